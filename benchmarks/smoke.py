"""Every benchmark in small, two at a time: a script that has stopped working is found before its figures are wanted.

    python benchmarks/smoke.py [--only SCRIPT ...]

Each script runs all its cases with `SMOKE=1` (`figures.small`), which shrinks numbers of particles, frames and
repetitions, and leaves its rows in out/smoke/; hard_footage.py and hard_bulk.py take each hardness with one rig.  A
script fails if it stops with an error, gives fewer rows than `SCRIPTS` says, or a row is NaN without a reason; missed
figures fail nothing.  What needs a program or package that is not installed gives a row that says `skipped` and why.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from rigtwin.benchmarks.figures import OUT, SMOKE, Row, report

HERE = Path(__file__).resolve().parent
RESULTS = OUT if SMOKE else OUT / "smoke"
AT_A_TIME = 2
LONGEST = 1800  # [s], of a script; far above what any takes on a machine with other work


@dataclass(frozen=True)
class Script:
    """A benchmark, the name of its report and how many rows that has at least, wherever it runs."""

    target: str
    rows: int
    path: str  # below this folder


# those that take longest begin first
SCRIPTS = (
    Script("faults", 15, "faults.py"),
    Script("bench-guards", 200, "measure/guards.py"),
    Script("bench-bulk-footage", 25, "measure/hard_bulk.py"),
    Script("bench-footage", 30, "measure/hard_footage.py"),
    Script("decks", 5, "engine/decks.py"),
    Script("bench", 26, "engine/speed.py"),
    Script("own-rigs", 4, "engine/own_rigs.py"),
    Script("bench-measure", 100, "measure/accuracy.py"),
    Script("verify", 210, "engine/verify.py"),
    Script("real-tracks", 4, "diagnose/real_tracks.py"),
    Script("bench-diagnose", 20, "diagnose/verdicts.py"),
    Script("bench-diagnose-independent", 17, "diagnose/independent.py"),
    Script("bench-diagnose-bulk", 6, "diagnose/bulk.py"),
    Script("bench-ground", 9, "measure/background_bias.py"),
    Script("reproduction-page", 2, "reproduce/docs_page.py"),
    Script("fuzz", 6, "fuzz.py"),
    Script("campaign", 16, "campaign/kills.py"),
    Script("soak", 2, "soak.py"),
    Script("beds-from-above", 8, "measure/beds_from_above.py"),
    Script("sweep-speed", 1, "campaign/sweep_speed.py"),
    Script("throughput", 3, "campaign/throughput.py"),
    Script("poured-bed", 8, "engine/poured_bed.py"),
    Script("conical", 3, "engine/conical.py"),
    Script("bench-review", 1, "review/page_speed.py"),
    Script("devices", 2, "engine/devices.py"),
    Script("calibrate_search", 4, "calibrate/search_cost.py"),
    Script("bench-drum-moments", 35, "measure/drum_moments.py"),
    Script("bench-verdicts", 20, "compare/verdict_rates.py"),
    Script("release", 1, "release.py"),
)


@dataclass(frozen=True)
class Ran:
    """How a script fared."""

    script: Script
    seconds: float
    rows: int
    skipped: Sequence[str]  # reasons
    error: str = ""


def ran(script: Script) -> Ran:
    began = time.perf_counter()
    error, rows = "", []
    with (RESULTS / f"{script.target}.log").open("w") as log:
        try:
            code = subprocess.run(
                [sys.executable, str(HERE / script.path)], stdout=log, stderr=subprocess.STDOUT, check=False,
                env=os.environ | {"SMOKE": "1"}, timeout=LONGEST,
            ).returncode  # fmt: skip
        except subprocess.TimeoutExpired:
            code, error = 1, f"took more than {LONGEST} s"
    if code:
        said = Path(log.name).read_text(errors="replace").strip().splitlines() or [""]
        error = error or f"exit code {code}: {said[-1]}"
    else:
        found = RESULTS / f"{script.target}.json"
        rows = json.loads(found.read_text())["rows"] if found.exists() else []
        error = _wrong(script, rows)
    reasons = {row["note"] for row in rows if row["note"].startswith("skipped: ")}
    return Ran(script, time.perf_counter() - began, len(rows), sorted(reasons), error)


def _wrong(script: Script, rows: Sequence[dict[str, object]]) -> str:
    if len(rows) < script.rows:
        return f"{len(rows)} rows, at least {script.rows} are expected"
    for row in rows:
        if math.isnan(row["value"]) and (row["passed"] is not None or not row["note"]):
            return f"NaN: {row['name']}"
    return ""


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [script.path for script in SCRIPTS]
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    options = parser.parse_args(arguments)
    shutil.rmtree(RESULTS, ignore_errors=True)
    RESULTS.mkdir(parents=True)
    rows, began = [], time.perf_counter()
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        for one in pool.map(ran, [script for script in SCRIPTS if script.path in options.only]):
            note = f"{one.rows} rows; {'; '.join([one.error or 'ok', *one.skipped])}"
            sys.stderr.write(f"{one.script.path}: {one.seconds:.0f} s, {note}\n")
            rows.append(Row(one.script.path, one.seconds, "s", None, "runs", not one.error, note))
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    computing = f"{spent.ru_utime + spent.ru_stime:.0f} s of computing"
    rows.append(Row("all", time.perf_counter() - began, "s", note=computing))
    return report("smoke", rows)


if __name__ == "__main__":
    sys.exit(main())
