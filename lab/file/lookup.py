"""What a file names, found in the file itself or else in the published reference, and never in silence."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.own_particles import faults, own_particle
from rigtwin.lab.file.schema import LabFile, ModelFile, ParticleEntry, Problem
from rigtwin.lab.file.toml_lines import Key
from rigtwin.lab.materials import PARAMETERS, KnownContact, Material, Pair, Particle, pair
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.spelling import suggestion


class Inventory:
    """Materials, particles and contacts of one file; gathers problems instead of stopping at the first.

    Parameters
    ----------
    file : LabFile or ModelFile
        The file, read.
    folder : Path
        Its folder, in which STL files are named.
    allow_outside : bool
        Whether STL files may lie outside the folder.
    only : collection of str, optional
        Names of the particles that are made.  Keys of others are checked, but these are not made: a clump in place of
        an STL file takes seconds.  Default: all.
    """

    def __init__(
        self,
        file: LabFile | ModelFile,
        folder: Path,
        *,
        allow_outside: bool = False,
        only: Collection[str] | None = None,
    ) -> None:
        self.file = file
        self._folder, self._allow_outside = folder, allow_outside
        self.borrowed: list[str] = []
        self.problems: list[Problem] = []
        self.particles: dict[str, Particle] = {}
        self._refused: set[str] = set()  # particles of the file that cannot be made
        self.contacts: dict[Pair, KnownContact] = {}
        self.materials = {
            name: Material(name, entry.density, entry.youngs_modulus, entry.poisson_ratio)
            for name, entry in file.materials.items()
        }
        for name, entry in file.particles.items():
            if only is None or name in only:
                self.particle(name, ("particles", name))
            elif self._solid(name, entry) is not None:
                self.problems += faults(entry, ("particles", name))
        for name in file.contacts:
            self._read_contact(name)

    def material(self, name: str, key: Key) -> Material | None:
        """Return a material by name.

        Parameters
        ----------
        name : str
            Name of the material.
        key : Key
            Where the file names it.

        Returns
        -------
        Material or None
            None when there is none or it cannot be made; the first request notes the problem, of an own particle at
            its keys.
        """
        if name in self.materials:
            return self.materials[name]
        if name not in hlosta2020.MATERIALS:
            near = suggestion(name, (*self.materials, *hlosta2020.MATERIALS))
            self.problems.append(Problem(key, f"there is no material {name!r}; {near}, or add [materials.{name}]."))
            return None
        self.materials[name] = hlosta2020.material(name)
        self.borrowed.append(f"material {name} taken from {hlosta2020.CITATION} (table 2)")
        return self.materials[name]

    def wall(self, name: str, key: Key, *, of_particles: bool) -> Material | None:
        """Return a wall by its material, or by the particles that cover it.

        Parameters
        ----------
        name : str
            Name of the material or of the particle.
        key : Key
            Where the file names it.
        of_particles : bool
            Whether particles may cover it.

        Returns
        -------
        Material or None
            None, with a problem noted, if there is none.  A wall of particles has their name.
        """
        if not of_particles or name not in {*self.file.particles, *hlosta2020.NAMES}:
            return self.material(name, key)
        grain = self.particle(name, key)
        return None if grain is None else replace(grain.material, name=name)

    def particle(self, name: str, key: Key) -> Particle | None:
        """Return a particle by name.

        Parameters
        ----------
        name : str
            Name of the particle.
        key : Key
            Where the file names it.

        Returns
        -------
        Particle or None
            None, and a problem at `key`, when there is none.
        """
        if name in self.particles:
            return self.particles[name]
        if name in self._refused:
            return None
        if name in self.file.particles:
            return self._own_particle(name, self.file.particles[name])
        if name not in hlosta2020.NAMES:
            near = suggestion(name, (*self.file.particles, *hlosta2020.NAMES))
            self.problems.append(Problem(key, f"there is no particle {name!r}; {near}, or add [particles.{name}]."))
            return None
        try:
            self.particles[name] = hlosta2020.particle(name)
        except BadInput as error:
            self.problems.append(Problem(key, str(error)))
            return None
        self.borrowed.append(f"particle {name} taken from {hlosta2020.CITATION} (tables 2, 3 and A2)")
        return self.particles[name]

    def borrow_contact(self, a: str, b: str) -> None:
        """Fill what the file leaves open of a contact from the reference, where the reference has it.

        Parameters
        ----------
        a, b : str
            Names of the two sides, in any order.
        """
        known = self.contacts.get(pair(a, b), KnownContact())
        gaps = known.missing()
        try:
            published = hlosta2020.contact(a, b)
        except BadInput:
            return
        if not gaps:
            return
        self.contacts[pair(a, b)] = known.filled(published)
        what = "" if len(gaps) == len(PARAMETERS) else f"{' and '.join(gap.replace('_', ' ') for gap in gaps)} of "
        own = [name for name in dict.fromkeys((a, b)) if name in self.file.particles or name in self.file.materials]
        caution = f"; the file has its own {' and '.join(own)}, so check that they are the same" if own else ""
        self.borrowed.append(
            f"{what}contact {a}-{b} taken from {hlosta2020.CITATION} ({hlosta2020.contact_tables(a, b)}){caution}"
        )

    def _solid(self, name: str, entry: ParticleEntry) -> Material | None:
        """The material of a particle; None, and a problem, where there is none, or the name is a material's."""
        key: Key = ("particles", name)
        if name in self.file.materials or name in hlosta2020.MATERIALS:
            self.problems.append(Problem(key, f"{name!r} is also a material; give the particle a name of its own."))
            return None
        return self.material(entry.material, (*key, "material"))

    def _own_particle(self, name: str, entry: ParticleEntry) -> Particle | None:
        solid = self._solid(name, entry)
        if solid is not None:
            found = own_particle(name, entry, solid, ("particles", name), self._folder, self._allow_outside)
            if isinstance(found, Particle):
                self.particles[name] = found
                return found
            self.problems += found
        self._refused.add(name)
        return None

    def _read_contact(self, name: str) -> None:
        key: Key = ("contacts", name)
        particles = {*self.file.particles, *hlosta2020.NAMES}
        materials = {*self.file.materials, *hlosta2020.MATERIALS}
        known = particles | materials
        halves = [(name[:k], name[k + 1 :]) for k, letter in enumerate(name) if letter == "-"]
        pairs = [both for both in halves if both[0] in known and both[1] in known]
        if len(pairs) != 1:
            self.problems.append(Problem(key, _unresolved(name, halves, pairs, sorted(known))))
            return
        a, b = pairs[0]
        if not {a, b} & particles:
            self.problems.append(Problem(key, "names two materials; one side must be a particle."))
        elif pair(a, b) in self.contacts:
            self.problems.append(Problem(key, "this contact is given twice (the order of names does not matter)."))
        else:
            entry = self.file.contacts[name]
            self.contacts[pair(a, b)] = KnownContact(entry.restitution, entry.static_friction, entry.rolling_friction)


def _unresolved(name: str, halves: list[tuple[str, str]], pairs: list[tuple[str, str]], known: list[str]) -> str:
    if pairs:
        readings = " or ".join(f"{a} with {b}" for a, b in pairs)
        return f"can be read as {readings}; rename one of them without a hyphen."
    if not halves:
        return "is not a pair of names; write it like [contacts.D6-steel]."
    unknown = next((half for both in halves for half in both if half not in known), name)
    return f"there is no particle or material {unknown!r}; {suggestion(unknown, known)}."
