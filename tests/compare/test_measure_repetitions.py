"""Repetitions of a lab are measured as its file states."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigtwin.compare.measure_repetitions import Failure, Measured, measure_repetition
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.records import Track, write_tracks

LAB = """\
[[experiments]]
id = "drop"
rig = "drop"
particle = "D6"
wall = "steel"
repetitions = ["ball.csv"]
{}
"""
COLUMNS = 'columns = "t=Uhr[ms],y=Ort[m],id=Spur"'


def drop(folder, *lines):
    """The experiment of a lab whose one drop is a table of unknown columns, its track broken in two."""
    rows, impact, restitution = ["Uhr;Ort;Spur"], math.sqrt(2 * 0.3 / 9.81), 0.7
    for k in range(150):
        time = k / 240
        since = time - impact
        height = 0.3 - 9.81 * time**2 / 2 if since < 0 else restitution * 9.81 * impact * since - 9.81 * since**2 / 2
        rows.append(f"{1e3 * time:.4f};{height:.6f};{'late' if k > 75 else 'early'}")
    (folder / "ball.csv").write_text("\n".join(rows))
    (folder / "lab.toml").write_text(LAB.format("\n".join(lines)))
    (experiment,) = read_lab(folder).experiments
    return experiment


def test_columns_of_a_table_and_its_broken_track_are_stated_in_the_lab(tmp_path):
    experiment = drop(tmp_path, COLUMNS, 'join = ["early,late"]')
    found = measure_repetition(experiment, experiment.repetitions[0], None)
    assert found.value("restitution_wall", method="velocity", bounce=1) == pytest.approx(0.7, abs=0.003)
    assert found.table["points"] == 150


@pytest.mark.parametrize(("stated", "named"), [(300.0, False), (300 / 1.04, False), (300 / 1.06, True), (450.0, True)])
def test_a_stated_drop_height_that_the_record_contradicts_is_named_with_both(stated, named, tmp_path):
    experiment = drop(tmp_path, COLUMNS, 'join = ["early,late"]', f'drop_height = "{stated} mm"')
    found = measure_repetition(experiment, experiment.repetitions[0], None)
    said = " ".join(Measured(experiment, (found,), ()).warnings)
    assert ("ball.csv shows drop_height = 299.96 mm" in said) == named
    assert (f"{stated:.5g} mm is stated" in said) == named


def test_a_mass_is_questioned_where_the_lab_states_it_and_not_where_the_reference_does(tmp_path):
    (tmp_path / "ball.csv").touch()
    lab = LAB.format("").replace("D6", "D6_ABS")
    stated = '[particles.D6_ABS]\nmaterial = "ABS"\ndiameter = "6 mm"\nmass = "0.2 g"\n'
    for text, questioned in ((lab, False), (stated + lab, True)):
        (tmp_path / "lab.toml").write_text(text)
        (experiment,) = read_lab(tmp_path).experiments
        assert experiment.particle.mass == pytest.approx(2e-4, rel=0.01)
        said = " ".join(Measured(experiment, (), ()).warnings)
        assert ("D6_ABS weighs 0.2 g, which is 1768 kg/m^3, and ABS has 1050" in said) == questioned


def swing(folder, release):
    """The experiment of a lab whose one pendulum, let go at 48 degrees, bounces back from a wall below its hinge."""
    length, frames, start = 0.19, np.arange(180) / 240, (-math.radians(48), 0.0)

    def path(start, **more):
        def pull(_, state):
            return state[1], -9.81 / length * math.sin(state[0])

        return solve_ivp(pull, (0.0, 1.0), start, rtol=1e-9, atol=1e-9, dense_output=True, **more)

    fall = path(start, events=lambda _, state: state[0])
    released, lasts = 0.05, fall.t_events[0][0]
    back = path((0.0, -0.7 * fall.sol(lasts)[1]))
    since = frames - released
    angle = np.where(since < lasts, fall.sol(np.maximum(since, 0))[0], back.sol(np.maximum(since - lasts, 0))[0])
    position = length * np.column_stack([np.sin(angle), -np.cos(angle)])
    position += np.random.default_rng(2).normal(0, 5e-5, position.shape)
    write_tracks(folder / "ball.csv", [Track(frames, position, np.full(len(frames), 5e-5), "A")])
    rig = f'rig = "pendulum"\nvariant = "wall"\nlength = "190 mm"\nrelease_angle = "{release} deg"'
    (folder / "lab.toml").write_text(LAB.format("").replace('rig = "drop"', rig))
    (experiment,) = read_lab(folder).experiments
    return experiment


@pytest.mark.parametrize(("stated", "named"), [(48.0, False), (48 / 1.04, False), (48 / 1.06, True), (60.0, True)])
def test_a_stated_release_angle_that_the_record_contradicts_is_named_with_both(stated, named, tmp_path):
    experiment = swing(tmp_path, stated)
    found = measure_repetition(experiment, experiment.repetitions[0], None)
    said = " ".join(Measured(experiment, (found,), ()).warnings)
    assert ("ball.csv shows release_angle = 48" in said) == named
    assert (f"{stated:.5g}° is stated" in said) == named


def test_a_column_that_is_stated_and_not_there_is_named(tmp_path):
    experiment = drop(tmp_path, COLUMNS.replace("Ort", "Hoehe"))
    found = measure_repetition(experiment, experiment.repetitions[0], None)
    assert isinstance(found, Failure)
    assert "no column 'Hoehe' for y" in found.message


MEDIA = Path(__file__).parents[2] / "sample_media"
HEAP = """\
[[experiments]]
id = "heap"
rig = "pile"
variant = "piling"
particle = "D6"
wall = "steel"
base_diameter = "90 mm"
repetitions = [["view1.jpg", "view2.jpg"]]

[experiments.files."view2.jpg"]
base = "195,480,810,512"
"""


def test_what_is_stated_of_one_photo_is_used_for_that_photo_alone_and_shown_where_it_was_found(tmp_path):
    for name in ("view1.jpg", "view2.jpg"):
        shutil.copy(MEDIA / "pile" / name, tmp_path)
    (tmp_path / "lab.toml").write_text(HEAP)
    (experiment,) = read_lab(tmp_path).experiments
    found = measure_repetition(experiment, experiment.repetitions[0], None)
    found_base, stated_base = (mark for mark in found.marks if mark.kind == "base")
    assert (found_base.view, stated_base.view) == (0, 1)
    # the disc of the first photo, and the line as it is stated of the second one
    assert np.array(found_base.points) == pytest.approx(np.array([[181, 433], [790, 439]]), abs=3)
    (left, high), (right, low) = stated_base.points
    assert math.degrees(math.atan2(low - high, right - left)) == pytest.approx(
        math.degrees(math.atan(32 / 615)), abs=0.1
    )
    doubted = {each.detail["view"] for each in found.quantities if "end of the stated base" in each.doubtful}
    assert doubted == {"view2"}
