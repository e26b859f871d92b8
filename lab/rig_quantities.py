"""The quantities that a rig and its twin give, as they may be stated under ``[experiments.measured]`` in lab.toml."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from rigtwin.lab.rigs import RigSettings
from rigtwin.lab.units import DIMENSIONS, LONGEST


@dataclass(frozen=True)
class RigQuantity:
    """A quantity of a rig."""

    dimension: str  # a key of `rigtwin.lab.units.DIMENSIONS`
    methods: tuple[str, ...]  # as the twin names them, the one that is meant unless stated first
    which: Mapping[str, int | str] = field(default_factory=dict)
    """Details that distinguish several of the name, with the values that are meant unless stated."""
    highest: float = math.inf  # in `unit`
    zero: bool = False  # whether it may be zero

    @property
    def unit(self) -> str:
        """SI; angles are in degrees."""
        return "deg" if self.dimension == "angle" else DIMENSIONS[self.dimension][0]


FIRST_BOUNCE, FIRST_COLLISION, BOTH_SIDES = {"bounce": 1}, {"collision": 1}, {"side": "mean"}
SIDES, BODIES = ("left", "right", "mean"), ("A", "B")
"""Words that a side and a body may have."""

ABOVE_RIM = ", above the rim"
"""Ending of a method that reads a heap above the rim of its bowl."""

_SWING = ("velocity", "angle")
_TOPS, _SURFACE = "surface bead tops", "mean surface"


def _angle(*methods: str, which: Mapping[str, int | str] | None = None) -> RigQuantity:
    return RigQuantity("angle", methods, which or {}, highest=90)


def _twice(*methods: str) -> tuple[str, ...]:
    """Methods read from the base plate, and from the rim of the bowl."""
    return (*methods, *(f"{method}{ABOVE_RIM}" for method in methods))


def _friction(method: str) -> RigQuantity:
    return RigQuantity("number", (method,))


def _length(*methods: str, which: Mapping[str, int | str] | None = None) -> RigQuantity:
    return RigQuantity("length", methods, which or {}, highest=LONGEST)


_OF_RIG: dict[str, dict[str, RigQuantity]] = {
    "drop": {
        "restitution_wall": RigQuantity(
            "number", ("height", "velocity", "time", "all directions"), FIRST_BOUNCE, highest=1
        ),
        "rebound_height": _length("height", which=FIRST_BOUNCE),
    },
    "pendulum double": {
        "restitution_pair": RigQuantity("number", _SWING, FIRST_COLLISION, highest=1),
        "energy_ratio_root": RigQuantity("number", ("height",), FIRST_COLLISION, highest=1),
        "rebound_angle": RigQuantity("angle", ("swing",), {"body": "B"}, highest=180),
    },
    "pendulum wall": {
        "restitution_wall": RigQuantity("number", (*_SWING, "height"), FIRST_COLLISION, highest=1),
        "rebound_angle": RigQuantity("angle", ("swing",), {"body": "A"}, highest=180),
    },
    "tilt slide": {
        "static_friction": _friction("onset"),
        "static_friction_angle": _angle("onset"),
        "kinetic_friction": _friction("acceleration"),
    },
    "tilt roll": {
        "rolling_friction": _friction("onset"),
        "rolling_friction_angle": _angle("onset"),
    },
    "packing": {
        "bed_height": _length(_TOPS, _SURFACE, "outline"),
        "bulk_density": RigQuantity("density", (_TOPS, _SURFACE)),
    },
    "pile": {
        "angle_of_repose_graphical": _angle(*_twice("line 15-85 %", "line 20-80 %"), which=BOTH_SIDES),
        "angle_of_repose_geometric": _angle(*_twice("apex", "equal area"), which=BOTH_SIDES),
        "pile_height": _length("95 % of the top grain band"),
        "pile_base_width": _length("outermost outline points"),
        "pile_tip_radius": _length("parabola through the tip"),
    },
    "drum": {
        "angle_of_repose_graphical": _angle("line, middle half", "line, 10-90 %", "tangent at the axis"),
        "angle_of_repose_geometric": _angle("chord, wall to wall"),
        "angle_of_repose_upper": _angle("line, 50-90 %"),
        "angle_of_repose_lower": _angle("line, 10-50 %"),
    },
    "hopper": {
        "discharge_time": RigQuantity("time", ("given to last loss",)),
        "discharge_time_5_95": RigQuantity("time", ("5 to 95 % of what leaves",)),
        "mass_flow_rate": RigQuantity("mass_flow", ("line, 20 % to 80 %",)),
        "residue_fraction": RigQuantity("number", ("end of the record",), highest=1, zero=True),
    },
}
"""By rig, or by rig and variant where variants give other quantities."""


def quantities_of(rig: RigSettings) -> Mapping[str, RigQuantity]:
    """Return the quantities of an experiment's rig.

    Parameters
    ----------
    rig : RigSettings
        Settings of the rig.

    Returns
    -------
    mapping of str to RigQuantity
        By name.

    Examples
    --------
    >>> from rigtwin.lab.rigs import TiltSettings
    >>> list(quantities_of(TiltSettings("roll")))
    ['rolling_friction', 'rolling_friction_angle']
    """
    return _OF_RIG.get(rig.name) or _OF_RIG[f"{rig.name} {getattr(rig, 'variant', '')}"]
