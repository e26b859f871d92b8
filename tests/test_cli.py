"""The command line: what it says when all is well, and above all when it is not."""

import errno
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rigtwin
from rigtwin.cli import run
from rigtwin.commands.display import show_measurement
from rigtwin.lab.errors import BadInput
from rigtwin.lab.quantity import Check, Measurement, Quantity
from rigtwin.lab.rigs import RIGS

HEAVY = {
    "numpy",
    "cv2",
    "scipy",
    "skimage",
    "matplotlib",
    "taichi",
    "av",
    "pandas",
    "pint",
    "jinja2",
    "starlette",
    "uvicorn",
    "tomlkit",
    "rigtwin.compare",
    "rigtwin.review",
}

LAB = """
[lab]
title = "Bench"
[[experiments]]
id = "drop-D6-steel"
rig = "drop"
particle = "D6"
wall = "steel"
drop_height = "300 mm"
repetitions = ["r01.csv"]
"""


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def empty_video(tmp_path):
    """A readable clip of a plain wall."""
    import av

    path = tmp_path / "wall.mp4"
    rng = np.random.default_rng(3)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=60, options={"x264-params": "mbtree=0"})
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        wall = np.full((120, 160, 3), 128) + rng.normal(0, 4, (120, 160, 1))
        for _ in range(40):
            picture = np.clip(wall + rng.normal(0, 1, wall.shape), 0, 255).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return path


@pytest.fixture
def empty_photo(tmp_path):
    import cv2

    path = tmp_path / "wall.jpg"
    noise = np.random.default_rng(4).normal(128, 4, (300, 400, 3))
    cv2.imwrite(str(path), np.clip(noise, 0, 255).astype(np.uint8))
    return path


@pytest.fixture
def started_engine(capfd):
    """Taichi says a word of its own when it first starts under captured output."""
    run(["simulate", "drop", "--drop-height", "50mm", "--out", "first", "--quiet"])
    capfd.readouterr()


def lab_with(tmp_path: Path, old: str = "", new: str = "") -> Path:
    folder = tmp_path / "lab"
    folder.mkdir()
    time = np.arange(60) / 240
    rows = [f"{t:.6f},0,{0.3 - 4.905 * t * t:.6f}" for t in time]
    (folder / "r01.csv").write_text("\n".join(["time_s,x_m,y_m", *rows]))
    (folder / "lab.toml").write_text(LAB.replace(old, new) if old else LAB)
    return folder


def refused(arguments: list[object], capfd, *words: str, as_json: bool = True) -> None:
    """The command ends with one sentence on stderr and code 2, and as one JSON document with --json."""
    words_given = [str(argument) for argument in arguments]
    assert run(words_given) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1, err
    assert "Traceback" not in err
    for word in words:
        assert word in err
    if not as_json:
        return
    assert run([*words_given, "--json"]) == 2
    out, err = capfd.readouterr()
    error = json.loads(out)["error"]
    assert error["exit_code"] == 2
    for word in words:
        assert word in error["message"]
    assert err == ""


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from rigtwin.cli import run; code = run(sys.argv[1:]);"
        "print('\\nLOADED', *sorted(sys.modules)); sys.exit(code)"
    )
    for command in ([], ["measure", "drop"], ["compare"]):
        done = subprocess.run(
            [sys.executable, "-c", code, *command, "--help"], capture_output=True, text=True, check=True
        )
        page, _, loaded = done.stdout.partition("LOADED")
        assert "Usage" in page
        assert HEAVY.isdisjoint(loaded.split())


@pytest.mark.parametrize(
    ("typed", "meant"), [("rigtwin simu", "simulate"), ("rigtwin compare --stiff", "--stiffness-factor")]
)
def test_the_shell_completes_commands_and_options_and_loads_nothing_heavy(typed, meant):
    code = (
        "import atexit, sys; atexit.register(lambda: print('\\nLOADED', *sorted(sys.modules)));"
        "from rigtwin.cli import run; sys.exit(run([]))"
    )
    asked = {"_RIGTWIN_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))}
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True, check=True
    )
    found, _, loaded = done.stdout.partition("LOADED")
    assert found.split() == [meant]
    assert HEAVY.isdisjoint(loaded.split())


def test_the_completion_of_a_shell_is_shown():
    # the shell is that in which the command runs; without `true` bash would become the command
    line = f"{shlex.quote(sys.executable)} -m rigtwin --show-completion && true"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True)
    assert "_RIGTWIN_COMPLETE" in done.stdout


SINGLE = (
    "demo",
    "init",
    "compare",
    "sweep",
    "calibrate",
    "runs",
    "diagnose",
    "doctor",
    "import",
    "reproduce",
    "review",
)
DECKS = ("liggghts", "lammps", "yade")
COMMANDS = [
    *([command] for command in SINGLE),
    ["measure", "lab"],
    *([group, rig] for group in ("measure", "simulate") for rig in RIGS),
    *(["export", card] for card in ("edem", "csv")),
    *(["export", code, rig] for code in DECKS for rig in ("packing", "pile", "drum", "hopper", "custom")),
    ["simulate", "custom"],
]
LISTED = {
    (): len(SINGLE) + 3,
    ("measure",): len(RIGS) + 1,
    ("simulate",): len(RIGS) + 1,
    ("export",): 5,
    ("export", "yade"): 5,
}


@pytest.mark.parametrize("group", LISTED)
def test_every_command_is_described_in_full_on_one_line_of_a_narrow_terminal(group, monkeypatch, capfd):
    monkeypatch.setenv("COLUMNS", "80")
    assert run([*group, "--help"]) == 0
    listed = capfd.readouterr().out.partition("Commands:")[2].splitlines()[1:]
    assert len(listed) == LISTED[group]
    assert all(line.endswith(".") and not line.endswith("...") for line in listed)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_help_of_every_command_shows_an_example_of_it(command, capfd):
    assert run([*command, "--help"]) == 0
    assert f"Example: rigtwin {' '.join(command)} " in capfd.readouterr().out


def test_the_version_is_that_of_the_package(capfd):
    from rigtwin import __version__

    assert run(["--version"]) == 0
    assert capfd.readouterr().out == f"rigtwin {__version__}\n"


@pytest.mark.parametrize("rig", ["drop", "pendulum", "pile"])
def test_a_wrong_path_is_refused_in_one_sentence(rig, capfd):
    refused(["measure", rig, "nowhere.mp4", "--bead-diameter", "6mm"], capfd, "nowhere.mp4", "no such file")


@pytest.mark.parametrize("rig", ["drop", "pendulum", "pile"])
def test_an_empty_file_is_refused_in_one_sentence(rig, tmp_path, capfd):
    (tmp_path / "empty.mp4").touch()
    refused(["measure", rig, "empty.mp4", "--bead-diameter", "6mm"], capfd, "empty.mp4", "is empty")


@pytest.mark.parametrize(("rig", "kind"), [("drop", "video"), ("pendulum", "video"), ("pile", "photo")])
def test_a_text_file_with_the_name_of_a_video_is_refused_in_one_sentence(rig, kind, tmp_path, capfd):
    (tmp_path / "notes.mp4").write_text("Drop height 300 mm, ten repetitions.\n" * 20)
    refused(["measure", rig, "notes.mp4", "--bead-diameter", "6mm"], capfd, "notes.mp4", f"decoded as a {kind}")


@pytest.mark.parametrize("rig", ["drop", "pendulum"])
def test_a_video_without_a_bead_is_refused_in_one_sentence(rig, empty_video, capfd):
    refused(["measure", rig, empty_video, "--bead-diameter", "6mm"], capfd, "wall.mp4")


def test_a_photo_without_a_pile_is_refused_in_one_sentence(empty_photo, capfd):
    refused(["measure", "pile", empty_photo, "--base-diameter", "90mm"], capfd, "wall.jpg")


def test_a_wrong_unit_in_the_lab_file_is_refused_with_key_and_line(tmp_path, capfd):
    folder = lab_with(tmp_path, '"300 mm"', '"300 kg"')
    refused(["compare", folder], capfd, "lab.toml", "line 9", "drop_height", "300 kg")


def test_a_missing_key_in_the_lab_file_is_refused_with_its_name(tmp_path, capfd):
    folder = lab_with(tmp_path, 'particle = "D6"\n', "")
    refused(["compare", folder], capfd, "lab.toml", "particle", "missing")


def test_a_misspelt_key_is_named_and_not_that_it_is_missing(tmp_path, capfd):
    folder = lab_with(tmp_path, 'wall = "steel"', 'wal = "steel"')
    refused(["compare", folder], capfd, "experiment 1, wal: unknown key; did you mean 'wall'?")


def test_several_faults_of_a_lab_stand_on_a_line_each_and_in_a_list(tmp_path, capfd):
    folder = lab_with(tmp_path, 'wall = "steel"\n', 'weight = "3 g"\n')
    assert run(["compare", str(folder)]) == 2
    head, *faults = capfd.readouterr().err.splitlines()
    assert head == f"rigtwin: {folder / 'lab.toml'} has 2 faults:"
    assert ["weight: unknown key" in faults[0], "wall: this key is missing" in faults[1]] == [True, True]
    assert run(["compare", str(folder), "--json"]) == 2
    error = json.loads(capfd.readouterr().out)["error"]
    assert error["faults"] == [fault.strip() for fault in faults]


def test_a_lab_whose_only_repetition_shows_no_bounce_is_refused_by_name(tmp_path, capfd):
    assert run(["compare", str(lab_with(tmp_path)), "--json"]) == 2
    message = json.loads(capfd.readouterr().out)["error"]["message"]
    assert message.startswith("drop-D6-steel: its only repetition could not be measured")


def test_the_demo_without_its_sample_media_says_where_they_are(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr("rigtwin.cli.__file__", str(tmp_path / "cli.py"))
    refused(["demo"], capfd, "sample_media", "install rigtwin again")


def test_an_unknown_experiment_is_refused_with_the_known_ones(tmp_path, capfd):
    refused(["compare", lab_with(tmp_path), "--only", "drop-D6-stel"], capfd, "drop-D6-stel", "drop-D6-steel")


@pytest.mark.parametrize("option", ["--runs", "--count", "--stiffness-factor", "--rolling-model"])
def test_an_option_that_no_twin_of_the_lab_takes_is_refused(tmp_path, capfd, option):
    value = {"--stiffness-factor": "0.1", "--rolling-model": "A"}.get(option, "3")
    refused(["compare", lab_with(tmp_path), option, value], capfd, option, "drop-D6-steel")


@pytest.mark.usefixtures("in_this_process")
def test_the_rolling_model_of_a_comparison_is_that_of_its_twins(tmp_path, capfd, monkeypatch):
    asked: dict[str, Any] = {}

    def twin(_rig, _cast, **given):
        asked.update(given)
        raise BadInput("seen")

    monkeypatch.setattr("rigtwin.compare.twins.pile.pile_twin", twin)
    pile = 'rig = "pile"\nvariant = "piling"\nbase_diameter = "90 mm"\ncount = 60\n'
    folder = lab_with(tmp_path, 'rig = "drop"\n', pile)
    lab = folder / "lab.toml"
    lab.write_text(lab.read_text().replace('drop_height = "300 mm"\n', ""))
    (folder / "r01.csv").write_text("x_m,height_m\n-0.04,0\n0,0.03\n0.04,0\n")
    refused(["compare", folder, "--rolling-model", "A-explicit"], capfd, "could not be measured")
    assert asked["rolling"] == "type A explicit"
    asked.clear()
    refused(["compare", folder], capfd, "could not be measured")
    assert "rolling" not in asked


@pytest.mark.usefixtures("in_this_process")
def test_a_twin_s_advice_in_a_comparison_names_no_option_that_compare_does_not_have(tmp_path, capfd, monkeypatch):
    from rigtwin.compare.twins import pile as bulk_twins

    ends_at_once = partial(bulk_twins.pile_twin, settle_limit=0.001)  # [s], while beads fall yet
    monkeypatch.setattr(bulk_twins, "pile_twin", ends_at_once)
    pile = 'rig = "pile"\nvariant = "piling"\nbase_diameter = "40 mm"\nrim_height = "8 mm"\ncount = 60\n'
    folder = lab_with(tmp_path, 'rig = "drop"\n', pile)
    lab = folder / "lab.toml"
    lab.write_text(lab.read_text().replace('drop_height = "300 mm"\n', ""))
    rows = [f"{x / 1e3},{max(0, 20 - abs(x)) / 2e3}" for x in range(-30, 31)]
    (folder / "r01.csv").write_text("\n".join(["x_m,height_m", *rows]) + "\n")
    assert run(["compare", str(folder), "--out", str(tmp_path / "out"), "--json"]) == 0
    (experiment,) = json.loads(capfd.readouterr().out)["experiments"]
    assert "twin: the heap was still moving when the time limit was reached" in experiment["warnings"]
    assert run(["compare", "--help"]) == 0
    options = set(re.findall(r"--[a-z-]+", capfd.readouterr().out))
    named = set(re.findall(r"--[a-z-]+", json.dumps(experiment)))
    assert named <= options
    assert run(["compare", str(folder), "--out", str(tmp_path / "out")]) == 0
    assert "-limit" not in capfd.readouterr().out


def test_a_table_of_a_drum_is_one_moment_unless_it_is_stated_to_be_a_mean(tmp_path, capfd):
    table = tmp_path / "surface.csv"
    table.write_text(
        "\n".join(["x_m,height_m", *(f"{x / 1e3},{0.6 * x / 1e3 - 0.01}" for x in range(-60, 61, 4))]) + "\n"
    )
    command = ["measure", "drum", str(table), "--drum-diameter", "150mm", "--bead-diameter", "6mm", "--json"]
    parts = []
    for more in ([], ["--averaged"]):
        assert run([*command, *more, "--out", str(tmp_path / f"out{len(more)}")]) == 0
        parts.append([each.get("budget", {}) for each in json.loads(capfd.readouterr().out)["quantities"]])
    assert parts[0]
    assert all("flow over time" in each for each in parts[0])
    assert not any("flow over time" in each for each in parts[1])


@pytest.mark.parametrize("rig", ["drop", "pendulum", "tilt", "packing", "pile", "hopper"])
def test_only_a_drum_can_be_averaged(rig, tmp_path, capfd):
    refused(["measure", rig, tmp_path / "one.mp4", "--averaged"], capfd, "--averaged")


@pytest.mark.parametrize("rig", ["pile", "packing"])
def test_a_copy_of_a_photo_is_no_further_view(tmp_path, capfd, rig):
    photos = [tmp_path / name for name in ("front.jpg", "other.jpg", "side.jpg")]
    for photo, content in zip(photos, (b"one", b"two", b"one"), strict=True):
        photo.write_bytes(content)
    known = ["--cylinder-diameter", "65mm"] if rig == "packing" else []
    refused(["measure", rig, *photos, *known], capfd, "side.jpg", "front.jpg", "take one of them out")


def test_a_model_that_is_not_there_is_looked_for_where_a_diagnosis_leaves_it(tmp_path, capfd):
    refused(["compare", lab_with(tmp_path), "--model", "nosuch.toml"], capfd, "nosuch.toml", "rigtwin diagnose")


PILE = ["simulate", "pile", "--base-diameter", "90mm"]
HOPPER = ["simulate", "hopper", "--outlet", "30mm"]
DRUM = ["simulate", "drum", "--drum-diameter", "40mm", "--speed", "10rpm"]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["measure", "drop", "x.mp4", "--bead-diameter", "6kg"], "--bead-diameter"),
        (["measure", "drop", "x.mp4", "--bead-diameter", "-6mm"], "--bead-diameter"),
        (["measure", "drop", "x.mp4", "--frame-rate", "240 mm"], "--frame-rate"),
        (["measure", "drop", "x.mp4", "--scale", "0.2 mm"], "--scale"),
        (["measure", "drop", "x.mp4", "--region", "1,2,3"], "--region"),
        (["simulate", "pile", "--base-diameter", "90mm", "--lift-speed", "20mm/s"], "--lift-speed"),
        (["measure", "drop", "x.mp4", "--known-length", "100mm"], "--known-length"),
        (["measure", "drop", "x.mp4", "--start", "soon"], "--start"),
        (["measure", "drop", "x.mp4", "--camera-roll", "1 mm"], "--camera-roll"),
        (["measure", "drop", "x.mp4", "--camera-roll", "90"], "--camera-roll"),
        (["measure", "drop", "x.mp4", "--start", "-5s"], "--start"),
        (["measure", "drop", "x.mp4", "--region", "nan,0,10,10"], "--region"),
        (["measure", "drop", "x.mp4", "--frame-rate", "1e300Hz"], "--frame-rate: cannot be"),
        (["measure", "pile", "x.jpg", "./x.jpg"], "given twice"),
        (["measure", "drop", "x.mp4", "--bead-diameter", "6"], "is 6 m, no bead's diameter; write it with its unit"),
        (["measure", "drop", "x.mp4", "--bead-diameter", "1e-30mm"], "is 1e-33 m, no bead"),
        (["measure", "drop", "x.mp4", "--bead-diameter", "0mm"], "is not above zero"),
        (["measure", "drop", "x.mp4", "--bead-diameter", "6mm", "--bead-mass", "71g"], "more than any metal"),
        (["measure", "drop", "x.mp4", "--bead-density", "568000kg/m^3"], "more than any metal"),
        (["measure", "drop", "x.mp4", "--bead-density", "568g/m^3"], "less than the air"),
        (
            ["measure", "hopper", "x.mp4", "--depth", "40mm"],
            "--depth serves to check the stated mass; give --bead-density and --total-mass too",
        ),
        (
            ["measure", "hopper", "x.csv", "--depth", "40mm", "--total-mass", "50g"],
            "--depth serves to check the mass against the bed in a film, and x.csv is a table; leave it out",
        ),
        (["simulate", "drop", "--drop-height", "300mm", "--wall", "wood_ash"], "D6-wood_ash"),
        (["measure", "drop", "x.mp4", "--bead-mass", "0.1g"], "--bead-diameter"),
        (["measure", "drop", "x.mp4", "--bead-mass", "6mm"], "wrong unit for a mass; write it like"),
        (["measure", "pendulum", "x.mp4", "--variant", "triple"], "--variant"),
        (["simulate", "drop", "--drop-height", "300 s"], "--drop-height"),
        (["simulate", "drop", "--drop-height", "300"], "300 m, no length on a bench; write it with its unit"),
        (["simulate", "drop", "--drop-height", "300mm", "--particle", "D7"], "--particle"),
        (["simulate", "drop", "--drop-height", "300mm", "--wall", "stel"], "steel"),
        (["simulate", "pile"], "--base-diameter"),
        (["simulate", "pile", "--base-diameter", "90mm", "--time-step-fraction", "0.9"], "or force it"),
        (["simulate", "pile", "--base-diameter", "90mm", "--count", "1000000000"], "--count"),
        (["simulate", "pile", "--base-diameter", "90mm", "--static-friction", "nan"], "--static-friction"),
        (["simulate", "pile", "--base-diameter", "90mm", "--seed", "-1"], "--seed"),
        (["simulate", "pile", "--base-diameter", "90mm", "--rim-height", "-5mm"], "--rim-height"),
        (["simulate", "drop", "--drop-height", "300mm", "--bounces", "1000000000"], "--bounces"),
        (["simulate", "drop", "--drop-height", "300mm", "--restitution", "1.2"], "at most 1"),
        (["simulate", "pendulum", "--length", "300mm", "--release-angle", "180deg"], "180 degrees, more than 175"),
        (["simulate", "drum", "--drum-diameter", "140mm", "--speed", "3"], "write it with its unit, like '3 rpm'"),
        (
            ["simulate", "tilt", "--variant", "slide", "--speed", "2deg"],
            "unit for a tilting speed; write it like '2 deg/s'",
        ),
        (["measure", "drop", "x.mp4", "--known-length", "100:1,2,301,4"], "100 m long; write the length with its unit"),
        (["simulate", "pendulum", "--length", "9cm", "--release-angle", "45deg", "--wall", "steel"], "--variant wall"),
        (["simulate", "drum", "--drum-diameter", "60mm", "--speed", "3rpm", "--count", "9", "--fill", "0.3"], "--fill"),
        (["simulate", "hopper", "--variant", "conical", "--outlet", "30mm", "--depth", "3m"], "--variant slot"),
        (["simulate", "packing", "--impact-speed", "3m/s"], "--contact-law linear"),
        (["simulate", "drop", "--drop-height", "300mm", "--turned", "30deg"], "--turned: D6 is a sphere"),
        (["simulate", "pendulum", "--length", "9cm", "--release-angle", "45deg", "--rod-mass", "2g"], "--hanger rod"),
        (
            ["simulate", "pendulum", "--length", "9cm", "--release-angle", "45deg", "--particle", "C6_24s"],
            "--particle: C6_24s is a clump",
        ),
        (["simulate", "packing", "--outlet-diameter", "80mm"], "--outlet-diameter: 80 mm is wider"),
        (["simulate", "drum", "--drum-diameter", "20mm", "--speed", "3rpm"], "--drum-diameter: a drum of 20 mm"),
        (["simulate", "tilt", "--variant", "slide", "--rolling-friction", "0.5"], "--variant roll"),
        (["simulate", "drop", "--drop-height", "300mm", "--bounces", "2", "--duration", "1s"], "--bounces"),
        ([*PILE, "--method", "pouring", "--fall-height", "20mm"], "--method piling"),
        ([*PILE, "--method", "emptying", "--pour-rate", "400/s"], "--method piling"),
        ([*PILE, "--fill-limit", "3s"], "--method pouring or emptying, here it is piling"),
        ([*PILE, "--outlet-height", "80mm", "--fall-height", "20mm"], "changes nothing beside --outlet-height"),
        (
            [*PILE, "--pour-rate", "400mm/s"],
            "--pour-rate: '400mm/s' has the wrong unit for a rate; write it like '400/s'",
        ),
        ([*PILE, "--settle-limit", "0s"], "--settle-limit"),
        (["simulate", "packing", "--hopper-diameter", "90mm", "--pour-rate", "400/s"], "beside --hopper-diameter"),
        (["simulate", "packing", "--fill-limit", "3s"], "--hopper-diameter"),
        ([*HOPPER, "--variant", "conical", "--slide-angle", "45deg"], "--variant slot"),
        ([*HOPPER, "--variant", "conical", "--slide-drop", "60mm"], "--variant slot"),
        ([*HOPPER, "--variant", "conical", "--inclination", "60deg"], "--variant slot"),
        ([*HOPPER, "--variant", "conical", "--settle-limit", "3s"], "--variant slot"),
        ([*HOPPER, "--variant", "slot", "--cone-height", "60mm"], "--variant conical"),
        (
            [*HOPPER, "--variant", "slot", "--inclination", "90deg"],
            "--inclination: '90deg' is 90 degrees, more than 85",
        ),
        ([*HOPPER, "--variant", "slot", "--slide-drop", "3mm"], "--slide-drop: 3 mm between slot and slide"),
        (["simulate", "tilt", "--variant", "slide", "--plate-length", "10mm"], "--plate-length: 10 mm is too short"),
        (["simulate", "tilt", "--variant", "slide", "--start-angle", "86deg"], "--start-angle"),
        ([*HOPPER, "--variant", "slot", "--depth", "3mm"], "--depth: 3 mm between the end walls"),
        ([*DRUM, "--depth", "3mm", "--count", "20"], "--depth: 3 mm between the end walls"),
        ([*DRUM, "--depth", "3mm"], "give at least 6.4 mm"),
        (["simulate", *DRUM[1:4], "--speed", "60000rpm", "--depth", "20mm"], "--speed: the drum's wall would move at"),
        ([*PILE, "--pour-rate", "0.1/s", "--count", "100"], "--pour-rate: 100 particles take 1000 s"),
        (["simulate", "packing", "--cylinder-height", "5mm"], "--cylinder-height: 5 mm hold no particles of 6.2 mm"),
        ([*PILE, "--outlet-height", "1mm"], "--outlet-height: 1 mm above the base"),
        ([*PILE, "--outlet-diameter", "95mm"], "--outlet-diameter: 95 mm is wider than the base of 90 mm"),
        (
            ["simulate", "pendulum", "--length", "6mm", "--release-angle", "45deg"],
            "--length: 6 mm from pivot",
        ),
        (["simulate", "pendulum", "--length", "30cm", "--release-angle", "179deg"], "more than 175; give less"),
        (["simulate", "drop", "--drop-height", "300mm", "--seed", "2"], "--seed: D6 is a sphere"),
        (
            ["simulate", "drop", "--drop-height", "9cm", "--particle", "C6_24s", "--turned", "30deg", "--seed", "1"],
            "--seed changes nothing beside --turned",
        ),
        ([*PILE, "--method", "emptying", "--rim-height", "3mm"], "has a wall, not a rim; leave it out"),
        (["compare", "x", "--runs", "0"], "--runs: is too small; give at least 1;"),
        (["compare", "x", "--runs", "two"], "--runs: is not a whole number;"),
        (["compare"], "LAB"),
        (["measure", "drop", "x.mp4", "--no-such-option"], "--no-such-option"),
    ],
)
def test_a_wrong_option_is_refused_with_its_name(arguments, word, capfd):
    refused(arguments, capfd, word)


def test_a_group_of_commands_alone_shows_its_help_page_line_by_line(capfd):
    assert run(["measure"]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert "\n  pendulum " in err


def test_a_misspelt_command_is_answered_in_one_sentence(capfd):
    refused(["measur", "drop"], capfd, "'measur'; did you mean 'measure'; see")
    refused(["export", "lammps", "drop"], capfd, "'drop'; there are packing, pile, drum, hopper, custom; see")


def test_a_fault_of_the_program_is_one_sentence_and_code_1(monkeypatch, capfd):
    import rigtwin.lab.file.lab_file

    def fall_over(folder):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(rigtwin.lab.file.lab_file, "new_lab", fall_over)
    assert run(["init", "lab"]) == 1
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "RIGTWIN_DEBUG" in err
    assert "Traceback" not in err


def test_the_traceback_of_a_fault_is_shown_on_demand(monkeypatch, capfd):
    import rigtwin.lab.file.lab_file

    def fall_over(folder):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(rigtwin.lab.file.lab_file, "new_lab", fall_over)
    monkeypatch.setenv("RIGTWIN_DEBUG", "1")
    assert run(["init", "lab"]) == 1
    assert "fall_over" in capfd.readouterr().err


def test_an_interrupt_ends_with_code_130(monkeypatch, capfd):
    import rigtwin.lab.file.lab_file

    def interrupted(folder):
        raise KeyboardInterrupt

    monkeypatch.setattr(rigtwin.lab.file.lab_file, "new_lab", interrupted)
    assert run(["init", "lab", "--json"]) == 130
    assert json.loads(capfd.readouterr().out)["error"]["type"] == "interrupted"


def test_an_interrupt_while_modules_load_ends_with_code_130_and_no_traceback(tmp_path):
    (tmp_path / "typer.py").write_text("import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(5)\n")
    begin = f"import rigtwin.__main__, sys; sys.path.insert(0, {str(tmp_path)!r}); rigtwin.__main__.main()"
    ended = subprocess.run([sys.executable, "-c", begin], capture_output=True, text=True, timeout=60, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")


def test_an_interrupted_twin_says_what_is_kept_and_the_next_run_where_it_goes_on(monkeypatch, capfd):
    stop = KeyboardInterrupt()
    stop.add_note("the run is kept up to t = 0.25 s in heap.npz; the same command goes on from there.")

    def twin(*_cast, progress, **_settings):
        progress("pouring", 1.0, 2.0)
        progress("pouring", 2.0, 2.0)
        raise stop

    monkeypatch.setattr("rigtwin.compare.twins.pile.pile_twin", twin)
    np.savez("heap.npz", words=np.array(json.dumps({"time_s": 0.25})))
    arguments = ["simulate", "pile", "--base-diameter", "90mm", "--checkpoint", "heap.npz"]
    assert run(arguments) == 130
    going_on, interrupted = capfd.readouterr().err.splitlines()
    assert going_on == "heap.npz is kept at t = 0.25 s; the run goes on from there."
    assert interrupted == f"rigtwin: interrupted; {stop.__notes__[0]}"


def test_init_makes_a_lab_file_that_is_never_overwritten(capfd):
    assert run(["init", "bench"]) == 0
    assert "rigtwin compare bench" in capfd.readouterr().out
    assert Path("bench/lab.toml").is_file()
    refused(["init", "bench"], capfd, "lab.toml")


def bounces(path: Path, restitution: float) -> Path:
    """A tracked drop from 0.3 m as CSV, without air."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fall = math.sqrt(2 * 0.3 / 9.81)
    rows, contact, speed = [], fall, 9.81 * fall
    time = np.arange(0, 0.75, 1 / 240)
    height = np.where(time < fall, 0.3 - 4.905 * time**2, 0.0)
    while contact < time[-1]:
        speed *= restitution
        since = time - contact
        height = np.where((since > 0) & (since < 2 * speed / 9.81), speed * since - 4.905 * since**2, height)
        contact += 2 * speed / 9.81
    rows = [f"{t:.6f},0,{y:.9f}" for t, y in zip(time, height, strict=True)]
    path.write_text("\n".join(["time_s,x_m,y_m", *rows]))
    return path


def measure_into(capfd, *arguments: object) -> Path:
    """The folder that `measure drop` wrote into."""
    assert run(["measure", "drop", *map(str, arguments), "--json"]) == 0
    return Path(json.loads(capfd.readouterr().out)["files"]["measurement"]).parent


def test_clips_of_one_name_never_write_into_the_same_folder(tmp_path, capfd):
    oak, ash = bounces(tmp_path / "oak/r01.csv", 0.6), bounces(tmp_path / "ash/r01.csv", 0.7)
    assert measure_into(capfd, oak) == Path("out/drop/r01")
    assert measure_into(capfd, ash) == Path("out/drop/r01~2")
    assert measure_into(capfd, oak) == Path("out/drop/r01")
    assert measure_into(capfd, oak, "--out", "mine") == Path("mine")
    assert measure_into(capfd, oak, "--out", "mine") == Path("mine"), "the same clip again replaces its own results"
    document = Path("mine/r01-measurement.json")
    kept = document.read_text()
    said = f"mine: holds results of {oak}, which would be lost; give --out another folder, or delete {document}."
    refused(["measure", "drop", str(ash), "--out", "mine"], capfd, said)
    with pytest.raises(BadInput, match=r"mine: holds results of .*oak/r01.csv, which would be lost; give out another"):
        rigtwin.measure("drop", ash, out="mine")
    assert document.read_text() == kept
    document.unlink()
    assert rigtwin.measure("drop", ash, out="mine").files["measurement"] == document
    refused(["measure", "drop", str(oak), "--out", "mine"], capfd, f"mine: holds results of {ash}")
    # another rig's results of the same clip
    refused(["measure", "pendulum", str(ash), "--out", "mine"], capfd, f"mine: holds results of {ash}")


def test_simulate_prints_one_json_document_with_the_restitution_that_was_put_in(capfd):
    arguments = ["simulate", "pendulum", "--length", "200mm", "--release-angle", "45deg", "--restitution", "0.7"]
    assert run([*arguments, "--out", "twin", "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    restitution = next(q for q in document["quantities"] if q["quantity"] == "restitution_pair")
    assert math.isclose(restitution["value"], 0.7, rel_tol=0.005)
    written = json.loads(Path("twin/quantities.json").read_text())
    assert written["quantities"] == document["quantities"]
    assert Path(document["files"]["record"]).read_text().startswith("time_s,x_m,y_m")


def test_a_clump_is_dropped_and_read_in_all_directions(capfd):
    drop = ["simulate", "drop", "--drop-height", "200mm", "--particle", "P6x15_5s", "--bounces", "1", "--json"]
    assert run([*drop, "--turned", "60deg", "--restitution", "0.6", "--out", "twin"]) == 0
    document = json.loads(capfd.readouterr().out)
    first = {q["method"]: q["value"] for q in document["quantities"] if q["quantity"] == "restitution_wall"}
    assert 0 < first["velocity"] < first["all directions"] < 0.6
    assert document["settings"]["rig"]["turned"] == pytest.approx(math.radians(60))
    assert any("turned by 60 degrees" in text for text in document["assumptions"])
    bodies = {line.rsplit(",", 1)[1] for line in Path(document["files"]["record"]).read_text().splitlines()[1:]}
    assert bodies == {"clump", "clump from the side"}


def test_a_bed_that_spilled_and_a_heap_that_moves_are_doubtful(capfd):
    bed = ["simulate", "packing", "--cylinder-diameter", "30mm", "--cylinder-height", "20mm", "--count", "90"]
    heap = ["simulate", "pile", "--base-diameter", "40mm", "--rim-height", "8mm", "--count", "60"]
    for arguments, why in ((bed, "did not stay"), ([*heap, "--settle-limit", "0.01s"], "still moving")):
        assert run([*arguments, "--out", arguments[1], "--json"]) == 0
        quantities = json.loads(capfd.readouterr().out)["quantities"]
        assert all(why in q["doubtful"] for q in quantities), quantities


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ("drop --drop-height 100mm --particle C6 --seed 3", "use only the methods by speeds"),
        ("pile --base-diameter 40mm --rim-height 8mm --count 60", "the mean of several heaps"),
        ("drum --drum-diameter 40mm --speed 60rpm --count 40", "give a longer record where these are few"),
        ("hopper --outlet 30mm --count 300 --duration 0.3s", "give a longer record"),
        ("tilt --variant slide --speed 12deg/s", "tilt the plate more slowly"),
    ],
)
def test_what_is_said_of_a_twin_s_record_does_not_speak_to_the_owner_of_a_film(arguments, word, capfd, tmp_path):
    assert run(["simulate", *arguments.split(), "--out", str(tmp_path), "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    said = [*document["warnings"], *(check["message"] for check in document["checks"])]
    said += [quantity["doubtful"] for quantity in document["quantities"] if "doubtful" in quantity]
    assert any(word in sentence for sentence in said), said
    assert not [sentence for sentence in said if re.search(r"\b(film|clip|photo|picture|camera|plot|screw)", sentence)]


def test_a_hopper_that_jams_gives_only_doubtful_numbers(capfd):
    assert run(["simulate", "hopper", "--outlet", "18mm", "--count", "150", "--out", "jammed", "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    reasons = {one["quantity"]: one.get("doubtful", "") for one in document["quantities"]}
    assert reasons.pop("opening_time") == ""
    assert {"discharge_time", "mass_flow_rate", "residue_fraction"} < set(reasons)
    for why in reasons.values():
        assert "of 150 beads had left" in why
        assert "arch over the outlet, which is 18 mm or 2.9 of their diameters wide" in why
    assert any("give a wider --outlet" in warning for warning in document["warnings"])


def test_a_hopper_that_keeps_beads_around_its_outlet_has_doubtful_times_and_a_sound_flow(capfd):
    flat = ["simulate", "hopper", "--outlet", "50mm", "--cone-height", "2mm", "--count", "400", "--out", "flat"]
    assert run([*flat, "--json"]) == 0
    reasons = {q["quantity"]: q.get("doubtful", "") for q in json.loads(capfd.readouterr().out)["quantities"]}
    for name in ("discharge_time", "discharge_time_5_95", "last_particle_time"):
        assert reasons[name].endswith("of 400 beads had left the hopper when the run ended")
    assert reasons["mass_flow_rate"] == reasons["residue_fraction"] == ""


def test_the_angle_of_a_handful_of_beads_in_a_drum_is_doubtful(capfd):
    arguments = ["--depth", "20mm", "--count", "20", "--turns", "0.5"]
    assert run([*DRUM, *arguments, "--out", "drum", "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    angles = [one for one in document["quantities"] if one["quantity"].startswith("angle_of_repose")]
    assert angles
    assert all("set by single beads" in one["doubtful"] for one in angles)


def test_a_checkpoint_of_another_run_is_refused_before_a_word_of_going_on(capfd):
    pile = ["simulate", "pile", "--base-diameter", "40mm", "--rim-height", "8mm", "--settle-limit", "0.01s"]
    pile += ["--checkpoint", "kept/heap.npz"]  # its folder is made, as that of --out is
    assert run([*pile, "--count", "40", "--out", "new/heap"]) == 0
    capfd.readouterr()
    refused([*pile, "--count", "41"], capfd, "another run (count: 40 there, 41 here)")
    refused([*pile, "--count", "40", "--base-diameter", "41mm"], capfd, "base diameter of the rig: 0.04 there")
    assert run([*pile, "--count", "40"]) == 0
    assert capfd.readouterr().err.count("the run goes on from there") == 1


def test_device_and_time_step_of_a_bulk_twin_can_be_said(capfd, monkeypatch):
    asked: dict[str, Any] = {}

    def twin(_rig, _cast, **given):
        asked.update(given)
        raise BadInput("seen")

    monkeypatch.setattr("rigtwin.compare.twins.pile.pile_twin", twin)
    pile = ["simulate", "pile", "--base-diameter", "90mm", "--rim-height", "10mm"]
    refused([*pile, "--device", "auto", "--time-step-fraction", "90%", "--force"], capfd, "seen")
    assert (asked["device"], asked["time_step_fraction"], asked["forced"]) == ("auto", 0.9, True)
    refused(pile, capfd, "seen")
    assert (asked["device"], asked["time_step_fraction"], asked["forced"]) == ("cpu", 0.3, False)


@pytest.mark.parametrize(
    ("rig", "options", "geometry", "settings"),
    [
        (
            "pile",
            "--base-diameter 90mm --fall-height 20mm --pour-rate 400/s --settle-limit 5s",
            {},
            {"fall_height": 0.02, "pour_rate": 400.0, "settle_limit": 5.0},
        ),
        ("pile", "--base-diameter 90mm --method pouring --fill-limit 5s", {}, {"fill_limit": 5.0}),
        (
            "packing",
            "--cylinder-height 80mm --fall-height 5cm --pour-rate 24000/min --settle-limit 5s --count 900",
            {"cylinder_height": 0.08, "fall_height": 0.05},
            {"pour_rate": 400.0, "settle_limit": 5.0},
        ),
        ("packing", "--hopper-diameter 90mm --fill-limit 5s", {"cylinder_height": 0.302}, {"fill_limit": 5.0}),
        ("drum", "--drum-diameter 90mm --speed 3rpm --fill-limit 5s", {}, {"fill_limit": 5.0}),
        (
            "hopper",
            "--outlet 30mm --cone-height 60mm --fill-limit 5s",
            {"cone_height": 0.06, "inclination": math.radians(60)},
            {"fill_limit": 5.0},
        ),
        (
            "hopper",
            "--variant slot --outlet 30mm --inclination 50deg --slide-angle 40deg --slide-drop 9cm --settle-limit 5s",
            {"inclination": math.radians(50), "slide_angle": math.radians(40), "slide_drop": 0.09},
            {"settle_limit": 5.0},
        ),
        (
            "tilt",
            "--variant slide --start-angle 5deg --plate-length 300mm",
            {"start_angle": math.radians(5), "plate_length": 0.3},
            {},
        ),
    ],
)
def test_what_a_rig_leaves_open_is_an_option(rig, options, geometry, settings, capfd, monkeypatch):
    asked: dict[str, Any] = {}

    def simulation(rig, *_cast, **given):
        asked.update(vars(rig) | given)
        raise BadInput("seen")

    module = "pile.pile" if rig == "pile" else rig
    monkeypatch.setattr(f"rigtwin.sim.{module}.run", simulation)
    refused(["simulate", rig, *options.split()], capfd, "seen")
    for name, value in {**geometry, **settings}.items():
        assert asked[name] == pytest.approx(value, rel=1e-12), name
    # what is not given is left to the rig
    assert set(asked) & {"fill_limit", "settle_limit"} == set(settings) & {"fill_limit", "settle_limit"}


def test_an_angle_without_its_unit_is_refused(capfd):
    refused(["simulate", "pendulum", "--length", "200mm", "--release-angle", "45"], capfd, "--release-angle", "45deg")


@pytest.mark.parametrize("folder", ["taken.mp4", "taken.mp4/results"])
def test_a_results_folder_that_is_a_file_is_refused_before_any_work(folder, tmp_path, capfd):
    (tmp_path / "taken.mp4").touch()
    refused(["measure", "drop", "x.mp4", "--out", folder], capfd, "--out", "taken.mp4 is a file", "another name")


def test_a_file_that_stands_where_results_go_is_refused_without_a_word_of_an_out_that_was_not_given(tmp_path, capfd):
    lab = lab_with(tmp_path)
    out = Path(lab) / "out"
    out.touch()
    for command in ("measure", "compare"):
        assert run([command, str(lab)]) == 2
        assert capfd.readouterr().err.startswith(
            f"rigtwin: {out} is a file, and results go into the folder {out}; move it"
        )


def test_a_photo_for_a_film_and_a_film_for_a_photo_are_named(empty_video, capfd):
    import cv2

    cv2.imwrite("photo.jpg", np.full((60, 80, 3), 120, np.uint8))
    refused(["measure", "drop", "photo.jpg"], capfd, "photo.jpg: is a picture (JPEG) and no film")
    refused(["measure", "pile", str(empty_video)], capfd, f"{empty_video}: is a film (MP4) and no photo")


def test_a_results_folder_without_a_name_is_refused(capfd):
    refused(["simulate", "drop", "--drop-height", "50mm", "--out", ""], capfd, "--out", "empty")
    assert not Path("quantities.json").exists()


def test_a_clip_without_its_rig_and_a_path_that_is_not_there_are_refused(tmp_path, capfd):
    (tmp_path / "mine").mkdir()
    Path("mine/a.mp4").touch()
    refused(
        ["measure", "mine/a.mp4"], capfd, "the rig", "is missing", "as in `rigtwin measure drop mine/a.mp4`; rigs are"
    )
    refused(["measure", "mine/b.mp4"], capfd, "mine/b.mp4: no such file or folder")
    refused(["measure", str(tmp_path / "nolab")], capfd, f"{tmp_path / 'nolab'}: no such file or folder")
    refused(["measure", "dorp", "mine/a.mp4"], capfd, "did you mean 'drop'")


def test_several_clips_of_a_rig_that_takes_one_are_refused_with_what_to_do(capfd):
    clips = [f"clip{number}.mp4" for number in range(60)]
    said = "measure tilt takes one clip, and 60 are given; for several make a lab, with `rigtwin init LAB`"
    refused(["measure", "tilt", "--variant", "slide", *clips, "--quiet"], capfd, said)
    refused(["measure", "drop", "a.mp4", "240Hz"], capfd, "extra argument(s) (240Hz)")
    for media in (clips, [clips]):
        with pytest.raises(BadInput, match=r"^measure drop takes one clip, and 60 are given; for several make a lab"):
            rigtwin.measure("drop", *media)
    with pytest.raises(BadInput, match=r"^measure drop: no media are given; give one clip"):
        rigtwin.measure("drop")


def test_twins_of_two_rigs_do_not_come_to_one_folder(capfd):
    drop = ["simulate", "drop", "--drop-height", "50mm", "--out", "both", "--quiet"]
    assert run(drop) == run(drop) == 0  # the same rig anew takes the place of what was there
    kept = Path("both/quantities.json").read_text()
    tilt = ["simulate", "tilt", "--variant", "slide", "--out", "both"]
    refused(tilt, capfd, "--out", "holds results of a drop", "a folder of its own")
    assert Path("both/quantities.json").read_text() == kept


def test_what_is_wrong_is_reported_once(capsys):
    sentence = "the centres are 18.78 mm apart at the collision, beads of 12.00 mm"
    pair = Quantity("restitution_pair", 0.9, 0.1, "1", "swing", doubtful=f"the camera shook; {sentence}")
    checks = (
        Check("contact_distance", False, 18.78, 12.0, f"{sentence}."),
        Check("gravity", False, 15.0, 9.81, "gravity is off."),
    )
    warnings = (f"{sentence}.", "gravity is off.", "the frame rate was read from the file.")
    camera = {"scale_m_per_px": 0.0008, "scale_from": "pendulum length"}
    show_measurement(Measurement("pendulum", Path("clip.mp4"), "", (pair,), checks, warnings, camera), False, False)
    printed = " ".join(capsys.readouterr().out.split())
    assert all(printed.count(each) == 1 for each in (sentence, "gravity is off", "warning: the frame rate was read"))
    assert "failed contact distance: as stated above" in printed


def test_a_results_folder_that_cannot_be_made_is_refused_before_any_work(tmp_path, monkeypatch, capfd):
    """On a read-only file system, which refuses files whatever the permissions of its folders."""

    def read_only(dir):  # noqa: A002, as `tempfile` calls it
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(dir))

    monkeypatch.setattr("rigtwin.commands.options.TemporaryFile", read_only)
    asked = ["measure", "drop", "x.mp4", "--out", str(tmp_path / "nope")]
    refused(asked, capfd, "--out", f"nothing may be written into {tmp_path}")
    assert not (tmp_path / "nope").exists()
    lab = lab_with(tmp_path)
    refused(["compare", lab], capfd, "--out", "nothing may be written into")
    refused(["measure", lab], capfd, "--out", "nothing may be written into")
    refused(
        ["sweep", "packing", "--set", "cylinder_diameter=50mm", "--vary", "static_friction=0.2..0.6"],
        capfd,
        "--out",
        "nothing may be written into",
    )


@pytest.mark.parametrize(("option", "file"), [("--checkpoint", "heap.npz"), ("--trajectory", "heap.gsd")])
def test_a_file_that_cannot_be_written_is_refused_before_any_work(option, file, tmp_path, capfd):
    (tmp_path / "taken").touch()
    (tmp_path / file).mkdir()
    asked = ["simulate", "pile", "--base-diameter", "90mm", option]
    refused([*asked, f"taken/{file}"], capfd, option, "taken is a file")
    refused([*asked, file], capfd, option, "is a folder")


def test_a_lab_gives_its_contacts_before_its_media_are_there(tmp_path, capfd):
    folder = lab_with(tmp_path)
    (folder / "r01.csv").unlink()
    assert run(["export", "liggghts", "--lab", str(folder)]) == 0
    assert "coefficientRestitution" in capfd.readouterr().out
    refused(["compare", str(folder)], capfd, "r01.csv", "there is no file")


@pytest.mark.usefixtures("started_engine")
def test_a_twin_that_does_not_fit_into_memory_is_refused(monkeypatch, capfd):
    def too_much(*arguments, **settings):
        raise MemoryError

    monkeypatch.setattr("rigtwin.compare.twins.drop.drop_twin", too_much)
    refused(["simulate", "drop", "--drop-height", "300mm"], capfd, "memory")


@pytest.mark.skipif(sys.platform == "win32", reason="closing a descriptor in the shell")
def test_a_twin_too_short_to_measure_gets_advice_on_its_settings(capfd):
    arguments = ["simulate", "drop", "--drop-height", "300mm", "--duration", "0.1s"]
    refused(arguments, capfd, "the twin of the drop gives nothing to measure", "try a higher frame rate")
    assert run(arguments) == 2
    assert "film" not in capfd.readouterr().err


@pytest.mark.parametrize(
    "rig", [["drop", "--drop-height", "300mm"], ["pendulum", "--length", "300mm", "--release-angle", "45deg"]]
)
def test_a_twin_of_a_million_seconds_is_refused_at_once(rig, capfd):
    refused(["simulate", *rig, "--duration", "1e6s"], capfd, "2.4e+08 frames", "shorter duration")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("tilt --variant slide --speed 0.003deg/s", ["frames at 240 Hz", "tilt it faster", "a frame rate of at most"]),
        (
            "tilt --variant slide --duration 1s",
            ["no run of the body down the plate was found", "try a longer duration"],
        ),
        ("packing --count 1", ["a count of 1 makes no bed", "one layer on the floor"]),
        ("hopper --outlet 30mm --count 1", ["a count of 1 is too small for a flow"]),
        ("hopper --outlet 30mm --count 60 --duration 0.05s", ["the flow continues; give a longer duration"]),
        ("drop --drop-height 300mm --restitution 0.01", ["try a higher frame rate, a greater drop height or"]),
        (
            "packing --cylinder-diameter 30mm --hopper-diameter 40mm --outlet-diameter 13mm --count 60",
            ["--outlet-diameter: ", "arch over the outlet, which is 13 mm or 2.1 of their diameters", "a wider one"],
        ),
        (
            "hopper --outlet 10mm --count 60",
            ["--outlet: ", "of 60 particles arch over the outlet, which is 10 mm or 1.6 of their", "a wider one"],
        ),
        (
            "hopper --outlet 30mm --cone-height 1mm --count 60",
            ["stay in the hopper around", "steeper walls"],
        ),
        (
            "pile --base-diameter 40mm --count 9 --pour-rate 20000/s",
            ["--pour-rate: 20000 particles per second", "a wider outlet"],
        ),
        ("packing --count 9 --pour-rate 90000/s", ["--pour-rate: 90000 particles per second leave", "give at most"]),
        ("packing --count 2000 --pour-rate 3.33/s", ["--pour-rate: 2000 particles take 600.6 s at 3.33", "3.334 per"]),
        (
            "pile --base-diameter 60mm --count 9 --pour-rate 0.01/s",
            ["--pour-rate: 9 particles take 900 s", "0.015 per"],
        ),
        (
            "packing --outlet-diameter 13mm --count 130000",
            ["--count: 130000 particles take ", "give fewer or a wider outlet"],
        ),
        (
            "packing --count 9 --fall-height 9m --cylinder-height 8m",
            ["--fall-height: after a fall of 17 m", "give a smaller height"],
        ),
        (
            "pile --base-diameter 60mm --count 9 --method pouring --lift-speed 100m/s",
            ["--lift-speed: the tube is lifted at 100 m/s", "lift it more slowly"],
        ),
        ("drum --drum-diameter 60mm --speed 3000rpm --depth 12mm --turns 0.5", ["--speed: ", "more slowly"]),
        ("drum --drum-diameter 60mm --speed 10rpm --depth 7mm --fill 0.85", ["--fill: 81 beads", "find room"]),
        ("pendulum --length 190mm --release-angle 120deg", ["try a higher frame rate, a greater length."]),
    ],
)
@pytest.mark.usefixtures("started_engine")
def test_a_twin_with_nothing_to_measure_names_the_setting_that_is_to_blame(arguments, words, capfd):
    # a twin that runs before it is refused runs once: that JSON says the same is shown where nothing is run
    refused(["simulate", *arguments.split(), "--quiet"], capfd, *words, as_json="--count 1" in arguments)


def test_results_are_written_even_when_nobody_listens(tmp_path):
    command = f"{sys.executable} -m rigtwin simulate drop --drop-height 100mm --frame-rate 1kHz --out twin >&-"
    done = subprocess.run(["sh", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "twin/quantities.json").is_file()


def test_progress_goes_to_a_file_as_a_line_now_and_then(capfd, monkeypatch):
    from rigtwin.commands import display

    def said(hidden, every):
        monkeypatch.setattr(display, "LOG_EVERY", every)
        with display.progress_bars(hidden) as tell:
            tell("running", 1, 4)
            tell("running", 2, 4)
        return capfd.readouterr().err

    assert said(False, 0.0) == "running: 25 %\nrunning: 50 %\n"
    assert said(False, 60.0) == ""
    assert said(True, 0.0) == ""


def test_a_comparison_shows_the_results_first_and_says_why_a_number_is_doubtful(capfd):
    from datetime import UTC, datetime

    from rigtwin.commands.display import show_comparison
    from rigtwin.compare.comparison import Comparison, Outcome
    from rigtwin.compare.deviation import deviations
    from rigtwin.compare.twins.twin import Twin
    from rigtwin.lab.file.lab_file import read_lab
    from rigtwin.lab.quantity import Evaluation, Quantity

    lab = read_lab(lab_with(Path.cwd()))
    found = [
        Quantity("restitution_wall", 0.42, 0.01, "1", "height", detail={"bounce": bounce}, doubtful="the plate moved")
        for bounce in (1, 2)
    ]
    twin = Twin("drop", Evaluation(tuple(found)), {})
    rows = deviations(lab.experiments[0].id, "drop", found, found)
    show_comparison(Comparison(lab, (Outcome(lab.experiments[0], (), (), (twin,), rows),), 1, datetime.now(UTC)))
    said = capfd.readouterr().out
    assert "bounce 1" in said
    assert "bounce 2" not in said
    assert "1 more" in said
    assert said.count("doubtful: drop-D6-steel: the plate moved") == 1
    assert "borrowed: contact D6-steel taken from" in said


@pytest.mark.usefixtures("started_engine")
def test_quiet_prints_nothing(capfd):
    arguments = ["simulate", "drop", "--drop-height", "100mm", "--frame-rate", "1kHz"]
    assert run([*arguments, "--out", "twin", "--quiet"]) == 0
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("arguments", "advice"),
    [
        (["measure", "drop", "x.mp4"], "shorter clip"),
        (["simulate", "drop", "--drop-height", "300mm"], "fewer particles"),
        (["compare", "."], "fewer experiments"),
    ],
)
def test_what_to_ask_less_of_fits_the_command_that_ran_out_of_memory(arguments, advice, monkeypatch, capfd):
    def short_of_memory(*_: object, **__: object) -> None:
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    monkeypatch.setattr("rigtwin.cli._command", lambda: short_of_memory)
    refused(arguments, capfd, advice)


@pytest.mark.parametrize("words", ["Virtual memory allocation (1073741824 B) failed.", "CUDA_ERROR: out of memory"])
def test_an_engine_that_finds_no_memory_is_no_fault_of_rigtwin(words, monkeypatch, capfd):
    def short_of_memory(*_: object, **__: object) -> None:
        raise RuntimeError(words)

    monkeypatch.setattr("rigtwin.cli._command", lambda: short_of_memory)
    refused(["simulate", "drop"], capfd, "does not fit into memory; ask for fewer particles")


def test_a_library_that_finds_no_memory_is_no_fault_of_rigtwin(monkeypatch, capfd):
    def not_loaded(*_: object, **__: object) -> None:
        raise ImportError("_ppoly.so: failed to map segment from shared object")

    monkeypatch.setattr("rigtwin.cli._command", lambda: not_loaded)
    refused(["measure", "drop", "x.mp4"], capfd, "_ppoly.so: cannot be loaded, for want of memory or because")


def test_a_full_disk_that_no_error_names_is_no_fault_of_rigtwin(monkeypatch, capfd):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("rigtwin.cli._command", lambda: full)
    refused(["measure", "drop", "x.mp4"], capfd, "no space left on device; free some space")


def test_two_runs_do_not_write_into_one_folder(empty_video, tmp_path, capfd):
    from rigtwin.commands.output_folder import claimed, results_folder

    with claimed(Path("results")):
        refused(["measure", "drop", str(empty_video), "--out", "results"], capfd, "another run of rigtwin is writing")
        arguments = ["simulate", "drop", "--drop-height", "300mm", "--out", "results"]
        refused(arguments, capfd, "another run of rigtwin is writing")
    with results_folder("drop", empty_video) as one, results_folder("drop", empty_video) as other:
        assert (one, other) == (Path("out/drop/wall"), Path("out/drop/wall~2"))
    assert not Path("out").exists()


@pytest.mark.parametrize("rig", ["drop", "hopper", "drum", "tilt --variant slide", "pendulum"])
@pytest.mark.parametrize(
    ("option", "value", "said"),
    [("--scale", "1e-300mm/px", "--scale: cannot be 1e-303"), ("--region", "1,2,3,4", "shows 3 x 4 px of the picture")],
)
def test_places_and_scales_beyond_any_use_are_refused(rig, option, value, said, empty_video, capfd):
    name, *more = rig.split()
    refused(["measure", name, str(empty_video), *more, option, value, "--out", "o"], capfd, said)


def test_a_decoder_without_a_thread_is_no_fault_of_rigtwin(monkeypatch, capfd):
    def no_thread(*_: object, **__: object) -> None:
        import av

        raise av.error.BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr("rigtwin.cli._command", lambda: no_thread)
    refused(["measure", "drop", "x.mp4"], capfd, "no further thread", "raise the limit")


def test_each_doubt_is_stated_once(tmp_path, capsys):
    photo = Path(__file__).parents[1] / "sample_media" / "pile" / "view1.jpg"
    stated = ["--base-diameter", "90mm", "--bead-diameter", "6.2mm", "--base", "250,600,700,595"]
    assert run(["measure", "pile", str(photo), *stated, "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.count("an end of the stated base lies") == 1
    assert said.count("of the stated base, so its geometric angle is too small") == 1
    assert said.count("beads look 1.30 times as large as stated") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="a pipe whose reader has left is not noticed there")
@pytest.mark.parametrize("asked", [["doctor", "--json"], ["measure", "pile", "view1.jpg", "--base-diameter", "90mm"]])
def test_a_reader_of_stdout_that_leaves_is_no_fault(asked, tmp_path):
    shutil.copy(Path(__file__).parents[1] / "sample_media" / "pile" / "view1.jpg", tmp_path)
    read, write = os.pipe()
    os.close(read)
    with subprocess.Popen(
        [sys.executable, "-m", "rigtwin", *asked], cwd=tmp_path, stdout=write, stderr=subprocess.PIPE
    ) as command:
        os.close(write)
        assert command.stderr is not None
        said = command.stderr.read().decode()
    assert command.returncode == 0, said
    assert "Traceback" not in said


def test_friction_beyond_that_of_any_material_is_refused(capsys):
    asked = ["simulate", "tilt", "--variant", "slide", "--static-friction", "36"]
    assert run(asked) == 2
    assert "static-friction: 36 is out of range; it must be at least 0 and at most 10" in capsys.readouterr().err


def test_a_refusal_holds_no_sign_that_a_terminal_takes_as_a_command(tmp_path, capsys):
    assert run(["measure", "drop", str(tmp_path / "red\x1b[31m\udc80.csv")]) == 2
    said = capsys.readouterr().err
    assert r"red\x1b[31m\udc80.csv: no such file" in said
    assert said.rstrip("\n").isprintable()
