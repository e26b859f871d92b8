"""What was measured by hand, or what a paper prints, under ``[experiments.measured]`` in lab.toml.

A value is a text like ``"184 +- 1.3 mm (n = 10)"``: the mean of n repetitions and their standard deviation s, so that
the standard uncertainty of the mean is s / sqrt(n).  Without n it is a single repetition with its standard uncertainty.
Values of single repetitions are a text like ``"184, 183.2, 186 mm"``, or a list of texts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from decimal import Decimal
from statistics import fmean, stdev
from typing import Any, NamedTuple

from rigtwin.lab.errors import BadInput, BadQuantity
from rigtwin.lab.quantity import Detail, Quantity
from rigtwin.lab.reference.repetition_scatter import Scatter
from rigtwin.lab.rig_quantities import BODIES, SIDES, RigQuantity, quantities_of
from rigtwin.lab.rigs import RigSettings
from rigtwin.lab.spelling import suggestion
from rigtwin.lab.units import DIMENSIONS, si

_REPETITIONS = re.compile(r"[(,;\s]\s*n\s*=\s*(\d+)\s*\)?$")
_PLUS_MINUS = re.compile(r"±|\+/?-")
_NUMBER = re.compile(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?")
_WORDS = {"side": SIDES, "body": BODIES}
MOST_REPETITIONS = 1_000_000  # a number that was meant to be smaller
LONGEST_TEXT = 100  # characters; no value needs more


class MeanOfRepetitions(NamedTuple):
    """A stated mean, in the unit of its text or in SI."""

    value: float
    std: float  # standard deviation of the n repetitions; of a single one, its standard uncertainty
    n: int


def stated_quantities(name: str, given: Any, rig: RigSettings) -> list[Quantity]:
    """Return the quantities that are stated under one name.

    Parameters
    ----------
    name : str
        Name of the quantity.
    given : Any
        What lab.toml holds there: a text, a table with the text as ``value`` and details, or a list of these.
    rig : RigSettings
        Rig of the experiment.

    Returns
    -------
    list of Quantity
        The quantities, in SI or degrees.

    Raises
    ------
    BadInput
        If the rig has no such quantity, or the text is no value with an uncertainty in a fitting unit.
    """
    known = quantities_of(rig)
    if name not in known:
        if hasattr(rig, name):
            raise BadInput(f"is a setting of the {rig.name}; state it as {name} of the experiment itself.")
        variant = getattr(rig, "variant", "")
        raise BadInput(f"is no result of a {rig.name}{variant and f' ({variant})'}; {suggestion(name, known)}.")
    several = isinstance(given, list) and not _single_values(given)
    entries = given if several else [given]
    if given == []:
        raise BadInput(f"is empty; {_written(known[name].dimension)}")
    found = [_quantity(name, entry, known[name]) for entry in entries]
    if len({(one.method, *one.detail.items()) for one in found}) < len(found):
        raise BadInput("states the same twice; take one of them out.")
    return found


def stated_scatter(name: str, given: Any, rig: RigSettings) -> Scatter:
    """Return the relative standard deviation from repetition to repetition that is stated for a quantity.

    Parameters
    ----------
    name : str
        Name of the quantity.
    given : Any
        What lab.toml holds there: ``"5 %"`` or 0.05; ``"5 % (n = 10)"`` was found with ten repetitions.
    rig : RigSettings
        Rig of the experiment.

    Returns
    -------
    Scatter
        The scatter; known exactly where no number of repetitions is stated.

    Raises
    ------
    BadInput
        If the rig has no such quantity, or the text is no share above 0 and below 1.

    Examples
    --------
    >>> from rigtwin.lab.rigs import TiltSettings
    >>> stated_scatter("rolling_friction", "12 % (n = 10)", TiltSettings("roll"))
    Scatter(relative=0.12, freedom=9.0, source='stated in lab.toml')
    """
    known = quantities_of(rig)
    if name not in known:
        raise BadInput(f"is no result of a {rig.name}; {suggestion(name, known)}.")
    text = str(given).strip()
    repetitions = _REPETITIONS.search(text)
    share = text[: repetitions.start()] if repetitions else text
    number, percent, rest = share.partition("%")
    try:
        relative = float(number) / (100 if percent else 1)
    except ValueError:
        relative = 0.0
    n = int(repetitions[1]) if repetitions else 0
    if isinstance(given, bool) or rest.strip() or not 0 < relative < 1 or (repetitions and n < 2):
        raise BadInput(f'{given!r} is no scatter; write it like "5 %" or "5 % (n = 10)", n being at least 2.')
    return Scatter(float(f"{relative:.12g}"), n - 1.0 if n else math.inf, "stated in lab.toml")


def mean_of_repetitions(text: str, dimension: str) -> MeanOfRepetitions:
    """Read a value with its uncertainty.

    Parameters
    ----------
    text : str
        For example ``"184 +- 1.3 mm (n = 10)"``; ``±`` is read too, and the unit may stand behind both numbers.
    dimension : str
        A key of `rigtwin.lab.units.DIMENSIONS`.

    Returns
    -------
    MeanOfRepetitions
        The value in SI.

    Raises
    ------
    BadInput
        If something is missing or has another dimension.

    Examples
    --------
    >>> mean_of_repetitions("184 ± 1.3 mm (n = 10)", "length")
    MeanOfRepetitions(value=0.184, std=0.0013, n=10)
    >>> mean_of_repetitions("0.42 +- 0.05", "number")
    MeanOfRepetitions(value=0.42, std=0.05, n=1)
    """
    if len(text) > LONGEST_TEXT:
        raise BadInput(f"{text[:20]!r}... has {len(text)} characters; {_written(dimension)}")
    repetitions = _REPETITIONS.search(text)
    numbers = text[: repetitions.start()] if repetitions else text
    bracketed = re.fullmatch(r"\(([^()]*)\)(.*)", numbers.strip())
    parts = [part.strip() for part in _PLUS_MINUS.split("".join(bracketed.groups()) if bracketed else numbers)]
    if len(parts) != 2 or not all(parts):
        many = "more than one" if len(parts) > 2 else "no"
        raise BadInput(f"{text!r} has {many} uncertainty; {_written(dimension)}")
    units = [_NUMBER.sub("", part, count=1).strip() for part in parts]
    if dimension != "number" and not any(units):
        raise BadInput(f"{text!r} has no unit; {_written(dimension)}")
    value, std = (
        _si(part if unit else f"{part} {''.join(units)}", dimension, whole=text)
        for part, unit in zip(parts, units, strict=True)
    )
    if std <= 0:
        raise BadInput(f"{text!r} has no uncertainty above zero; state at least half of the last digit.")
    n = int(repetitions[1]) if repetitions else 1
    if not 1 <= n <= MOST_REPETITIONS:
        raise BadInput(f"{text!r}: n is the number of repetitions, at least 1 and at most {MOST_REPETITIONS}.")
    return MeanOfRepetitions(value, std, n)


def _mean_of_values(texts: Sequence[str], dimension: str) -> MeanOfRepetitions:
    """Mean and standard deviation of values of single repetitions, in SI.

    Parameters
    ----------
    texts : sequence of str
        A value each; one without a unit has that of the last one.
    dimension : str
        A key of `rigtwin.lab.units.DIMENSIONS`.

    Raises
    ------
    BadInput
        If there is a single one, or one is no value of this dimension.

    Notes
    -----
    The standard deviation is at least that of rounding to the last digit, 1 / sqrt(12) of it.

    Examples
    --------
    >>> _mean_of_values(["184", "183", "185 mm"], "length")
    MeanOfRepetitions(value=0.184, std=0.001, n=3)
    """
    whole = ", ".join(texts)
    if len(texts) < 2 or len(texts) > MOST_REPETITIONS:
        raise BadInput(f"{whole!r} is one repetition, which does not show how much it scatters; {_written(dimension)}")
    unit = _NUMBER.sub("", texts[-1], count=1).strip()
    if dimension != "number" and not unit:
        raise BadInput(f"{whole!r} has no unit; {_written(dimension)}")
    values, least = [], 0.0
    for text in texts:
        number = _NUMBER.match(text.strip())
        if "," in text or number is None:
            raise BadInput(
                f"{text.strip()!r} is no value; write the values of single repetitions like '184, 183.2, 186 mm', with "
                "decimal points and with commas and blanks between them."
            )
        own = text.strip()[number.end() :].strip() or unit
        values.append(_si(f"{number[0]} {own}", dimension, whole=whole))
        digit = Decimal(1).scaleb(int(Decimal(number[0]).as_tuple().exponent))
        least = max(least, _si(f"{digit} {own}", dimension, whole=whole) / math.sqrt(12))
    return MeanOfRepetitions(float(f"{fmean(values):.12g}"), float(f"{max(stdev(values), least):.12g}"), len(values))


def _single_values(given: Any) -> list[str]:
    """The values of single repetitions in a text or a list of texts and numbers; empty where it is another one."""
    if isinstance(given, str):
        parts = re.split(r"[,;]\s+", given.strip())
    else:
        parts = [str(one) for one in given if isinstance(one, (str, int, float)) and not isinstance(one, bool)]
        if len(parts) < len(given):
            return []
    plain = not any(_PLUS_MINUS.search(part) or _REPETITIONS.search(part) for part in parts)
    return parts if plain and (len(parts) > 1 or not isinstance(given, str)) else []


def _quantity(name: str, entry: Any, of_rig: RigQuantity) -> Quantity:
    table = entry if isinstance(entry, dict) else {"value": entry}
    for key in table:
        if key not in ("value", "method", *of_rig.which):
            raise BadInput(f"unknown key {key!r}; {suggestion(key, ('value', 'method', *of_rig.which))}.")
    text = table.get("value")
    values = _single_values(text) if isinstance(text, (str, list)) else []
    if not values and not isinstance(text, str):
        missing = "has no value" if text is None else f"{text!r} has no uncertainty"
        raise BadInput(f"{missing}; {_written(of_rig.dimension)}")
    method = table.get("method", of_rig.methods[0])
    if method not in of_rig.methods:
        raise BadInput(f"there is no method {method!r}; {suggestion(str(method), of_rig.methods)}.")
    mean = _mean_of_values(values, of_rig.dimension) if values else mean_of_repetitions(str(text), of_rig.dimension)
    factor = math.degrees(1) if of_rig.unit == "deg" else 1.0
    value, std = (float(f"{number * factor:.12g}") for number in mean[:2])
    if value > of_rig.highest or value < 0 or (value == 0 and not of_rig.zero):
        unit = "" if of_rig.unit == "1" else f" {of_rig.unit}"
        most = "" if math.isinf(of_rig.highest) else f" and at most {of_rig.highest:g}{unit}"
        raise BadInput(f"{text!r} is out of range; it must be {'at least' if of_rig.zero else 'above'} 0{most}.")
    uncertainty = std / math.sqrt(mean.n)
    return Quantity(
        name,
        value,
        uncertainty,
        of_rig.unit,
        method,
        mean.n,
        dict(_details(table, of_rig)),
        {"repetition" if mean.n > 1 else "as stated": uncertainty},
        stated=True,
    )


def _details(table: dict[str, Any], of_rig: RigQuantity) -> Iterator[tuple[str, Detail]]:
    for name, usual in of_rig.which.items():
        value = table.get(name, usual)
        if name in _WORDS and value not in _WORDS[name]:
            raise BadInput(f"{name} = {value!r} is not known; {suggestion(str(value), _WORDS[name])}.")
        if name not in _WORDS and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
            raise BadInput(f"{name} = {value!r} is not a whole number of at least 1.")
        yield name, value


def _si(text: str, dimension: str, *, whole: str) -> float:
    try:
        return si(text.strip(), dimension)
    except BadQuantity as error:
        what = str(error).removeprefix(f"value: {text.strip()!r} ").partition("; write")[0]
        raise BadInput(f"{whole!r} {what}; {_written(dimension)}") from None


def _written(dimension: str) -> str:
    """How a value is written.

    >>> print(_written("length"))
    write mean, standard deviation and number of repetitions like '6.2 +- 0.31 mm (n = 10)', a single value and its \
standard uncertainty like '6.2 +- 0.31 mm', or the values of repetitions like '6.2, 6.5 mm'.
    """
    number, _, unit = DIMENSIONS[dimension][1].partition(" ")
    example = f"{number} +- {float(number) / 20:.2g} {unit}".strip()
    several = f"{number}, {float(number) * 1.05:.2g} {unit}".strip()
    return (
        f"write mean, standard deviation and number of repetitions like '{example} (n = 10)', a single value and its "
        f"standard uncertainty like {example!r}, or the values of repetitions like {several!r}."
    )
