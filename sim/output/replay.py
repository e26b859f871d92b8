"""One moment of a simulation that another program computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.materials import Particle

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.particle_state import Beads, Grains


@dataclass(frozen=True)
class Frame:
    """The spheres that are there at one time, ordered by their numbers."""

    time: float  # [s]
    ident: npt.NDArray[np.int64]  # shape (n,), number in the order of adding, from 0
    position: Array  # [m], shape (n, 3)
    velocity: Array  # [m/s], shape (n, 3)
    sizes: Array | None = None  # of all spheres by their number, over the largest; None: all alike

    def beads(self, particle: Particle) -> Beads:
        """The spheres, all of them of this particle; their spin is not known and taken as zero."""
        from rigtwin.sim.engine.bulk.particle_state import Beads

        count = len(self.ident)
        kind, still = np.zeros(count, dtype=np.int64), np.zeros((count, 3))
        radius, mass = particle.radius * self._size, particle.mass * self._size**3
        return Beads(self.ident, kind, self.position, self.velocity, still, radius, mass)

    @property
    def _size(self) -> Array:
        return np.ones(len(self.ident)) if self.sizes is None else self.sizes[self.ident]

    def grains(self, particle: Particle) -> Grains:
        """The same spheres as particles."""
        from rigtwin.sim.engine.bulk.particle_state import Grains

        count = len(self.ident)
        kind, still, turn = np.zeros(count, dtype=np.int64), np.zeros((count, 3)), np.zeros((count, 4))
        mass = particle.mass * self._size**3
        return Grains(self.ident, kind, self.position, self.velocity, still, turn, mass, still)
