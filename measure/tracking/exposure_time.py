"""Exposure time from the motion blur of a fast bead.

One exposure time holds for the whole clip. The frames with fast, uniform motion are fitted with streaks of several
lengths. The length with the smallest misfit, divided by the displacement between frames, is the exposure time as a
share of the frame interval.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.measure.robust import MAD_TO_STD
from rigtwin.measure.tracking.link import SpotPath

LEAST_SHARE = 0.02  # smallest share of the frame interval; 0 would mean unknown
TRIED = np.array([LEAST_SHARE, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0])  # shares of the frame interval in the first search
ROUGHLY = 0.04  # of the frame interval, standard uncertainty of this coarse search
CLOSER = np.array([-0.16, -0.08, 0.0, 0.08, 0.16])  # offsets in the second search, around the result of the first
STILL = 0.01  # [px], streak of a bead at rest; 0 would mean unknown
LEAST_WAY = 2.0  # [px/frame], minimum displacement for a visible streak
EVEN = 0.35  # largest relative change of the displacement between frames; at a bounce it is larger
MOST_STREAKS = 10  # number of frames used, those with the longest displacement
STREAK_UNCERTAINTY = 0.5  # [px], standard uncertainty of a streak's length, as shading and gloss differ from the model


@dataclass(frozen=True)
class Shutter:
    """Exposure time as a share of the frame interval, with its standard uncertainty; infinite: unknown.

    If it is unknown, the streak is a free parameter in every frame.
    """

    share: float = 0.0
    uncertainty: float = math.inf  # standard uncertainty of `share`

    @property
    def measured(self) -> bool:
        """Whether the exposure time is known, i.e. something moved fast enough."""
        return math.isfinite(self.uncertainty)

    def streak(self, way: tuple[float, float]) -> tuple[float, float]:
        """Streak [px] of a bead with this displacement per frame [px]; (0, 0) if unknown."""
        if not self.measured:
            return 0.0, 0.0
        x, y = self.share * way[0], self.share * way[1]
        return (x, y) if x or y else (STILL, STILL)

    def streak_uncertainty(self, way: tuple[float, float]) -> float:
        """Standard uncertainty of the streak's length [px]."""
        return self.uncertainty * math.hypot(*way) if self.measured else 0.0


NOT_MEASURED = Shutter()


def fast_frames(path: SpotPath) -> dict[int, float]:
    """Frames with the fastest uniform motion: frame index and displacement per frame [px]."""
    frames, centres = np.array(path.frames), path.centres
    ahead, behind = centres[2:] - centres[1:-1], centres[1:-1] - centres[:-2]
    way = np.hypot(*((ahead + behind) / 2).T)
    even = (np.hypot(*(ahead - behind).T) < EVEN * way) & (frames[2:] - frames[:-2] == 2) & (way > LEAST_WAY)
    fastest = [k for k in np.argsort(-way).tolist() if even[k]][:MOST_STREAKS]
    return {int(frames[k + 1]): float(way[k]) for k in fastest}


def shutter_of(tried: Array, misfits: Array, ways: Array) -> Shutter:
    """Exposure time from the misfits, shape (tried, frames), of streaks with the shares `tried`.

    `ways` is the displacement in every frame [px]. The result is the median over the frames, weighted by the curvature
    of the misfit at its minimum. Frames without a bead have a small curvature, and the median is robust against a few
    outliers.
    """
    known = np.all(np.isfinite(misfits), axis=0)
    if np.count_nonzero(known) < 3:
        return NOT_MEASURED
    shares, sharpness = np.array([_liked_best(tried, column) for column in misfits[:, known].T]).T
    ways = ways[known]
    if np.sum(sharpness) <= 0:
        return NOT_MEASURED
    share = _weighted_median(shares, sharpness)
    scatter = MAD_TO_STD * _weighted_median(np.abs(shares - share), sharpness)
    count = float(np.sum(sharpness) ** 2 / np.sum(sharpness**2))
    return Shutter(share, math.hypot(scatter / math.sqrt(count), STREAK_UNCERTAINTY / float(np.max(ways))))


def _liked_best(tried: Array, misfit: Array) -> tuple[float, float]:
    """The share with the smallest misfit, and the relative curvature of the misfit there."""
    relative = misfit / max(float(misfit.min()), 1e-6)
    best = int(np.clip(np.argmin(misfit), 1, len(tried) - 2))
    near = np.s_[best - 1 : best + 2]
    bend, slope, _ = np.polyfit(tried[near], relative[near], 2)
    if bend <= 0:
        return float(tried[np.argmin(misfit)]), 0.0
    return float(np.clip(-slope / (2 * bend), LEAST_SHARE, 1.0)), float(bend)


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    heap = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(heap, heap[-1] / 2)])
