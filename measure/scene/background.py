"""Learn the static background of a clip as the median over frames spread in time."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import FloatImage, GreyImage
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.robust import MAD_TO_STD
from rigtwin.measure.scene.pose import FLICKER, NEAR, Pose, rounded, shakes_of, stands_still
from rigtwin.measure.scene.scene import Scene


def learn_scene(video: Video, *, quickly: bool = False) -> Background:
    """Background from frames spread evenly over the clip; `quickly`: prefer frames that decode fast (keyframes)."""
    background = Background()
    for frame in video.single(video.spread(Background.capacity, quickly=quickly)):
        background.add(frame.index, frame.grey)
    return background


def frames_of(video: Video, indices: Collection[int]) -> list[Frame]:
    """The frames with these indices; nothing before the first or after the last of them is read."""
    return [frame for frame in video.frames(min(indices), max(indices)) if frame.index in indices]


class Background:
    """Learns the static background from frames spread over a clip; keeps at most `capacity` of them.

    The background is the median over time, so it does not contain what covers a pixel in less than half of the frames.
    `scene` can exclude the surroundings of a bead with known positions. This recovers the background even behind a
    bead that rested for most of the clip.
    """

    capacity = 21

    def __init__(self) -> None:
        self._frames: dict[int, GreyImage] = {}

    def add(self, index: int, grey: GreyImage) -> None:
        """Keep a frame; if there are more than `capacity`, drop every second one."""
        self._frames[index] = grey
        if len(self._frames) > self.capacity:
            for old in sorted(self._frames)[1::2]:
                del self._frames[old]

    @property
    def indices(self) -> tuple[int, ...]:
        """Indices of the frames kept."""
        return tuple(sorted(self._frames))

    def samples(self) -> dict[int, GreyImage]:
        """The frames kept, by frame index."""
        return dict(self._frames)

    def scene(
        self,
        bead: Mapping[int, tuple[float, float]] | None = None,
        reach: float = 0.0,
        *,
        laid_over: bool = False,
    ) -> Scene:
        """The static background; `bead` maps frame indices to bead centres [px], `reach` is the covered radius [px].

        `laid_over`: the frames are already registered and have equal brightness.
        """
        indices, layers = self.indices, [self._frames[index] for index in self.indices]
        scene = _median_scene(layers)
        if laid_over:
            return scene if not bead else _without_bead(scene, layers, indices, bead, reach)
        poses = [scene.pose(layer) for layer in layers]
        if _shaken_far(poses):
            # the median of badly registered frames is blurred: register against a single frame first
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
    """A sharper background from the frames that register to the middle one, with these frames and their poses.

    If at most half of the frames register, the background and the frames are returned unchanged.
    """
    middle = layers[len(layers) // 2]
    # the spread over time is due to camera shake here: estimate the noise within one frame
    grain = MAD_TO_STD * float(np.mean(cv2.absdiff(middle, cv2.medianBlur(middle, 3)))) + 0.3
    one = Scene(middle.astype(np.float32), np.full(middle.shape, grain, dtype=np.float32))
    poses = [one.pose(layer) for layer in layers]
    kept = [k for k, pose in enumerate(poses) if pose.placed]
    if 2 * len(kept) <= len(layers):
        return scene, indices, layers, [scene.pose(layer) for layer in layers]
    # the median shake defines the origin of the background
    x, y = np.median(shakes_of([poses[k] for k in kept]), axis=0).tolist()
    moved = [replace(poses[k], shake=(poses[k].shake[0] - x, poses[k].shake[1] - y)) for k in kept]
    chosen = [layers[k] for k in kept]
    laid = [rounded(pose.seen(layer)) for pose, layer in zip(moved, chosen, strict=True)]
    sharper = _median_scene(laid)
    return sharper, tuple(indices[k] for k in kept), chosen, [sharper.pose(layer) for layer in chosen]


def _laid_over(scene: Scene, layers: Sequence[GreyImage]) -> list[GreyImage]:
    """The frames registered to the background, position and brightness; rounded at once to save memory."""
    return [rounded(scene.pose(layer).seen(layer)) for layer in layers]


def _median_scene(layers: Sequence[GreyImage]) -> Scene:
    ordered = _sorted(layers)
    middle: FloatImage = _twice_the_middle(ordered).astype(np.float32) / np.float32(2)
    low, high = (ordered[round(share * (len(ordered) - 1))] for share in (0.16, 0.84))
    # 8-bit quantisation makes the spread of a single pixel coarse: average over the neighbours
    noise = cv2.blur((high.astype(np.float32) - low) / 2, (5, 5)) + np.float32(0.3)
    usual = float(np.median(noise))
    return Scene(middle, np.asarray(np.clip(noise, 0.5 * usual, 4 * usual), dtype=np.float32))


def middle_picture(layers: Sequence[GreyImage]) -> GreyImage:
    """Median over time of grey or coloured frames, in whole grey levels."""
    return np.asarray(_twice_the_middle(_sorted(layers)) // 2, dtype=np.uint8)


def _twice_the_middle(ordered: Sequence[GreyImage]) -> npt.NDArray[np.uint16]:
    """Twice the median of sorted layers, an integer for both even and odd numbers of layers."""
    return ordered[(len(ordered) - 1) // 2].astype(np.uint16) + ordered[len(ordered) // 2]


def _sorted(layers: Sequence[GreyImage]) -> list[GreyImage]:
    """The layers sorted pixel by pixel by Batcher's odd-even merge sort; a few times faster than `np.sort`."""
    rows = [np.asarray(layer) for layer in layers]
    for low, high in _exchanges(len(rows)):
        smaller = np.minimum(rows[low], rows[high])
        rows[high] = np.maximum(rows[low], rows[high])
        rows[low] = smaller
    return rows


@lru_cache
def _exchanges(count: int) -> tuple[tuple[int, int], ...]:
    """Compare-exchange pairs, in order, that sort any `count` values (Batcher 1968)."""
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
    """Median over the frames in which the bead does not cover the pixel, if there are at least two."""
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
