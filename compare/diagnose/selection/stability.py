"""Whether the same name would have come out of other repetitions: bootstrap, and each repetition left out in turn.

What a repetition says for or against a set of effects is its own share of the deviance, releases and impacts
integrated out; the stated calibration speaks once, whichever repetitions are drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.lab.arrays import Array

RESAMPLES = 2000
SEED = 20


@dataclass(frozen=True)
class Stability:
    """How often the winner stays first, and above the alarm."""

    resamples: int
    first: float
    """Share of bootstrap resamples of the repetitions, condition by condition, in which it stays first."""
    alarm: float
    """... and in which it would still have raised the alarm."""
    rival: str
    """Which set is first most often where it is not; empty where there is none."""
    left_out: float
    """Share of the repetitions without which it is still first and above the alarm."""

    def to_json(self) -> dict[str, object]:
        return asdict(self)

    def in_words(self) -> str:
        """How often the name would have come out of other repetitions."""
        other = f" (else {self.rival})" if self.rival else ""
        return (
            f"with the repetitions drawn anew {self.resamples} times it stays first in {100 * self.first:.0f} %{other} "
            f"and above the alarm in {100 * self.alarm:.0f} %; with one repetition left out, in "
            f"{100 * self.left_out:.0f} %"
        )


@dataclass(frozen=True)
class Claim:
    """A set of effects: its fit, and what its score is beyond its gain in deviance, whichever repetitions are drawn."""

    fitted: Fit
    credit: float = 0.0


def stability(
    base: Fit, winner: Claim, rivals: Sequence[Claim], condition: Array, *, alarm: float, spread: float = 1.0
) -> Stability | None:
    """Scores under resampled repetitions; None where the winner was not fitted to all of them."""
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
    """Whether it was fitted to all data, and not only looked at from the baseline."""
    known = len(fitted.by_run) == len(base.by_run)
    return known and abs(float(fitted.by_run.sum()) + _pulls(fitted) - fitted.deviance) < 1.0
