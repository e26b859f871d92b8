"""Frames that a film of a plate lacks or shows twice without its times saying so.

Where one is missing a plate that rises steadily turns too far.  Mostly it turns too little for that from frame to
frame, beside its noise; what runs down it does not, once it is fast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from rigtwin.lab.arrays import Array

AROUND = 7  # frames before and after, from which a frame's usual turn is taken
FEW_AROUND = 4  # the same of a run, which is shorter
SURE = 6.0  # times the noise of a turn, by which one that is missing has to stand out
WHOLE = 0.3  # of a turn, by which what is missing may be off a whole number of them
MOST_AT_ONCE = 10  # frames
MOST = 0.2  # of all frames: beyond that the plate jerks by itself
FAST = 8.0  # times the noise of a step, that a body moves by from frame to frame where none and two steps stand out
JERKY = 0.15  # median deviation of its steps from the usual one, beyond which a body stops and goes by itself


@dataclass(frozen=True)
class Gaps:
    """What is missing from a film or too much in it, and where that would be seen."""

    missing: npt.NDArray[np.int64]  # frames before each frame, shape (n,); -1: it repeats the one before
    told: npt.NDArray[np.bool_]  # whether one that is missing there would stand out, shape (n,)


def gaps_by_turn(times: Array, angle: Array) -> Gaps:
    """How many frames are missing before each of a film's frames, by the turn of the plate.

    `times` [s] are the frames' own, `angle` the plate's in any unit, NaN where it is not seen.  A plate that does not
    turn steadily, or hardly turns from frame to frame, tells none.
    """
    missing, told = np.zeros(len(times), dtype=np.int64), np.zeros(len(times), dtype=bool)
    seen = np.flatnonzero(np.isfinite(angle))
    seen = seen[1:][np.diff(seen) == 1]  # whose frame before is seen too
    steps = np.diff(times)[seen - 1]
    even = seen[np.abs(steps - np.median(steps)) < 0.1 * np.median(steps)] if len(seen) else seen
    if len(even) < 4 * AROUND:
        return Gaps(missing, told)
    turns = angle[even] - angle[even - 1]
    wide = np.lib.stride_tricks.sliding_window_view(np.pad(turns, AROUND, mode="edge"), 2 * AROUND + 1)
    usual = np.median(wide, axis=1)
    noise = 1.4826 * float(np.median(np.abs(turns - usual)))
    clear = np.abs(usual) > SURE * noise
    too_far = np.where(clear, (turns - usual) / np.where(clear, usual, 1.0), 0.0)
    # where a frame is shown twice the plate turns by nothing, and then by two
    together = np.convolve(np.pad(too_far, 1, mode="edge"), np.ones(3), mode="valid")
    extra = np.minimum(too_far, together)
    whole = np.rint(extra)
    found = (whole >= 1) & (np.abs(extra - whole) < WHOLE) & (whole <= MOST_AT_ONCE)
    # a loss stands alone; a plate that is knocked, or that sticks and slips, turns too far several times on end
    others = np.convolve(np.pad(found, 2).astype(int), np.ones(5, dtype=int), mode="valid") - found
    found &= others == 0
    if np.mean(found) > MOST:
        return Gaps(missing, told)
    told[even[clear]] = True
    missing[even[found]] = whole[found].astype(np.int64)
    return Gaps(missing, told)


def gaps_by_run(times: Array, way: Array, sigma: Array) -> Gaps:
    """The same by the run of a body that speeds up evenly: `way` from its place at rest, and its noise, in one unit.

    A frame that is shown twice, and a later one left out for it, moves nothing that follows: neither is told.
    """
    missing, told = np.zeros(len(times), dtype=np.int64), np.zeros(len(times), dtype=bool)
    if len(times) < 2 * FEW_AROUND:
        return Gaps(missing, told)
    # the square root of the way grows evenly with the time, and what rolls from rest hardly less so
    root, lasts = np.sqrt(np.maximum(way, 0.0)), np.diff(times)
    pace = np.diff(root)
    usual = median_filter(pace, 2 * FEW_AROUND + 1, mode="mirror")
    even = np.abs(lasts - np.median(lasts)) < 0.1 * np.median(lasts)
    runs = even & (usual > 0)
    # what hardly moves yet a codec copies from frame to frame: it scatters by less than it may be off
    noise = math.sqrt(2) * np.maximum(sigma[1:], np.median(sigma))
    # by the step that is due from where it is: the middle of slow and fast ones around says less of it
    clear = runs & (usual * (2 * root[:-1] + usual) > FAST * noise)
    extra = np.where(runs, pace / np.where(runs, usual, 1.0) - 1, 0.0)
    if not clear.any() or float(np.median(np.abs(extra[clear]))) > JERKY:
        return Gaps(missing, told)
    together = np.convolve(np.pad(extra, 1), np.ones(3), mode="valid")
    whole = np.rint(extra)
    # of the outermost steps it is not known what comes next to them
    clear[[0, -1]] = False
    found = clear & (whole != 0) & (whole >= -1) & (whole <= MOST_AT_ONCE)
    found &= (np.abs(extra - whole) < WHOLE) & (np.rint(together) == whole)
    told[1:] = clear
    missing[1:][found] = whole[found].astype(np.int64)
    return Gaps(missing, told)
