"""Reading the text dumps of LIGGGHTS, LAMMPS and Yade decks: frames, and the record of the rig."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.custom_rig import CustomRig
from rigtwin.lab.errors import BadInput
from rigtwin.lab.input_files import read_bytes
from rigtwin.lab.rigs import Drum, Hopper, Packing, Pile
from rigtwin.sim import custom, drum, hopper, packing
from rigtwin.sim.decks.deck import END, RECORD, Deck
from rigtwin.sim.output.replay import Frame
from rigtwin.sim.pile import pile
from rigtwin.sim.run.filling import SETTLED, resting

COLUMNS = ("id", "x", "y", "z", "vx", "vy", "vz")


def frames(path: Path, time_step: float) -> list[Frame]:
    """All frames of a text dump in LAMMPS's format.

    Parameters
    ----------
    path : Path
        The dump; its columns must contain id, x, y, z, vx, vy, vz in SI units, in any order.
    time_step : float
        Time step [s] of the run.

    Returns
    -------
    list of Frame
        The frames in the order of the file; numbers of beads count from 0.

    Raises
    ------
    BadInput
        If the file is no such dump, ends within a frame, or times do not ascend.
    """
    found = []
    content = read_bytes(path, advice="run the deck again").decode(errors="replace")
    for number, text in enumerate(content.split("ITEM: TIMESTEP")[1:], start=1):
        head, items, table = text.partition("ITEM: ATOMS")
        names, _, rows = table.partition("\n")
        order = names.split()
        try:
            step, count = int(head.split()[0]), int(head.partition("NUMBER OF ATOMS")[2].split()[0])
            columns = [order.index(name) for name in COLUMNS]
            values = np.array(rows.split(), dtype=float).reshape(count, len(order))[:, columns]
        except (ValueError, IndexError):
            what = "has no columns id x y z vx vy vz" if items and not set(COLUMNS) <= set(order) else "is not complete"
            raise BadInput(f"{path}: frame {number} {what}; run the deck again.") from None
        if not np.isfinite(values).all():
            raise BadInput(f"{path}: frame {number} has values that are not finite; give a smaller time step.")
        values = values[np.argsort(values[:, 0])]
        if (np.diff(values[:, 0]) == 0).any():
            raise BadInput(f"{path}: frame {number} has one bead twice; run the deck again.")
        found.append(Frame(step * time_step, values[:, 0].astype(np.int64) - 1, values[:, 1:4], values[:, 4:]))
    if not found:
        raise BadInput(f"{path}: holds no frames in LAMMPS's text format.")
    if any(late.time < early.time for early, late in pairwise(found)):
        raise BadInput(f"{path}: its times go backwards, as if two runs wrote into it; run the deck again.")
    return found


def record_of(folder: Path, deck: Deck) -> Any:
    """Return what `rigtwin.sim.<rig>.run` would return, from the dumps of a deck that has run.

    Parameters
    ----------
    folder : Path
        Folder of the deck.
    deck : Deck
        Deck that has run.

    Returns
    -------
    object
        The result of the rig's `replayed`.

    Raises
    ------
    BadInput
        If the deck has not run to its end, or its dumps are damaged.
    """
    if not (folder / END).is_file():
        raise BadInput(f"{folder}: there is no {END}: the deck has not run to its end; run there: {deck.command}")
    rig, bead, options = deck.rig, deck.particle, dict(deck.options or {})
    count, sizes = deck.scene.count, deck.scene.sizes

    def read(name: str) -> list[Frame]:
        found = frames(folder / name, deck.time_step)
        if any(len(one.ident) and not 0 <= one.ident[0] <= one.ident[-1] < count * len(bead.radii) for one in found):
            raise BadInput(f"{folder / name}: has other beads than the {count} of the deck; run the deck again.")
        return [replace(one, sizes=sizes) for one in found]

    [*_, last] = read(END)
    if isinstance(rig, Packing):
        return packing.replayed(rig, bead, last, asked=count, pour_rate=options.get("pour_rate"))
    if isinstance(rig, Pile):
        rate = options.get("pour_rate")
        filled = read(RECORD)[0] if rig.variant == "pouring" else None
        return pile.replayed(rig, bead, last, asked=count, in_time=True, pour_rate=rate, filled=filled)
    over_time = read(RECORD) if (folder / RECORD).is_file() else []
    if len(over_time) < 2:
        raise BadInput(f"{folder}: there is no {RECORD} with several frames; run there: {deck.command}")
    if isinstance(rig, CustomRig):
        return custom.replayed(rig, bead, over_time, asked=count, placed=count)
    in_time = resting(over_time[0].grains(bead), bead, SETTLED)
    if isinstance(rig, Drum):
        return drum.replayed(rig, bead, over_time, turns=options.get("turns", 1.0), in_time=in_time)
    assert isinstance(rig, Hopper)
    at_rest = rig.variant == "conical" or resting(last.grains(bead), bead)
    return hopper.replayed(rig, bead, over_time, asked=count, in_time=in_time, at_rest=at_rest)
