"""The cells of the paper's tables and the runs that fill them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any

from rigtwin.compare.campaign.run import Run
from rigtwin.compare.reproduce import paper_runs, run_time
from rigtwin.compare.twins.run_warnings import once, spoilt
from rigtwin.lab.errors import BadInput
from rigtwin.lab.reference import hlosta2020

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

Results = Mapping[str, dict[str, Any]]


@dataclass(frozen=True)
class Cell:
    """One number of the paper, and the runs that give ours."""

    table: int
    row: str  # particle, rig and method
    quantity: str
    unit: str
    experiment: float | None
    experiment_std: float | None
    paper_dem: float | None
    paper_dem_std: float | None
    runs: tuple[str, ...]  # names of the runs that give ours
    key: str  # of the number in their results
    assumed: tuple[str, ...] = ()
    off: float | None = None  # if given, the cell is the absolute deviation of the number from this one, in percent
    rolling: Rolling = "type A"  # rolling resistance law of the runs
    comparable: bool = True  # whether ours is the same quantity as the paper's

    def ours(self, results: Results) -> list[float]:
        """Values of the finished runs."""
        found = (result.get(self.key) for result in self._found(results))
        values = [float(value) for value in found if value is not None]
        return values if self.off is None else [100 * abs(value - self.off) / self.off for value in values]

    def row_of(self, results: Results) -> dict[str, Any]:
        """A row of ``cells.csv``: ours beside the paper's experiment and the paper's DEM, deviations in percent."""
        values = self.ours(results)
        ours = fmean(values) if values else None
        comparable = self.comparable and self.off is None and not any(map(self._ran_out, self._found(results)))
        return {
            "table": self.table,
            "row": self.row,
            "quantity": self.quantity,
            "unit": self.unit,
            "rolling_model": self.rolling,
            "paper_experiment": self.experiment,
            "paper_experiment_std": self.experiment_std,
            "paper_dem": self.paper_dem,
            "paper_dem_std": self.paper_dem_std,
            "ours": ours,
            "ours_std": stdev(values) if len(values) > 1 else None,
            "runs": len(values),
            "paper_dem_percent_deviation": _deviation(self.paper_dem, self.experiment),
            "ours_percent_deviation": _deviation(ours, self.experiment),
            # an absolute deviation has lost its sign, so its deviation from the paper's is not defined
            "ours_against_paper_dem_percent": _deviation(ours, self.paper_dem) if comparable else None,
            "doubtful": self.doubtful(results),
        }

    def doubtful(self, results: Results) -> str:
        """Why our value is doubtful; empty if no run gives a reason."""
        found = self._found(results)
        kinds = once([*spoilt(result), *([_ALL_OUT] if self._ran_out(result) else [])] for result in found)
        several = len(found) > 1
        return "; ".join(
            f"{words} ({count} of {len(found)} runs)" if several else words for words, count in kinds.items()
        )

    def _found(self, results: Results) -> list[dict[str, Any]]:
        """The finished runs."""
        return [results[name] for name in self.runs if name in results]

    def _ran_out(self, result: dict[str, Any]) -> bool:
        """Whether the cell counts the particles that left within a time and all had left, so it shows no flow."""
        return self.quantity in _COUNTED and result.get("emptied", 0) >= result.get("asked", math.inf)


@dataclass(frozen=True)
class Plan:
    """The runs and cells of some tables."""

    runs: tuple[Run, ...]
    cells: tuple[Cell, ...]


def plan(
    numbers: Sequence[int] | None,
    *,
    quick: bool,
    repetitions: int | None,
    seed: int,
    rolling: Rolling = "type A",
) -> Plan:
    """All runs that the tables `numbers` need (all tables by default); `quick` takes a representative part.

    Raises `BadInput` for a table that is not reproduced, or that is named and has no quick part.
    """
    check_tables(numbers or (), quick=quick)
    runs: dict[str, Run] = {}
    cells: list[Cell] = []
    for number in numbers or TABLES:
        for needed, cell in TABLES[number](number, quick, repetitions, seed):
            mine = [under(rolling, run) for run in needed]
            runs.update({run.name: run for run in mine})
            cells.append(replace(cell, rolling=rolling, runs=tuple(run.name for run in mine)))
    return Plan(tuple(runs.values()), tuple(cells))


def check_tables(numbers: Sequence[int], *, quick: bool = False) -> None:
    """Raise `BadInput` for a table that is not reproduced, or has no quick part with `quick`."""
    for number in numbers:
        if number not in TABLES:
            raise BadInput(f"--table: table {number} is not reproduced; known are {', '.join(map(str, TABLES))}.")
        if quick and number in _NEVER_QUICK:
            short = ", ".join(str(each) for each in TABLES if each not in _NEVER_QUICK)
            raise BadInput(
                f"--quick: table {number} has no quick part, because each bed of 2000 cubes of 24 spheres takes "
                f"several minutes; leave --quick out, or give --table one of {short}."
            )


def under(rolling: Rolling, run: Run) -> Run:
    """The run with a rolling law.

    With type C it has its name from before there was a choice, so that runs kept then are found.
    """
    if rolling != "type C":
        name = f"{rolling.replace(' ', '_')}-{run.name}"
        run = replace(run, name=name, settings={**run.settings, "rolling": rolling})
    return replace(run, inputs=paper_runs.inputs(run.function.partition(":")[2], run.settings))


_RIGS = "rigtwin.compare.reproduce.paper_runs"

Rows = Iterator[tuple[Sequence[Run], Cell]]

_SWEPT = {4: ("D6", 184.0), 5: ("C6_24s", 202.0), 6: ("P6x15_5s", 190.0)}  # particle, measured height [mm]
_FIRST_FRICTIONS = {"beads": (0.2, 0.01), "C6": (0.5, 0.1), "P6x15": (0.5, 0.1)}  # static, rolling (section 3.1)
_TOPS = "bead_tops_height_mm"
_QUICK_FRICTIONS = ((0.05, 0.01), (0.5, 0.01), (1.5, 0.01), (0.5, 1.0))  # static, rolling
_BASES = {"piling_90mm": 90e-3, "piling_150mm": 150e-3}
_DRUM_SPEED = 3 * 2 * math.pi / 60  # [rad/s]
_QUICK_ANGLES = (
    ("D6", "piling_90mm"),
    ("D6_ABS", "piling_90mm"),
    ("D5_steel", "piling_90mm"),
    ("D6_ABS", "drum_140mm_3rpm"),
)
_QUICK_BEDS = ("D6", "D6_ABS", "D12")
_QUICK_SLOTS = ("D6_ABS", "D12", "P6x15")
_FLOW_MODULI = (1e6, 1e7, 1e8)  # [Pa]; with larger moduli a run takes days
_ALL_OUT = "all had left before the end of the time, so the value does not depend on the flow"
_NEVER_QUICK = (5,)  # tables without a quick part
_COUNTED = ("mass_flow", "emptied_particles")  # within a stated time


def _angles(number: int, quick: bool, repetitions: int | None, seed: int) -> Rows:
    """Tables 14 (graphical) and 15 (geometric)."""
    for row in hlosta2020.table(number):
        particle, rig = str(row["particle"]), str(row["rig"])
        if quick and (particle, rig) not in _QUICK_ANGLES:
            continue
        count = repetitions or (1 if quick else 3)
        base = _BASES.get(rig)
        seeds = range(seed, seed + count)
        runs = [pile_run(particle, base, each) if base else _drum_run(particle, each) for each in seeds]
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
                ("rim", "piled", "pour", "wall") if rig in _BASES else ("drum", "wall"),
            ),
        )


def _beds(number: int, quick: bool, repetitions: int | None, seed: int) -> Rows:
    """Table 7: bed heights of all virtual particles, and the computing time.

    Rows "before calibration" use the parameters that the paper's own simulation had; they have no experiment.
    """
    for row in hlosta2020.table(number):
        particle = str(row["virtual_particle"])
        if quick and particle not in _QUICK_BEDS:
            continue
        yield from _bed(number, row, "", repetitions or (1 if quick else 3), seed)
    for row in () if quick else hlosta2020.table(number):
        sliding, rolling = _FIRST_FRICTIONS[hlosta2020.CLUMPS.get(str(row["virtual_particle"]), "beads")]
        taken = {"static_friction": sliding, "rolling_friction": rolling, "enlarged": False}
        yield from _bed(number, row, "before", repetitions or 1, seed, **taken)


def _bed(number: int, row: hlosta2020.Row, stage: str, repeated: int, seed: int, **taken: Any) -> Rows:
    """One bed of table 7, calibrated or at an earlier stage."""
    particle = str(row["virtual_particle"])
    count = in_bed(particle)
    lasts = run_time.of_bed(particle, count)
    runs = [_run("packing", particle, seed + k, lasts, stage, **taken, count=count) for k in range(repeated)]
    names = tuple(run.name for run in runs)
    experiment, experiment_std, dem, dem_std = (
        None if stage and "exp" in name else float(row[f"bed_height_{name}_mm"])
        for name in ("exp", "exp_std", "dem", "dem_std")
    )
    height = (experiment, experiment_std, dem, dem_std)
    where = f"{particle}, {stage} calibration" if stage else particle
    assumed = ("cylinder", "tops", "wall", *(("d12",) if particle == "D12" else ()), *((stage,) if stage else ()))
    yield runs, Cell(number, where, "bed_height", "mm", *height, names, _TOPS, assumed)
    takes = float(row["cost_s_per_particle"])
    computing = "seconds_per_particle"
    paper = (None, None, takes, None)
    yield runs, Cell(number, where, computing, "s", *paper, names, computing, ("computing",), comparable=False)


def in_bed(particle: str) -> int:
    """Number of particles in the cylinder."""
    if particle == "D12":
        return 390
    printed = hlosta2020.CLUMPS.get(particle, particle)
    return next(int(float(row["pieces"])) for row in hlosta2020.table(3) if row["particle"] == printed)


def _frictions(number: int, quick: bool, repetitions: int | None, seed: int) -> Rows:
    """Tables 4 to 6: deviation of the bed from the measured height, over static and rolling friction."""
    particle, height = _SWEPT[number]
    count = in_bed(particle)
    for row in hlosta2020.table(number):
        sliding, rolling = float(row["mu_s_pp"]), float(row["mu_r_pp"])
        if quick and (number in _NEVER_QUICK or (sliding, rolling) not in _QUICK_FRICTIONS):
            continue
        settings = {"count": count, "static_friction": sliding, "rolling_friction": rolling}
        name = f"{particle}-mus{sliding:g}-mur{rolling:g}"
        runs = [
            Run(
                f"packing-{name}-seed{seed + k}",
                f"{_RIGS}:packing",
                {"particle": particle, "seed": seed + k, **settings},
                run_time.of_bed(particle, count),
            )
            for k in range(repetitions or 1)
        ]
        where = f"{particle}, static friction {sliding:g}, rolling friction {rolling:g}"
        deviation = float(row["height_deviation_percent"])
        yield (
            runs,
            Cell(
                number,
                where,
                "bed_height_deviation",
                "%",
                None,
                None,
                deviation,
                None,
                tuple(run.name for run in runs),
                _TOPS,
                ("cylinder", "tops", "wall", "swept"),
                off=height,
            ),
        )


def _flows(number: int, quick: bool, repetitions: int | None, seed: int) -> Rows:
    """Table 13: flow from the conical hopper against the shear modulus; the paper has no experiment there.

    The paper's flow is the mass that left within 5 s over 5 s.  Ours is given so, and as steady flow, which is a
    different quantity.
    """
    for row in hlosta2020.table(number):
        modulus = float(row["shear_modulus_pa"])
        if modulus not in _FLOW_MODULI[: 1 if quick else None]:
            continue
        runs = [
            Run(
                f"conical-G{modulus:.0e}-seed{seed + k}",
                f"{_RIGS}:conical_hopper",
                {"shear_modulus": modulus, "seed": seed + k},
                run_time.of_flow(15000, modulus),
            )
            for k in range(repetitions or 1)
        ]
        names = tuple(run.name for run in runs)
        flow, emptied = (
            (None, None, float(row[name]), float(row[f"{name.removesuffix(unit)}_std{unit}"]))
            for name, unit in (("mass_flow_g_s", "_g_s"), ("emptied_particles", ""))
        )
        step = (None, None, float(row["timestep_s"]), None)
        where, of, steady = f"D6, G = {modulus:.0e} Pa", ("conical",), "steady_mass_flow_g_s"
        yield runs, Cell(number, where, "emptied_particles", "particles", *emptied, names, "emptied", of)
        yield runs, Cell(number, where, "mass_flow", "g/s", *flow, names, "mass_flow_g_s", of)
        yield runs, Cell(number, where, "steady_mass_flow", "g/s", *flow, names, steady, of, comparable=False)
        yield runs, Cell(number, where, "rayleigh_time_step", "s", *step, names, "rayleigh_step_s")


def _discharges(number: int, quick: bool, repetitions: int | None, seed: int) -> Rows:
    """Table 16: discharge times of the slot hopper."""
    for row in hlosta2020.table(number):
        particle, count = str(row["particle"]), int(float(row["particles"]))
        if quick and particle not in _QUICK_SLOTS:
            continue
        outlet = float(row["outlet_mm"]) * 1e-3
        lasts = run_time.of_discharge(particle, count, float(row["discharge_time_dem_s"]))
        repeated = repetitions or (1 if quick else 3)
        runs = [_run("slot_hopper", particle, seed + k, lasts, count=count, outlet=outlet) for k in range(repeated)]
        yield (
            runs,
            Cell(
                number,
                particle,
                "discharge_time",
                "s",
                float(row["discharge_time_exp_s"]),
                None,
                float(row["discharge_time_dem_s"]),
                None,
                tuple(run.name for run in runs),
                "discharge_time_s",
                ("slot", "wall"),
            ),
        )


def _run(rig: str, particle: str, seed: int, lasts: float, stage: str = "", /, **settings: Any) -> Run:
    name = "-".join(part for part in (rig, particle, stage, f"seed{seed}") if part)
    return Run(name, f"{_RIGS}:{rig}", {"particle": particle, "seed": seed, **settings}, lasts)


def _drum_run(particle: str, seed: int) -> Run:
    inside = {"depth": paper_runs.DEPTH, "fill": paper_runs.FILL}
    return _run("drum", particle, seed, run_time.of_drum(particle, _DRUM_SPEED), speed=_DRUM_SPEED, **inside)


def pile_run(particle: str, base: float, seed: int, count: int | None = None) -> Run:
    """A pile on a base of that diameter [m], poured as for tables 14 and 15; by default with a surplus."""
    settings = {
        "particle": particle,
        "base_diameter": base,
        "seed": seed,
        "fall_height": hlosta2020.particle(particle).diameter,
        **({} if count is None else {"count": count}),
    }
    poured = "" if count is None else f"-{count}"
    name = f"piling_{base * 1e3:.4g}mm-{particle}{poured}-seed{seed}"
    return Run(name, f"{_RIGS}:piling", settings, run_time.of_pile(particle, base, count))


TABLES: dict[int, Callable[[int, bool, int | None, int], Rows]] = {
    4: _frictions,
    5: _frictions,
    6: _frictions,
    7: _beds,
    13: _flows,
    14: _angles,
    15: _angles,
    16: _discharges,
}


def _deviation(value: float | None, reference: float | None) -> float | None:
    return None if value is None or not reference else 100 * (value - reference) / reference
