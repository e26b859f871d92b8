"""Rigs with walls from STL files, run by LIGGGHTS where it is installed, beside rigtwin's own runs.

A bin that is filled, a hopper whose slide is taken away, a bin in which a paddle turns, one that shakes.  Both codes
start from the same positions; beds and discharges of the same beads differ from run to run.  The tolerances are about
twice that scatter: they show that geometry, motion and conventions are right, not that the contact laws are equal.

    python benchmarks/engine/own_rigs.py [--rig hopper ...] [--seeds 3]
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import trimesh

from rigtwin.benchmarks.engine.decks import computed
from rigtwin.benchmarks.figures import Row, against, report, skipped, small
from rigtwin.compare.twins.custom import cast_of_own, custom_twin
from rigtwin.lab.file.own_rigs import read_own_rig
from rigtwin.sim.decks.deck import Deck

BIN = """
fill = { low = ["-23 mm", "-23 mm", "2 mm"], high = ["23 mm", "23 mm", "150 mm"] }
[rigs.rig.regions.bin]
low = ["-25 mm", "-25 mm", 0]
high = ["25 mm", "25 mm", "80 mm"]
[rigs.rig.walls.bin]
stl = "bin.stl"
material = "PMMA"
"""
ABOVE = BIN.replace('"2 mm"', '"45 mm"')  # the paddle stands below


@dataclass(frozen=True)
class Case:
    """A rig: its keys, the particles, and the quantity that is compared, with its tolerance [1]."""

    keys: str
    count: int
    quantity: str
    tolerance: float


CASES = {
    "bin": Case(f'duration = "3 s"\nend = "at rest"\n{BIN}', small(400, 60), "bed_height", 0.03),
    "hopper": Case(
        f'interval = "{small("10 ms", "2 ms")}"'
        """
duration = "4 s"
end = "empty"
low = ["-40 mm", "-40 mm", "-40 mm"]
high = ["40 mm", "40 mm", "140 mm"]
fill = { low = ["-35 mm", "-35 mm", "45 mm"], high = ["35 mm", "35 mm", "129 mm"] }
[rigs.rig.walls.hopper]
stl = "hopper.stl"
[rigs.rig.walls.slide]
stl = "slide.stl"
removed = "0.5 s"
""",
        small(500, 100), "mass_flow_rate", 0.1,
    ),
    "paddle": Case(
        f"""duration = "2 s"\n{ABOVE}
[rigs.rig.walls.paddle]
stl = "paddle.stl"
material = "steel"
rotation_speed = "120 rpm"
start = "0.5 s"
stop = "1.5 s"
""",
        small(300, 60), "bed_height", 0.06,
    ),
    "shaken": Case(
        f"""duration = "2 s"\n{BIN}
vibration_amplitude = [0, 0, "1 mm"]
vibration_frequency = "25 Hz"
start = "0.5 s"
stop = "1.5 s"
""",
        small(400, 60), "bed_height", 0.03,
    ),
}  # fmt: skip


def draw_walls(folder: Path) -> None:
    """Write the STL files, in millimetres."""
    box = trimesh.creation.box((50, 50, 160))
    box.apply_translation((0, 0, 80))
    box.update_faces(~np.isclose(box.triangles_center[:, 2], 160))
    box.export(folder / "bin.stl")
    sides = []
    for (half, z), (to_half, to_z) in (((20, 0), (35, 45)), ((35, 45), (35, 130))):
        for k in range(4):
            side = [(half, -half, z), (half, half, z), (to_half, to_half, to_z), (to_half, -to_half, to_z)]
            sides.append(trimesh.Trimesh(side, [[0, 1, 2], [0, 2, 3]]))
            sides[-1].apply_transform(trimesh.transformations.rotation_matrix(k * np.pi / 2, (0, 0, 1)))
    trimesh.util.concatenate(sides).export(folder / "hopper.stl")
    for name, corners in (
        ("slide", [(-21, -21, 0), (21, -21, 0), (21, 21, 0), (-21, 21, 0)]),
        ("paddle", [(-15, 0, 8), (15, 0, 8), (15, 0, 40), (-15, 0, 40)]),
    ):
        trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]).export(folder / f"{name}.stl")


def row_of(name: str, seeds: int) -> Row:
    """The compared quantity of a rig, by both codes."""
    case = CASES[name]
    title = f"{name}: {case.quantity.replace('_', ' ')}"
    with tempfile.TemporaryDirectory() as folder:
        draw_walls(Path(folder))
        head = f'[rigs.rig]\nparticle = "D6"\nwall = "PMMA"\ncount = {case.count}\n'
        (Path(folder) / "lab.toml").write_text(head + case.keys)
        own = read_own_rig(Path(folder))
        cast, surfaces = cast_of_own(own)
        ours: list[float] = []
        theirs: list[float] = []
        for seed in range(1, seeds + 1):
            run: dict[str, Any] = {"count": own.count, "seed": seed, "surfaces": surfaces}
            ours.append(custom_twin(own.rig, cast, **run).value(case.quantity))
            if shutil.which("liggghts"):
                deck = Deck("liggghts", own.rig, *cast, **run)
                theirs.append(computed(deck, 1)[0].value(case.quantity))
    note = f"ours {', '.join(f'{one:.4g}' for one in ours)}"
    if not theirs:
        return skipped(title, f"LIGGGHTS is not installed; {note}")
    unit = "kg/s" if case.quantity == "mass_flow_rate" else "m"
    note = f"{', '.join(f'{one:.4g}' for one in theirs)}; {note}"
    return against(title, fmean(theirs), fmean(ours), relative=case.tolerance, unit=unit, note=note)


def main() -> int:
    """Run what was asked for and report it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--rig", action="append", choices=list(CASES))
    parser.add_argument("--seeds", type=int, default=small(3, 1), help="runs of each code, with different starts")
    said = parser.parse_args()
    rows = []
    for name in said.rig or CASES:
        rows.append(row_of(name, said.seeds))
        sys.stderr.write(f"{rows[-1].name}: {rows[-1].value:.5g} {rows[-1].unit}; {rows[-1].note}\n")
    return report("own-rigs", rows)


if __name__ == "__main__":
    sys.exit(main())
