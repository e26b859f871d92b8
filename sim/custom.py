"""Simulation of a rig of the user's own: particles among walls from STL files, at rest or in motion.

Every `interval` the particles are counted, in rigtwin's own runs and in those that another code computed alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.custom_rig import CustomRig, Region, StlWall
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Series, WallLoad
from rigtwin.lab.rigs import GRAVITY
from rigtwin.lab.stl import encloses
from rigtwin.lab.units import positive
from rigtwin.sim.output.outline import surface, surface_over
from rigtwin.sim.run import filling
from rigtwin.sim.run.run_log import History
from rigtwin.sim.run.set_up import Bench, Numerics
from rigtwin.sim.run.steady_flow import steady_flow

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.bulk.particle_state import Beads, Grains
    from rigtwin.sim.engine.walls.mesh import Mesh
    from rigtwin.sim.engine.walls.shapes import Motion, Wall
    from rigtwin.sim.output.replay import Frame

Surfaces = Mapping[str, tuple[Material, Contact]]
"""Material of walls by their name, and the particle's contact with it."""

THROWN = 0.0  # [m/s], of placed particles: they may fall a long way before they meet a wall
MARGIN = 2  # [diameters], of the domain beyond walls and fill where none is stated
POSES = 200  # of a turning wall, at most a turn: they miss 1/8000 of its radius, far less than the margin
DRAWN = 64  # places that are compared with the walls at once, which takes hardly longer than one
ACROSS = 100  # points across a region over which the height of the bed is averaged
PROBES = 400  # places in the fill region that are compared with closed walls; 1 % of it is found with 98 %
FEWEST = 5  # looks from which a flow is read
WHOLE = "domain"  # name of the region that is looked at where none is stated


@dataclass(frozen=True)
class CustomRun:
    """What happened in a rig of the user's own; z up, times from the start of the run."""

    series: tuple[Series, ...]  # particles and mass in each region, discharged mass and kinetic energy over time
    inside: dict[str, tuple[int, float]]  # at the end, by region: particles, mass [kg]
    bed_heights: dict[str, float]  # [m], at the end, by stated region: mean height of the uppermost particles
    discharged: tuple[int, float]  # particles and mass [kg] that left through the lower side of the domain
    escaped: tuple[int, float]  # the same through another side
    mass_flow_rate: float | None  # [kg/s], of the discharge, its steady part; None where there is none
    asked: int
    placed: int
    at_rest: bool
    centres: Array  # [m], shape (n, 3), of the spheres at the end
    radii: Array  # [m], shape (n,)
    time: float  # [s], simulated
    statistics: dict[str, float] = field(default_factory=dict)
    history: History | None = None
    loads: tuple[WallLoad, ...] = ()  # of the particles on each wall; none of a run that another program computed
    assumptions: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def run(
    rig: CustomRig,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int,
    seed: int = 1,
    surfaces: Surfaces | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> CustomRun:
    """Fill particles between the walls, move the walls, and record where the particles are.

    Parameters
    ----------
    rig : CustomRig
        Walls and their motions, filling, duration and regions, in SI units.
    particle : Particle
        Sphere or clump.
    wall : Material
        Material of the walls that `surfaces` does not name.
    contact, wall_contact : Contact
        Coefficients of contacts between particles, and of particles with those walls.
    count : int
        Number of particles.
    seed : int
        Seed of the random positions and orientations.
    surfaces : mapping, optional
        Material and contact of walls by name.
    progress : Progress
        Callback for the progress display.
    **numerics : Numerics
        Numerical settings, see `rigtwin.sim.run.set_up.Numerics`.

    Returns
    -------
    CustomRun
        Particles in the regions over time, bed heights, and what was discharged.

    Raises
    ------
    BadInput
        If a setting is out of its range, the particles find no room, or a wall is too fast for the time step.
    SimulationFailed
        If the simulation breaks down.
    """
    check(rig, particle, count=count)
    walls, domain = shapes(rig), domain_of(rig, particle)
    made_of = {name: (surfaces or {}).get(name, (wall, wall_contact)) for name in walls}
    # the time step follows from the lowest restitution
    bench = Bench(rig, particle, wall, contact, min((c for _, c in made_of.values()), key=_restitution), numerics)
    bulk = bench.bulk_of([_wall(rig, name, walls[name], *made_of[name], bench) for name in walls], domain, weighs=True)
    regions = _regions_of(rig, particle)
    source, state = FillRegion(rig), _RunState(random=np.random.default_rng(seed))
    clock = _Clock(rig, bulk.time_step)
    stated = {name: [asdict(one) for one in pair] for name, pair in made_of.items()}
    with bench.logbook(bulk, count=count, seed=seed, surfaces=stated) as logbook:
        if kept := logbook.resume():
            state.go_on(kept)
        while not state.ended:
            if bulk.steps >= clock.check(state.checks):
                source.time, state.checks = bulk.time, state.checks + 1
                _fill(bulk, state, source, particle, count)
            before, began = state.remaining(bulk.grains(), domain), bulk.time
            if not state.rows:
                state.look(regions, before, 0.0)
                state.weigh(bulk.impulses)
            next_check, next_look = clock.check(state.checks), clock.look(len(state.rows))
            logbook.run(max(1, min(next_check, next_look, clock.end) - bulk.steps))
            now = state.remaining(bulk.grains(), domain)
            state.note_gone(before, now, domain, bulk.time - began)
            if bulk.steps >= next_check:
                state.note_rest(rig, particle, now, bulk.time, count)
            state.ended = state.ended or bulk.steps >= clock.end
            if bulk.steps >= next_look or state.ended:
                state.look(regions, now, bulk.time)
                state.weigh(bulk.impulses)
            logbook.look(state.kept())
            progress("simulating", min(bulk.time, rig.duration), rig.duration)
    said = (*remarks(rig, particle), *bench.warnings(bulk, logbook))
    return _course_of(
        rig, particle, state, bulk.beads(), state.remaining(bulk.grains(), domain), asked=count, time=bulk.time,
        statistics=logbook.statistics(), history=logbook.history,
        assumptions={**_assumptions_of(rig, particle), **bench.assumptions()}, warnings=said,
        loads=tuple(state.loads(rig)),
    )  # fmt: skip


def replayed(rig: CustomRig, particle: Particle, frames: Sequence[Frame], *, asked: int, placed: int) -> CustomRun:
    """The course of a run that another program computed.

    Parameters
    ----------
    rig : CustomRig
        The rig.
    particle : Particle
        The particle.
    frames : sequence of Frame
        The particles over time, from the start of the run to its end.
    asked, placed : int
        Number of particles that were asked for, and that were placed.

    Returns
    -------
    CustomRun
        As `run` returns it.
    """
    state, domain = _RunState(random=np.random.default_rng(0), placed=placed), domain_of(rig, particle)
    regions = _regions_of(rig, particle)
    before: Grains | None = None
    last = 0.0
    for frame in frames:
        now = state.remaining(frame.grains(particle), domain)
        if before is not None:
            state.note_gone(before, now, domain, frame.time - last)
        state.look(regions, now, frame.time)
        before, last = now, frame.time
    state.at_rest = filling.resting(now, particle)
    return _course_of(
        rig, particle, state, frame.beads(particle), now, asked=asked, time=frame.time,
        statistics={}, history=None, assumptions=_assumptions_of(rig, particle), warnings=(),
    )  # fmt: skip


def check(rig: CustomRig, particle: Particle, *, count: int) -> None:
    """Refuse settings that `run` would refuse, without simulating.

    Parameters
    ----------
    rig, particle, count : CustomRig, Particle, int
        As for `run`.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    """
    positive(duration=rig.duration, interval=rig.interval)
    if count < 1:
        raise BadInput(f"count: {count} particles fill no rig; give at least 1.")
    low, high = domain_of(rig, particle)
    walled, wider = "check stl_unit, and the axes of the STL file", "give a larger domain (low, high)"
    parts = {f"walls.{name}": (poses(rig, wall), walled) for name, wall in rig.walls.items()}
    parts |= {f"regions.{name}": (np.array([one.low, one.high]), wider) for name, one in rig.regions.items()}
    for name, (reached, advice) in parts.items():
        if not (reached.min(axis=0) < high).all() or not (reached.max(axis=0) > low).all():
            raise BadInput(
                f"{name}: lies outside the domain: it is {_box(reached)}, and the domain is "
                f"{_box(np.array([low, high]))}; {advice}."
            )
    fill = np.array([rig.fill.low, rig.fill.high])
    if not (fill[0] >= low).all() or not (fill[1] <= high).all():
        raise BadInput(
            f"fill: is {_box(fill)}, and the domain is {_box(np.array([low, high]))}; place it in the domain."
        )
    if (np.diff(fill, axis=0) < particle.diameter).any():
        raise BadInput(
            f"fill: is {_box(fill)}, too narrow for a particle of {1e3 * particle.diameter:.3g} mm; give a larger one."
        )


def remarks(rig: CustomRig, particle: Particle) -> list[str]:
    """Return sentences on what a rig states and was hardly meant.

    Parameters
    ----------
    rig : CustomRig
        Walls and fill region.
    particle : Particle
        Particle that fills the region.

    Returns
    -------
    list of str
        The warnings: of particles inside of solids, and of walls that would move or be removed after the run.
    """
    found = enclosed(rig, particle)
    for name, wall in rig.walls.items():
        late = {"start": ("begins to move", wall.start if wall.moves else 0.0), "removed": ("is removed", wall.removed)}
        for key, (what, when) in late.items():
            if when is not None and when >= rig.duration:
                end = f"the run ends at {rig.duration:.4g} s (duration) at the latest"
                found.append(f"walls.{name}: {what} at {when:.4g} s ({key}), and {end}; correct one of them")
    return found


def enclosed(rig: CustomRig, particle: Particle) -> list[str]:
    """Return sentences on walls that are closed surfaces, inside of which the fill region or a part of it lies.

    Parameters
    ----------
    rig : CustomRig
        Walls and fill region.
    particle : Particle
        Particle that fills the region.

    Returns
    -------
    list of str
        The warnings.

    Notes
    -----
    A closed wall in which all places lie may be a vessel, unless other walls lie outside of it, which its particles
    would never meet; places on both sides show that particles would be placed inside a solid.  Surfaces that are not
    closed have no inside.
    """
    rng, source, found = np.random.default_rng(0), FillRegion(rig), []
    points = rng.uniform(*source.box, (PROBES, 3))
    points = points[source.inside(points, particle.smallest_radius)]
    for name, wall in rig.walls.items():
        share = float(encloses(_corners_of(wall), points).mean()) if len(points) else 0.0
        others = [_corners_of(other).reshape(-1, 3) for about, other in rig.walls.items() if about != name]
        kept_apart = share == 1.0 and any(not encloses(_corners_of(wall), corners).any() for corners in others)
        if 0.0 < share < 1.0 or kept_apart:
            part = "all" if kept_apart else f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"
            ending = "which other walls lie outside of" if kept_apart else "particles are placed there, too"
            found.append(
                f"walls.{name}: is a closed surface, and {part} of the room in fill lies inside of it: "
                f"{ending}; if it is a solid, place fill beside it"
            )
    return found


def _inside(points: Array, domain: tuple[Array, Array]) -> npt.NDArray[np.bool_]:
    return np.asarray(((points >= domain[0]) & (points <= domain[1])).all(axis=1))


def _box(points: Array) -> str:
    corners = points.reshape(-1, 3)
    sides = zip("xyz", 1e3 * corners.min(axis=0), 1e3 * corners.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.4g} to {high:.4g} mm" for axis, low, high in sides)


def _restitution(contact: Contact) -> float:
    return contact.restitution


# ---------------------------------------------------------------------- the rig


def shapes(rig: CustomRig) -> dict[str, Mesh]:
    """Return the walls at their places at the start.

    Parameters
    ----------
    rig : CustomRig
        Its walls are read from their STL files.

    Returns
    -------
    dict of str to Mesh
        The walls by name.
    """
    from rigtwin.sim.engine.walls.mesh import Mesh

    return {name: Mesh(_corners_of(wall), name=f"walls.{name}") for name, wall in rig.walls.items()}


def _corners_of(wall: StlWall) -> Array:
    """Triangles [m] of a wall, shape (n, 3, 3)."""
    return _corners(wall.stl, wall.unit, wall.sha256)


@lru_cache(maxsize=64)
def _corners(stl: str, unit: float, _sha256: str) -> Array:
    from rigtwin.lab.stl import stl_facets

    return np.array(stl_facets(Path(stl), unit, "name the STL file of the wall").triangles, dtype=float)


def motion_of(wall: StlWall) -> Motion | None:
    """Return the motion of a wall as the engine takes it.

    Parameters
    ----------
    wall : StlWall
        Wall, moving or at rest.

    Returns
    -------
    Motion or None
        None where the wall rests.
    """
    from rigtwin.sim.engine.walls.shapes import Motion

    if not wall.moves:
        return None
    stop = math.inf if wall.stop is None else wall.stop
    return Motion(
        wall.velocity, wall.rotation_speed, wall.rotation_axis, wall.rotation_point, wall.start, stop, wall.belt,
        wall.vibration_amplitude, wall.vibration_frequency,
    )  # fmt: skip


def _wall(rig: CustomRig, name: str, mesh: Mesh, material: Material, contact: Contact, bench: Bench) -> Wall:
    from rigtwin.sim.engine.walls.shapes import Wall

    wall = rig.walls[name]
    until = math.inf if wall.removed is None else wall.removed
    return Wall(mesh, material.softened(bench.stiffness_factor), contact, motion_of(wall), until)


def domain_of(rig: CustomRig, particle: Particle) -> tuple[Array, Array]:
    """Return the domain of a simulation, stated or about all that is in it.

    Parameters
    ----------
    rig, particle : CustomRig, Particle
        As for `run`.

    Returns
    -------
    low, high : ndarray, shape (3,)
        Its corners [m].
    """
    if rig.low is not None and rig.high is not None:
        return np.array(rig.low), np.array(rig.high)
    points = [np.array([rig.fill.low, rig.fill.high]), *(poses(rig, wall) for wall in rig.walls.values())]
    every, margin = np.concatenate(points), MARGIN * particle.diameter
    return every.min(axis=0) - margin, every.max(axis=0) + margin


def poses(rig: CustomRig, wall: StlWall) -> Array:
    """Return points in whose box a wall stays until it is removed or the run ends.

    Parameters
    ----------
    rig : CustomRig
        Its duration is used.
    wall : StlWall
        Wall, moving or at rest.

    Returns
    -------
    ndarray, shape (n, 3)
        The points [m].
    """
    corners, motion = _corners_of(wall).reshape(-1, 3), motion_of(wall)
    if motion is None or wall.belt:
        return corners
    lasts = max(min(rig.duration, wall.moves_until) - motion.start, 0.0)
    turns = min(lasts, 2 * math.pi / abs(motion.spin)) if motion.spin else 0.0
    in_place = replace(motion, velocity=(0.0, 0.0, 0.0), amplitude=(0.0, 0.0, 0.0))
    hull = np.array(np.meshgrid(*np.array([corners.min(0), corners.max(0)]).T)).reshape(3, -1).T
    turned = np.concatenate(
        [corners, *(in_place.done(hull, time) for time in motion.start + np.linspace(0, turns, POSES))]
    )
    way, sway = lasts * np.array(motion.velocity), np.abs(motion.amplitude) if lasts else np.zeros(3)
    low, high = turned.min(axis=0), turned.max(axis=0)
    return np.array([low + np.minimum(way, 0.0) - sway, high + np.maximum(way, 0.0) + sway])


def within(region: Region, points: Array, clear: float = 0.0) -> npt.NDArray[np.bool_]:
    """Return which points are in a region.

    Parameters
    ----------
    region : Region
        Box or cylinder.
    points : ndarray, shape (n, 3)
        The points [m].
    clear : float
        Distance [m] that they keep from its sides.

    Returns
    -------
    ndarray of bool, shape (n,)
        Whether each is in it.
    """
    low, high = np.array(region.low), np.array(region.high)
    if region.shape == "box":
        return np.asarray(((points >= low + clear) & (points <= high - clear)).all(axis=1))
    middle = (low + high) / 2
    radius = (high[0] - low[0]) / 2
    level = (points[:, 2] >= low[2] + clear) & (points[:, 2] <= high[2] - clear)
    return np.asarray(level & (np.hypot(*(points - middle)[:, :2].T) <= radius - clear))


class FillRegion:
    """The region in which particles are placed, clear of the walls as they are at `time`.

    Parameters
    ----------
    rig : CustomRig
        Walls, region of filling, pour rate and pour speed.
    """

    def __init__(self, rig: CustomRig) -> None:
        self.rig = rig
        self.rate = rig.pour_rate or 0.0
        self.speed, self.height = rig.pour_speed, rig.fill.low[2]
        self.box = np.array(rig.fill.low), np.array(rig.fill.high)
        self.time = 0.0  # [s]
        self._drawn: list[Array | None] = []  # places that were drawn together
        self._drawn_for = (0.0, 0.0)  # [s], [m], time and diameter
        self._walls = [(mesh, rig.walls[name], motion_of(rig.walls[name])) for name, mesh in shapes(rig).items()]

    def inside(self, points: Array, clear: float) -> npt.NDArray[np.bool_]:
        """Return which points are in the region and clear of its sides and all walls.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            The points [m].
        clear : float
            Distance [m] that they keep.

        Returns
        -------
        ndarray of bool, shape (n,)
            Whether each is in it and clear.
        """
        from rigtwin.sim.engine.walls.shapes import gaps

        free = within(self.rig.fill, points, clear)
        for shape, wall, motion in self._walls:
            rows = np.flatnonzero(free)
            if not len(rows) or (wall.removed is not None and wall.removed <= self.time):
                continue
            there = points[rows] if motion is None else motion.undone(points[rows], self.time)
            free[rows] = gaps(shape, there, np.full(len(rows), clear)) > 0
        return free

    def draw(self, diameter: float, rng: np.random.Generator) -> Array | None:
        """Draw a random place for a particle.

        Parameters
        ----------
        diameter : float
            Diameter of the particle [m].
        rng : numpy.random.Generator
            Source of the numbers.

        Returns
        -------
        ndarray, shape (3,), or None
            The place [m]; None where the particle would reach out of the region or touch a wall.
        """
        if not self._drawn or self._drawn_for != (self.time, diameter):
            points = rng.uniform(*self.box, (DRAWN, 3))
            free = self.inside(points, diameter / 2)
            self._drawn = [point if clear else None for point, clear in zip(points, free, strict=True)]
            self._drawn_for = self.time, diameter
        return self._drawn.pop()


# ---------------------------------------------------------------------- the run


class _Clock:
    """Steps at which a run checks filling and rest, looks at the particles, and ends."""

    def __init__(self, rig: CustomRig, time_step: float) -> None:
        self._interval, self._time_step = rig.interval, time_step
        self.end = max(1, round(rig.duration / time_step))

    def check(self, number: int) -> int:
        """Step of a check, the first one at the start."""
        return round(number * filling.LOOK / self._time_step)

    def look(self, number: int) -> int:
        """Step of a look, the first one at the start."""
        return round(number * self._interval / self._time_step)


def _fill(bulk: Bulk, state: _RunState, source: FillRegion, particle: Particle, count: int) -> None:
    """Place the particles that are due and find room; in vain too often, filling ends."""
    if not state.filling(count):
        return
    rig = source.rig
    if rig.pour_rate is None:
        filling.scatter_some(bulk, state, count, source.inside, source.box, particle, thrown=THROWN)
    else:
        filling.pour(bulk, state, source, bulk.grains().position, particle, count)
    if _still_to_come(rig, source.time):
        state.patience = 0  # a wall that moves or is taken away may make room
    elif rig.pour_rate is None and state.checks == 1 and not state.placed:
        raise BadInput("fill: no particle finds room in it clear of the walls; give a larger one.")


def _still_to_come(rig: CustomRig, time: float) -> bool:
    """Whether a wall moves, or will move or be removed, after `time` [s]."""
    for wall in rig.walls.values():
        removed, stop = (math.inf if when is None else when for when in (wall.removed, wall.stop))
        if time < removed and ((wall.moves and time < stop) or removed < math.inf):
            return True
    return False


def _shakes(wall: StlWall, time: float) -> bool:
    return wall.vibrates and wall.start <= time < wall.moves_until


@dataclass(kw_only=True)
class _RunState(filling.Course):
    """What was seen so far; a run resumes from it and from the state of the particles."""

    rows: list[list[float]] = field(default_factory=list)
    """Time, per region particles and mass, discharged mass, kinetic energy."""
    impulses: list[list[list[float]]] = field(default_factory=list)
    """At the same times, by wall: impulse [N s] of the particles on it so far, and its moment [N m s]."""
    checks: int = 0  # of filling and rest so far
    settled: int = 0  # checks in a row at rest, with no wall that is still to move or to be removed
    discharged: int = 0
    discharged_mass: float = 0.0  # [kg]
    escaped: int = 0
    escaped_mass: float = 0.0  # [kg]
    gone: list[int] = field(default_factory=list)  # particles that left the domain
    ended: bool = False
    at_rest: bool = False

    def filling(self, count: int) -> bool:
        """Whether particles are still to be placed."""
        return self.placed < count and self.patience < filling.PATIENCE

    def remaining(self, grains: Grains, domain: tuple[Array, Array]) -> Grains:
        """The particles that have not left the domain, even if they came back before their removal."""
        keep = _inside(grains.position, domain) & ~np.isin(grains.ident, self.gone)
        return replace(grains, **{one.name: getattr(grains, one.name)[keep] for one in fields(grains)})

    def note_gone(self, before: Grains, now: Grains, domain: tuple[Array, Array], interval: float) -> None:
        """Count the particles that left, and through which side: that beyond which their flight led them farthest."""
        gone = ~np.isin(before.ident, now.ident)
        if not gone.any():
            return
        self.gone += before.ident[gone].tolist()
        ahead = before.position[gone] + interval * before.velocity[gone]
        ahead[:, 2] -= GRAVITY / 2 * interval**2
        beyond = np.column_stack([domain[0] - ahead, ahead - domain[1]])
        below = beyond.argmax(axis=1) == 2
        mass = before.mass[gone]
        self.discharged += int(below.sum())
        self.discharged_mass += float(mass[below].sum())
        self.escaped += int((~below).sum())
        self.escaped_mass += float(mass[~below].sum())

    def look(self, regions: Mapping[str, Region], grains: Grains, time: float) -> None:
        """Note where the particles are."""
        row = [time]
        for region in regions.values():
            there = within(region, grains.position)
            row += [float(there.sum()), float(grains.mass[there].sum())]
        self.rows.append([*row, self.discharged_mass, grains.kinetic_energy])

    def weigh(self, impulses: Array) -> None:
        """Note the impulses on the walls so far."""
        self.impulses.append(impulses.tolist())

    def loads(self, rig: CustomRig) -> Iterator[WallLoad]:
        """Mean forces and torques between the looks."""
        times = np.array([row[0] for row in self.rows])
        sums = np.array(self.impulses).reshape(len(times), len(rig.walls), 6)
        means = np.diff(sums, axis=0) / np.diff(times)[:, None, None]
        for number, (name, wall) in enumerate(rig.walls.items()):
            torque = means[:, number, 3:]
            axis = np.array(wall.rotation_axis) / np.linalg.norm(wall.rotation_axis)
            yield WallLoad(
                name, times[1:], means[:, number, :3], torque, torque @ axis if wall.rotation_speed else None
            )

    def note_rest(self, rig: CustomRig, particle: Particle, grains: Grains, time: float, count: int) -> None:
        """Note whether the particles rest, and whether the run ends here."""
        waits, resting = _still_to_come(rig, time), filling.resting(grains, particle)
        # checks may fall on the turning points of a vibration
        self.quiet = self.quiet + 1 if resting and not any(_shakes(wall, time) for wall in rig.walls.values()) else 0
        self.settled = self.settled + 1 if resting and not waits else 0
        self.at_rest = self.quiet >= filling.REST_LOOKS
        settled = self.settled >= filling.REST_LOOKS  # nothing moves or leaves any more
        over = {"time": False, "at rest": settled, "empty": settled or not len(grains.ident)}[rig.end]
        self.ended = over and not self.filling(count)


def _regions_of(rig: CustomRig, particle: Particle) -> dict[str, Region]:
    """The regions that are looked at, by name: those stated, else the domain."""
    if rig.regions:
        return dict(rig.regions)
    (x, y, z), (to_x, to_y, to_z) = domain_of(rig, particle)
    return {WHOLE: Region((float(x), float(y), float(z)), (float(to_x), float(to_y), float(to_z)))}


def bed_height(region: Region, centres: Array, radii: Array) -> float:
    """Return the height of a bed in a region: that of its uppermost spheres, averaged over the region.

    Parameters
    ----------
    region : Region
        Region in which the bed lies.
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m].
    radii : ndarray, shape (n,)
        Their radii [m].

    Returns
    -------
    float
        Height above the floor of the region [m].
    """
    (x, y, floor), (to_x, to_y, _) = region.low, region.high
    raised = centres - np.array([(x + to_x) / 2, (y + to_y) / 2, floor])
    if region.shape == "cylinder":
        return float(surface(raised, radii, to_x - x).mean())
    wide, deep = to_x - x, to_y - y
    pitch = max(wide, deep) / ACROSS
    sides = [(np.arange(n) + 0.5) * side / n - side / 2 for side in (wide, deep) if (n := math.ceil(side / pitch))]
    return float(surface_over(sides[0], sides[1], raised, radii).mean())


def _assumptions_of(rig: CustomRig, particle: Particle) -> dict[str, str]:
    """What was taken, in words."""
    domain = domain_of(rig, particle)
    stated = "as given" if rig.low is not None else f"walls and fill, and {MARGIN} particle diameters more"
    poured = "at once, those without room as soon as there is some"
    if rig.pour_rate is not None:
        poured = f"{rig.pour_rate:g} per second at {rig.pour_speed:g} m/s downwards"
    moving = [f"{name}: {_motion_in_words(wall)}" for name, wall in rig.walls.items() if wall.moves]
    return {
        "domain": f"{_box(np.array(domain))} ({stated}); gravity along -z",
        "filling": f"placed at random in {_box(np.array([rig.fill.low, rig.fill.high]))}, clear of the walls; {poured}",
        "motion": "; ".join(moving) or "all walls rest",
    }


def _motion_in_words(wall: StlWall) -> str:
    """The motion of a wall."""
    said = []
    if any(wall.velocity):
        said.append(f"moves at ({', '.join(f'{v:.4g}' for v in wall.velocity)}) m/s")
    if wall.rotation_speed:
        axis, point = (", ".join(f"{v:.4g}" for v in one) for one in (wall.rotation_axis, wall.rotation_point))
        said.append(f"turns at {wall.rotation_speed:.4g} rad/s about ({axis}) through ({point}) m")
    if wall.vibrates:
        sway = ", ".join(f"{1e3 * v:.4g}" for v in wall.vibration_amplitude)
        said.append(f"vibrates by ({sway}) mm at {wall.vibration_frequency:.4g} Hz")
    until = "the end" if wall.stop is None else f"{wall.stop:g} s"
    return f"{', '.join(said)}{', as a belt' if wall.belt else ''}, from {wall.start:g} s to {until}"


# ---------------------------------------------------------------------- the result


def _course_of(
    rig: CustomRig,
    particle: Particle,
    state: _RunState,
    beads: Beads,
    grains: Grains,
    *,
    asked: int,
    time: float,
    statistics: dict[str, float],
    history: History | None,
    assumptions: dict[str, str],
    warnings: tuple[str, ...],
    loads: tuple[WallLoad, ...] = (),
) -> CustomRun:
    regions = _regions_of(rig, particle)
    times, *columns = np.array(state.rows).T
    named = [(f"{what}_in_{name}", unit) for name in regions for what, unit in (("particles", "1"), ("mass", "kg"))]
    named += [("mass_discharged", "kg"), ("kinetic_energy", "J")]
    inside = {name: within(region, grains.position) for name, region in regions.items()}
    owner = beads.ident if beads.grain is None else beads.grain
    there = np.isin(owner, grains.ident)
    heights = {}
    for name, region in rig.regions.items():
        spheres = np.isin(owner, grains.ident[inside[name]])
        heights[name] = bed_height(region, beads.position[spheres], beads.radius[spheres])
    said = list(warnings)
    if state.placed < asked and state.patience >= filling.PATIENCE:
        said.append(f"only {state.placed} of {asked} particles found room in the fill region; give a larger one")
    elif state.placed < asked:
        more = "give a larger fill" if rig.pour_rate is None else "pour_rate"
        said.append(f"only {state.placed} of {asked} particles were placed in {time:.3g} s; raise duration or {more}")
    if state.escaped:
        said.append(
            f"{state.escaped} of {state.placed} particles left through a side or the top of the domain; "
            "close the walls there, or give a larger domain (low, high)"
        )
    if rig.end == "at rest" and _still_to_come(rig, time):
        said.append(
            "a wall still moved, or was still to be removed, when the time limit was reached; raise duration, or give "
            "its motion a stop"
        )
    elif rig.end == "at rest" and not state.at_rest:
        said.append("the particles were still moving when the time limit was reached; raise duration")
    if rig.end == "empty" and len(grains.ident):
        rest = "rest: they arch over an opening, or lie on a wall"
        limit = "were still there when the time limit was reached; raise duration"
        said.append(f"{len(grains.ident)} particles {rest if state.at_rest else limit}")
    return CustomRun(
        series=tuple(Series(times, values, name, unit) for (name, unit), values in zip(named, columns, strict=True)),
        inside={name: (int(rows.sum()), float(grains.mass[rows].sum())) for name, rows in inside.items()},
        bed_heights=heights,
        discharged=(state.discharged, state.discharged_mass),
        escaped=(state.escaped, state.escaped_mass),
        mass_flow_rate=steady_flow(times, columns[-2], columns[-2][-1], FEWEST),
        asked=asked,
        placed=state.placed,
        at_rest=state.at_rest,
        centres=beads.position[there],
        radii=beads.radius[there],
        time=time,
        statistics=statistics,
        history=history,
        loads=loads,
        assumptions=assumptions,
        warnings=tuple(said),
    )


def picture(rig: CustomRig, course: CustomRun) -> npt.NDArray[np.uint8]:
    """Draw the walls that are there, and the particles, at the end.

    Parameters
    ----------
    rig : CustomRig
        As for `run`.
    course : CustomRun
        Run that has ended.

    Returns
    -------
    ndarray, shape (height, width, 3)
        RGB image.
    """
    from rigtwin.sim.output.picture import draw

    shown = []
    for wall in rig.walls.values():
        if wall.removed is not None and wall.removed <= course.time:
            continue
        corners, motion = _corners_of(wall), motion_of(wall)
        if motion is not None:
            corners = motion.done(corners.reshape(-1, 3), course.time).reshape(-1, 3, 3)
        shown.append(corners)
    walls = np.concatenate(shown) if shown else None
    return draw(course.centres, course.radii, walls=walls, turn=30.0, tilt=20.0)
