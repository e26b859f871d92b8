"""A frame that a film lost, or shows twice, without its times saying so: found by the flights of a bouncing bead.

From there on every frame is a whole number of intervals late or early.  Within a flight that tears the parabola apart.
At a contact each flight stays whole, but the two no longer meet on the plate: they cross higher up, where a lost frame
brings them together, or lower, and a fit takes that for a bead that leaves the plane, unless it asks for this first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
import numpy.typing as npt

from rigtwin.measure.flights import Bounces, Heights, find_contacts, third_difference_noise

Array = npt.NDArray[np.float64]
Fit = Callable[[Heights], Bounces | None]

LOST = (1, 2, 3, -1)  # frames; a negative one is shown twice
MOST = 3  # places in a record: where more are torn, its times are not worth mending
TRIED = 3  # places of either kind, the likeliest, that the whole record is fitted with
ILL_FITTED = 2.5  # times its noise that a track may leave its fitted flights
TORN = 1.5  # times less scatter that the halves of a flight leave than the whole
GAINED = 60.0  # squares of the noise: that a place is tried at every frame gains a dozen, slow errors some times that
WILD = 5.0  # times the noise, more than which a point does not count: it may show something else
SHORTEST = 2  # frames on either side of a place within a flight; one alone may show something else
OUTERMOST = 3  # the same of the first and the last flight, of which no next contact tells
BESIDE = 3  # frames from a contact, up to which too few lie between to be a half of a flight
SOFT = 0.015  # [s], from a contact, up to which one that lasts, as a ball of foam's does, may be what bends a flight
SURELY = 5.0  # standard uncertainties of a plate's steps from contact to contact, from which on they are real
LEVEL = 0.1  # of them, that may be left
AS_NOISE = 1.2  # squares of the noise for each point, that a fit may leave where nothing can be torn


@dataclass(frozen=True)
class Loss:
    """A place in a record where frames are lost, or one is shown twice."""

    index: int  # of the first point after it
    frames: int  # lost; negative: shown twice
    time: float  # [s], of that point as the record tells it
    shift: float  # [s], by which all that follows is late
    at_contact: bool  # told by where the flights meet alone
    sure: bool = True  # whether nothing else could look the same; else times are not to be moved


def find_losses(record: Heights, fit: Fit) -> tuple[Loss, ...]:
    """Where frames are lost, or none where that does not explain the record; `fit` tells its bounces.

    One that is not sure is the last: what else there may be would rest on it.
    """
    if len(record.time) <= 12:
        return ()
    losses: list[Loss] = []
    bounces = fit(record)
    while len(losses) < MOST and all(loss.sure for loss in losses):
        better = _better(replace(record, time=in_time(record.time, losses)), bounces, fit)
        if better is None:
            break
        loss, bounces = better
        losses.append(replace(loss, time=float(record.time[loss.index])))
    return tuple(losses) if bounces is not None and _misfit(bounces) < ILL_FITTED else ()


def in_time(time: Array, losses: Iterable[Loss]) -> Array:
    """[s], with all that comes after a sure loss moved on by the frames that are lost, or back."""
    moved = time.copy()
    for loss in losses:
        if loss.sure:
            moved[loss.index :] += loss.shift
    return moved


def _better(record: Heights, bounces: Bounces | None, fit: Fit) -> tuple[Loss, Bounces] | None:
    """The loss that explains a record best, with its bounces then."""
    noise = _noise(record)
    if bounces is not None and _as_noise(bounces, noise) and _level(bounces):
        return None
    before = _left(bounces, noise)
    found: list[tuple[float, Loss, Bounces]] = []
    for place in [*_within_flights(record, noise), *(() if bounces is None else _at_contacts(record, bounces))]:
        tried = _fitted(record, place, noise, fit)
        if tried is None:
            continue
        loss, fitted = tried
        left = _left(fitted, noise)
        beside = _beside(record, loss, fitted)
        tears = left < before - GAINED and left < before / TORN
        if beside is None:
            if tears:
                found.append((left, replace(loss, at_contact=False), fitted))
            continue
        meets = bounces is not None and _meet(fitted, bounces)
        if tears or (meets and left < before + GAINED):
            sure = bounces is not None and meets and _lifted_alone(beside, fitted, bounces)
            found.append((left, replace(loss, at_contact=True, sure=sure), fitted))
    if not found:
        return None
    _, loss, fitted = min(found, key=lambda each: each[0])
    return loss, fitted


def _fitted(record: Heights, loss: Loss, noise: float, fit: Fit) -> tuple[Loss, Bounces] | None:
    """The record with a loss; of the points about a contact those are taken to follow it that lie so on the flights."""
    fitted = fit(_mended(record, loss))
    if fitted is None:
        return None
    if not loss.at_contact:
        return loss, fitted
    near = range(max(loss.index - BESIDE, 1), min(loss.index + BESIDE + 1, len(record.time)))
    moved = [replace(loss, index=index) for index in near]
    best = moved[int(np.argmin([_off(_mended(record, one), fitted, noise) for one in moved]))]
    if best.index != loss.index:
        fitted = fit(_mended(record, best))
    return None if fitted is None else (best, fitted)


def _mended(record: Heights, loss: Loss) -> Heights:
    return replace(record, time=in_time(record.time, (loss,)))


def _off(record: Heights, bounces: Bounces, noise: float) -> float:
    off = (record.height - bounces.curve(record.time)) / noise
    return float(np.nansum(np.minimum(off**2, WILD**2)))


def _as_noise(bounces: Bounces, noise: float) -> bool:
    return _left(bounces, noise) < AS_NOISE * float(np.sum(np.isfinite(bounces.residual)))


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


def _within_flights(record: Heights, noise: float) -> list[Loss]:
    """Places in each flight that make one curve of two halves: a parabola, or what air and lens make of it."""
    contacts = find_contacts(record).tolist()
    falls = np.flatnonzero(record.height > 0.97 * np.max(record.height) + 0.03 * np.min(record.height))
    start = int(falls[falls < contacts[0]][-1]) if contacts and np.any(falls < contacts[0]) else 0
    gains: dict[Loss, float] = {}
    for first, last in pairwise([start, *contacts, len(record.time)]):
        flight = np.s_[first + 1 : last]
        shortest = OUTERMOST if first == start or last == len(record.time) else SHORTEST
        for degree in (2, 3):
            place = _torn_at(record.time[flight], record.height[flight], degree, noise, shortest)
            if place is not None:
                gains[_loss(record, first + 1 + place[0], place[1], at_contact=False)] = place[2]
    return sorted(gains, key=lambda loss: -gains[loss])[:TRIED]


def _loss(record: Heights, index: int, lost: int, *, at_contact: bool) -> Loss:
    return Loss(index, lost, float(record.time[index]), lost * float(np.median(np.diff(record.time))), at_contact)


def _torn_at(time: Array, height: Array, degree: int, noise: float, shortest: int) -> tuple[int, int, float] | None:
    """Where the second half begins, the frames that are lost there, and what that gains in squares of the noise."""
    if len(time) < 2 * shortest + degree:
        return None
    whole = float(_off_curve(time[None], height, degree)[0])
    if whole < TORN * noise:
        return None
    step = float(np.median(np.diff(time)))
    places = list(product(range(shortest, len(time) - shortest + 1), LOST))
    scatter = _off_curve(
        np.array([time + lost * step * (np.arange(len(time)) >= k) for k, lost in places]), height, degree
    )
    best = int(np.argmin(scatter))
    gain = len(time) * (whole**2 - float(scatter[best]) ** 2) / noise**2
    return (*places[best], gain) if scatter[best] < whole / TORN else None


def _off_curve(times: Array, height: Array, degree: int) -> Array:
    """Root mean square that polynomials leave of heights at various times, shape (m, n); shape (m,)."""
    since = times - times.mean(axis=1, keepdims=True)
    since /= np.ptp(since, axis=1)[:, None]
    q, _ = np.linalg.qr(since[:, :, None] ** np.arange(degree + 1))
    off = height - np.squeeze(q @ (np.swapaxes(q, 1, 2) @ height[:, None]), axis=2)
    return np.asarray(np.sqrt(np.mean(off**2, axis=1)))


# -------------------------------------------------------------------------------------------------------- at a contact


def _at_contacts(record: Heights, bounces: Bounces) -> list[Loss]:
    """Contacts at which flights meet as far from the plate as lost frames make them."""
    if _level(bounces):
        return []
    steps, _ = _steps(bounces)
    step = float(np.median(np.diff(record.time)))
    reader = bounces.model.reader(bounces.parameters)
    left: dict[Loss, float] = {}
    for k, lost in product(range(bounces.count), LOST):
        down, up = reader.impact_speed(k + 1), reader.rebound_speed(k + 1)
        levels = np.zeros(bounces.count)
        levels[k] = lost * step * reader.size * down * up / (down + up)
        off = float(np.max(np.abs(steps - np.diff(levels))))
        after = int(np.searchsorted(record.time, bounces.contact_times[k]))
        if off < 0.5 * float(np.max(np.abs(steps))) and after < len(record.time):
            left[_loss(record, after, lost, at_contact=True)] = off
    return sorted(left, key=lambda loss: left[loss])[:TRIED]


def _beside(record: Heights, loss: Loss, mended: Bounces) -> int | None:
    """The contact that a loss is so near to that what happens there may look the same, if there is one."""
    between = np.mean(in_time(record.time, (loss,))[loss.index - 1 : loss.index + 1])
    far = np.abs(mended.contact_times - between)
    # half of the frames that are lost lie on either side
    near = max(1.5 * float(np.median(np.diff(record.time))) + abs(loss.shift) / 2, SOFT)
    return int(np.argmin(far)) if loss.at_contact or float(np.min(far)) < near else None


def _level(bounces: Bounces) -> bool:
    """Whether the plate shows no real step from contact to contact."""
    steps, doubts = _steps(bounces)
    return not np.any(np.abs(steps) > SURELY * doubts)


def _lifted_alone(contact: int, mended: Bounces, before: Bounces) -> bool:
    """Whether one contact stood above or below both its neighbours, and no step is left of that.

    A bead that is kicked aside at a bounce leaves the plane from there on and does not come back.  At the first and the
    last contact, and where the drift begins or ends, there is one step only, which either may have made.
    """
    steps, doubts = _steps(before)
    if not 1 <= contact < before.count - 1:
        return False
    rises, falls = (steps / doubts)[contact - 1 : contact + 1]
    return bool(rises * falls < 0 and min(abs(rises), abs(falls)) > SURELY and _level(mended))


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
    if not 2 <= before.count <= mended.count:
        return False
    left, were = (float(np.max(np.abs(_steps(each)[0][: before.count - 1]))) for each in (mended, before))
    return left < LEVEL * were and math.isfinite(left)
