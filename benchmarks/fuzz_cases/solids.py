"""STL files, binary and text: walls of a rig and the shape of a grain."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from random import Random

import trimesh

from rigtwin.benchmarks.fuzz_cases.case import Case, out, written
from rigtwin.benchmarks.fuzz_cases.labs import LAB
from rigtwin.benchmarks.fuzz_cases.mutations import EXTREMES, in_bytes, in_words

SIMULATED = 0.03  # share of walls between which beads are simulated, which takes seconds; the others go into a deck


@cache
def cup() -> trimesh.Trimesh:
    """A square cup without a lid, 40 mm wide, its floor at z = 0."""
    box = trimesh.creation.box((40, 40, 60))
    box.apply_translation((0, 0, 30))
    box.update_faces(box.triangles_center[:, 2] < 59)
    return box


@cache
def grain() -> trimesh.Trimesh:
    """A slightly long grain of 80 facets, 6 mm long."""
    shape = trimesh.creation.icosphere(subdivisions=1, radius=2.5)
    shape.apply_scale((1.2, 1.0, 1.0))
    return shape


def _damaged(chance: Random, solid: trimesh.Trimesh) -> bytes:
    if chance.random() < 0.5:
        return in_bytes(chance, solid.export(file_type="stl"))
    text = solid.export(file_type="stl_ascii")
    return in_words(chance, text if isinstance(text, str) else text.decode())


def wall(chance: Random, folder: Path) -> Case:
    """A wall from an STL file."""
    path = written(folder, "cup.stl", _damaged(chance, cup()))
    unit = chance.choice(("mm",) * 9 + ("cm", "m", "um", "inch"))
    box = "-15mm,-15mm,5mm..15mm,15mm,50mm"
    if chance.random() < 0.1:
        box = in_words(chance, box).decode(errors="replace").replace("\0", "")
    rig = ["custom", "--stl", path, "--stl-unit", unit, f"--fill={box}", "--count", "5"]
    if chance.random() < SIMULATED:
        return Case(["simulate", *rig, "--duration", "0.05s", "--threads", "1", *out(folder)])
    return Case(["export", chance.choice(("liggghts",) * 8 + ("lammps", "yade")), *rig, *out(folder)])


def grain_of_lab(chance: Random, folder: Path) -> Case:
    """A particle whose shape is an STL file."""
    written(folder, "grain.stl", _damaged(chance, grain()))
    shape = f'stl = "grain.stl"\nstl_unit = "{chance.choice(("mm",) * 9 + ("cm", *EXTREMES[:3]))}"\n'
    text = LAB.replace('diameter = "6 mm"\n', shape)
    written(folder, "lab.toml", text)
    return Case(["export", "csv", "--lab", str(folder), "--particle", "bead", *out(folder)])
