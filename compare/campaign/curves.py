"""Curves as targets of a calibration: profiles and discharge enter by a few principal components."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.campaign.posterior import Target
from rigtwin.compare.campaign.twin_runs import twin_from
from rigtwin.compare.twins.registry import entry_of

if TYPE_CHECKING:
    from rigtwin.compare.campaign.run import Result
    from rigtwin.compare.curve_overlays import Curve, Overlay
    from rigtwin.lab.arrays import Array
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement

OF_CURVE = " of the curve"
# chosen beforehand, not fitted to labs; the row that tests them together is the recovery of `make bench-calibrate`
COMPONENTS = 2  # of a curve
LEAST = 0.05  # share of the variance among twins that a component has at least
POINTS = 60  # of a curve
FEWEST = 6  # twins from which components are found


@dataclass(frozen=True)
class CurveTargets:
    """The components of the curves of an experiment.

    Attributes
    ----------
    experiment : Experiment
        Its twins give the curves.
    measured : sequence of Measurement
        Repetitions with the measured curves.
    components : mapping of str to tuple of ndarray
        For each curve the unit, the axis, shape (m,), the mean over twins, shape (m,), and unit vectors over the root
        of m, shape (c, m).
    """

    experiment: Experiment
    measured: Sequence[Measurement]
    components: Mapping[str, tuple[str, Array, Array, Array]]

    @property
    def targets(self) -> list[Target]:
        """Each component of the measured curves: mean over the repetitions."""
        found = []
        each = [self._scores([one], []) for one in self.measured]
        for what, (unit, *_) in self.components.items():
            rows = np.array([scores[what] for scores in each if what in scores])
            if len(rows) == 0 or not np.isfinite(rows).all():
                continue
            spread = rows.std(axis=0, ddof=1) / math.sqrt(len(rows)) if len(rows) > 1 else np.zeros(rows.shape[1])
            found += [
                Target(
                    self.experiment.id, what, _method(k), unit, float(np.mean(rows[:, k])), float(spread[k]), len(rows)
                )
                for k in range(rows.shape[1])
            ]
        return found

    def values(self, result: Result) -> dict[tuple[str, str], float]:
        """Return the components of a twin's curves.

        Parameters
        ----------
        result : Result
            Result of the run of the twin.

        Returns
        -------
        dict of tuple to float
            By quantity and method of their target, in the unit of the curve.
        """
        scores = self._scores([], [twin_from(result)])
        return {(what, _method(k)): float(value) for what, row in scores.items() for k, value in enumerate(row)}

    def _scores(self, measured: Sequence[Any], twins: Sequence[Any]) -> dict[str, Array]:
        found = {}
        for shape in _overlays(self.experiment, measured, twins):
            curves = shape.measured or shape.simulated
            if shape.what in self.components and curves:
                _, x, mean, vectors = self.components[shape.what]
                found[shape.what] = vectors @ (_mean(curves, x) - mean)
        return found


def curve_targets(experiment: Experiment, measured: Sequence[Measurement], results: Sequence[Result]) -> CurveTargets:
    """Find the principal components of the curves of twins that a measurement has, too.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose curves are compared.
    measured : sequence of Measurement
        Measured repetitions of the experiment.
    results : sequence of Result
        Results of its twins.

    Returns
    -------
    CurveTargets
        The components, found by `sklearn.decomposition.PCA`.  Scores are root mean squares along the curve, in the unit
        of the curve.
    """
    from sklearn.decomposition import PCA

    if not measured:
        return CurveTargets(experiment, measured, {})
    twins = [twin_from(result) for result in results]
    components = {}
    for shape in _overlays(experiment, measured, twins):
        if not (shape.measured and shape.simulated and shape.meet):
            continue
        x = np.linspace(*shape.span, POINTS)
        own = [_overlay(experiment, [one], shape.what) for one in twins]
        rows = np.array([_mean(one.simulated, x) for one in own if one is not None and one.simulated])
        if len(rows) < FEWEST or not np.isfinite(rows).all() or not np.ptp(rows, axis=0).any():
            continue
        found = PCA(COMPONENTS).fit(rows)
        kept = found.components_[found.explained_variance_ratio_ > LEAST]
        components[shape.what] = (shape.unit, x, found.mean_, kept / math.sqrt(POINTS))
    return CurveTargets(experiment, measured, components)


def _method(k: int) -> str:
    return f"component {k + 1}{OF_CURVE}"


def is_component(method: str) -> bool:
    """Return whether a method is that of a component of a curve, whose number means nothing by itself.

    Parameters
    ----------
    method : str
        Method of a quantity.

    Returns
    -------
    bool
        True where it is.
    """
    return method.endswith(OF_CURVE)


def _overlays(experiment: Experiment, measured: Sequence[Any], twins: Sequence[Any]) -> list[Overlay]:
    return list(entry_of(experiment).curves(experiment, measured, twins))


def _overlay(experiment: Experiment, twins: Sequence[Any], what: str) -> Overlay | None:
    return next((one for one in _overlays(experiment, [], twins) if one.what == what), None)


def _mean(curves: Sequence[Curve], x: Array) -> Array:
    """Mean over views; beyond its ends a curve keeps its last value."""
    rows = []
    for curve in curves:
        known = np.isfinite(curve.y) & np.isfinite(curve.x)
        order = np.argsort(curve.x[known], kind="stable")
        rows.append(np.interp(x, curve.x[known][order], curve.y[known][order]) if known.any() else np.nan * x)
    return np.asarray(np.mean(rows, axis=0))
