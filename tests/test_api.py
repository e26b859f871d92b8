"""The Python API: the same answers as the commands, tables, figures, and refusals in the API's own words."""

import inspect
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import pytest
import trimesh
import typer

import rigtwin
from rigtwin import api, cli
from rigtwin.lab.errors import BadInput, NothingToMeasure

SAMPLES = Path(__file__).parents[1] / "sample_media"
CLIP = SAMPLES / "drop" / "r01.mp4"


@pytest.fixture(scope="module")
def drop():
    return rigtwin.measure("drop", CLIP, frame_rate="240 Hz", bead_diameter="6.2 mm")


@pytest.fixture(scope="module")
def wrong():
    """The same film with half its frame rate."""
    return rigtwin.measure("drop", CLIP, frame_rate="120 Hz", bead_diameter="6.2 mm")


def test_measure_gives_what_the_command_gives(drop, tmp_path, capsys):
    said = ["measure", "drop", str(CLIP), "--frame-rate", "240Hz", "--bead-diameter", "6.2mm"]
    assert cli.run([*said, "--json", "--quiet", "--out", str(tmp_path)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [quantity.to_json() for quantity in drop.quantities] == document["quantities"]


def test_numbers_are_taken_in_si_and_with_out_the_files_stand_there(drop, tmp_path):
    plain = rigtwin.measure("drop", str(CLIP), out=tmp_path, frame_rate=240, bead_diameter=6.2e-3)
    assert plain.quantities == drop.quantities
    assert plain.files
    assert all(path.is_file() and path.parent == tmp_path for path in plain.files.values())


def test_value_and_table_hold_the_same_number(drop):
    frame = drop.to_frame()
    rows = frame[(frame["quantity"] == "restitution_wall") & (frame["method"] == "velocity") & (frame["bounce"] == 1)]
    assert list(rows["value"]) == [drop.value("restitution_wall", method="velocity", bounce=1)]


def test_a_value_that_several_quantities_have_is_refused_with_what_there_is(drop):
    with pytest.raises(BadInput, match=r"several quantities; there are restitution_wall \(height, bounce=1\)"):
        drop.value("restitution_wall")
    with pytest.raises(BadInput, match="is not among the quantities; there are"):
        drop.value("bed_height")
    with pytest.raises(BadInput, match=r"^drop_height: none has a side; there are drop_height \(height\)\.$"):
        drop.value("drop_height", side="middle")
    with pytest.raises(
        BadInput, match=r"none has bounce=9, but 1 or 2.*; there are restitution_wall \(height, bounce=1\)"
    ):
        drop.value("restitution_wall", bounce=9)
    with pytest.raises(BadInput, match="none has method='hight', but 'height' or 'velocity'"):
        drop.value("restitution_wall", "hight", bounce=1)


def test_a_plot_shows_the_track(drop):
    panel = drop.plot().axes[0]
    assert panel.get_ylabel() == "height y / mm"
    assert len(panel.lines[0].get_xdata()) == len(drop.tracks[0].time)


def test_without_out_no_files_are_named(drop):
    assert drop.files == {}


def test_without_out_a_refusal_leaves_no_picture_and_keeps_its_evidence(tmp_path, monkeypatch):
    photo = tmp_path / "noise.png"
    cv2.imwrite(str(photo), np.random.default_rng(1).integers(0, 255, (240, 320, 3), dtype=np.uint8))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NothingToMeasure) as refused:
        rigtwin.measure("pile", photo)
    assert refused.value.picture is None
    assert refused.value.seen.medium == photo
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["noise.png"]


def test_a_twin_has_values_and_a_table():
    twin = rigtwin.simulate("drop", particle="D6", wall="steel", drop_height="250 mm", restitution=0.6)
    assert twin.value("restitution_wall", method="velocity", bounce=1) == pytest.approx(0.6, abs=0.01)
    assert "restitution_wall" in set(twin.to_frame()["quantity"])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rigtwin.measure("drop", CLIP, bead_diametr="6 mm"), "did you mean 'bead_diameter'"),
        (lambda: rigtwin.measure("dropp", CLIP), "did you mean 'drop'"),
        (lambda: rigtwin.measure("drop", CLIP, CLIP), "takes one clip, and 2 are given"),
        (lambda: rigtwin.measure("drop", CLIP, bead_diameter="6"), "^bead_diameter: "),
        (lambda: rigtwin.measure("drop", CLIP, bead_diameter=6), "^bead_diameter: 6.0 is 6 m, no bead's diameter"),
        (lambda: rigtwin.measure("pile", CLIP, base_diameter=90.0), "^base_diameter: 90.0 is 90 m, no length"),
        (lambda: rigtwin.measure("drop", CLIP, bead_diameter=math.nan), "^bead_diameter: nan is not a finite number"),
        (lambda: rigtwin.simulate("pendulum", length=0.2, release_angle=45), "^release_angle: 45.0 is 2578 degrees"),
        (lambda: rigtwin.measure("drum", CLIP, averaged="no"), "^averaged: 'no' is neither True nor False"),
        (lambda: rigtwin.simulate("pile", base_diameter="90 mm", count=1.5), "^count: .*whole number"),
        (lambda: rigtwin.simulate("tilt", variant="slid"), "did you mean 'slide'"),
        (lambda: rigtwin.simulate("drop"), "^drop_height: is missing"),
        (lambda: rigtwin.simulate("drum", rolling_modl=1), "did you mean 'rolling_model'"),
        (lambda: rigtwin.measure("drop", CLIP, out=3), "^out: 3 is not the name of a file or folder"),
        (lambda: rigtwin.measure("drop", 3), "^media: 3 is not the name of a file"),
        (lambda: rigtwin.measure("drop", CLIP, plate=3), "^plate: '3' is not of the form"),
        (lambda: rigtwin.open_lab(3), "^folder: 3 is not the name of a file"),
        (lambda: rigtwin.open_lab(SAMPLES).compare(runs=0), "^runs: 0 is not a whole number from 1 to 10000"),
        (lambda: rigtwin.open_lab(SAMPLES).compare(workers="a"), "^workers: 'a' is not a whole number from 1 upwards"),
        (lambda: rigtwin.open_lab(SAMPLES).calibrate(workers=0), "^workers: 0 is not a whole number from 1 upwards"),
        (lambda: rigtwin.open_lab(SAMPLES).measure(workers="a"), "^workers: 'a' is not a whole number from 1 upwards"),
        (lambda: rigtwin.open_lab(SAMPLES).diagnose(workers=1.5), "^workers: 1.5 is not a whole number from 1 upw"),
        (lambda: rigtwin.open_lab(SAMPLES).compare(out=3), "^out: 3 is not the name of a file or folder"),
        (lambda: rigtwin.open_lab(SAMPLES).compare(cluster=3), "^cluster: 3 is not a text"),
        (lambda: rigtwin.open_lab(SAMPLES).compare(run=3), "there is no 'run'; did you mean 'runs'"),
        (lambda: rigtwin.open_lab(SAMPLES).compare(rolling_model="type A"), "^rolling_model: there is no 'type A'"),
        (lambda: rigtwin.open_lab(SAMPLES).compare(model=7), "^model: 7 is not the name of a file"),
        (lambda: rigtwin.open_lab(SAMPLES).compare(only=7), "^only: 7 is neither a text nor a list"),
        (lambda: rigtwin.open_lab(SAMPLES).diagnose(effects="own.py"), "did you mean 'effect'"),
        (lambda: rigtwin.open_lab(SAMPLES).diagnose(effect="own.py"), "^own.py: no such Python file"),
    ],
)
def test_refusals_name_the_keyword(call, words):
    with pytest.raises(BadInput, match=words):
        call()


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ({}, "a whole number."),
        ({"min": 2}, "a whole number from 2 upwards."),
        ({"max": 2_000_000}, "a whole number up to 2000000."),
        ({"min": 0, "max": 2_000_000}, "a whole number from 0 to 2000000."),
    ],
)
def test_a_number_that_is_not_whole_or_out_of_range_is_refused_with_the_range(ends, words):
    parameter = inspect.Parameter("n", inspect.Parameter.KEYWORD_ONLY, annotation=Annotated[int, typer.Option(**ends)])
    for value in [1.5, True, *([3_000_000] if "max" in ends else []), *([-1] if "min" in ends else [])]:
        with pytest.raises(BadInput, match=f"^n: {value} is not {words}$"):
            api._read("n", value, parameter)
    assert api._read("n", 2, parameter) == 2


def test_doubts_and_warnings_name_the_keyword(wrong):
    said = [*wrong.warnings, *(one.message for one in wrong.checks), *(one.doubtful for one in wrong.quantities)]
    assert any("leave out frame_rate." in sentence for sentence in said)
    assert not any("--" in sentence for sentence in said)


def test_a_measurement_shows_its_numbers_and_doubts_and_no_records(drop, wrong):
    assert repr(drop).startswith("<Measurement of a drop, r01.mp4")
    assert "restitution_wall (velocity, bounce=1) = 0.41" in repr(drop)
    assert "doubtful" not in repr(drop)
    assert "mm, doubtful\n" in repr(wrong)
    assert len(repr(drop)) < 2000
    assert len(repr(rigtwin.simulate("drop", particle="D6", wall="steel", drop_height=0.2))) < 2000


def test_a_lab_is_opened_with_its_experiments():
    assert [each.id for each in rigtwin.open_lab(SAMPLES).experiments] == [
        "drop-D6-steel",
        "pendulum-D12",
        "pile-D6-90mm",
    ]
    assert repr(rigtwin.open_lab(SAMPLES)) == f"<OpenLab {SAMPLES}: drop-D6-steel, pendulum-D12, pile-D6-90mm>"


def test_a_stated_place_may_be_a_tuple_of_numbers():
    photo = SAMPLES / "pile" / "view1.jpg"
    settings = {"base_diameter": "90 mm", "bead_diameter": "6.2 mm"}
    by_text, by_tuple = (
        rigtwin.measure("pile", photo, base=base, **settings) for base in ("177,440,793,440", (177, 440, 793, 440.0))
    )
    asked = ("angle_of_repose_geometric", "apex")
    assert by_tuple.value(*asked, side="mean") == by_text.value(*asked, side="mean")
    assert api._joined((320, 40)) == "320,40"
    assert [api._joined(each) for each in [(320, 40), "400,40"]] == ["320,40", "400,40"]
    assert api._joined((90, "mm")) == (90, "mm")


@pytest.mark.usefixtures("in_this_process")
def test_a_lab_is_compared_with_the_options_of_the_command(tmp_path):
    """Without effects the restitution of the twin is that of the contact."""
    (tmp_path / "model.toml").write_text("[contacts.D6-steel]\nrestitution = 0.7\n", encoding="utf-8")
    lab = rigtwin.open_lab(SAMPLES)
    found = lab.compare(only="drop-D6-steel", model=str(tmp_path / "model.toml"), out=tmp_path / "out")
    rows = found.to_frame()
    assert len(repr(found)) < 500
    assert found.headline in repr(found)
    first = rows[(rows["quantity"] == "restitution_wall") & (rows["bounce"] == 1)]
    assert set(rows["experiment"]) == {"drop-D6-steel"}
    assert list(first["simulated"]) == pytest.approx([0.7] * len(first), abs=0.01)


def test_tracked_repetitions_of_a_lab_json_are_diagnosed(tmp_path):
    """Five ideal drops: nothing is missing in the model of them."""
    rng = np.random.default_rng(3)
    time = np.arange(0, 0.5, 1 / 240)
    fall = math.sqrt(2 * 0.3 / 9.81)  # [s], from 0.3 m
    after = time - fall
    height = np.where(
        after < 0, 0.3 - 9.81 / 2 * time**2, np.maximum(0.6 * 9.81 * fall * after - 9.81 / 2 * after**2, 0)
    )
    for number in range(1, 6):
        x, y = 1e-4 * rng.standard_normal((2, len(time)))
        rows = np.column_stack([time, x, y + height + 3e-3])[height > 0]
        np.savetxt(tmp_path / f"rep{number:02d}.csv", rows, delimiter=",", header="time_s,x_m,y_m", comments="")
    condition = {"name": "c", "bead": "b", "wall": "w", "drop_height_m": 0.3, "repetitions": 5, "files": "rep%02d.csv"}
    stated = {
        "title": "t",
        "rig": "drop",
        "camera": {"frame_rate_hz": 240},
        "particles": {"b": {"diameter_m": 6e-3, "mass_g": 0.8}},
        "conditions": [condition],
    }
    (tmp_path / "lab.json").write_text(json.dumps(stated), encoding="utf-8")
    lab = rigtwin.open_lab(tmp_path)
    assert lab.experiments == ()
    found = lab.diagnose(out=tmp_path / "out")
    assert found.verdict == "none"
    assert repr(found) == f"<Diagnosis of 't': none: {found.reason}>"
    assert repr(lab) == f"<OpenLab {tmp_path}: tracked repetitions>"
    with pytest.raises(BadInput, match=r"lab\.toml: no such file"):
        lab.compare()


def test_a_particle_is_taken_from_a_lab_that_is_named_as_text():
    twin = rigtwin.simulate("drop", lab=str(SAMPLES), particle="D6", drop_height="250 mm", restitution=0.5)
    assert twin.value("restitution_wall", method="velocity", bounce=1) == pytest.approx(0.5, abs=0.01)


def test_importing_rigtwin_loads_nothing_heavy_and_calling_works_beside_the_package():
    code = (
        "import sys, conftest, rigtwin; heavy = {'numpy', 'cv2', 'taichi', 'pandas', 'typer'} & set(sys.modules)\n"
        "import rigtwin.measure.drop.evaluate; assert callable(rigtwin.measure)\n"
        "sys.exit(', '.join(heavy) or 0)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, check=True, timeout=60)


def test_a_rig_of_ones_own_is_simulated_from_its_stl_files(tmp_path):
    trimesh.creation.box((40, 40, 2)).export(tmp_path / "floor.stl")
    settings = {"stl": [tmp_path / "floor.stl"], "fill": "-15mm,-15mm,5mm..15mm,15mm,25mm", "count": 4}
    twin = rigtwin.simulate("custom", region="-20mm,-20mm,0mm..20mm,20mm,30mm", duration=0.1, **settings)
    assert twin.value("particles_inside") == 4
    (tmp_path / "lab.toml").write_text(
        '[rigs.floor]\nparticle = "D6"\nwall = "steel"\ncount = 4\nduration = "0.1 s"\n'
        'fill = { low = ["-15 mm", "-15 mm", "5 mm"], high = ["15 mm", "15 mm", "25 mm"] }\n'
        '[rigs.floor.walls.floor]\nstl = "floor.stl"\n'
    )
    assert rigtwin.simulate("custom", lab=tmp_path, name="floor", count=3).value("particles_inside") == 3
    with pytest.raises(BadInput, match=r"name: there is no rig 'flor' .* did you mean 'floor'"):
        rigtwin.simulate("custom", lab=tmp_path, name="flor")
