"""The page of a diagnosis as one self-contained HTML file."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.diagnosis import Diagnosis, in_words
from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.compare.diagnose.fitting.parameter_uncertainty import parameters
from rigtwin.compare.diagnose.selection.gap import Gap, closed
from rigtwin.compare.diagnose.selection.name_effects import ALARM
from rigtwin.compare.report.fill_template import filled
from rigtwin.lab.arrays import Array
from rigtwin.lab.formatting import unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER, NOISE = "#d55e00", "#0072b2", "#c3ccd4"  # safe for colour-blind readers (Okabe and Ito 2008)
MOST_PANELS = 12
SLICES = 40  # time bins of a record, for the residual curves


def page(diagnosis: Diagnosis) -> str:
    """The HTML text of the whole page."""
    naming = diagnosis.naming
    return filled(
        "diagnosis.html",
        title=diagnosis.lab.title,
        rig=diagnosis.lab.rig,
        verdict=diagnosis.verdict,
        reason=diagnosis.reason,
        left_out=diagnosis.left_out,
        form=diagnosis.form,
        next_experiment=diagnosis.next_experiment,
        designs=diagnosis.designs[:8],
        beside=[_beside_row(one) for one in diagnosis.beside],
        stability=diagnosis.stability.in_words() if diagnosis.stability else "",
        where=in_words(diagnosis.location),
        regions=diagnosis.where[:12],
        candidates=[_candidate_row(diagnosis.lab, one) for one in _leading(diagnosis)],
        added=_added(diagnosis),
        gaps=gap_rows(diagnosis.gap),
        gap_noise=diagnosis.gap.noise if diagnosis.gap else "",
        calibration=diagnosis.to_json()["calibration"],
        statistic=diagnosis.to_json()["residual_statistic"],
        figure=_figure(diagnosis) if naming is not None else "",
        tried=len(naming.tried) if naming is not None else 0,
        first_gain=f"{ALARM:g}",
        seconds=diagnosis.seconds,
    )


def _leading(diagnosis: Diagnosis) -> list[Any]:
    """All single candidates and the ten best larger sets, largest gain first."""
    if diagnosis.naming is None:
        return []
    order = sorted(diagnosis.naming.tried, key=lambda one: -one.gain)
    singles = [one for one in order if len(one.terms) == 1]
    more = [one for one in order if len(one.terms) > 1][:10]
    return sorted([*singles, *more], key=lambda one: -one.gain)


def _candidate_row(lab: TrackedLab, candidate: Any) -> dict[str, str]:
    found = parameters(lab, candidate.fitted, candidate.terms)
    return {
        "names": " + ".join(term.title for term in candidate.terms),
        "kind": ", ".join(dict.fromkeys(term.kind for term in candidate.terms)),
        "gain": f"{candidate.gain:.1f}",
        "parameters": parameters_in_words(found),
        "refused": candidate.reason,
    }


def _added(diagnosis: Diagnosis) -> list[dict[str, str]]:
    if diagnosis.chosen is None:
        return []
    return [
        {
            "title": term.title,
            "equation": term.equation,
            "source": term.source,
            "kind": term.kind,
            "rigs": ", ".join(term.rigs),
            "parameters": _candidate_row_of(diagnosis, term),
        }
        for term in diagnosis.chosen.terms
    ]


def _candidate_row_of(diagnosis: Diagnosis, term: Any) -> str:
    assert diagnosis.chosen is not None
    return parameters_in_words(parameters(diagnosis.lab, diagnosis.chosen.fitted, (term,)))


def parameters_in_words(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Coefficients with their standard uncertainties."""

    def one(name: str, about: Mapping[str, Any]) -> str:
        each = ", ".join(f"{value:.4g} for {pair}" for pair, value in about.get("by_pair", {}).items())
        value = f"{about['value']:.4g} ± {about['std']:.2g}{unit_of(about['unit'])}"
        return f"{name} = {value}{f' (mean of {each})' if each else ''}"

    return "; ".join(one(name, about) for name, about in found.items())


def gap_rows(gap: Gap | None) -> list[dict[str, str]]:
    """The gap on all data and on data held out, as the page shows it."""
    if gap is None:
        return []
    rows = [
        ("all data", gap.before, gap.after, gap.noise_floor),
        ("repetitions held out", gap.held_out_before, gap.held_out_after, gap.held_out_noise_floor),
        (f"condition held out {gap.condition}", gap.condition_before, gap.condition_after, gap.condition_noise_floor),
    ]
    return [
        {
            "what": what,
            "before": f"{before:.4g}",
            "after": f"{after:.4g}",
            "floor": f"{floor:.4g}",
            "closed": "–" if (share := closed(before, after, floor)) is None else f"{100 * share:.1f} %",
        }
        for what, before, after, floor in rows
        if before is not None and after is not None and floor is not None
    ]


def _beside_row(one: Any) -> dict[str, str]:
    return {
        "what": f"{one.role}: {' + '.join(one.effects)}",
        "gain": f"{one.gain:.1f}",
        "after": f"{one.gap_after:.4g}",
        "closed": "–" if one.closed is None else f"{100 * one.closed:.1f} %",
    }


def _figure(diagnosis: Diagnosis) -> str:
    """Mean residual over repetitions against time, before and after, one panel per condition and coordinate."""
    from matplotlib.figure import Figure

    bench, naming = diagnosis.bench, diagnosis.naming
    assert naming is not None
    names = list(bench.condition_names)
    order = {one.experiment: rank for rank, one in reversed(list(enumerate(diagnosis.where)))}
    shown = sorted(range(len(names)), key=lambda c: order.get(names[c], 999))[: MOST_PANELS // 2]
    figure = Figure(figsize=(9.5, 1.9 * len(shown)), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(shown), 2, squeeze=False))
    for row, c in enumerate(shown):
        for k, axis in enumerate("xy"):
            _panel(axes[row, k], bench, naming.base, c, k, BEFORE, "before")
            if diagnosis.chosen is not None:
                _panel(axes[row, k], bench, diagnosis.chosen.fitted, c, k, AFTER, "after")
            axes[row, k].set_title(f"{names[c]}: {axis}", fontsize=8, loc="left")
            axes[row, k].tick_params(labelsize=7)
            axes[row, k].axhspan(-2, 2, color=NOISE, alpha=0.35, lw=0)
    axes[-1, 0].set_xlabel("time / s", fontsize=8)
    axes[0, 0].set_ylabel("mean residual / standard errors", fontsize=7)
    axes[0, 0].legend(fontsize=7, frameon=False)
    return drawn(
        figure, "Mean residuals of measurement minus simulation over time, before and after the effect is added"
    )


def drawn(figure: Figure, label: str) -> str:
    """A figure as SVG for the page; `label` says what it shows."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    drawing = text.getvalue()
    drawing = re.sub(r"<style.*?</style>", "", drawing[drawing.index("<svg") :], flags=re.DOTALL)
    return drawing.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)


def _panel(axes: Axes, bench: Any, fitted: Fit, condition: int, k: int, colour: str, label: str) -> None:
    spans = [bench.spans[r] for r in np.flatnonzero(bench.condition == condition)]
    time = np.concatenate([bench.time[span] for span in spans])
    residual = np.concatenate([fitted.residual[span, k] for span in spans])
    centre, mean = _slices(time, residual)
    axes.plot(centre, mean, ".-", ms=3, lw=0.8, color=colour, label=label)


def _slices(time: Array, residual: Array) -> tuple[Array, Array]:
    """Centre [s] and mean residual of each time bin, in standard errors of that mean."""
    edges = np.linspace(time.min(), time.max() + 1e-9, SLICES + 1)
    number = np.digitize(time, edges) - 1
    centre, mean = [], []
    for one in range(SLICES):
        inside = number == one
        if inside.sum() > 2:
            centre.append(float(time[inside].mean()))
            mean.append(float(residual[inside].mean()) * math.sqrt(int(inside.sum())))
    return np.array(centre), np.array(mean)
