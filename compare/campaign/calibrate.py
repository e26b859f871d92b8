"""One set of parameters for all experiments of a lab, as a posterior.

An emulator of each quantity is fitted to twins of a space-filling design; the next twins are run where the posterior is
and the emulators are least certain, until the posterior is no longer narrowed or the runs are spent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare import result_files
from rigtwin.compare.campaign import emulator as emulators
from rigtwin.compare.campaign.campaign import Campaign
from rigtwin.compare.campaign.posterior import Parameter, Target, sample, variance
from rigtwin.compare.campaign.run import Run
from rigtwin.compare.campaign.runners import runner
from rigtwin.compare.campaign.store import Store
from rigtwin.compare.campaign.twin_runs import quantities_of, twin_run
from rigtwin.compare.campaign.vary import OF_PARTICLE, Setting, at, names, parse
from rigtwin.compare.deviation import Deviation, deviations, is_result
from rigtwin.compare.measure_repetitions import measuring
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment, Lab, read_lab
from rigtwin.lab.file.model_file import Model, model_text
from rigtwin.lab.file.schema import suggestion
from rigtwin.lab.materials import pair
from rigtwin.lab.progress import Progress, silent

if TYPE_CHECKING:
    from rigtwin.compare.campaign.emulator import Emulator
    from rigtwin.lab.quantity import Quantity
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
SKIPPED = {"bulk_density"}  # follows from the bed height
FIRST = 5  # points of the first design for each parameter
FEWEST = 10  # points of the first design
CONFIRMED = 3  # runs of the best set
BATCH = 2  # points between two looks at the posterior
NARROWED = 0.03  # relative change of the posterior's width below which it is no longer narrowed
CERTAIN = 0.3  # emulator's share of the standard uncertainty at which more runs would not help
TIED = 0.8  # correlation from which two parameters are named as ambiguous
WIDE = 0.2  # standard deviation over the range from which a parameter is not determined; a uniform one has 0.29
MISFIT = 0.01  # probability of the misfit below which no set fits


@dataclass(frozen=True)
class Calibration:
    """The posterior and what follows from it."""

    lab: Lab
    parameters: tuple[Parameter, ...]
    targets: tuple[Target, ...]
    samples: Array  # shape (n, p), in SI
    best: Mapping[str, float]  # the sample of highest density
    model: Model  # with the best set
    sensitivities: Array  # shape (targets, p), share of the variance that each parameter causes alone
    predictions: tuple[dict[str, Any], ...]
    runs: int
    stopped: str
    misfit: tuple[float, float]  # chi-square of the best set, and its probability
    remarks: tuple[str, ...] = ()
    files: dict[str, Path] = field(default_factory=dict)

    @property
    def fits(self) -> bool:
        """Whether the best set agrees with the measurements."""
        return self.misfit[1] >= MISFIT

    @property
    def intervals(self) -> dict[str, dict[str, float]]:
        """Median, standard deviation and 95 % credible interval of each parameter."""
        found = {}
        for one, values in zip(self.parameters, self.samples.T, strict=True):
            low, median, high = np.quantile(values, (0.025, 0.5, 0.975))
            found[one.name] = {"median": median, "std": float(np.std(values)), "low": low, "high": high}
        return found

    @property
    def correlations(self) -> dict[str, float]:
        """Correlation of each pair of parameters, of their logarithms where those are uniform beforehand."""
        names = [one.name for one in self.parameters]
        if len(names) < 2:
            return {}
        matrix = np.atleast_2d(np.corrcoef(np.array(self._scaled)))
        pairs = [(i, j) for i in range(len(names)) for j in range(i)]
        return {f"{names[j]} / {names[i]}": float(matrix[i, j]) for i, j in pairs}

    @property
    def ambiguous(self) -> list[str]:
        """Sentences on parameters that these experiments do not separate or do not determine."""
        said = [
            f"{names} cannot be separated (correlation {value:.2f}): families of sets fit equally well"
            for names, value in self.correlations.items()
            if abs(value) > TIED
        ]
        said += [
            f"{one.name} is not determined: its posterior is about as wide as its range"
            for one, scaled in zip(self.parameters, self._scaled, strict=True)
            if one.mean is None and np.std(scaled) > WIDE
        ]
        return said

    @property
    def _scaled(self) -> list[Array]:
        """The samples of each parameter in the unit interval."""
        return [one.unit(values) for one, values in zip(self.parameters, self.samples.T, strict=True)]

    def to_json(self) -> dict[str, Any]:
        """Content of ``calibration.json``."""
        return {
            "lab": str(self.lab.path),
            "fits": self.fits,
            "chi_square": self.misfit[0],
            "probability": self.misfit[1],
            "best": dict(self.best),
            "intervals": self.intervals,
            "priors": {
                one.name: {"low": one.low, "high": one.high, "mean": one.mean, "std": one.std, "source": one.source}
                for one in self.parameters
            },
            "correlations": self.correlations,
            "ambiguous": self.ambiguous,
            "sensitivities": [
                {
                    "experiment": target.experiment, "quantity": target.quantity, "method": target.method,
                    **dict(zip((one.name for one in self.parameters), row.tolist(), strict=True)),
                }
                for target, row in zip(self.targets, self.sensitivities, strict=True)
            ],
            "predictions": list(self.predictions),
            "runs": self.runs,
            "stopped": self.stopped,
            "remarks": list(self.remarks),
            "files": {name: str(path) for name, path in self.files.items()},
        }  # fmt: skip


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
        Folder for calibration.json, posterior.csv and model.toml; finished runs are kept in ``out/runs``.
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
    known = {experiment.id: experiment for experiment in lab.experiments}
    for name in hold_out:
        if name not in known:
            raise BadInput(f"--hold-out: there is no experiment {name!r}; {suggestion(name, known)}.")
    bulk = [one for one in lab.experiments if entry_of(one).many_particles]
    fitted = [one for one in bulk if one.id not in hold_out]
    if not fitted:
        raise BadInput(f"{lab.path}: has nothing to fit: no experiment with many particles that is not held out.")
    with measuring(lab.experiments, out, workers) as pending:
        measured = {name: found.quantities for name, found in pending.results(progress).items()}
    parameters = tuple(_parameters(fit, lab, fitted, measured))
    targets = {one.id: _targets(one, measured[one.id]) for one in bulk}
    if not any(targets[one.id] for one in fitted):
        raise BadInput(
            f"{lab.path}: nothing that the twins give was measured in {', '.join(one.id for one in fitted)}."
        )
    fitted = [one for one in fitted if targets[one.id]]
    options = {"count": count, "rolling": rolling}
    search = _Search(lab, fitted, parameters, targets, budget, seed, options)
    with Store(out / "runs") as store, Campaign(store, runner(cluster, workers, out / "runs")) as campaign:
        found = search.run(campaign, progress)
        held = [one for one in bulk if one.id in hold_out]
        predictions = tuple(search.predictions(found, held, campaign, progress))
    calibration = search.result(found, predictions)
    contents = {
        "posterior.csv": result_files.table(
            [dict(zip((one.name for one in parameters), row, strict=True)) for row in calibration.samples.tolist()],
            [one.name for one in parameters],
        ),
        "model.toml": model_text(calibration.model),
    }
    calibration.files.update({name: out / name for name in (*contents, "calibration.json")})
    document = result_files.document(calibration.to_json())
    result_files.write_in_turn(out, {**contents, "calibration.json": document})
    return calibration


def _parameters(
    fit: Sequence[str] | None, lab: Lab, fitted: Sequence[Experiment], measured: Mapping[str, Sequence[Quantity]]
) -> Iterator[Parameter]:
    seen: set[str] = set()
    for text in fit or ("static_friction", "rolling_friction"):
        name, ranged, _ = (part.strip() for part in text.partition("="))
        if name in seen:
            raise BadInput(f"--fit: {name} is given twice; take one of them out.")
        seen.add(name)
        takers = [one for one in fitted if _applies(name, one)]
        if not takers:
            known_names = dict.fromkeys(known for one in fitted for known in names(one) if not _of_rig(known, one))
            raise BadInput(
                f"--fit: no experiment that is fitted depends on {name!r}; {suggestion(name, known_names)}, and "
                "parameters of effects."
            )
        if _of_rig(name, takers[0]):
            raise BadInput(f"--fit: {name} is a setting of the rig, which lab.toml states; `rigtwin sweep` varies it.")
        known = _measured_value(name, lab, takers[0], measured)
        if ranged:
            varied = parse(text, takers[0], option="--fit")
            if varied.levels is None or varied.values[0] <= 0:
                raise BadInput(f"--fit: {text!r} is not a range above zero like static_friction=0.1..0.9.")
            low, high = varied.values
            source = "stated range"
            if known is not None and not low - 4 * known[1] < known[0] < high + 4 * known[1]:
                raise BadInput(
                    f"--fit: {text} contradicts {known[0]:.3g} +- {known[1]:.2g}, measured by {known[2]}; leave "
                    "the range out or correct it."
                )
        elif known is not None:
            low, high = max(known[0] - 4 * known[1], 0.05 * known[0]), known[0] + 4 * known[1]
            if name.endswith("restitution"):
                high = min(high, 1.0)
            source = f"measured by {known[2]}"
        elif name.removeprefix("wall_") in RANGES:
            low, high = RANGES[name.removeprefix("wall_")]
            source = "nothing is known"
        else:
            raise BadInput(f"--fit: {name} was not measured; give its range, {name}=LOW..HIGH.")
        mean, std = (known[0], known[1]) if known is not None else (None, None)
        yield Parameter(name, low, high, mean, std, source if known is None else f"measured by {known[2]}")


def _applies(name: str, experiment: Experiment) -> bool:
    return "." in name or name in names(experiment)


def _of_rig(name: str, experiment: Experiment) -> bool:
    """Whether a parameter is a setting of the rig, not of particle, contact or effect."""
    return hasattr(experiment.rig, name)


def _measured_value(
    name: str, lab: Lab, taker: Experiment, measured: Mapping[str, Sequence[Quantity]]
) -> tuple[float, float, str] | None:
    """Value, standard uncertainty and source of a contact's parameter that the lab measures directly."""
    wanted = pair(*taker.contacts[0 if name.startswith("wall_") else -1])
    for experiment in lab.experiments:
        if entry_of(experiment).many_particles or pair(*experiment.contacts[-1]) != wanted:
            continue
        for row in deviations(experiment.id, experiment.rig_name, measured[experiment.id], ()):
            parameter = MEASURED_BY.get((experiment.rig_name, row.quantity))
            known = math.isfinite(row.measured) and 0 < row.measured_std_uncertainty < math.inf
            if parameter == name.removeprefix("wall_") and known and not row.doubtful:
                return row.measured, row.measured_std_uncertainty, experiment.id
    return None


def _targets(experiment: Experiment, measured: Sequence[Quantity]) -> list[Target]:
    """The results of a rig, the first method of each."""
    rows: dict[str, Deviation] = {}
    for row in deviations(experiment.id, experiment.rig_name, measured, ()):
        usable = is_result(row.quantity, row.side) and row.quantity not in SKIPPED
        known = math.isfinite(row.measured) and math.isfinite(row.measured_std_uncertainty)
        if usable and known and not row.doubtful:
            rows.setdefault(row.quantity, row)
    return [
        Target(
            experiment.id, row.quantity, row.method, row.unit, row.measured, row.measured_std_uncertainty,
            row.measured_n, len(rows),
        )
        for row in rows.values()
    ]  # fmt: skip


@dataclass
class _State:
    """The state of the search."""

    unit: list[Array] = field(default_factory=list)  # points of the unit cube
    values: dict[Target, list[float]] = field(default_factory=dict)  # of each target at each point; NaN where none
    emulators: list[Emulator] = field(default_factory=list)
    samples: Array = field(default_factory=lambda: np.empty((0, 0)))  # in the unit cube
    density: Array = field(default_factory=lambda: np.empty(0))
    runs: int = 0
    stopped: str = ""
    failures: dict[str, str] = field(default_factory=dict)

    @property
    def best(self) -> Array:
        """The sample of highest density, in the unit cube."""
        return np.asarray(self.samples[int(np.argmax(self.density))])


@dataclass(frozen=True)
class _Search:
    """The lab, its twins and the parameters."""

    lab: Lab
    fitted: Sequence[Experiment]
    parameters: tuple[Parameter, ...]
    targets: Mapping[str, list[Target]]
    budget: int
    seed: int
    options: Mapping[str, Any]

    @property
    def every(self) -> list[Target]:
        return [target for one in self.fitted for target in self.targets[one.id]]

    def run(self, campaign: Campaign, progress: Progress) -> _State:
        """Run twins until the posterior is no longer narrowed, the emulators are certain or the budget is spent."""
        from scipy.stats import qmc

        first = max(FEWEST, FIRST * len(self.parameters))
        least = (first + BATCH + CONFIRMED) * len(self.fitted)
        if self.budget < least:
            raise BadInput(
                f"--budget: {self.budget} runs are too few for {len(self.parameters)} parameters and "
                f"{len(self.fitted)} experiments; give at least {least}."
            )
        found = _State(values={target: [] for target in self.every})
        sampler = qmc.Sobol(len(self.parameters), rng=self.seed)
        self._add(found, sampler.random(2 ** math.ceil(math.log2(first)))[:first], campaign, progress)
        self._update(found)
        width, still = self._width(found), 0
        while not found.stopped:
            if found.runs + (BATCH + CONFIRMED) * len(self.fitted) > self.budget:
                found.stopped = "the runs are spent"
                break
            self._add(found, self._next(found), campaign, progress)
            self._update(found)
            before, width = width, self._width(found)
            if self._certain(found):
                found.stopped = "the emulators are more certain than the measurements"
            still = still + 1 if abs(math.log(before / width)) < NARROWED else 0
            if not found.stopped and still == 2:  # one such step may be chance
                found.stopped = "the posterior is no longer narrowed"
        return found

    def _add(self, found: _State, unit: Array, campaign: Campaign, progress: Progress) -> None:
        runs: dict[tuple[int, str], Run] = {}
        start = len(found.unit)
        for k, point in enumerate(unit, start=start):
            for experiment in self.fitted:
                runs[k, experiment.id] = self._twin(experiment, point, f"{experiment.id}-point-{k:03d}", self.seed + k)
        done = campaign.results(list(runs.values()), progress, stage=f"twins of {len(unit)} points", retry=False)
        found.failures.update(done.failures)
        found.runs += len(runs)
        found.unit += list(unit)
        for target in self.every:
            for k in range(start, start + len(unit)):
                result = done.results.get(runs[k, target.experiment].name)
                found.values[target].append(math.nan if result is None else _value(target, result))

    def _twin(self, experiment: Experiment, point: Array, name: str, seed: int) -> Run:
        values = {one.name: float(one.value(point[k])) for k, one in enumerate(self.parameters)}
        mine = {name: value for name, value in values.items() if _applies(name, experiment)}
        return twin_run(name, *at(Setting(experiment, self.lab.model), mine), seed=seed, **self.options)

    def _update(self, found: _State) -> None:
        unit = np.array(found.unit)
        found.emulators = []
        for target in self.every:
            values = np.array(found.values[target])
            known = np.isfinite(values)
            if known.sum() < len(self.parameters) + 3:
                why = next(iter(found.failures.values()), "its twins do not give it")
                raise BadInput(f"{target.experiment}: {target.quantity} cannot be emulated: {why}")
            found.emulators.append(emulators.fit(unit[known], values[known], seed=self.seed))
        found.samples, found.density = sample(self.parameters, self.every, found.emulators, seed=self.seed)

    def _width(self, found: _State) -> float:
        """Geometric mean of the posterior's standard deviations, over the ranges."""
        return float(np.exp(np.mean(np.log(np.maximum(np.std(found.samples, axis=0), 1e-6)))))

    def _shares(self, found: _State, unit: Array) -> Array:
        """The emulators' share of the variance, shape (n, targets)."""
        shares = []
        for target, emulator in zip(self.every, found.emulators, strict=True):
            _, emulated = emulator.predict(unit)
            shares.append(emulated**2 / variance(target, emulator, emulated))
        return np.array(shares).T

    def _certain(self, found: _State) -> bool:
        return bool(np.sqrt(self._shares(found, found.samples[::20]).mean(axis=0)).max() < CERTAIN)

    def _next(self, found: _State) -> Array:
        """Points of the posterior where the emulators are least certain, apart from each other."""
        random = np.random.default_rng(self.seed + len(found.unit))
        pool = found.samples[random.choice(len(found.samples), 400)]
        gain = self._shares(found, pool).sum(axis=1)
        chosen: list[Array] = []
        for _ in range(BATCH):
            near = np.array([np.linalg.norm(pool - one, axis=1) for one in chosen])
            apart = np.ones(len(pool)) if not chosen else 1 - np.exp(-((near.min(axis=0) / 0.2) ** 2))
            chosen.append(pool[int(np.argmax(gain * apart))])
        return np.array(chosen)

    def predictions(
        self, found: _State, held: Sequence[Experiment], campaign: Campaign, progress: Progress
    ) -> Iterator[dict[str, Any]]:
        """The best set's twins, with other seeds than those of the emulators, beside the measurements."""
        best = found.best
        seeds = range(self.seed + 1000, self.seed + 1000 + CONFIRMED)
        runs = {
            (one.id, k): self._twin(one, best, f"{one.id}-best-seed-{k}", k)
            for one in (*self.fitted, *held)
            for k in seeds
        }
        done = campaign.results(list(runs.values()), progress, stage="twins of the best set", retry=False)
        found.failures.update(done.failures)
        found.runs += len(runs)
        for one in (*self.fitted, *held):
            for target in self.targets[one.id]:
                results = [done.results.get(runs[one.id, k].name) for k in seeds]
                values = np.array([_value(target, result) for result in results if result is not None])
                values = values[np.isfinite(values)]
                mean = float(np.mean(values)) if len(values) else None
                yield {
                    "experiment": one.id, "quantity": target.quantity, "method": target.method, "unit": target.unit,
                    "held_out": one in held, "measured": target.value, "std_uncertainty": target.std_uncertainty,
                    "predicted": mean, "predicted_std": float(np.std(values, ddof=1)) if len(values) > 1 else None,
                    "percent_deviation": _percent(mean, target.value),
                }  # fmt: skip

    def result(self, found: _State, predictions: tuple[dict[str, Any], ...]) -> Calibration:
        from scipy.stats import chi2

        samples = np.column_stack([one.value(found.samples[:, k]) for k, one in enumerate(self.parameters)])
        best = {one.name: float(one.value(found.best[k])) for k, one in enumerate(self.parameters)}
        square, model = 0.0, self.lab.model
        for k, one in enumerate(self.parameters):  # a measured prior is a measurement, too
            square -= 2 * float(one.log_prior(found.best[k : k + 1])[0])
        for target, emulator in zip(self.every, found.emulators, strict=True):
            mean, emulated = emulator.predict(found.best[None, :])
            square += float((target.value - mean[0]) ** 2 / variance(target, emulator, emulated)[0])
        for experiment in self.fitted:
            mine = {name: value for name, value in best.items() if _applies(name, experiment)}
            moved = at(Setting(experiment, model), mine)
            model = moved.model
            if OF_PARTICLE.keys() & mine.keys() and moved.experiment.particle.shape is None:
                particle = moved.experiment.particle
                model = replace(
                    model,
                    particles={**model.particles, particle.name: particle},
                    materials={**model.materials, particle.material.name: particle.material},
                )
        shares = np.array(
            [emulators.main_effects(one, len(self.parameters), seed=self.seed) for one in found.emulators]
        )
        free = max(len(self.every) - len([one for one in self.parameters if one.mean is None]), 1)
        failed = [
            f"`compare --model` takes contacts and effects from model.toml; state {name} = {best[name]:.5g} (SI) of "
            "the particle in lab.toml"
            for name in best
            if name in OF_PARTICLE
        ]
        if found.failures:
            failed = [f"{len(found.failures)} twins failed, the first: {next(iter(found.failures.values()))}"]
        return Calibration(
            self.lab, self.parameters, tuple(self.every), samples, best, model, shares, predictions, found.runs,
            found.stopped, (square, float(chi2.sf(square, free))), tuple(failed),
        )  # fmt: skip


def _percent(predicted: float | None, measured: float) -> float | None:
    return None if predicted is None or measured == 0 else 100 * (predicted - measured) / measured


def _value(target: Target, result: Mapping[str, Any]) -> float:
    """The quantity of a target in the result of a twin; NaN where it has none or a doubtful one."""
    for one in quantities_of(dict(result)):
        same = (one.quantity, one.method, one.unit) == (target.quantity, target.method, target.unit)
        if same and one.detail.get("side") in (None, "mean") and not one.doubtful:
            return one.value
    return math.nan
