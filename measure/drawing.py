"""Draw annotations on pictures and save pictures, plots and overlay videos.

Coordinates are sub-pixel picture coordinates (x right, y down, centre of the top-left pixel (0, 0)); images are BGR.
Files are written under a temporary name and then renamed, so that a crash leaves no incomplete file.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import FloatImage, Image
from rigtwin.lab.errors import BadInput
from rigtwin.lab.output_files import naming, replacing
from rigtwin.lab.quantity import Measurement

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Point = tuple[float, float]
Colour = tuple[int, int, int]

# BGR; distinguishable with colour blindness (Okabe and Ito 2008)
ORANGE: Colour = (0, 159, 230)
SKY: Colour = (233, 180, 86)
GREEN: Colour = (115, 158, 0)
YELLOW: Colour = (66, 228, 240)
BLUE: Colour = (178, 114, 0)
RED: Colour = (0, 94, 213)
WHITE: Colour = (255, 255, 255)

CAPITAL = 0.7  # height of a capital letter relative to the font size, for OpenCV's font "sans"
WEIGHT = 600  # font weight, semi-bold for legibility on any background
LONGEST_SIDE = 16384  # [px], of pictures that x264 takes
_SUBPIXEL_BITS = 4  # OpenCV draws in sixteenths of a pixel


class OverlayVideo:
    """An H.264 file for all players and browsers, written picture by picture.

    >>> with OverlayVideo(path, frame_rate=30) as video:  # doctest: +SKIP
    ...     video.write(picture)
    """

    def __init__(self, path: Path, *, frame_rate: float) -> None:
        """`frame_rate` is the playback rate of the overlay [1/s], not the capture rate of the clip."""
        self.path = path
        self._files = ExitStack()
        self._part = self._files.enter_context(replacing(path))
        with naming(path):
            self._container = av.open(f"file:{self._part.absolute()}", "w", format="mp4")
        self._rate = Fraction(frame_rate).limit_denominator(1000)
        self._stream: av.VideoStream | None = None

    def write(self, picture: Image) -> None:
        """Append one BGR picture, shape (height, width, 3); all must have the size of the first."""
        if self._stream is None:
            self._stream = self._open_stream(picture)
        height, width = self._stream.height, self._stream.width
        # 4:2:0 chroma subsampling needs even sides: an odd last row or column is dropped
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture[:height, :width]), format="bgr24")
        self._add(frame)

    def _open_stream(self, picture: Image) -> av.VideoStream:
        if max(picture.shape) > LONGEST_SIDE:
            size = f"{picture.shape[1]} x {picture.shape[0]}"
            raise BadInput(f"{self.path}: H.264 films have at most {LONGEST_SIDE} px a side, not {size}; use --region.")
        stream = self._container.add_stream("libx264", rate=self._rate, options={"preset": "ultrafast", "crf": "22"})
        stream.height, stream.width = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2
        stream.pix_fmt = "yuv420p"
        return stream

    def __enter__(self) -> OverlayVideo:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        whole = kind is None and self._stream is not None
        with self._files:
            try:
                if whole:
                    self._add(None)
            finally:
                with naming(self.path), suppress(*() if whole else (av.FFmpegError,)):
                    self._container.close()
            if not whole:
                self._part.unlink(missing_ok=True)

    def _add(self, frame: av.VideoFrame | None) -> None:
        """Append a frame; None for the last ones, which the encoder holds back."""
        assert self._stream is not None
        with naming(self.path):
            try:
                packets = self._stream.encode(frame)
            except av.error.ExternalError as error:  # x264 states no reason; size and kind of the pictures fit
                raise MemoryError from error
            for packet in packets:
                self._container.mux(packet)


def save_picture(path: Path, picture: Image) -> None:
    """Write a BGR picture; the file extension sets the format."""
    path.parent.mkdir(parents=True, exist_ok=True)
    written, data = cv2.imencode(path.suffix, picture)
    if not written:
        raise BadInput(f"{path}: cannot write a picture with this file extension; use .png or .jpg.")
    with replacing(path) as part:
        part.write_bytes(data.tobytes())


def save_plot(path: Path, figure: Figure, *, trimmed: bool = True) -> None:
    """Write a matplotlib figure; the file extension sets the format, in which text stays text.

    `trimmed` removes the white border, which takes as long as drawing; not needed for a figure with set margins.
    """
    import matplotlib

    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as part, matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(part, format=path.suffix.lstrip("."), bbox_inches="tight" if trimmed else None)


def line_width(picture: Image) -> int:
    """Line width [px] in proportion to the size of the picture."""
    return max(1, round(float(min(picture.shape[:2])) / 700))


def draw_circle(picture: Image, centre: Point, radius: float, colour: Colour, *, width: int | None = None) -> None:
    """Draw a circle at a sub-pixel centre [px]."""
    if not np.all(np.isfinite((*centre, radius))):
        return
    cv2.circle(
        picture,
        _fixed(centre),
        round(max(radius, 0.5) * 2**_SUBPIXEL_BITS),
        colour,
        width or line_width(picture),
        cv2.LINE_AA,
        _SUBPIXEL_BITS,
    )


def draw_dot(picture: Image, centre: Point, colour: Colour, *, radius: float = 1.5) -> None:
    """Draw a filled dot at a sub-pixel centre [px]."""
    if np.all(np.isfinite(centre)):
        cv2.circle(
            picture, _fixed(centre), round(radius * 2**_SUBPIXEL_BITS), colour, cv2.FILLED, cv2.LINE_AA, _SUBPIXEL_BITS
        )


def draw_line(picture: Image, start: Point, end: Point, colour: Colour, *, width: int | None = None) -> None:
    """Draw a straight line between two sub-pixel points [px]."""
    if np.all(np.isfinite((*start, *end))):
        cv2.line(picture, _fixed(start), _fixed(end), colour, width or line_width(picture), cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_path(
    picture: Image,
    points: Sequence[Point] | npt.NDArray[np.float64],
    colour: Colour,
    *,
    width: int | None = None,
    closed: bool = False,
) -> None:
    """Draw a polyline through sub-pixel points [px], shape (n, 2); a point that is not finite interrupts the line."""
    array = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    finite = np.all(np.isfinite(array), axis=1)
    pieces = np.split(np.arange(len(array)), np.flatnonzero(~finite))
    for piece in pieces:
        seen = piece[finite[piece]]
        if len(seen) > 1:
            fixed = np.round(np.clip(array[seen], -1e5, 1e5) * 2**_SUBPIXEL_BITS).astype(np.int32)
            cv2.polylines(
                picture,
                [fixed.reshape(-1, 1, 2)],
                closed,
                colour,
                width or line_width(picture),
                cv2.LINE_AA,
                _SUBPIXEL_BITS,
            )


def draw_cross(picture: Image, centre: Point, size: float, colour: Colour, *, width: int | None = None) -> None:
    """Draw an upright cross with arms of `size` [px]."""
    x, y = centre
    draw_line(picture, (x - size, y), (x + size, y), colour, width=width)
    draw_line(picture, (x, y - size), (x, y + size), colour, width=width)


def draw_text(picture: Image, text: str, corner: Point, colour: Colour = WHITE, *, size: float | None = None) -> None:
    """Draw one line of text with a dark outline.

    `corner` is its bottom-left corner [px]; the text is shifted to lie inside the picture. `size` is the height of a
    capital letter [px].
    """
    if not text or not np.all(np.isfinite(corner)):
        return
    ink, rim, below = _lettering(text, round(size or _letter(picture)))
    height, width = ink.shape
    left = round(min(max(corner[0], 0), max(picture.shape[1] - width, 0)))
    top = round(min(max(corner[1] - height + below, 0), max(picture.shape[0] - height, 0)))
    part = picture[top : top + height, left : left + width]
    ink, rim = (mask[: part.shape[0], : part.shape[1], None] for mask in (ink, rim))
    part[:] = np.clip(part * (1 - rim) + ink * np.array(colour, dtype=np.float32), 0, 255).astype(np.uint8)


def draw_caption(
    picture: Image, lines: Sequence[str | tuple[str, Colour]], *, bottom: bool = False, size: float | None = None
) -> None:
    """Draw lines of text in the top (or bottom) left corner, wrapped to the width of the picture.

    A line may be a pair of text and colour.
    """
    letter = round(size or _letter(picture))
    rows = [
        (row, WHITE if isinstance(line, str) else line[1])
        for line in lines
        for row in _broken(line if isinstance(line, str) else line[0], letter, picture.shape[1] - letter)
    ]
    step = 1.8 * letter
    first = picture.shape[0] - step * (len(rows) - 1) - 0.9 * letter if bottom else 1.6 * letter
    for number, (row, colour) in enumerate(rows):
        draw_text(picture, row, (0.6 * letter, first + step * number), colour, size=letter)


def with_strip_below(picture: Image, lines: Sequence[str]) -> Image:
    """The picture with a dark strip below it that holds the lines of text, wrapped to its width."""
    letter = round(_letter(picture))
    rows = [row for line in lines for row in _broken(line, letter, picture.shape[1] - letter)]
    strip = np.zeros((round(1.8 * letter * (len(rows) + 0.4)), *picture.shape[1:]), dtype=np.uint8)
    draw_caption(strip, rows, size=letter)
    return np.concatenate([picture, strip])


def _letter(picture: Image) -> float:
    """Height of a capital letter [px] that is legible on a picture of this size."""
    return max(9.0, float(min(picture.shape[:2])) / 45)


def _broken(text: str, letter: int, width: float) -> list[str]:
    """The text wrapped to lines of at most `width` [px]."""
    rows: list[str] = []
    for word in text.split(" "):
        if rows and _lettering(f"{rows[-1]} {word}", letter)[0].shape[1] <= width:
            rows[-1] += f" {word}"
        else:
            rows.append(word)
    return rows


@lru_cache(maxsize=256)
def _lettering(text: str, letter: int) -> tuple[FloatImage, FloatImage, int]:
    """Masks of a line of text and of its outline, both 0 to 1, and the number of rows below the base line.

    Cached, because many frames of a clip carry the same text.
    """
    face = cv2.FontFace("sans")
    size = round(letter / CAPITAL)
    # getTextSize excludes the margins left and right of the text
    _, _, width, _ = cv2.getTextSize((1, 1), text, (0, 0), face, size, WEIGHT)
    stroke = max(1, round(letter / 10))
    below = round(0.45 * letter) + stroke
    box = np.zeros((round(1.4 * letter) + stroke + below, width + letter, 3), np.uint8)
    cv2.putText(box, text, (stroke + letter // 4, box.shape[0] - below), (255, 255, 255), face, size, WEIGHT)
    ink = box[..., 0]
    rim = cv2.dilate(ink, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * stroke + 1,) * 2))
    shares = [np.asarray(mask, dtype=np.float32) / np.float32(255) for mask in (ink, rim)]
    return shares[0], shares[1], below


def _fixed(point: Point) -> tuple[int, int]:
    scaled = np.round(np.clip(point, -1e5, 1e5) * 2**_SUBPIXEL_BITS).astype(int)
    return int(scaled[0]), int(scaled[1])


def with_record_plot(measurement: Measurement, out: Path | None) -> Measurement:
    """The measurement with a plot of its record, ``NAME-plot.svg`` in the folder `out`; as it is without a folder."""
    if out is None:
        return measurement
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{measurement.source.stem}-plot.svg"
    save_plot(path, measurement.plot())
    return replace(measurement, files={"plot": path})
