"""Plots of measured and simulated curves for the report, as inline SVG."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.compare.report.plot_style import MEASURED, TWIN, canvas, svg, thin

if TYPE_CHECKING:
    from rigtwin.compare.curve_overlays import Curve, Overlay


MOST_CURVES = 12  # largest number of curves drawn on each side; a drum has hundreds


def overlay_figure(overlay: Overlay) -> str:
    """Measured and simulated curves on common axes, single curves faint, their means strong; SVG text."""
    low, high = overlay.span
    tall = 3.2
    if overlay.to_scale:
        heights = [float(np.nanmax(curve.y) - min(np.nanmin(curve.y), 0.0)) for curve in _drawn(overlay)]
        tall = 0.9 + 6.5 * min(max(heights) / (high - low), 1.0)
    with canvas(tall) as (figure, axes):
        for curves, colour, name in (
            (overlay.measured, MEASURED, "measured"),
            (overlay.simulated, TWIN, "twin"),
        ):
            several = len(curves) > 1
            for number, curve in enumerate(curves[:: max(1, math.ceil(len(curves) / MOST_CURVES))]):
                label = None if several or number else name
                axes.plot(*thin(curve.x, curve.y), "-", lw=1.3, color=colour, alpha=0.35 if several else 1, label=label)
            if several:
                mean = overlay.mean(curves)
                axes.plot(mean.x, mean.y, "-", lw=2, color=colour, label=f"{name}, mean of {len(curves)}")
        axes.set(xlabel=overlay.x_label, ylabel=overlay.y_label)
        if overlay.to_scale:
            axes.set_aspect("equal")
        axes.legend(loc="best")
        return svg(figure, f"{overlay.what.capitalize()}, measured and simulated")


def _drawn(overlay: Overlay) -> tuple[Curve, ...]:
    return (*overlay.measured, *overlay.simulated)
