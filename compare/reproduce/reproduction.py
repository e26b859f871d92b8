"""Run what the tables need, keep every finished run, and set the paper beside ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rigtwin.compare import results
from rigtwin.compare.reproduce import rigs
from rigtwin.compare.reproduce.tables import Cell, plan
from rigtwin.compare.runs import Done, run_all
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.reference import hlosta2020

COLUMNS = (
    "table", "row", "quantity", "unit", "paper_experiment", "paper_experiment_std", "paper_dem", "paper_dem_std",
    "ours", "ours_std", "runs", "paper_dem_percent_deviation", "ours_percent_deviation",
    "ours_against_paper_dem_percent",
)  # fmt: skip


@dataclass(frozen=True)
class Reproduction:
    """The paper's cells with ours beside them."""

    cells: tuple[Cell, ...]
    done: Done
    out: Path
    files: dict[str, Path] = field(default_factory=dict)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One row per cell, in the paper's order."""
        return [cell.row_of(self.done.results) for cell in self.cells]

    @property
    def scores(self) -> list[dict[str, Any]]:
        """Per table: cells done, and in how many we lie no further from the experiment than the paper's DEM does."""
        found = []
        for number in dict.fromkeys(cell.table for cell in self.cells):
            mine = [row for row in self.rows if row["table"] == number]
            judged = [row for row in mine if row["ours"] is not None and row["paper_dem_percent_deviation"] is not None]
            found.append(
                {
                    "table": number,
                    "cells": len(mine),
                    "done": sum(row["ours"] is not None for row in mine),
                    "judged": len(judged),
                    "no_further": sum(
                        abs(row["ours_percent_deviation"]) <= abs(row["paper_dem_percent_deviation"]) for row in judged
                    ),
                }
            )
        return found

    @property
    def assumptions(self) -> Mapping[str, str]:
        """What the paper leaves unsaid in these cells, and what was taken instead."""
        names = dict.fromkeys(name for cell in self.cells for name in cell.assumed)
        return {name: rigs.ASSUMED[name] for name in names}

    def to_json(self) -> dict[str, Any]:
        """The document of `rigtwin reproduce --json`."""
        return {
            "reference": hlosta2020.CITATION,
            "cells": self.rows,
            "scores": self.scores,
            "assumptions": dict(self.assumptions),
            "failures": dict(self.done.failures),
            "files": {name: str(path) for name, path in self.files.items()},
        }


def reproduce(
    out: Path,
    *,
    tables: Sequence[int] | None = None,
    quick: bool = False,
    repetitions: int | None = None,
    seed: int = 1,
    workers: int | None = None,
    progress: Progress = silent,
) -> Reproduction:
    """Fill the paper's tables (all that are reproduced, or those named) and write them into `out`.

    `repetitions` runs with different seeds fill a cell; finished runs are kept in ``out/runs`` and not run again.
    Raises `BadInput` for a table that is not reproduced.
    """
    wanted = plan(tables, quick=quick, repetitions=repetitions, seed=seed)
    done = run_all(wanted.runs, out / "runs", workers=workers, progress=progress)
    reproduction = Reproduction(wanted.cells, done, out)
    names = ("cells.csv", "cells.json", "report.html")
    reproduction.files.update({name: out / name for name in names})
    contents = {
        "cells.csv": results.table(reproduction.rows, COLUMNS),
        "cells.json": results.document(reproduction.to_json()),
        "report.html": page(reproduction),
    }
    results.write_together(out, contents)
    return reproduction


def page(reproduction: Reproduction) -> str:
    """The report as one HTML page."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rigtwin.compare", "templates"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.filters["number"] = number
    return environment.get_template("reproduction.html").render(
        citation=hlosta2020.CITATION,
        tables={
            score["table"]: (score, [row for row in reproduction.rows if row["table"] == score["table"]])
            for score in reproduction.scores
        },
        assumptions=reproduction.assumptions,
        failures=reproduction.done.failures,
    )


def number(value: float | None, std: float | None = None) -> str:
    """A value with its standard deviation as the tables show it.

    >>> number(30.26, 1.42), number(0.0712), number(None)
    ('30.3 ± 1.4', '0.0712', '–')
    """
    if value is None:
        return "–"
    if std is None:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    digits = 1 if abs(value) >= 10 else 2
    return f"{value:.{digits}f} ± {std:.{digits}f}"
