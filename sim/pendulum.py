"""The twin of the double pendulum: bead A swings down and hits bead B at rest (Hlosta et al. 2020, fig. 3c)."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.model import NO_EFFECTS, Effects
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY, Pendulum
from rigtwin.sim.engine.clock import positive
from rigtwin.sim.film import frame_times

FRAMES_AT_REST = 5  # shown before bead A is let go
TRACK_SIGMA = 1e-6  # [m], the step is halved until samples move by less


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
    """Paths of the beads "A" and "B", or of "A" alone before a wall, as a camera of `frame_rate` [1/s] would see them.

    Two pivots one bead diameter apart, rigid threads without mass, no air: the beads hang touching.  The origin is
    the point where they touch, so A hangs at x = -radius and B at x = +radius, both at y = 0, the pivots at
    y = length.  A is let go from rest after five frames at `release_angle` to the left.  Without `duration` [s] the
    tracks end a little after the beads have passed their highest points on the rebound.  `wall` is what an upright
    wall at x = 0 is made of, which stands in the place of B.  `effects` are those of a model by name, with their
    parameters.
    """
    from rigtwin.sim.engine import few_body
    from rigtwin.sim.engine.terms import acting
    from rigtwin.sim.engine.walls import Plane, Wall

    _check(rig, frame_rate, wall)
    quarter = _quarter_period(rig.length, rig.release_angle)
    if duration is None:
        duration = FRAMES_AT_REST / frame_rate + 2.2 * quarter
    positive(duration=duration)
    time = frame_times(duration, frame_rate)
    swinging = time[FRAMES_AT_REST + 1 :] - FRAMES_AT_REST / frame_rate

    # the camera's axes are x and y; in the engine z is up
    radius, angle = particle.radius, rig.release_angle
    start_a = (-radius - rig.length * math.sin(angle), 0.0, rig.length * (1 - math.cos(angle)))
    start_b = (radius, 0.0, 0.0)
    beads = [few_body.Body(particle, start_a, pivot=(-radius, 0.0, rig.length))]
    stand = []
    if wall is None:
        beads.append(few_body.Body(particle, start_b, pivot=(radius, 0.0, rig.length)))
    else:
        stand.append(Wall(Plane((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), wall, contact))
    position = np.tile([start_a, start_b][: len(beads)], (len(time), 1, 1))
    sigma = TRACK_SIGMA
    if len(swinging):
        motion, apart = few_body.run_halved(
            beads,
            swinging,
            walls=stand,
            contacts=contact if wall is None else None,
            effects=acting(effects, pivots=True),
            tolerance=TRACK_SIGMA,
            progress=progress,
        )
        sigma = max(sigma, apart)
        position[FRAMES_AT_REST + 1 :] = motion.position
    return tuple(
        Track(time, position[:, k][:, [0, 2]], np.full(len(time), sigma), body)
        for k, body in enumerate("AB"[: len(beads)])
    )


def _check(rig: Pendulum, frame_rate: float, wall: Material | None) -> None:
    positive(length=rig.length, release_angle=rig.release_angle, frame_rate=frame_rate)
    if rig.release_angle >= math.pi:
        raise BadInput(f"release_angle must be below 180 deg, got {math.degrees(rig.release_angle):g} deg.")
    if (rig.variant == "wall") != (wall is not None):
        raise BadInput(f"pendulum: the variant {rig.variant!r} {'needs' if wall is None else 'has no'} wall.")


def _quarter_period(length: float, amplitude: float) -> float:
    """[s] from the release to the lowest point, exact for any amplitude (arithmetic-geometric mean)."""
    a, b = 1.0, math.cos(amplitude / 2)
    while abs(a - b) > 1e-15:
        a, b = (a + b) / 2, math.sqrt(a * b)
    return math.pi / (2 * a) * math.sqrt(length / GRAVITY)
