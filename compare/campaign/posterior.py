"""Parameters given measurements: priors, likelihood with the emulator's uncertainty, and samples of the posterior."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.compare.campaign.emulator import Emulator
from rigtwin.lab.arrays import Array

WALKERS = 32
STEPS, BURNT = 900, 300
LOGARITHMIC = 8.0  # ratio of the ends of a range above which its logarithm is uniform


@dataclass(frozen=True)
class Parameter:
    """A parameter that is calibrated, and what is known of it beforehand.

    Parameters
    ----------
    name : str
        Its name, as in a sweep.
    low, high : float
        Range in SI, both above zero.
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
        return self.mean is None and self.high > LOGARITHMIC * self.low

    def value(self, unit: Array) -> Array:
        """Values in SI of numbers in [0, 1]."""
        if self.logarithmic:
            return np.asarray(self.low * (self.high / self.low) ** unit)
        return np.asarray(self.low + (self.high - self.low) * unit)

    def unit(self, value: Array) -> Array:
        """Numbers in [0, 1] of values in SI."""
        if self.logarithmic:
            return np.asarray(np.log(value / self.low) / math.log(self.high / self.low))
        return np.asarray((value - self.low) / (self.high - self.low))

    def log_prior(self, unit: Array) -> Array:
        """Logarithm of the prior density, up to a constant."""
        if self.mean is None or self.std is None:
            return np.zeros_like(unit)
        return np.asarray(-0.5 * ((self.value(unit) - self.mean) / self.std) ** 2)


@dataclass(frozen=True)
class Target:
    """A measured quantity that the twin shall give."""

    experiment: str
    quantity: str
    method: str
    unit: str
    value: float
    std_uncertainty: float
    repetitions: int
    shared: int = 1  # number of targets read from the same heap or bed, which err together


def variance(target: Target, emulator: Emulator, emulated: Array) -> Array:
    """Variance of the difference between measurement and emulator.

    Of one or two repetitions the scatter from run to run is not known; the twin's from seed to seed takes its place.
    """
    scatter = emulator.noise**2 / target.repetitions if target.repetitions <= 2 else 0.0
    return np.asarray(target.shared * (target.std_uncertainty**2 + scatter) + emulated**2)


def log_posterior(
    unit: Array, parameters: Sequence[Parameter], targets: Sequence[Target], emulators: Sequence[Emulator]
) -> Array:
    """Logarithm of the posterior density at points of the unit cube, shape (n, p)."""
    inside = ((unit >= 0) & (unit <= 1)).all(axis=1)
    total = np.full(len(unit), -math.inf)
    if not inside.any():
        return total
    within = unit[inside]
    found = sum((one.log_prior(within[:, k]) for k, one in enumerate(parameters)), np.zeros(len(within)))
    for target, emulator in zip(targets, emulators, strict=True):
        mean, emulated = emulator.predict(within)
        spread = variance(target, emulator, emulated)
        found -= 0.5 * ((target.value - mean) ** 2 / spread + np.log(spread))
    total[inside] = found
    return total


def sample(
    parameters: Sequence[Parameter], targets: Sequence[Target], emulators: Sequence[Emulator], *, seed: int
) -> tuple[Array, Array]:
    """Samples of the posterior in the unit cube, shape (n, p), and their log density (emcee, Goodman & Weare 2010)."""
    import emcee

    random = np.random.default_rng(seed)
    start = random.random((40 * WALKERS, len(parameters)))
    density = log_posterior(start, parameters, targets, emulators)
    chosen = start[np.argsort(-density)[: 4 * WALKERS]]
    falloff = 0.25 * (np.sort(density)[::-1][: 4 * WALKERS] - density.max())  # spread over all good places
    weights = np.exp(np.maximum(falloff, -500.0))  # none is zero, so that all walkers find a start
    first = chosen[random.choice(len(chosen), WALKERS, replace=False, p=weights / weights.sum())]
    sampler = emcee.EnsembleSampler(
        WALKERS, len(parameters), log_posterior, args=(parameters, targets, emulators), vectorize=True
    )
    # emcee's own wrapper prints arguments and traceback of every exception, Ctrl-C included, partly on stdout
    sampler.log_prob_fn = lambda places: log_posterior(places, parameters, targets, emulators)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(first, STEPS, skip_initial_state_check=True)
    return sampler.get_chain(discard=BURNT, thin=5, flat=True), sampler.get_log_prob(discard=BURNT, thin=5, flat=True)
