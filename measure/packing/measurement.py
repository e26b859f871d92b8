"""A cylinder filled with beads, photographed from the side: bed height and bulk density (Hlosta et al. 2020, fig. 4).

The surface of a bed is a band, not a line.  `bed_height` by the method "surface bead tops", the first, is the mean top
of the beads that form the surface, those with no higher bead whose centre lies within 0.8 diameters sideways of their
own: what is read at a gauge.  "mean surface" is the mean height of the surface with its pits, half a bead lower, to
which the bed fills the cylinder; a bead that is not stated is taken as large as beads look.  What a photo shows is the
"outline": at every place across the cylinder the highest bead along the line of sight, some 0.3 diameters above the
tops.  `evaluate` reads the outline and takes that off.  The bulk density is told for both of the first.

A profile of `measure` runs across the cylinder, x = 0 on its axis; heights are above the cylinder's floor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rigtwin.lab.arrays import Image
from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import all_different, sha256
from rigtwin.lab.errors import BadInput
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import (
    Measurement,
)
from rigtwin.lab.records import read_profile
from rigtwin.measure.media.photo import read_photo
from rigtwin.measure.packing.bed_profile import Observation
from rigtwin.measure.packing.checks import BY_HAND
from rigtwin.measure.packing.cylinder import Bed
from rigtwin.measure.packing.evaluate import evaluate_views
from rigtwin.measure.packing.observe import observe

# ---------------------------------------------------------------------------------------------------- media -> record


def measure(
    photos: Sequence[Path],
    camera: Camera,
    *,
    cylinder_diameter: float | None,
    total_mass: float | None = None,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
    spheres: bool = True,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Bed height and bulk density from photos of one bed (one per view); a ``.csv`` is a profile that is ready.

    A gauge beside the cylinder gives scale and zero where its graduations are seen; else the inner diameter of the
    cylinder gives the scale, and the lowest beads the floor.  Where `spheres` is false, beads may fill more or less of
    the bed than spheres of one size can.  Raises `NothingToMeasure` when no bed is seen.
    """
    if not photos:
        raise BadInput("measure packing: no photo given; name one or more photos of the cylinder.")
    all_different(photos)
    if cylinder_diameter is not None and not (math.isfinite(cylinder_diameter) and cylinder_diameter > 0):
        raise BadInput(f"measure packing: cylinder_diameter must be positive, got {cylinder_diameter:g}.")
    seen, views, checks = [], [], []
    beds: list[tuple[Image, Bed] | None] = []
    warnings: list[str] = []
    for number, photo in enumerate(photos):
        progress("looking for the bed", number, len(photos))
        if photo.suffix.lower() == ".csv":
            seen.append(Observation(replace(read_profile(photo), view=photo.stem)))
            views.append({"scale_m_per_px": None, "scale_from": "profile table", "camera_roll_deg": None})
            beds.append(None)
            continue
        image, odd = read_photo(photo, camera)
        warnings += odd
        bed, observation, view, found = observe(photo, image, camera, cylinder_diameter, bead_diameter)
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
    )
    if out is None:
        return measurement
    from rigtwin.measure.packing.figures import write_pictures

    files: dict[str, Path] = {}
    for number, (photo, each, pair) in enumerate(zip(photos, seen, beds, strict=True)):
        written = write_pictures(out, photo.stem, each.profile, pair, measurement)
        files.update(written if number == 0 else {f"{name}_{number + 1}": path for name, path in written.items()})
    return replace(measurement, files=files)
