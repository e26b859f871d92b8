"""Speed of the bulk engine: particle-steps per second of a settled bed of D6 beads, beside LIGGGHTS where it is there.

    python benchmarks/engine/speed.py [--beads 4000 15000 100000] [--threads 1 2] [--pairs 5] [--quick] [--pile]
                                [--hopper 15000] [--clumps 500] [--drops 300] [--memory 1000000]

d 6 mm, density 569 kg/m^3, E 11 MPa, Hertz-Mindlin with history, rolling resistance type A and type C, five plane
walls, 30 % of Rayleigh's step, skin a tenth of a diameter.  The machine's own speed moves by a factor of two within
minutes: only the ratio of two runs made one after the other means anything, so ours and LIGGGHTS alternate and the
median of their ratios is the figure.  One core is timed by the computing time of either process, two by the clock,
which needs a machine without other work.  `SEED` in the environment shuffles the bed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.engine import liggghts
from rigtwin.benchmarks.engine.few_body_speed import drop_rows, many_rows
from rigtwin.benchmarks.engine.flows import clump_rows, hopper_rows, memory_rows, timed
from rigtwin.benchmarks.figures import SMOKE, Row, machine, report, small
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rigs import GRAVITY, Pile
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.bulk.bulk import SKIN, Bulk
from rigtwin.sim.engine.contact import ROLLING, Rolling
from rigtwin.sim.engine.time_step import time_step
from rigtwin.sim.engine.walls.shapes import Plane, Wall
from rigtwin.sim.pile import pile

ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
SOFT = ASH.softened(1e-3)
D6 = Particle("D6", SOFT, 6e-3, density=569)
BEAD_BEAD, BEAD_WALL = Contact(0.75, 0.44, 0.08), Contact(0.42, 0.36, 0.06)
STEP = time_step([D6])[0]
ACROSS = 15 * D6.diameter  # of one block; larger beds are blocks side by side, each the mirror of its neighbour
BLOCK = small(4000, 80)  # beads
BEADS_OF_PILE = small(1000, 30)
WANTED = 2.0  # times LIGGGHTS
ALONE = 0.9  # part of the time that LIGGGHTS must have had its cores

Array = npt.NDArray[np.float64]


def bulk(size: tuple[float, float, float], beads: int, rolling: Rolling = "type C") -> Bulk:
    """An empty box, open at the top."""
    x, y, z = size
    planes = [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((x, 0, 0), (-1, 0, 0))]
    planes += [((0, 0, 0), (0, 1, 0)), ((0, y, 0), (0, -1, 0))]
    r = D6.radius
    return Bulk(
        [D6],
        BEAD_BEAD,
        [Wall(Plane(point, normal), SOFT, BEAD_WALL) for point, normal in planes],
        low=(-r, -r, -r),
        high=(x + r, y + r, z),
        time_step=STEP,
        capacity=beads,
        rolling=rolling,
    )


def settled_block(beads: int, seed: int) -> Array:
    """Positions of beads that were thrown about in a box and came to rest."""
    pitch = 1.02 * D6.diameter
    side = int(ACROSS / pitch)
    k = np.arange(beads)
    centres = np.stack([k % side, k // side % side, k // side**2], axis=1) * pitch + 0.51 * D6.diameter
    rng = np.random.default_rng(seed)
    centres += rng.uniform(-0.01, 0.01, centres.shape) * D6.radius
    bed = bulk((ACROSS, ACROSS, centres[:, 2].max() + ACROSS), beads)
    bed.add(centres, rng.normal(0, 0.4, centres.shape))
    return _at_rest(bed)


def settled_bed(beads: int, seed: int) -> tuple[Array, tuple[float, float, float]]:
    """Positions in a settled bed of about `beads` beads, and the size of its box."""
    tiles = max(1, round((beads / BLOCK) ** 0.5))
    block = settled_block(round(beads / tiles**2), seed)
    if tiles == 1:
        return block, (ACROSS, ACROSS, float(block[:, 2].max()) + ACROSS)
    parts = []
    for i in range(tiles):
        for j in range(tiles):
            part = block.copy()
            part[:, 0] = i * ACROSS + (ACROSS - part[:, 0] if i % 2 else part[:, 0])
            part[:, 1] = j * ACROSS + (ACROSS - part[:, 1] if j % 2 else part[:, 1])
            parts.append(part)
    centres = np.concatenate(parts)
    # beads were named by where they first stood; a bed of its own has no such order
    centres = np.random.default_rng(seed).permutation(centres)
    size = (tiles * ACROSS, tiles * ACROSS, float(block[:, 2].max()) + ACROSS)
    bed = bulk(size, len(centres))
    bed.add(centres, overlap=0.2)
    return _at_rest(bed, looks=4), size


def _at_rest(bed: Bulk, looks: int = 40) -> Array:
    for _ in range(looks):
        bed.run(1000)
        beads = bed.beads()
        if beads.kinetic_energy < 1e-6 * beads.mass.sum() * GRAVITY * D6.radius:
            break
    return bed.beads().position


def compare(beads: int, options: argparse.Namespace) -> list[Row]:
    """Rows of one bed: ours, LIGGGHTS, and the ratio, for each rolling model and number of threads."""
    began = time.perf_counter()
    position, size = settled_bed(beads, options.seed)
    beads = len(position)
    sys.stderr.write(f"{beads} beads settled in {time.perf_counter() - began:.0f} s\n")
    peer = liggghts.Bed(
        particle=D6, between=BEAD_BEAD, walls=BEAD_WALL, time_step=STEP, skin=SKIN * D6.diameter, gravity=GRAVITY,
        position=position, size=size,
    )  # fmt: skip
    pairs = options.pairs if beads <= 2 * BLOCK else max(1, options.pairs_large)
    steps = max(small(40, 10), int(3e6 * options.seconds / beads))
    rows: list[Row] = []
    for rolling in options.rolling:
        bed = bulk(size, beads, rolling)
        bed.add(position, overlap=0.2)
        for threads in options.threads:  # both sides start with contacts made and code compiled
            timed(bed, threads, 100)
        rows.append(Row(f"{beads} beads, {rolling}: contacts per bead", 2 * bed.contacts / beads))
        for threads in options.threads:
            ours, theirs, shares = [], [], []
            for _ in range(pairs):
                ours.append(timed(bed, threads, steps))
                if liggghts.installed(threads):
                    found, share = liggghts.speed(peer, rolling, threads=threads, steps=steps, warm_up=100)
                    theirs.append(found / share if threads == 1 else found)
                    shares.append(1.0 if threads == 1 else share)
            name = f"{beads} beads, {rolling}, {threads} thread{'s' if threads > 1 else ''}"
            rows += _rows(name, ours, theirs, shares)
            sys.stderr.write(f"{rows[-1].name} {rows[-1].value:.3g}  ({rows[-1].note})\n")
    return rows


def _rows(name: str, ours: list[float], theirs: list[float], shares: list[float]) -> list[Row]:
    """Speeds and their ratio; the ratio counts only where LIGGGHTS had its cores to itself in every pair."""
    alone = min(shares, default=1.0) >= ALONE
    more = "" if alone else f"; LIGGGHTS got only {min(shares):.0%} of its cores: the machine is too busy to tell"
    return liggghts.beside(name, ours, theirs, WANTED, alone, more)


FIRST_STEP = """
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.sim.engine.bulk.bulk import Bulk
bead = Particle("D6", Material("ash", 720, 11e6, 0.44), 6e-3)
bed = Bulk([bead], Contact(0.5), low=(0, 0, 0), high=(0.1, 0.1, 0.1), time_step=1e-5)
bed.add([[0.05, 0.05, 0.05]])
bed.run(1)
"""


def start_rows() -> list[Row]:
    """From the command to the first step of the bulk engine, kernels compiled and kernels cached.

    What they are made of, and why they miss what is wanted: docs/decisions/0009.
    """
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"TI_OFFLINE_CACHE_FILE_PATH": cache}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # else Python compiles the sources at every start
        for name, wanted in (("first start", 5.0), ("later start", 1.5)):
            began = time.perf_counter()
            subprocess.run([sys.executable, "-c", FIRST_STEP], check=True, env=environment)
            took = time.perf_counter() - began
            note = f"load average {machine()['load_average']}"
            rows.append(
                Row(f"{name}: command to first step", took, "s", None, f"below {wanted:g}", took < wanted, note)
            )
    return rows


def pile_rows() -> list[Row]:
    """How long the twin of a pile takes."""
    began = time.perf_counter()
    bead = Particle("D6", ASH, 6.2e-3, density=568)
    rig = Pile(small(0.09, 0.025), rim_height=0.01)
    heap = pile.run(rig, bead, STEEL, BEAD_BEAD, BEAD_WALL, count=BEADS_OF_PILE)
    note = f"{heap.time:.2f} s simulated, {len(heap.centres)} beads stay"
    return [Row(f"pile of {BEADS_OF_PILE} beads", time.perf_counter() - began, "s", note=note)]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beads", type=int, nargs="+", default=small([4000, 15_000, 100_000], [60, 320]))
    parser.add_argument("--threads", type=int, nargs="+", default=sorted({1, min(2, backend.available_threads())}))
    parser.add_argument("--rolling", nargs="+", choices=ROLLING, default=list(ROLLING))
    parser.add_argument("--pairs", type=int, default=small(5, 1), help="alternating pairs up to 8,000 beads")
    parser.add_argument("--pairs-large", type=int, default=small(5, 1), help="and above")
    parser.add_argument("--seconds", type=float, default=small(1.0, 0.001), help="rough length of one timing")
    parser.add_argument("--quick", action="store_true", help="three pairs, two for the large beds")
    parser.add_argument("--hopper", type=int, default=small(15_000, 200), help="beads in the running hopper; 0: none")
    parser.add_argument("--clumps", type=int, default=small(500, 12), help="clumps of 24 spheres; 0: none")
    parser.add_argument("--drops", type=int, default=small(300, 12), help="drops in one launch; 0: none")
    parser.add_argument(
        "--memory", type=int, default=small(1_000_000, 1000), help="beads whose memory is reported; 0: none"
    )
    parser.add_argument("--pile", action="store_true", default=SMOKE, help="also time the twin of a pile of 1000 beads")
    parser.add_argument("--seed", type=int, default=int(os.environ.get("SEED", "1")))
    options = parser.parse_args(arguments)
    if options.quick:
        options.pairs, options.pairs_large = 3, 2
    before = machine()["load_average"]
    rows = [row for beads in options.beads for row in compare(beads, options)]
    for threads in options.threads if options.hopper else ():
        rows += hopper_rows(options.hopper, threads, options.pairs_large, options.seconds, options.seed, WANTED)
    if options.clumps:
        rows += clump_rows(options.clumps, 200, options.seed)
    if options.memory:
        rows += memory_rows(options.memory)
    rows += start_rows() + drop_rows()
    if options.drops:
        rows += many_rows(options.drops, max(1, options.drops // 6), options.threads, options.seed)
    if options.pile:
        rows += pile_rows()
    present = liggghts.installed(1)
    compared = f"LIGGGHTS {liggghts.version()}" if present else "nothing: liggghts is not installed"
    return report("bench", rows, seed=options.seed, compared_with=compared, load_average_before=before)


if __name__ == "__main__":
    sys.exit(main())
