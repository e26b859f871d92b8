"""The books of a running simulation: where the energy is, and how deep the contacts are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rigtwin.sim.engine.contact import SPEED, STIFFNESS, linear_stiffness
from rigtwin.sim.engine.elements import Vector

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk import Grains

Array = npt.NDArray[np.float64]


Attraction = Callable[[Array, Array, Array], Array]
"""Pull [N] of contacts by overlap [m], effective radius [m] and modulus [Pa]."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class Budget:
    """Energies and overlaps at one moment.

    The elastic energy is that of the normal springs; those of sliding and rolling are smaller and left out.  A contact
    that is pulled together has given energy away: its adhesive energy is negative.  Overlaps are in twice the effective
    radius, which is the radius between equal beads (at a wall: in the bead's radius).
    """

    kinetic: float  # [J], of translation and rotation
    potential: float  # [J], zero at the origin
    elastic: float  # [J]
    beads: int
    contacts: int  # between beads
    wall_contacts: int
    mean_overlap: float  # of all contacts
    largest_overlap: float
    work: float  # [J], given by moving walls until now
    adhesive: float = 0.0  # [J], of the effects that attract
    in_flight: float = 0.0  # [J], given by effects' forces in flight until now: drag takes, a wind gives

    @property
    def total(self) -> float:
        """[J]"""
        return self.kinetic + self.potential + self.elastic + self.adhesive


def measure(
    rows: Array,
    near: npt.NDArray[np.int64],
    at_walls: Array,
    laws: tuple[Array, Array],
    *,
    grains: Grains,
    gravity: Vector,
    work: float = 0.0,
    in_flight: float = 0.0,
    linear: bool = False,
    attraction: Attraction | None = None,
) -> Budget:
    """The budget of `grains`, whose spheres are `rows` (as exported by the arena).

    The pairs `near` touch where they overlap; those that hold together although they have parted are marked by a third
    column.  `at_walls` are the contacts with walls: sphere, wall, overlap [m].  `linear`: so are the springs.
    """
    position, radius = rows[:, 0:3], rows[:, 9]
    kind = rows[:, 19].astype(int)

    one, other, holds = near.T
    overlap = radius[one] + radius[other] - np.linalg.norm(position[one] - position[other], axis=1)
    touch = (overlap > 0) | (holds > 0)
    one, other, overlap = one[touch], other[touch], overlap[touch]
    effective = radius[one] * radius[other] / (radius[one] + radius[other])
    depths = [overlap / (2 * effective)]
    energy, mass = _linear if linear else _hertz, rows[:, 10]
    mass_eff = mass[one] * mass[other] / (mass[one] + mass[other])
    pair = laws[0][kind[one], kind[other]]
    elastic = energy(pair, effective, mass_eff, np.maximum(overlap, 0.0))
    bead, wall = at_walls[:, :2].astype(int).T
    depths.append(at_walls[:, 2] / radius[bead])
    elastic += energy(laws[1][kind[bead], wall], radius[bead], mass[bead], np.maximum(at_walls[:, 2], 0.0))
    adhesive = 0.0
    if attraction is not None:
        adhesive = _adhesive(attraction, overlap, effective, pair[:, STIFFNESS])
        adhesive += _adhesive(attraction, at_walls[:, 2], radius[bead], laws[1][kind[bead], wall][:, STIFFNESS])
    depth = np.concatenate(depths)
    return Budget(
        kinetic=grains.kinetic_energy,
        potential=float(-np.sum(grains.mass * (grains.position @ np.array(gravity)))),
        elastic=elastic,
        beads=len(rows),
        contacts=len(one),
        wall_contacts=len(depth) - len(one),
        mean_overlap=float(depth.mean()) if len(depth) else 0.0,
        largest_overlap=float(depth.max(initial=0.0)),
        work=work,
        adhesive=adhesive,
        in_flight=in_flight,
    )


def _hertz(law: Array, radius: Array, _mass: Array, overlap: Array) -> float:
    """Energy [J] of contacts with force 4/3 E* sqrt(R*) d^(3/2)."""
    return float(np.sum(8 / 15 * law[..., STIFFNESS] * np.sqrt(radius) * overlap**2.5))


def _linear(law: Array, radius: Array, mass: Array, overlap: Array) -> float:
    """Energy [J] of contacts with linear springs."""
    stiffness = linear_stiffness(law[..., STIFFNESS], radius, mass, law[..., SPEED])
    return float(np.sum(0.5 * stiffness * overlap**2))


def _adhesive(attraction: Attraction, overlap: Array, radius: Array, modulus: Array) -> float:
    """Energy [J] of contacts that were pulled from touching to where they are."""
    total = np.zeros_like(overlap)
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        total -= 0.5 * overlap * weight * attraction(0.5 * (node + 1) * overlap, radius, modulus)
    return float(total.sum())
