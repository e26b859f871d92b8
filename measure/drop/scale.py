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

SCALE_DOUBT = 0.005  # relative standard uncertainty of a scale read off a rule in view
RIM_DOUBT = 0.12  # [px], standard uncertainty of the position of the rim of a bead's image
# relative standard uncertainty of a radius from a detected spot: blur adds to it, a bright side may be missing
SPOT_DOUBT = 0.15


@dataclass(frozen=True)
class Gauge:
    """Scale of a film and the direction of gravity in it."""

    scale: float  # [m/px]
    doubt: float  # relative standard uncertainty of the scale
    source: str
    roll: float  # [rad], positive when the scene looks turned clockwise
    roll_doubt: float  # [rad]
    cross_check: str  # comparison with the other scales, for messages
    gravity: tuple[float, float] | None  # [m/s^2] and its uncertainty, if the scale is independent of gravity
    contradiction: str  # message if the scales of gravity and of the bead's diameter disagree, else empty
    fall: tuple[float, float]  # [rad], roll from the direction of the bead's fall, and its standard uncertainty


def find_gauge(pixels: Track, fitted: Bounces, seen: Chase, camera: Camera, bead_diameter: float | None) -> Gauge:
    """The most reliable scale available, compared with the others, and the direction of gravity."""
    roll, roll_doubt = fall = _roll(pixels, fitted)
    text = (
        f"gravity points {math.degrees(roll):+.2f} ± {math.degrees(roll_doubt):.2f} degrees off the picture's vertical"
    )
    if camera.roll is not None:
        text += f", {math.degrees(camera.roll):+.2f} were given"
        roll, roll_doubt = camera.roll, 0.0
    size, parts = fitted.read(lambda at: at.size * math.cos(roll))
    by_gravity = math.cos(roll) ** 2 / size
    gravity_doubt = math.hypot(root_sum_of_squares(parts) / size, 4e-4)
    if camera.given_scale is not None:
        doubt = camera.scale_doubt(SCALE_DOUBT)
        return Gauge(camera.given_scale, doubt, camera.scale_from, roll, roll_doubt, text, None, "", fall)
    if bead_diameter is None:
        return Gauge(by_gravity, gravity_doubt, "gravity", roll, roll_doubt, text, None, "", fall)
    by_bead = bead_diameter / (2 * seen.radius)
    bead_doubt = radius_doubt(seen)
    text += (
        f"; the bead's diameter gives {by_bead * 1e3:.4g} mm/px (± {100 * bead_doubt:.1f} %), "
        f"gravity {by_gravity * 1e3:.4g} mm/px"
    )
    ratio, ratio_doubt = by_bead / by_gravity, math.hypot(bead_doubt, gravity_doubt)
    judged = GRAVITY * ratio, GRAVITY * ratio * ratio_doubt
    if camera.frame_rate is None:
        return Gauge(by_bead, bead_doubt, "bead diameter", roll, roll_doubt, text, None, "", fall)
    if scales_agree(ratio, ratio_doubt):
        if gravity_doubt >= bead_doubt:
            return Gauge(by_bead, bead_doubt, "bead diameter", roll, roll_doubt, text, None, "", fall)
        source = "gravity, agreeing with the bead's diameter"
        return Gauge(by_gravity, gravity_doubt, source, roll, roll_doubt, text, judged, "", fall)
    off = contradiction(ratio, ratio_doubt, camera.frame_rate, bead_diameter)
    # either scale may be right; the other one is then two standard uncertainties off
    doubt = math.hypot(ratio_doubt, 0.5 * math.log(ratio))
    if other_rate(camera.frame_rate, judged[0]) is not None:
        return Gauge(by_bead, doubt, "bead diameter, against gravity", roll, roll_doubt, text, judged, off, fall)
    # no usual confusion of capture rates explains it: more likely the rim of the bead was misjudged
    return Gauge(by_gravity, doubt, "gravity, against the bead's diameter", roll, roll_doubt, text, judged, off, fall)


def radius_doubt(seen: Chase) -> float:
    """Relative standard uncertainty of the bead's radius.

    Large where a lit or dark side of the bead merges with the background, or no rim could be fitted.
    """
    if seen.look is None:
        return SPOT_DOUBT
    contrasts = [abs(sighting.image.contrast) for sighting in seen.sightings]
    contrast = max(float(np.median(contrasts)), 1.0)
    shade = math.hypot(*seen.look.light[1:3]) / contrast
    return math.hypot(RIM_DOUBT / seen.radius, 0.01, 0.025 * min(shade, 4.0))


def _roll(pixels: Track, fitted: Bounces) -> tuple[float, float]:
    """Angle of gravity against the picture's vertical and its standard uncertainty [rad], from the bend of x(t)."""
    used = fitted.used
    sideways = fit_sideways(pixels.time[used], pixels.position[used, 0], fitted.contact_times, fitted.apex_times)
    pull = GRAVITY * fitted.model.reader(fitted.parameters).size
    # off the camera's axis the scale changes with height, which bends x(t) by about a tenth of a degree
    return math.atan(sideways.bend / pull), math.hypot(sideways.bend_doubt / pull, math.radians(0.2))


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
