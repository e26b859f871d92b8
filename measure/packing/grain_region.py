"""Region of a photo that is filled with grains, and where it ends on each side."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, FloatImage, Image, Marked, Mask
from rigtwin.measure.bulk.grain_classes import Grain
from rigtwin.measure.geometry.disc_morphology import closed, disc, odd, opened

ENDS_AT = 0.5  # probability of grains at which they end
NEAR = 3.0  # [bead radii], distance from the region within which grains belong to it
ROD = 6.0  # [bead radii], height of a gap that does not divide a bed
CORE = (0.15, 0.85)  # shares of the region's height between which both sides are grains


def grain_region(classes: FloatImage, radius: float) -> tuple[Mask, FloatImage]:
    """The largest region of grains, without parts narrower than five radii, and the classes with these grains alone.

    `classes` are the probabilities by `grain_classes`, shape (height, width, 4), `radius` is that of a bead [px].
    """
    grains = (classes[..., Grain.GRAINS] > ENDS_AT).astype(np.uint8)
    region = _largest(opened(_joined(closed(grains, odd(2 * radius)), radius), odd(5 * radius)))
    near = cv2.dilate(region, disc(odd(2 * NEAR * radius))) > 0
    kept = classes.copy()
    kept[..., Grain.GRAINS][~near] = 0.0
    return region > 0, kept


@dataclass(frozen=True)
class Straight:
    """Grains and their region, turned about the region's middle so that the cylinder is upright."""

    grains: Mask
    region: Mask
    centre: tuple[float, float]  # [px], the middle, which is where it was in the photo
    lean: float  # [rad], by which they were turned


def straightened(likely: FloatImage, region: Mask, lean: float, radius: float) -> Straight:
    """Turn the grains by the `lean` [rad] of the cylinder's axis, positive where its foot is further right.

    `likely` is the probability of grains in every pixel, shape (height, width).
    """
    rows, columns = np.nonzero(region)
    centre = (float(np.median(columns)), float(np.median(rows)))
    turn = cv2.getRotationMatrix2D(centre, -math.degrees(lean), 1.0)
    size = (region.shape[1], region.shape[0])
    turned = cv2.warpAffine(likely, turn, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    kept = cv2.warpAffine(region.astype(np.uint8), turn, size, flags=cv2.INTER_NEAREST)
    grains = _joined(closed((turned > ENDS_AT).astype(np.uint8), odd(1.5 * radius)), radius)
    return Straight(grains > 0, kept > 0, centre, lean)


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


def upright_borders(image: Image, straight: Straight, lean: float) -> Array:
    """Change of colour [Lab levels per 2 px] at every column of the turned picture, median of the core's rows, (n,).

    `lean` [rad] is that of the borders, which converge in perspective.  A straight wall has the same change in all
    rows, the edges of grains are scattered.
    """
    turn = cv2.getRotationMatrix2D(straight.centre, -math.degrees(lean), 1.0)
    size = (image.shape[1], image.shape[0])
    turned = cv2.warpAffine(image, turn, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rows = np.nonzero(straight.region)[0]
    top, foot = (round(float(end)) for end in np.quantile(rows, CORE))
    lab = cv2.cvtColor(turned[top : foot + 1], cv2.COLOR_BGR2LAB).astype(np.float32)
    smooth = cv2.GaussianBlur(lab, (0, 0), sigmaX=1.2, sigmaY=2.0)
    change = np.zeros(smooth.shape[1:])
    change[1:-1] = np.median(smooth[:, 2:] - smooth[:, :-2], axis=0)
    return np.asarray(np.linalg.norm(change, axis=1), dtype=np.float64)


def _run(lines: Mask) -> Array:
    """Number of pixels before the first gap of each line; lines have the shape (n, pixels)."""
    ended = np.concatenate([~lines, np.ones((len(lines), 1), dtype=bool)], axis=1)
    return np.asarray(np.argmax(ended, axis=1), dtype=np.float64)


def _joined(mask: Marked, radius: float) -> Marked:
    """The mask without gaps between grains above and below: a rod in front of the bed does not divide it."""
    upright = np.ones((round(ROD * radius) | 1, 1), np.uint8)
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, upright), dtype=np.uint8)


def _largest(mask: Marked) -> Marked:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    return (labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))).astype(np.uint8) if count > 1 else mask
