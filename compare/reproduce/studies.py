"""Influence of particle number, base size and evaluation on the angle of repose (Hlosta et al. 2020, section 3.4).

The paper advises that "the base to particle size ratio should be greater than 25, and the calibration experiment should
contain approximately 4000 particles", and that evaluations differ.  Each study pours piles of D6.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any

from rigtwin.compare.campaign.run import Run
from rigtwin.compare.reproduce.tables import pile_run, under
from rigtwin.lab.errors import BadInput
from rigtwin.lab.reference import hlosta2020

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

Results = Mapping[str, dict[str, Any]]
Points = Mapping[str, Sequence[tuple[float | str, float, float | None, int]]]
"""By reading: varied value, mean angle [deg], standard deviation over piles [deg], and number of piles."""

PARTICLE = "D6"
COUNTS = (250, 500, 1000, 2000, 4000)
COUNT_BASE = 0.15  # [m]
RATIOS = (6, 10, 15, 20, 25)  # base over bead diameter
REPETITIONS = 3
READINGS = {
    "graphical, 15-85 %": "graphical_line_15_85_deg",
    "graphical, 20-80 %": "graphical_line_20_80_deg",
    "geometric, apex": "geometric_apex_deg",
    "geometric, equal area": "geometric_equal_area_deg",
}
SHOWN = ("graphical, 15-85 %", "geometric, apex", "geometric, equal area")


@dataclass(frozen=True)
class Study:
    """Angles of repose as a function of one varied quantity."""

    name: str
    title: str
    x_label: str
    places: Mapping[float | str, tuple[str, ...]]  # the varied value, or the base in words -> names of its runs
    readings: Mapping[str, str]  # name of the reading -> key in the results
    rolling: Rolling = "type A"  # rolling resistance law

    def points(self, results: Results) -> Points:
        """Mean and standard deviation of the finished runs, by reading."""
        found: dict[str, list[tuple[float | str, float, float | None, int]]] = {}
        for reading, key in self.readings.items():
            for place, names in self.places.items():
                values = [float(results[name][key]) for name in names if key in results.get(name, {})]
                if values:
                    spread = stdev(values) if len(values) > 1 else None
                    found.setdefault(reading, []).append((place, fmean(values), spread, len(values)))
        return found


def studies(
    names: Sequence[str] | None,
    *,
    repetitions: int | None = None,
    seed: int,
    rolling: Rolling = "type A",
    quick: bool = False,
) -> tuple[list[Run], list[Study]]:
    """The runs of the studies `names` (all if None), and the studies; a point is the mean of `repetitions` piles.

    A `quick` study has one pile for each point by default.
    """
    seeds = range(seed, seed + (repetitions or (1 if quick else REPETITIONS)))
    runs: dict[str, Run] = {}
    found = []
    check_studies(names or ())
    for name in STUDIES if names is None else names:
        study, needed = STUDIES[name](seeds)
        mine = {run.name: under(rolling, run) for run in needed}
        places = {place: tuple(mine[run].name for run in named) for place, named in study.places.items()}
        found.append(replace(study, places=places, rolling=rolling))
        runs.update({run.name: run for run in mine.values()})
    return list(runs.values()), found


def check_studies(names: Sequence[str]) -> None:
    """Raise `BadInput` for an unknown study."""
    for name in names:
        if name not in STUDIES:
            raise BadInput(f"--study: there is no study {name!r}; known are {', '.join(STUDIES)}.")


def _number(seeds: Sequence[int]) -> tuple[Study, list[Run]]:
    runs = {count: [pile_run(PARTICLE, COUNT_BASE, seed, count) for seed in seeds] for count in COUNTS}
    title = f"Number of particles: {PARTICLE} poured on a base of {COUNT_BASE * 1e3:.0f} mm"
    readings = {reading: READINGS[reading] for reading in SHOWN}
    return Study("number", title, "particles poured", _names(runs), readings), _flat(runs)


def _base(seeds: Sequence[int]) -> tuple[Study, list[Run]]:
    bead = hlosta2020.particle(PARTICLE).diameter
    runs = {ratio: [pile_run(PARTICLE, ratio * bead, seed) for seed in seeds] for ratio in RATIOS}
    title = f"Base over particle size: {PARTICLE}, the surplus falls over the rim"
    readings = {reading: READINGS[reading] for reading in SHOWN}
    return Study("base", title, "base diameter / bead diameter", _names(runs), readings), _flat(runs)


def _evaluation(seeds: Sequence[int]) -> tuple[Study, list[Run]]:
    runs = {f"{base * 1e3:.0f} mm": [pile_run(PARTICLE, base, seed) for seed in seeds] for base in (0.09, 0.15)}
    above = {f"{reading}, above the rim": key for reading, key in READINGS.items()}
    plate = {f"{reading}, above the plate": f"{key}_from_plate" for reading, key in READINGS.items()}
    title = f"Evaluation: the same piles of {PARTICLE}, read in eight ways"
    return Study("evaluation", title, "base", _names(runs), above | plate), _flat(runs)


def _names(runs: Mapping[Any, Sequence[Run]]) -> dict[float | str, tuple[str, ...]]:
    return {place: tuple(run.name for run in mine) for place, mine in runs.items()}


def _flat(runs: Mapping[Any, Sequence[Run]]) -> list[Run]:
    return [run for mine in runs.values() for run in mine]


STUDIES = {"number": _number, "base": _base, "evaluation": _evaluation}
