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


def drop_figure(measured: Sequence[Track], twin: Track) -> str:
    """Height of the bead above its first contact [mm] against time from the first contact."""
    with _canvas() as (figure, axes):
        for number, track in enumerate(measured):
            label = "measured" if number == 0 else None
            axes.plot(*_thin(*_since_contact(track)), ".", ms=3, color=MEASURED, alpha=0.5, label=label)
        axes.plot(*_thin(*_since_contact(twin)), "-", lw=1.3, color=TWIN, label="twin")
        axes.set(xlabel="time from the first contact / s", ylabel="height above the plate / mm")
        axes.legend(loc="upper right", markerscale=2.5)
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
        axes.legend(loc="best", ncols=2, markerscale=2.5)
        return _svg(figure, "Angles of the beads over time, measured and simulated")


def pile_figure(measured: Sequence[Profile], twin: Sequence[Profile]) -> str:
    """Surface of the heap [mm], middle of the base at zero, true to scale."""
    outlines = [_outline(profile) for profile in (*measured, *twin)]
    width = max((float(np.ptp(x)) for x, _ in outlines), default=1.0)
    height = max((float(np.nanmax(z)) for _, z in outlines), default=1.0)
    with _canvas(0.8 + 6.5 * min(height / width, 1.0)) as (figure, axes):
        for number, profile in enumerate(measured):
            label = "measured" if number == 0 else None
            axes.plot(*_thin(*_outline(profile)), "-", lw=1.2, color=MEASURED, alpha=0.6, label=label)
        for number, profile in enumerate(twin):
            label = "twin" if number == 0 else None
            axes.plot(*_thin(*_outline(profile)), "-", lw=1, color=TWIN, alpha=0.5, label=label)
        axes.set(xlabel="distance from the middle / mm", ylabel="height above the base / mm", aspect="equal")
        axes.set_ylim(bottom=0)
        axes.legend(loc="upper right", markerscale=2.5)
        return _svg(figure, "Surface of the heap, measured and simulated")


@contextmanager
def _canvas(height: float = 3.2) -> Iterator[tuple[Figure, Axes]]:
    """A figure of `height` [inch] with one pair of axes in the report's style; no pyplot, so nothing global is left."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(7.2, height), layout="constrained")
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


def _since_contact(track: Track) -> tuple[Array, Array]:
    """Time [s] and height [mm] from the first contact, where lines through the frames on both sides of it meet.

    The zeros of a record are its own: the plate, the contact, or whatever the tracking program chose.
    """
    time, height = track.time, track.position[:, 1]
    span = float(np.ptp(height))
    low = int(np.argmax(height < np.min(height) + 0.15 * span))
    turn = low + int(np.argmax(np.diff(height[low:], append=np.inf) > 0))
    before, after = slice(max(turn - 3, 0), turn), slice(turn + 1, turn + 4)
    if len(time[before]) < 2 or len(time[after]) < 2:
        return np.asarray(time - time[turn]), np.asarray((height - height[turn]) * 1e3)
    down, up = np.polyfit(time[before], height[before], 1), np.polyfit(time[after], height[after], 1)
    contact = (up[1] - down[1]) / (down[0] - up[0])
    return np.asarray(time - contact), np.asarray((height - np.polyval(down, contact)) * 1e3)


def _angles(tracks: Sequence[Track], length: float, diameter: float) -> list[tuple[Array, Array]]:
    """Per bead: time from the first collision [s] and angle [deg], from the horizontal way off the pivot."""
    from rigtwin.measure.swing import fit_circle

    first = tracks[0]
    (pivot, _), _ = fit_circle(first.position)
    side = 1.0 if float(first.position[0, 0]) < pivot else -1.0
    angles = [
        np.degrees(np.arcsin(np.clip(side * (track.position[:, 0] - pivot) / length - shift, -1, 1)))
        for track, shift in zip(tracks, (0.0, diameter / length), strict=False)
    ]
    hit = float(first.time[int(np.argmax(angles[0] > -0.5))])
    return [(track.time - hit, angle) for track, angle in zip(tracks, angles, strict=False)]


def _outline(profile: Profile) -> tuple[Array, Array]:
    middle = sum(profile.base) / 2 if profile.base is not None else _middle(profile)
    return (profile.x - middle) * 1e3, profile.height * 1e3


def _middle(profile: Profile) -> float:
    seen = np.isfinite(profile.height) & (profile.height > 0)
    return float(np.mean(profile.x[seen][[0, -1]])) if np.any(seen) else 0.0
