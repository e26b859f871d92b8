"""Wall time of a sweep of packings by rigtwin and by LIGGGHTS, two runs at a time, and the bed heights of both.

    COUNT=4 python benchmarks/campaign/sweep_speed.py

COUNT is the number of packings, rounded to a grid; all are a grid of 8 x 7 values of static and rolling friction
between 3000 beads D6.  A block of points is swept by ``rigtwin sweep``, and by LIGGGHTS with the decks of ``rigtwin
export``, one after the other and in turn, so that both meet the same state of the machine.  The time of a sweep is that
of the whole command; of LIGGGHTS only its runs count.  Finished blocks are kept in ``out/sweep-speed``, so that an
interrupted benchmark continues; delete the folder to measure anew.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import fmean, stdev
from typing import NamedTuple

import numpy as np
import pandas as pd

from rigtwin.benchmarks.engine.decks import BINARY, run_deck, value_of
from rigtwin.benchmarks.figures import OUT, Row, report, skipped, small
from rigtwin.compare.twins.imported import imported_twin
from rigtwin.lab.version import __version__
from rigtwin.sim.decks.deck import read_deck

AT_A_TIME = 2
ROWS, COLUMNS = 8, 7
STATIC, ROLLING = np.linspace(0.05, 1.5, ROWS), np.linspace(0.01, 0.3, COLUMNS)
ROWS_EACH = 2  # of a block: an even number of runs, none of which ends alone
COUNT = int(os.environ.get("COUNT", str(small(ROWS * COLUMNS, 2))))
BEADS, DIAMETER = small(3000, 60), small("65mm", "30mm")
KEPT = OUT / "sweep-speed"
METHOD = "mean surface"
WANTED, SAME = 2.0, 3.0  # ratio of the times; deviation of the heights [%], as in decks.py


class Block(NamedTuple):
    """Points that are swept at once: all pairs of these coefficients."""

    static: tuple[float, ...]
    rolling: tuple[float, ...]

    @property
    def points(self) -> list[tuple[float, float]]:
        return [(static, rolling) for static in self.static for rolling in self.rolling]

    @property
    def folder(self) -> Path:
        """Where its results are kept, another one for other settings."""
        what = json.dumps([__version__, BEADS, DIAMETER, self.points])
        return KEPT / hashlib.sha256(what.encode()).hexdigest()[:12]


class Swept(NamedTuple):
    """Wall-clock and processor time of a block [s], and bed heights [m] by static and rolling friction."""

    seconds: float
    computing: float
    heights: dict[tuple[float, float], float]


def blocks(count: int) -> list[Block]:
    """About so many points, spread over the grid."""
    number = min(max(round(math.sqrt(count * ROWS / COLUMNS) / ROWS_EACH), 1), ROWS // ROWS_EACH)
    across = min(max(round(count / (number * ROWS_EACH)), 1), COLUMNS)
    static = _spread(STATIC, number * ROWS_EACH)
    rolling = _spread(ROLLING, across)
    return [Block(tuple(static[k::number]), tuple(rolling)) for k in range(number)]


def _spread(levels: np.ndarray, number: int) -> list[float]:
    return [float(f"{levels[round(k)]:.6g}") for k in np.linspace(0, len(levels) - 1, number)]


def by_rigtwin(block: Block) -> Swept:
    out = block.folder / "rigtwin"
    shutil.rmtree(out, ignore_errors=True)  # a part would save time
    values = {"static_friction": block.static, "rolling_friction": block.rolling}
    vary = [word for name, of in values.items() for word in ("--vary", f"{name}={','.join(map(str, of))}")]
    rig = ["--set", f"cylinder_diameter={DIAMETER}", "--particle", "D6", "--wall", "PMMA", "--count", str(BEADS)]
    times = timed(lambda: rigtwin("sweep", "packing", *rig, *vary, "--workers", str(AT_A_TIME), "--out", str(out)))
    table = pd.read_csv(out / "sweep.csv")
    beds = table[(table["quantity"] == "bed_height") & (table["method"] == METHOD)]
    rows = zip(beds["static_friction"], beds["rolling_friction"], beds["simulated"], strict=True)
    return Swept(*times, {(static, rolling): height for static, rolling, height in rows})


def by_liggghts(block: Block) -> Swept:
    folders = {point: block.folder / "liggghts" / f"{point[0]}-{point[1]}" for point in block.points}
    for (static, rolling), folder in folders.items():
        shutil.rmtree(folder, ignore_errors=True)
        rig = ["--cylinder-diameter", DIAMETER, "--particle", "D6", "--wall", "PMMA", "--count", str(BEADS)]
        contact = ["--static-friction", str(static), "--rolling-friction", str(rolling)]
        rigtwin("export", "liggghts", "packing", *rig, *contact, "--out", str(folder))
    decks = {folder: read_deck(folder) for folder in folders.values()}
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        times = timed(lambda: list(pool.map(run_deck, decks.values(), decks)))
    twins = {point: imported_twin(folder) for point, folder in folders.items()}
    return Swept(*times, {point: value_of(twin, "bed_height", METHOD)[0] for point, twin in twins.items()})


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Wall-clock time, and processor time of the processes that it starts [s]."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    work()
    seconds, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def rigtwin(*words: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rigtwin", *words, "--quiet"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"rigtwin {words[0]} stopped with code {done.returncode}: {done.stderr.strip()}")


def kept(block: Block, code: str, sweep: Callable[[Block], Swept]) -> Swept:
    """What a code gives for a block; read if it has finished before."""
    file = block.folder / f"{code}.json"
    if file.is_file():
        *times, heights = json.loads(file.read_text())
        return Swept(*times, {(static, rolling): height for static, rolling, height in heights})
    found = sweep(block)
    heights = [[*point, height] for point, height in found.heights.items()]
    file.write_text(json.dumps([found.seconds, found.computing, heights]))
    sys.stderr.write(
        f"{len(block.points)} packings by {code}: {found.seconds:.1f} s, {found.computing:.1f} s computing\n"
    )
    return found


def main() -> int:
    if shutil.which(BINARY["liggghts"]) is None:
        return report("sweep-speed", [skipped("time of LIGGGHTS over ours", "liggghts is not installed")])
    codes = [("rigtwin", by_rigtwin), ("liggghts", by_liggghts)]
    swept: dict[str, list[Swept]] = {"rigtwin": [], "liggghts": []}
    off: list[float] = []
    for number, block in enumerate(blocks(COUNT)):
        block.folder.mkdir(parents=True, exist_ok=True)
        found = {code: kept(block, code, sweep) for code, sweep in codes[:: 1 if number % 2 == 0 else -1]}
        for code, one in found.items():
            swept[code].append(one)
        ours, theirs = found["rigtwin"].heights, found["liggghts"].heights
        off += [ours[point] / theirs[point] - 1 for point in block.points]
    each = ", ".join(f"{theirs.seconds / ours.seconds:.2f}" for ours, theirs in zip(*swept.values(), strict=True))
    wall, cpu = ({code: sum(one[k] for one in ones) for code, ones in swept.items()} for k in (0, 1))
    ratio, of_computing = (times["liggghts"] / times["rigtwin"] for times in (wall, cpu))
    mean, scatter = 100 * fmean(off), 100 * stdev(off) if len(off) > 1 else math.nan
    packings, heights = f"{len(off)} packings of {BEADS}, {AT_A_TIME} at a time", "bed heights, ours over LIGGGHTS:"
    wanted = f"at least {WANTED:g}", f"within {SAME:g} %"
    return report(
        "sweep-speed",
        [
            Row("time of LIGGGHTS over ours", ratio, "1", None, wanted[0], ratio >= WANTED, f"of each block {each}"),
            Row("time of rigtwin", wall["rigtwin"], "s", note=packings),
            Row("time of LIGGGHTS", wall["liggghts"], "s", note=packings),
            Row("processor time of LIGGGHTS over ours", of_computing, note="other work on the machine matters less"),
            Row(f"{heights} mean deviation", mean, "%", None, wanted[1], abs(mean) <= SAME),
            Row(f"{heights} standard deviation", scatter, "%", note="over the packings"),
            Row(f"{heights} largest deviation", 100 * max(off, key=abs), "%"),
        ],
    )


if __name__ == "__main__":
    sys.exit(main())
