"""Frames registered to the static background: cropped, downsampled, without camera shake and flicker."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.measure.media.video import Video
from rigtwin.measure.scene.background import Background
from rigtwin.measure.scene.pose import Pose
from rigtwin.measure.scene.scene import Scene

Region = tuple[float, float, float, float]

FINEST = 960  # [px], largest side of the analysed picture
NO_SHAKE = 0.15  # [px], smaller shakes are not removed: interpolation would blur the picture more than it helps
EVEN_LIGHT = 2.0  # [grey levels], brightness changes below this do not affect the colour classification


@dataclass(frozen=True)
class Cut:
    """Crop and zoom of the analysed frames."""

    zoom: float  # analysed pixels per pixel of the clip
    region: Region | None = None  # [px] of the clip: x, y, width, height

    def seen(self, picture: Image) -> Image:
        """The cropped and downsampled picture."""
        if self.region is not None:
            left, top, width, height = (max(round(side), 0) for side in self.region)
            picture = picture[top : top + height, left : left + width]
        if self.zoom >= 1:
            return np.ascontiguousarray(picture)
        return np.asarray(cv2.resize(picture, None, fx=self.zoom, fy=self.zoom, interpolation=cv2.INTER_AREA), np.uint8)

    def in_clip(self, points: Array) -> Array:
        """Points in analysed pixels, shape (n, 2), converted to pixels of the clip."""
        return np.asarray(points / self.zoom + self._corner)

    def of_clip(self, points: Array) -> Array:
        """Points in pixels of the clip, shape (n, 2), converted to analysed pixels."""
        return np.asarray((points - self._corner) * self.zoom)

    @property
    def _corner(self) -> Array:
        left, top = (max(round(side), 0) for side in self.region[:2]) if self.region is not None else (0, 0)
        return np.array([left, top], dtype=np.float64)


@dataclass(frozen=True)
class Steadied:
    """One frame with the camera shake removed and the brightness of the background."""

    index: int
    time: float  # [s]
    colour: Image  # BGR
    pose: Pose

    @property
    def shake(self) -> tuple[float, float]:
        """[px], to be added to background coordinates to draw on the frame."""
        return self.pose.shake


def cut_for(width: int, height: int, region: Region | None = None) -> Cut:
    """Crop and zoom for a clip: the region (default: all) with a longer side of at most `FINEST`."""
    return Cut(min(1.0, FINEST / max(width, height)), region)


def still_scene(video: Video, lens: Cut) -> Scene:
    """The static background of the clip."""
    background = Background()
    wanted = set(np.unique(np.linspace(video.first, video.last, Background.capacity).round().astype(int)).tolist())
    for frame in video.frames():
        if frame.index in wanted:
            background.add(frame.index, lens.seen(frame.grey))
    return background.scene()


def steadied(video: Video, scene: Scene, lens: Cut) -> Iterator[Steadied]:
    """Every frame of the clip, registered to the background, in order."""
    shake = (0.0, 0.0)
    for frame in video.frames():
        pose = scene.pose(lens.seen(frame.grey), shake)
        shake = pose.shake
        yield Steadied(frame.index, frame.time, _levelled(_moved(lens.seen(frame.colour), shake), pose), pose)


def _levelled(picture: Image, pose: Pose) -> Image:
    """The picture with the brightness of the background: lamps flicker and cameras change their exposure."""
    # in dark pictures the gain is uncertain and there are few grey levels: correct only a visible change
    middle = float(np.mean(cv2.mean(picture)[:3]))
    if abs(middle - (middle - pose.offset) / pose.gain) < EVEN_LIGHT:
        return picture
    table = np.rint((np.arange(256) - pose.offset) / pose.gain)
    return np.asarray(cv2.LUT(picture, np.clip(table, 0, 255).astype(np.uint8)), np.uint8)


def _moved(picture: Image, shake: tuple[float, float]) -> Image:
    if max(abs(shake[0]), abs(shake[1])) < NO_SHAKE:
        return picture
    turn = np.array([[1, 0, shake[0]], [0, 1, shake[1]]], dtype=np.float32)
    size = (picture.shape[1], picture.shape[0])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(picture, turn, size, flags=flags, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def apart(one: Image, other: Image) -> Image:
    """Largest absolute difference of the three colours, per pixel, shape (height, width)."""
    blue, green, red = cv2.split(cv2.absdiff(one, other))
    return np.asarray(cv2.max(cv2.max(blue, green), red), dtype=np.uint8)
