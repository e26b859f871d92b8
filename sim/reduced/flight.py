"""Flights of a sphere between impacts, integrated by Runge-Kutta for many settings at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect

STEPS = 14  # steps per flight in a vacuum; the path between two steps is a cubic
MOST = 60  # largest number of steps of a flight
EDGES_PER_STEP = 4.0  # [edge widths], longest step across an edge; the impulse of a band then errs by at most 1 %
FINEST = 32  # largest refinement of the steps, to bound the cost of a band that a fit makes very narrow
FINE = 16  # sub-steps of the first and the last step for a steep force
GRADED = 2.0 * np.arange(1, FINE + 1) / (FINE * (FINE + 1))
"""Fractions of the first step, smallest at the plate (reversed for the last), for a force that is steep there."""

Pull = Callable[[Array, Array, Array, Array], tuple[Array, Array]]
"""Acceleration [m/s^2] from position (relative to the start of the flight) and velocity."""


@dataclass(frozen=True)
class Paths:
    """Flights relative to their starts; arrays of shape (settings, repetitions, flights), nodes in front."""

    step: Array  # [s]
    x: Array  # [m], (nodes, ...), from the start of the flight
    y: Array
    vx: Array  # [m/s]
    vy: Array
    duration: Array  # [s], to the contact with the plate
    land_x: Array
    land_y: Array
    land_vx: Array
    land_vy: Array


def fly(
    vx: Array,
    vy: Array,
    gap: Array,
    sine: Array,
    cosine: Array,
    *,
    radius: Array,
    mass: Array,
    gravity: float,
    terms: Sequence[Effect],
    values: Mapping[str, Array],
) -> Paths:
    """Integrate until contact with the plate, tilted by the given sine and cosine; `gap` [m] is the initial gap."""
    forces: list[tuple[Any, list[Array]]] = [
        (term.force, [values[f"{term.name}.{p.name}"][:, None, None] for p in term.parameters])
        for term in terms
        if term.force is not None
    ]

    def pull(x: Array, y: Array, u: Array, v: Array) -> tuple[Array, Array]:
        ax, ay = np.zeros_like(u), np.full_like(v, -gravity)
        for force, own in forces:
            fx, fy = force(u, v, gap + y * cosine - x * sine, radius, mass, *own)
            ax, ay = ax + fx / mass, ay + fy / mass
        return ax, ay

    steep = any(term.steep for term in terms)
    rise = np.maximum(vy, 0.0)
    h = (vy + np.sqrt(rise * rise + 2 * gravity * gap)) / gravity / STEPS
    more = _finer(np.maximum(h, 1e-6), vy, gap, gravity, terms, values)
    h = np.maximum(h / more, 1e-6)
    x, y = np.zeros_like(vx), np.zeros_like(vy)
    xs, ys, us, vs = [x], [y], [vx], [vy]
    u, v = vx, vy
    landed = np.full(vx.shape, -1)
    for k in range(more * MOST):
        for share in GRADED if steep and k == 0 else (1.0,):
            x, y, u, v = _advance(pull, x, y, u, v, share * h)
        xs.append(x)
        ys.append(y)
        us.append(u)
        vs.append(v)
        touching = (landed < 0) & (gap + y * cosine - x * sine <= 0) & (v * cosine - u * sine < 0)
        landed[touching] = k
        if k >= more * STEPS // 2 and (landed >= 0).all():
            break
    nodes = [np.stack(series) for series in (xs, ys, us, vs)]
    last = len(xs) - 2
    at = np.where(landed < 0, last, landed)[None]
    begin = [np.take_along_axis(series, at, 0)[0] for series in nodes]
    end = [np.take_along_axis(series, at + 1, 0)[0] for series in nodes]
    high = gap + begin[1] * cosine - begin[0] * sine
    low = gap + end[1] * cosine - end[0] * sine
    speed = begin[3] * cosine - begin[2] * sine
    speed_end = end[3] * cosine - end[2] * sine
    s = np.clip(high / np.maximum(high - low, 1e-12), 0.0, 1.0)
    for _ in range(4):
        value = _cubic(high, low, speed * h, speed_end * h, s)
        slope = _cubic_slope(high, low, speed * h, speed_end * h, s)
        s = np.clip(s - value / np.where(np.abs(slope) < 1e-12, -1e-12, slope), 0.0, 1.2)
    land_x = _cubic(begin[0], end[0], begin[2] * h, end[2] * h, s)
    land_y = _cubic(begin[1], end[1], begin[3] * h, end[3] * h, s)
    land_vx = _cubic_slope(begin[0], end[0], begin[2] * h, end[2] * h, s) / h
    land_vy = _cubic_slope(begin[1], end[1], begin[3] * h, end[3] * h, s) / h
    duration = (at[0] + s) * h
    if steep:
        x, y, u, v = begin
        for share in GRADED[::-1]:
            x, y, u, v = _advance(pull, x, y, u, v, share * s * h)
        late = (gap + y * cosine - x * sine) / np.maximum(u * sine - v * cosine, 1e-3)
        late = np.clip(late, -0.1 * h, 0.1 * h)
        land_x, land_y, land_vx, land_vy = _advance(pull, x, y, u, v, late)
        duration = duration + late
    return Paths(h, nodes[0], nodes[1], nodes[2], nodes[3], duration, land_x, land_y, land_vx, land_vy)


def _finer(
    h: Array, vy: Array, gap: Array, gravity: float, terms: Sequence[Effect], values: Mapping[str, Array]
) -> int:
    """Refinement of the steps that forces with edges need, over the flights that reach an edge."""
    most = 1.0
    for term in terms:
        if term.edges is not None:
            low, width = term.edges(*(values[f"{term.name}.{p.name}"][:, None, None] for p in term.parameters))
            squared = vy * vy + 2 * gravity * (gap - np.maximum(low, 0.0))  # of the speed at the lowest edge
            most = max(most, float(np.max(np.sqrt(np.maximum(squared, 0.0)) * h / width / EDGES_PER_STEP, initial=1.0)))
    return int(np.clip(np.ceil(most), 1, FINEST)) if np.isfinite(most) else 1


def _advance(pull: Pull, x: Array, y: Array, u: Array, v: Array, h: Array) -> tuple[Array, Array, Array, Array]:
    """One step of the fourth-order Runge-Kutta method."""
    ax1, ay1 = pull(x, y, u, v)
    u2, v2 = u + 0.5 * h * ax1, v + 0.5 * h * ay1
    ax2, ay2 = pull(x + 0.5 * h * u, y + 0.5 * h * v, u2, v2)
    u3, v3 = u + 0.5 * h * ax2, v + 0.5 * h * ay2
    ax3, ay3 = pull(x + 0.5 * h * u2, y + 0.5 * h * v2, u3, v3)
    u4, v4 = u + h * ax3, v + h * ay3
    ax4, ay4 = pull(x + h * u3, y + h * v3, u4, v4)
    return (
        x + h / 6 * (u + 2 * u2 + 2 * u3 + u4),
        y + h / 6 * (v + 2 * v2 + 2 * v3 + v4),
        u + h / 6 * (ax1 + 2 * ax2 + 2 * ax3 + ax4),
        v + h / 6 * (ay1 + 2 * ay2 + 2 * ay3 + ay4),
    )


def where(
    paths: Paths, begin: Array, x_start: Array, y_start: Array, time: Array, owner: Any
) -> tuple[Array, Array, Array, Array]:
    """Position [m] and velocity [m/s] at `time` [s] (settings, rows); flights start at `begin` [s], at rest before."""
    settings, repetitions, flights = begin.shape
    base = (np.arange(settings)[:, None] * repetitions + owner[None]) * flights  # flat index of flight 0
    number = np.zeros(base.shape, dtype=np.int64)
    flat_begin = begin.reshape(-1)
    for j in range(1, flights):
        number += time >= flat_begin[base + j]
    cell = base + number
    since = time - flat_begin[cell]
    held = since < 0
    since = np.maximum(since, 0.0)
    h = paths.step.reshape(-1)[cell]
    nodes = paths.x.shape[0]
    s = since / h
    k = np.clip(s.astype(np.int64), 0, nodes - 2)
    s = s - k
    size = settings * repetitions * flights
    first, second = k * size + cell, (k + 1) * size + cell
    x, y, u, v = (series.reshape(-1) for series in (paths.x, paths.y, paths.vx, paths.vy))
    u0, u1, v0, v1 = u[first] * h, u[second] * h, v[first] * h, v[second] * h
    x0, x1, y0, y1 = x[first], x[second], y[first], y[second]
    px = _cubic(x0, x1, u0, u1, s) + x_start.reshape(-1)[cell]
    py = _cubic(y0, y1, v0, v1, s) + y_start.reshape(-1)[cell]
    vx = np.where(held[:1], 0.0, _cubic_slope(x0[:1], x1[:1], u0[:1], u1[:1], s[:1]) / h[:1])
    vy = np.where(held[:1], 0.0, _cubic_slope(y0[:1], y1[:1], v0[:1], v1[:1], s[:1]) / h[:1])
    return px, py, vx, vy


def _cubic(a: Array, b: Array, da: Array, db: Array, s: Array) -> Array:
    """Hermite cubic from a to b with end slopes da, db per step, at the fraction s of the step."""
    return a + s * (da + s * (3 * (b - a) - 2 * da - db + s * (2 * (a - b) + da + db)))


def _cubic_slope(a: Array, b: Array, da: Array, db: Array, s: Array) -> Array:
    return da + s * (2 * (3 * (b - a) - 2 * da - db) + 3 * s * (2 * (a - b) + da + db))
