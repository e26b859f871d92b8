"""Values with uncertainties as they may be typed into lab.toml."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.stated_values import mean_of_repetitions, stated_quantities
from rigtwin.lab.rigs import DropSettings, PackingSettings, PendulumSettings, PileSettings, TiltSettings

BED, HEAP, DROP = PackingSettings(0.1), PileSettings(0.09), DropSettings()


@pytest.mark.parametrize(
    "text",
    [
        "184 +- 1.3 mm (n = 10)",
        "184 ± 1.3 mm (n=10)",
        "184±1.3mm, n = 10",
        "184 mm +/- 1.3 mm; n = 10",
        "184 mm ± 1.3 (n = 10)",
        "18.4 cm ± 1.3 mm (n = 10)",
        "(184 ± 1.3) mm (n = 10)",
        "1.84e-1 m +- 1300 um n = 10",
    ],
)
def test_a_mean_may_be_written_in_the_usual_ways(text):
    assert mean_of_repetitions(text, "length") == pytest.approx((0.184, 0.0013, 10))


@given(
    value=st.floats(1e-3, 1e3),
    std=st.floats(1e-3, 1e3),
    n=st.integers(1, 10_000),
    sign=st.sampled_from(["±", "+-", " +/- "]),
    unit=st.sampled_from(["mm", "m"]),
)
def test_what_is_written_is_read(value, std, n, sign, unit):
    factor = {"mm": 1e-3, "m": 1.0}[unit]
    found = mean_of_repetitions(f"{value!r}{sign}{std!r} {unit} (n = {n})", "length")
    assert found == pytest.approx((value * factor, std * factor, n), rel=1e-12)


def test_the_uncertainty_of_the_mean_falls_with_the_square_root_of_the_repetitions():
    (ten,) = stated_quantities("bed_height", "184 +- 1.3 mm (n = 10)", BED)
    assert (ten.n, ten.std_uncertainty) == (10, pytest.approx(1.3e-3 / math.sqrt(10)))
    (one,) = stated_quantities("bed_height", "184 +- 1.3 mm", BED)
    assert (one.n, one.std_uncertainty) == (1, 1.3e-3)


def test_angles_are_in_degrees_and_details_are_the_main_ones_unless_stated():
    (heap,) = stated_quantities("angle_of_repose_geometric", "0.5 ± 0.1 rad", HEAP)
    assert (heap.value, heap.unit) == (pytest.approx(math.degrees(0.5)), "deg")
    assert (heap.method, heap.detail) == ("apex", {"side": "mean"})
    one = {"value": "30 +- 1 deg", "method": "equal area", "side": "left"}
    (left,) = stated_quantities("angle_of_repose_geometric", one, HEAP)
    assert (left.method, left.detail) == ("equal area", {"side": "left"})
    first, second = stated_quantities("rebound_height", ["40 +- 1 mm", {"value": "8 +- 1 mm", "bounce": 2}], DROP)
    assert (first.detail, second.detail) == ({"bounce": 1}, {"bounce": 2})
    (struck,) = stated_quantities("rebound_angle", "38 +- 1 deg", PendulumSettings(0.2))
    assert struck.detail == {"body": "B"}


@pytest.mark.parametrize(
    ("name", "given", "why"),
    [
        ("bed_height", "184 mm", "'184 mm' has no uncertainty; write mean, standard deviation and number"),
        ("bed_height", 0.184, "0.184 has no uncertainty"),
        ("bed_height", True, "True has no uncertainty"),
        ("bed_height", "184 +- 1.3", "has no unit"),
        ("bed_height", "184 ± 1 mm ± 2 mm", "has more than one uncertainty"),
        ("bed_height", "184 +- 1.3 mm (n = 0)", "at least 1"),
        ("bed_height", "184 +- 1.3 mm (n = 2.5)", "is not a length"),
        ("bed_height", "184 +- 0 mm", "no uncertainty above zero"),
        ("bed_height", "184 ± 1,3 mm", "is not a length"),
        ("bed_height", "nan ± 1 mm", "is not a finite number"),
        ("bed_height", " " * 100_000 + "1 +- 1 mm", "has 100009 characters"),
        ("bed_height", "184 +- 1 m", "out of range; it must be above 0 and at most 10 m"),
        ("bed_height", [], "is empty"),
        ("bed_height", [["184 +- 1 mm"]], "has no uncertainty"),
        ("bed_height", ["184 +- 1 mm", {"value": "183 +- 1 mm"}], "the same twice"),
        ("bed_height", {"method": "outline"}, "has no value"),
        ("bed_height", {"value": "184 +- 1 mm", "n": 3}, "unknown key 'n'; known are value, method"),
        ("bed_height", {"value": "184 +- 1 mm", "method": "mean surfaces"}, "did you mean 'mean surface'"),
        ("cylinder_diameter", "1 +- 1 mm", "is a setting of the packing"),
    ],
)
def test_what_is_no_value_with_an_uncertainty_is_refused(name, given, why):
    with pytest.raises(BadInput) as refused:
        stated_quantities(name, given, BED)
    assert why in str(refused.value)


@pytest.mark.parametrize(
    ("rig", "name", "given", "why"),
    [
        (DROP, "restitution_wall", "1.2 +- 0.1", "above 0 and at most 1"),
        (DROP, "restitution_wall", {"value": "0.4 +- 0.1", "bounce": 0}, "whole number of at least 1"),
        (HEAP, "angle_of_repose_graphical", {"value": "30 +- 1 deg", "side": "top"}, "side = 'top' is not known"),
        (
            TiltSettings("roll"),
            "static_friction",
            "0.4 +- 0.1",
            "no result of a tilt (roll); known are rolling_friction",
        ),
        (PendulumSettings(0.2), "restitution_wall", "0.4 +- 0.1", "no result of a pendulum (double)"),
    ],
)
def test_details_and_ranges_are_those_of_the_rig(rig, name, given, why):
    with pytest.raises(BadInput) as refused:
        stated_quantities(name, given, rig)
    assert why in str(refused.value)


@pytest.mark.parametrize(
    ("entry", "mean", "std", "n"),
    [
        ("184, 183, 185 mm", 0.184, 1e-3, 3),
        (["184 mm", "183 mm", "18.5 cm"], 0.184, 1e-3, 3),
        ("184; 183; 184; 185; 184 mm", 0.184, math.sqrt(0.5) * 1e-3, 5),
        ("184, 184 mm", 0.184, 1e-3 / math.sqrt(12), 2),  # rounded to millimetres
        ({"value": "184.0, 186.0 mm", "method": "outline"}, 0.185, math.sqrt(2) * 1e-3, 2),
    ],
)
def test_values_of_single_repetitions_are_a_mean_with_its_scatter(entry, mean, std, n):
    (one,) = stated_quantities("bed_height", entry, BED)
    assert (one.value, one.n) == (pytest.approx(mean), n)
    assert one.std_uncertainty == pytest.approx(std / math.sqrt(n))


@pytest.mark.parametrize(
    ("entry", "why"),
    [
        (["184 mm"], "is one repetition"),
        ([184, 183], "has no unit"),
        ("18,4, 18,5 mm", "'18,4' is no value"),
        ("184, x mm", "is not a length"),
        ("184, 183 kg", "wrong unit"),
        ("18,4 mm", "has no uncertainty"),
        ([], "is empty"),
    ],
)
def test_what_are_no_values_of_single_repetitions_is_refused(entry, why):
    with pytest.raises(BadInput, match=why):
        stated_quantities("bed_height", entry, BED)
