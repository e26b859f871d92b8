"""Mixing of marked beads with the others: Lacey's index over cells, and its standard uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array, Mask
from rigtwin.lab.quantity import Detail, Quantity, doubted

CELL = 3.0  # [bead diameters], side of the cells
FEWEST = 5  # least number of beads in a cell that is evaluated
FEWEST_CELLS = 10  # least number of cells; their variance has a relative uncertainty of about one half


@dataclass(frozen=True)
class Mixing:
    """Lacey's index at one moment; NaN if too few cells hold enough beads."""

    index: float
    std_uncertainty: float  # statistical, by the jackknife over the cells
    cells: int  # with enough beads

    def quantity(self, turns: float) -> Quantity:
        """Return the index as a quantity; doubtful if it is based on few cells.

        Parameters
        ----------
        turns : float
            Revolutions of the drum so far [1].

        Returns
        -------
        Quantity
            ``mixing_index`` [1].
        """
        few = (
            f"the mixing index is counted in only {self.cells} cells of {CELL:g} bead diameters that hold at least "
            f"{FEWEST} beads; give more beads, or smaller ones"
        )
        detail: dict[str, Detail] = {"turns": turns, "cells": self.cells}
        found = Quantity(
            "mixing_index", self.index, self.std_uncertainty, "1", f"Lacey, after {turns:g} turns", 1, detail
        )
        return doubted(found, few if self.cells < FEWEST_CELLS else "")


def lacey(centres: Array, marked: Mask, cell: float) -> float:
    """Return Lacey's mixing index of marked beads, counted in cells in x and z.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres of the beads [m]; a corner of the cells is at the origin.
    marked : Mask, shape (n,)
        Which beads are marked.
    cell : float
        Side of the cells [m].

    Returns
    -------
    float
        0 separated, 1 random; NaN if fewer than two cells hold enough beads, or if all their beads are of one kind.

    Notes
    -----
    M = (S0^2 - S^2) / (S0^2 - SR^2), with S0^2 = p (1 - p) separated, SR^2 = p (1 - p) / n random, and S^2 the variance
    of the marked fraction among the cells, weighted by their numbers of beads.

    References
    ----------
    Lacey 1954, J. Appl. Chem. 4, 257.

    Examples
    --------
    >>> lacey(np.array([[0.5, 0, 0]] * 5 + [[1.5, 0, 0]] * 5), np.arange(10) < 5, 1.0)
    0.0
    """
    return _index(*_counted(centres, marked, cell))


def mixing(centres: Array, marked: Mask, cell: float) -> Mixing:
    """Return Lacey's index with its standard uncertainty.

    Parameters
    ----------
    centres, marked, cell : ndarray, Mask, float
        As for `lacey`.

    Returns
    -------
    Mixing
        Index, uncertainty and number of cells.
    """
    beads, share = _counted(centres, marked, cell)
    count, every = len(beads), np.arange(len(beads))
    without = np.array([_index(beads[every != k], share[every != k]) for k in every])
    scatter = math.sqrt((count - 1) * float(np.var(without))) if count > 2 else math.nan
    return Mixing(_index(beads, share), scatter, count)


def _counted(centres: Array, marked: Mask, cell: float) -> tuple[Array, Array]:
    """Number of beads, and marked fraction, of each cell with enough beads."""
    place = np.floor(centres[:, [0, 2]] / cell).astype(int)
    _cells, which = np.unique(place, axis=0, return_inverse=True)
    beads = np.bincount(which).astype(float)
    counts = beads >= FEWEST
    return beads[counts], (np.bincount(which, weights=marked) / beads)[counts]


def _index(beads: Array, share: Array) -> float:
    if len(beads) < 2:
        return math.nan
    p = float(np.average(share, weights=beads))
    apart = p * (1 - p)
    if apart <= 0:
        return math.nan
    at_random = apart / float(np.average(beads, weights=beads))
    spread = float(np.average((share - p) ** 2, weights=beads))
    return (apart - spread) / (apart - at_random)
