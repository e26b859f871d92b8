"""Measure a slowly turning drum, partly full of beads, seen from its end: dynamic angle of repose of its surface."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Image
from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import BadInput, NothingToMeasure, Seen, seeing
from rigtwin.lab.media_files import PICTURES
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement, doubted, failed
from rigtwin.lab.records import Profile
from rigtwin.lab.tracked.read import read_profiles, read_series
from rigtwin.lab.tracked.table import TableOptions, is_table
from rigtwin.measure.bulk.checks import spacing_check
from rigtwin.measure.drawing import with_record_plot
from rigtwin.measure.drum.bed import Bed, bed_in_photo, follow_bed, rim_seen_at
from rigtwin.measure.drum.checks import checks_of_picture, must_be_a_drum, rests_on
from rigtwin.measure.drum.evaluate import (
    USUAL_SHARE,
    Observation,
    check_settings,
    evaluate,
    evaluate_observation,
    evaluate_slope,
    rising_side,
    share_of,
)
from rigtwin.measure.drum.figures import picture_marks, write_pictures
from rigtwin.measure.drum.profiles import credible, hidden_columns, profile_of, without_flights
from rigtwin.measure.drum.rim import Rim
from rigtwin.measure.drum.rotation import stance_checks
from rigtwin.measure.geometry.camera_roll import NOT_SEEN, nothing_level
from rigtwin.measure.media.duplicate_frames import at_its_pace
from rigtwin.measure.media.photo import read_photo
from rigtwin.measure.media.video import Video, open_video
from rigtwin.measure.refusal import shows_refusals
from rigtwin.measure.scene.checks import camera_by_scene

ONE_PICTURE = (
    "a single picture shows one moment of the flow; film the drum for a mean over time, or state --averaged if the "
    "picture is such a mean."
)
BEAD_NOT_KNOWN = (
    f"the scatter from moment to moment is taken as that of beads of {USUAL_SHARE:.0%} of the drum's diameter; give "
    "--bead-diameter."
)


@shows_refusals
def measure(
    clip: Path,
    camera: Camera,
    *,
    drum_diameter: float | None,
    speed: float | None = None,
    bead_diameter: float | None = None,
    table: TableOptions | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure the dynamic angle of repose from a clip of a turning drum, or from a single picture of it.

    Parameters
    ----------
    clip : Path
        Video or photo of the end of the drum; or a table of its surface, at one time or over time, with the origin on
        the drum's axis, or of the surface's slope over time (`rigtwin.lab.tracked`).
    camera : Camera
        Scale, roll, region, frame rate and other settings of the camera; whether a picture is a mean over time.
    drum_diameter : float or None
        Inner diameter of the drum [m].
    speed : float, optional
        Angular speed of the drum [rad/s]; used for the Froude number and to recognise avalanches.
    bead_diameter : float, optional
        Bead diameter [m]; sets how much the angle scatters from moment to moment.
    table : TableOptions, optional
        Columns of a table.
    out : Path
        Folder for annotated video, still, plot and record.
    progress : Progress
        Callback that shows the progress.

    Returns
    -------
    Measurement
        Angles [deg] by all methods of `evaluate`, and avalanche frequency [Hz] and angles where the bed slides in
        avalanches.

    Raises
    ------
    BadInput
        If a size or the speed is not positive, or a bead is larger than half of the drum.
    NothingToMeasure
        If no drum with a bed is found, or too little of its surface is visible.

    Notes
    -----
    The origin of a drum's profile is the axis of the drum: x to the right, height upwards against gravity.  The surface
    of a drum less than half full therefore lies at negative heights.  Heights are NaN where there is no bed.  Angles
    are magnitudes; the detail ``turning`` states the direction of rotation, by the side to which the surface rises.
    """
    check_settings(drum_diameter=drum_diameter, speed=speed, bead_diameter=bead_diameter)
    share = share_of(bead_diameter, drum_diameter)
    if share is not None and share > 0.5 and drum_diameter is not None:
        raise BadInput(
            f"measure drum: a bead of {1e3 * share * drum_diameter:.4g} mm (--bead-diameter) is larger than half of a "
            f"drum of {1e3 * drum_diameter:.4g} mm (--drum-diameter); correct them."
        )
    if is_table(clip):
        return _measure_table(clip, camera, table, drum_diameter, speed, bead_diameter, out)
    warnings: list[str] = []
    rate, spoilt = None, ""
    shown: Video | Image
    if clip.suffix.lower() in PICTURES:
        shown, odd = read_photo(clip, camera)
        warnings += odd
        bed = bed_in_photo(clip, shown, camera, bead_share=share)
    else:
        shown = at_its_pace(open_video(clip, camera), progress)
        warnings += shown.warnings
        rate, spoilt = shown.frame_rate, shown.spoilt
        bed = follow_bed(shown, camera, bead_share=share, progress=progress)
    scale, scale_from, scale_uncertainty = _scale(bed, camera, drum_diameter)
    seen = _observation(bed, scale or 1.0, share or share_of(bead_diameter, _diameter(bed, scale)), camera.averaged)
    warnings += _of_one_picture(bed, seen)
    still = camera_by_scene(bed.poses) if bed.poses else ""
    if isinstance(still, str) and still:
        warnings.append(still)
    of_picture = [
        *checks_of_picture(bed, still),
        *stance_checks(bed.bed_direction, bed.turning, rising_side(seen.profiles)),
    ]
    if scale is not None and bead_diameter is not None and bed.spacing is not None:
        of_picture.append(spacing_check(bed.spacing * scale, scale_uncertainty, bead_diameter, scale_from))
    with seeing(Seen(marks=rim_seen_at(bed.rim, bed.lens))):
        must_be_a_drum(clip, of_picture)
    try:
        evaluation = evaluate_observation(seen, speed, None if scale is None else seen.radius)
    except NothingToMeasure as nothing:
        where = f"in each of {len(bed.outlines)} frames" if bed.poses else "in this picture"
        raise NothingToMeasure(
            f"{clip}: the surface of the bed was found at fewer than eight points of x {where}: give the original "
            "file, light the drum from the front, keep hands out of the view, or state the inner rim with --circle "
            "cx,cy,r.",
            Seen(marks=rim_seen_at(bed.rim, bed.lens)),
        ) from nothing
    quantities = tuple(
        doubted(doubted(one, failed(of_picture, rests_on(one, of_picture))), spoilt) for one in evaluation.quantities
    )
    checks = (*of_picture, *evaluation.checks)
    if speed is not None and len(seen.times) > 1 and not camera.averaged:
        warnings.append(
            "speed not confirmed: the film does not show how fast the drum turns, and the uncertainties of the mean "
            f"angles count its turns by --speed {abs(speed) * 30 / math.pi:.4g}rpm."
        )
    if scale is None:
        warnings.append("scale: not known, so profiles are omitted; give --drum-diameter or --scale.")
    if turned := nothing_level(bed.upright):
        warnings.append(turned)
    hidden = sum(outline.hidden for outline in bed.outlines)
    if 0 < hidden <= len(bed.outlines) / 2:
        warnings.append(
            f"in {hidden} of {len(bed.outlines)} frames something passes in front of the drum; they are left out."
        )
    view: dict[str, Any] = {
        "frame_rate_hz": rate,
        "scale_m_per_px": None if scale is None else scale * bed.lens.zoom,
        "scale_std_rel": scale_uncertainty if scale is not None else None,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(bed.upright.roll),
        "camera_roll_from": bed.upright.source,
        "drum_centre_px": [float(each) for each in bed.lens.in_clip(np.array([bed.rim.centre]))[0]],
        "drum_radius_px": bed.rim.radius / bed.lens.zoom,
        "frames": len(bed.outlines),
    } | camera.stated_view
    result = Measurement(
        rig="drum",
        source=clip,
        source_sha256=sha256(clip),
        quantities=quantities,
        checks=checks,
        warnings=(*warnings, *evaluation.warnings),
        camera=view,
        profiles=tuple(seen.profiles) if scale is not None else (),
        marks=shown.marks_in_file(picture_marks(bed)) if isinstance(shown, Video) else picture_marks(bed),
    )
    if out is None:
        return result
    return replace(result, files=write_pictures(out, result, shown, bed, scale or 1.0, progress))


def _measure_table(
    path: Path,
    camera: Camera,
    options: TableOptions | None,
    drum_diameter: float | None,
    speed: float | None,
    bead_diameter: float | None,
    out: Path | None,
) -> Measurement:
    """Evaluate a table of the surface's slope over time, or of the surface."""
    slope = read_series(path, ["angle"], options, frame_rate=camera.frame_rate)
    if slope is not None:
        share = share_of(bead_diameter, drum_diameter)
        evaluation = evaluate_slope(slope.series, speed, bead_share=share, averaged=camera.averaged)
        understood = slope.understood
        profiles: tuple[Profile, ...] = ()
    else:
        read = read_profiles(path, options, scale=camera.given_scale, frame_rate=camera.frame_rate)
        understood, profiles = read.understood, read.profiles
        evaluation = evaluate(
            profiles,
            read.times,
            drum_diameter=drum_diameter,
            speed=speed,
            bead_diameter=bead_diameter,
            averaged=camera.averaged,
        )
    result = Measurement(
        rig="drum",
        source=path,
        source_sha256=sha256(path),
        quantities=evaluation.quantities,
        checks=evaluation.checks,
        warnings=evaluation.warnings,
        profiles=profiles,
        series=() if slope is None else (slope.series,),
        table=understood.to_json(),
    )
    return with_record_plot(result, out)


# ----------------------------------------------------------------------------------------------------- media -> record


def _scale(bed: Bed, camera: Camera, drum_diameter: float | None) -> tuple[float | None, str, float]:
    """Scale [m/px] of the analysed picture, its source, and its relative standard uncertainty."""
    if camera.given_scale is not None:
        return camera.given_scale / bed.lens.zoom, camera.scale_from, camera.scale_uncertainty()
    if drum_diameter is not None:
        return drum_diameter / (2 * bed.rim.radius), "drum diameter", bed.rim.sigma / bed.rim.radius
    return None, "not known", math.inf


def _diameter(bed: Bed, scale: float | None) -> float | None:
    """[m], of the drum, None where the scale is not known."""
    return None if scale is None else 2 * bed.rim.radius * scale


def _of_one_picture(bed: Bed, seen: Observation) -> list[str]:
    """Warnings that a photo is one moment of the flow, unless it is stated to be a mean."""
    if bed.poses or seen.averaged:
        return []
    return [ONE_PICTURE] if seen.bead_share is not None else [ONE_PICTURE, BEAD_NOT_KNOWN]


def _observation(bed: Bed, unit: float, bead_share: float | None, averaged: bool) -> Observation:
    outlines = credible(bed.outlines)
    hidden = hidden_columns(outlines)
    outlines = without_flights(outlines, bed.bead)
    half_bead = 0.25 * bed.bead

    def profiles(which: str, shorter: float = 0.0) -> list[Profile]:
        return [profile_of(outline, which, hidden, unit, shorter, bed.bead) for outline in outlines]

    variants = {"outline level": (profiles("looser"), profiles("stricter"))}
    variants["ends of the surface"] = (profiles("height", half_bead), profiles("height", 2 * half_bead))
    usual = profiles("height")
    if bed.rim.stated:
        variants |= _with_other_circles(usual, bed.rim, unit)
    return Observation(
        usual,
        np.array([outline.time for outline in outlines]),
        bed.rim.radius * unit,
        variants,
        math.degrees(bed.upright.sigma),
        bed.upright.source != NOT_SEEN,
        True,
        bead_share,
        averaged,
    )


def _with_other_circles(
    profiles: list[Profile], rim: Rim, unit: float
) -> dict[str, tuple[list[Profile], list[Profile]]]:
    """Profiles as other circles give them, one standard uncertainty away in centre and radius.

    Another centre moves the surface against the axis.  Another radius leaves more or less of it inside the drum, as a
    smaller or larger picture of it inside the same drum does.
    """

    def seen(x: float = 0.0, height: float = 0.0, size: float = 1.0) -> list[Profile]:
        return [replace(each, x=size * each.x + x, height=size * each.height + height) for each in profiles]

    off, larger = rim.sigma * unit, rim.sigma / rim.radius
    return {
        "drum's centre, sideways": (seen(x=off), seen(x=-off)),
        "drum's centre, height": (seen(height=off), seen(height=-off)),
        "drum's radius": (seen(size=1 + larger), seen(size=1 - larger)),
    }
