"""Horizontal motion of a bouncing bead: linear in time between two bounces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array, Mask
from rigtwin.measure.robust import mad_std

OUTLIER = 4.0  # robust standard deviations beyond which a point is an outlier


@dataclass(frozen=True)
class SidewaysMotion:
    """Fitted horizontal motion: one line per flight, and one common acceleration due to camera roll."""

    bend: float  # horizontal acceleration, in units of length per second squared
    bend_uncertainty: float  # its standard uncertainty, from the residuals
    off: Array  # residuals, shape (n,)
    kept: Mask  # points that are no outliers, shape (n,)


def fit_sideways(time: Array, across: Array, contacts: Array, apexes: Array) -> SidewaysMotion:
    """Fit the horizontal positions `across` at `time` [s], shape (n,), within the flights.

    `contacts` [s] has one entry less than `apexes` [s].
    """
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
        kept = np.abs(off) < OUTLIER * mad_std(off[kept], centre=0.0) + 1e-9
    sigma = np.sqrt(np.var(off[kept]) * np.linalg.pinv(design[kept].T @ design[kept])[0, 0])
    return SidewaysMotion(float(solution[0]), float(sigma), off, kept)
