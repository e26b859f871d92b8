"""The paper by calibration; a closed form takes the place of the twins."""

import json
from dataclasses import asdict

import numpy as np
import pandas as pd
import pytest

from rigtwin.cli import run
from rigtwin.compare.reproduce.calibrated import PARTICLES, lab_text
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.reference import hlosta2020

SCALE, STATIC = 1.02, 0.45


def closed_form(*, rig, rig_settings, particle, contacts, seed, **_):
    """Twins that agree with the paper's D6 at a size of 1.02, static friction of 0.45 and rolling friction of 0.05."""
    pair = next(one for one in contacts if one["pair"][0] == one["pair"][1])
    off = np.random.default_rng(seed).normal()
    slope = np.log(pair["rolling_friction"] / 0.05) + 4 * (pair["static_friction"] - STATIC)
    scale = particle["diameter"] / 6.2e-3
    large = rig_settings.get("base_diameter") == 0.15
    graphical, geometric = (21.7, 36.4) if large else (30.3, 28.2)
    bed = 0.184 * (1 + 3 * (scale - SCALE) + 0.02 * (pair["static_friction"] - STATIC)) + 3e-4 * off
    found = {
        "packing": [Quantity("bed_height", bed, 0, "m", "surface bead tops")],
        "pile": [
            Quantity("angle_of_repose_graphical", graphical + 3 * slope + off, 0, "deg", "line 15-85 %, above the rim"),
            Quantity("angle_of_repose_geometric", geometric + 2 * slope + off, 0, "deg", "apex, above the rim"),
        ],
        "drum": [
            Quantity("angle_of_repose_graphical", 37.1 + 2 * slope + off, 0, "deg", "line, middle half"),
            Quantity("angle_of_repose_geometric", 39.4 + 2 * slope + off, 0, "deg", "chord, wall to wall"),
        ],
        "hopper": [Quantity("discharge_time", 2.8, 0, "s", "given to last loss")],
    }
    return {"quantities": [asdict(one) for one in found[rig]], "warnings": [], "wall_s": 0.0}


@pytest.mark.usefixtures("in_this_process")
def test_a_particle_of_the_paper_is_calibrated_and_predicts_what_was_held_out(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", closed_form)
    asked = ["reproduce", "hlosta2020", "--calibrated", "--particle", "D6", "--budget", "51", "--out", str(tmp_path)]
    assert run([*asked, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    sets = {row["parameter"]: row for row in found["sets"]}
    assert sets["scale"]["low"] < SCALE < sets["scale"]["high"]
    assert sets["scale"]["paper"] == 1.0
    assert sets["static_friction"]["paper"] == hlosta2020.contact("D6", "D6").static_friction
    cells = pd.read_csv(tmp_path / "calibrated.csv").set_index(["experiment", "quantity"])
    assert len(cells) == 8
    assert set(cells.index[cells.held_out].get_level_values(0)) == {"piling-150", "hopper"}
    bed = cells.loc["packing", "bed_height"]
    assert (bed.unit, bed.paper_experiment, bed.paper_dem) == ("mm", 184, 174)
    assert bed.ours == pytest.approx(184, abs=1.5)
    assert bool(bed.within_std) == (abs(bed.ours - 184) <= 1.3)
    discharge = cells.loc["hopper", "discharge_time"]
    assert discharge.ours_percent_deviation == pytest.approx(100 * (2.8 / 2.72 - 1))
    assert found["scores"]["discharge_times_within_10_percent"] == 1
    assert found["scores"]["fitted"] == 5


def test_every_particle_has_a_lab_that_can_be_read(tmp_path):
    for name in PARTICLES:
        (tmp_path / "lab.toml").write_text(lab_text(name), encoding="utf-8")
        lab = read_lab(tmp_path)
        assert [one.id for one in lab.experiments] == ["tilt", "packing", "piling-90", "piling-150", "drum", "hopper"]
        assert all(one.measured for one in lab.experiments)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (["--calibrated", "--table", "14"], "--table: does not go with --calibrated"),
        (["--calibrated", "--particle", "D7"], "'D7' is not calibrated here"),
        (["--particle", "D6"], "--particle: belongs to --calibrated"),
        (["--calibrated", "--particle", "D6", "--budget", "20"], "20 runs are too few"),
    ],
)
def test_options_that_do_not_go_together_are_refused(more, why, tmp_path, capsys):
    assert run(["reproduce", "hlosta2020", *more, "--out", str(tmp_path)]) == 2
    assert why in capsys.readouterr().err
