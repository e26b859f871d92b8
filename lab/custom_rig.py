"""A rig of the user's own: walls from STL files, at rest or in motion, and what is filled in between them.

Lengths in metres, times in seconds from the start of the run, angles in radians; z up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Vector = tuple[float, float, float]
End = Literal["time", "at rest", "empty"]

INTERVAL = 0.02  # [s], between two looks at the particles, where nothing is stated
DURATION = 2.0  # [s], longest run where nothing is stated: a filling of 0.2 m height rests after about one


@dataclass(frozen=True)
class Region:
    """A box, or the upright cylinder that touches its sides."""

    low: Vector  # [m], corner
    high: Vector  # [m], opposite corner
    shape: Literal["box", "cylinder"] = "box"


@dataclass(frozen=True)
class StlWall:
    """A wall from an STL file; translation, vibration and rotation act together between `start` and `stop`."""

    stl: str  # path of the file
    unit: float  # [m], length of 1 in the file
    sha256: str  # of the file
    material: str
    velocity: Vector = (0.0, 0.0, 0.0)  # [m/s]
    rotation_speed: float = 0.0  # [rad/s], right-handed about the axis
    rotation_axis: Vector = (0.0, 0.0, 1.0)
    rotation_point: Vector = (0.0, 0.0, 0.0)  # [m], on the axis as the motion starts; it moves with the wall
    vibration_amplitude: Vector = (0.0, 0.0, 0.0)  # [m]
    vibration_frequency: float = 0.0  # [1/s]
    start: float = 0.0  # [s]
    stop: float | None = None  # [s]; None: never
    belt: bool = False  # the surface moves and the shape stays
    removed: float | None = None  # [s], when the wall is taken away; None: never

    @property
    def moves(self) -> bool:
        """Whether it moves at any time."""
        return self.vibrates or self.rotation_speed != 0 or any(self.velocity)

    @property
    def vibrates(self) -> bool:
        """Whether it vibrates at any time."""
        return self.vibration_frequency != 0 and any(self.vibration_amplitude)

    @property
    def moves_until(self) -> float:
        """Time [s] of the end of its motion, by a stop or by its removal; infinite where there is none."""
        return min(math.inf if when is None else when for when in (self.stop, self.removed))


@dataclass(frozen=True)
class CustomRig:
    """Walls, filling, and what is looked at."""

    walls: Mapping[str, StlWall]
    fill: Region  # in which particles are placed
    low: Vector | None = None  # [m], corner of the domain that particles are removed beyond; None: about walls and fill
    high: Vector | None = None  # [m]
    pour_rate: float | None = None  # [1/s]; None: at once, and what finds no room as soon as it does
    pour_speed: float = 0.0  # [m/s], downwards, of poured particles
    duration: float = DURATION  # [s], longest run
    end: End = "time"  # "at rest": when all particles rest; "empty": when all have left
    interval: float = INTERVAL  # [s], between two looks
    regions: Mapping[str, Region] = field(default_factory=dict)  # in which particles are counted
