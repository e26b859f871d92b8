"""Summarise the warnings of runs: each kind once, in its worst form.

The patterns below match the wording of warnings in `rigtwin.sim`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rigtwin.lab.errors import options_in

_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_SHARE = re.compile(r"^only (\d+) of (\d+)")
# warnings that make the numbers of a run doubtful; not the overlap of beads, which follows from the paper's stiffness
_SPOILS = re.compile(r"still moving|^only \d|arch over|did not stay|reaches above|does not close")
# exceptions: these do not affect the flow of a hopper, which need not be empty after a stated time
_OF_HEAP, _OF_REST, _JAM = "the heap was still moving", "had left the hopper", "arch over"
_OF_LABS = {"stiffness_factor"}  # options of `simulate` that `compare` has, too


def once(said: Iterable[Iterable[str]]) -> dict[str, int]:
    """Return the warnings of several runs: each kind in its worst form, with the number of runs.

    Parameters
    ----------
    said : iterable of iterable of str
        The warnings of each run.

    Returns
    -------
    dict of str to int
        Number of runs by warning.

    Examples
    --------
    >>> once([["only 9 of 10 had left"], ["only 29 of 30 had left", "pressed by 5 %"], []])
    {'only 9 of 10 had left': 2, 'pressed by 5 %': 1}
    """
    kinds: dict[str, list[str]] = {}
    for words in said:
        mine: dict[str, list[str]] = {}
        for sentence in words:
            mine.setdefault(_NUMBER.sub("#", sentence), []).append(sentence)
        for kind, alike in mine.items():
            kinds.setdefault(kind, []).append(max(alike, key=_badness))
    return {max(alike, key=_badness): len(alike) for alike in kinds.values()}


def warned(result: Mapping[str, Any]) -> list[str]:
    """Return the warnings of a run without their advice, which names options of `simulate`.

    Parameters
    ----------
    result : mapping
        Its result, with ``warnings``.

    Returns
    -------
    list of str
        Warnings without that advice.
    """
    return [warning.partition(";")[0] for warning in result.get("warnings") or ()]


def fit_for_a_lab(warnings: Iterable[str]) -> tuple[str, ...]:
    """Return the warnings of a twin without advice that names an option which twins of a lab do not have.

    Parameters
    ----------
    warnings : iterable of str
        Warnings as the run gave them.

    Returns
    -------
    tuple of str
        Warnings without that advice.

    Examples
    --------
    >>> fit_for_a_lab(["it moves; raise --fill-limit", "it is soft; give a larger --stiffness-factor"])
    ('it moves', 'it is soft; give a larger --stiffness-factor')
    """
    said = ((warning, *warning.partition(";")[::2]) for warning in warnings)
    return tuple(warning if _OF_LABS.issuperset(options_in(advice)) else what for warning, what, advice in said)


def spoilt(result: Mapping[str, Any]) -> Sequence[str]:
    """Return the reasons why the numbers of a run are doubtful: still moving, lost particles, jammed or not empty.

    Parameters
    ----------
    result : mapping
        Its result, with ``warnings``.

    Returns
    -------
    sequence of str
        The reasons.

    Examples
    --------
    >>> rest = "only 5 of 60 beads had left the hopper when the run ended"
    >>> spoilt({"warnings": [rest], "emptied": 5})
    []
    >>> len(spoilt({"warnings": [f"{rest}: the others arch over the outlet"], "emptied": 5}))
    1
    """
    words = [sentence for sentence in warned(result) if _SPOILS.search(sentence)]
    if "at_rest" not in result:  # a drum or a hopper
        words = [one for one in words if _OF_HEAP not in one and not (_only_rest(one) and "emptied" in result)]
    elif not result["at_rest"] and not any("still moving" in sentence for sentence in words):
        words.append("it was still moving at the end")
    if (missed := result.get("missed")) and not any("did not stay" in sentence for sentence in words):
        words.append(f"{missed} of {result.get('placed', '?')} particles did not stay in the cylinder")
    return words


def _only_rest(sentence: str) -> bool:
    """Whether a warning only says that some particles have not left yet, not that they arch over the outlet."""
    return _OF_REST in sentence and _JAM not in sentence


def _badness(sentence: str) -> float:
    """Measure of severity: the first number of a warning, or for "only a of b" the missing share."""
    if share := _SHARE.match(sentence):
        return 1 - int(share[1]) / max(int(share[2]), 1)
    found = _NUMBER.search(sentence)
    return float(found[0]) if found else 0.0
