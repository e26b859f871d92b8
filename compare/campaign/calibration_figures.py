"""Figures of a calibration: influence of the parameters, posterior, deviations from measurements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.report.figure_file import FigureFile, figure_file
from rigtwin.compare.report.plot_style import MEASURED, TWIN, canvas
from rigtwin.lab.formatting import title

if TYPE_CHECKING:
    from rigtwin.compare.campaign.calibration import Calibration

MOST_SAMPLES = 600  # drawn of the posterior
DARK = 0.5  # share from which text on a field is white


def figures(found: Calibration) -> dict[str, FigureFile]:
    """Draw the figures of a calibration.

    Parameters
    ----------
    found : Calibration
        Calibration whose samples and predictions are drawn.

    Returns
    -------
    dict of str to FigureFile
        By name: ``screening``, ``posterior`` and ``predictions``.
    """
    return {"screening": _screening(found), "posterior": _posterior(found), "predictions": _predictions(found)}


def _screening(found: Calibration) -> FigureFile:
    """A field for each quantity and parameter: the share of the quantity's variance that the parameter causes alone."""
    label = "Share of the variance of each quantity that a parameter causes alone"
    shares = found.sensitivities
    rows = [f"{one.experiment}: {title(one.quantity)}, {one.method}" for one in found.targets]
    with canvas(max(1.0 + 0.28 * len(rows), 2.2)) as (figure, axes):  # the label of the colours needs its height
        axes.grid(visible=False)
        picture = axes.imshow(shares, aspect="auto", cmap="Blues", vmin=0, vmax=1)
        for (i, j), value in np.ndenumerate(shares):
            colour = "w" if value > DARK else "k"
            axes.text(j, i, f"{100 * value:.0f} %", ha="center", va="center", color=colour, fontsize=7)
        axes.set_xticks(range(len(found.parameters)), [one.name.replace("_", " ") for one in found.parameters])
        axes.set_yticks(range(len(rows)), rows, fontsize=7)
        figure.colorbar(picture, label="share of the variance")
        table = [
            {
                "experiment": target.experiment, "quantity": target.quantity, "method": target.method,
                **dict(zip((one.name for one in found.parameters), row.tolist(), strict=True)),
            }
            for target, row in zip(found.targets, shares, strict=True)
        ]  # fmt: skip
        return figure_file(figure, "calibration-screening", label, table)


def _posterior(found: Calibration) -> FigureFile:
    """Each parameter's density on the diagonal, each pair's samples below it."""
    number, names = len(found.parameters), [one.name for one in found.parameters]
    step = max(1, len(found.samples) // MOST_SAMPLES)
    with canvas(1.8 * number + 0.6) as (figure, _):
        figure.clear()
        panels = figure.subplots(number, number, squeeze=False)
        for i, j in np.ndindex(number, number):
            panel: Any = panels[i, j]
            across, down = found.parameters[j], found.parameters[i]
            if j > i:
                panel.axis("off")
                continue
            if i == j:
                spaced = across.value(np.linspace(0, 1, 31))
                panel.hist(found.samples[:, j], bins=spaced, density=True, color=TWIN, alpha=0.7)
                panel.set_yticks([])
            else:
                panel.plot(found.samples[::step, j], found.samples[::step, i], ".", ms=2, color=TWIN, alpha=0.4)
                panel.plot(found.best[across.name], found.best[down.name], "x", color="k")
                panel.set_yscale("log" if down.logarithmic else "linear")
                panel.set_ylim(down.low, down.high)
            panel.set_xscale("log" if across.logarithmic else "linear")
            panel.set_xlim(across.low, across.high)
            if i == number - 1:
                panel.set_xlabel(across.name.replace("_", " "))
            if j == 0 and i > 0:
                panel.set_ylabel(down.name.replace("_", " "))
        table = [dict(zip(names, row, strict=True)) for row in found.samples[::step].tolist()]
        return figure_file(
            figure,
            "calibration-posterior",
            "Posterior of the parameters over their ranges",
            table,
            names,
            "Posterior of the parameters (SI) over their ranges: densities on the diagonal, samples below it, a cross "
            "at the best set.",
        )


def _predictions(found: Calibration) -> FigureFile:
    """Deviation of the best set from each measurement, in standard deviations."""
    rows: list[dict[str, Any]] = [row for row in found.predictions if row["z"] is not None]
    label = "Predicted minus measured, in standard deviations"
    with canvas(0.9 + 0.26 * max(len(rows), 1)) as (figure, axes):
        axes.axvspan(-2, 2, color=MEASURED, alpha=0.12)
        for k, row in enumerate(rows):
            axes.plot(row["z"], k, "o", color=TWIN, mfc="none" if row["held_out"] else TWIN)
        names = [
            f"{row['experiment']}: {title(row['quantity'])}{' (held out)' if row['held_out'] else ''}" for row in rows
        ]
        axes.set_yticks(range(len(rows)), names, fontsize=7)
        axes.invert_yaxis()
        axes.set_xlabel(label.lower())
        columns = ("experiment", "quantity", "method", "unit", "measured", "predicted", "z", "held_out")
        caption = f"{label}; the band is two standard deviations wide on each side, open circles are held out."
        return figure_file(figure, "calibration-predictions", label, rows, columns, caption)
