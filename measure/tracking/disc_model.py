"""Model of a shaded, motion-blurred disc with a soft edge, with its derivatives at the pixels of a patch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from rigtwin.lab.arrays import Array, FloatImage
from rigtwin.measure.tracking.bead_image import LIGHTS, SHAPES
from rigtwin.measure.tracking.patch import Patch


def _soft_edge(depth: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Normal distribution at `depth` (share of a pixel covered) and its density (rim).

    From look-up tables: computing the functions would take most of the time of a fit.
    """
    places = (depth * np.float32(1 / _DEPTH_STEP) + np.float32(_DEEPEST / _DEPTH_STEP + 0.5)).astype(np.int32)
    return _COVERS.take(places, mode="clip"), _RIMS.take(places, mode="clip")


def _summed(moments: FloatImage, values: FloatImage) -> FloatImage:
    """Sums over the exposure of values, shape (..., exposure, pixels), one for each row of `moments`."""
    pixels = values.shape[-1]
    if pixels <= _SUMMED_AT_ONCE:
        return np.asarray(moments @ values)
    parts = [values[..., first : first + _SUMMED_AT_ONCE] for first in range(0, pixels, _SUMMED_AT_ONCE)]
    return np.concatenate([moments @ part for part in parts], axis=-1)


@dataclass(frozen=True)
class Prior:
    """Start and Gaussian prior of the fit, one entry per parameter; infinite spread: no prior.

    Parameters: x, y, radius, edge softness, blur x, blur y [patch px]; light: constant, slope x, slope y, bulge [grey
    levels]; background: offset (and two slopes if the background is unknown).
    """

    mean: Array  # shape (n,)
    spread: Array  # standard deviation, shape (n,)


FAINTEST = 0.3  # minimum contrast relative to the bead's known contrast

_ROOM = 2.5  # [px], margin of the near pixels, so that the bead can move a little before they are selected again

_POWERS = np.arange(3)[:, None]

# pixels per matrix product: larger ones would be split over threads, whose synchronisation costs more than it saves
_AT_ONCE = 1000

_SUMMED_AT_ONCE = 4000

_MOST_STEPS = 18  # of the exposure integral; a longer streak has its information at its ends and sides

_DEEPEST = 6.0  # depth below the rim, in units of its softness, where the uncovered share is 1e-9

_DEPTH_STEP = 2.0**-10  # resolution of the tables; error of the covered share 0.0002

_DEPTHS = np.arange(-_DEEPEST, _DEEPEST + _DEPTH_STEP, _DEPTH_STEP)

_COVERS = ndtr(_DEPTHS).astype(np.float32)

_RIMS = (np.exp(-0.5 * _DEPTHS**2) / math.sqrt(2 * math.pi)).astype(np.float32)


def _part_shown(model: Array, values: Array) -> float:
    """Amplitude of the model in the values (least squares), 1: full."""
    return float(np.einsum("i,i", model, values)) / (float(np.einsum("i,i", model, model)) + 1e-9)


class Pixels:
    """The usable pixels of a patch as flat arrays, and the disc model with its derivatives there.

    Pixels near the bead's path come first. The others show only the background; computing the disc model there would
    double the time.
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
        self._near = 0  # number of near pixels
        self._places_near = np.empty((2, 0), dtype=np.float32)
        self._behind_near: FloatImage | None = None
        self._shape = np.full(SHAPES, np.nan)  # shape for which they were selected

    def image(self, values: Array) -> Array:
        """Flat values as a picture, zero elsewhere, shape (h, w)."""
        flat = np.zeros(self._size[0] * self._size[1])
        flat[self._index] = values
        return flat.reshape(self._size)

    def arrange(self, shape: Array) -> bool:
        """Put the pixels near a bead of this shape first, with a margin; False if the current order still holds."""
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
        """The parameters with light and background fitted (linear least squares with ridge) at this shape."""
        jacobian, residual = self.linearise(parameters)
        information, pull = self.normal_equations(jacobian, residual, np.ones(len(residual)))
        ridge = np.full(len(parameters) - SHAPES, 1e-6)
        ridge[:LIGHTS] += 1 / spread**2
        solved = parameters.copy()
        solved[SHAPES:] += np.linalg.solve(information[SHAPES:, SHAPES:] + np.diag(ridge), pull[SHAPES:])
        return solved

    def normal_equations(self, jacobian: Array, residual: Array, weights: Array) -> tuple[Array, Array]:
        """J W J^T, shape (parameters, parameters), and J W r, shape (parameters,)."""
        near, scene = self._near, np.s_[SHAPES + LIGHTS :]
        left, right = jacobian * weights[:near], np.concatenate([jacobian, residual[None, :near]])
        # in blocks and without matrix-vector products, which would be split over threads (see _AT_ONCE)
        both = np.zeros((len(left), len(right)))  # stays zero if the bead has left the picture
        for first in range(0, near, _AT_ONCE):
            part = np.s_[:, first : first + _AT_ONCE]
            both += left[part] @ right[part].T
        information, pull = both[:, :-1].copy(), both[:, -1].copy()
        rows = self._scene_rows[:, near:]
        weighted = rows * weights[near:]
        information[scene, scene] += np.einsum("ik,jk", weighted, rows)
        pull[scene] += np.einsum("ik,k", weighted, residual[near:])
        return information, pull

    def started_better(self, prior: Prior, places: Sequence[tuple[float, float]]) -> Prior:
        """The prior, with the centre moved to one of `places` if the misfit is smaller there.

        The start from moments is the brightest part of a shaded bead, which may be half a radius off its centre.
        """
        there = [replace(prior, mean=np.concatenate([place, prior.mean[2:]])) for place in places]
        return min([prior, *there], key=lambda each: self._misfit(each.mean)) if there else prior

    def _misfit(self, parameters: Array) -> float:
        self.arrange(parameters[:SHAPES])
        return float(np.sum(np.abs(self.linearise(parameters)[1])))

    def confirm(self, parameters: Array, jacobian: Array, residual: Array, usual: Array) -> bool:
        """Whether the pixels show the fitted bead and not just the background.

        `usual` is the bead's known light, shape (4,): a much fainter smear of lens or codec is not the bead.
        """
        near, lights, scene = self._near, np.s_[SHAPES : SHAPES + LIGHTS], np.s_[SHAPES + LIGHTS :]
        values = self.values[:near]
        model = values - residual[:near] - np.einsum("i,ik", parameters[scene], jacobian[scene])
        bead = model + np.einsum("i,ik", usual - parameters[lights], jacobian[lights])
        return 0.5 < _part_shown(model, values) < 2.0 and _part_shown(bead, values) > FAINTEST

    def linearise(self, parameters: Array) -> tuple[Array, Array]:
        """Derivatives of the model at the near pixels, shape (parameters, near), and residual (data minus model).

        At the other pixels the model is the background alone.
        """
        light, near, unit = parameters[SHAPES:], self._near, self._unit
        radius, edge = parameters[2:4].tolist()
        base, _, _, bulge = light[:LIGHTS].tolist()
        centre, blur = parameters[:2, None].astype(np.float32), parameters[4:SHAPES, None].astype(np.float32)
        slopes = light[1:3, None].astype(np.float32) / np.float32(unit)
        # the midpoint rule is accurate enough with a step of about the width of the soft edge
        count = min(max(1, math.ceil(math.hypot(*parameters[4:SHAPES]) / (1.3 * max(edge, 0.7)))), _MOST_STEPS)
        when = (np.arange(count) + 0.5) / count - 0.5
        moments = (when**_POWERS / count).astype(np.float32)
        # with a known background the scene is a single offset
        scene = light[LIGHTS:] if self.behind is not None else np.einsum("i,ik", light[LIGHTS:], self._scene_rows)
        # single precision: its error is a hundredth of the smallest noise, and it takes a third of the time
        behind = np.asarray(scene[:near], dtype=np.float32) if self._behind_near is None else self._behind_near
        away = self._places_near - centre
        # one row per step of the exposure integral
        to = away[:, None] - (blur * when.astype(np.float32))[:, :, None]
        square = to[0] * to[0]
        square += to[1] * to[1]
        distance = np.sqrt(square)
        # for a curved rim the half-maximum lies inside the radius
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
        # sums over the exposure: plain, and weighted with time
        covered, early, spread = _summed(moments, cover)
        plain, late = _summed(moments[:2], collected).swapaxes(0, 1)
        turned, early_turned = away * covered - blur * early, away * early - blur * spread  # in units of _unit
        bend = np.float32(2 * bulge / unit**2)
        rows = np.empty((SHAPES + len(light), near))
        # d(cover * light)/d(centre): the rim moves, and the shading moves with the bead
        rows[:2] = plain[:2] - slopes * covered + bend * turned
        rows[2] = plain[2]
        np.negative(plain[3], out=rows[3])
        rows[4:SHAPES] = late[:2] - slopes * early + bend * early_turned
        rows[6] = covered
        np.divide(turned, np.float32(unit), out=rows[7:9])
        rows[9] = covered - plain[4] * np.float32(1 / unit**2)
        rows[SHAPES + LIGHTS :] = self._scene_rows[:, :near]
        if self.behind is None:
            rows[SHAPES + LIGHTS :] *= 1 - covered
        residual = self.values - scene
        residual[:near] -= plain[5]
        return rows, residual

    def near_path(self, shape: Array) -> npt.NDArray[np.intp]:
        """Indices of the pixels that a bead of this shape covers during the exposure."""
        return np.flatnonzero(self._from_path(shape) < (shape[2] + 4 * shape[3]) ** 2)

    def _from_path(self, shape: Array) -> Array:
        """Squared distance of every pixel from the path of the bead's centre during the exposure."""
        cx, cy, _, _, blur_x, blur_y = shape.tolist()
        length = math.hypot(blur_x, blur_y) + 1e-9
        along_x, along_y = blur_x / length, blur_y / length
        away_x, away_y = self.x - cx, self.y - cy
        along = np.clip(away_x * along_x + away_y * along_y, -length / 2, length / 2)
        return np.asarray((away_x - along * along_x) ** 2 + (away_y - along * along_y) ** 2)

    def _rows_of_scene(self) -> Array:
        """Derivatives of the background model at every pixel: offset, and two slopes if the background is unknown."""
        if self.behind is not None:
            return np.ones((1, len(self.x)))
        return np.stack([np.ones_like(self.x), self.x / self._unit, self.y / self._unit])
