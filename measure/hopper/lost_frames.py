"""Whether the frames of a film follow each other as its times say, above all where the file does not say so itself."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.quantity import Check
from rigtwin.measure.hopper.falling_stream import STILL
from rigtwin.measure.media.frame_loss import repeated

FEWEST = 10  # pairs of frames that must show how far beads fall between them
MORE = 0.6  # frames, more than its times tell, from which on a step is one in which a frame is missing
CUT = 2.5  # usual losses of the bed, by which a step is more where frames are cut out
# and scatters of them: beads leave in bursts.  Of flows of 70 steps without a cut, with losses of a gamma distribution
# that scatters by 58 %, 0.3 % are convicted where 5 % of the steps show no fall, and 1 % of those that scatter by 71 %
# where 15 % do (4000 drawn of each); rendered films scatter by 20 to 40 %
CLEARLY = 16.0
ALSO = 8.5  # scatters of them, where beads are seen to fall before and after that step, and in it alone none is
AROUND = 8  # steps before and after one, that tell how much of the bed goes usually
BESIDE = 3  # steps before and after one, that tell what is usual then: the first beads are slower


def timing_check(told: Array, shown: Array, changes: Array, gone: Array) -> Check | str:
    """Whether frames of a flow are missing or repeated, or in words why that cannot be judged.

    From each picture to the next, shape (n,): `told` is how many frames they are apart by their times, `shown` how many
    by how far beads fall, NaN where that is not seen, `changes` how much of the picture changes, in any unit, and
    `gone` how much of the bed is gone after it, NaN where that tells nothing.

    Beads that fall cannot stop for a frame, nor fall twice as far in one.  Where more than a few frames are cut out, no
    bead before the gap is seen after it, but the bed is lower at once.
    """
    again = repeated(changes)
    if again.any():
        return _repeats_check(again, shown)
    if cut := _cut_out(gone / told, _unseen_alone(shown)):
        message = (
            f"some {sum(cut)} frames of the flow are missing: from one picture to the next as much of the bed is gone "
            f"as else in {1 + max(cut)}, so that times come out too short; give the clip as it was recorded."
        )
        return Check("frame_timing", False, float(sum(cut)), 0.0, message)
    seen = shown > STILL
    if seen.sum() < FEWEST:
        return (
            "whether frames of the flow are missing is not seen: too few pictures show beads that fall below the slot."
        )
    excess = _to_the_usual(shown[seen] / told[seen]) * told[seen] - told[seen]
    lost = np.round(excess[excess > MORE])
    if len(lost) == 0:
        message = "from frame to frame beads fall as far as is usual: no frame of the flow seems to be missing."
        return Check("frame_timing", True, 0.0, 0.0, message)
    fewest = float(lost.sum())
    # where no bead is seen to fall as many may be missing, give or take two standard deviations of their number
    unseen = fewest / seen.sum() * (len(seen) - seen.sum())
    most = fewest + unseen + 2 * math.sqrt(unseen)
    some = f"at least {fewest:.0f}" if most < fewest + 1 else f"some {fewest:.0f} to {most:.0f}"
    are = "frame of the flow is" if some == "at least 1" else "frames of the flow are"
    message = (
        f"{some} {are} missing: in {len(lost)} of the {seen.sum()} steps in which beads are seen to "
        "fall, they fall as far as in two or more, so that times come out too short; give the clip as it was recorded."
    )
    return Check("frame_timing", False, fewest, 0.0, message)


def _unseen_alone(shown: Array) -> npt.NDArray[np.bool_]:
    """Steps in which no bead is seen to fall, unlike in the two before and the two after."""
    seen = np.concatenate([[False] * 2, shown > STILL, [False] * 2])
    return np.asarray(seen[:-4] & seen[1:-3] & ~seen[2:-2] & seen[3:-1] & seen[4:])


def _cut_out(gone: Array, unseen: npt.NDArray[np.bool_]) -> list[int]:
    """How many frames are missing at each step after which far more of the bed is gone than after those about it.

    `unseen`: no bead before the step is seen to fall after it, as where frames are cut out.
    """
    cut = []
    for k in np.flatnonzero(np.isfinite(gone)).tolist():
        near = _beside(gone, k, AROUND)
        near = near[np.isfinite(near)]
        if len(near) < AROUND or (usual := float(np.median(near))) <= 0:
            continue
        # one of them may be another gap; a median deviation would miss bursts that come at every third step
        more, scatter = gone[k] - usual, float(np.std(np.sort(near)[:-1], ddof=1))
        if more > CUT * usual and more > (ALSO if unseen[k] else CLEARLY) * scatter:
            cut.append(round(more / usual))
    return cut


def _to_the_usual(paces: Array) -> Array:
    """How fast each step is for those about it."""
    return np.asarray(paces / np.array([float(np.median(_beside(paces, k, BESIDE))) for k in range(len(paces))]))


def _beside(values: Array, k: int, reach: int) -> Array:
    """Those before and after one, without it."""
    return np.concatenate([values[max(k - reach, 0) : k], values[k + 1 : k + 1 + reach]])


def _repeats_check(again: npt.NDArray[np.bool_], shown: Array) -> Check:
    count, every = int(again.sum()), float(np.median(np.diff(np.flatnonzero(again))))
    if every < 2:  # shown three times and more, where the rhythm of the repeats tells nothing
        every = len(again) / count
    next_ones = shown[1:][again[:-1]]
    next_ones = next_ones[np.isfinite(next_ones)]
    message = f"{count} of {len(again)} frames of the flow repeat the one before them, about one in {every:.2g}: "
    if len(next_ones) and float(np.median(next_ones)) > 1 + MORE:
        message += "they stand where others are missing, so that times are right to a frame at best; "
    else:
        longer = every / max(every - 1, 0.1)
        message += f"unless the film plays as fast as it was captured, times come out {longer:.2f} times too long; "
    return Check("frame_timing", False, float(count), 0.0, message + "give the clip as it was recorded.")
