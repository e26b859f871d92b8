"""The bulk engine: thousands of spheres, walls, gravity.

::

    bed = Bulk([bead], contact, walls, low=(0, 0, 0), high=(0.1, 0.1, 0.2), time_step=3.6e-5)
    bed.add(positions)
    bed.run(20_000)
    bed.beads().position
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.lab.materials import Contact, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.engine import arena as at
from rigtwin.sim.engine import backend, budget, checkpoint
from rigtwin.sim.engine.clock import positive
from rigtwin.sim.engine.contact import LAW_SIZE, ROLLING, Rolling, pair_law
from rigtwin.sim.engine.elements import Vector
from rigtwin.sim.engine.terms import Active, Terms, terms_of
from rigtwin.sim.engine.wall_contacts import KINDS, WallTable, wall_table
from rigtwin.sim.engine.walls import Shape, Wall, gaps

Array = npt.NDArray[np.float64]

SMALLEST_ARENA = 1024  # beads; arenas come in steps of four, so that few kernels are ever compiled
PAIRS_PER_BEAD = 8  # half the neighbours of a bead, with room
NEAR_PER_BEAD = 2  # walls, or parts of them, near a bead on average, with room
SKIN = 0.1  # of the largest diameter
THREADED_FROM = 2000  # beads; below, one thread is faster than the launches cost
LAUNCH_SECONDS = 0.25  # kernels come back at least twice a second, so that progress and Ctrl-C work
OVERLAP_AT_START = 1e-3  # of a radius; more is a blunder


class SimulationFailed(RigtwinError):
    """A running simulation broke down; the message names the bead and the time."""


@dataclass(frozen=True)
class Beads:
    """State of all beads, in the order of their names."""

    ident: npt.NDArray[np.int64]  # number in the order of adding
    kind: npt.NDArray[np.int64]  # index of the particle
    position: Array  # [m], shape (n, 3)
    velocity: Array  # [m/s], shape (n, 3)
    spin: Array  # [rad/s], shape (n, 3)
    radius: Array  # [m]
    mass: Array  # [kg]

    @property
    def kinetic_energy(self) -> float:
        """Of translation and rotation [J]."""
        inertia = 0.4 * self.mass * self.radius**2
        return float(0.5 * np.sum(self.mass * (self.velocity**2).sum(1) + inertia * (self.spin**2).sum(1)))


class Bulk:
    """Spheres of some kinds among walls, in a box that none may leave."""

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
        effects: Sequence[Active] = (),
        skin: float = SKIN,
        open_domain: bool = False,
        threads: int | None = None,
        capacity: int = SMALLEST_ARENA,
        pair_capacity: int | None = None,
        near_capacity: int | None = None,
    ) -> None:
        """`particles` are the kinds; `contacts` one for all, or one per pair of kinds (a, b), a <= b.

        A wall may be a sequence with one `Wall` per kind, alike but for material and contact.  `low` and `high` [m]
        bound the domain; in an open one beads that leave are taken out and counted, else they stop the run.  `skin`
        is in units of the largest diameter.  `effects` act on all beads and contacts.
        """
        positive(time_step=time_step, skin=skin)
        self._particles = tuple(particles)
        self._walls = [tuple(wall) if isinstance(wall, Sequence) else (wall,) * len(particles) for wall in walls]
        self._check_sizes(low, high, rolling)
        self.time_step = time_step
        self.steps = 0
        self._added = 0
        self._open = open_domain
        running = backend.start()
        self.threads = running.threads if threads is None else threads
        self._on_gpu = running.device == "cuda"
        self._skin = skin * 2 * max(particle.radius for particle in particles)
        self._low, self._high = np.array(low, dtype=float), np.array(high, dtype=float)
        self._gravity = gravity
        self._rolling = rolling
        self._effects = tuple(effects)
        self._laws = self._pair_table(contacts)
        self._table = self._wall_table()
        size = _arena_size(capacity)
        self._rate = 200.0 / LAUNCH_SECONDS  # steps per second, learnt from the launches
        self._enter(
            at.arena(
                size,
                pair_capacity or PAIRS_PER_BEAD * size,
                near_capacity or NEAR_PER_BEAD * size,
                self._terms(),
                self._table.room,
            )
        )

    # ------------------------------------------------------------------ what a user does

    def add(
        self,
        position: Array,
        velocity: Array | None = None,
        spin: Array | None = None,
        *,
        kind: int = 0,
        overlap: float = OVERLAP_AT_START,
    ) -> None:
        """Add beads of one kind at `position` [m], shape (k, 3); overlaps above `overlap` radii are refused."""
        position = np.ascontiguousarray(position, dtype=np.float64).reshape(-1, 3)
        count = len(position)
        velocity = np.zeros((count, 3)) if velocity is None else np.broadcast_to(velocity, (count, 3))
        spin = np.zeros((count, 3)) if spin is None else np.broadcast_to(spin, (count, 3))
        particle = self._particles[kind]
        self._check_new(np.hstack([position, velocity, spin]), particle, kind, overlap)
        before = self._count(at.BEADS)
        if before + count > self._arena.capacity:
            self._grow(_arena_size(before + count), self._arena.pair_capacity, self._arena.walls.near_capacity)
        rows = np.zeros((count, at.STATE_SIZE))
        rows[:, 0:3], rows[:, 3:6], rows[:, 6:9] = position, velocity, spin
        rows[:, 9:12] = particle.radius, particle.mass, 0.4 * particle.mass * particle.radius**2
        rows[:, 12:15] = self._gravity  # a bead that touches nothing falls
        rows[:, 3:6] -= 0.5 * self.time_step * rows[:, 12:15]
        rows[:, 18] = np.arange(self._added, self._added + count)
        rows[:, 19] = kind
        self._arena.put(rows, before, count)
        self._arena.set_count(at.BEADS, before + count)
        self._arena.set_stale()
        self._added += count

    def run(self, steps: int, progress: Progress = silent) -> None:
        """Make `steps` steps.  Raises `SimulationFailed` when a bead leaves the domain or the energy explodes."""
        self._mine()
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
        """State of all beads now."""
        rows = self._rows()
        rows = rows[np.argsort(rows[:, 18], kind="stable")]
        half = 0.5 * self.time_step
        return Beads(
            ident=rows[:, 18].astype(np.int64),
            kind=rows[:, 19].astype(np.int64),
            position=rows[:, 0:3].copy(),
            velocity=rows[:, 3:6] + half * rows[:, 12:15],
            spin=rows[:, 6:9] + half * rows[:, 15:18],
            radius=rows[:, 9].copy(),
            mass=rows[:, 10].copy(),
        )

    def budget(self) -> budget.Budget:
        """Energies and overlaps now."""
        beads = self._count(at.LISTED)
        first, pairs = self._pairs(beads)
        owner = np.repeat(np.arange(beads), np.diff(first))
        near = np.stack([owner, pairs[: len(owner), 0].astype(np.int64)], axis=1)
        rows = self._rows()
        return budget.measure(
            rows,
            near,
            self._wall_overlaps(rows, beads),
            (self._laws, self._table.law),
            gravity=self._gravity,
            time_step=self.time_step,
            work=self.work,
        )

    def state(self) -> checkpoint.State:
        """All that the next step depends on."""
        self._mine()
        sizes = (self._arena.capacity, self._arena.pair_capacity, self._arena.walls.near_capacity)
        own = {"sizes": np.array(sizes), "steps": np.array(self.steps), "added": np.array(self._added)}
        return own | checkpoint.read_arena(self._arena)

    def restore(self, state: checkpoint.State) -> None:
        """Go on from a `state` of a simulation that was made in the same way."""
        self._enter(at.arena(*map(int, state["sizes"]), self._terms(), self._table.room))
        checkpoint.write_arena(self._arena, state)
        self.steps, self._added = int(state["steps"]), int(state["added"])

    @property
    def time(self) -> float:
        """[s]"""
        return self.steps * self.time_step

    @property
    def top(self) -> float:
        """Upper end of the domain [m]."""
        return float(self._high[2])

    @property
    def domain(self) -> tuple[Array, Array]:
        """Lower and upper corner [m]."""
        return self._low, self._high

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of particles."""
        return tuple(particle.name for particle in self._particles)

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The walls."""
        return tuple(wall[0].shape for wall in self._walls)

    @property
    def added(self) -> int:
        """Beads that were ever added."""
        return self._added

    @property
    def gone(self) -> int:
        """Beads that left an open domain and were taken out."""
        return self._count(at.GONE)

    @property
    def work(self) -> float:
        """Energy [J] that moving walls have given to the beads."""
        self._mine()
        walls = self._arena.walls
        return float(walls.work_before[None] + walls.work.to_numpy().sum())

    @property
    def lists_built(self) -> int:
        """How often the neighbour list was built."""
        return self._count(at.BUILDS)

    @property
    def largest_overlap(self) -> float:
        """Largest overlap so far, in radii (twice the effective radius between beads)."""
        rows = self._rows()
        return float(rows[:, 20].max()) if len(rows) else 0.0

    @property
    def contacts(self) -> int:
        """Pairs of beads that touch now."""
        beads = self._count(at.LISTED)
        _first, pairs = self._pairs(beads)
        return int(pairs[:, 1].sum())

    # ------------------------------------------------------------------ set-up

    def _check_sizes(self, low: Vector, high: Vector, rolling: Rolling) -> None:
        if not 1 <= len(self._particles) <= KINDS:
            raise BadInput(f"particles: {len(self._particles)} kinds were given; possible are 1 to {KINDS}.")
        if any(len(wall) != len(self._particles) for wall in self._walls):
            raise BadInput("walls: a wall given per kind needs one entry for every kind of particle.")
        if rolling not in ROLLING:
            raise BadInput(f"rolling: {rolling!r} is unknown; use one of {', '.join(map(repr, ROLLING))}.")
        if not (np.all(np.isfinite([low, high])) and np.all(np.less(low, high))):
            raise BadInput(f"domain: low {low} must lie below high {high} on every axis, and both must be finite.")

    def _pair_table(self, contacts: Contact | Mapping[tuple[int, int], Contact]) -> Array:
        table = np.zeros((KINDS, KINDS, LAW_SIZE))
        for a, one in enumerate(self._particles):
            for b, other in enumerate(self._particles):
                contact = contacts if isinstance(contacts, Contact) else contacts.get((min(a, b), max(a, b)))
                if contact is None:
                    raise BadInput(f"contacts: the pair {one.name}-{other.name} has none; give its Contact.")
                table[a, b] = pair_law(one.material, other.material, contact).row
        return table

    def _wall_table(self) -> WallTable:
        return wall_table(self._walls, self._particles, skin=self._skin, domain=self.domain)

    def _terms(self) -> Terms:
        return terms_of(self._effects, "bulk")

    def _enter(self, arena: at.Arena) -> None:
        """Take an arena for this simulation; whoever had it before has lost it."""
        extent = self._high - self._low
        cell = 2 * max(particle.radius for particle in self._particles) + self._skin
        cells = np.maximum(1, np.ceil(extent / cell))
        while cells.prod() > arena.cell_capacity:
            cell *= 1.1
            cells = np.maximum(1, np.ceil(extent / cell))
        numbers = np.zeros(at.NUMBERS)
        numbers[at.STEP], numbers[at.SKIN], numbers[at.CELL] = self.time_step, self._skin, cell
        numbers[at.GRAVITY : at.GRAVITY + 3], numbers[at.LOW : at.LOW + 3] = self._gravity, self._low
        # no bead may cross a fifth of its radius in a step: contacts would be missed, energy would explode
        numbers[at.MOST_SPEED] = 0.2 * min(particle.radius for particle in self._particles) / self.time_step
        counts = np.zeros(at.COUNTS, dtype=np.int32)
        counts[at.WALL_COUNT] = len(self._walls)
        counts[at.OPEN] = int(self._open)
        counts[at.CONSTANT_TORQUE] = int(self._rolling == ROLLING[0])
        counts[at.NX], counts[at.NY], counts[at.NZ] = cells
        arena.configure(numbers, counts, self._laws)
        arena.walls.load(self._table)
        arena.owner = self
        self._arena = arena

    def _check_new(self, state: Array, particle: Particle, kind: int, overlap: float) -> None:
        first, position = self._added, state[:, :3]
        finite = np.isfinite(state).all(1)
        if not finite.all():
            raise BadInput(f"bead {first + int(np.argmin(finite))}: position, velocity or spin is not a finite number.")
        inside = ((position >= self._low) & (position <= self._high)).all(1)
        if not inside.all():
            bad = int(np.argmin(inside))
            raise BadInput(f"bead {first + bad} starts outside the domain, at {np.round(position[bad], 6).tolist()} m.")
        radii = np.full(len(position), particle.radius)
        tolerance = overlap * particle.radius
        for wall in self._walls:
            motion = wall[0].motion
            if self.time >= wall[0].until:
                continue
            gap = gaps(wall[kind].shape, motion.undone(position, self.time) if motion else position, radii)
            if len(gap) and gap.min() < -tolerance:
                bad = int(np.argmin(gap))
                raise BadInput(f"bead {first + bad} starts {-gap[bad] * 1e3:.3g} mm inside a wall; move it out.")
        self._check_overlaps(position, radii, tolerance)

    def _check_overlaps(self, position: Array, radii: Array, tolerance: float) -> None:
        from scipy.spatial import cKDTree

        old = self._rows()
        centres, sizes = np.vstack([old[:, 0:3], position]), np.concatenate([old[:, 9], radii])
        names = np.concatenate([old[:, 18].astype(int), np.arange(self._added, self._added + len(position))])
        near = cKDTree(centres).query_pairs(2 * sizes.max(), output_type="ndarray")
        near = near[near[:, 1] >= len(old)]
        gap = np.linalg.norm(centres[near[:, 0]] - centres[near[:, 1]], axis=1) - sizes[near].sum(1)
        if len(gap) and gap.min() < -tolerance:
            a, b = names[near[np.argmin(gap)]]
            raise BadInput(f"beads {a} and {b} overlap at the start by {-gap.min() * 1e3:.3g} mm; move them apart.")

    # ------------------------------------------------------------------ running

    def _launch(self, steps: int) -> int:
        """Make up to `steps` steps and say how many were made."""
        arena = self._arena
        done = 0
        while done < steps:
            before = float(self.steps + done)
            arena.build_alone(before)
            if self._count(at.STATUS) != at.OK:
                break
            beads = self._count(at.BEADS)
            if not self._on_gpu and (self.threads == 1 or beads < THREADED_FROM):
                arena.run_serial(steps - done, before)
            else:
                length = min(at.BURST, steps - done)
                for s in range(length):
                    arena.run_step(s, beads, before)
                arena.end_burst(length)
            done += self._count(at.DONE)
        return done

    def _answer_trouble(self) -> None:
        status = self._count(at.STATUS)
        if status == at.OK:
            return
        if status in (at.PAIRS_FULL, at.NEAR_FULL):
            more_pairs, more_near = (4, 1) if status == at.PAIRS_FULL else (1, 4)
            sizes = more_pairs * self._arena.pair_capacity, more_near * self._arena.walls.near_capacity
            self._grow(self._arena.capacity, *sizes)
            return
        row = self._rows()[self._count(at.CULPRIT)]
        where = f"bead {int(row[18])} at t = {self.time:.6g} s, position {np.round(row[0:3], 6).tolist()} m"
        raise SimulationFailed(
            {
                at.LEFT_DOMAIN: f"A bead left the domain: {where}; make the domain larger or close the walls.",
                at.EXPLODED: f"The energy exploded: {where}, speed {np.linalg.norm(row[3:6]):.3g} m/s; "
                "use a smaller time step.",
            }[status]
        )

    def _grow(self, capacity: int, pair_capacity: int, near_capacity: int) -> None:
        """Move to a larger arena, history and all."""
        old, beads, listed = self._arena, self._count(at.BEADS), self._count(at.LISTED)
        rows, (first, pairs), near, work = self._rows(), self._pairs(listed), self._near(listed), self.work
        listed_at = old.walls.listed_at.to_numpy()
        kept = {column: self._count(column) for column in (at.GONE, at.BUILDS)}
        pair_capacity = max(pair_capacity, PAIRS_PER_BEAD * capacity)
        near_capacity = max(near_capacity, NEAR_PER_BEAD * capacity)
        self._enter(at.arena(capacity, pair_capacity, near_capacity, self._terms(), self._table.room))
        for column, value in {**kept, at.BEADS: beads}.items():
            self._arena.set_count(column, value)
        self._arena.put(rows, 0, beads)
        self._arena.put_pairs(first, pairs, listed)
        self._arena.walls.put_list(*near, self._count(at.LIVE_LIST), listed)
        self._arena.walls.work_before[None] = work
        self._arena.walls.listed_at.from_numpy(listed_at)
        self._arena.set_stale()
        old.owner = None

    def _count(self, column: int) -> int:
        self._mine()
        return int(self._arena.counts[column])

    def _rows(self) -> Array:
        beads = self._count(at.BEADS)
        rows = np.zeros((max(beads, 1), at.STATE_SIZE))
        self._arena.get(rows, beads)
        return rows[:beads]

    def _near(self, beads: int) -> tuple[npt.NDArray[np.int32], Array]:
        live, walls = self._count(at.LIVE_LIST), self._arena.walls
        first = np.zeros(beads + 1, dtype=np.int32)
        near = np.zeros((max(1, walls.first[live, beads]), 9))
        walls.get_list(first, near, live, beads)
        return first, near

    def _wall_overlaps(self, rows: Array, beads: int) -> Array:
        """Contacts with walls that hold now: bead, wall, overlap [m], shape (n, 3)."""
        first, near = self._near(beads)
        overlap = np.zeros(len(near))
        place = np.ascontiguousarray(rows[:, [0, 1, 2, 9]]) if len(rows) else np.zeros((1, 4))
        counts = (self._count(at.LIVE_LIST), beads, len(self._walls))
        self._arena.walls.get_contacts(place, overlap, *counts, self.time, self.time_step)
        owner = np.repeat(np.arange(beads), np.diff(first))
        found = np.stack([owner, near[: len(owner), 8], overlap[: len(owner)]], axis=1)
        return found[found[:, 2] > 0]

    def _pairs(self, beads: int) -> tuple[npt.NDArray[np.int32], Array]:
        first = np.zeros(beads + 1, dtype=np.int32)
        pairs = np.zeros((self._arena.pair_capacity, 8))
        self._arena.get_pairs(first, pairs, beads)
        return first, pairs[: max(1, int(first[beads]))]

    def _mine(self) -> None:
        if self._arena.owner is not self:
            raise RigtwinError("This simulation's arena was taken by a later one; run them one after the other.")


def _arena_size(beads: int) -> int:
    size = SMALLEST_ARENA
    while size < beads:
        size *= 4
    return size
