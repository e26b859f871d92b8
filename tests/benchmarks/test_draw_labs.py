"""The drawn labs move as physics says: closed forms, apart from both the generator's and the simulator's code."""

import json
import math

import numpy as np
import pytest

from rigtwin.benchmarks.diagnose.draw_labs import Case, chosen, plan, write
from rigtwin.benchmarks.diagnose.effect_names import means
from rigtwin.benchmarks.diagnose.lab_effects import ALL, PAIRS, UNLISTED
from rigtwin.benchmarks.diagnose.lab_motion import Bead, World, double, drop, pendulum, roll, slide
from rigtwin.benchmarks.diagnose.verdicts import Answer, Result, formula_terms
from rigtwin.sim.effects.nameless_shapes import Extent, shapes
from rigtwin.sim.effects.nameless_terms import beside, nameless

BEAD = Bead("D6", 0.006, 570, "wood", 11e9, 0.44)
LIGHT = Bead("EPS12", 0.012, 28, "expanded polystyrene", 5e6, 0.1)
G = 9.81


def quiet(**more: object) -> World:
    """A world without scatter."""
    world = World(
        {"D6/glass": 0.6, "EPS12/glass": 0.6, "D6/D6": 0.8}, {"glass": 0.4}, {"D6/glass": 0.02}, 0.0, 0.0, 0.0
    )
    world.hidden = dict(more)  # type: ignore[arg-type]
    return world


def speeds(path):
    times = np.arange(0, path.end, 1e-4)
    return times, path.at(times), np.gradient(path.at(times), times, axis=2)


def test_a_falling_bead_with_quadratic_drag_hits_at_the_speed_of_the_closed_form():
    path = drop(LIGHT, "glass", 0.01, 1.0, quiet(kd=0.53), np.random.default_rng(1))
    _, place, speed = speeds(path)
    bottom = place[0, 1] - LIGHT.radius
    impact = int(np.flatnonzero(bottom < 2e-3)[0]) - 5
    k = 0.5 * 0.53 * LIGHT.section / LIGHT.mass
    fallen = 1.0 - bottom[impact]
    expected = math.sqrt(G / k * (1 - math.exp(-2 * k * fallen)))
    assert -speed[0, 1, impact] == pytest.approx(expected, rel=1e-4)


def test_rebound_heights_return_the_restitution_squared():
    path = drop(BEAD, "glass", 0.01, 0.5, quiet(), np.random.default_rng(1))
    _, place, _ = speeds(path)
    rise = place[0, 1] - BEAD.radius
    after = np.flatnonzero(rise < 1e-3)[0] + 50
    second = after + np.flatnonzero(rise[after:] < 1e-3)[0]
    assert rise[after:second].max() == pytest.approx(0.5 * 0.36, rel=1e-4)


def test_a_viscous_pivot_damps_a_small_swing_exponentially():
    c = 4e-8
    path = pendulum(BEAD, 0.25, math.radians(3), 6.0, quiet(c_pivot=c), np.random.default_rng(1))
    times, place, _ = speeds(path)
    swing = np.abs(place[0, 0])
    peaks = [k for k in range(1, len(swing) - 1) if swing[k] >= swing[k - 1] and swing[k] > swing[k + 1]]
    rate = -np.polyfit(times[peaks[1:]], np.log(swing[peaks[1:]]), 1)[0]
    assert rate == pytest.approx(c / (2 * BEAD.mass * 0.25**2), rel=1e-2)


def test_dry_pivot_friction_takes_the_same_angle_from_every_swing():
    tau = 5e-7
    path = pendulum(BEAD, 0.25, math.radians(8), 6.0, quiet(tau_c=tau), np.random.default_rng(1))
    _, place, _ = speeds(path)
    angle = np.abs(np.arctan2(place[0, 0], -place[0, 1]))
    peaks = [angle[k] for k in range(1, len(angle) - 1) if angle[k] >= angle[k - 1] and angle[k] > angle[k + 1]]
    step = 2 * tau / (BEAD.mass * G * 0.25)
    assert np.diff(peaks[:6]) == pytest.approx(-step, rel=0.02)


def test_one_of_two_equal_hanging_beads_hands_on_its_speed():
    path = double(BEAD, (0.25, 0.25), math.radians(30), 1.0, quiet(), np.random.default_rng(3))
    _, _, speed = speeds(path)
    struck = int(np.flatnonzero(np.abs(np.diff(speed[1, 0])) > 0.1)[0])
    before, a, b = speed[0, 0, struck - 10], speed[0, 0, struck + 10], speed[1, 0, struck + 10]
    assert a + b == pytest.approx(before, rel=1e-3)
    assert (b - a) / before == pytest.approx(0.8, abs=2e-3)


def test_a_rolling_bead_accelerates_at_five_sevenths():
    path = roll(
        BEAD, "glass", slope=math.radians(10), push=0.0, distance=0.4, world=quiet(), rng=np.random.default_rng(1)
    )
    times, place, _ = speeds(path)
    moving = times > 0.1
    curve = np.polyfit(times[moving], np.hypot(*(place[0, :, moving].T - place[0, :, :1])), 2)
    expected = 5 / 7 * G * (math.sin(math.radians(10)) - 0.02 * math.cos(math.radians(10)))
    assert 2 * curve[0] == pytest.approx(expected, rel=1e-6)


def test_a_clump_slides_when_the_arm_passes_the_angle_of_friction():
    rate = math.radians(2)
    path = slide(
        1e-3, "glass", start_angle=math.radians(18), tilt_rate=rate, place=0.25, height=0.003, stop=0.05, dwell=5.0,
        duration=20, world=quiet(), rng=np.random.default_rng(1),
    )  # fmt: skip
    onset = path.starts[1] * rate + math.radians(18)
    assert math.tan(onset) == pytest.approx(0.4, rel=2e-4)


def test_a_drawn_lab_states_what_the_experimenter_knows_and_no_more(tmp_path):
    truth = write(Case("single", "roll", ("rolling_growth",), "strong"), "c1", (5, 1), tmp_path)
    text = (tmp_path / "labs" / "c1" / "lab.json").read_text()
    assert truth["parameters"]["rolling_growth"] > 0
    assert "growth" not in text
    assert "hidden" not in text
    lab = json.loads(text)
    for condition in lab["conditions"]:
        for k in range(condition["repetitions"]):
            assert (tmp_path / "labs" / "c1" / (condition["files"] % (k + 1))).is_file()


def test_a_case_is_drawn_alike_whatever_the_filters(tmp_path):
    by_number = dict(chosen(3, 40))
    for number, case in chosen(3, 5, kind="null"):
        if number in by_number:
            assert by_number[number] == case
    first = write(Case("null", "roll"), "a", (3, 9), tmp_path)
    second = write(Case("null", "roll"), "b", (3, 9), tmp_path)
    assert first["world"] == second["world"]


def test_a_third_of_the_plan_hides_nothing_and_a_round_holds_every_effect_and_pair():
    cases = [case for case, _ in zip(plan(1), range(240), strict=False)]
    assert sum(case.kind == "null" for case in cases) == 80
    assert {name for case in cases for name in case.effects} >= set(ALL)
    assert {case.effects for case in cases if case.kind == "pair"} == {(one, other) for one, other, _ in PAIRS}


def test_a_name_is_matched_by_its_words_alone():
    assert means("Air-Drag", "air drag")
    assert not means("linear drag", "drag")
    assert means("frame_rate_error", "frame&rate&!shutter")


@pytest.mark.parametrize("effect", UNLISTED, ids=lambda effect: effect.name)
def test_the_right_terms_of_an_unlisted_effect_are_among_those_that_are_tried(effect):
    for rig in effect.sizes:
        tried = [*nameless(rig), *beside(rig), *(one.effect for one in shapes(rig, Extent(1.0, 1.0, 1.0)))]
        known = {term for one in tried for term in formula_terms(f"{one.title} with c = 1")}
        assert effect.terms
        assert all(term in known for terms in (*effect.terms, *effect.weak_terms) for term in terms)
    assert set(effect.more.values()) <= set(effect.shape.values())


PULL = "force per mass c exp(-z / {}) with c = -0.3 ± 0.01 m/s^2"
BAND = "force per mass c e_x where low < z < high with c = 0.1 ± 0.01 m/s^2, low = {} ± {} m, high = {} ± 0.01 m"
GAP = {"held_out_before": 5.0, "held_out_after": 1.1, "held_out_noise_floor": 1.0}


@pytest.mark.parametrize(
    ("effect", "strength", "form", "right"),
    [
        ("magnetic_pull", "strong", PULL.format("reach") + ", reach = 0.044 ± 0.001 m", True),
        ("magnetic_pull", "strong", PULL.format("reach") + ", reach = 0.06 ± 0.001 m", False),
        ("magnetic_pull", "strong", PULL.format("reach") + ", reach = 0.06 ± 0.01 m", True),  # within its uncertainty
        ("magnetic_pull", "strong", PULL.format("reach") + ", reach = 0.06 ± nan m", False),
        ("magnetic_pull", "strong", PULL.format("20 mm"), False),
        ("magnetic_pull", "weak", PULL.format("20 mm"), True),
        ("draught", "strong", BAND.format("0.08", "0.005", "0.39"), True),
        ("draught", "strong", BAND.format("0.2", "0.005", "0.39"), False),
        ("draught", "strong", "", False),
    ],
)
def test_a_formula_is_right_by_its_terms_and_by_the_numbers_of_its_shape(effect, strength, form, right):
    truth = {"effects": [effect], "strength": strength}
    result = Result(truth, Answer("unlisted", form=form, gap=GAP))
    assert result.right_terms is right
    assert result.right_law is right
    assert not Result(truth, Answer("unlisted", form=form, gap=GAP | {"held_out_after": 3.0})).right_law
    assert not Result(truth, Answer("named", names=("air_drag",), gap=GAP)).right_law
