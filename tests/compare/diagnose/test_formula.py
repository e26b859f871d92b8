"""Diagnosis: formulas of what no effect explains; their shapes against closed forms, and when one is told as a law."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigtwin.compare.diagnose.models.pendulum import pushing
from rigtwin.compare.diagnose.selection.formula import Formula, _amiss, _extent, _worth_all
from rigtwin.compare.diagnose.selection.gap import Gap, _last_repetitions
from rigtwin.lab.errors import BadInput
from rigtwin.sim.effects import named
from rigtwin.sim.effects.nameless_shapes import Extent, shapes
from rigtwin.sim.effects.nameless_terms import beside, nameless
from rigtwin.sim.effects.validate import check
from rigtwin.sim.reduced import flight
from rigtwin.sim.reduced.swing import angle_at, half_swings

G = 9.81
EXTENT = Extent(time=2.0, clock=3.0, way=0.5)
SHAPES = {f"{rig} {one.effect.name}": one for rig in ("drop", "pendulum", "roll") for one in shapes(rig, EXTENT)}
GAP = Gap(5.0, 1.1, 1.0, 5.0, 1.2, 1.0, None, 8.0, 1.3, 1.0, "far")


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_held_at_a_place_of_its_grid_is_the_term_with_those_numbers(name):
    shape = SHAPES[name]
    number = len(shape.grid) // 2
    frozen, whole = shape.frozen(number), shape.effect
    hook = "force" if whole.force is not None else "drive"
    assert [p.name for p in whole.parameters] == [*shape.linear, *shape.shaping]
    motion = [np.array([0.1, 0.2, 0.3])] * (5 if hook == "force" else 3)
    sizes = [0.3, 0.2][: len(shape.linear)]
    given = getattr(frozen, hook)(*motion, *sizes)
    assert np.allclose(given, getattr(whole, hook)(*motion, *sizes, *shape.grid[number]))


def test_a_bead_that_falls_through_a_draught_gains_its_push_times_the_time_in_it():
    draught = SHAPES["drop form:band_sideways"].effect
    start = np.zeros((1, 1, 1))
    high, low, top, push = 0.5, 0.1, 0.3, 0.4
    values = {f"{draught.name}.{n}": np.array([v]) for n, v in (("c", push), ("low", low), ("high", top))}
    paths = flight.fly(
        start, start, start + high, start, start + 1, radius=np.full((1, 1), 3e-3), mass=np.full((1, 1), 1e-4),
        gravity=G, terms=(draught,), values=values,
    )  # fmt: skip
    through = math.sqrt(2 * (high - low) / G) - math.sqrt(2 * (high - top) / G)
    assert paths.land_vx[0, 0, 0] == pytest.approx(push * through, rel=0.01)


def fallen(place, low, top, *, finer=1, push=0.4, speed=0.0):
    """The sideways speed at landing behind a draught between two heights."""
    draught = SHAPES["drop form:band_sideways"].effect
    start = np.zeros((1, 1, 1))
    values = {f"{draught.name}.{n}": np.array([v]) for n, v in (("c", push), ("low", low), ("high", top))}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flight, "STEPS", finer * flight.STEPS)
        patch.setattr(flight, "MOST", finer * flight.MOST)
        paths = flight.fly(
            start, start + speed, start + place, start, start + 1, radius=np.full((1, 1), 3e-3),
            mass=np.full((1, 1), 1e-4), gravity=G, terms=(draught,), values=values,
        )  # fmt: skip
    return paths.land_vx[0, 0, 0]


@pytest.mark.parametrize(("place", "speed"), [(0.5, 0.0), (0.0, 2.5)])
def test_every_band_that_is_looked_at_pushes_as_fine_steps_say(place, speed):
    bands = SHAPES["drop form:band_sideways"].grid
    found = np.array([fallen(place, *band, speed=speed) for band in bands])
    true = np.array([fallen(place, *band, speed=speed, finer=6) for band in bands])
    assert np.abs(found / true - 1).max() < 0.01


@pytest.mark.parametrize("band", [(0.025, 0.05), (0.05, 0.09), (0.1, 0.14), (0.2, 0.21)])
def test_a_narrow_band_pushes_as_fine_steps_say(band):
    assert fallen(0.5, *band) == pytest.approx(fallen(0.5, *band, finer=6), rel=0.01)


def test_a_bob_that_is_pushed_by_the_clock_swings_as_scipy_says():
    push, period, length, release, angle = 0.05, 0.73, 0.4, 0.05, 0.3
    term = SHAPES["pendulum form:period"].effect
    values = {f"{term.name}.{n}": np.array([v]) for n, v in (("c", push), ("d", 0.0), ("period", period))}
    one = np.ones((1, 1))
    law, omega = pushing(length * one, np.ones(1), np.ones(1), G, values, (term,), release * one)
    swings = half_swings(angle * one, law, omega, 4 * one, dry=False, driven=True)
    time = np.linspace(0.0, 4.0, 50)
    found = angle_at(swings, time[None], np.zeros(50, dtype=int))[0][0]

    def motion(t, s):
        return [s[1], -G / length * math.sin(s[0]) + push / length * math.sin(2 * math.pi * (t + release) / period)]

    true = solve_ivp(motion, (0, 4), [angle, 0.0], t_eval=time, rtol=1e-9, atol=1e-11).y[0]
    assert np.abs(found - true).max() < 1e-5


@pytest.mark.parametrize(
    ("change", "holds"),
    [
        ({}, True),
        ({"held_out_after": 2.5}, False),  # closes 62 % of what it was not fitted to
        ({"held_out_before": 2000.0, "held_out_after": 250.0}, False),  # closes 88 %, and is off by 16 times the noise
        ({"held_out_before": 2000.0, "held_out_after": 5.0}, True),
        ({"condition_after": 12.0}, False),  # and this widens the gap of the condition held out
        ({"condition_before": None, "condition_after": None, "condition_noise_floor": None}, True),  # none held out
        ({"condition_before": 1.0, "condition_after": 1.01}, True),  # no gap in it that could be closed
        ({"condition_before": 1.0, "condition_after": 1.2}, False),
        ({"condition_after": 8.3}, False),  # it closes nothing of it there
        ({"condition_after": math.nan}, False),
        ({"held_out_after": math.nan}, False),
        ({"held_out_before": math.nan}, False),
        ({"held_out_before": None, "held_out_after": None, "held_out_noise_floor": None}, False),  # none to judge by
        ({"held_out_before": 0.9, "held_out_after": 9.0}, False),  # no gap there, and it opens one
        ({"held_out_before": 0.9, "held_out_after": 0.9}, False),
        ({"held_out_before": 1.03, "held_out_after": 1.0, "held_out_gain": 90.0}, True),  # small, and there
        ({"held_out_before": 1.03, "held_out_after": 1.0, "held_out_gain": 9.0}, False),
        ({"held_out_before": 1.03, "held_out_after": 1.0, "held_out_gain": -90.0}, False),
        ({"held_out_before": 1.03, "held_out_after": 1.0, "held_out_gain": math.nan}, False),
        ({"held_out_before": 1.03, "held_out_after": 1.2, "held_out_gain": 90.0}, False),  # widens the gap of its rows
    ],
)
def test_only_a_formula_that_closes_the_gap_where_it_was_not_fitted_is_told(change, holds):
    sizes = Gap(**{**GAP.to_json(), **change})
    assert Formula(None, sizes).holds is holds


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"held_out_after": 2.5}, "none closes the gap on repetitions"),
        ({"held_out_before": None, "held_out_after": None, "held_out_noise_floor": None}, "no condition has two"),
        ({"held_out_before": 1.0, "held_out_after": 1.0}, "no gap in such"),
        ({"held_out_before": 1.0, "held_out_after": 1.2, "held_out_gain": 90.0}, "widening the gap on repetitions"),
        ({"condition_after": 12.0}, "without widening it in far"),
        ({"condition_after": 7.9}, "closes any of it in far"),
    ],
)
def test_a_formula_says_why_it_is_no_law(change, why):
    assert why in Formula(None, Gap(**{**GAP.to_json(), **change})).flaw


@pytest.mark.parametrize("speed", [0.0, math.nan])
def test_where_nothing_moves_there_is_no_shape_to_look_for(speed):
    bench = SimpleNamespace(spans=[slice(0, 9)], time=np.arange(9.0), rows=np.zeros((9, 2)))
    assert _extent(bench, SimpleNamespace(speed=np.full((9, 2), speed))) is None


@pytest.mark.parametrize(
    ("name", "numbers", "good"),
    [
        ("drop form:band", {"c": (1.0, 0.1), "low": (0.1, 0.01), "high": (0.2, 0.01)}, True),
        ("drop form:band", {"c": (1.0, 0.1), "low": (0.2, 0.01), "high": (0.1, 0.01)}, False),
        ("drop form:band", {"c": (1.0, math.nan), "low": (0.1, 0.01), "high": (0.2, 0.01)}, False),
        ("drop form:decay", {"c": (1.0, 0.1), "reach": (0.04, 0.01)}, True),
        ("drop form:decay", {"c": (0.2, 0.1), "reach": (0.04, 0.01)}, False),
        ("drop form:decay", {"c": (1.0, 0.1), "reach": (-0.04, 0.01)}, False),
        ("roll form:period", {"c": (0.25, 0.1), "d": (0.25, 0.1), "period": (0.7, 0.1)}, True),
        ("roll form:period", {"c": (0.1, 0.1), "d": (0.25, 0.1), "period": (0.7, 0.1)}, False),
    ],
)
def test_a_term_that_may_be_zero_or_has_no_shape_is_refused(name, numbers, good):
    term = SHAPES[name].effect
    given = {f"{term.name}.{one}": pair for one, pair in numbers.items()}
    fitted = SimpleNamespace(value=lambda one: given[one][0], std=lambda one: given[one][1])
    assert (_amiss(fitted, term) == "") is good


@pytest.mark.parametrize(
    ("deviances", "per_row", "kept"),
    [
        ((500.0, 510.0), 1.0, [0, 1]),  # a near tie goes on to all data
        ((500.0, 540.0), 1.0, [0]),  # odds of e^20 to one
        ((500.0, 540.0), 5.0, [0, 1]),  # ... which they are not where the best leaves five times the noise
        ((980.0, 999.0), 1.0, [0]),  # 4 of all data for the 11 that the search on the grid costs
        ((990.0, 997.0), 1.0, [0, 1]),  # 12 of all data
        ((1001.0, 1002.0), 1.0, []),
    ],
)
def test_shapes_go_on_to_all_data_unless_a_part_of_them_tells_them_apart(deviances, per_row, kept):
    shape = SHAPES["drop form:band"]
    rough = [(shape, SimpleNamespace(deviance=one, per_row=per_row)) for one in deviances]
    left = _worth_all(rough, SimpleNamespace(deviance=1000.0), 4.0, 1.0)
    assert left == [rough[number] for number in kept]


def test_the_last_repetition_is_held_out_of_each_condition_that_has_two():
    lab = SimpleNamespace(conditions=[SimpleNamespace(repetitions=[0] * count) for count in (3, 1, 2)])
    assert _last_repetitions(lab) == [2, 5]


def test_terms_that_only_a_formula_asks_for_are_none_that_a_verdict_is_held_to():
    more = {term.name for term in beside("drop")}
    assert more == {"form:v_x", "form:height_sideways"}
    assert not more & {term.name for term in nameless("drop")}
    assert all(named(name).force is not None for name in more)
    with pytest.raises(BadInput, match=r"known are .*form:band, .*form:v_x"):
        named("form:no such")


def test_an_own_effect_that_pushes_by_the_clock_is_refused(tmp_path):
    with pytest.raises(BadInput, match="has a drive"):
        check(SHAPES["roll form:period"].effect, tmp_path / "own.py")


def test_a_band_of_heights_is_read_from_a_model_file_and_a_push_by_the_clock_is_refused():
    assert named("form:band_sideways").force is not None
    with pytest.raises(BadInput, match="no simulation implements"):
        named("form:period")
