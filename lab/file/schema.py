"""What may stand in lab.toml and model.toml, and the sentence that says what is wrong there and on which line.

The classes are the edge: texts with units go in, SI floats come out, an unknown key is an error.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError
from pydantic_core import ErrorDetails

from rigtwin.lab import camera
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file.toml_lines import Key, dotted, key_lines
from rigtwin.lab.input_files import LARGEST_NOTES, lies_outside, read_bytes, why_not_ordinary
from rigtwin.lab.rigs import RIGS, SETTINGS, UPSIDE_DOWN, RigSettings
from rigtwin.lab.tracked.columns import parse_columns, parse_joined
from rigtwin.lab.tracked.table import TableOptions
from rigtwin.lab.units import DIMENSIONS, LONGEST, MOST_PARTICLES, si

HERE = Path()


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
        """Line of a key, or of the table it should stand in."""
        while key not in self.lines:
            key = key[:-1]
        return self.lines[key]

    def error(self, problems: Iterable[Problem]) -> BadLabFile:
        """One sentence on the first problem by line, and in which lines there are more.

        A missing key comes last: it may be the misspelt one.
        """
        first, *others = sorted(
            dict.fromkeys(problems), key=lambda problem: (problem.key not in self.lines, self.line(problem.key))
        )
        where = f"{self.path}, line {self.line(first.key)}: "
        key = f"{dotted(first.key)}: " if first.key else ""
        if not others:
            return BadLabFile(f"{where}{key}{first.what}")
        lines = ", ".join(map(str, sorted({self.line(other.key) for other in others})))
        stop = "." if first.what.endswith(".") else ""
        return BadLabFile(
            f"{where}{key}{first.what.removesuffix('.')} (and {len(others)} more, see line {lines}){stop}"
        )


def read_document(path: Path, *, made_by: str = "make one with `rigtwin init`") -> Document:
    """Read a TOML file, `made_by` where it is not there.  Raises `BadLabFile` with the line of what is no TOML."""
    if why_not_ordinary(path) == "no such file":
        raise BadLabFile(f"{path}: no such file; check the path, or {made_by}.")
    advice = "check the path and its permissions"
    return parsed(path, read_bytes(path, advice=advice, largest=LARGEST_NOTES, refuse=BadLabFile))


def parsed(path: Path, content: bytes) -> Document:
    """What is, or shall be, the content of the TOML file `path`.  Raises `BadLabFile`."""
    try:
        text = content.decode("utf-8-sig")
        data = tomllib.loads(text)
        lines = key_lines(text)
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise BadLabFile(f"{path}, line {line}: is not UTF-8 text; save the file as UTF-8.") from None
    except (ValueError, RecursionError) as error:  # bad syntax, or a number or nesting beyond Python's limits
        raise BadLabFile(_syntax_error(path, text, error)) from None
    return Document(path, data, lines)


def _syntax_error(path: Path, text: str, error: Exception) -> str:
    said = str(error)
    place = re.search(r"\(at line (\d+), column (\d+)\)", said)
    line = int(place[1]) if place else text.rstrip().count("\n") + 1
    reason = re.sub(r"\s*\(at .*\)$", "", said)
    reason = reason.replace("Cannot overwrite a value", "the key or table stands there twice")
    written = text.split("\n")[line - 1].strip()[:60]
    quoted = "" if lies_outside(path, path.parent) else f" in {written!r}"  # a link would show a file elsewhere
    return (
        f"{path}, line {line}: not valid TOML ({reason[:1].lower()}{reason[1:]}){quoted}; "
        'write key = "text" or key = number, one per line.'
    )


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


def _text(value: Any, example: str) -> str:
    if not isinstance(value, str):
        raise BadInput(f"{value!r} is not a text; write it like {example!r}.")
    return value


def _views(value: Any) -> list[str]:
    views = [value] if isinstance(value, str) else value
    if not isinstance(views, list) or not views or not all(isinstance(view, str) and view for view in views):
        raise BadInput(f"{value!r} is not a file name; write it like 'r01.mp4', or ['front.jpg', 'left.jpg'].")
    return views


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise BadInput(f"{value!r} is not a whole number of at least 1.")
    if value > MOST_PARTICLES:
        raise BadInput(f"{value!r} is more than the {MOST_PARTICLES} particles that a twin can have.")
    return value


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
Height = Annotated[float, _quantity("length", 0, open_low=False), Field(examples=["10 mm"])]
Density = Annotated[float, _quantity("density", 0), Field(examples=["568 kg/m^3"])]
Mass = Annotated[float, _quantity("mass", 0), Field(examples=["0.69 g"])]
Modulus = Annotated[float, _quantity("pressure", 0, STIFFEST), Field(examples=["11 GPa"])]
Poisson = Annotated[float, _quantity("number", 0, 0.499, open_low=False), Field(examples=[0.44])]
Restitution = Annotated[float, _quantity("number", 0, 1), Field(examples=[0.42])]
Friction = Annotated[float, _quantity("number", 0, open_low=False), Field(examples=[0.36])]
Rate = Annotated[float, _quantity("frequency", 0), Field(examples=["240 Hz"])]
Scale = Annotated[float, _quantity("scale", 0), Field(examples=["0.2 mm/px"])]
Speed = Annotated[float, _quantity("speed", 0), Field(examples=["20 mm/s"])]
Turning = Annotated[float, _quantity("angular_speed", 0), Field(examples=["3 rpm"])]
Tilting = Annotated[float, _quantity("tilting_speed", 0), Field(examples=["2 deg/s"])]
Fraction = Annotated[float, _quantity("number", 0, 1), Field(examples=[0.35])]
Release = Annotated[float, _quantity("angle", 0, UPSIDE_DOWN), Field(examples=["45 deg"])]
Tilted = Annotated[float, _quantity("angle", 0, math.radians(45)), Field(examples=["0.1 deg"])]
Count = Annotated[int, _edge(_whole), Field(examples=[1000])]
Moment = Annotated[camera.Moment, _edge(_moment), Field(examples=["0.25 s"])]
KnownLength = Annotated[camera.KnownLength, _edge(_known_length)]
PlumbLine = Annotated[float, _edge(_plumb_line)]
Line = Annotated[camera.Line, _edge(_line)]
BeadAt = Annotated[camera.Seed, _edge(_seed)]
Spans = Annotated[tuple[tuple[camera.Moment, camera.Moment], ...], _edge(_spans)]
Pivots = Annotated[tuple[camera.Point, ...], _edge(_points)]
Flank = camera.Flank
Board = Annotated[camera.Board, _edge(_board)]
Views = Annotated[list[str], _edge(_views)]
Name = Annotated[str, Field(min_length=1)]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class LabEntry(_Entry):
    title: str = ""


class MaterialEntry(_Entry):
    density: Density
    youngs_modulus: Modulus
    poisson_ratio: Poisson


class ParticleEntry(_Entry):
    material: Name = Field(examples=["ash"])
    diameter: Length
    density: Density | None = None
    mass: Mass | None = None


class ContactEntry(_Entry):
    restitution: Restitution | None = None
    static_friction: Friction | None = None
    rolling_friction: Friction | None = None


_OF_CAMERA = [field.name for field in fields(camera.Camera)]
_ONLY_OF: dict[str, tuple[str, ...]] = {
    "bead_at": ("drop", "tilt"),
    "plate": ("drop", "tilt"),
    "pivot": ("pendulum",),
    "base": ("pile",),
    "flank": ("pile",),
    "cylinder": ("packing",),
    "floor": ("packing",),
    "circle": ("drum",),
    "averaged": ("drum",),
    "slot": ("hopper",),
    "exclude": tuple(rig for rig in RIGS if not SETTINGS[rig].several_views),
}
"""Rigs of which something that is else found in the picture may be stated."""


class CameraEntry(_Entry):
    frame_rate: Rate | None = None
    scale: Scale | None = None
    known_length: KnownLength | None = None
    region: Annotated[tuple[float, float, float, float], _edge(_region)] | None = None
    start: Moment | None = None
    end: Moment | None = None
    exclude: Spans = ()
    camera_roll: Annotated[float, _edge(_roll)] | None = None
    plumb_line: PlumbLine | None = None
    board: Board | None = None
    ignore: Annotated[tuple[tuple[float, float, float, float], ...], _edge(_regions)] = ()
    bead_at: BeadAt | None = None
    plate: Line | None = None
    pivot: Pivots = ()
    base: Line | None = None
    flank: Flank | None = None
    cylinder: Line | None = None
    floor: Annotated[float, _edge(_floor)] | None = None
    circle: Annotated[tuple[float, float, float], _edge(_circle)] | None = None
    averaged: Annotated[bool, _edge(_flag)] = False
    slot: Line | None = None

    def camera(self, folder: Path = HERE) -> camera.Camera:
        """What the keys say; a board's photo is named relative to the lab's `folder`."""
        roll = self.camera_roll if self.plumb_line is None else self.plumb_line
        board = None if self.board is None else replace(self.board, photo=folder / self.board.photo)
        stated = {name: getattr(self, name) for name in _OF_CAMERA if name in type(self).model_fields}
        return camera.Camera(**{**stated, "board": board}, roll=roll, pivots=self.pivot)

    def faults(self, folder: Path, rig: str) -> Iterable[tuple[str, str]]:
        """Keys that do not go together, with the rig, or with what lies in the lab's folder, and why."""
        for name in sorted(self.model_fields_set & _ONLY_OF.keys()):
            if rig not in _ONLY_OF[name]:
                yield name, f"is not used by a {rig}; leave it out."
        if len(self.pivot) > 2:
            yield "pivot", f"{len(self.pivot)} pivots are given; a pendulum has one or two."
        if self.camera_roll is not None and self.plumb_line is not None:
            yield "plumb_line", "camera_roll is given too; leave one of them out."
        if self.board is not None:
            if self.scale is not None or self.known_length is not None:
                yield "board", "the board gives the scale; leave scale and known_length out."
            if not (folder / self.board.photo).is_file():
                yield "board", f"there is no file {folder / self.board.photo}; put it there or correct the name."
        start, end = self.start, self.end
        if start and end and start.unit == end.unit and start.value >= end.value:
            yield "end", f"end ({end.value:g} {end.unit}) is not after start ({start.value:g} {start.unit})."


def keys_of_camera(rig: str) -> set[str]:
    """The keys of ``[experiments.camera]`` that a rig uses."""
    return {name for name in CameraEntry.model_fields if rig in _ONLY_OF.get(name, (rig,))}


class FileEntry(CameraEntry):
    """What is said of one clip or photo: keys of the camera that go before those of its experiment, and a verdict."""

    rejected: Annotated[str, _edge(_reason)] = ""

    def over(self, common: CameraEntry) -> CameraEntry:
        """The keys of the experiment's camera, with those of this file in their place."""
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
    id: Name = Field(examples=["drop-D6-steel"])
    particle: Name = Field(examples=["D6"])
    repetitions: list[Views] = Field([], min_length=1, examples=[["r01.mp4", "r02.mp4"]])
    measured: dict[str, Any] = {}  # read by `rigtwin.lab.file.stated_values`
    columns: Annotated[Mapping[str, tuple[str, str]], _edge(_columns), Field(examples=["t=time[ms],x=cx,y=cy"])] = {}
    join: Annotated[tuple[tuple[str, ...], ...], _edge(_joined), Field(examples=[["3,7"]])] = ()
    camera: CameraEntry = CameraEntry()
    files: dict[str, FileEntry] = {}  # by the name that stands in `repetitions`
    rig: str

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
        """Keys of the rig that do not go together, and why."""
        return ()


class UncertaintyEntry(_Entry):
    """Standard uncertainties of what is stated, for the diagnosis; relative ones as numbers."""

    scale: Fraction | None = None
    frame_rate: Fraction | None = None
    camera_roll: Tilted | None = None
    tracking_noise: Length | None = None
    drop_height: Length | None = None
    plate_level: Tilted | None = None
    length: Length | None = None
    release_angle: Tilted | None = None
    tilt_rate: Fraction | None = None
    incline_angle: Tilted | None = None


class DropEntry(_ExperimentEntry):
    rig: Literal["drop"]
    wall: Name = Field(examples=["steel"])
    drop_height: Length | None = None
    bounces: Count = 4
    turned: Release | None = None


class PendulumEntry(_ExperimentEntry):
    rig: Literal["pendulum"]
    wall: Name | None = None
    variant: Literal["double", "wall"] = Field(examples=["double"])
    length: Length = Field(examples=["300 mm"])
    release_angle: Release | None = None
    hanger: Literal["string", "rod"] = Field("string", examples=["rod"])
    rod_mass: Mass = 0.0

    def faults(self) -> Iterable[tuple[str, str]]:
        if self.variant == "wall" and self.wall is None:
            yield "wall", 'this key is missing; a pendulum with variant = "wall" needs wall = "steel".'
        if self.variant == "double" and self.wall is not None:
            yield "wall", 'a double pendulum has no wall; leave it out, or set variant = "wall".'


class PileEntry(_ExperimentEntry):
    rig: Literal["pile"]
    wall: Name = Field(examples=["steel"])
    variant: Literal["piling", "pouring", "emptying"] = Field(examples=["piling"])
    base_diameter: Length = Field(examples=["90 mm"])
    rim_height: Height = 0.0
    outlet_diameter: Length | None = None
    outlet_height: Length | None = None
    tube_diameter: Length | None = None
    lift_speed: Speed | None = None
    drain_diameter: Length | None = None
    count: Count | None = None

    def faults(self) -> Iterable[tuple[str, str]]:
        if self.variant != "emptying":
            return
        if self.drain_diameter is None:
            why = 'this key is missing; what stays in an emptied container lies between its wall and drain: "30 mm".'
            yield "drain_diameter", why
        elif self.drain_diameter >= self.base_diameter:
            yield "drain_diameter", "the drain is as wide as the container; give its own diameter."


class TiltEntry(_ExperimentEntry):
    rig: Literal["tilt"]
    wall: Name = Field(examples=["steel"])
    variant: Literal["slide", "roll"] = Field(examples=["slide"])
    arm_length: Length | None = None
    speed: Tilting | None = None


class PackingEntry(_ExperimentEntry):
    rig: Literal["packing"]
    wall: Name = Field(examples=["PMMA"])
    cylinder_diameter: Length = Field(examples=["65 mm"])
    hopper_diameter: Length | None = None
    outlet_diameter: Length | None = None
    fall_height: Length | None = None
    total_mass: Mass | None = None
    count: Count | None = None


class DrumEntry(_ExperimentEntry):
    rig: Literal["drum"]
    wall: Name = Field(examples=["PMMA"])
    drum_diameter: Length = Field(examples=["140 mm"])
    speed: Turning = Field(examples=["3 rpm"])
    depth: Length | None = None
    fill: Fraction | None = None
    count: Count | None = None
    end_wall_friction: Friction | None = None


class HopperEntry(_ExperimentEntry):
    rig: Literal["hopper"]
    wall: Name = Field(examples=["PMMA"])
    variant: Literal["slot", "conical"] = Field(examples=["slot"])
    bin_width: Length | None = None
    depth: Length | None = None
    outlet: Length | None = None
    cone_height: Length | None = None
    inclination: Release | None = None
    total_mass: Mass | None = None
    count: Count | None = None


ExperimentEntry = DropEntry | PendulumEntry | TiltEntry | PackingEntry | PileEntry | DrumEntry | HopperEntry


class LabFile(_Entry):
    lab: LabEntry = LabEntry()
    materials: dict[str, MaterialEntry] = {}
    particles: dict[str, ParticleEntry] = {}
    contacts: dict[str, ContactEntry] = {}
    uncertainty: UncertaintyEntry = UncertaintyEntry()
    experiments: list[Annotated[ExperimentEntry, Field(discriminator="rig")]] = []


class ModelFile(_Entry):
    materials: dict[str, MaterialEntry] = {}
    particles: dict[str, ParticleEntry] = {}
    contacts: dict[str, ContactEntry] = {}
    effects: dict[str, dict[str, float]] = {}


_SECTIONS: dict[str, type[_Entry]] = {
    "lab": LabEntry,
    "materials": MaterialEntry,
    "particles": ParticleEntry,
    "contacts": ContactEntry,
    "uncertainty": UncertaintyEntry,
}
_EXPERIMENTS: dict[str, type[_Entry]] = {
    rig: entry for entry in get_args(ExperimentEntry) for rig in get_args(entry.model_fields["rig"].annotation)
}

File = TypeVar("File", LabFile, ModelFile)


def validated(document: Document, kind: type[File]) -> File:
    """The document as `kind`.  Raises `BadLabFile` naming file, line and key."""
    try:
        return kind.model_validate(document.data)
    except ValidationError as error:
        raise document.error([_problem(details, kind) for details in error.errors()]) from None


def _problem(details: ErrorDetails, kind: type[_Entry]) -> Problem:
    place = details["loc"]
    parent = place[:-1]
    section = kind if not parent else _section(parent)
    key: Key = (*place[:2], *place[3:]) if place[:1] == ("experiments",) and len(place) > 2 else place
    name, given = str(place[-1]) if place else "", _shown(details["input"])
    match details["type"]:
        case "missing":
            return Problem(key, f"this key is missing; add {name} = {_example(section, name)}.")
        case "extra_forbidden":
            return Problem(key, f"unknown key; {suggestion(name, section.model_fields)}.")
        case "value_error":
            return Problem(key, str(details["ctx"]["error"]))
        case "union_tag_not_found":
            return Problem((*key, "rig"), f'this key is missing; add rig = "drop" (known: {", ".join(RIGS)}).')
        case "union_tag_invalid":
            return Problem((*key, "rig"), unknown_rig(str(details["ctx"]["tag"])))
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
        case "dict_type" | "model_type" | "model_attributes_type":
            return Problem(key, f"{given} is not a table; write it as [{_header(key)}] with its keys below.")
    return Problem(key, f"{given} cannot be used ({details['msg'].lower()}).")


def _section(parent: Key) -> type[_Entry]:
    """The class whose keys stand under `parent`; pydantic puts the rig's name after an experiment's number."""
    if parent[0] == "experiments" and len(parent) > 2:
        tables: dict[str | int, type[_Entry]] = {"camera": CameraEntry, "files": FileEntry}
        return tables.get((*parent, "")[3]) or _EXPERIMENTS[str(parent[2])]
    return _SECTIONS.get(str(parent[0]), LabFile)


def _example(section: type[_Entry], name: str) -> str:
    examples = section.model_fields[name].examples or ["..."]
    return _toml(examples[0])


def _shown(value: Any) -> str:
    return "a table" if isinstance(value, dict) else repr(value)


def _header(key: Key) -> str:
    return dotted(tuple(part for part in key if isinstance(part, str)))


def _list_hint(section: type[_Entry], name: str) -> str:
    if name == "experiments":
        return "each experiment under [[experiments]], with double brackets"
    return f"{name} = {_example(section, name)}"


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def suggestion(name: str, known: Iterable[str]) -> str:
    """The nearest known name as advice, or all of them.

    >>> suggestion("framerate", ["frame_rate", "scale"])
    "did you mean 'frame_rate'? (known: frame_rate, scale)"
    """
    names = list(dict.fromkeys(known))
    near = difflib.get_close_matches(name.lower(), [word.lower() for word in names], n=1)
    listed = ", ".join(names) or "none"
    if not near:
        return f"known are {listed}"
    found = next(word for word in names if word.lower() == near[0])
    return f"did you mean {found!r}? (known: {listed})"


def unknown_rig(name: str) -> str:
    """What to say of a rig that cannot be read."""
    return f"there is no rig {name!r}; {suggestion(name, RIGS)}."
