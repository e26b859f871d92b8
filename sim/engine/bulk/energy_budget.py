"""Energy balance and overlap statistics of a bulk simulation at one moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.sim.engine.contact import SPEED, STIFFNESS, linear_stiffness
from rigtwin.sim.engine.effect_terms import Adhesion
from rigtwin.sim.engine.walls.elements import Vector

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.particle_state import Grains


@dataclass(frozen=True)
class Budget:
    """Energies and overlaps at one moment.

    The elastic energy is that of the normal springs; tangential and rolling springs hold less and are neglected.  The
    adhesive energy is negative.  Overlaps between beads are in units of twice the effective radius, which is the radius
    of equal beads; at a wall they are in units of the bead's radius.
    """

    kinetic: float  # [J], of translation and rotation
    potential: float  # [J], zero at the origin
    elastic: float  # [J]
    beads: int
    contacts: int  # between beads
    wall_contacts: int
    mean_overlap: float  # of all contacts
    largest_overlap: float
    work: float  # [J], of moving walls so far
    adhesive: float = 0.0  # [J], of attractive effects
    in_flight: float = 0.0  # [J], work of the effects' forces in flight so far; negative for drag

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
    adhesion: Adhesion | None = None,
) -> Budget:
    """Budget of `grains`, whose spheres are `rows` (as exported by the arena).

    `near` are pairs of spheres, shape (n, 3); the third column marks those in contact when forces were last computed,
    which `adhesion` may still hold although they no longer overlap.  `at_walls` are contacts with walls, shape (k, 3):
    sphere, wall, overlap [m], negative if adhesion may hold them.  `linear`: whether springs are linear.
    """
    position, radius = rows[:, 0:3], rows[:, 9]
    kind = rows[:, 19].astype(int)

    one, other, touched = near.T
    overlap = radius[one] + radius[other] - np.linalg.norm(position[one] - position[other], axis=1)
    meets = (overlap > 0) | (touched > 0)
    one, other, overlap = one[meets], other[meets], overlap[meets]
    effective = radius[one] * radius[other] / (radius[one] + radius[other])
    mass = rows[:, 10]
    mass_eff = mass[one] * mass[other] / (mass[one] + mass[other])
    bead, wall = at_walls[:, :2].astype(int).T
    among = _books(laws[0][kind[one], kind[other]], effective, mass_eff, overlap, linear, adhesion)
    on_walls = _books(laws[1][kind[bead], wall], radius[bead], mass[bead], at_walls[:, 2], linear, adhesion)
    # at a wall the effective radius is the bead's
    depth = np.concatenate([among.depth / 2, on_walls.depth])
    return Budget(
        kinetic=grains.kinetic_energy,
        potential=float(-np.sum(grains.mass * (grains.position @ np.array(gravity)))),
        elastic=among.elastic + on_walls.elastic,
        beads=len(rows),
        contacts=len(among.depth),
        wall_contacts=len(on_walls.depth),
        mean_overlap=float(depth.mean()) if len(depth) else 0.0,
        largest_overlap=float(depth.max(initial=0.0)),
        work=work,
        adhesive=among.adhesive + on_walls.adhesive,
        in_flight=in_flight,
    )


@dataclass(frozen=True)
class _Books:
    depth: Array  # of the contacts that hold, in effective radii
    elastic: float  # [J]
    adhesive: float  # [J]


def _books(law: Array, radius: Array, mass: Array, overlap: Array, linear: bool, adhesion: Adhesion | None) -> _Books:
    """Depths and energies of contacts with effective radii and masses; separated ones count if adhesion holds them."""
    held = overlap > 0
    if adhesion is not None:
        held |= adhesion.holds(overlap, radius, law[..., STIFFNESS])
    law, radius, mass, overlap = law[held], radius[held], mass[held], overlap[held]
    elastic = (_linear if linear else _hertz)(law, radius, mass, np.maximum(overlap, 0.0))
    adhesive = adhesion.energy(overlap, radius, law[..., STIFFNESS]) if adhesion is not None else 0.0
    return _Books(overlap / radius, elastic, adhesive)


def _hertz(law: Array, radius: Array, _mass: Array, overlap: Array) -> float:
    """Energy [J] of contacts with force 4/3 E* sqrt(R*) d^(3/2)."""
    return float(np.sum(8 / 15 * law[..., STIFFNESS] * np.sqrt(radius) * overlap**2.5))


def _linear(law: Array, radius: Array, mass: Array, overlap: Array) -> float:
    """Energy [J] of contacts with linear springs."""
    stiffness = linear_stiffness(law[..., STIFFNESS], radius, mass, law[..., SPEED])
    return float(np.sum(0.5 * stiffness * overlap**2))
