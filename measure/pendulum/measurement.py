"""Measure a double or wall pendulum: from a clip or a record to quantities (`measure`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import seeing
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement, Quantity, doubted, failed
from rigtwin.lab.records import Track, write_tracks
from rigtwin.lab.rigs import GRAVITY
from rigtwin.lab.tracked.read import NOT_STATED, read_bodies, scale_used
from rigtwin.lab.tracked.table import TableOptions, is_table
from rigtwin.lab.tracked.upright import by_swing
from rigtwin.measure.media.duplicate_frames import without_repeats
from rigtwin.measure.media.video import Video, open_video
from rigtwin.measure.pendulum.checks import (
    lens_check,
    pivot_checks,
    timing_check,
    view_checks,
)
from rigtwin.measure.pendulum.evaluate import SHADING, Variant, in_order, judge, outcomes_of
from rigtwin.measure.pendulum.figures import picture_marks, picture_view, write_overlay, write_plot, write_still
from rigtwin.measure.pendulum.observe import (
    GROUND,
    Film,
    camera_axis,
    fit_clip,
    observe_film,
    observe_wall_film,
    roll_warning,
    scale_of,
    tracks_seen,
    upright,
)
from rigtwin.measure.pendulum.swing_fit import SwingFit, onset
from rigtwin.measure.pendulum.swing_model import turning_points
from rigtwin.measure.refusal import shows_refusals

UNCONFIRMED = (
    "scale and frame rate not confirmed: the scale was taken from gravity; give --length or --scale for a check."
)


@shows_refusals
def measure(
    clip: Path,
    camera: Camera,
    *,
    variant: Variant = "double",
    length: float | None = None,
    bead_diameter: float | None = None,
    bead_mass: float | None = None,
    table: TableOptions | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure a clip of a pendulum, or evaluate a tracked record.

    Bead A swings from an angle into bead B at rest, or into a wall.

    Parameters
    ----------
    clip : Path
        Video or stack of images; or a table with the tracks of the beads (`rigtwin.lab.tracked`).
    camera : Camera
        Frame rate, scale, roll and search region, as far as known; of a table only frame rate and scale.
    variant : {"double", "wall"}
        Second bead or wall.
    length : float, optional
        Length from hinge to bead centre [m].
    bead_diameter : float, optional
        Diameter of the beads [m].
    bead_mass : float, optional
        Mass of a bead [kg].
    table : TableOptions, optional
        Columns and joined tracks of a table.
    out : Path, optional
        Folder for the annotated video, pictures, plot and track; None writes no files.
    progress : Progress, optional
        Called with stage, number of steps done and total number of steps.

    Returns
    -------
    Measurement
        Restitution [1], release and rebound angles [deg] as in `rigtwin.measure.pendulum.evaluate.evaluate`, with
        checks and tracks.

    Raises
    ------
    UnreadableMedia
        If the file is no video.
    NothingToMeasure
        If no released bead hits a hanging one (or a wall).

    Notes
    -----
    The scale is that of `camera` if given, else from `length`, else from `bead_diameter` (distance of the centres at
    the collision), else from gravity.  The restitution uses only angles and ratios of speeds, so it depends neither on
    the scale nor on the frame rate.

    References
    ----------
    Hlosta et al. (2020), fig. 3c.
    """
    if is_table(clip):
        return _measure_table(
            clip,
            camera,
            table,
            variant=variant,
            length=length,
            bead_diameter=bead_diameter,
            bead_mass=bead_mass,
            out=out,
        )
    video = without_repeats(open_video(clip, camera), progress)
    film = (observe_wall_film if variant == "wall" else observe_film)(video, camera, length, progress)
    scale, scale_from = scale_of(film, camera, length, bead_diameter)
    roll = -float(film.fit.swings["tilt"]) if camera.roll is None else camera.roll
    tracks, axis, stated = upright(film, camera_axis(video), scale, roll)
    with seeing(tracks_seen(film.beads), film.warnings):
        fit = fit_clip(clip, tracks, axis=axis, ground=GROUND, stated=stated)
    evaluation = judge(
        fit,
        None if scale_from == "pendulum length" else length,
        None if scale_from == "bead diameter" else bead_diameter,
        bead_mass,
        shading=SHADING * scale * max(look.radius for look in film.beads.looks),
    )
    timing, lens, hinges = timing_check(video, film.losses), lens_check(fit), pivot_checks(film.fit)
    views = view_checks(film.beads, evaluation.checks)
    # gravity is no check if the scale is from gravity
    by_gravity = scale_from == "gravity"
    checks = (
        *(each for each in evaluation.checks if each.check != "gravity" or not by_gravity),
        timing,
        lens,
        *hinges,
        *views,
    )
    spoilt = "; ".join(filter(None, [video.spoilt, failed((timing, lens, *hinges, *views))]))
    quantities = tuple(doubted(quantity, spoilt) for quantity in evaluation.quantities)
    seen = {
        "frame_rate_hz": video.frame_rate,
        "playback_rate_hz": video.playback_rate,
        "scale_m_per_px": scale,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(roll),
    } | camera.stated_view
    return Measurement(
        rig="pendulum",
        source=clip,
        source_sha256=sha256(clip),
        quantities=quantities,
        checks=checks,
        warnings=(
            *video.warnings,
            *film.warnings,
            *roll_warning(film.fit, camera),
            *evaluation.warnings,
            *([UNCONFIRMED] if by_gravity else ()),
        ),
        camera=seen,
        tracks=tracks,
        marks=video.marks_in_file(picture_marks(film.beads, picture_view(film.fit, film.times))),
        frame_times=tuple(video.file_times.tolist()),
        files={} if out is None else _write(out, video, film, fit, quantities, progress=progress),
    )


def _measure_table(
    record: Path,
    camera: Camera,
    options: TableOptions | None,
    *,
    variant: Variant,
    length: float | None,
    bead_diameter: float | None,
    bead_mass: float | None,
    out: Path | None,
) -> Measurement:
    read = read_bodies(record, options, scale=camera.given_scale, frame_rate=camera.frame_rate, direction=by_swing)
    tracks = in_order(_named(read.tracks), variant)
    fit = fit_clip(record, tracks)
    view = scale_used(read, camera)
    lacking = "its scale and its vertical are" if read.unit == "m" and not read.scaled else "its vertical is"
    warnings: tuple[str, ...] = (NOT_STATED.format(lacking),)
    if read.unit != "m":
        found = fit.propagate(outcomes_of)
        known = length is not None
        scale = length / found["length"].value if length is not None else GRAVITY / found["gravity"].value
        tracks = tuple(replace(each, position=scale * each.position, sigma=scale * each.sigma) for each in tracks)
        fit = fit_clip(record, tracks)
        per = "scale_m_per_px" if read.unit == "px" else "scale_m_per_unit"
        view = {per: scale, "scale_from": "pendulum length" if known else "gravity"}
        warnings += () if known else (UNCONFIRMED,)
    evaluation = judge(fit, None if view.get("scale_from") == "pendulum length" else length, bead_diameter, bead_mass)
    files = {}
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        files["plot"] = out / f"{record.stem}-plot.svg"
        write_plot(files["plot"], fit)
    by_gravity = view.get("scale_from") == "gravity"
    return Measurement(
        "pendulum",
        record,
        sha256(record),
        evaluation.quantities,
        tuple(each for each in evaluation.checks if each.check != "gravity" or not by_gravity),
        (*warnings, *evaluation.warnings, *read.understood.proposals),
        camera=view,
        tracks=tracks,
        table=read.understood.to_json(),
        files=files,
    )


def _named(tracks: Sequence[Track]) -> tuple[Track, ...]:
    """Two tracks of other names as A, which moves first, and B."""
    if len(tracks) != 2 or {"A", "B"} <= {track.body.strip().upper() for track in tracks}:
        return tuple(tracks)
    starts = [onset(track) for track in tracks]
    moved = [
        math.inf if start is None else float(track.time[start]) for track, start in zip(tracks, starts, strict=True)
    ]
    first = 0 if moved[0] <= moved[1] else 1
    return replace(tracks[first], body="A"), replace(tracks[1 - first], body="B")


def _write(
    out: Path, video: Video, film: Film, fit: SwingFit, found: Sequence[Quantity], *, progress: Progress
) -> dict[str, Path]:
    clip = video.path
    out.mkdir(parents=True, exist_ok=True)
    endings = {"overlay": "overlay.mp4", "still": "still.png", "plot": "plot.svg", "record": "track.csv"}
    files = {kind: out / f"{clip.stem}-{ending}" for kind, ending in endings.items()}
    view = picture_view(film.fit, film.times)
    turning = float(turning_points(film.fit.swings, 0)[1][-1, 0])
    best = int(film.beads.frames[np.argmin(np.abs(film.times - turning))])
    still = write_overlay(files["overlay"], video, film.beads, view, still=best, progress=progress)
    write_still(files["still"], still, film.beads, view, film.fit, found=found)
    write_plot(files["plot"], fit)
    write_tracks(files["record"], fit.tracks)
    return files
