"""Flights of a sphere between impacts, integrated by Runge-Kutta for many settings at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array, Mask
from rigtwin.lab.integration import hermite, hermite_slope, runge_kutta
from rigtwin.sim.effects import Effect

STEPS = 14  # steps per flight in a vacuum; the path between two steps is a cubic
MOST = 60  # largest number of steps of a flight
MOST_SLOW = 150  # the same in a liquid: after a hundred damping times the velocity is constant
EDGES_PER_STEP = 4.0  # [edge widths], longest step across an edge; the impulse of a band then errs by at most 1 %
FINEST = 32  # largest refinement of the steps, to bound the cost of a band that a fit makes very narrow
STEPS_PER_DAMPING_TIME = 1.5  # the paths of beads in liquids are then within 0.1 % of finer ones
BISECTIONS = 12  # the speed is then right to a four thousandth of its upper bound; it decides on steps only
STEADY = 1e-9  # relative change of the velocity in a step, below which it counts as constant; chosen near rounding
CREEPING_SPEED = 1e-4  # [m/s], change of the velocity from which the damping time is taken
LIGHTEST = 0.01  # [gravity], apparent gravity for which the steps of a nearly neutral bead in a liquid are made
FINE = 16  # sub-steps of the first and the last step for a steep force
GRADED = 2.0 * np.arange(1, FINE + 1) / (FINE * (FINE + 1))
"""Fractions of the first step, smallest at the plate (reversed for the last), for a force that is steep there."""


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
    across: Array | float = 0.0,
) -> Paths:
    """Integrate until contact with the plate, tilted by the given sine and cosine; `gap` [m] is the initial gap.

    `across` [m] is the place along x at which each flight starts, for forces that depend on it.
    """

    def acting(hook: str) -> list[tuple[Any, list[Array]]]:
        return [
            (getattr(term, hook), [values[f"{term.name}.{p.name}"][:, None, None] for p in term.parameters])
            for term in terms
            if getattr(term, hook) is not None
        ]

    forces, pulls = acting("force"), acting("sideways")

    def above(place: Array) -> Array:
        return np.asarray(gap + place[1] * cosine - place[0] * sine)

    def away(velocity: Array) -> Array:
        return np.asarray(velocity[1] * cosine - velocity[0] * sine)

    def pull(place: Array, velocity: Array) -> Array:
        u, v = velocity
        ax, ay = np.zeros_like(u), np.full_like(v, -gravity)
        for force, own in forces:
            fx, fy = force(u, v, above(place), radius, mass, *own)
            ax, ay = ax + fx / mass, ay + fy / mass
        for sideways, own in pulls:
            ax = ax + sideways(across + place[0], radius, mass, *own) / mass
        return np.stack([ax, ay])

    steep = any(term.steep for term in terms)
    slow = any(term.slow for term in terms)
    h = _steps(pull, vx, vy, gap, gravity, slow=slow)
    more = _finer(np.maximum(h, 1e-6), vy, gap, gravity, terms, values)
    h = np.maximum(h / more, 1e-6)
    velocity = np.stack([vx, vy])  # both along x and y, in front
    place = np.zeros_like(velocity)
    places, velocities = [place], [velocity]
    landed, steady = np.full(vx.shape, -1), False
    for k in range(more * (MOST_SLOW if slow else MOST)):
        for share in GRADED if steep and k == 0 else (1.0,):
            place, velocity = runge_kutta(pull, place, velocity, share * h)
        places.append(place)
        velocities.append(velocity)
        touching = (landed < 0) & (above(place) <= 0) & (away(velocity) < 0)
        landed[touching] = k
        unchanged = np.abs(velocity - velocities[-2]) < STEADY * np.abs(velocity).max(axis=0)
        steady = slow and bool(np.all(unchanged | (landed >= 0)))
        if steady or (k >= more * STEPS // 2 and (landed >= 0).all()):
            break
    nodes, speeds = np.stack(places), np.stack(velocities)
    last = len(places) - 2
    at = np.where(landed < 0, last, landed)[None, None]
    begin, end = (np.take_along_axis(nodes, at + k, 0)[0] for k in (0, 1))
    speed, speed_end = (np.take_along_axis(speeds, at + k, 0)[0] for k in (0, 1))
    skipped = _skipped(above(begin), away(speed) * h, steady & (landed < 0))
    begin, end = begin + skipped * h * speed, end + skipped * h * speed
    fall = above(begin), above(end), away(speed) * h, away(speed_end) * h
    s = np.clip(fall[0] / np.maximum(fall[0] - fall[1], 1e-12), 0.0, 1.0)
    for _ in range(4):
        value, slope = hermite(*fall, s), hermite_slope(*fall, s)
        s = np.clip(s - value / np.where(np.abs(slope) < 1e-12, -1e-12, slope), 0.0, 1.2)
    step = begin, end, speed * h, speed_end * h
    land, land_speed = hermite(*step, s), hermite_slope(*step, s) / h
    duration = (at[0, 0] + skipped + s) * h
    if steep:
        place, velocity = begin, speed
        for share in GRADED[::-1]:
            place, velocity = runge_kutta(pull, place, velocity, share * s * h)
        late = np.clip(above(place) / np.maximum(-away(velocity), 1e-3), -0.1 * h, 0.1 * h)
        land, land_speed = runge_kutta(pull, place, velocity, late)
        duration = duration + late
    return Paths(h, nodes[:, 0], nodes[:, 1], speeds[:, 0], speeds[:, 1], duration, *land, *land_speed)


def _skipped(above: Array, rise: Array, steady: Mask) -> Array:
    """Number of steps until the last one above the plate for beads that sink at a constant velocity, else 0.

    `above` [m] is the height at the last step computed, `rise` [m] the change of it in one step.
    """
    sinking = np.where(steady & (rise < 0), -rise, np.inf)
    return np.asarray(np.maximum(above / sinking - 1.0, 0.0))


def _steps(
    pull: Callable[[Array, Array], Array], vx: Array, vy: Array, gap: Array, gravity: float, *, slow: bool
) -> Array:
    """Length [s] of the steps of each flight: a share of a fall without drag, in a liquid also of its damping time."""
    rise = np.maximum(vy, 0.0)
    weight = np.full_like(vy, gravity)
    if slow:
        rest = np.zeros((2, *vx.shape))
        weight = np.maximum(np.abs(pull(rest, rest)[1]), LIGHTEST * gravity)
    fastest = np.sqrt(rise * rise + 2 * weight * gap)
    h = (vy + fastest) / weight / STEPS
    if not slow:
        return np.asarray(h)
    sinking = _sinking_speed(pull, vx, fastest)
    damping = np.maximum(_damping(pull, vx, rise), _damping(pull, vx, -sinking))
    return np.asarray(h / np.maximum(STEPS_PER_DAMPING_TIME * h * damping, 1.0))


def _sinking_speed(pull: Callable[[Array, Array], Array], vx: Array, fastest: Array) -> Array:
    """Speed [m/s] at which drag balances the weight of a sinking bead, at most `fastest` [m/s]; by bisection."""
    place = np.zeros((2, *vx.shape))
    low, high = np.zeros_like(fastest), fastest
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        gains = pull(place, np.stack([np.zeros_like(vx), -middle]))[1] < 0
        low, high = np.where(gains, middle, low), np.where(gains, high, middle)
    return np.asarray(low)


def _damping(pull: Callable[[Array, Array], Array], vx: Array, vy: Array) -> Array:
    """Rate [1/s] at which drag slows a small change of a vertical velocity [m/s]."""
    velocity = np.stack([np.zeros_like(vx), vy])
    change = np.stack([np.zeros_like(vx), np.full_like(vx, CREEPING_SPEED)])
    place = np.zeros_like(velocity)
    return np.asarray((pull(place, velocity - change) - pull(place, velocity + change))[1] / (2 * CREEPING_SPEED))


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
    beyond, s = np.maximum(s - 1.0, 0.0), np.minimum(s, 1.0)  # steps after the last node, at the velocity there
    size = settings * repetitions * flights
    first, second = k * size + cell, (k + 1) * size + cell
    x, y, u, v = (series.reshape(-1) for series in (paths.x, paths.y, paths.vx, paths.vy))
    u0, u1, v0, v1 = u[first] * h, u[second] * h, v[first] * h, v[second] * h
    x0, x1, y0, y1 = x[first], x[second], y[first], y[second]
    px = hermite(x0, x1, u0, u1, s) + beyond * u1 + x_start.reshape(-1)[cell]
    py = hermite(y0, y1, v0, v1, s) + beyond * v1 + y_start.reshape(-1)[cell]
    vx = np.where(held[:1], 0.0, hermite_slope(x0[:1], x1[:1], u0[:1], u1[:1], s[:1]) / h[:1])
    vy = np.where(held[:1], 0.0, hermite_slope(y0[:1], y1[:1], v0[:1], v1[:1], s[:1]) / h[:1])
    return px, py, vx, vy
