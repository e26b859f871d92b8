"""Detect moving objects: connected areas (spots) of a frame that differ from the static background."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import FloatImage, GreyImage
from rigtwin.measure.media.duplicate_frames import COARSE, LARGE, Repeats, coarse
from rigtwin.measure.media.video import Frame
from rigtwin.measure.scene.pose import FLICKER, STEADY, Pose, rounded
from rigtwin.measure.scene.scene import Scene

Region = tuple[float, float, float, float]

Box = tuple[int, int, int, int]
"""Left, top, right and bottom [px]."""

MOST_COMPRESSED = 2.0  # [grey levels], largest scatter attributed to compression; more counts as motion


@dataclass(frozen=True)
class Spot:
    """A connected area of a frame that differs from the background."""

    x: float  # [px]
    y: float  # [px]
    area: float  # [px^2]
    width: float  # [px]
    height: float  # [px]
    contrast: float  # [grey levels], mean absolute difference


def moving_spots(seen: FloatImage, scene: Scene, region: Region | None, *, most: int = 12) -> list[Spot]:
    """Find spots of a frame that differ from the background by more than the noise.

    Parameters
    ----------
    seen : array, shape (height, width)
        Frame registered to the background [grey levels].
    scene : Scene
        Static background with its noise.
    region : tuple of float, optional
        x, y, width, height [px] of the searched part; None: the whole frame.
    most : int, optional
        Largest number of spots returned.

    Returns
    -------
    list of Spot
        Sorted by area times contrast, largest first. Spots below 6 px^2 are dropped.

    Notes
    -----
    A pixel differs if its absolute difference to the background, averaged over 3 x 3 pixels, exceeds
    6 k sigma + 1.5 grey levels. sigma is the camera noise of the pixel; k is the scatter of the averaged differences
    in units of the noise, estimated from the frame itself.
    """
    difference = np.abs(cv2.blur(seen - scene.picture, (3, 3)))
    # compression and demosaicing correlate neighbouring pixels: estimate the averaged noise from the frame itself
    left = _noise_left((difference / scene.noise)[::3, ::3], scene)
    mask = _outstanding(difference, scene.camera_noise, left)
    if region is not None:
        mask &= inside_region(region, mask.shape)
    return _strongest(_spots(difference, mask, (0, 0), 4 * most), most)


def _outstanding(difference: FloatImage, noise: FloatImage, left: float) -> GreyImage:
    return np.asarray(difference > np.float32(6 * left) * noise + np.float32(1.5), dtype=np.uint8)


def inside_region(region: Region, shape: tuple[int, ...]) -> GreyImage:
    """Mask of the region, shape `shape`; the region may extend beyond the picture."""
    x, y, width, height = (round(side) for side in region)
    inside = np.zeros(shape, dtype=np.uint8)
    inside[max(y, 0) : y + height, max(x, 0) : x + width] = 1
    return inside


def _spots(difference: FloatImage, mask: GreyImage, corner: tuple[int, int], most: int) -> list[Spot]:
    """The largest spots of a mask; `corner` is the picture position of its top-left pixel."""
    count, labels, stats, centres = cv2.connectedComponentsWithStats(mask, connectivity=8)
    spots = []
    for k in 1 + np.argsort(-stats[1:count, cv2.CC_STAT_AREA])[:most]:
        left, top, width, height, area = (int(value) for value in stats[k])
        if area < 6:
            continue
        box = np.s_[top : top + height, left : left + width]
        contrast = float(np.mean(difference[box][labels[box] == k]))
        x, y = float(centres[k][0]) + corner[0], float(centres[k][1]) + corner[1]
        spots.append(Spot(x, y, area, width, height, contrast))
    return spots


def _strongest(spots: list[Spot], most: int) -> list[Spot]:
    return sorted(spots, key=lambda spot: -spot.area * spot.contrast)[:most]


class Search:
    """Detect moving spots frame by frame; large frames are searched only where a downsampled picture has changed."""

    def __init__(self, scene: Scene, region: Region | None) -> None:
        self.scene, self.region, self.repeats = scene, region, Repeats()
        self.poses: list[Pose] = []
        self._at_strongest: list[FloatImage] = []
        height, width = scene.picture.shape
        self._large = height * width > LARGE
        if self._large:
            size = (width // COARSE, height // COARSE)
            self._coarse = coarse(rounded(scene.picture))
            noise = cv2.resize(scene.noise, size, interpolation=cv2.INTER_AREA)
            # residuals of the registration at edges
            edges = cv2.morphologyEx(self._coarse, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
            # limit per cell: a bead covers whole cells, and noise averages out within them
            self._least = np.clip(np.ceil(noise + 2 + 0.05 * edges), 3, 255).astype(np.uint8)
            self._inside = None if region is None else coarse(255 * inside_region(region, (height, width)))
            self._left = 1.0  # scatter of 3 x 3 averages in units of the noise
            self._strips = np.linspace(0, height - 3, 12).astype(int)

    def spots(self, frame: Frame, most: int = 12) -> list[Spot]:
        """The spots of the next frame, strongest first."""
        small = coarse(frame.grey)
        self.repeats.add(frame.index, small)
        before = self.poses[-1] if self.poses else Pose()
        pose = self.scene.next_pose(frame.grey, before) if self._large else self.scene.pose(frame.grey, before.shake)
        self.poses.append(pose)
        self._at_strongest.append(self.scene.at_strongest(frame.grey, pose))
        windows = self._windows(small, pose) if self._large else None
        if windows is not None:
            return self._in_windows(frame.grey, pose, windows, most)
        return moving_spots(pose.seen(frame.grey), self.scene, self.region, most=most)

    def all_poses(self) -> list[Pose]:
        """Poses of all frames, with `strongest_off`."""
        return self.scene.with_strongest(self.poses, self._at_strongest)

    def _windows(self, small: GreyImage, pose: Pose) -> list[Box] | None:
        """Boxes that have changed; None if they cover much of the picture."""
        x, y = pose.shake[0] / COARSE, pose.shake[1] / COARSE
        if max(abs(x), abs(y)) > STEADY:
            height, width = small.shape
            small = np.asarray(cv2.getRectSubPix(small, (width, height), ((width - 1) / 2 + x, (height - 1) / 2 + y)))
        if abs(pose.gain - 1) >= FLICKER:
            small = np.asarray(cv2.convertScaleAbs(small, alpha=1 / pose.gain, beta=-pose.offset / pose.gain))
        changed = cv2.compare(cv2.absdiff(small, self._coarse), self._least, cv2.CMP_GT)
        if self._inside is not None:
            changed = cv2.bitwise_and(changed, self._inside)
        left, top, width, height = cv2.boundingRect(changed)
        if width == 0:
            return []
        left, top = max(left - 2, 0), max(top - 2, 0)
        around = cv2.dilate(changed[top : top + height + 4, left : left + width + 4], np.ones((5, 5), np.uint8))
        boxes = _boxes_apart(np.asarray(around, dtype=np.uint8))
        if len(boxes) > 200 or sum(wide * high for _, _, wide, high in boxes) > 0.2 * small.size:
            return None
        corners = [(left + x, top + y, left + x + wide, top + y + high) for x, y, wide, high in boxes]
        return [(COARSE * x, COARSE * y, COARSE * right, COARSE * bottom) for x, y, right, bottom in corners]

    def _in_windows(self, grey: GreyImage, pose: Pose, windows: list[Box], most: int) -> list[Spot]:
        scene = self.scene
        if len(self.poses) % 8 == 1:
            self._left = self._noise_left(grey, pose)
        spots = []
        for box in windows:
            window = np.s_[box[1] : box[3], box[0] : box[2]]
            difference = np.abs(cv2.blur(pose.seen(grey, box) - scene.picture[window], (3, 3)))
            mask = _outstanding(difference, scene.camera_noise[window], self._left)
            spots += _spots(difference, mask, box[:2], 4 * most)
        return _strongest(spots, most)

    def _noise_left(self, grey: GreyImage, pose: Pose) -> float:
        """The noise factor of `moving_spots`, from a few rows of the frame."""
        scene, width = self.scene, grey.shape[1]
        strips = [(row, row + 3) for row in self._strips.tolist()]
        seen = np.concatenate([pose.seen(grey, (0, top, width, end)) for top, end in strips])
        usual = np.concatenate([scene.picture[top:end] for top, end in strips])
        # the middle row of each strip; its neighbours belong to the same strip
        difference = cv2.blur(seen - usual, (3, 3))[1::3, ::3]
        return _noise_left(difference / scene.noise[self._strips + 1, ::3], scene)


def _noise_left(ratios: npt.NDArray[np.floating], scene: Scene) -> float:
    """Robust scatter of differences in units of the noise: from the median, or from the 95th percentile if larger.

    Strong compression repeats most of a picture and changes the rest by several grey levels. The percentile is limited
    by `MOST_COMPRESSED`, so that motion does not count.
    """
    flat = np.abs(ratios).ravel()
    middle, far = round(0.5 * (len(flat) - 1)), round(0.95 * (len(flat) - 1))
    ordered = np.partition(flat, (middle, far))
    widest = min(float(ordered[far]) / 1.96, MOST_COMPRESSED / scene.usual_noise)
    return max(float(ordered[middle]) / 0.6745, widest)


def _boxes_apart(mask: GreyImage) -> list[Box]:
    """Bounding boxes (left, top, width, height) of all parts of a mask; overlapping ones are merged."""
    count = 0
    while True:
        found, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        boxes: list[Box] = [(int(x), int(y), int(w), int(h)) for x, y, w, h in stats[1:found, :4]]
        if len(boxes) in (1, count) or len(boxes) > 200:
            return boxes
        count = len(boxes)
        for x, y, wide, high in boxes:
            mask[y : y + high, x : x + wide] = 255
