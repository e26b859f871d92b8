"""What a falling bead does to the side, where nothing pulls at it: it goes straight on from bounce to bounce."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array, Mask

WILD = 4.0  # standard deviations


@dataclass(frozen=True)
class Aside:
    """A straight line for each flight, and one bend for all: a camera that is not upright shows gravity to the side."""

    bend: float  # of a fall, in units of length per second squared
    bend_doubt: float  # the same, as told by what is left
    off: Array  # what the lines leave of the places, shape (n,)
    kept: Mask  # which points are not wild, shape (n,)


def fly_aside(time: Array, across: Array, contacts: Array, apexes: Array) -> Aside:
    """Lines through the places aside at times [s] within the flights; one apex [s] more than contacts [s]."""
    flight = np.searchsorted(contacts, time)
    columns = [-0.5 * (time - apexes[flight]) ** 2]
    for k in range(len(apexes)):
        mine = (flight == k).astype(np.float64)
        columns += [mine, mine * (time - apexes[k])]
    design = np.stack(columns, axis=1)
    kept = np.ones(len(across), dtype=bool)
    for _ in range(3):
        solution, *_ = np.linalg.lstsq(design[kept], across[kept], rcond=None)
        off = across - design @ solution
        kept = np.abs(off) < WILD * 1.4826 * np.median(np.abs(off[kept])) + 1e-9
    doubt = np.sqrt(np.var(off[kept]) * np.linalg.pinv(design[kept].T @ design[kept])[0, 0])
    return Aside(float(solution[0]), float(doubt), off, kept)
