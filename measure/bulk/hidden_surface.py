"""Detect occlusions of the surface of a bed behind glass: glare, or an object in front of it.

The surface is not known where no grains are seen below the outline, and where the outline leaves its straight course by
more than a bead, as before something in front of the bed.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from rigtwin.lab.arrays import FloatImage, Image, Mask
from rigtwin.measure.bulk.outline import Silhouette
from rigtwin.measure.geometry.lines import at, straight

SATURATED = 252  # [grey levels], smallest level of a saturated pixel
BELOW = (0.7, 4.0)  # [bead radii] below the outline: objects behind the cylinder end at the outline
GRAINS = 0.5  # least mean probability of grains there
# least height and largest width of a strip of glare, over those of the picture; chosen on one of 14 photos by a path
# tracer, tested on drawn beds only
STRIP_HEIGHT, STRIP_WIDTH = 0.05, 0.1
STRIP_EDGE = 3  # [px], by which a strip of glare reaches beyond its saturated pixels
USUAL_LEVEL = 2.0  # [bead radii], largest distance of a settled surface from the straight line through it


def glare_in(image: Image) -> Mask:
    """Saturated pixels of a BGR photo, shape (height, width)."""
    return np.asarray(image.min(axis=2) >= SATURATED)


def without_strips(image: Image, glare: Mask) -> Image:
    """The photo with every upright strip of glare replaced by the mirrored pixels on its left and right.

    A lamp's reflection in a cylinder is a narrow strip that ends in the picture; a bright background is wide.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(glare.astype(np.uint8), connectivity=8)
    if count == 1:
        return image
    rows, columns = glare.shape
    left, top, width, height = stats[:, :4].T
    inside = (left > 0) & (top > 0) & (left + width < columns) & (top + height < rows)
    strips = inside & (height > STRIP_HEIGHT * rows) & (width < STRIP_WIDTH * columns) & (height > width)
    strips[0] = False
    strip = cv2.dilate(strips[labels].astype(np.uint8), np.ones((1, 2 * STRIP_EDGE + 1), np.uint8)) > 0
    place = np.arange(columns)
    before = np.maximum.accumulate(np.where(strip, -1, place), axis=1)
    after = np.minimum.accumulate(np.where(strip, columns, place)[:, ::-1], axis=1)[:, ::-1]
    nearer_left = place - before <= after - place
    mirrored = np.clip(np.where(nearer_left, 2 * before + 1 - place, 2 * after - 1 - place), 0, columns - 1)
    replaced = strip & ~np.take_along_axis(strip, mirrored, axis=1)
    return np.take_along_axis(image, np.where(replaced, mirrored, place)[..., None], axis=1)


def covered_columns(found: Silhouette, alike: FloatImage, inside: Mask) -> Mask:
    """Columns of the outline in which the surface is occluded, shape (n,); `inside` marks those between the walls.

    `alike` is the probability of grains in every pixel.
    """
    height = np.nan_to_num(found.height)
    steps = np.arange(*BELOW, 0.25) * found.bead_radius
    below = [at(alike, found.view.to_picture(found.x, height - step)) for step in steps]
    seen = inside & np.isfinite(found.height)
    hidden = (np.mean(below, axis=0) < GRAINS) | _off_level(found, seen)
    return np.asarray(hidden & seen)


def _off_level(found: Silhouette, seen: Mask) -> Mask:
    """Columns in which the outline is off its line, and a bead radius more on each side of them."""
    from scipy.ndimage import binary_dilation

    if not seen.any():
        return seen
    (offset, slope), _, _ = straight(found.x[seen], found.height[seen], np.ones(int(seen.sum())))
    off = seen & (np.abs(found.height - offset - slope * found.x) > USUAL_LEVEL * found.bead_radius)
    return np.asarray(binary_dilation(off, iterations=math.ceil(found.bead_radius)))
