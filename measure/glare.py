"""Light that lies over a part of a bed behind glass: a lamp's reflection brightens what is behind it and hides it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

BENEATH = (0.5, 2.0)  # bead diameters under the surface, where there are beads whatever hides the surface itself
BRIGHTER = 40.0  # [grey levels], above the darker columns of the bed; even light leaves them within 20
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
    """Share of the surface's length beneath which the bed is far brighter than elsewhere, in the mean of the pictures.

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
    surface = np.minimum(border, line)
    level = surface - np.linspace(*BENEATH, 8)[:, None] * bead
    cos, sin = math.cos(roll), math.sin(roll)
    at_x, at_y = centre[0] + x * cos + level * sin, centre[1] + x * sin - level * cos
    mean = np.asarray(np.mean([cv2.cvtColor(each, cv2.COLOR_BGR2GRAY) for each in pictures], axis=0), np.float32)
    light = cv2.remap(mean, at_x.astype(np.float32), at_y.astype(np.float32), cv2.INTER_LINEAR).astype(np.float64)
    inner = np.hypot(x, level) < INSIDE * radius
    deep = inner.sum(axis=0)
    columns = np.sum(np.where(inner, light, 0), axis=0)[deep > 0] / deep[deep > 0]
    if len(columns) < 8:
        return math.nan
    return float(np.mean(columns > np.percentile(columns, 25) + BRIGHTER))


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
