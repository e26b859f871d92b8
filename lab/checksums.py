"""Checksums of what a file, a folder of pictures or a JSON document holds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path

from rigtwin.lab.errors import BadInput


def all_different(views: Sequence[Path]) -> None:
    """Refuse views of which one is given twice, or is a copy of another.

    Counted twice it would make the mean over views look surer than it is.

    Parameters
    ----------
    views : sequence of Path
        Files of one repetition.

    Raises
    ------
    BadInput
        If two are the same.
    """
    seen: set[Path] = set()
    for view in views:
        if view.resolve() in seen:
            raise BadInput(f"{view}: is given twice; each view counts once.")
        seen.add(view.resolve())
    for original, copy in copies(view for view in views if view.is_file()):
        raise BadInput(f"{copy}: holds the same as {original}; a copy is no view of its own: take one of them out.")


def copies(files: Iterable[Path]) -> Iterator[tuple[Path, Path]]:
    """Yield each file that holds the same as an earlier one.

    Only what is of one size is read: clips are large.  What is empty is no copy, but a fault of its own.

    Parameters
    ----------
    files : iterable of Path
        Files, or folders of pictures.

    Yields
    ------
    original, copy : Path
        The earlier file and the later one.
    """
    by_size: dict[int, list[Path]] = {}
    for file in files:
        by_size.setdefault(_size(file), []).append(file)
    for size, alike in by_size.items():
        first: dict[str, Path] = {}
        for file in alike if size and len(alike) > 1 else ():
            original = first.setdefault(_remembered(file, *_state(file)), file)
            if original is not file:
                yield original, file


@lru_cache(maxsize=4096)
def _remembered(path: Path, *_state: tuple[str, int, int]) -> str:
    """`sha256`, which takes seconds for a large clip, once for the same state of a file."""
    return sha256(path)


def _state(path: Path) -> Iterator[tuple[str, int, int]]:
    """Name, size and time of the last change of a file, or of the files in a folder."""
    for file in [path] if path.is_file() else sorted(path.iterdir()):
        state = file.stat()
        yield file.name, state.st_size, state.st_mtime_ns


def _size(path: Path) -> int:
    """[bytes] of a file, or of all files in a folder."""
    return path.stat().st_size if path.is_file() else sum(one.stat().st_size for one in path.iterdir())


def sha256(path: Path) -> str:
    """Return a checksum of a file's content.

    Parameters
    ----------
    path : Path
        A file; of a folder, its files' names and contents count, in the order of their names.

    Returns
    -------
    str
        SHA-256, 64 hexadecimal digits.
    """
    if path.is_file():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    whole = hashlib.sha256()
    for one in sorted(file for file in path.iterdir() if file.is_file()):
        whole.update(f"{one.name}\n{sha256(one)}\n".encode())
    return whole.hexdigest()


def json_sha256(document: object) -> str:
    """Return a checksum of a JSON document.

    Parameters
    ----------
    document : object
        Of JSON types only; the order of names does not count.

    Returns
    -------
    str
        SHA-256, 64 hexadecimal digits.

    Examples
    --------
    >>> json_sha256({"a": 1, "b": 0.5}) == json_sha256({"b": 0.5, "a": 1})
    True
    """
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
