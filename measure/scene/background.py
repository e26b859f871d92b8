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
from rigtwin.measure.scene.pose import FLICKER, NEAR, Pose, rounded, shakes_of, stands_still
from rigtwin.measure.scene.scene import Scene


def learn_scene(video: Video, *, quickly: bool = False) -> Background:
    """Background from frames spread evenly over the clip, of a long film such as are soon read where wanted."""
    background = Background()
    for frame in video.single(video.spread(Background.capacity, quickly=quickly)):
        background.add(frame.index, frame.grey)
    return background


def frames_of(video: Video, indices: Collection[int]) -> list[Frame]:
    """Some frames of a video; what lies before the first and behind the last of them is not read."""
    return [frame for frame in video.frames(min(indices), max(indices)) if frame.index in indices]


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
