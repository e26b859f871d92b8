"""Open a video and iterate over its frames with their capture times.

A video is read in one pass and never held in memory as a whole. Times are capture times: a given capture rate is used;
if the file's time stamps are not monotonic (B-frames in AVI), the frame index replaces them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import GreyImage, Image
from rigtwin.lab.camera import Camera, Moment
from rigtwin.lab.errors import BadInput, Mark, UnreadableMedia
from rigtwin.measure.media import pictures
from rigtwin.measure.media.container import DECODER, memory_is_there
from rigtwin.measure.media.sources import source, straightened, without_regions
from rigtwin.measure.media.time_base import ROUNDED, time_base
from rigtwin.measure.media.validation import SMALLEST, must_exist, must_fit, must_lie_inside

FEWEST_KEYS = 9  # keyframes; with fewer, all frames are decoded instead of only these

BEHIND_KEY = 6  # frames after a keyframe: moving objects have moved on, and few pictures must be decoded to get there


@dataclass(frozen=True)
class Frame:
    """One picture of a video."""

    index: int  # 0 for the first picture in the file
    time: float  # [s], capture time of the start of the exposure, 0 for the first picture in the file
    grey: GreyImage  # the luma plane as stored, shape (height, width)
    in_colour: Callable[[], Image] = field(repr=False)

    @cached_property
    def colour(self) -> Image:
        """BGR, shape (height, width, 3); converted at the first access."""
        return self.in_colour()


@dataclass(frozen=True)
class Video:
    """A readable video; each iteration over `frames()` is one pass over the file."""

    path: Path
    width: int  # [px]
    height: int  # [px]
    frame_rate: float  # [1/s], capture rate
    playback_rate: float  # [1/s], rate at which the file plays
    times: npt.NDArray[np.float64]  # [s], capture time of every picture that can be decoded, shape (n,)
    first: int  # first frame inside --start/--end
    last: int  # last frame inside --start/--end
    source: pictures.Source = field(repr=False)
    warnings: tuple[str, ...] = field(default=())
    skipped: frozenset[int] = field(default=frozenset())  # pictures that `frames()` leaves out
    excluded: frozenset[int] = field(default=frozenset())  # those of them that the user leaves out
    numbers: npt.NDArray[np.int64] | None = field(default=None, repr=False)
    """Frame that each picture of the file shows, in ascending order, if repeated ones were taken out of the count."""

    @property
    def spoilt(self) -> str:
        """Why motion in this video is unreliable or incomplete (interlaced, truncated); empty if it is not."""
        return "; ".join(note for note in (pictures.INTERLACED, pictures.CUT_OFF) if note in self.warnings)

    @property
    def broken_off(self) -> str:
        """Why the recording may be incomplete; empty if it is complete."""
        return pictures.CUT_OFF if pictures.CUT_OFF in self.warnings else ""

    @property
    def file_times(self) -> npt.NDArray[np.float64]:
        """Capture time of every picture in the file [s]; of a repeated one that of the picture it repeats."""
        return self.times if self.numbers is None else self.times[self.numbers]

    def in_file(self, frame: int) -> int:
        """Index in the file of the first picture that shows a frame."""
        return frame if self.numbers is None else int(np.searchsorted(self.numbers, frame))

    def frame_of(self, index: int) -> int:
        """The frame that a picture of the file shows; of a repeated one that is skipped the one that it repeats."""
        if self.numbers is not None:
            beyond = max(index - len(self.numbers) + 1, 0)
            return int(self.numbers[index - beyond]) + beyond
        repeated = self.skipped - self.excluded
        while index in repeated and index - 1 >= self.first:
            index -= 1
        return index

    def marks_in_file(self, marks: Iterable[Mark]) -> tuple[Mark, ...]:
        """Marks with the indices that their frames have in the file."""
        return tuple(replace(mark, frames=[self.in_file(frame) for frame in mark.frames]) for mark in marks)

    def frames(self, first: int | None = None, last: int | None = None) -> Iterator[Frame]:
        """The frames from `first` to `last` (inclusive, default: those of the video), in order."""
        first = self.first if first is None else max(first, self.first)
        last = self.last if last is None else min(last, self.last)
        index = first - 1
        try:
            for index, (grey, in_colour) in enumerate(self.source.pictures(first), start=first):
                if index not in self.skipped:
                    yield Frame(index, float(self.times[index]), grey, in_colour)
                if index == last:
                    return  # a damaged rest of the file is not read
        except MemoryError:
            raise
        except av.FFmpegError:
            pass
        raise self._damaged(index)

    def spread(self, count: int, *, quickly: bool = False) -> set[int]:
        """Indices of `count` evenly spread frames; `quickly`: of frames at or near keyframes, which decode faster."""
        there = [index for index in range(self.first, self.last + 1) if index not in self.skipped]
        keys = [index for index in self.source.cheap(self.first, self.last) if index not in self.skipped]
        if FEWEST_KEYS <= len(keys) < count:
            # too few keyframes for the background: add frames shortly after them
            keys = sorted({*keys, *(key + BEHIND_KEY for key in keys)} & set(there))
        # an encoder that places keyframes at scene changes may put most of them in one part of the video
        widest = max(np.diff([self.first, *keys, self.last])) if keys else math.inf
        even = widest <= 2 * (self.last - self.first) / FEWEST_KEYS
        chosen = keys if quickly and even and len(keys) >= 2 * FEWEST_KEYS else there
        places = np.linspace(0, len(chosen) - 1, min(count, len(chosen))).round().astype(int)
        return {chosen[k] for k in places}

    def single(self, indices: Collection[int]) -> list[Frame]:
        """Single frames, in order; those in between are read only if that is faster than seeking."""
        wanted = [k for k in sorted(indices) if self.first <= k <= self.last and k not in self.skipped]
        found = list[Frame]()
        try:
            for index, (grey, in_colour) in zip(wanted, self.source.at(wanted), strict=False):
                found.append(Frame(index, float(self.times[index]), grey, in_colour))
        except MemoryError:
            raise
        except av.FFmpegError:
            pass
        if len(found) < len(wanted):
            last = found[-1].index if found else self.first
            for frame in self.frames(last):  # finds the place of the damage itself
                last = frame.index
            raise self._damaged(last)
        return found

    def _damaged(self, index: int) -> UnreadableMedia:
        if not memory_is_there(DECODER):  # some decoders report invalid data then
            raise MemoryError
        return UnreadableMedia(
            f"{self.path}: is damaged after picture {index}; end the measurement before it with --end {index}f."
        )


def open_video(path: Path, camera: Camera) -> Video:
    """Open a video and determine the capture time of every frame.

    Parameters
    ----------
    path : Path
        Video file, folder of numbered pictures, multi-page TIFF file or Photron recording.
    camera : Camera
        `frame_rate` is the capture rate [1/s] (None: the file's rate), `start` and `end` the time window, `lens` the
        distortion to correct. `region` and `known_length` must lie inside the picture.

    Returns
    -------
    Video
        Picture size [px], capture times [s], first and last frame of the time window, and warnings for the user.

    Raises
    ------
    UnreadableMedia
        The file is missing, empty, cannot be decoded, holds fewer than three pictures or only tiny ones.
    BadInput
        No frame rate is known, the time window holds fewer than three frames, `camera` names a place outside the
        picture, or the picture size differs from that of the calibration board.

    Notes
    -----
    Evenly spaced time stamps give t_i = i / rate with the capture rate. Uneven stamps are used as they are if the file
    plays at the capture rate, otherwise they are scaled by playback rate / capture rate. See `time_base`.

    Examples
    --------
    >>> video = open_video(Path("drop.mp4"), Camera())  # doctest: +SKIP
    >>> video.times[:3]  # doctest: +SKIP
    array([0.        , 0.00416667, 0.00833333])
    """
    must_exist(path, "video")
    cv2.setNumThreads(1)  # more threads cost more time in synchronisation than they save
    film: pictures.Source = source(path)
    if camera.lens is not None:
        must_fit(path, film.shape, camera.lens)
        film = straightened(film, camera.lens)
    stamps, stated, (height, width), warnings = film.stamps, film.rate, film.shape, list(film.notes)
    if len(stamps) < 3:
        raise UnreadableMedia(
            f"{path}: decodes to {len(stamps)} picture{'s' * (len(stamps) != 1)}; a measurement needs a clip."
        )
    if min(height, width) < SMALLEST:
        raise UnreadableMedia(f"{path}: is only {width} x {height} px, too small to show a rig; give the clip itself.")
    must_lie_inside(path, camera, width, height)
    film = without_regions(film, camera.ignore) if camera.ignore else film
    if not (camera.frame_rate or stated) > 0:
        raise BadInput(f"{path}: the file states no frame rate; give the capture rate with --frame-rate 240Hz.")
    times, plays_at, oddities = time_base(stamps, stated, film.tick, camera.frame_rate)
    rate = camera.frame_rate or plays_at
    if camera.frame_rate is None:
        warnings.append(
            f"frame rate {rate:.6g} Hz read from the file; high-speed files often play slower than captured: "
            "give the capture rate with --frame-rate."
        )
    check = "and --frame-rate, which sets the time scale."
    if beyond := _beyond("--start", camera.start, times):
        raise BadInput(f"{path}: {beyond}; check --start, {check}")
    first = _frame_of(camera.start, times, 0)
    last = _frame_of(camera.end, times, len(times) - 1)
    if beyond := _beyond("--end", camera.end, times):
        warnings.append(f"{beyond}: the clip was measured to its end; check --end, {check}")
    if last - first < 2:
        left = max(last - first + 1, 0)
        raise BadInput(
            f"{path}: --start and --end leave {left} {'frame' if left == 1 else 'frames'} of {len(times)}; "
            "a measurement needs at least three."
        )
    excluded = _excluded(camera, times)
    if sum(index not in excluded for index in range(first, last + 1)) < 3:
        raise BadInput(f"{path}: --exclude leaves fewer than three frames; leave out less of the clip.")
    warnings += _holding_no_frame(camera, times)
    return Video(
        path,
        width,
        height,
        rate,
        plays_at,
        times,
        first,
        last,
        film,
        (*warnings, *oddities),
        skipped=excluded,
        excluded=excluded,
    )


def _excluded(camera: Camera, times: npt.NDArray[np.float64]) -> frozenset[int]:
    """The frames of the parts of the clip that are left out."""
    return frozenset(frame for begin, end in camera.exclude for frame in _between(begin, end, times))


def _between(begin: Moment, end: Moment, times: npt.NDArray[np.float64]) -> Iterable[int]:
    """The frames from one moment to another; both belong to them."""
    if begin.unit == "frame":
        return range(math.ceil(begin.value), min(math.floor(end.value), len(times) - 1) + 1)
    inside = (times >= begin.value - 1e-9) & (times <= end.value + 1e-9)
    return [int(frame) for frame in np.flatnonzero(inside)]


def _holding_no_frame(camera: Camera, times: npt.NDArray[np.float64]) -> Iterator[str]:
    """The warnings for parts that are left out in which there is no frame."""
    for begin, end in camera.exclude:
        if any(True for _ in _between(begin, end, times)):
            continue
        span = f"{_in_words(begin)}..{_in_words(end)}"
        last = times[-1] if begin.unit == "s" else len(times) - 1
        if begin.value > last:
            where = f"lies beyond the last picture ({len(times) - 1}f at {times[-1]:.4g} s)"
        else:
            where = "lies between two frames"
        yield f"--exclude {span} {where}: it leaves nothing out."


def _in_words(moment: Moment) -> str:
    return f"{moment.value:g} s" if moment.unit == "s" else f"{moment.value:g}f"


def _beyond(option: str, moment: Moment | None, times: npt.NDArray[np.float64]) -> str:
    """Says that a moment lies beyond the clip, "" if it does not; the last picture lasts as the longest interval."""
    count = len(times)
    shown = float(times[-1] + np.max(np.diff(times)))
    # a clip length rounded to a hundredth of a second still counts as the clip's end
    if moment is None or moment.value <= (count if moment.unit == "frame" else shown + ROUNDED):
        return ""
    return (
        f"{option} {_in_words(moment)} lies beyond the clip, whose last picture ({count - 1}f) is at {times[-1]:.4g} s"
    )


def _frame_of(moment: Moment | None, times: npt.NDArray[np.float64], default: int) -> int:
    if moment is None:
        return default
    frame = moment.value if moment.unit == "frame" else float(np.searchsorted(times, moment.value - 1e-9))
    return int(min(max(frame, 0), len(times) - 1))
