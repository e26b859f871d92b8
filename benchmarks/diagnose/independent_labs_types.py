"""Parts of the independent labs: spheres, conditions, chance, hidden laws and recorded motions.

The labs of `independent_labs` put the diagnosis to the test with physics that shares no code with it: nothing of
`rigtwin.sim`, `rigtwin.compare` or `lab_motion` is used here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Rng = np.random.Generator

GRAVITY = 9.81  # [m/s^2]
FREE = math.inf  # standard deviation of what the experimenter does not know
PRECISE: dict[str, Any] = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-11, "dense_output": True}


@dataclass(frozen=True)
class Sphere:
    """A bead as it is stated."""

    name: str
    material: str
    diameter: float  # [m]
    density: float  # [kg/m^3]
    youngs_modulus: float  # [Pa]
    poissons_ratio: float
    restitution: float  # typical, on a hard plate

    @property
    def radius(self) -> float:
        return self.diameter / 2

    @property
    def volume(self) -> float:
        return math.pi / 6 * self.diameter**3

    @property
    def mass(self) -> float:
        return self.density * self.volume

    @property
    def section(self) -> float:
        return math.pi / 4 * self.diameter**2


@dataclass(frozen=True)
class Chance:
    """A number that differs from what is stated: in the whole lab, in a group of runs, or in every run."""

    name: str
    scope: str  # "lab", "run", "condition", or a key of `Condition.groups`
    spread: float  # standard deviation of the real deviation
    known: float = math.nan  # what the experimenter knows: standard deviation; as `spread` where left out
    step: float = 1e-5  # of a numerical derivative
    uniform: bool = False  # drawn from 0 to `spread`

    @property
    def prior(self) -> float:
        return self.spread if math.isnan(self.known) else self.known

    def draw(self, rng: Rng) -> float:
        """A deviation, never further off than two standard deviations."""
        if self.uniform:
            return float(rng.uniform(0, self.spread))
        return float(np.clip(rng.normal(0, self.spread), -2 * self.spread, 2 * self.spread)) if self.spread else 0.0


@dataclass(frozen=True)
class Condition:
    """One setting of the rig."""

    stated: dict[str, Any]  # its entries in lab.json
    sphere: Sphere
    repetitions: int
    nominal: Mapping[str, float]  # settings in SI, and true numbers that are not stated
    groups: Mapping[str, str] = field(default_factory=dict)  # which runs share a deviation


@dataclass(frozen=True)
class Hidden:
    """What a lab hides: deviations of its numbers, and laws in place of the simple ones."""

    shifts: Mapping[str, float] = field(default_factory=dict)
    force: Callable[[float, Array, Sphere], tuple[float, float]] | None = None
    """(time [s], (x, y, vx, vy), sphere) -> force [N] on a bead in flight."""
    added_mass: Callable[[Sphere], float] | None = None  # [kg]
    bounce: Callable[[float, float, Sphere], float] | None = None
    """(plain restitution, impact speed [m/s], sphere) -> restitution."""
    torque: Callable[[float, float, float, float, Sphere], float] | None = None
    """(time, angle, rate, length, sphere) -> moment [N m] about the pivot."""
    thread: Callable[[float, float, float], float] | None = None
    """(time [s], length [m], tension [N]) -> length [m]."""
    support: Callable[[float], tuple[float, float]] | None = None
    """Time [s] -> place [m] and acceleration [m/s^2] of the pivot, sideways."""
    friction: Callable[[float, Slip], float] | None = None
    """(plain friction, how things stand) -> friction of a clump."""
    rolling: Callable[[float, Rolling], float] | None = None
    """(plain rolling friction, how things stand) -> rolling friction of a bead."""
    along: Callable[[float, float, float, Condition], float] | None = None
    """(time, place, speed, condition) -> force per mass [m/s^2] along a track, down it positive."""
    apart: Callable[[float, Sphere], float] | None = None
    """(distance of two centres [m], sphere) -> force [N] that pushes them apart."""
    view: Callable[[Array, Array, Array], tuple[Array, Array]] | None = None
    """(time [s], x, y [m]) -> where the camera sees the point."""
    shutter: float = 0.0  # [s/m], how much later each metre of height is read


@dataclass(frozen=True)
class Slip:
    """A clump on the arm."""

    waited: float  # [s], at rest
    load: float  # [N], normal to the arm
    speed: float  # [m/s]
    place: float  # [m] from the hinge
    time: float  # [s]


@dataclass(frozen=True)
class Rolling:
    """A bead on a track."""

    speed: float  # [m/s]
    load: float  # [N]
    place: float  # [m] along the track
    sphere: Sphere
    turned: bool  # the surface lies the other way round
    way: float  # 1 to the right, -1 to the left


def combined(parts: Sequence[Hidden]) -> Hidden:
    """Several hidden things at once; of each kind of law but forces, moments and shifts only one may have it."""
    shifts: dict[str, float] = {}
    for part in parts:
        for name, value in part.shifts.items():
            shifts[name] = shifts.get(name, 0.0) + value
    forces = [part.force for part in parts if part.force]
    torques = [part.torque for part in parts if part.torque]
    laws: dict[str, Any] = {}
    for name in ("added_mass", "bounce", "thread", "support", "friction", "rolling", "along", "apart", "view"):
        laws[name] = next((law for part in parts if (law := getattr(part, name))), None)

    def force(t: float, state: Array, sphere: Sphere) -> tuple[float, float]:
        both = [one(t, state, sphere) for one in forces]
        return sum(f[0] for f in both), sum(f[1] for f in both)

    def torque(t: float, angle: float, rate: float, length: float, sphere: Sphere) -> float:
        return sum(one(t, angle, rate, length, sphere) for one in torques)

    return Hidden(
        shifts, force if forces else None, torque=torque if torques else None,
        shutter=sum(part.shutter for part in parts), **laws,
    )  # fmt: skip


class Motion:
    """Where each body was: pieces of a path, one after the other."""

    def __init__(self) -> None:
        self.starts: list[float] = []
        self.pieces: list[Callable[[Array], Array]] = []
        self.end = 0.0

    def add(self, start: float, end: float, piece: Callable[[Array], Array]) -> None:
        """`piece`: times, shape (k,) -> coordinates x, y of each body in turn, shape (2 * bodies, k)."""
        self.starts.append(start)
        self.pieces.append(piece)
        self.end = end

    def piece(self, times: Array) -> npt.NDArray[np.intp]:
        """Which piece each time is in."""
        return np.maximum(np.searchsorted(self.starts, times, side="right") - 1, 0)

    def at(self, times: Array) -> Array:
        which = self.piece(times)
        used = [(np.flatnonzero(which == k), k) for k in np.unique(which)]
        found = [(rows, self.pieces[k](times[rows])) for rows, k in used]
        out = np.empty((found[0][1].shape[0], len(times)))
        for rows, values in found:
            out[:, rows] = values
        return out


def still(*coordinates: float) -> Callable[[Array], Array]:
    """Bodies at rest."""
    place = np.array(coordinates)[:, None]
    return lambda t: np.repeat(place, len(t), axis=1)


@dataclass(frozen=True)
class Lab:
    """One rig with its conditions, before anything is filmed."""

    rig: str
    spheres: tuple[Sphere, ...]
    conditions: tuple[Condition, ...]
    chances: tuple[Chance, ...]
    move: Callable[[Condition, Mapping[str, float], Hidden], Motion]
    frame_rate: float  # [Hz]
    scale: float  # [m/px]
    noise: float  # [px]
    geometry: dict[str, Any]
    coordinates: str
    walls: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


Sized = Callable[[float], Hidden]
Make = Callable[[Rng, Lab], Sized]
"""A law draws its constants for a lab and gives what is hidden by its size; 1 is what a real lab may have."""
