"""A lab names files in its folder; files elsewhere are read where that is allowed, and never quoted."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from rigtwin.compare.diagnose.data.read_lab_json import read_tracked_lab
from rigtwin.compare.measure_repetitions import Failure, measure_repetition
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.file.schema import read_document
from rigtwin.lab.file.toml_lines import key_lines

SECRET = "root:x:0:0 a secret"


def lab_of(folder: Path, name: str, camera: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "lab.toml").write_text(
        f'[[experiments]]\nid = "d"\nrig = "drop"\nparticle = "D6"\nwall = "steel"\nrepetitions = ["{name}"]\n{camera}'
    )
    return folder


@pytest.fixture
def elsewhere(tmp_path) -> Path:
    place = tmp_path / "elsewhere"
    place.mkdir()
    (place / "r01.csv").write_text(f"{SECRET}\n1,2\n3,4\n")
    return place / "r01.csv"


def test_a_file_outside_the_lab_is_read_only_where_that_is_allowed(tmp_path, elsewhere) -> None:
    folder = lab_of(tmp_path / "lab", "r01.csv")
    (folder / "link.csv").symlink_to(elsewhere)
    (folder / "linked").symlink_to(elsewhere.parent)
    for name in (str(elsewhere), "../elsewhere/r01.csv", "link.csv", "linked/r01.csv", "linked"):
        lab_of(folder, name)
        with pytest.raises(BadLabFile, match=r"line 6: .*outside the lab's folder.*--allow-outside"):
            read_lab(folder)
        assert read_lab(folder, allow_outside=True).experiments[0].outside
    board = f'[experiments.camera]\nboard = "checkerboard 9x6 10mm {elsewhere}"\n'
    (folder / "own.csv").write_text("t,y\n0,1\n")
    lab_of(folder, "own.csv", board)
    with pytest.raises(BadLabFile, match=r"line 8: .*outside the lab's folder"):
        read_lab(folder)
    lab_of(folder, "own.csv")
    assert not read_lab(folder).experiments[0].outside


def test_a_refusal_quotes_nothing_of_a_file_outside(tmp_path, elsewhere) -> None:
    folder = lab_of(tmp_path / "lab", str(elsewhere))
    (experiment,) = read_lab(folder, allow_outside=True).experiments
    failed = measure_repetition(experiment, experiment.repetitions[0], None)
    assert isinstance(failed, Failure)
    assert "secret" not in failed.message
    assert "outside the lab's folder" in failed.message
    (folder / "lab.toml").unlink()
    (folder / "lab.toml").symlink_to(elsewhere)
    with pytest.raises(BadLabFile, match="not valid TOML") as caught:
        read_document(folder / "lab.toml")
    assert "secret" not in str(caught.value)


def tracked(folder: Path, files: object, repetitions: object = 1) -> Path:
    folder.mkdir(exist_ok=True)
    document = {
        "rig": "drop", "camera": {"frame_rate_hz": 240}, "particles": {"D6": {"diameter_m": 0.006, "mass_g": 0.06}},
        "conditions": [
            {"name": "one", "wall": "steel", "particle": "D6", "repetitions": repetitions, "files": files,
             "drop_height_m": 0.2}
        ],
    }  # fmt: skip
    (folder / "lab.json").write_text(json.dumps(document))
    return folder


def test_tracks_of_a_lab_json_outside_its_folder_are_refused(tmp_path, elsewhere) -> None:
    folder = tracked(tmp_path / "lab", "../elsewhere/r%02d.csv")
    with pytest.raises(BadLabFile, match="outside the lab's folder"):
        read_tracked_lab(folder)
    with pytest.raises(BadInput, match="nothing of it is quoted") as caught:
        read_tracked_lab(folder, allow_outside=True)
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("pattern", ["%.999999999d", "%999999999d", "%.0s", "%c", "r01.csv", "%d%d", "%(x)s", "%*d"])
def test_a_pattern_of_file_names_holds_one_short_number(tmp_path, pattern) -> None:
    with pytest.raises(BadLabFile, match="no placeholder for a number"):
        read_tracked_lab(tracked(tmp_path / "lab", pattern))


def test_a_count_of_repetitions_is_plausible(tmp_path) -> None:
    with pytest.raises(BadLabFile, match="1000000000 is more than the 10000"):
        read_tracked_lab(tracked(tmp_path / "lab", "r%02d.csv", 10**9))


@pytest.mark.parametrize(("modulus", "words"), [('"1e15 Pa"', r"at most 2e\+12 Pa"), ("11", "write it with its unit")])
def test_no_material_is_stiffer_than_diamond_or_softer_than_a_soft_gel(tmp_path, modulus, words) -> None:
    folder = tmp_path / "lab"
    lab_of(folder, "r01.mp4", f"[materials.m]\ndensity = 700\nyoungs_modulus = {modulus}\npoisson_ratio = 0.3\n")
    with pytest.raises(BadLabFile, match=rf"youngs_modulus: .*{words}"):
        read_lab(folder)


def test_the_lines_of_a_file_four_times_as_long_take_not_much_more_than_four_times_as_long() -> None:
    def seconds(count: int) -> float:
        text = "".join(f'[[experiments]]\nid = "d{k}"\nrepetitions = ["a.mp4", "b.mp4"]\n' for k in range(count))
        began = time.process_time()
        assert key_lines(text)["experiments", count - 1, "id"] == 3 * count - 1
        return time.process_time() - began

    seconds(100)
    # it was sixteen times; of a busy machine the least of three counts
    assert min(seconds(8000) for _ in range(3)) < 10 * min(seconds(2000) for _ in range(3))


def test_notes_that_are_far_too_long_are_refused_unread(tmp_path) -> None:
    path = tmp_path / "lab.toml"
    with path.open("wb") as file:
        file.truncate(10**10)
    with pytest.raises(BadLabFile, match="10000 MB, and at most 4 MB are read"):
        read_lab(tmp_path)
