"""Clips stored as single pictures: a folder of numbered pictures or a multi-page TIFF file."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import UnreadableMedia
from rigtwin.lab.media_files import FILMS, PICTURES, in_order
from rigtwin.measure.media.picture_size import must_have_room
from rigtwin.measure.media.pictures import (
    CUT_OFF,
    Picture,
    bit_shift,
    counted_pictures,
    eight_bit,
    must_be_whole,
    spread,
    still,
)
from rigtwin.measure.media.video_file import Apart


class Stills(Apart):
    """A folder of numbered pictures."""

    rate = tick = 0.0

    def __init__(self, path: Path) -> None:
        self.files = sorted((file for file in path.iterdir() if file.suffix.lower() in PICTURES), key=in_order)
        if len(self.files) < 3:
            films = sorted(file.name for file in path.iterdir() if file.suffix.lower() in FILMS)
            advice = (
                f"give one of its {len(films)} videos, e.g. {path / films[0]}, or list them as repetitions in lab.toml"
                if films
                else "give a video, or a folder of numbered pictures"
            )
            raise UnreadableMedia(
                f"{path}: is a folder with {counted_pictures(len(self.files))} ({', '.join(PICTURES)}); {advice}."
            )
        first = still(self.files[0])
        self.shape = (first.shape[0], first.shape[1])
        self.stamps: list[float | None] = [None] * len(self.files)
        must_be_whole(self.files[0], first)
        others = (still(self.files[number]) for number in spread(len(self.files))[1:])
        self.shift, self.notes = bit_shift(chain([first], others))

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        for file in self.files[start:]:
            image = still(file)
            if image.shape[:2] != self.shape:
                raise UnreadableMedia(
                    f"{file}: is {image.shape[1]} x {image.shape[0]} px, but the first picture of the folder is "
                    f"{self.shape[1]} x {self.shape[0]} px; keep the pictures of each clip in a separate folder."
                )
            yield eight_bit(image, self.shift)


class Stack(Apart):
    """A multi-page TIFF file."""

    rate = tick = 0.0

    def __init__(self, path: Path) -> None:
        import tifffile

        self.path = path
        try:
            with tifffile.TiffFile(path) as file:
                count = len(file.pages)
                page: Any = file.pages[0]
                must_have_room(path, int(page.imagewidth), int(page.imagelength))
                stated = max([int(one["shape"][0]) for one in file.shaped_metadata or () if "shape" in one], default=0)
                first = np.asarray(page.asarray())
                self.shape = (first.shape[0], first.shape[1])
                some = [first]
                for number in spread(count)[1:]:
                    some += _page(file, number, path, self.shape)
        except (UnreadableMedia, MemoryError):
            raise
        except Exception:  # tifffile raises errors of every kind at damaged files
            raise UnreadableMedia(f"{path}: cannot be decoded as a TIFF file; give a clip or a stack.") from None
        if count < 3:
            raise UnreadableMedia(f"{path}: holds {counted_pictures(count)}; a measurement needs a clip.")
        self.stamps: list[float | None] = [None] * count
        must_be_whole(path, first)
        self.shift, self.notes = bit_shift(some)
        if count < stated:
            self.notes += (f"{path.name} holds {count} of {counted_pictures(stated)}; only those were used.", CUT_OFF)

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        import tifffile

        with tifffile.TiffFile(self.path) as file:
            for number in range(start, len(self.stamps)):
                whole = _page(file, number, self.path, self.shape)
                if not whole:
                    raise UnreadableMedia(
                        f"{self.path}: is damaged after picture {number - 1}; copy it again, or end the measurement "
                        f"before it with --end {number - 1}f."
                    )
                image = whole[0]
                yield eight_bit(image[..., 2::-1] if image.ndim == 3 else image, self.shift)


def _page(file: Any, number: int, path: Path, shape: tuple[int, int]) -> list[npt.NDArray[Any]]:
    """One picture of a TIFF file; none if it is damaged or has another size than the first."""
    try:
        page = file.pages[number]
        must_have_room(path, int(page.imagewidth), int(page.imagelength))
        image = np.asarray(page.asarray())
    except (UnreadableMedia, MemoryError):
        raise
    except Exception:  # tifffile raises errors of every kind at damaged files
        return []
    return [image] if image.shape[:2] == shape else []
