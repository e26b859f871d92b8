"""Measure a hopper that empties through a slot opened by a slide: discharge time, mass flow, and residue."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import BadInput
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Measurement, doubted
from rigtwin.lab.records import Series
from rigtwin.lab.tracked.columns import found_columns
from rigtwin.lab.tracked.read import TrackedSeries, read_series, read_table
from rigtwin.lab.tracked.table import TableOptions, is_table
from rigtwin.lab.units import positive
from rigtwin.measure.bulk.bead_spacing import bead_spacing
from rigtwin.measure.drawing import with_record_plot
from rigtwin.measure.geometry.camera_roll import nothing_level, upright_checks
from rigtwin.measure.hopper.checks import (
    HIDDEN,
    bed_check,
    checks_of_picture,
    compression_effect,
    flow_timing_check,
    hidden_share,
    mass_check,
    rate_check,
    size_check,
    spoils_times,
)
from rigtwin.measure.hopper.evaluate import (
    CUT,
    CUT_SHORT,
    evaluate,
    evaluate_discharge,
    failed_message,
    with_times_doubted,
)
from rigtwin.measure.hopper.figures import picture_marks, write_pictures
from rigtwin.measure.hopper.observe import (
    closed_before,
    edges_of_slot,
    last_particle,
    opening_instant,
    share_left,
    slide_opening,
    unhidden,
    with_compression,
)
from rigtwin.measure.hopper.outflow import follow_outflow
from rigtwin.measure.hopper.scale import outlet_velocity, scale_of
from rigtwin.measure.media.duplicate_frames import at_its_pace
from rigtwin.measure.media.video import open_video
from rigtwin.measure.refusal import shows_refusals
from rigtwin.measure.scene.checks import camera_by_scene

AREA_UNCERTAINTY = 0.05  # relative standard uncertainty of the mass share from the visible area of the bed


@shows_refusals
def measure(
    clip: Path,
    camera: Camera,
    *,
    bead_diameter: float | None = None,
    total_mass: float | None = None,
    bin_width: float | None = None,
    depth: float | None = None,
    bead_density: float | None = None,
    table: TableOptions | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure opening, last particle, discharge time and flow rate from a clip of a hopper that empties.

    Parameters
    ----------
    clip : Path
        Video that begins before the slide opens and ends when the hopper is empty; or a table over time of what is left
        in the hopper, of what has left it, or of the flow (`rigtwin.lab.tracked`).
    camera : Camera
        Scale, roll, region, frame rate and other settings of the camera.
    bead_diameter : float, optional
        Bead diameter [m].
    total_mass : float, optional
        Mass of the filling [kg]; needed for the mass flow rate.
    bin_width : float, optional
        Inner width of the bin [m].
    depth : float, optional
        Inner depth of a flat bin along the line of sight [m]; with `bead_density` the mass is checked against the bed.
    bead_density : float, optional
        Density of a single bead [kg/m^3].
    table : TableOptions, optional
        Columns of a table.
    out : Path
        Folder for annotated video, still, plot and record.
    progress : Progress
        Callback that shows the progress.

    Returns
    -------
    Measurement
        ``opening_time``, ``last_particle_time``, ``discharge_time``, ``discharge_time_5_95`` [s], a flow rate,
        ``residue_fraction`` [1] and, where a scale is known, ``outlet_velocity`` [m/s].

    Raises
    ------
    BadInput
        If a size or mass is not positive.
    NothingToMeasure
        If no bed leaves the hopper in the clip.

    Notes
    -----
    The slot opens when the trailing edge of the slide passes the near edge of the slot.  The last particle is out when
    its centre is one radius below the slot, which is when its upper edge passes the slot.
    """
    positive(
        bead_diameter=bead_diameter,
        total_mass=total_mass,
        bin_width=bin_width,
        depth=depth,
        bead_density=bead_density,
    )
    if is_table(clip):
        return _measure_table(clip, camera, table, total_mass, out)
    video = at_its_pace(open_video(clip, camera), progress)
    bead = bead_diameter / camera.given_scale if bead_diameter and camera.given_scale else None
    seen = follow_outflow(video, camera, bead=bead, progress=progress)
    edges = edges_of_slot(seen)
    gate = slide_opening(seen, edges)
    opened = opening_instant(seen, gate)
    hidden = hidden_share(seen, edges)
    last = last_particle(seen, edges)
    if hidden > HIDDEN:
        last = replace(last, budget=last.budget | {"hidden part of the slot": seen.interval})
    opened, last = (unhidden(seen, moment) for moment in (closed_before(seen, opened), last))
    still = camera_by_scene([moment.pose for moment in seen.moments])
    compression, few_bits = compression_effect(seen, video, still)
    if few_bits:
        opened, last = (with_compression(seen, moment, failed_message(compression)) for moment in (opened, last))
    left = share_left(seen)
    evaluation = evaluate_discharge(left, total_mass, opened, last, seen.residue, AREA_UNCERTAINTY)
    timing = flow_timing_check(seen, left.value, opened, last)
    spacing = bead_spacing(seen.scenery.full, seen.scenery.bed)
    scale, scale_from, scale_uncertainty = scale_of(seen, camera, bead_diameter, bin_width, spacing)
    warnings = [*video.warnings, *evaluation.warnings]
    warnings.append("mass left: taken from the visible area of the bed, which assumes a slab of even depth.")
    view: dict[str, Any] = {
        "frame_rate_hz": video.frame_rate,
        "scale_m_per_px": scale,
        "scale_std_rel": scale_uncertainty if scale is not None else None,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(seen.upright.roll),
        "camera_roll_from": seen.upright.source,
        "slot_width_px": (edges[1] - edges[0]) / seen.lens.zoom,
        "slide_goes": {1: "right", -1: "left", 0: "unknown"}[gate.direction if gate is not None else 0],
        "frames": len(seen.moments),
    } | camera.stated_view
    velocity = outlet_velocity(seen, scale, scale_uncertainty, bin_width)
    mass = mass_check(seen, scale, total_mass, depth, bead_density)
    quantities = tuple(
        doubted(one, failed_message(mass)) if one.quantity == "mass_flow_rate" else one for one in evaluation.quantities
    )
    size: Check | str = ""
    rate: Check | str = (
        "frame rate not confirmed: without a scale the fall of the beads cannot be compared with gravity."
    )
    if isinstance(velocity, str):
        warnings.append(f"outlet velocity: not given, because {velocity}.")
    if scale is not None:
        size = size_check(seen, scale, scale_from, scale_uncertainty, bead_diameter, spacing, bin_width)
        outlet = None if isinstance(velocity, str) else doubted(velocity, failed_message(size))
        width = view["slot_width_px"] * scale
        rate = rate_check(
            seen, outlet, width, video.frame_rate, scale=scale, uncertainty=scale_uncertainty, hidden=hidden > HIDDEN
        )
        quantities = quantities if outlet is None else (*quantities, outlet)
    outcomes = (timing, rate, size, mass, still, nothing_level(seen.upright))
    warnings += [each for each in outcomes if isinstance(each, str) and each]
    judged = [each for each in outcomes if isinstance(each, Check)]
    checks = (
        *checks_of_picture(seen, gate, hidden),
        bed_check(seen, left.value, opened),
        *upright_checks(seen.upright),
        compression,
        *evaluation.checks,
        *judged,
    )
    for why in (
        failed_message(timing),
        failed_message(rate),
        video.spoilt,
        *(failed_message(one) for one in checks if spoils_times(one)),
    ):
        quantities = with_times_doubted(quantities, why)
    if why := video.broken_off:
        quantities = tuple(
            each if why.removesuffix(".") in each.doubtful else doubted(each, why) for each in quantities
        )
    if last.method == CUT:
        quantities = tuple(each if each.doubtful else doubted(each, CUT_SHORT) for each in quantities)
    result = Measurement(
        rig="hopper",
        source=clip,
        source_sha256=sha256(clip),
        quantities=quantities,
        checks=checks,
        warnings=tuple(warnings),
        camera=view,
        series=(left,),
        marks=picture_marks(seen, edges),
    )
    if out is None:
        return result
    return replace(result, files=write_pictures(out, result, video, seen, left, edges, scale, progress))


def _measure_table(
    path: Path, camera: Camera, options: TableOptions | None, total_mass: float | None, out: Path | None
) -> Measurement:
    read, left = _left(path, options, total_mass, camera.frame_rate)
    evaluation = evaluate(left, total_mass=total_mass)
    result = Measurement(
        rig="hopper",
        source=path,
        source_sha256=sha256(path),
        quantities=evaluation.quantities,
        checks=evaluation.checks,
        warnings=evaluation.warnings,
        series=(left,),
        table=read.understood.to_json(),
    )
    return with_record_plot(result, out)


def _left(
    path: Path, options: TableOptions | None, total_mass: float | None, frame_rate: float | None
) -> tuple[TrackedSeries, Series]:
    """The table as read, and what is left in the hopper over time."""
    read = read_series(path, ("left", "collected", "flow"), options, frame_rate=frame_rate)
    if read is None:
        raise BadInput(
            f"{path}: no column for what is left in the hopper, what has left it, or the flow was recognised; "
            f"{found_columns(read_table(path))}; name it with --columns 'left=NAME', 'collected=NAME' or 'flow=NAME'."
        )
    series = read.series
    if read.role == "left":
        return read, series
    gone = series.value
    if read.role == "flow":
        from scipy.integrate import cumulative_trapezoid

        gone = cumulative_trapezoid(series.value, series.time, initial=0)
    unit = series.unit.removesuffix("/s")
    full = float(gone[-1])
    if unit == "kg" and total_mass is not None:
        full = max(full, total_mass)
    return read, Series(series.time, full - gone, "mass_left" if unit == "kg" else "left", unit)
