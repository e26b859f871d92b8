"""Pictures of a measured tilt: annotated video, still at the onset, plot of the displacement and its fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import Point
from rigtwin.lab.errors import Mark
from rigtwin.lab.progress import Progress
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.records import Series, write_series, write_tracks
from rigtwin.measure.drawing import (
    GREEN,
    ORANGE,
    RED,
    SKY,
    YELLOW,
    Colour,
    OverlayVideo,
    draw_caption,
    draw_cross,
    draw_line,
    draw_path,
    save_picture,
    save_plot,
)
from rigtwin.measure.media.video import Video
from rigtwin.measure.tilt.incline import Descent
from rigtwin.measure.tilt.observe import Film
from rigtwin.measure.tilt.onset import Onset, Way

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def write_pictures(
    out: Path,
    measurement: Measurement,
    video: Video,
    film: Film,
    way: Way,
    found: Onset | Descent,
    angle: Series,
    progress: Progress,
) -> dict[str, Path]:
    """Write overlay, still, plot, track and angle into `out`; returns what was written."""
    out.mkdir(parents=True, exist_ok=True)
    stem = measurement.source.stem
    files = {
        "overlay": out / f"{stem}-overlay.mp4",
        "still": out / f"{stem}-still.png",
        "plot": out / f"{stem}-plot.svg",
        "record": out / f"{stem}-track.csv",
        "angle": out / f"{stem}-angle.csv",
    }
    if isinstance(found, Descent):
        event = found.start, f"{found.acceleration:.3f} ± {found.acceleration_sigma:.3f} m/s²"
    else:
        angle_there = measurement.quantities[1]
        event = found.time, f"onset at {angle_there.value:.2f} ± {angle_there.std_uncertainty:.2f}°"
    still = _write_video(files["overlay"], video, film, event, angle, progress)
    if still is not None:
        save_picture(files["still"], still)
    write_plot(files["plot"], way, found, measurement.quantities)
    write_tracks(files["record"], measurement.tracks)
    write_series(files["angle"], angle)
    return files


def write_plot(path: Path, way: Way, found: Onset | Descent, quantities: Sequence[Quantity]) -> None:
    """Plot displacement down the plate with what was fitted to it and the residuals."""
    if isinstance(found, Descent):
        _plot_descent(path, way, found)
    else:
        _plot_onset(path, way, found, quantities[1])


def _draw_way(upper: Axes, lower: Axes, way: Way, fitted: Array, label: str) -> None:
    """Draw the displacement down the plate with a fit [m], and below it the residuals."""
    upper.plot(way.time, way.down * 1e3, ".", ms=3, color="0.6", label="body, every frame")
    upper.plot(way.time, fitted * 1e3, color="#D55E00", lw=1, label=label)
    upper.set_ylabel("way down the plate / mm")
    upper.legend(fontsize=7, loc="upper left")
    lower.plot(way.time, (way.down - fitted) * 1e3, ".", ms=3, color="#0072B2")
    lower.set_ylabel("residual / mm")


def _plot_onset(path: Path, way: Way, onset: Onset, found: Quantity) -> None:
    """Plot displacement down the plate with the fitted run, its residuals, and the angle of the plate."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6.5))
    upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=[3, 1, 1.5])
    _draw_way(upper, middle, way, onset.fitted, "fitted rest and run")
    reach = 6 * onset.noise * 1e3
    middle.set_ylim(-reach, reach)
    lower.plot(way.time, np.degrees(way.angle), color="#0072B2", lw=1)
    lower.axhline(found.value, color="#009E73", lw=0.6)
    lower.set_ylabel("angle / deg")
    lower.set_xlabel("time / s")
    for axes in (upper, middle, lower):
        axes.axvspan(onset.time - 2 * onset.time_sigma, onset.time + 2 * onset.time_sigma, color="#009E73", alpha=0.3)
        axes.axvline(onset.time, color="#009E73", lw=0.8)
    upper.set_title(f"onset at {onset.time:.3f} s, {found.value:.2f} ± {found.std_uncertainty:.2f}°", fontsize=9)
    save_plot(path, figure)


def _plot_descent(path: Path, way: Way, descent: Descent) -> None:
    """Plot displacement down a plate at rest with the parabola of its run, and the residuals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 5))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    _draw_way(upper, lower, way, descent.fitted, "constant acceleration")
    lower.set_xlabel("time / s")
    upper.set_title(
        f"plate at {math.degrees(descent.angle):.2f}°, {descent.acceleration:.3f} ± "
        f"{descent.acceleration_sigma:.3f} m/s²",
        fontsize=9,
    )
    save_plot(path, figure)


def _write_video(
    path: Path, video: Video, film: Film, event: tuple[float, str], angle: Series, progress: Progress
) -> Image | None:
    """Write the annotated clip; returns the picture of the first frame after the event (time [s], caption)."""
    since, word = event
    still = None
    with OverlayVideo(path, frame_rate=min(video.playback_rate or 30.0, 30.0)) as overlay:
        for k, frame in enumerate(video.frames()):
            picture = frame.colour.copy()
            _mark(picture, film, k)
            alpha = math.degrees(float(np.interp(frame.time, angle.time, angle.value)))
            caption: list[str | tuple[str, Colour]] = [f"frame {frame.index}   {frame.time:.3f} s   {alpha:.2f}°"]
            if frame.time >= since:
                caption.append((word, RED))
            draw_caption(picture, caption)
            if frame.time >= since and still is None:
                still = picture.copy()
            overlay.write(picture)
            progress("drawing the overlay", k + 1, len(film.frames))
    return still


def picture_marks(film: Film) -> tuple[Mark, ...]:
    """The plate, the body on it and the axis in the frames in which they were found."""
    edges: list[Point] = []
    bodies: list[Point] = []
    edge_frames: list[int] = []
    body_frames: list[int] = []
    for k, frame in enumerate(film.frames.tolist()):
        if not math.isfinite(film.directions[k]) or not film.arm.edges:
            continue
        top = min(film.arm.edges, key=lambda edge: edge.row)
        for column in (top.start, top.end):
            edges.append(_place(film, k, float(film.arm.along[column]), top.row))
            edge_frames.append(frame)
        if (step := film.steps[k]) is not None:
            bodies.append(_place(film, k, *film.body.at(step)))
            body_frames.append(frame)
    return (
        Mark("plate", edges, kind="plate", frames=edge_frames),
        Mark("body", bodies, max(film.body.size) / 2, "track", body_frames),
        Mark("axis", [(float(film.arm.pivot[0]), float(film.arm.pivot[1]))], kind="pivot"),
    )


def _mark(picture: Image, film: Film, k: int) -> None:
    """Draw the arm, its pivot, the level edges and the body in one frame."""
    pose = film.poses[k]
    for line in () if film.level is None else film.level.lines:
        draw_line(picture, pose.in_frame(line.start), pose.in_frame(line.end), SKY)
    if not math.isfinite(film.directions[k]):
        return
    for edge in film.arm.edges:
        ends = [_place(film, k, float(film.arm.along[column]), edge.row) for column in (edge.start, edge.end)]
        draw_line(picture, ends[0], ends[1], GREEN)
    draw_cross(picture, pose.in_frame(film.arm.pivot), 6, YELLOW)
    step = film.steps[k]
    if step is not None:
        x, y = film.body.at(step)
        wide, high = film.body.size[0] / 2, film.body.size[1] / 2
        corners = [(x - wide, y - high), (x + wide, y - high), (x + wide, y + high), (x - wide, y + high)]
        draw_path(picture, [_place(film, k, *corner) for corner in corners], ORANGE, closed=True)


def _place(film: Film, k: int, along: float, across: float) -> Point:
    """Where a place of the arm [px] is in the k-th frame."""
    return film.poses[k].in_frame(film.arm.in_picture((along, across), film.directions[k]))
