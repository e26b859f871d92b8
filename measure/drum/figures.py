"""Figures of a drum measurement: annotated video, one still, plot of the surface and of its angle over time."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import Point
from rigtwin.lab.errors import Mark
from rigtwin.lab.output_files import replacing
from rigtwin.lab.progress import Progress
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Profile
from rigtwin.measure import drawing
from rigtwin.measure.drum import evaluate as drum
from rigtwin.measure.drum.bed import Bed, Outline
from rigtwin.measure.media.video import Video

MOST_POINTS = 80  # of a surface, for the page: a point every few pixels on a screen


def write_pictures(
    out: Path, measurement: Measurement, shown: Video | Image, bed: Bed, scale: float, progress: Progress
) -> dict[str, Path]:
    """Write overlay, still, plot and the surface over time into `out`; return the paths by kind.

    `shown` is the clip, or the photo, that was measured.
    """
    out.mkdir(parents=True, exist_ok=True)
    stem = measurement.source.stem
    files = {"still": out / f"{stem}-still.png"}
    text = _label(measurement)
    if isinstance(shown, Video):
        files["overlay"] = out / f"{stem}-overlay.mp4"
        _write_video(files["overlay"], files["still"], shown, bed, text, progress)
    else:
        files["overlay"] = files["still"]
        picture = shown.copy()
        _mark(picture, bed, bed.outlines[0], text)
        drawing.save_picture(files["still"], picture)
    files["plot"] = _write_plot(out / f"{stem}-plot.svg", measurement, bed, scale)
    files["record"] = _write_record(out / f"{stem}-surface.csv", measurement)
    return files


def picture_marks(bed: Bed) -> tuple[Mark, ...]:
    """The inner rim, and in each frame the surface of the bed and the line through its middle half."""
    surface: list[Point] = []
    lines: list[Point] = []
    at_surface: list[int] = []
    at_line: list[int] = []
    for outline in bed.outlines:
        points = _in_picture(bed, outline, outline.x, outline.height)
        thinned = points[:: max(1, len(points) // MOST_POINTS)]
        surface += thinned.tolist()
        at_surface += [outline.index] * len(thinned)
        if (ends := _middle_half(bed, outline)) is not None:
            lines += ends[0].tolist()
            at_line += [outline.index] * 2
    centre = bed.lens.in_clip(np.array([bed.rim.centre]))[0]
    return (
        Mark("inner rim", [(float(centre[0]), float(centre[1]))], bed.rim.radius / bed.lens.zoom, "circle"),
        Mark("surface", surface, kind="outline", frames=at_surface),
        Mark("line through the middle half", lines, kind="graphical", frames=at_line),
    )


def _in_picture(bed: Bed, outline: Outline, x: Array, height: Array) -> Array:
    """Points of the upright picture about the axis in a frame, shape (n, 2) [px]."""
    cos, sin = math.cos(bed.upright.roll), math.sin(bed.upright.roll)
    points = np.column_stack([x * cos + height * sin, x * sin - height * cos]) + np.array(bed.rim.centre)
    return bed.lens.in_clip(points + np.array(outline.shake))


def _middle_half(bed: Bed, outline: Outline) -> tuple[Array, float] | None:
    """Ends of the line through the middle half of the surface in a frame, shape (2, 2) [px], and its slope."""
    line = drum.surface_line(Profile(outline.x, outline.height, outline.height), (0.25, 0.75))
    if line is None:
        return None
    slope, offset, low, high = line
    ends = np.array([low, high])
    return _in_picture(bed, outline, ends, slope * ends + offset), slope


def _label(measurement: Measurement) -> str:
    for one in measurement.quantities:
        if (one.quantity, one.method) == (drum.GRAPHICAL, drum.MIDDLE):
            mark = " (doubtful)" if one.doubtful else ""
            low, high = one.interval95
            angle = f"angle of repose ({drum.MIDDLE}) {one.value:.2f}° ({low:.2f}° to {high:.2f}° at 95 %)"
            return f"{angle}, {one.detail['turning']}{mark}"
    return ""


def _write_video(path: Path, still: Path, video: Video, bed: Bed, text: str, progress: Progress) -> None:
    outlines = {outline.index: outline for outline in bed.outlines}
    middle = bed.outlines[len(bed.outlines) // 2].index
    with drawing.OverlayVideo(path, frame_rate=min(video.playback_rate or 30.0, 30.0)) as written:
        for frame in video.frames():
            picture = frame.colour.copy()
            if frame.index in outlines:
                _mark(picture, bed, outlines[frame.index], text)
            drawing.draw_caption(picture, [f"frame {frame.index}   {frame.time:.3f} s"], bottom=True)
            written.write(picture)
            if frame.index == middle:
                drawing.save_picture(still, picture)
            progress("drawing the overlay", frame.index - video.first + 1, video.last - video.first + 1)


def _mark(picture: Image, bed: Bed, outline: Outline, text: str) -> None:
    """Draw rim, surface, and the line through its middle half."""
    centre = _in_picture(bed, outline, np.zeros(1), np.zeros(1))[0]
    drawing.draw_circle(picture, (float(centre[0]), float(centre[1])), bed.rim.radius / bed.lens.zoom, drawing.SKY)
    drawing.draw_path(picture, _in_picture(bed, outline, outline.x, outline.height), drawing.ORANGE)
    line = _middle_half(bed, outline)
    caption = [text]
    if line is not None:
        ((ax, ay), (bx, by)), slope = line
        width = 2 * drawing.line_width(picture)
        drawing.draw_line(picture, (float(ax), float(ay)), (float(bx), float(by)), drawing.BLUE, width=width)
        angle = abs(math.degrees(math.atan(slope)))
        caption.append(f"this frame {angle:.1f}°")
    # the horizontal through the axis, by the camera roll
    (ax, ay), (bx, by) = _in_picture(bed, outline, np.array([-0.1, 0.1]) * bed.rim.radius, np.zeros(2))
    drawing.draw_line(picture, (float(ax), float(ay)), (float(bx), float(by)), drawing.GREEN)
    drawing.draw_caption(picture, caption)


def _write_plot(path: Path, measurement: Measurement, bed: Bed, scale: float) -> Path:
    from matplotlib.figure import Figure

    factor, unit = (1e3, "mm") if measurement.profiles else (1.0, "px")
    size = scale if measurement.profiles else 1.0
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    heights = np.array([outline.height for outline in bed.outlines]) * size * factor
    x = bed.outlines[0].x * size * factor
    seen = np.isfinite(heights).mean(axis=0) > 0.5
    turn = np.linspace(0, 2 * np.pi, 200)
    radius = bed.rim.radius * size * factor
    left.plot(radius * np.cos(turn), radius * np.sin(turn), color="0.6", lw=0.8)
    low, middle, high = (np.nanpercentile(heights[:, seen], share, axis=0) for share in (10, 50, 90))
    left.fill_between(x[seen], low, high, color="#e6d9b8", lw=0, label="10 to 90 % of the time")
    left.plot(x[seen], middle, color="#555555", lw=1, label="surface, median over time")
    left.set_aspect("equal")
    left.set_xlabel(f"x from the axis [{unit}]")
    left.set_ylabel(f"height above the axis [{unit}]")
    left.legend(fontsize=7, loc="upper right")
    times, angles = _over_time(bed)
    right.plot(times, angles, ".-", ms=3, lw=0.6, color="#0072b2")
    for one in measurement.quantities:
        if (one.quantity, one.method) == (drum.GRAPHICAL, drum.MIDDLE):
            right.axhline(one.value, color="#d55e00", lw=1)
            right.axhspan(*one.interval95, color="#d55e00", alpha=0.15, lw=0)
    right.set_xlabel("time [s]")
    right.set_ylabel("angle of the middle half [deg]")
    drawing.save_plot(path, figure)
    return path


def _over_time(bed: Bed) -> tuple[Array, Array]:
    lines = [
        drum.surface_line(Profile(outline.x, outline.height, outline.height), (0.25, 0.75)) for outline in bed.outlines
    ]
    angles = [math.nan if line is None else abs(math.degrees(math.atan(line[0]))) for line in lines]
    return np.array([outline.time for outline in bed.outlines]), np.array(angles)


def _write_record(path: Path, measurement: Measurement) -> Path:
    """Write the median surface over time as ``x_m,height_m`` with its scatter; in px if no scale is known."""
    rows: list[tuple[str, ...]] = []
    if measurement.profiles:
        heights = np.array([profile.height for profile in measurement.profiles])
        seen = np.isfinite(heights).mean(axis=0) > 0.5
        middle = np.nanmedian(heights[:, seen], axis=0)
        sway = np.nanstd(heights[:, seen], axis=0)
        x = measurement.profiles[0].x[seen]
        rows = [(f"{a:.9g}", f"{b:.9g}", f"{c:.3g}") for a, b, c in zip(x, middle, sway, strict=True)]
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([("x_m", "height_m", "sigma_m"), *rows])
    return path
