"""The diagnosis of one lab with many particles: run twins, fit the baseline, name the effect, measure the gap."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.compare.campaign.campaign import Campaign
from rigtwin.compare.campaign.runners import runner
from rigtwin.compare.campaign.store import Store
from rigtwin.compare.diagnose.bulk.axes import Axis, axes_of, twin_setting
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkLab
from rigtwin.compare.diagnose.bulk.further_experiment import FurtherExperiment, further_experiments
from rigtwin.compare.diagnose.bulk.misfit import BulkFit, fit, numbers
from rigtwin.compare.diagnose.bulk.naming import (
    ALARM,
    STATED,
    BulkCandidate,
    BulkNaming,
    excess,
    name_effects,
    probability,
)
from rigtwin.compare.diagnose.bulk.response import Response, response_of
from rigtwin.compare.diagnose.bulk.twin_design import Twins
from rigtwin.compare.diagnose.fitting.strained import strained
from rigtwin.compare.diagnose.selection.gap import Gap
from rigtwin.compare.diagnose.selection.locate import Disagreement
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.formatting import unit_of
from rigtwin.lab.progress import Progress, silent

LOOKS = 2  # second looks at likely effects
WORTH = 8.0  # score from which an effect is looked at again
NEAR = 20.0  # difference in score from the best up to which one is
FEWEST = 3  # repetitions of a lab in all
FAR = 3.0  # standard uncertainties from which a number is listed among those that disagree
NOISE = "scatter of the repetitions and of the twins from seed to seed, and a percent by which two codes may differ"


@dataclass(frozen=True)
class BulkDiagnosis:
    """Result of the diagnosis of a lab with many particles."""

    lab: BulkLab
    naming: BulkNaming
    responses: tuple[Response, ...]
    gap: Gap
    next_experiment: str
    designs: tuple[FurtherExperiment, ...] = ()
    left_out: tuple[str, ...] = ()
    runs: int = 0
    seconds: float = 0.0  # [s], CPU of this process
    form: str = ""
    stability: None = None
    beside: tuple[()] = ()
    model: Model = field(default_factory=Model)

    def __repr__(self) -> str:
        return f"<BulkDiagnosis of {self.lab.title!r}: {self.verdict}: {self.reason}>"

    @property
    def verdict(self) -> str:
        """ "none", "named", "indistinguishable", "unlisted" or "undecided"."""
        return self.naming.verdict

    @property
    def reason(self) -> str:
        """Why this is the verdict, in words."""
        return self.naming.reason

    @property
    def where(self) -> tuple[Disagreement, ...]:
        """Numbers in which measurement and baseline differ, the most different first."""
        return tuple(sorted(_differing(self.responses, self.naming.base), key=lambda one: -abs(one.z)))

    @property
    def where_in_words(self) -> str:
        """Where measurement and baseline differ, in one sentence."""
        return where_in_words(self.where, numbers(self.responses))

    @property
    def shown(self) -> BulkCandidate | None:
        """The effects that enter the model."""
        return self.naming.best if self.verdict in ("named", "indistinguishable") else None

    def to_json(self) -> dict[str, Any]:
        """The document of `diagnosis.json`, with the keys of that of a lab of single bodies."""
        naming = self.naming
        fitted = naming.base if self.shown is None else self.shown.fitted
        spreads = {axis.name: abs(axis.value(min(axis.std, 1.0)) - axis.value(0.0)) for axis in fitted.axes}
        calibrated = [
            {
                "name": name, "value": fitted.value(name), "std": fitted.std(name), "pull": pull,
                "stated_std": spreads[name],
            }
            for name, pull in fitted.pulls.items()
        ]  # fmt: skip
        return {
            "verdict": self.verdict,
            "reason": self.reason,
            "lab": self.lab.title,
            "path": str(self.lab.folder.resolve()),
            "experiments": [one.name for one in self.lab.conditions],
            "rig": self.lab.rigs,
            "left_out": list(self.left_out),
            "where": [
                {
                    "experiment": one.experiment, "record": one.record, "region": one.region, "z": one.z,
                    "p_adjusted": one.p_adjusted,
                    "deviation_m": one.deviation if math.isfinite(one.deviation) else None,
                }
                for one in self.where
            ],
            "where_in_words": self.where_in_words,
            "effects": list(_effects(self)),
            "indistinguishable": _sets(naming),
            "form": self.form,
            "gap": self.gap.to_json(),
            "next_experiment": self.next_experiment,
            "stability": None,
            "beside": [],
            "designs": [one.to_json() for one in self.designs],
            "calibration": calibrated,
            "strained": strained(calibrated),
            "scatter": [],
            "tried": [
                {
                    "effects": list(one.names), "gain": one.gain, "refused": one.reason,
                    "parameters": parameters_of(one), "converged": True,
                }
                for one in naming.tried
            ],
            "residual_statistic": {
                "before": _statistic(naming.base, self.responses),
                "after": None if self.shown is None else _statistic(self.shown.fitted, self.responses),
            },
            "twins": self.runs,
            "cpu_seconds": self.seconds,
        }  # fmt: skip


def diagnose_bulk(
    lab: BulkLab,
    store: Path,
    progress: Progress = silent,
    *,
    seed: int = 1,
    workers: int | None = None,
    cluster: str | None = None,
) -> BulkDiagnosis:
    """Diagnose a lab with many particles.

    Parameters
    ----------
    lab : BulkLab
        Records and statements.
    store : Path
        Folder that keeps the twins; a diagnosis that was stopped continues from it.
    progress : Progress
        Called with step, finished and total cost.
    seed : int
        First seed of the twins.
    workers : int, optional
        Number of processes of this machine; one for each core by default.
    cluster : str, optional
        A cluster for the runs, as in `rigtwin.compare.campaign.runners.runner`.

    Returns
    -------
    BulkDiagnosis
        Verdict "none", "named", "indistinguishable", "unlisted" or "undecided".

    Raises
    ------
    BadInput
        If there are too few repetitions, or the twins give nothing that was measured.
    """
    from threadpoolctl import threadpool_limits

    if lab.repetitions < FEWEST:
        raise BadInput(
            f"{lab.folder}: {lab.repetitions} repetition{'' if lab.repetitions == 1 else 's'} in all; at least "
            f"{FEWEST} are needed to separate an effect from scatter."
        )
    begun = time.process_time()
    axes = axes_of(lab)
    twins = Twins(lab, axes, seed)
    with threadpool_limits(1), Store(store) as kept, Campaign(kept, runner(cluster, workers, store)) as campaign:
        twins.first(campaign, progress)
        responses, naming = _named(lab, axes, twins)
        for look in range(1, LOOKS + 1):
            likely = _likely(naming)
            if not twins.again(likely, campaign, progress, look):
                break
            near = {axis: u for point in reversed(likely) for axis, u in point.items()}  # the best candidate's stays
            responses, naming = _named(lab, axes, twins, near)
        designs: list[FurtherExperiment] = []
        if naming.best is not None and naming.alike:
            designs = further_experiments(twins, (naming.best, *naming.alike), campaign, progress)
    found = BulkDiagnosis(
        lab, naming, responses, _gap(axes, responses, naming), "", tuple(designs), tuple(_left_out(lab, twins)),
        twins.asked, time.process_time() - begun,
    )  # fmt: skip
    return replace(found, next_experiment=_next(found), model=_model(found))


def _named(
    lab: BulkLab, axes: Sequence[Axis], twins: Twins, near: Mapping[Axis, float] | None = None
) -> tuple[tuple[Response, ...], BulkNaming]:
    for condition in lab.conditions:
        if condition.name not in twins.runs:
            why = next(iter(twins.failures.values()), "no reason is known")
            raise BadInput(f"{condition.name}: none of its twins could be run: {why}")
    responses = tuple(response_of(one, axes, twins.runs[one.name], near) for one in lab.conditions)
    return responses, name_effects(lab, axes, responses)


def _likely(naming: BulkNaming) -> list[Any]:
    """Coordinates of the effects that deserve a second look, the best first."""
    plausible = [one for one in naming.tried if not one.reason and one.score > WORTH]
    if not plausible:
        return []
    top = plausible[0].score
    return [one.point for one in plausible if top - one.score < NEAR][:4]


def _differing(responses: Sequence[Response], base: BulkFit) -> Iterator[Disagreement]:
    from scipy.stats import norm

    whole = numbers(responses)
    for one in responses:
        spread = np.sqrt(np.diag(one.covariance(base.u)))
        off = one.measured - one.predicted(base.u)
        for name, unit, value, std in zip(one.names, one.features.units, off, spread, strict=True):
            z = float(value / std) if std > 0 else 0.0
            if abs(z) > FAR:
                kind = "record" if (unit in ("m", "s") and "line" in name) or "time" in name else "result"
                yield Disagreement(
                    one.features.condition.name, kind, name.replace("_", " "), z,
                    min(1.0, whole * 2 * float(norm.sf(abs(z)))), float(value) if unit == "m" else math.nan,
                )  # fmt: skip


def where_in_words(found: Sequence[Disagreement], tested: int) -> str:
    """Return in one sentence where measurement and baseline differ.

    Parameters
    ----------
    found : sequence of Disagreement
        Numbers that differ, the most different first.
    tested : int
        How many numbers were compared.

    Returns
    -------
    str
        The sentence.
    """
    if not found:
        return (
            f"in no single number: none of {tested} differs by more than {FAR:g} standard uncertainties by itself; an "
            "effect is judged by the fit of all together"
        )
    conditions = list(dict.fromkeys(one.experiment for one in found))
    top = found[0]
    return (
        f"{len(found)} of {tested} numbers disagree, in {', '.join(conditions[:3])}; most the {top.region} of "
        f"{top.experiment} (z = {top.z:.1f})"
    )


def parameters_of(candidate: BulkCandidate) -> dict[str, dict[str, Any]]:
    """Return the coefficients of a candidate's effects.

    Parameters
    ----------
    candidate : BulkCandidate
        Candidate whose effects are listed.

    Returns
    -------
    dict of str to dict
        By name ``value``, ``std`` and ``unit``, in SI.
    """
    axes = {axis.name: axis for axis in candidate.fitted.axes}
    return {
        one.parameter if len(candidate.effects) == 1 else f"{one.name}.{one.parameter}": {
            "value": candidate.fitted.value(one.axis),
            "std": candidate.fitted.std(one.axis),
            "unit": axes[one.axis].unit,
        }
        for one in candidate.effects
    }


def _effects(found: BulkDiagnosis) -> Iterator[dict[str, Any]]:
    best = found.shown
    if best is None:
        return
    others = found.naming.alike
    weight = 1 / (1 + sum(math.exp((one.score - best.score) / 2) for one in others))
    for one in best.effects:
        yield {
            "effect": one.name, "title": one.title, "kind": one.kind,
            "parameters": parameters_of(replace(best, effects=(one,))), "probability": weight,
        }  # fmt: skip


def _sets(naming: BulkNaming) -> list[list[str]]:
    """The names that explain the measurements equally well."""
    if naming.best is None or not naming.alike:
        return []
    return [list(dict.fromkeys(name for one in (naming.best, *naming.alike) for name in one.names))]


def _statistic(fitted: BulkFit, responses: Sequence[Response]) -> dict[str, Any]:
    return {
        "S": excess(fitted) / numbers(responses), "p": probability(fitted, responses), "regions": numbers(responses),
        "spread": 1.0,
    }  # fmt: skip


def _gap(axes: Sequence[Axis], responses: Sequence[Response], naming: BulkNaming) -> Gap:
    """Mean squared deviation before and after, on all conditions and on one that is predicted from the others."""
    best = naming.best.fitted if naming.best is not None else naming.base
    number = numbers(responses)
    floor = max(number - len(best.freed), 1) / number
    found = Gap(excess(naming.base) / number, excess(best) / number, floor, noise=NOISE)
    if naming.best is None or len(responses) < 2:
        return found
    held = max(responses, key=lambda one: _missed(one, naming.base))
    others = [one for one in responses if one is not held]
    before, after = (fit(axes, others, freed) for freed in ((), best.freed))
    return replace(
        found,
        condition_before=_missed(held, before), condition_after=_missed(held, after), condition_noise_floor=1.0,
        condition=held.features.condition.name,
    )  # fmt: skip


def _missed(response: Response, fitted: BulkFit) -> float:
    """Mean squared deviation of a condition that was not fitted, what is uncertain of the fit included."""
    slopes = response.slopes(fitted.u)
    covariance = response.covariance(fitted.u) + slopes @ fitted.covariance @ slopes.T
    off = response.measured - response.predicted(fitted.u)
    return float(off @ np.linalg.solve(covariance, off)) / len(off)


def _left_out(lab: BulkLab, twins: Twins) -> Iterator[str]:
    yield from lab.left_out
    if twins.failures:
        yield f"{len(twins.failures)} of {twins.asked} twins failed, the first: {next(iter(twins.failures.values()))}"


def _next(found: BulkDiagnosis) -> str:
    naming = found.naming
    if found.verdict == "indistinguishable" and naming.best is not None:
        hints = "; or ".join(dict.fromkeys(e.splits for one in (naming.best, *naming.alike) for e in one.effects))
        if not found.designs:
            return hints
        one = found.designs[0]
        verb = "would separate them" if one.clear else "would separate them best, though not clearly"
        return (
            f"{one.words}, {one.repetitions} repetitions, {verb}: by {one.quantity} {' and '.join(one.between)} differ "
            f"by {one.separation:.1f} standard deviations; also: {hints}"
        )
    if found.verdict == "named" and naming.best is not None:
        return f"to confirm it: {naming.best.effects[0].splits}"
    if found.verdict == "none":
        return _sensitivity(naming)
    return "repeat the condition with the largest disagreement with one setting changed at a time"


def _sensitivity(naming: BulkNaming) -> str:
    """Smallest size of each effect that would have been named."""
    seen, blind = [], []
    for one in naming.tried:
        if len(one.effects) != 1:
            continue
        effect, fitted = one.effects[0], one.fitted
        axis = next(axis for axis in fitted.axes if axis.name == effect.axis)
        k = list(fitted.axes).index(axis)
        least = math.sqrt((ALARM + STATED) * float(fitted.covariance[k, k]))
        if least < 1:
            change = axis.value(least) if not axis.symmetric else abs(axis.value(least) - axis.value(0.0))
            seen.append(f"{effect.title} {change:.2g}{unit_of(axis.unit)}")
        else:
            blind.append(f"{effect.title} ({effect.splits})")
    text = "smallest effects that these data would have shown: " + ", ".join(seen) if seen else ""
    return text + ("; not detectable at any size: " + "; ".join(blind) if blind else "")


def _model(found: BulkDiagnosis) -> Model:
    """The lab's model with the physical effects that were named."""
    model, best = found.lab.model, found.shown
    if best is None:
        return model
    contacts, particles, effects = dict(model.contacts), dict(model.particles), dict(model.effects)
    for condition in found.lab.conditions:
        experiment, changed = twin_setting(found.lab, condition, best.point)
        contacts |= {pair: one for pair, one in changed.contacts.items() if one != model.contacts.get(pair)}
        effects |= changed.effects
        bead = experiment.particle
        if bead.shape is None and bead.name in particles:
            particles[bead.name] = bead
    return replace(model, contacts=contacts, particles=particles, effects=effects)


def not_in_the_model(found: BulkDiagnosis) -> list[str]:
    """Return one sentence for each effect that a model.toml does not hold.

    Parameters
    ----------
    found : BulkDiagnosis
        Diagnosis whose effects are checked.

    Returns
    -------
    list of str
        Sentences; empty where the model holds all effects.
    """
    held = {"rolling_resistance", "sliding_friction", "wall_friction", "cohesion_sjkr", "particle_size"}
    return [
        f"{one.title}: is no part of a model; {one.parameter} = {found.shown.fitted.value(one.axis):.4g} (SI)"
        for one in (found.shown.effects if found.shown is not None else ())
        if one.name not in held and found.shown is not None
    ]
