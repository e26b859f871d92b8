"""Options that several commands share, and the quantities read from them.

Only typer is imported at the top, so that ``--help`` answers at once.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated, Any, Literal

import typer

from rigtwin.lab.units import MOST_RUNS
from rigtwin.sim.engine import device

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress, no tables.")]


def option(flag: str, metavar: str, help_text: str, parser: Callable[[str], Any] | None = None, **more: Any) -> Any:
    """An option with a value; `more` goes to `typer.Option`."""
    return typer.Option(flag, metavar=metavar, help=help_text, parser=parser, **more)


def quantity(
    flag: str, dimension: str, example: str, help_text: str, *, zero: bool = False, highest: float = math.inf
) -> Any:
    """An option written with its unit, like ``6mm``; the command gets it in SI.

    It must be above zero, or `zero` itself, and at most `highest`.
    """

    def read(text: str | float) -> float:  # no partial: click asks for a name
        return _size(text, dimension, flag, zero, highest)

    return typer.Option(flag, metavar=example, help=help_text, parser=read, show_default=False)


OWN_FOLDER = "give --out a folder of your own"


def writable_folder(text: str | Path) -> Path:
    """A folder for results, given with --out; refused before an hour of work and not after it."""
    if not str(text).strip():
        from rigtwin.lab.errors import BadInput

        raise BadInput("--out: the name of the folder is empty; give one, or leave --out out.")
    folder = Path(text)
    _check_writable(folder, "--out: ", "and results go into a folder; give --out another name", OWN_FOLDER)
    return folder


def default_folder(folder: Path) -> Path:
    """The folder for results where none is given, refused as `writable_folder` does."""
    _check_writable(
        folder, "", f"and results go into the folder {folder}; move it, or give a folder with --out", OWN_FOLDER
    )
    return folder


def file_option(flag: str, metavar: str, help_text: str, **more: Any) -> Any:
    """An option that names a file to be written, refused before the work and not after it."""

    def read(text: str) -> Path:
        from rigtwin.lab.errors import BadInput

        file = Path(text)
        if file.is_dir():
            raise BadInput(f"{flag}: {file} is a folder; give the name of a file.")
        elsewhere = "name a file elsewhere"
        _check_writable(file.absolute().parent, f"{flag}: ", f"not a folder; {elsewhere}", elsewhere)
        return file

    return option(flag, metavar, help_text, read, **more)


def _check_writable(folder: Path, begin: str, because: str, instead: str) -> None:
    """Refuse a folder that cannot be made or written into: this one, or the nearest above it that is there."""
    from rigtwin.lab.errors import BadInput

    standing = next((above for above in (folder, *folder.absolute().parents) if above.exists()), folder)
    if not standing.is_dir():
        raise BadInput(f"{begin}{standing} is a file, {because}.")
    try:  # permissions do not show everything: some file systems are read-only for every user
        with TemporaryFile(dir=standing):
            pass
    except OSError:
        raise BadInput(f"{begin}nothing may be written into {standing}; {instead}.") from None


def out_option(help_text: str) -> Any:
    """The option ``--out``."""
    return option("--out", "DIR", help_text, writable_folder)


Out = Annotated[Path | None, out_option("Folder for results; LAB/out by default.")]
Outside = Annotated[
    bool, typer.Option("--allow-outside", help="Let the lab name files outside its folder (absolute paths, links, ..).")
]
Only = Annotated[
    list[str] | None, typer.Option("--only", metavar="ID", help="Only this experiment; may be given again.")
]
Again = Annotated[bool, typer.Option("--again", help="Measure repetitions again whose measurements are kept in OUT.")]


def beside(lab: Path, out: Path | None) -> Path:
    """Folder for results: `out`, or ``out`` in the lab folder, which is refused where nothing may be written."""
    return out or default_folder((lab if lab.is_dir() else lab.parent) / "out")


BeadDiameter = Annotated[float | None, quantity("--bead-diameter", "length", "6mm", "Diameter of the bead.")]
BeadMass = Annotated[float | None, quantity("--bead-mass", "mass", "0.69g", "Mass of one bead.")]
TotalMass = Annotated[float | None, quantity("--total-mass", "mass", "212.7g", "Mass of all beads together.")]


def _read_by(reader: str, flag: str, metavar: str, help_text: str) -> Any:
    """An option of the camera; `reader` is the function of `rigtwin.lab.camera` that reads its text."""

    def read(text: Any) -> Any:
        from rigtwin.lab import camera

        return getattr(camera, reader)(text, name=flag)

    return option(flag, metavar, help_text, read)


_STRAIGHT = "; with --board those of the straightened picture"

CAMERA: dict[str, Any] = {
    "frame_rate": Annotated[
        float | None,
        quantity(
            "--frame-rate",
            "frequency",
            "240Hz",
            "Capture rate (a bare number is in Hz); without it the file's own rate is used.",
        ),
    ],
    "scale": Annotated[float | None, quantity("--scale", "scale", "0.2mm/px", "Length of one pixel at the bead.")],
    "known_length": Annotated[
        Any,
        _read_by(
            "known_length", "--known-length", "100mm:x1,y1,x2,y2", "A length in view and the two pixels it spans."
        ),
    ],
    "region": Annotated[Any, _read_by("region", "--region", "x,y,w,h", f"Look only here (pixels{_STRAIGHT}).")],
    "start": Annotated[Any, _read_by("moment", "--start", "0.25s|60f", "Where to begin, in seconds or frames.")],
    "end": Annotated[Any, _read_by("moment", "--end", "1.5s|360f", "Where to stop, in seconds or frames.")],
    "exclude": Annotated[
        list[Any] | None,
        _read_by("span", "--exclude", "60f..80f|0.2s..0.3s", "Leave this part of the clip out; may be repeated."),
    ],
    "camera_roll": Annotated[
        Any, _read_by("roll", "--camera-roll", "1.5deg", "Camera roll; positive: the scene looks turned clockwise.")
    ],
    "plumb_line": Annotated[
        Any,
        _read_by(
            "plumb_line",
            "--plumb-line",
            "x1,y1,x2,y2",
            f"Two points of a plumb line, instead of --camera-roll (pixels{_STRAIGHT}).",
        ),
    ],
    "board": Annotated[
        Any,
        _read_by(
            "board",
            "--board",
            "'checkerboard 9x6 10mm board.jpg'",
            "Photo of a board in the plane of the motion (also charuco, aruco): gives the scale, removes perspective.",
        ),
    ],
    "ignore": Annotated[
        list[Any] | None,
        _read_by("region", "--ignore", "x,y,w,h", "Take nothing from here (pixels; may be repeated): lamp, hand."),
    ],
    "bead_at": Annotated[
        Any,
        _read_by("seed", "--bead-at", "frame:x,y", "The bead's centre in one frame (pixels); it is followed."),
    ],
    "centre": Annotated[
        list[Any] | None,
        _read_by(
            "seed", "--centre", "frame:x,y", "A bead's centre in one frame, where it is located wrongly or not at all."
        ),
    ],
    "plate": Annotated[
        Any, _read_by("line", "--plate", "x1,y1,x2,y2", "Two points of the plate's surface (pixels; first frame).")
    ],
    "pivot": Annotated[
        list[Any] | None,
        _read_by("point", "--pivot", "x,y", "The hinge (pixels); twice for two: of bead A, then of B."),
    ],
    "base": Annotated[
        Any,
        _read_by("line", "--base", "x1,y1,x2,y2", "Left and right end of the base that the heap stands on (pixels)."),
    ],
    "flank": Annotated[
        Literal["left", "right", "both"] | None,
        typer.Option(help="The flanks that are measured; both where there are two."),
    ],
    "cylinder": Annotated[
        Any,
        _read_by(
            "line", "--cylinder", "x1,y1,x2,y2", "The inner walls at the floor's middle, not at its front (pixels)."
        ),
    ],
    "floor": Annotated[
        Any, _read_by("height", "--floor", "y", "Height of the floor in the picture (pixels from the top).")
    ],
    "circle": Annotated[
        Any, _read_by("circle", "--circle", "cx,cy,r", "The drum's inner rim: centre and radius (pixels).")
    ],
    "averaged": Annotated[
        bool | None,
        typer.Option("--averaged", help="The picture is a mean over time, as of a GranuDrum, not one moment."),
    ],
    "slot": Annotated[Any, _read_by("line", "--slot", "x1,y1,x2,y2", "The two edges of the outlet (pixels).")],
}
"""What the person says of the camera; the same words are keys of ``[experiments.camera]`` in lab.toml."""


def _columns(text: str) -> Any:
    from rigtwin.lab.tracked.columns import parse_columns

    return parse_columns(text, name="--columns")


TABLE: dict[str, tuple[Any, Any]] = {
    "columns": (
        Annotated[
            Any,
            option(
                "--columns",
                "t=NAME[ms],x=NAME,y=NAME",
                "Columns of a table of tracked data, by name or number, where they are not recognised.",
                _columns,
            ),
        ],
        None,
    ),
    "join": (
        Annotated[
            list[str] | None,
            typer.Option("--join", metavar="3,7", help="Parts of one broken track in a table; may be repeated."),
        ],
        None,
    ),
}
"""What the person says of a table of tracked data that is given in place of a film."""

SHORTEST = 1e-6  # [m], what a camera resolves

PHOTO = ("scale", "known_length", "region", "ignore", "camera_roll", "plumb_line", "board")
FILM = ("frame_rate", "start", "end", "exclude", *PHOTO)

Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random in the twin.")]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="WHERE",
        help="Compute the runs on a cluster: tcp://host:8786 (Dask) or slurm; docs/cluster.md.",
    ),
]
Runs = Annotated[
    int,
    typer.Option(
        "--runs",
        "--heaps",
        min=1,
        max=MOST_RUNS,
        help="Runs of a twin of many particles, with seeds from --seed upwards; several at a time, each on one thread.",
    ),
]
Stiffness = Annotated[
    float | None,
    quantity(
        "--stiffness-factor",
        "number",
        "0..1",
        "Young's moduli in a twin of many particles are multiplied by this, to save time; 0.001.",
        highest=1.0,
    ),
]
TimeStep = Annotated[
    float,
    quantity(
        "--time-step-fraction",
        "number",
        "0.3",
        "Time step of the twin in parts of Rayleigh's; 0.3, or less for more accurate contacts.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Take a time step that is known to be unstable, too.")]
Device = Annotated[
    device.Device,
    typer.Option(
        "--device",
        envvar=device.VARIABLE,
        help="Where the twin is worked out; auto: on a GPU where CUDA finds one.",
    ),
]
Threads = Annotated[int | None, typer.Option("--threads", min=1, help="CPU threads of the twin; all by default.")]


Command = Callable[..., Any]


def with_options(
    command: Command, added: Mapping[str, tuple[Any, Any]], around: Callable[..., Any], hidden: str = ""
) -> Command:
    """`command` with options added behind its own (annotation and default by name).

    ``around(own, **said)`` is called in its place: `own` is the command with its own options filled in, `said` what
    was given of the added ones.  The parameter `hidden` is no option: `around` gives it.
    """
    own = inspect.signature(command, eval_str=True)
    kept = [parameter for name, parameter in own.parameters.items() if name != hidden]
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, (annotation, default) in added.items()
    ]

    @functools.wraps(command)
    def wrapped(**given: Any) -> Any:
        said = {name: given.pop(name) for name in added}
        return around(functools.partial(command, **given), **said)

    signature = own.replace(parameters=[*kept, *options])
    wrapped.__signature__ = signature  # type: ignore[attr-defined]
    wrapped.__annotations__ = {name: item.annotation for name, item in signature.parameters.items()}
    return wrapped


def filmed(*names: str) -> Callable[[Command], Command]:
    """Give a command the camera's options that are named; it gets them as one keyword, `camera`."""
    wanted = {name: (CAMERA[name], None) for name in CAMERA if name in names}
    return gathered("camera", wanted, camera_of)


def gathered(
    keyword: str, wanted: Mapping[str, tuple[Any, Any]], gather: Callable[..., Any]
) -> Callable[[Command], Command]:
    """Give a command options (annotation and default by name); it gets what `gather` makes of them as one `keyword`."""

    def around(own: Command, **said: Any) -> Any:
        return own(**{keyword: gather(**said)})

    return lambda command: with_options(command, wanted, around, hidden=keyword)


def tracked(command: Command) -> Command:
    """Give a command the options of a table of tracked data; it gets them as one keyword, `table`."""
    return gathered("table", TABLE, table_of)(command)


def table_of(*, columns: Any = None, join: Any = None) -> Any:
    """The `TableOptions` that the options describe."""
    from rigtwin.lab.tracked.columns import parse_joined
    from rigtwin.lab.tracked.table import TableOptions

    return TableOptions(columns or {}, parse_joined(join or (), name="--join"))


def camera_of(
    *,
    camera_roll: float | None = None,
    plumb_line: float | None = None,
    exclude: list[Any] | None = None,
    ignore: list[Any] | None = None,
    pivot: list[Any] | None = None,
    centre: list[Any] | None = None,
    averaged: bool | None = None,
    **said: Any,
) -> Any:
    """The `Camera` that the options describe."""
    from rigtwin.lab import camera
    from rigtwin.lab.errors import BadInput

    if camera_roll is not None and plumb_line is not None:
        raise BadInput("--camera-roll and --plumb-line are both given; leave one of them out.")
    described = camera.Camera(
        **said,
        roll=camera_roll if plumb_line is None else plumb_line,
        exclude=tuple(exclude or ()),
        ignore=tuple(ignore or ()),
        pivots=tuple(pivot or ()),
        centre=tuple(centre or ()),
        averaged=bool(averaged),
    )
    if described.board is None:
        return described
    from rigtwin.measure.geometry.calibration_board import straightened

    return straightened(described)


def _size(text: str | float, dimension: str, name: str, zero: bool, highest: float) -> float:
    """A quantity in SI that must be above zero, no longer than a bench."""
    from rigtwin.lab.errors import BadQuantity
    from rigtwin.lab.units import LARGEST_BEAD, LONGEST, si

    # a number is a default, which typer has read too, or comes from Python: it is in SI, also where a text needs a unit
    known = isinstance(text, float) and math.isfinite(text)
    value = float(text) if known else si(text, dimension, name=name)
    if value < 0 or (value == 0 and not zero):
        raise BadQuantity(f"{name}: {text!r} is {'below' if zero else 'not above'} zero; give a positive value.")
    too_large = value > highest and not math.isclose(value, highest)  # as radians(175) is another than 175 deg
    if too_large and dimension == "angle":
        raise BadQuantity(
            f"{name}: {text!r} is {math.degrees(value):.4g} degrees, more than {math.degrees(highest):.4g}; "
            "give less, with the angle's unit, like '45deg'."
        )
    if too_large:
        raise BadQuantity(f"{name}: {text!r} is too large; give at most {highest:g}.")
    bead = name == "--bead-diameter"
    if dimension == "length" and value and not SHORTEST <= value <= (LARGEST_BEAD if bead else LONGEST):
        what, example = ("bead's diameter", "6mm") if bead else ("length on a bench", "300mm")
        advice = "check number and unit" if str(text).strip()[-1:].isalpha() else "write it with its unit"
        raise BadQuantity(f"{name}: {text!r} is {value:g} m, no {what}; {advice}, like {example!r}.")
    return value


def density(given: float | None, mass: float | None, diameter: float | None) -> float | None:
    """[kg/m^3] as given, or from the bead's mass [kg] and diameter [m]."""
    from rigtwin.lab.errors import BadInput

    if mass is None:
        return _possible(given, "--bead-density")
    if given is not None:
        raise BadInput("--bead-mass and --bead-density are both given; leave one of them out.")
    if diameter is None:
        raise BadInput("--bead-mass alone says nothing of the density; give --bead-diameter too.")
    return _possible(mass / (math.pi / 6 * diameter**3), "--bead-mass")


def _possible(value: float | None, name: str) -> float | None:
    from rigtwin.lab.errors import BadQuantity
    from rigtwin.lab.materials import no_bead_has

    if value is not None and (odd := no_bead_has(value)):
        raise BadQuantity(f"{name}: {odd}")
    return value
