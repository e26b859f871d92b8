"""``rigtwin measure RIG MEDIA...``: one rig from its video or photos."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from rigtwin.commands.options import (
    PHOTO,
    BeadDiameter,
    BeadMass,
    Json,
    Out,
    Quiet,
    TotalMass,
    all_different,
    density,
    filmed,
    option,
    positive,
)
from rigtwin.commands.show import progress_bars, show_measurement

app = typer.Typer(help="Measure one rig from its video or photos.", no_args_is_help=True, rich_markup_mode=None)

Camera = Any  # a lab.camera.Camera, which `filmed` makes of the camera's options
FOLDER = Path("out")


@app.command(
    "drop",
    epilog="Example: rigtwin measure drop drop.mp4 --frame-rate 240Hz --bead-diameter 6mm --bead-density 568kg/m^3",
)
@filmed()
def measure_drop(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the drop.")],
    *,
    camera: Camera,
    bead_diameter: BeadDiameter = None,
    bead_density: Annotated[str | None, option("--bead-density", "568kg/m^3", "Density, to allow for the air.")] = None,
    bead_mass: BeadMass = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A bead falls on a plate and bounces: heights and restitution per bounce."""
    diameter = positive(bead_diameter, "length", "--bead-diameter")
    solid = density(bead_density, bead_mass, diameter)
    from rigtwin.measure import drop

    with progress_bars(as_json or quiet) as progress:
        measurement = drop.measure(
            clip, camera, bead_diameter=diameter, bead_density=solid, out=out or FOLDER, progress=progress
        )
    show_measurement(measurement, as_json, quiet)


@app.command(
    "pendulum",
    epilog="Example: rigtwin measure pendulum swing.mp4 --frame-rate 240Hz --length 300mm --bead-diameter 12mm",
)
@filmed()
def measure_pendulum(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the pendulum.")],
    *,
    camera: Camera,
    variant: Annotated[
        Literal["double", "wall"], typer.Option(help="Two beads, or one bead against a wall.")
    ] = "double",
    length: Annotated[str | None, option("--length", "300mm", "Hinge to bead centre.")] = None,
    bead_diameter: BeadDiameter = None,
    bead_mass: BeadMass = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Bead A swings against bead B or a wall: angles and restitution."""
    hinge = positive(length, "length", "--length")
    diameter = positive(bead_diameter, "length", "--bead-diameter")
    mass = positive(bead_mass, "mass", "--bead-mass")
    from rigtwin.measure import pendulum

    with progress_bars(as_json or quiet) as progress:
        measurement = pendulum.measure(
            clip,
            camera,
            variant=variant,
            length=hinge,
            bead_diameter=diameter,
            bead_mass=mass,
            out=out or FOLDER,
            progress=progress,
        )
    show_measurement(measurement, as_json, quiet)


@app.command("tilt", epilog="Example: rigtwin measure tilt tilt.mp4 --variant slide --bead-diameter 6mm")
@filmed()
def measure_tilt(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the tilting plate.")],
    *,
    camera: Camera,
    variant: Annotated[
        Literal["slide", "roll"], typer.Option(help="A body that slides (glued beads), or a bead that rolls.")
    ],
    bead_diameter: BeadDiameter = None,
    arm_length: Annotated[str | None, option("--arm-length", "150mm", "Plate or arm, from hinge to tip.")] = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A plate is tilted until the body on it moves: static or rolling friction."""
    diameter = positive(bead_diameter, "length", "--bead-diameter")
    arm = positive(arm_length, "length", "--arm-length")
    from rigtwin.measure import tilt

    with progress_bars(as_json or quiet) as progress:
        measurement = tilt.measure(
            clip,
            camera,
            variant=variant,
            bead_diameter=diameter,
            arm_length=arm,
            out=out or FOLDER,
            progress=progress,
        )
    show_measurement(measurement, as_json, quiet)


@app.command("pile", epilog="Example: rigtwin measure pile front.jpg side.jpg --base-diameter 90mm --bead-diameter 6mm")
@filmed(*PHOTO)
def measure_pile(
    photos: Annotated[
        list[Path], typer.Argument(metavar="PHOTO...", help="Photos of one pile; several are its views.")
    ],
    *,
    camera: Camera,
    base_diameter: Annotated[str | None, option("--base-diameter", "90mm", "Diameter of the base disc.")] = None,
    bead_diameter: BeadDiameter = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A heap on a base: its profile and angle of repose, graphical and geometric."""
    base = positive(base_diameter, "length", "--base-diameter")
    diameter = positive(bead_diameter, "length", "--bead-diameter")
    all_different(photos)
    from rigtwin.measure import pile

    with progress_bars(as_json or quiet) as progress:
        measurement = pile.measure(
            photos, camera, base_diameter=base, bead_diameter=diameter, out=out or FOLDER, progress=progress
        )
    show_measurement(measurement, as_json, quiet)


@app.command("drum", epilog="Example: rigtwin measure drum drum.mp4 --drum-diameter 140mm --speed 3rpm")
@filmed()
def measure_drum(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the rotating drum, or one picture of it.")],
    *,
    camera: Camera,
    drum_diameter: Annotated[str | None, option("--drum-diameter", "140mm", "Inner diameter of the drum.")] = None,
    speed: Annotated[str | None, option("--speed", "3rpm", "How fast the drum turns.")] = None,
    bead_diameter: BeadDiameter = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A bed in a rotating drum: its surface over time and dynamic angle of repose."""
    drum_size = positive(drum_diameter, "length", "--drum-diameter")
    turning = positive(speed, "angular_speed", "--speed")
    diameter = positive(bead_diameter, "length", "--bead-diameter")
    from rigtwin.measure import drum

    with progress_bars(as_json or quiet) as progress:
        measurement = drum.measure(
            clip,
            camera,
            drum_diameter=drum_size,
            speed=turning,
            bead_diameter=diameter,
            out=out or FOLDER,
            progress=progress,
        )
    show_measurement(measurement, as_json, quiet)


@app.command("hopper", epilog="Example: rigtwin measure hopper flow.mp4 --frame-rate 240Hz --bin-width 104mm")
@filmed()
def measure_hopper(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the emptying hopper.")],
    *,
    camera: Camera,
    bin_width: Annotated[str | None, option("--bin-width", "104mm", "Inner width of the bin, for the scale.")] = None,
    total_mass: TotalMass = None,
    bead_diameter: BeadDiameter = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A hopper empties through its outlet: discharge time and flow rate."""
    width = positive(bin_width, "length", "--bin-width")
    mass = positive(total_mass, "mass", "--total-mass")
    diameter = positive(bead_diameter, "length", "--bead-diameter")
    from rigtwin.measure import hopper

    with progress_bars(as_json or quiet) as progress:
        measurement = hopper.measure(
            clip,
            camera,
            bead_diameter=diameter,
            total_mass=mass,
            bin_width=width,
            out=out or FOLDER,
            progress=progress,
        )
    show_measurement(measurement, as_json, quiet)
