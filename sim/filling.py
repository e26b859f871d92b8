"""Filling a container: beads scattered in it without overlap, to fall and come to rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.lab.rigs import GRAVITY

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk import Bulk, Grains

Array = npt.NDArray[np.float64]
Inside = Callable[[Array, float], npt.NDArray[np.bool_]]
"""Which of the points, shape (n, 3), lie in the container and farther than so many metres from its walls."""

LOOSEST, TIGHTEST = 1.35, 1.02  # pitch of the lattice, in diameters
THROWN = 0.2  # [m/s], standard deviation of each component; so that no lattice survives the fall


def scatter(
    bulk: Bulk, count: int, inside: Inside, box: tuple[Array, Array], particle: Particle, random: np.random.Generator
) -> None:
    """Add `count` particles to a simulation, in the container, which lies in the `box` [m].

    A lattice as loose as fits, every bead moved off its site at random, filled from below.
    """
    for pitch in np.linspace(LOOSEST, TIGHTEST, 12) * particle.diameter:
        shift = 0.45 * (pitch - particle.diameter)
        steps = [np.arange(low + pitch / 2, high, pitch) for low, high in zip(*box, strict=True)]
        sites = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        sites = sites[inside(sites, particle.radius + shift)]
        if len(sites) >= count:
            lowest = sites[np.argsort(sites[:, 2], kind="stable")[:count]]
            places = lowest + random.uniform(-shift, shift, (count, 3)) / np.sqrt(3)
            velocities = random.normal(0, THROWN, (count, 3))
            turn = None if particle.shape is None else random.normal(size=(count, 4))
            bulk.add(places, velocities, turn=turn)
            return
    raise BadInput(
        f"count: {count} beads of {particle.diameter * 1e3:.3g} mm do not fit in; at most {len(sites)} find room."
    )


def resting(grains: Grains, particle: Particle, *, energy: float, speed: float) -> bool:
    """Whether the particles rest: mean kinetic energy below `energy` m g R and none faster than `speed` [m/s]."""
    mean = grains.kinetic_energy / max(len(grains.ident), 1)
    fastest = np.sqrt((grains.velocity**2).sum(1).max(initial=0.0))
    return bool(mean < energy * particle.mass * GRAVITY * particle.radius and fastest < speed)
