"""Scatter from repetition to repetition, as published, for experiments with few repetitions of their own.

Hlosta et al. 2020 print means and standard deviations of ten repetitions (tables 7 to 12, 14, 15).  The relative
standard deviations of one quantity differ from particle to particle; their distribution is the prior of a lab's own.
Of discharges no repetitions are published: the differences between measured and simulated times (table 16) take their
place, an upper limit of the scatter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from rigtwin.lab.reference import hlosta2020

REPETITIONS = 10  # of each published mean (sections 2.2.1 to 2.2.4, 3.2)


@dataclass(frozen=True)
class Scatter:
    """Relative standard deviation from repetition to repetition, and how well it is known.

    The variance is distributed as ``freedom * relative**2`` over chi-squared with `freedom` degrees of freedom.
    """

    relative: float  # [1]
    freedom: float  # infinite where it is known exactly
    source: str


class _Cells(NamedTuple):
    """Cells of a table: values with standard deviations, or with other values that differ from them by scatter."""

    table: int
    value: str
    std: str = ""
    other: str = ""  # in place of `std`
    rigs: str = ""  # begin of the entry in column `rig`
    alike: bool = False  # only pairs of like particles: the others are calculated from them

    @property
    def freedom(self) -> int:
        return REPETITIONS - 1 if self.std else 1


class _Published(NamedTuple):
    cells: tuple[_Cells, ...]
    power: float = 1.0  # of the published quantity that this one is proportional to


_SLIDE = _Published((_Cells(8, "mu_s_pw", "mu_s_pw_std"), _Cells(9, "mu_s_pp", "mu_s_pp_std")))
_ROLL = _Published((_Cells(10, "mu_r_pw", "mu_r_pw_std"),))
_WALL = _Published((_Cells(11, "e_pw", "e_pw_std"),))
_PAIR = _Published((_Cells(12, "e_pp", "e_pp_std", alike=True),))
_BED = _Published((_Cells(7, "bed_height_exp_mm", "bed_height_exp_std_mm"),))
_DISCHARGE = _Published((_Cells(16, "discharge_time_exp_s", other="discharge_time_dem_s"),))


def _slope(table: int, rigs: str) -> _Published:
    return _Published((_Cells(table, "aor_exp_deg", "aor_exp_std_deg", rigs=rigs),))


_OF_RIG: dict[str, dict[str, _Published]] = {
    "drop": {"restitution_wall": _WALL, "rebound_height": _WALL._replace(power=2.0)},
    "pendulum": {
        "restitution_wall": _WALL,
        "restitution_pair": _PAIR,
        "energy_ratio_root": _PAIR,
        "rebound_angle": _PAIR,
    },
    "tilt": {
        "static_friction": _SLIDE,
        "kinetic_friction": _SLIDE,
        "static_friction_angle": _SLIDE,  # an angle scatters like its tangent, so that both have one verdict
        "rolling_friction": _ROLL,
        "rolling_friction_angle": _ROLL,
    },
    "packing": {"bed_height": _BED, "bulk_density": _BED},
    "pile": {
        "angle_of_repose_graphical": _slope(14, "piling"),
        "angle_of_repose_geometric": _slope(15, "piling"),
    },
    "drum": {
        "angle_of_repose_graphical": _slope(14, "drum"),
        "angle_of_repose_upper": _slope(14, "drum"),
        "angle_of_repose_lower": _slope(14, "drum"),
        "angle_of_repose_geometric": _slope(15, "drum"),
    },
    "hopper": {
        "discharge_time": _DISCHARGE,
        "discharge_time_5_95": _DISCHARGE,
        "mass_flow_rate": _DISCHARGE,
    },
}


@cache
def published_scatter(rig: str, quantity: str) -> Scatter:
    """The scatter of a quantity of a rig.

    Parameters
    ----------
    rig : str
        Name of the rig.
    quantity : str
        Name of the quantity.

    Returns
    -------
    Scatter
        From the cells of this quantity; where none are published, from all cells with repetitions.

    Notes
    -----
    The sample variance of each cell, with d degrees of freedom, is that of a normal distribution whose variance is
    scaled inverse chi-squared over the cells.  Scale and degrees of freedom follow from mean and variance of the
    logarithms of the sample variances.  Their number of degrees of freedom is at most the number of cells less one.

    References
    ----------
    G. K. Smyth, Linear models and empirical Bayes methods, Stat. Appl. Genet. Mol. Biol. 3 (2004) 3, section 6.2.

    Examples
    --------
    >>> found = published_scatter("pile", "angle_of_repose_geometric")
    >>> round(found.relative, 3), round(found.freedom, 1), found.source
    (0.028, 3.0, 'Hlosta et al. 2020, table 15')
    """
    known = _OF_RIG.get(rig, {}).get(quantity)
    if known is None:
        every = {cells for rigs in _OF_RIG.values() for one in rigs.values() for cells in one.cells if cells.std}
        what = sorted(every)
        return _fitted(what, 1.0, f"{hlosta2020.CITATION}, all quantities together")
    numbers = " and ".join(str(cells.table) for cells in known.cells)
    tables = f"{hlosta2020.CITATION}, table{'s' if len(known.cells) > 1 else ''} {numbers}"
    upper = " (measured less simulated)" if known.cells[0].other else ""
    return _fitted(known.cells, known.power, tables + upper)


def _fitted(what: Iterable[_Cells], power: float, source: str) -> Scatter:
    import numpy as np
    from scipy.optimize import brentq
    from scipy.special import digamma, polygamma

    pairs = [(variance, cells.freedom) for cells in what for variance in _variances(cells)]
    variance, own = np.array(pairs).T
    logs = np.log(variance) - digamma(own / 2) + np.log(own / 2)
    between = float(np.var(logs, ddof=1) - polygamma(1, own / 2).mean())
    most = float(len(pairs) - 1)
    half = most / 2
    if between > polygamma(1, half):
        half = brentq(lambda x: float(polygamma(1, x)) - between, 1e-3, half)
    scale = math.exp((logs.mean() + digamma(half) - math.log(half)) / 2)
    return Scatter(power * float(scale), 2 * float(half), source)


def _variances(cells: _Cells) -> Iterator[float]:
    """Relative sample variances; of a deviation that is printed as zero, half of the least one is taken."""
    rows = [row for row in hlosta2020.table(cells.table) if str(row.get("rig", "")).startswith(cells.rigs)]
    if cells.alike:
        rows = [row for row in rows if row["particle"] == row["particle_2"]]
    found = []
    for row in rows:
        value = float(row[cells.value])
        std = float(row[cells.std]) if cells.std else abs(float(row[cells.other]) - value)
        found.append((round(std, 9), value, row["particle"]))
    least = min(std for std, _, _ in found if std > 0) / 2
    for std, value, _ in dict.fromkeys(found):  # the clumps of one particle share its measured bed
        yield (max(std, least) / value) ** 2
