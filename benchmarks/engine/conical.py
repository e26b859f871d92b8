"""The conical hopper of Hlosta et al. 2020 (section 2.2.3): flow against the shear modulus, and beside LIGGGHTS.

Fewer beads than the paper's 15,000, as the steady flow through an outlet does not hang on the filling above it.  Both
codes start from the same places at rest, without rolling friction; without LIGGGHTS ours stands alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.engine import liggghts
from rigtwin.benchmarks.engine.flows import BIN, CONE, OUTLET, funnel_corners
from rigtwin.benchmarks.figures import Row, against, report, small
from rigtwin.lab.materials import Particle
from rigtwin.lab.reference import hlosta2020
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.time_step import time_step
from rigtwin.sim.engine.walls.mesh import Mesh
from rigtwin.sim.engine.walls.shapes import Disc, Wall
from rigtwin.sim.run import filling

Array = npt.NDArray[np.float64]

BEAD = hlosta2020.particle("D6")
AMONG = replace(hlosta2020.contact("D6", "D6"), rolling_friction=0.0)
ON_WALL = replace(hlosta2020.contact("D6", "PMMA"), rolling_friction=0.0)
SOFTEST = 1e6  # [Pa], shear modulus of the filling, and of the flow beside LIGGGHTS
LOOK, LONGEST = 0.01, 3.0  # [s], between looks, and until a flow is given up
SETTLING, RELAXING = small(1.5, 0.1), small(0.05, 0.005)  # [s], of the bed at first, and with another modulus
STEADY = (0.2, 0.8)  # part of the beads that have left
DEEPEST = 0.05  # of a radius, how far beads at rest on the lid may lie in the walls
SKIN = 1.2e-3  # [m], of LIGGGHTS' list


def softened(modulus: float) -> Particle:
    """The bead with this shear modulus [Pa]."""
    return replace(BEAD, material=BEAD.material.softened(modulus / BEAD.material.shear_modulus))


def hopper(bead: Particle, top: float, *, lid: bool) -> Bulk:
    """The hopper with walls of the beads' material, up to z = `top` [m]."""
    walls = [Wall(Mesh(funnel_corners(OUTLET, BIN, CONE, top)), bead.material, ON_WALL)]
    if lid:
        walls.append(Wall(Disc((0, 0, 0), (0, 0, 1), OUTLET), bead.material, ON_WALL))
    reach = 1.2 * BIN
    return Bulk(
        [bead], AMONG, walls, low=(-reach, -reach, -0.1), high=(reach, reach, top + 0.02),
        time_step=time_step([bead])[0], open_domain=True, threads=1,
    )  # fmt: skip


def filled(count: int, top: float, seed: int) -> Array:
    """Places of beads that rest on the lid."""
    bed = hopper(softened(SOFTEST), top, lid=True)
    inside = filling.in_funnel(2 * OUTLET, 2 * BIN, CONE)
    box = np.array([-BIN, -BIN, 0.0]), np.array([BIN, BIN, top])
    filling.scatter(bed, count, inside, box, BEAD, np.random.default_rng(seed))
    while bed.time < SETTLING and not filling.resting(bed.grains(), BEAD, filling.SETTLED):
        bed.run(round(2 * LOOK / bed.time_step))
    return bed.beads().position


def ours(start: Array, modulus: float, top: float) -> Array:
    """Beads that are left at each look after the outlet opened."""
    bead = softened(modulus)
    if modulus != SOFTEST:
        bed = hopper(bead, top, lid=True)
        bed.add(start, overlap=DEEPEST)
        bed.run(round(RELAXING / bed.time_step))
        start = bed.beads().position
    flow = hopper(bead, top, lid=False)
    flow.add(start, overlap=DEEPEST)
    left = [len(start)]
    while left[-1] > (1 - STEADY[1]) * len(start) and flow.time < LONGEST:
        flow.run(round(LOOK / flow.time_step))
        left.append(int((flow.beads().position[:, 2] > 0).sum()))
    return np.array(left)


def theirs(start: Array, top: float, looks: int) -> Array:
    """The same of LIGGGHTS, with the softest beads."""
    bead, reach = softened(SOFTEST), 1.2 * BIN
    step = hopper(bead, top, lid=False).time_step
    every = round(LOOK / step)
    scene = liggghts.Scene(
        kinds=(bead, bead),
        contacts={(0, 0): AMONG, (0, 1): ON_WALL, (1, 1): ON_WALL},
        kind=np.zeros(len(start), dtype=int),
        position=start,
        velocity=np.zeros_like(start),
        walls=liggghts.mesh_wall(),
        files={"walls.stl": liggghts.stl(funnel_corners(OUTLET, BIN, CONE, top))},
        low=(-reach, -reach, -0.1),
        high=(reach, reach, top + 0.02),
        time_step=step,
        skin=SKIN,
    )
    return np.array(
        [int((frame[:, 3] > 0).sum()) for frame in liggghts.positions(scene, steps=every * looks, every=every)]
    )


def steady(left: Array) -> float:
    """Mass flow [g/s] while the middle of the beads leaves."""
    gone = (left[0] - left) / left[0]
    while_steady = (gone >= STEADY[0]) & (gone <= STEADY[1])
    seconds = LOOK * np.arange(len(left))
    return float(-np.polyfit(seconds[while_steady], left[while_steady], 1)[0] * BEAD.mass * 1e3)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=small(5000, 60))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--moduli", type=float, nargs="+", default=[1e6, 1e7, 1e8], help="shear moduli [Pa]")
    options = parser.parse_args(arguments)
    top = CONE + 5 * options.count * BEAD.diameter**3 / (np.pi * BIN**2)  # room for beads that lie scattered
    start = filled(options.count, top, options.seed)
    soft = ours(start, SOFTEST, top)
    rows = [Row(f"flow of {options.count} beads, G = {SOFTEST:g} Pa", steady(soft), "g/s")]
    if liggghts.installed(1):
        other = steady(theirs(start, top, len(soft) + 10))
        rows = [against(rows[0].name, rows[0].value, other, relative=0.03, unit="g/s", note="reference: LIGGGHTS")]
    for modulus in options.moduli:
        if modulus != SOFTEST:
            flow = steady(ours(start, modulus, top))
            rows.append(
                against(f"G = {modulus:g} Pa", flow, rows[0].value, relative=0.015, unit="g/s", note="flat in G")
            )
    return report("conical", rows, count=options.count, seed=options.seed)


if __name__ == "__main__":
    sys.exit(main())
