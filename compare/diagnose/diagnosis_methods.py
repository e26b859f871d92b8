"""The methods text of a diagnosis, of single bodies or of many particles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from rigtwin.compare.diagnose.selection.locate import LEVEL
from rigtwin.compare.diagnose.selection.name_effects import ALARM
from rigtwin.compare.report.methods_text import Methods, effect_sentence, software
from rigtwin.lab.formatting import counted
from rigtwin.lab.reference.bibliography import SOFTWARE

if TYPE_CHECKING:
    from rigtwin.compare.diagnose.bulk.candidates import BulkEffect
    from rigtwin.compare.diagnose.bulk.diagnose_bulk import BulkDiagnosis
    from rigtwin.compare.diagnose.diagnosis import Diagnosis
    from rigtwin.sim.effects import Effect

LIBRARIES = ("numpy", "scipy", "taichi")
"""Libraries whose versions the text states."""


def methods(found: Diagnosis, versions: Mapping[str, str]) -> Methods:
    """The methods text of the diagnosis of tracks of single bodies.

    Parameters
    ----------
    found : Diagnosis
        The finished diagnosis.
    versions : mapping of str to str
        Versions of rigtwin, Python and `LIBRARIES`.

    Returns
    -------
    Methods
        Its paragraphs.
    """
    return Methods((("Diagnosis", " ".join(_of_tracks(found))), ("Software", software(versions))))


def bulk_methods(found: BulkDiagnosis, versions: Mapping[str, str]) -> Methods:
    """Return the methods text of the diagnosis of a lab with many particles.

    Parameters
    ----------
    found : BulkDiagnosis
        Diagnosis that has ended.
    versions : mapping of str to str
        As for `methods`.

    Returns
    -------
    Methods
        Paragraphs and references of the methods text.
    """
    return Methods((("Diagnosis", " ".join(_of_numbers(found))), ("Software", software(versions))))


def _of_tracks(found: Diagnosis) -> Iterator[str]:
    lab, naming, location = found.lab, found.naming, found.location
    yield (
        f"{lab.repetitions} tracked repetitions in {counted(len(lab.conditions), 'condition')} were diagnosed with "
        f"rigtwin [@{SOFTWARE}]."
    )
    if naming is None:
        yield f"Nothing was fitted: {found.reason}."
        return
    names = [one.name.partition(".")[0].replace("_", " ") for one in naming.base.unknowns if math.isfinite(one.sd)]
    known = f"; unknown within their stated standard uncertainties: {', '.join(dict.fromkeys(names))}" if names else ""
    yield (
        f"The plain model was fitted to {len(found.bench.rows)} positions together with release and impacts of each "
        f"repetition{known}."
    )
    if location is not None and location.tested:
        yield (
            f"Mean residuals were tested in {location.tested} regions, with Holm's correction at a family-wise level "
            f"of {100 * LEVEL:g} % [@holm1979]."
        )
    yield (
        f"{len(naming.tried)} sets of effects were fitted beside the model. A first effect needs a decrease of the "
        f"deviance of at least {ALARM:g}; sets whose coefficients are impossible or within the calibration uncertainty "
        "are refused."
    )
    yield from _result(found.verdict, found.chosen.terms if found.chosen is not None else ())


def _of_numbers(found: BulkDiagnosis) -> Iterator[str]:
    from rigtwin.compare.diagnose.bulk.naming import ALARM as FIRST

    measured = sum(len(one.names) for one in found.responses)
    yield (
        f"{measured} measured numbers of {counted(len(found.responses), 'condition')} were compared with {found.runs} "
        f"discrete-element simulations in rigtwin [@{SOFTWARE}] about the stated setting. To these runs "
        "a response surface of each number over parameters, uncertain settings and effects was fitted."
    )
    yield (
        f"{len(found.naming.tried)} sets of effects were fitted beside the baseline. A first effect needs a decrease "
        f"of the deviance of at least {FIRST:g}."
    )
    yield from _result(found.verdict, () if found.shown is None else found.shown.effects)


def _result(verdict: str, effects: Sequence[Effect | BulkEffect]) -> Iterator[str]:
    yield f"The verdict is `{verdict}`."
    for one in effects:
        yield effect_sentence(one.title, one.equation, one.source)
