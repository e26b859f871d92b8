"""Pictures of clips and photos as JPEG, in the pixels that the measurement works with.

A clip is decoded by one thread, from the frame that was asked for onwards, so that frames are there before they are
asked for.
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import cv2

from rigtwin.lab.arrays import Image
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.measure.geometry.calibration_board import straightened
from rigtwin.measure.media.photo import read_photo
from rigtwin.measure.media.pictures import Picture
from rigtwin.measure.media.video import Video, open_video

QUALITY = 85  # of JPEG: differences to the original are not seen
LONGEST_SIDE = 2048  # [px], of a picture on the page; a larger one is reduced
BEHIND = 24  # frames decoded before one that lies before all that are there: the next ones back are there then
ONWARDS = 60  # frames: up to here decoding on is faster than looking for a keyframe
KEPT = 160 * 2**20  # [bytes], of the encoded frames of one clip
ROOM = 0.9  # of it are filled with frames that were not asked for yet
OPEN = 2  # clips kept open at a time
SOON = 0.05  # [s]
PATIENCE = 60.0  # [s], for one frame


@dataclass(frozen=True)
class MediaInfo:
    """Size of the pictures of a clip or photo [px], and the capture times of a clip's frames [s]."""

    width: int
    height: int
    times: tuple[float, ...] = ()
    playback_rate: float = 0.0


def version_of(medium: Path, camera: Camera) -> str:
    """A text that is the same as long as the pictures of a medium are: file, board, and the photo of the board."""
    board = camera.board
    files = [medium.stat()] if board is None else [medium.stat(), board.photo.stat()]
    state = [(file.st_mtime_ns, file.st_size) for file in files]
    return hashlib.sha256(repr((board, state)).encode()).hexdigest()[:16]


class Clip:
    """Frames of one clip; `close` ends its thread, `join` waits for its end."""

    def __init__(self, video: Video) -> None:
        self.info = MediaInfo(video.width, video.height, tuple(video.times.tolist()), video.playback_rate)
        self._video = video
        self._frames: OrderedDict[int, bytes] = OrderedDict()
        self._size = 0
        self._wanted = 0  # what was asked for last
        self._seen = False  # whether anything was asked for
        self._asked: list[int] = []  # what is waited for, in the order in which it was asked for
        self._faults: dict[int, Exception] = {}  # of frames that cannot be decoded
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._decode, name=f"frames of {video.path.name}", daemon=True)
        self._thread.start()

    def frame(self, index: int, *, near: bool = False) -> tuple[int, bytes]:
        """One frame as JPEG, and its number.  Raises `BadInput` where it cannot be decoded.

        With `near` another one that is there already, the nearest, if this one is not there within `SOON`.
        """
        if not 0 <= index < len(self.info.times):
            raise BadInput(f"{self._video.path}: has no frame {index}; its last one is {len(self.info.times) - 1}.")
        with self._changed:
            self._wanted, self._seen = index, True
            self._asked.append(index)
            self._faults.pop(index, None)  # it is tried again
            self._changed.notify_all()
            patience = SOON if near and self._frames else PATIENCE
            self._changed.wait_for(lambda: self._tried(index) or self._closed, patience)
            self._asked.remove(index)
            if near and index not in self._faults and self._frames:
                index = min(self._frames, key=lambda other: abs(other - index))
            if index in self._frames:
                self._frames.move_to_end(index)
                return index, self._frames[index]
            if index in self._faults:
                why = str(self._faults[index]).removesuffix(".")
                raise BadInput(f"{self._video.path}: frame {index} cannot be decoded; {why}.")
            raise BadInput(f"{self._video.path}: frame {index} is not decoded yet; ask again.")

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def join(self) -> None:
        """Wait until the thread has ended: Python must not end while it decodes."""
        self._thread.join(PATIENCE)

    def _tried(self, index: int) -> bool:
        return index in self._frames or index in self._faults

    def _decode(self) -> None:
        reader: Iterator[Picture] = iter(())
        position = -1  # of the next picture of the reader
        while (target := self._next()) is not None:
            try:
                if not position <= target <= position + ONWARDS or position < 0:
                    position = target  # before the reader, whose fault is then that of this frame
                    reader = self._video.source.pictures(target)
                picture = next(reader, None)
                if picture is None:
                    raise BadInput(f"the clip ends before frame {position}")
                self._keep(position, encoded(picture[1]()))
                position += 1
            except Exception as error:  # shown where the frame is asked for
                with self._changed:
                    self._faults[position] = error
                    self._changed.notify_all()
                position = -1  # the reader may have ended with it

    def _next(self) -> int | None:
        """The frame to decode next; waits while there is none, None at the end."""
        with self._changed:
            while not self._closed:
                # the latest first, but all of them: requests may arrive in another order than they were sent
                waiting = [index for index in self._asked if not self._tried(index)]
                wanted = waiting[-1] if waiting else self._wanted
                if not self._tried(wanted):
                    earlier = range(max(wanted - BEHIND, 0), wanted)
                    # going back: the frames before it are decoded with it, as each needs those before itself
                    back = wanted + 1 in self._frames
                    return next((index for index in earlier if back and not self._tried(index)), wanted)
                # then all others, from there on: a clip that has no room is left alone before frames are given up, a
                # damaged one because each frame behind the damage could mean to decode all since the last keyframe
                if self._seen and self._size < ROOM * KEPT and not self._faults:
                    others = chain(range(wanted + 1, len(self.info.times)), range(wanted))
                    missing = next((index for index in others if index not in self._frames), None)
                    if missing is not None:
                        return missing
                self._changed.wait()
        return None

    def _keep(self, index: int, data: bytes) -> None:
        with self._changed:
            self._size += len(data) - len(self._frames.pop(index, b""))
            self._frames[index] = data
            while self._size > KEPT:
                self._size -= len(self._frames.popitem(last=False)[1])
            self._changed.notify_all()


class Pictures:
    """All pictures of a lab; a few clips are kept open."""

    def __init__(self) -> None:
        self._clips: OrderedDict[Any, Clip] = OrderedDict()
        self._photos: OrderedDict[Any, tuple[MediaInfo, bytes]] = OrderedDict()
        self._lock = threading.Lock()

    def info(self, medium: Path, camera: Camera, *, photo: bool) -> MediaInfo:
        """Size and times of a medium.  Raises `BadInput` where it cannot be read."""
        return self._photo(medium, camera)[0] if photo else self._clip(medium, camera).info

    def picture(
        self, medium: Path, camera: Camera, index: int, *, photo: bool, near: bool = False
    ) -> tuple[int, bytes]:
        """A photo, or one frame of a clip, as JPEG, with its number.  Raises `BadInput` where it cannot be read."""
        return (0, self._photo(medium, camera)[1]) if photo else self._clip(medium, camera).frame(index, near=near)

    def close(self) -> None:
        with self._lock:
            for clip in self._clips.values():
                clip.close()
            for clip in self._clips.values():
                clip.join()
            self._clips.clear()

    def _clip(self, medium: Path, camera: Camera) -> Clip:
        key = (medium, version_of(medium, camera), camera.frame_rate)
        with self._lock:
            if key not in self._clips:
                self._clips[key] = Clip(open_video(medium, _as_taken(camera)))
                while len(self._clips) > OPEN:
                    self._clips.popitem(last=False)[1].close()
            self._clips.move_to_end(key)
            return self._clips[key]

    def _photo(self, medium: Path, camera: Camera) -> tuple[MediaInfo, bytes]:
        key = (medium, version_of(medium, camera))
        with self._lock:
            if key not in self._photos:
                picture, _ = read_photo(medium, _as_taken(camera))
                self._photos[key] = MediaInfo(picture.shape[1], picture.shape[0]), encoded(picture)
                while len(self._photos) > OPEN * 4:
                    self._photos.popitem(last=False)
            self._photos.move_to_end(key)
            return self._photos[key]


def _as_taken(camera: Camera) -> Camera:
    """The camera without what hides a part of the picture or of the clip, or could lie outside it."""
    return replace(Camera(frame_rate=camera.frame_rate), lens=straightened(Camera(board=camera.board)).lens)


def encoded(picture: Image) -> bytes:
    """A BGR picture as JPEG, reduced to `LONGEST_SIDE`."""
    zoom = LONGEST_SIDE / max(picture.shape[:2])
    if zoom < 1:
        size = max(round(picture.shape[1] * zoom), 1), max(round(picture.shape[0] * zoom), 1)
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return data.tobytes()
