"""Twins over a range of parameters: a grid or a space-filling design, beside what was measured."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any

from rigtwin.compare import result_files
from rigtwin.compare.campaign.campaign import run_all
from rigtwin.compare.campaign.run import Done, Run
from rigtwin.compare.campaign.runners import runner
from rigtwin.compare.campaign.sweep_figures import figures
from rigtwin.compare.campaign.twin_runs import quantities_of, twin_run
from rigtwin.compare.campaign.vary import (
    MOST_POINTS,
    WHOLE,
    Design,
    Point,
    Setting,
    Varied,
    at,
    need_different,
    parse,
    points,
)
from rigtwin.compare.deviation import IDENTITY, deviations, is_result, key_of
from rigtwin.compare.interrupted import note_on_interrupt
from rigtwin.compare.measure_repetitions import measuring
from rigtwin.compare.report.figure_file import figure_files
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment, Lab, read_lab
from rigtwin.lab.file.schema import ExperimentEntry
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.rigs import SETTINGS
from rigtwin.lab.spelling import suggestion

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

SIMULATED = (
    "quantity", "method", *IDENTITY, "unit", "simulated", "simulated_std", "runs", "measured",
    "measured_std_uncertainty", "percent_deviation", "percent_deviation_std", "z", "doubtful", "failed",
)  # fmt: skip


@dataclass(frozen=True)
class Sweep:
    """Quantities of the twin at each point of a design."""

    setting: Setting
    varied: tuple[Varied, ...]
    points: tuple[Point, ...]
    rows: tuple[dict[str, Any], ...]
    """One for each point and quantity: the varied parameters in SI, and the columns of ``sweep.csv``."""
    failures: Mapping[str, str]
    """Why runs failed, by the name of the run."""
    runs: int
    files: dict[str, Path] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The document of `rigtwin sweep --json`."""
        experiment = self.setting.experiment
        return {
            "experiment": experiment.id,
            "rig": experiment.rig_name,
            "particle": experiment.particle.name,
            "varied": {one.name: list(one.values) for one in self.varied},
            "points": len(self.points),
            "runs": self.runs,
            "rows": list(self.rows),
            "failures": dict(self.failures),
            "remarks": list(self.remarks),
            "files": {name: str(path) for name, path in self.files.items()},
        }


def stated_setting(
    rig: str, stated: Sequence[str], *, particle: str, wall: str | None, lab: Path | None = None
) -> Setting:
    """Return the experiment of a rig without media, and the model with its contacts.

    Parameters
    ----------
    rig : str
        Name of the rig.
    stated : sequence of str
        Keys of lab.toml with their values, ``base_diameter=90mm``.
    particle, wall : str
        Names in the lab's folder, or in the published reference; a double pendulum has no wall.
    lab : Path, optional
        Lab folder whose materials, particles and contacts are known by name.

    Returns
    -------
    Setting
        Experiment and model.

    Raises
    ------
    BadInput
        If a key is missing, unknown or not possible, or a contact is not known.
    """
    from rigtwin.compare.twins import by_name

    model = by_name.model_of(lab, particle)
    bead = by_name.particle(particle, model)
    entry = _entry(rig, stated, particle, wall)
    material = None if wall is None else by_name.wall(wall, model)
    experiment = Experiment(rig, entry.settings(), bead, material, Camera(), ())
    for names in experiment.contacts:
        known = by_name.contact(*names, model, entry_of(experiment).needed(experiment))
        model = model.with_contact(
            *names,
            restitution=known.restitution,
            static_friction=known.static_friction,
            rolling_friction=known.rolling_friction,
        )
    return Setting(experiment, model)


def _entry(rig: str, stated: Sequence[str], particle: str, wall: str | None) -> ExperimentEntry:
    from pydantic import TypeAdapter, ValidationError

    keys: dict[str, Any] = {"id": rig, "rig": rig, "particle": particle}
    if wall is not None:
        keys["wall"] = wall
    for text in stated:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise BadInput(f"--set: {text!r} is not like base_diameter=90mm.")
        keys[name] = int(value) if value.isdecimal() and name in WHOLE else value
    try:
        entry: ExperimentEntry = TypeAdapter(ExperimentEntry).validate_python(keys)
    except ValidationError as error:
        mine = [one for one in error.errors() if str(one["loc"][0]).lower().startswith(rig)]
        # a misspelt key is what makes another one missing
        first = min(mine or error.errors(), key=lambda one: one["type"] != "extra_forbidden")
        key, why = str(first["loc"][-1]), str(first["msg"]).removeprefix("Value error, ").rstrip(".")
        if first["type"] == "missing":
            why = "this setting is missing (it is given here also where --vary varies it)"
        elif first["type"] == "extra_forbidden":
            settings = [field.name for field in fields(SETTINGS[rig])]
            raise BadInput(f"--set: {key}: a {rig} has no such setting; {suggestion(key, settings)}.") from None
        raise BadInput(f"--set: {key}: {why}; the settings are the keys of a {rig} in lab.toml.") from None
    for key, why in entry.faults():
        raise BadInput(f"--set: {key}: {why}")
    return entry


def lab_setting(folder: Path, only: str | None, *, allow_outside: bool = False) -> tuple[Lab, Setting]:
    """Return the experiment of a lab that is swept.

    Parameters
    ----------
    folder : Path
        Lab folder.
    only : str or None
        Name of the experiment; None: the only one of the lab.
    allow_outside : bool
        Whether the lab may name files outside its folder.

    Returns
    -------
    lab : Lab
        Lab that holds the experiment.
    setting : Setting
        Experiment and model.

    Raises
    ------
    BadInput
        If there are several experiments, or none of that name, or its twin starts from the measurement.
    """
    lab = read_lab(folder, allow_outside=allow_outside)
    known = {experiment.id: experiment for experiment in lab.experiments}
    if only is not None and only not in known:
        raise BadInput(f"{lab.path}: there is no experiment {only!r}; {suggestion(only, known)}.")
    if only is None and len(known) > 1:
        raise BadInput(f"{lab.path}: has several experiments; name one with --only ({', '.join(known)}).")
    experiment = known[only] if only is not None else lab.experiments[0]
    entry = entry_of(experiment)
    if entry.needs_measurement(experiment) and not entry.many_particles:
        keys = entry.keys_to_state(experiment)
        alone = f"sweep the rig by itself: rigtwin sweep {experiment.rig_name} --set ..."
        advice = f"state {' and '.join(keys)} in lab.toml" if keys else alone
        raise BadInput(f"{experiment.id}: its twin starts from the measurement; {advice}.")
    return lab, Setting(experiment, lab.model)


def sweep(
    setting: Setting,
    vary: Sequence[str],
    out: Path,
    progress: Progress = silent,
    *,
    lab: Lab | None = None,
    design: Design = "grid",
    number: int | None = None,
    repetitions: int = 1,
    count: int | None = None,
    seed: int = 1,
    rolling: Rolling | None = None,
    stiffness_factor: float | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Sweep:
    """Run the twin at all points of a design and write the results.

    Parameters
    ----------
    setting : Setting
        Experiment and model.
    vary : sequence of str
        Parameters with their values, ``static_friction=0.05..1.5:8`` or ``outlet=30mm,40mm``.
    out : Path
        Folder for sweep.csv, sweep.json and figures; finished runs are kept in ``out/runs`` and not run again.
    progress : Progress
        Called with step, finished cost [s] and total cost [s].
    lab : Lab, optional
        If given, the repetitions of the experiment are measured and shown beside the twins.
    design : {"grid", "sobol", "latin"}
        Kind of the design.
    number : int, optional
        Number of points of a design that is no grid.
    repetitions : int
        Runs with different seeds at each point.
    count : int, optional
        Number of particles where the experiment states none.
    seed : int
        First seed, and seed of the design.
    rolling : Rolling, optional
        Rolling resistance law.
    stiffness_factor : float, optional
        Factor on the moduli.
    workers : int, optional
        Number of processes of this machine, one for each core by default.
    cluster : str, optional
        A cluster for the runs, as in `rigtwin.compare.campaign.runners.runner`.

    Returns
    -------
    Sweep
        Rows, failures and written files.

    Raises
    ------
    BadInput
        If a parameter is unknown or a value impossible, or no run has a result.
    """
    many = entry_of(setting.experiment).many_particles
    of_many = {"--count": count, "--rolling-model": rolling, "--stiffness-factor": stiffness_factor}
    for option, value in of_many.items():
        if not many and value is not None:
            raise BadInput(f"{option}: the twin of a {setting.experiment.rig_name} has few bodies; leave it out.")
    if not many and repetitions > 1:
        raise BadInput("--repetitions: the runs of a twin of few bodies are all the same; leave it out.")
    varied = tuple(parse(text, setting.experiment) for text in vary)
    if not varied:
        raise BadInput("--vary: nothing is varied; give a parameter like static_friction=0.05..1.5:8.")
    need_different([one.name for one in varied], [setting.experiment], option="--vary")
    where = tuple(points(varied, design, number, seed))
    if (whole := len(where) * repetitions) > MOST_POINTS:
        raise BadInput(
            f"--repetitions: {len(where)} points with {repetitions} repetitions are {whole} runs; give fewer of one of "
            f"them, at most {MOST_POINTS} runs."
        )
    settings = [_checked(setting, point, count) for point in where]
    names = [[f"point-{k:04d}-seed-{seed + j}" for j in range(repetitions)] for k in range(len(where))]
    options: dict[str, Any] = {"count": count, "rolling": rolling, "stiffness_factor": stiffness_factor}
    runs = [
        twin_run(name, *moved, seed=seed + j, **options)
        for moved, mine in zip(settings, names, strict=True)
        for j, name in enumerate(mine)
    ]
    computed_by = runner(cluster, workers, out / "runs")
    measured = [] if lab is None else _measured(setting.experiment, out, workers, progress)
    done = _run(runs, out, computed_by, progress)
    kept = f"finished runs are kept in {out / 'runs'}; the same command writes the tables from them."
    with note_on_interrupt(out / "runs", lambda: kept):
        rows = [
            {**point, **row}
            for point, mine in zip(where, names, strict=True)
            for row in _rows(setting.experiment, measured, mine, done)
        ]
        remarks = (*_replaced(out, rows), *_commas(vary))
        found = Sweep(setting, varied, where, tuple(rows), done.failures, len(runs), remarks=remarks)
        drawings = figure_files("sweep", figures(varied, rows, grid=design == "grid").values())
        columns = (*(one.name for one in varied), *SIMULATED)
        found.files.update({name: out / name for name in ("sweep.csv", "sweep.json", result_files.FIGURES)})
        table, document = result_files.table(rows, columns), result_files.document(found.to_json())
        result_files.write_in_turn(out, {"sweep.csv": table, "sweep.json": document, **drawings})
    return found


def _commas(vary: Sequence[str]) -> Iterator[str]:
    """A remark on each list of values that may be one number with a decimal comma."""
    for text in vary:
        name, _, said = (part.strip() for part in text.partition("="))
        if re.fullmatch(r"0,\d+", said):
            yield f"{name}: {said} are two values, 0 and {said[2:]}; write {said.replace(',', '.')} if one is meant"


def _replaced(out: Path, rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """A remark if the tables in `out` hold rows of another sweep, which these `rows` replace."""
    try:
        before = json.loads((out / "sweep.json").read_text(encoding="utf-8"))
        points, name, varied = before["rows"], str(before["experiment"]), ", ".join(before["varied"])
    except (OSError, ValueError, LookupError, TypeError):  # no such file, or of another kind
        return
    now = json.loads(result_files.document({"rows": list(rows)}))["rows"]
    if lost := [row for row in points if row not in now]:
        yield (
            f"sweep.csv and sweep.json in {out} held {len(lost)} other rows (a sweep of {name} over {varied}), which "
            "are replaced; their runs are kept in runs/, from which the earlier command can write them again; give "
            "--out another folder to keep both tables"
        )


def _checked(setting: Setting, point: Point, count: int | None) -> Setting:
    """The setting at a point, which the twin would accept."""
    moved = at(setting, point)
    entry = entry_of(moved.experiment)
    try:
        for names in moved.experiment.contacts:
            moved.model.contact(*names, entry.needed(moved.experiment))
        filled = count or 1 if entry.many_particles and not entry.takes_count(moved.experiment) else count
        entry.check(moved.experiment, model=moved.model, frame_rate=None, count=filled)
    except BadInput as error:
        place = ", ".join(f"{name} = {value:.4g}" for name, value in point.items())
        raise BadInput(f"--vary: at {place} there is no twin: {error}") from None
    return moved


def _measured(experiment: Experiment, out: Path, workers: int | None, progress: Progress) -> list[Quantity]:
    with measuring([experiment], out, workers) as pending:
        found = pending.results(progress)[experiment.id]
    if not found.known:
        why = found.failures[0].message if found.failures else "all are rejected in lab.toml"
        raise BadInput(f"{experiment.id}: no repetition could be measured: {why}")
    return found.quantities


def _run(runs: Sequence[Run], out: Path, where: Any, progress: Progress) -> Done:
    done = run_all(runs, out / "runs", runner=where, progress=progress)
    done.raise_faults()
    if not done.results:
        first = next(iter(done.failures))
        raise BadInput(f"no run has a result; {first}: {done.failures[first]}")
    return done


def _rows(
    experiment: Experiment, measured: Sequence[Quantity], names: Sequence[str], done: Done
) -> list[dict[str, Any]]:
    """The rows of a point: each result of the rig, the mean over its runs."""
    found = [quantities_of(done.results[name]) for name in names if name in done.results]
    why = "; ".join(dict.fromkeys(done.failures[name] for name in names if name in done.failures))
    if not found:
        return [{"failed": why, "runs": 0}]
    entry, rows = entry_of(experiment), []
    simulated = [one for run in found for one in run if is_result(one.quantity, one.detail.get("side"))]
    beside = {
        (row.quantity, row.method, row.unit, tuple(getattr(row, name) for name in IDENTITY)): row
        for row in deviations(experiment.id, experiment.rig_name, measured, simulated, run_name=entry.run_name)
    }
    for key in dict.fromkeys(map(key_of, simulated)):
        mine = [one for one in simulated if key_of(one) == key]
        identity = {name: mine[0].detail.get(name) for name in IDENTITY}
        values = [one.value for one in mine if math.isfinite(one.value)]
        row = {
            "quantity": mine[0].quantity, "method": mine[0].method, **identity, "unit": mine[0].unit,
            "simulated": fmean(values) if values else None,
            "simulated_std": stdev(values) if len(values) > 1 else None,
            "runs": len(values),
            "doubtful": "; ".join(dict.fromkeys(one.doubtful for one in mine if one.doubtful)),
            "failed": why,
        }  # fmt: skip
        other = beside.get((mine[0].quantity, mine[0].method, mine[0].unit, tuple(identity.values())))
        if other is not None:
            row |= {
                "measured": other.measured, "measured_std_uncertainty": other.measured_std_uncertainty,
                "percent_deviation": other.percent_deviation, "percent_deviation_std": other.percent_deviation_std,
                "z": other.z,
            }  # fmt: skip
        rows.append(row)
    return rows
