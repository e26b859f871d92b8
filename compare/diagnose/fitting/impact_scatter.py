"""Estimate the scatter of impacts and the jitter of timestamps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.fitting.normal_equations import Bench, Linear, State
from rigtwin.lab.arrays import Array

LEAST_DETERMINED = 0.2  # smallest share of deviations that count as determined by the data, in one update


def expect_scatter(bench: Bench, state: State, linear: Linear, most: Array) -> None:
    """Update the scatter in `state`: squared deviations over the number that the data determine (MacKay 1992).

    The fixed point is that of expectation-maximisation, which needs dozens of steps to reach a small scatter.
    """
    if not len(state.scatter):
        return
    inverse = np.linalg.inv(linear.a)
    variance = np.einsum("rsi,rij,rsj->rs", linear.soft_slope, inverse, linear.soft_slope)
    for h in range(len(state.scatter)):
        mine = bench.scatter == h
        if mine.any():
            known = 1.0 - np.minimum(variance[mine] / state.scatter[h] ** 2, 1.0)
            square = float(np.sum(linear.soft[mine] ** 2) / max(float(np.sum(known)), LEAST_DETERMINED * known.size))
            state.scatter[h] = max(min(math.sqrt(square), float(most[h])), float(bench.scatter_least[h]))


def jitter_of(bench: Bench, linear: Linear, mask: Any) -> tuple[float, float]:
    """Maximum-likelihood timestamp jitter [s] and its standard deviation [s].

    Uses differences of the residuals from row to row: jitter changes from frame to frame, a misfit of the model hardly
    does.  The noise of a bead at rest is fitted too, because the noise estimated from the tracks contains part of the
    jitter.
    """
    from scipy.optimize import minimize

    residual = bench.rows - linear.seen.position
    follows = mask[1:] & mask[:-1] & (np.abs(np.diff(bench.time)) < 3 * np.median(np.abs(np.diff(bench.time))))
    off = np.diff(residual, axis=0)[follows] ** 2 / 2
    squared = linear.seen.speed**2
    speed, floor = (squared[1:] + squared[:-1])[follows] / 2, bench.sigma[1:][follows, None] ** 2

    def badness(logs: Array) -> float:
        variance = math.exp(2 * logs[1]) * floor + math.exp(2 * logs[0]) * speed
        return float(np.sum(off / variance + np.log(variance)))

    limits = [(math.log(1e-7), math.log(0.05)), (math.log(0.3), math.log(1.05))]
    starts = [(math.log(tau), 0.0) for tau in (1e-5, 1e-3)]
    found = min(
        (minimize(badness, start, method="L-BFGS-B", bounds=limits) for start in starts), key=lambda one: one.fun
    )
    h = 0.02
    bend = np.array(
        [
            [
                badness(found.x + h * (i + j)) - badness(found.x + h * (i - j)) - badness(found.x - h * (i - j))
                + badness(found.x - h * (i + j))
                for j in np.eye(2)
            ]
            for i in np.eye(2)
        ]
    ) / (8 * h * h)  # fmt: skip
    # half of `badness` is the negative log-likelihood; neighbouring differences share a row, hence the factor
    variance = np.linalg.pinv(bend)[0, 0] * 1.5
    tau = math.exp(float(found.x[0]))
    return tau, tau * math.sqrt(max(float(variance), 0.0))
