"""Position and brightness of a frame relative to the static background (camera shake, flicker)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, FloatImage, GreyImage
from rigtwin.lab.camera import Point

STEADY = 0.03  # [px], smaller shakes are not removed: interpolation would blur the picture more than it helps

NEAR = 1.5  # [px], tolerance between the coarse and the fine estimate of a shake

FLICKER = 0.01  # relative brightness change above which an offset is fitted as well as a gain


@dataclass(frozen=True)
class Pose:
    """Shift and brightness of a frame relative to the background."""

    shake: tuple[float, float] = (0.0, 0.0)  # [px], position of the background's origin in the frame
    gain: float = 1.0
    offset: float = 0.0  # [grey levels]
    # [px], uncertainty of the shake: half the difference between the results of two halves of the background
    uncertainty: tuple[float, float] = (0.0, 0.0)
    misfit: float = math.inf  # [grey levels], median absolute residual at the background's edges
    placed: bool = True  # False: the registration failed and the shake is only a guess
    beside: float = 0.0  # [grey levels], the same residual some pixels away from the found shift; 0: not computed
    strongest_off: tuple[float, float] = (0.0, 0.0)  # [px], shift of the strongest edges relative to `shake`

    def seen(self, grey: GreyImage, box: tuple[int, int, int, int] | None = None) -> FloatImage:
        """Part of the frame in the background's pixels and brightness.

        `box` is left, top, right, bottom [px]; None: the whole frame.
        """
        left, top, right, bottom = box or (0, 0, grey.shape[1], grey.shape[0])
        if max(map(abs, self.shake)) > STEADY:
            x, y = (first + (end - 1 - first) / 2 for first, end in ((left, right), (top, bottom)))
            # getRectSubPix shifts exactly; cv2.warpAffine rounds to 1/32 px
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

    def in_frame(self, place: Point) -> Point:
        """Where a place of the background is in the frame [px]."""
        return float(place[0] + self.shake[0]), float(place[1] + self.shake[1])

    def in_background(self, place: Point) -> Point:
        """Where a place of the frame is in the background [px]."""
        return float(place[0] - self.shake[0]), float(place[1] - self.shake[1])

    def standing(self) -> Pose:
        """The same pose for a camera known to be static."""
        return replace(self, shake=(0.0, 0.0), uncertainty=(0.0, 0.0))


LOST = Pose(placed=False)


def worth_moving(shake: tuple[float, float]) -> Array:
    return np.array(shake) if max(map(abs, shake)) > STEADY else np.zeros(2)


def shakes_of(poses: Sequence[Pose]) -> Array:
    """[px], shape (n, 2)"""
    return np.array([pose.shake for pose in poses]).reshape(-1, 2)


def stands_still(poses: Sequence[Pose]) -> bool:
    """Whether the shake does not exceed its own uncertainty; removing it would only add this error to all positions."""
    poses = [pose for pose in poses if pose.placed]
    if not poses:
        return True
    shakes, uncertainties = shakes_of(poses), np.array([pose.uncertainty for pose in poses]).reshape(-1, 2)
    found = np.mean((shakes - np.median(shakes, axis=0)) ** 2, axis=0)
    return bool(np.all(found < np.maximum(2 * np.mean(uncertainties**2, axis=0), STEADY**2)))


@dataclass(frozen=True)
class View:
    """One frame registered to the background."""

    grey: FloatImage  # [grey levels], shape (height, width), in the background's pixels
    pose: Pose

    @property
    def shake(self) -> tuple[float, float]:
        """[px], position of the background's origin in the frame."""
        return self.pose.shake


def rounded(picture: FloatImage) -> GreyImage:
    """The picture rounded to whole grey levels."""
    return np.asarray(cv2.convertScaleAbs(np.maximum(picture, 0)), dtype=np.uint8)
