"""Plots of the report: what was measured, with the twin laid over it, as inline SVG."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.lab.records import Array, Profile, Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# told apart by colour-blind readers and in grey print (Okabe and Ito 2008)
MEASURED, TWIN, SECOND = "#0072b2", "#d55e00", "#009e73"

_STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9,
    "svg.fonttype": "none",  # text stays text: smaller, sharp and searchable
    "svg.hashsalt": "rigtwin",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8a94a0",
    "axes.labelcolor": "#3c4650",
    "xtick.color": "#5b6670",
    "ytick.color": "#5b6670",
    "axes.grid": True,
    "grid.color": "#e6eaee",
    "axes.axisbelow": True,
    "legend.frameon": False,
}
_MOST_POINTS = 500  # per curve; more is not seen and makes the file heavy


def drop_figure(measured: Sequence[Track], twin: Track, *, drop_height: Sequence[float | None], radius: float) -> str:
    """Height of the bead's lowest point [mm] against time from the first contact.

    `drop_height` [m] per repetition sets its record's zero where the record's own is not the plate.
    """
    with _canvas() as (figure, axes):
        for number, (track, height) in enumerate(zip(measured, drop_height, strict=True)):
            rise = _heights(track, height, radius)
            label = "measured" if number == 0 else None
            axes.plot(
                *_thin(_since_contact(track.time, rise), rise * 1e3), ".", ms=3, color=MEASURED, alpha=0.5, label=label
            )
        rise = twin.position[:, 1] - radius
        axes.plot(*_thin(_since_contact(twin.time, rise), rise * 1e3), "-", lw=1.3, color=TWIN, label="twin")
        axes.set(xlabel="time from the first contact / s", ylabel="height above the plate / mm")
        axes.legend(loc="upper right")
        return _svg(figure, "Height of the bead over time, measured and simulated")


def pendulum_figure(
    measured: Sequence[Sequence[Track]], twin: Sequence[Track], *, length: float, diameter: float
) -> str:
    """Angle of each bead from the vertical against time from the first collision; A is released on the left."""
    with _canvas() as (figure, axes):
        for number, tracks in enumerate(measured):
            for track, (time, angle), colour in zip(
                tracks, _angles(tracks, length, diameter), (MEASURED, SECOND), strict=False
            ):
                label = f"bead {track.body}, measured" if number == 0 else None
                axes.plot(*_thin(time, angle), ".", ms=3, color=colour, alpha=0.5, label=label)
        for track, (time, angle), line in zip(twin, _angles(twin, length, diameter), ("-", "--"), strict=False):
            axes.plot(*_thin(time, angle), line, lw=1.3, color=TWIN, label=f"bead {track.body}, twin")
        axes.set(xlabel="time from the collision / s", ylabel="angle from the vertical / °")
        axes.legend(loc="best", ncols=2)
        return _svg(figure, "Angles of the beads over time, measured and simulated")


def pile_figure(measured: Sequence[Profile], twin: Sequence[Profile]) -> str:
    """Surface of the heap [mm], middle of the base at zero, true to scale."""
    with _canvas() as (figure, axes):
        for number, profile in enumerate(measured):
            label = "measured" if number == 0 else None
            axes.plot(*_thin(*_outline(profile)), "-", lw=1.2, color=MEASURED, alpha=0.6, label=label)
        for number, profile in enumerate(twin):
            label = "twin" if number == 0 else None
            axes.plot(*_thin(*_outline(profile)), "-", lw=1, color=TWIN, alpha=0.5, label=label)
        axes.set(xlabel="distance from the middle / mm", ylabel="height above the base / mm", aspect="equal")
        axes.set_ylim(bottom=0)
        axes.legend(loc="upper right")
        return _svg(figure, "Surface of the heap, measured and simulated")


@contextmanager
def _canvas() -> Iterator[tuple[Figure, Axes]]:
    """A figure with one pair of axes in the report's style; no pyplot, so nothing global is left behind."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(7.2, 3.2), layout="constrained")
        yield figure, figure.add_subplot()


def _svg(figure: Figure, label: str) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    drawing = text.getvalue()
    # inside a page, the drawing's own style sheet would reach all of the page
    drawing = re.sub(r"<style.*?</style>", "", drawing[drawing.index("<svg") :], flags=re.DOTALL)
    return drawing.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)


def _thin(x: Array, y: Array) -> tuple[Array, Array]:
    step = max(1, math.ceil(len(x) / _MOST_POINTS))
    return x[::step], y[::step]


def _heights(track: Track, drop_height: float | None, radius: float) -> Array:
    """[m] of the bead's lowest point above the plate."""
    rise = np.asarray(track.position[:, 1] - radius, dtype=np.float64)
    if drop_height is None:
        return rise
    first = slice(0, max(3, len(rise) // 50))
    # a record whose zero is not the plate begins at another height than the drop height
    off = float(np.max(rise[first])) - drop_height
    return rise - (off if abs(off) > 0.2 * drop_height else 0.0)


def _since_contact(time: Array, rise: Array) -> Array:
    """Time from the first contact, where straight lines through the frames on both sides of it meet."""
    low = int(np.argmax(rise < 0.15 * np.max(rise)))
    turn = low + int(np.argmax(np.diff(rise[low:], append=np.inf) > 0))
    before, after = slice(max(turn - 3, 0), turn), slice(turn + 1, turn + 4)
    if len(time[before]) < 2 or len(time[after]) < 2:
        return np.asarray(time - time[turn])
    down, up = np.polyfit(time[before], rise[before], 1), np.polyfit(time[after], rise[after], 1)
    return np.asarray(time - (up[1] - down[1]) / (down[0] - up[0]))


def _angles(tracks: Sequence[Track], length: float, diameter: float) -> list[tuple[Array, Array]]:
    """Per bead: time from the first collision [s] and angle [deg], from the horizontal way off the place of rest."""
    first = tracks[0]
    if len(tracks) > 1:
        rest_b = float(np.median(tracks[1].position[: max(3, len(tracks[1].time) // 20), 0]))
        side = 1.0 if float(first.position[0, 0]) < rest_b else -1.0
        rests = [rest_b - side * diameter, rest_b]
    else:
        side = -1.0 if float(first.position[0, 0]) > float(np.median(first.position[:, 0])) else 1.0
        lowest = int(np.argmin(first.position[:, 1]))
        rests = [float(first.position[lowest, 0])]
    angles = [
        np.degrees(np.arcsin(np.clip(side * (track.position[:, 0] - rest) / length, -1, 1)))
        for track, rest in zip(tracks, rests, strict=False)
    ]
    hit = float(first.time[int(np.argmax(angles[0] > -0.5))])
    return [(track.time - hit, angle) for track, angle in zip(tracks, angles, strict=False)]


def _outline(profile: Profile) -> tuple[Array, Array]:
    middle = sum(profile.base) / 2 if profile.base is not None else _middle(profile)
    return (profile.x - middle) * 1e3, profile.height * 1e3


def _middle(profile: Profile) -> float:
    seen = np.isfinite(profile.height) & (profile.height > 0)
    return float(np.mean(profile.x[seen][[0, -1]])) if np.any(seen) else 0.0
