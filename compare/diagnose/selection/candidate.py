"""A candidate set of effects: its fit, its gain, and the reason if it is refused as implausible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.lab.formatting import unit_of
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.effect import WIDENING

SHUTTER = "rolling_shutter"
JITTER = 24.0  # deviance that jitter must gain in addition
OVERTAKEN = 0.5  # jitter in frame intervals; above this one frame in thirteen is taken before its predecessor
READ_OUT = 10.0  # longest read-out in frames; a camera needs at most one, the rest allows for a wrong stated rate
WHITE = 0.6  # smallest whiteness of the residuals (1 for white noise) that is compatible with jitter
# standard deviations from zero that show an effect as small as in every lab: of 80 independent null labs none has one
# beyond 8; 2 labs with a hidden perspective were called unlisted and none without it
CLEARLY_SEEN = 10.0
BEYOND = 0.1  # share of its range by which the uncertainty of a coefficient may excuse a value above the range


@dataclass(frozen=True)
class Candidate:
    """A set of effects and its fit."""

    terms: tuple[Effect, ...]
    fitted: Fit
    gain: float
    """Deviance of the baseline less that of the candidate, over the spread of the residuals; higher is better."""
    reason: str = ""
    """Why it is refused, empty if it is plausible."""
    rough: Fit | None = None
    """Its fit to part of the data, if it was screened."""
    cost: float = 0.0
    """Cost of the search over shapes that was subtracted from the gain of a formula."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(term.name for term in self.terms)

    @property
    def groups(self) -> frozenset[str]:
        return frozenset(term.group for term in self.terms)

    @property
    def score(self) -> float:
        """Gain less the penalty for coefficients far from their physical prediction."""
        return self.gain - sum(surprise(self.fitted, term) for term in self.terms)


def best_of(candidates: Sequence[Candidate]) -> Candidate | None:
    """The plausible candidate with the highest score, or None."""
    return max((one for one in candidates if not one.reason), key=lambda one: one.score, default=None)


def front_of(candidates: Sequence[Candidate], count: int) -> list[Candidate]:
    """The best plausible candidate of each family, highest score first, at most `count`."""
    front: list[Candidate] = []
    for one in sorted((c for c in candidates if not c.reason), key=lambda c: -c.score):
        if all(one.groups != other.groups for other in front):
            front.append(one)
    return front[:count]


def refused(fitted: Fit, terms: Sequence[Effect]) -> str:
    """Why a fit is implausible: a coefficient out of its physical range or not significant; empty if plausible."""
    for term in terms:
        reason = (
            _widened(fitted, term) if term.geometry in WIDENING else _read_late(fitted, term) or _beyond(fitted, term)
        )
        if reason:
            return reason
    return _wins(fitted) if any(term.restitution is not None for term in terms) else ""


def _widened(fitted: Fit, term: Effect) -> str:
    """Why the jitter or the scatter of impacts is implausible; empty if it is plausible."""
    least = term.parameters[0].least
    if term.geometry == "scatter":
        too_little = float(fitted.scatter[-1]) <= 1.02 * least
        return "rebounds scatter no more than those of a sphere" if too_little else ""
    if fitted.jitter < least:
        return f"the jitter is below {least:g} s, which every record has"
    if fitted.jitter > OVERTAKEN * fitted.frame:
        return f"with a jitter of {fitted.jitter:.2g} s frames would be taken before their predecessors"
    return "the residuals are correlated from frame to frame, unlike jitter" if fitted.white < WHITE else ""


def _read_late(fitted: Fit, term: Effect) -> str:
    """Why a rolling shutter is implausible: its read-out would last many frames; empty if it is plausible."""
    if term.name != SHUTTER:
        return ""
    high = float(np.ptp(fitted.seen[:, 1]))
    taken = abs(fitted.value(f"{term.name}.{term.parameters[0].name}")) * high
    if taken <= READ_OUT * fitted.frame:
        return ""
    return f"reading out a height of {high:.2g} m would take {taken:.2g} s, which is many frames"


def _beyond(fitted: Fit, term: Effect) -> str:
    """Which coefficient is out of its range or not significant; empty if none is."""
    shape = [f"{term.name}.{one.name}" for one in term.parameters if one.assumed is not None]
    for parameter in term.parameters:
        name = f"{term.name}.{parameter.name}"
        value, std = fitted.value(name), fitted.std_given(name, [one for one in shape if one != name])
        found = f"{parameter.name} = {value:.3g}{unit_of(parameter.unit)}"
        beyond = parameter.high + min(2 * std, BEYOND * (parameter.high - parameter.low))
        if value < parameter.low - 2 * std or value > beyond:
            return f"{found} is not in {parameter.low:g} to {parameter.high:g}"
        if parameter.assumed is not None:  # it does not measure the strength
            continue
        if abs(value) < shown_from(parameter.least, std):
            return f"{found} is no larger than in any lab"
        if abs(value) < 3.0 * std:
            return f"{parameter.name} = {value:.3g} is within three standard deviations ({std:.2g} each) of zero"
    return ""


def shown_from(least: float, std: float) -> float:
    """Size from which a coefficient is an effect, from that of every lab and its standard deviation."""
    return min(least, CLEARLY_SEEN * std)


def _wins(fitted: Fit) -> str:
    """Which restitution is significantly above one, as no impact gains energy; empty if none is."""
    for unknown, value in zip(fitted.unknowns, fitted.values, strict=True):
        if unknown.name.startswith("restitution.") and value - 2 * fitted.std(unknown.name) > 1:
            return f"{unknown.name} = {value:.3g} is above one"
    return ""


def surprise(fitted: Fit, term: Effect) -> float:
    """Penalty in deviance for coefficients far from their prediction: the squared log2 of the ratio, at most 5 each.

    Jitter has an additional penalty, because slightly correlated noise resembles a small jitter.
    """
    total = JITTER if term.geometry == "jitter" else 0.0
    for parameter in term.parameters:
        if parameter.predicted and term.geometry not in WIDENING:
            value = abs(fitted.value(f"{term.name}.{parameter.name}"))
            ratio = math.log(max(value, 1e-9) / parameter.predicted) / math.log(2)
            total += min(ratio * ratio, 5.0)
    return total
