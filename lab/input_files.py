"""Open input files: ordinary files only, and none that is larger than what it should hold."""

from __future__ import annotations

import os
import stat
import struct
import tempfile
import threading
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from rigtwin.lab.errors import BadInput, RigtwinError, UnreadableMedia

LARGEST_NOTES = 4 * 2**20  # [bytes], of a lab.toml, lab.json or model.toml: ten thousand experiments
LARGEST_TABLE = 128 * 2**20  # [bytes], of a table; as text cells it takes about eight times as much memory
OUTSIDE = "lies outside the lab's folder; put it there, or allow it with --allow-outside."
DAMAGED = (
    OSError, ValueError, LookupError, TypeError, EOFError, RuntimeError, struct.error, zlib.error, zipfile.BadZipFile,
)  # fmt: skip
"""What reading a JSON document or an archive of arrays raises where it is damaged; zipfile raises `RuntimeError` where
a member is encrypted or compressed in an unknown way, json where brackets are nested too deeply."""
LARGEST_CAPTURE = 2**16  # [bytes], of a library's words on stderr that are kept
MOST_ROWS = 1_000_000  # of a table: an hour at 240 frames per second; as text cells they take about half a gigabyte


def why_not_ordinary(path: Path) -> str:
    """Return what keeps a path from being read as a file.

    A pipe or a device would be waited for or read without end.

    Parameters
    ----------
    path : Path
        Path that is to be read.

    Returns
    -------
    str
        The reason in words; empty if there is none.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return "no such file"
    except OSError as error:
        return (error.strerror or "cannot be read").lower()
    except ValueError:  # a zero byte in the name
        return "no such file"
    if stat.S_ISDIR(mode):
        return "is a folder"
    return "" if stat.S_ISREG(mode) else "is a pipe or a device and no file"


def must_have_few_rows(path: Path, rows: int) -> None:
    """Refuse a table of more than `MOST_ROWS`.

    Parameters
    ----------
    path : Path
        Table to be read.
    rows : int
        Number of its rows.

    Raises
    ------
    BadInput
        If it has more.
    """
    if rows > MOST_ROWS:
        raise BadInput(f"{path}: has {rows} rows, and at most {MOST_ROWS} are read; keep only the rows of the track.")


@contextmanager
def opened(
    path: Path, *, advice: str, largest: int | None = None, refuse: type[BadInput] = BadInput
) -> Iterator[BinaryIO]:
    """Open a file for reading.

    Parameters
    ----------
    path : Path
        The file.
    advice : str
        What to do where it cannot be read, the end of the sentence.
    largest : int, optional
        Most bytes that such a file may have.
    refuse : type of BadInput
        The error that is raised.

    Yields
    ------
    binary file
        Open for reading, at its beginning.

    Raises
    ------
    BadInput
        The file is missing, no ordinary file, larger than `largest`, or the system refuses to read it.
    """
    if why := why_not_ordinary(path):
        raise refuse(f"{path}: {why}; {advice}.")
    try:
        with path.open("rb") as file:
            if largest is not None and (size := path.stat().st_size) > largest:
                raise refuse(f"{path}: has {size / 1e6:.0f} MB, and at most {largest / 1e6:.0f} MB are read; {advice}.")
            yield file
    except OSError as error:
        if isinstance(error, RigtwinError) or error.filename not in (None, str(path)):
            raise
        raise refuse(f"{path}: {(error.strerror or 'cannot be read').lower()}; {advice}.") from None


def read_bytes(path: Path, *, advice: str, largest: int | None = None, refuse: type[BadInput] = BadInput) -> bytes:
    """Read the content of a file.

    Parameters
    ----------
    path, advice, largest, refuse : Path, str, int, type of BadInput
        As for `opened`.

    Returns
    -------
    bytes
        The content.

    Raises
    ------
    BadInput
        As `opened` raises it.
    """
    with opened(path, advice=advice, largest=largest, refuse=refuse) as file:
        return file.read()


@contextmanager
def decoding(path: Path, what: str, advice: str, refuse: type[BadInput] = UnreadableMedia) -> Iterator[None]:
    """Refuse a file at whose content a library fails; around calls of libraries only.

    Decoders of pictures, films and archives raise errors of every kind at damaged files: assertions, divisions by zero,
    text that is no text.  What memory or disk lack is no fault of the file and passes through.

    Parameters
    ----------
    path : Path
        File that the library reads.
    what : str
        What it should be, in words.
    advice : str
        What to do, the end of the sentence.
    refuse : type of BadInput
        The error that is raised.

    Raises
    ------
    BadInput
        If the library fails.
    """
    try:
        yield
    except (RigtwinError, MemoryError):
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:80] or type(error).__name__
        raise refuse(f"{path}: cannot be decoded as {what} ({said}); {advice}.") from None


_STDERR = threading.Lock()


@contextmanager
def captured_stderr() -> Iterator[list[str]]:
    """Keep what is written to stderr meanwhile from the user, also what C libraries and other threads write.

    The decoders of JPEG and PNG write there what they find wrong, which no setting prevents.

    Yields
    ------
    list of str
        The lines, known when the block has ended; none where stderr is closed.
    """
    lines: list[str] = []
    with _STDERR:
        try:
            kept = os.dup(2)
        except OSError:  # started with stderr closed
            yield lines
            return
        try:
            with _scratch_file() as file:
                os.dup2(file.fileno(), 2)
                try:
                    yield lines
                finally:
                    os.dup2(kept, 2)
                    file.seek(0)
                    lines += file.read(LARGEST_CAPTURE).decode(errors="replace").splitlines()
        finally:
            os.close(kept)


def _scratch_file() -> BinaryIO:
    """A file without a name, in memory where the system has such files; what is written is lost if none can be made."""
    with suppress(AttributeError, OSError):
        return os.fdopen(os.memfd_create("stderr"), "w+b")
    try:
        return tempfile.TemporaryFile()
    except OSError:
        return Path(os.devnull).open("w+b")


def lies_outside(path: Path, folder: Path) -> bool:
    """Return whether a file, links followed, lies outside a folder.

    Parameters
    ----------
    path : Path
        The file; of a folder of pictures, one of them is enough.
    folder : Path
        Folder that it should lie in.

    Returns
    -------
    bool
        Whether it does; true also where that cannot be found out.
    """
    inside = folder.resolve()
    try:
        parts = [path, *path.iterdir()] if path.is_dir() else [path]
        return not all(part.resolve().is_relative_to(inside) for part in parts)
    except (OSError, RuntimeError, ValueError):  # a circle of links, a name that no file can have
        return True


@contextmanager
def unquoted(path: Path, *, outside: bool) -> Iterator[None]:
    """Let refusals of a file outside the lab's folder quote nothing of it.

    Parameters
    ----------
    path : Path
        File that is read.
    outside : bool
        Whether it lies outside.

    Raises
    ------
    BadInput
        The refusal.
    """
    try:
        yield
    except BadInput:
        if not outside:
            raise
        raise BadInput(
            f"{path}: cannot be used, and lies outside the lab's folder, so nothing of it is quoted here; "
            "give it to `rigtwin measure` to see why."
        ) from None
