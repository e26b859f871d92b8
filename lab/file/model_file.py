"""The model that a twin runs on: materials, particles, contacts and the effects switched on; a `model.toml`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from rigtwin.lab.file.lookup import Inventory
from rigtwin.lab.file.schema import ModelFile, read_document, validated
from rigtwin.lab.materials import PARAMETERS, Contact, KnownContact, Material, Pair, Particle, pair
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.size_distributions import Sizes

Effects = Mapping[str, Mapping[str, float]]
"""Effects by name, each with its parameters in SI."""

NO_EFFECTS: Effects = MappingProxyType({})


@dataclass(frozen=True)
class Model:
    """Materials, contacts and effects of a simulation."""

    materials: Mapping[str, Material] = field(default_factory=dict)
    particles: Mapping[str, Particle] = field(default_factory=dict)
    contacts: Mapping[Pair, KnownContact] = field(default_factory=dict)
    effects: Effects = field(default_factory=dict)
    """Effects added to plain contact mechanics, by name, each with its parameters in SI."""

    def known_contact(self, a: str, b: str) -> KnownContact:
        """Return what is known of a contact.

        Parameters
        ----------
        a, b : str
            Names of the two sides, in any order.

        Returns
        -------
        KnownContact
            All unknown where nothing is.
        """
        return self.contacts.get(pair(a, b), KnownContact())

    def contact(self, a: str, b: str, needs: Sequence[str] = PARAMETERS) -> Contact:
        """Return the contact of two particles, or of a particle and a wall.

        Parameters
        ----------
        a, b : str
            Names of the two sides, in any order.
        needs : sequence of str
            Parameters that must be known.

        Returns
        -------
        Contact
            The contact.

        Raises
        ------
        TwinLacks
            If a needed parameter is not known.
        """
        return self.known_contact(a, b).complete(needs, name=f"{a}-{b}")

    def with_contact(
        self,
        a: str,
        b: str,
        *,
        restitution: float | None = None,
        static_friction: float | None = None,
        rolling_friction: float | None = None,
    ) -> Model:
        """Return the same model with parameters of one contact set, for example to what was measured.

        Parameters
        ----------
        a, b : str
            Names of the two sides, in any order.
        restitution, static_friction, rolling_friction : float, optional
            The parameters [1].  Default: as they are.

        Returns
        -------
        Model
            Copy of the model with that contact.
        """
        known = KnownContact(restitution, static_friction, rolling_friction).filled(self.known_contact(a, b))
        return replace(self, contacts={**self.contacts, pair(a, b): known})


def read_model(path: Path) -> Model:
    """Read a model.toml; the sections are those of lab.toml.

    Parameters
    ----------
    path : Path
        Path of the model.toml.

    Returns
    -------
    Model
        The model.

    Raises
    ------
    BadLabFile
        If something is wrong; the message names file, line and key.
    """
    document = read_document(path, made_by="take the model.toml that `rigtwin diagnose` leaves in its results")
    file = validated(document, ModelFile)
    inventory = Inventory(file, path.parent)
    if inventory.problems:
        raise document.error(inventory.problems)
    return Model(inventory.materials, inventory.particles, inventory.contacts, dict(file.effects))


def model_text(model: Model) -> str:
    """Return the text of a model.toml, which `read_model` reads back the same.

    Parameters
    ----------
    model : Model
        Model that the text describes.

    Returns
    -------
    str
        The text; all values in SI.
    """
    lines = ["# all values in SI units"]
    for name, material in model.materials.items():
        lines += _section("materials", name, ("density", "youngs_modulus", "poisson_ratio"), material)
    for name, particle in model.particles.items():
        lines += _particle(name, particle)
    for (a, b), contact in model.contacts.items():
        lines += _section("contacts", f"{a}-{b}", PARAMETERS, contact)
    for name, parameters in model.effects.items():
        lines += ["", f"[effects.{_text(name)}]", *(f"{_text(key)} = {value!r}" for key, value in parameters.items())]
    return "\n".join(lines) + "\n"


def _particle(name: str, particle: Particle) -> list[str]:
    clump = particle.shape
    if clump is None:
        keys = ("diameter", "density") if particle.sizes is None else ("density",)
        lines = _section("particles", name, keys, particle)
    elif particle.name in hlosta2020.NAMES and hlosta2020.particle(particle.name) == particle:
        return []  # found again by its name
    else:
        spheres = [[*place, 2 * radius] for place, radius in zip(clump.offsets, clump.radii, strict=True)]
        lines = [*_section("particles", name, ("density",), particle), f"spheres = {spheres!r}"]
        lines += [f"volume = {clump.volume!r}", f"gyration = {list(clump.gyration)!r}"]
    lines.append(f"material = {_text(particle.material.name)}")
    return lines if particle.sizes is None else [*lines, *_sizes(name, particle.sizes)]


def _sizes(name: str, sizes: Sizes) -> list[str]:
    """Classes of equal particles, or number spread evenly between neighbouring diameters."""
    header = ["", f"[particles.{_text(name)}.size_distribution]", 'by = "number"']
    d, shares = sizes.diameters, sizes.shares
    if d[::2] == d[1::2]:
        parts = [b - a for a, b in zip(shares[::2], shares[1::2], strict=True)]
        return [*header, 'law = "list"', f"diameters = {list(d[::2])!r}", f"shares = {parts!r}"]
    return [*header, 'law = "sieve"', f"meshes = {list(d)!r}", f"passing = {[100 * one for one in shares]!r}"]


def _section(kind: str, name: str, keys: Sequence[str], item: object) -> list[str]:
    values = [(key, getattr(item, key)) for key in keys]
    return ["", f"[{kind}.{_text(name)}]", *(f"{key} = {value!r}" for key, value in values if value is not None)]


def _text(name: str) -> str:
    return json.dumps(name, ensure_ascii=False)
