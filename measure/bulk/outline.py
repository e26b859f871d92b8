"""Outline (silhouette) of a heap or bed in a photo, column by column above the base line.

The border between beads and background is the path of least cost through per-pixel evidence, found by dynamic
programming and refined to sub-pixel precision. Lengths are in pixels of the measured picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image
from rigtwin.measure.bulk.beads import (
    FEWEST_BEADS,
    Beads,
    edges,
    look_cells,
    rare,
    shares,
)
from rigtwin.measure.geometry.lines import fullest_run

COVERED = 0.8  # minimum share of the area under the outline that circles cover


@dataclass(frozen=True)
class Disc:
    """The base in the picture: a disc seen from the side."""

    centre: tuple[float, float]  # [px], midpoint between the rim's two ends, x right, y down
    half_width: float  # [px], half the distance of the rim's ends
    roll: float  # [rad], positive when the base appears turned clockwise
    bulge: float  # [px], distance of the front of the rim below the line between its ends
    thickness: float  # [px]
    nearness: float  # [1], disc radius / camera distance, from the focal length: one photo hardly determines it
    support: float  # [1], share of the template on edges

    @property
    def sigma(self) -> float:
        """Standard uncertainty [px] of the rim's height; larger if less of the template lies on edges."""
        return 1.5 * (1 + 10 * max(0.0, 0.9 - self.support))


@dataclass(frozen=True)
class View:
    """Pose of the base in the picture; all lengths in px of the measured picture."""

    origin: tuple[float, float]  # picture point of the disc's axis at the top of the base
    roll: float  # [rad], positive when the base looks rotated clockwise in the picture
    radius: float  # of the base, at the scale of the plane through its axis; 0: no disc found
    camera_height: float  # above the base plane
    camera_distance: float  # from the axis; infinite: unknown

    @property
    def looking_down(self) -> float:
        """Depression angle of the view [deg]; 0 is horizontal."""
        return math.degrees(math.atan2(self.camera_height, self.camera_distance))

    def to_picture(self, x: Array, height: Array) -> Array:
        """Picture points [px], shape (n, 2), of points `x` along and `height` above the base line, shape (n,)."""
        cos, sin = np.cos(self.roll), np.sin(self.roll)
        return np.column_stack([self.origin[0] + x * cos + height * sin, self.origin[1] + x * sin - height * cos])


@dataclass(frozen=True)
class Silhouette:
    """Outline of the heap against the background; lengths in px of the measured picture, arrays of shape (n,)."""

    x: Array  # along the base line, 0 at the disc's axis, ascending
    height: Array  # above the base line, NaN outside the heap
    looser: Array  # the same outline with a lower limit for beads
    stricter: Array  # the same outline with a higher limit for beads
    sigma: float  # standard uncertainty of the height of one point
    contrast: float  # [1], median edge strength along the outline, 1: the clearest edges in the picture
    bead_radius: float
    view: View
    disc: Disc | None
    zoom: float  # px of the measured picture per px of the photo
    cut_off: bool  # the outline touches the border of the picture
    covered: float  # [1], share of the area under the outline that looks like beads
    alike_behind: float  # [1], mean likeness to beads just above the outline
    bead_seen: float = float("nan")  # bead radius from the picture alone, independent of stated sizes
    stated: float | None = None  # standard uncertainty of both ends of a base line that was stated

    @property
    def base_line_uncertainty(self) -> tuple[float, float]:
        """Standard uncertainties of the base line's height [px] and of its angle [rad]."""
        if self.stated is not None:
            return self.stated / math.sqrt(2), self.stated / (math.sqrt(2) * self.view.radius)
        height = self.disc.sigma if self.disc is not None else 0.5 * self.bead_radius
        return height, height / max(self.view.radius, 0.5 * float(np.ptp(self.x)))


def outline_of(
    image: Image, alike: npt.NDArray[np.float32], beads: Beads, view: View, *, solid: bool = False
) -> Silhouette | None:
    """Find the border between beads and background, column by column above the base line.

    Parameters
    ----------
    image : array, shape (height, width, 3), uint8
        The photo in BGR order.
    alike : array, shape (height, width)
        Likeness of every pixel to beads, 0 to 1 (see `beads.likeness`).
    beads : Beads
        Circles found in the heap [px].
    view : View
        Pose of the base line in the picture [px, rad].
    solid : bool, optional
        Everything below the uppermost circles is beads, as in a filled cylinder; gaps are ignored.

    Returns
    -------
    Silhouette or None
        The outline with its quality measures. `disc` is None and `zoom` is 1; the caller sets them. None if fewer than
        `FEWEST_BEADS` circles lie above the base line, or if the outline is narrower than six bead radii.

    Notes
    -----
    The evidence e for beads is the log odds of `alike` plus the log ratio of two local colour histograms, reduced with
    the height above the circles. The border b(c) minimises the sum over columns c of

    sum_r +-e(r, c) / 3 - 0.35 R E(b, c) + 0.15 |b(c) - b(c - 1)|

    where the sign is + above and - below the border, E is the edge strength and R the bead radius [px].
    """
    across = beads.centre - np.array(view.origin)
    cos, sin = np.cos(view.roll), np.sin(view.roll)
    u, h = across @ np.array([cos, sin]), across @ np.array([sin, -cos])
    above = h > 0
    if np.sum(above) < FEWEST_BEADS:
        return None
    u, h = u[above], h[above]
    reach = max(view.radius, float(np.abs(u).max())) + 4 * beads.radius
    top = float(h.max()) + 6 * beads.radius
    columns = np.arange(-np.ceil(reach), np.ceil(reach) + 1)
    rows = np.arange(np.ceil(top), -1, -1.0)  # from the top down to the base line
    points = view.to_picture(np.tile(columns, len(rows)), np.repeat(rows, len(columns))).reshape(len(rows), -1, 2)
    map_x, map_y = points[..., 0].astype(np.float32), points[..., 1].astype(np.float32)
    seen = cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    level = np.asarray(seen, dtype=np.uint8)
    colour = cv2.remap(alike, map_x, map_y, cv2.INTER_LINEAR, borderValue=0.0).astype(np.float64)
    higher = _above_beads(columns, rows, u, h, beads.radius)
    evidence = np.log((colour + 0.02) / (1.02 - colour)) + _against_local_sky(level, higher, colour, beads.radius)
    # the further above the circles, the stronger the colour evidence must be
    evidence = np.clip(np.clip(evidence, -3, 3) - 1.2 * higher, -3, 3)
    if solid:
        evidence = np.where(_above_beads(columns, rows, u, h - 2.4 * beads.radius, beads.radius) == 0, 3.0, evidence)
    borders = edge_map(level)
    readings = np.stack([evidence + shift for shift in (0.0, 0.8, -0.8)])
    usual, looser, stricter = (
        bead_shaped(border, beads.radius) for border in cheapest_borders(readings, borders, 0.35 * beads.radius)
    )
    fine, clearness = sub_pixel(borders, usual)
    # the foot of a heap is as steep as the side of a bead: a flat tail belongs to an object behind it
    empty = usual >= len(rows) - 1 - 0.5 * beads.radius
    first, last = fullest_run(~empty, gap=int(2 * beads.radius) + 1) or (0, -1)
    empty[:first] = empty[last + 1 :] = True
    if np.sum(~empty) < 6 * beads.radius:
        return None

    def as_height(border: Array) -> Array:
        return np.where(empty, np.nan, rows[0] - border)

    heap = ~empty
    edge_x, edge_y = points[usual.astype(int), np.arange(len(columns))].T
    margin = (edge_x < 2) | (edge_y < 2) | (edge_x > image.shape[1] - 3) | (edge_y > image.shape[0] - 3)
    return Silhouette(
        x=columns,
        height=as_height(fine),
        looser=as_height(looser),
        stricter=as_height(stricter),
        sigma=0.7,
        contrast=float(np.median(clearness[heap])),
        bead_radius=beads.radius,
        view=view,
        disc=None,
        zoom=1.0,
        cut_off=bool(np.any(margin & heap)),
        covered=_covered(columns, rows, usual, heap, np.column_stack([u, h]), beads.radius),
        alike_behind=float(np.mean(_just_above(colour, usual, beads.radius)[:, heap])),
    )


def _covered(
    columns: Array, rows: Array, border: Array, heap: npt.NDArray[np.bool_], centre: Array, radius: float
) -> float:
    under = (np.arange(len(rows))[:, None] > border[None, :]) & heap[None, :]
    circles = np.zeros(under.shape, np.uint8)
    for u, h in centre:
        cv2.circle(circles, (round(u - columns[0]), round(rows[0] - h)), round(radius), 1, -1)
    return float(np.mean(circles[under])) if under.any() else 0.0


def _just_above(values: Array, border: Array, radius: float) -> Array:
    """Values 0.2 to 1.2 bead radii above the border, shape (6, columns)."""
    rows = border[None, :] - np.linspace(0.2, 1.2, 6)[:, None] * radius
    return np.take_along_axis(values, np.clip(np.rint(rows), 0, len(values) - 1).astype(np.int64), axis=0)


def _above_beads(columns: Array, rows: Array, u: Array, h: Array, radius: float) -> Array:
    """Height of each pixel above the circles in bead radii, 0 below them, shape (rows, columns)."""
    from scipy.ndimage import grey_closing

    envelope = np.zeros(len(columns))
    for centre_u, centre_h in zip(u, h, strict=True):
        near = np.abs(columns - centre_u) < 1.5 * radius
        envelope[near] = np.maximum(envelope[near], centre_h + 1.2 * radius)
    closed = np.asarray(grey_closing(envelope, size=(int(6 * radius) | 1,)))
    return np.asarray(np.maximum((rows[:, None] - closed[None, :]) / radius, 0))


def _against_local_sky(level: Image, higher: Array, colour: Array, radius: float) -> Array:
    """Evidence of a pixel's colour for beads against the local background, shape (rows, columns).

    Log ratio of two histograms: the beads, and the strip above the circles within a few beads to both sides.
    """
    index = look_cells(level, radius)
    inside = index[(higher == 0) & (colour > 0.5)]
    beads = shares(inside)
    little = rare(beads, inside)
    sky = (higher > 0.8) & (higher < 6.0)
    answer = np.zeros_like(colour)
    width, stride = level.shape[1], max(int(1.5 * radius), 1)
    for left in range(0, width, stride):
        window = slice(max(left - stride, 0), min(left + 2 * stride, width))
        strip = slice(left, min(left + stride, width))
        behind = shares(index[:, window][sky[:, window]])
        answer[:, strip] = np.log((beads + 0.1 * little) / (behind + little))[index[:, strip]]
    return np.clip(answer, -3, 3)


def edge_map(level: Image) -> Array:
    """Colour edge strength of each pixel, 0 to 1, shape (rows, columns)."""
    strength = np.zeros(level.shape[:2], dtype=np.float32)
    for channel in range(3):
        strength = np.maximum(strength, edges(np.ascontiguousarray(level[..., channel]), blur=1.0).strength)
    return np.asarray(np.clip(strength / max(float(np.percentile(strength, 95)), 1.0), 0, 1), dtype=np.float64)


def cheapest_borders(evidence: Array, borders: Array, edge_reward: float) -> Array:
    """Row of the border in every column, shape (readings, columns): background above it, beads below.

    `evidence` has shape (readings, rows, columns). Dynamic programming over the columns. A step between neighbouring
    columns costs less than an edge gains, because the sides of beads are steep. The minimum is exact: the cost of a
    step is linear in its height, so two running minima per column are enough.
    """
    gain = evidence / 3
    total = gain.sum(axis=1, keepdims=True)
    above = np.cumsum(gain, axis=1) - gain
    cost = np.ascontiguousarray(np.moveaxis(2 * above - total - edge_reward * borders, -1, 0))
    width, readings, count = cost.shape
    step = 0.15 * np.arange(count)
    best = cost[0]
    came_from = np.zeros(cost.shape, dtype=np.int32)
    index = np.arange(count, dtype=np.int32)
    for column in range(1, width):
        down, up = best - step, best + step
        least_down = np.minimum.accumulate(down, axis=1)
        least_up = np.minimum.accumulate(up[:, ::-1], axis=1)[:, ::-1]
        from_down = np.maximum.accumulate(np.where(down <= least_down, index, 0), axis=1)
        from_up = np.minimum.accumulate(np.where(up <= least_up, index, count - 1)[:, ::-1], axis=1)[:, ::-1]
        use_down = least_down + step <= least_up - step
        came_from[column] = np.where(use_down, from_down, from_up)
        best = np.where(use_down, least_down + step, least_up - step) + cost[column]
    border = np.empty((readings, width))
    row = np.argmin(best, axis=1)
    for column in range(width - 1, -1, -1):
        border[:, column] = row
        row = came_from[column, np.arange(readings), row]
    return border


def bead_shaped(border: Array, radius: float) -> Array:
    """Remove deep slits and high spikes narrower than a bead; rows count downwards."""
    from scipy.ndimage import grey_closing, grey_opening

    spikes_cut = grey_closing(border, size=(int(1.6 * radius) | 1,))
    border = np.where(spikes_cut - border > 0.8 * radius, spikes_cut, border)
    slits_filled = grey_opening(border, size=(int(1.2 * radius) | 1,))
    return np.asarray(np.where(border - slits_filled > radius, slits_filled, border))


def sub_pixel(borders: Array, border: Array) -> tuple[Array, Array]:
    """The border moved to the centroid of the edge strength within two rows, and the maximum strength there."""
    rows, columns = borders.shape
    reach = np.arange(-2, 3)
    near = np.clip(border.astype(int)[:, None] + reach, 0, rows - 1)
    strength = borders[near, np.arange(columns)[:, None]]
    middle = np.sum(strength * reach, axis=1) / np.maximum(strength.sum(axis=1), 1e-9)
    return border + middle, strength.max(axis=1)
