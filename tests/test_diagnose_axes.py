"""Diagnosis: faults of a track's columns are told before anything is fitted."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigtwin.compare.diagnose.axes import check_axes
from rigtwin.compare.diagnose.labs import Bead, Camera, Condition, TrackedLab
from rigtwin.compare.diagnose.sift import sifted
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track, read_tracks

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
    "slide": ("slide", sliding(), {"start_angle_deg": 20.0}),
    "roll": ("roll", rolling(), {"incline_angle_deg": math.degrees(0.15)}),
}


def lab_of(name, turn):
    rig, place, settings = LABS[name]
    noise = np.random.default_rng(3).normal(0, 2e-4, place.shape)
    track = Track(TIME, turn(place + noise), np.full(len(TIME), np.nan))
    condition = Condition("c", Bead("b", 2 * RADIUS, 2e-4), "", settings, ((track,),) * 5, ("c/rep01.csv",))
    return TrackedLab("", rig, G, Camera(240.0, 2e-4), {}, (condition,), Path("lab"))


@pytest.mark.parametrize("name", LABS)
def test_the_columns_of_a_track_are_told_where_they_are_exchanged_or_upside_down(name):
    check_axes(lab_of(name, lambda place: place))
    with pytest.raises(BadInput, match=r"c/rep01.csv: .* x_m and y_m look exchanged"):
        check_axes(lab_of(name, lambda place: place[:, ::-1]))
    with pytest.raises(BadInput, match=r"c/rep01.csv: .* y_m looks as if it counted downwards"):
        check_axes(lab_of(name, lambda place: place * [1, -1]))


def test_a_pendulum_whose_origin_is_where_it_hangs_is_refused():
    with pytest.raises(BadInput, match="put the origin at the pivot"):
        check_axes(lab_of("pendulum", lambda place: place + np.array([0, 0.25])))


def test_rows_without_a_position_are_told_by_file(tmp_path):
    rows = [f"{t:.5f},{x:.6f},{y:.6f}" for t, (x, y) in zip(TIME, bouncing(), strict=True)]
    rows[40:43] = [f"{t:.5f},nan,nan" for t in TIME[40:43]]
    (tmp_path / "rep01.csv").write_text("time_s,x_m,y_m\n" + "\n".join(rows) + "\n")
    lab = lab_of("drop", lambda place: place)
    whole = lab.conditions[0].repetitions
    gappy = replace(lab.conditions[0], repetitions=(read_tracks(tmp_path / "rep01.csv"), *whole[1:]))
    assert "rows without a position left out: 3 of 240 in c/rep01.csv" in sifted(replace(lab, conditions=(gappy,)))[1]
    assert not any("without a position" in one for one in sifted(lab)[1])
