"""Mean of a fluctuating, correlated record with its standard error; steady part; avalanches.

A film shows many frames but few independent moments.  The standard deviation over the root of the number of frames
would be far too small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array

SHORTEST = 8  # least number of frames for an analysis over time
JUMP = 3.0  # standard deviations of the steady flow by which a start or an end must differ from it
FEWEST_AVALANCHES = 3


@dataclass(frozen=True)
class Mean:
    """Mean over time."""

    value: float
    std_error: float  # widened for the few independent moments, so that 1.96 of it cover 95 %
    deviation: float  # standard deviation of one moment
    independent: float  # effective number of independent moments


@dataclass(frozen=True)
class Avalanches:
    """Slow rises of the surface and sudden slides."""

    frequency: float  # [1/s]
    frequency_error: float  # [1/s], standard error
    start_angle: float  # mean of the maxima, in the unit of the record
    stop_angle: float  # mean of the minima after them
    count: int


def even(time: Array, value: Array) -> Array:
    """The record resampled in steps of its median interval; gaps are filled by linear interpolation."""
    seen = np.isfinite(value)
    step = float(np.median(np.diff(time)))
    moments = np.arange(round((time[-1] - time[0]) / step) + 1) * step + time[0]
    return np.asarray(np.interp(moments, time[seen], value[seen]))


def mean_over_time(time: Array, value: Array) -> Mean:
    """Mean over time, with equal weight of all moments even where frames were dropped.

    `time` and `value` have shape (n,).  The standard error follows from the integrated correlation time (Sokal 1997,
    self-consistent window), corrected for the bias of a short record, and is widened by Student's t for the effective
    number of independent moments.
    """
    from scipy.stats import t as student

    seen = np.isfinite(value)
    if np.sum(seen) < SHORTEST:
        known = value[seen]
        deviation = float(np.std(known, ddof=1)) if len(known) > 1 else 0.0
        return Mean(float(np.mean(known)), deviation, deviation, 1.0)
    level = even(time[seen], value[seen])
    count = len(level)
    off = level - level.mean()
    variance = float(np.mean(off**2))
    if variance <= 1e-18:
        return Mean(float(level.mean()), 0.0, 0.0, float(count))
    correlation = np.correlate(off, off, "full")[count - 1 :] / (variance * count)
    length = 1.0
    for _ in range(20):
        # the mean comes from the record itself, which lowers every correlation by the variance of that mean
        raised = correlation + (1 - correlation) * min(length / count, 0.4)
        sums = 2 * np.cumsum(raised) - 1
        window = next((k for k in range(1, count) if k >= 3 * max(sums[k], 0.5)), count - 1)
        before, length = length, float(np.clip(sums[window], 1.0, count / 3))
        if abs(length - before) < 1e-3:
            break
    # in a short record of a slow sway the correlation of neighbouring frames says more than its few swings
    neighbours = min(float(correlation[1]) + (1 + 3 * float(correlation[1])) / count, 0.995)
    length = max(length, min((1 + neighbours) / (1 - neighbours), count / 3))
    independent = count / length
    deviation = math.sqrt(variance / (1 - 1 / independent))
    widened = float(student.ppf(0.975, max(independent - 1, 3.0))) / 1.959964
    return Mean(float(level.mean()), deviation / math.sqrt(independent) * widened, deviation, independent)


def steady_part(time: Array, value: Array) -> tuple[int, int]:
    """First and last index of the settled flow.

    A start or an end belongs to it unless it lies clearly outside the range of the middle of the record: a drum that
    starts to turn raises its bed from rest by many standard deviations of its later flow.
    """
    from scipy.ndimage import median_filter

    seen = np.flatnonzero(np.isfinite(value))
    if len(seen) < 4 * SHORTEST:
        return int(seen[0]) if len(seen) else 0, int(seen[-1]) if len(seen) else 0
    level = median_filter(value[seen], size=5)
    middle = level[len(level) // 3 : len(level) - len(level) // 5]
    spread = max(float(np.std(middle)), 1e-9)
    low, high = float(middle.min()) - JUMP * spread, float(middle.max()) + JUMP * spread
    outside = (level < low) | (level > high)
    first, last = 0, len(level) - 1
    if outside[: len(level) // 3].any():
        start = int(np.flatnonzero(outside[: len(level) // 3])[-1])
        # from there to the first time at which the flow has its usual level
        reached = np.flatnonzero(np.abs(level[start:] - float(np.median(middle))) < spread)
        first = start + int(reached[0]) if len(reached) else start
    tail = len(level) - len(level) // 5
    if outside[tail:].any():
        last = tail + int(np.flatnonzero(outside[tail:])[0]) - 1
    return int(seen[first]), int(seen[last])


def find_avalanches(time: Array, angle: Array, turning: float | None) -> Avalanches | str:
    """Avalanches in the surface's angle [deg] over time, or the reason why none can be reported.

    Between two avalanches the bed turns with the drum, by `turning` [deg/s] where it is known, and then slides back
    much faster than it rose.
    """
    from scipy.ndimage import gaussian_filter1d
    from scipy.signal import find_peaks

    seen = np.isfinite(angle)
    if np.sum(seen) < 4 * SHORTEST:
        return f"the surface is seen in only {np.sum(seen)} frames, {4 * SHORTEST} are needed"
    step = float(np.median(np.diff(time)))
    level = even(time[seen], angle[seen])
    noise = float(np.std(np.diff(level, 2))) / math.sqrt(6)
    smooth = gaussian_filter1d(level, 1.5)
    least = max(4 * noise / math.sqrt(5), 0.35 * float(np.ptp(smooth)))
    tops, _ = find_peaks(smooth, prominence=least)
    if len(tops) < FEWEST_AVALANCHES:
        few = f"the angle has {len(tops)} clear maxima, {FEWEST_AVALANCHES} are needed"
        return f"{few}; a longer record may have them, unless the surface flows steadily"
    bottoms = np.array([a + int(np.argmin(smooth[a:b])) for a, b in zip(tops, [*tops[1:], len(smooth)], strict=True)])
    # the last slide may be incomplete
    falls = (bottoms[:-1] - tops[:-1]) * step
    rises = (tops[1:] - bottoms[:-1]) * step
    gained = smooth[tops[1:]] - smooth[bottoms[:-1]]
    if float(np.median(falls)) > 0.5 * float(np.median(rises)):
        return "the angle rises as quickly as it falls: the surface flows steadily and sways"
    speed = float(np.median(gained / rises))
    if turning is not None and not 0.6 < speed / turning < 1.4:
        return f"between its falls the angle rises at {speed:.1f} deg/s, not with the drum at {turning:.1f} deg/s"
    intervals = np.diff(tops) * step
    frequency = 1 / float(intervals.mean())
    error = frequency * max(float(np.std(intervals, ddof=1)), step) / intervals.mean() / math.sqrt(len(intervals))
    return Avalanches(frequency, float(error), float(level[tops].mean()), float(level[bottoms[:-1]].mean()), len(tops))
