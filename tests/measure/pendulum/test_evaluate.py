"""Evaluation of swings without losses, whose speeds, angles and times are known in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipk

from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.records import Track
from rigtwin.measure.pendulum.evaluate import in_order, judge, outcomes_of
from rigtwin.measure.pendulum.swing_fit import SwingFit
from rigtwin.measure.pendulum.swing_model import Swings, angles, centres

GRAVITY, LENGTH, DIAMETER = 9.81, 0.2, 0.012
RELEASE = math.radians(50)
RELEASED = 0.1  # [s]
FAST = 2 * math.sqrt(GRAVITY * LENGTH) * math.sin(RELEASE / 2)  # [m/s], at the bottom


def fall_time(amplitude, length=LENGTH):
    """A quarter of the period of a pendulum."""
    return math.sqrt(length / GRAVITY) * ellipk(math.sin(amplitude / 2) ** 2)


def angular_speed(turning, length=LENGTH):
    """Angular speed at the bottom of a pendulum that turns at this angle."""
    return 2 * math.sqrt(GRAVITY / length) * math.sin(turning / 2)


def double(turning_a, turning_b, *, way=1.0, length_b=LENGTH, second=None, damping=0.0):
    """A falls from `RELEASE` on B, both turn at these angles; `second` are speeds [FAST] after another one."""
    known = {
        "pivot_x_0": 0.0, "pivot_y_0": 0.0, "length_0": LENGTH,
        "pivot_x_1": way * DIAMETER, "pivot_y_1": length_b - LENGTH, "length_1": length_b,
        "gravity": GRAVITY, "damping": damping, "release_angle": -way * RELEASE, "release_time": RELEASED,
        "time_0": RELEASED + fall_time(RELEASE),
        "speed_0_0": way * angular_speed(turning_a), "speed_0_1": way * angular_speed(turning_b, length_b),
    }  # fmt: skip
    if second is not None:  # B is back at the bottom
        known["time_1"] = known["time_0"] + 2 * fall_time(turning_b)
        known |= {f"speed_1_{bead}": way * speed * FAST / LENGTH for bead, speed in enumerate(second)}
    return swings_of(known, 2)


def wall(turning, *, way=1.0, hit=0.0, second=None):
    """A bead falls on a wall at the angle `hit` and turns at `turning`."""
    before = math.sqrt(2 * GRAVITY / LENGTH * (math.cos(hit) - math.cos(RELEASE)))
    after = math.sqrt(2 * GRAVITY / LENGTH * (math.cos(hit) - math.cos(turning)))
    early = hit / before if abs(hit) < 0.05 else math.nan  # close to the bottom the speed hardly changes
    known = {
        "length_0": LENGTH, "gravity": GRAVITY, "release_angle": -way * RELEASE, "release_time": RELEASED,
        "time_0": RELEASED + fall_time(RELEASE) + early, "speed_0_0": -way * after,
    }  # fmt: skip
    if second is not None:
        known |= {"time_1": known["time_0"] + 2 * fall_time(turning), "speed_1_0": -way * second * after}
    return swings_of(known, 1)


def swings_of(known, beads):
    collisions = 2 if "time_1" in known else 1
    names = Swings.names(beads, collisions)
    assert known.keys() <= set(names)
    return Swings(np.array([known.get(name, 0.0) for name in names]), beads, collisions)


def single(swings):
    return {name: float(value[0]) for name, value in outcomes_of(swings.batched()).items()}


SIGMA = {"release_angle": 1e-3, "length_0": 1e-4, "speed_0_1": 2e-2, "speed_0_0": 1e-2}


def fitted(swings, *, until=1.4, since=0.0, noise=1e-5, sigma=None, miss=1.0):
    """The fit that has these swings as its result, with independent uncertainties of some parameters."""
    times = np.arange(since, until, 1 / 240)
    places = centres(swings, angles(swings, times)[0])[:, :, 0]
    random = np.random.default_rng(1)
    residuals = tuple(noise * random.normal(size=places[0].shape) for _ in places)
    if miss > 1:  # residuals that stay from frame to frame
        residuals = tuple(each + miss * noise * np.sin(times / 0.1)[:, None] for each in residuals)
    tracks = tuple(
        Track(times, place + off, np.full(len(times), noise), body)
        for place, off, body in zip(places, residuals, "AB"[: swings.beads], strict=True)
    )
    sigma = SIGMA if sigma is None else sigma
    parts = {}
    for cause, taken in (("tracking", ("speed_0_0", "speed_0_1")), ("shape", ("release_angle", "length_0"))):
        names = Swings.names(swings.beads, swings.collisions)
        parts[cause] = np.diag([sigma.get(name, 0.0) ** 2 if name in taken else 0.0 for name in names])
    # a step for every parameter, also of those that are known
    covariance = sum(parts.values()) + 1e-10 * np.eye(len(swings.vector))
    used = tuple(np.ones(len(times), dtype=bool) for _ in tracks)
    return SwingFit(swings, tracks, used, residuals, noise, covariance, parts)


def pick(found, quantity, method=None, **detail):
    (one,) = (
        each for each in found.quantities
        if each.quantity == quantity and method in (None, each.method) and detail.items() <= each.detail.items()
    )  # fmt: skip
    return one


HEAVY, LIGHT = math.radians(10), math.radians(36)  # turning angles of A and B
E_PAIR = (math.sin(LIGHT / 2) - math.sin(HEAVY / 2)) / math.sin(RELEASE / 2)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_without_losses_speeds_angles_and_heights_of_a_pair_give_one_restitution(way):
    found = single(double(HEAVY, LIGHT, way=way))
    assert found["restitution_0"] == pytest.approx(E_PAIR, rel=1e-4)
    assert found["from_angles"] == pytest.approx(E_PAIR, rel=1e-4)
    assert found["energy_ratio_root"] == pytest.approx(math.sin(LIGHT / 2) / math.sin(RELEASE / 2), rel=1e-4)
    assert found["angle_ratio"] == pytest.approx(36 / 50, rel=1e-4)
    assert (found["release"], found["way"]) == (pytest.approx(RELEASE), way)
    assert [found["turning_0"], found["turning_1"]] == pytest.approx([HEAVY, LIGHT], rel=1e-4)
    assert found["approach_0"] == pytest.approx(FAST, rel=1e-4)
    assert found["speed"] == pytest.approx(FAST, rel=1e-4)
    after = 2 * math.sqrt(GRAVITY * LENGTH) * (math.sin(LIGHT / 2) + math.sin(HEAVY / 2))
    assert found["speeds_after"] == pytest.approx(after)
    assert found["momentum"] == pytest.approx(after / FAST, rel=1e-4)
    assert found["distance"] == pytest.approx(DIAMETER, rel=1e-3)
    assert [found["gravity"], found["length"], found["pull"]] == pytest.approx([GRAVITY, LENGTH, GRAVITY / LENGTH])


def test_a_bead_that_bounces_back_counts_negative():
    found = single(double(-HEAVY, LIGHT))
    expected = (math.sin(LIGHT / 2) + math.sin(HEAVY / 2)) / math.sin(RELEASE / 2)
    assert found["turning_0"] == pytest.approx(-HEAVY, rel=1e-4)
    assert found["restitution_0"] == pytest.approx(expected, rel=1e-4)
    assert found["from_angles"] == pytest.approx(expected, rel=1e-4)
    assert found["momentum"] == pytest.approx(
        (math.sin(LIGHT / 2) - math.sin(HEAVY / 2)) / math.sin(RELEASE / 2), rel=1e-4
    )


def test_heights_of_threads_of_two_lengths_are_those_of_the_beads():
    found = single(double(HEAVY, LIGHT, length_b=0.3))
    rise = 0.3 * (1 - math.cos(LIGHT)) / (LENGTH * (1 - math.cos(RELEASE)))
    assert found["energy_ratio_root"] == pytest.approx(math.sqrt(rise), rel=1e-4)
    assert found["length"] == pytest.approx(0.25)
    assert found["pull"] == pytest.approx(GRAVITY / LENGTH)
    speeds = [2 * math.sqrt(GRAVITY * length) * math.sin(turn / 2) for length, turn in ((LENGTH, HEAVY), (0.3, LIGHT))]
    assert found["restitution_0"] == pytest.approx((speeds[1] - speeds[0]) / FAST, rel=1e-4)


def test_a_second_collision_counts_the_speeds_of_both_beads():
    found = single(double(0.0, RELEASE, second=(-0.8, -0.1)))  # B comes back as fast as A came
    assert found["restitution_0"] == pytest.approx(1.0, rel=1e-4)
    assert found["restitution_1"] == pytest.approx((-0.1 + 0.8) / (0 + 1), rel=1e-3)
    assert [found["approach_0"], found["approach_1"]] == pytest.approx([FAST, FAST], rel=1e-3)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_without_losses_speeds_angles_and_heights_at_a_wall_give_one_restitution(way):
    found = single(wall(LIGHT, way=way, second=0.6))
    expected = math.sin(LIGHT / 2) / math.sin(RELEASE / 2)
    for name in ("restitution_0", "from_angles", "from_heights"):
        assert found[name] == pytest.approx(expected, rel=1e-4)
    assert found["restitution_1"] == pytest.approx(0.6, rel=1e-3)
    assert [found["approach_0"], found["approach_1"]] == pytest.approx([FAST, expected * FAST], rel=1e-3)
    assert found["contact_angle"] == pytest.approx(0, abs=1e-4)
    assert found["turning_0"] == pytest.approx(-LIGHT, rel=1e-4)
    assert (found["release"], found["way"], found["length"]) == (pytest.approx(RELEASE), way, pytest.approx(LENGTH))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_heights_count_from_the_contact_with_a_wall_that_stands_off(way):
    hit = math.radians(2.5)
    found = single(wall(LIGHT, way=way, hit=hit))
    fallen, risen = math.cos(hit) - math.cos(RELEASE), math.cos(hit) - math.cos(LIGHT)
    assert found["contact_angle"] == pytest.approx(hit, abs=1e-4)
    assert found["from_heights"] == pytest.approx(math.sqrt(risen / fallen), rel=1e-3)
    assert found["restitution_0"] == pytest.approx(math.sqrt(risen / fallen), rel=1e-3)
    assert found["from_angles"] == pytest.approx(math.sin(LIGHT / 2) / math.sin(RELEASE / 2), rel=1e-3)


def test_values_of_a_pair_have_units_methods_and_what_distinguishes_them():
    found = judge(fitted(double(HEAVY, LIGHT)))
    listed = [(one.quantity, one.method, one.unit) for one in found.quantities]
    assert listed == [
        ("restitution_pair", "velocity", "1"), ("restitution_pair", "angle", "1"), ("energy_ratio_root", "height", "1"),
        ("release_angle", "swing", "deg"), ("rebound_angle", "swing", "deg"), ("rebound_angle", "swing", "deg"),
    ]  # fmt: skip
    velocity, angle, ratio, release, first, second = found.quantities
    assert velocity.detail == {"collision": 1, "impact_speed_m_per_s": round(FAST, 5)}
    assert angle.detail == {"collision": 1}
    assert ratio.detail == {"collision": 1, "angle_ratio": 0.72, "equals": "(1+e)/2, not e"}
    assert release.detail == {"body": "A", "side": "left"}
    assert first.detail == {"body": "A", "side": "right"}
    assert second.detail == {"body": "B", "side": "right"}
    assert [release.value, first.value, second.value] == pytest.approx([50, 10, 36], rel=1e-4)
    for one in found.quantities:
        assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))


@pytest.mark.parametrize(("way", "sides"), [(1.0, ["left", "left", "right"]), (-1.0, ["right", "right", "left"])])
def test_sides_are_those_of_the_picture(way, sides):
    found = judge(fitted(double(-HEAVY, LIGHT, way=way)))
    assert [one.detail["side"] for one in found.quantities if one.unit == "deg"] == sides
    assert [one.value for one in found.quantities if one.unit == "deg"] == pytest.approx([50, 10, 36], rel=1e-4)


def test_uncertainties_of_speeds_and_angles_are_propagated():
    found = judge(fitted(double(HEAVY, LIGHT)))
    velocity = pick(found, "restitution_pair", "velocity")
    # e = (w_B - w_A) L / v, with v proportional to sqrt(L) sin(a / 2) up to the moment of the contact, which is fixed
    by_speed = math.hypot(SIGMA["speed_0_0"], SIGMA["speed_0_1"]) * LENGTH / FAST
    assert velocity.budget["tracking"] == pytest.approx(by_speed, rel=0.01)
    release = pick(found, "release_angle")
    assert release.budget["shape"] == pytest.approx(math.degrees(SIGMA["release_angle"]), rel=1e-3)
    assert release.budget["tracking"] == pytest.approx(0, abs=1e-6)
    rebound = pick(found, "rebound_angle", body="B")
    # w = 2 sqrt(g / L) sin(b / 2)
    per_speed = 1 / (math.sqrt(GRAVITY / LENGTH) * math.cos(LIGHT / 2))
    assert rebound.budget["tracking"] == pytest.approx(math.degrees(SIGMA["speed_0_1"] * per_speed), rel=0.01)


def test_losses_of_the_swing_widen_what_depends_on_angles_and_heights():
    swings = double(HEAVY, LIGHT, damping=0.3)
    found = judge(fitted(swings))
    velocity, angle = (pick(found, "restitution_pair", method) for method in ("velocity", "angle"))
    assert angle.value < velocity.value - 0.01
    assert angle.budget["swing_losses"] == pytest.approx(velocity.value - angle.value)
    assert "swing_losses" not in velocity.budget
    at_wall = wall(LIGHT)
    slowed = at_wall.vector.copy()
    slowed[at_wall.index("damping")] = 0.3
    found = judge(fitted(replace(at_wall, vector=slowed)))
    velocity, angle, height = (pick(found, "restitution_wall", method) for method in ("velocity", "angle", "height"))
    for one in (angle, height):
        assert one.budget["swing_losses"] == pytest.approx(abs(velocity.value - one.value))
        assert one.budget["swing_losses"] > 0.01


def test_a_shift_of_the_lit_centre_enters_each_angle_and_what_follows_from_them():
    shading = 2e-4  # [m]
    step = shading / LENGTH

    def restitution(release, first, second):
        return (math.sin(second / 2) - math.sin(first / 2)) / math.sin(release / 2)

    def ratio(release, _, second):
        return math.sin(second / 2) / math.sin(release / 2)

    def spread(function, *at):
        shifted = [function(*(a + (step if k == n else 0) for k, a in enumerate(at))) for n in range(3)]
        return math.hypot(*(one - function(*at) for one in shifted))

    found = judge(fitted(double(HEAVY, LIGHT)), shading=shading)
    for one in found.quantities:
        if one.unit == "deg":
            assert one.budget["shading"] == pytest.approx(math.degrees(step), rel=1e-3)
    turns = (RELEASE, HEAVY, LIGHT)
    angle, height = pick(found, "restitution_pair", "angle"), pick(found, "energy_ratio_root")
    assert angle.budget["shading"] == pytest.approx(spread(restitution, *turns), rel=0.01)
    assert height.budget["shading"] == pytest.approx(spread(ratio, *turns), rel=0.01)
    assert "shading" not in pick(found, "restitution_pair", "velocity").budget
    assert not any("shading" in one.budget for one in judge(fitted(double(HEAVY, LIGHT))).quantities)
    at_wall = judge(fitted(wall(LIGHT)), shading=shading)
    for method in ("angle", "height"):
        part = pick(at_wall, "restitution_wall", method).budget["shading"]
        assert part == pytest.approx(spread(ratio, RELEASE, 0.0, LIGHT), rel=0.01)


def equal_masses(e=0.6):
    """Turning angles after a collision of equal beads, which keeps the momentum."""
    shares = ((1 - e) / 2, (1 + e) / 2)
    return tuple(2 * math.asin(share * math.sin(RELEASE / 2)) for share in shares)


def test_a_sound_record_has_no_doubtful_value_and_checks_of_what_is_stated():
    fit = fitted(double(*equal_masses()))
    found = judge(fit)
    assert [one.check for one in found.checks] == ["momentum", "gravity", "swing_residuals"]
    assert all(one.passed for one in found.checks)
    assert not found.warnings
    assert not any(one.doubtful for one in found.quantities)
    assert pick(found, "restitution_pair", "velocity").value == pytest.approx(0.6, rel=1e-3)
    assert pick(found, "energy_ratio_root").value == pytest.approx(0.8, rel=1e-3)
    stated = judge(fit, LENGTH, DIAMETER, 0.002)
    assert len(stated.checks) == 5
    assert all(one.passed for one in stated.checks)
    momentum = stated.checks[0]
    assert momentum.expected == pytest.approx(0.002 * FAST, rel=1e-3)
    one_bead = judge(fitted(wall(LIGHT)), LENGTH, DIAMETER)
    assert [one.check for one in one_bead.checks][:3] == ["contact_angle", "gravity", "swing_residuals"]
    assert len(one_bead.checks) == 4  # there is no second bead at a distance


def test_beads_that_do_not_meet_head_on_make_what_the_collision_gives_doubtful():
    sound = fitted(double(*equal_masses()))
    for fit, diameter, number in ((fitted(double(HEAVY, LIGHT)), None, 1), (sound, 0.03, 1)):
        found = judge(fit, bead_diameter=diameter)
        wrong = [check for check in found.checks if not check.passed]
        assert len(wrong) == number
        assert found.warnings == tuple(check.message for check in wrong)
        for one in found.quantities:
            assert (wrong[0].message.rstrip(".") in one.doubtful) == (one.unit == "1")


def test_residuals_that_stay_make_every_value_doubtful():
    found = judge(fitted(double(*equal_masses()), miss=20.0))
    (wrong,) = (check for check in found.checks if not check.passed)
    assert wrong.check == "swing_residuals"
    assert all(wrong.message.rstrip(".") in one.doubtful for one in found.quantities)


def test_a_record_without_release_or_turn_makes_what_needs_them_doubtful():
    swings = double(*equal_masses())
    late = judge(fitted(swings, since=RELEASED + 0.02))
    assert "begins after the release" in pick(late, "release_angle").doubtful
    assert "begins after the release" in pick(late, "restitution_pair", "angle").doubtful
    assert "before its fall" in pick(late, "restitution_pair", "velocity").doubtful
    assert "before its fall" not in pick(late, "release_angle").doubtful
    assert not pick(late, "rebound_angle", body="B").doubtful
    short = judge(fitted(swings, until=RELEASED + fall_time(RELEASE) + 0.08))
    for one in short.quantities:
        assert ("the record ends before" in one.doubtful) == (
            one.quantity == "rebound_angle" or one.method in ("angle", "height")
        )


def test_a_wall_off_the_vertical_leaves_speeds_and_heights():
    found = judge(fitted(wall(LIGHT, hit=math.radians(2.5))))
    (wrong,) = (check for check in found.checks if not check.passed)
    assert wrong.check == "contact_angle"
    for one in found.quantities:
        assert ("past the vertical" in one.doubtful) == (one.method == "angle")


def test_a_restitution_surely_above_one_is_a_wrong_track():
    shares = ((1.05, 0.02, True), (1.05, 0.03, False), (0.95, 0.01, False))  # with their standard uncertainties
    for second, share, doubtful in shares:
        turning = 2 * math.asin(second * math.sin(RELEASE / 2))
        spread = {"speed_0_0": share * FAST / LENGTH}
        found = judge(fitted(wall(turning), sigma=spread))
        reason = pick(found, "restitution_wall", "velocity").doubtful
        assert reason == ("a restitution above 1 is not possible: a track is wrong" if doubtful else "")


def named(*names):
    time = np.arange(5.0)
    return [Track(time, np.zeros((5, 2)), time, name) for name in names]


def test_tracks_are_ordered_by_their_names():
    b, a = named(" b", "a ")
    assert in_order([b, a], "double") == (a, b)
    assert in_order([b, a], "wall") == (a,)
    (bead,) = named("bead")
    assert in_order([bead], "wall") == (bead,)


@pytest.mark.parametrize(
    ("names", "variant", "error", "message"),
    [
        (("B", "C"), "wall", BadInput, "A wall pendulum has one bead; this record holds 2 (B, C)."),
        (("A",), "double", NothingToMeasure,
         "the record holds one track; a double pendulum needs those of bead A and bead B (for a wall: variant wall)."),
        (("A", "C"), "double", BadInput,
         "The record names its beads A, C; name the released bead A and the hanging one B."),
        (("B", "C"), "double", BadInput,
         "The record names its beads B, C; name the released bead A and the hanging one B."),
    ],
)  # fmt: skip
def test_tracks_that_do_not_match_the_variant_are_refused(names, variant, error, message):
    with pytest.raises(error) as refusal:
        in_order(named(*names), variant)
    assert str(refusal.value) == message
