"""Long straight edges in a picture: Hough transform of the edge pixels, then sub-pixel refinement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage
from rigtwin.measure.robust import mad_std

STEP = math.radians(0.1)  # angular resolution of the Hough transform
# turns of the sub-pixel refinement: of the lines in 60 pictures of tilts by VTK (make bench-unseen) 94 % settle in 9
MOST_TURNS = 10
REACH = np.arange(-5.0, 6.0)  # [px], rows that are read around a line
# [px], by which the ends of a line move from the peak of the Hough transform: without a limit 119 pictures of tilts
# have the same horizontals in 2.6 times the time; with 4 px five of them have none
FARTHEST = 10.0
LEAST_SHARE = (
    0.25  # of a shift: a smaller one is taken to be this, so that no step exceeds four offsets of the centroid
)
SETTLED = 0.02  # [px], by which a line moves at most when its refinement ends
# parts of a line whose mean residuals show whether it is one edge: of the horizontals in 119 pictures of tilts by VTK 2
# are off unnoticed with 4 parts, 3 with 8, 9 with none
PARTS = 4
SPARSE = 0.1  # share of the strongest part's weight below which a part is left out; assumed
UNMOVED = 1e-3  # in the unit of the fitted values, by which a robust line moves at most when its fit ends


@dataclass(frozen=True)
class Line:
    """A straight edge from left to right."""

    start: tuple[float, float]  # [px]
    end: tuple[float, float]  # [px]
    sigma: float  # [rad], standard uncertainty of the slope
    strength: float  # [grey/px], median gradient

    @property
    def middle(self) -> tuple[float, float]:
        return (self.start[0] + self.end[0]) / 2, (self.start[1] + self.end[1]) / 2

    @property
    def length(self) -> float:
        return math.dist(self.start, self.end)

    @property
    def slope(self) -> float:
        """[rad], positive if the line falls to the right."""
        return math.atan2(self.end[1] - self.start[1], self.end[0] - self.start[0])


def gradient(picture: FloatImage, blur: float = 1.2) -> tuple[FloatImage, FloatImage]:
    """Gradient [grey/px] to the right and downwards of the picture smoothed by a Gaussian of sigma `blur` [px]."""
    smooth = cv2.GaussianBlur(picture, (0, 0), blur)
    return (
        np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8), dtype=np.float32),
        np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8), dtype=np.float32),
    )


def long_lines(
    picture: FloatImage, usable: npt.NDArray[np.bool_], *, steepest: float, shortest: float, most: int
) -> list[Line]:
    """At most `most` edges with |slope| below `steepest` [rad] and length above `shortest` [px], best first.

    `usable` marks the pixels to search.
    """
    slope_x, slope_y = gradient(picture)
    strength = np.hypot(slope_x, slope_y)
    noise = max(3.0 * float(np.median(strength)), 0.4)
    known = (strength > noise) & usable & (np.abs(slope_x) < math.tan(steepest + 0.12) * np.abs(slope_y))
    known[:3] = known[-3:] = False
    found: list[Line] = []
    for sign in (1, -1):
        y, x = np.nonzero(known & (sign * slope_y > 0))
        found += _lines_of(x, y, np.minimum(strength[y, x], 4 * noise), sign * slope_y, steepest, shortest, most)
    found.sort(key=lambda line: -line.length * min(line.strength, 10.0))
    return found[:most]


def _lines_of(
    x: npt.NDArray[np.int64],
    y: npt.NDArray[np.int64],
    weight: FloatImage,
    change: FloatImage,
    steepest: float,
    shortest: float,
    most: int,
) -> list[Line]:
    """Lines with one sign of the gradient, from the highest peaks of the Hough transform."""
    height, width = change.shape
    angles = np.arange(-steepest, steepest + STEP / 2, STEP)
    rows = 3 * height
    table = np.zeros((len(angles), rows), dtype=np.float32)
    for k, angle in enumerate(angles):
        # the row at which the line crosses the picture's centre column
        row = np.rint(y - (x - width / 2) * math.tan(angle)).astype(np.int64) + height
        table[k] = np.bincount(np.clip(row, 0, rows - 1), weights=weight, minlength=rows)
    table = cv2.blur(table, (3, 1)) * 3
    found: list[Line] = []
    for _ in range(2 * most):
        k, row = divmod(int(np.argmax(table)), rows)
        if table[k, row] < 0.3 * shortest * float(np.median(weight)) or len(found) == most:
            break
        line = _laid(change, float(angles[k]), float(row) - height, shortest)
        if line is not None and not any(abs(line.middle[1] - other.middle[1]) < 3 for other in found):
            found.append(line)
        # clear the surroundings of the peak, so that the same pixels give no second line
        table[max(k - 20, 0) : k + 21, max(row - 5, 0) : row + 6] = 0.0
    return found


def _laid(change: FloatImage, angle: float, row: float, shortest: float) -> Line | None:
    """Sub-pixel line near a peak of the Hough transform; None if it is too short or too ragged."""
    width = change.shape[1]
    every = np.arange(4.0, width - 4.0)
    offset, slope = row, math.tan(angle)
    moved = math.inf
    for within in (4,) * MOST_TURNS + (3, 2):
        if within == 4 and moved < SETTLED:
            continue
        step = 4 if within == 4 else 1  # [px], between the columns that are read on the way
        x = every[::step]
        y = offset + (x - width / 2) * slope
        columns = np.broadcast_to(x, (len(REACH), len(x))).astype(np.float32)
        band = cv2.remap(
            change, columns, (y[None, :] + REACH[:, None]).astype(np.float32), cv2.INTER_LINEAR, borderValue=0.0
        )
        near = np.abs(REACH) <= within
        weight = np.maximum(band, 0).astype(np.float64) ** 2
        power = weight[near].sum(axis=0)
        top = math.sqrt(float(np.percentile(power, 90))) + 1e-9
        seen = power > max(0.04 * top * top, 1e-6)
        run = fullest_run(seen, gap=max(10, width // 20) // step)
        if run is None or x[run[1]] - x[run[0]] < shortest - step:
            return None
        inside = np.flatnonzero(seen)
        inside = inside[(inside >= run[0]) & (inside <= run[1])]
        centre = (weight[near] * REACH[near][:, None]).sum(axis=0)[inside] / power[inside]
        centre /= _share_seen(weight[:, inside].sum(axis=1), near)
        (constant, lean), sigma, kept = straight(x[inside] - width / 2, centre, np.minimum(power[inside], top * top))
        if kept < 0.55 or len(inside) < 0.5 * (run[1] - run[0]):
            return None
        offset, slope = offset + constant, slope + lean
        moved = abs(constant) + abs(lean) * width / 2
        span = x[[run[0], run[1]]]
        if np.abs(offset - row + (slope - math.tan(angle)) * (span - width / 2)).max() > FARTHEST:
            return None  # it moves on to another edge
    ends = [(float(end), offset + (float(end) - width / 2) * slope) for end in span]
    return Line(ends[0], ends[1], sigma, float(np.median(np.sqrt(power[inside]))))


def _share_seen(profile: Array, near: npt.NDArray[np.bool_]) -> float:
    """Share of a small shift of an edge by which the centroid of the rows `near` it moves.

    `profile` p is the squared gradient summed along the edge, at the rows r of `REACH`; the share is
    -sum((r - c) p') / sum(p) with their centroid c.  Out of focus an edge is wider than the rows, whose centroid then
    stays near their middle.
    """
    within, change = profile[near], np.gradient(profile)[near]
    middle = float(REACH[near] @ within) / float(within.sum())
    return max(-float((REACH[near] - middle) @ change) / float(within.sum()), LEAST_SHARE)


def straight(x: Array, y: Array, weight: Array) -> tuple[tuple[float, float], float, float]:
    """Robust line fit: (offset, slope), standard uncertainty of the slope, share of inliers.

    `x`, `y` and `weight` have shape (n,).
    """
    usual = np.ones_like(y)
    offset, slope, miss, scale = math.inf, 0.0, np.abs(y), 1.0
    farthest = float(np.abs(x).max(initial=0.0))
    for _ in range(12):
        w = weight * usual
        total = w.sum() + 1e-12
        mean_x, mean_y = (w @ x) / total, (w @ y) / total
        before = offset, slope
        slope = float((w @ ((x - mean_x) * (y - mean_y))) / (w @ (x - mean_x) ** 2 + 1e-12))
        offset = float(mean_y - slope * mean_x)
        miss = np.abs(y - offset - slope * x)
        scale = max(mad_std(miss, centre=0.0), 0.05)
        usual = 1 / (1 + (miss / (2.5 * scale)) ** 2) ** 2
        if abs(offset - before[0]) + abs(slope - before[1]) * farthest < UNMOVED:
            break
    w = weight * usual
    # residuals of neighbouring columns are correlated (texture, compression): ten columns count as one independent one
    sigma = scale * math.sqrt(10 * float(w @ (w * (x - w @ x / w.sum()) ** 2))) / float(w @ (x - w @ x / w.sum()) ** 2)
    return (offset, slope), max(sigma, _bent(x, y - offset - slope * x, weight)), float(np.mean(miss < 3 * scale))


def _bent(x: Array, miss: Array, weight: Array) -> float:
    """Standard uncertainty of a slope from the mean residuals of the parts of a line, all shape (n,).

    It is that of a weighted fit to the means, with n / (n - 2) for the two fitted values and weights of at most their
    median.  Where a part follows another edge nearby, the foot of a post or the far edge of a plate, its mean is off
    the line by more than the scatter from column to column explains; so what the fit rejected counts here, too.
    """
    part = np.digitize(x, np.linspace(x.min(), x.max(), PARTS + 1)[1:-1])
    total = np.bincount(part, weight, PARTS)
    seen = total > SPARSE * total.max()
    if np.count_nonzero(seen) < 3:
        return 0.0
    total, off, place = (np.bincount(part, weight * each, PARTS)[seen] for each in (np.ones_like(x), miss, x))
    off, place = off / total, place / total
    total = np.minimum(total, np.median(total))
    lever = total * (place - total @ place / total.sum())
    free = len(total) / (len(total) - 2)
    return math.sqrt(free * float(lever**2 @ off**2)) / float(lever @ place)


def fullest_run(kept: npt.NDArray[np.bool_], gap: int) -> tuple[int, int] | None:
    """First and last index of the run with the most marked entries; gaps up to `gap` are bridged.

    Not the widest run: a row of scattered specks may be wider, but an edge or a heap has more marked entries.
    """
    places = np.flatnonzero(kept)
    if len(places) == 0:
        return None
    best = max(np.split(places, np.flatnonzero(np.diff(places) > gap) + 1), key=len)
    return int(best[0]), int(best[-1])


def at(picture: npt.NDArray[Any], points: Array) -> npt.NDArray[Any]:
    """Values of the pixels nearest to points (x, y), shape (n, 2); points outside are moved to the border."""
    x, y = (np.clip(np.rint(points[:, k]).astype(np.int64), 0, picture.shape[1 - k] - 1) for k in (0, 1))
    return np.asarray(picture[y, x])
