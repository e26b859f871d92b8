"""Lost and repeated frames: what a record of one has, and which steps of a clip repeat the frame before."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array, Mask

MOST = 3  # places in a record: where more are torn, its times are not worth mending

WILD = 5.0  # times the noise, more than which a point does not count: it may show something else

SELDOM = 6  # frames: the slowest of the usual doublings is every sixth
LEAST_SHARE = 0.15  # of the moving frames: single ones may be a bead that passes the same place up and down
RHYTHM = 0.5  # share of the gaps between them that are one and the same, from which on they follow a rhythm
IN_RHYTHM = 0.5  # share of those in a rhythm that is seen: a codec changes some, and slow steps hide some


@dataclass(frozen=True)
class Loss:
    """A place in a record where frames are lost, or one is shown twice."""

    index: int  # of the first point after it
    frames: int  # lost; negative: shown twice
    time: float  # [s], of that point as the record tells it
    shift: float  # [s], by which all that follows is late
    at_contact: bool  # told by where the flights meet alone
    sure: bool = True  # whether nothing else could look the same; else times are not to be moved

    @property
    def in_words(self) -> str:
        """What the camera did, before which point."""
        count = abs(self.frames)
        return f"{count} frame{'s' * (count > 1)} {'shown twice' if self.frames < 0 else 'lost'}"


def in_time(time: Array, losses: Iterable[Loss]) -> Array:
    """[s], with all that comes after a sure loss moved on by the frames that are lost, or back."""
    moved = time.copy()
    for loss in losses:
        if loss.sure:
            moved[loss.index :] += loss.shift
    return moved


def repeated(changes: Array, *, noise: float = 0.0) -> Mask:
    """Which of the steps from frame to frame are none, although there are some right before and after.

    `changes` says how much changes in each step, shape (n,), `noise` how much may where nothing moves.
    """
    none = np.zeros(len(changes), dtype=bool)
    if len(changes) < 8:
        return none
    before = np.array([np.max(changes[max(k - 2, 0) : k], initial=0.0) for k in range(len(changes))])
    after = np.array([np.max(changes[k + 1 : k + 3], initial=0.0) for k in range(len(changes))])
    around = np.minimum(before, after)
    calm = max(1.5 * float(np.percentile(changes, 5)), noise)
    moving = around > 4 * calm
    # at the top of a flight steps shrink evenly: half a step beside two and a half is the nearest they come to this
    marked = moving & (changes < np.maximum(0.15 * around, calm))
    gaps = np.diff(np.flatnonzero(marked))
    if len(gaps) < 3:
        return none
    usual = float(np.median(gaps))
    least = IN_RHYTHM / usual if float(np.mean(gaps == usual)) > RHYTHM else LEAST_SHARE
    # the tops of flights come seldom
    return marked if usual <= SELDOM and np.sum(marked) > least * np.sum(moving) else none
