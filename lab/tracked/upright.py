"""Whether y counts upwards in a track: gravity shows it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.records import Track

MOVING = 0.1  # share of the largest speed above which a body counts as in flight, not at rest or at its turning point


def by_fall(tracks: Sequence[Track]) -> tuple[bool, str] | None:
    """Find whether y counts upwards in tracks of bodies in free flight: they accelerate downwards, but during contacts.

    Parameters
    ----------
    tracks : sequence of Track
        The tracks, in any unit of length; the longest counts.

    Returns
    -------
    tuple of bool and str, or None
        The answer with the evidence in words; None if nothing accelerates or the track has fewer than
        five rows.
    """
    track = max(tracks, key=lambda each: len(each.time))
    reach, falls = 1, []
    while reach == 1 or 16 * reach < len(track.time):
        bends = _bends(track, reach)
        falls += [] if bends is None else [float(np.mean(bends < 0))]
        reach *= 2
    if not falls:
        return None
    # over few frames the noise hides the acceleration, over many there is a contact in between: take the clearest
    share = max(falls, key=lambda each: abs(each - 0.5))
    return (
        share > 0.5,
        f"the body accelerates downwards in {100 * max(share, 1 - share):.0f} % of the moments in flight",
    )


def by_swing(tracks: Sequence[Track]) -> tuple[bool, str] | None:
    """Find whether y counts upwards in tracks of hanging bodies: the centre of their circle is above them.

    Parameters
    ----------
    tracks : sequence of Track
        The tracks, in any unit of length; the widest counts.

    Returns
    -------
    tuple of bool and str, or None
        The answer with the evidence in words; None if nothing moves sideways or the track has fewer
        than six rows.
    """
    track = max(tracks, key=lambda each: float(np.ptp(each.position[:, 0])))
    x, y = (track.position - track.position.mean(axis=0)).T
    if len(x) < 6 or not np.ptp(x) > 0:
        return None
    # x^2 + y^2 = 2 a x + 2 b y + c, with the centre at (a, b)
    (_, b, _), *_ = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones_like(x)]), x**2 + y**2, rcond=None)
    return bool(b > 0), "the hinge is above the beads"


def _bends(track: Track, reach: int) -> Array | None:
    """Second derivative of y over `reach` frames to each side, where the body moves, in arbitrary units."""
    time, y = track.time, track.position[:, 1]
    if len(y) < 4 * reach + 1:
        return None
    before, after = time[reach:-reach] - time[: -2 * reach], time[2 * reach :] - time[reach:-reach]
    slope_in = (y[reach:-reach] - y[: -2 * reach]) / before
    slope_out = (y[2 * reach :] - y[reach:-reach]) / after
    speed = np.abs(slope_in + slope_out) / 2
    moving = speed > MOVING * float(np.max(speed))
    bend = (slope_out - slope_in) / (before + after)
    return bend[moving] if np.any(moving) and np.any(bend[moving] != 0) else None
