"""Lost and repeated frames of a recording, and the times corrected for them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array, Mask

MOST = 3  # places in a record; with more losses its times are not corrected

OUTLIER = 5.0  # outlier limit in noise standard deviations; such a point may show another object

SELDOM = 6  # frames; largest usual distance between repeated frames (every sixth)
LEAST_SHARE = 0.15  # minimum share of the moving frames; a single one may be a bead near the top of its flight
RHYTHM = 0.5  # share of equal gaps above which the repeats count as periodic
IN_RHYTHM = 0.5  # minimum share found of a periodic pattern; the codec alters some repeats, slow motion hides some


@dataclass(frozen=True)
class Loss:
    """A place in a record where frames are lost or repeated."""

    index: int  # of the first point after the loss
    frames: int  # number of lost frames; negative: repeated frames
    time: float  # [s], recorded time of that point
    shift: float  # [s], added to the times of all later points
    at_contact: bool  # found only from the intersection of two flights
    sure: bool = True  # no other cause is possible; otherwise the times must not be shifted

    @property
    def in_words(self) -> str:
        """Number and kind of the frames, for messages."""
        count = abs(self.frames)
        return f"{count} frame{'s' * (count > 1)} {'shown twice' if self.frames < 0 else 'lost'}"


def in_time(time: Array, losses: Iterable[Loss]) -> Array:
    """Times [s], shape (n,), with all points after each certain loss shifted by its `shift`."""
    moved = time.copy()
    for loss in losses:
        if loss.sure:
            moved[loss.index :] += loss.shift
    return moved


def repeated(changes: Array, *, noise: float = 0.0) -> Mask:
    """Mark the frames without change, shape (n,), whose neighbours before and after do change.

    `changes` is the change of each frame against the previous one, shape (n,); `noise` is the largest change at rest.
    """
    none = np.zeros(len(changes), dtype=bool)
    if len(changes) < 8:
        return none
    before = np.array([np.max(changes[max(k - 2, 0) : k], initial=0.0) for k in range(len(changes))])
    after = np.array([np.max(changes[k + 1 : k + 3], initial=0.0) for k in range(len(changes))])
    around = np.minimum(before, after)
    calm = max(1.5 * float(np.percentile(changes, 5)), noise)
    moving = around > 4 * calm
    # at the apex of a flight steps shrink linearly: there the smallest step is still 0.2 of its neighbours
    marked = moving & (changes < np.maximum(0.15 * around, calm))
    gaps = np.diff(np.flatnonzero(marked))
    if len(gaps) < 3:
        return none
    usual = float(np.median(gaps))
    least = IN_RHYTHM / usual if float(np.mean(gaps == usual)) > RHYTHM else LEAST_SHARE
    # apexes of flights are rarer than this
    return marked if usual <= SELDOM and np.sum(marked) > least * np.sum(moving) else none
