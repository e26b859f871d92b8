"""Calibration: emulators, posterior, and parameters recovered from a lab of simulated records."""

import json
from dataclasses import asdict

import numpy as np
import pandas as pd
import pytest

from rigtwin.benchmarks.calibrate.recovery import make_lab
from rigtwin.cli import run
from rigtwin.compare.campaign import emulator as emulators
from rigtwin.compare.campaign.posterior import Parameter, Posterior, Target, sample
from rigtwin.lab.file.model_file import read_model
from rigtwin.lab.quantity import Quantity


@pytest.fixture(scope="module")
def design():
    return np.random.default_rng(3).random((24, 2))


def test_an_emulator_gives_values_between_its_runs_and_knows_its_uncertainty(design):
    random = np.random.default_rng(4)

    def truth(unit):
        return 30 + 10 * np.sin(2 * unit[:, 0]) + 2 * unit[:, 1]

    fitted = emulators.fit(design, truth(design) + random.normal(0, 0.2, len(design)), seed=1)
    elsewhere = random.random((200, 2))
    mean, spread = fitted.predict(elsewhere)
    assert np.mean(np.abs(mean - truth(elsewhere)) < 2 * np.hypot(spread, 0.05)) > 0.85
    assert fitted.noise == pytest.approx(0.2, rel=0.5)
    first, second = emulators.main_effects(fitted, 2, seed=1)
    assert first > 0.8
    assert second < 0.2


def test_one_quantity_of_two_parameters_leaves_a_ridge_and_a_second_one_ends_it(design):
    parameters = [Parameter("a", 0.1, 0.5), Parameter("b", 0.1, 0.5)]
    both = emulators.fit(design, design.sum(axis=1), seed=1)
    other = emulators.fit(design, design[:, 0] - design[:, 1], seed=1)
    known = Target("heap", "angle", "line", "deg", 1.0, 0.02, 5)
    samples, _, _ = sample(Posterior(parameters, [known], [both], np.eye(1)), seed=1)
    assert np.corrcoef(samples.T)[0, 1] < -0.95
    assert np.std(samples[:, 0]) > 0.2
    second = Target("bed", "height", "top", "m", 0.2, 0.02, 5)
    samples, _, _ = sample(Posterior(parameters, [known, second], [both, other], np.eye(2)), seed=1)
    assert samples.mean(axis=0) == pytest.approx([0.6, 0.4], abs=0.02)
    assert np.std(samples[:, 0]) < 0.03


def test_a_measured_coefficient_is_a_prior_and_a_wide_range_is_logarithmic():
    known, wide = Parameter("a", 0.1, 0.5, 0.3, 0.02), Parameter("b", 0.003, 0.5)
    unit = np.linspace(0, 1, 101)
    assert known.value(unit[[int(np.argmax(known.log_prior(unit)))]]) == pytest.approx(0.3, abs=0.01)
    assert wide.value(np.array([0.5]))[0] == pytest.approx(np.sqrt(0.003 * 0.5))
    assert not wide.log_prior(unit).any()


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rigtwin.benchmarks.calibrate.recovery.small", lambda _usual, smoke: smoke)
        make_lab(folder, {"static_friction": 0.5, "rolling_friction": 0.05}, 1, "rigtwin")
    return folder


def test_a_lab_of_one_bed_is_calibrated_and_the_ambiguity_is_named(lab, tmp_path, capsys):
    asked = ["calibrate", str(lab), "--budget", "17", "--fit", "static_friction", "--fit", "rolling_friction"]
    assert run([*asked, "--json", "--out", str(tmp_path)]) == 0
    found = json.loads(capsys.readouterr().out)
    for name, value in {"static_friction": 0.5, "rolling_friction": 0.05}.items():
        assert found["intervals"][name]["low"] < value < found["intervals"][name]["high"]
    assert found["fits"]
    assert found["ambiguous"], "one bed height does not separate two frictions"
    bed, *curves = found["predictions"]
    assert abs(bed["percent_deviation"]) < 3
    assert {row["quantity"] for row in curves} == {"outline of the bed"}
    model = read_model(tmp_path / "model.toml")
    assert model.known_contact("D6", "D6").static_friction == pytest.approx(found["best"]["static_friction"])
    assert list(pd.read_csv(tmp_path / "posterior.csv").columns) == ["static_friction", "rolling_friction"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rigtwin.compare.campaign.campaign.perform", None)  # nothing is run again
        assert run([*asked, "--json", "--out", str(tmp_path)]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["best"] == found["best"]


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (["--hold-out", "packing"], "nothing to fit"),
        (["--hold-out", "heap"], "no experiment 'heap'"),
        (["--fit", "lift_speed"], "no experiment that is fitted depends on 'lift_speed'"),
        (["--fit", "static_friction=0.5..0.1"], "the lower value first"),
        (["--fit", "restitution"], "was not measured; give its range"),
        (["--budget", "3"], "too few"),
    ],
)
def test_bad_input_is_one_sentence(more, why, lab, tmp_path, capsys):
    assert run(["calibrate", str(lab), *more, "--out", str(tmp_path / "out")]) == 2
    assert why in capsys.readouterr().err


ONE_RIG = """
[[experiments]]
id = "drum"
rig = "drum"
particle = "D6"
wall = "PMMA"
drum_diameter = "100 mm"
depth = "30 mm"
fill = 0.35
speed = "6 rpm"
[experiments.measured]
angle_of_repose_geometric = "33 +- 0.6 deg (n = 5)"
"""


def closed_form(*, rig, contacts, seed, **_):
    """A drum shows the product of two frictions, a bed the first of them, and a heap neither."""
    static, rolling = next(
        (one["static_friction"], one["rolling_friction"]) for one in contacts if one["pair"] == ["D6", "D6"]
    )
    off = 0.2 * np.random.default_rng(seed).normal()
    angle = 33 + 4 * np.log(static * rolling / 0.02) + off
    found = {
        "drum": [Quantity("angle_of_repose_geometric", angle, 0.1, "deg", "chord, wall to wall")],
        "packing": [Quantity("bed_height", 0.05 + 0.02 * static + 1e-3 * off, 1e-4, "m", "surface bead tops")],
        "pile": [Quantity("angle_of_repose_geometric", 30 + off, 0.1, "deg", "apex")],
    }
    return {"quantities": [asdict(one) for one in found.get(rig, [])], "warnings": [], "wall_s": 0.0}


@pytest.mark.usefixtures("in_this_process")
def test_the_experiment_that_separates_equally_good_sets_is_found(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", closed_form)
    (tmp_path / "lab.toml").write_text(ONE_RIG, encoding="utf-8")
    assert run(["calibrate", str(tmp_path), "--budget", "45", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert any("cannot be separated" in sentence for sentence in found["ambiguous"])
    best, *others = found["next_experiments"]
    assert best["quantity"] == "bed_height"
    assert best["apart"] > 5
    assert all(row["apart"] < 2 for row in others), "the heap does not depend on either friction"
    page = (tmp_path / "calibration" / "calibration.html").read_text(encoding="utf-8")
    assert "Experiments that would separate" in page
    assert "screening" in " ".join(path.name for path in (tmp_path / "calibration").iterdir())
    assert run(["calibrate", str(tmp_path), "--budget", "17", "--json"]) == 0
    (said,) = (one for one in json.loads(capsys.readouterr().out)["remarks"] if "--budget" in one)
    assert "further experiment" in said


@pytest.mark.usefixtures("in_this_process")
def test_a_parameter_that_nothing_measured_depends_on_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", closed_form)
    (tmp_path / "lab.toml").write_text(ONE_RIG, encoding="utf-8")
    asked = ["calibrate", str(tmp_path), "--fit", "static_friction", "--fit", "wall_restitution=0.1..0.9"]
    assert run([*asked, "--budget", "15", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert "wall_restitution is not determined: no measured quantity depends on it visibly" in found["ambiguous"]


BED = """
[[experiments]]
id = "bed"
rig = "packing"
particle = "D6"
wall = "steel"
cylinder_diameter = "50 mm"
count = 400
[experiments.measured]
bed_height = "60 +- 1 mm (n = 5)"
"""


@pytest.mark.usefixtures("in_this_process")
def test_contacts_of_a_kind_are_named_with_their_pair(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", closed_form)
    (tmp_path / "lab.toml").write_text(ONE_RIG + BED, encoding="utf-8")
    assert run(["calibrate", str(tmp_path), "--fit", "wall_static_friction"]) == 2
    assert "static_friction@D6-PMMA, static_friction@D6-steel" in capsys.readouterr().err
    wanted = ("static_friction", "rolling_friction", "static_friction@D6-steel=0.1..0.9")
    asked = [word for name in wanted for word in ("--fit", name)]
    assert run(["calibrate", str(tmp_path), *asked, "--budget", "30", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["best"]["static_friction"] == pytest.approx(0.5, abs=0.05)
    model = read_model(tmp_path / "calibration" / "model.toml")
    assert model.known_contact("steel", "D6").static_friction == found["best"]["static_friction@D6-steel"]
