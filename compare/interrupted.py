"""What is kept when a command is interrupted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


def add_note(stop: KeyboardInterrupt, folder: Path, note: str) -> None:
    """Add a note on what is kept in a folder, unless one that names the folder is there.

    Parameters
    ----------
    stop : KeyboardInterrupt
        The interrupt.
    folder : Path
        Folder in which something is kept.
    note : str
        The note; nothing is added if it is empty.
    """
    if note and str(folder) not in " ".join(getattr(stop, "__notes__", ())):
        stop.add_note(note)


@contextmanager
def note_on_interrupt(folder: Path, note: Callable[[], str]) -> Iterator[None]:
    """Add a note on what is kept in a folder to a KeyboardInterrupt, as `add_note` does.

    Parameters
    ----------
    folder : Path
        Folder in which something is kept.
    note : Callable[[], str]
        Makes the note when the interrupt comes.

    Yields
    ------
    None
        While the block runs.
    """
    try:
        yield
    except KeyboardInterrupt as stop:
        add_note(stop, folder, note())
        raise
