"""Whether the columns of a track are the rig's axes: a cheap look at where gravity points, before anything is fitted.

An exchanged or an upside-down column is a fault of the file and no effect; fitted, it would come out as forces that
nobody would find in a laboratory.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rigtwin.compare.diagnose.labs import Condition, TrackedLab
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Array, Track

WINDOW = 0.05  # [s], through which a parabola is laid
FEWEST = 7  # rows of such a window
FALLING = 0.2  # of gravity: less says nothing of its direction
PLAINLY = 3.0  # times as much along one axis as along the other
ALWAYS, OFTEN = 0.95, 0.8  # shares of the rows
HIGH = 0.3  # thread lengths
NEAR, FAR = math.radians(5), math.radians(10)  # of a stated angle, and clearly off it

EXCHANGED = "x_m and y_m look exchanged; x_m is level and y_m points up"
UPSIDE_DOWN = "y_m looks as if it counted downwards; it points up"


def check_axes(lab: TrackedLab) -> None:
    """Raises `BadInput` for the first track whose axes are plainly not those of the rig."""
    look: Callable[[TrackedLab, Condition, Track], str] = {
        "drop": _falls,
        "pendulum": _hangs,
        "double": _hangs,
        "slide": _lies,
        "roll": _descends,
    }[lab.rig]
    for condition in lab.conditions:
        for number, repetition in enumerate(condition.repetitions):
            for track in repetition:
                if fault := look(lab, condition, track):
                    where = next(iter(condition.files[number : number + 1]), f"repetition {number + 1}")
                    raise BadInput(f"{lab.folder}: {condition.name}: {where}: {fault}.")


def _falls(lab: TrackedLab, _condition: Condition, track: Track) -> str:
    """A bead in flight is accelerated downwards."""
    across, up = np.median(_acceleration(track), axis=0) / lab.gravity
    if abs(across) > max(FALLING, PLAINLY * abs(up)):
        return f"the bead falls along x_m, {EXCHANGED}"
    return f"the bead falls upwards, {UPSIDE_DOWN}" if up > max(FALLING, PLAINLY * abs(across)) else ""


def _acceleration(track: Track) -> Array:
    """(windows, 2) [m/s^2], of parabolas through as many rows as there are in a window."""
    step = float(np.median(np.diff(track.time)))
    rows = min(max(math.ceil(WINDOW / step), FEWEST), len(track.time))
    time = np.lib.stride_tricks.sliding_window_view(track.time, rows)[:: rows // 2 + 1]
    place = np.lib.stride_tricks.sliding_window_view(track.position, rows, axis=0)[:: rows // 2 + 1]
    s = (time - time.mean(axis=1, keepdims=True)) / step
    weights = np.linalg.pinv(np.stack([np.ones_like(s), s, s * s], axis=-1))
    return np.asarray(2 * np.einsum("ws,wks->wk", weights[:, 2], place) / step**2)


def _hangs(_lab: TrackedLab, condition: Condition, track: Track) -> str:
    """A bob hangs below its pivot, whichever side it swings to."""
    left, below = np.mean(track.position < 0, axis=0)
    if below < OFTEN and left > ALWAYS:
        return f"the bob hangs to the left of its pivot, {EXCHANGED}"
    high = float(np.median(track.position[:, 1])) / float(condition.settings.get("length_m") or math.inf)
    if high > HIGH:
        return f"the bob stands above its pivot, {UPSIDE_DOWN}"
    return "the bob does not hang below the origin; put the origin at the pivot" if below < 1 - ALWAYS else ""


def _lies(_lab: TrackedLab, condition: Condition, track: Track) -> str:
    """A clump lies on the arm, which rises to the right at the angle stated for the first frame."""
    x, y = np.median(track.position[:FEWEST], axis=0)
    stated = math.radians(float(condition.settings.get("start_angle_deg") or 0.0))
    stated += math.atan2(condition.bead.radius, math.hypot(x, y))
    if abs(math.atan2(y, x) - stated) < FAR:
        return ""
    if abs(math.atan2(x, y) - stated) < NEAR:
        return f"the clump does not lie at the arm's angle, {EXCHANGED}"
    return f"the clump lies below the hinge, {UPSIDE_DOWN}" if abs(math.atan2(-y, x) - stated) < NEAR else ""


def _descends(_lab: TrackedLab, condition: Condition, track: Track) -> str:
    """A bead rolls along the level, and down where it is not pushed."""
    way = np.median(track.position[-FEWEST:], axis=0) - np.median(track.position[:FEWEST], axis=0)
    incline = math.radians(float(condition.settings.get("incline_angle_deg") or 0.0))
    along, up = abs(float(way[0])), float(way[1])
    if math.hypot(along, up) < condition.bead.diameter or incline > math.pi / 4 - FAR:
        return ""
    if abs(up) > along:
        return f"the bead rolls along y_m, {EXCHANGED}"
    climbs = incline > FAR / 2 and not condition.settings.get("push_speed_m_s") and math.atan2(up, along) > incline / 2
    return f"the bead rolls upwards, {UPSIDE_DOWN}" if climbs else ""
