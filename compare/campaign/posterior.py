"""Parameters given measurements: priors, likelihood with the emulators' uncertainty, and samples of the posterior."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigtwin.compare.campaign.emulator import Emulator
from rigtwin.lab.arrays import Array

# chosen beforehand, not fitted to labs; the row that tests them together is the recovery of `make bench-calibrate`
WALKERS = 32
STEPS, MOST_STEPS = 900, 7200  # of a walker
CONVERGED = 50  # autocorrelation times after which a chain counts as converged, as emcee's documentation has it
THINNED = 5
OFTEN = 0.8  # share of the twins that give a quantity, from which its correlation is taken
POOLED = 4  # degrees of freedom of the twin's scatter, beside those of the repetitions
LOGARITHMIC = 8.0  # ratio of the ends of a range above which its logarithm is uniform


@dataclass(frozen=True)
class Parameter:
    """A parameter that is calibrated, with its prior.

    Attributes
    ----------
    name : str
        Its name, as in a sweep.
    low, high : float
        Range in SI.
    mean, std : float, optional
        A measured value and its standard uncertainty; without them all of the range is equally likely, of a wide range
        all of its logarithm.
    source : str
        Where range or value come from, in words.
    """

    name: str
    low: float
    high: float
    mean: float | None = None
    std: float | None = None
    source: str = ""

    @property
    def logarithmic(self) -> bool:
        """Whether the parameter is scaled by its logarithm."""
        return self.mean is None and 0 < LOGARITHMIC * self.low < self.high

    def value(self, unit: Array) -> Array:
        """Return values in SI of numbers in [0, 1].

        Parameters
        ----------
        unit : ndarray
            The numbers, of any shape.

        Returns
        -------
        ndarray
            The values, of the same shape.
        """
        if self.logarithmic:
            return np.asarray(self.low * (self.high / self.low) ** unit)
        return np.asarray(self.low + (self.high - self.low) * unit)

    def unit(self, value: Array) -> Array:
        """Return numbers in [0, 1] of values in SI.

        Parameters
        ----------
        value : ndarray
            The values, of any shape.

        Returns
        -------
        ndarray
            The numbers, of the same shape.
        """
        if self.logarithmic:
            return np.asarray(np.log(value / self.low) / math.log(self.high / self.low))
        return np.asarray((value - self.low) / (self.high - self.low))

    def log_prior(self, unit: Array) -> Array:
        """Return the logarithm of the prior density, up to a constant.

        Parameters
        ----------
        unit : ndarray
            Numbers in [0, 1], of any shape.

        Returns
        -------
        ndarray
            Logarithms [1], of the same shape.
        """
        if self.mean is None or self.std is None:
            return np.zeros_like(unit)
        return np.asarray(-0.5 * ((self.value(unit) - self.mean) / self.std) ** 2)


@dataclass(frozen=True)
class Target:
    """A measured quantity that the twin shall give.

    Attributes
    ----------
    experiment, quantity, method, unit : str
        What was measured, and where.
    value, std_uncertainty : float
        Mean over the repetitions and its standard uncertainty, in `unit`.
    repetitions : int
        Number of repetitions.
    reading_std : float
        Standard uncertainty of the convention by which this quantity is read, in `unit`; all targets of this quantity
        and method are off by the same amount.
    """

    experiment: str
    quantity: str
    method: str
    unit: str
    value: float
    std_uncertainty: float
    repetitions: int
    reading_std: float = 0.0


def correlation(targets: Sequence[Target], residuals: Mapping[Target, Array]) -> Array:
    """Return the correlation of the scatter of the targets from run to run.

    Quantities read from the same heap err together.  Their correlation is that of the emulators' residuals over the
    runs of an experiment, shrunk towards none; other experiments are independent, and so is a quantity that fewer than
    four of five twins give.

    Parameters
    ----------
    targets : sequence of Target
        Targets that the parameters are fitted to.
    residuals : mapping of Target to ndarray
        Of each target the residuals of its emulator over the runs, NaN where a run does not give it.

    Returns
    -------
    ndarray, shape (k, k)
        The correlation [1] of the k targets.

    References
    ----------
    Ledoit & Wolf 2004.
    """
    from sklearn.covariance import LedoitWolf

    found = np.eye(len(targets))
    for experiment in dict.fromkeys(target.experiment for target in targets):
        mine = [k for k, target in enumerate(targets) if target.experiment == experiment]
        rows = np.array([residuals[targets[k]] for k in mine]).T
        often = np.isfinite(rows).mean(axis=0) >= OFTEN
        mine, rows = [k for k, one in zip(mine, often, strict=True) if one], rows[:, often]
        rows = rows[np.isfinite(rows).all(axis=1)]
        spread = rows.std(axis=0) if len(rows) else np.zeros(len(mine))
        varied = [k for k, one in zip(mine, spread, strict=True) if one > 0]
        if len(varied) < 2:
            continue
        scaled = rows[:, spread > 0] / spread[spread > 0]
        shrunk = LedoitWolf(assume_centered=True).fit(scaled).covariance_
        deviation = np.sqrt(np.diag(shrunk))
        found[np.ix_(varied, varied)] = shrunk / np.outer(deviation, deviation)
    return found


def scatter(target: Target, twin_std: float) -> float:
    """Return the standard uncertainty of a measured mean.

    The scatter of a few repetitions is hardly known.  It is pooled with the standard deviation of the twin from seed to
    seed, which counts as `POOLED` degrees of freedom, unless the measurement is less certain anyway; of one or two
    repetitions hardly any scatter is known, and the twin's is added.

    Parameters
    ----------
    target : Target
        Target whose mean was measured.
    twin_std : float
        Standard deviation of the twin from seed to seed, in the unit of the target.

    Returns
    -------
    float
        Standard uncertainty, in the unit of the target.
    """
    own, twin = target.std_uncertainty**2, twin_std**2 / target.repetitions
    freedom = target.repetitions - 1
    pooled = (freedom * own + POOLED * max(own, twin)) / (freedom + POOLED)
    return math.sqrt(own + twin if target.repetitions <= 2 else pooled)


@dataclass(frozen=True)
class Posterior:
    """Density of parameters given measurements.

    Attributes
    ----------
    parameters : sequence of Parameter
        With their priors.
    targets : sequence of Target
        The measurements.
    emulators : sequence of Emulator
        Of each target.
    correlation : ndarray, shape (k, k)
        As of `correlation`.
    """

    parameters: Sequence[Parameter]
    targets: Sequence[Target]
    emulators: Sequence[Emulator]
    correlation: Array

    def log_density(self, unit: Array) -> Array:
        """Return the logarithm of the density, up to a constant.

        Parameters
        ----------
        unit : ndarray, shape (n, p)
            Points of the unit cube.

        Returns
        -------
        ndarray, shape (n,)
            Logarithms [1]; minus infinity outside the cube.
        """
        inside = ((unit >= 0) & (unit <= 1)).all(axis=1)
        total = np.full(len(unit), -math.inf)
        if inside.any():
            within = unit[inside]
            square, covariance = self._misfit(within)
            total[inside] = self._log_prior(within) - 0.5 * (square + np.linalg.slogdet(covariance)[1])
        return total

    def chi_square(self, unit: Array) -> Array:
        """Return the squared deviations over their covariance; a measured prior counts, too.

        Parameters
        ----------
        unit : ndarray, shape (n, p)
            Points of the unit cube.

        Returns
        -------
        ndarray, shape (n,)
            Chi-square [1].
        """
        return self._misfit(unit)[0] - 2 * self._log_prior(unit)

    def shares(self, unit: Array) -> Array:
        """Return the emulators' share of the variance of each target.

        Parameters
        ----------
        unit : ndarray, shape (n, p)
            Points of the unit cube.

        Returns
        -------
        ndarray, shape (n, k)
            Shares [1].
        """
        _, emulated = self._predict(unit)
        return np.asarray(emulated**2 / (self._scatter**2 + np.diag(self._read) + emulated**2))

    @cached_property
    def _measured(self) -> Array:
        """Covariance of measurement minus twin without the emulators' variance, shape (k, k), for all steps."""
        return np.asarray(self.correlation * np.outer(self._scatter, self._scatter) + self._read)

    @cached_property
    def _scatter(self) -> Array:
        """Standard deviation between measurement and twin without the emulator's, shape (k,)."""
        return np.array([scatter(one, two.noise) for one, two in zip(self.targets, self.emulators, strict=True)])

    @property
    def _read(self) -> Array:
        """Covariance of the conventions by which quantities are read, shape (k, k)."""
        what = [(one.quantity, one.method) for one in self.targets]
        same = np.array([[a == b for a in what] for b in what], dtype=float)
        spread = np.array([one.reading_std for one in self.targets])
        return np.asarray(same * np.outer(spread, spread))

    def _predict(self, unit: Array) -> tuple[Array, Array]:
        both = [emulator.predict(unit) for emulator in self.emulators]
        return np.array([mean for mean, _ in both]).T, np.array([spread for _, spread in both]).T

    def _misfit(self, unit: Array) -> tuple[Array, Array]:
        mean, emulated = self._predict(unit)
        off = np.array([one.value for one in self.targets]) - mean
        floor = np.finfo(float).eps * np.maximum(np.abs(mean), 1e-12) ** 2  # a quantity that never scatters
        covariance = self._measured + (emulated**2 + floor)[:, :, None] * np.eye(len(self.targets))
        square = np.einsum("nk,nk->n", off, np.linalg.solve(covariance, off[..., None])[..., 0])
        return square, covariance

    def _log_prior(self, unit: Array) -> Array:
        return sum((one.log_prior(unit[:, k]) for k, one in enumerate(self.parameters)), np.zeros(len(unit)))


def sample(posterior: Posterior, *, seed: int, most: int = STEPS) -> tuple[Array, Array, bool]:
    """Samples of a posterior (emcee, Goodman & Weare 2010).

    Parameters
    ----------
    posterior : Posterior
        Density over the unit cube.
    seed : int
        Seed of the walkers.
    most : int
        Largest number of steps of a walker; it stops when its chain has converged.

    Returns
    -------
    samples : ndarray, shape (n, p)
        In the unit cube.
    log_density : ndarray, shape (n,)
        Of the samples.
    converged : bool
        Whether the chain is longer than fifty autocorrelation times.
    """
    import emcee

    random = np.random.default_rng(seed)
    dimensions = len(posterior.parameters)
    start = random.random((40 * WALKERS, dimensions))
    density = posterior.log_density(start)
    chosen = start[np.argsort(-density)[: 4 * WALKERS]]
    falloff = 0.25 * (np.sort(density)[::-1][: 4 * WALKERS] - density.max())  # spread over all good places
    weights = np.exp(np.maximum(falloff, -500.0))  # none is zero, so that all walkers find a start
    first = chosen[random.choice(len(chosen), WALKERS, replace=False, p=weights / weights.sum())]
    sampler = emcee.EnsembleSampler(WALKERS, dimensions, posterior.log_density, vectorize=True)
    # emcee's own wrapper prints arguments and traceback of every exception, Ctrl-C included, partly on stdout
    sampler.log_prob_fn = posterior.log_density
    sampler.random_state = np.random.RandomState(seed).get_state()
    state, longest = first, math.inf
    while sampler.iteration < most and sampler.iteration < CONVERGED * longest:
        state = sampler.run_mcmc(state, STEPS, skip_initial_state_check=True)
        longest = float(np.max(sampler.get_autocorr_time(tol=0)))
    burnt = sampler.iteration // 3
    samples = sampler.get_chain(discard=burnt, thin=THINNED, flat=True)
    densities = sampler.get_log_prob(discard=burnt, thin=THINNED, flat=True)
    return samples, densities, sampler.iteration >= CONVERGED * longest
