"""Figures of a sweep: a line over one parameter, a heat map over two, points over each of several."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.report.plot_style import MEASURED, TWIN, canvas, svg
from rigtwin.lab.formatting import title

if TYPE_CHECKING:
    from rigtwin.compare.campaign.vary import Varied

Row = Mapping[str, Any]

SHOWN = {"m": (1e3, "mm"), "deg": (1.0, "°"), "1": (1.0, "")}
"""Factor and unit in which a quantity is drawn, by its unit."""
DARK = 0.55  # [1], relative brightness of a colour below which text on it is white


def figures(varied: Sequence[Varied], rows: Sequence[Row], *, grid: bool) -> dict[str, str]:
    """SVG files by name, one for each quantity and method.

    Parameters
    ----------
    varied : sequence of Varied
        Parameters of the sweep.
    rows : sequence of mappings
        Rows of ``sweep.csv``.
    grid : bool
        Whether the points are all combinations of levels.

    Returns
    -------
    dict of str to str
        With one parameter a line; with two in a grid a heat map, on which a line marks where simulated and measured are
        equal and dashed lines two standard uncertainties around it; else points over each parameter.
    """
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        if row.get("simulated") is not None:
            groups.setdefault((row["quantity"], row["method"], row["unit"]), []).append(row)
    drawn = {}
    for (quantity, method, unit), mine in groups.items():
        name = re.sub(r"[^a-z0-9]+", "-", f"{quantity}-{method}".lower()).strip("-")
        label = f"{title(quantity)}, {method}"
        if len(varied) == 2 and grid:
            drawn[f"sweep-{name}.svg"] = _map(varied, mine, label, unit)
        else:
            drawn[f"sweep-{name}.svg"] = _lines(varied, mine, label, unit)
    return drawn


def _lines(varied: Sequence[Varied], rows: Sequence[Row], label: str, unit: str) -> str:
    factor, shown = SHOWN.get(unit, (1.0, unit))
    with canvas() as (figure, _):
        figure.clear()
        panels = figure.subplots(1, len(varied), sharey=True, squeeze=False)[0]
        for parameter, panel in zip(varied, panels, strict=True):
            x = np.array([row[parameter.name] for row in rows])
            y = factor * np.array([row["simulated"] for row in rows])
            spread = factor * np.array([row["simulated_std"] or 0.0 for row in rows])
            order = np.argsort(x)
            style = "o-" if len(varied) == 1 else "o"
            panel.errorbar(x[order], y[order], spread[order], fmt=style, ms=4, capsize=3, color=TWIN, label="twin")
            _band(panel, rows, factor)
            panel.set(xlabel=parameter.name.replace("_", " "))
        panels[0].set(ylabel=f"{label} / {shown}" if shown else label)
        panels[0].legend(loc="best")
        return svg(figure, label)


def _band(axes: Any, rows: Sequence[Row], factor: float) -> None:
    """The measured value with two standard uncertainties."""
    measured, uncertainty = _measured(rows)
    if measured is not None:
        axes.axhline(factor * measured, color=MEASURED, label="measured")
        axes.axhspan(
            factor * (measured - 2 * uncertainty), factor * (measured + 2 * uncertainty), color=MEASURED, alpha=0.15
        )


def _measured(rows: Sequence[Row]) -> tuple[float | None, float]:
    known = [row for row in rows if row.get("measured") is not None]
    return (known[0]["measured"], known[0]["measured_std_uncertainty"] or 0.0) if known else (None, 0.0)


def _map(varied: Sequence[Varied], rows: Sequence[Row], label: str, unit: str) -> str:
    """A heat map of the simulated values; the first parameter runs downwards, as in tables 4 to 6 of the paper."""
    down, across = varied
    factor, shown = SHOWN.get(unit, (1.0, unit))
    values = np.full((len(down.grid), len(across.grid)), np.nan)
    for row in rows:
        values[_level(down, row), _level(across, row)] = factor * row["simulated"]
    with canvas(1.2 + 0.42 * len(down.grid)) as (figure, axes):
        axes.grid(visible=False)
        picture = axes.imshow(values, aspect="auto", cmap="viridis")
        for (i, j), value in np.ndenumerate(values):
            if np.isfinite(value):
                bright = sum(picture.cmap(picture.norm(value))[:3]) / 3
                axes.text(
                    j, i, f"{value:.3g}", ha="center", va="center", color="w" if bright < DARK else "k", fontsize=7
                )
        measured, uncertainty = _measured(rows)
        if measured is not None and min(values.shape) > 1 and np.isfinite(values).all():
            for level, style in ((0.0, "-"), (-2.0, "--"), (2.0, "--")):
                at = factor * (measured + level * uncertainty)
                if values.min() < at < values.max():
                    axes.contour(values, levels=[at], colors="#d55e00", linestyles=style)
        axes.set(xlabel=across.name.replace("_", " "), ylabel=down.name.replace("_", " "))
        axes.set_xticks(range(len(across.grid)), [f"{value:.3g}" for value in across.grid])
        axes.set_yticks(range(len(down.grid)), [f"{value:.3g}" for value in down.grid])
        figure.colorbar(picture, label=f"{label} / {shown}" if shown else label)
        return svg(figure, label)


def _level(varied: Varied, row: Row) -> int:
    return int(np.argmin(np.abs(np.array(varied.grid) - row[varied.name])))
