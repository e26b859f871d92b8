"""Outline of a heap or bed above a known base line: the border between grains and background, column by column.

No single grain is found.  A network gives the odds of grains in every pixel, at a coarse resolution.  Histograms of
colour sharpen them, first of places that must belong to the heap or cannot, then of the regions below and above the
border that these gave, and so on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, Image, Mask
from rigtwin.lab.camera import Flank
from rigtwin.measure.bulk.beads import look_cells, rare, shares
from rigtwin.measure.bulk.grain_classes import Grain
from rigtwin.measure.bulk.outline import Silhouette, View, bead_shaped, cheapest_borders, edge_map, sub_pixel
from rigtwin.measure.geometry.lines import fullest_run

FLATTEST, STEEPEST = 0.15, 1.2  # slopes [1]: every heap rises more than the first and less than the second
NARROWEST = 0.6  # share of the base that every heap covers
ROUNDS = 2  # of histograms and border; the border moves by less than a pixel afterwards
REACH = 8.0  # [bead radii], overhang of the heap beyond the base
SKY = 14.0  # [bead radii], height of the strip of background above the border
NETWORK = 0.5  # weight of the network's odds: those of colour are sharper
CLEAR = 1.0  # log odds of grains beyond which a place is clearly grains or not
GAPS = 0.05, 0.45  # least and largest share of a heap through which the background is seen


@dataclass(frozen=True)
class _Window:
    """The part of the picture that is searched, and what is known of it before."""

    columns: Array  # [px] along the base line
    rows: Array  # [px] above the base line, descending
    inside: Mask  # pixels taken for grains at first, shape (rows, columns)
    outside: Mask  # pixels taken for background at first
    gaps: tuple[float, float]  # least and largest share through which the background is seen


def outline_above(
    image: Image, classes: FloatImage, view: View, radius: float, flank: Flank | None = None
) -> Silhouette | None:
    """Find the border between a heap on a base and the background.

    Parameters
    ----------
    image : array, shape (height, width, 3), uint8
        The photo in BGR order.
    classes : array, shape (height, width, 4), float32
        Probabilities of the classes `Grain` in the photo.
    view : View
        Pose of the base line in the picture; its radius is half the base [px].
    radius : float
        Radius of a bead [px], as far as it is known; it sets the size of the windows.
    flank : {"left", "right", "both"}, optional
        A single flank leans against a wall at the other end of the base.

    Returns
    -------
    Silhouette or None
        The outline with its quality measures; None if nothing on the base differs from the background, or what does is
        narrower than six bead radii.

    Notes
    -----
    log q is half the network's log odds of grains plus the log ratio of the colour histograms of grains and background.
    With the share g of background that is seen through gaps of the heap, the evidence for "below the border" is
    log((1 - g) q + g).
    """
    window = _of_heap(view, radius, flank)
    places = _places(view, window.columns, window.rows)
    return _outline(image, places, _odds(classes, *places), view, radius, window)


def surface_between(image: Image, classes: FloatImage, view: View, radius: float) -> Silhouette | None:
    """Find the border between a bed and what is above it between two walls; arguments as of `outline_above`.

    The radius of the view is half the distance of the walls.  Turned by half a turn the view shows the lower border.
    """
    columns = np.arange(-math.floor(view.radius), math.floor(view.radius) + 1.0)
    upwards = math.cos(view.roll) > 0
    rows = np.arange(math.floor(view.origin[1] if upwards else len(image) - 1 - view.origin[1]), -1, -1.0)
    places = _places(view, columns, rows)
    odds = _odds(classes, *places)
    if not np.any(odds > 0):
        return None
    top = float(np.median(np.argmax(odds > 0, axis=0)))
    above = np.arange(len(rows))[:, None] < top + 2 * radius
    window = _Window(columns, rows, odds > CLEAR, (odds < -CLEAR) & above, (0.0, 0.0))
    return _outline(image, places, odds, view, radius, window)


def _of_heap(view: View, radius: float, flank: Flank | None) -> _Window:
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
    # distance from the summit in shares of the way to the end of the base on that side
    ways = np.where(columns < summit, summit + size, size - summit)
    share = np.abs(columns - summit) / np.maximum(ways, 1e-6)
    tall = size + abs(summit)
    inside = rows[:, None] < FLATTEST * tall * (NARROWEST - share)[None, :]
    outside = (rows[:, None] > STEEPEST * tall * (1 - share)[None, :] + 4 * radius) & (rows[:, None] > 0)
    return _Window(columns, rows, inside, outside, GAPS)


def _places(view: View, columns: Array, rows: Array) -> tuple[FloatImage, FloatImage]:
    points = view.to_picture(np.tile(columns, len(rows)), np.repeat(rows, len(columns))).astype(np.float32)
    return points[:, 0].reshape(len(rows), -1), points[:, 1].reshape(len(rows), -1)


def _outline(
    image: Image,
    places: tuple[FloatImage, FloatImage],
    odds: FloatImage,
    view: View,
    radius: float,
    window: _Window,
) -> Silhouette | None:
    """The border in the window; `places` are its pixels in the picture, `odds` those of grains there."""
    columns, rows, inside, outside = window.columns, window.rows, window.inside, window.outside
    map_x, map_y = places
    seen = cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    level = np.asarray(seen, dtype=np.uint8)
    odds = NETWORK * odds
    if np.any(odds[inside] > 0):
        inside = inside & (odds > 0)
    colours = look_cells(level, radius)
    borders = edge_map(level)
    count = np.arange(len(rows))[:, None]
    for _ in range(ROUNDS):
        if not inside.any() or not outside.any():
            return None
        evidence = np.clip(odds + _log_ratio(colours, inside, outside, radius), -3, 3)
        gaps = float(np.clip(np.mean(evidence[inside] < -1), *window.gaps))
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

    at = usual.astype(int), np.arange(len(columns))
    edge_x, edge_y = map_x[at], map_y[at]
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


def _odds(classes: FloatImage, map_x: FloatImage, map_y: FloatImage) -> FloatImage:
    """Log odds of grains at points of the picture, -3 to 3."""
    grains = cv2.remap(classes[..., Grain.GRAINS], map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(np.clip(np.log((grains + 0.01) / (1.01 - grains)), -3, 3), dtype=np.float32)


def _largest_run(heap: npt.NDArray[np.bool_], gap: int) -> npt.NDArray[np.bool_]:
    run = fullest_run(heap, gap=gap + 1)
    kept = np.zeros_like(heap)
    if run is not None:
        kept[run[0] : run[1] + 1] = heap[run[0] : run[1] + 1]
    return kept


def _log_ratio(
    index: npt.NDArray[np.int32],
    inside: npt.NDArray[np.bool_],
    outside: npt.NDArray[np.bool_],
    radius: float,
) -> Array:
    """Log of the likelihood ratio of matter and background, -3 to 3; the background is partly that of near columns."""
    matter = shares(index[inside])
    little = rare(matter, index[inside])
    everywhere = shares(index[outside])
    answer = np.empty(index.shape)
    width, stride = index.shape[1], max(int(3 * radius), 8)
    beyond = (-width % stride) // 2  # strips lie symmetrically, so that a mirrored photo gives the mirrored border
    for left in range(-beyond, width, stride):
        window = slice(max(left - stride, 0), left + 2 * stride)
        strip = slice(max(left, 0), left + stride)
        near = index[:, window][outside[:, window]]
        behind = 0.7 * shares(near) + 0.3 * everywhere if near.size else everywhere
        answer[:, strip] = np.log((matter + 0.1 * little) / (behind + little))[index[:, strip]]
    return np.clip(answer, -3, 3)
