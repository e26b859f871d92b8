"""How large the disagreement is, before and after: on the data used, and on repetitions and conditions held out.

The gap is the mean squared deviation of rows and impacts in units of their noise, the pulls of the calibration
included; 1 and less is noise.  All models are held against one noise and one scatter between impacts, those of the best
model, save where an effect widens them: then each model is held against its own.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.fitting.fit import Fit, fit
from rigtwin.compare.diagnose.fitting.normal_equations import Bench, Regioned
from rigtwin.compare.diagnose.fitting.subset import cut, subset
from rigtwin.sim.effects import Effect

MOST_NOISE = 1.5  # times the white noise, as variance: more is a misfit that differs between repetitions

ONE_NOISE = "before and after on the same noise and the same scatter between impacts"
OWN_NOISE = {
    "jitter": "before on the stated noise, after on the noise that the jitter widens",
    "scatter": "before on the scatter of a sphere's impacts, after on the wider scatter that is the effect",
}


@dataclass(frozen=True)
class Gap:
    """Before and after a term is added, and the floor that noise alone would leave."""

    before: float
    after: float
    noise_floor: float
    held_out_before: float | None = None
    held_out_after: float | None = None
    held_out_noise_floor: float | None = None
    held_out_gain: float | None = None
    """By how much the deviance of those repetitions falls [noise^2]: seen where the mean over all rows is not."""
    condition_before: float | None = None
    condition_after: float | None = None
    condition_noise_floor: float | None = None
    condition: str = ""
    noise: str = ONE_NOISE

    def to_json(self) -> dict[str, float | str | None]:
        return asdict(self)

    @property
    def closed(self) -> float | None:
        """Share of the excess over the noise that the term closes."""
        return closed(self.before, self.after, self.noise_floor)


def closed(before: float | None, after: float | None, floor: float | None) -> float | None:
    if before is None or after is None or floor is None or before - floor < 1e-3:
        return None
    return 1 - max(after - floor, 0.0) / (before - floor)


def noise_floor(bench: Regioned, final: Fit) -> float:
    """Squared deviation per coordinate [noise^2] that a model without any gap would leave."""
    return _noise_level(bench, final) * _floor(bench, final)


def gap(bench: Regioned, lab: TrackedLab, base: Fit, best: Fit | None) -> Gap:
    """The gap of the baseline and of the best model, in sample and held out."""
    final = best or base
    level, floor = _noise_level(bench, final), noise_floor(bench, final)
    scatter = _shared_scatter(base, final)
    inside = Gap(_size(bench, base, scatter), _size(bench, final, scatter), floor, noise=_noise_in_words(final))
    if best is None:
        return inside
    last = _last_repetitions(lab)
    if last:
        before, after, floor, gain = _held_out(bench, last, base, best)
        inside = replace(
            inside,
            held_out_before=before,
            held_out_after=after,
            held_out_noise_floor=level * floor,
            held_out_gain=gain / level,
        )
    one = _extreme_condition(lab)
    if one is not None:
        runs = np.flatnonzero(bench.condition == one).tolist()
        before, after, floor, _ = _held_out(bench, runs, base, best)
        inside = replace(
            inside,
            condition_before=before,
            condition_after=after,
            condition_noise_floor=level * floor,
            condition=lab.conditions[one].name,
        )
    return inside


@dataclass(frozen=True)
class Beside:
    """Another set of effects in the winner's place, fitted to all data: how much of the gap a wrong name closes."""

    role: str  # "runner-up" or "placebo"
    effects: tuple[str, ...]
    gain: float
    gap_after: float
    closed: float | None

    def to_json(self) -> dict[str, object]:
        return asdict(self)


def beside(
    bench: Regioned, base: Fit, sizes: Gap, best: Fit, tried: Sequence[tuple[Fit, float]], seed: str
) -> tuple[Beside, ...]:
    """The best other set of as many effects, and a single effect drawn by lot, both fitted like the winner."""
    groups = {term.group for term in best.terms}
    others = [one for one in tried if one[0].terms and not groups & {term.group for term in one[0].terms}]
    same = [one for one in others if len(one[0].terms) == len(best.terms)] or others
    if not same:
        return ()
    second = max(same, key=lambda one: one[1])
    lots = [one for one in others if len(one[0].terms) == 1 and one is not second]
    drawn = [("runner-up", second)]
    if lots:
        drawn.append(("placebo", random.Random(seed).choice(lots)))
    found = []
    for role, (near, _gain) in drawn:
        fitted = fit(bench, near.terms, near=replace(near, local=base.local, scatter=base.scatter), most=12, rounds=1)
        size = _size(bench, fitted, _shared_scatter(base, best))
        share = closed(sizes.before, size, sizes.noise_floor)
        names_ = tuple(term.name for term in near.terms)
        found.append(Beside(role, names_, base.deviance - fitted.deviance, size, share))
    return tuple(found)


def _held_out(bench: Regioned, runs: Sequence[int], base: Fit, best: Fit) -> tuple[float, float, float, float]:
    """Fitted on the other repetitions, judged on these, whose own release and impacts are all that is fitted there."""
    others = [r for r in range(len(bench.spans)) if r not in runs]
    seen, unseen = subset(bench, others), subset(bench, runs)
    judges = []
    for whole in (best, base):
        trained = fit(seen, whole.terms, near=cut(whole, others), most=15, rounds=1)
        held = {
            u.name: float(v)
            for u, v in zip(trained.unknowns, trained.values, strict=True)
            if seen_in(bench, u.name, others)
        }
        judged = fit(unseen, whole.terms, near=cut(whole, runs, trained.values), held=held, most=15, rounds=1)
        judges.append(judged)
    after, before = judges
    scatter = _shared_scatter(before, after)
    gain = float(before.by_run.sum()) - float(after.by_run.sum())
    return _size(unseen, before, scatter), _size(unseen, after, scatter), _floor(unseen, after), gain


def runs_held_out(bench: Regioned, lab: TrackedLab) -> set[int]:
    """Numbers of the repetitions that a model is held against without having been fitted to them."""
    one = _extreme_condition(lab)
    return {*_last_repetitions(lab), *([] if one is None else np.flatnonzero(bench.condition == one).tolist())}


def seen_in(bench: Bench, name: str, runs: Sequence[int]) -> bool:
    """Whether an unknown acts in any of these repetitions: a doubt of the held-out condition alone, such as its angle,
    is no part of the model."""
    part = bench.touches(name)
    return part is None or bool(part[1][list(runs)].any())


def _widens(fitted: Fit) -> bool:
    """Whether an effect of the model is the scatter between impacts itself."""
    return any(term.geometry == "scatter" for term in fitted.terms)


def _shared_scatter(base: Fit, best: Fit) -> np.ndarray:
    """What all are held against: the best model's, for the baseline's has taken up part of the effect; the baseline's,
    kept to that of spheres, where a wider scatter is the effect."""
    return base.scatter if _widens(best) else best.scatter


def _noise_in_words(fitted: Fit) -> str:
    kinds = [term.geometry for term in fitted.terms if term.geometry in OWN_NOISE]
    return "; ".join(OWN_NOISE[kind] for kind in kinds) or ONE_NOISE


def _size(bench: Bench, fitted: Fit, shared: np.ndarray) -> float:
    scatter = fitted.scatter if _widens(fitted) else shared
    inside = bench.scatter >= 0
    total = fitted.chi2 + sum(pull**2 for pull in fitted.pulls.values())
    if inside.any():
        spread = scatter[bench.scatter[inside]]
        total += float(np.sum((fitted.soft[inside] / spread) ** 2))
    return total / (fitted.residual.size + int(inside.sum()))


def _noise_level(bench: Regioned, fitted: Fit) -> float:
    """Variance of the residuals about what repetitions share, over that of the white noise; at least 1.

    Correlated tracking errors and the picture's pixels are in the residuals of any model; what the repetitions of a
    condition have in common in a region is not noise.
    """
    owner = bench.condition[np.repeat(np.arange(len(bench.spans)), [s.stop - s.start for s in bench.spans])]
    cell = owner * len(bench.region_names) + bench.region
    inside = bench.region >= 0
    _, cell = np.unique(cell[inside], return_inverse=True)
    counts = np.bincount(cell)
    rest, taken = 0.0, 2 * len(counts)
    for k in (0, 1):
        residual = fitted.residual[inside, k]
        means = np.bincount(cell, residual) / counts
        rest += float(np.sum((residual - means[cell]) ** 2))
    free = 2 * int(inside.sum()) - taken - fitted.leverage
    return min(max(1.0, rest / free), MOST_NOISE) if free > 0 else 1.0


def _floor(bench: Bench, fitted: Fit) -> float:
    rows = fitted.residual.size + int((bench.scatter >= 0).sum())
    return max(rows - fitted.leverage, 1.0) / rows


def _last_repetitions(lab: TrackedLab) -> list[int]:
    """Numbers of the last repetition of each condition that has more than one."""
    counts = np.array([len(condition.repetitions) for condition in lab.conditions])
    return (np.cumsum(counts) - 1)[counts > 1].tolist()  # type: ignore[no-any-return]


def _extreme_condition(lab: TrackedLab) -> int | None:
    """One condition held out whole: the last in the list whose bead and wall are seen in others too."""
    for number in reversed(range(len(lab.conditions))):
        one = lab.conditions[number]
        rest = [c for c in lab.conditions if c is not one]
        if any(c.bead.name == one.bead.name and c.wall == one.wall for c in rest) and len(rest) > 1:
            return number
    return None


def names(terms: Sequence[Effect]) -> str:
    """The titles of some effects, as a sentence has them."""
    return " and ".join(term.title for term in terms)
