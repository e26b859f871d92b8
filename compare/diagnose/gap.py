"""How large the disagreement is, before and after: on the data used, and on repetitions and conditions held out.

The gap is the mean squared deviation of rows and impacts in units of their noise, the pulls of the calibration
included; 1 and less is noise.  Before and after use the same noise and the same scatter between impacts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from rigtwin.compare.diagnose.fit import Bench, Fit, fit
from rigtwin.compare.diagnose.labs import TrackedLab
from rigtwin.sim.effects import Effect

Build = Callable[[TrackedLab], Bench]


@dataclass(frozen=True)
class Gap:
    """Before and after a term is added, and the floor that noise alone would leave."""

    before: float
    after: float
    noise_floor: float
    held_out_before: float | None = None
    held_out_after: float | None = None
    held_out_noise_floor: float | None = None
    condition_before: float | None = None
    condition_after: float | None = None
    condition_noise_floor: float | None = None
    condition: str = ""

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


def gap(build: Build, bench: Bench, lab: TrackedLab, base: Fit, best: Fit | None) -> Gap:
    """The gap of the baseline and of the best model, in sample and held out."""
    final = best or base
    inside = Gap(_size(bench, base, final.scatter), _size(bench, final, final.scatter), _floor(bench, final))
    if best is None:
        return inside
    train, test = _last_repetitions(lab)
    if train is not None and test is not None:
        before, after, floor = _held_out(build, train, test, base, best)
        inside = replace(inside, held_out_before=before, held_out_after=after, held_out_noise_floor=floor)
    rest, one = _extreme_condition(lab)
    if rest is not None and one is not None:
        before, after, floor = _held_out(build, rest, one, base, best)
        inside = replace(
            inside,
            condition_before=before,
            condition_after=after,
            condition_noise_floor=floor,
            condition=one.conditions[0].name,
        )
    return inside


def _held_out(build: Build, train: TrackedLab, test: TrackedLab, base: Fit, best: Fit) -> tuple[float, float, float]:
    """Fitted on one part, judged on the other, whose own release and impacts are all that is fitted there."""
    seen, unseen = build(train), build(test)
    sizes = []
    scatter = None
    for whole in (best, base):
        trained = fit(seen, whole.terms, start=_by_name(whole), most=25, rounds=2)
        values = _by_name(trained)
        known = {u.name for u in unseen.unknowns(whole.terms)}
        judged = fit(unseen, whole.terms, held={k: v for k, v in values.items() if k in known}, most=25, rounds=1)
        if scatter is None:
            scatter, floor = judged.scatter, _floor(unseen, judged)
        sizes.append(_size(unseen, judged, scatter))
    return sizes[1], sizes[0], floor


def _by_name(fitted: Fit) -> dict[str, float]:
    return {unknown.name: float(value) for unknown, value in zip(fitted.unknowns, fitted.values, strict=True)}


def _size(bench: Bench, fitted: Fit, scatter: np.ndarray) -> float:
    inside = bench.scatter >= 0
    total = fitted.chi2 + sum(pull**2 for pull in fitted.pulls.values())
    if inside.any():
        spread = scatter[bench.scatter[inside]]
        total += float(np.sum((fitted.soft[inside] / spread) ** 2))
    return total / (fitted.residual.size + int(inside.sum()))


def _floor(bench: Bench, fitted: Fit) -> float:
    rows = fitted.residual.size + int((bench.scatter >= 0).sum())
    return max(rows - fitted.leverage, 1.0) / rows


def _last_repetitions(lab: TrackedLab) -> tuple[TrackedLab | None, TrackedLab | None]:
    """All but the last repetition of each condition, and those."""
    if any(len(condition.repetitions) < 2 for condition in lab.conditions):
        return None, None
    train = [replace(c, repetitions=c.repetitions[:-1], files=c.files[:-1]) for c in lab.conditions]
    test = [replace(c, repetitions=c.repetitions[-1:], files=c.files[-1:]) for c in lab.conditions]
    return replace(lab, conditions=tuple(train)), replace(lab, conditions=tuple(test))


def _extreme_condition(lab: TrackedLab) -> tuple[TrackedLab | None, TrackedLab | None]:
    """One condition held out whole: the last in the list whose bead and wall are seen in others too."""
    for condition in reversed(lab.conditions):
        rest = [c for c in lab.conditions if c is not condition]
        if any(c.bead.name == condition.bead.name and c.wall == condition.wall for c in rest) and len(rest) > 1:
            return replace(lab, conditions=tuple(rest)), replace(lab, conditions=(condition,))
    return None, None


def names(terms: Sequence[Effect]) -> str:
    """The titles of some effects, as a sentence has them."""
    return " and ".join(term.title for term in terms)
