"""How many packings a campaign settles in an hour of a core, and how they lie; also beside another checkout.

    COUNT=64 python benchmarks/campaign/throughput.py [--particle D6] [--beads 1000] [--beside /path/to/checkout]

A block of packings with different seeds is run by ``rigtwin sweep``, two at a time, so that start, filling, settling,
reading of the height and keeping of the results all count.  With ``--beside`` the same blocks are run by that checkout
in turn with this one, so that both meet the same state of the machine; the figures are ratios then.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import pandas as pd

from rigtwin.benchmarks.figures import Row, report, small
from rigtwin.lab.reference import hlosta2020

AT_A_TIME = 2
COUNT = int(os.environ.get("COUNT", str(small(64, 2))))
BLOCK = small(8, 2)  # packings of one sweep
BEADS, DIAMETER = small(1000, 60), small("65mm", "30mm")
METHOD = "mean surface"
WANTED = 0.5  # of the wall time of the checkout beside
SAME = 3.0  # standard errors of the difference between the mean heights


class Block(NamedTuple):
    """Packings that were swept at once."""

    seconds: float  # wall clock
    computing: float  # [s], of all processes
    runs: int
    height: float  # [m], mean
    scatter: float  # [m], standard deviation over the seeds


def swept(here: Path, seed: int, options: argparse.Namespace) -> Block:
    """One block by the checkout in the folder `here`."""
    with tempfile.TemporaryDirectory() as folder:
        (link := Path(folder, "python")).mkdir()
        (link / "rigtwin").symlink_to(here)  # the root of a checkout is the package
        out = Path(folder, "out")
        words = [sys.executable, "-m", "rigtwin", "sweep", "packing", "--set", f"cylinder_diameter={DIAMETER}"]
        words += ["--particle", options.particle, "--wall", "PMMA", "--count", str(options.beads)]
        words += ["--vary", f"static_friction={options.static_friction:g}", "--repetitions", str(BLOCK)]
        words += ["--seed", str(seed), "--workers", str(AT_A_TIME), "--out", str(out), "--quiet"]
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(
            words, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": str(link)}
        )
        seconds, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise RuntimeError(f"rigtwin sweep stopped with code {done.returncode}: {done.stderr.strip()}")
        table = pd.read_csv(out / "sweep.csv")
    [(_, bed)] = table[(table["quantity"] == "bed_height") & (table["method"] == METHOD)].iterrows()
    computing = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Block(seconds, computing, int(bed["runs"]), bed["simulated"], bed["simulated_std"])


def heights(blocks: Sequence[Block]) -> tuple[float, float, float]:
    """Mean [m], standard deviation over the seeds [m] and standard error of the mean [m]."""
    runs = sum(block.runs for block in blocks)
    mean = sum(block.runs * block.height for block in blocks) / runs
    squares = sum((block.runs - 1) * block.scatter**2 + block.runs * (block.height - mean) ** 2 for block in blocks)
    scatter = math.sqrt(squares / (runs - 1))
    return mean, scatter, scatter / math.sqrt(runs)


def rows_of(blocks: Sequence[Block], name: str) -> list[Row]:
    runs, (mean, scatter, _) = sum(block.runs for block in blocks), heights(blocks)
    wall, computing = (sum(getattr(block, part) for block in blocks) for part in ("seconds", "computing"))
    what = f"{runs} packings of {name}, {AT_A_TIME} at a time"
    return [
        Row("packings per hour of a core", 3600 * runs / computing, "1/h", note=f"processor time; {what}"),
        Row("wall time of a packing", wall / runs, "s", note=what),
        Row("bed height", 1e3 * mean, "mm", note=f"{METHOD}; standard deviation over the seeds {1e3 * scatter:.3g} mm"),
    ]


def beside_rows(ours: Sequence[Block], theirs: Sequence[Block]) -> list[Row]:
    """Ratios, block by block, and the difference of the heights."""
    wall = [one.seconds / other.seconds for one, other in zip(ours, theirs, strict=True)]
    computing = [one.computing / other.computing for one, other in zip(ours, theirs, strict=True)]
    (mean, _, error), (other_mean, scatter, other_error) = heights(ours), heights(theirs)
    off, error = mean - other_mean, math.hypot(error, other_error)
    each = ", ".join(f"{ratio:.2f}" for ratio in wall)
    return [
        Row("wall time over the other's", median(wall), "1", None, f"at most {WANTED:g}", median(wall) <= WANTED, each),
        Row("processor time over the other's", median(computing), "1", note="other work on the machine matters less"),
        Row(
            "bed height less the other's", 1e3 * off, "mm", None, f"within {SAME:g} standard errors",
            abs(off) <= SAME * error, f"standard error {1e3 * error:.2g} mm; seeds scatter by {1e3 * scatter:.2g} mm",
        ),
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particle", default="D6", help="a particle of Hlosta et al. 2020")
    parser.add_argument("--beads", type=int, default=BEADS, help="particles in a packing")
    parser.add_argument("--static-friction", type=float, help="between particles; default: the particle's own")
    parser.add_argument("--beside", type=Path, help="another checkout of rigtwin")
    options = parser.parse_args(arguments)
    if options.static_friction is None:
        known = hlosta2020.CLUMPS.get(options.particle, options.particle)
        options.static_friction = hlosta2020.contact(known, known).static_friction
    here = Path(__file__).resolve().parents[2]
    trees = [here] if options.beside is None else [here, options.beside.resolve()]
    found: list[list[Block]] = [[] for _ in trees]
    seed = int(os.environ.get("SEED", "1"))
    for number in range(max(1, round(COUNT / BLOCK))):
        for tree in range(len(trees))[:: 1 if number % 2 == 0 else -1]:
            found[tree].append(swept(trees[tree], seed + BLOCK * number, options))
    rows = rows_of(found[0], f"{options.beads} {options.particle}")
    if len(found) == 2:
        rows += beside_rows(*found)
    return report("throughput", rows, particle=options.particle, beads=options.beads, seed=seed)


if __name__ == "__main__":
    sys.exit(main())
