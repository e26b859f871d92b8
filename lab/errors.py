"""The errors a person at the bench can act on: what is wrong, where, what to do next.

::

    RigtwinError                 exit code 1
    ├── Interrupted              exit code 130: Ctrl-C, with what was kept of the work
    ├── SimulationFailed         exit code 2: a twin broke down: the input asks for what it cannot follow
    ├── WorkerEnded              exit code 2: the system ended a worker process, most likely for want of memory
    └── BadInput                 exit code 2: the input, not the program, is at fault
        ├── BadQuantity          text that is not a number with a fitting unit
        ├── BadCamera            values of the camera that cannot be, or contradict each other
        ├── BadLabFile           lab.toml: the message names file, key and line
        ├── UnreadableMedia      no such file, empty, not a video, not a picture
        ├── Claimed              another run writes into the same folder or checkpoint
        ├── TwinLacks            a twin needs a contact or setting that is not known
        └── NothingToMeasure     the media is readable but shows no bead, no bounce, no pile
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Mark:
    """A place in a picture: one point, a circle around it, or a line through several points."""

    label: str
    points: Sequence[tuple[float, float]]  # [px]
    radius: float = 0.0  # [px], of a circle around a single point, or around each place of a track; 0 for none
    kind: str = ""  # what it shows: "track", "fit", "outline", "base", "graphical" ...; sets its colour
    frames: Sequence[int] = ()  # of a film: the frame of each point, if the points are places over time
    view: int = 0  # number of the photo, of several


@dataclass(frozen=True)
class Seen:
    """What was found in a film or photo in which nothing could be measured, to be drawn for the user."""

    medium: Path | None = None  # the photo, of several
    frame: int | None = None  # of a film; None: one in its middle
    marks: tuple[Mark, ...] = ()


class RigtwinError(Exception):
    """Base of every error rigtwin raises on purpose.

    Parameters
    ----------
    message : str
        One clear sentence.
    """

    exit_code = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(message)
        self.message = message

    def __str__(self) -> str:
        return self.message


class Interrupted(RigtwinError):
    """The person stopped the work; the message says what was kept of it."""

    exit_code = 130


class SimulationFailed(RigtwinError):
    """A running simulation broke down for what was asked of it; the message names the body and the time."""

    exit_code = 2


class WorkerEnded(RigtwinError):
    """A worker process ended without a result; the message says what it did and how to need less memory."""

    exit_code = 2


class BadInput(RigtwinError):
    """What the user gave cannot be used; the message says what, where, and what to do.

    Parameters
    ----------
    message : str
        The sentence.
    seen : Seen, optional
        What a picture of the refusal should show (`rigtwin.measure.refusal`).
    """

    exit_code = 2

    def __init__(self, message: str = "", seen: Seen | None = None) -> None:
        super().__init__(message)
        self.seen = seen
        self.remarks: tuple[str, ...] = ()  # sentences on what may be the reason
        self.picture: Path | None = None  # written, and named at the end of the text

    def __str__(self) -> str:
        if self.picture is None:
            return self.message
        return f"{self.message.rstrip('.')}; {self.picture} shows what was seen."


class BadQuantity(BadInput):
    """A text that should be a quantity with a unit is not one, or has the wrong dimension."""


class BadLabFile(BadInput):
    """A lab.toml with missing keys, unknown keys or values that cannot be.

    Parameters
    ----------
    message : str
        What stands before several faults; the whole text of a single one.
    faults : sequence of str
        A sentence on each of several faults.
    """

    def __init__(self, message: str = "", faults: Sequence[str] = ()) -> None:
        self.faults = tuple(faults)
        self.headed = message
        super().__init__(": ".join(filter(None, (message, " ".join(self.faults)))))


class BadCamera(BadInput):
    """Values of the camera that cannot be, or that contradict each other.

    Parameters
    ----------
    message : str
        The first fault, with the option.
    faults : sequence of (str, str)
        Key and sentence of each fault.
    """

    def __init__(self, message: str = "", faults: Sequence[tuple[str, str]] = ()) -> None:
        super().__init__(message)
        self.faults = tuple(faults)


class TwinLacks(BadInput):
    """A contact parameter or a setting that a twin needs and that is neither stated nor measured."""


class UnreadableMedia(BadInput):
    """A video or photo that is missing, empty or cannot be decoded."""


class Claimed(BadInput):
    """A folder or checkpoint into which another run writes at this moment."""


class NothingToMeasure(BadInput):
    """Readable media in which the thing to be measured was not found."""


# an option and its value: a number with its unit, or a word with a digit, an inner comma or colon (x1,y1,x2,y2); the
# end of a file's name (heap--base.png) is none
_OPTION = re.compile(
    r"(?<![\w.-])--([a-z]+(?:-[a-z]+)*)"
    r"(?: (\d[\d.e+-]* (?:mm|m|g|kg|Hz|deg|s|ms)\b|(?=[^\s;]*(?:\d|[,:]\w))[\w.,:+^/-]*\w))?"
)


def options_in(text: str) -> list[str]:
    """Return the options of the command line that a message names.

    Parameters
    ----------
    text : str
        The message.

    Returns
    -------
    list of str
        Their names as keys, ``bead_diameter`` of ``--bead-diameter``.

    Examples
    --------
    >>> options_in("give --bead-diameter 6 mm, or --scale.")
    ['bead_diameter', 'scale']
    """
    return [option[1].replace("-", "_") for option in _OPTION.finditer(text)]


def rename_options(text: str, instead: Callable[[str, str], str | None]) -> str:
    """Return a message with other names for the options of the command line.

    Parameters
    ----------
    text : str
        The message.
    instead : callable
        Called with an option's name as a key (``bead_diameter``) and its value, quoted after a blank, "" if it has
        none; returns what takes their place, None if the option stays.

    Returns
    -------
    str
        The message.

    Examples
    --------
    >>> rename_options("give --bead-diameter 6 mm, or --scale.", lambda name, value: f"{name}{value}")
    'give bead_diameter "6 mm", or scale.'
    """

    def renamed(option: re.Match[str]) -> str:
        value = "" if option[2] is None else f' "{option[2]}"'
        return instead(option[1].replace("-", "_"), value) or option[0]

    return _OPTION.sub(renamed, text)


_change: ContextVar[Callable[[str], str]] = ContextVar("_change", default=str)


def reword(text: str) -> str:
    """Return a message in the words of `reworded_refusals` around it: names of options or, of a lab, of keys.

    Parameters
    ----------
    text : str
        The message, which names options.

    Returns
    -------
    str
        The message.
    """
    return _change.get()(text)


@contextmanager
def reworded_refusals(change: Callable[[str], str]) -> Iterator[None]:
    """Change the words of errors from within, and of texts that `reword` is given within.

    The message of any `RigtwinError` is changed on its way out, not what it carries besides: faults, remarks, what was
    seen. Of several around each other the innermost holds for `reword`, and an error passes through all of them. A
    thread that is started within has none.

    Parameters
    ----------
    change : callable
        Returns a message in other words; must be idempotent: a message that it has returned comes back equal.

    Raises
    ------
    RigtwinError
        The error from within.

    Examples
    --------
    >>> with reworded_refusals(lambda text: text.replace("--base", "base")):
    ...     reword("state it with --base.")
    'state it with base.'
    """
    before = _change.set(change)
    try:
        yield
    except RigtwinError as error:
        error.message = reword(error.message)
        raise
    finally:
        _change.reset(before)


@contextmanager
def seeing(seen: Seen, remarks: Sequence[str] = ()) -> Iterator[None]:
    """Add what was seen to a refusal from within that carries nothing of it, and `remarks` that may explain it.

    Parameters
    ----------
    seen : Seen
        What was seen.
    remarks : sequence of str
        Sentences, which the message of the refusal of a medium begins with.

    Raises
    ------
    NothingToMeasure
        The refusal.

    Examples
    --------
    >>> with seeing(Seen(frame=3)):  # doctest: +SKIP
    ...     evaluate(track)
    """
    try:
        yield
    except NothingToMeasure as error:
        error.seen = error.seen or seen
        error.remarks = (*error.remarks, *remarks)
        raise
