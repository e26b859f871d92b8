"""Baseline and candidates fitted to the measurements: deviance, coordinates of the axes and their uncertainty.

The baseline moves what the lab states within its standard uncertainty; a candidate frees one more axis.  The deviance
is minus twice the log-likelihood, that of the stated values included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.compare.diagnose.bulk.axes import Axis
from rigtwin.compare.diagnose.bulk.response import Response
from rigtwin.lab.arrays import Array

STARTS = (-0.7, -0.3, 0.0, 0.1, 0.3, 0.6, 0.95)  # first coordinates of a free axis
REWEIGHTED = 3  # fits, each with the covariance at the solution of the one before


@dataclass(frozen=True)
class BulkFit:
    """Axes fitted to the conditions."""

    axes: tuple[Axis, ...]
    freed: tuple[str, ...]  # names of the axes that are not held to their statement
    u: Array  # coordinates
    covariance: Array  # of the coordinates
    deviance: float
    chi2: float  # of the measurements alone
    pulls: dict[str, float]

    def coordinate(self, name: str) -> float:
        return float(self.u[self._place(name)])

    def value(self, name: str) -> float:
        """In SI."""
        return float(self.axes[self._place(name)].value(self.coordinate(name)))

    def std(self, name: str) -> float:
        """Standard uncertainty of the value, in SI."""
        k = self._place(name)
        spread, axis = float(np.sqrt(max(self.covariance[k, k], 0.0))), self.axes[k]
        high, low = min(self.u[k] + spread, 1.0), max(self.u[k] - spread, axis.low)
        return abs(axis.value(float(high)) - axis.value(float(low))) / 2

    def significance(self, name: str) -> float:
        """Coordinate over its standard uncertainty."""
        k = self._place(name)
        spread = float(np.sqrt(max(self.covariance[k, k], 0.0)))
        return abs(float(self.u[k])) / spread if spread > 0 else 0.0

    def _place(self, name: str) -> int:
        return [axis.name for axis in self.axes].index(name)


def fit(
    axes: Sequence[Axis], responses: Sequence[Response], freed: Sequence[str] = (), near: Array | None = None
) -> BulkFit:
    """Fit the stated axes within their uncertainty and the `freed` ones anywhere in their range.

    Parameters
    ----------
    axes : sequence of Axis
        All axes of the lab.
    responses : sequence of Response
        Of the conditions that are fitted.
    freed : sequence of str
        Names of axes without a statement.
    near : ndarray, optional
        Coordinates of another fit, from which the stated axes start.

    Returns
    -------
    BulkFit
        The best of several starts.
    """
    moved = [k for k, axis in enumerate(axes) if axis.std > 0 or axis.name in freed]
    free = [k for k in moved if axes[k].name in freed]
    first = np.zeros(len(axes)) if near is None else near.copy()
    starts = []
    for level in STARTS if free else (0.0,):
        start = first.copy()
        if free and axes[free[-1]].low <= level:
            start[free[-1]] = level
        elif free:
            continue
        starts.append(start)
    return min((_from(axes, responses, freed, moved, start) for start in starts), key=lambda one: one.deviance)


def _from(
    axes: Sequence[Axis], responses: Sequence[Response], freed: Sequence[str], moved: Sequence[int], start: Array
) -> BulkFit:
    from scipy.optimize import least_squares

    held = [k for k in moved if axes[k].name not in freed]
    stds = np.array([axes[k].std for k in held])
    low = np.array([axes[k].low for k in moved]) - 1e-9
    high = np.full(len(moved), 1.0 + 1e-9)
    u = start.copy()

    def whole(part: Array) -> Array:
        full = u.copy()
        full[list(moved)] = part
        return full

    best = _judged(axes, responses, freed, moved, u)
    for _ in range(REWEIGHTED):
        roots = [np.linalg.inv(np.linalg.cholesky(one.covariance(u))) for one in responses]

        def residuals(part: Array, roots: list[Array] = roots) -> Array:
            full = whole(part)
            parts = [root @ (one.measured - one.predicted(full)) for root, one in zip(roots, responses, strict=True)]
            return np.concatenate([*parts, full[held] / stds])

        def jacobian(part: Array, roots: list[Array] = roots) -> Array:
            full = whole(part)
            rows = [-root @ one.slopes(full)[:, list(moved)] for root, one in zip(roots, responses, strict=True)]
            priors = np.array([[float(k == j) / axes[k].std for j in moved] for k in held]).reshape(-1, len(moved))
            return np.concatenate([*rows, priors])

        if not moved:
            break
        begin = np.clip(u[list(moved)], low + 1e-6, high - 1e-6)
        found = least_squares(residuals, begin, jacobian, bounds=(low, high), x_scale=0.1)
        u = whole(found.x)
        best = min(best, _judged(axes, responses, freed, moved, u), key=lambda one: one.deviance)
    return best


def _judged(
    axes: Sequence[Axis], responses: Sequence[Response], freed: Sequence[str], moved: Sequence[int], u: Array
) -> BulkFit:
    chi2, deviance = 0.0, 0.0
    normal = np.zeros((len(moved), len(moved)))
    for one in responses:
        covariance = one.covariance(u)
        off, slopes = one.measured - one.predicted(u), one.slopes(u)[:, list(moved)]
        square = float(off @ np.linalg.solve(covariance, off))
        chi2 += square
        deviance += square + float(np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(one.floor)[1])
        normal += slopes.T @ np.linalg.solve(covariance, slopes)
    pulls = {axes[k].name: float(u[k] / axes[k].std) for k in moved if axes[k].name not in freed}
    for place, k in enumerate(moved):
        if axes[k].name not in freed:
            normal[place, place] += 1 / axes[k].std ** 2
    found = np.zeros((len(axes), len(axes)))
    found[np.ix_(moved, moved)] = np.linalg.pinv(normal)
    deviance += sum(pull**2 for pull in pulls.values())
    return BulkFit(tuple(axes), tuple(freed), u, found, deviance, chi2, pulls)


def numbers(responses: Sequence[Response]) -> int:
    """Number of measured numbers."""
    return sum(len(one.measured) for one in responses)
