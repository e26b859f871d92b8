"""Find the collision of two beads in a film: one path ends at high speed where another one begins.

Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage, Image
from rigtwin.lab.errors import Mark, NothingToMeasure, Seen
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.media.compression import by_bits
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.scene.background import middle_picture
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tracking.detect import inside_region
from rigtwin.measure.tracking.link import path_marks

Region = tuple[float, float, float, float]

LEAST_LEAP = 0.5  # [bead diameters], minimum jump from the hitting bead to the one that is hit
LEAST_WAY = (
    2.2  # [bead diameters], shortest path of a bead; pieces of one are shorter (films by VTK, make bench-unseen)
)
MOST_MEETINGS = 8  # number of candidate collisions with the highest scores that are verified in the film
COMPARABLE = 0.4  # minimum score of a candidate over the best one
HUNG = 0.5  # minimum change at B's rest position over the contrast of the beads
JUST_LEFT = 12  # [frames] after the collision in which B has left its rest position and A has hardly reached it
BENDS = 0.3  # largest offset of B's rest position from a straight line over the distance back to it
MOST_PIECES = 60  # number of the longest pieces of paths among which a collision is sought: noise has thousands
INNER = 0.7  # share of a bead's radius within which all pixels show the bead
ONE_SIDED = 0.6  # minimum |mean difference| over mean |difference| from the scene for a bead of known contrast
MANY = 20_000  # number of pixels that is enough for the median of a picture
SHORTEST_HALF = 0.1  # [s], minimum half period: that of a thread of 10 mm
LAST = 8  # [frames], before and after a hit, in which the speeds are sought (films by VTK, make bench-unseen)
LEAST_FALL = 6  # positions of a fall
SLOWEST = 1.0  # [px/frame], speed at which a bead is hit
SLOWED = 0.6  # least speed at the end of a fall over its largest: B's own path ends slowly, at the top of its swing
GAINED = 0.9  # largest speed at the beginning of a fall over that at its end
HANDED_ON = 0.85  # speed of B after the hit over that of A before it, for equal beads with a restitution of 0.7
LOST = 4  # [frames] without detection after which a path has ended


@dataclass
class Path:
    """Path of a moving spot, frame by frame; `size` is the smaller side of the spot."""

    frames: list[int] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)  # [px]
    sizes: list[float] = field(default_factory=list)  # [px]

    def part(self, start: int, end: int) -> Path:
        return Path(self.frames[start:end], self.places[start:end], self.sizes[start:end])

    def at(self, frame: float) -> Array:
        """Position [px] in a frame, interpolated; beyond an end, that of the end."""
        places = np.array(self.places)
        return np.array([np.interp(frame, self.frames, places[:, k]) for k in (0, 1)])

    def along(self, frame: int) -> tuple[Array, Array]:
        """Position [px] and velocity [px/frame] in a frame."""
        return self.at(frame), (self.at(frame + 1) - self.at(frame - 1)) / 2

    def clear_of(self, place: Array, reach: float, *, from_end: bool) -> Path:
        """The path up to where it comes within `reach` [px] of a place, or from where it has left it.

        Two beads next to each other appear as one spot.
        """
        near = np.hypot(*(np.array(self.places) - place).T) <= reach
        if from_end:
            return self.part(0, int(np.argmax(near))) if np.any(near[4:]) and not np.any(near[:4]) else self
        return self.part(int(np.argmin(near)), len(self.frames)) if np.sum(~near) >= 4 else self

    @property
    def extent(self) -> float:
        """Larger side of the bounding box [px]."""
        return float(np.max(np.ptp(np.array(self.places), axis=0)))

    def velocity(self, *, at_end: bool) -> Array:
        """Mean velocity [px/frame] over the last or first few frames."""
        last = len(self.frames) - 1
        one, other = (max(last - 3, 0), last) if at_end else (0, min(3, last))
        if one == other:
            return np.zeros(2)
        return np.asarray((self.places[other] - self.places[one]) / (self.frames[other] - self.frames[one]))

    def up_to_the_hit(self) -> Path:
        """The path up to the fastest three steps among its last frames.

        A bead gains speed until it hits.  Its last positions may be false: where it hangs for long after the hit, it is
        part of the picture of the still scene.
        """
        ends = range(max(len(self.frames) - LAST, 4), len(self.frames) + 1)
        return max((self.part(0, end) for end in ends), key=lambda one: float(np.hypot(*one.velocity(at_end=True))))

    def fastest_along(self, way: Array) -> float:
        """Largest mean speed over `LAST` steps in the direction of a unit vector [px/frame]."""
        frames, places = np.array(self.frames), np.array(self.places)
        ahead = min(LAST, len(frames) - 1)
        return float(np.max((places[ahead:] - places[:-ahead]) @ way / (frames[ahead:] - frames[:-ahead])))

    def arriving(self) -> Array:
        """Velocity [px/frame] before a hit."""
        return self.up_to_the_hit().velocity(at_end=True)

    def leaving(self) -> Array:
        """Median velocity [px/frame] over the first frames, in some of which two beads appear as one spot."""
        frames, places = np.array(self.frames[:LAST]), np.array(self.places[:LAST])
        return np.asarray(np.median(np.diff(places, axis=0) / np.diff(frames)[:, None], axis=0))


@dataclass(frozen=True)
class Collision:
    """The two paths of a collision, before the beads are located in detail."""

    fall: Path  # bead A up to the collision
    rise: Path  # bead B from it on
    rest: Array  # [px], where B hangs
    radius: float  # [px]
    rise_seen: bool = True  # else it is what the speed of A lets expect

    @property
    def weight(self) -> float:
        """Sum of the weights of both paths, see `weight_of`."""
        return weight_of(self.fall) + weight_of(self.rise)

    @property
    def way(self) -> Array:
        """Unit vector of the direction in which B leaves."""
        velocity = self.rise.leaving()
        return np.asarray(velocity / max(float(np.hypot(*velocity)), 1e-9))

    def of_every(self, every: int, first: int) -> Collision:
        """The same in frame numbers of the clip, for paths that count every `every`-th frame from `first` on."""
        fall, rise = (
            Path([first + every * k for k in path.frames], path.places, path.sizes) for path in (self.fall, self.rise)
        )
        return replace(self, fall=fall, rise=rise)


def weight_of(path: Path) -> float:
    """Weight of a path: extent times root of the size."""
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
    """Paths of everything that moves against the still `scene`, split where the speed jumps.

    For a high-speed film only every `every`-th frame is used; paths then count these frames from the clip's first.
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
        # in colour: the lit side of a brown bead may have the same grey level as a grey wall
        level = float(view.grey.mean()) / max(float(frame.grey.mean()), 1.0)  # the lamp's flicker
        blue, green, red = cv2.split(cv2.absdiff(_steady(frame.colour, shake, level), still))
        difference = np.asarray(cv2.max(cv2.max(blue, green), red), dtype=np.uint8)
        _link(paths, _spots(difference, least), frame.index if every == 1 else since // every)
    return [piece for path in paths for piece in _unbroken(path)]


def _steady(colour: Image, shake: tuple[float, float], level: float) -> Image:
    """A colour frame registered to the still scene, as `Scene.view` does for grey frames."""
    if abs(level - 1) > 0.004:
        colour = np.asarray(cv2.convertScaleAbs(colour, alpha=level), dtype=np.uint8)
    if max(abs(shake[0]), abs(shake[1])) < 0.03:
        return colour
    back = np.array([[1, 0, -shake[0]], [0, 1, -shake[1]]], dtype=np.float32)
    size = (colour.shape[1], colour.shape[0])
    return np.asarray(cv2.warpAffine(colour, back, size, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)


def _spots(difference: npt.NDArray[np.uint8], least: npt.NDArray[np.float32]) -> list[tuple[Array, float, float]]:
    """Compact spots that differ from the still scene: position [px], width [px], weight; heaviest first."""
    smooth = cv2.medianBlur(difference, 5)  # removes what is thinner than half its window, keeps edges
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
    """Centre and width of the thickest part of a spot, without attached threads and faint shadows."""
    strong = values > 0.3 * np.percentile(values[values > 0], 90)
    depth = cv2.distanceTransform(np.pad(strong, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    deepest = float(np.max(depth))
    if deepest < 1.5:
        return None
    y, x = np.nonzero(depth > 0.4 * deepest)
    return np.array([np.mean(x), np.mean(y)]), 2 * deepest


def _link(paths: list[Path], spots: list[tuple[Array, float, float]], index: int) -> None:
    """Extend the active paths by the spots nearest to their predicted positions; other spots begin new paths."""
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
    """Pieces between jumps of speed: the speed changes slowly in a swing and at once in a collision."""
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
        # a jump by one diameter, from the hitting bead to the one that is hit
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
    """The pair of paths of which one ends at high speed where and when the other begins in the same direction.

    With `in_pieces`, broken paths are tried too.  The broken path of one bead looks like two that meet, so the first
    candidate is taken for which `shown` confirms in the film that a bead hung there; else the first one.
    Raises `NothingToMeasure` if there is none; `stated_length` [m] of the pendulum is used in its message.
    """
    moving = [path for path in paths if path.extent > LEAST_WAY * float(np.median(path.sizes))]
    meetings = _meetings([with_beginning(path, paths) for path in moving], moving)
    if not meetings and in_pieces:
        meetings = _meetings_of_pieces(paths)
    if not meetings and not moving:
        raise no_swing(paths, video)
    if not meetings:
        but = "no path begins in the direction in which another one arrives there"
        must = (
            "show the released bead, the hanging bead and their collision: leave out what else moves with --start, "
            "--end or --region."
        )
        raise no_meeting(moving, video, stated_length, but, must)
    collisions = [_collision(fall, rise, paths) for fall, rise in meetings[:MOST_MEETINGS]]
    return next((collision for collision in collisions if shown(collision)), collisions[0])


def lone_falls(paths: list[Path]) -> list[Collision]:
    """Collisions of which the path of bead A alone is seen, heaviest first: B is where a bead of its size is hit.

    B is taken to leave in the direction and with most of the speed of A.
    """
    moving = [path for path in paths if path.extent > LEAST_WAY * float(np.median(path.sizes))]
    joined = [with_beginning(path, paths) for path in sorted(moving, key=weight_of, reverse=True)[:MOST_PIECES]]
    collisions: dict[int, Collision] = {}  # by the end of the fall: pieces of one swing give the same one
    for path in sorted(joined, key=weight_of, reverse=True):
        if len(path.frames) < LEAST_FALL:
            continue
        fall = path.up_to_the_hit()
        speed, size = float(np.hypot(*fall.velocity(at_end=True))), float(np.median(fall.sizes))
        if speed > SLOWEST and float(np.hypot(*fall.velocity(at_end=False))) < GAINED * speed:
            collisions.setdefault(fall.frames[-1], struck(fall, max(size / 2 + 0.5, 2.0)))
    return list(collisions.values())


def struck(fall: Path, radius: float) -> Collision:
    """The collision at the end of a fall, of beads of this radius [px], with a rise that the speed of A lets expect."""
    arriving = fall.velocity(at_end=True)
    rest = fall.places[-1] + 2 * radius * arriving / max(float(np.hypot(*arriving)), 1e-9)
    frames = [fall.frames[-1] + 1 + k for k in range(4)]
    rise = Path(frames, [rest + k * HANDED_ON * arriving for k in range(4)], [2 * radius] * 4)
    return Collision(fall, rise, rest, radius, rise_seen=False)


def _collision(fall: Path, rise: Path, paths: list[Path]) -> Collision:
    radius = float(np.median([*fall.sizes, *rise.sizes])) / 2 + 0.5
    return Collision(fall, rise, _rest_place(fall, rise, paths, radius), max(radius, 2.0))


def _meetings(falls: list[Path], rises: list[Path], least_leap: float = -math.inf) -> list[tuple[Path, Path]]:
    """Pairs of paths that meet, highest score first; for each start of a rise only the best one."""
    scores = {(i, k): _meeting(fall, rise) for i, fall in enumerate(falls) for k, rise in enumerate(rises)}
    leaps = [pair for pair, score in scores.items() if score > 0 and _leap(falls[pair[0]], rises[pair[1]]) > least_leap]
    best: dict[int, tuple[Path, Path]] = {}
    highest = max((scores[pair] for pair in leaps), default=0.0)
    for i, k in sorted(leaps, key=lambda pair: -scores[pair]):
        if scores[i, k] > COMPARABLE * highest:  # spots of threads seem to meet as well
            best.setdefault(rises[k].frames[0], (falls[i], rises[k]))
    return list(best.values())


def _meetings_of_pieces(paths: list[Path]) -> list[tuple[Path, Path]]:
    """The same if a coarse codec moves the beads in jerks, which breaks their paths into pieces.

    Pieces of one bead also meet; only the jump of a diameter distinguishes the collision of two beads.
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
    """Distance from the extrapolated end of `fall` to the begin of `rise`, in bead diameters."""
    velocity = (fall.velocity(at_end=True) + rise.leaving()) / 2
    further = rise.places[0] - fall.places[-1] - velocity * (rise.frames[0] - fall.frames[-1])
    way = velocity / max(float(np.hypot(*velocity)), 1e-9)
    return float(further @ way) / float(np.median([*fall.sizes, *rise.sizes]))


def no_swing(paths: list[Path], video: Video) -> NothingToMeasure:
    """The refusal of a clip in which nothing moves far."""
    found = f"none of the {len(paths)} moving objects that were followed" if paths else "nothing"
    return NothingToMeasure(
        f"{video.path}: {found} (frames {video.first} to {video.last}) moves by more than {LEAST_WAY:g} times its "
        f"size; show the release and the hit, or move --start, --end or --region to them{by_bits(video)}.",
        Seen(marks=marks_of(paths)),
    )


def no_meeting(moving: list[Path], video: Video, stated_length: float | None, but: str, must: str) -> NothingToMeasure:
    """The refusal of a clip in which nothing is hit: what no path does, and what the clip must show."""
    lone = lone_swing(moving, video, stated_length)
    return NothingToMeasure(
        f"{video.path}: {len(moving)} moving objects were followed (frames {video.first} to {video.last}), but "
        f"{but}{lone}; the clip must {must}",
        Seen(marks=marks_of(moving)),
    )


def marks_of(paths: list[Path]) -> tuple[Mark, ...]:
    """The longest paths as lines in the picture, with the frames that they last."""
    return path_marks((path.frames, path.places) for path in sorted(paths, key=lambda path: -path.extent))


def lone_swing(moving: list[Path], video: Video, stated_length: float | None) -> str:
    """Message with the period of a single pendulum and its length; empty if nothing swings."""
    size = max(float(np.median(path.sizes)) for path in moving)
    main = [path for path in moving if float(np.median(path.sizes)) > 0.6 * size]
    frames = np.concatenate([path.frames for path in main])
    order = np.argsort(frames)
    time = video.times[frames[order]]
    x = np.concatenate([np.array(path.places)[:, 0] for path in main])[order]
    away = x - (np.percentile(x, 2) + np.percentile(x, 98)) / 2
    # crossings of the middle, each counted once in spite of noise
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
    return f" (one body swings, with a period of {2 * half:.3f} s, that of a pendulum of {fits * 1e3:.0f} mm{stated})"


def _meeting(fall: Path, rise: Path) -> float:
    """Score of `rise` as the continuation of `fall` after a collision; 0 if it is not."""
    wait = rise.frames[0] - fall.frames[-1]
    if not -3 <= wait <= 3 * LOST or len(fall.frames) < LEAST_FALL:
        return 0.0
    arriving, leaving = fall.arriving(), rise.leaving()
    speed = float(np.hypot(*arriving))
    size = float(np.median([*fall.sizes, *rise.sizes]))
    if not 0.55 < float(np.median(fall.sizes)) / float(np.median(rise.sizes)) < 1.8:
        return 0.0
    gap = rise.places[0] - fall.places[-1]
    ahead = float(gap @ arriving) / max(speed, 1e-9)
    along = float(arriving @ leaving) / max(speed, 1e-9)
    if speed < SLOWEST or not 0.35 * speed < along < 1.3 * speed:
        return 0.0
    if not -speed < ahead < 2.5 * size + (wait + 2.5) * speed or float(np.hypot(*gap)) > 3 * size + (wait + 3) * speed:
        return 0.0
    start_speed = float(np.hypot(*fall.velocity(at_end=False)))
    if start_speed > GAINED * speed or speed < SLOWED * fall.fastest_along(arriving / speed):
        return 0.0
    return (fall.extent + rise.extent) * math.sqrt(size)


def with_beginning(fall: Path, paths: list[Path]) -> Path:
    """The fall joined with earlier pieces of paths, back to the bead at rest."""
    while True:
        velocity = fall.velocity(at_end=False)
        back = []
        for path in paths:
            gap = fall.frames[0] - path.frames[-1]
            # a narrow object may occlude the bead for a while
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
    """Approximate rest position of B: a still spot behind its rise, else a point just behind the begin of the rise."""
    velocity = rise.leaving()
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
    """Difference of moving beads from the scene [grey levels], for each pixel inside the beads."""
    apart: list[Array] = [np.zeros(1)]
    shape = next(iter(greys.values())).shape
    for path in (collision.fall, collision.rise):
        for index in (index for index in greys if path.frames[0] <= index <= path.frames[-1]):
            x, y = np.rint(path.at(index)).astype(int).tolist()
            disc = np.zeros(shape, dtype=np.uint8)
            cv2.circle(disc, (x, y), max(round(INNER * collision.radius), 1), 1, cv2.FILLED)
            inside = np.nonzero(disc)
            # the median of all whole frames would take seconds
            apart.append(greys[index][inside] - np.median([grey[inside] for grey in greys.values()], axis=0))
    return np.concatenate(apart)


def _contrast(apart: Array) -> int:
    """1 if moving beads are brighter than the scene, -1 if they are darker, 0 if both or neither."""
    # depending on the background, a bead's lit and dark side may have opposite contrast
    one_sided = abs(float(np.mean(apart))) > ONE_SIDED * float(np.mean(np.abs(apart)))
    return int(np.sign(np.mean(apart))) if one_sided else 0


def _left_by_bead(before: GreyImage, after: GreyImage, contrast: int) -> Array:
    """Contrast [grey levels] of each pixel that vanished between two sets of frames of shape (n, ...).

    For a bead of known contrast the result is positive from noise alone.
    """
    usual = np.median(before, axis=0)
    if contrast == 0:
        return np.asarray(np.abs(usual - np.median(after, axis=0)))
    return np.asarray(contrast * (usual - np.percentile(after, 50 - 30 * contrast, axis=0)))


def hanging_place(greys: dict[int, GreyImage], collision: Collision) -> Array:
    """Rest position of B [px]: a bead is seen there before the collision and not after it.

    A may have come to rest one diameter before it; of two such positions, B's is the one further on.  A may also cover
    part of it in most frames after the collision.  If the sign of the contrast is known, the frames with least of a
    bead count, and the position with the largest change: positions covered by A and B's shadow change less.
    """
    place, gone = _place_left(greys, collision, _contrast(_apart(greys, collision)))
    return collision.rest if gone < 4 else place


def hung(greys: dict[int, GreyImage], collision: Collision) -> bool:
    """Whether the frames show a bead that leaves its position at the collision, and that A has not passed."""
    apart = _apart(greys, collision)
    _, gone = _place_left(greys, collision, _contrast(apart))
    return gone > HUNG * float(np.mean(np.abs(apart)))


def _place_left(greys: dict[int, GreyImage], collision: Collision, contrast: int) -> tuple[Array, float]:
    """Position of a bead-sized object that vanished at the collision, and the contrast it lost [grey levels].

    Compared are all frames after the collision, or only those right after it, before A reaches the position.
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
    sideways = np.array([-way[1], way[0]])
    waited = (collision.rise.frames[0] - collision.fall.frames[-1] + 3) * float(np.hypot(*collision.rise.leaving()))
    # its path bends upwards from the rest position
    ends = [
        (along, side * (2 * radius + BENDS * abs(along)))
        for along in (-6 * radius - waited, radius)
        for side in (-1, 1)
    ]
    corners = np.array([begun + along * way + across * sideways for along, across in ends])
    # only this window is evaluated, with a margin for the filter
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
    along, across = (places - begun) @ way, np.abs((places - begun) @ sideways)
    behind = (along < radius) & (along > -6 * radius - waited) & (across < 2 * radius + BENDS * np.abs(along))
    # what A itself has left lies behind the end of its path, which may continue along B's for up to LOST frames
    lost = LOST * float(np.median(np.diff(collision.fall.frames)))  # in frames of the clip
    ahead = (places - collision.fall.places[-1]) @ way > -radius - lost * float(np.hypot(*collision.rise.leaving()))
    peaks = np.where(behind & ahead, filled[y, x], 0)
    if len(peaks) == 0:
        return collision.rest, 0.0
    best = np.argmax(peaks if contrast else np.where(peaks > 0.6 * np.max(peaks), along, -np.inf))
    return places[best], float(peaks[best])
