"""Read a lab.json for diagnosis: conditions, stated uncertainties and one track file (CSV) for each repetition."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import (
    BULK,
    TRACKED,
    Bead,
    Camera,
    Condition,
    TrackedLab,
    furthest_of,
    is_number,
    on_the_bench,
    other_rates,
)
from rigtwin.lab.checksums import copies
from rigtwin.lab.errors import BadLabFile, reworded_refusals
from rigtwin.lab.input_files import LARGEST_NOTES, OUTSIDE, lies_outside, read_bytes, unquoted, why_not_ordinary
from rigtwin.lab.materials import no_bead_has
from rigtwin.lab.media_files import kind_of
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY
from rigtwin.lab.spelling import near
from rigtwin.lab.tracked.read import read_tracks
from rigtwin.lab.units import LARGEST_BEAD

OPTIONAL = (
    "scale_m_per_px", "tracking_noise_px", "tracking_noise_m", "scale_uncertainty_rel", "frame_rate_uncertainty_rel",
    "roll_uncertainty_deg", "drop_height_uncertainty_m", "length_uncertainty_m", "release_angle_uncertainty_deg",
    "plate_level_uncertainty_deg", "tilt_rate_uncertainty_rel", "incline_angle_uncertainty_deg",
    "pivot_spacing_uncertainty_m", "release_sideways_speed_m_s", "sliding_friction_pw", "diameter_uncertainty_m",
    "gravity_m_s2", "material", "wall", "push_speed_m_s", "incline_angle_deg", "start_angle_deg", "waiting_time_s",
    "clump_mass_g", "mass_g", "mass_kg", "density_kg_m3", "rig_geometry", "camera", "walls",
    "thickness_m", "youngs_modulus_Pa", "poissons_ratio", "surface_turned", "run_reversed",
)  # fmt: skip
"""Optional keys: a misspelt one would silently be replaced by its default, so similar keys are reported."""

BEAD = ("bead", "particle", "clump", "sphere")  # keys of a condition that name its bead

ALIKE = 0.9  # similarity of two spellings (ratio of difflib) above which a key is reported as misspelt

SETTINGS = (
    "drop_height_m", "length_m", "release_angle_deg", "tilt_rate_deg_s", "start_angle_deg", "waiting_time_s",
    "start_distance_m", "clump_mass_g", "incline_angle_deg", "push_speed_m_s",
)  # fmt: skip
"""Settings of a condition; those common to all conditions may be stated once, in rig_geometry."""

YES_OR_NO = ("surface_turned", "run_reversed")  # settings of a condition that are true or false

NOT_NEGATIVE = ("uncertainty", "noise", "sideways_speed")  # parts of the names of quantities that cannot be negative

RANGES = {  # open range of valid values
    **dict.fromkeys(("drop_height_m", "length_m", "thickness_m", "youngs_modulus_Pa", "clump_mass_g"), (0.0, math.inf)),
    "poissons_ratio": (-1.0, 0.6),
    "release_angle_deg": (-180.0, 180.0),
    "gravity_m_s2": (0.0, 100.0),
}

TABLES = ("walls", "rig_geometry")

FARTHEST, FASTEST = 100.0, 60.0  # [m] from the origin, and [m/s] (speed of a fall from 180 m)

FEWEST_ROWS = 10  # of a track: a path has up to 4 unknowns of its own in each of two coordinates
MOST_REPETITIONS = 10_000  # of one condition; a count that was meant to be smaller

PLACEHOLDER = re.compile(r"(?:[^%]|%%)*%(?:0?[1-9])?d(?:[^%]|%%)*", re.DOTALL)  # one number of at most nine digits

INSTEAD = {  # options that a refusal of a table names, and what states the same in the table of a lab.json
    r"--columns '[^']+'": "the first line of the file, such as time_s,x_m,y_m",
    r"--frame-rate\b": "a column time_s",
    r"--scale\b": "columns x_m and y_m in metres",
}

LARGEST = 1e300  # largest accepted magnitude of any number, near the limit of a float


def read_tracked_lab(path: Path, *, allow_outside: bool = False) -> TrackedLab:
    """Read the lab.json of a folder, or at this path, and its track files.  Raises `BadLabFile`.

    With `allow_outside` track files may lie outside the folder of the lab.json.
    """
    file = path / "lab.json" if path.is_dir() else path
    document = read_document(file)
    rig = text_of(document, "rig", file)
    if rig not in (*TRACKED, *BULK):
        raise BadLabFile(f"{file}: rig: there is no rig {rig!r}; known are {', '.join((*TRACKED, *BULK))}.")
    raw_conditions = document.get("conditions")
    if not isinstance(raw_conditions, list) or not raw_conditions:
        raise BadLabFile(f"{file}: conditions: is missing or empty; list one condition per setting of the rig.")
    gravity = number_of({"gravity_m_s2": GRAVITY, **document}, "gravity_m_s2", file)
    camera = _camera(document, file, rig)
    geometry = document.get("rig_geometry", {})
    conditions = (
        () if rig in BULK else tuple(_condition(document, raw, file, rig, allow_outside) for raw in raw_conditions)
    )
    free = [one.name for one in conditions if not one.wall]
    if rig == "pendulum" and 0 < len(free) < len(conditions):
        striking = next(one.name for one in conditions if one.wall)
        raise BadLabFile(
            f"{file}: conditions: {free[0]} swings freely and {striking} hits a wall; those are two experiments: "
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
    """Raise if two conditions read the same file, or one track file is a copy of another."""
    owners: dict[Path, Condition] = {}
    for condition in conditions:
        for one in condition.files:
            owner = owners.setdefault((file.parent / one).resolve(), condition)
            if owner is not condition:
                raise BadLabFile(
                    f"{file}: conditions: {owner.name} and {condition.name} both read {one}; list all repetitions of "
                    "a setting under one condition, and give each setting its own name and files."
                )
    moving = (
        (file.parent / one).resolve()
        for condition in conditions
        for one, each in zip(condition.files, condition.repetitions, strict=True)
        if any(
            np.ptp(track.position, axis=0).any() for track in each
        )  # tracks without any motion are equal without being copies
    )
    for original, copy in copies(moving):  # a copy would raise the significance of an effect without a measurement
        raise BadLabFile(f"{copy}: has the same content as {original}; a copy is no repetition: remove one of them.")


def read_document(file: Path) -> dict[str, Any]:
    if why_not_ordinary(file) == "no such file":
        raise BadLabFile(
            f"{file}: no such file; give a folder with a lab.json of tracked repetitions, or with a lab.toml."
        )
    try:
        advice = "check the path and its permissions"
        content = read_bytes(file, advice=advice, largest=LARGEST_NOTES, refuse=BadLabFile)
        document = json.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        kind = kind_of(content)
        why = f"{kind}, no JSON text; give a lab.json" if kind else "not UTF-8 text; save the file as UTF-8"
        raise BadLabFile(f"{file}: is {why}.") from None
    except (ValueError, RecursionError) as error:
        raise BadLabFile(f"{file}: is not valid JSON ({error}); correct it there.") from None
    if not isinstance(document, dict):
        raise BadLabFile(f"{file}: is not a table of names and values; write it as docs/tracked_lab.md shows.")
    document = dict(_measured(document))
    for key in TABLES:
        if not isinstance(document.get(key, {}), dict):
            raise BadLabFile(f"{file}: {key}: is not a table of names and values.")
    _sane(document, "", file)
    return document


def _measured(value: Any) -> Any:
    """The document without null entries, which mean "not measured"."""
    if isinstance(value, dict):
        return {key: _measured(entry) for key, entry in value.items() if entry is not None}
    return [_measured(entry) for entry in value] if isinstance(value, list) else value


def _sane(value: Any, key: str, file: Path) -> None:
    """Raise for impossible numbers anywhere in the document."""
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
            raise BadLabFile(
                f"{file}: {key}: {value!r} is impossible; state a number {between}, in the unit of the key."
            )
    elif isinstance(value, (int, float)) and not abs(value) <= LARGEST:
        raise BadLabFile(f"{file}: {key}: {value!r} is not a finite number; leave the key out if it is unknown.")
    elif isinstance(value, (int, float)) and value < 0 and any(kind in key for kind in NOT_NEGATIVE):
        raise BadLabFile(f"{file}: {key}: {value!r} is impossible; state a number of at least zero.")


def _misspelt(table: Any) -> Iterator[str]:
    """A warning for each unknown key that is almost an optional key; other unknown keys are allowed."""
    if isinstance(table, list):
        for entry in table:
            yield from _misspelt(entry)
    elif isinstance(table, dict):
        for key, value in table.items():
            meant = get_close_matches(key, OPTIONAL, n=1, cutoff=ALIKE) or [
                one
                for one in OPTIONAL
                if one.rpartition("_")[0] == key and "uncertainty" in key  # the key without its unit
            ]
            if meant and key not in OPTIONAL and meant[0] not in table and isinstance(value, (int, float, dict)):
                yield f"{key}: is not read; was {meant[0]} meant? Its default is used"
            yield from _misspelt(value)


def _misnamed(walls: Mapping[str, Any], used: Collection[str]) -> Iterator[str]:
    """A warning for each wall table that no condition uses and whose name resembles a wall without a table."""
    bare = sorted(set(used) - set(walls))
    for name in sorted(set(walls) - set(used)):
        if meant := near(name, bare):
            yield f"walls: {name}: is not read, because no condition has this wall; was {meant} meant?"


def _one_more(file: Path, raw_conditions: Sequence[Any], conditions: Sequence[Condition]) -> Iterator[str]:
    """A warning for each condition with a file numbered after its last stated repetition."""
    for raw, condition in zip(raw_conditions, conditions, strict=False):  # bulk rigs have no conditions
        count = len(condition.files)
        if (file.parent / (more := _pattern(raw, condition.name) % (count + 1))).is_file():
            yield f"condition {condition.name}: {more} exists but is not read, because {count} repetitions are stated"


def _pattern(raw: Mapping[str, Any], name: str) -> str:
    return str(raw.get("files") or f"{name}/rep%02d.csv")


def _camera(document: Mapping[str, Any], file: Path, rig: str) -> Camera:
    raw = document.get("camera") or {}
    if not isinstance(raw, dict):
        raise BadLabFile(f"{file}: camera: is not a table of names and values.")
    if rig in BULK:
        return Camera(number_of(raw, "frame_rate_hz", file, default=240.0), math.nan)
    scale = number_of(raw, "scale_m_per_px", file, default=math.nan)
    noise = number_of(raw, "tracking_noise_px", file, default=math.nan) * scale
    return Camera(
        frame_rate=number_of(raw, "frame_rate_hz", file, where="camera: "),
        noise=number_of(raw, "tracking_noise_m", file, default=noise),
        scale_rel=number_of(raw, "scale_uncertainty_rel", file, default=0.002),
        clock_rel=number_of(raw, "frame_rate_uncertainty_rel", file, default=1e-4),
        roll=math.radians(number_of(raw, "roll_uncertainty_deg", file, default=0.15)),
    )


def _condition(document: Mapping[str, Any], raw: Any, file: Path, rig: str, allow_outside: bool) -> Condition:
    if not isinstance(raw, dict):
        raise BadLabFile(f"{file}: conditions: each must be a table with a name.")
    name = text_of(raw, "name", file)
    bead = bead_of(document, raw, file, name)
    if "repetitions" not in raw:
        raise BadLabFile(f"{file}: condition {name}: repetitions: is missing; state the number of its files.")
    count = raw["repetitions"]
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise BadLabFile(f"{file}: condition {name}: repetitions: {count!r} is not a whole number of at least 1.")
    if count > MOST_REPETITIONS:
        raise BadLabFile(
            f"{file}: condition {name}: repetitions: {count} is more than the {MOST_REPETITIONS} that are read."
        )
    pattern = _pattern(raw, name)
    if not PLACEHOLDER.fullmatch(pattern):
        raise BadLabFile(
            f"{file}: condition {name}: files: {pattern!r} has no placeholder for a number; write 'rep%02d.csv'."
        )
    first = pattern % 1
    common = {key: value for key, value in document.get("rig_geometry", {}).items() if key in SETTINGS}
    settings = common | {key: value for key, value in raw.items() if key not in ("name", "files", "repetitions")}
    for key in YES_OR_NO:
        if not isinstance(settings.get(key, False), bool):
            raise BadLabFile(f"{file}: condition {name}: {key}: {settings[key]!r} is not true or false.")
    if rig == "roll" and not {"incline_angle_deg", "push_speed_m_s"} & settings.keys():
        raise BadLabFile(
            f"{file}: condition {name}: has neither incline_angle_deg nor push_speed_m_s; state one of them: a bead "
            "rolls down an incline or is pushed."
        )
    tracks: list[tuple[Track, ...]] = []
    files = []
    for number in range(1, count + 1):  # lazily: a mistyped count may be huge
        files.append(one := pattern % number)
        outside = lies_outside(file.parent / one, file.parent)
        if outside and not allow_outside:
            raise BadLabFile(f"{file}: condition {name}: files: {file.parent / one} {OUTSIDE}")
        with reworded_refusals(_in_the_table), unquoted(file.parent / one, outside=outside):
            repetition = read_tracks(file.parent / one)
        _check(repetition, file.parent / one, rig)
        tracks.append(on_the_bench(rig, repetition))
        bodies, others = ({track.body for track in each} for each in (tracks[-1], tracks[0]))
        if rig == "double" and bodies != others:
            raise BadLabFile(
                f"{file.parent / one}: the beads are named {' and '.join(sorted(bodies))}, and "
                f"{' and '.join(sorted(others))} in {first}; use the same names in all repetitions."
            )
    wall = str(raw.get("wall", ""))
    return Condition(name, bead, "" if wall.lower() == "none" else wall, settings, tuple(tracks), tuple(files))


def _in_the_table(text: str) -> str:
    """A refusal of a table with what to change in it: a lab.json has no keys for what such options state."""
    for option, instead in INSTEAD.items():
        text = re.sub(option, instead, text)
    return text


def _check(repetition: tuple[Track, ...], path: Path, rig: str) -> None:
    needed = 2 if rig == "double" else 1
    if len(repetition) != needed:
        found = ", ".join(track.body for track in repetition)
        raise BadLabFile(f"{path}: holds {len(repetition)} bodies ({found}); a {rig} has {needed}.")
    for track in repetition:
        if len(track.time) < FEWEST_ROWS:
            raise BadLabFile(f"{path}: only {len(track.time)} rows; at least {FEWEST_ROWS} are needed.")
        if (far := furthest_of(track)) > FARTHEST:
            raise BadLabFile(f"{path}: a position is {far:.0f} m from the origin; are the columns in metres?")
        speeds = np.hypot(*np.diff(track.position, axis=0).T) / np.diff(track.time)
        if (fast := float(np.median(speeds))) > FASTEST:
            raise BadLabFile(
                f"{path}: the bead moves at {fast:.0f} m/s; are the columns in metres, and time_s in seconds?"
            )


def bead_of(document: Mapping[str, Any], raw: Mapping[str, Any], file: Path, where: str) -> Bead:
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
            f"{file}: condition {where}: names two kinds of beads, {wanted} and {second}; only two equal beads are "
            "supported for two pendulums."
        )
    about = particles.get(wanted) if isinstance(wanted, str) else None
    if not isinstance(about, dict):
        known = ", ".join(map(str, particles))
        raise BadLabFile(f"{file}: condition {where}: bead {wanted!r} is not under particles (known: {known}).")
    diameter = number_of(about, "diameter_m", file, default=math.nan)
    if diameter > LARGEST_BEAD:
        raise BadLabFile(f"{file}: particles: {wanted}: diameter_m: {diameter:g} is in metres; was it meant in mm?")
    mass = number_of(about, "mass_g", file, default=math.nan) * 1e-3
    density = number_of(about, "density_kg_m3", file, default=math.nan)
    mass = mass if math.isfinite(mass) else number_of(about, "mass_kg", file, default=math.nan)
    if not math.isfinite(mass):
        mass = density * math.pi / 6 * diameter**3
    if not (diameter > 0 and mass > 0):
        raise BadLabFile(f"{file}: particles: {wanted}: needs diameter_m and mass_g (or density_kg_m3) above zero.")
    bead = Bead(str(wanted), diameter, mass, about)
    if odd := no_bead_has(bead.density):
        raise BadLabFile(f"{file}: particles: {wanted}: {odd}")
    return bead


def text_of(table: Mapping[str, Any], key: str, file: Path) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise BadLabFile(f"{file}: {key}: is missing or not a text.")
    return value


def number_of(
    table: Mapping[str, Any], key: str, file: Path, *, default: float | None = None, where: str = ""
) -> float:
    value, key = table.get(key, default), where + key
    if value is None:
        raise BadLabFile(f"{file}: {key}: is missing; state it as a number.")
    if not is_number(value):
        raise BadLabFile(f"{file}: {key}: {value!r} is not a number.")
    if default is None and not value > 0:
        raise BadLabFile(f"{file}: {key}: {value!r} is impossible; it must be above zero.")
    return float(value)
