"""Cut out the pixels around a moving bead in every frame, and find occlusions along its path."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage, Mask
from rigtwin.lab.progress import Progress
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.scene.pose import Pose
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tracking.bead_image import BeadFit, BeadImage
from rigtwin.measure.tracking.colour_channel import Channel
from rigtwin.measure.tracking.detect import Box
from rigtwin.measure.tracking.link import SpotPath, Where, place_on

REST = 25  # frames analysed before and after the motion, while the bead is at rest


@dataclass(frozen=True)
class Sighting:
    """The bead in one frame, in background coordinates."""

    frame: int
    time: float  # [s]
    image: BeadImage
    shake: tuple[float, float]  # [px], to be added to a position to draw on the frame
    fit: BeadFit = field(repr=False)  # fit of this frame alone

    @property
    def place(self) -> tuple[float, float]:
        """Centre [px]."""
        return self.image.x, self.image.y


def shows(cut: Cut, place: tuple[float, float]) -> bool:
    """Whether a place [px] lies inside the cut-out."""
    return bool(
        cut.left <= place[0] < cut.left + cut.grey.shape[1] and cut.top <= place[1] < cut.top + cut.grey.shape[0]
    )


@dataclass(frozen=True)
class Cut:
    """The pixels around the bead in one frame."""

    frame: int
    time: float
    grey: npt.NDArray[np.float32]
    left: int
    top: int
    near: tuple[float, float]  # [px], expected centre in background coordinates
    step: tuple[float, float]  # [px/frame], motion
    pose: Pose


def cut_out(video: Video, path: SpotPath, scene: Scene, channel: Channel, progress: Progress) -> list[Cut]:
    where = place_on(path)
    cuts = []
    shake = (0.0, 0.0)
    for frame in video.frames(*busy(path)):
        grey = channel.grey(frame)
        pose = scene.pose(grey, shake)
        shake = pose.shake
        cuts += cut_around(frame, grey, pose, path, where)
        progress("cutting out the bead", frame.index - video.first + 1, video.last - video.first + 1)
    return cuts


def cut_around(frame: Frame, grey: GreyImage, pose: Pose, path: SpotPath, where: Where) -> list[Cut]:
    """The cut-out around the bead in one frame; empty if it lies outside the picture."""
    near, step = where(frame.index)
    box = inside_picture(around(path, near, step), grey.shape)
    if box is None:
        return []
    return [Cut(frame.index, frame.time, pose.seen(grey, box), *box[:2], near, step, pose)]


def inside_picture(box: Box, shape: tuple[int, ...]) -> Box | None:
    """The part of a box inside a picture of this shape; None if it is too small for a fit."""
    left, top, right, bottom = box[0], box[1], min(box[2], shape[1]), min(box[3], shape[0])
    return (left, top, right, bottom) if min(right - left, bottom - top) > 4 else None


def around(path: SpotPath, near: tuple[float, float], step: tuple[float, float]) -> Box:
    """Bounding box of a cut-out [px]: left, top, right, bottom."""
    reach = 2.2 * path.radius + 8 + abs(step[0]) + abs(step[1])
    left, top = max(int(near[0] - reach), 0), max(int(near[1] - reach), 0)
    return left, top, max(int(near[0] + reach) + 2, 0), max(int(near[1] + reach) + 2, 0)


def busy(path: SpotPath) -> tuple[int, int]:
    """First and last frame to analyse: the motion of the bead and `REST` frames before and after."""
    frames, centres = path.frames, path.centres
    moved = 0.3 * path.radius + 1
    begun = np.flatnonzero(np.hypot(*(centres - np.median(centres[:5], axis=0)).T) > moved)
    going = np.flatnonzero(np.hypot(*(centres - np.median(centres[-5:], axis=0)).T) > moved)
    first = frames[begun[0]] if len(begun) else frames[0]
    last = frames[going[-1]] if len(going) else frames[-1]
    return first - REST, last + REST


def occluders(cuts: list[Cut], sightings: list[Sighting], radius: float, scene: Scene) -> Mask | None:
    """Mask of pixels that show the background although the bead should cover them: an object in front of the path.

    None if there are none or too few sightings.
    """
    centres = _without_jumps(sightings)
    if len(centres) < 4:
        return None
    bright = _brightness(cuts, sightings, scene)
    seen = np.zeros(scene.picture.shape, dtype=np.float32)
    missing = np.zeros(scene.picture.shape, dtype=np.float32)
    for cut in cuts:
        if not sightings[0].frame <= cut.frame <= sightings[-1].frame:
            continue
        x, y = (float(np.interp(cut.frame, centres[:, 0], centres[:, k])) for k in (1, 2))
        window = np.s_[cut.top : cut.top + cut.grey.shape[0], cut.left : cut.left + cut.grey.shape[1]]
        behind = scene.picture[window]
        rows, columns = np.mgrid[: cut.grey.shape[0], : cut.grey.shape[1]]
        slack = np.hypot(*cut.step) / 2 + 1.5
        inside = np.hypot(columns + cut.left - x, rows + cut.top - y) < max(radius - slack, 0)
        contrast = np.abs(bright - behind)
        telling = inside & (contrast > 8 * scene.noise[window])
        gone = telling & (np.abs(cut.grey - behind) < 0.25 * contrast)
        seen[window] += telling
        missing[window] += gone
    hidden = (seen >= 2) & (missing > 0.7 * seen)
    hidden = cv2.morphologyEx(hidden.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    if not np.any(hidden):
        return None
    return np.asarray(cv2.dilate(hidden.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)


def _without_jumps(sightings: list[Sighting]) -> Array:
    """Frame, x, y of the sightings, shape (n, 3), without outliers from the line between their neighbours."""
    table = np.array([(sighting.frame, sighting.image.x, sighting.image.y) for sighting in sightings])
    if len(table) < 7:
        return table
    middle = (table[2:, 1:] + table[:-2, 1:]) / 2
    off = np.concatenate([[0], np.linalg.norm(table[1:-1, 1:] - middle, axis=1), [0]])
    return table[off < max(6 * float(np.median(off)), 2.0)]


def _brightness(cuts: list[Cut], sightings: list[Sighting], scene: Scene) -> float:
    """Grey level at the bead's centre, median over the clip."""
    by_frame = {cut.frame: cut for cut in cuts}
    levels = []
    for sighting in sightings:
        cut = by_frame[sighting.frame]
        row, column = round(sighting.image.y) - cut.top, round(sighting.image.x) - cut.left
        if 0 <= row < cut.grey.shape[0] and 0 <= column < cut.grey.shape[1]:
            levels.append(float(cut.grey[row, column]))
    return float(np.median(levels)) if levels else 0.0
