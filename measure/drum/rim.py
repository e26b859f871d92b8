"""Find the circle of a drum's inner wall in a picture.

A drum seen from its end shows several concentric circles: flange, front rim, back wall.  Every edge pixel votes for the
axis along its brightness gradient (Hough transform).  The inner wall is the circle that contains the bed of beads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.measure.geometry.disc_morphology import odd, opened
from rigtwin.measure.robust import mad_std

COARSE = 400  # [px], longer side of the reduced picture in which edges vote for the axis
SPOKES = 240  # directions in which the edge of a circle is searched
LEAST_SUPPORT = 0.3  # least share of spokes that meet an edge of the circle
THIN = 0.045  # share of the picture; what is narrower is not a bed
NEAR = 0.07  # share of the radius by which the bed may end short of the wall
# Share of a circle with an edge from which the picture shows it; and by how much a stated one must have less to be
# contradicted: less than the texture of a bed gives is no difference.  Rims of rendered drums have 0.7 to 1, circles
# through bed and back wall 0.2 to 0.6.
CLEARLY, LESS = 0.7, 0.3


@dataclass(frozen=True)
class Rim:
    """Circle of the drum's inner wall, in px of the picture that was searched."""

    centre: tuple[float, float]  # x to the right, y down
    radius: float
    support: float  # [1], share of the circle with an edge
    sigma: float  # standard uncertainty of centre and radius
    stated: bool = False  # by the user, not found
    seen: Rim | None = None  # the circle that the picture shows instead of the stated one

    def inside(self, shape: tuple[int, int], share: float = 1.0) -> npt.NDArray[np.bool_]:
        """Mask of pixels within `share` of the radius."""
        y, x = np.mgrid[: shape[0], : shape[1]]
        return np.asarray(np.hypot(x - self.centre[0], y - self.centre[1]) < share * self.radius)


def find_rim(picture: npt.NDArray[np.float32], moving: npt.NDArray[np.bool_] | None = None) -> Rim | None:
    """Find the drum's inner circle in a grey picture of the static scene; None if there is none.

    `moving` marks pixels in which the bed moves.  Its outer border selects the inner wall among concentric circles.
    Without it the circle with the largest support is used.
    """
    zoom = min(1.0, COARSE / max(picture.shape))
    small = cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA)
    axis = _axis(np.asarray(small, dtype=np.float32))
    if axis is None:
        return None
    centre = np.array(axis) / zoom
    rings = _rings(picture, centre)
    if not rings:
        return None
    if moving is not None and moving.any():
        reach = _reach(_largest(moving), centre)
        close = [ring for ring in rings if abs(ring.radius - reach) < NEAR * reach]
        if not close:
            return None
        chosen = max(close, key=lambda ring: ring.support - 4 * abs(ring.radius - reach) / reach)
    else:
        chosen = max(rings, key=lambda ring: ring.support)
    return _refined(picture, chosen)


def stated_rim(picture: npt.NDArray[np.float32], circle: tuple[float, float, float], sigma: float) -> Rim:
    """The circle (centre x, y and radius) as stated, with the share of it along which the picture has an edge."""
    x, y, radius = circle
    radii, radial, noise = _along_spokes(picture, np.array([x, y]))
    near = np.abs(radii - radius) < 2 * sigma
    support = float(np.mean(np.any(np.abs(radial[near]) > noise, axis=0)))
    return Rim((x, y), radius, support, sigma, stated=True)


def compared(stated: Rim, found: Rim | None) -> Rim:
    """The stated circle, with the one that the picture shows instead where it contradicts the stated one."""
    if found is None or found.support < max(CLEARLY, stated.support + LESS):
        return stated
    centres = math.dist(stated.centre, found.centre)
    if centres > min(stated.radius, found.radius):
        return stated  # that of another object
    apart = max(centres, abs(stated.radius - found.radius))
    return replace(stated, seen=found) if apart > NEAR * found.radius else stated


def rim_of_bed(moving: npt.NDArray[np.bool_]) -> Rim | None:
    """Circle through the lower border of the moving bed, for a drum whose rim shows no edge."""
    bed = _largest(moving)
    columns = np.flatnonzero(bed.any(axis=0))
    if len(columns) < 20:
        return None
    bottom = bed.shape[0] - 1 - np.argmax(bed[::-1], axis=0)[columns]
    circle = _circle_through(columns.astype(float), bottom.astype(float))
    if circle is None or not 0.3 * len(columns) < circle[2] < 5 * len(columns):
        return None
    x, y, radius, scatter = circle
    return Rim((x, y), radius, 0.0, max(scatter, 0.01 * radius))


def _largest(marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The largest thick region; bolts that turn with the flange leave a thin ring beside the bed."""
    thick = opened(marked.astype(np.uint8), odd(THIN * max(marked.shape)))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(thick, connectivity=4)
    if count < 2:
        return marked
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def _axis(picture: npt.NDArray[np.float32]) -> tuple[float, float] | None:
    """The point to or from which most edge gradients point."""
    slope_x, slope_y, strength = _gradient(picture)
    height, width = picture.shape
    y, x = np.nonzero(strength > max(float(np.percentile(strength, 80)), 1.0))
    if len(x) < 100:
        return None
    unit_x, unit_y = slope_x[y, x] / strength[y, x], slope_y[y, x] / strength[y, x]
    votes = np.zeros(height * width)
    for radius in np.arange(0.12 * min(height, width), 0.62 * max(height, width), 1.0):
        for sign in (-1, 1):
            to_x = np.rint(x + sign * radius * unit_x).astype(np.int64)
            to_y = np.rint(y + sign * radius * unit_y).astype(np.int64)
            inside = (to_x >= 0) & (to_x < width) & (to_y >= 0) & (to_y < height)
            # a straight edge votes along a strip, a circle for one point: count votes, regardless of edge strength
            votes += np.bincount(to_y[inside] * width + to_x[inside], minlength=height * width)
    density = cv2.GaussianBlur(votes.reshape(height, width), (0, 0), 2.0)
    # straight lines and dense edges raise whole regions; a centre is a local peak above its surroundings
    density = density - cv2.GaussianBlur(density, (0, 0), 12.0)
    row, column = np.unravel_index(int(np.argmax(density)), density.shape)
    top, left = max(int(row) - 4, 0), max(int(column) - 4, 0)
    weight = np.maximum(density[top : top + 9, left : left + 9], 0)
    rows, columns = np.indices(weight.shape)
    total = float(weight.sum())
    return left + float((weight * columns).sum()) / total, top + float((weight * rows).sum()) / total


def _gradient(
    picture: npt.NDArray[np.float32],
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    smooth = cv2.GaussianBlur(picture, (0, 0), 1.2)
    slope_x = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8), dtype=np.float32)
    slope_y = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8), dtype=np.float32)
    return slope_x, slope_y, np.asarray(np.hypot(slope_x, slope_y) + 1e-6, dtype=np.float32)


def _along_spokes(picture: npt.NDArray[np.float32], centre: Array) -> tuple[Array, Array, float]:
    """Radii [px], gradient along every spoke, shape (radii, SPOKES), and the edge noise of the picture [grey/px]."""
    slope_x, slope_y, strength = _gradient(picture)
    height, width = picture.shape
    farthest = float(np.hypot(np.maximum(centre[0], width - centre[0]), np.maximum(centre[1], height - centre[1])))
    radii = np.arange(8.0, farthest, 0.5)
    angle = np.arange(SPOKES) * 2 * np.pi / SPOKES
    x = (centre[0] + radii[:, None] * np.cos(angle)).astype(np.float32)
    y = (centre[1] + radii[:, None] * np.sin(angle)).astype(np.float32)
    along_x, along_y, whole = (
        cv2.remap(each, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.0)
        for each in (slope_x, slope_y, strength)
    )
    radial = along_x * np.cos(angle) + along_y * np.sin(angle)
    radial = np.where(np.abs(radial) > 0.85 * whole, radial, 0.0)
    return radii, np.asarray(radial, dtype=np.float64), max(1.5 * float(np.median(strength)), 0.4)


def _rings(picture: npt.NDArray[np.float32], centre: Array) -> list[Rim]:
    """Circles around an axis with edges on many spokes, from the inside outwards."""
    radii, radial, noise = _along_spokes(picture, centre)
    met = cv2.dilate((np.abs(radial) > noise).astype(np.float32), np.ones((7, 1), np.uint8))
    support = np.asarray(cv2.GaussianBlur(met.mean(axis=1)[:, None], (1, 9), 2.0), dtype=np.float64)[:, 0]
    peaks = [
        k
        for k in range(4, len(radii) - 4)
        if support[k] > LEAST_SUPPORT and support[k] == support[max(k - 8, 0) : k + 9].max()
    ]
    return [Rim((float(centre[0]), float(centre[1])), float(radii[k]), float(support[k]), 1.0) for k in peaks]


def _refined(picture: npt.NDArray[np.float32], ring: Rim) -> Rim:
    """Circle fitted to the edge points near a ring, without outliers."""
    radii, radial, noise = _along_spokes(picture, np.array(ring.centre))
    band = np.abs(radii - ring.radius) < max(0.03 * ring.radius, 3.0)
    strength = np.abs(radial[band])
    best = strength.argmax(axis=0)
    seen = strength.max(axis=0) > noise
    if np.sum(seen) < 0.2 * SPOKES:
        return ring
    angle = (np.arange(SPOKES) * 2 * np.pi / SPOKES)[seen]
    radius = radii[band][best[seen]]
    circle = _circle_through(ring.centre[0] + radius * np.cos(angle), ring.centre[1] + radius * np.sin(angle))
    if circle is None or abs(circle[2] - ring.radius) > 0.04 * ring.radius:
        return ring
    return Rim((circle[0], circle[1]), circle[2], ring.support, max(circle[3] / math.sqrt(np.sum(seen) / 4), 0.2))


def _reach(moving: npt.NDArray[np.bool_], centre: Array) -> float:
    """Distance from the axis to the end of the moving bed [px]: 60th percentile over the directions."""
    y, x = np.nonzero(moving)
    away = np.hypot(x - centre[0], y - centre[1])
    sector = np.floor(np.arctan2(y - centre[1], x - centre[0]) / (2 * np.pi) * 72).astype(int) % 72
    ends = np.array([np.percentile(away[sector == k], 99) for k in range(72) if np.sum(sector == k) > 20])
    return float(np.percentile(ends, 60)) if len(ends) else 0.0


def _circle_through(x: Array, y: Array) -> tuple[float, float, float, float] | None:
    """Centre, radius and scatter of a circle: algebraic fit (Kasa 1976), repeated without outliers."""
    keep = np.ones(len(x), dtype=bool)
    solution: Array = np.zeros(3)
    off = np.zeros(len(x))
    for _ in range(8):
        design = np.column_stack([x[keep], y[keep], np.ones(int(keep.sum()))])
        solution = np.asarray(np.linalg.lstsq(design, x[keep] ** 2 + y[keep] ** 2, rcond=None)[0], dtype=np.float64)
        squared = solution[2] + (solution[0] ** 2 + solution[1] ** 2) / 4
        if squared <= 0:
            return None
        off = np.hypot(x - solution[0] / 2, y - solution[1] / 2) - math.sqrt(squared)
        spread = mad_std(off[keep]) + 0.1
        before, keep = keep, np.abs(off) < 2.5 * spread
        if keep.sum() < 12:
            return None
        if np.array_equal(before, keep):
            break
    radius = math.sqrt(solution[2] + (solution[0] ** 2 + solution[1] ** 2) / 4)
    return float(solution[0] / 2), float(solution[1] / 2), radius, float(np.std(off[keep]))
