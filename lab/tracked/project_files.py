"""Tracker projects, TrackMate XML and Parquet files as tables."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import parse

from rigtwin.lab.errors import BadInput
from rigtwin.lab.input_files import LARGEST_TABLE, decoding, must_have_few_rows, opened
from rigtwin.lab.tracked.table import Table

Row = tuple[str, ...]


class _NoNumber(Exception):
    """An entry that should be a finite number is none."""


def _finite(text: str, name: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise _NoNumber(f"{name} is {text.strip()[:40]!r}, which is no number")
    return number


def _attribute(element: Element, name: str, default: float) -> float:
    return _finite(element.get(name, str(default)), f"{name} of {element.tag}")


def read_xml(path: Path) -> Table:
    """Read a Tracker project (``.trk``) or TrackMate's XML (exported tracks, or a project).

    Parameters
    ----------
    path : Path
        Path of the XML file.

    Returns
    -------
    Table
        The table.

    Raises
    ------
    BadInput
        If the file is neither, holds no tracked point, declares entities, or if a number in it is none.
    """
    try:
        with opened(path, advice="give tracked data", largest=LARGEST_TABLE) as file:
            root: Element = parse(file).getroot()
    except DefusedXmlException:
        raise BadInput(f"{path}: declares XML entities, which no tracking program writes; export it again.") from None
    except (ParseError, UnicodeError, LookupError, ValueError):  # LookupError: an unknown text encoding
        raise BadInput(f"{path}: not valid XML; give a Tracker project or TrackMate's tracks.") from None
    try:
        if root.tag == "Tracks":
            return _trackmate_tracks(path, root)
        if root.tag == "TrackMate":
            return _trackmate_project(path, root)
        if root.tag == "object" and any("PointMass" in each.get("class", "") for each in root.iter("object")):
            return _tracker(path, root)
    except _NoNumber as error:
        raise BadInput(f"{path}: {error.args[0]}; correct it in the file, or export it again.") from None
    raise BadInput(f"{path}: XML of another kind; read are Tracker projects with a point mass, and TrackMate's tracks.")


def read_parquet(path: Path) -> Table:
    """Read a Parquet file, as trackpy's tables are often kept.

    Parameters
    ----------
    path : Path
        Path of the Parquet file.

    Returns
    -------
    Table
        The table.

    Raises
    ------
    BadInput
        If it cannot be read.
    """
    import pandas as pd

    advice = "export it as CSV"
    with (
        opened(path, advice=advice, largest=LARGEST_TABLE) as file,
        decoding(path, "Parquet", advice, BadInput),
    ):
        from pyarrow import parquet

        about = parquet.ParquetFile(file).metadata
        must_have_few_rows(path, about.num_rows)
        unpacked = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
        if unpacked > LARGEST_TABLE:
            raise BadInput(
                f"{path}: has {unpacked / 1e6:.0f} MB, and at most {LARGEST_TABLE / 1e6:.0f} MB are read; "
                "keep only the columns and rows of the track."
            )
        file.seek(0)
        frame = pd.read_parquet(file)
    names = {str(name): name for name in frame.columns}
    rows = [tuple(_text(cell) for cell in row) for row in frame.itertuples(index=False, name=None)]
    kind, length = ("trackpy table", "px") if {"x", "y", "mass", "ecc", "frame"} <= set(names) else ("table", "")
    return _table(path, kind, tuple(names), rows, length=length)


def _text(cell: Any) -> str:
    if isinstance(cell, float):
        return "" if math.isnan(cell) else f"{cell:.15g}"
    return str(cell)


def _table(
    path: Path, kind: str, names: Sequence[str], rows: Sequence[Row], *, length: str = "", up: bool | None = None
) -> Table:
    if not rows:
        raise BadInput(f"{path}: holds no tracked point.")
    none = ("",) * len(names)
    return Table(path, kind, tuple(names), none, none, tuple(rows), (0,) * len(rows), length, up)


# ----------------------------------------------------------------------------------------------------------- Tracker


def _properties(element: Element) -> dict[str, Element]:
    return {each.get("name", ""): each for each in element.findall("property")}


def _number(properties: dict[str, Element], name: str, default: float) -> float:
    found = properties.get(name)
    return default if found is None or not found.text else _finite(found.text, name)


def _scale(view: dict[str, Element], name: str) -> float:
    scale = _number(view, name, 1.0)
    if scale == 0:
        raise _NoNumber(f"{name} is 0, which is no scale")
    return scale


def _frames(owner: Element) -> Iterator[tuple[int, dict[str, Element]]]:
    """Frame number and properties of every entry of an object's ``framedata``."""
    data = _properties(owner).get("framedata")
    for each in [] if data is None else data.findall("property"):
        inner = each.find("object")
        if inner is not None and (number := re.fullmatch(r"\[(\d+)\]", each.get("name", ""))):
            yield int(number[1]), _properties(inner)


def _tracker(path: Path, root: Element) -> Table:
    """Point masses of a Tracker project in the project's own axes; marks are stored as pixels of the picture."""
    of_class = {each.get("class", "").rpartition(".")[2]: each for each in root.iter("object")}
    clip, control, axes = (of_class.get(name) for name in ("VideoClip", "StepperClipControl", "ImageCoordSystem"))
    interval = 0.0 if control is None else _number(_properties(control), "delta_t", 0.0) / 1000
    start = 0.0 if clip is None else _number(_properties(clip), "starttime", 0.0) / 1000
    first = 0.0 if clip is None else _number(_properties(clip), "startframe", 0.0)
    views = dict([] if axes is None else _frames(axes))
    unit = _properties(root).get("length_unit")
    scaled = any("xscale" in view for view in views.values())
    length = "px" if not scaled else (unit.text or "m") if unit is not None else "m"
    rows: list[Row] = []
    for mass in (each for each in root.iter("object") if each.get("class", "").endswith(".PointMass")):
        name = _properties(mass).get("name")
        for frame, point in _frames(mass):
            view = views.get(max((each for each in views if each <= frame), default=-1), {})
            # the origin in pixels, y down; the angle of the x axis in degrees, anticlockwise
            x = (_number(point, "x", math.nan) - _number(view, "xorigin", 0.0)) / _scale(view, "xscale")
            y = (_number(view, "yorigin", 0.0) - _number(point, "y", math.nan)) / _scale(view, "yscale")
            angle = math.radians(_number(view, "angle", 0.0))
            along = x * math.cos(angle) + y * math.sin(angle)
            up = y * math.cos(angle) - x * math.sin(angle)
            time = f"{start + (frame - first) * interval:.9g}" if interval > 0 else ""
            rows.append((time, str(frame), f"{along:.9g}", f"{up:.9g}", (name.text or "") if name is not None else ""))
    columns = ("t [s]", "frame", f"x [{length}]", f"y [{length}]", "particle")
    if interval <= 0:
        return _table(path, "Tracker project", columns[1:], [row[1:] for row in rows], up=True)
    return _table(path, "Tracker project", columns, rows, up=True)


# --------------------------------------------------------------------------------------------------------- TrackMate


def _trackmate_tracks(path: Path, root: Element) -> Table:
    unit = root.get("spaceUnits", "pixel")
    interval, seconds = _attribute(root, "frameInterval", 0.0), root.get("timeUnits", "frame")
    rows = [
        (point.get("t", ""), point.get("x", ""), point.get("y", ""), str(number))
        for number, particle in enumerate(root.findall("particle"))
        for point in particle.findall("detection")
    ]
    return _timed(path, "TrackMate tracks", rows, interval, seconds, unit)


def _trackmate_project(path: Path, root: Element) -> Table:
    model = root.find("Model")
    if model is None:
        raise BadInput(f"{path}: this TrackMate project holds no model.")
    spots = {spot.get("ID", ""): spot for spot in model.iter("Spot")}
    image = next(root.iter("ImageData"), None)
    interval = 0.0 if image is None else _attribute(image, "timeinterval", 0.0)
    rows = []
    for track in model.iter("Track"):
        ends = {edge.get(end, "") for edge in track.iter("Edge") for end in ("SPOT_SOURCE_ID", "SPOT_TARGET_ID")}
        own = sorted((spots[each] for each in ends if each in spots), key=lambda spot: _attribute(spot, "FRAME", 0.0))
        name = track.get("TRACK_ID", track.get("name", ""))
        rows += [(s.get("FRAME", ""), s.get("POSITION_X", ""), s.get("POSITION_Y", ""), name) for s in own]
    units = model.get("timeunits", "frame"), model.get("spatialunits", "pixel")
    return _timed(path, "TrackMate project", rows, interval, *units)


def _timed(path: Path, kind: str, rows: Sequence[Row], interval: float, unit: str, length: str) -> Table:
    """A table of frames with times, where the file states a frame interval in a unit of time."""
    names = ("frame", f"x [{length}]", f"y [{length}]", "particle")
    if interval <= 0 or unit.lower() in ("frame", "frames", "pixel"):
        return _table(path, kind, names, rows)
    timed = [(f"{_finite(row[0], 'frame of a point') * interval:.9g}", *row) for row in rows]
    return _table(path, kind, (f"t [{unit}]", *names), timed)
