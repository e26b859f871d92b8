"""Detect a reflection over a part of a bed behind glass: a lamp's reflection brightens and hides what is behind it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, Image

APART = (0.5, 2.0)  # [bead diameters], distances below and above the surface at which the grey levels are compared
# A bed column is bright if it exceeds the dark quartile by this much.  In drawn beds of shaded beads no column does so
# in even light, or in light that changes by 40 % across the drum; lighter beads in 20 to 50 % of the bed, and lamps,
# do.
BRIGHTER = 40.0  # [grey levels]
ALSO_OVER = 10.0  # [grey levels]; above lighter beads less than 1, under lamps at least 18, even before a wall of 235
DULLED = 0.75  # contrast over brightness, relative to the rest; lighter beads have 0.85 to 0.92, lamps 0.39 to 0.66
WHITE = 255.0  # [grey levels], saturation
INSIDE = 0.93  # share of the drum's radius: further out the wall is seen
PAIRS = 60  # columns of which every pair gives a slope


def brightened_share(
    pictures: Sequence[Image],
    x: Array,
    heights: Array,
    centre: tuple[float, float],
    radius: float,
    roll: float,
    bead: float,
) -> float:
    """Share of the surface's length under a reflection, in the mean of the pictures.

    Under a reflection the bed is much brighter than elsewhere, the space above it is brighter, too, and the contrast of
    its beads is lower.  Lighter beads brighten nothing above them, and their contrast is that of dark ones.

    `heights`, shape (frames, n) [px] above the axis, at the columns `x`, shape (n,) [px] right of it, in a picture with
    roll `roll` [rad]; `centre` and `radius` [px] of the drum.  NaN if too little of the surface is seen.
    """
    seen = np.isfinite(heights).mean(axis=0) > 0.5
    if seen.sum() < 8:
        return math.nan
    x, border = x[seen], np.nanmedian(heights[:, seen], axis=0)
    # a reflection may pull the border up or down, but the line through the whole surface stays near it
    line = _line(x, border)
    if line is None:
        return math.nan
    apart = np.linspace(*APART, 8)[:, None] * bead
    beneath, over = np.minimum(border, line) - apart, np.maximum(border, line) + apart
    cos, sin = math.cos(roll), math.sin(roll)

    def along(picture: FloatImage, level: Array) -> Array:
        """Mean of a picture over the levels inside the drum, for every column; NaN if there are none."""
        at_x, at_y = centre[0] + x * cos + level * sin, centre[1] + x * sin - level * cos
        light = cv2.remap(picture, at_x.astype(np.float32), at_y.astype(np.float32), cv2.INTER_LINEAR)
        inner = np.hypot(x, level) < INSIDE * radius
        deep = inner.sum(axis=0)
        return np.asarray(np.where(deep > 0, np.sum(np.where(inner, light, 0), axis=0) / np.maximum(deep, 1), np.nan))

    greys = [np.asarray(cv2.cvtColor(each, cv2.COLOR_BGR2GRAY), np.float32) for each in pictures]
    mean = np.asarray(np.mean(greys, axis=0), np.float32)
    detail = np.mean([np.abs(each - cv2.GaussianBlur(each, (0, 0), bead / 2)) for each in greys], axis=0)
    bed, empty = along(mean, beneath), along(mean, over)
    contrast = along(np.asarray(detail / np.maximum(mean, 1), np.float32), beneath)
    known = np.isfinite(bed)
    if known.sum() < 8:
        return math.nan
    bright = bed > np.percentile(bed[known], 25) + BRIGHTER
    lit = bright & _lies_over(empty, bright)
    if not lit.any() or np.median(contrast[lit]) > DULLED * np.median(contrast[known & ~bright]):
        return 0.0
    return float(np.mean(lit[known]))


def _lies_over(empty: Array, bright: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Mask of columns whose empty part is brighter, too; all columns if the background is nearly saturated."""
    plain = empty[~bright & np.isfinite(empty)]
    usual = float(np.median(plain)) if len(plain) else math.nan
    return np.asarray((empty > usual + ALSO_OVER) | (usual > WHITE - ALSO_OVER))


def _line(x: Array, height: Array) -> Array | None:
    """Theil-Sen line through the inner part of the surface (Theil 1950, Sen 1968).

    None if it has fewer than two columns.
    """
    inner = np.flatnonzero(np.abs(x - (x[0] + x[-1]) / 2) < 0.4 * (x[-1] - x[0]))
    if len(inner) < 2:
        return None
    some = inner[:: max(1, len(inner) // PAIRS)]
    one, other = np.triu_indices(len(some), 1)
    slope = np.median((height[some][other] - height[some][one]) / (x[some][other] - x[some][one]))
    return np.asarray(slope * x + np.median(height[some] - slope * x[some]))
