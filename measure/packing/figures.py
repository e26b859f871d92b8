"""Figures of a packing measurement: the photo with walls, floor, outline and height, and a plot of the outline."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from rigtwin.lab.arrays import Image
from rigtwin.lab.errors import Mark
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.records import Profile, write_profile
from rigtwin.measure.drawing import (
    GREEN,
    ORANGE,
    RED,
    SKY,
    Colour,
    draw_caption,
    draw_cross,
    draw_line,
    draw_path,
    save_picture,
    save_plot,
)
from rigtwin.measure.packing.cylinder import Bed


def write_pictures(
    out: Path, stem: str, profile: Profile, seen: tuple[Image, Bed] | None, measurement: Measurement
) -> dict[str, Path]:
    """Write overlay (for a photo), plot and record of one view into `out`; return the paths by kind."""
    out.mkdir(parents=True, exist_ok=True)
    files = {"plot": out / f"{stem}-plot.svg", "record": out / f"{stem}-profile.csv"}
    if seen is not None:
        files["overlay"] = out / f"{stem}-overlay.png"
        save_picture(files["overlay"], _marked(*seen, measurement))
    write_plot(files["plot"], profile, measurement.quantities)
    write_profile(files["record"], profile)
    return files


def picture_marks(bed: Bed, view: int) -> tuple[Mark, ...]:
    """Walls, floor, outline and mean height of the bed in a photo, the `view`-th of its repetition."""
    silhouette, half = bed.silhouette, bed.width / 2
    x, height = bed.outline

    line = silhouette.in_photo
    top, level = float(np.max(height)) + half, float(np.mean(height))
    walls = [line(np.array([side, side]), np.array([0.0, top])) for side in (-half, half)]
    across = np.array([-half, half])
    return (
        *(Mark("wall", wall, kind="circle", view=view) for wall in walls),
        Mark("floor", line(across, np.zeros(2)), kind="base", view=view),
        Mark("outline", line(x, height), kind="outline", view=view),
        Mark("mean of the outline", line(across, np.full(2, level)), kind="graphical", view=view),
    )


def write_plot(path: Path, profile: Profile, found: tuple[Quantity, ...]) -> None:
    """Plot the outline across the cylinder with the heights found and their standard uncertainties."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4))
    axes = figure.subplots()
    axes.plot(profile.x * 1e3, profile.height * 1e3, color="0.4", lw=1, label="outline")
    colours = {"surface bead tops": "#D55E00", "mean surface": "#0072B2", "outline": "#009E73"}
    for one in found:
        if one.quantity == "bed_height":
            value, sigma = one.value * 1e3, one.std_uncertainty * 1e3
            colour = colours.get(one.method, "0.2")
            axes.axhline(value, color=colour, lw=1, label=f"{one.method}: {value:.1f} ± {sigma:.1f} mm")
            axes.axhspan(value - sigma, value + sigma, color=colour, alpha=0.15)
    axes.set_xlabel("across the cylinder / mm")
    axes.set_ylabel("height above the floor / mm")
    axes.legend(fontsize=7)
    save_plot(path, figure)


def _marked(image: Image, bed: Bed, measurement: Measurement) -> Image:
    zoom = bed.silhouette.zoom
    picture = np.asarray(cv2.resize(image, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    view = bed.silhouette.view
    x, height = bed.outline
    half = bed.width / 2

    def line(low: tuple[float, float], high: tuple[float, float], colour: tuple[int, int, int]) -> None:
        ends = view.to_picture(np.array([low[0], high[0]]), np.array([low[1], high[1]]))
        draw_line(picture, (ends[0, 0], ends[0, 1]), (ends[1, 0], ends[1, 1]), colour)

    top = float(np.max(height)) + half
    for side in (-half, half):
        line((side, 0.0), (side, top), SKY)
    if bed.stated.walls is not None:
        for wall in bed.stated.walls:
            draw_cross(picture, wall, 0.03 * bed.width, SKY)
    if bed.stated.floor is not None:
        draw_cross(picture, (bed.axis[0], bed.stated.floor), 0.03 * bed.width, GREEN)
    points = view.to_picture(x, height)
    draw_path(picture, points, ORANGE)
    floor, level = 0.0, float(np.mean(height))
    headline = measurement.quantities[0]
    if bed.gauge is not None:
        zero, reading = bed.gauge.row_of(0.0), bed.gauge.row_of(headline.value * 1e3)
        marks = [(bed.gauge.column_at(row), row) for row in (zero, reading)]
        for (column, row), colour in zip(marks, (GREEN, RED), strict=True):
            reach = column - bed.axis[0] + math.copysign(0.1 * bed.width, column - bed.axis[0])
            far = (bed.axis[0] + reach, row + (bed.axis[0] + reach - column) * math.tan(bed.roll))
            near = (bed.axis[0] - half, row + (bed.axis[0] - half - column) * math.tan(bed.roll))
            draw_line(picture, near, far, colour)
    else:
        line((-half, floor), (half, floor), GREEN)
        line((-half, level), (half, level), RED)
    value, sigma = headline.value * 1e3, headline.std_uncertainty * 1e3
    caption: list[str | tuple[str, Colour]] = [(f"bed height ({headline.method}) {value:.1f} ± {sigma:.1f} mm", RED)]
    if headline.doubtful:
        caption.append(f"doubtful: {headline.doubtful}")
    draw_caption(picture, caption)
    return picture
