"""Effect of the stated uncertainty of a bead's diameter on the coefficients fitted beside it."""

import json

import pytest

from rigtwin.benchmarks.diagnose.draw_labs import Case, write
from rigtwin.compare.diagnose.data.read_lab_json import read_tracked_lab
from rigtwin.compare.diagnose.diagnosis import bench_of, diagnose
from rigtwin.compare.diagnose.fitting.fit import fit
from rigtwin.sim.effects import named


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [(10160, 127), pytest.param((10161, 318), marks=pytest.mark.slow), pytest.param((11,), marks=pytest.mark.slow)],
)
def test_pivot_friction_beside_drag_is_found_with_slightly_wrong_diameters(seed, tmp_path):
    """With fixed stated diameters of two sizes the share of the pivot was off by three standard deviations or more."""
    truth = write(Case("pair", "pendulum", ("air_drag", "pivot_friction"), "moderate"), "lab", seed, tmp_path)
    bench = bench_of(read_tracked_lab(tmp_path / "labs" / "lab"))
    law = "air_drag_schiller_naumann" if "c_D" in truth["parameters"] else "air_drag"
    found = fit(bench, (named(law), named("pivot_friction")))
    moment = "pivot_friction.moment"
    assert abs(found.value(moment) - truth["parameters"]["tau_c"]) < 2.5 * found.std(moment)


@pytest.mark.slow
def test_another_plate_separates_a_loss_to_the_plate_from_one_in_the_bead(tmp_path):
    """One plate cannot separate them; the proposed experiment, simulated here, names the plate."""
    case = Case("single", "drop", ("plate_compliance",), "moderate")
    write(case, "lab", (10250, 66), tmp_path, narrowed=True)
    alike = diagnose(read_tracked_lab(tmp_path / "labs" / "lab"))
    assert alike.verdict == "indistinguishable"
    assert "plate of the same material" in alike.designs[0].words
    write(case, "further", (10250, 66), tmp_path, narrowed=True, design=alike.designs[0].to_json())
    result = diagnose(read_tracked_lab(tmp_path / "labs" / "further")).to_json()
    assert result["verdict"] == "named"
    assert [effect["effect"] for effect in result["effects"]] == ["plate_compliance"]


def with_half_the_thickness(effect, seed, folder):
    """A lab of one drop on two plates of one material, one half as thick, that hides this effect."""
    change = {"density": 1.0, "size": 1.0, "state": {}, "release": None, "longer": 1.0, "thickness": 0.5}
    case = Case("single", "drop", (effect,), "moderate")
    write(case, "plain", seed, folder, narrowed=True)
    document = json.loads((folder / "labs" / "plain" / "lab.json").read_text())
    design = {"condition": document["conditions"][0]["name"], "change": change}
    write(case, "both", seed, folder, narrowed=True, design=design)
    return folder / "labs" / "both"


def named_in(lab):
    said = diagnose(read_tracked_lab(lab)).to_json()
    return said["verdict"], [effect["effect"] for effect in said["effects"]]


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["plate_compliance", "velocity_dependent_restitution"])
def test_two_plates_of_one_material_separate_bending_of_the_plate_from_losses_in_the_bead(effect, tmp_path):
    verdict, names = named_in(with_half_the_thickness(effect, (10600, 10), tmp_path))
    assert verdict == "named"
    assert (names == ["plate_compliance"]) == (effect == "plate_compliance")


@pytest.mark.slow
def test_plates_of_different_stated_materials_are_not_tied(tmp_path):
    """A density that differs by a millionth unties the restitutions of the two plates and changes nothing else."""
    lab = with_half_the_thickness("plate_compliance", (10600, 10), tmp_path)
    document = json.loads((lab / "lab.json").read_text())
    next(iter(document["walls"].values()))["density_kg_m3"] *= 1 + 1e-6
    (lab / "lab.json").write_text(json.dumps(document))
    assert named_in(lab)[0] == "indistinguishable"
