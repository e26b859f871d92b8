"""A case: a command, and what of its result is compared with an independent reading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

Check = Callable[[dict[str, Any]], str]
"""What is wrong with the JSON document of a command that ended with a result; "" for nothing."""


@dataclass(frozen=True)
class Case:
    """A command line, without ``--quiet``."""

    command: list[str]
    check: Check | None = None
    """The command is run with ``--json`` where there is one."""


NOT_RUN = "all was read, and the rest is not run here."
"""Refusal of the benchmark itself where a case would take long."""

Kind = Callable[[Random, Path], Case]
"""Writes the files of one case into a folder.

Everything random comes from its first argument, and from inputs that earlier cases of the same process have kept."""


def written(folder: Path, name: str, data: bytes | str) -> str:
    """Write a file; its path for a command."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return str(path)


def out(folder: Path) -> list[str]:
    """The option for the folder of results."""
    return ["--out", str(folder / "out")]
