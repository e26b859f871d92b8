"""Quantities with units at the edges, SI floats inside.

Files and options write ``"6.2 mm"``, ``"240 Hz"``, ``"568kg/m^3"``; `si` turns them into floats in SI.  A bare
number is already SI, but where it would be taken for another unit.  pint is loaded on the first call, so a command's
``--help`` does not pay for it.
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING

from rigtwin.lab.errors import BadInput, BadQuantity

if TYPE_CHECKING:
    import pint

# what rigtwin calls a dimension -> (its SI unit, an example for the error message)
DIMENSIONS = {
    "length": ("m", "6.2 mm"),
    "time": ("s", "0.35 s"),
    "mass": ("kg", "0.69 g"),
    "density": ("kg/m^3", "568 kg/m^3"),
    "pressure": ("Pa", "11 GPa"),
    "frequency": ("1/s", "240 Hz"),
    "rate": ("1/s", "400/s"),
    "angle": ("rad", "45 deg"),
    "angular_speed": ("rad/s", "3 rpm"),
    "tilting_speed": ("rad/s", "2 deg/s"),
    "speed": ("m/s", "0.5 m/s"),
    "mass_flow": ("kg/s", "78 g/s"),
    "acceleration": ("m/s^2", "9.81 m/s^2"),
    "scale": ("m/px", "0.2 mm/px"),
    "volume": ("m^3", "0.2 cm^3"),
    "area": ("m^2", "4 mm^2"),
    "number": ("1", "0.42"),
}


LONGEST = 10.0  # [m], no rig on a bench is larger: "300" was meant to be millimetres
LARGEST_BEAD = 0.5  # [m], the same of the diameter of a bead or particle

AMBIGUOUS = {  # a bare number of these is nobody's habit
    "angular_speed": "radians a second or turns a minute",
    "tilting_speed": "radians or degrees a second",
}

LONGEST_QUANTITY = 200  # characters; of a damaged file or a wrong paste
MOST_PARTICLES = 10_000_000  # more of them fit into no memory; a count that was meant to be smaller

MOST_RUNS = 10_000  # of one twin with different seeds; a number that was meant to be smaller

_ANGULAR = re.compile("radian|degree|turn|revolution|arcminute|arcsecond|grade")


def si(text: str | float | int, dimension: str, *, name: str = "value") -> float:
    """Return a quantity as a float in SI.

    Parameters
    ----------
    text : str, float or int
        A number with a unit.  A bare number is taken as SI, but for a speed of turning, which a person writes in turns
        a minute or in degrees a second.
    dimension : str
        One of `DIMENSIONS`.
    name : str
        What errors name.

    Returns
    -------
    float
        The value in SI.

    Raises
    ------
    BadQuantity
        If the text is no quantity, is not finite, or has another dimension.

    Examples
    --------
    >>> si("6.2 mm", "length")
    0.0062
    >>> round(si("3 rpm", "angular_speed"), 6)
    0.314159
    >>> si(0.5, "length")
    0.5
    """
    unit, example = DIMENSIONS[dimension]
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise BadQuantity(f"{name}: {text!r} is not a quantity; write {_a(dimension)} like {example!r}.")
    if isinstance(text, str) and len(text) > LONGEST_QUANTITY:
        begin = f"{text[:20]!r}... with {len(text)} characters"
        raise BadQuantity(f"{name}: {begin} is not a quantity; write {_a(dimension)} like {example!r}.")
    try:
        value = (
            _parse(text.strip(), unit, dimension, example, name)
            if isinstance(text, str)
            else _bare(text, dimension, name)
        )
    except OverflowError:  # a whole number of more than 308 digits
        value = math.inf
    if not math.isfinite(value):
        raise BadQuantity(f"{name}: {text!r} is not a finite number; write {_a(dimension)} like {example!r}.")
    return value


def positive(**values: float | None) -> None:
    """Refuse values that are not finite, positive numbers.

    Parameters
    ----------
    **values : float or None
        Values by name; None is not given.

    Raises
    ------
    BadInput
        If one is not; the message names the first.
    """
    for name, value in values.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            raise BadInput(f"{name} must be a positive number, got {value:g}.")


def _parse(text: str, unit: str, dimension: str, example: str, name: str) -> float:
    number = re.match(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", text)
    if number is None or not (unit_text := text[number.end() :].strip()):
        try:
            return _bare(float(text), dimension, name)  # "inf" and "nan" included
        except ValueError:
            raise BadQuantity(f"{name}: {text!r} is not {_a(dimension)}; write it like {example!r}.") from None
    if "," in unit_text:  # pint reads over it: 6,1 mm would be 6 mm
        wrong = f"is not {_a(dimension)} (a number has a decimal point and no comma)"
        raise BadQuantity(f"{name}: {text!r} {wrong}; write it like {example!r}.")
    if dimension == "frequency" and unit_text == "fps":  # feet per second elsewhere
        unit_text = "1/s"
    if unit_text.startswith("/"):  # 400/s
        unit_text = f"1{unit_text}"
    import pint

    try:
        units = registry()
        written = units.Unit(unit_text.replace("%", "percent").replace("°", "deg"))
        value = units.Quantity(float(number[0]), written).to(unit if unit != "1" else "dimensionless").magnitude
        # pint counts radians as plain numbers: 3 Hz would pass as 3 rad/s, 5 deg as 0.087
        if bool(_ANGULAR.search(str(written))) != bool(_ANGULAR.search(str(units.Unit(unit)))):
            wrong = f"has the wrong unit for {_a(dimension)}"
        else:
            return float(f"{float(value):.15g}")  # 6.2 mm is 0.0062 m, not 0.006200000000000001
    except pint.DimensionalityError:
        wrong = f"has the wrong unit for {_a(dimension)}"
    except Exception:  # pint raises its own, tokenizer and attribute errors for garbage text
        wrong = f"is not {_a(dimension)} (unknown unit {unit_text!r})"
    raise BadQuantity(f"{name}: {text!r} {wrong}; write it like {example!r}.")


def _bare(number: float, dimension: str, name: str) -> float:
    """A number without a unit, in SI."""
    if dimension in AMBIGUOUS and math.isfinite(number):
        example = DIMENSIONS[dimension][1]
        may_be = f"{number:g} may be {AMBIGUOUS[dimension]}"
        raise BadQuantity(f"{name}: {may_be}; write it with its unit, like {example!r}.")
    return float(number)


def _a(dimension: str) -> str:
    return f"{'an' if dimension[0] in 'aeiou' else 'a'} {dimension.replace('_', ' ')}"


@cache
def registry() -> pint.UnitRegistry[float]:
    """Return pint's units, with ``px`` as the pixel of a picture; made once."""
    import pint

    units: pint.UnitRegistry[float] = pint.UnitRegistry(on_redefinition="ignore")
    units.define("px = pixel")  # pint's own px is the CSS pixel, 1/96 inch
    units.define("@alias hertz = hz")
    return units
