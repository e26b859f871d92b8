"""Angles of repose of a heap from its surface profile; the same functions serve filmed and simulated heaps.

There are two families of definitions.  The *graphical* angle is the slope of a line fitted along a flank.  The
*geometric* angle is that of a triangle with the height or area of the heap.  They must not be mixed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.camera import Flank
from rigtwin.lab.records import Profile
from rigtwin.measure.robust import mad_std

WINDOW = (0.15, 0.85)  # shares of the heap's height between which a flank is fitted, without toe and tip
OTHER_WINDOWS = ((0.2, 0.8), (0.1, 0.85), (0.15, 0.75), (0.25, 0.85), (0.1, 0.75), (0.25, 0.75))
SIDES = ("left", "right")
STEEPEST_FLANK = 60.0  # [deg]; cohesive matter may stand steeper, loose beads do not
DRAWS = 200  # bootstrap samples


@dataclass(frozen=True)
class Line:
    """A straight line along a flank."""

    angle: float  # [deg], above the base line, positive when the flank falls outwards
    middle: tuple[float, float]  # [m], a point of the line
    inner: float  # [m], x of the window's end towards the apex
    outer: float  # [m], x of the window's end towards the foot


@dataclass(frozen=True)
class Heap:
    """The parts of a heap's profile; lengths in the unit of the profile."""

    x: Array  # shape (n,), increasing in equal steps
    height: Array  # shape (n,), no gaps
    apex: tuple[float, float]  # x and height
    feet: tuple[float, float]  # x of the outermost points of the outline
    base_width: float  # diameter of the dish in the picture if one is stated, otherwise the distance of the feet
    grain: float  # bead diameter
    apex_spread: float  # standard deviation of x over the top points, which could all be called the apex


def find_parts(profile: Profile, base_diameter: float | None, grain: float | None) -> Heap | None:
    """Find apex, feet and base of a profile; None if it contains no heap.

    The apex height is the 95th percentile of the heights in the band of the top grain, so that one stray grain does not
    set it.
    """
    seen = np.isfinite(profile.height) & np.isfinite(profile.x)
    if np.sum(seen) < 8:
        return None
    x, height = profile.x[seen], profile.height[seen]
    if not height.max() > 0:
        return None
    feet = _feet(x, height)
    even = np.linspace(feet[0], feet[1], 800)
    level = np.interp(even, x, height)
    size = grain if grain is not None else 0.1 * float(level.max())
    top = level > level.max() - size
    summit = float(np.percentile(level[top], 95))
    if feet[1] <= feet[0]:
        return None
    apex_x = float(np.mean(even[level >= summit]))
    spread = float(np.std(even[level >= summit - 0.1 * size]))
    width = base_diameter or feet[1] - feet[0]
    if base_diameter is not None and profile.base is not None:
        # height and base width from the same picture: their ratio needs no scale
        width = profile.base[1] - profile.base[0]
    return Heap(even, level, (apex_x, summit), feet, width, size, spread)


def flank_line(heap: Heap, side: str, window: tuple[float, float] = WINDOW) -> Line | None:
    """Fit a robust orthogonal line to one flank, between two fractions of the heap's height.

    The flank runs from the outermost point that reaches the lower level to the innermost point below the upper level.
    Selecting single points by their height would flatten the line along a rough flank.
    """
    part = _flank(heap, side, window)
    if part is None:
        return None
    x, height = heap.x[part], heap.height[part]
    direction, middle = _orthogonal_fit(x, height, heap.grain)
    outwards = -1.0 if side == "left" else 1.0
    angle = math.degrees(math.atan2(-direction[1] * outwards, direction[0]))
    ends = (float(x[-1]), float(x[0])) if side == "left" else (float(x[0]), float(x[-1]))
    return Line(angle, (float(middle[0]), float(middle[1])), *ends)


def free_flanks(heap: Heap, flank: Flank | None = None) -> tuple[str, ...]:
    """The flanks that are slopes of the heap: the stated one or both, else those that do not lean against a wall.

    A flank that rises more steeply than loose beads stand leans against a wall if the other one does not.
    """
    if flank is not None:
        return SIDES if flank == "both" else (flank,)
    lines = {side: flank_line(heap, side) for side in SIDES}
    free = tuple(side for side, line in lines.items() if line is not None and abs(line.angle) <= STEEPEST_FLANK)
    return free if len(free) == 1 and _at_a_wall(heap, SIDES[1 - SIDES.index(free[0])]) else SIDES


def _at_a_wall(heap: Heap, side: str) -> bool:
    """Whether a flank falls from the upper half of the heap to its foot within a grain."""
    foot = heap.feet[SIDES.index(side)]
    high = heap.x[heap.height > 0.5 * heap.apex[1]]
    return abs(foot - float(high[0 if side == "left" else -1])) < heap.grain


def steepest_third(heap: Heap, side: str) -> float | None:
    """Largest slope [deg] of a line over a third of the flank's height; None if that is less than 1.5 grains."""
    low, high = WINDOW
    third = (high - low) / 3
    if third * heap.apex[1] < 3 * 0.5 * heap.grain:
        return None
    lines = [flank_line(heap, side, (bottom, bottom + third)) for bottom in np.linspace(low, high - third, 9)]
    angles = [line.angle for line in lines if line is not None]
    return max(angles) if angles else None


def roughness_uncertainty(heap: Heap, side: str) -> float:
    """Standard uncertainty [deg] of the flank's slope from grain roughness: moving-block bootstrap of the residuals.

    Blocks are two grains long, so that the points of one grain are not treated as independent (Kuensch 1989).
    """
    part = _flank(heap, side, WINDOW)
    if part is None:
        return math.nan
    x, height = heap.x[part], heap.height[part]
    slope, offset = np.polyfit(x, height, 1)
    residual = height - slope * x - offset
    step = float(heap.x[1] - heap.x[0])
    block = int(np.clip(round(2 * heap.grain / step), 1, len(x)))
    blocks = math.ceil(len(x) / block)
    random = np.random.default_rng(len(x))
    start = random.integers(0, len(x), size=(DRAWS, blocks))
    index = ((start[..., None] + np.arange(block)) % len(x)).reshape(DRAWS, -1)[:, : len(x)]
    lever = (x - x.mean()) / np.sum((x - x.mean()) ** 2)
    scatter = float(np.std(residual[index] @ lever))
    grains = max((x[-1] - x[0]) / heap.grain, 2.5)
    # the fitted line takes two degrees of freedom from the few grains
    return math.degrees(scatter * math.sqrt(grains / (grains - 2)) / (1 + slope * slope))


def window_uncertainty(heap: Heap, side: str) -> float:
    """Standard deviation [deg] of the slope over other, equally valid windows."""
    lines = [flank_line(heap, side, window) for window in (WINDOW, *OTHER_WINDOWS)]
    angles = [line.angle for line in lines if line is not None]
    return float(np.std(angles)) if len(angles) > 2 else math.nan


def apex_angle(heap: Heap, side: str | None = None) -> float:
    """Geometric angle atan(2 H / B) [deg], as in ISO 4324; of one side: from the apex to the foot of that side."""
    if side is None:
        return math.degrees(math.atan(2 * heap.apex[1] / heap.base_width))
    reach = abs(heap.apex[0] - heap.feet[SIDES.index(side)])
    return math.degrees(math.atan2(heap.apex[1], reach))


def equal_area_angle(heap: Heap) -> float:
    """Geometric angle atan(4 S / B^2) [deg]: isosceles triangle with the silhouette's area S on the base B."""
    area = float(np.trapezoid(np.maximum(heap.height, 0), heap.x))
    return math.degrees(math.atan(4 * area / heap.base_width**2))


def tip_radius(heap: Heap) -> float | None:
    """Radius of a circle fitted to the tip of the heap, in the unit of the profile; None if the tip is not convex."""
    top = np.abs(heap.x - heap.apex[0]) < 0.15 * (heap.feet[1] - heap.feet[0])
    bend = float(np.polyfit(heap.x[top] - heap.apex[0], heap.height[top], 2)[0])
    return -0.5 / bend if bend < 0 else None


def monotony(heap: Heap, side: str) -> float:
    """Net rise of a flank over its total variation, smoothed over 1.5 grains; 1 for a flank that falls steadily."""
    from scipy.ndimage import uniform_filter1d

    part = _flank(heap, side, WINDOW)
    if part is None:
        return 0.0
    step = float(heap.x[1] - heap.x[0])
    smooth = uniform_filter1d(heap.height, size=max(1, round(1.5 * heap.grain / step)))[part]
    rises = np.diff(smooth) * (1.0 if side == "left" else -1.0)
    return float(rises.sum() / max(np.abs(rises).sum(), 1e-12))


def _feet(x: Array, height: Array) -> tuple[float, float]:
    """x of both ends of the heap: from 2 % of its height outwards for as long as the outline falls.

    A record may continue along the base plane, which is not part of the heap.
    """
    (up,) = np.nonzero(height > 0.02 * float(height.max()))
    first, last = int(up[0]), int(up[-1])
    while first > 0 and 0 <= height[first - 1] < height[first]:
        first -= 1
    while last < len(x) - 1 and 0 <= height[last + 1] < height[last]:
        last += 1
    return float(x[first]), float(x[last])


def _flank(heap: Heap, side: str, window: tuple[float, float]) -> npt.NDArray[np.bool_] | None:
    away = (heap.apex[0] - heap.x) if side == "left" else (heap.x - heap.apex[0])
    low, high = (share * heap.apex[1] for share in window)
    mine = away > 0
    reaching, under = mine & (heap.height > low), mine & (heap.height < high)
    if not reaching.any() or not under.any():
        return None
    inner, outer = float(away[under].min()), float(away[reaching].max())
    part = mine & (away >= inner) & (away <= outer)
    return part if np.sum(part) >= 8 else None


def _orthogonal_fit(x: Array, height: Array, grain: float) -> tuple[Array, Array]:
    """Direction and a point of the line with the least orthogonal residuals, with Huber weights.

    Bumps of half a grain belong to the surface; only points further off get less weight.
    """
    points = np.column_stack([x, height])
    weight = np.ones(len(x))
    while True:
        middle = np.average(points, axis=0, weights=weight)
        away = points - middle
        xx, xy, yy = (float(np.sum(weight * away[:, i] * away[:, j])) for i, j in ((0, 0), (0, 1), (1, 1)))
        turn = 0.5 * math.atan2(2 * xy, xx - yy)  # the larger principal axis
        direction = np.array([math.cos(turn), math.sin(turn)])
        miss = np.abs(away @ np.array([-direction[1], direction[0]]))
        bound = max(1.345 * mad_std(miss, centre=0.0), 0.5 * grain)
        before, weight = weight, np.minimum(1.0, bound / np.maximum(miss, 1e-15))
        if float(np.max(np.abs(weight - before))) < 1e-3:
            return direction, middle
