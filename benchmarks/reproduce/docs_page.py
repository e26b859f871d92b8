"""The tables, studies and pictures of docs/reproduction.md anew from the finished runs of a folder.

    python benchmarks/reproduce/docs_page.py out/reproduce/hlosta2020

Cells that these runs give take the place of those in docs/reproduction_cells.csv, points of studies of those in
docs/reproduction_studies.csv, each rolling law's of its own; the others there stay.  Runs and cells that name no law
were made before there was a choice, by type C.  The page is written anew from its first table on; what stands before
is written by hand, and the figures that it quotes are printed.  With `SMOKE=1` runs are made up, and a copy of the page
is written.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from rigtwin.benchmarks.figures import OUT, SMOKE, report
from rigtwin.benchmarks.figures import Row as Figure
from rigtwin.compare import result_files
from rigtwin.compare.campaign.run import Done, same_inputs
from rigtwin.compare.campaign.store import LEDGER, Kept, Store
from rigtwin.compare.reproduce.figures import study_figure
from rigtwin.compare.reproduce.reproduce import COLUMNS, STUDY_COLUMNS, Reproduction, markdown
from rigtwin.compare.reproduce.studies import Points, Study, studies
from rigtwin.compare.reproduce.tables import TABLES, plan
from rigtwin.compare.twins.run_warnings import once, warned
from rigtwin.sim.engine.contact import ROLLING

DOCS = Path(__file__).resolve().parents[2] / "docs"
FIRST = "\n## Table "  # what is written anew begins here
WARNINGS = "\n## What the runs warn of\n"
COUNTS = re.compile(r"^in \d+ of \d+ runs: ")
WORDS = ("row", "quantity", "unit", "rolling_model", "doubtful")  # columns that are no numbers
JUDGED = (7, 14, 15, 16)  # tables with an experiment
REPETITIONS = 10  # of every experiment of the paper


Row = Mapping[str, Any]
Place = tuple[int, str, str, str]
"""Table, row, quantity and rolling law."""
Point = tuple[str, str, str, str]
"""Study, rolling law, reading and place."""
Angle = tuple[float, float | None, int]
"""Mean, standard deviation [deg] and how many piles."""


@dataclass(frozen=True)
class Page(Reproduction):
    """Cells and points of studies with what was run before, where no run is there now."""

    before: Mapping[Place, Row] = field(default_factory=dict)
    points_before: Mapping[Point, Angle] = field(default_factory=dict)
    said_before: Sequence[str] = ()

    @property
    def rows(self) -> list[dict[str, Any]]:
        both = [(row, self.before.get(_place(row), row)) for row in super().rows]
        return [dict(row if row["runs"] >= before["runs"] else before) for row, before in both]

    def points(self, study: Study) -> Points:
        found = {
            (reading, place): (mean, std, runs)
            for reading, points in super().points(study).items()
            for place, mean, std, runs in points
        }
        both: dict[str, list[tuple[float | str, float, float | None, int]]] = {}
        for reading in study.readings:
            for place in study.places:
                before = self.points_before.get((study.name, study.rolling, reading, str(place)))
                known = [one for one in (found.get((reading, place)), before) if one is not None]
                if known:
                    both.setdefault(reading, []).append((place, *max(known, key=lambda one: one[2])))
        return both

    @property
    def warnings(self) -> tuple[str, ...]:
        """Each kind of warning once, in its most severe wording; not counted, as those of earlier runs are missing."""
        return tuple(once([*map(warned, self.done.results.values()), self.said_before]))


def _place(row: Row) -> Place:
    return int(row["table"]), str(row["row"]), str(row["quantity"]), str(row["rolling_model"])


def run_before(cells: Path) -> dict[Place, Row]:
    """The rows of a table of cells."""
    with cells.open(encoding="utf-8", newline="") as lines:
        rows = [
            {"rolling_model": "type C", "doubtful": ""}
            | {name: text if name in WORDS else float(text) if text else None for name, text in row.items()}
            for row in csv.DictReader(lines)
        ]
    return {_place(row): {**row, "table": int(row["table"]), "runs": int(row["runs"])} for row in rows}


def points_run_before(table: Path) -> dict[Point, Angle]:
    """The points of a table of studies."""
    with table.open(encoding="utf-8", newline="") as lines:
        return {
            (row["study"], row["rolling_model"], row["reading"], row["place"]): (
                float(row["mean"]),
                float(row["std"]) if row["std"] else None,
                int(row["runs"]),
            )
            for row in csv.DictReader(lines)
        }


def said_before(text: str) -> tuple[str, ...]:
    """What the page says that runs warn of, without the numbers of runs."""
    lines = text.partition(WARNINGS)[2].partition("\n## ")[0].splitlines()
    return tuple(COUNTS.sub("", line.removeprefix("- ")) for line in lines if line.startswith("- "))


def kept(
    runs: Path,
    before: Mapping[Place, Row],
    points_before: Mapping[Point, Angle] | None = None,
    said: Sequence[str] = (),
) -> Page:
    """The paper's cells and studies with the finished runs of a folder, whichever version of rigtwin made them."""
    found: dict[str, list[Kept]] = {}
    with Store(runs, create=False) as store:
        for row in store.rows():  # the newest of several versions last
            if row.state == "done":
                found.setdefault(_key(row.function, row.settings), []).append(row)
    laws = [(number, law) for number in TABLES for law in ROLLING]
    wanted = [plan([number], quick=False, repetitions=None, seed=1, rolling=law) for number, law in laws]
    studied = [studies(None, seed=1, rolling=law) for law in ROLLING]
    every = [run for one in wanted for run in one.runs] + [run for piles, _ in studied for run in piles]
    fitting = {
        run.name: row.result
        for run in every
        for row in found.get(_key(run.function, run.settings), ())
        if same_inputs(row.inputs, run.inputs)
    }
    done = Done(fitting, {})
    cells = tuple(cell for one in wanted for cell in one.cells)
    every_study = tuple(study for _, shown in studied for study in shown)
    return Page(
        cells, done, runs.parent, every_study, before=before, points_before=points_before or {}, said_before=said
    )


def written(text: str, reproduction: Reproduction) -> str:
    """The page with its tables anew."""
    tables = markdown(reproduction)
    return text[: text.index(FIRST)] + tables[tables.index(FIRST) :].rstrip() + "\n"


def summary(reproduction: Reproduction) -> str:
    """The figures that the page quotes of the tables with an experiment: of each law, and of cells run under all."""
    rows = [row for row in reproduction.rows if row["table"] in JUDGED and row["paper_experiment"] is not None]
    by_law = {law: [row for row in rows if row["rolling_model"] == law] for law in ROLLING}
    run = {law: {_place(row)[:3]: row for row in mine if row["ours"] is not None} for law, mine in by_law.items()}
    run = {law: mine for law, mine in run.items() if mine}
    said = []
    for law, mine in run.items():
        said += [f"{law}: {len(mine)} of {len(by_law[law])} cells run", *_figures(list(mine.values()))]
        said += [
            f"  table {number}: {_no_further([r for r in mine.values() if r['table'] == number])}" for number in JUDGED
        ]
    printed = list({_place(row)[:3]: row for row in rows}.values())
    by_table = {str(number): [row for row in printed if row["table"] == number] for number in JUDGED}
    said += [
        f"{runs} more of the experiment: no further off than the paper's DEM in {share:.0%} of table {name}"
        for name, mine in {"7 to 16": printed, **by_table}.items()
        for runs in (1, REPETITIONS)
        if (share := repeated(mine, runs)) is not None
    ]
    both = set.intersection(*(set(mine) for mine in run.values())) if run else set()
    for law, mine in run.items():
        said += [
            f"{law}, the {len(both)} cells run under all laws",
            *_figures([mine[place] for place in sorted(both)]),
        ]
    return "\n".join(said)


def _no_further(rows: Sequence[Row]) -> str:
    near = sum(abs(r["ours_percent_deviation"]) <= abs(r["paper_dem_percent_deviation"]) for r in rows)
    return f"{near} of {len(rows)}"


def repeated(rows: Sequence[Row], runs: int) -> float | None:
    """In which part of the cells the mean of so many runs more of the experiment would be that near to its mean.

    If runs scatter normally the difference of the means, in standard deviations of one run, is Student's t of the
    `REPETITIONS` that the printed standard deviation is of, times sqrt(1 / REPETITIONS + 1 / runs).
    """
    spread = math.sqrt(1 / REPETITIONS + 1 / runs)
    off = [
        abs(row["paper_dem"] - row["paper_experiment"]) / (row["paper_experiment_std"] * spread)
        for row in rows
        if row["paper_experiment_std"]
    ]
    return float(np.mean(1 - 2 * student.sf(off, REPETITIONS - 1))) if off else None


def _figures(rows: Sequence[Row]) -> list[str]:
    with_std = [row for row in rows if row["paper_experiment_std"]]
    inside = {
        who: sum(abs(row[who] - row["paper_experiment"]) <= row["paper_experiment_std"] for row in with_std)
        for who in ("ours", "paper_dem")
    }
    near = sum(abs(row["ours_against_paper_dem_percent"]) <= 10 for row in rows)
    return [
        f"  no further from the experiment than the paper's DEM: {_no_further(rows)}",
        f"  within a standard deviation of the {len(with_std)} experiments that have one: ours {inside['ours']}, "
        f"paper's DEM {inside['paper_dem']}",
        f"  within 10 % of the paper's DEM: {near}",
    ]


def _key(function: str, settings: object) -> str:
    return json.dumps([function, result_files.plain(settings)], sort_keys=True)


RESULT = {"discharge_time_s": 1.0, "graphical_deg": 20.0, "bead_tops_height_mm": 200.0}


def _make_up(runs: Path, docs: Path) -> None:
    """One run of each cell and of each point of a study, as if finished, and a copy of the page."""
    (docs / "pictures").mkdir(parents=True, exist_ok=True)
    for file in DOCS.glob("reproduction*"):
        shutil.copy(file, docs)
    heaps, shown = studies(None, seed=1, quick=True)
    readings = dict.fromkeys((key for study in shown for key in study.readings.values()), 25.0)
    with Store(runs) as store:
        for one in (*plan(None, quick=True, repetitions=1, seed=1).runs, *heaps):
            store.keep(one, RESULT | readings, 1.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    optional = {"nargs": "?", "default": OUT / "reproduce"} if SMOKE else {}
    parser.add_argument("folder", type=Path, help="where `rigtwin reproduce` keeps its runs", **optional)
    given = parser.parse_args()
    docs = OUT / "docs" if SMOKE else DOCS
    if SMOKE:
        _make_up(given.folder / "runs", docs)
    page_file, cells, points = (docs / f"reproduction{name}" for name in (".md", "_cells.csv", "_studies.csv"))
    if not (given.folder / "runs" / LEDGER).is_file():
        parser.error(f"{given.folder / 'runs'}: no finished run; give the --out of `rigtwin reproduce`.")
    text = page_file.read_text(encoding="utf-8")
    reproduction = kept(given.folder / "runs", run_before(cells), points_run_before(points), said_before(text))
    page_file.write_text(written(text, reproduction), encoding="utf-8")
    run = [row for row in reproduction.rows if row["ours"] is not None or row["doubtful"]]
    cells.write_text(result_files.table(run, COLUMNS), encoding="utf-8")
    points.write_text(result_files.table(reproduction.study_rows, STUDY_COLUMNS), encoding="utf-8")
    for study in reproduction.studies:
        if study.points(reproduction.done.results):  # else the picture that is there stays
            picture = docs / "pictures" / f"study-{study.name}-{study.rolling.replace(' ', '-')}.svg"
            picture.write_text(study_figure(study, reproduction.points(study)).svg, encoding="utf-8")
    print(summary(reproduction))  # noqa: T201
    if not SMOKE:
        return 0
    return report(
        "reproduction-page", [Figure("cells run", len(run)), Figure("runs found", len(reproduction.done.results))]
    )


if __name__ == "__main__":
    sys.exit(main())
