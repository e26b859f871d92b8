"""Names that are nearly right: which known name was meant."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence

# all assumed, and tried on the names of commands, options and keys in tests/lab/test_spelling.py
LETTERS_PER_EDIT, MOST_EDITS = 4, 2  # letters of a name for each of its typing errors; a shorter name may have one
SHORTEST = 3  # letters of a name in which one error is no other name
STEM = 0.7  # share of the longer of two words that is their common beginning: simulate, simulation
UNIT = 3  # letters of a unit at the end of a name, at most: speed_rpm


def near(name: str, known: Iterable[str]) -> str:
    """Return the known name that was meant, where one is clearly the nearest.

    Parameters
    ----------
    name : str
        The name that is not known.
    known : iterable of str
        Names that are known.

    Returns
    -------
    str
        Empty where none is near, or several are alike.

    Notes
    -----
    Case and separators do not count.  A name is near if it is the same but for typing errors (a letter left out, added
    or changed, two swapped; figures are never typing errors), else if its words are among those of the known name, or
    are these behind others or with a unit, else if both begin alike.

    Examples
    --------
    >>> near("Frame-rate", ["frame_rate", "scale"]), near("heigth", ["height", "length"]), near("r07", ["r02"])
    ('frame_rate', 'height', '')
    >>> near("height", ["drop_height", "bounces"]), near("report", ["export", "import"])
    ('drop_height', '')
    """
    names = list(dict.fromkeys(known))
    given = _words(name)
    if not given:
        return ""
    letters = "".join(given)
    most = min(max(1, len(letters) // LETTERS_PER_EDIT), MOST_EDITS) if len(letters) >= SHORTEST else 0
    joined = {one: "".join(_words(one)) for one in names if _same_figures(name, one)}
    edits = {one: _edits(letters, other) for one, other in joined.items() if abs(len(letters) - len(other)) <= most}
    fewest = min(edits.values(), default=most + 1)
    if fewest <= most:
        misspelt = [one for one, count in edits.items() if count == fewest]
        return misspelt[0] if len(misspelt) == 1 else ""
    ways: Sequence[Callable[[Sequence[str], Sequence[str]], bool]] = (_among, _alike_at_first)
    found = ([one for one in names if way(given, _words(one))] for way in ways)
    return next((ones[0] if len(ones) == 1 else "" for ones in found if ones), "")


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the known names as advice, the one that was meant first.

    Parameters
    ----------
    name : str
        The name that is not known.
    known : iterable of str
        Names that are known.

    Returns
    -------
    str
        A clause.

    Examples
    --------
    >>> suggestion("framerate", ["frame_rate", "scale"])
    "did you mean 'frame_rate'? (known: frame_rate, scale)"
    >>> suggestion("temperature", ["frame_rate", "scale"])
    'known are frame_rate, scale'
    """
    names = list(dict.fromkeys(known))
    listed = ", ".join(names) or "none"
    meant = near(name, names)
    return f"did you mean {meant!r}? (known: {listed})" if meant else f"known are {listed}"


def meant_or(name: str, known: Iterable[str], otherwise: str) -> str:
    """Return the question for the known name that was meant, or another advice.

    Parameters
    ----------
    name : str
        The name that is not known.
    known : iterable of str
        Names that are known.
    otherwise : str
        Advice where none of them is near.

    Returns
    -------
    str
        A clause with its full stop or question mark, if `otherwise` has one.

    Examples
    --------
    >>> meant_or("framerate", ["frame_rate", "scale"], "give a name.")
    "did you mean 'frame_rate'?"
    >>> meant_or("temperature", ["frame_rate", "scale"], "give a name.")
    'give a name.'
    """
    meant = near(name, known)
    return f"did you mean {meant!r}?" if meant else otherwise


def _words(name: str) -> list[str]:
    return re.findall(r"[^\W_]+", name.lower())


def _same_figures(one: str, other: str) -> bool:
    return re.findall(r"\d", one) == re.findall(r"\d", other)


def _among(given: Sequence[str], known: Sequence[str]) -> bool:
    """Whether the given words are among the known ones, or are these behind others or with a unit."""
    count = len(known)
    with_unit = given[:count] == known and len(given) == count + 1 and len(given[-1]) <= UNIT
    return bool(known) and (set(given) <= set(known) or given[-count:] == known or with_unit)


def _alike_at_first(given: Sequence[str], known: Sequence[str]) -> bool:
    """Whether one name is the beginning of the other, or they share most of it."""
    one, other = "".join(given), "".join(known)
    same = next((k for k, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))
    shorter, longer = sorted((len(one), len(other)))
    return same >= SHORTEST and (same == shorter or same >= STEM * longer)


def _edits(one: str, other: str) -> int:
    """Letters left out, added, changed, or swapped with the next (optimal string alignment distance)."""
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, a in enumerate(one, start=1):
        last, row, earlier = row, [i], before
        for j, b in enumerate(other, start=1):
            least = min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (a != b))
            if i > 1 and j > 1 and (a, b) == (other[j - 2], one[i - 2]):
                least = min(least, earlier[j - 2] + 1)
            row.append(least)
        before = last
    return row[-1]
