"""Swings of a bob on a thread, integrated from turning point to turning point for many settings at once.

Between two turning points the sign of the rate is constant, so that dry friction is exact: each half swing starts at
the moment when the last one has come to rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.integration import hermite, hermite_slope, runge_kutta

STEPS = 30  # per half swing; numerical loss of amplitude 1e-8 per step; the path between two steps is a cubic
MOST_HALVES = 400  # half swings, far more than any film shows
LEAST_RATE = 1e-3  # [rad/s], above which dry friction acts fully

Push = Callable[..., Array]
"""Angular acceleration [rad/s^2] from angle [rad] and rate [rad/s], without the sign change of dry friction at rest;
for a driven bob also from the time [s] since its release."""


@dataclass(frozen=True)
class HalfSwings:
    """Consecutive half swings: arrays of shape (half swings, nodes, settings, repetitions)."""

    begin: Array  # [s], (half swings + 1, settings, repetitions), from the release
    step: Array  # [s], (half swings, settings, repetitions)
    angle: Array  # [rad]
    rate: Array  # [rad/s]


def half_swings(
    angle: Array,
    push: Push,
    omega: Array,
    until: Array,
    rate: Array | None = None,
    *,
    dry: bool = True,
    driven: bool = False,
) -> HalfSwings:
    """Swing from `angle` [rad] at rest (or with `rate` [rad/s]) for at least `until` [s]; `omega` [1/s] is sqrt(g/L).

    Without `dry` friction the bob never sticks.  If it is `driven`, the force depends on time, and it never sticks.
    """
    begin = [np.zeros_like(angle)]
    steps, angles, rates = [], [], []
    theta = angle
    omega_now = np.zeros_like(angle) if rate is None else rate
    stuck = np.zeros(angle.shape, dtype=bool)
    for _ in range(MOST_HALVES):
        resting = np.abs(omega_now) < 1e-9
        side = np.where(resting, -np.sign(theta), np.sign(omega_now))
        side = np.where(side == 0, 1.0, side)
        if dry and not driven:
            stuck |= resting & (push(theta, side * LEAST_RATE) * side <= 0)
        live = np.where(stuck, 0.0, 1.0)

        def held_back(a: Array, w: Array, *now: Array, side: Array = side, live: Array = live) -> Array:
            return live * push(a, side * np.maximum(side * w, LEAST_RATE), *now)

        change = held_back if dry else push
        h = _duration(theta, omega_now, omega, side) / STEPS
        node_angle, node_rate = [theta], [omega_now]
        a, w = theta, omega_now
        for k in range(STEPS - 1):
            a, w = runge_kutta(change, a, w, h, begin[-1] + k * h if driven else None)
            node_angle.append(a)
            node_rate.append(w)
        last = h
        now = begin[-1] + (STEPS - 1) * h if driven else None
        end_a, end_w = runge_kutta(change, a, w, last, now)
        for _ in range(3):  # Newton iteration to the turning point
            bend = change(end_a, end_w) if now is None else change(end_a, end_w, now + last)
            correction = np.where(np.abs(bend) > 1e-9, -end_w / np.where(bend == 0, 1.0, bend), 0.0)
            last = np.clip(last + np.clip(correction, -0.7 * h, 0.7 * h), 0.05 * h, 6 * h)
            end_a, end_w = runge_kutta(change, a, w, last, now)
        node_angle.append(end_a)
        node_rate.append(np.zeros_like(end_w))
        steps.append(h)
        angles.append(np.stack(node_angle))
        rates.append(np.stack(node_rate))
        begin.append(begin[-1] + (STEPS - 1) * h + last)
        theta, omega_now = end_a, np.zeros_like(end_w)
        if not (begin[-1] <= until).any():  # a motion that has become NaN, as trial models may, never gets there
            break
    return HalfSwings(np.stack(begin), np.stack(steps), np.stack(angles), np.stack(rates))


def _duration(theta: Array, rate: Array, omega: Array, side: Array) -> Array:
    """Time [s] to the next turning point without damping."""
    # amplitude from the energy, phase from the harmonic motion of that amplitude
    energy = np.clip(np.cos(theta) - 0.5 * (rate / omega) ** 2, -0.999, 1.0)
    amplitude = np.maximum(np.arccos(energy), 1e-6)
    slow = 1 + amplitude**2 / 16 + 11 * amplitude**4 / 3072 + 173 * amplitude**6 / 737280
    phase = np.arccos(np.clip(-side * theta / amplitude, -1.0, 1.0))  # 0 at the start of the half swing
    return np.maximum((math.pi - phase) / omega * slow, 1e-3)


def angle_at(swings: HalfSwings, since: Array, owner: Any) -> tuple[Array, Array]:
    """Angle [rad] and rate [rad/s] at times `since` the release [s] (settings, rows); at rest before it."""
    count, nodes, settings, repetitions = swings.angle.shape
    held = since < 0
    since = np.maximum(since, 0.0)
    base = np.arange(settings)[:, None] * repetitions + owner[None]
    size = settings * repetitions
    begin = swings.begin.reshape(count + 1, size)
    number = np.zeros(base.shape, dtype=np.int64)
    for half in range(1, count):
        number += since >= begin[half][base]
    flat_begin = begin.reshape(-1)
    start = flat_begin[number * size + base]
    end = flat_begin[(number + 1) * size + base]
    h = swings.step.reshape(-1)[number * size + base]
    s = since - start
    k = np.clip((s / h).astype(np.int64), 0, nodes - 2)
    length = np.where(k == nodes - 2, end - start - k * h, h)
    s = np.minimum((s - k * h) / length, 1.0)
    first = (number * nodes + k) * size + base
    angle, rate = swings.angle.reshape(-1), swings.rate.reshape(-1)
    a, b = angle[first], angle[first + size]
    da, db = rate[first] * length, rate[first + size] * length
    return hermite(a, b, da, db, s), np.where(held, 0.0, hermite_slope(a, b, da, db, s) / length)
