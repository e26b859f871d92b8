"""Evaluate a body that runs down a plate at rest: friction in motion from its acceleration.

The body obeys s'' = f g (sin a - m cos a), with f = 1 for sliding and 5/7 for a ball that rolls without slip, the
angle a of the plate, and the friction m in motion.  Nothing is said of the friction at rest: the angle at which the
body would let go by itself is not seen.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.quantity import Check, Evaluation, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.robust import autocorrelation_factor, mad_std
from rigtwin.measure.tilt.onset import LEAST_TURN, Run, Variant, Way, find_run, jitter

FRICTION_IN_MOTION = {"slide": "kinetic_friction", "roll": "rolling_friction"}

LEAST_FRAMES = 8  # of the run: place, speed and acceleration, with some left to judge the fit
OUTLIER = 4.0  # scatters from the parabola beyond which a point is none of the run
STEADY = 4.0  # scatter about the parabola over the noise beyond which the acceleration is not constant
TRACKED = 2e-3  # error of a track relative to its length: lighting and pixels change along the way

RESTS_ON = {"arm_in_view", "shape", "static_camera", "level", "camera_roll"}
FRICTION_RESTS_ON = RESTS_ON | {"constant_acceleration", "gravity", "compression", "bead_size"}


@dataclass(frozen=True)
class Descent:
    """A run down a plate at rest, and the parabola through it."""

    start: float  # [s], begin of the run
    end: float  # [s]
    angle: float  # [rad], of the plate
    angle_sigma: float  # [rad], of its mean over the record
    acceleration: float  # [m/s^2], along the plate
    acceleration_sigma: float  # [m/s^2], of the fit alone
    noise: float  # [m], scatter from point to point
    scatter: float  # [m], scatter about the parabola
    length: float  # [m], of the run
    fitted: Array  # [m], the parabola at every point of the record, NaN outside the run


def at_rest(way: Way) -> bool:
    """Whether the plate stands still while the body runs, and turns by less than the least turn in all."""
    return float(np.ptp(_smoothed(way.angle))) < LEAST_TURN


def _smoothed(angle: Array) -> Array:
    """Mean over a tenth of the record: noise is no turn."""
    width = max(len(angle) // 10, 1)
    return np.convolve(angle, np.full(width, 1 / width), mode="valid")


def descent_of(way: Way, whose: str) -> Descent:
    """The run of a body down a plate at rest.

    Parameters
    ----------
    way : Way
        Displacement of the body down the plate.
    whose : str
        Name of the record in messages.

    Returns
    -------
    Descent

    Raises
    ------
    NothingToMeasure
        If the body stays where it is, or its run has fewer than eight points.
    """
    run = find_run(way)
    angle = float(np.median(way.angle))
    if run is None:
        moved = 1e3 * float(np.ptp(way.down))
        raise NothingToMeasure(
            f"{whose}: the plate stands still at {math.degrees(angle):.1f} degrees, and the body moves by no more than "
            f"{moved:.2g} mm; film a plate that is tilted, or one so steep that the body runs down."
        )
    if run.end - run.start < LEAST_FRAMES:
        raise NothingToMeasure(
            f"{whose}: the plate stands still, and the body runs down it in only {run.end - run.start} frames "
            f"({way.time[run.start]:.3f} to {way.time[run.end]:.3f} s); its acceleration needs {LEAST_FRAMES}: film at "
            "a higher frame rate or a longer run."
        )
    time, down = way.time[run.start : run.end], way.down[run.start : run.end]
    design = np.vander(time - time.mean(), 3, increasing=True)
    answer, miss, kept = _robust(design, down)
    count = int(kept.sum())
    scatter = math.sqrt(float(np.sum(miss[kept] ** 2)) / (count - 3))
    more = autocorrelation_factor(miss[kept], count // 3)
    covariance = np.linalg.inv(design[kept].T @ design[kept]) * scatter**2 * more
    fitted = np.full(len(way.time), np.nan)
    fitted[run.start : run.end] = design @ answer
    return Descent(
        float(time[0]),
        float(time[-1]),
        angle,
        _sigma_of_mean(way.angle),
        2 * float(answer[2]),
        2 * math.sqrt(float(covariance[2, 2])),
        max(jitter(down), 1e-9),
        scatter,
        _length(way, run),
        fitted,
    )


def _robust(design: Array, values: Array) -> tuple[Array, Array, Array]:
    """Least squares without single outliers: answer, residuals, and which points were kept."""
    kept = np.ones(len(values), dtype=bool)
    answer, miss = np.zeros(design.shape[1]), values
    for _ in range(3):
        answer = np.asarray(np.linalg.lstsq(design[kept], values[kept], rcond=None)[0], dtype=np.float64)
        miss = values - design @ answer
        kept = np.abs(miss) <= OUTLIER * max(mad_std(miss), 1e-12)
    return answer, miss, kept


def _sigma_of_mean(angle: Array) -> float:
    residual = angle - np.median(angle)
    factor = autocorrelation_factor(residual, max(len(residual) // 5, 2))
    return mad_std(residual) * math.sqrt(factor / len(residual))


def _length(way: Way, run: Run) -> float:
    return float(way.down[run.end - 1] - way.down[run.start])


def evaluate_descent(
    descent: Descent, variant: Variant, scale_uncertainty: float, geometry: Mapping[str, float] | None = None
) -> Evaluation:
    """Friction in motion and the angle of a plate at rest.

    Parameters
    ----------
    descent : Descent
        The run.
    variant : {"slide", "roll"}
        Kind of motion.
    scale_uncertainty : float
        Relative standard uncertainty of lengths.
    geometry : mapping of str to float, optional
        Further standard uncertainties of the angle [rad].

    Returns
    -------
    Evaluation
        ``kinetic_friction`` (slide) or ``rolling_friction`` (roll) [1] by the method ``acceleration``, ``plate_angle``
        [deg], with checks.

    Raises
    ------
    NothingToMeasure
        If lengths are not known: the acceleration needs a scale.
    """
    if not math.isfinite(scale_uncertainty):
        raise NothingToMeasure(
            f"measure tilt: the plate stands still at {math.degrees(descent.angle):.1f} degrees, so that only the "
            "acceleration of the body shows its friction, and lengths are not known; give --bead-diameter, --scale or "
            "--known-length."
        )
    # inertia: a rolling solid ball gains rotation, too
    pull = {"slide": 1.0, "roll": 5 / 7}[variant] * GRAVITY * math.cos(descent.angle)
    friction = math.tan(descent.angle) - descent.acceleration / pull
    slope = 1 / math.cos(descent.angle) ** 2 - descent.acceleration * math.tan(descent.angle) / pull
    angles = {"plate": descent.angle_sigma, **(geometry or {})}
    budget = {
        "acceleration": descent.acceleration_sigma / pull,
        "scale": scale_uncertainty * abs(descent.acceleration) / pull,
        **{part: abs(slope) * value for part, value in angles.items()},
    }
    degrees = {part: math.degrees(value) for part, value in angles.items()}
    sigma = root_sum_of_squares(budget)
    checks = (_steady_check(descent), _gravity_check(descent, friction, sigma, pull))
    quantities = (
        Quantity(FRICTION_IN_MOTION[variant], friction, sigma, "1", "acceleration", budget=budget),
        Quantity(
            "plate_angle", math.degrees(descent.angle), root_sum_of_squares(degrees), "deg", "edges", budget=degrees
        ),
    )
    still = (
        f"the plate stands still at {math.degrees(descent.angle):.2f} degrees: friction in motion is evaluated, not "
        "the friction at which the body lets go.",
    )
    return Evaluation(judged_of_incline(quantities, checks), checks, still)


def judged_of_incline(quantities: Sequence[Quantity], checks: Sequence[Check]) -> tuple[Quantity, ...]:
    """The quantities, doubtful where a check that they rest on failed."""
    return tuple(
        doubted(one, failed(checks, RESTS_ON if one.quantity == "plate_angle" else FRICTION_RESTS_ON))
        for one in quantities
    )


def _steady_check(descent: Descent) -> Check:
    floor = math.hypot(descent.noise, TRACKED * descent.length)
    passed = descent.scatter < STEADY * floor
    message = (
        f"the run of {1e3 * descent.length:.0f} mm from {descent.start:.3f} to {descent.end:.3f} s scatters by "
        f"{1e3 * descent.scatter:.2g} mm about a constant acceleration"
    )
    ending = "." if passed else ": friction changes on the way, or something touches the body."
    return Check("constant_acceleration", passed, descent.scatter, floor, message + ending)


def _gravity_check(descent: Descent, friction: float, sigma: float, pull: float) -> Check:
    passed = friction > -2 * sigma
    free = pull * math.tan(descent.angle)
    message = f"the acceleration is {descent.acceleration:.3g} m/s^2; without friction it would be {free:.3g} m/s^2"
    ending = "." if passed else ": the scale, the frame rate or the variant is wrong."
    return Check("gravity", passed, descent.acceleration, free, message + ending)
