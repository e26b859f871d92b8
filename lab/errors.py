"""The errors a person at the bench can act on: what is wrong, where, what to do next.

::

    RigtwinError                 exit code 1
    ├── Interrupted              exit code 130: Ctrl-C, with what was kept of the work
    ├── SimulationFailed         exit code 2: a twin broke down: the input asks for what it cannot follow
    └── BadInput                 exit code 2: the input, not the program, is at fault
        ├── BadQuantity          text that is not a number with a fitting unit
        ├── BadLabFile           lab.toml: the message names file, key and line
        ├── UnreadableMedia      no such file, empty, not a video, not a picture
        └── NothingToMeasure     the media is readable but shows no bead, no bounce, no pile
"""

from __future__ import annotations


class RigtwinError(Exception):
    """Base of every error rigtwin raises on purpose; the message is one clear sentence."""

    exit_code = 1


class Interrupted(RigtwinError):
    """The person stopped the work; the message says what was kept of it."""

    exit_code = 130


class SimulationFailed(RigtwinError):
    """A running simulation broke down for what was asked of it; the message names the body and the time."""

    exit_code = 2


class BadInput(RigtwinError):
    """What the user gave cannot be used; the message says what, where, and what to do."""

    exit_code = 2


class BadQuantity(BadInput):
    """A text that should be a quantity with a unit is not one, or has the wrong dimension."""


class BadLabFile(BadInput):
    """A lab.toml with a missing key, an unknown key or a value that cannot be."""


class UnreadableMedia(BadInput):
    """A video or photo that is missing, empty or cannot be decoded."""


class NothingToMeasure(BadInput):
    """Readable media in which the thing to be measured was not found."""
