"""One or two bobs on threads that swing and collide, integrated for many settings at once.

Steps have a fixed length and are shortened to end at each contact.  The impact acts there, before the next step.  Bobs
that touch at the beginning of a step and again at its end rest against each other: the step is not shortened, and their
closing rate becomes the one with which they touch again at the end of the next step.  A rebound that ends within one
step is lost by this, and in the first step they overlap by what the force that presses them moves in one step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.integration import hermite, hermite_slope, runge_kutta
from rigtwin.sim.reduced.swing import LEAST_RATE, Push

PER_PERIOD = 50  # steps per period
LEAST_CLOSING = 1e-12  # [m/s], avoids division by zero
MOST_EXTRA = 40  # additional steps, one per contact
TOUCHING = 1e-6  # [m], gap below which surfaces touch: above what one step of resting errs by, below any that is filmed

Gap = Callable[[Array, Array, Array, Array], tuple[Array, Array]]
"""Distance of the surfaces [m] and its rate [m/s] from angles and rates of both bobs."""
Hit = Callable[[Array, Array, Array, Array, Array, Array], tuple[Array, Array, Array]]
"""Rates after a contact, and its closing speed, from angles, rates, number of the impact, and the restitution of bobs
that rest against each other, NaN of an impact."""
Mutual = Callable[[Array, Array], tuple[Array, Array]]
"""Angular accelerations [rad/s^2] of both bobs by the force between them, from their angles."""
Advance = Callable[[Push, Array, Array, Array], tuple[Array, Array]]
"""Angle [rad] and rate [rad/s] after a step [s]."""


@dataclass(frozen=True)
class Encounter:
    """Motion with contacts: arrays of shape (intervals, settings, repetitions); ends are before the impact there."""

    begin: Array  # [s]
    length: Array  # [s]
    angle: tuple[Array, Array]  # [rad] at the begin, of both bobs
    rate: tuple[Array, Array]  # [rad/s]
    angle_end: tuple[Array, Array]
    rate_end: tuple[Array, Array]
    speeds: Array  # [m/s], (impacts, settings, repetitions), closing speed of each; 1 without an impact


def swing_and_hit(
    start: tuple[Array, Array],
    push: tuple[Push, Push],
    period: Array,
    until: Array,
    gap: Gap,
    hit: Hit,
    impacts: int,
    *,
    dry: bool = False,
    mutual: Mutual | None = None,
) -> Encounter:
    """Integrate from rest at the angles `start` [rad] for at least `until` [s].

    With `dry` friction the force changes its sign at turning points within a step, or holds the bob there.  With a
    `mutual` force the second bob moves from the start, and dry friction is smooth.
    """
    a, b = start
    u, v = np.zeros_like(a), np.zeros_like(b)
    t = np.zeros_like(a)
    count, touched = np.zeros(a.shape, dtype=int), np.zeros(a.shape, dtype=bool)
    speeds = np.ones((impacts, *a.shape))
    step = np.broadcast_to(period / PER_PERIOD, a.shape)
    saved: list[tuple[Array, ...]] = []
    # extreme parameters of a fit would need an unlimited number of steps; their prediction is rejected later
    limit = int(np.nan_to_num(until / step, nan=0.0, posinf=0.0).max()) + MOST_EXTRA
    distance, closing = gap(a, b, u, v)
    for _ in range(limit):
        mobile = np.where(touched, 1.0, 0.0)  # before the first contact the second bob is at rest
        second: Push = partial(_moving_after_impact, push[1], mobile) if mobile.any() else _at_rest

        if mutual is None:
            on = partial(_both, _dry if dry else runge_kutta, (push[0], second), a, b, u, v)
        else:
            on = partial(_coupled, push, mutual, a, b, u, v)
        ends = on(step)
        distance_end, closing_end = gap(*ends)
        resting = (distance < TOUCHING) & (distance_end < TOUCHING) & (closing_end < 0)
        touching = (distance_end < 0) & (closing_end < 0) & ~resting
        closes = resting | touching
        length = step.copy()
        if touching.any():
            share = _first_zero(np.maximum(distance, 0.0), distance_end, closing * step, closing_end * step)
            length = np.where(touching, step * share, step)
            for _again in range(2):  # Newton iteration, from a start within 1/1000 of the step
                ends = on(length)
                off, speed_off = gap(*ends)
                length = np.where(touching, np.clip(length - off / np.minimum(speed_off, -1e-6), 1e-9, step), step)
            ends = on(length)
        saved.append((t, length, a, b, u, v, *ends))
        t = t + length
        a, b, u, v = ends
        if closes.any():
            parting = (closing - closing_end) / 2 - distance_end / step
            share = np.where(resting, parting / np.maximum(-closing_end, LEAST_CLOSING), np.nan)
            u2, v2, speed = hit(a, b, u, v, count, share)
            u, v = np.where(closes, u2, u), np.where(closes, v2, v)
            for k in range(impacts):
                speeds[k] = np.where(touching & (count == k), np.maximum(speed, 1e-3), speeds[k])
            count, touched = count + touching, touched | closes
            distance, closing = gap(a, b, u, v)
        else:
            distance, closing = distance_end, closing_end
        if (t >= until).all():
            break
    columns = [np.stack(column) for column in zip(*saved, strict=True)]
    return Encounter(
        columns[0], columns[1], (columns[2], columns[3]), (columns[4], columns[5]),
        (columns[6], columns[7]), (columns[8], columns[9]), speeds,
    )  # fmt: skip


def _at_rest(angle: Array, _rate: Array) -> Array:
    return np.zeros_like(angle)


def _moving_after_impact(push: Push, mobile: Array, angle: Array, rate: Array) -> Array:
    return np.asarray(mobile * push(angle, rate))


def _both(
    advance: Advance, push: tuple[Push, Push], a: Array, b: Array, u: Array, v: Array, h: Array
) -> tuple[Array, Array, Array, Array]:
    a2, u2 = advance(push[0], a, u, h)
    b2, v2 = advance(push[1], b, v, h)
    return a2, b2, u2, v2


def _coupled(
    push: tuple[Push, Push], mutual: Mutual, a: Array, b: Array, u: Array, v: Array, h: Array
) -> tuple[Array, Array, Array, Array]:
    def change(angles: Array, rates: Array) -> Array:
        one, other = mutual(angles[0], angles[1])
        return np.array([push[0](angles[0], rates[0]) + one, push[1](angles[1], rates[1]) + other])

    # np.stack takes twice as long
    angles, rates = runge_kutta(change, np.array([a, b]), np.array([u, v]), h)
    return angles[0], angles[1], rates[0], rates[1]


def _dry(push: Push, angle: Array, rate: Array, h: Array) -> tuple[Array, Array]:
    """Step with dry friction: integrated with one sign of the friction, then corrected if the bob turned."""
    resting = rate == 0
    side = np.where(resting, np.where(angle > 0, -1.0, 1.0), np.sign(rate))
    stuck = resting & (side * push(angle, side * LEAST_RATE) <= 0)

    def one_way(a: Array, w: Array) -> Array:
        return np.where(stuck, 0.0, push(a, side * np.maximum(side * w, LEAST_RATE)))

    angle_end, rate_end = runge_kutta(one_way, angle, rate, h)
    turns = side * rate_end < 0
    if not turns.any():
        return angle_end, rate_end
    there, back = push(angle_end, side * LEAST_RATE), push(angle_end, -side * LEAST_RATE)
    bend = np.where(turns, there, 1.0)
    change = 2 * (bend - (rate_end - rate) / h)  # of the acceleration over the step
    since = rate_end / bend
    since = np.where(turns, np.clip(rate_end / (bend - change * since / (2 * h)), 0.0, h), 0.0)
    gone = since * (rate_end - since * (bend / 2 - change * since / (6 * h)))  # [rad], from the turning point
    sticks = turns & (side * back >= 0)
    return (
        np.where(sticks, angle_end - gone, angle_end + 0.5 * (back - there) * since**2),
        np.where(sticks, 0.0, rate_end + (back - there) * since),
    )


def _first_zero(high: Array, low: Array, slope: Array, slope_end: Array) -> Array:
    """Fraction of the step at which a cubic from `high` falls below zero, by bisection."""
    left, right = np.zeros_like(high), np.ones_like(high)
    for _ in range(12):
        middle = 0.5 * (left + right)
        value = hermite(high, low, slope, slope_end, middle)
        left, right = np.where(value > 0, middle, left), np.where(value > 0, right, middle)
    return 0.5 * (left + right)


def angles_at(motion: Encounter, since: Array, owner: Any, body: Any) -> tuple[Array, Array]:
    """Angle [rad] and rate [rad/s] of each row's bob at times `since` the release [s]; at rest before it."""
    intervals, settings, repetitions = motion.begin.shape
    size = settings * repetitions
    base = np.arange(settings)[:, None] * repetitions + owner[None]
    held = since < 0
    inside = np.maximum(since, 0.0)
    # one sorted list of all begins: those of each motion are shifted past all times of the one before.  An impossible
    # setting has NaN or infinite begins; they count as begins after the last time asked for, which change nothing
    last = float(np.nanmax(inside, initial=0.0)) + 1.0
    early = np.minimum(np.nan_to_num(motion.begin, nan=last, posinf=last), last).reshape(intervals, size)
    after = last + 1.0
    begins = (early + after * np.arange(size)).T.reshape(-1)
    number = np.searchsorted(begins, inside + after * base, side="right") - 1 - intervals * base
    cell = np.clip(number, 0, intervals - 1) * size + base
    length = motion.length.reshape(-1)[cell]
    s = np.minimum((inside - motion.begin.reshape(-1)[cell]) / length, 1.0)

    def of(pair: tuple[Array, Array]) -> Array:
        return np.asarray(np.where(body[None] == 0, pair[0].reshape(-1)[cell], pair[1].reshape(-1)[cell]))

    step = of(motion.angle), of(motion.angle_end), of(motion.rate) * length, of(motion.rate_end) * length
    return hermite(*step, s), np.where(held, 0.0, hermite_slope(*step, s) / length)
