"""Objective of a rig's fit and its normal equations at given values of all unknowns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rigtwin.compare.diagnose.models.scattered import Scattered
from rigtwin.compare.diagnose.models.sensitivities import Moving, Slopes, slopes
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect

BLOCK = 128  # rows in one matrix product


class Bench(Moving, Protocol):
    """A rig with its data: the part that the fit needs."""

    sigma: Array  # [m], (N,)
    local_prior: Array  # (R, L)
    local_sd: Array  # (R, L)
    local_low: Array  # (L,), lower limits
    scatter: Array  # (R, S) index of the scatter parameter of each deviation, -1 for none
    scattered: Sequence[Scattered]  # what scatters, of length H
    scatter_start: Array  # (H,)
    scatter_least: Array  # (H,), smallest scatter that a fit may find
    scatter_most: Array  # (H,), upper limit of the scatter without an effect that widens it
    condition: Array  # (R,) number of the condition of each repetition

    def unknowns(self, terms: Sequence[Effect]) -> list[Unknown]: ...

    def first_guess(self, values: Mapping[str, float]) -> Array: ...


@dataclass
class State:
    local: Array
    values: Array
    scatter: Array
    jitter: float
    jitter_std: float = math.nan


@dataclass
class Linear:
    """Objective, residuals and normal equations at one point."""

    objective: float
    chi2: float
    seen: Slopes
    residual: Array
    a: Array  # (R, L, L)
    b: Array  # (R, L, G)
    c: Array  # (R, G, G)
    g_local: Array  # (R, L)
    g_global: Array  # (R, G)
    soft: Array  # (R, S)
    by_soft: Array  # (R, L + G, S), derivatives of the deviations
    by_data: Array  # (R, L + G, L + G), part of the rows and of the priors of the local unknowns
    pull: Array  # (R, L + G), the same part of the gradient


def linear_at(
    bench: Bench, terms: Sequence[Effect], unknowns: Sequence[Unknown], local: Array, values: Array, scatter: Array
) -> Linear:
    """The objective and its normal equations at given unknowns, on all rows."""
    state = State(local, values, scatter, 0.0)
    return linearise(bench, terms, unknowns, state, np.ones(len(bench.rows), dtype=bool))


@np.errstate(all="ignore")  # too large a step may overflow; its objective is then infinite and the step is refused
def linearise(bench: Bench, terms: Sequence[Effect], unknowns: Sequence[Unknown], state: State, mask: Array) -> Linear:
    """Residuals and normal equations at a state."""
    repetitions, size = state.local.shape
    count = len(unknowns)
    seen = slopes(bench, unknowns, terms, state.local, state.values)
    sigma = noise(bench, seen, state.jitter)
    weight = np.where(mask, 1.0, 0.0)[:, None] / sigma
    residual = (bench.rows - seen.position) * weight
    by_row = seen.by_row * weight
    spread = spread_of_each(bench, state.scatter)
    soft = seen.soft
    whole = np.empty((repetitions, size + count, size + count))
    gradient = np.empty((repetitions, size + count))
    for r, span in enumerate(bench.spans):
        j = by_row[:, span].reshape(size + count, -1)
        whole[r] = _gram(j)
        gradient[r] = j @ residual[span].reshape(-1)
    tie = 1.0 / bench.local_sd**2
    index = np.arange(size)
    whole[:, index, index] += tie
    gradient[:, :size] += tie * (bench.local_prior - state.local)
    by_soft = np.moveaxis(seen.by_soft, 0, 1)
    by_data, pull = whole, gradient
    whole, gradient = with_scatter(by_data, pull, by_soft, soft, spread)
    chi2 = float(np.sum(residual**2))
    objective = chi2 + float(np.sum((soft / spread) ** 2))
    objective += float(np.sum(tie * (state.local - bench.local_prior) ** 2))
    objective += sum(((v - u.prior) / u.sd) ** 2 for u, v in zip(unknowns, state.values, strict=True))
    if state.jitter > 0:
        objective += (
            2 * float(np.sum(np.log(sigma[mask] / bench.sigma[mask, None]))) * (1 if sigma.shape[1] == 2 else 2)
        )
    return Linear(
        objective if math.isfinite(objective) and np.isfinite(whole).all() else math.inf,
        chi2,
        seen,
        residual,
        whole[:, :size, :size],
        whole[:, :size, size:],
        whole[:, size:, size:],
        gradient[:, :size],
        gradient[:, size:],
        soft,
        by_soft,
        by_data,
        pull,
    )


def spread_of_each(bench: Bench, scatter: Array) -> Array:
    """Standard deviation (R, S) of each random deviation, infinite for those that do not occur."""
    return np.asarray(np.where(bench.scatter >= 0, scatter[np.maximum(bench.scatter, 0)], np.inf))


def with_scatter(by_data: Array, pull: Array, by_soft: Array, soft: Array, spread: Array) -> tuple[Array, Array]:
    """Normal equations and gradient with the random deviations, whose standard deviations are `spread` (R, S)."""
    scaled = by_soft / spread[:, None]
    return by_data + scaled @ np.moveaxis(scaled, 1, 2), pull - (scaled @ (soft / spread)[..., None])[..., 0]


def _gram(j: Array) -> Array:
    """j @ j.T in blocks too small for the BLAS library to start threads, which cost more than they save here."""
    even = j.shape[1] // BLOCK * BLOCK
    blocks = j[:, :even].reshape(len(j), -1, BLOCK).swapaxes(0, 1)
    rest = j[:, even:]
    return np.asarray((blocks @ blocks.swapaxes(1, 2)).sum(0) + rest @ rest.T)


def noise(bench: Bench, seen: Slopes, jitter: float) -> Array:
    """Standard deviation [m] of each coordinate, shape (N, 1), or (N, 2) with jitter."""
    if jitter == 0.0:
        return bench.sigma[:, None]
    return np.sqrt(bench.sigma[:, None] ** 2 + (jitter * seen.speed) ** 2)


class Regioned(Bench, Protocol):
    """A bench with the region of the motion of each row."""

    region: Any  # (N,) number of the region, -1 for none
    region_names: Sequence[str]
    condition_names: Sequence[str]
