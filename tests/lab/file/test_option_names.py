"""Messages on an experiment of a lab name the keys of its file in place of options of the command line."""

import shutil
from pathlib import Path

import pytest
from typer.main import get_command

from rigtwin.cli import app, run
from rigtwin.lab.errors import BadLabFile
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.file.option_names import in_keys
from rigtwin.lab.rigs import RIGS

MEDIA = Path(__file__).parents[3] / "sample_media"
DROP = """\
[[experiments]]
id = "drop"
rig = "drop"
particle = "D6"
wall = "steel"
repetitions = ["r01.mp4"]

[experiments.camera]
"""


def drop(folder, *lines):
    shutil.copy(MEDIA / "drop" / "r01.mp4", folder)
    (folder / "lab.toml").write_text(DROP + "\n".join(lines) + "\n")
    return folder


@pytest.mark.parametrize(
    ("option", "key"),
    [
        ("state it with --bead-at frame:x,y.", 'state it with bead_at "frame:x,y".'),
        ("end it with --end 45f.", 'end it with end "45f".'),
        ("move --start and --end to the fall;", "move start and end to the fall;"),
        ("give --frame-rate 240Hz, or --scale.", 'give frame_rate "240Hz", or scale.'),
        (
            "it is not that of --bead-diameter 6.2 mm alone",
            'it is not that of diameter "6.2 mm" of [particles.D6] alone',
        ),
        ("--region begins at 3,5", "region begins at 3,5"),
        ("name it with --columns 't=NAME[s]'", "name it with columns 't=NAME[s]'"),
        ("--exclude 60f..80f (0.25 s to 0.33 s): it leaves", 'exclude "60f..80f" (0.25 s to 0.33 s): it leaves'),
        ("put it there with --allow-outside or --pivot", "put it there with --allow-outside or --pivot"),
    ],
)
def test_an_option_is_its_key(option, key):
    assert in_keys(option, "drop", "[particles.D6]") == key


@pytest.mark.parametrize("rig", RIGS)
def test_every_option_that_states_something_of_a_film_is_a_key(rig):
    command = get_command(app).commands["measure"].commands[rig]
    words = {word for option in command.params for word in option.opts if word.startswith("--")}
    # what is done with the results, and what a lab has in another form
    words -= {"--out", "--json", "--quiet", "--log", "--angle", "--sound"}
    left = {word for word in words if in_keys(word, rig, "[particles.D6]") == word}
    assert not left


@pytest.mark.usefixtures("in_this_process")
def test_a_refused_repetition_of_a_lab_is_told_by_its_keys(tmp_path, capfd):
    lab = drop(tmp_path, 'centre = ["900:200,90"]')
    assert run(["measure", str(lab), "--out", str(tmp_path / "out")]) == 2
    said = " ".join(capfd.readouterr().err.split())
    assert 'centre "900:200,90" is outside the frames' in said
    assert "change start and end" in said
    assert "--centre" not in said


@pytest.mark.usefixtures("in_this_process")
def test_so_are_its_warnings(tmp_path, capfd):
    lab = drop(tmp_path)
    assert run(["measure", str(lab), "--out", str(tmp_path / "out"), "--json"]) == 0
    said = "".join(capfd.readouterr())
    assert "give the capture rate with frame_rate." in said
    assert "--frame-rate" not in said


def test_a_line_that_stands_upright_is_refused_with_the_line_of_the_file(tmp_path):
    photo = tmp_path / "view1.jpg"
    shutil.copy(MEDIA / "pile" / "view1.jpg", photo)
    (tmp_path / "lab.toml").write_text(
        '[[experiments]]\nid = "heap"\nrig = "pile"\nvariant = "piling"\nparticle = "D6"\nwall = "steel"\n'
        'base_diameter = "90 mm"\nrepetitions = ["view1.jpg"]\n[experiments.camera]\nbase = "300,100,310,400"\n'
    )
    with pytest.raises(BadLabFile, match=r"line 10.*camera\.base: names points at 300,100 and 310,400"):
        read_lab(tmp_path)


OWN = """
[particles.D6]
material = "wood_ash"
diameter = "6.2 mm"
"""


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize(("own", "place"), [("", "D6 (taken from the reference)"), (OWN, "[particles.D6]")])
def test_a_section_of_a_particle_is_named_where_there_is_one(tmp_path, capfd, own, place):
    shutil.copy(MEDIA / "pile" / "view1.jpg", tmp_path)
    (tmp_path / "lab.toml").write_text(
        '[[experiments]]\nid = "heap"\nrig = "pile"\nvariant = "piling"\nparticle = "D6"\nwall = "steel"\n'
        f'base_diameter = "900 mm"\nrepetitions = ["view1.jpg"]\n{own}'
    )
    assert run(["measure", str(tmp_path)]) == 0
    assert f"check diameter of {place} and the scale" in " ".join(capfd.readouterr().out.split())
