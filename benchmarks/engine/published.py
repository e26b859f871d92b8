"""The silo and the penetration test of the open-source benchmark, beside LIGGGHTS on the same packing.

Materials, restitution and friction are those of Dosta et al. (2024, Computer Physics Communications 296, 109066),
cases 1 and 3; the meshes and packings of that benchmark are replaced by our own, smaller ones.  Both codes start from
the same places at rest, and without LIGGGHTS ours stands alone.  Grains that flow are chaotic: the codes part after
some collisions, and what is compared is what many grains do together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.engine import liggghts
from rigtwin.benchmarks.engine.flows import funnel_corners
from rigtwin.benchmarks.figures import Row, against, small
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.time_step import time_step
from rigtwin.sim.engine.walls.mesh import Mesh
from rigtwin.sim.engine.walls.shapes import Disc, Plane, Wall
from rigtwin.sim.run.filling import beverloo

Array = npt.NDArray[np.float64]

M1, M2 = Material("M1", 2500, 1e9, 0.2), Material("M2", 2000, 0.5e9, 0.2)
STEEL = Material("steel", 7200, 210e9, 0.2)
AMONG = {"M1": Contact(0.5, 0.3, 0.0), "M2": Contact(0.4, 0.4, 0.0)}
ON_STEEL = Contact(0.4, 0.2, 0.0)
RADIUS = 2e-3  # [m]

WIDE, CONE, TALL = 0.03, 0.0593, 0.4  # [m], of the silo: radius, height of the cone, and of the cylinder's end
SILOS = ((M1, 0.011, small(1200, 60)), (M2, 0.014, small(1200, 60)))  # radius of the orifice [m], grains
SILO_LOOK = 0.01  # [s]
BOX, GRAINS, BALL = 0.06, small(4000, 300), 0.008  # side of the box [m], grains in it, radius of the ball [m]
HIT, DEEP, DEEP_LOOK = 5.0, small(0.03, 0.005), 5e-4  # [m/s], and for how long and how often it is watched [s]
FILLING_SILO, FILLING_BOX = small(0.3, 0.1), small(0.25, 0.05)  # [s]
SKIN = 0.4e-3  # [m], of both codes' lists


def silo() -> list[Row]:
    """Grains that stay over time while the silo empties."""
    rows = []
    for material, orifice, count in SILOS:
        grain = Particle(material.name, material, 2 * RADIUS)
        step = time_step([grain])[0]
        filling = _silo(grain, orifice, step, lid=True)
        filling.add(_funnel_places(count, orifice))
        filling.run(round(FILLING_SILO / step))
        start = filling.beads().position
        looks = math.ceil(2.5 * _emptying(grain, orifice, len(start)) / SILO_LOOK)
        every = round(SILO_LOOK / step)
        open_ = _silo(grain, orifice, step, lid=False)
        open_.add(start, overlap=0.01)
        ours = [len(start)]
        for _ in range(looks):
            open_.run(every)
            ours.append(int((open_.beads().position[:, 2] > 0).sum()))
        name = f"silo, {len(start)} grains of {material.name}, orifice {2e3 * orifice:.0f} mm"
        theirs = None
        if liggghts.installed(1):
            scene = liggghts.Scene(
                kinds=(grain, Particle("steel", STEEL, 2 * RADIUS)),
                contacts={(0, 0): AMONG[material.name], (0, 1): ON_STEEL, (1, 1): ON_STEEL},
                kind=np.zeros(len(start), dtype=int),
                position=start,
                velocity=np.zeros_like(start),
                walls=liggghts.mesh_wall(),
                files={"walls.stl": liggghts.stl(_silo_corners(orifice))},
                low=(-1.2 * WIDE, -1.2 * WIDE, -0.05),
                high=(1.2 * WIDE, 1.2 * WIDE, TALL),
                time_step=step,
                skin=SKIN,
            )
            seen = liggghts.positions(scene, steps=every * looks, every=every)
            theirs = [int((frame[:, 3] > 0).sum()) for frame in seen]
        rows += _emptied(name, np.array(ours), None if theirs is None else np.array(theirs))
    return rows


def penetration() -> list[Row]:
    """Height of a steel ball that hits a bed of grains."""
    grain = Particle("M1", M1, 2 * RADIUS)
    ball = Particle("ball", STEEL, 2 * BALL)
    step = time_step([grain])[0]
    filling = _box([grain], step)
    filling.add(_box_places(GRAINS), np.array([0.0, 0.0, -0.2]))
    filling.run(round(FILLING_BOX / step))
    bed = filling.beads().position
    top = float(bed[:, 2].max()) + RADIUS
    centre = np.array([[BOX / 2, BOX / 2, top + BALL + 1e-4]])
    fine = step / 4  # steel on the grains is stiffer than they are among themselves
    every, looks = round(DEEP_LOOK / fine), round(DEEP / DEEP_LOOK)
    hit = _box([grain, ball], fine)
    hit.add(bed, overlap=0.01)
    hit.add(centre, np.array([0.0, 0.0, -HIT]), kind=1)
    ours = [float(centre[0, 2])]
    for _ in range(looks):
        hit.run(every)
        beads = hit.beads()
        ours.append(float(beads.position[beads.kind == 1, 2][0]))
    name = f"penetration, {len(bed)} grains, ball of {2e3 * BALL:.0f} mm at {HIT:g} m/s"
    theirs = None
    if liggghts.installed(1):
        planes = {"x0": ("xplane", 0.0), "x1": ("xplane", BOX), "y0": ("yplane", 0.0), "y1": ("yplane", BOX)}
        scene = liggghts.Scene(
            kinds=(grain, ball),
            contacts={(0, 0): AMONG["M1"], (0, 1): ON_STEEL, (1, 1): ON_STEEL},
            kind=np.r_[np.zeros(len(bed), dtype=int), 1],
            position=np.vstack([bed, centre]),
            velocity=np.vstack([np.zeros_like(bed), [[0.0, 0.0, -HIT]]]),
            walls=liggghts.plane_walls({**planes, "z0": ("zplane", 0.0)}),
            files={},
            low=(-RADIUS, -RADIUS, -RADIUS),
            high=(BOX + RADIUS, BOX + RADIUS, TALL),
            time_step=fine,
            skin=SKIN,
        )
        seen = liggghts.positions(scene, steps=every * looks, every=every)
        theirs = [float(frame[frame[:, 0] == len(bed) + 1, 3][0]) for frame in seen]
    return _sunk(name, np.array(ours), None if theirs is None else np.array(theirs), top + BALL)


# ---------------------------------------------------------------------- what both give


def _emptied(name: str, ours: Array, theirs: Array | None) -> list[Row]:
    times = [_time_left(ours, part) for part in (0.5, 0.1)]
    if theirs is None:
        return [Row(f"{name}: half empty after", times[0], "s"), Row(f"{name}: a tenth left after", times[1], "s")]
    other = [_time_left(theirs, part) for part in (0.5, 0.1)]
    apart = float(np.abs(ours - theirs).max() / ours[0])
    return [
        against(f"{name}: half empty after", times[0], other[0], relative=0.05, unit="s", note="reference: LIGGGHTS"),
        against(f"{name}: a tenth left after", times[1], other[1], relative=0.05, unit="s", note="reference: LIGGGHTS"),
        Row(f"{name}: curves apart at most", 100 * apart, "%", None, "at most 5", bool(apart <= 0.05)),
    ]


def _time_left(retained: Array, part: float) -> float:
    """[s], when only this part of the grains was left."""
    below = np.flatnonzero(retained <= part * retained[0])
    if not len(below):
        return math.nan
    k = int(below[0])
    return SILO_LOOK * (k - (part * retained[0] - retained[k]) / max(retained[k - 1] - retained[k], 1))


def _sunk(name: str, ours: Array, theirs: Array | None, touching: float) -> list[Row]:
    deepest = 1e3 * (touching - ours.min())
    if theirs is None:
        return [Row(f"{name}: deepest", deepest, "mm")]
    apart = 1e3 * float(np.abs(ours - theirs).max())
    reference = 1e3 * (touching - theirs.min())
    limit = 0.05 * reference
    return [
        against(f"{name}: deepest", deepest, reference, relative=0.05, unit="mm", note="reference: LIGGGHTS"),
        Row(f"{name}: paths apart at most", apart, "mm", None, f"at most {limit:.2g}", bool(apart <= limit)),
    ]


# ---------------------------------------------------------------------- the scenes


def _silo_corners(orifice: float) -> Array:
    return funnel_corners(orifice, WIDE, CONE, TALL)


def _silo(grain: Particle, orifice: float, step: float, *, lid: bool) -> Bulk:
    walls = [Wall(Mesh(_silo_corners(orifice)), STEEL, ON_STEEL)]
    if lid:
        walls.append(Wall(Disc((0, 0, 0), (0, 0, 1), orifice), STEEL, ON_STEEL))
    reach = 1.2 * WIDE
    return Bulk(
        [grain], AMONG[grain.name], walls, low=(-reach, -reach, -0.05), high=(reach, reach, TALL), time_step=step,
        open_domain=True, skin=SKIN / grain.diameter, threads=1,
    )  # fmt: skip


def _box(kinds: Sequence[Particle], step: float) -> Bulk:
    planes = [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((BOX, 0, 0), (-1, 0, 0))]
    planes += [((0, 0, 0), (0, 1, 0)), ((0, BOX, 0), (0, -1, 0))]
    walls = [Wall(Plane(at, normal), STEEL, ON_STEEL) for at, normal in planes]
    contacts = {(0, 0): AMONG["M1"], (0, 1): ON_STEEL, (1, 1): ON_STEEL}
    contacts = {pair: contact for pair, contact in contacts.items() if pair[1] < len(kinds)}
    return Bulk(
        list(kinds), contacts, walls, low=(-RADIUS,) * 3, high=(BOX + RADIUS, BOX + RADIUS, TALL), time_step=step,
        skin=SKIN / max(kind.diameter for kind in kinds), threads=1,
    )  # fmt: skip


def _funnel_places(count: int, orifice: float) -> Array:
    places = _lattice(2 * WIDE, TALL, count)
    places[:, :2] -= WIDE
    slope = (WIDE - orifice) / CONE
    room = np.minimum(WIDE, orifice + slope * places[:, 2]) - 1.05 * RADIUS * math.hypot(1, slope)
    return places[np.hypot(places[:, 0], places[:, 1]) < room][:count]


def _box_places(count: int) -> Array:
    return _lattice(BOX, TALL, count)[:count]


def _lattice(side: float, height: float, count: int) -> Array:
    """Shaken places over a square, from the bottom up, more than `count`."""
    pitch = 2.06 * RADIUS
    across = np.arange(1.03 * RADIUS, side - RADIUS, pitch)
    levels = np.arange(1.1 * RADIUS, height - RADIUS, pitch)[: 8 * math.ceil(count / len(across) ** 2) + 8]
    z, y, x = np.meshgrid(levels, across, across, indexing="ij")
    places = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    return places + np.random.default_rng(1).uniform(-0.02, 0.02, places.shape) * RADIUS


def _emptying(grain: Particle, orifice: float, count: int) -> float:
    """[s], by Beverloo's law."""
    return count / beverloo(grain, 2 * orifice, grain.diameter)
