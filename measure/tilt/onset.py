"""Find the onset of motion of a body on a slowly rising plate: a change point of its displacement.

After the onset the body obeys s'' = f g (sin a - m cos a), with f = 1 for sliding and 5/7 for a ball that rolls without
slip, the angle a, and the friction m in motion.  The displacement in the first frames is far smaller than the noise
(for a rolling ball it grows with the cube of time).  Therefore rest and run are fitted together, and the onset is the
change point between them; no threshold is involved.

Small motion before the onset must not be taken for it: drift in proportion to the angle (error of the assumed axis),
and creep that starts earlier.  Both are columns of the fit.  Schwarz's criterion (BIC) weights the models with and
without creep, and the uncertainty of the onset covers all likely ones.
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
from rigtwin.measure.robust import autocorrelation_factor, mad_std

Variant = Literal["slide", "roll"]

LEAST_TURN = math.radians(0.4)  # minimum turn in a clip of a tilt
FACTOR = {"slide": 1.0, "roll": 5 / 7}  # share of gravity along the plate; a rolling solid ball also gains rotation
USUAL_DRIFT = 0.006  # [m], standard uncertainty of the axis relative to the origin of a track
MOST_POINTS = 250  # a longer record is averaged in groups: the onset depends on the whole run, not on single frames
# -2 log of the prior odds that rolling friction drops when a ball starts to roll, as sliding friction does: a slowly
# varying error looks like it
ROLLING_JUMP = 25.0
# limit of the knots of the smoothed angle: a slow plate hardly turns between them, and each costs about a millisecond
MOST_KNOTS = 4000
SLOW = 0.02  # prior standard deviation of the speed of creep over the mean speed of the run
CREEP_STARTS, CREEP_SHAPES = (
    6,
    2,
)  # number of start times and of shapes (constant or growing speed) of creep that are tried
PARTS = 4  # number of parts of the angle's record for its uncertainty
FLOOR = 1e-7  # [m], lower limit of the noise, below that of any film
LEAST_UNCERTAINTY = 0.15  # lower limit of the relative uncertainty of the scale: a wrong scale must not shift the onset
LEAST_RUN = 0.25  # minimum displacement of a run over `Way.drift`
MOST_LAGS = 20  # at which the autocorrelation of residuals is summed
WORSE = 1.5  # ratio of noise in the run to noise at rest beyond which they are treated separately
FAR = 0.002  # added noise over displacement: tracking is worse when rotation and lighting have changed


@dataclass(frozen=True)
class Way:
    """Displacement of the body down the plate, and the plate's angle, over time."""

    time: Array  # [s], shape (n,), ascending
    angle: Array  # [rad], shape (n,), plate against the horizontal
    down: Array  # [m], shape (n,), along the plate, positive downhill
    sigma: Array  # [m], shape (n,), one standard deviation of `down`; NaN where unknown
    factor: float  # 1 sliding, 5/7 rolling
    scale_uncertainty: float  # relative standard uncertainty of lengths; infinite when there is no scale
    drift: float  # [m], standard uncertainty of the axis about which the displacement was measured
    reach: float  # [m], initial distance of the body from that axis


@dataclass(frozen=True)
class Onset:
    """The change point and the fitted parameters."""

    time: float  # [s]
    time_sigma: float  # [s]
    angle: float  # [rad]
    angle_sigma: float  # [rad], from `time_sigma` and the noise of the angle
    moving_friction: float  # tan of the angle at which the moving body would not accelerate
    moving_sigma: float
    gain: float  # fitted acceleration over that expected from gravity and the scale
    gain_sigma: float
    axis: float  # [m/rad], apparent displacement of the resting body per angle of the plate
    axis_sigma: float  # [m]
    creep: float  # [m], creep before the onset
    creep_sigma: float  # [m]
    noise: float  # [m], scatter about the fit
    used: npt.NDArray[np.bool_]  # points that were fitted, shape (n,)
    fitted: Array  # [m], fitted displacement at every point of the record, NaN outside the window
    rate: float  # [rad/s], rate of the angle at the onset
    under_way: float  # log odds that the body moves from the first point on and the onset was before it


@dataclass(frozen=True)
class Run:
    """The last sustained motion downhill."""

    start: int  # first index that is certainly in motion
    end: int  # last index before the body is stopped or lost
    total: float  # [m]


def find_run(way: Way) -> Run | None:
    """The last motion that goes on until the body is stopped or the record ends; None if there is none."""
    down = _calm(way.down)
    noise = jitter(way.down)
    low, total = _begin_of(down), descent(way)
    top = low + total
    if len(down) < 8 or total < least_run(way):
        return None
    end = int(np.argmax(down > top - 0.03 * total - noise))
    # last point at which the body was still near its rest position
    level = low + max(0.04 * total, 6 * noise)
    before = np.flatnonzero(down[: end + 1] < level)
    start = int(before[-1]) + 1 if len(before) else 0
    return Run(start, end, total) if end - start >= 2 else None


def descent(way: Way) -> float:
    """Largest displacement down the plate from where the body is at first [m]."""
    down = _calm(way.down)
    return float(np.max(down)) - _begin_of(down)


def _begin_of(down: Array) -> float:
    return float(np.min(down[: max(3, len(down) // 10)]))


def least_run(way: Way) -> float:
    """Least displacement down the plate that counts as a run [m]."""
    return max(12 * jitter(way.down), LEAST_RUN * way.drift) + FLOOR


def find_onset(way: Way, run: Run) -> Onset | None:
    """The onset of a run; None if too few points lie before, at or in it."""
    table = _window(way, run)
    if table is None:
        return None
    found, noise = _search(table), FLOOR
    for _ in range(2):
        if found is None:
            return None
        residual = found.miss[found.best] * table.sigma
        moves = table.time > found.onset[found.best]
        # a moving body is registered less well than a resting one, with errors that are correlated in time: with the
        # noise at rest for the whole record, the onset would follow these errors
        rests, runs = (_scatter(residual[part], table.own[part], table.far[part]) for part in (~moves, moves))
        kept = np.empty(len(moves), dtype=bool)
        kept[~moves], kept[moves] = rests.kept, runs.kept
        noise = math.sqrt(float(np.mean(np.where(moves, runs.noise, rests.noise)[kept] ** 2)))
        apart = runs.together if runs.together > WORSE * rests.together else rests.together
        table = table.with_noise(np.where(moves, apart, rests.together), kept)
        # with the new noise another candidate may be the best
        found = _search(table)
    return None if found is None else _summary(way, table, found, noise, _under_way(table, found))


def smooth_angle(time: Array, angle: Array) -> Array:
    """Smoothed angle, shape (n,) (smoothing spline, generalised cross-validation)."""
    from scipy.interpolate import make_smoothing_spline

    if len(time) < 8:
        return angle
    together = -(-len(time) // MOST_KNOTS)  # frames
    starts = np.arange(0, len(time), together)
    count = np.diff([*starts, len(time)])
    when, level = (np.add.reduceat(one, starts) / count for one in (time, angle))
    return np.asarray(make_smoothing_spline(when, level, count / together)(time))


def smoothing_uncertainty(time: Array, angle: Array, places: Array) -> float:
    """Standard uncertainty of the smoothed angle at times `places` [s], from the scatter between parts of the record.

    Every `PARTS`-th point makes one part; the uncertainty of their mean is their scatter over sqrt(PARTS).
    """
    parts = [(time[first::PARTS], angle[first::PARTS]) for first in range(PARTS)]
    # outside the common range of the parts they would differ by the rate of the plate
    places = places[(places >= time[PARTS - 1]) & (places <= time[-PARTS])]
    curves = np.stack([np.interp(places, when, smooth_angle(when, part)) for when, part in parts])
    return math.sqrt(float(np.mean(np.var(curves, axis=0, ddof=1))) / PARTS)


def jitter(values: Array) -> float:
    """Noise from point to point from third differences, insensitive to smooth motion."""
    third = np.diff(values[np.isfinite(values)], n=3)
    return mad_std(third, centre=0.0) / math.sqrt(20) if len(third) else 0.0


def _calm(values: Array) -> Array:
    """Median over three points, so that a single outlier is no motion."""
    padded = np.concatenate([values[:1], values, values[-1:]])
    return np.asarray(np.median(np.stack([padded[:-2], padded[1:-1], padded[2:]]), axis=0))


@dataclass(frozen=True)
class _Table:
    """The points that are fitted, with integrals used by all candidates."""

    time: Array
    angle: Array
    down: Array
    own: Array  # noise of every point relative to that of a point at rest
    far: Array  # [m], noise added in proportion to the displacement
    sigma: Array  # [m], total standard deviation
    kept: npt.NDArray[np.bool_]  # points that are no outliers
    factor: float
    scale_uncertainty: float
    drift: float
    slow: float  # [m/s], prior standard deviation of the speed of creep
    early: float  # [s], earliest onset that is tried
    late: float  # [s], latest onset
    step: float  # [s], frame interval
    sines: tuple[Array, Array]  # first and second integral over time of sin(angle)
    cosines: tuple[Array, Array]

    def with_noise(self, noise: Array, kept: npt.NDArray[np.bool_]) -> _Table:
        """The same with this noise [m] of its points; those not kept get negligible weight."""
        sigma = np.hypot(noise * self.own, self.far)
        return replace(self, sigma=sigma * np.where(kept, 1.0, 1e3), kept=kept)


@dataclass(frozen=True)
class _Candidates:
    """Fits of one onset each, all arrays over candidates."""

    onset: Array  # [s]
    cost: Array  # -2 log of the weight
    answer: Array  # shape (n, 5): rest, axis, gain, creep, jump
    variance: Array  # of the answer, NaN if the candidate has no such column
    creep_from: Array  # [s], NaN without creep
    miss: Array  # (seen - fitted) / sigma, shape (n, points)
    spacing: Array  # [s], to the next onset that was tried: the interval that a candidate represents

    @classmethod
    def joined(cls, parts: Sequence[_Candidates]) -> _Candidates:
        """Concatenated candidates."""
        return cls(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls)))

    @property
    def weight(self) -> Array:
        likely = self.spacing * np.exp(-(self.cost - np.min(self.cost)) / 2)
        return np.asarray(likely / likely.sum())

    @property
    def best(self) -> int:
        return int(np.argmin(self.cost))


def _window(way: Way, run: Run) -> _Table | None:
    """Rest before the run and the run itself, averaged to at most `MOST_POINTS` points; None if too few."""
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
        way.scale_uncertainty,
        way.drift,
        SLOW * run.total / length,
        max(start - 1.2 * length - 8 * step, float(time[2])),
        min(start + 0.35 * length, float(time[-3])),
        step,
        _integrals(time, np.sin(angle)),
        _integrals(time, np.cos(angle)),
    )


def _integrals(time: Array, values: Array) -> tuple[Array, Array]:
    """First and second integral over time from the first point on, with linear interpolation between the points."""
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
    """Onsets [s] to try in the first, coarse search."""
    span = table.late - table.early
    return np.linspace(table.early, table.late, int(np.clip(1.5 * span / table.step, 24, 80)))


def _around(table: _Table, found: _Candidates) -> Array:
    """Onsets [s] to try near the likely ones of one kind."""
    near = found.onset[found.cost < np.min(found.cost) + 16]
    width = float(found.spacing[0])
    return np.linspace(max(near.min() - width, table.early), min(near.max() + width, table.late), 32)


def _search(table: _Table) -> _Candidates | None:
    """Candidates for all likely combinations of onset, creep and jump in friction.

    The models with and without creep are searched separately, as each has its own minimum.  A coarse search may miss
    the narrow minimum of the simple model and find only the wide one of the other, which a finer search cannot leave.
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
    """All candidates of these onsets, by linear least squares; impossible ones have infinite cost."""
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
    """Log odds that the body moves from the first point on, with any initial speed, against the onsets that were tried.

    The same least squares, except for the initial condition.
    """
    from scipy.optimize import lsq_linear

    time, pull = table.time, table.factor * GRAVITY
    sine = _since(table, table.sines, np.sin(table.angle), float(time[0]))
    cosine = _since(table, table.cosines, np.cos(table.angle), float(time[0]))
    columns = np.stack(
        [np.ones_like(time), table.angle - table.angle[0], pull * sine, -pull * cosine, time - time[0]], axis=1
    )
    mean = np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    certain = np.array([0.0, 1 / table.drift, 1 / max(table.scale_uncertainty, LEAST_UNCERTAINTY), 0.0, 0.0])
    weighted = columns / table.sigma[:, None]
    size = np.sqrt(np.sum(weighted**2, axis=0) + certain**2)
    rows = np.vstack([weighted / size, np.diag(certain / size)])
    wanted = np.concatenate([table.down / table.sigma, certain * mean])
    # bounds: gravity pulls down the plate, and the initial speed is not uphill
    least = np.array([-np.inf, -np.inf, 0.0, -np.inf, 0.0])
    answer = lsq_linear(rows, wanted, (least, np.full(5, np.inf)))
    # Schwarz's penalty for two free parameters: initial speed and friction
    cost = 2 * float(answer.cost) + 2 * math.log(max(float(np.sum(table.kept)), 2.0))
    return (float(np.min(found.cost)) - cost) / 2


def _solved(table: _Table, onsets: Array, columns: Array, creep_from: float) -> _Candidates:
    """The candidates of one combination of terms.

    Columns: rest, axis, gain, then creep if `creep_from` [s] is finite, then jump if there is one.
    """
    count = columns.shape[1]
    creeps = math.isfinite(creep_from)
    places = [0, 1, 2, 4][:count] if not creeps else [0, 1, 2, 3, 4][:count]
    # priors: gain from the scale; axis from the uncertainty of the hinge; creep is slow against the run; friction jumps
    # by less than 1
    mean = np.array([0.0, 0.0, 1.0, 0.0, 0.0])[places]
    gain = 1 / max(table.scale_uncertainty, LEAST_UNCERTAINTY) ** 2
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
    # Schwarz's penalty per parameter; creep has a start and a size
    free = (2 if creeps else 0) + (1 if 4 in places else 0)
    cost = cost + free * math.log(max(float(np.sum(table.kept)), 2.0))
    if creeps:  # prior: all creeps together are as likely as none, however many are tried
        cost = cost + 2 * math.log(CREEP_STARTS * CREEP_SHAPES)
    if 4 in places and table.factor < 1:
        cost = cost + ROLLING_JUMP
    full, variance = np.zeros((len(onsets), 5)), np.full((len(onsets), 5), np.nan)
    full[:, places] = answer
    variance[:, places] = np.einsum("kii->ki", inverse) / size**2
    # friction does not increase when motion starts; creep is downhill and starts before the onset
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
    """Noise of the residuals of a set of points."""

    noise: float  # [m], of a point at rest
    together: float  # [m], the same, enlarged for correlation between points
    kept: npt.NDArray[np.bool_]  # points that are no outliers


def _scatter(residual: Array, own: Array, far: Array) -> _Scatter:
    """Noise of points with an additional known noise `far` [m], by expectation maximisation."""
    if len(residual) < 2:
        return _Scatter(FLOOR, FLOOR, np.ones(len(residual), dtype=bool))
    noise = max(mad_std(residual / own, centre=0.0), FLOOR)
    kept = np.abs(residual) < 4.5 * np.hypot(noise * own, far)
    for _ in range(20):
        share = (noise * own) ** 2 / ((noise * own) ** 2 + far**2)
        squares = ((share * residual) ** 2 + share * far**2) / own**2
        noise = max(math.sqrt(float(np.mean(squares[kept]))), FLOOR)
    scaled = residual / np.hypot(noise * own, far)
    # until the autocorrelation is no longer significant
    together = autocorrelation_factor(scaled[kept], min(MOST_LAGS, int(np.count_nonzero(kept)) // 4), significance=2.0)
    return _Scatter(noise, noise * math.sqrt(together), kept)


def _summary(way: Way, table: _Table, found: _Candidates, noise: float, under_way: float) -> Onset | None:
    """Weighted mean and spread over all candidates; None if the onset lies in a gap of the record."""
    weight = found.weight

    def average(values: Array, own: Array | float = 0.0) -> tuple[float, float]:
        mean = float(weight @ values)
        return mean, math.sqrt(max(float(weight @ ((values - mean) ** 2 + own)), 0.0))

    time, time_sigma = average(found.onset)
    grid = float(found.spacing[found.best])
    angles = np.interp(found.onset, table.time, table.angle)
    angle, angle_sigma = average(angles)
    near = np.abs(table.time - time) < max(8 * table.step, 0.05)
    if np.sum(near) < 2:
        return None
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
        math.hypot(angle_sigma, rate * grid / 3, smoothing_uncertainty(way.time, way.angle, table.time)),
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
