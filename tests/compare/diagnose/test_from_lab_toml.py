"""A lab.toml in the diagnosis: tables of tilting plates drawn from the equations of motion, and rendered films."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from rigtwin.cli import app, run
from rigtwin.compare.diagnose.data.axis_checks import check_axes
from rigtwin.compare.diagnose.data.from_lab_toml import tracked_lab
from rigtwin.compare.measure_repetitions import Failure
from rigtwin.lab.errors import BadInput

G, RADIUS, NOISE, RATE = 9.81, 0.003, 1e-4, 120
ROLLING, STATIC = 0.02, 0.40
SAMPLES = Path(__file__).parents[3] / "sample_media"

HEAD = """
[materials.ash]
density = "570 kg/m^3"
youngs_modulus = "3 GPa"
poisson_ratio = 0.3
[materials.plate]
density = "7850 kg/m^3"
youngs_modulus = "200 GPa"
poisson_ratio = 0.28
[particles.bead]
material = "ash"
diameter = "6 mm"
mass = "0.071 g"
"""


def write_lab(folder, variant, draw, settings):
    """A lab.toml of one tilt for each setting, five repetitions each."""
    rng, text = np.random.default_rng(3), HEAD
    for name, setting in settings.items():
        files = []
        for number in range(5):
            time, angle, place = draw(rng, setting)
            place = place + rng.normal(0, NOISE, place.shape)
            rows = [
                f"{t:.5f},{x:.6f},{y:.6f},{a:.5f}" for t, (x, y), a in zip(time, place, np.degrees(angle), strict=True)
            ]
            files.append(f"{name}-{number}.csv")
            (folder / files[-1]).write_text("time_s,x_m,y_m,plate_angle_deg\n" + "\n".join(rows) + "\n")
        text += (
            f'[[experiments]]\nid = "{name}"\nrig = "tilt"\nvariant = "{variant}"\nparticle = "bead"\nwall = "plate"\n'
            f"repetitions = {files}\n"
        )
    (folder / "lab.toml").write_text(text)
    return folder


def rolling(rng, incline):
    """Down an incline at rest; the plate rises to the right, and its axis lies anywhere."""
    let_go, mu = rng.uniform(0.1, 0.2), ROLLING + rng.normal(0, 5e-4)
    time = np.arange(0, 0.8, 1 / RATE)
    gone = 5 / 14 * G * (math.sin(incline) - mu * math.cos(incline)) * np.maximum(time - let_go, 0) ** 2
    start = np.array([0.21, 0.05]) + rng.normal(0, 0.002, 2)
    return time, np.full(len(time), incline), start - gone[:, None] * [math.cos(incline), math.sin(incline)]


def sliding(rng, turn):
    """On an arm that turns at a rate [rad/s] until the body slips; every film begins at another angle."""
    first, static = math.radians(18) + rng.uniform(0, 0.02), STATIC + rng.normal(0, 0.004)
    seat = 0.15 + rng.normal(0, 0.01)

    def press(t, speed):
        return G * math.cos(first + turn * t) + 2 * speed * turn - RADIUS * turn**2

    def motion(t, s):
        return [s[1], s[0] * turn**2 - G * math.sin(first + turn * t) + static * press(t, s[1])]

    slip = 0.0
    for _ in range(60):
        slip = (math.asin((static * press(slip, 0.0) + seat * turn**2) / G) - first) / turn
    path = solve_ivp(motion, (slip, slip + 1), [seat, 0.0], rtol=1e-9, atol=1e-12, dense_output=True)
    time = np.arange(0, slip + 0.95, 1 / RATE)
    along = np.where(time > slip, path.sol(np.clip(time, slip, slip + 1))[0], seat)
    keep = along > seat - 0.1
    time, angle, along = time[keep], first + turn * time[keep], along[keep]
    cos, sin = np.cos(angle), np.sin(angle)
    return time, angle, np.column_stack([along * cos - RADIUS * sin, along * sin + RADIUS * cos])


def diagnosed(lab, out):
    result = CliRunner().invoke(app, ["diagnose", str(lab), "--out", str(out)])
    assert result.exit_code == 0, result.output
    return json.loads((out / "diagnosis.json").read_text())


def value(document, name):
    return next(one for one in document["calibration"] if one["name"] == name)


def test_rolls_down_an_incline_in_a_lab_toml_give_their_rolling_friction(tmp_path):
    lab = write_lab(tmp_path, "roll", rolling, {"flat": math.radians(5), "steep": math.radians(9)})
    document = diagnosed(lab, tmp_path / "out")
    assert document["rig"] == "roll"
    assert document["verdict"] == "none"
    friction = value(document, "rolling_friction.bead-plate")
    assert abs(friction["value"] - ROLLING) < 3 * friction["std"]


@pytest.mark.slow
def test_slides_that_begin_at_other_angles_and_places_give_their_static_friction(tmp_path):
    lab = write_lab(tmp_path, "slide", sliding, {"slow": math.radians(2), "fast": math.radians(4)})
    document = diagnosed(lab, tmp_path / "out")
    assert document["rig"] == "slide"
    assert document["verdict"] == "none"
    friction = value(document, "static_friction.bead-plate")
    assert abs(friction["value"] - STATIC) < 3 * friction["std"]
    assert document["strained"] == []


def test_a_lab_of_one_heap_is_refused_in_a_sentence(tmp_path, capsys):
    shutil.copytree(SAMPLES / "pile", tmp_path / "pile")
    text = (SAMPLES / "lab.toml").read_text()
    piles = '[[experiments]]\nid = "pile-D6-90mm"'
    (tmp_path / "lab.toml").write_text(text.partition("[[experiments]]")[0] + piles + text.partition(piles)[2])
    assert run(["diagnose", str(tmp_path)]) == 2
    assert "1 repetition in all; at least 3 are needed" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("variant", "draw", "setting", "says"),
    [
        ("roll", sliding, math.radians(4), "the plate turns by"),
        ("slide", rolling, math.radians(9), "the plate stands still"),
    ],
)
def test_a_motion_that_the_model_does_not_have_is_refused_in_a_sentence(tmp_path, capsys, variant, draw, setting, says):
    assert run(["diagnose", str(write_lab(tmp_path, variant, draw, {"one": setting}))]) == 2
    assert says in " ".join(capsys.readouterr().err.split())


def test_a_table_without_its_columns_is_refused_by_the_key_of_lab_toml(tmp_path):
    files = [f"odd{number}.csv" for number in range(5)]
    for number, file in enumerate(files):
        (tmp_path / file).write_text("foo,bar\n" + f"1,{number}\n" * 20)
    drop = '[[experiments]]\nid = "d"\nrig = "drop"\nparticle = "bead"\nwall = "plate"\n'
    (tmp_path / "lab.toml").write_text(f"{HEAD}{drop}repetitions = {files}\n")
    with pytest.raises(BadInput, match=r"name it with columns '.=NAME"):
        tracked_lab(tmp_path, [], tmp_path / "out")


def filmed(folder, films):
    """Five films in `folder`: copies with a free box of their own at the end, as copies of one film are refused."""
    names = [f"r{number}.mp4" for number in range(5)]
    for number, name in enumerate(names):
        (folder / name).write_bytes(films[number % len(films)].read_bytes() + b"\0\0\0\x09free" + bytes([number]))
    return names


@pytest.mark.slow
def test_films_of_two_beads_reach_the_diagnosis_with_the_origin_between_the_pivots(tmp_path):
    files = filmed(tmp_path, [SAMPLES / "pendulum" / "r01.mp4", SAMPLES / "pendulum" / "r02.mp4"])
    _, _, pendulums = (SAMPLES / "lab.toml").read_text().partition('[[experiments]]\nid = "pendulum-D12"')
    camera = next(line for line in pendulums.splitlines() if line.startswith("known_length"))
    (tmp_path / "lab.toml").write_text(
        HEAD.replace('"6 mm"', '"12.2 mm"')
        + '[[experiments]]\nid = "two"\nrig = "pendulum"\nvariant = "double"\nparticle = "bead"\nlength = "190 mm"\n'
        f'repetitions = {files}\n[experiments.camera]\nframe_rate = "240 Hz"\n{camera}\n'
    )
    lab = tracked_lab(tmp_path, [], tmp_path / "out")
    check_axes(lab)
    assert lab.rig == "double"
    for released, waiting in lab.conditions[0].repetitions:
        # on a circle of 190 mm about pivots a diameter apart, to 1 % of the scale
        assert np.hypot(released.position[:, 0] + 6.1e-3, released.position[:, 1]) == pytest.approx(0.19, rel=0.01)
        assert waiting.position[:20].mean(axis=0) == pytest.approx([6.1e-3, -0.19], abs=2e-3)


@pytest.mark.slow
def test_films_of_a_slide_reach_the_diagnosis_in_its_axes(tmp_path):
    """The film shows a slip at 20.4 degrees, 0.9 s after its begin, on a plate that turns by 2 degrees a second."""
    truth = json.loads((SAMPLES / "seven_rigs" / "truth.json").read_text())["tilt"]
    names = filmed(tmp_path, [SAMPLES / "seven_rigs" / "tilt.mp4"])
    (tmp_path / "lab.toml").write_text(
        f'{HEAD}[[experiments]]\nid = "tilt"\nrig = "tilt"\nvariant = "slide"\nparticle = "bead"\nwall = "plate"\n'
        f'repetitions = {names}\n[experiments.camera]\nframe_rate = "100 Hz"\nscale = "0.5 mm/px"\n'
    )
    (condition,) = tracked_lab(tmp_path, [], tmp_path / "out").conditions
    assert condition.settings["tilt_rate_deg_s"] == pytest.approx(truth["plate_speed_deg_s"], rel=0.02)
    begin = truth["onset_angle_deg"] - truth["onset_time_s"] * truth["plate_speed_deg_s"]
    assert condition.settings["start_angle_deg"] == pytest.approx(begin, abs=0.1)
    (track,) = condition.repetitions[0]
    rest = track.time < truth["onset_time_s"] - 0.05
    reach = np.hypot(*track.position.T)
    assert np.ptp(reach[rest]) < 0.5e-3  # a pixel
    assert reach[-1] < reach[0] - 0.01


def test_a_film_that_cannot_be_measured_is_left_out_with_its_reason_and_the_tables_remain(tmp_path):
    time = np.arange(30) / 240
    height = np.maximum(3e-3 + 0.06 - 4.905 * time**2, 3e-3)
    for number in range(5):
        rows = np.column_stack([time, 0 * time + 1e-5 * number, height])
        np.savetxt(tmp_path / f"r{number}.csv", rows, fmt="%.6f", delimiter=",", header="time_s,x_m,y_m", comments="")
    (tmp_path / "r5.mp4").write_bytes(b"no film")
    files = [*(f"r{number}.csv" for number in range(5)), "r5.mp4"]
    drop = '[[experiments]]\nid = "d"\nrig = "drop"\nparticle = "bead"\nwall = "plate"\n'
    (tmp_path / "lab.toml").write_text(f"{HEAD}{drop}repetitions = {files}\n")
    lab = tracked_lab(tmp_path, [], tmp_path / "out")
    assert lab.repetitions == 5
    assert any(one.startswith("d: r5.mp4 was left out: ") for one in lab.overlooked)
    (tmp_path / "lab.toml").write_text(f"{HEAD}{drop}repetitions = {files[1:]}\n")
    with pytest.raises(BadInput, match=r"4 repetitions in all, 1 more could not be measured"):
        tracked_lab(tmp_path, [], tmp_path / "out")


def test_a_file_that_fails_in_one_experiment_stays_in_another_where_it_was_measured(tmp_path, monkeypatch):
    from rigtwin.compare.diagnose.data import from_lab_toml

    flat = write_lab(tmp_path, "roll", rolling, {"one": math.radians(4), "two": math.radians(4)})
    text = (flat / "lab.toml").read_text()
    (flat / "lab.toml").write_text(text.replace("two-0.csv", "one-0.csv"))
    honest = from_lab_toml._measured

    def failing(*asked):
        found, failed = honest(*asked)
        (key,) = [key for key in found if key[0] == "one" and key[1].name == "one-0.csv"]
        del found[key]
        return found, [*failed, ("one", Failure(key[1], "it is blurred"))]

    monkeypatch.setattr(from_lab_toml, "_measured", failing)
    one, two = tracked_lab(flat, [], tmp_path / "out").conditions
    assert (len(one.repetitions), len(two.repetitions)) == (4, 5)
