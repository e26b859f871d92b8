"""What is said of the camera, as options and keys say it."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.camera import (
    Camera,
    Moment,
    Seed,
    circle,
    height,
    known_length,
    line,
    moment,
    point,
    region,
    roll,
    seed,
)
from rigtwin.lab.errors import BadInput, BadQuantity

PIXELS = st.integers(0, 4000)


@settings(deadline=None, derandomize=True)
@given(x=PIXELS, y=PIXELS, distance=st.integers(11, 3000), angle=st.floats(0, 2 * math.pi))
def test_a_known_length_gives_the_same_scale_in_any_direction(x, y, distance, angle):
    x2, y2 = x + distance * math.cos(angle), y + distance * math.sin(angle)
    line = known_length(f"100 mm:{x},{y},{x2},{y2}")
    assert line.scale == pytest.approx(0.1 / distance, rel=1e-9)
    assert Camera(known_length=line).given_scale == line.scale


def test_a_scale_and_a_known_length_are_not_both_taken():
    with pytest.raises(BadInput, match="leave one of them out"):
        Camera(scale=1e-3, known_length=known_length("100mm:0,0,500,0"))


def test_a_camera_of_which_nothing_is_said_has_no_scale():
    assert Camera().given_scale is None


@pytest.mark.parametrize(
    "text",
    [
        "100mm:10,20,10,20",
        "100mm:100,500,101,500",
        "100mm:nan,0,10,0",
        "0mm:0,0,10,0",
        "-5mm:0,0,10,0",
        "100mm",
        "100mm:1,2,3",
        "100Hz:0,0,10,0",
        ":0,0,1,1",
    ],
)
def test_a_known_length_that_spans_nothing_is_refused(text):
    with pytest.raises(BadQuantity):
        known_length(text)


def test_a_region_is_read_in_the_order_x_y_width_height():
    assert region("10, 20, 300,400") == (10, 20, 300, 400)


@pytest.mark.parametrize("text", ["1,2,3", "nan,2,3,4", "1,2,inf,4", "1,2,0,4", "1,2,3,-4", "a,b,c,d", "", "1,2,3,4,5"])
def test_an_empty_or_malformed_region_is_refused(text):
    with pytest.raises(BadQuantity):
        region(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("12 frames", Moment(12, "frame")),
        ("12f", Moment(12, "frame")),
        ("1 min", Moment(60, "s")),
        (0.5, Moment(0.5, "s")),
    ],
)
def test_a_moment_is_a_time_or_a_frame(text, expected):
    assert moment(text) == expected


@pytest.mark.parametrize("text", ["-1 s", -0.5, "-3 frames"])
def test_a_moment_before_the_clip_is_refused(text):
    with pytest.raises(BadQuantity, match="start"):
        moment(text)


@pytest.mark.parametrize("text", ["90 deg", 3, "-60 deg"])
def test_a_roll_that_no_camera_on_a_stand_has_is_refused_and_taken_for_a_missing_unit(text):
    with pytest.raises(BadQuantity, match=r"write it like '1.5 deg'"):
        roll(text)


def test_a_window_that_ends_before_it_starts_is_refused():
    with pytest.raises(BadInput, match="--end: 1 s is not after the start"):
        Camera(start=Moment(2, "s"), end=Moment(1, "s"))


@pytest.mark.parametrize("wrong", [{"frame_rate": 0.0}, {"frame_rate": -240.0}, {"scale": 0.0}, {"scale": math.nan}])
def test_a_rate_or_scale_that_cannot_be_is_refused(wrong):
    with pytest.raises(BadInput, match="must be positive"):
        Camera(**wrong)


@pytest.mark.parametrize("line", ["10 m:0,0,20,0", "9000mm:5,5,5,50"])
def test_a_scale_of_no_rig_is_refused_however_it_is_given(line):
    for wrong in ({"scale": 0.3}, {"scale": 1000.0}):
        with pytest.raises(BadInput, match=r"^--scale: .* in a pixel; write it like '0.2 mm/px'\.$"):
            Camera(**wrong)
    with pytest.raises(
        BadInput, match=r"^--known-length: .* in a pixel; give the length .* like '100mm:120,40,620,40'\."
    ):
        Camera(known_length=known_length(line))


def test_a_rate_that_no_camera_has_is_refused():
    with pytest.raises(BadInput, match="1e\\+300"):
        Camera(frame_rate=1e300)


def test_what_is_stated_is_read():
    assert line("500,310,100,300") == ((100.0, 300.0), (500.0, 310.0))
    assert seed("12:310,88.5") == Seed(12, (310.0, 88.5))
    assert circle("320,240,200") == (320.0, 240.0, 200.0)
    assert point("3,4") == (3.0, 4.0)
    assert height("88.5") == 88.5


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (line, "100,300,104,300"),
        (line, "100,300,200"),
        (circle, "100,300,0"),
        (circle, "100,300,-40"),
        (point, "nan,3"),
        (seed, "310,88"),
        (seed, "-3:310,88"),
        (seed, "3:310"),
        (height, "40 mm"),
    ],
)
def test_what_is_stated_wrongly_is_refused_with_an_example(read, text):
    with pytest.raises(BadQuantity, match=r"given|of the form|points far apart|inner rim"):
        read(text, name="given")
