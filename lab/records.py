"""Records: the raw result of one repetition, the same from a film and from a simulation.

`Track` (positions over time of one body), `Profile` (a surface), `Series` (one value over time).  Positions are
in metres in the rig's own axes: x to the right along the base, y up.  Tracks and profiles are written as plain CSV
with the unit in the column name.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput


@dataclass(frozen=True)
class Track:
    """Path of one body's centre, in the rig's own axes (x along the base, y up)."""

    time: Array  # [s], shape (n,), true exposure times, rising
    position: Array  # [m], shape (n, 2), centre of the body
    sigma: Array  # [m], shape (n,), one standard deviation of each coordinate of the centre
    body: str = "bead"  # "bead"; "A" and "B" in the double pendulum
    unseen: int = 0  # rows of its file in which the body was not seen


@dataclass(frozen=True)
class Profile:
    """Surface of a bed or pile seen from the side: height above the base plane against x."""

    x: Array  # [m], shape (n,), rising
    height: Array  # [m], shape (n,), above the base plane; NaN where the surface is not seen
    sigma: Array  # [m], shape (n,), one standard deviation of the height
    base: tuple[float, float] | None = None  # [m], x of the left and right edge of the base disc, where known
    view: str = "front"


@dataclass(frozen=True)
class Series:
    """One value over time."""

    time: Array  # [s], shape (n,)
    value: Array  # in `unit`, shape (n,)
    quantity: str
    unit: str


def write_tracks(path: Path, tracks: Sequence[Track]) -> None:
    """Write tracks as ``time_s,x_m,y_m,sigma_m,particle``, one row per body and time; 9 significant digits."""
    rows = [
        (f"{t:.9g}", f"{x:.9g}", f"{y:.9g}", f"{sigma:.3g}", track.body)
        for track in tracks
        for t, (x, y), sigma in zip(track.time, track.position, track.sigma, strict=True)
    ]
    _write(path, ("time_s", "x_m", "y_m", "sigma_m", "particle"), rows)


def write_profile(path: Path, profile: Profile) -> None:
    """Write a profile as ``x_m,height_m,sigma_m``; the base's edges and the view are not kept."""
    points = zip(profile.x, profile.height, profile.sigma, strict=True)
    _write(path, ("x_m", "height_m", "sigma_m"), [(f"{x:.9g}", f"{h:.9g}", f"{sigma:.3g}") for x, h, sigma in points])


def write_profiles(path: Path, profiles: Sequence[Profile], times: Array) -> None:
    """Write a surface over time as ``time_s,x_m,height_m,sigma_m``, one row per time and place where it is seen."""
    rows = [
        (f"{time:.9g}", f"{x:.9g}", f"{height:.9g}", f"{sigma:.3g}")
        for time, profile in zip(times, profiles, strict=True)
        for x, height, sigma in zip(profile.x, profile.height, profile.sigma, strict=True)
        if math.isfinite(height)
    ]
    _write(path, ("time_s", "x_m", "height_m", "sigma_m"), rows)


def write_series(path: Path, series: Series) -> None:
    """Write a series as ``time_s`` and its quantity with the unit behind it, like ``mass_left_kg``."""
    named = series.quantity if series.unit == "1" else f"{series.quantity}_{series.unit}"
    pairs = zip(series.time, series.value, strict=True)
    _write(path, ("time_s", named), [(f"{time:.9g}", f"{value:.9g}") for time, value in pairs])


def read_tracks(path: Path) -> tuple[Track, ...]:
    """Read ``time_s,x_m,y_m`` with optional columns ``sigma_m`` and ``particle`` (or ``body``).

    A row whose x or y is empty or ``nan`` is a moment in which the body was not seen, and is left out.
    Without ``sigma_m`` the sigma of every point is NaN: the estimator then takes it from its own residuals.
    Raises `BadInput` when a column is missing, a cell is not a number, or time does not rise.
    """
    table = _read(path, needed=("time_s", "x_m", "y_m"))
    rows = len(table["time_s"])
    bodies = table.get("particle", table.get("body", np.full(rows, "bead", dtype=object)))
    time = _numbers(table, "time_s", path)
    position = np.column_stack([_numbers(table, name, path, gaps=True) for name in ("x_m", "y_m")])
    sigma = _numbers(table, "sigma_m", path, gaps=True) if "sigma_m" in table else np.full(rows, np.nan)
    seen = np.isfinite(position).all(axis=1)
    tracks = []
    for body in dict.fromkeys(bodies.tolist()):
        own = bodies == body
        mine = own & seen
        if not mine.any():
            raise BadInput(f"{path}: particle {body!r} has no row with both x_m and y_m; leave it out.")
        if np.any(np.diff(time[mine]) <= 0):
            raise BadInput(
                f"{path}: time_s does not rise from row to row for particle {body!r}; "
                "sort the rows, or name each body in a column 'particle'."
            )
        gaps = int(np.sum(own & ~seen))
        tracks.append(Track(time=time[mine], position=position[mine], sigma=sigma[mine], body=str(body), unseen=gaps))
    return tuple(tracks)


def read_profile(path: Path) -> Profile:
    """Read ``x_m,height_m`` with an optional column ``sigma_m``; an empty height is a place not seen.

    Raises `BadInput` when a column is missing or a cell is not a number.
    """
    table = _read(path, needed=("x_m", "height_m"))
    x = _numbers(table, "x_m", path)
    height = _numbers(table, "height_m", path, gaps=True)
    sigma = _numbers(table, "sigma_m", path, gaps=True) if "sigma_m" in table else np.full(len(x), np.nan)
    order = np.argsort(x)
    return Profile(x=x[order], height=height[order], sigma=sigma[order])


def _write(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    partial = path.with_name(path.name + ".part")
    with partial.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
    partial.replace(path)


def _read(path: Path, needed: Sequence[str]) -> dict[str, npt.NDArray[np.object_]]:
    rows = _rows(path, needed)
    header = [name.strip() for name in rows[0][1]]
    missing = [name for name in needed if name not in header]
    if missing:
        hint = "; separate the columns by commas and write decimal points" if ";" in header[0] else ""
        raise BadInput(
            f"{path}: the column {missing[0]} is missing (found: {', '.join(header)}); "
            f"needed are {', '.join(needed)}{hint}."
        )
    if twice := next((name for name in header if header.count(name) > 1), ""):
        raise BadInput(f"{path}: the column {twice} stands there twice; leave one of them out.")
    for line, row in rows[1:]:
        if len(row) != len(header):
            raise BadInput(f"{path}, line {line}: {len(row)} cells where the header has {len(header)}.")
    return {name: np.array([row[k].strip() for _, row in rows[1:]], dtype=object) for k, name in enumerate(header)}


def _rows(path: Path, needed: Sequence[str]) -> list[tuple[int, list[str]]]:
    """Every row that is not empty, with its line."""
    columns = f"a table with the columns {', '.join(needed)}"
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            rows = [(reader.line_num, row) for row in reader if row]
    except OSError as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else (error.strerror or "unreadable").lower()
        raise BadInput(f"{path}: {reason}; give {columns}.") from None
    except (UnicodeDecodeError, csv.Error):
        raise BadInput(f"{path}: not a CSV text file; give {columns}.") from None
    if len(rows) < 2:
        raise BadInput(f"{path}: holds no rows; give {columns}.")
    return rows


def _numbers(table: dict[str, npt.NDArray[np.object_]], column: str, path: Path, *, gaps: bool = False) -> Array:
    """A column as floats; with `gaps` an empty cell is NaN."""
    cells = table[column]
    numbers = np.empty(len(cells))
    for row, cell in enumerate(cells):
        try:
            numbers[row] = np.nan if gaps and not cell else float(cell)
        except ValueError:
            raise BadInput(f"{path}: {column} holds {cell!r} in data row {row + 1}, which is not a number.") from None
        if np.isinf(numbers[row]) or (np.isnan(numbers[row]) and not gaps):
            raise BadInput(f"{path}: {column} holds {cell!r} in data row {row + 1}, which is not a finite number.")
    return numbers
