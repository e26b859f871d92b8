"""Figures of a diagnosis and calibration quantities far from their stated values: pendulums drawn by SciPy."""

import csv
import json
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from rigtwin.cli import app
from rigtwin.compare.diagnose.data.read_lab_json import read_tracked_lab
from rigtwin.compare.diagnose.diagnosis import diagnose
from rigtwin.compare.diagnose.figures import figures
from rigtwin.compare.diagnose.fitting.strained import STRAINED, in_words
from rigtwin.compare.diagnose.page import page
from rigtwin.compare.report.methods_text import Methods
from rigtwin.sim.effects import named

G, LENGTH, NOISE, MASS = 9.81, 0.25, 1e-4, 2e-4  # SI
ANGLES = (15, 30)  # [deg]


def write_pendulums(folder, *, scale=1.0, moment=0.0):
    """Swings of a bead of 6 mm, seen at a scale that is off, with a dry moment [N m] at the pivot."""
    rng = np.random.default_rng(5)
    for angle in ANGLES:
        (folder / f"a{angle}").mkdir(parents=True)
        for number in (1, 2, 3):

            def motion(_t, s):
                return [s[1], -G / LENGTH * math.sin(s[0]) - moment / (MASS * LENGTH**2) * math.tanh(s[1] / 1e-3)]

            start = math.radians(angle + rng.normal(0, 0.05))
            run = solve_ivp(motion, (0, 2), [start, 0.0], rtol=1e-9, atol=1e-11, max_step=0.01, dense_output=True)
            time = np.arange(0, 2, 1 / 120)
            swing = run.sol(np.maximum(time - 0.03, 0.0))[0]
            place = scale * LENGTH * np.column_stack([np.sin(swing), -np.cos(swing)])
            place += rng.normal(0, NOISE, place.shape)
            rows = [f"{t:.5f},{x:.6f},{y:.6f}" for t, (x, y) in zip(time, place, strict=True)]
            (folder / f"a{angle}" / f"rep{number:02d}.csv").write_text("time_s,x_m,y_m\n" + "\n".join(rows) + "\n")
    document = {
        "title": "pendulums", "rig": "pendulum", "gravity_m_s2": G,
        "camera": {"frame_rate_hz": 120, "tracking_noise_m": NOISE, "scale_uncertainty_rel": 0.002},
        "particles": {"bead": {"diameter_m": 0.006, "mass_g": 1e3 * MASS}},
        "conditions": [
            {"name": f"a{angle}", "bead": "bead", "length_m": LENGTH, "release_angle_deg": angle, "repetitions": 3}
            for angle in ANGLES
        ],
    }  # fmt: skip
    (folder / "lab.json").write_text(json.dumps(document))
    return folder


def numbers(text):
    return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(text.split())]


@pytest.fixture(scope="module")
def braked(tmp_path_factory):
    lab = write_pendulums(tmp_path_factory.mktemp("braked"), moment=2e-6)
    return diagnose(read_tracked_lab(lab), listed=[named("pivot_friction")])


def test_the_leading_figure_shows_the_gap_that_the_effect_closes(braked):
    drawn = figures(braked)
    assert list(drawn) == ["residual", "amplitude", "overview"]
    rows = [
        {name: float(value) for name, value in row.items()} for row in csv.DictReader(drawn["residual"].csv.split())
    ]
    measured, effect, noise = (
        np.array([row[name] for row in rows])
        for name in ("measured_minus_before_m", "effect_minus_before_m", "noise_of_mean_m")
    )
    # a moment of 2e-6 N m turns the bead by a degree in two seconds, which is 4 mm at its radius
    assert np.abs(measured).max() > 1e-3
    assert np.mean(((measured - effect) / noise) ** 2) == pytest.approx(1, abs=0.6)
    assert "time since the release [s]" in drawn["residual"].svg
    assert "twin with pivot friction" in drawn["residual"].svg


def test_the_amplitude_falls_by_four_moments_over_the_weight_in_a_period(braked):
    rows = numbers(figures(braked)["amplitude"].csv)
    assert len(rows) >= 4
    lost = math.degrees(2 * 2e-6 / (MASS * G * LENGTH))  # in half a period, closed form for small angles
    steps = np.diff([row["measured_deg"] for row in rows])
    assert np.mean(steps) == pytest.approx(-lost, rel=0.1)
    assert all(abs(row["measured_deg"] - row["effect_deg"]) < 5 * row["std_deg"] for row in rows)


def test_a_scale_off_by_twenty_stated_uncertainties_is_reported_first_of_all(tmp_path):
    found = diagnose(read_tracked_lab(write_pendulums(tmp_path, scale=1.04)), listed=[])
    (scale, *others) = found.to_json()["strained"]
    assert scale["name"] == "scale_error.relative"
    assert abs(scale["pull"]) == pytest.approx(20, abs=3)
    assert scale["stated_std"] == 0.002
    assert all(STRAINED < abs(one["pull"]) <= abs(scale["pull"]) for one in others)
    html = page(found, figures(found), Methods(()))
    assert 0 < html.index("scale_error.relative by") < html.index("<table>")
    assert "no calibration but a disagreement" in in_words(found.to_json()["strained"])


def test_the_table_of_candidates_begins_with_the_chosen_one_and_ends_with_the_refused_ones(tmp_path):
    lab = read_tracked_lab(write_pendulums(tmp_path, moment=2e-6))
    found = diagnose(lab, listed=[named(name) for name in ("pivot_friction", "linear_drag", "frame_rate_error")])
    html = page(found, figures(found), Methods(()))
    table = html[html.index("which effect it is") : html.index("what enters the model")]
    outcomes = [row.rsplit("<td>", 1)[1].split("</td>")[0] for row in table.split("<tr")[2:]]
    assert outcomes[0] == "chosen"
    assert 'class="quantity">pivot friction (Coulomb)<' in table.split("<tr")[2]
    refused = [one.startswith("refused: ") for one in outcomes]
    assert any(refused)
    assert refused == sorted(refused)
    others = {one for one, so in zip(outcomes[1:], refused[1:], strict=True) if not so}
    assert others <= {"not chosen", "more effects than needed"}


def test_the_command_writes_the_figures_beside_the_page(tmp_path):
    lab = write_pendulums(tmp_path / "lab")
    result = CliRunner().invoke(app, ["diagnose", str(lab), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    written = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*")}
    names = [f"figures/diagnosis-{name}" for name in ("residual", "amplitude", "overview")]
    assert {f"{name}.{ending}" for name in names for ending in ("svg", "png", "csv")} <= written
    assert {"diagnosis.html", "model.toml"} <= written
    text = (tmp_path / "out" / "diagnosis-methods.md").read_text(encoding="utf-8")
    repetitions = len(list(lab.rglob("*.csv")))
    assert f"{repetitions} tracked repetitions in " in text
    assert f"The verdict is `{json.loads((tmp_path / 'out' / 'diagnosis.json').read_text())['verdict']}`." in text
    assert "holm1979" in (tmp_path / "out" / "diagnosis-references.bib").read_text(encoding="utf-8")
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["strained"] == []
    assert "Strained calibration" not in (tmp_path / "out" / "diagnosis.html").read_text()
