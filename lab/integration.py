"""Integrate equations of motion in time, and interpolate between the steps; for many settings at once.

`scipy.integrate.solve_ivp` and `scipy.interpolate.CubicHermiteSpline` treat one motion at a time, with one grid of
times for all its coordinates; a fit needs thousands of motions, each with steps of its own.
"""

from __future__ import annotations

from collections.abc import Callable

from rigtwin.lab.arrays import Array

Acceleration = Callable[..., Array]
"""Acceleration from position and velocity; for a driven motion also from the time [s]."""


def runge_kutta(
    acceleration: Acceleration, position: Array, velocity: Array, h: Array, time: Array | None = None
) -> tuple[Array, Array]:
    """Position and velocity after one step of the classical fourth-order Runge-Kutta method.

    Parameters
    ----------
    acceleration : callable
        ``acceleration(position, velocity)``, or with `time` ``acceleration(position, velocity, time)``.
    position, velocity : array
        State at the start of the step, of any common shape; lengths or angles.
    h : array
        [s], step, of a shape that broadcasts with the state.
    time : array, optional
        [s], at the start of the step.

    Returns
    -------
    tuple of array
        Position and velocity at the end of the step.

    Examples
    --------
    >>> import numpy as np
    >>> position, velocity = runge_kutta(lambda x, v: -x, np.ones(1), np.zeros(1), np.array([0.1]))
    >>> bool(abs(position[0] - np.cos(0.1)) < 1e-7)
    True
    """
    begin, middle, end = ((),) * 3 if time is None else ((time,), (time + 0.5 * h,), (time + h,))
    a1 = acceleration(position, velocity, *begin)
    v2 = velocity + 0.5 * h * a1
    a2 = acceleration(position + 0.5 * h * velocity, v2, *middle)
    v3 = velocity + 0.5 * h * a2
    a3 = acceleration(position + 0.5 * h * v2, v3, *middle)
    v4 = velocity + h * a3
    a4 = acceleration(position + h * v3, v4, *end)
    return (
        position + h / 6 * (velocity + 2 * v2 + 2 * v3 + v4),
        velocity + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4),
    )


def hermite(start: Array, end: Array, slope_start: Array, slope_end: Array, s: Array) -> Array:
    """Interpolate with the cubic that has these ends and end slopes.

    Parameters
    ----------
    start, end : array
        Values at the ends of the step, of any common shape and unit.
    slope_start, slope_end : array
        Slopes there, per step, in the same unit.
    s : array
        Fraction of the step [1].

    Returns
    -------
    array
        Values at `s`.

    Examples
    --------
    >>> float(hermite(0.0, 1.0, 0.0, 0.0, 0.5))
    0.5
    """
    bend, twist = _coefficients(start, end, slope_start, slope_end)
    return start + s * (slope_start + s * (bend + s * twist))


def hermite_slope(start: Array, end: Array, slope_start: Array, slope_end: Array, s: Array) -> Array:
    """Return the slope of the cubic of `hermite`.

    Parameters
    ----------
    start, end, slope_start, slope_end, s : array
        As for `hermite`.

    Returns
    -------
    array
        Slopes at `s`, per step.

    Examples
    --------
    >>> float(hermite_slope(0.0, 1.0, 0.0, 0.0, 0.5))
    1.5
    """
    bend, twist = _coefficients(start, end, slope_start, slope_end)
    return slope_start + s * (2 * bend + 3 * s * twist)


def _coefficients(start: Array, end: Array, slope_start: Array, slope_end: Array) -> tuple[Array, Array]:
    """Coefficients of s^2 and s^3."""
    return 3 * (end - start) - 2 * slope_start - slope_end, 2 * (start - end) + slope_start + slope_end
