"""Video files decoded by FFmpeg (PyAV), with a cache for short ones; base class of sources with separate pictures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import av

from rigtwin.lab.errors import UnreadableMedia
from rigtwin.measure.media.container import DECODER, first_stream, memory_is_there, open_container
from rigtwin.measure.media.pictures import (
    CUT_OFF,
    DEEP_GREY,
    HEAD,
    KEPT,
    Picture,
    bit_shift,
    colour_of,
    combed,
    decode,
    luma,
    opened,
    reason,
    square,
    squared,
    upright,
)
from rigtwin.measure.media.truncation import breaks_off


class Film:
    """A video file that FFmpeg reads; the decoded pictures of a short one stay in memory."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._reel = _Reel(path)
        self.shape = (0, 0)  # not known yet
        try:
            with open_container(path) as container:
                stream = first_stream(container, path, "video")
                self.rate = float(stream.average_rate or 0)
                self.tick = float(stream.time_base or 0)
                self.squeeze = float(stream.sample_aspect_ratio or stream.codec_context.sample_aspect_ratio or 1)
                self.stamps, self.notes = self._stamps(container, stream)
            head = next(self._reel.at([0]))
            self.shift = 8
            if head.format.name in DEEP_GREY:
                self.shift, notes = bit_shift(each.to_ndarray() for each in islice(self._reel.pictures(), HEAD))
                self.notes += notes
            first, _colour = self._shown(head)
        except (UnreadableMedia, MemoryError):  # av.error.MemoryError is one
            raise
        except Exception as error:  # FFmpeg's, and PyAV's own at metadata and streams that it does not expect
            if not memory_is_there(DECODER):  # some decoders report invalid data then
                raise MemoryError from error
            why, advice = reason(error), "give a clip that a video player shows"
            if breaks_off(path):
                why = "its end with the index is missing: the recording or the copy was broken off"
                advice = "copy it again"
            raise UnreadableMedia(f"{path}: cannot be decoded as a video ({why}); {advice}.") from None
        self.shape = (first.shape[0], first.shape[1])
        self.notes += (CUT_OFF,) if breaks_off(path) else ()
        if not square(self.squeeze):
            self.notes += (
                f"the video's pixels are {self.squeeze:.4g} times as wide as high: the pictures were resized to "
                f"{self.shape[1]} x {self.shape[0]} px, so that pixels are square.",
            )

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        return map(self._shown, self._reel.pictures(start))

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        return map(self._shown, self._reel.at(numbers))

    def _shown(self, picture: av.VideoFrame) -> Picture:
        grey = upright(picture, squared(luma(picture, self.shift), self.squeeze))
        if self.shape not in ((0, 0), grey.shape):
            raise UnreadableMedia(
                f"{self.path}: a picture is {grey.shape[1]} x {grey.shape[0]} px and the first one {self.shape[1]} x "
                f"{self.shape[0]} px; copy the file again, or cut out the part before it."
            )
        return grey, colour_of(picture, self.squeeze, self.shift)

    def cheap(self, first: int, last: int) -> list[int]:
        return [key for key in self._reel.keys if first <= key <= last] if self._reel.too_long else []

    def _stamps(self, container: Any, stream: Any) -> tuple[list[float | None], tuple[str, ...]]:
        """Time stamps of all pictures, from the packets if these agree (no decoding), otherwise by decoding."""
        packets, keys, sound = [], [], True
        try:
            for packet in container.demux(stream):
                if packet.size and not packet.is_discard:
                    packets.append(packet.pts)
                    keys += [packet.pts] if packet.is_keyframe else []
                    sound = sound and not packet.is_corrupt
        except MemoryError:
            raise
        except av.FFmpegError:
            sound = False
        known = [stamp for stamp in packets if stamp is not None]
        expected = stream.frames or len(packets)
        if sound and len(known) == len(packets) == expected and len(set(known)) == len(known) > 0:
            known.sort()
            bytes_each = 1.5 * stream.width * stream.height  # lower bound: 4:2:0 with 8 bits
            self._reel.too_long = bytes_each * len(known) > KEPT
            # keep the stamps, not the pictures: at 4096 x 2160 px these take some hundred megabytes
            head = [(picture.pts, picture.interlaced_frame) for picture in islice(self._reel.pictures(), HEAD)]
            if [pts for pts, _ in head] == known[: len(head)]:
                place = {pts: index for index, pts in enumerate(known)}
                self._reel.points, self._reel.keys = known, sorted(place[pts] for pts in keys)
                return [stamp * self.tick for stamp in known], combed([interlaced for _, interlaced in head])
        return self._decoded_stamps()

    def _decoded_stamps(self) -> tuple[list[float | None], tuple[str, ...]]:
        stamps: list[float | None] = []
        interlaced: list[bool] = []
        damaged: tuple[str, ...] = ()
        try:
            for picture in self._reel.pictures():
                stamps.append(None if picture.pts is None else picture.pts * self.tick)
                interlaced.append(picture.interlaced_frame)
        except MemoryError:
            raise
        except av.FFmpegError as error:
            if not memory_is_there(DECODER):  # some decoders report invalid data then
                raise MemoryError from error
            if len(stamps) < 3:
                raise
            damaged = (f"the file is damaged after picture {len(stamps) - 1}; used what decodes.",)
        return stamps, damaged + combed(interlaced)


class _Reel:
    """Cache of decoded pictures for later passes, used as long as all of them fit into `KEPT`."""

    def __init__(self, path: Path) -> None:
        self.points: list[int] = []  # time stamp of every picture in ticks; empty if not all are known
        self.keys: list[int] = []  # indices of the keyframes
        self.too_long = False
        self._path = path
        self._kept: list[av.VideoFrame] = []
        self._room = KEPT
        self._decoder: Iterator[av.VideoFrame] | None = None  # positioned after the cached ones
        self._ended = False  # the cache holds the whole video
        self._fault: av.FFmpegError | None = None  # error that ended the decoding

    def pictures(self, start: int = 0) -> Iterator[av.VideoFrame]:
        """The pictures from index `start` on; several readers may run at the same time."""
        index = 0
        while not self.too_long and (index < len(self._kept) or self._keep_next()):
            if index >= start:
                yield self._kept[index]
            index += 1
        if self._fault is not None:
            raise self._fault
        if not self._ended:
            # the video does not fit: drop the cache, which would only help the first pass
            decoder, self._decoder, self._kept = self._decoder, None, []
            start = max(start, index)
            yield from decoder if decoder is not None and index == start else self._decoded(start)

    def at(self, numbers: Sequence[int]) -> Iterator[av.VideoFrame]:
        """The pictures with these indices (ascending); in a long video each is decoded from the keyframe before it."""
        if self.too_long and self.keys:
            # frame threads decode ahead; most of that work would be discarded at the next seek
            with opened(self._path, "SLICE") as (container, stream):
                decoded, begun = container.decode(stream), -1
                for done, number in enumerate(numbers):
                    key = self.keys[max(bisect_right(self.keys, number) - 1, 0)]
                    if key > begun:
                        container.seek(self.points[key], stream=stream, backward=True)
                        decoded = container.decode(stream)
                    begun, wanted = number, self.points[number]
                    picture = next((each for each in decoded if each.pts is not None and each.pts >= wanted), None)
                    if picture is None or picture.pts != wanted:  # the seek went to a wrong place
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
        """Decode and cache one more picture; False if the video ends or is too long for the cache."""
        if self._ended:
            return False
        if self._room <= 0:
            self.too_long = True
            return False
        self._decoder = self._decoder or decode(self._path)
        try:
            picture = next(self._decoder)
        except (av.FFmpegError, StopIteration) as end:
            # a traceback would keep a reference cycle with this object
            self._fault = end.with_traceback(None) if isinstance(end, av.FFmpegError) else None
            self._ended, self._decoder = True, None
            return False
        self._kept.append(picture)
        self._room -= sum(plane.buffer_size for plane in picture.planes)
        return True

    def _decoded(self, start: int) -> Iterator[av.VideoFrame]:
        """The pictures from index `start` on, decoded from the keyframe before it if known."""
        before = [key for key in self.keys if key <= start]
        if not before or start == 0:
            yield from islice(decode(self._path), start, None)
            return
        wanted = self.points[start]
        pictures = (
            picture
            for picture in decode(self._path, self.points[before[-1]])
            if picture.pts is not None and picture.pts >= wanted
        )
        first = next(pictures, None)
        if first is None or first.pts != wanted:  # the seek went to a wrong place
            yield from islice(decode(self._path), start, None)
            return
        yield first
        yield from pictures


class Apart(ABC):
    """Base class of sources whose pictures are stored separately: each can be read without the others."""

    @abstractmethod
    def pictures(self, start: int = 0) -> Iterator[Picture]: ...

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        return (next(self.pictures(number)) for number in numbers)

    def cheap(self, first: int, last: int) -> list[int]:
        return list(range(first, last + 1))
