"""Pile by pouring: a filled tube on the base is lifted, and the filling runs out below it.

"If the cylinder is lifted too fast, the material does not spill out of the cylinder immediately due to friction and
inertia, but rather with a delay ..., which results in a larger spill" (Hlosta et al. 2020, section 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.formatting import as_given
from rigtwin.lab.materials import Particle
from rigtwin.lab.progress import Progress
from rigtwin.lab.rigs import LIFT_SPEED, Pile
from rigtwin.lab.units import positive
from rigtwin.sim.output.outline import surface
from rigtwin.sim.pile.piling import Course, bowl
from rigtwin.sim.run import filling

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.walls.shapes import Shape
    from rigtwin.sim.run.run_log import Logbook


NARROWEST = 4  # [bead diameters], narrowest tube; in a narrower one the beads arch


@dataclass(frozen=True)
class Pouring:
    """Base and tube."""

    rig: Pile
    particle: Particle
    count: int
    tube_diameter: float  # [m], inside
    lift_speed: float  # [m/s]
    fill_limit: float  # [s]

    @property
    def tube_height(self) -> float:
        """Height of the tube [m]; leaves room for the loose lattice of the filling."""
        return filling.loose_height(self.particle, self.count, self.tube_diameter)

    @property
    def shapes(self) -> list[Shape]:
        """Base and rim, and the tube as the last wall."""
        from rigtwin.sim.engine.walls.shapes import Cylinder

        return [*bowl(self.rig), Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), self.tube_diameter / 2, self.tube_height)]

    @property
    def domain(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Low and high corner [m] of the domain."""
        side = self.rig.base_diameter / 2 + 4 * self.particle.diameter
        return (-side, -side, -2 * self.particle.diameter), (side, side, self.tube_height + 2 * self.particle.diameter)

    @property
    def settings(self) -> dict[str, Any]:
        """Longest wait [s] for the filling, which decides the outcome of a run."""
        return {"fill_limit": self.fill_limit}

    @property
    def assumptions(self) -> dict[str, str]:
        """What the rig's description leaves open, in words by name."""
        rig = self.rig
        tube = "half the base: not stated" if rig.tube_diameter is None else "as given"
        return {
            "tube_diameter": f"{self.tube_diameter * 1e3:.3g} mm ({tube})",
            "lift_speed": f"{self.lift_speed * 1e3:.3g} mm/s ({as_given(rig.lift_speed)}), at full speed at once",
            "tube": "of the base's material, without thickness",
            "filling": "placed on a loose lattice in the tube and let fall until it rested",
            "rim_height": f"{rig.rim_height * 1e3:.3g} mm" if rig.rim_height else "none: a flat disc",
        }

    def need_bearable(self, fastest: float, *, falls_freely: bool) -> None:
        """Refuse a tube that is lifted too fast for the time step; the beads themselves fall only a short way.

        Parameters
        ----------
        fastest, falls_freely : float, bool
            As for `rigtwin.sim.pile.pile.Method.need_bearable`.

        Raises
        ------
        BadInput
            If it is.
        """
        if self.lift_speed >= fastest:
            raise BadInput(
                f"lift_speed: the tube is lifted at {self.lift_speed:.3g} m/s, but the time step allows at most "
                f"{fastest:.3g} m/s; lift it more slowly (default: {LIFT_SPEED:g} m/s)."
            )

    def form(self, bulk: Bulk, logbook: Logbook, course: Course, progress: Progress) -> None:
        """Fill the tube and lift it until it is above all beads.

        Parameters
        ----------
        bulk, logbook, course, progress : Bulk, Logbook, Course, Progress
            As for `rigtwin.sim.pile.pile.Method.form`.
        """
        from rigtwin.sim.engine.walls.shapes import Motion

        tube = len(bulk.shapes) - 1
        if not course.placed:
            half = self.tube_diameter / 2
            box = np.array([-half, -half, 0.0]), np.array([half, half, self.tube_height])
            filling.scatter(bulk, self.count, filling.in_tube(self.tube_diameter), box, self.particle, course.random)
            course.placed = self.count
        if course.let_go is None:
            filling.settle_and_let_go(bulk, logbook, course, self.particle, self.fill_limit, progress)
            beads = bulk.beads()
            course.bed_height = self.bed_height(beads.position, beads.radius)
            bulk.move_wall(tube, Motion((0.0, 0.0, self.lift_speed), start=bulk.time))
        assert course.let_go is not None
        steps = max(1, round(filling.LOOK / bulk.time_step))
        while (lifted := self.lift_speed * (bulk.time - course.let_go)) < (top := _top(bulk)):
            logbook.run(steps)
            logbook.look(course.kept())
            progress("lifting the tube", lifted, top)
        bulk.remove_wall(tube)

    def bed_height(self, centres: Array, radii: Array) -> float:
        """Return the mean height of the surface of the bed in the tube.

        Parameters
        ----------
        centres : ndarray, shape (n, 3)
            Centres of the spheres [m].
        radii : ndarray, shape (n,)
            Their radii [m].

        Returns
        -------
        float
            Height above the base [m].
        """
        return float(surface(centres, radii, self.tube_diameter).mean())

    def warnings(self, course: Course, staying: Array) -> list[str]:
        """Warn about a filling that still moved, and about an empty base.

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
            found.append("the filling was still moving when the tube was lifted; raise --fill-limit")
        if not len(staying):
            found.append("nothing stayed on the base; give it a rim, or a larger base")
        return found


def pouring(rig: Pile, particle: Particle, count: int, fill_limit: float) -> Pouring:
    """Return the tube on the base.

    Parameters
    ----------
    rig, particle, count : Pile, Particle, int
        As for `rigtwin.sim.pile.pile.run`.
    fill_limit : float
        Longest wait [s] until the filling rests.

    Returns
    -------
    Pouring
        Base and tube.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    """
    tube = rig.base_diameter / 2 if rig.tube_diameter is None else rig.tube_diameter
    speed = LIFT_SPEED if rig.lift_speed is None else rig.lift_speed
    positive(tube_diameter=tube, lift_speed=speed, fill_limit=fill_limit)
    if tube < NARROWEST * particle.diameter:
        raise BadInput(
            f"tube_diameter: {tube * 1e3:.3g} mm is too narrow for beads of {particle.diameter * 1e3:.3g} mm, which "
            f"would arch in it; give at least {NARROWEST} bead diameters."
        )
    if tube >= rig.base_diameter:
        raise BadInput(
            f"tube_diameter: {tube * 1e3:.3g} mm does not stand on a base of {rig.base_diameter * 1e3:.3g} mm; "
            "give a narrower tube."
        )
    return Pouring(rig, particle, count, tube, speed, fill_limit)


def _top(bulk: Bulk) -> float:
    beads = bulk.beads()
    return float((beads.position[:, 2] + beads.radius).max(initial=0.0))
