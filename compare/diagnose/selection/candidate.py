"""A set of effects that is tried: its fit, what it gains, and why it cannot be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.effect import WIDENING

SHUTTER = "rolling_shutter"
JITTER = 24.0  # deviance
OVERTAKEN = 0.5  # of the time between two frames: with more jitter one frame in thirteen is taken before the last one
READ_OUT = 10.0  # frames: no camera takes longer than one to read its rows; the rate may be stated wrongly too
WHITE = 0.6  # of the squared differences of white noise
BEYOND = 0.1  # of a coefficient's range above it, that its doubt excuses at most


@dataclass(frozen=True)
class Candidate:
    """A set of effects and its fit."""

    terms: tuple[Effect, ...]
    fitted: Fit
    gain: float
    """Deviance of the baseline less its own, over the spread of the residuals; higher is better."""
    reason: str = ""
    """Why it is refused, empty where it is plausible."""
    rough: Fit | None = None
    """Its fit to a part of the data, where that was looked at first."""
    cost: float = 0.0
    """What its gain has paid for the search of its shapes, where it is a formula with such."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(term.name for term in self.terms)

    @property
    def groups(self) -> frozenset[str]:
        return frozenset(term.group for term in self.terms)

    @property
    def score(self) -> float:
        """Gain less the surprise of its coefficients where physics predicts them."""
        return self.gain - sum(surprise(self.fitted, term) for term in self.terms)


def best_of(candidates: Sequence[Candidate]) -> Candidate | None:
    """The one with the highest score of those that are plausible."""
    return max((one for one in candidates if not one.reason), key=lambda one: one.score, default=None)


def front_of(candidates: Sequence[Candidate], count: int) -> list[Candidate]:
    """The best of each family, plausible or nearly so."""
    front: list[Candidate] = []
    for one in sorted((c for c in candidates if not c.reason), key=lambda c: -c.score):
        if all(one.groups != other.groups for other in front):
            front.append(one)
    return front[:count]


def refused(fitted: Fit, terms: Sequence[Effect]) -> str:
    """Why a fit's coefficients cannot be: out of their physical range, or not larger than their own doubt."""
    for term in terms:
        reason = (
            _widened(fitted, term) if term.geometry in WIDENING else _read_late(fitted, term) or _beyond(fitted, term)
        )
        if reason:
            return reason
    return _wins(fitted) if any(term.restitution is not None for term in terms) else ""


def _widened(fitted: Fit, term: Effect) -> str:
    """Why the noise or the scatter cannot be so wide."""
    least = term.parameters[0].least
    if term.geometry == "scatter":
        too_little = float(fitted.scatter[-1]) <= 1.02 * least
        return "rebounds scatter no more than those of a sphere" if too_little else ""
    if fitted.jitter < least:
        return f"a jitter below {least:g} s is in any record"
    if fitted.jitter > OVERTAKEN * fitted.frame:
        return f"with a jitter of {fitted.jitter:.2g} s frames would be taken before those that they follow"
    return "what is left goes on from frame to frame, which jitter does not" if fitted.white < WHITE else ""


def _read_late(fitted: Fit, term: Effect) -> str:
    """Why a picture's rows cannot be read so slowly: the next frames would begin meanwhile."""
    if term.name != SHUTTER:
        return ""
    high = float(np.ptp(fitted.seen[:, 1]))
    taken = abs(fitted.value(f"{term.name}.{term.parameters[0].name}")) * high
    if taken <= READ_OUT * fitted.frame:
        return ""
    return f"rows {high:.2g} m apart would be read {taken:.2g} s after one another, which is many frames"


def _beyond(fitted: Fit, term: Effect) -> str:
    """Which coefficient is out of its range, or lost in its doubt."""
    for parameter in term.parameters:
        if parameter.assumed is not None:
            continue
        name = f"{term.name}.{parameter.name}"
        value, std = fitted.value(name), fitted.std(name)
        beyond = parameter.high + min(2 * std, BEYOND * (parameter.high - parameter.low))
        if value < parameter.low - 2 * std or value > beyond:
            return f"{parameter.name} = {value:.3g} {parameter.unit} is not in {parameter.low:g} to {parameter.high:g}"
        if abs(value) < parameter.least:
            return f"{parameter.name} = {value:.3g} {parameter.unit} is no more than any lab has"
        if abs(value) < 3.0 * std:
            return f"{parameter.name} = {value:.3g} is within three of its standard deviations ({std:.2g}) of zero"
    return ""


def _wins(fitted: Fit) -> str:
    """The restitution that is above one, if one is: no law of the impact may be had at the price of energy won."""
    for unknown, value in zip(fitted.unknowns, fitted.values, strict=True):
        if unknown.name.startswith("restitution.") and value - 2 * fitted.std(unknown.name) > 1:
            return f"{unknown.name} = {value:.3g} is above one"
    return ""


def surprise(fitted: Fit, term: Effect) -> float:
    """Twice the log of how much less likely a coefficient is than the predicted one; a factor of two costs one.

    Noise that is not quite white looks like a little jitter: that has to gain more.
    """
    total = JITTER if term.geometry == "jitter" else 0.0
    for parameter in term.parameters:
        if parameter.predicted and term.geometry not in WIDENING:
            value = abs(fitted.value(f"{term.name}.{parameter.name}"))
            ratio = math.log(max(value, 1e-9) / parameter.predicted) / math.log(2)
            total += min(ratio * ratio, 5.0)
    return total
