"""What the experimenter says about the camera: rate, scale, region, time window, roll.

The same words are options of ``rigtwin measure`` and keys of ``[experiments.camera]`` in lab.toml.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from rigtwin.lab.errors import BadCamera, BadQuantity, Mark
from rigtwin.lab.units import LONGEST, si

_BOARD = re.compile(
    r"(checkerboard|charuco|aruco)\s+(?:(\d{1,3})x(\d{1,3})\s+)?([\d.]+\s*[a-zµ]*)(?:/([\d.]+\s*[a-zµ]*))?\s+(\S.*)"
)
SHORTEST_LINE = 10.0  # [px], below it a line says nothing of a direction, and a pixel is a tenth of a length
WIDEST_SQUARE = 1.0  # [m], of a board; "10" was meant to be millimetres
WIDEST_PIXEL = 0.1  # [m], of which a picture shows some hundred metres; "0.3" was meant to be millimetres
NARROWEST_PIXEL = 1e-9  # [m/px], far below what light resolves; a unit that was mistaken
SLOWEST = 1e-6  # [1/s], a picture in eleven days
FASTEST = 1e8  # [1/s], no camera films faster; a larger rate is a slip of the pen


STATED_SIGMA = 2.0  # [px], standard uncertainty of a point that the user states, read off the picture by eye
STATED_OFF = 4.0  # standard uncertainties by which what is seen may lie beside a point that is stated
# Relative standard uncertainty of a scale that is stated, where a rig knows no other: as of a length of 280 px between
# two points of STATED_SIGMA each.
STATED_SCALE_UNCERTAINTY = 0.01
# of a camera whose lens is not known: focal length over the picture's width or longer side, between a
# phone (0.75) and a macro lens (3 and more), and the standard deviation of its logarithm
FOCAL_LENGTH, FOCAL_UNCERTAINTY = 2.0, 0.4

Kind = Literal["checkerboard", "charuco", "aruco"]
Point = tuple[float, float]
"""A place in the picture [px], x to the right, y down, centre of the top-left pixel is (0, 0)."""
Line = tuple[Point, Point]
Flank = Literal["left", "right", "both"]


@dataclass(frozen=True)
class KnownLength:
    """A length in view and the two picture points it spans."""

    length: float  # [m]
    start: Point
    end: Point

    @property
    def scale(self) -> float:
        """Length of a pixel [m/px]."""
        dx, dy = self.end[0] - self.start[0], self.end[1] - self.start[1]
        return self.length / float((dx * dx + dy * dy) ** 0.5)


@dataclass(frozen=True)
class Moment:
    """A point in the clip, as a time in seconds of capture time or as a frame number."""

    value: float
    unit: str  # "s" or "frame"


@dataclass(frozen=True)
class Seed:
    """Where a body is in one frame."""

    frame: int
    at: Point

    def __str__(self) -> str:
        return f"{self.frame}:{self.at[0]:g},{self.at[1]:g}"


@dataclass(frozen=True)
class Board:
    """A flat board of known pattern, photographed where the motion is."""

    kind: Kind
    columns: int  # squares; 1 for a single ArUco marker
    rows: int  # squares
    square: float  # [m], side of a square, or of the single marker
    marker: float | None  # [m], side of a ChArUco board's markers
    photo: Path


@dataclass(frozen=True)
class Lens:
    """How pixels of a straight picture map to pixels of the picture as taken; made from a `Board`."""

    size: tuple[int, int]  # [px], width and height of the picture
    plane: tuple[tuple[float, ...], ...]  # homography, straight to taken without distortion, shape (3, 3)
    bend: tuple[float, float]  # radial distortion, of the square and fourth power of radius / half the diagonal
    scale: float  # [m/px] of the straight picture
    uncertainty: float  # relative standard uncertainty of the scale from the corners, without that of the board's place
    residual: float  # [px], rms of the board's corners


@dataclass(frozen=True)
class Camera:
    """All that is known of the camera beforehand; None is "not given", never a default."""

    frame_rate: float | None = None  # [1/s], capture rate; high-speed files often play at another rate
    scale: float | None = None  # [m/px], at the bead's distance
    known_length: KnownLength | None = None
    region: tuple[float, float, float, float] | None = None  # [px], x, y, width, height
    start: Moment | None = None
    end: Moment | None = None
    exclude: tuple[tuple[Moment, Moment], ...] = ()  # first and last moment of each part of the clip that is left out
    roll: float | None = None  # [rad], positive when the scene looks turned clockwise in the picture
    board: Board | None = None
    lens: Lens | None = None  # what the board says; all places below and above are of straight pictures then
    # what is stated instead of being found in the picture; used as stated, with the uncertainty STATED_SIGMA
    ignore: tuple[tuple[float, float, float, float], ...] = ()  # [px], x, y, width, height of each
    bead_at: Seed | None = None  # drop, tilt: where the track begins
    centre: tuple[Seed, ...] = ()  # drop, pendulum, tilt: centre of a body in frames in which it is not located rightly
    plate: Line | None = None  # drop: surface that the bead hits; tilt: surface of the plate in the first frame
    pivots: tuple[Point, ...] = ()  # pendulum: hinge of bead A, and of bead B
    base: Line | None = None  # pile: left and right end of the line that the heap stands on
    flank: Flank | None = None  # pile: the flanks that are measured
    cylinder: Line | None = None  # packing: inner walls at the floor
    floor: float | None = None  # [px] packing: y of the floor
    circle: tuple[float, float, float] | None = None  # [px] drum: centre x, y and radius of the inner rim
    averaged: bool = False  # drum: each picture is a mean over time, not one moment
    slot: Line | None = None  # hopper: the two edges of the outlet

    def __post_init__(self) -> None:
        if faults := tuple(self._faults()):
            name, why = faults[0]
            raise BadCamera(f"--{name.replace('_', '-')}: {why}", faults)

    def _faults(self) -> Iterator[tuple[str, str]]:
        """Keys with values that cannot be or contradict another key, and what is wrong."""
        length = self.known_length
        for name, value, least, most, rest in (
            ("frame_rate", self.frame_rate, SLOWEST, FASTEST, "Hz; write it like '240 Hz'."),
            ("scale", self.scale, NARROWEST_PIXEL, WIDEST_PIXEL, "m in a pixel; write it like '0.2 mm/px'."),
            ("known_length", None if length is None else length.scale, NARROWEST_PIXEL, WIDEST_PIXEL,
             "m in a pixel; give the length with its unit and the pixels that it spans, like '100mm:120,40,620,40'."),
        ):  # fmt: skip
            if value is not None and not (math.isfinite(value) and value > 0):
                yield name, f"must be positive, got {value:g}."
            elif value is not None and not least <= value <= most:
                yield name, f"cannot be {value:g} {rest}"
        if self.scale is not None and self.known_length is not None:
            yield "known_length", "a scale is given too; leave one of them out."
        if self.board is not None and self.lens is None and self.given_scale is not None:
            yield "board", "a scale or a known length is given too; leave one of them out."
        if len(self.pivots) > 2:
            yield "pivot", f"{len(self.pivots)} are given; a pendulum has one or two."
        for name, line in {"base": self.base, "cylinder": self.cylinder, "slot": self.slot}.items():
            if line is not None and abs(line[1][1] - line[0][1]) > abs(line[1][0] - line[0][0]):
                ends = " and ".join(f"{x:g},{y:g}" for x, y in line)
                yield name, f"names points at {ends}, more above than beside each other; give its left and right end."
        start, end = self.start, self.end
        if start and end and start.unit == end.unit and start.value >= end.value:
            yield "end", f"{end.value:g} {end.unit} is not after the start ({start.value:g} {start.unit})."

    def places(self) -> Iterator[Mark]:
        """Yield every point, line and circle that is stated.

        Yields
        ------
        Mark
            The place, labelled with the option that states it, and its frame if it is one of a single frame.
        """
        length = self.known_length
        lines = {
            "--known-length": None if length is None else (length.start, length.end),
            "--plate": self.plate,
            "--base": self.base,
            "--cylinder": self.cylinder,
            "--slot": self.slot,
        }
        yield from (Mark(option, ends) for option, ends in lines.items() if ends is not None)
        yield from (Mark("--pivot", [pivot]) for pivot in self.pivots)
        if self.bead_at is not None:
            yield Mark("--bead-at", [self.bead_at.at], frames=[self.bead_at.frame])
        yield from (Mark("--centre", [centre.at], frames=[centre.frame]) for centre in self.centre)
        if self.floor is not None:
            yield Mark("--floor", [(0.0, self.floor)])
        if self.circle is not None:
            yield Mark("--circle", [self.circle[:2]], self.circle[2])

    @property
    def stated(self) -> tuple[str, ...]:
        """Names of what is used as stated instead of being found."""
        found = ("bead_at", "centre", "plate", "pivots", "base", "flank", "cylinder", "floor", "circle", "slot")
        names = (*found, "averaged")
        return tuple(name for name in names if getattr(self, name) not in (None, (), False))

    @property
    def stated_options(self) -> tuple[str, ...]:
        """The places that are used as stated instead of being found, as options with their values."""
        lines = {"--plate": self.plate, "--base": self.base, "--cylinder": self.cylinder, "--slot": self.slot}
        numbers: list[tuple[str, tuple[float, ...]]] = [
            *((option, (*line[0], *line[1])) for option, line in lines.items() if line is not None),
            *(("--pivot", pivot) for pivot in self.pivots),
            *([] if self.floor is None else [("--floor", (self.floor,))]),
            *([] if self.circle is None else [("--circle", self.circle)]),
        ]
        seeds = [("--bead-at", self.bead_at)] if self.bead_at is not None else []
        seeds += [("--centre", centre) for centre in self.centre]
        return (
            *(f"{option} {','.join(f'{number:g}' for number in values)}" for option, values in numbers),
            *(f"{option} {seed}" for option, seed in seeds),
        )

    @property
    def stated_view(self) -> dict[str, list[str]]:
        """`stated` for the JSON document of a measurement; empty where nothing is stated."""
        return {"stated": list(self.stated)} if self.stated else {}

    @property
    def given_scale(self) -> float | None:
        """Length of a pixel [m/px] from `scale` or `known_length`; None when neither was given."""
        if self.scale is not None:
            return self.scale
        return self.known_length.scale if self.known_length is not None else None

    @property
    def scale_from(self) -> str:
        """Where `given_scale` comes from: "board", "given" as a number, or "known length"."""
        if self.lens is not None:
            return "board"
        return "given" if self.scale is not None else "known length"

    def scale_uncertainty(self, by_hand: float = STATED_SCALE_UNCERTAINTY) -> float:
        """Return the relative standard uncertainty of `given_scale`.

        Parameters
        ----------
        by_hand : float
            That of a scale that was read off [1].

        Returns
        -------
        float
            The board's own, where there is one, else `by_hand` [1].
        """
        return by_hand if self.lens is None else self.lens.uncertainty


def camera_for_each(camera: Camera | Sequence[Camera], media: Sequence[Path]) -> dict[Path, Camera]:
    """Return the camera of each photo.

    Parameters
    ----------
    camera : Camera or sequence of Camera
        The same one for all, or one each in the order of the photos.
    media : sequence of Path
        Photos, in the order of the cameras.

    Returns
    -------
    dict of Path to Camera
        By photo.
    """
    cameras = [camera] * len(media) if isinstance(camera, Camera) else camera
    return dict(zip(media, cameras, strict=True))


def known_length(text: str, *, name: str = "known_length") -> KnownLength:
    """Read a known length.

    Parameters
    ----------
    text : str
        ``"100mm:x1,y1,x2,y2"``: the length, and its ends in the picture [px].
    name : str
        The setting that errors name.

    Returns
    -------
    KnownLength
        The length.

    Raises
    ------
    BadQuantity
        If the text is not like this, its ends are less than `SHORTEST_LINE` apart, or its length is not positive or is
        above `LONGEST`.

    Examples
    --------
    >>> known_length("100 mm:10,20,510,20").scale
    0.0002
    """
    length_text, _, points = text.partition(":")
    coordinates = _floats(points, 4, name, "100mm:x1,y1,x2,y2")
    length = si(length_text, "length", name=name)
    line = KnownLength(length, (coordinates[0], coordinates[1]), (coordinates[2], coordinates[3]))
    _apart(line.start, line.end, text, name)
    if length <= 0:
        raise BadQuantity(f"{name}: {text!r} spans no length; give a positive length.")
    if length > LONGEST:
        raise BadQuantity(f"{name}: {text!r} is {length:g} m long; write the length with its unit, like '100mm:...'.")
    return line


def _apart(first: Point, second: Point, text: str, name: str) -> None:
    """Refuse a line between two points that lie too near to each other."""
    if math.dist(first, second) < SHORTEST_LINE:
        raise BadQuantity(f"{name}: {text!r} is shorter than {SHORTEST_LINE:g} pixels; give two points far apart.")


def board(text: str, *, name: str = "board") -> Board:
    """Read the description of a calibration board.

    Parameters
    ----------
    text : str
        ``"checkerboard 9x6 10mm board.jpg"``, ``"charuco 8x5 20mm/15mm board.jpg"`` or ``"aruco 40mm board.jpg"``:
        numbers of squares, their size, the size of markers, and the photo.
    name : str
        The setting that errors name.

    Returns
    -------
    Board
        The board.

    Raises
    ------
    BadQuantity
        If the text is not like this, or there is no such board.

    Examples
    --------
    >>> board("charuco 8x5 20mm/15mm board.png").marker
    0.015
    """
    found = _BOARD.fullmatch(text.strip())
    if found is None:
        raise BadQuantity(
            f"{name}: {text!r} is no board; write it like 'checkerboard 9x6 10mm board.jpg', "
            "'charuco 8x5 20mm/15mm board.jpg' or 'aruco 40mm board.jpg'."
        )
    kind, columns, rows, square, marker, photo = found.groups()
    if (kind == "aruco") != (columns is None) or (kind == "charuco") != (marker is not None):
        raise BadQuantity(
            f"{name}: {text!r}: a checkerboard has squares (9x6) and their size, a ChArUco board the markers' size too "
            "(20mm/15mm), an ArUco marker its size alone."
        )
    sides = [si(side, "length", name=name) for side in (square, marker) if side is not None]
    if min(sides) <= 0 or (len(sides) == 2 and sides[1] >= sides[0]):
        raise BadQuantity(f"{name}: {text!r}: sizes must be positive, and markers smaller than their squares.")
    if max(sides) > WIDEST_SQUARE:
        raise BadQuantity(
            f"{name}: {text!r} has squares of {max(sides):g} m; write sizes with their unit, like '10mm'."
        )
    if kind != "aruco" and min(int(columns), int(rows)) < 3:
        raise BadQuantity(f"{name}: {text!r}: a board of fewer than 3 x 3 squares shows too few corners.")
    return Board(
        cast(Kind, kind),
        int(columns or 1),
        int(rows or 1),
        sides[0],
        sides[1] if len(sides) == 2 else None,
        Path(photo),
    )


def plumb_line(text: str, *, name: str = "plumb_line") -> float:
    """Read the roll of the camera from two points of a plumb line in the picture.

    Parameters
    ----------
    text : str
        ``"x1,y1,x2,y2"`` [px].
    name : str
        The setting that errors name.

    Returns
    -------
    float
        Roll [rad], positive when the scene looks turned clockwise in the picture.

    Raises
    ------
    BadQuantity
        If the text is not like this, or the points are too near or nearer to the horizontal.

    Examples
    --------
    >>> round(math.degrees(plumb_line("100,0,90,500")), 3)
    1.146
    """
    x1, y1, x2, y2 = _floats(text, 4, name, "x1,y1,x2,y2")
    if y1 > y2:
        x1, y1, x2, y2 = x2, y2, x1, y1
    _apart((x1, y1), (x2, y2), text, name)
    angle = math.atan2(x1 - x2, y2 - y1)
    if abs(angle) > math.pi / 4:
        raise BadQuantity(f"{name}: {text!r} is nearer to the picture's horizontal; give two points of a plumb line.")
    return angle


def region(text: str, *, name: str = "region") -> tuple[float, float, float, float]:
    """Read a rectangle in the picture.

    Parameters
    ----------
    text : str
        ``"x,y,width,height"`` [px].
    name : str
        The setting that errors name.

    Returns
    -------
    tuple of float
        x, y, width and height [px].

    Raises
    ------
    BadQuantity
        If the text is not like this, or the rectangle is empty.
    """
    x, y, width, height = _floats(text, 4, name, "x,y,width,height")
    if width <= 0 or height <= 0:
        raise BadQuantity(f"{name}: {text!r} is empty; width and height must be positive pixels.")
    return x, y, width, height


def line(text: str, *, name: str = "base") -> Line:
    """Read two points of a line in the picture.

    Parameters
    ----------
    text : str
        ``"x1,y1,x2,y2"`` [px].
    name : str
        The setting that errors name.

    Returns
    -------
    Line
        The points [px], from left to right.

    Raises
    ------
    BadQuantity
        If the text is not like this, or the points are too near.

    Examples
    --------
    >>> line("500,310,100,300")
    ((100.0, 300.0), (500.0, 310.0))
    """
    x1, y1, x2, y2 = _floats(text, 4, name, "x1,y1,x2,y2")
    _apart((x1, y1), (x2, y2), text, name)
    first, second = sorted([(x1, y1), (x2, y2)])
    return first, second


def point(text: str, *, name: str = "pivot") -> Point:
    """Read a point in the picture.

    Parameters
    ----------
    text : str
        ``"x,y"`` [px].
    name : str
        The setting that errors name.

    Returns
    -------
    Point
        The point [px].

    Raises
    ------
    BadQuantity
        If the text is not like this.
    """
    x, y = _floats(text, 2, name, "x,y")
    return x, y


def circle(text: str, *, name: str = "circle") -> tuple[float, float, float]:
    """Read a circle in the picture.

    Parameters
    ----------
    text : str
        ``"cx,cy,r"`` [px].
    name : str
        The setting that errors name.

    Returns
    -------
    tuple of float
        x and y of the centre, and radius [px].

    Raises
    ------
    BadQuantity
        If the text is not like this, or the radius is too small.
    """
    x, y, radius = _floats(text, 3, name, "cx,cy,r")
    if radius <= SHORTEST_LINE:
        raise BadQuantity(f"{name}: {text!r} has a radius of at most {SHORTEST_LINE:g} pixels; give the inner rim.")
    return x, y, radius


def height(text: str | float, *, name: str = "floor") -> float:
    """Read a height in the picture.

    Parameters
    ----------
    text : str or float
        ``"y"`` [px].
    name : str
        The setting that errors name.

    Returns
    -------
    float
        y [px].

    Raises
    ------
    BadQuantity
        If the text is not like this.
    """
    return _floats(str(text), 1, name, "y")[0]


def seed(text: str, *, name: str = "bead_at") -> Seed:
    """Read where a body is in one frame.

    Parameters
    ----------
    text : str
        ``"frame:x,y"`` [px].
    name : str
        The setting that errors name.

    Returns
    -------
    Seed
        Frame and place.

    Raises
    ------
    BadQuantity
        If the text is not like this.

    Examples
    --------
    >>> seed("12:310,88.5")
    Seed(frame=12, at=(310.0, 88.5))
    """
    frame, separator, place = text.partition(":")
    if not separator or not frame.strip().isdigit():
        raise BadQuantity(f"{name}: {text!r} is not of the form 'frame:x,y', like '12:310,88'.")
    x, y = _floats(place, 2, name, "frame:x,y")
    return Seed(int(frame), (x, y))


def moment(text: str | float, *, name: str = "start") -> Moment:
    """Read a time or a frame number.

    Parameters
    ----------
    text : str or float
        ``"0.25 s"``, a number in seconds, ``"60 frames"`` or ``"60f"``.
    name : str
        The setting that errors name.

    Returns
    -------
    Moment
        The moment.

    Raises
    ------
    BadQuantity
        If the text is not like this, or the time is negative.

    Examples
    --------
    >>> moment("60 frames")
    Moment(value=60.0, unit='frame')
    >>> moment("250 ms")
    Moment(value=0.25, unit='s')
    """
    words = str(text).strip().lower()
    for ending in ("frames", "frame", "f"):
        if words.endswith(ending) and words[: -len(ending)].strip().replace(".", "", 1).isdigit():
            return Moment(float(words[: -len(ending)]), "frame")
    time = si(text, "time", name=name)
    if time < 0:
        raise BadQuantity(f"{name}: {text!r} lies before the clip begins; write it like '0.25 s' or '60 frames'.")
    return Moment(time, "s")


def span(text: str, *, name: str = "exclude") -> tuple[Moment, Moment]:
    """Read a part of a clip.

    Parameters
    ----------
    text : str
        ``"60f..80f"`` or ``"0.25 s..0.3 s"``, both ends included.
    name : str
        The setting that errors name.

    Returns
    -------
    tuple of Moment
        First and last moment.

    Raises
    ------
    BadQuantity
        If the text is not like this, mixes a time and a frame, or the part ends before it begins.

    Examples
    --------
    >>> span("60f..80f")
    (Moment(value=60.0, unit='frame'), Moment(value=80.0, unit='frame'))
    """
    parts = text.split("..")
    if len(parts) != 2 or not all(part.strip() for part in parts):
        raise BadQuantity(f"{name}: {text!r} is no part of a clip; write it like '60f..80f' or '0.25 s..0.3 s'.")
    first, last = moment(parts[0], name=name), moment(parts[1], name=name)
    if first.unit != last.unit:
        raise BadQuantity(f"{name}: {text!r} mixes a time and a frame; write it like '60f..80f' or '0.25 s..0.3 s'.")
    if first.value > last.value:
        raise BadQuantity(f"{name}: {text!r} ends before it begins; write the earlier moment first.")
    return first, last


def roll(text: str | float, *, name: str = "camera_roll") -> float:
    """Read the roll of a camera.

    Parameters
    ----------
    text : str or float
        ``"1.5 deg"``, or a number in radians.
    name : str
        The setting that errors name.

    Returns
    -------
    float
        Roll [rad].

    Raises
    ------
    BadQuantity
        If the text is no angle, or one of more than 45 degrees.
    """
    angle = si(text, "angle", name=name)
    if abs(angle) > math.pi / 4:
        raise BadQuantity(
            f"{name}: {text!r} is {math.degrees(angle):.3g} degrees; a roll is small, write it like '1.5 deg'."
        )
    return angle


def _floats(text: str, count: int, name: str, example: str) -> list[float]:
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise BadQuantity(f"{name}: {text!r} is not of the form {example!r}.")
    return numbers
