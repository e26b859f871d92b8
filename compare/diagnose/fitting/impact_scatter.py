"""Estimate the scatter of impacts and the jitter of timestamps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.fitting.levenberg_marquardt import HOPELESS, newton_step
from rigtwin.compare.diagnose.fitting.normal_equations import Bench, Linear, State, spread_of_each, with_scatter
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array

MOST_UPDATES, SAME = 25, 3e-3  # updates in one linearised model, and the relative change that ends them
LEAST_DETERMINED = 0.2  # smallest share of deviations that count as determined by the data, in one update


def expect_scatter(
    bench: Bench, unknowns: Sequence[Unknown], state: State, free: Array, linear: Linear, most: Array
) -> None:
    """Update the scatter in `state`: squared deviations over the number that the data determine (MacKay 1992).

    The fixed point is that of expectation-maximisation, which needs dozens of steps to reach a small scatter.  It is
    iterated in the linearised model, whose unknowns follow the scatter; where the model does not fit at all, the
    linearised one leads far off, and the deviations of the fit itself are taken.
    """
    if not len(state.scatter):
        return
    size = state.local.shape[1]
    own = linear.by_soft[:, :size]
    if linear.chi2 > HOPELESS * bench.rows.size:
        _update(bench, state, linear.soft, _variance(own, linear.a), most)
        return
    for _ in range(MOST_UPDATES):
        before = state.scatter.copy()
        spread = spread_of_each(bench, state.scatter)
        whole, gradient = with_scatter(linear.by_data, linear.pull, linear.by_soft, linear.soft, spread)
        now = replace(
            linear, a=whole[:, :size, :size], b=whole[:, :size, size:], c=whole[:, size:, size:],
            g_local=gradient[:, :size], g_global=gradient[:, size:],
        )  # fmt: skip
        step_local, step = newton_step(unknowns, state, free, now, 0.0)
        steps = np.concatenate([step_local, np.broadcast_to(step, (len(step_local), len(step)))], axis=1)
        soft = linear.soft + np.einsum("rns,rn->rs", linear.by_soft, steps)
        _update(bench, state, soft, _variance(own, now.a), most)
        if np.allclose(state.scatter, before, rtol=SAME):
            break


def _variance(own: Array, information: Array) -> Array:
    """Variance (R, S) of the deviations, linear in the local unknowns by `own`, of which this is the information."""
    return np.asarray(np.einsum("ris,rij,rjs->rs", own, np.linalg.inv(information), own))


def _update(bench: Bench, state: State, soft: Array, variance: Array, most: Array) -> None:
    for h in range(len(state.scatter)):
        mine = bench.scatter == h
        if mine.any():
            known = 1.0 - np.minimum(variance[mine] / state.scatter[h] ** 2, 1.0)
            square = float(np.sum(soft[mine] ** 2) / max(float(np.sum(known)), LEAST_DETERMINED * known.size))
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
