"""Measure a heap on a round base from photos taken from the side: graphical and geometric angle of repose."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rigtwin.lab.camera import Camera, camera_for_each
from rigtwin.lab.checksums import all_different, sha256
from rigtwin.lab.errors import BadInput, Mark
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.tracked.table import TableOptions, is_table
from rigtwin.measure.media.photo import all_show_different, read_photo
from rigtwin.measure.pile.evaluate import evaluate_views
from rigtwin.measure.pile.observe import NO_SCALE, Draw, observe_photo, observe_table
from rigtwin.measure.refusal import shows_refusals


@shows_refusals
def measure(
    photos: Sequence[Path],
    camera: Camera | Sequence[Camera],
    *,
    base_diameter: float | None = None,
    bead_diameter: float | None = None,
    table: TableOptions | None = None,
    observe_each: Callable[..., Any] = observe_photo,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure angles of repose, height and width from photos of one heap.

    Parameters
    ----------
    photos : sequence of Path
        One photo per view.  A table is read as a finished profile (`rigtwin.lab.tracked`).
    camera : Camera or sequence of Camera
        Scale, roll, region and other settings of the camera; one for all photos, or one for each.
    base_diameter : float, optional
        Diameter of the disc that the heap stands on [m].
    bead_diameter : float, optional
        Bead diameter [m].
    table : TableOptions, optional
        Columns of a table.
    observe_each : callable, optional
        What observes one photo; `rigtwin.measure.pile.observe.observe_photo`, or the same with a memory.
    out : Path, optional
        Folder for overlay, plot and profile table.
    progress : Progress
        Callback that shows the progress.

    Returns
    -------
    Measurement
        ``angle_of_repose_graphical`` and ``angle_of_repose_geometric`` [deg] per side, as mean, and over all views;
        ``pile_height``, ``pile_base_width`` and ``pile_tip_radius`` [m] where a scale is known.

    Raises
    ------
    BadInput
        If no photo is given, two photos are the same file, or beads are as wide as the base.
    NothingToMeasure
        If no heap is found in a photo or profile.

    Notes
    -----
    Angles need no scale.  Lengths need `base_diameter`, `bead_diameter` or a scale in `camera`.
    """
    if not photos:
        raise BadInput("measure pile: no photo given; name one or more photos of the heap.")
    all_different(photos)
    if base_diameter is not None and bead_diameter is not None and bead_diameter >= base_diameter:
        raise BadInput(
            f"beads of {bead_diameter * 1e3:g} mm make no heap on a base of {base_diameter * 1e3:g} mm; "
            "check the diameters of base and bead."
        )
    cameras = camera_for_each(camera, photos)
    pictures = {photo: read_photo(photo, cameras[photo]) for photo in photos if not is_table(photo)}
    all_show_different({photo: picture for photo, (picture, _) in pictures.items()})
    observations, views, draws = [], [], []
    marks: list[Mark] = []
    for number, (photo, name) in enumerate(zip(photos, _names(photos), strict=True)):
        progress("looking for the heap", number, len(photos))
        if is_table(photo):
            seen, view, marked, draw = observe_table(photo, name, cameras[photo], table, base_diameter)
        else:
            seen, view, marked, draw = observe_each(
                photo, *pictures[photo], name, cameras[photo], base_diameter, bead_diameter
            )
        observations.append(seen)
        views.append(view)
        draws.append(draw)
        marks += [] if marked is None else marked(number)
    progress("looking for the heap", len(photos), len(photos))
    understood: dict[str, Any] = next((tabled for view in views if (tabled := view.pop("table", None))), {})
    scaled = all(view["scale_from"] != NO_SCALE for view in views)
    evaluation = evaluate_views(observations, base_diameter if scaled else None, bead_diameter if scaled else None)
    warnings = list(evaluation.warnings)
    quantities = evaluation.quantities
    if not scaled:
        quantities = tuple(quantity for quantity in quantities if quantity.unit != "m")
        advice = [
            *(["--base-diameter"] if base_diameter is None else []),
            *(["--bead-diameter"] if bead_diameter is None else []),
            *(["--base x1,y1,x2,y2, as no base was found"] if base_diameter is not None else []),
            "--scale",
        ]
        warnings.append(f"scale: not known, so heights and widths are omitted; give {' or '.join(advice)}.")
    return Measurement(
        rig="pile",
        source=photos[0],
        source_sha256=sha256(photos[0]),
        quantities=quantities,
        checks=evaluation.checks,
        warnings=tuple(warnings),
        camera=views[0] if len(views) == 1 else {**views[0], "views": views},
        table=understood,
        profiles=tuple(seen.profile for seen in observations) if scaled else (),
        files={} if out is None else _drawn(draws, out),
        marks=tuple(marks),
    )


def _drawn(draws: Sequence[Draw], out: Path) -> dict[str, Path]:
    """Draw the figures of all views, after all of them were read: a refusal leaves no partial output."""
    files: dict[str, Path] = {}
    out.mkdir(parents=True, exist_ok=True)
    for number, draw in enumerate(draws):
        written = draw(out)
        files.update(written if number == 0 else {f"{name}_{number + 1}": path for name, path in written.items()})
    return files


def _names(photos: Sequence[Path]) -> list[str]:
    """Name of every view and its files: the stem of the photo, numbered where an earlier photo has the same stem."""
    names: list[str] = []
    for photo in photos:
        taken = (f"{photo.stem}-{number}" for number in itertools.count(2))
        names.append(photo.stem if photo.stem not in names else next(name for name in taken if name not in names))
    return names
