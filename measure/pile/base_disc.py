"""Find the round base under a heap: ends of its rim, roll, and how steeply the camera looks down on it.

The base is a disc seen from slightly above.  Its front rim is half an ellipse, its lower edge another half ellipse
below, its sides are two vertical walls.  This template is fitted by differential evolution: its lines are edges of the
picture, and its regions, that is the heap, the top that the heap leaves free, the face below the rim and the background
around them, have the classes that a network gives (`rigtwin.measure.bulk.grain_classes`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, GreyImage
from rigtwin.measure.bulk.beads import Edges, edges
from rigtwin.measure.bulk.grain_classes import Grain, most_grains
from rigtwin.measure.bulk.outline import Disc
from rigtwin.measure.robust import mad_std

Numbers = npt.NDArray[np.floating[Any]]  # single or double precision; candidates are evaluated in single precision

LEAST_SUPPORT = 0.5  # least share of lower rim and walls on edges, else another thing may have been found
# least mean probability that the regions of the template are what they should be: 0.87 to 0.98 in 25 photos by two path
# tracers, 0.73 where the grains are cubes
LEAST_FIT = 0.7
CANDIDATES, GENERATIONS = 120, (35, 35)  # of the first search and of the final one
MARGIN = 0.1  # [widths], by which the base's ends may lie elsewhere than the classes say
LEAST_BASE = 0.02  # pixels of the base per pixel of grains, else none is seen
# of the first search and of the final one: width of edges [px], points along a rim, points in a region; with final
# edges of 0.9 px, 2 noisy photos of 23 by two path tracers lost their base
SPREADS, SAMPLES, POINTS = (2.5, 1.2), (20, 40), (32, 96)
RIDGE_BLUR = 1.2  # [px], of the picture in which ridges are searched: noise of single pixels makes none
WORKED = 500  # [px], width of the picture of the classes
LEADERS = 12  # best candidates around which mutants are made
CROSSED = 0.7  # crossover probability per number of a candidate
ALIKE = 1e-3  # relative spread of the costs at which a search stops
RUNNING_ON = 0.5  # weight of edges that continue beyond the end of a wall
MOST_ROLL = 0.1  # [rad], largest roll of camera or base if none is stated
BASE_LEANS = 0.02  # [rad], largest tilt of the base beyond a stated roll
THICK = 1.5  # cost of thickness, per half width: bases are plates
FLATTEST, STEEPEST = 0.25, 1.0  # slopes [1] that every heap exceeds, and that none reaches
LIT = 4.0  # [grey level], least brightness of a lit top above the face
SHADOW = 0.3  # of the largest darkening above the face: shadows on the face itself are fainter
EDGE_ROWS = 8  # [half pixels], width of an edge blurred by the lens


GRAINS, BASE, NEITHER = range(3)  # columns of the classes of `_Cost`


@dataclass(frozen=True)
class _Template:
    """Candidates for the disc; each field has shape (candidates, 1), lengths in half widths unless stated.

    The reference is the lower rim, which nothing hides.
    """

    x: Numbers  # [px], midpoint between the lower rim's ends
    y: Numbers  # [px], likewise
    half: Numbers  # [px]
    roll: Numbers  # [rad]
    low: Numbers  # distance of the front of the lower rim below the line between its ends
    thickness: Numbers

    def pixel(self, along: Numbers, down: Numbers) -> tuple[Numbers, Numbers]:
        """Picture point of a template point, given in half widths from the middle of the lower rim."""
        cos, sin = np.cos(self.roll), np.sin(self.roll)
        x, y = along * cos - down * sin, along * sin + down * cos
        x *= self.half
        x += self.x
        y *= self.half
        y += self.y
        return x, y

    def bulge(self, focal_length: float) -> Array:
        """Bulge of the upper rim; its view is less steep than that of the lower rim by thickness over distance."""
        near = nearness(self.half, focal_length)
        return np.asarray(np.maximum(self.low - self.thickness * near / (1 - near * near), 0))


def _ridges(grey: GreyImage) -> npt.NDArray[np.float32]:
    """Edges of a picture one pixel wide: unit vectors across them times their clearness, shape (height, width, 2).

    The gradient across a strong edge, which a lens has blurred, is high over many pixels; its ridge lies on the edge.
    """
    seen = edges(grey, blur=RIDGE_BLUR)
    rows, columns = np.indices(seen.strength.shape, dtype=np.float32)
    across = seen.both / np.maximum(seen.strength, 1e-9)[..., None]
    ridge = seen.strength > seen.noise
    for side in (-1, 1):
        x, y = columns + side * across[..., 0], rows + side * across[..., 1]
        ridge &= seen.strength >= cv2.remap(seen.strength, x, y, cv2.INTER_LINEAR)
    clearness = np.where(ridge, np.minimum(seen.strength / seen.strong, 1), 0)
    return np.asarray(across * clearness[..., None], dtype=np.float32)


def _lines(ridges: npt.NDArray[np.float32], spread: float) -> Edges:
    """Ridges that fall off to both sides as a Gaussian of sigma `spread` [px], from 1 on clear straight edges."""
    # the filter leaves 1 / (sqrt(2 pi) sigma) of a straight line
    lines = np.asarray(math.sqrt(2 * math.pi) * spread * cv2.GaussianBlur(ridges, (0, 0), spread), dtype=np.float32)
    x, y = lines[..., 0], lines[..., 1]
    return Edges(x, y, np.hypot(x, y), noise=0.0, strong=1.0)


def nearness(half: Numbers, focal_length: float) -> Array:
    """Disc radius over camera distance, from half its width and the focal length, both in px."""
    return np.asarray(np.minimum(half / focal_length, 0.5))


def find_disc(classes: FloatImage, grey: GreyImage, *, focal_length: float, roll: float | None) -> Disc | None:
    """Find the disc under a heap; None if none is visible.

    `classes` are the probabilities of the classes `Grain`, shape (height, width, 4), `grey` is the brightness,
    `focal_length` [px], `roll` [rad] the stated roll of the camera.  A stated roll only widens the search, to both
    sides, so that the fitted roll can be used to check it and its sign.
    """
    bounds = _bounds(classes, roll)
    if bounds is None:
        return None
    ridges = _ridges(grey)
    costs = [
        _Cost.of(classes, _lines(ridges, spread), points, focal_length, samples)
        for spread, points, samples in zip(SPREADS, POINTS, SAMPLES, strict=True)
    ]
    place = _search(costs, bounds)
    candidate, fit = _candidate(place), costs[-1].fit(place)
    # the search takes the shadows of the front beads for the rim, which lies below them where the face ends; a face
    # that seems to end above the rim that was found goes on in a top of its colour
    candidate[5] *= min(_face_share(grey, _Template(*candidate[:, None, None]), focal_length), 1.0)
    template = _Template(*candidate[:, None, None])
    lower, left, right, *_ = _support(costs[-1].picture, template, focal_length, 160)[:, 0]
    support = (2 * lower + left + right) / 4
    if support < LEAST_SUPPORT or fit < LEAST_FIT:
        return None
    _, _, half, turn, _, thickness = (float(value) for value in candidate)
    x, y = (float(part[0, 0]) for part in template.pixel(np.zeros((1, 1)), -template.thickness))
    bulge, near = float(template.bulge(focal_length)[0, 0]), float(nearness(template.half, focal_length)[0, 0])
    return Disc((x, y), half, turn, bulge * half, thickness * half, near, float(support), fit, float(lower))


def _search(costs: Sequence[_Cost], bounds: Array) -> Array:
    """Candidate with the least cost: among wide edges, then among narrow ones."""
    population: Array | None = None
    for cost, generations in zip(costs, GENERATIONS, strict=True):
        population, energies = _evolved(cost, bounds, population, generations)
    assert population is not None
    return np.asarray(population[np.argmin(energies)])


def _evolved(
    cost: Callable[[Array], Array], bounds: Array, start: Array | None, generations: int
) -> tuple[Array, Array]:
    """Minimise by differential evolution, best/1/bin (Storn and Price 1997).

    Returns the population, shape (candidates, numbers), and its costs.  Mutants are made around several leaders (Zhang
    and Sanderson 2009): around the best alone a population may converge on an edge that is not the disc's.

    `bounds` has shape (numbers, 2).  `start` holds the first population; if None it fills the bounds evenly.
    """
    random = np.random.default_rng(len(bounds))
    low, span, size = bounds[:, 0], np.maximum(np.diff(bounds, axis=1), 1e-12)[:, 0], len(bounds)
    if start is None:  # a Latin hypercube
        rows = np.argsort(random.random((CANDIDATES, size)), axis=0)
        population = (rows + random.random(rows.shape)) / CANDIDATES
    else:
        population = np.clip((start - low) / span, 0, 1)
    count = len(population)
    energies = cost((low + span * population).T)
    for _ in range(generations):
        one, other = population[random.integers(0, count, (2, count))]
        leader = population[np.argsort(energies)[random.integers(0, LEADERS, count)]]
        mutant = leader + random.uniform(0.5, 1) * (one - other)
        crossed = random.random(population.shape) < CROSSED
        crossed[np.arange(count), random.integers(0, size, count)] = True
        trial = np.where(crossed, mutant, population)
        trial = np.where((trial < 0) | (trial > 1), random.random(trial.shape), trial)
        found = cost((low + span * trial).T)
        better = found <= energies
        population[better], energies[better] = trial[better], found[better]
        if np.std(energies) <= ALIKE * abs(np.mean(energies)):
            break
    return low + span * population, energies


def _candidate(place: Array) -> Array:
    """Fields of a template from the searched numbers: x of both ends, y of the lower rim's front, and the rest.

    In these numbers each edge depends on as few of them as possible, which helps the search.
    """
    left, right, front, roll, low, thickness = place
    half = (right - left) / (2 * np.cos(roll))
    middle = np.array([(left + right) / 2, front])
    return np.array(
        [middle[0] + low * half * np.sin(roll), middle[1] - low * half * np.cos(roll), half, roll, low, thickness]
    )


def _face_share(grey: GreyImage, template: _Template, focal_length: float) -> float:
    """Height of the plain face as a share of the template's, read along its whole front.

    The front row of beads partly hides the edge of the upper rim, and its shadow lies on the face.  If at least every
    fourth column shows a strip of the lit top, the rim is the lower edge of that strip.  Otherwise the face ends where
    columns no longer look like the face below them.
    """
    along = np.linspace(-0.9, 0.9, 320)
    arc = np.sqrt(1 - along * along)
    half, low = float(template.half[0, 0]), template.low * arc
    tall = template.thickness + low - template.bulge(focal_length) * arc  # the middle of the face is nearer
    guess = half * float(np.max(tall))
    rows = np.arange(2.0, max(1.8 * guess, guess + 10, 12), 0.5)  # [px] above the lower rim, at the tallest column
    x, y = template.pixel(along[None, :], low - rows[:, None] / guess * tall)
    # noise averages out over the columns, so no smoothing is needed that would widen a strip of one or two pixels
    values = cv2.remap(grey.astype(np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    plain = rows < max(0.5 * guess, 2.5)  # at least the first row of a very thin face
    light = np.median(values[plain], axis=0)
    unlit = light < _usual(light) + LIT
    change = (values - light)[:, unlit]
    dark, bright = np.percentile(change, (25, 75), axis=1) * np.array([[-1.0], [1.0]])
    dark, bright = (each - np.median(each[plain]) for each in (dark, bright))
    faint = SHADOW * float(dark.max())
    ends, lit = _first_edge(dark, plain, faint), _first_edge(bright, plain, LIT)
    # below a lit top every fourth column still shows the face; brightness behind darker columns is a bead
    if lit is not None and dark[round(lit)] < dark.max() / 2 and bright[: round(lit)].min() > -max(faint, LIT):
        ends = lit
    return 1.0 if ends is None else float(np.interp(ends, np.arange(len(rows)), rows)) / guess


def _usual(light: Array) -> float:
    """Upper limit of the grey levels of a face's columns outside lamp reflections."""
    return float(np.median(light)) + 3 * mad_std(light)


def _first_edge(departure: Array, plain: npt.NDArray[np.bool_], least: float) -> float | None:
    """Row at which a departure from the plain rows first rises by half an edge; None if it nowhere does.

    An edge rises within `EDGE_ROWS`; light that falls off along the face changes more slowly.
    """
    first, usual = int(np.sum(plain)), float(np.std(departure[plain]))
    earlier = np.concatenate([np.full(EDGE_ROWS, departure[0]), departure[:-EDGE_ROWS]])
    (clear,) = np.nonzero((departure - earlier)[first:] > max(least, 4 * usual, 2.0))
    if len(clear) == 0:
        return None
    start = first + int(clear[0])
    level = (float(departure[start : start + EDGE_ROWS].max()) + float(earlier[start])) / 2
    row = start
    while row > first and departure[row - 1] >= level:
        row -= 1
    while departure[row] < level:
        row += 1
    before = float(departure[row - 1])
    # the last plain row may also reach the level: the edge then lies there
    return row - min((float(departure[row]) - level) / max(float(departure[row]) - before, 1e-9), 1.0)


def _bounds(classes: FloatImage, roll: float | None) -> Array | None:
    """Limits of the numbers of `_candidate`, shape (6, 2), around the base under most grains; None if there is none."""
    region = most_grains(classes)
    if region is None:
        return None
    kind = np.argmax(classes, axis=2)
    seen = region & (kind == Grain.BASE)
    if np.sum(seen) < LEAST_BASE * np.sum(region & (kind == Grain.GRAINS)):
        return None
    columns, rows = np.nonzero(seen.any(axis=0))[0], np.nonzero(seen.any(axis=1))[0]
    left, right, front = float(columns[0]), float(columns[-1] + 1), float(rows[-1] + 1)
    turn, slack = max(MOST_ROLL, abs(roll or 0.0) + BASE_LEANS), MARGIN * (right - left)
    return np.array(
        [
            (left - slack, left + slack),
            (right - slack, right + slack),
            (front - slack, front + slack),
            (-turn, turn),
            (0.0, 0.4),  # camera looking down by up to 20 degrees
            (0.012, 0.4),
        ]
    )


@dataclass(frozen=True)
class _Region:
    """Part of the template and its surroundings, by points; lengths in half widths."""

    kinds: tuple[int, ...]  # classes that it may have
    weight: float
    place: Callable[[Numbers, _Outline], Numbers]  # how far below the middle of the lower rim points at a height lie
    along: Numbers  # from the axis
    height: Numbers


@dataclass(frozen=True)
class _Outline:
    """Lines of candidates at the points of a region, counted downwards, each of shape (candidates, points)."""

    middle: Numbers  # of the upper rim, between its ends
    front: Numbers  # of the upper rim
    lower: Numbers  # front of the lower rim


def _above_middle(height: Numbers, at: _Outline) -> Numbers:
    return np.asarray(at.middle - height)


def _above_front(height: Numbers, at: _Outline) -> Numbers:
    return np.asarray(at.front - height)


def _below_lower(height: Numbers, at: _Outline) -> Numbers:
    return np.asarray(at.lower + height)


def _on_face(share: Numbers, at: _Outline) -> Numbers:
    return np.asarray(at.front + share * (at.lower - at.front))


def _on_top(share: Numbers, at: _Outline) -> Numbers:
    """From the front of the upper rim to its back, which lies as far above the middle."""
    return np.asarray(at.front + 2 * share * (at.middle - at.front))


def _regions(count: int) -> tuple[_Region, ...]:
    """What has a class that is known: the core of the heap, the top of the base beside it, its face, and around them.

    Each has `count` evenly distributed points.
    """
    grid = np.stack([_radical_inverse(16 * count, base) for base in (2, 3)], axis=1)

    def spread(along: tuple[float, float], height: tuple[float, float]) -> tuple[Array, Array]:
        """Points to both sides, their distance from the axis and their height between the given limits."""
        outer = 2 * grid[:, 0] - 1
        distance = along[0] + (along[1] - along[0]) * np.abs(outer)
        return np.sign(outer) * distance, height[0] + (height[1] - height[0]) * grid[:, 1]

    def one_side(left: float, right: float) -> tuple[Array, Array]:
        return left + (right - left) * grid[:, 0], 0.1 + 0.8 * grid[:, 1]

    def first(points: tuple[Array, Array], kept: npt.NDArray[np.bool_] | None = None) -> tuple[Numbers, Numbers]:
        along, height = (part if kept is None else part[kept] for part in points)
        return along[:count].astype(np.float32), height[:count].astype(np.float32)

    core, sky = spread((0.0, 0.6), (0.0, 0.2)), spread((0.0, 1.5), (0.02, 0.9))
    in_core = core[1] < FLATTEST * (0.7 - np.abs(core[0]))
    in_sky = sky[1] > STEEPEST * (1.15 - np.abs(sky[0]))
    return (
        _Region((GRAINS,), 1.0, _above_middle, *first(core, in_core)),
        _Region((GRAINS, BASE), 1.0, _on_top, *first(spread((0.8, 0.985), (0.1, 0.9)))),
        _Region((NEITHER,), 2.0, _above_front, *first(sky, in_sky)),
        _Region((NEITHER,), 1.0, _above_front, *first(spread((1.03, 1.25), (0.0, 0.12)))),  # beside the heap
        _Region((NEITHER,), 1.5, _on_face, *first(spread((1.03, 1.2), (0.0, 1.0)))),  # beside the face
        _Region((BASE,), 2.0, _on_face, *first(spread((0.0, 0.92), (0.1, 0.9)))),
        _Region((BASE,), 0.7, _on_face, *first(one_side(-0.985, -0.88))),  # the ends of the face
        _Region((BASE,), 0.7, _on_face, *first(one_side(0.88, 0.985))),
        _Region((NEITHER,), 1.0, _below_lower, *first(spread((0.0, 0.9), (0.02, 0.1)))),
    )


def _radical_inverse(count: int, base: int) -> Array:
    """One coordinate of `count` points of the Halton sequence, in 0 to 1.

    As `scipy.stats.qmc.Halton` without scrambling; importing `scipy.stats` takes a quarter of the time of a photo.
    """
    left, share, found = np.arange(count), 1.0, np.zeros(count)
    while left.any():
        share /= base
        found += share * (left % base)
        left //= base
    return found


@dataclass(frozen=True)
class _Cost:
    """Cost of candidates: edges on their lines, classes of their regions.

    The lower rim has the largest weight among the edges: it is the longest, and nothing stands in front of it.
    """

    picture: Edges
    classes: FloatImage  # probability of grains, of the base and of neither, shape (height, width, 3), reduced
    zoom: float  # px of the classes per px of the picture
    regions: tuple[_Region, ...]
    focal_length: float
    samples: int  # points along a rim

    @classmethod
    def of(cls, classes: FloatImage, picture: Edges, points: int, focal_length: float, samples: int) -> _Cost:
        """`points` are those of each region, `samples` those along a rim."""
        zoom = min(1.0, WORKED / classes.shape[1])
        some = classes[..., Grain.GRAINS : Grain.BASE + 1]
        small = cv2.resize(some, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA)
        three = np.dstack([small, 1 - small.sum(axis=2)])
        return cls(picture, np.asarray(three, dtype=np.float32), zoom, _regions(points), focal_length, samples)

    def __call__(self, places: Array) -> Array:
        """Cost of places, shape (6, n), in the numbers of `_candidate`."""
        template = _Template(*_candidate(places).astype(np.float32)[..., None])
        lower, left, right, upper, uneven = _support(self.picture, template, self.focal_length, self.samples)
        score = 2 * lower + 0.45 * (left + right + np.minimum(left, right)) + 0.5 * upper - uneven
        return np.asarray(THICK * template.thickness[:, 0] - score - self._fit(template))

    def fit(self, place: Array) -> float:
        """Weighted mean probability that the regions of a place, shape (6,), have the classes that they should have."""
        template = _Template(*_candidate(place[:, None]).astype(np.float32)[..., None])
        return float(self._fit(template)[0]) / sum(region.weight for region in self.regions)

    def _fit(self, template: _Template) -> Array:
        """Sum over the regions of weight times mean probability of the class that they should have, shape (n,)."""
        bulge = template.bulge(self.focal_length)
        x, y = [], []
        for region in self.regions:
            arc = np.sqrt(np.maximum(1 - region.along * region.along, 0))
            at = _Outline(-template.thickness, bulge * arc - template.thickness, template.low * arc)
            place = template.pixel(region.along[None, :], region.place(region.height, at))
            x.append(place[0])
            y.append(place[1])
        map_x, map_y = (np.asarray(self.zoom * np.concatenate(part, axis=1), dtype=np.float32) for part in (x, y))
        seen = cv2.remap(self.classes, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        fit, start = np.zeros(len(map_x)), 0
        for region in self.regions:
            end = start + len(region.along)
            fit += region.weight * seen[:, start:end][..., region.kinds].sum(axis=2).mean(axis=1)
            start = end
        return fit


def _support(picture: Edges, template: _Template, focal_length: float, samples: int) -> Array:
    """Shares on edges, shape (5, n): lower rim, both walls, upper rim, and lines across the face."""
    along = np.linspace(-0.97, 0.97, samples, dtype=np.float32)
    some = along[::2]  # for what is read in several rows
    bulge = template.bulge(focal_length)

    def rim(hang: Numbers, u: Numbers) -> Numbers:
        return np.asarray(hang * np.sqrt(1 - u * u))

    def slope(hang: Numbers, u: Numbers) -> Numbers:
        return np.asarray(hang * u / np.sqrt(1 - u * u))

    upper, lower = rim(bulge, some) - template.thickness, rim(template.low, some)
    on, beyond = (np.linspace(*ends, 8, dtype=np.float32) for ends in ((-0.9, -0.1), (0.15, 0.9)))
    walls = [(side * np.ones_like(part), template.thickness * part, None) for side in (-1, 1) for part in (on, beyond)]
    low, high, left, left_on, right, right_on, *uneven = _on_edges(
        picture,
        template,
        [
            (along, rim(template.low, along), slope(template.low, along)),
            (along, rim(bulge, along) - template.thickness, slope(bulge, along)),
            *walls,
            *((some, upper + share * (lower - upper), slope(template.low, some)) for share in (0.3, 0.5, 0.7)),
        ],
    )
    return np.array(
        [
            low,
            left - RUNNING_ON * left_on,
            right - RUNNING_ON * right_on,
            high,
            # the row with the fewest edges counts half: edges of the rims fill a very thin face
            (np.mean(uneven, axis=0) + np.min(uneven, axis=0)) / 2,
        ]
    )


def _on_edges(picture: Edges, template: _Template, lines: Sequence[tuple[Numbers, Numbers, Numbers | None]]) -> Array:
    """Share of lines that lies on edges along them, shape (lines, n).

    Each line is given by coordinates along and down the template and by its slope (None: vertical).  All lines are read
    in one call, because a search evaluates thousands of candidates.
    """
    x, y, starts = _laid_out(template, [line[:2] for line in lines])
    seen = cv2.remap(picture.both, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    cos, sin = np.cos(template.roll), np.sin(template.roll)
    across, down = seen[..., 0] * cos + seen[..., 1] * sin, seen[..., 1] * cos - seen[..., 0] * sin
    clear = np.empty_like(across)
    for (_, _, falls), part in zip(lines, _parts(starts, x.shape[1]), strict=True):
        if falls is None:
            clear[:, part] = across[:, part]
        else:
            clear[:, part] = (falls * across[:, part] + down[:, part]) / np.sqrt(1 + falls * falls)
    np.minimum(np.abs(clear, out=clear), picture.strong, out=clear)
    return _means(clear, starts) / picture.strong


def _means(values: npt.NDArray[Any], starts: Sequence[int]) -> Array:
    """Mean of each line's samples, shape (lines, n)."""
    sizes = np.diff([*starts, values.shape[1]])
    return np.asarray((np.add.reduceat(values, starts, axis=1) / sizes.astype(np.float32)).T)


def _laid_out(
    template: _Template, lines: Sequence[tuple[Numbers, Numbers]]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], list[int]]:
    """Picture points of all lines side by side, shape (n, samples), and the index where each line begins."""
    *starts, end = itertools.accumulate((line[0].shape[-1] for line in lines), initial=0)
    laid = np.empty((2, len(template.x), end), dtype=np.float32)
    for line, part in zip(lines, _parts(starts, end), strict=True):
        laid[0, :, part], laid[1, :, part] = line
    x, y = (np.asarray(each, dtype=np.float32) for each in template.pixel(laid[0], laid[1]))
    return x, y, starts


def _parts(starts: Sequence[int], end: int) -> list[slice]:
    return [slice(*ends) for ends in itertools.pairwise([*starts, end])]
