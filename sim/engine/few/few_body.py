"""Simulation of up to 16 bodies with an adaptive time step; many independent cases in one launch.

It is used for rigs whose result depends on single collisions (drop, pendulum).  Moduli are not softened, and the step
in contact is a small fraction of Rayleigh's.  Between contacts the step grows with the gap, without crossing it.
Velocity Verlet, float64; a body may be suspended on a rigid massless thread (RATTLE).

::

    motion = run([Body(bead, (0, 0, 0.3))], times, walls=[floor])
    motions = run_many([Case([Body(bead, (0, 0, h))], times, walls=[floor]) for h in heights])
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, RigtwinError, SimulationFailed
from rigtwin.lab.materials import Contact, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.effects import Effect
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.contact import (
    IMPACT_SPEED,
    LAW_SIZE,
    OVERLAP_AT_START,
    ContactLaw,
    Mechanics,
    Rolling,
    pair_law,
)
from rigtwin.sim.engine.effect_terms import Active, checked
from rigtwin.sim.engine.few import batch
from rigtwin.sim.engine.few import step as few_step
from rigtwin.sim.engine.few.batch import Copy, Outcome
from rigtwin.sim.engine.time_step import of_kind
from rigtwin.sim.engine.walls.shapes import Wall, gaps
from rigtwin.sim.engine.walls.wall_table import WallTable, wall_table

_Result = TypeVar("_Result")

BODIES = 16
ELEMENTS = 64  # largest number of wall elements (planes, discs, triangles ...)
ACCURATE_FRACTION = 0.015  # of Rayleigh's step: 1/20 of the usual 30 %; the error of the restitution is then < 0.1 %
FLIGHT_STEP = 1e-4  # [s], default longest step out of contact
HALVINGS = 6
UNTURNABLE = 1e30  # [kg m^2]


@dataclass(frozen=True)
class Body:
    """One sphere, its initial state, and the thread on which it may be suspended."""

    particle: Particle
    position: tuple[float, float, float]  # [m]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m/s]
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad/s]
    pivot: tuple[float, float, float] | None = None  # [m], other end of the thread; None: free
    turns: bool = True  # False: its spin is constant, as for a body that cannot roll


@dataclass(frozen=True, eq=False)
class Case:
    """One simulation: bodies, walls, contacts and gravity, from t = 0 on.

    `contacts` is one Contact for all pairs of bodies, or one per pair (i, j) with i < j; None: no contact forces.
    Gravity rotates about y at `gravity_turns`, from z towards x, as in the axes of a plate whose far end (x > 0) sinks.
    `effects` act on all bodies and contacts.  The springs of the "linear" law are as stiff as Hertz's contacts at
    `impact_speed`.
    """

    bodies: Sequence[Body]
    times: Array  # [s], ascending, of the samples
    walls: Sequence[Wall] = ()
    contacts: Mapping[tuple[int, int], Contact] | Contact | None = None
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)  # [m/s^2]
    gravity_turns: float = 0.0  # [rad/s]
    step: float | None = None  # [s], in contact; None: `contact_step`
    flight_step: float = FLIGHT_STEP  # [s], longest step out of contact
    rolling: Rolling = "type C"
    contact_law: ContactLaw = "Hertz-Mindlin"
    impact_speed: float = IMPACT_SPEED  # [m/s]
    effects: Sequence[Active] = ()
    overlap: float = OVERLAP_AT_START  # [radii], largest at t = 0 with walls and other bodies
    name: str = ""  # in error messages; default: its index, as in "cases[3]"


@dataclass(frozen=True, eq=False)
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


def run(bodies: Sequence[Body], times: Array, *, progress: Progress = silent, **settings: Any) -> Motion:
    """Simulate a few bodies from t = 0 and sample their motion.

    Parameters
    ----------
    bodies : sequence of Body
        1 to 16 spheres with initial states.
    times : array
        Times of the samples [s], shape (k,), ascending.
    progress : Progress
        Callback for the progress display.
    **settings
        Further fields of a `Case`, such as `walls`, `contacts` and `effects`.

    Returns
    -------
    Motion
        Positions [m], velocities [m/s] and spins [rad/s] at the sample times, shape (k, n, 3) for n bodies.

    Raises
    ------
    BadInput
        If a setting is out of its range, or bodies overlap at the start.
    SimulationFailed
        If a velocity is not finite or above 1000 km/s.

    Notes
    -----
    Velocity Verlet.  The step is `step` in contact, and grows up to `flight_step` with the gap between contacts.

    Examples
    --------
    >>> import numpy as np
    >>> from rigtwin.lab.reference import hlosta2020
    >>> motion = run([Body(hlosta2020.particle("D6"), (0.0, 0.0, 1.0))], np.array([0.1]))
    >>> round(float(motion.position[0, 0, 2]), 3)
    0.951
    """
    return the_one(run_many([Case(bodies, times, **settings)], progress=progress))


def run_many(
    cases: Sequence[Case], *, threads: int | None = None, progress: Progress = silent
) -> list[Motion | RigtwinError]:
    """Simulate many cases in parallel.

    Parameters
    ----------
    cases : sequence of Case
        The simulations; those with the same effects and contact law share a kernel.
    threads : int, optional
        Number of threads.  Default: all cores.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    list of Motion or RigtwinError
        One result per case; the result of a case that breaks down is its error.

    Raises
    ------
    BadInput
        If a setting of a case is out of its range; the message names the case.

    Notes
    -----
    The result of a case does not depend on the other cases or on the number of threads, to the bit.
    """
    return _run(_ready(cases), threads, progress)


def run_many_halved(
    cases: Sequence[Case], *, tolerance: float, threads: int | None = None, progress: Progress = silent
) -> list[tuple[Motion, float] | RigtwinError]:
    """`run_many` with the step in contact halved until no sampled position changes by more than `tolerance` [m].

    Returns, of each case, the finer of the last two runs and their largest distance [m], which exceeds the tolerance
    only if six halvings were not enough. Cases that have converged are left out of further halvings.
    """
    ready = _ready(cases)
    latest = _run(ready, threads, progress)
    apart = np.full(len(cases), math.inf)
    for halving in range(1, HALVINGS + 1):
        left = [k for k, it in enumerate(latest) if isinstance(it, Motion) and not apart[k] <= tolerance]
        finer = _run([ready[k].halved(halving) for k in left], threads, progress)
        for k, fine in zip(left, finer, strict=True):
            coarse = latest[k]
            if isinstance(fine, Motion) and isinstance(coarse, Motion):
                apart[k] = np.abs(fine.position - coarse.position).max()
            latest[k] = fine
    return [(it, float(apart[k])) if isinstance(it, Motion) else it for k, it in enumerate(latest)]


def the_one(results: Sequence[_Result | RigtwinError]) -> _Result:
    """Return the only result; if it is an error, raise it."""
    (result,) = results
    if isinstance(result, RigtwinError):
        raise result
    return result


# ---------------------------------------------------------------------- cases in numbers


@dataclass(frozen=True)
class _Ready:
    """A checked case, converted to numbers."""

    copy: Copy
    mechanics: Mechanics
    prefix: str  # of errors

    @property
    def alike(self) -> tuple[tuple[Effect, ...], Mechanics]:
        """Key of the cases that can share a launch, and so a compiled kernel."""
        return tuple(one.effect for one in self.copy.effects), self.mechanics

    def halved(self, times: int) -> "_Ready":
        clock = self.copy.clock.copy()
        clock[few_step.STEP] /= 2**times
        return replace(self, copy=replace(self.copy, clock=clock))


def _run(ready: Sequence[_Ready], threads: int | None, progress: Progress) -> list[Motion | RigtwinError]:
    """Run all cases, grouped by kernel."""
    if threads is not None and threads < 1:
        raise BadInput(f"threads: {threads} is too few; give at least 1.")
    threads = threads or backend.running().threads
    groups: dict[object, list[int]] = {}
    for k, one in enumerate(ready):
        groups.setdefault(one.alike, []).append(k)
    whole = sum(float(one.copy.times[-1]) for one in ready)
    before = 0.0
    found: dict[int, Motion | RigtwinError] = {}
    for members in groups.values():

        def tell(time: float, before: float = before) -> None:
            progress("simulating", before + time, whole)

        copies = [ready[k].copy for k in members]
        outcomes = batch.run(copies, ready[members[0]].mechanics, threads, tell)
        found |= {k: _motion(ready[k], one) for k, one in zip(members, outcomes, strict=True)}
        before += sum(float(copy.times[-1]) for copy in copies)
    return [found[k] for k in range(len(ready))]


def _motion(ready: _Ready, outcome: Outcome) -> Motion | RigtwinError:
    if outcome.culprit >= 0:
        return SimulationFailed(
            f"{ready.prefix}The simulation broke down at t = {outcome.time:.6g} s (body {outcome.culprit}): "
            "its speed is above 1000 km/s or not a number; use a smaller step."
        )
    data = outcome.samples
    return Motion(ready.copy.times, data[:, :, 0:3], data[:, :, 3:6], data[:, :, 6:9], outcome.steps)


def _ready(cases: Sequence[Case]) -> list[_Ready]:
    ready = []
    for k, case in enumerate(cases):
        name = getattr(case, "name", "") or (f"cases[{k}]" if len(cases) > 1 else "")
        prefix = f"{name}: " if name else ""
        try:
            of_kind(case, Case)
            ready.append(_Ready(_in_numbers(case), Mechanics(case.contact_law, case.rolling), prefix))
        except BadInput as error:
            raise type(error)(f"{prefix}{error}") from None
    return ready


def _in_numbers(case: Case) -> Copy:
    times = np.ascontiguousarray(case.times, dtype=np.float64)
    _check(case, times)
    step = case.step
    if step is None:
        step = min(contact_step([body.particle for body in case.bodies]), case.flight_step)
    if not 0 < step <= case.flight_step:
        raise BadInput(f"step: {step:g} s does not lie between 0 and the flight step of {case.flight_step:g} s.")
    kinds = list(dict.fromkeys(body.particle for body in case.bodies))
    clock = np.zeros(few_step.CLOCK)
    clock[few_step.STEP], clock[few_step.LONGEST] = step, case.flight_step
    clock[few_step.STEPS] = -1.0
    clock[few_step.GRAVITY : few_step.TURNS + 1] = *case.gravity, case.gravity_turns
    return Copy(
        np.array([_body_row(body, kinds) for body in case.bodies]),
        _pair_rows(case),
        _walls(case, kinds),
        times,
        clock,
        any(wall.motion is not None or math.isfinite(wall.until) for wall in case.walls),
        tuple(checked(case.effects)),
    )


def _body_row(body: Body, kinds: Sequence[Particle]) -> tuple[float, ...]:
    particle = body.particle
    pivot = body.pivot or (0.0, 0.0, 0.0)
    length = 0.0 if body.pivot is None else float(np.linalg.norm(np.subtract(body.position, pivot)))
    inertia = 0.4 * particle.mass * particle.radius**2 if body.turns else UNTURNABLE
    return (
        *body.position, *body.velocity, *body.spin, particle.radius, particle.mass, inertia, *pivot, length,
        kinds.index(particle),
    )  # fmt: skip


def _pair_rows(case: Case) -> Array:
    bodies, contacts = case.bodies, case.contacts
    if isinstance(contacts, Mapping):
        for i, j in contacts:
            if not 0 <= i < j < len(bodies):
                raise BadInput(f"contacts: ({i}, {j}) is no pair (i, j) of {len(bodies)} bodies with i < j.")
    rows = np.zeros((len(bodies), len(bodies), LAW_SIZE + 1))
    for i in range(len(bodies) if contacts is not None else 0):
        for j in range(i + 1, len(bodies)):
            contact = contacts if isinstance(contacts, Contact) or contacts is None else contacts.get((i, j))
            if contact is not None:
                law = pair_law(bodies[i].particle.material, bodies[j].particle.material, contact, case.impact_speed)
                rows[i, j] = (*law.row, 1.0)
    return rows.reshape(-1, LAW_SIZE + 1)


def _walls(case: Case, kinds: Sequence[Particle]) -> WallTable:
    """Table of the walls without its spare rows."""
    everywhere = np.full(3, -few_step.ENDLESS), np.full(3, few_step.ENDLESS)
    given = [(wall,) * len(kinds) for wall in case.walls]
    table = wall_table(given, kinds, skin=0.0, domain=everywhere, impact_speed=case.impact_speed)
    count = len(given)
    elements = table.elements if count else table.elements[:0]
    return replace(table, elements=elements, motion=table.motion[:count], law=table.law[:, :count])


def _check(case: Case, times: Array) -> None:
    bodies, walls = case.bodies, case.walls
    if not 1 <= len(bodies) <= BODIES:
        raise BadInput(
            f"bodies: {len(bodies)} were given; this engine takes 1 to {BODIES}, use the bulk engine for more."
        )
    if (count := sum(len(wall.shape.rows) for wall in walls)) > ELEMENTS:
        raise BadInput(
            f"walls: they have {count} parts; this engine takes {ELEMENTS}, use the bulk engine for larger meshes."
        )
    for body in bodies:
        if body.particle.shape is not None:
            raise BadInput(
                f"{body.particle.name} is a clump; this simulation takes single spheres only, name a sphere instead."
            )
    if len(times) == 0 or times[0] < 0 or not np.all(np.isfinite(times)) or not np.all(np.diff(times) > 0):
        raise BadInput("times: must be finite, rise, and start at or after 0 s.")
    state = np.array([[*b.position, *b.velocity, *b.spin, *(b.pivot or ())][:9] for b in bodies])
    if not np.all(np.isfinite(state)):
        bad = int(np.flatnonzero(~np.isfinite(state).all(axis=1))[0])
        raise BadInput(f"body {bad}: its position, velocity or spin is not a finite number.")
    centres, radii = state[:, :3], np.array([b.particle.radius for b in bodies])
    tolerance = case.overlap * radii
    for wall in walls:
        gap = gaps(wall.shape, wall.motion.undone(centres, 0.0) if wall.motion else centres, radii)
        if np.any(gap < -tolerance):
            bad = int(np.argmin(gap))
            raise BadInput(f"body {bad} starts {-gap[bad] * 1e3:.3g} mm inside a wall; move it out.")
    for i in range(len(bodies) if case.contacts is not None else 0):
        gap = np.linalg.norm(centres[i + 1 :] - centres[i], axis=1) - radii[i + 1 :] - radii[i]
        if np.any(gap < -tolerance[i]):
            bad = i + 1 + int(np.argmin(gap))
            raise BadInput(f"bodies {i} and {bad} overlap at the start by {-gap.min() * 1e3:.3g} mm; move them apart.")
