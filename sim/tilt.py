"""Simulation of the tilting plate: it turns slowly until a body slides or rolls (Hlosta et al. 2020, fig. 3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, RigtwinError, SimulationFailed
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Series, Track
from rigtwin.lab.rigs import GRAVITY, Tilt
from rigtwin.lab.units import positive
from rigtwin.sim.engine.contact import OVERLAP_AT_START, Rolling
from rigtwin.sim.engine.time_step import FEW_BODIES
from rigtwin.sim.run.frame_times import MOST_FRAMES, frame_times
from rigtwin.sim.run.trials import FRAMES_AT_REST, TRACK_SIGMA, each, name

if TYPE_CHECKING:
    from rigtwin.sim.engine.effect_terms import Active
    from rigtwin.sim.engine.few.few_body import Case, Motion


STEEPEST = math.radians(85)
HALF = math.sqrt(0.5)
ACROSS = {
    0: (HALF, 0.0, 0.0, HALF),
    1: (1.0, 0.0, 0.0, 0.0),
    2: (HALF, HALF, 0.0, 0.0),
}  # quaternions that turn an axis onto y
MARGIN = 1.3  # on the time to cross the plate; the record ends where the body leaves it


@dataclass(frozen=True)
class Trial:
    """One tilting test: plate, body, contact, and settings of the camera."""

    rig: Tilt
    particle: Particle
    wall: Material
    contact: Contact
    frame_rate: float  # [1/s]
    duration: float | None = None  # [s]; None: until the body has left the plate
    stiffness_factor: float = 1e-3  # of Young's moduli
    rolling: Rolling = "type C"
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)

    @property
    def rolls_a_clump(self) -> bool:
        """Whether the bulk engine simulates it."""
        return self.rig.variant == "roll" and self.particle.shape is not None


def run(
    rig: Tilt,
    particle: Particle,
    wall: Material,
    contact: Contact,
    *,
    frame_rate: float,
    duration: float | None = None,
    stiffness_factor: float = 1e-3,
    rolling: Rolling = "type C",
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> tuple[Series, Track]:
    """Simulate one tilting test and return the angle of the plate and the path of the body, sampled by a camera.

    Parameters
    ----------
    rig : Tilt
        Tilting speed [rad/s], start angle [rad], plate length [m], and variant: "slide", a block of glued particles
        that cannot rotate, or "roll", a sphere, or a clump lying across the plate (a pellet rolls, a cube slides or
        tips over).
    particle : Particle
        The body.
    wall : Material
        Material of the plate.
    contact : Contact
        Coefficients of the contact of body and plate.
    frame_rate : float
        Frames per second [1/s].
    duration : float, optional
        Length of the record [s].  Default: until the body has left the plate.
    stiffness_factor : float
        Factor of Young's moduli [1], at most 1; the onset does not depend on them.
    rolling : {"type A", "type A explicit", "type C"}
        Rolling resistance model.
    effects : Effects
        Effects of a model by name, with their parameters.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    angle : Series
        Angle of the plate [rad], one row per frame; it is at the start angle for five frames.
    path : Track
        Centre of the body [m] in axes fixed in space, x to the right, y up, with the origin in the hinge.  The plate
        lies along x and turns anticlockwise; the body starts in its middle and moves down towards the hinge.  The
        record ends where the body leaves the plate, or after `duration`.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    SimulationFailed
        If the simulation breaks down.

    Notes
    -----
    A sphere or a block is simulated in the axes of the plate under a rotating gravity.  The centrifugal acceleration
    (speed^2 times the distance to the hinge) and the Coriolis acceleration (2 speed times the velocity of the body)
    are neglected: at 1 degree/s and 0.1 m they are 1/300,000 of gravity before the onset and 0.4 % per m/s after it.

    References
    ----------
    Hlosta et al. 2020, fig. 3 and equations 3 and 4.
    """
    from rigtwin.sim.engine.few.few_body import the_one

    trial = Trial(rig, particle, wall, contact, frame_rate, duration, stiffness_factor, rolling, effects)
    return the_one(run_many([trial], progress=progress))


def run_many(
    trials: Sequence[Trial], *, threads: int | None = None, progress: Progress = silent
) -> list[tuple[Series, Track] | RigtwinError]:
    """Simulate many tilting tests.

    Spheres and blocks run in one launch, clumps one after the other.

    Parameters
    ----------
    trials : sequence of Trial
        Trials, one for each tilting test.
    threads : int, optional
        Number of threads of that launch.  Default: all cores.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    list of tuple or RigtwinError
        Angle and path of each test, as `run` returns them; for a trial that breaks down its error.

    Raises
    ------
    BadInput
        If a trial is refused; the message names it.
    """
    from rigtwin.sim.engine.few import few_body

    filmed = list(each(trials, Trial, _frames))
    moving = [k for k, frames in enumerate(filmed) if not trials[k].rolls_a_clump and frames.moving.any()]
    cases = [replace(_case(trials[k], filmed[k]), name=name(k, trials)) for k in moving]
    motions = dict(zip(moving, few_body.run_many(cases, threads=threads, progress=progress), strict=True))
    found: list[tuple[Series, Track] | RigtwinError] = []
    for k, (trial, frames) in enumerate(zip(trials, filmed, strict=True)):
        motion = motions.get(k)
        if isinstance(motion, RigtwinError):
            found.append(motion)
        elif trial.rolls_a_clump:
            found.append(_clump_record(trial, frames, progress))
        else:
            found.append(_record(frames, _seen(trial, frames, motion)))
    return found


def _clump_record(trial: Trial, frames: _Frames, progress: Progress) -> tuple[Series, Track] | RigtwinError:
    """As `_record`, or the error of a simulation that broke down."""
    try:
        return _record(frames, _rolled_clump(trial, frames.time, progress))
    except SimulationFailed as failure:
        return failure


@dataclass(frozen=True, eq=False)
class _Frames:
    """Times of the frames and angles of the plate."""

    time: Array  # [s]
    turning: Array  # [s] since the plate began to turn
    angle: Array  # [rad]

    @property
    def moving(self) -> npt.NDArray[np.bool_]:
        return (self.turning > 0) & (self.angle < STEEPEST)


def check(trial: Trial) -> None:
    """Refuse a trial that `run` would refuse, without simulating.

    Parameters
    ----------
    trial : Trial
        Trial of one tilting test.

    Raises
    ------
    BadInput
        As `run` raises it.
    """
    _frames(trial)


def _frames(trial: Trial) -> _Frames:
    rig, frame_rate, duration = trial.rig, trial.frame_rate, trial.duration
    _check(rig, trial.particle, frame_rate, trial.stiffness_factor)
    if not trial.rolls_a_clump:
        _start(trial)
    if duration is None:
        # the edges of a clump may prevent it from rolling, but not from sliding
        contact = trial.contact
        holds = replace(contact, rolling_friction=contact.static_friction) if trial.rolls_a_clump else contact
        duration = FRAMES_AT_REST / frame_rate + _until_gone(rig, holds)
    positive(duration=duration)
    if (frames := duration * frame_rate) > MOST_FRAMES:
        raise BadInput(
            f"speed: a plate tilted at {math.degrees(rig.speed):.3g} deg/s and recorded for {duration:.3g} s gives "
            f"{frames:.2g} frames at {frame_rate:g} Hz, more than {MOST_FRAMES:,}; tilt it faster, give a shorter "
            f"duration, or a frame rate of at most {MOST_FRAMES / duration:.2g} Hz."
        )
    time = frame_times(duration, frame_rate)
    turning = np.maximum(time - FRAMES_AT_REST / frame_rate, 0.0)
    return _Frames(time, turning, np.minimum(rig.start_angle + rig.speed * turning, STEEPEST))


def _start(trial: Trial) -> tuple[Particle, tuple[float, float, float]]:
    """The simulated body and its position at rest [m], in the axes of the plate."""
    rig, factor = trial.rig, trial.stiffness_factor
    body = _body(rig, trial.particle, factor)
    rest = _depth(body, trial.wall.softened(factor), rig.start_angle)
    if rest >= body.radius:
        raise BadInput(
            f"youngs_modulus: {trial.particle.name} would sink {rest * 1e3:.3g} mm into the plate, past its centre (the"
            f" twin computes with {factor:g} times the stated moduli); check those of the particle and of the wall."
        )
    return body, (rig.plate_length / 2, 0.0, body.radius - rest)


def _case(trial: Trial, frames: _Frames) -> Case:
    """Case of a sphere or a block, in the axes of the plate."""
    from rigtwin.sim.engine.effect_terms import acting
    from rigtwin.sim.engine.few.few_body import Body, Case, contact_step
    from rigtwin.sim.engine.walls.shapes import Plane, Wall

    rig, contact = trial.rig, trial.contact
    if rig.variant == "slide":
        contact = replace(contact, rolling_friction=0.0)
    body, start = _start(trial)
    pressed_in = 1 - start[2] / body.radius  # as deep as its weight presses it
    plate = trial.wall.softened(trial.stiffness_factor)
    return Case(
        [Body(body, start, turns=rig.variant == "roll")],
        frames.turning[frames.moving],
        walls=[Wall(Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), plate, contact)],
        gravity=(-GRAVITY * math.sin(rig.start_angle), 0.0, -GRAVITY * math.cos(rig.start_angle)),
        gravity_turns=rig.speed,
        step=contact_step([body], FEW_BODIES),
        rolling=trial.rolling,
        effects=acting(trial.effects),
        overlap=max(OVERLAP_AT_START, 1.01 * pressed_in),  # with room for rounding
    )


def _seen(trial: Trial, frames: _Frames, motion: Motion | None) -> Array:
    """Path [m] of a sphere or block in the camera's axes, until it leaves the plate; `motion` None: at rest."""
    place = np.tile(_start(trial)[1], (len(frames.time), 1))
    on_plate = len(place)
    if motion is not None:
        place[frames.moving] = motion.position[:, 0]
        on_plate = int(np.flatnonzero(frames.moving)[-1]) + 1
    gone = np.flatnonzero(place[:, 0] < 0)
    end = min(on_plate, int(gone[0]) if len(gone) else len(place))
    along, above, angle = place[:end, 0], place[:end, 2], frames.angle[:end]
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([along * cosine - above * sine, along * sine + above * cosine], axis=1)


def left_out(rig: Tilt, particle: Particle, effects: Effects) -> tuple[str, ...]:
    """Warn about effects of a model that `run` does not simulate.

    Parameters
    ----------
    rig, particle, effects : Tilt, Particle, Effects
        As for `run`.

    Returns
    -------
    tuple of str
        One warning for each such effect.
    """
    return _acting(rig, particle, effects)[1]


def _acting(rig: Tilt, particle: Particle, effects: Effects) -> tuple[tuple[Active, ...], tuple[str, ...]]:
    """Effects that act, and warnings about the others."""
    from rigtwin.sim.engine.effect_terms import acting_among, acting_on_few

    rolls = rig.variant == "roll" and particle.shape is not None
    return acting_among(effects, particle) if rolls else acting_on_few(effects)


def numerics(rig: Tilt, particle: Particle, effects: Effects) -> dict[str, str]:
    """Describe the numerical settings of `run`, and the effects that act.

    Parameters
    ----------
    rig, particle, effects : Tilt, Particle, Effects
        As for `run`; the other settings are taken at their defaults.

    Returns
    -------
    dict of str to str
        Settings in words, by name.
    """
    from rigtwin.sim.engine.effect_terms import named_in
    from rigtwin.sim.engine.few.few_body import Case

    rolls = {"rolling_resistance": f"{Trial.rolling}, torque limit mu_r Fn R"} if rig.variant == "roll" else {}
    return {
        "contact_law": Case.contact_law,
        "stiffness_factor": f"{Trial.stiffness_factor:g} of the real Young's moduli of body and plate",
        "time_step": f"{100 * FEW_BODIES:g}% of Rayleigh's, at most",
        **rolls,
        **named_in(_acting(rig, particle, effects)[0]),
    }


def body_in_words(rig: Tilt, particle: Particle) -> str:
    """Describe the simulated body.

    Parameters
    ----------
    rig, particle : Tilt, Particle
        As for `run`.

    Returns
    -------
    str
        One sentence.
    """
    if rig.variant == "slide":
        return "A body that slides does not turn."
    if particle.shape is None:
        return "The bead that rolls is a sphere."
    lies = "its axis across the plate" if _row(particle) is not None else "its own axes along and across the plate"
    return f"The body is {particle.name}, {len(particle.radii)} spheres in one piece, and lies with {lies}."


def _row(clump: Particle) -> int | None:
    """Axis on which the centres of all spheres of the clump lie; None if they do not lie on one axis."""
    assert clump.shape is not None
    offsets = np.array(clump.shape.offsets)
    axis = int(np.argmax(np.ptp(offsets, axis=0)))
    return axis if np.allclose(np.delete(offsets, axis, axis=1), 0.0) else None


def _record(frames: _Frames, path: Array) -> tuple[Series, Track]:
    """The record of the frames for which there is a path."""
    seen = len(path)
    time, angle = frames.time[:seen], frames.angle[:seen]
    return (
        Series(time, angle, quantity="plate_angle", unit="rad"),
        Track(time=time, position=path, sigma=np.full(seen, TRACK_SIGMA)),
    )


def onset(rig: Tilt, contact: Contact) -> float:
    """Return the angle of the onset.

    Parameters
    ----------
    rig : Tilt
        The variant decides which coefficients hold the body.
    contact : Contact
        Coefficients of the contact of body and plate.

    Returns
    -------
    float
        Angle [rad] whose tangent is the static friction, or, for a body that rolls, the smaller of static and rolling
        friction.

    References
    ----------
    Hlosta et al. 2020, equations 3 and 4.
    """
    holds = contact.static_friction
    if rig.variant == "roll":
        holds = min(holds, contact.rolling_friction)
    return math.atan(holds)


def _rolled_clump(trial: Trial, time: Array, progress: Progress) -> Array:
    """Path [m] of a clump lying across the tilting plate: a pellet rolls, a cube slides or tips over its edge.

    A row of spheres lies with its axis across the plate, any other clump along its own axes.
    """
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.effect_terms import acting_among
    from rigtwin.sim.engine.walls.shapes import Motion, Plane, Wall

    rig, contact, factor = trial.rig, trial.contact, trial.stiffness_factor
    clump = replace(trial.particle, material=trial.particle.material.softened(factor))
    assert clump.shape is not None
    offsets, radii = np.array(clump.shape.offsets), np.array(clump.shape.radii)
    row = _row(clump)
    lie = np.array(ACROSS[1 if row is None else row])
    inclined = np.array([math.cos(rig.start_angle / 2), 0.0, -math.sin(rig.start_angle / 2), 0.0])
    lowest = float((radii - offsets[:, 2]).max() if row is None else radii.max())
    cosine, sine = math.cos(rig.start_angle), math.sin(rig.start_angle)
    along = rig.plate_length / 2
    start = np.array([[along * cosine - lowest * sine, 0.0, along * sine + lowest * cosine]])
    interval = float(time[1] - time[0])
    steps = math.ceil(interval / (FEW_BODIES * clump.rayleigh_time_step))
    lifting = Motion(spin=rig.speed, axis=(0.0, -1.0, 0.0), start=FRAMES_AT_REST * interval)
    room = 1.5 * rig.plate_length
    bulk = Bulk(
        [clump],
        contact,
        [Wall(Plane((0.0, 0.0, 0.0), (-sine, 0.0, cosine)), trial.wall.softened(factor), contact, lifting)],
        low=(-room, -room, -room),
        high=(room, room, room),
        time_step=interval / steps,
        rolling=trial.rolling,
        effects=acting_among(trial.effects, clump)[0],
        threads=1,
        skin=1.0,
    )
    bulk.add(start, turn=_after(inclined, lie)[None])
    path = [start[0, [0, 2]]]
    for number in range(1, len(time)):
        bulk.run(steps)
        place = bulk.grains().position[0, [0, 2]]
        if place[0] < 0:  # it left the plate
            break
        path.append(place)
        progress("tilting", number, len(time))
    return np.array(path)


def _after(second: Array, first: Array) -> Array:
    """Rotation `first` followed by `second`, as quaternions with the real part first."""
    (a, *u), (b, *v) = second, first
    one, other = np.array(u), np.array(v)
    return np.array([a * b - one @ other, *(a * other + b * one + np.cross(one, other))])


def _until_gone(rig: Tilt, contact: Contact) -> float:
    """Time [s] from the start of the tilting until the body has left the plate."""
    waiting = max(onset(rig, contact) - rig.start_angle, 0.0) / rig.speed
    # after the onset the acceleration grows with the angle, by at least 5/7 g cos(alpha) times the tilting speed
    grows = 5 / 7 * GRAVITY * math.cos(onset(rig, contact)) * rig.speed
    return waiting + MARGIN * math.cbrt(3 * rig.plate_length / grows)


def _body(rig: Tilt, particle: Particle, stiffness_factor: float) -> Particle:
    """Simulated sphere: the particle itself, or an equivalent of the block, whose onset is independent of its shape."""
    soft = particle.material.softened(stiffness_factor)
    if particle.shape is None:
        return replace(particle, material=soft)
    density = particle.mass / (math.pi / 6 * particle.diameter**3)
    return Particle(particle.name, soft, particle.diameter, density)


def _depth(body: Particle, plate: Material, angle: float) -> float:
    """Overlap [m] at which Hertz's force balances the body's weight, so that it starts at rest."""
    from rigtwin.sim.engine.contact import pair_law

    modulus = pair_law(body.material, plate, Contact(1.0)).effective_modulus
    weight = body.mass * GRAVITY * math.cos(angle)
    return float((weight / (4 / 3 * modulus * math.sqrt(body.radius))) ** (2 / 3))


def _check(rig: Tilt, particle: Particle, frame_rate: float, stiffness_factor: float) -> None:
    positive(speed=rig.speed, plate_length=rig.plate_length, frame_rate=frame_rate, stiffness_factor=stiffness_factor)
    if rig.variant not in ("slide", "roll"):
        raise BadInput(f"tilt: there is no variant {rig.variant!r}; use 'slide' or 'roll'.")
    if not 0 <= rig.start_angle < STEEPEST:
        given = math.degrees(rig.start_angle)
        raise BadInput(f"start_angle: must lie between 0 and {math.degrees(STEEPEST):g} deg, got {given:g} deg.")
    if rig.plate_length < 4 * particle.diameter:
        raise BadInput(
            f"plate_length: {rig.plate_length * 1e3:.3g} mm is too short for a body of "
            f"{particle.diameter * 1e3:.3g} mm; give at least four diameters."
        )
    if stiffness_factor > 1:
        raise BadInput(f"stiffness_factor: {stiffness_factor:g} would stiffen the body; give at most 1.")
