"""Result of a measurement: a number, its standard uncertainty, its method, and the checks it passed.

`Quantity` is one number with its standard uncertainty; `Check` one self-check; `Measurement` everything one
repetition gave.  All three print as the JSON documents that `rigtwin measure --json` writes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from operator import is_
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.lab.errors import BadInput, Mark, reword
from rigtwin.lab.formatting import reading
from rigtwin.lab.records import Profile, Series, Track

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Detail = str | int | float | bool

MOST_IN_REPR = 12  # quantities, as many as a person reads at a glance


@dataclass(frozen=True)
class Quantity:
    """One measured or simulated number with its standard uncertainty.

    >>> e = Quantity("restitution_wall", 0.443, 0.006, "1", method="height", detail={"bounce": 1})
    >>> low, high = e.interval95
    >>> round(low, 3), round(high, 3)
    (0.431, 0.455)
    """

    quantity: str
    """Name as in the table of quantities: ``restitution_wall``, ``angle_of_repose_graphical``, ..."""
    value: float
    """In `unit`."""
    std_uncertainty: float
    """One standard uncertainty, in `unit`."""
    unit: str
    """``"1"``, ``"m"``, ``"deg"``, ``"s"``, ``"m/s"``, ..."""
    method: str
    """How the number was got: ``"height"``, ``"velocity"``, ``"apex"``, ..."""
    n: int = 1
    """Number of repetitions behind the value."""
    detail: dict[str, Detail] = field(default_factory=dict)
    """What distinguishes it from others of the same name: ``bounce=1``, ``side="left"``, ``body="B"``."""
    budget: dict[str, float] = field(default_factory=dict)
    """Named parts of the standard uncertainty, in `unit`; their root sum of squares is `std_uncertainty`."""
    doubtful: str = ""
    """Why this number should not be trusted as it stands; empty when nothing speaks against it."""
    stated: bool = False
    """Whether lab.toml states it, as the mean of `n` repetitions, instead of media."""

    @property
    def interval95(self) -> tuple[float, float]:
        """95 % interval (normal, k = 1.96), in `unit`."""
        half = 1.959964 * self.std_uncertainty
        return self.value - half, self.value + half

    def to_json(self) -> dict[str, Any]:
        """The flat document of `rigtwin measure --json`; details stand beside the value."""
        document: dict[str, Any] = {
            "quantity": self.quantity,
            "value": _finite(self.value),
            "std_uncertainty": _finite(self.std_uncertainty),
            "unit": self.unit,
            "method": self.method,
            **{name: _plain(value) for name, value in self.detail.items()},
        }
        if self.n != 1:
            document["n"] = self.n
        if self.budget:
            document["budget"] = {part: _finite(value) for part, value in self.budget.items()}
        if self.doubtful:
            document["doubtful"] = self.doubtful
        if self.stated:
            document["stated"] = "in lab.toml"
        return document


def root_sum_of_squares(budget: dict[str, float]) -> float:
    """Return the standard uncertainty from its independent named parts.

    Parameters
    ----------
    budget : dict of str to float
        The parts, in one unit.

    Returns
    -------
    float
        In the same unit.

    Examples
    --------
    >>> root_sum_of_squares({"tracking": 3.0, "scale": 4.0})
    5.0
    """
    return math.hypot(*budget.values())


def doubted(quantity: Quantity, why: str) -> Quantity:
    """Return the quantity marked doubtful, with a wider uncertainty: a fit does not know the effect of a failed check.

    Parameters
    ----------
    quantity : Quantity
        Quantity to be marked.
    why : str
        The reason; empty: nothing changes.

    Returns
    -------
    Quantity
        With twice its standard uncertainty as a further part of its budget.

    Examples
    --------
    >>> e = Quantity("restitution_wall", 0.44, 0.01, "1", "height", budget={"tracking": 0.01})
    >>> e = doubted(e, "two beads fall")
    >>> e.doubtful, round(e.std_uncertainty, 4)
    ('two beads fall', 0.0224)
    """
    if not why:
        return quantity
    known = quantity.budget or {"as found": quantity.std_uncertainty}
    budget = {"failed check": 2 * quantity.std_uncertainty, **known}
    reasons = in_a_row([quantity.doubtful, why])
    return replace(quantity, std_uncertainty=root_sum_of_squares(budget), budget=budget, doubtful=reasons)


def in_a_row(reasons: Iterable[str]) -> str:
    """Join reasons why a number is doubtful, each once; the full stops of messages are removed.

    Parameters
    ----------
    reasons : iterable of str
        The reasons; empty ones are left out.

    Returns
    -------
    str
        The reasons, separated by semicolons.

    Examples
    --------
    >>> in_a_row(["it leans.", "", "it is dark", "it leans."])
    'it leans; it is dark'
    """
    return "; ".join(dict.fromkeys(filter(None, reasons))).replace(".; ", "; ").removesuffix(".")


@dataclass(frozen=True)
class Check:
    """One self-check of a measurement: what was expected, what was found, what a mismatch means."""

    check: str
    passed: bool
    value: float
    expected: float
    message: str

    def to_json(self) -> dict[str, Any]:
        """The check as JSON data."""
        return {
            "check": self.check,
            "passed": bool(self.passed),
            "value": _finite(self.value),
            "expected": _finite(self.expected),
            "message": self.message,
        }


def failed(checks: Iterable[Check], among: Collection[str] | None = None) -> str:
    """Return what failed checks say against a number.

    Parameters
    ----------
    checks : iterable of Check
        Checks of the number, passed or failed.
    among : collection of str, optional
        Names of those that the number rests on.  Default: all.

    Returns
    -------
    str
        Their messages; empty where they passed.

    Examples
    --------
    >>> shaken = Check("static_camera", False, 5.0, 0.0, "the camera shook")
    >>> failed([shaken], {"static_camera", "gravity"}), failed([shaken], {"gravity"})
    ('the camera shook', '')
    """
    messages = (each for each in checks if not each.passed and (among is None or each.check in among))
    return in_a_row(check.message for check in messages)


@dataclass(frozen=True)
class CheckLine:
    """One self-check over all repetitions."""

    name: str
    passed: int
    of: int
    message: str
    """Of a repetition in which it failed, if there is one."""

    @property
    def verdict(self) -> str:
        """In how many repetitions it passed, in words."""
        if self.passed == self.of:
            return "passed" if self.of == 1 else f"passed in all {self.of}"
        return "failed" if self.passed == 0 else f"failed in {self.of - self.passed} of {self.of}"


def check_lines(repetitions: Iterable[Iterable[Check]]) -> list[CheckLine]:
    """Return each check of several repetitions once.

    Parameters
    ----------
    repetitions : iterable of iterable of Check
        The checks of each repetition.

    Returns
    -------
    list of CheckLine
        In the order of first appearance.

    Examples
    --------
    >>> leaning, upright = (Check("camera_roll", passed, 0.0, 0.0, "it leans") for passed in (False, True))
    >>> [line.verdict for line in check_lines([[leaning], [upright]])]
    ['failed in 1 of 2']
    """
    checks = [check for one in repetitions for check in one]
    lines = []
    for name in dict.fromkeys(check.check for check in checks):
        mine = [check for check in checks if check.check == name]
        worst = next((check for check in mine if not check.passed), mine[0])
        lines.append(CheckLine(name.replace("_", " "), sum(each.passed for each in mine), len(mine), worst.message))
    return lines


class Readable:
    """Access to quantities by name, shared by measurements and twins."""

    rig: str
    quantities: tuple[Quantity, ...]

    def __repr__(self) -> str:
        """What it is of, its first numbers, and what speaks against them: records have millions of characters."""
        first = self.quantities[:MOST_IN_REPR]
        lines = [f"{_label(one)} = {reading(one.value, one.std_uncertainty, one.unit)}" for one in first]
        lines = [f"{line}{', doubtful' if one.doubtful else ''}" for line, one in zip(lines, first, strict=True)]
        if more := len(self.quantities) - len(first):
            lines.append(f"{more} more: to_frame()")
        lines += dict.fromkeys(f"doubtful: {one.doubtful}" for one in self.quantities if one.doubtful)
        return "\n  ".join([f"<{type(self).__name__} of {self._subject}", *lines]) + ">"

    @property
    def _subject(self) -> str:
        """What it is of, in a few words."""
        return f"a {self.rig}"

    @property
    def _left_out(self) -> str:
        """Why some quantities are not there, as the end of a sentence."""
        return ""

    def quantity(self, name: str, method: str | None = None, **detail: Detail) -> Quantity:
        """Return the one quantity of that name.

        Parameters
        ----------
        name : str
            Name of the quantity, ``"restitution_wall"`` for example.
        method : str, optional
            How it was obtained, ``"velocity"`` for example; needed where several methods give it.
        **detail : str, int, float or bool
            What else distinguishes it: ``bounce=1``, ``side="left"``.

        Returns
        -------
        Quantity
            Value, standard uncertainty, unit, budget and the reason where it is doubtful.

        Raises
        ------
        rigtwin.lab.errors.BadInput
            If none, or more than one, is meant; the message lists what there is.

        Examples
        --------
        >>> m = Measurement("drop", Path("r01.mp4"), "", (Quantity("drop_height", 0.25, 0.001, "m", "fit"),))
        >>> m.quantity("drop_height").std_uncertainty
        0.001
        """
        found = [
            each
            for each in self.quantities
            if each.quantity == name
            and method in (None, each.method)
            and all(each.detail.get(key) == value for key, value in detail.items())
        ]
        if len(found) == 1:
            return found[0]
        named = [each for each in self.quantities if each.quantity == name]
        if found:
            what = "is meant by several quantities"
        elif named:
            what = _unfitting(named, detail if method is None else {"method": method, **detail})
        else:
            what = f"is not among the quantities{self._left_out}"
        there = "; ".join(dict.fromkeys(_label(each) for each in found or named or self.quantities)) or "nothing"
        raise BadInput(f"{name}: {what}; there are {there}.")

    def value(self, name: str, method: str | None = None, **detail: Detail) -> float:
        """Return the value of one quantity.

        Parameters
        ----------
        name, method : str
            As for `quantity`.
        **detail : str, int, float or bool
            As for `quantity`.

        Returns
        -------
        float
            The value, in the unit of the quantity.

        Raises
        ------
        rigtwin.lab.errors.BadInput
            As `quantity` raises it.

        Examples
        --------
        >>> m = Measurement("drop", Path("r01.mp4"), "", (Quantity("drop_height", 0.25, 0.001, "m", "fit"),))
        >>> m.value("drop_height")
        0.25
        """
        return self.quantity(name, method, **detail).value

    def to_frame(self) -> pd.DataFrame:
        """Return the quantities as a table.

        Returns
        -------
        pandas.DataFrame
            One row for each quantity: ``quantity``, ``method``, its details (``bounce``, ``side``, ...), ``value``,
            ``std_uncertainty``, ``unit``, ``n``, ``doubtful``.
        """
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "quantity": each.quantity,
                    "method": each.method,
                    **each.detail,
                    "value": each.value,
                    "std_uncertainty": each.std_uncertainty,
                    "unit": each.unit,
                    "n": each.n,
                    "doubtful": each.doubtful,
                }
                for each in self.quantities
            ]
        )


def _unfitting(named: Sequence[Quantity], wanted: Mapping[str, Detail]) -> str:
    """Which of the wanted details none of the quantities of a name has, and what they have instead."""
    faults = []
    for key, value in wanted.items():
        details = ({"method": each.method, **each.detail} for each in named)
        there = dict.fromkeys(each[key] for each in details if key in each)
        if not there:
            faults.append(f"none has a {key}")
        elif value not in there:
            faults.append(f"none has {key}={value!r}, but {' or '.join(map(repr, there))}")
    if not faults:
        faults = [f"none has {' and '.join(f'{key}={value!r}' for key, value in wanted.items())}"]
    return "; ".join(faults)


def _label(quantity: Quantity) -> str:
    """`name (method, bounce=1)`."""
    said = [quantity.method]
    said += [f"{name}={value}" for name, value in quantity.detail.items() if not isinstance(value, float)]
    return f"{quantity.quantity} ({', '.join(said)})"


@dataclass(frozen=True)
class Evaluation:
    """What an estimator says of one record, filmed or simulated: the part of a measurement that knows no camera."""

    quantities: tuple[Quantity, ...]
    checks: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Measurement(Readable):
    """Everything one repetition gave: quantities, checks, warnings, the record behind them, pictures to trust it by."""

    rig: str
    source: Path
    source_sha256: str
    quantities: tuple[Quantity, ...]
    checks: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()
    camera: dict[str, Any] = field(default_factory=dict)
    """``frame_rate_hz``, ``scale_m_per_px``, ``scale_from``, ``camera_roll_deg`` ...: what was used, found or given."""
    tracks: tuple[Track, ...] = ()
    profiles: tuple[Profile, ...] = ()
    series: tuple[Series, ...] = ()
    table: dict[str, Any] = field(default_factory=dict)
    """How a table of tracked data was understood: kind, columns, units, direction of y; empty for a film or photo."""
    files: dict[str, Path] = field(default_factory=dict)
    """Files written: ``overlay`` (annotated video or picture), ``still`` (one picture), ``plot``, ``record``."""
    marks: tuple[Mark, ...] = ()
    """Where in the picture the results were found, for the page of `rigtwin review`; frames as counted in the file."""
    frame_times: tuple[float, ...] = ()
    """Capture time of each picture in the file [s], by the clock of `tracks`; only of a film with `tracks`."""

    @property
    def _subject(self) -> str:
        return f"{super()._subject}, {self.source.name}"

    @property
    def _left_out(self) -> str:
        without = "scale_m_per_px" in self.camera and self.camera["scale_m_per_px"] is None
        lengths = any(each.unit == "m" for each in self.quantities)
        return ", which have no lengths as no scale is known" if without and not lengths else ""

    def to_json(self) -> dict[str, Any]:
        """The document of `rigtwin measure --json`."""
        return {
            "rig": self.rig,
            "source": {"file": str(self.source), "sha256": self.source_sha256},
            "camera": {name: _plain(value) for name, value in self.camera.items()},
            **({"table": self.table} if self.table else {}),
            "quantities": [quantity.to_json() for quantity in self.quantities],
            "checks": [check.to_json() for check in self.checks],
            "warnings": list(self.warnings),
            "files": {name: str(path) for name, path in self.files.items()},
        }

    def plot(self) -> Figure:
        """Return a figure of the measured records: tracks and series over time, profiles over their base.

        Returns
        -------
        matplotlib.figure.Figure
            Not shown; in a notebook it displays itself.
        """
        from rigtwin.lab.record_figure import record_figure

        return record_figure(self.tracks, self.profiles, self.series)


def reworded(found: Any, change: Callable[[str], str] = reword) -> Any:
    """Return a result with all its texts in other words.

    Parameters
    ----------
    found : Measurement, Twin, Comparison, ...
        The result: a dataclass, tuple, list or dict, within each other at will.
    change : callable
        Returns a text in other words; one that names no option comes back equal.

    Returns
    -------
    Measurement, Twin, Comparison, ...
        The same with other words; what has no changed text within is not copied.

    Examples
    --------
    >>> reworded(Evaluation((), warnings=("check --base",)), lambda text: text.replace("--", "")).warnings
    ('check base',)
    """
    if isinstance(found, str):
        new = change(found)
        return found if new == found else new
    if type(found) in (tuple, list):
        parts = [reworded(one, change) for one in found]
        return found if all(map(is_, parts, found)) else type(found)(parts)
    if type(found) is dict:
        parts = reworded(values := list(found.values()), change)
        return found if parts is values else dict(zip(found, parts, strict=True))
    if is_dataclass(found) and not isinstance(found, type):
        names = [each.name for each in fields(found) if each.init]
        parts = reworded(values := [getattr(found, name) for name in names], change)
        return found if parts is values else replace(found, **dict(zip(names, parts, strict=True)))
    return found


def _finite(value: float) -> float | None:
    """JSON knows no NaN and no infinity."""
    return float(value) if math.isfinite(value) else None


def _plain(value: Any) -> Any:
    """A NumPy number as Python's own, which JSON knows."""
    value = value.item() if isinstance(value, np.generic) else value
    return _finite(value) if isinstance(value, float) else value
