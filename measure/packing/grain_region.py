"""Region of a photo that is filled with grains: log odds of every pixel, and where the region ends on each side."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, Image
from rigtwin.measure.bulk.beads import Beads, colour_cells, rare, shares

Mask = npt.NDArray[np.bool_]

LEVELS = 40  # steps of roughness, a quarter of an octave each
COLOUR, TEXTURE = 3.0, 2.0  # limits of the log odds; texture has less, because neighbouring pixels share it
ROUNDS = 3  # the region gives the looks of grains, these give the region; it settles in three rounds
# The odds at which the region ends, as a share of the usual odds inside it.  Halfway to even odds: shadows and
# reflections below and beside a bed look a little like grains.
ENDS_AT = 0.5
CORE = (0.15, 0.85)  # shares of the region's height between which both sides are grains


def grain_region(image: Image, grey: Image, beads: Beads) -> tuple[FloatImage, Mask]:
    """Log odds that a pixel belongs to grains, and the largest region of them.

    Parameters
    ----------
    image, grey : array, shape (height, width, 3) and (height, width)
        The photo in colour and in grey.
    beads : Beads
        Circles found in the photo, most of them grains.

    Returns
    -------
    odds : array, shape (height, width)
        Log odds in units of their usual value inside the region, smoothed over a third of a bead radius.
    region : array of bool, shape (height, width)
        The region, without parts narrower than five bead radii.

    Notes
    -----
    Naive Bayes with two features, colour and roughness at the scale of a bead.  Their histograms are learned in the
    photo itself: inside the region, and outside it with equal weight for its neighbourhood and all the rest.
    """
    radius = beads.radius
    cells = colour_cells(image, radius)
    rough = _roughness(grey, radius)
    covered = np.zeros(grey.shape, np.uint8)
    for x, y in np.rint(beads.centre).astype(int):
        cv2.circle(covered, (int(x), int(y)), round(1.1 * radius), 1, -1)
    region = _largest(_opened(_closed(covered, 3 * radius), 6 * radius))
    odds = np.zeros(grey.shape, np.float32)
    for _ in range(ROUNDS):
        inside = cv2.erode(region, _disc(2 * radius)) > 0
        away = cv2.distanceTransform(1 - region, cv2.DIST_L2, 3) / radius
        outside = [away > 1, (away > 1) & (away < 8)]
        if not inside.any() or not outside[1].any():
            break
        odds = _odds(cells, inside, outside, 16 * 43 * 43) + _odds(rough, inside, outside, LEVELS)
        odds = np.asarray(cv2.GaussianBlur(odds, (0, 0), 0.3 * radius), dtype=np.float32)
        odds = odds / max(float(np.median(odds[inside])), 0.1)
        region = _largest(_opened(_closed((odds > ENDS_AT).astype(np.uint8), 2 * radius), 5 * radius))
    return odds, region > 0


@dataclass(frozen=True)
class Straight:
    """Grains and their region, turned about the region's middle so that the cylinder is upright."""

    grains: Mask
    region: Mask
    centre: tuple[float, float]  # [px], the middle, which is where it was in the photo
    lean: float  # [rad], by which they were turned


def straightened(odds: FloatImage, region: Mask, lean: float, radius: float) -> Straight:
    """Turn the grains by the `lean` [rad] of the cylinder's axis, positive where its foot is further right."""
    rows, columns = np.nonzero(region)
    centre = (float(np.median(columns)), float(np.median(rows)))
    turn = cv2.getRotationMatrix2D(centre, -math.degrees(lean), 1.0)
    size = (region.shape[1], region.shape[0])
    turned = cv2.warpAffine(odds, turn, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-1)
    kept = cv2.warpAffine(region.astype(np.uint8), turn, size, flags=cv2.INTER_NEAREST)
    return Straight(_closed((turned > ENDS_AT).astype(np.uint8), 1.5 * radius) > 0, kept > 0, centre, lean)


def sides(straight: Straight, radius: float) -> tuple[Array, Array]:
    """Places [px from the middle] at which the grains end to the left and to the right, by row of the core, (n,) each.

    Whatever looks like grains beyond the first gap does not count, nor does an upright strip at the end that looks like
    grains above the bed, too: a ruler or the wall itself.  `radius` is that of a bead [px].
    """
    column = round(straight.centre[0])
    rows = np.nonzero(straight.region)[0]
    top, foot = (round(float(end)) for end in np.quantile(rows, CORE))
    here = straight.grains[top : foot + 1]
    here = here[here[:, column]]
    # well above the surface, as far up as the core is high
    surface = max(int(rows.min() - 2 * radius), 1)
    goes_on = np.mean(straight.grains[max(surface - (foot - top), 0) : surface], axis=0) > 0.5
    ends = []
    for step in (-1, 1):
        number = np.arange(len(goes_on[column::step]))
        inwards = np.maximum.accumulate(np.where(goes_on[column::step], 0, number))
        ends.append(column + step * (inwards[_run(here[:, column::step]).astype(int) - 1] + 0.5) - straight.centre[0])
    return ends[0], ends[1]


def lower_ends(straight: Straight, walls: tuple[float, float]) -> tuple[Array, Array]:
    """Places across between the walls and down at which the grains end, from the region's middle [px], (n,) each."""
    (x, y), grains = straight.centre, straight.grains
    first, last = max(math.ceil(x + walls[0]), 0), min(math.floor(x + walls[1]), grains.shape[1] - 1)
    columns = np.arange(first, last + 1)
    columns = columns[grains[round(y), columns]]
    return columns - x, round(y) + _run(grains[round(y) :, columns].T) - 0.5 - y


def _run(lines: Mask) -> Array:
    """Number of pixels before the first gap of each line; lines have the shape (n, pixels)."""
    ended = np.concatenate([~lines, np.ones((len(lines), 1), dtype=bool)], axis=1)
    return np.asarray(np.argmax(ended, axis=1), dtype=np.float64)


def _roughness(grey: Image, radius: float) -> npt.NDArray[np.int32]:
    """Steps of the local rms of detail finer than a bead, without single edges, which do not fill a bead's width."""
    fine = grey.astype(np.float32)
    fine -= cv2.GaussianBlur(fine, (0, 0), 0.5 * radius)
    rms = np.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), 0.45 * radius)) + 0.5
    filled = cv2.dilate(cv2.erode(rms, _disc(1.6 * radius)), _disc(radius))
    return np.asarray(np.clip(4 * np.log2(filled) + 4, 0, LEVELS - 1), dtype=np.int32)


def _odds(cells: npt.NDArray[np.int32], inside: Mask, outside: list[Mask], count: int) -> FloatImage:
    if count == LEVELS:

        def share(index: npt.NDArray[np.int32]) -> Array:
            found = np.bincount(index, minlength=count) / max(len(index), 1)
            return np.convolve(found, (0.25, 0.5, 0.25), mode="same")

        little, limit = 2e-3, TEXTURE
    else:
        share, little, limit = shares, 0.0, COLOUR
    here = share(cells[inside])
    there = 0.5 * sum(share(cells[part]) for part in outside)
    little = little or rare(here, cells[inside])
    return np.asarray(np.clip(np.log((here + little) / (there + little)), -limit, limit)[cells], dtype=np.float32)


def _disc(size: float) -> npt.NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (max(3, round(size) | 1),) * 2), dtype=np.uint8)


def _closed(mask: npt.NDArray[np.uint8], size: float) -> npt.NDArray[np.uint8]:
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, _disc(size)), dtype=np.uint8)


def _opened(mask: npt.NDArray[np.uint8], size: float) -> npt.NDArray[np.uint8]:
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, _disc(size)), dtype=np.uint8)


def _largest(mask: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    return (labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))).astype(np.uint8) if count > 1 else mask
