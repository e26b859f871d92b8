"""Filling a rig: particles are poured from an outlet or placed in a container without overlap, and settle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Protocol, get_type_hints

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import PACKING, Particle
from rigtwin.lab.progress import Progress
from rigtwin.lab.rigs import GRAVITY
from rigtwin.lab.units import positive

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.bulk.particle_state import Grains
    from rigtwin.sim.engine.walls.shapes import Shape
    from rigtwin.sim.run.run_log import Logbook

Inside = Callable[[Array, float], npt.NDArray[np.bool_]]
"""``inside(points, clear)``: which points [m], shape (n, 3), lie in a container and over `clear` [m] from its walls."""

SKIN = 0.2  # [diameters], Verlet skin; small, as falling particles make a neighbour list short-lived
LOOK = 0.02  # [s], interval of the checks during filling
CLEAR = 1.02  # [diameters], least distance of the centres of new particles
TRIES = 20  # positions tried per particle that is due
GIVEN = "as given"  # origin of a pour rate that the user stated
NO_STATE = "The checkpoint holds no state of this run; delete it or name another file."
LONGEST_POUR = 600.0  # [s]
PATIENCE = 100  # checks in a row without room for a particle, after which filling ends
REST_LOOKS = 3  # checks in a row at rest, after which a bed counts as settled
LOOSEST, TIGHTEST = 1.35, 1.02  # [diameters], pitch of the lattice
MOST_SITES = 1e7  # of a lattice, which take half a gigabyte
MIDDLE, NOTHING = np.full(3, 0.5), np.zeros((0, 3))
THROWN = 0.2  # [m/s], standard deviation of each initial velocity component; destroys the lattice during the fall


@dataclass(frozen=True)
class Stillness:
    """Limits below which particles count as at rest."""

    energy: float  # mean kinetic energy over m g R
    speed: float  # [m/s], of the fastest


AT_REST = Stillness(1e-5, 0.01)
SETTLED = Stillness(1e-3, 0.05)  # for a filling that is about to be released


@dataclass(frozen=True)
class Outlet:
    """Round opening above the origin through which particles are poured downwards."""

    diameter: float  # [m]
    height: float  # [m], z
    rate: float  # [1/s]
    speed: float  # [m/s]
    rate_from: str  # origin of the rate, in words

    @property
    def slab(self) -> float:
        """Thickness [m] of the layer above the opening in which the particles of one interval are inserted."""
        return 1.5 * self.speed * LOOK

    @property
    def pours(self) -> str:
        """The rate in words."""
        return f"{self.rate:.0f} particles per second" if self.rate >= 100 else f"{self.rate:.3g} particles per second"

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that decide the outcome of a run, without the wording."""
        return {name: value for name, value in asdict(self).items() if name != "rate_from"}

    def draw(self, diameter: float, rng: np.random.Generator) -> Array:
        """Draw a random place in the layer above the opening.

        Parameters
        ----------
        diameter : float
            Diameter of the particle [m].
        rng : numpy.random.Generator
            Source of the numbers.

        Returns
        -------
        ndarray, shape (3,)
            The place [m].
        """
        reach = (self.diameter - diameter) / 2
        distance, angle = reach * math.sqrt(rng.random()), rng.uniform(0, 2 * math.pi)
        height = self.height + (self.slab + diameter) * rng.random()
        return np.array([distance * math.cos(angle), distance * math.sin(angle), height])


class Source(Protocol):
    """Where particles are poured: an outlet, or a region."""

    @property
    def height(self) -> float:
        """Height [m] of its lowest place."""

    @property
    def rate(self) -> float:
        """Particles per second [1/s]."""

    @property
    def speed(self) -> float:
        """Initial speed [m/s], downwards."""

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
        ...


def outlet(particle: Particle, diameter: float, height: float, rate: float | None, least: float) -> Outlet:
    """Return the outlet of a hopper.

    Parameters
    ----------
    particle : Particle
        Sphere or clump.
    diameter : float
        Diameter of the outlet [m].
    height : float
        Its height z [m].
    rate : float or None
        Particles per second [1/s]; None: by Beverloo's law, but at least `least`.
    least : float
        Smallest default rate [1/s].

    Returns
    -------
    Outlet
        The outlet.  Particles leave it at the speed of a free discharge, or faster where they would overlap.

    Raises
    ------
    BadInput
        If the outlet is narrower than two particles, or the rate is not positive.
    """
    if diameter < 2 * particle.diameter:
        raise BadInput(
            f"outlet_diameter: {diameter * 1e3:.3g} mm lets no particles of {particle.diameter * 1e3:.3g} mm through; "
            "give at least two diameters."
        )
    rate_from = GIVEN
    if rate is None:
        grain = particle.typical.equivalent_diameter
        rate = beverloo(particle, diameter, grain)
        grains = f"for grains of {grain * 1e3:.3g} mm"
        rate_from = f"Beverloo's discharge of the outlet {grains}"
        if rate < least:
            rate_from = f"{least:g} per second, above Beverloo's {rate:.0f} {grains}, to keep the run short"
            rate = least
    positive(pour_rate=rate)
    # speed of a free discharge, or more if the particles would otherwise overlap
    thinnest = rate * particle.mean_cube * particle.diameter**3 / (0.3 * diameter**2)
    return Outlet(diameter, height, rate, max(math.sqrt(GRAVITY * diameter / 2), thinnest), rate_from)


def need_end(outlet: Outlet, count: int) -> None:
    """Refuse an outlet through which the particles take more than `LONGEST_POUR`.

    Parameters
    ----------
    outlet : Outlet
        Outlet that the particles pour from.
    count : int
        Number of particles.

    Raises
    ------
    BadInput
        If they do.
    """
    if count / outlet.rate <= LONGEST_POUR:
        return
    named, advice = "count", "give fewer or a wider outlet"
    if outlet.rate_from == GIVEN:
        named, advice = "pour_rate", f"give at least {math.ceil(1e3 * count / LONGEST_POUR) / 1e3:g} per second"
    raise BadInput(f"{named}: {count} particles take {count / outlet.rate:.4g} s at {outlet.pours}; {advice}.")


def need_bearable(outlet: Outlet, fastest: float) -> None:
    """Refuse an outlet that particles leave too fast for the time step.

    Parameters
    ----------
    outlet : Outlet
        Outlet that the particles pour from.
    fastest : float
        Largest speed [m/s] that the time step allows.

    Raises
    ------
    BadInput
        If its speed is not below `fastest`.
    """
    if outlet.speed < fastest:
        return
    advice = "give a narrower outlet or a larger --stiffness-factor"
    given = outlet.rate_from == GIVEN
    if given and math.sqrt(GRAVITY * outlet.diameter / 2) < fastest:  # the rate, not the free discharge, sets the speed
        most = math.floor(0.99 * outlet.rate * fastest / outlet.speed)
        advice = f"give at most {most} per second, a wider outlet or a larger --stiffness-factor"
    named = "pour_rate: " if given else ""
    raise BadInput(
        f"{named}{outlet.pours} leave an outlet of {outlet.diameter * 1e3:.3g} mm at "
        f"{outlet.speed:.3g} m/s, but the time step allows at most {fastest:.3g} m/s; {advice}."
    )


def need_bearable_fall(name: str, fall: float, speed: float, fastest: float) -> None:
    """Refuse a height from which particles land too fast for the time step.

    Parameters
    ----------
    name : str
        Setting that the message names.
    fall : float
        Height of the fall [m].
    speed : float
        Speed [m/s] at its start.
    fastest : float
        Largest speed [m/s] that the time step allows.

    Raises
    ------
    BadInput
        If they do not land more slowly than `fastest`.
    """
    lands = math.sqrt(speed**2 + 2 * GRAVITY * fall)
    if lands >= fastest:
        raise BadInput(
            f"{name}: after a fall of {fall:.3g} m particles land at {lands:.3g} m/s, but the time step allows at most "
            f"{fastest:.3g} m/s; give a smaller height, or a larger --stiffness-factor."
        )


def arch_in_words(who: str, width: float, particle: Particle) -> str:
    """Return the warning text for particles that block the outlet of a hopper.

    Parameters
    ----------
    who : str
        The particles, in words.
    width : float
        Width of the outlet [m].
    particle : Particle
        Its diameter is used.

    Returns
    -------
    str
        A clause, without a full stop.
    """
    diameters = width / particle.diameter
    return f"{who} arch over the outlet, which is {width * 1e3:.3g} mm or {diameters:.2g} of their diameters wide"


def beverloo(particle: Particle, outlet: float, grain: float) -> float:
    """Return the discharge through a round outlet by Beverloo's law.

    Parameters
    ----------
    particle : Particle
        Its density and its mean mass are used.
    outlet : float
        Diameter D of the outlet [m].
    grain : float
        Diameter d of a particle [m]; of sizes that differ the typical one.

    Returns
    -------
    float
        Particles per second [1/s].

    Notes
    -----
    The mass flow is 0.58 rho_b sqrt(g) (D - 1.4 d)^2.5 with the bulk density rho_b = `PACKING` times the density of the
    particle.
    """
    flow: float = 0.58 * PACKING * particle.effective_density * math.sqrt(GRAVITY) * (outlet - 1.4 * grain) ** 2.5
    return flow / particle.mean_mass


@dataclass
class Filling:
    """State of a filling: settling and release; a run resumes from it and from the state of the beads."""

    settling_until: float | None = None  # [s]; None while not settling
    quiet: int = 0  # checks in a row at rest
    let_go: float | None = None  # [s], time of the release: lid, slide, tube or drum first moved
    in_time: bool = True  # whether the filling was at rest then

    def kept(self) -> dict[str, Any]:
        """The state as JSON data."""
        return dict(vars(self))

    def go_on(self, kept: dict[str, Any]) -> None:
        """Restore a state.

        Parameters
        ----------
        kept : dict
            A state that `kept` returned.

        Raises
        ------
        BadInput
            If it is none.
        """
        from pydantic import TypeAdapter

        hints, now = get_type_hints(type(self)), {}
        try:
            for name, value in kept.items():
                now[name] = TypeAdapter(hints[name]).validate_python(value, strict=True)
                if isinstance(value, float) and not math.isfinite(value):
                    raise ValueError(f"{name} is {value}")
            vars(self).update(now)
        except (KeyError, ValueError):
            raise BadInput(NO_STATE) from None


@dataclass(kw_only=True)
class Course(Filling):
    """State of pouring and settling."""

    random: np.random.Generator
    placed: int = 0
    patience: int = 0  # checks in a row without room for a particle
    size_seed: int | None = None  # from which the sizes of all particles are drawn, where they differ

    def kept(self) -> dict[str, Any]:
        """The state as JSON data, with that of the random numbers."""
        return {**super().kept(), "random": self.random.bit_generator.state}

    def go_on(self, kept: dict[str, Any]) -> None:
        """Restore a state.

        Parameters
        ----------
        kept : dict
            A state that `kept` returned.

        Raises
        ------
        BadInput
            If it lacks the state of the random numbers, as those of earlier versions do.
        """
        if "random" not in kept:
            raise BadInput("The checkpoint was written by an earlier rigtwin; delete it or name another.")
        try:
            self.random.bit_generator.state = kept["random"]
        except (KeyError, ValueError, TypeError, OverflowError):
            raise BadInput(NO_STATE) from None
        super().go_on({name: value for name, value in kept.items() if name != "random"})

    def sizes(self, count: int, particle: Particle) -> Array | None:
        """Draw the sizes of all particles at once, the same ones in each call.

        If a size were drawn for each new place, large particles would find room more rarely.

        Parameters
        ----------
        count : int
            Number of particles.
        particle : Particle
            With its distribution of sizes, if it has one.

        Returns
        -------
        ndarray, shape (count,), or None
            Size over the largest [1], in the order in which they are placed; None if all are alike.
        """
        if particle.sizes is None:
            return None
        if self.size_seed is None:
            self.size_seed = int(self.random.integers(2**32))
        return _sizes(count, particle, np.random.default_rng(self.size_seed))


def rain(
    bulk: Bulk,
    logbook: Logbook,
    course: Course,
    above: Callable[[], tuple[Outlet, Array]],
    particle: Particle,
    count: int,
    progress: Progress,
) -> None:
    """Pour particles until all are placed or no more find room; clumps get random orientations.

    Parameters
    ----------
    bulk, logbook, course : Bulk, Logbook, Course
        Simulation, its log, and the state of the filling.
    above : callable
        Returns the outlet at its present height, and the centres [m], shape (n, 3), that new particles avoid.
    particle : Particle
        Sphere or clump.
    count : int
        Number of particles.
    progress : Progress
        Callback for the progress display.
    """
    steps = max(1, round(LOOK / bulk.time_step))
    while course.placed < count and course.patience < PATIENCE:
        source, occupied = above()
        pour(bulk, course, source, occupied, particle, count)
        logbook.run(steps)
        logbook.look(course.kept())
        progress("pouring", course.placed, count)


def pour(bulk: Bulk, course: Course, source: Source, occupied: Array, particle: Particle, count: int) -> None:
    """Add the particles that are due in the interval from now on.

    Parameters
    ----------
    bulk, course : Bulk, Course
        Simulation, and the state of the filling.
    source : Source
        Where they are poured.
    occupied : ndarray, shape (n, 3)
        Centres [m] of which new particles keep clear; of sizes that differ, those in `bulk` are taken instead.
    particle : Particle
        Sphere or clump.
    count : int
        Number of particles in the whole.
    """
    sizes = course.sizes(count, particle)
    due = due_at(source, bulk.time, count) - course.placed
    wide = np.full(max(due, 0), particle.diameter)
    radii = np.full(len(occupied), particle.radius)
    if sizes is not None:
        grains = bulk.grains()
        occupied, radii = grains.position, particle.radius * np.cbrt(grains.mass / particle.mass)
        wide = particle.diameter * sizes[course.placed : course.placed + max(due, 0)]
    new = places(occupied, radii, source, wide, course.random)
    turn = None if particle.shape is None else course.random.normal(size=(len(new), 4))
    scale = None if sizes is None else sizes[course.placed : course.placed + len(new)]
    bulk.add(new, np.array([0.0, 0.0, -source.speed]), turn=turn, scale=scale)
    course.patience = 0 if len(new) or due <= 0 else course.patience + 1
    course.placed += len(new)


def due_at(source: Source, time: float, count: int) -> int:
    """Return how many particles have been poured at the end of the interval that begins now.

    Parameters
    ----------
    source : Source
        Its rate is used.
    time : float
        The time now [s].
    count : int
        Number of particles in the whole.

    Returns
    -------
    int
        At most `count`.
    """
    return min(count, math.ceil(source.rate * (time + LOOK)))


def places(
    occupied: Array,
    radii: Array,
    source: Source,
    diameters: Array,
    rng: np.random.Generator,
    *,
    in_shade: bool = True,
) -> Array:
    """Find places for new particles, clear of each other and of all others.

    Parameters
    ----------
    occupied : ndarray, shape (n, 3)
        Centres of the others [m].
    radii : ndarray, shape (n,)
        Their radii [m].
    source : Source
        Where the new ones are placed.
    diameters : ndarray, shape (k,)
        Diameters of the new ones [m], in the order in which they are placed.
    rng : numpy.random.Generator
        Source of the numbers.
    in_shade : bool
        Whether a new particle may be below another one; if not, the way down of the others is kept clear, as they
        fall faster than a new particle.

    Returns
    -------
    ndarray, shape (m, 3)
        Places [m] of the first m of the k new ones, in their order.
    """
    due = len(diameters)
    near = occupied[:, 2] > source.height - CLEAR * max(diameters.max(initial=0.0), 2 * radii.max(initial=0.0))
    taken, around = occupied[near], radii[near]
    falling = 0 if in_shade else len(taken)
    found: list[Array] = []
    for _ in range(TRIES * due):
        if len(found) == due:
            break
        diameter = float(diameters[len(found)])
        place = source.draw(diameter, rng)
        if place is None:
            continue
        apart = taken - place
        apart[:falling, 2] = np.minimum(apart[:falling, 2], 0.0)
        if ((apart**2).sum(1) > (CLEAR * (around + diameter / 2)) ** 2).all():
            taken, around = np.vstack([taken, place]), np.append(around, diameter / 2)
            found.append(place)
    return np.array(found).reshape(-1, 3)


def scatter(
    bulk: Bulk, count: int, inside: Inside, box: tuple[Array, Array], particle: Particle, random: np.random.Generator
) -> None:
    """Add particles to a simulation, in a container.

    They are placed on the loosest lattice that fits, filled from below, with a random shift from each site.

    Parameters
    ----------
    bulk : Bulk
        Simulation that the particles are added to.
    count : int
        Number of particles.
    inside : Inside
        Test for points in the container.
    box : tuple of ndarray
        Low and high corner [m] of a box around it.
    particle : Particle
        Sphere or clump; clumps get random orientations.
    random : numpy.random.Generator
        Source of the numbers.

    Raises
    ------
    BadInput
        If they do not fit in.
    """
    places, velocities, sizes = scattered(count, inside, box, particle, random)
    bulk.add(places, velocities, turn=turns_of(len(places), particle, random), scale=sizes)


def scattered(
    count: int,
    inside: Inside,
    box: tuple[Array, Array],
    particle: Particle,
    random: np.random.Generator,
    said: str = "count",
    thrown: float = THROWN,
    sizes: Array | None = None,
) -> tuple[Array, Array, Array | None]:
    """Return places, velocities and sizes of particles as `scatter` adds them.

    Parameters
    ----------
    count, inside, box, particle, random : int, Inside, tuple of ndarray, Particle, numpy.random.Generator
        As for `scatter`.
    said : str
        Setting that determines `count`, for the error message.
    thrown : float
        Standard deviation [m/s] of each component of the velocity.
    sizes : ndarray, shape (count,), optional
        Sizes over the largest [1].  Default: drawn here.

    Returns
    -------
    places : ndarray, shape (count, 3)
        Centres [m].
    velocities : ndarray, shape (count, 3)
        Velocities [m/s].
    sizes : ndarray, shape (count,), or None
        Sizes over the largest [1]; None where all are alike.

    Raises
    ------
    BadInput
        If they do not fit in.
    """
    sizes = _sizes(count, particle, random) if sizes is None else sizes
    sites, shift = _sites_of(count, inside, box, particle, sizes)
    if len(sites) < count:
        raise _too_many(count, particle, len(sites), said)
    return *_shaken(sites[:count], shift, random, thrown), sizes


def scatter_in_turns(
    bulk: Bulk,
    logbook: Logbook,
    course: Course,
    count: int,
    inside: Inside,
    box: tuple[Array, Array],
    particle: Particle,
    progress: Progress,
    said: str = "count",
) -> None:
    """Add particles as `scatter` does; those without room wait until earlier ones have fallen.

    Clumps pack denser than lattices.

    Parameters
    ----------
    bulk, logbook, course : Bulk, Logbook, Course
        Simulation, its log, and the state of the filling.
    count, inside, box, particle : int, Inside, tuple of ndarray, Particle
        As for `scatter`.
    progress : Progress
        Callback for the progress display.
    said : str
        Setting that determines `count`, for the error message.

    Raises
    ------
    BadInput
        If no more find room.
    """
    steps = max(1, round(LOOK / bulk.time_step))
    while course.placed < count:
        scatter_some(bulk, course, count, inside, box, particle)
        if course.patience > PATIENCE:
            raise _too_many(count, particle, course.placed, said)
        if course.placed < count:
            logbook.run(steps)
            logbook.look(course.kept())
            progress("filling", course.placed, count)


def scatter_some(
    bulk: Bulk,
    course: Course,
    count: int,
    inside: Inside,
    box: tuple[Array, Array],
    particle: Particle,
    thrown: float = THROWN,
) -> None:
    """Add those particles for which there is room now.

    Parameters
    ----------
    bulk, course : Bulk, Course
        Simulation, and the state of the filling.
    count, inside, box, particle : int, Inside, tuple of ndarray, Particle
        As for `scatter`; `count` is that of the whole.
    thrown : float
        Standard deviation [m/s] of each component of the velocity.
    """
    sizes = course.sizes(count, particle)
    taken = bulk.grains().position
    phase = course.random.random(3) if len(taken) else MIDDLE
    rest = None if sizes is None else sizes[course.placed :]
    new, shift = _sites_of(count - course.placed, inside, box, particle, rest, taken, phase)
    new = new[: count - course.placed]
    if len(new):
        places, velocities = _shaken(new, shift, course.random, thrown)
        scale = None if rest is None else rest[: len(new)]
        bulk.add(places, velocities, turn=turns_of(len(new), particle, course.random), scale=scale)
    course.patience = 0 if len(new) else course.patience + 1
    course.placed += len(new)


def _sites_of(
    count: int,
    inside: Inside,
    box: tuple[Array, Array],
    particle: Particle,
    sizes: Array | None,
    taken: Array = NOTHING,
    phase: Array = MIDDLE,
) -> tuple[Array, Array]:
    """Sites for the first of `count` particles, and how far [m] each may be shifted; more sites where all are alike."""
    if sizes is None:
        sites, shift = _sites(count, inside, box, particle, taken, phase)
        return sites, np.full(len(sites), shift)
    for pitch in np.linspace(LOOSEST, TIGHTEST, 12) * particle.diameter:
        blocks = _lattice(count, box, float(pitch), phase)
        blocks = blocks[inside(blocks, particle.smallest_radius)]
        if len(taken) and len(blocks):
            blocks = blocks[_clear(blocks, taken, particle.radius + pitch)]
        blocks = blocks[np.argsort(blocks[:, 2], kind="stable")]
        sites, shift_of = _cells(blocks, float(pitch), sizes * particle.radius, inside)
        if len(sites) == len(sizes):
            break
    return sites, shift_of


def _cells(blocks: Array, pitch: float, radii: Array, inside: Inside) -> tuple[Array, Array]:
    """Sites for the first of particles of different `radii` [m] in their order, and how far each may be shifted.

    A particle takes a cube of `pitch`, or one of the eight parts of such a cube, or of a part, the smallest that holds
    it as loosely as `pitch` holds the largest.
    """
    largest = radii.max()
    free: list[list[Array]] = [list(blocks[::-1])]
    corners = np.stack(np.meshgrid(*[(-0.25, 0.25)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    sites: list[Array] = []
    shifts: list[float] = []
    for radius in radii:
        level = int(math.log2(largest / radius) + 1e-9)
        free += [[] for _ in range(level + 1 - len(free))]
        shift = 0.45 * (pitch / 2**level - 2 * radius)
        while True:
            fitting = next((k for k in range(level, -1, -1) if free[k]), None)
            if fitting is None:
                return np.array(sites).reshape(-1, 3), np.array(shifts)
            cell = free[fitting].pop()
            if fitting < level:
                free[fitting + 1] += list(cell + corners[::-1] * (pitch / 2**fitting))
            elif inside(cell[None], radius + shift)[0]:
                break
        sites.append(cell)
        shifts.append(shift)
    return np.array(sites).reshape(-1, 3), np.array(shifts)


def _sites(
    count: int,
    inside: Inside,
    box: tuple[Array, Array],
    particle: Particle,
    taken: Array = NOTHING,
    phase: Array = MIDDLE,
) -> tuple[Array, float]:
    """Sites of the loosest lattice with `count` sites clear of `taken` centres, else of the tightest; lowest first.

    The lattice begins `phase` pitches from the low corner of the box.  Also returns how far [m] a site may be shifted.
    """
    for pitch in np.linspace(LOOSEST, TIGHTEST, 12) * particle.diameter:
        shift = float(0.45 * (pitch - particle.diameter))
        sites = _lattice(count, box, float(pitch), phase)
        sites = sites[inside(sites, particle.radius + shift)]
        if len(taken) and len(sites):
            sites = sites[_clear(sites, taken, particle.diameter + shift)]
        if len(sites) >= count:
            break
    return sites[np.argsort(sites[:, 2], kind="stable")], shift


def _lattice(count: int, box: tuple[Array, Array], pitch: float, phase: Array) -> Array:
    """Sites of a cubic lattice of this pitch [m] in a box, for `count` particles, shape (n, 3)."""
    low = box[0] + phase * pitch
    room = float(np.prod(np.maximum(np.ceil((box[1] - low) / pitch), 0)))
    if not room <= max(MOST_SITES, 4 * count):
        raise BadInput(
            f"the space to fill has room for {room:.2g} particles {1e3 * pitch:.3g} mm apart, and 10 million places at "
            f"most are searched for {count} of them; check the sizes of the rig and of the particle."
        )
    steps = [np.arange(begin, end, pitch) for begin, end in zip(low, box[1], strict=True)]
    return np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)


def _clear(sites: Array, taken: Array, distance: float) -> npt.NDArray[np.bool_]:
    """Which sites are at least `distance` [m] from all `taken` points."""
    from scipy.spatial import cKDTree  # not at the start of a rain, which does without

    near, _ = cKDTree(taken).query(sites, distance_upper_bound=distance)
    return np.isinf(near)


def _shaken(sites: Array, shift: Array, random: np.random.Generator, thrown: float) -> tuple[Array, Array]:
    """Places [m] near the sites, and velocities [m/s], of standard deviation `thrown` in each component."""
    far = shift[: len(sites), None]
    places = sites + random.uniform(-far, far, sites.shape) / np.sqrt(3)
    return places, random.normal(0, thrown, sites.shape)


def turns_of(count: int, particle: Particle, random: np.random.Generator) -> Array | None:
    """Draw random orientations of clumps.

    Parameters
    ----------
    count, particle, random : int, Particle, numpy.random.Generator
        As for `scatter`.

    Returns
    -------
    ndarray, shape (count, 4), or None
        Quaternions, not normalised; None for a sphere.
    """
    return None if particle.shape is None else random.normal(size=(count, 4))


def _sizes(count: int, particle: Particle, random: np.random.Generator) -> Array | None:
    """Random sizes of particles over the largest; None where all are alike."""
    return None if particle.sizes is None else particle.sizes.draw(count, random) / particle.sizes.largest


def _too_many(count: int, particle: Particle, room: int, said: str = "count") -> BadInput:
    more = f"at most {room} find room" if room else "give more room or smaller beads"
    return BadInput(f"{said}: {count} beads of {particle.diameter * 1e3:.3g} mm do not fit in; {more}.")


def loose_height(particle: Particle, count: int, diameter: float) -> float:
    """Return the height of a round container in which particles find room on the loose lattice.

    Parameters
    ----------
    particle : Particle
        Sphere or clump.
    count : int
        Number of particles.
    diameter : float
        Inner diameter of the container [m].

    Returns
    -------
    float
        Height [m].
    """
    free = math.pi / 4 * (diameter - 0.5 * particle.diameter) ** 2  # a narrow container loses its edge
    return loose_room(particle, count) / free + 2 * particle.diameter


def loose_room(particle: Particle, count: int) -> float:
    """Return the volume in which particles find room on the loose lattice.

    Parameters
    ----------
    particle : Particle
        Sphere or clump.
    count : int
        Number of particles.

    Returns
    -------
    float
        Volume [m^3].
    """
    # a particle takes up to five cubes of its diameter, or of the part of the lattice in which it fits
    cell = 1.0
    if (sizes := particle.sizes) is not None:
        cell = sizes.mean(lambda d: 8.0 ** -np.floor(np.log2(sizes.largest / d)))
    return 5 * count * cell * particle.diameter**3


def resting(grains: Grains, particle: Particle, still: Stillness = AT_REST) -> bool:
    """Return whether particles are at rest.

    Parameters
    ----------
    grains : Grains
        Particles that are checked.
    particle : Particle
        Its mean mass and its typical radius scale the limit of the energy.
    still : Stillness
        Limits of energy and speed.

    Returns
    -------
    bool
        Whether the mean kinetic energy and the fastest speed are below the limits.
    """
    mean = grains.kinetic_energy / max(len(grains.ident), 1)
    fastest = math.sqrt((grains.velocity**2).sum(1).max(initial=0.0))
    lifted = particle.mean_mass * GRAVITY * particle.typical.radius
    return mean < still.energy * lifted and fastest < still.speed


def settle(
    bulk: Bulk,
    logbook: Logbook,
    course: Filling,
    particle: Particle,
    limit: float,
    progress: Progress,
    *,
    still: Stillness = AT_REST,
    every: float = LOOK,
) -> bool:
    """Run until all particles rest, or the limit is reached.

    Parameters
    ----------
    bulk, logbook, course : Bulk, Logbook, Filling
        Simulation, its log, and the state of the filling.
    particle : Particle
        Sphere or clump.
    limit : float
        Longest wait [s].
    progress : Progress
        Callback for the progress display.
    still : Stillness
        Limits below which particles count as at rest.
    every : float
        Interval of the checks [s].

    Returns
    -------
    bool
        Whether they were at rest in `REST_LOOKS` checks in a row.
    """
    steps = max(1, round(every / bulk.time_step))
    if course.settling_until is None:
        course.settling_until = bulk.time + limit
    while bulk.time < course.settling_until and course.quiet < REST_LOOKS:
        logbook.run(steps)
        course.quiet = course.quiet + 1 if resting(bulk.grains(), particle, still) else 0
        logbook.look(course.kept())
        progress("settling", limit - (course.settling_until - bulk.time), limit)
    return course.quiet >= REST_LOOKS


def settle_and_let_go(
    bulk: Bulk,
    logbook: Logbook,
    course: Filling,
    particle: Particle,
    limit: float,
    progress: Progress,
    *,
    every: float = LOOK,
) -> None:
    """Wait until the filling is quiet enough for its release.

    `course` records the time, and whether the limit was kept.

    Parameters
    ----------
    bulk, logbook, course, particle, limit, progress : Bulk, Logbook, Filling, Particle, float, Progress
        As for `settle`.
    every : float
        Interval of the checks [s].
    """
    course.in_time = settle(bulk, logbook, course, particle, limit, progress, still=SETTLED, every=every)
    course.let_go, course.settling_until, course.quiet = bulk.time, None, 0


def need_gap(name: str, gap: float, particle: Particle) -> None:
    """Refuse a gap between two vertical walls that is too narrow for a particle.

    Parameters
    ----------
    name : str
        Setting that the message names.
    gap : float
        Width of the gap [m].
    particle : Particle
        Its diameter is used.

    Raises
    ------
    BadInput
        If the gap is narrower than 1.02 diameters.
    """
    least = TIGHTEST * particle.diameter
    if gap < least:
        raise BadInput(
            f"{name}: {gap * 1e3:.3g} mm between the end walls leave no room for particles of "
            f"{particle.diameter * 1e3:.3g} mm; give at least {math.ceil(least * 1e4) / 10:g} mm."
        )


def in_tube(diameter: float) -> Inside:
    """Return a test for points in a round tube on z = 0.

    Parameters
    ----------
    diameter : float
        Inner diameter [m].

    Returns
    -------
    Inside
        The test.
    """

    def inside(points: Array, clear: float) -> npt.NDArray[np.bool_]:
        return np.asarray((diameter / 2 - np.hypot(points[:, 0], points[:, 1]) > clear) & (points[:, 2] > clear))

    return inside


def funnel(outlet: float, diameter: float, height: float, top: float, bottom: float = 0.0) -> tuple[Shape, ...]:
    """Return the walls of a cone and of the tube above it.

    Parameters
    ----------
    outlet, diameter, height : float
        As for `in_funnel` [m].
    top : float
        Height z [m] of the upper edge of the tube.
    bottom : float
        Height z [m] of the outlet.

    Returns
    -------
    tuple of Shape
        The lid of the outlet, the cone and the tube.
    """
    from rigtwin.sim.engine.walls.shapes import Cone, Cylinder, Disc

    up, narrow, wide = (0.0, 0.0, 1.0), outlet / 2, diameter / 2
    shoulder = bottom + height
    return (
        Disc((0.0, 0.0, bottom), up, narrow),
        Cone((0.0, 0.0, bottom), up, narrow, wide, height),
        Cylinder((0.0, 0.0, shoulder), up, wide, top - shoulder),
    )


def in_funnel(outlet: float, diameter: float, height: float, bottom: float = 0.0) -> Inside:
    """Return a test for points in a cone or in the tube above it.

    Parameters
    ----------
    outlet : float
        Lower diameter of the cone [m].
    diameter : float
        Its upper diameter, that of the tube [m].
    height : float
        Height of the cone [m].
    bottom : float
        Height z [m] of the outlet.

    Returns
    -------
    Inside
        The test.
    """
    slope = (diameter - outlet) / 2 / height

    def inside(points: Array, clear: float) -> npt.NDArray[np.bool_]:
        from_axis, above = np.hypot(points[:, 0], points[:, 1]), points[:, 2] - bottom
        free = outlet / 2 + slope * above - from_axis > clear * math.hypot(1, slope)
        return np.asarray(free & (diameter / 2 - from_axis > clear) & (above > clear))

    return inside
