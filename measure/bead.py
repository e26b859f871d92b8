"""Find a bead in a frame before a known scene, with the centre to a few hundredths of a pixel.

`locate` fits a model of a shaded, motion-blurred disc to the pixels around a guess.  `rigtwin.measure.follow` uses it
to follow a bead through a clip.  Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from rigtwin.lab.arrays import Array, FloatImage, Mask
from rigtwin.measure.patch import Patch, cut_patch, start_from_moments, surroundings
from rigtwin.measure.scene import middle_of


@dataclass(frozen=True)
class BeadImage:
    """A bead as one frame shows it."""

    x: float  # [px]
    y: float  # [px]
    sigma: float  # [px], one standard deviation of each coordinate
    radius: float  # [px]
    blur: tuple[float, float]  # [px], path of the centre during the exposure; its sign is not seen
    contrast: float  # [grey levels], mean difference between the bead and what it hides, signed


@dataclass(frozen=True)
class Look:
    """What a bead looks like wherever it is: learnt from many frames, it steadies the fit of each."""

    radius: float  # [px]
    edge: float  # [px], softness of the rim
    light: Array  # [grey levels]: constant, slope in x, slope in y, bulge, shape (4,)


@dataclass(frozen=True)
class Shading:
    """The light's slopes in one frame: their freedom costs more of the centre than that of all else together.

    A bead brighter on its left looks much like one further left.
    """

    slopes: Array  # [grey levels per radius] in x and y, shape (2,)
    covariance: Array  # of x, y [px] and the slopes, shape (4, 4)
    usual: Array  # slopes that were held likely, shape (2,)
    spread: Array  # and how far off, shape (2,)


@dataclass(frozen=True)
class BeadFit:
    """A located bead with what its pixels say of its look."""

    image: BeadImage
    look: Look
    misfit: float  # [grey levels], mean absolute residual
    shading: Shading
    information: Array  # of all parameters, the pixels of a patch alone, shape (n, n)
    step: int  # picture pixels per patch pixel

    def certainty(self) -> Array:
        """Inverse covariance of (radius, edge, light), shape (6, 6).

        What is left of the information when place, blur and scene of this frame are unknown (Schur complement).
        """
        mine = np.array([2, 3, *range(_SHAPES, _SHAPES + _LIGHTS)])
        other = np.array([k for k in range(len(self.information)) if k not in mine])
        cross = self.information[np.ix_(mine, other)]
        inside = self.information[np.ix_(other, other)] + np.diag(np.full(len(other), 1e-9))
        schur = self.information[np.ix_(mine, mine)] - cross @ np.linalg.lstsq(inside, cross.T, rcond=None)[0]
        unit = np.array([self.step, self.step, 1, 1, 1, 1])
        return np.asarray(schur / np.outer(unit, unit))

    def with_slopes(self, slopes: Array, spread: Array) -> BeadImage:
        """The bead had it been known that the light's slopes are these, give or take `spread`.

        No new fit: near its best, what is known beforehand shifts a fit of least squares in proportion.
        """
        known, light = self.shading, self.shading.covariance[:, 2:]
        more = np.diag(1 / spread**2 - 1 / known.spread**2)
        pull = (slopes - known.slopes) / spread**2 - (known.usual - known.slopes) / known.spread**2
        gain = light @ np.linalg.inv(np.eye(2) + more @ light[2:])
        x, y = (gain @ pull)[:2].tolist()
        left = known.covariance - gain @ more @ light.T
        sigma = math.sqrt(max(float(left[0, 0] + left[1, 1]) / 2, LEAST_SIGMA**2))
        return replace(self.image, x=self.image.x + x, y=self.image.y + y, sigma=sigma)


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
    pixels = _Pixels(patch)
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


def _soft_edge(depth: FloatImage) -> tuple[FloatImage, FloatImage]:
    """The normal distribution at `depth`, and its density: how much of a pixel is covered, and where the rim is.

    Looked up in tables: the functions themselves would take most of the time of a fit.
    """
    places = (depth * np.float32(1 / _DEPTH_STEP) + np.float32(_DEEPEST / _DEPTH_STEP + 0.5)).astype(np.int32)
    return _COVERS.take(places, mode="clip"), _RIMS.take(places, mode="clip")


def _summed(moments: FloatImage, values: FloatImage) -> FloatImage:
    """Sums over the exposure, one for each row of `moments`, of values of shape (..., exposure, pixels)."""
    pixels = values.shape[-1]
    if pixels <= _SUMMED_AT_ONCE:
        return np.asarray(moments @ values)
    parts = [values[..., first : first + _SUMMED_AT_ONCE] for first in range(0, pixels, _SUMMED_AT_ONCE)]
    return np.concatenate([moments @ part for part in parts], axis=-1)


@dataclass(frozen=True)
class _Prior:
    """Where the fit starts and what is known beforehand, one entry per parameter; spread infinite: nothing.

    Parameters: x, y, radius, edge softness, blur x, blur y; light: constant, slope x, slope y, bulge; then the scene:
    offset (and slopes where there is no background).
    """

    mean: Array
    spread: Array


@dataclass(frozen=True)
class _Fit:
    parameters: Array
    covariance: Array  # by the pixels and what is known beforehand
    information: Array  # information of the pixels alone
    noise: float  # [grey levels], robust residual scatter
    misfit: float  # [grey levels], mean absolute residual


LEAST_SIGMA = 0.004  # [px], for what is left of faults of the model
FAINTEST = 0.3  # of how a bead should stand out from what it hides, below which what is seen there is not the bead
_SHAPES = 6
_LIGHTS = 4
_ROOM = 2.5  # [px], around the pixels near a bead, so that it may move a little before they are chosen anew
_POWERS = np.arange(3)[:, None]
# pixels in a product of matrices: larger ones would be shared out among threads that wait for each other
_AT_ONCE = 1000
_SUMMED_AT_ONCE = 4000
_EXACT = 0.02  # [px], spread of a blur that is known
_MOST_STEPS = 18  # of the exposure integral: a longer smear has its information at its ends and sides
_SETTLED = 0.1  # of the cost, that another step may gain at most; a gain of 1 would be one standard deviation
_BEYOND = 1.3  # of a step: the weights follow the residuals only in the next turn, so each step is too short
_HOPELESS = 8  # turns in which a bead that is there has been reached, a diameter away or less
_DEEPEST = 6.0  # depth below the rim, in units of its softness, at which a pixel is covered all but 1e-9
_DEPTH_STEP = 2.0**-10  # of the tables: how much of a pixel is covered is right to 0.0002
_DEPTHS = np.arange(-_DEEPEST, _DEEPEST + _DEPTH_STEP, _DEPTH_STEP)
_COVERS = ndtr(_DEPTHS).astype(np.float32)
_RIMS = (np.exp(-0.5 * _DEPTHS**2) / math.sqrt(2 * math.pi)).astype(np.float32)


def _start(patch: Patch, blur_guess: tuple[float, float], look: Look | None) -> Array | None:
    """x, y, blur x, blur y and contrast to start from."""
    if look is None:
        return start_from_moments(patch, blur_guess)
    behind = 0.0 if patch.behind is None else float(np.median(patch.behind))
    contrast = math.hypot(float(look.light[0]) - behind, 0.5 * math.hypot(*look.light[1:]))
    return np.array([*patch.near, *(np.array(blur_guess) / patch.step), max(contrast, 1.0)])


def _prior(pixels: _Pixels, start: Array, look: Look | None, patch: Patch, blur_doubt: float | None) -> _Prior:
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
        mean = pixels.solve_light(np.array([*shape, *np.zeros(_LIGHTS), *scene]), np.array(light_spread))
    else:
        shape = [x, y, look.radius / patch.step, max(look.edge / patch.step, 0.4), blur_x, blur_y]
        off = _EXACT if blur_doubt is None else math.hypot(0.3 + 0.1 * blur, blur_doubt / patch.step)
        spread = [np.inf, np.inf, 0.01 * patch.radius, 0.1, off, off]
        # light changes a little along the path: shadows, the bright plate
        light_spread = [0.15 * contrast, 0.05 * contrast, 0.05 * contrast, 0.05 * contrast]
        mean = np.array([*shape, *look.light, *scene])
    return _Prior(mean, np.array([*spread, *light_spread, *np.full(len(scene), np.inf)]))


def _fit_disc(pixels: _Pixels, prior: _Prior, usual: Array | None) -> _Fit | None:
    """Levenberg-Marquardt on all parameters together, weights and noise renewed at every turn.

    None where no bead is seen, of the light that is `usual` where that is known.
    """
    parameters = prior.mean.copy()
    pixels.arrange(parameters[:_SHAPES])
    jacobian, residual = pixels.linearise(parameters)
    damping = 1e-3
    beforehand = 1 / prior.spread**2
    steps = np.arange(len(beforehand))
    for turn in range(14):
        if pixels.arrange(parameters[:_SHAPES]):
            jacobian, residual = pixels.linearise(parameters)
        if turn == _HOPELESS and usual is not None and not pixels.confirm(parameters, jacobian, residual, usual):
            return None
        variance = _variance(residual, jacobian[_SHAPES])
        weights = _robust_weights(residual, variance)
        # pixels that repeat each other say less of the shape than they seem to: what is known before counts for more
        certain = beforehand.copy()
        certain[2:_SHAPES] *= _correlation_excess(pixels.image(residual))
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
    excess = _correlation_excess(pixels.image(residual))
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


def _bounded(parameters: Array, before: Array, prior: _Prior) -> Array:
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


def _part_shown(model: Array, values: Array) -> float:
    """How much of a model the values show: 1 for all of it."""
    return float(np.einsum("i,i", model, values)) / (float(np.einsum("i,i", model, model)) + 1e-9)


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


def _correlation_excess(residual: Array) -> float:
    """How much neighbouring residuals repeat each other (compression, demosaicing): factor on the variance."""
    values = residual - float(np.add.reduce(residual, axis=None)) / residual.size
    power = float(np.einsum("ij,ij", values, values)) + 1e-12
    across = float(np.einsum("ij,ij", values[:, 1:], values[:, :-1])) / power
    down = float(np.einsum("ij,ij", values[1:], values[:-1])) / power
    excess = (1 + across) / (1 - across) * (1 + down) / (1 - down)
    return min(max(excess, 1.0), 16.0)


class _Pixels:
    """The usable pixels of a patch as flat arrays, and the disc model with its derivatives there.

    Pixels near the bead's path come first: further away there is nothing but scene, and computing the model there too
    would double the time.
    """

    def __init__(self, patch: Patch) -> None:
        y, x = np.nonzero(patch.usable)
        self._size = patch.grey.shape
        self._index = y * self._size[1] + x
        self.x, self.y = x.astype(np.float64), y.astype(np.float64)
        self.values = patch.grey[y, x]
        self.behind = None if patch.behind is None else patch.behind[y, x]
        self._unit = patch.radius
        self._scene_rows = self._rows_of_scene()
        self._near = 0  # how many pixels come first
        self._places_near = np.empty((2, 0), dtype=np.float32)
        self._behind_near: FloatImage | None = None
        self._shape = np.full(_SHAPES, np.nan)  # for which they were chosen

    def image(self, values: Array) -> Array:
        """Flat values back in their places, zero elsewhere, shape (h, w)."""
        flat = np.zeros(self._size[0] * self._size[1])
        flat[self._index] = values
        return flat.reshape(self._size)

    def arrange(self, shape: Array) -> bool:
        """Put the pixels near a bead of this shape first, with room for it to move; False where they are already."""
        moved = shape - self._shape
        way = math.hypot(moved[0], moved[1]) + math.hypot(moved[4], moved[5]) / 2
        if way + moved[2] + 4 * moved[3] < 0.6 * _ROOM:
            return False
        far = self._from_path(shape) > (shape[2] + 4 * shape[3] + _ROOM) ** 2
        order = np.argsort(far, kind="stable")
        self.x, self.y, self.values, self._index = (each[order] for each in (self.x, self.y, self.values, self._index))
        self.behind = None if self.behind is None else self.behind[order]
        self._scene_rows = self._rows_of_scene()
        self._near = near = len(order) - int(np.count_nonzero(far))
        self._places_near = np.array([self.x[:near], self.y[:near]], dtype=np.float32)
        self._behind_near = None if self.behind is None else self.behind[:near].astype(np.float32)
        self._shape = shape.copy()
        return True

    def solve_light(self, parameters: Array, spread: Array) -> Array:
        """The parameters with the light that fits best at this shape."""
        jacobian, residual = self.linearise(parameters)
        information, pull = self.normal_equations(jacobian, residual, np.ones(len(residual)))
        ridge = np.full(len(parameters) - _SHAPES, 1e-6)
        ridge[:_LIGHTS] += 1 / spread**2
        solved = parameters.copy()
        solved[_SHAPES:] += np.linalg.solve(information[_SHAPES:, _SHAPES:] + np.diag(ridge), pull[_SHAPES:])
        return solved

    def normal_equations(self, jacobian: Array, residual: Array, weights: Array) -> tuple[Array, Array]:
        """The weighted jacobian times itself, shape (parameters, parameters), and times the residual."""
        near, scene = self._near, np.s_[_SHAPES + _LIGHTS :]
        left, right = jacobian * weights[:near], np.concatenate([jacobian, residual[None, :near]])
        # large products, and those with a vector, would be shared out among threads that wait for each other
        both = np.zeros((len(left), len(right)))  # no pixel is near a bead that left the picture
        for first in range(0, near, _AT_ONCE):
            part = np.s_[:, first : first + _AT_ONCE]
            both += left[part] @ right[part].T
        information, pull = both[:, :-1].copy(), both[:, -1].copy()
        rows = self._scene_rows[:, near:]
        weighted = rows * weights[near:]
        information[scene, scene] += np.einsum("ik,jk", weighted, rows)
        pull[scene] += np.einsum("ik,k", weighted, residual[near:])
        return information, pull

    def started_better(self, prior: _Prior, places: Sequence[tuple[float, float]]) -> _Prior:
        """The prior with the bead set down at one of `places` where the pixels there look more like it.

        The brightest part of a shaded bead, of which the moments tell, may lie half a radius off its centre.
        """
        there = [replace(prior, mean=np.concatenate([place, prior.mean[2:]])) for place in places]
        return min([prior, *there], key=lambda each: self._misfit(each.mean)) if there else prior

    def _misfit(self, parameters: Array) -> float:
        self.arrange(parameters[:_SHAPES])
        return float(np.sum(np.abs(self.linearise(parameters)[1])))

    def confirm(self, parameters: Array, jacobian: Array, residual: Array, usual: Array) -> bool:
        """Whether the pixels show what the model says, and not just the scene.

        `usual` is the light of the bead wherever it is: a smear of lens or codec that is far fainter is not the bead.
        """
        near, lights, scene = self._near, np.s_[_SHAPES : _SHAPES + _LIGHTS], np.s_[_SHAPES + _LIGHTS :]
        values = self.values[:near]
        model = values - residual[:near] - np.einsum("i,ik", parameters[scene], jacobian[scene])
        bead = model + np.einsum("i,ik", usual - parameters[lights], jacobian[lights])
        return 0.5 < _part_shown(model, values) < 2.0 and _part_shown(bead, values) > FAINTEST

    def linearise(self, parameters: Array) -> tuple[Array, Array]:
        """Derivatives of the model at the pixels near the bead, shape (parameters, near), and data minus model.

        At the others it depends on the scene alone.
        """
        light, near, unit = parameters[_SHAPES:], self._near, self._unit
        radius, edge = parameters[2:4].tolist()
        base, _, _, bulge = light[:_LIGHTS].tolist()
        centre, blur = parameters[:2, None].astype(np.float32), parameters[4:_SHAPES, None].astype(np.float32)
        slopes = light[1:3, None].astype(np.float32) / np.float32(unit)
        # the midpoint rule is exact enough once its step is about the width of the soft edge
        count = min(max(1, math.ceil(math.hypot(*parameters[4:_SHAPES]) / (1.3 * max(edge, 0.7)))), _MOST_STEPS)
        when = (np.arange(count) + 0.5) / count - 0.5
        moments = (when**_POWERS / count).astype(np.float32)
        # one offset for all pixels where the background is known
        scene = light[_LIGHTS:] if self.behind is not None else np.einsum("i,ik", light[_LIGHTS:], self._scene_rows)
        # single precision is a hundredth of the least noise, and takes a third of the time
        behind = np.asarray(scene[:near], dtype=np.float32) if self._behind_near is None else self._behind_near
        away = self._places_near - centre
        # one row per moment of the exposure
        to = away[:, None] - (blur * when.astype(np.float32))[:, :, None]
        square = to[0] * to[0]
        square += to[1] * to[1]
        distance = np.sqrt(square)
        # the blunter an arc, the further inside it the half of its height
        depth = (np.float32(radius - edge**2 / (2 * radius)) - distance) * np.float32(1 / edge)
        cover, rim = _soft_edge(depth)
        over = square * np.float32(-bulge / unit**2)
        over += np.float32(base + bulge) - behind
        over += slopes[0] * to[0]
        over += slopes[1] * to[1]
        collected = np.empty((6, count, near), dtype=np.float32)
        rim *= over
        np.multiply(rim, np.float32(1 / edge), out=collected[2])
        np.multiply(collected[2], depth + np.float32(edge / radius), out=collected[3])
        np.multiply(cover, square, out=collected[4])
        np.multiply(cover, over, out=collected[5])
        distance += np.float32(1e-6)
        np.multiply(np.divide(collected[2], distance, out=distance), to, out=collected[:2])
        # what every pixel collects over the exposure: plain, and weighted with the moment
        covered, early, spread = _summed(moments, cover)
        plain, late = _summed(moments[:2], collected).swapaxes(0, 1)
        turned, early_turned = away * covered - blur * early, away * early - blur * spread  # times the unit
        bend = np.float32(2 * bulge / unit**2)
        rows = np.empty((_SHAPES + len(light), near))
        # d(cover * lit)/d(centre): the rim moves, and the shading moves with the bead
        rows[:2] = plain[:2] - slopes * covered + bend * turned
        rows[2] = plain[2]
        np.negative(plain[3], out=rows[3])
        rows[4:_SHAPES] = late[:2] - slopes * early + bend * early_turned
        rows[6] = covered
        np.divide(turned, np.float32(unit), out=rows[7:9])
        rows[9] = covered - plain[4] * np.float32(1 / unit**2)
        rows[_SHAPES + _LIGHTS :] = self._scene_rows[:, :near]
        if self.behind is None:
            rows[_SHAPES + _LIGHTS :] *= 1 - covered
        residual = self.values - scene
        residual[:near] -= plain[5]
        return rows, residual

    def near_path(self, shape: Array) -> npt.NDArray[np.intp]:
        """Pixels that a bead of this shape covers while the shutter is open."""
        return np.flatnonzero(self._from_path(shape) < (shape[2] + 4 * shape[3]) ** 2)

    def _from_path(self, shape: Array) -> Array:
        """Squared distance of every pixel from the way of the bead's centre."""
        cx, cy, _, _, blur_x, blur_y = shape.tolist()
        length = math.hypot(blur_x, blur_y) + 1e-9
        along_x, along_y = blur_x / length, blur_y / length
        away_x, away_y = self.x - cx, self.y - cy
        along = np.clip(away_x * along_x + away_y * along_y, -length / 2, length / 2)
        return np.asarray((away_x - along * along_x) ** 2 + (away_y - along * along_y) ** 2)

    def _rows_of_scene(self) -> Array:
        """Derivatives of the scene alone: an offset, and without a background two slopes, at every pixel."""
        if self.behind is not None:
            return np.ones((1, len(self.x)))
        return np.stack([np.ones_like(self.x), self.x / self._unit, self.y / self._unit])


def _bead_image(patch: Patch, pixels: _Pixels, fit: _Fit) -> BeadImage | None:
    """Back to picture pixels; None when what was found is no bead."""
    x, y, radius, _, blur_x, blur_y = fit.parameters[:_SHAPES]
    sigma = math.sqrt(max(float(fit.covariance[0, 0] + fit.covariance[1, 1]) / 2, 1e-6))
    covered = pixels.near_path(fit.parameters[:_SHAPES] * np.array([1, 1, 0.7, 0, 1, 1]))
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
        fit.parameters[_SHAPES : _SHAPES + _LIGHTS].copy(),
    )


def _shading(fit: _Fit, patch: Patch, prior: _Prior) -> Shading:
    slopes = np.s_[_SHAPES + 1 : _SHAPES + 3]
    chosen = np.array([0, 1, _SHAPES + 1, _SHAPES + 2])
    unit = np.array([patch.step, patch.step, 1, 1])
    covariance = fit.covariance[np.ix_(chosen, chosen)] * np.outer(unit, unit)
    return Shading(fit.parameters[slopes].copy(), covariance, prior.mean[slopes].copy(), prior.spread[slopes].copy())
