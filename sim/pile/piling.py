"""Pile by piling: beads rain on the middle of a bowl and the surplus falls over its rim."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.lab.progress import Progress
from rigtwin.lab.rigs import GRAVITY, Pile
from rigtwin.lab.units import positive
from rigtwin.sim.run import filling

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.walls.shapes import Shape
    from rigtwin.sim.run.run_log import Logbook


SLOW = 0.1  # [m/s], a slower bead belongs to the heap, a faster one is still falling
QUICK_RATE = 400.0  # [1/s], least default rate, to keep a run short, while the initial speed adds no more than the fall
STREAM = 0.2  # largest volume fraction of beads in a free stream
NARROWEST = 3  # [bead diameters], smallest default outlet


@dataclass(kw_only=True)
class Course(filling.Course):
    """State of the run, with the heights of the outlet and of the bed."""

    height: float = 0.0  # [m], of the outlet, which rises with the heap
    bed_height: float | None = None  # [m], mean surface of the bed in the tube of a pouring, before it is lifted


@dataclass(frozen=True)
class Piling:
    """Bowl and funnel."""

    rig: Pile
    particle: Particle
    count: int
    outlet: filling.Outlet  # its height is 0 if it rises with the heap
    fall_height: float | None  # [m], of the rising outlet above the top of the heap; None: fixed outlet

    @property
    def shapes(self) -> list[Shape]:
        """Base and rim."""
        return bowl(self.rig)

    @property
    def domain(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Low and high corner [m] of the domain."""
        outlet, diameter = self.outlet, self.particle.diameter
        side = self.rig.base_diameter / 2 + 4 * diameter
        # a heap steeper than 45 degrees is not expected; the outlet stops rising there
        highest = self.rig.rim_height + self.rig.base_diameter / 2 + (self.fall_height or 0.0)
        top = max(highest, outlet.height) + 4 * filling.LOOK * outlet.speed + 4 * diameter
        return (-side, -side, -2 * diameter), (side, side, top)

    @property
    def settings(self) -> dict[str, Any]:
        """Outlet and fall height, which decide the outcome of a run."""
        return {"outlet": {**self.outlet.settings, "fall_height": self.fall_height}}

    @property
    def assumptions(self) -> dict[str, str]:
        """What the rig's description leaves open, in words by name."""
        rig, outlet = self.rig, self.outlet
        given = (
            f"a quarter of the base, at least {NARROWEST} bead diameters" if rig.outlet_diameter is None else "as given"
        )
        falls = f"{outlet.height * 1e3:.3g} mm above the base, fixed"
        if self.fall_height is not None:
            falls = f"{self.fall_height * 1e3:.3g} mm above the top of the heap, with which the outlet rises"
        return {
            "outlet_diameter": f"{outlet.diameter * 1e3:.3g} mm ({given})",
            "pour_rate": f"{outlet.pours} ({outlet.rate_from})",
            "outlet_speed": f"{outlet.speed:.2f} m/s",
            "fall_height": falls,
            "rim_height": f"{rig.rim_height * 1e3:.3g} mm" if rig.rim_height else "none: a flat disc",
        }

    def need_bearable(self, fastest: float, *, falls_freely: bool) -> None:
        """Refuse beads that would leave the outlet, or hit the base, too fast for the time step.

        Parameters
        ----------
        fastest, falls_freely : float, bool
            As for `rigtwin.sim.pile.pile.Method.need_bearable`.

        Raises
        ------
        BadInput
            If they would.
        """
        outlet = self.outlet
        filling.need_bearable(outlet, fastest)
        if falls_freely:
            name = "outlet_height" if self.fall_height is None else "fall_height"
            filling.need_bearable_fall(name, self.fall_height or outlet.height, outlet.speed, fastest)

    def form(self, bulk: Bulk, logbook: Logbook, course: Course, progress: Progress) -> None:
        """Insert the beads in the outlet until all are placed.

        Parameters
        ----------
        bulk, logbook, course, progress : Bulk, Logbook, Course, Progress
            As for `rigtwin.sim.pile.pile.Method.form`.
        """
        clear = self.outlet.slab + 2 * self.particle.diameter

        def above() -> tuple[filling.Outlet, Array]:
            beads = bulk.beads()
            height = self.outlet.height
            if self.fall_height is not None:
                resting = beads.position[(beads.velocity**2).sum(1) < SLOW**2, 2]
                height = max(course.height, resting.max(initial=0.0) + self.particle.radius + self.fall_height)
            course.height = float(min(height, bulk.top - clear))
            return replace(self.outlet, height=course.height), beads.position

        filling.rain(bulk, logbook, course, above, self.particle, self.count, progress)

    def warnings(self, course: Course, staying: Array) -> list[str]:
        """Warn about beads without room, and about a base without a rim.

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
        if course.placed < self.count:
            found.append(f"only {course.placed} of {self.count} beads found room below the outlet")
        if self.rig.rim_height == 0:
            found.append(
                f"the base has no rim: {len(staying)} of {course.placed} beads stayed on it; "
                "give its height if it has one (--rim-height)"
            )
        return found


def piling(rig: Pile, particle: Particle, count: int, rate: float | None, fall_height: float | None) -> Piling:
    """Return the funnel over the bowl.

    Parameters
    ----------
    rig, particle, count : Pile, Particle, int
        As for `rigtwin.sim.pile.pile.run`.
    rate : float or None
        `pour_rate` of that function [1/s].
    fall_height : float or None
        As for that function [m].

    Returns
    -------
    Piling
        Bowl and funnel.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    """
    bead = particle.diameter
    diameter = outlet_diameter(rig.base_diameter, bead) if rig.outlet_diameter is None else rig.outlet_diameter
    if diameter < 2 * bead:
        raise BadInput(
            f"outlet_diameter: {diameter * 1e3:.3g} mm lets no beads of {bead * 1e3:.3g} mm through; "
            "give at least two bead diameters."
        )
    if diameter > rig.base_diameter:
        raise BadInput(
            f"outlet_diameter: {diameter * 1e3:.3g} mm is wider than the base of {rig.base_diameter * 1e3:.3g} mm; "
            "beads would fall beside it: narrow it."
        )
    height = 3 * bead if fall_height is None else fall_height
    positive(fall_height=height)
    free = math.sqrt(GRAVITY * diameter / 2)  # [m/s], speed of a free discharge
    solid, grain = particle.mean_volume, particle.typical.diameter
    rate_from = filling.GIVEN
    if rate is None:
        grains = f"for grains of {grain * 1e3:.3g} mm"
        rate, rate_from = filling.beverloo(particle, diameter, grain), f"Beverloo's discharge of the outlet {grains}"
        # beads released faster than the fall accelerates them would dig into the heap
        fastest = max(free, math.sqrt(2 * GRAVITY * height))
        quick = min(QUICK_RATE, STREAM * math.pi / 4 * diameter**2 * fastest / solid)
        if rate < quick:
            rate, rate_from = quick, f"above Beverloo's {rate:.0f} {grains}, to keep the run short"
    positive(pour_rate=rate)
    if rig.outlet_height is not None:
        positive(outlet_height=rig.outlet_height)
        if rig.outlet_height < bead:
            raise BadInput(
                f"outlet_height: {rig.outlet_height * 1e3:.3g} mm above the base let no beads of {bead * 1e3:.3g} mm "
                "out; give at least a bead diameter, and more than the heap will be high."
            )
    # fast enough to keep the stream dilute
    thinnest = rate * solid / (STREAM * math.pi / 4 * diameter**2)
    outlet = filling.Outlet(diameter, rig.outlet_height or 0.0, rate, max(free, thinnest), rate_from)
    filling.need_end(outlet, count)
    return Piling(rig, particle, count, outlet, height if rig.outlet_height is None else None)


def outlet_diameter(base_diameter: float, bead: float) -> float:
    """Return the default diameter of the outlet.

    Parameters
    ----------
    base_diameter : float
        Diameter of the base [m].
    bead : float
        Diameter of the beads [m].

    Returns
    -------
    float
        A quarter of the base, at least three bead diameters [m].
    """
    return max(base_diameter / 4, NARROWEST * bead)


def bowl(rig: Pile) -> list[Shape]:
    """Return the walls of the base and of its rim, if there is one.

    Parameters
    ----------
    rig : Pile
        Its base diameter and rim height are used.

    Returns
    -------
    list of Shape
        The base first.
    """
    from rigtwin.sim.engine.walls.shapes import Cylinder, Disc

    up = (0.0, 0.0, 1.0)
    shapes: list[Shape] = [Disc((0.0, 0.0, 0.0), up, rig.base_diameter / 2)]
    if rig.rim_height > 0:
        shapes.append(Cylinder((0.0, 0.0, 0.0), up, rig.base_diameter / 2, rig.rim_height))
    return shapes
