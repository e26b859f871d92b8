"""What the last `rigtwin compare` found, as far as it stands in the lab's folder of results."""

from __future__ import annotations

import itertools
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from rigtwin.compare.result_files import FIGURES, listed_figures
from rigtwin.lab.checksums import sha256
from rigtwin.lab.formatting import percent, reading, siblings, title
from rigtwin.lab.input_files import LARGEST_TABLE

SHOWN = (".html", ".csv", ".json", ".toml", ".svg", ".png", ".webp", ".mp4", ".md", ".bib")
"""Endings of the result files that are linked or shown."""

FOLDERS = {"out": "", "calibration": "calibration/"}
"""Folders of a lab into which commands write by default, and how the names of files in them begin."""

PAGES = {
    "report": "Comparison",
    "diagnosis": "Diagnosis, step by step",
    "calibration": "Calibration",
    "sweep": "Sweep",
    "reproduction": "Published tables",
}
"""Titles of the pages with figures, by the name that their lists of captions begin with."""


def result_file(folder: Path, name: str) -> Path:
    """A file of the lab's folders of results.  Raises `LookupError` for any other, also behind a link."""
    for place, prefix in FOLDERS.items():
        out = folder.resolve() / place
        file = (out / name.removeprefix(prefix)).resolve()
        if name.startswith(prefix) and file.is_relative_to(out) and file.suffix in SHOWN and file.is_file():
            return file
    raise LookupError(name)


def result_files(folder: Path) -> list[str]:
    """Names of the reports and tables that earlier commands wrote into the lab's folders of results, reports first."""
    found = []
    for place, prefix in FOLDERS.items():
        for file in (folder / place).glob("*"):
            with suppress(LookupError):
                found.append((result_file(folder, prefix + file.name).suffix != ".html", prefix + file.name))
    return [name for _, name in sorted(found)]


def figures(folder: Path) -> list[dict[str, Any]]:
    """The figures that earlier commands drew into the lab's folders of results and folders in these, in their order.

    Parameters
    ----------
    folder : Path
        The lab's folder.

    Returns
    -------
    list of dict
        For each page that has figures its ``title``, and ``pictures`` with ``file`` and ``caption``.
    """
    found = []
    for (page, title_of_page), (place, prefix) in itertools.product(PAGES.items(), FOLDERS.items()):
        out, listed = folder / place, f"{FIGURES}/{page}-captions.csv"
        for file in [*out.glob(listed), *sorted(out.glob(f"*/{listed}"))]:
            beside = f"{prefix}{file.relative_to(out).parent.as_posix()}"
            with suppress(LookupError):  # a link elsewhere, or a figure is gone
                captions = listed_figures(result_file(folder, f"{beside}/{file.name}"))
                pictures = [{"file": f"{beside}/{name}.svg", "caption": words} for name, words in captions.items()]
                for picture in pictures:
                    result_file(folder, picture["file"])
                if pictures:
                    found.append({"title": title_of_page, "pictures": pictures})
    return found


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
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):  # none, or not of ours
        file = result_file(lab.parent, "deviations.json")
        state = file.stat()
        if state.st_size > LARGEST_TABLE:
            return {}
        found = json.loads(file.read_text(encoding="utf-8"))["deviations"]
        rows: dict[str, list[dict[str, str]]] = {}
        for name, row in map(row_json, found):
            rows.setdefault(name, []).append(row)
        newer = lab.stat().st_mtime_ns > state.st_mtime_ns
        return {"rows": rows, "changed_since": newer and not _as_compared(lab)}
    return {}


def _as_compared(lab: Path) -> bool:
    """Whether lab.toml holds what was compared, as after a change that was taken back."""
    with suppress(OSError, ValueError, LookupError, TypeError):
        inputs = json.loads(result_file(lab.parent, "provenance.json").read_text(encoding="utf-8"))["inputs"]
        return any((one["file"], one["sha256"]) == (lab.name, sha256(lab)) for one in inputs)
    return False


def row_json(row: dict[str, Any]) -> tuple[str, dict[str, str]]:
    """A row of deviations.json as the page shows it, and the name of its experiment."""
    which = siblings({name: row[name] for name in ("bounce", "collision", "body", "side")})
    return str(row["experiment"]), {
        "title": title(row["quantity"]) + (which and f", {which}"),
        "method": str(row["method"]),
        "measured": reading(row["measured"], row["measured_std_uncertainty"], row["unit"]),
        "simulated": reading(row["simulated"], row["simulated_std_uncertainty"], row["unit"]),
        "deviation": percent(row["percent_deviation"], row["percent_deviation_std"]),
        "verdict": str(row["verdict"]),
    }
