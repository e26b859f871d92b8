"""Parts of a broken track: joined as stated, or proposed where one ends where another begins."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track

NEAR = 4.0  # steps of the track, largest distance of the next part's first point from where the last speed leads
LONGEST_GAP = 0.2  # share of the longer part's duration; over longer gaps the last speed says nothing


def joined(tracks: Sequence[Track], groups: Sequence[Sequence[str]], where: str) -> tuple[Track, ...]:
    """Return tracks with the parts of every group put together under the name of its first part.

    Parameters
    ----------
    tracks : sequence of Track
        Tracks, some of them parts of one.
    groups : sequence of sequence of str
        Names of the parts of one body, for each body with several.
    where : str
        What messages begin with.

    Returns
    -------
    tuple of Track
        Tracks, one for each group and one for each track in no group.

    Raises
    ------
    BadInput
        If a name is unknown, or two parts overlap in time.
    """
    named = {track.body: track for track in tracks}
    for group in groups:
        if unknown := next((name for name in group if name not in named), ""):
            raise BadInput(f"{where}: there is no track {unknown!r} to join; the tracks are {', '.join(named)}.")
        parts = sorted((named.pop(name) for name in group), key=lambda track: float(track.time[0]))
        for one, other in pairwise(parts):
            if other.time[0] <= one.time[-1]:
                raise BadInput(
                    f"{where}: tracks {one.body!r} and {other.body!r} overlap in time, so they are two bodies."
                )
        named[group[0]] = Track(
            np.concatenate([part.time for part in parts]),
            np.concatenate([part.position for part in parts]),
            np.concatenate([part.sigma for part in parts]),
            group[0],
            sum(part.unseen for part in parts),
        )
    return tuple(named.values())


def proposals(tracks: Sequence[Track]) -> tuple[str, ...]:
    """Propose to join tracks of which one ends where, and just before, the other begins.

    Parameters
    ----------
    tracks : sequence of Track
        Tracks that may be parts of one.

    Returns
    -------
    tuple of str
        One sentence for each such pair.
    """
    found = []
    whole = [track for track in tracks if len(track.time) >= 3]
    for one in whole:
        after = [other for other in whole if _continues(one, other)]
        if len(after) == 1:
            gap = float(after[0].time[0] - one.time[-1])
            found.append(
                f"track {after[0].body!r} begins where track {one.body!r} ends, {gap:.3g} s later; if they are one "
                f"body, give --join {one.body},{after[0].body}."
            )
    return tuple(found)


def _continues(one: Track, other: Track) -> bool:
    gap = float(other.time[0] - one.time[-1])
    longer = max(float(np.ptp(one.time)), float(np.ptp(other.time)))
    if not 0 < gap <= LONGEST_GAP * longer:
        return False
    speed = (one.position[-1] - one.position[-3]) / (one.time[-1] - one.time[-3])
    step = max(_step(one), _step(other))
    jump = float(np.hypot(*(other.position[0] - one.position[-1] - speed * gap)))
    # the longest step, as it may have fallen on for the gap
    return jump <= NEAR * step


def _step(track: Track) -> float:
    return float(np.percentile(np.hypot(*np.diff(track.position, axis=0).T), 90))
