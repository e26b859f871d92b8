"""Scale and roll of a drop film: scale from a rule in view, the bead's diameter, or gravity."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.camera import Camera
from rigtwin.lab.quantity import root_sum_of_squares
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.drop.bounce_fit import Bounces
from rigtwin.measure.drop.checks import contradiction, other_rate, scales_agree
from rigtwin.measure.drop.sideways_motion import fit_sideways
from rigtwin.measure.tracking.follow import Chase

SCALE_UNCERTAINTY = 0.005  # relative standard uncertainty of a scale read off a rule in view
RIM_UNCERTAINTY = 0.12  # [px], standard uncertainty of the position of the rim of a bead's image
GRAVITY_UNCERTAINTY = 4e-4  # relative standard uncertainty of the gravitational acceleration where it was not measured
# relative standard uncertainty of a radius from a detected spot: blur adds to it, a bright side may be missing
SPOT_UNCERTAINTY = 0.15


@dataclass(frozen=True)
class Gauge:
    """Scale of a film and the direction of gravity in it."""

    scale: float  # [m/px]
    uncertainty: float  # relative standard uncertainty of the scale
    source: str
    roll: float  # [rad], positive when the scene looks turned clockwise
    roll_uncertainty: float  # [rad]
    cross_check: str  # comparison with the other scales, for messages
    gravity: tuple[float, float] | None  # [m/s^2] and its uncertainty, if the scale is independent of gravity
    contradiction: str  # message if the scales of gravity and of the bead's diameter disagree, else empty
    fall: tuple[float, float]  # [rad], roll from the direction of the bead's fall, and its standard uncertainty


def find_gauge(pixels: Track, fitted: Bounces, seen: Chase, camera: Camera, bead_diameter: float | None) -> Gauge:
    """The most reliable scale available, compared with the others, and the direction of gravity."""
    roll, roll_uncertainty = fall = _roll(pixels, fitted)
    text = (
        f"gravity points {math.degrees(roll):+.2f} ± {math.degrees(roll_uncertainty):.2f} degrees "
        "off the picture's vertical"
    )
    if camera.roll is not None:
        text += f", {math.degrees(camera.roll):+.2f} were given"
        roll, roll_uncertainty = camera.roll, 0.0
    by_gravity, gravity_uncertainty = scale_by_gravity(fitted, roll)
    if camera.given_scale is not None:
        uncertainty = camera.scale_uncertainty(SCALE_UNCERTAINTY)
        return Gauge(camera.given_scale, uncertainty, camera.scale_from, roll, roll_uncertainty, text, None, "", fall)
    if bead_diameter is None:
        return Gauge(by_gravity, gravity_uncertainty, "gravity", roll, roll_uncertainty, text, None, "", fall)
    by_bead = bead_diameter / (2 * seen.radius)
    bead_uncertainty = radius_uncertainty(seen)
    text += (
        f"; the bead's diameter gives {by_bead * 1e3:.4g} mm/px (± {100 * bead_uncertainty:.1f} %), "
        f"gravity {by_gravity * 1e3:.4g} mm/px"
    )
    ratio, ratio_uncertainty = by_bead / by_gravity, math.hypot(bead_uncertainty, gravity_uncertainty)
    judged = GRAVITY * ratio, GRAVITY * ratio * ratio_uncertainty
    if camera.frame_rate is None:
        return Gauge(by_bead, bead_uncertainty, "bead diameter", roll, roll_uncertainty, text, None, "", fall)
    if scales_agree(ratio, ratio_uncertainty):
        if gravity_uncertainty >= bead_uncertainty:
            return Gauge(by_bead, bead_uncertainty, "bead diameter", roll, roll_uncertainty, text, None, "", fall)
        source = "gravity, agreeing with the bead's diameter"
        return Gauge(by_gravity, gravity_uncertainty, source, roll, roll_uncertainty, text, judged, "", fall)
    off = contradiction(ratio, ratio_uncertainty, camera.frame_rate, bead_diameter)
    # either scale may be right; the other one is then two standard uncertainties off
    uncertainty = math.hypot(ratio_uncertainty, 0.5 * math.log(ratio))
    if other_rate(camera.frame_rate, judged[0]) is not None:
        return Gauge(
            by_bead, uncertainty, "bead diameter, against gravity", roll, roll_uncertainty, text, judged, off, fall
        )
    # no usual confusion of capture rates explains it: more likely the rim of the bead was misjudged
    return Gauge(
        by_gravity, uncertainty, "gravity, against the bead's diameter", roll, roll_uncertainty, text, judged, off, fall
    )


def scale_by_gravity(fitted: Bounces, roll: float) -> tuple[float, float]:
    """Scale [m/px] from the fall in a picture of this roll [rad], and its relative standard uncertainty."""
    size, parts = fitted.read(lambda at: at.size * math.cos(roll))
    return math.cos(roll) ** 2 / size, math.hypot(root_sum_of_squares(parts) / size, GRAVITY_UNCERTAINTY)


def radius_uncertainty(seen: Chase) -> float:
    """Relative standard uncertainty of the bead's radius.

    Large where a lit or dark side of the bead merges with the background, or no rim could be fitted.
    """
    if seen.look is None:
        return SPOT_UNCERTAINTY
    contrasts = [abs(sighting.image.contrast) for sighting in seen.sightings]
    contrast = max(float(np.median(contrasts)), 1.0)
    shade = math.hypot(*seen.look.light[1:3]) / contrast
    return math.hypot(RIM_UNCERTAINTY / seen.radius, 0.01, 0.025 * min(shade, 4.0))


def _roll(pixels: Track, fitted: Bounces) -> tuple[float, float]:
    """Angle of gravity against the picture's vertical and its standard uncertainty [rad], from the bend of x(t)."""
    used = fitted.used
    sideways = fit_sideways(pixels.time[used], pixels.position[used, 0], fitted.contact_times, fitted.apex_times)
    pull = GRAVITY * fitted.model.reader(fitted.parameters).size
    # off the camera's axis the scale changes with height, which bends x(t) by about a tenth of a degree
    return math.atan(sideways.bend / pull), math.hypot(sideways.bend_uncertainty / pull, math.radians(0.2))


def to_metres(pixels: Track, fitted: Bounces, gauge: Gauge) -> Track:
    """The track turned upright and scaled to metres, with the first contact as origin."""
    first = fitted.contact_times[0]
    used = fitted.used
    x0 = float(np.interp(first, pixels.time[used], pixels.position[used, 0]))
    y0 = float(fitted.level(np.array([first]))[0])
    x, y = pixels.position[:, 0] - x0, pixels.position[:, 1] - y0
    cos, sin = math.cos(gauge.roll), math.sin(gauge.roll)
    # undo the clockwise roll of the scene
    upright = np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)
    return Track(pixels.time, gauge.scale * upright, gauge.scale * pixels.sigma)
