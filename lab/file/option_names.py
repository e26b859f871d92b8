"""Messages that name options of the command line, for a user who states the same in a lab.toml: its keys instead."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache, partial

from rigtwin.lab.errors import rename_options, reworded_refusals
from rigtwin.lab.file.schema import ParticleEntry, experiment_entries, keys_of_camera

_OF_PARTICLE = "bead_"  # options of the particle begin with it, its keys do not


def in_keys(text: str, rig: str, particle: str) -> str:
    """A message with the keys of lab.toml in place of options of the same name.

    Parameters
    ----------
    text : str
        Message that may name options.
    rig : str
        Rig of the experiment.
    particle : str
        Where its particle is described, in words.

    Returns
    -------
    str
        The same; an option that is no key of the experiment, its camera or its particle stays.

    Examples
    --------
    >>> in_keys("state it with --base x1,y1,x2,y2, or give --bead-diameter 6 mm and --out", "pile", "[particles.D6]")
    'state it with base "x1,y1,x2,y2", or give diameter "6 mm" of [particles.D6] and --out'
    """
    return rename_options(text, partial(_key, rig, particle))


def _key(rig: str, particle: str, name: str, value: str) -> str | None:
    if name in _keys(rig):
        return f"{name}{value}"
    short = name.removeprefix(_OF_PARTICLE)
    if short != name and short in ParticleEntry.model_fields:
        return f"{short}{value} of {particle}"
    return None


@cache
def _keys(rig: str) -> set[str]:
    """Keys of an experiment and its camera."""
    return {*experiment_entries()[rig].model_fields, *keys_of_camera(rig)}


def naming_lab_keys(rig: str, particle: str) -> AbstractContextManager[None]:
    """Let refusals from within, and what `reword` is asked within, name keys of lab.toml.

    Parameters
    ----------
    rig, particle : str
        Rig of the experiment, and where its particle is described, in words.

    Returns
    -------
    context manager
        Within it refusals name keys of lab.toml.
    """
    return reworded_refusals(partial(in_keys, rig=rig, particle=particle))
