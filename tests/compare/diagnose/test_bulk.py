"""Diagnosis of labs with many particles: verdicts by twins of a closed form, and real twins of a few beads."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rigtwin.cli import run
from rigtwin.compare.campaign.run import Done
from rigtwin.compare.diagnose.bulk import further_experiment, twin_design
from rigtwin.compare.diagnose.diagnose_folder import diagnose_folder
from rigtwin.compare.diagnose.diagnosis import Diagnosis
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file.model_file import read_model
from rigtwin.lab.quantity import Quantity

PARTICLES = {
    "diameter_m": 0.006, "diameter_uncertainty_m": 5e-5, "density_kg_m3": 1768.0, "youngs_modulus_Pa": 1e7,
    "poissons_ratio": 0.3,
}  # fmt: skip
CONTACT = {
    "restitution_pp": 0.8, "restitution_pw": 0.6, "static_friction_pp": 0.4, "static_friction_pw": 0.4,
    "rolling_friction": None, "friction_uncertainty": 0.02,
    "rolling_friction_note": "limit torque = rolling_friction * R_eff * normal force",
}  # fmt: skip
PILES = [
    {"name": f"base{base}", "base_diameter_m": base / 1000, "rim_height_m": 0.005, "cylinder_inner_diameter_m": 0.06,
     "particle_count": 600, "lift_speed_m_s": 0.15, "repetitions": 3}
    for base in (90, 120)
]  # fmt: skip
BEDS = [
    {"name": f"bed{width}", "rig": "packing", "cylinder_inner_diameter_m": width / 1000, "particle_count": 500,
     "repetitions": 3}
    for width in (50,)
]  # fmt: skip


def pile_law(base: float, mu: float, rolling: float, lift: float = 1.0) -> tuple[float, float, float]:
    """Height of a heap [m], curvature of its flanks [1] and beads that stay: a law that no simulation gives."""
    tall = 0.25 * base * (1 + 0.5 * math.log(mu / 0.4) + 3.0 * rolling) * (1 - 0.1 * math.log(lift))
    return tall, 0.3 + 0.6 * math.log(mu / 0.4) - 4.0 * rolling * base / 0.1, 450 * (1 + 0.4 * rolling)


def outline(base: float, tall: float, bend: float, rim: float = 0.005) -> tuple[np.ndarray, np.ndarray]:
    x = np.linspace(-base / 2, base / 2, 201)
    part = 1 - np.abs(2 * x / base)
    return x, rim + tall * (part + 0.3 * bend * part * (1 - part))


def twin(settings: dict) -> dict:
    """Result of a run by the law, with the scatter of its seed."""
    random = np.random.default_rng([settings["seed"], len(str(settings))])
    bead, rig = dict(settings["particle"]), settings["rig_settings"]
    bead["density"] = bead["density"] or bead["material"]["density"]
    _wall, like = settings["contacts"]
    found = {
        "rig": settings["rig"], "quantities": [], "checks": [], "warnings": [], "assumptions": [], "profiles": [],
        "series": [], "wall_s": 0.1, "settings": {"particle": bead},
    }  # fmt: skip
    loose = 1 + 0.05 * math.log(like["static_friction"] / 0.4) + 1.2 * like["rolling_friction"]
    loose += 1e-7 * settings["effects"].get("cohesion_sjkr", {}).get("energy_density", 0.0)
    if settings["rig"] == "packing":
        height = 0.06 * loose * (bead["diameter"] / 0.006) ** 3 * random.normal(1, 0.004)
        found["settings"]["surface_height_m"] = height
        found["quantities"] = [asdict(Quantity("bed_height", height, 1e-4, "m", "mean surface"))]
        return found
    tall, bend, stay = pile_law(
        rig["base_diameter"], like["static_friction"], like["rolling_friction"], (rig["lift_speed"] or 0.15) / 0.15
    )
    tall *= 1 + 2e-6 * settings["effects"].get("cohesion_sjkr", {}).get("energy_density", 0.0)
    x, height = outline(rig["base_diameter"], tall * random.normal(1, 0.01), bend + random.normal(0, 0.02))
    found["profiles"] = [{"base": [-rig["base_diameter"] / 2, rig["base_diameter"] / 2], "view": "0"}]
    found |= {"profile_1_x": x, "profile_1_height": height, "profile_1_sigma": 0 * x}
    found["settings"] |= {
        "placed": 600, "fallen": round(600 - stay * random.normal(1, 0.01)),
        "bed_height_m": 0.04 * loose * random.normal(1, 0.004),
    }  # fmt: skip
    return found


@pytest.fixture
def by_law(monkeypatch):
    """Twins by the law; the list of runs that were asked for."""
    asked = []

    def results(runs, campaign, progress, stage):
        asked.extend(runs)
        known = [one for one in runs if one.settings["rig"] in ("pile", "packing")]
        return Done({one.name: twin(dict(one.settings)) for one in known}, {})

    monkeypatch.setattr(twin_design, "results_of", results)
    monkeypatch.setattr(further_experiment, "results_of", results)
    return asked


def write(folder: Path, conditions: list, mu: float = 0.4, rolling: float = 0.0, roll: float = 0.0, **changed) -> Path:
    """A lab made by the law."""
    random = np.random.default_rng(5)
    for one in conditions:
        for k in range(one["repetitions"]):
            place = folder / one["name"] / f"rep{k + 1:02d}"
            place.mkdir(parents=True)
            loose = 1 + 0.05 * math.log(mu / 0.4) + 0.6 * rolling  # in the lab's convention of rolling friction
            results = {"total_mass_g": 1e3 * one["particle_count"] * 1768 * math.pi / 6 * 0.006**3}
            if "base_diameter_m" in one:
                base = one["base_diameter_m"]
                tall, bend, stay = pile_law(base, mu, rolling / 2)
                x, height = outline(base, tall * random.normal(1, 0.012), bend + random.normal(0, 0.03))
                turned = x * math.cos(roll) + height * math.sin(roll), height * math.cos(roll) - x * math.sin(roll)
                rows = np.column_stack(turned) + [0, 1] * random.normal(0, 1e-4, (len(x), 2))
                np.savetxt(place / "profile.csv", rows, "%.6f", ",", header="x_m,height_m", comments="")
                results |= {"particles_on_base": round(stay), "bed_height_m": 0.04 * loose + 0.0018}
            else:
                results |= {"bed_height_m": 0.06 * loose * random.normal(1, 0.004) + 0.0018}
            (place / "results.json").write_text(json.dumps(results))
    document = {
        "case": "by law", "rig": "pile", "particles": PARTICLES, "contact": CONTACT, "camera": {},
        "conditions": conditions,
    } | changed  # fmt: skip
    (folder / "lab.json").write_text(json.dumps(document))
    return folder


def test_a_lab_that_agrees_with_its_twins_has_no_effect(tmp_path, by_law):
    _found, files = diagnose_folder(write(tmp_path / "lab", PILES), tmp_path / "out")
    said = json.loads(files["diagnosis.json"].read_text())
    assert (said["verdict"], said["effects"]) == ("none", [])
    assert "rolling resistance" in said["next_experiment"]  # the smallest one that would have shown
    assert len(by_law) <= 40 * len(PILES)


def test_the_documentation_describes_each_key_of_the_document(tmp_path, by_law):
    found, _files = diagnose_folder(write(tmp_path / "lab", PILES), tmp_path / "out")
    text = (Path(__file__).parents[3] / "docs" / "diagnosis.md").read_text()
    table = text.split("## The file diagnosis.json")[1].split("## ")[0]
    rows = [row for row in table.splitlines() if row.startswith("| `")]
    described = {key for row in rows for key in re.findall(r"`(\w+)`", row.split(" | ")[0])}
    of_single_bodies = Diagnosis(
        SimpleNamespace(title="", rig="drop", folder=tmp_path, conditions=()), "none", ""
    ).to_json()
    assert described == set(found.to_json()) == {"twins", *of_single_bodies}


def test_missing_rolling_resistance_is_named_with_its_coefficient_and_enters_the_model(tmp_path, by_law):
    lab = write(tmp_path / "lab", [*PILES, *BEDS], rolling=0.16)
    found, files = diagnose_folder(lab, tmp_path / "out")
    assert found.verdict == "named"
    [effect] = found.to_json()["effects"]
    assert effect["effect"] == "rolling_resistance"
    assert effect["parameters"]["rolling_friction"]["value"] == pytest.approx(0.16, abs=0.04)
    # the lab counts with the effective radius, half of a bead's own between beads
    model = read_model(files["model.toml"])
    assert model.contact("bead", "bead").rolling_friction == pytest.approx(
        model.contact("bead", "wall").rolling_friction / 2
    )
    assert found.gap.before > 3 * found.gap.after
    assert found.gap.condition_before > 2 > found.gap.condition_after
    assert "rolling resistance" in files["diagnosis.html"].read_text()


def test_a_rolled_camera_is_named_without_any_twin_of_it(tmp_path, by_law):
    found, _ = diagnose_folder(write(tmp_path / "lab", PILES, roll=math.radians(4)), tmp_path / "out")
    [effect] = found.to_json()["effects"]
    assert (found.verdict, effect["effect"], effect["kind"]) == ("named", "camera_roll", "measurement")
    assert effect["parameters"]["angle"]["value"] == pytest.approx(math.radians(4), abs=0.01)
    assert not any("camera_roll" in one.name for one in by_law)


def test_two_names_that_one_bed_cannot_tell_apart_come_with_an_experiment_that_does(tmp_path, by_law):
    conditions = [{**BEDS[0], "repetitions": 4}]
    found, _ = diagnose_folder(write(tmp_path / "lab", conditions, rolling=0.3, rig="packing"), tmp_path / "out")
    said = found.to_json()
    assert said["verdict"] == "indistinguishable"
    assert "rolling_resistance" in said["indistinguishable"][0]
    assert "standard deviations" in said["next_experiment"]
    assert said["designs"][0]["separation_sigma"] > 0


def notebook(folder: Path) -> Path:
    """The same piles as a lab.toml with tables of profiles."""
    experiments = "".join(
        f"""
[[experiments]]
id = "{one["name"]}"
rig = "pile"
variant = "pouring"
particle = "bead"
wall = "plate"
base_diameter = "{1e3 * one["base_diameter_m"]:g} mm"
rim_height = "5 mm"
tube_diameter = "60 mm"
lift_speed = "0.15 m/s"
count = 600
repetitions = [{", ".join(f'"{one["name"]}/rep{k:02d}/profile.csv"' for k in (1, 2, 3))}]
"""
        for one in PILES
    )
    materials = "".join(
        f"[materials.{name}]\ndensity = 1768\nyoungs_modulus = 1e7\npoisson_ratio = 0.3\n"
        for name in ("plastic", "plate")
    )
    (folder / "lab.json").unlink()
    (folder / "lab.toml").write_text(
        f"""[lab]
title = "the same piles"
{materials}
[particles.bead]
material = "plastic"
diameter = "6 mm"
[contacts.bead-bead]
restitution = 0.8
static_friction = 0.4
rolling_friction = 0.0
[contacts.bead-plate]
restitution = 0.6
static_friction = 0.4
rolling_friction = 0.0
{experiments}"""
    )
    return folder


@pytest.mark.usefixtures("in_this_process")
def test_piles_of_a_lab_toml_are_diagnosed_too(tmp_path, by_law):
    found, _ = diagnose_folder(notebook(write(tmp_path / "lab", PILES, roll=math.radians(4))), tmp_path / "out")
    assert (found.verdict, found.naming.best.names) == ("named", ("camera_roll",))
    found, _ = diagnose_folder(
        notebook(write(tmp_path / "other", PILES, rolling=0.3)), tmp_path / "other-out", only=["base90"]
    )
    assert "rolling_resistance" in {name for one in found.naming.tried[:5] for name in one.names}
    assert [one.name for one in found.lab.conditions] == ["base90"]


@pytest.mark.usefixtures("in_this_process")
def test_experiments_of_a_lab_toml_with_other_rigs_are_left_out_with_a_word(tmp_path, by_law):
    lab = notebook(write(tmp_path / "lab", PILES))
    with (lab / "lab.toml").open("a") as file:
        file.write(
            '[[experiments]]\nid = "fall"\nrig = "drop"\nparticle = "bead"\nwall = "plate"\n'
            'drop_height = "200 mm"\nrepetitions = ["base90/rep01/results.json"]\n'
        )
    found, _ = diagnose_folder(lab, tmp_path / "out")
    assert "fall: a drop is not diagnosed together with base90; ask for it with --only fall" in found.left_out


def test_different_coefficients_of_rolling_friction_are_changed_by_one_factor(tmp_path, by_law):
    contact = CONTACT | {"rolling_friction_pp": 0.12, "rolling_friction_pw": 0.03}
    diagnose_folder(write(tmp_path / "lab", PILES, rolling=0.12, contact=contact), tmp_path / "out")
    pairs = {tuple(one["rolling_friction"] for one in run.settings["contacts"]) for run in by_law}
    assert len(pairs) >= 4
    assert all(like / wall == pytest.approx(0.06 / 0.03) for wall, like in pairs)  # R_eff is half of a bead's radius


def test_keys_that_are_not_understood_are_listed(tmp_path, by_law):
    lab = write(tmp_path / "lab", PILES)
    spoil(lab, lambda d: d["conditions"][0].update(ground_height_m=0.02))
    spoil(lab, lambda d: d["contact"].update(rolling_fricton=0.1))
    _found, files = diagnose_folder(lab, tmp_path / "out")
    left_out = json.loads(files["diagnosis.json"].read_text())["left_out"]
    assert {"base90: ground_height_m is not used", "contact: rolling_fricton is not used"} <= set(left_out)


def spoil(folder: Path, change: Callable[[dict], object]) -> None:
    document = json.loads((folder / "lab.json").read_text())
    change(document)
    (folder / "lab.json").write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["conditions"][0].pop("base_diameter_m"), "base diameter of the pile is missing"),
        (lambda d: d["conditions"][0].update(lift_speed_m_s="slow"), "lift_speed_m_s: 'slow' is not a number"),
        (lambda d: d["conditions"][0].update(base_diameter_m=-0.1), "base_diameter: -0.1 is impossible"),
        (lambda d: d["conditions"][0].update(repetitions=0), "repetitions: 0 is not a whole number"),
        (lambda d: d["conditions"][1].update(name="base90"), "'base90' is there twice"),
        (lambda d: d["conditions"][1].update(rig="drop"), "'drop' stands beside a rig of many particles"),
        (lambda d: d["contact"].pop("static_friction_pp"), "static_friction_pp (between particles) is missing"),
        (lambda d: d["contact"].update(restitution_pw=1.2), "restitution_pw: 1.2 is impossible"),
        (lambda d: d["contact"].update(rolling_friction="small"), "rolling_friction: 'small' is not a number"),
        (lambda d: d["conditions"][0].update(files="somewhere/rep"), "has no place for a number"),
        (lambda d: d["conditions"][0].update(files="rep%999999999999d"), "has no place for a number"),
        (lambda d: d["conditions"][0].update(files="../rep%02d"), "lies outside"),
        (lambda d: d["conditions"][0].update(repetitions=9), "has neither profile.csv nor a results.json"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(tmp_path, change, says):
    lab = write(tmp_path / "lab", PILES)
    spoil(lab, change)
    with pytest.raises(BadLabFile, match=re.escape(says)):
        diagnose_folder(lab, tmp_path / "out")


def test_the_command_refuses_a_table_without_its_columns_with_exit_code_2(tmp_path, capsys):
    lab = write(tmp_path / "lab", PILES)
    (lab / "base90" / "rep02" / "profile.csv").write_text("x,h\n" + "0,0\n" * 20)
    assert run(["diagnose", str(lab), "--out", str(tmp_path / "out")]) == 2
    assert "profile.csv: there is no column x_m" in capsys.readouterr().err


def test_two_repetitions_are_too_few(tmp_path):
    with pytest.raises(BadInput, match="2 repetitions in all; at least 3"):
        diagnose_folder(write(tmp_path / "lab", [{**PILES[0], "repetitions": 2}]), tmp_path / "out")


FEW = [{**PILES[0], "base_diameter_m": 0.05, "cylinder_inner_diameter_m": 0.03, "particle_count": 60}]


@pytest.mark.slow
def test_a_diagnosis_by_real_twins_that_was_killed_continues_from_its_store(tmp_path):
    lab = write(tmp_path / "lab", FEW)
    command = [sys.executable, "-m", "rigtwin", "diagnose", str(lab), "--out", str(tmp_path / "out"), "--json"]
    first = subprocess.Popen([*command, "--workers", "1"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    ledger = tmp_path / "out" / "runs" / "arrays"
    begun = time.monotonic()
    while time.monotonic() - begun < 200 and (not ledger.is_dir() or len(list(ledger.glob("*.npz"))) < 5):
        time.sleep(0.2)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    kept = {path: path.stat().st_mtime for path in ledger.glob("*.npz")}
    assert len(kept) >= 5
    done = subprocess.run([*command, "--workers", "1"], check=True, capture_output=True, text=True)
    said = json.loads(done.stdout)
    assert said["verdict"] in ("none", "named", "indistinguishable", "unlisted", "undecided")
    assert said["twins"] <= 60
    assert all(path.stat().st_mtime == when for path, when in kept.items())  # none was computed again
