"""The page of the diagnosis of a lab with many particles as one self-contained HTML file."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigtwin.compare.diagnose.bulk.diagnose_bulk import BulkDiagnosis, parameters_of
from rigtwin.compare.diagnose.bulk.naming import ALARM, SECOND, BulkCandidate
from rigtwin.compare.diagnose.figures import BEFORE, NOISE
from rigtwin.compare.diagnose.fitting import strained
from rigtwin.compare.diagnose.page import gap_rows, in_order, parameters_in_words
from rigtwin.compare.report.figure_file import FigureFile, figure_file
from rigtwin.compare.report.fill_template import filled
from rigtwin.compare.report.methods_text import Methods
from rigtwin.compare.report.plot_style import TWIN, canvas
from rigtwin.lab.formatting import unit_of


def bulk_page(found: BulkDiagnosis, figure: FigureFile, text: Methods) -> str:
    """The HTML text of the whole page, with its figure and its methods text."""
    document = found.to_json()
    return filled(
        "diagnosis.html",
        title=found.lab.title,
        rig=found.lab.rigs,
        verdict=found.verdict,
        reason=found.reason,
        left_out=found.left_out,
        form="",
        next_experiment=found.next_experiment,
        designs=found.designs[:8],
        beside=[],
        stability="",
        where=found.where_in_words,
        regions=found.where[:12],
        candidates=in_order([(one, _row(one)) for one in found.naming.tried], found.shown, found.naming.alike),
        added=_added(found),
        gaps=gap_rows(found.gap),
        gap_noise=found.gap.noise,
        calibration=sorted(document["calibration"], key=lambda row: -abs(row["pull"] or 0.0)),
        strained=strained.in_words(document["strained"]),
        far=[row["name"] for row in document["strained"]],
        leading=[figure],
        further=[],
        overview=[],
        tried=len(found.naming.tried),
        first_gain=f"{ALARM:g}",
        further_gain=f"{SECOND:g}",
        methods=text,
        seconds=found.seconds,
    )


def bulk_figure(found: BulkDiagnosis) -> FigureFile:
    """Deviation of each measured number over its uncertainty, before and after, one panel for each condition."""
    columns = ("condition", "quantity", "twin", "deviation_standard_uncertainties")
    rows: list[dict[str, Any]] = []
    heights = [len(one.names) for one in found.responses]
    fits = [(found.naming.base, BEFORE, "twin before")]
    if found.shown is not None:
        fits.append((found.shown.fitted, TWIN, f"twin with {found.shown.title}"))
    with canvas(0.6 + sum(0.5 + 0.22 * height for height in heights)) as (figure, _):
        figure.clear()
        panels = np.atleast_1d(figure.subplots(len(heights), 1, squeeze=True, height_ratios=heights, sharex=True))
        for panel, one in zip(panels, found.responses, strict=True):
            for fitted, colour, label in fits:
                spread = np.sqrt(np.diag(one.covariance(fitted.u)))
                off = (one.measured - one.predicted(fitted.u)) / np.where(spread > 0, spread, 1.0)
                panel.plot(off, np.arange(len(off)), "o", ms=4, color=colour, label=label)
                rows += [
                    dict(zip(columns, (one.features.condition.name, name, label, float(value)), strict=True))
                    for name, value in zip(one.names, off, strict=True)
                ]
            panel.set_yticks(range(len(one.names)), [name.replace("_", " ") for name in one.names], fontsize=7)
            panel.axvspan(-2, 2, color=NOISE, alpha=0.35, lw=0)
            panel.set_title(one.features.condition.name, fontsize=8, loc="left")
            panel.invert_yaxis()
        panels[-1].set_xlabel("(measured - simulated) / standard uncertainty")
        panels[0].legend(fontsize=7)
        label = "Deviation of each measured number over its uncertainty, before and after the effect is added"
        caption = f"{label}; the band is two standard uncertainties wide on each side."
        return figure_file(figure, "diagnosis-numbers", label, rows, columns, caption)


def _row(candidate: BulkCandidate) -> dict[str, str]:
    return {
        "names": candidate.title,
        "kind": ", ".join(dict.fromkeys(one.kind for one in candidate.effects)),
        "gain": f"{candidate.gain:.1f}",
        "parameters": parameters_in_words(parameters_of(candidate)),
    }


def _added(found: BulkDiagnosis) -> list[dict[str, Any]]:
    best = found.shown
    if best is None:
        return []
    return [
        {
            "title": one.title, "equation": one.equation, "source": one.source, "kind": one.kind,
            "rigs": found.lab.rigs,
            "parameters": f"{one.parameter} = {best.fitted.value(one.axis):.4g} ± {best.fitted.std(one.axis):.2g}"
            f"{unit_of(next(axis.unit for axis in best.fitted.axes if axis.name == one.axis))}",
        }
        for one in best.effects
    ]  # fmt: skip
