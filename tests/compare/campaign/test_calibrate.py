"""Calibration: emulators, posterior, and parameters recovered from a lab of simulated records."""

import json
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from rigtwin.benchmarks.calibrate.recovery import make_lab
from rigtwin.cli import run
from rigtwin.compare.campaign import emulator as emulators
from rigtwin.compare.campaign.calibration import Calibration, at_range_limit
from rigtwin.compare.campaign.curves import curve_targets
from rigtwin.compare.campaign.posterior import Parameter, Posterior, Target, correlation, sample, scatter
from rigtwin.lab.camera import Camera
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import read_model
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.records import Profile
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import PileSettings


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


def test_quantities_that_err_together_weigh_less_and_a_convention_of_reading_frees_the_prior(design):
    parameter = Parameter("a", 0.0, 1.0)
    emulator = emulators.fit(design[:, :1], design[:, 0], seed=1)
    one, other = (Target("heap", name, "line", "deg", 0.5, 0.05, 9) for name in ("angle", "height"))
    random = np.random.default_rng(1)
    off = random.normal(size=400)
    residuals = {one: off, other: 0.9 * off + np.sqrt(1 - 0.9**2) * random.normal(size=400)}
    together = correlation([one, other], residuals)
    assert together[0, 1] == pytest.approx(0.9, abs=0.05)
    spread = {}
    for name, matrix in {"together": together, "apart": np.eye(2)}.items():
        samples, _, _ = sample(Posterior([parameter], [one, other], [emulator, emulator], matrix), seed=1)
        spread[name] = samples.std()
    assert spread["together"] / spread["apart"] == pytest.approx(np.sqrt(1 + together[0, 1]), rel=0.1)
    read = Target("heap", "angle", "line", "deg", 0.5, 0.05, 9, reading_std=50.0)
    samples, _, _ = sample(Posterior([parameter], [read], [emulator], np.eye(1)), seed=1)
    assert samples.std() == pytest.approx(1 / np.sqrt(12), rel=0.05), "the prior, uniform"


def test_an_emulator_takes_a_run_far_off_for_scatter():
    unit = np.linspace(0, 1, 14)[:, None]
    smooth = emulators.fit(unit, np.sin(3 * unit[:, 0]), seed=1)
    outlier = np.sin(3 * unit[:, 0])
    outlier[6] += 3
    assert smooth.widened >= 1
    assert emulators.fit(unit, outlier, seed=1).noise > 100 * smooth.noise


def test_the_scatter_of_few_repetitions_is_pooled_with_that_of_the_twin():
    def heap(std, repetitions):
        return Target("heap", "angle", "line", "deg", 30, std, repetitions)

    assert scatter(heap(0.1, 1), 1.0) == pytest.approx(np.hypot(0.1, 1.0))
    assert scatter(heap(0.0, 3), 0.6) == pytest.approx(0.6 / np.sqrt(3) * np.sqrt(4 / 6)), "by chance alike"
    assert scatter(heap(2.0, 3), 0.6) == pytest.approx(2.0), "less certain anyway"
    assert scatter(heap(0.1, 10_000), 50.0) == pytest.approx(0.1, rel=0.01), "known by itself"


def test_a_curve_enters_by_its_components():
    slopes = np.linspace(0.4, 0.7, 9)
    x = np.linspace(-0.04, 0.04, 81)

    def outline(slope, up=0.0):
        return Profile(x, np.maximum(0.03 - slope * np.abs(x), 0) + up, np.full(81, 1e-5), base=(-0.04, 0.04))

    def twin(slope):
        profile = outline(slope)
        return {
            "rig": "pile", "quantities": [], "checks": [], "warnings": [], "settings": {}, "assumptions": [],
            "series": [], "wall_s": 0.0, "profiles": [{"base": profile.base, "view": "front"}],
            "profile_1_x": profile.x, "profile_1_height": profile.height, "profile_1_sigma": profile.sigma,
        }  # fmt: skip

    bead = hlosta2020.particle("D6")
    heap = Experiment("heap", PileSettings(0.08), bead, hlosta2020.material("steel"), Camera(), ())
    measured = [Measurement("pile", Path("a"), "", (), profiles=(outline(slope),)) for slope in (0.54, 0.56)]
    found = curve_targets(heap, measured, [twin(slope) for slope in slopes])
    (target, *_) = found.targets
    assert (target.quantity, target.unit, target.repetitions) == ("outline of the heap", "mm", 2)
    scores = [found.values(twin(slope))[target.quantity, target.method] for slope in slopes]
    assert np.interp(target.value, *sorted_pair(scores, slopes)) == pytest.approx(0.55, abs=0.005)
    assert target.std_uncertainty > 0


def sorted_pair(scores, slopes):
    order = np.argsort(scores)
    return np.array(scores)[order], slopes[order]


def test_a_calibration_shows_its_parameters_and_no_samples():
    friction = Calibration(
        lab=SimpleNamespace(title="t"), parameters=(SimpleNamespace(name="static_friction"),), targets=(),
        samples=np.linspace(0.3, 0.5, 101)[:, None], best={}, model=None, sensitivities=np.zeros((0, 1)),
        predictions=(), runs=3, stopped="", misfit=(0.0, 1.0),
    )  # fmt: skip
    assert repr(friction) == "<Calibration of 't', 3 runs; SI units\n  static_friction = 0.400 ± 0.058>"


def test_a_measured_coefficient_is_a_prior_and_a_wide_range_is_logarithmic():
    known, wide = Parameter("a", 0.1, 0.5, 0.3, 0.02), Parameter("b", 0.003, 0.5)
    unit = np.linspace(0, 1, 101)
    assert known.value(unit[[int(np.argmax(known.log_prior(unit)))]]) == pytest.approx(0.3, abs=0.01)
    assert wide.value(np.array([0.5]))[0] == pytest.approx(np.sqrt(0.003 * 0.5))
    assert not wide.log_prior(unit).any()


def test_a_best_value_at_range_limit_of_its_range_is_said():
    friction, rolling = Parameter("static_friction", 0.05, 1.2), Parameter("rolling_friction", 0.01, 0.4)
    samples = np.column_stack([np.linspace(0.05, 0.1, 50), np.linspace(0.1, 0.3, 50)])
    (said,) = at_range_limit((friction, rolling), {"static_friction": 0.05, "rolling_friction": 0.2}, samples)
    assert said.startswith("static_friction: the best value, 0.05, lies at the lower end of its range, 0.05 to 1.2")
    assert said.endswith("values beyond it may fit better")
    near, anywhere = np.linspace(1.0, 1.19, 50)[:, None], np.linspace(0.05, 1.19, 50)[:, None]
    assert "upper end" in at_range_limit((friction,), {"static_friction": 1.19}, near)[0]
    assert not at_range_limit((friction,), {"static_friction": 1.19}, anywhere)  # nothing was learned of it


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rigtwin.benchmarks.calibrate.recovery.small", lambda _usual, smoke: smoke)
        make_lab(folder, {"static_friction": 0.5, "rolling_friction": 0.05}, 1, "rigtwin")
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Where the records of that lab are measured once."""
    return tmp_path_factory.mktemp("out")


@pytest.mark.usefixtures("in_this_process")
def test_a_lab_of_one_bed_is_calibrated_and_the_ambiguity_is_named(lab, out, capsys):
    asked = ["calibrate", str(lab), "--budget", "17", "--fit", "static_friction", "--fit", "rolling_friction"]
    ranges = {"static_friction": {"low": 0.1, "high": 0.9}, "rolling_friction": {"low": 0.001, "high": 0.1}}
    (out / "calibration.json").write_text(json.dumps({"priors": ranges}))
    assert run([*asked, "--json", "--out", str(out)]) == 0
    found = json.loads(capsys.readouterr().out)
    (remark,) = (one for one in found["remarks"] if one.startswith("the calibration of "))
    assert "static_friction between 0.1 and 0.9, rolling_friction between 0.001 and 0.1 (SI) in" in remark
    for name, value in {"static_friction": 0.5, "rolling_friction": 0.05}.items():
        assert found["intervals"][name]["low"] < value < found["intervals"][name]["high"]
    assert found["fits"]
    assert found["ambiguous"], "one bed height does not separate two frictions"
    bed, *curves = found["predictions"]
    assert abs(bed["percent_deviation"]) < 3
    assert {row["quantity"] for row in curves} == {"outline of the bed"}
    model = read_model(out / "model.toml")
    assert model.known_contact("D6", "D6").static_friction == pytest.approx(found["best"]["static_friction"])
    assert list(pd.read_csv(out / "posterior.csv").columns) == ["static_friction", "rolling_friction"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rigtwin.compare.campaign.campaign.perform", None)  # nothing is run again
        assert run([*asked, "--json", "--out", str(out)]) == 0
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
        (["--budget", "3"], "3 runs are too few for 2 parameters and 1 experiment; give at least 13"),
        (["--fit", "count=100..140"], "a whole number, which cannot be fitted"),
        (["--fit", "static_friction=0.1..0.9:7"], "not a range without levels"),
        (["--fit", "static_friction", "--fit", "static_friction@D6-D6"], "are the same parameter"),
    ],
)
@pytest.mark.usefixtures("in_this_process")
def test_bad_input_is_one_sentence(more, why, lab, out, capsys):
    assert run(["calibrate", str(lab), *more, "--out", str(out)]) == 2
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
    assert run(["calibrate", str(tmp_path), "--budget", "13", "--json"]) == 0
    (said,) = (one for one in json.loads(capsys.readouterr().out)["remarks"] if "--budget" in one)
    budget = said.partition("--budget ")[2].split()[0]
    assert run(["calibrate", str(tmp_path), "--budget", budget, "--json"]) == 0  # what the remark names is enough
    found = json.loads(capsys.readouterr().out)
    assert any("do not separate" in sentence for sentence in found["ambiguous"])
    best, *others = found["next_experiments"]
    assert best["quantity"] == "bed_height"
    assert best["apart"] > 5
    assert all(row["apart"] < 2 for row in others), "the heap does not depend on either friction"
    page = (tmp_path / "calibration" / "calibration.html").read_text(encoding="utf-8")
    assert "Experiments that would separate" in page
    figures = {path.name for path in (tmp_path / "calibration" / "figures").iterdir()}
    names = [f"calibration-{name}" for name in ("screening", "posterior", "predictions")]
    assert figures == {f"{name}.{kind}" for name in names for kind in ("svg", "png", "csv")} | {
        "calibration-captions.csv"
    }
    text = (tmp_path / "calibration" / "calibration-methods.md").read_text(encoding="utf-8")
    assert f"with {found['runs']} discrete-element simulations" in text
    assert f"chi-square of {found['chi_square']:.3g} (probability {found['probability']:.2g})" in text
    for name, prior in found["priors"].items():
        assert f"{name.replace('_', ' ')}: logarithm uniform in {prior['low']:.4g} to {prior['high']:.4g}" in text
    bib = (tmp_path / "calibration" / "calibration-references.bib").read_text(encoding="utf-8")
    assert "foreman2013" in bib


@pytest.mark.usefixtures("in_this_process")
def test_a_parameter_that_nothing_measured_depends_on_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", closed_form)
    (tmp_path / "lab.toml").write_text(ONE_RIG, encoding="utf-8")
    asked = ["calibrate", str(tmp_path), "--fit", "static_friction", "--fit", "wall_restitution=0.1..0.9"]
    assert run([*asked, "--budget", "15", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert any(one.startswith("wall_restitution is not determined: alone it") for one in found["ambiguous"])


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
def test_a_stated_bulk_density_is_fitted_unless_the_bed_height_is_there(tmp_path, capsys, monkeypatch):
    def packed(*, contacts, seed, **_):
        static = next(one["static_friction"] for one in contacts if one["pair"] == ["D6", "D6"])
        density = 420 - 60 * static + 0.5 * np.random.default_rng(seed).normal()
        found = [
            Quantity("bed_height", 24 / density, 1e-4, "m", "surface bead tops"),
            Quantity("bulk_density", density, 1, "kg/m^3", "surface bead tops"),
        ]
        return {"quantities": [asdict(one) for one in found], "warnings": [], "wall_s": 0.0}

    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", packed)
    asked = ["calibrate", str(tmp_path), "--fit", "static_friction=0.1..0.9", "--budget", "15", "--json"]
    density = 'bulk_density = "390 +- 2 kg/m^3 (n = 5)"\n'
    fitted = {}
    for name, measured in {"density": density, "both": f'{density}bed_height = "61.5 +- 0.3 mm (n = 5)"\n'}.items():
        text = BED.partition("bed_height")[0] + measured
        (tmp_path / "lab.toml").write_text(text, encoding="utf-8")
        assert run(asked) == 0
        found = json.loads(capsys.readouterr().out)
        fitted[name] = {row["quantity"] for row in found["predictions"]}
        assert found["best"]["static_friction"] == pytest.approx(0.5, abs=0.1)
    assert fitted == {"density": {"bulk_density"}, "both": {"bed_height"}}


HEAP = """
[[experiments]]
id = "heap"
rig = "pile"
variant = "piling"
particle = "D6"
wall = "steel"
base_diameter = "90 mm"
"""


def test_what_was_measured_but_cannot_be_fitted_is_named(tmp_path, capsys):
    measured = """
        measured.pile_height = "25 +- 1 mm (n = 5)"
        measured.angle_of_repose_graphical = {value = "30 +- 1 deg (n = 5)", side = "left"}
    """
    (tmp_path / "lab.toml").write_text(HEAP + measured, encoding="utf-8")
    assert run(["calibrate", str(tmp_path)]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "of a pile: angle_of_repose_graphical, angle_of_repose_geometric, the mean of both sides" in said
    assert "measured: pile_height, left angle_of_repose_graphical" in said


@pytest.mark.usefixtures("in_this_process")
def test_the_reason_is_named_where_nothing_was_measured(tmp_path, capsys):
    rows = [f"{x / 1e3},{max(0.0, 0.02 - abs(x) * 4e-4) if x < 0 else 0.0:.5f}" for x in range(-45, 46)]
    (tmp_path / "heap.csv").write_text("\n".join(["x_m,height_m", *rows]))  # a half of a heap
    (tmp_path / "flat.csv").write_text("x_m,height_m\n" + "\n".join(f"{x / 1e3},0" for x in range(-45, 46)))
    (tmp_path / "lab.toml").write_text(
        HEAP + 'repetitions = ["heap.csv"]\n' + HEAP.replace('"heap"', '"flat"') + 'repetitions = ["flat.csv"]\n'
    )
    assert run(["calibrate", str(tmp_path)]) == 2
    heap, flat = " ".join(capsys.readouterr().err.split()).split("was measured in flat")
    assert "nothing that can be fitted was measured in heap" in heap
    assert "measured: left angle_of_repose_graphical" in heap
    assert "flat.csv was not measured: " in flat
    assert "shows no heap" in flat


def test_a_setting_of_another_variant_is_no_parameter(tmp_path, capsys):
    measured = 'measured.angle_of_repose_graphical = "30 +- 1 deg (n = 5)"'
    (tmp_path / "lab.toml").write_text(HEAP + measured, encoding="utf-8")
    assert run(["calibrate", str(tmp_path), "--fit", "lift_speed=10mm/s..30mm/s"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "no experiment that is fitted depends on 'lift_speed'" in said
    assert "outlet_diameter" in said


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


TILT = """
[[experiments]]
id = "plate"
rig = "tilt"
variant = "slide"
particle = "D6"
wall = "steel"
[experiments.measured]
static_friction = "0.55 +- 0.06 (n = 9)"
"""


@pytest.mark.usefixtures("in_this_process")
def test_a_measured_coefficient_that_a_measured_height_contradicts_is_named(tmp_path, capsys, monkeypatch):
    def on_the_wall(*, contacts, **_):
        friction = next(one["static_friction"] for one in contacts if set(one["pair"]) == {"D6", "steel"})
        height = Quantity("bed_height", 0.05 + 0.02 * friction, 1e-4, "m", "surface bead tops")
        return {"quantities": [asdict(height)], "warnings": [], "wall_s": 0.0}

    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", on_the_wall)
    stated = BED + TILT.replace("0.55 +- 0.06", "0.2 +- 0.03")
    (tmp_path / "lab.toml").write_text(stated, encoding="utf-8")
    asked = ["calibrate", str(tmp_path), "--fit", "wall_static_friction", "--budget", "15"]
    assert run(asked) == 0
    said = capsys.readouterr().out
    assert "of 1 measured number and 1 value known beforehand" in said
    assert "wall_static_friction from its value known beforehand" in said
    assert "no more measurements than parameters" not in said
    assert run([*asked, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (bed,) = (one for one in found["predictions"] if one["quantity"] == "bed_height")
    squares = bed["z"] ** 2 + found["priors"]["wall_static_friction"]["pull"] ** 2
    assert found["chi_square"] == pytest.approx(squares, rel=0.2)


def test_a_parameter_that_nothing_has_is_refused_before_anything_is_measured(tmp_path, capsys):
    (tmp_path / "lab.toml").write_text(ONE_RIG, encoding="utf-8")
    out = tmp_path / "out"
    assert run(["calibrate", str(tmp_path), "--fit", "sliding_friction", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "no experiment that is fitted depends on 'sliding_friction'; known are" in said
    assert ("static_friction@D6-PMMA" in said) != ("static_friction@PMMA-D6" in said), "each contact once"
    assert not out.exists()


@pytest.mark.usefixtures("in_this_process")
def test_an_interrupted_calibration_says_what_is_kept(tmp_path, capsys, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", closed_form)
    monkeypatch.setattr("rigtwin.compare.campaign.search.sample", stopped)
    (tmp_path / "lab.toml").write_text(ONE_RIG, encoding="utf-8")
    assert run(["calibrate", str(tmp_path), "--budget", "13"]) == 130
    assert f"finished runs are kept in {tmp_path / 'calibration' / 'runs'}" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_an_experiment_says_nothing_of_parameters_that_it_does_not_have(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", closed_form)
    (tmp_path / "lab.toml").write_text(ONE_RIG + BED + TILT, encoding="utf-8")
    wanted = ("rolling_friction", "static_friction@D6-PMMA=0.1..0.9", "depth=20mm..40mm")
    asked = [word for name in wanted for word in ("--fit", name)]
    assert run(["calibrate", str(tmp_path), *asked, "--budget", "30", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    of_bed = next(row for row in found["sensitivities"] if row["experiment"] == "bed")
    assert (of_bed["static_friction@D6-PMMA"], of_bed["depth"]) == (0, 0)
    assert any("plate measured 0.55 +- 0.02; --fit static_friction@D6-steel" in one for one in found["remarks"])
    assert any("D6" in one for one in found["borrowed"])
    held = ["--fit", "static_friction@D6-steel=0.1..0.9", "--fit", "static_friction", "--budget", "30"]
    for more, mean in ([], 0.55), (["--hold-out", "plate"], None):
        assert run(["calibrate", str(tmp_path), *held, *more, "--json"]) == 0
        prior = json.loads(capsys.readouterr().out)["priors"]["static_friction@D6-steel"]
        assert prior["mean"] == (None if mean is None else pytest.approx(mean))
