"""Rigs described in a lab.toml under ``[rigs.NAME]``: their keys, checked against each other and the STL files."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from rigtwin.lab.checksums import sha256
from rigtwin.lab.custom_rig import CustomRig, Region, StlWall
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lookup import Inventory
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.file.schema import (
    CustomRigEntry,
    Document,
    LabFile,
    Problem,
    RegionEntry,
    WallEntry,
    read_document,
    validated,
)
from rigtwin.lab.file.toml_lines import Key, dotted
from rigtwin.lab.input_files import OUTSIDE, lies_outside, unquoted
from rigtwin.lab.materials import Particle
from rigtwin.lab.spelling import suggestion
from rigtwin.lab.stl import STL_UNITS, stl_facets
from rigtwin.lab.units import LONGEST, MOST_PARTICLES

ADVICE = "give the surface of a wall as STL, binary or text"
WIDE = 1000  # [diameters]; a wall as long, of which a bed would have 10^8 particles, has most likely another unit
# keys that belong to a motion: which of them need another one
NEEDS = {
    "rotation_axis": "rotation_speed",
    "rotation_point": "rotation_speed",
    "vibration_amplitude": "vibration_frequency",
    "vibration_frequency": "vibration_amplitude",
}
_ANY: dict[str, Any] = {  # keys that an entry must have
    "fill": {"low": [0, 0, 0], "high": [1, 1, 1]},
    "particle": "D6",
    "wall": "steel",
    "walls": {"wall": {"stl": "wall.stl"}},
}
_KEY = re.compile(r"[a-z_]+(\.[A-Za-z0-9_-]+)*")
NAMES = re.compile(r"[A-Za-z0-9_-]{1,60}")  # of walls and regions
MOTIONS = ("velocity", "rotation_speed", "vibration_amplitude")


@dataclass(frozen=True)
class OwnRig:
    """A rig of a lab.toml, and what the file knows of its particle, materials and contacts."""

    name: str
    rig: CustomRig
    particle: Particle
    wall: str  # material of the walls that state none
    count: int
    model: Model
    notes: tuple[str, ...] = ()
    """What is odd about an STL file."""
    located: Callable[[str], str] = str
    """Returns a refusal that begins with a key of the file (``walls.cup: ...``) with file and line before it."""


def _located(document: Document, key: Key, instead: frozenset[str], refusal: str) -> str:
    """A refusal with file and line of the key below `key` that it begins with, if no option stands `instead`."""
    begins = _KEY.match(refusal)
    names = begins[0].split(".") if begins is not None else []
    if not names or names[0] in instead or (*key, names[0]) not in document.lines:
        return refusal
    line = document.line((*key, *names))
    return f"{document.path}, line {line}: {dotted(key)}.{refusal}"


def read_own_rig(
    path: Path,
    name: str | None = None,
    *,
    instead: Mapping[str, Any] | None = None,
    allow_outside: bool = False,
) -> OwnRig:
    """Read a rig of a lab.toml.

    Parameters
    ----------
    path : Path
        The lab.toml, or its folder; it needs no experiments.
    name : str, optional
        The rig; needed where the file has several.
    instead : mapping, optional
        Keys of the rig that go before those of the file, as the file would state them.
    allow_outside : bool
        Whether STL files may lie outside the folder of the file.

    Returns
    -------
    OwnRig
        The rig in SI units.

    Raises
    ------
    BadLabFile
        In one sentence with file, line and key: what is wrong and what to write instead.
    """
    document = read_document(path / "lab.toml" if path.is_dir() else path)
    file = validated(document, LabFile)
    named = _named(path, file, name)
    entry = file.rigs[named]
    if instead:
        entry = _replaced(entry, instead)
    inventory = Inventory(file, document.path.parent, allow_outside=allow_outside, only={entry.particle})
    reading = _Reading(("rigs", named), document.path.parent, inventory, allow_outside)
    found = reading.rig(named, entry)
    if found is None:
        for problem in inventory.problems:
            part = problem.key[len(reading.key) :]
            if problem.key[: len(reading.key)] == reading.key and part and part[0] in (instead or {}):
                raise BadInput(f"{_said(part)}: {problem.what}")
        raise document.error(inventory.problems)
    return replace(found, located=partial(_located, document, reading.key, frozenset(instead or ())))


def rig_of_keys(keys: Mapping[str, Any], lab: Path | None = None) -> OwnRig:
    """Return a rig from its keys, as a lab.toml would state them; STL files are named from the present folder.

    Parameters
    ----------
    keys : mapping
        The keys of the rig.
    lab : Path, optional
        A lab.toml or its folder, in which particle and materials are looked up before the reference.

    Returns
    -------
    OwnRig
        The rig in SI units.

    Raises
    ------
    BadInput
        If a key is not possible; the message has it in front.
    """
    file, folder = LabFile(), Path()
    if lab is not None:
        document = read_document(lab / "lab.toml" if lab.is_dir() else lab)
        file, folder = validated(document, LabFile), document.path.parent
    entry = _replaced(None, keys)
    inventory = Inventory(file, folder, only={entry.particle})
    found = _Reading((), None, inventory, allow_outside=True).rig("custom", entry)
    if found is None:
        first = inventory.problems[0]
        raise BadInput(f"{_said(first.key)}: {first.what}")
    return found


def named_for(files: Sequence[Path]) -> dict[str, Path]:
    """Return walls that are named for their files, with a number where another one has the name.

    Parameters
    ----------
    files : sequence of Path
        STL files.

    Returns
    -------
    dict of str to Path
        Files by the names of their walls, in their order.

    Examples
    --------
    >>> list(named_for([Path("a/cup.stl"), Path("b/cup.stl"), Path("lid (1).stl")]))
    ['cup', 'cup-2', 'lid_1_']
    """
    walls: dict[str, Path] = {}
    for file in files:
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", file.stem)[:50] or "wall"  # `NAMES` leaves room for a number
        numbered = (f"{name}-{number}" for number in itertools.count(2))
        walls[next(free for free in itertools.chain((name,), numbered) if free not in walls)] = file
    return walls


def _said(key: Key) -> str:
    """A key as a person says it, who gives a box as `fill` or `region`, and a wall as its file."""
    if key[:2] == ("regions", "region"):
        return "region"
    if key[:1] == ("walls",) and len(key) == 3:
        return "stl" if key[2:] == ("stl",) else f"{key[2]}: wall {key[1]}"
    return "fill" if key[:1] == ("fill",) else dotted(key)


def _named(path: Path, file: LabFile, name: str | None) -> str:
    if name is None and len(file.rigs) == 1:
        return next(iter(file.rigs))
    if not file.rigs:
        raise BadInput(f"{path}: has no rig of your own; describe one under [rigs.NAME], see docs/own_rigs.md.")
    if name is None:
        raise BadInput(f"{path}: has several rigs; choose one with --name ({', '.join(file.rigs)}).")
    if name not in file.rigs:
        raise BadInput(f"--name: there is no rig {name!r} in {path}; {suggestion(name, file.rigs)}.")
    return name


def _replaced(entry: CustomRigEntry | None, keys: Mapping[str, Any]) -> CustomRigEntry:
    """The entry with keys as a file would state them; `entry` None: these alone."""
    try:
        whole = CustomRigEntry.model_validate({**_ANY, **keys})
    except ValidationError as error:
        details = error.errors()[0]
        said = details.get("ctx", {}).get("error", details["msg"])
        raise BadInput(f"{_said(details['loc'])}: {said}") from None
    if entry is None:
        return whole
    changed = {name: getattr(whole, name) for name in keys}
    if "count" in keys:
        changed["total_mass"] = None
    return entry.model_copy(update=changed)


class _Reading:
    """Reading of one rig at `key`, whose problems go into the inventory's; no `folder`: the user named its files."""

    def __init__(self, key: Key, folder: Path | None, inventory: Inventory, allow_outside: bool) -> None:
        self.key, self.folder, self.inventory, self.allow_outside = key, folder, inventory, allow_outside
        self.notes: list[str] = []

    def rig(self, name: str, entry: CustomRigEntry) -> OwnRig | None:
        problems = self.inventory.problems
        particle = self.inventory.particle(entry.particle, (*self.key, "particle"))
        self.inventory.wall(entry.wall, (*self.key, "wall"), of_particles=False)
        problems += [Problem((*self.key, *where), what) for where, what in _faults(entry)]
        if problems or particle is None:
            return None
        walls = {wall: self.wall(wall, stated, entry.wall, particle) for wall, stated in entry.walls.items()}
        whole = {wall: made for wall, made in walls.items() if made is not None}
        if problems or len(whole) < len(walls):
            return None
        rig = CustomRig(
            whole, _region(entry.fill), entry.low, entry.high, entry.pour_rate, entry.pour_speed, entry.duration,
            entry.end, entry.interval, {region: _region(stated) for region, stated in entry.regions.items()},
        )  # fmt: skip
        count = entry.count or round((entry.total_mass or 0.0) / particle.mean_mass)
        if count == 0:
            what = "is less than half the mass of one particle; state the mass of all particles."
            problems.append(Problem((*self.key, "total_mass"), what))
            return None
        if count > MOST_PARTICLES:
            what = f"is that of {count} particles, more than the {MOST_PARTICLES} that a twin can have."
            problems.append(Problem((*self.key, "total_mass"), what))
            return None
        model = Model(self.inventory.materials, self.inventory.particles, self.inventory.contacts)
        return OwnRig(name, rig, particle, entry.wall, count, model, tuple(self.notes))

    def wall(self, name: str, entry: WallEntry, material: str, particle: Particle) -> StlWall | None:
        """A wall; None, and a problem, where it is none."""
        key: Key = (*self.key, "walls", name)
        problems = self.inventory.problems
        of = entry.material or material
        self.inventory.wall(of, (*key, "material"), of_particles=False)
        path = (self.folder or Path()) / entry.stl
        outside = self.folder is not None and lies_outside(path, self.folder)
        if outside and not self.allow_outside:
            problems.append(Problem((*key, "stl"), f"{path} {OUTSIDE}"))
            return None
        try:
            with unquoted(path, outside=outside):
                facets = stl_facets(path, STL_UNITS[entry.stl_unit], ADVICE)
        except BadInput as error:
            problems.append(Problem((*key, "stl"), str(error)))
            return None
        if wrong := self._unit(f"wall {name}", float(np.max(facets.extents)), entry.stl_unit, particle):
            problems.append(Problem((*key, "stl_unit" if "stl_unit" in entry.model_fields_set else "stl"), wrong))
        stated = {
            field: getattr(entry, field)
            for field in ("velocity", "rotation_speed", "rotation_axis", "rotation_point", "vibration_amplitude",
                          "vibration_frequency", "start", "stop", "belt", "removed")
            if getattr(entry, field) is not None
        }  # fmt: skip
        return StlWall(str(path), STL_UNITS[entry.stl_unit], sha256(path), of, **stated)

    def _unit(self, name: str, length: float, unit: str, particle: Particle) -> str:
        """What is wrong with the size [m] of a wall; a note where it is only odd."""
        bead = particle.typical.diameter
        size, grain = _size(length), f"the particle {particle.name} has {_size(bead)}"
        if length > LONGEST:
            return f"is {size} long with stl_unit = {unit!r}, more than {LONGEST:g} m; state the unit of the file."
        if not bead <= length <= WIDE * bead:
            self.notes.append(f"{name} is {size} long with stl_unit = {unit!r}, and {grain}: check the unit")
        return ""


def _size(length: float) -> str:
    return f"{length:.3g} m" if length >= 1 else f"{1e3 * length:.3g} mm"


def _region(entry: RegionEntry) -> Region:
    return Region(entry.low, entry.high, entry.shape)


def _faults(entry: CustomRigEntry) -> Iterator[tuple[Key, str]]:
    """Keys that do not go together, and why."""
    if entry.count is None and entry.total_mass is None:
        yield ("count",), "this key is missing; add count = 1000, or total_mass."
    if entry.count is not None and entry.total_mass is not None:
        yield ("total_mass",), "count is given too; leave one of them out."
    if entry.pour_speed and entry.pour_rate is None:
        yield ("pour_speed",), "belongs to pour_rate, which is not given; leave it out."
    if (entry.low is None) != (entry.high is None):
        missing, there = ("low", "high") if entry.low is None else ("high", "low")
        yield (there,), f"{missing} is not given; give both corners of the domain, or none."
    elif entry.low is not None and entry.high is not None:
        yield from _corners((), entry.low, entry.high)
    for kind, names in (("walls", entry.walls), ("regions", entry.regions)):
        for name in names:
            if not NAMES.fullmatch(name):
                yield (kind, name), "a name has letters, digits, hyphens and underscores only, as it names a file."
    yield from _of_region(("fill",), entry.fill)
    for name, region in entry.regions.items():
        yield from _of_region(("regions", name), region)
    for name, wall in entry.walls.items():
        yield from _of_motion(("walls", name), wall)


def _corners(key: Key, low: tuple[float, ...], high: tuple[float, ...]) -> Iterator[tuple[Key, str]]:
    for axis, a, b in zip("xyz", low, high, strict=True):
        if not a < b:
            yield (*key, "high"), f"is {_size(b)} along {axis}, not above low ({_size(a)}); give the opposite corner."


def _of_region(key: Key, region: RegionEntry) -> Iterator[tuple[Key, str]]:
    yield from _corners(key, region.low, region.high)
    x, y, _ = (b - a for a, b in zip(region.low, region.high, strict=True))
    if region.shape == "cylinder" and not math.isclose(x, y, rel_tol=1e-6):
        yield (*key, "high"), f"the cylinder's box is {_size(x)} by {_size(y)}; give it two equal sides."


def _of_motion(key: Key, wall: WallEntry) -> Iterator[tuple[Key, str]]:
    given = {name for name in (*MOTIONS, *NEEDS) if getattr(wall, name) is not None}
    for name, other in NEEDS.items():
        if name in given and other not in given:
            yield (*key, name), f"changes nothing without {other}; add it, or leave {name} out."
    if not given:
        for name in sorted(wall.model_fields_set & {"start", "stop", "belt"}):
            yield (*key, name), "belongs to a motion, and the wall has none; leave it out."
    if wall.stop is not None and wall.stop <= wall.start:
        yield (*key, "stop"), f"is {wall.stop:g} s, not after start ({wall.start:g} s)."
