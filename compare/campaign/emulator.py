"""A fast stand-in for a quantity of a twin: a Gaussian process over the parameters; the scatter of seeds is noise."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array

SHORTEST, LONGEST = 0.15, 10.0  # bounds of a correlation length, over the range of a parameter
LEAST_NOISE, MOST_NOISE = 1e-4, 0.5  # bounds of the variance of the scatter, over that of the values
RESTARTS = 3  # of the fit of the correlation lengths


@dataclass(frozen=True)
class Emulator:
    """Gaussian process (`sklearn.gaussian_process`) with one correlation length for each parameter.

    Parameters
    ----------
    process : GaussianProcessRegressor
        Fitted to standardised values.
    fitted_noise : float
        Standard deviation of the twin from seed to seed as fitted, in the unit of the quantity.
    widened : float
        Factor on both uncertainties, with which the runs lie about their own predictions as they should when each is
        left out in turn; at least 1.
    """

    process: Any
    fitted_noise: float
    widened: float = 1.0

    @property
    def noise(self) -> float:
        """Standard deviation of the twin from seed to seed, in the unit of the quantity."""
        return self.widened * self.fitted_noise

    def predict(self, unit: Array) -> tuple[Array, Array]:
        """Mean of the twin at points of the unit cube, shape (n, p), and the emulator's standard uncertainty of it."""
        mean, spread = self.process.predict(unit, return_std=True)
        return mean, self.widened * np.sqrt(np.maximum(spread**2 - self.fitted_noise**2, 0.0))


def fit(unit: Array, values: Array, *, seed: int) -> Emulator:
    """Fit an emulator.

    Parameters
    ----------
    unit : ndarray, shape (n, p)
        Parameters of the runs, scaled to the unit cube.
    values : ndarray, shape (n,)
        The quantity.
    seed : int
        Seed of the starts of the fit.

    Returns
    -------
    Emulator
        Mean and uncertainty of the quantity anywhere in the cube.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    kernel = ConstantKernel(1.0, (0.1, 30.0)) * RBF(np.full(unit.shape[1], 0.7), (SHORTEST, LONGEST)) + WhiteKernel(
        0.05, (LEAST_NOISE, MOST_NOISE)
    )
    process = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=RESTARTS, random_state=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound: the quantity does not depend on it
        process.fit(unit, values)
    noise = float(np.sqrt(process.kernel_.k2.noise_level)) * float(np.std(values))
    return Emulator(process, noise, max(1.0, float(np.sqrt(np.mean(_left_out(process) ** 2)))))


def _left_out(process: Any) -> Array:
    """Standardised deviation of each run from the prediction without it (Rasmussen & Williams 2006, section 5.4.2)."""
    inverse = np.linalg.inv(process.kernel_(process.X_train_))
    return np.asarray(inverse @ process.y_train_ / np.sqrt(np.diag(inverse)))


def main_effects(emulator: Emulator, parameters: int, *, seed: int, number: int = 512) -> Array:
    """Share of the variance of the emulated quantity that each parameter causes alone, shape (p,).

    First-order Sobol indices over the unit cube (Saltelli et al. 2010, table 2, estimator (b)).
    """
    from scipy.stats import qmc

    points = qmc.Sobol(2 * parameters, rng=seed).random(number)
    one, other = points[:, :parameters], points[:, parameters:]
    at_one, at_other = emulator.predict(one)[0], emulator.predict(other)[0]
    whole = np.var(np.concatenate([at_one, at_other]))
    found = np.empty(parameters)
    for k in range(parameters):
        mixed = one.copy()
        mixed[:, k] = other[:, k]
        found[k] = np.mean(at_other * (emulator.predict(mixed)[0] - at_one)) / whole if whole > 0 else 0.0
    return np.clip(found, 0.0, 1.0)
