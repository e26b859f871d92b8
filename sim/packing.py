"""The twin of the packing test: particles pour into a measuring cylinder (Hlosta et al. 2020, fig. 4)."""

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
from rigtwin.lab.rigs import Packing
from rigtwin.sim import fill
from rigtwin.sim.engine.clock import USUAL, positive, time_step
from rigtwin.sim.logbook import History, Logbook
from rigtwin.sim.pile import silhouette

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk import Bulk
    from rigtwin.sim.engine.contact import Rolling
    from rigtwin.sim.engine.walls import Shape

Array = npt.NDArray[np.float64]

VIEWS = (0.0, 45.0, 90.0, 135.0)  # [deg], about the cylinder's axis
OUTLET = 0.6  # of the cylinder's diameter
LEAST_RATE = 200.0  # [1/s]
SKIN = 0.2  # of a diameter; the rain makes a list short-lived
FRAME_INTERVAL = 0.01  # [s]
CHECKPOINT_INTERVAL = 60.0  # [s] of computing
OVERLAP_LIMIT = 0.05  # of a radius
SURFACE_POINTS = 100  # across the cylinder


@dataclass(frozen=True)
class Bed:
    """What stands in the cylinder in the end.  x and y from the axis, z above the bottom."""

    centres: Array  # [m], shape (n, 3), of the spheres
    radii: Array  # [m], shape (n,)
    surface: Array  # [m], shape (k,), height of the uppermost sphere over points that cover the cylinder evenly
    profiles: tuple[Profile, ...]  # outline of the bed's top through the glass, from four sides
    mass: float  # [kg], in the cylinder
    solid: float  # [m^3], volume of the particles in the cylinder
    cylinder_diameter: float  # [m]
    at_rest: bool
    time: float  # [s], simulated
    asked: int
    placed: int
    missed: int  # particles that did not stay in the cylinder
    computing: float  # [s], of processor time
    statistics: dict[str, float] = field(default_factory=dict)
    history: History | None = None
    assumptions: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def height(self) -> float:
        """Mean height of the surface [m]."""
        return float(self.surface.mean()) if len(self.surface) else 0.0

    @property
    def bulk_density(self) -> float:
        """Mass over the volume filled up to the mean height [kg/m^3]."""
        return self.mass / self._filled

    @property
    def packing_fraction(self) -> float:
        """Volume of the particles over the volume filled up to the mean height [1]."""
        return self.solid / self._filled

    @property
    def seconds_per_particle(self) -> float:
        """Processor time [s] that each particle took."""
        return self.computing / max(self.placed, 1)

    @property
    def _filled(self) -> float:
        return max(math.pi / 4 * self.cylinder_diameter**2 * self.height, 1e-30)


def run(
    rig: Packing,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int = 3000,
    seed: int = 1,
    stiffness_factor: float = 1e-3,
    threads: int | None = None,
    time_step_fraction: float = USUAL,
    pour_rate: float | None = None,
    settle_limit: float = 4.0,
    rolling: Rolling = "type C",
    trajectory: Path | None = None,
    trajectory_interval: float = FRAME_INTERVAL,
    checkpoint: Path | None = None,
    checkpoint_interval: float = CHECKPOINT_INTERVAL,
    progress: Progress = silent,
) -> Bed:
    """Pour `count` particles into the cylinder and wait until they rest.

    They rain through the hopper's outlet, without overlap, clumps turned at random, at `pour_rate` [1/s] (default:
    Beverloo's discharge of the outlet).  The run ends when they rest, or `settle_limit` [s] after the last one, and
    says which.  Young's moduli are multiplied by `stiffness_factor` (Hlosta et al. 2020, section 2.2.3).  Trajectory
    and checkpoint as in the twin of the pile.
    """
    _check(rig, particle, count, stiffness_factor, settle_limit)
    soft = replace(particle, material=particle.material.softened(stiffness_factor))
    step, warnings = time_step([soft], time_step_fraction)
    opening = OUTLET * rig.cylinder_diameter if rig.outlet_diameter is None else rig.outlet_diameter
    source = fill.outlet(particle, opening, rig.cylinder_height + rig.fall_height, pour_rate, LEAST_RATE)
    bulk = _bench(rig, soft, wall.softened(stiffness_factor), (contact, wall_contact), source, step, rolling, threads)
    settings = {
        **{name: asdict(thing) for name, thing in (("rig", rig), ("particle", particle), ("wall", wall))},
        **{"contact": asdict(contact), "wall_contact": asdict(wall_contact), "outlet": asdict(source)},
        **{"count": count, "seed": seed, "stiffness_factor": stiffness_factor, "rolling": rolling},
        **{"time_step_fraction": time_step_fraction, "settle_limit": settle_limit},
    }
    course = fill.Course(np.random.default_rng(seed))
    logbook = Logbook(
        bulk,
        settings,
        trajectory=trajectory,
        trajectory_interval=trajectory_interval,
        checkpoint=checkpoint,
        checkpoint_interval=checkpoint_interval,
    )
    began = time.process_time()
    with logbook:
        if kept := logbook.resume():
            course.go_on(kept)
        fill.rain(bulk, logbook, course, source, particle, count, progress)
        at_rest = fill.settle(bulk, logbook, course, particle, settle_limit, progress)
    return _bed(
        rig,
        particle,
        bulk,
        logbook,
        at_rest=at_rest,
        asked=count,
        placed=course.placed,
        computing=time.process_time() - began,
        assumptions=_assumptions(rig, source, stiffness_factor, time_step_fraction, rolling),
        warnings=warnings,
    )


def surface(centres: Array, radii: Array, diameter: float) -> Array:
    """Height [m] of the uppermost sphere over points spread evenly over a round base; 0 where there is none."""
    x = (np.arange(SURFACE_POINTS) + 0.5) / SURFACE_POINTS * diameter - diameter / 2
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    points = points[np.hypot(*points.T) < diameter / 2]
    height = np.zeros(len(points))
    pitch = diameter / SURFACE_POINTS
    for part in np.array_split(np.arange(len(points)), max(1, len(points) * len(centres) // 4_000_000)):
        low = points[part].min(axis=0) - radii.max(initial=0.0) - pitch
        high = points[part].max(axis=0) + radii.max(initial=0.0) + pitch
        near = ((centres[:, :2] > low) & (centres[:, :2] < high)).all(axis=1)
        place, radius = centres[near], radii[near]
        over = radius**2 - ((points[part, None] - place[:, :2]) ** 2).sum(axis=2)
        top = np.where(over >= 0, place[:, 2] + np.sqrt(np.maximum(over, 0.0)), 0.0)
        height[part] = top.max(axis=1, initial=0.0)
    return height


def picture(rig: Packing, bed: Bed, *, turn: float = 30.0, tilt: float = 15.0) -> npt.NDArray[np.uint8]:
    """The cylinder and its bed, an RGB image; the eye `turn` [deg] about z and `tilt` [deg] above."""
    from rigtwin.sim.picture import draw
    from rigtwin.sim.trajectory import triangles

    reach = np.full(3, rig.cylinder_height + rig.cylinder_diameter)
    walls = np.concatenate([triangles(shape, (-reach, reach)) for shape in _shapes(rig)])
    return draw(bed.centres, bed.radii, walls=walls, turn=turn, tilt=tilt)


def _bench(
    rig: Packing,
    soft: Particle,
    wall: Material,
    contacts: tuple[Contact, Contact],
    source: fill.Outlet,
    step: float,
    rolling: Rolling,
    threads: int | None,
) -> Bulk:
    from rigtwin.sim.engine.bulk import Bulk
    from rigtwin.sim.engine.walls import Wall

    side = max(rig.cylinder_diameter, source.diameter) / 2 + 2 * soft.diameter
    top = source.height + source.slab + 3 * soft.diameter
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


def _shapes(rig: Packing) -> list[Shape]:
    from rigtwin.sim.engine.walls import Cylinder, Disc

    up = (0.0, 0.0, 1.0)
    radius = rig.cylinder_diameter / 2
    return [Disc((0.0, 0.0, 0.0), up, radius), Cylinder((0.0, 0.0, 0.0), up, radius, rig.cylinder_height)]


def _bed(
    rig: Packing,
    particle: Particle,
    bulk: Bulk,
    logbook: Logbook,
    *,
    at_rest: bool,
    asked: int,
    placed: int,
    computing: float,
    assumptions: dict[str, str],
    warnings: tuple[str, ...],
) -> Bed:
    beads, grains = bulk.beads(), bulk.grains()
    within = (np.hypot(*grains.position[:, :2].T) < rig.cylinder_diameter / 2) & (grains.position[:, 2] > 0)
    spheres = np.isin(beads.ident if beads.grain is None else beads.grain, grains.ident[within])
    centres, radii = beads.position[spheres], beads.radius[spheres]
    heights = surface(centres, radii, rig.cylinder_diameter)
    overlap = bulk.largest_overlap
    said = [*warnings, *logbook.warnings]
    if placed < asked:
        said.append(f"only {placed} of {asked} particles found room below the outlet")
    if missed := placed - int(within.sum()):
        said.append(f"{missed} of {placed} particles did not stay in the cylinder")
    if heights.max(initial=0.0) > rig.cylinder_height:
        said.append("the bed reaches above the cylinder; give a higher one or fewer particles")
    if not at_rest:
        said.append("the bed was still moving when the time limit was reached")
    if overlap > OVERLAP_LIMIT:
        said.append(f"the largest overlap was {overlap:.1%} of a radius; above {OVERLAP_LIMIT:.0%} raise the stiffness")
    return Bed(
        centres=centres,
        radii=radii,
        surface=heights,
        profiles=tuple(silhouette(centres, radii, rig.cylinder_diameter, view) for view in VIEWS),
        mass=float(grains.mass[within].sum()),
        solid=float(within.sum()) * particle.volume,
        cylinder_diameter=rig.cylinder_diameter,
        at_rest=at_rest,
        time=bulk.time,
        asked=asked,
        placed=placed,
        missed=missed,
        computing=computing,
        statistics={
            "largest_overlap": overlap,
            **logbook.statistics(),
            "time_step_s": bulk.time_step,
            "steps": float(bulk.steps),
            "lists_built": float(bulk.lists_built),
        },
        history=logbook.history,
        assumptions=assumptions,
        warnings=tuple(said),
    )


def _check(rig: Packing, particle: Particle, count: int, stiffness_factor: float, settle_limit: float) -> None:
    positive(
        cylinder_diameter=rig.cylinder_diameter,
        cylinder_height=rig.cylinder_height,
        fall_height=rig.fall_height,
        stiffness_factor=stiffness_factor,
        settle_limit=settle_limit,
    )
    if rig.cylinder_diameter < 2 * particle.diameter:
        raise BadInput(
            f"cylinder_diameter: {rig.cylinder_diameter * 1e3:.3g} mm is too narrow for particles of "
            f"{particle.diameter * 1e3:.3g} mm; give at least two diameters."
        )
    if rig.outlet_diameter is not None and rig.outlet_diameter > rig.cylinder_diameter:
        raise BadInput(
            f"outlet_diameter: {rig.outlet_diameter * 1e3:.3g} mm is wider than the cylinder of "
            f"{rig.cylinder_diameter * 1e3:.3g} mm; particles would fall beside it."
        )
    if count < 1:
        raise BadInput(f"count: {count} particles make no bed; give at least 1.")
    if stiffness_factor > 1:
        raise BadInput(f"stiffness_factor: {stiffness_factor:g} would stiffen the particles; give at most 1.")


def _assumptions(
    rig: Packing, source: fill.Outlet, stiffness_factor: float, fraction: float, rolling: Rolling
) -> dict[str, str]:
    given = f"{OUTLET:g} of the cylinder" if rig.outlet_diameter is None else "as given"
    return {
        "cylinder": f"{rig.cylinder_diameter * 1e3:.3g} mm wide, {rig.cylinder_height * 1e3:.3g} mm high",
        "outlet_diameter": f"{source.diameter * 1e3:.3g} mm ({given})",
        "pour_rate": f"{source.rate:.0f} particles per second ({source.rate_from})",
        "outlet_speed": f"{source.speed:.2f} m/s",
        "fall_height": f"{rig.fall_height * 1e3:.3g} mm from the outlet to the rim, and on to the bed",
        "stiffness_factor": f"{stiffness_factor:g} of the real Young's moduli of particles and cylinder",
        "time_step": f"{fraction:.0%} of Rayleigh's",
        "rolling_resistance": f"{rolling}, torque limit mu_r Fn R on each sphere",
    }
