"""Deviations: `measured`, `percent_deviation` and `z` agree with simulated random samples."""

import csv
import io
import math
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student_t

from rigtwin.compare.deviation import (
    combine,
    deviations,
    headlines,
    is_result,
    over_views,
    percent_deviation,
    percent_interval,
    primary_first,
    summarized,
)
from rigtwin.compare.result_files import deviations_csv, document
from rigtwin.compare.twins.registry import ENTRIES
from rigtwin.lab.quantity import CheckLine, Quantity
from rigtwin.lab.reference.repetition_scatter import Scatter, published_scatter

sizes = st.floats(1e-3, 1e3)
shares = st.floats(1e-3, 0.2)


def quantity(value, std=0.01, name="restitution_wall", unit="1", method="height", **more):
    return Quantity(name, value, std, unit, method, **more)


def compared(measured, simulated, rig="drop", **more):
    return deviations("it", rig, measured, simulated, run_name=ENTRIES[rig].run_name, **more)


def test_the_uncertainty_of_the_percentage_is_the_scatter_of_repeated_experiments():
    rng = np.random.default_rng(1)
    measured, measured_u, simulated, simulated_u = 0.42, 0.012, 0.46, 0.009
    trials = rng.normal(simulated, simulated_u, 200_000) / rng.normal(measured, measured_u, 200_000)
    percent, std = percent_deviation(measured, measured_u, simulated, simulated_u)
    assert percent == pytest.approx(9.5238, abs=1e-3)
    # first order: the neglected terms are of the order (0.012 / 0.42)^2
    assert std == pytest.approx(100 * trials.std(), rel=0.01)


def test_the_stated_uncertainty_of_a_mean_is_its_scatter_about_the_truth():
    rng = np.random.default_rng(2)
    truth, noise, scale, n, labs = 0.5, 0.010, 0.006, 6, 3000
    misses, stated = [], []
    for _ in range(labs):
        shared = rng.normal(0, scale)
        values = truth + shared + rng.normal(0, noise, n)
        budget = {"tracking": noise, "scale": scale}
        total = math.hypot(noise, scale)
        mean = combine([quantity(value, total, budget=budget) for value in values])
        misses.append(mean.value - truth)
        stated.append(mean.std_uncertainty)
    # taking the larger of scatter and stated noise errs on the safe side, by at most a fifth
    assert 0.97 < np.sqrt(np.mean(np.square(stated))) / np.std(misses) < 1.2


@given(n=st.integers(1, 40), scale=st.floats(1e-4, 1.0))
def test_repeating_does_not_make_a_shared_scale_error_smaller(n, scale):
    budget = {"tracking": 0.5, "scale": scale}
    repetition = quantity(10.0, math.hypot(0.5, scale), budget=budget)
    assert combine([repetition] * n).std_uncertainty >= scale


def test_repetitions_that_agree_by_chance_keep_an_uncertainty():
    repetition = quantity(0.5, 0.01, budget={"tracking": 0.01})
    assert combine([repetition] * 4).std_uncertainty == pytest.approx(0.005)


@pytest.mark.parametrize(
    "part",
    [
        "tracking", "repetition", "grain roughness", "grain at apex and foot", "scatter of views and sides",
        "flow over time", "scatter of avalanches", "scatter of the flow",
    ],
)  # fmt: skip
def test_what_differs_from_repetition_to_repetition_averages_out(part):
    one = quantity(31.0, 0.5, "angle_of_repose_graphical", "deg", budget={part: 0.5})
    assert combine([one] * 4).std_uncertainty == pytest.approx(0.25)


def test_one_repetition_keeps_its_own_uncertainty():
    mean = combine([quantity(0.5, 0.05, budget={"tracking": 0.03, "scale": 0.04})])
    assert (mean.n, mean.std) == (1, 0.05)
    assert mean.std_uncertainty == pytest.approx(0.05)


def test_an_uncertainty_wider_than_its_budget_is_kept():
    wide = quantity(0.5, 0.2, budget={"tracking": 0.01}, doubtful="blurred")
    assert combine([wide, wide]).std_uncertainty >= 0.199


@given(measured=sizes, ratio=st.floats(0.2, 5), u_measured=shares, u_simulated=shares, factor=st.floats(1e-3, 1e3))
def test_neither_percent_nor_z_depends_on_the_unit(measured, ratio, u_measured, u_simulated, factor):
    def row(unit_factor):
        m, s = measured * unit_factor, measured * ratio * unit_factor
        return compared([quantity(m, u_measured * m)], [quantity(s, u_simulated * s)])[0]

    plain, scaled = row(1.0), row(factor)
    assert scaled.percent_deviation == pytest.approx(plain.percent_deviation, rel=1e-9, abs=1e-9)
    assert scaled.percent_deviation_std == pytest.approx(plain.percent_deviation_std, rel=1e-9)
    assert scaled.z == pytest.approx(plain.z, rel=1e-9, abs=1e-9)


@given(a=sizes, b=sizes, u_a=shares, u_b=shares)
def test_z_changes_sign_when_measured_and_simulated_change_places(a, b, u_a, u_b):
    first = [quantity(a, u_a * a)]
    second = [quantity(b, u_b * b)]
    assert compared(first, second)[0].z == pytest.approx(-compared(second, first)[0].z)


@pytest.mark.parametrize("value", [0.0, 1e-300, -0.02])
def test_a_measured_value_compatible_with_zero_gives_no_percentage_but_a_z(value):
    row = compared([quantity(value, 0.03)], [quantity(0.09, 0.04)])[0]
    assert (row.percent_deviation, row.percent_deviation_std) == (None, None)
    assert row.z == pytest.approx((0.09 - value) / 0.05)


def test_with_an_unknown_uncertainty_there_is_a_percentage_but_no_z():
    row = compared([quantity(0.5, math.inf)], [quantity(0.6, 0.01)])[0]
    assert row.z is None
    assert row.verdict == "uncertainty unknown"
    assert "Infinity" not in document([row.row()])


def test_a_doubtful_repetition_is_left_out_and_named_where_sound_ones_remain():
    row = compared([quantity(0.5), quantity(0.52), quantity(0.9, doubtful="blurred")], [quantity(0.51)])[0]
    assert (row.measured, row.measured_n, row.doubtful) == (pytest.approx(0.51), 2, "")
    assert "1 doubtful repetition left out" in row.note


def test_a_doubtful_run_of_the_twin_is_left_out_and_named_with_its_reason():
    runs = [quantity(0.51), quantity(0.9, doubtful="its heap leans on the wall")]
    row = compared([quantity(0.5)], runs, rig="pile")[0]
    assert (row.simulated, row.simulated_n) == (0.51, 1)
    assert "1 doubtful heap of the twin left out (its heap leans on the wall), 1 counted" in row.note


def test_the_row_is_doubtful_when_every_repetition_is_doubtful():
    row = compared([quantity(0.5, doubtful="blurred"), quantity(0.6, doubtful="rolled")], [quantity(0.51)])[0]
    assert (row.measured_n, row.doubtful, row.verdict) == (2, "blurred; rolled", "doubtful")


def test_a_quantity_that_the_twin_does_not_give_keeps_its_row():
    row = compared([quantity(0.5)], [])[0]
    assert (row.simulated, row.percent_deviation, row.z, row.simulated_n) == (None, None, None, 0)
    assert row.verdict == "no twin value"


def test_bounces_are_compared_with_the_same_bounce():
    measured = [quantity(0.5, detail={"bounce": 1}), quantity(0.4, detail={"bounce": 2})]
    simulated = [quantity(0.4, detail={"bounce": 2}), quantity(0.5, detail={"bounce": 1})]
    assert [(row.bounce, row.percent_deviation) for row in compared(measured, simulated)] == [(1, 0.0), (2, 0.0)]


def test_a_pendulum_filmed_from_behind_is_compared_with_the_same_bead():
    def angle(value, body, side):
        return quantity(value, 0.1, "rebound_angle", "deg", "swing", detail={"body": body, "side": side})

    measured = [angle(8.0, "A", "left"), angle(40.0, "B", "left")]
    simulated = [angle(8.0, "A", "right"), angle(40.0, "B", "right")]
    assert [row.percent_deviation for row in compared(measured, simulated)] == [0.0, 0.0]


def test_the_two_slopes_of_a_pile_stay_apart():
    def slope(value, side):
        return quantity(value, 0.5, "angle_of_repose_graphical", "deg", "line", detail={"side": side})

    rows = compared([slope(24.0, "left"), slope(30.0, "right")], [slope(30.0, "right"), slope(24.0, "left")])
    assert [(row.side, row.percent_deviation) for row in rows] == [("left", 0.0), ("right", 0.0)]


def test_a_heap_seen_from_four_sides_is_one_repetition_where_its_views_were_combined():
    def slope(value, side, view=None):
        detail = {"side": side} | ({} if view is None else {"view": view})
        return quantity(value, 0.5, "angle_of_repose_graphical", "deg", "line", detail=detail)

    four = [slope(v, side, f"view{k}") for k, v in enumerate((24.0, 26.0, 28.0, 30.0)) for side in ("left", "mean")]
    rows = compared(
        over_views([*four, slope(27.4, "mean", "all")]), over_views([slope(27.0, "left"), slope(27.4, "mean")])
    )
    found = {row.side: (row.measured, row.measured_n) for row in rows}
    assert found == {"left": (27.0, 1), "mean": (27.4, 1)}
    assert [row.percent_deviation for row in rows] == [0.0, 0.0]


def test_the_mean_over_views_leaves_doubtful_views_out_and_keeps_what_they_share():
    def slope(value, view, doubtful=""):
        budget = {"grain roughness": 0.3, "camera distance": 0.4}
        detail = {"side": "left", "view": view}
        return quantity(value, 0.5, "slope", "deg", "line", detail=detail, budget=budget, doubtful=doubtful)

    (one,) = over_views([slope(24.0, "front"), slope(26.0, "back"), slope(60.0, "top", "cut off")])
    assert (one.value, one.doubtful, one.detail) == (25.0, "", {"side": "left", "view": "all"})
    assert one.budget == {"scatter of views and sides": pytest.approx(1.0), "camera distance": pytest.approx(0.4)}
    # the standard error of 24 and 26 is 1; the camera is the same
    assert one.std_uncertainty == pytest.approx(math.hypot(1.0, 0.4))


def test_an_input_of_the_twin_does_not_count_as_agreement():
    height = quantity(0.3, 0.001, "drop_height", "m", "fit")
    row = compared([height], [height], set_from={"drop_height": "measured"})[0]
    assert (row.verdict, row.note) == ("set equal", "the twin starts from the measured value")


def test_the_verdict_says_which_side_is_high_only_when_the_difference_is_significant():
    def verdict(simulated):
        return compared([quantity(0.5, 0.006)] * 2, [quantity(simulated, 0.008)])[0].verdict

    assert verdict(0.515) == "agrees"
    assert verdict(0.521) == "twin probably too high"
    assert verdict(0.45) == "twin too low"


def scattered(rng, truth, noise, n):
    return [quantity(value, noise / 100, budget={"tracking": noise / 100}) for value in rng.normal(truth, noise, n)]


@pytest.mark.parametrize("n", [2, 3, 5])
def test_a_right_twin_is_called_wrong_in_one_of_twenty_labs_however_few_their_repetitions(n):
    rng = np.random.default_rng(n)
    rows = [compared(scattered(rng, 0.5, 0.01, n), [quantity(0.5, 1e-9)])[0] for _ in range(1500)]
    wrong = sum(row.verdict.startswith("twin") for row in rows) / len(rows)
    # three standard errors of a share of 5 % among 1500
    assert wrong == pytest.approx(0.05, abs=0.017)
    assert np.mean([abs(row.z) > row.coverage_factor for row in rows]) == pytest.approx(0.05, abs=0.017)


def test_two_scattered_repetitions_reject_no_twin_but_two_with_a_known_uncertainty_do():
    loose = [quantity(0.48, 1e-4, budget={"tracking": 1e-4}), quantity(0.53, 1e-4, budget={"tracking": 1e-4})]
    sure = [quantity(0.505, 0.025, budget={"scale": 0.025})] * 2
    twin = [quantity(0.62, 1e-6)]
    few, both = compared(loose, twin)[0], compared(sure, twin)[0]
    assert few.z == pytest.approx(both.z, rel=1e-3)
    assert (few.verdict, both.verdict) == ("too few repetitions to tell", "twin too high")


def test_one_repetition_rejects_no_twin_however_precise_it_is():
    (row,) = compared([quantity(0.40, 1e-4)], [quantity(0.50, 1e-4)])
    assert row.z > 50
    assert row.verdict == "too few repetitions to tell"
    assert row.coverage_factor == math.inf
    assert "the scatter of repetitions is not in the uncertainty" in row.note
    (left,) = compared([quantity(0.40, 1e-4), quantity(0.41, 1e-4, doubtful="blurred")], [quantity(0.50, 1e-4)])
    assert left.verdict == "too few repetitions to tell"


def test_a_deviation_whose_interval_excludes_zero_does_not_agree():
    known = Scatter(0.0435, 1.7, "published")
    row = compared([quantity(0.5675, 0.001)], [quantity(0.45, 0.001)], scatter=lambda _name: known)[0]
    assert abs(row.z) < row.coverage_factor
    assert abs(row.percent_deviation) > row.coverage_factor * row.percent_deviation_std
    assert row.verdict == "too few repetitions to tell"


def test_a_large_z_that_only_few_degrees_of_freedom_keep_from_being_significant_does_not_agree():
    def row(simulated):  # the pair of a double pendulum of which two films show little scatter
        known = Scatter(0.025, 1.3, "published")
        return compared([quantity(0.613, 0.002)], [quantity(simulated, 1e-4)], scatter=lambda _name: known)[0]

    far, near = row(0.720), row(0.630)
    assert 3 < far.z < far.coverage_factor
    assert abs(far.percent_deviation) < far.coverage_factor * far.percent_deviation_std < 25
    assert (far.verdict, near.verdict) == ("too few repetitions to tell", "agrees")


def test_one_repetition_shows_that_a_rig_is_not_set_as_stated():
    height = [quantity(value, 0.001, "drop_height", "m", "fit") for value in (0.30, 0.32)]
    row = compared(height[:1], height[1:], set_from={"drop_height": "stated"})[0]
    assert row.verdict == "differs from the setting"


def test_the_first_bounce_and_both_sides_come_before_later_bounces_single_sides_and_other_methods():
    measured = [
        quantity(0.4, detail={"bounce": 2}),
        quantity(0.4, detail={"bounce": 1}),
        quantity(0.4, method="velocity", detail={"bounce": 1}),
        quantity(0.4, method="time", detail={"bounce": 1}),
        quantity(0.3, name="drop_height", unit="m"),
        *[quantity(30.0, name="angle_of_repose_graphical", detail={"side": side}) for side in ("left", "mean")],
        quantity(0.03, name="pile_height", unit="m"),
    ]
    rows = compared(measured, measured)
    primary, rest = primary_first(rows)
    assert [(row.quantity, row.method, row.side) for row in primary] == [
        ("restitution_wall", "height", None),
        ("restitution_wall", "velocity", None),
        ("drop_height", "height", None),
        ("angle_of_repose_graphical", "height", "mean"),
    ]
    assert len(primary) + len(rest) == len(rows)
    later = [row for row in rest if row.bounce == 2]
    assert primary_first(later) == (later, []), "an experiment with nothing else shows what it has"


def test_a_note_says_that_a_single_pile_does_not_show_the_scatter():
    slope = quantity(30.0, 0.5, "angle_of_repose_graphical", "deg", "line")
    (row,) = compared([slope, slope], [slope], "pile")
    assert row.note.startswith("one heap simulated:")
    (row,) = compared([slope], [slope], "pile")
    assert row.note.startswith("one heap measured and one simulated:")
    (row,) = compared([slope, slope], [slope, slope], "pile")
    assert row.note == ""


@pytest.mark.parametrize("simulated", [33.0, 80.0])
def test_one_pile_rejects_no_twin_but_several_that_agree_do(simulated):
    def verdict(measured, runs):
        slope = [quantity(value, 0.5, "angle_of_repose_graphical", "deg", "line") for value in (30.0, simulated)]
        (row,) = compared([slope[0]] * measured, [slope[1]] * runs, "pile")
        return row.verdict

    assert verdict(1, 1) == verdict(6, 1) == verdict(1, 6) == "too few repetitions to tell"
    assert verdict(6, 6) == "twin too high"


@pytest.mark.parametrize(
    ("rig", "verdict"),
    # beds and discharges differ between seeds; the uncertainty of a drum includes its scatter over time
    [("packing", "too few repetitions to tell"), ("hopper", "too few repetitions to tell"), ("drum", "twin too high")],
)
def test_one_run_is_not_rejected_where_runs_differ_by_their_seed(rig, verdict):
    measured, simulated = [quantity(1.0, 0.001)] * 6, [quantity(1.5, 0.001)]
    (row,) = compared(measured, simulated, rig)
    assert row.verdict == verdict
    (row,) = compared(measured, simulated * 3, rig)
    assert row.verdict == "twin too high"


def test_the_csv_has_the_agreed_columns_and_empty_cells_for_unknown_values():
    text = deviations_csv(compared([quantity(0.0, 0.1)], [quantity(0.5, math.nan)]))
    row = next(csv.DictReader(io.StringIO(text)))
    agreed = (
        "experiment quantity unit measured measured_std measured_n simulated simulated_std simulated_n "
        "percent_deviation z coverage_factor method side bounce body percent_deviation_std"
    )
    assert set(agreed.split()) <= set(row)
    assert (row["percent_deviation"], row["z"], row["simulated_std"], row["bounce"]) == ("", "", "", "")
    assert (row["measured"], row["simulated"], row["measured_n"]) == ("0", "0.5", "1")


def test_different_methods_are_compared_if_each_side_has_only_one():
    film = Quantity("discharge_time", 0.80, 0.01, "s", "edge of the slide to the last bead")
    twin = Quantity("discharge_time", 0.76, 0.001, "s", "given to last passage")
    (row,) = deviations("it", "hopper", [film, film], [twin, twin])
    assert row.percent_deviation == pytest.approx(-5.0)
    assert row.note == "the twin's value is by another method: given to last passage"
    other = Quantity("discharge_time", 0.70, 0.01, "s", "5 to 95 %")
    rows = deviations("it", "hopper", [film, other], [twin])
    assert [one.simulated for one in rows] == [None, None]


def test_times_on_the_camera_clock_give_no_deviation():
    onset = Quantity("onset_time", 0.9, 0.01, "s", "onset")
    assert deviations("it", "tilt", [onset], [Quantity("onset_time", 9.9, 0.01, "s", "onset")]) == ()


@pytest.mark.parametrize("span", [2.0, 3.5])
def test_the_interval_of_a_deviation_excludes_zero_where_z_exceeds_its_span_and_only_there(span):
    random = np.random.default_rng(5)
    for measured, simulated in random.normal(0, 5, (300, 2)):
        u = random.exponential(1.0, 2)
        low, high = percent_interval(measured, u[0], simulated, u[1], span)
        if abs(measured) <= span * u[0]:
            assert (low, high) == (-np.inf, np.inf)
        else:
            assert (not low < 0 < high) == (abs(simulated - measured) > span * np.hypot(*u))


def test_a_twin_that_may_be_wrong_by_a_quarter_does_not_agree():
    def verdict(std_uncertainty):
        (row,) = deviations("drop-1", "drop", [quantity(0.5, std_uncertainty)], [quantity(0.5, 1e-9)])
        return row.verdict

    assert (verdict(0.06), verdict(0.07)) == ("agrees", "too uncertain to tell")


def with_prior(measured, simulated, rig="pile", name="angle_of_repose_graphical"):
    def slopes(values):
        return [quantity(value, 0.3, name, "deg", "line", budget={"line fit": 0.3}) for value in values]

    (row,) = compared(slopes(measured), slopes(simulated), rig, scatter=partial(published_scatter, rig))
    return row


def test_one_heap_against_one_tells_a_flat_one_from_a_slope_and_cannot_tell_one_percent():
    flat, near = with_prior([22.6], [0.25]), with_prior([22.6], [22.8])
    assert (flat.verdict, near.verdict) == ("twin too low", "too few repetitions to tell")
    assert flat.percent_deviation == pytest.approx(-98.9, abs=0.1)
    assert "1 measured repetition and 1 simulated heap: a scatter of 8.5 % is in the uncertainty" in flat.note
    assert flat.scatter_from == "Hlosta et al. 2020, table 14"
    assert summarized([flat, near]) == (
        "2 quantities measured and simulated: 1 differs, 1 has too few repetitions to tell"
    )


def test_own_repetitions_take_over_from_the_published_scatter():
    rng = np.random.default_rng(3)
    few, many = (with_prior(rng.normal(30, 0.3, n), rng.normal(30, 0.3, n)) for n in (2, 60))
    published = published_scatter("pile", "angle_of_repose_graphical").relative
    assert few.scatter > 0.7 * published
    assert many.scatter == pytest.approx(0.01 * math.sqrt(1 + 3 * (published / 0.01) ** 2 / 60), rel=0.2)
    assert (few.scatter_from != "", many.scatter_from) == (True, "")
    assert (few.verdict, many.verdict) == ("agrees", "agrees")


@pytest.mark.parametrize(
    ("std", "freedom", "contradicted"),
    [
        (0.12, math.inf, True),
        (0.02, math.inf, False),
        (0.001, math.inf, False),
        (0.12, 20.0, True),
        (0.025, 20.0, False),
    ],
)
def test_a_stated_scatter_that_the_own_repetitions_contradict_is_noted(std, freedom, contradicted):
    values = 1 + std * np.random.default_rng(4).standard_normal(20)
    ones = [quantity(0.5 * value, 1e-6, budget={"tracking": 1e-6}) for value in values]
    stated = Scatter(0.02, freedom, "stated in lab.toml")
    (row,) = compared(ones, [quantity(0.5, 1e-9)], scatter=lambda _: stated)
    said = r"the 20 measured repetitions scatter by 1\d %, .* of 2 % \(stated in lab.toml; F test, p < 0.01\)"
    assert bool(re.search(said, row.note)) is contradicted
    assert ("F test" in row.note) is contradicted


@pytest.mark.parametrize("n", [1, 2, 4])
def test_with_the_published_scatter_as_the_truth_one_right_twin_in_twenty_is_called_wrong(n):
    """Scatter from heap to heap drawn from the distribution that is the prior."""
    rng = np.random.default_rng(n)
    prior = Scatter(0.03, 5.0, "drawn")
    wrong = 0
    for _ in range(1500):
        std = 30 * prior.relative * math.sqrt(prior.freedom / rng.chisquare(prior.freedom))
        ones = [quantity(value, 1e-6, budget={"tracking": 1e-6}) for value in rng.normal(30, std, n)]
        (row,) = compared(ones, [quantity(30.0, 1e-9)], scatter=lambda _: prior)
        wrong += row.verdict.startswith("twin")
    assert wrong / 1500 == pytest.approx(0.05, abs=0.017)


def test_a_setting_of_the_twin_gets_no_published_scatter():
    height = quantity(0.3, 0.001, "drop_height", "m", "fit")
    row = compared([height], [height], set_from={"drop_height": "stated"}, scatter=partial(published_scatter, "drop"))[
        0
    ]
    assert (row.verdict, row.scatter) == ("set equal", None)


def test_what_a_twin_assumes_and_why_there_is_none_stand_beside_the_number():
    (row,) = compared([quantity(0.4)], [quantity(0.4)], assumed=["a depth of 50 mm", "a fill of 0.35"])
    assert row.note.endswith("the twin assumes a depth of 50 mm, a fill of 0.35")
    (row,) = compared([quantity(0.4)], [], without_twin="it needs the restitution")
    assert (row.verdict, row.note) == ("no twin value", "no twin: it needs the restitution")


def test_two_repetitions_against_two_have_the_effective_degrees_of_freedom_of_the_gum():
    """Equation G.2b of JCGM 100:2008 by hand: scatter known from one degree of freedom, a scale known well."""
    budget = {"tracking": 0.001, "scale": 0.02}
    ones = [quantity(value, math.hypot(*budget.values()), budget=budget) for value in (0.50, 0.54)]
    mean = combine(ones)
    scatter = math.sqrt(2) * 0.02  # of one repetition
    assert (mean.std, mean.n, mean.left_out) == (pytest.approx(scatter), 2, 0)
    assert mean.budget == {"repetition": pytest.approx(scatter / math.sqrt(2)), "scale": pytest.approx(0.02)}
    total = math.hypot(scatter / math.sqrt(2), 0.02)
    assert mean.std_uncertainty == pytest.approx(total)
    assert mean.freedom == pytest.approx((total / (scatter / math.sqrt(2))) ** 4)
    # both sides alike: variances add, each with these degrees of freedom
    (row,) = compared(ones, ones)
    assert row.z == 0
    assert row.coverage_factor == pytest.approx(student_t.ppf(0.975, 2 * mean.freedom), rel=1e-6)


def test_one_repetition_has_a_random_part_unless_its_scatter_is_known_to_be_larger():
    one = quantity(0.5, 0.02, budget={"tracking": 0.02})
    assert combine([one]).budget == {"random": pytest.approx(0.02)}
    assert combine([one], Scatter(0.1, math.inf, "stated")).budget == {"repetition": pytest.approx(0.05)}
    assert combine([one] * 2).budget == {"repetition": pytest.approx(0.02 / math.sqrt(2))}


def test_published_and_own_scatter_are_pooled_by_their_degrees_of_freedom():
    prior = Scatter(0.1, 3.0, "published")
    mean = combine([quantity(value, 1e-6, budget={"tracking": 1e-6}) for value in (0.9, 1.0, 1.1)], prior)
    pooled = math.sqrt((3 * 0.1**2 + 2 * 0.1**2) / 5)
    assert (mean.scatter, mean.freedom) == (pytest.approx(pooled), pytest.approx(5))
    assert mean.std_uncertainty == pytest.approx(pooled / math.sqrt(3))
    assert mean.prior is prior
    assert combine([quantity(1.0 + k / 100, 1e-6) for k in range(4)], prior).prior is None
    assert combine([quantity(0.0, 0.1)], prior).scatter == 0


def test_a_stated_mean_has_the_scatter_of_its_repetitions():
    stated = quantity(0.5, 0.01, n=4, stated=True)
    mean = combine([stated])
    assert (mean.value, mean.n, mean.std, mean.std_uncertainty) == (0.5, 4, pytest.approx(0.02), pytest.approx(0.01))
    assert mean.freedom == pytest.approx(3)
    single = combine([quantity(0.5, 0.01, stated=True)])
    assert (single.std, single.freedom) == (pytest.approx(0.01), math.inf)
    prior = Scatter(0.1, math.inf, "published")
    assert combine([stated], prior).std_uncertainty == pytest.approx(0.05 / math.sqrt(4))
    # of a single one its own uncertainty and the scatter from repetition to repetition
    assert combine([quantity(0.5, 0.01, stated=True)], prior).std_uncertainty == pytest.approx(math.hypot(0.01, 0.05))
    (row,) = compared([stated], [quantity(0.5, 0.01)])
    assert row.note.startswith("the measured value is stated in lab.toml")


def test_notes_stand_in_their_order_with_semicolons():
    failed = [CheckLine("scale", 0, 1, "off"), CheckLine("roll", 0, 1, "off")]
    (row,) = compared(
        [quantity(0.5)] * 2,
        [quantity(0.5, method="time")],
        assumed=["a depth"],
        seen="a fill",
        failed_checks=lambda key: failed,
    )
    assert row.note == (
        "the twin takes from the media a fill; the twin assumes a depth; the twin's value is by another method: time"
    )
    assert row.failed_check == "scale, roll"


def test_collisions_are_compared_with_the_same_collision():
    def ones(*values):
        return [
            quantity(value, name="restitution_pair", detail={"collision": k}) for k, value in enumerate(values, start=1)
        ]

    rows = compared(ones(0.9, 0.8), ones(0.9, 0.8), "pendulum")
    assert [(row.collision, row.percent_deviation) for row in rows] == [(1, 0.0), (2, 0.0)]


@pytest.mark.parametrize("name", ["onset_time", "opening_time", "last_particle_time"])
def test_no_moment_on_the_clock_of_the_film_is_compared(name):
    assert compared([quantity(0.4, name=name, unit="s")], [quantity(0.4, name=name, unit="s")]) == ()


def test_a_setting_that_is_not_what_was_measured_is_counted():
    height = quantity(0.3, 0.001, "drop_height", "m", "fit")
    (row,) = compared([height], [quantity(0.33, 0.001, "drop_height", "m", "fit")], set_from={"drop_height": "stated"})
    assert row.verdict == "differs from the setting"
    assert summarized([row]) == "1 quantity measured and simulated: 1 differs from the setting"


def test_only_the_main_results_are_headlines():
    def named(name, method, **detail):
        return quantity(0.5, name=name, method=method, detail=detail)

    several = [named("restitution_pair", method) for method in ("a", "b", "c")]
    angles = [named("angle_of_repose_geometric", method, side="mean") for method in ("apex", "foot")]
    later = [named("restitution_pair", "a", collision=2), named("angle_of_repose_geometric", "apex", side="left")]
    rows = compared([*several, *angles, *later], [*several, *angles, *later])
    assert [(row.quantity, row.method) for row in headlines(rows)] == [
        ("restitution_pair", "a"), ("restitution_pair", "b"), ("angle_of_repose_geometric", "apex"),
    ]  # fmt: skip


def test_more_repetitions_are_advised_only_where_they_would_tell():
    def verdict(budget):
        ones = [quantity(value, math.hypot(*budget.values()), budget=budget) for value in (0.4, 0.6)]
        return compared(ones, [quantity(0.55, 0.001)])[0].verdict

    assert verdict({"tracking": 0.001, "scale": 0.001}) == "too few repetitions to tell"
    assert verdict({"tracking": 0.001, "scale": 0.1}) == "too uncertain to tell"


def test_every_quantity_has_the_published_scatter_of_its_own():
    known = {"restitution_wall": Scatter(0.1, math.inf, "walls"), "rebound_height": Scatter(0.3, math.inf, "heights")}
    ones = [quantity(0.5, 1e-6, name=name, budget={"tracking": 1e-6}) for name in known]
    rows = compared(ones, ones, "pile", scatter=known.__getitem__)
    assert [row.measured_std_uncertainty for row in rows] == [pytest.approx(0.05), pytest.approx(0.15)]
    assert [row.simulated_std_uncertainty for row in rows] == [pytest.approx(0.05), pytest.approx(0.15)]


def test_a_result_is_the_first_number_of_its_rig_and_of_a_heap_the_mean():
    assert is_result("restitution_pair", None)
    assert is_result("angle_of_repose_graphical", "mean")
    assert not is_result("angle_of_repose_graphical", "left")
    assert not is_result("drop_height", None)


@pytest.mark.parametrize(
    ("verdict", "one", "two"),
    [
        ("twin too low", "1 differs", "2 differ"),
        ("twin probably too high", "1 probably differs", "2 probably differ"),
        ("agrees", "1 agrees within its uncertainty", "2 agree within their uncertainty"),
        ("too few repetitions to tell", "1 has too few repetitions to tell", "2 have too few repetitions to tell"),
        ("too uncertain to tell", "1 is too uncertain to tell", "2 are too uncertain to tell"),
        ("doubtful", "1 is doubtful", "2 are doubtful"),
        ("differs from the setting", "1 differs from the setting", "2 differ from the setting"),
    ],
)
def test_the_verdicts_are_counted_in_singular_and_plural(verdict, one, two):
    row = replace(compared([quantity(0.5)] * 2, [quantity(0.5)])[0], verdict=verdict)
    assert summarized([row]) == f"1 quantity measured and simulated: {one}"
    assert summarized([row, row]) == f"2 quantities measured and simulated: {two}"


def test_without_a_twin_only_the_number_of_quantities_is_said():
    assert summarized(compared([quantity(0.5)], [])) == "1 quantity measured and simulated"


def test_several_verdicts_are_listed_the_differences_first_and_no_twin_not_at_all():
    row = compared([quantity(0.5)] * 2, [quantity(0.5)])[0]
    verdicts = ("doubtful", "agrees", "no twin value", "twin probably too low", "agrees", "twin too low")
    assert summarized([replace(row, verdict=verdict) for verdict in verdicts]) == (
        "6 quantities measured and simulated: 1 differs, 1 probably differs, 2 agree within their uncertainty, "
        "1 is doubtful"
    )


@pytest.mark.parametrize(
    ("off", "verdict", "setting"),
    # standard uncertainties; 95 % span 1.96 of them and 97.5 % span 2.24, and up to two agree in any case
    [
        (1.98, "agrees", "set equal"),
        (2.02, "twin probably too high", "differs from the setting"),
        (2.22, "twin probably too high", "differs from the setting"),
        (2.27, "twin too high", "differs from the setting"),
        (-2.22, "twin probably too low", "differs from the setting"),
        (-2.27, "twin too low", "differs from the setting"),
    ],
)
def test_a_difference_is_probable_above_two_standard_uncertainties_and_sure_above_97_5_percent(off, verdict, setting):
    measured, simulated = [quantity(1.0, 0.01)] * 2, [quantity(1 + 0.01 * off, 1e-9)]
    (row,) = compared(measured, simulated)
    assert (row.coverage_factor, row.verdict) == (pytest.approx(1.96, abs=1e-3), verdict)
    (row,) = compared(measured, simulated, set_from={"restitution_wall": "stated"})
    assert row.verdict == setting


@pytest.mark.parametrize(
    ("freedom", "ratio"),
    # of three repetitions: the probability is exp(-ratio) where the scatter is known, (1 + ratio / 2)**-2 with four
    # degrees of freedom
    [(math.inf, math.log(100)), (4.0, 18.0)],
)
def test_three_repetitions_contradict_a_known_scatter_at_one_percent(freedom, ratio):
    def note(factor):
        off = 0.02 * math.sqrt(factor * ratio)
        ones = [quantity(value, 1e-6, budget={"tracking": 1e-6}) for value in (1 - off, 1.0, 1 + off)]
        known = Scatter(0.02, freedom, "stated in lab.toml")
        return compared(ones, [quantity(1.0, 1e-9)], scatter=lambda _: known)[0].note

    assert "F test" not in note(0.98)
    assert "the 3 measured repetitions scatter by" in note(1.02)


def test_a_scatter_known_to_be_zero_is_contradicted_by_any():
    known = Scatter(0.0, 5.0, "stated in lab.toml")
    ones = [quantity(value, 1e-6, budget={"tracking": 1e-6}) for value in (0.9, 1.0, 1.1)]
    assert combine(ones, known).own_scatter == pytest.approx(0.1)
    assert combine(ones[:1] * 3, known).own_scatter is None


def test_a_stated_mean_has_a_budget_and_degrees_of_freedom_of_the_scatter_that_was_used():
    stated = quantity(0.5, 0.01, n=2, budget={"scale": 0.01}, stated=True)
    assert (combine([stated]).budget, combine([stated]).stated) == ({"scale": 0.01}, True)
    assert combine([stated]).freedom == pytest.approx(1)
    exact = combine([stated], Scatter(0.1, math.inf, "published"))
    assert exact.budget == {"repetition": pytest.approx(0.05 / math.sqrt(2))}
    assert exact.freedom == math.inf
    few = combine([stated], Scatter(0.1, 5.0, "published"))
    scatter = math.sqrt((5 * 0.05**2 + 0.01**2 * 2) / 6)
    assert (few.std_uncertainty, few.freedom) == (pytest.approx(scatter / math.sqrt(2)), pytest.approx(6))
    assert few.scatter == pytest.approx(scatter / 0.5)
    alone = combine([replace(stated, n=1)], Scatter(0.1, 5.0, "published"))
    # the variance of the scatter is known from five degrees of freedom, that of the reading exactly
    assert alone.freedom == pytest.approx(5 * (1 + (0.01 / 0.05) ** 2) ** 2)


def test_a_doubtful_twin_makes_the_row_doubtful_and_each_reason_is_given_once():
    measured = [quantity(0.5, doubtful="blurred"), quantity(0.5, doubtful="blurred")]
    (row,) = compared(measured, [quantity(0.5, doubtful="it leaks")])
    assert (row.verdict, row.doubtful) == ("doubtful", "blurred; twin: it leaks")
    (row,) = compared([quantity(0.5)] * 2, [quantity(0.5, doubtful="it leaks")])
    assert (row.verdict, row.doubtful) == ("doubtful", "twin: it leaks")


def test_a_row_holds_both_sides_with_their_scatter():
    detail = {"body": "B", "collision": 2, "bounce": 3, "frame": 7}
    measured = [quantity(value, 1e-6, budget={"tracking": 1e-6}, detail=detail) for value in (0.4, 0.5, 0.6)]
    simulated = [quantity(value, 1e-6, budget={"tracking": 1e-6}, detail=detail) for value in (0.5, 0.5, 0.7, 0.7)]
    (row,) = compared(measured, simulated)
    assert (row.experiment, row.rig, row.quantity, row.method, row.unit) == (
        "it", "drop", "restitution_wall", "height", "1",
    )  # fmt: skip
    assert (row.body, row.collision, row.bounce, row.side) == ("B", 2, 3, None)
    assert (row.measured, row.measured_std, row.measured_n) == (pytest.approx(0.5), pytest.approx(0.1), 3)
    assert row.measured_std_uncertainty == pytest.approx(0.1 / math.sqrt(3))
    assert (row.simulated, row.simulated_std, row.simulated_n) == (
        pytest.approx(0.6), pytest.approx(0.2 / math.sqrt(3)), 4,
    )  # fmt: skip
    assert row.simulated_std_uncertainty == pytest.approx(0.1 / math.sqrt(3))
    assert row.z == pytest.approx(0.1 / (0.1 * math.sqrt(2 / 3)))
    assert row.coverage_factor == pytest.approx(student_t.ppf(0.975, 4 / (1 / 2 + 1 / 3)))
    assert row.budget == {"repetition": pytest.approx(0.1 / math.sqrt(3))}
    assert (row.scatter, row.scatter_from, row.doubtful, row.failed_check, row.note) == (None, "", "", "", "")


def test_without_a_counterpart_nothing_is_said_of_the_twin_s_settings():
    (row,) = compared([quantity(0.5)], [quantity(1.0, name="bed_height")], assumed=["a depth"], seen="a fill")
    assert row.note == "the twin gives no such number"


def test_the_notes_of_a_stated_value_and_of_left_out_repetitions_are_separated():
    slope = partial(quantity, std=0.5, name="angle_of_repose_graphical", unit="deg", method="line")
    (row,) = compared([slope(30.0, stated=True)], [slope(30.0)] * 2, "pile")
    assert row.note == (
        "the measured value is stated in lab.toml; one heap measured: the scatter of heaps is not in the uncertainty"
    )
    ones = [slope(30.0), slope(30.0), slope(50.0, doubtful="cut off"), slope(9.0, doubtful="cut off")]
    (row,) = compared(ones, [slope(30.0)] * 2, "pile", set_from={"angle_of_repose_graphical": "stated"})
    assert row.note == "the twin starts from the stated value; 2 doubtful repetitions left out"
    (row,) = compared([quantity(0.5)], [quantity(0.5)])
    assert row.note == "one repetition measured: the scatter of repetitions is not in the uncertainty"


def test_the_notes_name_the_scatter_that_was_used_and_both_sides_that_contradict_it():
    known = Scatter(0.02, math.inf, "stated in lab.toml")
    ones = [quantity(value, 1e-6, budget={"tracking": 1e-6}) for value in (0.9, 1.0, 1.1)]
    (row,) = compared(ones, ones, "pile", scatter=lambda _: known)
    assert (row.scatter, row.scatter_from) == (pytest.approx(0.02), "stated in lab.toml")
    used, measured, simulated = row.note.split("; the 3 ")
    assert used == (
        "3 measured repetitions and 3 simulated heaps: a scatter of 2 % is in the uncertainty (stated in lab.toml)"
    )
    too_large = "too much for a scatter of 2 % (stated in lab.toml; F test, p < 0.01)"
    assert measured == f"measured repetitions scatter by 10 %, {too_large}"
    assert simulated == f"simulated heaps scatter by 10 %, {too_large}"
    (row,) = compared(ones, [], "pile", scatter=lambda _: known, without_twin="it has no wall")
    alone = "no twin: it has no wall; 3 measured repetitions: a scatter of 2 % is in the uncertainty"
    assert row.note.startswith(alone)
    assert row.note.endswith(f"; the 3 measured repetitions scatter by 10 %, {too_large}")


def test_every_result_is_a_quantity_of_a_rig_and_comes_first_with_its_methods():
    several = {
        "drop": {"restitution_wall": 2, "drop_height": 1, "rebound_height": 1},
        "pendulum": {"restitution_pair": 2, "restitution_wall": 2, "release_angle": 1, "rebound_angle": 1},
        "tilt": {"static_friction": 1, "rolling_friction": 1},
        "packing": {"bed_height": 1, "bulk_density": 1},
        "pile": {"angle_of_repose_graphical": 1, "angle_of_repose_geometric": 1},
        "hopper": {"discharge_time": 1, "mass_flow_rate": 1},
    }
    inputs = ("drop_height", "rebound_height", "release_angle", "rebound_angle")
    for rig, shown in several.items():
        ones = [quantity(0.5, name=name, method=method) for name in (*shown, "other") for method in ("a", "b", "c")]
        rows = compared(ones, ones, rig)
        primary, rest = primary_first(rows)
        expected = [(name, method) for name, number in shown.items() for method in ("a", "b", "c")[:number]]
        assert [(row.quantity, row.method) for row in primary] == expected
        assert len(primary) + len(rest) == len(rows)
        results = [one for one in expected if one[0] not in inputs]
        assert [(row.quantity, row.method) for row in headlines(rows)] == results


def test_the_results_of_two_beads_and_of_two_experiments_are_shown_beside_each_other():
    def angle(body):
        return quantity(8.0, 0.1, "rebound_angle", "deg", "swing", detail={"body": body})

    rows = compared([angle("A"), angle("B")], [])
    again = tuple(replace(row, experiment="again") for row in rows)
    assert primary_first([*rows, *again]) == ([*rows, *again], [])


@pytest.mark.parametrize(
    ("scale", "verdict"),
    # with the scatter averaged out, two standard uncertainties of 12.4 % lie within 25 %, those of 12.6 % do not
    [(0.124, "too few repetitions to tell"), (0.126, "too uncertain to tell")],
)
def test_more_repetitions_would_tell_where_the_shared_parts_allow_it(scale, verdict):
    ones = [quantity(value, scale, budget={"scale": scale}) for value in (0.8, 1.2)]
    (row,) = compared(ones, [quantity(1.0, 1e-6)])
    assert (row.z, row.verdict) == (pytest.approx(0, abs=1e-9), verdict)


def test_an_uncertainty_of_zero_gives_no_z_but_a_percentage():
    (row,) = compared([quantity(0.5, 0.0)] * 2, [quantity(0.6, 0.0)])
    assert (row.z, row.coverage_factor, row.verdict) == (None, None, "uncertainty unknown")
    assert (row.percent_deviation, row.percent_deviation_std) == (pytest.approx(20), 0)
    (row,) = compared([quantity(0.0, 0.0)] * 2, [quantity(0.6, 0.0)])
    assert row.percent_deviation is None
    (row,) = compared([quantity(0.5, 0.0)], [quantity(0.6, 0.0)], set_from={"restitution_wall": "stated"})
    assert row.verdict == "set equal"


def test_parts_that_are_not_in_the_budget_or_unknown_are_shared():
    plain = combine([quantity(0.5, 0.02)] * 4)
    assert (plain.budget, plain.freedom) == ({"measurement": pytest.approx(0.02)}, math.inf)
    wide = combine([quantity(0.5, 0.05, budget={"tracking": 0.03})] * 4)
    assert wide.budget == {"repetition": pytest.approx(0.015), "unexplained": pytest.approx(0.04)}
    full = combine([quantity(0.5, 0.03, budget={"tracking": 0.03})] * 4)
    assert full.budget == {"repetition": pytest.approx(0.015)}
    unknown = combine([quantity(0.5, math.inf), quantity(0.5, 0.01)])
    assert (unknown.budget, unknown.std_uncertainty) == ({"unknown": math.inf, "measurement": 0.005}, math.inf)
    assert unknown.freedom == math.inf


def test_views_that_were_not_measured_or_have_no_name_are_not_averaged():
    def slope(value, **detail):
        return quantity(value, 0.5, "angle_of_repose_graphical", "deg", "line", detail=detail)

    ones = [slope(math.nan, view="front"), slope(30.0, view="back")]
    assert over_views(ones) == ones
    assert [one.value for one in over_views([*ones, slope(31.0, view="left")])] == [30.5]
    twice = [slope(30.0), slope(32.0)]
    assert over_views(twice) == twice
    assert over_views([*ones, slope(31.0, view="all")]) == [slope(31.0, view="all")]
