"""Result types of a bulk simulation: state of all particles (`Grains`) and of all spheres (`Beads`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array


@dataclass(frozen=True)
class Grains:
    """State of all particles, spheres or clumps, ordered by their numbers."""

    ident: npt.NDArray[np.int64]  # number in the order of adding
    kind: npt.NDArray[np.int64]  # index of the particle
    position: Array  # [m], shape (n, 3), of the centre of mass
    velocity: Array  # [m/s], shape (n, 3)
    spin: Array  # [rad/s], shape (n, 3)
    turn: Array  # [1], shape (n, 4), quaternion from the clump's own axes to space; not computed for spheres
    mass: Array  # [kg]
    momentum: Array  # [kg m^2/s], shape (n, 3), angular, about the centre of mass

    @property
    def kinetic_energy(self) -> float:
        """Of translation and rotation [J]."""
        return float(0.5 * np.sum(self.mass * (self.velocity**2).sum(1) + (self.momentum * self.spin).sum(1)))


@dataclass(frozen=True)
class Beads:
    """State of all spheres, ordered by their numbers."""

    ident: npt.NDArray[np.int64]  # number in the order of adding
    kind: npt.NDArray[np.int64]  # index of the particle
    position: Array  # [m], shape (n, 3)
    velocity: Array  # [m/s], shape (n, 3)
    spin: Array  # [rad/s], shape (n, 3)
    radius: Array  # [m]
    mass: Array  # [kg]; of a sphere in a clump its share by volume
    grain: npt.NDArray[np.int64] | None = None  # number of the particle of each sphere; None: single spheres
    grains: Grains | None = None  # None: the spheres themselves

    @property
    def kinetic_energy(self) -> float:
        """Of translation and rotation [J]."""
        if self.grains is not None:
            return self.grains.kinetic_energy
        inertia = 0.4 * self.mass * self.radius**2
        return float(0.5 * np.sum(self.mass * (self.velocity**2).sum(1) + inertia * (self.spin**2).sum(1)))
