"""The page of a diagnosis as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.diagnosis import Diagnosis, in_words
from rigtwin.compare.diagnose.fitting import strained
from rigtwin.compare.diagnose.fitting.parameter_uncertainty import parameters
from rigtwin.compare.diagnose.selection.candidate import Candidate
from rigtwin.compare.diagnose.selection.complexity_penalty import SECOND
from rigtwin.compare.diagnose.selection.gap import Gap, closed
from rigtwin.compare.diagnose.selection.name_effects import ALARM
from rigtwin.compare.report.figure_file import FigureFile
from rigtwin.compare.report.fill_template import filled
from rigtwin.compare.report.methods_text import Methods
from rigtwin.lab.formatting import unit_of


class Tried(Protocol):
    """A set of effects that was fitted, of single bodies or of a bulk."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""

    @property
    def gain(self) -> float:
        """Decrease of the deviance."""

    @property
    def reason(self) -> str:
        """Why it is refused, or empty."""


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
            [(one, _candidate_row(diagnosis.lab, one)) for one in _leading(diagnosis)],
            diagnosis.chosen,
            naming.alike if naming is not None and diagnosis.verdict == "indistinguishable" else (),
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
        further_gain=f"{SECOND:g}",
        methods=text,
        seconds=diagnosis.seconds,
    )


def _leading(diagnosis: Diagnosis) -> list[Candidate]:
    """The chosen candidate, those alike, all single ones, and the ten larger sets of the largest gains."""
    if diagnosis.naming is None:
        return []
    order = sorted(diagnosis.naming.tried, key=lambda one: -one.gain)
    shown = [
        *(() if diagnosis.chosen is None else (diagnosis.chosen,)),
        *(one for one in order if len(one.terms) == 1),
        *diagnosis.naming.alike,
        *[one for one in order if len(one.terms) > 1][:10],
    ]
    return list({one.names: one for one in reversed(shown)}.values())


def in_order(
    candidates: Sequence[tuple[Tried, dict[str, str]]],
    chosen: Tried | None,
    alike: Sequence[Tried],
) -> list[dict[str, str]]:
    """Return the rows of candidates with what became of each.

    Parameters
    ----------
    candidates : sequence of tuple
        Candidates with their rows.
    chosen : Tried or None
        The one that was chosen.
    alike : sequence of Tried
        Those that explain the data as well as the chosen one.

    Returns
    -------
    list of dict
        The chosen one first, then those alike, those that are not refused, and the refused ones, each by decreasing
        gain.
    """
    equal = [one.names for one in alike]

    def outcome(one: Tried) -> tuple[int, str]:
        if chosen is not None and one.names == chosen.names:
            return 0, "chosen"
        if one.names in equal:
            return 1, "explains the data equally well"
        if one.reason:
            return 3, f"refused: {one.reason}"
        larger = chosen is not None and len(one.names) > len(chosen.names)
        return 2, "more effects than needed" if larger else "not chosen"

    ordered = sorted(candidates, key=lambda each: (outcome(each[0])[0], -each[0].gain))
    return [row | {"outcome": outcome(one)[1], "refused": one.reason} for one, row in ordered]


def _candidate_row(lab: TrackedLab, candidate: Candidate) -> dict[str, str]:
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
