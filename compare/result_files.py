"""Write result files: all are written under temporary names first, then renamed."""

from __future__ import annotations

import csv
import errno
import hashlib
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
from rigtwin.lab.errors import BadInput, Claimed
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
    """Write files together; a failure while writing leaves all old files unchanged.

    Figures that an earlier run of the same command wrote, and this one does not, are removed.

    Parameters
    ----------
    folder : Path
        Folder of results, made where it is missing.
    contents : mapping of str to str or bytes
        Contents by name in the folder.

    Returns
    -------
    dict of str to Path
        The files by name.

    Raises
    ------
    OSError
        If a file cannot be written.
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


def others_before(
    out: Path, document: str, lab: Path, names: Iterable[str], known: Iterable[str] | None = None
) -> list[str]:
    """Return which other experiments an earlier document in a folder holds that the lab no longer has.

    Parameters
    ----------
    out : Path
        Folder of results.
    document : str
        Name of the JSON document, with the lab's path under "path" or "lab" and its "experiments".
    lab : Path
        The lab whose results are written there now.
    names : iterable of str
        Experiments that are written now.
    known : iterable of str, optional
        All experiments of the lab; by default any that was written before may be among them.

    Returns
    -------
    list of str
        Names of experiments.

    Raises
    ------
    BadInput
        If it holds results of other experiments, which would be lost.
    """
    try:
        before = json.loads((out / document).read_text(encoding="utf-8"))
        source = Path(before["path"] if "path" in before else before["lab"])
        there = [str(one["id"] if isinstance(one, dict) else one) for one in before["experiments"]]
    except (OSError, ValueError, LookupError, TypeError):  # no such file, or of another kind
        return []
    now, still = set(names), None if known is None else set(known)
    others = [name for name in there if name not in now]
    same = source.resolve() == lab.resolve()
    lost = others if still is None or not same else [name for name in others if name in still]
    if lost:
        raise would_be_lost(out, f"{', '.join(lost)} ({source})", out / document)
    return others


def would_be_lost(out: Path, whose: str, document: Path) -> BadInput:
    """Return the refusal of a folder whose results would be replaced by others.

    Parameters
    ----------
    out : Path
        Folder of results.
    whose : str
        What the results are of.
    document : Path
        The document that shows it.

    Returns
    -------
    BadInput
        To be raised.
    """
    return BadInput(
        f"{out}: holds results of {whose}, which would be lost; give --out another folder, or delete {document}."
    )


def _figures_before(folder: Path, contents: Mapping[str, str | bytes]) -> Iterator[str]:
    """Files of the figures that stand in the lists of figures which are written anew."""
    for listed in contents:
        if not re.fullmatch(rf"{FIGURES}/[\w-]+-captions\.csv", listed):
            continue
        for name in listed_figures(folder / listed):
            yield from (f"{FIGURES}/{name}.{ending}" for ending in ("svg", "png", "csv"))


def listed_figures(captions: Path) -> dict[str, str]:
    """Read the list of the figures of a page.

    Parameters
    ----------
    captions : Path
        The list, a CSV file.

    Returns
    -------
    dict of str to str
        Captions by name; empty if there is no list or it is not of ours.
    """
    with suppress(OSError, ValueError, KeyError, csv.Error):
        if captions.stat().st_size <= LARGEST_TABLE:
            rows = list(csv.DictReader(captions.read_text(encoding="utf-8").splitlines()))
            return {row["figure"]: row["caption"] for row in rows if re.fullmatch(r"[\w-][\w.-]*", row["figure"])}
    return {}


def write_in_turn(folder: Path, contents: Mapping[str, str | bytes]) -> dict[str, Path]:
    """Write files as `write_together` does, while no other run writes there.

    Temporary files of killed runs are removed.

    Parameters
    ----------
    folder, contents : Path, mapping
        As for `write_together`.

    Returns
    -------
    dict of str to Path
        The files by name.

    Raises
    ------
    Claimed
        If another run writes for longer than `PATIENCE`.
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
    """Keep the folder of results for one run; temporary files of killed runs are removed.

    Parameters
    ----------
    out : Path
        Folder that the results are written to.

    Raises
    ------
    Claimed
        If another run writes into it.
    """
    with claimed_folder(
        out, f"{out}: another run of rigtwin is writing into it; wait for that one, or give --out another folder."
    ):
        remove_leftovers(out / FIGURES)
        yield


def observation(experiment: str, rig: str, origin: str, repetition: str, quantity: Quantity) -> dict[str, Any]:
    """Return a row of ``observations.csv``: one quantity of one repetition, or one that lab.toml states.

    Parameters
    ----------
    experiment : str
        Name of the experiment.
    rig : str
        Name of its rig.
    origin : {"measured", "stated", "simulated"}
        Where the quantity comes from.
    repetition : str
        File of the repetition, or name of the run.
    quantity : Quantity
        Quantity that becomes a row.

    Returns
    -------
    dict
        The cells by `OBSERVATION_COLUMNS`.
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
    """Return a path as seen from a folder where it lies in it, else as it is.

    Parameters
    ----------
    path : Path
        Path to be shortened.
    folder : Path
        Folder that it may lie in.

    Returns
    -------
    str
        With slashes where it lies in the folder.
    """
    try:
        return path.relative_to(folder).as_posix()
    except ValueError:
        return str(path)


def deviations_csv(rows: Iterable[Deviation]) -> str:
    """Return the text of ``deviations.csv``; an empty cell means "does not apply" or "unknown".

    Parameters
    ----------
    rows : iterable of Deviation
        Rows of the table of deviations.

    Returns
    -------
    str
        CSV text.
    """
    return table([row.row() for row in rows], COLUMNS)


def table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Return rows as CSV text; None, NaN and infinity become empty cells.

    Parameters
    ----------
    rows : sequence of mapping
        Cells by column; a missing one is empty.
    columns : sequence of str
        Columns, in the order in which they are written.

    Returns
    -------
    str
        CSV text, numbers with nine digits.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(row.get(name)) for name in columns} for row in rows)
    return text.getvalue()


def document(content: object) -> str:
    """Return Python and NumPy values as strict JSON text.

    Parameters
    ----------
    content : object
        The values, without dataclasses.

    Returns
    -------
    str
        JSON text.
    """
    return json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> str:
    """Write arrays into one file, which is on the disk when this returns.

    Parameters
    ----------
    path : Path
        ``.npz``; replaced when the new one is whole.
    arrays : mapping of str to array
        By name.

    Returns
    -------
    str
        SHA-256 of what was written, 64 hexadecimal digits.
    """
    import numpy as np

    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    with replacing(path) as part, part.open("wb") as file:
        file.write(content.getbuffer())
        file.flush()
        os.fsync(file.fileno())
    return hashlib.sha256(content.getbuffer()).hexdigest()


def plain(value: Any) -> Any:
    """Return a value with JSON types only.

    Parameters
    ----------
    value : object
        The value, without dataclasses.

    Returns
    -------
    object
        Paths become text, arrays lists, NumPy scalars numbers, NaN and infinity None.
    """
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
    """Return the versions of rigtwin, Python and libraries.

    Parameters
    ----------
    libraries : iterable of str
        Names of the libraries.

    Returns
    -------
    dict of str to str
        Versions by name; "unknown" where a library is not installed.
    """
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
