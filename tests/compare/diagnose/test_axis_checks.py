"""Diagnosis: errors in the columns of a track are reported before the fit."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigtwin.compare.diagnose.data.axis_checks import check_axes
from rigtwin.compare.diagnose.data.exclusions import sifted
from rigtwin.compare.diagnose.data.tracked_lab import Bead, Camera, Condition, TrackedLab
from rigtwin.compare.diagnose.diagnosis import diagnose
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track
from rigtwin.lab.tracked.read import read_tracks

G = 9.81
RADIUS = 0.003
TIME = np.arange(0, 1.0, 1 / 240)


def bouncing():
    """A bead that falls from 0.3 m and bounces with half of its speed."""
    place, speed, height = [], 0.0, 0.3
    for _ in TIME:
        place.append([0.01 * len(place) / 240, RADIUS + height])
        speed, height = speed - G / 240, height + speed / 240 - G / 240**2 / 2
        if height < 0:
            height, speed = 0.0, -0.5 * speed
    return np.array(place)


def swinging(low, high):
    angle = np.radians(low + (high - low) * (0.5 + 0.5 * np.cos(6 * TIME)))
    return 0.25 * np.column_stack([np.sin(angle), -np.cos(angle)])


def sliding():
    angle = math.radians(20) + 0.03 * TIME
    along = 0.25 - 0.1 * TIME**2
    return np.column_stack(
        [along * np.cos(angle) - RADIUS * np.sin(angle), along * np.sin(angle) + RADIUS * np.cos(angle)]
    )


def rolling():
    along = 0.4 * TIME**2
    return np.column_stack([along * math.cos(0.15), RADIUS - along * math.sin(0.15)])


LABS = {
    "drop": ("drop", bouncing(), {"drop_height_m": 0.3}),
    "pendulum": ("pendulum", swinging(-50, 50), {"length_m": 0.25, "release_angle_deg": 50}),
    "pendulum that strikes a wall": ("pendulum", swinging(0, 50), {"length_m": 0.25, "release_angle_deg": 50}),
    "slide": ("slide", sliding(), {"start_angle_deg": 20.0, "tilt_rate_deg_s": math.degrees(0.03)}),
    "roll": ("roll", rolling(), {"incline_angle_deg": math.degrees(0.15)}),
}


def lab_of(name, turn, settings=None):
    rig, place, usual = LABS[name]
    noise = np.random.default_rng(3).normal(0, 2e-4, place.shape)
    track = Track(TIME, turn(place + noise), np.full(len(TIME), np.nan))
    condition = Condition("c", Bead("b", 2 * RADIUS, 2e-4), "", settings or usual, ((track,),) * 5, ("c/rep01.csv",))
    return TrackedLab("", rig, G, Camera(240.0, 2e-4), {}, (condition,), Path("lab"))


@pytest.mark.parametrize("name", LABS)
def test_exchanged_or_inverted_columns_of_a_track_are_reported(name):
    check_axes(lab_of(name, lambda place: place))
    with pytest.raises(BadInput, match=r"c/rep01.csv: .* x_m and y_m look exchanged"):
        check_axes(lab_of(name, lambda place: place[:, ::-1]))
    with pytest.raises(BadInput, match=r"c/rep01.csv: .* y_m looks as if it counted downwards"):
        check_axes(lab_of(name, lambda place: place * [1, -1]))


def test_times_in_milliseconds_are_refused():
    lab = lab_of("drop", lambda place: place)
    condition = lab.conditions[0]
    slow = tuple(tuple(replace(track, time=1000 * track.time) for track in each) for each in condition.repetitions)
    with pytest.raises(BadInput, match=r"c/rep01.csv: its rows are .* s apart"):
        check_axes(replace(lab, conditions=(replace(condition, repetitions=slow),)))


@pytest.mark.parametrize("stage", ["bench_of", "fit", "name_effects"])
@pytest.mark.parametrize("error", [np.linalg.LinAlgError, FloatingPointError])
def test_a_lab_to_which_nothing_can_be_fitted_is_refused_in_one_sentence_wherever_it_fails(monkeypatch, stage, error):
    def failing(*_arguments, **_settings):
        raise error("Singular matrix")

    monkeypatch.setattr(f"rigtwin.compare.diagnose.diagnosis.{stage}", failing)
    with pytest.raises(BadInput, match=r"the model of a drop cannot be fitted to these tracks \(Singular matrix\)"):
        diagnose(lab_of("drop", lambda place: place), listed=[])


def test_a_fault_of_the_program_is_not_reported_as_an_error_of_the_lab(monkeypatch):
    def failing(*_arguments, **_settings):
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr("rigtwin.compare.diagnose.diagnosis.name_effects", failing)
    with pytest.raises(ValueError, match="broadcast") as error:
        diagnose(lab_of("drop", lambda place: place), listed=[])
    assert not isinstance(error.value, BadInput)


def test_a_pendulum_with_the_origin_at_its_bob_is_refused():
    with pytest.raises(BadInput, match="put the origin at the pivot"):
        check_axes(lab_of("pendulum", lambda place: place + np.array([0, 0.25])))


def test_rows_without_a_position_are_reported_by_file(tmp_path):
    rows = [f"{t:.5f},{x:.6f},{y:.6f}" for t, (x, y) in zip(TIME, bouncing(), strict=True)]
    rows[40:43] = [f"{t:.5f},nan,nan" for t in TIME[40:43]]
    (tmp_path / "rep01.csv").write_text("time_s,x_m,y_m\n" + "\n".join(rows) + "\n")
    lab = lab_of("drop", lambda place: place)
    whole = lab.conditions[0].repetitions
    gappy = replace(lab.conditions[0], repetitions=(read_tracks(tmp_path / "rep01.csv"), *whole[1:]))
    assert "rows without a position left out: 3 of 240 in c/rep01.csv" in sifted(replace(lab, conditions=(gappy,)))[1]
    assert not any("without a position" in one for one in sifted(lab)[1])


FINE = 2e-3  # [s], step of the drawn motions
DRAWN = 250
FAULTS = {"exchanged": lambda place: place[:, ::-1], "counted downwards": lambda place: place * [1, -1]}


def drawn_drops(rng, n):
    """(steps, n, 2) [m]: beads released or thrown, the light ones slowed by air, over an elastic plate."""
    thrown = rng.random(n) < 0.5
    speed = np.where(thrown, rng.uniform([[-1.0], [-0.5]], [[1.0], [1.5]], (2, n)), 0.0)
    height, lively = np.exp(rng.uniform(np.log(0.02), np.log(0.6), n)), rng.uniform(0.3, 0.97, n)
    drag = G / np.exp(rng.uniform(np.log(1.5), np.log(50), n)) ** 2
    at, path = np.stack([np.zeros(n), height]), []
    for _ in range(600):
        path.append(at.T + np.array([0, RADIUS]))
        speed = speed - FINE * (drag * np.hypot(*speed) * speed + np.array([[0.0], [G]]))
        at = at + FINE * speed
        struck = at[1] < 0
        at[1], speed[1] = np.where(struck, 0.0, at[1]), np.where(struck, -lively * speed[1], speed[1])
    return np.array(path)


def drawn_pendulums(rng, n):
    """(steps, n, 2) [m], lengths [m] and release angles [rad]: free, against a wall, or first and second of two."""
    length, lively = rng.uniform(0.05, 0.5, n), rng.uniform(0.3, 0.95, n)
    release = np.radians(rng.uniform(3, 170, n)) * rng.choice([-1, 1], n)
    kind = rng.integers(0, 4, n)
    angle, rate, path = np.stack([release, np.zeros(n)]), np.zeros((2, n)), []
    side = np.sign(release)
    drag = rng.uniform(0, 0.5, n)
    for _ in range(900):
        path.append(np.where(kind == 3, angle[1], angle[0]))
        rate = rate - FINE * (G / length * np.sin(angle) + drag * rate)
        angle = angle + FINE * rate
        wall = (kind == 1) & (angle[0] * side < 0)
        meet = (kind > 1) & ((angle[0] - angle[1]) * side < 0) & ((rate[0] - rate[1]) * side < 0)
        mean, half = rate.mean(axis=0), lively * (rate[0] - rate[1]) / 2
        rate = np.where(meet, np.stack([mean - half, mean + half]), rate)
        rate[0] = np.where(wall, -lively * rate[0], rate[0])
        angle[0] = np.where(wall, 0.0, angle[0])
    pivot = np.where(kind == 2, side * RADIUS, np.where(kind == 3, -side * RADIUS, 0.0))
    swung = np.array(path)
    return np.stack([pivot + length * np.sin(swung), -length * np.cos(swung)], axis=-1), length, release


def filmed(rng, path, rate=(10, 1000), span=(0.1, 2.5)):
    """A part of a motion as a camera of some rate and some noise would see it."""
    end = FINE * (len(path) - 1)
    begin = rng.uniform(0, 0.3) * (rng.random() < 0.5)
    step = math.exp(-rng.uniform(*np.log(rate)))
    time = np.arange(begin, min(begin + rng.uniform(*span), end), step)
    place = np.column_stack([np.interp(time, FINE * np.arange(len(path)), path[:, k]) for k in (0, 1)])
    return time - begin, place + rng.normal(0, 10 ** rng.uniform(-5, -3), place.shape)


def fault_of(rig, time, place, settings):
    track = Track(time, place, np.full(len(time), np.nan))
    condition = Condition("c", Bead("b", 2 * RADIUS, 2e-4), "", settings, ((track,),), ("c/rep01.csv",))
    try:
        check_axes(TrackedLab("", rig, G, Camera(240.0, 2e-4), {}, (condition,), Path("lab")))
    except BadInput as error:
        return str(error)
    return ""


def assert_reported(rig, seen):
    """No motion is refused, and most faulty copies with enough rows are."""
    assert [said for time, place, one in seen if (said := fault_of(rig, time, place, one))] == []
    sharp = [one for one in seen if len(one[0]) > 40]
    for fault, turn in FAULTS.items():
        found = [fault in fault_of(rig, time, turn(place), one) for time, place, one in sharp]
        assert np.mean(found) > 0.6, fault


def test_no_drawn_drop_is_refused_and_most_faulty_copies_are():
    rng = np.random.default_rng(11)
    assert_reported("drop", [(*filmed(rng, path), {}) for path in drawn_drops(rng, DRAWN).swapaxes(0, 1)])


def test_no_drawn_pendulum_is_refused_and_most_faulty_copies_are():
    rng = np.random.default_rng(12)
    paths, lengths, releases = drawn_pendulums(rng, DRAWN)
    settings = [
        {"length_m": one, "release_angle_deg": abs(math.degrees(angle))}
        for one, angle in zip(lengths, releases, strict=True)
    ]
    seen = [(*filmed(rng, path), one) for path, one in zip(paths.swapaxes(0, 1), settings, strict=True)]
    assert_reported("pendulum", seen)


@pytest.mark.parametrize(
    ("height", "lively", "rate", "seconds"),
    [
        (0.10, 0.85, 30, 0.8), (0.10, 0.85, 30, 1.0), (0.10, 0.90, 30, 0.8), (0.10, 0.95, 30, 0.8),
        (0.05, 0.95, 30, 0.8), (0.05, 0.90, 60, 0.8), (0.02, 0.95, 60, 0.5),
    ],
)  # fmt: skip
def test_a_fast_bead_at_a_low_frame_rate_is_not_refused(height, lively, rate, seconds):
    time = np.arange(0, seconds, 1 / rate)
    place, at, speed = [], 0.0, 0.0
    first = math.sqrt(2 * height / G)
    for t in time:
        if t < first:
            place.append(height - G * t * t / 2)
            continue
        at, speed = first, lively * G * first
        while t > at + 2 * speed / G:
            at, speed = at + 2 * speed / G, lively * speed
        place.append(speed * (t - at) - G * (t - at) ** 2 / 2)
    assert fault_of("drop", time, np.column_stack([0 * time, RADIUS + np.array(place)]), {}) == ""


@pytest.mark.parametrize(
    ("name", "key"),
    [("pendulum", "length_m"), ("slide", "start_angle_deg"), ("roll", "incline_angle_deg")],
)
def test_a_setting_that_is_a_text_is_bad_input(name, key):
    _, _, settings = LABS[name]
    with pytest.raises(BadInput) as error:
        check_axes(lab_of(name, lambda place: place, {**settings, key: "0.25 m"}))
    assert f"condition c: {key}: is missing or not a number" in str(error.value)


def test_an_arm_that_tilted_long_before_its_first_row_is_not_refused():
    time, angle = TIME + 24, np.radians(40 + 0.5 * (TIME + 24))
    place = 0.25 * np.column_stack([np.cos(angle), np.sin(angle)])
    settings = {"start_angle_deg": 40.0, "tilt_rate_deg_s": 0.5}
    assert fault_of("slide", time, place, settings) == ""
    assert "exchanged" in fault_of("slide", time, place[:, ::-1], settings)


@pytest.mark.parametrize("rig", ["drop", "pendulum", "double", "slide", "roll"])
def test_too_few_rows_give_no_fault(rig):
    for rows in range(1, 6):
        assert fault_of(rig, TIME[:rows], np.zeros((rows, 2)), {"length_m": 0.25}) == ""
