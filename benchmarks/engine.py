"""Speed of the bulk engine on this machine: particle-steps per second of a settled bed of D6 beads.

    python benchmarks/engine.py [--beads 4000] [--threads 1 2] [--rounds 5] [--pile]

Box 20 beads wide and deep, E 11 MPa, Hertz-Mindlin with history, rolling resistance type C, 30 % of Rayleigh's step.
The machine's own speed moves by a factor of two within minutes: only figures of one run are comparable.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import sys
import time
from collections.abc import Sequence

import numpy as np

from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rigs import Pile
from rigtwin.sim import pile
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.bulk import Bulk
from rigtwin.sim.engine.clock import time_step
from rigtwin.sim.engine.walls import Plane, Wall

ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
SOFT = ASH.softened(1e-3)
D6 = Particle("D6", SOFT, 6e-3, density=569)
BEAD_BEAD, BEAD_WALL = Contact(0.75, 0.44, 0.08), Contact(0.42, 0.36, 0.06)
ACROSS = 20  # beads


def settled_bed(beads: int) -> Bulk:
    """A bed that came to rest in the box."""
    width, pitch = ACROSS * D6.diameter, 1.02 * D6.diameter
    side = int(width / pitch)
    k = np.arange(beads)
    layer = k // side**2
    centres = np.stack([k % side, k // side % side, layer], axis=1) * pitch + 0.51 * D6.diameter
    rng = np.random.default_rng(1)
    centres += rng.uniform(-0.01, 0.01, centres.shape) * D6.radius
    planes = [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((width, 0, 0), (-1, 0, 0))]
    planes += [((0, 0, 0), (0, 1, 0)), ((0, width, 0), (0, -1, 0))]
    top = centres[:, 2].max() + width
    bed = Bulk(
        [D6],
        BEAD_BEAD,
        [Wall(Plane(point, normal), SOFT, BEAD_WALL) for point, normal in planes],
        low=(-D6.radius, -D6.radius, -D6.radius),
        high=(width + D6.radius, width + D6.radius, top),
        time_step=time_step([D6])[0],
        capacity=beads,
    )
    # thrown about, so that the bed does not settle as the lattice it was
    bed.add(centres, rng.normal(0, 0.4, centres.shape))
    for _ in range(40):
        bed.run(1000)
        state = bed.beads()
        if state.kinetic_energy < 1e-6 * state.mass.sum() * 9.81 * D6.radius:
            break
    return bed


def speed(bed: Bulk, threads: int, beads: int, seconds: float = 1.0) -> float:
    """Particle-steps per second of wall time."""
    bed.threads = threads
    steps, began = 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        bed.run(200)
        steps += 200
    return steps * beads / (time.perf_counter() - began)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beads", type=int, nargs="+", default=[4000])
    parser.add_argument("--threads", type=int, nargs="+", default=sorted({1, min(2, backend.available_threads())}))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--pile", action="store_true", help="also time the twin of a pile of 1000 beads")
    options = parser.parse_args(arguments)
    sys.stdout.write(f"{platform.machine()}, {backend.available_threads()} cores, Python {platform.python_version()}\n")
    for beads in options.beads:
        began = time.perf_counter()
        bed = settled_bed(beads)
        settling = time.perf_counter() - began
        touching = 2 * bed.contacts / beads
        sys.stdout.write(
            f"N = {beads}: settled in {bed.time:.2f} s simulated, {settling:.1f} s wall; "
            f"{touching:.2f} contacts per bead, largest overlap {bed.largest_overlap:.1%} of a radius\n"
        )
        figures: dict[int, list[float]] = {threads: [] for threads in options.threads}
        for _ in range(options.rounds):
            for threads, found in figures.items():
                found.append(speed(bed, threads, beads))
        for threads, found in figures.items():
            sys.stdout.write(
                f"  {threads} thread(s): {statistics.median(found) / 1e6:.2f} M particle-steps/s "
                f"(median of {len(found)}, best {max(found) / 1e6:.2f})\n"
            )
    if options.pile:
        began = time.perf_counter()
        heap = pile.run(
            Pile(0.09, rim_height=0.01), Particle("D6", ASH, 6.2e-3, density=568), STEEL, BEAD_BEAD, BEAD_WALL
        )
        sys.stdout.write(
            f"pile of 1000: {time.perf_counter() - began:.1f} s wall, {heap.time:.2f} s simulated, "
            f"{len(heap.centres)} beads stay\n"
        )


if __name__ == "__main__":
    main()
