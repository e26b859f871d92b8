"""The class `Bulk`: simulation of thousands of spheres, single or in rigid clumps, with walls and gravity.

::

    bed = Bulk([bead], contact, walls, low=(0, 0, 0), high=(0.1, 0.1, 0.2), time_step=3.6e-5)
    bed.add(positions)
    bed.run(20_000)
    bed.beads().position
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, RigtwinError, SimulationFailed
from rigtwin.lab.materials import Contact, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import GRAVITY
from rigtwin.lab.units import positive
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.bulk import arena as areas
from rigtwin.sim.engine.bulk import checkpoint, rigid_bodies
from rigtwin.sim.engine.bulk import energy_budget as budget
from rigtwin.sim.engine.bulk import table_layout as at
from rigtwin.sim.engine.bulk.neighbour_list import LARGE
from rigtwin.sim.engine.bulk.particle_state import Beads, Grains
from rigtwin.sim.engine.bulk.thread_team import Crew
from rigtwin.sim.engine.contact import (
    IMPACT_SPEED,
    LAW_SIZE,
    OVERLAP_AT_START,
    ContactLaw,
    Mechanics,
    Rolling,
    pair_law,
)
from rigtwin.sim.engine.device import Device
from rigtwin.sim.engine.effect_terms import Active, Terms, adhesion_of, terms_of
from rigtwin.sim.engine.time_step import UNSTABLE
from rigtwin.sim.engine.walls.elements import Vector
from rigtwin.sim.engine.walls.mesh import Mesh
from rigtwin.sim.engine.walls.shapes import Motion, Shape, Wall, gaps
from rigtwin.sim.engine.walls.wall_contacts import THREADS
from rigtwin.sim.engine.walls.wall_table import KINDS, UNTIL, WANDERS, WallTable, motion_of, motion_row, wall_table

LARGEST_ARENA = 100  # largest arena in a checkpoint over the number of beads: steps of four, and eight pairs a bead
SMALLEST_ARENA = 1024  # beads; sizes of arenas are powers of four times this, so that few kernels are compiled
PAIRS_PER_BEAD, PAIRS_PER_PART = 5, 8  # reserved pairs (half the neighbours) of a single bead, and of a clump's bead
PAIRS_IN_LARGE = 4  # the same for very many single beads; a settled bed has 3.3 at the default skin
NEAR_PER_BEAD = 2  # reserved entries for walls, or parts of walls, near a bead
NEAR_IN_LARGE = 1 / 8  # the same for very many beads, few of which are near a wall
SKIN = 0.1  # [diameters of the largest particle], default Verlet skin
BEADS_PER_THREAD = 500  # with fewer an additional thread gains no speed
BEADS_IN_PARTS = 4000  # with fewer, listing takes less time than compiling the code that joins parts
LAUNCH_SECONDS = 0.25  # [s] per launch, so that progress and Ctrl-C are handled at least twice a second
STEP_IN_RADII = 0.2  # [radii], largest displacement of a bead or a wall in a step
FEW = 300  # spheres up to which testing all pairs is faster than importing SciPy


class Bulk:
    """Simulation of particles of one or more kinds among walls, in a rectangular domain.

    Parameters
    ----------
    particles : sequence of Particle
        The kinds of particles.
    contacts : Contact or mapping
        One contact for all pairs, or one per pair of kinds (a, b), a <= b.
    walls : sequence
        A `Wall` each, or a sequence of one `Wall` per kind with the same shape and motion.
    low, high : Vector
        Corners of the domain [m].
    time_step : float
        Time step [s].
    gravity : Vector
        Acceleration of gravity [m/s^2].
    rolling : {"type A", "type A explicit", "type C"}
        Rolling resistance model.
    contact_law : {"Hertz-Mindlin", "linear"}
        Contact law.
    impact_speed : float
        Impact speed [m/s] at which the springs of the "linear" law are as stiff as Hertz's contacts.
    effects : sequence of Active
        Effects that act on all single beads and contacts.
    skin : float
        Verlet skin, in diameters of the largest particle (for a clump: of the sphere of equal volume).
    open_domain : bool
        Whether beads that leave the domain are removed and counted; a clump leaves as a whole.  If False, they stop
        the run with an error.
    weighs : bool
        Whether the impulses of the particles on each wall are summed, for `impulses`.
    threads : int, optional
        Number of threads.  Default: all that the backend has.
    device : {"cpu", "cuda", "auto"}, optional
        Device of the engine.  Default: the one on which it runs already, else that of the environment variable
        RIGTWIN_DEVICE, else the CPU.
    capacity, pair_capacity, near_capacity : int, optional
        Initial sizes of the tables of beads, pairs and near walls; they grow as needed.

    Raises
    ------
    BadInput
        If an argument is out of its range; the message names it.

    Notes
    -----
    Velocity Verlet integration; contact forces as in `rigtwin.sim.engine.contact.contact_forces`.  Simulations of the
    same size share the memory of the engine: a later one takes it, and the earlier one then raises `RigtwinError`.
    The result does not depend on the number of threads, to the bit.
    """

    def __init__(
        self,
        particles: Sequence[Particle],
        contacts: Contact | Mapping[tuple[int, int], Contact],
        walls: Sequence[Wall | Sequence[Wall]] = (),
        *,
        low: Vector,
        high: Vector,
        time_step: float,
        gravity: Vector = (0.0, 0.0, -GRAVITY),
        rolling: Rolling = "type C",
        contact_law: ContactLaw = "Hertz-Mindlin",
        impact_speed: float = IMPACT_SPEED,
        effects: Sequence[Active] = (),
        skin: float = SKIN,
        open_domain: bool = False,
        weighs: bool = False,
        threads: int | None = None,
        device: Device | None = None,
        capacity: int = SMALLEST_ARENA,
        pair_capacity: int | None = None,
        near_capacity: int | None = None,
    ) -> None:
        positive(time_step=time_step, skin=skin)
        self._particles = tuple(particles)
        self._walls = [tuple(wall) if isinstance(wall, Sequence) else (wall,) * len(particles) for wall in walls]
        self._check_sizes(low, high)
        if not np.isfinite(gravity).all():
            raise BadInput(f"gravity: {tuple(gravity)} m/s^2 is not a vector of finite numbers.")
        self.time_step = time_step
        self.steps = 0
        self._added = self._spheres = 0
        self._owners = np.zeros(0, dtype=np.int64)  # particle of every sphere ever added
        self._rigid = any(particle.shape is not None for particle in self._particles)
        self._open, self._weighs = open_domain, weighs
        running = backend.start(device=device)
        self.threads = running.threads if threads is None else threads
        self._crew = Crew(running.threads)
        self.device = running.device
        self.note = running.note if device == "cuda" else ""  # reason if it does not run on the requested device
        # a clump of small spheres moves as fast as one large sphere; its neighbour list should last as long
        self._skin = skin * max(particle.equivalent_diameter for particle in self._particles)
        self._low, self._high = np.array(low, dtype=float), np.array(high, dtype=float)
        self._gravity = gravity
        self._mechanics, self._impact_speed = Mechanics(contact_law, rolling), impact_speed
        self._effects = tuple(effects)
        self._laws = self._pair_table(contacts)
        self._table = self._wall_table()
        self._check_walls_step(self._table.motion)
        size = _arena_size(capacity)
        self._rate = 200.0 / LAUNCH_SECONDS  # steps per second, updated after each launch
        near = near_capacity or _near_size(size)
        self._enter(self._room_for(size, pair_capacity or self._pair_size(size), near))

    # ------------------------------------------------------------------ public interface

    def add(
        self,
        position: Array,
        velocity: Array | None = None,
        spin: Array | None = None,
        *,
        kind: int = 0,
        turn: Array | None = None,
        scale: Array | None = None,
        overlap: float = OVERLAP_AT_START,
    ) -> None:
        """Add particles of one kind.

        Parameters
        ----------
        position : array
            Centres of mass [m], shape (k, 3).
        velocity : array, optional
            Velocities [m/s], shape (k, 3) or (3,).  Default: at rest.
        spin : array, optional
            Angular velocities [rad/s], shape (k, 3) or (3,).  Default: none.
        kind : int
            Index of the kind.
        turn : array, optional
            Orientations of clumps, shape (k, 4): quaternions (real part first) from their own axes to space.  Default:
            aligned with the axes of space.
        scale : array, optional
            Sizes of the particles over the size of the kind, shape (k,), above 0 and at most 1 [1].
        overlap : float
            Largest overlap with other particles and walls, in sphere radii [1].

        Raises
        ------
        BadInput
            If a value is not finite, a particle is outside the domain or overlaps too much, or a scale is refused.
        """
        position = np.ascontiguousarray(position, dtype=np.float64).reshape(-1, 3)
        count = len(position)
        velocity = np.zeros((count, 3)) if velocity is None else np.broadcast_to(velocity, (count, 3))
        spin = np.zeros((count, 3)) if spin is None else np.broadcast_to(spin, (count, 3))
        particle = self._particles[kind]
        finite = np.isfinite(np.hstack([position, velocity, spin])).all(1)
        if not finite.all():
            bad = self._added + int(np.argmin(finite))
            raise BadInput(f"bead {bad}: position, velocity or spin is not a finite number.")
        sizes = self._sizes(particle, scale, count)
        bodies_before = self._count(at.BODIES)
        if particle.shape is None:
            rows, members = self._single(particle, position, velocity, spin, sizes), None
        else:
            grains = rigid_bodies.new_bodies(particle, position, velocity, spin, turn, sizes)
            grains[:, rigid_bodies.IDENT], grains[:, rigid_bodies.KIND] = (
                np.arange(self._added, self._added + count),
                kind,
            )
            grains[:, rigid_bodies.VELOCITY] -= 0.5 * self.time_step * np.array(self._gravity)
            grains[:, rigid_bodies.PUSH] = self._gravity
            rows, members = rigid_bodies.new_members(particle, grains, sizes, bodies_before)
        self._check_new(rows, particle, kind, overlap)
        before = self._count(at.BEADS)
        if before + len(rows) > self._arena.capacity:
            self._grow(_arena_size(before + len(rows)), self._arena.pair_capacity, self._arena.walls.near_capacity)
        rows[:, 18] = np.arange(self._spheres, self._spheres + len(rows))
        rows[:, 19] = kind
        self._arena.put(rows, before, len(rows))
        if members is not None:
            self._arena.put_bodies(grains, bodies_before, count)
            self._arena.put_members(members, before, len(rows))
            self._arena.set_count(at.BODIES, bodies_before + count)
        if (sizes != 1).any():
            self._arena.set_count(at.MIXED, 1)
        self._arena.set_count(at.BEADS, before + len(rows))
        self._added += count
        self._spheres += len(rows)
        self._owners = np.concatenate(
            [self._owners, np.repeat(np.arange(self._added - count, self._added), len(particle.radii))]
        )

    def run(self, steps: int, progress: Progress = silent) -> None:
        """Make time steps.

        Parameters
        ----------
        steps : int
            Number of steps.
        progress : Progress
            Callback for the progress display.

        Raises
        ------
        SimulationFailed
            If a bead leaves a closed domain, or moves too fast for the time step.
        RigtwinError
            If a later simulation has taken the memory of this one.
        """
        self._mine()
        # a later simulation in another arena may have changed the parameters of the same effects
        self._arena.terms.load([self._effects])
        left = steps
        while left > 0:
            burst = int(min(left, max(1.0, self._rate * LAUNCH_SECONDS)))
            began = time.perf_counter()
            done = self._launch(burst)
            self._rate = max(1, done) / max(time.perf_counter() - began, 1e-6)
            self.steps += done
            left -= done
            self._answer_trouble()
            progress("simulating", float(steps - left), float(steps))

    def beads(self) -> Beads:
        """State of all spheres at the current time, ordered by their numbers."""
        rows = self._rows()
        rows = rows[np.argsort(rows[:, 18], kind="stable")]
        half = 0.5 * self.time_step
        velocity, spin = rows[:, 3:6] + half * rows[:, 12:15], rows[:, 6:9] + half * rows[:, 15:18]
        ident, mass, grain, grains = rows[:, 18].astype(np.int64), rows[:, 10].copy(), None, None
        if self._rigid:
            grains, grain = self.grains(), self._owners[ident]
            part = np.searchsorted(grains.ident, grain)
            spin = grains.spin[part]
            velocity = grains.velocity[part] + np.cross(spin, rows[:, 0:3] - grains.position[part])
            volume = rows[:, 9] ** 3
            mass = mass * volume / np.bincount(part, volume, minlength=len(grains.ident))[part]
        return Beads(
            ident=ident,
            kind=rows[:, 19].astype(np.int64),
            position=rows[:, 0:3].copy(),
            velocity=velocity,
            spin=spin,
            radius=rows[:, 9].copy(),
            mass=mass,
            grain=grain,
            grains=grains,
        )

    def grains(self) -> Grains:
        """State of all particles (spheres or clumps) at the current time, ordered by their numbers."""
        half = 0.5 * self.time_step
        rows = self._rows()
        rows = rows[self._members(len(rows))[:, 3] < 0] if self._rigid else rows
        turning = rows[:, 6:9] + half * rows[:, 15:18]
        whole = self._body_rows()
        velocity, spin, momentum = rigid_bodies.velocities_now(whole, self.time_step)
        ident = np.concatenate(
            [self._owners[rows[:, 18].astype(np.int64)], whole[:, rigid_bodies.IDENT].astype(np.int64)]
        )
        order = np.argsort(ident, kind="stable")
        return Grains(
            ident=ident[order],
            kind=np.concatenate([rows[:, 19], whole[:, rigid_bodies.KIND]]).astype(np.int64)[order],
            position=np.concatenate([rows[:, 0:3], whole[:, rigid_bodies.CENTRE]])[order],
            velocity=np.concatenate([rows[:, 3:6] + half * rows[:, 12:15], velocity])[order],
            spin=np.concatenate([turning, spin])[order],
            turn=np.concatenate([np.tile([1.0, 0, 0, 0], (len(rows), 1)), whole[:, rigid_bodies.TURN]])[order],
            mass=np.concatenate([rows[:, 10], whole[:, rigid_bodies.MASS]])[order],
            momentum=np.concatenate([rows[:, 11, None] * turning, momentum])[order],
        )

    def budget(self) -> budget.Budget:
        """Energies and overlaps at the current time."""
        beads = self._count(at.LISTED)
        rows, near, at_walls = self._rows(), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 3))
        if beads:  # before the first step there is no list; the kernels that read it are not compiled then
            first, pairs = self._pairs(beads)
            owner = np.repeat(np.arange(beads), np.diff(first))
            near = np.column_stack([owner, pairs[: len(owner), :2].astype(np.int64)])
            at_walls = self._wall_overlaps(rows, beads)
        return budget.measure(
            rows,
            near,
            at_walls,
            (self._laws, self._table.law),
            grains=self.grains(),
            gravity=self._gravity,
            work=self.work,
            in_flight=self.work_in_flight,
            linear=self._mechanics.linear,
            adhesion=adhesion_of(self._effects),
        )

    def state(self) -> checkpoint.State:
        """Full state of the simulation, from which it can be resumed with identical bits."""
        self._mine()
        sizes = (self._arena.capacity, self._arena.pair_capacity, self._arena.walls.near_capacity)
        own = {"sizes": np.array(sizes), "steps": np.array(self.steps), "added": np.array(self._added)}
        own["owners"] = self._owners
        return own | checkpoint.read_arena(self._arena)

    def restore(self, state: checkpoint.State) -> None:
        """Restore a `state` of a simulation that was constructed with the same arguments."""
        sizes = [int(size) for size in state["sizes"]]
        beads = max(SMALLEST_ARENA, self._arena.capacity, len(state["owners"]))
        if not (len(sizes) == 3 and all(0 < size <= LARGEST_ARENA * beads for size in sizes)):
            raise ValueError(f"an arena of the sizes {sizes}")
        self._enter(self._room_for(*sizes))
        checkpoint.write_arena(self._arena, state)
        self._table.motion[:] = self._arena.walls.motion.to_numpy()
        self.steps, self._added = int(state["steps"]), int(state["added"])
        self._owners = np.asarray(state["owners"], dtype=np.int64)
        self._spheres = len(self._owners)
        low, high = np.asarray(self._low), np.asarray(self._high)
        place = self.grains().position  # an IndexError where numbers of beads are others
        if not ((place >= 2 * low - high) & (place <= 2 * high - low)).all():
            raise ValueError("a particle far outside of the domain")
        if not (self.beads().radius > 0).all():
            raise ValueError("a particle without size")

    def remove_wall(self, wall: int) -> None:
        """Remove a wall, by its index in the order given, from the current time on."""
        self._set_motion(wall, (*self._table.motion[wall, :UNTIL], self.time, *self._table.motion[wall, UNTIL + 1 :]))

    def move_wall(self, wall: int, motion: Motion) -> None:
        """Set the motion of a wall that has not moved yet; it starts now or later, else `BadInput` is raised."""
        row = self._table.motion[wall]
        if motion.start < self.time or motion_of(row).moved_by(self.time):
            raise BadInput(f"wall {wall} has moved already, or the motion starts before {self.time:g} s; it must not.")
        new = self._table.motion.copy()
        new[wall] = motion_row(self._walls[wall][0].shape, motion, float(row[UNTIL]), self.domain)
        self._check_walls_step(new)
        self._set_motion(wall, tuple(new[wall]))

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.time_step

    @property
    def top(self) -> float:
        """z of the upper end of the domain [m]."""
        return float(self._high[2])

    @property
    def domain(self) -> tuple[Array, Array]:
        """Lower and upper corner of the domain [m]."""
        return self._low, self._high

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of particles."""
        return tuple(particle.name for particle in self._particles)

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Shapes of the walls."""
        return tuple(wall[0].shape for wall in self._walls)

    @property
    def added(self) -> int:
        """Number of particles ever added."""
        return self._added

    @property
    def gone(self) -> int:
        """Number of particles that left an open domain and were removed."""
        return self._count(at.GONE)

    @property
    def work(self) -> float:
        """Work [J] of moving walls on the beads."""
        self._mine()
        if not self.steps:
            return 0.0
        walls = self._arena.walls
        return float(walls.work_before[None] + walls.work.to_numpy().sum())

    @property
    def impulses(self) -> Array:
        """Impulse of the particles on each wall so far, and its moment, shape (walls, 6) [N s, N m s].

        The moment is about the wall's pivot, which moves with it.  Needs `weighs`.
        """
        self._mine()
        found = np.zeros((len(self._walls), 6))
        if self.steps and found.size:
            live, listed = self._count(at.LIVE_LIST), self._count(at.LISTED)
            self._arena.walls.get_impulses(found, live, listed, len(found))
        return found

    @property
    def work_in_flight(self) -> float:
        """Work [J] of the effects' forces in flight on the beads; negative for drag."""
        self._mine()
        arena = self._arena
        if not (self.steps and arena.terms.acts_in_flight):
            return 0.0
        return float(arena.flight_before[None] + arena.flight.to_numpy().sum())

    @property
    def lists_built(self) -> int:
        """Number of times that the neighbour list was built."""
        return self._count(at.BUILDS)

    @property
    def largest_overlap(self) -> float:
        """Largest overlap so far, also of beads that have left, in radii (twice the effective radius between beads)."""
        return float(self._rows()[:, 20].max(initial=self._arena.numbers[at.WORST]))

    @property
    def contacts(self) -> int:
        """Number of pairs of beads in contact."""
        beads = self._count(at.LISTED)
        _first, pairs = self._pairs(beads)
        return int(pairs[:, 1].sum())

    # ------------------------------------------------------------------ set-up

    def _check_sizes(self, low: Vector, high: Vector) -> None:
        if not 1 <= len(self._particles) <= KINDS:
            raise BadInput(f"particles: {len(self._particles)} kinds were given; possible are 1 to {KINDS}.")
        if any(len(wall) != len(self._particles) for wall in self._walls):
            raise BadInput("walls: a wall given per kind needs one entry for every kind of particle.")
        if not (np.all(np.isfinite([low, high])) and np.all(np.less(low, high))):
            raise BadInput(f"domain: low {low} must lie below high {high} on every axis, and both must be finite.")

    @property
    def _longest_step(self) -> float:
        """Largest displacement in a step [m]; with larger ones contacts would be missed and the energy diverge."""
        return STEP_IN_RADII * min(particle.smallest_radius for particle in self._particles)

    def _check_walls_step(self, motion: Array) -> None:
        way = motion[:, WANDERS] * self.time_step
        wall = int(np.argmax(way))
        if way[wall] > self._longest_step:
            raise BadInput(
                f"{self._wall_name(wall)} moves by up to {way[wall] * 1e3:.3g} mm in a step of {self.time_step:.3g} s, "
                f"more than {STEP_IN_RADII:g} radii of the smallest sphere: spheres could pass through it; "
                "let it move more slowly or give a smaller time step."
            )

    def _wall_name(self, wall: int) -> str:
        shape = self._walls[wall][0].shape
        return shape.name if isinstance(shape, Mesh) and shape.name != Mesh.name else f"wall {wall}"

    def _pair_table(self, contacts: Contact | Mapping[tuple[int, int], Contact]) -> Array:
        table = np.zeros((KINDS, KINDS, LAW_SIZE))
        for a, one in enumerate(self._particles):
            for b, other in enumerate(self._particles):
                contact = contacts if isinstance(contacts, Contact) else contacts.get((min(a, b), max(a, b)))
                if contact is None:
                    raise BadInput(f"contacts: the pair {one.name}-{other.name} has none; give its Contact.")
                table[a, b] = pair_law(one.material, other.material, contact, self._impact_speed).row
        return table

    def _wall_table(self) -> WallTable:
        return wall_table(
            self._walls, self._particles, skin=self._skin, domain=self.domain, impact_speed=self._impact_speed
        )

    def _terms(self) -> Terms:
        terms = terms_of(self._effects, "bulk")
        if terms.acts_in_flight and self._rigid:
            names = ", ".join(one.effect.name for one in self._effects)
            raise BadInput(
                f"effects: {names}: forces in flight are simulated for single spheres only; leave them out for clumps."
            )
        return terms

    def _set_motion(self, wall: int, row: tuple[float, ...]) -> None:
        self._mine()
        self._table.motion[wall] = row
        self._arena.walls.motion.from_numpy(self._table.motion)
        self._arena.set_count(
            at.WALL_COUNT, len(self._walls)
        )  # rebuilds the list, in which moving walls have a larger range

    def _room_for(self, capacity: int, pair_capacity: int, near_capacity: int) -> areas.Arena:
        return areas.arena(
            capacity,
            pair_capacity,
            near_capacity,
            self._terms(),
            self._table.room,
            self._rigid,
            self._mechanics.rolling,
            self._weighs,
        )

    def _enter(self, arena: areas.Arena) -> None:
        """Take an arena for this simulation; its earlier owner can no longer use it."""
        extent = self._high - self._low
        cell = 2 * self._largest + self._skin
        cells = np.maximum(1, np.ceil(extent / cell))
        while cells.prod() > arena.cell_capacity:
            cell *= 1.1
            cells = np.maximum(1, np.ceil(extent / cell))
        numbers = np.zeros(at.NUMBERS)
        numbers[at.STEP], numbers[at.SKIN], numbers[at.CELL] = self.time_step, self._skin, cell
        numbers[at.GRAVITY : at.GRAVITY + 3], numbers[at.LOW : at.LOW + 3] = self._gravity, self._low
        numbers[at.MOST_SPEED] = self._longest_step / self.time_step
        counts = np.zeros(at.COUNTS, dtype=np.int32)
        counts[at.WALL_COUNT] = len(self._walls)
        counts[at.OPEN], counts[at.MIXED] = int(self._open), int(self._rigid or len(self._particles) > 1)
        counts[at.NX], counts[at.NY], counts[at.NZ] = cells
        first = self._particles[0]
        mass, inertia = first.mass, float(first.moments[0])
        sizes = np.array([first.radius, mass, inertia, 1 / mass, 1 / inertia])
        arena.configure(numbers, counts, self._laws, sizes, self._mechanics.linear)
        arena.walls.load(self._table, sizes, self.time_step, self._mechanics.linear)
        arena.owner = self
        self._arena = arena

    @property
    def _largest(self) -> float:
        return max(max(particle.radii) for particle in self._particles)

    def _sizes(self, particle: Particle, scale: Array | None, count: int) -> Array:
        if scale is None:
            return np.ones(count)
        sizes = np.broadcast_to(np.asarray(scale, dtype=np.float64), (count,))
        if not ((sizes > 0) & (sizes <= 1 + 1e-12)).all():
            raise BadInput("scale: every particle must be above 0 and at most 1 times the size of its kind.")
        # the particle's own step is that of its smallest size
        own = particle.rayleigh_time_step / particle.smallest_size * sizes.min(initial=1.0)
        if self.time_step > UNSTABLE * own:
            raise BadInput(
                f"scale: a particle of {sizes.min():.3g} times the size of its kind needs a step below "
                f"{UNSTABLE:.0%} of its own Rayleigh step, {own:.3g} s."
            )
        return sizes

    def _single(self, particle: Particle, position: Array, velocity: Array, spin: Array, sizes: Array) -> Array:
        rows = np.zeros((len(position), rigid_bodies.STATE_SIZE))
        rows[:, 0:3], rows[:, 3:6], rows[:, 6:9] = position, velocity, spin
        rows[:, 9], rows[:, 10] = particle.radius * sizes, particle.mass * sizes**3
        rows[:, 11] = particle.moments[0] * sizes**5
        rows[:, 12:15] = self._gravity  # acceleration of a bead without contacts
        rows[:, 3:6] -= 0.5 * self.time_step * rows[:, 12:15]
        return rows

    def _check_new(self, rows: Array, particle: Particle, kind: int, overlap: float) -> None:
        position, radii = rows[:, 0:3], rows[:, 9]
        name = self._added + np.repeat(np.arange(len(rows) // len(particle.radii)), len(particle.radii))
        inside = ((position >= self._low) & (position <= self._high)).all(1)
        if not inside.all():
            bad = int(np.argmin(inside))
            raise BadInput(f"bead {name[bad]} starts outside the domain, at {np.round(position[bad], 6).tolist()} m.")
        tolerance = overlap * particle.smallest_radius
        for wall, row in zip(self._walls, self._table.motion, strict=False):
            if self.time >= row[UNTIL]:
                continue
            gap = gaps(wall[kind].shape, motion_of(row).undone(position, self.time), radii)
            if len(gap) and gap.min() < -tolerance:
                bad = int(np.argmin(gap))
                raise BadInput(f"bead {name[bad]} starts {-gap[bad] * 1e3:.3g} mm inside a wall; move it out.")
        self._check_overlaps(position, radii, name, tolerance)

    def _check_overlaps(self, position: Array, radii: Array, name: npt.NDArray[np.int64], tolerance: float) -> None:
        old = self._rows()
        reach = old[:, 9:10] + radii.max(initial=0.0)  # only those near the new ones are looked at
        beyond = (old[:, 0:3] < position.min(axis=0, initial=math.inf) - reach) | (
            old[:, 0:3] > position.max(axis=0, initial=-math.inf) + reach
        )
        old = old[~beyond.any(axis=1)]
        centres, sizes = np.vstack([old[:, 0:3], position]), np.concatenate([old[:, 9], radii])
        names = np.concatenate([self._owners[old[:, 18].astype(int)], name])
        near = _pairs_within(centres, 2 * sizes.max(initial=0.0))
        near = near[(near[:, 1] >= len(old)) & (names[near[:, 0]] != names[near[:, 1]])]
        gap = np.linalg.norm(centres[near[:, 0]] - centres[near[:, 1]], axis=1) - sizes[near].sum(1)
        if len(gap) and gap.min() < -tolerance:
            a, b = names[near[np.argmin(gap)]]
            raise BadInput(f"beads {a} and {b} overlap at the start by {-gap.min() * 1e3:.3g} mm; move them apart.")

    # ------------------------------------------------------------------ running

    def _launch(self, steps: int) -> int:
        """Make up to `steps` steps and return how many were made."""
        arena, beads = self._arena, self._count(at.BEADS)
        build = cache(lambda whole: backend.prepared(arena.build_list, 0.0, 1, whole))
        step = cache(lambda: backend.prepared(arena.run_team, 1, 1, 0.0, self._alike, self._mechanics))
        done = 0
        while done < steps:
            before = float(self.steps + done)
            team = 1
            if self.device != "cuda":
                team = self._crew.gather(arena, min(self.threads, beads // BEADS_PER_THREAD))
            parts = team if beads >= BEADS_IN_PARTS and not self._count(at.WHOLE) else 1
            build(parts == 1)(before, parts)
            if self.device == "cuda":
                if self._count(at.STATUS) != at.OK:
                    break
                self._burst(min(areas.BURST, steps - done), before)
            else:
                self._run_team(step(), team, steps - done, before)
            made = self._count(at.DONE)
            if not made and self._count(at.STATUS) != at.OK:
                break
            done += made
        return done

    def _run_team(self, launch: Callable[..., None], team: int, steps: int, before: float) -> None:
        """Make up to `steps` steps on a team of threads."""
        if team == 1:
            launch(team, steps, before)
            return
        began, used = time.perf_counter(), time.process_time()
        launch(team, steps, before)
        took = time.perf_counter() - began
        self._crew.watch(self._arena, team, took, time.process_time() - used, late=self._count(at.LATE) == 1)

    def _burst(self, length: int, before: float) -> None:
        """Make `length` steps with one launch each, as a GPU needs it."""
        self._arena.begin_burst(length, THREADS, before)
        make_step = backend.prepared(self._arena.run_step, self._alike, self._mechanics)
        for _ in range(length):
            make_step()
        self._arena.end_burst(length)

    def _pair_size(self, capacity: int) -> int:
        single = PAIRS_IN_LARGE if capacity > LARGE else PAIRS_PER_BEAD
        return (PAIRS_PER_PART if self._rigid else single) * capacity

    @property
    def _alike(self) -> bool:
        """Whether all beads are single spheres of one kind and size with one contact law."""
        return self._count(at.MIXED) == 0 and not self._arena.terms.changes_restitution

    def _answer_trouble(self) -> None:
        status = self._count(at.STATUS)
        if status == at.OK:
            return
        if status in (at.PAIRS_FULL, at.NEAR_FULL):
            more = 4 if self._arena.capacity < LARGE else 2
            more_pairs, more_near = (more, 1) if status == at.PAIRS_FULL else (1, more)
            sizes = more_pairs * self._arena.pair_capacity, more_near * self._arena.walls.near_capacity
            self._grow(self._arena.capacity, *sizes)
            return
        row = self._rows()[self._count(at.CULPRIT)]
        name, place = self._owners[int(row[18])], np.round(row[0:3], 6).tolist()
        where = f"bead {name} at t = {self.time:.6g} s, position {place} m"
        raise SimulationFailed(
            {
                at.LEFT_DOMAIN: f"A bead left the domain: {where}; make the domain larger or close the walls.",
                at.EXPLODED: f"The energy exploded: {where}, speed {np.linalg.norm(row[3:6]):.3g} m/s; a step of "
                f"{self.time_step:.3g} s allows at most {self._longest_step / self.time_step:.3g} m/s; "
                + (self._throwing_wall() or "use a smaller time step, or check sizes, speeds and stiffness."),
            }[status]
        )

    def _throwing_wall(self) -> str:
        """Which wall may throw beads faster than a step allows, at up to twice its own speed, and what to do."""
        speeds = self._table.motion[:, WANDERS]
        wall = int(np.argmax(speeds)) if len(speeds) else 0
        if not len(speeds) or 2 * speeds[wall] * self.time_step < self._longest_step:
            return ""
        return (
            f"{self._wall_name(wall)} moves at up to {speeds[wall]:.3g} m/s and throws beads at up to twice that: let "
            "it move more slowly or give a smaller time step."
        )

    def _grow(self, capacity: int, pair_capacity: int, near_capacity: int) -> None:
        """Move to a larger arena, with the contact histories."""
        old, beads, listed = self._arena, self._count(at.BEADS), self._count(at.LISTED)
        rows, (first, pairs), near, work = self._rows(), self._pairs(listed), self._near(listed), self.work
        in_flight, worst = self.work_in_flight, self._arena.numbers[at.WORST]
        listed_at = old.walls.listed_at.to_numpy()
        impulses = self.impulses if self._weighs else None
        kept = {column: self._count(column) for column in (at.GONE, at.BUILDS, at.BODIES, at.MIXED)}
        whole, members = self._body_rows(), self._members(beads) if self._rigid else None
        pair_capacity = max(pair_capacity, self._pair_size(capacity))
        near_capacity = max(near_capacity, _near_size(capacity))
        self._enter(self._room_for(capacity, pair_capacity, near_capacity))
        for column, value in {**kept, at.BEADS: beads}.items():
            self._arena.set_count(column, value)
        self._arena.put(rows, 0, beads)
        if members is not None:
            self._arena.put_bodies(whole, 0, len(whole))
            self._arena.put_members(members, 0, beads)
        self._arena.put_pairs(first, pairs, listed)
        self._arena.walls.put_list(*near, self._count(at.LIVE_LIST), listed)
        self._arena.numbers[at.WORST] = worst
        self._arena.walls.work_before[None] = work
        if impulses is not None:
            for wall, impulse in enumerate(impulses.tolist()):
                self._arena.walls.impulse_before[wall] = impulse
        if self._arena.terms.acts_in_flight:
            self._arena.flight_before[None] = in_flight
        self._arena.walls.listed_at.from_numpy(listed_at)
        old.owner = None

    def _count(self, column: int) -> int:
        self._mine()
        return int(self._arena.counts[column])

    def _rows(self) -> Array:
        beads = self._count(at.BEADS)
        rows = np.zeros((beads, rigid_bodies.STATE_SIZE))
        if beads:
            self._arena.get(rows, beads)
        return rows

    def _near(self, beads: int) -> tuple[npt.NDArray[np.int32], Array]:
        live, walls = self._count(at.LIVE_LIST), self._arena.walls
        first = np.zeros(beads + 1, dtype=np.int32)
        near = np.zeros((max(1, walls.first[live, beads]), 9))
        walls.get_list(first, near, live, beads)
        return first, near

    def _wall_overlaps(self, rows: Array, beads: int) -> Array:
        """Present contacts with walls: bead, wall, overlap [m], shape (n, 3)."""
        first, near = self._near(beads)
        overlap = np.zeros(len(near))
        place = np.ascontiguousarray(rows[:, [0, 1, 2, 9]]) if len(rows) else np.zeros((1, 4))
        counts = (self._count(at.LIVE_LIST), beads, len(self._walls))
        self._arena.walls.get_contacts(place, overlap, *counts, self.time, self.time_step)
        owner = np.repeat(np.arange(beads), np.diff(first))
        found = np.stack([owner, near[: len(owner), 8], overlap[: len(owner)]], axis=1)
        return np.asarray(found[found[:, 2] != 0])

    def _body_rows(self) -> Array:
        count = self._count(at.BODIES) if self._rigid else 0
        rows = np.zeros((max(count, 1), rigid_bodies.BODY_SIZE))
        if count:
            self._arena.get_bodies(rows, count)
        return rows[:count]

    def _members(self, beads: int) -> Array:
        members = np.zeros((max(beads, 1), rigid_bodies.MEMBER_SIZE))
        self._arena.get_members(members, beads)
        return members[:beads]

    def _pairs(self, beads: int) -> tuple[npt.NDArray[np.int32], Array]:
        first = np.zeros(beads + 1, dtype=np.int32)
        pairs = np.zeros((self._arena.pair_capacity, 9))
        self._arena.get_pairs(first, pairs, beads)
        return first, pairs[: max(1, int(first[beads]))]

    def _mine(self) -> None:
        if self._arena.owner is not self:
            raise RigtwinError(
                "The memory of this simulation was taken by a later one of the same size; run them one after the other."
            )


def _arena_size(beads: int) -> int:
    size = SMALLEST_ARENA
    while size < beads:
        size *= 4
    return size


def _near_size(capacity: int) -> int:
    return int(max(min(NEAR_PER_BEAD * capacity, 32_768), NEAR_IN_LARGE * capacity))


def _pairs_within(centres: Array, distance: float) -> npt.NDArray[np.int64]:
    """Indices of all pairs within `distance` [m], the lower one first, shape (n, 2)."""
    if len(centres) <= FEW:
        pairs = np.stack(np.triu_indices(len(centres), 1), axis=1)
        return np.asarray(pairs[np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1) <= distance])
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(centres).query_pairs(distance, output_type="ndarray"))
