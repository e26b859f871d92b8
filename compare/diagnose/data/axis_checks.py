"""Check that the columns of a track are the rig's axes, from the direction of gravity in the tracks.

Exchanged or inverted columns are an error of the file.  Fitted, they would appear as an impossible force.
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

WINDOWS = (0.06, 0.12)  # [s], lengths of the windows in which a parabola is fitted
FEWEST = 6  # smallest number of rows in a window
OF_A_PERIOD = 0.2  # longest window for a pendulum, as a share of its period
BADLY = 0.2  # largest misfit of a parabola, as a share of the bend due to gravity; an impact in a window exceeds it
PLAINLY = 3.0  # factor by which one direction of gravity must fit better, in misfit and in number of windows
APART = 0.2  # smallest difference, in units of gravity, between two directions for a window to count
SPEAKING = 3  # smallest number of windows for a decision
SELDOM = 0.05  # share of the rows below the pivot under which the origin cannot be at the pivot
HIGH = 0.3  # height above the pivot, in thread lengths, that a bob released below the pivot cannot reach
LONG = 200.0  # camera frames between two rows; times in milliseconds give far more
HIGHER = 0.3  # relative difference to a stated height; larger than any plausible scale error
OFF = 0.25  # distance of a bob from the circle of its thread, in thread lengths
TINY = 1e-9  # [m], avoids division by zero
NEAR, FAR = math.radians(5), math.radians(10)  # [rad], agreement with a stated angle, and clear difference

EXCHANGED = "x_m and y_m look exchanged; x_m is level and y_m points up"
UPSIDE_DOWN = "y_m looks as if it counted downwards; it points up"


def check_axes(lab: TrackedLab) -> None:
    """Raise `BadInput` for the first track whose axes are clearly not those of the rig."""
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
                    f"{lab.folder}: {condition.name}: {where}: {repetition[0].body}, the released bead, starts "
                    "on the right; write x_m with the opposite sign, so that it starts on the left."
                )


def check_heights(lab: TrackedLab) -> None:
    """Raise `BadInput` where the tracks of a condition contradict its stated drop height."""
    for condition in lab.conditions if lab.rig == "drop" else ():
        stated, bead = replace(lab, conditions=(condition,)).setting("drop_height_m")[0], condition.bead
        falls = [_let_go(repetition[0], lab.gravity) for repetition in condition.repetitions]
        seen = float(np.median(falls)) - bead.radius
        if abs(seen - stated) > HIGHER * stated + bead.diameter:
            raise BadInput(
                f"{lab.folder}: {condition.name}: drop_height_m: {stated:g} is stated, but the tracks fall from "
                f"{seen:.3g} m above the plate; correct the height or the scale of the tracks, or put their origin in "
                "the plate's surface."
            )


def _let_go(track: Track, gravity: float) -> float:
    """Height [m] from which a bead falls; above the picture if it enters the picture with a speed."""
    time, height = track.time[:FEWEST], track.position[:FEWEST, 1]
    speed = float(np.polyfit(time - time[0], height, 1)[0])
    return max(float(track.position[:, 1].max()), float(height.mean()) + speed**2 / (2 * gravity))


def _ticks(lab: TrackedLab, track: Track) -> str:
    """An error text if the rows are much further apart than the camera's frames."""
    step = float(np.median(np.diff(track.time)))
    slow = step * lab.camera.frame_rate > LONG
    each = f"its rows are {step:g} s apart, but the camera takes a frame every {1 / lab.camera.frame_rate:g} s"
    return f"{each}; write time_s in seconds" if slow else ""


def _falls(lab: TrackedLab, _condition: Condition, track: Track) -> str:
    """An error text if a bead in flight is not accelerated downwards."""
    _, acceleration = _bent(track, lab.gravity)

    def misfit(x: float, y: float) -> Array:
        return np.asarray(np.hypot(*(acceleration / lab.gravity - [x, y]).T))

    if any(_pulls(misfit(side, 0), misfit(0, -1)) for side in (-1, 1)):
        return f"the bead falls along x_m, {EXCHANGED}"
    return f"the bead falls upwards, {UPSIDE_DOWN}" if _pulls(misfit(0, 1), misfit(0, -1)) else ""


def _hangs(lab: TrackedLab, _condition: Condition, track: Track) -> str:
    """An error text if a bob is not accelerated downwards along its arc; the thread carries the rest of its weight."""
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
    # a bob released below the height of the pivot never rises above it
    stands = release < 90 and float(np.median(y)) > HIGH * length
    stands = stands or _pulls(misfit(0, 1), misfit(0, -1), abs(along @ [0, 2]) > APART)
    return f"the bob stands above its pivot, {UPSIDE_DOWN}" if stands else ""


def _pulls(this: Array, right: Array, apart: npt.NDArray[np.bool_] | bool = True) -> bool:
    """Whether clearly more windows fit gravity in this direction than in the right one."""
    for_this = int(np.sum(apart & (PLAINLY * this < right)))
    for_right = int(np.sum(apart & (PLAINLY * right < this)))
    return for_this >= SPEAKING and for_this > PLAINLY * for_right


def _bent(track: Track, gravity: float, longest: float = math.inf) -> tuple[Array, Array]:
    """Positions (windows, 2) [m] and accelerations (windows, 2) [m/s^2] of the windows that a parabola fits well."""
    step = float(np.median(np.diff(track.time)))
    sizes = {min(max(round(window / step) + 1, FEWEST), len(track.time)) for window in WINDOWS}
    found = [_parabolas(track, rows, gravity, longest) for rows in sorted(sizes)]
    return np.concatenate([place for place, _ in found]), np.concatenate([bend for _, bend in found])


def _parabolas(track: Track, rows: int, gravity: float, longest: float) -> tuple[Array, Array]:
    """As `_bent`, for windows of `rows` rows, each shifted by a quarter of its length."""
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
    """An error text if the clump does not lie on the arm, which rises to the right by its stated angle at time zero."""
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
    """An error text if a bead does not roll along x, or rolls up an incline without a push."""
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
