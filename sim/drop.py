"""Simulation of the drop test: a sphere falls on a plate and bounces (Hlosta et al. 2020, fig. 3b).

Clumps rebound sideways and with spin: see `rigtwin.sim.drop_clump`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY, Drop
from rigtwin.lab.units import positive
from rigtwin.sim.run.frame_times import frame_times
from rigtwin.sim.run.trials import FRAMES_AT_REST, Release, each, film, released


@dataclass(frozen=True)
class Trial:
    """One drop: bodies, contact, and settings of the camera."""

    rig: Drop
    particle: Particle
    wall: Material
    contact: Contact
    frame_rate: float  # [1/s]
    duration: float | None = None  # [s]; None: until the last of `rig.bounces` is over
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)


def run(
    rig: Drop,
    particle: Particle,
    wall: Material,
    contact: Contact,
    *,
    frame_rate: float,
    duration: float | None = None,
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> Track:
    """Simulate one drop and return the path of the bead, sampled by a camera.

    Parameters
    ----------
    rig : Drop
        Drop height [m] and number of bounces.
    particle : Particle
        The bead, a sphere; a clump is treated as a sphere (use `rigtwin.sim.drop_clump.run`).
    wall : Material
        Material of the plate.
    contact : Contact
        Coefficients of the contact of bead and plate.
    frame_rate : float
        Frames per second [1/s].
    duration : float, optional
        Length of the record [s].  Default: until the bead comes down from the last of `rig.bounces`.
    effects : Effects
        Effects of a model by name, with their parameters.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    Track
        Horizontal position and height of the bead's centre above the plate [m], one row per frame.  The bead is at
        rest at drop height + radius for five frames and is then released.

    Raises
    ------
    BadInput
        If a setting is not positive, `rig.turned` is given for a sphere, or the record has too many frames.
    SimulationFailed
        If the simulation breaks down.

    Notes
    -----
    Young's moduli are not softened.  The time step in contact is halved until the track changes by less than 1 um.

    References
    ----------
    Hlosta et al. 2020, fig. 3b.
    """
    from rigtwin.sim.engine.few.few_body import the_one

    return the_one(run_many([Trial(rig, particle, wall, contact, frame_rate, duration, effects)], progress=progress))


def run_many(
    trials: Sequence[Trial], *, threads: int | None = None, progress: Progress = silent
) -> list[Track | RigtwinError]:
    """Simulate many drops in one launch.

    Parameters
    ----------
    trials : sequence of Trial
        Trials, one for each drop.
    threads : int, optional
        Number of threads.  Default: all cores.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    list of Track or RigtwinError
        The path of each bead, as `run` returns it; for a trial that breaks down its error.

    Raises
    ------
    BadInput
        If a trial is refused; the message names it.
    """
    seen = film(list(each(trials, Trial, _release)), threads=threads, progress=progress)
    return [
        one if isinstance(one, RigtwinError) else Track(one.time, one.position[:, 0][:, [0, 2]], one.sigma)
        for one in seen
    ]


def check(trial: Trial) -> None:
    """Refuse a trial that `run` would refuse, without simulating.

    Parameters
    ----------
    trial : Trial
        Trial of one drop.

    Raises
    ------
    BadInput
        As `run` raises it.
    """
    _frames(trial)


def _frames(trial: Trial) -> Array:
    """Times of the frames [s]."""
    rig, frame_rate, duration = trial.rig, trial.frame_rate, trial.duration
    positive(drop_height=rig.drop_height, frame_rate=frame_rate, bounces=rig.bounces)
    if rig.turned is not None and trial.particle.shape is None:
        raise BadInput(
            f"turned: {trial.particle.name} is a sphere, for which an orientation has no meaning; leave it out."
        )
    if duration is None:
        duration = FRAMES_AT_REST / frame_rate + _flight_time(rig, trial.contact.restitution) - 0.5 / frame_rate
    positive(duration=duration)
    return frame_times(duration, frame_rate)


def _release(trial: Trial) -> Release:
    from rigtwin.sim.engine.effect_terms import acting
    from rigtwin.sim.engine.few.few_body import Body, Case
    from rigtwin.sim.engine.walls.shapes import Plane, Wall

    rig, time = trial.rig, _frames(trial)
    start = (0.0, 0.0, rig.drop_height + trial.particle.radius)
    plate = Wall(Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), trial.wall, trial.contact)
    return Release(
        time,
        Case(
            [Body(trial.particle, start)],
            released(time, trial.frame_rate),
            walls=[plate],
            effects=acting(trial.effects),
        ),
    )


def _flight_time(rig: Drop, restitution: float) -> float:
    """[s] from the release to the end of the last wanted arc."""
    fall = math.sqrt(2 * rig.drop_height / GRAVITY)
    return fall * (1 + 2 * sum(restitution**n for n in range(1, rig.bounces + 1)))
