"""A change of one key leaves everything else in a lab.toml as it is."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file.lab_edit import LabEdit, with_key
from rigtwin.lab.file.lab_file import read_lab

LAB = """\
# Bench of the first floor
[lab]
title = "Ash"   # beads

[[experiments]]
id = "drop"     # the first one
rig = "drop"
particle = "D6"
wall = "steel"
repetitions = ["r01.mp4", "r02.mp4"]

[experiments.camera]
frame_rate = "240 Hz" # high speed
known_length = "100 mm:0,0,500,0"

# The heap has no camera yet
[[experiments]]
id = "heap"
rig = "pile"
variant = "piling"
particle = "D6"
wall = "steel"
base_diameter = "90 mm"
repetitions = [["a.jpg", "b.jpg"]]
"""
PLACE = Path("lab.toml")


@pytest.fixture
def edit(tmp_path) -> LabEdit:
    for number, name in enumerate(("r01.mp4", "r02.mp4", "a.jpg", "b.jpg")):
        (tmp_path / name).write_bytes(b"picture" * (number + 1))
    (tmp_path / "lab.toml").write_text(LAB)
    return LabEdit(tmp_path / "lab.toml")


def set_in(text: str, *where, value) -> str:
    return with_key(text.encode(), PLACE, where[0], where[1:], value).decode()


def test_a_new_key_is_one_new_line_behind_the_others():
    assert set_in(LAB, 0, "camera", "region", value="1,2,30,40") == LAB.replace(
        '0,0,500,0"\n', '0,0,500,0"\nregion = "1,2,30,40"\n'
    )


def test_a_changed_key_keeps_its_place_and_its_comment():
    assert set_in(LAB, 0, "camera", "frame_rate", value="120 Hz") == LAB.replace("240 Hz", "120 Hz")


def test_a_key_that_is_taken_out_leaves_the_rest():
    with_region = set_in(LAB, 0, "camera", "region", value="1,2,30,40")
    assert set_in(with_region, 0, "camera", "region", value=None) == LAB


def test_a_table_is_made_where_there_is_none_and_goes_with_its_last_key():
    made = set_in(LAB, 1, "camera", "base", value="1,2,30,4")
    assert made == f'{LAB}\n[experiments.camera]\nbase = "1,2,30,4"\n'
    assert set_in(made, 1, "camera", "base", value=None) == LAB


def test_keys_of_one_file_stand_in_a_table_of_their_own():
    rejected = set_in(LAB, 0, "files", "r02.mp4", "rejected", value="a hand")
    assert '\n\n[experiments.files."r02.mp4"]\nrejected = "a hand"\n\n' in rejected
    assert rejected.replace('[experiments.files."r02.mp4"]\nrejected = "a hand"\n\n', "") == LAB


def test_line_ends_and_byte_order_mark_stay():
    windows = "\ufeff" + LAB.replace("\n", "\r\n")
    assert set_in(windows, 1, "camera", "base", value="1,2,30,4") == (
        windows + '\r\n[experiments.camera]\r\nbase = "1,2,30,4"\r\n'
    )


@pytest.mark.parametrize(
    "camera",
    [
        'camera = { frame_rate = "240 Hz" }\n',
        'camera.frame_rate = "240 Hz"\n',
        '[experiments.camera] # seen from the left\nframe_rate = "240 Hz"\n',
        '[experiments."camera"]\nframe_rate = "240 Hz"',
        '[experiments.files."r01.mp4"]\nrejected = "dark"\n[experiments.camera]\nframe_rate = "240 Hz"\n',
    ],
)
@pytest.mark.parametrize("value", ["1,2,30,40", None])
def test_however_a_camera_is_written_nothing_else_changes(camera, value):
    text = LAB[: LAB.index("[experiments.camera]")] + camera
    before = tomllib.loads(text)
    after = tomllib.loads(set_in(text, 0, "camera", "frame_rate" if value is None else "region", value=value))
    if value is None:
        del before["experiments"][0]["camera"]
    else:
        before["experiments"][0]["camera"]["region"] = value
    assert after == before


def test_changes_are_taken_back_one_by_one(edit):
    edit.set(0, "region", "0,0,300,400")
    with_region = edit.path.read_text()
    edit.set(0, "rejected", "a hand", file="r02.mp4")
    edit.undo()
    assert edit.path.read_text() == with_region
    edit.undo()
    assert edit.path.read_text() == LAB
    assert not edit.can_undo
    with pytest.raises(BadInput, match="nothing was changed here"):
        edit.undo()


def test_what_was_changed_elsewhere_is_not_overwritten(edit):
    edit.set(0, "region", "0,0,300,400")
    edit.path.write_text(edit.path.read_text() + "# seen\n")
    with pytest.raises(BadInput, match="was changed elsewhere since"):
        edit.undo()
    assert edit.path.read_text().endswith("# seen\n")


@pytest.mark.parametrize(
    ("experiment", "key", "value", "file", "said"),
    [
        (0, "region", "1,2", None, r"experiment 1, camera\.region: '1,2' is not of the form"),
        (1, "plate", "1,2,30,4", None, r"camera\.plate: is not used by a pile"),
        (0, "scale", "0.2 mm/px", None, r"camera\.known_length: a scale is given too"),
        (0, "rejected", " ", "r01.mp4", r"files\.\"r01\.mp4\"\.rejected: ' ' is no reason"),
        (0, "rejected", "dark", "r07.mp4", r"is none of the repetitions; known are r01\.mp4"),
        (4, "region", "0,0,9,9", None, "has no experiment 5 any more"),
    ],
)
def test_what_would_not_be_valid_is_not_written(edit, experiment, key, value, file, said):
    with pytest.raises(BadInput, match=said):
        edit.set(experiment, key, value, file=file)
    assert edit.path.read_text() == LAB


def test_a_broken_lab_is_not_written_over(edit):
    edit.path.write_text(LAB + "[[")
    with pytest.raises(BadLabFile, match="not valid TOML"):
        edit.set(0, "region", "0,0,300,400")
    assert edit.path.read_text() == LAB + "[["


def test_a_link_to_a_lab_stays_a_link(edit, tmp_path):
    kept = tmp_path / "kept.toml"
    edit.path.rename(kept)
    edit.path.symlink_to(kept)
    edit.set(0, "region", "0,0,300,400")
    assert edit.path.is_symlink()
    assert 'region = "0,0,300,400"' in kept.read_text()


LEFT_OUT = """exclude = [   # seen by eye
    "3f..5f",  # a hand
    "0.2 s..0.3 s",   # the lamp flickers
    # at rest
    "60f..80f",
]  # that is all
"""


@pytest.mark.parametrize(
    ("entries", "changed"),
    [
        (["3f..5f", "60f..80f"], ('    "0.2 s..0.3 s",   # the lamp flickers\n', "")),
        (["0.2 s..0.3 s", "60f..80f"], ('    "3f..5f",  # a hand\n', "")),
        (["3f..5f", "0.2 s..0.3 s"], ('    "60f..80f",\n', "")),
        (["3f..5f", "0.2 s..0.3 s", "60f..80f", "90f..90f"], ('80f",\n', '80f",\n    "90f..90f",\n')),
        (["3f..5f", "0.2 s..0.4 s", "60f..80f"], ("0.3 s", "0.4 s")),
    ],
)
def test_one_entry_of_several_lines_is_changed_with_the_others_and_their_comments_as_they_are(entries, changed):
    lab = LAB.replace("known_length =", f"{LEFT_OUT}known_length =")
    assert set_in(lab, 0, "camera", "exclude", value=entries) == lab.replace(LEFT_OUT, LEFT_OUT.replace(*changed))


@given(st.lists(st.sampled_from("abcd"), max_size=6), st.lists(st.sampled_from("abcde"), min_size=1, max_size=6))
def test_any_entries_become_any_others(before, after):
    lines = "".join(f'    "{each}", # {each}\n' for each in before)
    lab = LAB.replace("known_length =", f"exclude = [\n{lines}]\nknown_length =")
    found = tomllib.loads(set_in(lab, 0, "camera", "exclude", value=after))["experiments"][0]["camera"]
    assert found == {"frame_rate": "240 Hz", "exclude": after, "known_length": "100 mm:0,0,500,0"}


def test_a_file_has_the_camera_of_its_experiment_but_for_what_is_stated_of_it(edit):
    edit.set(0, "scale", "0.1 mm/px", file="r02.mp4")
    edit.set(0, "exclude", ["3f..5f", "0.2 s..0.3 s"], file="r02.mp4")
    drop = read_lab(edit.path).experiments[0]
    first, second = (drop.camera_of(view) for (view,) in drop.repetitions)
    assert (first.frame_rate, first.given_scale, first.exclude) == (240, 0.2e-3, ())
    assert (second.frame_rate, second.given_scale, second.known_length) == (240, pytest.approx(1e-4), None)
    assert [(a.value, b.value, a.unit) for a, b in second.exclude] == [(3, 5, "frame"), (0.2, 0.3, "s")]


def test_a_rejected_file_is_no_repetition(edit, tmp_path):
    edit.set(1, "rejected", "out of focus", file="b.jpg")
    heap = read_lab(edit.path).experiments[1]
    assert heap.repetitions == ((tmp_path / "a.jpg",),)
    assert heap.rejected == {tmp_path / "b.jpg": "out of focus"}
    edit.set(1, "rejected", "out of focus", file="a.jpg")
    assert read_lab(edit.path).experiments[1].repetitions == ()


def test_what_stands_there_already_is_no_change(edit):
    edit.set(0, "frame_rate", "240 Hz")
    edit.set(0, "region", None)
    edit.set(0, "rejected", None, file="r02.mp4")
    assert edit.path.read_text() == LAB
    assert not edit.can_undo
