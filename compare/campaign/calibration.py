"""What a calibration found: posterior, best set, predictions, and what they say in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.compare.campaign import emulator as emulators
from rigtwin.compare.campaign.posterior import CONVERGED, Parameter, Target
from rigtwin.compare.campaign.search import Search, State
from rigtwin.compare.campaign.vary import OF_PARTICLE, of_contact
from rigtwin.lab.arrays import Array
from rigtwin.lab.file.lab_file import Experiment, Lab
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.formatting import counted, reading
from rigtwin.lab.materials import PARAMETERS

# thresholds of verdicts in words; they change no interval
TIED = 0.8  # correlation from which two parameters are named as ambiguous
WIDE = 0.2  # standard deviation over the range from which a parameter is not determined; a uniform one has 0.29
WEAK = 0.02  # share of the variance of a quantity below which a parameter has no visible influence on it
MISFIT = 0.01  # probability of the misfit below which no set fits
END = 0.02  # share of the range of a parameter from its ends within which a best value lies at the end
FURTHEST = 3  # deviations named where no set fits


@dataclass(frozen=True)
class Calibration:
    """The posterior and what follows from it."""

    lab: Lab
    parameters: tuple[Parameter, ...]
    targets: tuple[Target, ...]
    samples: Array  # shape (n, p), in SI
    best: Mapping[str, float]  # the sample of highest density
    model: Model  # with the best set
    sensitivities: Array  # shape (targets, p), share of the variance that each parameter causes alone
    predictions: tuple[dict[str, Any], ...]
    runs: int
    stopped: str
    misfit: tuple[float, float]  # chi-square of the best set, and its probability
    remarks: tuple[str, ...] = ()
    next_experiments: tuple[dict[str, Any], ...] = ()  # that would separate sets that fit, the best first
    files: dict[str, Path] = field(default_factory=dict)

    def __repr__(self) -> str:
        found = [f"{name} = {reading(one['median'], one['std'], '1')}" for name, one in self.intervals.items()]
        return "\n  ".join([f"<Calibration of {self.lab.title!r}, {counted(self.runs, 'run')}; SI units", *found]) + ">"

    @property
    def fits(self) -> bool:
        """Whether the best set agrees with the measurements."""
        return self.misfit[1] >= MISFIT

    @property
    def tested(self) -> bool:
        """Whether there are more measurements than parameters, so that the fit says something of the model."""
        return len(self.targets) > sum(one.mean is None for one in self.parameters)

    @property
    def no_fit(self) -> str:
        """Sentence for a calibration that no set fits: what that may mean, and what is furthest off."""
        square, probability = self.misfit
        known = sum(one.mean is not None for one in self.parameters)
        beside = f" and {counted(known, 'value')} known beforehand" if known else ""
        furthest = f"; furthest off: {'; '.join(self._furthest)}" if self._furthest else ""
        return (
            f"no set within the ranges fits (chi-square {square:.1f} of {counted(len(self.targets), 'measured number')}"
            f"{beside}, probability {probability:.2g}): a range may be too narrow, an effect missing from the "
            f"model, or a stated setting or a measurement wrong{furthest}"
        )

    @property
    def pulls(self) -> dict[str, float]:
        """By how many of its standard uncertainties the best set moves each parameter that has a prior."""
        return {
            one.name: (self.best[one.name] - one.mean) / one.std
            for one in self.parameters
            if one.mean is not None and one.std is not None
        }

    @property
    def _furthest(self) -> list[str]:
        """The measured numbers and known parameters that are most standard uncertainties off, the furthest first."""
        off = [(abs(pull), f"{name} from its value known beforehand") for name, pull in self.pulls.items()]
        off += [
            (abs(row["z"]), f"{row['quantity']} of {row['experiment']}")
            for row in self.predictions
            if row["z"] is not None and not row["held_out"]
        ]
        return [f"{what} ({size:.1f} standard deviations)" for size, what in sorted(off, reverse=True)[:FURTHEST]]

    @property
    def intervals(self) -> dict[str, dict[str, float]]:
        """Median, standard deviation and 95 % credible interval of each parameter."""
        found = {}
        for one, values in zip(self.parameters, self.samples.T, strict=True):
            low, median, high = np.quantile(values, (0.025, 0.5, 0.975))
            found[one.name] = {"median": median, "std": float(np.std(values)), "low": low, "high": high}
        return found

    @property
    def correlations(self) -> dict[str, float]:
        """Correlation of each pair of parameters, of their logarithms where the prior of those is uniform."""
        names = [one.name for one in self.parameters]
        if len(names) < 2:
            return {}
        matrix = np.atleast_2d(np.corrcoef(np.array(self._scaled)))
        pairs = [(i, j) for i in range(len(names)) for j in range(i)]
        return {f"{names[j]} / {names[i]}": float(matrix[i, j]) for i, j in pairs}

    @property
    def ambiguous(self) -> list[str]:
        """Sentences on parameters that these experiments do not separate or do not determine."""
        said = [
            f"{names}: these experiments do not separate them (correlation {value:.2f}); a family of sets fits alike"
            for names, value in self.correlations.items()
            if abs(value) > TIED
        ]
        for k, (one, scaled) in enumerate(zip(self.parameters, self._scaled, strict=True)):
            if one.mean is None and np.std(scaled) > WIDE:
                width = 100 * float(np.std(scaled))
                why = (
                    f"its posterior has a standard deviation of {width:.0f} % of its range (29 % if nothing is learned)"
                )
                if (self.sensitivities[:, k] < WEAK).all():
                    why = f"alone it causes less than {100 * WEAK:g} % of the variance of each measured quantity"
                said.append(f"{one.name} is not determined: {why}")
        return said

    @property
    def _scaled(self) -> list[Array]:
        """The samples of each parameter in the unit interval."""
        return [one.unit(values) for one, values in zip(self.parameters, self.samples.T, strict=True)]

    def to_json(self) -> dict[str, Any]:
        """Content of ``calibration.json``."""
        return {
            "lab": str(self.lab.path),
            "fits": self.fits,
            "tested": self.tested,
            "chi_square": self.misfit[0],
            "probability": self.misfit[1],
            "best": dict(self.best),
            "intervals": self.intervals,
            "priors": {
                one.name: {
                    "low": one.low, "high": one.high, "mean": one.mean, "std": one.std, "source": one.source,
                    "pull": self.pulls.get(one.name),
                }
                for one in self.parameters
            },
            "correlations": self.correlations,
            "ambiguous": self.ambiguous,
            "next_experiments": list(self.next_experiments),
            "sensitivities": [
                {
                    "experiment": target.experiment, "quantity": target.quantity, "method": target.method,
                    **dict(zip((one.name for one in self.parameters), row.tolist(), strict=True)),
                }
                for target, row in zip(self.targets, self.sensitivities, strict=True)
            ],
            "predictions": list(self.predictions),
            "borrowed": list(self.lab.borrowed),
            "runs": self.runs,
            "stopped": self.stopped,
            "remarks": list(self.remarks),
            "files": {name: str(path) for name, path in self.files.items()},
        }  # fmt: skip


def calibration_of(search: Search, found: State, predictions: tuple[dict[str, Any], ...]) -> Calibration:
    """Return the result of a search that has ended.

    Parameters
    ----------
    search : Search
        Search that has ended.
    found : State
        What it found.
    predictions : tuple of dict
        Rows of `Search.predictions`.

    Returns
    -------
    Calibration
        The result, without candidates of a further experiment and files.
    """
    from scipy.stats import chi2

    parameters, posterior = search.parameters, found.fitted
    samples = np.column_stack([one.value(found.samples[:, k]) for k, one in enumerate(parameters)])
    best = search.values(found.best)
    square = float(posterior.chi_square(found.best[None, :])[0])
    free = max(len(posterior.targets) - sum(one.mean is None for one in parameters), 1)
    shares = [emulators.main_effects(one, len(parameters), seed=search.seed) for one in posterior.emulators]
    return Calibration(
        search.lab, parameters, tuple(posterior.targets), samples, best, _best_model(search, best), np.array(shares),
        predictions, found.runs, found.stopped, (square, float(chi2.sf(square, free))),
        (*at_range_limit(parameters, best, samples), *_remarks(search, found, best)),
    )  # fmt: skip


def _best_model(search: Search, best: Mapping[str, float]) -> Model:
    """The model of the lab with the best set."""
    model = search.lab.model
    for experiment in search.fitted:
        moved = search.setting(experiment, best, model)
        model = moved.model
        if OF_PARTICLE.keys() & best.keys() and moved.experiment.particle.shape is None:
            particle = moved.experiment.particle
            model = replace(
                model,
                particles={**model.particles, particle.name: particle},
                materials={**model.materials, particle.material.name: particle.material},
            )
    return model


def _at_best(search: Search, best: Mapping[str, float]) -> Experiment:
    """The first fitted experiment with the best set."""
    return search.setting(search.fitted[0], best).experiment


def at_range_limit(parameters: Sequence[Parameter], best: Mapping[str, float], samples: Array) -> list[str]:
    """Return a sentence for each parameter that is determined and whose best value lies at an end of its range.

    Parameters
    ----------
    parameters : sequence of Parameter
        The parameters with their ranges.
    best : mapping of str to float
        The best set, in SI.
    samples : ndarray
        Samples of the posterior, shape (n, p), in SI.

    Returns
    -------
    list of str
        The sentences.
    """
    said = []
    for one, values in zip(parameters, samples.T, strict=True):
        share = float(one.unit(np.array([best[one.name]]))[0])
        end = "lower" if share <= END else "upper" if share >= 1 - END else ""
        physical = one.low == 0 if end == "lower" else "restitution" in one.name and one.high == 1
        if end and not physical and np.std(one.unit(values)) <= WIDE:
            said.append(
                f"{one.name}: the best value, {best[one.name]:.4g}, lies at the {end} end of its range, {one.low:.4g} "
                f"to {one.high:.4g} (SI); values beyond it may fit better"
            )
    return said


def _remarks(search: Search, found: State, best: Mapping[str, float]) -> Iterator[str]:
    for name, value in best.items():
        if "." not in name and of_contact(name) not in PARAMETERS:
            particle = _at_best(search, best).particle
            what = f"{name} = {value:.5g} (SI) of the rig"
            if name in OF_PARTICLE:
                what = f"{name} = {value:.5g} (SI) of the particle"
            if name == "scale":
                density = particle.effective_density
                what = f"diameter = {1e3 * particle.diameter:.5g} mm, density = {density:.5g} kg/m^3 of the particle"
            yield f"`compare --model` takes contacts and effects from model.toml; state {what} in lab.toml"
    if found.failures:
        yield f"{len(found.failures)} twins failed, the first: {next(iter(found.failures.values()))}"
    for target, why in found.missing.items():
        fate = " was not fitted" if target in found.left_out else ""
        yield f"{target.experiment}, {target.quantity} ({target.method}){fate}: {why}"
    if not found.converged:
        yield (
            f"the samples of the posterior span less than {CONVERGED} autocorrelation times; intervals are approximate"
        )
