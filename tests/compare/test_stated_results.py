"""Results that lab.toml states in place of media: compared, swept, calibrated, refused where they cannot be used."""

import csv
import json
import math
from dataclasses import asdict
from pathlib import Path

import pandas as pd
import pytest
from scipy import stats
from threadpoolctl import threadpool_limits

from rigtwin.cli import run
from rigtwin.compare.compare_lab import compare
from rigtwin.compare.measure_repetitions import Measured
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.reference.repetition_scatter import published_scatter
from rigtwin.lab.rig_quantities import quantities_of
from rigtwin.lab.rigs import (
    DropSettings,
    DrumSettings,
    HopperSettings,
    PackingSettings,
    PendulumSettings,
    PileSettings,
    TiltSettings,
)

BED = """
[[experiments]]
id = "bed"
rig = "packing"
particle = "D6"
wall = "PMMA"
cylinder_diameter = "30 mm"
count = 60
"""
TILT = """
[[experiments]]
id = "plate"
rig = "tilt"
variant = "slide"
particle = "D6"
wall = "PMMA"
"""
DROP = """
[[experiments]]
id = "drop"
rig = "drop"
particle = "D6"
wall = "steel"
"""
PELLET = """
[contacts.P6x15_5s-steel]
restitution = 0.6
"""
# small twins of all rigs and variants, by the name of the experiment
RIGS = {
    "sphere": (DropSettings(), 'rig = "drop"\nwall = "steel"\ndrop_height = "250 mm"'),
    "pellet": (
        DropSettings(),
        'rig = "drop"\nwall = "steel"\ndrop_height = "80 mm"\nturned = "60 deg"\ncamera = { frame_rate = "1 kHz" }',
    ),
    "double": (
        PendulumSettings(0.19),
        'rig = "pendulum"\nvariant = "double"\nlength = "190 mm"\nrelease_angle = "45 deg"',
    ),
    "single": (
        PendulumSettings(0.19, variant="wall"),
        'rig = "pendulum"\nvariant = "wall"\nwall = "steel"\nlength = "190 mm"\nrelease_angle = "45 deg"',
    ),
    "slide": (TiltSettings("slide"), 'rig = "tilt"\nvariant = "slide"\nwall = "steel"'),
    "roll": (TiltSettings("roll"), 'rig = "tilt"\nvariant = "roll"\nwall = "steel"'),
    "packing": (PackingSettings(0.03), 'rig = "packing"\nwall = "PMMA"\ncylinder_diameter = "30 mm"\ncount = 60'),
    "pile": (
        PileSettings(0.05),
        'rig = "pile"\nvariant = "piling"\nwall = "steel"\nbase_diameter = "50 mm"\nrim_height = "6 mm"\ncount = 200',
    ),
    "drum": (
        DrumSettings(0.06, 1.0),
        'rig = "drum"\nwall = "PMMA"\ndrum_diameter = "60 mm"\ndepth = "20 mm"\nspeed = "10 rpm"',
    ),
    "hopper": (
        HopperSettings("slot"),
        'rig = "hopper"\nvariant = "slot"\nwall = "PMMA"\noutlet = "25 mm"\nbin_width = "60 mm"\ndepth = "30 mm"\n'
        "count = 120",
    ),
}


def write(folder, text):
    folder.mkdir(exist_ok=True)
    (folder / "lab.toml").write_text(text, encoding="utf-8")
    return folder


def stated(text):
    return f"[experiments.measured]\n{text}\n"


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def every_quantity(settings):
    """All quantities of a rig by all methods, as lines of lab.toml."""
    for name, one in quantities_of(settings).items():
        text = f"0.5 ± 0.1 {'' if one.unit == '1' else one.unit} (n = 4)"
        bounce = ", bounce = 2" if "bounce" in one.which else ""  # a flight time needs two
        entries = (f'{{ value = "{text}", method = "{method}"{bounce} }}' for method in one.methods)
        yield f"{name} = [{', '.join(entries)}]"


@pytest.mark.usefixtures("in_this_process")
def test_every_quantity_of_every_rig_can_be_stated_and_has_its_twin(tmp_path):
    text = PELLET
    for name, (settings, keys) in RIGS.items():
        particle = "P6x15_5s" if name == "pellet" else "D6"
        text += f'[[experiments]]\nid = "{name}"\nparticle = "{particle}"\n{keys}\n'
        text += stated("\n".join(every_quantity(settings)))
    found = compare(write(tmp_path / "lab", text), tmp_path / "out", workers=1, threads=1)
    without = {(row.experiment, row.method) for row in found.deviations if row.simulated is None}
    assert without == {("sphere", "all directions")}, "a sphere does not leave the plate sideways"
    for row in found.deviations:
        assert (row.measured, row.measured_std, row.measured_n) == (0.5, pytest.approx(0.1), 4)
        prior = published_scatter(row.rig, row.quantity)
        freedom = prior.freedom + 3
        variance = (prior.freedom * (0.5 * prior.relative) ** 2 + 3 * 0.1**2) / freedom
        assert row.measured_std_uncertainty == pytest.approx(math.sqrt(variance / 4))
        assert row.note.startswith("the measured value is stated in lab.toml")
        if row.experiment == "sphere" and row.simulated is not None:
            assert row.coverage_factor == pytest.approx(stats.t.ppf(0.975, freedom), rel=0.01)


@pytest.mark.usefixtures("in_this_process")
def test_a_lab_without_media_is_compared_and_says_what_is_stated(tmp_path, capsys):
    lab = write(
        tmp_path / "lab", BED + stated('bed_height = "14.0 +- 0.4 mm (n = 4)"\nbulk_density = "240 +- 9 kg/m^3"')
    )
    assert run(["compare", str(lab), "--json", "--threads", "1", "--runs", "2"]) == 0
    found = json.loads(capsys.readouterr().out)
    height, density = found["deviations"]
    assert (height["measured"], height["measured_n"]) == (0.014, 4)
    assert height["measured_std"] == pytest.approx(0.4e-3)
    assert 0.01 * 14e-3 / 2 < height["measured_std_uncertainty"] < 0.2e-3, "between published and own scatter"
    assert "4 measured repetitions and 2 simulated beds: a scatter of" in height["note"]
    assert height["percent_deviation"] == pytest.approx(100 * (height["simulated"] / 0.014 - 1))
    single = math.hypot(9, 240 * published_scatter("packing", "bulk_density").relative)
    assert (density["measured_n"], density["measured_std_uncertainty"]) == (1, pytest.approx(single))
    assert "1 measured repetition and 2 simulated beds: a scatter of 1 %" in density["note"]
    (bed,) = found["experiments"]
    assert [one["stated"] for one in bed["stated"]] == ["in lab.toml"] * 2
    assert bed["measurements"] == []
    origins = {row["repetition"]: row["origin"] for row in rows_of(lab / "out" / "observations.csv")}
    assert origins == {"lab.toml": "stated", "twin, seed 1": "simulated", "twin, seed 2": "simulated"}
    page = (lab / "out" / "report.html").read_text(encoding="utf-8")
    assert "The measured value is stated in lab.toml" in page
    assert "Each repetition" not in page


def profile(height):
    """The surface of a bed of 30 mm that is `height` [mm] high and not quite even."""
    rows = (f"{k * 1e-3:.4f},{height * 1e-3 + 2e-4 * (k % 2):.5f}\n" for k in range(-15, 16))
    return "x_m,height_m\n" + "".join(rows)


@pytest.mark.usefixtures("in_this_process")
def test_a_stated_value_replaces_that_of_the_media_by_the_same_method_only(tmp_path):
    media = BED + 'repetitions = ["r1.csv", "r2.csv"]\n'
    lab = write(tmp_path / "lab", media)
    for k in (1, 2):
        (lab / f"r{k}.csv").write_text(profile(14 + 0.2 * k))
    of_media = compare(lab, tmp_path / "a", workers=1, threads=1).deviations
    value = '{ value = "15 +- 0.3 mm (n = 9)", method = "outline" }'
    write(lab, media + stated(f"bed_height = {value}"))
    both = compare(lab, tmp_path / "b", workers=1, threads=1)
    (mine,) = [row for row in both.deviations if (row.quantity, row.method) == ("bed_height", "outline")]
    assert (mine.measured, mine.measured_n) == (0.015, 9)
    (theirs,) = [row for row in of_media if row not in both.deviations]
    assert (theirs.quantity, theirs.method, theirs.measured_n) == ("bed_height", "outline", 2)
    assert len(of_media) == len(both.deviations) > 2
    (said,) = [text for text in both.outcomes[0].warnings if "stated in lab.toml" in text]
    assert "stated in lab.toml as 15.00 ± 0.10 mm; the mean of 2 repetitions, 14." in said
    assert "contradict" not in said


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize(
    ("height", "contradicts"), [("1.40 +- 0.05 mm", True), ("14.50 +- 0.50 mm", False), ("140.0 +- 5.0 mm", True)]
)
def test_a_stated_value_that_the_media_contradict_is_named_with_the_measured_one(tmp_path, capsys, height, contradicts):
    value = f'bed_height = {{ value = "{height}", method = "outline" }}'
    lab = write(tmp_path / "lab", BED + 'repetitions = ["r1.csv"]\n' + stated(value))
    (lab / "r1.csv").write_text(profile(14))
    assert run(["measure", str(lab)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"stated in lab.toml as {height.split()[0]}" in said
    assert "that of a repetition, 14.1" in said
    assert ("contradict each other" in said) == contradicts


@pytest.mark.parametrize(
    ("doubtful", "those"),
    [
        (["", "", ""], "the mean of 3 repetitions, 15.00 "),
        (["", "", "it leans"], "the mean of 2 repetitions (1 doubtful left out), 14.50 "),
        (["", "it leans", "it leans"], "that of a repetition (2 doubtful left out), 14.00 "),
        (["it leans"] * 3, "the mean of 3 repetitions, 15.00 "),
    ],
)
def test_what_a_stated_value_replaces_is_the_mean_of_the_sound_repetitions(doubtful, those, tmp_path):
    value = stated('bed_height = { value = "15 +- 0.3 mm", method = "outline" }')
    (experiment,) = read_lab(write(tmp_path / "lab", BED + value)).experiments
    heights = [
        Quantity("bed_height", 0.014 + 0.001 * k, 1e-4, "m", "outline", doubtful=why) for k, why in enumerate(doubtful)
    ]
    found = Measured(experiment, tuple(Measurement("packing", Path("r.csv"), "", (one,)) for one in heights), ())
    (said,) = [text for text in found.warnings if "stated in lab.toml" in text]
    assert f"; {those}" in said


@pytest.mark.usefixtures("in_this_process")
def test_media_that_cannot_be_measured_are_left_out_beside_a_stated_value(tmp_path):
    lab = write(tmp_path / "lab", BED + 'repetitions = ["r1.csv"]\n' + stated('bed_height = "14.0 +- 0.4 mm (n = 4)"'))
    (lab / "r1.csv").write_text("nothing\n")
    found = compare(lab, tmp_path / "out", workers=1, threads=1)
    assert [row.quantity for row in found.deviations] == ["bed_height"]
    assert "r1.csv was left out" in found.outcomes[0].warnings[0]


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_has_the_stated_value_beside_the_twins(tmp_path, capsys):
    lab = write(tmp_path / "lab", DROP + 'drop_height = "250 mm"\n' + stated('restitution_wall = "0.5 +- 0.1 (n = 4)"'))
    assert run(["sweep", str(lab), "--vary", "wall_restitution=0.4,0.6", "--out", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    table = pd.read_csv(tmp_path / "out" / "sweep.csv")
    table = table[(table["method"] == "height") & (table["bounce"] == 1)]
    assert table["percent_deviation"].to_numpy() == pytest.approx([-20, 20], abs=0.1)
    assert table["measured_std_uncertainty"].to_numpy() == pytest.approx(0.05)


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize(("parameter", "other"), [("wall_static_friction", "PMMA"), ("static_friction", "D6")])
def test_stated_values_are_targets_and_priors_of_a_calibration(parameter, other, tmp_path, capsys, monkeypatch):
    def bed(*, contacts, **_):
        friction = next(one["static_friction"] for one in contacts if one["pair"] == ["D6", other])
        height = Quantity("bed_height", 0.02 + 0.01 * friction, 1e-5, "m", "surface bead tops")
        return {"quantities": [asdict(height)], "warnings": [], "wall_s": 0.0}

    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", bed)
    plate = TILT.replace("PMMA", other) + stated('static_friction = "0.3 +- 0.06 (n = 9)"')
    both = BED + stated('bed_height = "23.4 +- 0.4 mm (n = 4)"') + plate
    lab = write(tmp_path / "lab", both)
    arguments = ["--fit", parameter, "--budget", "15", "--json", "--out", str(tmp_path / "out")]
    with threadpool_limits(1):  # for matrices this small several threads mostly wait for each other
        assert run(["calibrate", str(lab), *arguments]) == 0
    found = json.loads(capsys.readouterr().out)
    (prediction,) = found["predictions"]
    assert (prediction["measured"], prediction["std_uncertainty"]) == (0.0234, pytest.approx(0.2e-3))
    prior = found["priors"][parameter]
    assert (prior["mean"], prior["std"]) == (0.3, pytest.approx(0.02))
    assert "plate" in prior["source"]
    # the plate says 0.30 and the bed 0.34, each with a standard uncertainty of 0.02
    friction = found["intervals"][parameter]
    assert friction["median"] == pytest.approx(0.32, abs=0.002)
    assert friction["std"] == pytest.approx(0.02 / 2**0.5, rel=0.1)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (DROP + stated('restitution_wall = "0.4 +- 0.1"'), "drop height, which is not stated"),
        (BED.replace("count = 60", "") + stated('bed_height = "14 +- 1 mm"'), "add total_mass or count"),
    ],
)
def test_what_the_twin_lacks_is_said_and_the_stated_value_stands_alone(text, why, tmp_path, capsys):
    lab = write(tmp_path / "lab", text)
    assert run(["compare", str(lab), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert why in found["experiments"][0]["without_twin"]
    assert [row["verdict"] for row in found["deviations"]] == ["no twin value"]


@pytest.mark.parametrize(
    ("text", "key", "why"),
    [
        (BED, "experiment 1, repetitions", "or state results under [experiments.measured]"),
        (BED + "measured = {}", "experiment 1, repetitions", "this key is missing"),
        (BED + "measured = 3", "experiment 1, measured", "write it as [experiments.measured]"),
        (BED + stated('bed_heigth = "14 +- 1 mm"'), "measured.bed_heigth", "did you mean 'bed_height'"),
        (TILT + stated('rolling_friction = "1 +- 1"'), "measured.rolling_friction", "no result of a tilt (slide)"),
        (DROP + stated('drop_height = "1 +- 1 m"'), "measured.drop_height", "of the experiment itself"),
        (BED + stated('bed_height = "14 +- 1 kg"'), "measured.bed_height", "'14 +- 1 kg' has the wrong unit for a"),
        (BED + stated('bed_height = "14 mm"'), "measured.bed_height", "like '6.2 +- 0.31 mm (n = 10)'"),
        (BED + stated('camera.bed = "14 mm"'), "measured.camera", "no result of a packing"),
        (
            BED + 'camera = { scale = "0.2 mm/px" }\n' + stated('bed_height = "14 +- 1 mm"'),
            "camera.scale",
            "no repetitions",
        ),
        (BED + 'join = ["1,2"]\n' + stated('bed_height = "14 +- 1 mm"'), "experiment 1, join", "no repetitions"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_key(text, key, why, tmp_path, capsys):
    lab = write(tmp_path / "lab", text)
    assert run(["compare", str(lab), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert f"{lab / 'lab.toml'}, line " in said
    assert f"{key}: " in said
    assert why in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("only", [[], ["--only", "drop"]])
def test_a_diagnosis_needs_the_motion(only, tmp_path, capsys):
    lab = write(tmp_path / "lab", DROP + 'drop_height = "250 mm"\n' + stated('restitution_wall = "0.4 +- 0.1"'))
    assert run(["diagnose", str(lab), *only]) == 2
    assert "drop states results only, under [experiments.measured]" in capsys.readouterr().err
