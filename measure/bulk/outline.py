"""Outline (silhouette) of a heap or bed in a photo, column by column above the base line.

The border between beads and background is the path of least cost through per-pixel evidence, found by dynamic
programming and refined to sub-pixel precision. Lengths are in pixels of the measured picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import Point
from rigtwin.measure.bulk.beads import edges


@dataclass(frozen=True)
class Disc:
    """The base in the picture: a disc seen from the side."""

    centre: tuple[float, float]  # [px], midpoint between the rim's two ends, x right, y down
    half_width: float  # [px], half the distance of the rim's ends
    roll: float  # [rad], positive when the base appears turned clockwise
    bulge: float  # [px], distance of the front of the rim below the line between its ends
    thickness: float  # [px]
    nearness: float  # [1], disc radius / camera distance, from the focal length: one photo hardly determines it
    support: float  # [1], mean clearness of the edges along lower rim and walls
    fit: float  # [1], probability that its regions are what they should be: heap, face of the base, background
    lower_rim: float  # [1], mean clearness of the edges along the lower rim, 1: all are clear and on it

    @property
    def sigma(self) -> float:
        """Standard uncertainty [px] of the rim's place; larger if less of the template lies on edges or fits."""
        return 1.5 * (1 + 10 * max(0.0, 0.9 - self.support) + 10 * max(0.0, 0.9 - self.fit))


@dataclass(frozen=True)
class View:
    """Pose of the base in the picture; all lengths in px of the measured picture."""

    origin: tuple[float, float]  # picture point of the disc's axis at the top of the base
    roll: float  # [rad], positive when the base looks rotated clockwise in the picture
    radius: float  # of the base, at the scale of the plane through its axis; 0: not known
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
    contradicted: float = 0.0  # [px of the photo], from a base line that was stated to the one that is seen
    unconfirmed: str = ""  # why the picture cannot confirm a base line that was stated
    depression_sigma: float = 0.0  # [deg], standard uncertainty of the view's depression where no disc gives it

    def in_photo(self, x: Array, height: Array) -> list[Point]:
        """Points of the photo [px] at `x` along and `height` above the base line, shape (n,)."""
        # the centre of the top-left pixel is 0, 0 in the photo and in the smaller picture that was analysed
        points = (self.view.to_picture(x, height) + 0.5) / self.zoom - 0.5
        return [(float(a), float(b)) for a, b in points]

    @property
    def base_line_uncertainty(self) -> tuple[float, float]:
        """Standard uncertainties of the base line's height [px] and of its angle [rad]."""
        if self.stated is not None:
            return self.stated / math.sqrt(2), self.stated / (math.sqrt(2) * self.view.radius)
        height = self.disc.sigma if self.disc is not None else 0.5 * self.bead_radius
        return height, height / max(self.view.radius, 0.5 * float(np.ptp(self.x)))


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
    index, per_row = np.arange(count), 0.15
    steps = per_row * index
    best = np.empty_like(cost)
    best[0] = cost[0]
    for column in range(1, width):
        before = best[column - 1]
        from_above = np.minimum.accumulate(before - steps, axis=1) + steps
        from_below = np.minimum.accumulate((before + steps)[:, ::-1], axis=1)[:, ::-1] - steps
        np.add(np.minimum(from_above, from_below), cost[column], out=best[column])
    border = np.empty((readings, width))
    border[:, -1] = np.argmin(best[-1], axis=1)
    for column in range(width - 1, 0, -1):
        stepped = per_row * np.abs(index - border[:, column, None])
        border[:, column - 1] = np.argmin(best[column - 1] + stepped, axis=1)
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
