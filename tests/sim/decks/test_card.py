"""Export to other codes: the same torques and the same restitution in their conventions."""

import csv
import json
import math
import re
import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigtwin.cli import run
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle, sized
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rolling_conventions import rolling_friction
from rigtwin.lab.size_distributions import listed, sieved
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


def test_low_restitution_and_unknown_codes_are_refused():
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
    assert run(["export", "liggghts", "--particle", "P6x15"]) == 0
    assert "particletemplate/multisphere" in capsys.readouterr().out


def classes_of(text):
    """Diameters and shares by mass of the classes of a CSV card."""
    rows = [row for row in csv.DictReader(text.splitlines()) if row["kind"] == "size"]
    return [(float(row["diameter_m"]), float(row["share_by_mass"])) for row in rows]


def test_the_csv_of_clumps_of_several_sizes_says_that_it_has_the_largest():
    cube = sized(hlosta2020.particle("C6_8s-a"), listed([4e-3, 6e-3], [0.3, 0.7]))
    made = export("csv", cube, STEEL, AMONG, ON_STEEL)
    [said] = made.warnings
    assert said.startswith("diameter, its spheres, mass and moments of C6_8s-a are those of its largest size, 6 mm;")
    assert not export("csv", hlosta2020.particle("C6_8s-a"), STEEL, AMONG, ON_STEEL).warnings


def test_a_clump_is_exported_with_its_spheres_mass_and_moments():
    cube = hlosta2020.particle("C6_8s-a")
    rows = list(csv.DictReader(export("csv", cube, STEEL, AMONG, ON_STEEL).text.splitlines()))
    spheres = [row for row in rows if row["kind"] == "sphere"]
    places = [tuple(float(row[f"{axis}_m"]) for axis in "xyz") for row in spheres]
    assert np.array(places) == pytest.approx(np.array(cube.shape.offsets), abs=1e-12)
    assert [float(row["diameter_m"]) / 2 for row in spheres] == pytest.approx(cube.radii)
    assert float(rows[0]["mass_kg"]) == pytest.approx(cube.mass)
    text = export("edem", cube, STEEL, AMONG, ON_STEEL).text
    assert "sphere 8: x " in text
    assert f"mass {cube.mass:.6g} kg" in text
    said = export("liggghts", cube, STEEL, AMONG, ON_STEEL).to_json()["particle"]
    assert said["moments_kg_m2"] == pytest.approx(cube.moments)
    assert len(said["spheres_m"]) == 8


def test_sizes_are_exported_as_classes_with_their_share_of_the_mass():
    few = sized(D6, listed([4e-3, 6e-3], [0.3, 0.7]))
    assert classes_of(export("csv", few, STEEL, AMONG, ON_STEEL).text) == [(4e-3, 0.3), (6e-3, pytest.approx(0.7))]
    many = classes_of(export("csv", sized(D6, sieved([2e-3, 4e-3, 8e-3], [2, 8])), STEEL, AMONG, ON_STEEL).text)
    assert len(many) == 10
    assert sum(share for _, share in many) == pytest.approx(1)
    assert sum(share for diameter, share in many if diameter < 4e-3) == pytest.approx(0.2, abs=0.05)
    assert "70 % of the mass" in export("edem", few, STEEL, AMONG, ON_STEEL).text


THROWN = """{soft}atom_style granular
atom_modify map array
boundary f f f
newton off
communicate single vel yes
units si
region box block 0 0.06 0 0.06 0 0.06 units box
create_box 2 box
neighbor 0.002 bin
neigh_modify delay 0
include card.in
region inside block 0.005 0.055 0.005 0.055 0.005 0.055 units box
fix throw all insert/pack seed 32452843 distributiontemplate sizes maxattempt 1000 insert_every once &
  overlapcheck yes orientation random all_in yes vel constant 0 0 -0.3 region inside particles_in_region 40
fix move all {move}
compute mass all property/atom mass
compute whole all reduce sum c_mass
thermo_style custom step atoms c_whole
run 1
print "found $(atoms) $(c_whole)"
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("liggghts") is None, reason="LIGGGHTS is not installed")
@pytest.mark.parametrize("which", ["clump", "sizes", "clump in sizes"])
def test_liggghts_takes_the_particles_of_its_card(which, tmp_path):
    cube = hlosta2020.particle("C6_8s-a")
    two = listed([3e-3, 5e-3], [0.3, 0.7], by="number")
    bead = {"clump": cube, "sizes": sized(D6, two), "clump in sizes": sized(cube, two)}[which]
    made = export("liggghts", bead, STEEL, AMONG, ON_STEEL)
    (tmp_path / "card.in").write_text(made.text)
    soft = "".join(
        line.removeprefix("# required before atom_style: ") + "\n"
        for line in made.text.splitlines()
        if line.startswith("# required before atom_style")
    )
    move = "nve/sphere" if bead.shape is None else "multisphere"
    (tmp_path / "in.thrown").write_text(THROWN.format(soft=soft, move=move))
    done = subprocess.run(["liggghts", "-in", "in.thrown"], cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-1500:]
    assert (tmp_path / "log.liggghts").read_text().count("ERROR") == 0
    inserted = re.search(r"inserted\s+(\d+) particle templates \(mass ([\d.e+-]+)\)", done.stdout)
    assert inserted, done.stdout[-1500:]
    count, mass = int(inserted[1]), float(inserted[2])
    assert count == 40
    # sizes are drawn at random there: four standard deviations of the mean of forty
    assert mass == pytest.approx(40 * bead.mean_mass, rel=0.35 if bead.sizes else 0.01)
