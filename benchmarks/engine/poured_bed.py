"""How much rolling friction raises a poured bed, under both rolling laws, beside LIGGGHTS (tables 4 to 6 hang on it).

D6 beads fall from a loose cloud into a box 40 mm wide; both codes start from the same places.  The height is twice that
of the centre of mass.  LIGGGHTS' constant torque (cdt) is not held where a bead rests, but turns its spin back and
forth; rigtwin's type A holds it, so that beads stay where they touch first.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.engine import liggghts
from rigtwin.benchmarks.figures import Row, against, report, small
from rigtwin.lab.materials import Contact
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.contact import Rolling
from rigtwin.sim.engine.time_step import time_step
from rigtwin.sim.engine.walls.shapes import Plane, Wall

Array = npt.NDArray[np.float64]

PUBLISHED = hlosta2020.particle("D6")
BEAD = replace(PUBLISHED, material=PUBLISHED.material.softened(1e-3))
AMONG, ON_WALL = hlosta2020.contact("D6", "D6"), hlosta2020.contact("D6", "PMMA")
ACROSS, TALL = 0.04, 0.45  # [m], of the box
CROWDED = 0.3  # cubes around the beads, in parts of the space that they hang in
FALLING = small(1.5, 0.1)  # [s], after which all is at rest
STEP = time_step([BEAD])[0]
FRICTIONS = ((0.5, 0.01), (0.5, 1.0), (1.5, 0.01), (1.5, 1.0))  # static, rolling
LAWS: tuple[Rolling, ...] = ("type C", "type A")


def cloud(count: int, seed: int) -> Array:
    """Places of beads that hang at random in the box and touch neither each other nor a wall."""
    rng = np.random.default_rng(seed)
    edge = 1.05 * BEAD.radius
    high = count * BEAD.diameter**3 / (CROWDED * ACROSS**2)
    placed: list[Array] = []
    while len(placed) < count:
        at = rng.uniform([edge, edge, edge], [ACROSS - edge, ACROSS - edge, high])
        if not placed or np.linalg.norm(np.array(placed) - at, axis=1).min() > 2 * edge:
            placed.append(at)
    return np.array(placed)


def ours(start: Array, rolling: Rolling, contact: Contact) -> float:
    """Height [m] of the bed."""
    sides = [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((ACROSS, 0, 0), (-1, 0, 0))]
    sides += [((0, 0, 0), (0, 1, 0)), ((0, ACROSS, 0), (0, -1, 0))]
    edge = BEAD.diameter
    bed = Bulk(
        [BEAD], contact, [Wall(Plane(point, normal), BEAD.material, ON_WALL) for point, normal in sides],
        low=(-edge, -edge, -edge), high=(ACROSS + edge, ACROSS + edge, TALL), time_step=STEP, rolling=rolling,
        threads=1,
    )  # fmt: skip
    bed.add(start)
    bed.run(round(FALLING / STEP))
    return 2 * float(bed.beads().position[:, 2].mean())


def theirs(start: Array, rolling: Rolling, contact: Contact) -> float:
    """The same of LIGGGHTS."""
    bed = liggghts.Bed(
        particle=BEAD, between=contact, walls=ON_WALL, time_step=STEP, skin=0.1 * BEAD.diameter, gravity=GRAVITY,
        position=start, size=(ACROSS, ACROSS, TALL),
    )  # fmt: skip
    return 2 * float(liggghts.final_positions(bed, rolling, round(FALLING / STEP))[:, 2].mean())


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=small(500, 20))
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args(arguments)
    start = cloud(options.count, options.seed)
    rows = []
    for static, rolling in FRICTIONS:
        contact = replace(AMONG, static_friction=static, rolling_friction=rolling)
        for law in LAWS:
            name, height = f"static {static:g}, rolling {rolling:g}, {law}", 1e3 * ours(start, law, contact)
            if not liggghts.installed(1):
                rows.append(Row(name, height, "mm"))
                continue
            other = 1e3 * theirs(start, law, contact)
            relative = 0.02 if law == "type C" else None  # cdt is another law than our type A, where beads rest
            note = f"reference: LIGGGHTS' {liggghts.ROLLING[law]}"
            rows.append(against(name, height, other, relative=relative, unit="mm", note=note))
    return report("poured-bed", rows, count=options.count, seed=options.seed)


if __name__ == "__main__":
    sys.exit(main())
