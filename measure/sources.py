"""Where the pictures of a clip come from: a video file, numbered stills, a stack of stills, or a Photron recording.

Every source says how large its pictures are, when they were taken as far as the file knows, and hands them out in
order, one at a time.  FFmpeg (through PyAV) reads the video files, Phantom's ``.cine`` among them.
"""

from __future__ import annotations

import logging
import lzma
import re
import zlib
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Any, Protocol
from xml.etree import ElementTree as Xml

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import GreyImage, Image
from rigtwin.lab.camera import Lens
from rigtwin.lab.errors import UnreadableMedia
from rigtwin.measure.lens import straight
from rigtwin.measure.wholeness import breaks_off

# what is odd about a stack is told in our own words, and not on stderr besides
logging.getLogger("tifffile").addHandler(logging.NullHandler())

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


def source(path: Path) -> Source:
    """The source that fits the path.  Raises `UnreadableMedia` in one sentence when nothing can be read there."""
    if path.is_dir():
        return Stills(path)
    if path.suffix.lower() in PHOTRON:
        return Photron(path)
    if path.suffix.lower() in STACKS:
        return Stack(path)
    return Film(path)


class Film:
    """A video file that FFmpeg reads; a short one stays in memory as decoded."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._reel = _Reel(path)
        try:
            with av.open(str(path)) as container:
                if not container.streams.video:
                    raise UnreadableMedia(f"{path}: holds no video; give a clip that a video player shows.")
                stream = container.streams.video[0]
                self.rate = float(stream.average_rate or 0)
                self.tick = float(stream.time_base or 0)
                self.squeeze = float(stream.sample_aspect_ratio or stream.codec_context.sample_aspect_ratio or 1)
                self.stamps, self.notes = self._stamps(container, stream)
            head = next(self._reel.at([0]))
            self.shift = 8
            if head.format.name in DEEP_GREY:
                self.shift, told = bit_shift(each.to_ndarray() for each in islice(self._reel.pictures(), HEAD))
                self.notes += told
            first, _colour = self._shown(head)
        except (av.FFmpegError, StopIteration) as error:
            advice = (
                "its end with the index is missing, as of a recording or a copy that was broken off; copy it again"
                if breaks_off(path)
                else "give a clip that a video player shows"
            )
            raise UnreadableMedia(f"{path}: cannot be decoded as a video ({_reason(error)}); {advice}.") from None
        self.shape = (first.shape[0], first.shape[1])
        self.notes += (CUT_OFF,) if breaks_off(path) else ()
        if not _square(self.squeeze):
            self.notes += (
                f"the film's pixels are {self.squeeze:.4g} times as wide as high: the pictures were stretched to "
                f"{self.shape[1]} x {self.shape[0]} px, in which they are square.",
            )

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        return map(self._shown, self._reel.pictures(start))

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        return map(self._shown, self._reel.at(numbers))

    def _shown(self, picture: av.VideoFrame) -> Picture:
        grey = _upright(picture, _squared(_luma(picture, self.shift), self.squeeze))
        return grey, _colour_of(picture, self.squeeze, self.shift)

    def cheap(self, first: int, last: int) -> list[int]:
        return [key for key in self._reel.keys if first <= key <= last] if self._reel.too_long else []

    def _stamps(self, container: Any, stream: Any) -> tuple[list[float | None], tuple[str, ...]]:
        """Stamps of all pictures: those of the packets, which costs no decoding, where the two are the same."""
        packets, keys, sound = [], [], True
        try:
            for packet in container.demux(stream):
                if packet.size and not packet.is_discard:
                    packets.append(packet.pts)
                    keys += [packet.pts] if packet.is_keyframe else []
                    sound = sound and not packet.is_corrupt
        except av.FFmpegError:
            sound = False
        known = [stamp for stamp in packets if stamp is not None]
        expected = stream.frames or len(packets)
        if sound and len(known) == len(packets) == expected and len(set(known)) == len(known) > 0:
            known.sort()
            bytes_each = 1.5 * stream.width * stream.height  # at least
            self._reel.too_long = bytes_each * len(known) > KEPT
            # not the pictures themselves: at 4096 x 2160 px they fill some hundred megabytes
            head = [(picture.pts, picture.interlaced_frame) for picture in islice(self._reel.pictures(), HEAD)]
            if [pts for pts, _ in head] == known[: len(head)]:
                place = {pts: index for index, pts in enumerate(known)}
                self._reel.points, self._reel.keys = known, sorted(place[pts] for pts in keys)
                return [stamp * self.tick for stamp in known], _combed([interlaced for _, interlaced in head])
        return self._decoded_stamps()

    def _decoded_stamps(self) -> tuple[list[float | None], tuple[str, ...]]:
        stamps: list[float | None] = []
        interlaced: list[bool] = []
        damaged: tuple[str, ...] = ()
        try:
            for picture in self._reel.pictures():
                stamps.append(None if picture.pts is None else picture.pts * self.tick)
                interlaced.append(picture.interlaced_frame)
        except av.FFmpegError:
            if len(stamps) < 3:
                raise
            damaged = (f"the file is damaged after picture {len(stamps) - 1}; used what decodes.",)
        return stamps, damaged + _combed(interlaced)


class _Reel:
    """Decoded pictures of a film, kept for later passes as long as all of them fit into `KEPT`."""

    def __init__(self, path: Path) -> None:
        self.points: list[int] = []  # time stamp of every picture, in the film's ticks, where all are known
        self.keys: list[int] = []  # pictures at which decoding can begin
        self.too_long = False
        self._path = path
        self._kept: list[av.VideoFrame] = []
        self._room = KEPT
        self._decoder: Iterator[av.VideoFrame] | None = None  # stands right behind the kept ones
        self._ended = False  # the film holds no more than the kept ones
        self._fault: av.FFmpegError | None = None  # on which it ended

    def pictures(self, start: int = 0) -> Iterator[av.VideoFrame]:
        """The pictures from number `start` on; several may read at once."""
        index = 0
        while not self.too_long and (index < len(self._kept) or self._keep_next()):
            if index >= start:
                yield self._kept[index]
            index += 1
        if self._fault is not None:
            raise self._fault
        if not self._ended:
            # what was kept of too long a film would only save the first of several passes
            decoder, self._decoder, self._kept = self._decoder, None, []
            start = max(start, index)
            yield from decoder if decoder is not None and index == start else self._decoded(start)

    def at(self, numbers: Sequence[int]) -> Iterator[av.VideoFrame]:
        """The pictures of these numbers, which rise, each from the key picture before it on where the film is long."""
        if self.too_long and self.keys:
            # of threads that decode ahead of each other most of the work would be thrown away at the next key picture
            with _opened(self._path, "SLICE") as (container, stream):
                decoded, begun = container.decode(stream), -1
                for done, number in enumerate(numbers):
                    key = self.keys[max(bisect_right(self.keys, number) - 1, 0)]
                    if key > begun:
                        container.seek(self.points[key], stream=stream, backward=True)
                        decoded = container.decode(stream)
                    begun, wanted = number, self.points[number]
                    picture = next((each for each in decoded if each.pts is not None and each.pts >= wanted), None)
                    if picture is None or picture.pts != wanted:  # the file seeks elsewhere
                        numbers = numbers[done:]
                        break
                    yield picture
                else:
                    return
        for index, picture in enumerate(self.pictures(numbers[0]), start=numbers[0]):
            if index in numbers:
                yield picture
            if index == numbers[-1]:
                return

    def _keep_next(self) -> bool:
        """Decode and keep one picture more; False where the film ends or is too long to be kept."""
        if self._ended:
            return False
        if self._room <= 0:
            self.too_long = True
            return False
        self._decoder = self._decoder or _decode(self._path)
        try:
            picture = next(self._decoder)
        except (av.FFmpegError, StopIteration) as end:
            # a traceback would hold on to this reel, and the reel to it
            self._fault = end.with_traceback(None) if isinstance(end, av.FFmpegError) else None
            self._ended, self._decoder = True, None
            return False
        self._kept.append(picture)
        self._room -= sum(plane.buffer_size for plane in picture.planes)
        return True

    def _decoded(self, start: int) -> Iterator[av.VideoFrame]:
        """From number `start` on, begun at the key picture before it where there is one."""
        before = [key for key in self.keys if key <= start]
        if not before or start == 0:
            yield from islice(_decode(self._path), start, None)
            return
        wanted = self.points[start]
        pictures = (
            picture
            for picture in _decode(self._path, self.points[before[-1]])
            if picture.pts is not None and picture.pts >= wanted
        )
        first = next(pictures, None)
        if first is None or first.pts != wanted:  # the file seeks elsewhere
            yield from islice(_decode(self._path), start, None)
            return
        yield first
        yield from pictures


class _Apart(ABC):
    """Pictures that are stored apart: each is read without the others."""

    @abstractmethod
    def pictures(self, start: int = 0) -> Iterator[Picture]: ...

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        return (next(self.pictures(number)) for number in numbers)

    def cheap(self, first: int, last: int) -> list[int]:
        return list(range(first, last + 1))


class Stills(_Apart):
    """A folder of numbered pictures."""

    rate = tick = 0.0

    def __init__(self, path: Path) -> None:
        self.files = sorted((file for file in path.iterdir() if file.suffix.lower() in STILLS), key=_in_order)
        if len(self.files) < 3:
            films = sorted(file.name for file in path.iterdir() if file.suffix.lower() in FILMS)
            advice = (
                f"of its {len(films)} videos give one, like {path / films[0]}, or name them as repetitions in lab.toml"
                if films
                else "give a video, or a folder of numbered pictures"
            )
            raise UnreadableMedia(
                f"{path}: is a folder with {_pictures(len(self.files))} ({', '.join(STILLS)}); {advice}."
            )
        first = _still(self.files[0])
        self.shape = (first.shape[0], first.shape[1])
        self.stamps: list[float | None] = [None] * len(self.files)
        _must_be_whole(self.files[0], first)
        others = (_still(self.files[number]) for number in _spread(len(self.files))[1:])
        self.shift, self.notes = bit_shift(chain([first], others))

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        for file in self.files[start:]:
            image = _still(file)
            if image.shape[:2] != self.shape:
                raise UnreadableMedia(
                    f"{file}: is {image.shape[1]} x {image.shape[0]} px where the first picture of the folder is "
                    f"{self.shape[1]} x {self.shape[0]} px; keep pictures of one clip in a folder of their own."
                )
            yield _eight_bit(image, self.shift)


class Stack(_Apart):
    """A TIFF file of many pictures."""

    rate = tick = 0.0

    def __init__(self, path: Path) -> None:
        import tifffile

        self.path = path
        try:
            with tifffile.TiffFile(path) as file:
                count = len(file.pages)
                stated = max([int(one["shape"][0]) for one in file.shaped_metadata or () if "shape" in one], default=0)
                first = np.asarray(file.pages[0].asarray())
                some = [first]
                for number in _spread(count)[1:]:
                    with suppress(*BROKEN_PAGE, tifffile.TiffFileError):  # told where the pictures are read
                        some.append(np.asarray(file.pages[number].asarray()))
        except (*BROKEN_PAGE, tifffile.TiffFileError):
            raise UnreadableMedia(f"{path}: cannot be decoded as a TIFF file; give a clip or a stack.") from None
        if count < 3:
            raise UnreadableMedia(f"{path}: holds {_pictures(count)}; a measurement needs a clip.")
        self.shape = (first.shape[0], first.shape[1])
        self.stamps: list[float | None] = [None] * count
        _must_be_whole(path, first)
        self.shift, self.notes = bit_shift(some)
        if count < stated:
            self.notes += (f"{path.name} holds {count} of {_pictures(stated)}; used those.", CUT_OFF)

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        import tifffile

        with tifffile.TiffFile(self.path) as file:
            for number in range(start, len(self.stamps)):
                try:
                    image = np.asarray(file.pages[number].asarray())
                except (*BROKEN_PAGE, tifffile.TiffFileError):
                    raise UnreadableMedia(
                        f"{self.path}: is damaged after picture {number - 1}; copy it again, or end the measurement "
                        f"before it with --end {number - 1}f."
                    ) from None
                yield _eight_bit(image[..., 2::-1] if image.ndim == 3 else image, self.shift)


class Straight:
    """Another source, its pictures straightened by what a board told of lens and perspective."""

    def __init__(self, taken: Source, lens: Lens) -> None:
        self.taken, self.lens = taken, lens
        self.shape, self.stamps, self.rate, self.tick = taken.shape, taken.stamps, taken.rate, taken.tick
        self.notes = taken.notes

    def cheap(self, first: int, last: int) -> list[int]:
        return self.taken.cheap(first, last)

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        return map(self._straightened, self.taken.pictures(start))

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        return map(self._straightened, self.taken.at(numbers))

    def _straightened(self, picture: Picture) -> Picture:
        grey, in_colour = picture
        return straight(grey, self.lens), partial(_straight_colour, in_colour, self.lens)


def _straight_colour(in_colour: Callable[[], Image], lens: Lens) -> Image:
    return straight(in_colour(), lens)


@dataclass(frozen=True)
class _PhotronHeader:
    rate: float
    width: int
    height: int
    count: int
    bits: int  # of one stored pixel
    used: int  # of these, filled by the sensor


class Photron(_Apart):
    """A Photron recording: a header (.cihx or .cih) beside the raw pictures (.mraw); 8, 12 (packed) or 16 bits."""

    tick = 0.0

    def __init__(self, path: Path) -> None:
        found = [file for end in (".cihx", ".cih") if (file := path.with_suffix(end)).is_file()]
        if not found:
            raise UnreadableMedia(f"{path}: its header is missing; put the .cihx or .cih file beside it.")
        self.raw = path.with_suffix(".mraw")
        if not self.raw.is_file():
            raise UnreadableMedia(f"{path}: its pictures are missing; put {self.raw.name} beside it.")
        self.header = header = _photron_header(found[0])
        size = header.width * header.height * header.bits // 8
        whole = self.raw.stat().st_size // size
        self.notes: tuple[str, ...] = ()
        if whole < header.count:
            self.notes = (f"{self.raw.name} holds {whole} of {_pictures(header.count)}; used those.",)
        self.shape = (header.height, header.width)
        self.rate = header.rate
        self.stamps: list[float | None] = [k / header.rate for k in range(min(whole, header.count))]

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        header = self.header
        pixels = header.width * header.height
        size = pixels * header.bits // 8
        with self.raw.open("rb") as file:
            file.seek(start * size)
            for _ in self.stamps[start:]:
                data = np.frombuffer(file.read(size), dtype=np.uint8)
                yield _eight_bit(_unpacked(data, header.bits).reshape(self.shape), header.used - 8)


def _photron_header(path: Path) -> _PhotronHeader:
    text = path.read_bytes().decode("utf-8", errors="replace")
    try:
        if path.suffix.lower() == ".cihx":
            # the XML stands between blocks of settings that are no text
            root = Xml.fromstring(text[text.index("<cih>") : text.index("</cih>") + len("</cih>")])
            found = {
                "Record Rate(fps)": root.findtext("recordInfo/recordRate"),
                "Image Width": root.findtext("imageDataInfo/resolution/width"),
                "Image Height": root.findtext("imageDataInfo/resolution/height"),
                "Total Frame": root.findtext("frameInfo/totalFrame"),
                "Color Bit": root.findtext("imageDataInfo/colorInfo/bit"),
                "EffectiveBit Depth": root.findtext("imageDataInfo/effectiveBit/depth"),
            }
            words: dict[str, str] = {key: value for key, value in found.items() if value is not None}
        else:
            words = dict(re.findall(r"^([^:#\n]+?)\s*:\s*(.+?)\s*$", text, re.MULTILINE))
        bits = int(words["Color Bit"])
        header = _PhotronHeader(
            rate=float(words["Record Rate(fps)"].split("/")[0]),
            width=int(words["Image Width"]),
            height=int(words["Image Height"]),
            count=int(words["Total Frame"]),
            bits=bits,
            used=int(words.get("EffectiveBit Depth", bits)),
        )
    except (KeyError, ValueError, Xml.ParseError):
        raise UnreadableMedia(
            f"{path}: rate, size or bit depth cannot be read from it; save the recording as TIFF or AVI."
        ) from None
    if header.bits not in (8, 12, 16) or min(header.rate, header.width, header.height, header.used - 7) <= 0:
        raise UnreadableMedia(f"{path}: {header.bits} bits a pixel cannot be read; save the recording as TIFF or AVI.")
    return header


def _unpacked(data: npt.NDArray[np.uint8], bits: int) -> npt.NDArray[Any]:
    if bits == 8:
        return data
    if bits == 16:
        return data.view("<u2")
    three = data.reshape(-1, 3).astype(np.uint16)  # two pixels in three bytes
    pair = np.stack([(three[:, 0] << 4) | (three[:, 1] >> 4), ((three[:, 1] & 15) << 8) | three[:, 2]], axis=1)
    return pair.reshape(-1)


def _in_order(file: Path) -> tuple[list[Any], str]:
    """img2 before img10."""
    parts = re.split(r"(\d+)", file.name.lower())
    return [(int(part) if part.isdigit() else 0, part) for part in parts], file.name


def _still(path: Path) -> npt.NDArray[Any]:
    image = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if image is None:
        raise UnreadableMedia(f"{path}: cannot be decoded as a picture; take it out of the folder or save it again.")
    return np.asarray(image)


def _must_be_whole(path: Path, first: npt.NDArray[Any]) -> None:
    # cut to their lowest eight bits they would be read as something else
    if first.dtype not in (np.uint8, np.uint16):
        raise UnreadableMedia(f"{path}: its pixels are {first.dtype} numbers; save it with 8 or 16 bits, unsigned.")


def _pictures(count: int) -> str:
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


def _spread(count: int) -> list[int]:
    """Numbers of some pictures of `count`: the first may be dim."""
    return sorted(set(np.linspace(0, count - 1, LOOKED_AT).round().astype(int).tolist()))


def dropped(image: npt.NDArray[Any], shift: int) -> npt.NDArray[np.uint8]:
    """A picture without its low bits; what is brighter than all that `shift` was told by is white."""
    return np.ascontiguousarray(np.minimum(image >> shift, 255) if image.dtype == np.uint16 else image, dtype=np.uint8)


def _eight_bit(image: npt.NDArray[Any], shift: int) -> Picture:
    small = dropped(image, shift)
    if small.ndim == 2:
        return small, lambda: np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), dtype=np.uint8), lambda: small


def _decode(path: Path, start: int | None = None) -> Iterator[av.VideoFrame]:
    """All pictures, or those from the key picture with time stamp `start` on."""
    with _opened(path, "AUTO") as (container, stream):
        if start is not None:
            container.seek(start, stream=stream, backward=True)
        yield from container.decode(stream)


@contextmanager
def _opened(path: Path, threads: str) -> Iterator[tuple[Any, Any]]:
    """The file and its film; threads share out large pictures, their slices, or what is best."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = threads
        if stream.width * stream.height <= IN_CACHE:
            stream.codec_context.thread_count = 1
        yield container, stream


def _combed(interlaced: Sequence[bool]) -> tuple[str, ...]:
    """What is told of pictures of which these are interlaced."""
    return (INTERLACED,) if sum(interlaced) > len(interlaced) / 2 else ()


def _luma(picture: av.VideoFrame, shift: int) -> GreyImage:
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


def _colour_of(picture: av.VideoFrame, squeeze: float, shift: int) -> Callable[[], Image]:
    def in_colour() -> Image:
        if picture.format.name in DEEP_GREY:
            shown = cv2.cvtColor(_luma(picture, shift), cv2.COLOR_GRAY2BGR)
        else:
            shown = picture.to_ndarray(format="bgr24")
        return _upright(picture, _squared(np.asarray(shown, dtype=np.uint8), squeeze))

    return in_colour


def _square(squeeze: float) -> bool:
    return abs(squeeze - 1) < SQUARE


def _squared(image: npt.NDArray[np.uint8], squeeze: float) -> npt.NDArray[np.uint8]:
    """Pixels `squeeze` times as wide as high made square, as a player shows them; none are thrown together."""
    if _square(squeeze):
        return image
    height, width = image.shape[:2]
    size = (round(width * squeeze), height) if squeeze > 1 else (width, round(height / squeeze))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _upright(picture: av.VideoFrame, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Pixels with the display matrix applied, as a player shows them."""
    turns = round(getattr(picture, "rotation", 0) / 90) % 4  # counter-clockwise
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or "no picture in it").lower()
