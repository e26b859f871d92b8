"""What the last `rigtwin compare` found, as far as it stands in the lab's folder of results."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from rigtwin.lab.formatting import percent, reading, siblings, title
from rigtwin.lab.input_files import LARGEST_TABLE, lies_outside

SHOWN = (".html", ".csv", ".json", ".toml", ".svg", ".png", ".webp", ".mp4")
"""Endings of the result files that are linked or shown."""


def result_files(out: Path) -> list[str]:
    """Names of the reports and tables of earlier commands, reports first."""
    if not out.is_dir():
        return []
    found = [file for file in out.iterdir() if file.is_file() and file.suffix in SHOWN and not lies_outside(file, out)]
    return [file.name for file in sorted(found, key=lambda each: (each.suffix != ".html", each.name))]


def comparison(lab: Path) -> dict[str, Any]:
    """Measured beside simulated, by experiment.

    Parameters
    ----------
    lab : Path
        The lab.toml, beside whose folder ``out`` the results lie.

    Returns
    -------
    dict
        ``rows`` by name of the experiment, and whether lab.toml has been changed since; empty if nothing was compared.
    """
    file = lab.parent / "out" / "deviations.json"
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):  # none, or not of ours
        state = file.stat()
        if state.st_size > LARGEST_TABLE or lies_outside(file, file.parent):
            return {}
        found = json.loads(file.read_text(encoding="utf-8"))["deviations"]
        rows: dict[str, list[dict[str, str]]] = {}
        for name, row in map(_row, found):
            rows.setdefault(name, []).append(row)
        return {"rows": rows, "changed_since": lab.stat().st_mtime_ns > state.st_mtime_ns}
    return {}


def _row(row: dict[str, Any]) -> tuple[str, dict[str, str]]:
    which = siblings({name: row[name] for name in ("bounce", "collision", "body", "side")})
    return str(row["experiment"]), {
        "title": title(row["quantity"]) + (which and f", {which}"),
        "method": str(row["method"]),
        "measured": reading(row["measured"], row["measured_std_uncertainty"], row["unit"]),
        "simulated": reading(row["simulated"], row["simulated_std_uncertainty"], row["unit"]),
        "deviation": percent(row["percent_deviation"], row["percent_deviation_std"]),
        "verdict": str(row["verdict"]),
    }
