"""Labs with particles of their own, through the command line: compared and swept like those of the reference."""

import csv
import json
import re
import shutil
from pathlib import Path

import pytest
import trimesh

from rigtwin.cli import run
from rigtwin.lab.file.lab_file import read_cast, read_lab

ROOT = Path(__file__).parents[2]
CONTACT = "restitution = 0.6\nstatic_friction = 0.4\nrolling_friction = 0.05\n"
LAB = """
[particles.ball]
material = "wood_ash"
stl = "ball.stl"
mass = "0.071 g"

[particles.peanut]
material = "wood_ash"
spheres = [["-1.5 mm", 0, 0, "5 mm"], ["1.5 mm", 0, 0, "5 mm"]]

[particles.gravel]
material = "wood_ash"
size_distribution = { law = "sieve", meshes = ["3 mm", "4 mm", "6 mm"], passing = [0, 30, 100] }

[[experiments]]
id = "photographed"
rig = "packing"
particle = "ball"
wall = "PMMA"
cylinder_diameter = "50 mm"
count = 530
repetitions = ["packing.jpg"]

[[experiments]]
id = "peanuts"
rig = "packing"
particle = "peanut"
wall = "PMMA"
cylinder_diameter = "30 mm"
total_mass = "5 g"
measured = { bed_height = "20 +- 1 mm (n = 5)" }

[[experiments]]
id = "gravel"
rig = "packing"
particle = "gravel"
wall = "PMMA"
cylinder_diameter = "30 mm"
total_mass = "5 g"
measured = { bed_height = "20 +- 1 mm (n = 5)" }

[[experiments]]
id = "one"
rig = "drop"
particle = "gravel"
wall = "PMMA"
drop_height = "200 mm"
measured = { restitution_wall = "0.6 +- 0.02 (n = 5)" }
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("own")
    trimesh.creation.icosphere(subdivisions=3, radius=3.1).export(folder / "ball.stl")
    shutil.copy(ROOT / "sample_media/seven_rigs/packing.jpg", folder)
    names = ("ball", "peanut", "gravel")
    pairs = [pair for name in names for pair in (f"{name}-{name}", f"{name}-PMMA")]
    (folder / "lab.toml").write_text(LAB + "".join(f"\n[contacts.{pair}]\n{CONTACT}" for pair in pairs))
    return folder


@pytest.fixture(scope="module")
def compared(lab, one_process) -> Path:
    with one_process():
        assert run(["compare", str(lab), "--out", str(lab / "out"), "--quiet"]) == 0
    return lab / "out"


def test_every_own_particle_is_compared(compared):
    rows = list(csv.DictReader((compared / "deviations.csv").read_text().splitlines()))
    simulated = {row["experiment"]: float(row["simulated"]) for row in rows if row["simulated"]}
    assert {"photographed", "peanuts", "gravel", "one"} <= simulated.keys()
    heights = {row["experiment"]: row for row in rows if row["quantity"] == "bed_height" and row["method"] != "outline"}
    # the photo shows 530 spheres of 6.2 mm, and the twin has as many balls from the STL file
    shown = heights["photographed"]
    assert float(shown["simulated"]) == pytest.approx(float(shown["measured"]), rel=0.1)


def test_a_weighed_filling_of_different_sizes_has_as_many_particles_as_weigh_it(lab, compared):
    twins = json.loads((compared / "provenance.json").read_text())["twins"]
    gravel = read_lab(lab).particles["gravel"]
    (settings,) = twins["gravel"]
    assert settings["asked"] == round(5e-3 / gravel.mean_mass)
    assert settings["particle"]["sizes"]["law"] == "sieved, 2 classes from 3 mm to 6 mm"


def test_the_report_says_what_stands_for_all_sizes_and_the_stl_file_is_an_input(compared):
    page = (compared / "report.html").read_text()
    assert "sieved, 2 classes from 3 mm to 6 mm: 3 to 6 mm, median by mass" in page
    assert "gravel is one particle of" in page
    assert "2 spheres" in page
    assert "particle ball: 1 sphere in place of ball.stl, within 0.0" in page
    inputs = {item["file"] for item in json.loads((compared / "provenance.json").read_text())["inputs"]}
    assert {"lab.toml", "ball.stl", "packing.jpg"} <= inputs


@pytest.mark.usefixtures("in_this_process")
def test_an_own_particle_is_swept(lab, tmp_path):
    asked = ["sweep", str(lab), "--only", "one", "--vary", "diameter=3mm,5mm", "--out", str(tmp_path), "--quiet"]
    assert run(asked) == 0
    rows = list(csv.DictReader((tmp_path / "sweep.csv").read_text().splitlines()))
    assert {round(1e3 * float(row["diameter"]), 6) for row in rows} == {3.0, 5.0}


# ---------------------------------------------------------------------- the page of the documents


PAGE = (ROOT / "docs/own_particles.md").read_text(encoding="utf-8")


def test_the_examples_of_the_page_are_read_and_its_command_runs(tmp_path, monkeypatch):
    blocks = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.S)
    folder = tmp_path / "my-lab"
    folder.mkdir()
    pebble = trimesh.creation.icosphere(subdivisions=3)
    pebble.vertices = pebble.vertices * [3.2, 2.4, 2.1]
    pebble.export(folder / "pebble.stl")
    contacts = "".join(f"[contacts.{pair}]\n{CONTACT}" for pair in ("pebble-pebble", "pebble-PMMA"))
    (folder / "lab.toml").write_text("\n".join([*blocks, contacts]), encoding="utf-8")
    particles = read_cast(folder).particles
    assert len(blocks) == 3
    assert list(particles) == ["peanut", "pebble", "gravel", "beads", "mixture", "pebbles"]
    assert len(particles["pebble"].radii) <= 12
    monkeypatch.chdir(tmp_path)
    (command,) = re.findall(r"```\nrigtwin (simulate .*)\n```", PAGE)
    smaller = command.replace("--count 400", "--count 24").replace("50mm", "25mm")
    assert run([*smaller.split(), "--out", "out", "--quiet"]) == 0
    settings = json.loads((tmp_path / "out" / "quantities.json").read_text())["settings"]
    assert settings["placed"] == 24
    assert settings["particle"]["name"] == "pebble"
