"""Measure a tilt from tables: the plate's angle and the body's track, in any axes and any unit."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Series, Track
from rigtwin.lab.tracked.read import NOT_STATED, TrackedSeries, read_bodies, read_series, scale_used
from rigtwin.lab.tracked.table import TableOptions
from rigtwin.measure.tilt.evaluate import NEARBY_LENGTH_UNCERTAINTY, NOMINAL, evaluate_run, onset_of, way_down
from rigtwin.measure.tilt.incline import Descent, at_rest, descent_of, evaluate_descent
from rigtwin.measure.tilt.onset import LEAST_TURN, Onset, Variant

SAME = 1.5  # ratio of residuals up to which an axis at the origin of the table explains the ride as well

RIDES = 3.0  # residual relative to that of the best shorter stretch, up to which the body still rides on the plate


def measure_table(
    path: Path,
    camera: Camera,
    options: TableOptions | None,
    *,
    variant: Variant,
    bead_diameter: float | None,
    angle: Path | None,
    out: Path | None,
) -> Measurement:
    """Measure a tilt from a table of the body's track, with the plate's angle in it or in a second table.

    Parameters
    ----------
    path : Path
        Table of the track.
    camera : Camera
        Scale and frame rate, as far as known.
    options : TableOptions or None
        Columns and joined tracks.
    variant : {"slide", "roll"}
        Kind of motion.
    bead_diameter : float or None
        Diameter of the bead [m].
    angle : Path or None
        Table of the plate's angle.
    out : Path or None
        Folder for the plot.

    Returns
    -------
    Measurement
        As of a film, without the checks of its picture.
    """
    plate = _angle(path, options, angle, camera.frame_rate)
    read = read_bodies(path, options, scale=camera.given_scale, frame_rate=camera.frame_rate)
    body = max(read.tracks, key=lambda each: len(each.time))
    known = read.unit == "m"
    turns = float(np.ptp(plate.series.value)) >= LEAST_TURN
    track, axes = in_the_rigs_axes(plate.series, body) if turns else along_the_path(plate.series, body)
    if not known:
        track = replace(track, position=NOMINAL * track.position, sigma=NOMINAL * track.sigma)
    uncertainty = NEARBY_LENGTH_UNCERTAINTY if known else math.inf
    way = way_down(plate.series, [track], variant, bead_diameter, uncertainty)
    view = scale_used(read, camera)
    result: Descent | Onset
    if at_rest(way):
        result = descent_of(way, str(path))
        evaluation = evaluate_descent(result, variant, uncertainty)
    else:
        run, result = onset_of(way, str(path))
        if not known:
            view = {"scale_m_per_px" if read.unit == "px" else "scale_m_per_unit": NOMINAL / result.gain}
            view |= {"scale_std_rel": result.gain_sigma / result.gain, "scale_from": "gravity"}
            track = replace(track, position=track.position / result.gain, sigma=track.sigma / result.gain)
            way = way_down(plate.series, [track], variant, bead_diameter, uncertainty)
            run, result = onset_of(way, str(path))
        evaluation = evaluate_run(way, run, result, variant, bead_diameter)
    understood = replace(
        read.understood,
        columns={**read.understood.columns, **plate.understood.columns},
        direction=axes,
        notes=(*read.understood.notes, *plate.understood.notes),
    )
    several = (
        (f"{path.name} holds {len(read.tracks)} bodies; evaluated {body.body!r}, the longest.",)
        if len(read.tracks) > 1
        else ()
    )
    files = {}
    if out is not None:
        from rigtwin.measure.tilt.figures import write_plot

        out.mkdir(parents=True, exist_ok=True)
        files["plot"] = out / f"{path.stem}-plot.svg"
        write_plot(files["plot"], way, result, evaluation.quantities)
    return Measurement(
        "tilt",
        path,
        sha256(path),
        evaluation.quantities,
        evaluation.checks,
        (*evaluation.warnings, NOT_STATED.format("the horizontal is"), *several, *read.understood.proposals),
        camera=view,
        tracks=(track,),
        series=(plate.series,),
        table=understood.to_json(),
        files=files,
    )


def _angle(path: Path, options: TableOptions | None, given: Path | None, frame_rate: float | None) -> TrackedSeries:
    """The plate's angle: from the table given for it, a column of the track's table, or the file beside it."""
    beside = path.with_name(path.name.replace("-track.", "-angle."))
    candidates = [given] if given is not None else [path, *([beside] if beside != path and beside.exists() else [])]
    for candidate in candidates:
        found = read_series(candidate, ["angle"], options if candidate == path else None, frame_rate=frame_rate)
        if found is not None:
            flat = float(np.median(found.series.value)) < 0
            series = replace(found.series, value=-found.series.value) if flat else found.series
            return replace(found, series=series)
    raise BadInput(
        f"{given or path}: no column for the plate's angle was recognised; name it with --columns 'angle=NAME[deg]', "
        "or give a table of the angle with --angle."
    )


def in_the_rigs_axes(angle: Series, track: Track) -> tuple[Track, str]:
    """The track with its origin on the plate's axis, x towards the rising side and y up.

    Parameters
    ----------
    angle : Series
        Angle of the plate [rad], positive, over time [s].
    track : Track
        The body in axes of any origin, in which x or y, or both, may count the other way.

    Returns
    -------
    track : Track
        In the rig's axes.
    words : str
        What was done to it.

    Raises
    ------
    NothingToMeasure
        If angle and body are known together at fewer than 8 times.

    Notes
    -----
    Until it slips the body rides on the plate: x = x0 + a cos(alpha) - b sin(alpha), y = y0 + a sin(alpha) +
    b cos(alpha).  The fit is linear in the axis (x0, y0) and the seat (a, b) of the body.  Which sense of rotation fits
    shows whether an axis is mirrored; the body sits on the rising side, a > 0.
    """
    alpha = np.interp(track.time, angle.time, angle.value, left=np.nan, right=np.nan)
    seen = np.isfinite(alpha)
    if np.sum(seen) < 8:
        raise NothingToMeasure(
            f"body and plate angle are known together at only {int(np.sum(seen))} times; give tables that overlap."
        )
    fits = [(*_ride(alpha[seen], track.position[seen] * [1, sign]), sign) for sign in (1.0, -1.0)]
    _, (x0, y0, a, _), sign = min(fits, key=lambda each: each[0])
    if abs(fits[0][0] - fits[1][0]) < 0.1 * max(fits[0][0], fits[1][0]):  # the plate hardly turns: as in the file
        _, (x0, y0, a, _), sign = fits[0]
    as_it_is, (_, _, along_plate, _) = _ride(alpha[seen], track.position[seen], centred=True)
    if along_plate > 0 and as_it_is < SAME * min(each[0] for each in fits):
        return track, "axes as in the table: its origin is on the plate's axis"
    half_turn = -1.0 if a < 0 else 1.0
    position = half_turn * (track.position * [1, sign] - [x0, y0])
    up, along = half_turn * sign > 0, half_turn > 0
    words = [
        "" if up else "y counts downwards and was turned over",
        "" if along else "x was turned over towards the rising side",
        "the origin was set on the plate's axis, found from the body's ride",
    ]
    return replace(track, position=position), ", ".join(filter(None, words))


def along_the_path(angle: Series, track: Track) -> tuple[Track, str]:
    """The track on a plate at rest, in the rig's axes, whichever way the axes of the table point.

    The direction of the body's own path is that of the plate, and it ends further down than it began.
    """
    away = track.position - track.position[0]
    _, _, directions = np.linalg.svd(away - away.mean(axis=0), full_matrices=False)
    down = away @ directions[0]
    across = away @ directions[1]
    down = down if down[-1] > down[0] else -down
    slope = float(np.median(angle.value))
    cos, sin = math.cos(slope), math.sin(slope)
    position = np.column_stack([-down * cos - across * sin, -down * sin + across * cos])
    return replace(track, position=position), "the plate stands still: its direction is that of the body's path"


def _ride(alpha: Array, position: Array, *, centred: bool = False) -> tuple[float, tuple[float, float, float, float]]:
    """Residual, axis and seat of a body that rides on the plate for as long as this fits; `centred`: axis at (0, 0)."""
    best: tuple[float, tuple[float, float, float, float]] | None = None
    for share in (0.3, 0.5, 0.7, 0.9):
        n = max(4, round(share * len(alpha)))
        cos, sin = np.cos(alpha[:n]), np.sin(alpha[:n])
        one, none = np.ones(n), np.zeros(n)
        matrix = np.vstack([np.column_stack([one, none, cos, -sin]), np.column_stack([none, one, sin, cos])])
        wanted = np.concatenate([position[:n, 0], position[:n, 1]])
        found = np.zeros(4)
        free = slice(2 if centred else 0, 4)
        found[free], *_ = np.linalg.lstsq(matrix[:, free], wanted, rcond=None)
        residual = float(np.sqrt(np.mean((matrix @ found - wanted) ** 2)))
        if best is not None and residual > RIDES * best[0]:
            break
        best = residual, (float(found[0]), float(found[1]), float(found[2]), float(found[3]))
    assert best is not None
    return best
