"""Cache of the frame parts around moving spots, so that a bead can be fitted without reading the video again."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigtwin.lab.arrays import GreyImage
from rigtwin.measure.media.video import Frame
from rigtwin.measure.scene.background import Background
from rigtwin.measure.tracking.detect import Box, Spot

ROOM = 96 * 2**20  # [bytes] of cut-outs; a clip that needs more is read again instead
MOST = 4  # number of spots per frame kept, the strongest
GHOSTS = 25  # frames for which the surroundings of a spot are still kept after it has vanished
FEWEST = 7  # minimum number of whole frames to learn the background behind a bead


class Album:
    """Cut-outs around the spots of every frame, and some whole frames with motion."""

    def __init__(self) -> None:
        self._whole: dict[int, GreyImage] = {}
        self._moved, self._every = 0, 1  # number of frames with motion; every n-th is kept whole
        self.times: dict[int, float] = {}  # [s], by index of the frames with cut-outs
        self._cuts: dict[int, list[tuple[Box, GreyImage]]] = {}
        self._places: list[tuple[Box, int]] = []  # box, and last frame with a spot there
        self._room = ROOM
        self._last: Spot | None = None

    def add(self, frame: Frame, spots: Sequence[Spot]) -> None:
        """Add the next frame with its spots, strongest first."""
        if self._last is not None and spots:
            step = math.hypot(spots[0].x - self._last.x, spots[0].y - self._last.y)
            if step > 1:
                self._keep_whole(frame)
        self._last = spots[0] if spots else None
        here = [(_around(spot), frame.index) for spot in spots[:MOST]]
        gone = [
            (box, seen)
            for box, seen in self._places
            if frame.index - seen < GHOSTS and not any(_meets(box, other) for other, _ in here)
        ]
        self._places = (here + gone)[: 2 * MOST]
        if self._places and self._room > 0:  # nothing is kept while nothing moves
            self._keep_cuts(frame)

    def _keep_cuts(self, frame: Frame) -> None:
        height, width = frame.grey.shape
        boxes = [(left, top, min(right, width), min(bottom, height)) for (left, top, right, bottom), _ in self._places]
        self._room -= sum((right - left) * (bottom - top) for left, top, right, bottom in boxes)
        if self._room >= 0:
            self.times[frame.index] = frame.time
            self._cuts[frame.index] = [
                ((left, top, right, bottom), frame.grey[top:bottom, left:right].copy())
                for left, top, right, bottom in boxes
            ]

    def _keep_whole(self, frame: Frame) -> None:
        """Keep every n-th frame with motion; n doubles when the store is full."""
        if self._moved % self._every == 0:
            self._whole[frame.index] = frame.grey.copy()
        self._moved += 1
        if len(self._whole) > Background.capacity:
            for index in list(self._whole)[1::2]:
                del self._whole[index]
            self._every *= 2

    def cut(self, index: int, box: Box) -> GreyImage | None:
        """A part of a frame; None if it was not kept completely."""
        for (left, top, right, bottom), part in self._cuts.get(index, []):
            if left <= box[0] and top <= box[1] and right >= box[2] and bottom >= box[3]:
                return part[box[1] - top : box[3] - top, box[0] - left : box[2] - left]
        return None

    def greys(self, first: int, last: int) -> dict[int, GreyImage]:
        """The whole frames kept from `first` to `last`, by index; empty if there are fewer than `FEWEST`."""
        greys = {index: grey for index, grey in self._whole.items() if first <= index <= last}
        return greys if len(greys) >= FEWEST else {}


def _around(spot: Spot) -> Box:
    """Box around a spot with a margin for motion blur and the motion within a frame."""
    reach = 2 * max(spot.width, spot.height) + 32
    return (
        max(int(spot.x - reach), 0),
        max(int(spot.y - reach), 0),
        max(int(spot.x + reach) + 2, 0),
        max(int(spot.y + reach) + 2, 0),
    )


def _meets(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
