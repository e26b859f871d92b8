"""Measure a plate that is tilted until a body on it slides or rolls: from a clip to quantities (`measure`)."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import Seen, seeing
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Measurement, doubted
from rigtwin.lab.records import Series, Track
from rigtwin.lab.tracked.table import TableOptions, is_table
from rigtwin.measure.media.compression import compression_check
from rigtwin.measure.media.duplicate_frames import at_its_pace
from rigtwin.measure.media.video import Video, open_video
from rigtwin.measure.refusal import shows_refusals
from rigtwin.measure.scene.checks import camera_by_scene
from rigtwin.measure.tilt.evaluate import check_variant, evaluate_run, judged_quantities, onset_of, way_down
from rigtwin.measure.tilt.figures import picture_marks, write_pictures
from rigtwin.measure.tilt.film_checks import (
    arm_check,
    level_check,
    portrait_check,
    shape_check,
    size_check,
    view_checks,
)
from rigtwin.measure.tilt.incline import at_rest, descent_of, evaluate_descent, judged_of_incline
from rigtwin.measure.tilt.measure_table import measure_table
from rigtwin.measure.tilt.observe import (
    PERSPECTIVE,
    Film,
    Gauge,
    body_seen,
    gauge_of,
    observe_film,
    record,
    timed_by_the_run,
)
from rigtwin.measure.tilt.onset import (
    Onset,
    Run,
    Variant,
    Way,
)

OVER_COMPRESSED = 0.006  # [bits/pixel], below which the codec drops low-contrast motion in a film with little motion


@shows_refusals
def measure(
    clip: Path,
    camera: Camera,
    *,
    variant: Variant,
    bead_diameter: float | None = None,
    arm_length: float | None = None,
    table: TableOptions | None = None,
    angle: Path | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure a clip of a tilting plate with a body on it.

    Parameters
    ----------
    clip : Path
        Video or stack of images, seen from the side; or a table with the body's track (`rigtwin.lab.tracked`).
    camera : Camera
        Frame rate, scale and roll, as far as known.  Without a roll the base plate under the arm is taken to be level.
    variant : {"slide", "roll"}
        Kind of motion.
    bead_diameter : float, optional
        Diameter of the bead [m].
    arm_length : float, optional
        Length of the arm from hinge to tip [m].
    table : TableOptions, optional
        Columns and joined tracks of a table.
    angle : Path, optional
        Table of the plate's angle over time, where the table of the track has none; by default ``NAME-angle.csv``
        beside ``NAME-track.csv``.
    out : Path, optional
        Folder for the annotated video, pictures, plot and records; None writes no files.
    progress : Progress, optional
        Called with stage, number of steps done and total number of steps.

    Returns
    -------
    Measurement
        Quantities and checks of `rigtwin.measure.tilt.evaluate.evaluate`, the track of the body, and the angle of the
        plate against the horizontal [rad], positive.

    Raises
    ------
    UnreadableMedia
        If the file is no video.
    NothingToMeasure
        If no plate is found, or nothing moves on it.
    BadInput
        If the variant is unknown.

    Notes
    -----
    mu = tan(alpha) at the onset of motion.  Where the plate stands still, the friction in motion follows from the
    body's acceleration (`rigtwin.measure.tilt.incline`), which needs a scale.  The track is fixed in space with its
    origin on the axis of the plate, x towards the rising side and y up.  The scale is that of `camera`, else from
    `arm_length`, else from `bead_diameter`, else from gravity.  On a plate that turns only the check of the
    acceleration and the kinetic friction need it.

    References
    ----------
    Hlosta et al. (2020), eqs. 3 and 4.
    """
    check_variant(variant)
    if is_table(clip):
        return measure_table(clip, camera, table, variant=variant, bead_diameter=bead_diameter, angle=angle, out=out)
    video = at_its_pace(open_video(clip, camera), progress)
    film = observe_film(video, camera, progress)
    gauge = gauge_of(film, camera, bead_diameter, arm_length)
    sizes = size_check(film, gauge, bead_diameter)
    if any(not check.passed for check in sizes):  # limits of drift and creep are those of the body as it is seen
        bead_diameter = film.body.size[1] * gauge.scale

    def read(film: Film, gauge: Gauge) -> tuple[Series, Track, Way, Run, Onset]:
        """Return the record of the film at this scale, and the run and onset in it."""
        plate, track = record(film, gauge)
        way = way_down(plate, [track], variant, bead_diameter, gauge.uncertainty)
        return plate, track, way, *onset_of(way, str(clip))

    by_gravity = math.inf
    with seeing(Seen(frame=video.first, marks=body_seen(film)), film.warnings):
        plate, track = record(film, gauge)
        way = way_down(plate, [track], variant, bead_diameter, gauge.uncertainty)
        resting = descent_of(way, str(clip)) if at_rest(way) else None
        if resting is not None:
            evaluation = evaluate_descent(resting, variant, gauge.uncertainty, _geometry(film, gauge))
        else:
            plate, track, way, run, onset = read(film, gauge)
    if resting is None:
        by_turn_alone, film = film, timed_by_the_run(film, way, run, onset, video)
        if np.any(film.missing != by_turn_alone.missing):
            plate, track, way, run, onset = read(film, gauge)
        if not math.isfinite(gauge.uncertainty):
            # only now, as it depends on the square of all times
            by_gravity = onset.gain_sigma / onset.gain
            gauge = replace(gauge, scale=gauge.scale / onset.gain, source="gravity")
            plate, track, way, run, onset = read(film, gauge)
        timing = _timing(film, video, onset)
        evaluation = evaluate_run(way, run, onset, variant, bead_diameter, _geometry(film, gauge), timing)
    still = camera_by_scene(film.poses)
    of_film = (
        shape_check(film.body, variant),
        *sizes,
        *(portrait_check(film, onset) if resting is None else ()),
        *(view_checks(film, gauge, video, onset) if resting is None else (arm_check(film), level_check(film, gauge))),
        compression_check(video, OVER_COMPRESSED),
        *([still] if isinstance(still, Check) else []),
    )
    checks = (*evaluation.checks, *of_film)
    quantities = [doubted(each, video.spoilt) for each in evaluation.quantities]
    measurement = Measurement(
        rig="tilt",
        source=clip,
        source_sha256=sha256(clip),
        quantities=judged_quantities(quantities, of_film) if resting is None else judged_of_incline(quantities, checks),
        checks=checks,
        warnings=(*video.warnings, *film.warnings, *evaluation.warnings, *([still] if isinstance(still, str) else [])),
        camera=_view(video, gauge, camera, by_gravity),
        tracks=(track,),
        series=(plate,),
        marks=video.marks_in_file(picture_marks(film)),
        frame_times=tuple(video.file_times.tolist()),
    )
    if out is None:
        return measurement
    found = onset if resting is None else resting
    return replace(measurement, files=write_pictures(out, measurement, video, film, way, found, plate, progress))


def _timing(film: Film, video: Video, onset: Onset) -> dict[str, float]:
    """Standard uncertainties of the time of the onset in a film [s]."""
    # an exposure lasts up to one frame interval, and the time stamp is that of its start
    timing = {"exposure": 0.2 / video.frame_rate}
    if corrected := int(np.sum(film.missing[film.times <= onset.time] > 0)):
        # a jerk of the plate looks like a missing frame
        timing["missing frames"] = 0.5 * math.sqrt(corrected) / video.frame_rate
    return timing


def _geometry(film: Film, gauge: Gauge) -> dict[str, float]:
    """Standard uncertainties of the plate's angle in a film [rad]."""
    return {
        "level": gauge.level.sigma,
        "arm": max(film.arm.tilt_sigma, float(np.nanmedian(film.sigmas))),
        "perspective": PERSPECTIVE,
    }


def _view(video: Video, gauge: Gauge, camera: Camera, by_gravity: float) -> dict[str, Any]:
    """What is known of the camera; `by_gravity` is the relative standard uncertainty of a scale from the run."""
    return {
        "frame_rate_hz": video.frame_rate,
        "playback_rate_hz": video.playback_rate,
        "scale_m_per_px": gauge.scale,
        "scale_std_rel": by_gravity if gauge.source == "gravity" else gauge.uncertainty,
        "scale_from": gauge.source,
        "camera_roll_deg": math.degrees(gauge.level.roll),
        "camera_roll_std_deg": math.degrees(gauge.level.sigma),
        "camera_roll_from": gauge.level.source,
    } | camera.stated_view
