"""A bead falls on a plate and bounces: drop and rebound heights, restitution per bounce (Hlosta et al. 2020, eq. 5).

`measure` turns a clip into a track and the track into quantities; `evaluate` does the second half for any track, filmed
or simulated.  Restitutions are told apart: by ``height`` sqrt(h_{k+1}/h_k), which air drag lowers; by ``velocity``,
the ratio of the speeds across the plate at the contact itself; by ``time``, the ratio of neighbouring flight times;
and where the body leaves sideways, as one that is no sphere does, by ``all directions``, the ratio of the speeds with
what goes along the plate (section 3.2), which takes two views; of one view it is by ``picture plane``.

In a track of `measure` y = 0 is the bead's centre at its first contact, so y is the height of its lowest point above
the plate; x = 0 is where it first hits.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import sha256
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Measurement, Quantity, doubted, failed
from rigtwin.lab.records import read_tracks
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.drop.checks import (
    size_check,
    view_checks,
)
from rigtwin.measure.drop.evaluate import bounces_of, evaluate_bounces, rate_of, readable
from rigtwin.measure.drop.fall_in_air import AirDrag
from rigtwin.measure.drop.find_bead import find_bead
from rigtwin.measure.drop.scale import Gauge, find_gauge, radius_doubt, to_metres
from rigtwin.measure.geometry.camera_roll import roll_check
from rigtwin.measure.media.duplicate_frames import at_its_pace
from rigtwin.measure.media.video import open_video

RATE_UNJUDGED = (
    "the scale is from gravity and the frame rate from the file: if the film plays slower than it was captured, "
    "heights are too large; give --frame-rate or --scale"
)

RATE_UNCONFIRMED = (
    "frame rate not confirmed: the scale was taken from gravity, so that all lengths hang on --frame-rate alone, with "
    "its square; give --bead-diameter or --scale"
)


def _with_doubts(
    quantity: Quantity, checks: tuple[Check, ...], drag: AirDrag, *, film: str, lengths: str, scales: str
) -> Quantity:
    """The quantity with the failed checks of the film that it rests on; those of the flights it has already.

    `film` is what makes all doubtful, `lengths` what makes lengths doubtful, `scales` what makes time or size doubtful.
    """
    in_metres = quantity.unit == "m"
    # the bead's size is in the air's drag where that is known and not fitted
    of_size = in_metres or (quantity.method == "velocity" and drag.known)
    rests_on = {"bead_in_view": True, "static_camera": True, "camera_roll": in_metres, "bead_size": of_size}
    seen = failed(checks, [name for name, rests in rests_on.items() if rests])
    doubts = [seen, film, lengths if in_metres else "", scales if of_size else ""]
    return doubted(quantity, "; ".join(filter(None, doubts)))


# ---------------------------------------------------------------------------------------------------- media -> record


def measure(
    clip: Path,
    camera: Camera,
    *,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure a clip of a bouncing bead, or evaluate a track already made (``.csv``).

    Raises `UnreadableMedia` for a file that is no video, `NothingToMeasure` when no bead falls and bounces in it.
    """
    drag = AirDrag(bead_diameter, bead_density)
    if clip.suffix.lower() == ".csv":
        return _measure_record(clip, drag, out)
    video = at_its_pace(open_video(clip, camera), progress)
    found = find_bead(video, camera, drag, bead_diameter, progress)
    video, seen, pixels, repeats = found.video, found.seen, found.pixels, found.repeats
    fitted = bounces_of(pixels, drag, str(clip), filmed=True)
    gauge = find_gauge(pixels, fitted, seen, camera, bead_diameter)
    track = to_metres(pixels, fitted, gauge)
    if bead_diameter is None:
        drag = AirDrag(2 * seen.radius * gauge.scale, bead_density)
    bounces = bounces_of(track, drag, str(clip), in_metres=True, filmed=True)
    evaluation = evaluate_bounces(
        track,
        bounces,
        scale_doubt=gauge.doubt,
        rate=video.frame_rate,
        repeats=len(repeats - video.skipped),
        losses=found.losses,
    )
    checks = _with_gravity_told(evaluation.checks, gauge) + view_checks(video, seen, fitted, repeats)
    if camera.roll is not None:
        checks = (*checks, roll_check(camera.roll, *gauge.fall, "the bead's fall shows"))
    if bead_diameter is not None and not gauge.source.startswith("bead diameter"):
        checks = (*checks, size_check(2 * seen.radius * gauge.scale, radius_doubt(seen), bead_diameter))
    unconfirmed = (f"{RATE_UNCONFIRMED}; {gauge.cross_check}.",) if gauge.source == "gravity" else ()
    unjudged = RATE_UNJUDGED if gauge.source == "gravity" and camera.frame_rate is None else ""
    measurement = Measurement(
        rig="drop",
        source=clip,
        source_sha256=sha256(clip),
        quantities=tuple(
            _with_doubts(quantity, checks, drag, film=video.spoilt, lengths=unjudged, scales=gauge.contradiction)
            for quantity in evaluation.quantities
        ),
        checks=checks,
        warnings=(*video.warnings, *evaluation.warnings, *unconfirmed),
        camera={
            "frame_rate_hz": video.frame_rate,
            "playback_rate_hz": video.playback_rate,
            "scale_m_per_px": gauge.scale,
            "scale_std_rel": gauge.doubt,
            "scale_from": gauge.source,
            "camera_roll_deg": math.degrees(gauge.roll),
            "camera_roll_std_deg": math.degrees(gauge.roll_doubt),
            "exposure_fraction": seen.shutter.share if seen.shutter.told else None,
            "exposure_fraction_std": seen.shutter.doubt if seen.shutter.told else None,
            "bead_radius_px": seen.radius,
        },
        tracks=(track,),
    )
    if out is None:
        return measurement
    from rigtwin.measure.drop.figures import write_pictures

    files = write_pictures(out, measurement, bounces, fitted, video, seen, progress)
    return replace(measurement, files=files)


def _measure_record(path: Path, drag: AirDrag, out: Path | None) -> Measurement:
    tracks = read_tracks(path)
    longest = max(tracks, key=lambda each: len(each.time))
    track, repeats, losses, fitted = readable(longest, drag)
    bounces = bounces_of(track, drag, str(path), fitted=fitted, in_metres=True)
    evaluation = evaluate_bounces(
        track, bounces, scale_doubt=0.0, rate=rate_of(longest), repeats=repeats, losses=losses
    )
    warnings = evaluation.warnings
    if len(tracks) > 1:
        warnings = (*warnings, f"{path.name} holds {len(tracks)} bodies; evaluated {track.body!r}, the longest.")
    if drag.density is not None and drag.diameter is None:
        told = "bead density: not used, for the air's drag needs the diameter too; it was fitted. Give --bead-diameter."
        warnings = (*warnings, told)
    measurement = Measurement(
        rig="drop",
        source=path,
        source_sha256=sha256(path),
        quantities=evaluation.quantities,
        checks=evaluation.checks,
        warnings=warnings,
        tracks=(track,),
    )
    if out is None:
        return measurement
    from rigtwin.measure.drop.figures import write_plot

    return replace(measurement, files={"plot": write_plot(out, measurement, bounces)})


def _with_gravity_told(checks: tuple[Check, ...], gauge: Gauge) -> tuple[Check, ...]:
    """With what the bead's diameter says of gravity; without that check where gravity itself gave the scale."""
    gravity, *others = checks
    if gauge.gravity is not None:
        value, doubt = gauge.gravity
        message = f"with the scale of the bead's diameter free flight gives g = {value:.2f} ± {doubt:.2f} m/s²"
        message += f" instead of {GRAVITY}: {gauge.contradiction}" if gauge.contradiction else ": they agree"
        gravity = replace(gravity, passed=not gauge.contradiction, value=value, message=message)
    elif gauge.source == "gravity":
        return tuple(others)
    return replace(gravity, message=f"{gravity.message.rstrip('.')}; {gauge.cross_check}."), *others
