"""Videos and photos as they really are: frames with their own time stamps, photos with their orientation applied.

A video is read in one pass and never held in memory whole.  Times are capture times: where the capture rate is given
it is used; where the file's own time stamps cannot be trusted (B-frames in AVI) the frame index is.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.camera import Camera, Moment
from rigtwin.lab.errors import BadInput, UnreadableMedia

Grey = npt.NDArray[np.uint8]
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Frame:
    """One picture of a video."""

    index: int  # 0 for the first picture in the file
    time: float  # [s], capture time of the start of the exposure, 0 for the first picture in the file
    grey: Grey  # the luma plane as stored, shape (height, width)
    picture: av.VideoFrame = field(repr=False)

    @cached_property
    def colour(self) -> Image:
        """BGR, shape (height, width, 3); converted only when asked for."""
        return _upright(self.picture, np.asarray(self.picture.to_ndarray(format="bgr24"), dtype=np.uint8))


@dataclass(frozen=True)
class Video:
    """A readable video; iterate `frames()` as often as needed, each time one pass over the file."""

    path: Path
    width: int  # [px]
    height: int  # [px]
    frame_count: int  # pictures that decode
    frame_rate: float  # [1/s], capture rate
    playback_rate: float  # [1/s], as the file states it
    times: npt.NDArray[np.float64]  # [s], capture time of every picture, shape (frame_count,)
    first: int  # first frame inside --start/--end
    last: int  # last frame inside --start/--end
    warnings: tuple[str, ...] = field(default=())
    skipped: frozenset[int] = field(default=frozenset())  # pictures that `frames()` leaves out

    def frames(self) -> Iterator[Frame]:
        """The pictures from `first` to `last`, in order."""
        for index, picture in enumerate(_decode(self.path)):
            if index > self.last:
                return
            if index >= self.first and index not in self.skipped:
                yield Frame(index, float(self.times[index]), _upright(picture, _luma(picture)), picture)
            if index == self.last:
                return  # a damaged rest of the file is never touched


def open_video(path: Path, camera: Camera) -> Video:
    """Open a video and find its true time base.

    Raises `UnreadableMedia` for a missing, empty or undecodable file, `BadInput` when the file states no frame rate
    and none was given, or when the time window holds too few frames.
    """
    _must_exist(path, "video")
    stamps, stated, base, (height, width), warnings = _scan(path)
    if len(stamps) < 3:
        raise UnreadableMedia(f"{path}: decodes to {len(stamps)} pictures; a measurement needs a clip.")
    rate = camera.frame_rate or stated
    if not rate > 0:
        raise BadInput(f"{path}: the file states no frame rate; give the capture rate with --frame-rate 240Hz.")
    if camera.frame_rate is None:
        warnings.append(
            f"frame rate {rate:.6g} Hz read from the file; high-speed files often play slower than captured: "
            "check gravity, or give --frame-rate."
        )
    times, oddities = _time_base(stamps, stated, base, camera.frame_rate)
    first = _frame_of(camera.start, times, 0)
    last = _frame_of(camera.end, times, len(times) - 1)
    if last - first < 2:
        raise BadInput(f"{path}: --start and --end leave {max(last - first + 1, 0)} frames of {len(times)}.")
    return Video(path, width, height, len(times), rate, stated, times, first, last, (*warnings, *oddities))


def read_photo(path: Path) -> Image:
    """A photo as BGR, shape (height, width, 3), 8 bit, with its EXIF orientation applied.  Raises `UnreadableMedia`."""
    _must_exist(path, "photo")
    # decode from memory: imread reports a broken file on stderr by itself, and once more to us as None
    image = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise UnreadableMedia(f"{path}: cannot be decoded as a photo; give a JPEG, PNG or TIFF file.")
    return np.asarray(image, dtype=np.uint8)


def sha256(path: Path) -> str:
    """Hex digest of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _must_exist(path: Path, kind: str) -> None:
    if not path.exists():
        raise UnreadableMedia(f"{path}: no such file; check the path of the {kind}.")
    if not path.is_file():
        raise UnreadableMedia(f"{path}: is a folder, not a {kind}; give the file itself.")
    if path.stat().st_size == 0:
        raise UnreadableMedia(f"{path}: is empty (0 bytes); copy the {kind} again.")


def _scan(path: Path) -> tuple[list[float | None], float, float, tuple[int, int], list[str]]:
    """One pass over a file: time stamps [s], stated rate [1/s], tick of the stamps [s], size, what is odd."""
    stamps: list[float | None] = []
    size = (0, 0)
    stated = base = 0.0
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise UnreadableMedia(f"{path}: holds no video; give a clip that a video player shows.")
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            stated = float(stream.average_rate or 0)
            base = float(stream.time_base or 0)
            for picture in container.decode(stream):
                stamps.append(None if picture.pts is None else picture.pts * base)
                if not size[0]:
                    size = _upright(picture, _luma(picture)).shape
    except av.FFmpegError as error:
        if len(stamps) < 3:
            raise UnreadableMedia(
                f"{path}: cannot be decoded as a video ({_reason(error)}); give a clip that a video player shows."
            ) from None
        return stamps, stated, base, size, [f"the file is damaged after picture {len(stamps) - 1}; used what decodes."]
    return stamps, stated, base, size, []


def _decode(path: Path) -> Iterator[av.VideoFrame]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        yield from container.decode(stream)


def _luma(picture: av.VideoFrame) -> Grey:
    """The luma plane itself where it is stored with 8 bits: no colour conversion, no rounding."""
    if picture.format.name.startswith(("yuv4", "yuvj4", "nv12", "nv21", "gray")) and all(
        component.bits == 8 for component in picture.format.components
    ):
        plane = picture.planes[0]
        rows: Grey = np.frombuffer(memoryview(plane), dtype=np.uint8).reshape(-1, plane.line_size)
        return np.array(rows[: picture.height, : picture.width])
    return np.asarray(picture.to_ndarray(format="gray"), dtype=np.uint8)


def _upright(picture: av.VideoFrame, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Pixels with the display matrix applied, as a player shows them."""
    turns = round(getattr(picture, "rotation", 0) / 90) % 4  # counter-clockwise
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


def _time_base(
    stamps: list[float | None], stated: float, tick: float, given: float | None
) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Capture time of every picture, and what is odd about the file's own stamps.

    `stated` is the file's rate, `given` the capture rate where it is known [1/s], `tick` the unit of the stamps [s].
    """
    rate = given or stated
    index = np.arange(len(stamps), dtype=np.float64)
    if any(stamp is None for stamp in stamps):
        return index / rate, ["time base: the file has pictures without a time stamp; used the frame index."]
    times = np.array(stamps, dtype=np.float64)
    steps = np.diff(times)
    if np.any(steps <= 0):
        return index / rate, [
            f"time base: {int(np.sum(steps <= 0))} of the file's time stamps run backwards or repeat "
            "(typical of H.264 with B-frames in AVI); used frame index / frame rate instead."
        ]
    line = np.polyfit(index, times, 1)
    if np.max(np.abs(np.polyval(line, index) - times)) <= max(0.8 * tick, 0.02 * line[0]):
        return index / rate, []  # equal steps but for the rounding of the stamps
    middle = float(np.median(steps))
    odd = int(np.sum(np.abs(steps - middle) > 0.05 * middle))
    times = times - times[0]
    plays_at = 1 / middle
    if given is None or any(abs(real / given - 1) < 0.03 for real in (stated, plays_at, 1 / float(line[0]))):
        # stamps of a file that plays as fast as it was captured are true times, dropped frames or not
        used = "the file's own time stamps were used"
    else:
        times = times * plays_at / given
        used = f"the file's own time stamps were used, stretched from {plays_at:.4g} Hz to {given:.4g} Hz"
    return times, [
        f"time base: {odd} of {len(steps)} frame intervals differ by more than 5 % from {middle * 1e3:.2f} ms; {used}."
    ]


def _frame_of(moment: Moment | None, times: npt.NDArray[np.float64], default: int) -> int:
    if moment is None:
        return default
    frame = moment.value if moment.unit == "frame" else float(np.searchsorted(times, moment.value - 1e-9))
    return int(min(max(frame, 0), len(times) - 1))


def _reason(error: av.FFmpegError) -> str:
    return str(error.strerror or "unknown data").lower()
