"""One to a few bodies: the whole run in one serial kernel, with a step that adapts to the contact.

For the rigs whose result hangs on a single collision (drop, pendulum) the stiffness is the real one and the step in
contact a small part of Rayleigh's; between contacts the step grows with the gap, never crossing it.  Velocity Verlet,
float64; a body may hang on a rigid massless thread (RATTLE).
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.lab.materials import Contact, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.contact import (
    DAMPING,
    IMPACT_SPEED,
    LAW_SIZE,
    SIZES_OF_KIND,
    STIFFNESS,
    ContactLaw,
    Mechanics,
    Rolling,
    braked,
    constants_of_two,
    contact_forces,
    pair_law,
)
from rigtwin.sim.engine.elements import OF_WALL
from rigtwin.sim.engine.terms import Active, Terms, terms_of, upwards
from rigtwin.sim.engine.wall_contacts import WallContacts
from rigtwin.sim.engine.wall_table import WANDERS, wall_table
from rigtwin.sim.engine.walls import Wall, gaps

Array = npt.NDArray[np.float64]

BODIES, SAMPLES = 16, 4096
ELEMENTS = 64  # planes, discs, triangles ... that the walls are made of
ENDLESS = 1e9  # [m]
ACCURATE_FRACTION = 0.015  # of Rayleigh's step: a twentieth of the usual 30 %, restitution then errs by < 0.1 %
FLIGHT_STEP = 1e-4  # [s], longest step out of contact
HALVINGS = 6
LAUNCH_STEPS = 200_000  # first guess of what a launch can do in a quarter of a second

RUNNING, DONE, BROKEN = range(3)

UNTURNABLE = 1e30  # [kg m^2]
RESTING_SPEED = 1e-8  # [m/s]
RESTING_ACCELERATION = 1e-4  # [m/s^2]


@dataclass(frozen=True)
class Body:
    """One sphere, where it starts, and the thread it may hang on."""

    particle: Particle
    position: tuple[float, float, float]  # [m]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m/s]
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad/s]
    pivot: tuple[float, float, float] | None = None  # [m], the thread's other end; None: free
    turns: bool = True  # False: it keeps its spin, as a body too broad to roll does


@dataclass(frozen=True)
class Motion:
    """Sampled motion of the bodies."""

    time: Array  # [s], shape (k,)
    position: Array  # [m], shape (k, n, 3)
    velocity: Array  # [m/s], shape (k, n, 3)
    spin: Array  # [rad/s], shape (k, n, 3)
    steps: int


def contact_step(particles: Sequence[Particle], fraction: float = ACCURATE_FRACTION) -> float:
    """Step in contact [s]: `fraction` of the smallest Rayleigh step (Hlosta et al. 2020, eq. 7)."""
    return fraction * min(particle.rayleigh_time_step for particle in particles)


def run(
    bodies: Sequence[Body],
    times: Array,
    *,
    walls: Sequence[Wall] = (),
    contacts: Mapping[tuple[int, int], Contact] | Contact | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY),
    gravity_turns: float = 0.0,
    step: float | None = None,
    flight_step: float = FLIGHT_STEP,
    rolling: Rolling = "type C",
    contact_law: ContactLaw = "Hertz-Mindlin",
    impact_speed: float = IMPACT_SPEED,
    effects: Sequence[Active] = (),
    progress: Progress = silent,
) -> Motion:
    """Move the bodies from t = 0 and sample them at `times` [s], rising.

    `contacts` is one Contact for all pairs of bodies, or one per pair (i, j) with i < j; None: bodies never touch.
    `step` [s] is the step in contact (default `contact_step`).  Gravity turns about y by `gravity_turns` [rad/s],
    from z towards x: what a plate feels whose far end (x > 0) sinks.  `effects` act on all bodies and contacts.
    The springs of the "linear" law are as stiff as Hertz's contacts at `impact_speed` [m/s].
    """
    times = np.ascontiguousarray(times, dtype=np.float64)
    _check(bodies, times, walls, contacts)
    step = contact_step([body.particle for body in bodies]) if step is None else step
    if not 0 < step <= flight_step:
        raise BadInput(f"step: {step:g} s does not lie between 0 and the flight step of {flight_step:g} s.")
    mechanics = Mechanics(contact_law, rolling)
    backend.start()
    bench = _bench(terms_of(effects, "few bodies"))
    bench.load(
        bodies, walls, contacts, gravity=(*gravity, gravity_turns), steps=(step, flight_step), impact_speed=impact_speed
    )
    count = len(bodies)
    sampled: list[Array] = []
    budget = LAUNCH_STEPS
    for first in range(0, len(times), SAMPLES):
        block = times[first : first + SAMPLES]
        bench.expect(block)
        while bench.status() == RUNNING:
            began = time.perf_counter()
            bench.advance(budget, mechanics)
            # kernels come back at least twice a second, so that progress and Ctrl-C work
            budget = int(np.clip(0.25 / max(time.perf_counter() - began, 1e-6) * budget, 1000, 50_000_000))
            progress("simulating", bench.now(), float(times[-1]))
        if bench.status() == BROKEN:
            raise RigtwinError(
                f"The simulation broke down at t = {bench.now():.6g} s (body {bench.culprit()}): "
                "its position is not a finite number; use a smaller step."
            )
        sampled.append(bench.samples(len(block), count))
    data = np.concatenate(sampled)
    return Motion(times, data[:, :, 0:3], data[:, :, 3:6], data[:, :, 6:9], bench.steps())


def run_halved(
    bodies: Sequence[Body], times: Array, *, tolerance: float, step: float | None = None, **settings: Any
) -> tuple[Motion, float]:
    """`run` with the step in contact halved until no sample moves by more than `tolerance` [m].

    Returns the finer of the last two runs and how far they lie apart [m], which is above the tolerance only when
    six halvings were not enough.
    """
    step = contact_step([body.particle for body in bodies]) if step is None else step
    coarse = run(bodies, times, step=step, **settings)
    apart = math.inf
    for _ in range(HALVINGS):
        step /= 2
        fine = run(bodies, times, step=step, **settings)
        apart = float(np.abs(fine.position - coarse.position).max())
        coarse = fine
        if apart <= tolerance:
            break
    return coarse, apart


def _check(
    bodies: Sequence[Body],
    times: Array,
    walls: Sequence[Wall],
    contacts: Mapping[tuple[int, int], Contact] | Contact | None,
) -> None:
    if not 1 <= len(bodies) <= BODIES:
        raise BadInput(
            f"bodies: {len(bodies)} were given; this path moves 1 to {BODIES}, use the bulk engine for more."
        )
    if (count := sum(len(wall.shape.rows) for wall in walls)) > ELEMENTS:
        raise BadInput(
            f"walls: they are made of {count} parts; this path takes {ELEMENTS}, use the bulk engine for larger meshes."
        )
    for body in bodies:
        if body.particle.shape is not None:
            raise BadInput(f"{body.particle.name} is a clump; this twin moves single spheres, name a sphere instead.")
    if len(times) == 0 or times[0] < 0 or not np.all(np.isfinite(times)) or not np.all(np.diff(times) > 0):
        raise BadInput("times: must be finite, rise, and start at or after 0 s.")
    state = np.array([[*b.position, *b.velocity, *b.spin, *(b.pivot or ())][:9] for b in bodies])
    if not np.all(np.isfinite(state)):
        bad = int(np.flatnonzero(~np.isfinite(state).all(axis=1))[0])
        raise BadInput(f"body {bad}: its position, velocity or spin is not a finite number.")
    centres, radii = state[:, :3], np.array([b.particle.radius for b in bodies])
    tolerance = 1e-3 * radii  # hanging beads touch; a thousandth of a radius is no blunder
    for wall in walls:
        gap = gaps(wall.shape, wall.motion.undone(centres, 0.0) if wall.motion else centres, radii)
        if np.any(gap < -tolerance):
            bad = int(np.argmin(gap))
            raise BadInput(f"body {bad} starts {-gap[bad] * 1e3:.3g} mm inside a wall; move it out.")
    for i in range(len(bodies) if contacts is not None else 0):
        gap = np.linalg.norm(centres[i + 1 :] - centres[i], axis=1) - radii[i + 1 :] - radii[i]
        if np.any(gap < -tolerance[i]):
            bad = i + 1 + int(np.argmin(gap))
            raise BadInput(f"bodies {i} and {bad} overlap at the start by {-gap.min() * 1e3:.3g} mm; move them apart.")


@cache
def _bench(terms: Terms) -> "_Bench":
    return _Bench(terms)


@ti.data_oriented
class _Bench:
    """Fields and kernel of the few-body path; made once per process, after the backend has started."""

    def __init__(self, terms: Terms) -> None:
        self.terms = terms
        self.position = ti.Vector.field(3, ti.f64, BODIES)
        self.velocity = ti.Vector.field(3, ti.f64, BODIES)
        self.spin = ti.Vector.field(3, ti.f64, BODIES)
        self.push = ti.Vector.field(3, ti.f64, BODIES)  # acceleration
        self.twist = ti.Vector.field(3, ti.f64, BODIES)  # angular acceleration
        self.brake = ti.field(ti.f64, BODIES)  # [rad/s^2], against the spin, by rolling resistance of type A
        self.half = ti.Vector.field(3, ti.f64, BODIES)  # velocity at the middle of the step
        self.half_spin = ti.Vector.field(3, ti.f64, BODIES)
        self.body = ti.Vector.field(3, ti.f64, BODIES)  # radius, mass, inertia
        self.thread = ti.Vector.field(4, ti.f64, BODIES)  # pivot, length (0: none)
        self.pair_slip = ti.Vector.field(3, ti.f64, (BODIES, BODIES))
        self.pair_roll = ti.Vector.field(3, ti.f64, (BODIES, BODIES))
        self.walls = WallContacts(BODIES, BODIES * ELEMENTS, ELEMENTS, terms)
        self.kind = ti.field(ti.i32, BODIES)
        self.pair_law = ti.Vector.field(LAW_SIZE, ti.f64, (BODIES, BODIES))
        self.pair_meets = ti.field(ti.i32, (BODIES, BODIES))
        if terms.act_on_contacts:
            self.impact = ti.field(ti.f64, (BODIES, BODIES))  # DAMPING of this impact; negative: apart
        self.gravity = ti.Vector.field(4, ti.f64, ())  # at the start, and how fast it turns about y
        self.pull = ti.Vector.field(3, ti.f64, ())  # gravity now
        self.times = ti.field(ti.f64, SAMPLES)
        self.out = ti.field(ti.f64, (SAMPLES, BODIES, 9))
        self.clock = ti.field(ti.f64, 4)  # time, step in contact, longest step, time to a contact
        self.counts = ti.field(ti.i32, 8)
        self.total_steps = ti.field(ti.i64, ())

    def load(
        self,
        bodies: Sequence[Body],
        walls: Sequence[Wall],
        contacts: Mapping[tuple[int, int], Contact] | Contact | None,
        *,
        gravity: tuple[float, float, float, float],
        steps: tuple[float, float],
        impact_speed: float,
    ) -> None:
        table = np.zeros((BODIES, 20))
        for i, b in enumerate(bodies):
            p = b.particle
            length = 0.0 if b.pivot is None else float(np.linalg.norm(np.subtract(b.position, b.pivot)))
            pivot = b.pivot or (0.0, 0.0, 0.0)
            inertia = 0.4 * p.mass * p.radius**2 if b.turns else UNTURNABLE
            table[i, :16] = (*b.position, *b.velocity, *b.spin, p.radius, p.mass, inertia, *pivot, length)
        pair = np.zeros((BODIES, BODIES, LAW_SIZE + 1))
        for i in range(len(bodies)):
            for j in range(i + 1, len(bodies)):
                contact = contacts if isinstance(contacts, Contact) or contacts is None else contacts.get((i, j))
                if contact is not None:
                    law = pair_law(bodies[i].particle.material, bodies[j].particle.material, contact, impact_speed)
                    pair[i, j] = (*law.row, 1.0)
        kinds = list(dict.fromkeys(b.particle for b in bodies))
        for i, b in enumerate(bodies):
            table[i, 16] = kinds.index(b.particle)
        self._load_walls(walls, kinds, len(bodies), impact_speed)
        changing = any(w.motion is not None or math.isfinite(w.until) for w in walls)
        numbers = np.array([0.0, *steps, *gravity])
        self._load(table, pair, numbers, len(bodies), len(walls), int(changing))
        if self.terms.act_on_contacts:
            self.impact.fill(-1.0)

    def _load_walls(self, walls: Sequence[Wall], kinds: Sequence[Particle], bodies: int, impact_speed: float) -> None:
        """Every part of every wall is near every body."""
        everywhere = np.full(3, -ENDLESS), np.full(3, ENDLESS)
        laws = wall_table(
            [(wall,) * len(kinds) for wall in walls], kinds, skin=0.0, domain=everywhere, impact_speed=impact_speed
        )
        self.walls.load(laws, np.ones(SIZES_OF_KIND), 1.0, False)  # bodies differ: constants are made for each contact
        parts = len(laws.elements) if walls else 0
        first = (np.arange(BODIES + 1) * parts).astype(np.int32)
        near = np.zeros((max(1, BODIES * parts), 9))
        near[: BODIES * parts, 0] = np.tile(np.arange(parts), BODIES)
        self.walls.put_list(first, near, 0, bodies)

    def expect(self, times: Array) -> None:
        padded = np.zeros(SAMPLES)
        padded[: len(times)] = times
        self._expect(padded, len(times))

    def status(self) -> int:
        return int(self.counts[4])

    def culprit(self) -> int:
        return int(self.counts[6])

    def now(self) -> float:
        return float(self.clock[0])

    def steps(self) -> int:
        return int(self.total_steps[None])

    def samples(self, samples: int, bodies: int) -> Array:
        return np.asarray(self.out.to_numpy()[:samples, :bodies])

    @ti.kernel
    def _load(
        self,
        table: ti.types.ndarray(),
        pair: ti.types.ndarray(),
        numbers: ti.types.ndarray(),
        bodies: ti.i32,
        walls: ti.i32,
        changing: ti.i32,
    ):
        ti.loop_config(serialize=True)
        for i in range(BODIES):
            self.position[i] = ti.Vector([table[i, 0], table[i, 1], table[i, 2]])
            self.velocity[i] = ti.Vector([table[i, 3], table[i, 4], table[i, 5]])
            self.spin[i] = ti.Vector([table[i, 6], table[i, 7], table[i, 8]])
            self.body[i] = ti.Vector([table[i, 9], table[i, 10], table[i, 11]])
            self.thread[i] = ti.Vector([table[i, 12], table[i, 13], table[i, 14], table[i, 15]])
            for j in range(BODIES):
                self.pair_slip[i, j] = ti.Vector([0.0, 0.0, 0.0])
                self.pair_roll[i, j] = ti.Vector([0.0, 0.0, 0.0])
                self.pair_meets[i, j] = int(pair[i, j, LAW_SIZE])
                for c in ti.static(range(LAW_SIZE)):
                    self.pair_law[i, j][c] = pair[i, j, c]
            self.kind[i] = int(table[i, 16])
        for c in ti.static(range(3)):
            self.clock[c] = numbers[c]
            self.clock[3] = 0.0
            self.gravity[None][c] = numbers[3 + c]
            self.pull[None][c] = numbers[3 + c]
        self.gravity[None][3] = numbers[6]
        self.counts[0] = bodies
        self.counts[1] = walls
        self.counts[4] = DONE
        self.counts[6] = -1
        self.counts[7] = changing
        self.total_steps[None] = -1  # forces not yet known

    @ti.kernel
    def _expect(self, times: ti.types.ndarray(), count: ti.i32):
        for s in range(SAMPLES):
            self.times[s] = times[s]
        self.counts[2] = count
        self.counts[3] = 0
        self.counts[4] = RUNNING

    @ti.func
    def forces(self, step, mechanics: ti.template()):
        """Accelerations here, from the velocities of mid-step; the smallest time to a contact, 0 in contact."""
        n = self.counts[0]
        clear = self.clock[2]
        slack = self.pull[None].norm() * self.clock[2]
        self.walls.pose(0, self.counts[1], self.clock[0] + step, step, ENDLESS)
        for i in range(n):
            self.push[i] = self.push_on_body(i, step)
            self.twist[i] = ti.Vector([0.0, 0.0, 0.0])
            self.brake[i] = 0.0
        for i in range(n):
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
            for j in range(i + 1, n):
                if self.pair_meets[i, j] == 1:
                    radius_j, mass_j, inertia_j = self.body[j][0], self.body[j][1], self.body[j][2]
                    between = self.position[j] - self.position[i]
                    distance = between.norm()
                    overlap = radius + radius_j - distance
                    velocity = self.half[i] - self.half[j]
                    clear = ti.min(clear, self.cling(i, j, overlap, between))
                    if overlap > 0.0:
                        clear = 0.0
                        normal = between / distance
                        lever = distance * radius / (radius + radius_j)
                        lever_j = distance - lever
                        surface = velocity + (lever * self.half_spin[i] + lever_j * self.half_spin[j]).cross(normal)
                        constants = constants_of_two(
                            self.law_of_pair(i, j), radius, radius_j, mass, mass_j, inertia, inertia_j, step,
                            mechanics.linear,
                        )  # fmt: skip
                        force, torque, grip, slip, roll = contact_forces(
                            overlap, normal, surface, self.half_spin[i], self.half_spin[j], constants,
                            self.pair_slip[i, j], self.pair_roll[i, j], step, mechanics,
                        )  # fmt: skip
                        self.pair_slip[i, j] = slip
                        self.pair_roll[i, j] = roll
                        turn = normal.cross(force)
                        self.push[i] = self.push[i] + force / mass
                        self.push[j] = self.push[j] - force / mass_j
                        self.twist[i] = self.twist[i] + (lever * turn + torque) / inertia
                        self.twist[j] = self.twist[j] + (lever_j * turn - torque) / inertia_j
                        self.brake[i] = self.brake[i] + grip * radius / inertia
                        self.brake[j] = self.brake[j] + grip * radius_j / inertia_j
                    else:
                        self.pair_slip[i, j] = ti.Vector([0.0, 0.0, 0.0])
                        self.pair_roll[i, j] = ti.Vector([0.0, 0.0, 0.0])
                        clear = ti.min(clear, -0.4 * overlap / (velocity.norm() + slack))
        return clear

    @ti.func
    def push_on_body(self, i, step):
        """Gravity and what effects add to it."""
        push = self.pull[None]
        if ti.static(self.terms.act_on_bodies):
            push += self.push_of_terms(i, step)
        return push

    @ti.func
    def push_of_terms(self, i, step):
        """Acceleration by what acts on a body away from contacts; `push` still holds the last step's."""
        radius, mass = self.body[i][0], self.body[i][1]
        gravity = self.pull[None]
        velocity = self.half[i] + 0.5 * step * self.push[i]
        push = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.terms.acts_in_flight):
            self.walls.face(0, 0, i, self.position[i], radius)
            push += self.terms.in_flight(velocity, self.walls.gap(0, i, radius), radius, mass, upwards(gravity)) / mass
        if ti.static(self.terms.acts_on_threads):
            length = self.thread[i][3]
            if length > 0.0:
                pivot = ti.Vector([self.thread[i][0], self.thread[i][1], self.thread[i][2]])
                arm = (self.position[i] - pivot) / length
                push += self.terms.on_thread(velocity, arm, length, mass, upwards(gravity)) / mass
        return push

    @ti.func
    def law_of_pair(self, i, j):
        law = self.pair_law[i, j]
        if ti.static(self.terms.changes_restitution):
            law[DAMPING] = self.impact[i, j]
        return law

    @ti.func
    def cling(self, i, j, overlap, between):
        """The longest step while effects act on this contact: none; they remember how it began, and may pull."""
        clear = self.clock[2]
        if ti.static(self.terms.act_on_contacts):
            normal = between / between.norm()
            radius, mass = self.body[i][0], self.body[i][1]
            radius_j, mass_j = self.body[j][0], self.body[j][1]
            radius_eff = radius * radius_j / (radius + radius_j)
            law = self.pair_law[i, j]
            state = self.impact[i, j]
            if overlap > 0.0 and state < 0.0:
                closing = (self.half[i] - self.half[j]).dot(normal)
                mass_eff = mass * mass_j / (mass + mass_j)
                state = self.terms.damping_of_pair(law[DAMPING], closing, radius_eff, mass_eff)
            if overlap < -self.terms.neck(radius_eff, law[STIFFNESS]):
                state = -1.0
            if state >= 0.0:
                clear = 0.0
                pull = self.terms.attraction(overlap, radius_eff, law[STIFFNESS])
                self.push[i] = self.push[i] + pull / mass * normal
                self.push[j] = self.push[j] - pull / mass_j * normal
            self.impact[i, j] = state
        return clear

    @ti.func
    def turn_gravity(self, time):
        start = self.gravity[None]
        cosine, sine = ti.cos(start[3] * time), ti.sin(start[3] * time)
        x, z = start[0] * cosine + start[2] * sine, start[2] * cosine - start[0] * sine
        self.pull[None] = ti.Vector([x, start[1], z])

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
    def take_sample(self):
        s = self.counts[3]
        for i in range(self.counts[0]):
            for c in ti.static(range(3)):
                self.out[s, i, c] = self.position[i][c]
                self.out[s, i, 3 + c] = self.velocity[i][c]
                self.out[s, i, 6 + c] = self.spin[i][c]
        self.counts[3] = s + 1
        if s + 1 == self.counts[2]:
            self.counts[4] = DONE

    @ti.kernel
    def advance(self, budget: ti.i32, mechanics: ti.template()):
        """Up to `budget` steps, or until all samples are taken."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            n = self.counts[0]
            left = budget
            while left > 0 and self.counts[4] == RUNNING:
                wanted = self.times[self.counts[3]]
                h = ti.max(self.clock[3], self.clock[1])
                if self.clock[0] + h > wanted - 1e-15:
                    h = ti.max(wanted - self.clock[0], 0.0)
                if self.total_steps[None] < 0:
                    h = 0.0
                for i in range(n):
                    self.drift(i, h, mechanics)
                still = 1 - self.counts[7]
                if self.gravity[None][3] != 0.0:
                    still = 0
                    self.turn_gravity(self.clock[0] + h)
                self.clock[3] = self.forces(h, mechanics)
                for i in range(n):
                    self.velocity[i] = self.across_thread(i, self.half[i] + 0.5 * h * self.push[i])
                    self.spin[i] = self.turned_on(i, self.half_spin[i], 0.5 * h, mechanics)
                    speed2 = self.velocity[i].norm_sqr() + (self.body[i][0] * self.spin[i]).norm_sqr()
                    if not (speed2 < 1e12):
                        self.counts[4] = BROKEN
                        self.counts[6] = i
                    if speed2 > RESTING_SPEED**2 or self.push[i].norm_sqr() > RESTING_ACCELERATION**2:
                        still = 0
                self.clock[0] = self.clock[0] + h
                self.total_steps[None] = self.total_steps[None] + 1
                left -= 1
                while self.counts[4] == RUNNING and (self.clock[0] > self.times[self.counts[3]] - 1e-14 or still == 1):
                    # what rests, under its own weight and without force, rests for good
                    self.take_sample()
