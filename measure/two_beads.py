"""Find and follow the two beads of a double pendulum in the film of a still camera.

`find` looks at what moves: of all paths it takes the one that ends, fast, where and when another begins, and follows both
beads from there to the ends of the clip with `bead.locate`.  The beads swing in one plane and cannot pass each other, so
the released bead stays on its side of the hanging one.

Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.bead import Background, BeadFit, BeadImage, Look, Scene, common_look, fit_bead
from rigtwin.measure.follow import Channel, Spot, SpotPath, best_channel
from rigtwin.measure.media import Frame, Grey, Image, Video
from rigtwin.measure.swing import angles, first_guess, positions

Array = npt.NDArray[np.float64]

SAMPLES = 21  # frames from which the still scene is learnt
LOST = 4  # frames after which a path that was not seen again has ended


@dataclass
class Path:
    """What moves, frame by frame; `size` is the smaller side of its picture."""

    frames: list[int] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)  # [px]
    sizes: list[float] = field(default_factory=list)  # [px]

    def part(self, start: int, end: int) -> Path:
        return Path(self.frames[start:end], self.places[start:end], self.sizes[start:end])

    @property
    def extent(self) -> float:
        """[px]"""
        return float(np.max(np.ptp(np.array(self.places), axis=0)))

    def velocity(self, *, at_end: bool) -> Array:
        """[px/frame] over the last or first few frames."""
        few = slice(-4, None) if at_end else slice(0, 4)
        frames, places = np.array(self.frames[few], dtype=float), np.array(self.places[few])
        if len(frames) < 2:
            return np.zeros(2)
        return np.asarray(np.polyfit(frames - frames[0], places, 1)[0])


@dataclass(frozen=True)
class Collision:
    """The two paths that meet, before the beads are followed in detail."""

    fall: Path  # bead A up to the collision
    rise: Path  # bead B from it on
    rest: Array  # [px], where B hangs
    radius: float  # [px]


@dataclass(frozen=True)
class Beads:
    """Both beads in every frame of the clip."""

    frames: npt.NDArray[np.int64]  # frame numbers, shape (n,)
    a: list[BeadImage | None]
    b: list[BeadImage | None]
    looks: list[Look]  # of A and B
    exposure: float  # share of the frame interval
    scene: Scene
    channel: Channel
    shakes: Array  # [px], where the scene's origin lies in each frame, shape (n, 2)
    looked: npt.NDArray[np.bool_]  # where each bead was looked for, shape (2, n)


def find_beads(
    video: Video,
    region: tuple[float, float, float, float] | None = None,
    *,
    stated_length: float | None = None,
    progress: Progress = silent,
) -> Beads:
    """Both beads in every frame; `stated_length` [m] of the pendulum only helps to say what is wrong.

    Raises `NothingToMeasure` when no two bodies collide in the clip.
    """
    samples = _sample(video, progress)
    scene = _scene({index: frame.grey for index, frame in samples.items()})
    collision = _collision(_paths(video, scene, samples, region, progress), video, stated_length)
    channel = best_channel(video, _as_spots(collision.fall))
    greys = {index: channel.grey(frame) for index, frame in samples.items()}
    scene = _scene(greys)
    # right after the collision B has left its place and A has not come to it yet: the best view of what B hid
    hit = collision.rise.frames[0]
    greys |= {frame.index: channel.grey(frame) for frame in video.frames() if hit <= frame.index < hit + 12}
    scene = _without_beads(scene, greys, collision.radius, _rough_places(collision, video))
    looks, exposure = _learn_looks(video, channel, scene, collision)
    return _follow(video, channel, scene, collision, looks, exposure, progress)


def _scene(greys: dict[int, Grey]) -> Scene:
    background = Background()
    for index, grey in greys.items():
        background.add(index, grey)
    return background.scene()


def _as_spots(path: Path) -> SpotPath:
    spots = [
        Spot(float(x), float(y), math.pi / 4 * size**2, size, size, 0.0)
        for (x, y), size in zip(path.places, path.sizes, strict=True)
    ]
    return SpotPath(tuple(path.frames), tuple(spots))


def _sample(video: Video, progress: Progress) -> dict[int, Frame]:
    count = video.last - video.first + 1
    wanted = set(np.unique(np.linspace(video.first, video.last, min(SAMPLES, count)).round().astype(int)).tolist())
    samples = {}
    for frame in video.frames():
        progress("learning the still scene", frame.index - video.first, count)
        if frame.index in wanted:
            samples[frame.index] = frame
    return samples


# --- what moves -----------------------------------------------------------------------------------------------------


def _paths(
    video: Video,
    scene: Scene,
    samples: dict[int, Frame],
    region: tuple[float, float, float, float] | None,
    progress: Progress,
) -> list[Path]:
    """Everything that moves, linked from frame to frame and broken where its speed jumps."""
    paths: list[Path] = []
    shake = (0.0, 0.0)
    still = np.median(np.stack([frame.colour for frame in samples.values()]), axis=0).astype(np.uint8)
    least = np.maximum(4 * scene.noise, 8.0)
    if region is not None:
        x, y, width, height = (round(side) for side in region)
        inside = np.zeros(least.shape, dtype=bool)
        inside[max(y, 0) : y + height, max(x, 0) : x + width] = True
        least = np.where(inside, least, np.inf)
    for frame in video.frames():
        progress("looking for beads", frame.index - video.first, video.last - video.first + 1)
        shake = scene.view(frame.grey, shake).shake
        # in colour: a brown bead on a grey wall may have the wall's grey on its lit side
        difference = cv2.absdiff(_steady(frame.colour, shake), still).max(axis=2)
        _link(paths, _spots(difference, least), frame.index)
    return [piece for path in paths for piece in _unbroken(path)]


def _steady(colour: Image, shake: tuple[float, float]) -> Image:
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
    weights = np.bincount(labels.ravel(), smooth.ravel(), minlength=count)
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
    # two steps back and two ahead, so that a single frame of contact counts once
    jump = np.zeros(len(frames))
    for i in range(2, len(frames) - 2):
        before, after = np.median(speed[max(i - 3, 0) : i], axis=0), np.median(speed[i : i + 3], axis=0)
        jump[i] = np.hypot(*(after - before)) / (1.0 + 0.15 * max(fast[max(i - 3, 0) : i + 3]))
    cuts = [i for i in range(len(jump)) if jump[i] > 1 and jump[i] == np.max(jump[max(i - 3, 0) : i + 4])]
    edges = [0, *cuts, len(frames)]
    return [path.part(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b - a >= 4]


# --- the collision --------------------------------------------------------------------------------------------------


def _collision(paths: list[Path], video: Video, stated_length: float | None) -> Collision:
    """The pair of paths of which one ends, fast, where and when the other begins in the same direction."""
    moving = [path for path in paths if path.extent > 3 * float(np.median(path.sizes))]
    if not moving:
        raise NothingToMeasure(f"{video.path}: nothing of a bead's kind moves in this clip; show the release and the hit.")
    best, best_score = None, 0.0
    for fall in moving:
        for rise in moving:
            score = _meeting(fall, rise)
            if score > best_score:
                best, best_score = (fall, rise), score
    if best is None:
        raise NothingToMeasure(
            f"{video.path}: no bead is seen to hit a second one{_lone_swing(moving, video, stated_length)}; the clip must "
            "show the released bead, the hanging bead and their collision."
        )
    fall, rise = best
    radius = float(np.median([*fall.sizes, *rise.sizes])) / 2 + 0.5
    fall = _with_beginning(fall, paths)
    return Collision(fall, rise, _rest_place(fall, rise, paths, radius), max(radius, 2.0))


def _lone_swing(moving: list[Path], video: Video, stated_length: float | None) -> str:
    """What a single pendulum's period says of its length; empty where nothing swings to and fro."""
    size = max(float(np.median(path.sizes)) for path in moving)
    main = [path for path in moving if float(np.median(path.sizes)) > 0.6 * size]
    frames = np.concatenate([path.frames for path in main])
    order = np.argsort(frames)
    time = video.times[frames[order]]
    x = np.concatenate([np.array(path.places)[:, 0] for path in main])[order]
    away = x - (np.percentile(x, 2) + np.percentile(x, 98)) / 2
    # crossings of the middle, counted once although noise may cross it to and fro
    sides = np.flatnonzero(np.abs(away) > 0.3 * np.percentile(np.abs(away), 90))
    turns = sides[:-1][np.sign(away[sides[:-1]]) != np.sign(away[sides[1:]])]
    if len(turns) < 4:
        return ""
    crossings = time[turns]
    halves = np.round((crossings - crossings[0]) / np.median(np.diff(crossings)))
    half, _ = np.polyfit(halves, crossings, 1)
    fits = GRAVITY * (half / math.pi) ** 2
    stated = "" if stated_length is None else f", {stated_length * 1e3:.0f} mm are stated"
    return f" (one body swings, with a period of {2 * half:.3f} s as a pendulum of {fits * 1e3:.0f} mm has{stated})"


def _meeting(fall: Path, rise: Path) -> float:
    """How well `rise` begins where and when `fall` ends; 0 where it does not."""
    wait = rise.frames[0] - fall.frames[-1]
    if fall is rise or not -3 <= wait <= LOST + 2 or len(fall.frames) < 6:
        return 0.0
    arriving, leaving = fall.velocity(at_end=True), rise.velocity(at_end=False)
    speed = float(np.hypot(*arriving))
    size = float(np.median([*fall.sizes, *rise.sizes]))
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


def _with_beginning(fall: Path, paths: list[Path]) -> Path:
    """The fall with the pieces of path that lead up to it, back to the bead at rest."""
    while True:
        back = [
            path
            for path in paths
            if 0 <= fall.frames[0] - path.frames[-1] <= LOST + 2
            and np.hypot(*(fall.places[0] - path.places[-1])) < 3 + 2 * float(np.hypot(*fall.velocity(at_end=False)))
        ]
        if not back:
            return fall
        first = max(back, key=lambda path: len(path.frames))
        own = 1 if first.frames[-1] == fall.frames[0] else 0
        fall = Path(
            first.frames + fall.frames[own:], first.places + fall.places[own:], first.sizes + fall.sizes[own:]
        )


def _rest_place(fall: Path, rise: Path, paths: list[Path], radius: float) -> Array:
    """Where B hung: a still spot there, else where its rise, run back, meets the bead that hits it."""
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
    clear = _clear_of(fall, rise.places[0], 4 * radius, from_end=True)
    arriving = clear.velocity(at_end=True)
    closing = float((arriving - velocity) @ velocity) / speed
    start = rise.frames[0] - clear.frames[-1]
    gap = float((rise.places[0] - clear.places[-1]) @ velocity) / speed - 2 * radius
    # frames from the rise's first frame back to the contact, both beads running straight
    back = (gap - start * float(arriving @ velocity) / speed) / closing if abs(closing) > 0.1 * speed else 1.0
    return np.asarray(rise.places[0] + velocity * float(np.clip(back, -8, 0)))


def _without_beads(scene: Scene, greys: dict[int, Grey], radius: float, places: dict[int, list[Array]]) -> Scene:
    """The still scene behind the beads as well.

    Where beads cover a pixel in many frames the median over time is no background: there the frames are taken in which
    the beads are furthest away, and where they never leave, the surroundings grow in.
    """
    reach = round(1.7 * radius + 3)
    cover = np.zeros(scene.picture.shape, dtype=np.float32)
    for index in greys:
        disc = np.zeros(cover.shape, dtype=np.uint8)
        for place in places[index]:
            cv2.circle(disc, (round(place[0]), round(place[1])), reach, 1, cv2.FILLED)
        cover += disc
    y, x = np.nonzero(cover > 0.1 * len(greys))
    if len(x) == 0:
        return scene
    away = np.stack(
        [np.min([np.hypot(x - place[0], y - place[1]) for place in places[index]], axis=0) for index in greys]
    )
    values = np.stack([scene.view(grey).grey[y, x] for grey in greys.values()])
    furthest = np.argsort(-away, axis=0)[:5]
    picture, hidden = scene.picture.copy(), np.zeros(cover.shape, dtype=np.uint8)
    picture[y, x] = np.median(np.take_along_axis(values, furthest, 0), axis=0)
    never = np.take_along_axis(away, furthest, 0)[-1] < radius + 1.5
    hidden[y[never], x[never]] = 1
    filled = cv2.inpaint(np.clip(np.round(picture), 0, 255).astype(np.uint8), hidden, 5, cv2.INPAINT_NS)
    return Scene(np.where(hidden > 0, filled, picture).astype(np.float32), scene.noise)


def _rough_places(collision: Collision, video: Video) -> dict[int, list[Array]]:
    """Where both beads are about in every frame, from a pendulum's motion through the two paths."""
    fall = _clear_of(collision.fall, collision.rest, 2.5 * collision.radius, from_end=True)
    rise = _clear_of(collision.rise, collision.rest, 2.5 * collision.radius, from_end=False)
    still = [frame for frame in range(video.first, fall.frames[-1] + 1)]
    hanging = Path(still + rise.frames, [collision.rest] * len(still) + rise.places, [])
    swings = first_guess(tuple(_rough_track(path, video) for path in (fall, hanging)))
    frames = np.arange(video.first, video.last + 1)
    seen = positions(swings, angles(swings, video.times[frames])[0])[:, :, 0] * [1, -1]
    places = {int(frame): [seen[0, k], seen[1, k]] for k, frame in enumerate(frames)}
    for path in (fall, rise):
        for frame, place in zip(path.frames, path.places, strict=True):
            places[frame].append(place)
    return places


def _rough_track(path: Path, video: Video) -> Track:
    position = np.array(path.places) * [1, -1]
    return Track(video.times[path.frames], position, np.full(len(position), np.nan))


def _on_path(path: Path, index: float) -> Array:
    places = np.array(path.places)
    return np.array([np.interp(index, path.frames, places[:, k]) for k in (0, 1)])


def _along(path: Path, index: int) -> tuple[Array, Array]:
    """Place [px] and velocity [px/frame] on a path."""
    return _on_path(path, index), (_on_path(path, index + 1) - _on_path(path, index - 1)) / 2


# --- following ------------------------------------------------------------------------------------------------------


def _learn_looks(
    video: Video, channel: Channel, scene: Scene, collision: Collision
) -> tuple[list[Look], float]:
    """What A and B look like, from frames in which they are apart, and the exposure's share of the frame interval."""
    fall = _clear_of(collision.fall, collision.rest, 3 * collision.radius, from_end=True)
    rise = _clear_of(collision.rise, collision.rest, 3 * collision.radius, from_end=False)
    # not the first frames of the fall: something may hold the bead there
    wanted = [_spread(path.frames[len(path.frames) // 3 * (1 - k)], path.frames[-1]) for k, path in enumerate((fall, rise))]
    fits: list[list[BeadFit]] = [[], []]
    smears: list[float] = []
    for frame in video.frames():
        for bead, path in enumerate((fall, rise)):
            if frame.index in wanted[bead]:
                place = _on_path(path, frame.index)
                # a radius far off is no small error: the fit is held near the one it starts from
                tries = [
                    fit_bead(scene.view(channel.grey(frame)).grey, scene.picture, (place[0], place[1]), radius)
                    for radius in (collision.radius, 1.3 * collision.radius)
                ]
                found = [fit for fit in tries if fit is not None]
                if found:
                    best = min(found, key=lambda fit: fit.image.sigma)
                    fits[bead].append(best)
                    speed = np.hypot(*(_on_path(path, frame.index + 1) - _on_path(path, frame.index - 1))) / 2
                    smears += [math.hypot(*best.image.blur) / float(speed)] if speed > 3 else []
    if len(fits[0]) < 3 and len(fits[1]) < 3:
        raise NothingToMeasure(f"{video.path}: what moves in this clip does not look like beads.")
    looks = [common_look(own if len(own) >= 3 else other) for own, other in (fits, fits[::-1])]
    return looks, min(float(np.median(smears)), 1.0) if len(smears) > 2 else 0.3


def _spread(first: int, last: int) -> set[int]:
    return set(np.unique(np.linspace(first, last, 10).round().astype(int)).tolist())


def _follow(
    video: Video,
    channel: Channel,
    scene: Scene,
    collision: Collision,
    looks: list[Look],
    exposure: float,
    progress: Progress,
) -> Beads:
    """Locate both beads in every frame, each from where its path or its last frames say it should be."""
    walk = _Walk(scene, collision, looks, exposure, video.first)
    for frame in video.frames():
        progress("following the beads", frame.index - video.first, video.last - video.first + 1)
        walk.step(frame.index, channel.grey(frame))
    return Beads(
        np.array(walk.frames),
        walk.a,
        walk.b,
        looks,
        exposure,
        scene,
        channel,
        np.array(walk.shakes),
        np.array(walk.looked, dtype=bool).T,
    )


class _Walk:
    """State of following two beads through the clip."""

    def __init__(self, scene: Scene, collision: Collision, looks: list[Look], exposure: float, first: int) -> None:
        self.scene, self.collision, self.looks, self.exposure = scene, collision, looks, exposure
        self.frames: list[int] = []
        self.shakes: list[tuple[float, float]] = []
        self.a: list[BeadImage | None] = []
        self.b: list[BeadImage | None] = []
        self.looked: list[list[bool]] = []
        reach = looks[0].radius + looks[1].radius
        self.fall = _clear_of(collision.fall, collision.rest, 1.2 * reach, from_end=True)
        self.rise = _clear_of(collision.rise, collision.rest, 1.2 * reach, from_end=False)
        arriving, leaving = self.fall.velocity(at_end=True), self.rise.velocity(at_end=False)
        self._hit = _hit_frame(self.fall, arriving, collision.rest, reach)
        # beads of equal mass: A keeps what B does not take; the search around it forgives other masses
        self._kept = arriving - leaving
        # a bead at rest is the same in every frame: a few dozen frames say where
        left = np.hypot(*(np.array(self.fall.places) - self.fall.places[0]).T) > 1.5
        self._release = self.fall.frames[int(np.argmax(left))] - 2
        self._rest_steps = (max(1, round((self._release - first) / 10)), max(1, round((self._hit - first) / 25)))

    def step(self, index: int, grey: Grey) -> None:
        view = self.scene.view(grey, self.shakes[-1] if self.shakes else (0.0, 0.0))
        (expected_a, speed_a), (expected_b, speed_b) = self._expect_a(index), self._expect_b(index)
        # in its swing B is well known beforehand; just after the collision A is not
        b, a = None, None
        looked = [
            index >= self._release or index % self._rest_steps[0] == 0,
            index > self._hit - 3 or index % self._rest_steps[1] == 0,
        ]
        if looked[1]:
            b = self._see(view.grey, expected_b, speed_b, 1, expected_a if index < self._hit else None)
        if looked[0]:
            beside = expected_b if b is None else np.array([b.x, b.y])
            a = self._see(view.grey, expected_a, speed_a, 0, beside)
        self.looked.append(looked)
        self.frames.append(index)
        self.shakes.append(view.shake)
        self.a.append(a)
        self.b.append(b)

    def _expect_a(self, index: int) -> tuple[Array, Array]:
        """Place [px] and velocity [px/frame]."""
        last, arriving = self.fall.frames[-1], self.fall.velocity(at_end=True)
        if index < last:
            return _along(self.fall, index)
        if index <= self._hit:
            return self.fall.places[-1] + arriving * (index - last), arriving
        return self._onwards(self.a, index, self.fall.places[-1] + arriving * (self._hit - last), self._kept, self._hit)

    def _expect_b(self, index: int) -> tuple[Array, Array]:
        rise, rest = self.rise, self.collision.rest
        found = [image for image in self.b if image is not None]
        if index <= self._hit:
            if len(found) >= 5:
                rest = np.array([np.median([image.x for image in found]), np.median([image.y for image in found])])
            return rest, np.zeros(2)
        if index < rise.frames[0]:
            velocity = (rise.places[0] - rest) / max(rise.frames[0] - self._hit, 1e-9)
            return rest + (index - self._hit) * velocity, velocity
        if index < rise.frames[-1]:
            return _along(rise, index)
        return self._onwards(self.b, index, rise.places[-1], rise.velocity(at_end=True), rise.frames[-1])

    def _onwards(
        self, images: list[BeadImage | None], index: int, start: Array, velocity: Array, since: float
    ) -> tuple[Array, Array]:
        """Straight on from the last frames in which the bead was found since the collision."""
        seen = [
            (frame, image)
            for frame, image in zip(self.frames[-12:], images[-12:], strict=True)
            if image is not None and frame > since
        ][-3:]
        if not seen:
            return start + velocity * (index - since), velocity
        places = np.array([[image.x, image.y] for _, image in seen])
        if len(seen) > 1:
            velocity = (places[-1] - places[0]) / (seen[-1][0] - seen[0][0])
        return places[-1] + velocity * (index - seen[-1][0]), velocity

    def _see(
        self, grey: npt.NDArray[np.float32], expected: Array, velocity: Array, bead: int, other: Array | None
    ) -> BeadImage | None:
        look, blur = self.looks[bead], velocity * self.exposure
        image = _locate_beside(grey, self.scene, expected, look, blur, other, self.looks[1 - bead].radius)
        if image is None:
            return None
        return image if np.hypot(image.x - expected[0], image.y - expected[1]) < 1.2 * look.radius + 5 else None


def relocate(video: Video, beads: Beads, places: Array, velocities: Array, again: npt.NDArray[np.bool_]) -> Beads:
    """Look again in the frames and for the beads marked in `again` (shape (2, n)), where the fitted swing says they are.

    `places` [px] and `velocities` [px/frame] have shape (2, n, 2).  A bead that is not found there is not seen.
    """
    found = [list(beads.a), list(beads.b)]
    numbers = {int(frame): k for k, frame in enumerate(beads.frames)}
    for frame in video.frames():
        k = numbers[frame.index]
        if not np.any(again[:, k]):
            continue
        shake = (float(beads.shakes[k, 0]), float(beads.shakes[k, 1]))
        grey = beads.scene.view(beads.channel.grey(frame), shake).grey
        for bead in np.flatnonzero(again[:, k]):
            look, place, blur = beads.looks[bead], places[bead, k], velocities[bead, k] * beads.exposure
            other, other_radius = places[1 - bead, k], beads.looks[1 - bead].radius
            image = _locate_beside(grey, beads.scene, place, look, blur, other, other_radius)
            if image is not None and np.hypot(image.x - place[0], image.y - place[1]) > 2 + 0.3 * look.radius:
                image = None
            found[bead][k] = image
    return replace(beads, a=found[0], b=found[1])


def _locate_beside(
    grey: npt.NDArray[np.float32],
    scene: Scene,
    expected: Array,
    look: Look,
    blur: Array,
    other: Array | None,
    other_radius: float,
) -> BeadImage | None:
    """One bead where the other may be close by: the other's pixels are not looked at."""
    hidden = None
    if other is not None and np.hypot(*(expected - other)) < 2.5 * (look.radius + other_radius) + 10:
        y, x = np.mgrid[: grey.shape[0], : grey.shape[1]]
        to_other = np.hypot(x - other[0], y - other[1])
        nearer = to_other - other_radius < np.hypot(x - expected[0], y - expected[1]) - look.radius
        hidden = nearer & (to_other < other_radius + 3)
    place = (float(expected[0]), float(expected[1]))
    # no blur at all would mean "unknown"
    smear = (float(blur[0]) + 0.01, float(blur[1]))
    fit = fit_bead(grey, scene.picture, place, look.radius, blur_guess=smear, hidden=hidden, look=look)
    return None if fit is None else fit.image


def _clear_of(path: Path, rest: Array, reach: float, *, from_end: bool) -> Path:
    """The path without its frames next to the hanging bead, where the two show as one spot."""
    far = np.hypot(*(np.array(path.places) - rest).T) > reach
    keep = np.flatnonzero(far)
    if len(keep) < 4:
        return path
    return path.part(0, int(keep[-1]) + 1) if from_end else path.part(int(keep[0]), len(path.frames))


def _hit_frame(fall: Path, arriving: Array, rest: Array, reach: float) -> float:
    """When A, going on as it does, comes within `reach` [px] of B at rest: a frame number with a fraction."""
    speed = float(np.hypot(*arriving))
    ahead = float((rest - fall.places[-1]) @ arriving) / max(speed, 1e-9) - reach
    return float(fall.frames[-1] + max(ahead, 0.0) / max(speed, 1e-9))
