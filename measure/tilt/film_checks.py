"""Checks of a tilt film: shape of the body, rest, view of the plate, frame timing, horizontal."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.lab.quantity import Check
from rigtwin.measure.bulk.checks import size_seen
from rigtwin.measure.geometry.camera_roll import roll_check
from rigtwin.measure.media.time_base import UNSTEADY
from rigtwin.measure.media.video import Video
from rigtwin.measure.tilt.body_track import FEWEST, RestingBody
from rigtwin.measure.tilt.checks import BEGIN_EARLIER
from rigtwin.measure.tilt.observe import BEAD_UNCERTAINTY, Film, Gauge
from rigtwin.measure.tilt.onset import (
    Onset,
    Variant,
)

CLUMP = 2.3  # length over height of a body beyond which it is no single bead, even if smeared by creep

MOSTLY = 0.8  # minimum share of frames before the onset in which a missing frame would be detected


def shape_check(body: RestingBody, variant: Variant) -> Check:
    """Whether the shape of the body allows the stated motion: beads glued together do not roll."""
    ratio = body.size[0] / body.size[1]
    passed = variant == "slide" or ratio < CLUMP
    ending = "." if passed else ": it is no single bead, so that it slides; give --variant slide."
    return Check("shape", passed, ratio, 1.0, f"the body is {ratio:.1f} times as long as high{ending}")


def size_check(film: Film, gauge: Gauge, bead_diameter: float | None) -> tuple[Check, ...]:
    """Whether the body is as high as the stated bead; none where its size gives the scale, or there is no scale."""
    if bead_diameter is None or gauge.source == "bead diameter":
        return ()
    most = 3 * math.hypot(BEAD_UNCERTAINTY, gauge.uncertainty)
    source = "--arm-length" if gauge.source == "arm length" else gauge.source
    return (size_seen(film.body.size[1] * gauge.scale, bead_diameter, most, source),)


def portrait_check(film: Film, onset: Onset) -> tuple[Check, ...]:
    """A failed check if the body moves in too many frames from which its picture at rest is made, else none."""
    body = film.body
    resting = int(np.sum(film.times[np.isin(film.frames, body.rests)] < onset.time))
    if resting >= max(FEWEST, len(body.rests) / 2):
        return ()
    message = (
        f"of the {len(body.rests)} frames that show the body at its first position only {resting} are before the "
        f"onset: too little of its rest is seen. {BEGIN_EARLIER}"
    )
    return (Check("picture_at_rest", False, float(resting), float(FEWEST), message),)


def view_checks(film: Film, gauge: Gauge, video: Video, onset: Onset) -> tuple[Check, ...]:
    return arm_check(film), _timing_check(film, video, onset), level_check(film, gauge)


def arm_check(film: Film) -> Check:
    """Whether the plate's edges are seen in most frames."""
    seen = float(np.mean(np.isfinite(film.directions)))
    return Check(
        "arm_in_view",
        seen > 0.8,
        seen,
        1.0,
        f"the plate's edges are found in {100 * seen:.0f} % of the frames"
        + ("." if seen > 0.8 else ": something hides them; keep hands and cables out of the view."),
    )


def _timing_check(film: Film, video: Video, onset: Onset) -> Check:
    """Whether the time stamps are right, as far as the motion of plate and body shows."""
    steps = np.diff(video.times[video.first : video.last + 1])
    odd = int(np.sum(np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)))
    message = f"{odd} of {len(steps)} frame intervals are odd" + ("; the file's own times were used" if odd else "")
    if lost := int(film.missing.sum()):
        at = film.times[film.missing > 0]
        by = {0: "the plate turns", lost: "the body moves"}.get(film.lost_in_run, "plate and body move")
        message += (
            f"; {lost} more {'is' if lost == 1 else 'are'} missing by how far {by} at {at[0]:.3f} s"
            f"{'' if len(at) == 1 else f' and {len(at) - 1} times after'}, and the times were corrected"
        )
    clear = film.shown[film.times < onset.time]
    seen = float(np.mean(clear)) if len(clear) else 0.0
    hidden = (
        f"in {100 * (1 - seen):.0f} % of the frames before the onset the plate turns too little to show a missing one"
    )
    passed = False
    if doubled := film.repeated:
        ending = (
            f", but in the run {doubled} frame{'' if doubled == 1 else 's'} identical to the one before delay "
            "all that follow, so that times are too long: use the camera's original file."
        )
    elif film.lost_in_run:
        # a loss that the plate's turn does not show there may be missed before the onset too
        ending = ", but others may be before the onset, where only the plate moves: use the camera's original file."
    elif odd >= UNSTEADY * len(steps):
        ending = ", but so many may be wrong: use the camera's original file."
    else:
        passed, ending = True, "." if seen >= MOSTLY else f"; {hidden}."
    return Check("frame_timing", passed, float(odd), 0.0, message + ending)


def level_check(film: Film, gauge: Gauge) -> Check:
    """Whether the horizontal is known, and whether a stated one agrees with the base plate."""
    level, edges = gauge.level, len(film.level.lines) if film.level else 0
    degrees, sigma = math.degrees(level.roll), math.degrees(level.sigma)
    if level.source == "not known":
        message = "no level edge of a base plate was found, so the camera is taken to be upright; give --camera-roll."
        return Check("level", False, 0.0, 0.0, message)
    if level.source == "given" and level.seen is not None:
        return roll_check(level.roll, *level.seen, f"{edges} level edges of the base plate run at")
    where = "as given" if level.source == "given" else f"from {edges} level edges"
    message = f"the horizontal runs at {degrees:+.2f} ± {sigma:.2f} deg in the picture, {where}."
    return Check("level", True, degrees, 0.0, message)
