"""Robust circle fit."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.measure.robust import mad_std


def fit_circle(points: Array) -> tuple[Array, float]:
    """Centre [shape (2,)] and radius of the circle through points of an arc, shape (n, 2); robust against outliers.

    >>> angle = np.linspace(0, 2, 20)
    >>> centre, radius = fit_circle(np.column_stack([3 + 5 * np.cos(angle), 4 + 5 * np.sin(angle)]))
    >>> centre.round(6).tolist(), round(radius, 6)
    ([3.0, 4.0], 5.0)
    """
    from scipy.optimize import least_squares

    # the algebraic fit x^2 + y^2 = 2 a x + 2 b y + c is biased towards small circles; the geometric fit removes this
    middle = points.mean(axis=0)
    near = points - middle
    a, b, c = np.linalg.lstsq(np.column_stack([2 * near, np.ones(len(near))]), np.sum(near * near, axis=1), rcond=None)[
        0
    ]
    size = math.sqrt(max(c + a * a + b * b, 1e-30))

    def miss(circle: Array) -> Array:
        return np.asarray(np.hypot(near[:, 0] - circle[0], near[:, 1] - circle[1]) - circle[2])

    scatter = mad_std(miss(np.array([a, b, size])), centre=0.0) + 1e-9 * size
    circle = least_squares(miss, [a, b, size], loss="soft_l1", f_scale=2 * scatter, x_scale=size).x
    return middle + circle[:2], float(abs(circle[2]))
