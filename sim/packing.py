"""Simulation of the packing test: particles pour into a measuring cylinder (Hlosta et al. 2020, fig. 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Unpack

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Profile
from rigtwin.lab.rigs import OUTLET_SHARE, Packing
from rigtwin.lab.units import positive
from rigtwin.sim.output.outline import VIEWS, silhouette, surface
from rigtwin.sim.run import filling
from rigtwin.sim.run.run_log import History
from rigtwin.sim.run.set_up import Bench, Numerics

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.bulk.particle_state import Beads, Grains
    from rigtwin.sim.engine.walls.shapes import Shape
    from rigtwin.sim.output.replay import Frame
    from rigtwin.sim.run.run_log import Logbook


LEAST_RATE = 200.0  # [1/s], smallest default pour rate, to keep the run short
CONE = math.radians(60)  # [rad], inclination of the hopper's walls from the horizontal
SLIDE = 2  # number of the wall that closes the hopper
FLOWING = 0.5  # [s] without a particle leaving, after which the hopper counts as blocked or empty


@dataclass(frozen=True)
class Bed:
    """The bed in the cylinder at the end.  x and y from the axis, z above the bottom."""

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
    missed: int  # particles that are neither in the cylinder nor in the hopper
    stuck: int  # particles still in the hopper
    arched: bool  # whether these are at rest over its outlet
    outlet_diameter: float  # [m]
    computing: float  # [s], processor time of all processes of the run; NaN if an earlier one did not record it
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
        """Processor time per particle [s]."""
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
    pour_rate: float | None = None,
    fill_limit: float = 3.0,
    settle_limit: float = 4.0,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Bed:
    """Pour particles into the cylinder and wait until they rest.

    Parameters
    ----------
    rig : Packing
        Dimensions of cylinder, outlet and hopper [m].
    particle : Particle
        Sphere or clump.
    wall : Material
        Material of the walls.
    contact, wall_contact : Contact
        Coefficients of contacts between particles, and of particles with walls.
    count : int
        Number of particles.
    seed : int
        Seed of the random positions and orientations.
    pour_rate : float, optional
        Particles per second [1/s], without a hopper.  Default: Beverloo's discharge of the outlet, but at least
        200 per second.
    fill_limit : float
        Longest wait [s] until the particles rest on the slide of a hopper.
    settle_limit : float
        Longest wait [s] until the bed rests, after the last particle.
    progress : Progress
        Callback for the progress display.
    **numerics : Numerics
        Numerical settings, see `rigtwin.sim.run.set_up.Numerics`.

    Returns
    -------
    Bed
        The bed at the end; `Bed.at_rest` states whether it rests, `Bed.warnings` what limits the result.

    Raises
    ------
    BadInput
        If a setting is out of its range, or particles would move too fast for the time step.
    SimulationFailed
        If the simulation breaks down.

    Notes
    -----
    Without a hopper (`rig.hopper_diameter` None) the particles are inserted in the outlet without overlap, clumps with
    random orientation.  With a hopper they rest on its slide, which is then removed.

    References
    ----------
    Hlosta et al. 2020, fig. 4.
    """
    check(rig, particle, count=count, settle_limit=settle_limit, pour_rate=pour_rate)
    bench = Bench(rig, particle, wall, contact, wall_contact, numerics)
    source = outlet_of(rig, particle, pour_rate)
    if rig.hopper_diameter is None:
        filling.need_bearable(source, bench.fastest)
    if bench.falls_freely:
        higher = "fall_height" if rig.fall_height > rig.cylinder_height else "cylinder_height"
        filling.need_bearable_fall(higher, source.height, source.speed, bench.fastest)
    hopper = None if rig.hopper_diameter is None else Hopper(rig.hopper_diameter, source, particle, count)
    shapes = walls_of(rig) if hopper is None else [*walls_of(rig), *hopper.shapes]
    bulk = bench.bulk(shapes, domain_of(rig, particle, source, hopper), skin=filling.SKIN)
    course = filling.Course(random=np.random.default_rng(seed))
    asked = {"count": count, "seed": seed, "settle_limit": settle_limit, "fill_limit": fill_limit}
    with bench.logbook(bulk, outlet=source.settings, **asked) as logbook:
        if kept := logbook.resume():
            course.go_on(kept)
        if hopper is None:
            filling.rain(bulk, logbook, course, lambda: (source, bulk.grains().position), particle, count, progress)
        elif course.settling_until is None or course.let_go is None:
            hopper.pour(bulk, logbook, course, fill_limit, progress)
        at_rest = filling.settle(bulk, logbook, course, particle, settle_limit, progress)
    return _bed(
        rig,
        particle,
        source,
        bulk.beads(),
        bulk.grains(),
        at_rest=at_rest,
        asked=count,
        placed=course.placed,
        in_time=course.in_time,
        time=bulk.time,
        computing=logbook.computing,
        statistics=logbook.statistics(),
        history=logbook.history,
        assumptions={**_assumptions(rig, source), **bench.assumptions()},
        warnings=bench.warnings(bulk, logbook),
    )


def replayed(rig: Packing, particle: Particle, frame: Frame, *, asked: int, pour_rate: float | None = None) -> Bed:
    """The bed of a run that another program computed.

    Parameters
    ----------
    rig : Packing
        Dimensions of cylinder, outlet and hopper [m].
    particle : Particle
        The sphere.
    frame : Frame
        The spheres at the end.
    asked : int
        Number of particles that were poured.
    pour_rate : float, optional
        Particles per second [1/s], as in `run`.

    Returns
    -------
    Bed
        The bed at the end, as `run` gives it.
    """
    source, grains = outlet_of(rig, particle, pour_rate), frame.grains(particle)
    return _bed(
        rig, particle, source, frame.beads(particle), grains, at_rest=filling.resting(grains, particle), asked=asked,
        placed=asked, in_time=True, time=frame.time, computing=math.nan, statistics={}, history=None,
        assumptions=_assumptions(rig, source), warnings=(),
    )  # fmt: skip


@dataclass(frozen=True)
class Hopper:
    """A round hopper above the cylinder, closed by a slide."""

    diameter: float  # [m], inside, above the cone
    outlet: filling.Outlet
    particle: Particle
    count: int

    @property
    def cone_height(self) -> float:
        """Height of the cone [m]."""
        return (self.diameter - self.outlet.diameter) / 2 * math.tan(CONE)

    @property
    def top(self) -> float:
        """z [m] of its upper edge; leaves room for the loose lattice of the filling."""
        loose = filling.loose_height(self.particle, self.count, self.diameter)
        return self.outlet.height + self.cone_height + loose

    @property
    def shapes(self) -> list[Shape]:
        """Walls, the slide first."""
        source = self.outlet
        return [*filling.funnel(source.diameter, self.diameter, self.cone_height, self.top, source.height)]

    def pour(self, bulk: Bulk, logbook: Logbook, course: filling.Course, limit: float, progress: Progress) -> None:
        """Fill the hopper, remove its slide, and wait until no more particles leave it.

        Parameters
        ----------
        bulk, logbook, course : Bulk, Logbook, Course
            Simulation, its log, and the state of the filling.
        limit : float
            Longest wait [s] until the particles rest on the slide.
        progress : Progress
            Callback for the progress display.
        """
        wide, low = self.diameter / 2, self.outlet.height
        if not course.placed:
            box = np.array([-wide, -wide, low]), np.array([wide, wide, self.top])
            inside = filling.in_funnel(self.outlet.diameter, self.diameter, self.cone_height, low)
            filling.scatter(bulk, self.count, inside, box, self.particle, course.random)
            course.placed = self.count
        if course.let_go is None:
            filling.settle_and_let_go(bulk, logbook, course, self.particle, limit, progress)
            bulk.remove_wall(SLIDE)
        steps = max(1, round(filling.LOOK / bulk.time_step))
        while (above := self._above(bulk)) and course.patience * filling.LOOK < FLOWING:
            logbook.run(steps)
            course.patience = 0 if self._above(bulk) < above else course.patience + 1
            logbook.look(course.kept())
            progress("pouring", self.count - above, self.count)

    def _above(self, bulk: Bulk) -> int:
        return int((bulk.grains().position[:, 2] > self.outlet.height).sum())


def picture(rig: Packing, bed: Bed, *, turn: float = 30.0, tilt: float = 15.0) -> npt.NDArray[np.uint8]:
    """Draw the cylinder and its bed.

    Parameters
    ----------
    rig : Packing
        As for `run`.
    bed : Bed
        Bed at the end of a run.
    turn : float
        Direction of view [deg] about z.
    tilt : float
        Height of the view above the horizon [deg].

    Returns
    -------
    ndarray, shape (height, width, 3)
        RGB image.
    """
    from rigtwin.sim.output.picture import draw
    from rigtwin.sim.output.trajectory import triangles

    reach = np.full(3, rig.cylinder_height + rig.cylinder_diameter)
    walls = np.concatenate([triangles(shape, (-reach, reach)) for shape in walls_of(rig)])
    return draw(bed.centres, bed.radii, walls=walls, turn=turn, tilt=tilt)


def domain_of(
    rig: Packing, particle: Particle, source: filling.Outlet, hopper: Hopper | None
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the domain of a simulation.

    Parameters
    ----------
    rig, particle : Packing, Particle
        As for `run`.
    source : Outlet
        The outlet, of `outlet_of`.
    hopper : Hopper or None
        The hopper above the cylinder, if there is one.

    Returns
    -------
    tuple of tuple of float
        Low and high corner [m].
    """
    wide = max(rig.cylinder_diameter, source.diameter, hopper.diameter if hopper else 0.0)
    side = wide / 2 + 2 * particle.diameter
    top = source.height + source.slab if hopper is None else hopper.top
    return (-side, -side, -2 * particle.diameter), (side, side, top + 3 * particle.diameter)


def walls_of(rig: Packing) -> list[Shape]:
    """Return the walls of the cylinder.

    Parameters
    ----------
    rig : Packing
        Its diameter and height are used.

    Returns
    -------
    list of Shape
        Bottom and side wall.
    """
    from rigtwin.sim.engine.walls.shapes import Cylinder, Disc

    up = (0.0, 0.0, 1.0)
    radius = rig.cylinder_diameter / 2
    return [Disc((0.0, 0.0, 0.0), up, radius), Cylinder((0.0, 0.0, 0.0), up, radius, rig.cylinder_height)]


def _bed(
    rig: Packing,
    particle: Particle,
    source: filling.Outlet,
    beads: Beads,
    grains: Grains,
    *,
    at_rest: bool,
    asked: int,
    placed: int,
    in_time: bool,
    time: float,
    computing: float,
    statistics: dict[str, float],
    history: History | None,
    assumptions: dict[str, str],
    warnings: tuple[str, ...],
) -> Bed:
    z = grains.position[:, 2]
    within = (np.hypot(*grains.position[:, :2].T) < rig.cylinder_diameter / 2) & (z > 0)
    stuck, arched = 0, False
    if rig.hopper_diameter is not None:  # particles may be stuck in it
        within &= z < source.height
        above = z > source.height
        stuck = int(above.sum())
        arched = stuck > 0 and bool(np.linalg.norm(grains.velocity[above], axis=1).max() < filling.SETTLED.speed)
    spheres = np.isin(beads.ident if beads.grain is None else beads.grain, grains.ident[within])
    centres, radii = beads.position[spheres], beads.radius[spheres]
    heights = surface(centres, radii, rig.cylinder_diameter)
    said = list(warnings)
    if not in_time:
        said.append("the filling of the hopper was still moving when its slide was removed; raise --fill-limit")
    if placed < asked:
        said.append(f"only {placed} of {asked} particles found room below the outlet")
    overfull = bool(heights.max(initial=0.0) > rig.cylinder_height)
    if overfull:  # the surplus stands up to the hopper and is not stuck in it
        stuck, arched = 0, False
    if arched:
        jam = filling.arch_in_words(f"{stuck} of {placed} particles", source.diameter, particle)
        said.append(f"{jam}; give a wider --outlet-diameter")
    elif stuck:
        said.append(f"only {placed - stuck} of {placed} particles had left the hopper when the run ended")
    if missed := placed - int(within.sum()) - stuck:
        said.append(f"{missed} of {placed} particles did not stay in the cylinder")
    if overfull:
        said.append("the bed reaches above the cylinder; give a larger --cylinder-height or fewer particles")
    if not at_rest:
        said.append("the bed was still moving when the time limit was reached; raise --settle-limit")
    return Bed(
        centres=centres,
        radii=radii,
        surface=heights,
        profiles=tuple(silhouette(centres, radii, rig.cylinder_diameter, view) for view in VIEWS),
        mass=float(grains.mass[within].sum()),
        solid=_solid(grains.mass[within], particle),
        cylinder_diameter=rig.cylinder_diameter,
        at_rest=at_rest,
        time=time,
        asked=asked,
        placed=placed,
        missed=missed,
        stuck=stuck,
        arched=arched,
        outlet_diameter=source.diameter,
        computing=computing,
        statistics=statistics,
        history=history,
        assumptions=assumptions,
        warnings=tuple(said),
    )


def _solid(masses: Array, particle: Particle) -> float:
    """Volume [m^3] of the particles of these masses [kg]."""
    if particle.sizes is None:
        return len(masses) * particle.volume
    return float(masses.sum()) / particle.effective_density


def check(
    rig: Packing, particle: Particle, *, count: int, settle_limit: float = 4.0, pour_rate: float | None = None
) -> None:
    """Refuse settings that `run` would refuse, without simulating.

    Parameters
    ----------
    rig, particle : Packing, Particle
        As for `run`.
    count : int
        Number of particles.
    settle_limit : float
        Longest wait [s] until the bed rests.
    pour_rate : float, optional
        Particles per second [1/s], without a hopper.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    """
    positive(
        cylinder_diameter=rig.cylinder_diameter,
        cylinder_height=rig.cylinder_height,
        fall_height=rig.fall_height,
        settle_limit=settle_limit,
    )
    if rig.cylinder_diameter < 2 * particle.diameter:
        raise BadInput(
            f"cylinder_diameter: {rig.cylinder_diameter * 1e3:.3g} mm is too narrow for particles of "
            f"{particle.diameter * 1e3:.3g} mm; give at least two diameters."
        )
    if rig.cylinder_height < particle.diameter:
        raise BadInput(
            f"cylinder_height: {rig.cylinder_height * 1e3:.3g} mm hold no particles of "
            f"{particle.diameter * 1e3:.3g} mm; give a higher cylinder."
        )
    if rig.outlet_diameter is not None and rig.outlet_diameter > rig.cylinder_diameter:
        raise BadInput(
            f"outlet_diameter: {rig.outlet_diameter * 1e3:.3g} mm is wider than the cylinder of "
            f"{rig.cylinder_diameter * 1e3:.3g} mm; particles would fall beside it."
        )
    if count < 1:
        raise BadInput(f"count: {count} particles make no bed; give at least 1.")
    if rig.hopper_diameter is not None and rig.hopper_diameter <= (
        rig.outlet_diameter or OUTLET_SHARE * rig.cylinder_diameter
    ):
        raise BadInput(
            f"hopper_diameter: {rig.hopper_diameter * 1e3:.3g} mm is no wider than its outlet; give a wider hopper."
        )
    source = outlet_of(rig, particle, pour_rate)
    if rig.hopper_diameter is None:
        filling.need_end(source, count)


def outlet_of(rig: Packing, particle: Particle, pour_rate: float | None) -> filling.Outlet:
    """Return the outlet above the cylinder.

    Parameters
    ----------
    rig, particle : Packing, Particle
        As for `run`.
    pour_rate : float or None
        Particles per second [1/s]; None: the default of `run`.

    Returns
    -------
    Outlet
        The outlet.

    Raises
    ------
    BadInput
        If it lets no particles through, or the rate is not positive.
    """
    opening = OUTLET_SHARE * rig.cylinder_diameter if rig.outlet_diameter is None else rig.outlet_diameter
    return filling.outlet(particle, opening, rig.cylinder_height + rig.fall_height, pour_rate, LEAST_RATE)


def _assumptions(rig: Packing, source: filling.Outlet) -> dict[str, str]:
    given = f"{OUTLET_SHARE:g} of the cylinder" if rig.outlet_diameter is None else "as given"
    words = {
        "cylinder": f"{rig.cylinder_diameter * 1e3:.3g} mm wide, {rig.cylinder_height * 1e3:.3g} mm high",
        "outlet_diameter": f"{source.diameter * 1e3:.3g} mm ({given})",
        "fall_height": f"{rig.fall_height * 1e3:.3g} mm from the outlet to the rim, and on to the bed",
    }
    if rig.hopper_diameter is not None:
        wide, steep = rig.hopper_diameter * 1e3, math.degrees(CONE)
        return words | {
            "hopper": f"{wide:.3g} mm wide over a cone of {steep:.0f} degrees; its slide is removed at once"
        }
    return words | {
        "pour_rate": f"{source.pours} ({source.rate_from})",
        "outlet_speed": f"{source.speed:.2f} m/s",
    }
