"""Measure repetitions in the background, in processes that stay; the same settings are measured once."""

from __future__ import annotations

import hashlib
import multiprocessing
import pickle
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import Future, InvalidStateError
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from rigtwin.compare.deviation import Deviation, deviations
from rigtwin.compare.measure_repetitions import Failure, measure_repetition
from rigtwin.compare.twins.matched import twin_of
from rigtwin.compare.worker_processes import Workers
from rigtwin.lab.arrays import Image
from rigtwin.lab.errors import BadInput, Mark, RigtwinError
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.quantity import Measurement
from rigtwin.review.twin_in_step import twin_marks

AT_ONCE = 2  # processes: while one is stopped and started again, the other one measures with the new settings
KEPT = 64  # results
MEASURING, TWIN = "measurement", "twin"  # what a process works on
PHOTOS_KEPT = 6  # in each process: a change of one photo of a repetition leaves the others as they were observed
MEMORY_SHORT = (
    "the process that measured ended without a result, most likely because memory ran out; close other programs, or "
    "give a shorter clip or smaller photos."
)
TWIN_ENDED = (
    "the process that ran the twin ended without a result, most likely because memory ran out; close other programs, "
    "then ask again."
)


@dataclass(frozen=True)
class Remeasured:
    """What a measurement gave, and how long it took."""

    found: Measurement | Failure
    seconds: float
    ended: bool = False
    """Whether the system ended the process that measured."""


@dataclass(frozen=True)
class Beside:
    """A repetition beside its twin."""

    rows: tuple[Deviation, ...] = ()
    marks: tuple[Mark, ...] = ()
    refused: str = ""
    ended: bool = False
    """Whether the system ended the process that ran the twin."""


Outcome = TypeVar("Outcome", Remeasured, Beside)


class Remeasuring:
    """Measurements of the repetitions of a lab.

    A measurement is stopped when the same repetition is asked for with other settings, or when all processes are busy.
    """

    def __init__(self) -> None:
        self._results: OrderedDict[str, Future[Remeasured]] = OrderedDict()
        self._twins: OrderedDict[str, Future[Beside]] = OrderedDict()
        self._lock = threading.Lock()
        self._slots = [_Slot() for _ in range(AT_ONCE)]

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
            The result; `BadInput` says what else was asked for, if it is stopped.
        """
        key = _key(experiment, views)
        with self._lock:
            if not _useful(self._results.get(key)):
                shown = tuple(views)
                ended = Remeasured(Failure(shown[0], MEMORY_SHORT), 0.0, ended=True)
                self._results[key] = self._chosen(shown, MEASURING).start(shown, ended, _measure, experiment, shown)
                while len(self._results) > KEPT:
                    self._results.popitem(last=False)
            self._results.move_to_end(key)
            return key, self._results[key]

    def in_step(self, experiment: Experiment, model: Model, measurement: Measurement) -> Future[Beside]:
        """Run the twin of a filmed repetition that was measured.

        Parameters
        ----------
        experiment : Experiment
            One whose twin has few bodies and starts from what was measured.
        model : Model
            Contacts and effects of the twin.
        measurement : Measurement
            What the film gave.

        Returns
        -------
        Future of Beside
            The result; `BadInput` says what else was asked for, if it is stopped.
        """
        views = (measurement.source,)
        key = f"{_key(experiment, views)} {hashlib.sha256(pickle.dumps(model)).hexdigest()}"
        with self._lock:
            if not _useful(self._twins.get(key)):
                ended = Beside(refused=TWIN_ENDED, ended=True)
                slot = self._chosen(views, TWIN)
                self._twins[key] = slot.start(views, ended, _simulate, experiment, model, measurement)
                while len(self._twins) > KEPT:
                    self._twins.popitem(last=False)
            return self._twins[key]

    def warm_up(self) -> None:
        """Start the processes, which load their libraries meanwhile."""
        with self._lock:
            for slot in self._slots:
                slot.begin()

    def close(self) -> None:
        """End the processes at once."""
        with self._lock:
            for slot in self._slots:
                slot.stop("the page was closed")

    def _chosen(self, views: tuple[Path, ...], work: str) -> _Slot:
        """The process that is to work on these media; what works on them with other settings is stopped."""
        for slot in self._slots:
            if slot.busy and slot.views == views:
                slot.renew(f"its {work} with other settings was asked for meanwhile")
        idle = [slot for slot in self._slots if not slot.busy]
        # one that has observed these media before, else one that has loaded its libraries
        idle.sort(key=lambda slot: (slot.views != views, not slot.loaded))
        chosen = idle[0] if idle else self._slots[0]
        if chosen.busy:
            chosen.renew(f"the {work} of {views[0].name} was asked for meanwhile")
        chosen.work = work
        self._slots.remove(chosen)
        self._slots.append(chosen)  # the one that was asked first stands first
        return chosen


class _Slot:
    """One process that measures one repetition at a time."""

    def __init__(self) -> None:
        self.views: tuple[Path, ...] = ()
        self.work = MEASURING
        self._promised: Future[Any] = Future()
        self._promised.cancel()
        self._workers: Workers | None = None
        self._loading: Future[None] = Future()
        self._processes: set[BaseProcess] = set()

    @property
    def busy(self) -> bool:
        return not self._promised.done()

    @property
    def loaded(self) -> bool:
        """Whether the process has loaded its libraries."""
        return self._loading.done()

    def start(
        self, views: tuple[Path, ...], if_ended: Outcome, work: Callable[..., Outcome], *arguments: Any
    ) -> Future[Outcome]:
        """Let the process do some work on these media; `if_ended` is the result where the system ends the process."""
        self.views = views
        workers = self.begin()
        try:
            job = workers.submit(work, *arguments)
        except BrokenProcessPool:  # the process was ended by the system meanwhile
            self._end()
            job = self.begin().submit(work, *arguments)
        promised: Future[Outcome] = Future()
        self._promised = promised
        job.add_done_callback(lambda done: _hand_on(done, promised, if_ended))
        return promised

    def renew(self, why: str) -> None:
        """Stop what is measured, and begin a new process."""
        self.stop(why)
        self.begin()

    def stop(self, why: str) -> None:
        """Stop what is measured; who waits for it is given the reason."""
        if self.busy:
            with suppress(InvalidStateError):  # it is there just now
                stopped = f"{self.views[0]}: the {self.work} was stopped, because {why}; choose it again."
                self._promised.set_exception(BadInput(stopped))
        self._end()

    def _end(self) -> None:
        for process in self._processes:
            process.terminate()
        if self._workers is not None:
            self._workers.close()
            self._workers = None

    def begin(self) -> Workers:
        """Start the process, unless it runs."""
        if not all(process.is_alive() for process in self._processes):
            self._end()
        if self._workers is None:
            others = set(multiprocessing.active_children())
            self._workers = Workers(1)
            self._loading = self._workers.submit(_load)
            self._processes = set(multiprocessing.active_children()) - others
        return self._workers


def _useful(known: Future[Outcome] | None) -> bool:
    """Whether a result is there or will come; where the system ended the process it is tried again."""
    if known is None or known.cancelled():
        return False
    return not known.done() or (known.exception() is None and not known.result().ended)


def _hand_on(done: Future[Outcome], promised: Future[Outcome], if_ended: Outcome) -> None:
    with suppress(InvalidStateError):  # it was stopped
        if done.cancelled():
            promised.cancel()
        elif isinstance(error := done.exception(), BrokenProcessPool):
            promised.set_result(if_ended)
        elif error is not None:
            promised.set_exception(error)
        else:
            promised.set_result(done.result())


def _measure(experiment: Experiment, views: tuple[Path, ...]) -> Remeasured:
    begun = time.perf_counter()
    more = {"observe_each": _remembering(experiment.rig_name)} if experiment.rig.several_views else {}
    found = measure_repetition(experiment, views, None, **more)
    return Remeasured(found, time.perf_counter() - begun)


def _simulate(experiment: Experiment, model: Model, measurement: Measurement) -> Beside:
    try:
        twin = twin_of(experiment, model=model, measurements=[measurement])
    except RigtwinError as error:
        return Beside(refused=str(error))
    rows = deviations(
        experiment.id,
        experiment.rig_name,
        measurement.quantities,
        list(twin.evaluation.quantities),
        set_from=twin.set_from,
    )
    return Beside(tuple(rows), twin_marks(measurement, twin.tracks, np.array(measurement.frame_times)))


@cache
def _remembering(rig: str) -> Callable[..., Any]:
    """What observes a photo of this rig, and does not do so again for the same photo and settings."""
    observe = import_module(f"rigtwin.measure.{rig}.observe").observe_photo
    known: OrderedDict[Any, Any] = OrderedDict()

    def observed(photo: Path, image: Image, *settings: Any) -> Any:
        key = (photo, photo.stat().st_mtime_ns, settings)
        if key not in known:
            known[key] = observe(photo, image, *settings)
            while len(known) > PHOTOS_KEPT:
                known.popitem(last=False)
        known.move_to_end(key)
        return known[key]

    return observed


def _load() -> None:
    for rig in ("drop", "packing", "pile"):
        import_module(f"rigtwin.measure.{rig}.measurement")


def _key(experiment: Experiment, views: Sequence[Path]) -> str:
    """A text that is the same for the same settings of these media."""
    cameras = tuple(experiment.camera_of(view) for view in views)
    state = tuple((view, view.stat().st_mtime_ns, view.stat().st_size) for view in views if view.exists())
    alone = replace(
        experiment, repetitions=(), with_rejected=(), cameras={}, rejected={}, measured=(), outside=frozenset()
    )
    return hashlib.sha256(pickle.dumps((alone, cameras, state))).hexdigest()
