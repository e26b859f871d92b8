"""A frame that a film lost, or shows twice, without its times saying so: found by the flights of a bouncing bead.

From there on every frame is a whole number of intervals late or early.  Within a flight that tears the parabola apart.
At a contact each flight stays whole, but the two no longer meet on the plate: they cross higher up, where a lost frame
brings them together, or lower, and a fit takes that for a bead that leaves the plane, unless it asks for this first.
A bead that does come nearer is told by its growth: its plate sinks with that, as high as the camera stands above it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, product

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.measure.drop.bounce_fit import Bounces, Heights, find_contacts, third_difference_noise
from rigtwin.measure.media.frame_loss import MOST, WILD, Loss, in_time

Fit = Callable[[Heights], Bounces | None]

LOST = (1, 2, 3, -1)  # frames; a negative one is shown twice

TRIED = 3  # places of either kind, the likeliest, that the whole record is fitted with

ILL_FITTED = 2.5  # times its noise that a track may leave its fitted flights

TORN = 1.5  # times less scatter that the halves of a flight leave than the whole

GAINED = 60.0  # squares of the noise: that a place is tried at every frame gains a dozen, slow errors some times that

SHORTEST = 2  # frames on either side of a place within a flight; one alone may show something else

OUTERMOST = 3  # the same of the first and the last flight, of which no next contact tells

BESIDE = 3  # frames from a contact, up to which too few lie between to be a half of a flight

SOFT = 0.015  # [s], from a contact, up to which one that lasts, as a ball of foam's does, may be what bends a flight

SURELY = 5.0  # standard uncertainties of a plate's steps from contact to contact, from which on they are real

ODD = 6.0  # squares of their doubt, that steps leave of an even drift, from which on they ask for another cause

OTHERS = 16.0  # such squares, that a sure loss may leave; and more than it leaves, that all others must

CAMERA = (-0.5, 0.35)  # sinking of the plate in drop heights per growth: seen from about halfway up, pitched a little

UNEVEN = 5e-4  # of the drop height, to which plates are level

LEAST_TOLD = 0.5  # share of the knowledge of a growth that must come from the record, and not from what is usual

GROWN_TO = (0.001, 0.05)  # growth that a fit of air and lens may miss: absolute, and relative

AS_NOISE = 1.2  # squares of the noise for each point, that a fit may leave where nothing can be torn


def find_losses(record: Heights, fit: Fit) -> tuple[tuple[Loss, ...], Bounces | None]:
    """Where frames are lost, or none where that does not explain the record, and its bounces with sure ones mended.

    `fit` tells a record's bounces.  A loss that is not sure is the last: what else there may be would rest on it.
    """
    if len(record.time) <= 12:
        return (), None
    losses: list[Loss] = []
    first = true = bounces = fit(record)
    while len(losses) < MOST and all(loss.sure for loss in losses):
        better = _better(replace(record, time=in_time(record.time, losses)), bounces, fit)
        if better is None:
            break
        loss, bounces = better
        losses.append(replace(loss, time=float(record.time[loss.index])))
        true = bounces if loss.sure else true
    explained = bounces is not None and _misfit(bounces) < ILL_FITTED
    return (tuple(losses), true) if explained else ((), first)


def _better(record: Heights, bounces: Bounces | None, fit: Fit) -> tuple[Loss, Bounces] | None:
    """The loss that explains a record best, with its bounces then."""
    noise = _noise(record)
    if bounces is not None and _as_noise(bounces, noise) and _oddness(bounces) < ODD:
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
                found.append((left + _oddness(fitted), replace(loss, at_contact=False), fitted))
            continue
        meets = bounces is not None and _meet(fitted, bounces)
        if tears or (meets and left < before + GAINED):
            sure = (
                bounces is not None
                and meets
                and (_lifted_alone(beside, fitted, bounces) or _undrifted(loss, beside, bounces))
            )
            found.append((left + _oddness(fitted), replace(loss, at_contact=True, sure=sure), fitted))
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
    """Contacts at which flights meet as far from an evenly drifting plate as lost frames make them."""
    odd = _oddness(bounces)
    if odd < ODD:
        return []
    step = float(np.median(np.diff(record.time)))
    after = np.searchsorted(record.time, bounces.contact_times)
    left = {
        _loss(record, int(after[k]), lost, at_contact=True): _oddness(bounces, _lifts(bounces, k, lost * step))
        for k, lost in product(range(bounces.count), LOST)
        if after[k] < len(record.time)
    }
    return sorted((loss for loss in left if left[loss] < odd / 2), key=lambda loss: left[loss])[:TRIED]


def _lifts(bounces: Bounces, contact: int, shift: float) -> Array:
    """Steps of the plate's level that a loss of so many seconds at a contact feigns, shape (count - 1,)."""
    reader = bounces.model.reader(bounces.parameters)
    down, up = reader.impact_speed(contact + 1), reader.rebound_speed(contact + 1)
    levels = np.zeros(bounces.count)
    levels[contact] = shift * reader.size * down * up / (down + up)
    return np.diff(levels)


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


def _undrifted(loss: Loss, contact: int, before: Bounces) -> bool:
    """Whether no drift explains the plate's steps, from wherever one looks, nor any other loss than this one.

    A contact that lasts looks like a frame shown twice, and never like one that is lost.
    """
    if loss.frames < 0 or _oddness(before, usually=False) < GAINED:
        return False
    step = loss.shift / loss.frames
    left = {
        (k, lost): _oddness(before, _lifts(before, k, lost * step), usually=False)
        for k, lost in product(range(before.count), LOST)
    }
    mine = left.pop((contact, loss.frames), math.inf)
    return mine < OTHERS and mine + OTHERS < min(left.values())


def _oddness(bounces: Bounces, feigned: Array | float = 0.0, *, usually: bool = True) -> float:
    """Squares of their doubt, that the plate's steps leave where the bead's growth explains what it can of them.

    `feigned` steps are a loss's; `usually` the camera stands where one puts it, else anywhere.
    """
    if bounces.count < 2:
        return 0.0
    steps, doubts = _steps(bounces)
    growth, grown = _growths(bounces)
    steep = np.tan(np.linspace(-np.pi / 2, np.pi / 2, 2001)[1:-1, None])
    seen = (steps - feigned) / bounces.span
    variance = (doubts / bounces.span) ** 2 + UNEVEN**2 + (steep * grown) ** 2
    left = np.sum((seen - steep * growth) ** 2 / variance, axis=1)
    if usually:
        left += ((steep[:, 0] - CAMERA[0]) / CAMERA[1]) ** 2
    return float(np.min(left))


def _growths(bounces: Bounces) -> tuple[Array, Array]:
    """Of the bead from contact to contact, relative, and their standard uncertainties, shape (count - 1,).

    What the fit expects beforehand is taken out again; along low flights it is all that holds the growth, near nothing.
    """
    count = bounces.count
    heights, _, growth = bounces.model.split(bounces.parameters)
    inner = slice(4 + 2 * count, 3 + 3 * count)
    mine = bounces.covariance[inner, inner]
    # the first contact is where it is counted from
    steps = np.eye(count - 1) - np.eye(count - 1, k=-1)
    fitted = np.diag(steps @ mine @ steps.T)
    told = 1 - fitted / bounces.model.swelling(heights[1:count]) ** 2
    known = told > LEAST_TOLD
    told = np.where(known, told, 1.0)
    each, variance = steps @ growth[: count - 1] / told, np.where(known, fitted / told, 1.0)
    return each, np.sqrt(variance + GROWN_TO[0] ** 2 + (GROWN_TO[1] * each) ** 2)


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
    """Whether flights meet on a level or evenly drifting plate, or come nearer to that, which did not."""
    odd, left = _oddness(before), _oddness(mended)
    return 2 <= before.count <= mended.count and left < odd - ODD and left < max(ODD, odd / 2)
