"""The twin of the piling test: beads rain on a round base and heap up (Hlosta et al. 2020, fig. 5a)."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Profile
from rigtwin.lab.rigs import GRAVITY, Pile
from rigtwin.sim import fill
from rigtwin.sim.engine.clock import USUAL, positive, time_step
from rigtwin.sim.logbook import History, Logbook

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk import Bulk
    from rigtwin.sim.engine.contact import Rolling
    from rigtwin.sim.engine.walls import Shape

Array = npt.NDArray[np.float64]

VIEWS = (0.0, 45.0, 90.0, 135.0)  # [deg], about the disc's axis
POINTS_PER_DIAMETER = 24
PROFILE_SIGMA = 1e-5  # [m], a silhouette of exact spheres is as good as the beads' overlap
SLOW = 0.1  # [m/s], a bead below this speed belongs to the heap, above it is still falling
LEAST_RATE = 400.0  # [1/s]
SKIN = 0.2  # of a diameter; the rain makes a list short-lived
FRAME_INTERVAL = 0.01  # [s]
CHECKPOINT_INTERVAL = 60.0  # [s] of computing; what a power cut may cost
OVERLAP_LIMIT = 0.05  # of a radius; softer contacts than this bend the result


@dataclass(frozen=True)
class Heap:
    """What lies on the base in the end.  x and y from the disc's axis, z above the disc's top face."""

    centres: Array  # [m], shape (n, 3), of the spheres that stay on the base
    radii: Array  # [m], shape (n,)
    radius: float  # [m], of a particle; of a clump that of the sphere that holds it
    profiles: tuple[Profile, ...]  # silhouettes from four sides
    at_rest: bool
    time: float  # [s], simulated
    asked: int
    placed: int
    fallen: int
    statistics: dict[str, float] = field(default_factory=dict)
    history: History | None = None  # energy, contacts and overlaps over time
    assumptions: dict[str, str] = field(default_factory=dict)  # all that the rig's description leaves open
    warnings: tuple[str, ...] = ()


def run(
    rig: Pile,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int = 1000,
    seed: int = 1,
    stiffness_factor: float = 1e-3,
    threads: int | None = None,
    time_step_fraction: float = USUAL,
    pour_rate: float | None = None,
    fall_height: float | None = None,
    settle_limit: float = 4.0,
    rolling: Rolling = "type C",
    trajectory: Path | None = None,
    trajectory_interval: float = FRAME_INTERVAL,
    checkpoint: Path | None = None,
    checkpoint_interval: float = CHECKPOINT_INTERVAL,
    progress: Progress = silent,
) -> Heap:
    """Pour `count` beads on the base and wait until the heap rests.

    The beads rain through a round outlet above the base's centre, without overlap, at `pour_rate` [1/s] (default:
    Beverloo's discharge of the outlet, at least 400 per second).  The outlet rises with the heap and stays
    `fall_height` [m] above its top (default: three bead diameters).  What leaves the base falls and is taken out.
    The run ends when the beads rest, or `settle_limit` [s] after the last one was poured, and says which.
    Young's moduli are multiplied by `stiffness_factor` (Hlosta et al. 2020, section 2.2.3).

    `trajectory` (.gsd or .vtkhdf) takes a frame every `trajectory_interval` [s] simulated, the walls stand beside it
    in `<stem>-walls.vtk`.  `checkpoint` keeps the run every `checkpoint_interval` [s] of computing; a run whose file
    is there goes on from it and ends with the same bits as one that never stopped.
    """
    _check(rig, particle, count, stiffness_factor, settle_limit)
    soft = replace(particle, material=particle.material.softened(stiffness_factor))
    step, warnings = time_step([soft], time_step_fraction)
    outlet = _outlet(rig, particle, count, pour_rate, fall_height)
    base = wall.softened(stiffness_factor)
    bulk = _bench(rig, soft, base, (contact, wall_contact), outlet, step=step, rolling=rolling, threads=threads)

    settings = {
        **{name: asdict(thing) for name, thing in (("rig", rig), ("particle", particle), ("wall", wall))},
        **{"contact": asdict(contact), "wall_contact": asdict(wall_contact), "outlet": asdict(outlet)},
        **{"count": count, "seed": seed, "stiffness_factor": stiffness_factor, "rolling": rolling},
        **{"time_step_fraction": time_step_fraction, "settle_limit": settle_limit},
    }
    course = _Course(np.random.default_rng(seed), height=outlet.fall_height)
    logbook = Logbook(
        bulk,
        settings,
        trajectory=trajectory,
        trajectory_interval=trajectory_interval,
        checkpoint=checkpoint,
        checkpoint_interval=checkpoint_interval,
    )
    with logbook:
        if kept := logbook.resume():
            course.go_on(kept)
        began, first_step = time.perf_counter(), bulk.steps
        _pour(bulk, logbook, course, outlet, particle, count, progress)
        at_rest = fill.settle(bulk, logbook, course, particle, settle_limit, progress)
        wall_time = time.perf_counter() - began
    placed = course.placed

    beads, grains = bulk.beads(), bulk.grains()
    stays = (np.hypot(*grains.position[:, :2].T) < rig.base_diameter / 2 + particle.radius) & (
        grains.position[:, 2] > 0
    )
    staying = int(stays.sum())
    spheres = np.isin(beads.ident if beads.grain is None else beads.grain, grains.ident[stays])
    centres, radii = beads.position[spheres], beads.radius[spheres]
    statistics = {
        "largest_overlap": bulk.largest_overlap,
        **logbook.statistics(),
        "contacts_per_bead": 2 * bulk.contacts / max(len(grains.ident), 1),
        "time_step_s": step,
        "steps": float(bulk.steps),
        "lists_built": float(bulk.lists_built),
    }
    if bulk.steps > first_step:
        statistics["steps_per_second"] = (bulk.steps - first_step) / max(wall_time, 1e-9)
    return Heap(
        centres=centres,
        radii=radii,
        radius=particle.radius,
        profiles=tuple(silhouette(centres, radii, rig.base_diameter, view) for view in VIEWS),
        at_rest=at_rest,
        time=bulk.time,
        asked=count,
        placed=placed,
        fallen=placed - staying,
        statistics=statistics,
        history=logbook.history,
        assumptions=_assumptions(rig, outlet, stiffness_factor, time_step_fraction, rolling),
        warnings=warnings
        + logbook.warnings
        + _warnings(
            rig,
            count=count,
            placed=placed,
            staying=staying,
            at_rest=at_rest,
            overlap=bulk.largest_overlap,
        ),
    )


def silhouette(centres: Array, radii: Array | float, base_diameter: float, view: float) -> Profile:
    """Outline of spheres on a disc, seen from the side, orthographic.

    `view` [deg] turns the heap about the disc's axis.  Height is that of the highest bead edge at each x, 0 where
    only the disc is seen; x runs over the disc, 0 on its axis.  A rim is not
    drawn: it would hide beads, not raise them.
    """
    radii = np.broadcast_to(radii, len(centres))
    widest = 2 * float(radii.max()) if len(radii) else base_diameter
    points = math.ceil(base_diameter / widest * POINTS_PER_DIAMETER) + 1
    x = np.linspace(-base_diameter / 2, base_diameter / 2, points)
    angle = math.radians(view)
    across = centres[:, 0] * math.cos(angle) + centres[:, 1] * math.sin(angle)
    height = np.zeros(points)
    for part in np.array_split(np.arange(len(centres)), max(1, len(centres) // 1000)):
        inside = radii[part, None] ** 2 - (x - across[part, None]) ** 2
        # a point that only touches the outline would go in or out by rounding
        edge = np.where(
            inside > 1e-9 * radii[part, None] ** 2, centres[part, 2, None] + np.sqrt(np.maximum(inside, 0.0)), 0.0
        )
        height = np.maximum(height, edge.max(axis=0, initial=0.0))
    return Profile(
        x=x,
        height=height,
        sigma=np.full(points, PROFILE_SIGMA),
        base=(-base_diameter / 2, base_diameter / 2),
        view=f"{view:g} deg",
    )


def picture(rig: Pile, heap: Heap, *, turn: float = 30.0, tilt: float = 20.0) -> npt.NDArray[np.uint8]:
    """The heap on its base as shaded spheres, an RGB image; the eye `turn` [deg] about z and `tilt` [deg] above."""
    from rigtwin.sim.picture import draw
    from rigtwin.sim.trajectory import triangles

    reach = np.full(3, rig.base_diameter + rig.rim_height)
    walls = [triangles(shape, (-reach, reach)) for shape in _shapes(rig)]
    return draw(heap.centres, heap.radii, walls=np.concatenate(walls), turn=turn, tilt=tilt)


@dataclass(frozen=True)
class _Outlet:
    diameter: float  # [m]
    speed: float  # [m/s], of the beads leaving it
    rate: float  # [1/s]
    rate_from: str
    fall_height: float  # [m], above the top of the heap


def _outlet(rig: Pile, particle: Particle, count: int, rate: float | None, fall_height: float | None) -> _Outlet:
    diameter = rig.base_diameter / 4 if rig.outlet_diameter is None else rig.outlet_diameter
    bead = particle.diameter
    if diameter < 2 * bead:
        raise BadInput(
            f"outlet_diameter: {diameter * 1e3:.3g} mm lets no beads of {bead * 1e3:.3g} mm through; "
            "give at least two bead diameters."
        )
    rate_from = "as given"
    if rate is None:
        # Beverloo's law, bulk density 0.6 of the bead's
        flow = 0.58 * 0.6 * particle.effective_density * math.sqrt(GRAVITY) * (diameter - 1.4 * bead) ** 2.5
        rate, rate_from = flow / particle.mass, "Beverloo's discharge of the outlet"
        if rate < LEAST_RATE:
            rate, rate_from = (
                LEAST_RATE,
                f"{LEAST_RATE:g} per second, above Beverloo's {rate:.0f}, to keep the run short",
            )
    height = 3 * bead if fall_height is None else fall_height
    positive(pour_rate=rate, fall_height=height)
    # as fast as a free discharge leaves, and fast enough that the beads keep clear of each other
    thinnest = rate * particle.mass / particle.effective_density / (0.2 * math.pi / 4 * diameter**2)
    return _Outlet(diameter, max(math.sqrt(GRAVITY * diameter / 2), thinnest), rate, rate_from, height)


def _bench(
    rig: Pile,
    soft: Particle,
    wall: Material,
    contacts: tuple[Contact, Contact],
    outlet: _Outlet,
    *,
    step: float,
    rolling: Rolling,
    threads: int | None,
) -> Bulk:
    from rigtwin.sim.engine.bulk import Bulk
    from rigtwin.sim.engine.walls import Wall

    side = rig.base_diameter / 2 + 4 * soft.diameter
    # a heap steeper than 45 degrees is not expected; the outlet stops rising there
    top = rig.rim_height + rig.base_diameter / 2 + outlet.fall_height + 4 * fill.LOOK * outlet.speed + 4 * soft.diameter
    return Bulk(
        [soft],
        contacts[0],
        [Wall(shape, wall, contacts[1]) for shape in _shapes(rig)],
        low=(-side, -side, -2 * soft.diameter),
        high=(side, side, top),
        open_domain=True,
        time_step=step,
        rolling=rolling,
        threads=threads,
        skin=SKIN,
    )


def _shapes(rig: Pile) -> list[Shape]:
    from rigtwin.sim.engine.walls import Cylinder, Disc

    up = (0.0, 0.0, 1.0)
    shapes: list[Shape] = [Disc((0.0, 0.0, 0.0), up, rig.base_diameter / 2)]
    if rig.rim_height > 0:
        shapes.append(Cylinder((0.0, 0.0, 0.0), up, rig.base_diameter / 2, rig.rim_height))
    return shapes


@dataclass
class _Course(fill.Course):
    """How far pouring and settling have come, the outlet that rises with the heap included."""

    height: float = 0.0  # [m], of the outlet


def _pour(
    bulk: Bulk,
    logbook: Logbook,
    course: _Course,
    outlet: _Outlet,
    particle: Particle,
    count: int,
    progress: Progress,
) -> None:
    """Rain the beads."""
    steps = max(1, round(fill.LOOK / bulk.time_step))
    slab = 1.5 * outlet.speed * fill.LOOK + particle.diameter
    while course.placed < count and course.patience < fill.PATIENCE:
        beads = bulk.beads()
        resting = beads.position[(beads.velocity**2).sum(1) < SLOW**2, 2]
        height = max(course.height, resting.max(initial=0.0) + particle.radius + outlet.fall_height)
        course.height = float(min(height, bulk.top - slab - particle.diameter))
        due = min(count, math.ceil(outlet.rate * (bulk.time + fill.LOOK))) - course.placed
        source = fill.Outlet(outlet.diameter, course.height, outlet.rate, outlet.speed, outlet.rate_from)
        new = fill.places(beads.position, source, particle.diameter, due, course.random)
        turn = None if particle.shape is None else course.random.normal(size=(len(new), 4))
        bulk.add(new, np.array([0.0, 0.0, -outlet.speed]), turn=turn)
        course.patience = 0 if len(new) else course.patience + 1
        course.placed += len(new)
        logbook.run(steps)
        logbook.look(course.kept())
        progress("pouring", course.placed, count)


def _check(rig: Pile, particle: Particle, count: int, stiffness_factor: float, settle_limit: float) -> None:
    positive(base_diameter=rig.base_diameter, stiffness_factor=stiffness_factor, settle_limit=settle_limit)
    if rig.base_diameter < 4 * particle.diameter:
        raise BadInput(
            f"base_diameter: {rig.base_diameter * 1e3:.3g} mm is no base for a heap of beads of "
            f"{particle.diameter * 1e3:.3g} mm; give at least four bead diameters."
        )
    if not (math.isfinite(rig.rim_height) and rig.rim_height >= 0):
        raise BadInput(f"rim_height must be zero or positive, got {rig.rim_height:g}.")
    if count < 1:
        raise BadInput(f"count: {count} beads make no heap; give at least 1.")
    if stiffness_factor > 1:
        raise BadInput(f"stiffness_factor: {stiffness_factor:g} would stiffen the beads; give at most 1.")


def _assumptions(
    rig: Pile, outlet: _Outlet, stiffness_factor: float, fraction: float, rolling: Rolling
) -> dict[str, str]:
    given = "a quarter of the base" if rig.outlet_diameter is None else "as given"
    return {
        "outlet_diameter": f"{outlet.diameter * 1e3:.3g} mm ({given})",
        "pour_rate": f"{outlet.rate:.0f} beads per second ({outlet.rate_from})",
        "outlet_speed": f"{outlet.speed:.2f} m/s",
        "fall_height": f"{outlet.fall_height * 1e3:.3g} mm above the top of the heap, with which the outlet rises",
        "rim_height": f"{rig.rim_height * 1e3:.3g} mm" if rig.rim_height else "none: a flat disc",
        "stiffness_factor": f"{stiffness_factor:g} of the real Young's moduli of beads and base",
        "time_step": f"{fraction:.0%} of Rayleigh's",
        "rolling_resistance": f"{rolling}, torque limit mu_r Fn R on each bead",
    }


def _warnings(rig: Pile, *, count: int, placed: int, staying: int, at_rest: bool, overlap: float) -> tuple[str, ...]:
    warnings = []
    if placed < count:
        warnings.append(f"only {placed} of {count} beads found room below the outlet")
    if rig.rim_height == 0:
        warnings.append(f"the base has no rim: {staying} of {placed} beads stayed on it; give rim_height if it has one")
    if not at_rest:
        warnings.append("the heap was still moving when the time limit was reached")
    if overlap > OVERLAP_LIMIT:
        warnings.append(
            f"the largest overlap was {overlap:.1%} of a radius; above {OVERLAP_LIMIT:.0%} raise stiffness_factor"
        )
    return tuple(warnings)
