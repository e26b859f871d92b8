"""How long the shutter was open, from the length of the streaks that a fast bead draws.

One exposure holds for the whole clip.  It is told by the frames in which the bead moves fast and evenly: each is fitted
with streaks of several lengths, and the length that its pixels like best, over the way from frame to frame, is the
share of the frame interval that the shutter was open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.measure.tracking.link import SpotPath

LEAST_SHARE = 0.02  # no streak at all would mean that it is unknown
TRIED = np.array([LEAST_SHARE, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0])  # shares of the frame interval, first
ROUGHLY = 0.04  # of the frame interval, that the best by so few of them may be off
CLOSER = np.array([-0.16, -0.08, 0.0, 0.08, 0.16])  # then, about the best of them
STILL = 0.01  # [px], smear of a bead at rest: none at all would mean that it is unknown
LEAST_WAY = 2.0  # [px/frame], of a bead whose streak shows
EVEN = 0.35  # change of the way from one frame to the next, relative; at a bounce it is larger
MOST_STREAKS = 10  # that are looked at, the longest
STREAK_DOUBT = 0.5  # [px], of a streak's length: shading and gloss of a bead are not those of the model


@dataclass(frozen=True)
class Shutter:
    """Share of the frame interval that the shutter was open, with its standard uncertainty; none where it is not told.

    Without it the streak of every frame is as free as its pixels leave it.
    """

    share: float = 0.0
    doubt: float = math.inf

    @property
    def told(self) -> bool:
        """Whether anything moved fast enough to show it."""
        return math.isfinite(self.doubt)

    def streak(self, way: tuple[float, float]) -> tuple[float, float]:
        """Smear of a bead that goes this way from frame to frame, all in pixels; (0, 0) where it is not known."""
        if not self.told:
            return 0.0, 0.0
        x, y = self.share * way[0], self.share * way[1]
        return (x, y) if x or y else (STILL, STILL)

    def streak_doubt(self, way: tuple[float, float]) -> float:
        """Standard uncertainty of its length [px] from that of the shutter."""
        return self.doubt * math.hypot(*way) if self.told else 0.0


NOT_TOLD = Shutter()


def fast_frames(path: SpotPath) -> dict[int, float]:
    """Where the bead is seen to move fastest, evenly from the frame before to the one after: frame and way [px]."""
    frames, centres = np.array(path.frames), path.centres
    ahead, behind = centres[2:] - centres[1:-1], centres[1:-1] - centres[:-2]
    way = np.hypot(*((ahead + behind) / 2).T)
    even = (np.hypot(*(ahead - behind).T) < EVEN * way) & (frames[2:] - frames[:-2] == 2) & (way > LEAST_WAY)
    fastest = [k for k in np.argsort(-way).tolist() if even[k]][:MOST_STREAKS]
    return {int(frames[k + 1]): float(way[k]) for k in fastest}


def shutter_of(tried: Array, misfits: Array, ways: Array) -> Shutter:
    """The shutter from the misfit of every frame with streaks of `tried`, shape (tried, frames), and its way [px].

    A frame counts by how sharply its misfit tells one length from another, which one without a bead does not, and the
    middle frame decides: a few that show something else have no say.
    """
    known = np.all(np.isfinite(misfits), axis=0)
    if np.count_nonzero(known) < 3:
        return NOT_TOLD
    shares, sharpness = np.array([_liked_best(tried, column) for column in misfits[:, known].T]).T
    ways = ways[known]
    if np.sum(sharpness) <= 0:
        return NOT_TOLD
    share = _weighted_median(shares, sharpness)
    scatter = 1.4826 * _weighted_median(np.abs(shares - share), sharpness)
    count = float(np.sum(sharpness) ** 2 / np.sum(sharpness**2))
    return Shutter(share, math.hypot(scatter / math.sqrt(count), STREAK_DOUBT / float(np.max(ways))))


def _liked_best(tried: Array, misfit: Array) -> tuple[float, float]:
    """The share of least misfit, and how sharply the misfit grows beside it, relative to the least."""
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
