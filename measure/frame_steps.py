"""Whether the frames of a film follow each other as its times say, above all where the file does not say so itself."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rigtwin.lab.quantity import Check

UNSTEADY = 0.5  # share of odd frame intervals, from which on a file's own times are not believed
TWO_STEPS = 1.7  # times the usual step: nearer to two frames than to one, with what is uneven in a flow of beads
FEWEST = 15  # frames of the flow, to know what is usual
JERKY = 0.4  # median deviation from the usual step, beyond which a flow stops and goes and two steps are nothing odd


def timing_check(rates: npt.NDArray[np.float64]) -> Check | str:
    """Whether frames are missing, or in words why that cannot be judged.

    `rates`: how fast the bed falls from each frame to the next, by the frames' own times, in any unit, shape (n,).

    Where a frame was lost before the film was written anew, the bed falls twice as far in what counts as one.
    """
    usual = float(np.median(rates)) if len(rates) >= FEWEST else 0.0
    steps = rates / usual if usual > 0 else np.full(1, math.nan)
    uneven = float(np.median(np.abs(steps - 1)))
    if not uneven < JERKY:
        return "whether frames of the flow are missing is not seen: the bed falls in too few frames, or unevenly."
    jumps = steps[steps > max(TWO_STEPS, 1 + 4 * uneven)]
    missing = int(np.sum(np.round(jumps) - 1))
    if missing == 0:
        return Check("frame_timing", True, 0.0, 0.0, "the bed falls evenly: no frame of the flow seems to be missing.")
    message = (
        f"at least some {missing} frames of the flow seem to be missing: between {len(jumps)} pairs of frames the bed "
        f"falls up to {float(jumps.max()):.1f} times as far as usual, so that times come out too short; give the "
        "clip as it was recorded."
    )
    return Check("frame_timing", False, float(missing), 0.0, message)
