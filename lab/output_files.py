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

from rigtwin.lab.errors import Claimed

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the errors of a full disk: no space, a quota, a file at the largest size that the system allows."""

_TEMPORARY = re.compile(r".+\.[0-9a-f]{8}\.part")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary file beside `path` that takes its name when the block ends without an error.

    A block that removes the temporary file leaves `path` as it was.

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
            if part.exists():
                part.replace(path)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let an error of the system that names no file, or a temporary one, name the file that was to be written.

    Parameters
    ----------
    path : Path
        File that is to be written.

    Raises
    ------
    OSError
        The error, with this name.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None or (error.filename is not None and not _TEMPORARY.fullmatch(Path(error.filename).name)):
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


@contextmanager
def claimed_folder(folder: Path, refusal: str) -> Iterator[None]:
    """Keep a folder of results from being written by two runs at once.

    Parameters
    ----------
    folder : Path
        The folder; it is made, and removed again if nothing was written into it.
    refusal : str
        The message where another run writes there.

    Raises
    ------
    Claimed
        Another run writes there.

    Notes
    -----
    The lock is one of the operating system, which ends with the process: a killed run leaves no claim, and the
    temporary files that it left are removed.  Where the system has no such locks (Windows, some network file systems),
    nothing is claimed.
    """
    made = [above for above in (folder, *folder.parents) if not above.exists()]
    with naming(folder):
        folder.mkdir(parents=True, exist_ok=True)
    handle = _locked(folder, os.O_RDONLY, refusal)
    try:
        if handle is not None:
            remove_leftovers(folder)
        yield
    finally:
        with suppress(OSError):  # something was written into it
            for empty in made:
                empty.rmdir()
        if handle is not None:
            os.close(handle)


@contextmanager
def claimed_file(file: Path, refusal: str) -> Iterator[None]:
    """Lock a file that is written again and again against a second run; ``NAME.lock`` stands beside it meanwhile.

    Parameters
    ----------
    file : Path
        The file; its folder is made.
    refusal : str
        The message where another run writes it.

    Raises
    ------
    Claimed
        As `claimed_folder` raises it.
    """
    lock = file.with_name(f"{file.name}.lock")
    with naming(file):
        file.parent.mkdir(parents=True, exist_ok=True)
    handle = _locked(lock, os.O_RDWR | os.O_CREAT, refusal)
    try:
        yield
    finally:
        if handle is not None:
            with suppress(OSError):
                lock.unlink()
            os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files of runs that were killed.

    Parameters
    ----------
    folder : Path
        A folder that is claimed.
    """
    with suppress(OSError):
        for file in folder.iterdir():
            if _TEMPORARY.fullmatch(file.name):
                with suppress(OSError):
                    file.unlink()


def locked(handle: int) -> bool:
    """Lock an open file or folder until it is closed.

    Parameters
    ----------
    handle : int
        Its descriptor.

    Returns
    -------
    bool
        False where the system has no such locks (some network file systems).

    Raises
    ------
    BlockingIOError
        Another process, or another descriptor of this one, holds the lock.
    """
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(errno.EWOULDBLOCK, os.strerror(errno.EWOULDBLOCK)) from error
        return True
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            raise BlockingIOError(error.errno, os.strerror(error.errno)) from None
        return False
    return True


def _locked(lock: Path, mode: int, refusal: str) -> int | None:
    """An open handle that holds the lock, None where the system has no locks."""
    if sys.platform == "win32":  # it cannot open a folder
        return None
    while True:
        with naming(lock):
            handle = os.open(lock, mode)
        try:
            held = locked(handle)
        except BlockingIOError:
            os.close(handle)
            raise Claimed(refusal) from None
        if not held:
            os.close(handle)
            return None
        if _same_file(handle, lock):
            return handle
        os.close(handle)  # its owner removed it in between: this is a lock of nothing


def _same_file(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except OSError:
        return False
