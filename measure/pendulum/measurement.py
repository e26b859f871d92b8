"""Measure a double or wall pendulum: from a clip or a record to quantities (`measure`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import sha256
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement, Quantity, doubted, failed
from rigtwin.lab.records import read_tracks, write_tracks
from rigtwin.measure.media.duplicate_frames import without_repeats
from rigtwin.measure.media.video import Video, open_video
from rigtwin.measure.pendulum.checks import (
    lens_check,
    timing_check,
    view_checks,
)
from rigtwin.measure.pendulum.evaluate import SHADING, Variant, in_order, judge
from rigtwin.measure.pendulum.figures import picture_view, write_overlay, write_plot, write_still
from rigtwin.measure.pendulum.observe import (
    GROUND,
    Film,
    camera_axis,
    fit_clip,
    roll_warning,
    scale_of,
    upright,
    watch,
    watch_wall,
)
from rigtwin.measure.pendulum.swing_fit import SwingFit
from rigtwin.measure.pendulum.swing_model import turning_points

UNCONFIRMED = (
    "scale and frame rate not confirmed: the scale was taken from gravity; give --length or --scale for a check."
)


def measure(
    clip: Path,
    camera: Camera,
    *,
    variant: Variant = "double",
    length: float | None = None,
    bead_diameter: float | None = None,
    bead_mass: float | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure a clip of a pendulum, or evaluate a tracked record.

    Bead A swings from an angle into bead B at rest, or into a wall.

    Parameters
    ----------
    clip : Path
        Video or stack of images; or a record as ``.csv`` with columns time_s, x_m, y_m and particle.
    camera : Camera
        Frame rate, scale, roll and search region, as far as known; not used for a record.
    variant : {"double", "wall"}
        Second bead or wall.
    length : float, optional
        Length from hinge to bead centre [m].
    bead_diameter : float, optional
        Diameter of the beads [m].
    bead_mass : float, optional
        Mass of a bead [kg].
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
    if clip.suffix.lower() == ".csv":
        return _measure_record(
            clip, variant=variant, length=length, bead_diameter=bead_diameter, bead_mass=bead_mass, out=out
        )
    video = without_repeats(open_video(clip, camera), progress)
    film = (watch_wall if variant == "wall" else watch)(video, camera, length, progress)
    scale, scale_from = scale_of(film, camera, length, bead_diameter)
    roll = -float(film.fit.swings["tilt"]) if camera.roll is None else camera.roll
    tracks, axis = upright(film, camera_axis(video), scale, roll)
    fit = fit_clip(clip, tracks, axis=axis, ground=GROUND)
    evaluation = judge(
        fit,
        None if scale_from == "pendulum length" else length,
        None if scale_from == "bead diameter" else bead_diameter,
        bead_mass,
        shading=SHADING * scale * max(look.radius for look in film.beads.looks),
    )
    timing, lens = timing_check(video, film.losses), lens_check(fit)
    views = view_checks(film.beads, evaluation.checks)
    # gravity is no check if the scale is from gravity
    by_gravity = scale_from == "gravity"
    checks = (*(each for each in evaluation.checks if each.check != "gravity" or not by_gravity), timing, lens, *views)
    spoilt = "; ".join(filter(None, [video.spoilt, failed((timing, lens, *views))]))
    quantities = tuple(doubted(quantity, spoilt) for quantity in evaluation.quantities)
    seen = {
        "frame_rate_hz": video.frame_rate,
        "playback_rate_hz": video.playback_rate,
        "scale_m_per_px": scale,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(roll),
    }
    return Measurement(
        rig="pendulum",
        source=clip,
        source_sha256=sha256(clip),
        quantities=quantities,
        checks=checks,
        warnings=(
            *video.warnings,
            *roll_warning(film.fit, camera),
            *evaluation.warnings,
            *([UNCONFIRMED] if by_gravity else ()),
        ),
        camera=seen,
        tracks=tracks,
        files={} if out is None else _write(out, video, film, fit, quantities, progress=progress),
    )


def _measure_record(
    record: Path,
    *,
    variant: Variant,
    length: float | None,
    bead_diameter: float | None,
    bead_mass: float | None,
    out: Path | None,
) -> Measurement:
    tracks = read_tracks(record)
    fit = fit_clip(record, in_order(tracks, variant))
    evaluation = judge(fit, length, bead_diameter, bead_mass)
    files = {}
    if out is not None:
        files["plot"] = out / f"{record.stem}-plot.svg"
        write_plot(files["plot"], fit)
    return Measurement(
        "pendulum",
        record,
        sha256(record),
        evaluation.quantities,
        evaluation.checks,
        evaluation.warnings,
        tracks=tracks,
        files=files,
    )


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
