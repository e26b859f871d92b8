"""The door: parse, call one function, print.

stdout carries the result (a table, or one JSON document with ``--json``), stderr the progress and the errors.
Only typer and rich are imported at the top, so that ``--help`` answers at once.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.markup import escape

from rigtwin import __version__

if TYPE_CHECKING:
    from rich.console import Console

    from rigtwin.compare.comparison import Comparison
    from rigtwin.compare.diagnose.diagnosis import Diagnosis
    from rigtwin.compare.twin import Twin
    from rigtwin.lab.camera import Camera
    from rigtwin.lab.progress import Progress
    from rigtwin.lab.quantity import Check, Measurement, Quantity

app = typer.Typer(
    name="rigtwin",
    help="Measure granular materials from videos and photos, simulate the same rigs, set the two side by side.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help pages: typer's decorated ones take twice as long to show
)
measure_app = typer.Typer(help="Measure one rig from its video or photos.", no_args_is_help=True, rich_markup_mode=None)
simulate_app = typer.Typer(help="Run the twin of one rig.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(measure_app, name="measure")
app.add_typer(simulate_app, name="simulate")

Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for results.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress, no tables.")]


def _option(flag: str, metavar: str, help_text: str) -> Any:
    return typer.Option(flag, metavar=metavar, help=help_text)


FrameRate = Annotated[
    str | None, _option("--frame-rate", "240Hz", "Capture rate; without it the file's own rate is used.")
]
Scale = Annotated[str | None, _option("--scale", "0.2mm/px", "Length of one pixel at the bead.")]
KnownLength = Annotated[
    str | None,
    _option("--known-length", "100mm:x1,y1,x2,y2", "A length in view and the two pixels it spans."),
]
Region = Annotated[str | None, _option("--region", "x,y,w,h", "Look only here (pixels).")]
Start = Annotated[str | None, _option("--start", "0.25s|60f", "Where to begin, in seconds or frames.")]
End = Annotated[str | None, _option("--end", "1.5s|360f", "Where to stop, in seconds or frames.")]
CameraRoll = Annotated[
    str | None,
    _option("--camera-roll", "1.5deg", "Camera roll; positive: the scene looks turned clockwise."),
]
BeadDiameter = Annotated[str | None, typer.Option("--bead-diameter", metavar="6mm", help="Diameter of the bead.")]
BeadMass = Annotated[str | None, typer.Option("--bead-mass", metavar="0.69g", help="Mass of one bead.")]

LabFolder = Annotated[
    Path | None, _option("--lab", "DIR", "Take particle, wall and contact from this lab folder's lab.toml.")
]
ParticleName = Annotated[str, _option("--particle", "NAME", "D4, D6, D12, ... or a particle of --lab.")]
WallName = Annotated[str, _option("--wall", "NAME", "steel, ... or a material of --lab.")]
Restitution = Annotated[float | None, _option("--restitution", "0..1", "Restitution of the contact.")]
StaticFriction = Annotated[float | None, _option("--static-friction", "MU", "Static friction between particles.")]
RollingFriction = Annotated[float | None, _option("--rolling-friction", "MU", "Rolling friction between particles.")]
TwinRate = Annotated[str, typer.Option("--frame-rate", metavar="240Hz", help="How often the twin's record is taken.")]
Duration = Annotated[str | None, typer.Option("--duration", metavar="1.5s", help="How long the twin is watched.")]
Seed = Annotated[int, typer.Option("--seed", help="Seed of everything random in the twin.")]
Count = Annotated[int, typer.Option("--count", min=1, help="Number of particles poured on the base.")]
Heaps = Annotated[int, typer.Option("--heaps", min=1, help="Heaps that a pile's twin pours, from --seed upwards.")]
Threads = Annotated[int | None, typer.Option("--threads", min=1, help="CPU threads of the twin; all by default.")]


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rigtwin {__version__}")
        raise typer.Exit


@app.callback()
def _rigtwin(
    *,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Options that stand before the command."""


@app.command()
def demo(
    *,
    out: Out = None,
    count: Count = 1000,
    seed: Seed = 1,
    heaps: Heaps = 1,
    threads: Threads = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """The main job on the sample media: measure three rigs, run their twins, write a report."""
    from rigtwin.lab.errors import BadInput

    lab = Path(__file__).parent / "sample_media"
    if not (lab / "lab.toml").is_file():
        raise BadInput(
            f"{lab}: the sample media are not here; they come with the source repository, not with the installed "
            "package: run the demo from a clone, or `rigtwin compare LAB` on a lab folder of your own."
        )
    _compare(
        lab,
        out or Path("out/demo"),
        only=None,
        count=count,
        seed=seed,
        heaps=heaps,
        threads=threads,
        as_json=as_json,
        quiet=quiet,
    )


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The new lab folder.")],
    *,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make a new lab folder with a commented lab.toml."""
    from rigtwin.lab.notebook import new_lab

    written = new_lab(folder)
    if as_json:
        _print_json({"lab": str(folder), "files": [str(path) for path in written]})
    elif not quiet:
        typer.echo(
            f"Wrote {', '.join(map(str, written))}. Describe your rigs there, put the media beside it, then: "
            f"rigtwin compare {folder}"
        )


@app.command()
def compare(
    lab: Annotated[Path, typer.Argument(metavar="LAB", help="Lab folder with a lab.toml.")],
    *,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="ID", help="Only this experiment; may be given again.")
    ] = None,
    count: Annotated[
        int | None, typer.Option("--count", min=1, help="Particles in the pile's twin, where lab.toml gives none.")
    ] = None,
    seed: Seed = 1,
    heaps: Heaps = 1,
    threads: Threads = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Measure every experiment of a lab, run the matched twins, write percent deviations and a report."""
    _compare(
        lab,
        out or (lab if lab.is_dir() else lab.parent) / "out",
        only=only,
        count=count,
        seed=seed,
        heaps=heaps,
        threads=threads,
        as_json=as_json,
        quiet=quiet,
    )


@app.command()
def diagnose(
    lab: Annotated[Path, typer.Argument(metavar="LAB", help="Folder with a lab.json of tracked repetitions.")],
    *,
    effect: Annotated[
        list[Path] | None,
        typer.Option("--effect", metavar="FILE", help="Your own effect, one Python file; may be given again."),
    ] = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find where twin and measurement disagree, name the missing effect, add it, show the gap shrink."""
    from rigtwin.compare.diagnose.run import diagnose_folder

    target = out or (lab if lab.is_dir() else lab.parent) / "out"
    with _progress(as_json or quiet) as progress:
        diagnosis, files = diagnose_folder(lab, target, own=effect or (), progress=progress)
    if as_json:
        _print_json({**diagnosis.to_json(), "files": files})
    elif not quiet:
        _show_diagnosis(diagnosis, files)


@measure_app.command(
    "drop",
    epilog="Example: rigtwin measure drop drop.mp4 --frame-rate 240Hz --bead-diameter 6mm --bead-density 568kg/m^3",
)
def measure_drop(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the drop.")],
    *,
    bead_diameter: BeadDiameter = None,
    bead_density: Annotated[
        str | None,
        typer.Option("--bead-density", metavar="568kg/m^3", help="Density, to allow for the air."),
    ] = None,
    bead_mass: BeadMass = None,
    frame_rate: FrameRate = None,
    scale: Scale = None,
    known_length: KnownLength = None,
    region: Region = None,
    start: Start = None,
    end: End = None,
    camera_roll: CameraRoll = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A bead falls on a plate and bounces: heights and restitution per bounce."""
    diameter = _positive(bead_diameter, "length", "--bead-diameter")
    density = _density(bead_density, bead_mass, diameter)
    camera = _camera(
        frame_rate=frame_rate,
        scale=scale,
        known_length=known_length,
        region=region,
        start=start,
        end=end,
        camera_roll=camera_roll,
    )
    from rigtwin.measure import drop

    with _progress(as_json or quiet) as progress:
        measurement = drop.measure(
            clip, camera, bead_diameter=diameter, bead_density=density, out=out or Path("out"), progress=progress
        )
    _show_measurement(measurement, as_json, quiet)


@measure_app.command(
    "pendulum",
    epilog="Example: rigtwin measure pendulum swing.mp4 --frame-rate 240Hz --length 300mm --bead-diameter 12mm",
)
def measure_pendulum(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the pendulum.")],
    *,
    variant: Annotated[
        Literal["double", "wall"], typer.Option(help="Two beads, or one bead against a wall.")
    ] = "double",
    length: Annotated[str | None, typer.Option("--length", metavar="300mm", help="Hinge to bead centre.")] = None,
    bead_diameter: BeadDiameter = None,
    bead_mass: BeadMass = None,
    frame_rate: FrameRate = None,
    scale: Scale = None,
    known_length: KnownLength = None,
    region: Region = None,
    start: Start = None,
    end: End = None,
    camera_roll: CameraRoll = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Bead A swings against bead B: angles and restitution of the pair."""
    hinge = _positive(length, "length", "--length")
    diameter = _positive(bead_diameter, "length", "--bead-diameter")
    mass = _positive(bead_mass, "mass", "--bead-mass")
    camera = _camera(
        frame_rate=frame_rate,
        scale=scale,
        known_length=known_length,
        region=region,
        start=start,
        end=end,
        camera_roll=camera_roll,
    )
    from rigtwin.measure import pendulum

    with _progress(as_json or quiet) as progress:
        measurement = pendulum.measure(
            clip,
            camera,
            variant=variant,
            length=hinge,
            bead_diameter=diameter,
            bead_mass=mass,
            out=out or Path("out"),
            progress=progress,
        )
    _show_measurement(measurement, as_json, quiet)


@measure_app.command(
    "pile", epilog="Example: rigtwin measure pile front.jpg side.jpg --base-diameter 90mm --bead-diameter 6mm"
)
def measure_pile(
    photos: Annotated[
        list[Path], typer.Argument(metavar="PHOTO...", help="Photos of one pile; several are its views.")
    ],
    *,
    base_diameter: Annotated[
        str | None, typer.Option("--base-diameter", metavar="90mm", help="Diameter of the base disc.")
    ] = None,
    bead_diameter: BeadDiameter = None,
    scale: Scale = None,
    known_length: KnownLength = None,
    region: Region = None,
    camera_roll: CameraRoll = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A heap on a base: its profile and angle of repose, graphical and geometric."""
    base = _positive(base_diameter, "length", "--base-diameter")
    diameter = _positive(bead_diameter, "length", "--bead-diameter")
    camera = _camera(scale=scale, known_length=known_length, region=region, camera_roll=camera_roll)
    _all_different(photos)
    from rigtwin.measure import pile

    with _progress(as_json or quiet) as progress:
        measurement = pile.measure(
            photos, camera, base_diameter=base, bead_diameter=diameter, out=out or Path("out"), progress=progress
        )
    _show_measurement(measurement, as_json, quiet)


@simulate_app.command("drop", epilog="Example: rigtwin simulate drop --drop-height 300mm --particle D6 --wall steel")
def simulate_drop(
    *,
    drop_height: Annotated[
        str, typer.Option("--drop-height", metavar="300mm", help="From the bead's lowest point to the plate.")
    ],
    particle: ParticleName = "D6",
    wall: WallName = "steel",
    lab: LabFolder = None,
    bounces: Annotated[int, typer.Option("--bounces", min=1, help="How many bounces to show.")] = 4,
    restitution: Restitution = None,
    frame_rate: TwinRate = "240Hz",
    duration: Duration = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A bead dropped on a plate."""
    from rigtwin.compare import cast
    from rigtwin.lab.rigs import Drop

    rig = Drop(_needed(drop_height, "length", "--drop-height"), bounces)
    rate, span = _needed(frame_rate, "frequency", "--frame-rate"), _positive(duration, "time", "--duration")
    model = cast.model_of(lab)
    bead, plate = cast.particle(particle, model), cast.wall(wall, model)
    contact = cast.contact(bead.name, plate.name, model, ("restitution",), restitution=restitution)
    from rigtwin.compare.twin import drop_twin

    with _progress(as_json or quiet) as progress:
        twin = drop_twin(rig, bead, plate, contact, frame_rate=rate, duration=span, progress=progress)
    _show_twin(twin, out or Path("out/simulate-drop"), as_json, quiet)


@simulate_app.command(
    "pendulum", epilog="Example: rigtwin simulate pendulum --length 300mm --release-angle 45deg --particle D12"
)
def simulate_pendulum(
    *,
    length: Annotated[str, typer.Option("--length", metavar="300mm", help="Hinge to bead centre.")],
    release_angle: Annotated[
        str, typer.Option("--release-angle", metavar="45deg", help="Of bead A, from the vertical.")
    ],
    particle: ParticleName = "D12",
    lab: LabFolder = None,
    restitution: Restitution = None,
    frame_rate: TwinRate = "240Hz",
    duration: Duration = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Bead A swings from an angle and hits bead B at rest."""
    from rigtwin.compare import cast
    from rigtwin.lab.rigs import Pendulum

    rig = Pendulum(_needed(length, "length", "--length"), _needed(release_angle, "angle", "--release-angle"))
    rate, span = _needed(frame_rate, "frequency", "--frame-rate"), _positive(duration, "time", "--duration")
    model = cast.model_of(lab)
    bead = cast.particle(particle, model)
    contact = cast.contact(bead.name, bead.name, model, ("restitution",), restitution=restitution)
    from rigtwin.compare.twin import pendulum_twin

    with _progress(as_json or quiet) as progress:
        twin = pendulum_twin(rig, bead, contact, frame_rate=rate, duration=span, progress=progress)
    _show_twin(twin, out or Path("out/simulate-pendulum"), as_json, quiet)


@simulate_app.command(
    "pile", epilog="Example: rigtwin simulate pile --base-diameter 90mm --rim-height 10mm --count 2000"
)
def simulate_pile(
    *,
    base_diameter: Annotated[str, typer.Option("--base-diameter", metavar="90mm", help="Diameter of the base.")],
    rim_height: Annotated[
        str, typer.Option("--rim-height", metavar="10mm", help="Rim of the base; nothing stays on a plate without one.")
    ] = "0 mm",
    outlet_diameter: Annotated[
        str | None, typer.Option("--outlet-diameter", metavar="20mm", help="Outlet that the beads are poured from.")
    ] = None,
    particle: ParticleName = "D6",
    wall: WallName = "steel",
    lab: LabFolder = None,
    restitution: Restitution = None,
    static_friction: StaticFriction = None,
    rolling_friction: RollingFriction = None,
    count: Count = 1000,
    seed: Seed = 1,
    stiffness_factor: Annotated[
        float, typer.Option("--stiffness-factor", help="Young's moduli are multiplied by this, to save time.")
    ] = 1e-3,
    threads: Threads = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Beads poured on a round base until a heap stands."""
    from rigtwin.compare import cast
    from rigtwin.lab.rigs import Pile

    rim = _parsed(rim_height, "length", "--rim-height")
    rig = Pile(
        _needed(base_diameter, "length", "--base-diameter"),
        rim,
        _positive(outlet_diameter, "length", "--outlet-diameter"),
    )
    model = cast.model_of(lab)
    bead, base = cast.particle(particle, model), cast.wall(wall, model)
    contact = cast.contact(
        bead.name,
        bead.name,
        model,
        restitution=restitution,
        static_friction=static_friction,
        rolling_friction=rolling_friction,
    )
    wall_contact = cast.contact(bead.name, base.name, model)
    from rigtwin.compare.twin import pile_twin

    with _progress(as_json or quiet) as progress:
        twin = pile_twin(
            rig,
            bead,
            base,
            contact,
            wall_contact,
            count=count,
            seed=seed,
            stiffness_factor=stiffness_factor,
            threads=threads,
            progress=progress,
        )
    _show_twin(twin, out or Path("out/simulate-pile"), as_json, quiet)


def main() -> None:
    """Entry point of the command ``rigtwin``; leaves with 0, 1 (our fault), 2 (bad input) or 130 (interrupted)."""
    if sys.stdout is None:  # started with stdout closed: results still go into files
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code; every error becomes one sentence, or one JSON document."""
    as_json = "--json" in arguments
    try:
        code = app(arguments, prog_name="rigtwin", standalone_mode=False)
    except typer.TyperException as error:  # unknown option, missing argument; no words after a command alone
        return _fail("usage", _usage(error), 2, as_json) if error.format_message() else 2
    except BrokenPipeError:  # the reader of stdout left, as in `rigtwin ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        return _fault(error, as_json)
    if code == 130:  # typer's word for Ctrl-C
        return _fail("interrupted", "interrupted; results of earlier runs are as they were.", code, as_json)
    return code if isinstance(code, int) else 0


def _fault(error: Exception, as_json: bool) -> int:
    from rigtwin.lab.errors import RigtwinError

    if os.environ.get("RIGTWIN_DEBUG"):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, RigtwinError):
        return _fail(type(error).__name__, str(error), error.exit_code, as_json)
    if isinstance(error, MemoryError):
        message = "this does not fit into memory; ask for fewer particles, a shorter time or a lower frame rate."
        return _fail("memory", message, 2, as_json)
    if isinstance(error, OSError) and error.filename is not None:  # a folder that cannot be made, a full disk
        reason = (error.strerror or "cannot be used").lower()
        return _fail("file", f"{error.filename}: {reason}; check the path and its permissions.", 2, as_json)
    reason = f"{type(error).__name__}: {error}".splitlines()[0]
    message = f"a fault of rigtwin itself ({reason}); set RIGTWIN_DEBUG=1 and run again to see the traceback."
    return _fail("fault", message, 1, as_json)


def _fail(kind: str, message: str, code: int, as_json: bool) -> int:
    sentence = " ".join(message.split())
    if as_json:
        _print_json({"error": {"type": kind, "message": sentence, "exit_code": code}})
    else:
        typer.echo(f"rigtwin: {sentence}", err=True)
    return code


def _usage(error: typer.TyperException) -> str:
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "rigtwin"
    return f"{error.format_message().rstrip('.')}; see `{command} --help`."


def _compare(
    lab: Path,
    out: Path,
    *,
    only: list[str] | None,
    count: int | None,
    seed: int,
    heaps: int,
    threads: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    from rigtwin.compare.comparison import compare as compare_lab

    with _progress(as_json or quiet) as progress:
        comparison = compare_lab(lab, out, progress, only=only, count=count, seed=seed, heaps=heaps, threads=threads)
    if as_json:
        _print_json(comparison.to_json())
    elif not quiet:
        _show_comparison(comparison)


def _camera(
    *,
    frame_rate: str | None = None,
    scale: str | None = None,
    known_length: str | None = None,
    region: str | None = None,
    start: str | None = None,
    end: str | None = None,
    camera_roll: str | None = None,
) -> Camera:
    from rigtwin.lab import camera

    return camera.Camera(
        frame_rate=_positive(frame_rate, "frequency", "--frame-rate"),
        scale=_positive(scale, "scale", "--scale"),
        known_length=None if known_length is None else camera.known_length(known_length, name="--known-length"),
        region=None if region is None else camera.region(region, name="--region"),
        start=None if start is None else camera.moment(start, name="--start"),
        end=None if end is None else camera.moment(end, name="--end"),
        roll=None if camera_roll is None else camera.roll(camera_roll, name="--camera-roll"),
    )


def _parsed(text: str, dimension: str, name: str) -> float:
    from rigtwin.lab.units import si

    return si(text, dimension, name=name)


def _needed(text: str, dimension: str, name: str) -> float:
    from rigtwin.lab.errors import BadQuantity
    from rigtwin.lab.units import LONGEST

    value = _parsed(text, dimension, name)
    if value <= 0:
        raise BadQuantity(f"{name}: {text!r} cannot be; it must be above zero.")
    if dimension == "length" and value > LONGEST:
        raise BadQuantity(f"{name}: {text!r} is {value:g} m; write a length with its unit, like '300mm'.")
    return value


def _positive(text: str | None, dimension: str, name: str) -> float | None:
    return None if text is None else _needed(text, dimension, name)


def _all_different(photos: Sequence[Path]) -> None:
    """The same photo counted twice would make the mean over views look more certain than it is."""
    from rigtwin.lab.errors import BadInput

    seen: set[Path] = set()
    for photo in photos:
        if photo.resolve() in seen:
            raise BadInput(f"{photo}: is given twice; each view counts once.")
        seen.add(photo.resolve())


def _density(density: str | None, mass: str | None, diameter: float | None) -> float | None:
    """[kg/m^3] as given, or from the bead's mass and diameter."""
    from rigtwin.lab.errors import BadInput

    if mass is None:
        return _positive(density, "density", "--bead-density")
    if density is not None:
        raise BadInput("--bead-mass and --bead-density are both given; leave one of them out.")
    if diameter is None:
        raise BadInput("--bead-mass alone says nothing of the density; give --bead-diameter too.")
    return _needed(mass, "mass", "--bead-mass") / (math.pi / 6 * diameter**3)


@contextmanager
def _progress(hidden: bool) -> Iterator[Progress]:
    """Progress bars on stderr while a person watches; nothing otherwise."""
    if hidden or not sys.stderr.isatty():
        from rigtwin.lab.progress import silent

        yield silent
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: float, total: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total or None)
            bars.update(tasks[stage], completed=done, total=total or None)

        yield show


def _print_json(document: dict[str, Any]) -> None:
    from rigtwin.compare.results import plain

    sys.stdout.write(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def _console() -> Console:
    from rich.console import Console

    # a pipe has no width of its own: keep one row of a table on one line
    return Console(width=None if sys.stdout.isatty() else 160, highlight=False)


def _show_measurement(measurement: Measurement, as_json: bool, quiet: bool) -> None:
    if as_json:
        _print_json(measurement.to_json())
        return
    if quiet:
        return
    console = _console()
    _show_quantities(console, f"{measurement.rig}: {measurement.source.name}", measurement.quantities)
    _show_rest(console, measurement.checks, measurement.warnings, measurement.files)


def _show_twin(twin: Twin, out: Path, as_json: bool, quiet: bool) -> None:
    from rigtwin.compare.twin import write_twin

    files = write_twin(twin, out)
    if as_json:
        _print_json({**twin.to_json(), "files": files})
        return
    if quiet:
        return
    console = _console()
    _show_quantities(console, f"twin of the {twin.rig}", twin.evaluation.quantities)
    for assumption in twin.assumptions:
        console.print(f"[dim]assumed:[/dim] {escape(assumption)}")
    _show_rest(console, twin.evaluation.checks, (*twin.warnings, *twin.evaluation.warnings), files)


def _show_comparison(comparison: Comparison) -> None:
    from rich.table import Table

    from rigtwin.compare.deviation import primary_first
    from rigtwin.compare.wording import percent, reading, siblings, title, z_score

    primary, rest = primary_first(comparison.deviations)
    table = Table(title=escape(comparison.lab.title), title_justify="left")
    for column in ("experiment", "quantity", "which", "measured", "simulated", "deviation", "z", "verdict"):
        table.add_column(column, justify="right" if column in ("measured", "simulated", "deviation", "z") else "left")
    for outcome in comparison.outcomes:
        for row in primary:
            if row.experiment != outcome.experiment.id:
                continue
            table.add_row(
                escape(row.experiment),
                f"{title(row.quantity)} [dim]({escape(row.method)})[/dim]",
                escape(siblings(row.row())),
                reading(row.measured, row.measured_std_uncertainty, row.unit),
                reading(row.simulated, row.simulated_std_uncertainty, row.unit),
                percent(row.percent_deviation, row.percent_deviation_std),
                z_score(row.z),
                escape(row.verdict),
            )
        table.add_section()
    console = _console()
    console.print(table)
    if rest:
        console.print(f"{len(rest)} more (later bounces, single sides, other methods) in the report and deviations.csv")
    for reason in dict.fromkeys(f"{row.experiment}: {row.doubtful}" for row in primary if row.doubtful):
        console.print(f"[yellow]doubtful:[/yellow] {escape(reason)}")
    for outcome in comparison.outcomes:
        for warning in outcome.warnings:
            console.print(f"[yellow]warning:[/yellow] {escape(outcome.experiment.id)}: {escape(warning)}")
    for path in comparison.files.values():
        typer.echo(f"wrote {path}")


def _show_diagnosis(diagnosis: Diagnosis, files: Mapping[str, Path]) -> None:
    console = _console()
    console.print(f"[bold]{escape(diagnosis.verdict)}[/bold]: {escape(diagnosis.reason)}")
    document = diagnosis.to_json()
    console.print(f"where: {escape(document['where_in_words'])}")
    for effect in document["effects"]:
        for name, found in effect["parameters"].items():
            console.print(
                f"{escape(effect['title'])}: {name} = {found['value']:.4g} ± {found['std']:.2g} {found['unit']}"
            )
    if diagnosis.form:
        console.print(f"form: {escape(diagnosis.form)}")
    if diagnosis.gap is not None:
        gap = diagnosis.gap
        console.print(f"gap: {gap.before:.4g} before, {gap.after:.4g} after, noise alone {gap.noise_floor:.4g}")
    if diagnosis.next_experiment:
        console.print(f"next: {escape(diagnosis.next_experiment)}")
    for path in files.values():
        typer.echo(f"wrote {path}")


def _show_quantities(console: Console, heading: str, quantities: Sequence[Quantity]) -> None:
    from rich.table import Table

    from rigtwin.compare.wording import reading, siblings, title

    table = Table(title=escape(heading), title_justify="left")
    for column in ("quantity", "which", "value ± standard uncertainty", "method", ""):
        table.add_column(column, justify="right" if column.startswith("value") else "left")
    over_views = [quantity for quantity in quantities if quantity.detail.get("view") == "all"]
    shown = over_views or quantities
    for quantity in shown:
        table.add_row(
            title(quantity.quantity),
            escape(siblings(quantity.detail)),
            reading(quantity.value, quantity.std_uncertainty, quantity.unit),
            escape(quantity.method),
            "[yellow]doubtful[/yellow]" if quantity.doubtful else "",
        )
    console.print(table)
    if len(shown) < len(quantities):
        console.print(f"{len(quantities) - len(shown)} more (view by view, left and right): add --json")
    for reason in dict.fromkeys(quantity.doubtful for quantity in shown if quantity.doubtful):
        console.print(f"[yellow]doubtful:[/yellow] {escape(reason)}")


def _show_rest(console: Console, checks: Sequence[Check], warnings: Sequence[str], files: Mapping[str, Path]) -> None:
    for passed, name, message in dict.fromkeys((check.passed, check.check, check.message) for check in checks):
        mark = "[green]passed[/green]" if passed else "[red]failed[/red]"
        console.print(f"{mark} {escape(name.replace('_', ' '))}: {escape(message)}")
    for warning in warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    for path in dict.fromkeys(files.values()):
        typer.echo(f"wrote {path}")


if __name__ == "__main__":
    main()
