"""Reads a lab for diagnosis: tracked repetitions and all that the experimenter knows, stated uncertainties included.

Two forms: a folder with a `lab.json` (conditions, stated uncertainties, one CSV per repetition), or a `lab.toml`
whose repetitions are CSV already tracked.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.errors import BadLabFile
from rigtwin.lab.records import Track, read_tracks
from rigtwin.lab.units import LONGEST
from rigtwin.sim.effects.effect import Effect, Parameter

LARGEST_BEAD = 0.5  # [m]
TRACKED = ("drop", "pendulum", "double", "slide", "roll")
BULK = ("pile", "hopper", "drum")
OPTIONAL = (
    "scale_m_per_px", "tracking_noise_px", "tracking_noise_m", "scale_uncertainty_rel", "frame_rate_uncertainty_rel",
    "roll_uncertainty_deg", "drop_height_uncertainty_m", "length_uncertainty_m", "release_angle_uncertainty_deg",
    "plate_level_uncertainty_deg", "tilt_rate_uncertainty_rel", "incline_angle_uncertainty_deg",
    "pivot_spacing_uncertainty_m", "release_sideways_speed_m_s", "sliding_friction_pw", "diameter_uncertainty_m",
    "gravity_m_s2", "material", "wall", "push_speed_m_s", "incline_angle_deg", "start_angle_deg", "waiting_time_s",
    "clump_mass_g", "mass_g", "mass_kg", "density_kg_m3", "rig_geometry", "camera", "walls",
    "thickness_m", "youngs_modulus_Pa", "poissons_ratio",
)  # fmt: skip
"""Keys that have a default: misspelt, they would be missing without a word."""
PLATE = ("thickness_m", "density_kg_m3", "youngs_modulus_Pa", "poissons_ratio")
ALIKE = 0.9  # of two spellings, as difflib tells it


@dataclass(frozen=True)
class Bead:
    """One kind of bead: what the experimenter knows of it."""

    name: str
    diameter: float  # [m]
    mass: float  # [kg]
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def radius(self) -> float:
        return self.diameter / 2


@dataclass(frozen=True)
class Camera:
    """The stated camera and how well it is known; standard uncertainties."""

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
    """The whole document as it stands in the file."""
    misspelt: tuple[str, ...] = ()
    """Keys that are not read and look like one that would be, each with the one that it looks like."""

    @property
    def repetitions(self) -> int:
        return sum(len(condition.repetitions) for condition in self.conditions)

    def setting(self, name: str, default: float | None = None) -> list[float]:
        """A number that each condition states, one per repetition.

        Raises `BadLabFile` where it is missing, or a length that fits on no bench.
        """
        values = []
        for condition in self.conditions:
            value, place = condition.settings.get(name, default), f"{self.folder / 'lab.json'}: condition"
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise BadLabFile(f"{place} {condition.name}: {name}: is missing or not a number.")
            if name.endswith("_m") and value > LONGEST:
                raise BadLabFile(f"{place} {condition.name}: {name}: {value:g} is in metres; was it meant in mm?")
            values += [float(value)] * len(condition.repetitions)
        return values

    def stated_for(self, condition: Condition, parameter: Parameter) -> float | None:
        """What the lab states of a parameter for the bead and the wall of a condition; None where it does not."""
        if parameter.stated is None:
            return None
        key = parameter.stated, condition.bead.name, condition.wall
        if key not in self._known:
            self._known[key] = self._stated(condition, parameter, parameter.stated)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[Any, str, str], float | None]:
        """What was worked out before: a fit asks for it at every step."""
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
        """Whether the lab states of two walls that they are of one material and of another thickness.

        Walls of which it says less may be of anything.
        """
        walls = self.stated.get("walls")
        if not isinstance(walls, Mapping) or not isinstance(walls.get(one), Mapping):
            return False
        here, there = walls[one], walls.get(other)
        if not isinstance(there, Mapping) or not all(
            _is_number(wall.get(key)) for wall in (here, there) for key in PLATE
        ):
            return False
        return all((here[key] == there[key]) != (key == "thickness_m") for key in PLATE)

    def assumed(self, effects: Sequence[Effect]) -> Iterator[str]:
        """Which beads and walls have to do with an assumed value where the lab states it of others."""
        for effect in effects:
            for parameter in effect.parameters:
                stated = {(c.bead.name, c.wall): self.stated_for(c, parameter) for c in self.conditions}
                lacking = [f"{bead} on {wall}" for (bead, wall), value in stated.items() if value is None]
                if parameter.assumed is not None and 0 < len(lacking) < len(stated):
                    yield (
                        f"{effect.title}: too little is stated of {', '.join(lacking)}; {parameter.assumed[0]:g} is "
                        f"taken for {parameter.name} there"
                    )

    def known(self, *names: str, default: float) -> float:
        """The first of the geometry's numbers of these names, else the default."""
        for name in names:
            value = self.geometry.get(name)
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                return float(value)
        return default


def read_tracked_lab(path: Path) -> TrackedLab:
    """Read the lab.json of a folder.  Raises `BadLabFile` in one sentence."""
    file = path / "lab.json" if path.is_dir() else path
    document = _document(file)
    rig = _text(document, "rig", file)
    if rig not in (*TRACKED, *BULK):
        raise BadLabFile(f"{file}: rig: there is no rig {rig!r}; known are {', '.join((*TRACKED, *BULK))}.")
    raw_conditions = document.get("conditions")
    if not isinstance(raw_conditions, list) or not raw_conditions:
        raise BadLabFile(f"{file}: conditions: is missing or empty; list one condition per setting of the rig.")
    gravity = _number({"gravity_m_s2": 9.81, **document}, "gravity_m_s2", file)
    camera = _camera(document, file, rig)
    conditions = () if rig in BULK else tuple(_condition(document, raw, file, rig) for raw in raw_conditions)
    geometry = document.get("rig_geometry") or {}
    if not isinstance(geometry, dict):
        raise BadLabFile(f"{file}: rig_geometry: is not a table of names and values.")
    return TrackedLab(
        title=str(document.get("case") or document.get("title") or file.parent.name),
        rig=rig,
        gravity=gravity,
        camera=camera,
        geometry=geometry,
        conditions=conditions,
        folder=file.parent,
        stated=document,
        misspelt=tuple(dict.fromkeys(_misspelt(document))),
    )


def _document(file: Path) -> dict[str, Any]:
    try:
        document = json.loads(file.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise BadLabFile(f"{file}: no such file; give a folder with a lab.json of tracked repetitions.") from None
    except OSError as error:
        raise BadLabFile(f"{file}: cannot be read ({error.strerror}); check the path and its permissions.") from None
    except UnicodeDecodeError:
        raise BadLabFile(f"{file}: is not UTF-8 text; save the file as UTF-8.") from None
    except (ValueError, RecursionError) as error:
        raise BadLabFile(f"{file}: is not valid JSON ({error}); correct it there.") from None
    if not isinstance(document, dict):
        raise BadLabFile(f"{file}: holds no table of names and values; write it as docs/tracked_lab.md shows.")
    _sane(document, "", file)
    return document


def _sane(value: Any, key: str, file: Path) -> None:
    """Refuse numbers anywhere in the document that nothing in a lab can have."""
    if isinstance(value, dict):
        for name, entry in value.items():
            _sane(entry, str(name), file)
    elif isinstance(value, list):
        for entry in value:
            _sane(entry, key, file)
    elif isinstance(value, float) and not math.isfinite(value):
        raise BadLabFile(f"{file}: {key}: {value!r} is no number that was measured; leave it out where it is unknown.")
    elif isinstance(value, (int, float)) and value < 0 and ("uncertainty" in key or "noise" in key):
        raise BadLabFile(f"{file}: {key}: {value!r} cannot be; an uncertainty is not below zero.")


def _misspelt(table: Any) -> Iterator[str]:
    """Whatever the document says beside is its own business, but nearly a key's name is hardly meant as a remark."""
    if isinstance(table, list):
        for entry in table:
            yield from _misspelt(entry)
    elif isinstance(table, dict):
        for key, value in table.items():
            meant = get_close_matches(key, OPTIONAL, n=1, cutoff=ALIKE)
            if meant and key not in OPTIONAL and meant[0] not in table and isinstance(value, (int, float, dict)):
                yield f"{key}: is not read; was {meant[0]} meant? Its default stands"
            yield from _misspelt(value)


def _camera(document: Mapping[str, Any], file: Path, rig: str) -> Camera:
    raw = document.get("camera") or {}
    if not isinstance(raw, dict):
        raise BadLabFile(f"{file}: camera: is not a table of names and values.")
    if rig in BULK:
        return Camera(_number(raw, "frame_rate_hz", file, default=240.0), math.nan)
    scale = _number(raw, "scale_m_per_px", file, default=math.nan)
    noise = _number(raw, "tracking_noise_px", file, default=math.nan) * scale
    return Camera(
        frame_rate=_number(raw, "frame_rate_hz", file),
        noise=_number(raw, "tracking_noise_m", file, default=noise),
        scale_rel=_number(raw, "scale_uncertainty_rel", file, default=0.002),
        clock_rel=_number(raw, "frame_rate_uncertainty_rel", file, default=1e-4),
        roll=math.radians(_number(raw, "roll_uncertainty_deg", file, default=0.15)),
    )


def _condition(document: Mapping[str, Any], raw: Any, file: Path, rig: str) -> Condition:
    if not isinstance(raw, dict):
        raise BadLabFile(f"{file}: conditions: each must be a table with a name.")
    name = _text(raw, "name", file)
    bead = _bead(document, raw, file, name)
    count = raw.get("repetitions", 0)
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise BadLabFile(f"{file}: condition {name}: repetitions: {count!r} is not a whole number of at least 1.")
    pattern = str(raw.get("files") or f"{name}/rep%02d.csv")
    try:
        files = [pattern % number for number in range(1, count + 1)]
    except (TypeError, ValueError):
        raise BadLabFile(
            f"{file}: condition {name}: files: {pattern!r} holds no place for a number; write 'rep%02d.csv'."
        ) from None
    tracks = tuple(read_tracks(file.parent / one) for one in files)
    for one, repetition in zip(files, tracks, strict=True):
        _check(repetition, file.parent / one, rig)
    settings = {key: value for key, value in raw.items() if key not in ("name", "files", "repetitions")}
    return Condition(name, bead, str(raw.get("wall", "")), settings, tracks, tuple(files))


def _check(repetition: tuple[Track, ...], path: Path, rig: str) -> None:
    needed = 2 if rig == "double" else 1
    if len(repetition) != needed:
        found = ", ".join(track.body for track in repetition)
        raise BadLabFile(f"{path}: {len(repetition)} bodies ({found}) where a {rig} has {needed}.")
    for track in repetition:
        if len(track.time) < 20:
            raise BadLabFile(f"{path}: only {len(track.time)} rows; at least 20 are needed to see a motion.")
        if float(np.max(np.abs(track.position))) > 100:
            raise BadLabFile(f"{path}: a position is more than 100 m from the origin; are the columns in metres?")


def _bead(document: Mapping[str, Any], raw: Mapping[str, Any], file: Path, where: str) -> Bead:
    particles = document.get("particles")
    if not isinstance(particles, dict) or not particles:
        raise BadLabFile(f"{file}: particles: is missing or empty; describe each bead there.")
    wanted = next((raw[key] for key in ("bead", "particle", "clump", "sphere") if key in raw), None)
    if wanted is None and len(particles) == 1:
        wanted = next(iter(particles))
    if "diameter_m" in particles and wanted is None:
        wanted, particles = "bead", {"bead": particles}
    about = particles.get(wanted) if isinstance(wanted, str) else None
    if not isinstance(about, dict):
        known = ", ".join(map(str, particles))
        raise BadLabFile(f"{file}: condition {where}: bead {wanted!r} is not under particles (known: {known}).")
    diameter = _number(about, "diameter_m", file, default=math.nan)
    if diameter > LARGEST_BEAD:
        raise BadLabFile(f"{file}: particles: {wanted}: diameter_m: {diameter:g} is in metres; was it meant in mm?")
    mass = _number(about, "mass_g", file, default=math.nan) * 1e-3
    density = _number(about, "density_kg_m3", file, default=math.nan)
    mass = mass if math.isfinite(mass) else _number(about, "mass_kg", file, default=math.nan)
    if not math.isfinite(mass):
        mass = density * math.pi / 6 * diameter**3
    if not (diameter > 0 and mass > 0):
        raise BadLabFile(f"{file}: particles: {wanted}: needs diameter_m and mass_g (or density_kg_m3) above zero.")
    return Bead(str(wanted), diameter, mass, about)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _text(table: Mapping[str, Any], key: str, file: Path) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise BadLabFile(f"{file}: {key}: is missing or not a text.")
    return value


def _number(table: Mapping[str, Any], key: str, file: Path, *, default: float | None = None) -> float:
    value = table.get(key, default)
    if value is None:
        raise BadLabFile(f"{file}: {key}: is missing; state it as a number.")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise BadLabFile(f"{file}: {key}: {value!r} is not a number.")
    if default is None and not value > 0:
        raise BadLabFile(f"{file}: {key}: {value!r} cannot be; it must be above zero.")
    return float(value)
