"""The rigs: geometry and settings that a measurement and its twin share.

Lengths in metres, angles in radians, masses in kilograms.  A field that is None was not given by the experimenter.
`RIGS` is the list of the rigs; every other list of them follows from it or is checked against it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, get_args

from rigtwin.lab.errors import TwinLacks

GRAVITY = 9.81  # [m/s^2]

# [rad], of a pendulum's release; nearer to the top it hangs for so long that its record holds several collisions, of
# which the first cannot be identified
UPSIDE_DOWN = math.radians(175)

# what the twins take where the rig does not state it
OUTLET_SHARE = 0.6  # [1], outlet over cylinder diameter of a packing
LIFT_SPEED = 0.02  # [m/s], of the tube of a pile
SLOT_WIDTH, SLOT_LENGTH = 0.15, 0.068  # [m], of a slot hopper; the length follows from the paper's discharge times

RigName = Literal["drop", "pendulum", "tilt", "packing", "pile", "drum", "hopper"]


@dataclass(frozen=True)
class Drop:
    """A bead falls on a plate and bounces (Hlosta et al. 2020, fig. 3b)."""

    drop_height: float  # [m], from the bead's lowest point to the plate
    bounces: int = 4  # how many bounces the twin shows
    turned: float | None = None  # [rad], of a clump out of its own axes, clockwise as seen; None: at random


@dataclass(frozen=True)
class Pendulum:
    """Bead A swings from an angle and hits bead B (or a wall) at the lowest point (fig. 3c)."""

    length: float  # [m], hinge to bead centre
    release_angle: float  # [rad], of bead A from the vertical
    variant: Literal["double", "wall"] = "double"
    hanger: Literal["string", "rod"] = "string"  # rigid in the twin, which warns where a string would be slack
    rod_mass: float = 0.0  # [kg], of each rod


PileMethod = Literal["piling", "pouring", "emptying"]


@dataclass(frozen=True)
class Pile:
    """A heap on a round base (fig. 5a); `variant` says how it forms.

    piling: beads rain on the base's middle and the surplus falls over the rim.  The paper does not state the rim;
    without one no heap stays on a smooth plate.
    pouring: a filled tube stands on the base and is lifted.
    emptying: a filled round container, as wide as the base, drains through a hole in the middle of its floor; the heap
    is what stays: "only the particles above the drain hole were dropped, creating a slope angle of almost 90 degrees"
    (section 3.4) can be said of that alone.
    """

    base_diameter: float  # [m]; emptying: of the container, inside
    rim_height: float = 0.0  # [m], height of the bowl's rim above the base plate; emptying: none
    outlet_diameter: float | None = None  # [m], piling: of the funnel; None: a quarter of the base, or 3 beads
    variant: PileMethod = "piling"
    outlet_height: float | None = (
        None  # [m], piling: of a funnel that stands above the base; None: it rises as the heap
    )
    tube_diameter: float | None = None  # [m], pouring: inside; None: half the base
    lift_speed: float | None = None  # [m/s], pouring: of the tube; None: LIFT_SPEED
    drain_diameter: float | None = None  # [m], emptying; None: a third of the base


@dataclass(frozen=True)
class Packing:
    """Particles pour from a hopper, as its slide is drawn, into a measuring cylinder (fig. 4).

    The paper gives the cylinder's volume, 1000 mL, not its diameter: 65 mm follow from its masses and bed heights.
    Without a `hopper_diameter` the particles rain from the outlet at the rate that Beverloo's law gives for it; with
    one they stand on the slide of a conical hopper above the cylinder, and the slide is drawn away at once.
    """

    cylinder_diameter: float = 0.065  # [m], inside
    cylinder_height: float = 0.302  # [m], inside; with 65 mm it holds 1000 mL
    outlet_diameter: float | None = None  # [m], of the hopper; None: OUTLET_SHARE of the cylinder
    fall_height: float = 0.02  # [m], from the outlet to the cylinder's rim
    hopper_diameter: float | None = None  # [m], inside, above its cone of 60 degrees; None: no hopper, a rain


@dataclass(frozen=True)
class Tilt:
    """A plate turns slowly about a hinge until the body on it slides or rolls (figs 3a and 3d)."""

    variant: Literal["slide", "roll"]
    speed: float = 0.0175  # [rad/s], of the plate; about one degree per second
    start_angle: float = 0.0  # [rad], of the plate where the film begins
    plate_length: float = 0.2  # [m], from the hinge; the body lies in its middle


@dataclass(frozen=True)
class Drum:
    """A drum turning about its level axis, partly filled (section 2.2.4); the paper states neither depth nor fill."""

    diameter: float  # [m], inner
    speed: float  # [rad/s]
    depth: float | None = None  # [m], between the end walls; None: half the diameter
    fill: float | None = None  # [1], part of the drum's volume that the bed takes; None: 0.35
    end_wall_friction: float | None = None  # [1], static friction of the end walls; None: that of the shell


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
    width: float | None = None  # [m], of the slot hopper above its inclined walls; None: SLOT_WIDTH
    slot_length: float | None = None  # [m]; None: SLOT_LENGTH
    slide_angle: float | None = None  # [rad], of the slide from the level; None: 45 degrees
    slide_drop: float | None = None  # [m], from the slot to the slide below it; None: 60 mm


Rig = Drop | Pendulum | Pile | Packing | Tilt | Drum | Hopper


class _Settings:
    """What every rig says of itself."""

    name: ClassVar[RigName]
    title: ClassVar[str]  # for the reader of a report
    several_views: ClassVar[bool] = False  # a rig at rest, of which one repetition may have several photos
    wall_of_particles: ClassVar[bool] = False  # whether the wall may be covered with particles, and has their contacts
    only_of: ClassVar[Mapping[str, tuple[str, str]]] = {}
    """Settings that are used with one value of another setting alone, with that setting and its value."""

    @property
    def idle(self) -> frozenset[str]:
        """Settings that are not used with the others as they are."""
        return frozenset(name for name, (other, value) in self.only_of.items() if getattr(self, other) != value)

    @property
    def particles_touch(self) -> bool:
        """Whether particles touch each other, not only the wall."""
        return True


@dataclass(frozen=True)
class DropSettings(_Settings):
    """What the experimenter says of a drop beforehand; None is "not given" and is then measured."""

    drop_height: float | None = None  # [m], from the bead's lowest point to the plate
    bounces: int = 4  # how many bounces the twin shows
    turned: float | None = None  # [rad], of a clump out of its own axes, clockwise as seen; None: at random

    name: ClassVar[RigName] = "drop"
    title: ClassVar[str] = "Drop test"

    @property
    def particles_touch(self) -> bool:
        """False: one bead falls."""
        return False

    def rig(self, measured_drop_height: float | None = None) -> Drop:
        """Return the rig of the twin; a height stated in the lab file goes before the measured one.

        Parameters
        ----------
        measured_drop_height : float, optional
            Measured drop height [m].

        Returns
        -------
        Drop
            The rig.

        Raises
        ------
        TwinLacks
            If the height is neither stated nor measured.
        """
        height = _stated("drop_height", self.drop_height, measured_drop_height)
        return Drop(drop_height=height, bounces=self.bounces, turned=self.turned)


@dataclass(frozen=True)
class PendulumSettings(_Settings):
    """What the experimenter says of a pendulum beforehand."""

    length: float  # [m], hinge to bead centre
    release_angle: float | None = None  # [rad], of bead A from the vertical
    variant: Literal["double", "wall"] = "double"
    hanger: Literal["string", "rod"] = "string"
    rod_mass: float = 0.0  # [kg], of each rod

    name: ClassVar[RigName] = "pendulum"
    title: ClassVar[str] = "Pendulum"
    only_of: ClassVar[Mapping[str, tuple[str, str]]] = {"rod_mass": ("hanger", "rod")}

    @property
    def particles_touch(self) -> bool:
        """Whether two beads collide."""
        return self.variant == "double"

    def rig(self, measured_release_angle: float | None = None) -> Pendulum:
        """Return the rig of the twin; an angle stated in the lab file goes before the measured one.

        Parameters
        ----------
        measured_release_angle : float, optional
            Measured release angle [rad].

        Returns
        -------
        Pendulum
            The rig.

        Raises
        ------
        TwinLacks
            If the angle is neither stated nor measured.
        """
        angle = _stated("release_angle", self.release_angle, measured_release_angle)
        return Pendulum(self.length, angle, self.variant, self.hanger, self.rod_mass)


@dataclass(frozen=True)
class PileSettings(_Settings):
    """What the experimenter says of a pile beforehand."""

    base_diameter: float  # [m]
    rim_height: float = 0.0  # [m], height of the bowl's rim above the base plate
    outlet_diameter: float | None = None  # [m], of the pouring funnel
    count: int | None = None  # how many particles were poured
    variant: PileMethod = "piling"
    outlet_height: float | None = None  # [m], of the funnel above the base
    tube_diameter: float | None = None  # [m], of the tube that is lifted
    lift_speed: float | None = None  # [m/s]
    drain_diameter: float | None = None  # [m], of the hole in the container's floor

    name: ClassVar[RigName] = "pile"
    title: ClassVar[str] = "Pile"
    several_views: ClassVar[bool] = True
    only_of: ClassVar[Mapping[str, tuple[str, str]]] = {
        "outlet_diameter": ("variant", "piling"),
        "outlet_height": ("variant", "piling"),
        "tube_diameter": ("variant", "pouring"),
        "lift_speed": ("variant", "pouring"),
        "drain_diameter": ("variant", "emptying"),
    }

    def rig(self) -> Pile:
        """The rig of the twin."""
        return Pile(**{name: value for name, value in vars(self).items() if name != "count"})


@dataclass(frozen=True)
class TiltSettings(_Settings):
    """What the experimenter says of a tilting plate beforehand."""

    variant: Literal["slide", "roll"]
    arm_length: float | None = None  # [m], plate or arm, from hinge to tip
    speed: float | None = None  # [rad/s], how fast the plate is tilted

    name: ClassVar[RigName] = "tilt"
    title: ClassVar[str] = "Tilting plate"
    wall_of_particles: ClassVar[bool] = True

    @property
    def particles_touch(self) -> bool:
        """False: one body lies on the plate."""
        return False

    def rig(self) -> Tilt:
        """The rig of the twin."""
        return Tilt(self.variant) if self.speed is None else Tilt(self.variant, self.speed)


@dataclass(frozen=True)
class PackingSettings(_Settings):
    """What the experimenter says of a packed cylinder beforehand."""

    cylinder_diameter: float  # [m], inner
    total_mass: float | None = None  # [kg], of all particles
    count: int | None = None  # how many particles there are
    hopper_diameter: float | None = None  # [m], of the hopper above the cylinder
    outlet_diameter: float | None = None  # [m], of that hopper's slide, or of the funnel
    fall_height: float | None = None  # [m], from the outlet to the cylinder's rim

    name: ClassVar[RigName] = "packing"
    title: ClassVar[str] = "Packed cylinder"
    several_views: ClassVar[bool] = True

    def rig(self) -> Packing:
        """The rig of the twin."""
        usual = Packing(
            self.cylinder_diameter, outlet_diameter=self.outlet_diameter, hopper_diameter=self.hopper_diameter
        )
        return usual if self.fall_height is None else replace(usual, fall_height=self.fall_height)


@dataclass(frozen=True)
class DrumSettings(_Settings):
    """What the experimenter says of a rotating drum beforehand."""

    drum_diameter: float  # [m], inner
    speed: float  # [rad/s]
    depth: float | None = None  # [m], inner length along the axis
    fill: float | None = None  # [1], share of the drum's volume that the bed takes
    count: int | None = None  # how many particles there are
    end_wall_friction: float | None = None  # [1], static friction of the end walls, where it is not that of the shell

    name: ClassVar[RigName] = "drum"
    title: ClassVar[str] = "Rotating drum"

    def rig(self) -> Drum:
        """The rig of the twin."""
        return Drum(self.drum_diameter, self.speed, self.depth, self.fill, self.end_wall_friction)


@dataclass(frozen=True)
class HopperSettings(_Settings):
    """What the experimenter says of a hopper beforehand."""

    variant: Literal["slot", "conical"]
    bin_width: float | None = None  # [m], inner width, or diameter, of the bin
    depth: float | None = None  # [m], of a slot hopper, along the line of sight
    outlet: float | None = None  # [m], width of the slot or diameter of the outlet
    cone_height: float | None = None  # [m], of a conical hopper; hardly any: a flat floor
    inclination: float | None = None  # [rad], of a slot hopper's walls from the level
    total_mass: float | None = None  # [kg], of all particles
    count: int | None = None  # how many particles there are

    name: ClassVar[RigName] = "hopper"
    title: ClassVar[str] = "Hopper"
    only_of: ClassVar[Mapping[str, tuple[str, str]]] = {
        "depth": ("variant", "slot"),
        "inclination": ("variant", "slot"),
        "cone_height": ("variant", "conical"),
    }

    def rig(self) -> Hopper:
        """The rig of the twin."""
        outlet = _stated("outlet", self.outlet, None)
        if self.variant == "slot":
            slot = Hopper(outlet, "slot", width=self.bin_width, slot_length=self.depth)
            return slot if self.inclination is None else replace(slot, inclination=self.inclination)
        usual = Hopper(outlet)
        wide = usual.diameter if self.bin_width is None else self.bin_width
        return replace(
            usual, diameter=wide, cone_height=usual.cone_height if self.cone_height is None else self.cone_height
        )


RigSettings = (
    DropSettings | PendulumSettings | TiltSettings | PackingSettings | PileSettings | DrumSettings | HopperSettings
)

SETTINGS: dict[str, type[RigSettings]] = {kind.name: kind for kind in get_args(RigSettings)}
RIGS = tuple(SETTINGS)


def _stated(key: str, stated: float | None, measured: float | None) -> float:
    value = stated if stated is not None else measured
    if value is None:
        words = key.replace("_", " ")
        raise TwinLacks(f"the {words} is neither stated nor measured; add {key} to the experiment in lab.toml.")
    return value
