"""Calibration: the values and ranges that enter it, what it leaves out and says so, and what it writes."""

import csv
import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from rigtwin.compare.campaign import calibrate as subject
from rigtwin.compare.campaign import posterior
from rigtwin.compare.measure_repetitions import Failure, Measured
from rigtwin.compare.report.figure_file import FigureFile
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.file.model_file import read_model
from rigtwin.lab.quantity import Measurement, Quantity


def experiment(name, rig, keys, wall="steel", **measured):
    said = "".join(f'measured.{quantity} = "{value}"\n' for quantity, value in measured.items())
    beside = f'wall = "{wall}"\n' if wall else ""
    return f'[[experiments]]\nid = "{name}"\nrig = "{rig}"\nparticle = "D6"\n{beside}{keys}\n{said}\n'


def bed(height="60 +- 1 mm (n = 5)", name="bed", **more):
    return experiment(name, "packing", 'cylinder_diameter = "50 mm"\ncount = 400', bed_height=height, **more)


def drum(**measured):
    keys = 'drum_diameter = "100 mm"\ndepth = "30 mm"\nfill = 0.35\nspeed = "6 rpm"'
    return experiment("drum", "drum", keys, wall="PMMA", **measured)


def heap(**measured):
    return experiment("heap", "pile", 'variant = "piling"\nbase_diameter = "90 mm"', **measured)


def hopper(**measured):
    keys = 'variant = "slot"\noutlet = "30 mm"\nbin_width = "96 mm"\ndepth = "48 mm"\ncount = 600'
    return experiment("hopper", "hopper", keys, **measured)


def plate(value, name="plate", variant="slide", quantity="static_friction", wall="steel"):
    return experiment(name, "tilt", f'variant = "{variant}"', wall, **{quantity: value})


def drop(value):
    return experiment("drop", "drop", 'drop_height = "250 mm"', restitution_wall=value)


def pendulum(value):
    keys = 'variant = "double"\nlength = "190 mm"\nrelease_angle = "45 deg"'
    return experiment("pair", "pendulum", keys, wall="", restitution_pair=value)


ANGLE = "33 +- 0.6 deg (n = 5)"


def twin(*, rig, contacts, seed, **_):
    """Every result depends on the product of the two frictions between the particles, by the way of a logarithm."""
    static, rolling = next(
        (one["static_friction"], one["rolling_friction"]) for one in contacts if one["pair"] == ["D6", "D6"]
    )
    steep = math.log(static * rolling / 0.0352)
    off = 0.1 * np.random.default_rng(seed).normal()
    found = {
        "drum": Quantity("angle_of_repose_geometric", 33 + 4 * steep + off, 0.1, "deg", "chord, wall to wall"),
        "pile": Quantity("angle_of_repose_geometric", 28 + 4 * steep + off, 0.1, "deg", "apex"),
        "packing": Quantity("bed_height", 0.06 + 0.003 * steep + 1e-3 * off, 1e-4, "m", "surface bead tops"),
        "hopper": Quantity("discharge_time", 2 + 0.2 * steep + 0.1 * off, 1e-3, "s", "given to last loss"),
    }
    nothing = {key: [] for key in ("checks", "warnings", "assumptions", "series", "surfaces", "profiles")}
    return {"rig": rig, "quantities": [asdict(found[rig])], "settings": {}, "wall_s": 0.0, **nothing}


@pytest.fixture
def quick(in_this_process, monkeypatch):
    """Closed forms in place of twins, short chains and empty figures: for what does not depend on the samples."""

    def few_steps(found, *, seed, most=0):
        return posterior.sample(found, seed=seed, most=20)

    def empty(_found):
        return {name: FigureFile(name, "<svg></svg>", b"", "", name, name) for name in names}

    names = ("screening", "posterior", "predictions")
    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", twin)
    monkeypatch.setattr(posterior, "STEPS", 20)
    monkeypatch.setattr("rigtwin.compare.campaign.search.sample", few_steps)
    monkeypatch.setattr(subject, "figures", empty)


@pytest.fixture
def calibrated(quick, tmp_path):
    """`calibrated(text, *fit, **more)`: the calibration of a lab.toml."""

    def calibrated(text, *fit, **more):
        (tmp_path / "lab.toml").write_text(text, encoding="utf-8")
        return subject.calibrate(tmp_path, tmp_path / "out", fit=fit, **more)

    return calibrated


def refused(calibrated, *arguments, **more):
    with pytest.raises(BadInput) as error:
        calibrated(*arguments, **more)
    return str(error.value)


def known(found):
    return {
        one.name: tuple(
            None if number is None else round(number, 9) for number in (one.low, one.high, one.mean, one.std)
        )
        for one in found.parameters
    }


def test_every_rig_that_measures_a_coefficient_directly_gives_its_prior(calibrated):
    measured = [
        plate("0.55 +- 0.06 (n = 9)"),
        plate("0.3 +- 0.04 (n = 4)", "ramp", "roll", "rolling_friction"),
        drop("0.9 +- 0.3 (n = 9)"),
        pendulum("0.5 +- 0.1 (n = 4)"),
        plate("0.2 +- 0.6 (n = 9)", "beads", wall="D6"),
    ]
    wall = ("wall_static_friction", "wall_rolling_friction", "wall_restitution")
    found = calibrated(bed() + "".join(measured), *wall, "restitution", "static_friction", budget=23)
    assert known(found) == {
        "wall_static_friction": (0.47, 0.63, 0.55, 0.02),
        "wall_rolling_friction": (0.22, 0.38, 0.3, 0.02),
        "wall_restitution": (0.5, 1.0, 0.9, 0.1),  # no coefficient of restitution is above 1
        "restitution": (0.3, 0.7, 0.5, 0.05),
        "static_friction": (0.01, 1.0, 0.2, 0.2),  # a 20th of the value, above zero
    }
    sources = [one.source.removeprefix("four standard uncertainties, measured by ") for one in found.parameters]
    assert sources == ["plate", "ramp", "drop", "pair", "beads"]


def test_a_single_wall_pendulum_measures_the_restitution_on_its_wall_and_friction_may_exceed_one(calibrated):
    keys = 'variant = "wall"\nlength = "190 mm"\nrelease_angle = "45 deg"'
    swing = experiment("swing", "pendulum", keys, restitution_wall="0.5 +- 0.1 (n = 4)")
    found = calibrated(bed() + swing + plate("0.95 +- 0.03"), "wall_restitution", "wall_static_friction", budget=13)
    assert known(found) == {
        "wall_restitution": (0.3, 0.7, 0.5, 0.05),
        "wall_static_friction": (0.83, 1.07, 0.95, 0.03),
    }


STEEL = "static_friction@D6-steel"


@pytest.mark.parametrize("said", ["0.62..0.9", "0.1..0.48"])
def test_a_stated_range_replaces_the_usual_one_of_a_measured_coefficient(calibrated, said):
    """It may end four standard uncertainties of 0.02 from 0.55."""
    (one,) = calibrated(bed() + plate("0.55 +- 0.06 (n = 9)"), f" {STEEL} ={said}", budget=13).parameters
    low, _, high = said.partition("..")
    assert (one.name, one.low, one.high, one.mean) == (STEEL, float(low), float(high), 0.55)
    assert one.source == "stated range, measured by plate"


CONTRADICTS = "contradicts 0.55 +- 0.02, measured by plate; leave the range out or correct it."
LEVELS = "is not a range without levels, like static_friction=0.1..0.9."


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("0.64..0.9", f"--fit: {STEEL}=0.64..0.9 {CONTRADICTS}"),
        ("0.1..0.46", f"--fit: {STEEL}=0.1..0.46 {CONTRADICTS}"),
        ("0.1,0.9", f"--fit: '{STEEL}=0.1,0.9' {LEVELS}"),
        ("0.1..0.9:7", f"--fit: '{STEEL}=0.1..0.9:7' {LEVELS}"),
    ],
)
def test_a_stated_range_that_contradicts_a_measurement_or_has_levels_is_refused(calibrated, said, why):
    assert refused(calibrated, bed() + plate("0.55 +- 0.06 (n = 9)"), f"{STEEL}={said}") == why


def test_what_was_not_measured_on_that_contact_has_a_usual_range_or_needs_one(calibrated):
    other = plate("0.55 +- 0.06 (n = 9)", wall="PMMA")
    found = calibrated(bed() + other, "static_friction@D6-steel", "rolling_friction", "restitution=0.2..0.6", budget=14)
    assert known(found) == {
        "static_friction@D6-steel": (0.05, 1.2, None, None),
        "rolling_friction": (0.003, 0.5, None, None),
        "restitution": (0.2, 0.6, None, None),
    }
    assert [one.source for one in found.parameters] == ["nothing is known", "nothing is known", "stated range"]
    assert refused(calibrated, bed() + other, "wall_restitution") == (
        "--fit: wall_restitution was not measured; give its range, wall_restitution=LOW..HIGH."
    )


def test_the_first_experiment_that_is_not_held_out_gives_the_prior(calibrated):
    three = "".join(plate(f"{value} +- 0.06 (n = 9)", f"p{k}") for k, value in enumerate((0.5, 0.6, 0.7)))
    (first,) = calibrated(bed() + three, "wall_static_friction", budget=13).parameters
    (second,) = calibrated(bed() + three, "wall_static_friction", budget=13, hold_out=["p0"]).parameters
    assert (first.mean, second.mean) == (0.5, 0.6)


def test_what_does_not_take_part_is_reported_with_the_reason(calibrated):
    text = bed() + heap(pile_height="25 +- 1 mm (n = 5)") + drum(angle_of_repose_geometric=ANGLE)
    found = calibrated(text, "cylinder_diameter=49mm..51mm", budget=13)
    without, apart, *_ = found.remarks
    assert without.startswith("heap was not fitted: nothing that can be fitted was measured in heap (of a pile: ")
    assert without.endswith("not doubtful; measured: pile_height)")
    assert apart == "drum was not fitted: it depends on none of the parameters"
    assert {one.experiment for one in found.targets} == {"bed"}


def test_an_experiment_held_out_is_predicted_and_fits_nothing(calibrated):
    text = bed() + drum(angle_of_repose_geometric=ANGLE)
    found = calibrated(text, "static_friction", budget=13, hold_out=["drum"])
    assert {one.experiment for one in found.targets} == {"bed"}
    assert {(row["experiment"], row["held_out"]) for row in found.predictions} == {("bed", False), ("drum", True)}
    assert found.runs == 16, "8 + 2 of the search, 3 of the best set in both experiments"


@pytest.mark.parametrize(
    ("slide", "roll", "parameter"), [("0.41", "0.021", "static_friction"), ("0.39", "0.019", "rolling_friction")]
)
def test_a_measured_coefficient_beside_another_one_of_the_model_is_pointed_out(calibrated, slide, roll, parameter):
    """More than two standard uncertainties of 0.02 from the 0.36 and 0.06 of the reference."""
    plates = plate(f"{slide} +- 0.06 (n = 9)") + plate(f"{roll} +- 0.06 (n = 9)", "ramp", "roll", "rolling_friction")
    found = calibrated(bed() + plates, "static_friction", budget=13)
    used, measured = (
        ("0.36", f"plate measured {slide}") if parameter.startswith("s") else ("0.06", f"ramp measured {roll}")
    )
    assert [one for one in found.remarks if "--fit" in one] == [
        f"{parameter} of D6-steel is {used} in the model, {measured} +- 0.02; "
        f"--fit {parameter}@D6-steel uses the measured value"
    ]


def test_coefficients_that_are_fitted_or_were_not_measured_are_not_pointed_out(calibrated):
    text = bed() + plate("0.55 +- 0.06 (n = 9)") + drop("0.7 +- 0.03 (n = 9)")
    found = calibrated(text, "wall_static_friction", budget=13)
    pointed_out = [one for one in found.remarks if "--fit" in one]
    assert len(pointed_out) == 1
    assert pointed_out[0].startswith("restitution of D6-steel is 0.42 in the model, drop measured 0.7 +- 0.01")
    found = calibrated(text, "static_friction", budget=13, hold_out=["plate"])
    assert [one for one in found.remarks if "plate" in one] == []


def test_the_files_say_what_the_calibration_says(calibrated, tmp_path):
    found = calibrated(bed(), "static_friction=0.1..0.9", budget=13)
    assert sorted(path.name for path in found.files.values()) == sorted([
        "calibration.json", "calibration.html", "posterior.csv", "model.toml", "calibration-methods.md",
        "calibration-references.bib", "figures",
    ])  # fmt: skip
    assert all(path == tmp_path / "out" / name and path.exists() for name, path in found.files.items())
    document = json.loads(found.files["calibration.json"].read_text(encoding="utf-8"))
    assert document == json.loads(json.dumps(found.to_json()))
    with found.files["posterior.csv"].open(newline="") as file:
        rows = [float(row["static_friction"]) for row in csv.DictReader(file)]
    assert rows == pytest.approx(found.samples[:, 0].tolist(), rel=1e-6)
    friction = read_model(found.files["model.toml"]).known_contact("D6", "D6").static_friction
    assert friction == pytest.approx(found.best["static_friction"])
    assert (tmp_path / "out" / "runs" / "ledger.sqlite").is_file()


def test_another_calibration_in_the_same_folder_is_replaced_with_a_remark(calibrated, tmp_path):
    def replaced(*fit):
        found = calibrated(bed(), *fit, budget=13)
        return [one for one in found.remarks if "is replaced" in one]

    assert replaced("static_friction=0.1..0.9") == []
    assert replaced("static_friction=0.1..0.9") == []
    assert replaced("static_friction=0.1..0.8") == [
        f"the calibration of static_friction between 0.1 and 0.9 (SI) in {tmp_path / 'out'} is replaced; its runs are "
        "kept in runs/, from which the earlier command can write it again; give --out another folder to keep both"
    ]
    for other in ("{", "[1]", "{}", '{"priors": {"a": 1}}', '{"priors": {"a": {"low": "x", "high": 1}}}'):
        (tmp_path / "out" / "calibration.json").write_text(other)
        assert replaced("static_friction=0.1..0.8") == [], "no calibration that can be read"


def test_the_further_experiment_is_looked_for_where_the_budget_has_runs_for_it(calibrated):
    text = bed() + drum(angle_of_repose_geometric="33 +- 0.3 deg (n = 5)")
    fit = ("static_friction", "rolling_friction")
    few = calibrated(text, *fit, budget=33)
    assert few.ambiguous
    assert few.next_experiments == ()
    assert "8 more runs would show which further experiment separates the sets: --budget 34 or more" in few.remarks
    enough = calibrated(text, *fit, budget=34)
    assert {row["quantity"] for row in enough.next_experiments} == {"angle_of_repose_geometric", "discharge_time"}
    assert enough.runs == 34
    assert not any("--budget" in one for one in enough.remarks)


def test_no_further_experiment_is_named_where_all_rigs_are_fitted(calibrated):
    others = heap(angle_of_repose_geometric="28 +- 0.6 deg (n = 5)") + drum(angle_of_repose_geometric=ANGLE)
    text = bed() + others + hopper(discharge_time="2 +- 0.2 s (n = 5)")
    found = calibrated(text, "static_friction", "rolling_friction", budget=52)
    assert found.ambiguous
    assert found.fits
    assert found.next_experiments == ()
    assert not any("--budget" in one for one in found.remarks)


@pytest.mark.parametrize(
    ("fit", "why"),
    [
        (["count=300..500"], "--fit: count is a whole number, which cannot be fitted; `rigtwin sweep` varies it."),
        (["lift_speed"], "--fit: no experiment that is fitted depends on 'lift_speed'; "),
        (["static_friction@D6-steal"], "did you mean 'static_friction@D6-steel'"),
        (["static_friction", "static_friction@D6-D6"], "--fit: static_friction@D6-D6 and static_friction are the same"),
    ],
)
def test_a_parameter_that_cannot_be_fitted_is_refused(calibrated, fit, why):
    assert why in refused(calibrated, bed(), *fit)


def test_each_contact_is_named_once_where_a_parameter_is_unknown(calibrated):
    said = refused(calibrated, bed(), "static_friction@D6-glass")
    assert (said.count("static_friction@D6-steel"), said.count("static_friction@steel-D6")) == (1, 0)
    assert said.endswith(", and parameters of effects.")


def test_number_of_particles_rolling_law_and_seed_reach_every_twin(calibrated, monkeypatch):
    asked = []

    def recorded(**settings):
        asked.append(settings)
        return twin(**settings)

    monkeypatch.setattr("rigtwin.compare.campaign.twin_runs.simulate", recorded)
    given = {"count": 300, "rolling": "type C", "seed": 7}
    calibrated(bed().replace("count = 400", ""), "static_friction", budget=13, **given)
    assert {(one["count"], one["rolling"]) for one in asked} == {(300, "type C")}
    assert [one["seed"] for one in asked] == [*range(7, 17), *range(100_007, 100_010)]


def test_one_name_for_several_contacts_is_refused_unless_it_is_no_contact(calibrated):
    text = bed() + drum(angle_of_repose_geometric=ANGLE)
    assert refused(calibrated, text, "wall_static_friction") == (
        "--fit: wall_static_friction would be one value of several contacts; name them: "
        "static_friction@D6-steel, static_friction@D6-PMMA."
    )
    (scale,) = calibrated(text, "scale=0.95..1.05", budget=26).parameters
    assert (scale.name, scale.low, scale.high) == ("scale", 0.95, 1.05)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"hold_out": ["bed"]}, "has nothing to fit: no experiment with many particles that is not held out."),
        ({"hold_out": ["bad"]}, "--hold-out: there is no experiment 'bad'; did you mean 'bed'"),
        ({"workers": 0}, "--workers: "),
        ({"cluster": "here"}, "--cluster: 'here' is neither"),
        ({"budget": 12}, "--budget: 12 runs are too few for 1 parameter and 1 experiment; give at least 13."),
    ],
)
def test_what_cannot_be_calibrated_is_refused(calibrated, more, why):
    assert why in refused(calibrated, bed() + plate("0.55 +- 0.06 (n = 9)"), "static_friction", **more)


@pytest.fixture
def of_bed(quick, tmp_path):
    """`of_bed(*quantities, failures=, **more)`: the calibration on measurements of a bed."""
    (tmp_path / "lab.toml").write_text(bed() + bed(name="other"), encoding="utf-8")
    lab = read_lab(tmp_path)

    def of_bed(*quantities, failures=(), **more):
        one, other = (replace(experiment, measured=()) for experiment in lab.experiments)
        found = {
            "bed": Measured(one, (Measurement("packing", Path("a.csv"), "", quantities),), tuple(failures)),
            "other": Measured(other, (), (Failure(Path("b.csv"), "it is empty."),)),
        }
        both = replace(lab, experiments=(one, other))
        given = {"fit": ["static_friction"], "budget": 13, **more}
        return subject.calibrate_lab(both, found, tmp_path / "out", **given)

    return of_bed


def test_a_coefficient_that_is_doubtful_or_of_unknown_uncertainty_is_no_prior(quick, tmp_path):
    quantities = {
        "unknown": (0.51, math.inf, ""),
        "exact": (0.52, 0.0, ""),
        "leaning": (0.53, 0.02, "it leans"),
        "sound": (0.54, 0.02, ""),
    }
    text = bed() + "".join(plate("1 +- 1", name) for name in quantities)
    (tmp_path / "lab.toml").write_text(text, encoding="utf-8")
    lab = read_lab(tmp_path)
    stated, *plates = lab.experiments
    found = {"bed": Measured(stated, (), ())}
    for one, (value, std, why) in zip(plates, quantities.values(), strict=True):
        friction = Quantity("static_friction", value, std, "1", "onset of motion", doubtful=why)
        found[one.id] = Measured(replace(one, measured=()), (Measurement("tilt", Path("a"), "", (friction,)),), ())
    (prior,) = subject.calibrate_lab(lab, found, tmp_path / "out", fit=["wall_static_friction"], budget=13).parameters
    assert (prior.mean, prior.std) == (0.54, 0.02)


def height(value=0.06, std=1e-3, method="surface bead tops", name="bed_height", **more):
    return Quantity(name, value, std, "m", method, **more)


def test_the_first_sound_method_of_each_result_is_the_target(of_bed):
    found = of_bed(
        height(0.050, doubtful="it leans"),
        height(0.051, math.inf, "level"),
        height(0.06, method="surface bead tops", detail={"side": "left"}),
        height(0.061),
        height(0.059, method="outline"),
        reading={"bed_height": 2e-3},
    )
    (target,) = found.targets
    assert (target.experiment, target.quantity, target.method, target.unit) == (
        "bed", "bed_height", "surface bead tops", "m",
    )  # fmt: skip
    assert (target.value, target.std_uncertainty, target.repetitions, target.reading_std) == (0.061, 1e-3, 1, 2e-3)


def test_the_bulk_density_is_a_target_only_without_the_bed_height_and_read_without_a_convention(quick, of_bed):
    density = Quantity("bulk_density", 390.0, 2.0, "kg/m^3", "surface bead tops")
    (target,) = of_bed(density, height(), reading={"bulk_density": 1.0}).targets
    assert (target.quantity, target.reading_std) == ("bed_height", 0.0)


def test_media_that_were_not_measured_are_named_once(of_bed):
    found = of_bed(height(), failures=[Failure(Path("c.csv"), "it is torn.")], remarks=["as given"])
    given, empty, torn, *_ = found.remarks
    assert given == "as given"
    assert empty.startswith(
        "other was not fitted: nothing that can be fitted was measured in other (of a packing: bed_height"
    )
    assert empty.endswith("measured: nothing): b.csv was not measured: it is empty")
    assert torn == "bed: c.csv was left out: it is torn."
    assert sum("b.csv" in one for one in found.remarks) == 1


def test_an_experiment_held_out_of_which_nothing_was_measured_is_named(of_bed):
    found = of_bed(height(), hold_out=["other"])
    assert found.remarks[0].startswith("other was not predicted: nothing that can be fitted was measured in other")
    assert found.remarks[0].endswith("b.csv was not measured: it is empty")
    assert sum("b.csv" in one for one in found.remarks) == 1


def test_where_nothing_can_be_fitted_all_reasons_are_named(of_bed):
    with pytest.raises(BadInput) as error:
        of_bed(height(doubtful="it leans"), height(0.05, detail={"side": "left"}))
    said = str(error.value)
    assert "measured in bed (of a packing: bed_height, bulk_density, the mean of both sides and not doubtful" in said
    assert "measured: bed_height (doubtful), left bed_height): doubtful: it leans; nothing" in said
    assert said.endswith("b.csv was not measured: it is empty.")
