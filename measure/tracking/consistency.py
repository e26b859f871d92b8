"""The light on a bead changes little from frame to frame: what the frames around say of it steadies the centre in each.

A fit of one frame cannot well tell a bead that is brighter on its left from one that lies further left, and the smaller
the bead the less.  Of a clip it is known how steady the light is, and what it is about any frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.measure.tracking.bead_image import BeadFit, BeadImage

AROUND = 10  # frames before and after that tell of the light in one

FEWEST = 5  # frames that tell how steady the light is

JUMP = 3.0  # standard deviations, by which a frame's own light has to be off that of the others to be believed

MOST = 4.0  # variances, that a single frame's light counts as off in telling how steady light is

OF_NOISE = 0.92  # mean of squares of standard normal numbers, none counted as more than this


def in_steady_light(fits: Sequence[BeadFit], frames: npt.NDArray[np.int64]) -> list[BeadImage]:
    """The beads of a clip, each with the light that the frames around it show, as far as light is seen to be steady.

    How far it is not (a bead with a grain that spins, say) is told by the clip itself, and a frame in which the light
    is far from that around (next to a bright plate) keeps its own.
    """
    images = [fit.image for fit in fits]
    others, count = _around(frames)
    told = np.flatnonzero(count >= FEWEST)
    if not len(told):
        return images
    seen = np.array([fit.shading.slopes for fit in fits])
    doubt = np.array([np.diag(fit.shading.covariance)[2:] for fit in fits])
    usual = _medians(seen, others, count)[told]
    # a median of normal numbers is less certain than their mean by pi/2
    unsure = math.pi / 2 * _medians(doubt, others, count)[told] / count[told, None]
    off, expected = (seen[told] - usual) ** 2, doubt[told] + unsure
    restless = np.mean(np.minimum(off / expected, MOST), axis=0) / OF_NOISE - 1
    spread = unsure + np.maximum(restless, 0) * np.median(expected, axis=0)
    spread = np.where(off > JUMP**2 * (doubt[told] + spread), np.maximum(spread, off), spread)
    for k, *known in zip(told.tolist(), usual, np.sqrt(spread), strict=True):
        images[k] = fits[k].with_slopes(*known)
    return images


def _around(frames: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """The sightings in the frames around that of each, without it, shape (n, 2 AROUND), -1 for none; and how many."""
    steps = np.array([step for step in range(-AROUND, AROUND + 1) if step])
    others = np.arange(len(frames))[:, None] + steps
    inside = (others >= 0) & (others < len(frames))
    there = frames[np.where(inside, others, 0)]
    inside &= np.abs(there - frames[:, None]) <= AROUND
    return np.where(inside, others, -1), np.count_nonzero(inside, axis=1)


def _medians(values: Array, others: npt.NDArray[np.intp], count: npt.NDArray[np.intp]) -> Array:
    """Of what the others of each say, shape (n, 2)."""
    ordered = np.sort(np.where(others[..., None] < 0, np.inf, values[others]), axis=1)
    rows = np.arange(len(others))
    return np.asarray((ordered[rows, np.maximum(count - 1, 0) // 2] + ordered[rows, count // 2]) / 2)


CREEPS = 0.25  # [px/frame], up to which a codec may repeat a bead where it was

FEWEST_DIFFERENCES = 12  # of the places of seven frames, from which their scatter is told

SIXTH = (1, -6, 15, -20, 15, -6, 1)  # difference, and its factors

BOUNCES = 5.0  # times the usual difference: of normal numbers one in a thousand is as large

QUICK = 1 / 100  # [s], from frame to frame: over two, 400 px of a swing of 8 rad/s differ by 0.007 px


def scatter(times: Array, frames: npt.NDArray[np.int64], images: Sequence[BeadImage]) -> float:
    """How many times their sigma the places of a moving bead scatter about a smooth way; 1 where that is not told.

    `times` [s].  A codec smears the rim of a bead along with the noise, so that single frames seem surer than they
    are.  Of a flight or a swing sixth differences leave nothing but the scatter, at 25 frames a second too.  A codec
    that predicts a frame from the last keeps its error for a while, which differences over every second frame show
    better; a swing's own sixth difference is 64 times larger there, so that they are taken of quick frames only.
    """
    if len(frames) < FEWEST_DIFFERENCES:
        return 1.0
    places = np.array([(image.x, image.y) for image in images])
    variance = np.array([image.sigma**2 for image in images])
    strides = (1, 2) if float(np.median(np.diff(times))) < QUICK else (1,)
    return max(_scatter_over(stride, frames, places, variance) for stride in strides)


def _scatter_over(stride: int, frames: npt.NDArray[np.int64], places: Array, variance: Array) -> float:
    """As `scatter`, of places that lie `stride` sightings apart."""
    reach = 6 * stride
    if len(frames) <= reach:
        return 1.0
    parts = [np.s_[k * stride : len(frames) - reach + k * stride] for k in range(7)]
    off = sum(factor * places[part] for factor, part in zip(SIXTH, parts, strict=True))
    expected = sum(factor**2 * variance[part] for factor, part in zip(SIXTH, parts, strict=True))
    moves = np.hypot(*(places[reach:] - places[:-reach]).T) > reach * CREEPS
    told = moves & (frames[reach:] - frames[:-reach] == reach)
    if np.count_nonzero(told) < FEWEST_DIFFERENCES:
        return 1.0
    apart = (np.abs(off) / np.sqrt(expected)[:, None])[told]
    # those across a bounce stand out far; what is left tells more together than its median does
    usual = apart[apart < BOUNCES * np.median(apart)]
    return max(float(np.sqrt(np.mean(usual**2))), 1.0) if len(usual) else 1.0
