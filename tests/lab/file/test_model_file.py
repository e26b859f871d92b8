"""A model comes back from its file as it was written; materials and contacts refuse what cannot be."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file.model_file import Model, model_text, read_model
from rigtwin.lab.materials import AIR_DENSITY, HEAVIEST, Contact, KnownContact, Material, Particle, clumped, pair
from rigtwin.lab.reference import hlosta2020

POSITIVE = st.floats(1e-6, 1e12)
MODULI = st.floats(1e3, 1e12)
DIAMETERS = st.floats(1e-6, 10)
DENSITIES = st.none() | st.floats(AIR_DENSITY, HEAVIEST, exclude_min=True)
NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"], exclude_characters="-"), min_size=1)
FRACTIONS = st.none() | st.floats(0.001, 1)


@st.composite
def models(draw):
    names = draw(st.lists(NAMES, min_size=2, max_size=4, unique=True))
    names = [f"{name}_" for name in names]  # no name of the reference
    solids = {
        name: Material(name, draw(POSITIVE), draw(MODULI), draw(st.floats(0, 0.499, allow_subnormal=False)))
        for name in names[: len(names) // 2]
    }
    beads = {
        name: Particle(name, draw(st.sampled_from(list(solids.values()))), draw(DIAMETERS), draw(DENSITIES))
        for name in names[len(names) // 2 :]
    }
    contacts = {
        pair(bead, draw(st.sampled_from(names))): KnownContact(draw(FRACTIONS), draw(FRACTIONS), draw(FRACTIONS))
        for bead in beads
    }
    words = st.text("abc \"'\\ö", max_size=5)
    effects = draw(
        st.dictionaries(
            words, st.dictionaries(words, st.floats(-1e6, 1e6, allow_subnormal=False), max_size=2), max_size=2
        )
    )
    return Model(solids, beads, contacts, effects)


@settings(deadline=None, derandomize=True)
@given(model=models())
def test_a_model_comes_back_from_its_file_as_it_was_written(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "model.toml"
    path.write_text(model_text(model), encoding="utf-8")
    assert read_model(path) == model


def test_a_model_file_with_an_unknown_key_is_refused_with_its_line(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text("[effects]\n[materials.ash]\ndensty = 1\n")
    with pytest.raises(BadLabFile, match=r"model\.toml has 3 faults: line 3: materials\.ash\.densty.*'density'"):
        read_model(path)


def test_a_parameter_set_in_a_model_leaves_the_others_and_the_old_model_alone():
    before = Model(contacts={("D6", "steel"): KnownContact(0.4, 0.3, 0.1)})
    after = before.with_contact("steel", "D6", restitution=0.5)
    assert after.contact("D6", "steel") == Contact(0.5, 0.3, 0.1)
    assert before.contact("D6", "steel") == Contact(0.4, 0.3, 0.1)


def test_only_the_parameters_that_a_rig_needs_must_be_known():
    model = Model().with_contact("D6", "steel", restitution=0.5)
    assert model.contact("D6", "steel", ("restitution",)) == Contact(0.5, 0.0, 0.0)
    with pytest.raises(BadInput, match="static_friction of the contact D6-steel is not known"):
        model.contact("D6", "steel")


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Material("ash", 0, 1e9, 0.3),
        lambda: Material("ash", 700, math.nan, 0.3),
        lambda: Material("ash", 700, 1e9, 0.5),
        lambda: Particle("D6", hlosta2020.material("ABS"), -0.006),
        lambda: Particle("D6", hlosta2020.material("ABS"), 0.006, density=0.0),
        lambda: Contact(0.0),
        lambda: Contact(1.1),
        lambda: Contact(0.5, static_friction=-0.1),
        lambda: Contact(0.5, rolling_friction=math.inf),
    ],
)
def test_a_thing_that_cannot_be_is_refused(wrong):
    with pytest.raises(BadInput, match="must"):
        wrong()


def test_a_model_file_leaves_out_the_clumps_that_are_known_by_name_and_holds_others(tmp_path):
    cube = hlosta2020.particle("C6_9s")
    (tmp_path / "model.toml").write_text(model_text(Model(particles={"C6_9s": cube})), encoding="utf-8")
    assert "C6_9s" not in read_model(tmp_path / "model.toml").particles
    # the mass properties of a body from an STL file are not those of its spheres
    body = replace(cube.shape, volume=1.1 * cube.shape.volume, gyration=(1e-6, 2e-6, 3e-6))
    own = clumped("own", cube.material, body)
    model = Model(materials={cube.material.name: cube.material}, particles={"own": own, "C6_9s": cube})
    (tmp_path / "model.toml").write_text(model_text(model), encoding="utf-8")
    assert read_model(tmp_path / "model.toml").particles == {"own": own}


@pytest.mark.parametrize(("shear_modulus", "step"), [(1e6, 2.45e-4), (1e7, 7.77e-5), (1e8, 2.45e-5), (1e9, 7.74e-6)])
def test_the_rayleigh_step_of_a_bead_is_that_of_table_13(shear_modulus, step):
    """Hlosta et al. 2020, table 13: the steps are those of a 6.2 mm bead; three digits are printed."""
    bead = hlosta2020.particle("D6")
    softened = bead.material.softened(shear_modulus / bead.material.shear_modulus)
    model_bead = Particle("D6", softened, bead.diameter, bead.density)
    assert model_bead.rayleigh_time_step == pytest.approx(step, rel=0.005)


def test_a_bead_of_the_paper_weighs_what_table_3_says():
    for name, grams in {"D4": 0.022, "D6": 0.071, "D12": 0.690, "D6_ABS": 0.200, "D5_steel": 0.500}.items():
        assert hlosta2020.particle(name).mass * 1e3 == pytest.approx(grams, rel=0.005, abs=5e-4)
