"""Simulation of the double pendulum: bead A swings down and hits bead B at rest (Hlosta et al. 2020, fig. 3c).

In the variant "wall" it hits a vertical wall instead, as the paper did with cubes (section 3.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY, Pendulum
from rigtwin.lab.units import positive
from rigtwin.sim.run.frame_times import frame_times
from rigtwin.sim.run.trials import FRAMES_AT_REST, Release, Seen, each, film, released


@dataclass(frozen=True)
class Trial:
    """One swing: bodies, contact, and settings of the camera."""

    rig: Pendulum
    particle: Particle
    contact: Contact
    frame_rate: float  # [1/s]
    wall: Material | None = None  # material of the wall that replaces B
    duration: float | None = None  # [s]; None: until both beads have turned back
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)


def run(
    rig: Pendulum,
    particle: Particle,
    contact: Contact,
    *,
    frame_rate: float,
    wall: Material | None = None,
    duration: float | None = None,
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> tuple[Track, ...]:
    """Simulate one swing and return the paths of the beads, sampled by a camera.

    Parameters
    ----------
    rig : Pendulum
        Length [m], release angle [rad], rod mass [kg] and variant.
    particle : Particle
        The beads; a clump only in the variant "wall".
    contact : Contact
        Coefficients of the contact of the beads, or of bead and wall.
    frame_rate : float
        Frames per second [1/s].
    wall : Material, optional
        Material of a vertical wall at x = 0 that replaces bead B; required for the variant "wall", and only there.
    duration : float, optional
        Length of the record [s].  Default: until shortly after the highest points of the rebound.
    effects : Effects
        Effects of a model by name, with their parameters.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    tuple of Track
        Paths [m] of the beads "A" and "B", or of "A" alone.  x to the right, y up; the origin is the point of
        contact: A hangs at x = -radius, B at x = +radius, both at y = 0, the pivots are at y = length.  A is at rest
        at the release angle to the left for five frames and is then released.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    SimulationFailed
        If the simulation breaks down.

    Notes
    -----
    Rigid threads or rods, pivots one bead diameter apart, no air.  A clump hits the wall flat, with the side of its
    own x axis, and does not turn: it is simulated as a sphere of the same width and mass.

    Uniform rods of mass M = `rig.rod_mass` make beads of mass m swing faster by sqrt((m + M/2) / (m + M/3)) (compound
    pendulum); in the impact the beads act with the mass m + M/3.

    References
    ----------
    Hlosta et al. 2020, fig. 3c and section 3.2.
    """
    from rigtwin.sim.engine.few.few_body import the_one

    trial = Trial(rig, particle, contact, frame_rate, wall, duration, effects)
    return the_one(run_many([trial], progress=progress))


def run_many(
    trials: Sequence[Trial], *, threads: int | None = None, progress: Progress = silent
) -> list[tuple[Track, ...] | RigtwinError]:
    """Simulate many pendulums in one launch.

    Parameters
    ----------
    trials : sequence of Trial
        Trials, one for each swing.
    threads : int, optional
        Number of threads.  Default: all cores.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    list of tuple of Track or RigtwinError
        The paths of the beads of each swing, as `run` returns them; for a trial that breaks down its error.

    Raises
    ------
    BadInput
        If a trial is refused; the message names it.
    """
    seen = film(list(each(trials, Trial, _release)), threads=threads, progress=progress)
    return [one if isinstance(one, RigtwinError) else _tracks(one) for one in seen]


def _tracks(seen: Seen) -> tuple[Track, ...]:
    # the camera's axes are x and y; in the engine z is up
    beads = range(seen.position.shape[1])
    return tuple(Track(seen.time, seen.position[:, k][:, [0, 2]], seen.sigma, "AB"[k]) for k in beads)


def check(trial: Trial) -> None:
    """Refuse a trial that `run` would refuse, without simulating.

    Parameters
    ----------
    trial : Trial
        Trial of one swing.

    Raises
    ------
    BadInput
        As `run` raises it.
    """
    _frames(trial)


def _frames(trial: Trial) -> Array:
    """Times of the frames [s]."""
    rig, duration = trial.rig, trial.duration
    _check(rig, trial.particle, trial.frame_rate, trial.wall)
    if duration is None:
        duration = FRAMES_AT_REST / trial.frame_rate + 2.2 * _quarter_period(rig.length, rig.release_angle)
    positive(duration=duration)
    return frame_times(duration, trial.frame_rate)


def _release(trial: Trial) -> Release:
    from rigtwin.sim.engine.effect_terms import acting
    from rigtwin.sim.engine.few.few_body import Body, Case
    from rigtwin.sim.engine.walls.shapes import Plane, Wall

    time = _frames(trial)
    rig, contact, wall = trial.rig, trial.contact, trial.wall
    bead, turns = _bob(trial.particle, rig.rod_mass), trial.particle.shape is None
    radius, angle = bead.radius, rig.release_angle
    start_a = (-radius - rig.length * math.sin(angle), 0.0, rig.length * (1 - math.cos(angle)))
    beads = [Body(bead, start_a, pivot=(-radius, 0.0, rig.length), turns=turns)]
    stand = []
    if wall is None:
        beads.append(Body(bead, (radius, 0.0, 0.0), pivot=(radius, 0.0, rig.length)))
    else:
        stand.append(Wall(Plane((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), wall, contact))
    return Release(
        time,
        Case(
            beads,
            released(time, trial.frame_rate),
            walls=stand,
            contacts=contact if wall is None else None,
            gravity=(0.0, 0.0, -GRAVITY * _heavier(trial.particle, rig.rod_mass)),
            effects=acting(trial.effects, pivots=True),
        ),
    )


def _bob(particle: Particle, rod_mass: float) -> Particle:
    """Sphere that swings and collides like the particle with its rod."""
    diameter = particle.diameter
    if particle.shape is not None:
        places, radii = np.array(particle.shape.offsets)[:, 0], np.array(particle.shape.radii)
        diameter = float((places + radii).max() - (places - radii).min())
    mass = particle.mass + rod_mass / 3
    return Particle(particle.name, particle.material, diameter, mass / (math.pi / 6 * diameter**3))


def _heavier(particle: Particle, rod_mass: float) -> float:
    """Factor by which the rod raises weight over inertia (compound pendulum)."""
    return (particle.mass + rod_mass / 2) / (particle.mass + rod_mass / 3)


def _check(rig: Pendulum, particle: Particle, frame_rate: float, wall: Material | None) -> None:
    positive(length=rig.length, release_angle=rig.release_angle, frame_rate=frame_rate)
    if rig.release_angle >= math.pi:
        raise BadInput(f"release_angle: {math.degrees(rig.release_angle):g} degrees are not below 180; give less.")
    if rig.length < particle.diameter:
        raise BadInput(
            f"length: {rig.length * 1e3:.3g} mm from pivot to centre are less than the bead's own "
            f"{particle.diameter * 1e3:.3g} mm; give a longer pendulum or a smaller bead."
        )
    if (rig.variant == "wall") != (wall is not None):
        raise BadInput(f"pendulum: the variant {rig.variant!r} {'needs' if wall is None else 'has no'} wall.")
    if particle.shape is not None and wall is None:
        raise BadInput(
            f"particle: {particle.name} is a clump, and the impact of two clumps is not central; "
            "give a sphere, or use the variant wall."
        )
    if not (math.isfinite(rig.rod_mass) and rig.rod_mass >= 0):
        raise BadInput(f"rod_mass: {rig.rod_mass:g} kg is below zero; give the mass of a rod.")
    if rig.rod_mass and rig.hanger != "rod":
        raise BadInput("rod_mass: a string is taken as massless; give the hanger 'rod', or leave rod_mass out.")


def _quarter_period(length: float, amplitude: float) -> float:
    """[s] from the release to the lowest point, exact for any amplitude (arithmetic-geometric mean)."""
    a, b = 1.0, math.cos(amplitude / 2)
    while abs(a - b) > 1e-15:
        a, b = (a + b) / 2, math.sqrt(a * b)
    return math.pi / (2 * a) * math.sqrt(length / GRAVITY)
