"""Correct pictures for lens distortion and perspective: as seen perpendicular to the plane of motion."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import Lens


def straight(picture: Image, lens: Lens) -> Image:
    """Undistorted and rectified picture (grey or colour) of the lens's size; the border pixels are replicated."""
    across, down = _maps(lens)
    return np.asarray(
        cv2.remap(picture, across, down, interpolation=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


def project(points: Array, plane: Array, bend: tuple[float, float], size: tuple[int, int]) -> Array:
    """Pixel coordinates, shape (n, 2), of points in the plane, shape (n, 2), with radial distortion.

    `plane` is the homography, shape (3, 3), from plane to ideal pixels; `bend` the two radial coefficients; `size`
    width and height [px]. The distortion factor about the picture's centre is 1 + k1 r^2 + k2 r^4, where r is the
    distance in units of half the diagonal.
    """
    flat = points @ plane[:, :2].T + plane[:, 2]
    pixels = flat[:, :2] / flat[:, 2:]
    middle = (np.array(size, dtype=float) - 1) / 2
    out = (pixels - middle) / (math.hypot(*size) / 2)
    square = np.sum(out * out, axis=1, keepdims=True)
    return np.asarray(middle + (pixels - middle) * (1 + square * (bend[0] + square * bend[1])))


@lru_cache(maxsize=4)
def _maps(lens: Lens) -> tuple[Any, Any]:
    width, height = lens.size
    down, across = np.mgrid[:height, :width]
    grid = np.column_stack([across.ravel(), down.ravel()]).astype(float)
    source = project(grid, np.array(lens.plane), lens.bend, lens.size).astype(np.float32)
    return cv2.convertMaps(source[:, 0].reshape(height, width), source[:, 1].reshape(height, width), cv2.CV_16SC2)
