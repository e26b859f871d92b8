"""Fits of known least squares problems, within limits and on a rough objective, against SciPy and closed forms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from rigtwin.compare.diagnose.fitting.fit import fit
from rigtwin.compare.diagnose.models.camera import CALIBRATED
from rigtwin.compare.diagnose.models.sensitivities import Mechanics
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.sim.effects import named

NOISE = 1e-3  # [m]
TIMES = np.linspace(0.1, 1.0, 10)  # [s]
CAMERA = [f"{name}.{named(name).parameters[0].name}" for name in CALIBRATED]


class Bodies:
    """Bodies of which `path` gives the place (n, 2) [m] at `TIMES` from own and common unknowns."""

    onset = set_up = -1
    small = 1e-4
    rough = 0.0  # [m], of ripples that no derivative shows, as of a motion integrated in steps
    scatter_start = scatter_least = scatter_most = np.zeros(0)
    scattered = ()

    def __init__(self, path: Callable, rows: np.ndarray, low: list[float], common: list[Unknown], first: np.ndarray):
        self.path, self.common, self.first, self.moves = path, common, first, 0
        bodies = len(rows)
        self.rows, self.time = rows.reshape(-1, 2), np.tile(TIMES, bodies)
        self.sigma = np.full(len(self.rows), NOISE)
        self.spans = [slice(k * len(TIMES), (k + 1) * len(TIMES)) for k in range(bodies)]
        self.owner, self.condition = np.repeat(np.arange(bodies), len(TIMES)), np.zeros(bodies, dtype=int)
        self.local_low, self.local_prior = np.array(low), np.zeros((bodies, len(low)))
        self.local_sd, self.scatter = np.full((bodies, len(low)), np.inf), np.zeros((bodies, 0), dtype=int)

    def unknowns(self, _terms):
        return [*self.common, *(Unknown(name, 0.0, 1e-3, sd=1e-9) for name in CAMERA)]

    def first_guess(self, _values):
        return self.first.copy()

    def mechanics(self, unknowns, _terms, local, values, _true):
        """Derivatives by central differences, exact for a path that is at most quadratic."""
        self.moves += 1
        own, size = local.shape[1], local.shape[1] + len(unknowns)
        shared = values[: len(self.common)]
        by_row = np.zeros((size, *self.rows.shape))
        for r, span in enumerate(self.spans):
            both = np.concatenate([local[r], shared])
            for k in range(len(both)):
                step = np.where(np.arange(len(both)) == k, 1e-4, 0.0)
                ahead, behind = (self.path(*np.split(both + sign * step, [own])) for sign in (1, -1))
                by_row[k, span] = (ahead - behind) / 2e-4
        place = np.concatenate([self.path(one, shared) for one in local])
        place[:, 0] += self.rough * np.sin(1e7 * shared.sum())
        still, none = np.zeros(len(self.rows)), np.zeros((len(local), 0))
        return Mechanics(*place.T, still, still, none, by_row, np.zeros((size, *none.shape)))


def fall(own: np.ndarray, common: np.ndarray) -> np.ndarray:
    """Bodies with a speed and a place each, which all have one acceleration."""
    return np.column_stack([own[0] * TIMES + own[1], 0.5 * common[0] * TIMES**2 + own[0] * TIMES])


def bounded(rows: np.ndarray, low: float, common: tuple[float, float]) -> np.ndarray:
    """The same fit by SciPy, as one linear problem: speed and place of each body, then the acceleration."""
    bodies, size = len(rows), 2 * len(rows) + 1
    matrix = np.zeros((*rows.shape, size))
    for r in range(bodies):
        for k, own in enumerate(np.eye(2)):
            matrix[r, ..., 2 * r + k] = fall(own, np.zeros(1))
        matrix[r, ..., -1] = fall(np.zeros(2), np.ones(1))
    lower = np.array([low, -np.inf] * bodies + [common[0]])
    upper = np.array([np.inf] * (size - 1) + [common[1]])
    return lsq_linear(matrix.reshape(-1, size), rows.ravel(), (lower, upper), tol=1e-14).x


@pytest.mark.parametrize("speeds", [(0.5, 0.7, 0.9), (0.5, -0.3, 0.9), (-0.2, -0.3, -0.1)])
@pytest.mark.parametrize("limits", [(-20.0, 20.0), (-20.0, -8.0), (-12.0, -9.0)])
def test_unknowns_at_a_limit_stay_there_and_the_others_find_their_best_beside_them(speeds, limits):
    random = np.random.default_rng(4)
    rows = np.stack([fall(np.array([speed, 0.1]), np.array([-8.5])) for speed in speeds])
    rows += NOISE * random.normal(size=rows.shape)
    acceleration = Unknown("acceleration", -10.0, 0.1, low=limits[0], high=limits[1])
    bench = Bodies(fall, rows, [0.0, -np.inf], [acceleration], np.full((3, 2), 0.3))
    found = fit(bench)
    best = bounded(rows, 0.0, limits)
    assert found.converged
    assert found.local.ravel() == pytest.approx(best[:-1], abs=1e-6)
    assert found.value("acceleration") == pytest.approx(best[-1], abs=1e-6)


def valley(own: np.ndarray, common: np.ndarray) -> np.ndarray:
    """Rosenbrock's curved valley, whose lowest place is (1, 1)."""
    a, b = common
    return np.column_stack([np.full(len(TIMES), 1 - a + own[0]), np.full(len(TIMES), 10 * (b - a * a))])


@pytest.mark.parametrize(("rough", "most"), [(0.0, 35), (NOISE, 42)])
def test_a_descent_follows_a_curved_valley_to_its_end_and_ends_there_soon(rough, most):
    rows = NOISE * np.random.default_rng(6).normal(size=(1, len(TIMES), 2))
    common = [Unknown("a", -1.2, 0.1), Unknown("b", 1.0, 0.1)]
    bench = Bodies(valley, rows, [-np.inf], common, np.zeros((1, 1)))
    bench.local_sd[:] = 1e-9  # no unknown of its own
    bench.rough = rough
    found = fit(bench, most=200)
    least = float(np.sum((rows - rows.mean(axis=1)) ** 2)) / NOISE**2
    assert found.converged
    assert found.objective - least < 0.01 + rough / NOISE  # what ripples of this height may leave
    assert bench.moves < most
