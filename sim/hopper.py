"""Simulation of the discharge tests: a hopper is filled, its outlet opened, and the beads that leave are counted.

Two hoppers (Hlosta et al. 2020): the conical one of section 2.2.3, whose beads fall out of sight, and the slot hopper
of section 2.2.5, whose beads run down a slide and form a heap on the floor below.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Unpack

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.formatting import as_given
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Profile, Series
from rigtwin.lab.rigs import GRAVITY, SLOT_LENGTH, SLOT_WIDTH, Hopper
from rigtwin.lab.units import positive
from rigtwin.sim.output.outline import bed, outline
from rigtwin.sim.run import filling
from rigtwin.sim.run.run_log import History
from rigtwin.sim.run.set_up import Bench, Numerics
from rigtwin.sim.run.steady_flow import steady_flow

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.bulk.particle_state import Beads, Grains
    from rigtwin.sim.engine.walls.shapes import Shape
    from rigtwin.sim.output.replay import Frame
    from rigtwin.sim.run.run_log import Logbook


LOOK = 0.01  # [s], interval of the samples, as in the paper's simulations
STUCK = 0.5  # [s] without a bead leaving, after which the hopper counts as blocked or empty
BELOW = 0.08  # [m], depth below a round outlet down to which beads are simulated
# slot hopper, where the rig does not state them
SLIDE_DROP = 0.06  # [m]
SLIDE_ANGLE = math.radians(45)  # [rad]
LID = 0  # number of the wall that closes the outlet


@dataclass(frozen=True)
class Discharge:
    """Discharge of a hopper over time; times count from the opening of the outlet.

    x runs across the slot (slot hopper), z up from the outlet.
    """

    outlet_times: Array  # [s], ascending, at which the particles' centres passed the outlet
    mass_left: Series  # [kg] in the hopper over time
    discharge_time: float | None  # [s], from the opening to the last bead; None if beads remain inside
    mass_flow_rate: float | None  # [kg/s], steady part; None where too few beads left
    asked: int
    emptied: int
    remaining: int
    arched: bool  # whether the discharge stopped with particles over the outlet
    centres: Array  # [m], shape (n, 3), of the spheres in the domain at the end
    radii: Array  # [m], shape (n,)
    pile: Profile | None  # outline of the heap on slide and floor, seen along the slot
    at_rest: bool  # whether that heap rests
    time: float  # [s], simulated, filling included
    statistics: dict[str, float] = field(default_factory=dict)
    history: History | None = None  # energy, contacts and overlaps over time
    assumptions: dict[str, str] = field(default_factory=dict)  # all that the rig's description leaves open
    warnings: tuple[str, ...] = ()


def run(
    rig: Hopper,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int = 3000,
    seed: int = 1,
    fill_limit: float = 3.0,
    duration: float | None = None,
    settle_limit: float = 4.0,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Discharge:
    """Fill the hopper, let the beads rest, open the outlet, and record the discharge.

    Parameters
    ----------
    rig : Hopper
        Variant ("conical" or "slot") and dimensions [m], angles [rad].
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
    fill_limit : float
        Longest wait [s] until the filling rests before the outlet opens.
    duration : float, optional
        Longest discharge [s].  Default: until the hopper is empty, or no bead has left for 0.5 s.
    settle_limit : float
        Longest wait [s] until the heap below a slot hopper rests.
    progress : Progress
        Callback for the progress display.
    **numerics : Numerics
        Numerical settings, see `rigtwin.sim.run.set_up.Numerics`.

    Returns
    -------
    Discharge
        Times of passage, mass in the hopper, mass flow rate, and the heap below a slot hopper.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    SimulationFailed
        If the simulation breaks down.

    Notes
    -----
    The whole outlet opens at once.  The time at which a bead passes the outlet follows from its free fall below it.

    References
    ----------
    Hlosta et al. 2020, sections 2.2.3 and 2.2.5.
    """
    check(rig, particle, count=count, duration=duration)
    plan = plan_of(rig, particle, count)
    positive(fill_limit=fill_limit, settle_limit=settle_limit)
    bench = Bench(rig, particle, wall, contact, wall_contact, numerics)
    bulk = bench.bulk(plan.shapes, plan.domain)
    course = _Course(count=count)
    limits = {"fill_limit": fill_limit, "settle_limit": settle_limit, "duration": duration}
    with bench.logbook(bulk, count=count, seed=seed, **limits) as logbook:
        if kept := logbook.resume():
            course = _Course(**kept)
        else:
            filling.scatter(bulk, count, plan.inside, plan.filled, particle, np.random.default_rng(seed))
        _settle(bulk, logbook, course, particle, fill_limit, progress)
        _discharge(bulk, logbook, course, plan, duration, progress)
        at_rest = not plan.floor or filling.settle(bulk, logbook, course, particle, settle_limit, progress, every=LOOK)
    return _discharge_of(
        rig,
        particle,
        plan,
        course,
        bulk.beads(),
        at_rest=at_rest,
        time=bulk.time,
        statistics=logbook.statistics(),
        history=logbook.history,
        assumptions={**_opening(course), **bench.assumptions()},
        warnings=bench.warnings(bulk, logbook),
    )


def replayed(
    rig: Hopper,
    particle: Particle,
    frames: Sequence[Frame],
    *,
    asked: int,
    in_time: bool,
    at_rest: bool,
) -> Discharge:
    """The result of a discharge that another program computed.

    Parameters
    ----------
    rig : Hopper
        Outlet [m], shape and sizes of the hopper.
    particle : Particle
        The sphere.
    frames : sequence of Frame
        The spheres as the outlet opens, then at regular intervals.  Those that are no longer there have left.
    asked : int
        Number of particles.
    in_time : bool
        Whether the bed was at rest as the outlet opened.
    at_rest : bool
        Whether the heap below a slot hopper rests in the last frame.

    Returns
    -------
    Discharge
        Times of passage, mass in the hopper and mass flow rate, as `run` gives them.
    """
    plan, course = plan_of(rig, particle, asked), _Course(count=asked, in_time=in_time, let_go=frames[0].time)
    course.looks.append((0.0, asked))
    interval = frames[1].time - frames[0].time if len(frames) > 1 else LOOK
    for frame in frames[1:]:
        now = frame.time - frames[0].time
        _note_who_left(frame.grains(particle), course, now, interval)
        course.looks.append((now, sum(when is None for when in course.left_at)))
    now, inside = course.looks[-1]
    last = max((when for when in course.left_at if when is not None), default=0.0)
    course.arched = inside > 0 and now - last > STUCK and plan.over_outlet(frames[-1].position)
    return _discharge_of(
        rig, particle, plan, course, frames[-1].beads(particle), at_rest=at_rest, time=frames[-1].time, statistics={},
        history=None, assumptions=_opening(course), warnings=(),
    )  # fmt: skip


def _opening(course: _Course) -> dict[str, str]:
    return {
        "opening": "the whole outlet opens at once",
        "filling": f"placed loosely above the outlet and let fall, {course.let_go:.2f} s until the bed rested",
    }


def _discharge_of(
    rig: Hopper,
    particle: Particle,
    plan: Plan,
    course: _Course,
    beads: Beads,
    *,
    at_rest: bool,
    time: float,
    statistics: dict[str, float],
    history: History | None,
    assumptions: dict[str, str],
    warnings: tuple[str, ...],
) -> Discharge:
    count = course.count
    times = np.sort(np.array([when for when in course.left_at if when is not None], dtype=float))
    emptied = len(times)
    flow = steady_flow(times, np.arange(emptied, dtype=float), count)
    return Discharge(
        outlet_times=times,
        mass_left=_mass_left(course, particle, count),
        discharge_time=float(times[-1]) if emptied == count else None,
        mass_flow_rate=None if flow is None else flow * particle.mean_mass,
        asked=count,
        emptied=emptied,
        remaining=count - emptied,
        arched=course.arched,
        centres=beads.position,
        radii=beads.radius,
        pile=_heap(beads, particle, plan) if plan.floor else None,
        at_rest=at_rest,
        time=time,
        statistics=statistics,
        history=history,
        assumptions={**plan.assumptions, **assumptions},
        warnings=warnings + _warnings(rig, particle, course, emptied, count, at_rest),
    )


def picture(rig: Hopper, particle: Particle, discharge: Discharge) -> npt.NDArray[np.uint8]:
    """Draw the hopper and the beads at the end; a slot hopper is drawn without its vertical plates.

    Parameters
    ----------
    rig, particle : Hopper, Particle
        As for `run`.
    discharge : Discharge
        Run that has ended.

    Returns
    -------
    ndarray, shape (height, width, 3)
        RGB image.
    """
    from rigtwin.sim.output.picture import draw
    from rigtwin.sim.output.trajectory import triangles

    plan = plan_of(rig, particle, discharge.asked)
    triangles_of = [triangles(shape, plan.domain) for shape in plan.shapes[LID + 1 :]]
    walls = np.concatenate(triangles_of)
    if rig.variant == "slot":  # plates facing the viewer would hide the beads
        walls = walls[np.ptp(walls[:, :, 1], axis=1) > 0]
        low = walls.reshape(-1, 3).min(axis=0)
        walls = walls[walls[:, :, 2].min(axis=1) < low[2] + 3 * plan.domain[1][0]]
    return draw(discharge.centres, discharge.radii, walls=walls, turn=20.0, tilt=15.0)


# ---------------------------------------------------------------------- the rig


@dataclass(frozen=True)
class Plan:
    """Walls of the hopper, the lid of the outlet first, and its domain."""

    shapes: tuple[Shape, ...]
    filled: tuple[Array, Array]  # [m], corners of the box in which the beads are placed
    domain: tuple[Array, Array]  # [m]
    inside: filling.Inside
    floor: float  # [m], height of the floor below the outlet, negative; 0 without a floor
    assumptions: dict[str, str]
    outlet: float  # [m], diameter, or width of the slot
    round: bool  # False: a slot along y

    def over_outlet(self, centres: Array) -> bool:
        """Return whether particles are over the middle of the outlet; those lying around it do not block it.

        Parameters
        ----------
        centres : ndarray, shape (n, 3)
            Centres of the particles [m].

        Returns
        -------
        bool
            Whether one is above the outlet and within a quarter of its width of the middle.
        """
        from_axis = np.hypot(centres[:, 0], centres[:, 1]) if self.round else np.abs(centres[:, 0])
        return bool(((from_axis < self.outlet / 4) & (centres[:, 2] > 0)).any())


def plan_of(rig: Hopper, particle: Particle, count: int) -> Plan:
    """Plan walls, filling and domain of a hopper.

    Parameters
    ----------
    rig, particle : Hopper, Particle
        As for `run`.
    count : int
        Number of particles, for which there is room above the outlet.

    Returns
    -------
    Plan
        The plan, with defaults for what the rig does not state.
    """
    room = filling.loose_room(particle, count)
    return _slot(rig, particle, room) if rig.variant == "slot" else _conical(rig, particle, room)


def _conical(rig: Hopper, particle: Particle, room: float) -> Plan:
    wide, cone = rig.diameter / 2, rig.cone_height
    top = cone + room / (math.pi * wide**2)
    return Plan(
        shapes=filling.funnel(rig.outlet, rig.diameter, cone, top),
        filled=(np.array([-wide, -wide, 0.0]), np.array([wide, wide, top])),
        domain=(np.array([-1.5 * wide, -1.5 * wide, -BELOW]), np.array([1.5 * wide, 1.5 * wide, top + wide])),
        inside=filling.in_funnel(rig.outlet, rig.diameter, cone),
        floor=0.0,
        assumptions={
            "cylinder": f"{rig.diameter * 1e3:.3g} mm wide and as high as the filling needs, on a cone of "
            f"{cone * 1e3:.3g} mm height",
        },
        outlet=rig.outlet,
        round=True,
    )


def _slot(rig: Hopper, particle: Particle, room: float) -> Plan:
    from rigtwin.sim.engine.walls.shapes import Plate

    width = SLOT_WIDTH if rig.width is None else rig.width
    length = SLOT_LENGTH if rig.slot_length is None else rig.slot_length
    angle = SLIDE_ANGLE if rig.slide_angle is None else rig.slide_angle
    drop = SLIDE_DROP if rig.slide_drop is None else rig.slide_drop
    positive(width=width, slot_length=length, slide_angle=angle, slide_drop=drop)
    narrow, wide, deep = rig.outlet / 2, width / 2, length / 2
    rise = (wide - narrow) * math.tan(rig.inclination)
    top = rise + room / (width * length)
    # beads hit the slide in its upper third; it ends on the floor, which is as long as the hopper is wide
    reach = 1.5 * width
    begins = (-reach / 3, -drop + reach / 3 * math.tan(angle))
    ends = (begins[0] + reach, begins[1] - reach * math.tan(angle))
    if begins[1] > -particle.diameter:
        begins = (-(drop - particle.diameter) / math.tan(angle), -particle.diameter)
    floor, far = ends[1], ends[0] + width
    along = (0.0, length, 0.0)
    slope = (wide - narrow) / rise

    def inside(points: Array, clear: float) -> npt.NDArray[np.bool_]:
        across, z = np.abs(points[:, 0]), points[:, 2]
        free = narrow + slope * z - across > clear * math.hypot(1, slope)
        return np.asarray(free & (wide - across > clear) & (deep - np.abs(points[:, 1]) > clear) & (z > clear))

    shapes = [Plate((-narrow, -deep, 0.0), (2 * narrow, 0.0, 0.0), along)]
    for side in (-1, 1):
        shapes.append(Plate((side * narrow, -deep, 0.0), (side * (wide - narrow), 0.0, rise), along))
        shapes.append(Plate((side * wide, -deep, rise), (0.0, 0.0, top - rise), along))
        front = (begins[0] - wide, side * deep, floor - particle.diameter)
        shapes.append(Plate(front, (far + wide - front[0], 0.0, 0.0), (0.0, 0.0, top - front[2])))
    shapes.append(Plate((begins[0], -deep, begins[1]), (ends[0] - begins[0], 0.0, ends[1] - begins[1]), along))
    shapes.append(Plate((ends[0], -deep, floor), (width, 0.0, 0.0), along))
    shapes.append(Plate((far, -deep, floor), (0.0, 0.0, -floor), along))
    margin = 2 * particle.diameter
    low = np.array([begins[0] - wide, -deep - margin, floor - margin])
    assumed = {"slot_length": (rig.slot_length, length), "width": (rig.width, width)}
    assumed["slide_drop"] = (rig.slide_drop, drop)
    words = {name: f"{used * 1e3:.3g} mm ({as_given(given)})" for name, (given, used) in assumed.items()}
    return Plan(
        shapes=tuple(shapes),
        filled=(np.array([-wide, -deep, 0.0]), np.array([wide, deep, top])),
        domain=(low, np.array([far + margin, deep + margin, top + wide])),
        inside=inside,
        floor=floor,
        assumptions={
            **words,
            "inclination": f"{math.degrees(rig.inclination):.3g} degrees",
            "slide_angle": f"{math.degrees(angle):.3g} degrees ({as_given(rig.slide_angle)})",
            "floor": f"{-floor * 1e3:.3g} mm below the slot, at the slide's end, {width * 1e3:.3g} mm long",
        },
        outlet=rig.outlet,
        round=False,
    )


# ---------------------------------------------------------------------- the run


@dataclass(kw_only=True)
class _Course(filling.Filling):
    """State of filling and discharge; a run resumes from it and from the state of the beads."""

    count: int
    emptied_at: float | None = None  # [s], end of the discharge
    arched: bool = False
    left_at: list[float | None] = field(default_factory=list)  # [s], after the opening, of each bead
    looks: list[tuple[float, int]] = field(default_factory=list)  # time [s] after the opening, beads inside

    def __post_init__(self) -> None:
        self.left_at = self.left_at or [None] * self.count


def _settle(
    bulk: Bulk, logbook: Logbook, course: _Course, particle: Particle, limit: float, progress: Progress
) -> None:
    """Let the bed come to rest on the lid, then remove the lid."""
    if course.let_go is None:
        filling.settle_and_let_go(bulk, logbook, course, particle, limit, progress, every=LOOK)
        course.looks.append((0.0, course.count))
        bulk.remove_wall(LID)


def _discharge(
    bulk: Bulk, logbook: Logbook, course: _Course, plan: Plan, duration: float | None, progress: Progress
) -> None:
    """Record which beads have left, until no more do."""
    assert course.let_go is not None
    steps = max(1, round(LOOK / bulk.time_step))
    while course.emptied_at is None:
        logbook.run(steps)
        now = bulk.time - course.let_go
        _note_who_left(bulk.grains(), course, now)
        inside = sum(when is None for when in course.left_at)
        course.looks.append((now, inside))
        last = max((when for when in course.left_at if when is not None), default=0.0)
        if inside == 0 or now - last > STUCK or (duration is not None and now >= duration):
            course.emptied_at = bulk.time
            course.arched = now - last > STUCK and plan.over_outlet(bulk.grains().position)
        logbook.look(course.kept())
        progress("emptying", float(course.count - inside), float(course.count))


def _note_who_left(grains: Grains, course: _Course, now: float, interval: float = LOOK) -> None:
    """Record the times at which beads passed the outlet, from their free fall below it."""
    there = np.full(course.count, -1)
    there[grains.ident] = np.arange(len(grains.ident))
    for ident in (k for k, when in enumerate(course.left_at) if when is None):
        row = there[ident]
        if row < 0:  # already out of the domain
            course.left_at[ident] = now
        elif (below := -float(grains.position[row, 2])) > 0:
            speed = max(-float(grains.velocity[row, 2]), 1e-9)
            ago = (speed - math.sqrt(max(speed**2 - 2 * GRAVITY * below, 0.0))) / GRAVITY
            course.left_at[ident] = now - min(ago, interval)


# ---------------------------------------------------------------------- the result


def _mass_left(course: _Course, particle: Particle, count: int) -> Series:
    time_, inside = np.array(course.looks, dtype=float).reshape(-1, 2).T
    return Series(time_, inside * particle.mean_mass, "mass_left", "kg")


def _heap(beads: Beads, particle: Particle, plan: Plan) -> Profile:
    below = beads.position[:, 2] < 0
    centres, radii = beads.position[below], beads.radius[below]
    heap = bed(centres, radii)
    span, grain = (float(plan.domain[0][0]), float(plan.domain[1][0])), 2 * particle.smallest_radius
    return outline(centres[heap], radii[heap], span, grain=grain, floor=plan.floor, view="along the slot")


def check(rig: Hopper, particle: Particle, *, count: int, duration: float | None = None) -> None:
    """Refuse settings that `run` would refuse, without simulating.

    Parameters
    ----------
    rig, particle : Hopper, Particle
        As for `run`.
    count : int
        Number of particles.
    duration : float, optional
        Longest discharge [s].

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    """
    positive(outlet=rig.outlet)
    if rig.variant == "conical":
        positive(diameter=rig.diameter, cone_height=rig.cone_height)
    elif not 0 < rig.inclination < math.pi / 2:
        raise BadInput(
            f"inclination: {math.degrees(rig.inclination):g} degrees is not between 0 and 90; count it from the "
            "horizontal."
        )
    elif rig.slide_drop is not None and rig.slide_drop < particle.diameter:
        raise BadInput(
            f"slide_drop: {rig.slide_drop * 1e3:.3g} mm between slot and slide let no bead of "
            f"{particle.diameter * 1e3:.3g} mm through; lower the slide."
        )
    across = rig.diameter if rig.variant == "conical" else SLOT_WIDTH if rig.width is None else rig.width
    if rig.outlet >= across:
        raise BadInput(
            f"outlet: {rig.outlet * 1e3:.3g} mm is as wide as the hopper of {across * 1e3:.3g} mm; narrow it."
        )
    if rig.outlet < particle.diameter:
        raise BadInput(
            f"outlet: {rig.outlet * 1e3:.3g} mm lets no bead of {particle.diameter * 1e3:.3g} mm through; widen it."
        )
    if rig.variant == "slot":
        filling.need_gap("depth", SLOT_LENGTH if rig.slot_length is None else rig.slot_length, particle)
    if count < 1:
        raise BadInput(f"count: {count} beads fill no hopper; give at least 1.")
    if duration is not None:
        positive(duration=duration)


def _warnings(
    rig: Hopper, particle: Particle, course: _Course, emptied: int, count: int, at_rest: bool
) -> tuple[str, ...]:
    warnings = []
    if not course.in_time:
        warnings.append("the bed was still moving when the outlet was opened; raise --fill-limit")
    if emptied < count:
        jam = filling.arch_in_words("the others", rig.outlet, particle)
        why = f": {jam}; give a wider --outlet" if course.arched else ""
        warnings.append(f"only {emptied} of {count} beads had left the hopper when the run ended{why}")
    if not at_rest:
        warnings.append("the heap was still moving when the time limit was reached; raise --settle-limit")
    return tuple(warnings)
