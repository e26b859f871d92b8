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

from rigtwin.lab.arrays import Array
from rigtwin.lab.output_files import replacing


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


@dataclass(frozen=True)
class WallLoad:
    """Force of the particles on a wall and its torque over time, means over the interval that ends at each time."""

    wall: str
    time: Array  # [s], shape (n,)
    force: Array  # [N], shape (n, 3)
    torque: Array  # [N m], shape (n, 3), about the wall's rotation point, which moves with it
    about_axis: Array | None = None  # [N m], shape (n,), of a wall that turns: that about its axis, right-handed


def write_load(path: Path, load: WallLoad) -> None:
    """Write a load as ``time_s,fx_N,fy_N,fz_N,torque_x_Nm,torque_y_Nm,torque_z_Nm`` and ``torque_axis_Nm``.

    Parameters
    ----------
    path : Path
        Path of the CSV file.
    load : WallLoad
        The load; only that of a wall that turns has a column ``torque_axis_Nm``.
    """
    header = ["time_s", *(f"f{axis}_N" for axis in "xyz"), *(f"torque_{axis}_Nm" for axis in "xyz")]
    columns = [load.time, *load.force.T, *load.torque.T]
    if load.about_axis is not None:
        header.append("torque_axis_Nm")
        columns.append(load.about_axis)
    _write(path, header, [[f"{value:.9g}" for value in row] for row in zip(*columns, strict=True)])


def write_tracks(path: Path, tracks: Sequence[Track]) -> None:
    """Write tracks as ``time_s,x_m,y_m,sigma_m,particle``, one row per body and time; 9 significant digits.

    Parameters
    ----------
    path : Path
        Path of the CSV file.
    tracks : sequence of Track
        Tracks, one for each body.
    """
    rows = [
        (f"{t:.9g}", f"{x:.9g}", f"{y:.9g}", f"{sigma:.3g}", track.body)
        for track in tracks
        for t, (x, y), sigma in zip(track.time, track.position, track.sigma, strict=True)
    ]
    _write(path, ("time_s", "x_m", "y_m", "sigma_m", "particle"), rows)


def write_profile(path: Path, profile: Profile) -> None:
    """Write a profile as ``x_m,height_m,sigma_m``; the base's edges and the view are not kept.

    Parameters
    ----------
    path : Path
        Path of the CSV file.
    profile : Profile
        Profile of a bed or heap.
    """
    points = zip(profile.x, profile.height, profile.sigma, strict=True)
    _write(path, ("x_m", "height_m", "sigma_m"), [(f"{x:.9g}", f"{h:.9g}", f"{sigma:.3g}") for x, h, sigma in points])


def write_profiles(path: Path, profiles: Sequence[Profile], times: Array) -> None:
    """Write a surface over time as ``time_s,x_m,height_m,sigma_m``, one row per time and place where it is seen.

    Parameters
    ----------
    path : Path
        Path of the CSV file.
    profiles : sequence of Profile
        The surface at each time.
    times : ndarray, shape (n,)
        The times [s].
    """
    rows = [
        (f"{time:.9g}", f"{x:.9g}", f"{height:.9g}", f"{sigma:.3g}")
        for time, profile in zip(times, profiles, strict=True)
        for x, height, sigma in zip(profile.x, profile.height, profile.sigma, strict=True)
        if math.isfinite(height)
    ]
    _write(path, ("time_s", "x_m", "height_m", "sigma_m"), rows)


def write_series(path: Path, series: Series) -> None:
    """Write a series as ``time_s`` and its quantity with the unit behind it, like ``mass_left_kg``.

    Parameters
    ----------
    path : Path
        Path of the CSV file.
    series : Series
        Series of one quantity.
    """
    named = series.quantity if series.unit == "1" else f"{series.quantity}_{series.unit}"
    pairs = zip(series.time, series.value, strict=True)
    _write(path, ("time_s", named), [(f"{time:.9g}", f"{value:.9g}") for time, value in pairs])


def _write(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
