"""Combine the bead fits of neighbouring frames: common shading, and scatter of the positions about a smooth path.

In a single frame a bead that is brighter on its left is hard to distinguish from one further left, the more so the
smaller it is. The light changes slowly along a path, so the slopes fitted in the neighbouring frames are a prior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.measure.tracking.bead_image import BeadFit, BeadImage

AROUND = 10  # frames before and after that form the prior of the light

FEWEST = 5  # minimum number of neighbouring frames

JUMP = 3.0  # standard deviations; a frame whose light deviates more from the others keeps its own

MOST = 4.0  # limit of a frame's squared normalised deviation in the estimate of the light's variation

OF_NOISE = 0.92  # mean of squared standard normal numbers, each limited to MOST


def in_steady_light(fits: Sequence[BeadFit], frames: npt.NDArray[np.int64]) -> list[BeadImage]:
    """The beads of a clip, each refitted with the light of the neighbouring frames as a prior.

    The width of the prior includes the variation of the light estimated from the clip (e.g. a spinning bead with
    grain). A frame whose light deviates strongly (e.g. next to a bright plate) keeps its own.
    """
    images = [fit.image for fit in fits]
    others, count = _around(frames)
    known = np.flatnonzero(count >= FEWEST)
    if not len(known):
        return images
    seen = np.array([fit.shading.slopes for fit in fits])
    variance = np.array([np.diag(fit.shading.covariance)[2:] for fit in fits])
    usual = _medians(seen, others, count)[known]
    # the variance of a median of normal numbers is pi/2 times that of their mean
    unsure = math.pi / 2 * _medians(variance, others, count)[known] / count[known, None]
    off, expected = (seen[known] - usual) ** 2, variance[known] + unsure
    restless = np.mean(np.minimum(off / expected, MOST), axis=0) / OF_NOISE - 1
    spread = unsure + np.maximum(restless, 0) * np.median(expected, axis=0)
    spread = np.where(off > JUMP**2 * (variance[known] + spread), np.maximum(spread, off), spread)
    for k, *prior in zip(known.tolist(), usual, np.sqrt(spread), strict=True):
        images[k] = fits[k].with_slopes(*prior)
    return images


def _around(frames: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Indices of the sightings around each one, itself excluded, shape (n, 2 AROUND), -1: none; and their number."""
    steps = np.array([step for step in range(-AROUND, AROUND + 1) if step])
    others = np.arange(len(frames))[:, None] + steps
    inside = (others >= 0) & (others < len(frames))
    there = frames[np.where(inside, others, 0)]
    inside &= np.abs(there - frames[:, None]) <= AROUND
    return np.where(inside, others, -1), np.count_nonzero(inside, axis=1)


def _medians(values: Array, others: npt.NDArray[np.intp], count: npt.NDArray[np.intp]) -> Array:
    """Median of `values`, shape (n, 2), over the neighbours `others` of each sighting, shape (n, 2)."""
    ordered = np.sort(np.where(others[..., None] < 0, np.inf, values[others]), axis=1)
    rows = np.arange(len(others))
    return np.asarray((ordered[rows, np.maximum(count - 1, 0) // 2] + ordered[rows, count // 2]) / 2)


CREEPS = 0.25  # [px/frame], minimum speed; a codec may repeat a slower bead unchanged

FEWEST_DIFFERENCES = 12  # minimum number of sixth differences for an estimate of the scatter

SIXTH = (1, -6, 15, -20, 15, -6, 1)  # coefficients of the sixth difference

BOUNCES = 5.0  # outlier limit in medians of the difference; one in a thousand normal numbers exceeds it

# [s], largest frame interval for differences over every second frame: there the sixth difference of a swing with an
# amplitude of 400 px and 8 rad/s is 0.007 px
QUICK = 1 / 100


def scatter(times: Array, frames: npt.NDArray[np.int64], images: Sequence[BeadImage]) -> float:
    """Scatter of a moving bead's positions about a smooth path in units of their sigma, at least 1; 1 if unknown.

    `times` [s], shape (n,). A codec removes noise and blurs the rim of a bead, so that the sigma of a single frame is
    too small. The sixth difference of a flight or swing is negligible even at 25 frames per second, so it measures the
    scatter alone. A codec that predicts a frame from the previous one keeps its error for some frames. Differences over
    every second frame show this better; a swing's own sixth difference is 64 times larger there, so they are used only
    at short frame intervals.
    """
    if len(frames) < FEWEST_DIFFERENCES:
        return 1.0
    places = np.array([(image.x, image.y) for image in images])
    variance = np.array([image.sigma**2 for image in images])
    strides = (1, 2) if float(np.median(np.diff(times))) < QUICK else (1,)
    return max(_scatter_over(stride, frames, places, variance) for stride in strides)


def _scatter_over(stride: int, frames: npt.NDArray[np.int64], places: Array, variance: Array) -> float:
    """As `scatter`, for positions `stride` sightings apart."""
    reach = 6 * stride
    if len(frames) <= reach:
        return 1.0
    parts = [np.s_[k * stride : len(frames) - reach + k * stride] for k in range(7)]
    off = sum(factor * places[part] for factor, part in zip(SIXTH, parts, strict=True))
    expected = sum(factor**2 * variance[part] for factor, part in zip(SIXTH, parts, strict=True))
    moves = np.hypot(*(places[reach:] - places[:-reach]).T) > reach * CREEPS
    usable = moves & (frames[reach:] - frames[:-reach] == reach)
    if np.count_nonzero(usable) < FEWEST_DIFFERENCES:
        return 1.0
    apart = (np.abs(off) / np.sqrt(expected)[:, None])[usable]
    # differences across a bounce are outliers; the rms of the others is more precise than their median
    usual = apart[apart < BOUNCES * np.median(apart)]
    return max(float(np.sqrt(np.mean(usual**2))), 1.0) if len(usual) else 1.0
