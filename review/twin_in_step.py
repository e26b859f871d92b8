"""The twin of a filmed repetition in the pixels and frames of its film, to be played in step with it.

The measured track is known in metres and in pixels, which gives turn, scale and shift between rig and picture.  Film
and twin have origins and clocks of their own: the lowest places of a body, where it touches the plate or hangs at rest,
are laid over each other, and the clocks are set so that both paths differ least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import Mark
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Track

STEPS = 400  # times at which both are compared, and shifts that are tried first
FEWEST = 5  # points of a track
UNLIKE = 0.25  # of the extent of the path; twins that are further away on average move otherwise, as down another plate


def twin_marks(measurement: Measurement, twin: Sequence[Track], times: Array) -> tuple[Mark, ...]:
    """Places of the bodies of a twin in each frame of the film.

    Parameters
    ----------
    measurement : Measurement
        The film, with its tracks in metres and their marks in pixels, in the same order.
    twin : sequence of Track
        Tracks of the twin, in the order of those of the film.
    times : array, shape (n,)
        Capture times of the frames [s].

    Returns
    -------
    tuple of Mark
        One for each body, of the kind "twin"; empty where the film shows no track, or the twin's path is another one.
    """
    films = list(measurement.tracks)
    seen = [mark for mark in measurement.marks if mark.kind == "track"]
    if not films or len(films) != len(seen) or len(films) != len(twin):
        return ()
    if any(len(track.time) < FEWEST for track in (*films, *twin)):
        return ()
    turn, shift = _into_picture(films, seen, times)
    moved = _on_the_same_place(films, twin)
    later, apart = _later(films, moved)
    extent = max(float(np.max(np.ptp(track.position, axis=0))) for track in films)
    if apart > UNLIKE * extent:
        return ()
    return tuple(_mark(track, mark, turn, shift, later, times) for track, mark in zip(moved, seen, strict=True))


def _on_the_same_place(films: Sequence[Track], twin: Sequence[Track]) -> list[Track]:
    """The twin's tracks moved together so that the lowest places of the bodies are those of the film."""
    apart = [_lowest(film) - _lowest(track) for film, track in zip(films, twin, strict=True)]
    shift = np.mean(apart, axis=0)
    return [replace(track, position=track.position + shift) for track in twin]


def _lowest(track: Track) -> Array:
    return np.asarray(track.position[np.argmin(track.position[:, 1])])


def _into_picture(films: Sequence[Track], seen: Sequence[Mark], times: Array) -> tuple[complex, complex]:
    """Turn and scale, and shift, that give the picture's points as x - iy from the rig's as x + iy."""
    places, points = [], []
    for track, mark in zip(films, seen, strict=True):
        at = times[np.asarray(mark.frames)]
        inside = (at >= track.time[0]) & (at <= track.time[-1])
        x, y = (np.interp(at[inside], track.time, track.position[:, axis]) for axis in (0, 1))
        pixels = np.asarray(mark.points, dtype=float)[inside]
        places.append(x + 1j * y)
        points.append(pixels[:, 0] - 1j * pixels[:, 1])
    place, point = np.concatenate(places), np.concatenate(points)
    design = np.column_stack([place, np.ones_like(place)])
    (turn, shift), *_ = np.linalg.lstsq(design, point, rcond=None)
    return complex(turn), complex(shift)


def _later(films: Sequence[Track], twin: Sequence[Track]) -> tuple[float, float]:
    """By how much the film's clock is ahead of the twin's [s], so that both differ least, and by how much then [m]."""
    begin = max(track.time[0] for track in films)
    end = min(track.time[-1] for track in films)
    at = np.linspace(begin, end, STEPS)
    film = [_positions(track, at) for track in films]

    def apart(later: float) -> float:
        squares = [
            np.sum((_positions(track, at - later) - seen) ** 2, 1) for track, seen in zip(twin, film, strict=True)
        ]
        return float(np.sqrt(np.mean(squares)))

    tried = np.linspace(begin - twin[0].time[-1], end - twin[0].time[0], 2 * STEPS)
    best = tried[int(np.argmin([apart(later) for later in tried]))]
    step = tried[1] - tried[0]
    found = minimize_scalar(apart, bounds=(best - step, best + step), method="bounded")
    return float(found.x), float(found.fun)


def _positions(track: Track, at: Array) -> Array:
    """Shape (n, 2) [m]; before and after the track its ends."""
    return np.column_stack([np.interp(at, track.time, track.position[:, axis]) for axis in (0, 1)])


def _mark(track: Track, seen: Mark, turn: complex, shift: complex, later: float, times: Array) -> Mark:
    inside = (times - later >= track.time[0]) & (times - later <= track.time[-1])
    x, y = _positions(track, times[inside] - later).T
    points = turn * (x + 1j * y) + shift
    frames = np.flatnonzero(inside).tolist()
    return Mark(
        f"twin, {seen.label}",
        list(zip(points.real.tolist(), (-points.imag).tolist(), strict=True)),
        seen.radius,
        "twin",
        frames,
    )
