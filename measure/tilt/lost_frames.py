"""Detect lost or doubled frames that the time stamps of a tilt film do not show.

At a lost frame a steadily rising plate turns too far.  Its turn per frame is often within the noise; the body that
runs down moves far enough once it is fast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from rigtwin.lab.arrays import Array
from rigtwin.measure.robust import mad_std

AROUND = 7  # [frames], half width of the running median of the turn per frame
FEW_AROUND = 4  # [frames], the same for the run of the body, which is shorter
SURE = 6.0  # minimum turn per frame over its noise
WHOLE = 0.3  # largest deviation of the excess turn from a whole number of turns per frame
MOST_AT_ONCE = 10  # largest number of frames missing in one place
MOST = 0.2  # share of frames with losses beyond which the plate itself moves in jerks
FAST = 8.0  # minimum step of the body over its noise for which a missing or repeated step is clear
JERKY = 0.15  # median relative deviation of the steps beyond which the body itself moves in jerks


@dataclass(frozen=True)
class Gaps:
    """Missing and repeated frames of a film, and where they would be detected."""

    missing: npt.NDArray[np.int64]  # frames missing before each frame, shape (n,); -1: it repeats the one before
    shown: npt.NDArray[np.bool_]  # whether a missing frame would be detected there, shape (n,)


def gaps_by_turn(times: Array, angle: Array) -> Gaps:
    """Number of frames missing before each frame, from the turn of the plate.

    `times` [s] are the time stamps, `angle` that of the plate in any unit, NaN where it is not seen, both of shape
    (n,).  Nothing is detected if the plate does not turn steadily, or turns too little per frame.
    """
    missing, shown = np.zeros(len(times), dtype=np.int64), np.zeros(len(times), dtype=bool)
    seen = np.flatnonzero(np.isfinite(angle))
    seen = seen[1:][np.diff(seen) == 1]  # frames whose predecessor is seen too
    steps = np.diff(times)[seen - 1]
    even = seen[np.abs(steps - np.median(steps)) < 0.1 * np.median(steps)] if len(seen) else seen
    if len(even) < 4 * AROUND:
        return Gaps(missing, shown)
    turns = angle[even] - angle[even - 1]
    wide = np.lib.stride_tricks.sliding_window_view(np.pad(turns, AROUND, mode="edge"), 2 * AROUND + 1)
    usual = np.median(wide, axis=1)
    noise = mad_std(turns - usual, centre=0.0)
    clear = np.abs(usual) > SURE * noise
    too_far = np.where(clear, (turns - usual) / np.where(clear, usual, 1.0), 0.0)
    # at a doubled frame the turn is zero and then twice the usual one
    together = np.convolve(np.pad(too_far, 1, mode="edge"), np.ones(3), mode="valid")
    extra = np.minimum(too_far, together)
    whole = np.rint(extra)
    found = (whole >= 1) & (np.abs(extra - whole) < WHOLE) & (whole <= MOST_AT_ONCE)
    # a loss is isolated; a plate that is knocked, or sticks and slips, turns too far several times in a row
    others = np.convolve(np.pad(found, 2).astype(int), np.ones(5, dtype=int), mode="valid") - found
    found &= others == 0
    if np.mean(found) > MOST:
        return Gaps(missing, shown)
    shown[even[clear]] = True
    missing[even[found]] = whole[found].astype(np.int64)
    return Gaps(missing, shown)


def gaps_by_run(times: Array, way: Array, sigma: Array) -> Gaps:
    """The same from the run of a body with steady acceleration.

    `way` is the displacement from its rest position and `sigma` its noise, in the same unit, shape (n,).  A doubled
    frame that replaces a lost one does not shift later frames: neither is reported.
    """
    missing, shown = np.zeros(len(times), dtype=np.int64), np.zeros(len(times), dtype=bool)
    if len(times) < 2 * FEW_AROUND:
        return Gaps(missing, shown)
    # the square root of the displacement is linear in time, nearly so for a body that rolls from rest
    root, lasts = np.sqrt(np.maximum(way, 0.0)), np.diff(times)
    pace = np.diff(root)
    usual = median_filter(pace, 2 * FEW_AROUND + 1, mode="mirror")
    even = np.abs(lasts - np.median(lasts)) < 0.1 * np.median(lasts)
    runs = even & (usual > 0)
    # a codec copies a slow body from frame to frame: its scatter is smaller than its error
    noise = math.sqrt(2) * np.maximum(sigma[1:], np.median(sigma))
    # expected step at the present position, as the median of the steps around includes slower and faster ones
    clear = runs & (usual * (2 * root[:-1] + usual) > FAST * noise)
    extra = np.where(runs, pace / np.where(runs, usual, 1.0) - 1, 0.0)
    if not clear.any() or float(np.median(np.abs(extra[clear]))) > JERKY:
        return Gaps(missing, shown)
    together = np.convolve(np.pad(extra, 1), np.ones(3), mode="valid")
    whole = np.rint(extra)
    # the outermost steps have no neighbour on one side
    clear[[0, -1]] = False
    found = clear & (whole != 0) & (whole >= -1) & (whole <= MOST_AT_ONCE)
    found &= (np.abs(extra - whole) < WHOLE) & (np.rint(together) == whole)
    shown[1:] = clear
    missing[1:][found] = whole[found].astype(np.int64)
    return Gaps(missing, shown)
