"""Checks of a measured drop: gravity, residuals, plane of motion, first fall, frame timing, size, camera."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.lab.camera import STATED_OFF, STATED_SIGMA
from rigtwin.lab.formatting import reading
from rigtwin.lab.quantity import Check, root_sum_of_squares
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.drop.bounce_fit import FEWEST_SEEN, LEAST_SEEN, Bounces
from rigtwin.measure.drop.sideways_motion import fit_sideways
from rigtwin.measure.media.frame_loss import LEAST_SHARE
from rigtwin.measure.robust import MAD_TO_STD
from rigtwin.measure.scene.checks import bead_in_view, static_camera

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.lab.camera import Line
    from rigtwin.lab.records import Track
    from rigtwin.measure.media.frame_loss import Loss
    from rigtwin.measure.media.video import Video
    from rigtwin.measure.tracking.follow import Chase

# [1/s], capture rates that cameras offer; a wrong rate is most often another one of these.
USUAL_RATES = (24, 25, 30, 48, 50, 60, 90, 100, 120, 200, 240, 250, 300, 400, 480, 500, 600, 960, 1000, 1200, 2000)
# Standard uncertainties beyond which two scales contradict; that of a rim is a limit (shading), not a scatter.
SCALES_APART = 2.0
OF_RADIUS = 0.3  # of the bead: seen from above, the visible edge of a plate is not the line on which it is hit
LEAST_APART = 0.06  # relative tolerance of a stated diameter: beads are not rounder than that
LEAST_LEFT = 0.05  # [px], lower limit of the tracking noise that is used in the comparison below
MOST_LEFT = 2.5  # largest residual of the flights over the tracking noise
MOST_HIDDEN = 0.1  # [px], standard deviation, largest sway of the strongest edges against the rest of the scene
MOST_SHAKE = 5.0  # [px], standard deviation, up to which camera shake only shifts the picture

RISEN = 0.03  # share of the fall below its top from which a rising bead is distinguished from a held one
MIRRORED = 0.15  # relative distance from the mirrored fall up to which the motion before the apex is a rise


def gravity_check(bounces: Bounces, scale_uncertainty: float, rate: float, repeated_share: float) -> Check:
    gravity, parts = bounces.read(lambda at: at.size * GRAVITY)
    fit_uncertainty = root_sum_of_squares(parts)
    uncertainty = math.hypot(fit_uncertainty, gravity * scale_uncertainty)
    passed = abs(math.log(gravity / GRAVITY)) < max(
        0.015, math.hypot(3 * fit_uncertainty / gravity, SCALES_APART * scale_uncertainty)
    )
    found = f"free flight gives g = {gravity:.3f} ± {uncertainty:.3f} m/s²"
    if passed:
        return Check("gravity", True, gravity, GRAVITY, f"{found}: scale, frame rate and roll fit together.")
    meaning = _what_is_wrong(gravity, rate, repeated_share)
    return Check("gravity", False, gravity, GRAVITY, f"{found} instead of {GRAVITY}: {meaning}")


def _what_is_wrong(gravity: float, rate: float, repeated_share: float) -> str:
    """Likely cause of a wrong gravity: doubled frames, else another usual capture rate, else the scale."""
    ratio = gravity / GRAVITY
    # repeats are not found while the bead rests, so they stretch the time by at least the share found
    if repeated_share > LEAST_SHARE and 0.25 < math.sqrt(ratio) < 1.2 * (1 - repeated_share):
        return (
            f"doubled frames, {100 * repeated_share:.0f} % of them, stretch the time; "
            f"give --frame-rate {rate / math.sqrt(ratio):.3g}Hz, or the camera's original file."
        )
    scale = f"lengths (the scale) are {abs(ratio - 1) * 100:.3g} % too {'large' if ratio > 1 else 'small'}"
    usual = other_rate(rate, gravity)
    if usual is not None:
        speed = f"slow motion by {usual / rate:.3g}" if usual > rate else f"a speed-up by {rate / usual:.3g}"
        return (
            f"this is what a record captured at {usual} Hz gives when {rate:.4g} Hz are assumed ({speed}); "
            f"give --frame-rate {usual}Hz, or else {scale}."
        )
    if 0.7 < ratio < 1.4:
        return f"{scale}; capture rates come in steps, and none explains this."
    return f"either {scale}, or it was captured at {rate / math.sqrt(ratio):.4g} Hz and not {rate:.4g} Hz."


def scales_agree(ratio: float, uncertainty: float) -> bool:
    """Whether the bead's stated diameter and another scale are compatible.

    `ratio` is the ratio of the two scales, `uncertainty` its relative standard uncertainty.
    """
    return abs(math.log(ratio)) < max(LEAST_APART, SCALES_APART * uncertainty)


def contradiction(ratio: float, uncertainty: float, rate: float, bead: float) -> str:
    """Message on possible causes if the bead's stated diameter [m] gives `ratio` times the scale from gravity.

    `uncertainty` is the relative standard uncertainty of the ratio, `rate` [1/s] the stated frame rate.
    """
    across, captured = bead / ratio, rate / math.sqrt(ratio)
    return (
        f"the stated diameter and frame rate contradict each other: either the bead is "
        f"{reading(across, across * uncertainty, 'm')} across and not {1e3 * bead:.3g}, or the clip was captured at "
        f"{captured:.0f} ± {captured * uncertainty / 2:.0f} Hz and not at {rate:.4g}, or the rim of "
        "the bead's image was misjudged"
    )


def other_rate(rate: float, gravity: float) -> int | None:
    """The usual capture rate [1/s] that explains a fitted `gravity` [m/s^2] when `rate` was assumed, or None."""
    true_rate = rate / math.sqrt(gravity / GRAVITY)
    nearest = min(USUAL_RATES, key=lambda usual: abs(math.log(usual / true_rate)))
    return nearest if abs(nearest / true_rate - 1) < 0.03 and abs(nearest / rate - 1) > 0.15 else None


def residual_check(bounces: Bounces) -> Check:
    expected = max(bounces.expected_noise, 2e-5 * bounces.span)
    ratio = bounces.noise / expected
    passed = ratio < 2.5
    meaning = (
        "within its frame-to-frame noise"
        if passed
        else "well above its frame-to-frame noise: something pushes the bead, or the tracking is wrong"
    )
    message = f"residuals from the fitted flights are {ratio:.2f} times the noise of the track, {meaning}."
    return Check("flight_residuals", passed, ratio, 1.0, message)


def plane_check(track: Track, bounces: Bounces, side: Track | None = None) -> Check:
    """Sideways motion and change of scale: both change a height without any loss of energy.

    `side` is the same body at the same times seen from the side.
    """
    contacts = bounces.contact_times
    speeds = [0.0]
    impact = bounces.model.reader(bounces.parameters)
    for k, start in enumerate(contacts):
        end = contacts[k + 1] if k + 1 < len(contacts) else track.time[-1]
        inside = (track.time > start) & (track.time < end)
        if np.sum(inside) > 4:
            views = [track] if side is None else [track, side]
            slopes = [float(np.polyfit(track.time[inside], view.position[inside, 0], 1)[0]) for view in views]
            speeds.append(math.hypot(*slopes) / (impact.impact_speed(k + 1) * impact.size))
    sideways = max(speeds)
    _, levels, growth = bounces.model.split(bounces.parameters)
    reach = float(impact.heights[1]) * impact.size
    drift = float(np.max(np.abs(levels[: bounces.count] - levels[0]))) / reach if bounces.count > 1 else 0.0
    swell = float(np.max(np.abs(growth)))
    value = max(sideways, drift, swell)
    passed = sideways < 0.15 and drift < 0.12 and swell < 0.12
    message = (
        f"sideways speed is {100 * sideways:.1f} % of the impact speed, the plate's level drifts by "
        f"{100 * drift:.1f} % of the first rebound, the scale along the path by {100 * swell:.1f} %"
    )
    ending = "."
    if not passed:
        ending = (
            ": the bead leaves the plane of its fall (spin, not a sphere, or plate not level); use only the methods by "
            "speeds."
        )
    return Check("out_of_plane", passed, value, 0.0, message + ending)


def fall_check(track: Track, bounces: Bounces) -> Check:
    """Whether the fall to the first bounce is the drop from rest and was seen in enough frames."""
    apex, contact = float(bounces.apex_times[0]), float(bounces.contact_times[0])
    time, height = track.time, track.position[:, 1]
    step = float(np.median(np.diff(time)))
    frames = int((contact - max(apex, float(time[0]))) / step)
    seen = int(np.sum(bounces.used & (time < contact)))
    # a rise that mirrors the fall shows that the bead comes from a bounce
    before = (time > 2 * apex - contact) & (time < apex)
    mirrored = bounces.curve(2 * apex - time[before])
    top = float(bounces.level(np.array([contact]))[0]) + bounces.span
    below = top - mirrored
    clear = below > RISEN * bounces.span
    off = np.abs(height[before] - mirrored)[clear] / below[clear]
    rises = len(off) >= FEWEST_SEEN and float(np.median(off)) < MIRRORED
    message = f"the fall to the first bounce shows the bead in {seen} of its {frames} frames"
    if rises:
        message = (
            "the bead is first seen as it rises from a bounce: the flight that is taken for the drop is a later one"
        )
    passed = not rises and seen >= max(LEAST_SEEN * frames, 1)
    ending = "." if passed else ": the record must show the bead from its release, all the way down."
    return Check("first_fall", passed, float(seen), float(frames), message + ending)


def timing_check(track: Track, bounces: Bounces, repeats: int, losses: Sequence[Loss] = ()) -> Check:
    """Frames that are missing or repeated during the flights.

    `repeats` more were left out before; certain `losses` are corrected already.
    """
    time = track.time
    steps = np.diff(time)
    usual = float(np.median(steps))
    inside = (time[1:] > bounces.apex_times[0]) & (time[1:] < time[bounces.used].max())
    missing = float(np.sum(np.maximum(np.round(steps[inside] / usual) - 1, 0)))
    moved = np.linalg.norm(np.diff(track.position, axis=0), axis=1)
    fitted = np.abs(np.diff(bounces.curve(time)))
    near_contact = np.min(np.abs(time[1:, None] - usual / 2 - bounces.contact_times), axis=1) < 1.5 * usual
    still = ~near_contact & (moved < 0.05 * fitted) & (fitted > 12 * bounces.expected_noise)
    again = int(np.sum(inside & still))
    whole = max(float(np.sum(inside)), 1.0)
    # lost frames are allowed: the time stamps of the others are right; occlusion of the bead is another check
    passed = again == 0 and repeats == 0 and missing < whole and all(loss.sure for loss in losses)
    message = (
        f"{int(missing)} of {int(whole + missing)} frames of the flights are missing or without the bead, "
        f"{again} are repeated"
    )
    if repeats:
        message = f"doubled frames: {repeats} of {repeats + len(time)} repeat the one before and were left out"
    message += "".join(f"; {_loss_text(loss)}" for loss in losses)
    ending = "." if passed else ": for a film, use the camera's original file, taken at a fixed frame rate."
    return Check("frame_timing", passed, missing + again + repeats, 0.0, message + ending)


def _loss_text(loss: Loss) -> str:
    if not loss.sure:
        return (
            f"either {loss.in_words} at about {loss.time:.3f} s, which the time stamps do not show, or the bead is "
            "kicked sideways out of the plane there, or that contact lasts long: with a correction the flights would "
            "meet on a level plate; times were not changed"
        )
    why = "the flights meet on a level plate" if loss.at_contact else "the flight is one curve"
    return f"{loss.in_words} at {loss.time:.3f} s, which the time stamps do not show: {why} after the correction"


def size_check(found: float, uncertainty: float, stated: float) -> Check:
    """Compare the diameter of the bead's image `found` with the `stated` one [m]; `uncertainty` is relative."""
    passed = scales_agree(found / stated, uncertainty)
    message = (
        f"the bead's rim is {found * 1e3:.2f} ± {found * uncertainty * 1e3:.2f} mm across, "
        f"{stated * 1e3:.2f} mm are stated"
    )
    ending = "." if passed else ": the scale or the stated diameter is wrong, or something else was followed."
    return Check("bead_size", passed, found, stated, message + ending)


def plate_check(plate: Line, seen: Chase, fitted: Bounces) -> Check:
    """Whether the flights meet where the bead touches the stated plate; `fitted` is in pixels, y up."""
    contact = float(fitted.contact_times[0])
    times = np.array([sighting.time for sighting in seen.sightings])
    x = float(np.interp(contact, times, [sighting.image.x for sighting in seen.sightings]))
    lowest = float(-fitted.level(np.array([contact]))[0]) + seen.radius
    (x1, y1), (x2, y2) = plate
    stated = y1 + (y2 - y1) * (x - x1) / max(x2 - x1, 1e-9)
    passed = abs(lowest - stated) < STATED_OFF * STATED_SIGMA + OF_RADIUS * seen.radius
    message = (
        f"at the first contact ({contact:.3f} s) the bead's lowest point is {lowest - stated:+.1f} px below --plate"
    )
    ending = (
        "." if passed else ": the bead bounces on something else, or the stated line is none of the plate's surface."
    )
    return Check("stated_plate", passed, lowest - stated, 0.0, message + ending)


def _left_of_flights(seen: Chase, fitted: Bounces) -> float:
    """Residual of the flights [px], root mean square: the larger of vertical and horizontal."""
    flights = [sighting for sighting, used in zip(seen.sightings, fitted.used, strict=True) if used]
    times, across = (np.array(each) for each in zip(*((one.time, one.image.x) for one in flights), strict=True))
    sideways = fit_sideways(times, across, fitted.contact_times, fitted.apex_times)
    return max(fitted.noise, float(np.std(sideways.off[sideways.kept])))


def view_checks(video: Video, seen: Chase, fitted: Bounces, repeats: frozenset[int]) -> tuple[Check, ...]:
    """Whether the bead was seen during its flights, and whether the camera was still or its shake was measured.

    `repeats` are frames that repeat the one before.
    """
    times = np.array([sighting.time for sighting in seen.sightings])[fitted.used]
    flights = (video.times >= times[0]) & (video.times <= times[-1])
    flights[list(repeats)] = False
    share = len(times) / max(int(np.sum(flights)), 1)
    seen_to = max(float(np.median([sighting.image.sigma for sighting in seen.sightings])), LEAST_LEFT)
    left = _left_of_flights(seen, fitted)
    shaken = (
        ""
        if left < MOST_LEFT * seen_to
        else (
            f"; but the residuals of the flights are {left:.2f} px, at a tracking noise of {seen_to:.2f} px: the "
            "camera shook where a coarse codec hides it, or the bead spins or drifts"
        )
    )
    off = np.array([pose.strongest_off for pose in seen.poses if pose.placed]).reshape(-1, 2)
    hidden = MAD_TO_STD * float(np.max(np.median(np.abs(off - np.median(off, axis=0)), axis=0))) if len(off) else 0.0
    if hidden > MOST_HIDDEN:
        shaken += (
            f"; but its strongest edges sway by {hidden:.2f} px against the rest: the camera shook, and a coarse codec "
            "repeats parts of low contrast"
        )
    return (
        bead_in_view(share, int(np.sum(flights)), "its flights"),
        static_camera(seen.poses, MOST_SHAKE, vouched="the bead's flights show no shake", reason=shaken),
    )
