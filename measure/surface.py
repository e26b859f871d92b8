"""From a photo of a heap to its surface profile: silhouette, base line, and the view undone.

A heap is seen from slightly above and from near by: its outline is not its section.  `undo_view` takes each outline
point back to the plane through the disc's axis, as on a cone of the flank's slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image
from rigtwin.measure.disc import FOCAL_LENGTH, Disc, find_disc
from rigtwin.measure.exposure import exposure_of
from rigtwin.measure.grains import (
    FEWEST_BEADS,
    Beads,
    edges,
    find_beads,
    likeness,
    look_cells,
    more_beads,
    rare,
    rim_radius,
    shares,
)
from rigtwin.measure.straight import fullest_run

FINEST = 1000  # [px], width of the picture that is measured; of 1400 the angles of the sample heap are no nearer
TALLEST = 2.0  # height of a picture over its width above which its height sets the size instead
COVERED = 0.8  # share of the area under the outline that circles must cover
COARSE = 900  # [px], width of the picture that is searched for beads


@dataclass(frozen=True)
class View:
    """How the base lies in the picture; all lengths in px of the measured picture."""

    origin: tuple[float, float]  # picture point of the disc's axis at the top of the base
    roll: float  # [rad], positive when the base looks turned clockwise in the picture
    radius: float  # of the base, in the scale of the plane through its axis; 0 when no disc is seen
    camera_height: float  # above the base plane
    camera_distance: float  # from the axis; infinite when not known

    @property
    def looking_down(self) -> float:
        """[deg], from the level view"""
        return math.degrees(math.atan2(self.camera_height, self.camera_distance))

    def to_picture(self, x: Array, height: Array) -> Array:
        """Picture points, shape (n, 2), of points given along and above the base line."""
        cos, sin = np.cos(self.roll), np.sin(self.roll)
        return np.column_stack([self.origin[0] + x * cos + height * sin, self.origin[1] + x * sin - height * cos])


@dataclass(frozen=True)
class Silhouette:
    """Outline of the heap against what is behind it; lengths in px of the measured picture."""

    x: Array  # along the base line, 0 at the disc's axis, rising
    height: Array  # above the base line, NaN where there is no heap
    looser: Array  # the same outline when more pixels are taken for beads
    stricter: Array  # and when fewer are
    sigma: float  # of the height of one point
    contrast: float  # [1], median clearness of the outline, 1 is as clear as any edge in the picture
    bead_radius: float
    view: View
    disc: Disc | None
    zoom: float  # px of the measured picture per px of the photo
    cut_off: bool  # touches the picture's edge
    covered: float  # [1], share of the area under the outline that circles cover
    alike_behind: float  # [1], bead likeness just above the outline
    unexplained: float  # [1], share of the outline that runs more than a radius above all circles
    bead_seen: float = float("nan")  # radius by the picture alone, whatever sizes are stated

    @property
    def base_line_doubt(self) -> tuple[float, float]:
        """Standard uncertainties of the base line's height [px] and of its angle [rad]."""
        height = self.disc.sigma if self.disc is not None else 0.5 * self.bead_radius
        return height, height / max(self.view.radius, 0.5 * float(np.ptp(self.x)))


def find_heap(
    photo: Image,
    *,
    roll: float | None = None,
    region: tuple[float, float, float, float] | None = None,
    beads_across: float | None = None,
    focal_length: float | None = None,
) -> Silhouette | None:
    """The outline of a heap of beads in a photo (BGR), None when the photo shows none.

    `roll` [rad] and `region` [px] as the camera gives them, `beads_across` the base's diameter in bead diameters,
    `focal_length` [px] of the lens where it is known.
    """
    focal_length = focal_length or FOCAL_LENGTH * photo.shape[1]
    if region is not None:
        left, top, width, height = (max(round(side), 0) for side in region)
        part = photo[top : top + height, left : left + width]
        found = _heap_in(part, roll, beads_across, focal_length) if part.size else None
        return None if found is None else _moved(found, left, top)
    return _heap_in(photo, roll, beads_across, focal_length)


def _moved(found: Silhouette, left: float, top: float) -> Silhouette:
    """The same in a photo that reaches further by `left` and `top` [px]."""
    by = (left * found.zoom, top * found.zoom)
    origin = (found.view.origin[0] + by[0], found.view.origin[1] + by[1])
    disc = found.disc
    if disc is not None:
        disc = replace(disc, centre=(disc.centre[0] + by[0], disc.centre[1] + by[1]))
    return replace(found, view=replace(found.view, origin=origin), disc=disc)


def _heap_in(photo: Image, roll: float | None, beads_across: float | None, focal_length: float) -> Silhouette | None:
    zoom = min(1.0, FINEST / _breadth(photo))
    image = _shrunk(photo, zoom)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    exposure = exposure_of(grey[::2, ::2])
    image, grey = exposure.applied(image), exposure.applied(grey)
    circles = _beads(grey)
    if circles is None:
        return None
    beads, bead_seen = circles
    cells = look_cells(image, beads.radius, textured=True)
    rims = edges(grey)
    beads = more_beads(rims, likeness(image, beads, cells), beads)
    alike = likeness(image, beads, cells)
    disc = find_disc(grey, alike, beads, focal_length=focal_length * zoom, roll=roll, beads_across=beads_across)
    view = _view_of_disc(disc) if disc is not None else _view_of_feet(beads, roll)
    if disc is not None and beads_across is not None:
        beads = more_beads(rims, alike, Beads(beads.centre, view.radius / beads_across))
        alike = likeness(image, beads, look_cells(image, beads.radius, textured=True))
    found = outline_of(image, alike, beads, view)
    if found is None:
        return None
    found = replace(found, disc=disc, zoom=zoom, bead_seen=bead_seen)
    return found if _looks_like_a_heap(found) else None


def undo_view(x: Array, height: Array, view: View, slopes: tuple[float, float]) -> tuple[Array, Array]:
    """Outline points as they would be in a view from far away and level; all lengths in px.

    The outline of a cone of slope theta is where the surface is seen edge-on: at the azimuth phi behind the plane
    through the axis with sin phi = ((c - z) / tan theta - rho) / D, c and D the camera's height and distance.
    `slopes` are tan(theta) of the left and right flank.
    """
    if not np.isfinite(view.camera_distance):
        return x, height
    gradient = np.where(x < 0, slopes[0], slopes[1])
    # the camera is pointed at the heap's foot: heights are foreshortened, and what is high is nearer to it
    down = math.radians(view.looking_down)
    nearer = math.sin(down) * math.cos(down) / view.camera_distance
    height = height / (math.cos(down) + nearer * height)
    x = x * (1 - nearer * height)
    rho, z = np.abs(x), height.copy()
    for _ in range(4):
        behind = np.clip(((view.camera_height - z) / gradient - rho) / view.camera_distance, -0.5, 0.5)
        stretch = 1 + rho * behind / view.camera_distance
        z = view.camera_height + (height - view.camera_height) * stretch
        rho = np.abs(x) * stretch / np.sqrt(1 - behind * behind)
    return np.sign(x) * rho, z


def _breadth(picture: Image) -> float:
    """[px], the width, or half the height of a picture so tall that it would take minutes by its width."""
    return float(max(picture.shape[1], picture.shape[0] / TALLEST))


def _shrunk(picture: Image, factor: float) -> Image:
    if factor >= 1:
        return picture
    return np.asarray(cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _beads(grey: Image) -> tuple[Beads, float] | None:
    """Circles of the heap, and the radius [px] at which their edges end."""
    shrink = min(1.0, COARSE / _breadth(grey))
    small = _shrunk(grey, shrink)
    beads = find_beads(small, (0.0045 * small.shape[1], 0.05 * small.shape[1]))
    if beads is None:
        return None
    return Beads(beads.centre / shrink, beads.radius / shrink), rim_radius(small, beads) / shrink


def _view_of_disc(disc: Disc) -> View:
    """The camera's place relative to the base, from the ellipse of its rim.

    With q the disc's radius over the camera's distance D: the rim's ends lie R / sqrt(1 - q^2) from the middle, its
    front bulges by c q / (1 - q^2) below the line between them, and the axis meets the base plane q bulges above it.
    """
    q = disc.nearness
    lift = q * disc.bulge
    radius = disc.half_width * np.sqrt(1 - q * q)
    origin = (disc.centre[0] + lift * np.sin(disc.roll), disc.centre[1] - lift * np.cos(disc.roll))
    return View(origin, disc.roll, float(radius), disc.bulge * (1 - q * q) / q, float(radius / q))


def _view_of_feet(beads: Beads, roll: float | None) -> View:
    """No disc in sight: the base line runs under the outermost beads."""
    order = np.argsort(beads.centre[:, 0])
    few = max(2, len(order) // 12)
    feet = [beads.centre[part][np.argmax(beads.centre[part][:, 1])] for part in (order[:few], order[-few:])]
    turn = float(np.arctan2(feet[1][1] - feet[0][1], feet[1][0] - feet[0][0])) if roll is None else roll
    middle = (feet[0] + feet[1]) / 2
    return View((float(middle[0]), float(middle[1] + beads.radius)), turn, 0.0, 0.0, float("inf"))


def outline_of(
    image: Image, alike: npt.NDArray[np.float32], beads: Beads, view: View, *, solid: bool = False
) -> Silhouette | None:
    """The border between beads and background, column by column above the base line.

    `solid`: below the uppermost circles there are beads everywhere, as in a filled cylinder, whatever a gap looks like.
    """
    across = beads.centre - np.array(view.origin)
    cos, sin = np.cos(view.roll), np.sin(view.roll)
    u, h = across @ np.array([cos, sin]), across @ np.array([sin, -cos])
    above = h > 0
    if np.sum(above) < FEWEST_BEADS:
        return None
    u, h = u[above], h[above]
    reach = max(view.radius, float(np.abs(u).max())) + 4 * beads.radius
    top = float(h.max()) + 6 * beads.radius
    columns = np.arange(-np.ceil(reach), np.ceil(reach) + 1)
    rows = np.arange(np.ceil(top), -1, -1.0)  # from the sky down to the base line
    points = view.to_picture(np.tile(columns, len(rows)), np.repeat(rows, len(columns))).reshape(len(rows), -1, 2)
    map_x, map_y = points[..., 0].astype(np.float32), points[..., 1].astype(np.float32)
    seen = cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    level = np.asarray(seen, dtype=np.uint8)
    colour = cv2.remap(alike, map_x, map_y, cv2.INTER_LINEAR, borderValue=0.0).astype(np.float64)
    higher = _above_beads(columns, rows, u, h, beads.radius)
    evidence = np.log((colour + 0.02) / (1.02 - colour)) + _against_local_sky(level, higher, colour, beads.radius)
    # the further above the circles found, the surer a pixel's colour has to be
    evidence = np.clip(np.clip(evidence, -3, 3) - 1.2 * higher, -3, 3)
    if solid:
        evidence = np.where(_above_beads(columns, rows, u, h - 2.4 * beads.radius, beads.radius) == 0, 3.0, evidence)
    borders = _edge_map(level)
    readings = np.stack([evidence + shift for shift in (0.0, 0.8, -0.8)])
    usual, looser, stricter = (
        _bead_shaped(border, beads.radius) for border in _cheapest_borders(readings, borders, 0.35 * beads.radius)
    )
    fine, clearness = _sub_pixel(borders, usual)
    # the foot of a heap is a bead's side, steep: what runs out flat is something behind it
    empty = usual >= len(rows) - 1 - 0.5 * beads.radius
    first, last = fullest_run(~empty, gap=int(2 * beads.radius) + 1) or (0, -1)
    empty[:first] = empty[last + 1 :] = True
    if np.sum(~empty) < 6 * beads.radius:
        return None

    def as_height(border: Array) -> Array:
        return np.where(empty, np.nan, rows[0] - border)

    heap = ~empty
    edge_x, edge_y = points[usual.astype(int), np.arange(len(columns))].T
    margin = (edge_x < 2) | (edge_y < 2) | (edge_x > image.shape[1] - 3) | (edge_y > image.shape[0] - 3)
    return Silhouette(
        x=columns,
        height=as_height(fine),
        looser=as_height(looser),
        stricter=as_height(stricter),
        sigma=0.7,
        contrast=float(np.median(clearness[heap])),
        bead_radius=beads.radius,
        view=view,
        disc=None,
        zoom=1.0,
        cut_off=bool(np.any(margin & heap)),
        covered=_covered(columns, rows, usual, heap, np.column_stack([u, h]), beads.radius),
        unexplained=float(np.mean(higher[usual.astype(int), np.arange(len(columns))][heap] > 1.0)),
        alike_behind=float(np.mean(_just_above(colour, usual, beads.radius)[:, heap])),
    )


def _looks_like_a_heap(found: Silhouette) -> bool:
    """Whether beads fill the outline, something else is behind it, and it has a heap's proportions.

    Circles are found in many pictures; that they cover all of an area that ends at them is a heap's own.
    """
    height, width = float(np.nanmax(found.height)), float(np.sum(np.isfinite(found.height)))
    bead = 2 * found.bead_radius
    if height < 1.2 * bead or width < 5 * bead or height > 0.75 * width or found.alike_behind > 0.45:
        return False
    on_disc = found.disc is not None and found.contrast > 0.5 and found.alike_behind < 0.3
    return found.covered > (0.6 if on_disc else COVERED)


def _covered(
    columns: Array, rows: Array, border: Array, heap: npt.NDArray[np.bool_], centre: Array, radius: float
) -> float:
    under = (np.arange(len(rows))[:, None] > border[None, :]) & heap[None, :]
    circles = np.zeros(under.shape, np.uint8)
    for u, h in centre:
        cv2.circle(circles, (round(u - columns[0]), round(rows[0] - h)), round(radius), 1, -1)
    return float(np.mean(circles[under])) if under.any() else 0.0


def _just_above(values: Array, border: Array, radius: float) -> Array:
    """Values one to six tenths of a bead above the border, shape (rows, columns)."""
    rows = border[None, :] - np.linspace(0.2, 1.2, 6)[:, None] * radius
    return np.take_along_axis(values, np.clip(np.rint(rows), 0, len(values) - 1).astype(np.int64), axis=0)


def _above_beads(columns: Array, rows: Array, u: Array, h: Array, radius: float) -> Array:
    """How many radii above the circles found a pixel lies, shape (rows, columns)."""
    from scipy.ndimage import grey_closing

    envelope = np.zeros(len(columns))
    for centre_u, centre_h in zip(u, h, strict=True):
        near = np.abs(columns - centre_u) < 1.5 * radius
        envelope[near] = np.maximum(envelope[near], centre_h + 1.2 * radius)
    closed = np.asarray(grey_closing(envelope, size=(int(6 * radius) | 1,)))
    return np.asarray(np.maximum((rows[:, None] - closed[None, :]) / radius, 0))


def _against_local_sky(level: Image, higher: Array, colour: Array, radius: float) -> Array:
    """How much a pixel's colour speaks for beads against what stands behind just this part of the heap.

    Logarithm of the ratio of two histograms: beads, and the strip above the circles within a few beads to both sides.
    """
    index = look_cells(level, radius)
    inside = index[(higher == 0) & (colour > 0.5)]
    beads = shares(inside)
    little = rare(beads, inside)
    sky = (higher > 0.8) & (higher < 6.0)
    answer = np.zeros_like(colour)
    width, stride = level.shape[1], max(int(1.5 * radius), 1)
    for left in range(0, width, stride):
        window = slice(max(left - stride, 0), min(left + 2 * stride, width))
        strip = slice(left, min(left + stride, width))
        behind = shares(index[:, window][sky[:, window]])
        answer[:, strip] = np.log((beads + 0.1 * little) / (behind + little))[index[:, strip]]
    return np.clip(answer, -3, 3)


def _edge_map(level: Image) -> Array:
    """Strength of the colour edge that a border running through a pixel would follow, 0 to 1."""
    strength = np.zeros(level.shape[:2], dtype=np.float32)
    for channel in range(3):
        strength = np.maximum(strength, edges(np.ascontiguousarray(level[..., channel]), blur=1.0).strength)
    return np.asarray(np.clip(strength / max(float(np.percentile(strength, 95)), 1.0), 0, 1), dtype=np.float64)


def _cheapest_borders(evidence: Array, borders: Array, edge_reward: float) -> Array:
    """Row of the border in every column, shape (readings, columns): background above it, beads below, on edges where
    it can be; `evidence` of shape (readings, rows, columns).

    Dynamic programming over the columns; a step between neighbours costs a part of what an edge gains, because the
    sides of beads are steep.  The exact minimum, found by two running minima per column.
    """
    gain = evidence / 3
    total = gain.sum(axis=1, keepdims=True)
    above = np.cumsum(gain, axis=1) - gain
    cost = np.ascontiguousarray(np.moveaxis(2 * above - total - edge_reward * borders, -1, 0))
    width, readings, count = cost.shape
    step = 0.15 * np.arange(count)
    best = cost[0]
    came_from = np.zeros(cost.shape, dtype=np.int32)
    index = np.arange(count, dtype=np.int32)
    for column in range(1, width):
        down, up = best - step, best + step
        least_down = np.minimum.accumulate(down, axis=1)
        least_up = np.minimum.accumulate(up[:, ::-1], axis=1)[:, ::-1]
        from_down = np.maximum.accumulate(np.where(down <= least_down, index, 0), axis=1)
        from_up = np.minimum.accumulate(np.where(up <= least_up, index, count - 1)[:, ::-1], axis=1)[:, ::-1]
        use_down = least_down + step <= least_up - step
        came_from[column] = np.where(use_down, from_down, from_up)
        best = np.where(use_down, least_down + step, least_up - step) + cost[column]
    border = np.empty((readings, width))
    row = np.argmin(best, axis=1)
    for column in range(width - 1, -1, -1):
        border[:, column] = row
        row = came_from[column, np.arange(readings), row]
    return border


def _bead_shaped(border: Array, radius: float) -> Array:
    """Without deep slits and high spikes narrower than a bead; rows grow downwards."""
    from scipy.ndimage import grey_closing, grey_opening

    spikes_cut = grey_closing(border, size=(int(1.6 * radius) | 1,))
    border = np.where(spikes_cut - border > 0.8 * radius, spikes_cut, border)
    slits_filled = grey_opening(border, size=(int(1.2 * radius) | 1,))
    return np.asarray(np.where(border - slits_filled > radius, slits_filled, border))


def _sub_pixel(borders: Array, border: Array) -> tuple[Array, Array]:
    """The border moved to the strongest edge within two rows of it, and how clear that edge is."""
    rows, columns = borders.shape
    reach = np.arange(-2, 3)
    near = np.clip(border.astype(int)[:, None] + reach, 0, rows - 1)
    strength = borders[near, np.arange(columns)[:, None]]
    middle = np.sum(strength * reach, axis=1) / np.maximum(strength.sum(axis=1), 1e-9)
    return border + middle, strength.max(axis=1)
