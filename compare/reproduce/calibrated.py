"""The paper by calibration: its measured coefficients and bulk results as labs, calibrated as any lab, beside its DEM.

Each particle is a lab.toml of typed-in values.  Bed height, the heap on 90 mm and the drum are fitted, the heap on
150 mm and the discharge time are predicted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare import result_files
from rigtwin.compare.campaign.calibrate import calibrate_lab
from rigtwin.compare.measure_repetitions import measuring
from rigtwin.compare.reproduce import paper_runs
from rigtwin.compare.reproduce.tables import in_bed
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.output_files import replacing
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rig_quantities import ABOVE_RIM
from rigtwin.lab.rigs import SLOT_LENGTH
from rigtwin.lab.spelling import suggestion

if TYPE_CHECKING:
    from rigtwin.compare.campaign.calibration import Calibration
    from rigtwin.sim.engine.contact import Rolling

PARTICLES = ("D6", "C6_24s", "P6x15_5s", "D6_ABS", "D5_steel")
FITTED = ("static_friction", "rolling_friction", "scale=0.95..1.05", "rim_height=0mm..18mm")
"""Parameters; the size of the particles, which the paper adjusted by hand, and the rim, which it does not state."""
HELD_OUT = ("piling-150", "hopper")
READING = {"angle_of_repose_graphical": 3.0, "angle_of_repose_geometric": 3.0}
"""[deg], standard uncertainty of where the paper's lines were drawn, which it does not state."""
ANGLES = (
    (14, "angle_of_repose_graphical", "line 15-85 %", "line, middle half"),
    (15, "angle_of_repose_geometric", "apex", "chord, wall to wall"),
)
"""Table, quantity, and methods on heap and drum."""
RIGS = {"piling-90": "piling_90mm", "piling-150": "piling_150mm", "drum": "drum_140mm_3rpm"}
"""Experiments and the names of their rigs in tables 14 and 15."""
CELL_COLUMNS = (
    "particle", "table", "experiment", "quantity", "unit", "held_out", "paper_experiment", "paper_experiment_std",
    "paper_dem", "ours", "ours_std", "paper_dem_percent_deviation", "ours_percent_deviation", "within_std",
    "no_further",
)  # fmt: skip
SET_COLUMNS = ("particle", "parameter", "best", "median", "low", "high", "paper")


@dataclass(frozen=True)
class Calibrated:
    """The labs of the paper, calibrated."""

    found: Mapping[str, Calibration]
    files: dict[str, Path] = field(default_factory=dict)

    @property
    def cells(self) -> list[dict[str, Any]]:
        """A row for each cell of the paper: its experiment, its DEM and our prediction."""
        return [row for name, one in self.found.items() for row in _cells(name, one)]

    @property
    def sets(self) -> list[dict[str, Any]]:
        """A row for each parameter of each particle, beside the paper's calibrated value."""
        return [
            {"particle": name, "parameter": parameter, "best": one.best[parameter], **interval,
             "paper": _of_paper(name, parameter)}
            for name, one in self.found.items()
            for parameter, interval in one.intervals.items()
        ]  # fmt: skip

    @property
    def scores(self) -> dict[str, Any]:
        """Numbers of cells, and of those that are near enough."""
        fitted = [row for row in self.cells if not row["held_out"]]
        times = [row for row in self.cells if row["quantity"] == "discharge_time"]
        near = [row for row in times if row["ours"] is not None and abs(row["ours_percent_deviation"]) <= 10]
        return {
            "fitted": len(fitted),
            "fitted_near": sum(bool(row["within_std"] or row["no_further"]) for row in fitted),
            "discharge_times": len(times),
            "discharge_times_within_10_percent": len(near),
        }

    def to_json(self) -> dict[str, Any]:
        """The document of `rigtwin reproduce --calibrated --json`."""
        return {
            "reference": hlosta2020.CITATION,
            "scores": self.scores,
            "cells": self.cells,
            "sets": self.sets,
            "fits": {name: one.fits for name, one in self.found.items()},
            "ambiguous": {name: one.ambiguous for name, one in self.found.items()},
            "remarks": {name: list(one.remarks) for name, one in self.found.items()},
            "runs": {name: one.runs for name, one in self.found.items()},
            "stopped": {name: one.stopped for name, one in self.found.items()},
            "reading_std_deg": READING,
            "files": {name: str(path) for name, path in self.files.items()},
        }


def reproduce_calibrated(
    out: Path,
    progress: Progress = silent,
    *,
    particles: Sequence[str] | None = None,
    budget: int = 60,
    seed: int = 1,
    rolling: Rolling = "type A",
    workers: int | None = None,
    cluster: str | None = None,
) -> Calibrated:
    """Calibrate particles of Hlosta et al. 2020 on its measurements and write the cells beside the paper's DEM.

    Parameters
    ----------
    out : Path
        Folder for calibrated.csv, calibrated_sets.csv and calibrated.json; the labs lie in ``out/calibrated``, with
        finished runs, which are not run again.
    progress : Progress
        Called with step, finished and total runs.
    particles : sequence of str, optional
        Names out of `PARTICLES`; all by default.
    budget : int
        Largest number of fitted runs of a particle.
    seed : int
        First seed.
    rolling : {"type A", "type A explicit", "type C"}
        Rolling resistance law.
    workers : int, optional
        Number of processes of this machine, one for each core by default.
    cluster : str, optional
        A cluster for the runs, as in `rigtwin.compare.campaign.runners.runner`.

    Returns
    -------
    Calibrated
        Cells, sets and written files.

    Raises
    ------
    BadInput
        For an unknown particle, or too small a budget.

    References
    ----------
    Hlosta et al. 2020, tables 7 to 12 and 14 to 16, and A2 to A7 for its calibrated values.
    """
    for name in particles or ():
        if name not in PARTICLES:
            raise BadInput(f"--particle: {name!r} is not calibrated here; {suggestion(name, PARTICLES)}.")
    found: dict[str, Calibration] = {}
    files = {name: out / name for name in ("calibrated.csv", "calibrated_sets.csv", "calibrated.json")}
    for name in particles or PARTICLES:
        folder = out / "calibrated" / name
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(folder / "lab.toml") as part:
            part.write_text(lab_text(name), encoding="utf-8")
        lab = read_lab(folder)
        with measuring(lab.experiments, folder) as pending:
            stated = pending.results()
        found[name] = calibrate_lab(
            lab, stated, folder / "calibration", _named(progress, name), fit=FITTED, hold_out=HELD_OUT, budget=budget,
            seed=seed, options={"rolling": rolling}, reading=READING, workers=workers, cluster=cluster,
        )  # fmt: skip
    calibrated = Calibrated(found, files)
    contents = {
        "calibrated.csv": result_files.table(calibrated.cells, CELL_COLUMNS),
        "calibrated_sets.csv": result_files.table(calibrated.sets, SET_COLUMNS),
        "calibrated.json": result_files.document(calibrated.to_json()),
    }
    result_files.write_in_turn(out, contents)
    return calibrated


def lab_text(particle: str) -> str:
    """The lab.toml of a particle with what the paper measured.

    Standard deviations of bulk results are those of ten repetitions.  A measured coefficient is a prior with its
    whole standard deviation: the way in which it was measured differs from what a contact law means by it.
    """
    printed = hlosta2020.CLUMPS.get(particle, particle)
    bead = hlosta2020.particle(particle)
    (bed,) = (row for row in hlosta2020.table(7) if row["virtual_particle"] == particle)
    (discharge,) = (row for row in hlosta2020.table(16) if row["particle"] == printed)
    friction = hlosta2020.measured("static_friction", printed, printed)
    text = [f'[lab]\ntitle = "{particle} of {hlosta2020.CITATION}"', _prior(particle, friction.value, friction.std)]
    height = f'bed_height = "{bed["bed_height_exp_mm"]} +- {bed["bed_height_exp_std_mm"]} mm (n = 10)"'
    cylinder = f'cylinder_diameter = "{1e3 * paper_runs.CYLINDER:g} mm"\ncount = {in_bed(particle)}'
    text.append(_experiment("packing", "packing", particle, "PMMA", cylinder, [height]))
    for name, base in (("piling-90", 90e-3), ("piling-150", 150e-3)):
        count = paper_runs.piled_count(base, paper_runs.RIM, bead.mass / bead.effective_density)
        rig = (
            f'variant = "piling"\nbase_diameter = "{1e3 * base:g} mm"\n'
            f'rim_height = "{1e3 * paper_runs.RIM:g} mm"\ncount = {count}'
        )
        text.append(_experiment(name, "pile", particle, "steel", rig, list(_angles(printed, name))))
    drum = (
        f'drum_diameter = "{1e3 * paper_runs.DRUM:g} mm"\ndepth = "{1e3 * paper_runs.DEPTH:g} mm"\n'
        f'fill = {paper_runs.FILL}\nspeed = "3 rpm"'
    )
    text.append(_experiment("drum", "drum", particle, "PMMA", drum, list(_angles(printed, "drum"))))
    hopper = (
        f'variant = "slot"\nbin_width = "150 mm"\ndepth = "{1e3 * SLOT_LENGTH:g} mm"\n'
        f'outlet = "{discharge["outlet_mm"]} mm"\ncount = {int(float(discharge["particles"]))}'
    )
    time = float(discharge["discharge_time_exp_s"])
    shown = f'discharge_time = "{time} +- {0.05 * time:.3g} s"'  # printed without; held out, so it weighs nothing
    text.append(_experiment("hopper", "hopper", particle, "PMMA", hopper, [shown]))
    return "\n\n".join(text) + "\n"


def _prior(particle: str, friction: float, std: float) -> str:
    return _experiment(
        "tilt", "tilt", particle, particle, 'variant = "slide"', [f'static_friction = "{friction} +- {std}"']
    )


def _experiment(name: str, rig: str, particle: str, wall: str, settings: str, stated: Sequence[str]) -> str:
    head = f'[[experiments]]\nid = "{name}"\nrig = "{rig}"\nparticle = "{particle}"\nwall = "{wall}"\n{settings}'
    return "\n".join((head, "[experiments.measured]", *stated))


def _angles(printed: str, experiment: str) -> Iterator[str]:
    """The angles of a heap or drum as entries of lab.toml."""
    for number, quantity, on_heap, in_drum in ANGLES:
        row = _row(number, printed, experiment)
        method = in_drum if experiment == "drum" else on_heap + ABOVE_RIM
        value = f"{row['aor_exp_deg']} +- {row['aor_exp_std_deg']} deg (n = 10)"
        yield f'{quantity} = {{ value = "{value}", method = "{method}" }}'


def _row(number: int, printed: str, experiment: str) -> hlosta2020.Row:
    rows = hlosta2020.table(number)
    return next(row for row in rows if row["particle"] == printed and row["rig"] == RIGS[experiment])


def _cells(particle: str, calibration: Calibration) -> Iterator[dict[str, Any]]:
    printed = hlosta2020.CLUMPS.get(particle, particle)
    for row in calibration.predictions:
        table, dem, std = _printed(particle, printed, row["experiment"], row["quantity"])
        factor, unit = (1e3, "mm") if row["unit"] == "m" else (1.0, row["unit"])
        experiment, ours = factor * row["measured"], None if row["predicted"] is None else factor * row["predicted"]
        theirs = abs(dem - experiment)
        yield {
            "particle": particle, "table": table, "experiment": row["experiment"], "quantity": row["quantity"],
            "unit": unit, "held_out": row["held_out"], "paper_experiment": experiment, "paper_experiment_std": std,
            "paper_dem": dem, "ours": ours,
            "ours_std": None if row["predicted_std"] is None else factor * row["predicted_std"],
            "paper_dem_percent_deviation": 100 * (dem - experiment) / experiment,
            "ours_percent_deviation": row["percent_deviation"],
            "within_std": None if ours is None or std is None else abs(ours - experiment) <= std,
            "no_further": None if ours is None else abs(ours - experiment) <= theirs + 1e-9,
        }  # fmt: skip


def _printed(particle: str, printed: str, experiment: str, quantity: str) -> tuple[int, float, float | None]:
    """Table, the paper's DEM and the experiment's standard deviation of a cell, in the paper's unit."""
    if quantity == "bed_height":
        (row,) = (one for one in hlosta2020.table(7) if one["virtual_particle"] == particle)
        return 7, float(row["bed_height_dem_mm"]), float(row["bed_height_exp_std_mm"])
    if quantity == "discharge_time":
        (row,) = (one for one in hlosta2020.table(16) if one["particle"] == printed)
        return 16, float(row["discharge_time_dem_s"]), None
    number = next(table for table, name, *_ in ANGLES if name == quantity)
    row = _row(number, printed, experiment)
    return number, float(row["aor_dem_deg"]), float(row["aor_exp_std_deg"])


def _of_paper(particle: str, parameter: str) -> float | None:
    """The paper's calibrated value (tables A2 to A7); None of what it does not state."""
    if parameter == "scale":
        return 1.0
    return None if parameter == "rim_height" else getattr(hlosta2020.contact(particle, particle), parameter)


def _named(progress: Progress, name: str) -> Progress:
    return lambda step, done, total: progress(f"{name}: {step}", done, total)
