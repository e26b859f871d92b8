"""What speaks for and against a measured pendulum: momentum, gravity, lengths, where it hits, what was left out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.lab.quantity import Check
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.pendulum.swing_fit import Outcome, SwingFit, frame_interval
from rigtwin.measure.pendulum.swing_model import turning_points
from rigtwin.measure.scene.checks import bead_in_view, static_camera

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.measure.media.frame_loss import Loss
    from rigtwin.measure.media.video import Video
    from rigtwin.measure.pendulum.track_two_beads import Beads

MOST_MISFIT = 1.4  # times the noise from frame to frame, that a track may leave the fitted swings by
LEAST_MISFIT = 5e-4  # of the pendulum's length: textures behind a bead shift it by less, and slowly in high-speed films
LEAST_NOISE = 2e-5  # of the pendulum's length: below it a record that is exact would be judged by its rounding


def doubts_of(fit: SwingFit, outcomes: dict[str, Outcome]) -> dict[str, str]:
    """Why the collision, the release angle or the turning angles should not be trusted; empty where nothing is."""
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
        release.append("the record begins at the release: that the bead started from rest is not seen")
    if since < 2 * frame_interval(first):
        # the speed at the hit follows from a fall that is taken to start from rest
        collision.append("the record does not show bead A at rest before its fall")
    _, when = turning_points(swings, 0)
    for bead, track in enumerate(fit.tracks):
        if track.time[-1] < float(when[bead, 0]):
            turning.append(f"the record ends before bead {track.body} turns: its angle is extrapolated")
    return {"collision": "; ".join(collision), "release": "; ".join(release), "turning": "; ".join(turning)}


def _sway(fit: SwingFit) -> float:
    """Speed of bead B in the last moments before the collision [m/s]; 0 where it cannot be told from noise."""
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
    meaning = "" if passed else ": the beads differ in mass, they hit off centre, or a track is wrong"
    return Check("momentum", passed, after, before, found + meaning)


def contact_angle_check(outcomes: dict[str, Outcome]) -> Check:
    """Whether the bead hangs plumb where it touches the wall, as the formula with the two angles supposes."""
    hit = outcomes["contact_angle"]
    angle, doubt = math.degrees(hit.value), math.degrees(hit.std)
    passed = abs(angle) < max(1.0, 3 * doubt)
    found = f"the bead hits the wall {angle:+.2f} ± {doubt:.2f} degrees past the vertical"
    meaning = "" if passed else ": methods velocity and height allow for it, method angle does not"
    return Check("contact_angle", passed, angle, 0.0, found + meaning)


HEAVIEST = 0.5  # by which a rod alone, without a bead, swings faster than a thread of its length


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
    """Whether the swings leave of the tracks what one frame differs by from the next, and not more."""
    misses, steps = [], []
    for bead, (residual, used) in enumerate(zip(fit.residuals, fit.used, strict=True)):
        swings = used & (fit.tracks[bead].time > (float(fit.swings["time_0"]) if bead else -math.inf))
        left = residual[swings]
        misses.append(left.ravel())
        steps.append(np.diff(left, axis=0).ravel() / math.sqrt(2))
    off, noise = (1.4826 * float(np.median(np.abs(np.concatenate(each)))) for each in (misses, steps))
    ratio = off / max(noise, LEAST_NOISE * float(fit.swings["length_0"]))
    passed = ratio < MOST_MISFIT or off < LEAST_MISFIT * float(fit.swings["length_0"])
    message = f"the tracks leave the fitted swings by {ratio:.2f} times their frame-to-frame noise"
    meaning = "" if passed else ": frames are missing or repeated, something touches a bead, or a track is wrong"
    return Check("swing_residuals", passed, ratio, 1.0, message + meaning)


def lens_check(fit: SwingFit) -> Check:
    """Whether the camera's view bends more than a usual lens and a careful set-up make it."""
    lens = 100 * float(fit.swings["lens"])
    askew = 100 * math.hypot(float(fit.swings["perspective_x"]), float(fit.swings["perspective_y"]))
    message = (
        f"one pendulum length from the picture's middle things look {lens:+.1f} % larger through the lens, and up to "
        f"{askew:.1f} % larger on one side"
    )
    meaning = ": photograph a board in the plane of the swing and give --board, or film from further away"
    return Check("lens", not fit.bent, lens, 0.0, message + (meaning if fit.bent else ""))


def timing_check(video: Video, losses: Sequence[Loss] = ()) -> Check:
    """Whether frames of the film repeat the one before them, or are lost; sure `losses` were mended before."""
    frames, doubled = video.last - video.first + 1, len(video.skipped)
    message = f"{doubled} of {frames} frames repeat the one before"
    if doubled:
        message = f"doubled frames: {message} and were left out: use the camera's original file"
    message += "".join(f"; {_told(loss)}" for loss in losses)
    return Check("frame_timing", not doubled and all(loss.sure for loss in losses), doubled, 0.0, message)


def _told(loss: Loss) -> str:
    told = f"{loss.in_words} at about {loss.time:.3f} s, which the times do not tell"
    if loss.sure:
        return f"{told}: the swings are whole once that is put right"
    return (
        f"it seems that {told}, or the contact lasts: from there on the beads are off their swings by that much; times "
        "are left as they are: film with a fixed frame rate, or use the camera's original file"
    )


def view_checks(beads: Beads, others: Sequence[Check]) -> tuple[Check, Check]:
    """Whether the beads were seen all along their swings, and whether the camera stood still or its shake was followed.

    `others` are the checks of the fit: swings that fit show a still camera where nothing else in the picture does.
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
    meaning = "" if passed else ": the scale is off, or the stated length is not from hinge to bead centre"
    message = f"the beads swing on circles of {found.value * 1e3:.1f} mm, {stated * 1e3:.1f} mm are stated{meaning}"
    return Check("length", passed, found.value, stated, message)


def distance_check(found: Outcome, diameter: float) -> Check:
    passed = abs(found.value / diameter - 1) <= max(0.06, 2.5 * found.std / diameter)
    meaning = "" if passed else ": the scale or the stated diameter is off, or the beads hit off centre"
    message = (
        f"the centres are {found.value * 1e3:.2f} mm apart at the collision, beads of {diameter * 1e3:.2f} mm{meaning}"
    )
    return Check("contact_distance", passed, found.value, diameter, message)
