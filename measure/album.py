"""What the search for a bead keeps of the frames, so that the bead can be fitted without reading them again."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigtwin.measure.bead import Background
from rigtwin.measure.media import Frame
from rigtwin.measure.spots import Box, Spot

Grey = npt.NDArray[np.uint8]

ROOM = 96 * 2**20  # [bytes] of cut-outs; a clip that asks for more is read again instead
MOST = 4  # spots of a frame that are kept, the strongest
GHOSTS = 25  # frames for which the place of a spot is kept on after it has vanished
FEWEST = 11  # whole frames from which the scene behind a bead is learnt


class Album:
    """Cut-outs around the spots of every frame, and some whole frames in which something moves."""

    def __init__(self) -> None:
        self.whole = Background()
        self.times: dict[int, float] = {}  # [s]
        self._cuts: dict[int, list[tuple[Box, Grey]]] = {}
        self._places: list[tuple[Box, int]] = []  # and in which frame a spot was last seen there
        self._room = ROOM
        self._last: Spot | None = None

    def add(self, frame: Frame, spots: Sequence[Spot]) -> None:
        """See the next frame with its spots, the strongest first."""
        if self._last is not None and spots:
            step = math.hypot(spots[0].x - self._last.x, spots[0].y - self._last.y)
            if step > 1:
                self.whole.add(frame.index, frame.grey.copy())
        self._last = spots[0] if spots else None
        here = [(_around(spot), frame.index) for spot in spots[:MOST]]
        gone = [
            (box, seen)
            for box, seen in self._places
            if frame.index - seen < GHOSTS and not any(_meets(box, other) for other, _ in here)
        ]
        self._places = (here + gone)[: 2 * MOST]
        self.times[frame.index] = frame.time
        cuts = []
        for box, _ in self._places:
            left, top, right, bottom = box
            part = frame.grey[top:bottom, left:right].copy()
            self._room -= part.size
            cuts.append(((left, top, left + part.shape[1], top + part.shape[0]), part))
        if self._room >= 0:
            self._cuts[frame.index] = cuts

    def cut(self, index: int, box: Box) -> Grey | None:
        """A part of a frame, None where not all of it was kept."""
        for (left, top, right, bottom), part in self._cuts.get(index, []):
            if left <= box[0] and top <= box[1] and right >= box[2] and bottom >= box[3]:
                return part[box[1] - top : box[3] - top, box[0] - left : box[2] - left]
        return None

    def greys(self, first: int, last: int) -> dict[int, Grey]:
        """The whole frames kept from `first` to `last`, by number; none where they are too few to learn from."""
        greys = {index: grey for index, grey in self.whole.samples().items() if first <= index <= last}
        return greys if len(greys) >= FEWEST else {}


def _around(spot: Spot) -> Box:
    """Room for the bead of a spot, for its blur and for what it moves in a frame."""
    reach = 2 * max(spot.width, spot.height) + 32
    return (
        max(int(spot.x - reach), 0),
        max(int(spot.y - reach), 0),
        max(int(spot.x + reach) + 2, 0),
        max(int(spot.y + reach) + 2, 0),
    )


def _meets(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
