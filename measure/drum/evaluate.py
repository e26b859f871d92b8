"""Evaluate profiles of a drum's surface over time: dynamic angles of repose, avalanches, uncertainty budgets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.drum_flow import froude_check
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Check, Detail, Evaluation, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.records import Profile, Series
from rigtwin.lab.units import positive
from rigtwin.measure.drum.time_average import SHORTEST, Avalanches, Mean, find_avalanches, mean_over_time, steady_part
from rigtwin.measure.media.time_base import UNSTEADY

GRAPHICAL, GEOMETRIC = "angle_of_repose_graphical", "angle_of_repose_geometric"

UPPER, LOWER = "angle_of_repose_upper", "angle_of_repose_lower"

FREQUENCY = "avalanche_frequency"

OF_SURFACE = (GRAPHICAL, GEOMETRIC, UPPER, LOWER)

MIDDLE = "line, middle half"

SLOPE = "slope over time"

WHOLE = "line, 10-90 %"

TANGENT = "tangent at the axis"

CHORD = "chord, wall to wall"

CHORD_ENDS = 0.05  # share of the surface's extent averaged at each end of the chord: about one bead

AT_WALL = 0.02  # share of the radius; an outline this near to the wall is the wall's, not the surface's

# shares of the surface's horizontal extent, from its lower to its upper end, between which lines are fitted
WINDOWS = {
    (GRAPHICAL, MIDDLE): (0.25, 0.75),
    (GRAPHICAL, WHOLE): (0.1, 0.9),
    (LOWER, "line, 10-50 %"): (0.1, 0.5),
    (UPPER, "line, 50-90 %"): (0.5, 0.9),
}

TANGENT_REACH = 0.2  # share of the radius, to both sides of the axis

S_SHAPE = 2.0  # [deg], least difference of upper and lower angle of a curved surface

# [deg], standard uncertainty by perspective, lens, and flying beads, which hide the bed most at its upper end
VIEW_UNCERTAINTY = {GRAPHICAL: 0.25, LOWER: 0.5, UPPER: 1.2, GEOMETRIC: 1.2}

# a line over a curved surface has the mean slope of its two halves, so half of the uncertainty of each
HALVES_UNCERTAINTY = math.hypot(VIEW_UNCERTAINTY[LOWER], VIEW_UNCERTAINTY[UPPER]) / 2

# [deg], standard deviation of the angle in one moment about its mean over time, in units of bead over drum diameter, to
# which it is proportional.  From twins of drums 11 to 34 beads wide (benchmarks/measure/drum_moments.py).  Ray-traced
# drums of other physics have 0.75 to 1 of it, published repetitions 0.5 to 1.8 (Hlosta et al. 2020, table 14).
ONE_MOMENT = {
    (GRAPHICAL, MIDDLE): 59.0,
    (GRAPHICAL, WHOLE): 42.0,
    (LOWER, "line, 10-50 %"): 79.0,
    (UPPER, "line, 50-90 %"): 79.0,
    (GEOMETRIC, CHORD): 39.0,
    (GRAPHICAL, TANGENT): 115.0,
}

# degrees of freedom to which ONE_MOMENT is known of one drum: a standard deviation of ten scatters by 22 %; that of
# different twins by 16 %, that of ray-traced drums and published repetitions by more
PRIOR = 10.0

MEMORY = 0.1  # turns, after which the surface is another one; largest value in the same twins, of the line over 10-90 %

USUAL_SHARE = 0.04  # [1], bead over drum diameter where it is not known

MOST_BOW = 0.2  # sagitta over length of the surface; an S-shape has none about its middle, the drum's own arc 0.5

HIGHEST_STEP = 4.0  # [bead diameters], largest rise over one bead diameter: a slope of 76 degrees

# checks of the record; if one fails every angle is doubtful
RESTS_ON = ("surface_in_view", "steady_flow", "frame_timing", "surface_falls", "froude_number")

SURELY_UP = 3.0  # standard uncertainties by which half of the surface must rise the wrong way

SMEARED = 0.25  # share of frames without a surface above which the result is doubtful


@dataclass(frozen=True)
class Observation:
    """Profiles over time, and the profiles that other readings of the clip give, one standard deviation away."""

    profiles: Sequence[Profile]
    times: Array  # shape (n,), [s]
    radius: float | None  # of the drum, in the unit of the profiles
    variants: Mapping[str, tuple[Sequence[Profile], Sequence[Profile]]] = field(default_factory=dict)
    roll_uncertainty: float = 0.0  # [deg], standard uncertainty of the camera roll
    roll_seen: bool = True  # whether the roll was measured or stated
    filmed: bool = False
    bead_share: float | None = None  # [1], bead diameter over drum diameter; None: not known
    averaged: bool = False  # whether each profile is a mean over time


def evaluate(
    profiles: Sequence[Profile],
    times: Array,
    *,
    drum_diameter: float | None,
    speed: float | None = None,
    bead_diameter: float | None = None,
    averaged: bool = False,
) -> Evaluation:
    """Evaluate the angles of a drum's surface from its profiles over time, filmed or simulated.

    Parameters
    ----------
    profiles : sequence of Profile
        Surface at each time: x and height from the drum's axis [m], height against gravity, NaN where there is no bed.
        The surface of a simulated bed is the upper edge of its spheres.
    times : array, shape (n,)
        Time of each profile [s], increasing.
    drum_diameter : float or None
        Inner diameter of the drum [m]; needed for the tangent at the axis.
    speed : float, optional
        Angular speed of the drum [rad/s].
    bead_diameter : float, optional
        Bead diameter [m]; sets how much the angle scatters from moment to moment.
    averaged : bool
        Whether each profile is a mean over time, which does not scatter as one moment does.

    Returns
    -------
    Evaluation
        Means over the steady part of ``angle_of_repose_graphical`` (lines over the middle half and 10 to 90 %,
        tangent), ``angle_of_repose_geometric`` (chord), ``angle_of_repose_lower`` and ``angle_of_repose_upper`` [deg];
        where there are avalanches also ``avalanche_frequency`` [Hz] and the angles at which they start and stop.

    Raises
    ------
    BadInput
        If a size or the speed is not positive, the numbers of profiles and times differ, or times do not increase.
    NothingToMeasure
        If no profile contains a surface.

    Notes
    -----
    Neighbouring frames are correlated.  The standard error of a mean over time therefore follows from the integrated
    correlation time, see `rigtwin.measure.drum.time_average.mean_over_time`.

    Examples
    --------
    >>> import numpy as np
    >>> from rigtwin.lab.records import Profile
    >>> x = np.linspace(-0.06, 0.06, 121)
    >>> surface = Profile(x, 0.5 * x - 0.02, np.full(121, 1e-5))
    >>> found = evaluate([surface] * 20, np.arange(20) / 100, drum_diameter=0.15)
    >>> round(found.quantities[0].value, 1)
    26.6
    """
    check_settings(drum_diameter=drum_diameter, speed=speed, bead_diameter=bead_diameter)
    if len(profiles) != len(times):
        raise BadInput(f"drum: {len(profiles)} profiles but {len(times)} times; give one time for each profile.")
    times = np.asarray(times, dtype=np.float64)
    if len(times) > 1 and not np.all(np.diff(times) > 0):
        raise BadInput("drum: times do not increase from profile to profile; sort the profiles by time.")
    radius = drum_diameter / 2 if drum_diameter is not None else None
    seen = Observation(profiles, times, radius, bead_share=share_of(bead_diameter, drum_diameter), averaged=averaged)
    return evaluate_observation(seen, speed, radius)


def evaluate_slope(
    slope: Series, speed: float | None = None, *, bead_share: float | None = None, averaged: bool = False
) -> Evaluation:
    """Evaluate the slope of a drum's surface over time, measured elsewhere.

    Parameters
    ----------
    slope : Series
        Angle of the surface against the horizontal over time [s], in "rad" or "deg".
    speed : float, optional
        Angular speed of the drum [rad/s].
    bead_share : float, optional
        Bead diameter over drum diameter [1].
    averaged : bool
        Whether each slope is that of a mean over time.

    Returns
    -------
    Evaluation
        ``angle_of_repose_graphical`` [deg], the mean over the steady part, and the avalanches where there are some.

    Raises
    ------
    NothingToMeasure
        If no value is finite.
    """
    check_settings(speed=speed)
    x = np.linspace(-1.0, 1.0, 9)  # in any unit: a straight surface has the slope everywhere
    tangents = np.tan(np.radians(slope.value) if slope.unit == "deg" else slope.value)
    surfaces = [Profile(x, tangent * x, np.full(len(x), np.nan)) for tangent in tangents]
    seen = Observation(surfaces, slope.time, None, bead_share=bead_share, averaged=averaged)
    found = evaluate_observation(seen, speed, None)
    kept = [each for each in found.quantities if each.method == MIDDLE or each.quantity not in OF_SURFACE]
    quantities = tuple(
        replace(each, method=SLOPE) if each.method == MIDDLE and each.quantity == GRAPHICAL else each for each in kept
    )
    return replace(found, quantities=quantities)


def angles_over_time(profiles: Sequence[Profile], times: Array, *, drum_diameter: float) -> tuple[Series, Series]:
    """Graphical angle (line, middle half) and geometric angle (chord) of each profile [deg], NaN where not seen.

    Positive in the direction in which the surface mostly rises.  `evaluate` averages them over the steady part.
    """
    positive(drum_diameter=drum_diameter)
    free = _without_wall(profiles, drum_diameter / 2)
    angles = _angles(free, rising_side(free), drum_diameter / 2)
    graphical, geometric = angles[GRAPHICAL, MIDDLE], angles[GEOMETRIC, CHORD]
    return Series(times, graphical, GRAPHICAL, "deg"), Series(times, geometric, GEOMETRIC, "deg")


def surface_line(profile: Profile, window: tuple[float, float]) -> tuple[float, float, float, float] | None:
    """Slope, height at x = 0, and both ends of the least-squares line over a share of the surface's extent.

    `window` counts from the left end to the right end.  None if too little of the surface is seen there.
    """
    ends = surface_ends(profile)
    if ends is None:
        return None
    low, high = (ends[0] + share * (ends[1] - ends[0]) for share in window)
    slope, offset = _line(profile, low, high)
    return (slope, offset, low, high) if math.isfinite(slope) else None


def surface_ends(profile: Profile) -> tuple[float, float] | None:
    """x of both ends of the surface."""
    seen = np.isfinite(profile.height)
    if np.sum(seen) < 8:
        return None
    x = profile.x[seen]
    return float(x[0]), float(x[-1])


# ------------------------------------------------------------------------------------------------- record -> quantities


def evaluate_observation(seen: Observation, speed: float | None, radius: float | None) -> Evaluation:
    """Evaluate an observation; `speed` [rad/s] and `radius` [m] of the drum where they are known."""
    if seen.radius is not None:
        variants = {
            name: (_without_wall(one, seen.radius), _without_wall(other, seen.radius))
            for name, (one, other) in seen.variants.items()
        }
        seen = replace(seen, profiles=_without_wall(seen.profiles, seen.radius), variants=variants)
    rises = rising_side(seen.profiles)
    angles = _angles(seen.profiles, rises, seen.radius)
    main = angles[GRAPHICAL, MIDDLE]
    if not np.isfinite(main).any():
        raise NothingToMeasure(
            "no profile contains the surface of a bed: heights must be finite at eight or more points of x."
        )
    first, last = steady_part(seen.times, main)
    kept = slice(first, last + 1)
    avalanches = find_avalanches(seen.times[kept], main[kept], None if speed is None else math.degrees(abs(speed)))
    varied = {
        name: [_angles(profiles, rises, seen.radius) for profiles in pair] for name, pair in seen.variants.items()
    }
    means = {
        key: mean_over_time(seen.times[kept], series[kept])
        for key, series in angles.items()
        if np.isfinite(series[kept]).sum() > 0
    }
    s_shaped = _s_shaped(means)
    quantities = []
    for key, mean in means.items():
        uncertainties = {
            part: _spread([_shift(other[key][kept], angles[key][kept]) for other in pair])
            for part, pair in varied.items()
        }
        quantities.append(
            _quantity(
                key,
                mean,
                _flow(key, mean, seen.times[kept][np.isfinite(angles[key][kept])], seen, speed),
                uncertainties,
                seen,
                rises,
                s_shaped,
            )
        )
    warnings = []
    if isinstance(avalanches, str):
        warnings.append(f"avalanche frequency and angles: not given, because {avalanches}.")
    else:
        quantities += _of_avalanches(avalanches, quantities[0].budget)
    checks = [*_checks(seen, main, first, last, means.get((GRAPHICAL, MIDDLE)), speed), *_falls_check(quantities)]
    if speed is not None and radius is not None:
        checks.append(froude_check(speed, radius))
    quantities = [doubted(one, failed(checks, RESTS_ON)) for one in quantities]
    if last - first + 1 < len(seen.times):
        warnings.append(
            f"steady part: {seen.times[first]:.3f} s to {seen.times[last]:.3f} s; before or after it the surface lies "
            "clearly elsewhere, and these frames are left out."
        )
    return Evaluation(tuple(quantities), tuple(checks), tuple(warnings))


def _without_wall(profiles: Sequence[Profile], radius: float) -> list[Profile]:
    """Profiles without the ends that run along the wall, as they do where the bed reaches above the axis."""
    cut = []
    for profile in profiles:
        free = np.flatnonzero(np.hypot(profile.x, profile.height) < (1 - AT_WALL) * radius)
        inner = np.zeros(len(profile.x), dtype=bool)
        if len(free):
            inner[free[0] : free[-1] + 1] = True
        cut.append(replace(profile, height=np.where(inner, profile.height, np.nan)))
    return cut


def rising_side(profiles: Sequence[Profile]) -> float:
    """+1 where the surface rises to the right, -1 where it rises to the left."""
    slopes = [line[0] for line in (surface_line(profile, (0.1, 0.9)) for profile in profiles) if line is not None]
    return -1.0 if slopes and float(np.median(slopes)) < 0 else 1.0


def _angles(profiles: Sequence[Profile], rises: float, radius: float | None) -> dict[tuple[str, str], Array]:
    """Every angle [deg] by (quantity, method), shape (n profiles,), NaN where it is not seen."""
    table: dict[tuple[str, str], list[float]] = {key: [] for key in WINDOWS}
    table[GEOMETRIC, CHORD] = []
    if radius is not None:
        table[GRAPHICAL, TANGENT] = []
    for profile in profiles:
        for key, (low, high) in WINDOWS.items():
            line = surface_line(profile, (low, high) if rises > 0 else (1 - high, 1 - low))
            table[key].append(math.nan if line is None else rises * math.degrees(math.atan(line[0])))
        table[GEOMETRIC, CHORD].append(rises * _chord(profile))
        if radius is not None:
            slope, _ = _line(profile, -TANGENT_REACH * radius, TANGENT_REACH * radius)
            table[GRAPHICAL, TANGENT].append(rises * math.degrees(math.atan(slope)))
    return {key: np.array(values) for key, values in table.items()}


def _line(profile: Profile, low: float, high: float) -> tuple[float, float]:
    """Slope and height at x = 0 of the least-squares line between two x."""
    part = np.isfinite(profile.height) & (profile.x >= low) & (profile.x <= high)
    x, height = profile.x[part], profile.height[part]
    # if too much of the window is hidden the line would have another window
    if np.sum(part) < 4 or np.ptp(x) < 0.7 * (high - low):
        return math.nan, math.nan
    slope, offset = np.polyfit(x, height, 1)
    return float(slope), float(offset)


def _chord(profile: Profile) -> float:
    """Angle [deg] of the straight line between the points where the surface meets the wall."""
    ends = surface_ends(profile)
    if ends is None:
        return math.nan
    seen = np.isfinite(profile.height)
    x, height = profile.x[seen], profile.height[seen]
    reach = CHORD_ENDS * (ends[1] - ends[0])
    (ax, ay), (bx, by) = (
        (float(np.mean(x[part])), float(np.mean(height[part]))) for part in (x <= ends[0] + reach, x >= ends[1] - reach)
    )
    return math.degrees(math.atan2(by - ay, bx - ax))


def _s_shaped(means: Mapping[tuple[str, str], Mean]) -> bool:
    upper, lower = (
        next((mean for (name, _), mean in means.items() if name == wanted), None) for wanted in (UPPER, LOWER)
    )
    if upper is None or lower is None:
        return False
    apart = abs(upper.value - lower.value)
    return apart > max(S_SHAPE, 2 * math.hypot(upper.std_error, lower.std_error))


@dataclass(frozen=True)
class Flow:
    """How well the mean over a record stands for the long-run mean of the fluctuating flow."""

    std_uncertainty: float  # [deg], of the mean over time; 1.96 of it cover 95 %
    frames: int
    independent: float  # number of independent moments


def _flow(key: tuple[str, str], mean: Mean, times: Array, seen: Observation, speed: float | None) -> Flow:
    """Uncertainty of a mean over the `times` at which the angle was seen."""
    from scipy.stats import t as student

    if seen.averaged:
        return Flow(mean.std_error, len(times), mean.independent)
    few = len(times) < SHORTEST  # too few to show their correlation
    turns = 0.0 if speed is None else abs(speed) * float(times[-1] - times[0]) / (2 * math.pi)
    by_turns = min(float(len(times)), 1 + turns / MEMORY)
    # of a film three independent moments at least are found: neighbours that agree may all show one moment, so two of
    # them carry no information, even in a record that never returns to its mean
    moments = by_turns if few else max(by_turns, mean.independent - 2)
    weight = PRIOR if few else 1.0  # a film shows its own drum's scatter
    observed = mean.std_error if speed is None else 0.0
    usual = one_moment(key, seen.bead_share)
    # the observed scatter and the usual one, each weighted by its degrees of freedom
    scatter2 = (weight * usual**2 + (moments - 1) * mean.deviation**2) / (weight + moments - 1)
    widened = float(student.ppf(0.975, PRIOR + moments - 1)) / 1.959964
    error = max(observed, math.sqrt(scatter2 / moments) * widened)
    return Flow(error, len(times), moments if few else mean.independent)


def one_moment(key: tuple[str, str], bead_share: float | None) -> float:
    """Usual standard deviation [deg] of an angle (quantity, method) in one moment about its mean over time."""
    return ONE_MOMENT[key] * (USUAL_SHARE if bead_share is None else bead_share)


def share_of(bead_diameter: float | None, drum_diameter: float | None) -> float | None:
    """Bead over drum diameter [1] where both are known."""
    return bead_diameter / drum_diameter if bead_diameter and drum_diameter else None


def _quantity(
    key: tuple[str, str],
    mean: Mean,
    flow: Flow,
    uncertainties: Mapping[str, float],
    seen: Observation,
    rises: float,
    s_shaped: bool,
) -> Quantity:
    name, method = key
    budget = {"flow over time": flow.std_uncertainty}
    budget |= {"camera roll" if seen.roll_seen else "camera roll, not measured": seen.roll_uncertainty, **uncertainties}
    if seen.filmed:
        budget["perspective, beads in flight"] = HALVES_UNCERTAINTY if method == WHOLE else VIEW_UNCERTAINTY[name]
    budget = {part: float(value) for part, value in budget.items() if math.isfinite(value) and value > 0}
    this_clip = root_sum_of_squares({part: value for part, value in budget.items() if part != "flow over time"})
    detail: dict[str, Detail] = {
        "turning": "anticlockwise" if rises > 0 else "clockwise",
        "standard_deviation": mean.deviation,
        "frames": flow.frames,
        "independent_frames": round(flow.independent, 1),
        "std_uncertainty_of_this_clip": this_clip,
    }
    if name in (UPPER, LOWER):
        detail["s_shaped"] = s_shaped
    return Quantity(name, mean.value, root_sum_of_squares(budget), "deg", method, 1, detail, budget)


def _of_avalanches(found: Avalanches, budget: Mapping[str, float]) -> list[Quantity]:
    error = {"scatter of intervals": found.frequency_error}
    angle = {part: value for part, value in budget.items() if part != "flow over time"}
    angle["scatter of avalanches"] = budget.get("flow over time", 0.0)
    detail: dict[str, Detail] = {"avalanches": found.count}
    total = root_sum_of_squares(angle)
    return [
        Quantity(FREQUENCY, found.frequency, found.frequency_error, "Hz", "maxima", 1, detail, error),
        Quantity("avalanche_start_angle", found.start_angle, total, "deg", MIDDLE, 1, detail, angle),
        Quantity("avalanche_stop_angle", found.stop_angle, total, "deg", MIDDLE, 1, detail, angle),
    ]


def _checks(
    seen: Observation, main: Array, first: int, last: int, mean: Mean | None, speed: float | None
) -> list[Check]:
    count = last - first + 1
    checks = []
    if len(main) > 1:
        share = count / len(main)
        # the number of turns is reported, not judged: the film may begin long after the drum did
        turns = None if speed is None else abs(speed) * float(seen.times[last] - seen.times[first]) / (2 * math.pi)
        checks.append(
            Check(
                "steady_flow",
                share > 0.5,
                share,
                1.0,
                f"{100 * share:.0f} % of the record is steady flow, worth "
                f"{mean.independent if mean else 0:.0f} independent moments"
                f"{'' if turns is None else f' in {turns:.2g} turns'}; give a longer record where these are few.",
            )
        )
    measured = float(np.isfinite(main[first : last + 1]).mean())
    checks.append(
        Check(
            "surface_in_view",
            measured > 1 - SMEARED,
            measured,
            1.0,
            f"the surface was measured in {100 * measured:.0f} % of {count} frames"
            + ("." if measured > 1 - SMEARED else ": something may hide it."),
        )
    )
    if len(seen.times) > 2:
        steps = np.diff(seen.times)
        odd = float(np.mean(np.abs(steps / np.median(steps) - 1) > 0.25))
        checks.append(
            Check(
                "frame_timing",
                odd < UNSTEADY,
                odd,
                0.0,
                f"{100 * odd:.0f} % of the frame intervals differ by more than a quarter from the usual one; "
                "means are taken over time, not over frames.",
            )
        )
    return checks


def _falls_check(quantities: Sequence[Quantity]) -> list[Check]:
    """Check that both halves of the surface fall the same way; near the toe the surface may be level."""
    halves = [one for one in quantities if one.quantity in (LOWER, UPPER)]
    if len(halves) < 2:
        return []
    least = min(halves, key=lambda one: one.value + SURELY_UP * one.std_uncertainty)
    passed = least.value + SURELY_UP * least.std_uncertainty > 0
    message = (
        f"the {'upper' if least.quantity == UPPER else 'lower'} half of the surface falls by {least.value:.0f} "
        f"± {least.std_uncertainty:.0f} deg"
    )
    ending = "." if passed else ", against the other half: no bed flows so; something else was taken for the surface."
    return [Check("surface_falls", passed, least.value, 0.0, message + ending)]


def _shift(other: Array, usual: Array) -> float:
    """Median change of the angle by another reading, over frames in which both exist."""
    both = np.isfinite(other) & np.isfinite(usual)
    return float(np.median(other[both] - usual[both])) if both.any() else math.nan


def _spread(changes: Sequence[float]) -> float:
    """Root mean square of the changes by readings one standard deviation away."""
    known = [change for change in changes if math.isfinite(change)]
    return math.sqrt(sum(change * change for change in known) / len(known)) if known else 0.0


def check_settings(
    *, speed: float | None, drum_diameter: float | None = None, bead_diameter: float | None = None
) -> None:
    """Refuse settings that cannot be; a speed is negative where the drum turns the other way."""
    positive(speed=None if speed is None else abs(speed), drum_diameter=drum_diameter, bead_diameter=bead_diameter)
