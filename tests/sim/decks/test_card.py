"""Export to other codes: the same torques and the same restitution in their conventions."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigtwin.cli import run
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rolling_conventions import rolling_friction
from rigtwin.sim.decks.card import export
from rigtwin.sim.engine.contact import damping_ratio

D6, STEEL = hlosta2020.particle("D6"), hlosta2020.material("steel")
AMONG, ON_STEEL = Contact(0.75, 0.44, 0.08), Contact(0.42, 0.36, 0.06)


@given(
    coefficient=st.floats(0, 2),
    radius=st.floats(1e-5, 1),
    times=st.floats(1, 1 + 1e-12),
)
def test_the_torque_limit_on_each_sphere_stays(coefficient, radius, times):
    other = radius * times
    effective = radius * other / (radius + other)
    there = rolling_friction(coefficient, radius, other, arm="effective radius")
    assert there * effective == pytest.approx(coefficient * radius)
    assert rolling_friction(coefficient, radius, arm="effective radius") == coefficient
    assert rolling_friction(coefficient, radius, other, arm="own radius") == coefficient


def test_no_coefficient_gives_unequal_spheres_two_torques_where_they_feel_one():
    with pytest.raises(BadInput, match="no coefficient gives both"):
        rolling_friction(0.1, 3e-3, 4e-3, arm="effective radius")


@given(restitution=st.floats(0.22, 1))
def test_the_restitution_for_liggghts_gives_our_damping_ratio(restitution):
    made = export("liggghts", D6, STEEL, Contact(restitution), ON_STEEL)
    there = made.between.restitution
    usual = -math.log(there) / math.hypot(math.pi, math.log(there))
    assert usual == pytest.approx(damping_ratio(restitution), abs=1e-12)
    assert there <= restitution


def test_edem_gets_what_the_paper_means():
    made = export("edem", D6, STEEL, AMONG, ON_STEEL)
    assert (made.between, made.at_wall) == (AMONG, ON_STEEL)
    assert "interaction D6 - steel: restitution 0.42, static friction 0.36, rolling friction 0.06" in made.text


def test_liggghts_reads_pairs_of_types_in_order():
    lines = export("liggghts", D6, STEEL, AMONG, ON_STEEL, rolling="type A").text.splitlines()
    said = {line.split()[1]: line.split()[5:] for line in lines if line.startswith("fix")}
    assert said["coefficientRollingFriction"] == ["peratomtypepair", "2", "0.16", "0.06", "0.06", "0.06"]
    assert said["coefficientFriction"] == ["peratomtypepair", "2", "0.44", "0.36", "0.36", "0.36"]
    assert [float(value) for value in said["youngsModulus"][1:]] == [11e6, 210e6]  # a thousandth
    assert "pair_style gran model hertz tangential history rolling_friction cdt" in lines


@pytest.mark.parametrize("code", ["edem", "liggghts"])
def test_the_output_states_that_the_moduli_are_softened(code):
    words = "the moduli are 0.001 of the real ones"
    assert words in export(code, D6, STEEL, AMONG, ON_STEEL).text
    assert words not in export(code, D6, STEEL, AMONG, ON_STEEL, stiffness_factor=1.0).text


def test_moduli_out_of_liggghts_range_get_the_confirming_command():
    rubber = Particle("ball", Material("rubber", 1100, 1e7, 0.49), 6e-3)

    def wants(factor):
        text = export("liggghts", rubber, STEEL, AMONG, ON_STEEL, stiffness_factor=factor).text
        return [word for word in ("soft", "hard") if f"{word}_particles yes" in text]

    assert [wants(factor) for factor in (0.1, 1, 1e-3)] == [["soft", "hard"], ["hard"], ["soft"]]


def test_a_large_time_step_gives_a_warning():
    made = export("edem", D6, STEEL, AMONG, ON_STEEL, time_step_fraction=0.5)
    assert "50%" in made.warnings[0]
    assert made.warnings[0] in made.text


def test_clumps_low_restitution_and_unknown_codes_are_refused():
    with pytest.raises(BadInput, match="clump"):
        export("edem", hlosta2020.particle("C6_8s-a"), STEEL, AMONG, ON_STEEL)
    with pytest.raises(BadInput, match="smallest that LIGGGHTS can reach"):
        export("liggghts", D6, STEEL, Contact(0.1), ON_STEEL)
    with pytest.raises(BadInput, match="unknown"):
        export("yade", D6, STEEL, AMONG, ON_STEEL)


def test_the_command_writes_a_file_and_json(tmp_path, capsys):
    path = tmp_path / "new" / "d6.in"
    assert run(["export", "liggghts", "--particle", "D6", "--wall", "steel", "--out", str(path), "--json"]) == 0
    written = json.loads(capsys.readouterr().out)
    assert written["contacts"]["particle-particle"]["rolling_friction"] == pytest.approx(0.16)
    assert f"timestep {written['time_step_s']:.10g}" in path.read_text()
    assert run(["export", "edem"]) == 0
    assert "rolling friction 0.08" in capsys.readouterr().out
    assert run(["export", "edem", "--out", str(tmp_path)]) == 2
    assert run(["export", "liggghts", "--particle", "C6"]) == 2
