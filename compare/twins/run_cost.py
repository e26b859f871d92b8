"""Estimate how long runs of many particles take, and refuse numbers of particles that are not stated."""

from __future__ import annotations

import math

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.lab.reference import hlosta2020

START = 5.0  # [s], compilation of the kernels
# [s], cost of a time step for each body and for each of its spheres, from runs of the twins of the published tables
BODY, SPHERE = 0.22e-6, 0.035e-6
STEP = 0.3  # time step over the Rayleigh time step
MANY = 10_000  # ten times a usual heap, a minute for each simulated second: the number is shown beforehand
MOST_UNSTATED = 100_000
"""Largest number of particles that follows from other sizes: 100 times a usual heap, some ten minutes for each
simulated second with beads of 6 mm."""


def seconds(particle: Particle, count: float, lasts: float, *, stiffness_factor: float = hlosta2020.SOFTENING) -> float:
    """Return the run time of a simulation on one core.

    Parameters
    ----------
    particle : Particle
        The particle.
    count : float
        Mean number of particles.
    lasts : float
        Simulated time [s].
    stiffness_factor : float
        Factor on the moduli.

    Returns
    -------
    float
        Run time [s].
    """
    step = STEP * particle.rayleigh_time_step / math.sqrt(stiffness_factor)
    # the neighbour list of a long clump grows with the volume of its bounding sphere over that of the clump
    neighbours = math.pi / 6 * particle.diameter**3 / particle.volume
    return START + lasts / step * count * (BODY + SPHERE * len(particle.radii) * neighbours)


def in_words(particle: Particle, count: int, *, stiffness_factor: float = hlosta2020.SOFTENING) -> str:
    """Return a number of particles with the time that each simulated second of them takes.

    Parameters
    ----------
    particle : Particle
        The particle.
    count : int
        Number of particles.
    stiffness_factor : float
        Factor on the moduli.

    Returns
    -------
    str
        Both in words.
    """
    minutes = (seconds(particle, count, 1.0, stiffness_factor=stiffness_factor) - START) / 60
    time = f"{minutes / 60:.2g} h" if minutes > 60 else f"{minutes:.2g} min"
    return f"{count} particles, about {time} for each simulated second on one core"


def need_usual_number(key: str, count: int, particle: Particle, origin: str, check: str) -> None:
    """Refuse a number of particles that follows from other sizes and is far beyond that of a rig on a bench.

    Parameters
    ----------
    key : str
        Stated size that the number follows from.
    count : int
        Number of particles.
    particle : Particle
        The particle.
    origin : str
        How the number was found, for the message.
    check : str
        What to check, for the message.

    Raises
    ------
    BadInput
        If there are more than `MOST_UNSTATED`.
    """
    if count > MOST_UNSTATED:
        raise BadInput(
            f"{key}: {in_words(particle, count)}, by {origin}; a number that is not stated may be at most "
            f"{MOST_UNSTATED}; check {check}, or state count (--count) to run so many."
        )
