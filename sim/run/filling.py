"""Filling a rig: particles are poured from an outlet or placed in a container without overlap, and settle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import PACKING, Particle
from rigtwin.lab.progress import Progress
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.engine.time_step import positive

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
LONGEST_POUR = 600.0  # [s]
PATIENCE = 100  # checks in a row without room for a particle, after which filling ends
REST_LOOKS = 3  # checks in a row at rest, after which a bed counts as settled
LOOSEST, TIGHTEST = 1.35, 1.02  # [diameters], pitch of the lattice
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
        """A random place [m] in the layer above the opening for a particle of this `diameter` [m]."""
        reach = (self.diameter - diameter) / 2
        distance, angle = reach * math.sqrt(rng.random()), rng.uniform(0, 2 * math.pi)
        height = self.height + (self.slab + diameter) * rng.random()
        return np.array([distance * math.cos(angle), distance * math.sin(angle), height])


class Source(Protocol):
    """Where particles are poured: an outlet, or a region."""

    @property
    def height(self) -> float: ...  # [m], of its lowest place
    @property
    def rate(self) -> float: ...  # [1/s]
    @property
    def speed(self) -> float: ...  # [m/s], downwards

    def draw(self, diameter: float, rng: np.random.Generator) -> Array | None:
        """A random place [m] for a particle of this `diameter` [m]; None where it would touch a wall."""
        ...


def outlet(particle: Particle, diameter: float, height: float, rate: float | None, least: float) -> Outlet:
    """Outlet of a hopper; default `rate` [1/s]: Beverloo's law, but at least `least`."""
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
    """Refuse an outlet through which `count` particles take more than `LONGEST_POUR`."""
    if count / outlet.rate <= LONGEST_POUR:
        return
    named, advice = "count", "give fewer or a wider outlet"
    if outlet.rate_from == GIVEN:
        named, advice = "pour_rate", f"give at least {math.ceil(1e3 * count / LONGEST_POUR) / 1e3:g} per second"
    raise BadInput(f"{named}: {count} particles take {count / outlet.rate:.4g} s at {outlet.pours}; {advice}.")


def need_bearable(outlet: Outlet, fastest: float) -> None:
    """Refuse an outlet that particles leave at `fastest` [m/s] or more, too fast for the time step."""
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
    """Refuse the setting `name` if particles released at `speed` [m/s] land too fast after a `fall` [m]."""
    lands = math.sqrt(speed**2 + 2 * GRAVITY * fall)
    if lands >= fastest:
        raise BadInput(
            f"{name}: after a fall of {fall:.3g} m particles land at {lands:.3g} m/s, but the time step allows at most "
            f"{fastest:.3g} m/s; give a smaller height, or a larger --stiffness-factor."
        )


def arch_in_words(who: str, width: float, particle: Particle) -> str:
    """Warning text for particles that block the outlet of a hopper, `width` [m] wide."""
    diameters = width / particle.diameter
    return f"{who} arch over the outlet, which is {width * 1e3:.3g} mm or {diameters:.2g} of their diameters wide"


def beverloo(particle: Particle, outlet: float, grain: float) -> float:
    """Particles per second through a round outlet of diameter `outlet` [m], by Beverloo's law.

    Mass flow 0.58 rho_b sqrt(g) (D - 1.4 d)^2.5 with d = `grain` [m] and the bulk density rho_b = `PACKING` times the
    density of the particle; of sizes that differ `grain` is the typical one, and the mass of one the mean.
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
        """Restore a state from `kept`."""
        vars(self).update(kept)


@dataclass(kw_only=True)
class Course(Filling):
    """State of pouring and settling."""

    random: np.random.Generator
    placed: int = 0
    patience: int = 0  # checks in a row without room for a particle
    size_seed: int | None = None  # from which the sizes of all particles are drawn, where they differ

    def kept(self) -> dict[str, Any]:
        return {**super().kept(), "random": self.random.bit_generator.state}

    def go_on(self, kept: dict[str, Any]) -> None:
        if "random" not in kept:
            raise BadInput("The checkpoint was written by an earlier rigtwin; delete it or name another.")
        self.random.bit_generator.state = kept["random"]
        super().go_on({name: value for name, value in kept.items() if name != "random"})

    def sizes(self, count: int, particle: Particle) -> Array | None:
        """Sizes of all `count` particles over the largest, in the order in which they are placed; None if all alike.

        Drawn at once: if a size were drawn for each new place, large particles would find room more rarely.
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
    """Pour particles until `count` are placed or no more find room; clumps get random orientations.

    `above` returns the outlet at its present height, and the centres [m], shape (n, 3), that new particles avoid.
    """
    steps = max(1, round(LOOK / bulk.time_step))
    while course.placed < count and course.patience < PATIENCE:
        source, occupied = above()
        pour(bulk, course, source, occupied, particle, count)
        logbook.run(steps)
        logbook.look(course.kept())
        progress("pouring", course.placed, count)


def pour(bulk: Bulk, course: Course, source: Source, occupied: Array, particle: Particle, count: int) -> None:
    """Add the particles of `count` that are due in the interval from now on, clear of centres `occupied` [m]."""
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
    """Number of the `count` particles that the outlet has poured at the end of the interval from `time` [s]."""
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
    """Positions [m] in the layer above the outlet for the first of particles of these `diameters` [m].

    They are clear of each other and of all particles at `occupied`, which have `radii`; without `in_shade` also of the
    way down of these, which fall faster than a new particle.
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
    """Add `count` particles to a simulation, in the container, which lies in the `box` [m].

    They are placed on the loosest lattice that fits, filled from below, with a random shift from each site.
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
    """Places [m] and velocities [m/s] of particles as `scatter` adds them, both of shape (count, 3), and their sizes.

    Sizes are over the largest, None where all are alike.  `said` is the setting that determines `count`, for the error
    message; `thrown` [m/s] the standard deviation of each component of the velocity.  `sizes`, where they are drawn
    already, take the place of new ones.
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
    """As `scatter`, but particles without room wait until earlier ones have fallen: clumps pack denser than lattices.

    `said` is the setting that determines `count`, for the error message.
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
    """Add those of `count` particles for which there is room now; the arguments are those of `scatter_in_turns`."""
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
        steps = [np.arange(low + part * pitch, high, pitch) for low, high, part in zip(*box, phase, strict=True)]
        blocks = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
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
        steps = [np.arange(low + part * pitch, high, pitch) for low, high, part in zip(*box, phase, strict=True)]
        sites = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        sites = sites[inside(sites, particle.radius + shift)]
        if len(taken) and len(sites):
            sites = sites[_clear(sites, taken, particle.diameter + shift)]
        if len(sites) >= count:
            break
    return sites[np.argsort(sites[:, 2], kind="stable")], shift


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
    """Random orientations of clumps, quaternions of shape (count, 4)."""
    return None if particle.shape is None else random.normal(size=(count, 4))


def _sizes(count: int, particle: Particle, random: np.random.Generator) -> Array | None:
    """Random sizes of particles over the largest; None where all are alike."""
    return None if particle.sizes is None else particle.sizes.draw(count, random) / particle.sizes.largest


def _too_many(count: int, particle: Particle, room: int, said: str = "count") -> BadInput:
    more = f"at most {room} find room" if room else "give more room or smaller beads"
    return BadInput(f"{said}: {count} beads of {particle.diameter * 1e3:.3g} mm do not fit in; {more}.")


def loose_height(particle: Particle, count: int, diameter: float) -> float:
    """Height [m] of a round container in which `count` particles find room on the loose lattice."""
    free = math.pi / 4 * (diameter - 0.5 * particle.diameter) ** 2  # a narrow container loses its edge
    return loose_room(particle, count) / free + 2 * particle.diameter


def loose_room(particle: Particle, count: int) -> float:
    """Volume [m^3] in which `count` particles find room on the loose lattice."""
    # a particle takes up to five cubes of its diameter, or of the part of the lattice in which it fits
    cell = 1.0
    if (sizes := particle.sizes) is not None:
        cell = sizes.mean(lambda d: 8.0 ** -np.floor(np.log2(sizes.largest / d)))
    return 5 * count * cell * particle.diameter**3


def resting(grains: Grains, particle: Particle, still: Stillness = AT_REST) -> bool:
    """Whether the particles are at rest."""
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
    """Run until all particles rest, with a check `every` [s]; False if they still move after `limit` [s]."""
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
    """Wait until the filling is quiet enough for its release; record the time, and whether the limit was kept."""
    course.in_time = settle(bulk, logbook, course, particle, limit, progress, still=SETTLED, every=every)
    course.let_go, course.settling_until, course.quiet = bulk.time, None, 0


def need_gap(name: str, gap: float, particle: Particle) -> None:
    """Refuse the setting `name`, a `gap` [m] between two vertical walls, if it is too narrow for a particle."""
    least = TIGHTEST * particle.diameter
    if gap < least:
        raise BadInput(
            f"{name}: {gap * 1e3:.3g} mm between the end walls leave no room for particles of "
            f"{particle.diameter * 1e3:.3g} mm; give at least {math.ceil(least * 1e4) / 10:g} mm."
        )


def in_tube(diameter: float) -> Inside:
    """Test for points in a round tube on z = 0."""

    def inside(points: Array, clear: float) -> npt.NDArray[np.bool_]:
        return np.asarray((diameter / 2 - np.hypot(points[:, 0], points[:, 1]) > clear) & (points[:, 2] > clear))

    return inside


def funnel(outlet: float, diameter: float, height: float, top: float, bottom: float = 0.0) -> tuple[Shape, ...]:
    """Walls of a cone as in `in_funnel` and of the tube above it up to z = `top` [m], the lid of the outlet first."""
    from rigtwin.sim.engine.walls.shapes import Cone, Cylinder, Disc

    up, narrow, wide = (0.0, 0.0, 1.0), outlet / 2, diameter / 2
    shoulder = bottom + height
    return (
        Disc((0.0, 0.0, bottom), up, narrow),
        Cone((0.0, 0.0, bottom), up, narrow, wide, height),
        Cylinder((0.0, 0.0, shoulder), up, wide, top - shoulder),
    )


def in_funnel(outlet: float, diameter: float, height: float, bottom: float = 0.0) -> Inside:
    """Test for points in a cone of `height` [m] that widens from `outlet` to `diameter` [m], or in the tube above it.

    The outlet is at z = `bottom` [m].
    """
    slope = (diameter - outlet) / 2 / height

    def inside(points: Array, clear: float) -> npt.NDArray[np.bool_]:
        from_axis, above = np.hypot(points[:, 0], points[:, 1]), points[:, 2] - bottom
        free = outlet / 2 + slope * above - from_axis > clear * math.hypot(1, slope)
        return np.asarray(free & (diameter / 2 - from_axis > clear) & (above > clear))

    return inside
