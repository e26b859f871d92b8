"""The paper's numbers come out as printed, with its misprints put right; values checked by eye against the paper."""

import pytest

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.reference.hlosta2020 import PARTICLES, WALLS, contact, material, measured, mixed_restitution, table

SPHERES = [name for name in PARTICLES if name not in ("C6", "P6x15")]


@pytest.mark.parametrize(
    ("name", "density", "modulus", "ratio"),
    [
        ("steel", 7850, 210e9, 0.30),
        ("aluminum", 2700, 69e9, 0.33),
        ("glass", 2600, 70e9, 0.22),
        ("PMMA", 1250, 3e9, 0.40),
        ("ABS", 1050, 2.25e9, 0.35),
        ("wood_ash", 720, 11e9, 0.44),
    ],
)
def test_materials_are_those_of_table_2(name, density, modulus, ratio):
    solid = material(name)
    assert (solid.density, solid.poisson_ratio) == (density, ratio)
    assert solid.youngs_modulus == pytest.approx(modulus)


@pytest.mark.parametrize(
    ("name", "millimetres", "density", "solid"),
    [
        ("D4", 4.2, 567, "wood_ash"),
        ("D6", 6.2, 569, "wood_ash"),
        ("D12", 12.2, 726, "wood_ash"),
        ("D6_ABS", 6.0, 1768, "ABS"),
        ("D5_steel", 5.0, 7639, "steel"),
    ],
)
def test_spheres_have_the_size_and_density_of_the_calibrated_model(name, millimetres, density, solid):
    bead = hlosta2020.particle(name)
    assert bead.diameter * 1e3 == pytest.approx(millimetres)
    assert bead.effective_density == density
    assert bead.material.name == solid


@pytest.mark.parametrize("name", SPHERES)
def test_the_volume_of_a_sphere_is_that_of_table_3(name):
    bead = hlosta2020.particle(name)
    (row,) = hlosta2020.properties(name)
    assert bead.mass / bead.effective_density * 1e9 == pytest.approx(row["dem_volume_mm3"], abs=0.06)


@pytest.mark.parametrize("name", ["C6", "P6x15"])
def test_cubes_and_pellets_are_clumps_whose_properties_are_listed(name):
    assert hlosta2020.particle(name).shape is not None
    assert all(row["material"] == "wood_ash" for row in hlosta2020.properties(name))


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ("D6", "steel", Contact(0.42, 0.36, 0.06)),
        ("D6", "aluminum", Contact(0.55, 0.15, 0.06)),
        ("D12", "PMMA", Contact(0.35, 0.40, 0.05)),
        ("D5_steel", "glass", Contact(0.68, 0.22, 0.02)),
        ("D6_ABS", "steel", Contact(0.72, 0.49, 0.025)),
        ("C6", "glass", Contact(0.28, 0.40, 0.06)),
        ("D6", "D6", Contact(0.75, 0.44, 0.08)),
        ("P6x15", "P6x15", Contact(0.78, 0.25, 0.03)),
        ("D12", "D4", Contact(0.67, 0.40, 0.08)),  # rolling: mean of 0.04 and 0.12
        ("D5_steel", "D6_ABS", Contact(0.85, 0.18, 0.03)),
    ],
)
def test_contacts_are_those_of_the_appendix_in_either_order(a, b, expected):
    assert contact(a, b) == contact(b, a) == expected


def test_every_particle_has_a_contact_with_every_other_and_every_wall():
    for a in PARTICLES:
        for b in (*PARTICLES, *WALLS):
            assert 0 < contact(a, b).restitution < 1


@pytest.mark.parametrize(("a", "b"), [("D6", "ABS"), ("steel", "glass"), ("D7", "steel"), ("D6", "D7")])
def test_a_contact_that_the_paper_lacks_is_refused(a, b):
    with pytest.raises(BadInput, match="has no contact"):
        contact(a, b)


@pytest.mark.parametrize(
    ("quantity", "particle", "other", "value", "std"),
    [
        ("restitution_wall", "D6", "aluminum", 0.47, 0.03),
        ("restitution_wall", "D5_steel", "PMMA", 0.40, 0.00),
        ("restitution_pair", "D4", "C6", 0.66, 0.08),
        ("restitution_pair", "D6", "D6", 0.73, 0.04),
        ("static_friction", "D12", "glass", 0.35, 0.03),
        ("static_friction", "D12", "D12", 0.37, 0.02),
        ("static_friction_angle", "D4", "PMMA", 30.9, 2.3),
        ("rolling_friction", "D4", None, 0.14, 0.03),
        ("rolling_friction_angle", "D6_ABS", None, 1.5, 0.4),
    ],
)
def test_measured_values_carry_their_standard_deviation(quantity, particle, other, value, std):
    found = measured(quantity, particle, other)
    assert (found.value, found.std) == (value, std)
    assert found.unit == ("deg" if quantity.endswith("angle") else "1")


@pytest.mark.parametrize(
    ("quantity", "particle", "other"),
    [
        ("rolling_friction", "C6", None),
        ("restitution_wall", "D6", "D6"),
        ("colour", "D6", None),
        ("restitution_wall", "D7", "steel"),
    ],
)
def test_a_value_that_was_not_measured_is_refused(quantity, particle, other):
    with pytest.raises(BadInput, match=f"no measured {quantity} of {particle}"):
        measured(quantity, particle, other)


def test_equation_8_gives_every_unlike_pair_of_table_12_to_its_rounding():
    modulus = dict.fromkeys(PARTICLES, 11.0) | {"D6_ABS": 2.25, "D5_steel": 210.0}
    like = {name: measured("restitution_pair", name, name).value for name in PARTICLES}
    unlike = [(a, b) for k, a in enumerate(PARTICLES) for b in PARTICLES[:k]]
    assert len(unlike) == 21
    for a, b in unlike:
        expected = measured("restitution_pair", a, b).value
        assert mixed_restitution(modulus[a], like[a], modulus[b], like[b]) == pytest.approx(expected, abs=0.00501)


def test_a_mix_with_itself_is_itself_and_the_stiffer_body_counts_more():
    assert mixed_restitution(11, 0.7, 11, 0.7) == pytest.approx(0.7)
    assert mixed_restitution(210, 0.85, 11, 0.61) > (0.85 + 0.61) / 2


def test_the_misprinted_time_step_of_table_13_is_corrected_unless_asked_for():
    assert table(13)[-1]["timestep_s"] == 2.45e-6
    assert table("13", as_printed=True)[-1]["timestep_s"] == 2.45e-7
    assert table(13)[:-1] == table(13, as_printed=True)[:-1]


def test_time_steps_of_table_13_fall_with_the_root_of_the_stiffness():
    products = [row["timestep_s"] * row["shear_modulus_pa"] ** 0.5 for row in table(13)]
    assert max(products) / min(products) == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize(
    ("number", "rows"),
    [
        *[(2, 6), (3, 13), (4, 56), (5, 56), (6, 56), (7, 14), (8, 28), (9, 28), (10, 6), (11, 28), (12, 28), (13, 5)],
        *[(14, 21), (15, 21), (16, 7), ("A2", 7), ("A3", 28), ("a4", 28), ("A5", 28), ("A6", 28), ("A7", 7)],
    ],
)
def test_every_table_is_there_with_all_its_rows(number, rows):
    assert len(table(number)) == rows


@pytest.mark.parametrize("number", [1, 17, "A1", "A", "", "1_", "packing"])
def test_a_table_that_is_not_there_is_refused(number):
    with pytest.raises(BadInput, match="has no table"):
        table(number)


def test_changing_a_row_that_was_handed_out_changes_nothing_for_the_next():
    table(2)[0]["density_kg_m3"] = 1.0
    assert material("steel").density == 7850


def test_measured_heaps_are_those_of_table_14():
    rows = {(row["particle"], row["rig"]): row for row in table(14)}
    assert rows["D6", "piling_90mm"]["aor_exp_deg"] == 30.3
    assert rows["D6", "piling_90mm"]["aor_dem_deg"] == 30.5
    assert rows["D12", "drum_140mm_3rpm"]["aor_exp_std_deg"] == 9.3
