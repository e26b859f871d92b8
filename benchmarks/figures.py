"""Where the figures of a benchmark go: a table on stdout and `out/<target>.json`, the same rows in both.

With `SMOKE=1` in the environment every benchmark runs all its cases with few particles, frames or repetitions, only to
show that it runs.  Its figures then mean nothing: they go to `out/smoke/<target>.json` and fail nothing.
"""

from __future__ import annotations

import json
import math
import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

SMOKE = os.environ.get("SMOKE", "0") not in ("", "0")
OUT = Path(__file__).resolve().parent.parent / "out" / ("smoke" if SMOKE else "")

Setting = TypeVar("Setting")


def small(usual: Setting, smoke: Setting) -> Setting:
    """A setting of a benchmark, and what takes its place with `SMOKE=1`."""
    return smoke if SMOKE else usual


@dataclass(frozen=True)
class Row:
    """One figure.  `passed` is None where nothing is wanted of it."""

    name: str
    value: float
    unit: str = "1"
    reference: float | None = None
    wanted: str = ""
    passed: bool | None = None
    note: str = ""

    @property
    def deviation(self) -> float | None:
        """Relative to the reference; absolute where that is zero."""
        if self.reference is None:
            return None
        difference = self.value - self.reference
        return difference / abs(self.reference) if self.reference else difference


def against(
    name: str,
    value: float,
    reference: float,
    *,
    relative: float | None = None,
    absolute: float | None = None,
    unit: str = "1",
    note: str = "",
) -> Row:
    """A row that passes when the value lies within one tolerance of its reference."""
    if relative is not None:
        tolerance, wanted = relative * abs(reference), f"within {relative:.2%}"
    elif absolute is not None:
        tolerance, wanted = absolute, f"within {absolute:.2g}"
    else:
        return Row(name, value, unit, reference, note=note)
    return Row(name, value, unit, reference, wanted, bool(abs(value - reference) <= tolerance), note)


def below(name: str, value: float, limit: float, *, unit: str = "1", note: str = "") -> Row:
    """A row that passes when the value's size stays below a limit."""
    return Row(name, value, unit, None, f"below {limit:.2g}", bool(abs(value) < limit), note)


def coverage(name: str, hits: Sequence[bool], *, judged: bool = True, note: str = "numbers") -> Row:
    """Share of 95 % intervals that hold the truth; it passes from 0.90 to 0.99 where it is `judged`."""
    share = sum(hits) / len(hits) if hits else math.nan
    wanted, passed = ("0.90 to 0.99", bool(0.90 <= share <= 0.99)) if judged else ("", None)
    return Row(f"{name}: 95 % intervals", share, "1", 0.95, wanted, passed, f"{len(hits)} {note}")


def skipped(name: str, reason: str) -> Row:
    """A row whose figure cannot be had here."""
    return Row(name, math.nan, note=f"skipped: {reason}")


def machine() -> dict[str, object]:
    """What the figures were taken on."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    load = [round(x, 2) for x in os.getloadavg()] if hasattr(os, "getloadavg") else None
    return {
        "processor": _processor(),
        "architecture": platform.machine(),
        "cores": cores,
        "load_average": load,
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def report(target: str, rows: Sequence[Row], **more: object) -> int:
    """Print the rows, write `out/<target>.json`, and return the exit code: 1 when a wanted figure is missed.

    With `SMOKE=1` it is always 0.
    """
    passed = all(row.passed is not False for row in rows)
    document = {
        "target": target,
        "machine": machine(),
        **more,
        "rows": [asdict(row) | {"deviation": row.deviation} for row in rows],
        "passed": passed,
    }
    OUT.mkdir(parents=True, exist_ok=True)
    path = OUT / f"{target}.json"
    unfinished = path.with_suffix(".tmp")
    unfinished.write_text(json.dumps(document, indent=1) + "\n")
    unfinished.replace(path)
    _print(target, rows)
    missed = sum(row.passed is False for row in rows)
    judged = sum(row.passed is not None for row in rows)
    sys.stdout.write(f"{judged - missed} of {judged} wanted figures reached; written to {path}\n")
    return 0 if passed or SMOKE else 1


def _print(target: str, rows: Sequence[Row]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"{target}, {machine()['processor']}, load average {machine()['load_average']}")
    for column in ("figure", "ours", "reference", "deviation", "wanted", "passed", "note"):
        number = column in ("ours", "reference", "deviation")
        table.add_column(column, justify="right" if number else "left", no_wrap=column != "note")
    for row in rows:
        unit = "" if row.unit == "1" else f" {row.unit}"
        off = row.deviation
        deviation = "" if off is None else f"{off:+.2%}" if row.reference else f"{off:+.2g}"
        verdict = {True: "yes", False: "NO", None: ""}[row.passed]
        reference = "" if row.reference is None else f"{row.reference:.5g}{unit}"
        table.add_row(row.name, f"{row.value:.5g}{unit}", reference, deviation, row.wanted, verdict, row.note)
    width = None if sys.stdout.isatty() else 200
    Console(width=width).print(table)


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
