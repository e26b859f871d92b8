"""Find a bed of beads in a glass cylinder in a photo: walls, floor, outline, and a gauge beside the cylinder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, GreyImage, Image, Mask
from rigtwin.lab.camera import FOCAL_LENGTH, FOCAL_UNCERTAINTY, STATED_SIGMA, Line
from rigtwin.lab.errors import Mark
from rigtwin.measure.bulk.beads import Beads, edges, find_beads, more_beads, rim_radius
from rigtwin.measure.bulk.grain_classes import Grain, grain_classes
from rigtwin.measure.bulk.hidden_surface import covered_columns, glare_in, without_strips
from rigtwin.measure.bulk.outline import Silhouette, View
from rigtwin.measure.bulk.outline_above import surface_between
from rigtwin.measure.geometry.horizon import Level, level_of
from rigtwin.measure.geometry.lines import at, long_lines
from rigtwin.measure.packing.bed_profile import NEARER, READ
from rigtwin.measure.packing.graduations import Gauge, find_gauge, other_sizes
from rigtwin.measure.packing.grain_region import (
    CORE,
    ENDS_AT,
    Straight,
    grain_region,
    sides,
    straightened,
    upright_borders,
)
from rigtwin.measure.scene.contrast_stretch import exposure_of

FINEST = 1000  # [px], longer side of the analysed picture; a bead's edge is read to an eighth of its least radius
NEXT_TO = 2.0  # [bead radii], from the region to the middle of a bead that lies on it
# shares of the width, by which a wall lies beyond the usual end of the grains, as the network sees it: mean and
# standard deviation (22 photos by two path tracers; 0.004 to 0.01 are as good)
WALL_BEYOND, WALL_SPREAD = 0.007, 0.007
# quantile of the ends of the rows, counted from the middle outwards, that is taken for the wall: reflections on the
# glass, shadows and gaps make rows end too early, few things make them end too late (23 path-traced photos: 5 widths
# are off by more than 4 %, with the median 7; 0.65 and 0.85 are nearly as good)
OUTER = 0.75
# share of the width, standard uncertainty of a wall that is found: half of the widths of 17 beds are within 1.1 %
WALL_SIGMA = 0.011
OFF_CENTRE = 0.05  # standard uncertainty of the lens's axis in the picture, which may be cropped, over its longer side
# [bead radii], by which gaps between the lowest grains raise the mean of their lower ends in the middle of the bed:
# settled beds of a DEM, 6 to 16 beads wide, seen from 6 to 17 degrees above; scatter of the ends; standard uncertainty
# of their level
ENDS_GAPS, ENDS_SCATTER, ENDS_LEVEL = 0.18, 0.2, 0.3
# [bead radii], by which the lowest grains seem to end above the floor, since their lower sides lie in their own shadow:
# 0.17 ± 0.05, the mean of 19 path-traced photos beyond what settled beds of a DEM without shadows give
ENDS_SHADED = 0.17
FRONT, BESIDE = 0.4, 1.1  # shares of the radius, by which grains appear below the floor's middle and beside the walls
FEWEST = 25  # least number of beads of a bed
PARTED = 0.1  # least size of a separate part of the bed, as a share of the largest; a hand or a rod may split the bed
ZERO_NEAR = 4.6  # [mm], zero to floor: less than half a centimetre, so that the longer marks identify the zero
ENDS_ABOVE = 4.0  # [mm], graduations may end this far above zero: the gauge's foot and its shadow hide a mark or two
# a gauge is not in the plane of the axis where the beads agree with the cylinder this much better than the gauge does
ELSEWHERE = 0.5
CLEARLY_APART = 0.08  # logarithm of the ratio of their scales, more than beads can decide below
LOOKING = (-0.1, 0.6)  # slope of the line of sight to the floor: from slightly below its level to 30 degrees above
MOST_LEAN = math.radians(7)
# [1], slope of the line of sight to the surface: standard deviation, 6 degrees, assumed (11 photos by a path tracer
# whose cameras were drawn from 0 to 10 degrees: 0.11); the steepest that is tried, 45 degrees
USUAL_SLOPE, STEEPEST = 0.1, 1.0
# [bead diameters], rise of the mean outline where the far side of the bed appears t above its near side:
# hypot(RAISED_FROM, RAISED_BY t) - RAISED_FROM; its scatter, and the part of it that grows with the rise.  Settled beds
# of a DEM, 8 to 22 beads wide, t up to 4 (benchmarks/measure/beds_from_above.py)
RAISED_FROM, RAISED_BY, RAISED_SPREAD, RAISED_SHARE = 0.55, 0.35, 0.05, 0.1
# [bead diameters], height of the arch that the outlines of the same beds have, as they fall a little towards the wall:
# ARCH + hypot(ARCH_FROM, ARCH_BY t) - ARCH_FROM; its scatter is 0.5 there and more in beds that were poured otherwise,
# assumed
ARCH, ARCH_FROM, ARCH_BY, ARCH_SPREAD = 0.3, 0.7, 0.6, 0.7
INSIDE = 0.97  # share of the inner radius in which the outline is searched
# [px], half of the 1 px blur under which edges are searched: shading shifts the clearest edge to one side within the
# blur, by the same amount along the whole outline
EDGE_UNCERTAINTY = 0.6
# least visible share of the surface across the cylinder, and the share from which the mean is trusted: its uncertainty
# has a part for what is hidden
LEAST_SHOWN, MOSTLY_SHOWN = 0.3, 0.75
MOST_BELOW = 0.5  # share of the columns between the walls in which grains may be seen below the floor
HIDDEN_LEVEL = 0.25  # [bead diameters], roughness of the outlines of settled beds


@dataclass(frozen=True)
class Stated:
    """What the user reads off the photo [px], with the standard uncertainty `sigma` of each coordinate."""

    walls: Line | None = None  # both inner walls at the floor, left first
    floor: float | None = None  # row of the floor on the axis
    sigma: float = STATED_SIGMA

    @property
    def options(self) -> str:
        """The options that state the floor, empty where it is found."""
        given = {"--floor": self.floor, "--cylinder": self.walls}
        return " and ".join(option for option, value in given.items() if value is not None)

    def zoomed(self, zoom: float) -> Stated:
        """The same in a picture with `zoom` px per px of the photo."""
        left, right = self.walls or ((0.0, 0.0), (0.0, 0.0))
        walls = ((left[0] * zoom, left[1] * zoom), (right[0] * zoom, right[1] * zoom)) if self.walls else None
        return Stated(walls, None if self.floor is None else self.floor * zoom, self.sigma * zoom)

    @property
    def middle(self) -> tuple[float, float]:
        """Point of the axis at the floor."""
        assert self.walls is not None
        (x1, y1), (x2, y2) = self.walls
        return (x1 + x2) / 2, (y1 + y2) / 2 if self.floor is None else self.floor

    @property
    def half(self) -> float:
        """Radius of the cylinder."""
        assert self.walls is not None
        return math.dist(*self.walls) / 2

    def between(self, shape: tuple[int, ...], share: float) -> Mask:
        """Mask of the pixels within a `share` of the radius of the axis, and above the front of the floor."""
        column, row = self.middle
        across = np.abs(np.arange(shape[1]) - column) < share * self.half
        return np.asarray((np.arange(shape[0]) < row + FRONT * self.half)[:, None] & across)

    def across(self, straight: Straight, lean: float) -> tuple[float, float]:
        """Places of the walls from the middle of the region of grains."""
        assert self.walls is not None
        x, y = straight.centre
        left, right = ((wall[0] - x) * math.cos(lean) - (wall[1] - y) * math.sin(lean) for wall in self.walls)
        return left, right

    def down(self, straight: Straight, lean: float, offset: float) -> float | None:
        """Place of the floor below the middle of the region of grains, on the axis at `offset`."""
        x, y = straight.centre
        if self.walls is not None:
            column, row = self.middle
            return (row - y) * math.cos(lean) + (column - x) * math.sin(lean)
        return None if self.floor is None else (self.floor - y + offset * math.sin(lean)) / math.cos(lean)


@dataclass(frozen=True)
class Bed:
    """A bed in the picture; lengths in px of the analysed picture, rows counted downwards."""

    axis: tuple[float, float]  # point of the axis at the floor
    lean: float  # [rad], of the axis: positive where its foot is further right
    roll: float  # [rad], of the horizontal: positive where it falls to the right
    width: float  # inner width of the cylinder in the plane of its axis
    floor_sigma: float
    bulge: float  # distance of the front of the floor below its middle
    bulge_sigma: float
    bead_radius: float
    bead_seen: float  # bead radius from the picture alone, independent of stated sizes; NaN where no circles are seen
    beyond: float  # share of the beads found that lie outside the walls
    gauge: Gauge | None
    contrast: float  # contrast of the outline over that of the clearest edge in the picture
    outline_uncertainty: float  # standard uncertainty of the mean outline
    flaw: str  # why the outline is unreliable
    longer_side: float  # of the picture
    silhouette: Silhouette = field(repr=False)
    narrowing: float = 0.0  # relative decrease of the bed's width from top to foot
    # roll from upright edges and its standard uncertainty [rad], where another roll is given
    roll_seen: tuple[float, float] | None = None
    stated: Stated = Stated()
    wall_sigma: float = 0.0  # relative standard uncertainty of the width as found, not as stated
    floor_apart: float = 0.0  # [standard uncertainties], of a stated floor below the lowest grains
    elsewhere: float = math.nan  # scale [m/px] of a gauge that was not used over that of the cylinder; NaN: none
    seen_width: float = math.nan  # `width` as seen, also where walls are stated

    @property
    def floor(self) -> float:
        return self.axis[1]

    @property
    def outline(self) -> tuple[Array, Array]:
        """x from the axis and height above the floor, both shape (n,) [px], inside the cylinder."""
        seen = np.isfinite(self.silhouette.height) & (np.abs(self.silhouette.x) < INSIDE * self.width / 2)
        return self.silhouette.x[seen], self.silhouette.height[seen]

    def gauge_rows(self, x: Array, height: Array) -> Array:
        """Rows [px] where horizontal lines through outline points meet the gauge."""
        assert self.gauge is not None
        points = self.silhouette.view.to_picture(x, height)
        rows = points[:, 1].copy()
        for _ in range(3):
            rows = points[:, 1] + (self.gauge.column_at(float(rows.mean())) - points[:, 0]) * math.tan(self.roll)
        return rows

    def raised(self) -> tuple[float, float]:
        """How far the outline lies above that of a horizontal view, and its standard uncertainty [bead diameters].

        A camera above (or below) the surface sees its far (or near) side above its middle.  The front of the floor
        shows the slope of the line of sight at the floor; at the surface it is less, by surface height over camera
        distance.  The far side is an arch in the picture, so the outline shows the slope, too.
        """
        x, height = self.outline
        half, bead = self.width / 2, 2 * self.bead_radius
        focal = FOCAL_LENGTH * self.longer_side
        less = float(np.mean(height)) / focal
        slopes = np.linspace(-STEEPEST, STEEPEST, 801)
        rise = slopes * self.width / bead
        at_floor_sigma = math.hypot(less * FOCAL_UNCERTAINTY, self.bulge_sigma / half)
        misses = [(slopes - (self.bulge / half - less)) / at_floor_sigma, slopes / USUAL_SLOPE]
        read = np.abs(x) < READ * half
        if np.sum(read) > bead:
            arch, scatter = arch_of(x[read] / half, height[read] / bead)
            misses.append((arch - arch_by(rise)) / (ARCH_SPREAD * scatter))
        deviance = np.sum(np.square(misses), axis=0)
        weights = np.exp((np.min(deviance) - deviance) / 2)
        lifted = raised_by(rise)
        mean = float(np.average(lifted, weights=weights))
        spread = math.sqrt(float(np.average((lifted - mean) ** 2, weights=weights)))
        return mean, math.hypot(spread, RAISED_SPREAD, RAISED_SHARE * mean)


def raised_by(rise: npt.ArrayLike) -> Array:
    """Rise of the mean outline where the far side appears `rise` above the near side, both in bead diameters."""
    return np.hypot(RAISED_FROM, RAISED_BY * np.asarray(rise)) - RAISED_FROM


def arch_by(rise: npt.ArrayLike) -> Array:
    """Height of the outline's arch where the far side appears `rise` above the near side, both in bead diameters."""
    return ARCH + np.hypot(ARCH_FROM, ARCH_BY * np.asarray(rise)) - ARCH_FROM


def arch_of(along: Array, height: Array) -> tuple[float, float]:
    """Height of the half ellipse in an outline, and its scatter over that of a surface that is seen whole.

    `along` are places from the axis over the inner radius.
    """

    def terms(places: Array) -> Array:
        return np.column_stack([np.ones(len(places)), places, np.sqrt(1 - places**2)])

    def scatter(places: Array) -> float:
        columns = terms(places)
        step = float(np.median(np.diff(places)))  # neighbours within a bead are not independent
        return math.sqrt(float(np.linalg.inv(columns.T @ columns)[2, 2]) / step)

    whole = np.linspace(-READ, READ, 401)
    found = np.linalg.lstsq(terms(along), height, rcond=None)[0]
    return float(found[2]), max(scatter(along) / scatter(whole), 1.0)


@dataclass(frozen=True)
class NoBed:
    """Why no bed was found, and what was."""

    why: str
    marks: tuple[Mark, ...]  # in pixels of the photo
    advice: str = ""  # what helps, where it is neither a stated place nor a sharper photo


def _no_bed(why: str, beads: Beads | None, zoom: float) -> NoBed:
    circles = [] if beads is None else beads.centre.tolist()
    radius = 0.0 if beads is None else beads.radius / zoom
    return NoBed(why, tuple(Mark("", [(x / zoom, y / zoom)], radius) for x, y in circles))


def find_bed(
    photo: Image,
    *,
    cylinder: float | None,
    bead: float | None,
    roll: float | None = None,
    region: tuple[float, float, float, float] | None = None,
    stated: Stated | None = None,
) -> Bed | NoBed:
    """Find the bed in a photo (BGR), or say why there is none.

    `cylinder` (inner) and `bead` are diameters [m] where known, `stated` are walls and floor read off the photo.
    """
    image, grey, glare, zoom = _analysed(photo)
    stated = (stated or Stated()).zoomed(zoom)
    region = None if region is None else (region[0] * zoom, region[1] * zoom, region[2] * zoom, region[3] * zoom)
    ratio = cylinder / bead if cylinder and bead else None
    classes = grain_classes(without_strips(image, glare))
    alike = np.ascontiguousarray(classes[..., Grain.GRAINS])
    beads, circles = _beads(alike, grey, region, stated, ratio)
    if beads is None or len(beads.centre) < FEWEST:
        why = f"{circles} touching circles of one size were found, {FEWEST} are needed"
        return _no_bed(why, beads if circles else None, zoom)
    upright, roll_seen = _upright(grey, roll)
    region_of_grains, classes = grain_region(classes, beads.radius)
    if not region_of_grains.any():
        return _no_bed(f"no region of grains is wider than {5 * beads.radius / zoom:.0f} px", beads, zoom)
    lean = upright.at(stated.middle[0] if stated.walls else float(np.median(np.nonzero(region_of_grains)[1])))[0]
    straight = straightened(alike, region_of_grains, lean, beads.radius)
    left, right, wall_sigma, seen_width = _walls(image, straight, beads.radius, upright, stated)
    width, offset = right - left, (left + right) / 2
    radius = width / 2 / ratio if ratio else beads.radius
    chosen = _of_the_bed(alike, beads, straight, region_of_grains, (left, right), radius)
    (column, middle), x = straight.centre, (straight.centre[0] + left, straight.centre[0] + right)
    if chosen is None:
        why = f"fewer than {FEWEST} of {_named(beads, circles)} lie between x = {x[0] / zoom:.0f} and"
        return _no_bed(f"{why} {x[1] / zoom:.0f} px", beads, zoom)
    kept, clear, beyond = chosen
    seen_radius = rim_radius(grey, clear) if circles >= FEWEST else math.nan
    ends = _lower_ends(image, classes, straight, (left, right), radius)
    expected = _expected_slope(image.shape, middle + float(np.median(ends[1])), upright)
    known = stated.down(straight, lean, offset)
    floor, floor_sigma, bulge, bulge_sigma = _floor(*ends, width / 2, radius, expected)
    apart = 0.0 if known is None else (known - floor) / math.hypot(floor_sigma, stated.sigma)
    if known is not None:
        floor_sigma, (floor, _, bulge, bulge_sigma) = stated.sigma, _floor(*ends, width / 2, radius, expected, known)
    axis = (
        column + offset * math.cos(lean) + floor * math.sin(lean),
        middle - offset * math.sin(lean) + floor * math.cos(lean),
    )
    horizontal = -upright.at((image.shape[1] - 1) / 2)[0]
    kept = Beads(kept.centre[_filled(kept, alike)], kept.radius)
    found = surface_between(image, classes, View(axis, -lean, width / 2, 0.0, math.inf), kept.radius)
    if found is None:
        why = f"no outline was found above {_named(kept, circles)} between x = {x[0] / zoom:.0f} and"
        return _no_bed(f"{why} {x[1] / zoom:.0f} px", kept, zoom)
    covered = covered_columns(found, alike, np.abs(found.x) < INSIDE * width / 2)
    found = replace(found, height=np.where(covered, np.nan, found.height), zoom=zoom)
    gauge = _gauge(grey, upright, width, (cylinder, bead), beads.radius, axis, horizontal)
    elsewhere = math.nan
    if gauge is not None and cylinder is not None and bead is not None and math.isfinite(seen_radius):
        elsewhere = _elsewhere(gauge.pitch(middle) * width / cylinder, 2 * seen_radius * cylinder / (width * bead))
        gauge = None if math.isfinite(elsewhere) else gauge
    if gauge is not None and known is None:
        row = gauge.row_of(0.0)
        zero = row - (gauge.column_at(row) - axis[0]) * math.tan(horizontal)
        known = floor - (axis[1] - zero) / math.cos(lean)
        _, _, bulge, bulge_sigma = _floor(*ends, width / 2, radius, expected, known)
    bed = Bed(
        axis,
        lean,
        horizontal,
        width,
        floor_sigma,
        bulge,
        bulge_sigma,
        kept.radius,
        seen_radius,
        beyond,
        gauge,
        found.contrast,
        0.0,
        "",
        float(max(image.shape[:2])),
        found,
        _narrowing(straight, beads.radius) / width,
        roll_seen,
        stated,
        wall_sigma,
        apart,
        elsewhere,
        seen_width,
    )
    return _judged(bed, _cut_off(kept, alike), alike)


def _analysed(photo: Image) -> tuple[Image, GreyImage, Mask, float]:
    """The picture that is analysed with its exposure evened out, its brightness, glare in it, and its px per px."""
    zoom = min(1.0, FINEST / max(photo.shape[:2]))
    image = photo
    if zoom < 1:
        image = np.asarray(cv2.resize(photo, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    glare = glare_in(image)
    image = exposure_of(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)).applied(image)
    return image, np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8), glare, zoom


def _of_the_bed(
    alike: FloatImage, beads: Beads, straight: Straight, region: Mask, walls: tuple[float, float], radius: float
) -> tuple[Beads, Beads, float] | None:
    """Circles of the bed, those well inside it, and the share of circles beside it; None if few."""
    away = beads.centre - np.array(straight.centre)
    across = away[:, 0] * math.cos(straight.lean) - away[:, 1] * math.sin(straight.lean)
    down = away[:, 1] * math.cos(straight.lean) + away[:, 0] * math.sin(straight.lean)
    within = (across > walls[0]) & (across < walls[1])
    distance = cv2.distanceTransform(1 - region.astype(np.uint8), cv2.DIST_L2, 3)
    gap = at(np.asarray(distance, dtype=np.float32), beads.centre)
    inside = within & (gap < NEXT_TO * beads.radius)
    if np.sum(inside) < FEWEST:
        return None
    clear = Beads(beads.centre[inside & (gap == 0)], beads.radius)
    kept = Beads(beads.centre[inside], radius if 0.7 < radius / beads.radius < 1.4 else beads.radius)
    inside[inside] = _filled(kept, alike)
    if np.sum(inside) < FEWEST:
        return None
    # count only rows of the bed: round things beside the empty part of the cylinder are not beads beyond a wall
    beside = (down > np.percentile(down[inside], 5)) & (down < np.percentile(down[inside], 95))
    beyond = float(np.mean(~within[beside])) if beside.any() else 0.0
    return Beads(beads.centre[inside], kept.radius), clear, beyond


def _filled(beads: Beads, alike: FloatImage) -> npt.NDArray[np.bool_]:
    """Mask of circles filled with bead-like pixels; marks on the glass also form circles."""
    filled = cv2.GaussianBlur(alike, (0, 0), 0.5 * beads.radius)
    share = at(filled, beads.centre)
    return np.asarray(share > 0.7 * np.median(share))


def _beads(
    alike: FloatImage,
    grey: Image,
    region: tuple[float, float, float, float] | None,
    stated: Stated,
    ratio: float | None,
) -> tuple[Beads | None, int]:
    """Circles in the photo, or between the walls where these are stated, and their number.

    `ratio` is cylinder over bead diameter; with stated walls it gives the size of the circles.  Where few are found
    then, points that look like grains take their place.
    """
    radii = 0.0055 * max(grey.shape), 0.045 * max(grey.shape)
    half = 0.0 if stated.walls is None else stated.half
    between = None if stated.walls is None else stated.between(grey.shape, BESIDE)
    searched = grey
    if between is not None:
        if ratio is not None:
            radii = 0.8 * half / ratio, 1.1 * half / ratio
        searched = np.where(between, grey, np.median(grey)).astype(np.uint8)

    def searched_for(found: Beads) -> Beads:
        centre = found.centre
        if region is not None:
            x, y, width, height = region
            centre = centre[(np.abs(centre - [x + width / 2, y + height / 2]) < [width / 2, height / 2]).all(axis=1)]
        if between is not None:
            centre = centre[at(between.astype(np.float32), centre) > 0]
        return Beads(centre, found.radius)

    beads = find_beads(searched, radii)
    if beads is not None:
        beads = searched_for(more_beads(edges(grey), alike, beads, least_group=PARTED))
    count = 0 if beads is None else len(beads.centre)
    if count < FEWEST and stated.walls is not None and ratio is not None:
        return searched_for(_points_of(alike, stated, ratio)), count
    return beads, count


def _named(beads: Beads, circles: int) -> str:
    """Their number and what they are; `circles` is the number of circles that were found."""
    return f"{len(beads.centre)} {'circles' if circles >= FEWEST else 'points that look like grains'}"


def _points_of(alike: FloatImage, stated: Stated, ratio: float) -> Beads:
    """Points that look like grains between stated walls, a radius apart, in place of circles that were not found.

    `ratio` is cylinder over bead diameter.
    """
    radius = stated.half / ratio
    step = max(round(radius), 1)
    seen = (alike > ENDS_AT) & stated.between(alike.shape, 1.0)
    rows, columns = np.nonzero(seen[::step, ::step])
    return Beads(np.column_stack([columns, rows]).astype(np.float64) * step, radius)


def _upright(grey: Image, roll: float | None) -> tuple[Level, tuple[float, float] | None]:
    """Lean of the vertical at every column, from long upright edges.

    If `roll` is given, also the roll that the edges show and its standard uncertainty [rad].
    """
    turned = np.ascontiguousarray(grey.T).astype(np.float32)
    lines = long_lines(
        turned, np.ones(turned.shape, dtype=bool), steepest=MOST_LEAN, shortest=0.22 * turned.shape[1], most=24
    )
    free = level_of(lines, turned.shape)
    if roll is None:
        return free, None
    seen = free.at((turned.shape[0] - 1) / 2)
    return level_of(lines, turned.shape, -roll), (-seen[0], seen[1]) if free.lines else None


def _walls(
    image: Image, straight: Straight, radius: float, upright: Level, stated: Stated
) -> tuple[float, float, float, float]:
    """Columns of the inner walls from the region's middle [px], the relative standard uncertainty of the width.

    Also the width [px] that is seen, whatever is stated.

    Grains touch the walls, so their ends lie at the inner walls or up to a bead radius within them.  A wall is the
    upright edge whose strength, times the probability of its distance to their outer quartile, is largest: the outer
    face of a wall and whatever stands behind or beside the cylinder have stronger edges, but elsewhere.
    """
    left_ends, right_ends = sides(straight, radius)
    ends = float(np.quantile(left_ends, 1 - OUTER)), float(np.quantile(right_ends, OUTER))
    width = ends[1] - ends[0]
    left, right = (
        _clearest_edge(image, straight, upright, end + sign * WALL_BEYOND * width, WALL_SPREAD * width)
        for sign, end in zip((-1, 1), ends, strict=True)
    )
    if stated.walls is not None:
        return *stated.across(straight, straight.lean), 0.0, right - left
    return left, right, math.sqrt(2) * WALL_SIGMA, right - left


def _clearest_edge(image: Image, straight: Straight, upright: Level, expected: float, spread: float) -> float:
    """Column of an upright edge near the one that is `expected`, both from the region's middle [px]."""
    from scipy.signal import find_peaks, peak_widths

    column = straight.centre[0]
    borders = upright_borders(image, straight, upright.at(column + expected)[0])
    peaks, _ = find_peaks(borders)
    # a blurred edge is several pixels wide: its middle lies between the places where it is 60 % as strong
    _, _, first, last = peak_widths(borders, peaks, rel_height=0.4)
    places = (first + last) / 2 - column
    clear = borders[peaks] * np.exp(-(((places - expected) / spread) ** 2) / 2)
    return float(places[np.argmax(clear)]) if np.any(clear > 0) else expected


def _lower_ends(
    image: Image, classes: FloatImage, straight: Straight, walls: tuple[float, float], radius: float
) -> tuple[Array, Array]:
    """Places across from the axis and down from the region's middle at which the grains end [px], shape (n,) each."""
    (column, middle), lean = straight.centre, straight.lean
    offset, half = (walls[0] + walls[1]) / 2, (walls[1] - walls[0]) / 2
    origin = column + offset * math.cos(lean), middle - offset * math.sin(lean)
    found = surface_between(image, classes, View(origin, math.pi - lean, half, 0.0, math.inf), radius)
    if found is not None:
        # the outermost grains need not touch the floor
        seen = np.isfinite(found.height) & (np.abs(found.x) < half - radius)
        return -found.x[seen], found.height[seen]
    # the bed reaches the lower edge of the picture
    columns = np.nonzero(straight.region.any(axis=0))[0]
    lowest = len(straight.region) - 1 - np.argmax(straight.region[::-1, columns], axis=0)
    return np.asarray(columns - column - offset, dtype=np.float64), np.asarray(lowest - middle, dtype=np.float64)


def _expected_slope(shape: tuple[int, ...], floor: float, upright: Level) -> tuple[float, float]:
    """Slope of the line of sight to the floor [1], seen with the usual focal length, and its standard uncertainty.

    A camera that is tilted down sees uprights converge downwards, by its tilt over its focal length.
    """
    focal = FOCAL_LENGTH * max(shape[:2])
    below, tilt = (floor - shape[0] / 2) / focal, -focal * upright.converging
    sigma = math.hypot(FOCAL_UNCERTAINTY * (tilt - below), focal * upright.converging_sigma, OFF_CENTRE / FOCAL_LENGTH)
    return below + tilt, sigma


def _floor(
    x: Array, y: Array, half: float, radius: float, slope: tuple[float, float], known: float | None = None
) -> tuple[float, float, float, float]:
    """Floor row at the axis, its standard uncertainty, distance of the floor's front below it, its uncertainty [px].

    `x` from the axis and `y` are the lower ends of the grains, `known` is the floor row from a gauge.  The foot of a
    bed seen from above is half an ellipse: of the circle on which the outermost grains touch the floor, a bead radius
    within the wall, rounded by the grains.  Low floor and steep view are separated only by its shape, so the `slope` of
    the view is expected with its standard uncertainty.
    """
    from scipy.optimize import least_squares

    across = np.linspace(-radius, radius, 25)
    rises = radius - np.sqrt(radius**2 - across**2)  # of a grain's lower side, from where it touches the floor
    widest = half - radius
    touching = widest**2 - (np.clip(x, -widest, widest)[:, None] + across) ** 2
    arcs, outside = np.sqrt(np.maximum(touching, 0)) / half, touching < 0
    gaps = (ENDS_SHADED + ENDS_GAPS * (1 - (x / half) ** 2)) * radius

    def foot(bulge: float) -> Array:
        return np.asarray(np.max(np.where(outside, -np.inf, bulge * arcs - rises), axis=1) - gaps)

    scale = ENDS_SCATTER * radius
    # the ends within a bead's width belong to one bead
    worth = math.sqrt(2 * half / (2 * radius) / max(len(x), 1))

    def misses(sought: Array) -> Array:
        floor, bulge = (sought[0], sought[1]) if known is None else (known, sought[0])
        off = (y - floor - foot(bulge)) / scale
        # Cauchy: a missed bead ends higher, a shadow or a reflection lower
        return np.append(worth * np.sqrt(2 * np.log1p(off**2 / 2)), (bulge / half - slope[0]) / slope[1])

    bulge = slope[0] * half
    start = [float(np.median(y - foot(bulge))), bulge] if known is None else [bulge]
    found = least_squares(misses, start)
    slopes = np.asarray(found.jac)
    sigma = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    if known is None:
        return float(found.x[0]), math.hypot(float(sigma[0]), ENDS_LEVEL * radius), float(found.x[1]), float(sigma[1])
    return known, 0.0, float(found.x[0]), float(sigma[0])


def _narrowing(straight: Straight, radius: float) -> float:
    """Decrease of the bed's width [px] from top to foot that is certain: twice that of the side that slants less.

    Beads missed in glare or at one wall make one side slant.  The walls of a bin or the flanks of a heap slant both.
    """
    from scipy.stats import theilslopes

    slants = []
    for sign, ends in zip((1, -1), sides(straight, radius), strict=True):
        # a row of beads for every radius of height: neighbours lie in each other's gaps
        each = np.linspace(0, len(ends) - 1, max(round(len(ends) / radius), 3)).astype(int)
        _, _, low, high = theilslopes(sign * ends[each], each / (len(ends) - 1))
        slants.append(min((low, high), key=abs) if low * high > 0 else 0.0)
    slant = min(slants, key=abs) if slants[0] * slants[1] > 0 else 0.0
    return 2 * float(slant) / (CORE[1] - CORE[0])


def _gauge(
    grey: Image,
    upright: Level,
    width: float,
    sizes: tuple[float | None, float | None],
    bead_radius: float,
    axis: tuple[float, float],
    horizontal: float,
) -> Gauge | None:
    """Find the gauge beside the cylinder; `sizes` [m] are the stated diameters of cylinder and beads, one is needed."""
    cylinder, bead = sizes
    if cylinder is None and bead is None:
        return None
    # expected size of a millimetre [px]
    pixel = width / (cylinder * 1e3) if cylinder else 2 * bead_radius / (bead or 1.0) / 1e3
    walls, gap = (axis[0] - width / 2, axis[0] + width / 2), 0.06 * width
    columns = np.concatenate([np.arange(4, walls[0] - gap, 3.0), np.arange(walls[1] + gap, grey.shape[1] - 4, 3.0)])

    def clearest(sizes: Sequence[float]) -> Gauge | None:
        found = []
        for side in (columns < walls[0], columns > walls[1]):
            mine = columns[side]
            if len(mine) < 4:
                continue
            lean = np.array([upright.at(column)[0] for column in mine])
            floor = axis[1] + (float(mine.mean()) - axis[0]) * math.tan(horizontal)
            upper = mine - np.tan(lean) * grey.shape[0] / 2
            found += [find_gauge(grey, upper, lean, size, floor, ZERO_NEAR) for size in sizes]
        return max((each for each in found if each is not None), key=lambda each: each.strength, default=None)

    return clearest([pixel]) or clearest(other_sizes(pixel, len(grey)))


def _elsewhere(gauge: float, beads: float) -> float:
    """Scale [m/px] of the gauge over that of the cylinder, if the gauge is not in the plane of the axis, or NaN.

    `gauge` is this ratio, `beads` the beads' apparent diameter over that expected from the cylinder.  Where beads and
    gauge both disagree with the cylinder, its stated diameter may be wrong, and the gauge counts.
    """
    by_gauge, by_beads = abs(math.log(gauge)), abs(math.log(beads / NEARER))
    return gauge if by_gauge > CLEARLY_APART and by_beads < ELSEWHERE * by_gauge else math.nan


def _cut_off(beads: Beads, alike: FloatImage) -> bool:
    """Whether the bed reaches the lower edge of the picture, so that the floor is not visible."""
    height = len(alike)
    lowest = float(beads.centre[:, 1].max()) + beads.radius
    if lowest < height - 2 * beads.radius:  # a row of beads cut by the edge may not be detected
        return False
    left, right = (max(round(float(end)), 0) for end in np.percentile(beads.centre[:, 0], (5, 95)))
    edge = alike[height - max(2, round(beads.radius / 4)) :, left : right + 1]
    return bool(np.mean(edge) > 0.5 * np.median(at(alike, beads.centre)))


def _grains_below(bed: Bed, alike: FloatImage) -> float:
    """Share of the columns between the walls in which grains are seen below the floor."""
    across = np.arange(-INSIDE * bed.width / 2, INSIDE * bed.width / 2)
    down = np.arange(bed.bulge + 2 * bed.bead_radius, bed.bulge + 12 * bed.bead_radius)
    (x, y), (cos, sin) = bed.axis, (math.cos(bed.lean), math.sin(bed.lean))
    columns = (x + across * cos + down[:, None] * sin).astype(np.float32)
    rows = (y - across * sin + down[:, None] * cos).astype(np.float32)
    seen = cv2.remap(alike, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return float(np.mean(np.sum(seen > ENDS_AT, axis=0) > 0.5 * bed.bead_radius))


def _judged(bed: Bed, cut_off: bool, alike: FloatImage) -> Bed | NoBed:
    """The bed with the uncertainty and flaws of its outline, or why too little of the surface is visible."""
    found = bed.silhouette
    seen = np.abs(found.x) < INSIDE * bed.width / 2
    known = seen & np.isfinite(found.height)
    shown = float(np.sum(known) / np.sum(seen))
    if shown < LEAST_SHOWN:
        points = found.view.to_picture(found.x, np.asarray(found.height)) / found.zoom
        return NoBed(
            f"the surface of the bed was found over {100 * shown:.0f} % of the cylinder's {bed.width / found.zoom:.0f} "
            f"px, {100 * LEAST_SHOWN:.0f} % are needed",
            (Mark("surface", points.tolist()),),
            "photograph the bed without glare and with nothing before its surface",
        )
    apart = np.abs(found.looser[known] - found.stricter[known])
    uncertainty = 0.15 * float(np.nanmean(np.minimum(apart, 4 * bed.bead_radius))) + EDGE_UNCERTAINTY
    flaw = ""
    by_zero = bed.gauge is not None and bed.stated.walls is None and bed.stated.floor is None
    middle = float(np.mean(bed.gauge_rows(*bed.outline))) if bed.gauge is not None else 0.0
    if cut_off:
        flaw = "the bed reaches the lower edge of the picture, so the floor is not visible"
    elif _grains_below(bed, alike) > MOST_BELOW:
        floor = f"stated floor ({bed.stated.options})" if bed.stated.options else "floor as found"
        flaw = f"grains are seen below the {floor}: something stands before the foot of the bed, or mirrors it"
        flaw += ", or the floor lies lower" if bed.stated.options else ""
    elif bed.gauge is not None and not bed.gauge.first - bed.bead_radius < middle < bed.gauge.last + bed.bead_radius:
        flaw = "the gauge's graduations are hidden at the height of the surface: something may be in front of both"
    elif by_zero and bed.gauge is not None and float(bed.gauge.reading(bed.gauge.lowest)) > ENDS_ABOVE:
        flaw = "the gauge's graduations end above the supposed zero: they are hidden, or the gauge was misread"
    elif by_zero and not LOOKING[0] < bed.bulge / (bed.width / 2) < LOOKING[1]:
        flaw = "the lowest beads do not lie at the gauge's zero: the floor is hidden, or the gauge was misread"
    elif shown < MOSTLY_SHOWN:
        flaw = f"the surface is hidden in more than {100 * (1 - MOSTLY_SHOWN):.0f} % of the cylinder's width"
    elif found.contrast < 0.25:
        flaw = "the outline has hardly any contrast to the background"
    # the hidden part may lie higher or lower by the roughness of a bed
    hidden = HIDDEN_LEVEL * 2 * bed.bead_radius * math.sqrt(max(1 - shown, 0.0))
    return replace(bed, outline_uncertainty=math.hypot(uncertainty, hidden), flaw=flaw)
