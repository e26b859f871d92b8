"""Figures of the report: measured and simulated curves, and the deviations of all main results."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.deviation import percent_interval
from rigtwin.compare.report.figure_file import FigureFile, column_name, figure_file
from rigtwin.compare.report.plot_style import MEASURED, TWIN, canvas, thin
from rigtwin.lab.formatting import siblings, title

if TYPE_CHECKING:
    from rigtwin.compare.curve_overlays import Curve, Overlay
    from rigtwin.compare.deviation import Deviation


NAME_WIDTH = 44  # letters in a line of a row's name: 2.5 inch of the 7.2, which leaves the axis room for its title
LINE, BETWEEN = 0.14, 0.14  # [inch], height of a line of a row's name, and between two rows
MOST_CURVES = 12  # largest number of curves drawn on each side; a drum has hundreds
TONES = {"good": "#1c7a4d", "bad": "#b3471d", "doubtful": "#8a6400", "plain": "#8a94a0"}  # as in templates/style.css
DRAWN_ROWS = ("experiment", "quantity", "method", "deviation_percent", "low_95_percent", "high_95_percent", "verdict")


def overlay_figure(overlay: Overlay, name: str, caption: str) -> FigureFile:
    """Draw measured and simulated curves on common axes, single curves faint, their means strong.

    Parameters
    ----------
    overlay : Overlay
        The curves.
    name : str
        Name of the figure's files.
    caption : str
        Its caption.

    Returns
    -------
    FigureFile
        The figure.
    """
    low, high = overlay.span
    tall = 3.2
    if overlay.to_scale:
        heights = [float(np.nanmax(curve.y) - min(np.nanmin(curve.y), 0.0)) for curve in _drawn(overlay)]
        tall = 0.9 + 6.5 * min(max(heights) / (high - low), 1.0)
    columns = ("side", "curve", column_name(overlay.x_label), column_name(overlay.y_label))
    rows: list[dict[str, Any]] = []
    with canvas(tall) as (figure, axes):
        for curves, colour, side in (
            (overlay.measured, MEASURED, "measured"),
            (overlay.simulated, TWIN, "twin"),
        ):
            several = len(curves) > 1
            every = max(1, math.ceil(len(curves) / MOST_CURVES))
            for number, curve in enumerate(curves[::every]):
                x, y = thin(curve.x, curve.y)
                label = None if several or number else side
                axes.plot(x, y, "-", lw=1.3, color=colour, alpha=0.35 if several else 1, label=label)
                rows += _points(columns, side, str(number * every + 1), x, y)
            if several:
                mean = overlay.mean(curves)
                axes.plot(mean.x, mean.y, "-", lw=2, color=colour, label=f"{side}, mean of {len(curves)}")
                rows += _points(columns, side, f"mean of {len(curves)}", mean.x, mean.y)
        axes.set(xlabel=overlay.x_label, ylabel=overlay.y_label)
        if overlay.to_scale:
            axes.set_aspect("equal")
        axes.legend(loc="best")
        label = f"{overlay.what.capitalize()}, measured and simulated"
        return figure_file(figure, name, label, rows, columns, caption)


def _points(columns: Sequence[str], side: str, curve: str, x: Any, y: Any) -> Iterator[dict[str, Any]]:
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if math.isfinite(a) and math.isfinite(b):
            yield dict(zip(columns, (side, curve, a, b), strict=True))


def _drawn(overlay: Overlay) -> tuple[Curve, ...]:
    return (*overlay.measured, *overlay.simulated)


def tone(row: Deviation) -> str:
    """Return how a verdict is coloured.

    Parameters
    ----------
    row : Deviation
        The row with the verdict.

    Returns
    -------
    str
        "good", "bad", "doubtful" or "plain".
    """
    if row.doubtful:
        return "doubtful"
    if row.verdict.startswith("agree"):
        return "good"
    return "bad" if row.verdict.startswith(("twin", "differs")) else "plain"


def interval(row: Deviation) -> tuple[float, float]:
    """Return the 95 % interval of a percent deviation, as `rigtwin.compare.deviation.percent_interval` takes it.

    Parameters
    ----------
    row : Deviation
        The row, whose twin has a value.

    Returns
    -------
    tuple of float
        Its ends [%], infinite where nothing is known.
    """
    assert row.simulated is not None
    return percent_interval(
        row.measured,
        row.measured_std_uncertainty,
        row.simulated,
        row.simulated_std_uncertainty or 0.0,
        row.z_limit or 2.0,
    )


def deviations_figure(rows: Sequence[Deviation], widest: float) -> FigureFile | None:
    """Draw percent deviations with their 95 % intervals.

    Parameters
    ----------
    rows : sequence of Deviation
        Rows of the table of deviations; those without a known standard deviation are left out.
    widest : float
        End of the axis [%].

    Returns
    -------
    FigureFile or None
        None where no deviation has a known standard deviation.
    """
    shown = [(row, row.percent_deviation) for row in rows if row.percent_deviation is not None]
    shown = [(row, deviation) for row, deviation in shown if row.percent_deviation_std is not None]
    if not shown:
        return None
    names = [textwrap.wrap(f"{row.experiment}: {_what(row)}", NAME_WIDTH) for row, _ in shown]
    tall = np.array([BETWEEN + LINE * len(lines) for lines in names])
    places, end = np.cumsum(tall) - tall / 2, 1.08 * widest
    with canvas(0.8 + float(tall.sum())) as (figure, axes):
        axes.axvline(0.0, lw=1, color="#8a94a0")
        for place, (row, deviation) in zip(places, shown, strict=True):
            (low, high), colour = interval(row), TONES[tone(row)]
            axes.plot(np.clip([low, high], -2 * end, 2 * end), [place] * 2, lw=1.5, color=colour)
            axes.plot(deviation, place, "o", ms=4.5, color=colour)
            for side, reach, arrow in ((-1, -low, "<"), (1, high, ">")):
                if reach > end:  # the interval goes on
                    axes.plot(side * end, place, arrow, ms=6, color=colour, clip_on=False)
        axes.set_xlim(-end, end)
        axes.set_yticks(places, ["\n".join(lines) for lines in names], fontsize=8)
        axes.set_ylim(float(tall.sum()), 0.0)
        axes.set_xlabel("deviation of the twin from the measurement / %")
        return figure_file(
            figure,
            "deviations",
            "Percent deviations of the twins from the measurements",
            [_row(row, deviation) for row, deviation in shown],
            DRAWN_ROWS,
            "Deviation of each simulated value from the measured one, 100 (simulated - measured) / measured, with its "
            "95 % interval, which excludes zero where the verdict says too high or too low, unless the measured value "
            "is zero within its own; an arrow marks an interval that goes on beyond the axis.",
        )


def _what(row: Deviation) -> str:
    words = ", ".join(words for words in (title(row.quantity), siblings(row.row()), row.method) if words)
    return words.replace(" %", "\N{NO-BREAK SPACE}%")


def _row(row: Deviation, deviation: float) -> dict[str, Any]:
    values = (deviation, *interval(row))
    quantity = ", ".join(filter(None, (title(row.quantity), siblings(row.row()))))
    return dict(zip(DRAWN_ROWS, (row.experiment, quantity, row.method, *values, row.verdict), strict=True))
