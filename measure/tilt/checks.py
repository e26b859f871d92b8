"""What speaks for and against a measured onset: gravity, proportions, the kind of motion, rest before it, the fit."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.quantity import Check
from rigtwin.measure.tilt.onset import FACTOR, USUAL_DRIFT, Onset, Variant, Way, jitter, smooth_angle

LIKELY = math.log(20)  # odds from which on one kind of motion is believed rather than the other
LEAST_KINETIC = 0.5  # kinetic friction over static, of what slides
SQUEEZED = 1.5  # widest that usual shapes of pixels make a picture, and narrowest, when they are taken for square
FOLLOWED = 0.03  # of a body's size, to which light and pixels let it be followed while the plate turns under it
SAME_FRICTION = 0.02  # relative, how far friction of what rolls may be off at its start
RESIDUALS = 6  # times the noise, that a body may leave the fitted run by
LEAST_REST = 6  # frames before the onset: for place, drift, a creep's speed and beginning, the onset, and one to spare
BEGIN_EARLIER = "Let the record begin at least 0.2 s before the body lets go."
FASTEST_TILT = math.radians(10)  # [rad/s], beyond it one frame is too much of an angle


def checks_of(way: Way, onset: Onset, variant: Variant, bead_diameter: float | None) -> tuple[Check | str, ...]:
    """Checks of a record and its onset; a sentence instead where one cannot be made."""
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
    """Whether the body runs as gravity makes it run at this angle, or why that is not known."""
    if not math.isfinite(way.scale_doubt):
        return "frame rate not confirmed: without a scale the run's acceleration tells none; give the bead's diameter."
    doubt = _gain_doubt(way, onset)
    how = "slides" if variant == "slide" else "rolls"
    least = LEAST_KINETIC * math.tan(onset.angle)
    if onset.moving_friction + 2 * onset.moving_sigma < least:
        # a run that is told too fast has an acceleration that hardly any friction is left for
        ratio = onset.moving_friction / math.tan(onset.angle)
        message = (
            f"in motion the body's friction would be {ratio:.2f} times that at rest, less than what {how} loses: the "
            "scale or the frame rate is too high, or something pulls the body."
        )
        return Check("gravity", False, ratio, 1.0, message)
    passed = abs(onset.gain - 1) < 3 * doubt
    found = (
        f"the body's acceleration grows with the angle as {onset.gain:.3f} ± {doubt:.3f} times that of one that {how}"
    )
    ending = "scale and frame rate fit" if passed else "the scale, the frame rate or the variant is wrong"
    return Check("gravity", passed, onset.gain, 1.0, f"{found}: {ending}.")


def _proportions_check(way: Way, onset: Onset, falls_as_it_should: bool) -> Check:
    """Whether the picture is as wide as it is high: a squeezed one shows another angle.

    There the plate grows longer or shorter as it turns, and a body that rests on it wanders along it in step with the
    angle, while it runs down as if gravity were another one by the square of the squeeze.
    """
    # over a small turn a wander and a creep look alike in the fit, and a plain line through the rest knows no creep
    rests = way.time < onset.time - 2 * onset.time_sigma
    turn = max(float(np.ptp(way.angle[rests])), 1e-3) if np.any(rests) else math.inf
    seen = max(onset.axis, _wander(way.angle[rests], way.down[rests]))
    sure = way.drift + 3 * onset.axis_sigma
    if seen < -sure - FOLLOWED * way.drift / turn:  # down the plate it might creep, but nothing creeps uphill
        message = (
            f"the body at rest wanders up the plate by {-1e3 * seen:.1f} ± {1e3 * onset.axis_sigma:.1f} mm for a "
            f"radian of its rise, of which a hinge not quite found explains {1e3 * way.drift:.0f}: are widths "
            "squeezed, as in a clip whose pixels are not square? Then all angles are wrong; give it with square ones."
        )
        return Check("proportions", False, seen, 0.0, message)
    # how much less than at rest the body is held back, half of it at most, tells least of a run that is too fast
    start = math.tan(onset.angle)
    strong = max(onset.gain, (start - onset.moving_friction) / ((1 - LEAST_KINETIC) * start))
    squeeze = math.sqrt(strong if strong > 1 else onset.gain)
    wander = -way.reach * _lengthening(onset.angle, squeeze)
    if falls_as_it_should or not 1 / SQUEEZED < squeeze < SQUEEZED or abs(onset.axis - wander) > sure:
        return Check("proportions", True, seen, 0.0, "nothing speaks for widths that are squeezed.")
    message = (
        "that the body does not run as gravity makes it may be for the scale or the frame rate, on which no angle "
        f"hangs, or for a record {squeeze:.2f} times as wide as it should be, in which all angles are wrong; the "
        "plate turns too little to tell which. Is a bead as wide as it is high?"
    )
    return Check("proportions", False, seen, 0.0, message)


def _wander(angle: Array, down: Array) -> float:
    """[m/rad], slope of a body's way over the plate's angle."""
    if len(angle) < LEAST_REST or np.ptp(angle) == 0:
        return 0.0
    return float(np.polyfit(angle - angle.mean(), down, 1)[0])


def _lengthening(angle: float, squeeze: float) -> float:
    """By how much of its length a plate grows for every radian that it rises, in a picture `squeeze` times as wide.

    `angle` [rad] is the one that this picture shows, in which (cos a / squeeze)^2 + sin^2 a is one over the length^2.
    """
    level, high = (math.cos(angle) / squeeze) ** 2, math.sin(angle) ** 2
    return (1 / squeeze**2 - 1) * math.sin(angle) * math.cos(angle) / (level + high)


def _variant_check(way: Way, onset: Onset, variant: Variant) -> Check | str:
    """Whether the run is rather that of a body that moves the other way, or why that is not known."""
    instead: Variant = "roll" if variant == "slide" else "slide"
    odds = _log_odds(way, onset, variant) - _log_odds(way, onset, instead)
    believed = odds > -LIKELY
    told_by = "the friction in motion"
    if math.isfinite(way.scale_doubt):
        told_by = f"its acceleration and {told_by}"
    if not believed:
        message = f"by {told_by} the body seems to {instead}; give --variant {instead}."
    elif odds > LIKELY:
        message = f"by {told_by} the body {variant}s, as stated."
    else:
        return (
            f"not confirmed: neither acceleration nor friction in motion tells whether the body {variant}s, as stated; "
            f"that the coefficient is one of {'sliding' if variant == 'slide' else 'rolling'} hangs on --variant alone."
        )
    return Check("variant", believed, onset.gain, 1.0, message)


def _log_odds(way: Way, onset: Onset, moving: Variant) -> float:
    """Logarithm of the likelihood of this run for a body that moves so.

    A ball that rolls is held back by the same friction when it starts and after; one that slides by less once it moves,
    by how much is not known beforehand.  The acceleration tells as far as the scale is known.
    """
    from scipy.stats import norm

    doubt = _gain_doubt(way, onset)
    log = 0.0
    if math.isfinite(doubt):
        log -= 0.5 * ((onset.gain * way.factor / FACTOR[moving] - 1) / doubt) ** 2
    start = math.tan(onset.angle)
    ratio = onset.moving_friction / start
    sigma = math.hypot(onset.moving_sigma / start, SAME_FRICTION)
    if moving == "roll":
        return log + float(norm.logpdf(ratio, 1, sigma))
    share = norm.cdf((1 - ratio) / sigma) - norm.cdf((LEAST_KINETIC - ratio) / sigma)
    return log + math.log(max(float(share), 1e-12) / (1 - LEAST_KINETIC))


def _gain_doubt(way: Way, onset: Onset) -> float:
    return math.hypot(onset.gain_sigma, way.scale_doubt, 0.02)


def _creep_check(onset: Onset, bead_diameter: float | None) -> Check:
    crept = onset.creep
    sure = crept > 3 * onset.creep_sigma and crept > 3 * onset.noise
    limit = 0.3 * (bead_diameter or USUAL_DRIFT)
    passed = not sure or crept < limit
    if not sure:
        message = "the body rests until the onset."
    else:
        message = f"the body creeps by {crept * 1e3:.2f} mm before the onset; the creep is fitted and left out."
    if not passed:
        message += " That is much, as on a plate that is knocked or wet; read the onset from the record."
    return Check("creep", passed, crept if sure else 0.0, 0.0, message)


def _rise_check(way: Way, onset: Onset) -> Check:
    """A plate that rises slowly and without shaking."""
    rough = float(np.std(way.angle - smooth_angle(way.time, way.angle)))
    passed = rough < math.radians(0.15) and abs(onset.rate) < FASTEST_TILT
    rate = math.degrees(onset.rate)
    message = f"the plate rises by {rate:.2f} deg/s at the onset and shakes by {math.degrees(rough):.3f} deg"
    ending = "." if passed else ": too fast or too unsteady for a sharp onset; tilt the plate more slowly."
    return Check("steady_rise", passed, math.degrees(onset.rate), 0.0, message + ending)


def _residual_check(way: Way, onset: Onset) -> Check:
    # the noise of a run counts as that of a body at rest, by how much less well it is stated to be seen
    stated = way.sigma[onset.used & (way.time < onset.time) & np.isfinite(way.sigma)]
    expected = max(jitter(way.down[onset.used]), 1.5e-5 * float(np.ptp(way.down)), 1e-7)
    if len(stated):
        expected = max(expected, float(np.median(stated)))
    ratio = onset.noise / expected
    passed = ratio < RESIDUALS
    meaning = "as its frame-to-frame noise tells" if ratio < 3 else f"where up to {RESIDUALS} times are let pass"
    ending = "." if passed else ": it does not run freely; look at its record before trusting the onset."
    return Check(
        "run_residuals",
        passed,
        ratio,
        1.0,
        f"the body leaves the fitted run by {ratio:.1f} times its noise, {meaning}{ending}",
    )


def _certainty_check(onset: Onset, way: Way) -> Check:
    frame = float(np.median(np.diff(way.time)))
    sigma = math.degrees(onset.angle_sigma)
    passed = sigma < 0.5
    message = f"the onset is known to {sigma:.3f} degrees and {onset.time_sigma / frame:.1f} frames"
    ending = "." if passed else ": too little of the rest or of the run is seen; record both, at a higher rate."
    return Check("onset_certainty", passed, sigma, 0.0, message + ending)


def _rest_check(onset: Onset, way: Way) -> Check:
    """Whether the record begins before the onset: a body that is under way already has none in it."""
    before = int(np.sum(way.time < onset.time))
    start = float(way.time[0])
    if onset.under_way >= -LIKELY:
        message = (
            f"the body comes down from the first frame on ({start:.3f} s): the onset may lie before. {BEGIN_EARLIER}"
        )
        return Check("rest_seen", False, float(before), float(LEAST_REST), message)
    passed = before >= LEAST_REST
    message = f"the body rests from {start:.3f} s to the onset, in {before} frames"
    ending = "." if passed else f", too few to tell rest from creep. {BEGIN_EARLIER}"
    return Check("rest_seen", passed, float(before), float(LEAST_REST), message + ending)
