"""Read tracks, profiles and series from tables of other programs, in SI units, with what was understood.

A record written by `rigtwin.lab.records` is read by the same functions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Profile, Series, Track
from rigtwin.lab.tracked.bodies import joined, proposals
from rigtwin.lab.tracked.columns import (
    Column,
    body_and_axis,
    column_at,
    factor,
    find_column,
    found_columns,
    name_and_unit,
    role_of,
)
from rigtwin.lab.tracked.project_files import read_parquet, read_xml
from rigtwin.lab.tracked.table import Table, TableOptions
from rigtwin.lab.tracked.text_table import read_text_table
from rigtwin.lab.units import LONGEST

Direction = Callable[[Sequence[Track]], tuple[bool, str] | None]

STEEPEST_TANGENT = 2.8575  # of 70.7 degrees: larger values of a slope without unit are no tangents but degrees

LARGEST = 1e30  # of a number in any unit, far above any length or time; squares and cubes of much larger ones overflow

SAME_RATE = 0.005  # relative difference up to which a given frame rate and the table's times agree

# with what is not known, such as "its scale is"
NOT_STATED = "the table does not say how well {} known: that is not part of the uncertainties."


@dataclass(frozen=True)
class Understood:
    """How a table was read, for the user to check."""

    kind: str
    columns: Mapping[str, str]  # role to the column's name and unit
    points: int
    bodies: tuple[str, ...] = ()
    frame_rate: float = math.nan  # [1/s]
    direction: str = ""  # of y
    notes: tuple[str, ...] = ()  # what the file does not state and how it was taken
    proposals: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the part ``table`` of the JSON document."""
        return {
            "kind": self.kind,
            "columns": dict(self.columns),
            "points": self.points,
            "bodies": list(self.bodies),
            "frame_rate_hz": self.frame_rate if math.isfinite(self.frame_rate) else None,
            "direction_of_y": self.direction,
            "notes": list(self.notes),
            "in_words": self.in_words(),
        }

    def in_words(self) -> str:
        """Return the same as one line."""
        parts = [
            self.kind,
            ", ".join(f"{role} = {name}" for role, name in self.columns.items()),
            f"{self.points} points" + (f" of {len(self.bodies)} bodies" if len(self.bodies) > 1 else ""),
            f"{self.frame_rate:.5g} frames/s" if math.isfinite(self.frame_rate) else "",
            self.direction,
            *self.notes,
        ]
        return "; ".join(filter(None, parts))


@dataclass(frozen=True)
class TrackedBodies:
    """Tracks of a table and how they were understood."""

    tracks: tuple[Track, ...]
    unit: str  # "m"; "px" or "" (not stated) where no scale is known, positions are in it then
    scaled: bool  # whether the given scale was used
    understood: Understood

    def in_metres(self, path: Path) -> tuple[Track, ...]:
        """Return the tracks.

        Parameters
        ----------
        path : Path
            The file, for the message.

        Returns
        -------
        tuple of Track
            In metres.

        Raises
        ------
        BadInput
            If no scale is known.
        """
        if self.unit != "m":
            raise BadInput(
                f"{path}: x and y are in {self.unit or 'a unit that is not stated'}; give a scale or metres."
            )
        return self.tracks


@dataclass(frozen=True)
class TrackedProfiles:
    """Profiles of a table, one for each time, and how they were understood."""

    profiles: tuple[Profile, ...]
    times: Array  # [s], shape (n,); zero for a table without times
    scaled: bool  # whether the given scale was used
    understood: Understood


@dataclass(frozen=True)
class TrackedSeries:
    """A value over time and how the table was understood."""

    series: Series
    role: str
    understood: Understood


def scale_used(read: TrackedBodies | TrackedProfiles, camera: Camera) -> dict[str, Any]:
    """Return the camera's scale as a measurement states it.

    Parameters
    ----------
    read : TrackedBodies or TrackedProfiles
        What was read.
    camera : Camera
        Camera whose scale is stated.

    Returns
    -------
    dict of str to object
        ``scale_m_per_px`` and ``scale_from``; empty where lengths of the table were not scaled by it.
    """
    return {"scale_m_per_px": camera.given_scale, "scale_from": camera.scale_from} if read.scaled else {}


def read_table(path: Path) -> Table:
    """Read a file of any kind that is known as a table.

    Parameters
    ----------
    path : Path
        Path of the table.

    Returns
    -------
    Table
        The table.

    Raises
    ------
    BadInput
        If it is none.
    """
    suffix = path.suffix.lower()
    if suffix in (".trk", ".xml"):
        return read_xml(path)
    return read_parquet(path) if suffix == ".parquet" else read_text_table(path)


# ------------------------------------------------------------------------------------------------------------ tracks


def read_tracks(path: Path, options: TableOptions | None = None) -> tuple[Track, ...]:
    """Read the tracks of a table whose lengths are known.

    Parameters
    ----------
    path : Path
        Table with columns of time, x and y, and optionally their standard deviation and the body.
    options : TableOptions, optional
        What the user states of the table.

    Returns
    -------
    tuple of Track
        One for each body, positions [m] as they stand in the file.  Rows without x or y are left out and counted in
        `Track.unseen`; an unknown sigma is NaN.

    Raises
    ------
    BadInput
        If a column is missing, a cell is no number, time does not rise, or lengths are in pixels.
    """
    return read_bodies(path, options).in_metres(path)


def read_bodies(
    path: Path,
    options: TableOptions | None = None,
    *,
    scale: float | None = None,
    frame_rate: float | None = None,
    direction: Direction | None = None,
    only_height: bool = False,
) -> TrackedBodies:
    """Read the tracks of all bodies of a table.

    Parameters
    ----------
    path : Path
        The table.
    options : TableOptions, optional
        Columns and joined tracks as the user states them.
    scale : float, optional
        Length of a pixel [m/px], for tables in pixels.
    frame_rate : float, optional
        Frame rate [1/s]; needed where the table has frames and no time, and used before its times.
    direction : callable, optional
        Finds from the tracks whether y counts upwards; y is turned over if not.
    only_height : bool
        Whether a column of x may be missing; x is 0 then.

    Returns
    -------
    TrackedBodies
        Tracks with y upwards, in metres where the scale is known.

    Raises
    ------
    BadInput
        If a column is missing, a cell is no number, or time does not rise.
    """
    options = options or TableOptions()
    table = read_table(path)
    notes = [*table.notes]
    sources, shown = _bodies(table, options, only_height)
    tracks, length = list[Track](), ""
    for body, rows, columns in sources:
        track, length = _track(table, body, rows, columns, frame_rate, notes)
        if track is None:
            notes.append(f"{body!r} has no row with both x and y and is left out")
        else:
            tracks.append(track)
        shown |= {role: _shown(column) for role, column in columns.items() if role not in shown}
    if not tracks:
        raise BadInput(f"{path}: no row holds both x and y as numbers; {found_columns(table)}.")
    tracks = list(joined(tracks, options.joined, str(path)))
    size, unit, by_scale = _length(table, length, tracks, scale, notes)
    up, words = _up(table, tracks, direction)
    turn = np.array([size, size if up else -size])
    scaled = tuple(replace(each, position=each.position * turn, sigma=each.sigma * size) for each in tracks)
    understood = Understood(
        table.kind,
        shown,
        sum(len(track.time) for track in scaled),
        tuple(track.body for track in scaled),
        _rate([track.time for track in scaled]),
        words,
        tuple(dict.fromkeys(notes)),
        proposals(scaled) if len(scaled) > 1 else (),
    )
    return TrackedBodies(scaled, unit, by_scale, understood)


Source = tuple[str, list[int], dict[str, Column]]


def _bodies(table: Table, options: TableOptions, only_height: bool) -> tuple[list[Source], dict[str, str]]:
    """Name, rows and columns of every body, and what distinguishes them."""
    stated = options.columns
    shared = {role: find_column(table, role, stated) for role in ("t", "frame", "sigma", "id")}
    common = {role: column for role, column in shared.items() if column is not None}
    body = common.pop("id", None)
    everything = list(range(len(table.rows)))
    if side_by_side := [] if "y" in stated else _side_by_side(table, common, only_height):
        return [(name, everything, columns) for name, columns in side_by_side], {}
    axes = {role: find_column(table, role, stated) for role in ("x", "y")}
    for role in ("x", "y"):
        if axes[role] is None and not (role == "x" and only_height):
            raise BadInput(
                f"{table.path}: no column for {role} was recognised; {found_columns(table)}; "
                f"name it with --columns '{role}=NAME'."
            )
    columns = common | {role: column for role, column in axes.items() if column is not None}
    if body is not None:
        names = [row[body.index].removesuffix(".0") for row in table.rows]
        order = dict.fromkeys(name for name in names if name)
        rows = {name: [k for k, each in enumerate(names) if each == name] for name in order}
        return [(name, rows[name], columns) for name in order], {"body": _shown(body)}
    if len(set(table.blocks)) > 1 and "t" in columns and _restarts(table, columns["t"]):
        blocks = dict.fromkeys(table.blocks)
        return [
            (str(number), [k for k in everything if table.blocks[k] == block], columns)
            for number, block in enumerate(blocks, start=1)
        ], {"body": "blocks of rows"}
    return [(table.titles[columns["y"].index] or "bead", everything, columns)], {}


def _restarts(table: Table, time: Column) -> bool:
    starts = [k for k in range(1, len(table.rows)) if table.blocks[k] != table.blocks[k - 1]]
    cells = [_float(row[time.index]) for row in table.rows]
    return any(cells[k] <= cells[k - 1] for k in starts)


def _side_by_side(table: Table, common: Mapping[str, Column], only_height: bool) -> list[tuple[str, dict[str, Column]]]:
    """Bodies with columns of their own: ``X1 Y1 X2 Y2``, or ``x y`` below several titles."""
    found: dict[str, dict[str, Column]] = {}
    several = sum(role_of(name, ["y"])[0] == "y" for name in table.names) > 1
    for k, name in enumerate(table.names):
        if pair := body_and_axis(name):
            body, role = pair
        elif several and table.titles[k] and (role := role_of(name, ["t", "x", "y"])[0]):
            body = table.titles[k]
        else:
            continue
        found.setdefault(body, {})[role] = column_at(table, k)
    needed = {"y"} if only_height else {"x", "y"}
    plain = "y" in {role_of(name, ["y"])[0] for name, title in zip(table.names, table.titles, strict=True) if not title}
    return [] if plain else [(body, {**common, **own}) for body, own in found.items() if needed <= set(own)]


def _track(
    table: Table,
    body: str,
    rows: Sequence[int],
    columns: Mapping[str, Column],
    frame_rate: float | None,
    notes: list[str],
) -> tuple[Track | None, str]:
    """The track of one body, lengths in the unit that is returned; None if it is never seen."""
    y = _numbers(table, columns["y"], rows, gaps=True)
    x = _numbers(table, columns["x"], rows, gaps=True) if "x" in columns else np.zeros(len(rows))
    if "x" not in columns:
        notes.append("no column for x, which is taken as 0")
    units = [columns[role].unit for role in ("x", "y") if role in columns]
    unit = next(filter(None, units), "")
    other = next((each for each in units if each and each != unit), "")
    if other:
        x = x * factor(table, columns["x"], "length") / factor(table, columns["y"], "length")
        unit = columns["y"].unit
    sigma = _numbers(table, columns["sigma"], rows, gaps=True) if "sigma" in columns else np.full(len(rows), np.nan)
    time = _times(table, rows, columns, frame_rate, notes)
    seen = np.isfinite(x) & np.isfinite(y)
    if not np.any(seen):
        return None, unit
    alone = body == "bead" or table.titles[columns["y"].index] == body
    where = f"{table.path}: track {body!r}" if not alone else f"{table.path}"
    kept = np.flatnonzero(seen)
    if np.any(np.diff(time[kept]) <= 0) and not alone:
        kept = kept[np.argsort(time[kept], kind="stable")]
    if np.any(np.diff(time[kept]) <= 0):
        raise BadInput(
            f"{where}: time does not rise from row to row; sort the rows, or name each body in a column 'particle'."
        )
    gaps = np.flatnonzero(~seen)
    wide = len(rows) == len(table.rows) and body_and_axis(columns["y"].name) is not None
    unseen = int(np.sum((gaps > kept[0]) & (gaps < kept[-1]))) if wide else len(gaps)
    position = np.column_stack([x, y])[kept]
    return Track(time[kept], position, sigma[kept], body, unseen), unit


def _times(
    table: Table, rows: Sequence[int], columns: Mapping[str, Column], frame_rate: float | None, notes: list[str]
) -> Array:
    """Time of every row [s]."""
    times, frames = columns.get("t"), columns.get("frame")
    if times is not None and (times.unit == "frame" or (not times.unit and frames is None and _counts(table, times))):
        times, frames = None, times
    if frame_rate is not None and frames is not None:
        return _numbers(table, frames, rows) / frame_rate
    if times is None and frames is None:
        if frame_rate is None:
            raise BadInput(
                f"{table.path}: no column for time or frame was recognised; {found_columns(table)}; name it with "
                "--columns 't=NAME[s]', or give --frame-rate if each row is one frame."
            )
        notes.append("each row is taken as one frame")
        return np.arange(len(rows)) / frame_rate
    if times is None:
        assert frames is not None
        raise BadInput(
            f"{table.path}: {frames.name!r} counts frames and there is no column for time; give --frame-rate."
        )
    milliseconds = not times.unit and table.kind == "Kinovea table"
    if not times.unit:
        notes.append(f"no unit of time is stated, {'milliseconds' if milliseconds else 'seconds'} are taken")
    unit = 1e-3 if milliseconds else 1.0 if not times.unit else factor(table, times, "time")
    time = _numbers(table, times, rows) * unit
    if frame_rate is not None and len(time) > 2:
        found = _rate([time])
        if abs(found / frame_rate - 1) > SAME_RATE:
            notes.append(f"times are stretched from {found:.5g} to the {frame_rate:.5g} frames/s that are given")
            return time * found / frame_rate
    return time


def _counts(table: Table, column: Column) -> bool:
    """Whether a column without unit counts frames: whole numbers that mostly go up by one."""
    values = np.array([_float(row[column.index]) for row in table.rows])
    values = values[np.isfinite(values)]
    whole = len(values) > 2 and bool(np.all(values == np.round(values)))
    return whole and float(np.median(np.abs(np.diff(np.unique(values))))) == 1


def _length(
    table: Table, unit: str, tracks: Sequence[Track], scale: float | None, notes: list[str]
) -> tuple[float, str, bool]:
    """What lengths are multiplied by, their unit then ("m", "px" or "" for not stated), and whether it is `scale`."""
    if not unit:
        widest = max(float(np.max(np.ptp(track.position, axis=0))) for track in tracks)
        if scale is not None or table.default_length == "px":
            unit = "px"
        elif widest <= LONGEST:
            unit = "m"
        notes.append(
            f"no unit of length is stated, {unit or 'none'} is taken" if unit else "no unit of length is stated"
        )
    if unit == "px":
        return (scale, "m", True) if scale is not None else (1.0, "px", False)
    if scale is not None:
        notes.append(f"the scale is not used, as lengths are in {unit}")
    return (factor(table, Column(0, "x, y", unit), "length"), "m", False) if unit else (1.0, "", False)


def _up(table: Table, tracks: Sequence[Track], direction: Direction | None) -> tuple[bool, str]:
    """Whether y counts upwards, in words."""
    if direction is None:
        return True, ""
    found = direction(tracks)
    if found is None:
        return table.up is not False, "y is taken to count upwards" if table.up is not False else "y counts downwards"
    up, why = found
    return up, f"y counts upwards ({why})" if up else f"y counts downwards and was turned over ({why})"


# ---------------------------------------------------------------------------------------------------------- profiles


def read_profiles(
    path: Path,
    options: TableOptions | None = None,
    *,
    scale: float | None = None,
    frame_rate: float | None = None,
    heap: bool = False,
) -> TrackedProfiles:
    """Read the profiles of a surface, one or one for each time.

    Parameters
    ----------
    path : Path
        Table with columns of x and height (or y), and optionally sigma, time or frame.
    options : TableOptions, optional
        Columns as the user states them.
    scale : float, optional
        Length of a pixel [m/px], for tables in pixels.
    frame_rate : float, optional
        Frame rate [1/s], for tables with frames and no time.
    heap : bool
        Whether the surface is a heap, which shows whether heights count upwards: its middle is above its ends.

    Returns
    -------
    TrackedProfiles
        Profiles sorted by x, heights [m] upwards.

    Raises
    ------
    BadInput
        If a column is missing, a cell is no number, or lengths are in pixels and no scale is given.
    """
    options = options or TableOptions()
    table = read_table(path)
    notes = [*table.notes]
    stated = options.columns
    x, height = find_column(table, "x", stated), find_column(table, "height", stated)
    if height is None and "y" in stated:
        height = find_column(table, "y", stated)
    for role, column in (("x", x), ("height", height)):
        if column is None:
            raise BadInput(
                f"{path}: no column for {role} was recognised; {found_columns(table)}; "
                f"name it with --columns '{role}=NAME'."
            )
    assert x is not None
    assert height is not None
    columns = {"x": x, "height": height}
    columns |= {role: found for role in ("t", "frame", "sigma") if (found := find_column(table, role, stated))}
    rows = range(len(table.rows))
    places, heights = _numbers(table, x, rows), _numbers(table, height, rows, gaps=True)
    sigmas = _numbers(table, columns["sigma"], rows, gaps=True) if "sigma" in columns else np.full(len(rows), np.nan)
    over_time = "t" in columns or "frame" in columns
    time = _times(table, rows, columns, frame_rate, notes) if over_time else np.zeros(len(rows))
    seen = Track(time, np.column_stack([places, heights]), sigmas)
    unit = x.unit or height.unit
    size, unit, by_scale = _length(table, unit, [_finite(seen)], scale, notes)
    if unit != "m":
        raise BadInput(f"{path}: x and {height.name} are in {unit or 'a unit that is not stated'}; give --scale.")
    words = ""
    # a column that is named a height counts upwards, and may be the crater of an emptied container
    if heap and role_of(height.name, ["height"])[2] > 0 and not _heaped(places, heights):
        words = "y counts downwards and was turned over (the middle of a heap is above its ends)"
        heights = np.nanmax(heights) - heights
    profiles, times = [], np.unique(time)
    for moment in times:
        own = np.flatnonzero(time == moment)
        own = own[np.argsort(places[own], kind="stable")]
        profiles.append(Profile(size * places[own], size * heights[own], size * sigmas[own]))
    understood = Understood(
        table.kind,
        {role: _shown(column) for role, column in columns.items()},
        len(rows),
        frame_rate=_rate([times]),
        direction=words,
        notes=tuple(dict.fromkeys(notes)),
    )
    return TrackedProfiles(tuple(profiles), times, by_scale, understood)


def _finite(track: Track) -> Track:
    seen = np.isfinite(track.position).all(axis=1)
    return replace(track, position=track.position[seen] if np.any(seen) else np.zeros((1, 2)))


def _heaped(x: Array, height: Array) -> bool:
    """Whether the middle third of a surface is above its outer thirds."""
    seen = np.isfinite(height)
    if np.sum(seen) < 9:
        return True
    low, high = np.quantile(x[seen], [1 / 3, 2 / 3])
    middle = (x[seen] > low) & (x[seen] < high)
    return bool(np.mean(height[seen][middle]) >= np.mean(height[seen][~middle])) if np.any(middle) else True


# ------------------------------------------------------------------------------------------------------------ series


def read_series(
    path: Path, roles: Sequence[str], options: TableOptions | None = None, *, frame_rate: float | None = None
) -> TrackedSeries | None:
    """Read one value over time: the first of `roles` that a column has.

    Parameters
    ----------
    path : Path
        Table with a column of time or frame, and one of the value.
    roles : sequence of {"angle", "left", "collected", "flow"}
        What the value may be, in the order of preference: an angle, what is left in a hopper, what has left it, or
        the flow out of it.
    options : TableOptions, optional
        Columns as the user states them.
    frame_rate : float, optional
        Frame rate [1/s], for tables with frames and no time.

    Returns
    -------
    TrackedSeries or None
        Angles in rad, masses in kg, fractions and numbers in 1, flows in kg/s or 1/s; None if no column has
        one of the roles.

    Raises
    ------
    BadInput
        If there is no column of time, a cell is no number, or the unit is of another kind.
    """
    options = options or TableOptions()
    table = read_table(path)
    notes = [*table.notes]
    stated = options.columns
    role, value = next(((role, found) for role in roles if (found := find_column(table, role, stated))), ("", None))
    if value is None:
        return None
    columns = {role: value}
    columns |= {name: found for name in ("t", "frame") if (found := find_column(table, name, stated))}
    numbers = _numbers(table, value, range(len(table.rows)), gaps=True)
    size, unit = _value_unit(table, role, value, numbers, notes)
    kept = np.flatnonzero(np.isfinite(numbers))
    time = _times(table, [int(k) for k in kept], columns, frame_rate, notes)
    if len(kept) < 2:
        raise BadInput(f"{path}: {value.name!r} holds {len(kept)} numbers; a series needs at least two.")
    if np.any(np.diff(time) <= 0):
        raise BadInput(f"{path}: time does not rise from row to row of {value.name!r}; sort the rows.")
    numbers = np.arctan(numbers[kept]) if unit == "slope" else size * numbers[kept]
    name = re.sub(r"\W+", "_", name_and_unit(value.name)[0].lower()).strip("_") or role
    series = Series(time, numbers, name, "rad" if unit == "slope" else unit)
    shown = {each: _shown(column) for each, column in columns.items()}
    return TrackedSeries(
        series,
        role,
        Understood(table.kind, shown, len(kept), frame_rate=_rate([time]), notes=tuple(dict.fromkeys(notes))),
    )


def _value_unit(table: Table, role: str, column: Column, values: Array, notes: list[str]) -> tuple[float, str]:
    """What values are multiplied by, and their unit then; "slope" for a tangent."""
    unit = column.unit
    if role == "angle":
        if unit:
            return factor(table, column, "angle"), "rad"
        if "slope" in column.name.lower() and float(np.nanmax(np.abs(values))) < STEEPEST_TANGENT:
            notes.append("the slope is taken as a tangent, as no unit is stated")
            return 1.0, "slope"
        if float(np.nanmax(np.abs(values))) > math.pi / 2:
            notes.append("no unit of the angle is stated, degrees are taken")
            return math.radians(1.0), "rad"
        raise BadInput(
            f"{table.path}: the unit of the column {column.name!r} is not stated; name it with --columns "
            f"'angle={column.name}[deg]'."
        )
    if not unit:
        return 1.0, "1/s" if role == "flow" else "1"
    if role == "flow":
        for dimension_unit, result in (("kg/s", "kg/s"), ("1/s", "1/s")):
            if (size := _ratio(unit, dimension_unit)) is not None:
                return size, result
        raise BadInput(f"{table.path}: the column {column.name!r} is in {unit!r}, which is no unit of a flow.")
    if unit == "percent":
        return 0.01, "1"
    return factor(table, column, "mass"), "kg"


def _ratio(unit: str, of: str) -> float | None:
    """How many `of` a `unit` is; None if they are of different kinds."""
    import pint

    from rigtwin.lab.units import registry

    try:
        return float(registry().Quantity(1.0, unit.replace("beads", "1").replace("particles", "1")).to(of).magnitude)
    except (pint.PintError, AttributeError, ValueError):
        return None


# ------------------------------------------------------------------------------------------------------------- cells


def _shown(column: Column) -> str:
    named = (
        column.name
        if not column.unit
        else re.sub(r"[\s_/,]*[(\[]?" + re.escape(column.unit) + r"[)\]]?$", "", column.name)
    )
    return f"{named or column.name} [{column.unit}]" if column.unit else column.name


def _float(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _numbers(table: Table, column: Column, rows: Sequence[int], *, gaps: bool = False) -> Array:
    """A column as floats; with `gaps` an empty cell is NaN."""
    import pandas as pd

    cells = pd.Series([table.rows[k][column.index] for k in rows], dtype="str")
    numbers = np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
    empty = cells.str.lower().isin(["", "nan", "na", "-"]).to_numpy(dtype=bool)
    bad = np.flatnonzero(~(np.abs(numbers) < LARGEST) & ~(empty & gaps))
    if len(bad):
        cell = cells.iloc[int(bad[0])]
        what = "a finite number" if math.isinf(_float(cell)) or cell.lower() == "nan" else "a number"
        what = f"a number between -{LARGEST:g} and {LARGEST:g}" if np.isfinite(numbers[bad[0]]) else what
        raise BadInput(
            f"{table.path}: {column.name} holds {cell!r} in data row {rows[int(bad[0])] + 1}, which is not {what}."
        )
    return numbers


def _rate(times: Sequence[Array]) -> float:
    """Frame rate [1/s], NaN for a single time; the mean of all intervals, as times may be rounded or frames lost."""
    steps = np.concatenate([np.diff(each) for each in times])
    steps = steps[steps > 0]
    if not len(steps):
        return math.nan
    frames = np.maximum(np.round(steps / np.median(steps)), 1)
    return float(np.sum(frames) / np.sum(steps))
