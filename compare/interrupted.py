"""What is kept when a command is interrupted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def noting(note: Callable[[], str]) -> Iterator[None]:
    """Add a note on what is kept to a KeyboardInterrupt that has none yet.

    Parameters
    ----------
    note : Callable[[], str]
        Makes the note when the interrupt comes; nothing is added if it is empty.

    Yields
    ------
    None
        While the block runs.
    """
    try:
        yield
    except KeyboardInterrupt as stop:
        if not getattr(stop, "__notes__", None) and (said := note()):
            stop.add_note(said)
        raise
