"""Figures of a sweep: a line over one parameter, a heat map over two, points over each of several."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.report.figure_file import FigureFile, column_name, figure_file, slug, unique_names
from rigtwin.compare.report.plot_style import MEASURED, TWIN, canvas
from rigtwin.lab.formatting import shown, siblings, title

if TYPE_CHECKING:
    from rigtwin.compare.campaign.vary import Varied

Row = Mapping[str, Any]

DRAWN = ("simulated", "simulated_std", "measured", "measured_std_uncertainty")
DARK = 0.55  # [1], relative brightness of a colour below which text on it is white


def figures(varied: Sequence[Varied], rows: Sequence[Row], *, grid: bool) -> dict[str, FigureFile]:
    """Figures by name, one for each quantity, method, and bounce, collision, body or side.

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
    dict of str to FigureFile
        With one parameter a line; with two in a grid a heat map, on which a line marks where simulated and measured are
        equal and dashed lines two standard uncertainties around it; else points over each parameter.
    """
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        if row.get("simulated") is not None:
            head = (row["quantity"], row["method"], siblings(row), row["unit"])
            groups.setdefault(head, []).append(row)
    draw = _map if len(varied) == 2 and grid else _lines
    found = {}
    for name, (head, mine) in zip(_names(list(groups)), groups.items(), strict=True):
        quantity, method, which, unit = head
        label = ", ".join(words for words in (title(quantity), method, which) if words)
        found[f"sweep-{name}"] = draw(varied, mine, f"sweep-{name}", label, unit)
    return found


def _names(heads: Sequence[Sequence[str]]) -> list[str]:
    """A name for each figure: quantity and method, and as much of the rest as makes it another than the others."""
    names = [_slug(head[:2]) for head in heads]
    for parts in (3, 4):
        often = Counter(names)
        names = [_slug(head[:parts]) if often[name] > 1 else name for head, name in zip(heads, names, strict=True)]
    return list(unique_names(names))


def _slug(words: Sequence[str]) -> str:
    return slug(re.sub(r"[^a-z0-9]+", "-", "-".join(words).lower()))


def _lines(varied: Sequence[Varied], rows: Sequence[Row], name: str, label: str, unit: str) -> FigureFile:
    factor, sign = shown(unit)
    with canvas() as (figure, _):
        figure.clear()
        panels = figure.subplots(1, len(varied), sharey=True, squeeze=False)[0]
        for parameter, panel in zip(varied, panels, strict=True):
            scale, _ = shown(parameter.unit)
            x = scale * np.array([row[parameter.name] for row in rows])
            y = factor * np.array([row["simulated"] for row in rows])
            spread = factor * np.array([row["simulated_std"] or 0.0 for row in rows])
            order = np.argsort(x)
            style = "o-" if len(varied) == 1 else "o"
            panel.errorbar(x[order], y[order], spread[order], fmt=style, ms=4, capsize=3, color=TWIN, label="twin")
            _band(panel, rows, factor)
            panel.set(xlabel=_axis(parameter))
        panels[0].set(ylabel=_with_unit(label, sign))
        panels[0].legend(loc="best")
        return figure_file(figure, name, label, *_numbers(varied, rows, unit))


def _numbers(varied: Sequence[Varied], rows: Sequence[Row], unit: str) -> tuple[list[dict[str, Any]], list[str]]:
    """The numbers of a figure as they are drawn, and their columns."""
    factor, sign = shown(unit)
    columns = [column_name(_axis(one)) for one in varied]
    values = [column_name(_with_unit(name.replace("_", " "), sign)) for name in DRAWN]
    table = [
        {
            **{head: shown(one.unit)[0] * row[one.name] for head, one in zip(columns, varied, strict=True)},
            **{
                head: None if row.get(name) is None else factor * row[name]
                for head, name in zip(values, DRAWN, strict=True)
            },
        }
        for row in rows
    ]
    return table, [*columns, *values]


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


def _map(varied: Sequence[Varied], rows: Sequence[Row], name: str, label: str, unit: str) -> FigureFile:
    """A heat map of the simulated values; the first parameter runs downwards, as in tables 4 to 6 of the paper."""
    down, across = varied
    factor, sign = shown(unit)
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
        axes.set(xlabel=_axis(across), ylabel=_axis(down))
        axes.set_xticks(range(len(across.grid)), _ticks(across))
        axes.set_yticks(range(len(down.grid)), _ticks(down))
        figure.colorbar(picture, label=_with_unit(label, sign))
        return figure_file(figure, name, label, *_numbers(varied, rows, unit))


def _axis(parameter: Varied) -> str:
    return _with_unit(parameter.name.replace("_", " "), shown(parameter.unit)[1])


def _ticks(parameter: Varied) -> list[str]:
    factor, _ = shown(parameter.unit)
    return [f"{factor * value:.4g}" for value in parameter.grid]


def _with_unit(words: str, sign: str) -> str:
    return f"{words} / {sign}" if sign else words


def _level(varied: Varied, row: Row) -> int:
    return int(np.argmin(np.abs(np.array(varied.grid) - row[varied.name])))
