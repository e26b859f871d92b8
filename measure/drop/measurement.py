"""Measure a bead that falls on a plate and bounces: from a clip or a track to quantities (`measure`)."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import Mark, NothingToMeasure, RigtwinError, Seen, seeing
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Evaluation, Measurement, Quantity, doubted, failed
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY
from rigtwin.lab.tracked.read import NOT_STATED, read_bodies, scale_used
from rigtwin.lab.tracked.table import TableOptions, is_table
from rigtwin.lab.tracked.upright import by_fall
from rigtwin.measure.drop.bounce_fit import Bounces
from rigtwin.measure.drop.checks import (
    plate_check,
    size_check,
    view_checks,
)
from rigtwin.measure.drop.evaluate import bounces_of, evaluate_bounces, rate_of, readable
from rigtwin.measure.drop.fall_in_air import AirDrag
from rigtwin.measure.drop.figures import picture_marks, write_pictures
from rigtwin.measure.drop.find_bead import find_bead
from rigtwin.measure.drop.line_of_sight import Depth, at_first_contact, find_depth, in_plane, with_depth
from rigtwin.measure.drop.scale import (
    SCALE_UNCERTAINTY,
    Gauge,
    find_gauge,
    radius_uncertainty,
    scale_by_gravity,
    to_metres,
)
from rigtwin.measure.drop.sound_measurement import measure_sound, with_sound
from rigtwin.measure.geometry.camera_roll import roll_check
from rigtwin.measure.media.duplicate_frames import at_its_pace
from rigtwin.measure.media.sound import has_sound, is_sound
from rigtwin.measure.media.time_base import SAME_RATE
from rigtwin.measure.media.video import Video, open_video
from rigtwin.measure.refusal import shows_refusals
from rigtwin.measure.tracking.follow import Chase

RATE_UNJUDGED = (
    "the scale is from gravity and the frame rate from the file: if the film plays slower than it was captured, "
    "heights are too large; give --frame-rate or --scale"
)

RATE_BELOW_THE_FILE = (
    "the scale is from gravity, and the stated {stated:g} Hz are fewer than the {file:g} Hz of the file, in which no "
    "frame repeats the one before; lengths go with the square of the rate: check --frame-rate, or give "
    "--bead-diameter or --scale"
)

RATE_UNCONFIRMED = (
    "frame rate not confirmed: the scale was taken from gravity, so all lengths depend on the square of --frame-rate; "
    "give --bead-diameter or --scale"
)


def _with_film_checks(
    quantity: Quantity, checks: tuple[Check, ...], drag: AirDrag, *, film: str, lengths: str, scales: str
) -> Quantity:
    """The quantity with the failed checks of the film that affect it; those of the flights are included already.

    `film` makes every quantity doubtful, `lengths` those in metres, `scales` those that depend on the bead's size.
    """
    in_metres = quantity.unit == "m"
    # a known air drag depends on the bead's size; a fitted one does not
    of_size = in_metres or (quantity.method == "velocity" and drag.known)
    rests_on = {
        "bead_in_view": True,
        "static_camera": True,
        "stated_plate": True,
        "camera_roll": in_metres,
        "bead_size": of_size,
    }
    seen = failed(checks, [name for name, rests in rests_on.items() if rests])
    reasons = [seen, film, lengths if in_metres else "", scales if of_size else ""]
    return doubted(quantity, "; ".join(filter(None, reasons)))


# ---------------------------------------------------------------------------------------------------- media -> record


def measure(
    clip: Path,
    camera: Camera,
    *,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
    table: TableOptions | None = None,
    sound: bool = False,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure a clip of a bouncing bead, or evaluate a table of its track.

    Parameters
    ----------
    clip : Path
        Video or stack of images; a sound recording; or a table with the bead's track (`rigtwin.lab.tracked`), for which
        only frame rate and scale of the camera are used.
    camera : Camera
        Frame rate, scale, roll and search region, as far as known.
    bead_diameter : float, optional
        Diameter of the bead [m].  Gives a scale if `camera` has none, and the air drag.
    bead_density : float, optional
        Density of the bead [kg/m^3].  With the diameter it fixes the air drag; otherwise the drag is fitted.
    table : TableOptions, optional
        Columns and joined tracks of a table.
    sound : bool
        Evaluate the sound of a film too, and compare both.  The sound alone is evaluated where the film cannot be.
    out : Path, optional
        Folder for the annotated video, pictures, plot and track; None writes no files.
    progress : Progress, optional
        Called with stage, number of steps done and total number of steps.

    Returns
    -------
    Measurement
        ``drop_height`` and ``rebound_height`` [m] and ``restitution_wall`` [1] per bounce, with checks and the track.

    Raises
    ------
    UnreadableMedia
        If the file is no video.
    NothingToMeasure
        If no bead falls and bounces in it.

    Notes
    -----
    In the track, y = 0 is the bead's centre at its first contact, so y is the height of its lowest point above the
    plate; x = 0 is the point of the first impact.  The methods of the restitution are described in
    `rigtwin.measure.drop.evaluate.evaluate`.

    References
    ----------
    Hlosta et al. (2020), eq. 5.
    """
    drag = AirDrag(bead_diameter, bead_density)
    if is_table(clip):
        return _measure_table(clip, camera, table, drag, out)
    if is_sound(clip):
        return measure_sound(clip, out=out)
    try:
        film = _measure_film(
            clip,
            camera,
            drag=drag,
            bead_diameter=bead_diameter,
            bead_density=bead_density,
            out=out,
            progress=progress,
        )
    except NothingToMeasure as nothing:
        if not has_sound(clip):
            raise
        try:
            heard = measure_sound(clip, out=out)
        except RigtwinError:
            raise nothing from None
        unseen = f"the film could not be measured, so the sound alone was: {nothing.message}"
        files = heard.files if nothing.picture is None else {**heard.files, "seen": nothing.picture}
        return replace(heard, warnings=(unseen, *heard.warnings), files=files)
    return with_sound(film) if sound else film


@shows_refusals
def _measure_film(
    clip: Path,
    camera: Camera,
    *,
    drag: AirDrag,
    bead_diameter: float | None,
    bead_density: float | None,
    out: Path | None,
    progress: Progress,
) -> Measurement:
    video = at_its_pace(open_video(clip, camera), progress)
    found = find_bead(video, camera, drag, bead_diameter, progress)
    video, seen, pixels, repeats = found.video, found.seen, found.pixels, found.repeats
    with seeing(_track_seen(found.seen), found.warnings):
        in_picture = bounces_of(pixels, drag, str(clip), filmed=True)
    depth = find_depth(seen, pixels, in_picture)
    if depth is not None:
        first = float(np.interp(in_picture.contact_times[0], video.times, np.arange(len(video.times))))
        seen = at_first_contact(seen, depth, first)

    def evaluated(depth: Depth | None) -> tuple[Gauge, Bounces, Track, AirDrag, Bounces, Evaluation]:
        """Scale, bounces in pixels, track, air drag, bounces and quantities, with this depth."""
        flat = pixels if depth is None else in_plane(pixels, depth)
        fitted = in_picture if depth is None else bounces_of(flat, drag, str(clip), filmed=True)
        gauge = find_gauge(flat, fitted, seen, camera, bead_diameter)
        track = to_metres(flat, fitted, gauge)
        used = AirDrag(2 * seen.radius * gauge.scale, bead_density) if bead_diameter is None else drag
        bounces = bounces_of(track, used, str(clip), in_metres=True, filmed=True)
        evaluation = evaluate_bounces(
            track,
            bounces,
            scale_uncertainty=gauge.uncertainty,
            rate=video.frame_rate,
            repeats=len(repeats - video.skipped),
            losses=found.losses,
        )
        return gauge, fitted, track, used, bounces, evaluation

    gauge, fitted, track, drag, bounces, evaluation = evaluated(depth)
    if depth is not None:
        others = [evaluated(other)[-1].quantities for other in depth.varied()]
        evaluation = replace(
            evaluation, quantities=tuple(with_depth(quantity, others) for quantity in evaluation.quantities)
        )
    checks = _with_gravity_judged(evaluation.checks, gauge) + view_checks(video, seen, fitted, repeats)
    if depth is not None:
        checks = (*checks, depth.check)
    if camera.roll is not None:
        checks = (*checks, roll_check(camera.roll, *gauge.fall, "the bead's fall shows"))
    if bead_diameter is not None and not gauge.source.startswith("bead diameter"):
        checks = (*checks, size_check(2 * seen.radius * gauge.scale, radius_uncertainty(seen), bead_diameter))
    if camera.plate is not None:
        checks = (*checks, plate_check(camera.plate, seen, in_picture))
    unconfirmed = (f"{RATE_UNCONFIRMED}; {gauge.cross_check}.",) if gauge.source == "gravity" else ()
    unjudged = _rate_unjudged(video, camera) if gauge.source == "gravity" else ""
    measurement = Measurement(
        rig="drop",
        source=clip,
        source_sha256=sha256(clip),
        quantities=tuple(
            _with_film_checks(quantity, checks, drag, film=video.spoilt, lengths=unjudged, scales=gauge.contradiction)
            for quantity in evaluation.quantities
        ),
        checks=checks,
        warnings=(*video.warnings, *found.warnings, *evaluation.warnings, *unconfirmed),
        camera={
            "frame_rate_hz": video.frame_rate,
            "playback_rate_hz": video.playback_rate,
            "scale_m_per_px": gauge.scale,
            "scale_std_rel": gauge.uncertainty,
            "scale_from": gauge.source,
            "camera_roll_deg": math.degrees(gauge.roll),
            "camera_roll_std_deg": math.degrees(gauge.roll_uncertainty),
            "exposure_fraction": seen.shutter.share if seen.shutter.measured else None,
            "exposure_fraction_std": seen.shutter.uncertainty if seen.shutter.measured else None,
            "bead_radius_px": seen.radius,
        }
        | camera.stated_view,
        tracks=(track,),
        marks=video.marks_in_file(picture_marks(seen, in_picture)),
        frame_times=tuple(video.file_times.tolist()),
    )
    if out is None:
        return measurement
    files = write_pictures(out, measurement, bounces, in_picture, video, seen, progress)
    return replace(measurement, files=files)


def _rate_unjudged(video: Video, camera: Camera) -> str:
    """Why lengths in a scale from gravity are doubtful for their frame rate; empty if they are not."""
    if camera.frame_rate is None:
        return RATE_UNJUDGED
    repeats = video.numbers is not None or video.skipped - video.excluded
    fewer = video.frame_rate < (1 - SAME_RATE) * video.playback_rate and not repeats
    return RATE_BELOW_THE_FILE.format(stated=video.frame_rate, file=video.playback_rate) if fewer else ""


def _track_seen(chase: Chase) -> Seen:
    """The track that was followed, for the picture of a refusal."""
    points = [(sighting.image.x, sighting.image.y) for sighting in chase.sightings]
    frames = [sighting.frame for sighting in chase.sightings]
    ends = [Mark(f"frame {frames[k]}", [points[k]], chase.radius) for k in (0, -1)]
    return Seen(frame=frames[len(frames) // 2], marks=(Mark("", points), *ends))


def _measure_table(
    path: Path, camera: Camera, options: TableOptions | None, drag: AirDrag, out: Path | None
) -> Measurement:
    read = read_bodies(
        path,
        options,
        scale=camera.given_scale,
        frame_rate=camera.frame_rate,
        direction=by_fall,
        only_height=True,
    )
    longest = max(read.tracks, key=lambda each: len(each.time))
    in_metres = read.unit == "m"
    track, repeats, losses, fitted = readable(longest, drag if in_metres else AirDrag())
    bounces = bounces_of(track, drag if in_metres else AirDrag(), str(path), fitted=fitted, in_metres=in_metres)
    view = scale_used(read, camera)
    uncertainty = camera.scale_uncertainty(SCALE_UNCERTAINTY) if read.scaled else 0.0
    warnings: tuple[str, ...] = (NOT_STATED.format("its scale is"),) if in_metres and not read.scaled else ()
    if not in_metres:
        by_gravity, uncertainty = scale_by_gravity(bounces, 0.0)
        track = replace(track, position=track.position * by_gravity, sigma=track.sigma * by_gravity)
        bounces = bounces_of(track, drag, str(path), in_metres=True)
        per = "scale_m_per_px" if read.unit == "px" else "scale_m_per_unit"
        view = {per: by_gravity, "scale_std_rel": uncertainty, "scale_from": "gravity"}
        warnings = (
            f"lengths are in {read.unit or 'a unit that is not stated'}, so the scale was taken from gravity and "
            "depends on the square of the frame rate; give --scale, or the unit with --columns.",
        )
    evaluation = evaluate_bounces(
        track, bounces, scale_uncertainty=uncertainty, rate=rate_of(longest), repeats=repeats, losses=losses
    )
    warnings = (*warnings, *evaluation.warnings, *read.understood.proposals)
    if len(read.tracks) > 1:
        warnings = (*warnings, f"{path.name} holds {len(read.tracks)} bodies; evaluated {track.body!r}, the longest.")
    if drag.density is not None and drag.diameter is None:
        unused = "bead density not used: the air drag needs the diameter too and was fitted. Give --bead-diameter."
        warnings = (*warnings, unused)
    checks = evaluation.checks if in_metres else tuple(each for each in evaluation.checks if each.check != "gravity")
    measurement = Measurement(
        rig="drop",
        source=path,
        source_sha256=sha256(path),
        quantities=evaluation.quantities,
        checks=checks,
        warnings=warnings,
        camera=view,
        tracks=(track,),
        table=read.understood.to_json(),
    )
    if out is None:
        return measurement
    from rigtwin.measure.drop.figures import write_plot

    return replace(measurement, files={"plot": write_plot(out, measurement, bounces)})


def _with_gravity_judged(checks: tuple[Check, ...], gauge: Gauge) -> tuple[Check, ...]:
    """Checks with gravity by the scale of the bead's diameter; without that check if gravity gave the scale."""
    gravity, *others = checks
    if gauge.gravity is not None:
        value, sigma = gauge.gravity
        message = f"with the scale from the bead's diameter, free flight gives g = {value:.2f} ± {sigma:.2f} m/s²"
        message += f" instead of {GRAVITY}: {gauge.contradiction}" if gauge.contradiction else ": they agree"
        gravity = replace(gravity, passed=not gauge.contradiction, value=value, message=message)
    elif gauge.source == "gravity":
        return tuple(others)
    return replace(gravity, message=f"{gravity.message.rstrip('.')}; {gauge.cross_check}."), *others
