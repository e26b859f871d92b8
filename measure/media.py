"""Videos and photos as they really are: frames with their own time stamps, photos with their orientation applied.

A video is read in one pass and never held in memory whole.  Times are capture times: where the capture rate is given
it is used; where the file's own time stamps cannot be trusted (B-frames in AVI) the frame index is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import GreyImage, Image
from rigtwin.lab.camera import Camera, Lens, Moment
from rigtwin.lab.errors import BadInput, UnreadableMedia
from rigtwin.measure import sources
from rigtwin.measure.lens import straight

SMALLEST = 5  # [px], no rig fits into less
ROUNDED = 0.01  # [s], by which a stated end may lie beyond that of the clip
FEWEST_KEYS = 9  # pictures at which decoding can begin, below which a film is read as a whole
COARSE = 0.01  # of a frame's interval, above which the rounding of time stamps moves what is seen
FRAME_LIKE = 0.3  # of a frame's interval, above which a tick is so long that a lost frame looks like rounding
WHOLE = 0.002  # ticks, by which a frame's interval is off a whole number of them at most where it is meant to be one
FULL_RATE = 5  # [%], percentile of the steps between pictures: the shortest that are no chance
UNSTEADY = 0.5  # share of odd frame intervals, from which on a file's own times are not believed
SAME_RATE = 0.03  # relative, by which two rates may differ that are meant to be one
WRONG_HEADER = 0.01  # relative, by which the rate in a file's head may differ from its time stamps
BEHIND_KEY = 6  # frames: what moves has moved on by then, and few pictures are decoded on the way there


@dataclass(frozen=True)
class Frame:
    """One picture of a video."""

    index: int  # 0 for the first picture in the file
    time: float  # [s], capture time of the start of the exposure, 0 for the first picture in the file
    grey: GreyImage  # the luma plane as stored, shape (height, width)
    in_colour: Callable[[], Image] = field(repr=False)

    @cached_property
    def colour(self) -> Image:
        """BGR, shape (height, width, 3); converted only when asked for."""
        return self.in_colour()


@dataclass(frozen=True)
class Video:
    """A readable video; iterate `frames()` as often as needed, each time one pass over the file."""

    path: Path
    width: int  # [px]
    height: int  # [px]
    frame_count: int  # pictures that decode
    frame_rate: float  # [1/s], capture rate
    playback_rate: float  # [1/s], at which the file plays
    times: npt.NDArray[np.float64]  # [s], capture time of every picture, shape (frame_count,)
    first: int  # first frame inside --start/--end
    last: int  # last frame inside --start/--end
    source: sources.Source = field(repr=False)
    warnings: tuple[str, ...] = field(default=())
    skipped: frozenset[int] = field(default=frozenset())  # pictures that `frames()` leaves out

    @property
    def spoilt(self) -> str:
        """Why nothing that moves can be trusted to be seen, where it is or to its end; empty where it can."""
        return "; ".join(note for note in (sources.INTERLACED, sources.CUT_OFF) if note in self.warnings)

    @property
    def broken_off(self) -> str:
        """Why the film may not show all that was filmed; empty where it does."""
        return sources.CUT_OFF if sources.CUT_OFF in self.warnings else ""

    def frames(self, first: int | None = None, last: int | None = None) -> Iterator[Frame]:
        """The pictures from `first` to `last`, the video's own where not given, in order."""
        first = self.first if first is None else max(first, self.first)
        last = self.last if last is None else min(last, self.last)
        index = first - 1
        try:
            for index, (grey, in_colour) in enumerate(self.source.pictures(first), start=first):
                if index not in self.skipped:
                    yield Frame(index, float(self.times[index]), grey, in_colour)
                if index == last:
                    return  # a damaged rest of the file is never touched
        except av.FFmpegError:
            pass
        raise self._damaged(index)

    def spread(self, count: int, *, quickly: bool = False) -> set[int]:
        """`count` frames spread evenly from `first` to `last`; `quickly`: about as many that are soon read."""
        there = [index for index in range(self.first, self.last + 1) if index not in self.skipped]
        keys = [index for index in self.source.cheap(self.first, self.last) if index not in self.skipped]
        if FEWEST_KEYS <= len(keys) < count:
            # a scene is learnt from many pictures: add those that come a while after the key pictures
            keys = sorted({*keys, *(key + BEHIND_KEY for key in keys)} & set(there))
        # a film cut at scene changes may have most of its key pictures in one place
        widest = max(np.diff([self.first, *keys, self.last])) if keys else math.inf
        even = widest <= 2 * (self.last - self.first) / FEWEST_KEYS
        chosen = keys if quickly and even and len(keys) >= 2 * FEWEST_KEYS else there
        places = np.linspace(0, len(chosen) - 1, min(count, len(chosen))).round().astype(int)
        return {chosen[k] for k in places}

    def single(self, indices: Collection[int]) -> list[Frame]:
        """Some frames, in order; what lies between them is read only where that is quicker than to skip it."""
        wanted = [k for k in sorted(indices) if self.first <= k <= self.last and k not in self.skipped]
        found = list[Frame]()
        try:
            for index, (grey, in_colour) in zip(wanted, self.source.at(wanted), strict=False):
                found.append(Frame(index, float(self.times[index]), grey, in_colour))
        except av.FFmpegError:
            pass
        if len(found) < len(wanted):
            last = found[-1].index if found else self.first
            for frame in self.frames(last):  # which says where the damage is, not which picture was wanted before it
                last = frame.index
            raise self._damaged(last)
        return found

    def _damaged(self, index: int) -> UnreadableMedia:
        return UnreadableMedia(
            f"{self.path}: is damaged after picture {index}; end the measurement before it with --end {index}f."
        )


def open_video(path: Path, camera: Camera) -> Video:
    """Open a video and find its true time base.

    Raises `UnreadableMedia` for a missing, empty or undecodable file, `BadInput` when the file states no frame rate
    and none was given, or when the time window holds too few frames.
    """
    _must_exist(path, "video")
    cv2.setNumThreads(1)  # more threads would spend more on waiting for each other than on pictures
    film = sources.source(path)
    if camera.lens is not None:
        _must_fit(path, film.shape, camera.lens)
        film = sources.Straight(film, camera.lens)
    stamps, stated, (height, width), warnings = film.stamps, film.rate, film.shape, list(film.notes)
    if len(stamps) < 3:
        raise UnreadableMedia(
            f"{path}: decodes to {len(stamps)} picture{'s' * (len(stamps) != 1)}; a measurement needs a clip."
        )
    if min(height, width) < SMALLEST:
        raise UnreadableMedia(f"{path}: is only {width} x {height} px, too small to show a rig; give the clip itself.")
    _must_lie_inside(path, camera, width, height)
    if not (camera.frame_rate or stated) > 0:
        raise BadInput(f"{path}: the file states no frame rate; give the capture rate with --frame-rate 240Hz.")
    times, plays_at, oddities = _time_base(stamps, stated, film.tick, camera.frame_rate)
    rate = camera.frame_rate or plays_at
    if camera.frame_rate is None:
        warnings.append(
            f"frame rate {rate:.6g} Hz read from the file; high-speed files often play slower than captured: "
            "give the capture rate with --frame-rate."
        )
    first = _frame_of(camera.start, times, 0)
    last = _frame_of(camera.end, times, len(times) - 1)
    warnings += _ends_before(camera.end, times)
    if last - first < 2:
        left = max(last - first + 1, 0)
        raise BadInput(
            f"{path}: --start and --end leave {left} {'frame' if left == 1 else 'frames'} of {len(times)}; "
            "a measurement needs at least three."
        )
    return Video(path, width, height, len(times), rate, plays_at, times, first, last, film, (*warnings, *oddities))


def _must_lie_inside(path: Path, camera: Camera, width: int, height: int) -> None:
    """Refuse places of another picture: a region or a known length that this one does not show."""
    outside = f"outside the picture of {width} x {height} px."
    if camera.region is not None and (camera.region[0] >= width or camera.region[1] >= height):
        raise BadInput(f"{path}: --region begins at {camera.region[0]:g},{camera.region[1]:g}, {outside}")
    for x, y in () if camera.known_length is None else (camera.known_length.start, camera.known_length.end):
        if not (-1 <= x <= width and -1 <= y <= height):
            raise BadInput(f"{path}: --known-length has an end at {x:g},{y:g}, {outside}")


def read_photo(path: Path, camera: Camera | None = None) -> tuple[Image, tuple[str, ...]]:
    """A photo as BGR, shape (height, width, 3), 8 bit, with its EXIF orientation applied, straightened by the lens.

    And what is odd about it.  Raises `UnreadableMedia`, or `BadInput` where the camera names places outside of it.
    """
    _must_exist(path, "photo")
    # decode from memory: imread reports a broken file on stderr by itself, and once more to us as None
    stored = np.fromfile(path, dtype=np.uint8)
    image = cv2.imdecode(stored, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if image is not None and image.dtype not in (np.uint8, np.uint16):
        image = cv2.imdecode(stored, cv2.IMREAD_COLOR)
    notes: tuple[str, ...] = ()
    if image is None:
        photo = _phone_photo(path)
    else:
        shift, told = sources.bit_shift([image])
        photo = sources.dropped(image, shift)
        if told:
            notes = (
                f"{path.name}: none of its 16-bit pixels is brighter than {image.max()}, so it was read as of "
                f"{shift + 8} bits, {2 ** (8 - shift)} times brighter; if the photo is just dim, expose it longer.",
            )
    if camera is not None:
        if camera.lens is not None:
            _must_fit(path, photo.shape, camera.lens)
            photo = straight(photo, camera.lens)
        _must_lie_inside(path, camera, photo.shape[1], photo.shape[0])
    return photo, notes


def _phone_photo(path: Path) -> Image:
    """What OpenCV does not read: HEIC, and the rest that Pillow knows."""
    import pillow_heif
    from PIL import Image as Pictures
    from PIL import ImageOps, UnidentifiedImageError

    pillow_heif.register_heif_opener()
    try:
        with Pictures.open(path) as photo:
            upright = ImageOps.exif_transpose(photo).convert("RGB")
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        if "truncated" in str(error).lower():
            raise UnreadableMedia(f"{path}: {_what_is_left(path)}; copy it again.") from None
        raise UnreadableMedia(f"{path}: cannot be decoded as a photo; give a JPEG, PNG, TIFF or HEIC file.") from None
    return np.ascontiguousarray(np.asarray(upright)[..., ::-1])


def _what_is_left(path: Path) -> str:
    """How much can be read of a photo whose file is cut off."""
    from PIL import ExifTags, ImageFile
    from PIL import Image as Pictures

    before, ImageFile.LOAD_TRUNCATED_IMAGES = ImageFile.LOAD_TRUNCATED_IMAGES, True
    try:
        with Pictures.open(path) as photo:
            whole = bool(photo.info.get("progressive") or photo.info.get("interlace"))
            turned = photo.getexif().get(ExifTags.Base.Orientation, 1) != 1
            rows = np.asarray(photo.convert("RGB"))
    except (OSError, ValueError, SyntaxError):
        return "the file is cut off, and nothing of the photo can be read"
    finally:
        ImageFile.LOAD_TRUNCATED_IMAGES = before
    # what is missing is filled with one grey, or goes on as the last row that is there
    seen = np.flatnonzero(np.any(rows != rows[-1], axis=(1, 2)))
    there = int(seen[-1]) + 1 if len(seen) else 0
    size = f"{rows.shape[1]} x {rows.shape[0]} px"
    if whole or turned or there >= len(rows) - 1:  # a coarse whole, a part to one side, or all but the end
        return f"the file is cut off: a photo of {size}"
    if there == 0:
        return f"the file is cut off: a photo of {size}, of which only the head can be read"
    return f"the file is cut off: a photo of {size}, of which only the upper {there} rows can be read"


def _must_fit(path: Path, shape: tuple[int, ...], lens: Lens) -> None:
    height, width = shape[:2]
    if (width, height) != lens.size:
        raise BadInput(
            f"{path}: has {width} x {height} px, the board was photographed with {lens.size[0]} x {lens.size[1]} px; "
            "photograph the board with the same camera, lens and resolution."
        )


def _must_exist(path: Path, kind: str) -> None:
    if not path.exists():
        raise UnreadableMedia(f"{path}: no such file; check the path of the {kind}.")
    if path.is_dir():
        if kind == "video":
            return  # of numbered pictures
        raise UnreadableMedia(f"{path}: is a folder, not a {kind}; give the file itself.")
    if path.stat().st_size == 0:
        raise UnreadableMedia(f"{path}: is empty (0 bytes); copy the {kind} again.")


def _time_base(
    stamps: Sequence[float | None], stated: float, tick: float, given: float | None
) -> tuple[npt.NDArray[np.float64], float, list[str]]:
    """Capture time of every picture, the rate at which the file plays, and what is odd about the file's own stamps.

    `stated` is the file's rate, `given` the capture rate where it is known [1/s], `tick` the unit of the stamps [s].
    """
    rate = given or stated
    index = np.arange(len(stamps), dtype=np.float64)
    if all(stamp is None for stamp in stamps):  # stills know no time
        return index / rate, stated, []
    if any(stamp is None for stamp in stamps):
        note = "frame times: the file has pictures without a time stamp; frames are counted instead."
        return index / rate, stated, [note]
    times = np.array(stamps, dtype=np.float64)
    times = times - times[0]
    if backwards := int(np.sum(np.diff(times) <= 0)):
        return (
            index / rate,
            stated,
            [
                f"frame times: {backwards} of the file's time stamps run backwards or repeat "
                "(typical of H.264 with B-frames in AVI); used frame index / frame rate instead."
            ],
        )
    if _even(times, tick, [known for known in (given, stated) if known]):
        plays_at, notes = _played(float(np.polyfit(index, times, 1)[0]), stated, tick / times[-1])
        rate = given or plays_at
        return index / rate, plays_at, notes + _stored_slow(plays_at, given)
    times = _unrounded(times, tick, stated)
    steps = np.diff(times)
    step, lost = _full_step(steps)
    plays_at, notes = _played(step, stated, tick / times[-1], 1 / float(np.mean(steps)))
    odd = int(np.sum(np.abs(steps - step) > 0.05 * step))
    rates = [1 / step, 1 / float(np.median(steps)), 1 / float(np.mean(steps)), plays_at]
    if given is None or any(abs(real / given - 1) < SAME_RATE for real in rates):
        # stamps of a file that plays as fast as it was captured are true times, dropped frames or not
        used = "the file's own time stamps were used"
    else:
        times = times / step / given
        used = f"the file's own time stamps were used, stretched from {1 / step:.4g} Hz to {given:.4g} Hz"
    missing = f"; {lost} frame{'s' * (lost != 1)} between them {'are' if lost != 1 else 'is'} missing" if lost else ""
    told = (
        f"frame times: {odd} of {len(steps)} frame intervals differ by more than 5 % from {step * 1e3:.2f} ms{missing}"
    )
    return times, plays_at, [*notes, f"{told}; {used}."]


def _even(times: npt.NDArray[np.float64], tick: float, known: Sequence[float]) -> bool:
    """Whether the steps are equal but for the rounding of the stamps to ticks; `known` rates [1/s]."""
    steps = np.diff(times)
    index = np.arange(len(times))
    if tick < FRAME_LIKE * float(np.median(steps)):
        line = np.polyfit(index, times, 1)
        return bool(np.max(np.abs(np.polyval(line, index) - times)) <= max(0.8 * tick, 0.02 * line[0]))
    # in ticks about as long as a frame every fourth picture lost looks like rounded steps a third longer: only a rate
    # that is known to be no whole number of ticks makes rounded steps of them
    if np.ptp(steps) < 0.5 * tick:
        return True
    rounded = [rate for rate in known if abs(1 / rate / tick - round(1 / rate / tick)) > WHOLE]
    return any(float(np.ptp(times - index / rate)) <= (1 + COARSE) * tick for rate in rounded)


def _played(step: float, stated: float, doubt: float, mean: float = 0.0) -> tuple[float, list[str]]:
    """Rate at which a film of such a step [s] plays; `doubt` of the step, relative, `mean` rate with all that is lost.

    The stated rate is the sharper one as long as the stamps do not contradict it.
    """
    if not stated > 0:
        return 1 / step, []
    if abs(step * stated - 1) <= WRONG_HEADER + doubt or (mean and abs(stated / mean - 1) <= SAME_RATE):
        return stated, []
    return 1 / step, [
        f"frame times: the file's head states {stated:.4g} Hz, its time stamps are {step * 1e3:.2f} ms apart, which is "
        f"{1 / step:.4g} Hz; the time stamps were believed."
    ]


def _stored_slow(plays_at: float, given: float | None) -> list[str]:
    if given is None or abs(plays_at / given - 1) < SAME_RATE:
        return []
    why = "high-speed footage stored slow" if given > plays_at else "a time lapse, or frames shown twice"
    return [
        f"frame times: the file plays at {plays_at:.4g} Hz, --frame-rate gives {given:.4g} Hz: read as {why}; "
        "if it plays in real time, leave out --frame-rate."
    ]


def _full_step(steps: npt.NDArray[np.float64]) -> tuple[float, int]:
    """The step [s] between pictures of which none is lost between them, and how many are lost in all.

    The usual one, unless shorter ones occur of which all are whole multiples: then every second is lost in most places.
    """
    usual = float(np.median(steps))
    for guess in (float(np.percentile(steps, FULL_RATE)), usual):
        whole = np.maximum(np.rint(steps / guess), 1)
        step = float(np.sum(steps) / np.sum(whole))
        # stamps may have been rounded to milliseconds before they came into this file
        if np.mean(np.abs(steps / step - whole) < 0.25) > 0.95:
            return step, int(np.sum(whole - 1))
    return usual, 0


def _unrounded(times: npt.NDArray[np.float64], tick: float, stated: float) -> npt.NDArray[np.float64]:
    """Stamps in coarse ticks [s], from 0, put back to whole multiples of one interval where they all fit such ones.

    Matroska counts milliseconds: a quarter of a frame at 240 Hz, in which a fast bead goes several pixels.
    """
    steps = np.diff(times)
    if tick < COARSE * float(np.median(steps)):
        return times
    for guess in (float(np.median(steps)), float(np.percentile(steps, FULL_RATE))):
        interval = guess
        for _ in range(3):  # the step itself is a whole number of ticks
            places = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / interval), 1))])
            interval, first = (float(each) for each in np.polyfit(places, times, 1))
        if np.max(np.abs(first + interval * places - times)) <= 0.8 * tick:
            # the stated rate is the truer one where the stamps, each a tick off at most, cannot tell the two apart
            return places * (1 / stated if abs(interval * stated - 1) < tick / times[-1] else interval)
    return times


def _ends_before(end: Moment | None, times: npt.NDArray[np.float64]) -> list[str]:
    """What is said of a clip without the moment asked for; its last picture is shown until the next would come."""
    count = len(times)
    shown = float(times[-1] + np.max(np.diff(times)))
    # a length that a player or a person has rounded, to a hundredth of a second, is that of the clip
    beyond = end is not None and end.value > (count if end.unit == "frame" else shown + ROUNDED)
    if end is None or not beyond:
        return []
    asked = f"{end.value:g} s" if end.unit == "s" else f"{end.value:g}f"
    return [
        f"--end {asked} lies beyond the clip, whose last picture ({count - 1}f) is of {times[-1]:.4g} s: all of it was "
        "measured; check --end, and --frame-rate, by which seconds count."
    ]


def _frame_of(moment: Moment | None, times: npt.NDArray[np.float64], default: int) -> int:
    if moment is None:
        return default
    frame = moment.value if moment.unit == "frame" else float(np.searchsorted(times, moment.value - 1e-9))
    return int(min(max(frame, 0), len(times) - 1))
