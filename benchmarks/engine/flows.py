"""Heavier loads for the benchmark of the engine: a hopper that runs out and turns, clumps, a million beads."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.engine import liggghts
from rigtwin.benchmarks.figures import Row, small
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.engine.bulk.bulk import SKIN, Bulk
from rigtwin.sim.engine.time_step import time_step
from rigtwin.sim.engine.walls.mesh import Mesh
from rigtwin.sim.engine.walls.shapes import Disc, Motion, Plane, Wall

Array = npt.NDArray[np.float64]

ASH = Material("ash", 720, 11e6, 0.44)
D6 = Particle("D6", ASH, 6e-3, density=569)
BEAD_BEAD, BEAD_WALL = Contact(0.75, 0.44, 0.08), Contact(0.42, 0.36, 0.06)
STEP = time_step([D6])[0]

SECTORS, BIN, OUTLET, CONE, HEIGHT = 72, 0.05, 0.025, 0.1, 0.6  # of the hopper; radii and heights [m]
RPM = 10.0  # it turns about its axis
FILLING, RUNNING = small(0.45, 0.05), small(0.1, 0.02)  # [s] until the bed rests, and from the opening to the timing
FALLING = small(0.25, 0.01)  # [s], of clumps before the timing


# ---------------------------------------------------------------------- hopper


def hopper_corners() -> Array:
    """Triangles of the hopper, shape (n, 3, 3)."""
    return funnel_corners(OUTLET, BIN, CONE, HEIGHT)


def funnel_corners(outlet: float, wide: float, cone: float, top: float) -> Array:
    """Triangles of a cylinder above a cone, shape (n, 3, 3), radii and heights [m], the outlet at z = 0."""
    angle = np.linspace(0, 2 * math.pi, SECTORS + 1)
    rings = [
        np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, z)], axis=1)
        for radius, z in ((outlet, 0.0), (wide, cone), (wide, top))
    ]
    corners = []
    for low, high in itertools.pairwise(rings):
        for k in range(SECTORS):
            corners += [[low[k], low[k + 1], high[k + 1]], [low[k], high[k + 1], high[k]]]
    return np.array(corners)


def hopper(position: Array, velocity: Array, *, lid: bool) -> Bulk:
    """Beads in the turning hopper, open below or not."""
    walls = [Wall(Mesh(hopper_corners()), ASH, BEAD_WALL, Motion.turning(RPM, axis=(0, 0, 1)))]
    if lid:
        walls.append(Wall(Disc((0, 0, 0), (0, 0, 1), OUTLET), ASH, BEAD_WALL))
    reach = BIN + D6.radius
    bulk = Bulk(
        [D6], BEAD_BEAD, walls, low=(-reach, -reach, -0.1), high=(reach, reach, HEIGHT + 0.02), time_step=STEP,
        capacity=len(position), open_domain=True,
    )  # fmt: skip
    bulk.add(position, velocity, overlap=0.2)
    return bulk


def filled(beads: int, seed: int) -> Array:
    """Places on a shaken lattice inside the hopper, from the bottom up."""
    pitch = 1.03 * D6.diameter
    across = np.arange(-BIN, BIN, pitch)
    levels = np.arange(0.6 * D6.diameter, HEIGHT, pitch)
    z, y, x = np.meshgrid(levels, across, across, indexing="ij")
    places = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    places += np.random.default_rng(seed).uniform(-0.01, 0.01, places.shape) * D6.diameter
    slope = (BIN - OUTLET) / CONE
    room = np.minimum(BIN, OUTLET + slope * places[:, 2]) - 1.05 * D6.radius * math.hypot(1, slope)
    return places[np.hypot(places[:, 0], places[:, 1]) < room][:beads]


def running_hopper(beads: int, seed: int) -> tuple[Array, Array]:
    """Positions and velocities of beads that flow out."""
    places = filled(beads, seed)
    closed = hopper(places, np.zeros_like(places), lid=True)
    closed.run(round(FILLING / STEP))
    rest = closed.beads()
    flowing = hopper(rest.position, rest.velocity, lid=False)
    flowing.run(round(RUNNING / STEP))
    now = flowing.beads()
    inside = now.position[:, 2] > -0.05  # those far below would leave both domains during the timing
    return now.position[inside], now.velocity[inside]


def hopper_rows(beads: int, threads: int, pairs: int, seconds: float, seed: int, wanted: float) -> list[Row]:
    """Ours beside LIGGGHTS, by turns, each from the same state of flow."""
    position, velocity = running_hopper(beads, seed)
    steps = max(small(40, 10), int(2e6 * seconds / len(position)))
    state = liggghts.Hopper(
        particle=D6, between=BEAD_BEAD, walls=BEAD_WALL, time_step=STEP, skin=SKIN * D6.diameter, gravity=GRAVITY,
        position=position, velocity=velocity, corners=hopper_corners(), period=60 / RPM, reach=(BIN, -0.1, HEIGHT),
    )  # fmt: skip
    ours, theirs = [], []
    for _ in range(pairs):
        bulk = hopper(position, velocity, lid=False)
        timed(bulk, threads, 100)
        ours.append(timed(bulk, threads, steps))
        if liggghts.installed(threads):
            found, share = liggghts.speed(state, "type C", threads=threads, steps=steps, warm_up=100)
            theirs.append(found / share if threads == 1 else found)
    name = f"hopper, {len(position)} beads, moving mesh of {len(hopper_corners())} triangles, {threads} thread"
    return liggghts.beside(name, ours, theirs, wanted)


# ---------------------------------------------------------------------- clumps


def clump_rows(clumps: int, steps: int, seed: int) -> list[Row]:
    """Clumps of 24 spheres that fall into a heap in a box, and LIGGGHTS' multisphere on a heap of its own.

    It takes no clumps from elsewhere: it throws as many into a box of the same base, and both are timed after the same
    time.  The heaps are alike, not the same, so the ratio is no figure that is wanted.
    """
    cube = replace(hlosta2020.particle("C6_24s"), material=ASH)
    side, pitch = 0.08, 1.01 * cube.diameter
    across = int(side / pitch)
    k = np.arange(clumps)
    places = (np.stack([k % across, k // across % across, k // across**2], axis=1) + 0.5) * pitch
    top = float(places[:, 2].max()) + 2 * pitch
    planes = [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((side, 0, 0), (-1, 0, 0))]
    planes += [((0, 0, 0), (0, 1, 0)), ((0, side, 0), (0, -1, 0))]
    bulk = Bulk(
        [cube], BEAD_BEAD, [Wall(Plane(at, normal), ASH, BEAD_WALL) for at, normal in planes],
        low=(-0.01,) * 3, high=(side + 0.01, side + 0.01, top), time_step=time_step([cube])[0],
        capacity=24 * clumps, threads=1,
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    bulk.add(places, velocity=np.array([[0, 0, -0.3]]), turn=rng.normal(size=(clumps, 4)))
    fall = round(FALLING / bulk.time_step)
    bulk.run(fall)
    rates = [timed(bulk, 1, steps) for _ in range(5)]
    name = f"{clumps} clumps of 24 spheres, 1 thread"
    note = f"{min(rates) / 1e6:.2f} to {max(rates) / 1e6:.2f}; {2 * bulk.contacts / clumps:.1f} contacts per clump"
    rate = float(np.median(rates)) / 1e6
    rows = [
        Row(f"{name}: spheres", rate, "M sphere-steps/s", note=note),
        Row(f"{name}: clumps", rate / 24, "M clump-steps/s"),
    ]
    if liggghts.installed(1):
        # thrown in as the spheres about them, a quarter of the room
        room = clumps * 4 * math.pi / 6 * cube.diameter**3 / side**2
        high = cube.diameter + max(room, 2 * cube.diameter)
        theirs = liggghts.Clumps(
            particle=cube, between=BEAD_BEAD, walls=BEAD_WALL, time_step=bulk.time_step,
            skin=SKIN * cube.equivalent_diameter, gravity=GRAVITY, count=clumps, size=(side, side, high),
        )  # fmt: skip
        found, share = liggghts.speed(theirs, "type C", threads=1, steps=5 * steps, warm_up=fall)
        found *= 1e-6 / share
        rows += [
            Row(f"{name}: LIGGGHTS multisphere", found, "M sphere-steps/s", note="a heap of its own"),
            Row(f"{name}: ratio", rate / found, "1"),
        ]
    return rows


# ---------------------------------------------------------------------- memory

MANY = """
from rigtwin.benchmarks.engine import flows
flows.many_beads({beads})
"""


def many_beads(beads: int, steps: int = 3) -> None:
    """Beads a thousandth of a diameter into each other, so that all neighbours touch; prints this process' memory."""
    before, _ = memory()
    side = math.ceil(beads ** (1 / 3))
    pitch = 0.9999 * D6.diameter
    k = np.arange(beads)
    places = (np.stack([k % side, k // side % side, k // side**2], axis=1) + 1.0) * pitch
    high = (side + 1.5) * pitch
    bulk = Bulk([D6], BEAD_BEAD, low=(0, 0, 0), high=(high,) * 3, time_step=STEP, capacity=beads, threads=1)
    bulk.add(places, overlap=0.01)
    del k, places
    bulk.run(steps)
    now, most = memory()
    sys.stdout.write(f"{before} {most} {now} {2 * bulk.contacts / beads:.2f}\n")


def memory() -> tuple[int, int]:
    """What this process holds now and held at most [kB]; `getrusage` would count what its parent held as its own."""
    lines = (line.split() for line in Path("/proc/self/status").read_text().splitlines())
    held = {words[0]: int(words[1]) for words in lines if words[0] in ("VmRSS:", "VmHWM:")}
    return held["VmRSS:"], held["VmHWM:"]


def memory_rows(beads: int) -> list[Row]:
    """Memory per sphere, of the process as it runs and at its highest."""
    script = MANY.format(beads=beads)
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    before, most, now, touching = map(float, done.stdout.split())
    note = f"{touching:.1f} contacts per bead; the process before: {before / 1e3:.0f} MB"
    held, peak = (now - before) * 1024 / beads, (most - before) * 1024 / beads
    return [
        Row(f"memory per sphere at {beads}", held, "B", None, "below 1000", held < 1000, note),
        Row(f"memory per sphere at {beads}: highest", peak, "B", note="while beads are added and checked"),
    ]


def timed(bulk: Bulk, threads: int, steps: int) -> float:
    """Particle-steps per second; on one thread of computing time, which other work on the machine leaves alone."""
    bulk.threads = threads
    clock = time.process_time if threads == 1 else time.perf_counter
    beads = len(bulk.beads().ident)
    began = clock()
    bulk.run(steps)
    return steps * beads / (clock() - began)
