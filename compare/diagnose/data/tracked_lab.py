"""A lab ready for diagnosis: beads, camera, conditions with their tracks, and access to the stated values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.compare.twins.registry import ENTRIES
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.records import Track
from rigtwin.lab.spelling import near
from rigtwin.lab.units import LONGEST
from rigtwin.sim.effects.effect import Effect, Parameter

TRACKED = ("drop", "pendulum", "double", "slide", "roll")

BULK = tuple(name for name, entry in ENTRIES.items() if entry.many_particles)

FEWEST = 5  # smallest number of repetitions in a lab for a diagnosis

PLATE = ("thickness_m", "density_kg_m3", "youngs_modulus_Pa", "poissons_ratio")

EXACT = 1e-3  # share of the default standard uncertainty used where zero is stated; a fit needs a positive value

BEYOND = 30.0  # stated length over the extent of the tracks, above which it is taken to be in millimetres

OTHER_RATE = 0.1  # relative difference of rates above which a warning is given; times rounded to 1 ms turn 240 into 250

EARLY = 0.2  # [s], latest first row of a clock that starts with the film, with a margin for lost frames


@dataclass(frozen=True)
class Bead:
    """One kind of bead with its stated properties."""

    name: str
    diameter: float  # [m]
    mass: float  # [kg]
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def radius(self) -> float:
        return self.diameter / 2

    @property
    def density(self) -> float:
        """[kg/m^3], of a sphere of this size and mass."""
        return self.mass / (math.pi / 6 * self.diameter**3)


@dataclass(frozen=True)
class Camera:
    """The stated camera with its standard uncertainties."""

    frame_rate: float  # [1/s]
    noise: float  # [m], one standard deviation of a tracked coordinate; NaN where not stated
    scale_rel: float = 0.002
    clock_rel: float = 1e-4
    roll: float = math.radians(0.15)  # [rad]


@dataclass(frozen=True)
class Condition:
    """One setting of the rig with its repetitions."""

    name: str
    bead: Bead
    wall: str
    settings: Mapping[str, Any]
    repetitions: tuple[tuple[Track, ...], ...]
    files: tuple[str, ...] = ()


@dataclass(frozen=True)
class TrackedLab:
    """A lab ready for diagnosis."""

    title: str
    rig: str
    gravity: float  # [m/s^2]
    camera: Camera
    geometry: Mapping[str, Any]
    conditions: tuple[Condition, ...]
    folder: Path
    stated: Mapping[str, Any] = field(default_factory=dict)
    """The whole document as in the file."""
    overlooked: tuple[str, ...] = ()
    """Warnings: unread keys and files that look like known ones, and stated frame rates that the tracks contradict."""

    @property
    def repetitions(self) -> int:
        return sum(len(condition.repetitions) for condition in self.conditions)

    def setting(self, name: str, default: float | None = None) -> list[float]:
        """A number that each condition states, one per repetition.

        Raises `BadLabFile` if it is missing, or if a length is implausible and far larger than the tracks.
        """
        values = []
        for condition in self.conditions:
            value, place = condition.settings.get(name, default), f"{self.folder / 'lab.json'}: condition"
            if not is_number(value):
                meant = "" if name in condition.settings else near(name, condition.settings)
                hint = f"; was {meant} meant?" if meant else "."
                raise BadLabFile(f"{place} {condition.name}: {name}: is missing or not a number{hint}")
            if name.endswith("_m") and value > LONGEST and value > BEYOND * _furthest(condition):
                raise BadLabFile(f"{place} {condition.name}: {name}: {value:g} is in metres; was it meant in mm?")
            values += [float(value)] * len(condition.repetitions)
        return values

    def stated_for(self, condition: Condition, parameter: Parameter) -> float | None:
        """The stated value of a parameter for the bead and the wall of a condition, or None."""
        if parameter.stated is None:
            return None
        key = parameter.stated, condition.bead.name, condition.wall
        if key not in self._known:
            self._known[key] = self._stated(condition, parameter, parameter.stated)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[Any, str, str], float | None]:
        """Cache of `stated_for`, which a fit calls at every step."""
        return {}

    def _stated(self, condition: Condition, parameter: Parameter, rule: Callable[..., float]) -> float | None:
        walls = self.stated.get("walls")
        wall = walls.get(condition.wall) if isinstance(walls, Mapping) else None
        if not isinstance(wall, Mapping):
            return None
        try:
            value = rule(condition.bead.about, wall)
        except (KeyError, TypeError, ZeroDivisionError):
            return None
        return value if isinstance(value, float) and parameter.low < value <= parameter.high else None

    def alike(self, one: str, other: str) -> bool:
        """Whether two walls are stated to have the same material and different thickness.

        False where the lab does not state all properties of both walls.
        """
        walls = self.stated.get("walls")
        if not isinstance(walls, Mapping) or not isinstance(walls.get(one), Mapping):
            return False
        here, there = walls[one], walls.get(other)
        if not isinstance(there, Mapping) or not all(
            is_number(wall.get(key)) for wall in (here, there) for key in PLATE
        ):
            return False
        return all((here[key] == there[key]) != (key == "thickness_m") for key in PLATE)

    def assumed(self, effects: Sequence[Effect]) -> Iterator[str]:
        """One sentence for each parameter that is stated for some beads and walls and assumed for the others."""
        for effect in effects:
            for parameter in effect.parameters:
                stated = {(c.bead.name, c.wall): self.stated_for(c, parameter) for c in self.conditions}
                lacking = [f"{bead} on {wall}" for (bead, wall), value in stated.items() if value is None]
                if parameter.assumed is not None and 0 < len(lacking) < len(stated):
                    yield (
                        f"{effect.title}: too little is stated of {', '.join(lacking)}; {parameter.name} = "
                        f"{parameter.assumed[0]:g} is assumed there"
                    )

    def on_wall(self, name: str, wall: str, *, default: float) -> float:
        """A number of the rig's geometry, stated once or in a table of the walls; `default` if it is not stated."""
        value = self.geometry.get(name)
        if isinstance(value, Mapping):
            value = value.get(wall)
        if value is None:
            return default
        if not is_number(value) or value < 0:
            raise BadLabFile(
                f"{self.folder / 'lab.json'}: rig_geometry: {name}: {value!r} is not a number of at least 0; state "
                "one, or a table with one for each wall."
            )
        return float(value)

    def uncertainty(self, name: str, *, default: float) -> float:
        """Standard uncertainty that the rig's geometry states under this name, else the default; never zero."""
        return stated_uncertainty(self.geometry, name, default)


def stated_uncertainty(table: Mapping[str, Any], name: str, default: float) -> float:
    """A stated standard uncertainty, or the default if the table states none.

    Zero means exactly known; it is replaced by a small positive value that a fit can use.
    """
    value = table.get(name, default)
    if not is_number(value):
        raise BadLabFile(f"{name}: {value!r} is not a number; state a standard uncertainty in the unit of the name.")
    return max(float(value), EXACT * default)


def on_the_bench(rig: str, repetition: tuple[Track, ...]) -> tuple[Track, ...]:
    """A repetition as the models expect it: the released one of two beads first, and a clock that starts near zero.

    The released bead is the one that starts furthest from the middle, whatever the order in the file.  The clock of a
    tilting arm is kept, because the stated angle belongs to time zero.
    """
    if rig == "double":
        repetition = tuple(sorted(repetition, key=lambda track: -abs(start_of(track))))
    begin = min(float(track.time[0]) for track in repetition)
    if rig == "slide" or 0 <= begin < EARLY:
        return repetition
    return tuple(replace(track, time=track.time - begin) for track in repetition)


def need_repetitions(folder: Path, there: int, still: int = 0, failed: int = 0) -> None:
    """Raise `BadInput` if a lab has too few repetitions, not counting `still` ones without motion and `failed` ones."""
    if there < FEWEST:
        more = f", {still} more in which nothing moved" if still else ""
        more += f", {failed} more could not be measured" if failed else ""
        raise BadInput(
            f"{folder}: {there} repetition{'' if there == 1 else 's'} in all{more}; at least {FEWEST} are needed to "
            "separate an effect from scatter."
        )


def start_of(track: Track) -> float:
    """x [m] of a bead before its release."""
    return float(np.median(track.position[:5, 0]))


def other_rates(conditions: Sequence[Condition], stated: Sequence[float | None]) -> Iterator[str]:
    """A warning for each condition whose rows contradict the stated frame rate [1/s]; the times are kept."""
    for condition, rate in zip(conditions, stated, strict=True):
        steps = [float(np.median(np.diff(track.time))) for each in condition.repetitions for track in each]
        found = 1 / float(np.median(steps))
        if rate is not None and abs(math.log(found / rate)) > OTHER_RATE:
            yield (
                f"condition {condition.name}: a frame rate of {rate:g} Hz is stated, but its tracks have {found:.4g} "
                "rows a second; time_s is used: if the stated rate is right, all times are wrong by that factor"
            )


def _furthest(condition: Condition) -> float:
    """Largest coordinate [m] of any track of the condition."""
    return max(furthest_of(track) for repetition in condition.repetitions for track in repetition)


def furthest_of(track: Track) -> float:
    return float(np.max(np.abs(track.position)))


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
