"""The search of a calibration: which twins to run next, and when to stop."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.campaign import emulator as emulators
from rigtwin.compare.campaign.curves import CurveTargets, curve_targets, is_component
from rigtwin.compare.campaign.posterior import MOST_STEPS, Parameter, Posterior, Target, correlation, sample, scatter
from rigtwin.compare.campaign.twin_runs import quantities_of, twin_run
from rigtwin.compare.campaign.vary import Setting, applies, at
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.lab.formatting import counted

if TYPE_CHECKING:
    from rigtwin.compare.campaign.campaign import Campaign
    from rigtwin.compare.campaign.run import Done, Result, Run
    from rigtwin.lab.file.lab_file import Experiment, Lab
    from rigtwin.lab.file.model_file import Model
    from rigtwin.lab.progress import Progress
    from rigtwin.lab.quantity import Measurement

SPENT = "the runs are spent"
# chosen beforehand, not fitted to labs; the row that tests them together is the recovery of `make bench-calibrate`
FIRST = 3  # points of the first design for each parameter
FEWEST = 8  # points of the first design
CONFIRMED = 3  # runs of the best set
POOL = 400  # samples of the posterior among which the next points are chosen
APART = 0.2  # distance in the unit cube within which a second point of a batch gains less
CONFIRMING_SEED = 100_000  # added to the seed of the design for the runs of the best set
BATCH = 2  # points between two looks at the posterior
NARROWED = 0.03  # relative change of the posterior's width below which it is no longer narrowed
CERTAIN = 0.3  # emulator's share of the standard uncertainty at which more runs would not help


@dataclass
class State:
    """The state of the search."""

    unit: list[Array] = field(default_factory=list)  # points of the unit cube
    measured: tuple[Target, ...] = ()
    results: dict[str, list[Result | None]] = field(default_factory=dict)  # of each experiment at each point
    curves: dict[str, CurveTargets] = field(default_factory=dict)  # of each experiment
    posterior: Posterior | None = None
    samples: Array = field(default_factory=lambda: np.empty((0, 0)))  # in the unit cube
    density: Array = field(default_factory=lambda: np.empty(0))
    converged: bool = True
    runs: int = 0
    stopped: str = ""
    failures: dict[str, str] = field(default_factory=dict)
    missing: dict[Target, str] = field(default_factory=dict)  # how many twins do not give a quantity, and why

    @property
    def best(self) -> Array:
        """The sample of highest density, in the unit cube."""
        return np.asarray(self.samples[int(np.argmax(self.density))])

    @property
    def left_out(self) -> list[Target]:
        """Measured quantities that too few twins give."""
        curves = [target for one in self.curves.values() for target in one.targets]
        return [target for target in (*self.measured, *curves) if target not in self.fitted.targets]

    @property
    def fitted(self) -> Posterior:
        """The posterior of the last update."""
        assert self.posterior is not None
        return self.posterior


@dataclass(frozen=True)
class Search:
    """The lab, its twins and the parameters.

    Attributes
    ----------
    lab : Lab
        With the model whose parameters are changed.
    fitted : sequence of Experiment
        Experiments that are fitted.
    parameters : tuple of Parameter
        With their priors.
    targets : mapping of str to list of Target
        Measured quantities of each experiment, also of those held out.
    measured : mapping of str to sequence of Measurement
        Repetitions of each experiment, for their curves.
    budget : int
        Largest number of runs of the fitted experiments, those of the best set included.
    seed : int
        First seed.
    options : mapping
        Keywords of `twin_run`.
    reserve : int
        Runs of the budget that are kept for candidates of a further experiment, where it is large enough.
    """

    lab: Lab
    fitted: Sequence[Experiment]
    parameters: tuple[Parameter, ...]
    targets: Mapping[str, list[Target]]
    measured: Mapping[str, Sequence[Measurement]]
    budget: int
    seed: int
    options: Mapping[str, Any]
    reserve: int = 0

    @property
    def least(self) -> int:
        """Smallest number of runs: the first design, one batch, and those of the best set."""
        return (self._first + BATCH + CONFIRMED) * len(self.fitted)

    @property
    def _first(self) -> int:
        return max(FEWEST, FIRST * len(self.parameters))

    def run(self, campaign: Campaign, progress: Progress) -> State:
        """Run twins until the posterior is no longer narrowed, the emulators are certain or the budget is spent.

        Parameters
        ----------
        campaign : Campaign
            Computes the twins.
        progress : Progress
            Called with step, finished cost [s] and total cost [s].

        Returns
        -------
        State
            Runs, emulators and samples of the posterior.

        Raises
        ------
        BadInput
            If the budget is too small, or no quantity can be fitted.
        """
        from scipy.stats import qmc

        first = self._first
        if self.budget < self.least:
            raise BadInput(
                f"--budget: {self.budget} runs are too few for {counted(len(self.parameters), 'parameter')} and "
                f"{counted(len(self.fitted), 'experiment')}; give at least {self.least}."
            )
        reserved = self.reserve if self.budget >= self.least + self.reserve else 0
        measured = tuple(target for one in self.fitted for target in self.targets[one.id])
        found = State(measured=measured, results={one.id: [] for one in self.fitted})
        sampler = qmc.Sobol(len(self.parameters), rng=self.seed)
        self._add(found, sampler.random(2 ** math.ceil(math.log2(first)))[:first], campaign, progress)
        for one in self.fitted:
            finished = [result for result in found.results[one.id] if result is not None]
            found.curves[one.id] = curve_targets(one, self.measured.get(one.id, ()), finished)
        self._update(found)
        width, still = self._width(found), 0
        while not found.stopped:
            if found.runs + (BATCH + CONFIRMED) * len(self.fitted) > self.budget - reserved:
                found.stopped = SPENT
                break
            self._add(found, self._next(found), campaign, progress)
            self._update(found)
            before, width = width, self._width(found)
            if self._certain(found):
                found.stopped = "the emulators are more certain than the measurements"
            still = still + 1 if abs(math.log(before / width)) < NARROWED else 0
            if not found.stopped and still == 2:  # one such step may be chance
                found.stopped = "the posterior is no longer narrowed"
        found.samples, found.density, found.converged = sample(found.fitted, seed=self.seed, most=MOST_STEPS)
        return found

    def _add(self, found: State, unit: Array, campaign: Campaign, progress: Progress) -> None:
        start = len(found.unit)
        runs = {
            (k, one.id): self.twin(one, point, f"{one.id}-point-{k:03d}", self.seed + k)
            for k, point in enumerate(unit, start=start)
            for one in self.fitted
        }
        done = results_of(list(runs.values()), campaign, progress, f"twins of {len(unit)} points")
        found.failures.update(done.failures)
        found.runs += len(runs)
        found.unit += list(unit)
        for (_, experiment), run in runs.items():
            found.results[experiment].append(done.results.get(run.name))

    def twin(self, experiment: Experiment, point: Array, name: str, seed: int) -> Run:
        """Return the run of an experiment at a point.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose twin is run.
        point : ndarray, shape (p,)
            Point of the unit cube.
        name : str
            Name of the run.
        seed : int
            Seed of the twin.

        Returns
        -------
        Run
            Run of the twin, not yet computed.
        """
        return twin_run(name, *self.setting(experiment, self.values(point)), seed=seed, **self.options)

    def values(self, point: Array) -> dict[str, float]:
        """Return the values of the parameters at a point.

        Parameters
        ----------
        point : ndarray, shape (p,)
            Point of the unit cube.

        Returns
        -------
        dict of str to float
            Values in SI, by name.
        """
        return {one.name: float(one.value(point[k])) for k, one in enumerate(self.parameters)}

    def setting(self, experiment: Experiment, values: Mapping[str, float], model: Model | None = None) -> Setting:
        """Return an experiment and the model with those values that the twin has.

        Parameters
        ----------
        experiment : Experiment
            Experiment of which the values are set.
        values : mapping of str to float
            Values in SI, by name.
        model : Model, optional
            The model that is changed.  Default: that of the lab.

        Returns
        -------
        Setting
            Experiment and model.
        """
        mine = {name: value for name, value in values.items() if applies(name, experiment)}
        return at(Setting(experiment, self.lab.model if model is None else model), mine)

    def _update(self, found: State) -> None:
        unit = np.array(found.unit)
        fitted: dict[Target, emulators.Emulator] = {}
        residuals = {}
        for one in self.fitted:
            columns = [k for k, parameter in enumerate(self.parameters) if applies(parameter.name, one)]
            for target in (*self.targets[one.id], *found.curves[one.id].targets):
                read = [_read(target, result, found.curves[one.id]) for result in found.results[one.id]]
                values = np.array([value for value, _ in read])
                known = np.isfinite(values)
                if not known.all():
                    why = next(why for value, why in read if not math.isfinite(value))
                    found.missing[target] = f"{len(known) - known.sum()} of {len(known)} twins do not give it: {why}"
                if known.sum() < len(columns) + 3:
                    continue  # too few twins give it so far
                fitted[target] = emulators.fit(unit[known], values[known], seed=self.seed, columns=columns)
                residuals[target] = values - fitted[target].predict(unit)[0]
        targets = tuple(fitted)
        if not targets:
            target, why = next(iter(found.missing.items()))
            why = next(iter(found.failures.values()), why)
            raise BadInput(f"{target.experiment}: {target.quantity} cannot be fitted: {why}")
        together = correlation(targets, residuals)
        found.posterior = Posterior(self.parameters, targets, tuple(fitted.values()), together)
        found.samples, found.density, found.converged = sample(found.fitted, seed=self.seed)

    def _width(self, found: State) -> float:
        """Geometric mean of the posterior's standard deviations, over the ranges."""
        return float(np.exp(np.mean(np.log(np.maximum(np.std(found.samples, axis=0), 1e-6)))))

    def _certain(self, found: State) -> bool:
        shares = found.fitted.shares(found.samples[::20])
        return bool(np.sqrt(shares.mean(axis=0)).max() < CERTAIN)

    def _next(self, found: State) -> Array:
        """Points of the posterior where the emulators are least certain, apart from each other."""
        random = np.random.default_rng(self.seed + len(found.unit))
        pool = found.samples[random.choice(len(found.samples), POOL)]
        gain = found.fitted.shares(pool).sum(axis=1)
        chosen: list[Array] = []
        for _ in range(BATCH):
            near = np.array([np.linalg.norm(pool - one, axis=1) for one in chosen])
            apart = np.ones(len(pool)) if not chosen else 1 - np.exp(-((near.min(axis=0) / APART) ** 2))
            chosen.append(pool[int(np.argmax(gain * apart))])
        return np.array(chosen)

    def predictions(
        self, found: State, held: Sequence[Experiment], campaign: Campaign, progress: Progress
    ) -> Iterator[dict[str, Any]]:
        """Run the twins of the best set, with other seeds than those of the emulators.

        Parameters
        ----------
        found : State
            What the search found; the runs are added to it.
        held : sequence of Experiment
            Experiments that were not fitted.
        campaign, progress : Campaign, Progress
            As for `run`.

        Yields
        ------
        dict
            For each target the measured value with its standard uncertainty, mean and standard deviation of the twins,
            in its unit, the deviation [%], and ``z`` [1].
        """
        best = found.best
        seeds = range(self.seed + CONFIRMING_SEED, self.seed + CONFIRMING_SEED + CONFIRMED)
        runs = {
            (one.id, k): self.twin(one, best, f"{one.id}-best-seed-{k}", k)
            for one in (*self.fitted, *held)
            for k in seeds
        }
        done = results_of(list(runs.values()), campaign, progress, "twins of the best set")
        found.failures.update(done.failures)
        found.runs += len(runs)
        for one in (*self.fitted, *held):
            curves = found.curves.get(one.id)
            for target in (*self.targets[one.id], *([] if curves is None else curves.targets)):
                results = [done.results.get(runs[one.id, k].name) for k in seeds]
                values = np.array([_value(target, result, curves) for result in results])
                yield {**_prediction(target, values[np.isfinite(values)]), "held_out": one in held}


def results_of(runs: Sequence[Run], campaign: Campaign, progress: Progress, stage: str) -> Done:
    """Return the results of runs.

    Parameters
    ----------
    runs : sequence of Run
        Runs whose results are wanted.
    campaign : Campaign
        Computes them.
    progress : Progress
        Called with step, finished cost [s] and total cost [s].
    stage : str
        Name of the step.

    Returns
    -------
    Done
        Results and failures by name.

    Raises
    ------
    RigtwinError
        If one ended by a fault of rigtwin or for want of memory.
    """
    done = campaign.results(runs, progress, stage=stage, retry=False)
    done.raise_faults()
    if done.out_of_memory:
        first = done.out_of_memory[0]
        raise RigtwinError(f"{len(done.out_of_memory)} of {len(runs)} runs failed; {first} {done.failures[first]}")
    return done


def _prediction(target: Target, values: Array) -> dict[str, Any]:
    """A row of the predictions: the twins of the best set beside the measurement."""
    mean = float(np.mean(values)) if len(values) else None
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
    percent = z = None
    if mean is not None:
        percent = None if target.value == 0 else 100 * (mean - target.value) / target.value
        twin = spread or 0.0
        off = math.hypot(scatter(target, twin), target.reading_std, twin / math.sqrt(len(values)))
        z = (mean - target.value) / off if off > 0 else None
    return {
        "experiment": target.experiment, "quantity": target.quantity, "method": target.method, "unit": target.unit,
        "measured": target.value, "std_uncertainty": target.std_uncertainty, "predicted": mean,
        "predicted_std": spread, "percent_deviation": percent, "z": z, "curve": is_component(target.method),
    }  # fmt: skip


def _value(target: Target, result: Result | None, curves: CurveTargets | None) -> float:
    """The quantity of a target in the result of a twin; NaN where it has none or a doubtful one."""
    return _read(target, result, curves)[0]


def _read(target: Target, result: Result | None, curves: CurveTargets | None) -> tuple[float, str]:
    """The quantity of a target in the result of a twin, or NaN and why there is none."""
    if result is None:
        return math.nan, "the run failed"
    if curves is not None and target.quantity in curves.components:
        return curves.values(result).get((target.quantity, target.method), math.nan), "it has no such curve"
    same = [
        one
        for one in quantities_of(dict(result))
        if (one.quantity, one.unit) == (target.quantity, target.unit) and one.detail.get("side") in (None, "mean")
    ]
    # another method counts only if the twin has no more than that one
    method = target.method if len({one.method for one in same}) != 1 else same[0].method
    mine = [one for one in same if one.method == method]
    if not mine:
        return math.nan, "its evaluation has no such result"
    return (math.nan, mine[0].doubtful) if mine[0].doubtful else (mine[0].value, "it is not finite")
