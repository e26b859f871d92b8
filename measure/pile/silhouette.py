"""Find the silhouette of a heap in a photo, and correct it for the perspective of the camera."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, FloatImage, GreyImage, Image, Mask
from rigtwin.lab.camera import FOCAL_LENGTH, STATED_SIGMA, Flank, Line
from rigtwin.lab.errors import Mark, NothingToMeasure, Seen
from rigtwin.measure.bulk.bead_spacing import bead_spacing
from rigtwin.measure.bulk.beads import Beads, find_beads, rim_radius
from rigtwin.measure.bulk.checks import MISFIT, size_of_beads
from rigtwin.measure.bulk.grain_classes import Grain, grain_classes, most_grains
from rigtwin.measure.bulk.outline import Disc, Silhouette, View
from rigtwin.measure.bulk.outline_above import outline_above
from rigtwin.measure.pile.base_disc import find_disc, nearness
from rigtwin.measure.pile.checks import NEARER
from rigtwin.measure.scene.contrast_stretch import exposure_of

FINEST = 1000  # [px], width of the analysed picture; 1400 does not improve the angles of the sample heap

TALLEST = 2.0  # ratio of height to width above which the height of the picture sets its size

USUAL_DEPRESSION = 3.0  # [deg], of the line of sight where nothing shows it, and its standard uncertainty

SEEN_DEPRESSION = 1.5  # [deg], standard uncertainty where rim or foot show it

# least fit (chosen) and support of a base that is held against a stated one: of 11 rendered photos the base was within
# 4 % of its radius in ten, nine of them with a support of 0.7 or more, and 11 % off in one, with 0.56
CLEARLY, SUPPORTED = 0.85, 0.7
# [standard uncertainties] and [half widths], by which the ends of a stated base may lie elsewhere than those seen
ELSEWHERE, LEAST_APART = 3.0, 0.015

USUAL_BEADS = 25  # bead diameters across a base where neither sizes nor circles are known

LEAST_MATTER, MOST_ALIKE = 0.6, 0.45  # mean likelihood of matter below and above the border of any heap

SIZE_RANGE = 2.0  # largest ratio of the apparent to the stated size of beads that is searched

LEAST_GRAINS = 0.003  # least share of the picture that grains cover
LEAST_LIKELY = 0.7  # mean probability of grains in their region: 0.78 and more in photos of heaps, 0.66 in noise

COARSE = 900  # [px], width of the reduced picture that is searched for beads


def find_heap(
    photo: Image,
    *,
    roll: float | None = None,
    region: tuple[float, float, float, float] | None = None,
    beads_across: float | None = None,
    focal_length: float | None = None,
    base: Line | None = None,
    flank: Flank | None = None,
) -> Silhouette:
    """Find the outline of a heap of beads in a photo (BGR).

    Raises `NothingToMeasure` with what was found instead of a heap.

    `roll` [rad] and `region` [px] are those of the camera, `beads_across` is the base diameter in bead diameters,
    `focal_length` [px] that of the lens where it is known.  `base` is the line that the heap stands on, where it is
    stated [px], and `flank` the only flank, where there is one.
    """
    focal_length = focal_length or FOCAL_LENGTH * photo.shape[1]
    left, top = (max(round(side), 0) for side in region[:2]) if region is not None else (0, 0)
    if region is not None:
        photo = photo[top : top + round(region[3]), left : left + round(region[2])]
        if not photo.size:
            raise NothingToMeasure("no pixel of the photo lies inside --region")
    try:
        if base is None:
            found = _heap_in(photo, roll, beads_across, focal_length)
        else:
            (x1, y1), (x2, y2) = base
            found = _heap_on(photo, ((x1 - left, y1 - top), (x2 - left, y2 - top)), beads_across, focal_length, flank)
    except NothingToMeasure as nothing:
        marks = () if nothing.seen is None else nothing.seen.marks
        moved = (replace(mark, points=[(x + left, y + top) for x, y in mark.points]) for mark in marks)
        raise NothingToMeasure(nothing.message, Seen(marks=tuple(moved))) from None
    return _moved(found, left, top)


def _moved(found: Silhouette, left: float, top: float) -> Silhouette:
    """The silhouette in the coordinates of a photo that extends `left` and `top` further [px]."""
    by = (left * found.zoom, top * found.zoom)
    origin = (found.view.origin[0] + by[0], found.view.origin[1] + by[1])
    disc = found.disc
    if disc is not None:
        disc = replace(disc, centre=(disc.centre[0] + by[0], disc.centre[1] + by[1]))
    return replace(found, view=replace(found.view, origin=origin), disc=disc)


def _heap_in(photo: Image, roll: float | None, beads_across: float | None, focal_length: float) -> Silhouette:
    image, grey, zoom = _analysed(photo)
    classes = grain_classes(image)
    grains = _grains(classes)
    disc = find_disc(classes, grey, focal_length=focal_length * zoom, roll=roll)
    if disc is not None:
        view = span = _view_of_disc(disc)
        around = _around(grey, disc.centre, disc.half_width, disc.bulge)
        circles, stated = _circles(image, around, grains, view.radius, beads_across)
        usual = view.radius / USUAL_BEADS
    else:
        stated, circles = None, _beads(grey)
        view, half = _view_of_feet(grains, roll, focal_length * zoom)
        span, usual = replace(view, radius=half), half / USUAL_BEADS
    # cubes and pebbles show no circles
    beads, bead_seen = circles or (Beads(np.empty((0, 2)), usual), math.nan)
    radius = beads.radius if stated is None else stated
    found = outline_above(image, classes, span, radius)
    if found is None:
        raise NothingToMeasure(_no_outline(span, zoom), _seen(beads, zoom))
    sigma = SEEN_DEPRESSION if disc is None else 0.0
    found = replace(found, view=view, disc=disc, zoom=zoom, bead_seen=bead_seen, depression_sigma=sigma)
    if flaw := _unlike_a_heap(found):
        raise NothingToMeasure(flaw, _seen(beads, zoom))
    return found


def _seen(beads: Beads, zoom: float) -> Seen:
    """The circles that were found, for the picture of a refusal."""
    return Seen(marks=tuple(Mark("", [(x / zoom, y / zoom)], beads.radius / zoom) for x, y in beads.centre.tolist()))


def _no_outline(span: View, zoom: float) -> str:
    return f"no outline of what differs from the background above a base line {2 * span.radius / zoom:.0f} px wide"


def _circles(
    image: Image, around: GreyImage, grains: Mask | None, half: float, beads_across: float | None
) -> tuple[tuple[Beads, float] | None, float | None]:
    """Circles of the heap on a base, and the bead radius [px] to measure with, by the stated sizes if there are any.

    `half` is half the width of the base [px].
    """
    if beads_across is None:
        return _beads(around), None
    stated = half / beads_across
    circles = _beads(around, stated)
    others = None if grains is None else _of_another_size(image, around, grains, circles, stated)
    return (circles, stated) if others is None else (others, others[0].radius)


def _around(grey: GreyImage, middle: tuple[float, float], half: float, bulge: float) -> GreyImage:
    """The part of a picture that a heap on a base may fill, and as much background as its edges are judged by."""
    x, y = middle
    rows = slice(max(round(y - 1.2 * half), 0), max(round(y + bulge + 0.4 * half), 1))
    return np.ascontiguousarray(grey[rows, max(round(x - 1.6 * half), 0) : max(round(x + 1.6 * half), 1)])


def _heap_on(
    photo: Image, base: Line, beads_across: float | None, focal_length: float, flank: Flank | None
) -> Silhouette:
    """The heap on a stated base line."""
    image, grey, zoom = _analysed(photo)
    (x1, y1), (x2, y2) = ((x * zoom, y * zoom) for x, y in base)
    half, turn = math.hypot(x2 - x1, y2 - y1) / 2, math.atan2(y2 - y1, x2 - x1)
    distance, down, sigma, apart, unconfirmed = math.inf, 0.0, 0.0, 0.0, ""
    classes = grain_classes(image)
    try:
        grains: Mask | None = _grains(classes)
    except NothingToMeasure:
        grains = None
    if flank not in ("left", "right"):  # a slope against a wall is no cone
        distance = half / float(nearness(np.array(half), focal_length * zoom))
        down, sigma = USUAL_DEPRESSION, USUAL_DEPRESSION
        unconfirmed = "no grains were found, so that no base was searched"
        if grains is not None:
            disc = find_disc(classes, grey, focal_length=focal_length * zoom, roll=turn)
            seen = _view_of_disc(disc) if disc else _view_of_feet(grains, turn, focal_length * zoom)[0]
            down, sigma = seen.looking_down, SEEN_DEPRESSION
            unconfirmed = _not_clear(disc)
            apart = 0.0 if disc is None or unconfirmed else _contradicts(seen, disc, base, zoom)
    height = distance * math.tan(math.radians(down)) if math.isfinite(distance) else 0.0
    view = View(((x1 + x2) / 2, (y1 + y2) / 2), turn, half, height, distance)
    circles, stated = _circles(image, _around(grey, view.origin, half, 0.0), grains, half, beads_across)
    radius = stated or (circles[0].radius if circles else half / USUAL_BEADS)
    found = outline_above(image, classes, view, radius, flank)
    if found is None:
        raise NothingToMeasure(_no_outline(view, zoom))
    bead_seen = circles[1] if circles else math.nan
    found = replace(found, zoom=zoom, stated=STATED_SIGMA * zoom, bead_seen=bead_seen)
    return replace(found, depression_sigma=sigma, contradicted=apart, unconfirmed=unconfirmed)


def _not_clear(disc: Disc | None) -> str:
    """Why the base in the picture cannot confirm a stated one; empty if it can."""
    if disc is None:
        return "no base is seen in the picture"
    if disc.support < SUPPORTED:
        return (
            f"{100 * disc.support:.0f} % of a base's rim and sides lie on edges, and {100 * SUPPORTED:.0f} % are needed"
        )
    if disc.fit < CLEARLY:
        return f"base, heap and wall are distinguished to {100 * disc.fit:.0f} %, and {100 * CLEARLY:.0f} % are needed"
    return ""


def _contradicts(view: View, disc: Disc, base: Line, zoom: float) -> float:
    """Distance [px of the photo] of an end of the stated base from that of the base that is seen; 0 if alike."""
    seen = view.to_picture(np.array([-view.radius, view.radius]), np.zeros(2)).tolist()
    apart = max(math.dist(end, (zoom * px, zoom * py)) for end, (px, py) in zip(seen, sorted(base), strict=True))
    usual = math.hypot(STATED_SIGMA * zoom, disc.sigma)
    return apart / zoom if apart > ELSEWHERE * usual + LEAST_APART * view.radius else 0.0


def undo_view(x: Array, height: Array, view: View, slopes: tuple[float, float]) -> tuple[Array, Array]:
    """Outline points of a horizontal view from far away, from those of the actual view; all lengths in px.

    The outline of a cone of slope theta is where the surface is seen edge-on.  That is at the azimuth phi behind the
    plane through the axis, with sin phi = ((c - z) / tan theta - rho) / D; c and D are the camera's height and
    distance. `slopes` are tan(theta) of the left and right flank.
    """
    if not np.isfinite(view.camera_distance):
        return x, height
    gradient = np.where(x < 0, slopes[0], slopes[1])
    # the camera is pointed at the foot of the heap: heights are foreshortened, and high points are nearer to it
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


def _analysed(photo: Image) -> tuple[Image, GreyImage, float]:
    """The picture that is analysed with its exposure evened out, its brightness, and its px per px of the photo."""
    zoom = min(1.0, FINEST / _breadth(photo))
    image = _shrunk(photo, zoom)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    exposure = exposure_of(grey[::2, ::2])
    return exposure.applied(image), exposure.applied(grey), zoom


def _breadth(picture: Image) -> float:
    """Width [px], or half the height of a tall picture, which would take minutes if scaled by its width."""
    return float(max(picture.shape[1], picture.shape[0] / TALLEST))


def _shrunk(picture: Image, factor: float) -> Image:
    if factor >= 1:
        return picture
    return np.asarray(cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _beads(grey: GreyImage, radius: float | None = None) -> tuple[Beads, float] | None:
    """Circles of the heap, and the radius [px] of their rims; `radius` is that by the stated sizes."""
    shrink = min(1.0, COARSE / _breadth(grey))
    small = _shrunk(grey, shrink)
    smallest, largest = (0.0045 * small.shape[1], 0.05 * small.shape[1])
    if radius is not None:
        smallest, largest = radius * shrink / SIZE_RANGE, radius * shrink * SIZE_RANGE
    beads = find_beads(small, (smallest, largest))
    if beads is None:
        return None
    return Beads(beads.centre / shrink, beads.radius / shrink), rim_radius(small, beads) / shrink


def _of_another_size(
    image: Image, around: GreyImage, grains: Mask, near: tuple[Beads, float] | None, stated: float
) -> tuple[Beads, float] | None:
    """Circles of the heap beyond the sizes that are searched `near` the `stated` radius [px]; None if there are none.

    Where the distance of neighbours is clear, it decides; else circles of the stated size go first if they look right.
    """
    freely = _beads(around)
    if freely is None or _ratio(freely[1], NEARER * stated) < SIZE_RANGE:
        return None
    # edges of cubes or pebbles give large circles that overlap each other: more than fit into the region of the grains
    if len(freely[0].centre) * math.pi * freely[1] ** 2 > np.count_nonzero(grains):
        return None
    spacing = bead_spacing(image, grains)
    if spacing is None:
        right = near is not None and abs(near[1] / (NEARER * stated) - 1) <= MISFIT
        return None if right else freely
    return freely if _ratio(2 * freely[1] / NEARER, size_of_beads(spacing)) < 1 + 2 * MISFIT else None


def _ratio(one: float, other: float) -> float:
    """Ratio of the larger to the smaller."""
    return max(one, other) / min(one, other)


def _view_of_disc(disc: Disc) -> View:
    """Position of the camera relative to the base, from the ellipse of its rim.

    With q the disc's radius over the camera distance D and height c of the camera: the rim's ends lie R / sqrt(1 - q^2)
    from the middle, its front lies c q / (1 - q^2) below the line between them, and the axis meets the base plane q
    bulges above that line.
    """
    q = disc.nearness
    lift = q * disc.bulge
    radius = disc.half_width * np.sqrt(1 - q * q)
    origin = (disc.centre[0] + lift * np.sin(disc.roll), disc.centre[1] - lift * np.cos(disc.roll))
    return View(origin, disc.roll, float(radius), disc.bulge * (1 - q * q) / q, float(radius / q))


def _grains(classes: FloatImage) -> Mask:
    """The largest region of grains."""
    region = most_grains(classes)
    kind = np.argmax(classes, axis=2)
    grains = np.zeros(kind.shape, dtype=bool) if region is None else region & (kind == Grain.GRAINS)
    share = float(np.mean(grains))
    if share < LEAST_GRAINS:
        raise NothingToMeasure(
            f"the largest region that looks like grains covers {100 * share:.2g} % of the picture, "
            f"{100 * LEAST_GRAINS:g} % are needed"
        )
    likely = float(np.mean(classes[..., Grain.GRAINS][grains]))
    if likely < LEAST_LIKELY:
        raise NothingToMeasure(
            f"the largest region that looks like grains, {100 * share:.2g} % of the picture, has a mean probability "
            f"of {likely:.2f}, {LEAST_LIKELY} is needed"
        )
    if grains[0].any() and grains[:, 0].any() and grains[:, -1].any():
        raise NothingToMeasure(
            f"what looks like grains, {100 * share:.0f} % of the picture, reaches its left, right and upper edge"
        )
    return grains


def _view_of_feet(grains: Mask, roll: float | None, focal_length: float) -> tuple[View, float]:
    """View without a visible disc, and half the heap's width: the base line runs through the outermost grains.

    The foot of a round heap is an ellipse, whose front is the lower border of the grains.
    """
    from scipy.optimize import least_squares

    columns = np.nonzero(grains.any(axis=0))[0]
    lowest = len(grains) - np.argmax(grains[::-1, columns], axis=0) - 0.5
    centre, half = (columns[0] + columns[-1]) / 2, (columns[-1] - columns[0] + 1) / 2
    along = (columns - centre) / half
    arc = np.sqrt(1 - along * along)
    slope = math.nan if roll is None else math.tan(roll) * half

    def misses(sought: Array) -> Array:
        turn = sought[2] if roll is None else slope
        return np.asarray(sought[0] + turn * along + sought[1] * arc - lowest)

    start = np.array([np.median(lowest), 0.0, 0.0])
    bounds = ([-np.inf, 0.0, -half], [np.inf, half, half])
    level, bulge, fall = least_squares(misses, start, bounds=bounds, loss="soft_l1", f_scale=0.02 * half).x.tolist()
    turn = math.atan(fall / half) if roll is None else roll
    near = float(nearness(np.array(half), focal_length))
    # see `_view_of_disc`
    view = View((float(centre), level - near * bulge), turn, 0.0, bulge * (1 - near * near) / near, half / near)
    return view, float(half / math.cos(turn))


def _unlike_a_heap(found: Silhouette) -> str:
    """How proportions, matter or background are not those of a heap; empty if they are."""
    height, width = float(np.nanmax(found.height)), float(np.sum(np.isfinite(found.height)))
    bead = 2 * found.bead_radius
    if height < 1.2 * bead or width < 5 * bead or height > 0.75 * width:
        return (
            f"what was found is {height / bead:.1f} beads high and {width / bead:.1f} wide, and a heap is higher than "
            "1.2, wider than 5 and lower than 0.75 of its width"
        )
    if found.covered <= LEAST_MATTER:
        return f"below the outline the mean likelihood of beads is {found.covered:.2f}, {LEAST_MATTER} is needed"
    if found.alike_behind >= MOST_ALIKE:
        found_above = f"{found.alike_behind:.2f}"
        return f"above the outline the mean likelihood of beads is {found_above}, less than {MOST_ALIKE} is needed"
    return ""
