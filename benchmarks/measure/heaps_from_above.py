"""Angles of heaps that a camera sees from above: settled heaps of the twin beside the stated intervals.

    python benchmarks/measure/heaps_from_above.py

`measure pile` undoes the view as if the heap were a smooth cone (`rigtwin.measure.pile.silhouette.undo_view`); which
grain hides which remains, and is the part "view from above" of the uncertainty.  Heaps 10 to 22 grains wide are poured
by the twin and seen from four sides at 2 to 10 degrees.  Each row is the share of the graphical angles whose 95 %
interval holds the angle of the level view; the second one is that without this part.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import gsd.hoomd
import numpy as np
import numpy.typing as npt

import rigtwin
from rigtwin.benchmarks.figures import Row, coverage, report, small
from rigtwin.lab.quantity import Quantity
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


def angles(x: Array, height: Array, grain: float, down: float = 0.0) -> dict[str, Quantity]:
    """Graphical angle of each flank and of both."""
    seen = np.isfinite(height)
    profile = Profile(x[seen], height[seen], np.zeros(int(seen.sum())), (-1.0, 1.0))
    heap = evaluate.Observation(profile, grain=grain, looking_down=down)
    found = evaluate.evaluate_views([heap], 2.0, grain).quantities
    return {str(one.detail["side"]): one for one in found if one.method == evaluate.LINE}


def flank_slopes(x: Array, height: Array, grain: float) -> tuple[float, float]:
    """Tangents of the left and right flank."""
    heap = repose_angles.find_parts(Profile(x, height, np.zeros_like(x), (-1.0, 1.0)), 2.0, grain)
    lines = [None if heap is None else repose_angles.flank_line(heap, side) for side in repose_angles.SIDES]
    left, right = (math.tan(math.radians(line.angle)) if line else 0.5 for line in lines)
    return left, right


def holds(one: Quantity, true: float) -> bool:
    low, high = one.interval95
    return low <= true <= high


def held(centres: Array, grain: float, down: float) -> Iterator[tuple[bool, bool]]:
    """Whether the interval of each angle from every side holds that of the level view, with and without the part."""
    view = View((0.0, 0.0), 0.0, 1.0, AWAY * math.tan(math.radians(down)), AWAY)
    x = np.arange(-1.2, 1.2, grain / 24)
    for side in SIDES:
        heap = turned(centres, side)
        level = angles(x, highest(x, heap[:, 0], heap[:, 2], np.full(len(heap), grain / 2)), grain)
        above = seen_from_above(heap, grain / 2, x, view)
        there = np.isfinite(above)
        undone = undo_view(x[there], above[there], view, flank_slopes(x[there], above[there], grain))
        for name, one in angles(*undone, grain, down).items():
            if name in level:
                rest = math.sqrt(one.std_uncertainty**2 - one.budget.get("view from above", 0.0) ** 2)
                yield holds(one, level[name].value), holds(replace(one, std_uncertainty=rest), level[name].value)


def rows(folder: Path) -> Iterator[Row]:
    heaps = [
        (settled(across, count, rolling, folder), 2 * BEAD / across)
        for across, count in HEAPS.items()
        for rolling in ROLLING
    ]
    for down in DOWN:
        hits = [hit for heap, grain in heaps for hit in held(heap, grain, down)]
        yield coverage(f"seen from {down} degrees above", [hit for hit, _ in hits], note="angles")
        yield coverage(f"seen from {down} degrees above, without the part", [hit for _, hit in hits], judged=False)


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        return report("heaps-from-above", list(rows(Path(folder))))


if __name__ == "__main__":
    sys.exit(main())
