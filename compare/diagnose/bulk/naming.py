"""Which effect, or pair of effects, explains the measurements: gains, rivals and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from rigtwin.compare.diagnose.bulk.axes import Axis
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkLab
from rigtwin.compare.diagnose.bulk.candidates import LEAST_SIGNIFICANCE, BulkEffect, effects_of
from rigtwin.compare.diagnose.bulk.misfit import BulkFit, fit, numbers
from rigtwin.compare.diagnose.bulk.response import Response
from rigtwin.compare.diagnose.diagnosis import LEFT, SURE
from rigtwin.compare.diagnose.selection.name_effects import ALIKE

ALARM = 14.0  # deviance that a first effect gains at least: p = 2e-4 for one of some fifteen effects
SECOND = 14.0  # deviance that a second effect gains at least beside the first
SHARE = 0.02  # least share of the first one's gain: the quadratics are accurate to about 1/7, whose square is 2 %
END = 0.999  # coordinate above which an effect counts as at the end of its range
STATED = 2.0  # deviance that it costs to contradict a stated value
LEADING = 5  # single effects from which pairs are made


@dataclass(frozen=True)
class BulkCandidate:
    """One effect, or two, fitted together with the baseline."""

    effects: tuple[BulkEffect, ...]
    fitted: BulkFit
    gain: float
    reason: str = ""
    """Why it is refused; empty if it is plausible."""

    @property
    def score(self) -> float:
        """Gain less the cost of each stated value that it contradicts."""
        axes = {axis.name: axis for axis in self.fitted.axes}
        return self.gain - STATED * sum(axes[one.axis].std > 0 for one in self.effects)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(one.name for one in self.effects)

    @property
    def title(self) -> str:
        return " and ".join(one.title for one in self.effects)

    @property
    def at_an_end(self) -> bool:
        """Whether an effect would need more than the range that is tried."""
        return any(abs(self.fitted.coordinate(one.axis)) > END for one in self.effects)

    @property
    def point(self) -> Mapping[Axis, float]:
        """Coordinates of the axes that it frees."""
        axes = {axis.name: axis for axis in self.fitted.axes}
        return {axes[one.axis]: self.fitted.coordinate(one.axis) for one in self.effects}


@dataclass(frozen=True)
class BulkNaming:
    """All candidates, and the verdict."""

    base: BulkFit
    tried: tuple[BulkCandidate, ...]  # the highest score first
    verdict: str
    reason: str
    best: BulkCandidate | None = None
    alike: tuple[BulkCandidate, ...] = ()
    """Others that explain the measurements equally well."""


def name_effects(lab: BulkLab, axes: Sequence[Axis], responses: Sequence[Response]) -> BulkNaming:
    """Fit the baseline, each effect and pairs of the leading ones, and judge them."""
    base = fit(axes, responses)
    visible = [axis for k, axis in enumerate(axes) if any(one.depends_on(k) for one in responses)]
    singles = [_candidate(axes, responses, base, (one,)) for one in effects_of(lab, visible)]
    singles.sort(key=lambda one: -one.score)
    plausible = [one for one in singles if not one.reason]
    tried = list(singles)
    # no pair can gain more than the best effect leaves
    if plausible and plausible[0].score > ALARM and excess(plausible[0].fitted) > SECOND:
        leading = plausible[:LEADING]
        pairs = [
            _candidate(axes, responses, base, (one.effects[0], other.effects[0]), one.fitted)
            for one, other in combinations(leading[:1] + [one for one in singles if one not in leading[:1]], 2)
            if one in leading
        ]
        tried += pairs
    tried.sort(key=lambda one: -one.score)
    verdict, reason, best, alike = judged(base, tried, responses)
    return BulkNaming(base, tuple(tried), verdict, reason, best, alike)


def _candidate(
    axes: Sequence[Axis], responses: Sequence[Response], base: BulkFit, effects: tuple[BulkEffect, ...],
    near: BulkFit | None = None,
) -> BulkCandidate:  # fmt: skip
    freed = tuple(one.axis for one in effects)
    fitted = fit(axes, responses, freed, base.u if near is None else near.u)
    return BulkCandidate(effects, fitted, base.deviance - fitted.deviance, _refused(fitted, effects))


def _refused(fitted: BulkFit, effects: Sequence[BulkEffect]) -> str:
    for one in effects:
        sigmas = fitted.significance(one.axis)
        if sigmas < LEAST_SIGNIFICANCE:
            return f"its {one.parameter.replace('_', ' ')} is {sigmas:.1f} standard uncertainties from the stated one"
    return ""


def probability(fitted: BulkFit, responses: Sequence[Response]) -> float:
    """Probability of a misfit as large as this one."""
    from scipy.stats import chi2

    free = max(numbers(responses) - len(fitted.freed), 1)
    return float(chi2.sf(excess(fitted), free))


def excess(fitted: BulkFit) -> float:
    """Squared deviations of measured numbers and stated values over their uncertainties."""
    return fitted.chi2 + sum(pull**2 for pull in fitted.pulls.values())


def closed(base: BulkFit, fitted: BulkFit, responses: Sequence[Response]) -> float:
    """Share of the excess gap that a fit closes."""
    floor = float(numbers(responses))
    before, after = excess(base), excess(fitted)
    return 1.0 if before <= floor else 1 - max(after - floor, 0.0) / (before - floor)


def judged(
    base: BulkFit, tried: Sequence[BulkCandidate], responses: Sequence[Response]
) -> tuple[str, str, BulkCandidate | None, tuple[BulkCandidate, ...]]:
    """Verdict, reason, best candidate and its rivals."""
    plausible = [one for one in tried if not one.reason]
    singles = [one for one in plausible if len(one.effects) == 1 and one.score > ALARM]
    if not singles:
        if probability(base, responses) < SURE:
            why = "measurement and twin disagree, and no listed effect describes how"
            return "unlisted", why, None, ()
        why = "the measurements agree with the twin within scatter and stated uncertainties"
        return "none", why, None, ()
    best = singles[0]
    pairs = [
        one
        for one in plausible
        if len(one.effects) == 2
        and one.score - best.score > max(SECOND, SHARE * best.gain)
        and not replace(one, effects=tuple(each for each in one.effects if each not in best.effects)).at_an_end
    ]
    if pairs:
        best = pairs[0]
    share = closed(base, best.fitted, responses)
    if probability(best.fitted, responses) < SURE and share < LEFT:
        why = f"{best.title} would close only {100 * share:.0f} % of the gap and leave a disagreement"
        return "unlisted", why, None, ()
    same = [one for one in plausible if len(one.effects) == len(best.effects) and one is not best]
    alike = tuple(one for one in same if best.score - one.score < ALIKE and (best.at_an_end or not one.at_an_end))
    if alike:
        others = "; ".join(one.title for one in alike)
        return "indistinguishable", f"{best.title} explains the measurements; equally well: {others}", best, alike
    return "named", f"{best.title} explains the disagreement", best, ()
