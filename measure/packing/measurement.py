"""Measure a cylinder filled with beads from photos: bed height and bulk density (Hlosta et al. 2020, fig. 4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rigtwin.lab.arrays import Image
from rigtwin.lab.camera import Camera, camera_for_each
from rigtwin.lab.checksums import all_different, sha256
from rigtwin.lab.errors import BadInput
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import (
    Measurement,
)
from rigtwin.lab.tracked.read import read_profiles, scale_used
from rigtwin.lab.tracked.table import TableOptions, is_table
from rigtwin.lab.units import positive
from rigtwin.measure.media.photo import all_show_different, read_photo
from rigtwin.measure.packing.bed_profile import Observation
from rigtwin.measure.packing.checks import BY_HAND
from rigtwin.measure.packing.cylinder import Bed
from rigtwin.measure.packing.evaluate import evaluate_views
from rigtwin.measure.packing.figures import picture_marks, write_pictures
from rigtwin.measure.packing.observe import observe_photo
from rigtwin.measure.refusal import shows_refusals

# ---------------------------------------------------------------------------------------------------- media -> record


@shows_refusals
def measure(
    photos: Sequence[Path],
    camera: Camera | Sequence[Camera],
    *,
    cylinder_diameter: float | None,
    total_mass: float | None = None,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
    spheres: bool = True,
    table: TableOptions | None = None,
    observe_each: Callable[..., Any] = observe_photo,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure bed height and bulk density from photos of one bed.

    Parameters
    ----------
    photos : sequence of Path
        One photo per view.  A table is read as a finished profile (`rigtwin.lab.tracked`).
    camera : Camera or sequence of Camera
        Scale, roll, region and other settings of the camera; one for all photos, or one for each.
    cylinder_diameter : float or None
        Inner diameter of the cylinder [m].
    total_mass : float, optional
        Mass of all beads [kg]; needed for the bulk density.
    bead_diameter : float, optional
        Bead diameter [m]; where it is not given, the apparent diameter in the picture is used.
    bead_density : float, optional
        Density of a bead [kg/m^3]; used to check the bulk density.
    spheres : bool
        Whether the beads are equal spheres; other shapes have a wider range of possible solid fractions.
    table : TableOptions, optional
        Columns of a table.
    observe_each : callable, optional
        What observes one photo; `rigtwin.measure.packing.observe.observe_photo`, or the same with a memory.
    out : Path, optional
        Folder for overlay, plot and profile table.
    progress : Progress
        Callback that shows the progress.

    Returns
    -------
    Measurement
        ``bed_height`` [m] by the methods "surface bead tops" (first), "mean surface" and "outline", and
        ``bulk_density`` [kg/m^3] by the first two.  Its profiles run across the cylinder: x = 0 on the axis, heights
        above the floor [m].

    Raises
    ------
    BadInput
        If no photo is given, two photos are the same file, or no source of scale is available.
    NothingToMeasure
        If no bed is found in a photo.

    Notes
    -----
    The surface of a bed has a thickness of about one bead, so three heights are reported:

    - "surface bead tops" is the mean top of the surface beads.  A surface bead has no higher bead whose centre lies
      within 0.8 diameters horizontally.  A reader of a gauge sees this height.
    - "mean surface" is the mean height of the surface including its pits, half a bead diameter lower.  The volume of
      the bed follows from it.
    - "outline" is what a photo shows: for every x the highest bead along the line of sight.  It lies about 0.3
      diameters
      above the bead tops.  `evaluate` measures it and subtracts the offsets of the other two.

    If graduations of a gauge beside the cylinder are visible they give scale and zero.  Otherwise the inner diameter of
    the cylinder gives the scale, and the lowest beads give the floor.

    References
    ----------
    Hlosta et al. 2020, fig. 4.
    """
    if not photos:
        raise BadInput("measure packing: no photo given; name one or more photos of the cylinder.")
    all_different(photos)
    positive(cylinder_diameter=cylinder_diameter)
    cameras = camera_for_each(camera, photos)
    pictures = {photo: read_photo(photo, cameras[photo]) for photo in photos if not is_table(photo)}
    all_show_different({photo: picture for photo, (picture, _) in pictures.items()})
    seen, views, checks = [], [], []
    beds: list[tuple[Image, Bed] | None] = []
    warnings: list[str] = []
    understood: dict[str, Any] = {}
    for number, photo in enumerate(photos):
        progress("looking for the bed", number, len(photos))
        if is_table(photo):
            read = read_profiles(photo, table, scale=cameras[photo].given_scale)
            if len(read.profiles) > 1:
                raise BadInput(f"{photo}: holds {len(read.profiles)} profiles over time; give that of the bed at rest.")
            understood = understood or read.understood.to_json()
            seen.append(Observation(replace(read.profiles[0], view=photo.stem)))
            by_table = {"scale_m_per_px": None, "scale_from": "profile table", "camera_roll_deg": None}
            views.append({**by_table, **scale_used(read, cameras[photo])})
            beds.append(None)
            continue
        image, odd = pictures[photo]
        warnings += odd
        bed, observation, view, found = observe_each(photo, image, cameras[photo], cylinder_diameter, bead_diameter)
        seen.append(observation)
        views.append(view)
        checks += found
        beds.append((image, bed))
    progress("looking for the bed", len(photos), len(photos))
    evaluation = evaluate_views(seen, cylinder_diameter, total_mass, bead_diameter, bead_density, BY_HAND, spheres)
    measurement = Measurement(
        rig="packing",
        source=photos[0],
        source_sha256=sha256(photos[0]),
        quantities=evaluation.quantities,
        checks=(*checks, *evaluation.checks),
        warnings=(*warnings, *evaluation.warnings),
        camera=views[0] if len(views) == 1 else {**views[0], "views": views},
        profiles=tuple(each.profile for each in seen),
        table=understood,
        marks=tuple(
            mark for view, each in enumerate(beds) if each is not None for mark in picture_marks(each[1], view)
        ),
    )
    if out is None:
        return measurement
    files: dict[str, Path] = {}
    for number, (photo, each, pair) in enumerate(zip(photos, seen, beds, strict=True)):
        written = write_pictures(out, photo.stem, each.profile, pair, measurement)
        files.update(written if number == 0 else {f"{name}_{number + 1}": path for name, path in written.items()})
    return replace(measurement, files=files)
