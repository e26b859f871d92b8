"""The still scene of a clip: learnt from frames spread over it, and how a shaken, flickering frame lies over it.

Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, GreyImage, Mask
from rigtwin.measure.robust import middle_of
from rigtwin.measure.scene.pose import FLICKER, LOST, NEAR, STEADY, Pose, View, rounded, worth_moving

FAR = 0.12  # of the picture's longer side, up to which a shake is believed

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
        near = worth_moving(start)
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
        pose = self._placed(grey, worth_moving(before.shake), self._few_anchors, to=STEADY)
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
