"""Where one bead hits another in a film: of all paths of what moves, the one that ends, fast, where another begins.

Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage, Image
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.media.compression import by_bits
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.scene.background import middle_picture
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tracking.detect import inside_region

Region = tuple[float, float, float, float]

LEAST_LEAP = 0.5  # bead diameters, of one from the bead that hits over to the one that is hit
MOST_MEETINGS = 8  # of one path with another, the longest ones, among which the film shows which is the collision
COMPARABLE = 0.4  # of how long and large the best of them are, that another is
HUNG = 0.5  # of how much beads differ from the scene, what is gone where one hung and another may have come
JUST_LEFT = 12  # frames, in which B has left the place where it hung and A has hardly come there
BENDS = 0.3  # of the way back to where B hung, by which that may lie beside a straight line
MOST_PIECES = 60  # of path, the farthest ones, among which a meeting is sought: noise has thousands
INNER = 0.7  # of a bead's radius, within which it is all bead
ONE_SIDED = 0.6  # of how much beads differ from the scene, what is left where brighter and darker are set off
MANY = 20_000  # pixels, of which the middle is known as well as of all
SHORTEST_HALF = 0.1  # [s], of a swing to and fro: no bead hangs from a thread of 10 mm
LOST = 4  # frames after which a path that was not seen again has ended


@dataclass
class Path:
    """What moves, frame by frame; `size` is the smaller side of its picture."""

    frames: list[int] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)  # [px]
    sizes: list[float] = field(default_factory=list)  # [px]

    def part(self, start: int, end: int) -> Path:
        return Path(self.frames[start:end], self.places[start:end], self.sizes[start:end])

    def at(self, frame: float) -> Array:
        """Place [px] in a frame between those seen; at an end, the last one seen."""
        places = np.array(self.places)
        return np.array([np.interp(frame, self.frames, places[:, k]) for k in (0, 1)])

    def along(self, frame: int) -> tuple[Array, Array]:
        """Place [px] and velocity [px/frame]."""
        return self.at(frame), (self.at(frame + 1) - self.at(frame - 1)) / 2

    def clear_of(self, place: Array, reach: float, *, from_end: bool) -> Path:
        """The path up to where it comes within `reach` of a place, or from where it has left it.

        Next to each other two beads show as one spot.
        """
        near = np.hypot(*(np.array(self.places) - place).T) <= reach
        if from_end:
            return self.part(0, int(np.argmax(near))) if np.any(near[4:]) and not np.any(near[:4]) else self
        return self.part(int(np.argmin(near)), len(self.frames)) if np.sum(~near) >= 4 else self

    @property
    def extent(self) -> float:
        """[px]"""
        return float(np.max(np.ptp(np.array(self.places), axis=0)))

    def velocity(self, *, at_end: bool) -> Array:
        """[px/frame] over the last or first few frames."""
        last = len(self.frames) - 1
        one, other = (max(last - 3, 0), last) if at_end else (0, min(3, last))
        if one == other:
            return np.zeros(2)
        return np.asarray((self.places[other] - self.places[one]) / (self.frames[other] - self.frames[one]))


@dataclass(frozen=True)
class Collision:
    """The two paths that meet, before the beads are followed in detail."""

    fall: Path  # bead A up to the collision
    rise: Path  # bead B from it on
    rest: Array  # [px], where B hangs
    radius: float  # [px]

    @property
    def weight(self) -> float:
        """How much of what moves in the film the two paths are."""
        return weight_of(self.fall) + weight_of(self.rise)

    @property
    def way(self) -> Array:
        """Unit vector, in which B leaves."""
        velocity = self.rise.velocity(at_end=False)
        return np.asarray(velocity / max(float(np.hypot(*velocity)), 1e-9))

    def of_every(self, every: int, first: int) -> Collision:
        """The same in frames of the clip, where paths counted `every` so many from the `first` on."""
        fall, rise = (
            Path([first + every * k for k in path.frames], path.places, path.sizes) for path in (self.fall, self.rise)
        )
        return Collision(fall, rise, self.rest, self.radius)


def weight_of(path: Path) -> float:
    """How far something moves, and how large it is."""
    return path.extent * math.sqrt(float(np.median(path.sizes)))


def find_paths(
    video: Video,
    scene: Scene,
    samples: dict[int, Frame],
    region: Region | None = None,
    progress: Progress = silent,
    *,
    every: int = 1,
) -> list[Path]:
    """Everything that moves against the still `scene`, linked from frame to frame and broken where its speed jumps.

    Of a high-speed film only `every` so many frames are looked at; paths count these then, from the clip's first.
    """
    paths: list[Path] = []
    shake = (0.0, 0.0)
    still = middle_picture([frame.colour for frame in samples.values()])
    least = np.maximum(4 * scene.noise, 8.0)
    if region is not None:
        least = np.where(inside_region(region, least.shape), least, np.inf)
    for frame in video.frames():
        since = frame.index - video.first
        if since % every:
            continue
        progress("looking for beads", since, video.last - video.first + 1)
        view = scene.view(frame.grey, shake)
        shake = view.shake
        # in colour: a brown bead on a grey wall may have the wall's grey on its lit side
        level = float(view.grey.mean()) / max(float(frame.grey.mean()), 1.0)  # the lamp's flicker
        blue, green, red = cv2.split(cv2.absdiff(_steady(frame.colour, shake, level), still))
        difference = np.asarray(cv2.max(cv2.max(blue, green), red), dtype=np.uint8)
        _link(paths, _spots(difference, least), frame.index if every == 1 else since // every)
    return [piece for path in paths for piece in _unbroken(path)]


def _steady(colour: Image, shake: tuple[float, float], level: float) -> Image:
    """A frame laid over the still scene, as `Scene.view` does it."""
    if abs(level - 1) > 0.004:
        colour = np.asarray(cv2.convertScaleAbs(colour, alpha=level), dtype=np.uint8)
    if max(abs(shake[0]), abs(shake[1])) < 0.03:
        return colour
    back = np.array([[1, 0, -shake[0]], [0, 1, -shake[1]]], dtype=np.float32)
    size = (colour.shape[1], colour.shape[0])
    return np.asarray(cv2.warpAffine(colour, back, size, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)


def _spots(difference: npt.NDArray[np.uint8], least: npt.NDArray[np.float32]) -> list[tuple[Array, float, float]]:
    """Compact spots that differ from the still scene: place [px], width [px], weight; heaviest first."""
    smooth = cv2.medianBlur(difference, 5)  # drops what is thinner than half its window, keeps edges
    mask = (smooth > least).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    marked = np.flatnonzero(mask)
    weights = np.bincount(labels.ravel()[marked], smooth.ravel()[marked], minlength=count)
    spots = []
    for k in np.argsort(weights[1:])[::-1][:12] + 1:
        x, y, width, height, area = (int(number) for number in stats[k])
        if area < 9 or min(width, height) > 0.3 * min(mask.shape):
            continue
        window = np.s_[y : y + height, x : x + width]
        spot = _core(np.where(labels[window] == k, smooth[window], 0))
        if spot is not None:
            spots.append((spot[0] + (x, y), spot[1], float(weights[k])))
    return spots


def _core(values: npt.NDArray[np.uint8]) -> tuple[Array, float] | None:
    """Middle and width of the thickest part of a spot: threads and faint shadows that hang on it fall away."""
    strong = values > 0.3 * np.percentile(values[values > 0], 90)
    depth = cv2.distanceTransform(np.pad(strong, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    deepest = float(np.max(depth))
    if deepest < 1.5:
        return None
    y, x = np.nonzero(depth > 0.4 * deepest)
    return np.array([np.mean(x), np.mean(y)]), 2 * deepest


def _link(paths: list[Path], spots: list[tuple[Array, float, float]], index: int) -> None:
    """Extend the living paths by the spots nearest to where they should be; the others begin new paths."""
    living = [path for path in paths if index - path.frames[-1] <= LOST]
    pairs = []
    for path in living:
        ahead = index - path.frames[-1]
        velocity = path.velocity(at_end=True)
        expected = path.places[-1] + velocity * ahead
        reach = 4 + 0.5 * path.sizes[-1] + 0.5 * float(np.hypot(*velocity)) * ahead
        if len(path.frames) < 2:
            reach += 1.5 * path.sizes[-1]
        for number, (place, size, _) in enumerate(spots):
            miss = float(np.hypot(*(place - expected)))
            if miss < reach and 0.4 < size / path.sizes[-1] < 2.5:
                pairs.append((miss, path, number))
    taken: set[int] = set()
    extended: set[int] = set()
    for _, path, number in sorted(pairs, key=lambda pair: pair[0]):
        if number in taken or id(path) in extended:
            continue
        taken.add(number)
        extended.add(id(path))
        _extend(path, spots[number], index)
    for number, spot in enumerate(spots):
        if number not in taken:
            paths.append(Path())
            _extend(paths[-1], spot, index)


def _extend(path: Path, spot: tuple[Array, float, float], index: int) -> None:
    path.frames.append(index)
    path.places.append(spot[0])
    path.sizes.append(spot[1])


def _unbroken(path: Path) -> list[Path]:
    """Pieces between the jumps of speed: a pendulum's speed changes slowly, a collision's at once."""
    if len(path.frames) < 5:
        return []
    frames, places = np.array(path.frames, dtype=float), np.array(path.places)
    speed = np.diff(places, axis=0) / np.diff(frames)[:, None]
    fast = np.hypot(*speed.T)
    size = float(np.median(path.sizes))
    jump = np.zeros(len(frames))
    for i in range(2, len(frames) - 2):
        # medians over three steps, so that a single frame of contact counts once
        before, after = np.median(speed[max(i - 3, 0) : i], axis=0), np.median(speed[i : i + 3], axis=0)
        jump[i] = np.hypot(*(after - before)) / (1.0 + 0.15 * max(fast[max(i - 3, 0) : i + 3]))
        # from the hitting bead over to the one it hits, a leap of one diameter
        around = np.median(speed[max(i - 4, 0) : i + 3], axis=0)
        leap = places[i] - places[i - 1] - around * (frames[i] - frames[i - 1])
        jump[i] = max(jump[i], float(np.hypot(*leap)) / (1.5 + 0.35 * size))
    cuts = [i for i in range(len(jump)) if jump[i] > 1 and jump[i] == np.max(jump[max(i - 3, 0) : i + 4])]
    edges = [0, *cuts, len(frames)]
    return [path.part(a, b) for a, b in pairwise(edges) if b - a >= 4]


def find_collision(
    paths: list[Path],
    video: Video,
    stated_length: float | None = None,
    shown: Callable[[Collision], bool] = lambda _: True,
    *,
    in_pieces: bool,
) -> Collision:
    """The pair of paths of which one ends, fast, where and when the other begins in the same direction.

    With `in_pieces` also of paths that are broken.  One bead's path, broken on its way, looks like two that meet: of
    all that meet the first is taken of which `shown` says that the film shows a bead hanging there, else the first.
    Raises `NothingToMeasure` when there is none; `stated_length` [m] of the pendulum then helps to say what was seen.
    """
    moving = [path for path in paths if path.extent > 3 * float(np.median(path.sizes))]
    meetings = _meetings([with_beginning(path, paths) for path in moving], moving)
    if not meetings and in_pieces:
        meetings = _meetings_of_pieces(paths)
    if not meetings and not moving:
        raise NothingToMeasure(
            f"{video.path}: no bead is seen to swing in this clip; show the release and the hit.{by_bits(video)}"
        )
    if not meetings:
        lone = lone_swing(moving, video, stated_length)
        raise NothingToMeasure(
            f"{video.path}: no bead is seen to hit a second one{lone}; the clip must show the released bead, "
            "the hanging bead and their collision."
        )
    collisions = [_collision(fall, rise, paths) for fall, rise in meetings[:MOST_MEETINGS]]
    return next((collision for collision in collisions if shown(collision)), collisions[0])


def _collision(fall: Path, rise: Path, paths: list[Path]) -> Collision:
    radius = float(np.median([*fall.sizes, *rise.sizes])) / 2 + 0.5
    return Collision(fall, rise, _rest_place(fall, rise, paths, radius), max(radius, 2.0))


def _meetings(falls: list[Path], rises: list[Path], least_leap: float = -math.inf) -> list[tuple[Path, Path]]:
    """Paths that meet, first those that are longest and largest; of each hit the best ones only."""
    scores = {(i, k): _meeting(fall, rise) for i, fall in enumerate(falls) for k, rise in enumerate(rises)}
    leaps = [pair for pair, score in scores.items() if score > 0 and _leap(falls[pair[0]], rises[pair[1]]) > least_leap]
    best: dict[int, tuple[Path, Path]] = {}
    highest = max((scores[pair] for pair in leaps), default=0.0)
    for i, k in sorted(leaps, key=lambda pair: -scores[pair]):
        if scores[i, k] > COMPARABLE * highest:  # threads seem to meet as well
            best.setdefault(rises[k].frames[0], (falls[i], rises[k]))
    return list(best.values())


def _meetings_of_pieces(paths: list[Path]) -> list[tuple[Path, Path]]:
    """The same where a coarse codec moves the beads by jerks, which breaks their paths into pieces.

    One bead's pieces meet as those of two do, but for the leap of a diameter from the one bead over to the other.
    """
    pieces = [path for path in paths if path.extent > 0.5 * float(np.median(path.sizes))]
    pieces = sorted(pieces, key=lambda path: -path.extent)[:MOST_PIECES]
    turned = [_backwards(path) for path in paths]
    falls = [with_beginning(piece, paths) for piece in pieces]
    rises = [_backwards(with_beginning(_backwards(piece), turned)) for piece in pieces]
    far_falls, far_rises = (
        [path for path in joined if path.extent > 2 * float(np.median(path.sizes))] for joined in (falls, rises)
    )
    return _meetings(far_falls, far_rises, LEAST_LEAP)


def _leap(fall: Path, rise: Path) -> float:
    """How much further on `rise` begins than `fall` would have gone, in bead diameters."""
    velocity = (fall.velocity(at_end=True) + rise.velocity(at_end=False)) / 2
    further = rise.places[0] - fall.places[-1] - velocity * (rise.frames[0] - fall.frames[-1])
    way = velocity / max(float(np.hypot(*velocity)), 1e-9)
    return float(further @ way) / float(np.median([*fall.sizes, *rise.sizes]))


def lone_swing(moving: list[Path], video: Video, stated_length: float | None) -> str:
    """What a single pendulum's period says of its length; empty where nothing swings to and fro."""
    size = max(float(np.median(path.sizes)) for path in moving)
    main = [path for path in moving if float(np.median(path.sizes)) > 0.6 * size]
    frames = np.concatenate([path.frames for path in main])
    order = np.argsort(frames)
    time = video.times[frames[order]]
    x = np.concatenate([np.array(path.places)[:, 0] for path in main])[order]
    away = x - (np.percentile(x, 2) + np.percentile(x, 98)) / 2
    # crossings of the middle, each counted once although noise may cross it to and fro
    far = np.flatnonzero(np.abs(away) > 0.3 * np.percentile(np.abs(away), 90))
    turns = np.flatnonzero(np.sign(away[far[:-1]]) != np.sign(away[far[1:]]))
    if len(turns) < 4:
        return ""
    before, after = far[turns], far[turns + 1]
    crossings = time[before] - away[before] * (time[after] - time[before]) / (away[after] - away[before])
    steps = np.diff(crossings)
    usual = float(np.median(steps))
    if usual < SHORTEST_HALF:  # several bodies seen at once cross in one frame
        return ""
    halves = np.concatenate([[0], np.cumsum(np.round(steps / usual))])
    half, first = np.polyfit(halves, crossings, 1)
    if half < SHORTEST_HALF or np.std(crossings - first - half * halves) > 0.1 * half:
        return ""
    fits = GRAVITY * (half / math.pi) ** 2
    stated = "" if stated_length is None else f", {stated_length * 1e3:.0f} mm are stated"
    return f" (one body swings, with a period of {2 * half:.3f} s as a pendulum of {fits * 1e3:.0f} mm has{stated})"


def _meeting(fall: Path, rise: Path) -> float:
    """How well `rise` begins where and when `fall` ends; 0 where it does not."""
    wait = rise.frames[0] - fall.frames[-1]
    if not -3 <= wait <= 3 * LOST or len(fall.frames) < 6:
        return 0.0
    arriving, leaving = fall.velocity(at_end=True), rise.velocity(at_end=False)
    speed = float(np.hypot(*arriving))
    size = float(np.median([*fall.sizes, *rise.sizes]))
    if not 0.55 < float(np.median(fall.sizes)) / float(np.median(rise.sizes)) < 1.8:
        return 0.0
    gap = rise.places[0] - fall.places[-1]
    ahead = float(gap @ arriving) / max(speed, 1e-9)
    along = float(arriving @ leaving) / max(speed, 1e-9)
    if speed < 1.0 or not 0.35 * speed < along < 1.3 * speed:
        return 0.0
    if not -speed < ahead < 2.5 * size + (wait + 2.5) * speed or float(np.hypot(*gap)) > 3 * size + (wait + 3) * speed:
        return 0.0
    start_speed = float(np.hypot(*fall.velocity(at_end=False)))
    if start_speed > 0.9 * speed:  # a bead that falls gains speed
        return 0.0
    return (fall.extent + rise.extent) * math.sqrt(size)


def with_beginning(fall: Path, paths: list[Path]) -> Path:
    """The fall with the pieces of path that lead up to it, back to the bead at rest."""
    while True:
        velocity = fall.velocity(at_end=False)
        back = []
        for path in paths:
            gap = fall.frames[0] - path.frames[-1]
            # behind something narrow the bead is out of sight for a while
            expected = fall.places[0] - gap * velocity
            reach = 3 + 0.5 * fall.sizes[0] + 0.4 * gap * float(np.hypot(*velocity))
            if 0 <= gap <= 3 * LOST and np.hypot(*(path.places[-1] - expected)) < reach:
                back.append(path)
        if not back:
            return fall
        first = max(back, key=lambda path: path.extent + len(path.frames))
        own = 1 if first.frames[-1] == fall.frames[0] else 0
        fall = Path(first.frames + fall.frames[own:], first.places + fall.places[own:], first.sizes + fall.sizes[own:])


def _backwards(path: Path) -> Path:
    return Path([-frame for frame in path.frames[::-1]], path.places[::-1], path.sizes[::-1])


def _rest_place(fall: Path, rise: Path, paths: list[Path], radius: float) -> Array:
    """About where B hung: a still spot behind its rise, else a little behind where its rise is first seen."""
    velocity = rise.velocity(at_end=False)
    speed = float(np.hypot(*velocity))
    furthest = (rise.frames[0] - fall.frames[-1] + 6) * speed + radius
    for path in sorted(paths, key=lambda path: -len(path.frames)):
        still = np.median(np.array(path.places), axis=0)
        if path.extent < 0.6 * radius + 1 and len(path.frames) >= 5:
            away = rise.places[0] - still
            along = float(away @ velocity) / speed
            across = float(np.hypot(*(away - along * velocity / speed)))
            if -radius <= along < furthest and across < radius + 0.15 * along:
                return np.asarray(still)
    return rise.places[0] - 2 * velocity


def _apart(greys: dict[int, GreyImage], collision: Collision) -> Array:
    """[grey levels], how moving beads differ from the scene, pixel by pixel."""
    apart: list[Array] = [np.zeros(1)]
    shape = next(iter(greys.values())).shape
    for path in (collision.fall, collision.rise):
        for index in (index for index in greys if path.frames[0] <= index <= path.frames[-1]):
            x, y = np.rint(path.at(index)).astype(int).tolist()
            disc = np.zeros(shape, dtype=np.uint8)
            cv2.circle(disc, (x, y), max(round(INNER * collision.radius), 1), 1, cv2.FILLED)
            inside = np.nonzero(disc)
            # the middle of all whole frames would take seconds
            apart.append(greys[index][inside] - np.median([grey[inside] for grey in greys.values()], axis=0))
    return np.concatenate(apart)


def _contrast(apart: Array) -> int:
    """1 where moving beads are brighter than the scene, -1 where they are darker, 0 where they are both or neither."""
    # over the places where it moves a bead's lit and dark side may stand out either way
    one_sided = abs(float(np.mean(apart))) > ONE_SIDED * float(np.mean(np.abs(apart)))
    return int(np.sign(np.mean(apart))) if one_sided else 0


def _left_by_bead(before: GreyImage, after: GreyImage, contrast: int) -> Array:
    """How much of a bead [grey levels] each place showed before and no more after, of frames of shape (n, ...).

    By its noise alone every place of a bead of known contrast shows some.
    """
    usual = np.median(before, axis=0)
    if contrast == 0:
        return np.asarray(np.abs(usual - np.median(after, axis=0)))
    return np.asarray(contrast * (usual - np.percentile(after, 50 - 30 * contrast, axis=0)))


def hanging_place(greys: dict[int, GreyImage], collision: Collision) -> Array:
    """Where B hung: what the frames before the collision show there and those after it do not.

    A may have come to rest one diameter before it: of two such places, B's is the one further on.  Or A hides a part of
    it in most frames after the collision: where beads are known to be brighter or darker than the scene, the frames
    that show least of a bead count, and the place that has lost most, for what A covers now and B's shadow lose less.
    """
    place, gone = _place_left(greys, collision, _contrast(_apart(greys, collision)))
    return collision.rest if gone < 4 else place


def hung(greys: dict[int, GreyImage], collision: Collision) -> bool:
    """Whether the frames show a bead before the collision which has left right after it, and which A has not passed."""
    apart = _apart(greys, collision)
    place, gone = _place_left(greys, collision, _contrast(apart))
    ahead = (place - collision.fall.places[-1]) @ collision.way
    # a path may run on along B for as long as one lives that is not seen
    further = collision.radius + LOST * float(np.hypot(*collision.rise.velocity(at_end=False)))
    return bool(gone > HUNG * float(np.mean(np.abs(apart))) and ahead > -further)


def _place_left(greys: dict[int, GreyImage], collision: Collision, contrast: int) -> tuple[Array, float]:
    """Where something the size of a bead hung up to the collision, and how much of it has gone [grey levels].

    It has left where it hung after the collision, or right after it alone, before A has come there.
    """
    came, left = collision.fall.frames[-1], collision.rise.frames[0]
    before = [grey for index, grey in greys.items() if index < came - 1]
    places = [
        _place_lost(before, after, collision, contrast)
        for after in (
            [grey for index, grey in greys.items() if index > left + 1],
            [grey for index, grey in greys.items() if came < index < left + JUST_LEFT],
        )
        if len(before) >= 3 and len(after) >= 3
    ]
    return max(places, key=lambda place: place[1], default=(collision.rest, 0.0))


def _place_lost(
    before: Sequence[GreyImage], after: Sequence[GreyImage], collision: Collision, contrast: int
) -> tuple[Array, float]:
    radius, reach = collision.radius, math.ceil(collision.radius)
    way, begun = collision.way, collision.rise.places[0]
    aside = np.array([-way[1], way[0]])
    waited = (collision.rise.frames[0] - collision.fall.frames[-1] + 3) * float(
        np.hypot(*collision.rise.velocity(at_end=False))
    )
    # its way bends up from where it hung
    ends = [
        (along, side * (2 * radius + BENDS * abs(along)))
        for along in (-6 * radius - waited, radius)
        for side in (-1, 1)
    ]
    corners = np.array([begun + along * way + across * aside for along, across in ends])
    # more is not looked at, beside what lies within a bead's reach of a place and of those next to it
    left, top = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 2 * reach - 1, 0).tolist()
    right, bottom = np.maximum(np.ceil(corners.max(axis=0)).astype(int) + 2 * reach + 2, 0).tolist()
    window = np.s_[top:bottom, left:right]
    if before[0][window].size == 0:
        return collision.rest, 0.0

    def left_in(part: tuple[slice, slice]) -> Array:
        return _left_by_bead(
            np.stack([grey[part] for grey in before]), np.stack([grey[part] for grey in after]), contrast
        )

    gone = left_in(window)
    if contrast:
        thin = max(math.isqrt(before[0].size // MANY), 1)
        gone = np.maximum(gone - np.median(left_in(np.s_[::thin, ::thin])), 0)
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = (np.hypot(u, v) <= radius).astype(np.float32)
    filled = cv2.filter2D(gone.astype(np.float32), -1, disc / disc.sum())
    y, x = np.nonzero(filled >= cv2.dilate(filled, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)))
    places = np.column_stack([x + left, y + top]).astype(np.float64)
    along, across = (places - begun) @ way, np.abs((places - begun) @ aside)
    behind = (along < radius) & (along > -6 * radius - waited) & (across < 2 * radius + BENDS * np.abs(along))
    peaks = np.where(behind, filled[y, x], 0)
    if len(peaks) == 0:
        return collision.rest, 0.0
    best = np.argmax(peaks if contrast else np.where(peaks > 0.6 * np.max(peaks), along, -np.inf))
    return places[best], float(peaks[best])
