"""Particles described in a lab.toml or model.toml: spheres, and clumps from a list of spheres or an STL file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rigtwin.lab.clumps import Clump, apart, clump
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.schema import (
    ModelParticleEntry,
    ParticleEntry,
    Problem,
    SizesEntry,
    Sphere,
    example_of,
    toml,
)
from rigtwin.lab.file.toml_lines import Key
from rigtwin.lab.input_files import OUTSIDE, lies_outside, unquoted
from rigtwin.lab.materials import HAIR, Material, Particle, clumped, no_bead_has, no_bead_is, sized
from rigtwin.lab.size_distributions import Law, Sizes, listed, lognormal, normal, sieved, uniform
from rigtwin.lab.stl import STL_UNITS
from rigtwin.lab.stl_grain import SphereFilling, filled_file

SHAPES = ("diameter", "spheres", "stl")  # keys of which a particle has one
NEEDED: dict[Law, tuple[str, str]] = {
    "list": ("diameters", "shares"),
    "uniform": ("smallest", "largest"),
    "normal": ("mean", "standard_deviation"),
    "lognormal": ("median", "spread"),
    "sieve": ("meshes", "passing"),
}
ENDS = ("smallest", "largest")  # keys that a normal and a lognormal law may have


def own_particle(
    name: str, entry: ParticleEntry, solid: Material, key: Key, folder: Path, allow_outside: bool
) -> Particle | list[Problem]:
    """Return the particle of an entry, or what is wrong there.

    Parameters
    ----------
    name : str
        Name of the particle.
    entry : ParticleEntry
        Keys under ``[particles.NAME]``.
    solid : Material
        Material of the particle.
    key : Key
        Where the entry stands.
    folder : Path
        Folder in which STL files are named.
    allow_outside : bool
        Whether they may lie outside it.

    Returns
    -------
    Particle or list of Problem
        The particle, or the problems.
    """
    if found := list(faults(entry, key)):
        return found
    try:
        shape = _shape(entry, folder, allow_outside)
    except BadInput as error:
        return [Problem((*key, "stl" if entry.stl is not None else "spheres"), str(error))]
    if shape is None:
        diameter = entry.diameter or 1.0  # that of sizes follows
        sphere = Particle(name, solid, diameter)
        particle = Particle(name, solid, diameter, _density(entry, sphere.volume))
    else:
        particle = clumped(name, solid, shape, density=_density(entry, shape.volume))
    if entry.size_distribution is not None:
        try:
            particle = sized(particle, _sizes_of(entry.size_distribution))
        except BadInput as error:
            return [Problem((*key, "size_distribution"), str(error).removeprefix("sizes: "))]
    if not isinstance(entry, ModelParticleEntry) and (odd := no_bead_is(particle.diameter)):
        given = next(name for name in (*SHAPES, "size_distribution") if getattr(entry, name) is not None)
        return [Problem((*key, given), odd)]
    if particle.density is not None and (odd := no_bead_has(particle.density)):
        return [Problem((*key, "density" if entry.mass is None else "mass"), odd)]
    return particle


def faults(entry: ParticleEntry, key: Key) -> Iterator[Problem]:
    """Yield keys of a particle that do not go together, or are missing.

    Parameters
    ----------
    entry : ParticleEntry
        Keys under ``[particles.NAME]``.
    key : Key
        Where the entry stands.

    Yields
    ------
    Problem
        Each of them.
    """
    given = [name for name in SHAPES if getattr(entry, name) is not None]
    if entry.size_distribution is not None:
        yield from _faults_of_sizes(entry, entry.size_distribution, key)
    elif not given:
        example = toml(example_of(ParticleEntry.model_fields["diameter"]))
        yield Problem((*key, "diameter"), f"this key is missing; add diameter = {example}.")
    for name in given[1:]:
        yield Problem((*key, name), f"{given[0]} is given too; leave one of them out.")
    if entry.density is not None and entry.mass is not None:
        yield Problem((*key, "mass"), "density and mass are both given; leave one of them out.")
    if entry.stl is None:
        for name in sorted(entry.model_fields_set & {"stl_unit", "stl_spheres", "stl_error"}):
            yield Problem((*key, name), "belongs to an STL file, and stl is not given; leave it out.")
    elif entry.stl_spheres is not None and entry.stl_error is not None:
        yield Problem((*key, "stl_error"), "stl_spheres is given too; leave one of them out.")


def _faults_of_sizes(entry: ParticleEntry, sizes: SizesEntry, key: Key) -> Iterator[Problem]:
    place: Key = (*key, "size_distribution")
    if entry.diameter is not None:
        yield Problem((*key, "diameter"), "size_distribution is given too; leave one of them out.")
    if entry.mass is not None:
        yield Problem((*key, "mass"), "says nothing where sizes differ; give density.")
    needed = NEEDED[sizes.law]
    for name in needed:
        if getattr(sizes, name) is None:
            example = toml(example_of(SizesEntry.model_fields[name]))
            # at the law, so that it is no fault of its own where the law is missing
            yield Problem((*place, "law"), f"{sizes.law!r} needs {name}; add {name} = {example}.")
    allowed = {*needed, *(ENDS if sizes.law in ("normal", "lognormal") else ()), "law", "by"}
    for name in sorted(sizes.model_fields_set - allowed):
        yield Problem((*place, name), f"is not used by the law {sizes.law!r}; leave it out.")


def _sizes_of(entry: SizesEntry) -> Sizes:
    """The distribution of an entry in which nothing is missing.  Raises `BadInput` where it is none."""
    first, second = (getattr(entry, name) for name in NEEDED[entry.law])
    ends = {"smallest": entry.smallest, "largest": entry.largest}
    match entry.law:
        case "list":
            return listed(first, second, by=entry.by or "mass")
        case "uniform":
            return uniform(first, second, by=entry.by or "number")
        case "normal":
            return normal(first, second, by=entry.by or "number", **ends)
        case "lognormal":
            return lognormal(first, second, by=entry.by or "number", **ends)
    if len(first) != len(second):
        raise BadInput(f"{len(first)} meshes and {len(second)} numbers under passing are given; give one for each.")
    parts = np.array(second)
    if parts[0] != 0 or not math.isclose(parts[-1], 100, abs_tol=1e-6) or (np.diff(parts) < 0).any():
        raise BadInput(f"passing is {list(second)}; give percents that rise from 0 to 100, one for each mesh.")
    return sieved(first, np.diff(parts).tolist(), by=entry.by or "mass")


def _density(entry: ParticleEntry, volume: float) -> float | None:
    return entry.density if entry.mass is None else entry.mass / volume


def filling_in_words(name: str, entry: ParticleEntry, folder: Path) -> str:
    """Return in words how near the clump of a particle comes to its STL file.

    Parameters
    ----------
    name : str
        Name of the particle.
    entry : ParticleEntry
        Its keys, with an STL file.
    folder : Path
        Folder in which the file is named.

    Returns
    -------
    str
        A clause.
    """
    assert entry.stl is not None
    found = _filling(entry, folder)
    count = len(found.clump.radii)
    gaps = "" if found.touching else "; the spheres do not all touch each other, more of them would"
    return (
        f"particle {name}: {count} sphere{'s' if count > 1 else ''} in place of {entry.stl}, within "
        f"{1e3 * found.error:.2g} mm of its surface, enlarged by {1e3 * found.enlarged:.2g} mm to its volume{gaps}"
    )


def _filling(entry: ParticleEntry, folder: Path) -> SphereFilling:
    assert entry.stl is not None
    return filled_file(folder / entry.stl, STL_UNITS[entry.stl_unit], spheres=entry.stl_spheres, error=entry.stl_error)


def _shape(entry: ParticleEntry, folder: Path, allow_outside: bool) -> Clump | None:
    if entry.stl is not None:
        path = folder / entry.stl
        outside = lies_outside(path, folder)
        if outside and not allow_outside:
            raise BadInput(f"{path} {OUTSIDE}")
        with unquoted(path, outside=outside):
            shape = _filling(entry, folder).clump
        width = (6 * shape.volume / math.pi) ** (1 / 3)
        if width < HAIR and "stl_unit" not in entry.model_fields_set:
            raise BadInput(
                f"{entry.stl}, read in mm, is {1e6 * width:.2g} um wide; state stl_unit, the unit of the file."
            )
        return shape
    if entry.spheres is None:
        return None
    if isinstance(entry, ModelParticleEntry) and entry.volume is not None and entry.gyration is not None:
        places = tuple((x, y, z) for x, y, z, _ in entry.spheres)
        return Clump(places, tuple(diameter / 2 for *_, diameter in entry.spheres), entry.volume, entry.gyration)
    return _of_spheres(entry.spheres)


def _of_spheres(spheres: tuple[Sphere, ...]) -> Clump:
    """The clump of a list of spheres [m].  Raises `BadInput` if they are not all connected."""
    rows = np.array(spheres)
    centres, radii = rows[:, :3], rows[:, 3] / 2
    if (alone := apart(centres, radii)) is not None:
        raise BadInput(f"sphere {alone + 1} does not touch those before it; spheres of one particle hang together.")
    return clump([(x, y, z) for x, y, z, _ in spheres], radii.tolist())
