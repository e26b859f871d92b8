"""Write output files: under a temporary name of their own, renamed when they are whole; one run per folder.

A run that fails leaves the earlier file and no temporary one.  A run that is killed may leave one, whose name ends in
``.part``; the next run in the same folder removes it.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rigtwin.lab.errors import BadInput

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the errors of a full disk: no space, a quota, a file at the largest size that the system allows."""

_TEMPORARY = re.compile(r".+\.[0-9a-f]{8}\.part")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary file beside `path` that takes its name when the block ends without an error.

    Parameters
    ----------
    path : Path
        The file to be written; its folder is made.

    Yields
    ------
    Path
        The temporary file; no other run has the same.

    Raises
    ------
    OSError
        Writing failed; the error names `path`, and the temporary file is removed.

    Examples
    --------
    >>> with replacing(Path("heap.csv")) as part:  # doctest: +SKIP
    ...     part.write_text("x_m,height_m")
    """
    part = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
    with naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield part
            part.replace(path)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let an error of the system that names no file, or a temporary one, name the file that was to be written."""
    try:
        yield
    except OSError as error:
        if error.errno is None or (error.filename is not None and not _TEMPORARY.fullmatch(Path(error.filename).name)):
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


@contextmanager
def claimed(place: Path, refusal: str) -> Iterator[None]:
    """Keep a folder, or the file of one run, from being written by two processes at once.

    Parameters
    ----------
    place : Path
        A folder, which is made; or a file, beside which ``NAME.lock`` stands meanwhile.
    refusal : str
        The message where another process has it.

    Raises
    ------
    BadInput
        Another process writes there.

    Notes
    -----
    The lock is one of the operating system, which ends with the process: a killed run leaves no claim.  Where the
    system has none (Windows, some network file systems), nothing is claimed.
    """
    handle = _locked(place, refusal)
    try:
        yield
    finally:
        if handle is not None:
            if not place.is_dir():
                with suppress(OSError):
                    _lock_file(place).unlink()
            os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files of runs that were killed; only for a folder that is `claimed`."""
    with suppress(OSError):
        for file in folder.iterdir():
            if _TEMPORARY.fullmatch(file.name):
                with suppress(OSError):
                    file.unlink()


def _lock_file(place: Path) -> Path:
    return place.with_name(f"{place.name}.lock")


def _locked(place: Path, refusal: str) -> int | None:
    """An open handle that holds the lock, None where the system has no locks."""
    if sys.platform == "win32":
        return None
    import fcntl

    is_folder = place.is_dir()
    while True:
        with naming(place):
            handle = os.open(place, os.O_RDONLY) if is_folder else os.open(_lock_file(place), os.O_RDWR | os.O_CREAT)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(handle)
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                raise BadInput(refusal) from None
            return None
        if is_folder or _same_file(handle, _lock_file(place)):
            return handle
        os.close(handle)  # its owner removed it in between: this is the lock of nothing


def _same_file(handle: int, path: Path) -> bool:
    try:
        there: Any = path.stat()
    except OSError:
        return False
    mine = os.fstat(handle)
    return bool((mine.st_dev, mine.st_ino) == (there.st_dev, there.st_ino))
