"""Stability of the named effects under bootstrap and leave-one-out resampling of the repetitions.

The evidence of a repetition for a set of effects is its share of the deviance, with releases and impacts integrated
out; the priors of the calibration count once in each resample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.lab.arrays import Array

RESAMPLES = 2000  # bootstrap resamples
SEED = 20  # of the random numbers of the bootstrap


@dataclass(frozen=True)
class Stability:
    """How often the winner stays first and above the detection threshold (`alarm`)."""

    resamples: int
    first: float
    """Share of bootstrap resamples (within each condition) in which the winner stays first."""
    alarm: float
    """Share of bootstrap resamples in which its score stays above the threshold."""
    rival: str
    """The set that is first most often in the other resamples; empty if there is none."""
    left_out: float
    """Share of the repetitions without which the winner is still first and above the threshold."""

    def to_json(self) -> dict[str, object]:
        return asdict(self)

    def in_words(self) -> str:
        """One sentence for the report."""
        other = f" (otherwise {self.rival})" if self.rival else ""
        return (
            f"in {self.resamples} bootstrap resamples of the repetitions it stays first in {100 * self.first:.0f} %"
            f"{other} and above the threshold in {100 * self.alarm:.0f} %; with one repetition left out it stays first "
            f"and above the threshold in {100 * self.left_out:.0f} %"
        )


@dataclass(frozen=True)
class Claim:
    """A set of effects: its fit, and the part of its score that does not depend on the repetitions (`credit`)."""

    fitted: Fit
    credit: float = 0.0


def stability(
    base: Fit, winner: Claim, rivals: Sequence[Claim], condition: Array, *, alarm: float, spread: float = 1.0
) -> Stability | None:
    """Scores under resampled repetitions; None if the winner was not fitted to all repetitions."""
    if not _whole(winner.fitted, base):
        return None
    rivals = [one for one in rivals if _whole(one.fitted, base) and names(one.fitted) != names(winner.fitted)]
    claims = (winner, *rivals)
    gains = np.array([(base.by_run - one.fitted.by_run) / spread for one in claims])  # (candidates, R)
    stated = np.array([(_pulls(base) - _pulls(one.fitted)) / spread + one.credit for one in claims])
    rng = np.random.default_rng(SEED)
    weight = np.zeros((RESAMPLES, len(condition)))
    for number in np.unique(condition):
        mine = np.flatnonzero(condition == number)
        weight[:, mine] = rng.multinomial(len(mine), np.full(len(mine), 1 / len(mine)), size=RESAMPLES)
    drawn = weight @ gains.T + stated
    leader = drawn.argmax(axis=1)
    others = leader[leader > 0]
    rival = names(claims[int(np.bincount(others).argmax())].fitted) if len(others) else ""
    without = gains.sum(axis=1) + stated - gains.T  # (R, candidates), one repetition left out
    stays = (without.argmax(axis=1) == 0) & (without[:, 0] >= alarm)
    return Stability(
        RESAMPLES, float(np.mean(leader == 0)), float(np.mean(drawn[:, 0] >= alarm)), rival, float(np.mean(stays))
    )


def names(fitted: Fit) -> str:
    return " + ".join(sorted(term.name for term in fitted.terms))


def _pulls(fitted: Fit) -> float:
    return sum(pull**2 for pull in fitted.pulls.values())


def _whole(fitted: Fit, base: Fit) -> bool:
    """Whether the set was fitted to all data, not only screened."""
    known = len(fitted.by_run) == len(base.by_run)
    return known and abs(float(fitted.by_run.sum()) + _pulls(fitted) - fitted.deviance) < 1.0
