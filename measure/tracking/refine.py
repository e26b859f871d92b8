"""Fit a bead in a frame with known background; the centre is accurate to a few hundredths of a pixel.

`locate` fits a model of a shaded, motion-blurred disc to the pixels around a guess. `rigtwin.measure.tracking.follow`
uses it to follow a bead through a clip. Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Mask
from rigtwin.measure.robust import MAD_TO_STD, correlation_excess, middle_of
from rigtwin.measure.tracking.bead_image import LEAST_SIGMA, LIGHTS, SHAPES, BeadFit, BeadImage, Look, Shading
from rigtwin.measure.tracking.disc_model import Pixels, Prior
from rigtwin.measure.tracking.patch import Patch, cut_patch, start_from_moments, surroundings


def locate(
    grey: npt.NDArray[np.generic],
    background: npt.NDArray[np.generic] | None,
    near: tuple[float, float],
    radius: float,
    blur_guess: tuple[float, float] = (0.0, 0.0),
) -> BeadImage | None:
    """Locate a disc near a guess with sub-pixel precision.

    Parameters
    ----------
    grey : array, shape (height, width)
        The frame [grey levels].
    background : array, shape (height, width), or None
        The same picture without the bead [grey levels]; None: a plane is fitted around the bead.
    near : tuple of float
        Expected centre x, y [px].
    radius : float
        Expected radius [px].
    blur_guess : tuple of float, optional
        Expected motion x, y during the exposure [px]; (0, 0): unknown.

    Returns
    -------
    BeadImage or None
        Centre, standard uncertainty, radius and motion blur [px], contrast [grey levels]; None if no disc is found.

    See Also
    --------
    fit_bead : the fit itself, with more prior knowledge and results.

    Examples
    --------
    >>> y, x = np.mgrid[:60, :60]
    >>> grey = 20 + 100 * np.clip(10.5 - np.hypot(x - 30.3, y - 28.6), 0, 1)
    >>> bead = locate(grey, np.full((60, 60), 20.0), near=(31, 29), radius=10)
    >>> round(bead.x, 1), round(bead.y, 1), round(bead.radius, 1)
    (30.3, 28.6, 10.0)
    """
    fit = fit_bead(grey, background, near, radius, blur_guess=blur_guess)
    return None if fit is None else fit.image


def fit_bead(
    grey: npt.NDArray[np.generic],
    background: npt.NDArray[np.generic] | None,
    near: tuple[float, float],
    radius: float,
    *,
    blur_guess: tuple[float, float] = (0.0, 0.0),
    hidden: Mask | None = None,
    look: Look | None = None,
    surely_near: bool = False,
    room: float | None = None,
    onwards: tuple[float, float] | None = None,
    blur_uncertainty: float | None = 0.0,
) -> BeadFit | None:
    """Fit the image of a bead near a guess.

    Parameters
    ----------
    grey : array, shape (height, width)
        The frame [grey levels].
    background : array, shape (height, width), or None
        The same picture without the bead [grey levels]; None: a plane is fitted around the bead.
    near : tuple of float
        Expected centre x, y [px].
    radius : float
        Expected radius [px].
    blur_guess : tuple of float, optional
        Expected motion x, y during the exposure [px]; (0, 0): unknown.
    hidden : array of bool, shape (height, width), optional
        Pixels with an object in front of the bead; they are not used.
    look : Look, optional
        Known radius, edge and light of the bead, used as a prior.
    surely_near : bool, optional
        Start at `near` itself if `look` is given, so that other moving objects close by (e.g. a shadow) cannot mislead
        the fit. Otherwise it starts from the moments of the difference image.
    room : float, optional
        Margin for the motion blur [px]; default: half of `blur_guess`.
    onwards : tuple of float, optional
        Extrapolated centre x, y [px], another candidate for the start if `look` is given.
    blur_uncertainty : float or None, optional
        Standard uncertainty of `blur_guess` [px], added to the minimum uncertainty of a guess; None: the guess is
        exact. Used only if `look` is given.

    Returns
    -------
    BeadFit or None
        Centre and radius [px], look, misfit [grey levels] and information matrix; None if no bead is found.

    Notes
    -----
    The bead is a disc of radius r with a soft edge, lit like a sphere (constant, two slopes and a bulge). It is
    averaged over its path during the exposure and hides the background B. The difference image is

    D = mean_k d_k (p_k - B)

    where d_k is the covered share of a pixel and p_k the brightness of the bead at step k of the exposure. All
    parameters are fitted together by Levenberg-Marquardt with robust (Geman-McClure) weights.
    """
    margin = 0.8 * radius + 5.0 if look is None else 0.5 * radius + 4.0
    along = (abs(blur_guess[0]) / 2, abs(blur_guess[1]) / 2) if room is None else (room, room)
    reach = (radius + margin + along[0], radius + margin + along[1])
    patch = cut_patch(grey, background, near, reach, radius, hidden)
    start = None if patch is None else _start(patch, blur_guess, look if surely_near else None)
    if patch is None or start is None:
        return None
    pixels = Pixels(patch)
    prior = _prior(pixels, start, look, patch, blur_uncertainty)
    if look is not None:
        places = [] if surely_near else [patch.near]
        prior = pixels.started_better(prior, places if onwards is None else [*places, patch.place(onwards)])
    fit = _fit_disc(pixels, prior, None if look is None else look.light)
    image = None if fit is None else _bead_image(patch, pixels, fit)
    if fit is None or image is None:
        return None
    shading = _shading(fit, patch, prior)
    return BeadFit(image, _look(fit, patch), fit.misfit, shading, fit.information, patch.step)


def common_look(fits: Sequence[BeadFit]) -> Look:
    """The common look of all fits: the mean weighted with the inverse covariance matrix of each fit."""
    table = np.array([np.concatenate([[fit.look.radius, fit.look.edge], fit.look.light]) for fit in fits])
    # a fit of another object is an outlier in several parameters: use only the inliers
    middle = np.median(table, axis=0)
    spread = MAD_TO_STD * np.median(np.abs(table - middle), axis=0) + 1e-6
    inner = np.flatnonzero(np.max(np.abs(table - middle) / spread, axis=1) < 4).tolist()
    inner = inner if len(inner) >= 3 else list(range(len(fits)))
    certainty = np.array([fits[k].certainty() for k in inner])
    total, pull = np.sum(certainty, axis=0), np.einsum("kij,kj->i", certainty, table[inner])
    mean = np.linalg.lstsq(total, pull, rcond=1e-10)[0]
    return Look(float(mean[0]), float(mean[1]), np.asarray(mean[2:]))


@dataclass(frozen=True)
class _Fit:
    parameters: Array
    covariance: Array  # from the pixels and the prior
    information: Array  # Fisher information of the pixels alone
    noise: float  # [grey levels], robust residual scatter
    misfit: float  # [grey levels], mean absolute residual


_EXACT = 0.02  # [px], prior standard deviation of a known blur

_SETTLED = 0.1  # gain of the cost below which the iteration stops; a gain of 1 is one standard deviation

_BEYOND = 1.3  # over-relaxation: the weights follow the residuals only in the next iteration, so each step is too short

_HOPELESS = 8  # iterations within which a bead up to a diameter away is reached


def _start(patch: Patch, blur_guess: tuple[float, float], look: Look | None) -> Array | None:
    """Start values x, y, blur x, blur y [patch px] and contrast [grey levels]; None: no bead."""
    if look is None:
        return start_from_moments(patch, blur_guess)
    behind = 0.0 if patch.behind is None else float(np.median(patch.behind))
    contrast = math.hypot(float(look.light[0]) - behind, 0.5 * math.hypot(*look.light[1:]))
    return np.array([*patch.near, *(np.array(blur_guess) / patch.step), max(contrast, 1.0)])


def _prior(pixels: Pixels, start: Array, look: Look | None, patch: Patch, blur_uncertainty: float | None) -> Prior:
    """Prior: wide for an unknown bead, narrow if its look is known.

    The width matters only if the pixels contain little information, e.g. radius and blur of a blurred bead are not
    separable.
    """
    x, y, blur_x, blur_y, contrast = start
    blur = math.hypot(blur_x, blur_y)
    scene = np.zeros(3 if patch.behind is None else 1)
    if look is None:
        shape = [x, y, patch.radius, 0.9, blur_x, blur_y]
        spread = [np.inf, np.inf, 0.15 * patch.radius, 0.5, 1 + 0.4 * blur, 1 + 0.4 * blur]
        light_spread = [np.inf, 0.4 * contrast, 0.4 * contrast, 0.4 * contrast]
        pixels.arrange(np.array(shape))
        mean = pixels.solve_light(np.array([*shape, *np.zeros(LIGHTS), *scene]), np.array(light_spread))
    else:
        shape = [x, y, look.radius / patch.step, max(look.edge / patch.step, 0.4), blur_x, blur_y]
        off = _EXACT if blur_uncertainty is None else math.hypot(0.3 + 0.1 * blur, blur_uncertainty / patch.step)
        spread = [np.inf, np.inf, 0.01 * patch.radius, 0.1, off, off]
        # the light changes slightly along the path (shadows, bright plate)
        light_spread = [0.15 * contrast, 0.05 * contrast, 0.05 * contrast, 0.05 * contrast]
        mean = np.array([*shape, *look.light, *scene])
    return Prior(mean, np.array([*spread, *light_spread, *np.full(len(scene), np.inf)]))


def _fit_disc(pixels: Pixels, prior: Prior, usual: Array | None) -> _Fit | None:
    """Levenberg-Marquardt on all parameters; weights and noise are updated in every iteration.

    None if no bead is found, or none with the known light `usual`, shape (4,).
    """
    parameters = prior.mean.copy()
    pixels.arrange(parameters[:SHAPES])
    jacobian, residual = pixels.linearise(parameters)
    damping = 1e-3
    beforehand = 1 / prior.spread**2
    steps = np.arange(len(beforehand))
    for turn in range(14):
        if pixels.arrange(parameters[:SHAPES]):
            jacobian, residual = pixels.linearise(parameters)
        if turn == _HOPELESS and usual is not None and not pixels.confirm(parameters, jacobian, residual, usual):
            return None
        variance = _variance(residual, jacobian[SHAPES])
        weights = _robust_weights(residual, variance)
        # correlated residuals contain less information on the shape: give the prior more weight instead
        certain = beforehand.copy()
        certain[2:SHAPES] *= correlation_excess(pixels.image(residual))
        information, pull = pixels.normal_equations(jacobian, residual, weights)
        pull += certain * (prior.mean - parameters)
        cost = _cost(residual, weights, parameters, prior.mean, certain)
        normal = information.copy()
        normal[steps, steps] += certain
        gained = 0.0
        for _ in range(6):
            damped = normal.copy()
            damped[steps, steps] += damping * normal[steps, steps] + 1e-12
            change = np.linalg.solve(damped, pull)
            if turn >= 2 and float(change @ (2 * pull - normal @ change)) < _SETTLED:
                parameters = _bounded(
                    parameters + change, parameters, prior
                )  # accept so small a step without evaluating the cost
                break
            tried = _bounded(parameters + (_BEYOND if turn >= 2 else 1.0) * change, parameters, prior)
            tried_jacobian, tried_residual = pixels.linearise(tried)
            tried_cost = _cost(tried_residual, weights, tried, prior.mean, certain)
            if tried_cost < cost:
                gained = cost - tried_cost
                parameters, jacobian, residual = tried, tried_jacobian, tried_residual
                damping = max(damping / 6, 1e-7)
                break
            damping *= 8
        if gained < _SETTLED and turn >= 2:
            break
    if not np.all(np.isfinite(parameters)):
        return None
    if usual is not None and not pixels.confirm(parameters, jacobian, residual, usual):
        return None
    excess = correlation_excess(pixels.image(residual))
    return _Fit(
        parameters,
        np.asarray(np.linalg.pinv(information / excess + np.diag(beforehand)), dtype=np.float64),
        information / excess,
        math.sqrt(float(np.min(variance))),
        float(np.mean(np.abs(residual))),
    )


def _cost(residual: Array, weights: Array, parameters: Array, mean: Array, certain: Array) -> float:
    off = parameters - mean
    return float(np.einsum("i,i", weights, residual * residual) + certain @ (off * off))


def _bounded(parameters: Array, before: Array, prior: Prior) -> Array:
    """Limit the step to the range of the linear model, and radius and edge to plausible values."""
    radius = float(prior.mean[2])
    for k in (0, 1):
        parameters[k] = min(max(parameters[k], before[k] - 0.5 * radius), before[k] + 0.5 * radius)
    parameters[2] = min(max(parameters[2], 0.5 * radius), 2.0 * radius)
    parameters[3] = min(max(parameters[3], 0.3), 3.0)
    return parameters


def _variance(residual: Array, cover: Array) -> Array:
    """Noise variance of every pixel [grey levels squared], shape (n,).

    Larger on the bead, where grain and gloss are not part of the model. `cover` is the covered share of the near
    pixels, which come first; it is zero for the others.
    """
    # dither: the median of integer grey levels would be an integer, too (a noise of 2.4 would count as 3)
    off = np.abs(residual + _between_levels(len(residual)))
    around = max(MAD_TO_STD * middle_of(off), 0.4)
    inside = off[: len(cover)][cover > 0.5]
    within = max(MAD_TO_STD * middle_of(inside), around) if len(inside) > 8 else around
    variance = np.full(len(residual), around**2)
    variance[: len(cover)] += cover * (within**2 - around**2)
    return variance


@functools.lru_cache(maxsize=8)
def _between_levels(count: int) -> Array:
    """Offsets in [-0.5, 0.5) grey levels, evenly distributed (golden-ratio sequence), shape (count,)."""
    return np.arange(count) * (math.sqrt(5) - 1) / 2 % 1 - 0.5


def _robust_weights(residual: Array, variance: Array) -> Array:
    """Geman-McClure weights: outlying pixels (unknown objects) have little weight.

    1 / (1 + (residual / 4 noise)^2)^2 / noise^2, in fewer operations.
    """
    broad = 16 * variance
    scaled = broad + residual * residual
    scaled *= scaled
    broad *= 16
    broad /= scaled
    return np.asarray(broad)


def _bead_image(patch: Patch, pixels: Pixels, fit: _Fit) -> BeadImage | None:
    """The result in picture pixels; None if it is no plausible bead."""
    x, y, radius, _, blur_x, blur_y = fit.parameters[:SHAPES]
    sigma = math.sqrt(max(float(fit.covariance[0, 0] + fit.covariance[1, 1]) / 2, 1e-6))
    covered = pixels.near_path(fit.parameters[:SHAPES] * np.array([1, 1, 0.7, 0, 1, 1]))
    away = math.hypot(x - patch.near[0], y - patch.near[1])
    if len(covered) < 3 or away > 1.5 * patch.radius + 4 or sigma > 0.5 * radius:
        return None
    spot = pixels.values[covered] - surroundings(patch)
    if float(np.sqrt(np.mean(spot**2))) < 2.0 * fit.noise:
        return None
    step = patch.step
    return BeadImage(
        x=float(patch.origin[0] + x * step),
        y=float(patch.origin[1] + y * step),
        sigma=max(sigma, LEAST_SIGMA) * step,
        radius=float(radius * step),
        blur=(float(blur_x * step), float(blur_y * step)),
        contrast=float(np.mean(spot)),
    )


def _look(fit: _Fit, patch: Patch) -> Look:
    return Look(
        float(fit.parameters[2] * patch.step),
        float(fit.parameters[3] * patch.step),
        fit.parameters[SHAPES : SHAPES + LIGHTS].copy(),
    )


def _shading(fit: _Fit, patch: Patch, prior: Prior) -> Shading:
    slopes = np.s_[SHAPES + 1 : SHAPES + 3]
    chosen = np.array([0, 1, SHAPES + 1, SHAPES + 2])
    unit = np.array([patch.step, patch.step, 1, 1])
    covariance = fit.covariance[np.ix_(chosen, chosen)] * np.outer(unit, unit)
    return Shading(fit.parameters[slopes].copy(), covariance, prior.mean[slopes].copy(), prior.spread[slopes].copy())
