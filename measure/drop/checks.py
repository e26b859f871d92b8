"""What a track of a falling bead says of itself: gravity, residuals, plane, timing, and stated size."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.lab.formatting import reading
from rigtwin.lab.quantity import Check, root_sum_of_squares
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.drop.bounce_fit import FEWEST_SEEN, LEAST_SEEN, Bounces
from rigtwin.measure.drop.sideways_motion import fly_aside
from rigtwin.measure.media.frame_loss import LEAST_SHARE
from rigtwin.measure.scene.checks import bead_in_view, static_camera

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.lab.records import Track
    from rigtwin.measure.media.frame_loss import Loss
    from rigtwin.measure.media.video import Video
    from rigtwin.measure.tracking.follow import Chase

# Capture rates that cameras offer [1/s]; a wrong rate is most often another one of these.
USUAL_RATES = (24, 25, 30, 48, 50, 60, 90, 100, 120, 200, 240, 250, 300, 400, 480, 500, 600, 960, 1000, 1200, 2000)
# A rim's doubt is no scatter but how far shading may shift it: two scales further apart than twice that contradict.
SCALES_APART = 2.0
LEAST_APART = 0.06  # relative, that a stated diameter may be off: beads are not round to better
LEAST_LEFT = 0.05  # [px], that a bead is not said to be seen better than
MOST_LEFT = 2.5  # times what a bead is seen to, that its flights may leave of its track
MOST_HIDDEN = 0.1  # [px], standard deviation, by which the strongest edges may sway where the scene seems to stand
MOST_SHAKE = 5.0  # [px], standard deviation, up to which a shaking camera only shifts its picture

RISEN = 0.03  # of the fall, below its top, from which on a bead that rises to it is told from one that is held there
MIRRORED = 0.15  # of the way below the top, up to which a rise is the fall backwards


def gravity_check(bounces: Bounces, scale_doubt: float, rate: float, repeated_share: float) -> Check:
    gravity, parts = bounces.read(lambda at: at.size * GRAVITY)
    fit_doubt = root_sum_of_squares(parts)
    doubt = math.hypot(fit_doubt, gravity * scale_doubt)
    passed = abs(math.log(gravity / GRAVITY)) < max(
        0.015, math.hypot(3 * fit_doubt / gravity, SCALES_APART * scale_doubt)
    )
    found = f"free flight gives g = {gravity:.3f} ± {doubt:.3f} m/s²"
    if passed:
        return Check("gravity", True, gravity, GRAVITY, f"{found}: scale, frame rate and roll fit together.")
    meaning = _what_is_wrong(gravity, rate, repeated_share)
    return Check("gravity", False, gravity, GRAVITY, f"{found} instead of {GRAVITY}: {meaning}")


def _what_is_wrong(gravity: float, rate: float, repeated_share: float) -> str:
    """Doubled frames show themselves; capture rates come in steps; what is left is the scale."""
    ratio = gravity / GRAVITY
    # where the bead rests not all repeats are found: they stretch the time by at least their share
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


def scales_agree(ratio: float, doubt: float) -> bool:
    """Whether the bead's stated diameter and another scale can both be right.

    `ratio` is what one makes of a length over what the other does, `doubt` its relative standard uncertainty.
    """
    return abs(math.log(ratio)) < max(LEAST_APART, SCALES_APART * doubt)


def contradiction(ratio: float, doubt: float, rate: float, bead: float) -> str:
    """What may be wrong where the bead's stated diameter [m] gives `ratio` times the scale that gravity gives.

    `doubt` is the relative standard uncertainty of the ratio, `rate` [1/s] the stated frame rate.
    """
    across, captured = bead / ratio, rate / math.sqrt(ratio)
    return (
        f"the stated diameter and frame rate contradict each other: either the bead is "
        f"{reading(across, across * doubt, 'm')} across and not {1e3 * bead:.3g}, or the clip was captured at "
        f"{captured:.0f} ± {captured * doubt / 2:.0f} Hz and not at {rate:.4g}, or the rim of "
        "the bead's image was misjudged"
    )


def other_rate(rate: float, gravity: float) -> int | None:
    """The usual capture rate [1/s] that explains a fitted gravity [m/s^2] when `rate` was assumed, if there is one."""
    true_rate = rate / math.sqrt(gravity / GRAVITY)
    nearest = min(USUAL_RATES, key=lambda usual: abs(math.log(usual / true_rate)))
    return nearest if abs(nearest / true_rate - 1) < 0.03 and abs(nearest / rate - 1) > 0.15 else None


def residual_check(bounces: Bounces) -> Check:
    expected = max(bounces.expected_noise, 2e-5 * bounces.span)
    ratio = bounces.noise / expected
    passed = ratio < 2.5
    meaning = (
        "as its frame-to-frame noise tells"
        if passed
        else "far more than its frame-to-frame noise: something pushes the bead, or the tracking is wrong"
    )
    message = f"the track leaves the fitted flights by {ratio:.2f} times its noise, {meaning}."
    return Check("flight_residuals", passed, ratio, 1.0, message)


def plane_check(track: Track, bounces: Bounces, side: Track | None = None) -> Check:
    """Sideways motion and growth against the fall: both change a height without any loss of energy.

    `side` is the same body at the same times as one sees it from the side.
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
            ": the bead leaves the plane, as one does that spins, is no sphere or meets a plate that is not level; "
            "trust the methods by speeds only."
        )
    return Check("out_of_plane", passed, value, 0.0, message + ending)


def fall_check(track: Track, bounces: Bounces) -> Check:
    """Whether the fall to the first bounce is the drop, and was seen; else heights and bounces are not those meant."""
    apex, contact = float(bounces.apex_times[0]), float(bounces.contact_times[0])
    time, height = track.time, track.position[:, 1]
    step = float(np.median(np.diff(time)))
    frames = int((contact - max(apex, float(time[0]))) / step)
    seen = int(np.sum(bounces.used & (time < contact)))
    # a bead that rises to where its fall begins, as it falls from there, comes from a bounce
    before = (time > 2 * apex - contact) & (time < apex)
    mirrored = bounces.curve(2 * apex - time[before])
    top = float(bounces.level(np.array([contact]))[0]) + bounces.span
    below = top - mirrored
    told = below > RISEN * bounces.span
    off = np.abs(height[before] - mirrored)[told] / below[told]
    rises = len(off) >= FEWEST_SEEN and float(np.median(off)) < MIRRORED
    message = f"the fall to the first bounce shows the bead in {seen} of its {frames} frames"
    if rises:
        message = "the bead is first seen as it rises from a bounce: what is called the drop here is a later flight"
    passed = not rises and seen >= max(LEAST_SEEN * frames, 1)
    ending = "." if passed else ": the record is to show the bead from its release on, all the way down."
    return Check("first_fall", passed, float(seen), float(frames), message + ending)


def timing_check(track: Track, bounces: Bounces, repeats: int, losses: Sequence[Loss] = ()) -> Check:
    """Frames missing or repeated while the bead flies; `repeats` more were left out, sure `losses` mended before."""
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
    # the frames' own times hold where others were lost; whether the bead is in those that are there is another check
    passed = again == 0 and repeats == 0 and missing < whole and all(loss.sure for loss in losses)
    message = (
        f"{int(missing)} of {int(whole + missing)} frames of the flights are missing or without the bead, "
        f"{again} are repeated"
    )
    if repeats:
        message = f"doubled frames: {repeats} of {repeats + len(time)} repeat the one before and were left out"
    message += "".join(f"; {_told(loss)}" for loss in losses)
    ending = "." if passed else ": of a film use the camera's original file, taken at a fixed frame rate."
    return Check("frame_timing", passed, missing + again + repeats, 0.0, message + ending)


def _told(loss: Loss) -> str:
    if not loss.sure:
        return (
            f"either {loss.in_words} at about {loss.time:.3f} s, which the times do not tell, or the bead is kicked "
            "aside and leaves the plane there, or that contact lasts: the flights would meet on a level plate were it "
            "put right; times are left as they are"
        )
    why = "the flights meet on a level plate" if loss.at_contact else "a flight is whole"
    return f"{loss.in_words} at {loss.time:.3f} s, which the times do not tell: {why} once that is put right"


def size_check(found: float, doubt: float, stated: float) -> Check:
    """`found` and `stated` [m]; `doubt` relative."""
    passed = scales_agree(found / stated, doubt)
    message = f"the bead's rim shows {found * 1e3:.2f} ± {found * doubt * 1e3:.2f} mm, {stated * 1e3:.2f} mm are stated"
    ending = "." if passed else ": the scale or the stated diameter is wrong, or something else was followed."
    return Check("bead_size", passed, found, stated, message + ending)


def _left_of_flights(seen: Chase, fitted: Bounces) -> float:
    """[px], root mean square, up and down or to the side, whichever is more."""
    flights = [sighting for sighting, used in zip(seen.sightings, fitted.used, strict=True) if used]
    times, across = (np.array(each) for each in zip(*((one.time, one.image.x) for one in flights), strict=True))
    aside = fly_aside(times, across, fitted.contact_times, fitted.apex_times)
    return max(fitted.noise, float(np.std(aside.off[aside.kept])))


def view_checks(video: Video, seen: Chase, fitted: Bounces, repeats: frozenset[int]) -> tuple[Check, ...]:
    """Whether the bead was seen through its flights, and whether the camera stood still or its shake is told.

    `repeats` are frames that show the same as the one before.
    """
    times = np.array([sighting.time for sighting in seen.sightings])[fitted.used]
    flights = (video.times >= times[0]) & (video.times <= times[-1])
    flights[list(repeats)] = False
    share = len(times) / max(int(np.sum(flights)), 1)
    seen_to = max(float(np.median([sighting.image.sigma for sighting in seen.sightings])), LEAST_LEFT)
    left = _left_of_flights(seen, fitted)
    doubt = (
        ""
        if left < MOST_LEFT * seen_to
        else (
            f"; but the bead leaves its flights by {left:.2f} px where it is seen to {seen_to:.2f}: the camera shook "
            "where a coarse codec hides it, or the bead spins or drifts"
        )
    )
    off = np.array([pose.strongest_off for pose in seen.poses if pose.placed]).reshape(-1, 2)
    hidden = 1.4826 * float(np.max(np.median(np.abs(off - np.median(off, axis=0)), axis=0))) if len(off) else 0.0
    if hidden > MOST_HIDDEN:
        doubt += (
            f"; but its strongest edges sway by {hidden:.2f} px against the rest: the camera shook, and a coarse codec "
            "repeats what is not so clear as it was"
        )
    return (
        bead_in_view(share, int(np.sum(flights)), "its flights"),
        static_camera(seen.poses, MOST_SHAKE, vouched="the bead's flights show no shake", doubt=doubt),
    )
