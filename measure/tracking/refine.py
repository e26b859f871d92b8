"""Find a bead in a frame before a known scene, with the centre to a few hundredths of a pixel.

`locate` fits a model of a shaded, motion-blurred disc to the pixels around a guess.  `rigtwin.measure.tracking.follow`
uses it to follow a bead through a clip.  Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Mask
from rigtwin.measure.robust import correlation_excess, middle_of
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
    """Sub-pixel centre of a disc near a guess; None when there is none.

    `grey` and `background` have shape (height, width); without a background a plane of grey is fitted around the
    bead.  `near`, `radius` and `blur_guess` in pixels; a `blur_guess` of zero means unknown.
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
    blur_doubt: float | None = 0.0,
) -> BeadFit | None:
    """As `locate`; `hidden` marks pixels where something stands in front of the bead, `look` is its known look.

    `surely_near` starts the fit at `near` itself: what else moves close by, a shadow say, then cannot mislead it.
    `room` [px] is how far beyond the bead at rest the pixels are used, half the blur when not given.
    `onwards` is where the bead is if it goes on as it did, another place to start from.
    `blur_doubt` [px] is how far the blur may be off its guess beyond what a guess is always off; None: it is exact.

    The bead is a disc of radius r with a soft edge, lit like a sphere (constant, two slopes and a bulge), averaged over
    its path during the exposure, and hides the background behind it: D = mean_k d_k (p_k - B).  All parameters are
    fitted at once by damped least squares with robust weights, started from the moments of the difference image.
    """
    margin = 0.8 * radius + 5.0 if look is None else 0.5 * radius + 4.0
    along = (abs(blur_guess[0]) / 2, abs(blur_guess[1]) / 2) if room is None else (room, room)
    reach = (radius + margin + along[0], radius + margin + along[1])
    patch = cut_patch(grey, background, near, reach, radius, hidden)
    start = None if patch is None else _start(patch, blur_guess, look if surely_near else None)
    if patch is None or start is None:
        return None
    pixels = Pixels(patch)
    prior = _prior(pixels, start, look, patch, blur_doubt)
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
    """The look that all fits agree on: their mean, each weighted with the certainty matrix of its own pixels."""
    table = np.array([np.concatenate([[fit.look.radius, fit.look.edge], fit.look.light]) for fit in fits])
    # a fit caught by something else is far off in several parameters at once: only the inner ones vote
    middle = np.median(table, axis=0)
    spread = 1.4826 * np.median(np.abs(table - middle), axis=0) + 1e-6
    inner = np.flatnonzero(np.max(np.abs(table - middle) / spread, axis=1) < 4).tolist()
    inner = inner if len(inner) >= 3 else list(range(len(fits)))
    certainty = np.array([fits[k].certainty() for k in inner])
    total, pull = np.sum(certainty, axis=0), np.einsum("kij,kj->i", certainty, table[inner])
    mean = np.linalg.lstsq(total, pull, rcond=1e-10)[0]
    return Look(float(mean[0]), float(mean[1]), np.asarray(mean[2:]))


@dataclass(frozen=True)
class _Fit:
    parameters: Array
    covariance: Array  # by the pixels and what is known beforehand
    information: Array  # information of the pixels alone
    noise: float  # [grey levels], robust residual scatter
    misfit: float  # [grey levels], mean absolute residual


_EXACT = 0.02  # [px], spread of a blur that is known

_SETTLED = 0.1  # of the cost, that another step may gain at most; a gain of 1 would be one standard deviation

_BEYOND = 1.3  # of a step: the weights follow the residuals only in the next turn, so each step is too short

_HOPELESS = 8  # turns in which a bead that is there has been reached, a diameter away or less


def _start(patch: Patch, blur_guess: tuple[float, float], look: Look | None) -> Array | None:
    """x, y, blur x, blur y and contrast to start from."""
    if look is None:
        return start_from_moments(patch, blur_guess)
    behind = 0.0 if patch.behind is None else float(np.median(patch.behind))
    contrast = math.hypot(float(look.light[0]) - behind, 0.5 * math.hypot(*look.light[1:]))
    return np.array([*patch.near, *(np.array(blur_guess) / patch.step), max(contrast, 1.0)])


def _prior(pixels: Pixels, start: Array, look: Look | None, patch: Patch, blur_doubt: float | None) -> Prior:
    """Wide where a bead may be anything, narrow where its look is known.

    The width only matters where the pixels say little: a blurred bead does not tell its radius from its blur.
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
        off = _EXACT if blur_doubt is None else math.hypot(0.3 + 0.1 * blur, blur_doubt / patch.step)
        spread = [np.inf, np.inf, 0.01 * patch.radius, 0.1, off, off]
        # light changes a little along the path: shadows, the bright plate
        light_spread = [0.15 * contrast, 0.05 * contrast, 0.05 * contrast, 0.05 * contrast]
        mean = np.array([*shape, *look.light, *scene])
    return Prior(mean, np.array([*spread, *light_spread, *np.full(len(scene), np.inf)]))


def _fit_disc(pixels: Pixels, prior: Prior, usual: Array | None) -> _Fit | None:
    """Levenberg-Marquardt on all parameters together, weights and noise renewed at every turn.

    None where no bead is seen, of the light that is `usual` where that is known.
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
        # pixels that repeat each other say less of the shape than they seem to: what is known before counts for more
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
                parameters = _bounded(parameters + change, parameters, prior)  # so small a step needs no proof
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
    """A step that stays near enough for the linear model to hold, and a bead that stays one."""
    radius = float(prior.mean[2])
    for k in (0, 1):
        parameters[k] = min(max(parameters[k], before[k] - 0.5 * radius), before[k] + 0.5 * radius)
    parameters[2] = min(max(parameters[2], 0.5 * radius), 2.0 * radius)
    parameters[3] = min(max(parameters[3], 0.3), 3.0)
    return parameters


def _variance(residual: Array, cover: Array) -> Array:
    """[grey levels squared], of every pixel's noise.

    A bead's grain and gloss are no noise of the camera, but no shading either.
    `cover` is how much of each of the first pixels the bead covers; of the others it covers nothing.
    """
    # of whole grey levels the median would be a whole number too: noise of 2.4 would count as 3
    off = np.abs(residual + _between_levels(len(residual)))
    around = max(1.4826 * middle_of(off), 0.4)
    inside = off[: len(cover)][cover > 0.5]
    within = max(1.4826 * middle_of(inside), around) if len(inside) > 8 else around
    variance = np.full(len(residual), around**2)
    variance[: len(cover)] += cover * (within**2 - around**2)
    return variance


@functools.lru_cache(maxsize=8)
def _between_levels(count: int) -> Array:
    """[grey levels], evenly spread from one to the next."""
    return np.arange(count) * (math.sqrt(5) - 1) / 2 % 1 - 0.5


def _robust_weights(residual: Array, variance: Array) -> Array:
    """Weights of Geman and McClure, flat up to a few times the noise: pixels of an unknown thing count little.

    1 / (1 + (residual / 4 noise)^2)^2 / noise^2, in fewer steps.
    """
    broad = 16 * variance
    scaled = broad + residual * residual
    scaled *= scaled
    broad *= 16
    broad /= scaled
    return np.asarray(broad)


def _bead_image(patch: Patch, pixels: Pixels, fit: _Fit) -> BeadImage | None:
    """Back to picture pixels; None when what was found is no bead."""
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
