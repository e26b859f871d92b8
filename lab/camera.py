"""What the experimenter says about the camera: rate, scale, region, time window, roll.

The same words are options of ``rigtwin measure`` and keys of ``[experiments.camera]`` in lab.toml.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigtwin.lab.errors import BadInput, BadQuantity
from rigtwin.lab.units import si

FASTEST = 1e8  # [1/s], no camera films faster; a larger rate is a slip of the pen


@dataclass(frozen=True)
class KnownLength:
    """A length in view and the two picture points it spans."""

    length: float  # [m]
    start: tuple[float, float]  # [px], x to the right, y down, centre of the top-left pixel is (0, 0)
    end: tuple[float, float]  # [px]

    @property
    def scale(self) -> float:
        """[m/px]"""
        dx, dy = self.end[0] - self.start[0], self.end[1] - self.start[1]
        return self.length / float((dx * dx + dy * dy) ** 0.5)


@dataclass(frozen=True)
class Moment:
    """A point in the clip, as a time in seconds of capture time or as a frame number."""

    value: float
    unit: str  # "s" or "frame"


@dataclass(frozen=True)
class Camera:
    """All that is known of the camera beforehand; None is "not given", never a default."""

    frame_rate: float | None = None  # [1/s], capture rate; high-speed files often play at another rate
    scale: float | None = None  # [m/px], at the bead's distance
    known_length: KnownLength | None = None
    region: tuple[float, float, float, float] | None = None  # [px], x, y, width, height
    start: Moment | None = None
    end: Moment | None = None
    roll: float | None = None  # [rad], positive when the scene looks turned clockwise in the picture

    def __post_init__(self) -> None:
        for name in ("frame_rate", "scale"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise BadInput(f"the camera's {name.replace('_', ' ')} must be positive, got {value:g}.")
        if self.frame_rate is not None and self.frame_rate > FASTEST:
            raise BadInput(f"the camera's frame rate cannot be {self.frame_rate:g} Hz; write it like '240 Hz'.")
        start, end = self.start, self.end
        if start and end and start.unit == end.unit and start.value >= end.value:
            raise BadInput(f"end ({end.value:g} {end.unit}) is not after start ({start.value:g} {start.unit}).")

    @property
    def given_scale(self) -> float | None:
        """[m/px] from `scale` or `known_length`, None when neither was given."""
        if self.scale is not None:
            return self.scale
        return self.known_length.scale if self.known_length is not None else None


def known_length(text: str, *, name: str = "known_length") -> KnownLength:
    """Parse ``"100mm:x1,y1,x2,y2"`` (pixels).

    >>> known_length("100 mm:10,20,510,20").scale
    0.0002
    """
    length_text, _, points = text.partition(":")
    coordinates = _floats(points, 4, name, "100mm:x1,y1,x2,y2")
    length = si(length_text, "length", name=name)
    line = KnownLength(length, (coordinates[0], coordinates[1]), (coordinates[2], coordinates[3]))
    if length <= 0 or line.start == line.end:
        raise BadQuantity(f"{name}: {text!r} spans no length; give two different points and a positive length.")
    return line


def region(text: str, *, name: str = "region") -> tuple[float, float, float, float]:
    """Parse ``"x,y,width,height"`` in pixels."""
    x, y, width, height = _floats(text, 4, name, "x,y,width,height")
    if width <= 0 or height <= 0:
        raise BadQuantity(f"{name}: {text!r} is empty; width and height must be positive pixels.")
    return x, y, width, height


def moment(text: str | float, *, name: str = "start") -> Moment:
    """Parse a time ("0.25 s") or a frame number ("60 frames", "60f").

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


def roll(text: str | float, *, name: str = "camera_roll") -> float:
    """Parse a camera roll [rad]; a bare number would be radians, and 1.5 of them are no roll."""
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
