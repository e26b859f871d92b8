"""Pile by emptying: a filled round container drains through a hole in the middle of its floor.

The remaining crater rises from the hole to the wall.  Its profile is the surface in a section through the axis, with
both halves placed back to back: the walls meet in the middle and the edges of the hole are the feet.  The slopes can
then be evaluated as those of any heap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.lab.progress import Progress
from rigtwin.lab.records import Profile
from rigtwin.lab.rigs import Pile
from rigtwin.lab.units import positive
from rigtwin.sim.output.outline import POINTS_PER_DIAMETER, SIGMA, highest
from rigtwin.sim.pile.piling import Course
from rigtwin.sim.run import filling

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.walls.shapes import Shape
    from rigtwin.sim.run.run_log import Logbook


DRAIN = 1 / 3  # drain over base diameter, where the rig does not state it
LEAST_DRAIN = 7  # [bead diameters], smallest default drain; rough spheres arch over narrower holes
BELOW = 0.05  # [m], depth below the floor down to which beads are simulated
SECTION = 1.0  # [bead diameters], half the thickness of the section
LID = 0  # number of the wall that closes the drain


@dataclass(frozen=True)
class Emptying:
    """Container and drain."""

    rig: Pile
    particle: Particle
    count: int
    drain_diameter: float  # [m]
    fill_limit: float  # [s]

    @property
    def height(self) -> float:
        """Height of the container [m]; leaves room for the loose lattice of the filling."""
        return filling.loose_height(self.particle, self.count, self.rig.base_diameter)

    @property
    def shapes(self) -> list[Shape]:
        """The lid of the drain first, then the floor around it and the side wall."""
        from rigtwin.sim.engine.walls.shapes import Annulus, Cylinder, Disc

        at, up = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
        hole, wide = self.drain_diameter / 2, self.rig.base_diameter / 2
        return [Disc(at, up, hole), Annulus(at, up, hole, wide), Cylinder(at, up, wide, self.height)]

    @property
    def domain(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Low and high corner [m] of the domain."""
        side = self.rig.base_diameter / 2 + 2 * self.particle.diameter
        return (-side, -side, -BELOW), (side, side, self.height + 2 * self.particle.diameter)

    @property
    def settings(self) -> dict[str, Any]:
        """Longest wait [s] for the filling, which decides the outcome of a run."""
        return {"fill_limit": self.fill_limit}

    @property
    def assumptions(self) -> dict[str, str]:
        """What the rig's description leaves open, in words by name."""
        assumed = f"not stated: a third of the base, at least {LEAST_DRAIN} bead diameters"
        given = assumed if self.rig.drain_diameter is None else "as given"
        return {
            "heap": "the bed that remains around the drain, in sections through its axis",
            "container": f"round, {self.rig.base_diameter * 1e3:.3g} mm wide, of the base's material",
            "drain_diameter": f"{self.drain_diameter * 1e3:.3g} mm ({given}), opened at once",
            "filling": "placed on a loose lattice in the container and let fall until it rested",
        }

    def need_bearable(self, fastest: float, *, falls_freely: bool) -> None:
        """Check nothing: beads that leave are only simulated over a short fall.

        Parameters
        ----------
        fastest, falls_freely : float, bool
            As for `rigtwin.sim.pile.pile.Method.need_bearable`.
        """

    def form(self, bulk: Bulk, logbook: Logbook, course: Course, progress: Progress) -> None:
        """Fill the container and open its drain.

        Parameters
        ----------
        bulk, logbook, course, progress : Bulk, Logbook, Course, Progress
            As for `rigtwin.sim.pile.pile.Method.form`.
        """
        if not course.placed:
            half = self.rig.base_diameter / 2
            box = np.array([-half, -half, 0.0]), np.array([half, half, self.height])
            filling.scatter(bulk, self.count, filling.in_tube(2 * half), box, self.particle, course.random)
            course.placed = self.count
        if course.let_go is None:
            filling.settle_and_let_go(bulk, logbook, course, self.particle, self.fill_limit, progress)
            bulk.remove_wall(LID)

    def warnings(self, course: Course, staying: Array) -> list[str]:
        """Warn about a filling that still moved, and about a bridged drain.

        Parameters
        ----------
        course, staying : Course, ndarray
            As for `rigtwin.sim.pile.pile.Method.warnings`.

        Returns
        -------
        list of str
            The warnings.
        """
        found = []
        if not course.in_time:
            found.append("the filling was still moving when the drain was opened; raise --fill-limit")
        if (np.hypot(*staying[:, :2].T) < self.drain_diameter / 4).any():
            drained = course.placed - len(staying)
            found.append(f"the drain is bridged: {drained} of {course.placed} beads drained, and beads stand over it")
        return found


def emptying(rig: Pile, particle: Particle, count: int, fill_limit: float) -> Emptying:
    """Return the container and its drain.

    Parameters
    ----------
    rig, particle, count : Pile, Particle, int
        As for `rigtwin.sim.pile.pile.run`.
    fill_limit : float
        Longest wait [s] until the filling rests.

    Returns
    -------
    Emptying
        Container and drain.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    """
    usual = max(DRAIN * rig.base_diameter, LEAST_DRAIN * particle.diameter)
    drain = usual if rig.drain_diameter is None else rig.drain_diameter
    positive(drain_diameter=drain, fill_limit=fill_limit)
    if rig.rim_height:
        raise BadInput("rim_height: a container that is emptied has a wall, not a rim; leave it out.")
    if drain < 2 * particle.diameter:
        raise BadInput(
            f"drain_diameter: {drain * 1e3:.3g} mm lets no beads of {particle.diameter * 1e3:.3g} mm through; give "
            f"{LEAST_DRAIN} bead diameters, below which they arch."
        )
    if drain > rig.base_diameter - 2 * particle.diameter:
        raise BadInput(
            f"drain_diameter: {drain * 1e3:.3g} mm leaves no floor in a container of {rig.base_diameter * 1e3:.3g} mm; "
            "give a smaller hole."
        )
    return Emptying(rig, particle, count, drain, fill_limit)


def section(centres: Array, radii: Array, rig: Pile, drain_diameter: float, grain: float, view: float) -> Profile:
    """Return the surface of the remaining bed in a section through the axis, its halves back to back.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m].
    radii : ndarray, shape (n,)
        Their radii [m].
    rig : Pile
        Its base diameter, that of the container, is used.
    drain_diameter : float
        Diameter of the hole [m].
    grain : float
        Diameter of a particle [m]; spheres whose centre is within it of the plane belong to the section.
    view : float
        Line of sight [deg], to which the section is perpendicular.

    Returns
    -------
    Profile
        Heights above the floor [m]; x [m] runs from one edge of the hole (negative) over the wall (0) to the other
        edge.
    """
    wide, hole = rig.base_diameter / 2, drain_diameter / 2
    angle = math.radians(view)
    cosine, sine = math.cos(angle), math.sin(angle)
    across = centres[:, 0] * cosine + centres[:, 1] * sine
    near = np.abs(centres[:, 1] * cosine - centres[:, 0] * sine) < SECTION * grain
    reach = wide - hole
    x = np.linspace(-reach, reach, 2 * math.ceil(reach / grain * POINTS_PER_DIAMETER) + 1)
    height = np.zeros(len(x))
    for side in (-1, 1):
        mine = (x >= 0) if side > 0 else (x <= 0)
        place = side * (wide - np.abs(x[mine]))  # position in the container
        height[mine] = np.maximum(height[mine], highest(place, across[near], centres[near, 2], radii[near]))
    return Profile(x=x, height=height, sigma=np.full(len(x), SIGMA), base=(-reach, reach), view=f"{view:g} deg")
