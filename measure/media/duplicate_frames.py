"""Detect frames that repeat the previous one, e.g. a 120 Hz recording stored at 240 Hz.

While something moves, a repeated frame is recognised by its zero change between frames that do change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, GreyImage
from rigtwin.lab.progress import Progress, silent
from rigtwin.measure.media.frame_loss import SELDOM, repeated
from rigtwin.measure.media.pictures import Picture, Source
from rigtwin.measure.media.time_base import SAME_RATE
from rigtwin.measure.media.video import Video

COARSE = 4  # downsampling factor per axis
LARGE = 1_000_000  # [px], picture size above which downsampling is done by two halvings
CLOSE = 0.1  # largest difference between the share of repeats found and the share expected from the two frame rates
IN_STEP = 0.9  # share of the repeated frames that one constant rate must explain


def coarse(grey: GreyImage) -> GreyImage:
    """The picture at a quarter of its size: a moving bead changes a few cells strongly, noise all cells weakly."""
    if grey.size > LARGE:  # halving is the fastest resize
        # the sum reads the picture sequentially into the cache; halving reads two rows at once and would stall
        cv2.sumElems(grey)
        half = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
        grey = np.asarray(half, dtype=np.uint8)
        return np.asarray(cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA))
    size = (max(grey.shape[1] // COARSE, 1), max(grey.shape[0] // COARSE, 1))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


class Repeats:
    """Collect the frames of a clip one by one, then list those that repeat the previous one."""

    def __init__(self) -> None:
        self._last: GreyImage | None = None
        self._indices: list[int] = []
        self._changes: list[float] = []

    def add(self, index: int, small: GreyImage) -> None:
        """Add the next frame, already reduced by `coarse`."""
        if self._last is not None:
            self._indices.append(index)
            self._changes.append(float(np.max(cv2.absdiff(small, self._last))))
        self._last = small

    def frames(self) -> frozenset[int]:
        """Indices of the repeated frames; empty if there are only a few."""
        marked = repeated(np.array(self._changes), noise=2.0)
        return frozenset(int(index) for index, mark in zip(self._indices, marked, strict=True) if mark)


def without_repeats(video: Video, progress: Progress = silent) -> Video:
    """The video without repeated frames."""
    repeats = Repeats()
    for frame in video.frames():
        repeats.add(frame.index, coarse(frame.grey))
        progress("looking for doubled frames", frame.index - video.first + 1, video.last - video.first + 1)
    return _by_those_that_remain(video, repeats.frames())


def at_its_pace(video: Video, progress: Progress = silent) -> Video:
    """The video without repeated frames; they are searched only if the playback rate exceeds the capture rate."""
    return without_repeats(video, progress) if video.frame_rate < (1 - SAME_RATE) * video.playback_rate else video


def _by_those_that_remain(video: Video, doubled: frozenset[int]) -> Video:
    skipped = video.skipped | doubled
    apart = np.diff(sorted(doubled))
    apart = apart[apart <= SELDOM]  # repeats are invisible while nothing moves; larger gaps come from there
    if len(apart) == 0 or abs(video.frame_rate / video.playback_rate - 1) < SAME_RATE:
        return replace(video, skipped=skipped)  # playback at the capture rate: the time stamps are true times
    share, stored = 1 / float(np.mean(apart)), 1 - video.frame_rate / video.playback_rate
    # some repeats are missed where little moves; if the share found agrees with the two rates, theirs is exact
    share = stored if abs(share - stored) < CLOSE else 1 / float(np.median(apart))
    note = (
        f"doubled frames: about {100 * share:.0f} % repeat the previous one and were left out; the remaining frames "
        "are timed at the given capture rate."
    )
    warnings = (*video.warnings, note)
    beat = _in_step(video.times * video.frame_rate * (1 - share), doubled)
    if beat is None:
        return replace(video, skipped=skipped, times=video.times * (1 - share), warnings=warnings)
    kept = [k for k in range(len(beat)) if k == 0 or beat[k] > beat[k - 1]]
    inside = [number for number, index in enumerate(kept) if video.first <= index <= video.last]
    return replace(
        video,
        source=_Captured(video.source, kept),
        times=beat[kept] / video.frame_rate,
        first=inside[0],
        last=inside[-1],
        skipped=(left_out := frozenset(number for number, index in enumerate(kept) if index in video.excluded)),
        excluded=left_out,
        numbers=np.searchsorted(beat[kept], beat),
        warnings=warnings,
    )


def _in_step(taken: Array, doubled: frozenset[int]) -> Array | None:
    """Captured frame number of each stored frame, shape (n,), if one constant rate explains the repeats; else None.

    The file shows the last frame captured so far, so stored frame i shows floor(taken_i + phase). The repeats found
    fix the phase for all frames, also while nothing moves. `taken` is the time in capture intervals, shape (n,).
    """
    seen = np.array(sorted(doubled))
    phases = np.arange(0.0, 1.0, 0.01)
    numbers = np.floor(taken[None] + phases[:, None])
    agree = np.sum(numbers[:, seen] == numbers[:, seen - 1], axis=1)
    most = np.flatnonzero(agree == np.max(agree))
    return np.asarray(numbers[most[len(most) // 2]]) if np.max(agree) > IN_STEP * len(seen) else None


class _Captured:
    """The distinct pictures of a source, renumbered."""

    def __init__(self, source: Source, kept: list[int]) -> None:
        self.source, self.kept = source, kept
        self.shape, self.rate, self.tick, self.notes = source.shape, source.rate, source.tick, source.notes
        self.stamps = [source.stamps[index] for index in kept]

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        kept = frozenset(self.kept)
        first = self.kept[start]
        return (each for index, each in enumerate(self.source.pictures(first), start=first) if index in kept)

    def at(self, numbers: Sequence[int]) -> Iterator[Picture]:
        return self.source.at([self.kept[number] for number in numbers])

    def cheap(self, first: int, last: int) -> list[int]:
        keys = frozenset(self.source.cheap(self.kept[first], self.kept[last]))
        return [number for number in range(first, last + 1) if self.kept[number] in keys]
