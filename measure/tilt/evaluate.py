"""Evaluate plate angle and body track of a tilt: friction and its angle at the onset of motion, checks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Check, Evaluation, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.records import Series, Track
from rigtwin.measure.tilt.checks import checks_of
from rigtwin.measure.tilt.onset import (
    FACTOR,
    LEAST_TURN,
    LEAST_UNCERTAINTY,
    USUAL_DRIFT,
    Onset,
    Run,
    Variant,
    Way,
    descent,
    find_onset,
    find_run,
    least_run,
)

FRICTION = {"slide": "static_friction", "roll": "rolling_friction"}

NOMINAL = 3e-4  # [m/px], in place of a scale that is not known, until gravity gives one
# relative standard uncertainty of a scale from a length in view, or of a tracked record: the length lies beside the
# plane in which the body moves, 1 cm off at a distance of 0.5 m
NEARBY_LENGTH_UNCERTAINTY = 0.02

WRONG_SCALE = 0.3  # relative misfit of the acceleration beyond which the scale is not used

# checks that affect every quantity
BEHIND_ALL = {
    "variant",
    "creep",
    "steady_rise",
    "run_residuals",
    "rest_seen",
    "picture_at_rest",
    "onset_certainty",
    "shape",
    "arm_in_view",
    "static_camera",
}

# further checks that affect angles
ANGLES_ON = {"level", "camera_roll", "proportions"}

# all checks per quantity: an angle needs neither time base nor scale, the onset time needs no horizontal
RESTS_ON = {
    "static_friction": BEHIND_ALL | ANGLES_ON,
    "static_friction_angle": BEHIND_ALL | ANGLES_ON,
    "rolling_friction": BEHIND_ALL | ANGLES_ON,
    "rolling_friction_angle": BEHIND_ALL | ANGLES_ON,
    "onset_time": BEHIND_ALL | {"gravity", "frame_timing", "compression"},
    "kinetic_friction": BEHIND_ALL | {"gravity", "frame_timing", "bead_size"} | ANGLES_ON,
}


# ------------------------------------------------------------------------------------------------- record -> quantities


def evaluate(
    angle: Series, tracks: Sequence[Track], *, variant: Variant, bead_diameter: float | None = None
) -> Evaluation:
    """Friction and its angle at the onset of motion, and the time of the onset.

    Parameters
    ----------
    angle : Series
        Angle of the plate against the horizontal over time [s], positive, in "rad" or "deg".
    tracks : sequence of Track
        The body, or the bodies of one rigid clump.  Position [m], shape (n, 2), fixed in space, origin on the plate's
        axis, x towards the rising side, y up.
    variant : {"slide", "roll"}
        Kind of motion.
    bead_diameter : float, optional
        Diameter of the bead [m]; scales the limits of drift and creep.

    Returns
    -------
    Evaluation
        ``static_friction`` (slide) or ``rolling_friction`` (roll) [1], the same with ``_angle`` [deg], ``onset_time``
        [s], for a sliding body ``kinetic_friction`` [1], with checks.

    Raises
    ------
    NothingToMeasure
        If nothing starts to move, or rest and run are not both seen.
    BadInput
        If the variant is unknown or there is no track.

    Notes
    -----
    mu = tan(alpha) at the onset.  The onset is the change point of a fit of rest and run, see
    `rigtwin.measure.tilt.onset`, not the crossing of a threshold.

    References
    ----------
    Hlosta et al. (2020), eqs. 3 and 4.
    """
    check_variant(variant)
    way = way_down(angle, tracks, variant, bead_diameter, scale_uncertainty=NEARBY_LENGTH_UNCERTAINTY)
    run, onset = onset_of(way, "the record")
    return evaluate_run(way, run, onset, variant, bead_diameter)


def check_variant(variant: str) -> None:
    if variant not in FRICTION:
        raise BadInput(f"measure tilt: variant {variant!r} is unknown; give 'slide' or 'roll'.")


def way_down(
    angle: Series, tracks: Sequence[Track], variant: Variant, bead_diameter: float | None, scale_uncertainty: float
) -> Way:
    """Displacement of the body down the plate: its track rotated back by the plate's angle.

    Raises `BadInput` without a track, `NothingToMeasure` if body and angle are seen together in too few frames.
    """
    if not tracks:
        raise BadInput("measure tilt: the record holds no track of the body; give one beside the angle.")
    if any(len(track.time) == 0 for track in tracks):
        raise NothingToMeasure(
            "measure tilt: the body is seen in no frame together with the plate's angle; state where it rests with "
            "--bead-at frame:x,y, or give a record that shows both."
        )
    turned = np.radians(angle.value) if angle.unit == "deg" else np.asarray(angle.value)
    known = np.isfinite(turned) & np.isfinite(angle.time)
    if known.sum() < 8:
        raise NothingToMeasure(
            f"measure tilt: the plate's angle is known in only {int(known.sum())} frames, 8 are needed; film the plate "
            "from the side, with enough light, or state it with --plate x1,y1,x2,y2."
        )
    time = tracks[0].time
    ways, sigmas = [], []
    alpha = np.interp(time, angle.time[known], turned[known], left=np.nan, right=np.nan)
    for track in tracks:
        x = np.interp(time, track.time, track.position[:, 0])
        y = np.interp(time, track.time, track.position[:, 1])
        up = x * np.cos(alpha) + y * np.sin(alpha)
        rests = up[np.isfinite(up)]  # the angle may become known later than the body
        ways.append(-(up - np.median(rests[: max(3, len(rests) // 20)])) if len(rests) else up)
        sigmas.append(np.interp(time, track.time, track.sigma))
    seen = np.isfinite(alpha) & np.all(np.isfinite(ways), axis=0)
    if seen.sum() < 8:
        raise NothingToMeasure(
            f"measure tilt: body and angle are known together in only {int(seen.sum())} frames, 8 are needed; "
            "give records that overlap in time."
        )
    return Way(
        time[seen],
        alpha[seen],
        np.mean(ways, axis=0)[seen],
        np.mean(sigmas, axis=0)[seen],
        FACTOR[variant],
        scale_uncertainty,
        bead_diameter or USUAL_DRIFT,
        float(np.median([np.hypot(track.position[0, 0], track.position[0, 1]) for track in tracks])),
    )


def onset_of(way: Way, whose: str) -> tuple[Run, Onset]:
    run = find_run(way)
    if run is None:
        first, last = (math.degrees(angle) for angle in (way.angle[0], way.angle[-1]))
        share = descent(way) / least_run(way)
        soon = ", within two frames" if share >= 1 else ""
        stays = (
            f"{whose}: in {len(way.time)} frames from {way.time[0]:.3f} to {way.time[-1]:.3f} s, while the plate turns "
            f"from {first:.1f} to {last:.1f} degrees, no run of the body down the plate was found (it moves down it "
            f"by {share:.2f} times the least way of a run{soon})"
        )
        if abs(last - first) < math.degrees(LEAST_TURN):
            raise NothingToMeasure(
                f"{stays}; if another object was followed, state the body with --bead-at frame:x,y, or give a sharp "
                "clip of the whole tilt."
            )
        advice = "film on until it has run down the plate" if last > first else "check whether the clip plays backwards"
        raise NothingToMeasure(f"{stays}; {advice}, or state the body with --bead-at frame:x,y.")
    onset = find_onset(way, run)
    if onset is not None and math.isfinite(way.scale_uncertainty) and abs(onset.gain - 1) > WRONG_SCALE:
        # a wrong scale must not shift the onset: fit it freely
        onset = find_onset(replace(way, scale_uncertainty=math.inf), run)
    if onset is None:
        end = way.time[run.end]
        raise NothingToMeasure(
            f"{whose}: no onset could be fitted to the body's {run.start} positions before it moves down the plate at "
            f"{way.time[run.start]:.3f} s and its {run.end - run.start} positions until {end:.3f} s; let the clip "
            "begin at least 0.2 s before and end after the run."
        )
    return run, onset


def evaluate_run(
    way: Way,
    run: Run,
    onset: Onset,
    variant: Variant,
    bead_diameter: float | None,
    geometry: Mapping[str, float] | None = None,
    timing: Mapping[str, float] | None = None,
) -> Evaluation:
    """Quantities and checks of a fitted onset.

    `geometry` [rad] and `timing` [s] are additional standard uncertainties of the angle and the time in a film.
    """
    geometry = geometry or {}
    judged = checks_of(way, onset, variant, bead_diameter)
    checks = tuple(each for each in judged if isinstance(each, Check))
    name = FRICTION[variant]
    budget = {"onset": onset.angle_sigma, **geometry}
    slope = 1 + math.tan(onset.angle) ** 2
    degrees = {part: math.degrees(value) for part, value in budget.items()}
    tangent = {part: slope * value for part, value in budget.items()}
    quantities = [
        _quantity(name, math.tan(onset.angle), "1", tangent),
        _quantity(f"{name}_angle", math.degrees(onset.angle), "deg", degrees),
        _quantity("onset_time", onset.time, "s", {"onset": onset.time_sigma, **(timing or {})}),
    ]
    if variant == "slide" and math.isfinite(way.scale_uncertainty):
        # kinetic friction is the slope minus the acceleration over g, which is proportional to the scale
        scale = min(way.scale_uncertainty, LEAST_UNCERTAINTY) * abs(math.tan(onset.angle) - onset.moving_friction)
        turned = {part: slope * value for part, value in geometry.items()}
        moving = {"acceleration": onset.moving_sigma, "scale": scale, **turned}
        quantities.append(
            Quantity(
                "kinetic_friction",
                onset.moving_friction,
                root_sum_of_squares(moving),
                "1",
                "acceleration",
                budget=moving,
            )
        )
    warnings = tuple(each for each in judged if isinstance(each, str))
    return Evaluation(judged_quantities(quantities, checks), checks, warnings)


def judged_quantities(quantities: Sequence[Quantity], checks: Sequence[Check]) -> tuple[Quantity, ...]:
    return tuple(doubted(quantity, failed(checks, RESTS_ON[quantity.quantity])) for quantity in quantities)


def _quantity(name: str, value: float, unit: str, budget: dict[str, float]) -> Quantity:
    return Quantity(name, value, root_sum_of_squares(budget), unit, "onset", budget=budget)
