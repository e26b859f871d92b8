from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rigtwin.lab.arrays import Array

MOST = 3  # places in a record: where more are torn, its times are not worth mending

WILD = 5.0  # times the noise, more than which a point does not count: it may show something else


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
