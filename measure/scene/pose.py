from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, FloatImage, GreyImage

STEADY = 0.03  # [px], a shake that moving the picture back would blur more than it helps

NEAR = 1.5  # [px], within which a coarse and a fine look at a shake agree

FLICKER = 0.01  # relative change of brightness above which a frame is levelled with an offset as well


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


def worth_moving(shake: tuple[float, float]) -> Array:
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
class View:
    """One frame laid over the scene."""

    grey: FloatImage  # [grey levels], shape (height, width), in the scene's pixels
    pose: Pose

    @property
    def shake(self) -> tuple[float, float]:
        """[px], where the scene's origin lies in the frame"""
        return self.pose.shake


def rounded(picture: FloatImage) -> GreyImage:
    """In whole grey levels."""
    return np.asarray(cv2.convertScaleAbs(np.maximum(picture, 0)), dtype=np.uint8)
