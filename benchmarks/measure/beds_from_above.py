"""How far the far side of a bed that is seen from above raises its outline: settled beds of the twin beside the laws.

    python benchmarks/measure/beds_from_above.py

`measure packing` takes the rise off (`rigtwin.measure.packing.cylinder.Bed.raised`).  Beds 8 to 22 beads wide are
poured by the twin and seen from far away, from 12 sides, so that the far side appears t bead diameters above the near
one.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import gsd.hoomd
import numpy as np
import numpy.typing as npt

import rigtwin
from rigtwin.benchmarks.figures import Row, against, report, small
from rigtwin.measure.packing import cylinder
from rigtwin.measure.packing.bed_profile import READ
from rigtwin.sim.output.outline import highest

Array = npt.NDArray[np.float64]

BEAD = 6.0  # [mm]
BEDS = small({8: 350, 12: 1200, 16: 2400, 22: 5000}, {8: 60})  # beads, by the diameter of the cylinder in beads
RISES = (1.0, 2.0, 3.0, 4.0)  # [bead diameters], of the far side above the near side
SIDES = np.radians(np.arange(0, 360, 30))


def settled(across: int, count: int, seed: int, folder: Path) -> Array:
    """Centres of a bed [bead diameters]."""
    path = folder / f"bed-{across}-{seed}.gsd"
    rigtwin.simulate("packing", cylinder_diameter=f"{across * BEAD} mm", count=count, seed=seed, trajectory=str(path))
    with gsd.hoomd.open(str(path)) as frames:
        places = np.asarray(frames[-1].particles.position, dtype=np.float64) / (1e-3 * BEAD)
    return places[np.hypot(places[:, 0], places[:, 1]) < across / 2]


def seen(centres: Array, across: int, rise: float) -> Array:
    """Rise of the mean outline and height of its arch from every side [bead diameters], shape (sides, 2)."""
    x = np.linspace(-READ, READ, 401) * across / 2
    radii = np.full(len(centres), 0.5)
    found = []
    for side in SIDES:
        along = centres[:, 0] * np.cos(side) + centres[:, 1] * np.sin(side)
        away = centres[:, 1] * np.cos(side) - centres[:, 0] * np.sin(side)
        level = highest(x, along, centres[:, 2], radii)
        raised = highest(x, along, centres[:, 2] + rise / across * away, radii)
        arch, _ = cylinder.arch_of(x / (across / 2), raised)
        found.append((float(np.mean(raised - level)), arch))
    return np.array(found)


def rows(folder: Path) -> Iterator[Row]:
    for across, count in BEDS.items():
        beds = [settled(across, count, seed, folder) for seed in (1, 2)]
        for rise in RISES:
            found = np.concatenate([seen(bed, across, rise) for bed in beds])
            laws = float(cylinder.raised_by(rise)), float(cylinder.arch_by(rise))
            for k, (name, within) in enumerate((("rise of the outline", max(0.05, 0.15 * laws[0])), ("arch", 0.5))):
                title = f"{across} beads wide, far side {rise:g} bead diameters higher: {name}"
                note = f"± {found[:, k].std():.2f} from side to side"
                yield against(title, float(found[:, k].mean()), laws[k], absolute=within, note=note)


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        return report("beds-from-above", list(rows(Path(folder))))


if __name__ == "__main__":
    sys.exit(main())
