"""The page of the diagnosis of a lab with many particles as one self-contained HTML file."""

from __future__ import annotations

from typing import Any

from rigtwin.compare.diagnose.bulk.diagnose_bulk import BulkDiagnosis, parameters_of
from rigtwin.compare.diagnose.bulk.naming import ALARM, BulkCandidate
from rigtwin.compare.diagnose.page import gap_rows, parameters_in_words
from rigtwin.compare.report.fill_template import filled
from rigtwin.lab.formatting import unit_of


def bulk_page(found: BulkDiagnosis) -> str:
    """The HTML text of the whole page."""
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
        candidates=[_row(one) for one in found.naming.tried],
        added=_added(found),
        gaps=gap_rows(found.gap),
        gap_noise=found.gap.noise,
        calibration=document["calibration"],
        statistic=document["residual_statistic"],
        figure="",
        tried=len(found.naming.tried),
        first_gain=f"{ALARM:g}",
        seconds=found.seconds,
    )


def _row(candidate: BulkCandidate) -> dict[str, str]:
    return {
        "names": candidate.title,
        "kind": ", ".join(dict.fromkeys(one.kind for one in candidate.effects)),
        "gain": f"{candidate.gain:.1f}",
        "parameters": parameters_in_words(parameters_of(candidate)),
        "refused": candidate.reason,
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
