"""Light that lies over a part of a bed behind glass: a lamp's reflection brightens what is behind it and hides it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, Image

APART = (0.5, 2.0)  # bead diameters from the surface, where there are beads, or none, whatever hides the surface itself
# as drawn: beds of shaded beads in even light, and in one that changes by 40 % across the drum, have no column brighter
# than the darker ones by as much; lighter beads in 20 to 50 % of the bed, and lamps, have
BRIGHTER = 40.0  # [grey levels]
ALSO_OVER = 10.0  # [grey levels]; above lighter beads less than 1, under lamps 18 and more, even before a wall of 235
DULLED = 0.75  # times the usual contrast over brightness; of lighter beads 0.85 to 0.92, under lamps 0.39 to 0.66
WHITE = 255.0  # [grey levels], what no light makes brighter
INSIDE = 0.93  # of the drum's radius: further out the wall is seen
PAIRS = 60  # columns, of which every pair gives a slope


def brightened_share(
    pictures: Sequence[Image],
    x: Array,
    heights: Array,
    centre: tuple[float, float],
    radius: float,
    roll: float,
    bead: float,
) -> float:
    """Share of the surface's length at which light lies over the bed, in the mean of the pictures.

    There the bed is far brighter than elsewhere, so is what is above it, and its beads stand out less; lighter beads
    brighten nothing above them, and stand out from each other as dark ones do.

    `heights` [px] above the axis, one row per frame, at the columns `x` [px] right of it, in a picture turned by `roll`
    [rad]; `centre` and `radius` [px] of the drum.  NaN where too little of a surface is seen.
    """
    seen = np.isfinite(heights).mean(axis=0) > 0.5
    if seen.sum() < 8:
        return math.nan
    x, border = x[seen], np.nanmedian(heights[:, seen], axis=0)
    # where a reflection pulls the border up or down, the line through the whole surface still lies near it
    line = _line(x, border)
    if line is None:
        return math.nan
    apart = np.linspace(*APART, 8)[:, None] * bead
    beneath, over = np.minimum(border, line) - apart, np.maximum(border, line) + apart
    cos, sin = math.cos(roll), math.sin(roll)

    def along(picture: FloatImage, level: Array) -> Array:
        """Mean of a picture over the levels inside the drum, for every column; NaN where there are none."""
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
    """Columns in which what is not bed is brighter, too; all of them where it is too bright to show it."""
    plain = empty[~bright & np.isfinite(empty)]
    usual = float(np.median(plain)) if len(plain) else math.nan
    return np.asarray((empty > usual + ALSO_OVER) | (usual > WHITE - ALSO_OVER))


def _line(x: Array, height: Array) -> Array | None:
    """The line of the median slope between columns of the surface's inner part (Theil 1950, Sen 1968).

    None where none of these columns is seen.
    """
    inner = np.flatnonzero(np.abs(x - (x[0] + x[-1]) / 2) < 0.4 * (x[-1] - x[0]))
    if len(inner) < 2:
        return None
    some = inner[:: max(1, len(inner) // PAIRS)]
    one, other = np.triu_indices(len(some), 1)
    slope = np.median((height[some][other] - height[some][one]) / (x[some][other] - x[some][one]))
    return np.asarray(slope * x + np.median(height[some] - slope * x[some]))
