"""What the twins of one condition say: its numbers as a quadratic function of the coordinate of each axis.

All runs of a condition are fitted together, axis by axis additive, so that each run adds to what is known of the stated
setting.  The scatter of the runs about the fit is that of the twin from seed to seed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.compare.campaign.posterior import Target, scatter
from rigtwin.compare.campaign.run import Result
from rigtwin.compare.diagnose.bulk.axes import Axis, acts
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkCondition
from rigtwin.compare.diagnose.bulk.observables import (
    Features,
    Seen,
    features_of,
    of_record,
    of_twin,
    turns_the_other_way,
)
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# two codes with the same contact law differ by this much (`make bench-decks`, means of two runs, half of it scatter)
AGREE = 0.008  # relative, of outlines, times and numbers of particles
AGREE_SHAPE = 0.004  # relative, of the components of a curve
AGREE_BED = 0.006  # relative, of the height of a bed
AGREE_MASS = 0.002  # relative; nothing but counting and weighing
DISTORTED = (
    -1.0,
    -0.7,
    -0.4,
    -0.2,
    0.2,
    0.4,
    0.7,
    1.0,
)  # coordinates at which an error of the measurement is worked out
LEVERAGE = 0.2  # one less the leverage of a run; below, its residual is mostly taken up by the fit itself
WINDOW = 0.45  # coordinates about a second look within which runs are used: holds the three of `twin_design.AGAIN`
LEVELS = 3  # different coordinates that are left there, else all are used
CUT_AT = 4.0  # standard deviations at which a residual is cut before correlations are taken: 1 in 16,000 lies beyond
NEARBY = 0.3  # coordinate above which the misfit of an axis's quadratic counts in full: the first level of most axes
OFTEN = 0.8  # share of the twins that give a number, below which it depends on the effect whether there is one
FEWEST = 6  # twins of a condition, as many as are run of the stated setting


@dataclass(frozen=True)
class Twinned:
    """One run of a condition: coordinates of the axes that differ from 0, and its result."""

    point: Mapping[Axis, float]
    result: Result


@dataclass(frozen=True)
class Response:
    """Measured numbers of a condition and the twin's, as a function of the coordinates of all axes.

    Parameters
    ----------
    features : Features
        Their names and units.
    measured : ndarray, shape (k,)
        Mean over the repetitions.
    constant : ndarray, shape (k,)
        The twin at the stated setting.
    linear, quadratic : ndarray, shape (axes, k)
        Coefficients of the coordinates and their squares.
    mean : ndarray, shape (k, k)
        Covariance of the mean over the repetitions.
    run : ndarray, shape (k, k)
        Covariance of a twin from seed to seed.
    inverse : ndarray, shape (p, p)
        Of the normal matrix of the fit, for columns 1, then u and u^2 of each axis with twins.
    columns : tuple of int
        Numbers of the axes with twins.
    bent : ndarray, shape (axes, k)
        Variance by which the twins along an axis miss its quadratic, beyond their scatter.
    agree : ndarray, shape (k,)
        Standard uncertainty of the twin beside its scatter.
    worked_out : mapping of int to CubicSpline
        Change of the numbers with the coordinate of an axis without twins, by the number of the axis.
    """

    features: Features
    measured: Array
    constant: Array
    linear: Array
    quadratic: Array
    mean: Array
    run: Array
    inverse: Array
    columns: tuple[int, ...]
    bent: Array
    agree: Array
    worked_out: Mapping[int, CubicSpline]

    def depends_on(self, axis: int) -> bool:
        """Whether any number depends on the axis of this number."""
        known = self.worked_out.get(axis)
        return bool(self.linear[axis].any() or self.quadratic[axis].any() or (known is not None and known(1.0).any()))

    @property
    def names(self) -> tuple[str, ...]:
        return self.features.names

    def predicted(self, u: Array) -> Array:
        """The numbers at coordinates, shape (axes,)."""
        found = self.constant + u @ self.linear + u**2 @ self.quadratic
        return np.asarray(found + sum(curve(u[k]) for k, curve in self.worked_out.items()))

    def slopes(self, u: Array) -> Array:
        """Derivatives of the numbers by the coordinates, shape (k, axes)."""
        found = (self.linear + 2 * u[:, None] * self.quadratic).T
        for k, curve in self.worked_out.items():
            found[:, k] += curve(u[k], 1)
        return np.asarray(found)

    def covariance(self, u: Array) -> Array:
        """Of the difference of measurement and twin at coordinates."""
        row = _row(u[list(self.columns)])
        bent = np.minimum(np.abs(u) / NEARBY, 1.0) ** 2 @ self.bent
        return np.asarray(self.mean + float(row @ self.inverse @ row) * self.run + np.diag(self.agree**2 + bent))

    @cached_property
    def floor(self) -> Array:
        """Covariance of the difference at the stated setting."""
        return self.covariance(np.zeros(len(self.linear)))


def _row(coordinates: Array) -> Array:
    return np.concatenate([[1.0], np.column_stack([coordinates, coordinates**2]).ravel()])


def response_of(
    condition: BulkCondition, axes: Sequence[Axis], runs: Sequence[Twinned], near: Mapping[Axis, float] | None = None
) -> Response:
    """Fit the runs of a condition.

    Along axes that were looked at again, at coordinates `near`, runs further off than `WINDOW` are not used, so that
    the quadratic holds where it is needed.  Raises `BadInput` where the runs give nothing that was measured.
    """
    runs = _in_window(runs, near or {})
    mirrored = turns_the_other_way(condition)
    looks = [of_record(condition, record, mirrored) for record in condition.records]
    views = [of_twin(condition, run.result) for run in runs]
    features = features_of(condition, looks, [view for each in views for view in each])
    ours = [np.array([features.of(view) for view in each]) for each in views]
    means = np.array([each.mean(axis=0) for each in ours])
    lab = np.array([features.of(look) for look in looks])
    known = (np.isfinite(means).mean(axis=0) >= OFTEN) & np.isfinite(lab).any(axis=0)
    if not known.any():
        raise BadInput(f"{condition.name}: its twins give nothing that was measured there.")
    whole = np.isfinite(means[:, known]).all(axis=1)
    if whole.sum() < FEWEST:
        raise BadInput(f"{condition.name}: only {whole.sum()} twins give a result; at least {FEWEST} are needed.")
    kept = [k for k, one in enumerate(whole) if one]
    return _fitted(condition, axes, features, [runs[k] for k in kept], [ours[k] for k in kept], lab, known)


def _in_window(runs: Sequence[Twinned], near: Mapping[Axis, float]) -> list[Twinned]:
    kept = list(runs)
    for axis, place in near.items():
        inside = [run for run in kept if not run.point.get(axis) or abs(run.point[axis] - place) <= WINDOW]
        if len({round(run.point[axis], 6) for run in inside if run.point.get(axis)}) >= LEVELS:
            kept = inside
    return kept


def _fitted(
    condition: BulkCondition, axes: Sequence[Axis], features: Features, runs: Sequence[Twinned],
    views: Sequence[Array], lab: Array, known: Array,
) -> Response:  # fmt: skip
    columns = tuple(k for k, axis in enumerate(axes) if any(run.point.get(axis) for run in runs))
    coordinates = np.array([[run.point.get(axis, 0.0) for axis in axes] for run in runs])
    design = np.array([_row(row[list(columns)]) for row in coordinates])
    values = np.array([each.mean(axis=0) for each in views])[:, known]
    inverse = np.linalg.pinv(design.T @ design, rcond=1e-9)
    coefficients = inverse @ design.T @ values
    fitted = design @ coefficients
    free = 1 - np.einsum("ij,jk,ik->i", design, inverse, design)
    run = _covariance(values - fitted, free)
    looks = np.concatenate([each[:, known] - row for each, row in zip(views, fitted, strict=True)])
    single = _covariance(looks, np.repeat(free, [len(each) for each in views]))
    bent = np.zeros((len(axes), known.sum()))
    for k in columns:
        bent[k] = _bent(coordinates[:, k], values - fitted, run)
    linear, quadratic = np.zeros((len(axes), known.sum())), np.zeros((len(axes), known.sum()))
    for place, k in enumerate(columns):
        linear[k], quadratic[k] = coefficients[1 + 2 * place], coefficients[2 + 2 * place]
    worked_out = {
        k: _worked_out(condition, axis, features, runs, known)
        for k, axis in enumerate(axes)
        if acts(axis, condition) and (axis.distortion or axis.mass)
    }
    names = [name for name, one in zip(features.names, known, strict=True) if one]
    sizes = features.sizes[known]
    return Response(
        _kept(features, known), np.nanmean(lab[:, known], axis=0), coefficients[0], linear, quadratic,
        _of_the_mean(lab[:, known], single), run, inverse, columns, bent,
        np.array([_agree(name) * size for name, size in zip(names, sizes, strict=True)]), worked_out,
    )  # fmt: skip


def _agree(name: str) -> float:
    usual = AGREE_SHAPE if name.startswith("component") else AGREE
    return AGREE_MASS if name == "total_mass" else AGREE_BED if name.startswith("bed_height") else usual


def _kept(features: Features, known: Array) -> Features:
    curve = known[: len(features.vectors)]
    return replace(
        features,
        names=tuple(name for name, one in zip(features.names, known, strict=True) if one),
        units=tuple(unit for unit, one in zip(features.units, known, strict=True) if one),
        sizes=features.sizes[known],
        vectors=features.vectors[curve],
    )


def _covariance(residuals: Array, free: Array) -> Array:
    """Covariance of residuals, its correlations shrunk (Ledoit & Wolf 2004); `free` is one less each run's leverage.

    Its scale is that of the median: a coordinate that no quadratic describes counts where it is (`_bent`).
    """
    from scipy.stats import median_abs_deviation
    from sklearn.covariance import LedoitWolf

    judged = free > LEVERAGE
    residuals = residuals[judged] / np.sqrt(free[judged])[:, None]
    spread = np.asarray(median_abs_deviation(residuals, scale="normal", axis=0))
    varied = spread > 0
    found = np.diag(spread**2)
    if varied.sum() > 1:
        scaled = np.clip(residuals[:, varied] / spread[varied], -CUT_AT, CUT_AT)
        shrunk = LedoitWolf(assume_centered=True).fit(scaled).covariance_
        deviation = np.sqrt(np.diag(shrunk))
        found[np.ix_(varied, varied)] = shrunk / np.outer(deviation, deviation) * np.outer(*(spread[varied],) * 2)
    return found


def _bent(coordinate: Array, residuals: Array, run: Array) -> Array:
    """Variance by which the runs along an axis miss its quadratic beyond their scatter, shape (k,)."""
    there = residuals[coordinate != 0]
    return np.asarray(np.maximum(np.mean(there**2, axis=0) - np.diag(run), 0.0))


def _of_the_mean(lab: Array, single: Array) -> Array:
    """Covariance of the mean over repetitions; the scatter of few is pooled with that of the twin."""
    twin = np.sqrt(np.diag(single))
    there = np.isfinite(lab).sum(axis=0)
    own = np.array([np.nanstd(row, ddof=1) if n > 1 else 0.0 for row, n in zip(lab.T, there, strict=True)])
    stds = np.array([
        scatter(Target("", "", "", "", 0.0, s / math.sqrt(n), int(n)), t)
        for s, n, t in zip(own, there, twin, strict=True)
    ])  # fmt: skip
    scaled = np.divide(stds, twin, out=np.ones_like(stds), where=twin > 0)
    found = single * np.outer(scaled, scaled)
    np.fill_diagonal(found, stds**2)
    return found


def _worked_out(
    condition: BulkCondition, axis: Axis, features: Features, runs: Sequence[Twinned], known: Array
) -> CubicSpline:
    """Change of the numbers along an axis without twins: an error of the measurement, or of the mass alone."""
    from scipy.interpolate import CubicSpline

    stated = [run.result for run in runs if not any(run.point.values())] or [runs[0].result]
    levels = [one for one in DISTORTED if axis.symmetric or one > 0]
    before = _looked(features, [look for result in stated for look in of_twin(condition, result)])
    changes = []
    for level in levels:
        value = axis.value(level)
        if axis.distortion is not None:
            distortion = axis.distortion(value)
            if turns_the_other_way(condition):  # the record is mirrored, which reverses the roll of the camera
                distortion = replace(distortion, roll=-distortion.roll)
            seen = [look for result in stated for look in of_twin(condition, result, distortion)]
            changes.append(np.nan_to_num(_looked(features, seen) - before))
        else:
            assert axis.mass is not None
            weighs = np.array([name == "total_mass" for name in features.names], dtype=float)
            changes.append(weighs * np.nan_to_num(before) * (axis.mass(value) - 1))
    order = np.argsort([*levels, 0.0])
    return CubicSpline(np.array([*levels, 0.0])[order], np.array([*changes, 0 * before])[order][:, known])


def _looked(features: Features, seen: Sequence[Seen]) -> Array:
    return np.asarray(np.mean([features.of(one) for one in seen], axis=0))
