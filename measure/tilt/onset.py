"""When a body on a slowly rising plate starts to move, from its way down the plate and the plate's angle over time.

After the onset the body obeys s'' = f g (sin a - m cos a): f = 1 for a sliding body and 5/7 for a ball that rolls
without slip, a the angle, m the friction while it moves.  The first frames of that motion are far smaller than the
noise (a rolling ball's way grows with the cube of time), so the whole run is fitted and its beginning is where the
motion, run backwards, came to rest: a change point that no threshold shifts.

What moves the body a little before the onset must not pass for it: a drift in step with the angle (the axis is not
quite where it is thought to be) and a creep that began some time before.  Both are columns of the fit; which of them
are needed is weighed by the data (Schwarz's criterion), and the doubt of the onset covers all that remain likely.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.rigs import GRAVITY

Variant = Literal["slide", "roll"]

LEAST_TURN = math.radians(0.4)  # of a clip that shows a tilt
FACTOR = {"slide": 1.0, "roll": 5 / 7}  # of gravity along the plate; a solid ball that rolls also has to be spun up
USUAL_DRIFT = 0.006  # [m], how far the axis may lie off the origin of a track
MOST_POINTS = 250  # a longer record is averaged down: the onset hangs on all of the run, not on single frames
# -2 log of the odds that rolling friction falls when a ball starts to roll, as sliding friction does: an error that
# lasts for a while looks like it
ROLLING_JUMP = 25.0
# of the smoothed angle, between which a slow plate hardly turns: its search takes a millisecond for every knot
MOST_KNOTS = 4000
SLOW = 0.02  # speed of a creep over the mean speed of the run, one standard deviation
CREEP_STARTS, CREEP_SHAPES = 6, 2  # how many beginnings of a creep are tried, and whether it is even or grows
PARTS = 4  # of the angle's record
FLOOR = 1e-7  # [m], finer than any film
LEAST_DOUBT = 0.15  # of the scale: a scale that is wrong must not pull the onset along
LEAST_RUN = 0.25  # way of a run over the bead's size
WORSE = 1.5  # times the noise at rest, from which on that of a run is one of its own
FAR = 0.002  # noise added per way, relative: a body that has turned and left its light is tracked less well


@dataclass(frozen=True)
class Way:
    """How far the body has come down the plate, and the plate's angle, over time."""

    time: Array  # [s], shape (n,), rising
    angle: Array  # [rad], shape (n,), plate against the horizontal
    down: Array  # [m], shape (n,), along the plate, positive downhill
    sigma: Array  # [m], shape (n,), one standard deviation of `down`; NaN where unknown
    factor: float  # 1 sliding, 5/7 rolling
    scale_doubt: float  # relative standard uncertainty of lengths; infinite when there is no scale
    drift: float  # [m], how far the true axis may lie off the one that the way was measured about
    reach: float  # [m], of the body at first, from that axis


@dataclass(frozen=True)
class Onset:
    """The change point and what was fitted around it."""

    time: float  # [s]
    time_sigma: float  # [s]
    angle: float  # [rad]
    angle_sigma: float  # [rad], from `time_sigma` and the noise of the angle
    moving_friction: float  # tan of the angle at which the moving body would not accelerate
    moving_sigma: float
    gain: float  # fitted acceleration over that expected from gravity and the scale; 1 when both are right
    gain_sigma: float
    axis: float  # [m], way that the body seems to come down for every radian that the plate rises under it
    axis_sigma: float  # [m]
    creep: float  # [m], way that the body crept before the onset
    creep_sigma: float  # [m]
    noise: float  # [m], scatter of the way about the fit
    used: npt.NDArray[np.bool_]  # points of the way that were fitted, shape (n,)
    fitted: Array  # [m], fitted way at every point of the record, NaN outside the window
    rate: float  # [rad/s], of the angle at the onset
    under_way: float  # logarithm of the odds that the body moves from the first point on and the onset was before it


@dataclass(frozen=True)
class Run:
    """The last sustained motion downhill."""

    start: int  # first index that is surely in motion
    end: int  # last index before the body is stopped or lost
    total: float  # [m]


def find_run(way: Way) -> Run | None:
    """The last motion that goes on until the body is stopped or the record ends; None when there is none."""
    down = _calm(way.down)
    noise = jitter(way.down)
    top = float(np.max(down))
    low = float(np.min(down[: max(3, len(down) // 10)]))
    total = top - low
    if len(down) < 8 or total < max(12 * noise, LEAST_RUN * way.drift) + FLOOR:
        return None
    end = int(np.argmax(down > top - 0.03 * total - noise))
    # back from the end to where the body was still near its place
    level = low + max(0.04 * total, 6 * noise)
    before = np.flatnonzero(down[: end + 1] < level)
    start = int(before[-1]) + 1 if len(before) else 0
    return Run(start, end, total) if end - start >= 2 else None


def find_onset(way: Way, run: Run) -> Onset | None:
    """The onset of a run; None when too few points lie before or in it."""
    table = _window(way, run)
    if table is None:
        return None
    found, noise = _search(table), FLOOR
    for _ in range(2):
        if found is None:
            return None
        residual = found.miss[found.best] * table.sigma
        moves = table.time > found.onset[found.best]
        # what moves over the pixels is laid over its picture less well than what rests on them, and for a while wrong
        # to the same side: a run that counted as exact as the rest would bend the onset to follow it
        rests, runs = (_scatter(residual[part], table.own[part], table.far[part]) for part in (~moves, moves))
        kept = np.empty(len(moves), dtype=bool)
        kept[~moves], kept[moves] = rests.kept, runs.kept
        noise = math.sqrt(float(np.mean(np.where(moves, runs.noise, rests.noise)[kept] ** 2)))
        apart = runs.together if runs.together > WORSE * rests.together else rests.together
        table = table.with_noise(np.where(moves, apart, rests.together), kept)
        # with another noise another motion may be the likely one
        found = _search(table)
    return None if found is None else _summary(way, table, found, noise, _under_way(table, found))


def smooth_angle(time: Array, angle: Array) -> Array:
    """The angle without the noise of single frames (smoothing spline, generalised cross-validation)."""
    from scipy.interpolate import make_smoothing_spline

    if len(time) < 8:
        return angle
    together = -(-len(time) // MOST_KNOTS)  # frames
    starts = np.arange(0, len(time), together)
    count = np.diff([*starts, len(time)])
    when, level = (np.add.reduceat(one, starts) / count for one in (time, angle))
    return np.asarray(make_smoothing_spline(when, level, count / together)(time))


def smoothing_doubt(time: Array, angle: Array, places: Array) -> float:
    """Standard uncertainty of the smoothed angle about some times, by what parts of the record say of it.

    Every `PARTS`-th point makes a record of its own, and their mean is known to their scatter over sqrt(PARTS).
    """
    parts = [(time[first::PARTS], angle[first::PARTS]) for first in range(PARTS)]
    # before the last of them begins and after the first of them ends they would differ by how fast the plate turns
    places = places[(places >= time[PARTS - 1]) & (places <= time[-PARTS])]
    curves = np.stack([np.interp(places, when, smooth_angle(when, part)) for when, part in parts])
    return math.sqrt(float(np.mean(np.var(curves, axis=0, ddof=1))) / PARTS)


def jitter(values: Array) -> float:
    """Scatter from point to point, blind to anything smooth (third differences)."""
    third = np.diff(values[np.isfinite(values)], n=3)
    return 1.4826 * float(np.median(np.abs(third))) / math.sqrt(20) if len(third) else 0.0


def _calm(values: Array) -> Array:
    """Median over three points: one wild point is no motion."""
    padded = np.concatenate([values[:1], values, values[-1:]])
    return np.asarray(np.median(np.stack([padded[:-2], padded[1:-1], padded[2:]]), axis=0))


@dataclass(frozen=True)
class _Table:
    """The points that are fitted, with the integrals that every candidate needs."""

    time: Array
    angle: Array
    down: Array
    own: Array  # noise of every point relative to that of a resting one
    far: Array  # [m], what the way behind it adds
    sigma: Array  # [m], both together
    kept: npt.NDArray[np.bool_]  # points that are no outliers
    factor: float
    scale_doubt: float
    drift: float
    slow: float  # [m/s], speed that a creep may have
    early: float  # [s], between which the onset is looked for
    late: float
    step: float  # [s], frame interval
    sines: tuple[Array, Array]  # first and second integral over time of sin(angle)
    cosines: tuple[Array, Array]

    def with_noise(self, noise: Array, kept: npt.NDArray[np.bool_]) -> _Table:
        """The same with this noise of its points, and without those that are not kept."""
        sigma = np.hypot(noise * self.own, self.far)
        return replace(self, sigma=sigma * np.where(kept, 1.0, 1e3), kept=kept)


@dataclass(frozen=True)
class _Candidates:
    """Fits of one onset each, all arrays over candidates."""

    onset: Array  # [s]
    cost: Array  # -2 log of the weight
    answer: Array  # shape (n, 5): rest, axis, gain, creep, jump
    variance: Array  # of the answer, NaN where the candidate has no such column
    creep_from: Array  # [s], NaN without creep
    miss: Array  # (seen - fitted) / sigma, shape (n, points)
    spacing: Array  # [s], to the next onset that was tried: the stretch that a candidate stands for

    @classmethod
    def joined(cls, parts: Sequence[_Candidates]) -> _Candidates:
        """All of them as one."""
        return cls(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls)))

    @property
    def weight(self) -> Array:
        likely = self.spacing * np.exp(-(self.cost - np.min(self.cost)) / 2)
        return np.asarray(likely / likely.sum())

    @property
    def best(self) -> int:
        return int(np.argmin(self.cost))


def _window(way: Way, run: Run) -> _Table | None:
    """Rest before the run and the run itself, averaged down to a manageable number of points."""
    finite = np.isfinite(way.down) & np.isfinite(way.angle)
    start, end = float(way.time[run.start]), float(way.time[run.end])
    step = float(np.median(np.diff(way.time)))
    length = max(end - start, 6 * step)
    first = start - 1.5 * length - 12 * step
    inside = finite & (way.time >= first) & (way.time < end - 0.5 * step)
    if np.sum(inside & (way.time < start)) < 5 or np.sum(inside & (way.time >= start)) < 3:
        return None
    time, angle, down = (values[inside] for values in (way.time, smooth_angle(way.time, way.angle), way.down))
    sigma = way.sigma[inside]
    bins = math.ceil(len(time) / MOST_POINTS)
    if bins > 1:
        whole = len(time) // bins * bins
        time, angle, down, sigma = (v[-whole:].reshape(-1, bins).mean(axis=1) for v in (time, angle, down, sigma))
    rest = float(np.median(down[time < start]))
    usual = float(np.median(sigma[time < start])) if np.all(np.isfinite(sigma)) else math.nan
    noise = max(jitter(way.down[finite]) / math.sqrt(bins), FLOOR)
    own = np.maximum(sigma / usual, 0.2) if usual > 0 else np.ones_like(time)
    far = FAR * np.maximum(down - rest, 0)
    return _Table(
        time,
        angle,
        down,
        own,
        far,
        np.hypot(noise * own, far),
        np.ones(len(time), dtype=bool),
        way.factor,
        way.scale_doubt,
        way.drift,
        SLOW * run.total / length,
        max(start - 1.2 * length - 8 * step, float(time[2])),
        min(start + 0.35 * length, float(time[-3])),
        step,
        _integrals(time, np.sin(angle)),
        _integrals(time, np.cos(angle)),
    )


def _integrals(time: Array, values: Array) -> tuple[Array, Array]:
    """First and second integral from the first point on, of straight lines between the points."""
    step = np.diff(time)
    first = np.concatenate([[0.0], np.cumsum(step * (values[1:] + values[:-1]) / 2)])
    second = np.concatenate([[0.0], np.cumsum(step * first[:-1] + step**2 * (2 * values[:-1] + values[1:]) / 6)])
    return first, second


def _since(table: _Table, integrals: tuple[Array, Array], values: Array, onset: float) -> Array:
    """Double integral of `values` from the onset on, zero before."""
    time = table.time
    k = int(np.clip(np.searchsorted(time, onset, side="right") - 1, 0, len(time) - 2))
    part = onset - time[k]
    slope = (values[k + 1] - values[k]) / (time[k + 1] - time[k])
    first = integrals[0][k] + values[k] * part + slope * part**2 / 2
    second = integrals[1][k] + integrals[0][k] * part + values[k] * part**2 / 2 + slope * part**3 / 6
    return np.where(time > onset, integrals[1] - second - first * (time - onset), 0.0)


def _everywhere(table: _Table) -> Array:
    """Onsets to try when nothing is known."""
    span = table.late - table.early
    return np.linspace(table.early, table.late, int(np.clip(1.5 * span / table.step, 24, 80)))


def _around(table: _Table, found: _Candidates) -> Array:
    """Onsets to try between the likely ones of one kind."""
    near = found.onset[found.cost < np.min(found.cost) + 16]
    width = float(found.spacing[0])
    return np.linspace(max(near.min() - width, table.early), min(near.max() + width, table.late), 32)


def _search(table: _Table) -> _Candidates | None:
    """Every likely combination of onset, creep and jump in friction.

    With and without a creep each has a valley of its own: a coarse step that misses the narrow one of the simple motion
    may still fall into the wide one of the motion with more freedom, from which no finer step leads back.
    """
    kinds = []
    for creeps in (False, True):
        found = _tried(table, _everywhere(table), creeps)
        for _ in range(2):
            if not np.any(np.isfinite(found.cost)):
                break
            found = _tried(table, _around(table, found), creeps)
        if np.any(np.isfinite(found.cost)):
            kinds.append(found)
    return _Candidates.joined(kinds) if kinds else None


def _tried(table: _Table, onsets: Array, creeps: bool) -> _Candidates:
    """All candidates of these onsets, by linear least squares; what cannot be has infinite cost."""
    time = table.time
    alpha = np.interp(onsets, time, table.angle)
    sine = np.stack([_since(table, table.sines, np.sin(table.angle), onset) for onset in onsets])
    cosine = np.stack([_since(table, table.cosines, np.cos(table.angle), onset) for onset in onsets])
    pull = table.factor * GRAVITY
    always = np.broadcast_to(np.stack([np.ones_like(time), table.angle - table.angle[0]]), (len(onsets), 2, len(time)))
    moving = np.stack([pull * (sine - np.tan(alpha)[:, None] * cosine), pull * cosine], axis=1)
    plain = np.concatenate([always, moving], axis=1)
    if not creeps:
        return _Candidates.joined([_solved(table, onsets, plain[:, : 3 + jump], math.nan) for jump in (0, 1)])
    parts = []
    for start in np.linspace(time[0], onsets[-1], CREEP_STARTS, endpoint=False):
        since = np.maximum(time - start, 0)
        until = np.maximum(onsets - start, 1e-9)[:, None]
        grown = np.where(time < onsets[:, None], since**2 / until, 2 * since - until)
        for creep in (np.broadcast_to(since, grown.shape), grown):
            columns = np.concatenate([plain[:, :3], creep[:, None], plain[:, 3:]], axis=1)
            parts += [_solved(table, onsets, columns[:, : 4 + jump], float(start)) for jump in (0, 1)]
    return _Candidates.joined(parts)


def _under_way(table: _Table, found: _Candidates) -> float:
    """Logarithm of the odds that the body comes down from the first point on, at a speed of its own there or from rest.

    Against the onsets that were tried, by the same least squares; what is fitted is no different but for its beginning.
    """
    from scipy.optimize import lsq_linear

    time, pull = table.time, table.factor * GRAVITY
    sine = _since(table, table.sines, np.sin(table.angle), float(time[0]))
    cosine = _since(table, table.cosines, np.cos(table.angle), float(time[0]))
    columns = np.stack(
        [np.ones_like(time), table.angle - table.angle[0], pull * sine, -pull * cosine, time - time[0]], axis=1
    )
    mean = np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    certain = np.array([0.0, 1 / table.drift, 1 / max(table.scale_doubt, LEAST_DOUBT), 0.0, 0.0])
    weighted = columns / table.sigma[:, None]
    size = np.sqrt(np.sum(weighted**2, axis=0) + certain**2)
    rows = np.vstack([weighted / size, np.diag(certain / size)])
    wanted = np.concatenate([table.down / table.sigma, certain * mean])
    # gravity pulls down the plate, and nothing comes up it by itself
    least = np.array([-np.inf, -np.inf, 0.0, -np.inf, 0.0])
    answer = lsq_linear(rows, wanted, (least, np.full(5, np.inf)))
    # its speed and its friction are free, each for Schwarz's price
    cost = 2 * float(answer.cost) + 2 * math.log(max(float(np.sum(table.kept)), 2.0))
    return (float(np.min(found.cost)) - cost) / 2


def _solved(table: _Table, onsets: Array, columns: Array, creep_from: float) -> _Candidates:
    """The candidates of one combination.

    Columns: rest, axis, gain, then creep where it has a start, then jump where there is one.
    """
    count = columns.shape[1]
    creeps = math.isfinite(creep_from)
    places = [0, 1, 2, 4][:count] if not creeps else [0, 1, 2, 3, 4][:count]
    # gain: what is known of the scale; axis: what is known of the hinge; creep is slow beside the run; a coefficient of
    # friction jumps by less than 1
    mean = np.array([0.0, 0.0, 1.0, 0.0, 0.0])[places]
    gain = 1 / max(table.scale_doubt, LEAST_DOUBT) ** 2
    certain = np.array([0.0, 1 / table.drift**2, gain, 1 / table.slow**2, 1.0])[places]
    weighted = columns / table.sigma
    size = np.sqrt(np.sum(weighted**2, axis=2) + certain) + 1e-300
    scaled = weighted / size[..., None]
    normal = scaled @ scaled.transpose(0, 2, 1) + (certain / size**2)[:, None] * np.eye(count) + 1e-11 * np.eye(count)
    wanted = table.down / table.sigma
    inverse = np.linalg.inv(normal)
    answer = np.einsum("kij,kj->ki", inverse, scaled @ wanted + certain * mean / size) / size
    miss = wanted - np.einsum("kin,ki->kn", weighted, answer)
    cost = np.sum(miss**2, axis=1) + (answer - mean) ** 2 @ certain
    # Schwarz's price of a parameter; a creep has a start as well as a size
    free = (2 if creeps else 0) + (1 if 4 in places else 0)
    cost = cost + free * math.log(max(float(np.sum(table.kept)), 2.0))
    if creeps:  # all creeps together are as likely beforehand as none, however many are tried
        cost = cost + 2 * math.log(CREEP_STARTS * CREEP_SHAPES)
    if 4 in places and table.factor < 1:
        cost = cost + ROLLING_JUMP
    full, variance = np.zeros((len(onsets), 5)), np.full((len(onsets), 5), np.nan)
    full[:, places] = answer
    variance[:, places] = np.einsum("kii->ki", inverse) / size**2
    # friction does not grow when motion starts, and nothing creeps uphill or begins to creep after the onset
    possible = (full[:, 2] > 0) & np.all(full[:, 3:] >= 0, axis=1)
    if creeps:
        possible &= creep_from < onsets - 3 * table.step
    return _Candidates(
        onsets,
        np.where(possible, cost, np.inf),
        full,
        variance,
        np.full(len(onsets), creep_from),
        miss,
        np.full(len(onsets), onsets[1] - onsets[0]),
    )


@dataclass(frozen=True)
class _Scatter:
    """Noise of the residuals of some points."""

    noise: float  # [m], of one that rests
    together: float  # [m], that counts each by itself for what they are worth together
    kept: npt.NDArray[np.bool_]  # which are not wild


def _scatter(residual: Array, own: Array, far: Array) -> _Scatter:
    """The noise of points whose way adds `far` [m] to it, by expectation and maximisation of the likelihood."""
    if len(residual) < 2:
        return _Scatter(FLOOR, FLOOR, np.ones(len(residual), dtype=bool))
    noise = max(1.4826 * float(np.median(np.abs(residual) / own)), FLOOR)
    kept = np.abs(residual) < 4.5 * np.hypot(noise * own, far)
    for _ in range(20):
        share = (noise * own) ** 2 / ((noise * own) ** 2 + far**2)
        squares = ((share * residual) ** 2 + share * far**2) / own**2
        noise = max(math.sqrt(float(np.mean(squares[kept]))), FLOOR)
    scaled = residual / np.hypot(noise * own, far)
    return _Scatter(noise, noise * math.sqrt(_repeat(scaled[kept])), kept)


def _repeat(residual: Array) -> float:
    """How many neighbouring residuals count as one: 1 + 2 sum of the autocorrelation up to its first zero."""
    rest = residual - np.mean(residual)
    total = float(rest @ rest)
    together = 1.0
    for lag in range(1, min(20, len(rest) // 4)):
        rho = float(rest[lag:] @ rest[:-lag]) / total if total > 0 else 0.0
        if rho <= 2 / math.sqrt(len(rest)):
            break
        together += 2 * rho
    return together


def _summary(way: Way, table: _Table, found: _Candidates, noise: float, under_way: float) -> Onset:
    """Mean and spread over all that is likely."""
    weight = found.weight

    def average(values: Array, own: Array | float = 0.0) -> tuple[float, float]:
        mean = float(weight @ values)
        return mean, math.sqrt(max(float(weight @ ((values - mean) ** 2 + own)), 0.0))

    time, time_sigma = average(found.onset)
    grid = float(found.spacing[found.best])
    angles = np.interp(found.onset, table.time, table.angle)
    angle, angle_sigma = average(angles)
    near = np.abs(table.time - time) < max(8 * table.step, 0.05)
    rate = float(np.polyfit(table.time[near], table.angle[near], 1)[0])
    friction = np.tan(angles) - found.answer[:, 4] / found.answer[:, 2]
    moving, moving_sigma = average(friction, np.nan_to_num(found.variance[:, 4]))
    gain, gain_sigma = average(found.answer[:, 2], found.variance[:, 2])
    axis, axis_sigma = average(found.answer[:, 1], found.variance[:, 1])
    crept = np.where(np.isfinite(found.creep_from), found.answer[:, 3] * (found.onset - found.creep_from), 0.0)
    creep, creep_sigma = average(crept)
    fitted = np.full(len(way.time), np.nan)
    inside = (way.time >= table.time[0]) & (way.time <= table.time[-1])
    curve = table.down - found.miss[found.best] * table.sigma
    fitted[inside] = np.interp(way.time[inside], table.time, curve)
    return Onset(
        time,
        math.hypot(time_sigma, grid / 3),
        angle,
        math.hypot(angle_sigma, rate * grid / 3, smoothing_doubt(way.time, way.angle, table.time)),
        moving,
        moving_sigma,
        gain,
        gain_sigma,
        axis,
        axis_sigma,
        creep,
        creep_sigma,
        noise,
        inside,
        fitted,
        rate,
        under_way,
    )
