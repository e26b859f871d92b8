"""Figures of a pile measurement: the photo with outline, base line and flank lines, and the profile with its angles."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import Flank
from rigtwin.lab.errors import Mark
from rigtwin.lab.quantity import Evaluation, Quantity
from rigtwin.lab.records import Profile, write_profile
from rigtwin.measure import drawing
from rigtwin.measure.bulk.outline import Silhouette
from rigtwin.measure.pile import repose_angles


def write_pictures(
    folder: Path,
    stem: str,
    photo: Image,
    found: Silhouette,
    profile: Profile,
    evaluation: Evaluation,
    base_diameter: float | None,
    scale: float | None,
    grain: float | None,
    flank: Flank | None,
) -> dict[str, Path]:
    """Write overlay, plot and, where the scale is known, the profile as CSV; return the paths by kind."""
    still = folder / f"{stem}-overlay.png"
    drawing.save_picture(still, _overlay(photo, found, profile, evaluation, scale or 1.0, grain, flank))
    unit = "m" if scale is not None else "px"
    width = base_diameter if scale is not None else None
    files = {
        "overlay": still,
        "still": still,
        "plot": write_plot(folder / f"{stem}-plot.svg", profile, width, grain, unit, flank),
    }
    if scale is not None:
        files["record"] = folder / f"{stem}-profile.csv"
        write_profile(files["record"], profile)
    return files


def picture_marks(
    found: Silhouette, profile: Profile, scale: float | None, flank: Flank | None, grain: float | None, view: int
) -> tuple[Mark, ...]:
    """Outline, base line and both constructions of the angle of repose in a photo, the `view`-th of its repetition.

    The graphical angle is that of the lines along the flanks, the geometric one that from the feet to the apex.
    """
    unit, line = scale or 1.0, found.in_photo
    reach = found.view.radius or float(np.abs(found.x[np.isfinite(found.height)]).max())
    marks = [
        Mark("outline", line(found.x, found.height), kind="outline", view=view),
        Mark("base", line(np.array([-reach, reach]), np.zeros(2)), kind="base", view=view),
    ]
    heap = repose_angles.find_parts(profile, None, grain)
    if heap is None:
        return tuple(marks)
    sides = repose_angles.free_flanks(heap, flank)
    for side in sides:
        along = repose_angles.flank_line(heap, side)
        if along is not None:
            ends = np.array([along.inner, along.outer])
            points = line(ends / unit, _on_line(along, side, ends) / unit)
            marks.append(Mark(f"{side} flank {along.angle:.1f}°", points, kind="graphical", view=view))
    feet = [foot for foot, side in zip(heap.feet, repose_angles.SIDES, strict=True) if side in sides]
    for foot in feet:
        points = line(np.array([foot, heap.apex[0]]) / unit, np.array([0.0, heap.apex[1]]) / unit)
        marks.append(Mark("from foot to apex", points, kind="geometric", view=view))
    return tuple(marks)


def write_plot(
    path: Path,
    profile: Profile,
    base_diameter: float | None,
    grain: float | None,
    unit: str,
    flank: Flank | None = None,
) -> Path:
    """Plot the profile with base, apex, feet and flank lines, in mm (px where no scale is known)."""
    from matplotlib.figure import Figure

    factor, label = (1e3, "mm") if unit == "m" else (1.0, "px")
    figure = Figure(figsize=(7.5, 3.6))
    axes = figure.add_axes((0.08, 0.14, 0.91, 0.84))
    axes.fill_between(profile.x * factor, profile.height * factor, color="#e6d9b8", linewidth=0)
    axes.plot(profile.x * factor, profile.height * factor, color="#555555", linewidth=1, label="outline")
    heap = repose_angles.find_parts(profile, base_diameter, grain)
    if heap is not None:
        axes.axhline(0, color="black", linewidth=0.8)
        axes.plot(heap.apex[0] * factor, heap.apex[1] * factor, "v", color="#d55e00", label="apex")
        axes.plot([foot * factor for foot in heap.feet], [0, 0], "|", color="#d55e00", markersize=12, label="feet")
        colours = {"left": "#0072b2", "right": "#009e73"}
        for side in repose_angles.free_flanks(heap, flank):
            line = repose_angles.flank_line(heap, side)
            if line is not None:
                ends = np.array([line.inner, line.outer])
                axes.plot(
                    ends * factor,
                    _on_line(line, side, ends) * factor,
                    color=colours[side],
                    linewidth=2.5,
                    label=f"{side} {line.angle:.1f}°",
                )
    axes.set_xlabel(f"x along the base [{label}]")
    axes.set_ylabel(f"height [{label}]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="upper right", fontsize=8, frameon=False)
    drawing.save_plot(path, figure, trimmed=False)
    return path


def _on_line(line: repose_angles.Line, side: str, x: Array) -> Array:
    falls = math.tan(math.radians(line.angle)) * (1.0 if side == "right" else -1.0)
    return np.asarray(line.middle[1] - falls * (x - line.middle[0]))


def _overlay(
    photo: Image,
    found: Silhouette,
    profile: Profile,
    evaluation: Evaluation,
    unit: float,
    grain: float | None,
    flank: Flank | None,
) -> Image:
    """The photo, reduced to screen size, with the measured lines drawn on it."""
    picture = photo.copy()
    if found.zoom < 1:
        picture = np.asarray(cv2.resize(photo, None, fx=found.zoom, fy=found.zoom, interpolation=cv2.INTER_AREA))
    seen = np.isfinite(found.height)
    drawing.draw_path(picture, found.view.to_picture(found.x[seen], found.height[seen]), drawing.ORANGE)
    reach = found.view.radius or float(np.abs(found.x[seen]).max())
    _draw(picture, found, np.array([-reach, reach]), np.zeros(2), drawing.SKY)
    heap = repose_angles.find_parts(profile, None, grain)
    if heap is None:
        return picture
    for side in repose_angles.free_flanks(heap, flank):
        line = repose_angles.flank_line(heap, side)
        if line is not None:
            ends = np.array([line.inner, line.outer])
            _draw(picture, found, ends / unit, _on_line(line, side, ends) / unit, drawing.BLUE, width=3)
    apex = found.view.to_picture(np.array([heap.apex[0] / unit]), np.array([heap.apex[1] / unit]))[0]
    drawing.draw_cross(picture, (float(apex[0]), float(apex[1])), 0.5 * found.bead_radius, drawing.RED)
    drawing.draw_caption(picture, _labels(evaluation))
    return picture


def _draw(
    picture: Image, found: Silhouette, x: Array, height: Array, colour: drawing.Colour, width: int | None = None
) -> None:
    (ax, ay), (bx, by) = found.view.to_picture(x, height)
    drawing.draw_line(picture, (float(ax), float(ay)), (float(bx), float(by)), colour, width=width)


def _labels(evaluation: Evaluation) -> list[str]:
    def words(one: Quantity) -> str:
        return f"{one.detail['side']} {one.value:.1f} ± {one.std_uncertainty:.1f}°"

    main = {"angle_of_repose_graphical": "line 15-85 %", "angle_of_repose_geometric": "apex"}
    texts = []
    for quantity, method in main.items():
        ones = [one for one in evaluation.quantities if (one.quantity, one.method) == (quantity, method)]
        name = f"angle of repose, {quantity.rsplit('_', 1)[1]} ({method}), ± standard uncertainty"
        texts.append(f"{name}: {', '.join(words(one) for one in ones)}")
    reasons = sorted({one.doubtful for one in evaluation.quantities if one.doubtful})
    return texts + [f"doubtful: {reason}" for reason in reasons]
