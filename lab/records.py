"""Records: the raw result of one repetition, the same from a film and from a simulation.

`Track` (positions over time of one body), `Profile` (a surface), `Series` (one value over time).  Positions are
in metres in the rig's own axes: x to the right along the base, y up.  Each is written as plain CSV with the unit
in the column name, and read back the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """Path of one body's centre, in the rig's own axes (x along the base, y up)."""

    time: Array  # [s], shape (n,), true exposure times, rising
    position: Array  # [m], shape (n, 2), centre of the body
    sigma: Array  # [m], shape (n,), one standard deviation of each coordinate of the centre
    body: str = "bead"  # "bead"; "A" and "B" in the double pendulum


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
    """Write tracks as ``time_s,x_m,y_m,sigma_m,particle``, one row per body and time."""
    lines = ["time_s,x_m,y_m,sigma_m,particle"]
    for track in tracks:
        for t, (x, y), sigma in zip(track.time, track.position, track.sigma, strict=True):
            lines.append(f"{t:.9g},{x:.9g},{y:.9g},{sigma:.3g},{track.body}")
    _write(path, lines)


def write_profile(path: Path, profile: Profile) -> None:
    """Write a profile as ``x_m,height_m,sigma_m``."""
    lines = ["x_m,height_m,sigma_m"]
    for x, height, sigma in zip(profile.x, profile.height, profile.sigma, strict=True):
        lines.append(f"{x:.9g},{height:.9g},{sigma:.3g}")
    _write(path, lines)


def read_tracks(path: Path) -> tuple[Track, ...]:
    """Read ``time_s,x_m,y_m`` with optional columns ``sigma_m`` and ``particle`` (or ``body``).

    Raises `BadInput` when a column is missing, a cell is not a number, or time does not rise.
    Without ``sigma_m`` the sigma of every point is NaN: the estimator then takes it from its own residuals.
    """
    table = _read(path, needed=("time_s", "x_m", "y_m"))
    bodies = table.get("particle", table.get("body", np.full(len(table["time_s"]), "bead", dtype=object)))
    tracks = []
    for body in dict.fromkeys(bodies.tolist()):
        mine = bodies == body
        time = _numbers(table["time_s"][mine], path, "time_s")
        position = np.column_stack([_numbers(table[name][mine], path, name) for name in ("x_m", "y_m")])
        sigma = (
            _numbers(table["sigma_m"][mine], path, "sigma_m") if "sigma_m" in table else np.full(len(time), np.nan)
        )
        if len(time) > 1 and not np.all(np.diff(time) > 0):
            raise BadInput(
                f"{path}: time_s does not rise from row to row for particle {body!r}; "
                "sort the rows, or name each body in a column 'particle'."
            )
        tracks.append(Track(time=time, position=position, sigma=sigma, body=str(body)))
    return tuple(tracks)


def read_profile(path: Path) -> Profile:
    """Read ``x_m,height_m`` with an optional column ``sigma_m``.  Raises `BadInput` like `read_tracks`."""
    table = _read(path, needed=("x_m", "height_m"))
    x = _numbers(table["x_m"], path, "x_m")
    sigma = _numbers(table["sigma_m"], path, "sigma_m") if "sigma_m" in table else np.full(len(x), np.nan)
    order = np.argsort(x)
    return Profile(x=x[order], height=_numbers(table["height_m"], path, "height_m")[order], sigma=sigma[order])


def _write(path: Path, lines: list[str]) -> None:
    partial = path.with_name(path.name + ".part")
    partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
    partial.replace(path)


def _read(path: Path, needed: Sequence[str]) -> dict[str, npt.NDArray[np.object_]]:
    import csv

    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except FileNotFoundError:
        raise BadInput(f"{path}: no such file; check the path.") from None
    except (UnicodeDecodeError, csv.Error):
        raise BadInput(f"{path}: not a CSV text file; give a table with the columns {', '.join(needed)}.") from None
    if len(rows) < 2:
        raise BadInput(f"{path}: holds no rows; give a table with the columns {', '.join(needed)}.")
    header = [name.strip() for name in rows[0]]
    missing = [name for name in needed if name not in header]
    if missing:
        raise BadInput(
            f"{path}: the column {missing[0]} is missing (found: {', '.join(header)}); needed are {', '.join(needed)}."
        )
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise BadInput(f"{path}: row {number} has {len(row)} cells where the header has {len(header)}.")
    return {name: np.array([row[k].strip() for row in rows[1:]], dtype=object) for k, name in enumerate(header)}


def _numbers(cells: npt.NDArray[np.object_], path: Path, column: str) -> Array:
    try:
        return cells.astype(np.float64)
    except ValueError as error:
        raise BadInput(f"{path}: column {column} holds something that is not a number ({error}).") from None
