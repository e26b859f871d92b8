"""Find when a hopper's slot begins to open, and its edges, from the rows of the slide over time.

In this picture of position against time the trailing edge of the slide leaves a straight trace.  The slot begins to
open where the trace passes its near edge; that instant is interpolated between frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from rigtwin.lab.arrays import Array, Image, Mask
from rigtwin.measure.robust import mad_std

STILL = 5  # frames at the beginning from which the noise is estimated
ROWS = 0.4  # share of the rows that show the slide which must have lost it
LASTING = 3  # frames over which a change must persist


@dataclass(frozen=True)
class Opening:
    """Instant at which the slot begins to open."""

    frame: float  # from the first strip, with its fraction
    sigma: float  # [frames], standard uncertainty
    method: str  # how it was found
    direction: int  # +1: the slide moves to the right, -1: to the left, 0: unknown
    speed: float  # [px/frame], of the slide; NaN if unknown


def slot_edges(beads: npt.NDArray[np.bool_], left: float, right: float) -> tuple[float, float]:
    """Left and right edge [px] of the columns that beads pass through; `beads` has shape (frames, width).

    `left` and `right` are the first estimate, returned if too few beads are seen.
    """
    flowing = beads[:, round(left) : max(round(right), round(left) + 1)].mean(axis=1) > 0.25
    if flowing.sum() < 5:
        return left, right
    share = beads[flowing].mean(axis=0)
    middle = (left + right) / 2
    reach = 0.75 * (right - left)
    columns = np.flatnonzero(share > 0.15)
    columns = columns[np.abs(columns - middle) < reach]
    if len(columns) < 0.5 * (right - left):
        return left, right
    return float(columns[0]) - 0.5, float(columns[-1]) + 0.5


def find_opening(strips: Image, left: float, right: float, before: int, masked: Mask | None = None) -> Opening | None:
    """Instant at which the slide's trailing edge passes the slot's near edge; None if nothing changes in the slot.

    `strips`, shape (frames, width, 3 x rows), lasts until the hopper is empty.  `left` and `right` are the slot's edges
    [px], `before` a frame in which the slot is surely open, `masked`, shape (frames, width), is where something is in
    front of the slide.
    """
    level = strips[: before + LASTING + 1].astype(np.float64)
    masked = np.zeros(level.shape[:2], dtype=bool) if masked is None else masked[: len(level)]
    changed = _first_changes(level, np.median(strips[-STILL:], axis=0).astype(np.float64), masked)
    width = right - left
    slot = np.arange(max(math.ceil(left), 0), min(math.floor(right), level.shape[1] - 1) + 1)
    seen = slot[np.isfinite(changed[slot]) & (changed[slot] <= before + 1)]
    if len(seen) < 0.3 * len(slot):
        return None
    first, last = np.percentile(changed[seen], [10, 90])
    if last - first < 1:
        # the slide left between two frames
        return Opening(float(np.median(changed[seen])) - 0.5, 0.3, "slide, between two frames", 0, math.nan)
    direction = 1 if float(np.corrcoef(seen, changed[seen])[0, 1]) > 0 else -1
    near = left if direction > 0 else right
    # the slide also lies under the wall beside the slot, so its edge is visible there before it opens anything
    around = np.arange(level.shape[1], dtype=np.float64)
    along = direction * (around - near)
    kept = (along > -0.7 * width) & (along < width) & np.isfinite(changed) & (changed <= before + 1)
    frames, places = _edge_places(along[kept], changed[kept])
    if len(frames) >= 2:
        speed, at, sigma = _line(frames, places)
        if speed > 0:
            return Opening(at, sigma, "trailing edge of the slide", direction, speed)
    # without an edge to follow, the columns that change before the middle one may be noise
    early = 0.5 * (float(np.median(changed[seen])) - float(first))
    return Opening(float(first) - 0.5, math.hypot(0.5, early), "slide, first change in the slot", direction, math.nan)


def _first_changes(level: Array, empty: Array, masked: Mask) -> Array:
    """Frame in which every column permanently loses what it showed at first; infinite if that is not visible.

    Afterwards the column shows the empty hopper, and soon beads.  The change counts from its half height, because a
    moving edge is blurred.
    """
    wide = _smoothing(level)
    if wide > 1:
        level, empty = (uniform_filter1d(each, wide, axis=-2) for each in (level, empty))
    start = np.median(level[:STILL], axis=0)
    away, step = _by_row(level - start), _by_row((empty - start)[None])[0]
    # median over these frames: something may pass in one of them
    noise = max(float(np.median(np.percentile(away[:STILL], 90, axis=(1, 2)))), 1.0)
    shown = step > 4 * noise
    gone = (away > np.maximum(0.5 * step, 2.5 * noise)) & shown
    # beads that rest on the slide fill its uppermost rows and stay for a while: not all rows need to change
    above = (gone.sum(axis=2) >= ROWS * shown.sum(axis=1)) & (shown.sum(axis=1) > 0)
    count = len(above) - LASTING + 1
    above[masked] = False
    lasting = np.all([above[k : count + k] for k in range(LASTING)], axis=0)
    first = np.argmax(lasting, axis=0)
    # the frame of a change behind an occlusion is not known
    seen = lasting.any(axis=0) & ~masked[np.maximum(first - 1, 0), np.arange(len(first))]
    return np.asarray(np.where(seen, first, np.inf), dtype=np.float64)


def _smoothing(level: Array) -> int:
    """Number of columns to average, so that a slide of low contrast is visible in a noisy film."""
    noise = mad_std(np.diff(level[:STILL], axis=0), centre=0.0) / math.sqrt(2)
    return 2 * int(np.clip(round(noise / 3), 0, 4)) + 1


def _by_row(colours: Array) -> Array:
    """Root mean square over the three colours of every row, shape (frames, width, rows)."""
    frames, width = colours.shape[:2]
    return np.asarray(np.sqrt(np.mean(colours.reshape(frames, width, -1, 3) ** 2, axis=3)))


def _edge_places(along: Array, changed: Array) -> tuple[Array, Array]:
    """Frames in which the edge is moving, and its places [px]: uncovered on this side of it, covered beyond."""
    frames, places = [], []
    order = np.argsort(along)
    along, changed = along[order], changed[order]
    for frame in range(int(changed.min()), int(changed.max())):
        done = changed <= frame
        # the split with the fewest columns on the wrong side
        wrong = np.concatenate([[0], np.cumsum(~done)]) + (done.sum() - np.concatenate([[0], np.cumsum(done)]))
        k = int(np.argmin(wrong))
        if 1 < k < len(along) - 1 and wrong[k] < 0.2 * len(along):
            frames.append(frame)
            places.append((along[k - 1] + along[k]) / 2)
    return _moving(np.array(frames, dtype=np.float64), np.array(places))


def _moving(frames: Array, places: Array) -> tuple[Array, Array]:
    """The longest stretch in which the edge advances from frame to frame; of equally long ones the first."""
    if len(frames) < 2:
        return frames, places
    on = (np.diff(places) > 1.5) & (np.diff(frames) == 1)
    runs = np.split(np.arange(len(frames)), np.flatnonzero(~on) + 1)
    longest = max(runs, key=len)
    return frames[longest], places[longest]


def _line(frames: Array, places: Array) -> tuple[float, float, float]:
    """Speed [px/frame] of the edge, the frame at which it is at 0, and the standard uncertainty of that frame.

    A slide that still accelerates, or a misread place, bends the trace, so places next to the slot have most weight.
    """
    if len(frames) == 2:
        speed = float((places[1] - places[0]) / (frames[1] - frames[0]))
        at = frames[0] - places[0] / speed if speed > 0 else math.nan
        outside = max(frames[0] - at, at - frames[1], 0.0) if math.isfinite(at) else 1.0
        return speed, float(at), 0.15 + 0.3 * float(outside)
    weight = 1 / (1 + (places / max(float(np.ptp(places)) / 3, 1.0)) ** 2)
    for _ in range(4):
        speed, start = np.polyfit(frames, places, 1, w=np.sqrt(weight))
        off = np.abs(places - speed * frames - start)
        weight = weight * np.minimum(1.0, 2.0 / np.maximum(off, 1e-9) * (np.median(off) + 0.5))
        weight = weight / weight.max()
    if not speed > 0:
        return float(speed), math.nan, math.nan
    spread = float(np.sqrt(np.average((places - speed * frames - start) ** 2, weights=weight)))
    return float(speed), float(-start / speed), math.hypot(0.1, spread / float(speed))
