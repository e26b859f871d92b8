"""An independent reading of accepted files: csv and float for tables, tomllib and pint for lab.toml and model.toml."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

HEADER = ["time_s", "x_m", "y_m"]
MEAN = re.compile(r"([\d.]+) \+- ([\d.]+) ?([a-z]*) \(n = (\d+)\)")
"""A stated mean, its standard deviation, its unit and the number of repetitions."""
SAME = 1e-9  # relative, of numbers that were converted

PARTICLE = {"diameter": "m", "density": "kg/m^3"}
MATERIAL = {"density": "kg/m^3", "youngs_modulus": "Pa", "poisson_ratio": ""}
CONTACT = {"restitution": "", "static_friction": "", "rolling_friction": ""}


def same_track(path: Path, document: dict[str, Any]) -> str:
    """What of an accepted table ``time_s,x_m,y_m`` was read as another number; "" for nothing."""
    from rigtwin.lab.tracked.read import read_tracks

    text = _text(path.read_bytes())
    ended = re.search(r"rows from line (\d+) on are another table", " ".join(document["table"]["notes"]))
    lines = text.splitlines()[: int(ended[1]) - 1 if ended else None]
    block, blocks, kept = 0, list[int](), list[str]()  # an empty line ends a block of rows
    for line in lines:
        block += not line.strip()
        if line.strip() and line.lstrip()[0] not in "#%":
            kept.append(line)
            blocks.append(block)
    rows = [[cell.strip() for cell in row] for row in csv.reader(kept)]
    if HEADER not in rows:  # columns of other names or units
        return ""
    expected, begun = dict[int, list[list[float]]](), rows.index(HEADER) + 1
    for row, number in zip(rows[begun:], blocks[begun:], strict=False):
        try:
            numbers = [math.nan if cell == "" else float(cell) for cell in row]
        except ValueError:
            return f"took a row that is no row of numbers: {row}"
        if len(numbers) != 3:
            return f"took a row of {len(numbers)} cells"
        if all(map(math.isfinite, numbers)):
            expected.setdefault(number, []).append(numbers)
    tracks = read_tracks(path)
    read = [[[time, *at] for time, at in zip(one.time.tolist(), one.position.tolist(), strict=True)] for one in tracks]
    bodies = list(expected.values()) if len(tracks) > 1 else [[row for block in expected.values() for row in block]]
    counts = [sorted(map(len, each)) for each in (read, bodies)]
    if counts[0] != counts[1] or document["table"]["points"] != sum(counts[1]):
        return f"read bodies of {counts[0]} points, and the file has {counts[1]}"
    # the longest body is read first
    pairs = [
        pair for one, other in zip(sorted(read), sorted(bodies), strict=True) for pair in zip(one, other, strict=True)
    ]
    different = [f"{one} for {other}" for one, other in pairs if not _same(one, other)]
    return f"read {different[0]}" if different else ""


def same_settings(path: Path, document: dict[str, Any]) -> str:
    """What of an accepted lab.toml with the particle ``bead`` was read as another number; "" for nothing."""
    stated = tomllib.loads(_text(path.read_bytes()))
    used = document["settings"]
    bead = stated.get("particles", {}).get("bead", {})
    own = stated.get("contacts", {})
    contact = own.get("bead-steel", own.get("steel-bead", {}))
    material = stated.get("materials", {}).get(bead.get("material", ""), {})
    pairs = [
        *((bead, used["particle"], name, unit) for name, unit in PARTICLE.items()),
        *((material, used["particle"]["material"], name, unit) for name, unit in MATERIAL.items()),
        *((contact, used["contacts"].get("bead-steel", {}), name, unit) for name, unit in CONTACT.items()),
    ]
    for there, here, name, unit in pairs:
        if (wrong := _differs(there.get(name), here.get(name), unit)) != "":
            return f"{name}: {wrong}"
    return ""


def same_results(path: Path, document: dict[str, Any]) -> str:
    """What of the stated results in an accepted lab.toml was read as another number; "" for nothing."""
    stated = tomllib.loads(_text(path.read_bytes()))["experiments"]
    for entry, experiment in zip(stated, document["experiments"], strict=True):
        for name, result in entry.get("measured", {}).items():
            given = result.get("value") if isinstance(result, dict) else result
            found = MEAN.fullmatch(given) if isinstance(given, str) else None
            read = [one for one in experiment["stated"] if one["quantity"] == name]
            if found is None or len(read) != 1:
                continue
            value, scatter, unit, count = found.groups()
            [one] = read
            deviation = one["std_uncertainty"] * math.sqrt(int(count))
            for text, used in ((value, one["value"]), (scatter, deviation)):
                if (wrong := _differs(f"{text} {unit}".strip(), used, one["unit"].replace("1", ""))) != "":
                    return f"{name}: {wrong}"
            if one.get("n", 1) != int(count):
                return f"{name}: n = {one.get('n', 1)} for {count}"
    return ""


def same_model(path: Path) -> str:
    """What of an accepted model.toml was read as another number; "" for nothing."""
    from rigtwin.lab.file.model_file import read_model

    stated, read = tomllib.loads(_text(path.read_bytes())), read_model(path)
    drag = stated.get("effects", {}).get("air_drag", {}).get("drag_coefficient")
    if (wrong := _differs(drag, read.effects.get("air_drag", {}).get("drag_coefficient"), "")) != "":
        return f"drag_coefficient: {wrong}"
    contact = next(iter(stated.get("contacts", {}).values()), {})
    known = next(iter(read.contacts.values()), None)
    for name, unit in CONTACT.items():
        if known is not None and (wrong := _differs(contact.get(name), getattr(known, name, None), unit)) != "":
            return f"{name}: {wrong}"
    return ""


def _differs(stated: Any, used: Any, unit: str) -> str:
    """How a number differs from what the file states, where that can be read."""
    if not isinstance(stated, int | float | str) or isinstance(stated, bool):
        return ""
    expected = _in_si(stated, unit)
    if expected is None or (used is not None and _same([float(used)], [expected])):
        return ""
    return f"{used} for {stated!r}"


def _in_si(stated: float | str, unit: str) -> float | None:
    if not isinstance(stated, str):
        return float(stated)
    try:
        return float(_registry().Quantity(stated).to(unit or "1").magnitude)
    except Exception:  # pint raises errors of every kind at texts that are no quantities
        return None


def _same(one: list[float], other: list[float]) -> bool:
    return all(math.isclose(a, b, rel_tol=SAME, abs_tol=1e-15) for a, b in zip(one, other, strict=True))


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252")


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()
