"""Decks for other codes that have run: their description and their dumps."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from random import Random

import numpy as np

from rigtwin.benchmarks.fuzz_cases.case import Case, out, written
from rigtwin.benchmarks.fuzz_cases.mutations import in_words
from rigtwin.lab.arrays import Array
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Drum, Hopper, Packing, Pile
from rigtwin.sim.decks.deck import END, RECORD, Deck

RIGS = {
    "packing": (Packing(0.05, 0.1), "PMMA"),
    "pile": (Pile(0.07, 0.008, outlet_height=0.06), "steel"),
    "drum": (Drum(0.08, 1.0, 0.03), "PMMA"),
    "hopper": (Hopper(0.03, diameter=0.06, cone_height=0.05), "PMMA"),
}
COUNT = 40


@cache
def files(rig: str) -> dict[str, str]:
    """All files of a deck and its dumps."""
    settings, wall = RIGS[rig]
    bead, contacts = hlosta2020.particle("D6"), [hlosta2020.contact("D6", other) for other in ("D6", wall)]
    deck = Deck("lammps", settings, bead, hlosta2020.material(wall), *contacts, count=COUNT, seed=3)
    layer = [(0.0, 0.0)] + [(0.0125 * math.cos(a), 0.0125 * math.sin(a)) for a in np.arange(6) * math.pi / 3]
    places = np.array([(x, y, 0.003 + k * 0.0063) for k in range(8) for x, y in layer])[:COUNT]
    looks = [places - [0, 0, 0.02 * k if rig == "hopper" else 0] for k in range(6)]
    every = deck.steps(1.2 if rig == "drum" else 0.02)  # until the bed of a drum is steady
    dumps = {RECORD: dump([k * every for k in range(6)], looks), END: dump([5 * every], looks[-1:])}
    return {**deck.files(), **dumps}


def dump(steps: list[int], looks: list[Array]) -> str:
    """Frames at these steps in LAMMPS's text format, beads at rest."""
    text = ""
    for step, places in zip(steps, looks, strict=True):
        rows = "".join(f"{k} {x:.6g} {y:.6g} {z:.6g} 0 0 0\n" for k, (x, y, z) in enumerate(places.tolist(), 1))
        text += f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{len(places)}\nITEM: BOX BOUNDS ff ff ff\n"
        text += f"0 1\n0 1\n0 1\nITEM: ATOMS id x y z vx vy vz\n{rows}"
    return text


def imported(chance: Random, folder: Path) -> Case:
    """A deck whose description or dumps are damaged."""
    rig = chance.choice(list(RIGS))
    damaged = chance.choice(("deck.json", "deck.json", END, RECORD))
    for name, text in files(rig).items():
        written(folder, f"deck/{name}", in_words(chance, text) if name == damaged else text)
    return Case(["import", str(folder / "deck"), *out(folder)])
