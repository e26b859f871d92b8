"""Check the frame rate by the beads that leave an outlet and fall: their acceleration is that of gravity."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.formatting import reading
from rigtwin.lab.quantity import Check
from rigtwin.lab.rigs import GRAVITY

LEAST_FRAMES = 5
BEGINS = 1.0  # [bead diameters] below the outlet: a bead that is completely outside falls freely
LEAST_FALL = 1.5  # [bead diameters], least distance over which it must be seen
PASSING = 0.5  # [bead diameters], uncertainty because another bead may have become the lowest one
JUMP = 0.6  # [bead diameters], largest change of the step: a larger one means another bead, or the floor
UNEVEN = 0.12  # [bead diameters], largest standard deviation from a parabola for a free fall
# Least relative deviation of the acceleration from gravity for a failed check.  Air drag takes some hundredths from
# beads of a few millimetres; a frame rate that was mixed up is wrong by a quarter or more.
LEAST_OFF = 0.1
# Outlet speed over sqrt(g W), the speed after a fall of half of the slot's width W.  Beads leave slots from three beads
# wide to many within this range (Beverloo's law); a clip in slow motion plays them at least eight times slower.
OUTLET_SPEED = (0.15, 3.0)


@dataclass(frozen=True)
class FreeFall:
    """Acceleration of the lowest bead below the outlet."""

    acceleration: float  # [px/s^2]
    uncertainty: float  # [px/s^2], standard uncertainty

    def at(self, zoom: float) -> FreeFall:
        """The same acceleration in a picture `zoom` times as large."""
        return FreeFall(self.acceleration * zoom, self.uncertainty * zoom)


def surer(falls: Iterable[FreeFall | None]) -> FreeFall | None:
    """The fall with the smallest relative standard uncertainty."""
    seen = [fall for fall in falls if fall is not None]
    return min(seen, key=lambda fall: fall.uncertainty / fall.acceleration, default=None)


def together(falls: Iterable[FreeFall | None]) -> FreeFall | None:
    """Weighted mean of several estimates; its uncertainty is widened if they disagree (Birge ratio)."""
    seen = [fall for fall in falls if fall is not None]
    if not seen:
        return None
    weights = np.array([fall.uncertainty**-2 for fall in seen])
    each = np.array([fall.acceleration for fall in seen])
    mean = float(np.average(each, weights=weights))
    ratio = float(np.sum(weights * (each - mean) ** 2)) / max(len(seen) - 1, 1)
    return FreeFall(mean, math.sqrt(max(ratio, 1.0) / float(np.sum(weights))))


def fall_below(time: Array, fronts: Array, bead: float) -> FreeFall | None:
    """The fall with the best known acceleration; None if no fall is seen.

    `fronts`, shape (any, n) [px], are distances of the lowest bead below the outlet at `time`, shape (n,) [s], by
    several methods; NaN where there is none.  `bead` is a diameter [px].  The lowest bead falls freely: nothing below
    holds it, and those above are slower.
    """
    return surer(_fitted(time[run], front[run], bead) for front in fronts for run in _runs(front, bead))


def _runs(front: Array, bead: float) -> list[npt.NDArray[np.intp]]:
    """Index ranges over which the front moves down from frame to frame without a jump."""
    step = np.diff(front)
    on = np.isfinite(step) & (step > 0) & (front[1:] > BEGINS * bead) & (front[:-1] > BEGINS * bead)
    before = np.concatenate([[0.0], step[:-1]])
    on &= np.abs(step - np.where(np.isfinite(before), before, 0.0)) < JUMP * bead
    runs = np.split(np.arange(len(front)), np.flatnonzero(~on) + 1)
    return [run for run in runs if len(run) >= LEAST_FRAMES and np.ptp(front[run]) > LEAST_FALL * bead]


def _fitted(time: Array, front: Array, bead: float) -> FreeFall | None:
    since = time - time.mean()
    fit, covariance = np.polyfit(since, front, 2, cov="unscaled")
    scatter = float(np.sqrt(np.sum((front - np.polyval(fit, since)) ** 2) / (len(front) - 3)))
    if scatter > UNEVEN * bead:
        return None
    # rows are whole pixels, and the lowest visible row of a bead changes with its illumination
    noise = max(scatter, 0.5)
    acceleration, uncertainty = 2 * float(fit[0]), 2 * noise * math.sqrt(float(covariance[0, 0]))
    if acceleration < 3 * uncertainty:  # no significant acceleration
        return None
    return FreeFall(acceleration, math.hypot(uncertainty, PASSING * bead / float(np.ptp(front)) * acceleration))


def fall_check(fall: FreeFall, scale: float, scale_uncertainty: float, rate: float) -> Check:
    """Check the acceleration against gravity; `scale` [m/px] with relative uncertainty, `rate` [1/s] as stated."""
    found, uncertainty = fall.acceleration * scale, math.hypot(fall.uncertainty / fall.acceleration, scale_uncertainty)
    reach = max(3 * uncertainty, LEAST_OFF)
    message = f"beads below the outlet fall with {reading(found, found * uncertainty, 'm/s^2')}"
    off = abs(math.log(found / GRAVITY))
    if off < reach:
        # the acceleration is proportional to the square of the rate
        limit = f"a frame rate off by less than a factor of {math.exp((reach + off) / 2):.2f} would not show"
        return Check("frame_rate", True, found, GRAVITY, f"{message}: scale and frame rate fit together; {limit}.")
    captured = rate / math.sqrt(found / GRAVITY)
    return Check(
        "frame_rate",
        False,
        found,
        GRAVITY,
        f"{message} instead of {GRAVITY}: either the clip was captured at {captured:.0f} "
        f"± {captured * uncertainty / 2:.0f} Hz and not at {rate:.4g} (--frame-rate), "
        f"or lengths (the scale) are {found / GRAVITY:.2g} times the true "
        "ones.",
    )


def outlet_check(velocity: float, width: float) -> Check:
    """Check the outlet speed [m/s] against gravity for a slot `width` [m]; used if no bead is seen to fall.

    The limits are wide, because the speed depends on the bead size.
    """
    ratio = velocity / math.sqrt(GRAVITY * width)
    passed = OUTLET_SPEED[0] < ratio < OUTLET_SPEED[1]
    ending = ": is the frame rate that of the capture (--frame-rate), and is the scale right?"
    if ratio < 0:
        ending = ": they rise; is the clip played backwards?"
    if passed:
        # the speed is proportional to the rate
        low, high = OUTLET_SPEED[1] / ratio, ratio / OUTLET_SPEED[0]
        ending = f", so that a rate {low:.1f} times too low or {high:.1f} times too high would not show."
    message = f"beads leave the slot {ratio:.2g} times as fast as a body that has fallen half its width{ending}"
    return Check("frame_rate", passed, ratio, 1.0, message)
