"""Observe a hopper that empties: the bed in it, the slot, the slide that uncovers the slot, and the last bead.

Pictures of the full and of the empty hopper separate the bed from everything else: a bead is what differs from the
empty hopper and has the colour of the bed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image, Mask
from rigtwin.lab.camera import STATED_SIGMA, Camera, Line
from rigtwin.lab.errors import Mark, NothingToMeasure, Seen
from rigtwin.lab.progress import Progress
from rigtwin.measure.bulk.beads import colour_cells, find_beads, rare, shares
from rigtwin.measure.bulk.piv import Displacements, MeanCorrelation, without_outliers
from rigtwin.measure.geometry.camera_roll import Upright, upright
from rigtwin.measure.geometry.disc_morphology import closed, opened
from rigtwin.measure.hopper.falling_stream import Stream
from rigtwin.measure.hopper.foreign_objects import Usual, crosses, foreign, usual_sight
from rigtwin.measure.media.video import Video
from rigtwin.measure.scene.background import middle_picture
from rigtwin.measure.scene.pose import Pose
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.scene.steadied_frames import Cut, Steadied, apart, cut_for, steadied, still_scene

ENDS = 5  # frames at either end of the clip that show the full and the empty hopper
BEAD_SHARE = 0.06  # bead diameter over the bed's width, if no bead is found
CLEAR = 6.0  # least difference of bed and empty hopper over the noise
FLOWING = (0.2, 0.8)  # shares of the bed left between which the flow is steady
DIP = 0.25  # share of the bead likeness of rows of beads: the row below them contains only their lowest points
SLOT_UNCERTAINTY = 0.12  # [bead diameters], standard uncertainty of the slot's row below the lowest beads
LEAST_BESIDE = 500  # [px^2], least area beside the bed for an occlusion check
PASSES = 0.03  # least share of that area that an occlusion hides
AROUND = 3.0  # [bead diameters] above and below the slot, and one to its sides, where a hand is an occlusion
# Depth of the changed region over the thickness of slender objects.  Beads arch over a slot narrower than about six of
# them (Beverloo et al. 1961 need more), and the bed above is as wide; a slide, its knob and its rod are hardly thicker
# than a bead.
NARROWEST = 6
SLENDER, GAPS = 11, 7  # [px], thickness of such an object, and of the gaps between beads, in a small picture
ALIKE = 0.5  # overlap of their colours (Bhattacharyya) above which two regions are parts of one bed
ALIKE_BLUR = 2.0  # [px]
REACH_BELOW = 5  # [bead diameters] below the slot, where a leaving bead is searched
LEAST_BEAD = 0.2  # share of a bead's disc; smaller patches are no beads


@dataclass(frozen=True)
class Slot:
    """The outlet in the upright picture, px."""

    row: float  # lower edge of the bed that rests on the closed slide
    left: float
    right: float
    sigma: float = 1.0  # standard uncertainty of the row
    stated: bool = False


@dataclass(frozen=True)
class Scenery:
    """The hopper before and after, upright, and the classifier that separates beads from it."""

    full: Image
    empty: Image
    bed: Mask  # where the bed is at first
    slot: Slot
    bead: float  # [px], bead diameter
    odds: Array  # log likelihood ratio of beads against the empty hopper, by colour cell
    noise: float  # [grey levels]
    level: float  # [grey levels], threshold of a bead's difference from the empty hopper
    turn: Array  # shape (2, 3), from the upright picture to the registered frame
    bead_seen: bool  # single beads were found
    contrast: float  # [grey levels], difference of the bed at first from the empty hopper


@dataclass(frozen=True)
class Moment:
    """Counts of one frame."""

    index: int
    time: float  # [s]
    left: float  # [px^2], area of beads above the slot
    top: float  # [px], row of the uppermost bead in or below the hopper; infinite if there is none
    front: float  # [px], row of the lowest bead connected to the bed; NaN if there is none
    lowest: float  # [px], row of the lowest bead below the slot; NaN if there is none
    change: float  # [grey levels], change of the bed's lower part since the previous frame
    pose: Pose
    covered: bool  # something is in front of the bed or the slot
    hidden: bool = False  # something is in front of the scene, including beside the bed


@dataclass(frozen=True)
class Outflow:
    """Observation of a hopper that empties."""

    moments: tuple[Moment, ...]
    strips: npt.NDArray[np.uint8]  # rows at the slide's level, shape (frames, width, colours of the rows)
    masked: Mask  # where something is in front of them, shape (frames, width)
    scenery: Scenery
    upright: Upright
    lens: Cut
    residue: float  # share of the bed's area still filled at the end
    interval: float  # [s], between frames
    outlet: Displacements  # of the beads in the slot from frame to frame, mean over the steady flow
    stream: Stream  # of the beads below the slot, in the upright cut


def follow_outflow(video: Video, camera: Camera, *, bead: float | None, progress: Progress) -> Outflow:
    """Observe a discharge; `bead` is the bead's diameter [px] if scale and bead are known.

    Raises `NothingToMeasure` if no bed empties downwards between the first and the last frame.
    """
    lens = cut_for(video.width, video.height, camera.region)
    scene = still_scene(video, lens)
    turned = upright(scene.picture, given=camera.roll)
    height, width = scene.picture.shape
    about = (width / 2, height / 2)
    turn = np.asarray(cv2.getRotationMatrix2D(about, -math.degrees(turned.roll), 1.0), dtype=np.float64)
    stated = None if camera.slot is None else _stated_slot(camera.slot, lens, turn)
    scenery = _scenery(video, scene, lens, turn, None if bead is None else bead * lens.zoom, stated)
    moments, strips, masked = [], [], []
    before: Image | None = None
    there = [index for index in range(video.first, video.last + 1) if index not in video.skipped]
    usual = float(np.median(np.diff(video.times[there])))
    outlet, stream = _windows(scenery), Stream(scenery.bead, scenery.noise)
    beside = _beside(scenery)
    rows, sight = _usual_sight(scene, scenery)
    count = video.last - video.first + 1
    for frame in _upright_frames(video, scene, lens, turn):
        strange, crossed = _strange(frame.colour, rows, sight)
        moment = _moment(frame, before, scenery, strange)
        moment = replace(moment, covered=moment.covered or crossed)
        moments.append(replace(moment, hidden=moment.covered or _hides(frame.colour, scenery, beside)))
        strips.append(slide_strip(frame.colour, scenery))
        masked.append(strange[_strip_rows(scenery)].any(axis=0) | crossed)
        share = moments[-1].left / max(float(np.median([moment.left for moment in moments[:ENDS]])), 1.0)
        # across a lost frame beads move twice as far
        neighbours = before is not None and abs(moment.time - moments[-2].time - usual) < 0.5 * usual
        steady = neighbours and FLOWING[0] < share < FLOWING[1]
        if before is not None:
            stream.add(_below(before, scenery), _below(frame.colour, scenery), steady=steady)
            if steady:
                outlet.add(_grey(before), _grey(frame.colour))
        before = frame.colour
        progress("watching the hopper empty", len(moments), count)
    if stated is not None and all(math.isnan(moment.lowest) for moment in moments):
        raise NothingToMeasure(
            f"{video.path}: no bead is seen below --slot in frames {video.first} to {video.last}; state the two lower "
            "edges of the outlet, where the beads leave it.",
            Seen(frame=(video.first + video.last) // 2, marks=(Mark("slot", _ends_of(scenery.slot, lens)),)),
        )
    return Outflow(
        tuple(moments),
        np.stack(strips),
        np.stack(masked),
        scenery,
        turned,
        lens,
        _residue(scenery),
        float(np.median(np.diff([moment.time for moment in moments]))),
        without_outliers(outlet.displacements()),
        stream,
    )


def _stated_slot(slot: Line, lens: Cut, turn: Array) -> Slot:
    """The slot that the user states, in the upright picture."""
    ends = lens.of_clip(np.array(slot, dtype=np.float64))
    back = cv2.invertAffineTransform(turn)
    (x1, y1), (x2, y2) = (ends @ back[:, :2].T + back[:, 2]).tolist()
    return Slot((y1 + y2) / 2, min(x1, x2), max(x1, x2), STATED_SIGMA * lens.zoom, stated=True)


def _windows(scenery: Scenery) -> MeanCorrelation:
    """Windows two beads wide along the slot for downward shifts of up to three beads."""
    slot, bead = scenery.slot, scenery.bead
    count = max(3, round((slot.right - slot.left) / (0.75 * bead)))
    x = slot.left + (np.arange(count) + 0.5) * (slot.right - slot.left) / count
    place = np.column_stack([x, np.full(count, slot.row)])
    return MeanCorrelation(place, window=max(8, round(2 * bead)), reach=(max(3, round(bead)), max(6, round(3 * bead))))


def _below(picture: Image, scenery: Scenery) -> npt.NDArray[np.uint8]:
    """Difference of the picture below the slot from the empty hopper."""
    slot = scenery.slot
    part = (slice(round(slot.row), None), slice(max(round(slot.left), 0), round(slot.right)))
    return apart(picture[part], scenery.empty[part])


def _grey(picture: Image) -> npt.NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def bin_walls(scenery: Scenery) -> tuple[float, float] | None:
    """Inner edges [px] of the bin's vertical walls above the bed; None if they are not clear.

    The wall is the first edge outwards from the bed that is vertical over all these rows.
    """
    rows, columns = np.nonzero(scenery.bed)
    top = int(rows.min() - 0.5 * scenery.bead)
    if top < 3 * scenery.bead:
        return None
    left, right = float(columns.min()), float(columns.max())
    part = cv2.cvtColor(scenery.empty[max(top - round(8 * scenery.bead), 0) : top], cv2.COLOR_BGR2GRAY)
    steps = cv2.Sobel(cv2.GaussianBlur(part.astype(np.float32), (0, 0), 1.0), cv2.CV_32F, 1, 0, scale=1 / 8)
    upright_edge = np.abs(np.median(steps, axis=0))
    reach = round(0.25 * (right - left))
    found = []
    for start, way in ((round(left + scenery.bead), -1), (round(right - scenery.bead), 1)):
        x = np.clip(start + way * np.arange(reach), 1, len(upright_edge) - 2)
        strength = upright_edge[x]
        peaks = [k for k in range(1, reach - 1) if strength[k] >= max(strength[k - 1], strength[k + 1])]
        clear = [k for k in peaks if strength[k] > 0.5 * strength.max() and strength[k] > 2.0]
        if not clear:
            return None
        found.append(float(x[clear[0]]))
    middle = (scenery.slot.left + scenery.slot.right) / 2
    lopsided = abs(found[0] + found[1] - 2 * middle) / (found[1] - found[0])
    return (found[0], found[1]) if lopsided < 0.12 else None


def bead_mask(picture: Image, scenery: Scenery) -> Mask:
    """Mask of beads in an upright picture that are not part of the empty hopper."""
    differs = cv2.GaussianBlur(apart(picture, scenery.empty), (0, 0), max(0.1 * scenery.bead, 0.8))
    odds = scenery.odds[colour_cells(picture, 0.5 * scenery.bead)]
    found = ((differs > scenery.level) & (odds > -0.5)).astype(np.uint8)
    return np.asarray(opened(found, max(2, round(0.25 * scenery.bead))) > 0)


def slide_strip(picture: Image, scenery: Scenery) -> Image:
    """Rows at the slide's level, with the colours of a column side by side, shape (width, 3 x rows)."""
    rows = picture[_strip_rows(scenery)]
    return np.ascontiguousarray(rows.transpose(1, 0, 2).reshape(picture.shape[1], -1))


def _strip_rows(scenery: Scenery) -> slice:
    top = round(scenery.slot.row + 1)
    return slice(top, top + int(np.clip(round(0.6 * scenery.bead), 4, 12)))


def _usual_sight(scene: Scene, scenery: Scenery) -> tuple[slice, Usual]:
    """Usual colours of the rows around bed and slot."""
    slot, bead = scenery.slot, scenery.bead
    first = max(round(int(np.argmax(scenery.bed.any(axis=1))) - AROUND * bead), 0)
    rows = slice(first, round(slot.row + AROUND * bead))
    mostly = scene.picture if _straight(scenery.turn) else _turned(scene.picture, scenery.turn)
    return rows, usual_sight(
        scenery.full[rows],
        scenery.empty[rows],
        mostly[rows],
        scenery.bed[rows],
        slot_row=slot.row - first,
        bead=bead,
        noise=scenery.noise,
    )


def _strange(picture: Image, rows: slice, usual: Usual) -> tuple[Mask, bool]:
    """Mask of foreign objects in an upright picture, and whether one approaches the bed from the side."""
    strange = np.zeros(picture.shape[:2], dtype=bool)
    part = np.ascontiguousarray(picture[rows])
    strange[rows] = foreign(part, usual)
    return strange, crosses(part, usual)


def _upright_frames(video: Video, scene: Scene, lens: Cut, turn: Array) -> Iterator[Steadied]:
    straight = _straight(turn)
    for frame in steadied(video, scene, lens):
        yield frame if straight else replace(frame, colour=_turned(frame.colour, turn))


def _straight(turn: Array) -> bool:
    return np.allclose(turn, np.eye(2, 3), atol=1e-4)


def _turned(picture: npt.NDArray[Any], turn: Array) -> npt.NDArray[Any]:
    size = (picture.shape[1], picture.shape[0])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    turned = cv2.warpAffine(picture, turn, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(turned, dtype=picture.dtype)


def _scenery(
    video: Video, scene: Scene, lens: Cut, turn: Array, bead: float | None, stated: Slot | None = None
) -> Scenery:
    firsts: list[Image] = []
    lasts: list[Image] = []
    for frame in _upright_frames(video, scene, lens, turn):
        if len(firsts) < ENDS:
            firsts.append(frame.colour)
        lasts = [*lasts, frame.colour][-ENDS:]
    full, empty = (middle_picture(pictures) for pictures in (firsts, lasts))
    noise = max(float(np.median(apart(lasts[0], lasts[-1]))) / 1.4, 0.7)
    differs = np.asarray(cv2.GaussianBlur(apart(full, empty), (0, 0), 1.5), dtype=np.uint8)
    level = max(CLEAR / 2 * noise, 0.5 * _otsu(differs))
    bed = _bed(np.asarray(differs > level), full)
    if bed is None:
        raise NothingToMeasure(
            f"{video.path}: {100 * float(np.mean(differs > level)):.1f} % of the picture differ between the first and "
            f"the last {ENDS} frames ({video.first} to {video.last}), but not in a region with the size and the free "
            "border of a bed; give a clip that begins before the slot opens and ends when the last bead has left, with "
            "the camera at rest, or move --start, --end and --region to it."
        )
    beads = find_beads(*_searched(full, bed)) if bead is None else None
    width = float(np.ptp(np.nonzero(bed)[1]))
    seen = bead or (2 * beads.radius if beads is not None else BEAD_SHARE * width)
    slot = _slot(bed, seen) if stated is None else _usable(stated, bed, seen, video, lens)
    if stated is not None:
        bed[round(slot.row) :] = False
    cells_full, cells_empty = colour_cells(full, 0.5 * seen), colour_cells(empty, 0.5 * seen)
    core = cv2.erode(bed.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    below = np.zeros_like(bed)
    below[round(slot.row) : round(slot.row + 6 * seen), round(slot.left) : round(slot.right)] = True
    here, there = shares(cells_full[core]), shares(cells_empty[bed | below])
    little = rare(here, cells_full[core])
    odds = np.clip(np.log((here + little) / (there + little)), -3, 3)
    if stated is None:
        slot = _above_slide(np.asarray(odds)[cells_full], bed & (odds[cells_full] > 0.7), slot, seen)
    if slot.row + seen > full.shape[0]:
        raise NothingToMeasure(
            f"{video.path}: the slot {'stated' if slot.stated else 'found'} lies at y = "
            f"{_ends_of(slot, lens)[0][1]:.0f} px, less than a bead diameter "
            f"({seen / lens.zoom:.0f} px) above the lower edge of what is looked at; show about five bead diameters "
            "below it as well, or give a larger --region.",
            Seen(frame=video.first, marks=(Mark("slot", _ends_of(slot, lens)),)),
        )
    contrast = float(np.median(apart(full, empty)[core]))
    return Scenery(
        full,
        empty,
        bed,
        slot,
        seen,
        np.asarray(odds),
        noise,
        max(CLEAR / 2 * noise, 0.25 * contrast),
        turn,
        bead is not None or beads is not None,
        contrast,
    )


def _usable(slot: Slot, bed: Mask, bead: float, video: Video, lens: Cut) -> Slot:
    """The stated slot; refused where it is narrower than a bead, or nothing that empties lies above it."""
    marks = Seen(frame=video.first, marks=(Mark("slot", _ends_of(slot, lens)),))
    if slot.right - slot.left < bead:
        raise NothingToMeasure(
            f"{video.path}: --slot is {(slot.right - slot.left) / lens.zoom:.0f} px wide, less than a bead "
            f"({bead / lens.zoom:.0f} px); state the two edges of the outlet.",
            marks,
        )
    left, right = max(round(slot.left - bead), 0), round(slot.right + bead)
    if not bed[: max(round(slot.row), 0), left:right].any():
        raise NothingToMeasure(
            f"{video.path}: nothing that is there in the first {ENDS} frames and gone in the last {ENDS} "
            f"({video.first} to {video.last}) lies above --slot; state the two edges of the outlet below the bed.",
            marks,
        )
    return slot


def _ends_of(slot: Slot, lens: Cut) -> list[tuple[float, float]]:
    """Ends of the slot in pixels of the clip (not turned back by the roll of the camera)."""
    return [(x, y) for x, y in lens.in_clip(np.array([[slot.left, slot.row], [slot.right, slot.row]])).tolist()]


def _searched(picture: Image, bed: Mask) -> tuple[Image, tuple[float, float]]:
    """The picture of the bed alone, and the range of possible bead radii [px]."""
    rows, columns = np.nonzero(bed)
    crop = picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    width = float(np.ptp(columns))
    return np.asarray(cv2.cvtColor(crop, cv2.COLOR_BGR2GRAY), np.uint8), (max(0.012 * width, 2.5), 0.15 * width)


def _otsu(values: npt.NDArray[np.uint8]) -> float:
    level, _ = cv2.threshold(values, 0, 255, cv2.THRESH_OTSU)
    return float(level)


def _bed(differs: Mask, full: Image) -> Mask | None:
    """The upper of the two large regions that changed, which is the bed; the lower one is where it went."""
    changed = differs.astype(np.uint8)
    within = closed(changed, GAPS)
    if within.all():  # everything changed, so there is no edge to measure the depth from
        return None
    deep = 2 * float(cv2.distanceTransform(within, cv2.DIST_L2, 3).max())
    slender = max(SLENDER, round(deep / NARROWEST))
    marked = closed(changed, slender * GAPS // SLENDER)
    marked = opened(marked, slender)
    count, labels, stats, centres = cv2.connectedComponentsWithStats(marked, connectivity=4)
    if count < 2:
        return None
    areas = stats[1:, cv2.CC_STAT_AREA]
    large = [k + 1 for k in range(count - 1) if areas[k] > 0.2 * areas.max() and areas[k] > 0.004 * differs.size]
    if not large:
        return None
    upper = min(large, key=lambda k: centres[k][1])
    # a bar in front of the hopper splits the bed in two; a hand at the slide that has left the view is not part of it
    reach = 0.5 * stats[upper, cv2.CC_STAT_HEIGHT]
    cells = colour_cells(full, ALIKE_BLUR)
    beads = np.sqrt(shares(cells[labels == upper]))
    parts = [k for k in large if abs(centres[k][1] - centres[upper][1]) < reach]
    return np.isin(labels, [k for k in parts if float(beads @ np.sqrt(shares(cells[labels == k]))) > ALIKE])


def _slot(bed: Mask, bead: float) -> Slot:
    """Row where the bed rests on the slide, and its width there."""
    rows = np.flatnonzero(bed.any(axis=1))
    lowest = int(rows[-1])
    columns = np.flatnonzero(bed[max(lowest - round(0.4 * bead), 0) : lowest + 1].any(axis=0))
    inner = columns[len(columns) // 8 : len(columns) - len(columns) // 8]
    bottoms = bed.shape[0] - 1 - np.argmax(bed[::-1, inner], axis=0)
    # beads touch the slide only with their lowest points
    return Slot(float(np.percentile(bottoms, 70)) + 0.5, float(columns[0]) - 0.5, float(columns[-1]) + 0.5)


def _above_slide(odds: Array, coloured: Mask, slot: Slot, bead: float) -> Slot:
    """The slot where the beads' colour ends: the slide below them also leaves, so it looks like a part of the bed."""
    inset = round(0.12 * (slot.right - slot.left))
    columns = slice(round(slot.left) + inset, max(round(slot.right) - inset, round(slot.left) + inset + 1))
    rows = np.flatnonzero(coloured.any(axis=1))
    first = max(round(slot.row - max(1.2 * bead, 0.1 * float(np.ptp(rows)) if len(rows) else 0.0)), 0)
    alike = odds[first : round(slot.row + 0.3 * bead) + 1, columns].mean(axis=1)
    ended, level = _end_of_beads(alike, max(round(0.3 * bead), 1))
    if not ended:
        return replace(slot, sigma=0.4 * bead)
    row = first + ended
    seen = np.flatnonzero(coloured[max(row - round(0.4 * bead), 0) : row].any(axis=0))
    if len(seen) < 0.5 * (slot.right - slot.left):
        return replace(slot, sigma=0.4 * bead)
    # sub-pixel: interpolate the colour change between the last row of beads and the first of the slide
    above, below = alike[ended - 1] - level, alike[ended] - level
    crossing = row - 1 + above / max(above - below, 1e-6)
    sigma = max(SLOT_UNCERTAINTY * bead, 0.7)
    return Slot(float(crossing), float(seen[0]) - 0.5, float(seen[-1]) + 0.5, sigma)


def _end_of_beads(alike: Array, near: int) -> tuple[int, float]:
    """First row, downwards, whose log odds are not those of beads, and the level that they fall below; 0 if none.

    A slide in the beads' own colour follows them after a dip that may stay above even odds.
    """
    dip = DIP * float(np.median(alike[:near]))
    low = np.flatnonzero(alike < max(dip, 0.0))
    if len(low) == 0:
        return 0, 0.0
    even = np.flatnonzero(alike[low[0] : low[0] + near] < 0)
    return (int(low[0] + even[0]), 0.0) if len(even) else (int(low[0]), dip)


def _moment(frame: Steadied, before: Image | None, scenery: Scenery, strange: Mask) -> Moment:
    slot, bead = scenery.slot, scenery.bead
    mask = bead_mask(frame.colour, scenery) & ~strange
    row = round(slot.row)
    reach = cv2.dilate(scenery.bed.astype(np.uint8), np.ones((round(bead) | 1, round(bead) | 1), np.uint8)) > 0
    reach[row:] = False
    outlet = np.zeros_like(mask)
    outlet[row : round(slot.row + REACH_BELOW * bead), max(round(slot.left - bead), 0) : round(slot.right + bead)] = (
        True
    )
    above = mask & reach
    inside = (mask & (reach | outlet)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=8)
    least = LEAST_BEAD * math.pi / 4 * bead * bead
    tops = [
        _top_row(labels == k, stats[k])
        for k in range(1, count)
        if stats[k, cv2.CC_STAT_AREA] > least and stats[k, cv2.CC_STAT_HEIGHT] > 0.3 * bead
    ]
    columns = slice(max(round(slot.left), 0), round(slot.right))
    filled = np.asarray(mask[row:, columns].any(axis=1))
    hanging = int(np.argmin(filled)) if not filled.all() else len(filled)
    lowest = len(filled) - int(np.argmax(filled[::-1]))
    change = 0.0
    if before is not None:
        low = slice(max(row - round(3 * bead), 0), row)
        change = float(np.mean(apart(frame.colour[low, columns], before[low, columns])))
    return Moment(
        frame.index,
        frame.time,
        float(above.sum()),
        min(tops, default=math.inf),
        slot.row + hanging if hanging > 0 else math.nan,
        slot.row + lowest if filled.any() else math.nan,
        change,
        frame.pose,
        _covers(strange, scenery),
    )


def _covers(strange: Mask, scenery: Scenery) -> bool:
    """Whether something is in front of the bed or the slot; a hand may approach from the side to pull the slide."""
    slot, bead = scenery.slot, scenery.bead
    rows = slice(max(round(slot.row - AROUND * bead), 0), round(slot.row + AROUND * bead))
    columns = slice(max(round(slot.left - bead), 0), round(slot.right + bead))
    return bool((strange & scenery.bed).any() or strange[rows, columns].any())


def _beside(scenery: Scenery) -> Mask:
    """Mask where nothing should change: to both sides of the bed, well above the slide and the hand that pulls it."""
    columns = np.flatnonzero(scenery.bed.any(axis=0))
    beside = np.ones_like(scenery.bed)
    beside[:, max(round(columns[0] - 2 * scenery.bead), 0) : round(columns[-1] + 2 * scenery.bead)] = False
    beside[max(round(scenery.slot.row - 2 * scenery.bead), 0) :] = False
    return beside


def _hides(picture: Image, scenery: Scenery, beside: Mask) -> bool:
    """Whether something is in front of the static surroundings."""
    if beside.sum() < LEAST_BESIDE:
        return False
    # what is there before or after is not passing
    off = cv2.GaussianBlur(cv2.min(apart(picture, scenery.full), apart(picture, scenery.empty)), (0, 0), 2.0)[beside]
    # flicker of the light changes all pixels alike
    return bool(np.mean(off > 15 + CLEAR * scenery.noise + np.median(off)) > PASSES)


def _top_row(part: Mask, stats: npt.NDArray[np.int32]) -> float:
    return float(stats[cv2.CC_STAT_TOP]) - 0.5


def _residue(scenery: Scenery) -> float:
    """Share of the bed's area that still has the bed's colour, unchanged, at the end."""
    odds = scenery.odds[colour_cells(scenery.empty, 0.5 * scenery.bead)]
    alike = cv2.erode(((odds > 1.0) & scenery.bed).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    unchanged = apart(scenery.full, scenery.empty) < scenery.level
    return float(np.mean((alike & unchanged)[scenery.bed]))
