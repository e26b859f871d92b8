"""Repetitions are measured in the background: once for the same settings, and without waiting for outdated ones."""

import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from rigtwin.compare.measure_repetitions import Failure, measure_repetition
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.review.described import beside_json
from rigtwin.review.remeasure import Remeasuring

MEDIA = Path(__file__).parents[2] / "sample_media"
LAB = """
[[experiments]]
id = "bed"
rig = "packing"
particle = "D6"
wall = "PMMA"
cylinder_diameter = "50 mm"
repetitions = ["packing.jpg"]

[[experiments]]
id = "drop"
rig = "drop"
particle = "D6"
wall = "steel"
repetitions = ["r01.mp4"]
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    shutil.copy(MEDIA / "seven_rigs/packing.jpg", folder)
    shutil.copy(MEDIA / "drop/r01.mp4", folder)
    (folder / "lab.toml").write_text(LAB)
    return read_lab(folder)


@pytest.fixture(scope="module")
def measuring():
    made = Remeasuring()
    yield made
    made.close()


def with_floor(experiment, floor):
    return replace(experiment, camera=replace(experiment.camera, floor=floor))


def end_processes(measuring):
    for slot in measuring._slots:
        for process in slot._processes:
            os.kill(process.pid, signal.SIGKILL)
            process.join(60)


def test_the_same_settings_are_measured_once_and_as_the_command_line_does(lab, measuring):
    bed = lab.experiment("bed")
    key, first = measuring.measured(bed, bed.repetitions[0])
    found = first.result(60).found
    assert measuring.measured(bed, bed.repetitions[0]) == (key, first)
    assert found.quantities == measure_repetition(bed, bed.repetitions[0], None).quantities
    other, second = measuring.measured(with_floor(bed, 600.0), bed.repetitions[0])
    assert other != key
    assert second.result(60).found.quantities != found.quantities


def test_a_file_that_was_replaced_is_measured_again(lab, measuring):
    bed = lab.experiment("bed")
    key, _ = measuring.measured(bed, bed.repetitions[0])
    os.utime(bed.repetitions[0][0], (7, 7))
    assert measuring.measured(bed, bed.repetitions[0])[0] != key


def test_a_measurement_with_outdated_settings_is_stopped(lab, measuring):
    drop = lab.experiment("drop")
    _, outdated = measuring.measured(drop, drop.repetitions[0])
    faster = replace(drop, camera=replace(drop.camera, frame_rate=120.0))
    _, wanted = measuring.measured(faster, drop.repetitions[0])
    assert outdated.cancelled()
    assert wanted.result(60).found.camera["frame_rate_hz"] == 120


def test_a_process_that_the_system_ends_is_said_and_replaced(lab, measuring):
    drop, bed = lab.experiment("drop"), lab.experiment("bed")
    rate = replace(drop, camera=replace(drop.camera, frame_rate=100.0))
    _, started = measuring.measured(rate, drop.repetitions[0])
    end_processes(measuring)
    found = started.result(60).found
    assert isinstance(found, Failure)
    assert "ended without a result" in found.message
    _, again = measuring.measured(with_floor(bed, 601.0), bed.repetitions[0])
    assert not isinstance(again.result(60).found, Failure)
    _, again = measuring.measured(rate, drop.repetitions[0])
    assert again is not started


def test_a_twin_whose_process_the_system_ends_is_refused_and_run_again_when_asked(lab, measuring):
    drop = lab.experiment("drop")
    measurement = measuring.measured(drop, drop.repetitions[0])[1].result(60).found
    started = measuring.in_step(drop, lab.model, measurement)
    end_processes(measuring)
    said = beside_json(started.result(60))
    assert "the process that ran the twin ended without a result" in said["refused"]
    assert (said["rows"], said["marks"]) == ([], [])
    again = measuring.in_step(drop, lab.model, measurement)
    assert again is not started
    assert beside_json(again.result(120))["rows"] != []
    assert measuring.in_step(drop, lab.model, measurement) is again
