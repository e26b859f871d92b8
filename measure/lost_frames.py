"""A frame that a film lost, or shows twice, without its times saying so: found by the flights of a bouncing bead.

From there on every frame is a whole number of intervals late or early.  Within a flight that tears the parabola apart.
At a contact each flight stays whole, but the two no longer meet on the plate: they cross higher up, where a lost frame
brings them together, or lower, and a fit takes that for a bead that leaves the plane, unless it asks for this first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
import numpy.typing as npt

from rigtwin.measure.flights import Bounces, Heights, find_contacts, third_difference_noise

Array = npt.NDArray[np.float64]
Fit = Callable[[Heights], Bounces | None]

LOST = (1, 2, 3, -1)  # frames; a negative one is shown twice
MOST = 3  # places in a record: where more are torn, its times are not worth mending
ILL_FITTED = 2.5  # times its noise that a track may leave its fitted flights
TORN = 1.5  # times less scatter that the halves of a flight leave than the whole
GAINED = 60.0  # squares of the noise: that a place is tried at every frame gains a dozen, slow errors some times that
WILD = 5.0  # times the noise, more than which a point does not count: it may show something else
SHORTEST = 1  # frames on either side of a place within a flight
BESIDE = 3  # frames from a contact, up to which too few lie between to be a half of a flight
SURELY = 5.0  # standard uncertainties of a plate's steps from contact to contact, from which on they are real
LEVEL = 0.1  # of them, that may be left


@dataclass(frozen=True)
class Loss:
    """A place in a record where frames are lost, or one is shown twice."""

    index: int  # of the first point after it
    frames: int  # lost; negative: shown twice
    at_contact: bool  # told by where the flights meet alone
    sure: bool = True  # whether a bead that leaves the plane could hardly look the same


def find_losses(record: Heights, fit: Fit) -> tuple[Loss, ...]:
    """Where frames are lost, or none where that does not explain the record; `fit` tells its bounces."""
    losses: list[Loss] = []
    mended, bounces = record, fit(record)
    while len(losses) < MOST:
        better = _better(mended, bounces, fit)
        if better is None:
            break
        loss, bounces = better
        losses.append(loss)
        mended = replace(mended, time=in_time(mended.time, (loss,)))
    return tuple(losses) if bounces is not None and _misfit(bounces) < ILL_FITTED else ()


def in_time(time: Array, losses: tuple[Loss, ...]) -> Array:
    """[s], with all that comes after a loss moved on by the frames that are lost, or back."""
    moved = time.copy()
    for loss in losses:
        moved[loss.index :] += loss.frames * float(np.median(np.diff(time)))
    return moved


def _better(record: Heights, bounces: Bounces | None, fit: Fit) -> tuple[Loss, Bounces] | None:
    """The loss that explains a record best, with its bounces then."""
    if len(record.time) <= 12:
        return None
    noise = _noise(record)
    before = _left(bounces, noise)
    found: list[tuple[float, Loss, Bounces]] = []
    for loss in [*_within_flights(record, noise), *(() if bounces is None else _at_contacts(record, bounces))]:
        fitted = fit(replace(record, time=in_time(record.time, (loss,))))
        if fitted is None:
            continue
        left = _left(fitted, noise)
        if loss.at_contact and bounces is not None and _meet(fitted, bounces) and left < before + GAINED:
            # one step of the plate may be that of a bead that leaves the plane, several hardly
            found.append((left, replace(loss, sure=fitted.count > 2), fitted))
        elif left < before - GAINED and left < before / TORN:
            found.append((left, replace(loss, at_contact=False), fitted))
    if not found:
        return None
    _, loss, fitted = min(found, key=lambda each: each[0])
    return loss, fitted


def _noise(record: Heights) -> float:
    return max(third_difference_noise(record), 2e-5 * float(np.ptp(record.height)))


def _left(bounces: Bounces | None, noise: float) -> float:
    """What a fit leaves of the record from the release on, in squares of the noise, also where it knows no flight."""
    if bounces is None:
        return math.inf
    off = (bounces.residual / noise) ** 2
    falls = int(np.argmax(np.isfinite(off)))
    return float(np.sum(np.fmin(off[falls:], WILD**2)))


def _misfit(bounces: Bounces) -> float:
    return bounces.noise / max(bounces.expected_noise, 2e-5 * bounces.span)


# ------------------------------------------------------------------------------------------------------ within a flight


def _within_flights(record: Heights, noise: float) -> Iterator[Loss]:
    """Places in each flight that make one curve of two halves: a parabola, or what air and lens make of it."""
    contacts = find_contacts(record).tolist()
    falls = np.flatnonzero(record.height > 0.97 * np.max(record.height) + 0.03 * np.min(record.height))
    start = int(falls[falls < contacts[0]][-1]) if contacts and np.any(falls < contacts[0]) else 0
    for first, last in pairwise([start, *contacts, len(record.time)]):
        flight = np.s_[first + 1 : last]
        for degree in (2, 3):
            place = _torn_at(record.time[flight], record.height[flight], degree, noise)
            if place is not None:
                yield Loss(first + 1 + place[0], place[1], at_contact=False)


def _torn_at(time: Array, height: Array, degree: int, noise: float) -> tuple[int, int] | None:
    if len(time) < 2 * SHORTEST + degree:
        return None
    whole = _off_curve(time[None], height, degree)[0]
    if whole < TORN * noise:
        return None
    step = float(np.median(np.diff(time)))
    places = list(product(range(SHORTEST, len(time) - SHORTEST + 1), LOST))
    scatter = _off_curve(
        np.array([time + lost * step * (np.arange(len(time)) >= k) for k, lost in places]), height, degree
    )
    best = int(np.argmin(scatter))
    return places[best] if scatter[best] < whole / TORN else None


def _off_curve(times: Array, height: Array, degree: int) -> Array:
    """Root mean square that polynomials leave of heights at various times, shape (m, n); shape (m,)."""
    since = times - times.mean(axis=1, keepdims=True)
    since /= np.ptp(since, axis=1)[:, None]
    q, _ = np.linalg.qr(since[:, :, None] ** np.arange(degree + 1))
    off = height - np.squeeze(q @ (np.swapaxes(q, 1, 2) @ height[:, None]), axis=2)
    return np.asarray(np.sqrt(np.mean(off**2, axis=1)))


# -------------------------------------------------------------------------------------------------------- at a contact


def _at_contacts(record: Heights, bounces: Bounces) -> Iterator[Loss]:
    """Places about a contact at which flights meet as far from the plate as lost frames make them."""
    steps, doubts = _steps(bounces)
    if not len(steps) or not np.any(np.abs(steps) > SURELY * doubts):
        return
    step = float(np.median(np.diff(record.time)))
    reader = bounces.model.reader(bounces.parameters)
    for k, lost in product(range(bounces.count), LOST):
        down, up = reader.impact_speed(k + 1), reader.rebound_speed(k + 1)
        levels = np.zeros(bounces.count)
        levels[k] = lost * step * reader.size * down * up / (down + up)
        if float(np.max(np.abs(steps - np.diff(levels)))) > 0.5 * float(np.max(np.abs(steps))):
            continue
        after = int(np.searchsorted(record.time, bounces.contact_times[k]))
        for index in range(max(after - BESIDE, 1), min(after + BESIDE + 1, len(record.time))):
            yield Loss(index, lost, at_contact=True)


def _steps(bounces: Bounces) -> tuple[Array, Array]:
    """Of the plate's level from contact to contact, and their standard uncertainties, shape (count - 1,).

    What follows the last contact shows no level of its own.
    """
    count = bounces.count
    _, levels, _ = bounces.model.split(bounces.parameters)
    mine = bounces.covariance[3 + count : 3 + 2 * count, 3 + count : 3 + 2 * count]
    spread = np.diag(mine)
    variance = spread[1:] + spread[:-1] - 2 * np.diag(mine, 1)
    return np.diff(levels[:count]), np.sqrt(np.maximum(variance, 1e-300))


def _meet(mended: Bounces, before: Bounces) -> bool:
    """Whether flights meet on a level plate, which did not."""
    if mended.count < before.count:
        return False
    left, were = (float(np.max(np.abs(_steps(each)[0][: before.count - 1]))) for each in (mended, before))
    return left < LEVEL * were and math.isfinite(left)
