"""Cover the regions that the user wants ignored, with what surrounds them.

A covered region is smooth and, in a film, the same in every picture: it shows neither edges nor motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from rigtwin.lab.arrays import Image

Region = tuple[float, float, float, float]

LARGEST = 96  # [px], side to which a region is reduced before it is filled, which takes time with the square of it


def covered(picture: Image, regions: Sequence[Region]) -> Image:
    """A copy of the picture, shape (height, width) or (height, width, 3), with `regions` [px] filled from around."""
    out: Image = picture.copy()
    for region in regions:
        rows, columns, frame_rows, frame_columns = _places(region, picture.shape)
        around = out[frame_rows, frame_columns]
        hole = np.zeros((around.shape[0], around.shape[1]), np.uint8)
        top, left = rows.start - frame_rows.start, columns.start - frame_columns.start
        hole[top : top + rows.stop - rows.start, left : left + columns.stop - columns.start] = 255
        if not hole.any() or hole.all():
            continue
        factor = min(LARGEST / max(hole.shape), 1.0)
        size = (max(math.ceil(hole.shape[1] * factor), 3), max(math.ceil(hole.shape[0] * factor), 3))
        # pixels that the hole touches when reduced belong to it, so that nothing of its content is spread
        small_hole = (np.asarray(cv2.resize(hole, size, interpolation=cv2.INTER_AREA)) > 0).astype(np.uint8)
        filled = cv2.inpaint(cv2.resize(around, size, interpolation=cv2.INTER_AREA), small_hole, 3, cv2.INPAINT_TELEA)
        smooth = cv2.resize(filled, (hole.shape[1], hole.shape[0]), interpolation=cv2.INTER_LINEAR)
        around[hole > 0] = smooth[hole > 0]
    return out


def _places(region: Region, shape: Sequence[int]) -> tuple[slice, slice, slice, slice]:
    """Rows and columns of a region, and of the region with the surroundings that it is filled from."""
    x, y, width, height = region
    margin = max(4, round(0.1 * max(width, height)))
    rows, wide_rows = _extent(y, height, shape[0], margin)
    columns, wide_columns = _extent(x, width, shape[1], margin)
    return rows, columns, wide_rows, wide_columns


def _extent(start: float, length: float, whole: int, margin: int) -> tuple[slice, slice]:
    first, last = max(math.floor(start), 0), min(math.ceil(start + length), whole)
    return slice(first, max(last, first)), slice(max(first - margin, 0), min(last + margin, whole))


def patched(picture: Image, fill: Image, regions: Sequence[Region]) -> Image:
    """A copy of the picture with `regions` [px] taken from `fill`, a picture of the same shape."""
    out: Image = picture.copy()
    for region in regions:
        rows, columns, *_ = _places(region, picture.shape)
        out[rows, columns] = fill[rows, columns]
    return out
