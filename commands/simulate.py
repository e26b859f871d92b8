"""``rigtwin simulate RIG``: the twin of one rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigtwin.commands.options import Json, Out, Quiet, Seed, Threads, needed, option, parsed, positive
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
TwinRate = Annotated[str, typer.Option("--frame-rate", metavar="240Hz", help="How often the twin's record is taken.")]
Duration = Annotated[str | None, typer.Option("--duration", metavar="1.5s", help="How long the twin is watched.")]
Count = Annotated[int, typer.Option("--count", min=1, help="Number of particles poured on the base.")]


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

    rig = Pendulum(needed(length, "length", "--length"), needed(release_angle, "angle", "--release-angle"))
    rate, span = needed(frame_rate, "frequency", "--frame-rate"), positive(duration, "time", "--duration")
    model = cast.model_of(lab)
    bead = cast.particle(particle, model)
    contact = cast.contact(bead.name, bead.name, model, ("restitution",), restitution=restitution)
    from rigtwin.compare.twin import pendulum_twin

    with progress_bars(as_json or quiet) as progress:
        twin = pendulum_twin(rig, bead, contact, frame_rate=rate, duration=span, progress=progress)
    show_twin(twin, out or Path("out/simulate-pendulum"), as_json, quiet)


@app.command("pile", epilog="Example: rigtwin simulate pile --base-diameter 90mm --rim-height 10mm --count 2000")
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

    rim = parsed(rim_height, "length", "--rim-height")
    rig = Pile(
        needed(base_diameter, "length", "--base-diameter"),
        rim,
        positive(outlet_diameter, "length", "--outlet-diameter"),
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

    with progress_bars(as_json or quiet) as progress:
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
    show_twin(twin, out or Path("out/simulate-pile"), as_json, quiet)
