"""The twin of the double pendulum: bead A swings down and hits bead B at rest (Hlosta et al. 2020, fig. 3c)."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Particle
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
    duration: float | None = None,
    progress: Progress = silent,
) -> tuple[Track, Track]:
    """Paths of the beads "A" and "B", sampled as a camera of `frame_rate` [1/s] would.

    Two pivots one bead diameter apart, rigid threads without mass, no air: the beads hang touching.  The origin is
    the point where they touch, so A hangs at x = -radius and B at x = +radius, both at y = 0, the pivots at
    y = length.  A is let go from rest after five frames at `release_angle` to the left.  Without `duration` [s] the
    tracks end a little after the beads have passed their highest points on the rebound.
    """
    from rigtwin.sim.engine import few_body

    _check(rig, frame_rate)
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
    position = np.tile([start_a, start_b], (len(time), 1, 1))
    sigma = TRACK_SIGMA
    if len(swinging):
        motion, apart = few_body.run_halved(
            [
                few_body.Body(particle, start_a, pivot=(-radius, 0.0, rig.length)),
                few_body.Body(particle, start_b, pivot=(radius, 0.0, rig.length)),
            ],
            swinging,
            contacts=contact,
            tolerance=TRACK_SIGMA,
            progress=progress,
        )
        sigma = max(sigma, apart)
        position[FRAMES_AT_REST + 1 :] = motion.position
    a, b = (Track(time, position[:, k][:, [0, 2]], np.full(len(time), sigma), body) for k, body in enumerate("AB"))
    return a, b


def _check(rig: Pendulum, frame_rate: float) -> None:
    positive(length=rig.length, release_angle=rig.release_angle, frame_rate=frame_rate)
    if rig.release_angle >= math.pi:
        raise BadInput(f"release_angle must be below 180 deg, got {math.degrees(rig.release_angle):g} deg.")
    if rig.variant != "double":
        raise BadInput(f"pendulum: there is no twin of the variant {rig.variant!r} yet; use 'double'.")


def _quarter_period(length: float, amplitude: float) -> float:
    """[s] from the release to the lowest point, exact for any amplitude (arithmetic-geometric mean)."""
    a, b = 1.0, math.cos(amplitude / 2)
    while abs(a - b) > 1e-15:
        a, b = (a + b) / 2, math.sqrt(a * b)
    return math.pi / (2 * a) * math.sqrt(length / GRAVITY)
