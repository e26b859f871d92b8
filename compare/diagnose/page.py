"""The page of a diagnosis as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.diagnosis import Diagnosis, in_words
from rigtwin.compare.diagnose.fitting import strained
from rigtwin.compare.diagnose.fitting.parameter_uncertainty import parameters
from rigtwin.compare.diagnose.selection.gap import Gap, closed
from rigtwin.compare.diagnose.selection.name_effects import ALARM
from rigtwin.compare.report.figure_file import FigureFile
from rigtwin.compare.report.fill_template import filled
from rigtwin.compare.report.methods_text import Methods
from rigtwin.lab.formatting import counted, unit_of


def page(diagnosis: Diagnosis, drawn: Mapping[str, FigureFile], text: Methods) -> str:
    """Return the HTML text of the whole page.

    Parameters
    ----------
    diagnosis : Diagnosis
        Diagnosis that the page shows.
    drawn : mapping of str to FigureFile
        Its figures, as of `rigtwin.compare.diagnose.figures.figures`.
    text : Methods
        Methods text of the diagnosis.

    Returns
    -------
    str
        HTML text.
    """
    naming, document = diagnosis.naming, diagnosis.to_json()
    plots = list(drawn.values())
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
        candidates=in_order(
            [(one, _candidate_row(diagnosis.lab, one)) for one in _leading(diagnosis)], diagnosis.chosen
        ),
        added=_added(diagnosis),
        gaps=gap_rows(diagnosis.gap),
        gap_noise=diagnosis.gap.noise if diagnosis.gap else "",
        calibration=sorted(document["calibration"], key=lambda row: -abs(row["pull"] or 0.0)),
        strained=strained.in_words(document["strained"]),
        far=[row["name"] for row in document["strained"]],
        leading=plots[:1],
        further=plots[1:-1],
        overview=plots[1:][-1:],
        tried=len(naming.tried) if naming is not None else 0,
        first_gain=f"{ALARM:g}",
        methods=text,
        seconds=diagnosis.seconds,
    )


def _leading(diagnosis: Diagnosis) -> list[Any]:
    """All single candidates, the ten best larger sets, and the chosen one."""
    if diagnosis.naming is None:
        return []
    order = sorted(diagnosis.naming.tried, key=lambda one: -one.gain)
    singles = [one for one in order if len(one.terms) == 1]
    sets = [one for one in order if len(one.terms) > 1]
    chosen = () if diagnosis.chosen is None else diagnosis.chosen.names
    return [*singles, *sets[:10], *(one for one in sets[10:] if one.names == chosen)]


def in_order(candidates: Sequence[tuple[Any, dict[str, str]]], chosen: Any) -> list[dict[str, str]]:
    """Return the rows of candidates with what became of each.

    Parameters
    ----------
    candidates : sequence of tuple
        Candidates, which have names, gain and reason, with their rows.
    chosen : candidate or None
        The one that was chosen.

    Returns
    -------
    list of dict
        The chosen one first, then those that are not refused, then the refused ones, each by decreasing gain.
    """

    def outcome(one: Any) -> tuple[int, str]:
        if chosen is not None and one.names == chosen.names:
            return 0, "chosen"
        if one.reason:
            return 2, f"refused: {one.reason}"
        if chosen is None:
            return 1, ""
        more, gained = len(one.names) - len(chosen.names), one.gain - chosen.gain
        if more > 0 and gained > 0:
            return 1, f"gains {gained:.4g} more by {counted(more, 'effect')} more"
        return 1, f"gains {-gained:.4g} less" if gained < 0 else f"gains {gained:.4g} more"

    found = [(outcome(one), one.gain, row) for one, row in candidates]
    return [
        row | {"outcome": words, "refused": "yes" if rank == 2 else ""}
        for (rank, words), _, row in sorted(found, key=lambda each: (each[0][0], -each[1]))
    ]


def _candidate_row(lab: TrackedLab, candidate: Any) -> dict[str, str]:
    found = parameters(lab, candidate.fitted, candidate.terms)
    return {
        "names": " + ".join(term.title for term in candidate.terms),
        "kind": ", ".join(dict.fromkeys(term.kind for term in candidate.terms)),
        "gain": f"{candidate.gain:.1f}",
        "parameters": parameters_in_words(found),
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
    """Return coefficients with their standard uncertainties.

    Parameters
    ----------
    found : mapping of str to mapping
        By name ``value``, ``std`` and ``unit`` (SI) of each coefficient.

    Returns
    -------
    str
        The words.
    """

    def one(name: str, about: Mapping[str, Any]) -> str:
        each = ", ".join(f"{value:.4g} for {pair}" for pair, value in about.get("by_pair", {}).items())
        value = f"{about['value']:.4g} ± {about['std']:.2g}{unit_of(about['unit'])}"
        return f"{name} = {value}{f' (mean of {each})' if each else ''}"

    return "; ".join(one(name, about) for name, about in found.items())


def gap_rows(gap: Gap | None) -> list[dict[str, str]]:
    """Return the gap on all data and on data held out, as the page shows it.

    Parameters
    ----------
    gap : Gap or None
        Gap between data and model; None where none was computed.

    Returns
    -------
    list of dict
        Rows of the table.
    """
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
        "what": f"{one.role}: {one.title}",
        "gain": f"{one.gain:.1f}",
        "after": f"{one.gap_after:.4g}",
        "closed": "–" if one.closed is None else f"{100 * one.closed:.1f} %",
    }
