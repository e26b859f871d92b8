"""The light on a bead changes little from frame to frame: what the frames around say of it steadies the centre in each.

A fit of one frame cannot well tell a bead that is brighter on its left from one that lies further left, and the smaller
the bead the less.  Of a clip it is known how steady the light is, and what it is about any frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigtwin.measure.bead import BeadFit, BeadImage

Array = npt.NDArray[np.float64]

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
    seen = np.array([fit.shading.slopes for fit in fits]).reshape(-1, 2)
    doubt = np.array([np.diag(fit.shading.covariance)[2:] for fit in fits]).reshape(-1, 2)
    around = [_others(k, frames) for k in range(len(frames))]
    told = [k for k, others in enumerate(around) if len(others) >= FEWEST]
    images = [fit.image for fit in fits]
    if not told:
        return images
    usual = np.array([np.median(seen[around[k]], axis=0) for k in told])
    # a median of normal numbers is less certain than their mean by pi/2
    unsure = np.array([math.pi / 2 * np.median(doubt[around[k]], axis=0) / len(around[k]) for k in told])
    off, expected = (seen[told] - usual) ** 2, doubt[told] + unsure
    restless = np.mean(np.minimum(off / expected, MOST), axis=0) / OF_NOISE - 1
    spread = unsure + np.maximum(restless, 0) * np.median(expected, axis=0)
    spread = np.where(off > JUMP**2 * (doubt[told] + spread), np.maximum(spread, off), spread)
    for k, *known in zip(told, usual, np.sqrt(spread), strict=True):
        images[k] = fits[k].with_slopes(*known)
    return images


def _others(k: int, frames: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """The sightings in the frames around that of sighting `k`, without it."""
    near = np.flatnonzero(np.abs(frames - frames[k]) <= AROUND)
    return np.asarray(near[near != k])
