"""Find objects in front of a turning arm: a post, a rule, a cable.

The arm passes behind such an object and its pixels do not change.  In the arm's coordinates it moves along the arm,
like a body that rests on it and leaves.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from rigtwin.lab.arrays import Mask
from rigtwin.measure.tilt.plate_angle import Arm

INSIDE = 2.0  # [px], minimum distance from the arm's edges for a pixel that shows only the arm
OFTEN = 0.15  # minimum share of frames in which a pixel shows the arm, and in which it does not
FEWEST = 6  # minimum number of pixels in a column that the arm sweeps over
UNCHANGED = 0.6  # minimum share of unchanged pixels in an occluded column
THIN = 0.3  # largest share of occluded columns; if more are unchanged, arm and background look alike


def in_front(arm: Arm, still: Mask) -> Mask:
    """Mask of the columns in which an object is in front of the arm; `still` marks pixels that do not change."""
    y, x = np.indices(still.shape, dtype=np.float32)
    x, y = x - np.float32(arm.pivot[0]), y - np.float32(arm.pivot[1])
    rows = [edge.row for edge in arm.edges]
    shown = np.zeros(still.shape, dtype=np.float32)
    for direction in arm.directions.values():
        cos, sin = math.cos(direction), math.sin(direction)
        along, across = x * cos + y * sin, y * cos - x * sin
        inside = (across > min(rows) + INSIDE) & (across < max(rows) - INSIDE)
        shown += inside & (along > arm.span[0]) & (along < arm.span[1])
    share = shown / len(arm.directions)
    swept = (share > OFTEN) & (share < 1 - OFTEN)
    count = swept.sum(axis=0)
    known = count >= FEWEST
    unchanged = known & ((swept & still).sum(axis=0) > UNCHANGED * count)
    hidden = np.zeros(still.shape, dtype=np.uint8)
    if 0 < unchanged.sum() < THIN * known.sum():
        hidden[:, unchanged] = 1
    return np.asarray(cv2.dilate(hidden, np.ones((1, 7), np.uint8)) > 0)
