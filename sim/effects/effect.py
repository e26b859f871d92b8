"""The types `Effect` and `Parameter`: names, equation, source, parameters, rigs and hook functions of an effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

Hook = Callable[..., Any]
WIDENING = ("jitter", "scatter")
"""Values of `Effect.geometry` that shift no position and only increase the noise."""
RIGS = ("drop", "pendulum", "double", "slide", "roll")


@dataclass(frozen=True)
class Parameter:
    """One coefficient of an effect, in SI units.

    Attributes
    ----------
    name, unit : str
        Name as used in a model file, and SI unit ("1" for a dimensionless coefficient).
    low, high : float
        Limits of the physical values.
    typical : float
        A value whose influence is clearly visible; sets the step of the fit.
    predicted : float, optional
        Value that theory predicts without a fit.
    least : float
        Size that occurs in every lab; smaller ones are reported from ten standard deviations on.
    assumed : tuple of float, optional
        Prior mean and standard deviation of a nuisance parameter, which belongs to the effect but does not measure its
        strength.
    stated : callable, optional
        ``stated(bead, wall) -> value`` computes the parameter from the entries of a bead and a wall in lab.json; if
        an entry is missing the value is `assumed`.
    starts : tuple of float
        Further starting values of the fit, for effects with several local minima.
    bounded : bool
        Whether a fit stays within `low` and `high`; others may leave them, so that an impossible value is found and
        refused.
    meaning : str
        What the coefficient is, for the reader of a report.

    Examples
    --------
    >>> from rigtwin.sim.effects import Parameter
    >>> Parameter("work", "J", 0.0, 1e-4, 1e-7, meaning="energy lost per impact").high
    0.0001
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    predicted: float | None = None
    least: float = 0.0
    assumed: tuple[float, float] | None = None
    stated: Callable[[Mapping[str, Any], Mapping[str, Any]], float] | None = None
    starts: tuple[float, ...] = ()
    bounded: bool = False
    meaning: str = ""


@dataclass(frozen=True)
class Effect:
    """One term that can be added to a model of a rig or of its camera.

    Attributes
    ----------
    name : str
        Name in model files and reports.
    title : str
        Name in prose.
    kind : {"physical", "measurement"}
        Whether the effect changes the motion or only its record.
    rigs : tuple of str
        Rigs of the diagnosis in which the effect acts, from `RIGS`.
    parameters : tuple of Parameter
        The coefficients; the first one measures the strength.
    equation, source : str
        Formula and literature.
    synonyms : tuple of str
        Other names.
    family : str
        Name shared by alternative forms of one mechanism; they are distinguished only where the data can.
    force, sideways, torque, mutual, restitution, rolling, sliding, onset, attraction, neck, exposure, view, drive : \
            callable, optional
        Hook functions, see Notes.
    geometry : str
        Name of the quantity of the rig that the first parameter shifts: ``"level"``, ``"length"``,
        ``"lengths"``, ``"release_spin"``, ``"rod_mass"``, ``"stretch"``, ``"creep"``, ``"release_speed"``,
        ``"tilt_rate"``, ``"surface_slope"``, ``"surface_direction"``, ``"jitter"``, ``"scatter"``.
    splits : str
        Experiment that separates this effect from similar ones.
    aimed : bool
        Whether the force in flight, or the torque on a thread, has a fixed direction (towards positive x for a
        positive coefficient), whichever way the bead moves.
    steep : bool
        Whether the force on a bead in flight changes considerably within one radius of the plate.
    slow : bool
        Whether a fall may last many times as long as one without the effect.
    edges : callable, optional
        ``edges(*p) -> (lowest, width)`` [m] of a force in flight that starts or ends at a height: the height of its
        lowest edge, and the length over which the force grows by a factor e there.
    flat : bool
        Whether a fit that starts with zero for the first parameter stays there: its derivative is zero there, or so
        large for the slowest impacts that it hides the others.
    even : bool
        Whether the sign of the first parameter has no influence: a fit that ends below zero means its absolute value.
    special : bool
        Whether the effect needs a setup that not every lab has.  It is reported only where the data prefer it clearly
        to the plain forms of its family; where those explain the data nearly as well, they are named beside it.
    free : bool
        Whether the effect is a plain form of its family with a free exponent, or with a further dependence.  It is
        reported only where the data prefer it clearly, and is never another name beside the plain form.

    Notes
    -----
    The hooks are plain functions of numbers (arrays, or scalars in a compiled engine), with the parameters last:

    - ``force(vx, vy, gap, radius, mass, *p) -> (fx, fy)`` [N] on a sphere in flight or on a thread; `gap` [m] is the
      height of its lowest point above the plate.
    - ``sideways(x, radius, mass, *p)`` [N]: horizontal force on a sphere in flight at the place `x` [m] in the picture.
      Only the drops of the diagnosis have it.
    - ``torque(angle, rate, length, mass, *p)`` [N m] about a pivot.
    - ``mutual(distance, radius, mass, *p)`` [N]: force by which two equal beads push each other apart, from the
      `distance` [m] of their centres.  Only the double pendulum of the diagnosis has it.
    - ``restitution(e, speed, radius, mass, *p)``: coefficient at an impact `speed` [m/s], from its value at 1 m/s.
    - ``rolling(mu, speed, radius, *p)``: rolling friction (tangent of the angle) at a speed.
    - ``sliding(mu, speed, waiting, *p)``: kinetic friction coefficient.
    - ``onset(mu, waiting, normal, *p)``: friction coefficient at which sliding starts; `waiting` [s], `normal` [N].
    - ``attraction(overlap, radius, modulus, *p)`` [N]: attractive force of two bodies in contact, with the effective
      `radius` [m] and `modulus` [Pa]; ``neck(radius, modulus, *p)`` [m] is the distance at which it ends.
    - ``exposure(time, x, y, *p)``: true time [s] of a row with the time stamp `time`.
    - ``view(x, y, *p) -> (x, y)`` [m]: position at which the camera sees a point at x, y.
    - ``drive(time, place, speed, *p)`` [m/s^2] along the path of a guided body, a bob's arc or a track: `time` [s] on
      the clock of the record, `place` [m] along the path.  Only the formulas of the diagnosis have it.

    Examples
    --------
    >>> from rigtwin.sim.effects import named
    >>> named("air_drag").equation
    'F = rho_air C_D pi R^2 v^2 / 2'
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
    force: Hook | None = None
    sideways: Hook | None = None
    torque: Hook | None = None
    mutual: Hook | None = None
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
    splits: str = ""
    aimed: bool = False
    steep: bool = False
    slow: bool = False
    edges: Hook | None = None
    flat: bool = False
    even: bool = False
    special: bool = False
    free: bool = False

    @property
    def group(self) -> str:
        """The family, or the name where there is none."""
        return self.family or self.name
