"""Evaluation of a drum's surface from profiles whose angles and uncertainties are known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import t as student

from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Check, Evaluation, Quantity
from rigtwin.lab.records import Profile, Series
from rigtwin.measure.drum import evaluate as drum
from rigtwin.measure.drum.evaluate import GEOMETRIC, GRAPHICAL, LOWER, UPPER, Observation, evaluate_observation

Array = npt.NDArray[np.float64]

X = np.linspace(-1.0, 1.0, 2001)
MIDDLE, WHOLE, TANGENT, CHORD = "line, middle half", "line, 10-90 %", "tangent at the axis", "chord, wall to wall"
OF_HALF = {LOWER: "line, 10-50 %", UPPER: "line, 50-90 %"}


def surface(height: Array) -> Profile:
    return Profile(X, height, np.full(len(X), 1e-5))


def straight(degrees: float) -> Profile:
    return surface(math.tan(math.radians(degrees)) * X)


def bent(lower: float, upper: float) -> Profile:
    """Two straight halves of these angles [deg]."""
    return surface(np.where(X < 0, math.tan(math.radians(lower)) * X, math.tan(math.radians(upper)) * X))


def observed(profiles: list[Profile], *, apart: float = 0.1, **more: Any) -> Observation:
    return Observation(profiles, apart * np.arange(len(profiles)), **{"radius": None, "bead_share": 0.04} | more)


def find(found: Evaluation, quantity: str, method: str = "") -> Quantity:
    (one,) = (each for each in found.quantities if each.quantity == quantity and method in ("", each.method))
    return one


def check(found: Evaluation, name: str) -> Check:
    (one,) = (each for each in found.checks if each.check == name)
    return one


def usual(quantity: str, method: str, share: float = 0.04) -> float:
    """Usual standard deviation of a moment [deg], in units of bead over drum diameter times that ratio."""
    known = {MIDDLE: 59, WHOLE: 42, CHORD: 39, TANGENT: 115, OF_HALF[LOWER]: 79, OF_HALF[UPPER]: 79}
    assert (quantity == GEOMETRIC) == (method == CHORD)
    return known[method] * share


def widened(freedom: float) -> float:
    """Student's t over that of the normal distribution, at 95 %."""
    return float(student.ppf(0.975, freedom)) / 1.959964


@pytest.mark.parametrize("falls", [1, -1])
def test_every_line_has_the_slope_of_least_squares_over_its_window(falls: int) -> None:
    # height = x + 0.15 x^2 - 0.3 x^3; least squares over [m - h, m + h] gives x^2 the slope 2 m and x^3 the slope
    # 3 m^2 + 0.6 h^2
    height = X + 0.15 * X**2 - 0.3 * X**3

    def degrees(m: float, h: float) -> float:
        return math.degrees(math.atan(1 + 0.15 * 2 * m - 0.3 * (3 * m**2 + 0.6 * h**2)))

    ends = X >= 0.9  # a twentieth of the extent at each end
    rise = float(np.mean(height[ends]) - np.mean(height[X <= -0.9]))
    chord = math.degrees(math.atan(rise / (2 * float(np.mean(X[ends])))))
    shown = surface(height if falls > 0 else height[::-1].copy())
    found = drum.evaluate([shown], np.zeros(1), drum_diameter=4.0)
    assert find(found, GRAPHICAL, MIDDLE).value == pytest.approx(degrees(0, 0.5), abs=0.03)
    assert find(found, GRAPHICAL, WHOLE).value == pytest.approx(degrees(0, 0.8), abs=0.03)
    assert find(found, GRAPHICAL, TANGENT).value == pytest.approx(degrees(0, 0.4), abs=0.03)  # 0.2 of the radius
    assert find(found, LOWER, OF_HALF[LOWER]).value == pytest.approx(degrees(-0.4, 0.4), abs=0.03)
    assert find(found, UPPER, OF_HALF[UPPER]).value == pytest.approx(degrees(0.4, 0.4), abs=0.03)
    assert find(found, GEOMETRIC, CHORD).value == pytest.approx(chord, abs=0.03)
    assert len(found.quantities) == 6
    for one in found.quantities:
        assert (one.unit, one.n, one.detail["frames"]) == ("deg", 1, 1)
        assert one.detail["turning"] == ("anticlockwise" if falls > 0 else "clockwise")
        assert ("s_shaped" in one.detail) == (one.quantity in OF_HALF)
    graphical, geometric = drum.angles_over_time([shown] * 2, np.array([0.0, 1.0]), drum_diameter=4.0)
    assert graphical.value == pytest.approx(find(found, GRAPHICAL, MIDDLE).value)
    assert geometric.value == pytest.approx(chord, abs=0.03)
    assert [(one.quantity, one.unit) for one in (graphical, geometric)] == [(GRAPHICAL, "deg"), (GEOMETRIC, "deg")]
    line = drum.surface_line(shown, (0.25, 0.75))
    assert line is not None
    assert math.degrees(math.atan(abs(line[0]))) == pytest.approx(degrees(0, 0.5), abs=0.03)
    assert line[1:] == pytest.approx((0.15 * 0.5**2 / 3, -0.5, 0.5), abs=1e-3)


@pytest.mark.parametrize(("reach", "is_wall"), [(0.985, True), (0.97, False)])
def test_an_outline_within_a_fiftieth_of_the_radius_of_the_wall_is_no_surface(reach: float, is_wall: bool) -> None:
    radius, slope = 1.2, math.tan(math.radians(20))
    arc = np.sqrt(np.maximum((reach * radius) ** 2 - X**2, 0))
    shown = surface(np.where(slope * 0.8 < arc, np.where(X < 0.8, slope * X, arc), np.nan))
    graphical, chord = drum.angles_over_time([shown], np.zeros(1), drum_diameter=2 * radius)
    assert graphical.value[0] == pytest.approx(20, abs=0.01)
    assert (chord.value[0] == pytest.approx(20, abs=0.01)) == is_wall
    found = drum.evaluate([shown], np.zeros(1), drum_diameter=2 * radius)
    assert find(found, GEOMETRIC).value == pytest.approx(chord.value[0])


def test_a_single_moment_scatters_as_usual_with_ten_degrees_of_freedom() -> None:
    found = drum.evaluate([straight(30)], np.zeros(1), drum_diameter=4.0, bead_diameter=0.08)
    unknown = drum.evaluate([straight(30)], np.zeros(1), drum_diameter=4.0)  # then a 25th of the drum
    assert len(found.quantities) == 6
    for one in (*found.quantities, *unknown.quantities):
        share = 0.02 if one in found.quantities else 0.04
        assert one.budget == pytest.approx({"flow over time": usual(one.quantity, one.method, share) * widened(10)})
        assert one.std_uncertainty == pytest.approx(one.budget["flow over time"])
        assert one.detail["independent_frames"] == 1


@pytest.mark.parametrize("apart", [0.05, 1.5])
def test_two_moments_count_by_the_turn_between_them_and_lower_the_scatter(apart: float) -> None:
    speed = -0.6  # [rad/s]
    found = drum.evaluate([straight(31), straight(33)], apart * np.arange(2), drum_diameter=4.0, speed=speed)
    # a tenth of a turn gives another moment, but two profiles show two at most
    count = min(2.0, 1 + 0.6 * apart / (2 * math.pi) / 0.1)
    own = math.sqrt(2)  # standard deviation of 31 and 33
    for method in (MIDDLE, WHOLE):
        one = find(found, GRAPHICAL, method)
        scatter2 = (10 * usual(GRAPHICAL, method) ** 2 + (count - 1) * own**2) / (9 + count)
        assert one.value == pytest.approx(32)
        assert one.detail["standard_deviation"] == pytest.approx(own)
        assert one.detail["independent_frames"] == round(count, 1)
        assert one.std_uncertainty == pytest.approx(math.sqrt(scatter2 / count) * widened(9 + count))


@pytest.mark.parametrize(("frames", "speed"), [(20, None), (20, 100.0), (8, None)])
def test_a_film_of_a_surface_at_rest_has_all_but_two_of_its_frames_as_moments(frames: int, speed: float | None) -> None:
    seen = observed([straight(30)] * frames, apart=0.001)
    found = find(evaluate_observation(seen, speed, None), GRAPHICAL, MIDDLE)
    moments = frames - 2.0
    by_turns = 1.0 if speed is None else 1 + speed * 0.001 * (frames - 1) / (2 * math.pi) / 0.1
    count = max(moments, by_turns)
    # no scatter was seen, so the usual one counts as one degree of freedom among them
    scatter = usual(GRAPHICAL, MIDDLE) / math.sqrt(count)
    assert found.std_uncertainty == pytest.approx(scatter / math.sqrt(count) * widened(9 + count))
    assert (found.detail["frames"], found.detail["independent_frames"]) == (frames, frames)


def test_moments_whose_scatter_shows_have_at_least_their_standard_error() -> None:
    pair = observed([straight(20), straight(40)])
    alone = find(evaluate_observation(pair, None, None), GRAPHICAL, MIDDLE)
    # without the speed both may be one moment, of the standard deviation that was seen
    assert alone.std_uncertainty == pytest.approx(10 * math.sqrt(2))
    turning = find(evaluate_observation(pair, 0.6, None), GRAPHICAL, MIDDLE)
    assert turning.std_uncertainty < alone.std_uncertainty


def test_a_mean_over_time_is_as_uncertain_as_its_repetitions_scatter() -> None:
    found = find(
        evaluate_observation(observed([straight(31), straight(33)], averaged=True), 0.6, None), GRAPHICAL, WHOLE
    )
    assert found.std_uncertainty == pytest.approx(math.sqrt(2))
    assert (found.detail["frames"], found.detail["independent_frames"]) == (2, 1)


def test_roll_readings_and_view_enter_the_budget_of_each_angle() -> None:
    shown = [straight(30)] * 20
    tilted = {"edge": ([straight(30.3)] * 20, [straight(29.5)] * 20)}
    view = {GRAPHICAL: 0.25, LOWER: 0.5, UPPER: 1.2, GEOMETRIC: 1.2}
    for roll_seen, filmed in ((True, True), (False, False)):
        seen = observed(shown, variants=tilted, roll_uncertainty=0.2, roll_seen=roll_seen, filmed=filmed, radius=3.0)
        found = evaluate_observation(seen, None, 3.0)
        assert len(found.quantities) == 6
        for one in found.quantities:
            parts = {
                "camera roll" if roll_seen else "camera roll, not measured": 0.2,
                "edge": math.sqrt((0.3**2 + 0.5**2) / 2),
            }
            if filmed:  # a line over both halves has half of the error of each
                of_view = math.hypot(0.5, 1.2) / 2 if one.method == WHOLE else view[one.quantity]
                parts["perspective, beads in flight"] = of_view
            assert {k: v for k, v in one.budget.items() if k != "flow over time"} == pytest.approx(parts, abs=0.02)
            assert one.detail["std_uncertainty_of_this_clip"] == pytest.approx(math.hypot(*parts.values()), abs=0.02)
            assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))


def test_a_reading_that_shows_no_surface_counts_where_the_other_one_does() -> None:
    hidden = replace(straight(30), height=np.full(len(X), np.nan))
    for lost, expected in (([hidden] * 20, 0.4), ([hidden] * 10 + [straight(30.8)] * 10, math.sqrt((0.16 + 0.64) / 2))):
        seen = observed([straight(30)] * 20, variants={"edge": ([straight(30.4)] * 20, lost)})
        assert find(evaluate_observation(seen, None, None), GRAPHICAL, MIDDLE).budget["edge"] == pytest.approx(expected)
    seen = observed([straight(30)] * 20, variants={"edge": ([hidden] * 20, [hidden] * 20)})
    assert "edge" not in find(evaluate_observation(seen, None, None), GRAPHICAL, MIDDLE).budget


@pytest.mark.parametrize(("apart", "curved"), [(1.9, False), (2.1, True), (-1.9, False), (-2.1, True)])
def test_halves_that_differ_by_two_degrees_are_an_s_shape(apart: float, curved: bool) -> None:
    found = evaluate_observation(observed([bent(30, 30 + apart)] * 20), None, None)
    assert find(found, UPPER).detail["s_shaped"] is curved
    assert find(found, LOWER).detail["s_shaped"] is curved


def test_a_difference_within_the_scatter_of_both_halves_is_no_s_shape() -> None:
    swaying = [bent(30 + sway, 33 - sway) for sway in (-8.0, 8.0)]  # [deg]; each known to its deviation of 11
    assert find(evaluate_observation(observed(swaying), None, None), UPPER).detail["s_shaped"] is False


@pytest.mark.parametrize(("hidden", "seen"), [(0.2, True), (0.28, False)])
def test_a_line_needs_seven_tenths_of_its_window(hidden: float, seen: bool) -> None:
    # the window of the upper half reaches from 0 to 0.8
    shown = replace(straight(30), height=np.where(np.abs(X - hidden / 2) <= hidden / 2, np.nan, straight(30).height))
    found = evaluate_observation(observed([shown]), None, None)
    assert any(one.quantity == UPPER for one in found.quantities) == seen
    assert any(one.quantity == LOWER for one in found.quantities)


def test_a_surface_needs_eight_points_and_a_line_four() -> None:
    def points(count: int) -> Profile:
        x = np.linspace(-1, 1, count)
        return Profile(x, 0.5 * x, np.full(count, 1e-5))

    assert find(drum.evaluate([points(9)], np.zeros(1), drum_diameter=None), GRAPHICAL, MIDDLE).value == pytest.approx(
        math.degrees(math.atan(0.5))
    )
    assert find(drum.evaluate([points(8)], np.zeros(1), drum_diameter=None), GEOMETRIC)
    why = "no profile contains the surface of a bed: heights must be finite at eight or more points of x."
    with pytest.raises(NothingToMeasure) as refusal:
        drum.evaluate([points(7)], np.zeros(1), drum_diameter=None)
    assert str(refusal.value) == why
    assert drum.surface_ends(points(7)) is None
    assert drum.surface_ends(points(8)) == pytest.approx((-1, 1))


@pytest.mark.parametrize(("hidden", "passed"), [(24, True), (26, False)])
def test_a_surface_must_be_seen_in_three_of_four_frames(hidden: int, passed: bool) -> None:
    nothing = replace(straight(30), height=np.full(len(X), np.nan))
    found = evaluate_observation(
        observed([straight(30)] + [nothing] * hidden + [straight(30)] * (99 - hidden)), None, None
    )
    view = check(found, "surface_in_view")
    assert (view.passed, view.expected) == (passed, 1.0)
    assert view.value == pytest.approx(1 - hidden / 100)
    ending = "." if passed else ": something may hide it."
    assert view.message == f"the surface was measured in {100 - hidden} % of 100 frames{ending}"
    assert all(bool(one.doubtful) != passed for one in found.quantities)


@pytest.mark.parametrize(("odd", "passed"), [(48, True), (52, False)])
def test_more_than_half_of_odd_frame_intervals_make_every_angle_doubtful(odd: int, passed: bool) -> None:
    steps = [1.0] * (90 - odd) + [1.2] * 10 + [0.7, 1.3] * (odd // 2)
    found = evaluate_observation(
        replace(observed([straight(30)] * 101), times=np.concatenate([[0.0], np.cumsum(steps)])), None, None
    )
    timing = check(found, "frame_timing")
    assert (timing.passed, timing.value, timing.expected) == (passed, pytest.approx(odd / 100), 0.0)
    assert timing.message == (
        f"{odd} % of the frame intervals differ by more than a quarter from the usual one; means are taken over time, "
        "not over frames."
    )
    assert all(bool(one.doubtful) != passed for one in found.quantities)


def test_the_steady_part_is_counted_in_frames_moments_and_turns() -> None:
    before = 32
    rising = [straight(angle) for angle in np.linspace(0, 20, before)]
    seen = observed([*rising, *[straight(30)] * (100 - before)])
    speed = 2 * math.pi / 10  # a turn in 10 s
    found = evaluate_observation(seen, speed, None)
    steady = check(found, "steady_flow")
    count = 100 - before
    assert (steady.passed, steady.value, steady.expected) == (True, pytest.approx(count / 100), 1.0)
    assert steady.message == (
        f"{count} % of the record is steady flow, worth {count} independent moments in {(count - 1) / 100:.2g} turns; "
        "give a longer record where these are few."
    )
    assert found.warnings[-1] == (
        f"steady part: {before / 10:.3f} s to 9.900 s; before or after it the surface lies clearly elsewhere, and "
        "these frames are left out."
    )
    assert find(found, GRAPHICAL, MIDDLE).value == pytest.approx(30)
    assert find(found, GRAPHICAL, MIDDLE).detail["frames"] == count
    whole = evaluate_observation(observed([straight(30)] * 40), None, None)
    assert "independent moments; give" in check(whole, "steady_flow").message
    assert not any("steady part" in warning for warning in whole.warnings)
    single = evaluate_observation(observed([straight(30)]), None, None)
    assert [one.check for one in single.checks] == ["surface_in_view", "surface_falls"]


@pytest.mark.parametrize(("wrong", "passed"), [(0.4, True), (0.7, False)])
@pytest.mark.parametrize("half", [LOWER, UPPER])
def test_a_half_that_rises_the_wrong_way_by_three_uncertainties_is_no_surface(
    half: str, wrong: float, passed: bool
) -> None:
    angles = (-wrong, 30.0) if half == LOWER else (30.0, -wrong)
    found = evaluate_observation(observed([bent(*angles)] * 20), None, None)
    sigma = usual(half, OF_HALF[half]) / 18 * widened(27)  # as of a surface at rest
    falls = check(found, "surface_falls")
    assert (wrong < 3 * sigma) == passed == falls.passed
    assert (falls.value, falls.expected) == (pytest.approx(-wrong, abs=0.02), 0.0)
    named = "upper" if half == UPPER else "lower"
    ending = "." if passed else ", against the other half: no bed flows so; something else was taken for the surface."
    assert falls.message == f"the {named} half of the surface falls by {-wrong:.0f} ± 0 deg{ending}"


def test_a_level_surface_is_said_to_turn_anticlockwise() -> None:
    found = evaluate_observation(observed([straight(0)] * 20), None, None)
    assert find(found, GRAPHICAL, MIDDLE).detail["turning"] == "anticlockwise"


def test_avalanche_angles_are_as_uncertain_as_the_angle_and_their_number_is_said() -> None:
    times = np.arange(600) / 30
    angles = 27 + (3.0 * times + 1) % 5.0  # 5 degrees slide every 5/3 s
    slope = Series(times, np.radians(angles), "angle", "rad")
    found = drum.evaluate_slope(slope, math.radians(3.0), bead_share=0.05)
    frequency = find(found, "avalanche_frequency")
    assert frequency.value == pytest.approx(0.6, rel=0.02)
    assert (frequency.unit, frequency.method, frequency.n) == ("Hz", "maxima", 1)
    assert frequency.budget == pytest.approx({"scatter of intervals": frequency.std_uncertainty})
    main = find(found, GRAPHICAL)
    assert main.method == "slope over time"
    for name in ("avalanche_start_angle", "avalanche_stop_angle"):
        one = find(found, name)
        assert one.budget == pytest.approx({"scatter of avalanches": main.budget["flow over time"]})
        assert one.std_uncertainty == pytest.approx(main.std_uncertainty)
        assert (one.unit, one.method, one.n, one.detail["avalanches"]) == ("deg", "line, middle half", 1, 12)
    seen = observed([straight(angle) for angle in angles], apart=1 / 30, roll_uncertainty=0.5)
    start = find(evaluate_observation(seen, None, None), "avalanche_start_angle")
    assert start.budget["camera roll"] == 0.5
    assert start.std_uncertainty == pytest.approx(math.hypot(0.5, start.budget["scatter of avalanches"]))


def test_a_slope_is_read_in_degrees_or_radians_and_has_one_angle() -> None:
    for unit, value in (("deg", 25.0), ("rad", math.radians(25))):
        found = drum.evaluate_slope(Series(np.zeros(1), np.array([value]), "angle", unit), bead_share=0.05)
        (one,) = found.quantities
        assert (one.quantity, one.method) == (GRAPHICAL, "slope over time")
        assert one.value == pytest.approx(25)
        assert one.std_uncertainty == pytest.approx(usual(GRAPHICAL, MIDDLE, 0.05) * widened(10))


def test_settings_and_times_that_cannot_be_are_refused_in_a_sentence() -> None:
    two = [straight(30)] * 2
    with pytest.raises(BadInput) as refusal:
        drum.evaluate(two, np.array([1.0, 1.0]), drum_diameter=4.0)
    assert str(refusal.value) == "drum: times do not increase from profile to profile; sort the profiles by time."
    with pytest.raises(BadInput) as refusal:
        drum.evaluate(two, np.zeros(3), drum_diameter=4.0)
    assert str(refusal.value) == "drum: 2 profiles but 3 times; give one time for each profile."
    for wrong in ({"speed": 0.0}, {"bead_diameter": -1.0}):
        with pytest.raises(BadInput, match="positive"):
            drum.evaluate(two, np.arange(2.0), drum_diameter=4.0, **wrong)
    assert drum.share_of(0.006, 0.15) == pytest.approx(0.04)
    assert drum.share_of(None, 0.15) is None
    assert drum.share_of(0.006, None) is None
