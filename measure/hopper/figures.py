"""Figures of a hopper measurement: annotated video, still, plot of what is left over time, the record as CSV."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import Mark
from rigtwin.lab.formatting import title
from rigtwin.lab.output_files import replacing
from rigtwin.lab.progress import Progress
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.records import Series
from rigtwin.measure import drawing
from rigtwin.measure.hopper.outflow import Outflow
from rigtwin.measure.hopper.scale import outlet_profile
from rigtwin.measure.media.video import Video


def write_pictures(
    out: Path,
    measurement: Measurement,
    video: Video,
    seen: Outflow,
    left: Series,
    edges: tuple[float, float],
    scale: float | None,
    progress: Progress,
) -> dict[str, Path]:
    """Write overlay, still, plot and record into `out`; return the paths by kind."""
    out.mkdir(parents=True, exist_ok=True)
    stem = measurement.source.stem
    files = {name: out / f"{stem}-{name}{ending}" for name, ending in (("overlay", ".mp4"), ("still", ".png"))}
    _write_video(files["overlay"], files["still"], measurement, video, seen, edges, progress)
    files["plot"] = _write_plot(out / f"{stem}-plot.svg", measurement, seen, left, scale)
    files["record"] = out / f"{stem}-left.csv"
    with replacing(files["record"]) as part, part.open("w", newline="", encoding="utf-8") as file:
        rows = [(f"{t:.9g}", f"{value:.6g}") for t, value in zip(left.time, left.value, strict=True)]
        csv.writer(file, lineterminator="\n").writerows([("time_s", "fraction_left"), *rows])
    return files


def picture_marks(seen: Outflow, edges: tuple[float, float]) -> tuple[Mark, ...]:
    """The slot in the picture, from edge to edge."""
    row = seen.scenery.slot.row
    ends = _in_picture(seen, edges, row, np.zeros(2))
    return (Mark("slot", ends.tolist(), kind="slot"),)


def _in_picture(seen: Outflow, edges: tuple[float, float], row: float, shake: Array) -> Array:
    """The ends of the slot in a frame, shape (2, 2) [px]."""
    ends = np.array([[edges[0], row], [edges[1], row]])
    turned = cv2.transform(ends.reshape(-1, 1, 2), seen.scenery.turn).reshape(-1, 2)
    return seen.lens.in_clip(np.asarray(turned + shake, dtype=np.float64))


def _quantity(measurement: Measurement, name: str) -> Quantity:
    return next(one for one in measurement.quantities if one.quantity == name)


def _write_video(
    path: Path,
    still: Path,
    measurement: Measurement,
    video: Video,
    seen: Outflow,
    edges: tuple[float, float],
    progress: Progress,
) -> None:
    opened, last, duration = (
        _quantity(measurement, name) for name in ("opening_time", "last_particle_time", "discharge_time")
    )
    moments = {moment.index: moment for moment in seen.moments}
    row = seen.scenery.slot.row
    # high-speed clips are played slowly
    with drawing.OverlayVideo(path, frame_rate=min(video.playback_rate or 30.0, 30.0)) as written:
        for frame in video.frames():
            picture = frame.colour.copy()
            moment = moments.get(frame.index)
            if moment is not None:
                (ax, ay), (bx, by) = _in_picture(seen, edges, row, np.array(moment.pose.shake))
                isopen = opened.value <= frame.time
                colour = drawing.GREEN if isopen and frame.time <= last.value else drawing.RED
                drawing.draw_line(picture, (float(ax), float(ay)), (float(bx), float(by)), colour)
            caption = [f"frame {frame.index}   {frame.time:.4f} s"]
            if frame.time >= opened.value:
                caption.append(f"opened at {opened.value:.4f} s")
            if frame.time >= last.value:
                caption.append(f"last bead at {last.value:.4f} s")
                caption.append(f"discharge time {duration.value:.4f} ± {duration.std_uncertainty:.4f} s")
            drawing.draw_caption(picture, caption)
            written.write(picture)
            if frame.time <= (opened.value + last.value) / 2:
                chosen = picture
            progress("drawing the overlay", frame.index - video.first + 1, video.last - video.first + 1)
    drawing.save_picture(still, chosen)


def _write_plot(path: Path, measurement: Measurement, seen: Outflow, left: Series, scale: float | None) -> Path:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.8), layout="constrained")
    axes, outlet = figure.subplots(1, 2, width_ratios=[2, 1])
    axes.plot(left.time, left.value, ".-", ms=3, lw=0.8, color="#0072b2", label="left in the hopper")
    for name, colour in (("opening_time", "#009e73"), ("last_particle_time", "#d55e00")):
        one = _quantity(measurement, name)
        axes.axvline(one.value, color=colour, lw=1, label=f"{title(name)} {one.value:.4f} s")
        axes.axvspan(*one.interval95, color=colour, alpha=0.2, lw=0)
    for one in measurement.quantities:
        if "from_s" in one.detail:
            axes.axvspan(float(one.detail["from_s"]), float(one.detail["to_s"]), color="0.9", lw=0, zorder=0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(title(left.quantity))
    axes.legend(fontsize=8, frameon=False)
    place, velocity = outlet_profile(seen, scale or 1.0)
    factor, units = (1e3, ("mm", "m/s")) if scale is not None else (1.0, ("px", "px/s"))
    outlet.plot(place * factor, velocity, "o-", ms=4, color="#0072b2")
    outlet.set_ylim(bottom=0)
    outlet.set_xlabel(f"along the slot [{units[0]}]")
    outlet.set_ylabel(f"downward velocity [{units[1]}]")
    drawing.save_plot(path, figure)
    return path
