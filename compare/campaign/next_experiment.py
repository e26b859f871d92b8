"""The further experiment that would separate sets of parameters that fit equally well."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.campaign.search import Search, State, results_of
from rigtwin.compare.campaign.twin_runs import quantities_of, twin_run
from rigtwin.compare.campaign.vary import OF_PARTICLE, of_contact
from rigtwin.compare.deviation import is_result, key_of
from rigtwin.lab.camera import Camera
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.materials import PARAMETERS
from rigtwin.lab.rigs import DrumSettings, HopperSettings, PackingSettings, PileSettings, RigSettings

if TYPE_CHECKING:
    from rigtwin.compare.campaign.campaign import Campaign
    from rigtwin.compare.campaign.run import Result, Run
    from rigtwin.lab.arrays import Array
    from rigtwin.lab.progress import Progress

# they scale the ranking of candidates, not the fit
SEEDS = 2  # runs of each candidate with each set
REPETITIONS = 3  # that the further experiment would have
READ = 0.02  # relative standard uncertainty with which a result is read, beside its scatter
ENDS = 0.05  # share of the samples at each end of the family of sets


def candidates(fitted: Sequence[Experiment]) -> list[Experiment]:
    """Return a small packing, heap, drum and hopper of the fitted particle, but for rigs that are fitted already.

    Parameters
    ----------
    fitted : sequence of Experiment
        The fitted experiments; the first gives particle and wall.

    Returns
    -------
    list of Experiment
        One for each of these rigs.
    """
    known = fitted[0]
    d = known.particle.diameter
    rigs: dict[str, RigSettings] = {
        f"packing, cylinder {8e3 * d:.3g} mm": PackingSettings(8 * d, count=400),
        f"pile, base {14e3 * d:.3g} mm, rim {1.5e3 * d:.3g} mm": PileSettings(14 * d, 1.5 * d, count=700),
        f"drum {16e3 * d:.3g} mm, depth {5e3 * d:.3g} mm, 35 % full, 6 rpm": DrumSettings(
            16 * d, 6 * math.pi / 30, depth=5 * d, fill=0.35
        ),
        f"slot hopper, outlet {5e3 * d:.3g} mm, depth {8e3 * d:.3g} mm, 600 particles": HopperSettings(
            "slot", depth=8 * d, outlet=5 * d, bin_width=16 * d, count=600
        ),
    }
    there = {one.rig_name for one in fitted}
    return [
        Experiment(name, rig, known.particle, known.wall, Camera(), ())
        for name, rig in rigs.items()
        if rig.name not in there
    ]


def runs_needed(fitted: Sequence[Experiment]) -> int:
    """Return the number of runs of `next_experiments`.

    Parameters
    ----------
    fitted : sequence of Experiment
        Experiments that are fitted already.

    Returns
    -------
    int
        Number of runs.
    """
    return 2 * SEEDS * len(candidates(fitted))


def next_experiments(search: Search, found: State, campaign: Campaign, progress: Progress) -> list[dict[str, Any]]:
    """Return how far apart two sets that fit are in each candidate of a further experiment.

    The sets are likely ones from both ends of the family, along the longest axis of the samples.

    Parameters
    ----------
    search : Search
        The search of the calibration.
    found : State
        What it found; the runs are added to it.
    campaign : Campaign
        Computes the twins.
    progress : Progress
        Called with step, finished cost [s] and total cost [s].

    Returns
    -------
    list of dict
        For each candidate the row of `separations` that is most `apart`; the best candidate first.
    """
    ends = _ends(found.samples, found.density)
    runs: dict[tuple[str, int, int], Run] = {}
    for one in candidates(search.fitted):
        for k, point in enumerate(ends):
            shared = {name: value for name, value in search.values(point).items() if not _of_rig(name)}
            moved = search.setting(one, shared)
            for j in range(SEEDS):
                name = f"next-{one.rig_name}-set-{k}-seed-{j}"
                runs[one.id, k, j] = twin_run(name, *moved, seed=search.seed + j, **search.options)
    done = results_of(list(runs.values()), campaign, progress, "candidates for a further experiment")
    found.runs += len(runs)
    rows = []
    for one in candidates(search.fitted):
        sets = [[done.results.get(runs[one.id, k, j].name) for j in range(SEEDS)] for k in range(2)]
        if all(result is not None for results in sets for result in results):
            rows += sorted(separations(one, sets), key=lambda row: -row["apart"])[:1]
    return sorted(rows, key=lambda row: -row["apart"])


def _of_rig(name: str) -> bool:
    """Whether a parameter is a setting of a fitted rig, which another rig does not share."""
    return "." not in name and of_contact(name) not in PARAMETERS and name not in OF_PARTICLE


def _ends(samples: Array, density: Array) -> list[Array]:
    """A likely sample from each end of the longest axis."""
    centred = samples - samples.mean(axis=0)
    axis = np.linalg.svd(centred[:: max(1, len(centred) // 2000)], full_matrices=False)[2][0]
    order = np.argsort(centred @ axis)
    number = max(1, int(ENDS * len(order)))
    return [samples[group[int(np.argmax(density[group]))]] for group in (order[:number], order[-number:])]


def separations(experiment: Experiment, sets: list[list[Result | None]]) -> Iterator[dict[str, Any]]:
    """Compare two sets of parameters in a candidate experiment.

    Parameters
    ----------
    experiment : Experiment
        Candidate that both sets are run in.
    sets : list of list of Result
        For each of the two sets the results of its runs.

    Yields
    ------
    dict
        For each quantity ``one`` and ``other``, the means of the sets in its unit, and ``apart`` [1]: their difference
        over the standard uncertainty of a mean of three repetitions, scatter from seed to seed, the twins' own scatter
        and 2 % reading included.
    """
    tables: list[list[Mapping[Any, float]]] = [
        [
            {
                key_of(one): one.value
                for one in quantities_of(dict(result or {}))
                if is_result(one.quantity, one.detail.get("side")) and not one.doubtful and math.isfinite(one.value)
            }
            for result in results
        ]
        for results in sets
    ]
    every = [table for tables_of_set in tables for table in tables_of_set]
    for key in every[0]:
        if not all(key in table for table in every):
            continue
        values = np.array([[table[key] for table in tables_of_set] for tables_of_set in tables])
        one, other = values.mean(axis=1)
        scatter = math.sqrt(float(np.mean(values.var(axis=1, ddof=1))))
        read = READ * abs(one + other) / 2
        # the repetitions share what is read wrongly, and the two twins scatter, too
        off = math.sqrt(read**2 + scatter**2 / REPETITIONS + 2 * scatter**2 / SEEDS)
        yield {
            "experiment": experiment.id, "quantity": key[0], "method": key[1], "unit": key[2], "one": float(one),
            "other": float(other), "apart": abs(float(one - other)) / off if off > 0 else 0.0,
        }  # fmt: skip
