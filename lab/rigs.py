"""The rigs: geometry and settings that a measurement and its twin share.

Lengths in metres, angles in radians, masses in kilograms.  A field that is None was not given by the experimenter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from rigtwin.lab.errors import BadInput

GRAVITY = 9.81  # [m/s^2]


@dataclass(frozen=True)
class Drop:
    """A bead falls on a plate and bounces (Hlosta et al. 2020, fig. 3b)."""

    drop_height: float  # [m], from the bead's lowest point to the plate
    bounces: int = 4  # how many bounces the twin shows


@dataclass(frozen=True)
class Pendulum:
    """Bead A swings from an angle and hits bead B (or a wall) at the lowest point (fig. 3c)."""

    length: float  # [m], hinge to bead centre
    release_angle: float  # [rad], of bead A from the vertical
    variant: Literal["double", "wall"] = "double"


@dataclass(frozen=True)
class Pile:
    """A heap on a round base, formed by piling: beads rain on its middle and the surplus falls over the rim (fig. 5a).

    The paper does not state the rim; without one no heap stays on a smooth plate.
    """

    base_diameter: float  # [m]
    rim_height: float = 0.0  # [m], height of the bowl's rim above the base plate
    outlet_diameter: float | None = None  # [m], of the pouring funnel; None: a quarter of the base
    variant: Literal["piling"] = "piling"


@dataclass(frozen=True)
class Drum:
    """A drum turning about its level axis, partly filled (section 2.2.4); the paper states neither depth nor fill."""

    diameter: float  # [m], inner
    speed: float  # [rad/s]
    depth: float | None = None  # [m], between the end walls; None: half the diameter
    fill: float | None = None  # [1], part of the drum's volume that the bed takes; None: 0.35


@dataclass(frozen=True)
class Hopper:
    """A hopper that empties through its outlet.

    conical: a cylinder on a cone, with a round outlet (section 2.2.3).  slot: two inclined walls between two upright
    plates, with a slot between them, and below it a slide that leads to the floor (section 2.2.5).
    """

    outlet: float  # [m], diameter of the round outlet, width of the slot
    variant: Literal["conical", "slot"] = "conical"
    diameter: float = 0.1  # [m], of the conical hopper's cylinder
    cone_height: float = 0.1  # [m]
    inclination: float = math.radians(60)  # [rad], of the slot hopper's walls from the level
    width: float | None = None  # [m], of the slot hopper above its inclined walls; None: 150 mm
    slot_length: float | None = None  # [m]; None: 68 mm
    slide_angle: float | None = None  # [rad], of the slide from the level; None: 45 degrees
    slide_drop: float | None = None  # [m], from the slot to the slide below it; None: 60 mm


Rig = Drop | Pendulum | Pile | Drum | Hopper


@dataclass(frozen=True)
class DropSettings:
    """What the experimenter says of a drop beforehand; None is "not given" and is then measured."""

    drop_height: float | None = None  # [m], from the bead's lowest point to the plate
    bounces: int = 4  # how many bounces the twin shows

    name: ClassVar[str] = "drop"

    def rig(self, measured_drop_height: float | None = None) -> Drop:
        """The rig of the twin; a height stated in the lab file goes before the measured one."""
        height = _stated("drop_height", self.drop_height, measured_drop_height)
        return Drop(drop_height=height, bounces=self.bounces)


@dataclass(frozen=True)
class PendulumSettings:
    """What the experimenter says of a pendulum beforehand."""

    length: float  # [m], hinge to bead centre
    release_angle: float | None = None  # [rad], of bead A from the vertical
    variant: Literal["double", "wall"] = "double"

    name: ClassVar[str] = "pendulum"

    def rig(self, measured_release_angle: float | None = None) -> Pendulum:
        """The rig of the twin; an angle stated in the lab file goes before the measured one."""
        angle = _stated("release_angle", self.release_angle, measured_release_angle)
        return Pendulum(length=self.length, release_angle=angle, variant=self.variant)


@dataclass(frozen=True)
class PileSettings:
    """What the experimenter says of a pile beforehand."""

    base_diameter: float  # [m]
    rim_height: float = 0.0  # [m], height of the bowl's rim above the base plate
    outlet_diameter: float | None = None  # [m], of the pouring funnel
    count: int | None = None  # how many particles were poured
    variant: Literal["piling"] = "piling"

    name: ClassVar[str] = "pile"

    def rig(self) -> Pile:
        """The rig of the twin."""
        return Pile(self.base_diameter, self.rim_height, self.outlet_diameter, self.variant)


RigSettings = DropSettings | PendulumSettings | PileSettings


def _stated(key: str, stated: float | None, measured: float | None) -> float:
    value = stated if stated is not None else measured
    if value is None:
        raise BadInput(f"{key} is neither stated nor measured; add {key} to the experiment in lab.toml.")
    return value
