"""Plots of the report: what was measured, with the twin laid over it, as inline SVG."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.lab.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rigtwin.compare.reproduce.studies import Points, Study
    from rigtwin.compare.shapes import Curve, Overlay

# told apart by colour-blind readers and in grey print (Okabe and Ito 2008)
MEASURED, TWIN = "#0072b2", "#d55e00"
MOST_CURVES = 12  # drawn of each side; a drum has hundreds

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
_MOST_POINTS = 500  # per curve; more is not seen and makes the file heavy


def overlay_figure(overlay: Overlay) -> str:
    """Measured and simulated curves on common axes, single ones faint, their means strong."""
    low, high = overlay.span
    tall = 3.2
    if overlay.to_scale:
        heights = [float(np.nanmax(curve.y) - min(np.nanmin(curve.y), 0.0)) for curve in _drawn(overlay)]
        tall = 0.9 + 6.5 * min(max(heights) / (high - low), 1.0)
    with _canvas(tall) as (figure, axes):
        for curves, colour, name in (
            (overlay.measured, MEASURED, "measured"),
            (overlay.simulated, TWIN, "twin"),
        ):
            several = len(curves) > 1
            for number, curve in enumerate(curves[:: max(1, math.ceil(len(curves) / MOST_CURVES))]):
                label = None if several or number else name
                axes.plot(
                    *_thin(curve.x, curve.y), "-", lw=1.3, color=colour, alpha=0.35 if several else 1, label=label
                )
            if several:
                mean = overlay.mean(curves)
                axes.plot(mean.x, mean.y, "-", lw=2, color=colour, label=f"{name}, mean of {len(curves)}")
        axes.set(xlabel=overlay.x_label, ylabel=overlay.y_label)
        if overlay.to_scale:
            axes.set_aspect("equal")
        axes.legend(loc="best")
        return _svg(figure, f"{overlay.what.capitalize()}, measured and simulated")


def _drawn(overlay: Overlay) -> tuple[Curve, ...]:
    return (*overlay.measured, *overlay.simulated)


def study_figure(study: Study, points: Points) -> str:
    """Angles against what was varied, with the standard deviation over piles."""
    colours = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#8a94a0")
    with _canvas() as (figure, axes):
        for (reading, found), colour in zip(points.items(), colours, strict=False):
            x = [place for place, *_ in found]
            spread = [0.0 if std is None else std for _, _, std, _ in found]
            axes.errorbar(
                x, [mean for _, mean, *_ in found], spread, fmt="o-", ms=4, capsize=3, color=colour, label=reading
            )
        axes.set(xlabel=study.x_label, ylabel="angle of repose / °")
        axes.legend(loc="best", ncols=2, fontsize=7)
        return _svg(figure, study.title)


@contextmanager
def _canvas(height: float = 3.2) -> Iterator[tuple[Figure, Axes]]:
    """A figure of `height` [inch] with one pair of axes in the report's style; no pyplot, so nothing global is left."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(7.2, height), layout="constrained")
        yield figure, figure.add_subplot()


def _svg(figure: Figure, label: str) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    drawing = text.getvalue()
    # inside a page, the drawing's own style sheet would reach all of the page
    drawing = re.sub(r"<style.*?</style>", "", drawing[drawing.index("<svg") :], flags=re.DOTALL)
    return drawing.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)


def _thin(x: Array, y: Array) -> tuple[Array, Array]:
    step = max(1, math.ceil(len(x) / _MOST_POINTS))
    return x[::step], y[::step]
