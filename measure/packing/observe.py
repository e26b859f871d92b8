"""Observe one photo of a packing: the bed's outline in metres, its scale, and its uncertainty budget."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Image
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput, NothingToMeasure, Seen
from rigtwin.lab.quantity import (
    Check,
    failed,
)
from rigtwin.lab.records import Profile
from rigtwin.measure.bulk.checks import size_unseen
from rigtwin.measure.geometry.camera_roll import roll_check
from rigtwin.measure.packing.bed_profile import NEARER, SAME_PLANE, Observation
from rigtwin.measure.packing.checks import STATED, gauge_pitch, picture_checks
from rigtwin.measure.packing.cylinder import Bed, NoBed, Stated, find_bed
from rigtwin.measure.packing.evaluate import BEAD_UNCERTAINTY

# relative standard uncertainty of a scale from a length in the plane of the axis: it fills most of a photo, as 940 px
# between two points of STATED_SIGMA each
AXIS_LENGTH_UNCERTAINTY = 0.003

WALL_UNCERTAINTY = 0.006  # relative standard uncertainty of a scale from the cylinder's inner walls

GAUGE_UNCERTAINTY = 0.002  # relative standard uncertainty of a scale from a gauge in the plane of the axis


def observe_photo(
    photo: Path, image: Image, camera: Camera, cylinder: float | None, bead: float | None
) -> tuple[Bed, Observation, dict[str, Any], list[Check]]:
    places = Stated(camera.cylinder, camera.floor)
    bed = find_bed(image, cylinder=cylinder, bead=bead, roll=camera.roll, region=camera.region, stated=places)
    if isinstance(bed, NoBed):
        advice = [
            *(["the walls with --cylinder x1,y1,x2,y2"] if camera.cylinder is None else []),
            *(["the part with the bed with --region x,y,width,height"] if camera.region is None else []),
        ]
        advised = bed.advice or (f"state {' or '.join(advice)}" if advice else "give a sharper photo")
        raise NothingToMeasure(
            f"{photo}: no bed of beads: {bed.why}; {advised}.",
            Seen(medium=photo, marks=bed.marks),
        )
    scale, uncertainty, source = _scale(photo, bed, camera, cylinder, bead)
    x, above = bed.outline
    stated = bed.stated.walls is not None or bed.stated.floor is not None
    if bed.gauge is not None and source == "gauge" and not stated:
        height = bed.gauge.reading(bed.gauge_rows(x, above)) * 1e-3
        floor_uncertainty, floor_from = 0.15e-3, "gauge"
    else:
        height = above * scale
        floor_uncertainty = bed.floor_sigma * scale
        floor_from = "stated" if stated else "lowest grains"
    grain = 2 * bed.bead_radius * scale
    raised, spread = (part * grain for part in bed.raised())
    profile = Profile(x * scale, height - raised, np.full(len(x), 0.8 * scale), view=photo.stem)
    mean = float(np.nanmean(height))
    uncertainties = {
        "scale": uncertainty * mean,
        "floor": floor_uncertainty,
        "outline level": bed.outline_uncertainty * scale,
        "camera height": spread,
    }
    view = {
        "scale_m_per_px": scale * bed.silhouette.zoom,
        "scale_std_rel": uncertainty,
        "scale_from": source,
        "floor_from": floor_from,
        "camera_roll_deg": math.degrees(bed.roll),
        "bead_radius_px": bed.bead_radius / bed.silhouette.zoom,
    } | camera.stated_view
    checks = picture_checks(bed, scale, source, cylinder, bead)
    if camera.roll is not None and bed.roll_seen is not None:
        checks.append(roll_check(camera.roll, *bed.roll_seen, "the upright edges in the picture show"))
    misfit = failed(checks, STATED)
    observation = Observation(
        profile,
        uncertainties,
        bed.flaw,
        misfit,
        _unconfirmed(bed, source, cylinder, bead),
        2 * bed.bead_seen * scale / NEARER if math.isfinite(bed.bead_seen) else None,
    )
    return bed, observation, view, checks


def _unconfirmed(bed: Bed, source: str, cylinder: float | None, bead: float | None) -> str:
    """Warning that the results depend on one stated size that nothing else in the picture confirms, or ""."""
    if bed.gauge is not None:
        return ""  # the gauge's graduations are a known length
    if not math.isfinite(bed.bead_seen):
        what, given = "bed height and, by its third power, bulk density depend", f"the scale from {source}"
        return size_unseen(what, given, "no round bead shows its size: photograph a length gauge beside the cylinder")
    if source == "cylinder diameter" and bead is None:
        what, advice = "bed height and, by its third power, bulk density depend", "--bead-diameter"
        given = f"--cylinder-diameter {(cylinder or 0) * 1e3:g} mm"
    elif source == "bead diameter":
        what, advice, given = "bed height depends", "--cylinder-diameter", f"--bead-diameter {(bead or 0) * 1e3:g} mm"
    elif bead is None and cylinder is None:
        what, advice, given = "bed height depends", "--cylinder-diameter or --bead-diameter", "the given scale"
    else:
        return ""
    return size_unseen(what, given, f"give {advice} too, or photograph a length gauge beside the cylinder")


def _scale(
    photo: Path, bed: Bed, camera: Camera, cylinder: float | None, bead: float | None
) -> tuple[float, float, str]:
    """Scale [m/px] in the plane of the axis at mid-height, its relative standard uncertainty, and its source."""
    if camera.given_scale is not None:
        return (
            camera.given_scale / bed.silhouette.zoom,
            camera.scale_uncertainty(AXIS_LENGTH_UNCERTAINTY),
            camera.scale_from,
        )
    wall = None if cylinder is None else cylinder / bed.width
    seen = 0.0 if camera.cylinder is None else math.sqrt(2) * bed.stated.sigma / bed.width
    uncertainty = math.hypot(WALL_UNCERTAINTY, bed.wall_sigma, seen)
    if bed.gauge is not None:
        pitch = gauge_pitch(bed)
        if wall is None or abs(pitch / wall - 1) < SAME_PLANE:
            return pitch, GAUGE_UNCERTAINTY, "gauge"
        # rectangular distribution: the true scale lies anywhere between the two
        uncertainty = math.hypot(uncertainty, (pitch / wall - 1) / math.sqrt(3))
    if wall is not None:
        return wall, uncertainty, "cylinder diameter"
    if bead is not None:
        return NEARER * bead / (2 * bed.bead_seen), BEAD_UNCERTAINTY, "bead diameter"
    raise BadInput(
        f"{photo}: no scale; give --cylinder-diameter, --scale, or a photo with a graduated gauge beside the cylinder."
    )
