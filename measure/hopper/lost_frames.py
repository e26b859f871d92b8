"""Detect missing and repeated frames during the flow, also where the file does not report them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.quantity import Check
from rigtwin.measure.hopper.falling_stream import STILL
from rigtwin.measure.media.frame_loss import repeated

FEWEST = 10  # least number of pairs of frames that show how far beads fall between them
MORE = 0.6  # [frames], excess of a step over its time above which a frame is missing
CUT = 2.5  # least loss of the bed over the usual loss in a step where frames were cut out
# The same over the scatter of the losses, because beads leave in bursts.  False positives for flows of 70 steps without
# a cut, losses drawn from a gamma distribution (4000 each): 0.3 % with a scatter of 58 % where 5 % of the steps show no
# fall, 1 % with a scatter of 71 % where 15 % do.  Rendered films scatter by 20 to 40 %.
CLEARLY = 16.0
ALSO = 8.5  # the same where beads are seen to fall before and after that step, and only in it none is
AROUND = 8  # steps before and after one that give the usual loss
BESIDE = 3  # steps before and after one that give the usual fall then: the first beads are slower


def timing_check(stamped: Array, shown: Array, changes: Array, gone: Array) -> Check | str:
    """Check whether frames of a flow are missing or repeated, or state why that cannot be judged.

    All arrays have shape (n,), one value per step from a picture to the next.  `stamped` is the number of frames by the
    time stamps, `shown` that by the fall of the beads (NaN where not seen), `changes` the change of the picture in any
    unit, and `gone` the loss of the bed (NaN where it carries no information).

    Falling beads cannot stop for a frame, nor fall twice as far in one.  If more than a few frames are cut out, no bead
    is seen both before and after the gap, but the bed is lower at once.
    """
    again = repeated(changes)
    if again.any():
        return _repeats_check(again, shown)
    if cut := _cut_out(gone / stamped, _unseen_alone(shown)):
        message = (
            f"some {sum(cut)} frames of the flow are missing: from one picture to the next the bed loses as much as "
            f"usually in {1 + max(cut)} steps, so times are too short; give the clip as it was recorded."
        )
        return Check("frame_timing", False, float(sum(cut)), 0.0, message)
    seen = shown > STILL
    if seen.sum() < FEWEST:
        return (
            "whether frames of the flow are missing is not known: too few pictures show beads that fall below the slot."
        )
    excess = _to_the_usual(shown[seen] / stamped[seen]) * stamped[seen] - stamped[seen]
    lost = np.round(excess[excess > MORE])
    if len(lost) == 0:
        message = "from frame to frame beads fall as far as usual: no frame of the flow seems to be missing."
        return Check("frame_timing", True, 0.0, 0.0, message)
    fewest = float(lost.sum())
    # the same share may be missing where no bead is seen to fall, plus two standard deviations of that number
    unseen = fewest / seen.sum() * (len(seen) - seen.sum())
    most = fewest + unseen + 2 * math.sqrt(unseen)
    some = f"at least {fewest:.0f}" if most < fewest + 1 else f"some {fewest:.0f} to {most:.0f}"
    are = "frame of the flow is" if some == "at least 1" else "frames of the flow are"
    message = (
        f"{some} {are} missing: in {len(lost)} of the {seen.sum()} steps in which beads are seen to "
        "fall, they fall as far as in two or more, so times are too short; give the clip as it was recorded."
    )
    return Check("frame_timing", False, fewest, 0.0, message)


def _unseen_alone(shown: Array) -> npt.NDArray[np.bool_]:
    """Steps in which no bead is seen to fall, unlike in the two before and the two after."""
    seen = np.concatenate([[False] * 2, shown > STILL, [False] * 2])
    return np.asarray(seen[:-4] & seen[1:-3] & ~seen[2:-2] & seen[3:-1] & seen[4:])


def _cut_out(gone: Array, unseen: npt.NDArray[np.bool_]) -> list[int]:
    """Number of missing frames at each step in which the bed loses far more than in the steps around it.

    `unseen`: steps in which no bead is seen to fall, as where frames are cut out.
    """
    cut = []
    for k in np.flatnonzero(np.isfinite(gone)).tolist():
        near = _beside(gone, k, AROUND)
        near = near[np.isfinite(near)]
        if len(near) < AROUND or (usual := float(np.median(near))) <= 0:
            continue
        # one of them may be another gap; a median absolute deviation would miss bursts at every third step
        more, scatter = gone[k] - usual, float(np.std(np.sort(near)[:-1], ddof=1))
        if more > CUT * usual and more > (ALSO if unseen[k] else CLEARLY) * scatter:
            cut.append(round(more / usual))
    return cut


def _to_the_usual(paces: Array) -> Array:
    """Each step over the median of those around it."""
    return np.asarray(paces / np.array([float(np.median(_beside(paces, k, BESIDE))) for k in range(len(paces))]))


def _beside(values: Array, k: int, reach: int) -> Array:
    """Values before and after index `k`, without it."""
    return np.concatenate([values[max(k - reach, 0) : k], values[k + 1 : k + 1 + reach]])


def _repeats_check(again: npt.NDArray[np.bool_], shown: Array) -> Check:
    count, every = int(again.sum()), float(np.median(np.diff(np.flatnonzero(again))))
    if every < 2:  # shown three times or more: the distance of the repeats gives no rate
        every = len(again) / count
    next_ones = shown[1:][again[:-1]]
    next_ones = next_ones[np.isfinite(next_ones)]
    message = f"{count} of {len(again)} frames of the flow repeat the previous one, about one in {every:.2g}: "
    if len(next_ones) and float(np.median(next_ones)) > 1 + MORE:
        message += "they replace missing frames, so times are right to a frame at best; "
    else:
        longer = every / max(every - 1, 0.1)
        message += f"unless the film plays as fast as it was captured, times are {longer:.2f} times too long; "
    return Check("frame_timing", False, float(count), 0.0, message + "give the clip as it was recorded.")
