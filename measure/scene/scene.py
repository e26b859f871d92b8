"""Static background of a clip, and registration of frames to it (camera shake, flicker).

Frames are registered by Gauss-Newton on the grey levels at strong edges of the background; phase correlation and
template matching find large shifts. Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
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
from rigtwin.measure.robust import MAD_TO_STD, mad_std, middle_of
from rigtwin.measure.scene.pose import FLICKER, LOST, NEAR, STEADY, Pose, View, rounded, worth_moving

FAR = 0.12  # of the picture's longer side, largest accepted shake

SHARP = 0.12  # largest residual of a correct registration, relative to the residual some pixels away from it

AS_BEFORE = 0.9  # the same limit relative to the residual beside the previous frame's position; above it, recompute

FEWEST = 60  # minimum number of edge pixels for a registration

# [grey levels], minimum residual of the strongest edges some pixels beside their position: noise frozen by a codec
# gives up to 5, real edges in recordings five times too dark give 8 and more
GRAIN = 6.0

MOST_UNUSUAL = 2.0  # largest camera noise relative to its median; bright pixels have more noise than dark ones

BORDER = 8  # [px], margin of the background without anchors

STRONGEST = 300  # number of pixels at the strongest edges

AT_ONCE = 256  # frames per batch, limits the memory

AS_NOISE = 2.0  # alternative limit of the residual, in units of the background's noise

COARSE = 480  # [px], longer side of the downsampled picture for the search of large shakes


@dataclass(frozen=True)
class _Anchors:
    """Pixels at strong edges, spread over the picture, used to register frames."""

    x: npt.NDArray[np.intp]
    y: npt.NDArray[np.intp]
    rows: Array  # slope in x, slope in y, minus the grey level; shape (3, n)
    halves: tuple[slice, slice]  # pixels in the two halves of a chequered partition of the picture

    @classmethod
    def of(cls, x: npt.NDArray[np.intp], y: npt.NDArray[np.intp], rows: Array, half: Mask) -> _Anchors:
        """`half` marks the pixels of the first half, shape (n,)."""
        order, first = np.argsort(~half, kind="stable"), int(np.sum(half))
        return cls(x[order], y[order], rows[:, order], (slice(first), slice(first, None)))

    def best(self, count: int) -> _Anchors:
        """The `count` anchors with the strongest edges."""
        chosen = np.argsort(-np.sum(self.rows[:2] ** 2, axis=0), kind="stable")[:count]
        half = np.arange(len(self.x)) < self.halves[0].stop
        return _Anchors.of(self.x[chosen], self.y[chosen], self.rows[:, chosen], half[chosen])

    def seen(self, grey: GreyImage, shift: Array) -> Array:
        """Grey levels of a frame at the anchors shifted by `shift` [px], bilinear, shape (n,)."""
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
    """Static background of a clip, without the moving objects."""

    picture: FloatImage  # [grey levels], shape (height, width)
    noise: FloatImage  # [grey levels], standard deviation over time of every pixel, same shape
    moving: Mask | None = None  # pixels that moving objects cover, excluded from the registration, same shape

    @cached_property
    def usual_noise(self) -> float:
        """[grey levels], median noise of the pixels."""
        return float(np.median(self.noise[::8, ::8]))

    @cached_property
    def camera_noise(self) -> FloatImage:
        """[grey levels], the noise with an upper limit: a bead at rest for a third of the clip inflates the spread."""
        return np.minimum(self.noise, np.float32(MOST_UNUSUAL * self.usual_noise))

    def view(self, grey: GreyImage, start: tuple[float, float] = (0.0, 0.0)) -> View:
        """A frame registered to the background: shake removed, brightness matched.

        `start` is a guess of the shake [px], e.g. that of the previous frame.
        """
        pose = self.pose(grey, start)
        return View(pose.seen(grey), pose)

    def pose(self, grey: GreyImage, start: tuple[float, float] = (0.0, 0.0)) -> Pose:
        """Pose of a frame; `start` is a guess of its shake [px]."""
        if not self.textured:
            return LOST
        near = worth_moving(start)
        pose = self._placed(grey, near, self._anchors)
        if pose is None or not self._sharp(grey, pose):
            guess = Pose((float(near[0]), float(near[1])), misfit=self._misfit(grey, near))
            pose = self._placed_from_afar(grey, guess, pose)
        return self._levelled(grey, pose)

    def next_pose(self, grey: GreyImage, before: Pose) -> Pose:
        """Pose of the frame after one with pose `before`; faster than `pose`.

        Uses a quarter of the anchors, which doubles the uncertainty of the shake.
        """
        if not self.textured:
            return LOST
        pose = self._placed(grey, worth_moving(before.shake), self._few_anchors, to=STEADY)
        if pose is None:
            return self.pose(grey, before.shake)
        # the residual beside the position hardly changes from frame to frame
        pose = replace(pose, beside=before.beside * pose.gain / before.gain)
        if pose.misfit > AS_BEFORE * pose.beside:
            pose = replace(pose, beside=self._beside(grey, pose))
        if not self._sharp(grey, pose):
            return self.pose(grey, before.shake)
        return self._levelled(grey, pose)

    def _levelled(self, grey: GreyImage, pose: Pose) -> Pose:
        return pose if not pose.placed or abs(pose.gain - 1) < FLICKER else self._lit(grey, pose)

    def _placed_from_afar(self, grey: GreyImage, guess: Pose, fine: Pose | None) -> Pose:
        """Pose of a frame that could not be registered from a guess: at the guess itself, or far away from it."""
        # a rotating plate can disturb the registration to a background with few edges although the camera is static
        if fine is None and self._sharp(grey, guess):
            return guess
        for rough in (self._by_phase(grey), self._by_likeness(grey)):
            # accepted if coarse and fine search agree, even at low contrast
            if fine is not None and math.dist(rough, fine.shake) < NEAR:
                return fine
            pose = self._placed(grey, rough, self._anchors)
            if pose is not None and self._sharp(grey, pose):
                return pose
        return replace(guess, placed=False)

    @cached_property
    def textured(self) -> bool:
        """Whether the background has enough edges for a registration, some of them clearer than frozen noise.

        In a uniform picture a codec freezes the noise for many frames and may shift it.
        """
        if len(self._anchors.x) < FEWEST:
            return False
        return self._beside(rounded(self.picture), Pose(), self._strongest.best(FEWEST)) > GRAIN

    def _sharp(self, grey: GreyImage, pose: Pose) -> bool:
        """Whether the frame fits there clearly better than some pixels beside; wrong positions may fit partly."""
        if pose.misfit < SHARP * pose.gain * self._contrast:
            return True
        if MAD_TO_STD * pose.misfit > AS_NOISE * self._noise_at_edges:
            return False
        return pose.misfit < 0.95 * (pose.beside or self._beside(grey, pose))

    def _misfit(self, grey: GreyImage, shift: Array, gain: float = 1.0, anchors: _Anchors | None = None) -> float:
        anchors = anchors or self._few_anchors
        return middle_of(np.abs(anchors.seen(grey, shift) + gain * anchors.rows[2]))

    def _beside(self, grey: GreyImage, pose: Pose, anchors: _Anchors | None = None) -> float:
        """Mean residual [grey levels] some pixels beside a pose, at `anchors` (default: a quarter of all)."""
        whole = np.round(pose.shake)
        steps = ((6, 2), (-2, 6), (-6, -2), (2, -6))
        return float(np.mean([self._misfit(grey, whole + step, pose.gain, anchors) for step in steps]))

    @cached_property
    def _contrast(self) -> float:
        """Residual [grey levels] of the background itself some pixels beside its position."""
        return self._beside(rounded(self.picture), Pose())

    @cached_property
    def _noise_at_edges(self) -> float:
        return float(np.median(self.noise[self._few_anchors.y, self._few_anchors.x]))

    def _by_phase(self, grey: GreyImage) -> Array:
        """Shift of a frame [px], accurate to about a pixel, any distance: phase correlation of downsampled pictures."""
        small, window, step = self._small
        frame = cv2.resize(grey, (small.shape[1], small.shape[0]), interpolation=cv2.INTER_AREA).astype(np.float32)
        # OpenCV 5 multiplies its input by the window in place
        (x, y), _ = cv2.phaseCorrelate(small.copy(), frame, window)
        return np.array([x, y]) * step

    def _by_likeness(self, grey: GreyImage) -> Array:
        """The same by template matching, for soft or few edges, where phase correlation is not reliable."""
        small, _, step = self._small
        height, width = small.shape
        frame = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
        far = round(FAR * max(width, height))
        # use the whole frame, because its centre may be uniform
        wide = cv2.copyMakeBorder(small, far, far, far, far, cv2.BORDER_REPLICATE)
        likeness = cv2.matchTemplate(wide, frame, cv2.TM_CCOEFF_NORMED)
        _, _, _, (x, y) = cv2.minMaxLoc(likeness)
        return np.array([far - x, far - y]) * step

    @cached_property
    def _small(self) -> tuple[FloatImage, FloatImage, Array]:
        """Downsampled picture, Hanning window, and size of its pixels [px], shape (2,)."""
        height, width = self.picture.shape
        share = min(1.0, COARSE / max(height, width))
        size = (round(width * share), round(height * share))
        small = np.asarray(cv2.resize(self.picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        window = np.asarray(cv2.createHanningWindow(size, cv2.CV_32F), dtype=np.float32)
        return small, window, np.array([width / size[0], height / size[1]])

    def _lit(self, grey: GreyImage, pose: Pose) -> Pose:
        """Gain and offset of a flickering frame; the offset is needed because black is not 0 in most videos."""
        step = max(1, min(self.picture.shape) // 60)
        moved = replace(pose, gain=1.0).seen(grey) if max(map(abs, pose.shake)) > 1 else grey
        wanted, seen = (each[::step, ::step].ravel().astype(np.float64) for each in (self.picture, moved))
        gain, offset = pose.gain, 0.0
        for _ in range(5):
            error = seen - gain * wanted - offset
            spread = mad_std(error) + 0.3
            weights = 1 / (1 + (error / (2 * spread)) ** 2) ** 2
            middle = float(np.average(wanted, weights=weights))
            power = float(np.average((wanted - middle) ** 2, weights=weights))
            if power < 20:  # [grey levels squared]; in a uniform picture gain and offset are not separable
                offset = float(np.average(seen - gain * wanted, weights=weights))
                break
            gain = float(np.average((wanted - middle) * seen, weights=weights)) / power
            offset = float(np.average(seen - gain * wanted, weights=weights))
        return replace(pose, gain=gain, offset=offset) if 0.5 < gain < 2 else replace(LOST, shake=pose.shake)

    @cached_property
    def _edges(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Array, Mask]:
        """Columns and rows of the strongest edges per block (6 x 6), `rows` of `_Anchors`, and marks of one half."""
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
        """Residual of a frame at the background's strongest edges [grey levels], shape (n,)."""
        anchors = self._strongest
        error = anchors.seen(grey, np.array(pose.shake)) - pose.offset + pose.gain * anchors.rows[2]
        return np.asarray(error, dtype=np.float32)

    def with_strongest(self, poses: Sequence[Pose], left: Sequence[FloatImage]) -> list[Pose]:
        """The poses with `strongest_off`: under camera shake a coarse codec updates only the strongest edges.

        `left` is the residual `at_strongest` of each frame. Only the shift across an edge is observable; the one along
        it is damped.
        """
        slopes = self._strongest.rows[:2]
        if slopes.shape[1] < FEWEST:
            return list(poses)
        off = np.zeros((len(poses), 2))
        for first in range(0, len(poses), AT_ONCE):
            error = np.array(left[first : first + AT_ONCE], dtype=np.float64)
            half = error.shape[1] // 2
            spread = MAD_TO_STD * np.partition(np.abs(error), half, axis=1)[:, half, None] + 0.3
            weighted = slopes * (1 / (1 + (error / (2 * spread)) ** 2) ** 2)[:, None]
            equations = weighted @ slopes.T
            equations += 0.1 * np.trace(equations, axis1=1, axis2=2)[:, None, None] * np.eye(2)
            off[first : first + AT_ONCE] = -np.linalg.solve(equations, weighted @ error[..., None])[..., 0]
        return [
            replace(pose, strongest_off=(x, y)) if pose.placed else pose
            for pose, (x, y) in zip(poses, off.tolist(), strict=True)
        ]

    def _placed(self, grey: GreyImage, start: Array, anchors: _Anchors, to: float = 0.003) -> Pose | None:
        """Shift of a frame relative to the background [px] and gain, by Gauss-Newton at the anchors.

        Stops at steps shorter than `to` [px]; None if it does not converge or the result is too uncertain.
        """
        if len(anchors.x) < FEWEST:
            return None
        rows = anchors.rows
        shift, gain = start, 1.0
        for _ in range(8):
            error = anchors.seen(grey, shift) + gain * rows[2]
            misfit = middle_of(np.abs(error))
            spread = MAD_TO_STD * misfit + 0.3
            weights = 1 / (1 + (error / (2 * spread)) ** 2) ** 2  # robust against a moving bead or hand
            weighted, both = rows * weights, np.concatenate([rows, error[None]])
            one, other = (weighted[:, half] @ both[:, half].T for half in anchors.halves)
            equations = np.stack([one + other, one, other])  # all anchors, first half, second half
            inverses = _inverses(equations[:, :, :3])
            changes = -(inverses @ equations[:, :, 3:])[:, :, 0]
            across, down, brighter = changes[0].tolist()
            shift = shift + np.array([min(max(across, -3.0), 3.0), min(max(down, -3.0), 3.0)])
            gain += brighter
            if max(abs(across), abs(down)) < to:
                break
        worst = max(inverses[0, 0, 0], inverses[0, 1, 1]) * spread**2
        if worst > 0.05**2 or max(abs(across), abs(down)) > STEADY:
            return None  # too little texture, or not converged
        x, y = shift.tolist()
        if max(abs(x), abs(y)) > max(FAR * max(grey.shape), 40) or not 0.5 < gain < 2:
            return None
        uncertainty = np.abs(changes[1] - changes[2]) / 2
        return Pose((x, y), gain, 0.0, (float(uncertainty[0]), float(uncertainty[1])), misfit)


def _inverses(normals: Array) -> Array:
    """Inverses of matrices, shape (n, 3, 3); regularised, so singular ones give large values."""
    traces = np.einsum("kii->k", normals)
    # without texture the traces are zero; 1e-30 is far below those of any picture, and its inverse does not overflow
    return np.asarray(np.linalg.inv(normals + (1e-12 * traces + 1e-30)[:, None, None] * np.eye(3)))
