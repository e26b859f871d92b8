"""Find a bead in every frame by its picture, where spots that differ from the background are not enough.

A shadow or a second object that touches the bead joins its spot, and an occlusion splits it.  The picture of the bead
from frames that show it alone is therefore compared with every place of a frame: does the frame look there like the
bead, or like the background?
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field

import cv2
import numpy as np

from rigtwin.lab.arrays import FloatImage, GreyImage
from rigtwin.lab.progress import Progress, silent
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.tracking.detect import Region, Spot, inside_region
from rigtwin.measure.tracking.find_paths import Movement
from rigtwin.measure.tracking.link import Linker, SpotPath

COARSE_RADIUS = 7.0  # [px], of the bead in the pictures that are searched
LIKE = 0.25  # minimum likeness of a place, 1: the bead, -1: the background, 0: as different from both
CANDIDATES = 3  # places per frame
FEWEST = 3  # minimum number of frames for the picture of a bead
MOST = 15  # frames that it is taken from
BACKGROUND_FRAMES = 15  # spread over the clip, for the background in colour
INNER = 0.9  # radius of the disc that is compared over that of the bead
ALONE = 0.15  # largest relative difference of a spot's area from the median of a bead that is seen alone


@dataclass(frozen=True)
class BeadPicture:
    """How a bead and the background look, in colour, with the bead at a radius of a few pixels."""

    radius: float  # [px], in the frames
    picture: FloatImage = field(repr=False)  # [grey levels], shape (side, side, 3), centre in the middle
    behind: FloatImage = field(repr=False)  # [grey levels], background, shape (rows, columns, 3)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures that are searched [px]."""
        return self.behind.shape[1], self.behind.shape[0]


def picture_on_path(video: Video, path: SpotPath, moves: Movement) -> BeadPicture | None:
    """The picture of the bead of a path, from its slowest frames in which the spot has its usual size."""
    areas = np.array([spot.area for spot in path.spots])
    centres, frames = path.centres, np.array(path.frames)
    speed = np.hypot(*np.gradient(centres, axis=0).T) / np.maximum(np.gradient(frames), 1)
    alone = np.flatnonzero(np.abs(areas / np.median(areas) - 1) < ALONE)
    chosen = alone[np.argsort(speed[alone], kind="stable")[:MOST]]
    if len(chosen) < FEWEST:
        return None
    at = {int(frames[k]): (float(centres[k, 0]), float(centres[k, 1])) for k in chosen}
    return _picture(video, at, moves, path.radius, path)


def picture_at(video: Video, frame: int, at: tuple[float, float], radius: float, moves: Movement) -> BeadPicture | None:
    """The picture of the bead at a stated place [px] in one frame."""
    return _picture(video, {frame: at}, moves, radius, None)


def _picture(
    video: Video, at: dict[int, tuple[float, float]], moves: Movement, radius: float, path: SpotPath | None
) -> BeadPicture | None:
    """Picture of the bead at the places `at` by frame, and of the background where the bead of the path is not."""
    height, width = moves.scene.picture.shape
    factor = max(radius / COARSE_RADIUS, 1.0)
    size = max(round(width / factor), 1), max(round(height / factor), 1)
    behind = np.unique(np.linspace(video.first, video.last, BACKGROUND_FRAMES).round().astype(int)).tolist()
    reach = math.ceil(radius / factor)
    covered = {} if path is None else dict(zip(path.frames, path.centres, strict=True))
    cuts, layers = [], []
    for frame in video.frames():
        if frame.index not in at and frame.index not in behind:
            continue
        layer = _in_colour(frame, moves, size)
        if frame.index in at:
            x, y = (at[frame.index][k] / factor for k in (0, 1))
            cuts.append(cv2.getRectSubPix(layer, (2 * reach + 1, 2 * reach + 1), (x, y)))
        if frame.index in behind:
            if frame.index in covered:
                x, y = covered[frame.index] / factor
                cv2.circle(layer, (round(x), round(y)), round(1.6 * radius / factor + 2), (math.nan,) * 3, cv2.FILLED)
            layers.append(layer)
    if not cuts:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # places that the bead always covers
        background = np.nanmedian(np.stack(layers), axis=0)
    background = np.where(np.isfinite(background), background, np.median(layers[0][np.isfinite(layers[0])]))
    return BeadPicture(radius, np.median(np.stack(cuts), axis=0).astype(np.float32), background.astype(np.float32))


def _in_colour(frame: Frame, moves: Movement, size: tuple[int, int]) -> FloatImage:
    """The frame at this size in the background's pixels and brightness, BGR, shape (height, width, 3)."""
    pose = moves.pose(frame)
    seen = _smaller(frame.colour, size)
    if not moves.still:
        shift = [[1.0, 0.0, -pose.shake[0] * size[0] / frame.grey.shape[1]]]
        shift += [[0.0, 1.0, -pose.shake[1] * size[1] / frame.grey.shape[0]]]
        seen = np.asarray(cv2.warpAffine(seen, np.array(shift), size, borderMode=cv2.BORDER_REPLICATE))
    return np.asarray((seen - np.float32(pose.offset)) / np.float32(pose.gain))


def paths_by_look(
    video: Video, bead: BeadPicture, moves: Movement, region: Region | None, progress: Progress = silent
) -> list[SpotPath]:
    """Paths of everything that looks like the bead.

    Parameters
    ----------
    video : Video
        The clip.
    bead : BeadPicture
        Picture of the bead.
    moves : Movement
        Background and poses of the frames.
    region : tuple of float, optional
        x, y, width, height [px] of the searched part; None: the whole frame.

    Notes
    -----
    With the frame g, the background b and the picture of the bead l, summed over the disc of the bead and the colours,
    the likeness of a place is (sum (g - b)^2 - sum (g - l)^2) / sum (l - b)^2: 1 on the bead, -1 on the background.
    """
    shape = moves.scene.picture.shape
    scales = shape[1] / bead.size[0], shape[0] / bead.size[1]
    matcher = _Matcher(bead, math.sqrt(scales[0] * scales[1]))
    inside = None if region is None else _smaller(inside_region(region, shape), bead.size) > 0.5
    linker = Linker()
    for frame in video.frames():
        if frame.index not in moves.repeated:
            likeness = matcher.likeness(_in_colour(frame, moves, bead.size))
            if inside is not None:
                likeness = np.where(inside, likeness, -1.0).astype(np.float32)
            linker.add(frame.index, _spots(likeness, matcher.contrast, bead.radius, scales))
        progress("searching the bead by its picture", frame.index - video.first + 1, video.last - video.first + 1)
    return linker.paths()


def _smaller(picture: FloatImage | GreyImage, size: tuple[int, int]) -> FloatImage:
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


class _Matcher:
    """Compares places of frames with the picture of the bead."""

    def __init__(self, bead: BeadPicture, factor: float) -> None:
        self._behind = bead.behind
        side = len(bead.picture)
        rows, columns = np.mgrid[:side, :side] - side // 2
        # the rim holds some background, and the motion blur
        disc = (np.hypot(rows, columns) < INNER * bead.radius / factor).astype(np.float32)
        self._disc = disc / disc.sum()
        self._bead = self._disc[..., None] * bead.picture
        self._power = float(np.sum(self._bead * bead.picture))
        between = self._to_bead(bead.behind)
        self.contrast = np.sqrt(np.maximum(between, 1.0))

    def _to_bead(self, seen: FloatImage) -> FloatImage:
        """Mean square difference to the bead's picture, summed over the colours, at every place."""
        alike = sum(_correlated(seen[..., k], self._bead[..., k]) for k in range(seen.shape[2]))
        return np.asarray(_correlated(np.sum(seen**2, axis=2), self._disc) - 2 * alike + self._power)

    def likeness(self, seen: FloatImage) -> FloatImage:
        """Likeness of every place, shape as the frame."""
        to_background = _correlated(np.sum((seen - self._behind) ** 2, axis=2), self._disc)
        return np.asarray((to_background - self._to_bead(seen)) / self.contrast**2)


def _correlated(picture: FloatImage, kernel: FloatImage) -> FloatImage:
    return np.asarray(cv2.filter2D(picture, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT))


def _spots(likeness: FloatImage, contrast: FloatImage, radius: float, scales: tuple[float, float]) -> list[Spot]:
    """The places most like the bead, at least a diameter apart."""
    reach = max(round(2 * radius / max(scales)), 1) | 1
    peaks = likeness >= cv2.dilate(likeness, np.ones((reach, reach), np.uint8))
    rows, columns = np.nonzero(peaks & (likeness > LIKE))
    best = np.argsort(-likeness[rows, columns])[:CANDIDATES]
    found = []
    for row, column in zip(rows[best].tolist(), columns[best].tolist(), strict=True):
        x, y = ((place + 0.5) * scale - 0.5 for place, scale in zip((column, row), scales, strict=True))
        level = float(contrast[row, column]) * max(float(likeness[row, column]), 0.1)
        found.append(Spot(x, y, np.pi * radius**2, 2 * radius, 2 * radius, level))
    return found
