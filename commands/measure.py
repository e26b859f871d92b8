"""``rigtwin measure RIG MEDIA...``: one rig from its video or photos."""

from __future__ import annotations

from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperCommand, TyperGroup

from rigtwin.commands.display import show_lab_measurements
from rigtwin.commands.options import (
    FILM,
    PHOTO,
    Again,
    BeadDiameter,
    BeadMass,
    Only,
    Out,
    Outside,
    TotalMass,
    beside,
    density,
    filmed,
    quantity,
    tracked,
)
from rigtwin.commands.run_command import Work, finished, measured
from rigtwin.lab.errors import BadInput
from rigtwin.lab.media_files import FILMS, PICTURES, SOUNDS
from rigtwin.lab.spelling import near

ENDINGS = (*FILMS, *PICTURES, *SOUNDS, ".csv")
"""Suffixes by which a word is known as the name of a clip where there is no such file."""


class RigOrLab(TyperGroup):
    """A command group that also accepts a lab folder or a lab.toml in place of a rig, and measures the whole lab."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        known = self.get_command(ctx, args[0]) if args else None
        if args and known is None and not args[0].startswith("-") and _is_lab(Path(args[0])):
            args = ["lab", *args]
        elif args and args[0] == "lab" and all(word.startswith("-") for word in args[1:2]) and _is_lab(Path("lab")):
            args = ["lab", *args]  # a lab folder of that name
        elif args and known is None and not args[0].startswith("-"):
            self._refuse(ctx, args[0])
        return super().resolve_command(ctx, args)

    def _refuse(self, ctx: Any, word: str) -> None:
        """Refuse what is no rig and no lab."""
        rigs = [name for name in self.list_commands(ctx) if name != "lab"]
        if Path(word).exists():
            ctx.fail(
                f"{word}: the rig that it shows is missing before it, as in `rigtwin measure {rigs[0]} {word}`; "
                f"rigs are {', '.join(rigs)}"
            )
        if Path(word).name != word or Path(word).suffix:
            ctx.fail(f"{word}: no such file or folder")
        meant = near(word, rigs)
        advice = f"did you mean {meant!r}? (rigs are {', '.join(rigs)})" if meant else f"rigs are {', '.join(rigs)}"
        ctx.fail(f"{word}: is neither a rig nor a lab folder; {advice}")


class OneClip(TyperCommand):
    """A command that takes one clip, and says what to do with several."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        ctx.allow_extra_args = True
        further = super().parse_args(ctx, args)
        if ctx.resilient_parsing:  # completion of a line that is not finished
            return further
        if further and all(Path(word).exists() or Path(word).suffix.lower() in ENDINGS for word in further):
            ctx.fail(one_clip(str(ctx.info_name), 1 + len(further)))
        if further:
            ctx.fail(f"Got unexpected extra argument(s) ({' '.join(further)})")
        return further


def one_clip(rig: str, given: int) -> str:
    """The refusal of several clips where a rig's measurement takes one."""
    return f"measure {rig} takes one clip, and {given} are given; for several make a lab, with `rigtwin init LAB`"


def _is_lab(path: Path) -> bool:
    return path.suffix == ".toml" or path.is_dir()


app = typer.Typer(
    cls=RigOrLab,
    help="Measure one rig from its video or photos, or a whole lab.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Camera = Any  # a lab.camera.Camera, which `filmed` makes of the camera's options

Table = Any  # a lab.tracked.table.TableOptions, which `tracked` makes of its options


@app.command(
    "drop",
    cls=OneClip,
    epilog="Example: rigtwin measure drop drop.mp4 --frame-rate 240Hz --bead-diameter 6mm --bead-density 568kg/m^3",
)
@measured("drop")
@filmed(*FILM, "plate", "bead_at", "centre")
@tracked
def measure_drop(
    clip: Annotated[
        Path, typer.Argument(metavar="CLIP", help="Video of the drop, a sound recording, or a table of its track.")
    ],
    *,
    camera: Camera,
    table: Table,
    bead_diameter: BeadDiameter = None,
    bead_density: Annotated[
        float | None, quantity("--bead-density", "density", "568kg/m^3", "Density, to allow for the air.")
    ] = None,
    bead_mass: BeadMass = None,
    sound: Annotated[
        bool, typer.Option("--sound", help="Evaluate the sound of the impacts too, and compare it with the film.")
    ] = False,
) -> Work:
    """A bead bounces on a plate: heights and restitution per bounce."""
    solid = density(bead_density, bead_mass, bead_diameter)
    from rigtwin.measure.drop import measurement as drop

    return partial(
        drop.measure, clip, camera, bead_diameter=bead_diameter, bead_density=solid, table=table, sound=sound
    )


@app.command(
    "pendulum",
    cls=OneClip,
    epilog="Example: rigtwin measure pendulum swing.mp4 --frame-rate 240Hz --length 300mm --bead-diameter 12mm",
)
@measured("pendulum")
@filmed(*FILM, "pivot", "centre")
@tracked
def measure_pendulum(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the pendulum, or a table of its tracks.")],
    *,
    camera: Camera,
    table: Table,
    variant: Annotated[
        Literal["double", "wall"], typer.Option(help="Two beads, or one bead against a wall.")
    ] = "double",
    length: Annotated[float | None, quantity("--length", "length", "300mm", "Hinge to bead centre.")] = None,
    bead_diameter: BeadDiameter = None,
    bead_mass: BeadMass = None,
) -> Work:
    """Bead A swings against bead B or a wall: angles and restitution."""
    from rigtwin.measure.pendulum import measurement as pendulum

    return partial(
        pendulum.measure,
        clip,
        camera,
        variant=variant,
        length=length,
        bead_diameter=bead_diameter,
        bead_mass=bead_mass,
        table=table,
    )


@app.command("tilt", cls=OneClip, epilog="Example: rigtwin measure tilt tilt.mp4 --variant slide --bead-diameter 6mm")
@measured("tilt")
@filmed(*FILM, "plate", "bead_at", "centre")
@tracked
def measure_tilt(
    clip: Annotated[
        Path, typer.Argument(metavar="CLIP", help="Video of the tilting plate, or a table of the body's track.")
    ],
    *,
    camera: Camera,
    table: Table,
    variant: Annotated[
        Literal["slide", "roll"], typer.Option(help="A body that slides (glued beads), or a bead that rolls.")
    ],
    bead_diameter: BeadDiameter = None,
    arm_length: Annotated[
        float | None, quantity("--arm-length", "length", "150mm", "Plate or arm, from hinge to tip.")
    ] = None,
    angle: Annotated[
        Path | None,
        typer.Option("--angle", metavar="TABLE", help="Plate angle over time, beside a table of the body's track."),
    ] = None,
) -> Work:
    """A plate is tilted until a body moves: its angle of friction."""
    from rigtwin.measure.tilt import measurement as tilt

    return partial(
        tilt.measure,
        clip,
        camera,
        variant=variant,
        bead_diameter=bead_diameter,
        arm_length=arm_length,
        table=table,
        angle=angle,
    )


@app.command("packing", epilog="Example: rigtwin measure packing bed.jpg --cylinder-diameter 65mm --total-mass 212.7g")
@measured("packing")
@filmed(*PHOTO, "cylinder", "floor")
@tracked
def measure_packing(
    photos: Annotated[
        list[Path], typer.Argument(metavar="PHOTO...", help="Photos of one bed, or tables of its profile.")
    ],
    *,
    camera: Camera,
    table: Table,
    cylinder_diameter: Annotated[
        float | None, quantity("--cylinder-diameter", "length", "65mm", "Inner diameter of the cylinder.")
    ] = None,
    total_mass: TotalMass = None,
    bead_diameter: BeadDiameter = None,
    bead_density: Annotated[
        float | None, quantity("--bead-density", "density", "568kg/m^3", "Of one bead, to check the bulk's.")
    ] = None,
) -> Work:
    """A bed in a cylinder: its height and bulk density."""
    from rigtwin.measure.packing import measurement as packing

    return partial(
        packing.measure,
        photos,
        camera,
        cylinder_diameter=cylinder_diameter,
        total_mass=total_mass,
        bead_diameter=bead_diameter,
        bead_density=bead_density,
        table=table,
    )


@app.command("pile", epilog="Example: rigtwin measure pile front.jpg side.jpg --base-diameter 90mm --bead-diameter 6mm")
@measured("pile")
@filmed(*PHOTO, "base", "flank")
@tracked
def measure_pile(
    photos: Annotated[
        list[Path], typer.Argument(metavar="PHOTO...", help="Photos of one pile, or tables of its profile.")
    ],
    *,
    camera: Camera,
    table: Table,
    base_diameter: Annotated[
        float | None, quantity("--base-diameter", "length", "90mm", "Diameter of the base disc.")
    ] = None,
    bead_diameter: BeadDiameter = None,
) -> Work:
    """A heap on a base: its profile and angle of repose."""
    from rigtwin.measure.pile import measurement as pile

    return partial(pile.measure, photos, camera, base_diameter=base_diameter, bead_diameter=bead_diameter, table=table)


@app.command("drum", cls=OneClip, epilog="Example: rigtwin measure drum drum.mp4 --drum-diameter 140mm --speed 3rpm")
@measured("drum")
@filmed(*FILM, "circle", "averaged")
@tracked
def measure_drum(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the rotating drum, a picture, or a table.")],
    *,
    camera: Camera,
    table: Table,
    drum_diameter: Annotated[
        float | None, quantity("--drum-diameter", "length", "140mm", "Inner diameter of the drum.")
    ] = None,
    speed: Annotated[float | None, quantity("--speed", "angular_speed", "3rpm", "How fast the drum turns.")] = None,
    bead_diameter: BeadDiameter = None,
) -> Work:
    """A bed in a rotating drum: its dynamic angle of repose."""
    from rigtwin.measure.drum import measurement as drum

    return partial(
        drum.measure,
        clip,
        camera,
        drum_diameter=drum_diameter,
        speed=speed,
        bead_diameter=bead_diameter,
        table=table,
    )


@app.command(
    "hopper", cls=OneClip, epilog="Example: rigtwin measure hopper flow.mp4 --frame-rate 240Hz --bin-width 104mm"
)
@measured("hopper")
@filmed(*FILM, "slot")
@tracked
def measure_hopper(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="Video of the emptying hopper, or a table over time.")],
    *,
    camera: Camera,
    table: Table,
    bin_width: Annotated[
        float | None, quantity("--bin-width", "length", "104mm", "Inner width of the bin, for the scale.")
    ] = None,
    depth: Annotated[
        float | None, quantity("--depth", "length", "40mm", "Inner depth of a flat bin, to check the mass.")
    ] = None,
    total_mass: TotalMass = None,
    bead_diameter: BeadDiameter = None,
    bead_density: Annotated[
        float | None, quantity("--bead-density", "density", "568kg/m^3", "Of one bead, to check the mass.")
    ] = None,
) -> Work:
    """A hopper empties: discharge time and flow rate."""
    from rigtwin.lab.tracked.table import is_table
    from rigtwin.measure.hopper import measurement as hopper

    of_check = {"--depth": depth, "--bead-density": bead_density, "--total-mass": total_mass}
    missing = [option for option, value in of_check.items() if value is None]
    stated = [option for option, value in of_check.items() if value is not None and option != "--total-mass"]
    serve, them = ("serves", "it") if len(stated) == 1 else ("serve", "them")
    check = f"measure hopper: {' and '.join(stated)} {serve} to check the"
    if stated and is_table(clip):
        raise BadInput(f"{check} mass against the bed in a film, and {clip} is a table; leave {them} out.")
    if stated and missing:
        raise BadInput(f"{check} stated mass; give {' and '.join(missing)} too, or leave {them} out.")
    return partial(
        hopper.measure,
        clip,
        camera,
        bead_diameter=bead_diameter,
        total_mass=total_mass,
        bin_width=bin_width,
        depth=depth,
        bead_density=bead_density,
        table=table,
    )


@app.command("lab", epilog="Example: rigtwin measure lab my-lab --only drop-D6-steel")
@finished(show_lab_measurements, attrgetter("warnings"))
def measure_lab(
    lab: Annotated[Path, typer.Argument(metavar="LAB", help="Lab folder with a lab.toml.")],
    *,
    only: Only = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Clips measured at a time; one per core.")
    ] = None,
    again: Again = False,
    allow_outside: Outside = False,
    out: Out = None,
) -> Work:
    """All repetitions of a lab, without its twins: also `measure LAB`.

    Measurements are kept in OUT/measured by media, settings and version: called again, only what is new or changed is
    measured, also by `rigtwin compare`. With --only, the tables in OUT go on to hold the other experiments of which
    every repetition is kept as it is now.
    """
    from rigtwin.compare.measure_lab import measure_lab as measure_all

    return partial(
        measure_all, lab, beside(lab, out), only=only, workers=workers, again=again, allow_outside=allow_outside
    )
