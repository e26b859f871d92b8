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
from rigtwin.measure.bead import Background, BeadImage, Scene, locate
from rigtwin.measure.media import Grey, Image, Video

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
    radius: float  # [px]
    scene: Scene
    shakes: Array  # [px], where the scene's origin lies in each frame, shape (n, 2)


def find_beads(
    video: Video, region: tuple[float, float, float, float] | None = None, progress: Progress = silent
) -> Beads:
    """Both beads in every frame.  Raises `NothingToMeasure` when no two bodies collide in the clip."""
    samples = _sample(video, progress)
    background = Background()
    for index, colour in samples.items():
        background.add(index, cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY))
    scene = background.scene()
    paths = _paths(video, scene, samples, region, progress)
    collision = _collision(paths, video)
    scene = _without_beads(scene, samples, collision)
    return _follow(video, scene, replace(collision, radius=_true_radius(scene, samples, collision)), progress)


def _sample(video: Video, progress: Progress) -> dict[int, Image]:
    count = video.last - video.first + 1
    wanted = set(np.unique(np.linspace(video.first, video.last, min(SAMPLES, count)).round().astype(int)).tolist())
    samples = {}
    for frame in video.frames():
        progress("learning the still scene", frame.index - video.first, count)
        if frame.index in wanted:
            samples[frame.index] = frame.colour
    return samples


# --- what moves -----------------------------------------------------------------------------------------------------


def _paths(
    video: Video,
    scene: Scene,
    samples: dict[int, Image],
    region: tuple[float, float, float, float] | None,
    progress: Progress,
) -> list[Path]:
    """Everything that moves, linked from frame to frame and broken where its speed jumps."""
    paths: list[Path] = []
    shake = (0.0, 0.0)
    still = np.median(np.stack(list(samples.values())), axis=0).astype(np.uint8)
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


def _collision(paths: list[Path], video: Video) -> Collision:
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
            f"{video.path}: no bead is seen to hit a second one; the clip must show the released bead, "
            "the hanging bead and their collision."
        )
    fall, rise = best
    radius = float(np.median([*fall.sizes, *rise.sizes])) / 2 + 0.5
    fall = _with_beginning(fall, paths)
    return Collision(fall, rise, _rest_place(fall, rise, paths, radius), max(radius, 2.0))


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


def _true_radius(scene: Scene, samples: dict[int, Image], collision: Collision) -> float:
    """Radius [px] that fits bead B where it hangs still and sharp; the spot's own width where that shows none."""
    best: list[tuple[float, float]] = []
    for index in [index for index in samples if index < collision.fall.frames[-1] - 3][:4]:
        grey = scene.view(cv2.cvtColor(samples[index], cv2.COLOR_BGR2GRAY)).grey
        place = (float(collision.rest[0]), float(collision.rest[1]))
        tries = [locate(grey, scene.picture, place, collision.radius * factor) for factor in (0.8, 1.1, 1.5)]
        found = [(image.sigma, image.radius) for image in tries if image is not None]
        if found:
            best.append(min(found))
    return float(np.median([radius for _, radius in best])) if best else collision.radius


def _without_beads(scene: Scene, samples: dict[int, Image], collision: Collision) -> Scene:
    """The still scene behind the beads as well: median over the frames in which no bead covers the pixel."""
    stack, covered = [], []
    reach = round(1.7 * collision.radius + 3)
    for index, colour in samples.items():
        grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
        stack.append(scene.view(grey).grey)
        cover = np.zeros(grey.shape, dtype=np.uint8)
        for place in _rough_places(collision, index):
            cv2.circle(cover, (round(place[0]), round(place[1])), reach, 1, cv2.FILLED)
        covered.append(cover > 0)
    values, hidden = np.stack(stack), np.stack(covered)
    change = np.any(hidden, axis=0) & (np.sum(~hidden, axis=0) >= 2)
    picture = scene.picture.copy()
    columns = values[:, change]
    columns[hidden[:, change]] = np.nan
    picture[change] = np.nanmedian(columns, axis=0)
    return Scene(picture, scene.noise)


def _rough_places(collision: Collision, index: int) -> list[Array]:
    """Where the beads are about in a frame; after the collision A is somewhere between the two known places."""
    fall, rise = collision.fall, collision.rise
    hit = (fall.frames[-1] + rise.frames[0]) / 2
    if index <= hit:
        return [_on_path(fall, index), collision.rest]
    return [_on_path(rise, index)] if index <= rise.frames[-1] else []


def _on_path(path: Path, index: int) -> Array:
    places = np.array(path.places)
    return np.array([np.interp(index, path.frames, places[:, k]) for k in (0, 1)])


# --- following ------------------------------------------------------------------------------------------------------


def _follow(video: Video, scene: Scene, collision: Collision, progress: Progress) -> Beads:
    """Locate both beads in every frame, each from where its path or its last frames say it should be."""
    walk = _Walk(scene, collision)
    for frame in video.frames():
        progress("following the beads", frame.index - video.first, video.last - video.first + 1)
        walk.step(frame.index, frame.grey)
    return Beads(np.array(walk.frames), walk.a, walk.b, walk.radius, scene, np.array(walk.shakes))


class _Walk:
    """State of following two beads through the clip."""

    def __init__(self, scene: Scene, collision: Collision) -> None:
        self.scene, self.collision, self.radius = scene, collision, collision.radius
        self.frames: list[int] = []
        self.shakes: list[tuple[float, float]] = []
        self.a: list[BeadImage | None] = []
        self.b: list[BeadImage | None] = []
        self._radii: list[float] = []
        self.fall = _clear_of(collision.fall, collision.rest, 2.5 * collision.radius, from_end=True)
        self.rise = _clear_of(collision.rise, collision.rest, 2.5 * collision.radius, from_end=False)
        arriving, leaving = self.fall.velocity(at_end=True), self.rise.velocity(at_end=False)
        self._hit = _hit_frame(self.fall, arriving, collision.rest, collision.radius)
        # beads of equal mass: A keeps what B does not take; the search around it forgives other masses
        self._kept = arriving - leaving

    def step(self, index: int, grey: Grey) -> None:
        view = self.scene.view(grey, self.shakes[-1] if self.shakes else (0.0, 0.0))
        expected_a, expected_b = self._expect_a(index), self._expect_b(index)
        # in its swing B is well known beforehand; just after the collision A is not
        b = self._see(view.grey, expected_b, expected_a if index < self._hit else None)
        at_b = expected_b if b is None else np.array([b.x, b.y])
        a = self._see(view.grey, expected_a, at_b)
        self.frames.append(index)
        self.shakes.append(view.shake)
        self.a.append(a)
        self.b.append(b)
        if len(self._radii) < 60:
            self._radii += [image.radius for image in (a, b) if image is not None]
            self.radius = float(np.median(self._radii)) if len(self._radii) >= 8 else self.radius

    def _expect_a(self, index: int) -> Array:
        if index <= self.fall.frames[-1]:
            return _on_path(self.fall, index)
        if index <= self._hit:
            return self.fall.places[-1] + self.fall.velocity(at_end=True) * (index - self.fall.frames[-1])
        start = self.fall.places[-1] + self.fall.velocity(at_end=True) * (self._hit - self.fall.frames[-1])
        return self._onwards(self.a, index, start, self._kept, self._hit)

    def _expect_b(self, index: int) -> Array:
        if index <= self._hit:
            return self.collision.rest
        if index <= self.rise.frames[-1]:
            share = (index - self._hit) / max(self.rise.frames[0] - self._hit, 1e-9)
            if share < 1:
                return self.collision.rest + share * (self.rise.places[0] - self.collision.rest)
            return _on_path(self.rise, index)
        return self._onwards(
            self.b, index, self.rise.places[-1], self.rise.velocity(at_end=True), self.rise.frames[-1]
        )

    def _onwards(
        self, images: list[BeadImage | None], index: int, start: Array, velocity: Array, since: float
    ) -> Array:
        """Straight on from the last frames in which the bead was found since the collision."""
        seen = [
            (frame, image)
            for frame, image in zip(self.frames[-12:], images[-12:], strict=True)
            if image is not None and frame > since
        ][-3:]
        if not seen:
            return start + velocity * (index - since)
        places = np.array([[image.x, image.y] for _, image in seen])
        if len(seen) > 1:
            velocity = (places[-1] - places[0]) / (seen[-1][0] - seen[0][0])
        return np.asarray(places[-1] + velocity * (index - seen[-1][0]))

    def _see(self, grey: npt.NDArray[np.float32], expected: Array, other: Array | None) -> BeadImage | None:
        image = _locate_beside(grey, self.scene, expected, self.radius, other)
        if image is None or not 0.6 < image.radius / self.radius < 1.6:
            return None
        return image if np.hypot(image.x - expected[0], image.y - expected[1]) < 1.2 * self.radius + 5 else None


def relocate(video: Video, beads: Beads, places: Array, velocities: Array, again: npt.NDArray[np.bool_]) -> Beads:
    """Look again in the frames and for the beads marked in `again` (shape (2, n)), where the fitted swing says they are.

    `places` [px] and `velocities` [px/frame] have shape (2, n, 2).  A bead that is not found there is not seen.
    """
    found = [list(beads.a), list(beads.b)]
    numbers = {int(frame): k for k, frame in enumerate(beads.frames)}
    exposure = _exposure(beads, velocities)
    for frame in video.frames():
        k = numbers[frame.index]
        if not np.any(again[:, k]):
            continue
        grey = beads.scene.view(frame.grey, (float(beads.shakes[k, 0]), float(beads.shakes[k, 1]))).grey
        for bead in np.flatnonzero(again[:, k]):
            place, blur = places[bead, k], velocities[bead, k] * exposure
            image = _locate_beside(grey, beads.scene, place, beads.radius, places[1 - bead, k], (blur[0], blur[1]))
            if image is not None and np.hypot(image.x - place[0], image.y - place[1]) > 2 + 0.3 * beads.radius:
                image = None
            found[bead][k] = image
    return replace(beads, a=found[0], b=found[1])


def _exposure(beads: Beads, velocities: Array) -> float:
    """Share of the frame interval during which the shutter was open, from the smear of fast beads."""
    shares = [
        math.hypot(*image.blur) / float(np.hypot(*velocity))
        for images, speeds in zip((beads.a, beads.b), velocities, strict=True)
        for image, velocity in zip(images, speeds, strict=True)
        if image is not None and np.hypot(*velocity) > 0.3 * beads.radius
    ]
    return min(float(np.median(shares)), 1.0) if len(shares) > 4 else 0.3


def _locate_beside(
    grey: npt.NDArray[np.float32],
    scene: Scene,
    expected: Array,
    radius: float,
    other: Array | None,
    blur: tuple[float, float] = (0.0, 0.0),
) -> BeadImage | None:
    """One bead where the other may be close by: the other's pixels are not looked at."""
    hidden = None
    if other is not None and np.hypot(*(expected - other)) < 4 * radius + 10:
        y, x = np.mgrid[: grey.shape[0], : grey.shape[1]]
        nearer = np.hypot(x - other[0], y - other[1]) < np.hypot(x - expected[0], y - expected[1])
        hidden = nearer & (np.hypot(x - other[0], y - other[1]) < radius + 3)
    return locate(grey, scene.picture, (float(expected[0]), float(expected[1])), radius, blur, hidden)


def _clear_of(path: Path, rest: Array, reach: float, *, from_end: bool) -> Path:
    """The path without its frames next to the hanging bead, where the two show as one spot."""
    far = np.hypot(*(np.array(path.places) - rest).T) > reach
    keep = np.flatnonzero(far)
    if len(keep) < 4:
        return path
    return path.part(0, int(keep[-1]) + 1) if from_end else path.part(int(keep[0]), len(path.frames))


def _hit_frame(fall: Path, arriving: Array, rest: Array, radius: float) -> float:
    """When A, going on as it does, touches B at rest: a frame number with a fraction."""
    speed = float(np.hypot(*arriving))
    ahead = float((rest - fall.places[-1]) @ arriving) / max(speed, 1e-9) - 2 * radius
    return float(fall.frames[-1] + max(ahead, 0.0) / max(speed, 1e-9))
