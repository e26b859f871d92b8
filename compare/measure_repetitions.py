"""Measure the repetitions of the experiments of a lab in parallel processes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from rigtwin.compare.worker_processes import interrupts_held, spawned
from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.rigs import (
    DropSettings,
    DrumSettings,
    HopperSettings,
    PackingSettings,
    PendulumSettings,
    PileSettings,
    TiltSettings,
)


@dataclass(frozen=True)
class Failure:
    """A repetition that could not be measured, with the reason in one sentence."""

    source: Path
    message: str


@dataclass(frozen=True)
class Measured:
    """Results of the repetitions of one experiment."""

    measurements: tuple[Measurement, ...]
    failures: tuple[Failure, ...]


def measure_repetition(experiment: Experiment, views: Sequence[Path], out: Path | None) -> Measurement | Failure:
    """Measure one repetition from its media, or from a tracked record (CSV); pictures are written into `out`."""
    try:
        return _measure(experiment, views, out)
    except RigtwinError as error:
        return Failure(views[0], str(error))


@contextmanager
def measuring(experiments: Sequence[Experiment], out: Path, workers: int | None = None) -> Iterator[Pending]:
    """Start measuring all repetitions; the block may do other work before it calls `Pending.results`."""
    jobs = [
        (experiment, views, folder)
        for experiment, place in zip(experiments, folders(experiments), strict=True)
        for views, folder in zip(experiment.repetitions, _places(experiment, out / place), strict=True)
    ]
    with spawned(len(jobs), workers) as pool:
        with interrupts_held():
            # the views of a pile are one long job: start it first, so that the others run beside it
            longest_first = sorted(range(len(jobs)), key=lambda k: -len(jobs[k][1]))
            started = {k: pool.submit(measure_repetition, *jobs[k]) for k in longest_first}
        yield Pending([(jobs[k][0].id, started[k]) for k in range(len(jobs))])


@dataclass(frozen=True)
class Pending:
    """Measurements under way."""

    jobs: list[tuple[str, Future[Measurement | Failure]]]

    def results(self, progress: Progress = silent) -> Mapping[str, Measured]:
        """Wait for all measurements; by experiment, with the repetitions in the order of the lab file."""
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
    """A folder name for each experiment: its id with special characters replaced.

    Equal names are distinguished by a number.
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


def _measure(experiment: Experiment, views: Sequence[Path], out: Path | None) -> Measurement:
    from rigtwin.measure.geometry.calibration_board import straightened

    rig, camera = experiment.rig, straightened(experiment.camera)
    if isinstance(rig, PileSettings) and rig.variant == "emptying":
        _need_sections(views)
    ruler = import_module(f"rigtwin.measure.{rig.name}.measurement")
    media = list(views) if isinstance(rig, (PackingSettings, PileSettings)) else views[0]
    measurement: Measurement = ruler.measure(media, camera, **known(experiment), out=out, progress=silent)
    return measurement


def _need_sections(views: Sequence[Path]) -> None:
    for view in views:
        if view.suffix.lower() != ".csv":
            raise BadInput(
                f"{view}: a photo from outside does not show the crater of an emptied container; give a CSV file of "
                "its surface in a section through the axis as x_m,height_m, with both halves set back to back: x from "
                "the wall (0) to the edges of the hole."
            )


def known(experiment: Experiment) -> dict[str, Any]:
    """Keyword arguments of the `measure` function of the experiment's rig, from the lab file."""
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
            filled = {"total_mass": filling(experiment), "bead_density": particle.effective_density}
            return told | {"cylinder_diameter": rig.cylinder_diameter, "spheres": particle.shape is None} | filled
        case PileSettings():
            drained = rig.drain_diameter or 0.0 if rig.variant == "emptying" else 0.0
            return told | {"base_diameter": rig.base_diameter - drained}
        case DrumSettings():
            return told | {"drum_diameter": rig.drum_diameter, "speed": rig.speed}
    return told | {"bin_width": rig.bin_width, "total_mass": filling(experiment)}


def filling(experiment: Experiment) -> float | None:
    """Mass [kg] in a cylinder or hopper: as weighed, else the count times the mass of a particle; None if unknown."""
    rig = experiment.rig
    if not isinstance(rig, (PackingSettings, HopperSettings)):
        return None
    if rig.total_mass is None and rig.count is not None:
        return rig.count * experiment.particle.mass
    return rig.total_mass
