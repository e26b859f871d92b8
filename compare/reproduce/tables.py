"""Which runs fill which cells of the paper's tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Any

from rigtwin.compare.reproduce import rigs
from rigtwin.compare.runs import Run
from rigtwin.lab.errors import BadInput
from rigtwin.lab.reference import hlosta2020

Results = Mapping[str, dict[str, Any]]


@dataclass(frozen=True)
class Cell:
    """One number of the paper, with ours beside it."""

    table: int
    row: str  # which particle, rig and method
    quantity: str
    unit: str
    experiment: float | None
    experiment_std: float | None
    paper_dem: float | None
    paper_dem_std: float | None
    runs: tuple[str, ...]  # names of the runs that give ours
    key: str  # of the number in their results
    assumed: tuple[str, ...] = ()

    def ours(self, results: Results) -> list[float]:
        """What the finished runs gave."""
        return [float(results[name][self.key]) for name in self.runs if name in results and self.key in results[name]]

    def row_of(self, results: Results) -> dict[str, Any]:
        """A row of ``cells.csv``: ours beside the paper's experiment and the paper's DEM, deviations in percent."""
        values = self.ours(results)
        ours = fmean(values) if values else None
        return {
            "table": self.table,
            "row": self.row,
            "quantity": self.quantity,
            "unit": self.unit,
            "paper_experiment": self.experiment,
            "paper_experiment_std": self.experiment_std,
            "paper_dem": self.paper_dem,
            "paper_dem_std": self.paper_dem_std,
            "ours": ours,
            "ours_std": stdev(values) if len(values) > 1 else None,
            "runs": len(values),
            "paper_dem_percent_deviation": _deviation(self.paper_dem, self.experiment),
            "ours_percent_deviation": _deviation(ours, self.experiment),
            "ours_against_paper_dem_percent": _deviation(ours, self.paper_dem),
        }


@dataclass(frozen=True)
class Plan:
    """The runs and cells of some tables."""

    runs: tuple[Run, ...]
    cells: tuple[Cell, ...]


def plan(numbers: Sequence[int] | None, *, quick: bool, repetitions: int | None, seed: int) -> Plan:
    """All runs that the tables `numbers` need (all tables by default); `quick` takes a representative part."""
    for number in numbers or ():
        if number not in TABLES:
            raise BadInput(f"--table: table {number} is not reproduced; there are {', '.join(map(str, TABLES))}.")
    runs: dict[str, Run] = {}
    cells: list[Cell] = []
    for number in numbers or TABLES:
        for needed, cell in TABLES[number](number, quick, repetitions, seed):
            runs.update({run.name: run for run in needed})
            cells.append(cell)
    return Plan(tuple(runs.values()), tuple(cells))


Rows = Iterator[tuple[Sequence[Run], Cell]]

SPHERES = ("D4", "D6", "D12", "D6_ABS", "D5_steel")
_BASES = {"piling_90mm": 90e-3, "piling_150mm": 150e-3}
_QUICK_PILES = (("D6", "piling_90mm"), ("D6_ABS", "piling_90mm"), ("D5_steel", "piling_90mm"), ("D12", "piling_150mm"))


def _angles(number: int, quick: bool, repetitions: int | None, seed: int) -> Rows:
    """Tables 14 (graphical) and 15 (geometric)."""
    for row in hlosta2020.table(number):
        particle, rig = str(row["particle"]), str(row["rig"])
        if rig not in _BASES or particle not in SPHERES or (quick and (particle, rig) not in _QUICK_PILES):
            continue
        count = repetitions or (1 if quick else 3)
        runs = [_pile_run(particle, rig, seed + k) for k in range(count)]
        method = "graphical" if number == 14 else "geometric"
        experiment, experiment_std, dem, dem_std = (
            float(row[name]) for name in ("aor_exp_deg", "aor_exp_std_deg", "aor_dem_deg", "aor_dem_std_deg")
        )
        yield (
            runs,
            Cell(
                number,
                f"{particle}, {rig.replace('_', ' ')}",
                f"angle_of_repose_{method}",
                "deg",
                experiment,
                experiment_std,
                dem,
                dem_std,
                tuple(run.name for run in runs),
                f"{method}_deg",
                ("rim", "piled"),
            ),
        )


def _pile_run(particle: str, rig: str, seed: int) -> Run:
    base = _BASES[rig]
    bead = hlosta2020.particle(particle)
    count = rigs.piled_count(base, rigs.RIM, bead.mass / bead.effective_density)
    settings = {"particle": particle, "base_diameter": base, "seed": seed}
    return Run(f"{rig}-{particle}-seed{seed}", "rigtwin.compare.reproduce.rigs:piling", settings, count)


TABLES: dict[int, Callable[[int, bool, int | None, int], Rows]] = {14: _angles, 15: _angles}


def _deviation(value: float | None, reference: float | None) -> float | None:
    return None if value is None or not reference else 100 * (value - reference) / reference
