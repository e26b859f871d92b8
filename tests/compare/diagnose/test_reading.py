"""Diagnosis: accepted variants of a lab.json, and errors that are found before the fit."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigtwin.compare.diagnose.data.axis_checks import check_axes
from rigtwin.compare.diagnose.data.read_lab_json import read_tracked_lab
from rigtwin.compare.diagnose.diagnosis import bench_of, diagnose
from rigtwin.compare.diagnose.fitting.fit import fit
from rigtwin.compare.diagnose.models.double_pendulum import DoubleBench
from rigtwin.compare.diagnose.models.drop import DropBench
from rigtwin.compare.diagnose.models.pendulum import PendulumBench
from rigtwin.lab.errors import BadInput, BadLabFile

G, RADIUS, LENGTH, NOISE = 9.81, 0.006, 0.25, 1e-4
CAMERA = {"frame_rate_hz": 240, "tracking_noise_m": NOISE}
BEADS = {"heavy": {"diameter_m": 2 * RADIUS, "mass_g": 0.7}}


def swing(angle: float, rate: float, time):
    """Angles of a pendulum at these times, by SciPy."""
    run = solve_ivp(
        lambda _t, s: [s[1], -G / LENGTH * math.sin(s[0])],
        (0, float(np.max(time, initial=0.0)) + 1e-6), [angle, rate], rtol=1e-9, atol=1e-11, dense_output=True,
    )  # fmt: skip
    return run.sol(time)[0]


def write_lab(folder: Path, rig: str, settings, tracks, **more) -> Path:
    """One condition; each track holds the time [s] and, for each bead of the repetition, its places [m]."""
    (folder / "c").mkdir(parents=True)
    for number, (time, *places) in enumerate(tracks, start=1):
        names = "AB" if len(places) > 1 else [""]
        rows = [
            f"{t:.6f},{name}{',' if name else ''}{place[k, 0]:.6f},{place[k, 1]:.6f}"
            for k, t in enumerate(time)
            for name, place in zip(names, places, strict=True)
        ]
        header = "time_s,particle,x_m,y_m" if len(places) > 1 else "time_s,x_m,y_m"
        (folder / "c" / f"rep{number:02d}.csv").write_text("\n".join([header, *rows]))
    condition = {"name": "c", "bead": "heavy", "repetitions": len(tracks)} | settings
    change(folder, {"rig": rig, "camera": CAMERA, "particles": BEADS, "conditions": [condition]} | more, new=True)
    return folder


def change(folder: Path, entries, *, new=False) -> Path:
    """Change some entries of the lab.json."""
    file = folder / "lab.json"
    file.write_text(json.dumps(({} if new else json.loads(file.read_text())) | entries))
    return folder


def condition(folder: Path, **entries) -> Path:
    return change(folder, {"conditions": [json.loads((folder / "lab.json").read_text())["conditions"][0] | entries]})


@pytest.fixture
def doubles(tmp_path):
    """Five repetitions of two beads, A released on the left, filmed until shortly after the first contact."""
    rng = np.random.default_rng(7)
    time, begin, e = np.arange(0, 0.5, 1 / 240), 0.04, 0.6
    quarter = solve_ivp(
        lambda _t, s: [s[1], -G / LENGTH * math.sin(s[0])], (0, 1), [-math.radians(40), 0],
        events=lambda _t, s: s[0], rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    meet, rate = float(quarter.t_events[0][0]), float(quarter.y_events[0][0][1])
    since = np.maximum(time - begin, 0.0)
    after = since > meet
    tracks = []
    for _ in range(5):
        a, b = swing(-math.radians(40), 0.0, since), np.zeros(len(time))
        a[after] = swing(0.0, rate * (1 - e) / 2, since[after] - meet)
        b[after] = swing(0.0, rate * (1 + e) / 2, since[after] - meet)
        places = [
            np.column_stack([side * RADIUS + LENGTH * np.sin(angle), -LENGTH * np.cos(angle)])
            + rng.normal(0, NOISE, (len(time), 2))
            for side, angle in ((-1, a), (1, b))
        ]
        tracks.append((time, *places))
    return write_lab(tmp_path / "double", "double", {"length_m": LENGTH, "release_angle_deg": 40}, tracks)


@pytest.fixture
def drops(tmp_path):
    """Five drops from 0.2 m that bounce twice; restitution 0.6 within one hundredth."""
    rng = np.random.default_rng(8)
    tracks = []
    for _ in range(5):
        time, height, moment = np.arange(0, 0.6, 1 / 240), 0.2 + RADIUS, 0.03
        y, speed, start = np.full(len(time), height), 0.0, height
        for _ in range(3):
            fall = (speed + math.sqrt(speed**2 + 2 * G * (start - RADIUS))) / G
            s = time - moment
            y = np.where(s >= 0, start + speed * s - G * s * s / 2, y)
            moment, speed, start = moment + fall, (G * fall - speed) * rng.normal(0.6, 0.01), RADIUS
        place = np.column_stack([np.zeros(len(time)), y]) + rng.normal(0, NOISE, (len(time), 2))
        tracks.append((time[time < moment - 0.01], place[time < moment - 0.01]))
    return write_lab(tmp_path / "drop", "drop", {"wall": "glass", "drop_height_m": 0.2}, tracks)


@pytest.fixture
def pendulums(tmp_path):
    """Five free pendulums, released at 25 degrees."""
    rng = np.random.default_rng(9)
    time = np.arange(0, 2, 1 / 120)
    angle = swing(math.radians(25), 0.0, np.maximum(time - 0.03, 0.0))
    place = LENGTH * np.column_stack([np.sin(angle), -np.cos(angle)])
    tracks = [(time, place + rng.normal(0, NOISE, place.shape)) for _ in range(5)]
    return write_lab(tmp_path / "pendulum", "pendulum", {"length_m": LENGTH, "release_angle_deg": 25}, tracks)


def rewrite(path: Path, change_rows) -> None:
    header, *rows = path.read_text().split("\n")
    path.write_text("\n".join([header, *change_rows(rows)]))


def later(rows, by: float):
    """Rows on a clock that started so much [s] earlier."""
    return [f"{float(row.split(',', 1)[0]) + by:.6f},{row.split(',', 1)[1]}" for row in rows]


def test_the_released_bead_is_found_from_its_start_and_not_from_the_order_of_rows(doubles):
    rewrite(doubles / "c" / "rep02.csv", lambda rows: rows[1:])  # A was not seen in the first frame
    rewrite(doubles / "c" / "rep03.csv", lambda rows: sorted(rows, key=lambda row: row.split(",")[1], reverse=True))
    lab = read_tracked_lab(doubles)
    assert {tuple(track.body for track in pair) for pair in lab.conditions[0].repetitions} == {("A", "B")}
    found = fit(bench_of(lab), rounds=3)
    assert found.per_row == pytest.approx(1, abs=0.1)
    assert found.value("restitution.heavy-heavy") == pytest.approx(0.6, abs=0.02)


def test_beads_with_different_names_in_other_repetitions_are_refused(doubles):
    rewrite(doubles / "c" / "rep03.csv", lambda rows: [row.replace(",B,", ",C,") for row in rows])
    with pytest.raises(BadLabFile, match=r"rep03\.csv: the beads are named A and C, and A and B in c/rep01\.csv"):
        read_tracked_lab(doubles)


def test_two_pendulums_with_unequal_beads_or_released_on_the_right_are_refused(doubles):
    lab = read_tracked_lab(doubles)
    check_axes(lab)
    for number in range(1, 6):
        rewrite(
            doubles / "c" / f"rep{number:02d}.csv",
            lambda rows: [f"{t},{b},{-float(x)},{y}" for t, b, x, y in (row.split(",") for row in rows)],
        )
    with pytest.raises(BadInput, match=r"rep01\.csv: A, the released bead, starts on the right"):
        check_axes(read_tracked_lab(doubles))
    condition(change(doubles, {"particles": BEADS | {"light": BEADS["heavy"]}}), bead_B="light")
    with pytest.raises(BadLabFile, match="condition c: names two kinds of beads, heavy and light"):
        read_tracked_lab(doubles)


@pytest.mark.parametrize("key", ["surface_turned", "run_reversed"])
@pytest.mark.parametrize("value", ["no", 3, [True]])
def test_how_a_surface_lies_and_a_bead_runs_is_stated_by_true_or_false(key, value, tmp_path):
    one = {"name": "c", "bead": "heavy", "wall": "glass", "repetitions": 3, "incline_angle_deg": 5.0, key: value}
    document = {"rig": "roll", "camera": CAMERA, "particles": BEADS, "conditions": [one]}
    (tmp_path / "lab.json").write_text(json.dumps(document))
    with pytest.raises(BadLabFile, match=f"condition c: {key}: .* is not true or false"):
        read_tracked_lab(tmp_path)


@pytest.mark.parametrize("rig", ["doubles", "pendulums", "drops"])
@pytest.mark.parametrize("by", [100.0, -3.0])
def test_the_start_of_the_clock_changes_nothing(rig, by, request):
    folder = request.getfixturevalue(rig)
    plain = fit(bench_of(read_tracked_lab(folder)), rounds=3)
    for path in (folder / "c").glob("rep*.csv"):
        rewrite(path, lambda rows: later(rows, by))
    shifted = fit(bench_of(read_tracked_lab(folder)), rounds=3)
    assert shifted.deviance == pytest.approx(plain.deviance, rel=1e-3)
    assert shifted.per_row == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize(
    "name", ["drop_height_uncertainty_m", "release_sideways_speed_m_s", "plate_level_uncertainty_deg"]
)
def test_a_stated_uncertainty_of_zero_is_a_quantity_known_very_well(drops, name):
    plain = fit(bench_of(read_tracked_lab(drops)), rounds=3)
    exact = fit(bench_of(read_tracked_lab(change(drops, {"rig_geometry": {name: 0}}))), rounds=3)
    assert exact.converged
    assert exact.deviance == pytest.approx(plain.deviance, rel=0.05)  # the drops are as they are stated


@pytest.mark.parametrize("name", ["length_uncertainty_m", "release_angle_uncertainty_deg"])
@pytest.mark.parametrize("rig", ["doubles", "pendulums"])
def test_a_thread_or_an_angle_known_exactly_can_be_fitted(rig, name, request):
    folder = change(request.getfixturevalue(rig), {"rig_geometry": {name: 0, "pivot_spacing_uncertainty_m": 0}})
    found = fit(bench_of(read_tracked_lab(folder)), rounds=3)
    assert found.converged
    assert found.per_row == pytest.approx(1, abs=0.2)


def test_a_bead_whose_diameter_is_known_exactly_keeps_it(doubles):
    change(doubles, {"particles": {"heavy": BEADS["heavy"] | {"diameter_uncertainty_m": 0}}})
    unknowns = bench_of(read_tracked_lab(doubles)).unknowns(())
    sd = next(one.sd for one in unknowns if one.name == "diameter.heavy")
    assert 0 < sd < 1e-7


def test_a_baseline_without_a_finite_misfit_is_refused(drops, monkeypatch):
    lost = replace(fit(bench_of(read_tracked_lab(drops)), rounds=1), deviance=math.nan)
    monkeypatch.setattr("rigtwin.compare.diagnose.diagnosis.fit", lambda *_args, **_more: lost)
    with pytest.raises(BadInput, match=r"cannot be fitted to these tracks.*the misfit of the baseline is not finite"):
        diagnose(read_tracked_lab(drops))


@pytest.mark.parametrize(
    ("header", "advice"),
    [
        ("foo,bar,baz", r"name it with the first line of the file, such as time_s,x_m,y_m\.$"),
        ("frame,x_m,y_m", r"there is no column for time; give a column time_s\.$"),
        ("time_kg,x_m,y_m", r"state it with the first line of the file, such as time_s,x_m,y_m\.$"),
    ],
)
def test_a_table_without_its_columns_is_refused_with_what_to_write_into_it(drops, header, advice):
    table = drops / "c" / "rep01.csv"
    table.write_text("\n".join([header, *table.read_text().split("\n")[1:]]))
    with pytest.raises(BadInput, match=advice):
        read_tracked_lab(drops)


def test_null_means_not_measured(drops):
    change(drops, {
        "gravity_m_s2": None, "rig_geometry": None,
        "camera": CAMERA | {"tracking_noise_px": None, "scale_uncertainty_rel": None},
        "particles": {"heavy": {"diameter_m": 2 * RADIUS, "mass_g": None, "density_kg_m3": 1000}},
    })  # fmt: skip
    lab = read_tracked_lab(condition(drops, push_speed_m_s=None))
    assert lab.gravity == pytest.approx(9.81)
    assert lab.camera.noise == NOISE
    assert lab.conditions[0].bead.mass == pytest.approx(1000 * 4 / 3 * math.pi * RADIUS**3)
    with pytest.raises(BadLabFile, match="frame_rate_hz: is missing"):
        read_tracked_lab(change(drops, {"camera": {"frame_rate_hz": None}}))


@pytest.mark.parametrize("wall", [None, "", "none", "None"])
def test_four_notations_of_no_wall_give_a_free_pendulum(pendulums, wall):
    assert isinstance(bench_of(read_tracked_lab(condition(pendulums, wall=wall))), PendulumBench)


def test_a_pendulum_with_a_wall_beside_a_free_one_is_refused(pendulums):
    first = json.loads((pendulums / "lab.json").read_text())["conditions"][0]
    both = [first, first | {"name": "d", "files": "c/rep%02d.csv", "wall": "steel"}]
    with pytest.raises(BadLabFile, match="c swings freely and d hits a wall"):
        read_tracked_lab(change(pendulums, {"conditions": both}))
    assert isinstance(bench_of(read_tracked_lab(change(pendulums, {"conditions": both[1:]}))), DoubleBench)


@pytest.mark.parametrize(
    ("stated", "taken"),
    [(0.2, 0.2), ({"glass": 0.2}, 0.2), ({"glass": None}, 0.35), (None, 0.35), ({"steel": 0.2}, 0.35)],
)
def test_sliding_friction_is_one_number_or_one_for_each_wall(drops, stated, taken):
    bench = bench_of(read_tracked_lab(change(drops, {"rig_geometry": {"sliding_friction_pw": stated}})))
    assert isinstance(bench, DropBench)
    assert bench.friction == pytest.approx(taken)


def test_a_friction_or_an_uncertainty_that_is_a_text_is_refused_by_name(drops):
    for name in ("sliding_friction_pw", "drop_height_uncertainty_m"):
        with pytest.raises(BadLabFile, match=f"{name}: 'little' is not a number"):
            bench_of(read_tracked_lab(change(drops, {"rig_geometry": {name: "little"}})))


def test_a_rolling_bead_without_incline_or_push_is_refused(tmp_path):
    time = np.arange(0, 0.5, 1 / 240)
    place = np.column_stack([0.3 * time**2, np.full(len(time), RADIUS)])
    folder = write_lab(tmp_path / "roll", "roll", {"wall": "glass", "slope_deg": 6}, [(time, place)])
    with pytest.raises(BadLabFile, match="condition c: has neither incline_angle_deg nor push_speed_m_s"):
        read_tracked_lab(folder)
    assert read_tracked_lab(condition(folder, incline_angle_deg=6)).setting("incline_angle_deg") == [6]


def test_a_setting_common_to_all_conditions_may_be_stated_once(pendulums):
    first = json.loads((pendulums / "lab.json").read_text())["conditions"][0]
    length = first.pop("length_m")
    change(pendulums, {"conditions": [first], "rig_geometry": {"length_m": length}})
    assert set(read_tracked_lab(pendulums).setting("length_m")) == {length}
    change(pendulums, {"conditions": [first | {"length_m": 0.4}]})
    assert set(read_tracked_lab(pendulums).setting("length_m")) == {0.4}


def test_the_noise_of_unevenly_spaced_rows_must_be_stated(drops):
    gaps = np.array([1, 2, 5])  # frames to the next row: no three in a row are alike
    for path in (drops / "c").glob("rep*.csv"):
        rewrite(path, lambda rows: [rows[k] for k in np.cumsum(np.tile(gaps, 40)) if k < len(rows)])
    assert bench_of(read_tracked_lab(drops)).noise == NOISE
    change(drops, {"camera": {"frame_rate_hz": 240}})
    with pytest.raises(BadInput, match=r"evenly spaced.*state tracking_noise_m"):
        bench_of(read_tracked_lab(drops))


@pytest.mark.parametrize(
    ("key", "value"),
    [("length_m", -0.25), ("length_m", 0), ("length_m", "250mm"), ("release_angle_deg", 400)],
)
def test_an_impossible_setting_is_refused_by_its_name(pendulums, key, value):
    with pytest.raises(BadLabFile, match=f"{key}.*is impossible"):
        read_tracked_lab(condition(pendulums, **{key: value}))
