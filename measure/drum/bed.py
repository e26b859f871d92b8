"""Segment the moving bed of beads in a drum, frame by frame, by colour, motion and texture.

The bed moves and the empty drum does not, so motion averaged over the clip shows where the bed is.  The pixels there
and elsewhere are training data for a classifier of single frames.  A single picture has no motion; there the bed is the
lower of the two colours in the drum.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, Image
from rigtwin.lab.camera import STATED_SIGMA, Camera
from rigtwin.lab.errors import BadInput, Mark, NothingToMeasure, Seen
from rigtwin.lab.progress import Progress, silent
from rigtwin.measure.bulk.bead_spacing import bead_spacing
from rigtwin.measure.bulk.beads import colour_cells, rare, shares
from rigtwin.measure.bulk.checks import NEIGHBOURS_UNCERTAINTY
from rigtwin.measure.drum.evaluate import USUAL_SHARE
from rigtwin.measure.drum.glare import brightened_share
from rigtwin.measure.drum.rim import LEAST_SUPPORT, Rim, compared, find_rim, rim_of_bed, stated_rim
from rigtwin.measure.drum.rotation import sector_of, turning_of
from rigtwin.measure.geometry.camera_roll import Upright, upright
from rigtwin.measure.geometry.disc_morphology import odd, opened
from rigtwin.measure.media.video import Video
from rigtwin.measure.robust import mad_std
from rigtwin.measure.scene.contrast_stretch import Exposure, exposure_of
from rigtwin.measure.scene.pose import Pose
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.scene.steadied_frames import Cut, Steadied, apart, cut_for, steadied, still_scene

SAMPLES = 41  # frames used as training data for bed and drum
SPACINGS = 5  # frames in which the distance of the beads is measured; it scatters by 2 % from frame to frame
GRAIN_SHARE = 0.012  # the same in a single picture, whose bed may be of powder
STEPS = 32  # bins of a histogram of motion or texture
STANDS_OUT = 1.6  # least motion over noise
PIECE = 0.08  # least size of a separate part of the bed, as a share of the largest part
NOISY = 6.0  # [grey levels], noise above which frames are smoothed
LEAST_NOISE = 0.5  # [grey levels]; compression may remove all noise from a static scene
UNDECIDED = 0.5  # [bead diameters], band on both sides of the mean border that is decided by the single frame alone
MISFIT = 0.15  # share of the radius by which the border of a bed may deviate from the drum's circle
GAP = 3.0  # [bead diameters], empty drum between the bed and other things that look like it
BESIDE = 1.15  # share of the drum's radius outside which nothing should move; walls and flanges are a tenth of it thick
# Least share of the picture outside the drum that an object in front of it hides.  A finger 2 cm wide that reaches half
# across a view of 30 cm hides 3 %; rollers and belts that turn with the drum hide less.
PASSES = 0.03
SHIFT = 0.8  # [1], change of the log odds by one standard deviation of the border between bead and drum


@dataclass(frozen=True)
class Still:
    """One frame registered to the static scene, at the zoom of the analysis."""

    index: int
    time: float  # [s]
    colour: Image  # BGR
    change: FloatImage  # [grey levels], mean absolute difference to the frames before and after
    pose: Pose
    hidden: bool = False  # something passes in front of the scene


@dataclass(frozen=True)
class Looks:
    """Log likelihood ratios of beads against the empty drum by a pixel's colour, motion and texture."""

    colour: Array  # by colour cell
    change: Array  # by bin of log motion
    texture: Array  # by bin of log texture
    before: FloatImage  # prior log odds by place, from the motion over the whole clip
    noise: float  # [grey levels], motion of a static scene
    bead: float  # [px], bead diameter


@dataclass(frozen=True)
class Outline:
    """Upper border of the bed in one frame; upright, in px, x from the drum's axis, heights above it, NaN: no bed."""

    index: int
    time: float  # [s]
    x: Array  # shape (n,)
    height: Array  # shape (n,)
    looser: Array  # heights with a lower threshold for bead pixels
    stricter: Array  # heights with a higher threshold
    area: float  # [px^2], of the bed
    shake: tuple[float, float]  # [px]
    hidden: bool = False  # something passes in front of the drum


@dataclass(frozen=True)
class Bed:
    """A drum, its pose in the picture, and the surface of its bed over time."""

    outlines: tuple[Outline, ...]
    rim: Rim
    rim_seen: bool
    upright: Upright
    bead: float  # [px]
    lens: Cut
    clearness: float  # [1], motion of the bed (or its colour difference) over noise
    poses: tuple[Pose, ...]  # of the clip's frames
    shows_motion: bool
    glare: float  # [1], share of the surface under a reflection; NaN: not judged
    shape: tuple[int, ...]  # [px], height and width of the analysed picture
    bed_direction: float  # [rad], direction of the bed's middle from the drum's axis: 0 below it, positive to the right
    turning: int = 0  # direction of the beads at the wall: +1 clockwise, -1 anticlockwise, 0 unknown
    spacing: float | None = None  # [px], distance of neighbouring beads, None where the bed shows no pattern of beads


def follow_bed(video: Video, camera: Camera, *, bead_share: float | None, progress: Progress = silent) -> Bed:
    """Find the surface of the bed in every frame; `bead_share` is bead over drum diameter where both are known.

    Raises `NothingToMeasure` if no turning drum with a bed in it is found.
    """
    lens = cut_for(video.width, video.height, camera.region)
    scene = still_scene(video, lens)
    wanted = set(np.unique(np.linspace(video.first, video.last, SAMPLES).round().astype(int)).tolist())
    samples, poses = [], []
    count = video.last - video.first + 1
    exposure = exposure_of(scene.picture)
    for still in _stills(video, scene, lens, exposure):
        poses.append(still.pose)
        if still.index in wanted:
            samples.append(still)
        progress("learning what bed and drum look like", len(poses), count)
    picture = exposure.applied(np.clip(scene.picture, 0, 255).astype(np.uint8)).astype(np.float32)
    stated = _stated_rim(scene.picture, camera, lens)
    motion, noise, rim, rim_seen = _drum_in(samples, scene.picture, stated)
    if rim is not None:
        # what passes in front of the drum is neither bed nor drum; what stays for half of the clip belongs to the scene
        beside = ~rim.inside(picture.shape, BESIDE)
        free = [still for still in samples if not _hides(still, picture, beside)]
        if len(samples) > len(free) >= len(samples) / 2:
            samples = free
            motion, noise, rim, rim_seen = _drum_in(samples, scene.picture, stated)
    if rim is None:
        raise NothingToMeasure(
            f"{video.path}: no round rim was found around what moves between {len(samples)} frames from {video.first} "
            f"to {video.last}, and its lower border is no arc of a circle within {100 * MISFIT:.0f} % of the radius; "
            "film the drum's end, the whole rim in view, with the camera at rest, or state the inner rim with --circle "
            "cx,cy,r."
        )
    turned = _upright(scene.picture, rim, camera.roll)
    bead = (bead_share or USUAL_SHARE) * 2 * rim.radius
    looks = _learn(samples, motion, rim, bead)
    if looks is None:
        advice = "give a clip in which the drum turns, or state its inner rim with --circle cx,cy,r"
        if bead_share and _learn(samples, motion, rim, USUAL_SHARE * 2 * rim.radius) is not None:
            advice = (
                f"with beads of {100 * USUAL_SHARE:.0f} % of the drum's diameter it does, by the stated sizes they are "
                f"{100 * bead_share:.0f} %: check --drum-diameter and --bead-diameter"
            )
        raise NothingToMeasure(
            f"{video.path}: what changes between the frames inside {circle_of(rim, lens)} does not divide into a "
            f"moving bed and a part that stays as it is; {advice}.",
            Seen(marks=rim_seen_at(rim, lens)),
        )
    outlines = []
    sector = sector_of(looks.before, rim)
    rings: list[Image] = []
    beside = ~rim.inside(picture.shape, BESIDE)
    for still in _stills(video, scene, lens, exposure):
        if sector is not None:
            rings.append(sector.seen(np.asarray(cv2.cvtColor(still.colour, cv2.COLOR_BGR2GRAY), dtype=np.uint8)))
        hides = _hides(still, picture, beside)
        outlines.append(replace(_outline(still, looks, rim, turned.roll), hidden=hides))
        progress("following the bed's surface", len(outlines), count)
    inside = motion[rim.inside(motion.shape, 0.95)]
    clearness = float(np.percentile(inside, 95) / max(noise, 1e-6))
    heights = np.array([outline.height for outline in outlines])
    colours = [still.colour for still in samples]
    glare = brightened_share(colours, outlines[0].x, heights, rim.centre, rim.radius, turned.roll, bead)
    direction = _bed_direction(looks.before > 0, rim, turned.roll)
    return Bed(
        tuple(outlines),
        rim,
        rim_seen,
        turned,
        bead,
        lens,
        clearness,
        tuple(poses),
        True,
        glare,
        picture.shape,
        direction,
        turning_of(rings),
        _spacing(colours, (looks.before > 0) & rim.inside(picture.shape, 0.97)),
    )


def bed_in_photo(path: Path, photo: Image, camera: Camera, *, bead_share: float | None) -> Bed:
    """Find the surface of the bed in a single picture.

    Raises `NothingToMeasure` if it shows no drum with a bed.
    """
    lens = cut_for(photo.shape[1], photo.shape[0], camera.region)
    image = lens.seen(photo)
    image = exposure_of(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)).applied(image)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    stated, rim = _stated_rim(np.asarray(grey), camera, lens), find_rim(np.asarray(grey, dtype=np.float32))
    if stated is not None:
        rim = compared(stated, rim)
    if rim is None:
        raise NothingToMeasure(
            f"{path}: no circle was found with an edge along {100 * LEAST_SUPPORT:.0f} % of it or more; give a picture "
            "of the drum's end with the whole rim in view, or state the inner rim with --circle cx,cy,r."
        )
    turned = _upright(np.asarray(grey, dtype=np.float32), rim, camera.roll)
    bead = (bead_share or GRAIN_SHARE) * 2 * rim.radius
    still = Still(0, 0.0, image, np.zeros(grey.shape, dtype=np.float32), Pose())
    bed, empty, clearness = _two_colours(image, rim, bead)
    if bed is None or empty is None:
        raise NothingToMeasure(
            f"{path}: the colours inside {circle_of(rim, lens)} do not divide into a bed and an empty part; light the "
            "drum so that they differ, give a film, or state the inner rim with --circle cx,cy,r.",
            Seen(marks=rim_seen_at(rim, lens)),
        )
    looks = _looks([still], bed, empty, np.zeros(grey.shape, dtype=np.float32), 1.0, bead)
    outline = _outline(still, looks, rim, turned.roll)
    direction = _bed_direction(bed, rim, turned.roll)
    spacing = _spacing([image], bed)
    shape = grey.shape
    return Bed(
        (outline,), rim, True, turned, bead, lens, clearness, (), False, math.nan, shape, direction, spacing=spacing
    )


def rim_seen_at(rim: Rim, lens: Cut) -> tuple[Mark, ...]:
    """The circle of a drum in pixels of the clip, for the picture of a refusal."""
    ((x, y),) = lens.in_clip(np.array([rim.centre])).tolist()
    return (Mark("stated rim" if rim.stated else "rim found", [(x, y)], rim.radius / lens.zoom),)


def circle_of(rim: Rim, lens: Cut) -> str:
    (mark,) = rim_seen_at(rim, lens)
    ((x, y),) = mark.points
    found = "stated" if rim.stated else "found"
    return f"the {found} circle of radius {mark.radius:.0f} px around {x:.0f},{y:.0f}"


def _spacing(pictures: list[Image], bed: npt.NDArray[np.bool_]) -> float | None:
    """Median distance of neighbouring beads [px] in pictures of a bed; None if most do not show it, or do not agree."""
    few = pictures[:: math.ceil(len(pictures) / SPACINGS)]
    found = [spacing for spacing in (bead_spacing(picture, bed) for picture in few) if spacing is not None]
    usual = float(np.median(found)) if found else math.nan
    agreeing = sum(abs(spacing / usual - 1) < 3 * NEIGHBOURS_UNCERTAINTY for spacing in found)
    return usual if 2 * agreeing > len(few) else None


def _stills(video: Video, scene: Scene, lens: Cut, exposure: Exposure) -> Iterator[Still]:
    """Every frame with its change against the frames before and after."""
    waiting: list[Steadied] = []
    blur: float | None = None
    for seen in steadied(video, scene, lens):
        if blur is None:
            blur = _blur_against_noise(seen.colour, scene.picture)
        colour = cv2.GaussianBlur(seen.colour, (0, 0), blur) if blur else seen.colour
        waiting.append(replace(seen, colour=exposure.applied(np.asarray(colour, dtype=np.uint8))))
        if len(waiting) == 2:
            yield _still(waiting[0], waiting[1:])
        elif len(waiting) == 3:
            yield _still(waiting[1], [waiting[0], waiting[2]])
            del waiting[0]
    if len(waiting) == 2:
        yield _still(waiting[1], waiting[:1])


def _blur_against_noise(frame: Image, picture: FloatImage) -> float:
    """Width [px] of the blur for frames so noisy that the motion of slow beads is lost; 0 if none is needed."""
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32)
    off = grey - picture
    noise = mad_std(off)  # without the offset of a flickering lamp
    return float(np.clip(noise / NOISY, 1.0, 2.0)) if noise > NOISY else 0.0


def _still(now: Steadied, others: list[Steadied]) -> Still:
    change = np.mean(np.stack([apart(now.colour, other.colour) for other in others]), axis=0, dtype=np.float32)
    return Still(now.index, now.time, now.colour, np.asarray(change, dtype=np.float32), now.pose)


def _stated_rim(picture: FloatImage, camera: Camera, lens: Cut) -> Rim | None:
    """The circle that the user states, in analysed pixels; None if none is stated."""
    if camera.circle is None:
        return None
    x, y, radius = camera.circle
    ((x, y),) = lens.of_clip(np.array([[x, y]]))
    rim = stated_rim(picture, (float(x), float(y), radius * lens.zoom), STATED_SIGMA * lens.zoom)
    if not rim.inside(picture.shape).any():
        x, y, radius = camera.circle
        raise BadInput(
            f"measure drum: no part of --circle {x:g},{y:g},{radius:g} lies inside the picture or --region; correct "
            "one of them.",
            Seen(),
        )
    return rim


def _drum_in(
    samples: list[Still], picture: FloatImage, stated: Rim | None
) -> tuple[FloatImage, float, Rim | None, bool]:
    """Motion over the clip, its noise, the drum, and whether its rim was found or stated."""
    motion = _motion(samples)
    noise = max(float(np.median(motion)), LEAST_NOISE)
    moving = motion > max(STANDS_OUT * noise, _otsu(motion))
    rim = find_rim(picture, moving)
    if stated is not None:
        return motion, noise, compared(stated, rim), True
    if rim is not None:
        return motion, noise, rim, True
    rim = rim_of_bed(moving)
    # only the lower border of a bed is an arc that fits a circle
    return motion, noise, rim if rim is not None and rim.sigma < MISFIT * rim.radius else None, False


def _hides(still: Still, picture: FloatImage, beside: npt.NDArray[np.bool_]) -> bool:
    """Whether a part of the static surroundings looks different in this frame; flicker of the light is removed."""
    grey = cv2.cvtColor(still.colour, cv2.COLOR_BGR2GRAY).astype(np.float32)
    off = cv2.GaussianBlur(grey - picture, (0, 0), 2.0)[beside]
    if off.size < 500:
        return False
    off = np.abs(off - np.median(off))
    return bool(np.mean(off > 15 + 4 * np.median(off)) > PASSES)


def _motion(samples: list[Still]) -> FloatImage:
    """Change of every pixel: between neighbouring frames plus between samples across the clip."""
    quick = np.mean([still.change for still in samples], axis=0)
    slow = np.mean(
        [apart(one.colour, other.colour) for one, other in itertools.pairwise(samples)],
        axis=0,
    )
    return np.asarray(cv2.GaussianBlur((quick + slow).astype(np.float32), (0, 0), 2.0), dtype=np.float32)


def _otsu(values: FloatImage) -> float:
    """Otsu threshold of the logarithms of the values."""
    logs = np.log(values + 0.1)
    low, high = float(logs.min()), float(logs.max())
    if high - low < 1e-6:
        return math.inf
    levels = ((logs - low) / (high - low) * 255).astype(np.uint8)
    level, _ = cv2.threshold(levels.reshape(-1, 1), 0, 255, cv2.THRESH_OTSU)
    return math.exp(low + (level + 0.5) / 255 * (high - low)) - 0.1


def _upright(picture: FloatImage, rim: Rim, roll: float | None) -> Upright:
    y = np.arange(picture.shape[0])[:, None] + np.zeros(picture.shape[1])
    return upright(
        picture, given=roll, stand=y > rim.centre[1] + 0.8 * rim.radius, apart_from=rim.inside(picture.shape, 1.15)
    )


def _bed_direction(bed: npt.NDArray[np.bool_], rim: Rim, roll: float) -> float:
    """Direction of the bed's middle from the drum's axis [rad], in the upright picture."""
    rows, columns = np.nonzero(bed & rim.inside(bed.shape, 1.0))
    if len(rows) == 0:
        return math.nan
    right, down = float(columns.mean()) - rim.centre[0], float(rows.mean()) - rim.centre[1]
    turned = math.atan2(right, down) + roll  # in a scene turned clockwise the bed appears further left
    return math.remainder(turned, 2 * math.pi)


def _learn(samples: list[Still], motion: FloatImage, rim: Rim, bead: float) -> Looks | None:
    """Learn the looks of bed and empty drum from where there is motion over the clip and where there is none."""
    inside = rim.inside(motion.shape, 0.97)
    smooth = cv2.GaussianBlur(motion, (0, 0), max(0.3 * bead, 1.5))
    noise = max(float(np.median(motion)), LEAST_NOISE)
    level = _otsu(np.asarray(smooth[inside], dtype=np.float32))
    marked = (smooth > level) & inside
    if not 0.02 < float(np.mean(marked[inside])) < 0.9 or level < 1.15 * float(np.percentile(smooth[inside], 5)):
        return None
    away = cv2.distanceTransform((~marked).astype(np.uint8), cv2.DIST_L2, 3)
    within = cv2.distanceTransform(marked.astype(np.uint8), cv2.DIST_L2, 3)
    bed, empty = within > 0.6 * bead, (away > 0.8 * bead) & rim.inside(motion.shape, 0.94)
    if bed.sum() < 200 or empty.sum() < 200:
        return None
    # the smoothed motion extends further than the beads
    depth = (within - away) / bead - 1 / 3
    before = (3 * np.sign(depth) * np.clip(np.abs(depth) - UNDECIDED, 0, 1)).astype(np.float32)
    return _looks(samples, bed, empty, before, noise, bead)


def _looks(
    samples: list[Still],
    bed: npt.NDArray[np.bool_],
    empty: npt.NDArray[np.bool_],
    before: FloatImage,
    noise: float,
    bead: float,
) -> Looks:
    cells = [colour_cells(still.colour, 0.5 * bead) for still in samples]
    here = shares(np.concatenate([cell[bed] for cell in cells]))
    there = shares(np.concatenate([cell[empty] for cell in cells]))
    little = rare(here, np.concatenate([cell[bed] for cell in cells[:3]]))
    ratios = []
    for feature in (_change_steps, _texture_steps):
        steps = [feature(still, noise, bead) for still in samples]
        counts = [
            np.bincount(np.concatenate([step[part] for step in steps]), minlength=STEPS)[:STEPS] + 1.0
            for part in (bed, empty)
        ]
        smooth = [np.convolve(count / count.sum(), [0.25, 0.5, 0.25], mode="same") + 1e-3 for count in counts]
        ratios.append(np.log(smooth[0] / smooth[1]))
    colour = np.log((here + little) / (there + little))
    return Looks(np.asarray(colour), ratios[0], ratios[1], before, noise, bead)


def _change_steps(still: Still, noise: float, bead: float) -> npt.NDArray[np.int64]:
    smooth = cv2.GaussianBlur(still.change, (0, 0), max(0.12 * bead, 1.0))
    return _steps(np.asarray(smooth / noise, dtype=np.float32))


def _texture_steps(still: Still, noise: float, bead: float) -> npt.NDArray[np.int64]:
    grey = cv2.cvtColor(still.colour, cv2.COLOR_BGR2GRAY).astype(np.float32)
    fine = grey - cv2.GaussianBlur(grey, (0, 0), max(0.25 * bead, 1.5))
    rough = np.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), max(0.2 * bead, 1.5)))
    return _steps(np.asarray(rough / noise, dtype=np.float32))


def _steps(values: FloatImage) -> npt.NDArray[np.int64]:
    return np.asarray(np.clip((np.log2(values + 0.06) + 4) * 3, 0, STEPS - 1), dtype=np.int64)


def _evidence(still: Still, looks: Looks) -> FloatImage:
    """Log odds that a pixel belongs to a bead."""
    colour = np.clip(looks.colour, -3, 3)[colour_cells(still.colour, 0.5 * looks.bead)]
    change = np.clip(looks.change, -2, 2)[_change_steps(still, looks.noise, looks.bead)]
    texture = np.clip(looks.texture, -1.5, 1.5)[_texture_steps(still, looks.noise, looks.bead)]
    odds = (colour + 0.5 * change + 0.5 * texture + looks.before).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(odds, (0, 0), max(0.08 * looks.bead, 0.7)), dtype=np.float32)


def _outline(still: Still, looks: Looks, rim: Rim, roll: float) -> Outline:
    reach = math.ceil(rim.radius)
    cos, sin = math.cos(roll), math.sin(roll)
    # picture point of the upright point (x, h): centre + x (cos, sin) + h (sin, -cos)
    turn = np.array(
        [
            [cos, -sin, rim.centre[0] - reach * cos + reach * sin],
            [sin, cos, rim.centre[1] - reach * sin - reach * cos],
        ]
    )

    def upright_map(picture: FloatImage) -> FloatImage:
        seen = cv2.warpAffine(
            picture,
            turn,
            (2 * reach + 1, 2 * reach + 1),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=-3.0,
        )
        return np.asarray(seen, dtype=np.float32)

    odds = upright_map(_evidence(still, looks))
    # the threshold is uncertain near the mean border; far from it the presence of the bed is certain
    uncertain = np.where(np.abs(upright_map(looks.before)) < 2.9, np.float32(SHIFT), np.float32(0))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    odds[np.hypot(x, y) > rim.radius] = -3.0
    usual, area = _top(odds, looks.bead)
    looser, stricter = (_top(odds + sign * uncertain, looks.bead)[0] for sign in (1, -1))
    return Outline(
        still.index,
        still.time,
        np.arange(-reach, reach + 1, dtype=np.float64),
        reach - usual,
        reach - looser,
        reach - stricter,
        area,
        still.pose.shake,
    )


def _top(odds: FloatImage, bead: float) -> tuple[Array, float]:
    """Row of the upper border of the large groups of bead pixels by column, NaN if there is none; and their area."""
    marked = opened((odds > 0).astype(np.uint8), odd(0.35 * bead))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(marked, connectivity=4)
    if count < 2:
        return np.full(odds.shape[1], np.nan), 0.0
    areas = stats[:, cv2.CC_STAT_AREA]
    # a bar in front of the drum splits the bed in two; much smaller groups are flying beads
    bed = np.isin(labels, 1 + np.flatnonzero(areas[1:] > PIECE * areas[1:].max()))
    row = _top_of_lowest(bed, GAP * bead)
    columns = np.arange(odds.shape[1])
    # sub-pixel: the border lies where the log odds change sign between two pixels
    below, above = odds[row, columns], odds[np.maximum(row - 1, 0), columns]
    part = np.where((below > 0) & (above < 0), below / np.maximum(below - above, 1e-6), 0.5)
    return np.where(bed.any(axis=0), row - part, np.nan), float(bed.sum())


def _top_of_lowest(bed: npt.NDArray[np.bool_], gap: float) -> npt.NDArray[np.int64]:
    """By column, the first row of the lowest stretch without a gap of `gap` [px]; the last row if there is none.

    Pixels connected to the bed along the wall, such as a turning rim, are not its surface.
    """
    joined = cv2.morphologyEx(bed.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((round(gap) | 1, 1), np.uint8))[::-1] > 0
    lowest = np.argmax(joined, axis=0)
    ended = ~joined & (np.arange(len(joined))[:, None] > lowest)
    length = np.where(ended.any(axis=0), np.argmax(ended, axis=0), len(joined))
    return np.asarray(np.minimum(len(joined) - length, len(joined) - 1))


def _two_colours(
    image: Image, rim: Rim, bead: float
) -> tuple[npt.NDArray[np.bool_] | None, npt.NDArray[np.bool_] | None, float]:
    """Cores of bed and empty drum in one picture: two classes of colour, the bed is the lower one."""
    inside = rim.inside(image.shape[:2], 0.95)
    lab = cv2.cvtColor(cv2.GaussianBlur(image, (0, 0), max(0.3 * bead, 1.0)), cv2.COLOR_BGR2LAB).astype(np.float32)
    pixels = np.ascontiguousarray(lab[inside])
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.2)
    cv2.setRNGSeed(1)
    _, labels, centres = cv2.kmeans(pixels, 2, np.empty(0, np.int32), criteria, 3, cv2.KMEANS_PP_CENTERS)
    rows = np.nonzero(inside)[0]
    of = labels.reshape(-1)
    if min(np.sum(of == 0), np.sum(of == 1)) < 0.02 * len(of):
        return None, None, 0.0
    lower = int(rows[of == 1].mean() > rows[of == 0].mean())
    spread = float(np.mean([pixels[of == k].std(axis=0).max() for k in (0, 1)]))
    clearness = float(np.linalg.norm(centres[0] - centres[1])) / max(spread, 0.5)
    bed = np.zeros(inside.shape, dtype=bool)
    bed[inside] = of == lower
    kernel = np.ones((max(3, round(0.5 * bead)),) * 2, np.uint8)
    cores = [cv2.erode(part.astype(np.uint8), kernel, borderValue=0) > 0 for part in (bed & inside, ~bed & inside)]
    if min(core.sum() for core in cores) < 50:
        return None, None, 0.0
    return cores[0], cores[1], clearness
