"""Select the path of the falling bead from the paths of everything that moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.measure.tracking.link import SpotPath


@dataclass(frozen=True)
class _Arc:
    """A piece of a path without a kink, and its acceleration."""

    path: SpotPath
    acceleration: float  # [px/frame^2], down
    sigma: float  # its standard uncertainty
    weight: float  # evidence for a bead in free flight: vertical range times root of the contrast


def join_flights(paths: list[SpotPath], size: float | None) -> SpotPath | None:
    """Join all arcs with the same downward acceleration to one path.

    At a bounce, or behind a post, a bead is easily confused with its shadow or reflection.  Only the bead always
    has the same acceleration.  `size` [px] is the expected radius.
    """
    arcs = [arc for path in paths if likeness(path, size) > 0 for piece in _arcs(path) for arc in _as_arc(piece)]
    if not arcs:
        return None
    best = max(arcs, key=lambda arc: arc.weight)
    frames: dict[int, int] = {}
    chosen: list[SpotPath] = []
    for arc in sorted(arcs, key=lambda arc: -arc.weight):
        # a bead that comes nearer to the camera seems larger and faster by the same factor
        larger = arc.path.radius / best.path.radius
        expected = (best.acceleration, larger * best.acceleration)
        alike = min(abs(arc.acceleration - each) for each in expected) < 0.1 * best.acceleration + 3 * arc.sigma
        same = 0.6 < larger < 1.7
        free = [k for k, frame in enumerate(arc.path.frames) if frame not in frames]
        if alike and same and len(free) > 0.7 * len(arc.path.frames):
            frames.update(dict.fromkeys(arc.path.frames, 1))
            chosen.append(SpotPath(tuple(arc.path.frames[k] for k in free), tuple(arc.path.spots[k] for k in free)))
    pairs = sorted(
        (pair for path in chosen for pair in zip(path.frames, path.spots, strict=True)), key=lambda pair: pair[0]
    )
    return SpotPath(tuple(frame for frame, _ in pairs), tuple(spot for _, spot in pairs))


def _arcs(path: SpotPath) -> list[SpotPath]:
    """Pieces of the path between kinks, of at least five frames."""
    y = path.centres[:, 1]
    frames = np.array(path.frames)
    speed = np.diff(y) / np.diff(frames)
    kinks = np.flatnonzero(np.abs(np.diff(speed)) > 0.4 * path.radius + 0.15 * np.abs(speed[1:])) + 1
    pieces = np.split(np.arange(len(y)), kinks)
    return [
        SpotPath(tuple(path.frames[k] for k in piece), tuple(path.spots[k] for k in piece))
        for piece in pieces
        if len(piece) >= 5
    ]


def _as_arc(path: SpotPath) -> list[_Arc]:
    """The piece as an arc if it is a parabola bent downwards; frames at rest before a release are left out."""
    y, frames = path.centres[:, 1], np.array(path.frames, dtype=np.float64)
    moving = np.flatnonzero(np.abs(y - y[0]) > 0.5 * path.radius)
    first = 0 if np.ptp(y) < 2 * path.radius or not len(moving) else max(int(moving[0]) - 2, 0)
    if len(y) - first < 5:
        return []
    t, y = frames[first:] - frames[first], y[first:]
    bend, slope, base = np.polyfit(t, y, 2)
    rms = float(np.std(y - np.polyval([bend, slope, base], t)))
    sigma = 2 * 13.4 * max(rms, 0.1) / (float(np.ptp(t)) ** 2 * math.sqrt(len(t)))
    if bend <= 0 or np.ptp(y) < path.radius or rms > 0.25 * path.radius + 0.01 * np.ptp(y) or sigma > bend:
        return []
    contrast = float(np.median([spot.contrast for spot in path.spots]))
    whole = SpotPath(path.frames, path.spots)
    return [_Arc(whole, 2 * float(bend), sigma, float(np.ptp(y)) * math.sqrt(contrast))]


def likeness(path: SpotPath, size: float | None) -> float:
    """Score of a path: long vertical path, smooth steps, contrast, and the expected radius `size` [px]."""
    y = path.centres[:, 1]
    if len(y) < 8:
        return 0.0
    steps = np.diff(y) / np.diff(np.array(path.frames))
    smooth = np.abs(np.diff(steps)) < 0.5 * path.radius + 0.2 * np.abs(steps[1:]) + 1
    way = float(np.sum(np.abs(np.diff(y))))
    if np.ptp(y) < 3 * path.radius or np.mean(smooth) < 0.5:
        return 0.0
    fit = 1.0 if size is None else math.exp(-(math.log(path.radius / size) ** 2))
    contrast = float(np.median([spot.contrast for spot in path.spots]))
    return way * float(np.mean(smooth)) ** 4 * math.sqrt(contrast) * fit
