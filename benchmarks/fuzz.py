"""Damaged and absurd input: every command ends with a result, or with one sentence, or a list, and exit code 2.

    SEED=1 COUNT=10000 python benchmarks/fuzz.py

Files that are right and options are changed by chance: bytes flipped, cut, doubled, numbers made extreme, words
exchanged (`fuzz_cases.kinds` lists the kinds).  The commands run one after the other in a process of its own, in the
way of the command line; where that process dies or hangs, another goes on behind the case.  What an accepted table,
lab.toml or model.toml was read as is compared with an independent reading.  Inputs of cases that ended wrongly are
kept in out/fuzz.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

from rigtwin.benchmarks.figures import SMOKE, Row, report, small
from rigtwin.benchmarks.fuzz_cases.case import NOT_RUN
from rigtwin.benchmarks.fuzz_cases.running import FAULTS, LONGEST, MEMORY, End, keep_input, run_cases

SEED = int(os.environ.get("SEED", "1"))
COUNT = int(os.environ.get("COUNT", str(small(10000, 27))))
FIRST = 3 * LONGEST  # [s], of the first case of a process, which imports all libraries
BLOCK = 500  # cases of a process: what libraries keep must not add up

REASONS = {
    "exit": "a fault of rigtwin",
    "died": "the process died",
    "hang": f"a case took more than {LONGEST:g} s",
    "memory": f"more than {MEMORY:g} MB",
    "words": "refused in more than a sentence or a list",
    "wrong": "read as another number",
}


def judged() -> list[End]:
    """All cases."""
    ends: list[End] = []
    following = 0
    while following < COUNT:
        block = _block(following, min(COUNT, following + BLOCK))
        ends += block
        following = block[-1].number + 1 if block else following + 1
        if not SMOKE:
            wrong = sum(bool(end.wrong) for end in ends)
            sys.stderr.write(f"{following} of {COUNT} cases, {wrong} of them wrong\n")
    return ends


def _block(first: int, end: int) -> list[End]:
    """Cases from `first` up to `end`, or up to one at which the process died or hung."""
    words = [sys.executable, str(Path(__file__).resolve()), str(first), str(end)]
    ends: list[End] = []
    begun: dict[str, Any] = {}
    FAULTS.mkdir(parents=True, exist_ok=True)
    quiet = os.environ | {"OPENCV_LOG_LEVEL": "SILENT"}  # as the command line does
    with (
        (FAULTS / "stderr.log").open("a") as log,
        subprocess.Popen(words, stdout=subprocess.PIPE, stderr=log, text=True, env=quiet) as child,
    ):
        assert child.stdout is not None
        stopped = threading.Event()
        guard = _guard(child, FIRST, stopped)
        for line in child.stdout:
            guard.cancel()
            entry = json.loads(line)
            if "begun" in entry:
                begun = entry
            else:
                ends.append(End(**entry))
            guard = _guard(child, LONGEST if ends else FIRST, stopped)
        guard.cancel()
    if child.returncode != 0:
        # it may also die while the files of the next case are written
        number = max(begun.get("begun", first), ends[-1].number + 1 if ends else first)
        folder = Path(begun.get("folder", "/nowhere"))
        if folder.is_dir():
            keep_input(folder, SEED, number)
            shutil.rmtree(folder, ignore_errors=True)
        wrong = "hang: no end" if stopped.is_set() else f"died: exit {child.returncode}"
        ends.append(End(number, begun.get("kind", "start"), child.returncode, LONGEST, 0.0, "", wrong))
    return ends


def _guard(child: subprocess.Popen[str], seconds: float, stopped: threading.Event) -> threading.Timer:
    def stop() -> None:
        stopped.set()
        child.kill()

    timer = threading.Timer(seconds, stop)
    timer.daemon = True
    timer.start()
    return timer


def refusals(ends: list[End]) -> dict[str, dict[str, int]]:
    """How often each refusal was reached, by kind: its words without paths, numbers and what is quoted."""
    found: dict[str, Counter[str]] = {}
    for end in ends:
        if end.code == 2:
            found.setdefault(end.kind, Counter())[end.words()] += 1
    return {kind: dict(counted.most_common()) for kind, counted in found.items()}


def main() -> int:
    if len(sys.argv) == 3:
        run_cases(SEED, range(int(sys.argv[1]), int(sys.argv[2])), every_kind=SMOKE)
        return 0
    began = time.monotonic()
    ends = judged()
    seconds = time.monotonic() - began
    rows = []
    for reason, name in REASONS.items():
        found = [end for end in ends if end.wrong.partition(":")[0] == reason]
        note = "; ".join(f"case {end.number}, {end.kind}: {end.wrong[-140:]}" for end in found[:3])
        rows.append(Row(name, float(len(found)), "1", 0.0, f"0 of {len(ends)}", not found, note))
    most, longest = max(ends, key=lambda end: end.peak_mb), max(ends, key=lambda end: end.seconds)
    large, long = (f"case {end.number}, {end.kind}" for end in (most, longest))
    rows.append(Row("largest memory", most.peak_mb, "MB", None, f"below {MEMORY:g}", most.peak_mb < MEMORY, large))
    rows.append(Row("longest case", longest.seconds, "s", None, f"below {LONGEST:g}", longest.seconds < LONGEST, long))
    rows.append(Row("mean time of a case", seconds / max(1, len(ends)), "s"))
    cut = sum(end.said.strip().endswith(NOT_RUN) for end in ends)
    rows.append(Row("ended here once all was read", float(cut), note="diagnoses not fitted, twins not run"))
    for kind, total in sorted(Counter(end.kind for end in ends).items()):
        own = [end for end in ends if end.kind == kind]
        mean, results = sum(end.seconds for end in own) / total, sum(end.code == 0 for end in own)
        rows.append(Row(f"{kind}: cases", float(total), note=f"{results} with a result, {mean:.2f} s each"))
    return report(
        "fuzz", rows, seed=SEED, count=COUNT, refusals=refusals(ends), wrong=[vars(end) for end in ends if end.wrong]
    )


if __name__ == "__main__":
    sys.exit(main())
