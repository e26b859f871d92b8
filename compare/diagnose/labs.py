"""Reads a lab for diagnosis: tracked repetitions and all that the experimenter knows, stated uncertainties included.

Two forms: a folder with a `lab.json` (conditions, stated uncertainties, one CSV per repetition), or a `lab.toml`
whose repetitions are CSV already tracked.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.content import copies
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.materials import no_bead_has
from rigtwin.lab.records import Track, read_tracks
from rigtwin.lab.units import LONGEST
from rigtwin.sim.effects.effect import Effect, Parameter

LARGEST_BEAD = 0.5  # [m]
TRACKED = ("drop", "pendulum", "double", "slide", "roll")
BULK = ("pile", "hopper", "drum")
FEWEST = 5  # repetitions in a lab, below which nothing is named
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
BEAD = ("bead", "particle", "clump", "sphere")  # keys of a condition that name its bead
PLATE = ("thickness_m", "density_kg_m3", "youngs_modulus_Pa", "poissons_ratio")
ALIKE = 0.9  # of two spellings, as difflib tells it
SETTINGS = (
    "drop_height_m", "length_m", "release_angle_deg", "tilt_rate_deg_s", "start_angle_deg", "waiting_time_s",
    "start_distance_m", "clump_mass_g", "incline_angle_deg", "push_speed_m_s",
)  # fmt: skip
"""Settings of a condition; what is the same in all of them may stand once, in rig_geometry."""
EXACT = 1e-3  # of the doubt taken where none is stated: what is known so well is as good as known exactly
DOUBTS = ("uncertainty", "noise", "sideways_speed")  # in the names of what cannot be below zero
RANGES = {  # smallest and largest that can be, neither of which is
    **dict.fromkeys(("drop_height_m", "length_m", "thickness_m", "youngs_modulus_Pa", "clump_mass_g"), (0.0, math.inf)),
    "poissons_ratio": (-1.0, 0.6),
    "release_angle_deg": (-180.0, 180.0),
    "gravity_m_s2": (0.0, 100.0),
}
TABLES = ("walls", "rig_geometry")
BEYOND = 30.0  # times as long as what is seen of a motion: 300 mm and what is seen of them are 1000 apart
FARTHEST, FASTEST = 100.0, 60.0  # [m] from the origin, and [m/s]: a fall from 180 m
LARGEST = 1e300  # of any number: what a float can hold
OTHER_RATE = 0.1  # relative: times rounded to the millisecond make 250 of 240 rows a second; another rate is a step
EARLY = 0.2  # [s], in which a clock that starts with the film has shown a row, some lost frames allowed for


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

    @property
    def density(self) -> float:
        """[kg/m^3] of a ball of this size and mass."""
        return self.mass / (math.pi / 6 * self.diameter**3)


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
    overlooked: tuple[str, ...] = ()
    """Keys and files that are not read and look like ones that would be, and stated rates that tracks do not have."""

    @property
    def repetitions(self) -> int:
        return sum(len(condition.repetitions) for condition in self.conditions)

    def setting(self, name: str, default: float | None = None) -> list[float]:
        """A number that each condition states, one per repetition.

        Raises `BadLabFile` where it is missing, or a length that fits neither on a bench nor what its tracks show.
        """
        values = []
        for condition in self.conditions:
            value, place = condition.settings.get(name, default), f"{self.folder / 'lab.json'}: condition"
            if not _is_number(value):
                meant = [] if name in condition.settings else get_close_matches(name, condition.settings, n=1)
                hint = f"; was {meant[0]} meant to be it?" if meant else "."
                raise BadLabFile(f"{place} {condition.name}: {name}: is missing or not a number{hint}")
            if name.endswith("_m") and value > LONGEST and value > BEYOND * _furthest(condition):
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

    def on_wall(self, name: str, wall: str, *, default: float) -> float:
        """A number of the rig's geometry, stated once or in a table of the walls; the default where it is not."""
        value = self.geometry.get(name)
        if isinstance(value, Mapping):
            value = value.get(wall)
        if value is None:
            return default
        if not _is_number(value) or value < 0:
            raise BadLabFile(
                f"{self.folder / 'lab.json'}: rig_geometry: {name}: {value!r} is not a number of at least 0; state "
                "one, or a table with one for each wall."
            )
        return float(value)

    def doubt(self, name: str, *, default: float) -> float:
        """Standard uncertainty that the rig's geometry states under this name, else the default; never zero."""
        return stated_doubt(self.geometry, name, default)


def stated_doubt(table: Mapping[str, Any], name: str, default: float) -> float:
    """A standard uncertainty, the default where the table states none.

    Zero says that a quantity is known exactly, which a fit can take for known very well.
    """
    value = table.get(name, default)
    if not _is_number(value):
        raise BadLabFile(f"{name}: {value!r} is not a number; state a standard uncertainty in the unit of the name.")
    return max(float(value), EXACT * default)


def on_the_bench(rig: str, repetition: tuple[Track, ...]) -> tuple[Track, ...]:
    """A repetition as the models take it: of two beads the one that is let go first, on a clock that starts at zero.

    Whichever bead a file lists first, the released one starts furthest from the middle.  A tilting arm's clock is left
    as it is: its angle is stated for the moment zero.
    """
    if rig == "double":
        repetition = tuple(sorted(repetition, key=lambda track: -abs(start_of(track))))
    begin = min(float(track.time[0]) for track in repetition)
    if rig == "slide" or 0 <= begin < EARLY:
        return repetition
    return tuple(replace(track, time=track.time - begin) for track in repetition)


def need_repetitions(folder: Path, there: int, still: int = 0) -> None:
    """Refuse a lab of few repetitions: in `still` more of them nothing moved."""
    if there < FEWEST:
        more = f", {still} more in which nothing moved" if still else ""
        raise BadInput(
            f"{folder}: {there} repetition{'' if there == 1 else 's'} in all{more}; at least {FEWEST} are needed to "
            "tell an effect from scatter."
        )


def start_of(track: Track) -> float:
    """[m], x where a bead is before it is let go."""
    return float(np.median(track.position[:5, 0]))


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
    geometry = document.get("rig_geometry", {})
    conditions = () if rig in BULK else tuple(_condition(document, raw, file, rig) for raw in raw_conditions)
    free = [one.name for one in conditions if not one.wall]
    if rig == "pendulum" and 0 < len(free) < len(conditions):
        striking = next(one.name for one in conditions if one.wall)
        raise BadLabFile(
            f"{file}: conditions: {free[0]} swings freely and {striking} strikes a wall; those are two experiments: "
            "write a lab.json for each."
        )
    _read_once(file, conditions)
    used = {condition.wall for condition in conditions if condition.wall}
    return TrackedLab(
        title=str(document.get("case") or document.get("title") or file.parent.name),
        rig=rig,
        gravity=gravity,
        camera=camera,
        geometry=geometry,
        conditions=conditions,
        folder=file.parent,
        stated=document,
        overlooked=tuple(
            dict.fromkeys(
                (
                    *_misspelt(document),
                    *_misnamed(document.get("walls") or {}, used),
                    *_one_more(file, raw_conditions, conditions),
                    *other_rates(conditions, [camera.frame_rate] * len(conditions)),
                )
            )
        ),
    )


def _read_once(file: Path, conditions: Sequence[Condition]) -> None:
    """Refuse conditions that read the same files, and repetitions that are copies of others."""
    owners: dict[Path, Condition] = {}
    for condition in conditions:
        for one in condition.files:
            owner = owners.setdefault((file.parent / one).resolve(), condition)
            if owner is not condition:
                raise BadLabFile(
                    f"{file}: conditions: {owner.name} and {condition.name} both read {one}; one condition holds all "
                    "repetitions of a setting, and each setting has a name and files of its own."
                )
    moving = (
        (file.parent / one).resolve()
        for condition in conditions
        for one, each in zip(condition.files, condition.repetitions, strict=True)
        if any(
            np.ptp(track.position, axis=0).any() for track in each
        )  # what stands as still as can be is alike by itself
    )
    for original, copy in copies(moving):  # counted again it would make an effect surer without a measurement
        raise BadLabFile(f"{copy}: holds the same as {original}; a copy is no repetition: take one of them out.")


def _document(file: Path) -> dict[str, Any]:
    try:
        document = json.loads(file.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise BadLabFile(
            f"{file}: no such file; give a folder with a lab.json of tracked repetitions, or with a lab.toml."
        ) from None
    except OSError as error:
        raise BadLabFile(f"{file}: cannot be read ({error.strerror}); check the path and its permissions.") from None
    except UnicodeDecodeError:
        raise BadLabFile(f"{file}: is not UTF-8 text; save the file as UTF-8.") from None
    except (ValueError, RecursionError) as error:
        raise BadLabFile(f"{file}: is not valid JSON ({error}); correct it there.") from None
    if not isinstance(document, dict):
        raise BadLabFile(f"{file}: holds no table of names and values; write it as docs/tracked_lab.md shows.")
    document = dict(_measured(document))
    for key in TABLES:
        if not isinstance(document.get(key, {}), dict):
            raise BadLabFile(f"{file}: {key}: is not a table of names and values.")
    _sane(document, "", file)
    return document


def _measured(value: Any) -> Any:
    """The document without what was not measured: null says so."""
    if isinstance(value, dict):
        return {key: _measured(entry) for key, entry in value.items() if entry is not None}
    return [_measured(entry) for entry in value] if isinstance(value, list) else value


def _sane(value: Any, key: str, file: Path) -> None:
    """Refuse numbers anywhere in the document that nothing in a lab can have."""
    if isinstance(value, dict):
        for name, entry in value.items():
            _sane(entry, str(name), file)
    elif isinstance(value, list):
        for entry in value:
            _sane(entry, key, file)
    elif key in RANGES:
        least, most = RANGES[key]
        if not (isinstance(value, (int, float)) and least < value < most):
            between = "above zero" if most == math.inf else f"between {least:g} and {most:g}"
            raise BadLabFile(f"{file}: {key}: {value!r} cannot be; state a number {between}, in the unit of the name.")
    elif isinstance(value, (int, float)) and not abs(value) <= LARGEST:
        raise BadLabFile(f"{file}: {key}: {value!r} is no number that was measured; leave it out where it is unknown.")
    elif isinstance(value, (int, float)) and value < 0 and any(kind in key for kind in DOUBTS):
        raise BadLabFile(f"{file}: {key}: {value!r} cannot be; an uncertainty is not below zero.")


def _misspelt(table: Any) -> Iterator[str]:
    """Whatever the document says beside is its own business, but nearly a key's name is hardly meant as a remark."""
    if isinstance(table, list):
        for entry in table:
            yield from _misspelt(entry)
    elif isinstance(table, dict):
        for key, value in table.items():
            meant = get_close_matches(key, OPTIONAL, n=1, cutoff=ALIKE) or [
                one
                for one in OPTIONAL
                if one.rpartition("_")[0] == key and "uncertainty" in key  # less its unit
            ]
            if meant and key not in OPTIONAL and meant[0] not in table and isinstance(value, (int, float, dict)):
                yield f"{key}: is not read; was {meant[0]} meant? Its default stands"
            yield from _misspelt(value)


def _misnamed(walls: Mapping[str, Any], used: Collection[str]) -> Iterator[str]:
    """Tables of walls that no condition names, each beside a wall like it that has no table."""
    bare = sorted(set(used) - set(walls))
    for name in sorted(set(walls) - set(used)):
        for meant in get_close_matches(name, bare, n=1):
            yield f"walls: {name}: is not read, for no condition has this wall; was {meant} meant?"


def _one_more(file: Path, raw_conditions: Sequence[Any], conditions: Sequence[Condition]) -> Iterator[str]:
    """Files that go on with the numbers where the repetitions that are stated end."""
    for raw, condition in zip(raw_conditions, conditions, strict=False):  # rigs of many particles have none
        count = len(condition.files)
        if (file.parent / (more := _pattern(raw, condition.name) % (count + 1))).is_file():
            yield f"condition {condition.name}: {more} is there and is not read, for {count} repetitions are stated"


def other_rates(conditions: Sequence[Condition], stated: Sequence[float | None]) -> Iterator[str]:
    """Conditions whose rows do not follow one another at the rate [1/s] that is stated; times are taken as they are."""
    for condition, rate in zip(conditions, stated, strict=True):
        steps = [float(np.median(np.diff(track.time))) for each in condition.repetitions for track in each]
        found = 1 / float(np.median(steps))
        if rate is not None and abs(math.log(found / rate)) > OTHER_RATE:
            yield (
                f"condition {condition.name}: a frame rate of {rate:g} Hz is stated, but its tracks have {found:.4g} "
                "rows a second; time_s is believed: where the stated rate is right, all times are wrong by that factor"
            )


def _pattern(raw: Mapping[str, Any], name: str) -> str:
    return str(raw.get("files") or f"{name}/rep%02d.csv")


def _camera(document: Mapping[str, Any], file: Path, rig: str) -> Camera:
    raw = document.get("camera") or {}
    if not isinstance(raw, dict):
        raise BadLabFile(f"{file}: camera: is not a table of names and values.")
    if rig in BULK:
        return Camera(_number(raw, "frame_rate_hz", file, default=240.0), math.nan)
    scale = _number(raw, "scale_m_per_px", file, default=math.nan)
    noise = _number(raw, "tracking_noise_px", file, default=math.nan) * scale
    return Camera(
        frame_rate=_number(raw, "frame_rate_hz", file, where="camera: "),
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
    if "repetitions" not in raw:
        raise BadLabFile(f"{file}: condition {name}: repetitions: is missing; say how many files there are of it.")
    count = raw["repetitions"]
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise BadLabFile(f"{file}: condition {name}: repetitions: {count!r} is not a whole number of at least 1.")
    pattern = _pattern(raw, name)
    try:
        first = pattern % 1
    except (TypeError, ValueError):
        raise BadLabFile(
            f"{file}: condition {name}: files: {pattern!r} holds no place for a number; write 'rep%02d.csv'."
        ) from None
    common = {key: value for key, value in document.get("rig_geometry", {}).items() if key in SETTINGS}
    settings = common | {key: value for key, value in raw.items() if key not in ("name", "files", "repetitions")}
    if rig == "roll" and not {"incline_angle_deg", "push_speed_m_s"} & settings.keys():
        raise BadLabFile(
            f"{file}: condition {name}: states neither incline_angle_deg nor push_speed_m_s; a bead rolls down an "
            "incline or is pushed."
        )
    tracks: list[tuple[Track, ...]] = []
    files = []
    for number in range(1, count + 1):  # which a slip of the pen makes too many to list
        files.append(one := pattern % number)
        repetition = read_tracks(file.parent / one)
        _check(repetition, file.parent / one, rig)
        tracks.append(on_the_bench(rig, repetition))
        bodies, others = ({track.body for track in each} for each in (tracks[-1], tracks[0]))
        if rig == "double" and bodies != others:
            raise BadLabFile(
                f"{file.parent / one}: the beads are named {' and '.join(sorted(bodies))}, and "
                f"{' and '.join(sorted(others))} in {first}; name them alike in all repetitions."
            )
    wall = str(raw.get("wall", ""))
    return Condition(name, bead, "" if wall.lower() == "none" else wall, settings, tuple(tracks), tuple(files))


def _check(repetition: tuple[Track, ...], path: Path, rig: str) -> None:
    needed = 2 if rig == "double" else 1
    if len(repetition) != needed:
        found = ", ".join(track.body for track in repetition)
        raise BadLabFile(f"{path}: {len(repetition)} bodies ({found}) where a {rig} has {needed}.")
    for track in repetition:
        if len(track.time) < 20:
            raise BadLabFile(f"{path}: only {len(track.time)} rows; at least 20 are needed to see a motion.")
        if (far := _furthest_of(track)) > FARTHEST:
            raise BadLabFile(f"{path}: a position is {far:.0f} m from the origin; are the columns in metres?")
        speeds = np.hypot(*np.diff(track.position, axis=0).T) / np.diff(track.time)
        if (fast := float(np.median(speeds))) > FASTEST:
            raise BadLabFile(
                f"{path}: the bead moves at {fast:.0f} m/s; are the columns in metres, and time_s in seconds?"
            )


def _furthest(condition: Condition) -> float:
    """[m] from the origin that a bead of the condition is seen at."""
    return max(_furthest_of(track) for repetition in condition.repetitions for track in repetition)


def _furthest_of(track: Track) -> float:
    return float(np.max(np.abs(track.position)))


def _bead(document: Mapping[str, Any], raw: Mapping[str, Any], file: Path, where: str) -> Bead:
    particles = document.get("particles")
    if not isinstance(particles, dict) or not particles:
        raise BadLabFile(f"{file}: particles: is missing or empty; describe each bead there.")
    wanted = next((raw[key] for key in BEAD if key in raw), None)
    if wanted is None and len(particles) == 1:
        wanted = next(iter(particles))
    if "diameter_m" in particles and wanted is None:
        wanted, particles = "bead", {"bead": particles}
    kinds = [value for key, value in raw.items() if any(kind in key.lower() for kind in BEAD)]
    second = next((one for one in kinds if isinstance(one, str) and one in particles and one != wanted), None)
    if document["rig"] == "double" and wanted is not None and second is not None:
        raise BadLabFile(
            f"{file}: condition {where}: names two kinds of beads, {wanted} and {second}; two pendulums are read with "
            "two beads alike."
        )
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
    bead = Bead(str(wanted), diameter, mass, about)
    if odd := no_bead_has(bead.density):
        raise BadLabFile(f"{file}: particles: {wanted}: {odd}")
    return bead


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _text(table: Mapping[str, Any], key: str, file: Path) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise BadLabFile(f"{file}: {key}: is missing or not a text.")
    return value


def _number(table: Mapping[str, Any], key: str, file: Path, *, default: float | None = None, where: str = "") -> float:
    value, key = table.get(key, default), where + key
    if value is None:
        raise BadLabFile(f"{file}: {key}: is missing; state it as a number.")
    if not _is_number(value):
        raise BadLabFile(f"{file}: {key}: {value!r} is not a number.")
    if default is None and not value > 0:
        raise BadLabFile(f"{file}: {key}: {value!r} cannot be; it must be above zero.")
    return float(value)
