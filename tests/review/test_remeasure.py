"""Repetitions are measured in the background: once for the same settings, and without waiting for outdated ones."""

import math
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import av
import pytest

from rigtwin.compare.measure_repetitions import Failure, measure_repetition
from rigtwin.lab.camera import Seed
from rigtwin.lab.errors import BadInput
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
    with pytest.raises(BadInput, match="the measurement was stopped, because its measurement with other settings"):
        outdated.result(60)
    assert wanted.result(60).found.camera["frame_rate_hz"] == 120


def test_what_is_stopped_for_another_repetition_says_so_and_is_begun_when_asked_again(lab, measuring, doubled):
    drop, bed = lab.experiment("drop"), lab.experiment("bed")
    slower = replace(drop, camera=replace(drop.camera, frame_rate=110.0))
    _, stopped = measuring.measured(slower, drop.repetitions[0])
    measuring.measured(with_floor(bed, 602.0), bed.repetitions[0])
    measuring.measured(drop, (doubled,))
    with pytest.raises(BadInput, match=r"r01\.mp4: .* stopped, because the measurement of doubled\.mp4"):
        stopped.result(60)
    assert measuring.measured(slower, drop.repetitions[0])[1] is not stopped


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


@pytest.fixture(scope="module")
def doubled(lab):
    """The drop with each of its frames stored twice, at 480 Hz."""
    path = lab.folder / "doubled.mp4"
    with av.open(str(lab.folder / "r01.mp4")) as clip, av.open(str(path), "w") as container:
        stream = None
        for frame in clip.decode(video=0):
            if stream is None:
                stream = container.add_stream("libx264", rate=480, options={"crf": "12", "preset": "ultrafast"})
                stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, "yuv420p"
            grey = frame.to_ndarray(format="bgr24")
            for _ in range(2):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="bgr24")))
        container.mux(stream.encode())
    return path


@pytest.mark.slow
def test_marks_and_twin_of_a_clip_with_doubled_frames_lie_in_the_frames_of_the_file(lab, measuring, doubled):
    drop = lab.experiment("drop")
    drop = replace(drop, camera=replace(drop.camera, frame_rate=240.0))
    places = []
    for clip in (drop.repetitions[0][0], doubled):
        one = replace(drop, repetitions=((clip,),))
        found = measuring.measured(one, (clip,))[1].result(120).found
        track = next(mark for mark in found.marks if mark.kind == "track")
        places.append(dict(zip(track.frames, track.points, strict=True)))
        twin = measuring.in_step(one, lab.model, found).result(120).marks[0]
        at = dict(zip(twin.frames, twin.points, strict=True))
        assert max(math.dist(at[frame], places[-1][frame]) for frame in at.keys() & places[-1].keys()) < 20
    single, double = places
    both = [frame for frame in single if 2 * frame in double]
    assert len(both) > 0.9 * len(single)
    assert max(math.dist(single[frame], double[2 * frame]) for frame in both) < 1.0

    frame = both[len(both) // 4]
    there = replace(drop.camera, bead_at=Seed(2 * frame + 1, single[frame]))
    stated = measuring.measured(replace(drop, camera=there), (doubled,))[1].result(120).found
    assert stated.quantities[0].value == pytest.approx(found.quantities[0].value, rel=0.01)
