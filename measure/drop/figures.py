"""Pictures of a measured drop: annotated video, strobe picture, plot of height over time with residuals."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.errors import Mark, NothingToMeasure
from rigtwin.lab.progress import Progress
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import write_tracks
from rigtwin.measure.drawing import (
    GREEN,
    ORANGE,
    RED,
    SKY,
    YELLOW,
    OverlayVideo,
    draw_caption,
    draw_circle,
    draw_cross,
    draw_dot,
    draw_line,
    draw_path,
    draw_text,
    save_picture,
    save_plot,
)
from rigtwin.measure.drop.bounce_fit import Bounces
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.tracking.cutouts import Sighting
from rigtwin.measure.tracking.follow import Chase

_LONGEST_SIDE = 960  # [px], of the overlay video: sharp enough to check, fast to write


def write_pictures(
    out: Path,
    measurement: Measurement,
    bounces: Bounces,
    in_pixels: Bounces,
    video: Video,
    seen: Chase,
    progress: Progress,
) -> dict[str, Path]:
    """Write overlay, still, plot and track into `out`; returns what was written.

    `bounces` is the fit in metres, `in_pixels` the one in the picture (heights up).
    """
    out.mkdir(parents=True, exist_ok=True)
    stem = measurement.source.stem
    files = {
        "overlay": out / f"{stem}-overlay.mp4",
        "still": out / f"{stem}-still.png",
        "record": out / f"{stem}-track.csv",
    }
    strobe = _Strobe(seen, in_pixels)
    _write_video(files["overlay"], measurement, in_pixels, video, seen, strobe, progress)
    save_picture(files["still"], strobe.finish(measurement))
    write_tracks(files["record"], measurement.tracks)
    files["plot"] = write_plot(out, measurement, bounces)
    return files


def picture_marks(seen: Chase, bounces: Bounces) -> tuple[Mark, ...]:
    """Track, fitted flights, plate and contacts in the picture; `bounces` is the fit in pixels."""
    time, places = _places(seen)
    frames = [sighting.frame for sighting in seen.sightings]
    shown = places + np.array([sighting.shake for sighting in seen.sightings]).reshape(-1, 2)
    fine = np.linspace(time[0], time[-1], 20 * (bounces.count + 1))
    flights = np.column_stack([np.interp(fine, time, places[:, 0]), -bounces.curve(fine)])
    contacts = bounces.contact_times
    x = np.interp(contacts, time, places[:, 0])
    y = -bounces.level(contacts)
    ends = [(float(x.min()) - 6 * seen.radius, float(y[0])), (float(x.max()) + 6 * seen.radius, float(y[-1]))]
    return (
        Mark("bead", shown.tolist(), seen.radius, "track", frames),
        Mark("fitted flights", flights.tolist(), kind="fit"),
        Mark("plate", [(a, b + seen.radius) for a, b in ends], kind="plate"),
        *(
            Mark(f"contact {k}", [(float(a), float(b))], seen.radius, "contact")
            for k, (a, b) in enumerate(zip(x, y, strict=True), start=1)
        ),
    )


def write_plot(out: Path, measurement: Measurement, bounces: Bounces) -> Path:
    """Height over time with the fitted flights, residuals below."""
    from matplotlib.figure import Figure

    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{measurement.source.stem}-plot.svg"
    track = max(measurement.tracks, key=lambda each: len(each.time))
    figure = Figure(figsize=(8, 5.5))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    figure.subplots_adjust(left=0.11, right=0.99, bottom=0.09, top=0.985, hspace=0.08)
    height = track.position[:, 1] * 1e3
    upper.plot(track.time, height, ".", ms=3, color="0.6", label="bead, every frame")
    upper.plot(track.time[bounces.used], height[bounces.used], ".", ms=3, color="#0072B2", label="used in the fit")
    fine = np.linspace(track.time[0], track.time[-1], 1500)
    upper.plot(fine, bounces.curve(fine) * 1e3, color="#D55E00", lw=1, label="fitted flights")
    upper.plot(fine, bounces.level(fine) * 1e3, color="0.4", lw=0.8, ls="--", label="level at contact")
    for k, time in enumerate(bounces.contact_times, start=1):
        upper.axvline(time, color="#009E73", lw=0.6)
        upper.annotate(
            _restitution_text(measurement, k), (time, upper.get_ylim()[1]), fontsize=7, rotation=90, va="top"
        )
    upper.set_ylabel("height above the plate / mm")
    upper.legend(fontsize=7, loc="upper right")
    lower.axhline(0, color="0.4", lw=0.8)
    lower.plot(track.time[bounces.used], bounces.residual[bounces.used] * 1e3, ".", ms=3, color="#0072B2")
    lower.set_ylabel("residual / mm")
    lower.set_xlabel("time / s")
    save_plot(path, figure, trimmed=False)
    return path


def _restitution_text(measurement: Measurement, bounce: int) -> str:
    for quantity in measurement.quantities:
        if quantity.method == "velocity" and quantity.detail.get("bounce") == bounce:
            return f" e = {quantity.value:.4f} ± {quantity.std_uncertainty:.4f}"
    return ""


def _apex_texts(measurement: Measurement) -> list[str]:
    """One label per apex: drop height, then the rebounds."""
    return [
        f"h{quantity.detail.get('bounce', 0)} = {quantity.value * 1e3:.1f} mm"
        for quantity in measurement.quantities
        if quantity.quantity in ("drop_height", "rebound_height")
    ]


class _Strobe:
    """Strobe picture: the bead of every few frames pasted into the last frame."""

    def __init__(self, seen: Chase, in_pixels: Bounces) -> None:
        self._seen = seen
        self._bounces = in_pixels
        self._picture: Image | None = None
        self._pieces: list[tuple[Image, npt.NDArray[np.bool_], int, int]] = []
        self._chosen = self._apart(seen.sightings, 3.0 * seen.radius)

    @staticmethod
    def _apart(sightings: tuple[Sighting, ...], distance: float) -> set[int]:
        """Frames whose beads are at least `distance` [px] apart."""
        chosen: set[int] = set()
        last = (np.inf, np.inf)
        for sighting in sightings:
            here = (sighting.image.x, sighting.image.y)
            if not np.hypot(here[0] - last[0], here[1] - last[1]) < distance:
                chosen.add(sighting.frame)
                last = here
        return chosen

    def add(self, frame: Frame, sighting: Sighting | None) -> None:
        """Store the bead of one frame if it was chosen."""
        self._picture = frame.colour
        if sighting is None or sighting.frame not in self._chosen:
            return
        image, reach = sighting.image, self._seen.radius + np.hypot(*sighting.image.blur) / 2 + 2
        left, top = max(int(image.x - reach), 0), max(int(image.y - reach), 0)
        piece = frame.colour[top : int(image.y + reach) + 2, left : int(image.x + reach) + 2].copy()
        if piece.size:
            disc = np.zeros(piece.shape[:2], dtype=np.uint8)
            ends = [
                (image.x - left + side * image.blur[0] / 2, image.y - top + side * image.blur[1] / 2)
                for side in (-1, 1)
            ]
            start, end = ((round(x), round(y)) for x, y in ends)
            cv2.line(disc, start, end, 1, max(round(2 * self._seen.radius + 2), 1))
            self._pieces.append((piece, disc > 0, left, top))

    def finish(self, measurement: Measurement) -> Image:
        """The picture with track, plate line, contacts and heights."""
        if self._picture is None:
            raise NothingToMeasure(
                f"{measurement.source}: no frame could be read again to draw on; copy the clip anew."
            )
        picture = self._picture.copy()
        for piece, disc, left, top in self._pieces:
            picture[top : top + piece.shape[0], left : left + piece.shape[1]][disc] = piece[disc]
        zoom = max(1.0, 700 / max(picture.shape[:2]))
        picture = np.asarray(cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
        mark_fit(picture, self._seen, self._bounces, measurement, zoom)
        return picture


def mark_fit(picture: Image, seen: Chase, bounces: Bounces, measurement: Measurement, zoom: float) -> None:
    """Draw track, plate line, contacts and apex heights; `zoom` is picture pixels per frame pixel."""
    time, places = _places(seen)
    draw_path(picture, places * zoom, SKY)
    contacts = bounces.contact_times
    x_at = np.interp(contacts, time, places[:, 0]) * zoom
    y_at = (-bounces.level(contacts) + seen.radius) * zoom
    margin = 0.2 * picture.shape[1]
    draw_line(
        picture, (float(x_at.min()) - margin, float(y_at[0])), (float(x_at.max()) + margin, float(y_at[-1])), GREEN
    )
    for x, y in zip(x_at, y_at, strict=True):
        draw_cross(picture, (float(x), float(y)), 5, RED)
    apexes = np.clip(bounces.apex_times, time[0], time[-1])
    # in metres, with the air drag, fewer of the bounces may be fitted than in the picture
    for text, apex, contact in zip(_apex_texts(measurement), apexes, [contacts[0], *contacts], strict=False):
        x = float(np.interp(apex, time, places[:, 0])) * zoom
        lowest = float(-bounces.level(np.array([contact]))[0])
        y = float(np.interp(apex, time, places[:, 1]))
        y = (min(y, lowest) + seen.radius) * zoom
        draw_line(picture, (x - 12, y), (x + 12, y), YELLOW)
        draw_text(picture, text, (x + 16, y + 4), YELLOW)


def _places(seen: Chase) -> tuple[Array, Array]:
    time = np.array([sighting.time for sighting in seen.sightings])
    return time, np.array([(sighting.image.x, sighting.image.y) for sighting in seen.sightings])


def _write_video(
    path: Path,
    measurement: Measurement,
    bounces: Bounces,
    video: Video,
    seen: Chase,
    strobe: _Strobe,
    progress: Progress,
) -> None:
    by_frame = {sighting.frame: sighting for sighting in seen.sightings}
    zoom = min(1.0, _LONGEST_SIDE / max(video.width, video.height))
    trail: list[tuple[float, float]] = []
    first, last = seen.cuts[0].frame, seen.cuts[-1].frame
    marks = _contact_marks(bounces, measurement, seen, zoom)
    # at most 30 frames per second: high-speed clips play in slow motion
    with OverlayVideo(path, frame_rate=min(video.playback_rate or 30.0, 30.0)) as overlay:
        for frame in video.frames(first, last):
            sighting = by_frame.get(frame.index)
            strobe.add(frame, sighting)
            picture = frame.colour.copy() if zoom == 1 else _shrunk(frame.colour, zoom)
            shake = seen.shakes[min(frame.index - video.first, len(seen.shakes) - 1)]
            if sighting is not None:
                trail.append((sighting.image.x, sighting.image.y))
                at = ((sighting.image.x + shake[0]) * zoom, (sighting.image.y + shake[1]) * zoom)
                draw_circle(picture, at, seen.radius * zoom, ORANGE)
                draw_dot(picture, at, ORANGE, radius=1)
            draw_path(picture, (np.array(trail[-40:]).reshape(-1, 2) + shake) * zoom, SKY)
            _mark_past(picture, frame, marks)
            overlay.write(picture)
            progress("drawing the overlay", frame.index - first + 1, last - first + 1)


def _shrunk(picture: Image, zoom: float) -> Image:
    return np.asarray(cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _contact_marks(
    bounces: Bounces, measurement: Measurement, seen: Chase, zoom: float
) -> list[tuple[float, tuple[float, float], str]]:
    """Time [s], place in the overlay and restitution of every contact."""
    time, places = _places(seen)
    marks = []
    for k, contact in enumerate(bounces.contact_times, start=1):
        x = float(np.interp(contact, time, places[:, 0])) * zoom
        y = float(-bounces.level(np.array([contact]))[0] + seen.radius) * zoom
        marks.append((float(contact), (x, y), f"{k}:{_restitution_text(measurement, k)}"))
    return marks


def _mark_past(picture: Image, frame: Frame, marks: list[tuple[float, tuple[float, float], str]]) -> None:
    """Mark past contacts with their restitution; write frame number and time."""
    past = [(place, text) for contact, place, text in marks if contact <= frame.time]
    for place, _ in past:
        draw_cross(picture, place, 5, RED)
    draw_caption(picture, [f"frame {frame.index}   {frame.time:.4f} s", *((text, RED) for _, text in past)])
