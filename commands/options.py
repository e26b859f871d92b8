"""Options that several commands share, and the quantities read from them.

Only typer is imported at the top, so that ``--help`` answers at once.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for results.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress, no tables.")]


def option(flag: str, metavar: str, help_text: str) -> Any:
    """An option with a value."""
    return typer.Option(flag, metavar=metavar, help=help_text)


BeadDiameter = Annotated[str | None, option("--bead-diameter", "6mm", "Diameter of the bead.")]
BeadMass = Annotated[str | None, option("--bead-mass", "0.69g", "Mass of one bead.")]
TotalMass = Annotated[str | None, option("--total-mass", "212.7g", "Mass of all beads together.")]

CAMERA: dict[str, Any] = {
    "frame_rate": Annotated[
        str | None, option("--frame-rate", "240Hz", "Capture rate; without it the file's own rate is used.")
    ],
    "scale": Annotated[str | None, option("--scale", "0.2mm/px", "Length of one pixel at the bead.")],
    "known_length": Annotated[
        str | None, option("--known-length", "100mm:x1,y1,x2,y2", "A length in view and the two pixels it spans.")
    ],
    "region": Annotated[str | None, option("--region", "x,y,w,h", "Look only here (pixels).")],
    "start": Annotated[str | None, option("--start", "0.25s|60f", "Where to begin, in seconds or frames.")],
    "end": Annotated[str | None, option("--end", "1.5s|360f", "Where to stop, in seconds or frames.")],
    "camera_roll": Annotated[
        str | None, option("--camera-roll", "1.5deg", "Camera roll; positive: the scene looks turned clockwise.")
    ],
    "plumb_line": Annotated[
        str | None, option("--plumb-line", "x1,y1,x2,y2", "Two points of a plumb line, instead of --camera-roll.")
    ],
    "board": Annotated[
        str | None,
        option(
            "--board",
            "'checkerboard 9x6 10mm board.jpg'",
            "Photo of a board in the plane of the motion (also charuco, aruco): gives the scale, removes perspective.",
        ),
    ],
}
"""What the person says of the camera; the same words are keys of ``[experiments.camera]`` in lab.toml."""

SHORTEST, LARGEST_BEAD = 1e-6, 0.5  # [m], what a camera resolves, and a unit that was forgotten
HEAVIEST = 25_000.0  # [kg/m^3], osmium has 22 600

PHOTO = ("scale", "known_length", "region", "camera_roll", "plumb_line", "board")

Seed = Annotated[int, typer.Option("--seed", help="Seed of everything random in the twin.")]
Heaps = Annotated[int, typer.Option("--heaps", min=1, help="Heaps that a pile's twin pours, from --seed upwards.")]
Threads = Annotated[int | None, typer.Option("--threads", min=1, help="CPU threads of the twin; all by default.")]


def filmed(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the camera's options (all, or those named); it gets them as one keyword, `camera`."""
    wanted = {name: (CAMERA[name], None) for name in names or CAMERA}
    return gathered("camera", wanted, camera_of)


def gathered(
    keyword: str, wanted: Mapping[str, tuple[Any, Any]], gather: Callable[..., Any], before: str = "out"
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command options (annotation and default by name); it gets what `gather` makes of them as one `keyword`.

    They stand before its option `before`.
    """

    def wrap(command: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(command, eval_str=True)
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for name, (annotation, default) in wanted.items()
        ]
        kept = [parameter for name, parameter in own.parameters.items() if name != keyword]
        last = next((k for k, parameter in enumerate(kept) if parameter.name == before), len(kept))

        @functools.wraps(command)
        def wrapped(*args: Any, **given: Any) -> None:
            said = {name: given.pop(name) for name in wanted}
            command(*args, **given, **{keyword: gather(**said)})

        signature = own.replace(parameters=[*kept[:last], *added, *kept[last:]])
        wrapped.__signature__ = signature  # type: ignore[attr-defined]
        wrapped.__annotations__ = {name: item.annotation for name, item in signature.parameters.items()}
        return wrapped

    return wrap


def camera_of(
    *,
    frame_rate: str | None = None,
    scale: str | None = None,
    known_length: str | None = None,
    region: str | None = None,
    start: str | None = None,
    end: str | None = None,
    camera_roll: str | None = None,
    plumb_line: str | None = None,
    board: str | None = None,
) -> Any:
    """The `Camera` that the options describe."""
    from rigtwin.lab import camera
    from rigtwin.lab.errors import BadInput

    if camera_roll is not None and plumb_line is not None:
        raise BadInput("--camera-roll and --plumb-line are both given; leave one of them out.")
    roll = None if camera_roll is None else camera.roll(camera_roll, name="--camera-roll")

    said = camera.Camera(
        frame_rate=positive(frame_rate, "frequency", "--frame-rate"),
        scale=positive(scale, "scale", "--scale"),
        known_length=None if known_length is None else camera.known_length(known_length, name="--known-length"),
        region=None if region is None else camera.region(region, name="--region"),
        start=None if start is None else camera.moment(start, name="--start"),
        end=None if end is None else camera.moment(end, name="--end"),
        roll=roll if plumb_line is None else camera.plumb_line(plumb_line, name="--plumb-line"),
        board=None if board is None else camera.board(board, name="--board"),
    )
    if said.board is None:
        return said
    from rigtwin.measure.board import straightened

    return straightened(said)


def parsed(text: str, dimension: str, name: str) -> float:
    """A quantity in SI."""
    from rigtwin.lab.units import si

    return si(text, dimension, name=name)


def needed(text: str, dimension: str, name: str) -> float:
    """A quantity in SI that must be above zero, and no longer than a bench where it is a length."""
    from rigtwin.lab.errors import BadQuantity
    from rigtwin.lab.units import LONGEST

    value = parsed(text, dimension, name)
    if value <= 0:
        raise BadQuantity(f"{name}: {text!r} is not above zero; give a positive value.")
    bead = name == "--bead-diameter"
    if dimension == "length" and not SHORTEST <= value <= (LARGEST_BEAD if bead else LONGEST):
        what, example = ("a bead's diameter", "6mm") if bead else ("a length", "300mm")
        raise BadQuantity(f"{name}: {text!r} is {value:g} m; write {what} with its unit, like {example!r}.")
    return value


def positive(text: str | None, dimension: str, name: str) -> float | None:
    """`needed`, or None where the option was not given."""
    return None if text is None else needed(text, dimension, name)


def density(given: str | None, mass: str | None, diameter: float | None) -> float | None:
    """[kg/m^3] as given, or from the bead's mass and diameter."""
    from rigtwin.lab.errors import BadInput

    if mass is None:
        return _possible(positive(given, "density", "--bead-density"), "--bead-density")
    if given is not None:
        raise BadInput("--bead-mass and --bead-density are both given; leave one of them out.")
    if diameter is None:
        raise BadInput("--bead-mass alone says nothing of the density; give --bead-diameter too.")
    return _possible(needed(mass, "mass", "--bead-mass") / (math.pi / 6 * diameter**3), "--bead-mass")


def _possible(value: float | None, name: str) -> float | None:
    from rigtwin.lab.errors import BadQuantity

    if value is not None and value > HEAVIEST:
        raise BadQuantity(
            f"{name}: the bead would weigh {value:.3g} kg/m^3, more than any metal; "
            "check its unit and the bead's diameter."
        )
    return value


def all_different(photos: Sequence[Path]) -> None:
    """The same photo counted twice would make the mean over views look more certain than it is."""
    from rigtwin.lab.errors import BadInput

    seen: set[Path] = set()
    for photo in photos:
        if photo.resolve() in seen:
            raise BadInput(f"{photo}: is given twice; each view counts once.")
        seen.add(photo.resolve())
