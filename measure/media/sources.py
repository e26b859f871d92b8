"""Choose the reader for a clip: video file, numbered pictures, TIFF stack or Photron recording.

Every source states the picture size and the time stamps of the file and returns the pictures in order, one at a time.
FFmpeg (through PyAV) reads the video files, including Phantom's ``.cine``.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path

from rigtwin.lab.arrays import Image
from rigtwin.lab.camera import Lens
from rigtwin.measure.media.ignored_regions import Region, covered, patched
from rigtwin.measure.media.image_stack import Stack, Stills
from rigtwin.measure.media.photron import Photron
from rigtwin.measure.media.pictures import PHOTRON, STACKS, Picture, Source
from rigtwin.measure.media.undistort import straight
from rigtwin.measure.media.video_file import Film

# warnings about a stack are reported by `Stack`; tifffile must not write them to stderr as well
logging.getLogger("tifffile").addHandler(logging.NullHandler())


def source(path: Path) -> Source:
    """The source for a path. Raises `UnreadableMedia` if nothing can be read there."""
    if path.is_dir():
        return Stills(path)
    if path.suffix.lower() in PHOTRON:
        return Photron(path)
    if path.suffix.lower() in STACKS:
        return Stack(path)
    return Film(path)


class Altered:
    """A source of which every picture is altered by `alter`; size, times and notes stay."""

    def __init__(self, taken: Source, alter: Callable[[Picture], Picture]) -> None:
        self.taken, self.alter = taken, alter
        self.shape, self.stamps, self.rate, self.tick = taken.shape, taken.stamps, taken.rate, taken.tick
        self.notes = taken.notes

    def cheap(self, first: int, last: int) -> list[int]:
        return self.taken.cheap(first, last)

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        return map(self.alter, self.taken.pictures(start))

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        return map(self.alter, self.taken.at(numbers))


def straightened(taken: Source, lens: Lens) -> Altered:
    """The source with its pictures corrected for lens distortion and perspective (see `undistort`)."""

    def alter(picture: Picture) -> Picture:
        grey, in_colour = picture
        return straight(grey, lens), partial(_straight_colour, in_colour, lens)

    return Altered(taken, alter)


def without_regions(taken: Source, regions: Sequence[Region]) -> Altered:
    """The source with `regions` covered by the surroundings that they have in the first picture."""

    @cache
    def first() -> tuple[Image, Image]:
        grey, in_colour = next(iter(taken.at([0])))
        return covered(grey, regions), covered(in_colour(), regions)

    def alter(picture: Picture) -> Picture:
        grey, in_colour = picture
        return patched(grey, first()[0], regions), lambda: patched(in_colour(), first()[1], regions)

    return Altered(taken, alter)


def _straight_colour(in_colour: Callable[[], Image], lens: Lens) -> Image:
    return straight(in_colour(), lens)
