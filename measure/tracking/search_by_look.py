"""Find a bead in every frame by its picture, where spots that differ from the background are not enough.

A shadow or a second object that touches the bead joins its spot, and an occlusion splits it.  The picture of the bead
from frames that show it alone is therefore compared with every place of a frame: does the frame look there like the
bead, or like the background?
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np

from rigtwin.lab.arrays import FloatImage
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
ALONE = 0.15  # largest relative difference of a spot's area from the median of a bead that is seen alone


@dataclass(frozen=True)
class BeadPicture:
    """How a bead looks."""

    radius: float  # [px]
    picture: FloatImage = field(repr=False)  # [grey levels], square, centre in the middle


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
    return _picture(video.frames(min(at), max(at)), at, moves, path.radius)


def picture_at(video: Video, frame: int, at: tuple[float, float], radius: float, moves: Movement) -> BeadPicture | None:
    """The picture of the bead at a stated place [px] in one frame."""
    return _picture(video.frames(frame, frame), {frame: at}, moves, radius)


def _picture(
    frames: Iterable[Frame], at: dict[int, tuple[float, float]], moves: Movement, radius: float
) -> BeadPicture | None:
    reach = int(np.ceil(radius))
    cuts = []
    for frame in frames:
        if frame.index in at:
            seen = moves.pose(frame).seen(frame.grey)
            cuts.append(cv2.getRectSubPix(seen.astype(np.float32), (2 * reach + 1, 2 * reach + 1), at[frame.index]))
    if not cuts:
        return None
    return BeadPicture(radius, np.median(np.stack(cuts), axis=0).astype(np.float32))


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
    With the frame g, the background b and the picture of the bead l, summed over the disc of the bead, the likeness of
    a place is (sum (g - b)^2 - sum (g - l)^2) / sum (l - b)^2: 1 on the bead, -1 on the background.
    """
    factor = max(bead.radius / COARSE_RADIUS, 1.0)
    behind = moves.scene.picture
    size = (max(round(behind.shape[1] / factor), 1), max(round(behind.shape[0] / factor), 1))
    scales = behind.shape[1] / size[0], behind.shape[0] / size[1]
    matcher = _Matcher(bead, _smaller(behind, size), factor)
    inside = None if region is None else _smaller(inside_region(region, behind.shape), size) > 0.5
    linker = Linker()
    for frame in video.frames():
        if frame.index not in moves.repeated:
            likeness = matcher.likeness(_smaller(moves.pose(frame).seen(frame.grey), size))
            if inside is not None:
                likeness = np.where(inside, likeness, -1.0).astype(np.float32)
            linker.add(frame.index, _spots(likeness, matcher.contrast, bead.radius, scales))
        progress("searching the bead by its picture", frame.index - video.first + 1, video.last - video.first + 1)
    return linker.paths()


def _smaller(picture: FloatImage, size: tuple[int, int]) -> FloatImage:
    return np.asarray(cv2.resize(picture.astype(np.float32), size, interpolation=cv2.INTER_AREA))


class _Matcher:
    """Compares places of frames with the picture of the bead."""

    def __init__(self, bead: BeadPicture, behind: FloatImage, factor: float) -> None:
        self.behind = behind
        side = max(round(len(bead.picture) / factor), 3) | 1
        picture = _smaller(bead.picture, (side, side))
        rows, columns = np.mgrid[:side, :side] - side // 2
        # the rim holds some background, and the motion blur
        disc = (np.hypot(rows, columns) < 0.9 * bead.radius / factor).astype(np.float32)
        disc /= disc.sum()
        self._disc, self._bead = disc, disc * picture
        self._power = float(np.sum(disc * picture**2))
        between = self._power - 2 * self._correlated(behind, self._bead) + self._correlated(behind**2, disc)
        self.contrast = np.sqrt(np.maximum(between, 1.0))

    @staticmethod
    def _correlated(picture: FloatImage, kernel: FloatImage) -> FloatImage:
        return np.asarray(cv2.filter2D(picture, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT))

    def likeness(self, seen: FloatImage) -> FloatImage:
        """Likeness of every place, shape as the frame."""
        to_bead = self._correlated(seen**2, self._disc) - 2 * self._correlated(seen, self._bead) + self._power
        to_background = self._correlated((seen - self.behind) ** 2, self._disc)
        return np.asarray((to_background - to_bead) / self.contrast**2)


def _spots(
    likeness: FloatImage, contrast: FloatImage, radius: float, scales: tuple[float, float]
) -> list[Spot]:
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
