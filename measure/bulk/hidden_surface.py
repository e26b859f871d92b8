"""Detect occlusions of the surface of a bed behind glass: glare, or an object in front of it.

Signs of an occlusion: a saturated area larger than a highlight; an outline without beads near it; an abrupt change of
the background above the outline where the outline leaves its usual height or no beads follow below it.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image, Mask
from rigtwin.measure.bulk.beads import Beads
from rigtwin.measure.bulk.outline import Silhouette
from rigtwin.measure.geometry.lines import at
from rigtwin.measure.robust import mad_std

SATURATED = 252  # [grey levels], smallest level of a saturated pixel
NO_BEAD = 3.0  # [bead radii]; within this distance of a packing's surface lie four beads, at least one is detected
ABOVE = (0.6, 2.6)  # [bead radii] above the outline: outside its blur, but still next to it
ABRUPT = 4.0  # times the usual scatter of the background's colour along the surface
FAINTEST = 14.0  # [grey levels], smaller changes of colour are shadows and reflections of the beads
BELOW = (0.7, 4.0)  # [bead radii] below the outline: objects behind the cylinder end at the outline
USUAL_LEVEL = 2.0  # [bead radii], largest deviation from the median height without an occlusion
FEWEST_KEPT = 0.3  # minimum share of the outline for an estimate of the usual background


def glare_in(image: Image) -> Mask:
    """Saturated pixels of a BGR photo, shape (height, width)."""
    return np.asarray(image.min(axis=2) >= SATURATED)


def covered_columns(
    found: Silhouette, image: Image, beads: Beads, alike: npt.NDArray[np.float32], glare: Mask, inside: Mask
) -> Mask:
    """Columns of the outline in which the surface is occluded, shape (n,); `inside` marks those between the walls.

    `alike` is the likeness of every pixel to beads.
    """
    seen = inside & np.isfinite(found.height)
    covered = np.zeros(len(found.x), dtype=bool)
    if not seen.any():
        return covered
    points = found.view.to_picture(found.x, np.nan_to_num(found.height))
    covered |= under_glare(points, glare, found.bead_radius)
    covered |= _far_from_beads(points, beads)
    covered |= _odd_background(found, image, seen & ~covered) & ~_goes_on_below(found, alike, seen & ~covered)
    return np.asarray(covered & seen)


def under_glare(points: Array, glare: Mask, radius: float) -> Mask:
    """Points, shape (n, 2) [px], near patches of glare that are larger than the highlight on a bead."""
    size = max(3, round(0.8 * radius) | 1)
    patch = cv2.morphologyEx(glare.astype(np.uint8), cv2.MORPH_OPEN, np.ones((size, size), np.uint8))
    if not patch.any():
        return np.zeros(len(points), dtype=bool)
    reach = 2 * math.ceil(1.5 * radius) + 1
    patch = cv2.dilate(patch, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach)))
    return np.asarray(at(patch, points) > 0)


def _far_from_beads(points: Array, beads: Beads) -> Mask:
    from scipy.spatial import cKDTree

    away, _ = cKDTree(beads.centre).query(points)
    return np.asarray(away > NO_BEAD * beads.radius)


def _goes_on_below(found: Silhouette, alike: npt.NDArray[np.float32], seen: Mask) -> Mask:
    """Columns with the outline at its usual height and beads below it: the object above is behind the bed."""
    steps = np.arange(BELOW[0], BELOW[1], 0.25) * found.bead_radius
    below = [at(alike, found.view.to_picture(found.x, np.nan_to_num(found.height) - step)) for step in steps]
    usual = float(np.median(found.height[seen])) if seen.any() else 0.0
    level = np.abs(np.nan_to_num(found.height) - usual) < USUAL_LEVEL * found.bead_radius
    return np.asarray(level & (np.mean(below, axis=0) > 0.5))


def _odd_background(found: Silhouette, image: Image, seen: Mask) -> Mask:
    """Columns in which the colour just above the outline deviates from its linear trend across the cylinder."""
    odd = np.zeros(len(found.x), dtype=bool)
    if not seen.any():
        return odd
    steps = np.arange(ABOVE[0], ABOVE[1], 0.25) * found.bead_radius
    rows = [found.view.to_picture(found.x, np.nan_to_num(found.height) + step).astype(np.float32) for step in steps]
    lab = cv2.cvtColor(image, cv2.COLOR_BGR2LAB)
    colours = np.stack([cv2.remap(lab, row[:, :1], row[:, 1:], cv2.INTER_LINEAR)[:, 0] for row in rows])
    above = np.median(colours.astype(np.float64), axis=0)
    x = found.x / max(float(np.abs(found.x[seen]).max(initial=1.0)), 1.0)
    off = np.zeros(len(x))
    for channel in above.T:
        # robust: start from the median, then a line, because light from one side gives a linear trend
        miss, kept, spread = np.abs(channel - np.median(channel[seen])), seen, 0.0
        for _ in range(6):
            spread = max(mad_std(miss[kept], centre=0.0), FAINTEST / ABRUPT)
            kept = seen & (miss < 2.5 * spread)
            if kept.sum() < FEWEST_KEPT * seen.sum():
                return odd
            miss = np.abs(channel - np.polyval(np.polyfit(x[kept], channel[kept], 1), x))
        off = np.maximum(off, miss / (ABRUPT * spread))
    odd |= off > 1
    # narrower than a bead radius: a scratch on the glass
    size = max(3, round(found.bead_radius) | 1)
    kernel = np.ones((1, size), np.uint8)
    opened = cv2.morphologyEx((odd & seen).astype(np.uint8)[None], cv2.MORPH_OPEN, kernel)
    return np.asarray(cv2.dilate(opened, kernel)[0] > 0)
