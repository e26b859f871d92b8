"""Run many simulations on all cores and keep each result in a folder, so that an interrupted call can continue.

Each finished run is written at once, to a file whose name contains a digest of its settings.  A run with the same
settings is read instead of run again.  The data behind names in the settings (a particle, for example) are stored in
the file, too: if they have changed, the run is repeated.
"""

from __future__ import annotations

import hashlib
import json
import math
import traceback
from collections.abc import Iterator, Mapping, Sequence, Sized
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from rigtwin.compare import result_files
from rigtwin.compare.worker_processes import interrupts_held, spawned
from rigtwin.lab.errors import RigtwinError
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.version import __version__


@dataclass(frozen=True)
class Run:
    """One run: a function and its settings."""

    name: str  # unique among the runs of a call, valid in a file name
    function: str  # "module:function"; takes the settings as keywords, returns plain numbers and texts
    settings: Mapping[str, Any]  # plain numbers and texts
    cost: float = 1.0  # [s], estimated run time; the longest runs start first
    inputs: Mapping[str, Any] = field(default_factory=dict)  # data behind the names in the settings: numbers and texts

    @property
    def file_name(self) -> str:
        """Name of the file that keeps its result, with a digest of version, function and settings."""
        what = json.dumps([__version__, self.function, self.settings], sort_keys=True)
        return f"{self.name}-{hashlib.sha256(what.encode()).hexdigest()[:10]}.json"


@dataclass(frozen=True)
class Done:
    """Results of the runs by name, and the reasons why others have none."""

    results: Mapping[str, dict[str, Any]]
    failures: Mapping[str, str]
    faults: Mapping[str, str] = field(default_factory=dict)
    """Tracebacks of failures by unexpected exceptions."""
    out_of_memory: tuple[str, ...] = ()
    """Names of the runs that did not fit into memory."""


def run_all(
    runs: Sequence[Run],
    folder: Path,
    *,
    workers: int | None = None,
    only_kept: bool = False,
    progress: Progress = silent,
) -> Done:
    """Run what the folder does not contain yet, in parallel processes, and return all results.

    Parameters
    ----------
    runs : sequence of Run
        Runs with unique names.
    folder : Path
        Folder of the kept results; created if it does not exist.
    workers : int, optional
        Number of processes, one for each core by default.
    only_kept : bool
        Read kept results only, run nothing.
    progress : Progress
        Called with step, finished cost [s] and total cost [s].

    Returns
    -------
    Done
        Results and failures by name.  A failed run is tried again in the next call.

    Raises
    ------
    RigtwinError
        If a worker process ends unexpectedly.

    Notes
    -----
    A run that raises a `RigtwinError` is listed with its message, any other exception as a fault of rigtwin.
    """
    if not only_kept:
        folder.mkdir(parents=True, exist_ok=True)
    kept = {run.name: found for run in runs if (found := _read(folder / run.file_name, run)) is not None}
    missing = sorted((run for run in runs if run.name not in kept), key=lambda run: -run.cost)
    failures: dict[str, str] = {}
    faults: dict[str, str] = {}
    out_of_memory: list[str] = []
    whole, still = sum(run.cost for run in runs), sum(run.cost for run in missing)
    progress("running", whole - still, whole)
    if missing and not only_kept:
        with _kept_note(runs, kept, folder), spawned(len(missing), workers) as pool:
            with interrupts_held():
                pending = {pool.submit(_perform, run.function, dict(run.settings)): run for run in missing}
            for job in as_completed(pending):
                run = pending[job]
                try:
                    found = job.result()
                except RigtwinError as error:
                    failures[run.name] = str(error)
                except BrokenProcessPool:  # the other runs cannot continue either
                    raise
                except MemoryError:
                    failures[run.name] = "does not fit into memory; close other programs or give fewer --workers."
                    out_of_memory.append(run.name)
                except Exception as error:  # a fault in one run must not stop the others
                    failures[run.name] = f"a fault of rigtwin itself ({_in_short(error)})"
                    faults[run.name] = "".join(traceback.format_exception(error))
                else:
                    kept[run.name] = found
                    record = {
                        "rigtwin": __version__, "function": run.function, "settings": dict(run.settings),
                        "inputs": run.inputs, "result": found,
                    }  # fmt: skip
                    result_files.write_together(
                        folder, {run.file_name: result_files.document(result_files.plain(record))}
                    )
                still -= run.cost
                progress("running", whole - still, whole)
    finished = {run.name: kept[run.name] for run in runs if run.name in kept}
    return Done(finished, failures, faults, tuple(out_of_memory))


@contextmanager
def _kept_note(runs: Sized, kept: Sized, folder: Path) -> Iterator[None]:
    """Add to a KeyboardInterrupt a note on what is kept."""
    try:
        yield
    except KeyboardInterrupt as stop:
        stop.add_note(f"{len(kept)} of {len(runs)} runs are kept in {folder}; the same command runs the others.")
        raise


def _in_short(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]


def _perform(function: str, settings: dict[str, Any]) -> dict[str, Any]:
    module, name = function.split(":")
    found: dict[str, Any] = result_files.plain(getattr(import_module(module), name)(**settings))
    return found


def fits(record: Mapping[str, Any], run: Run) -> bool:
    """Whether a kept run has the same inputs as the run would have now; true if the file does not state them."""
    return not record.get("inputs") or not run.inputs or _alike(record["inputs"], result_files.plain(run.inputs))


def _alike(one: Any, other: Any) -> bool:
    """Equal up to rounding, which differs between machines."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_alike(value, other[name]) for name, value in one.items())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, (int, float)) and isinstance(other, (int, float)):
        return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-15)
    return bool(one == other)


def _read(path: Path, run: Run) -> dict[str, Any] | None:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        found = record["result"] if fits(record, run) else None
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return None  # missing or damaged: run again
    return found if isinstance(found, dict) and found else None  # a valid result is never empty
