"""One run of a campaign, and the results of many."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from rigtwin.compare.result_files import plain
from rigtwin.lab.checksums import json_sha256
from rigtwin.lab.errors import RigtwinError
from rigtwin.lab.version import __version__

Result = dict[str, Any]
"""Numbers, texts, lists and dictionaries of them, and arrays (at the top level)."""


@dataclass(frozen=True)
class Run:
    """One run: a function and its settings."""

    name: str  # unique among the runs of a call
    function: str  # "module:function"; takes the settings as keywords, returns a `Result` that is not empty
    settings: Mapping[str, Any]  # plain numbers and texts, lists and dictionaries of them
    cost: float = 1.0  # [s], estimated run time; the longest runs start first
    inputs: Mapping[str, Any] = field(default_factory=dict)  # data behind the names in the settings: numbers and texts

    @cached_property
    def key(self) -> str:
        """Digest of rigtwin's version, function and settings: 20 hexadecimal digits."""
        return json_sha256([__version__, self.function, plain(self.settings)])[:20]


@dataclass(frozen=True)
class Done:
    """Results of the runs by name, and the reasons why others have none."""

    results: Mapping[str, Result]
    failures: Mapping[str, str]
    faults: Mapping[str, str] = field(default_factory=dict)
    """Tracebacks of failures by unexpected exceptions."""
    out_of_memory: tuple[str, ...] = ()
    """Names of the runs that did not fit into memory."""

    def raise_faults(self) -> None:
        """Raise an error if a run ended by a fault of rigtwin.

        Raises
        ------
        RigtwinError
            If one did; the traceback of the first is its note.
        """
        if self.faults:
            first = next(iter(self.faults))
            number = len(self.results) + len(self.failures)
            fault = RigtwinError(f"{len(self.faults)} of {number} runs failed, {first} by {self.failures[first]}.")
            fault.add_note(self.faults[first])
            raise fault


def same_inputs(kept: Mapping[str, Any], inputs: Mapping[str, Any]) -> bool:
    """Return whether a kept run had these inputs, up to rounding.

    Parameters
    ----------
    kept : mapping
        Inputs of the kept run.
    inputs : mapping
        Inputs that the run would have now.

    Returns
    -------
    bool
        Whether they are alike; true where one of the two does not state any.
    """
    return not kept or not inputs or _alike(kept, plain(inputs))


def _alike(one: Any, other: Any) -> bool:
    """Equal up to rounding, which differs between machines."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_alike(value, other[name]) for name, value in one.items())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, (int, float)) and isinstance(other, (int, float)):
        return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-15)
    return bool(one == other)
