"""Look up particle, wall and contact by name, in a lab file or the published reference."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import read_cast
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.materials import PARAMETERS, Contact, KnownContact, Material, Particle
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.spelling import suggestion

T = TypeVar("T")


def model_of(lab: Path | None, particle: str | None = None) -> Model:
    """Return the model of a lab folder, whose media need not exist yet.

    Parameters
    ----------
    lab : Path or None
        The folder; None: an empty model.
    particle : str, optional
        As for `rigtwin.lab.file.lab_file.read_cast`.

    Returns
    -------
    Model
        Materials, particles and contacts.
    """
    return Model() if lab is None else read_cast(lab, particle)


def particle(name: str, model: Model) -> Particle:
    """Return a particle of the model, else of the published reference.

    Parameters
    ----------
    name : str
        Name of the particle.
    model : Model
        Model that is asked first.

    Returns
    -------
    Particle
        The particle.

    Raises
    ------
    BadInput
        If there is none.
    """
    return _named("--particle", "particle", name, model.particles, hlosta2020.NAMES, hlosta2020.particle)


def wall(name: str, model: Model) -> Material:
    """Return a material of the model, else of the published reference.

    Parameters
    ----------
    name : str
        Name of the material.
    model : Model
        Model that is asked first.

    Returns
    -------
    Material
        The material.

    Raises
    ------
    BadInput
        If there is none.
    """
    return _named("--wall", "material", name, model.materials, hlosta2020.MATERIALS, hlosta2020.material)


def _named(
    option: str, what: str, name: str, own: Mapping[str, T], published: Iterable[str], read: Callable[[str], T]
) -> T:
    """One of the model's `own`, else a `published` one, which `read` returns."""
    if name in own:
        return own[name]
    if name in published:
        return read(name)
    raise BadInput(f"{option}: there is no {what} {name!r}; {suggestion(name, (*own, *published))}.")


def contact(
    a: str,
    b: str,
    model: Model,
    needs: Sequence[str] = PARAMETERS,
    *,
    restitution: float | None = None,
    static_friction: float | None = None,
    rolling_friction: float | None = None,
    options: bool = True,
) -> Contact:
    """Return a contact; each parameter is that which is given, else the model's, else the published one.

    Parameters
    ----------
    a, b : str
        Names of the two sides, in any order.
    model : Model
        Model that gives what is not stated.
    needs : sequence of str
        Parameters that must be known.
    restitution, static_friction, rolling_friction : float, optional
        Parameters that are given [1].
    options : bool
        Whether there are options for them, which a refusal can name.

    Returns
    -------
    Contact
        The contact.

    Raises
    ------
    BadInput
        If a needed parameter is not known.
    """
    known = KnownContact(restitution, static_friction, rolling_friction).filled(model.known_contact(a, b))
    with suppress(BadInput):  # the pair is not published
        known = known.filled(hlosta2020.contact(a, b))
    if gaps := known.missing(needs):
        raise BadInput(
            f"the {gaps[0].replace('_', ' ')} of the contact {a}-{b} is not known; give it "
            f"{'as an option, or ' if options else ''}under [contacts.{a}-{b}] in the lab.toml"
            f"{' of --lab' if options else ''}."
        )
    return known.complete(needs)
