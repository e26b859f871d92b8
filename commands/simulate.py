"""``rigtwin simulate RIG``: the twin of one rig."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from rigtwin.commands.options import (
    Json,
    Out,
    Quiet,
    Seed,
    Threads,
    gathered,
    needed,
    option,
    parsed,
    positive,
)
from rigtwin.commands.show import progress_bars, show_twin

app = typer.Typer(help="Run the twin of one rig.", no_args_is_help=True, rich_markup_mode=None)

LabFolder = Annotated[
    Path | None, option("--lab", "DIR", "Take particle, wall and contact from this lab folder's lab.toml.")
]
ParticleName = Annotated[str, option("--particle", "NAME", "D4, D6, D12, ... or a particle of --lab.")]
WallName = Annotated[str, option("--wall", "NAME", "steel, ... or a material of --lab.")]
Restitution = Annotated[float | None, option("--restitution", "0..1", "Restitution of the contact.")]
StaticFriction = Annotated[float | None, option("--static-friction", "MU", "Static friction between particles.")]
RollingFriction = Annotated[float | None, option("--rolling-friction", "MU", "Rolling friction between particles.")]
WallFriction = Annotated[float | None, option("--static-friction", "MU", "Static friction on the plate.")]
WallRolling = Annotated[float | None, option("--rolling-friction", "MU", "Rolling friction on the plate.")]
Stiffness = Annotated[
    float, typer.Option("--stiffness-factor", help="Young's moduli are multiplied by this, to save time.")
]
TwinRate = Annotated[str, typer.Option("--frame-rate", metavar="240Hz", help="How often the twin's record is taken.")]
Duration = Annotated[str | None, typer.Option("--duration", metavar="1.5s", help="How long the twin is watched.")]
Count = Annotated[int, typer.Option("--count", min=1, help="Number of particles.")]
Kept = Annotated[
    Path | None, option("--checkpoint", "FILE.npz", "Keep the run here, and go on from it where it was stopped.")
]
Filmed = Annotated[
    Path | None, option("--trajectory", "FILE.gsd", "Write the beads' motion for OVITO (.gsd) or ParaView (.vtkhdf).")
]

Run = Any  # what `bulk` makes of the options of a rig of many particles


def bulk(*, wall: str, count: int | None = None) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options that the rigs of many particles share; without a `count` it asks for its own.

    It gets them as one keyword, `run`: a function that gives the cast, and the other settings by keyword.
    """
    options: dict[str, tuple[Any, Any]] = {
        "particle": (ParticleName, "D6"),
        "wall": (WallName, wall),
        "lab": (LabFolder, None),
        "restitution": (Restitution, None),
        "static_friction": (StaticFriction, None),
        "rolling_friction": (RollingFriction, None),
        **({} if count is None else {"count": (Count, count)}),
        "seed": (Seed, 1),
        "stiffness_factor": (Stiffness, 1e-3),
        "threads": (Threads, None),
        "checkpoint": (Kept, None),
        "trajectory": (Filmed, None),
    }
    casting = ("particle", "wall", "lab", "restitution", "static_friction", "rolling_friction")

    def gather(**said: Any) -> Callable[[], tuple[Any, dict[str, Any]]]:
        asked = {name: value for name, value in said.items() if name not in casting}
        return lambda: (_cast(**{name: said[name] for name in casting}), asked)

    return gathered("run", options, gather)


def _cast(
    particle: str,
    wall: str,
    lab: Path | None,
    restitution: float | None,
    static_friction: float | None,
    rolling_friction: float | None,
) -> Any:
    """Particle, wall, their contacts among themselves and with the wall; the options go before lab and reference."""
    from rigtwin.compare import cast
    from rigtwin.compare.bulk_twins import Cast

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
    return Cast(bead, base, contact, cast.contact(bead.name, base.name, model))


@app.command("drop", epilog="Example: rigtwin simulate drop --drop-height 300mm --particle D6 --wall steel")
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

    rig = Drop(needed(drop_height, "length", "--drop-height"), bounces)
    rate, span = needed(frame_rate, "frequency", "--frame-rate"), positive(duration, "time", "--duration")
    model = cast.model_of(lab)
    bead, plate = cast.particle(particle, model), cast.wall(wall, model)
    contact = cast.contact(bead.name, plate.name, model, ("restitution",), restitution=restitution)
    from rigtwin.compare.twin import drop_twin

    with progress_bars(as_json or quiet) as progress:
        twin = drop_twin(rig, bead, plate, contact, frame_rate=rate, duration=span, progress=progress)
    show_twin(twin, out or Path("out/simulate-drop"), as_json, quiet)


@app.command(
    "pendulum", epilog="Example: rigtwin simulate pendulum --length 300mm --release-angle 45deg --particle D12"
)
def simulate_pendulum(
    *,
    length: Annotated[str, typer.Option("--length", metavar="300mm", help="Hinge to bead centre.")],
    release_angle: Annotated[
        str, typer.Option("--release-angle", metavar="45deg", help="Of bead A, from the vertical.")
    ],
    variant: Annotated[
        Literal["double", "wall"], typer.Option(help="Two beads, or one bead against an upright wall.")
    ] = "double",
    particle: ParticleName = "D12",
    wall: WallName = "steel",
    lab: LabFolder = None,
    restitution: Restitution = None,
    frame_rate: TwinRate = "240Hz",
    duration: Duration = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Bead A swings from an angle and hits bead B at rest, or a wall."""
    from rigtwin.compare import cast
    from rigtwin.lab.rigs import Pendulum

    rig = Pendulum(needed(length, "length", "--length"), needed(release_angle, "angle", "--release-angle"), variant)
    rate, span = needed(frame_rate, "frequency", "--frame-rate"), positive(duration, "time", "--duration")
    model = cast.model_of(lab)
    bead, upright = cast.particle(particle, model), cast.wall(wall, model) if variant == "wall" else None
    other = bead.name if upright is None else upright.name
    contact = cast.contact(bead.name, other, model, ("restitution",), restitution=restitution)
    from rigtwin.compare.twin import pendulum_twin

    with progress_bars(as_json or quiet) as progress:
        twin = pendulum_twin(rig, bead, contact, frame_rate=rate, wall=upright, duration=span, progress=progress)
    show_twin(twin, out or Path("out/simulate-pendulum"), as_json, quiet)


@app.command("pile", epilog="Example: rigtwin simulate pile --base-diameter 90mm --rim-height 10mm --count 2000")
@bulk(wall="steel", count=1000)
def simulate_pile(
    *,
    base_diameter: Annotated[str, typer.Option("--base-diameter", metavar="90mm", help="Diameter of the base.")],
    method: Annotated[
        Literal["piling", "pouring", "emptying"],
        typer.Option(help="Beads rain on the base; a filled tube is lifted; a filled container drains."),
    ] = "piling",
    rim_height: Annotated[
        str, typer.Option("--rim-height", metavar="10mm", help="Rim of the base; nothing stays on a plate without one.")
    ] = "0 mm",
    outlet_diameter: Annotated[str | None, option("--outlet-diameter", "20mm", "piling: of the funnel.")] = None,
    outlet_height: Annotated[
        str | None, option("--outlet-height", "80mm", "piling: of the funnel above the base; else it rises.")
    ] = None,
    tube_diameter: Annotated[str | None, option("--tube-diameter", "45mm", "pouring: inner; half the base.")] = None,
    lift_speed: Annotated[str | None, option("--lift-speed", "20mm/s", "pouring: of the tube; 20 mm/s.")] = None,
    drain_diameter: Annotated[
        str | None, option("--drain-diameter", "50mm", "emptying: of the hole; a third of the base.")
    ] = None,
    run: Run,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A heap on a round base, its slope seen from four sides."""
    from rigtwin.lab.errors import BadInput
    from rigtwin.lab.rigs import Pile

    others = {
        "--outlet-diameter": (outlet_diameter, "piling"),
        "--outlet-height": (outlet_height, "piling"),
        "--tube-diameter": (tube_diameter, "pouring"),
        "--lift-speed": (lift_speed, "pouring"),
        "--drain-diameter": (drain_diameter, "emptying"),
    }
    for name, (given, needs) in others.items():
        if given is not None and needs != method:
            raise BadInput(f"{name} belongs to --method {needs}, this heap is made by {method}; leave one of them out.")
    rig = Pile(
        needed(base_diameter, "length", "--base-diameter"),
        parsed(rim_height, "length", "--rim-height"),
        positive(outlet_diameter, "length", "--outlet-diameter"),
        method,
        positive(outlet_height, "length", "--outlet-height"),
        positive(tube_diameter, "length", "--tube-diameter"),
        positive(lift_speed, "speed", "--lift-speed"),
        positive(drain_diameter, "length", "--drain-diameter"),
    )
    cast, asked = run()
    from rigtwin.compare.bulk_twins import pile_twin

    with progress_bars(as_json or quiet) as progress:
        twin = pile_twin(rig, cast, **asked, progress=progress)
    show_twin(twin, out or Path("out/simulate-pile"), as_json, quiet)


@app.command("tilt", epilog="Example: rigtwin simulate tilt --variant slide --particle D6 --wall steel")
def simulate_tilt(
    *,
    variant: Annotated[
        Literal["slide", "roll"], typer.Option(help="A body that slides (glued beads), or a bead that rolls.")
    ],
    speed: Annotated[str, option("--speed", "1deg/s", "How fast the plate is tilted.")] = "1 deg/s",
    particle: ParticleName = "D6",
    wall: WallName = "steel",
    lab: LabFolder = None,
    static_friction: WallFriction = None,
    rolling_friction: WallRolling = None,
    frame_rate: TwinRate = "240Hz",
    duration: Duration = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A plate tilted until the body on it moves."""
    from rigtwin.compare import cast
    from rigtwin.lab.rigs import Tilt

    rig = Tilt(variant, needed(speed, "angular_speed", "--speed"))
    rate, span = needed(frame_rate, "frequency", "--frame-rate"), positive(duration, "time", "--duration")
    model = cast.model_of(lab)
    bead, plate = cast.particle(particle, model), cast.wall(wall, model)
    needs = ("static_friction", "rolling_friction")
    friction: dict[str, Any] = {"static_friction": static_friction, "rolling_friction": rolling_friction}
    contact = cast.contact(bead.name, plate.name, model, needs, **friction)
    from rigtwin.compare.twin import tilt_twin

    with progress_bars(as_json or quiet) as progress:
        twin = tilt_twin(rig, bead, plate, contact, frame_rate=rate, duration=span, progress=progress)
    show_twin(twin, out or Path("out/simulate-tilt"), as_json, quiet)


@app.command("packing", epilog="Example: rigtwin simulate packing --cylinder-diameter 65mm --particle D6 --count 1000")
@bulk(wall="PMMA", count=1000)
def simulate_packing(
    *,
    cylinder_diameter: Annotated[str, option("--cylinder-diameter", "65mm", "Inner diameter of the cylinder.")] = (
        "65 mm"
    ),
    outlet_diameter: Annotated[
        str | None, option("--outlet-diameter", "39mm", "What the particles leave by; 0.6 of the cylinder.")
    ] = None,
    hopper_diameter: Annotated[
        str | None, option("--hopper-diameter", "100mm", "A hopper with a slide above the cylinder; else a rain.")
    ] = None,
    run: Run,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Particles poured into a cylinder: bed height and bulk density."""
    from rigtwin.lab.rigs import Packing

    rig = Packing(
        needed(cylinder_diameter, "length", "--cylinder-diameter"),
        outlet_diameter=positive(outlet_diameter, "length", "--outlet-diameter"),
        hopper_diameter=positive(hopper_diameter, "length", "--hopper-diameter"),
    )
    cast, asked = run()
    from rigtwin.compare import bulk_twins

    rig = bulk_twins.cylinder_for(rig, cast.particle, asked["count"])
    with progress_bars(as_json or quiet) as progress:
        twin = bulk_twins.packing_twin(rig, cast, **asked, progress=progress)
    show_twin(twin, out or Path("out/simulate-packing"), as_json, quiet)


@app.command(
    "drum", epilog="Example: rigtwin simulate drum --drum-diameter 140mm --speed 3rpm --depth 50mm --fill 0.35"
)
@bulk(wall="PMMA")
def simulate_drum(
    *,
    drum_diameter: Annotated[str, option("--drum-diameter", "140mm", "Inner diameter of the drum.")],
    speed: Annotated[str, option("--speed", "3rpm", "How fast the drum turns.")],
    depth: Annotated[str | None, option("--depth", "50mm", "Inner length of the drum; half its diameter.")] = None,
    fill: Annotated[float | None, option("--fill", "0..1", "Share of the drum that the bed takes; 0.35.")] = None,
    turns: Annotated[float, option("--turns", "N", "How often the drum turns.")] = 1.0,
    count: Annotated[int | None, typer.Option("--count", min=1, help="Particles, in place of --fill.")] = None,
    run: Run,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A bed in a turning drum: its dynamic angle of repose and how it mixes."""
    from rigtwin.lab.rigs import Drum

    rig = Drum(
        needed(drum_diameter, "length", "--drum-diameter"),
        needed(speed, "angular_speed", "--speed"),
        positive(depth, "length", "--depth"),
        fill,
    )
    cast, asked = run()
    from rigtwin.compare.bulk_twins import drum_twin

    with progress_bars(as_json or quiet) as progress:
        twin = drum_twin(rig, cast, count=count, turns=turns, **asked, progress=progress)
    show_twin(twin, out or Path("out/simulate-drum"), as_json, quiet)


@app.command(
    "hopper", epilog="Example: rigtwin simulate hopper --variant slot --outlet 20mm --particle D6 --count 2000"
)
@bulk(wall="PMMA", count=2000)
def simulate_hopper(
    *,
    variant: Annotated[
        Literal["conical", "slot"], typer.Option(help="A cone with a round outlet, or two walls with a slot.")
    ] = "conical",
    outlet: Annotated[str, option("--outlet", "50mm", "Diameter of the outlet, or width of the slot.")],
    bin_width: Annotated[
        str | None, option("--bin-width", "150mm", "Width above the walls; diameter of the conical hopper's cylinder.")
    ] = None,
    depth: Annotated[str | None, option("--depth", "68mm", "Length of the slot.")] = None,
    duration: Duration = None,
    run: Run,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """A hopper that empties through its outlet: discharge time and mass flow."""
    from rigtwin.lab.rigs import HopperSettings

    width, length = positive(bin_width, "length", "--bin-width"), positive(depth, "length", "--depth")
    rig = HopperSettings(variant, width, length, needed(outlet, "length", "--outlet")).rig()
    span = positive(duration, "time", "--duration")
    cast, asked = run()
    from rigtwin.compare.bulk_twins import hopper_twin

    with progress_bars(as_json or quiet) as progress:
        twin = hopper_twin(rig, cast, **asked, duration=span, progress=progress)
    show_twin(twin, out or Path("out/simulate-hopper"), as_json, quiet)
