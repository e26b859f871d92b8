"""Locate where model and measurement disagree: mean residuals by region, with Holm's correction.

Events (release, impacts, turning points) divide the rows into regions.  In each region of each condition the mean
residual over repetitions is divided by its standard error.  The error follows from the tracking noise, and is widened
where the repetitions scatter more (correlated tracking errors, pixel locking).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.compare.diagnose.fitting.normal_equations import Regioned
from rigtwin.lab.arrays import Array

AXES = ("x", "y")
LEVEL = 0.02  # probability that any region is called significant where nothing disagrees


@dataclass(frozen=True)
class Disagreement:
    """One region of one condition in which the mean residual is significant."""

    experiment: str
    record: str  # "x" or "y" of the track
    region: str
    z: float
    p_adjusted: float
    deviation: float  # [m], measured minus simulated


@dataclass(frozen=True)
class Location:
    """Result of the test of all regions."""

    found: tuple[Disagreement, ...]  # the significant ones, strongest first
    tested: int
    statistic: float
    """S: mean of z^2 over all regions; about 1 or less without a disagreement."""
    p: float  # 1 where nothing could be tested
    spread: float
    """Variance of region means between repetitions over that expected of white noise, at least 1."""


def locate(bench: Regioned, fitted: Fit, level: float = LEVEL) -> Location:
    """Test every region of every condition at the family-wise significance `level`."""
    means, counts = _region_means(bench, fitted)
    spread = _spread(bench, means, counts)
    rows = []
    for c, name in enumerate(bench.condition_names):
        mine = np.flatnonzero(bench.condition == c)
        for g, region in enumerate(bench.region_names):
            for k in (0, 1):
                here = mine[counts[mine, g] >= 3]
                if len(here) < 2:
                    continue
                weight = counts[here, g]
                mean = float(np.sum(weight * means[here, g, k]) / np.sum(weight))
                z = mean * math.sqrt(float(np.sum(weight)) / spread)
                rows.append((name, AXES[k], region, z, mean * float(np.median(bench.sigma))))
    if not rows:
        return Location((), 0, 0.0, 1.0, spread)
    from scipy import special

    scores = np.array([row[3] for row in rows])
    adjusted = holm(np.asarray(2 * special.ndtr(-np.abs(scores))))
    found = [
        Disagreement(name, axis, region, float(value), float(q), mean)
        for (name, axis, region, value, mean), q in zip(rows, adjusted, strict=True)
        if q < level
    ]
    found.sort(key=lambda one: -abs(one.z))
    total = float(np.sum(scores**2))
    return Location(tuple(found), len(rows), total / len(rows), float(special.chdtrc(len(rows), total)), spread)


def holm(p: Array) -> Array:
    """p-values adjusted for the number of tests, shape (n,) (Holm 1979).

    >>> holm(np.array([0.01, 0.04, 0.03])).round(3).tolist()
    [0.03, 0.06, 0.06]
    """
    order = np.argsort(p)
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    return adjusted


def _region_means(bench: Regioned, fitted: Fit) -> tuple[Array, Array]:
    """Mean residual (R, regions, 2) and number of rows (R, regions) by repetition and region."""
    regions = len(bench.region_names)
    repetitions = len(bench.spans)
    sums, counts = np.zeros((repetitions, regions, 2)), np.zeros((repetitions, regions))
    owner = np.concatenate([np.full(span.stop - span.start, r) for r, span in enumerate(bench.spans)])
    inside = bench.region >= 0
    np.add.at(counts, (owner[inside], bench.region[inside]), 1)
    np.add.at(sums, (owner[inside], bench.region[inside]), fitted.residual[inside])
    return sums / np.maximum(counts, 1)[..., None], counts


def _spread(bench: Regioned, means: Array, counts: Array) -> float:
    """Variance of region means between repetitions times the rows: 1 for white noise, more for correlated noise."""
    seen = counts >= 3  # (R, regions)
    mine = [np.flatnonzero(bench.condition == c) for c in range(len(bench.condition_names))]
    regions = [(rows[seen[rows, g]], g) for rows in mine for g in range(counts.shape[1])]
    # pairs of repetitions give a poor variance: they are used only if no condition has three
    repeated = [one for one in regions if len(one[0]) >= 3] or [one for one in regions if len(one[0]) == 2]
    if not repeated:
        return 1.0
    values = []
    for here, g in repeated:
        off = means[here, g] - means[here, g].mean(0)
        values.append(np.sum(off**2, axis=0) / (len(here) - 1) * float(np.mean(counts[here, g])))
    # capped, so that regions where the model fails differently in each repetition do not dominate
    return max(1.0, float(np.mean(np.minimum(np.concatenate(values), 25.0))))
