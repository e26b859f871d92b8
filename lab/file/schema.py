"""What may stand in lab.toml and model.toml, and the sentence that says what is wrong there and on which line.

The classes are the edge: texts with units go in, SI floats come out, an unknown key is an error.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, NamedTuple, TypeVar, cast, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from rigtwin.lab import camera
from rigtwin.lab.custom_rig import DURATION, INTERVAL, End
from rigtwin.lab.drum_flow import FILL
from rigtwin.lab.errors import BadCamera, BadInput, BadLabFile
from rigtwin.lab.file.toml_lines import Key, dotted, key_lines
from rigtwin.lab.input_files import LARGEST_NOTES, lies_outside, read_bytes, why_not_ordinary
from rigtwin.lab.materials import MOST_FRICTION
from rigtwin.lab.media_files import kind_of
from rigtwin.lab.rigs import (
    LIFT_SPEED,
    OUTLET_SHARE,
    RIGS,
    SETTINGS,
    SLOT_LENGTH,
    SLOT_WIDTH,
    UPSIDE_DOWN,
    Hopper,
    Packing,
    RigSettings,
    Tilt,
)
from rigtwin.lab.spelling import near, suggestion
from rigtwin.lab.stl import StlUnit
from rigtwin.lab.stl_grain import MOST_SPHERES, STL_SPHERES
from rigtwin.lab.tracked.columns import parse_columns, parse_joined
from rigtwin.lab.tracked.table import TableOptions
from rigtwin.lab.units import DIMENSIONS, LONGEST, MOST_PARTICLES, si

HERE = Path()


Sphere = tuple[float, float, float, float]
"""Centre and diameter [m]."""
SPHERES: list[list[Any]] = [["-2 mm", 0, 0, "6 mm"], ["2 mm", 0, 0, "6 mm"]]
"""Example of a clump."""

MOST_CLASSES = 2000  # of a size distribution; a laser granulometer gives a hundred, a model.toml up to 1000
SOFTEST = 1e3  # [Pa], assumed: a grain of 10 mm sags by a tenth under its own weight
STIFFEST = 2e12  # [Pa], diamond has 1.2e12; a larger one makes a time step with which no run ends


class Problem(NamedTuple):
    """Something wrong in the file: where, and the rest of the sentence."""

    key: Key
    what: str


@dataclass(frozen=True)
class Document:
    """A TOML file, its content and the line of every key."""

    path: Path
    data: dict[str, Any]
    lines: dict[Key, int]

    def line(self, key: Key) -> int:
        """Return the line of a key, or of the table it should stand in.

        Parameters
        ----------
        key : Key
            Key that is looked up.

        Returns
        -------
        int
            The line, 1 for the first.
        """
        while key not in self.lines:
            key = key[:-1]
        return self.lines[key]

    def error(self, problems: Iterable[Problem]) -> BadLabFile:
        """Return an error with all problems in the order of their lines, each with its line.

        A missing key comes last: it may be the misspelt one.

        Parameters
        ----------
        problems : iterable of Problem
            What is wrong, in any order.

        Returns
        -------
        BadLabFile
            The error; its `faults` has them one by one.
        """
        in_order = sorted(
            dict.fromkeys(problems), key=lambda problem: (problem.key not in self.lines, self.line(problem.key))
        )
        faults = [
            f"line {self.line(one.key)}: {dotted(one.key)}{': ' if one.key else ''}{one.what}" for one in in_order
        ]
        if len(faults) == 1:
            return BadLabFile(f"{self.path}, {faults[0]}")
        return BadLabFile(f"{self.path} has {len(faults)} faults", faults=faults)


def read_document(path: Path, *, made_by: str = "make one with `rigtwin init`") -> Document:
    """Read a TOML file.

    Parameters
    ----------
    path : Path
        Path of the TOML file.
    made_by : str
        How to make one, for the message where it is not there.

    Returns
    -------
    Document
        Content and lines.

    Raises
    ------
    BadLabFile
        If it cannot be read; the message has the line of what is no TOML.
    """
    if why_not_ordinary(path) == "no such file":
        raise BadLabFile(f"{path}: no such file; check the path, or {made_by}.")
    advice = "check the path and its permissions"
    return parsed(path, read_bytes(path, advice=advice, largest=LARGEST_NOTES, refuse=BadLabFile))


def parsed(path: Path, content: bytes) -> Document:
    """Return what is, or shall be, the content of a TOML file.

    Parameters
    ----------
    path : Path
        The file, for messages.
    content : bytes
        Bytes of the file.

    Returns
    -------
    Document
        Content and lines.

    Raises
    ------
    BadLabFile
        If it is no TOML.
    """
    try:
        text = content.decode("utf-8-sig")
        data = tomllib.loads(text)
        lines = key_lines(text)
    except ValueError as error:
        if kind := kind_of(content):
            raise BadLabFile(f"{path}: is {kind}, no text with keys and values (TOML); give a lab.toml.") from None
        if not isinstance(error, UnicodeDecodeError):  # bad syntax, or a number beyond Python's limits
            raise BadLabFile(_syntax_error(path, text, error)) from None
        line = error.object.count(b"\n", 0, error.start) + 1
        raise BadLabFile(f"{path}, line {line}: is not UTF-8 text; save the file as UTF-8.") from None
    except RecursionError as error:  # nesting beyond Python's limits
        raise BadLabFile(_syntax_error(path, text, error)) from None
    return Document(path, data, lines)


def _syntax_error(path: Path, text: str, error: Exception) -> str:
    said = str(error)
    place = re.search(r"\(at line (\d+), column (\d+)\)", said)
    line = int(place[1]) if place else text.rstrip().count("\n") + 1
    reason = re.sub(r"\s*\(at .*\)$", "", said)
    twice = "the key or table stands there twice"
    if re.search(r"[Cc]annot (overwrite a value|declare .* twice)|[Dd]uplicate inline table key", reason):
        reason = twice
    written = text.split("\n")[line - 1].strip()[:60]
    quoted = "" if lies_outside(path, path.parent) else f" in {written!r}"  # a link would show a file elsewhere
    advice = 'write key = "text" or key = number, one per line.'
    if re.search(r"=\s*-?\d+,\d+\s*(#.*)?$", written):
        advice = "write the number with a decimal point instead of a comma."
    elif reason == twice:
        advice = "take one of the two out."
    elif re.search("[\u2018-\u201f]", written.partition("#")[0]):
        advice = 'write straight quotation marks, " and not \u201c or \u201d.'
    return f"{path}, line {line}: not valid TOML ({reason[:1].lower()}{reason[1:]}){quoted}; {advice}"


@dataclass(frozen=True)
class InSi(PlainValidator):
    """Reads a quantity of a dimension of `rigtwin.lab.units`."""

    dimension: str = "number"


def _edge(parse: Callable[[Any], Any], kind: Callable[..., PlainValidator] = PlainValidator) -> PlainValidator:
    def check(value: Any) -> Any:
        try:
            return parse(value)
        except BadInput as error:
            raise ValueError(str(error).removeprefix("value: ")) from None

    return kind(check)


def _is_bare(value: Any) -> bool:
    """Whether a value has no unit."""
    try:
        float(value)
    except (TypeError, ValueError):
        return False
    return True


def _quantity(dimension: str, lowest: float = -math.inf, highest: float = math.inf, *, open_low: bool = True) -> Any:
    def parse(value: Any) -> float:
        number = si(value, dimension)
        too_large = number > highest and not math.isclose(number, highest)  # as radians(175) is another than 175 deg
        if number < lowest or too_large or (open_low and number == lowest):
            bare = dimension != "number" and _is_bare(value)
            unit, example = DIMENSIONS[dimension]
            hint = f"; a bare number is in {unit}, write it with its unit, like {example!r}" if bare else ""
            limits = _limits(lowest, highest, open_low) + ("" if unit == "1" or highest == math.inf else f" {unit}")
            raise BadInput(f"{value!r} is out of range; it must be {limits}{hint}.")
        return number

    return _edge(parse, partial(InSi, dimension=dimension))


def _limits(lowest: float, highest: float, open_low: bool) -> str:
    low = "" if lowest == -math.inf else f"{'above' if open_low else 'at least'} {lowest:g}"
    high = "" if highest == math.inf else f"at most {highest:g}"
    return " and ".join(word for word in (low, high) if word)


def _roll(value: Any) -> float:
    return camera.roll(value, name="value")


def _region(value: Any) -> tuple[float, float, float, float]:
    if isinstance(value, list):
        value = ",".join(str(number) for number in value)
    return camera.region(_text(value, "120,40,640,480"), name="value")


def _known_length(value: Any) -> camera.KnownLength:
    return camera.known_length(_text(value, "100mm:10,20,510,20"), name="value")


def _plumb_line(value: Any) -> float:
    return camera.plumb_line(_text(value, "100,0,90,500"), name="value")


def _board(value: Any) -> camera.Board:
    return camera.board(_text(value, "checkerboard 9x6 10mm board.jpg"), name="value")


def _regions(value: Any) -> tuple[tuple[float, float, float, float], ...]:
    several = value if isinstance(value, list) and not all(isinstance(each, int | float) for each in value) else [value]
    return tuple(_region(each) for each in several)


def _spans(value: Any) -> tuple[tuple[camera.Moment, camera.Moment], ...]:
    several = value if isinstance(value, list) else [value]
    return tuple(camera.span(_text(each, "60f..80f"), name="value") for each in several)


def _points(value: Any) -> tuple[camera.Point, ...]:
    several = value if isinstance(value, list) else [value]
    return tuple(camera.point(_text(each, "320,40"), name="value") for each in several)


def _line(value: Any) -> camera.Line:
    return camera.line(_text(value, "100,300,500,300"), name="value")


def _circle(value: Any) -> tuple[float, float, float]:
    return camera.circle(_text(value, "320,240,200"), name="value")


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise BadInput(f"{value!r} is neither true nor false; write it without quotes.")
    return value


def _floor(value: Any) -> float:
    return camera.height(value, name="value")


def _seed(value: Any) -> camera.Seed:
    return camera.seed(_text(value, "12:310,88"), name="value")


def _seeds(value: Any) -> tuple[camera.Seed, ...]:
    return tuple(_seed(each) for each in (value if isinstance(value, list) else [value]))


def _text(value: Any, example: str) -> str:
    if not isinstance(value, str):
        raise BadInput(f"{value!r} is not a text; write it like {example!r}.")
    return value


class Bracketed(list[str]):
    """Files that stand in brackets: views of one repetition."""


def _views(value: Any) -> list[str]:
    views = [value] if isinstance(value, str) else value
    if not isinstance(views, list) or not views or not all(isinstance(view, str) and view for view in views):
        raise BadInput(f"{value!r} is not a file name; write it like 'r01.mp4', or ['front.jpg', 'left.jpg'].")
    return views if isinstance(value, str) else Bracketed(views)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise BadInput(f"{value!r} is not a whole number of at least 1.")
    if value > MOST_PARTICLES:
        raise BadInput(f"{value!r} is more than the {MOST_PARTICLES} particles that a twin can have.")
    return value


def _clumped(value: Any) -> int:
    return _at_most(_whole(value), MOST_SPHERES)


def _at_most(number: int, most: int) -> int:
    if number > most:
        raise BadInput(f"{number} is more than the {most} spheres that a clump can have.")
    return number


def _spheres(value: Any) -> tuple[Sphere, ...]:
    example = toml(SPHERES)
    if not (isinstance(value, list) and value and all(isinstance(one, list) and len(one) == 4 for one in value)):
        raise BadInput(f"{value!r} is not a list of spheres; write [x, y, z, diameter] of each, like {example}.")
    _at_most(len(value), MOST_SPHERES)
    found = []
    for number, one in enumerate(value, start=1):
        x, y, z, diameter = (si(text, "length", name=f"sphere {number}") for text in one)
        if diameter <= 0 or max(map(abs, (x, y, z, diameter))) > LONGEST:
            hint = "; a bare number is in m, write it with its unit" if any(map(_is_bare, one)) else ""
            raise BadInput(
                f"sphere {number} ({toml(one)}) is out of range; its diameter must be above 0, and no number "
                f"larger than {LONGEST:g} m{hint}."
            )
        found.append((x, y, z, diameter))
    return tuple(found)


def _shares(value: Any) -> tuple[float, ...]:
    return _each(value, "number", [0.3, 0.7])


def _lengths(value: Any) -> tuple[float, ...]:
    found = _each(value, "length", ["4 mm", "6 mm"])
    if min(found) <= 0 or max(found) > LONGEST:
        hint = "; a bare number is in m, write it with its unit" if any(map(_is_bare, value)) else ""
        raise BadInput(f"{toml(value)} is out of range; lengths must be above 0 and at most {LONGEST:g} m{hint}.")
    return found


def _each(value: Any, dimension: str, example: list[Any]) -> tuple[float, ...]:
    if not (isinstance(value, list) and value):
        raise BadInput(f"{value!r} is not a list; write it like {toml(example)}.")
    if len(value) > MOST_CLASSES:
        raise BadInput(f"has {len(value)} numbers, and at most {MOST_CLASSES} are read.")
    return tuple(si(one, dimension) for one in value)


def _gyration(value: Any) -> tuple[float, ...]:
    if not (isinstance(value, list) and len(value) == 3):
        raise BadInput(f"{value!r} is not a list of three moments of inertia over the mass, in m^2.")
    found = tuple(si(one, "area") for one in value)
    if min(found) <= 0:
        raise BadInput(f"{value!r} is out of range; moments of inertia are above 0.")
    return found


def _vector(dimension: str, example: list[Any]) -> Any:
    """Three quantities of a dimension."""

    def parse(value: Any) -> tuple[float, ...]:
        if not (isinstance(value, list) and len(value) == 3):
            raise BadInput(
                f"{value!r} is not a list of three numbers, along x, y and z; write it like {toml(example)}."
            )
        found = tuple(si(one, dimension) for one in value)
        if dimension == "length" and max(map(abs, found)) > LONGEST:
            hint = "; a bare number is in m, write it with its unit" if any(map(_is_bare, value)) else ""
            raise BadInput(f"{toml(value)} is out of range; no length is larger than {LONGEST:g} m{hint}.")
        return found

    return _edge(parse, partial(InSi, dimension=dimension))


def _direction(value: Any) -> tuple[float, ...]:
    if not (isinstance(value, list) and len(value) == 3):
        raise BadInput(f"{value!r} is not a direction; write it like [0, 0, 1].")
    found = tuple(si(one, "number") for one in value)
    if not any(found):
        raise BadInput("a direction of three zeros points nowhere; write it like [0, 0, 1].")
    return found


def _columns(value: Any) -> Mapping[str, tuple[str, str]]:
    return parse_columns(_text(value, "t=time[ms],x=cx,y=cy"), name="value")


def _joined(value: Any) -> tuple[tuple[str, ...], ...]:
    several = value if isinstance(value, list) else [value]
    return parse_joined([_text(each, "3,7") for each in several], name="value")


def _reason(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise BadInput(f"{value!r} is no reason; write in a few words why the file is not used.")
    return " ".join(value.split())


def _moment(value: Any) -> camera.Moment:
    return camera.moment(value, name="value")


Length = Annotated[float, _quantity("length", 0, LONGEST), Field(examples=["6.2 mm"])]
Height = Annotated[float, _quantity("length", 0, LONGEST, open_low=False), Field(examples=["10 mm"])]
Density = Annotated[float, _quantity("density", 0), Field(examples=["568 kg/m^3"])]
Mass = Annotated[float, _quantity("mass", 0), Field(examples=["0.69 g"])]
Modulus = Annotated[float, _quantity("pressure", SOFTEST, STIFFEST, open_low=False), Field(examples=["11 GPa"])]
Poisson = Annotated[float, _quantity("number", 0, 0.499, open_low=False), Field(examples=[0.44])]
Restitution = Annotated[float, _quantity("number", 0, 1), Field(examples=[0.42])]
Friction = Annotated[float, _quantity("number", 0, MOST_FRICTION, open_low=False), Field(examples=[0.36])]
Rate = Annotated[float, _quantity("frequency", 0), Field(examples=["240 Hz"])]
Scale = Annotated[float, _quantity("scale", 0), Field(examples=["0.2 mm/px"])]
Speed = Annotated[float, _quantity("speed", 0), Field(examples=["20 mm/s"])]
Turning = Annotated[float, _quantity("angular_speed", 0), Field(examples=["3 rpm"])]
Tilting = Annotated[float, _quantity("tilting_speed", 0), Field(examples=["2 deg/s"])]
Fraction = Annotated[float, _quantity("number", 0, 1), Field(examples=[0.35])]
Release = Annotated[float, _quantity("angle", 0, UPSIDE_DOWN), Field(examples=["45 deg"])]
Tilted = Annotated[float, _quantity("angle", 0, math.radians(45)), Field(examples=["0.1 deg"])]
Count = Annotated[int, _edge(_whole), Field(examples=[1000])]
Lengths = Annotated[tuple[float, ...], _edge(_lengths)]
Shares = Annotated[tuple[float, ...], _edge(_shares)]
Volume = Annotated[float, _quantity("volume", 0)]
Gyration = Annotated[tuple[float, float, float], _edge(_gyration)]
Clumped = Annotated[int, _edge(_clumped)]
SphereList = Annotated[tuple[Sphere, ...], _edge(_spheres), Field(examples=[SPHERES])]
Moment = Annotated[camera.Moment, _edge(_moment, partial(InSi, dimension="time")), Field(examples=["0.25 s"])]
KnownLength = Annotated[camera.KnownLength, _edge(_known_length)]
PlumbLine = Annotated[float, _edge(_plumb_line)]
Line = Annotated[camera.Line, _edge(_line)]
BeadAt = Annotated[camera.Seed, _edge(_seed)]
Centres = Annotated[tuple[camera.Seed, ...], _edge(_seeds)]
Spans = Annotated[tuple[tuple[camera.Moment, camera.Moment], ...], _edge(_spans)]
Pivots = Annotated[tuple[camera.Point, ...], _edge(_points)]
Flank = camera.Flank
Board = Annotated[camera.Board, _edge(_board)]
Views = Annotated[list[str], _edge(_views)]
Name = Annotated[str, Field(min_length=1)]
Vector = tuple[float, float, float]
LOW: list[Any] = ["-30 mm", "-30 mm", "50 mm"]
HIGH: list[Any] = ["30 mm", "30 mm", "120 mm"]
Place = Annotated[Vector, _vector("length", LOW)]
Velocity = Annotated[Vector, _vector("speed", [0, 0, "20 mm/s"])]
Direction = Annotated[Vector, _edge(_direction)]
Instant = Annotated[float, _quantity("time", 0, open_low=False)]
Span = Annotated[float, _quantity("time", 0)]
PourRate = Annotated[float, _quantity("rate", 0)]
Fall = Annotated[float, _quantity("speed", 0, open_low=False)]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class LabEntry(_Entry):
    """The lab."""

    title: str = Field(
        default="",
        examples=["Ash beads on steel"],
        description="title of the report; by default the name of the folder",
    )


class MaterialEntry(_Entry):
    """What particles and walls are made of; materials of the reference need no entry."""

    density: Density = Field(examples=["720 kg/m^3"], description="of the solid")
    youngs_modulus: Modulus = Field(description="Young's modulus")
    poisson_ratio: Poisson = Field(description="Poisson's ratio")


class SizesEntry(_Entry):
    """Sizes of a particle: diameters of spheres; of clumps the diameters of spheres of their volume."""

    law: Literal["list", "uniform", "normal", "lognormal", "sieve"] = Field(
        examples=["sieve"],
        description=(
            '"list": diameters and shares; "uniform": smallest and largest; "normal": mean and standard_deviation; '
            '"lognormal": median and spread; "sieve": meshes and passing'
        ),
    )
    by: Literal["number", "mass"] | None = Field(
        default=None,
        examples=["mass"],
        description="what the shares or the law count; by default mass for a list and a sieve, number for the others",
    )
    diameters: Lengths | None = Field(default=None, examples=[["4 mm", "6 mm"]], description="list: of each class")
    shares: Shares | None = Field(default=None, examples=[[0.3, 0.7]], description="list: of each class")
    mean: Length | None = Field(default=None, examples=["6 mm"], description="normal: of the diameters")
    standard_deviation: Length | None = Field(
        default=None, examples=["0.5 mm"], description="normal: of the diameters; cut off at three of them"
    )
    median: Length | None = Field(default=None, examples=["6 mm"], description="lognormal: of the diameters")
    spread: Fraction | None = Field(
        default=None,
        examples=[0.2],
        description="lognormal: standard deviation of the logarithm of the diameters; cut off at three of them",
    )
    smallest: Length | None = Field(
        default=None, examples=["4 mm"], description="uniform, normal, lognormal: no diameter is below"
    )
    largest: Length | None = Field(
        default=None, examples=["8 mm"], description="uniform, normal, lognormal: no diameter is above"
    )
    meshes: Lengths | None = Field(
        default=None,
        examples=[["2 mm", "4 mm", "5.6 mm", "8 mm"]],
        description="sieve: openings, rising; nothing passes the first and all the last",
    )
    passing: Shares | None = Field(
        default=None,
        examples=[[0, 20, 70, 100]],
        description="sieve: percent that passes each opening, from 0 to 100",
    )


class ParticleEntry(_Entry):
    """A sphere, or a rigid clump of spheres (own_particles.md); particles of the reference need no entry."""

    material: Name = Field(examples=["wood_ash"], description="its material, of this file or of the reference")
    diameter: Length | None = Field(default=None, description="of a sphere; or spheres, or stl")
    density: Density | None = Field(
        default=None, description="of one particle where it differs from the material's (holes); or mass"
    )
    mass: Mass | None = Field(default=None, examples=["0.071 g"], description="of one particle; or density")
    spheres: SphereList | None = Field(
        default=None,
        description="of a clump, each as [x, y, z, diameter] in axes of your choice; they may overlap",
    )
    stl: Name | None = Field(
        default=None,
        examples=["grain.stl"],
        description="closed surface of one particle, in place of which a clump of spheres is simulated",
    )
    stl_unit: StlUnit = Field(default="mm", description="in which the numbers of the STL file are")
    stl_spheres: Clumped | None = Field(
        default=None,
        examples=[24],
        description=f"most spheres of the clump; without it and stl_error {STL_SPHERES}",
    )
    stl_error: Length | None = Field(
        default=None,
        examples=["0.2 mm"],
        description="in place of stl_spheres: largest distance of the surfaces of clump and particle",
    )
    size_distribution: SizesEntry | None = Field(
        default=None,
        examples=[{"law": "normal", "mean": "6 mm", "standard_deviation": "0.5 mm"}],
        description="sizes, in place of diameter, under [particles.NAME.size_distribution]; a clump is scaled to them",
    )


class RegionEntry(_Entry):
    """A part of a rig of your own: a box, or the upright cylinder that touches its four sides."""

    low: Place = Field(examples=[LOW], description="corner with the smallest x, y and z")
    high: Place = Field(examples=[HIGH], description="corner with the largest x, y and z")
    shape: Literal["box", "cylinder"] = Field(
        default="box", description='"cylinder": upright, as wide as the box, which is then square'
    )


class WallEntry(_Entry):
    """A wall of a rig of your own; all its motions act together, from start to stop."""

    stl: Name = Field(examples=["drum.stl"], description="its surface, closed or not, in the axes of the rig, z up")
    stl_unit: StlUnit = Field(default="mm", description="in which the numbers of the STL file are")
    material: Name | None = Field(
        default=None, examples=["PMMA"], description="its material, where it is not the rig's `wall`"
    )
    velocity: Velocity | None = Field(default=None, examples=[[0, 0, "20 mm/s"]], description="of a translation")
    rotation_speed: Turning | None = Field(
        default=None, examples=["30 rpm"], description="of a rotation, right-handed about rotation_axis"
    )
    rotation_axis: Direction | None = Field(
        default=None, examples=[[0, 1, 0]], description="its direction; by default z"
    )
    rotation_point: Place | None = Field(
        default=None,
        examples=[[0, 0, "40 mm"]],
        description="a point of the axis, which moves with the wall; by default the origin",
    )
    vibration_amplitude: Place | None = Field(
        default=None, examples=[[0, 0, "0.5 mm"]], description="of a vibration, a sin(2 pi f t) from start"
    )
    vibration_frequency: Rate | None = Field(default=None, examples=["50 Hz"], description="of the vibration")
    start: Instant = Field(default=0.0, examples=["0.5 s"], description="of the motion, from the start of the run")
    stop: Span | None = Field(default=None, examples=["3 s"], description="of the motion; by default it goes on")
    belt: Annotated[bool, _edge(_flag)] = Field(
        default=False, examples=[True], description="the surface moves and the shape stays, as of a conveyor belt"
    )
    removed: Span | None = Field(
        default=None, examples=["0.5 s"], description="when the wall is taken away, as the slide of an outlet"
    )


class CustomRigEntry(_Entry):
    """A rig of your own for `rigtwin simulate custom` (own_rigs.md): STL walls, and particles filled in between."""

    particle: Name = Field(examples=["D6"], description="a particle of this file or of the reference")
    wall: Name = Field(examples=["steel"], description="material of its walls")
    walls: dict[str, WallEntry] = Field(
        min_length=1,
        examples=[{"cup": {"stl": "cup.stl"}}],
        description="its walls by name, each under [rigs.NAME.walls.WALL]",
    )
    fill: RegionEntry = Field(
        examples=[{"low": LOW, "high": HIGH}],
        description="where particles are placed, clear of walls and of each other",
    )
    count: Count | None = Field(default=None, description="number of particles; or total_mass")
    total_mass: Mass | None = Field(default=None, examples=["85 g"], description="of all particles; or count")
    pour_rate: PourRate | None = Field(
        default=None,
        examples=["400/s"],
        description="particles per second; by default all at once, those without room as soon as there is some",
    )
    pour_speed: Fall = Field(default=0.0, examples=["0.2 m/s"], description="downwards, of particles with a pour_rate")
    duration: Span = Field(default=DURATION, examples=["2 s"], description="simulated time, at most")
    end: End = Field(
        default="time",
        description='"at rest": ends as all rest and no wall is to move or be removed; "empty": as all have left',
    )
    interval: Span = Field(
        default=INTERVAL, examples=["20 ms"], description="between two entries of the tables over time"
    )
    low: Place | None = Field(
        default=None,
        examples=[["-60 mm", "-60 mm", "-20 mm"]],
        description=(
            "corner of the domain; particles that leave it are counted and removed. By default two particle diameters "
            "beyond walls and fill"
        ),
    )
    high: Place | None = Field(
        default=None, examples=[["60 mm", "60 mm", "150 mm"]], description="opposite corner of the domain"
    )
    regions: dict[str, RegionEntry] = Field(
        default={},
        examples=[{"cup": {"low": LOW, "high": HIGH}}],
        description=(
            "where particles are counted and the bed height is taken, each under [rigs.NAME.regions.REGION]; by "
            "default the domain"
        ),
    )


class ModelParticleEntry(ParticleEntry):
    """A particle of a model.toml, in which a clump may have other mass properties than the union of its spheres."""

    volume: Volume | None = None
    gyration: Gyration | None = None  # [m^2], moments of inertia over the mass; the axes of the spheres are principal


class ContactEntry(_Entry):
    """What is known of a contact of two particles, or of a particle and a wall; only the twins need it."""

    restitution: Restitution | None = Field(default=None, description="coefficient of restitution")
    static_friction: Friction | None = Field(default=None, description="Coulomb limit of the tangential force")
    rolling_friction: Friction | None = Field(
        default=None,
        examples=[0.06],
        description="torque limit mu_r Fn R on each body, not the tangent of a tilting angle",
    )


_OF_CAMERA = [field.name for field in fields(camera.Camera)]
_ONLY_OF: dict[str, tuple[str, ...]] = {
    "bead_at": ("drop", "tilt"),
    "centre": ("drop", "pendulum", "tilt"),
    "plate": ("drop", "tilt"),
    "pivot": ("pendulum",),
    "base": ("pile",),
    "flank": ("pile",),
    "cylinder": ("packing",),
    "floor": ("packing",),
    "circle": ("drum",),
    "averaged": ("drum",),
    "slot": ("hopper",),
    **dict.fromkeys(
        ("frame_rate", "start", "end", "exclude"), tuple(rig for rig in RIGS if not SETTINGS[rig].several_views)
    ),
}
"""Rigs of which something that is else found in the picture may be stated, or that are filmed."""


def _unused(name: str, rig: str) -> str:
    """Why a key of the camera has no place in an experiment, whatever its value; "" if it has one."""
    return "" if rig in _ONLY_OF.get(name, (rig,)) else f"is not used by a {rig}; leave it out."


class CameraEntry(_Entry):
    """What is known of the camera; what is not given is found in the picture."""

    frame_rate: Rate | None = Field(
        default=None,
        description="capture rate; a high-speed clip often plays at another rate. By default that of the file",
    )
    scale: Scale | None = Field(
        default=None,
        description="at the particle's distance; by default from the particle's diameter or a known size of the rig",
    )
    known_length: KnownLength | None = Field(
        default=None,
        examples=["100mm:120,40,620,40"],
        description="a length in view and the two points that it spans: x1,y1,x2,y2 in pixels; in place of scale",
    )
    region: Annotated[tuple[float, float, float, float], _edge(_region)] | None = Field(
        default=None, examples=["100,0,400,720"], description="look only there: x,y,width,height in pixels"
    )
    start: Moment | None = Field(
        default=None, description='begin of the evaluated part, a time or a frame ("48 frames")'
    )
    end: Moment | None = Field(
        default=None, examples=["1.5 s"], description="end of the evaluated part, a time or a frame"
    )
    exclude: Spans = Field(default=(), examples=[["60f..80f"]], description="parts of the clip that are left out")
    camera_roll: Annotated[float, _edge(_roll, partial(InSi, dimension="angle"))] | None = Field(
        default=None,
        examples=["0.5 deg"],
        description="positive when the scene looks turned clockwise; measured when not stated",
    )
    plumb_line: PlumbLine | None = Field(
        default=None,
        examples=["412,20,405,700"],
        description="two points of a plumb line: x1,y1,x2,y2 in pixels; in place of camera_roll",
    )
    board: Board | None = Field(
        default=None,
        examples=["checkerboard 9x6 10mm board.jpg"],
        description=(
            'a calibration board photographed where the motion is: "checkerboard 9x6 10mm board.jpg", '
            '"charuco 8x5 20mm/15mm board.jpg", "aruco 40mm b.jpg"; gives scale, lens and perspective'
        ),
    )
    ignore: Annotated[tuple[tuple[float, float, float, float], ...], _edge(_regions)] = Field(
        default=(),
        examples=[["0,0,80,60"]],
        description="regions of which nothing is taken (lamp, reflection, hand): x,y,width,height in pixels",
    )
    bead_at: BeadAt | None = Field(
        default=None,
        examples=["12:310,88"],
        description='where the body is in a frame: "frame:x,y" in pixels; seed of the track',
    )
    centre: Centres = Field(
        default=(),
        examples=[["60:310,88"]],
        description=(
            'centre of a bead in frames in which it is located wrongly or not at all: "frame:x,y" in pixels; used as '
            "stated"
        ),
    )
    plate: Line | None = Field(
        default=None, examples=["100,300,500,300"], description="two points of the plate: x1,y1,x2,y2 in pixels"
    )
    pivot: Pivots = Field(default=(), examples=["320,40"], description="the hinge, or both: x,y in pixels")
    base: Line | None = Field(
        default=None, examples=["100,300,500,300"], description="left and right end of the base: x1,y1,x2,y2 in pixels"
    )
    flank: Flank | None = Field(default=None, examples=["left"], description="which flanks of the heap are read")
    cylinder: Line | None = Field(
        default=None,
        examples=["150,600,450,600"],
        description="its two inner walls at the floor, beside its middle, not at its front: x1,y1,x2,y2 in pixels",
    )
    floor: Annotated[float, _edge(_floor)] | None = Field(
        default=None, examples=[612], description="row of the floor in pixels"
    )
    circle: Annotated[tuple[float, float, float], _edge(_circle)] | None = Field(
        default=None, examples=["320,240,200"], description="the inner rim: cx,cy,r in pixels"
    )
    averaged: Annotated[bool, _edge(_flag)] = Field(
        default=False, examples=[True], description="the picture is a mean over time, as of a GranuDrum, not one moment"
    )
    slot: Line | None = Field(
        default=None, examples=["300,400,340,400"], description="both edges of the slot: x1,y1,x2,y2 in pixels"
    )

    def camera(self, folder: Path = HERE) -> camera.Camera:
        """Return what the keys say.

        Parameters
        ----------
        folder : Path
            The lab's folder, in which a board's photo is named.

        Returns
        -------
        Camera
            The camera; without its board's calibration.

        Raises
        ------
        BadInput
            If a rate or scale is out of range, a line is steeper than it may be, or keys contradict each other.
        """
        roll = self.camera_roll if self.plumb_line is None else self.plumb_line
        board = None if self.board is None else replace(self.board, photo=folder / self.board.photo)
        stated = {name: getattr(self, name) for name in _OF_CAMERA if name in type(self).model_fields}
        return camera.Camera(**{**stated, "board": board}, roll=roll, pivots=self.pivot)

    def faults(self, folder: Path, rig: str) -> Iterable[tuple[str, str]]:
        """Yield keys that cannot be, or do not go together, with the rig, or with what lies in the lab's folder.

        Parameters
        ----------
        folder : Path
            The lab's folder.
        rig : str
            Name of the rig.

        Yields
        ------
        key, why : str
            The key, and what is wrong.
        """
        for name in sorted(self.model_fields_set & _ONLY_OF.keys()):
            if why := _unused(name, rig):
                yield name, why
        if self.camera_roll is not None and self.plumb_line is not None:
            yield "plumb_line", "camera_roll is given too; leave one of them out."
        if self.board is not None and not (folder / self.board.photo).is_file():
            yield "board", f"there is no file {folder / self.board.photo}; put it there or correct the name."
        try:
            self.camera(folder)
        except BadCamera as error:
            yield from error.faults


def keys_of_camera(rig: str) -> set[str]:
    """Return the keys of ``[experiments.camera]`` that a rig uses.

    Parameters
    ----------
    rig : str
        Name of the rig.

    Returns
    -------
    set of str
        Names of the keys.
    """
    return {name for name in CameraEntry.model_fields if not _unused(name, rig)}


class FileEntry(CameraEntry):
    """What is said of one clip or photo: keys of the camera that go before those of its experiment, and a verdict."""

    rejected: Annotated[str, _edge(_reason)] = Field(
        default="", examples=["a hand is in view"], description="why the file is not used"
    )

    def over(self, common: CameraEntry) -> CameraEntry:
        """Return the keys of the experiment's camera, with those of this file in their place.

        Parameters
        ----------
        common : CameraEntry
            Keys of the experiment's camera.

        Returns
        -------
        CameraEntry
            Keys that hold for this file.
        """
        mine = self.model_fields_set & CameraEntry.model_fields.keys()
        for alternatives in _ALTERNATIVES:
            if mine & alternatives:
                common = common.model_copy(update=dict.fromkeys(alternatives))
        return CameraEntry.model_construct(
            {*common.model_fields_set, *mine},
            **{name: getattr(self if name in mine else common, name) for name in CameraEntry.model_fields},
        )


_ALTERNATIVES = ({"scale", "known_length", "board"}, {"camera_roll", "plumb_line"})
"""Keys of the camera that state the same in several ways."""


class _ExperimentEntry(_Entry):
    id: Name = Field(examples=["drop-D6-steel"], description="name of the experiment, a different one for each")
    particle: Name = Field(examples=["D6"], description="a particle of this file or of the reference")
    repetitions: list[Views] = Field(
        default=[],
        min_length=1,
        examples=[["r01.mp4", "r02.mp4"]],
        description=(
            "one clip, photo or table each; several photos of one bed or pile in brackets; a pattern "
            '("clips/*.mp4") or a folder ("clips/") adds all files in it'
        ),
    )
    measured: dict[str, Any] = Field(
        default={},
        examples=[{"restitution_wall": "0.42 +- 0.05 (n = 10)"}],
        description="results measured by hand, in place of media or beside them (stated_results.md)",
    )
    scatter: dict[str, Any] = Field(
        default={},
        examples=[{"restitution_wall": "5 %"}],
        description=(
            "standard deviation from repetition to repetition in percent of the value, in place of the "
            'published one that `compare` uses with few repetitions; "5 % (n = 10)" is one that was found'
            " with ten repetitions"
        ),
    )  # read by `rigtwin.lab.file.stated_values`
    columns: Annotated[Mapping[str, tuple[str, str]], _edge(_columns), Field(examples=["t=time[ms],x=cx,y=cy"])] = (
        Field(default={}, description="columns of a table that are not recognised (tracked_data.md)")
    )
    join: Annotated[tuple[tuple[str, ...], ...], _edge(_joined), Field(examples=[["3,7"]])] = Field(
        (), description="the parts of one broken track in a table"
    )
    camera: CameraEntry = Field(
        default=CameraEntry(), description="what is known of the camera, under [experiments.camera]"
    )
    files: dict[str, FileEntry] = Field(
        default={}, description='keys of single files, by the name of the file, under [experiments.files."NAME"]'
    )
    rig: str = Field(examples=["drop"], description="its rig")

    @property
    def table(self) -> TableOptions:
        """What is stated of tables of tracked data."""
        return TableOptions(self.columns, self.join)

    @property
    def several_views(self) -> bool:
        """Whether a repetition may have several photos."""
        return SETTINGS[self.rig].several_views

    def settings(self) -> RigSettings:
        """The settings of the rig: the keys that have the names of its fields."""
        kind = SETTINGS[self.rig]
        return kind(**{field.name: getattr(self, field.name) for field in fields(kind)})

    def faults(self) -> Iterable[tuple[str, str]]:
        """Yield keys of the rig that do not go together, and why."""
        settings = self.settings()
        for name in sorted(settings.idle & self.model_fields_set):
            other, value = settings.only_of[name]
            given = getattr(settings, other)
            yield name, f'is of {other} = "{value}" and not used with {other} = "{given}"; leave it out.'


class UncertaintyEntry(_Entry):
    """Standard uncertainties of what is stated, for the diagnosis; relative ones as numbers."""

    scale: Fraction | None = Field(default=None, examples=[0.005], description="of the scale, relative")
    frame_rate: Fraction | None = Field(default=None, examples=[0.001], description="of the frame rate, relative")
    camera_roll: Tilted | None = Field(default=None, description="of the camera roll")
    tracking_noise: Length | None = Field(
        default=None, examples=["0.02 mm"], description="of the centre of a tracked particle in one frame"
    )
    drop_height: Length | None = Field(default=None, examples=["0.5 mm"], description="of the drop height")
    plate_level: Tilted | None = Field(default=None, examples=["0.1 deg"], description="of the level of the plate")
    length: Length | None = Field(default=None, examples=["0.5 mm"], description="of the length of the pendulum")
    release_angle: Tilted | None = Field(default=None, examples=["0.5 deg"], description="of the release angle")
    tilt_rate: Fraction | None = Field(default=None, examples=[0.01], description="of the speed of the plate, relative")
    incline_angle: Tilted | None = Field(
        default=None, examples=["0.1 deg"], description="of the angle of a fixed incline"
    )


class DropEntry(_ExperimentEntry):
    """A particle falls on a plate and bounces."""

    rig: Literal["drop"]
    wall: Name = Field(examples=["steel"], description="material of the plate")
    drop_height: Length | None = Field(
        default=None,
        examples=["300 mm"],
        description="lowest point of the particle above the plate; measured when not stated",
    )
    bounces: Count = Field(default=4, examples=[4], description="bounces that the twin shows")
    turned: Release | None = Field(
        default=None, description="of a clump out of its own axes, clockwise as seen; random when not stated"
    )


class PendulumEntry(_ExperimentEntry):
    """A particle swings against another one, or against a wall."""

    rig: Literal["pendulum"]
    wall: Name | None = Field(
        default=None, examples=["steel"], description='material of the wall; only with variant = "wall"'
    )
    variant: Literal["double", "wall"] = Field(
        examples=["double"],
        description='"double": particle A hits particle B, which is at rest; "wall": particle A hits a wall',
    )
    length: Length = Field(examples=["300 mm"], description="hinge to centre of the particle")
    release_angle: Release | None = Field(
        default=None, description="of particle A from the vertical; measured when not stated"
    )
    hanger: Literal["string", "rod"] = Field(
        default="string", examples=["rod"], description="suspension of each particle: a string or a rigid rod"
    )
    rod_mass: Mass = Field(default=0.0, examples=["2 g"], description="of each, uniform along its length")

    def faults(self) -> Iterable[tuple[str, str]]:
        """Yield keys of a pendulum that do not go together, and why."""
        yield from super().faults()
        if self.variant == "wall" and self.wall is None:
            yield "wall", 'this key is missing; a pendulum with variant = "wall" needs wall = "steel".'
        if self.variant == "double" and self.wall is not None:
            yield "wall", 'a double pendulum has no wall; leave it out, or set variant = "wall".'


class PileEntry(_ExperimentEntry):
    """A heap on a round base."""

    rig: Literal["pile"]
    wall: Name = Field(examples=["steel"], description="material of the base")
    variant: Literal["piling", "pouring", "emptying"] = Field(
        examples=["piling"],
        description=(
            '"piling": poured on the base through a funnel; "pouring": a tube that is lifted; "emptying":'
            " what stays in a container that is drained"
        ),
    )
    base_diameter: Length = Field(examples=["90 mm"], description="of the base; of the container of an emptied one")
    rim_height: Height = Field(
        default=0.0, description="of the rim above the base plate; 0 if flat, from which round beads roll off"
    )
    outlet_diameter: Length | None = Field(
        default=None,
        examples=["25 mm"],
        description="of the funnel; by default a quarter of the base, at least three particle diameters",
    )
    outlet_height: Length | None = Field(
        default=None,
        examples=["120 mm"],
        description="of a fixed funnel above the base; by default it rises with the heap",
    )
    tube_diameter: Length | None = Field(
        default=None, examples=["50 mm"], description="of the tube, inside; by default half the base"
    )
    lift_speed: Speed | None = Field(
        default=None,
        examples=["20 mm/s"],
        description=f"with which the tube is lifted; by default {1e3 * LIFT_SPEED:.3g} mm/s",
    )
    drain_diameter: Length | None = Field(
        default=None,
        examples=["30 mm"],
        description="of the hole in the container's floor; needed there",
    )
    count: Count | None = Field(
        default=None,
        description="particles poured; by default from the volume of the filmed heap, at least 1000 where it reaches "
        "the edge of its base, and 1000 where nothing is filmed",
    )

    def faults(self) -> Iterable[tuple[str, str]]:
        """Yield keys of a pile that do not go together, and why."""
        yield from super().faults()
        if self.variant != "emptying":
            return
        if self.drain_diameter is None:
            why = 'this key is missing; what stays in an emptied container lies between its wall and drain: "30 mm".'
            yield "drain_diameter", why
        elif self.drain_diameter >= self.base_diameter:
            yield "drain_diameter", "the drain is as wide as the container; give its own diameter."


class TiltEntry(_ExperimentEntry):
    """A plate is tilted until the body on it slides or rolls."""

    rig: Literal["tilt"]
    wall: Name = Field(examples=["steel"], description="material of the plate, or a particle that covers it")
    variant: Literal["slide", "roll"] = Field(
        examples=["slide"], description='"slide": a body that slides (glued particles); "roll": a particle that rolls'
    )
    arm_length: Length | None = Field(
        default=None, examples=["150 mm"], description="of the plate or arm, from hinge to tip"
    )
    speed: Tilting | None = Field(
        default=None,
        description=(
            f"with which the plate is tilted; by default as seen in the film, else {math.degrees(Tilt.speed):.2g} deg/s"
        ),
    )


class PackingEntry(_ExperimentEntry):
    """A bed in a cylinder."""

    rig: Literal["packing"]
    wall: Name = Field(examples=["PMMA"], description="material of the cylinder")
    cylinder_diameter: Length = Field(examples=["65 mm"], description="inner diameter")
    hopper_diameter: Length | None = Field(
        default=None,
        examples=["100 mm"],
        description="inner diameter of a hopper above the cylinder; by default the particles rain from the outlet",
    )
    outlet_diameter: Length | None = Field(
        default=None,
        examples=["40 mm"],
        description=f"of that hopper's slide, or of the funnel; by default {OUTLET_SHARE:g} of the cylinder",
    )
    fall_height: Length | None = Field(
        default=None,
        examples=["20 mm"],
        description=f"from the outlet to the cylinder's rim; by default {1e3 * Packing.fall_height:.3g} mm",
    )
    total_mass: Mass | None = Field(
        default=None, examples=["212.7 g"], description="of all particles, weighed; the twin needs it or count"
    )
    count: Count | None = Field(default=None, description="number of all particles; the twin needs it or total_mass")


class DrumEntry(_ExperimentEntry):
    """A bed in a rotating drum."""

    rig: Literal["drum"]
    wall: Name = Field(examples=["PMMA"], description="material of the shell and the end walls")
    drum_diameter: Length = Field(examples=["140 mm"], description="inner diameter")
    speed: Turning = Field(examples=["3 rpm"], description="of rotation")
    depth: Length | None = Field(
        default=None, examples=["70 mm"], description="inner length along the axis; by default half the diameter"
    )
    fill: Fraction | None = Field(
        default=None,
        description=f"share of the drum's volume that the bed takes; by default as seen in the film, else {FILL:g}",
    )
    count: Count | None = Field(default=None, description="number of all particles, in place of fill")
    end_wall_friction: Friction | None = Field(
        default=None, description="static friction of the end walls; by default that of the shell"
    )


class HopperEntry(_ExperimentEntry):
    """A hopper that empties through its outlet."""

    rig: Literal["hopper"]
    wall: Name = Field(examples=["PMMA"], description="material of the walls")
    variant: Literal["slot", "conical"] = Field(
        examples=["slot"],
        description='"slot": two inclined walls between two upright plates; "conical": a cylinder on a cone',
    )
    bin_width: Length | None = Field(
        default=None,
        examples=["104 mm"],
        description=(
            "inner width of the bin, or diameter of a conical one; "
            f"by default {1e3 * SLOT_WIDTH:.3g} mm ({1e3 * Hopper.diameter:.3g} mm)"
        ),
    )
    depth: Length | None = Field(
        default=None,
        examples=["68 mm"],
        description=f"length of the slot along the line of sight; by default {1e3 * SLOT_LENGTH:.3g} mm",
    )
    outlet: Length | None = Field(
        default=None, examples=["34 mm"], description="width of the slot or diameter of the outlet; the twin needs it"
    )
    cone_height: Length | None = Field(
        default=None,
        examples=["100 mm"],
        description=f"of the cone; by default {1e3 * Hopper.cone_height:.3g} mm",
    )
    inclination: Release | None = Field(
        default=None,
        examples=["60 deg"],
        description=f"of the walls from the level; by default {math.degrees(Hopper.inclination):.3g} deg",
    )
    total_mass: Mass | None = Field(
        default=None, examples=["85 g"], description="of all particles, weighed; the twin needs it or count"
    )
    count: Count | None = Field(default=None, description="number of all particles; the twin needs it or total_mass")


ExperimentEntry = DropEntry | PendulumEntry | TiltEntry | PackingEntry | PileEntry | DrumEntry | HopperEntry


class LabFile(_Entry):
    """The content of a lab.toml."""

    lab: LabEntry = LabEntry()
    materials: dict[str, MaterialEntry] = {}
    particles: dict[str, ParticleEntry] = {}
    contacts: dict[str, ContactEntry] = {}
    rigs: dict[str, CustomRigEntry] = {}
    uncertainty: UncertaintyEntry = UncertaintyEntry()
    experiments: list[Annotated[ExperimentEntry, Field(discriminator="rig")]] = []


class ModelFile(_Entry):
    """The content of a model.toml."""

    materials: dict[str, MaterialEntry] = {}
    particles: dict[str, ModelParticleEntry] = {}
    contacts: dict[str, ContactEntry] = {}
    effects: dict[str, dict[str, float]] = {}


_SECTIONS: dict[str, type[_Entry]] = {
    "lab": LabEntry,
    "materials": MaterialEntry,
    "particles": ParticleEntry,
    "contacts": ContactEntry,
    "rigs": CustomRigEntry,
    "uncertainty": UncertaintyEntry,
}
_EXPERIMENTS: dict[str, type[_ExperimentEntry]] = {
    rig: entry for entry in get_args(ExperimentEntry) for rig in get_args(entry.model_fields["rig"].annotation)
}

_NO_TABLE = ("dict_type", "model_type", "model_attributes_type")  # of pydantic's errors
_NO_RIG = ("union_tag_invalid", "union_tag_not_found")
_MISSING = "this key is missing"
_MEANT = re.compile(r"unknown key; did you mean '(.+?)'\?")

File = TypeVar("File", LabFile, ModelFile)


def validated(document: Document, kind: type[File]) -> File:
    """Return a document as a lab.toml or a model.toml.

    Parameters
    ----------
    document : Document
        Document to be validated.
    kind : type
        `LabFile` or `ModelFile`.

    Returns
    -------
    LabFile or ModelFile
        The content.

    Raises
    ------
    BadLabFile
        If something is wrong; the message names file, line and key of all of it.
    """
    read = repaired(document, kind)
    if read.problems:
        raise document.error(read.problems)
    return read.file


@dataclass(frozen=True)
class Repaired(Generic[File]):
    """A document in which examples stand for what is missing or wrong, so that the rest of it can be checked too."""

    file: File
    problems: list[Problem]
    places: frozenset[Key]
    """Keys of what was repaired."""

    def touches(self, key: Key) -> bool:
        """Return whether a key, or a table that holds it, was repaired.

        What is wrong there is then no fault of the document.

        Parameters
        ----------
        key : Key
            Key that a fault was found in.

        Returns
        -------
        bool
            True where it was repaired.
        """
        return _touches(self.places, key)

    def touched_in(self, table: Key) -> bool:
        """Return whether a key of the table itself was repaired.

        Parameters
        ----------
        table : Key
            Table whose own keys are meant.

        Returns
        -------
        bool
            True where one of its keys was repaired.
        """
        return any(place[:-1] == table for place in self.places)


def _touches(places: Iterable[Key], key: Key) -> bool:
    return any(key[: len(place)] == place for place in places)


def repaired(document: Document, kind: type[File]) -> Repaired[File]:
    """Return a document as a lab.toml or a model.toml, with all that is missing, unknown or out of range.

    Parameters
    ----------
    document : Document
        Document to be validated and, where needed, repaired.
    kind : type
        `LabFile` or `ModelFile`.

    Returns
    -------
    Repaired
        Content, with examples in place of what is wrong, and the problems.

    Raises
    ------
    BadLabFile
        If it cannot be repaired.
    """
    data = deepcopy(document.data)
    problems: list[Problem] = []
    consequences: list[Problem] = []
    places: set[Key] = set()
    while True:
        try:
            file = kind.model_validate(data)
            return Repaired(file, without_consequences(problems), frozenset(places))
        except ValidationError as error:
            before = frozenset(places)
            for details in error.errors():
                problem = _problem(details, kind)
                if problem in problems or problem in consequences:  # it cannot be repaired
                    raise document.error(without_consequences(problems)) from None
                # what is wrong with an example is nothing that was written
                (consequences if _touches(before, problem.key) else problems).append(problem)
                if details["type"] in _NO_RIG:
                    table = data["experiments"][problem.key[1]]
                    if meant := near(str(table.get("rig", "")), RIGS):
                        table["rig"] = meant  # nothing else of the experiment is repaired
                        continue
                    problems += _whichever_rig(table, problem.key[:2])
                repaired_key = _repair(data, problem.key, details, kind)
                if details["type"] != "extra_forbidden" or _MEANT.match(problem.what):
                    places.add(repaired_key)


def _whichever_rig(table: Mapping[str, Any], key: Key) -> list[Problem]:
    """What is wrong with the keys that experiments of all rigs have."""
    try:
        _ExperimentEntry.model_validate({name: table[name] for name in _ExperimentEntry.model_fields if name in table})
    except ValidationError as error:
        places = [{**details, "loc": (*key, "drop", *details["loc"])} for details in error.errors()]
        return [_problem(cast("ErrorDetails", each), LabFile) for each in places]
    return []


def without_consequences(problems: Sequence[Problem]) -> list[Problem]:
    """Return the problems without the missing keys that are there under a misspelt name.

    Parameters
    ----------
    problems : sequence of Problem
        Problems that validation found.

    Returns
    -------
    list of Problem
        In their order.
    """
    meant = {(*one.key[:-1], word[1]) for one in problems if (word := _MEANT.match(one.what))}
    return [one for one in problems if not (one.key in meant and one.what.startswith(_MISSING))]


def _repair(data: dict[str, Any], key: Key, details: ErrorDetails, kind: type[_Entry]) -> Key:
    """Put the key's example in its place, or take it out where it has none; the place of what was repaired."""
    if details["type"] in _NO_RIG or (len(key) == 2 and key[0] == "experiments"):
        key = key[:2]
        value: Any = {name: example_of(DropEntry.model_fields[name]) for name in ("id", "particle", "wall")}
        value |= {"rig": "drop", "repetitions": ["r01.mp4"]}
    elif details["type"] in _NO_TABLE:
        value = {}
    else:
        section = kind if len(details["loc"]) == 1 else _section(details["loc"][:-1])
        field = section.model_fields.get(str(key[-1])) if isinstance(key[-1], str) else None
        value = "r01.mp4" if field is None else _stand_in(field)
    *above, last = key
    table: Any = data
    for part in above:
        table = table[part]
    if value is None or details["type"] == "extra_forbidden":
        table.pop(last, None)
    else:
        table[last] = value
    return key


def _stand_in(field: FieldInfo) -> Any:
    """A value that a key may have; None where it can be left out."""
    if not field.is_required():
        return None
    choices = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
    return example_of(field) or choices[0]


def _problem(details: ErrorDetails, kind: type[_Entry]) -> Problem:
    place = details["loc"]
    parent = place[:-1]
    section = kind if not parent else _section(parent)
    key: Key = (*place[:2], *place[3:]) if place[:1] == ("experiments",) and len(place) > 2 else place
    name, given = str(place[-1]) if place else "", _shown(details["input"])
    if issubclass(section, CameraEntry) and (why := _unused(name, str(place[2]))):
        return Problem(key, why)
    match details["type"]:
        case "missing":
            return Problem(key, f"{_MISSING}; add {name} = {_example(section, name)}.")
        case "extra_forbidden":
            return Problem(key, f"unknown key; {_place_of(name, section) or suggestion(name, section.model_fields)}.")
        case "value_error":
            return Problem(key, str(details["ctx"]["error"]))
        case "union_tag_not_found":
            return Problem((*key, "rig"), f'this key is missing; add rig = "drop" (known: {", ".join(RIGS)}).')
        case "union_tag_invalid":
            return Problem((*key, "rig"), _unknown_rig(str(details["ctx"]["tag"])))
        case "literal_error":
            return Problem(key, f"{given} is not known; write {details['ctx']['expected']}.")
        case "too_short":
            return Problem(key, f"is empty; write {name} = {_example(section, name)}.")
        case "string_too_short":
            return Problem(key, "is empty; write a name.")
        case "string_type":
            return Problem(key, f"{given} is not a text; put it in quotes.")
        case "list_type":
            return Problem(key, f"{given} is not a list; write {_list_hint(section, name)}.")
        case kind_of_fault if kind_of_fault in _NO_TABLE:
            return Problem(key, f"{given} is not a table; write it as [{_header(key)}] with its keys below.")
    return Problem(key, f"{given} cannot be used ({details['msg'].lower()}).")


def _place_of(name: str, section: type[_Entry]) -> str:
    """Where a key belongs that stands beside the experiments and is one of theirs; empty for others."""
    of_experiments = any(name in entry.model_fields for entry in _EXPERIMENTS.values())
    if section is not LabFile or not of_experiments or near(name, section.model_fields):
        return ""
    return f"it belongs to an experiment: below its [[experiments]] write {name} = ..., or a table [experiments.{name}]"


def _section(parent: Key) -> type[_Entry]:
    """The class whose keys stand under `parent`; pydantic puts the rig's name after an experiment's number."""
    if parent[0] == "experiments" and len(parent) > 2:
        tables: dict[str | int, type[_Entry]] = {"camera": CameraEntry, "files": FileEntry}
        return tables.get((*parent, "")[3]) or _EXPERIMENTS[str(parent[2])]
    if parent[0] == "particles" and parent[2:] == ("size_distribution",):
        return SizesEntry
    if parent[0] == "rigs" and len(parent) > 2:
        return WallEntry if parent[2] == "walls" else RegionEntry
    return _SECTIONS.get(str(parent[0]), LabFile)


def _example(section: type[_Entry], name: str) -> str:
    given = example_of(section.model_fields[name])
    return toml("..." if given is None else given)


def example_of(field: FieldInfo) -> Any:
    """Return the example of a key, its own or that of its type.

    Parameters
    ----------
    field : FieldInfo
        Field of a class of keys.

    Returns
    -------
    object
        None where it has none.
    """
    examples = field.examples or next((one.examples for one in _notes(field, FieldInfo) if one.examples), None)
    return examples[0] if examples else None


def dimension_of(field: FieldInfo) -> str:
    """Return the dimension of a key's value.

    Parameters
    ----------
    field : FieldInfo
        Field of a class of keys.

    Returns
    -------
    str
        One of `rigtwin.lab.units.DIMENSIONS`; empty where the value is no quantity.
    """
    return next((note.dimension for note in _notes(field, InSi)), "")


Note = TypeVar("Note")


def _notes(field: FieldInfo, kind: type[Note]) -> list[Note]:
    """What is annotated of this kind: in the field, and in the types of a union."""
    inner = [note for each in get_args(field.annotation) for note in getattr(each, "__metadata__", ())]
    return [note for note in (*field.metadata, *inner) if isinstance(note, kind)]


def experiment_entries() -> dict[str, type[_ExperimentEntry]]:
    """The class of an experiment's keys, by rig."""
    return dict(_EXPERIMENTS)


def camera_rigs(name: str) -> tuple[str, ...]:
    """Return the rigs that have a key of ``[experiments.camera]``.

    Parameters
    ----------
    name : str
        Name of the key.

    Returns
    -------
    tuple of str
        Empty where all have it.
    """
    return _ONLY_OF.get(name, ())


def _shown(value: Any) -> str:
    return "a table" if isinstance(value, dict) else repr(value)


def _header(key: Key) -> str:
    return dotted(tuple(part for part in key if isinstance(part, str)))


def _list_hint(section: type[_Entry], name: str) -> str:
    if name == "experiments":
        return "each experiment under [[experiments]], with double brackets"
    return f"{name} = {_example(section, name)}"


def toml(value: Any) -> str:
    """Return a value as TOML has it.

    Parameters
    ----------
    value : object
        A text, number, truth value, list or dictionary of these.

    Returns
    -------
    str
        The text.

    Examples
    --------
    >>> toml({"bed_height": ["184 mm", 0.183], "averaged": True})
    '{ bed_height = ["184 mm", 0.183], averaged = true }'
    """
    if isinstance(value, list):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {toml(item)}" for name, item in value.items()) + " }"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


def _unknown_rig(name: str) -> str:
    """What to say of a rig that cannot be read."""
    return f"there is no rig {name!r}; {suggestion(name, RIGS)}."
