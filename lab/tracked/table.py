"""A table as a file holds it (`Table`), before its columns are understood."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

TABLES = (".csv", ".tsv", ".txt", ".dat", ".trk", ".xml", ".parquet")
"""Suffixes of files that are read as tables of tracked data and not as films or photos."""


def is_table(path: Path) -> bool:
    """Return whether the suffix of a file is that of a table of tracked data.

    Parameters
    ----------
    path : Path
        File, of which the suffix alone counts.

    Returns
    -------
    bool
        True for a table.
    """
    return path.suffix.lower() in TABLES


@dataclass(frozen=True)
class TableOptions:
    """What the user states of a table of tracked data."""

    columns: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Role (``t``, ``frame``, ``x``, ``y``, ``id``, ...) to the name, or number from 1, of its column and the unit."""
    joined: tuple[tuple[str, ...], ...] = ()
    """Names of the parts of one broken track, for each body."""


@dataclass(frozen=True)
class Table:
    """Cells of a table as text, with the names and units of its columns."""

    path: Path
    kind: str
    """What wrote the file: "TrackMate spots", "Tracker project", "table"."""
    names: tuple[str, ...]
    units: tuple[str, ...]
    """Unit from a row of its own below the names; empty where there is none."""
    titles: tuple[str, ...]
    """Title above the column, the name of a body; empty where there is none."""
    rows: tuple[tuple[str, ...], ...]
    blocks: tuple[int, ...]
    """Number of the block of each row; blank lines separate blocks."""
    default_length: str = ""
    """Unit of lengths in files of this kind where the file states none: "px" or "m"."""
    up: bool | None = None
    """Whether y counts upwards, where the kind of file settles it."""
    notes: tuple[str, ...] = ()
    """What of the file was not read."""
