"""Checks of a measured pendulum: momentum, gravity, lengths, contact angle, residuals, lens, timing, camera."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.lab.camera import STATED_OFF
from rigtwin.lab.quantity import Check
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.pendulum.swing_fit import Outcome, SwingFit, frame_interval
from rigtwin.measure.pendulum.swing_model import pivots, turning_points
from rigtwin.measure.robust import mad_std
from rigtwin.measure.scene.checks import bead_in_view, static_camera

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.measure.media.frame_loss import Loss
    from rigtwin.measure.media.video import Video
    from rigtwin.measure.pendulum.track_two_beads import Beads

MOST_MISFIT = 1.4  # largest residual over the frame-to-frame noise
LEAST_MISFIT = 5e-4  # residual over the pendulum's length that always passes: background texture shifts a bead by less
LEAST_NOISE = 2e-5  # lower limit of the noise over the pendulum's length: below it an exact record shows its rounding


def reasons_of(fit: SwingFit, outcomes: dict[str, Outcome]) -> dict[str, str]:
    """Reasons why collision, release angle and turning angles are doubtful; empty texts if there is none."""
    swings = fit.swings
    collision, release, turning = [], [], []
    if fit.noise > 0.006 * outcomes["length"].value:
        collision.append(
            f"the tracks scatter by {fit.noise / outcomes['length'].value:.1%} of the pendulum length about the fit"
        )
    if swings.beads == 2 and (sway := _sway(fit)) > 0.005 * outcomes["speed"].value:
        share = sway / outcomes["speed"].value
        collision.append(f"bead B was not at rest before the collision ({share:.1%} of A's speed)")
    first = fit.tracks[0]
    since = float(swings["release_time"]) - first.time[0]
    if since < -frame_interval(first):
        release.append("the record begins after the release: the angle is extrapolated")
    elif since < 2 * frame_interval(first):
        release.append("the record begins at the release: it does not show that the bead started from rest")
    if since < 2 * frame_interval(first):
        # the fit of the speed at the collision assumes a start from rest
        collision.append("the record does not show bead A at rest before its fall")
    _, when = turning_points(swings, 0)
    for bead, track in enumerate(fit.tracks):
        if track.time[-1] < float(when[bead, 0]):
            turning.append(f"the record ends before bead {track.body} turns: its angle is extrapolated")
    return {"collision": "; ".join(collision), "release": "; ".join(release), "turning": "; ".join(turning)}


def _sway(fit: SwingFit) -> float:
    """Speed of bead B in the last 0.12 s before the collision [m/s]; 0 if it is within the noise."""
    track, hit = fit.tracks[1], float(fit.swings["time_0"])
    before = (track.time < hit - frame_interval(track)) & (track.time > hit - 0.12)
    if np.sum(before) < 8:
        return 0.0
    time, x = track.time[before], track.position[before, 0]
    (slope, _), covariance = np.polyfit(time - hit, x, 1, cov=True)
    return float(abs(slope)) if abs(slope) > 4 * math.sqrt(covariance[0, 0]) else 0.0


def momentum_check(outcomes: dict[str, Outcome], bead_mass: float | None) -> Check:
    ratio = outcomes["momentum"]
    passed = abs(ratio.value - 1) <= max(0.03, 3 * ratio.std)
    mass, unit = (1.0, "m/s per unit of mass") if bead_mass is None else (bead_mass, "kg m/s")
    before, after = mass * outcomes["speed"].value, mass * outcomes["speeds_after"].value
    found = (
        f"momentum after the collision is {ratio.value:.4f} of that before (equal masses; {before:.4g} {unit} before)"
    )
    meaning = "" if passed else ": the beads differ in mass, hit off centre, or a track is wrong"
    return Check("momentum", passed, after, before, found + meaning)


def contact_angle_check(outcomes: dict[str, Outcome]) -> Check:
    """Whether the bead hangs vertically where it touches the wall, as the formula with the two angles assumes."""
    hit = outcomes["contact_angle"]
    angle, sigma = math.degrees(hit.value), math.degrees(hit.std)
    passed = abs(angle) < max(1.0, 3 * sigma)
    found = f"the bead hits the wall {angle:+.2f} ± {sigma:.2f} degrees past the vertical"
    meaning = "" if passed else ": methods velocity and height allow for it, method angle does not"
    return Check("contact_angle", passed, angle, 0.0, found + meaning)


HEAVIEST = 0.5  # relative excess of apparent gravity for a rod without a bead, against a thread of its length


def gravity_check(outcomes: dict[str, Outcome]) -> Check:
    g = outcomes["gravity"]
    excess = g.value / GRAVITY - 1
    passed = abs(excess) <= max(0.02, 2.5 * g.std / GRAVITY)
    fits = GRAVITY / outcomes["pull"].value
    found = (
        f"gravity from the swing is {g.value:.3f} ± {g.std:.3f} m/s²; a pendulum that swings like this is "
        f"{fits * 1e3:.1f} mm long, the record says {outcomes['length'].value * 1e3:.1f} mm"
    )
    if passed:
        return Check("gravity", True, g.value, GRAVITY, found)
    word = "large" if excess > 0 else "small"
    heavy = ", or rods or threads have mass" if 0 < excess < HEAVIEST else ""
    fast = "high" if excess > 0 else "low"
    return Check(
        "gravity",
        False,
        g.value,
        GRAVITY,
        f"{found}: the scale or stated length is {abs(excess):.1%} too {word}, or the frame rate "
        f"{abs(math.sqrt(1 + excess) - 1):.1%} too {fast}{heavy} (restitution and angles do not depend on that)",
    )


def residual_check(fit: SwingFit) -> Check:
    """Whether the residuals of the swings are as small as the noise from frame to frame."""
    misses, steps = [], []
    for bead, (residual, used) in enumerate(zip(fit.residuals, fit.used, strict=True)):
        swings = used & (fit.tracks[bead].time > (float(fit.swings["time_0"]) if bead else -math.inf))
        left = residual[swings]
        misses.append(left.ravel())
        steps.append(np.diff(left, axis=0).ravel() / math.sqrt(2))
    off, noise = (mad_std(np.concatenate(each), centre=0.0) for each in (misses, steps))
    ratio = off / max(noise, LEAST_NOISE * float(fit.swings["length_0"]))
    passed = ratio < MOST_MISFIT or off < LEAST_MISFIT * float(fit.swings["length_0"])
    message = f"residuals from the fitted swings are {ratio:.2f} times the frame-to-frame noise of the tracks"
    meaning = "" if passed else ": frames are missing or repeated, something touches a bead, or a track is wrong"
    return Check("swing_residuals", passed, ratio, 1.0, message + meaning)


def lens_check(fit: SwingFit) -> Check:
    """Whether lens and perspective exceed those of a usual lens and a careful set-up."""
    lens = 100 * float(fit.swings["lens"])
    askew = 100 * math.hypot(float(fit.swings["perspective_x"]), float(fit.swings["perspective_y"]))
    message = (
        f"one pendulum length from the middle of the picture the scale changes by {lens:+.1f} % (lens) and by up to "
        f"{askew:.1f} % on one side (perspective)"
    )
    meaning = ": photograph a board in the plane of the swing and give --board, or film from further away"
    return Check("lens", not fit.bent, lens, 0.0, message + (meaning if fit.bent else ""))


def pivot_checks(fit: SwingFit) -> tuple[Check, ...]:
    """Whether the stated pivots lie where the swings of the beads have theirs; none if none is stated.

    `fit` is in pixels.
    """
    found = pivots(fit.swings)[:, 0, 0]
    checks = []
    for bead, place in zip("AB", fit.stated.places, strict=False):
        at = found["AB".index(bead)]
        off = float(np.hypot(*(at - np.array(place))))
        passed = off < STATED_OFF * fit.stated.sigma
        message = f"the pivot of bead {bead} lies {off:.1f} px from where it was stated"
        ending = "." if passed else f", at {at[0]:.0f},{-at[1]:.0f} by its swing: correct --pivot or leave it out."
        checks.append(Check("stated_pivot", passed, off, 0.0, message + ending))
    return tuple(checks)


def timing_check(video: Video, losses: Sequence[Loss] = ()) -> Check:
    """Whether frames of the film repeat the one before, or are lost; certain `losses` are corrected already."""
    frames, doubled = video.last - video.first + 1, len(video.skipped - video.excluded)
    message = f"{doubled} of {frames} frames repeat the one before"
    if doubled:
        message = f"doubled frames: {message} and were left out: use the camera's original file"
    message += "".join(f"; {_loss_text(loss)}" for loss in losses)
    return Check("frame_timing", not doubled and all(loss.sure for loss in losses), doubled, 0.0, message)


def _loss_text(loss: Loss) -> str:
    text = f"{loss.in_words} at about {loss.time:.3f} s, which the time stamps do not show"
    if loss.sure:
        return f"{text}: the swings fit after the correction"
    return (
        f"possibly {text}, or the contact lasts long: from there on the phase of the swings is off by that much; "
        "times were not changed: film with a fixed frame rate, or use the camera's original file"
    )


def view_checks(beads: Beads, others: Sequence[Check]) -> tuple[Check, Check]:
    """Whether the beads were seen during their swings, and whether the camera was still or its shake was measured.

    `others` are the checks of the fit: small residuals show a still camera if the scene has no edges.
    """
    shares, count = [], 0
    for images, looked in zip(beads.images, beads.looked, strict=True):
        seen = np.array([image is not None for image in images])
        found = np.flatnonzero(seen)
        if not len(found):
            shares.append(0.0)
            continue
        during = (beads.frames >= beads.frames[found[0]]) & (beads.frames <= beads.frames[found[-1]]) & (looked | seen)
        shares.append(float(np.mean(seen[during])))
        count = max(count, int(np.sum(during)))
    fits = all(check.passed for check in others if check.check == "swing_residuals")
    vouched = "the fitted swings show no shake" if fits else ""
    return bead_in_view(min(shares), count, "its swings"), static_camera(beads.poses, vouched=vouched)


def length_check(found: Outcome, stated: float) -> Check:
    passed = abs(found.value / stated - 1) <= max(0.02, 2.5 * found.std / stated)
    meaning = "" if passed else ": the scale is wrong, or the stated length is not from hinge to bead centre"
    message = f"the beads swing on circles of {found.value * 1e3:.1f} mm, {stated * 1e3:.1f} mm are stated{meaning}"
    return Check("length", passed, found.value, stated, message)


def distance_check(found: Outcome, diameter: float) -> Check:
    passed = abs(found.value / diameter - 1) <= max(0.06, 2.5 * found.std / diameter)
    meaning = "" if passed else ": the scale or the stated diameter is wrong, or the beads hit off centre"
    message = (
        f"the centres are {found.value * 1e3:.2f} mm apart at the collision, beads of {diameter * 1e3:.2f} mm{meaning}"
    )
    return Check("contact_distance", passed, found.value, diameter, message)
