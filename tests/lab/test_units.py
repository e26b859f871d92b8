"""Texts with units become SI floats; anything else is refused in one sentence."""

import contextlib
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.errors import BadQuantity
from rigtwin.lab.units import AMBIGUOUS, DIMENSIONS, si

# unit as written -> its dimension and what one of it is in SI, from the definitions of the units
ONE_OF = {
    "mm": ("length", 1e-3),
    "µm": ("length", 1e-6),
    "cm": ("length", 1e-2),
    "inch": ("length", 0.0254),
    "ms": ("time", 1e-3),
    "min": ("time", 60.0),
    "g": ("mass", 1e-3),
    "g/cm^3": ("density", 1000.0),
    "kg/m³": ("density", 1.0),
    "GPa": ("pressure", 1e9),
    "kHz": ("frequency", 1e3),
    "fps": ("frequency", 1.0),
    "/s": ("rate", 1.0),
    "/min": ("rate", 1 / 60),
    "deg": ("angle", math.pi / 180),
    "°": ("angle", math.pi / 180),
    "rpm": ("angular_speed", 2 * math.pi / 60),
    "mm/s": ("speed", 1e-3),
    "cm/s^2": ("acceleration", 1e-2),
    "mm/px": ("scale", 1e-3),
    "%": ("number", 0.01),
}


@settings(deadline=None, derandomize=True)
@given(
    value=st.floats(1e-6, 1e6).map(lambda number: float(f"{number:.9g}")),
    unit=st.sampled_from(sorted(ONE_OF)),
    space=st.sampled_from(["", " ", "   "]),
    sign=st.sampled_from([1, -1]),
)
def test_a_quantity_comes_out_in_si(value, unit, space, sign):
    dimension, one = ONE_OF[unit]
    assert si(f"{sign * value!r}{space}{unit}", dimension) == pytest.approx(sign * value * one, rel=1e-12)


@settings(deadline=None, derandomize=True)
@given(
    value=st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False),
    dimension=st.sampled_from(sorted(DIMENSIONS.keys() - AMBIGUOUS.keys())),
)
def test_a_bare_number_is_si_already(value, dimension):
    assert si(value, dimension) == value
    assert si(repr(value), dimension) == value


def test_a_bare_angular_speed_may_be_rpm_and_is_refused():
    for bare in ("3", 3, 3.0):
        with pytest.raises(BadQuantity, match=r"--speed: 3 may be .* turns a minute; .* '3 rpm'"):
            si(bare, "angular_speed", name="--speed")


@settings(deadline=None, derandomize=True)
@given(unit=st.sampled_from(sorted(ONE_OF)), dimension=st.sampled_from(sorted(DIMENSIONS)))
def test_a_unit_of_another_dimension_is_refused_with_name_text_and_example(unit, dimension):
    if ONE_OF[unit][0] == dimension or (unit, dimension) == ("rpm", "tilting_speed"):
        return
    if unit == "fps" and dimension == "speed":  # feet per second, rightly
        return
    if {ONE_OF[unit][0], dimension} == {"frequency", "rate"} and unit != "fps":  # the same unit
        return
    with pytest.raises(BadQuantity) as refused:
        si(f"3 {unit}", dimension, name="camera.scale")
    message = str(refused.value)
    assert message.startswith("camera.scale: ")
    assert repr(f"3 {unit}") in message
    assert DIMENSIONS[dimension][1] in message


def test_a_tilt_is_given_the_unit_of_a_tilt_and_takes_that_of_a_drum():
    for slip in ("2 deg", 2):
        with pytest.raises(BadQuantity, match="'2 deg/s'"):
            si(slip, "tilting_speed")
    assert si("1 rpm", "tilting_speed") == si("6 deg/s", "angular_speed")


def test_hertz_is_no_angular_speed_and_rpm_no_frequency():
    with pytest.raises(BadQuantity, match="angular speed"):
        si("3 Hz", "angular_speed")
    with pytest.raises(BadQuantity, match="frequency"):
        si("3 rpm", "frequency")


def test_a_short_decimal_stays_short_in_si():
    assert si("6.2 mm", "length") == 0.0062
    assert si("0.1 mm/px", "scale") == 0.0001


@pytest.mark.parametrize(
    "text", ["", "mm", "6,2 mm", "6.2 mmm", "9**9**9**9 m", "nan mm", "nan", "inf", "1e999 m", "1 /"]
)
def test_text_that_is_no_length_is_refused(text):
    with pytest.raises(BadQuantity):
        si(text, "length")


@pytest.mark.parametrize("text", ["6,0mm", "6,1 mm", "1,5", "1,000 mm", "6,mm"])
def test_a_decimal_comma_is_refused_with_what_to_write(text):
    with pytest.raises(
        BadQuantity, match=rf"^width: '{text}' is not a length .a number has a decimal point and no comma"
    ):
        si(text, "length", name="width")


@pytest.mark.parametrize("value", [True, None, [1.0], {"value": 1}])
def test_something_that_is_neither_text_nor_number_is_refused(value):
    with pytest.raises(BadQuantity, match="not a quantity"):
        si(value, "length")


@settings(deadline=None, derandomize=True)
@given(text=st.text(max_size=20))
def test_any_text_is_either_a_finite_length_or_refused(text):
    with contextlib.suppress(BadQuantity):
        assert math.isfinite(si(text, "length"))


def test_a_long_text_is_refused_with_its_beginning():
    with pytest.raises(
        BadQuantity, match=r"^diameter: '5\*5\*5\*5\*5\*5\*5\*5\*5\*5\*'\.\.\. with 4000 characters is not"
    ):
        si("5*" * 2000, "length", name="diameter")
