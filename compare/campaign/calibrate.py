"""One set of parameters for all experiments of a lab, as a posterior.

An emulator of each quantity is fitted to twins of a space-filling design; the next twins are run where the posterior is
and the emulators are least certain, until the posterior is no longer narrowed or the runs are spent.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare import result_files
from rigtwin.compare.campaign.calibration import Calibration, calibration_of
from rigtwin.compare.campaign.calibration_figures import figures
from rigtwin.compare.campaign.calibration_methods import LIBRARIES, methods
from rigtwin.compare.campaign.campaign import Campaign
from rigtwin.compare.campaign.next_experiment import next_experiments, runs_needed
from rigtwin.compare.campaign.posterior import Parameter, Target
from rigtwin.compare.campaign.runners import runner
from rigtwin.compare.campaign.search import Search, State
from rigtwin.compare.campaign.store import Store
from rigtwin.compare.campaign.vary import (
    WHOLE,
    applies,
    contact_pair,
    names,
    need_different,
    of_contact,
    of_pairs,
    parse,
)
from rigtwin.compare.deviation import Deviation, deviations, is_result
from rigtwin.compare.measure_repetitions import Measured, measuring
from rigtwin.compare.report.figure_file import figure_files
from rigtwin.compare.report.fill_template import filled
from rigtwin.compare.twins.matched import as_seen
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment, Lab, read_lab
from rigtwin.lab.file.model_file import model_text
from rigtwin.lab.formatting import title
from rigtwin.lab.materials import PARAMETERS, pair
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Quantity, in_a_row
from rigtwin.lab.rig_quantities import quantities_of
from rigtwin.lab.spelling import suggestion

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

RANGES = {"static_friction": (0.05, 1.2), "rolling_friction": (0.003, 0.5)}
"""Ranges of parameters of which nothing is known."""
MEASURED_BY = {
    ("tilt", "static_friction"): "static_friction",
    ("tilt", "rolling_friction"): "rolling_friction",
    ("drop", "restitution_wall"): "restitution",
    ("pendulum", "restitution_wall"): "restitution",
    ("pendulum", "restitution_pair"): "restitution",
}
"""Rig and quantity that measure a parameter of a contact directly."""
FOLLOWS_FROM = {"bulk_density": "bed_height"}
"""Results that say nothing new beside another one of the same experiment."""


def calibrate(
    lab_folder: Path,
    out: Path,
    progress: Progress = silent,
    *,
    fit: Sequence[str] | None = None,
    hold_out: Sequence[str] = (),
    budget: int = 60,
    count: int | None = None,
    seed: int = 1,
    rolling: Rolling | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    allow_outside: bool = False,
) -> Calibration:
    """Calibrate parameters on all experiments of a lab with many particles.

    Parameters
    ----------
    lab_folder : Path
        Folder with a lab.toml.
    out : Path
        Folder for calibration.json, calibration.html, its figures, posterior.csv and model.toml; finished runs are kept
        in ``out/runs``.
    progress : Progress
        Called with step, finished and total runs.
    fit : sequence of str, optional
        Parameters as of a sweep, ``static_friction`` or ``static_friction=0.1..0.9``; static and rolling friction
        between the particles by default.
    hold_out : sequence of str
        Experiments that are not fitted but predicted.
    budget : int
        Largest number of twins of the fitted experiments.
    count : int, optional
        Number of particles where lab.toml states none.
    seed : int
        First seed.
    rolling : Rolling, optional
        Rolling resistance law.
    workers : int, optional
        Number of processes of this machine, one for each core by default.
    cluster : str, optional
        A cluster for the runs, as in `rigtwin.compare.campaign.runners.runner`.
    allow_outside : bool
        Whether the lab may name files outside its folder.

    Returns
    -------
    Calibration
        Posterior, best set, predictions and written files.

    Raises
    ------
    BadInput
        If there is nothing to fit, a parameter that no experiment depends on, or too small a budget.
    """
    lab = read_lab(lab_folder, allow_outside=allow_outside)
    _, fitted = _to_fit(lab, hold_out)  # these two before the media are measured
    _fitted_by(fit, fitted)
    with measuring(lab.experiments, out, workers) as pending:
        measured = pending.results(progress)
    options = {"count": count, "rolling": rolling}
    seen = {one.id: as_seen(one, measured[one.id].measurements, count) for one in lab.experiments}
    return calibrate_lab(
        replace(lab, experiments=tuple(one for one, _ in seen.values())),
        measured, out, progress, fit=fit, hold_out=hold_out, budget=budget, seed=seed, options=options,
        workers=workers, cluster=cluster,
        remarks=[f"{name}: its twins take from the media {said}" for name, (_, said) in seen.items() if said],
    )  # fmt: skip


def calibrate_lab(
    lab: Lab,
    measured: Mapping[str, Measured],
    out: Path,
    progress: Progress = silent,
    *,
    fit: Sequence[str] | None = None,
    hold_out: Sequence[str] = (),
    budget: int = 60,
    seed: int = 1,
    options: Mapping[str, Any] | None = None,
    reading: Mapping[str, float] | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    remarks: Sequence[str] = (),
) -> Calibration:
    """Calibrate parameters on measurements that are there already.

    Parameters
    ----------
    lab : Lab
        Experiments and model.
    measured : mapping of str to Measured
        Results of the repetitions of each experiment.
    out, progress, fit, hold_out, budget, seed : Path, Progress, sequence of str, sequence of str, int, int
        As for `calibrate`.
    options : mapping, optional
        Keywords of `rigtwin.compare.campaign.twin_runs.twin_run`.
    reading : mapping of str to float, optional
        For quantities the standard uncertainty of the convention by which they were read, in their unit.
    workers, cluster : int, str, optional
        As for `calibrate`.
    remarks : sequence of str
        What is reported beside what was left out.

    Returns
    -------
    Calibration
        As of `calibrate`.

    Raises
    ------
    BadInput
        As of `calibrate`.
    """
    from threadpoolctl import threadpool_limits

    bulk, fitted = _to_fit(lab, hold_out)
    quantities = {name: found.quantities for name, found in measured.items()}
    targets = {one.id: _targets(one, quantities[one.id], reading or {}) for one in bulk}
    if not any(targets[one.id] for one in fitted):
        raise BadInput(f"{lab.path}: {'; '.join(_without_result(measured[one.id]) for one in fitted)}.")
    left_out = [*remarks]
    left_out += [
        f"{one.id} was not {'fitted' if one in fitted else 'predicted'}: {_without_result(measured[one.id])}"
        for one in bulk
        if not targets[one.id]
    ]
    left_out += [
        f"{name}: {failure.source.name} was left out: {failure.message}"
        for name, found in measured.items()
        if targets.get(name) != []  # else it is said there
        for failure in found.failures
    ]
    fitted = [one for one in fitted if targets[one.id]]
    parameters = tuple(_parameters(fit, lab, fitted, quantities, hold_out))
    moved = [one for one in fitted if any(applies(parameter.name, one) for parameter in parameters)]
    left_out += [f"{one.id} was not fitted: it depends on none of the parameters" for one in fitted if one not in moved]
    left_out += list(_unused(lab, moved, parameters, quantities, hold_out))
    fitted = moved
    records = {name: found.measurements for name, found in measured.items()}
    reserve = runs_needed(fitted)
    search = Search(lab, fitted, parameters, targets, records, budget, seed, options or {}, reserve)
    # the matrices are small: more threads would only wait for each other, and the twins need the cores
    pool = runner(cluster, workers, out / "runs")
    with threadpool_limits(1), Store(out / "runs") as store, Campaign(store, pool) as campaign:
        found = search.run(campaign, progress)
        held = [one for one in bulk if one.id in hold_out]
        predictions = tuple(search.predictions(found, held, campaign, progress))
        calibration = calibration_of(search, found, predictions)
        if calibration.ambiguous and calibration.fits:
            calibration = _with_next_experiments(calibration, search, found, campaign, progress)
    replaced = _replaced(out, parameters)
    calibration = replace(calibration, remarks=(*left_out, *calibration.remarks, *replaced))
    drawn = figures(calibration)
    text = methods(calibration, result_files.versions(LIBRARIES))
    page = filled("calibration.html", found=calibration, figures=drawn, title=title, methods=text)
    drawings = figure_files("calibration", drawn.values())
    contents = {
        "posterior.csv": result_files.table(
            [dict(zip((one.name for one in parameters), row, strict=True)) for row in calibration.samples.tolist()],
            [one.name for one in parameters],
        ),
        "model.toml": model_text(calibration.model),
        "calibration.html": page,
        **text.files("calibration"),
    }
    calibration.files.update({name: out / name for name in (*contents, "calibration.json", result_files.FIGURES)})
    document = result_files.document(calibration.to_json())
    result_files.write_in_turn(out, {**contents, "calibration.json": document, **drawings})
    return calibration


def _replaced(out: Path, parameters: Sequence[Parameter]) -> Iterator[str]:
    """A remark if `out` holds a calibration of other parameters or ranges, which this one replaces."""
    try:
        priors = json.loads((out / "calibration.json").read_text(encoding="utf-8"))["priors"]
        before = {name: (one["low"], one["high"]) for name, one in priors.items()}
        fitted = ", ".join(f"{name} between {low:.4g} and {high:.4g}" for name, (low, high) in before.items())
    except (OSError, ValueError, LookupError, TypeError, AttributeError):  # no such file, or of another kind
        return
    if before != {one.name: (one.low, one.high) for one in parameters}:
        yield (
            f"the calibration of {fitted} (SI) in {out} is replaced; its runs are kept in runs/, from which the "
            "earlier command can write it again; give --out another folder to keep both"
        )


def _with_next_experiments(
    calibration: Calibration, search: Search, found: State, campaign: Campaign, progress: Progress
) -> Calibration:
    """The calibration with experiments that would separate the sets that fit, or a remark on what they need."""
    needed = runs_needed(search.fitted)
    if not needed:
        return calibration
    if found.runs + needed > search.budget:
        budget = search.least + needed
        remark = f"{needed} more runs would show which further experiment separates the sets: --budget {budget} or more"
        return replace(calibration, remarks=(*calibration.remarks, remark))
    following = next_experiments(search, found, campaign, progress)
    return replace(calibration, next_experiments=tuple(following), runs=found.runs)


def _to_fit(lab: Lab, hold_out: Sequence[str]) -> tuple[list[Experiment], list[Experiment]]:
    """The experiments with many particles, and those of them that are fitted."""
    known = {experiment.id: experiment for experiment in lab.experiments}
    for name in hold_out:
        if name not in known:
            raise BadInput(f"--hold-out: there is no experiment {name!r}; {suggestion(name, known)}.")
    bulk = [one for one in lab.experiments if entry_of(one).many_particles]
    fitted = [one for one in bulk if one.id not in hold_out]
    if not fitted:
        raise BadInput(f"{lab.path}: has nothing to fit: no experiment with many particles that is not held out.")
    return bulk, fitted


def _parameters(
    fit: Sequence[str] | None,
    lab: Lab,
    fitted: Sequence[Experiment],
    measured: Mapping[str, Sequence[Quantity]],
    hold_out: Sequence[str],
) -> Iterator[Parameter]:
    for text, takers in _fitted_by(fit, fitted).items():
        name = _name(text)
        known = _measured_value(of_contact(name), contact_pair(name, takers[0]), lab, measured, hold_out)
        low, high, source = _range(text, name, takers[0], known)
        mean, std = (known[0], known[1]) if known is not None else (None, None)
        yield Parameter(name, low, high, mean, std, source if known is None else f"{source}, measured by {known[2]}")


def _fitted_by(fit: Sequence[str] | None, fitted: Sequence[Experiment]) -> dict[str, list[Experiment]]:
    """The experiments that depend on each parameter."""
    texts = fit or ("static_friction", "rolling_friction")
    need_different([_name(text) for text in texts], fitted, option="--fit")
    found: dict[str, list[Experiment]] = {}
    for text in texts:
        name = _name(text)
        takers = found[text] = [one for one in fitted if applies(name, one)]
        if not takers:
            of_contacts = (
                known for one in fitted for known, (_, sides) in of_pairs(one).items() if sides in one.contacts
            )
            known_names = dict.fromkeys((*(known for one in fitted for known in names(one)), *of_contacts))
            raise BadInput(
                f"--fit: no experiment that is fitted depends on {name!r}; {suggestion(name, known_names)}, and "
                "parameters of effects."
            )
        pairs = dict.fromkeys(pair(*contact_pair(name, one)) for one in takers)
        if of_contact(name) in PARAMETERS and len(pairs) > 1:
            each = [f"{of_contact(name)}@{'-'.join(one)}" for one in pairs]
            raise BadInput(f"--fit: {name} would be one value of several contacts; name them: {', '.join(each)}.")
    return found


def _name(text: str) -> str:
    return text.partition("=")[0].strip()


def _range(text: str, name: str, taker: Experiment, known: tuple[float, float, str] | None) -> tuple[float, float, str]:
    """The range of a parameter, and where it comes from."""
    if name in WHOLE:
        raise BadInput(f"--fit: {name} is a whole number, which cannot be fitted; `rigtwin sweep` varies it.")
    _, equals, ranged = text.partition("=")
    if equals:
        varied = parse(text, taker, option="--fit")
        if varied.levels is None or ":" in ranged:
            raise BadInput(f"--fit: {text!r} is not a range without levels, like static_friction=0.1..0.9.")
        low, high = varied.values
        if known is not None and not low - 4 * known[1] < known[0] < high + 4 * known[1]:
            raise BadInput(
                f"--fit: {text} contradicts {known[0]:.3g} +- {known[1]:.2g}, measured by {known[2]}; leave "
                "the range out or correct it."
            )
        return low, high, "stated range"
    if known is not None:
        high = known[0] + 4 * known[1]
        highest = min(high, 1.0) if of_contact(name) == "restitution" else high
        return max(known[0] - 4 * known[1], 0.05 * known[0]), highest, "four standard uncertainties"
    if of_contact(name) in RANGES:
        return *RANGES[of_contact(name)], "nothing is known"
    raise BadInput(f"--fit: {name} was not measured; give its range, {name}=LOW..HIGH.")


def _measured_value(
    parameter: str,
    names: tuple[str, str],
    lab: Lab,
    measured: Mapping[str, Sequence[Quantity]],
    hold_out: Sequence[str],
) -> tuple[float, float, str] | None:
    """Value, standard uncertainty and source of a contact's parameter that the lab measures directly."""
    for experiment in lab.experiments:
        other = entry_of(experiment).many_particles or pair(*experiment.contacts[-1]) != pair(*names)
        if other or experiment.id in hold_out:
            continue
        for row in deviations(experiment.id, experiment.rig_name, measured[experiment.id], ()):
            known = 0 < row.measured_std_uncertainty < math.inf
            if parameter == MEASURED_BY.get((experiment.rig_name, row.quantity)) and known and not row.doubtful:
                return row.measured, row.measured_std_uncertainty, experiment.id
    return None


def _unused(
    lab: Lab,
    fitted: Sequence[Experiment],
    parameters: Sequence[Parameter],
    measured: Mapping[str, Sequence[Quantity]],
    hold_out: Sequence[str],
) -> Iterator[str]:
    """Sentences on coefficients that the lab measures and that are neither fitted nor in its model."""
    fitted_ones = {
        (of_contact(one.name), pair(*contact_pair(one.name, experiment)))
        for one in parameters
        for experiment in fitted
        if of_contact(one.name) in PARAMETERS and applies(one.name, experiment)
    }
    for contact in dict.fromkeys(pair(*both) for experiment in fitted for both in experiment.contacts):
        for parameter in PARAMETERS:
            known = _measured_value(parameter, contact, lab, measured, hold_out)
            used = getattr(lab.model.known_contact(*contact), parameter)
            if known is None or used is None or (parameter, contact) in fitted_ones:
                continue
            if abs(used - known[0]) > 2 * known[1]:
                name = "-".join(contact)
                yield (
                    f"{parameter} of {name} is {used:.4g} in the model, {known[2]} measured {known[0]:.4g} +- "
                    f"{known[1]:.2g}; --fit {parameter}@{name} uses the measured value"
                )


def _without_result(measured: Measured) -> str:
    """Why an experiment has no target: what could be fitted, what was measured, and what was not, with the reasons."""
    experiment = measured.experiment
    known = [name for name in quantities_of(experiment.rig) if is_result(name, None)]
    usable = f"of a {experiment.rig_name}: {', '.join(known)}, the mean of both sides and not doubtful"
    of_rig = [one for one in measured.quantities if one.quantity in quantities_of(experiment.rig)]
    found = ", ".join(dict.fromkeys(map(_of_side, of_rig))) or "nothing"
    why = [f"{failure.source.name} was not measured: {failure.message}" for failure in measured.failures]
    why += [f"doubtful: {one.doubtful}" for one in of_rig if one.doubtful]
    reasons = in_a_row(why)
    return (
        f"nothing that can be fitted was measured in {experiment.id} ({usable}; measured: {found})"
        f"{': ' if reasons else ''}{reasons}"
    )


def _of_side(one: Quantity) -> str:
    side = one.detail.get("side", "mean")
    return f"{'' if side == 'mean' else f'{side} '}{one.quantity}{' (doubtful)' if one.doubtful else ''}"


def _targets(experiment: Experiment, measured: Sequence[Quantity], reading: Mapping[str, float]) -> list[Target]:
    """The results of a rig, the first method of each."""
    rows: dict[str, Deviation] = {}
    for row in deviations(experiment.id, experiment.rig_name, measured, ()):
        usable = is_result(row.quantity, row.side)
        if usable and math.isfinite(row.measured_std_uncertainty) and not row.doubtful:
            rows.setdefault(row.quantity, row)
    return [
        Target(
            experiment.id, row.quantity, row.method, row.unit, row.measured, row.measured_std_uncertainty,
            row.measured_n, reading.get(row.quantity, 0.0),
        )
        for row in rows.values()
        if FOLLOWS_FROM.get(row.quantity) not in rows
    ]  # fmt: skip
