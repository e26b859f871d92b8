"""The tables, studies and pictures of docs/reproduction.md anew from the finished runs in docs/reproduction/runs.

    python benchmarks/reproduction_page.py [--from out/reproduce/hlosta2020]

What these runs give takes the place of everything from the first table on; what stands before it is written by hand,
and the figures that it quotes are printed.  With `--from` that folder's finished runs are taken over first.
"""

from __future__ import annotations

import argparse
import json
import shutil
from dataclasses import replace
from pathlib import Path

from rigtwin.compare import results
from rigtwin.compare.figures import study_figure
from rigtwin.compare.reproduce.reproduction import COLUMNS, Reproduction, page
from rigtwin.compare.reproduce.studies import studies
from rigtwin.compare.reproduce.tables import plan
from rigtwin.compare.runs import Done

DOCS = Path(__file__).resolve().parent.parent / "docs"
FIRST = "\n## Table "  # what is written anew begins here
HEIGHTS = {"tops": "bead_tops_height_mm", "mean surface": "surface_height_mm"}
JUDGED = (7, 14, 15, 16)  # tables with an experiment


def kept(runs: Path) -> Reproduction:
    """The paper's cells and studies with the finished runs of a folder, whichever version of rigtwin made them."""
    found = {}
    for file in sorted(runs.glob("*.json")):
        record = json.loads(file.read_text(encoding="utf-8"))
        found[_key(record["function"], record["settings"])] = record["result"]
    wanted = plan(None, quick=False, repetitions=None, seed=1)
    piles, shown = studies(None, seed=1)
    asked = {run.name: _key(run.function, run.settings) for run in (*wanted.runs, *piles)}
    done = Done({name: found[key] for name, key in asked.items() if key in found}, {})
    return Reproduction(wanted.cells, done, runs.parent, tuple(shown))


def written(text: str, reproduction: Reproduction) -> str:
    """The page with its tables anew."""
    tables = page(reproduction, "reproduction.md")
    return text[: text.index(FIRST)] + tables[tables.index(FIRST) :].rstrip() + "\n"


def summary(reproduction: Reproduction) -> str:
    """The figures that the page quotes of the tables with an experiment."""
    rows = [row for row in reproduction.rows if row["table"] in JUDGED]
    run = [row for row in rows if row["ours"] is not None]
    no_further = sum(abs(r["ours_percent_deviation"]) <= abs(r["paper_dem_percent_deviation"]) for r in run)
    with_std = [row for row in run if row["paper_experiment_std"]]
    inside = {
        who: sum(abs(row[who] - row["paper_experiment"]) <= row["paper_experiment_std"] for row in with_std)
        for who in ("ours", "paper_dem")
    }
    near = sum(abs(row["ours_against_paper_dem_percent"]) <= 10 for row in run)
    return "\n".join(
        (
            f"{len(run)} of {len(rows)} cells run",
            f"no further from the experiment than the paper's DEM: {no_further} ({no_further / max(len(run), 1):.0%})",
            f"within a standard deviation of the {len(with_std)} experiments that have one: ours {inside['ours']}, "
            f"paper's DEM {inside['paper_dem']}",
            f"within 10 % of the paper's DEM: {near}",
            *(f"swept beds by {name}: {_patterns(reproduction, key)}" for name, key in HEIGHTS.items()),
        )
    )


def _patterns(reproduction: Reproduction, key: str) -> str:
    """How alike tables 4 to 6 are to the paper's where a bed's height is read so."""
    cells = tuple(replace(cell, key=key) for cell in reproduction.cells if cell.off is not None)
    return ", ".join(
        f"table {score['table']} rank correlation {score['rank_correlation']:.2f}, "
        f"mean distance {score['mean_difference']:.1f} points ({score['done']} of {score['cells']})"
        for score in replace(reproduction, cells=cells).scores
        if score["rank_correlation"] is not None
    )


def _key(function: str, settings: object) -> str:
    return json.dumps([function, settings], sort_keys=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--from", dest="folder", type=Path, help="take over the finished runs of this folder first")
    given = parser.parse_args()
    runs = DOCS / "reproduction" / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    if given.folder is not None:
        for file in (given.folder / "runs").glob("*.json"):
            shutil.copy(file, runs)
    reproduction = kept(runs)
    text = (DOCS / "reproduction.md").read_text(encoding="utf-8")
    (DOCS / "reproduction.md").write_text(written(text, reproduction), encoding="utf-8")
    (DOCS / "reproduction" / "cells.csv").write_text(results.table(reproduction.rows, COLUMNS), encoding="utf-8")
    for study in reproduction.studies:
        if points := study.points(reproduction.done.results):
            picture = DOCS / "pictures" / f"study-{study.name}.svg"
            picture.write_text(study_figure(study, points), encoding="utf-8")
    print(summary(reproduction))  # noqa: T201


if __name__ == "__main__":
    main()
