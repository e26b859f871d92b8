"""The still scene of a clip: learnt from frames spread over it, and how a shaken, flickering frame lies over it.

Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, GreyImage, Mask

STEADY = 0.03  # [px], a shake that moving the picture back would blur more than it helps
FAR = 0.12  # of the picture's longer side, up to which a shake is believed
NEAR = 1.5  # [px], within which a coarse and a fine look at a shake agree
SHARP = 0.12  # of the misfit some pixels beside it, that a frame in its place may leave; in a wrong one it leaves more
AS_BEFORE = 0.9  # of what frames before left some pixels beside their place, that one in its place leaves at most
FEWEST = 60  # pixels at edges by which a frame is laid over the scene
# [grey levels] that the clearest edges leave some pixels beside their place: what codecs freeze of noise leaves up to
# 5, the edges of films five times too dark 8 and more
GRAIN = 6.0
MOST_UNUSUAL = 2.0  # times the usual noise: bright pixels of a camera have that much more than dark ones
BORDER = 8  # [px], of a scene, in which no edges are looked at
STRONGEST = 300  # pixels, at the strongest edges of all
AT_ONCE = 256  # frames whose strongest edges are looked at together
AS_NOISE = 2.0  # times the scene's noise, that it may leave as well
COARSE = 480  # [px], longer side of the picture in which a large shake is looked for
FLICKER = 0.01  # relative change of brightness above which a frame is levelled with an offset as well


def middle_of(values: Array) -> float:
    """The median of many, without the care np.median takes of few; to seven digits, three times as quick as to all."""
    half = len(values) // 2
    parted = values.astype(np.float32)
    parted.partition(half)
    return float(parted[half])


@dataclass(frozen=True)
class Pose:
    """How a frame lies over the scene, and how bright it is against it."""

    shake: tuple[float, float] = (0.0, 0.0)  # [px], where the scene's origin lies in the frame
    gain: float = 1.0
    offset: float = 0.0  # [grey levels]
    doubt: tuple[float, float] = (0.0, 0.0)  # [px], half of what two halves of the scene disagree by on the shake
    misfit: float = math.inf  # [grey levels], median of what it leaves at the scene's edges
    placed: bool = True  # else the picture does not tell where the frame lies, and the shake is a guess
    beside: float = 0.0  # [grey levels], likewise left some pixels beside; 0 where that was not looked at
    strongest_off: tuple[float, float] = (0.0, 0.0)  # [px], how far the scene's strongest edges lie off it

    def seen(self, grey: GreyImage, box: tuple[int, int, int, int] | None = None) -> FloatImage:
        """A part of the frame (left, top, right, bottom; all where None), moved back and levelled to the scene's."""
        left, top, right, bottom = box or (0, 0, grey.shape[1], grey.shape[0])
        if max(map(abs, self.shake)) > STEADY:
            x, y = (first + (end - 1 - first) / 2 for first, end in ((left, right), (top, bottom)))
            # exact, where cv2.warpAffine goes in steps of a thirty-second of a pixel
            middle = (x + self.shake[0], y + self.shake[1])
            moved = cv2.getRectSubPix(grey, (right - left, bottom - top), middle, patchType=cv2.CV_32F)
            part: FloatImage = np.asarray(moved, dtype=np.float32)
        else:
            part = grey[top:bottom, left:right].astype(np.float32)
        if self.offset != 0:
            np.subtract(part, np.float32(self.offset), out=part)
        if self.gain != 1:
            np.multiply(part, np.float32(1 / self.gain), out=part)
        return part

    def standing(self) -> Pose:
        """Of a camera that is known to stand still."""
        return replace(self, shake=(0.0, 0.0), doubt=(0.0, 0.0))


LOST = Pose(placed=False)


def _worth_moving(shake: tuple[float, float]) -> Array:
    return np.array(shake) if max(map(abs, shake)) > STEADY else np.zeros(2)


def shakes_of(poses: Sequence[Pose]) -> Array:
    """[px], shape (n, 2)"""
    return np.array([pose.shake for pose in poses]).reshape(-1, 2)


def stands_still(poses: Sequence[Pose]) -> bool:
    """Whether the shake is no more than its own error: taking it out would only add that error to every place."""
    poses = [pose for pose in poses if pose.placed]
    if not poses:
        return True
    shakes, doubts = shakes_of(poses), np.array([pose.doubt for pose in poses]).reshape(-1, 2)
    found = np.mean((shakes - np.median(shakes, axis=0)) ** 2, axis=0)
    return bool(np.all(found < np.maximum(2 * np.mean(doubts**2, axis=0), STEADY**2)))


@dataclass(frozen=True)
class _Anchors:
    """Pixels at strong edges, spread over a picture, by which a frame is laid over it."""

    x: npt.NDArray[np.intp]
    y: npt.NDArray[np.intp]
    rows: Array  # slope in x, slope in y, minus the grey level; shape (3, n)
    halves: tuple[slice, slice]  # those in one half and in the other of the picture, in checks

    @classmethod
    def of(cls, x: npt.NDArray[np.intp], y: npt.NDArray[np.intp], rows: Array, half: Mask) -> _Anchors:
        """`half` says of each pixel whether it lies in the first half."""
        order, first = np.argsort(~half, kind="stable"), int(np.sum(half))
        return cls(x[order], y[order], rows[:, order], (slice(first), slice(first, None)))

    def best(self, count: int) -> _Anchors:
        """The `count` of them with the strongest edges."""
        chosen = np.argsort(-np.sum(self.rows[:2] ** 2, axis=0), kind="stable")[:count]
        half = np.arange(len(self.x)) < self.halves[0].stop
        return _Anchors.of(self.x[chosen], self.y[chosen], self.rows[:, chosen], half[chosen])

    def seen(self, grey: GreyImage, shift: Array) -> Array:
        """Grey levels of a frame at the anchors moved by `shift` [px]."""
        if not shift.any():
            return grey[self.y, self.x].astype(np.float64)
        x, y = shift.tolist()
        across, down = math.floor(x), math.floor(y)
        u, v = x - across, y - down
        left, top = self.x + across, self.y + down
        if not -BORDER <= min(across, down) <= max(across, down) < BORDER - 1:
            height, width = grey.shape
            left, top = np.clip(left, 0, width - 2), np.clip(top, 0, height - 2)
        if u == v == 0:
            return np.asarray(grey[top, left], dtype=np.float64)
        right, below = left + 1, top + 1
        upper, lower = (grey[row, left] * (1 - u) + grey[row, right] * u for row in (top, below))
        return np.asarray(upper * (1 - v) + lower * v)


@dataclass(frozen=True)
class Scene:
    """What a clip shows without the bead."""

    picture: FloatImage  # [grey levels], shape (height, width)
    noise: FloatImage  # [grey levels], one standard deviation of every pixel over time, same shape
    moving: Mask | None = None  # pixels that something passes over, by which no frame is laid, same shape

    @cached_property
    def usual_noise(self) -> float:
        """[grey levels], of most pixels"""
        return float(np.median(self.noise[::8, ::8]))

    @cached_property
    def camera_noise(self) -> FloatImage:
        """[grey levels], the noise, but where a bead stays for a third of the clip and the spread is mostly its own."""
        return np.minimum(self.noise, np.float32(MOST_UNUSUAL * self.usual_noise))

    def view(self, grey: GreyImage, start: tuple[float, float] = (0.0, 0.0)) -> View:
        """A frame laid over the scene: moved back by the camera's shake, levelled to the scene's brightness.

        `start` is a guess of the shake, e.g. that of the frame before.
        """
        pose = self.pose(grey, start)
        return View(pose.seen(grey), pose)

    def pose(self, grey: GreyImage, start: tuple[float, float] = (0.0, 0.0)) -> Pose:
        """Where a frame lies; `start` is a guess of its shake."""
        if not self.textured:
            return LOST
        near = _worth_moving(start)
        pose = self._placed(grey, near, self._anchors)
        if pose is None or not self._sharp(grey, pose):
            guess = Pose((float(near[0]), float(near[1])), misfit=self._misfit(grey, near))
            pose = self._placed_from_afar(grey, guess, pose)
        return self._levelled(grey, pose)

    def next_pose(self, grey: GreyImage, before: Pose) -> Pose:
        """Likewise, quickly, of the frame after one that lies as `before`.

        By a quarter of the edges, which doubles the error of the shake.
        """
        if not self.textured:
            return LOST
        pose = self._placed(grey, _worth_moving(before.shake), self._few_anchors, to=STEADY)
        if pose is None:
            return self.pose(grey, before.shake)
        # what is left beside a place hardly changes from frame to frame
        pose = replace(pose, beside=before.beside * pose.gain / before.gain)
        if pose.misfit > AS_BEFORE * pose.beside:
            pose = replace(pose, beside=self._beside(grey, pose))
        if not self._sharp(grey, pose):
            return self.pose(grey, before.shake)
        return self._levelled(grey, pose)

    def _levelled(self, grey: GreyImage, pose: Pose) -> Pose:
        return pose if not pose.placed or abs(pose.gain - 1) < FLICKER else self._lit(grey, pose)

    def _placed_from_afar(self, grey: GreyImage, guess: Pose, fine: Pose | None) -> Pose:
        """Where a frame lies that the search from a guess did not place: there still, or far from it."""
        # a plate that turns pulls at a scene of few edges, which lies where it lay none the less
        if fine is None and self._sharp(grey, guess):
            return guess
        for rough in (self._by_phase(grey), self._by_likeness(grey)):
            # what both ways find is believed, however little stands out
            if fine is not None and math.dist(rough, fine.shake) < NEAR:
                return fine
            pose = self._placed(grey, rough, self._anchors)
            if pose is not None and self._sharp(grey, pose):
                return pose
        return replace(guess, placed=False)

    @cached_property
    def textured(self) -> bool:
        """Whether it has edges enough to lay a frame over it, and some that are clearer than frozen grain.

        A codec keeps what it made of the noise of a plain picture for many frames, and moves it where it likes.
        """
        if len(self._anchors.x) < FEWEST:
            return False
        return self._beside(rounded(self.picture), Pose(), self._strongest.best(FEWEST)) > GRAIN

    def _sharp(self, grey: GreyImage, pose: Pose) -> bool:
        """Whether the frame fits there and not some pixels beside: many wrong places fit somewhat."""
        if pose.misfit < SHARP * pose.gain * self._contrast:
            return True
        if 1.4826 * pose.misfit > AS_NOISE * self._noise_at_edges:
            return False
        return pose.misfit < 0.95 * (pose.beside or self._beside(grey, pose))

    def _misfit(self, grey: GreyImage, shift: Array, gain: float = 1.0, anchors: _Anchors | None = None) -> float:
        anchors = anchors or self._few_anchors
        return middle_of(np.abs(anchors.seen(grey, shift) + gain * anchors.rows[2]))

    def _beside(self, grey: GreyImage, pose: Pose, anchors: _Anchors | None = None) -> float:
        """What is left [grey levels] some pixels beside a pose, by `anchors`, the few where not given."""
        whole = np.round(pose.shake)
        steps = ((6, 2), (-2, 6), (-6, -2), (2, -6))
        return float(np.mean([self._misfit(grey, whole + step, pose.gain, anchors) for step in steps]))

    @cached_property
    def _contrast(self) -> float:
        """What the scene itself leaves [grey levels] some pixels beside its place."""
        return self._beside(rounded(self.picture), Pose())

    @cached_property
    def _noise_at_edges(self) -> float:
        return float(np.median(self.noise[self._few_anchors.y, self._few_anchors.x]))

    def _by_phase(self, grey: GreyImage) -> Array:
        """Shift of a frame [px] to about a pixel, however far: the phase correlation of small pictures."""
        small, window, step = self._small
        frame = cv2.resize(grey, (small.shape[1], small.shape[0]), interpolation=cv2.INTER_AREA).astype(np.float32)
        # OpenCV 5 lays the window over the pictures that it is given
        (x, y), _ = cv2.phaseCorrelate(small.copy(), frame, window)
        return np.array([x, y]) * step

    def _by_likeness(self, grey: GreyImage) -> Array:
        """The same from where it is most alike: of soft or few edges the phase tells too little."""
        small, _, step = self._small
        height, width = small.shape
        frame = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
        far = round(FAR * max(width, height))
        # the whole frame, for its middle may be plain
        wide = cv2.copyMakeBorder(small, far, far, far, far, cv2.BORDER_REPLICATE)
        likeness = cv2.matchTemplate(wide, frame, cv2.TM_CCOEFF_NORMED)
        _, _, _, (x, y) = cv2.minMaxLoc(likeness)
        return np.array([far - x, far - y]) * step

    @cached_property
    def _small(self) -> tuple[FloatImage, FloatImage, Array]:
        """The picture made small, a window that hides its borders, and the size of its pixels [px]."""
        height, width = self.picture.shape
        share = min(1.0, COARSE / max(height, width))
        size = (round(width * share), round(height * share))
        small = np.asarray(cv2.resize(self.picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        window = np.asarray(cv2.createHanningWindow(size, cv2.CV_32F), dtype=np.float32)
        return small, window, np.array([width / size[0], height / size[1]])

    def _lit(self, grey: GreyImage, pose: Pose) -> Pose:
        """Gain and offset of a flickering frame: black is not 0 in most videos, so a gain alone would not level it."""
        step = max(1, min(self.picture.shape) // 60)
        moved = replace(pose, gain=1.0).seen(grey) if max(map(abs, pose.shake)) > 1 else grey
        wanted, seen = (each[::step, ::step].ravel().astype(np.float64) for each in (self.picture, moved))
        gain, offset = pose.gain, 0.0
        for _ in range(5):
            error = seen - gain * wanted - offset
            spread = 1.4826 * float(np.median(np.abs(error - np.median(error)))) + 0.3
            weights = 1 / (1 + (error / (2 * spread)) ** 2) ** 2
            middle = float(np.average(wanted, weights=weights))
            power = float(np.average((wanted - middle) ** 2, weights=weights))
            if power < 20:  # [grey levels squared]: one even grey tells no gain from an offset
                offset = float(np.average(seen - gain * wanted, weights=weights))
                break
            gain = float(np.average((wanted - middle) * seen, weights=weights)) / power
            offset = float(np.average(seen - gain * wanted, weights=weights))
        return replace(pose, gain=gain, offset=offset) if 0.5 < gain < 2 else replace(LOST, shake=pose.shake)

    @cached_property
    def _edges(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Array, Mask]:
        """Columns and rows of the strongest edges, what `_Anchors` knows of them, and in which half each lies."""
        smooth = cv2.GaussianBlur(self.picture, (0, 0), 1.0)
        slope_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)
        slope_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
        strength = np.hypot(slope_x, slope_y) / (self.noise + 0.5)
        if self.moving is not None:
            strength[self.moving] = 0
        strength[:BORDER] = strength[-BORDER:] = 0
        strength[:, :BORDER] = strength[:, -BORDER:] = 0
        chosen, half = [], []
        for i, rows in enumerate(np.array_split(np.arange(strength.shape[0]), 6)):
            for j, columns in enumerate(np.array_split(np.arange(strength.shape[1]), 6)):
                block = strength[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
                few = min(100, block.size)
                best = np.argpartition(block, -few, axis=None)[-few:]
                best = best[np.argsort(block.ravel()[best])]
                y, x = np.unravel_index(best[block.ravel()[best] > 0.5], block.shape)
                chosen.append(np.stack([x + columns[0], y + rows[0]]))
                half.append(np.full(len(x), (i + j) % 2 == 0))
        x, y = np.concatenate(chosen, axis=1)
        slopes = np.stack([slope_x[y, x], slope_y[y, x], -self.picture[y, x]]).astype(np.float64)
        return x, y, slopes, np.concatenate(half)

    @cached_property
    def _anchors(self) -> _Anchors:
        return _Anchors.of(*self._edges)

    @cached_property
    def _few_anchors(self) -> _Anchors:
        x, y, rows, half = self._edges
        return _Anchors.of(x[::4], y[::4], rows[:, ::4], half[::4])

    @cached_property
    def _strongest(self) -> _Anchors:
        return self._anchors.best(STRONGEST)

    def at_strongest(self, grey: GreyImage, pose: Pose) -> FloatImage:
        """What a frame leaves of the scene's strongest edges [grey levels]."""
        anchors = self._strongest
        error = anchors.seen(grey, np.array(pose.shake)) - pose.offset + pose.gain * anchors.rows[2]
        return np.asarray(error, dtype=np.float32)

    def with_strongest(self, poses: Sequence[Pose], left: Sequence[FloatImage]) -> list[Pose]:
        """With how far the strongest edges lie off it: where a camera shakes, a coarse codec redraws them alone.

        `left` is what each frame leaves `at_strongest`.  Across the edges only: along them nothing is seen.
        """
        slopes = self._strongest.rows[:2]
        if slopes.shape[1] < FEWEST:
            return list(poses)
        off = np.zeros((len(poses), 2))
        for first in range(0, len(poses), AT_ONCE):
            error = np.array(left[first : first + AT_ONCE], dtype=np.float64)
            half = error.shape[1] // 2
            spread = 1.4826 * np.partition(np.abs(error), half, axis=1)[:, half, None] + 0.3
            weighted = slopes * (1 / (1 + (error / (2 * spread)) ** 2) ** 2)[:, None]
            equations = weighted @ slopes.T
            equations += 0.1 * np.trace(equations, axis1=1, axis2=2)[:, None, None] * np.eye(2)
            off[first : first + AT_ONCE] = -np.linalg.solve(equations, weighted @ error[..., None])[..., 0]
        return [
            replace(pose, strongest_off=(x, y)) if pose.placed else pose
            for pose, (x, y) in zip(poses, off.tolist(), strict=True)
        ]

    def _placed(self, grey: GreyImage, start: Array, anchors: _Anchors, to: float = 0.003) -> Pose | None:
        """Shift of a frame against the scene [px] and its gain, by Gauss-Newton on the strongest edges.

        Steps shorter than `to` [px] are the last; None where they do not come to an end, or tell too little.
        """
        if len(anchors.x) < FEWEST:
            return None
        rows = anchors.rows
        shift, gain = start, 1.0
        for _ in range(8):
            error = anchors.seen(grey, shift) + gain * rows[2]
            misfit = middle_of(np.abs(error))
            spread = 1.4826 * misfit + 0.3
            weights = 1 / (1 + (error / (2 * spread)) ** 2) ** 2  # a moving bead or hand must not pull the scene along
            weighted, both = rows * weights, np.concatenate([rows, error[None]])
            one, other = (weighted[:, half] @ both[:, half].T for half in anchors.halves)
            equations = np.stack([one + other, one, other])  # of all anchors, and of each half alone
            inverses = _inverses(equations[:, :, :3])
            changes = -(inverses @ equations[:, :, 3:])[:, :, 0]
            across, down, brighter = changes[0].tolist()
            shift = shift + np.array([min(max(across, -3.0), 3.0), min(max(down, -3.0), 3.0)])
            gain += brighter
            if max(abs(across), abs(down)) < to:
                break
        worst = max(inverses[0, 0, 0], inverses[0, 1, 1]) * spread**2
        if worst > 0.05**2 or max(abs(across), abs(down)) > STEADY:
            return None  # too little texture to tell, or too far away
        x, y = shift.tolist()
        if max(abs(x), abs(y)) > max(FAR * max(grey.shape), 40) or not 0.5 < gain < 2:
            return None
        doubt = np.abs(changes[1] - changes[2]) / 2
        return Pose((x, y), gain, 0.0, (float(doubt[0]), float(doubt[1])), misfit)


def _inverses(normals: Array) -> Array:
    """Of small matrices, shape (n, 3, 3); of singular ones large."""
    traces = np.einsum("kii->k", normals)
    return np.asarray(np.linalg.inv(normals + (1e-12 * traces)[:, None, None] * np.eye(3) + 1e-300))


@dataclass(frozen=True)
class View:
    """One frame laid over the scene."""

    grey: FloatImage  # [grey levels], shape (height, width), in the scene's pixels
    pose: Pose

    @property
    def shake(self) -> tuple[float, float]:
        """[px], where the scene's origin lies in the frame"""
        return self.pose.shake


class Background:
    """Learns the still scene from frames spread over a clip; keeps at most `capacity` of them.

    The scene is the median over time, so whatever covers a pixel for less than half of the frames is not in it.
    `scene` can leave out the surroundings of a bead whose place in those frames is known: then even the scene behind a
    bead that rested for most of the clip is found.
    """

    capacity = 21

    def __init__(self) -> None:
        self._frames: dict[int, GreyImage] = {}

    def add(self, index: int, grey: GreyImage) -> None:
        """Remember a frame; every second one is dropped again when there are too many."""
        self._frames[index] = grey
        if len(self._frames) > self.capacity:
            for old in sorted(self._frames)[1::2]:
                del self._frames[old]

    @property
    def indices(self) -> tuple[int, ...]:
        """Frame numbers kept."""
        return tuple(sorted(self._frames))

    def samples(self) -> dict[int, GreyImage]:
        """The frames kept, by frame number."""
        return dict(self._frames)

    def scene(
        self,
        bead: Mapping[int, tuple[float, float]] | None = None,
        reach: float = 0.0,
        *,
        laid_over: bool = False,
    ) -> Scene:
        """The still scene; `bead` maps frame numbers to bead centres [px], `reach` [px] is how far it may cover.

        `laid_over`: the frames lie over each other and are levelled already.
        """
        indices, layers = self.indices, [self._frames[index] for index in self.indices]
        scene = _median_scene(layers)
        if laid_over:
            return scene if not bead else _without_bead(scene, layers, indices, bead, reach)
        poses = [scene.pose(layer) for layer in layers]
        if _shaken_far(poses):
            # the median of frames that lie apart shows nothing well: start from one of them
            scene, indices, layers, poses = _of_those_that_fit(scene, indices, layers)
        if not stands_still(poses) or np.std([pose.gain for pose in poses]) > FLICKER:
            for _ in range(2):
                scene = _median_scene(_laid_over(scene, layers))
            layers = _laid_over(scene, layers)
        return scene if not bead else _without_bead(scene, layers, indices, bead, reach)


def _shaken_far(poses: Sequence[Pose]) -> bool:
    return any(not pose.placed for pose in poses) or float(np.ptp(shakes_of(poses), axis=0).max()) > NEAR


def _of_those_that_fit(
    scene: Scene, indices: tuple[int, ...], layers: list[GreyImage]
) -> tuple[Scene, tuple[int, ...], list[GreyImage], list[Pose]]:
    """A sharper scene of the frames that lie over the middle one, these frames and how they lie.

    Where most do not, all is as it was.
    """
    middle = layers[len(layers) // 2]
    # the spread over time is the shake's, not the noise's
    grain = 1.4826 * float(np.mean(cv2.absdiff(middle, cv2.medianBlur(middle, 3)))) + 0.3
    one = Scene(middle.astype(np.float32), np.full(middle.shape, grain, dtype=np.float32))
    poses = [one.pose(layer) for layer in layers]
    kept = [k for k, pose in enumerate(poses) if pose.placed]
    if 2 * len(kept) <= len(layers):
        return scene, indices, layers, [scene.pose(layer) for layer in layers]
    # the camera's usual place is the scene's
    x, y = np.median(shakes_of([poses[k] for k in kept]), axis=0).tolist()
    moved = [replace(poses[k], shake=(poses[k].shake[0] - x, poses[k].shake[1] - y)) for k in kept]
    chosen = [layers[k] for k in kept]
    laid = [rounded(pose.seen(layer)) for pose, layer in zip(moved, chosen, strict=True)]
    sharper = _median_scene(laid)
    return sharper, tuple(indices[k] for k in kept), chosen, [sharper.pose(layer) for layer in chosen]


def _laid_over(scene: Scene, layers: Sequence[GreyImage]) -> list[GreyImage]:
    """The frames moved and levelled as the scene is, each rounded at once: as floats they would fill the memory."""
    return [rounded(scene.pose(layer).seen(layer)) for layer in layers]


def rounded(picture: FloatImage) -> GreyImage:
    """In whole grey levels."""
    return np.asarray(cv2.convertScaleAbs(np.maximum(picture, 0)), dtype=np.uint8)


def _median_scene(layers: Sequence[GreyImage]) -> Scene:
    ordered = _sorted(layers)
    middle: FloatImage = _twice_the_middle(ordered).astype(np.float32) / np.float32(2)
    low, high = (ordered[round(share * (len(ordered) - 1))] for share in (0.16, 0.84))
    # 8-bit steps make the spread of one pixel coarse: share it with its neighbours
    noise = cv2.blur((high.astype(np.float32) - low) / 2, (5, 5)) + np.float32(0.3)
    usual = float(np.median(noise))
    return Scene(middle, np.asarray(np.clip(noise, 0.5 * usual, 4 * usual), dtype=np.float32))


def middle_picture(layers: Sequence[GreyImage]) -> GreyImage:
    """Median over time of grey or coloured frames, in whole grey levels."""
    return np.asarray(_twice_the_middle(_sorted(layers)) // 2, dtype=np.uint8)


def _twice_the_middle(ordered: Sequence[GreyImage]) -> npt.NDArray[np.uint16]:
    """The two middle ones of an even number of sorted layers added up, or twice the one of an odd number."""
    return ordered[(len(ordered) - 1) // 2].astype(np.uint16) + ordered[len(ordered) // 2]


def _sorted(layers: Sequence[GreyImage]) -> list[GreyImage]:
    """The layers sorted pixel by pixel: Batcher's odd-even merging, a few times faster than sorting each pixel."""
    rows = [np.asarray(layer) for layer in layers]
    for low, high in _exchanges(len(rows)):
        smaller = np.minimum(rows[low], rows[high])
        rows[high] = np.maximum(rows[low], rows[high])
        rows[low] = smaller
    return rows


@lru_cache
def _exchanges(count: int) -> tuple[tuple[int, int], ...]:
    """Pairs to put in order, one after the other, that sort any `count` values (Batcher 1968)."""
    pairs = []
    size = 1
    while size < count:
        step = size
        while step >= 1:
            for first in range(step % size, count - step, 2 * step):
                for low in range(first, min(first + step, count - step)):
                    if low // (2 * size) == (low + step) // (2 * size):
                        pairs.append((low, low + step))
            step //= 2
        size *= 2
    return tuple(pairs)


def _without_bead(
    scene: Scene,
    layers: Sequence[GreyImage],
    indices: tuple[int, ...],
    bead: Mapping[int, tuple[float, float]],
    reach: float,
) -> Scene:
    """Median over those frames only in which the bead is away from the pixel, where there are any."""
    picture = scene.picture.copy()
    touched = np.zeros(picture.shape, dtype=np.uint8)
    for index in indices:
        if index in bead:
            _cover(touched, bead[index], reach)
    y, x = np.nonzero(touched)
    values = np.array([layer[y, x] for layer in layers], dtype=np.float32)
    for layer, index in enumerate(indices):
        if index in bead:
            covered = np.zeros(picture.shape, dtype=np.uint8)
            _cover(covered, bead[index], reach)
            values[layer, covered[y, x] > 0] = np.nan
    enough = np.sum(np.isfinite(values), axis=0) >= 2
    picture[y[enough], x[enough]] = np.nanmedian(values[:, enough], axis=0)
    return Scene(picture, scene.noise)


def _cover(mask: GreyImage, place: tuple[float, float], reach: float) -> None:
    cv2.circle(mask, (round(place[0]), round(place[1])), math.ceil(reach), 1, cv2.FILLED)
