"""Leave out unusable data before the fit, each with one sentence for the report.

Left out are rows without a position, single outliers, rows after a jump of the path (lost frames), rows before the
release of a bead that moves in the hand, and repetitions without motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import Condition, TrackedLab
from rigtwin.compare.diagnose.data.tracking_noise import noise_of
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track
from rigtwin.measure.robust import mad_std

SIDE = 5  # rows on either side of a row, in which a parabola is fitted
FAR = 12.0  # typical extrapolation errors above which a row is an outlier
MOST = 0.02  # largest share of outliers; more of them are treated as noise and kept
STAYS = 8.0  # displacement in units of the noise below which a bead has not moved
FALLEN = 0.1  # share of a fall after which its beginning is computed as that of a free fall; no hand lowers as fast
FREELY = 1.1  # way of a free fall to a speed, over v^2 / 2 g, above which it is none; 1.2 at 0.8 g, below 1.05 in air
LOW = 0.3  # share of the height of a fall below which the bead rises again only from the plate
LISTED = 3  # largest number of tracks with missing positions that are listed by name
CLEAR = 1.5  # height above the plate, in bead diameters, at which no impact is near


def sifted(lab: TrackedLab) -> tuple[TrackedLab, tuple[str, ...]]:
    """The lab without unusable data, and one sentence for each exclusion.  Raises `BadInput` if nothing is left."""
    noise = noise_of(lab, [track for c in lab.conditions for repetition in c.repetitions for track in repetition])
    said = _unseen(lab)
    conditions = []
    for condition in lab.conditions:
        kept: list[tuple[Track, ...]] = []
        files: list[str] = []
        for number, repetition in enumerate(condition.repetitions):
            where = f"{condition.name}, repetition {number + 1}"
            if _stayed(lab.rig, condition, repetition[0], noise):
                said.append(f"{where}: left out, nothing moved")
                continue
            cleaned = _cleaned(lab.rig, condition, repetition, noise, where, said)
            kept.append(
                _cut_before_release(cleaned, condition, lab.gravity, noise, where, said)
                if lab.rig == "drop"
                else cleaned
            )
            files.extend(condition.files[number : number + 1])
        if kept:
            conditions.append(replace(condition, repetitions=tuple(kept), files=tuple(files)))
    if not conditions:
        raise BadInput(
            f"{lab.folder}: nothing moves by more than {STAYS:g} times the tracking noise of {noise:.2g} m in any of "
            f"the {lab.repetitions} repetitions; check the tracks, and tracking_noise_m if it is stated."
        )
    return replace(lab, conditions=tuple(conditions)), tuple(said)


def _unseen(lab: TrackedLab) -> list[str]:
    """One sentence on the rows without a position, which were left out on reading."""
    gaps = []
    for condition in lab.conditions:
        for number, repetition in enumerate(condition.repetitions):
            where = next(iter(condition.files[number : number + 1]), f"{condition.name}, repetition {number + 1}")
            gaps += [(track.unseen, track.unseen + len(track.time), where) for track in repetition if track.unseen]
    if not gaps:
        return []
    gaps.sort(reverse=True)
    most = ", ".join(f"{gap} of {rows} in {where}" for gap, rows, where in gaps[:LISTED])
    others = (
        f" and {sum(gap for gap, _, _ in gaps[LISTED:])} in {len(gaps) - LISTED} more" if len(gaps) > LISTED else ""
    )
    return [f"rows without a position left out: {most}{others}"]


def _stayed(rig: str, condition: Condition, track: Track, noise: float) -> bool:
    """Whether nothing happened: no fall, no swing, no rolling on the incline, no sliding on the arm."""
    if rig == "slide":
        way = np.hypot(track.position[:, 0], track.position[:, 1])  # the arm itself moves
    elif rig == "roll" and not condition.settings.get("push_speed_m_s"):
        way = track.position[:, 0]
    else:
        return bool(np.ptp(track.position, axis=0).max() <= STAYS * noise)
    return bool(abs(np.median(way[-SIDE:]) - np.median(way[:SIDE])) < STAYS * noise)


def _cleaned(
    rig: str, condition: Condition, repetition: tuple[Track, ...], noise: float, where: str, said: list[str]
) -> tuple[Track, ...]:
    tracks = []
    for track in repetition:
        off, _ = _faults(track, noise)
        if off.sum() > max(MOST * len(off), 1):
            off[:] = False
        if off.any():
            at = ", ".join(f"{t:.4f}" for t in track.time[off][:4])
            said.append(f"{where}: {off.sum()} rows left out as outliers from the path before and after (t = {at} s)")
        smooth = _part(track, ~off)
        end = _break(smooth, condition, noise) if rig == "drop" else len(smooth.time)
        if end < len(smooth.time):
            said.append(f"{where}: left out after t = {smooth.time[end - 1]:.4f} s, where the path jumps")
        tracks.append(_part(smooth, slice(end)))
    return tuple(tracks)


def _cut_before_release(
    repetition: tuple[Track, ...], condition: Condition, gravity: float, noise: float, where: str, said: list[str]
) -> tuple[Track, ...]:
    """The repetition from its release on, if the bead does not rest until then."""
    (track,) = repetition
    row = release_row(track, condition.bead.radius, gravity)
    # the last row may belong to the fall already, as the moment of release is known to a frame or so
    way = float(np.ptp(track.position[: row - 1], axis=0).max()) if row > SIDE else 0.0
    if way <= STAYS * noise:
        return repetition
    said.append(
        f"{where}: left out before the release at t = {track.time[row]:.4f} s, as the bead moves by {1e3 * way:.1f} "
        "mm while it is held"
    )
    return (_part(track, slice(row, None)),)


def release_row(track: Track, radius: float, gravity: float) -> int:
    """Row of the release of a drop, 0 where the fall is not that of a body let go.

    The first fall ends at the plate, or with the track; it began when the speed was that of a free fall through
    `FALLEN` of the height, after which the time since the release follows from that speed.
    """
    time, height = track.time, track.position[:, 1]
    top = int(np.argmax(height))
    low = height[top:-1] - radius < LOW * (height[top] - radius)
    rebounds = np.flatnonzero(low & (height[top + 1 :] > height[top:-1]))
    end = top + int(rebounds[0]) if len(rebounds) else len(height) - 1
    if end - SIDE <= SIDE:
        return 0
    speed = (height[: end - SIDE] - height[SIDE:end]) / (time[SIDE:end] - time[: end - SIDE])
    half = SIDE // 2
    above = height[half : half + len(speed)] - radius
    slow = np.flatnonzero(speed < np.sqrt(2 * gravity * FALLEN * np.maximum(above, 0.0)))
    if not len(slow) or slow[-1] + 2 * SIDE >= len(speed):
        return 0
    at = int(slow[-1])
    free = max(float(speed[at]), 0.0)
    row = int(np.searchsorted(time, time[at + half] - free / gravity))
    # what falls slower than freely, as in a liquid, has come further by the time that it is as fast
    return row if height[row] - height[at + half] < FREELY * free**2 / (2 * gravity) else 0


def _break(track: Track, condition: Condition, noise: float) -> int:
    """Number of rows before the path of a drop jumps well above the plate, as it does where frames are missing."""
    high = CLEAR * condition.bead.diameter + condition.bead.radius
    for k in np.flatnonzero(_faults(track, noise)[1]):
        if float(track.position[max(k - SIDE, 0) : k + SIDE + 1, 1].min()) > high and k > 4 * SIDE:
            return int(k) + 1
    return len(track.time)


def _part(track: Track, rows: Any) -> Track:
    return replace(track, time=track.time[rows], position=track.position[rows], sigma=track.sigma[rows])


def _faults(track: Track, noise: float) -> tuple[Any, Any]:
    """Masks (n,) of rows off the path extrapolated from both sides, and of rows after which the path jumps."""
    n = len(track.time)
    off, broken = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    if n < 4 * SIDE:
        return off, broken
    step = float(np.median(np.diff(track.time)))
    ahead, behind = _carried_on(track, step, 1), _carried_on(track, step, -1)
    for k in range(track.position.shape[1]):
        y = track.position[:, k]
        before, after = y - ahead[0][:, k], y - behind[0][:, k]
        # a track with other errors than white noise, such as uneven frames, sets its own scale
        typical = max(mad_std(before[np.isfinite(before)], centre=0.0), 2.3 * noise)
        far = (np.abs(before) > FAR * typical) & (np.abs(after) > FAR * typical)
        off |= far & (np.sign(before) == np.sign(after))
        # the paths before and after, each extrapolated by half a step to the middle between two rows
        jump = behind[1][1:, k] - ahead[1][:-1, k]
        here, there = y[1:] - ahead[0][1:, k], behind[0][:-1, k] - y[:-1]
        alike = (np.sign(jump) == np.sign(here)) & (np.sign(jump) == np.sign(there))
        least = np.minimum(np.abs(here), np.abs(there))
        broken[:-1] |= alike & (least > FAR * typical) & (np.abs(jump) > 0.7 * np.maximum(np.abs(here), np.abs(there)))
    return off, broken


def _carried_on(track: Track, step: float, way: int) -> tuple[Array, Array]:
    """Parabolas through the `SIDE` rows before (with `way` -1: after) each row, extrapolated to the row and half a
    step beyond the last of these rows; NaN where there are too few rows."""
    time, place = track.time[::way] * way, track.position[::way]
    n = len(time)
    to_row, beyond = np.full(place.shape, np.nan), np.full(place.shape, np.nan)
    t = np.lib.stride_tricks.sliding_window_view(time, SIDE)
    y = np.lib.stride_tricks.sliding_window_view(place, SIDE, axis=0)  # (n - SIDE + 1, coordinates, SIDE)
    s = (t - t[:, -1:]) / step
    powers = np.stack([np.ones_like(s), s, s * s], axis=-1)
    weights = np.linalg.pinv(powers)  # (windows, 3, SIDE)
    bent = np.einsum("wps,wks->wkp", weights, y)
    late = (time[SIDE:] - time[SIDE - 1 : n - 1]) / step
    to_row[SIDE:] = bent[:-1, :, 0] + bent[:-1, :, 1] * late[:, None] + bent[:-1, :, 2] * late[:, None] ** 2
    beyond[SIDE - 1 :] = bent[..., 0] + 0.5 * bent[..., 1] + 0.25 * bent[..., 2]
    return to_row[::way], beyond[::way]
