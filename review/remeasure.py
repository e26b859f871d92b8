"""Measure repetitions in the background, in processes that stay; the same settings are measured once."""

from __future__ import annotations

import hashlib
import multiprocessing
import pickle
import threading
import time
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

from rigtwin.compare.measure_repetitions import Failure, measure_repetition
from rigtwin.compare.worker_processes import Workers
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.quantity import Measurement

AT_ONCE = 2  # a measurement whose settings have changed meanwhile is not waited for
KEPT = 64  # results
MEMORY_SHORT = (
    "the process that measured ended without a result, most likely because memory ran out; close other programs, or "
    "give a shorter clip or smaller photos."
)


@dataclass(frozen=True)
class Remeasured:
    """What a measurement gave, and how long it took."""

    found: Measurement | Failure
    seconds: float


class Remeasuring:
    """Measurements of the repetitions of a lab."""

    def __init__(self) -> None:
        self._others = set(multiprocessing.active_children())
        self._workers = Workers(AT_ONCE)
        self._results: OrderedDict[str, Future[Remeasured]] = OrderedDict()
        self._lock = threading.Lock()

    def warm_up(self) -> None:
        """Let a process load the libraries that measuring needs."""
        with self._lock:
            self._workers.submit(_loaded)

    def measured(self, experiment: Experiment, views: Sequence[Path]) -> tuple[str, Future[Remeasured]]:
        """Start measuring one repetition, unless that was done with the same settings and media.

        Parameters
        ----------
        experiment : Experiment
            Its rig, particle and cameras.
        views : sequence of Path
            The media of the repetition.

        Returns
        -------
        str
            What distinguishes these settings from others.
        Future of Remeasured
            The result.
        """
        key = _key(experiment, views)
        with self._lock:
            if key not in self._results:
                for earlier in self._results.values():
                    earlier.cancel()  # what has not begun is not wanted any more
                self._results = OrderedDict(
                    (name, kept) for name, kept in self._results.items() if not kept.cancelled()
                )
                self._results[key] = self._submitted(experiment, views)
                while len(self._results) > KEPT:
                    self._results.popitem(last=False)
            self._results.move_to_end(key)
            return key, self._results[key]

    def forget(self, key: str) -> None:
        """Let the next call measure again."""
        with self._lock:
            self._results.pop(key, None)

    def close(self) -> None:
        """End the processes at once."""
        for process in set(multiprocessing.active_children()) - self._others:
            process.terminate()
        self._workers.close()

    def _submitted(self, experiment: Experiment, views: Sequence[Path]) -> Future[Remeasured]:
        try:
            started = self._workers.submit(_measure, experiment, tuple(views))
        except BrokenProcessPool:
            self._workers.close()
            self._workers = Workers(AT_ONCE)
            started = self._workers.submit(_measure, experiment, tuple(views))
        return started


def ended_early(views: Sequence[Path]) -> Remeasured:
    """The result of a measurement whose process ended."""
    return Remeasured(Failure(views[0], MEMORY_SHORT), 0.0)


def _measure(experiment: Experiment, views: tuple[Path, ...]) -> Remeasured:
    begun = time.perf_counter()
    found = measure_repetition(experiment, views, None)
    return Remeasured(found, time.perf_counter() - begun)


def _loaded() -> None:
    from importlib import import_module

    for rig in ("drop", "pile"):
        import_module(f"rigtwin.measure.{rig}.measurement")


def _key(experiment: Experiment, views: Sequence[Path]) -> str:
    """A text that is the same for the same settings of these media."""
    cameras = tuple(experiment.camera_of(view) for view in views)
    state = tuple((view, view.stat().st_mtime_ns, view.stat().st_size) for view in views if view.exists())
    alone = replace(experiment, repetitions=(), cameras={}, rejected={}, measured=(), outside=frozenset())
    return hashlib.sha256(pickle.dumps((alone, cameras, state))).hexdigest()
