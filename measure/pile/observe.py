"""Observe one photo or table of a heap: its profile, variants of it for the uncertainty budget, scale and checks."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import FOCAL_UNCERTAINTY, Camera
from rigtwin.lab.errors import BadInput, Mark, NothingToMeasure, Seen
from rigtwin.lab.records import Profile
from rigtwin.lab.tracked.read import read_profiles, scale_used
from rigtwin.lab.tracked.table import TableOptions
from rigtwin.measure.bulk.outline import Disc, Silhouette, View
from rigtwin.measure.geometry.camera_roll import roll_check
from rigtwin.measure.media.picture_size import header_of
from rigtwin.measure.pile import repose_angles
from rigtwin.measure.pile.checks import (
    BASE_UNCERTAINTY,
    base_check,
    size_checks,
)
from rigtwin.measure.pile.evaluate import Observation, evaluate_views
from rigtwin.measure.pile.figures import picture_marks, write_pictures
from rigtwin.measure.pile.silhouette import find_heap, undo_view

Draw = Callable[[Path], dict[str, Path]]
"""Writes the pictures of a view into a folder."""

Marked = Callable[[int], tuple[Mark, ...]]
"""Where things were found in a photo, given the number of its view."""

NO_SCALE = "not known"
NO_BASE = "no base disc was found, so the base line runs through the outermost grains; --base states it"

STATED_FOCAL_UNCERTAINTY = 0.1  # standard deviation of the logarithm of a focal length stated in the photo's EXIF data

FULL_FRAME_DIAGONAL = 43.27  # [mm]

EXIF_IFD, FOCAL_LENGTH_35MM = 0x8769, 0xA405  # EXIF 2.32, tables 4 and 9

BEAD_UNCERTAINTY = 0.06  # relative standard uncertainty of a scale from beads

STEEPEST_VIEW = 10.0  # [deg], of the line of sight; measured angles are 1 degree too steep from 12, 2 degrees from 20

# clearness of the lower rim of the base: 0.6 to 1 in 22 photos with right base lines, 0.3 where one was wrong
LEAST_RIM = 0.5

UNSURE = 0.2  # share of the outline that another threshold moves by more than a bead radius


def observe_table(
    path: Path, name: str, camera: Camera, options: TableOptions | None, base_diameter: float | None
) -> tuple[Observation, dict[str, Any], None, Draw]:
    read = read_profiles(path, options, scale=camera.given_scale, heap=True)
    if len(read.profiles) > 1:
        raise BadInput(f"{path}: holds {len(read.profiles)} profiles over time; give the one of the heap at rest.")
    profile = replace(read.profiles[0], view=name)
    if base_diameter is not None:
        profile = replace(profile, base=(-base_diameter / 2, base_diameter / 2))

    def draw(out: Path) -> dict[str, Path]:
        from rigtwin.measure.pile.figures import write_plot

        return {"plot": write_plot(out / f"{name}-plot.svg", profile, base_diameter, None, "m", camera.flank)}

    view = {
        "scale_m_per_px": None,
        "scale_from": "profile table",
        "camera_roll_deg": None,
        **scale_used(read, camera),
        "table": read.understood.to_json(),
    }
    return Observation(profile, flank=camera.flank), view, None, draw


def observe_photo(
    photo: Path,
    image: Image,
    odd: tuple[str, ...],
    name: str,
    camera: Camera,
    base_diameter: float | None,
    bead_diameter: float | None,
) -> tuple[Observation, dict[str, Any], Marked, Draw]:
    ratio = base_diameter / bead_diameter if base_diameter and bead_diameter else None
    focal_length = _focal_length(photo, image)
    look = partial(find_heap, image, roll=camera.roll, region=camera.region, focal_length=focal_length)
    if camera.base is not None:
        look = partial(look, base=camera.base, flank=camera.flank)
    try:
        found = _sized(look, ratio)
    except NothingToMeasure as nothing:
        advice = [
            "a side view of the whole heap",
            *(["its place with --region x,y,width,height"] if camera.region is None else []),
            *(["the line it stands on with --base x1,y1,x2,y2"] if camera.base is None else []),
        ]
        turned = _quarter_turned(image, camera, focal_length, ratio)
        raise NothingToMeasure(
            f"{photo}: no heap was found: {nothing.message}; {turned or 'give ' + ' or '.join(advice)}.",
            replace(nothing.seen or Seen(), medium=photo),
        ) from None
    if found.unconfirmed:
        odd = (*odd, f"the stated base line is not confirmed: {found.unconfirmed}; check it in the overlay.")
    scale, scale_from = _scale(found, camera, base_diameter, bead_diameter)
    unit = scale if scale is not None else 1.0
    profile = _profile(found, found.view, found.height, unit, name)
    sizes, unconfirmed = size_checks(found, scale, scale_from, bead_diameter, base_diameter)
    if base_diameter is not None and scale is not None and found.view.radius > 0 and scale_from != "base diameter":
        across = 2 * found.view.radius * scale
        sizes = (*sizes, base_check(across, _scale_uncertainty(found, scale_from, camera), base_diameter, scale_from))
    if camera.roll is not None and found.view.radius > 0:
        seen_turn = found.view.roll, found.base_line_uncertainty[1]
        sizes = (*sizes, roll_check(camera.roll, *seen_turn, "the base line of the angles shows"))
    seen = Observation(
        profile,
        _variants(found, unit, name, FOCAL_UNCERTAINTY if focal_length is None else STATED_FOCAL_UNCERTAINTY),
        _flaw_of_picture(found) or _ignored(found, camera),
        2 * found.bead_radius * unit,
        sizes,
        _scale_uncertainty(found, scale_from, camera),
        unconfirmed,
        odd,
        camera.flank,
        NO_BASE if found.view.radius == 0 else _faint_rim(found),
    )
    view = {
        "scale_m_per_px": None if scale is None else scale * found.zoom,
        "scale_std_rel": None if scale is None else seen.scale_uncertainty,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(found.view.roll),
        "looking_down_deg": found.view.looking_down,
        "base_found": found.disc is not None,
    } | camera.stated_view

    def draw(out: Path) -> dict[str, Path]:
        evaluation = evaluate_views([seen], base_diameter if scale else None, bead_diameter if scale else None)
        return write_pictures(
            out, name, image, found, profile, evaluation, base_diameter, scale, seen.grain, camera.flank
        )

    return seen, view, partial(picture_marks, found, profile, scale, camera.flank, seen.grain), draw


def _sized(look: Callable[..., Silhouette], beads_across: float | None) -> Silhouette:
    """The heap with beads as small as stated against the base, or where none is found so, as small as they are seen.

    A stated size that is wrong by a factor then fails the check of the sizes instead of hiding the heap.
    """
    try:
        return look(beads_across=beads_across)
    except NothingToMeasure:
        if beads_across is None:
            raise
        try:
            return look(beads_across=None)
        except NothingToMeasure:
            pass
        raise


def _quarter_turned(image: Image, camera: Camera, focal_length: float | None, ratio: float | None) -> str:
    """Advice for a refused photo that shows a heap on a base if it is turned by a quarter; empty for any other.

    Not tried where places of the picture are stated.
    """
    if camera.region or camera.stated_view:
        return ""
    for quarters, side in ((1, "left"), (3, "right")):
        with suppress(NothingToMeasure):
            other = np.ascontiguousarray(np.rot90(image, quarters))
            # a heap without a base is easily seen in a picture that lies on its side
            if find_heap(other, focal_length=focal_length, beads_across=ratio).disc is not None:
                return f"turn the photo by a quarter to the {side}, then a heap is found"
    return ""


def _focal_length(photo: Path, image: npt.NDArray[np.uint8]) -> float | None:
    """Focal length [px] from the EXIF 35 mm equivalent, which refers to the picture's diagonal (CIPA DCG-001)."""
    try:
        with header_of(photo) as file:
            equivalent = float(file.getexif().get_ifd(EXIF_IFD).get(FOCAL_LENGTH_35MM) or 0)
    except MemoryError:
        raise
    except Exception:  # a format that only OpenCV reads, or damaged metadata
        return None
    if not (math.isfinite(equivalent) and equivalent > 0):
        return None
    return equivalent / FULL_FRAME_DIAGONAL * math.hypot(*image.shape[:2])


def _scale(
    found: Silhouette, camera: Camera, base_diameter: float | None, bead_diameter: float | None
) -> tuple[float | None, str]:
    """Scale [m/px] of the analysed picture in the plane of the base's axis, and its source."""
    if camera.given_scale is not None:
        return camera.given_scale / found.zoom, camera.scale_from
    if base_diameter is not None and found.view.radius > 0:
        return base_diameter / (2 * found.view.radius), "base diameter"
    if bead_diameter is not None and math.isfinite(found.bead_seen):
        return bead_diameter / (2 * found.bead_radius), "bead diameter"
    return None, NO_SCALE


def _scale_uncertainty(found: Silhouette, scale_from: str, camera: Camera) -> float:
    """Relative standard uncertainty of the scale; 0 if there is no scale."""
    if scale_from == "base diameter" and found.stated is not None:
        return _ends_uncertainty(found) / found.view.radius
    by_sizes = {"base diameter": BASE_UNCERTAINTY, "bead diameter": BEAD_UNCERTAINTY, NO_SCALE: 0.0}
    return by_sizes.get(scale_from, camera.scale_uncertainty())


def _ends_uncertainty(found: Silhouette) -> float:
    """Standard uncertainty of half the distance of the base's ends [px]."""
    end = found.stated if found.stated is not None else found.disc.sigma if found.disc is not None else 0.0
    return end / math.sqrt(2)


def _profile(found: Silhouette, view: View, height: Array, unit: float, name: str) -> Profile:
    """The outline as a vertical section through the heap, in metres (px if `unit` is 1)."""
    seen = np.isfinite(height)
    x, level = found.x[seen], height[seen]
    raw = repose_angles.find_parts(Profile(x, level, level), None, 2 * found.bead_radius)
    if raw is not None:
        lines = [repose_angles.flank_line(raw, side) for side in repose_angles.SIDES]
        left, right = (max(math.tan(math.radians(line.angle)), 0.1) if line else 0.5 for line in lines)
        x, level = undo_view(x, level, view, (left, right))
    order = np.argsort(x)
    x, level = x[order], level[order]
    base = (-view.radius * unit, view.radius * unit) if view.radius > 0 else None
    return Profile(x * unit, level * unit, np.full(len(x), found.sigma * unit), base, name)


def _variants(
    found: Silhouette, unit: float, name: str, focal_uncertainty: float
) -> dict[str, tuple[Profile, Profile]]:
    """Profiles of other readings of the photo, each pair one standard deviation to either side."""
    view, height = found.view, found.height
    raised, turned = found.base_line_uncertainty
    pairs = {
        "outline level": ((view, found.looser), (view, found.stricter)),
        "base line height": ((view, height + raised), (view, height - raised)),
        "base line angle": ((view, height + turned * found.x), (view, height - turned * found.x)),
    }
    if found.disc is not None:
        factor = math.exp(focal_uncertainty)
        (far, far_lift), (near, near_lift) = (
            _other_distance(view, found.disc, stretch) for stretch in (factor, 1 / factor)
        )
        pairs["camera distance"] = (far, height + far_lift), (near, height + near_lift)
    if view.radius > 0:
        wider = _ends_uncertainty(found)
        pairs["base ends"] = (
            (replace(view, radius=view.radius + wider), height),
            (replace(view, radius=view.radius - wider), height),
        )
    if found.disc is None:
        distance = view.camera_distance
        if math.isfinite(distance):
            seen, off = view.looking_down, found.depression_sigma
            lowest, highest = (distance * math.tan(math.radians(down)) for down in (max(seen - off, 0.0), seen + off))
            pairs["camera height"] = (
                (replace(view, camera_height=lowest), height),
                (replace(view, camera_height=highest), height),
            )
            stretch = math.exp(focal_uncertainty)
            pairs["camera distance"] = (
                (replace(view, camera_distance=distance * stretch, camera_height=view.camera_height * stretch), height),
                (replace(view, camera_distance=distance / stretch, camera_height=view.camera_height / stretch), height),
            )
    return {
        part: (_profile(found, *first, unit, name), _profile(found, *second, unit, name))
        for part, (first, second) in pairs.items()
    }


def _other_distance(view: View, disc: Disc, factor: float) -> tuple[View, float]:
    """View with the camera `factor` times as far away, and the increase of heights that follows [px].

    The lower rim and the front of the face are observed.  From further away the lower rim bulges less beyond the upper
    one, so the upper rim must bulge more, and the axis meets the base plane elsewhere (see `Disc`).
    """
    near, other = disc.nearness, disc.nearness / factor
    deepening, changed = near / (1 - near * near), other / (1 - other * other)
    thickness = disc.thickness * (1 + deepening) / (1 + changed)
    bulge = max(disc.bulge + disc.thickness * deepening - thickness * changed, 0.0)
    lift = (disc.thickness - thickness) + near * disc.bulge - other * bulge
    radius = disc.half_width * math.sqrt(1 - other * other)
    seen = replace(view, radius=radius, camera_height=bulge / changed, camera_distance=radius / other)
    return seen, lift


def _flaw_of_picture(found: Silhouette) -> str:
    if found.cut_off:
        return "the outline touches the edge of the picture"
    if found.contradicted:
        return f"an end of the stated base lies {found.contradicted:.0f} px from that of the base as seen: check --base"
    if found.view.looking_down > STEEPEST_VIEW:
        down = found.view.looking_down
        return (
            f"the camera looks down by {down:.0f} degrees and sees no vertical section; photograph from less than "
            f"{STEEPEST_VIEW:.0f}"
        )
    apart = np.abs(found.looser - found.stricter)
    if float(np.nanmean(apart > found.bead_radius)) > UNSURE:
        return "more than a fifth of the outline depends on the threshold that separates beads from the background"
    return ""


def _faint_rim(found: Silhouette) -> str:
    if found.disc is None or found.disc.lower_rim >= LEAST_RIM:
        return ""
    return (
        f"the lower rim of the base is faint (clearness {found.disc.lower_rim:.2f}, {LEAST_RIM:g} is needed), and the "
        "base line may lie too high or too low; --base states it"
    )


def _ignored(found: Silhouette, camera: Camera) -> str:
    """Reason if the outline runs through what is to be ignored, where it is not seen, or ""."""
    seen = np.isfinite(found.height)
    points = found.view.to_picture(found.x[seen], found.height[seen]) / found.zoom
    for x, y, width, height in camera.ignore:
        inside = np.all((points > (x, y)) & (points < (x + width, y + height)), axis=1)
        if np.sum(inside) > 2 * found.bead_radius:
            return f"the outline runs through --ignore {x:g},{y:g},{width:g},{height:g}, where the heap is not seen"
    return ""
