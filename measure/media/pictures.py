from __future__ import annotations

import lzma
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import GreyImage, Image
from rigtwin.lab.errors import UnreadableMedia

Picture = tuple[GreyImage, Callable[[], Image]]
"""Brightness, shape (height, width), and a call that gives it as BGR, shape (height, width, 3)."""

STILLS = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")

FILMS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".wmv", ".cine")

STACKS = (".tif", ".tiff")

PHOTRON = (".cihx", ".cih", ".mraw")

INTERLACED = "the film is interlaced: every picture mixes two moments; deinterlace it first."

CUT_OFF = "the file ends before the length that it states: a copy or a recording was broken off; copy it again."

SQUARE = 0.005  # relative, by which the sides of a pixel may differ: less is the rounding of a film made smaller

HEAD = 24  # pictures decoded to see whether packets and pictures have the same time stamps

LOOKED_AT = 5  # pictures of a folder or a stack, to see how many bits they use

DEEP_GREY = ("gray16le", "gray16be")

BROKEN_PAGE = (zlib.error, lzma.LZMAError, ValueError, IndexError, KeyError, RuntimeError, OSError)  # of a TIFF file

# pixels of a picture up to which one thread decodes: what it decoded is looked at while its processor still has it in
# its cache, which takes a sixth less CPU time than with several threads; larger ones take the more time to decode
IN_CACHE = 1920 * 1088

KEPT = 128 * 2**20  # [bytes], of decoded pictures that a film keeps, so that a short one is decoded once only


class Source(Protocol):
    """Pictures in order."""

    shape: tuple[int, int]  # height, width [px]
    stamps: list[float | None]  # [s], of every picture, as the file has them
    rate: float  # [1/s], as the file states it; 0 where it does not
    tick: float  # [s], unit of the stamps
    notes: tuple[str, ...]  # what is odd about the file

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        """All pictures from number `start` on; one pass over the file."""

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        """The pictures of these numbers, in order; what lies between is read only where that is quicker."""

    def cheap(self, first: int, last: int) -> list[int]:
        """Numbers of the pictures from `first` to `last` that are read without reading others, where that matters."""


def in_order(file: Path) -> tuple[list[Any], str]:
    """img2 before img10."""
    parts = re.split(r"(\d+)", file.name.lower())
    return [(int(part) if part.isdigit() else 0, part) for part in parts], file.name


def still(path: Path) -> npt.NDArray[Any]:
    image = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if image is None:
        raise UnreadableMedia(f"{path}: cannot be decoded as a picture; take it out of the folder or save it again.")
    return np.asarray(image)


def must_be_whole(path: Path, first: npt.NDArray[Any]) -> None:
    # cut to their lowest eight bits they would be read as something else
    if first.dtype not in (np.uint8, np.uint16):
        raise UnreadableMedia(f"{path}: its pixels are {first.dtype} numbers; save it with 8 or 16 bits, unsigned.")


def counted_pictures(count: int) -> str:
    return "1 picture" if count == 1 else f"{count} pictures"


def bit_shift(some: Iterable[npt.NDArray[Any]]) -> tuple[int, tuple[str, ...]]:
    """How many low bits to drop, told by some of the pictures: a 12-bit sensor fills only a part of a 16-bit file.

    One picture after the other is looked at: together they may fill some hundred megabytes.
    """
    brightest = []
    for image in some:
        if image.dtype != np.uint16:
            return 0, ()
        brightest.append(int(image.max()))
    used = max(8, max(brightest).bit_length())
    bits = next(width for width in (8, 10, 12, 14, 16) if width >= used)
    return bits - 8, (
        f"16-bit pictures that use {bits} bits (told by {len(brightest)} of them): read as such.",
    ) if bits < 16 else ()


def spread(count: int) -> list[int]:
    """Numbers of some pictures of `count`: the first may be dim."""
    return sorted(set(np.linspace(0, count - 1, LOOKED_AT).round().astype(int).tolist()))


def dropped(image: npt.NDArray[Any], shift: int) -> npt.NDArray[np.uint8]:
    """A picture without its low bits; what is brighter than all that `shift` was told by is white."""
    return np.ascontiguousarray(np.minimum(image >> shift, 255) if image.dtype == np.uint16 else image, dtype=np.uint8)


def eight_bit(image: npt.NDArray[Any], shift: int) -> Picture:
    small = dropped(image, shift)
    if small.ndim == 2:
        return small, lambda: np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), dtype=np.uint8), lambda: small


def decode(path: Path, start: int | None = None) -> Iterator[av.VideoFrame]:
    """All pictures, or those from the key picture with time stamp `start` on."""
    with opened(path, "AUTO") as (container, stream):
        if start is not None:
            container.seek(start, stream=stream, backward=True)
        yield from container.decode(stream)


@contextmanager
def opened(path: Path, threads: str) -> Iterator[tuple[Any, Any]]:
    """The file and its film; threads share out large pictures, their slices, or what is best."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = threads
        if stream.width * stream.height <= IN_CACHE:
            stream.codec_context.thread_count = 1
        yield container, stream


def combed(interlaced: Sequence[bool]) -> tuple[str, ...]:
    """What is told of pictures of which these are interlaced."""
    return (INTERLACED,) if sum(interlaced) > len(interlaced) / 2 else ()


def luma(picture: av.VideoFrame, shift: int) -> GreyImage:
    """The luma plane itself where it is stored with 8 bits: no colour conversion, no rounding.

    Of grey pictures of 16 bits `shift` low bits are dropped.
    """
    if picture.format.name.startswith(("yuv4", "yuvj4", "nv12", "nv21", "gray")) and all(
        component.bits == 8 for component in picture.format.components
    ):
        plane = picture.planes[0]
        rows: GreyImage = np.frombuffer(memoryview(plane), dtype=np.uint8).reshape(-1, plane.line_size)
        return rows[: picture.height, : picture.width]  # the decoder's own memory, which the array keeps alive
    if picture.format.name in DEEP_GREY and shift < 8:
        return dropped(picture.to_ndarray(), shift)
    return np.asarray(picture.to_ndarray(format="gray"), dtype=np.uint8)


def colour_of(picture: av.VideoFrame, squeeze: float, shift: int) -> Callable[[], Image]:
    def in_colour() -> Image:
        if picture.format.name in DEEP_GREY:
            shown = cv2.cvtColor(luma(picture, shift), cv2.COLOR_GRAY2BGR)
        else:
            shown = picture.to_ndarray(format="bgr24")
        return upright(picture, squared(np.asarray(shown, dtype=np.uint8), squeeze))

    return in_colour


def square(squeeze: float) -> bool:
    return abs(squeeze - 1) < SQUARE


def squared(image: npt.NDArray[np.uint8], squeeze: float) -> npt.NDArray[np.uint8]:
    """Pixels `squeeze` times as wide as high made square, as a player shows them; none are thrown together."""
    if square(squeeze):
        return image
    height, width = image.shape[:2]
    size = (round(width * squeeze), height) if squeeze > 1 else (width, round(height / squeeze))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def upright(picture: av.VideoFrame, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Pixels with the display matrix applied, as a player shows them."""
    turns = round(getattr(picture, "rotation", 0) / 90) % 4  # counter-clockwise
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


def reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or "no picture in it").lower()
