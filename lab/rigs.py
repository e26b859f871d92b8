"""The rigs: geometry and settings that a measurement and its twin share.

Lengths in metres, angles in radians, masses in kilograms.  A field that is None was not given by the experimenter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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


Rig = Drop | Pendulum | Pile
