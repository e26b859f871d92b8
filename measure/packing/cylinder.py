"""Find a bed of beads in a glass cylinder in a photo: walls, floor, outline, and a gauge beside the cylinder."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image
from rigtwin.measure.bulk.beads import Beads, edges, find_beads, likeness, more_beads, rim_radius
from rigtwin.measure.bulk.hidden_surface import covered_columns, glare_in
from rigtwin.measure.bulk.outline import Silhouette, View, outline_of
from rigtwin.measure.geometry.horizon import Level, level_of
from rigtwin.measure.geometry.lines import at, long_lines
from rigtwin.measure.packing.graduations import Gauge, find_gauge
from rigtwin.measure.robust import mad_std
from rigtwin.measure.scene.contrast_stretch import exposure_of

COARSE = 900  # [px], longer side of the reduced picture that is searched for beads
FEWEST = 25  # least number of beads of a bed
PARTED = 0.1  # least size of a separate part of the bed, as a share of the largest; a hand or a rod may split the bed
WALL_TO_WALL = 3  # beads; a row with fewer does not show both walls
LAYERED = 6  # least number of rows, one radius apart (about four layers): single layers differ in width
FEWEST_ROWS = 3  # rows, one bead radius apart, that a single layer of beads fills
ZERO_NEAR = 4.6  # [mm], zero to floor: less than half a centimetre, so that the longer marks identify the zero
GOES_ON = 6.0  # [mm], graduations further below the zero after a gap mean that the zero is wrong
ENDS_ABOVE = 4.0  # [mm], graduations may end this far above zero: the gauge's foot and its shadow hide a mark or two
# [mm] and [px] by which the lowest run of graduations may appear longer than it is, because marks are blurred
SMEARED = 1.5, 4.0
LOOKING = (-0.1, 0.6)  # slope of the line of sight to the floor: from slightly below its level to 30 degrees above
MOST_LEAN = math.radians(7)
FOCAL_SIDES = 2.0  # usual focal length over the longer side of the picture
USUAL_STEEPNESS = 0.5  # [bead diameters], standard deviation of the prior of `Bed.steepness`
FOCAL_UNCERTAINTY = 0.4  # standard deviation of the logarithm of the focal length
INSIDE = 0.97  # share of the inner radius in which the outline is searched
# Relative tolerance of the wall distance predicted from the bead size.  Circles are found on the clearest edge of a
# shaded bead, up to 1/6 inside its rim, and radii are tried in steps of 1/8.
WALL_TOLERANCE = 0.2
# [px], half of the 1 px blur under which edges are searched: shading shifts the clearest edge to one side within the
# blur, by the same amount along the whole outline
EDGE_UNCERTAINTY = 0.6
LEAST_SHOWN = 0.3  # least visible share of the surface across the cylinder
HIDDEN_LEVEL = 0.25  # [bead diameters], roughness of the outlines of settled beds
TEXTURE = 2.0  # limit of the log odds from texture; less than the 3.9 of colour, because neighbouring pixels share it


@dataclass(frozen=True)
class Bed:
    """A bed in the picture; lengths in px, rows counted downwards."""

    axis: tuple[float, float]  # point of the axis at the floor
    lean: float  # [rad], of the axis: positive where its foot is further right
    roll: float  # [rad], of the horizontal: positive where it falls to the right
    width: float  # inner width of the cylinder in the plane of its axis
    floor_sigma: float
    bulge: float  # distance of the front of the floor below its middle
    bulge_sigma: float
    bead_radius: float
    bead_seen: float  # bead radius from the picture alone, independent of stated sizes
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

    def steepness(self) -> tuple[float, float]:
        """Apparent rise of the bed's far side above its near side [bead diameters], and its standard uncertainty.

        The front of the floor shows the slope of the line of sight at the floor.  At the surface the slope is less, by
        surface height over camera distance.
        """
        _, height = self.outline
        focal = FOCAL_SIDES * self.longer_side
        fallen = float(np.mean(height)) / focal
        steep = self.bulge / (self.width / 2) - fallen
        uncertainty = math.hypot(fallen * FOCAL_UNCERTAINTY, self.bulge_sigma / (self.width / 2))
        beads = self.width / (4 * self.bead_radius)
        # prior: the camera is usually held near the height of the surface
        share = USUAL_STEEPNESS**2 / (USUAL_STEEPNESS**2 + (uncertainty * beads) ** 2)
        return float(np.clip(share * steep * beads, -1.5, 1.5)), math.sqrt(share) * uncertainty * beads


def find_bed(
    image: Image,
    *,
    cylinder: float | None,
    bead: float | None,
    roll: float | None = None,
    region: tuple[float, float, float, float] | None = None,
) -> Bed | None:
    """Find the bed in a photo (BGR), or None.  `cylinder` (inner) and `bead` are diameters [m] where known."""
    glare = glare_in(image)
    image = exposure_of(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)).applied(image)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    beads = _beads(image, grey, region)
    if beads is None or len(beads.centre) < FEWEST:
        return None
    upright, roll_seen = _upright(grey, roll)
    ratio = cylinder / bead if cylinder and bead else None
    middle = float(np.median(beads.centre[:, 1]))
    column = float(np.median(beads.centre[:, 0]))
    lean = upright.at(column)[0]
    centre = beads.centre - np.array([column, middle])
    across = centre[:, 0] * math.cos(lean) - centre[:, 1] * math.sin(lean)
    down = centre[:, 1] * math.cos(lean) + centre[:, 0] * math.sin(lean)
    left, right = _walls(across, down, beads.radius, ratio, upright, (column, middle))
    width = right - left
    radius = width / 2 / ratio if ratio else beads.radius
    inside = _in_the_bed(across, down, (left, right), beads.radius)
    if np.sum(inside) < FEWEST:
        return None
    seen_radius = rim_radius(grey, Beads(beads.centre[inside], beads.radius))
    kept = Beads(beads.centre[inside], radius if 0.7 < radius / beads.radius < 1.4 else beads.radius)
    alike = likeness(image, kept)
    inside[inside] = _filled(kept, alike)
    if np.sum(inside) < FEWEST:
        return None
    # count only rows of the bed: round things beside the empty part of the cylinder are not beads beyond a wall
    beside = (down > np.percentile(down[inside], 5)) & (down < np.percentile(down[inside], 95))
    beyond = float(np.mean(((across < left) | (across > right))[beside])) if beside.any() else 0.0
    offset = (left + right) / 2
    floor, floor_sigma, bulge, bulge_sigma = _floor(across[inside] - offset, down[inside], width / 2, radius)
    axis = (
        column + offset * math.cos(lean) + floor * math.sin(lean),
        middle - offset * math.sin(lean) + floor * math.cos(lean),
    )
    horizontal = -upright.at((image.shape[1] - 1) / 2)[0]
    view = View(axis, -lean, width / 2, 0.0, math.inf)
    kept = Beads(beads.centre[inside], kept.radius)
    alike = _with_texture(alike, grey, kept, view)
    kept = Beads(kept.centre[_filled(kept, alike)], kept.radius)
    found = outline_of(image, alike, kept, view, solid=True)
    if found is None:
        return None
    covered = covered_columns(found, image, kept, alike, glare, np.abs(found.x) < INSIDE * width / 2)
    found = replace(found, height=np.where(covered, np.nan, found.height))
    gauge = None
    if cylinder is not None or bead is not None:
        pixel = width / (cylinder * 1e3) if cylinder else 2 * beads.radius / (bead or 1.0) / 1e3
        gauge = _gauge(grey, upright, (axis[0] - width / 2, axis[0] + width / 2), pixel, axis, horizontal)
    if gauge is not None:
        row = gauge.row_of(0.0)
        zero = row - (gauge.column_at(row) - axis[0]) * math.tan(horizontal)
        known = floor - (axis[1] - zero) / math.cos(lean)
        _, _, bulge, bulge_sigma = _floor(across[inside] - offset, down[inside], width / 2, radius, known)
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
        _narrowing(across[inside], down[inside], beads.radius) / width,
        roll_seen,
    )
    return _judged(bed, _cut_off(kept, alike))


def _with_texture(alike: npt.NDArray[np.float32], grey: Image, beads: Beads, view: View) -> npt.NDArray[np.float32]:
    """Combine likeness in colour with likeness in texture: a bed is full of edges, the background is out of focus.

    Compares histograms of local roughness between the walls: inside the bed, and more than a bead above it.
    """
    away = beads.centre - np.array(view.origin)
    turn = np.array([[math.cos(view.roll), math.sin(view.roll)], [math.sin(view.roll), -math.cos(view.roll)]])
    x, y = np.meshgrid(np.arange(grey.shape[1]) - view.origin[0], np.arange(grey.shape[0]) - view.origin[1])
    across, height = turn[0, 0] * x + turn[0, 1] * y, turn[1, 0] * x + turn[1, 1] * y
    level = away @ turn[1]
    top, usual = float(level.max()), float(np.percentile(level, 90))
    inside = np.abs(across) < INSIDE * view.radius
    bed = inside & (height > beads.radius) & (height < usual - beads.radius)
    sky = inside & (height > top + 3 * beads.radius) & (height < top + 20 * beads.radius)
    if np.sum(sky) < np.sum(bed) / 20:
        return alike
    fine = grey.astype(np.float32)
    fine -= cv2.GaussianBlur(fine, (0, 0), 0.5 * beads.radius)
    rough = np.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), 0.35 * beads.radius)) + 0.5
    steps = np.clip(4 * np.log2(rough), 0, 39).astype(np.int64)
    shares = [
        np.convolve(np.bincount(steps[part], minlength=40) / np.sum(part), (0.25, 0.5, 0.25), mode="same") + 2e-3
        for part in (bed, sky)
    ]
    odds = np.clip(np.log(shares[0] / shares[1]), -TEXTURE, TEXTURE)[steps] + np.log((alike + 0.02) / (1.02 - alike))
    return np.asarray(1 / (1 + np.exp(-odds)), dtype=np.float32)


def _filled(beads: Beads, alike: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Mask of circles filled with bead-like pixels; marks on the glass also form circles."""
    filled = cv2.GaussianBlur(alike, (0, 0), 0.5 * beads.radius)
    share = at(filled, beads.centre)
    return np.asarray(share > 0.7 * np.median(share))


def _beads(image: Image, grey: Image, region: tuple[float, float, float, float] | None) -> Beads | None:
    shrink = min(1.0, COARSE / max(grey.shape))
    small = grey if shrink == 1 else cv2.resize(grey, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    beads = find_beads(np.asarray(small, dtype=np.uint8), (0.0055 * max(small.shape), 0.045 * max(small.shape)))
    if beads is None:
        return None
    beads = Beads(beads.centre / shrink, beads.radius / shrink)
    beads = more_beads(edges(grey), likeness(image, beads), beads, least_group=PARTED)
    if region is not None:
        x, y, width, height = region
        here = (np.abs(beads.centre - [x + width / 2, y + height / 2]) < [width / 2, height / 2]).all(axis=1)
        beads = Beads(beads.centre[here], beads.radius)
    return beads


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
    across: Array, down: Array, radius: float, ratio: float | None, upright: Level, middle: tuple[float, float]
) -> tuple[float, float]:
    """Columns of the inner walls at the bed's middle row, from the outermost beads and long upright edges near them."""
    # lines are in the transposed picture: (row, column)
    places = [line.start[1] + (middle[1] - line.start[0]) * math.tan(line.slope) - middle[0] for line in upright.lines]
    _, once = np.unique(np.floor(np.stack([across, down]) / radius), axis=1, return_index=True)
    starts = np.sort(across[once])
    # other round things may lie outside the walls: start from an estimate of the width if the bead size does not give
    # it
    width = 2 * radius * ratio if ratio is not None else float(np.ptp(np.percentile(starts, (2, 98)))) + 2 * radius

    def held(left: float, right: float) -> int:
        return int(np.searchsorted(starts, right) - np.searchsorted(starts, left))

    # best: two upright edges as far apart as the walls that hold most beads between them; of these the inner ones
    least, most_wide = (1 - WALL_TOLERANCE) * width, (1 + WALL_TOLERANCE) * width
    pairs = [(one, two) for one in places for two in places if least < two - one < most_wide]
    most = max((held(*pair) for pair in pairs), default=0)
    if most > 0.8 * max(held(start - radius, start + width) for start in starts.tolist()):
        return min((pair for pair in pairs if held(*pair) > 0.96 * most), key=lambda pair: pair[1] - pair[0])
    if ratio is not None:
        # otherwise the strip that holds the most beads
        first = max(starts.tolist(), key=lambda start: held(start, start + width - 1.8 * radius))
        across = across[(across >= first) & (across <= first + width - 1.8 * radius)]
    low, high = np.percentile(across, (2, 98))
    ends = [float(low) - radius, float(high) + radius]
    for side in (0, 1):
        near = [place for place in places if abs(place - ends[side]) < 0.4 * radius]
        if near:
            ends[side] = min(near, key=lambda place: abs(place - ends[side]))
    return ends[0], ends[1]


def _in_the_bed(across: Array, down: Array, walls: tuple[float, float], radius: float) -> npt.NDArray[np.bool_]:
    """Mask of circles between the walls in rows filled with beads; other round things stand in sparse rows."""
    inside = (across > walls[0]) & (across < walls[1])
    rows = np.arange(down.min(), down.max() + radius, radius)
    filled = []
    for row in rows:
        near = inside & (np.abs(down - row) < radius)
        places = np.unique(np.floor((across[near] - walls[0]) / (2 * radius)))
        filled.append(len(places) * 2 * radius / (walls[1] - walls[0]))
    full = np.flatnonzero(np.array(filled) > 0.4)
    if len(full) == 0:
        return inside
    runs = np.split(full, np.flatnonzero(np.diff(full) > 2) + 1)
    # an object in front of the bed may split it: runs of full rows belong to it wherever they are
    kept = np.concatenate([run for run in runs if len(run) >= min(FEWEST_ROWS, max(map(len, runs)))])
    return np.asarray(inside & (down > rows[kept[0]] - 1.5 * radius) & (down < rows[kept[-1]] + 1.2 * radius))


def _floor(
    across: Array, down: Array, half: float, radius: float, known: float | None = None
) -> tuple[float, float, float, float]:
    """Floor row at the axis, its standard uncertainty, distance of the floor's front below it, its uncertainty [px].

    `known` is the floor row from a gauge.  The lowest beads of a bed seen from above form an arc, because those in
    front touch the floor in front.
    """
    bins = np.linspace(-0.93 * half, 0.93 * half, 15)
    places, lowest = [], []
    for left, right in itertools.pairwise(bins):
        here = (across >= left) & (across < right)
        if np.any(here):
            k = int(np.argmax(np.where(here, down, -np.inf)))
            places.append(across[k])
            lowest.append(down[k] + radius)
    x, y = np.array(places), np.array(lowest)
    arc = np.sqrt(np.clip(1 - (x / (half - 0.5 * radius)) ** 2, 0, 1)) * (1 - radius / half)
    weight = np.ones_like(y)
    scale = level_sigma = 0.0
    answer = np.array([float(np.median(y)), 0.0])
    for _ in range(12):
        design = np.column_stack([np.ones_like(x), arc]) * weight[:, None]
        if known is None:
            normal = design.T @ design + np.diag([0.0, 0.3])
            answer = np.linalg.solve(normal, design.T @ (y * weight))
            # low floor and steep view are separated only by the shape of the arc
            level_sigma = scale * math.sqrt(float(np.linalg.inv(normal)[0, 0]))
        else:
            bulge = float(design[:, 1] @ ((y - known) * weight) / (design[:, 1] @ design[:, 1]))
            answer = np.array([known, bulge])
        answer[1] = max(answer[1], 0.0) if known is None else answer[1]
        miss = y - answer @ np.array([np.ones_like(x), arc])
        scale = max(mad_std(miss, centre=0.0), 0.1 * radius)
        # a missed bead leaves a higher one as the lowest, so negative residuals are weighted less
        weight = np.where(miss < 0, 1 / (1 + (miss / (1.5 * scale)) ** 2), 1 / (1 + (miss / (2.5 * scale)) ** 2))
    floor_sigma = math.hypot(max(0.35 * radius, 1.0), level_sigma)
    return float(answer[0]), floor_sigma, float(answer[1]), math.hypot(0.6 * radius, scale)


def _narrowing(across: Array, down: Array, radius: float) -> float:
    """Decrease of the bed's width [px] from top to foot: twice that of the side that slants less.

    Beads missed in glare or at one wall make one side slant.  The walls of a bin or the flanks of a heap slant both.
    """
    from scipy.stats import theilslopes

    outermost = []
    for row in np.arange(down.min(), down.max() + radius, radius):
        here = across[np.abs(down - row) < radius]
        if len(here) >= WALL_TO_WALL:
            outermost.append((row, float(here.min()), float(here.max())))
    if len(outermost) < LAYERED:
        return 0.0
    rows, left, right = np.array(outermost).T
    inwards = float(theilslopes(left, rows)[0]), -float(theilslopes(right, rows)[0])
    slant = min(inwards, key=abs) if inwards[0] * inwards[1] > 0 else 0.0
    return 2 * slant * float(np.ptp(rows))


def _gauge(
    grey: Image,
    upright: Level,
    walls: tuple[float, float],
    pixel: float,
    axis: tuple[float, float],
    horizontal: float,
) -> Gauge | None:
    """Find the gauge beside the cylinder; `pixel` is the expected size of a millimetre [px]."""
    gap = 0.06 * (walls[1] - walls[0])
    columns = np.concatenate([np.arange(4, walls[0] - gap, 3.0), np.arange(walls[1] + gap, grey.shape[1] - 4, 3.0)])
    best = None
    for side in (columns < walls[0], columns > walls[1]):
        mine = columns[side]
        if len(mine) < 4:
            continue
        lean = np.array([upright.at(column)[0] for column in mine])
        floor = axis[1] + (float(mine.mean()) - axis[0]) * math.tan(horizontal)
        found = find_gauge(grey, mine - np.tan(lean) * grey.shape[0] / 2, lean, pixel, floor, ZERO_NEAR)
        if found is not None and (best is None or found.strength > best.strength):
            best = found
    return best


def _goes_on(gauge: Gauge) -> bool:
    """Whether graduations are visible below the supposed zero."""
    return gauge.lowest > gauge.row_of(-GOES_ON) or gauge.last > gauge.row_of(-SMEARED[0]) + SMEARED[1]


def _cut_off(beads: Beads, alike: npt.NDArray[np.float32]) -> bool:
    """Whether the bed reaches the lower edge of the picture, so that the floor is not visible."""
    height = len(alike)
    lowest = float(beads.centre[:, 1].max()) + beads.radius
    if lowest < height - 2 * beads.radius:  # a row of beads cut by the edge may not be detected
        return False
    left, right = (max(round(float(end)), 0) for end in np.percentile(beads.centre[:, 0], (5, 95)))
    edge = alike[height - max(2, round(beads.radius / 4)) :, left : right + 1]
    return bool(np.mean(edge) > 0.5 * np.median(at(alike, beads.centre)))


def _judged(bed: Bed, cut_off: bool) -> Bed | None:
    """The bed with the uncertainty and flaws of its outline; None if too little of the surface is visible."""
    found = bed.silhouette
    seen = np.abs(found.x) < INSIDE * bed.width / 2
    known = seen & np.isfinite(found.height)
    shown = float(np.sum(known) / np.sum(seen))
    if shown < LEAST_SHOWN:
        return None
    apart = np.abs(found.looser[known] - found.stricter[known])
    uncertainty = 0.15 * float(np.nanmean(np.minimum(apart, 4 * bed.bead_radius))) + EDGE_UNCERTAINTY
    flaw = ""
    middle = float(np.mean(bed.gauge_rows(*bed.outline))) if bed.gauge is not None else 0.0
    if cut_off:
        flaw = "the bed reaches the lower edge of the picture, so the floor is not visible"
    elif bed.gauge is not None and not bed.gauge.first - bed.bead_radius < middle < bed.gauge.last + bed.bead_radius:
        flaw = "the gauge's graduations are hidden at the height of the surface: something may be in front of both"
    elif bed.gauge is not None and _goes_on(bed.gauge):
        flaw = "the gauge's graduations continue below the supposed zero: the lower part of the bed is hidden"
    elif bed.gauge is not None and float(bed.gauge.reading(bed.gauge.lowest)) > ENDS_ABOVE:
        flaw = "the gauge's graduations end above the supposed zero: they are hidden, or the gauge was misread"
    elif bed.gauge is not None and not LOOKING[0] < bed.bulge / (bed.width / 2) < LOOKING[1]:
        flaw = "the lowest beads do not lie at the gauge's zero: the floor is hidden, or the gauge was misread"
    elif shown < 0.9:
        flaw = "the surface is hidden in more than a tenth of the cylinder's width"
    elif found.contrast < 0.25:
        flaw = "the outline has hardly any contrast to the background"
    elif float(np.nanmean(apart > 1.5 * bed.bead_radius)) > 0.2:
        flaw = "a fifth of the outline depends on the threshold that separates beads from the background"
    # the hidden part may lie higher or lower by the roughness of a bed
    hidden = HIDDEN_LEVEL * 2 * bed.bead_radius * math.sqrt(max(1 - shown, 0.0))
    return replace(bed, outline_uncertainty=math.hypot(uncertainty, hidden), flaw=flaw)
