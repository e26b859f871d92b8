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
    sizes: Array | None = None  # of all spheres by their number, over the largest; None: all equal

    def beads(self, particle: Particle) -> Beads:
        """Return the spheres as the engine has them.

        Parameters
        ----------
        particle : Particle
            All of them are this particle or of clumps of it.

        Returns
        -------
        Beads
            The spheres; their spin is not known and taken as zero.
        """
        from rigtwin.sim.engine.bulk.particle_state import Beads

        count, each = len(self.ident), len(particle.radii)
        kind, still = np.zeros(count, dtype=np.int64), np.zeros((count, 3))
        if particle.shape is None:
            radius, mass = particle.radius * self._size, particle.mass * self._size**3
            return Beads(self.ident, kind, self.position, self.velocity, still, radius, mass)
        radii, grain = np.array(particle.radii), self.ident // each
        own = radii[self.ident % each]
        share = own**3 / (radii**3).sum()
        size = np.ones(count) if self.sizes is None else self.sizes[grain]
        radius, mass = own * size, particle.mass * size**3 * share
        return Beads(
            self.ident, kind, self.position, self.velocity, still, radius, mass, grain, self.grains(particle)
        )  # fmt: skip

    @property
    def _size(self) -> Array:
        return np.ones(len(self.ident)) if self.sizes is None else self.sizes[self.ident]

    def grains(self, particle: Particle) -> Grains:
        """Return the same spheres as particles.

        Parameters
        ----------
        particle : Particle
            All of them are this particle or of clumps of it.

        Returns
        -------
        Grains
            The particles; clumps of which a sphere is missing are left out.
        """
        if particle.shape is not None:
            return self._clumps(particle)._alike(particle)
        return self._alike(particle)

    def _alike(self, particle: Particle) -> Grains:
        from rigtwin.sim.engine.bulk.particle_state import Grains

        count = len(self.ident)
        kind, still, turn = np.zeros(count, dtype=np.int64), np.zeros((count, 3)), np.zeros((count, 4))
        mass = particle.mass * self._size**3
        return Grains(self.ident, kind, self.position, self.velocity, still, turn, mass, still)

    def _clumps(self, particle: Particle) -> Frame:
        """The centres of mass of the clumps."""
        assert particle.shape is not None
        offsets, each = np.array(particle.shape.offsets), len(particle.radii)
        # the centre of mass as a weighted mean of the centres of the spheres, whatever the orientation
        matrix = np.vstack([np.ones(each), offsets.T / max(particle.radius, 1e-300)])
        weights = np.linalg.lstsq(matrix, np.array([1.0, 0.0, 0.0, 0.0]), rcond=None)[0]
        grain, counts = np.unique(self.ident // each, return_counts=True)
        whole = grain[counts == each]
        rows = np.isin(self.ident // each, whole)
        position, velocity = (
            np.einsum("k,nkj->nj", weights, one[rows].reshape(-1, each, 3)) for one in (self.position, self.velocity)
        )
        return Frame(self.time, whole, position, velocity, self.sizes)
