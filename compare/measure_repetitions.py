"""Measure the repetitions of the experiments of a lab in parallel processes, and add what lab.toml states."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import Future, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from rigtwin.compare.deviation import MOMENTS, Key, combine, group, key_of, over_views
from rigtwin.compare.kept_measurements import KeptMeasurements
from rigtwin.compare.result_files import observation, relative
from rigtwin.compare.twins.matched import measured_start, stated_start
from rigtwin.compare.twins.registry import entry_of
from rigtwin.compare.worker_processes import spawned
from rigtwin.lab.errors import BadInput, RigtwinError, Seen
from rigtwin.lab.file.lab_file import Experiment, Lab
from rigtwin.lab.file.option_names import naming_lab_keys
from rigtwin.lab.formatting import few_of, reading, siblings, title
from rigtwin.lab.input_files import unquoted
from rigtwin.lab.materials import heavier_than_its_solid
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import CheckLine, Measurement, Quantity, check_lines, reworded
from rigtwin.lab.rig_quantities import quantities_of
from rigtwin.lab.tracked.table import is_table

CERTAINLY = 4.0
"""Standard uncertainties beyond which a film shows another value than the stated one."""
BY_HAND = 0.05
"""Relative difference of a stated value that hand and ruler explain; assumed."""


@dataclass(frozen=True)
class Failure:
    """A repetition that could not be measured, with the reason in one sentence."""

    source: Path
    message: str
    seen: Seen | None = None
    """What was found in the picture, where there is one."""
    picture: Path | None = None
    """The picture that was written and that the message names."""


@dataclass(frozen=True)
class Measured:
    """Results of the repetitions of one experiment, and those that lab.toml states."""

    experiment: Experiment
    measurements: tuple[Measurement, ...]
    failures: tuple[Failure, ...]

    @property
    def known(self) -> bool:
        """Whether anything was measured or is stated."""
        return bool(self.measurements or self.experiment.measured)

    def need_known(self) -> None:
        """Refuse an experiment of which no repetition could be measured and nothing is stated.

        Raises
        ------
        BadInput
            With the reason of the first failure.
        """
        if self.known or not self.failures:
            return
        first, *others = self.failures
        which = f"none of its {len(others) + 1} repetitions" if others else "its only repetition"
        verb = "could be measured" if others else "could not be measured"
        raise BadInput(f"{self.experiment.id}: {which} {verb}: {first.message}")

    @property
    def quantities(self) -> list[Quantity]:
        """Stated quantities, then those of all repetitions that they do not replace, the views of each combined."""
        stated = self.experiment.measured
        found = (quantity for item in self.measurements for quantity in over_views(item.quantities))
        return [*stated, *(one for one in found if not any(replaces(other, one, self.experiment) for other in stated))]

    @property
    def failed_checks(self) -> list[CheckLine]:
        """The checks that failed in a repetition or in several."""
        return _failed(self.measurements)

    def failed_beside(self, key: Key) -> list[CheckLine]:
        """The checks that failed in the repetitions of which a value is the mean.

        Parameters
        ----------
        key : tuple
            The quantity, as of `rigtwin.compare.deviation.key_of`.

        Returns
        -------
        list of CheckLine
            None for a value that is stated.
        """
        if any(key_of(one) == key for one in self.experiment.measured):
            return []
        having = [(item, group(over_views(item.quantities)).get(key, [])) for item in self.measurements]
        sound = [item for item, values in having if any(not one.doubtful for one in values)]
        return _failed(sound or [item for item, values in having if values])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was rejected, failed, doubtful or replaced, and the warnings of each repetition with its file's name."""
        # a published particle is as its table prints it: nothing that the user could check
        own = self.experiment.own_particle
        return (
            *filter(None, (heavier_than_its_solid(self.experiment.particle) if own else "",)),
            *rejections(self.experiment),
            *(f"{failure.source.name} was left out: {failure.message}" for failure in self.failures),
            *_of_files(self.measurements),
            *_left_out(self.measurements),
            *_replaced(self.experiment, self.measurements),
            *_contradicted(self.experiment, self.measurements),
        )

    def observations(self, lab: Lab) -> list[dict[str, Any]]:
        """Return rows of ``measurements.csv`` and ``observations.csv``: every quantity measured, then those stated.

        Parameters
        ----------
        lab : Lab
            The lab, in whose folder the files are named.

        Returns
        -------
        list of dict
            One row each, with `rigtwin.compare.result_files.OBSERVATION_COLUMNS`.
        """
        name, rig = self.experiment.id, self.experiment.rig_name
        rows = []
        for item in self.measurements:
            source = relative(item.source, lab.folder)
            rows += [observation(name, rig, "measured", source, quantity) for quantity in item.quantities]
        return rows + [observation(name, rig, "stated", lab.path.name, one) for one in self.experiment.measured]

    def to_json(self) -> dict[str, Any]:
        """The part of an experiment in ``measurements.json`` and ``deviations.json``."""
        return {
            "id": self.experiment.id,
            "rig": self.experiment.rig_name,
            "stated": [quantity.to_json() for quantity in self.experiment.measured],
            "measurements": [item.to_json() for item in self.measurements],
            "failures": [{"file": str(item.source), "message": item.message} for item in self.failures],
            "rejected": [{"file": str(file), "reason": why} for file, why in self.experiment.rejected.items()],
        }


def rejections(experiment: Experiment) -> list[str]:
    """Return a warning for each file that lab.toml names but rejects.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose files are checked.

    Returns
    -------
    list of str
        Warnings, one for each rejected file.
    """
    return [f"{file.name} is rejected in lab.toml: {why}" for file, why in experiment.rejected.items()]


def replaces(stated: Quantity, found: Quantity, experiment: Experiment) -> bool:
    """Return whether a stated quantity replaces one from media.

    Parameters
    ----------
    stated : Quantity
        Quantity as lab.toml states it.
    found : Quantity
        Quantity as measured from media.
    experiment : Experiment
        Its rig decides which methods there are.

    Returns
    -------
    bool
        Whether it is the same quantity, by the same method or by the only one.
    """
    (name, *same), (other, *others) = key_of(stated), key_of(found)
    only = len(quantities_of(experiment.rig)[stated.quantity].methods) == 1
    return name == other and (same[1:] == others[1:] if only else same == others)


def measure_repetition(
    experiment: Experiment, views: Sequence[Path], out: Path | None, **more: Any
) -> Measurement | Failure:
    """Measure one repetition from its media, or from a tracked record (CSV).

    Parameters
    ----------
    experiment : Experiment
        Experiment of the repetition.
    views : sequence of Path
        Media of the repetition; several for a rig at rest.
    out : Path or None
        Folder for pictures; None writes none.
    **more : object
        Further keyword arguments of the rig's `measure`.

    Returns
    -------
    Measurement or Failure
        The measurement, or why there is none.
    """
    try:
        with (
            naming_lab_keys(experiment.rig_name, experiment.particle_place),
            unquoted(views[0], outside=is_table(views[0]) and not experiment.outside.isdisjoint(views)),
        ):
            measurement: Measurement = reworded(_measure(experiment, views, out, **more))
            return measurement
    except RigtwinError as error:
        if isinstance(error, BadInput):
            return Failure(views[0], str(error), error.seen, error.picture)
        return Failure(views[0], str(error))


@contextmanager
def measuring(
    experiments: Sequence[Experiment],
    out: Path,
    workers: int | None = None,
    *,
    again: bool = False,
    only: Collection[Experiment] | None = None,
) -> Iterator[Pending]:
    """Start measuring all repetitions; the block may do other work before it calls `Pending.results`.

    Parameters
    ----------
    experiments : sequence of Experiment
        Experiments whose repetitions are measured.
    out : Path
        Folder of results, in which measurements are kept.
    workers : int, optional
        Number of processes.  Default: one per core.
    again : bool
        Whether repetitions are measured again whose measurements are kept.
    only : collection of Experiment, optional
        Those whose repetitions are measured; of the others only what is kept is taken.

    Yields
    ------
    Pending
        The measurements under way.

    Raises
    ------
    BadInput
        If `workers` is not a whole number from 1 upwards.
    WorkerEnded
        If a process ends unexpectedly.
    """
    jobs = [
        (experiment, views, folder)
        for experiment, place in zip(experiments, folders(experiments), strict=True)
        for views, folder in zip(experiment.repetitions, _places(experiment, out / place), strict=True)
    ]
    kept = KeptMeasurements(out)
    named = {one.id for one in (experiments if only is None else only)}
    wanted = {k for k, (experiment, *_) in enumerate(jobs) if experiment.id in named}

    def key_of_job(k: int) -> str:
        experiment, views, folder = jobs[k]
        return kept.key(experiment, views, known(experiment), folder)

    keys = {k: key_of_job(k) for k in wanted}
    for k in range(len(jobs)) if kept.any else ():
        if k not in wanted:
            with suppress(OSError):  # the media of experiments that are not named may be missing
                keys[k] = key_of_job(k)
    before = {k: None if again and k in wanted else kept.find(key, jobs[k][1]) for k, key in keys.items()}
    # the views of a pile are one long job: start it first, so that the others run beside it
    new = sorted((k for k in wanted if before[k] is None), key=lambda k: -len(jobs[k][1]))
    work, less = "measured a repetition", "give shorter clips or smaller photos"
    with spawned(len(new), workers, work=work, less=less) as pool:
        started = {pool.submit(measure_repetition, *jobs[k]): k for k in new}
        done = {
            k: Failure(jobs[k][1][0], found) if isinstance(found, str) else found
            for k, found in before.items()
            if found is not None
        }
        pending = Pending(experiments, [job[0].id for job in jobs], done, started, kept, keys)
        try:
            yield pending
        except BaseException as stop:
            pending.keep_finished()
            here = len(wanted) - len(new) + len(pending.saved)
            if isinstance(stop, KeyboardInterrupt) and 0 < here < len(wanted):
                same = "the same command without --again" if again else "the same command"
                stop.add_note(f"{here} of {len(wanted)} measurements are kept; {same} measures the others.")
            raise


@dataclass(frozen=True)
class Pending:
    """Measurements under way."""

    experiments: Sequence[Experiment]
    names: Sequence[str]
    """Name of the experiment of each repetition."""
    before: Mapping[int, Measurement | Failure]
    """Results that were kept, by the number of the repetition."""
    started: Mapping[Future[Measurement | Failure], int]
    """Numbers of the repetitions that are measured."""
    kept: KeptMeasurements
    keys: Mapping[int, str]
    saved: set[int] = field(default_factory=set)
    """Numbers of the repetitions whose new measurements are kept by now."""

    def keep_finished(self) -> None:
        """Keep what is measured by now, without waiting for the rest; what failed unexpectedly is left to `results`."""
        for job, number in self.started.items():
            if number not in self.saved and job.done() and not job.cancelled() and job.exception() is None:
                self._keep(number, job.result())

    def keeping(self, progress: Progress) -> Progress:
        """Keep measurements that have ended while other work goes on.

        Parameters
        ----------
        progress : Progress
            That of the other work.

        Returns
        -------
        Progress
            The same, which keeps them before.
        """

        def both(stage: str, done: float, total: float) -> None:
            self.keep_finished()
            progress(stage, done, total)

        return both

    def _keep(self, number: int, found: Measurement | Failure) -> None:
        if isinstance(found, Failure):
            self.kept.keep(self.keys[number], found.message, found.picture)
        else:
            self.kept.keep(self.keys[number], found)
        self.saved.add(number)

    def results(self, progress: Progress = silent) -> Mapping[str, Measured]:
        """Wait for all measurements, and keep them.

        Parameters
        ----------
        progress : Progress
            Called with stage, number and count.

        Returns
        -------
        dict of str to Measured
            By experiment, with the repetitions in the order of the lab file; without those that are not measured and
            not kept.
        """
        done = dict(self.before)
        total = len(self.before) + len(self.started)
        for job in as_completed(self.started):
            progress("measuring repetitions", len(done), total)
            number = self.started[job]
            done[number] = job.result()
            if number not in self.saved:
                self._keep(number, done[number])
        progress("measuring repetitions", total, total)
        unknown = {name for number, name in enumerate(self.names) if number not in done}
        mine: dict[str, list[Measurement | Failure]] = {
            experiment.id: [] for experiment in self.experiments if experiment.id not in unknown
        }
        for number, name in enumerate(self.names):
            if name in mine:
                mine[name].append(done[number])
        return {
            experiment.id: Measured(
                experiment,
                _counted_once([result for result in mine[experiment.id] if isinstance(result, Measurement)]),
                tuple(result for result in mine[experiment.id] if isinstance(result, Failure)),
            )
            for experiment in self.experiments
            if experiment.id in mine
        }


def _failed(measurements: Sequence[Measurement]) -> list[CheckLine]:
    return [one for one in check_lines(item.checks for item in measurements) if one.passed < one.of]


def _counted_once(found: Sequence[Measurement]) -> tuple[Measurement, ...]:
    """The measurements; one with the records and numbers of an earlier one is doubtful: no two clips agree to the bit.

    Counted, a copy whose file differs (saved again, other metadata) would lower the uncertainty of a mean without a
    second measurement.
    """
    first: dict[Any, Measurement] = {}
    counted = []
    for item in found:
        numbers = tuple(
            (key_of(one), one.detail.get("view"), *(float(each).hex() for each in (one.value, one.std_uncertainty)))
            for one in item.quantities
        )
        records = (
            *(each.position.tobytes() for each in item.tracks), *(each.height.tobytes() for each in item.profiles),
            *(each.value.tobytes() for each in item.series),
        )  # fmt: skip
        original = first.setdefault((numbers, records), item)
        counted.append(item if original is item or not numbers else _doubtful_copy(item, original.source))
    return tuple(counted)


def _doubtful_copy(item: Measurement, original: Path) -> Measurement:
    name = original.name if original.name != item.source.name else f"{original.parent.name}/{original.name}"
    why = f"the same result to the last digit as {name}: copies of one clip?"
    marked = (replace(one, doubtful="; ".join(filter(None, (one.doubtful, why)))) for one in item.quantities)
    return replace(item, quantities=tuple(marked))


def folders(experiments: Sequence[Experiment]) -> list[str]:
    """Return a folder name for each experiment: its id with special characters replaced.

    Equal names are distinguished by a number.

    Parameters
    ----------
    experiments : sequence of Experiment
        Experiments that each need a folder.

    Returns
    -------
    list of str
        In their order.
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


def _measure(experiment: Experiment, views: Sequence[Path], out: Path | None, **more: Any) -> Measurement:
    from rigtwin.measure.geometry.calibration_board import straightened

    entry = entry_of(experiment)
    entry.check_media(experiment, views)
    ruler = import_module(f"rigtwin.measure.{experiment.rig.name}.measurement")
    cameras = [straightened(experiment.camera_of(view)) for view in views]
    several = experiment.rig.several_views
    measurement: Measurement = ruler.measure(
        list(views) if several else views[0],
        cameras if several else cameras[0],
        **known(experiment),
        table=experiment.table,
        out=out,
        progress=silent,
        **more,
    )
    return measurement


def known(experiment: Experiment) -> dict[str, Any]:
    """Return the keyword arguments of the rig's `measure` that the lab file states.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose entries are read.

    Returns
    -------
    dict of str to object
        In SI units, by name.
    """
    return {"bead_diameter": experiment.particle.typical.diameter, **entry_of(experiment).known(experiment)}


def _left_out(measurements: Sequence[Measurement]) -> Iterator[str]:
    """A warning for each doubtful repetition that is excluded from a mean, because there are sound ones."""
    seen = [(item.source, one) for item in measurements for one in over_views(item.quantities)]
    sound = {key for key, ones in group(one for _, one in seen).items() if not all(one.doubtful for one in ones)}
    lacking: dict[tuple[Path, str], list[str]] = {}
    for source, one in seen:
        if one.doubtful and key_of(one) in sound and one.quantity not in MOMENTS:
            lacking.setdefault((source, one.doubtful), []).append(title(one.quantity))
    alike: dict[tuple[str, str], list[str]] = {}  # one line for all repetitions with the same reason
    for (source, reason), names in lacking.items():
        alike.setdefault((reason, ", ".join(dict.fromkeys(names))), []).append(source.name)
    for (reason, names_in_words), sources in alike.items():
        are = "are" if len(sources) > 1 else "is"
        yield f"{few_of(sources)} {are} doubtful and excluded from the mean of {names_in_words}: {reason}"


def _replaced(experiment: Experiment, measurements: Sequence[Measurement]) -> Iterator[str]:
    """A warning for each stated quantity that replaces what the repetitions give, with both values."""
    for stated in experiment.measured:
        same = [
            one
            for item in measurements
            for one in over_views(item.quantities)
            if replaces(stated, one, experiment) and math.isfinite(one.value)
        ]
        if not same:
            continue
        found = combine(same)
        what = ", ".join(filter(None, (title(stated.quantity), siblings(stated.detail))))
        given, seen = (reading(one.value, one.std_uncertainty, one.unit) for one in (stated, found))
        those = f"the mean of {found.n} repetitions" if found.n > 1 else "that of a repetition"
        those += f" ({found.left_out} doubtful left out)" if found.left_out else ""
        warning = f"{what} ({stated.method}) is stated in lab.toml as {given}; {those}, {seen}, is not used"
        if found.doubtful:
            warning += ", and is doubtful"
        if _differs(found.value, math.hypot(found.std_uncertainty, stated.std_uncertainty), stated.value):
            warning += "; the two contradict each other: correct the stated value, or what the measured one rests on"
        yield warning


def _differs(found: float, std_uncertainty: float, stated: float) -> bool:
    """Whether a film or photo certainly shows another value than the stated one."""
    return abs(found - stated) > math.hypot(CERTAINLY * std_uncertainty, BY_HAND * stated)


def _contradicted(experiment: Experiment, measurements: Sequence[Measurement]) -> Iterator[str]:
    """A warning for each repetition whose start, drop height or release angle, is not the stated one."""
    stated = stated_start(experiment)
    if stated is None:
        return
    for item in measurements:
        found = measured_start(experiment, item)
        if found is None or found.doubtful:
            continue
        if _differs(found.value, found.std_uncertainty, stated):
            shown, given = (reading(value, 0.0, found.unit) for value in (found.value, stated))
            yield (
                f"{item.source.name} shows {found.quantity} = {shown}, {given} is stated: correct {found.quantity}, or "
                "look for another clip, a wrong scale or roll of the camera, or a missed early part of the motion"
            )


def _of_files(measurements: Sequence[Measurement]) -> Iterator[str]:
    """The warnings, each once, with the names of their files, unless they already name one of several views."""
    alike = Counter(item.source.name for item in measurements)
    files: dict[tuple[bool, str], dict[str, None]] = {}
    for item in measurements:
        views = {str(quantity.detail["view"]) for quantity in item.quantities if "view" in quantity.detail}
        source = item.source.name if alike[item.source.name] == 1 else f"{item.source.parent.name}/{item.source.name}"
        for warning in item.warnings:
            named = any(warning.startswith(f"{view}: ") for view in views)
            files.setdefault((bool(views), warning), {}).update({} if named else {source: None})
    for (several, warning), names in files.items():
        theirs = f" and {'their' if len(names) > 1 else 'its'} other views" if several else ""
        yield f"{few_of(list(names))}{theirs}: {warning}" if names else warning
