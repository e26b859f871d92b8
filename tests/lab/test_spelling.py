"""A name is proposed in place of a misspelt one only where it is near."""

import pytest

from rigtwin.cli import run
from rigtwin.lab.file.schema import CameraEntry, DropEntry, DrumEntry, HopperEntry, MaterialEntry, ParticleEntry
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import RIGS
from rigtwin.lab.spelling import near


@pytest.mark.parametrize(
    ("known", "meant"),
    [
        (CameraEntry.model_fields, {"framerate": "frame_rate", "roll": "camera_roll", "resolution": "", "fps": ""}),
        (DropEntry.model_fields, {"height": "drop_height", "wal": "wall", "temperature": "", "operator": ""}),
        (DrumEntry.model_fields, {"speed_rpm": "speed", "rotation_speed": "speed", "rpm": ""}),
        (HopperEntry.model_fields, {"width": "bin_width", "humidity": ""}),
        (MaterialEntry.model_fields, {"youngs": "youngs_modulus", "poisson": "poisson_ratio", "rho": ""}),
        (ParticleEntry.model_fields, {"diam": "diameter", "radius": "", "E": ""}),
        (hlosta2020.NAMES, {"D7": "", "d6": "D6"}),
        (RIGS, {"drumm": "drum", "tilting": "tilt", "dorp": "drop", "drup": "", "silo": "", "shear cell": ""}),
    ],
)
def test_only_a_near_name_is_proposed(known, meant):
    assert {name: near(name, known) for name in meant} == meant


@pytest.mark.parametrize(
    ("arguments", "proposed"),
    [
        (["report"], ""), (["video"], ""), (["plot"], ""), (["compar"], "'compare'"), (["simulation"], "'simulate'"),
        (["compare", "x", "--runz", "2"], "'--runs'"), (["compare", "x", "--report"], ""),
        (["measure", "pen", "x.mp4"], "'pendulum'"), (["simulate", "drop", "--drop-heigh", "3mm"], "'--drop-height'"),
        (["measure", "drop", "x.mp4", "--diameter", "6mm"], "'--bead-diameter'"),
    ],
)  # fmt: skip
def test_only_a_near_command_or_option_is_proposed(arguments, proposed, capsys):
    assert run(arguments) == 2
    said = capsys.readouterr().err
    assert said.count("did you mean") + said.count("ossible") == bool(proposed)
    assert f"did you mean {proposed}" in said or not proposed
