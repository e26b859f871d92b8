"""The file of ``--log``: steps, warnings, refusals and faults of a command, one line each, appended.

The lines go through the logger ``rigtwin`` of the standard library.
"""

from __future__ import annotations

import logging
import re
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from rigtwin.commands.options import file_option
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.version import __version__

LOGGER = logging.getLogger("rigtwin")
LOGGER.addHandler(logging.NullHandler())  # without a file nothing is printed
LOG_EVERY = 15.0  # [s], between two lines of progress in a file
LINE = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z [A-Z]+ ")

WarningsOf = Callable[[Any], Iterable[str]]


class _File(logging.FileHandler):
    """Appends to a file, each line at once; if that fails, the log ends with one warning on stderr."""

    def __init__(self, file: Path) -> None:
        super().__init__(file, encoding="utf-8", errors="backslashreplace")
        self.setFormatter(_Lines("%(asctime)s %(levelname)s %(message)s"))

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        LOGGER.removeHandler(self)
        error = sys.exception()
        reason = getattr(error, "strerror", None) or error
        sys.stderr.write(f"rigtwin: warning: {self.baseFilename}: {reason}; the log ends here, the command goes on.\n")
        self.close()

    def close(self) -> None:
        with suppress(OSError):  # what could not be written is tried again
            super().close()


class _Lines(logging.Formatter):
    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:  # noqa: N802
        moment = datetime.fromtimestamp(record.created, UTC)
        return f"{moment.strftime(datefmt or '%Y-%m-%dT%H:%M:%S')}.{int(record.msecs):03d}Z"


def _begin(file: Path | None) -> Path | None:
    """Open the file as soon as its option is read, so that refusals of other options are written too."""
    if file is None:
        return None
    from rigtwin.lab.errors import BadInput

    if file.is_file():
        with file.open("rb") as earlier:
            head = earlier.read(64)
        if head and not LINE.match(head):
            raise BadInput(f"--log: {file} is no log of rigtwin; give the name of another file.")
    file.parent.mkdir(parents=True, exist_ok=True)
    end()
    LOGGER.addHandler(_File(file))
    LOGGER.setLevel(logging.INFO)
    LOGGER.info("rigtwin %s begins: %s", __version__, _one_line(" ".join(sys.argv[1:])))
    return file


Log = Annotated[
    Path | None,
    file_option(
        "--log",
        "FILE",
        "Append steps, warnings and errors to this file, with UTC times.",
        callback=_begin,
        is_eager=True,
    ),
]


def end(code: int | None = None) -> None:
    """Write the exit code and close the file, if there is one."""
    for handler in [one for one in LOGGER.handlers if isinstance(one, _File)]:
        if code is not None:
            LOGGER.info("ends with exit code %d", code)
        LOGGER.removeHandler(handler)
        handler.close()


def failure(message: str, code: int, error: BaseException | None = None) -> None:
    """Write why a command ends with an exit code other than 0; of a fault (1) with the traceback of `error`."""
    level = {1: logging.CRITICAL, 130: logging.WARNING}.get(code, logging.ERROR)
    LOGGER.log(level, "%s", _one_line(message), exc_info=error if code == 1 else None)


def warned(found: Any, warnings_of: WarningsOf) -> Any:
    """Write the warnings of a result; returns the result."""
    if any(isinstance(handler, _File) for handler in LOGGER.handlers):
        for words in warnings_of(found):
            LOGGER.warning("%s", _one_line(words))
    return found


def steps() -> Progress:
    """Progress that writes a line where a step begins and ends, and every 15 s in between."""
    if not any(isinstance(handler, _File) for handler in LOGGER.handlers):
        return silent
    written: dict[str, tuple[float, bool]] = {}  # by step: when its last line was written, whether it had ended

    def write(stage: str, done: float, total: float) -> None:
        ends, now = bool(total) and done >= total, time.monotonic()
        last, ended = written.get(stage, (-LOG_EVERY, False))
        if (ends and ended) or (not ends and not ended and now - last < LOG_EVERY):
            return
        written[stage] = now, ends
        LOGGER.info("%s %s", _one_line(stage), f"{done:.6g}/{total:.6g}" if total else f"{done:.6g}")

    return write


def _one_line(words: str) -> str:
    return " ".join(words.split())
