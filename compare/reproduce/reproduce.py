"""Run what the tables of the paper need, keep every finished run, and write the paper's values beside ours."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare import result_files
from rigtwin.compare.campaign.campaign import run_all
from rigtwin.compare.campaign.run import Done
from rigtwin.compare.campaign.runners import runner
from rigtwin.compare.campaign.store import LEDGER
from rigtwin.compare.report.figure_file import FigureFile, figure_files
from rigtwin.compare.report.fill_template import filled
from rigtwin.compare.reproduce import paper_runs
from rigtwin.compare.reproduce.studies import Points, Study, check_studies, studies
from rigtwin.compare.reproduce.tables import Cell, Plan, check_tables, plan
from rigtwin.compare.twins.run_warnings import once, warned
from rigtwin.lab.errors import BadInput
from rigtwin.lab.formatting import title
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.reference import hlosta2020

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

COLUMNS = (
    "table", "row", "quantity", "unit", "rolling_model", "paper_experiment", "paper_experiment_std", "paper_dem",
    "paper_dem_std", "ours", "ours_std", "runs", "paper_dem_percent_deviation", "ours_percent_deviation",
    "ours_against_paper_dem_percent", "doubtful",
)  # fmt: skip
STUDY_COLUMNS = ("study", "rolling_model", "reading", "place", "unit", "mean", "std", "runs")


@dataclass(frozen=True)
class Reproduction:
    """The cells of the paper with our values."""

    cells: tuple[Cell, ...]
    done: Done
    out: Path
    studies: tuple[Study, ...] = ()
    files: dict[str, Path] = field(default_factory=dict)
    replaced: str = ""
    """A remark on cells and points of earlier files that the new files do not contain."""
    missing: tuple[str, ...] = ()
    """Studies whose runs are not all kept, with `only_kept`."""

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One row per cell, in the paper's order."""
        return [cell.row_of(self.done.results) for cell in self.cells]

    @property
    def tables(self) -> dict[tuple[int, Rolling], list[dict[str, Any]]]:
        """The rows of each table and rolling law."""
        found: dict[tuple[int, Rolling], list[dict[str, Any]]] = {}
        for row in self.rows:
            found.setdefault((row["table"], row["rolling_model"]), []).append(row)
        return found

    @property
    def scores(self) -> list[dict[str, Any]]:
        """For each table and rolling law: cells done, and those that deviate no more than the paper's DEM."""
        found = []
        for (number, law), mine in self.tables.items():
            judged = [row for row in mine if row["ours"] is not None and row["paper_dem_percent_deviation"] is not None]
            found.append(
                {
                    "table": number,
                    "rolling_model": law,
                    "cells": len(mine),
                    "done": sum(row["ours"] is not None for row in mine),
                    "doubtful": sum(bool(row["doubtful"]) for row in mine),
                    "judged": len(judged),
                    "no_further": sum(
                        abs(row["ours_percent_deviation"]) <= abs(row["paper_dem_percent_deviation"]) for row in judged
                    ),
                    **_pattern([row for row in mine if row["quantity"] == "bed_height_deviation"]),
                }
            )
        return found

    def points(self, study: Study) -> Points:
        """The points of a study whose runs have finished."""
        return study.points(self.done.results)

    @property
    def study_rows(self) -> list[dict[str, Any]]:
        """Rows of ``studies.csv``, one for each finished point: mean angle and standard deviation over piles."""
        return [
            {
                "study": study.name,
                "rolling_model": study.rolling,
                "reading": reading,
                "place": place,
                "unit": "deg",
                "mean": mean,
                "std": std,
                "runs": runs,
            }
            for study in self.studies
            for reading, found in self.points(study).items()
            for place, mean, std, runs in found
        ]

    @property
    def assumptions(self) -> Mapping[str, str]:
        """What the paper does not state for these cells, and what was assumed instead."""
        names = dict.fromkeys(name for cell in self.cells for name in cell.assumed)
        laws = dict.fromkeys([cell.rolling for cell in self.cells] + [study.rolling for study in self.studies])
        rolled = {f"rolling, {law}" if len(laws) > 1 else "rolling": paper_runs.ROLLED[law] for law in laws}
        return {name: paper_runs.ASSUMED[name] for name in names} | rolled

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the runs, each kind once in its worst form, with the number of runs."""
        runs = len(self.done.results)
        kinds = once(map(warned, self.done.results.values()))
        return tuple(f"in {count} of {runs} runs: {words}" for words, count in kinds.items())

    def to_json(self) -> dict[str, Any]:
        """The document of `rigtwin reproduce --json`."""
        return {
            "reference": hlosta2020.CITATION,
            "cells": self.rows,
            "scores": self.scores,
            "studies": {study.name: self.points(study) for study in self.studies},
            "assumptions": dict(self.assumptions),
            "failures": dict(self.done.failures),
            "faults": list(self.done.faults),
            "out_of_memory": list(self.done.out_of_memory),
            "warnings": list(self.warnings),
            "replaced": self.replaced,
            "missing": list(self.missing),
            "files": {name: str(path) for name, path in self.files.items()},
        }


def _pattern(rows: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """Rank correlation and mean difference (percentage points) of a table of deviations with the paper's."""
    both = [(row["ours"], row["paper_dem"]) for row in rows if row["ours"] is not None]
    if len(both) < 3 or len({mine for mine, _ in both}) == 1:
        return {"rank_correlation": None, "mean_difference": None}
    from scipy.stats import spearmanr

    correlation = float(spearmanr([mine for mine, _ in both], [theirs for _, theirs in both]).statistic)
    return {
        "rank_correlation": correlation,
        "mean_difference": sum(abs(mine - theirs) for mine, theirs in both) / len(both),
    }


def reproduce(
    out: Path,
    *,
    tables: Sequence[int] | None = None,
    study: Sequence[str] | None = None,
    quick: bool = False,
    only_kept: bool = False,
    rolling: Rolling = "type A",
    repetitions: int | None = None,
    seed: int = 1,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress = silent,
) -> Reproduction:
    """Reproduce tables of Hlosta et al. 2020 and write them beside the paper's values.

    Parameters
    ----------
    out : Path
        Folder for cells.csv, studies.csv, cells.json, report.html and reproduction.md; finished runs are kept in
        ``out/runs`` and not run again.
    tables : sequence of int, optional
        Numbers of the tables; all reproduced ones by default.
    study : sequence of str, optional
        Names of influence studies.  With neither tables nor studies named, and not `quick`, all of both are run.
    quick : bool
        Take a part of each table, and one pile for each point of a study.
    only_kept : bool
        Show kept runs only, run nothing.
    rolling : {"type A", "type A explicit", "type C"}
        Rolling resistance law of all runs; the runs of each law are kept separately.
    repetitions : int, optional
        Runs with different seeds for each cell or point.
    seed : int
        First seed.
    workers : int, optional
        Number of processes of this machine, one for each core by default.
    cluster : str, optional
        A cluster for the runs, as in `rigtwin.compare.campaign.runners.runner`.
    progress : Progress
        Called with step, finished cost [s] and total cost [s].

    Returns
    -------
    Reproduction
        Cells, studies, run results and written files.

    Raises
    ------
    BadInput
        For an unknown table or study, for a table without a quick part, or if nothing is kept with `only_kept`.

    References
    ----------
    Hlosta et al. 2020, tables 4 to 7 and 13 to 16; section 3.4 for the studies.
    """
    check_tables(tables or (), quick=quick)
    check_studies(study or ())
    if only_kept and not (out / "runs" / LEDGER).is_file():  # checked first, as planning takes time
        raise _none_kept(out)
    wanted = Plan((), ())
    if tables or not study:
        wanted = plan(tables, quick=quick, repetitions=repetitions, seed=seed, rolling=rolling)
    asked = (study or ()) if study or tables or quick else None
    runs, shown = studies(asked, repetitions=repetitions, seed=seed, rolling=rolling, quick=quick)
    every = {run.name: run for run in (*wanted.runs, *runs)}
    done = run_all(
        tuple(every.values()),
        out / "runs",
        runner=runner(cluster, workers, out / "runs"),
        only_kept=only_kept,
        progress=progress,
    )
    if only_kept and not done.results:
        raise _none_kept(out)
    missing = tuple(_not_kept(shown, done)) if only_kept else ()
    reproduction = Reproduction(wanted.cells, done, out, tuple(shown), missing=missing)
    reproduction = replace(reproduction, replaced=_replaced(out / "cells.json", reproduction))
    names = ("cells.csv", "studies.csv", "cells.json", "report.html", "reproduction.md")
    figures = drawn_figures(reproduction)
    reproduction.files.update({name: out / name for name in (*names, result_files.FIGURES)})
    contents: dict[str, str | bytes] = {
        "cells.csv": result_files.table(reproduction.rows, COLUMNS),
        "studies.csv": result_files.table(reproduction.study_rows, STUDY_COLUMNS),
        "cells.json": result_files.document(reproduction.to_json()),
        "report.html": page(reproduction, figures),
        "reproduction.md": markdown(reproduction),
        **figure_files("reproduction", figures.values()),
    }
    result_files.write_in_turn(out, contents)
    return reproduction


def _none_kept(out: Path) -> BadInput:
    return BadInput(
        f"{out / 'runs'}: holds no finished run of the requested tables or studies; leave --kept out to run them, or "
        "give --out, --seed and --rolling-model of the kept runs."
    )


def _not_kept(shown: Sequence[Study], done: Done) -> Iterator[str]:
    """A remark for each study whose runs are not all kept."""
    for study in shown:
        names = [name for named in study.places.values() for name in named]
        if lacking := sum(name not in done.results for name in names):
            yield (
                f"study {study.name}, {study.rolling}: lacks {lacking} of {len(names)} runs; "
                "leave --kept out to run them"
            )


def _replaced(file: Path, reproduction: Reproduction) -> str:
    """A remark on what the files of an earlier call show and the new files will not; the runs themselves are kept."""
    try:
        before = set(_shown(json.loads(file.read_text(encoding="utf-8"))))
    except (OSError, ValueError, LookupError, TypeError, AttributeError):  # no such file, or of another kind
        return ""
    lost = before - set(_shown(reproduction.to_json()))
    if not lost:
        return ""
    parts = "; ".join(sorted({part for part, _ in lost}))
    return (
        f"{len(lost)} finished cells or points ({parts}) were in the files of {file.parent} and were not requested now"
        "; their runs are kept, and --kept with the earlier options shows them again"
    )


def _shown(document: Mapping[str, Any]) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """The finished cells and points of a document, each with its table or study."""
    for row in document["cells"]:
        if row["ours"] is not None:
            yield f"table {row['table']}, {row['rolling_model']}", (row["row"], row["quantity"])
    law = document["assumptions"].get("rolling", "")  # all points of a document have one law
    for study, readings in document["studies"].items():
        for reading, points in readings.items():
            for place, *_ in points:
                yield f"study {study}", (reading, place, law)


def drawn_figures(reproduction: Reproduction) -> dict[tuple[str, Rolling], FigureFile]:
    """The figure of each study that has points, by its name and rolling law."""
    from rigtwin.compare.reproduce.figures import study_figure

    found = [(study, reproduction.points(study)) for study in reproduction.studies]
    return {(study.name, study.rolling): study_figure(study, points) for study, points in found if points}


def page(reproduction: Reproduction, figures: Mapping[tuple[str, Rolling], FigureFile]) -> str:
    """The report as one HTML page with its figures."""
    return _filled("reproduction.html", reproduction, figures)


def markdown(reproduction: Reproduction) -> str:
    """The report as Markdown, without figures."""
    return _filled("reproduction.md", reproduction, {})


def _filled(template: str, reproduction: Reproduction, figures: Mapping[tuple[str, Rolling], FigureFile]) -> str:
    found = [(study, reproduction.points(study)) for study in reproduction.studies]
    drawn = [
        (study, _run_places(study, points), points, figures.get((study.name, study.rolling)))
        for study, points in found
        if points
    ]
    return filled(
        template,
        number=number,
        title=title,
        studies=drawn,
        citation=hlosta2020.CITATION,
        tables=list(zip(reproduction.scores, reproduction.tables.values(), strict=True)),
        assumptions=reproduction.assumptions,
        failures=reproduction.done.failures,
        warnings=reproduction.warnings,
    )


def _run_places(study: Study, points: Points) -> list[float | str]:
    done = {at for found in points.values() for at, *_ in found}
    return [place for place in study.places if place in done]


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
