"""Read a lab.json of piles, packings, drums and hoppers: conditions, and a folder of records for each repetition."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.bulk.bulk_lab import (
    FRICTION_STD,
    RESTITUTION_STD,
    SIZE_STD,
    BulkCondition,
    BulkLab,
    Record,
    Uncertain,
)
from rigtwin.compare.diagnose.data.read_lab_json import PLACEHOLDER, bead_of, number_of, read_document, text_of
from rigtwin.compare.diagnose.data.tracked_lab import BULK, Bead, is_number
from rigtwin.lab.arrays import Array
from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import copies
from rigtwin.lab.errors import BadLabFile
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.input_files import LARGEST_NOTES, OUTSIDE, lies_outside, read_bytes
from rigtwin.lab.materials import MOST_FRICTION, KnownContact, Material, Pair, Particle, pair
from rigtwin.lab.rigs import DrumSettings, HopperSettings, PackingSettings, PileSettings, RigSettings

UNITS = {  # endings of keys, with the factor to SI
    "length": {"_m": 1.0, "_mm": 1e-3, "_cm": 1e-2},
    "speed": {"_m_s": 1.0, "_mm_s": 1e-3},
    "turning": {"_rpm": math.pi / 30, "_rad_s": 1.0, "_deg_s": math.pi / 180, "_hz": 2 * math.pi},
    "angle": {"_deg": math.pi / 180, "_rad": 1.0},
    "number": {"": 1.0, "_1": 1.0},
    "mass": {"_g": 1e-3, "_kg": 1.0},
}
COUNT = ("particle_count", "count", "bead_count", "number_of_particles", "n_particles")
NAMES: dict[str, dict[str, tuple[str, tuple[str, ...]]]] = {
    "pile": {
        "base_diameter": ("length", ("base_diameter", "dish_diameter", "plate_diameter")),
        "rim_height": ("length", ("rim_height",)),
        "tube_diameter": (
            "length", ("cylinder_inner_diameter", "tube_inner_diameter", "tube_diameter", "cylinder_diameter"),
        ),
        "lift_speed": ("speed", ("lift_speed", "lifting_speed", "cylinder_speed")),
        "outlet_height": ("length", ("outlet_height", "pour_height", "funnel_height", "drop_height")),
        "outlet_diameter": ("length", ("outlet_diameter", "funnel_outlet_diameter", "funnel_diameter")),
        "count": ("number", COUNT),
    },
    "packing": {
        "cylinder_diameter": (
            "length", ("cylinder_inner_diameter", "cylinder_diameter", "container_diameter", "inner_diameter"),
        ),
        "outlet_diameter": ("length", ("outlet_diameter", "funnel_outlet_diameter", "funnel_diameter")),
        "fall_height": ("length", ("fall_height", "pour_height", "drop_height")),
        "count": ("number", COUNT),
    },
    "drum": {
        "drum_diameter": ("length", ("drum_inner_diameter", "drum_diameter", "inner_diameter", "diameter")),
        "depth": (
            "length",
            ("drum_length", "drum_depth", "drum_width", "inner_length", "inner_depth", "inner_width", "length", "depth",
             "width"),
        ),
        "speed": (
            "turning",
            ("rotation_speed", "rotational_speed", "drum_speed", "speed", "rotation_rate", "rotation", "drum", ""),
        ),
        "fill": ("number", ("fill_fraction", "fill_level", "filling_fraction", "filling_degree", "fill")),
        "count": ("number", COUNT),
    },
    "hopper": {
        "outlet": (
            "length",
            ("outlet_diameter", "orifice_diameter", "opening_diameter", "outlet_width", "slot_width", "opening_width",
             "orifice_width", "outlet"),
        ),
        "bin_width": (
            "length",
            ("bin_diameter", "hopper_diameter", "silo_diameter", "cylinder_inner_diameter", "cylinder_diameter",
             "bin_inner_diameter", "bin_width", "hopper_width", "silo_width", "inner_width", "inner_diameter", "width",
             "diameter"),
        ),
        "depth": ("length", ("slot_length", "bin_depth", "hopper_depth", "inner_depth", "depth", "thickness")),
        "cone_height": ("length", ("cone_height",)),
        "half_angle": ("angle", ("cone_half_angle", "half_angle", "hopper_half_angle")),
        "inclination": ("angle", ("wall_angle", "inclination", "cone_angle", "hopper_angle", "wall_inclination")),
        "count": ("number", COUNT),
    },
}  # fmt: skip
"""For each rig the settings: kind of quantity, and names that are understood, each with a unit as its ending."""
WORDS: dict[str, dict[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "pile": {"base_diameter": (("base", "dish", "plate"), ("height", "tube", "cylinder"))},
    "packing": {"cylinder_diameter": (("diameter",), ("bead", "particle", "outlet", "funnel", "hopper"))},
    "drum": {
        "drum_diameter": (("diameter",), ("bead", "particle")),
        "depth": (("length", "depth", "width"), ()),
        "speed": (("",), ("frame",)),
        "fill": (("fill",), ("count",)),
    },
    "hopper": {
        "outlet": (("outlet", "orifice", "opening", "aperture", "slot"), ("time", "delay", "length")),
        "bin_width": (("diameter", "width"), ("bead", "particle", "outlet", "orifice", "opening", "aperture", "slot")),
    },
}
"""Words of which a key has one, and those that it must not have, where none of `NAMES` is there."""
NEEDED = {
    "pile": ("base_diameter", "count"),
    "packing": ("cylinder_diameter", "count"),
    "drum": ("drum_diameter", "depth", "speed"),
    "hopper": ("outlet", "bin_width", "count"),
}
RESULTS = {
    "bed_height": ("length", ("bed_height", "bed_level", "fill_height")),
    "total_mass": ("mass", ("total_mass", "filling_mass")),
    "on_base": ("number", ("particles_on_base", "beads_on_base", "on_base")),
    "stuck": ("number", ("particles_left", "particles_remaining", "particles_in_hopper", "particles_stuck")),
}
"""Numbers of results.json that are understood."""
RESTITUTION = ("restitution",)
FRICTION = ("static_friction", "sliding_friction", "friction")
ROLLING = ("rolling_friction",)
AMONG, AT_WALL, END_WALL = ("_pp", ""), ("_pw", ""), ("_pe", "_end", "_end_wall")
"""Beginnings and ends of the keys of coefficients."""
CONTACT = {
    *(f"{stem}{end}" for stem in (*RESTITUTION, *FRICTION, *ROLLING) for end in (*AMONG, *AT_WALL, *END_WALL)),
    "friction_uncertainty", "restitution_uncertainty", "rolling_friction_uncertainty",
}  # fmt: skip
COLUMNS = {"profile.csv": ("x_m", "height_m"), "discharge.csv": ("time_s", "mass_g")}
FLAT = 1e-3  # [1], height of the cone of a flat floor, over its width
ROWS = 10  # of a record at least
MOST_REPETITIONS = 1000


def is_bulk(folder: Path) -> bool:
    """Whether the lab.json of a folder has rigs with many particles."""
    file = folder / "lab.json" if folder.is_dir() else folder
    if not file.is_file() or file.suffix != ".json":
        return False
    document = read_document(file)
    return any(rig in BULK for rig in _rigs(document))


def _rigs(document: Mapping[str, Any]) -> list[str]:
    """The rig of each condition."""
    conditions = document.get("conditions")
    common = document.get("rig")
    found = (
        [one.get("rig", common) for one in conditions if isinstance(one, dict)] if isinstance(conditions, list) else []
    )
    return [str(one) for one in found or [common]]


def read_bulk_lab(path: Path, *, allow_outside: bool = False) -> BulkLab:
    """Read the lab.json of a folder, or at this path, and its records.  Raises `BadLabFile`.

    With `allow_outside` records may lie outside the folder of the lab.json.
    """
    file = path / "lab.json" if path.is_dir() else path
    document = read_document(file)
    raw = document.get("conditions")
    if not isinstance(raw, list) or not raw or not all(isinstance(one, dict) for one in raw):
        raise BadLabFile(f"{file}: conditions: is missing or empty; list one condition per setting of a rig.")
    if odd := [rig for rig in _rigs(document) if rig not in BULK]:
        raise BadLabFile(
            f"{file}: rig: {odd[0]!r} stands beside a rig of many particles; known of those are {', '.join(BULK)}: "
            "write a lab.json of its own for it."
        )
    left_out: list[str] = []
    conditions: list[BulkCondition] = []
    contacts: dict[Pair, KnownContact] = {}
    materials: dict[str, Material] = {}
    particles: dict[str, Particle] = {}
    for one, rig in zip(raw, _rigs(document), strict=True):
        name = text_of(one, "name", file)
        if name in [known.name for known in conditions]:
            raise BadLabFile(f"{file}: conditions: {name!r} is there twice; give each its own name.")
        bead = _particle(bead_of(document, one, file, name), file)
        wall = _wall(document, one, bead)
        of_rig: dict[str, Any] = found if isinstance(found := document.get(rig), dict) else {}
        stated = {**document.get("rig_geometry", {}), **of_rig, **one}
        settings, unread = _settings(rig, stated, document, file, name)
        left_out += [f"{name}: {key} is not used" for key in unread]
        records = tuple(_records(file, one, name, rig, allow_outside, left_out))
        conditions.append(BulkCondition(Experiment(name, settings, bead, wall, Camera(), ()), records))
        contacts |= _contacts(document, bead, wall, file)
        left_out += [f"contact: {key} is not used" for key in _unread(_contact_table(document), CONTACT)]
        materials |= {bead.material.name: bead.material, wall.name: wall}
        particles[bead.name] = bead
    return BulkLab(
        str(document.get("case") or document.get("title") or file.parent.name),
        file.parent,
        tuple(conditions),
        Model(materials, particles, contacts),
        _uncertain(document, file),
        _arm(document),
        tuple(dict.fromkeys(left_out)),
    )


def _particle(bead: Bead, file: Path) -> Particle:
    about = bead.about
    material = Material(
        f"material of {bead.name}",
        bead.density,
        number_of(about, "youngs_modulus_Pa", file, default=1e7),
        number_of(about, "poissons_ratio", file, default=0.3),
    )
    return Particle(bead.name, material, bead.diameter, bead.density)


def _wall(document: Mapping[str, Any], condition: Mapping[str, Any], bead: Particle) -> Material:
    """The wall's material; its moduli are the bead's where they are not stated, which no bulk rig depends on."""
    name = str(condition.get("wall") or "wall")
    walls = document.get("walls", {})
    about = walls.get(name) if isinstance(walls.get(name), dict) else {}
    known = bead.material
    return Material(
        name,
        float(about.get("density_kg_m3", known.density)),
        float(about.get("youngs_modulus_Pa", known.youngs_modulus)),
        float(about.get("poissons_ratio", known.poisson_ratio)),
    )


def _found(table: Mapping[str, Any], kind: str, names: Sequence[str], where: str) -> tuple[str, float] | None:
    """The first of the names that a table has, with a unit as its ending: the key, and the value in SI."""
    for name in names:
        for ending, factor in UNITS[kind].items():
            key = f"{name}{ending}" if name else ending.removeprefix("_")
            if table.get(key) is not None:
                if not is_number(table[key]):
                    raise BadLabFile(f"{where}: {key}: {table[key]!r} is not a number.")
                return key, float(table[key]) * factor
    return None


def _with_words(
    table: Mapping[str, Any], kind: str, words: Sequence[str], without: Sequence[str]
) -> tuple[str, float] | None:
    """The only key that ends in a unit of this kind and has one of the words; None where there are several."""
    found = [
        (key, float(value) * UNITS[kind][ending])
        for key, value in table.items()
        for ending in UNITS[kind]
        if is_number(value) and ending and f"_{key}".endswith(ending) and "uncertainty" not in key
        and any(word in key for word in words) and not any(word in key for word in without)
    ]  # fmt: skip
    return found[0] if len({key for key, _ in found}) == 1 else None


def _settings(
    rig: str, raw: Mapping[str, Any], document: Mapping[str, Any], file: Path, name: str
) -> tuple[RigSettings, list[str]]:
    """The settings of a rig, and the keys with numbers that are none of them."""
    where = f"{file}: condition {name}"
    read = {key: item for key, (kind, names) in NAMES[rig].items() if (item := _found(raw, kind, names, where))}
    for key, (words, without) in WORDS[rig].items():
        if key not in read and (item := _with_words(raw, NAMES[rig][key][0], words, without)):
            read[key] = item
    found = {key: value for key, (_, value) in read.items()}
    return _of_rig(rig, found, raw, document, file, name), _unread(
        raw, {"repetitions", *(one for one, _ in read.values())}
    )


def _unread(table: Mapping[str, Any], read: Iterable[str]) -> list[str]:
    """The keys with numbers that are not among those that were read."""
    return [key for key, value in table.items() if is_number(value) and key not in read]


def _of_rig(
    rig: str, found: dict[str, Any], raw: Mapping[str, Any], document: Mapping[str, Any], file: Path, name: str
) -> RigSettings:
    for key in NEEDED[rig]:
        if key not in found:
            kind, names = NAMES[rig][key]
            raise BadLabFile(
                f"{file}: condition {name}: the {key.replace('_', ' ')} of the {rig} is missing; state it as "
                f"{names[0]}{next(iter(UNITS[kind]))}."
            )
    for key, value in found.items():
        if value < 0 or (value == 0 and key != "rim_height"):
            raise BadLabFile(f"{file}: condition {name}: {key}: {value:g} is impossible; it must be above zero.")
    if "count" in found:
        found["count"] = round(found["count"])
    if rig == "pile":
        return _pile(found)
    if rig == "packing":
        return PackingSettings(**found)
    if rig == "drum":
        if not {"fill", "count"} & found.keys():
            raise BadLabFile(f"{file}: condition {name}: state particle_count, or fill_fraction.")
        ends = _coefficient(document, FRICTION, END_WALL, file)
        return DrumSettings(**found, end_wall_friction=ends)
    return _hopper(found, raw)


def _pile(found: dict[str, Any]) -> PileSettings:
    pours = "tube_diameter" in found or "lift_speed" in found
    unused = ("outlet_height", "outlet_diameter") if pours else ()
    used = {key: value for key, value in found.items() if key not in unused}
    return PileSettings(**used, variant="pouring" if pours else "piling")


def _hopper(found: dict[str, Any], raw: Mapping[str, Any]) -> HopperSettings:
    slot = "depth" in found and not any("diameter" in key for key in raw)
    half_angle = found.pop("half_angle", None)
    steep = found.pop("inclination", None)
    if steep is None and half_angle is not None:
        steep = math.pi / 2 - half_angle
    if slot:
        return HopperSettings("slot", **found, inclination=math.radians(1) if steep is None else steep)
    found.pop("depth", None)
    if "cone_height" not in found:
        step = (found["bin_width"] - found["outlet"]) / 2
        found["cone_height"] = FLAT * found["bin_width"] if steep is None else step * math.tan(steep)
    return HopperSettings("conical", **found)


def _contact_table(document: Mapping[str, Any]) -> Mapping[str, Any]:
    found: Mapping[str, Any] = document.get("contact") or document.get("contacts") or {}
    return found


def _coefficient(document: Mapping[str, Any], stems: Sequence[str], ends: Sequence[str], file: Path) -> float | None:
    """The first coefficient that is stated under one of the stems with one of the ends; None where none is."""
    table = _contact_table(document)
    for key in (f"{stem}{end}" for stem in stems for end in ends):
        if table.get(key) is None:
            continue
        if not is_number(table[key]):
            raise BadLabFile(f"{file}: contact: {key}: {table[key]!r} is not a number; correct it or leave it out.")
        if not 0 <= table[key] <= MOST_FRICTION or (stems == RESTITUTION and not 0 < table[key] <= 1):
            raise BadLabFile(f"{file}: contact: {key}: {table[key]:g} is impossible.")
        return float(table[key])
    return None


def _contacts(document: Mapping[str, Any], bead: Particle, wall: Material, file: Path) -> dict[Pair, KnownContact]:
    """The contacts among the beads and with the wall, in the convention that counts with a bead's own radius."""

    def known(ends: Sequence[str], what: str, arm: float) -> KnownContact:
        restitution = _coefficient(document, RESTITUTION, ends, file)
        friction = _coefficient(document, FRICTION, ends, file)
        for key, value in (("restitution", restitution), ("static_friction", friction)):
            if value is None:
                raise BadLabFile(f"{file}: contact: {key}{ends[0]} ({what}) is missing; state it as a number.")
        return KnownContact(restitution, friction, arm * (_coefficient(document, ROLLING, ends, file) or 0.0))

    return {
        pair(bead.name, bead.name): known(AMONG, "between particles", _arm(document)),
        pair(bead.name, wall.name): known(AT_WALL, "of a particle and the wall", 1.0),
    }


def _arm(document: Mapping[str, Any]) -> float:
    """1/2 where the lab says that its rolling friction counts with the effective radius of two particles."""
    table = _contact_table(document)
    said = " ".join(str(value).lower() for key, value in table.items() if "rolling" in key)
    return 0.5 if any(word in said for word in ("r_eff", "effective radius", "reduced radius", "r/2")) else 1.0


def _uncertain(document: Mapping[str, Any], file: Path) -> Uncertain:
    contact = _contact_table(document)
    camera = document.get("camera") or {}
    particles = document.get("particles", {})
    tables = [particles, *(one for one in particles.values() if isinstance(one, dict))]
    stated = [
        float(one["diameter_uncertainty_m"]) / float(one["diameter_m"])
        for one in tables
        if is_number(one.get("diameter_uncertainty_m")) and is_number(one.get("diameter_m"))
    ]

    def number(table: Mapping[str, Any], key: str, default: float) -> float:
        return number_of(table, key, file, default=default)

    return Uncertain(
        friction=number(contact, "friction_uncertainty", FRICTION_STD),
        restitution=number(contact, "restitution_uncertainty", RESTITUTION_STD),
        rolling=number(contact, "rolling_friction_uncertainty", 0.0),
        diameter_rel=max(stated) if stated else SIZE_STD,
        scale_rel=number(camera, "scale_uncertainty_rel", Uncertain.scale_rel),
        roll=math.radians(number(camera, "roll_uncertainty_deg", math.degrees(Uncertain.roll))),
        clock_rel=number(camera, "frame_rate_uncertainty_rel", Uncertain.clock_rel),
    )


def _records(
    file: Path, raw: Mapping[str, Any], name: str, rig: str, allow_outside: bool, left_out: list[str]
) -> Iterator[Record]:
    count = raw.get("repetitions")
    if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= MOST_REPETITIONS:
        raise BadLabFile(
            f"{file}: condition {name}: repetitions: {count!r} is not a whole number from 1 to {MOST_REPETITIONS}."
        )
    pattern = str(raw.get("files") or f"{name}/rep%02d")
    if not PLACEHOLDER.fullmatch(pattern):
        raise BadLabFile(f"{file}: condition {name}: files: {pattern!r} has no place for a number, as rep%02d.")
    folders = [file.parent / (pattern % number) for number in range(1, count + 1)]
    curve = "discharge.csv" if rig == "hopper" else "profile.csv"
    there = [folder / curve for folder in folders if (folder / curve).is_file()]
    for original, copy in copies(there):
        raise BadLabFile(f"{copy}: has the same content as {original}; a copy is no repetition: remove one of them.")
    for folder in folders:
        if lies_outside(folder, file.parent) and not allow_outside:
            raise BadLabFile(f"{file}: condition {name}: {folder} {OUTSIDE}")
        numbers = _results(folder / "results.json", left_out)
        x, y = _table(folder / curve) if (folder / curve).is_file() else (None, None)
        if x is None and not numbers:
            raise BadLabFile(f"{folder}: has neither {curve} nor a results.json with known results; put them there.")
        yield Record(x, y, numbers)


def _results(path: Path, left_out: list[str]) -> dict[str, float]:
    if not path.is_file():
        return {}
    try:
        content = json.loads(read_bytes(path, advice="check it", largest=LARGEST_NOTES, refuse=BadLabFile))
    except ValueError as error:
        raise BadLabFile(f"{path}: is not valid JSON ({error}); correct it there.") from None
    if not isinstance(content, dict):
        raise BadLabFile(f"{path}: is not a table of names and values.")
    found, used = {}, set()
    for key, (kind, names) in RESULTS.items():
        if (item := _found(content, kind, names, str(path))) is not None and math.isfinite(item[1]):
            found[key] = item[1]
            used.add(item[0])
    left_out += [f"results.json: {key} is not used" for key in content if key not in used]
    return found


def _table(path: Path) -> tuple[Array, Array]:
    """Two columns of a record; rows without a number are left out."""
    import pandas as pd

    names = COLUMNS[path.name]
    try:
        frame = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise BadLabFile(f"{path}: cannot be read as a table ({error}).") from None
    if missing := [name for name in names if name not in frame.columns]:
        raise BadLabFile(f"{path}: there is no column {missing[0]}; write {','.join(names)}.")
    rows = frame[list(names)].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=float)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < ROWS:
        raise BadLabFile(f"{path}: has only {len(rows)} rows of numbers; at least {ROWS} are needed.")
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return rows[:, 0], rows[:, 1] * (1e-3 if names[1] == "mass_g" else 1.0)
