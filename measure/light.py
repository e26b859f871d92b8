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
from rigtwin.measure.bead import BeadFit, BeadImage

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
