"""Particles of a lab.toml's own: clumps from a list of spheres or an STL file, or one sentence on what is wrong."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from rigtwin.lab.errors import BadLabFile
from rigtwin.lab.file.lab_file import read_cast, read_lab
from rigtwin.lab.file.model_file import Model, model_text, read_model
from rigtwin.lab.materials import Particle, heavier_than_its_solid, very_small
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.size_distributions import listed, lognormal, normal, sieved, uniform

MATERIAL = '[materials.ash]\ndensity = "720 kg/m^3"\nyoungs_modulus = "11 GPa"\npoisson_ratio = 0.44\n'

EXPERIMENT = """
[[experiments]]
id = "drop"
rig = "drop"
particle = "own"
wall = "steel"
repetitions = ["r01.csv"]
"""


def own(folder: Path, keys: str) -> Particle:
    """The particle with these keys."""
    (folder / "lab.toml").write_text(f'{MATERIAL}[particles.own]\nmaterial = "ash"\n{keys}\n')
    return read_cast(folder).particles["own"]


@pytest.fixture
def grain(tmp_path):
    """A box of 8 x 6 x 4 mm, in millimetres and in metres."""
    trimesh.creation.box((8e-3, 6e-3, 4e-3)).export(tmp_path / "in-metres.stl")
    trimesh.creation.box((8.0, 6.0, 4.0)).export(tmp_path / "grain.stl")
    return tmp_path


def test_a_clump_is_a_list_of_spheres_in_any_axes(tmp_path):
    # two spheres that touch at a point, off the origin and along a diagonal: closed forms
    particle = own(
        tmp_path, 'spheres = [["10 mm", "5 mm", "0 mm", "6 mm"], ["13.6 mm", "9.8 mm", 0, "6 mm"]]\nmass = "0.2 g"'
    )
    assert particle.shape is not None
    r = 3e-3
    assert particle.volume == pytest.approx(2 * 4 / 3 * math.pi * r**3, rel=1e-4)
    assert particle.mass == pytest.approx(0.2e-3, rel=1e-9)
    assert particle.diameter == pytest.approx(4 * r, rel=1e-3)
    along, across = 0.4 * r * r, 1.4 * r * r
    assert sorted(particle.shape.gyration) == pytest.approx([along, across, across], rel=1e-3)
    assert np.array(particle.shape.offsets).mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-7)


def test_the_mass_of_overlapping_spheres_counts_no_volume_twice(tmp_path):
    particle = own(tmp_path, 'spheres = [[0, 0, 0, "6 mm"], ["1 mm", 0, 0, "6 mm"]]')
    r, h = 3.0, 2.5  # [mm], each sphere beyond the plane between them lacks a cap of this height
    union = 2 * (4 / 3 * math.pi * r**3 - math.pi * h**2 * (3 * r - h) / 3)
    assert particle.mass == pytest.approx(720 * union * 1e-9, rel=1e-4)


def test_the_cube_of_the_paper_as_a_list_is_the_cube_of_the_paper(tmp_path):
    cube = hlosta2020.particle("C6")
    rows = [[*place, 2 * radius] for place, radius in zip(cube.shape.offsets, cube.shape.radii, strict=True)]
    particle = own(tmp_path, f"spheres = {rows!r}\nmass = {cube.mass!r}")
    assert np.array(particle.shape.offsets) == pytest.approx(np.array(cube.shape.offsets), abs=1e-9)
    assert particle.shape.radii == cube.shape.radii
    assert particle.volume == pytest.approx(cube.volume, rel=1e-6)
    assert particle.shape.gyration == pytest.approx(cube.shape.gyration, rel=1e-5)
    assert particle.mass == pytest.approx(cube.mass, rel=1e-12)


def test_a_symmetric_clump_of_the_paper_comes_back_to_the_bit(tmp_path):
    """Its twins then give identical numbers, as runs are reproducible to the bit."""
    cube = hlosta2020.particle("C6_8s-a")
    rows = [[*place, 2 * radius] for place, radius in zip(cube.shape.offsets, cube.shape.radii, strict=True)]
    keys = f"spheres = {rows!r}\ndensity = {cube.density!r}"
    (tmp_path / "lab.toml").write_text(f'[particles.own]\nmaterial = "wood_ash"\n{keys}\n')
    assert read_cast(tmp_path).particles["own"] == replace(cube, name="own")


def test_an_stl_file_gives_a_clump_with_the_mass_of_the_body(grain):
    particle = own(grain, 'stl = "grain.stl"\nstl_spheres = 9')
    assert len(particle.shape.radii) <= 9
    assert particle.mass == pytest.approx(720 * 8e-3 * 6e-3 * 4e-3, rel=1e-6)
    larger = own(grain, 'stl = "grain.stl"\nstl_unit = "cm"\nstl_spheres = 9\ndensity = "500 kg/m^3"')
    assert larger.mass == pytest.approx(500 * 8e-2 * 6e-2 * 4e-2, rel=1e-6)
    near = own(grain, 'stl = "grain.stl"\nstl_error = "0.4 mm"')
    assert len(near.shape.radii) > 9


def test_the_stl_files_of_a_lab_are_known(grain):
    (grain / "r01.csv").write_text("t,y\n0,1\n")
    experiment = (
        '[[experiments]]\nid = "d"\nrig = "drop"\nparticle = "own"\nwall = "steel"\nrepetitions = ["r01.csv"]\n'
    )
    (grain / "lab.toml").write_text(
        f'{MATERIAL}[particles.own]\nmaterial = "ash"\nstl = "grain.stl"\nstl_spheres = 4\n{experiment}'
    )
    lab = read_lab(grain)
    assert lab.stl_files == (grain / "grain.stl",)
    assert lab.experiments[0].particle is lab.particles["own"]


def sizes(folder: Path, keys: str, shape: str = "") -> Particle:
    return own(folder, f"{shape}\n[particles.own.size_distribution]\n{keys}")


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ('law = "list"\ndiameters = ["4 mm", "6 mm"]\nshares = [30, 70]', listed([4e-3, 6e-3], [0.3, 0.7])),
        ('law = "uniform"\nsmallest = "4 mm"\nlargest = "6 mm"', uniform(4e-3, 6e-3)),
        (
            'law = "normal"\nmean = "6 mm"\nstandard_deviation = "1 mm"\nby = "mass"\nsmallest = "4 mm"',
            normal(6e-3, 1e-3, by="mass", smallest=4e-3),
        ),
        ('law = "lognormal"\nmedian = "6 mm"\nspread = 0.2', lognormal(6e-3, 0.2)),
        (
            'law = "sieve"\nmeshes = ["2 mm", "4 mm", "8 mm"]\npassing = [0, 20, 100]',
            sieved([2e-3, 4e-3, 8e-3], [20, 80]),
        ),
    ],
    ids=["list", "uniform", "normal", "lognormal", "sieve"],
)
def test_sizes_are_given_by_a_law_and_survive_a_model_file(tmp_path, keys, expected):
    particle = sizes(tmp_path, keys)
    assert particle.sizes is not None
    assert particle.sizes.diameters == pytest.approx(expected.diameters)
    assert particle.sizes.shares == pytest.approx(expected.shares)
    assert particle.sizes.law == expected.law
    assert particle.diameter == pytest.approx(expected.largest)
    (tmp_path / "model.toml").write_text(
        model_text(Model({"ash": particle.material}, {"own": particle})), encoding="utf-8"
    )
    again = read_model(tmp_path / "model.toml").particles["own"]
    assert again.mean_mass == pytest.approx(particle.mean_mass, rel=1e-6)
    assert again.typical.diameter == pytest.approx(particle.typical.diameter, rel=1e-6)


def test_a_clump_comes_in_the_sizes_of_spheres_of_its_volume(grain):
    keys = 'law = "uniform"\nsmallest = "3 mm"\nlargest = "6 mm"'
    particle = sizes(grain, keys, 'stl = "grain.stl"\nstl_spheres = 9\ndensity = 500')
    assert particle.volume == pytest.approx(math.pi / 6 * 6e-3**3, rel=1e-6)
    assert particle.mass == pytest.approx(500 * particle.volume)
    assert 1 < len(particle.radii) <= 9
    assert particle.smallest_size == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("keys", "where", "words"),
    [
        ('law = "sieve"\nmeshes = ["2 mm", "4 mm"]', ".law", "'sieve' needs passing; add passing = [0, 20, 70, 100]"),
        ('law = "bimodal"', ".law", "'bimodal' is not known; write 'list', 'uniform'"),
        ('mean = "6 mm"\nstandard_deviation = "1 mm"', ".law", 'this key is missing; add law = "sieve"'),
        ('law = "normal"\nmean = "6 mm"\nstandard_deviation = "1 mm"\nshares = [1]', ".shares", "not used by"),
        ('law = "normal"\nmean = "6 mm"\nstandart_deviation = "1 mm"', ".standart_deviation", "did you mean"),
        ('law = "normal"\nmean = "6 mm"\nstandard_deviation = "3 mm"', "", "no diameter is left; give the smallest"),
        ('law = "lognormal"\nmedian = "6 mm"\nspread = 0.9', "", "the largest diameter is 221 times the smallest"),
        ('law = "list"\ndiameters = ["4 mm"]\nshares = [1, 2]', "", "1 diameters and 2 shares were given"),
        ('law = "sieve"\nmeshes = ["2 mm", "4 mm"]\npassing = [0, 90]', "", "percents that rise from 0 to 100"),
        ('law = "sieve"\nmeshes = ["2 mm", "4 mm"]\npassing = [0, 9, 100]', "", "2 meshes and 3 numbers"),
        ('law = "list"\ndiameters = [4, "1 km"]\nshares = [1, 2]', ".diameters", "a bare number is in m"),
        ('law = "list"\ndiameters = "4 mm"\nshares = [1]', ".diameters", "is not a list"),
    ],
)
def test_what_is_wrong_with_sizes_is_said_in_one_sentence(tmp_path, keys, where, words):
    with pytest.raises(BadLabFile) as refused:
        sizes(tmp_path, keys)
    assert f": particles.own.size_distribution{where}: " in str(refused.value), str(refused.value)
    assert words in str(refused.value)


@pytest.mark.parametrize(("shape", "words"), [('diameter = "6 mm"', "leave one"), ('mass = "1 g"', "give density")])
def test_one_diameter_or_one_mass_beside_sizes_is_refused(tmp_path, shape, words):
    with pytest.raises(BadLabFile, match=words):
        sizes(tmp_path, 'law = "uniform"\nsmallest = "3 mm"\nlargest = "6 mm"', shape)


@pytest.mark.parametrize(
    ("keys", "key", "words"),
    [
        ("", "diameter", 'this key is missing; add diameter = "6.2 mm"'),
        ('diamter = "6 mm"', "diamter", "did you mean 'diameter'"),
        ('diameter = "6 mm"\nstl = "grain.stl"', "stl", "diameter is given too"),
        ('diameter = "6 mm"\nspheres = [[0, 0, 0, "1 mm"]]', "spheres", "diameter is given too"),
        ('diameter = "6 mm"\nstl_spheres = 3', "stl_spheres", "belongs to an STL file"),
        ('diameter = "6 mm"\nmass = "1 g"\ndensity = 700', "mass", "both given"),
        ('stl = "grain.stl"\nstl_spheres = 3\nstl_error = "1 mm"', "stl_error", "stl_spheres is given too"),
        ('stl = "grain.stl"\nstl_spheres = 301', "stl_spheres", "more than the 300 spheres"),
        ('stl = "grain.stl"\nstl_spheres = 0', "stl_spheres", "not a whole number of at least 1"),
        ('stl = "grain.stl"\nstl_unit = "ft"', "stl_unit", "'ft' is not known; write 'mm'"),
        ('stl = "other.stl"', "stl", "no such file"),
        ('stl = "in-metres.stl"', "stl", "read in mm, is 7.2 um wide; state stl_unit"),
        ('stl = "lab.toml"', "stl", "STL"),
        ('stl = "../grain.stl"', "stl", "outside the lab's folder"),
        ('stl = "grain.stl"\nmass = "1 kg"', "mass", "more than any metal"),
        ("spheres = []", "spheres", "is not a list of spheres; write [x, y, z, diameter]"),
        ('spheres = [["1 mm", 0, 0]]', "spheres", "is not a list of spheres"),
        ("spheres = 3", "spheres", "is not a list of spheres"),
        ('spheres = [[0, 0, 0, "6 mm"], [0, 0, 0, "0 mm"]]', "spheres", "sphere 2"),
        ('spheres = [[0, 0, 0, "6 kg"]]', "spheres", "sphere 1: '6 kg' has the wrong unit for a length"),
        ("spheres = [[0, 0, 40, 6]]", "spheres", "a bare number is in m"),
        ('spheres = [[0, 0, 0, "6 mm"], ["20 mm", 0, 0, "6 mm"]]', "spheres", "sphere 2 does not touch"),
        (f"spheres = {[[0, 0, 0, 0.001]] * 301}", "spheres", "more than the 300 spheres"),
        ("volume = 1", "volume", "unknown key"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence_with_its_line(grain, keys, key, words):
    with pytest.raises(BadLabFile) as refused:
        own(grain, keys)
    said = str(refused.value)
    line = next((n for n, text in enumerate(keys.split("\n"), start=7) if text.startswith(key)), 5)
    assert re.match(rf"{re.escape(str(grain))}/lab.toml, line {line}: particles.own.{key}: ", said), said
    assert words in said


def test_all_faults_of_a_particle_are_reported_at_once(grain):
    with pytest.raises(BadLabFile) as refused:
        own(grain, 'diameter = "6 mm"\nspheres = [[0, 0, 0, "1 mm"]]\nstl_error = "1 mm"\ndensity = 7\nmass = 1')
    assert len(refused.value.faults) == 3


def test_an_stl_file_elsewhere_is_read_where_that_is_allowed_and_not_quoted(tmp_path):
    lab = tmp_path / "lab"
    lab.mkdir()
    (lab / "r01.csv").write_text("t,y\n0,1\n")
    (tmp_path / "grain.stl").write_text("solid secret\nfacet normal of the secret\n")
    (lab / "lab.toml").write_text(f'{MATERIAL}[particles.own]\nmaterial = "ash"\nstl = "../grain.stl"\n{EXPERIMENT}')
    with pytest.raises(BadLabFile, match="--allow-outside"):
        read_lab(lab)
    with pytest.raises(BadLabFile, match="cannot be used, and lies outside") as refused:
        read_lab(lab, allow_outside=True)
    assert "normal of the secret" not in str(refused.value)
    trimesh.creation.box((8.0, 6.0, 4.0)).export(tmp_path / "grain.stl")
    assert read_lab(lab, allow_outside=True).particles["own"].shape is not None


def test_only_particles_that_are_used_are_made(tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr("rigtwin.lab.file.own_particles.filled_file", lambda path, *_, **__: made.append(path.name))
    (tmp_path / "r01.csv").write_text("time_s,x_m,y_m\n0,0,0\n")
    entries = (
        '[particles.own]\nmaterial = "ash"\ndiameter = "6 mm"\n[particles.scan]\nmaterial = "ash"\nstl = "s.stl"\n'
    )
    (tmp_path / "lab.toml").write_text(MATERIAL + entries + EXPERIMENT)
    lab = read_lab(tmp_path)
    assert set(lab.particles) == {"own"}
    assert lab.stl_files == lab.notes == ()
    assert set(read_cast(tmp_path, "own").particles) == {"own"}
    assert made == []
    # the keys of a particle are checked even where nothing uses it
    (tmp_path / "lab.toml").write_text(MATERIAL + entries.replace('stl = "s.stl"', "stl_error = 1") + EXPERIMENT)
    with pytest.raises(BadLabFile, match=r"2 faults|belongs to an STL file"):
        read_lab(tmp_path)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ('diameter = "6 m"', r"line 7: particles\.own\.diameter: the particle would be 6 m wide, more than 0.5 m"),
        ('diameter = "0.6 um"', "would be 6e-07 m wide, less than 1 um; check its unit"),
        ('spheres = [[0, 0, 0, "6 m"]]', r"particles\.own\.spheres: the particle would be 6 m wide"),
        (
            'size_distribution = { law = "uniform", smallest = "1 m", largest = "2 m" }',
            r"size_distribution: .* 2 m wide",
        ),
    ],
)
def test_sizes_that_no_particle_has_are_refused(tmp_path, keys, words):
    with pytest.raises(BadLabFile, match=words):
        own(tmp_path, keys)


def test_a_particle_heavier_than_its_solid_is_remarked(tmp_path):
    sphere = 720 * math.pi / 6 * 0.006**3 * 1e3  # [g], of solid ash
    heavy = heavier_than_its_solid(own(tmp_path, f'diameter = "6 mm"\nmass = "{3 * sphere} g"'))
    assert "which is 2160 kg/m^3, and ash has 720 kg/m^3" in heavy
    for share in (0.8, 1.05):  # holes; a caliper's last digit
        assert heavier_than_its_solid(own(tmp_path, f'diameter = "6 mm"\nmass = "{share * sphere} g"')) == ""


def test_a_particle_thinner_than_a_hair_is_remarked(tmp_path):
    assert very_small(own(tmp_path, 'diameter = "6 um"')) == (
        "own is 6 um wide, thinner than a hair; check the unit of its size"
    )
    assert very_small(own(tmp_path, 'diameter = "0.1 mm"')) == ""
