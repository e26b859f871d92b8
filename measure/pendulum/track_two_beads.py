"""Locate the two beads of a double pendulum with sub-pixel accuracy in every frame, in contact or apart.

`find_beads` follows both beads through the clip, based on their collision (`find_collision`); `relocate` searches
again at the positions given by the fitted swings.  The beads swing in one plane and cannot pass each other.

Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage
from rigtwin.lab.errors import NothingToMeasure, Seen
from rigtwin.lab.progress import Progress, silent
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.pendulum.find_collision import (
    JUST_LEFT,
    Collision,
    Path,
    Region,
    find_collision,
    find_paths,
    hanging_place,
    hung,
    lone_falls,
    marks_of,
    struck,
    weight_of,
)
from rigtwin.measure.scene.background import Background, frames_of
from rigtwin.measure.scene.pose import Pose, rounded, shakes_of
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tracking.bead_image import BeadFit, BeadImage, Look
from rigtwin.measure.tracking.colour_channel import Channel, best_channel
from rigtwin.measure.tracking.detect import Spot
from rigtwin.measure.tracking.link import SpotPath
from rigtwin.measure.tracking.refine import common_look, fit_bead

SPARSER = (4, 16)  # frame steps that are tried if neighbouring frames are too similar to show a collision
# weight of two paths that meet over that of the heaviest path, below which pieces of paths are tried, too: parts of
# threads have 0.05 to 0.25 in films by VTK, beads beside a hand may have less
LIGHT = 0.25
WHOLE = 1.3  # fitted radius of a bead over that of its spots; above it the spots show a part of the bead (films by VTK)
MOST_ALONE = 3  # number of paths of A alone that are tried where no two paths meet
FEWEST = 30  # minimum number of frames that a search with a larger step has (films by VTK)
SAMPLES = 21  # number of frames from which the background is learnt


@dataclass(frozen=True)
class Beads:
    """Both beads (the one bead, before a wall) in every frame of the clip."""

    frames: npt.NDArray[np.int64]  # frame numbers, shape (n,)
    images: tuple[list[BeadImage | None], ...]  # of A and B, one per frame
    looks: list[Look]  # of A and B
    exposure: float  # share of the frame interval
    scene: Scene
    channel: Channel
    poses: tuple[Pose, ...]  # of each frame relative to the scene
    looked: npt.NDArray[np.bool_]  # whether each bead was searched for, shape (2, n)
    greys: dict[int, GreyImage]  # the frames from which the background was learnt

    @property
    def shakes(self) -> Array:
        """Position of the scene's origin in each frame [px], shape (n, 2)."""
        return shakes_of(self.poses)


def find_beads(
    video: Video,
    region: Region | None = None,
    *,
    stated_length: float | None = None,
    progress: Progress = silent,
) -> Beads:
    """Locate both beads in every frame; `stated_length` [m] of the pendulum is used in messages only.

    Raises `NothingToMeasure` if no two bodies collide in the clip.
    """
    samples = sample_frames(video, progress)
    scene = still_scene({index: frame.grey for index, frame in samples.items()})
    collision = _collision(video, scene, samples, region, stated_length, progress)
    falling = np.linspace(collision.fall.frames[0], collision.fall.frames[-1], 12).round().astype(int)
    channel = best_channel(frames_of(video, set(falling.tolist())), as_spots(collision.fall))
    greys = {index: channel.grey(frame) for index, frame in samples.items()}
    scene = still_scene(greys)
    greys |= {frame.index: channel.grey(frame) for frame in _right_after(video, collision)}
    collision = _of_whole_beads(video, channel, scene, collision)
    collision = replace(collision, rest=hanging_place(_steady(scene, greys), collision))
    scene = _without_beads(scene, greys, collision.rest, collision.radius, _rough_places(collision, greys))
    looks, exposure = _learn_looks(video, channel, scene, collision)
    walk = _Walk(scene, collision, looks, exposure, video.first)
    for frame in video.frames():
        progress("following the beads", frame.index - video.first, video.last - video.first + 1)
        walk.step(frame.index, channel.grey(frame))
    return Beads(
        np.array(walk.frames),
        (walk.a, walk.b),
        looks,
        exposure,
        scene,
        channel,
        tuple(walk.poses),
        np.array(walk.looked, dtype=bool).T,
        greys,
    )


def _collision(
    video: Video,
    scene: Scene,
    samples: dict[int, Frame],
    region: Region | None,
    stated_length: float | None,
    progress: Progress,
) -> Collision:
    """Find the collision; if none is found, search again with a larger step between frames.

    In a high-speed film the common spot of both beads moves from one to the other without a jump, while spots of the
    threads seem to meet.  Broken paths are joined only if no whole ones meet where a bead is seen to have hung, and the
    path of A alone is tried only if no pair of paths is heavier than every single path.
    """
    seen: dict[int, list[Path]] = {}
    steady = _steady(scene, {index: frame.grey for index, frame in samples.items()})

    def shown(pace: tuple[int, int], meeting: Collision) -> bool:
        meeting = meeting.of_every(*pace)
        right_after = {frame.index: frame.grey for frame in _right_after(video, meeting)}
        return hung(steady | _steady(scene, right_after), meeting)

    refused: NothingToMeasure | None = None
    heavy: Collision | None = None  # the first that is heavier than any path alone
    best: Collision | None = None
    heaviest = 0.0
    for in_pieces in (False, True):
        for every in (1, *SPARSER):
            if every > 1 and video.last - video.first < every * FEWEST:
                break
            if every not in seen:
                seen[every] = find_paths(video, scene, samples, region, progress, every=every)
            try:
                pace = _pace(every, video)
                found = find_collision(seen[every], video, stated_length, partial(shown, pace), in_pieces=in_pieces)
                found = found.of_every(*pace)
            except NothingToMeasure as error:
                refused = refused or error  # keep the first message: its period is based on all frames
                continue
            alone = max(weight_of(path) for path in seen[every])
            if found.weight > alone:
                if shown((1, 0), found):
                    return found
                heavy = heavy or found
            # not shown, or some other path has a larger weight, possibly that of the beads
            heaviest = max(heaviest, alone)
            if best is None or found.weight > best.weight:
                best = found
        # parts of threads seem to meet as well: what is much lighter than another path is taken if nothing else meets
        if best is not None and best.weight > LIGHT * heaviest and shown((1, 0), best):
            return best
    least = max(LIGHT * heaviest, 0.0 if best is None else best.weight)
    taken = heavy or _lone_fall(seen, least, video, shown) or best
    if taken is None:
        assert refused is not None
        raise refused
    return taken


def _pace(every: int, video: Video) -> tuple[int, int]:
    """Frame step of the paths, and number of their first frame; with a step of 1 they have the film's own numbers."""
    return (1, 0) if every == 1 else (every, video.first)


def _lone_fall(
    seen: dict[int, list[Path]], least: float, video: Video, shown: Callable[[tuple[int, int], Collision], bool]
) -> Collision | None:
    """The first fall with a weight above `least` for which the film shows that a bead hung where it ends."""
    for every, paths in seen.items():
        pace = _pace(every, video)
        for collision in lone_falls(paths)[:MOST_ALONE]:
            if weight_of(collision.fall) > least and shown(pace, collision):
                return collision.of_every(*pace)
    return None


def _right_after(video: Video, collision: Collision) -> Iterable[Frame]:
    """Frames right after the collision: B has left its position and A has not reached it, so the background is seen."""
    # the path of A may continue along that of B
    first = min(collision.fall.frames[-1] + 1, collision.rise.frames[0], video.last)
    return video.frames(first, collision.rise.frames[0] + JUST_LEFT - 1)


def _steady(scene: Scene, greys: dict[int, GreyImage]) -> dict[int, GreyImage]:
    """The frames, by number, registered to the scene."""
    return {index: rounded(scene.view(grey).grey) for index, grey in greys.items()}


def still_scene(greys: dict[int, GreyImage]) -> Scene:
    """Background learnt from frames by number."""
    background = Background()
    for index, grey in greys.items():
        background.add(index, grey)
    return background.scene()


def as_spots(path: Path) -> SpotPath:
    """The path in the type used by `rigtwin.measure.tracking.follow`."""
    spots = [
        Spot(float(x), float(y), math.pi / 4 * size**2, size, size, 0.0)
        for (x, y), size in zip(path.places, path.sizes, strict=True)
    ]
    return SpotPath(tuple(path.frames), tuple(spots))


def sample_frames(video: Video, progress: Progress) -> dict[int, Frame]:
    """Frames spread evenly over the clip, by number."""
    progress("learning the still scene", 0, 1)
    samples = {frame.index: frame for frame in video.single(video.spread(SAMPLES))}
    progress("learning the still scene", 1, 1)
    return samples


def _without_beads(
    scene: Scene, greys: dict[int, GreyImage], rest: Array, radius: float, places: dict[int, list[Array]]
) -> Scene:
    """Background without the beads, from the frames in `places`, which holds possible positions of beads in them.

    Where beads cover a pixel in many frames, the median over time is not the background.  There the frames are used in
    which the beads are furthest away; pixels that are always covered are filled from their surroundings.
    """
    reach = round(1.7 * radius + 3)
    cover = np.zeros(scene.picture.shape, dtype=np.float32)
    for spots in places.values():
        disc = np.zeros(cover.shape, dtype=np.uint8)
        for place in spots:
            cv2.circle(disc, (round(place[0]), round(place[1])), reach, 1, cv2.FILLED)
        cover += disc
    slow = np.zeros(cover.shape, dtype=np.uint8)
    cv2.circle(slow, (round(rest[0]), round(rest[1])), round(5 * radius), 1, cv2.FILLED)
    y, x = np.nonzero((cover > 0.1 * len(places)) | (slow > 0))
    away = np.stack(
        [np.min([np.hypot(x - place[0], y - place[1]) for place in spots], axis=0) for spots in places.values()]
    )
    values = np.stack([scene.view(greys[index]).grey[y, x] for index in places])
    furthest = np.argsort(-away, axis=0)[:5]
    picture, hidden = scene.picture.copy(), np.zeros(cover.shape, dtype=np.uint8)
    picture[y, x] = np.median(np.take_along_axis(values, furthest, 0), axis=0)
    never = np.take_along_axis(away, furthest, 0)[-1] < radius + 1.5
    hidden[y[never], x[never]] = 1
    filled = cv2.inpaint(np.clip(np.round(picture), 0, 255).astype(np.uint8), hidden, 5, cv2.INPAINT_NS)
    return Scene(np.where(hidden > 0, filled, picture).astype(np.float32), scene.noise)


def _rough_places(collision: Collision, indices: Iterable[int]) -> dict[int, list[Array]]:
    """Possible positions of beads in those frames of `indices` in which they are known well enough."""
    hit, rest = collision.rise.frames[0], collision.rest
    fall = collision.fall.clear_of(rest, 2.5 * collision.radius, from_end=True)
    velocity = collision.rise.velocity(at_end=False)
    touch = rest - 2 * collision.radius * velocity / max(float(np.hypot(*velocity)), 1e-9)
    places = {}
    for index in indices:
        if index <= fall.frames[-1]:
            places[index] = [fall.at(index), rest]
        elif hit <= index < hit + 12:
            # A may stop at the contact or go on with up to half the speed of B (this excludes a restitution below 0.3)
            onwards = [touch + share * velocity * (index - hit + 2) for share in np.linspace(0, 0.5, 6)]
            places[index] = [collision.rise.at(index), *onwards]
    return places


# --- following ------------------------------------------------------------------------------------------------------


def _learn_looks(video: Video, channel: Channel, scene: Scene, collision: Collision) -> tuple[list[Look], float]:
    """Appearance of A and B from frames in which they are apart, and exposure over frame interval."""
    fall = collision.fall.clear_of(collision.rest, 3 * collision.radius, from_end=True)
    rise = collision.rise.clear_of(collision.rest, 3 * collision.radius, from_end=False)
    # not the first frames of the fall: a holder may occlude the bead there
    wanted = [
        _spread(path.frames[len(path.frames) // 3 * (1 - k)], path.frames[-1]) for k, path in enumerate((fall, rise))
    ]
    fits: list[list[BeadFit]] = [[], []]
    smears: list[float] = []
    for frame in video.frames(min(wanted[0] | wanted[1]), max(wanted[0] | wanted[1])):
        for bead, path in enumerate((fall, rise)):
            if frame.index in wanted[bead] and (bead == 0 or collision.rise_seen):
                (x, y), speed = path.along(frame.index)
                grey = scene.view(channel.grey(frame)).grey
                # radius and exposure are not known yet, and the fit stays near its start values: try several
                tries = [
                    fit_bead(
                        grey,
                        scene.picture,
                        (float(x), float(y)),
                        share * collision.radius,
                        blur_guess=(float(exposure * speed[0]) + 0.01, float(exposure * speed[1])),
                    )
                    for share, exposure in ((0.85, 0.2), (1.05, 0.2), (1.05, 0.8))
                ]
                found = [fit for fit in tries if fit is not None]
                if found:
                    best = min(found, key=lambda fit: fit.image.sigma)
                    fits[bead].append(best)
                    pace = float(np.hypot(*speed))
                    smears += [math.hypot(*best.image.blur) / pace] if pace > 3 else []
    if len(fits[0]) < 3 and not collision.rise_seen:
        raise NothingToMeasure(
            f"{video.path}: a moving object hits another one in frame {collision.fall.frames[-1]}, but a round bead "
            f"fits {len(fits[0])} pictures of it, 3 are needed; film the beads larger or with more light, or leave out "
            "what else moves with --region.",
            Seen(frame=collision.fall.frames[-1], marks=marks_of([collision.fall])),
        )
    if len(fits[0]) < 3 and len(fits[1]) < 3:
        raise NothingToMeasure(
            f"{video.path}: two moving objects meet in frame {collision.rise.frames[0]}, but a round bead fits "
            f"{len(fits[0])} pictures of the one and {len(fits[1])} of the other, 3 are needed; film the beads larger "
            "or with more light, or leave out what else moves with --region.",
            Seen(frame=collision.rise.frames[0], marks=marks_of([collision.fall, collision.rise])),
        )
    looks = [common_look(own if len(own) >= 3 else other) for own, other in (fits, fits[::-1])]
    return looks, min(float(np.median(smears)), 1.0) if len(smears) > 2 else 0.3


def _of_whole_beads(video: Video, channel: Channel, scene: Scene, collision: Collision) -> Collision:
    """The collision, with the fitted radius of A where the spots of its path are much smaller than the bead."""
    try:
        looks, _ = _learn_looks(video, channel, scene, collision)
    except NothingToMeasure:  # where the beads are part of the scene, which is cleared of them later
        return collision
    radius = looks[0].radius
    if radius < WHOLE * collision.radius:
        return collision
    return replace(collision, radius=radius) if collision.rise_seen else struck(collision.fall, radius)


def _spread(first: int, last: int) -> set[int]:
    return set(np.unique(np.linspace(first, last, 8).round().astype(int)).tolist())


class _Walk:
    """Locates both beads frame by frame, near the position predicted from its path or its last frames."""

    def __init__(self, scene: Scene, collision: Collision, looks: list[Look], exposure: float, first: int) -> None:
        self.scene, self.collision, self.looks, self.exposure = scene, collision, looks, exposure
        self.frames: list[int] = []
        self.poses: list[Pose] = []
        self.a: list[BeadImage | None] = []
        self.b: list[BeadImage | None] = []
        self.looked: list[list[bool]] = []
        reach = looks[0].radius + looks[1].radius
        self.fall = collision.fall.clear_of(collision.rest, 1.2 * reach, from_end=True)
        self.rise = collision.rise.clear_of(collision.rest, 1.2 * reach, from_end=False)
        arriving, leaving = self.fall.velocity(at_end=True), self.rise.velocity(at_end=False)
        self._hit = _hit_frame(self.fall, arriving, collision.rest, reach)
        # momentum of beads of equal mass; the search radius allows for other masses
        self._kept = arriving - leaving
        # a bead at rest needs only a few dozen frames
        left = np.hypot(*(np.array(self.fall.places) - self.fall.places[0]).T) > 1.5
        self._release = self.fall.frames[int(np.argmax(left))] - 2
        self._rest_steps = (max(1, round((self._release - first) / 10)), max(1, round((self._hit - first) / 25)))

    def step(self, index: int, grey: GreyImage) -> None:
        view = self.scene.view(grey, self.poses[-1].shake if self.poses else (0.0, 0.0))
        (expected_a, speed_a), (expected_b, speed_b) = self._expect_a(index), self._expect_b(index)
        # B first: its prediction is good, that of A just after the collision is not
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
        self.poses.append(view.pose)
        self.a.append(a)
        self.b.append(b)

    def _expect_a(self, index: int) -> tuple[Array, Array]:
        """Predicted position [px] and velocity [px/frame]."""
        last, arriving = self.fall.frames[-1], self.fall.velocity(at_end=True)
        if index < last:
            return self.fall.along(index)
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
            return rise.along(index)
        return self._onwards(self.b, index, rise.places[-1], rise.velocity(at_end=True), rise.frames[-1])

    def _onwards(
        self, images: list[BeadImage | None], index: int, start: Array, velocity: Array, since: float
    ) -> tuple[Array, Array]:
        """Linear extrapolation from the last frames in which the bead was found since the collision."""
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
        image = _locate_beside(
            grey, self.scene, expected, look, blur, other=other, other_radius=self.looks[1 - bead].radius
        )
        if image is None:
            return None
        return image if np.hypot(image.x - expected[0], image.y - expected[1]) < 1.2 * look.radius + 5 else None


def relocate(video: Video, beads: Beads, places: Array, velocities: Array, again: npt.NDArray[np.bool_]) -> Beads:
    """Search again for the beads in the frames marked in `again`, shape (2, n), at the positions of the fitted swings.

    `places` [px] and `velocities` [px/frame] have shape (2, n, 2).  With the positions of both beads known, the
    background behind them is improved; beads in front of changed parts are located again too.  A bead that is not
    found near its fitted position counts as not seen.
    """
    known = {int(frame): [places[0, k], places[1, k]] for k, frame in enumerate(beads.frames)}
    radius = max(look.radius for look in beads.looks)
    rest = np.median(places[1, beads.frames <= min(beads.greys) + 3], axis=0)
    scene = _without_beads(beads.scene, beads.greys, rest, radius, {index: known[index] for index in beads.greys})
    again = (again | _in_front_of(np.abs(scene.picture - beads.scene.picture), places, beads.looks)) & beads.looked
    beads = replace(beads, scene=scene)
    found = [list(images) for images in beads.images]
    numbers = {int(frame): k for k, frame in enumerate(beads.frames)}
    for frame in video.frames():
        k = numbers[frame.index]
        if not np.any(again[:, k]):
            continue
        grey = beads.scene.view(beads.channel.grey(frame), beads.poses[k].shake).grey
        for bead in np.flatnonzero(again[:, k]):
            look, place, blur = beads.looks[bead], places[bead, k], velocities[bead, k] * beads.exposure
            image = _locate_beside(
                grey,
                beads.scene,
                place,
                look,
                blur,
                other=places[1 - bead, k],
                other_radius=beads.looks[1 - bead].radius,
            )
            if image is not None and np.hypot(image.x - place[0], image.y - place[1]) > 2 + 0.3 * look.radius:
                image = None
            found[bead][k] = image
    return replace(beads, images=tuple(found))


def _in_front_of(change: npt.NDArray[np.float32], places: Array, looks: list[Look]) -> npt.NDArray[np.bool_]:
    """Which beads are in front of a part of the scene that changed by more than one grey level, shape (2, n)."""
    near = np.zeros(places.shape[:2], dtype=bool)
    for bead, look in enumerate(looks):
        size = 2 * math.ceil(look.radius) + 1
        mean = cv2.blur(change, (size, size))
        x, y = (np.clip(np.round(places[bead, :, axis]).astype(int), 0, change.shape[1 - axis] - 1) for axis in (0, 1))
        near[bead] = mean[y, x] > 1.0
    return near


def _locate_beside(
    grey: npt.NDArray[np.float32],
    scene: Scene,
    expected: Array,
    look: Look,
    blur: Array,
    *,
    other: Array | None,
    other_radius: float,
) -> BeadImage | None:
    """Locate one bead; pixels of the other bead, if close, are masked."""
    # window that contains all pixels of the fit
    reach = 1.5 * look.radius + 6 + np.abs(blur) / 2
    left, top = (max(int(place - far), 0) for place, far in zip(expected, reach, strict=True))
    right, bottom = (max(int(place + far) + 2, 0) for place, far in zip(expected, reach, strict=True))
    window = np.s_[top:bottom, left:right]
    part = grey[window]
    hidden = None
    if other is not None and np.hypot(*(expected - other)) < 2.5 * (look.radius + other_radius) + 10:
        x, y = np.arange(part.shape[1])[None, :] + left, np.arange(part.shape[0])[:, None] + top
        to_other = np.hypot(x - other[0], y - other[1])
        nearer = to_other - other_radius < np.hypot(x - expected[0], y - expected[1]) - look.radius
        hidden = nearer & (to_other < other_radius + 3)
    place = (float(expected[0]) - left, float(expected[1]) - top)
    # a blur of zero would mean "unknown"
    smear = (float(blur[0]) + 0.01, float(blur[1]))
    fit = fit_bead(part, scene.picture[window], place, look.radius, blur_guess=smear, hidden=hidden, look=look)
    return None if fit is None else replace(fit.image, x=fit.image.x + left, y=fit.image.y + top)


def _hit_frame(fall: Path, arriving: Array, rest: Array, reach: float) -> float:
    """Frame number (with fraction) at which A, at constant velocity, comes within `reach` [px] of B at rest."""
    speed = float(np.hypot(*arriving))
    ahead = float((rest - fall.places[-1]) @ arriving) / max(speed, 1e-9) - reach
    return float(fall.frames[-1] + max(ahead, 0.0) / max(speed, 1e-9))
