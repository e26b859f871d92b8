"""Detect a heap of roughly equal beads in a picture automatically.

Every edge pixel votes for the centre of the circle it may belong to (Hough transform along the gradient). A centre is
accepted if edges that point at it surround it. Beads of a heap touch: the heap is the largest group of such circles
at most a bead apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.measure.geometry.lines import at

Numbers = npt.NDArray[np.float32]

SPOKES = 24  # number of directions in which a circle's edge is searched

SURROUNDED = 0.5  # minimum share of the spokes that meet an edge; half of a bead in a heap is hidden

WELL_SURROUNDED = 0.7  # the same for beads at the front of a heap, which are not occluded

NEARLY = 0.5  # share of the best score above which a larger radius is preferred

FEWEST_BEADS = 10  # least number of circles of a heap

# [bead radii], largest scatter across the line of a row of marks: two layers of beads have 0.8, marks 0.1 to 0.6
ROW = 0.7

SAMPLED = 300  # minimum rows and columns sampled for the statistics of the gradient

GREY = 6  # [Lab levels], largest range of hues in a picture without colour

MOST_ROWS = 30_000  # rows per call of cv2.remap, which accepts fewer than 32,767


@dataclass(frozen=True)
class Beads:
    """Circles in the picture that form one group."""

    centre: Array  # [px], shape (n, 2), x right, y down
    radius: float  # [px], common to all


@dataclass(frozen=True)
class Edges:
    """Brightness gradient of a picture."""

    x: npt.NDArray[np.float32]  # [grey/px], shape (height, width)
    y: npt.NDArray[np.float32]  # [grey/px], shape (height, width)
    strength: npt.NDArray[np.float32]  # [grey/px], shape (height, width)
    noise: float  # [grey/px], limit above which a gradient counts as an edge
    strong: float  # [grey/px], strength of the clearest edges in this picture

    @cached_property
    def both(self) -> npt.NDArray[np.float32]:
        """[grey/px], gradient along x and y, shape (height, width, 2)."""
        return np.asarray(cv2.merge([self.x, self.y]), dtype=np.float32)

    @cached_property
    def points(self) -> tuple[Numbers, Numbers, Numbers, Numbers]:
        """Edge pixels: column, row, and unit vector of the gradient, each of shape (n,)."""
        row, column = np.nonzero(self.strength > self.noise)
        strength = self.strength[row, column]
        across = (self.x[row, column] / strength, self.y[row, column] / strength)
        return column.astype(np.float32), row.astype(np.float32), *across


def edges(grey: npt.NDArray[np.uint8], blur: float = 1.0) -> Edges:
    """Gradient of the picture smoothed by a Gaussian of sigma `blur` [px]; 1 px suits circles."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), blur)
    x = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8), dtype=np.float32)
    y = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8), dtype=np.float32)
    strength = np.asarray(cv2.magnitude(x, y), dtype=np.float32)
    apart = max(1, min(strength.shape) // SAMPLED)
    usual, strong = (float(level) for level in np.percentile(strength[::apart, ::apart], (50, 90)))
    noise = max(2 * usual, 1.0)
    return Edges(x, y, strength, noise, max(strong, noise))


def find_beads(grey: npt.NDArray[np.uint8], radii: tuple[float, float]) -> Beads | None:
    """The largest group of touching circles with a radius between `radii` [px], None if there is none.

    The score of a radius is how completely edges surround its circles: too large circles through the gaps between
    beads and too small ones inside beads meet edges on a part of their rim only. Shading moves the clearest edge inside
    the rim. Therefore the largest radius with a score close to the best one is taken.
    """
    picture = edges(grey)
    tried: list[tuple[float, Beads]] = []
    for radius in np.geomspace(*radii, num=max(2, round(np.log(radii[1] / radii[0]) / 0.12) + 1)):
        for sign in (1, -1):  # beads brighter, then darker than the gaps between them
            centre = _circles(picture, float(radius), sign)
            group = _largest_group(centre, 3.0 * radius) if len(centre) >= FEWEST_BEADS else centre
            if len(group) < FEWEST_BEADS:
                continue
            surrounded = _surrounded(picture, group, float(radius), sign)
            tried.append((float(np.sum(np.maximum(surrounded - WELL_SURROUNDED, 0)) * radius), Beads(group, radius)))
    if not tried:
        return None
    # graduations of a ruler give a row of good circles; prefer groups with circles above each other
    piled = [(score, beads) for score, beads in tried if not _in_a_row(beads)]
    tried = piled or tried
    best, leader = max(tried, key=lambda one: one[0])
    close = [beads for score, beads in tried if score >= NEARLY * best and beads.radius < 1.5 * leader.radius]
    return max(close, key=lambda beads: beads.radius)


def _in_a_row(beads: Beads) -> bool:
    across = float(np.linalg.eigvalsh(np.cov(beads.centre.T))[0])
    return bool(math.sqrt(max(across, 0.0)) < ROW * beads.radius)


def more_beads(picture: Edges, alike: npt.NDArray[np.float32], beads: Beads, *, least_group: float = 1.0) -> Beads:
    """All circles of the heap, with lower limits because size and colour of the beads are known now.

    `alike` is the likeness of every pixel to beads, shape (height, width). A further group belongs to the beads if its
    size is at least `least_group` times that of the largest one.
    """
    found = [beads.centre]
    for stretch in (0.88, 1.0, 1.14):
        for sign in (1, -1):
            centre = _circles(picture, stretch * beads.radius, sign, surrounded=0.36)
            found.append(centre[at(alike, centre) > 0.6])
    return Beads(_largest_group(np.concatenate(found), 2.4 * beads.radius, least_group), beads.radius)


def rim_radius(grey: npt.NDArray[np.uint8], beads: Beads) -> float:
    """Outer radius [px] of the clearest circles: half maximum of the mean gradient on its outer side."""
    picture = edges(grey)
    stretch = np.arange(0.6, 1.6, 0.04)
    steepest = np.zeros(len(stretch))
    for sign in (1, -1):
        surrounded = _surrounded(picture, beads.centre, beads.radius, sign)
        clear = beads.centre[surrounded >= np.percentile(surrounded, 80)]
        inward, _ = _along_spokes(picture, clear, (stretch * beads.radius).tolist(), sign)
        mean = inward.mean(axis=(0, 2), dtype=np.float64)
        if mean.max() > steepest.max():
            steepest = mean
    top = int(np.argmax(steepest))
    below = np.flatnonzero(steepest[top:] < steepest[top] / 2)
    if len(below) == 0 or below[0] == 0:
        return beads.radius
    k = top + int(below[0])
    part = (steepest[k - 1] - steepest[top] / 2) / (steepest[k - 1] - steepest[k])
    return float(beads.radius * (stretch[k - 1] + part * (stretch[k] - stretch[k - 1])))


def rare(share: Array, index: npt.NDArray[np.int32]) -> float:
    """Smallest histogram share that counts as evidence; one or two false circles among the beads give as much."""
    return 0.1 * float(np.median(share[index])) if index.size else 0.1


def colour_cells(image: npt.NDArray[np.uint8], radius: float) -> npt.NDArray[np.int32]:
    """Index of the Lab colour cell of every pixel, after smoothing over a tenth of a bead radius."""
    return _cells(_smooth_lab(image, radius))


def look_cells(image: npt.NDArray[np.uint8], radius: float) -> npt.NDArray[np.int32]:
    """As `colour_cells`; a picture without hues has finer steps of lightness."""
    lab = _smooth_lab(image, radius)
    # percentiles: a coloured sticker does not make the picture a colour picture
    if max(float(np.ptp(np.percentile(lab[..., hue], (0.5, 99.5)))) for hue in (1, 2)) > GREY:
        return _cells(lab)
    nothing = np.zeros_like(lab[..., 0])
    return _cells(np.dstack([nothing, lab[..., 0], nothing]))


def _smooth_lab(image: npt.NDArray[np.uint8], radius: float) -> npt.NDArray[np.uint8]:
    smooth = cv2.GaussianBlur(image, (0, 0), max(0.1 * radius, 0.8))
    return np.asarray(cv2.cvtColor(smooth, cv2.COLOR_BGR2LAB), dtype=np.uint8)


def _cells(lab: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
    levels = np.arange(256, dtype=np.int32)
    cells = np.take(levels // 16 * 43 * 43, lab[..., 0])
    cells += np.take(levels // 6 * 43, lab[..., 1])
    cells += np.take(levels // 6, lab[..., 2])
    return np.asarray(cells)


def shares(index: npt.NDArray[np.int32]) -> Array:
    """Smoothed histogram of colour cells, sum 1."""
    from scipy.ndimage import gaussian_filter

    count = np.bincount(index, minlength=16 * 43 * 43).reshape(16, 43, 43).astype(np.float64)
    return np.asarray(gaussian_filter(count / max(len(index), 1), 1.0).ravel())


def _circles(picture: Edges, radius: float, sign: int, surrounded: float = SURROUNDED) -> Array:
    """Centres [px], shape (n, 2), of circles of this radius."""
    height, width = picture.strength.shape
    column, row, across_x, across_y = picture.points
    spread = max(0.12 * radius, 0.8)
    # the votes are smoothed over `spread` anyway, so those for a large circle are counted in larger cells
    cell = max(int(spread), 1)
    reach = np.float32(sign * radius)
    # a margin collects the votes outside the picture, which is faster than excluding them
    margin = (int(radius) + 2) // cell + 1
    x, y = (
        ((place + reach * across + np.float32(0.5)) * np.float32(1 / cell) + np.float32(margin)).astype(np.int32)
        for place, across in ((column, across_x), (row, across_y))
    )
    wide, high = (-(-side // cell) for side in (width, height))
    stride = wide + 2 * margin
    votes = np.bincount(y * stride + x, minlength=stride * (high + 2 * margin)).reshape(-1, stride)
    votes = votes[margin : margin + high, margin : margin + wide]
    density = cv2.GaussianBlur(votes.astype(np.float32), (0, 0), spread / cell) * ((spread / cell) ** 2 / radius)
    size = 2 * int(0.8 * radius / cell) + 1
    peaks = (density == cv2.dilate(density, np.ones((size, size), np.uint8))) & (density > 0.3)
    peak_y, peak_x = np.divmod(np.flatnonzero(peaks), peaks.shape[1])  # faster on a flat array
    centre = np.asarray(np.column_stack([peak_x, peak_y]) * cell + (cell - 1) / 2, dtype=np.float64)
    return centre[_surrounded(picture, centre, radius, sign) >= surrounded]


def _along_spokes(picture: Edges, centre: Array, lengths: Sequence[float], sign: int) -> tuple[Numbers, Numbers]:
    """Radial component (towards the centre) and magnitude of the gradient at every length along every spoke.

    Both have shape (n, lengths, SPOKES) and are 0 outside the picture.
    """
    angle = np.arange(SPOKES, dtype=np.float32) * np.float32(2 * np.pi / SPOKES)
    cos, sin = np.cos(angle), np.sin(angle)
    length = np.array(lengths, dtype=np.float32)[:, None]
    at_x, at_y = (
        (centre[:, k].astype(np.float32)[:, None] + (length * away).ravel()) for k, away in enumerate((cos, sin))
    )
    read = [np.zeros((0, at_x.shape[1], 2), np.float32)]
    for part in (slice(first, first + MOST_ROWS) for first in range(0, len(centre), MOST_ROWS)):
        read.append(cv2.remap(picture.both, at_x[part], at_y[part], cv2.INTER_NEAREST, borderValue=0))
    seen = np.concatenate(read).reshape(-1, len(length), SPOKES, 2)
    inward = (seen[..., 0] * cos + seen[..., 1] * sin) * np.float32(-sign)
    return inward, np.hypot(seen[..., 0], seen[..., 1])


def _surrounded(picture: Edges, centre: Array, radius: float, sign: int) -> Array:
    """Share of the spokes that meet an edge pointing at the centre, shape (n,)."""
    lengths = [stretch * radius for stretch in (0.85, 0.93, 1.0, 1.07, 1.15)]
    inward, whole = _along_spokes(picture, centre, lengths, sign)
    met = (whole > picture.noise) & (inward > np.float32(0.8) * whole)
    return np.asarray(met.any(axis=1).mean(axis=1), dtype=np.float64)


def _largest_group(centre: Array, reach: float, least: float = 1.0) -> Array:
    """Circles of the largest connected group, and of groups with more than `least` times its size, shape (m, 2)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if len(centre) < 2:
        return centre
    pairs = cKDTree(centre).query_pairs(reach, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(centre), len(centre)))
    _, label = connected_components(links, directed=False)
    count = np.bincount(label)
    kept = count > least * count.max()
    kept[count.argmax()] = True
    return np.asarray(centre[kept[label]])
