"""Find the round base under a heap: rim ends, roll, and how far one looks down on it.

The base is a disc seen from slightly above: its front rim is half an ellipse, its lower edge another half ellipse
below it, its sides two straight walls; bead colour above the rim, none on its face.  This template is laid where it
fits best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.measure.grains import Beads, Edges, edges

Array = npt.NDArray[np.float64]

LEAST_RIM = 0.5  # share of the lower rim that must lie on edges
LEAST_WALL = 0.3  # likewise of both walls, less the edges that run on where a wall should end
GOOD_SUPPORT = 0.82  # share of the outline on edges from which a find is not to be doubted
DOUBTFUL_SUPPORT = 0.78  # below it the find may be another edge
FOCAL_LENGTH = 2.0  # in widths of the photo: between a phone (0.75) and a macro lens (3 and more)
FOCAL_DOUBT = 0.4  # standard deviation of the logarithm of the above


@dataclass(frozen=True)
class Disc:
    """The base in the picture, a disc seen from the side."""

    centre: tuple[float, float]  # [px], middle of the line between the rim's two ends, x right, y down
    half_width: float  # [px], half the distance of the rim's ends
    roll: float  # [rad], positive when the base looks turned clockwise in the picture
    bulge: float  # [px], how far the front of the rim hangs below the line between its ends
    thickness: float  # [px]
    nearness: float  # [1], disc radius / distance of the camera, by the expected focal length: one photo hardly tells
    support: float  # [1], share of the template that lies on edges

    @property
    def sigma(self) -> float:
        """Standard uncertainty [px] of the rim's height; the less of the outline is seen, the more."""
        return 1.5 * (1 + 10 * max(0.0, 0.9 - self.support))

    @property
    def doubtful(self) -> bool:
        return self.support < DOUBTFUL_SUPPORT


@dataclass(frozen=True)
class _Template:
    """Candidates for the disc, each field of shape (candidates, 1), lengths in half widths unless said."""

    x: Array  # [px]
    y: Array  # [px]
    half: Array  # [px]
    roll: Array  # [rad]
    bulge: Array
    thickness: Array

    def pixel(self, along: Array, down: Array) -> tuple[Array, Array]:
        """Picture point of a template point given in half widths."""
        cos, sin = np.cos(self.roll), np.sin(self.roll)
        return self.x + self.half * (along * cos - down * sin), self.y + self.half * (along * sin + down * cos)

    def nearness(self, photo_width: float) -> Array:
        return np.asarray(np.minimum(self.half / (FOCAL_LENGTH * photo_width), 0.5))

    def lower_bulge(self, photo_width: float) -> Array:
        """One looks down on the lower rim more steeply, by the disc's thickness over the distance."""
        near = self.nearness(photo_width)
        return np.asarray(self.bulge + self.thickness * near / (1 - near * near))


def find_disc(
    grey: npt.NDArray[np.uint8],
    alike: npt.NDArray[np.float32],
    beads: Beads,
    *,
    roll: float | None,
) -> Disc | None:
    """The disc under the beads, None when there is none to be seen.

    `alike` is the bead likeness of every pixel, `roll` [rad] the camera's roll where it was given.
    """
    fine = edges(grey, blur=1.2)
    pictures = [edges(grey, blur=2.5), edges(grey, blur=1.5)]
    best: Disc | None = None
    for seed in (1, 2, 3):  # the search may end on another edge; look again when little supports what it found
        candidate = _sharpened(grey, fine, _search(pictures, alike, beads, roll, seed))
        template = _Template(*candidate[:, None, None])
        lower, left, right, *_ = _support(fine, alike, template, beads.radius, 160)[:, 0]
        support = float((2 * lower + left + right) / 4)
        if lower > LEAST_RIM and (left + right) / 2 > LEAST_WALL and (best is None or support > best.support):
            x, y, half, turn, bulge, thickness = (float(value) for value in candidate)
            near = float(template.nearness(grey.shape[1])[0, 0])
            best = Disc((x, y), half, turn, bulge * half, thickness * half, near, support)
        if best is not None and best.support > GOOD_SUPPORT:
            break
    return best


def _search(
    pictures: Sequence[Edges], alike: npt.NDArray[np.float32], beads: Beads, roll: float | None, seed: int
) -> Array:
    from scipy.optimize import Bounds, differential_evolution

    bounds = _bounds(beads, roll)
    population: Any = "sobol"
    for picture, generations in zip(pictures, (30, 60), strict=True):  # the more blurred one leads from further away
        search = differential_evolution(
            partial(_cost, picture, alike, beads),
            Bounds(bounds[:, 0], bounds[:, 1]),
            vectorized=True,
            updating="deferred",
            init=population,
            popsize=40,
            maxiter=generations,
            rng=seed,
            tol=1e-3,
            polish=False,
        )
        population = search.population
    return np.asarray(search.x)


def _sharpened(grey: npt.NDArray[np.uint8], fine: Edges, candidate: Array) -> Array:
    """The candidate moved to the sub-pixel edges: walls, then lower rim, then the upper rim by the face's height."""
    p = candidate.copy()
    for reach in (7.0, 5.0, 3.0):
        template = _Template(*p[:, None, None])
        near = float(template.nearness(grey.shape[1])[0, 0])
        deepening = near / (1 - near * near)  # the lower rim bulges by so much of the thickness more
        low = p[4] + p[5] * deepening
        down = p[5] + np.linspace(-0.8, -0.15, 24) * p[5]
        left = _edge_offset(fine, template, -np.ones(24), down, (1.0, 0.0), reach)
        right = _edge_offset(fine, template, np.ones(24), down, (1.0, 0.0), reach)
        shift = np.array([np.median(left[0]), np.median(right[0])])
        p[0], p[2] = p[0] + shift.mean(), p[2] + (shift[1] - shift[0]) / 2
        along = np.linspace(-0.95, 0.95, 240)
        arc = np.sqrt(1 - along * along)
        offset, strength = _edge_offset(fine, template, along, p[5] + low * arc, (0.0, 1.0), reach)
        move = _robust_fit(np.column_stack([np.ones_like(along), along, arc]), offset, strength)
        lower, low = p[1] + p[5] * p[2] + move[0], max(low + move[2] / p[2], 0.0)  # [px], [half widths]
        p[3] += move[1] / p[2]
        p[1], p[4] = lower - p[5] * p[2], max(low - p[5] * deepening, 0.0)
        face = _face_height(grey, _Template(*p[:, None, None])) / p[2]
        p[5] = face / (1 + deepening)
        p[1], p[4] = lower - p[5] * p[2], max(low - p[5] * deepening, 0.0)
    return p


def _edge_offset(
    picture: Edges, template: _Template, along: Array, down: Array, normal: tuple[float, float], reach: float
) -> tuple[Array, Array]:
    """Where the strongest edge lies off the template [px] in the direction `normal`, and how strong it is."""
    steps = np.arange(-reach, reach + 0.25, 0.5)
    half = float(template.half[0, 0])
    u, v = along[:, None] + normal[0] * steps / half, down[:, None] + normal[1] * steps / half
    x, y = (part.astype(np.float32) for part in template.pixel(u, v))
    cos, sin = float(np.cos(template.roll[0, 0])), float(np.sin(template.roll[0, 0]))
    across = (normal[0] * cos - normal[1] * sin, normal[0] * sin + normal[1] * cos)
    gradient = np.abs(
        across[0] * cv2.remap(picture.x, x, y, cv2.INTER_LINEAR)
        + across[1] * cv2.remap(picture.y, x, y, cv2.INTER_LINEAR)
    )
    at = np.argmax(gradient, axis=1)
    rows = np.arange(len(at))
    return steps[at] + 0.5 * _vertex(gradient, rows, at), gradient[rows, at].astype(np.float64)


def _vertex(values: npt.NDArray[np.float32], rows: npt.NDArray[np.int64], at: npt.NDArray[np.int64]) -> Array:
    """Offset, in samples, of the parabola's top through the largest sample and its neighbours."""
    at = np.clip(at, 1, values.shape[1] - 2)
    before, here, after = (values[rows, at + k].astype(np.float64) for k in (-1, 0, 1))
    bend = before - 2 * here + after
    return np.asarray(np.clip(np.where(bend < -1e-9, 0.5 * (before - after) / np.minimum(bend, -1e-9), 0.0), -0.5, 0.5))


def _robust_fit(design: Array, values: Array, weight: Array) -> Array:
    """Weighted least squares with Huber's weights."""
    usual = np.ones_like(values)
    answer = np.zeros(design.shape[1])
    for _ in range(12):
        w = np.sqrt(weight * usual)
        answer = np.asarray(np.linalg.lstsq(design * w[:, None], values * w, rcond=None)[0], dtype=np.float64)
        miss = np.abs(values - design @ answer)
        scale = max(1.4826 * float(np.median(miss)), 0.1)
        usual = np.minimum(1.0, 1.345 * scale / np.maximum(miss, 1e-9))
    return answer


def _face_height(grey: npt.NDArray[np.uint8], template: _Template) -> float:
    """How far [px] the plain face reaches up from the lower rim, along the middle of the disc.

    The front row of beads and its shadow hide the upper rim's edge; where columns stop looking like the face below
    them, the face ends.
    """
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.2)
    along = np.linspace(-0.85, 0.85, 240)
    arc = np.sqrt(1 - along * along)
    half = float(template.half[0, 0])
    low = template.lower_bulge(grey.shape[1]) * arc
    guess = half * float((template.thickness + np.mean(low - template.bulge * arc))[0, 0])
    rows = np.arange(2.0, max(1.8 * guess, guess + 10), 0.5)  # [px] above the lower rim
    x, y = template.pixel(along[None, :], template.thickness + low - rows[:, None] / half)
    values = cv2.remap(smooth, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR).astype(np.float64)
    plain = rows < 0.5 * guess
    change = np.median(np.abs(values - np.median(values[plain], axis=0)), axis=1)
    usual, above = float(np.median(change[plain])), change[~plain]
    # the beads' shadow on the rim is the first thing above the face, and fainter than the beads
    starts = int(np.argmax(above > usual + min(0.5 * (float(above.max()) - usual), max(2 * usual, 6.0))))
    nearby = above[starts : starts + 8]  # the edge itself is as wide as the blur: take its half height
    edge = starts + int(np.argmax(nearby >= (usual + float(nearby.max())) / 2))
    return float(rows[~plain][edge])


def _bounds(beads: Beads, roll: float | None) -> Array:
    low, high = beads.centre.min(axis=0) - beads.radius, beads.centre.max(axis=0) + beads.radius
    reach, middle, foot = (high[0] - low[0]) / 2, (low[0] + high[0]) / 2, high[1]
    turn = (-0.1, 0.1) if roll is None else (roll - 0.01, roll + 0.01)
    return np.array(
        [
            (middle - 0.4 * reach, middle + 0.4 * reach),
            (foot - 0.4 * reach, foot + beads.radius),
            (0.85 * reach, 1.8 * reach),
            turn,
            (0.0, 0.3),  # looking down by up to 17 degrees
            (0.02, 0.5),
        ]
    )


def _score(picture: Edges, alike: npt.NDArray[np.float32], beads: Beads, candidates: Array, samples: int) -> Array:
    """How well candidates, shape (6, n), fit: edges on the outline, beads above the rim and neither below nor beside.

    The lower rim weighs most: it is the longest edge, and nothing stands before it.
    """
    template = _Template(*candidates[..., None])
    lower, left, right, upper, face, heap, spilled = _support(picture, alike, template, beads.radius, samples)
    x, y = beads.centre[:, 0] - template.x, beads.centre[:, 1] - template.y
    along = (x * np.cos(template.roll) + y * np.sin(template.roll)) / template.half
    down = (y * np.cos(template.roll) - x * np.sin(template.roll)) / template.half
    front = template.bulge * np.sqrt(np.clip(1 - along * along, 0, 1))
    below = np.mean(down > front - 0.3 * beads.radius / template.half, axis=1)
    walls = 0.4 * (left + right + np.minimum(left, right))
    return np.asarray(2 * lower + walls + upper + heap - face - spilled - 2 * below)


def _cost(picture: Edges, alike: npt.NDArray[np.float32], beads: Beads, candidates: Array) -> Any:
    return -_score(picture, alike, beads, candidates, 40)


def _support(picture: Edges, alike: npt.NDArray[np.float32], template: _Template, bead: float, samples: int) -> Array:
    """Shares, shape (7, n): edges on lower rim, both walls, upper rim; bead colour on the face, above, beside."""
    height, width = picture.strength.shape
    along = np.linspace(-0.97, 0.97, samples)
    arc = np.sqrt(1 - along * along)
    level = np.ones_like(along)
    low = template.lower_bulge(width)
    upper_y, lower_y = template.bulge * arc, template.thickness + low * arc

    def lookup(u: Array, v: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        x, y = template.pixel(u, v)
        return np.clip(np.rint(y), 0, height - 1).astype(np.int64), np.clip(np.rint(x), 0, width - 1).astype(np.int64)

    def on_edge(u: Array, v: Array, normal_u: Array, normal_v: Array) -> Array:
        at = lookup(u, v)
        cos, sin = np.cos(template.roll), np.sin(template.roll)
        across = picture.x[at] * (normal_u * cos - normal_v * sin) + picture.y[at] * (normal_u * sin + normal_v * cos)
        return np.asarray(np.clip(np.abs(across) / np.hypot(normal_u, normal_v) / picture.strong, 0, 1).mean(axis=1))

    def wall(side: int) -> Array:
        one, zero = np.ones(16), np.zeros(16)
        on, beyond = np.linspace(0.1, 0.9, 16), np.linspace(1.15, 1.7, 16)
        runs_on = on_edge(side * one, template.thickness * beyond, one, zero)
        return on_edge(side * one, template.thickness * on, one, zero) - 0.5 * runs_on

    def bead_colour(u: Array, rows: list[Array]) -> Array:
        return np.asarray(np.mean([alike[lookup(u, row)] for row in rows], axis=(0, 2)))

    above = [-share * bead / template.half for share in (0.5, 1.0, 1.5, 2.0)]
    beside = np.concatenate([np.linspace(-1.3, -1.07, 10), np.linspace(1.07, 1.3, 10)])
    return np.array(
        [
            on_edge(along, lower_y, low * along / arc, level),
            wall(-1),
            wall(1),
            on_edge(along, upper_y, template.bulge * along / arc, level),
            bead_colour(along, [upper_y + share * (lower_y - upper_y) for share in (0.15, 0.35, 0.6, 0.85)]),
            bead_colour(along, [upper_y + row for row in above]),
            bead_colour(beside, above),
        ]
    )
