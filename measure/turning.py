"""Frames that a film of a steadily turning plate lacks without its times saying so: there the plate turns too far."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

AROUND = 7  # frames before and after, from which a frame's usual turn is taken
SURE = 6.0  # times the noise of a turn, by which one that is missing has to stand out
WHOLE = 0.3  # of a turn, by which what is missing may be off a whole number of them
MOST_AT_ONCE = 10  # frames
MOST = 0.2  # of all frames: beyond that the plate jerks by itself


def missing_frames(times: Array, angle: Array) -> npt.NDArray[np.int64]:
    """How many frames are missing before each of a film's frames; shape (n,).

    `times` [s] are the frames' own, `angle` the plate's in any unit, NaN where it is not seen.  A plate that does not
    turn steadily, or hardly turns from frame to frame, tells none.
    """
    missing = np.zeros(len(times), dtype=np.int64)
    seen = np.flatnonzero(np.isfinite(angle))
    seen = seen[1:][np.diff(seen) == 1]  # whose frame before is seen too
    steps = np.diff(times)[seen - 1]
    even = seen[np.abs(steps - np.median(steps)) < 0.1 * np.median(steps)] if len(seen) else seen
    if len(even) < 4 * AROUND:
        return missing
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
        return missing
    missing[even[found]] = whole[found].astype(np.int64)
    return missing
