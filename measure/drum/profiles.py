"""Profiles of a drum's surface from the borders of its bed, frame by frame.

Left out are frames in which the drum is hidden, static objects in front of it, and flying beads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, binary_opening

from rigtwin.lab.arrays import Array
from rigtwin.lab.records import Profile
from rigtwin.measure.drum.bed import Outline

LOST = 0.25  # largest relative difference of a frame's bed area from the median
FLIGHT = 0.035  # [s], in which a bead of 6 mm falls by its diameter: a flying bead has passed, the bed has not changed


def credible(outlines: Sequence[Outline]) -> list[Outline]:
    """Outlines with heights NaN in frames where the drum is hidden or the bed's area is far from the median."""
    hidden = np.array([outline.hidden for outline in outlines])
    if hidden.mean() > 0.5:  # what is there for so long belongs to the scene
        hidden[:] = False
    areas = np.array([outline.area for outline in outlines])
    usual = float(np.median(areas[~hidden]))
    blank = np.full_like(outlines[0].height, np.nan)
    return [
        outline
        if abs(outline.area - usual) < LOST * usual and not behind
        else replace(outline, height=blank, looser=blank, stricter=blank)
        for outline, behind in zip(outlines, hidden, strict=True)
    ]


def hidden_columns(outlines: Sequence[Outline]) -> npt.NDArray[np.bool_]:
    """Mask of columns in which the border never moves: it belongs to an object in front of the drum."""
    heights = np.array([outline.height for outline in outlines])
    seen = np.isfinite(heights).mean(axis=0) > 0.5
    if len(outlines) < 8 or seen.sum() < 8:
        return np.zeros(heights.shape[1], dtype=bool)
    middle = np.full(heights.shape[1], np.nan)
    middle[seen] = np.nanmedian(heights[:, seen], axis=0)
    sway = np.full(heights.shape[1], np.nan)
    sway[seen] = np.nanmedian(np.abs(heights[:, seen] - middle[seen]), axis=0)
    usual = float(np.nanmedian(sway))
    still = seen & (sway < 0.2 * usual)
    kept = binary_opening(still, np.ones(3, dtype=bool))
    return np.asarray(binary_dilation(kept, np.ones(5, dtype=bool)))


def without_flights(outlines: Sequence[Outline], bead: float) -> list[Outline]:
    """Outlines without flying beads: heights half a `bead` [px] above the minimum within `FLIGHT` are lowered to it."""
    times = np.array([outline.time for outline in outlines])
    first, last = np.searchsorted(times, times - FLIGHT), np.searchsorted(times, times + FLIGHT, side="right")

    def lowest(which: str) -> list[Array]:
        heights = np.array([getattr(outline, which) for outline in outlines])
        filled = np.where(np.isfinite(heights), heights, np.inf)
        lowest_near = [filled[a:b].min(axis=0) for a, b in zip(first, last, strict=True)]
        # a frame keeps its own extent and its roughness
        return [
            np.where(np.isfinite(own) & (own - low > 0.5 * bead), low, own)
            for own, low in zip(heights, lowest_near, strict=True)
        ]

    borders = zip(outlines, lowest("height"), lowest("looser"), lowest("stricter"), strict=True)
    return [replace(one, height=usual, looser=more, stricter=fewer) for one, usual, more, fewer in borders]


def _apart_from_gaps(height: Array, bead: float) -> Array:
    """Heights without the neighbourhood of a gap: there the border bends along the object that hides the surface."""
    seen = np.flatnonzero(np.isfinite(height))
    if len(seen) == 0:
        return height
    gap = ~np.isfinite(height)
    gap[: seen[0]] = gap[seen[-1] + 1 :] = False
    if not gap.any():
        return height
    near = binary_dilation(gap, np.ones(2 * max(1, round(0.5 * bead)) + 1, dtype=bool))
    near[seen[0]] = near[seen[-1]] = False
    return np.where(near, np.nan, height)


def profile_of(
    outline: Outline, which: str, hidden: npt.NDArray[np.bool_], unit: float, shorter: float, bead: float
) -> Profile:
    height = _apart_from_gaps(np.where(hidden, np.nan, getattr(outline, which)), bead)
    seen = np.flatnonzero(np.isfinite(height))
    if shorter > 0 and len(seen):
        low, high = outline.x[seen[0]] + shorter, outline.x[seen[-1]] - shorter
        height = np.where((outline.x < low) | (outline.x > high), np.nan, height)
    return Profile(outline.x * unit, height * unit, np.full(len(height), 0.7 * unit), None, "end")
