"""Evaluation of a tilt: the way down the plate, friction and its budgets, and what each check spoils."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Check
from rigtwin.lab.records import Series, Track
from rigtwin.measure.tilt.evaluate import (
    check_variant,
    evaluate,
    evaluate_run,
    judged_quantities,
    onset_of,
    way_down,
)
from rigtwin.measure.tilt.onset import Onset, Run, Way, descent, find_onset, find_run, least_run

G = 9.81
STARTS = 1.5  # [s]
AT_ONSET, IN_MOTION = math.radians(20), 0.3  # [rad], angle of the plate; kinetic friction
RATE = math.radians(2)  # [rad/s]


def plate(time):
    return AT_ONSET + RATE * (time - STARTS)


def slid(time, friction=IN_MOTION):
    """Way of a body that slides from `STARTS` on; the plate turns by a degree meanwhile."""
    fine = np.arange(0.0, time[-1] + 1e-3, 1e-4)
    push = np.where(fine > STARTS, G * (np.sin(plate(fine)) - friction * np.cos(plate(fine))), 0.0)
    return np.interp(time, fine, np.cumsum(np.cumsum(push) * 1e-4) * 1e-4)


def placed(time, along, across=0.006, angle=plate):
    """Track of a body at this distance from the axis along the plate and above it."""
    alpha = angle(time)
    position = [along * np.cos(alpha) - across * np.sin(alpha), along * np.sin(alpha) + across * np.cos(alpha)]
    return Track(time, np.column_stack(position), np.full(len(time), 2e-5))


def record(*, until=2.0, noise=2e-5, scale=1.0, since=0.0):
    time = np.arange(since, until, 0.01)
    random = np.random.default_rng(4)
    track = placed(time, scale * (0.15 - slid(time)) + noise * random.normal(size=len(time)), 0.006 * scale)
    return Series(time, plate(time) + 1e-4 * random.normal(size=len(time)), "plate_angle", "rad"), track


def pick(found, name):
    (one,) = (each for each in found.quantities if each.quantity == name)
    return one


# --- way down the plate -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_the_way_down_is_the_track_turned_back_by_the_plate(unit):
    time = np.linspace(0, 2, 201)
    angles = plate(time) if unit == "rad" else np.degrees(plate(time))
    # a clump of two beads on both sides of its middle; as the plate is longer for one its distance is another
    beads = [placed(time, 0.15 + off - slid(time), across) for off, across in ((-0.01, 0.004), (0.03, 0.012))]
    beads[1] = replace(beads[1], sigma=np.full(201, 6e-5))
    way = way_down(Series(time, angles, "plate_angle", unit), beads, "slide", 0.008, 0.05)
    assert way.time == pytest.approx(time)
    assert way.angle == pytest.approx(plate(time))
    assert way.down == pytest.approx(slid(time), abs=1e-9)
    assert way.sigma == pytest.approx(np.full(201, 4e-5))
    assert (way.factor, way.scale_uncertainty, way.drift) == (1.0, 0.05, 0.008)
    assert way.reach == pytest.approx(np.mean([math.hypot(0.14, 0.004), math.hypot(0.18, 0.012)]))


def test_a_rolling_body_has_five_sevenths_of_gravity_and_an_unknown_one_the_usual_drift():
    angles, track = record()
    way = way_down(angles, [track], "roll", None, math.inf)
    assert way.factor == pytest.approx(5 / 7)
    assert way.drift == 0.006


def test_the_way_counts_from_the_median_of_the_first_twentieth():
    time = np.linspace(0, 2, 200)
    along = np.full(200, 0.15)
    along[:4] += 0.001  # of ten
    angles = Series(time, plate(time), "plate_angle", "rad")
    assert way_down(angles, [placed(time, along)], "slide", None, 0.02).down[50:] == pytest.approx(np.zeros(150))
    along[:7] += 0.001
    assert way_down(angles, [placed(time, along)], "slide", None, 0.02).down[50:] == pytest.approx(np.full(150, 0.001))


def test_only_times_at_which_body_and_angle_are_known_count():
    angles, track = record()
    value, seen = angles.value.copy(), angles.time.copy()
    value[50], seen[60] = np.nan, np.nan  # lie between their neighbours
    part = Series(seen[20:], value[20:], "plate_angle", "rad")
    way = way_down(part, [track], "slide", None, 0.02)
    assert way.time == pytest.approx(track.time[20:])
    assert way.angle[30] == pytest.approx((value[49] + value[51]) / 2)
    assert np.isfinite(way.angle).all()


def test_an_angle_that_is_known_later_than_the_body_costs_no_more_than_its_time():
    angles, track = record()
    late = replace(angles, time=angles.time[40:], value=angles.value[40:])
    way = way_down(late, [track], "slide", None, 0.02)
    assert len(way.time) == 160
    assert way.down[:50] == pytest.approx(np.zeros(50), abs=1e-4)


def cut(series, count):
    return replace(series, time=series.time[:count], value=series.value[:count])


def test_eight_times_are_enough_and_seven_are_refused():
    angles, track = record()
    assert len(way_down(cut(angles, 8), [track], "slide", None, 0.02).time) == 8
    with pytest.raises(NothingToMeasure) as refusal:
        way_down(cut(angles, 7), [track], "slide", None, 0.02)
    assert str(refusal.value) == (
        "measure tilt: the plate's angle is known in only 7 frames, 8 are needed; film the plate from the side, with "
        "enough light, or state it with --plate x1,y1,x2,y2."
    )
    later = replace(angles, time=angles.time - 1.925)
    with pytest.raises(NothingToMeasure) as refusal:
        way_down(later, [track], "slide", None, 0.02)
    assert str(refusal.value) == (
        "measure tilt: body and angle are known together in only 7 frames, 8 are needed; give records that overlap in "
        "time."
    )
    nothing = Track(np.empty(0), np.empty((0, 2)), np.empty(0))
    with pytest.raises(NothingToMeasure) as refusal:
        way_down(angles, [track, nothing], "slide", None, 0.02)
    assert str(refusal.value) == (
        "measure tilt: the body is seen in no frame together with the plate's angle; state where it rests with "
        "--bead-at frame:x,y, or give a record that shows both."
    )
    with pytest.raises(BadInput) as refused:
        way_down(angles, [], "slide", None, 0.02)
    assert str(refused.value) == "measure tilt: the record holds no track of the body; give one beside the angle."
    with pytest.raises(BadInput) as refused:
        check_variant("fall")
    assert str(refused.value) == "measure tilt: variant 'fall' is unknown; give 'slide' or 'roll'."


# --- onset ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sliding():
    angles, track = record()
    return way_down(angles, [track], "slide", 0.006, 0.02)


def test_a_slide_gives_both_frictions_and_the_time_at_which_it_starts():
    angles, track = record()
    found = evaluate(angles, [track], variant="slide", bead_diameter=0.006)
    friction, angle, time, moving = found.quantities
    assert [one.quantity for one in found.quantities] == [
        "static_friction", "static_friction_angle", "onset_time", "kinetic_friction"
    ]  # fmt: skip
    assert [one.unit for one in found.quantities] == ["1", "deg", "s", "1"]
    assert [one.method for one in found.quantities] == ["onset", "onset", "onset", "acceleration"]
    assert angle.value == pytest.approx(20, abs=0.05)
    assert friction.value == pytest.approx(math.tan(math.radians(angle.value)))
    assert time.value == pytest.approx(STARTS, abs=0.01)
    assert moving.value == pytest.approx(IN_MOTION, abs=4 * moving.std_uncertainty)
    # a record states no uncertainty of its scale: two percent, of the acceleration over g
    assert moving.budget["scale"] == pytest.approx(0.02 * (friction.value - moving.value), rel=1e-6)


def test_without_a_run_the_way_that_was_seen_is_stated(sliding):
    still = sliding.time < STARTS - 0.1
    rest = replace(sliding, time=sliding.time[still], angle=sliding.angle[still], down=sliding.down[still])
    share = descent(rest) / least_run(rest)
    begin = (
        "r01: in 140 frames from 0.000 to 1.390 s, while the plate turns from {} to {} degrees, no run of the body "
        f"down the plate was found (it moves down it by {share:.2f} times the least way of a run)"
    )
    ends = [f"{math.degrees(one):.1f}" for one in (rest.angle[0], rest.angle[-1])]
    at_rest = replace(rest, angle=np.linspace(0.30, 0.306, 140))
    backwards = replace(rest, angle=rest.angle[::-1].copy())
    for way, message in (
        (rest, begin.format(*ends) + "; film on until it has run down the plate, or state the body with --bead-at "
               "frame:x,y."),
        (at_rest, begin.format("17.2", "17.5") + "; if another object was followed, state the body with --bead-at "
                  "frame:x,y, or give a sharp clip of the whole tilt."),
        (backwards, begin.format(*ends[::-1]) + "; check whether the clip plays backwards, or state the body with "
                    "--bead-at frame:x,y."),
    ):  # fmt: skip
        with pytest.raises(NothingToMeasure) as refusal:
            onset_of(way, "r01")
        assert str(refusal.value) == message
    turning = replace(rest, angle=np.linspace(0.30, 0.308, 140))  # by more than 0.4 degrees
    with pytest.raises(NothingToMeasure, match="film on until"):
        onset_of(turning, "r01")


@pytest.mark.parametrize("scale", [0.65, 1.25])
def test_a_scale_wrong_by_more_than_three_tenths_has_no_say_in_the_onset(scale):
    angles, track = record(scale=scale)
    way = way_down(angles, [track], "slide", 0.006, 0.02)
    run, onset = onset_of(way, "r01")
    assert run == find_run(way)
    expected = find_onset(replace(way, scale_uncertainty=math.inf) if scale == 0.65 else way, run)
    assert expected is not None
    assert onset.gain == pytest.approx(scale, rel=0.1)
    assert (onset.time, onset.gain) == (expected.time, expected.gain)


def test_a_run_that_ends_right_after_its_start_is_refused_with_what_was_seen(sliding):
    part = slice(151, 154)
    short = Way(
        np.concatenate([np.arange(5) * 0.01, [0.05, 0.06, 0.07]]), np.linspace(0.3, 0.31, 8),
        np.array([0, 0, 0, 0, 0, 0.003, 0.006, 0.01]), np.full(8, 1e-5), 1.0, 0.02, 0.006, 0.15,
    )  # fmt: skip
    run = find_run(short)
    assert run is not None
    assert find_onset(short, run) is None
    with pytest.raises(NothingToMeasure) as refusal:
        onset_of(short, "r01")
    assert str(refusal.value) == (
        f"r01: no onset could be fitted to the body's {run.start} positions before it moves down the plate at "
        f"{short.time[run.start]:.3f} s and its {run.end - run.start} positions until {short.time[run.end]:.3f} s; let "
        "the clip begin at least 0.2 s before and end after the run."
    )
    assert sliding.down[part].max() < 0.01  # of such a way an onset is found in a whole record


# --- quantities -------------------------------------------------------------------------------------------------------


def fitted(way, angle=AT_ONSET, moving=IN_MOTION, **more):
    known = {
        "time": STARTS, "time_sigma": 0.004, "angle": angle, "angle_sigma": 2e-3, "moving_friction": moving,
        "moving_sigma": 0.005, "gain": 1.0, "gain_sigma": 0.01, "axis": 0.0, "axis_sigma": 1e-4, "creep": 0.0,
        "creep_sigma": 1e-5, "noise": 2e-5, "used": np.ones(len(way.time), dtype=bool), "fitted": way.down,
        "rate": RATE, "under_way": -20.0,
    }  # fmt: skip
    return Onset(**(known | more))


RUN = Run(155, 195, 0.05)


def test_friction_is_the_tangent_and_its_budget_has_the_slope_of_the_tangent(sliding):
    onset = fitted(sliding)
    found = evaluate_run(sliding, RUN, onset, "slide", 0.006, {"camera roll": 3e-3}, {"exposure": 0.003})
    friction, angle, time, moving = found.quantities
    tangent = math.tan(AT_ONSET)
    slope = (math.tan(AT_ONSET + 1e-6) - math.tan(AT_ONSET - 1e-6)) / 2e-6
    assert (friction.value, angle.value, time.value) == (pytest.approx(tangent), pytest.approx(20), STARTS)
    assert angle.budget == pytest.approx({"onset": math.degrees(2e-3), "camera roll": math.degrees(3e-3)})
    assert friction.budget == pytest.approx({"onset": slope * 2e-3, "camera roll": slope * 3e-3})
    assert time.budget == {"onset": 0.004, "exposure": 0.003}
    assert time.std_uncertainty == pytest.approx(0.005)
    assert moving.value == IN_MOTION
    assert moving.budget == pytest.approx(
        {"acceleration": 0.005, "scale": 0.02 * (tangent - IN_MOTION), "camera roll": slope * 3e-3}
    )
    for one in found.quantities:
        assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))
        assert not one.doubtful
    assert [check.check for check in found.checks] == [
        "gravity", "proportions", "variant", "creep", "steady_rise", "run_residuals", "onset_certainty", "rest_seen"
    ]  # fmt: skip


def test_a_rough_scale_counts_as_fifteen_percent_at_most(sliding):
    rough = replace(sliding, scale_uncertainty=0.4)
    moving = pick(evaluate_run(rough, RUN, fitted(rough), "slide", 0.006), "kinetic_friction")
    assert moving.budget["scale"] == pytest.approx(0.15 * (math.tan(AT_ONSET) - IN_MOTION))
    faster = pick(evaluate_run(sliding, RUN, fitted(sliding, moving=0.4), "slide", 0.006), "kinetic_friction")
    assert faster.budget["scale"] == pytest.approx(0.02 * (0.4 - math.tan(AT_ONSET)))


def test_without_a_scale_there_is_no_kinetic_friction_and_a_warning(sliding):
    unknown = replace(sliding, scale_uncertainty=math.inf)
    found = evaluate_run(unknown, RUN, fitted(unknown), "slide", 0.006)
    assert [one.quantity for one in found.quantities] == ["static_friction", "static_friction_angle", "onset_time"]
    assert any(warning.startswith("frame rate not confirmed") for warning in found.warnings)
    assert "gravity" not in [check.check for check in found.checks]
    assert found.quantities[2].budget == {"onset": 0.004}


def test_a_rolling_body_has_rolling_friction_and_none_of_sliding(sliding):
    rolling = replace(sliding, factor=5 / 7)
    found = evaluate_run(rolling, RUN, fitted(rolling, moving=math.tan(AT_ONSET)), "roll", 0.006)
    assert [one.quantity for one in found.quantities] == ["rolling_friction", "rolling_friction_angle", "onset_time"]


ALL_OF_THEM = ("friction", "angle", "time", "kinetic")


@pytest.mark.parametrize(
    ("check", "spoils"),
    [
        ("variant", ALL_OF_THEM), ("creep", ALL_OF_THEM), ("steady_rise", ALL_OF_THEM), ("run_residuals", ALL_OF_THEM),
        ("rest_seen", ALL_OF_THEM), ("picture_at_rest", ALL_OF_THEM), ("onset_certainty", ALL_OF_THEM),
        ("shape", ALL_OF_THEM), ("arm_in_view", ALL_OF_THEM), ("static_camera", ALL_OF_THEM),
        ("level", ("friction", "angle", "kinetic")), ("camera_roll", ("friction", "angle", "kinetic")),
        ("proportions", ("friction", "angle", "kinetic")),
        ("gravity", ("time", "kinetic")), ("frame_timing", ("time", "kinetic")),
        ("compression", ("time",)), ("bead_size", ("kinetic",)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["static", "rolling"])
def test_a_failed_check_spoils_what_depends_on_it(sliding, check, spoils, kind):
    variant = "slide" if kind == "static" else "roll"
    quantities = evaluate_run(sliding, RUN, fitted(sliding), variant, 0.006).quantities
    plain = [replace(one, doubtful="") for one in quantities]
    names = {"friction": f"{kind}_friction", "angle": f"{kind}_friction_angle", "time": "onset_time",
             "kinetic": "kinetic_friction"}  # fmt: skip
    failed = Check(check, False, 0.0, 1.0, "it failed.")
    found = judged_quantities(plain, [failed, Check("level", True, 0.0, 1.0, "level.")])
    for one in found:
        assert bool(one.doubtful) == (one.quantity in {names[name] for name in spoils})
    assert judged_quantities(plain, [replace(failed, passed=True)]) == tuple(plain)
