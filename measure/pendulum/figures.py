"""Pictures of a measured pendulum: annotated video, still picture, plot of the angles over time with their fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.errors import Mark, NothingToMeasure
from rigtwin.lab.formatting import title
from rigtwin.lab.progress import Progress
from rigtwin.lab.quantity import Quantity
from rigtwin.measure import drawing
from rigtwin.measure.media.video import Video
from rigtwin.measure.pendulum.swing_fit import SwingFit
from rigtwin.measure.pendulum.swing_model import angles, turning_points
from rigtwin.measure.pendulum.track_two_beads import Beads
from rigtwin.measure.tracking.bead_image import BeadImage

COLOURS = (drawing.ORANGE, drawing.SKY)
NAMES = "AB"


@dataclass(frozen=True)
class View:
    """The fitted swings in pixels of the picture."""

    pivots: Array  # [px], shape (beads, 2)
    lengths: Array  # [px], shape (beads,)
    down: float  # [rad], direction of gravity from the picture's vertical, counter-clockwise
    angles: Array  # [rad], from gravity, per bead and frame, shape (beads, n)

    def place(self, bead: int, angle: float, share: float = 1.0) -> tuple[float, float]:
        """Point on a bead's thread [px] at `angle` [rad] from gravity; `share` of the length from the pivot."""
        turned, reach = angle + self.down, share * float(self.lengths[bead])
        return (
            float(self.pivots[bead, 0]) + reach * math.sin(turned),
            float(self.pivots[bead, 1]) + reach * math.cos(turned),
        )


def picture_view(fit: SwingFit, times: Array) -> View:
    """View of a `fit` in pixels (y up) at `times` [s] of the frames."""
    swings = fit.swings
    pivots = np.column_stack([swings.per_bead("pivot_x"), -swings.per_bead("pivot_y")])
    at, _ = angles(swings, times)
    return View(pivots, swings.per_bead("length"), float(swings["tilt"]), at[..., 0])


def picture_marks(beads: Beads, view: View) -> tuple[Mark, ...]:
    """Tracks of the beads, their fitted swings and pivots in the picture."""
    marks = []
    for bead, images in enumerate(beads.images):
        name = f"bead {NAMES[bead]}"
        seen = [k for k, image in enumerate(images) if image is not None]
        places = np.array([_place(images[k]) for k in seen]).reshape(-1, 2) + beads.shakes[seen]
        fitted = [view.place(bead, float(angle)) for angle in view.angles[bead]]
        frames = beads.frames[seen].tolist()
        marks += [
            Mark(name, places.tolist(), beads.looks[bead].radius, "track", frames),
            Mark(f"{name}, fitted swing", fitted, kind="fit"),
            Mark(f"pivot {NAMES[bead]}", [view.place(bead, 0.0, 0.0)], kind="pivot"),
        ]
    return tuple(marks)


def write_overlay(path: Path, video: Video, beads: Beads, view: View, *, still: int, progress: Progress) -> Image:
    """Write the clip with both beads, their trails, pivots and angles; returns the unmarked frame `still`."""
    kept: Image | None = None
    trails = [np.array([_place(image) for image in images]) for images in beads.images]
    with drawing.OverlayVideo(path, frame_rate=min(video.playback_rate or 30.0, 30.0)) as film:
        for k, frame in enumerate(video.frames()):
            progress("drawing the overlay", k, len(beads.frames))
            picture = frame.colour.copy()
            kept = frame.colour if frame.index == still or kept is None else kept
            shake = beads.shakes[k]
            for bead, images in enumerate(beads.images):
                _draw_swing(picture, view, bead, shake, float(view.angles[bead, k]))
                drawing.draw_path(picture, _seen(trails[bead][max(0, k - 60) : k + 1]) + shake, COLOURS[bead])
                image = images[k]
                if image is not None:
                    place = (image.x + shake[0], image.y + shake[1])
                    drawing.draw_circle(picture, place, beads.looks[bead].radius, COLOURS[bead])
            drawing.draw_caption(picture, [f"frame {frame.index}   {frame.time:.4f} s"], bottom=True)
            film.write(picture)
    if kept is None:
        raise NothingToMeasure(f"{path.stem}: no frame could be read again to draw on; copy the clip anew.")
    return kept


def write_still(
    path: Path, picture: Image, beads: Beads, view: View, fit: SwingFit, *, found: Sequence[Quantity]
) -> None:
    """One picture: both trails, release and turning angles as lines with their numbers, restitution in the corner.

    `found` are the quantities of the measurement, so that the picture shows the same values as the tables.
    """
    picture = picture.copy()
    release = float(fit.swings["release_angle"])
    turning = turning_points(fit.swings, 0)[0][:, 0]
    values = {(q.quantity, str(q.detail.get("body", ""))): q.value for q in found if q.unit == "deg"}
    for bead, images in enumerate(beads.images):
        trail = np.array([_place(image) for image in images])
        for x, y in trail[np.all(np.isfinite(trail), axis=1)]:
            drawing.draw_dot(picture, (float(x), float(y)), COLOURS[bead], radius=1.2)
        drawing.draw_cross(picture, view.place(bead, 0, 0), 5, COLOURS[bead])
        drawing.draw_line(picture, view.place(bead, 0, 0), view.place(bead, 0, 1.03), drawing.WHITE)
        marks = [(float(turning[bead]), f"{NAMES[bead]}'", "rebound_angle")]
        marks = [(release, "A", "release_angle"), *marks] if bead == 0 else marks
        for place, (angle, name, quantity) in enumerate(marks):
            drawing.draw_line(picture, view.place(bead, 0, 0), view.place(bead, angle), COLOURS[bead])
            share = 0.55 + 0.12 * (bead + place)
            arc = [view.place(bead, part, share) for part in np.linspace(0, angle, 40)]
            drawing.draw_path(picture, arc, COLOURS[bead])
            value = values.get((quantity, NAMES[bead]), abs(math.degrees(angle)))
            label = f"{name} {value:.2f}°"
            drawing.draw_text(picture, label, view.place(bead, 0.55 * angle, share + 0.04), COLOURS[bead])
    lines = [
        f"{title(q.quantity)} ({q.method}) {q.value:.4f} ± {q.std_uncertainty:.4f}"
        + (" doubtful" if q.doubtful else "")
        for q in found
        if q.unit == "1" and q.detail.get("collision") == 1
    ]
    drawing.draw_caption(picture, lines, bottom=True)
    drawing.save_picture(path, picture)


def write_plot(path: Path, fit: SwingFit) -> None:
    """Write angles over time with the fitted swings, and the residuals, as an SVG file."""
    from matplotlib.figure import Figure

    swings = fit.swings
    figure = Figure(figsize=(8, 5.5))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    figure.subplots_adjust(left=0.11, right=0.99, bottom=0.09, top=0.985, hspace=0.08)
    start, end = (float(side(track.time[index] for track in fit.tracks)) for side, index in ((min, 0), (max, -1)))
    time = np.linspace(start, end, 600)
    fitted = np.degrees(angles(swings, time)[0][..., 0])
    for bead, (track, colour) in enumerate(zip(fit.tracks, ("#e69f00", "#0072b2"), strict=False)):
        pivot = np.array([swings[f"pivot_x_{bead}"], swings[f"pivot_y_{bead}"]])
        away = track.position - pivot
        seen = np.degrees(np.arctan2(away[:, 0], -away[:, 1]) - float(swings["tilt"]))
        above.plot(track.time, seen, ".", ms=3, color=colour, label=f"{NAMES[bead]} seen")
        above.plot(time, fitted[bead], "-", lw=1, color=colour, label=f"{NAMES[bead]} fitted")
        used = fit.used[bead]
        for axis, mark in ((0, "."), (1, "x")):
            left = fit.residuals[bead][used, axis] * 1e3
            below.plot(track.time[used], left, mark, ms=3, color=colour, label=f"{NAMES[bead]} {'xy'[axis]}")
    for k in range(swings.collisions):
        for axes in (above, below):
            axes.axvline(float(swings[f"time_{k}"]), color="0.6", lw=0.8, ls="--")
    above.set_ylabel("angle from gravity [deg]")
    above.legend(fontsize="small", ncols=2)
    below.set_ylabel("seen - fitted [mm]")
    below.set_xlabel("time [s]")
    drawing.save_plot(path, figure, trimmed=False)


def _draw_swing(picture: Image, view: View, bead: int, shake: Array, angle: float) -> None:
    def moved(point: tuple[float, float]) -> tuple[float, float]:
        return point[0] + float(shake[0]), point[1] + float(shake[1])

    pivot = moved(view.place(bead, 0, 0))
    drawing.draw_cross(picture, pivot, 5, COLOURS[bead])
    drawing.draw_line(picture, pivot, moved(view.place(bead, angle)), COLOURS[bead])
    label = f"{NAMES[bead]} {math.degrees(angle):+.1f}°"
    x, y = moved(view.place(bead, angle, 1.12))
    drawing.draw_text(picture, label, (x - 30, y + 14 * bead), COLOURS[bead])


def _place(image: BeadImage | None) -> tuple[float, float]:
    return (math.nan, math.nan) if image is None else (image.x, image.y)


def _seen(trail: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return trail[np.all(np.isfinite(trail), axis=1)]
