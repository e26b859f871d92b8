"""Colours and style of the plots."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rigtwin.lab.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# distinguishable for colour-blind readers and in grey print (Okabe and Ito 2008)
MEASURED, TWIN = "#0072b2", "#d55e00"

_STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9,
    "svg.fonttype": "none",  # text stays text: smaller, sharp and searchable
    "svg.hashsalt": "rigtwin",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8a94a0",
    "axes.labelcolor": "#3c4650",
    "xtick.color": "#5b6670",
    "ytick.color": "#5b6670",
    "axes.grid": True,
    "grid.color": "#e6eaee",
    "axes.axisbelow": True,
    "legend.frameon": False,
}

_MOST_POINTS = 500  # largest number of points in a curve; more are not visible and enlarge the file


@contextmanager
def canvas(height: float = 3.2) -> Iterator[tuple[Figure, Axes]]:
    """Open a figure with one pair of axes in the report's style; without pyplot and its global state.

    Parameters
    ----------
    height : float
        Height of the figure [inch].

    Yields
    ------
    figure, axes : Figure, Axes
        As of matplotlib.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(7.2, height), layout="constrained")
        yield figure, figure.add_subplot()


def thin(x: Array, y: Array) -> tuple[Array, Array]:
    """Leave out points of a curve that has more than are visible.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Coordinates of the curve.

    Returns
    -------
    x, y : ndarray, shape (m,)
        Every k-th of them.
    """
    step = max(1, math.ceil(len(x) / _MOST_POINTS))
    return x[::step], y[::step]
