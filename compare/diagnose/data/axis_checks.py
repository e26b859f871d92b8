"""Whether the columns of a track are the rig's axes: a cheap look at where gravity points, before anything is fitted.

An exchanged or an upside-down column is a fault of the file and no effect; fitted, it would come out as forces that
nobody would find in a laboratory.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rigtwin.compare.diagnose.data.tracked_lab import Condition, TrackedLab, start_of
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track

WINDOWS = (0.06, 0.12)  # [s], through which a parabola is laid
FEWEST = 6  # rows of such a window
OF_A_PERIOD = 0.2  # longest window through the path of a pendulum
BADLY = 0.2  # of what gravity bends a path within a window: an impact leaves more beside its parabola
PLAINLY = 3.0  # times as near to one gravity as to the other, and times as many windows
APART = 0.2  # of gravity, between what two directions of it would do
SPEAKING = 3  # windows
SELDOM = 0.05  # share of the rows
HIGH = 0.3  # thread lengths
LONG = 200.0  # frames between two rows, far below a time in milliseconds
HIGHER = 0.3  # of a stated height: no lab is as unsure of its scale
OFF = 0.25  # thread lengths from where a thread's end can be
TINY = 1e-9  # [m]
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
        alone = replace(lab, conditions=(condition,))
        for number, repetition in enumerate(condition.repetitions):
            for track in repetition:
                if len(track.time) >= FEWEST and (fault := _ticks(lab, track) or look(alone, condition, track)):
                    where = next(iter(condition.files[number : number + 1]), f"repetition {number + 1}")
                    raise BadInput(f"{lab.folder}: {condition.name}: {where}: {fault}.")
            if lab.rig == "double" and start_of(repetition[0]) > 0:
                where = next(iter(condition.files[number : number + 1]), f"repetition {number + 1}")
                raise BadInput(
                    f"{lab.folder}: {condition.name}: {where}: {repetition[0].body}, the bead that is let go, starts "
                    "on the right; write x_m with the opposite sign, so that it starts on the left."
                )


def check_heights(lab: TrackedLab) -> None:
    """Raises `BadInput` where the beads of a condition do not come from where it says that they are let go."""
    for condition in lab.conditions if lab.rig == "drop" else ():
        stated, bead = replace(lab, conditions=(condition,)).setting("drop_height_m")[0], condition.bead
        falls = [_let_go(repetition[0], lab.gravity) for repetition in condition.repetitions]
        seen = float(np.median(falls)) - bead.radius
        if abs(seen - stated) > HIGHER * stated + bead.diameter:
            raise BadInput(
                f"{lab.folder}: {condition.name}: drop_height_m: {stated:g} is stated, but the tracks fall from "
                f"{seen:.3g} m above the plate; correct it, or the scale of the tracks, or put their origin in the "
                "plate's surface."
            )


def _let_go(track: Track, gravity: float) -> float:
    """[m], the height from which a bead falls, above the picture where it is seen to come in with a speed."""
    time, height = track.time[:FEWEST], track.position[:FEWEST, 1]
    speed = float(np.polyfit(time - time[0], height, 1)[0])
    return max(float(track.position[:, 1].max()), float(height.mean()) + speed**2 / (2 * gravity))


def _ticks(lab: TrackedLab, track: Track) -> str:
    """Rows follow one another about as fast as the camera's frames."""
    step = float(np.median(np.diff(track.time)))
    slow = step * lab.camera.frame_rate > LONG
    each = f"its rows are {step:g} s apart, where the camera has a frame each {1 / lab.camera.frame_rate:g} s"
    return f"{each}; time_s is in seconds" if slow else ""


def _falls(lab: TrackedLab, _condition: Condition, track: Track) -> str:
    """A bead in flight is accelerated downwards."""
    _, acceleration = _bent(track, lab.gravity)

    def misfit(x: float, y: float) -> Array:
        return np.asarray(np.hypot(*(acceleration / lab.gravity - [x, y]).T))

    if any(_pulls(misfit(side, 0), misfit(0, -1)) for side in (-1, 1)):
        return f"the bead falls along x_m, {EXCHANGED}"
    return f"the bead falls upwards, {UPSIDE_DOWN}" if _pulls(misfit(0, 1), misfit(0, -1)) else ""


def _hangs(lab: TrackedLab, _condition: Condition, track: Track) -> str:
    """A bob is drawn down along its arc, wherever on it it is; the thread holds it across the arc."""
    length, release = lab.setting("length_m")[0], abs(lab.setting("release_angle_deg")[0])
    x, y = track.position.T
    if float(np.median(abs(np.hypot(x, y) - length))) > OFF * length:
        aloft = float(np.mean(y < 0)) < SELDOM
        return "the bob does not hang below the origin; put the origin at the pivot" if aloft else ""
    longest = OF_A_PERIOD * 2 * math.pi * math.sqrt(max(length, 0.0) / lab.gravity)
    place, acceleration = _bent(track, lab.gravity, longest)
    along = place[:, ::-1] * [-1, 1] / np.maximum(np.hypot(*place.T), TINY)[:, None]

    def misfit(x: float, y: float) -> Array:
        return np.asarray(abs(np.sum((acceleration / lab.gravity - [x, y]) * along, axis=1)))

    if _pulls(misfit(-1, 0), misfit(0, -1), abs(along @ [-1, 1]) > APART):
        return f"the bob hangs to the left of its pivot, {EXCHANGED}"
    # a bob let go below the level never comes above it
    stands = release < 90 and float(np.median(y)) > HIGH * length
    stands = stands or _pulls(misfit(0, 1), misfit(0, -1), abs(along @ [0, 2]) > APART)
    return f"the bob stands above its pivot, {UPSIDE_DOWN}" if stands else ""


def _pulls(this: Array, right: Array, apart: npt.NDArray[np.bool_] | bool = True) -> bool:
    """Whether plainly more windows fit a gravity in this direction than in the right one."""
    for_this = int(np.sum(apart & (PLAINLY * this < right)))
    for_right = int(np.sum(apart & (PLAINLY * right < this)))
    return for_this >= SPEAKING and for_this > PLAINLY * for_right


def _bent(track: Track, gravity: float, longest: float = math.inf) -> tuple[Array, Array]:
    """Places (windows, 2) [m] and accelerations [m/s^2] of the windows through which a parabola fits well."""
    step = float(np.median(np.diff(track.time)))
    sizes = {min(max(round(window / step) + 1, FEWEST), len(track.time)) for window in WINDOWS}
    found = [_parabolas(track, rows, gravity, longest) for rows in sorted(sizes)]
    return np.concatenate([place for place, _ in found]), np.concatenate([bend for _, bend in found])


def _parabolas(track: Track, rows: int, gravity: float, longest: float) -> tuple[Array, Array]:
    """The same, of windows of so many rows, each a quarter on from the one before."""
    every = max(rows // 4, 1)
    time = np.lib.stride_tricks.sliding_window_view(track.time, rows)[::every]
    path = np.lib.stride_tricks.sliding_window_view(track.position, rows, axis=0)[::every]
    place = path.mean(axis=-1)
    left = path - place[..., None]
    s = time - time.mean(axis=1, keepdims=True)
    square = np.sum(s * s, axis=1, keepdims=True)
    bow = s * s - square / rows - s * np.sum(s**3, axis=1, keepdims=True) / square
    height = np.sum(bow * bow, axis=1)
    left = left - s[:, None] * np.sum(left * s[:, None], axis=-1, keepdims=True) / square[:, None]
    half = np.sum(left * bow[:, None], axis=-1) / height[:, None]
    left = left - half[..., None] * bow[:, None]
    beside = np.sqrt(np.sum(left**2, axis=-1).max(axis=1) / (rows - 3))
    well = (beside < BADLY * gravity / 2 * np.sqrt(height / rows)) & (time[:, -1] - time[:, 0] <= longest)
    return place[well], 2 * half[well]


def _lies(lab: TrackedLab, condition: Condition, track: Track) -> str:
    """A clump lies on the arm, which rises to the right from the angle stated for the moment zero."""
    x, y = np.median(track.position[:FEWEST], axis=0)
    tilted = lab.setting("tilt_rate_deg_s", 0.0)[0] * float(np.median(track.time[:FEWEST]))
    stated = math.radians(lab.setting("start_angle_deg", 0.0)[0] + tilted)
    stated += math.atan2(condition.bead.radius, math.hypot(x, y))
    if abs(math.atan2(y, x) - stated) < FAR:
        return ""
    if abs(math.atan2(x, y) - stated) < NEAR:
        return f"the clump does not lie at the arm's angle, {EXCHANGED}"
    return f"the clump lies below the hinge, {UPSIDE_DOWN}" if abs(math.atan2(-y, x) - stated) < NEAR else ""


def _descends(lab: TrackedLab, condition: Condition, track: Track) -> str:
    """A bead rolls along the level, and down where it is not pushed."""
    way = np.median(track.position[-FEWEST:], axis=0) - np.median(track.position[:FEWEST], axis=0)
    incline = math.radians(lab.setting("incline_angle_deg", 0.0)[0])
    along, up = abs(float(way[0])), float(way[1])
    if math.hypot(along, up) < condition.bead.diameter or incline > math.pi / 4 - FAR:
        return ""
    if abs(up) > along:
        return f"the bead rolls along y_m, {EXCHANGED}"
    pushed = lab.setting("push_speed_m_s", 0.0)[0] != 0
    climbs = incline > FAR / 2 and not pushed and math.atan2(up, along) > incline / 2
    return f"the bead rolls upwards, {UPSIDE_DOWN}" if climbs else ""
