"""What an effect is: names, equation, source, parameters, the rigs in which it acts, and the hooks where it enters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

Hook = Callable[..., Any]
WIDENING = ("jitter", "scatter")
"""Values of `Effect.geometry` that move nothing and widen the noise alone."""
RIGS = ("drop", "pendulum", "double", "slide", "roll")


@dataclass(frozen=True)
class Parameter:
    """One coefficient of an effect, in SI."""

    name: str
    unit: str
    low: float
    """Below this the value is not physical."""
    high: float
    typical: float
    """A clearly visible size; sets the step of the fit."""
    predicted: float | None = None
    """The value that physics predicts without a fit, where it does."""
    least: float = 0.0
    """What is smaller than this is in every lab, and is not named."""
    assumed: tuple[float, float] | None = None
    """Mean and standard deviation, in any lab, of what goes with the effect and is no measure of its strength."""
    stated: Callable[[Mapping[str, Any], Mapping[str, Any]], float] | None = None
    """What stands for it where a lab states enough of a bead and a wall, by their keys in lab.json; else the assumed
    value does."""
    starts: tuple[float, ...] = ()
    """Further values from which a fit is started, where the way to the best one is not straight."""
    meaning: str = ""


@dataclass(frozen=True)
class Effect:
    """One term that can be added to a model.

    The hooks are plain functions of numbers (arrays, or scalars in a compiled engine), parameters last:

    - ``force(vx, vy, gap, radius, mass, *p) -> (fx, fy)`` [N] on a sphere in flight or on a thread; `gap` [m] is the
      height of its lowest point above the plate.
    - ``torque(angle, rate, length, mass, *p)`` [N m] about a pivot.
    - ``restitution(e, speed, radius, mass, *p)``: the coefficient at an impact `speed` [m/s], from the one at 1 m/s.
    - ``rolling(mu, speed, radius, *p)``: the rolling friction (tangent of the angle) at a speed.
    - ``sliding(mu, speed, waiting, *p)``: the sliding friction while it slides.
    - ``onset(mu, waiting, normal, *p)``: the friction at which sliding starts; `waiting` [s], `normal` [N].
    - ``attraction(overlap, radius, modulus, *p)`` [N]: the pull of two bodies in contact, `radius` [m] and `modulus`
      [Pa] the effective ones; with ``neck(radius, modulus, *p)`` [m] it lasts until they are so far apart.
    - ``exposure(time, x, y, *p)``: the true time [s] at which a row stamped `time` was taken.
    - ``view(x, y, *p) -> (x, y)`` [m]: where the camera sees what is at x, y.
    - ``drive(time, place, speed, *p)`` [m/s^2] along the path of a body that is held on one, a bob's arc or a track:
      `time` [s] on the clock of the record, `place` [m] along the path.  Only the diagnosis's own formulas have it.
    """

    name: str
    title: str
    kind: Literal["physical", "measurement"]
    rigs: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    equation: str
    source: str
    synonyms: tuple[str, ...] = ()
    family: str = ""
    """Effects of one family are forms of one thing: told apart only where the data can."""
    force: Hook | None = None
    torque: Hook | None = None
    restitution: Hook | None = None
    rolling: Hook | None = None
    sliding: Hook | None = None
    onset: Hook | None = None
    attraction: Hook | None = None
    neck: Hook | None = None
    exposure: Hook | None = None
    view: Hook | None = None
    drive: Hook | None = None
    geometry: str = ""
    """Name of the rig's own quantity that the first parameter shifts: ``"level"``, ``"length"``, ``"release_spin"``,
    ``"rod_mass"``, ``"release_speed"``, ``"jitter"``, ``"scatter"``."""
    splits: str = ""
    """The experiment that tells this effect from those that look alike."""

    aimed: bool = False
    """Whether its force in flight or its torque on a thread pushes to a side of its own, towards positive x for a
    positive number, whichever way the bead moves."""
    steep: bool = False
    """Whether its force on a bead in flight changes much within a radius of the plate."""
    edges: Hook | None = None
    """``edges(*p) -> (lowest, width)`` [m] of a force on a bead in flight that sets in or ends anywhere on it: the
    height of its lowest edge, and the length within which it grows by a factor e there."""
    flat: bool = False
    """Whether the effect has no slope at zero, so that a fit from there would stay there."""

    even: bool = False
    """Whether the sign of its first parameter says nothing: a fit that ends below zero means the same above."""

    special: bool = False
    """Whether it takes what not every lab has, so that it is named only where the data speak for it clearly before the
    plain forms of its family; where they explain the data nearly as well, they are told beside it."""

    @property
    def group(self) -> str:
        """The family, or the name where there is none."""
        return self.family or self.name
