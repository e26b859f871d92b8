"""Simulations that a calibration needs, beside a full grid, random search and CMA-ES.

    SEED=1 COUNT=6 python benchmarks/calibrate/search_cost.py

Static and rolling friction are sought from a packing, a heap and a drum.  The simulation is replaced by an emulator,
fitted to 32 points of our own twins, to which the scatter from seed to seed is added, so that each search can be
repeated.  The emulator is of the same kind as ours, which favours our search.  A search has ended when its best set
fits the measurements within their noise (`ARRIVED`, a third above the mean squared deviation of the true set; without
the scatter of the run).  The best set is the most likely one for our search, for the others the point with the least
misfit among those that were run; for CMA-ES (package `cma`, Hansen & Ostermeier 2001) also the mean of its
distribution.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from rigtwin.benchmarks.calibrate.recovery import RIGS, SMALL, WALL
from rigtwin.benchmarks.figures import OUT, Row, report, skipped, small
from rigtwin.compare.campaign import emulator as emulators
from rigtwin.compare.campaign.calibrate import RANGES
from rigtwin.compare.campaign.campaign import run_all
from rigtwin.compare.campaign.posterior import Parameter, Target
from rigtwin.compare.campaign.run import Done, Run
from rigtwin.compare.campaign.search import Search, State
from rigtwin.compare.campaign.sweep import stated_setting
from rigtwin.compare.campaign.twin_runs import quantities_of, twin_run
from rigtwin.compare.campaign.vary import Setting, at
from rigtwin.lab.file.lab_file import Lab
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.quantity import Quantity

POINTS = small(32, 10)  # of our own twins, to which the stand-in is fitted
REPETITIONS = 3  # of the measurements
ARRIVED = 4 / 3  # mean squared deviation of the quantities, over their variance
MOST = 400  # points of a search that does not arrive
PARAMETERS = tuple(Parameter(name, *bounds) for name, bounds in RANGES.items())
MEASURED = {
    "packing": (("bed_height", "surface bead tops"),),
    "pile": (("angle_of_repose_geometric", "apex"), ("pile_height", "95 % of the top grain band")),
    "drum": (("angle_of_repose_graphical", "line, middle half"), ("angle_of_repose_geometric", "chord, wall to wall")),
}


@dataclass(frozen=True)
class StandIn:
    """Emulators of our twins, by rig, quantity, method and unit."""

    emulators: Mapping[tuple[str, str, str, str], emulators.Emulator]

    def mean(self, unit: np.ndarray) -> np.ndarray:
        """Quantities at a point of the unit cube, without scatter."""
        return np.array([one.predict(unit[None, :])[0][0] for one in self.emulators.values()])

    @property
    def noise(self) -> np.ndarray:
        """Standard deviation from seed to seed."""
        return np.array([one.noise for one in self.emulators.values()])


class StandInCampaign:
    """Gives a `Search` the results of the stand-in."""

    def __init__(self, twin: StandIn) -> None:
        self.twin = twin

    def results(self, runs: Sequence[Run], *_: Any, **__: Any) -> Done:
        """Results of runs, with the scatter of their seeds."""
        return Done({run.name: self._result(run) for run in runs}, {})

    def _result(self, run: Run) -> dict[str, Any]:
        contact = next(one for one in run.settings["contacts"] if one["pair"][0] == one["pair"][1])
        unit = np.array([float(one.unit(np.array(contact[one.name]))) for one in PARAMETERS])
        off = np.random.default_rng(run.settings["seed"]).normal(size=len(self.twin.noise))
        values = self.twin.mean(unit) + off * self.twin.noise
        found = [
            Quantity(quantity, float(value), 0.0, measured_in, method)
            for (rig, quantity, method, measured_in), value in zip(self.twin.emulators, values, strict=True)
            if rig == run.settings["rig"]
        ]
        return {"quantities": [asdict(one) for one in found], "warnings": [], "wall_s": 0.0}


@dataclass(frozen=True)
class WatchedSearch(Search):
    """A search that shows its state after each update."""

    watch: Callable[[State], None] = lambda _: None

    def _update(self, found: State) -> None:
        super()._update(found)
        self.watch(found)


def settings() -> dict[str, Setting]:
    """The rigs of the labs of recovery.py."""
    return {
        rig: stated_setting(rig, stated, particle="D6", wall=WALL)
        for rig, (stated, _) in small(RIGS, SMALL).items()
    }  # fmt: skip


def stand_in() -> StandIn:
    """Emulators of twins of a space-filling design; finished twins are kept."""
    from scipy.stats import qmc

    unit = qmc.Sobol(len(PARAMETERS), rng=5).random(64)[:POINTS]
    runs = {
        (rig, k): twin_run(f"{rig}-{k}", *at(setting, _values(point)), seed=7000 + k)
        for rig, setting in settings().items()
        for k, point in enumerate(unit)
    }
    done = run_all(list(runs.values()), OUT / "calibrate" / "search" / "runs")
    found = {}
    for rig in settings():
        for quantity, method in MEASURED[rig]:
            values = np.full(len(unit), np.nan)
            measured_in = ""
            for k in range(len(unit)):
                for one in quantities_of(done.results[f"{rig}-{k}"]) if f"{rig}-{k}" in done.results else ():
                    if (one.quantity, one.method) == (quantity, method) and one.detail.get("side") in (None, "mean"):
                        values[k], measured_in = one.value, one.unit
            known = np.isfinite(values)
            if known.sum() >= POINTS // 2:
                found[rig, quantity, method, measured_in] = emulators.fit(unit[known], values[known], seed=1)
    return StandIn(found)


def _values(unit: np.ndarray) -> dict[str, float]:
    return {one.name: float(one.value(unit[k])) for k, one in enumerate(PARAMETERS)}


@dataclass(frozen=True)
class Task:
    """A lab whose true parameters are known, and how far a set is from it."""

    twin: StandIn
    measured: np.ndarray
    seed: int

    @property
    def uncertainty(self) -> np.ndarray:
        """Standard uncertainty of the measurements."""
        return self.twin.noise / np.sqrt(REPETITIONS)

    def arrived(self, unit: np.ndarray) -> bool:
        """Whether a set fits within the noise."""
        return float(np.mean(((self.twin.mean(unit) - self.measured) / self.uncertainty) ** 2)) <= ARRIVED

    def seen(self, unit: np.ndarray, seed: int) -> float:
        """The misfit that one run of each rig shows."""
        off = np.random.default_rng([self.seed, seed]).normal(size=len(self.measured)) * self.twin.noise
        return float(np.sum(((self.twin.mean(unit) + off - self.measured) / self.twin.noise) ** 2))


def ours(task: Task) -> int | None:
    """Points until the best set of the posterior has arrived."""
    rigs = settings()
    targets: dict[str, list[Target]] = {rig: [] for rig in rigs}
    for (rig, *what), value, off in zip(task.twin.emulators, task.measured, task.uncertainty, strict=True):
        targets[rig].append(Target(rig, *what, float(value), float(off), REPETITIONS))
    arrived: list[int] = []

    def watch(found: State) -> None:
        if not arrived and task.arrived(found.best):
            arrived.append(len(found.unit))

    fitted = [setting.experiment for rig, setting in rigs.items() if targets[rig]]
    model = Model(contacts={names: known for one in rigs.values() for names, known in one.model.contacts.items()})
    lab = Lab("stand-in", OUT, {}, {}, {}, tuple(fitted), model, (), OUT / "lab.toml")
    search = WatchedSearch(lab, fitted, PARAMETERS, targets, {}, 60 * len(fitted), task.seed, {}, watch=watch)
    search.run(StandInCampaign(task.twin), lambda *_: None)  # type: ignore[arg-type]
    return arrived[0] if arrived else None


def grid(task: Task) -> int | None:
    """Points of the smallest full grid whose best point has arrived."""
    for number in range(2, 21):
        middles = (np.arange(number) + 0.5) / number
        points = np.array(np.meshgrid(middles, middles)).reshape(2, -1).T
        seen = [task.seen(point, 1000 * number + k) for k, point in enumerate(points)]
        if task.arrived(points[int(np.argmin(seen))]):
            return len(points)
    return None


def random_search(task: Task) -> int | None:
    """Points until the best one so far has arrived."""
    random = np.random.default_rng(task.seed)
    best, least = None, np.inf
    for k in range(MOST):
        point = random.random(len(PARAMETERS))
        seen = task.seen(point, 100_000 + k)
        if seen < least:
            best, least = point, seen
        if best is not None and task.arrived(best):
            return k + 1
    return None


def cma_es(task: Task) -> int | None:
    """Points until the best one so far has arrived; the package's defaults, started in the middle."""
    import cma

    middle = [0.5] * len(PARAMETERS)
    strategy = cma.CMAEvolutionStrategy(middle, 0.3, {"bounds": [0, 1], "seed": task.seed + 1, "verbose": -9})
    best, least, count = None, np.inf, 0
    while count < MOST and not strategy.stop():
        points = strategy.ask()
        seen = [task.seen(np.array(point), 200_000 + count + k) for k, point in enumerate(points)]
        strategy.tell(points, seen)
        count += len(points)
        if min(seen) < least:
            best, least = np.array(points[int(np.argmin(seen))]), min(seen)
        if task.arrived(np.array(strategy.result.xfavorite)) or (best is not None and task.arrived(best)):
            return count
    return None


def main() -> int:
    seed, count = int(os.environ.get("SEED", "1")), int(os.environ.get("COUNT", small("10", "1")))
    twin = stand_in()
    searches = {"grid": grid, "random": random_search}
    rows = []
    if find_spec("cma") is None:
        rows.append(skipped("points until the best set fits, CMA-ES", "the package cma (group bench) is not installed"))
    else:
        searches["CMA-ES"] = cma_es
    needed: dict[str, list[float]] = {name: [] for name in ("ours", *searches)}
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="cma")
        for k in range(seed, seed + count):
            random = np.random.default_rng([k, 1])
            off = random.normal(size=len(twin.noise)) * twin.noise / np.sqrt(REPETITIONS)
            task = Task(twin, twin.mean(0.1 + 0.8 * random.random(len(PARAMETERS))) + off, k)
            for name, search in {"ours": ours, **searches}.items():
                needed[name].append(search(task) or MOST)
            print({name: values[-1] for name, values in needed.items()}, flush=True)  # noqa: T201
    median = {name: float(np.median(values)) for name, values in needed.items()}
    best = min(median[name] for name in searches)
    rows += [
        Row(f"points until the best set fits, {name}, median of {count}", value, "1") for name, value in median.items()
    ]
    ratio = best / median["ours"]
    rows.append(Row("fewer than the best of the others by", ratio, "x", None, "at least 3", bool(ratio >= 3)))
    return report("calibrate_search", rows)


if __name__ == "__main__":
    sys.exit(main())
