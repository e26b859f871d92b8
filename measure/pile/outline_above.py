"""Outline of a heap above a known base line: everything that looks like the matter on the base, up to the background.

No single grain is found.  Matter and background are histograms of colour and of texture, first of places that must
belong to the heap or cannot, then of the regions below and above the border that these gave, and so on.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import Flank
from rigtwin.measure.bulk.beads import look_cells, rare, shares
from rigtwin.measure.bulk.outline import Silhouette, View, bead_shaped, cheapest_borders, edge_map, sub_pixel
from rigtwin.measure.geometry.lines import fullest_run

FLATTEST, STEEPEST = 0.15, 1.2  # slopes [1]: every heap rises more than the first and less than the second
NARROWEST = 0.6  # share of the base that every heap covers
ROUNDS = 2  # of histograms and border; the border moves by less than a pixel afterwards
REACH = 8.0  # [bead radii], overhang of the heap beyond the base
SKY = 14.0  # [bead radii], height of the strip of background above the border
TEXTURES = 64  # steps of roughness
ROUGHNESS_WEIGHT = 0.5  # of texture against colour: its windows overlap, so that neighbouring pixels say the same twice
FEWEST_GAPS, MOST_GAPS = 0.05, 0.45  # share of a heap through which the background is seen


def outline_above(image: Image, view: View, radius: float, flank: Flank | None = None) -> Silhouette | None:
    """Find the border between the matter on a base and the background, column by column above the base line.

    Parameters
    ----------
    image : array, shape (height, width, 3), uint8
        The photo in BGR order.
    view : View
        Pose of the base line in the picture; its radius is half the base [px].
    radius : float
        Radius of a bead [px], as far as it is known; it sets the size of the windows.
    flank : {"left", "right", "both"}, optional
        A single flank leans against a wall at the other end of the base.

    Returns
    -------
    Silhouette or None
        The outline with its quality measures; None if nothing on the base differs from the background.

    Notes
    -----
    With the ratio q of the likelihoods of a pixel for matter and background, and the share g of background that is seen
    through gaps of the heap, the evidence for "below the border" is log((1 - g) q + g).
    """
    size = view.radius
    summit = {"left": size, "right": -size}.get(flank or "both", 0.0)
    slack = math.ceil(REACH * radius)
    first, last = (-math.ceil(size) - slack, math.ceil(size) + slack)
    if flank == "left":
        last = math.floor(size)
    elif flank == "right":
        first = math.ceil(-size)
    columns = np.arange(first, last + 1.0)
    rows = np.arange(math.ceil(STEEPEST * (size + abs(summit))), -1, -1.0)
    points = view.to_picture(np.tile(columns, len(rows)), np.repeat(rows, len(columns))).reshape(len(rows), -1, 2)
    map_x, map_y = points[..., 0].astype(np.float32), points[..., 1].astype(np.float32)
    seen = cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    level = np.asarray(seen, dtype=np.uint8)
    # distance from the summit in shares of the way to the end of the base on that side
    ways = np.where(columns < summit, summit + size, size - summit)
    share = np.abs(columns - summit) / np.maximum(ways, 1e-6)
    tall = size + abs(summit)
    inside = rows[:, None] < FLATTEST * tall * (NARROWEST - share)[None, :]
    outside = (rows[:, None] > STEEPEST * tall * (1 - share)[None, :] + 4 * radius) & (rows[:, None] > 0)
    colours = look_cells(_smooth(level, radius), radius)
    looks = [(colours, 1.0, shares), (_roughness(level, radius), ROUGHNESS_WEIGHT, _steps)]
    borders = edge_map(level)
    count = np.arange(len(rows))[:, None]
    for _ in range(ROUNDS):
        if not inside.any() or not outside.any():
            return None
        ratio = sum(weight * _log_ratio(index, inside, outside, count_of, radius) for index, weight, count_of in looks)
        evidence = np.clip(ratio, -3, 3)
        gaps = float(np.clip(np.mean(evidence[inside] < -1), FEWEST_GAPS, MOST_GAPS))
        gain = np.log((1 - gaps) * np.exp(evidence) + gaps)
        (border,) = cheapest_borders(gain[None], borders, 0.35 * radius)
        inside = count > border + 0.3 * radius
        outside = (count < border - 0.6 * radius) & (count > border - SKY * radius)
    readings = np.stack([gain + shift for shift in (0.0, 0.8, -0.8)])
    found = cheapest_borders(readings, borders, 0.35 * radius)
    usual, looser, stricter = (bead_shaped(border, radius) for border in found)
    fine, clearness = sub_pixel(borders, usual)
    heap = _largest_run(usual < len(rows) - 1 - 0.5 * radius, math.ceil(2 * radius))
    if np.sum(heap) < 6 * radius:
        return None

    def as_height(border: Array) -> Array:
        return np.where(heap, rows[0] - border, np.nan)

    edge_x, edge_y = points[usual.astype(int), np.arange(len(columns))].T
    margin = (edge_x < 2) | (edge_y < 2) | (edge_x > image.shape[1] - 3) | (edge_y > image.shape[0] - 3)
    likely = 1 / (1 + np.exp(-evidence))
    below = (count > usual[None, :]) & heap[None, :]
    return Silhouette(
        x=columns,
        height=as_height(fine),
        looser=as_height(looser),
        stricter=as_height(stricter),
        sigma=0.7,
        contrast=float(np.median(clearness[heap])),
        bead_radius=radius,
        view=view,
        disc=None,
        zoom=1.0,
        cut_off=bool(np.any(margin & heap)),
        covered=float(np.mean(likely[below])) if below.any() else 0.0,
        alike_behind=float(np.mean(likely[outside])) if outside.any() else 1.0,
    )


def _largest_run(heap: npt.NDArray[np.bool_], gap: int) -> npt.NDArray[np.bool_]:
    run = fullest_run(heap, gap=gap + 1)
    kept = np.zeros_like(heap)
    if run is not None:
        kept[run[0] : run[1] + 1] = heap[run[0] : run[1] + 1]
    return kept


def _smooth(level: npt.NDArray[Any], radius: float) -> npt.NDArray[Any]:
    """The picture without noise finer than a tenth of a bead's radius."""
    return cv2.GaussianBlur(level, (0, 0), max(0.1 * radius, 0.8))


def _roughness(level: Image, radius: float) -> npt.NDArray[np.int32]:
    """Step of the local standard deviation of lightness of every pixel, 0 to `TEXTURES` - 1."""
    light = _smooth(cv2.cvtColor(level, cv2.COLOR_BGR2LAB)[..., 0].astype(np.float32), radius)
    window = (2 * round(0.5 * radius) + 1,) * 2
    rough = np.sqrt(np.maximum(cv2.blur(light * light, window) - cv2.blur(light, window) ** 2, 0))
    # smoothest window that contains the pixel (Kuwahara et al. 1976), so that an edge adds no roughness beside it
    smoothest = cv2.erode(rough, np.ones(window, np.uint8))
    return np.asarray(np.clip(8 * np.log2(smoothest + 1), 0, TEXTURES - 1).astype(np.int32))


def _steps(index: npt.NDArray[np.int32]) -> Array:
    """Smoothed histogram of roughness, sum 1."""
    from scipy.ndimage import gaussian_filter1d

    count = np.bincount(index, minlength=TEXTURES).astype(np.float64)
    return np.asarray(gaussian_filter1d(count / max(len(index), 1), 1.5))


def _log_ratio(
    index: npt.NDArray[np.int32],
    inside: npt.NDArray[np.bool_],
    outside: npt.NDArray[np.bool_],
    count_of: Callable[[npt.NDArray[np.int32]], Array],
    radius: float,
) -> Array:
    """Log of the likelihood ratio of matter and background, -3 to 3; the background is partly that of near columns."""
    matter = count_of(index[inside])
    little = rare(matter, index[inside])
    everywhere = count_of(index[outside])
    answer = np.empty(index.shape)
    width, stride = index.shape[1], max(int(3 * radius), 8)
    beyond = (-width % stride) // 2  # strips lie symmetrically, so that a mirrored photo gives the mirrored border
    for left in range(-beyond, width, stride):
        window = slice(max(left - stride, 0), left + 2 * stride)
        strip = slice(max(left, 0), left + stride)
        near = index[:, window][outside[:, window]]
        behind = 0.7 * count_of(near) + 0.3 * everywhere if near.size else everywhere
        answer[:, strip] = np.log((matter + 0.1 * little) / (behind + little))[index[:, strip]]
    return np.clip(answer, -3, 3)
