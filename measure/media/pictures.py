"""Decode single pictures: bit depth, brightness, colour, pixel aspect ratio and orientation.

`Source` is the interface of all picture sources: video files, folders of pictures, TIFF stacks, Photron recordings.
"""

from __future__ import annotations

import re
import struct
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
from rigtwin.lab.input_files import captured_stderr
from rigtwin.measure.media.container import open_container
from rigtwin.measure.media.picture_size import must_be_small_enough

Picture = tuple[GreyImage, Callable[[], Image]]
"""Brightness, shape (height, width), and a function that returns the BGR picture, shape (height, width, 3)."""

CORRUPT = "Corrupt JPEG data: "  # prefix of libjpeg's warnings, of which it prints the first for each picture
SURPLUS = re.compile(r"(\d+) extraneous bytes before marker 0xd\d")  # within or after the picture data
MOST_SURPLUS = 16  # [bytes], left there by the encoders of some cameras (assumed); more are left by damaged data

PNG = b"\x89PNG\r\n\x1a\n"

STACKS = (".tif", ".tiff")

PHOTRON = (".cihx", ".cih", ".mraw")

INTERLACED = "the video is interlaced: every picture mixes two moments; deinterlace it first."

CUT_OFF = "the file is shorter than its header states: the copy or the recording was broken off; copy it again."

SQUARE = 0.005  # relative difference of pixel width and height that counts as rounding of a resized video

HEAD = 24  # pictures decoded to compare their time stamps with those of the packets

LOOKED_AT = 5  # pictures of a folder or a stack that are read to find how many bits are used

NO_MEMORY = -4  # OpenCV's number of the error

DEEP_GREY = ("gray16le", "gray16be")

# [px], largest picture decoded by one thread: the decoded picture is then still in the processor's cache when it is
# analysed, which takes a sixth less CPU time than several threads; for larger pictures decoding dominates
IN_CACHE = 1920 * 1088

KEPT = 128 * 2**20  # [bytes], cache of decoded pictures per video, so that a short one is decoded only once


class Source(Protocol):
    """An ordered sequence of pictures with time stamps."""

    shape: tuple[int, int]  # height, width [px]
    stamps: list[float | None]  # [s], time stamp of every picture as stored in the file
    rate: float  # [1/s], frame rate stated by the file; 0 if none
    tick: float  # [s], resolution of the time stamps
    notes: tuple[str, ...]  # warnings about the file

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        """All pictures from index `start` on; one pass over the file."""

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        """The pictures with these indices, in order; those in between are read only if that is faster than seeking."""

    def cheap(self, first: int, last: int) -> list[int]:
        """Indices from `first` to `last` that can be read without decoding others; empty if that saves nothing."""


def still(path: Path) -> npt.NDArray[Any]:
    must_be_small_enough(path)
    image = decoded(path, np.fromfile(path, dtype=np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if image is None:
        raise UnreadableMedia(f"{path}: cannot be decoded as a picture; take it out of the folder or save it again.")
    return np.asarray(image)


def decoded(path: Path, stored: npt.NDArray[np.uint8], kind: int) -> npt.NDArray[Any] | None:
    """A picture that OpenCV decodes, None if it cannot.  Refuses one of which a part of the data is damaged."""
    if _promises_more(stored):
        return None
    try:
        with captured_stderr() as said:
            image = cv2.imdecode(stored, kind)
    except cv2.error as error:  # an assertion of its own about the header
        if error.code == NO_MEMORY:
            raise MemoryError from None
        return None
    for line in said if image is not None else ():
        _, found, complaint = line.partition(CORRUPT)
        surplus = SURPLUS.match(complaint)
        few = int(surplus[1]) <= MOST_SURPLUS if surplus else "extraneous" in complaint
        if found and not few:  # libjpeg fills what it cannot decode with grey
            raise UnreadableMedia(f"{path}: a part of its picture data is damaged ({complaint}); copy it again.")
    return None if image is None else np.asarray(image)


def _promises_more(stored: npt.NDArray[np.uint8]) -> bool:
    """Whether a PNG file states a chunk longer than the file: OpenCV takes that memory, up to 4 GB, then fails."""
    if bytes(stored[: len(PNG)]) != PNG:
        return False
    place = len(PNG)
    while place + 8 <= len(stored):
        length, name = struct.unpack(">I4s", stored[place : place + 8].tobytes())
        if name == b"IEND":
            return False
        place += 12 + length  # with its name and its checksum
    return place > len(stored)


def must_be_whole(path: Path, first: npt.NDArray[Any]) -> None:
    # other pixel types would be truncated to their lowest eight bits
    if first.dtype not in (np.uint8, np.uint16):
        raise UnreadableMedia(f"{path}: its pixels are {first.dtype} numbers; save it with 8 or 16 bits, unsigned.")


def counted_pictures(count: int) -> str:
    return "1 picture" if count == 1 else f"{count} pictures"


def bit_shift(some: Iterable[npt.NDArray[Any]]) -> tuple[int, tuple[str, ...]]:
    """Number of low bits to drop, from a sample of pictures: a 12-bit sensor fills only a part of a 16-bit file.

    The pictures are read one after the other: together they may take some hundred megabytes.
    """
    brightest = []
    for image in some:
        if image.dtype != np.uint16:
            return 0, ()
        brightest.append(int(image.max()))
    used = max(8, max(brightest).bit_length())
    bits = next(width for width in (8, 10, 12, 14, 16) if width >= used)
    return bits - 8, (
        f"16-bit pictures that use {bits} bits (found from {len(brightest)} of them): read as {bits}-bit pictures.",
    ) if bits < 16 else ()


def spread(count: int) -> list[int]:
    """Indices of a few evenly spread pictures of `count`; the first alone may be dark."""
    return sorted(set(np.linspace(0, count - 1, LOOKED_AT).round().astype(int).tolist()))


def dropped(image: npt.NDArray[Any], shift: int) -> npt.NDArray[np.uint8]:
    """A picture without its `shift` low bits; pixels brighter than the sample that set `shift` become white."""
    return np.ascontiguousarray(np.minimum(image >> shift, 255) if image.dtype == np.uint16 else image, dtype=np.uint8)


def eight_bit(image: npt.NDArray[Any], shift: int) -> Picture:
    small = dropped(image, shift)
    if small.ndim == 2:
        return small, lambda: np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), dtype=np.uint8), lambda: small


def decode(path: Path, start: int | None = None) -> Iterator[av.VideoFrame]:
    """All pictures, or those from the keyframe with time stamp `start` on."""
    with opened(path, "AUTO") as (container, stream):
        if start is not None:
            container.seek(start, stream=stream, backward=True)
        yield from container.decode(stream)


@contextmanager
def opened(path: Path, threads: str) -> Iterator[tuple[Any, Any]]:
    """The container and its video stream; `threads` is FFmpeg's thread type, used for large pictures."""
    with open_container(path) as container:
        stream = container.streams.video[0]
        stream.thread_type = threads
        if stream.width * stream.height <= IN_CACHE:
            stream.codec_context.thread_count = 1
        yield container, stream


def combed(interlaced: Sequence[bool]) -> tuple[str, ...]:
    """The warning if most of the pictures are interlaced."""
    return (INTERLACED,) if sum(interlaced) > len(interlaced) / 2 else ()


def luma(picture: av.VideoFrame, shift: int) -> GreyImage:
    """Brightness; the luma plane itself if it is stored with 8 bits: no colour conversion, no rounding.

    16-bit grey pictures lose their `shift` low bits.
    """
    if picture.format.name.startswith(("yuv4", "yuvj4", "nv12", "nv21", "gray")) and all(
        component.bits == 8 for component in picture.format.components
    ):
        plane = picture.planes[0]
        rows: GreyImage = np.frombuffer(memoryview(plane), dtype=np.uint8).reshape(-1, abs(plane.line_size))
        if plane.line_size < 0:  # stored from the lowest row upwards, as by Phantom cameras
            rows = np.ascontiguousarray(rows[picture.height - 1 :: -1])
        return rows[: picture.height, : picture.width]  # a view of the decoder's memory; the array keeps it alive
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
    """Resample pixels of aspect ratio `squeeze` (width / height) to square ones; the picture only grows."""
    if square(squeeze):
        return image
    height, width = image.shape[:2]
    size = (round(width * squeeze), height) if squeeze > 1 else (width, round(height / squeeze))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def upright(picture: av.VideoFrame, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """The picture rotated by the display matrix, as a player shows it."""
    turns = round(getattr(picture, "rotation", 0) / 90) % 4  # counter-clockwise
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


def reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or "no picture in it").lower()
