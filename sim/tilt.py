"""The twin of the tilting plate: it turns slowly until what lies on it slides or rolls (Hlosta et al. 2020, fig. 3)."""

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
from rigtwin.sim.engine.contact import Rolling
from rigtwin.sim.engine.time_step import positive
from rigtwin.sim.run.frame_times import MOST_FRAMES, frame_times
from rigtwin.sim.run.trials import FRAMES_AT_REST, TRACK_SIGMA, each, name

if TYPE_CHECKING:
    from rigtwin.sim.engine.few.few_body import Case, Motion


STEP = 0.1  # of Rayleigh's
STEEPEST = math.radians(85)
HALF = math.sqrt(0.5)
ACROSS = {0: (HALF, 0.0, 0.0, HALF), 1: (1.0, 0.0, 0.0, 0.0), 2: (HALF, HALF, 0.0, 0.0)}  # turns an axis onto y
MARGIN = 1.3  # times the way's time; the record ends where the body leaves the plate


@dataclass(frozen=True)
class Trial:
    """One plate and what lies on it, and how it is filmed."""

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
        """Whether the bulk engine has to move it."""
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
    """Angle of the plate and path of the body, sampled as a camera of `frame_rate` [1/s] would.

    Axes fixed in space, x to the right, y up, the hinge in the origin; the plate lies along x and turns
    anticlockwise, from `rig.start_angle` on, after five frames at rest.  The body starts in the plate's middle and
    goes down towards the hinge; the record ends where it leaves the plate, or after `duration` [s].

    "slide" is a block of glued particles that cannot roll, moved as one that does not turn; "roll" is a single sphere,
    or a clump that lies across the plate: a pellet rolls, a cube slides or tips.  The motion of a sphere or a block is
    worked out in the plate's axes under a gravity that turns.  What is left out there, the centrifugal and the Coriolis
    acceleration, is speed^2 times the way to the hinge, and 2 speed times the body's velocity: at one degree a second
    and 0.1 m a 300,000th of gravity before the onset, 0.4 % of it per m/s after.
    Young's moduli are multiplied by `stiffness_factor`: the onset does not hang on them.
    """
    from rigtwin.sim.engine.few.few_body import the_one

    trial = Trial(rig, particle, wall, contact, frame_rate, duration, stiffness_factor, rolling, effects)
    return the_one(run_many([trial], progress=progress))


def run_many(
    trials: Sequence[Trial], *, threads: int | None = None, progress: Progress = silent
) -> list[tuple[Series, Track] | RigtwinError]:
    """Angles and paths of many plates, each as `run` gives them, over `threads` (None: all cores).

    Spheres and blocks move in one launch, clumps one after the other.  In the place of a trial that breaks down stands
    the error that says so.
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
    """As `_record`, or why the clump's simulation broke down."""
    try:
        return _record(frames, _rolled_clump(trial, frames.time, progress))
    except SimulationFailed as failure:
        return failure


@dataclass(frozen=True, eq=False)
class _Frames:
    """When the camera looks, and how the plate stands then."""

    time: Array  # [s]
    turning: Array  # [s] since the plate began to turn
    angle: Array  # [rad]

    @property
    def moving(self) -> npt.NDArray[np.bool_]:
        return (self.turning > 0) & (self.angle < STEEPEST)


def check(trial: Trial) -> None:
    """Raises `BadInput` where `run` would refuse this trial, and computes nothing."""
    _frames(trial)


def _frames(trial: Trial) -> _Frames:
    rig, frame_rate, duration = trial.rig, trial.frame_rate, trial.duration
    _check(rig, trial.particle, frame_rate, trial.stiffness_factor)
    if duration is None:
        # a clump may have edges that keep it from rolling, never from sliding
        contact = trial.contact
        holds = replace(contact, rolling_friction=contact.static_friction) if trial.rolls_a_clump else contact
        duration = FRAMES_AT_REST / frame_rate + _until_gone(rig, holds)
    positive(duration=duration)
    if (frames := duration * frame_rate) > MOST_FRAMES:
        raise BadInput(
            f"speed: a plate tilted at {math.degrees(rig.speed):.3g} deg/s and watched for {duration:.3g} s is a "
            f"record of {frames:.2g} frames at {frame_rate:g} Hz, more than {MOST_FRAMES:,}; tilt it faster, watch it "
            f"for a shorter time, or give a frame rate of at most {MOST_FRAMES / duration:.2g} Hz."
        )
    time = frame_times(duration, frame_rate)
    turning = np.maximum(time - FRAMES_AT_REST / frame_rate, 0.0)
    return _Frames(time, turning, np.minimum(rig.start_angle + rig.speed * turning, STEEPEST))


def _start(trial: Trial) -> tuple[Particle, tuple[float, float, float]]:
    """What moves for the body, and where it lies still [m], in the plate's axes."""
    rig, factor = trial.rig, trial.stiffness_factor
    body = _body(rig, trial.particle, factor)
    rest = _depth(body, trial.wall.softened(factor), rig.start_angle)
    return body, (rig.plate_length / 2, 0.0, body.radius - rest)


def _case(trial: Trial, frames: _Frames) -> Case:
    """A sphere or a block on the plate, in the plate's axes."""
    from rigtwin.sim.engine.effect_terms import acting
    from rigtwin.sim.engine.few.few_body import Body, Case, contact_step
    from rigtwin.sim.engine.walls.shapes import Plane, Wall

    rig, contact = trial.rig, trial.contact
    if rig.variant == "slide":
        contact = replace(contact, rolling_friction=0.0)
    body, start = _start(trial)
    plate = trial.wall.softened(trial.stiffness_factor)
    return Case(
        [Body(body, start, turns=rig.variant == "roll")],
        frames.turning[frames.moving],
        walls=[Wall(Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), plate, contact)],
        gravity=(-GRAVITY * math.sin(rig.start_angle), 0.0, -GRAVITY * math.cos(rig.start_angle)),
        gravity_turns=rig.speed,
        step=contact_step([body], STEP),
        rolling=trial.rolling,
        effects=acting(trial.effects),
    )


def _seen(trial: Trial, frames: _Frames, motion: Motion | None) -> Array:
    """Path [m] of a sphere or block in the camera's axes, until it leaves the plate; None: it has not moved yet."""
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
    """What is to be said of a model's effects that `run` cannot add."""
    from rigtwin.sim.engine.effect_terms import acting_among, acting_on_few

    rolls = rig.variant == "roll" and particle.shape is not None
    return (acting_among(effects, particle) if rolls else acting_on_few(effects))[1]


def body_in_words(rig: Tilt, particle: Particle) -> str:
    """What the body is taken for, for the result."""
    if rig.variant == "slide":
        return "A body that slides does not turn."
    if particle.shape is None:
        return "The bead that rolls is a sphere."
    lies = "its axis across the plate" if _row(particle) is not None else "its own axes along and across the plate"
    return f"The body is {particle.name}, {len(particle.radii)} spheres in one piece, and lies with {lies}."


def _row(clump: Particle) -> int | None:
    """The axis along which all of the clump's spheres have their centres; None where they lie otherwise."""
    assert clump.shape is not None
    offsets = np.array(clump.shape.offsets)
    axis = int(np.argmax(np.ptp(offsets, axis=0)))
    return axis if np.allclose(np.delete(offsets, axis, axis=1), 0.0) else None


def _record(frames: _Frames, path: Array) -> tuple[Series, Track]:
    """The frames for which there is a path."""
    seen = len(path)
    time, angle = frames.time[:seen], frames.angle[:seen]
    return (
        Series(time, angle, quantity="plate_angle", unit="rad"),
        Track(time=time, position=path, sigma=np.full(seen, TRACK_SIGMA)),
    )


def onset(rig: Tilt, contact: Contact) -> float:
    """Angle [rad] at which the body must let go: tan(alpha) is the lesser of what holds it (eqs 3 and 4)."""
    holds = contact.static_friction
    if rig.variant == "roll":
        holds = min(holds, contact.rolling_friction)
    return math.atan(holds)


def _rolled_clump(trial: Trial, time: Array, progress: Progress) -> Array:
    """Path [m] of a clump that lies across a plate which turns: a pellet rolls, a cube slides or tips over its edge.

    A row of spheres lies with its axis across the plate, anything else as its own axes say.
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
    steps = math.ceil(interval / (STEP * clump.rayleigh_time_step))
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
    """The rotation `first` and then `second`, as quaternions with the real part first."""
    (a, *u), (b, *v) = second, first
    one, other = np.array(u), np.array(v)
    return np.array([a * b - one @ other, *(a * other + b * one + np.cross(one, other))])


def _until_gone(rig: Tilt, contact: Contact) -> float:
    """[s] from the start of the turning until the body has left the plate."""
    waiting = max(onset(rig, contact) - rig.start_angle, 0.0) / rig.speed
    # past the onset the acceleration grows with the angle, at least by 5/7 g cos(alpha) speed a second
    grows = 5 / 7 * GRAVITY * math.cos(onset(rig, contact)) * rig.speed
    return waiting + MARGIN * math.cbrt(3 * rig.plate_length / grows)


def _body(rig: Tilt, particle: Particle, stiffness_factor: float) -> Particle:
    """A sphere: the particle itself, or what stands for the glued block, whose angle does not hang on its shape."""
    soft = particle.material.softened(stiffness_factor)
    if particle.shape is None:
        return replace(particle, material=soft)
    density = particle.mass / (math.pi / 6 * particle.diameter**3)
    return Particle(particle.name, soft, particle.diameter, density)


def _depth(body: Particle, plate: Material, angle: float) -> float:
    """Overlap [m] that bears the body's weight, by Hertz's law, so that it lies still from the start."""
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
