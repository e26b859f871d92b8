"""The twin of the drop test: a bead falls on a plate and bounces (Hlosta et al. 2020, fig. 3b)."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.model import NO_EFFECTS, Effects
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY, Drop
from rigtwin.sim.engine.clock import positive
from rigtwin.sim.film import frame_times

FRAMES_AT_REST = 5  # shown before the bead is let go
TRACK_SIGMA = 1e-6  # [m], the step is halved until samples move by less


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
    """Path of the bead, sampled as a camera of `frame_rate` [1/s] would.

    y is the height of the bead's centre above the plate; it starts at rest at drop height + radius and is let go
    after five frames.  Without `duration` [s] the track ends as the bead comes down from the last of `rig.bounces`.
    The stiffness is the real one; the step in contact is halved until the track no longer moves.  `effects` are those
    of a model by name, with their parameters.
    """
    from rigtwin.sim.engine import few_body
    from rigtwin.sim.engine.terms import acting
    from rigtwin.sim.engine.walls import Plane, Wall

    positive(drop_height=rig.drop_height, frame_rate=frame_rate, bounces=rig.bounces)
    if duration is None:
        duration = FRAMES_AT_REST / frame_rate + _flight_time(rig, contact.restitution) - 0.5 / frame_rate
    positive(duration=duration)
    time = frame_times(duration, frame_rate)
    falling = time[FRAMES_AT_REST + 1 :] - FRAMES_AT_REST / frame_rate

    start = (0.0, 0.0, rig.drop_height + particle.radius)
    position = np.tile(start, (len(time), 1))
    sigma = TRACK_SIGMA
    if len(falling):
        motion, apart = few_body.run_halved(
            [few_body.Body(particle, start)],
            falling,
            walls=[Wall(Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), wall, contact)],
            effects=acting(effects),
            tolerance=TRACK_SIGMA,
            progress=progress,
        )
        sigma = max(sigma, apart)
        position[FRAMES_AT_REST + 1 :] = motion.position[:, 0]
    return Track(time=time, position=position[:, [0, 2]], sigma=np.full(len(time), sigma))


def _flight_time(rig: Drop, restitution: float) -> float:
    """[s] from the release to the end of the last wanted arc."""
    fall = math.sqrt(2 * rig.drop_height / GRAVITY)
    return fall * (1 + 2 * sum(restitution**n for n in range(1, rig.bounces + 1)))
