"""Lost and repeated frames of a recording, and the times corrected for them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rigtwin.lab.arrays import Array

MOST = 3  # places in a record; with more losses its times are not corrected

WILD = 5.0  # outlier limit in noise standard deviations; such a point may show another object


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
