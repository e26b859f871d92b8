"""The independent labs move as closed forms say, and an effect gains what it is drawn to gain."""

import json
import math

import numpy as np
import pytest

from rigtwin.benchmarks.diagnose import independent_labs_double as double
from rigtwin.benchmarks.diagnose import independent_labs_drop as drop
from rigtwin.benchmarks.diagnose import independent_labs_pendulum as pendulum
from rigtwin.benchmarks.diagnose import independent_labs_roll as roll
from rigtwin.benchmarks.diagnose import independent_labs_slide as slide
from rigtwin.benchmarks.diagnose.effect_names import is_named
from rigtwin.benchmarks.diagnose.independent_labs import Case, plan, write
from rigtwin.benchmarks.diagnose.independent_labs_effects import ALL, PAIRS
from rigtwin.benchmarks.diagnose.independent_labs_fluids import abraham, brown_lawler, schiller_naumann, white
from rigtwin.benchmarks.diagnose.independent_labs_gain import Strength
from rigtwin.benchmarks.diagnose.independent_labs_types import Condition, Hidden, Sphere
from rigtwin.compare.diagnose.data.read_lab_json import read_tracked_lab

G = 9.81
BEAD = Sphere("PM60", "PMMA", 0.006, 1190, 3.1e9, 0.38, 0.8)
FALL = {"height": 0.5, "restitution": 0.7, "sliding": 0.4, "begin": 0.02, "impacts": 2, "cut": 0.5}


def test_a_fall_with_linear_drag_follows_its_exact_solution():
    gamma = 1.7  # [1/s]

    def force(_t, s, sphere):
        return -sphere.mass * gamma * s[2], -sphere.mass * gamma * s[3]

    motion = drop.move(Condition({}, BEAD, 1, FALL), {}, Hidden(force=force))
    t = np.linspace(0, 0.9, 50) * (motion.starts[2] - motion.starts[1])
    fallen = G / gamma * t - G / gamma**2 * (1 - np.exp(-gamma * t))
    assert motion.at(t + 0.02)[1] == pytest.approx(0.5 + BEAD.radius - fallen, abs=1e-7)


def test_an_impact_keeps_the_square_of_the_restitution_of_the_energy_on_a_tilted_plate_too():
    level = 0.03
    motion = drop.move(Condition({}, BEAD, 1, FALL), {}, Hidden({"level": level}))
    struck = motion.starts[2]
    before, after = (
        np.diff(motion.at(struck + np.array(t)), axis=1)[:, 0] / 1e-5 for t in ([-2e-5, -1e-5], [1e-5, 2e-5])
    )
    normal, along = np.array([-math.sin(level), math.cos(level)]), np.array([math.cos(level), math.sin(level)])
    assert after @ normal == pytest.approx(-0.7 * (before @ normal), rel=1e-3)
    assert after @ along == pytest.approx(5 / 7 * (before @ along), rel=1e-2)  # a sphere that was not spinning rolls


def test_a_small_swing_has_the_period_of_a_thread_and_a_stretched_one_that_of_its_length():
    condition = Condition({}, BEAD, 1, {"length": 0.4, "angle": 0.02, "begin": 0.02, "duration": 6.0})
    for hidden, length in ((Hidden(), 0.4), (Hidden(thread=lambda _t, r, _tension: 1.1 * r), 0.44)):
        t = np.linspace(0.02, 6.0, 20_000)
        x = pendulum.move(condition, {}, hidden).at(t)[0]
        zeros = t[1:][np.diff(np.sign(x)) != 0]
        period = 2 * (zeros[-1] - zeros[0]) / (len(zeros) - 1)
        assert period == pytest.approx(2 * math.pi * math.sqrt(length / G) * (1 + 0.02**2 / 16), rel=1e-4)


def test_a_swing_without_friction_keeps_its_energy_and_dry_friction_takes_its_moment_times_the_angle():
    condition = Condition({}, BEAD, 1, {"length": 0.3, "angle": 0.6, "begin": 0.0, "duration": 3.0})
    moment = 2e-3 * BEAD.mass * G * 0.3

    def torque(_t, _angle, rate, _length, _sphere):
        return -moment * math.tanh(rate / 1e-4)

    lost = []
    for hidden in (Hidden(), Hidden(torque=torque)):
        _, y = pendulum.move(condition, {}, hidden).at(np.linspace(0.3, 1.6, 20_000))
        lost.append(-0.3 * math.cos(0.6) - y.max())  # of the height of the release, once it has swung across and back
    assert lost[0] == pytest.approx(0.0, abs=1e-6)
    assert BEAD.mass * G * lost[1] == pytest.approx(moment * 2 * 0.6, rel=0.02)


def test_a_clump_slips_where_the_slope_passes_its_friction_and_slides_as_newton_says():
    nominal = {
        "start": math.radians(15), "rate": math.radians(0.01), "waiting": 5.0, "mass": 1e-3, "place": 0.25,
        "stop": 0.05, "friction": math.tan(math.radians(16)),
    }  # fmt: skip
    motion = slide.move(Condition({}, BEAD, 1, nominal), {}, Hidden({"friction_drop": 0.05}))
    assert motion.starts[1] == pytest.approx(100.0, rel=1e-3)
    t = np.array([0.0, 0.2, 0.4])
    r = np.hypot(*motion.at(motion.starts[1] + t))
    assert r[0] - r == pytest.approx(0.5 * 0.05 * G * math.cos(math.radians(16)) * t**2, rel=2e-2)


@pytest.mark.parametrize(("law", "reynolds", "published"), [
    (schiller_naumann, 100, 1.09), (brown_lawler, 100, 1.09), (abraham, 10, 4.37), (white, 10, 4.24),
    (brown_lawler, 10_000, 0.41),
])  # fmt: skip
def test_drag_laws_lie_on_the_standard_curve(law, reynolds, published):
    assert law(reynolds) == pytest.approx(published, rel=0.06)


def test_the_gain_of_a_shift_within_its_prior_is_small_and_one_beyond_it_large():
    lab = pendulum.lab(np.random.default_rng(4))
    strength = Strength(lab)
    small, large = (strength.gain(Hidden({"roll": size})) for size in (0.0005, 0.05))
    # a roll is measured far better than it is known, so the gain is the prior's: (roll / sd)^2
    assert small == pytest.approx((0.0005 / math.radians(0.15)) ** 2, rel=0.05)
    assert large == pytest.approx((0.05 / math.radians(0.15)) ** 2, rel=0.05)


@pytest.mark.parametrize(("rig", "effect"), [
    ("drop", "plate_tilt"), ("pendulum", "pivot_viscous"), ("slide", "friction_drop"), ("roll", "surface_direction"),
    ("double", "bead_repulsion"),
])  # fmt: skip
def test_a_drawn_lab_can_be_read_and_states_nothing_of_what_it_hides(rig, effect, tmp_path):
    case = Case("single", rig, (effect,), (next(iter(ALL[effect].laws)),), "strong")
    truth = write(case, "c1", (5, 1), tmp_path)
    lab = read_tracked_lab(tmp_path / "labs" / "c1")
    assert not lab.overlooked
    assert 2 <= len(lab.conditions) <= 8
    assert all(3 <= len(condition.repetitions) <= 6 for condition in lab.conditions)
    stated = json.loads((tmp_path / "labs" / "c1" / "lab.json").read_text())
    assert not {"hidden", "gain", "law", "strength"} & set(stated)
    assert truth["gain"] is None or truth["gain"] > 16
    assert is_named(effect, truth, effect)


def test_the_plan_holds_every_effect_and_pair_and_a_quarter_of_nulls():
    cases = [case for case, _ in zip(plan(1), range(240), strict=False)]
    assert sum(case.kind == "null" for case in cases) == 60
    assert {name for case in cases for name in case.effects} == set(ALL)
    assert {case.effects for case in cases if case.kind == "pair"} == {(one, other) for one, other, _ in PAIRS}
    assert cases[3] == Case("null", cases[3].rig)


def test_two_equal_beads_share_the_speed_as_their_restitution_says_and_keep_their_momentum():
    condition = Condition(
        {}, BEAD, 1, {"length": 0.3, "angle": 0.5, "begin": 0.02, "duration": 1.5, "restitution": 0.8}
    )
    motion = double.move(condition, {}, Hidden())
    struck = motion.starts[2]
    before, after = (
        np.diff(motion.at(struck + np.array(t)), axis=1)[[0, 2], 0] / 1e-5 for t in ([-2e-5, -1e-5], [1e-5, 2e-5])
    )
    assert before[0] == pytest.approx(math.sqrt(2 * G * 0.3 * (1 - math.cos(0.5))), rel=1e-3)
    assert after == pytest.approx(before[0] * np.array([0.1, 0.9]), abs=2e-3)


def test_a_bead_rolls_at_five_sevenths_and_one_pushed_without_spin_keeps_five_sevenths_of_its_speed():
    nominal = {
        "slope": 0.1, "push": 0.0, "way": 1.0, "length": 0.5, "rolling": 0.01, "turned": 0.0, "begin": 0.0,
        "sliding": 0.3,
    }  # fmt: skip
    t = np.array([0.2, 0.4, 0.6])
    path = roll.move(Condition({}, BEAD, 1, nominal), {}, Hidden()).at(np.append(0.0, t))
    place = np.hypot(*(path[:, 1:] - path[:, :1]))
    pull = 5 / 7 * G * (math.sin(0.1) - 0.01 * math.cos(0.1))
    assert place == pytest.approx(0.5 * pull * t**2, rel=1e-4)
    level = Condition({}, BEAD, 1, nominal | {"slope": 0.0, "push": 0.7, "rolling": 0.0})
    x = roll.move(level, {}, Hidden({"slip": 1.0})).at(np.array([0.30, 0.31]))[0]
    assert np.diff(x)[0] / 0.01 == pytest.approx(5 / 7 * 0.7, rel=1e-4)


def test_a_surface_with_a_lay_brakes_otherwise_once_it_is_turned():
    rng = np.random.default_rng(2)
    lab = roll.lab(rng, turned=True)
    hidden = ALL["surface_direction"].laws["ratio"](rng, lab)(1.0)
    one, other = (c for c in lab.conditions[:2])
    assert one.stated["surface_turned"] != other.stated["surface_turned"]
    ends = [lab.move(c, {}, hidden).end for c in (one, other)]
    plain = [lab.move(c, {}, Hidden()).end for c in (one, other)]
    assert plain[0] == pytest.approx(plain[1])
    assert (ends[0] - plain[0]) * (ends[1] - plain[1]) < 0
