"""Checks of a measured onset: gravity, proportions, kind of motion, creep, rise, residuals, certainty, rest."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.quantity import Check
from rigtwin.measure.tilt.onset import FACTOR, USUAL_DRIFT, Onset, Variant, Way, jitter, smooth_angle

LIKELY = math.log(20)  # log odds beyond which one kind of motion is accepted against the other
LEAST_KINETIC = 0.5  # minimum kinetic friction over static friction of a sliding body
SQUEEZED = 1.5  # largest distortion (either way) if pixels of usual shapes are taken for square
FOLLOWED = 0.03  # tracking error over the body's size due to lighting and pixels while the plate turns
SAME_FRICTION = 0.02  # relative uncertainty of the ratio of rolling friction at the start and in motion
RESIDUALS = 6  # largest residual of the fitted run over the noise
LEAST_REST = 6  # minimum frames before the onset: position, drift, speed and start of a creep, onset, and one more
BEGIN_EARLIER = "Let the record begin at least 0.2 s before the body lets go."
FASTEST_TILT = math.radians(10)  # [rad/s], beyond it the angle changes too much in one frame


def checks_of(way: Way, onset: Onset, variant: Variant, bead_diameter: float | None) -> tuple[Check | str, ...]:
    """Checks of a record and its onset; a text instead of a check that is not possible."""
    gravity = _gravity_check(way, onset, variant)
    return (
        gravity,
        _proportions_check(way, onset, isinstance(gravity, str) or gravity.passed),
        _variant_check(way, onset, variant),
        _creep_check(onset, bead_diameter),
        _rise_check(way, onset),
        _residual_check(way, onset),
        _certainty_check(onset, way),
        _rest_check(onset, way),
    )


def _gravity_check(way: Way, onset: Onset, variant: Variant) -> Check | str:
    """Whether the acceleration of the body agrees with gravity at this angle, or a text if that is not known."""
    if not math.isfinite(way.scale_uncertainty):
        return "frame rate not confirmed: that needs a scale for the acceleration; give the bead's diameter."
    sigma = _gain_sigma(way, onset)
    how = "slides" if variant == "slide" else "rolls"
    least = LEAST_KINETIC * math.tan(onset.angle)
    if onset.moving_friction + 2 * onset.moving_sigma < least:
        # with a scale or frame rate that is too high, the acceleration leaves hardly any friction
        ratio = onset.moving_friction / math.tan(onset.angle)
        message = (
            f"in motion the body's friction would be {ratio:.2f} times that at rest, too little for a body that {how}: "
            "the scale or the frame rate is too high, or something pulls the body."
        )
        return Check("gravity", False, ratio, 1.0, message)
    passed = abs(onset.gain - 1) < 3 * sigma
    found = f"the acceleration grows with the angle as {onset.gain:.3f} ± {sigma:.3f} times that of a body that {how}"
    ending = "scale and frame rate fit" if passed else "the scale, the frame rate or the variant is wrong"
    return Check("gravity", passed, onset.gain, 1.0, f"{found}: {ending}.")


def _proportions_check(way: Way, onset: Onset, falls_as_it_should: bool) -> Check:
    """Whether horizontal and vertical scale agree; otherwise the angle is wrong.

    In a squeezed picture the plate changes its length as it turns.  A body at rest on it then moves along the plate in
    proportion to the angle, and the apparent gravity of its run changes by the square of the squeeze.
    """
    # over a small turn drift and creep are alike in the fit; a line through the rest ignores creep
    rests = way.time < onset.time - 2 * onset.time_sigma
    turn = max(float(np.ptp(way.angle[rests])), 1e-3) if np.any(rests) else math.inf
    seen = max(onset.axis, _wander(way.angle[rests], way.down[rests]))
    sure = way.drift + 3 * onset.axis_sigma
    if seen < -sure - FOLLOWED * way.drift / turn:  # motion downhill may be creep, motion uphill not
        message = (
            f"the body at rest moves up the plate by {-1e3 * seen:.1f} ± {1e3 * onset.axis_sigma:.1f} mm per radian "
            f"of its rise, of which the uncertainty of the hinge explains {1e3 * way.drift:.0f} mm: are widths "
            "squeezed, as in a clip whose pixels are not square? Then all angles are wrong; use square pixels."
        )
        return Check("proportions", False, seen, 0.0, message)
    # lower limit of the excess acceleration: friction drops by at most half when motion starts
    start = math.tan(onset.angle)
    strong = max(onset.gain, (start - onset.moving_friction) / ((1 - LEAST_KINETIC) * start))
    squeeze = math.sqrt(strong if strong > 1 else onset.gain)
    wander = -way.reach * _lengthening(onset.angle, squeeze)
    if falls_as_it_should or not 1 / SQUEEZED < squeeze < SQUEEZED or abs(onset.axis - wander) > sure:
        return Check("proportions", True, seen, 0.0, "no sign of squeezed widths was found.")
    message = (
        "the acceleration of the body does not agree with gravity: either the scale or the frame rate is wrong, which "
        f"does not affect the angles, or the record is {squeeze:.2f} times as wide as it should be, and all angles "
        "are wrong; the plate turns too little to decide. Is a bead as wide as it is high?"
    )
    return Check("proportions", False, seen, 0.0, message)


def _wander(angle: Array, down: Array) -> float:
    """Slope of a body's displacement over the plate's angle [m/rad]."""
    if len(angle) < LEAST_REST or np.ptp(angle) == 0:
        return 0.0
    return float(np.polyfit(angle - angle.mean(), down, 1)[0])


def _lengthening(angle: float, squeeze: float) -> float:
    """Relative change of a plate's length per radian of its rise, in a picture `squeeze` times as wide.

    `angle` [rad] is the apparent one in this picture, with (cos a / squeeze)^2 + sin^2 a = 1 / length^2.
    """
    level, high = (math.cos(angle) / squeeze) ** 2, math.sin(angle) ** 2
    return (1 / squeeze**2 - 1) * math.sin(angle) * math.cos(angle) / (level + high)


def _variant_check(way: Way, onset: Onset, variant: Variant) -> Check | str:
    """Whether the run agrees with the stated kind of motion, or a text if that is not known."""
    instead: Variant = "roll" if variant == "slide" else "slide"
    odds = _log_odds(way, onset, variant) - _log_odds(way, onset, instead)
    believed = odds > -LIKELY
    evidence = "the friction in motion"
    if math.isfinite(way.scale_uncertainty):
        evidence = f"its acceleration and {evidence}"
    if not believed:
        message = f"by {evidence} the body seems to {instead}; give --variant {instead}."
    elif odds > LIKELY:
        message = f"by {evidence} the body {variant}s, as stated."
    else:
        return (
            f"not confirmed: neither acceleration nor friction in motion shows whether the body {variant}s, as stated; "
            f"that the coefficient is for {'sliding' if variant == 'slide' else 'rolling'} depends on --variant alone."
        )
    return Check("variant", believed, onset.gain, 1.0, message)


def _log_odds(way: Way, onset: Onset, moving: Variant) -> float:
    """Log likelihood of this run for a kind of motion.

    The friction of a rolling ball is the same at the start and in motion; that of a sliding body drops by an unknown
    amount once it moves.  The acceleration contributes if the scale is known.
    """
    from scipy.stats import norm

    gain_sigma = _gain_sigma(way, onset)
    log = 0.0
    if math.isfinite(gain_sigma):
        log -= 0.5 * ((onset.gain * way.factor / FACTOR[moving] - 1) / gain_sigma) ** 2
    start = math.tan(onset.angle)
    ratio = onset.moving_friction / start
    sigma = math.hypot(onset.moving_sigma / start, SAME_FRICTION)
    if moving == "roll":
        return log + float(norm.logpdf(ratio, 1, sigma))
    share = norm.cdf((1 - ratio) / sigma) - norm.cdf((LEAST_KINETIC - ratio) / sigma)
    return log + math.log(max(float(share), 1e-12) / (1 - LEAST_KINETIC))


def _gain_sigma(way: Way, onset: Onset) -> float:
    return math.hypot(onset.gain_sigma, way.scale_uncertainty, 0.02)


def _creep_check(onset: Onset, bead_diameter: float | None) -> Check:
    crept = onset.creep
    sure = crept > 3 * onset.creep_sigma and crept > 3 * onset.noise
    limit = 0.3 * (bead_diameter or USUAL_DRIFT)
    passed = not sure or crept < limit
    if not sure:
        message = "the body rests until the onset."
    else:
        message = f"the body creeps by {crept * 1e3:.2f} mm before the onset; the creep was fitted and removed."
    if not passed:
        message += " That is much, as on a plate that was knocked or is wet; check the onset in the record."
    return Check("creep", passed, crept if sure else 0.0, 0.0, message)


def _rise_check(way: Way, onset: Onset) -> Check:
    """Whether the plate rises slowly and smoothly."""
    rough = float(np.std(way.angle - smooth_angle(way.time, way.angle)))
    passed = rough < math.radians(0.15) and abs(onset.rate) < FASTEST_TILT
    rate = math.degrees(onset.rate)
    message = f"the plate rises by {rate:.2f} deg/s at the onset and shakes by {math.degrees(rough):.3f} deg"
    ending = "." if passed else ": too fast or too unsteady for a sharp onset; tilt the plate more slowly."
    return Check("steady_rise", passed, math.degrees(onset.rate), 0.0, message + ending)


def _residual_check(way: Way, onset: Onset) -> Check:
    # expected noise of a body at rest, to which the noise of the fit refers
    stated = way.sigma[onset.used & (way.time < onset.time) & np.isfinite(way.sigma)]
    expected = max(jitter(way.down[onset.used]), 1.5e-5 * float(np.ptp(way.down)), 1e-7)
    if len(stated):
        expected = max(expected, float(np.median(stated)))
    ratio = onset.noise / expected
    passed = ratio < RESIDUALS
    meaning = "within its frame-to-frame noise" if ratio < 3 else f"where up to {RESIDUALS} are allowed"
    ending = "." if passed else ": it does not run freely; check its record before using the onset."
    return Check(
        "run_residuals",
        passed,
        ratio,
        1.0,
        f"residuals from the fitted run are {ratio:.1f} times the noise, {meaning}{ending}",
    )


def _certainty_check(onset: Onset, way: Way) -> Check:
    frame = float(np.median(np.diff(way.time)))
    sigma = math.degrees(onset.angle_sigma)
    passed = sigma < 0.5
    message = f"the onset is known to {sigma:.3f} degrees and {onset.time_sigma / frame:.1f} frames"
    ending = "." if passed else ": too little of the rest or of the run is seen; record both, at a higher frame rate."
    return Check("onset_certainty", passed, sigma, 0.0, message + ending)


def _rest_check(onset: Onset, way: Way) -> Check:
    """Whether the record begins before the onset, with enough frames of rest."""
    before = int(np.sum(way.time < onset.time))
    start = float(way.time[0])
    if onset.under_way >= -LIKELY:
        message = (
            f"the body moves down from the first frame on ({start:.3f} s): the onset may lie before. {BEGIN_EARLIER}"
        )
        return Check("rest_seen", False, float(before), float(LEAST_REST), message)
    passed = before >= LEAST_REST
    message = f"the body rests from {start:.3f} s to the onset, in {before} frames"
    ending = "." if passed else f", too few to distinguish rest from creep. {BEGIN_EARLIER}"
    return Check("rest_seen", passed, float(before), float(LEAST_REST), message + ending)
