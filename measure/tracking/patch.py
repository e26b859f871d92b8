"""Pixels around the expected position of a bead, and the start of the fit from image moments."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Mask
from rigtwin.measure.robust import MAD_TO_STD, middle_of

LARGEST_RADIUS = 20.0  # [px], beads of at least twice this radius are downsampled by block means to save time


@dataclass(frozen=True)
class Patch:
    """Pixels around the expected centre, downsampled if the bead is larger than the fit needs."""

    grey: Array  # difference to the background if known, otherwise grey levels, shape (h, w)
    behind: Array | None  # background, shape (h, w)
    usable: Mask  # pixels that are not occluded, shape (h, w)
    origin: tuple[float, float]  # [px], picture position of the patch's pixel (0, 0)
    step: int  # picture pixels per patch pixel
    near: tuple[float, float]  # expected centre [patch px]
    radius: float  # [patch px]

    def place(self, point: tuple[float, float]) -> tuple[float, float]:
        """A picture position [px] converted to patch pixels."""
        return (point[0] - self.origin[0]) / self.step, (point[1] - self.origin[1]) / self.step


def cut_patch(
    grey: npt.NDArray[np.generic],
    background: npt.NDArray[np.generic] | None,
    near: tuple[float, float],
    reach: tuple[float, float],
    radius: float,
    hidden: Mask | None,
) -> Patch | None:
    """The pixels within `reach` (x, y) of `near` [px]; None if too few of them lie inside the picture.

    `hidden` marks occluded pixels, shape (height, width).
    """
    height, width = grey.shape
    if not (np.all(np.isfinite(near)) and radius > 0):
        return None
    left, right = max(math.floor(near[0] - reach[0]), 0), min(math.ceil(near[0] + reach[0]) + 1, width)
    top, bottom = max(math.floor(near[1] - reach[1]), 0), min(math.ceil(near[1] + reach[1]) + 1, height)
    if right - left < max(radius, 4) or bottom - top < max(radius, 4):
        return None
    window = np.s_[top:bottom, left:right]
    values = np.asarray(grey[window], dtype=np.float64)
    behind = None if background is None else np.asarray(background[window], dtype=np.float64)
    usable = np.ones(values.shape, dtype=bool) if hidden is None else ~hidden[window]
    if behind is not None:
        values = values - behind
    step = max(1, math.floor(radius / LARGEST_RADIUS))
    if step > 1:
        values, usable = _block_mean(values, step), _block_mean(usable.astype(np.float64), step) > 0.99
        behind = None if behind is None else _block_mean(behind, step)
    first = (step - 1) / 2
    return Patch(
        grey=values,
        behind=behind,
        usable=usable,
        origin=(left + first, top + first),
        step=step,
        near=((near[0] - left - first) / step, (near[1] - top - first) / step),
        radius=radius / step,
    )


def _block_mean(values: Array, step: int) -> Array:
    height, width = (side // step for side in values.shape)
    blocks = values[: height * step, : width * step].reshape(height, step, width, step)
    return np.asarray(blocks.mean(axis=(1, 3)))


def start_from_moments(patch: Patch, blur_guess: tuple[float, float]) -> Array | None:
    """x, y, blur x, blur y [patch px] and contrast from the moments of the spot nearest to the guess; None: no spot."""
    values = patch.grey - surroundings(patch)
    level = cv2.GaussianBlur(np.abs(values) * patch.usable, (0, 0), 0.8)
    away_x = np.arange(values.shape[1])[None, :] - patch.near[0]
    away_y = np.arange(values.shape[0])[:, None] - patch.near[1]
    square = away_x * away_x + away_y * away_y
    if float(square.min()) >= max(patch.radius, 2.0) ** 2:
        return None
    noise = MAD_TO_STD * middle_of(np.abs(values - middle_of(values.ravel())).ravel())
    threshold = max(0.4 * _part(level.ravel(), 0.97), 1.5 * noise, 1.0)
    count, labels, stats, _ = cv2.connectedComponentsWithStats((level > threshold).astype(np.uint8), connectivity=4)
    nearness = level / (1 + square / patch.radius**2)
    score = np.bincount(labels.ravel(), nearness.ravel(), minlength=count)
    score[(stats[:, cv2.CC_STAT_AREA] < 3) | (np.arange(count) == 0)] = 0.0
    best = int(np.argmax(score))
    if score[best] == 0.0:
        return None
    y, x = np.nonzero(labels == best)
    blur = np.array(blur_guess) / patch.step
    if not np.any(blur):
        blur = _blur_from_moments(x.astype(np.float64), y.astype(np.float64))
    return np.array([x.mean(), y.mean(), *blur, _part(level[y, x], 0.8)])


def surroundings(patch: Patch) -> float:
    """Background level: median along the border of the patch; 0 if the background is already subtracted."""
    if patch.behind is not None:
        return 0.0
    rim = np.concatenate([patch.grey[0], patch.grey[-1], patch.grey[:, 0], patch.grey[:, -1]])
    return float(np.median(rim))


def _blur_from_moments(x: Array, y: Array) -> Array:
    """Motion blur L of a disc from the second moments of its image: lambda_1 - lambda_2 = L^2 / 12."""
    if len(x) < 6:
        return np.array([0.3, 0.3])
    values, vectors = np.linalg.eigh(np.cov(np.stack([x, y])))
    length = math.sqrt(12 * max(float(values[1] - values[0]), 0.0))
    return np.asarray(max(length, 0.5) * vectors[:, 1])


def _part(values: npt.NDArray[Any], share: float) -> float:
    """Quantile without interpolation, faster than `np.quantile`."""
    place = min(round(share * (len(values) - 1)), len(values) - 1)
    return float(np.partition(values, place)[place])
