"""Quantities with units at the edges, SI floats inside.

Files and options write ``"6.2 mm"``, ``"240 Hz"``, ``"568kg/m^3"``; `si` turns them into floats in SI.  A bare
number is already SI.  pint is loaded on the first call, so a command's ``--help`` does not pay for it.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

from rigtwin.lab.errors import BadQuantity

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
    "angle": ("rad", "45 deg"),
    "angular_speed": ("rad/s", "3 rpm"),
    "speed": ("m/s", "0.5 m/s"),
    "acceleration": ("m/s^2", "9.81 m/s^2"),
    "scale": ("m/px", "0.2 mm/px"),
    "number": ("1", "0.42"),
}


def si(text: str | float | int, dimension: str, *, name: str = "value") -> float:
    """A quantity as a float in SI.

    `text` is a number with a unit; a bare number is taken as SI.  Raises `BadQuantity` naming `name` when the
    text is no quantity, is not finite, or has another dimension.

    >>> si("6.2 mm", "length")
    0.0062
    >>> si("3 rpm", "angular_speed") == 3 * 2 * math.pi / 60
    True
    >>> si(0.5, "length")
    0.5
    """
    unit, example = DIMENSIONS[dimension]
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise BadQuantity(f"{name}: {text!r} is not a quantity; write a {dimension} like {example!r}.")
    if isinstance(text, (int, float)):
        value = float(text)
    else:
        value = _parse(text.strip(), unit, dimension, example, name)
    if not math.isfinite(value):
        raise BadQuantity(f"{name}: {text!r} is not a finite number; write a {dimension} like {example!r}.")
    return value


def _parse(text: str, unit: str, dimension: str, example: str, name: str) -> float:
    try:
        return float(text)
    except ValueError:
        pass
    import pint

    try:
        # "Hz" is a frequency here, never 2 pi rad/s; a percent sign is 1/100
        parsed = _registry().Quantity(text.replace("%", " percent").replace("°", " deg"))
        value = parsed.to(unit if unit != "1" else "dimensionless").magnitude
        return float(f"{float(value):.15g}")  # 6.2 mm is 0.0062 m, not 0.006200000000000001
    except pint.DimensionalityError:
        wrong = f"has the wrong unit for a {dimension}"
    except (pint.UndefinedUnitError, pint.DefinitionSyntaxError):
        wrong = f"is not a {dimension} (unknown unit)"
    except Exception:  # pint raises tokenizer and attribute errors for garbage text
        wrong = f"is not a {dimension}"
    raise BadQuantity(f"{name}: {text!r} {wrong}; write it like {example!r}.")


@cache
def _registry() -> pint.UnitRegistry:
    import pint

    registry = pint.UnitRegistry()
    registry.define("px = [pixel]")
    return registry
