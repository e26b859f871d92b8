"""Motion along a straight track until it stops, for many settings at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.integration import hermite, hermite_slope, runge_kutta

STEPS = 24
LATE, LONGEST = 1.5, 8.0
"""[steps]: length of the last step above which the time of the stop is estimated again; its longest useful length."""
MOST_ROUNDS = 12  # iterations for the time of the stop, each of which adds at most a third
SLOW = 1e-3  # [m/s], below which the body counts as at rest at the start

Pull = Callable[[Array, Array, Array], Array]
"""Acceleration along the track [m/s^2] from place [m], speed [m/s] and time since the start [s]."""


@dataclass(frozen=True)
class Ride:
    """Motion from time 0: arrays with nodes, shape (STEPS + 1, settings, repetitions)."""

    step: Array  # [s]
    end: Array  # [s], of the last node: the stop, or the end of the record
    place: Array  # [m]
    speed: Array  # [m/s]


def ride(place: Array, speed: Array, pull: Pull, until: Array, *, may_stop: bool = True) -> Ride:
    """Integrate from `place` [m] at `speed` [m/s] until `until` [s], or until the body stops."""
    zero = np.zeros_like(place)
    slowing = np.maximum(-pull(place, np.maximum(speed, 1e-4), zero), 1e-9)
    # a body released from rest that accelerates does not stop
    slows = may_stop & (speed > SLOW) & (slowing > 1e-6)
    stops = np.where(slows & (speed / slowing < until), speed / slowing, np.inf)
    stopping = np.isfinite(stops)
    for _ in range(MOST_ROUNDS):
        h = np.maximum(np.where(stopping, stops, until), 1e-4) / STEPS
        places, speeds, last = _ridden(place, speed, pull, h, stopping)
        # drag decreases with the speed, so the stop is later than estimated from the initial deceleration
        late = stopping & (last > LATE * h)
        if not late.any():
            break
        stops = np.where(late, (STEPS - 1) * h + np.minimum(last, LONGEST * h), stops)
        stopping = stops < until
    return Ride(h, (STEPS - 1) * h + last, np.stack(places), np.stack(speeds))


def _ridden(place: Array, speed: Array, pull: Pull, h: Array, stopping: Any) -> tuple[list[Array], list[Array], Array]:
    """Places and speeds after each step, and the length of the last step, which ends at the stop."""
    places, speeds = [place], [speed]
    t, s, v = np.zeros_like(place), place, speed
    for _ in range(STEPS - 1):
        s, v = runge_kutta(pull, s, v, h, t)
        t = t + h
        places.append(s)
        speeds.append(v)
    last = h
    end_s, end_v = runge_kutta(pull, s, v, last, t)
    for _ in range(4):  # Newton iteration to the stop
        bend = pull(end_s, np.maximum(end_v, 1e-5), t + last)
        correction = np.where(stopping & (bend < -1e-9), -end_v / np.where(bend == 0, 1.0, bend), 0.0)
        last = np.clip(last + correction, 0.05 * h, STEPS * h)
        end_s, end_v = runge_kutta(pull, s, v, last, t)
    places.append(end_s)
    speeds.append(np.where(stopping, 0.0, end_v))
    return places, speeds, last


def place_at(motion: Ride, since: Array, owner: Any) -> tuple[Array, Array]:
    """Place [m] and speed [m/s] at times `since` the start [s] (settings, rows); at rest before and after the stop."""
    nodes, settings, repetitions = motion.place.shape
    size = settings * repetitions
    base = np.arange(settings)[:, None] * repetitions + owner[None]
    h, end = motion.step.reshape(-1)[base], motion.end.reshape(-1)[base]
    held = since < 0
    inside = np.clip(since, 0.0, None)
    k = np.clip((inside / h).astype(np.int64), 0, nodes - 2)
    length = np.where(k == nodes - 2, end - k * h, h)
    over = np.maximum(inside - end, 0.0)
    s = np.minimum((inside - k * h) / length, 1.0)
    place, speed = motion.place.reshape(-1), motion.speed.reshape(-1)
    first = k * size + base
    step = place[first], place[first + size], speed[first] * length, speed[first + size] * length
    final = speed[(nodes - 1) * size + base]
    return hermite(*step, s) + over * final, np.where(held, 0.0, hermite_slope(*step, s) / length)
