"""Size of the disagreement before and after adding effects, on all data and on held-out repetitions and conditions.

The gap is the mean squared deviation of rows and impacts in units of their noise, including the pulls of the
calibration; about 1 is noise.  All models are judged with the noise and the impact scatter of the best model, except
where an effect widens them: then each model is judged with its own.
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

MOST_NOISE = 1.5  # largest noise variance over that of white noise; more is a misfit that differs between repetitions

ONE_NOISE = "before and after relative to the same noise and the same scatter between impacts"
OWN_NOISE = {
    "jitter": "before relative to the stated noise, after relative to the noise widened by the jitter",
    "scatter": "before relative to the impact scatter of a sphere, after relative to the wider scatter of the effect",
}


@dataclass(frozen=True)
class Gap:
    """Gap before and after adding effects, and the noise floor."""

    before: float
    after: float
    noise_floor: float
    held_out_before: float | None = None
    held_out_after: float | None = None
    held_out_noise_floor: float | None = None
    held_out_gain: float | None = None
    """Decrease of the deviance of those repetitions [noise^2]; more sensitive than the mean over all rows."""
    condition_before: float | None = None
    condition_after: float | None = None
    condition_noise_floor: float | None = None
    condition: str = ""
    noise: str = ONE_NOISE

    def to_json(self) -> dict[str, float | str | None]:
        return asdict(self)

    @property
    def closed(self) -> float | None:
        """Share of the excess over the noise floor that the effects close."""
        return closed(self.before, self.after, self.noise_floor)


def closed(before: float | None, after: float | None, floor: float | None) -> float | None:
    if before is None or after is None or floor is None or before - floor < 1e-3:
        return None
    return 1 - max(after - floor, 0.0) / (before - floor)


def noise_floor(bench: Regioned, final: Fit) -> float:
    """Mean squared deviation per coordinate [noise^2] that a perfect model would leave."""
    return _noise_level(bench, final) * _floor(bench, final)


def gap(bench: Regioned, lab: TrackedLab, base: Fit, best: Fit | None) -> Gap:
    """Gap of the baseline and of the best model, on all data and on held-out data."""
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
    """Another set of effects, fitted to all data instead of the winner: the gap that a wrong name closes."""

    role: str  # "runner-up" or "placebo"
    effects: tuple[str, ...]
    title: str
    gain: float
    gap_after: float
    closed: float | None

    def to_json(self) -> dict[str, object]:
        return asdict(self)


def beside(
    bench: Regioned, base: Fit, sizes: Gap, best: Fit, tried: Sequence[tuple[Fit, float]], seed: str
) -> tuple[Beside, ...]:
    """The best other set with as many effects, and a randomly chosen single effect, both fitted like the winner."""
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
        found.append(Beside(role, names_, names(near.terms), base.deviance - fitted.deviance, size, share))
    return tuple(found)


def _held_out(bench: Regioned, runs: Sequence[int], base: Fit, best: Fit) -> tuple[float, float, float, float]:
    """Gap before, gap after, noise floor and gain on the repetitions `runs`, for models fitted to the others.

    On `runs` only the releases and impacts are fitted.
    """
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
    """Numbers of the held-out repetitions."""
    one = _extreme_condition(lab)
    return {*_last_repetitions(lab), *([] if one is None else np.flatnonzero(bench.condition == one).tolist())}


def seen_in(bench: Bench, name: str, runs: Sequence[int]) -> bool:
    """Whether an unknown acts in any of these repetitions.  Unknowns of the held-out condition alone, such as its
    angle, are not part of the tested model."""
    part = bench.touches(name)
    return part is None or bool(part[1][list(runs)].any())


def _widens(fitted: Fit) -> bool:
    """Whether the model has an effect that widens the scatter between impacts."""
    return any(term.geometry == "scatter" for term in fitted.terms)


def _shared_scatter(base: Fit, best: Fit) -> np.ndarray:
    """The impact scatter used for all models: that of the best model, as that of the baseline has absorbed part of the
    effect; if a wider scatter is the effect, that of the baseline, which is limited to that of spheres."""
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
    """Variance of the residuals about their mean over repetitions, over that of white noise; at least 1.

    Residuals of every model contain correlated tracking errors and pixel locking; the mean over the repetitions of a
    condition in a region is misfit, not noise.
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
    """Number of the last repetition of each condition that has more than one."""
    counts = np.array([len(condition.repetitions) for condition in lab.conditions])
    return (np.cumsum(counts) - 1)[counts > 1].tolist()  # type: ignore[no-any-return]


def _extreme_condition(lab: TrackedLab) -> int | None:
    """Number of the held-out condition: the last whose bead and wall also occur in others; None if there is none."""
    for number in reversed(range(len(lab.conditions))):
        one = lab.conditions[number]
        rest = [c for c in lab.conditions if c is not one]
        if any(c.bead.name == one.bead.name and c.wall == one.wall for c in rest) and len(rest) > 1:
            return number
    return None


def names(terms: Sequence[Effect]) -> str:
    """Titles of some effects, joined for a sentence."""
    return " and ".join(term.title for term in terms)
