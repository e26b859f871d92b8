"""A fast stand-in for a quantity of a twin: a Gaussian process over the parameters; the scatter of seeds is noise."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array

Indices = npt.NDArray[np.intp]

SHORTEST, LONGEST = 0.15, 10.0  # bounds of a correlation length, over the range of a parameter
LEAST_NOISE, MOST_NOISE = 1e-4, 1.0  # bounds of the variance of the scatter, over that of the values
RESTARTS = 3  # of the fit of the correlation lengths


@dataclass(frozen=True)
class Emulator:
    """Gaussian process with one correlation length for each parameter and a Gaussian kernel.

    Fitted by `sklearn.gaussian_process`; predicted here, because a posterior asks a hundred thousand times for a few
    points, for which that library takes ten times as long (Rasmussen & Williams 2006, equations 2.25 and 2.26).

    Attributes
    ----------
    columns : ndarray, shape (q,)
        Numbers of the parameters that the twin has; it does not depend on the others.
    lengths : ndarray, shape (q,)
        Correlation lengths over the unit cube.
    amplitude : float
        Variance of the process, over that of the values.
    points : ndarray, shape (n, q)
        Runs in the unit cube, over the lengths.
    inverse : ndarray, shape (n, n)
        Of the covariance of the standardised values.
    weights : ndarray, shape (n,)
        That matrix times the standardised values.
    mean, std : float
        Of the values, in the unit of the quantity.
    fitted_noise : float
        Standard deviation of the twin from seed to seed as fitted, in the unit of the quantity.
    """

    columns: Indices
    lengths: Array
    amplitude: float
    points: Array
    inverse: Array
    weights: Array
    mean: float
    std: float
    fitted_noise: float

    @cached_property
    def widened(self) -> float:
        """Factor on both uncertainties, at least 1.

        With it the runs lie about their own predictions as they should when each is left out in turn.

        Returns
        -------
        float
            The factor [1].

        References
        ----------
        Rasmussen & Williams 2006, section 5.4.2.
        """
        left_out = self.weights / np.sqrt(np.diag(self.inverse))
        return max(1.0, float(np.sqrt(np.mean(left_out**2))))

    @property
    def noise(self) -> float:
        """Standard deviation of the twin from seed to seed, in the unit of the quantity."""
        return self.widened * self.fitted_noise

    def predict(self, unit: Array) -> tuple[Array, Array]:
        """Predict the mean of the twin.

        Parameters
        ----------
        unit : ndarray, shape (n, p)
            Points of the unit cube.

        Returns
        -------
        mean : ndarray, shape (n,)
            In the unit of the quantity.
        std_uncertainty : ndarray, shape (n,)
            The emulator's standard uncertainty of it, in the same unit.
        """
        apart = (unit[:, self.columns] / self.lengths)[:, None, :] - self.points
        kernel = self.amplitude * np.exp(-0.5 * np.einsum("ijk,ijk->ij", apart, apart))
        variance = self.amplitude - np.einsum("ij,ij->i", kernel @ self.inverse, kernel)
        mean = self.mean + self.std * (kernel @ self.weights)
        return mean, self.widened * self.std * np.sqrt(np.maximum(variance, 0.0))


def fit(unit: Array, values: Array, *, seed: int, columns: Sequence[int] | None = None) -> Emulator:
    """Fit an emulator.

    Parameters
    ----------
    unit : ndarray, shape (n, p)
        Parameters of the runs, scaled to the unit cube.
    values : ndarray, shape (n,)
        The quantity.
    seed : int
        Seed of the starts of the fit.
    columns : sequence of int, optional
        Numbers of the parameters that the twin has; all by default.

    Returns
    -------
    Emulator
        Mean and uncertainty of the quantity anywhere in the cube.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    used: Indices = np.arange(unit.shape[1]) if columns is None else np.array(columns, dtype=np.intp)
    unit = unit[:, used]
    kernel = ConstantKernel(1.0, (0.1, 30.0)) * RBF(np.full(unit.shape[1], 0.7), (SHORTEST, LONGEST)) + WhiteKernel(
        0.05, (LEAST_NOISE, MOST_NOISE)
    )
    process = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=RESTARTS, random_state=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound: the quantity does not depend on it
        process.fit(unit, values)
    signal, white = process.kernel_.k1, process.kernel_.k2
    lengths = np.atleast_1d(signal.k2.length_scale)
    inverse = np.linalg.inv(process.kernel_(unit))
    std = float(np.std(values))
    scaled = (values - np.mean(values)) / (std or 1.0)
    return Emulator(
        columns=used,
        lengths=lengths,
        amplitude=float(signal.k1.constant_value),
        points=unit / lengths,
        inverse=inverse,
        weights=inverse @ scaled,
        mean=float(np.mean(values)),
        std=std,
        fitted_noise=float(np.sqrt(white.noise_level)) * std,
    )


def main_effects(emulator: Emulator, parameters: int, *, seed: int, number: int = 512) -> Array:
    """Return the share of the variance of the emulated quantity that each parameter causes alone.

    Parameters
    ----------
    emulator : Emulator
        Emulator of the quantity.
    parameters : int
        Number p of the parameters.
    seed : int
        Seed of the points.
    number : int
        Number of points of each of two designs.

    Returns
    -------
    ndarray, shape (p,)
        First-order Sobol indices over the unit cube, between 0 and 1.

    References
    ----------
    Saltelli et al. 2010, table 2, estimator (b).
    """
    from scipy.stats import qmc

    points = qmc.Sobol(2 * parameters, rng=seed).random(number)
    one, other = points[:, :parameters], points[:, parameters:]
    at_one, at_other = (emulator.predict(points)[0] - emulator.mean for points in (one, other))
    whole = np.var(np.concatenate([at_one, at_other]))
    found = np.empty(parameters)
    for k in range(parameters):
        mixed = one.copy()
        mixed[:, k] = other[:, k]
        found[k] = (
            np.mean(at_other * (emulator.predict(mixed)[0] - emulator.mean - at_one)) / whole if whole > 0 else 0.0
        )
    return np.clip(found, 0.0, 1.0)
