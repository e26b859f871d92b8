"""Compare a lab with its twins: measure every repetition, run the matching twins, write deviations and a report.

::

    lab.toml ── measure all repetitions ──┐
        └────── run each rig's twin ──────┴── deviations ── observations.csv, deviations.csv/.json,
                                                            report.html, figures/, methods.md,
                                                            references.bib, provenance.json
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare import result_files
from rigtwin.compare.campaign.campaign import run_all
from rigtwin.compare.campaign.runners import Runner, runner
from rigtwin.compare.campaign.twin_runs import twin_from, twin_run
from rigtwin.compare.chosen import chosen, known_scatter
from rigtwin.compare.comparison import Comparison, Outcome
from rigtwin.compare.curve_overlays import comparable
from rigtwin.compare.deviation import deviations, over_views
from rigtwin.compare.interrupted import note_on_interrupt
from rigtwin.compare.kept_measurements import FOLDER as KEPT
from rigtwin.compare.measure_repetitions import Measured, folders, measuring
from rigtwin.compare.preflight import preflight
from rigtwin.compare.twins.imported import imported_for
from rigtwin.compare.twins.matched import (
    as_seen,
    checkpoints,
    set_by_hand,
    twin_of,
)
from rigtwin.compare.twins.registry import entry_of
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import BadInput, Claimed, SimulationFailed, TwinLacks
from rigtwin.lab.file.lab_file import Experiment, Lab, read_lab
from rigtwin.lab.file.model_file import Model, read_model
from rigtwin.lab.materials import KnownContact, pair
from rigtwin.lab.output_files import remove_leftovers
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.spelling import suggestion

if TYPE_CHECKING:
    from rigtwin.compare.report.figure_file import FigureFile
    from rigtwin.sim.engine.contact import Rolling


UNFINISHED = "unfinished"  # folder in the output folder with checkpoints of running twins
RUNS = "runs"  # folder in the output folder with the store of twins that run side by side


def compare(
    lab_folder: Path,
    out: Path,
    progress: Progress = silent,
    *,
    only: Sequence[str] | None = None,
    count: int | None = None,
    seed: int = 1,
    runs: int = 1,
    threads: int | None = None,
    workers: int | None = None,
    model: Path | None = None,
    stiffness_factor: float | None = None,
    rolling: Rolling | None = None,
    simulated: Mapping[str, Path] | None = None,
    cluster: str | None = None,
    allow_outside: bool = False,
    again: bool = False,
) -> Comparison:
    """Compare a lab with its twins and write the results.

    Parameters
    ----------
    lab_folder : Path
        Folder with a lab.toml.
    out : Path
        Folder for observations.csv, deviations.csv, deviations.json, report.html, methods.md, references.bib,
        provenance.json, figures and pictures.
    progress : Progress
        Called with step, number and count.
    only : sequence of str, optional
        Names of the experiments; all by default.
    count : int, optional
        Number of particles of twins of many particles where lab.toml states none.
    seed : int
        Seed of the first run of a twin.
    runs : int
        Number of runs of each twin of many particles, with seeds from `seed` upwards.  Several runs are computed side
        by side, each by one thread, and kept in ``out/runs``.
    threads : int, optional
        CPU threads of a simulation, or number of runs at a time; all by default.
    workers : int, optional
        Number of measuring processes, one for each core by default.
    model : Path, optional
        A model.toml, whose contacts and effects take precedence over those of lab.toml.
    stiffness_factor : float, optional
        Factor on the moduli in twins of many particles.
    rolling : Rolling, optional
        Rolling resistance law of twins of many particles.
    simulated : mapping of str to Path, optional
        For experiments by name the folder of a deck that another code has computed; it takes the place of the twin.
    cluster : str, optional
        A cluster for the twins of many particles, as in `rigtwin.compare.campaign.runners.runner`.
    allow_outside : bool
        Whether the lab may name files outside its folder.
    again : bool
        Whether repetitions are measured again whose measurements are kept in `out`.

    Returns
    -------
    Comparison
        Outcomes of all experiments and the written files.

    Raises
    ------
    BadInput
        If no repetition of an experiment can be measured, an option applies to no experiment, or `out` holds results
        of other experiments.
    BadLabFile
        If lab.toml is not valid.

    Notes
    -----
    A repetition that cannot be measured is left out with a warning; an experiment whose twin lacks something, or fails,
    has no simulated values.  Measurements are kept in ``out/measured``.  After an error the files of an earlier run are
    unchanged.  The next call continues an interrupted one: a single run of a twin of many particles from its state in
    ``out/unfinished``, several runs with those that ``out/runs`` does not contain.
    """
    started, clock = datetime.now(UTC), time.perf_counter()
    lab = read_lab(lab_folder, allow_outside=allow_outside)
    experiments = chosen(lab, only)
    remarks = [*_stale(lab, experiments, out)]
    if model is not None:
        given = read_model(model)
        lab = _under(lab, given)
        remarks += _made_for_others(model, given, experiments)
    _need_takers(
        lab, experiments, count=count, runs=runs, stiffness_factor=stiffness_factor, rolling=rolling, cluster=cluster
    )
    where = None
    if runs > 1 or cluster is not None:
        where = runner(cluster, threads, out / RUNS, option="--threads")
    twins, more = _imported(lab, experiments, simulated or {})
    remarks += more
    lacking = preflight(lab, experiments, count=count)
    lacking = {name: why for name, why in lacking.items() if name not in twins}
    settings = {"count": count, "threads": threads, "stiffness_factor": stiffness_factor, "rolling": rolling}
    with result_files.claimed(out):
        for place in (*folders(experiments), KEPT):
            remove_leftovers(out / place)
        ran = _measured_and_run(
            lab,
            experiments,
            out,
            workers,
            settings,
            twins,
            lacking,
            again=again,
            seeds=range(seed, seed + runs),
            where=where,
            clock=clock,
            progress=progress,
        )
        outcomes = tuple(_outcome(experiment, ran, count) for experiment in experiments)
        comparison = Comparison(lab, outcomes, seed, started, ran.seconds, remarks=tuple(remarks))
        written = _written(comparison, out, clock, progress)
        for experiment in experiments:
            for kept in checkpoints(out / UNFINISHED, experiment):
                kept.unlink(missing_ok=True)
        with suppress(OSError):  # it holds other twins, or does not exist
            (out / UNFINISHED).rmdir()
    return written


@dataclass(frozen=True)
class _Ran:
    """Measurements and twins of the experiments, by name."""

    measured: Mapping[str, Measured]
    twins: dict[str, list[Twin]]
    without: dict[str, str]
    """Why an experiment has no twin."""
    lost: dict[str, dict[int, str]]
    """Why runs of a twin failed, by seed, where others did not."""
    filmed: dict[str, Experiment]
    """The experiments with the settings that their media show."""
    seen: dict[str, str]
    """What the twins take from the media, in words."""
    seconds: dict[str, float]


def _measured_and_run(
    lab: Lab,
    experiments: Sequence[Experiment],
    out: Path,
    workers: int | None,
    settings: Mapping[str, Any],
    imported: Mapping[str, list[Twin]],
    lacking: Mapping[str, str],
    *,
    again: bool,
    seeds: range,
    where: Runner | None,
    clock: float,
    progress: Progress,
) -> _Ran:
    """Measure the experiments and run their twins, but for `imported` ones and those that are `lacking` something.

    Twins of many particles are runs of a campaign if `where` is given.
    """
    twins, without = dict(imported), dict(lacking)
    lost: dict[str, dict[int, str]] = {}
    filmed, seen = {one.id: one for one in experiments}, dict.fromkeys((one.id for one in experiments), "")

    def run(waiting: Sequence[Experiment], measured: Mapping[str, Measured], progress: Progress) -> None:
        """Run the twins of the experiments that are `waiting` for nothing any more."""
        if where is not None:
            many = [one for one in waiting if entry_of(one).many_particles]
            done, failed = _side_by_side(lab, many, out / RUNS, settings, seeds, where, progress)
            twins.update(done)
            for name, why in failed.items():
                if name in done:
                    lost[name] = why
                else:
                    without[name] = f"the twin failed: {next(iter(why.values()))}"
        for one in waiting:
            if one.id in twins or one.id in without:
                continue
            found = measured[one.id].measurements if one.id in measured else ()
            try:
                twins[one.id] = [
                    twin_of(
                        one, model=lab.model, seed=seeds[0], kept_in=out / UNFINISHED, progress=progress,
                        measurements=found, **settings,
                    )
                ]  # fmt: skip
            except Claimed:
                raise
            except TwinLacks as error:
                without[one.id] = str(error).rstrip(".")
            except (BadInput, SimulationFailed) as error:
                without[one.id] = f"the twin failed: {str(error).rstrip('.')}"

    with note_on_interrupt(out / UNFINISHED, lambda: _note_of_kept_twins(out / UNFINISHED, experiments)):
        wanted = [one for one in experiments if one.id not in twins and one.id not in without]
        early = [one for one in wanted if not entry_of(one).needs_measurement(one)]
        with measuring(experiments, out, workers, again=again) as pending:
            run(early, {}, pending.keeping(progress))
            measured = pending.results(progress)
        measured_after = time.perf_counter() - clock
        for experiment in experiments:
            measured[experiment.id].need_known()
        late = [one for one in wanted if one not in early]
        for one in late:
            try:
                filmed[one.id], seen[one.id] = as_seen(one, measured[one.id].measurements, settings["count"])
            except BadInput as error:
                without[one.id] = str(error).rstrip(".")
        run([filmed[one.id] for one in late if one.id not in without], measured, progress)
    seconds = {f"twin of {name}": sum(twin.seconds for twin in runs) for name, runs in twins.items()}
    seconds["measuring, beside early twins"] = measured_after
    return _Ran(measured, twins, without, lost, filmed, seen, seconds)


def _side_by_side(
    lab: Lab,
    experiments: Sequence[Experiment],
    store: Path,
    settings: Mapping[str, Any],
    seeds: range,
    where: Runner,
    progress: Progress,
) -> tuple[dict[str, list[Twin]], dict[str, dict[int, str]]]:
    """Twins of many particles by experiment, one for each seed, and why other seeds failed; finished ones are kept."""
    options = {name: value for name, value in settings.items() if name != "threads"}  # each run has one
    names = {one.id: {seed: f"{one.id}, seed {seed}" for seed in seeds} for one in experiments}
    runs = [
        twin_run(name, one, lab.model, seed=seed, **options)
        for one in experiments
        for seed, name in names[one.id].items()
    ]
    done = run_all(runs, store, runner=where, progress=progress)
    done.raise_faults()
    twins, failed = {}, {}
    for one in experiments:
        mine = names[one.id]
        if finished := [twin_from(done.results[name]) for name in mine.values() if name in done.results]:
            twins[one.id] = finished
        if lost := {seed: done.failures[name].rstrip(".") for seed, name in mine.items() if name in done.failures}:
            failed[one.id] = lost
    return twins, failed


def _imported(
    lab: Lab, experiments: Sequence[Experiment], folders: Mapping[str, Path]
) -> tuple[dict[str, list[Twin]], list[str]]:
    """Twins that other codes have computed, by experiment, and remarks on them."""
    twins: dict[str, list[Twin]] = {}
    remarks: list[str] = []
    known = {experiment.id: experiment for experiment in experiments}
    for name, folder in folders.items():
        if name not in known:
            raise BadInput(f"--simulated: there is no experiment {name!r} here; {suggestion(name, list(known))}.")
        twin, said = imported_for(known[name], folder, lab.model)
        twins[name] = [twin]
        remarks += said
    return twins, remarks


def _note_of_kept_twins(folder: Path, experiments: Sequence[Experiment]) -> str:
    """What an interrupt between two twins says of those that have run; a running twin adds its own note."""
    kept = any(checkpoints(folder, one) for one in experiments)
    return f"twins that have run are kept in {folder}; the same command continues from there." if kept else ""


def observations(comparison: Comparison) -> list[dict[str, Any]]:
    """Return the rows of ``observations.csv``: every quantity of every repetition, measured and simulated.

    Parameters
    ----------
    comparison : Comparison
        Comparison whose quantities become rows.

    Returns
    -------
    list of dict
        One row each, with `rigtwin.compare.result_files.OBSERVATION_COLUMNS`.
    """
    rows = []
    for outcome in comparison.outcomes:
        name, rig = outcome.experiment.id, outcome.experiment.rig_name
        rows += outcome.measured.observations(comparison.lab)
        seeds = (seed for seed in itertools.count(comparison.seed) if seed not in outcome.lost_runs)
        for number, twin in zip(seeds, outcome.twins, strict=False):
            by = twin.settings.get("engine", {}).get("computed_by")
            seed = twin.settings.get("seed") if by else number
            run = f"twin{f' by {by}' if by else ''}, seed {seed}"
            rows += [result_files.observation(name, rig, "simulated", run, item) for item in twin.evaluation.quantities]
    return rows


def provenance(comparison: Comparison, figures: Sequence[FigureFile] = ()) -> dict[str, Any]:
    """Return the content of ``provenance.json``: versions, inputs with checksums, model, twins, cameras and figures.

    Parameters
    ----------
    comparison : Comparison
        Comparison that the document describes.
    figures : sequence of FigureFile
        The figures of its page.

    Returns
    -------
    dict
        Object that is written as JSON.
    """
    lab = comparison.lab
    media = [view for outcome in comparison.outcomes for views in outcome.experiment.repetitions for view in views]
    return {
        **result_files.surroundings(),
        "started": comparison.started.isoformat(timespec="seconds"),
        "seconds": {name: round(value, 3) for name, value in comparison.seconds.items()},
        "seed": comparison.seed,
        "inputs": [
            {"file": result_files.relative(path, lab.folder), "sha256": sha256(path)}
            for path in dict.fromkeys([lab.path, *lab.stl_files, *media])
        ],
        "model": {
            "materials": {name: asdict(material) for name, material in lab.model.materials.items()},
            "particles": {name: asdict(particle) for name, particle in lab.model.particles.items()},
            "contacts": {"-".join(names): asdict(contact) for names, contact in lab.model.contacts.items()},
            "effects": {name: dict(values) for name, values in lab.model.effects.items()},
        },
        "borrowed": list(lab.borrowed),
        "twins": {outcome.experiment.id: [twin.settings for twin in outcome.twins] for outcome in comparison.outcomes},
        "cameras": {
            outcome.experiment.id: [item.camera for item in outcome.measurements] for outcome in comparison.outcomes
        },
        "figures": [{"caption": one.caption, "files": list(one.files.values())} for one in figures],
    }


def _written(comparison: Comparison, out: Path, clock: float, progress: Progress) -> Comparison:
    from rigtwin.compare.report.figure_file import figure_files
    from rigtwin.compare.report.methods import methods
    from rigtwin.compare.report.page import drawn_figures, report

    progress("writing the report", 0, 1)
    comparison.seconds["total before the report"] = time.perf_counter() - clock
    drawn = drawn_figures(comparison)
    figures = [one for ones in drawn.values() for one in ones]
    record = result_files.plain(provenance(comparison, figures))
    text = methods(comparison, record["versions"])
    drawings = figure_files("report", figures)
    names = (
        "observations.csv", "deviations.csv", "deviations.json", "report.html", "provenance.json", "methods.md",
        "references.bib",
    )  # fmt: skip
    comparison.files.update({name: out / name for name in (*names, result_files.FIGURES)})
    contents = {
        "observations.csv": result_files.table(observations(comparison), result_files.OBSERVATION_COLUMNS),
        "deviations.csv": result_files.deviations_csv(comparison.deviations),
        "deviations.json": result_files.document(comparison.to_json()),
        "report.html": report(comparison, record, out, drawn, text),
        "provenance.json": result_files.document(record),
        "methods.md": text.markdown,
        "references.bib": text.bibtex,
        **drawings,
    }
    result_files.write_together(out, contents)
    progress("writing the report", 1, 1)
    return comparison


def _under(lab: Lab, model: Model) -> Lab:
    """The lab with the contacts of a model, which take precedence over its own, and the effects of the model."""
    contacts = dict(lab.model.contacts)
    for names, known in model.contacts.items():
        contacts[names] = known.filled(contacts.get(names, KnownContact()))
    return replace(lab, contacts=contacts, model=replace(lab.model, contacts=contacts, effects=model.effects))


def _stale(lab: Lab, experiments: Sequence[Experiment], out: Path) -> Iterator[str]:
    """A remark if `out` holds results of experiments that lab.toml no longer contains.

    Raises `BadInput` if it holds results of other experiments, which would be lost.
    """
    asked, known = ([one.id for one in each] for each in (experiments, lab.experiments))
    if others := result_files.others_before(out, "deviations.json", lab.path, asked, known):
        yield f"{', '.join(others)}: no longer in {lab.path.name} nor in these tables; a folder of pictures may be left"


def _made_for_others(file: Path, model: Model, experiments: Sequence[Experiment]) -> Iterator[str]:
    """A remark for each experiment without any contact of the model, whose effects were then found for other pairs."""
    theirs = ", ".join("-".join(names) for names in model.contacts)
    acting = f"; its effects ({', '.join(model.effects)}) still act in this twin" if model.effects else ""
    for experiment in experiments:
        if model.contacts and not any(pair(*names) in model.contacts for names in experiment.contacts):
            mine = ", ".join("-".join(names) for names in experiment.contacts)
            yield f"{experiment.id}: {file.name} has contacts of {theirs} and none of {mine}{acting}"


def _need_takers(
    lab: Lab,
    experiments: Sequence[Experiment],
    *,
    count: int | None,
    runs: int,
    stiffness_factor: float | None,
    rolling: Rolling | None,
    cluster: str | None,
) -> None:
    """Raise `BadInput` for an option that applies to no twin."""
    few = not any(entry_of(one).many_particles for one in experiments)
    idle = {
        "--count: there is no experiment with many particles whose number lab.toml does not state": count is not None
        and not any(entry_of(one).takes_count(one) for one in experiments),
        "--runs: no experiment has many particles": runs > 1 and few,
        "--stiffness-factor: no experiment has many particles": stiffness_factor is not None and few,
        "--rolling-model: no experiment has many particles": rolling is not None and few,
        "--cluster: no experiment has many particles": cluster is not None and few,
    }
    for what, given in idle.items():
        if given:
            raise BadInput(f"{lab.path}: {what} ({', '.join(one.id for one in experiments)}); leave it out.")


def _outcome(experiment: Experiment, ran: _Ran, count: int | None) -> Outcome:
    entry, measured = entry_of(experiment), ran.measured[experiment.id]
    twins = ran.twins.get(experiment.id, [])
    sound = [twin for twin in twins if not twin.failed]
    # the deck of another code states all settings
    own = sound and not sound[0].settings.get("engine", {}).get("computed_by")
    without = ran.without.get(experiment.id, "")
    if twins and not sound:
        without = f"the twin failed: {twins[0].failed}"
    rows = deviations(
        experiment.id,
        experiment.rig_name,
        measured.quantities,
        [quantity for twin in sound for quantity in over_views(twin.evaluation.quantities)],
        set_from=sound[0].set_from if sound else set_by_hand(experiment),
        run_name=entry.run_name,
        without_twin=without,
        assumed=entry.assumed(ran.filmed[experiment.id], count) if own else (),
        seen=ran.seen[experiment.id],
        scatter=partial(known_scatter, experiment),
        failed_checks=measured.failed_beside,
    )
    shapes = comparable(entry.curves(experiment, measured.measurements, sound)) if sound else ()
    return Outcome(
        experiment,
        measured.measurements,
        measured.failures,
        tuple(twins),
        rows,
        shapes,
        without_twin=without,
        lost_runs=ran.lost.get(experiment.id, {}),
        from_media=ran.seen[experiment.id],
    )
