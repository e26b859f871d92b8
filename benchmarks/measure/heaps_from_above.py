"""How far a camera that looks down changes the flanks of a heap: settled heaps of the twin beside the uncertainty.

    python benchmarks/measure/heaps_from_above.py

`measure pile` undoes the view as if the heap were a smooth cone (`rigtwin.measure.pile.silhouette.undo_view`); which
grain hides which remains, and is the part "view from above" of the uncertainty.  Heaps 10 to 22 grains wide are poured
by the twin and seen from four sides at 2 to 10 degrees.  Each row is the root mean square of the error of an angle,
beside the mean uncertainty that is stated for it.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import gsd.hoomd
import numpy as np
import numpy.typing as npt

import rigtwin
from rigtwin.benchmarks.figures import Row, against, report, small
from rigtwin.lab.records import Profile
from rigtwin.measure.bulk.outline import View
from rigtwin.measure.pile import evaluate, repose_angles
from rigtwin.measure.pile.silhouette import undo_view
from rigtwin.sim.output.outline import highest

Array = npt.NDArray[np.float64]

BEAD = 6.0  # [mm]
RIM = 3.1  # [mm]
HEAPS = small({60: 650, 90: 1850, 130: 5300}, {60: 300})  # beads that are poured, by the diameter of the base [mm]
ROLLING = small((0.05, 0.2, 0.5), (0.2,))  # rolling friction
DOWN = small((2, 4, 6, 8, 10), (2, 10))  # [deg], by which the camera looks down
AWAY = 9.0  # [radii of the base], horizontal distance of the camera from the axis
SIDES = np.radians((0, 90, 180, 270))


def settled(across: int, count: int, rolling: float, folder: Path) -> Array:
    """Centres of the beads above the base [radii of the base], shape (n, 3)."""
    path = folder / f"heap-{across}-{rolling}.gsd"
    rigtwin.simulate(
        "pile",
        base_diameter=f"{across} mm",
        rim_height=f"{RIM} mm",
        count=count,
        rolling_friction=rolling,
        seed=1,
        trajectory=str(path),
    )
    with gsd.hoomd.open(str(path)) as frames:
        places = np.asarray(frames[-1].particles.position, dtype=np.float64) / (0.5e-3 * across)
    return places[(places[:, 2] > 0) & (np.hypot(places[:, 0], places[:, 1]) < 1 + BEAD / across)]


def turned(centres: Array, angle: float) -> Array:
    """The centres, turned about the vertical axis [rad]."""
    cos, sin = math.cos(angle), math.sin(angle)
    x, y, z = centres.T
    return np.column_stack([x * cos - y * sin, x * sin + y * cos, z])


def seen_from_above(centres: Array, radius: float, x: Array, view: View) -> Array:
    """Outline in the picture of a camera that is pointed at the middle of the base."""
    camera = np.array([0.0, -view.camera_distance, view.camera_height])
    distance = float(np.linalg.norm(camera))
    forward = -camera / distance
    right = np.array([1.0, 0.0, 0.0])
    nearer = distance / ((centres - camera) @ forward)
    return highest(x, (centres @ right) * nearer, (centres @ np.cross(right, forward)) * nearer, radius * nearer)


def flanks(x: Array, height: Array, grain: float) -> Array:
    """Angles of the left and right flank [deg]; NaN where there is none."""
    heap = repose_angles.find_parts(Profile(x, height, np.zeros_like(x), (-1.0, 1.0)), 2.0, grain)
    lines = [None if heap is None else repose_angles.flank_line(heap, side) for side in repose_angles.SIDES]
    return np.array([line.angle if line else math.nan for line in lines])


def errors(centres: Array, grain: float, down: float) -> Array:
    """Errors of the left, right and mean angle [deg] from every side, shape (sides, 3)."""
    view = View((0.0, 0.0), 0.0, 1.0, AWAY * math.tan(math.radians(down)), AWAY)
    x = np.arange(-1.2, 1.2, grain / 24)
    found = []
    for side in SIDES:
        heap = turned(centres, side)
        level = highest(x, heap[:, 0], heap[:, 2], np.full(len(heap), grain / 2))
        above = seen_from_above(heap, grain / 2, x, view)
        there = np.isfinite(above)
        slopes = np.tan(np.radians(flanks(x[there], above[there], grain)))
        undone = undo_view(x[there], above[there], view, (float(slopes[0]), float(slopes[1])))
        true = np.isfinite(level)
        apart = flanks(*undone, grain) - flanks(x[true], level[true], grain)
        found.append([*apart, apart.mean()])
    return np.array(found)


def rows(folder: Path) -> Iterator[Row]:
    for across, count in HEAPS.items():
        heaps = [settled(across, count, rolling, folder) for rolling in ROLLING]
        grain = 2 * BEAD / across
        for down, (name, columns) in product(DOWN, (("a flank", slice(2)), ("the mean of both", slice(2, 3)))):
            found = np.concatenate([errors(heap, grain, down)[:, columns].ravel() for heap in heaps])
            found = found[np.isfinite(found)]
            share = evaluate.BOTH_FLANKS if columns.start else 1.0
            stated = evaluate.from_above(down, 2.0 / grain) * share
            title = f"base of {across / BEAD:.0f} grains seen from {down} degrees above: error of {name}"
            rms = float(np.sqrt(np.mean(found**2)))
            note = f"{len(found)} angles of {len(heaps)} heaps, mean {found.mean():+.2f}"
            yield against(title, rms, stated, relative=0.5, unit="deg", note=note)


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        return report("heaps-from-above", list(rows(Path(folder))))


if __name__ == "__main__":
    sys.exit(main())
