"""Decks of four rigs run by LIGGGHTS, LAMMPS and Yade, where they are installed, beside rigtwin's own twins.

Every code starts from the same positions.  Beds and heaps of the same beads differ from run to run, as the order of
additions differs: heaps of this size by several degrees, discharges by a few percent.  The tolerances are about twice
that scatter; they show that geometry, motion and conventions are right, not that the contact laws are equal.

    python benchmarks/engine/decks.py [--code liggghts ...] [--rig pile ...] [--seeds 2]
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from rigtwin.benchmarks.figures import SMOKE, Row, against, report, skipped, small
from rigtwin.compare.twins.drum import drum_twin
from rigtwin.compare.twins.hopper import hopper_twin
from rigtwin.compare.twins.imported import imported_twin
from rigtwin.compare.twins.many_body import Cast
from rigtwin.compare.twins.packing import packing_twin
from rigtwin.compare.twins.pile import pile_twin
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Drum, Hopper, Packing, Pile
from rigtwin.sim.decks.deck import CODES, TITLES, Code, Deck

BINARY = {"liggghts": "liggghts", "lammps": "lmp", "yade": "yade"}
LONGEST = 1800  # [s], of one run


@dataclass(frozen=True)
class Case:
    """A rig, its filling, and what is compared: quantity, method and tolerance [1]."""

    rig: Any
    wall: str
    count: int | None
    run: Any
    compared: tuple[tuple[str, str, float], ...]
    options: dict[str, float]


CASES = {
    "packing": Case(
        small(Packing(0.05, 0.2), Packing(0.03, 0.1)), "PMMA", small(600, 60), packing_twin,
        (("bed_height", "mean surface", 0.03), ("bulk_density", "mean surface", 0.03)), {},
    ),
    "pile": Case(
        small(Pile(0.09, 0.01, outlet_height=0.07), Pile(0.07, 0.01, outlet_height=0.06)), "steel", small(900, 200),
        pile_twin,
        (("angle_of_repose_geometric", "apex", 0.1), ("pile_height", "", 0.1)), {},
    ),
    "hopper": Case(
        small(Hopper(0.035, diameter=0.08, cone_height=0.06), Hopper(0.03, diameter=0.06, cone_height=0.05)), "PMMA",
        small(800, 100), hopper_twin,
        (("discharge_time", "", 0.08), ("mass_flow_rate", "", 0.1)), {},
    ),
    "drum": Case(
        small(Drum(0.12, math.pi / 3, 0.04), Drum(0.08, math.pi / 3, 0.03)), "PMMA", small(None, 120), drum_twin,
        (("angle_of_repose_graphical", "line, 10-90 %", 0.1), ("angle_of_repose_geometric", "chord", 0.1)),
        {"turns": small(0.5, 0.05)},
    ),
}  # fmt: skip


def deck_of(code: Code, case: Case, seed: int) -> Deck:
    """The deck of a case."""
    bead, wall = hlosta2020.particle("D6"), hlosta2020.material(case.wall)
    contacts = hlosta2020.contact("D6", "D6"), hlosta2020.contact("D6", case.wall)
    return Deck(code, case.rig, bead, wall, *contacts, count=case.count, seed=seed, options=case.options)


def run_deck(deck: Deck, folder: Path, ranks: int = 1) -> float:
    """Let the deck's code run in the folder of its files; returns the time that this takes [s]."""
    command = deck.command.split()
    if ranks > 1:
        command = ["mpirun", "-np", str(ranks), "--oversubscribe", *command]
    environment = os.environ | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",  # mpirun refuses a container's only user without these
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_mpi_yield_when_idle": small("0", "1"),  # another script runs beside this one
    }
    began = time.perf_counter()
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=LONGEST
    )
    took = time.perf_counter() - began
    if done.returncode:
        last = " ".join((done.stdout + done.stderr).strip().splitlines()[-2:])
        raise RuntimeError(f"{TITLES[deck.code]} stopped with code {done.returncode}: {last}")
    return took


def computed(deck: Deck, ranks: int) -> tuple[Twin, float]:
    """The twin that the deck's code computes, and the time that this takes [s]."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in deck.files().items():
            (folder / file).write_text(text)
        took = run_deck(deck, folder, ranks)
        return imported_twin(folder), took


def value_of(twin: Twin, quantity: str, method: str) -> tuple[float, str]:
    """A quantity of the twin, over all views where there are several, and its unit."""
    found = [
        one
        for one in twin.quantities
        if one.quantity == quantity and one.method.startswith(method) and one.detail.get("view") in (None, "all")
    ]
    found = [one for one in found if one.detail.get("side") in (None, "mean")] or found
    return found[0].value, found[0].unit


def rows_of(rig: str, codes: list[Code], seeds: int) -> list[Row]:
    """One row for each code and each compared quantity."""
    case = CASES[rig]
    began = time.perf_counter()
    ours = []
    for seed in range(1, seeds + 1):
        deck = deck_of("liggghts", case, seed)
        cast = Cast(deck.particle, deck.wall, deck.contact, deck.wall_contact)
        more = {"threads": 2, **case.options}
        ours.append(case.run(case.rig, cast, count=case.count, seed=seed, **more))
    took = (time.perf_counter() - began) / seeds
    # in small, two ranks for the first rig only: beside another script, two that wait for each other need 30 s for 1 s
    parallel = not SMOKE or rig == next(iter(CASES))
    runs = [(code, ranks) for code in codes for ranks in ((1, 2) if parallel and code != "yade" else (1,))]
    rows = []
    for code, ranks in runs:
        title = f"{rig}, {TITLES[code]}" + (f", {ranks} processes" if ranks > 1 else "")
        if shutil.which(BINARY[code]) is None or (ranks > 1 and shutil.which("mpirun") is None):
            rows.append(skipped(title, "is not installed"))
            continue
        twins, times = zip(*(computed(deck_of(code, case, seed), ranks) for seed in range(1, seeds + 1)), strict=True)
        for quantity, method, tolerance in case.compared:
            mine = [value_of(twin, quantity, method) for twin in ours]
            theirs = [value_of(twin, quantity, method)[0] for twin in twins]
            scatter = ", ".join(f"{value:.4g}" for value in theirs)
            note = (
                f"{scatter}; ours {', '.join(f'{value:.4g}' for value, _ in mine)}; {fmean(times):.0f} s, {took:.0f} s"
            )
            reference, unit = fmean(value for value, _ in mine), mine[0][1]
            name = f"{title}: {quantity.replace('_', ' ')}"
            rows.append(against(name, fmean(theirs), reference, relative=tolerance, unit=unit, note=note))
        for row in rows[-len(case.compared) :]:
            sys.stderr.write(f"{row.name}: {row.value:.5g} {row.unit}, {100 * (row.deviation or 0):+.1f} %\n")
    return rows


def main() -> int:
    """Run what was asked for and report it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--code", action="append", choices=CODES)
    parser.add_argument("--rig", action="append", choices=list(CASES))
    parser.add_argument(
        "--seeds", type=int, default=small(2, 1), help="runs of each code, with different start positions"
    )
    said = parser.parse_args()
    rows = [row for rig in said.rig or CASES for row in rows_of(rig, said.code or list(CODES), said.seeds)]
    return report("decks", rows)


if __name__ == "__main__":
    sys.exit(main())
