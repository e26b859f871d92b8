"""The bench on which few bodies move: many small simulations side by side, each a serial loop, all in one launch.

Bodies, pairs and walls of all copies stand one after another in the same fields, and each copy knows where its own
begin.  Threads take copies as they come free.  What a copy computes hangs on its own numbers alone, so it gets the same
bits in any company; and it begins on a line of the cache of its own, so that no two threads write to the same line.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from rigtwin.sim.effects import Effect
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.contact import (
    DAMPING,
    LAW_SIZE,
    STIFFNESS,
    Mechanics,
    braked,
    constants_of_two,
    contact_forces,
)
from rigtwin.sim.engine.elements import ELEMENT_SIZE, OF_WALL
from rigtwin.sim.engine.terms import Active, Terms, terms_among, upwards
from rigtwin.sim.engine.wall_contacts import WallContacts
from rigtwin.sim.engine.wall_table import KINDS, MOTION_SIZE, WANDERS, WallTable

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int32]

COPIES, LARGER = 1000, 9
BODIES_A_COPY, PAIRS_A_COPY, WALLS_A_COPY, ELEMENTS_A_COPY, ENTRIES_A_COPY = 8, 16, 2, 4, 16
LINE, LINE_OF_LIST = 8, 16  # vectors and numbers of 4 bytes that are surely not on one line of the cache
THREADS_OF_A_BLOCK = 32  # on a GPU
ENDLESS = 1e9  # [m]
LAUNCH = 0.2  # [s], so that progress and Ctrl-C work twice a second
FIRST_RATE = 1e6  # [1/s], first guess of the steps that are made, of all copies together
LEAST_STEPS, MOST_STEPS = 100, 50_000_000  # of a copy in a launch

# columns of a copy's clock: time, step in contact, longest step, how long the next may be, steps made (-1: forces are
# not known yet), gravity 3, how fast it turns about y
TIME, STEP, LONGEST, AHEAD, STEPS, GRAVITY, TURNS = 0, 1, 2, 3, 4, 5, 8
CLOCK = 9
# columns of a copy's counts: its first body and how many, walls likewise, its first pair, whether a wall changes, the
# sample that is next and how many are still to be taken, the row for the next sample, and the body whose motion is no
# finite number any more (-1: none)
BODY, BODIES, WALL, WALLS, PAIR, CHANGES, SAMPLE, LEFT, ROW, CULPRIT = range(10)
COUNTS = 10
# columns of a table of bodies: position 3, velocity 3, spin 3, radius, mass, inertia, pivot 3, length, kind
KIND = 16
BODY_SIZE = 17
SAMPLE_SIZE = 9  # position, velocity, spin

RESTING_SPEED = 1e-8  # [m/s]
RESTING_ACCELERATION = 1e-4  # [m/s^2]


@dataclass(frozen=True)
class Copy:
    """One small simulation in numbers."""

    bodies: Array  # shape (n, 17)
    pairs: Array  # shape (n * n, LAW_SIZE + 1): the law of each pair, and whether it meets
    walls: WallTable
    times: Array  # [s]
    clock: Array  # shape (16,)
    changes: bool  # whether a wall moves or goes
    effects: tuple[Active, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What became of a copy."""

    samples: Array  # shape (times, bodies, 9); NaN after a break-down
    steps: int
    time: float  # [s], reached
    culprit: int = -1  # the body whose motion is no finite number


def run(copies: Sequence[Copy], mechanics: Mechanics, threads: int, tell: Callable[[float], None]) -> list[Outcome]:
    """Move copies that have the same effects; `tell` hears of the time [s] that all of them have made together."""
    bench = _bench(tuple(one.effect for one in copies[0].effects), _room(copies))
    return bench.run(copies, mechanics, threads, tell)


def _room(copies: Sequence[Copy]) -> int:
    """How many copies there must be room for."""
    needs = max(
        len(copies),
        sum(_whole_lines(len(copy.bodies), LINE) for copy in copies) / BODIES_A_COPY,
        sum(_whole_lines(len(copy.pairs), LINE) for copy in copies) / PAIRS_A_COPY,
        sum(len(copy.walls.motion) for copy in copies) / WALLS_A_COPY,
        sum(len(copy.walls.elements) for copy in copies) / ELEMENTS_A_COPY,
        sum(_whole_lines(len(copy.bodies) * len(copy.walls.elements), LINE_OF_LIST) for copy in copies)
        / ENTRIES_A_COPY,
    )
    room = COPIES
    while room < needs:
        room *= LARGER
    return room


def _whole_lines(size: int, line: int) -> int:
    return -(-size // line) * line


def _places(sizes: Sequence[int], line: int = 1) -> Integers:
    """Where each of these pieces begins when they stand one after another, and where the last one ends."""
    return np.cumsum([0, *(_whole_lines(size, line) for size in sizes)], dtype=np.int32)


def _nearness(copies: Sequence[Copy], body_at: Integers, wall_at: Integers) -> tuple[Array, Integers, Integers]:
    """What all walls are made of, and the list of what is near each body: every part of every wall of its copy."""
    element_at = _places([len(copy.walls.elements) for copy in copies])
    entry_at = _places([len(copy.bodies) * len(copy.walls.elements) for copy in copies], LINE_OF_LIST)
    elements = np.concatenate([copy.walls.elements for copy in copies])
    elements[:, OF_WALL] += np.repeat(wall_at[:-1], np.diff(element_at))
    first, near = np.zeros(body_at[-1] + 1, dtype=np.int32), np.zeros(entry_at[-1], dtype=np.int32)
    for c, copy in enumerate(copies):
        n, parts = len(copy.bodies), len(copy.walls.elements)
        # bodies that only fill the line have the entries that do so
        first[body_at[c] : body_at[c + 1] + 1] = entry_at[c + 1]
        first[body_at[c] : body_at[c] + n + 1] = entry_at[c] + np.arange(n + 1) * parts
        near[entry_at[c] : entry_at[c] + n * parts] = np.tile(element_at[c] + np.arange(parts), n)
    return elements, first, near


@cache
def _bench(effects: tuple[Effect, ...], room: int) -> "Bench":
    return Bench(terms_among(effects, "few bodies", room), room)


@ti.data_oriented
class Bench:
    """Fields and kernels for up to `room` copies; made once per process, after the backend has started."""

    def __init__(self, terms: Terms, room: int) -> None:
        self.terms = terms
        self.room = room
        self.block = 1 if backend.start().device == "cpu" else THREADS_OF_A_BLOCK
        self.rate = FIRST_RATE
        bodies, pairs = BODIES_A_COPY * room, PAIRS_A_COPY * room
        self.position = ti.Vector.field(3, ti.f64, bodies)
        self.velocity = ti.Vector.field(3, ti.f64, bodies)
        self.spin = ti.Vector.field(3, ti.f64, bodies)
        self.push = ti.Vector.field(3, ti.f64, bodies)  # acceleration
        self.twist = ti.Vector.field(3, ti.f64, bodies)  # angular acceleration
        self.brake = ti.field(ti.f64, bodies)  # [rad/s^2], against the spin, by rolling resistance of type A
        self.half = ti.Vector.field(3, ti.f64, bodies)  # velocity at the middle of the step
        self.half_spin = ti.Vector.field(3, ti.f64, bodies)
        self.body = ti.Vector.field(3, ti.f64, bodies)  # radius, mass, inertia
        self.thread = ti.Vector.field(4, ti.f64, bodies)  # pivot, length (0: none)
        self.kind = ti.field(ti.i32, bodies)
        self.pair_slip = ti.Vector.field(3, ti.f64, pairs)
        self.pair_roll = ti.Vector.field(3, ti.f64, pairs)
        self.pair_law = ti.Vector.field(LAW_SIZE, ti.f64, pairs)
        self.pair_meets = ti.field(ti.i32, pairs)
        if terms.act_on_contacts:
            self.impact = ti.field(ti.f64, pairs)  # DAMPING of this impact; negative: apart
        self.walls = WallContacts(
            bodies, ENTRIES_A_COPY * room, ELEMENTS_A_COPY * room, terms, walls=WALLS_A_COPY * room, threads=1
        )

    # ------------------------------------------------------------------ a run

    def run(
        self, copies: Sequence[Copy], mechanics: Mechanics, threads: int, tell: Callable[[float], None]
    ) -> list[Outcome]:
        """Load the copies and advance them to the last of their times."""
        counts = self.load(copies)
        clock = np.array([copy.clock for copy in copies])
        times = np.concatenate([copy.times for copy in copies])
        rows = _places([len(copy.times) * len(copy.bodies) for copy in copies])
        samples = np.full((rows[-1], SAMPLE_SIZE), np.nan)
        running = np.arange(len(copies), dtype=np.int32)
        while len(running):
            began, before = time.perf_counter(), clock[:, STEPS].sum()
            budget = int(np.clip(LAUNCH * self.rate / len(running), LEAST_STEPS, MOST_STEPS))
            workers = min(threads, len(running)) if self.block == 1 else len(running)
            self._advance(
                running, np.zeros(1, dtype=np.int32), workers, budget, clock, counts, times, samples, mechanics
            )
            self.rate = max(1.0, clock[:, STEPS].sum() - before) / (time.perf_counter() - began)
            running = running[(counts[running, LEFT] > 0) & (counts[running, CULPRIT] < 0)]
            tell(float(clock[:, TIME].sum()))
        return [
            Outcome(
                samples[rows[c] : rows[c + 1]].reshape(-1, len(copy.bodies), SAMPLE_SIZE),
                int(clock[c, STEPS]),
                float(clock[c, TIME]),
                int(counts[c, CULPRIT]),
            )
            for c, copy in enumerate(copies)
        ]

    def load(self, copies: Sequence[Copy]) -> Integers:
        """Take the copies as they are at the start; their counts."""
        counts = np.zeros((len(copies), COUNTS), dtype=np.int32)
        body_at = _places([len(copy.bodies) for copy in copies], LINE)
        pair_at = _places([len(copy.pairs) for copy in copies], LINE)
        wall_at = _places([len(copy.walls.motion) for copy in copies])
        bodies, pairs = np.zeros((body_at[-1], BODY_SIZE)), np.zeros((pair_at[-1], LAW_SIZE + 1))
        for c, copy in enumerate(copies):
            bodies[body_at[c] : body_at[c] + len(copy.bodies)] = copy.bodies
            pairs[pair_at[c] : pair_at[c] + len(copy.pairs)] = copy.pairs
        counts[:, BODY], counts[:, BODIES] = body_at[:-1], [len(copy.bodies) for copy in copies]
        counts[:, WALL], counts[:, WALLS] = wall_at[:-1], [len(copy.walls.motion) for copy in copies]
        counts[:, PAIR], counts[:, CHANGES] = pair_at[:-1], [copy.changes for copy in copies]
        counts[:, LEFT], counts[:, CULPRIT] = [len(copy.times) for copy in copies], -1
        counts[:, SAMPLE] = _places([len(copy.times) for copy in copies])[:-1]
        counts[:, ROW] = _places([len(copy.times) * len(copy.bodies) for copy in copies])[:-1]
        elements, first, near = _nearness(copies, body_at, wall_at)
        motion = np.concatenate([copy.walls.motion for copy in copies])
        law = np.concatenate([copy.walls.law for copy in copies], axis=1)
        of = np.repeat(np.arange(len(copies), dtype=np.int32), counts[:, WALLS])
        self.terms.load([copy.effects for copy in copies])
        self._load(bodies, pairs)
        self._load_walls(elements, motion, law, of, first, near)
        return counts

    # ------------------------------------------------------------------ data in

    @ti.kernel
    def _load(self, bodies: ti.types.ndarray(), pairs: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for _ in range(1):
            for i in range(bodies.shape[0]):
                self.position[i] = ti.Vector([bodies[i, 0], bodies[i, 1], bodies[i, 2]])
                self.velocity[i] = ti.Vector([bodies[i, 3], bodies[i, 4], bodies[i, 5]])
                self.spin[i] = ti.Vector([bodies[i, 6], bodies[i, 7], bodies[i, 8]])
                self.body[i] = ti.Vector([bodies[i, 9], bodies[i, 10], bodies[i, 11]])
                self.thread[i] = ti.Vector([bodies[i, 12], bodies[i, 13], bodies[i, 14], bodies[i, 15]])
                self.kind[i] = int(bodies[i, KIND])
                # the last run may have broken down here, and nothing times no number is no number
                self.push[i] = ti.Vector([0.0, 0.0, 0.0])
                self.twist[i] = ti.Vector([0.0, 0.0, 0.0])
                self.brake[i] = 0.0
            for p in range(pairs.shape[0]):
                self.pair_slip[p] = ti.Vector([0.0, 0.0, 0.0])
                self.pair_roll[p] = ti.Vector([0.0, 0.0, 0.0])
                self.pair_meets[p] = int(pairs[p, LAW_SIZE])
                for k in ti.static(range(LAW_SIZE)):
                    self.pair_law[p][k] = pairs[p, k]
                if ti.static(self.terms.act_on_contacts):
                    self.impact[p] = -1.0

    @ti.kernel
    def _load_walls(
        self,
        elements: ti.types.ndarray(),
        motion: ti.types.ndarray(),
        law: ti.types.ndarray(),
        of: ti.types.ndarray(),
        first: ti.types.ndarray(),
        near: ti.types.ndarray(),
    ):
        """Bodies differ, so the constants of a contact are worked out when it is met: they are not needed here."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            for e in range(elements.shape[0]):
                for k in range(ELEMENT_SIZE):
                    self.walls.elements[e, k] = elements[e, k]
            for w in range(motion.shape[0]):
                self.walls.copy[w] = of[w]
                self.walls.listed_at[w] = 0.0
                for k in range(MOTION_SIZE):
                    self.walls.motion[w, k] = motion[w, k]
                for a in range(KINDS):
                    for k in ti.static(range(LAW_SIZE)):
                        self.walls.law[a, w][k] = law[a, w, k]
            for i in range(first.shape[0]):
                self.walls.first[0, i] = first[i]
            for q in range(near.shape[0]):
                self.walls.near[0, q] = near[q]
                self.walls.touching[0, q] = 0

    # ------------------------------------------------------------------ the step

    @ti.func
    def forces(self, c, begin, end, first_pair, step, longest, pull, mechanics: ti.template()):
        """Accelerations here, from the velocities of mid-step; the smallest time to a contact, 0 in contact."""
        clear = longest
        slack = pull.norm() * longest
        for i in range(begin, end):
            self.push[i] = self.push_on_body(c, i, step, pull)
            self.twist[i] = ti.Vector([0.0, 0.0, 0.0])
            self.brake[i] = 0.0
        for i in range(begin, end):
            radius, mass, inertia = self.body[i][0], self.body[i][1], self.body[i][2]
            force, torque, grip, deepest = self.walls.press(
                0, 0, i, self.kind[i], self.position[i], self.half[i], self.half_spin[i], radius, mass, inertia, step,
                False, mechanics,
            )  # fmt: skip
            self.push[i] = self.push[i] + force / mass
            self.twist[i] = self.twist[i] + torque / inertia
            self.brake[i] = self.brake[i] + grip * radius / inertia
            for q in range(self.walls.first[0, i], self.walls.first[0, i + 1]):
                wall = int(self.walls.elements[self.walls.near[0, q], OF_WALL])
                closing = self.half[i].norm() + slack + self.walls.motion[wall, WANDERS]
                clear = ti.min(clear, 0.4 * ti.max(self.walls.facing[q][3] - radius, 0.0) / closing)
            if deepest > 0.0:
                clear = 0.0
            for j in range(i + 1, end):
                p = first_pair + (i - begin) * (end - begin) + (j - begin)
                if self.pair_meets[p] == 1:
                    radius_j, mass_j, inertia_j = self.body[j][0], self.body[j][1], self.body[j][2]
                    between = self.position[j] - self.position[i]
                    distance = between.norm()
                    overlap = radius + radius_j - distance
                    velocity = self.half[i] - self.half[j]
                    clear = ti.min(clear, self.cling(c, p, i, j, overlap, between, longest))
                    if overlap > 0.0:
                        clear = 0.0
                        normal = between / distance
                        lever = distance * radius / (radius + radius_j)
                        lever_j = distance - lever
                        surface = velocity + (lever * self.half_spin[i] + lever_j * self.half_spin[j]).cross(normal)
                        constants = constants_of_two(
                            self.law_of_pair(p), radius, radius_j, mass, mass_j, inertia, inertia_j, step,
                            mechanics.linear,
                        )  # fmt: skip
                        force, torque, grip, slip, roll = contact_forces(
                            overlap, normal, surface, self.half_spin[i], self.half_spin[j], constants,
                            self.pair_slip[p], self.pair_roll[p], step, mechanics,
                        )  # fmt: skip
                        self.pair_slip[p] = slip
                        self.pair_roll[p] = roll
                        turn = normal.cross(force)
                        self.push[i] = self.push[i] + force / mass
                        self.push[j] = self.push[j] - force / mass_j
                        self.twist[i] = self.twist[i] + (lever * turn + torque) / inertia
                        self.twist[j] = self.twist[j] + (lever_j * turn - torque) / inertia_j
                        self.brake[i] = self.brake[i] + grip * radius / inertia
                        self.brake[j] = self.brake[j] + grip * radius_j / inertia_j
                    else:
                        self.pair_slip[p] = ti.Vector([0.0, 0.0, 0.0])
                        self.pair_roll[p] = ti.Vector([0.0, 0.0, 0.0])
                        clear = ti.min(clear, -0.4 * overlap / (velocity.norm() + slack))
        return clear

    @ti.func
    def push_on_body(self, c, i, step, pull):
        """Gravity and what effects add to it."""
        push = pull
        if ti.static(self.terms.act_on_bodies):
            push += self.push_of_terms(c, i, step, pull)
        return push

    @ti.func
    def push_of_terms(self, c, i, step, gravity):
        """Acceleration by what acts on a body away from contacts; `push` still holds the last step's."""
        radius, mass = self.body[i][0], self.body[i][1]
        velocity = self.half[i] + 0.5 * step * self.push[i]
        push = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.terms.acts_in_flight):
            self.walls.face(0, 0, i, self.position[i], radius)
            gap = self.walls.gap(0, i, radius)
            push += self.terms.in_flight(velocity, gap, radius, mass, upwards(gravity), c) / mass
        if ti.static(self.terms.acts_on_threads):
            length = self.thread[i][3]
            if length > 0.0:
                pivot = ti.Vector([self.thread[i][0], self.thread[i][1], self.thread[i][2]])
                arm = (self.position[i] - pivot) / length
                push += self.terms.on_thread(velocity, arm, length, mass, upwards(gravity), c) / mass
        return push

    @ti.func
    def law_of_pair(self, p):
        law = self.pair_law[p]
        if ti.static(self.terms.changes_restitution):
            law[DAMPING] = self.impact[p]
        return law

    @ti.func
    def cling(self, c, p, i, j, overlap, between, longest):
        """The longest step while effects act on this contact: none; they remember how it began, and may pull."""
        clear = longest
        if ti.static(self.terms.act_on_contacts):
            normal = between / between.norm()
            radius, mass = self.body[i][0], self.body[i][1]
            radius_j, mass_j = self.body[j][0], self.body[j][1]
            radius_eff = radius * radius_j / (radius + radius_j)
            law = self.pair_law[p]
            state = self.impact[p]
            if overlap > 0.0 and state < 0.0:
                closing = (self.half[i] - self.half[j]).dot(normal)
                mass_eff = mass * mass_j / (mass + mass_j)
                state = self.terms.damping_of_pair(law[DAMPING], closing, radius_eff, mass_eff, c)
            if overlap < -self.terms.neck(radius_eff, law[STIFFNESS], c):
                state = -1.0
            if state >= 0.0:
                clear = 0.0
                pull = self.terms.attraction(overlap, radius_eff, law[STIFFNESS], c)
                self.push[i] = self.push[i] + pull / mass * normal
                self.push[j] = self.push[j] - pull / mass_j * normal
            self.impact[p] = state
        return clear

    @ti.func
    def turned_about_y(self, vector, angle):
        """From z towards x."""
        cosine, sine = ti.cos(angle), ti.sin(angle)
        return ti.Vector([vector[0] * cosine + vector[2] * sine, vector[1], vector[2] * cosine - vector[0] * sine])

    @ti.func
    def drift(self, i, h, mechanics: ti.template()):
        """Positions to the end of the step, velocities to its middle; a thread keeps its length (RATTLE)."""
        before = self.position[i]
        middle = self.velocity[i] + 0.5 * h * self.push[i]
        after = before + h * middle
        length = self.thread[i][3]
        if length > 0.0 and h > 0.0:
            pivot = ti.Vector([self.thread[i][0], self.thread[i][1], self.thread[i][2]])
            arm = before - pivot
            reach = after - pivot
            b = reach.dot(arm)
            c = reach.norm_sqr() - length * length
            pull = -c / (b + ti.sqrt(b * b - c * arm.norm_sqr()))
            after += pull * arm
            middle += pull / h * arm
        self.position[i] = after
        self.half[i] = middle
        self.half_spin[i] = self.turned_on(i, self.spin[i], 0.5 * h, mechanics)

    @ti.func
    def turned_on(self, i, spin, time, mechanics: ti.template()):
        """The spin of body `i` a `time` later."""
        later = spin + time * self.twist[i]
        if ti.static(mechanics.constant_torque):
            later = braked(later, time * self.brake[i])
        return later

    @ti.func
    def across_thread(self, i, velocity):
        free = velocity
        length = self.thread[i][3]
        if length > 0.0:
            pivot = ti.Vector([self.thread[i][0], self.thread[i][1], self.thread[i][2]])
            arm = (self.position[i] - pivot) / length
            free -= free.dot(arm) * arm
        return free

    @ti.func
    def take_sample(self, samples: ti.template(), row, begin, end):
        for i in range(begin, end):
            for k in ti.static(range(3)):
                samples[row + i - begin, k] = self.position[i][k]
                samples[row + i - begin, 3 + k] = self.velocity[i][k]
                samples[row + i - begin, 6 + k] = self.spin[i][k]

    @ti.func
    def advance_copy(
        self, c, budget, clock: ti.template(), counts: ti.template(), times: ti.template(), samples: ti.template(),
        mechanics: ti.template(),
    ):  # fmt: skip
        """Up to `budget` steps of one copy, or until all samples are taken."""
        begin, first_wall, first_pair = counts[c, BODY], counts[c, WALL], counts[c, PAIR]
        end, last_wall, changes = begin + counts[c, BODIES], first_wall + counts[c, WALLS], counts[c, CHANGES]
        sample, awaited, row = counts[c, SAMPLE], counts[c, LEFT], counts[c, ROW]
        now, ahead, steps = clock[c, TIME], clock[c, AHEAD], clock[c, STEPS]
        shortest, longest, turns = clock[c, STEP], clock[c, LONGEST], clock[c, TURNS]
        gravity = ti.Vector([clock[c, GRAVITY], clock[c, GRAVITY + 1], clock[c, GRAVITY + 2]])
        pull, wanted, culprit = gravity, times[sample], -1
        left = budget
        while left > 0 and awaited > 0 and culprit < 0:
            h = ti.max(ahead, shortest)
            if now + h > wanted - 1e-15:
                h = ti.max(wanted - now, 0.0)
            if steps < 0.0:
                h = 0.0
            for i in range(begin, end):
                self.drift(i, h, mechanics)
            if turns != 0.0:
                pull = self.turned_about_y(gravity, turns * (now + h))
            if changes == 1 or steps < 0.0:
                for w in range(first_wall, last_wall):
                    self.walls.pose_wall(0, w, now + h, h, ENDLESS)
            ahead = self.forces(c, begin, end, first_pair, h, longest, pull, mechanics)
            still = changes == 0 and turns == 0.0
            for i in range(begin, end):
                self.velocity[i] = self.across_thread(i, self.half[i] + 0.5 * h * self.push[i])
                self.spin[i] = self.turned_on(i, self.half_spin[i], 0.5 * h, mechanics)
                speed2 = self.velocity[i].norm_sqr() + (self.body[i][0] * self.spin[i]).norm_sqr()
                if not (speed2 < 1e12):
                    culprit = i - begin
                if speed2 > RESTING_SPEED**2 or self.push[i].norm_sqr() > RESTING_ACCELERATION**2:
                    still = False
            now += h
            steps += 1.0
            left -= 1
            while awaited > 0 and culprit < 0 and (now > wanted - 1e-14 or still):
                # what rests, under its own weight and without force, rests for good
                self.take_sample(samples, row, begin, end)
                row += end - begin
                awaited -= 1
                if awaited > 0:
                    sample += 1
                    wanted = times[sample]
        clock[c, TIME], clock[c, AHEAD], clock[c, STEPS] = now, ahead, steps
        counts[c, SAMPLE], counts[c, LEFT], counts[c, ROW], counts[c, CULPRIT] = sample, awaited, row, culprit

    @ti.kernel
    def _advance(
        self,
        running: ti.types.ndarray(),
        taken: ti.types.ndarray(),
        workers: ti.i32,
        budget: ti.i32,
        clock: ti.types.ndarray(),
        counts: ti.types.ndarray(),
        times: ti.types.ndarray(),
        samples: ti.types.ndarray(),
        mechanics: ti.template(),
    ):
        """Each worker takes the next of the running copies until none is left; `taken` counts those that are."""
        ti.loop_config(block_dim=self.block)
        for _ in range(workers):
            turn = ti.atomic_add(taken[0], 1)
            while turn < running.shape[0]:
                self.advance_copy(running[turn], budget, clock, counts, times, samples, mechanics)
                turn = ti.atomic_add(taken[0], 1)
