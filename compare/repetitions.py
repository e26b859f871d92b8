"""Measure the repetitions of a lab's experiments, several at a time in processes of their own."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from rigtwin.lab.errors import RigtwinError
from rigtwin.lab.notebook import Experiment
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.rigs import (
    DropSettings,
    DrumSettings,
    PackingSettings,
    PendulumSettings,
    PileSettings,
    TiltSettings,
)


@dataclass(frozen=True)
class Failure:
    """A repetition that could not be measured, and why in one sentence."""

    source: Path
    message: str


@dataclass(frozen=True)
class Measured:
    """What the repetitions of one experiment gave."""

    measurements: tuple[Measurement, ...]
    failures: tuple[Failure, ...]


def measure_repetition(experiment: Experiment, views: Sequence[Path], out: Path | None) -> Measurement | Failure:
    """One repetition from its media, or from a record already tracked (CSV); pictures go into `out`."""
    try:
        return _measure(experiment, views, out)
    except RigtwinError as error:
        return Failure(views[0], str(error))


@contextmanager
def measuring(experiments: Sequence[Experiment], out: Path, workers: int | None = None) -> Iterator[Pending]:
    """Start measuring all repetitions; the block may do other work before it asks for `Pending.results`.

    Processes are spawned, never forked: a simulation may already run in this one.
    """
    jobs = [
        (experiment, views, folder)
        for experiment, place in zip(experiments, folders(experiments), strict=True)
        for views, folder in zip(experiment.repetitions, _places(experiment, out / place), strict=True)
    ]
    workers = max(1, min(workers or os.cpu_count() or 1, len(jobs)))
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_start_worker)
    try:
        with _interrupts_held():
            pending = [(item.id, pool.submit(measure_repetition, item, views, folder)) for item, views, folder in jobs]
        yield Pending(pending)
    except BrokenProcessPool:
        raise RigtwinError(
            "a measuring process ended before its time, most likely for want of memory; "
            "close other programs and run again, or measure the clips one by one."
        ) from None
    except BaseException:
        # nobody will read what is still being measured: do not let the person wait for it
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


@dataclass(frozen=True)
class Pending:
    """Measurements under way."""

    jobs: list[tuple[str, Future[Measurement | Failure]]]

    def results(self, progress: Progress = silent) -> Mapping[str, Measured]:
        """Wait for all; by experiment, repetitions in the order of the lab file."""
        found: dict[str, list[Measurement | Failure]] = {}
        for done, (name, job) in enumerate(self.jobs):
            progress("measuring repetitions", done, len(self.jobs))
            found.setdefault(name, []).append(job.result())
        progress("measuring repetitions", len(self.jobs), len(self.jobs))
        return {
            name: Measured(
                tuple(result for result in results if isinstance(result, Measurement)),
                tuple(result for result in results if isinstance(result, Failure)),
            )
            for name, results in found.items()
        }


def folders(experiments: Sequence[Experiment]) -> list[str]:
    """A folder name for each experiment: its id, where the id can be one.

    Ids that come out the same are told apart by a number.
    """
    names: list[str] = []
    for experiment in experiments:
        name = re.sub(r"[^\w.-]+", "_", experiment.id).lstrip(".") or "experiment"
        same = sum(earlier.split("~")[0].lower() == name.lower() for earlier in names)
        names.append(f"{name}~{same + 1}" if same else name)
    return names


def _places(experiment: Experiment, folder: Path) -> list[Path]:
    """One folder for all repetitions, unless files of the same name would overwrite each other's pictures."""
    stems = [view.stem.lower() for views in experiment.repetitions for view in views]
    if len(set(stems)) == len(stems):
        return [folder] * len(experiment.repetitions)
    return [folder / f"r{number:02d}" for number in range(1, len(experiment.repetitions) + 1)]


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Processes started inside begin with Ctrl-C held back, until they are ready to die of it without a traceback."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_worker() -> None:
    """Ctrl-C ends a worker at once and without words; the main process does the talking."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    import cv2

    cv2.setNumThreads(1)  # the pool already uses every core


def _measure(experiment: Experiment, views: Sequence[Path], out: Path | None) -> Measurement:
    rig, camera = experiment.rig, experiment.camera
    ruler = import_module(f"rigtwin.measure.{rig.name}")
    media = list(views) if isinstance(rig, (PackingSettings, PileSettings)) else views[0]
    measurement: Measurement = ruler.measure(media, camera, **known(experiment), out=out, progress=silent)
    return measurement


def known(experiment: Experiment) -> dict[str, Any]:
    """What the ruler of the experiment's rig is told beforehand, by keyword."""
    rig, particle = experiment.rig, experiment.particle
    told: dict[str, Any] = {"bead_diameter": particle.diameter}
    match rig:
        case DropSettings():
            return told | {"bead_density": particle.effective_density}
        case PendulumSettings():
            return told | {"variant": rig.variant, "length": rig.length, "bead_mass": particle.mass}
        case TiltSettings():
            return told | {"variant": rig.variant, "arm_length": rig.arm_length}
        case PackingSettings():
            return told | {"cylinder_diameter": rig.cylinder_diameter, "total_mass": rig.total_mass}
        case PileSettings():
            return told | {"base_diameter": rig.base_diameter}
        case DrumSettings():
            return told | {"drum_diameter": rig.drum_diameter, "speed": rig.speed}
    return told | {"bin_width": rig.bin_width, "total_mass": rig.total_mass}
