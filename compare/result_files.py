"""Write result files: all are written under temporary names first, then renamed."""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import platform
import re
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib import metadata
from pathlib import Path
from typing import Any

from rigtwin.compare.deviation import COLUMNS, IDENTITY, Deviation
from rigtwin.lab.errors import Claimed
from rigtwin.lab.input_files import LARGEST_TABLE
from rigtwin.lab.output_files import claimed_folder, remove_leftovers, replacing
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.version import __version__

OBSERVATION_COLUMNS = (
    "experiment", "rig", "origin", "repetition", "quantity", "method", *IDENTITY, "view",
    "value", "std_uncertainty", "unit", "doubtful",
)  # fmt: skip

FIGURES = "figures"  # folder of the figures of all pages in a folder of results

PATIENCE = 10.0  # [s], far above what writing the tables and figures of a campaign takes
POLL = 0.05  # [s], between two attempts

LIBRARIES = (
    "numpy", "scipy", "pandas", "taichi", "opencv-python-headless", "scikit-image", "av", "pydantic", "pint",
    "matplotlib", "jinja2",
)  # fmt: skip


def write_together(folder: Path, contents: Mapping[str, str | bytes]) -> dict[str, Path]:
    """Write files by name into `folder`; a failure while writing leaves all old files unchanged.

    Figures that an earlier run of the same command wrote, and this one does not, are removed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    stale = [name for name in _figures_before(folder, contents) if name not in contents]
    for name in contents:
        if (folder / name).is_dir():  # otherwise this would fail only halfway through the renaming
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(folder / name))
    with ExitStack() as together:  # renames when all are written
        for name, text in contents.items():
            part = together.enter_context(replacing(folder / name))
            if isinstance(text, bytes):
                part.write_bytes(text)
            else:
                part.write_text(text, encoding="utf-8", newline="")
    for name in stale:
        with suppress(OSError):
            (folder / name).unlink()
    return {name: folder / name for name in contents}


def _figures_before(folder: Path, contents: Mapping[str, str | bytes]) -> Iterator[str]:
    """Files of the figures that stand in the lists of figures which are written anew."""
    for listed in contents:
        if not re.fullmatch(rf"{FIGURES}/[\w-]+-captions\.csv", listed):
            continue
        for name in listed_figures(folder / listed):
            yield from (f"{FIGURES}/{name}.{ending}" for ending in ("svg", "png", "csv"))


def listed_figures(captions: Path) -> dict[str, str]:
    """Names and captions in the list of the figures of a page; empty if there is none or it is not of ours."""
    with suppress(OSError, ValueError, KeyError, csv.Error):
        if captions.stat().st_size <= LARGEST_TABLE:
            rows = list(csv.DictReader(captions.read_text(encoding="utf-8").splitlines()))
            return {row["figure"]: row["caption"] for row in rows if re.fullmatch(r"[\w-][\w.-]*", row["figure"])}
    return {}


def write_in_turn(folder: Path, contents: Mapping[str, str | bytes]) -> dict[str, Path]:
    """`write_together` while no other run writes there; temporary files of killed runs are removed.

    Raises `Claimed` if another run writes for longer than `PATIENCE`.
    """
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            with claimed(folder):
                return write_together(folder, contents)
        except Claimed:
            if time.monotonic() > deadline:
                raise
            time.sleep(POLL)


@contextmanager
def claimed(out: Path) -> Iterator[None]:
    """Keep the folder of results for one run; temporary files of killed runs are removed."""
    with claimed_folder(
        out, f"{out}: another run of rigtwin is writing into it; wait for that one, or give --out another folder."
    ):
        remove_leftovers(out / FIGURES)
        yield


def observation(experiment: str, rig: str, origin: str, repetition: str, quantity: Quantity) -> dict[str, Any]:
    """A row of ``observations.csv``: one quantity of one repetition, or one that lab.toml states.

    `origin` is "measured", "stated" or "simulated".
    """
    return {
        "experiment": experiment,
        "rig": rig,
        "origin": origin,
        "repetition": repetition,
        "quantity": quantity.quantity,
        "method": quantity.method,
        **{name: quantity.detail.get(name) for name in (*IDENTITY, "view")},
        "value": quantity.value,
        "std_uncertainty": quantity.std_uncertainty,
        "unit": quantity.unit,
        "doubtful": quantity.doubtful,
    }


def relative(path: Path, folder: Path) -> str:
    """A path as seen from `folder` where it lies in it, else as it is."""
    try:
        return path.relative_to(folder).as_posix()
    except ValueError:
        return str(path)


def deviations_csv(rows: Iterable[Deviation]) -> str:
    """The text of ``deviations.csv``; an empty cell means "does not apply" or "unknown"."""
    return table([row.row() for row in rows], COLUMNS)


def table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Rows as CSV text; None, NaN and infinity become empty cells."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(row.get(name)) for name in columns} for row in rows)
    return text.getvalue()


def document(content: object) -> str:
    """Python and NumPy values (no dataclasses) as strict JSON text."""
    return json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """The value with JSON types only: paths become text, NumPy scalars numbers, NaN and infinity null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy scalar or array
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int, bool)):
        return value
    return str(value)


def versions(libraries: Iterable[str] = LIBRARIES) -> dict[str, str]:
    """Versions of rigtwin, Python and libraries."""
    found = {"rigtwin": __version__, "python": platform.python_version()}
    for library in libraries:
        try:
            found[library] = metadata.version(library)
        except metadata.PackageNotFoundError:  # a checkout on the path without an install
            found[library] = "unknown"
    return found


def surroundings() -> dict[str, Any]:
    """Versions, machine and command line of the run."""
    return {
        "versions": versions(),
        "platform": {
            "system": platform.platform(),
            "machine": platform.machine(),
            "processors": os.cpu_count(),
        },
        "command_line": [Path(sys.argv[0]).name, *sys.argv[1:]],
    }


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.9g}" if math.isfinite(value) else ""
    return "" if value is None else value
