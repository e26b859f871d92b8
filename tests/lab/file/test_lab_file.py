"""A lab.toml is read whole, or refused in one sentence that names file, line and key."""

import math
import re

import pytest
import trimesh

from rigtwin.lab.camera import Camera, Moment
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file.lab_file import new_lab, read_lab
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import RIGS, DropSettings, HopperSettings, PendulumSettings, PileSettings
from rigtwin.lab.spelling import suggestion

LAB = """\
[lab]
title = "Ash beads on steel"

[materials.ash]
density = "568 kg/m^3"
youngs_modulus = "11 GPa"
poisson_ratio = 0.44

[particles.oak-bead]
material = "ash"
diameter = "6 mm"
mass = "0.0710 g"

[contacts.steel-oak-bead]
restitution = 0.5

[[experiments]]
id = "drop-1"
rig = "drop"
particle = "oak-bead"
wall = "steel"
repetitions = ["r01.mp4", "r02.csv"]
[experiments.camera]
frame_rate = "240 Hz"
scale = "0.2 mm/px"
region = "10,20,300,400"
start = "12 frames"
end = "60 frames"
camera_roll = "-1.5 deg"

[[experiments]]
id = "pendulum-1"
rig = "pendulum"
variant = "double"
particle = "D12"
length = "300 mm"
release_angle = "40 deg"
repetitions = ["r01.mp4"]
camera = { known_length = "100 mm:0,0,500,0" }

[[experiments]]
id = "pile-1"
rig = "pile"
variant = "piling"
particle = "D6"
wall = "steel"
base_diameter = "90 mm"
count = 1000
repetitions = [["p1.jpg", "p2.jpg"], "p3.jpg"]
"""
MEDIA = ("r01.mp4", "r02.csv", "p1.jpg", "p2.jpg", "p3.jpg")


@pytest.fixture
def folder(tmp_path):
    for name in MEDIA:
        (tmp_path / name).touch()
    (tmp_path / "lab.toml").write_text(LAB, encoding="utf-8")
    return tmp_path


def refusal(folder, old, new):
    """The message when `old` in the lab file is `new` instead, and the new text."""
    assert LAB.count(old) == 1
    text = LAB.replace(old, new)
    (folder / "lab.toml").write_text(text, encoding="utf-8")
    with pytest.raises(BadLabFile) as refused:
        read_lab(folder)
    message = str(refused.value)
    assert re.match(rf"{re.escape(str(folder / 'lab.toml'))}(, line | has \d+ faults: line )", message)
    assert "\n" not in message
    return message, text


def test_the_lab_holds_what_the_file_says_in_si(folder):
    lab = read_lab(folder)
    assert lab.title == "Ash beads on steel"
    drop, pendulum, pile = lab.experiments
    assert drop.rig == DropSettings(drop_height=None)
    assert pendulum.rig == PendulumSettings(length=0.3, release_angle=pytest.approx(0.6981317), variant="double")
    assert pile.rig == PileSettings(base_diameter=0.09, count=1000)
    assert [experiment.rig_name for experiment in lab.experiments] == ["drop", "pendulum", "pile"]
    assert drop.camera.frame_rate == 240
    assert drop.camera.scale == pytest.approx(2e-4)
    assert drop.camera.region == (10, 20, 300, 400)
    assert drop.camera.start == Moment(12, "frame")
    assert drop.camera.roll == pytest.approx(-0.02617994)
    assert pendulum.camera.given_scale == pytest.approx(2e-4)
    assert drop.particle.mass == pytest.approx(7.1e-5)
    assert drop.wall is not None
    assert pendulum.wall is None


DRUM = """
[[experiments]]
id = "drum-1"
rig = "drum"
particle = "D6"
wall = "PMMA"
drum_diameter = "140 mm"
speed = "3 rpm"
repetitions = ["p3.jpg"]
camera = { circle = "320,240,200"%s }
"""


@pytest.mark.parametrize(
    ("said", "averaged"), [("", False), (", averaged = true", True), (", averaged = false", False)]
)
def test_a_drum_may_be_stated_to_be_averaged(folder, said, averaged):
    (folder / "lab.toml").write_text(LAB + DRUM % said, encoding="utf-8")
    drum = read_lab(folder).experiments[-1]
    assert drum.camera.averaged is averaged
    assert drum.camera.stated == (("circle", "averaged") if averaged else ("circle",))


def test_repetitions_are_files_beside_the_lab_file_and_a_pile_may_have_several_views(folder):
    drop, _, pile = read_lab(folder).experiments
    assert drop.repetitions == ((folder / "r01.mp4",), (folder / "r02.csv",))
    assert pile.repetitions == ((folder / "p1.jpg", folder / "p2.jpg"), (folder / "p3.jpg",))


def test_the_lab_file_itself_may_be_named_in_place_of_its_folder(folder):
    assert read_lab(folder / "lab.toml").experiments == read_lab(folder).experiments


def test_what_the_file_states_of_a_contact_stands_in_either_order_of_names(folder):
    lab = read_lab(folder)
    needs = ("restitution",)
    assert lab.contact("oak-bead", "steel", needs) == lab.contact("steel", "oak-bead", needs)
    assert lab.contact("oak-bead", "steel", needs).restitution == 0.5


def test_a_contact_parameter_that_nobody_gave_is_asked_for_by_name(folder):
    with pytest.raises(BadInput, match=r"static_friction of the contact oak-bead-steel.*\[contacts.oak-bead-steel\]"):
        read_lab(folder).contact("oak-bead", "steel")


def test_whatever_comes_from_the_paper_is_said(folder):
    lab = read_lab(folder)
    assert lab.particles["D12"].diameter == pytest.approx(12.2e-3)
    assert lab.contact("D6", "D6").restitution == 0.75
    assert lab.contact("steel", "D6").static_friction == 0.36
    for thing in ("material steel", "particle D6 ", "particle D12", "contact D6-steel", "contact D12-D12"):
        assert sum(thing in sentence and "Hlosta et al. 2020" in sentence for sentence in lab.borrowed) == 1
    assert not any("oak-bead" in sentence or "ash " in sentence for sentence in lab.borrowed)


def test_what_the_file_defines_goes_before_the_paper_and_only_gaps_are_filled(folder):
    own = '[materials.steel]\ndensity = 7000\nyoungs_modulus = "200 GPa"\npoisson_ratio = 0.3\n\n'
    contact = "[contacts.D6-steel]\nrestitution = 0.9\n\n"
    (folder / "lab.toml").write_text(LAB.replace("[[experiments]]", own + contact + "[[experiments]]", 1))
    lab = read_lab(folder)
    assert lab.materials["steel"].density == 7000
    assert lab.contact("D6", "steel").restitution == 0.9
    assert lab.contact("D6", "steel").static_friction == 0.36
    (said,) = [sentence for sentence in lab.borrowed if "contact D6-steel" in sentence]
    assert said.startswith("static friction and rolling friction of contact D6-steel")
    assert "its own steel" in said


TILT = """
[[experiments]]
id = "tilt-1"
rig = "tilt"
variant = "slide"
particle = "oak-bead"
wall = "%s"
repetitions = ["r03.mp4"]
"""


def test_a_tilted_plate_may_be_covered_with_particles_and_no_other_wall(folder):
    (folder / "r03.mp4").write_bytes(b"another")
    (folder / "lab.toml").write_text(LAB + TILT % "oak-bead", encoding="utf-8")
    tilt = read_lab(folder).experiments[-1]
    assert tilt.contacts == (("oak-bead", "oak-bead"),)
    assert tilt.wall.youngs_modulus == tilt.particle.material.youngs_modulus
    (folder / "lab.toml").write_text(LAB + TILT % "oak-bed", encoding="utf-8")
    with pytest.raises(BadLabFile, match="there is no material 'oak-bed'"):
        read_lab(folder)
    message, _ = refusal(folder, 'wall = "steel"\nrep', 'wall = "D6"\nrep')
    assert "experiment 1, wall: there is no material 'D6'" in message


@pytest.mark.parametrize("again", ["r01.mp4", "./r01.mp4"])
def test_a_clip_listed_twice_is_refused_for_it_is_no_second_measurement(folder, again):
    message, _ = refusal(folder, '"r02.csv"', f'"{again}"')
    assert "experiment 1, repetition 2" in message
    assert "listed twice" in message


@pytest.mark.parametrize("one", ["r01.mp4", "r01.mp4/1.png"])
def test_a_copy_of_a_clip_under_another_name_is_refused_and_both_are_named(folder, one):
    for name in (one, one.replace("r01.mp4", "r02.csv")):
        if "/" in name:
            (folder / name).parent.unlink()
            (folder / name).parent.mkdir()
        (folder / name).write_bytes(b"film")
    with pytest.raises(BadLabFile, match=r"experiment 1, repetition 2: .*r02\.csv holds the same as .*r01\.mp4"):
        read_lab(folder)
    (folder / one).write_bytes(b"Film")
    assert len(read_lab(folder).experiments[0].repetitions) == 2


def test_a_table_of_an_experiment_beside_the_experiments_is_refused_with_its_place(folder):
    path = folder / "lab.toml"
    text = path.read_text()
    path.write_text(f'[camera]\nframe_rate = "240 Hz"\n{text}')
    with pytest.raises(BadLabFile, match=r"line 1: camera: unknown key; .* experiment: .*\[experiments\.camera\]"):
        read_lab(folder)
    path.write_text(f"[particle.ash]\n{text}")
    with pytest.raises(BadLabFile, match=r"particle: unknown key; did you mean 'particles'"):
        read_lab(folder)


def test_many_copies_of_one_clip_are_refused_in_one_line(folder):
    (folder / "clips").mkdir()
    for number in range(1, 61):
        (folder / "clips" / f"r{number:02d}.csv").write_text("film")
    path = folder / "lab.toml"
    path.write_text(path.read_text().replace('["r01.mp4", "r02.csv"]', '["clips/"]'))
    with pytest.raises(BadLabFile, match=r"r02\.csv and 58 others hold the same as .*r01\.csv; keep one") as refused:
        read_lab(folder)
    assert str(refused.value).count("hold the same") == 1
    assert refused.value.faults == ()


@pytest.mark.parametrize("name", ["C6", "C6_24s", "P6x15_3s"])
def test_the_clumps_of_the_paper_are_found_by_name_with_their_contacts(folder, name):
    (folder / "lab.toml").write_text(LAB.replace('particle = "D6"', f'particle = "{name}"'), encoding="utf-8")
    lab = read_lab(folder)
    assert lab.experiment("pile-1").particle == hlosta2020.particle(name)
    assert lab.contact(name, "steel") == hlosta2020.contact(name, "steel")
    assert f"particle {name} taken from Hlosta et al. 2020 (tables 2, 3 and A2)" in lab.borrowed


def test_each_experiment_names_the_pairs_that_touch_in_it(folder):
    drop, pendulum, pile = read_lab(folder).experiments
    assert drop.contacts == (("oak-bead", "steel"),)
    assert pendulum.contacts == (("D12", "D12"),)
    assert pile.contacts == (("D6", "steel"), ("D6", "D6"))


@pytest.mark.parametrize(
    "case",
    [
        # wrong units and values
        ('"240 Hz"', '"240 mm"', "experiment 1, camera.frame_rate", "240 mm", "wrong unit for a frequency"),
        ('"0.0710 g"', '"0.0710 kg"', "particles.oak-bead.mass", "0.0710 kg", "more than any metal"),
        ('"240 Hz"', '"fast"', "experiment 1, camera.frame_rate", "fast", "'240 Hz'"),
        ('"240 Hz"', '"0 Hz"', "experiment 1, camera.frame_rate", "0 Hz", "above 0"),
        ('"0.2 mm/px"', '"0.2 mm"', "experiment 1, camera.scale", "0.2 mm", "wrong unit for a scale"),
        ('"-1.5 deg"', "1.5", "experiment 1, camera.camera_roll", "camera_roll", "85.9 degrees"),
        ('"10,20,300,400"', '"10,20"', "experiment 1, camera.region", "region", "x,y,width,height"),
        ("100 mm:0,0,500,0", "100 mm", "experiment 2, camera.known_length", "known_length", "100mm:x1,y1,x2,y2"),
        ('region = "10,20,300,400"', "averaged = true", "experiment 1, camera.averaged", "averaged", "used by a drop"),
        (
            'region = "10,20,300,400"',
            'averaged = "no"',
            "experiment 1, camera.averaged",
            "averaged",
            "is not used by a drop",
        ),
        ('"60 frames"', '"6 frames"', "experiment 1, camera.end", "end =", "not after the start"),
        ('"12 frames"', '"-1 s"', "experiment 1, camera.start", "start =", "before the clip begins"),
        ("count = 1000", 'camera.circle = "1,2,3"', "experiment 3, camera.circle", "circle", "is not used by a pile"),
        ("count = 1000", 'camera.frame_rate = "30 Hz"', "experiment 3, camera.frame_rate", "camera.frame", "by a pile"),
        ("count = 1000", 'camera.start = "3 s"', "experiment 3, camera.start", "camera.start", "not used by a pile"),
        ("count = 1000", 'rim_height = "300 m"', "experiment 3, rim_height", "rim_height", "at most 10 m"),
        ('"11 GPa"', '"11 kg"', "materials.ash.youngs_modulus", "11 kg", "wrong unit for a pressure"),
        ("0.44", "0.5", "materials.ash.poisson_ratio", "poisson_ratio", "at most 0.499"),
        ("restitution = 0.5", "restitution = 1.2", "contacts.steel-oak-bead.restitution", "1.2", "at most 1"),
        ("restitution = 0.5", "static_friction = nan", "contacts.steel-oak-bead.static_friction", "nan", "finite"),
        ('"6 mm"', "6e3", "particles.oak-bead.diameter", "6e3", "at most 10"),
        ('"6 mm"', '"-6 mm"', "particles.oak-bead.diameter", "-6 mm", "above 0"),
        ("count = 1000", "count = 0", "experiment 3, count", "count", "whole number"),
        ("count = 1000", 'count = "many"', "experiment 3, count", "count", "'many' is not a whole number"),
        ('"40 deg"', '"200 deg"', "experiment 2, release_angle", "200 deg", "at most"),
        ('"piling"', '"heaping"', "experiment 3, variant", "heaping", "'piling'"),
        ('"piling"', '"emptying"', "experiment 3, drain_diameter", '[[experiments]]\nid = "pile-1"', "missing"),
        (
            "count = 1000",
            'lift_speed = "2 cm/s"',
            "experiment 3, lift_speed",
            "lift_speed",
            'is of variant = "pouring" and not used with variant = "piling"',
        ),
        ('"40 deg"', '"40 deg"\nrod_mass = "2 g"', "experiment 2, rod_mass", "rod_mass", 'is of hanger = "rod"'),
        ('"Ash beads on steel"', "3", "lab.title", "title", "put it in quotes"),
        # missing and unknown keys, wrong shapes
        ('diameter = "6 mm"\n', "", "particles.oak-bead.diameter", "[particles.oak-bead]", 'diameter = "6.2 mm"'),
        ('wall = "steel"\nbase', "base", "experiment 3, wall", '[[experiments]]\nid = "pile-1"', "missing"),
        ('base_diameter = "90 mm"', "", "experiment 3, base_diameter", '[[experiments]]\nid = "pile-1"', "missing"),
        ('rig = "drop"\n', "", "experiment 1, rig", '[[experiments]]\nid = "drop-1"', 'rig = "drop"'),
        ("frame_rate", "framerate", "experiment 1, camera.framerate", "framerate", "did you mean 'frame_rate'"),
        ("[lab]", "[lap]", "lap", "[lap]", "did you mean 'lab'"),
        ("count = 1000", "drop_height = 1", "experiment 3, drop_height", "drop_height", "unknown key"),
        (
            "[materials.ash]",
            "[uncertainty]\nscael = 0.01\n\n[materials.ash]",
            "uncertainty.scael",
            "scael",
            "did you mean 'scale'",
        ),
        ('["r01.mp4"]', '"r01.mp4"', "experiment 2, repetitions", 'repetitions = "r01', "is not a list"),
        ('["r01.mp4"]', "[]", "experiment 2, repetitions", "repetitions = []", "is empty"),
        ('["r01.mp4"]', "[7]", "experiment 2, repetition 1", "[7]", "not a file name"),
        (
            'camera = { known_length = "100 mm:0,0,500,0" }',
            "camera = 3",
            "experiment 2, camera",
            "camera = 3",
            "table",
        ),
        # names
        ('id = "pile-1"', 'id = "drop-1"', "experiment 3, id", '"drop-1"\nrig = "pile"', "line 18"),
        ('particle = "D12"', 'particle = "D11"', "experiment 2, particle", "D11", "[particles.D11]"),
        ('particle = "oak-bead"', 'particle = "oak-bed"', "experiment 1, particle", "oak-bed", "did you mean 'oak-b"),
        ('wall = "steel"\nrep', 'wall = "steal"\nrep', "experiment 1, wall", "steal", "did you mean 'steel'"),
        ('material = "ash"', 'material = "oak"', "particles.oak-bead.material", '= "oak"', "[materials.oak]"),
        ("[contacts.steel-oak-bead]", "[contacts.lead-D6]", "contacts.lead-D6", "lead-D6", "'lead'"),
        ("[contacts.steel-oak-bead]", "[contacts.steel]", "contacts.steel", "[contacts.steel]", "D6-steel"),
        ("[contacts.steel-oak-bead]", "[contacts.steel-ash]", "contacts.steel-ash", "steel-ash", "a particle"),
        ('mass = "0.0710 g"', 'mass = 1\ndensity = "1 g/cm^3"', "particles.oak-bead.mass", "mass = 1", "both given"),
        ("[particles.oak-bead]", "[particles.ash]", "particles.ash", "[particles.ash]", "also a material"),
        ('"double"', '"wall"', "experiment 2, wall", '[[experiments]]\nid = "pendulum-1"', "missing"),
        ('"double"', '"double"\nwall = "steel"', "experiment 2, wall", 'wall = "steel"\nparticle', "no wall"),
        # rigs and media
        ('rig = "drop"', 'rig = "dorp"', "experiment 1, rig", "dorp", "did you mean 'drop'"),
        ('r02.csv"]', 'r02.csv"]\ncolumns = "weight=3"', "experiment 1, columns", "columns", "names no column"),
        ('r02.csv"]', 'r02.csv"]\njoin = ["3"]', "experiment 1, join", "join", "two at least"),
        ('"r02.csv"]', '\n"r03.csv"]', "experiment 1, repetition 2", "r03.csv", "no file"),
        ('"p3.jpg"', '"."', "experiment 3, repetition 2", '"."', "listed twice"),
        ('["r01.mp4", "r02.csv"]', '[["r01.mp4", "r02.csv"]]', "experiment 1, repetition 1", '[["r01', "one file"),
    ],
)
def test_a_wrong_entry_is_refused_with_key_line_and_advice(folder, case):
    old, new, key, on_line, words = case
    message, text = refusal(folder, old, new)
    line = text.count("\n", 0, text.index(on_line)) + 1
    assert f" line {line}: {key}: " in message
    assert words in message


def test_the_same_contact_given_in_both_orders_is_refused(folder):
    again = '[contacts.oak-bead-steel]\nrestitution = 0.4\n\n[[experiments]]\nid = "drop-1"'
    message, _ = refusal(folder, '[[experiments]]\nid = "drop-1"', again)
    assert "contacts.oak-bead-steel: " in message
    assert "twice" in message


def test_a_contact_that_can_be_read_in_two_ways_is_refused(folder):
    particle = '[particles.{}]\nmaterial = "ash"\ndiameter = 0.006\n\n'
    names = "".join(particle.format(name) for name in ("a", "b", "a-b", "b-b"))
    message, _ = refusal(folder, "[contacts.steel-oak-bead]", names + "[contacts.a-b-b]")
    assert "a with b-b or a-b with b" in message


@pytest.mark.parametrize(
    ("old", "new", "on_line"),
    [
        ('title = "Ash', "title = Ash", "title"),
        ('title = "Ash beads on steel"', 'title = "Ash', "title"),
        ('rig = "pile"', 'rig = "pile"\nrig = "pile"', 'rig = "pile"\nvariant'),
        ("[materials.ash]", "[materials.ash", "[materials.ash"),
        ("count = 1000", "count 1000", "count"),
    ],
)
def test_a_slip_of_syntax_is_refused_with_its_line(folder, old, new, on_line):
    message, text = refusal(folder, old, new)
    line = text.count("\n", 0, text.index(on_line)) + 1
    assert f", line {line}: not valid TOML" in message


@pytest.mark.parametrize("twice", ['rig = "pile"\nrig = "pile"', 'rig = "pile"\n[materials.ash]'])
def test_a_key_or_table_that_stands_twice_is_to_be_taken_out(folder, twice):
    message, _ = refusal(folder, 'rig = "pile"', twice)
    assert "the key or table stands there twice" in message
    assert message.endswith("take one of the two out.")


def test_quotation_marks_of_a_word_processor_are_named(folder):
    straight = 'write straight quotation marks, " and not \u201c or \u201d.'
    message, _ = refusal(folder, 'rig = "pile"', "rig = \u201cpile\u201d")
    assert message.endswith(straight)
    key, _ = refusal(folder, 'rig = "pile"', "\u201crig\u201d = pile")
    assert key.endswith(straight)
    for comment in ("the lab\u2019s heap", "a heap, \u201cbig\u201d"):
        message, _ = refusal(folder, 'rig = "pile"', f"rig = pile  # {comment}")
        assert not message.endswith(straight)


def test_a_text_that_never_ends_is_refused(folder):
    message, _ = refusal(folder, 'title = "Ash', 'title = """Ash')
    assert "not valid TOML" in message


def test_all_slips_are_reported_with_their_lines(folder):
    message, text = refusal(
        folder, '[experiments.camera]\nframe_rate = "240 Hz"\nscale', "[experiments.camera]\nfps = 1\nscael"
    )
    line = text.count("\n", 0, text.index("scael")) + 1
    assert "has 2 faults" in message
    assert f"line {line - 1}: experiment 1, camera.fps: " in message
    assert f"line {line}: experiment 1, camera.scael: unknown key; did you mean 'scale'" in message


def test_a_lab_without_experiments_is_refused(tmp_path):
    (tmp_path / "lab.toml").write_text("[lab]\n")
    with pytest.raises(BadLabFile, match="has no experiments"):
        read_lab(tmp_path)


def test_a_file_that_is_not_utf_8_is_refused_with_its_line(tmp_path):
    (tmp_path / "lab.toml").write_bytes("[lab]\n# 90 µm\n".encode("latin-1"))
    with pytest.raises(BadLabFile, match="line 2: is not UTF-8"):
        read_lab(tmp_path)


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"\xff\xd8\xff\xe0\x00\x10JFIF", r"a picture \(JPEG\)"),
        (b"\x00\x00\x00\x20ftypisom\xff", r"a film \(MP4\)"),
        (b"solid wall\nfacet normal 0 0 1\nendfacet\nendsolid", "an STL file"),
    ],
)
def test_another_kind_of_file_is_named(tmp_path, content, kind):
    (tmp_path / "lab.toml").write_bytes(content)
    with pytest.raises(BadLabFile, match=f"lab.toml: is {kind}, no text with keys"):
        read_lab(tmp_path)


def test_a_byte_order_mark_and_windows_line_ends_do_no_harm(folder):
    plain = read_lab(folder)
    (folder / "lab.toml").write_bytes(b"\xef\xbb\xbf" + LAB.replace("\n", "\r\n").encode())
    assert read_lab(folder) == plain
    (folder / "lab.toml").write_bytes(LAB.replace("240 Hz", "240 mm").replace("\n", "\r\n").encode())
    with pytest.raises(BadLabFile, match="line 24: "):
        read_lab(folder)


@pytest.mark.parametrize("name", ["", "nowhere", "nowhere/lab.toml"])
def test_a_folder_without_a_lab_file_is_refused_with_the_way_to_make_one(tmp_path, name):
    with pytest.raises(BadLabFile, match=r"no such file.*rigtwin init"):
        read_lab(tmp_path / name)


def with_media(folder):
    """Empty media for every rig of a new lab."""
    for rig in RIGS:
        for name in ("r01.mp4", "r01_front.jpg", "r01_left.jpg", "r02.jpg"):
            (folder / rig / name).write_text(f"{rig} {name}")


def test_a_new_lab_has_every_rig_and_reads_once_its_media_are_there(tmp_path):
    folder = tmp_path / "new" / "lab"
    assert new_lab(folder) == [folder / "lab.toml"]
    with pytest.raises(BadLabFile, match=r"has 11 faults: .*no file matches 'drop/\*.mp4'.*no file .*r02.jpg"):
        read_lab(folder)
    with_media(folder)
    lab = read_lab(folder)
    assert [experiment.rig_name for experiment in lab.experiments] == list(RIGS)
    for experiment in lab.experiments:
        for a, b in experiment.contacts:
            lab.contact(a, b)  # complete: the twins can start


EITHER_OR = (
    "scale", "known_length", "camera_roll", "plumb_line", "board", "density", "columns", "join", "spheres", "stl",
    "size_distribution",
)  # fmt: skip


@pytest.mark.parametrize(("heap", "shape"), [("piling", "slot"), ("pouring", "conical"), ("emptying", "slot")])
def test_every_commented_line_of_the_new_lab_is_valid_when_uncommented(tmp_path, heap, shape):
    new_lab(tmp_path)
    with_media(tmp_path)
    path = tmp_path / "lab.toml"
    other = "|".join(EITHER_OR)  # what another line says already, or what needs a file
    text = re.sub(rf"^# (?!{other})(?=\w+ = )", "", path.read_text(), flags=re.M)
    text = re.sub(r"^wall = .*only with variant.*\n", "", text, flags=re.M)
    text = text.replace('variant = "piling"', f'variant = "{heap}"').replace('variant = "slot"', f'variant = "{shape}"')
    only_of = {**PileSettings.only_of, **HopperSettings.only_of}
    others = [name for name, (_, variant) in only_of.items() if variant not in (heap, shape)]
    text = re.sub(rf"^({'|'.join(others)}) = .*\n", "", text, flags=re.M)
    path.write_text(text)
    drop, pendulum, *_, pile, drum, hopper = read_lab(tmp_path).experiments
    assert drop.rig.drop_height == pytest.approx(0.3)
    assert drop.camera.end == Moment(1.5, "s")
    assert drop.scatter["restitution_wall"].relative == 0.05
    assert pendulum.rig.release_angle == pytest.approx(math.radians(45))
    assert (pile.rig.drain_diameter == pytest.approx(0.03)) == (heap == "emptying")
    assert (hopper.rig.cone_height == pytest.approx(0.1)) == (shape == "conical")
    assert (drum.rig.fill, hopper.rig.outlet) == (0.35, pytest.approx(0.034))


@pytest.mark.parametrize("name", EITHER_OR[:5])
def test_every_line_of_the_new_lab_that_excludes_another_is_valid_by_itself(tmp_path, name):
    new_lab(tmp_path)
    with_media(tmp_path)
    (tmp_path / "board.jpg").touch()
    path = tmp_path / "lab.toml"
    path.write_text(re.sub(rf"^# (?={name} = )", "", path.read_text(), flags=re.M))
    assert read_lab(tmp_path).experiments[0].camera != Camera()


SIZES = ["size_distribution"]


@pytest.mark.parametrize("lines", [["spheres"], ["stl", "stl_unit", "stl_spheres"], ["stl", "stl_error"], SIZES])
def test_the_shapes_of_a_particle_in_the_new_lab_are_valid_in_place_of_its_diameter(tmp_path, lines):
    new_lab(tmp_path)
    with_media(tmp_path)
    trimesh.creation.icosphere(subdivisions=2, radius=3.0).export(tmp_path / "grain.stl")
    path = tmp_path / "lab.toml"
    text = re.sub(rf"^# (?=({'|'.join(lines)}) = )", "", path.read_text(), flags=re.M)
    instead = "diameter|mass" if lines is SIZES else "diameter"
    path.write_text(re.sub(rf"^({instead}) = .*\n", "", text, flags=re.M))
    bead = read_lab(tmp_path).particles["bead6"]
    assert (bead.sizes is None) == (lines is not SIZES)
    assert (bead.shape is None) == (lines is SIZES)


CAMERA_SAID_TWICE = {
    'plumb_line = "412,20,405,700"\ncamera_roll = "1 deg"': "camera_roll is given too",
    'scale = "0.2 mm/px"\nboard = "checkerboard 9x6 10mm board.png"': "a scale or a known length is given too",
    'board = "checkerboard 9x6 10mm missing.png"': "missing.png",
    'board = "chess 9x6 10mm board.png"': "is no board",
}


@pytest.mark.parametrize(("lines", "message"), CAMERA_SAID_TWICE.items())
def test_what_is_said_twice_of_the_camera_is_refused(tmp_path, lines, message):
    new_lab(tmp_path)
    path = tmp_path / "lab.toml"
    path.write_text(path.read_text().replace("[experiments.camera] ", f"[experiments.camera]\n{lines}\n#", 1))
    for name in ("drop/r01.mp4", "board.png"):
        (tmp_path / name).touch()
    with pytest.raises(BadLabFile, match=message):
        read_lab(tmp_path)


def test_a_new_lab_overwrites_nothing(folder):
    with pytest.raises(BadInput, match="not overwritten"):
        new_lab(folder)
    assert (folder / "lab.toml").read_text() == LAB


def test_a_new_lab_in_place_of_a_file_is_refused(tmp_path):
    (tmp_path / "taken").touch()
    with pytest.raises(BadInput, match="name another folder"):
        new_lab(tmp_path / "taken")


def test_a_twin_takes_the_stated_height_first_then_the_measured_one():
    assert DropSettings(drop_height=0.3).rig(0.28).drop_height == 0.3
    assert DropSettings().rig(0.28).drop_height == 0.28
    with pytest.raises(BadInput, match="drop height is neither stated nor measured; add drop_height"):
        DropSettings().rig()


def test_a_name_like_nothing_known_gets_the_list_of_what_is():
    assert suggestion("xyz", ["drop", "pile"]) == "known are drop, pile"


ONE = """
[[experiments]]
id = "one"
rig = "{}"
particle = "D6"
wall = "PMMA"
repetitions = [{}]
{}
"""


def repetitions(folder, rig, written, files, more=""):
    """The names of what is read as repetitions, from a lab with these files."""
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    (folder / "lab.toml").write_text(ONE.format(rig, written, more))
    (experiment,) = read_lab(folder).experiments
    return [[view.relative_to(folder).as_posix() for view in views] for views in experiment.repetitions]


def test_a_pattern_stands_for_all_files_that_it_matches_in_natural_order(tmp_path):
    files = [f"clips/r{n}.mp4" for n in (10, 9, 1)] + ["clips/notes.md", "clips/.r2.mp4"]
    assert repetitions(tmp_path, "drop", '"clips/*.mp4"', files) == [[f"clips/r{n}.mp4"] for n in (1, 9, 10)]


def test_a_folder_stands_for_the_films_and_tables_in_it(tmp_path):
    files = ["clips/r10.mp4", "clips/r2.csv", "clips/still.jpg", "clips/notes.md"]
    assert repetitions(tmp_path, "drop", '"clips/"', files) == [["clips/r2.csv"], ["clips/r10.mp4"]]


def test_a_folder_of_pictures_is_one_clip_of_a_film_and_several_piles(tmp_path):
    files = ["many/p1.jpg", "many/p2.jpg"]
    assert repetitions(tmp_path, "drop", '"many"', files) == [["many"]]
    pile = 'variant = "piling"\nbase_diameter = "90 mm"'
    assert repetitions(tmp_path, "pile", '"many"', files, pile) == [["many/p1.jpg"], ["many/p2.jpg"]]


def test_a_folder_of_folders_of_pictures_holds_clips(tmp_path):
    files = ["clips/r10/1.png", "clips/r2/1.png"]
    assert repetitions(tmp_path, "drop", '"clips"', files) == [["clips/r2"], ["clips/r10"]]


def test_a_pattern_in_brackets_stands_for_the_views_of_one_pile(tmp_path):
    files = ["p1_a.jpg", "p1_b.jpg", "p2.jpg"]
    pile = 'variant = "piling"\nbase_diameter = "90 mm"'
    found = repetitions(tmp_path, "pile", '["p1_*.jpg", "p2.jpg"]', files, pile)
    assert found == [["p1_a.jpg", "p1_b.jpg", "p2.jpg"]]
    assert repetitions(tmp_path, "pile", '["p1_*.jpg"], "p2.jpg"', files, pile) == [found[0][:2], ["p2.jpg"]]
    assert repetitions(tmp_path, "pile", '"p1_*.jpg"', files, pile) == [["p1_a.jpg"], ["p1_b.jpg"]]


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ('"clips/*.mov"', "no file matches 'clips/\\*.mov'"),
        ('"empty/"', "nothing in the folder 'empty/' can be measured"),
        ('"../*.mp4"', "lies outside the lab's folder"),
        ('"clips/r1.mp4", "clips/*.mp4"', "listed twice"),
    ],
)
def test_a_pattern_or_folder_that_gives_nothing_is_refused(tmp_path, written, words):
    lab = tmp_path / "lab"
    (lab / "empty").mkdir(parents=True)
    (tmp_path / "outside.mp4").touch()
    with pytest.raises(BadLabFile, match=rf"line 7: experiment 1, repetition \d: .*{words}"):
        repetitions(lab, "drop", written, ["clips/r1.mp4"])


def test_all_that_is_wrong_is_reported_at_once_and_nothing_that_follows_from_it(tmp_path):
    new_lab(tmp_path)
    with_media(tmp_path)
    path = tmp_path / "lab.toml"
    text = path.read_text().replace("poisson_ratio = 0.44", "").replace('rig = "drum"', 'rig = "drumm"')
    text = text.replace('variant = "slide"', 'variant = "slid"').replace("cylinder_diameter =", "cylindre_diameter =")
    path.write_text(text.replace("drop/*.mp4", "drop/none.mp4"))
    with pytest.raises(BadLabFile) as refused:
        read_lab(tmp_path)
    said = [
        "there is no file .*none.mp4", "variant: 'slid' is not known", "cylindre_diameter: unknown key",
        "rig: there is no rig 'drumm'", "materials.ash.poisson_ratio: this key is missing",
    ]  # fmt: skip
    assert len(refused.value.faults) == len(said)
    for fault, words in zip(refused.value.faults, said, strict=True):
        assert re.search(rf"^line \d+: .*{words}", fault)


def faults_of(folder, text):
    (folder / "lab.toml").write_text(text)
    with pytest.raises(BadLabFile) as refused:
        read_lab(folder)
    return list(refused.value.faults)


def test_an_unknown_rig_hides_no_fault_of_the_keys_of_all_rigs(folder):
    wrong = LAB.replace('mass = "0.0710 g"', 'mass = "71 g"').replace('rig = "drop"\n', 'rig = "shear cell"\n')
    wrong = wrong.replace('id = "pendulum-1"', 'id = "drop-1"').replace("count = 1000\n", "coont = 1000\ncomment = 1\n")
    wrong = wrong.replace('rig = "pile"', 'rig = "piles"').replace('variant = "piling"\n', "")
    wrong = wrong.replace('particle = "oak-bead"\n', "")
    said = [
        "particles.oak-bead.mass: .*kg/m\\^3", "experiment 1, rig: there is no rig 'shear cell'; known are",
        "experiment 2, id: 'drop-1' is already the id of experiment 1", "experiment 3, rig: .* did you mean 'pile'",
        "experiment 3, coont: unknown key; did you mean 'count'", "experiment 3, comment: unknown key; known are",
        "experiment 1, particle: this key is missing", "experiment 3, variant: this key is missing",
    ]  # fmt: skip
    wrong = wrong.replace('particle = "D12"', 'particle = "oak-bead"')  # another experiment uses it
    found = faults_of(folder, wrong)
    assert len(found) == len(said), found
    for fault, words in zip(found, said, strict=True):
        assert re.search(words, fault), fault


def test_the_mass_of_a_particle_is_checked_where_the_rig_of_its_experiment_is_unknown(folder):
    found = faults_of(folder, LAB.replace('"0.0710 g"', '"71 g"').replace('rig = "drop"', 'rig = "shear cell"'))
    assert ["mass" in found[0], "no rig" in found[1], len(found)] == [True, True, 2]


def test_keys_that_do_not_go_together_are_named_beside_an_unknown_key(folder):
    found = faults_of(
        folder, LAB.replace('variant = "piling"', 'variant = "piling"\ncomment = 1\ntube_diameter = "3 cm"')
    )
    assert ["comment: unknown key" in found[0], "tube_diameter: is of variant" in found[1]] == [True, True]


@pytest.mark.parametrize(
    ("written", "place"),
    [
        ("[materials]\nash = 3", "materials.ash"),
        ("[materials]\ndensity = 3", "materials.density"),  # the name of a key as that of a material
        ('[experiments.files]\n"r1.mp4" = 3', 'experiment 1, files."r1.mp4"'),
        ("[particles]\nbead = 4", "particles.bead"),
        ("[contacts]\nash-ash = 2", "contacts.ash-ash"),
    ],
)
def test_what_is_no_table_is_the_only_fault_of_its_place(tmp_path, written, place):
    with pytest.raises(BadLabFile) as refused:
        repetitions(tmp_path, "drop", '"r1.mp4"', ["r1.mp4"], f"bonces = 3\n{written}")
    table, key = refused.value.faults[::-1]
    assert "bonces: unknown key" in key
    assert f"{place}: " in table
    assert table.count("is not a table") == 1


def test_a_scatter_is_stated_with_or_without_its_repetitions(tmp_path):
    stated = 'scatter = { restitution_wall = "6 % (n = 5)", rebound_height = 0.1 }'
    repetitions(tmp_path, "drop", '"r1.mp4"', ["r1.mp4"], stated)
    (experiment,) = read_lab(tmp_path).experiments
    assert [(one.relative, one.freedom) for one in experiment.scatter.values()] == [(0.06, 4), (0.1, math.inf)]


@pytest.mark.parametrize("given", ['"6 mm"', '"0"', "true", '"150 %"', '"5 % (n = 1)"', "3"])
def test_a_scatter_that_is_no_share_is_refused(tmp_path, given):
    with pytest.raises(BadLabFile, match=r"line 8: experiment 1, scatter.restitution_wall: .* is no scatter"):
        repetitions(tmp_path, "drop", '"r1.mp4"', ["r1.mp4"], f"scatter = {{ restitution_wall = {given} }}")
