"""One lab with all seven rigs of one material: what is drawn is found, and every rig stands beside its twin."""

import json
from pathlib import Path

import pytest

from rigtwin.compare.compare_lab import compare
from rigtwin.compare.measure_repetitions import known, measure_repetition
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.rigs import RIGS

LAB = Path(__file__).resolve().parents[2] / "sample_media" / "seven_rigs"
TRUTH = json.loads((LAB / "truth.json").read_text(encoding="utf-8"))


def measured(rig: str, out: Path) -> Measurement:
    (experiment,) = (one for one in read_lab(LAB, allow_outside=True).experiments if one.id == rig)
    found = measure_repetition(experiment, experiment.repetitions[0], out)
    assert isinstance(found, Measurement)
    return found


def holds(found: Measurement, name: str, truth: float, method: str = "") -> bool:
    one = next(one for one in found.quantities if one.quantity == name and one.method.startswith(method))
    low, high = one.interval95
    return low < truth < high


def test_the_lab_holds_every_rig_once():
    assert sorted(one.rig_name for one in read_lab(LAB, allow_outside=True).experiments) == sorted(RIGS)


def test_a_filling_that_was_counted_is_as_heavy_as_its_beads():
    stated = {one.id: known(one) for one in read_lab(LAB, allow_outside=True).experiments}
    assert stated["packing"]["total_mass"] == pytest.approx(530 * 0.071e-3)
    assert stated["hopper"]["total_mass"] == pytest.approx(400 * 0.071e-3)


def test_the_drawn_bed_is_as_high_as_it_was_drawn(tmp_path):
    found = measured("packing", tmp_path)
    assert holds(found, "bed_height", TRUTH["packing"]["mean_outline_mm"] * 1e-3, "outline")


@pytest.mark.slow
def test_the_turning_plate_does_not_pull_a_scene_of_few_edges_along(tmp_path):
    plate = measured("tilt", tmp_path)
    assert holds(plate, "static_friction_angle", TRUTH["tilt"]["onset_angle_deg"])
    assert holds(plate, "onset_time", TRUTH["tilt"]["onset_time_s"])
    shake = next(check for check in plate.checks if check.check == "static_camera")
    assert shake.value < 0.05  # [px]; the drawn camera stands still


@pytest.mark.slow
def test_drum_and_hopper_are_measured_as_drawn(tmp_path):
    assert holds(measured("drum", tmp_path), "angle_of_repose_graphical", TRUTH["drum"]["surface_angle_deg"])
    hopper = measured("hopper", tmp_path)
    assert holds(hopper, "opening_time", TRUTH["hopper"]["opening_time_s"])
    assert holds(hopper, "discharge_time", TRUTH["hopper"]["discharge_time_s"])


@pytest.mark.slow
def test_the_whole_lab_stands_beside_its_twins(tmp_path):
    compared = compare(LAB, tmp_path, allow_outside=True, threads=1, workers=1)
    document = json.loads((tmp_path / "deviations.json").read_text(encoding="utf-8"))
    assert {row["experiment"] for row in document["deviations"]} == set(RIGS)
    assert {row["experiment"] for row in document["shapes"]} == set(RIGS)
    assert all(row["distance_rms"] > 0 for row in document["shapes"])
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("with the twin laid over it") == len(RIGS)
    assert all(outcome.twins[0].evaluation.quantities for outcome in compared.outcomes)
