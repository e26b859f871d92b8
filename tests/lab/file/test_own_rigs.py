"""Rigs of a lab.toml's own: what is read, and one sentence with file, line and key on what is wrong."""

import math
import re
from pathlib import Path

import pytest
import trimesh

from rigtwin.cli import run
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file import lookup
from rigtwin.lab.file.lab_file import new_lab, read_lab
from rigtwin.lab.file.own_rigs import named_for, read_own_rig, rig_of_keys

RIG = """[rigs.mixer]
particle = "D6"
wall = "steel"
total_mass = "7.1 g"
fill = { low = ["-20 mm", "-20 mm", "10 mm"], high = ["20 mm", "20 mm", "60 mm"] }

[rigs.mixer.walls.cup]
stl = "cup.stl"
material = "PMMA"
rotation_speed = "30 rpm"
rotation_axis = [0, 1, 0]
rotation_point = [0, 0, "2 cm"]
vibration_amplitude = [0, 0, "0.5 mm"]
vibration_frequency = "50 Hz"
velocity = ["10 mm/s", 0, 0]
start = "0.5 s"
stop = "1 s"

[rigs.mixer.regions.cup]
low = ["-20 mm", "-20 mm", 0]
high = ["20 mm", "20 mm", "60 mm"]
shape = "cylinder"
"""


@pytest.fixture
def lab(tmp_path):
    """A folder with a rig whose wall is a box of 50 x 50 x 60 mm in millimetres."""
    trimesh.creation.box((50, 50, 60)).export(tmp_path / "cup.stl")
    (tmp_path / "lab.toml").write_text(RIG)
    return tmp_path


def changed(folder, old, new):
    text = (folder / "lab.toml").read_text()
    assert old in text
    (folder / "lab.toml").write_text(text.replace(old, new))
    return folder


def test_a_rig_is_read_in_si_units(lab):
    own = read_own_rig(lab)
    cup = own.rig.walls["cup"]
    assert cup.rotation_speed == pytest.approx(math.pi)
    assert cup.rotation_point == pytest.approx((0, 0, 0.02))
    assert cup.vibration_amplitude == pytest.approx((0, 0, 0.5e-3))
    assert (cup.velocity, cup.vibration_frequency, cup.start, cup.stop) == ((0.01, 0, 0), 50, 0.5, 1)
    assert (cup.material, own.wall, own.particle.name) == ("PMMA", "steel", "D6")
    assert own.count == round(7.1e-3 / own.particle.mass)
    assert own.rig.regions["cup"].shape == "cylinder"
    assert read_own_rig(lab / "lab.toml", "mixer", instead={"count": 7, "duration": 0.3}).count == 7


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('stl = "cup.stl"', 'stl = "cup.stl"\nstl_unit = "m"', 9, "60 m long with stl_unit = 'm', more than 10 m"),
        ('stl = "cup.stl"', 'stl = "other.stl"', 8, "no such file"),
        ('stl = "cup.stl"', 'stl = "../cup.stl"', 8, "lies outside the lab's folder"),
        ('stl = "cup.stl"', 'stll = "cup.stl"', 8, "unknown key; did you mean 'stl'"),
        ('material = "PMMA"', 'material = "PMA"', 9, "there is no material 'PMA'"),
        ('rotation_speed = "30 rpm"\n', "", 10, "changes nothing without rotation_speed"),
        ('vibration_frequency = "50 Hz"\n', "", 13, "changes nothing without vibration_frequency"),
        ('stop = "1 s"', 'stop = "0.2 s"', 17, "0.2 s, not after start"),
        ('total_mass = "7.1 g"', 'total_mass = "7.1 g"\ncount = 5', 4, "count is given too"),
        ('total_mass = "7.1 g"\n', "", 1, "count: this key is missing"),
        (
            'total_mass = "7.1 g"',
            'total_mass = "90 t"',
            4,
            r"that of \d+ particles, more than the 10000000 that a twin",
        ),
        ('total_mass = "7.1 g"', 'total_mass = "1 mg"', 4, "less than half the mass of one particle"),
        ('total_mass = "7.1 g"', 'total_mass = "7.1 g"\nlow = [0, 0, 0]', 5, "high is not given; give both"),
        ('total_mass = "7.1 g"', 'total_mass = "7.1 g"\npour_speed = "1 m/s"', 5, "belongs to pour_rate"),
        ('["20 mm", "20 mm", "60 mm"]\nshape', '["20 mm", "30 mm", "60 mm"]\nshape', 21, "40 mm by 50 mm; give it two"),
        ('["20 mm", "20 mm", "60 mm"] }', '["20 mm", "-30 mm", "60 mm"] }', 5, "-30 mm along y, not above low"),
        ('["20 mm", "20 mm", "60 mm"] }', '["20 mm", "60 mm"] }', 5, "is not a list of three numbers"),
        ("rotation_axis = [0, 1, 0]", "rotation_axis = [0, 0, 0]", 11, "points nowhere"),
        ("[rigs.mixer.walls.cup]", '[rigs.mixer.walls."a/b"]', 7, "letters, digits, hyphens and underscores"),
        ('particle = "D6"', 'particle = "D7"', 2, "there is no particle 'D7'"),
        ('particle = "D6"\n', "", 1, r'particle: this key is missing; add particle = "D6"'),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence_with_its_line(lab, old, new, line, words):
    with pytest.raises(BadLabFile) as refused:
        read_own_rig(changed(lab, old, new))
    said = [str(refused.value), *refused.value.faults]
    assert any(re.search(rf"line {line}: .*{words}", one) for one in said), said


def test_a_wall_of_a_thousand_diameters_is_noted_and_not_refused(lab):
    changed(lab, 'stl = "cup.stl"', 'stl = "cup.stl"\nstl_unit = "cm"')
    assert read_own_rig(lab).notes == ()
    changed(lab, 'particle = "D6"', 'particle = "grit"')
    (lab / "lab.toml").write_text(
        (lab / "lab.toml").read_text() + '[particles.grit]\nmaterial = "steel"\ndiameter = "0.5 mm"\n'
    )
    [note] = read_own_rig(lab).notes
    assert note == "wall cup is 600 mm long with stl_unit = 'cm', and the particle grit has 0.5 mm: check the unit"


def test_a_wall_shorter_than_a_particle_is_noted_and_not_refused(lab):
    changed(lab, 'stl = "cup.stl"', 'stl = "cup.stl"\nstl_unit = "um"')
    [note] = read_own_rig(lab).notes
    assert note == "wall cup is 0.06 mm long with stl_unit = 'um', and the particle D6 has 6.2 mm: check the unit"


def test_nothing_of_an_allowed_file_outside_the_folder_is_quoted(lab, tmp_path_factory):
    other = tmp_path_factory.mktemp("other") / "secret.stl"
    other.write_text("solid secret\nfacet normal 0 0 1\nouter loop\nvertex 31415 0 0\n")
    changed(lab, 'stl = "cup.stl"', f'stl = "{other}"')
    with pytest.raises(BadLabFile, match=r"nothing of it is quoted here"):
        read_own_rig(lab, allow_outside=True)
    walls = {"wall": {"stl": str(other)}}
    fill = {"low": [0, 0, 0], "high": [1, 1, 1]}
    with pytest.raises(BadInput, match="ends within facet 1: it is cut off"):
        rig_of_keys({"walls": walls, "fill": fill, "count": 3})


def test_faults_of_options_are_said_of_the_option_and_not_of_the_file(lab, capfd, monkeypatch):
    monkeypatch.chdir(lab)
    assert "--fill: is 0 mm along x, not above low" in refused(capfd, "lab.toml", "--fill=0,0,0..0,0,0")
    assert "--region: is 0 mm along x, not above low" in refused(capfd, "lab.toml", "--region=0,0,0..0,0,0")
    assert "--particle: there is no particle 'D7'" in refused(capfd, "lab.toml", "--particle", "D7")
    assert "--fill: " in refused(capfd, "--stl", "cup.stl", "--fill=0,0,a..1,1,1")
    changed(lab, 'high = ["20 mm", "20 mm", "60 mm"] }', 'high = ["20 mm", "-30 mm", "60 mm"] }')
    assert "line 5: " in refused(capfd, "lab.toml", "--count", "3")


def test_refusals_of_the_simulation_name_file_and_line_unless_an_option_states_the_key(lab, capfd, monkeypatch):
    monkeypatch.chdir(lab)
    changed(lab, 'total_mass = "7.1 g"', 'total_mass = "7.1 g"\nlow = [-1, -1, -1]\nhigh = [1, 1, 1]')
    changed(lab, '["20 mm", "20 mm", "60 mm"] }', '["20 mm", "20 mm", "2 m"] }')
    for command in (["simulate"], ["export", "liggghts"]):
        assert run([*command, "custom", "lab.toml", "--out", "out"]) == 2
        assert "lab.toml, line 7: rigs.mixer.fill: is x -20 to 20 mm" in capfd.readouterr().err
    narrow = "--fill=0mm,0mm,0mm..1mm,1mm,1mm"
    assert "--fill: is x 0 to 1 mm, " in refused(capfd, "lab.toml", narrow)
    changed(lab, '"2 m"', '"50 mm"')
    changed(lab, '"30 rpm"', '"3e6 rpm"')
    assert re.search(r"lab.toml, line \d+: rigs.mixer.walls.cup moves by up to", refused(capfd, "lab.toml"))


def test_a_particle_that_cannot_be_made_is_tried_once(lab, monkeypatch):
    changed(lab, 'particle = "D6"', 'particle = "grain"')
    (lab / "lab.toml").write_text(
        (lab / "lab.toml").read_text() + '[particles.grain]\nmaterial = "steel"\nstl = "none.stl"\nstl_spheres = 5\n'
    )
    tried, make = [], lookup.own_particle
    monkeypatch.setattr(lookup, "own_particle", lambda name, *more: tried.append(name) or make(name, *more))
    with pytest.raises(BadLabFile, match=r"none\.stl"):
        read_own_rig(lab)
    assert tried == ["grain"]


def test_a_file_with_several_rigs_asks_which(lab):
    (lab / "lab.toml").write_text(RIG + RIG.replace("mixer", "chute"))
    with pytest.raises(BadInput, match=r"choose one with --name \(mixer, chute\)"):
        read_own_rig(lab)
    with pytest.raises(BadInput, match=r"no rig 'chut' in .* did you mean 'chute'"):
        read_own_rig(lab, "chut")
    (lab / "lab.toml").write_text("")
    with pytest.raises(BadInput, match=r"has no rig of your own; describe one under \[rigs.NAME\]"):
        read_own_rig(lab)


def test_the_rig_of_a_new_lab_can_be_used_as_it_stands_and_with_its_signs_of_comment_taken_away(tmp_path):
    new_lab(tmp_path)
    trimesh.creation.box((50, 50, 60)).export(tmp_path / "drum.stl")
    own = read_own_rig(tmp_path)
    assert (own.count, own.particle.name) == (1000, "bead6")
    assert not own.rig.walls["drum"].moves
    text = (tmp_path / "lab.toml").read_text()
    before, _, rest = text.partition("[rigs.mixer]")
    (tmp_path / "lab.toml").write_text(
        f"{before}[rigs.mixer]{re.sub('^# (?!total_mass)(?=[a-z_]+ = )', '', rest, flags=re.M)}"
    )
    own = read_own_rig(tmp_path)
    assert own.rig.walls["drum"].belt
    assert own.rig.walls["drum"].moves
    assert own.rig.low == pytest.approx((-0.06, -0.06, -0.02))


def test_rigs_do_not_disturb_the_experiments_of_a_lab(lab):
    (lab / "r01.csv").write_text("time_s,x_m,y_m\n0,0,0\n0.1,0,0\n")
    (lab / "lab.toml").write_text(
        RIG + '[[experiments]]\nid = "a"\nrig = "drop"\nparticle = "D6"\nwall = "steel"\nrepetitions = ["r01.csv"]\n'
    )
    assert len(read_lab(lab).experiments) == 1


def test_keys_alone_make_a_rig(lab):
    walls = {"wall": {"stl": str(lab / "cup.stl")}}
    fill = {"low": ["-2 cm", "-2 cm", "0"], "high": ["2 cm", "2 cm", "5 cm"]}
    own = rig_of_keys({"walls": walls, "fill": fill, "count": 3})
    assert (own.count, own.particle.name, own.wall) == (3, "D6", "steel")
    with pytest.raises(BadInput, match=r"fill: is -20 mm along x, not above low"):
        rig_of_keys({"walls": walls, "fill": {**fill, "high": ["-2 cm", "2 cm", "5 cm"]}, "count": 3})


def refused(capfd, *arguments):
    assert run(["simulate", "custom", *map(str, arguments)]) == 2
    said = capfd.readouterr()
    assert not said.out
    return said.err


def test_the_command_refuses_in_one_sentence(lab, capfd, monkeypatch):
    monkeypatch.chdir(lab)
    assert "name a lab.toml with a rig" in refused(capfd)
    assert "--fill: --stl needs it" in refused(capfd, "--stl", "cup.stl")
    assert "--fill: -24 has no unit; write it like -24mm." in refused(
        capfd, "--stl", "cup.stl", "--fill=-24,-24,0..24,24,75"
    )
    assert "two corners like" in refused(capfd, "--stl", "cup.stl", "--fill=1,2,3")
    assert "not above low" in refused(capfd, "--stl", "cup.stl", "--fill=0,0,0..0,0,0")
    assert "state stl_unit there" in refused(capfd, "lab.toml", "--stl-unit", "m")
    assert "leave one of them out" in refused(capfd, "--stl", "cup.stl", "--name", "mixer", "--fill=0,0,0..1mm,1mm,1mm")
    changed(lab, '"D6"', '"grit"')
    (lab / "lab.toml").write_text(
        (lab / "lab.toml").read_text() + '[particles.grit]\nmaterial = "steel"\ndiameter = "6 mm"\n'
    )
    said = refused(capfd, "lab.toml")
    assert "contact grit-steel is not known; give it under [contacts.grit-steel] in the lab.toml." in said
    assert not (lab / "out").exists()


def test_walls_of_the_command_line_are_named_for_their_files_and_refused_by_their_options(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert list(named_for([Path("cup-2.stl"), Path("a/cup.stl"), Path("b/cup.stl")])) == ["cup-2", "cup", "cup-3"]
    command = ["simulate", "custom", "--fill=0mm,0mm,0mm..20mm,20mm,20mm", "--stl"]
    assert run([*command, "lid.stl"]) == 2
    assert capfd.readouterr().err.startswith("rigtwin: --stl: lid.stl: no such file")
    trimesh.creation.box((50, 50, 50)).export("cup.stl")
    assert run([*command, "cup.stl", "--stl-unit", "m"]) == 2
    assert capfd.readouterr().err.startswith("rigtwin: --stl-unit: wall cup: is 50 m long")
