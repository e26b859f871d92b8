"""Detect lost or doubled frames that the time stamps do not show, from the flights of a bouncing bead.

After such a frame all others are early or late by a whole number of frame intervals.  Within a flight this breaks the
parabola.  At a contact each flight stays a parabola, but the two no longer meet on the plate: they cross above it (lost
frame) or below it (doubled frame).  A fit would take that for a bead that leaves the plane, so lost frames are tested
first.  A bead that does come nearer grows in the picture, and its plate sinks in proportion, depending on how high the
camera stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, product

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.measure.drop.bounce_fit import Bounces, Heights, find_contacts, third_difference_noise
from rigtwin.measure.media.frame_loss import MOST, OUTLIER, Loss, in_time

Fit = Callable[[Heights], Bounces | None]

LOST = (1, 2, 3, -1)  # numbers of lost frames that are tried; -1: a frame is shown twice

TRIED = 3  # number of the likeliest places of either kind for which the whole record is fitted

ILL_FITTED = 2.5  # largest residual of fitted flights over the noise

TORN = 1.5  # minimum ratio of the scatter of a whole flight to that of its two halves

# minimum gain in chi-square: trying a place at every frame gains about a dozen, slow errors several times that
GAINED = 60.0

MOST_PLACES = 1000  # in a flight; of one with more frames every second, third ... is looked at, as time and memory go
# with the square of their number

SHORTEST = 2  # minimum frames on either side of a place within a flight; a single one may show another object

OUTERMOST = 3  # the same for the first and the last flight, which no contact bounds on one side

BESIDE = 3  # distance from a contact [frames] within which the exact place is searched again

SOFT = 0.015  # [s], distance from a contact within which a long contact (ball of foam) may bend a flight

SURELY = 5.0  # standard uncertainties beyond which a step of the plate from contact to contact is real

# Chi-square of the steps about a uniform drift beyond which another cause is looked for: that of one degree of freedom
# which chance exceeds once in a thousand.  Of 40 copies of a sound film at other bit rates 2 had 8 to 10.
ODD = 10.8

OTHERS = 16.0  # largest chi-square that a certain loss may leave; all others must leave more by at least as much

# prior mean and standard deviation of the plate's drift in drop heights per relative growth of the bead: camera about
# halfway up, slightly pitched
CAMERA = (-0.5, 0.35)

UNEVEN = 5e-4  # flatness of plates over the drop height

LEAST_SHOWN = 0.5  # minimum share of the information on a growth that comes from the record and not from the prior

GROWN_TO = (0.001, 0.05)  # error of a growth from the models of air and lens: absolute and relative

AS_NOISE = 1.2  # chi-square per point up to which a fit needs no loss within a flight


def find_losses(record: Heights, fit: Fit) -> tuple[tuple[Loss, ...], Bounces | None]:
    """Lost frames (none if they do not explain the record), and the bounces with certain losses corrected.

    `fit` fits the bounces of a record.  The search ends at the first loss that is not certain, because any further one
    would depend on it.
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
    """The loss that explains a record best, with the bounces fitted after its correction."""
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
    """The record fitted with a loss; near a contact, the loss is moved to the frame that fits the flights best."""
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
    return float(np.nansum(np.minimum(off**2, OUTLIER**2)))


def _as_noise(bounces: Bounces, noise: float) -> bool:
    return _left(bounces, noise) < AS_NOISE * float(np.sum(np.isfinite(bounces.residual)))


def _noise(record: Heights) -> float:
    return max(third_difference_noise(record), 2e-5 * float(np.ptp(record.height)))


def _left(bounces: Bounces | None, noise: float) -> float:
    """Chi-square of a fit from the release on, also for frames outside the flights."""
    if bounces is None:
        return math.inf
    off = (bounces.residual / noise) ** 2
    falls = int(np.argmax(np.isfinite(off)))
    return float(np.sum(np.fmin(off[falls:], OUTLIER**2)))


def _misfit(bounces: Bounces) -> float:
    return bounces.noise / max(bounces.expected_noise, 2e-5 * bounces.span)


# ------------------------------------------------------------------------------------------------------ within a flight


def _within_flights(record: Heights, noise: float) -> list[Loss]:
    """Likely losses within each flight: two halves become one polynomial (degree 3 for air and lens)."""
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
    """Index at which the second half begins, the number of frames lost there, and the gain in chi-square."""
    if len(time) < 2 * shortest + degree:
        return None
    whole = float(_off_curve(time[None], height, degree)[0])
    if not whole > TORN * noise > 0:
        return None
    step = float(np.median(np.diff(time)))
    stride = math.ceil(len(time) / MOST_PLACES)
    places = list(product(range(shortest, len(time) - shortest + 1, stride), LOST))
    kept = np.arange(0, len(time), stride)
    tried = np.array([time[kept] + lost * step * (kept >= k) for k, lost in places])
    scatter = _off_curve(tried, height[kept], degree)
    best = int(np.argmin(scatter))
    least = float(scatter[best])
    gain = len(time) * ((whole - least) / noise) * ((whole + least) / noise)
    return (*places[best], gain) if scatter[best] < whole / TORN else None


def _off_curve(times: Array, height: Array, degree: int) -> Array:
    """Root mean square residual of polynomial fits of the heights at `times`, shape (m, n); shape (m,)."""
    since = times - times.mean(axis=1, keepdims=True)
    since /= np.ptp(since, axis=1)[:, None]
    q, _ = np.linalg.qr(since[:, :, None] ** np.arange(degree + 1))
    off = height - np.squeeze(q @ (np.swapaxes(q, 1, 2) @ height[:, None]), axis=2)
    return np.asarray(np.sqrt(np.mean(off**2, axis=1)))


# -------------------------------------------------------------------------------------------------------- at a contact


def _at_contacts(record: Heights, bounces: Bounces) -> list[Loss]:
    """Likely losses at contacts: flights meet off a uniformly drifting plate by as much as lost frames cause."""
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
    """Apparent steps of the plate's level due to a loss of `shift` [s] at a contact, shape (count - 1,)."""
    reader = bounces.model.reader(bounces.parameters)
    down, up = reader.impact_speed(contact + 1), reader.rebound_speed(contact + 1)
    levels = np.zeros(bounces.count)
    levels[contact] = shift * reader.size * down * up / (down + up)
    return np.diff(levels)


def _beside(record: Heights, loss: Loss, mended: Bounces) -> int | None:
    """Index of the contact that is so near to a loss that a long contact looks the same; None if there is none."""
    between = np.mean(in_time(record.time, (loss,))[loss.index - 1 : loss.index + 1])
    far = np.abs(mended.contact_times - between)
    # half of the lost frames lie on either side
    near = max(1.5 * float(np.median(np.diff(record.time))) + abs(loss.shift) / 2, SOFT)
    return int(np.argmin(far)) if loss.at_contact or float(np.min(far)) < near else None


def _level(bounces: Bounces) -> bool:
    """Whether the plate shows no real step from contact to contact."""
    steps, sigmas = _steps(bounces)
    return not np.any(np.abs(steps) > SURELY * sigmas)


def _lifted_alone(contact: int, mended: Bounces, before: Bounces) -> bool:
    """Whether one contact was above or below both its neighbours, and no step remains after the correction.

    A bead that is kicked sideways at a bounce leaves the plane from there on and does not come back.  At the first and
    the last contact, and where a drift begins or ends, there is only one step, which either cause may explain.
    """
    steps, sigmas = _steps(before)
    if not 1 <= contact < before.count - 1:
        return False
    rises, falls = (steps / sigmas)[contact - 1 : contact + 1]
    return bool(rises * falls < 0 and min(abs(rises), abs(falls)) > SURELY and _level(mended))


def _undrifted(loss: Loss, contact: int, before: Bounces) -> bool:
    """Whether neither a drift, at any position of the camera, nor any other loss explains the steps of the plate.

    A long contact looks like a frame shown twice, and never like a lost one.
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
    """Chi-square of the plate's steps after the best explanation by the growth of the bead.

    `feigned` are apparent steps of a loss; `usually` applies the prior of the camera's position.
    """
    if bounces.count < 2:
        return 0.0
    steps, sigmas = _steps(bounces)
    growth, grown = _growths(bounces)
    steep = np.tan(np.linspace(-np.pi / 2, np.pi / 2, 2001)[1:-1, None])
    seen = (steps - feigned) / bounces.span
    variance = (sigmas / bounces.span) ** 2 + UNEVEN**2 + (steep * grown) ** 2
    left = np.sum((seen - steep * growth) ** 2 / variance, axis=1)
    if usually:
        left += ((steep[:, 0] - CAMERA[0]) / CAMERA[1]) ** 2
    return float(np.min(left))


def _growths(bounces: Bounces) -> tuple[Array, Array]:
    """Relative growth of the bead from contact to contact and its standard uncertainty, shape (count - 1,).

    The prior of the fit is removed again: along low flights it alone determines the growth.
    """
    count = bounces.count
    heights, _, growth = bounces.model.split(bounces.parameters)
    inner = slice(4 + 2 * count, 3 + 3 * count)
    mine = bounces.covariance[inner, inner]
    # growth is relative to the first contact
    steps = np.eye(count - 1) - np.eye(count - 1, k=-1)
    fitted = np.diag(steps @ mine @ steps.T)
    shown = 1 - fitted / bounces.model.swelling(heights[1:count]) ** 2
    known = shown > LEAST_SHOWN
    shown = np.where(known, shown, 1.0)
    each, variance = steps @ growth[: count - 1] / shown, np.where(known, fitted / shown, 1.0)
    return each, np.sqrt(variance + GROWN_TO[0] ** 2 + (GROWN_TO[1] * each) ** 2)


def _steps(bounces: Bounces) -> tuple[Array, Array]:
    """Steps of the plate's level from contact to contact and their standard uncertainties, shape (count - 1,).

    The last flight has no level of its own.
    """
    count = bounces.count
    _, levels, _ = bounces.model.split(bounces.parameters)
    mine = bounces.covariance[3 + count : 3 + 2 * count, 3 + count : 3 + 2 * count]
    spread = np.diag(mine)
    variance = spread[1:] + spread[:-1] - 2 * np.diag(mine, 1)
    return np.diff(levels[:count]), np.sqrt(np.maximum(variance, 1e-300))


def _meet(mended: Bounces, before: Bounces) -> bool:
    """Whether the correction brings the flights clearly closer to a level or uniformly drifting plate."""
    odd, left = _oddness(before), _oddness(mended)
    return 2 <= before.count <= mended.count and left < odd - ODD and left < max(ODD, odd / 2)
