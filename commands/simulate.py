"""``rigtwin simulate RIG``: the twin of one rig."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from rigtwin.commands.options import (
    Command,
    Device,
    Force,
    Outside,
    Seed,
    Stiffness,
    Threads,
    TimeStep,
    file_option,
    gathered,
    option,
    quantity,
)
from rigtwin.commands.run_command import Work, simulated
from rigtwin.lab.custom_rig import End
from rigtwin.lab.rigs import UPSIDE_DOWN
from rigtwin.lab.stl import StlUnit
from rigtwin.lab.units import MOST_PARTICLES

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

app = typer.Typer(help="Run the twin of one rig.", no_args_is_help=True, rich_markup_mode=None)

LabFolder = Annotated[
    Path | None, option("--lab", "DIR", "Take particle, wall and contact from this lab folder's lab.toml.")
]
ParticleName = Annotated[str, option("--particle", "NAME", "D4, D6, D12, ... or a particle of --lab.")]
WallName = Annotated[str, option("--wall", "NAME", "steel, ... or a material of --lab.")]
UprightWallName = Annotated[
    str | None, option("--wall", "NAME", "Of --variant wall: steel, ... or a material of --lab; steel.")
]
Restitution = Annotated[
    float | None, quantity("--restitution", "number", "0..1", "Restitution of the contact, above 0.", highest=1.0)
]
StaticFriction = Annotated[
    float | None, quantity("--static-friction", "number", "MU", "Static friction between particles.", zero=True)
]
RollingFriction = Annotated[
    float | None, quantity("--rolling-friction", "number", "MU", "Rolling friction between particles.", zero=True)
]
WallFriction = Annotated[
    float | None, quantity("--static-friction", "number", "MU", "Static friction on the plate.", zero=True)
]
WallRolling = Annotated[
    float | None, quantity("--rolling-friction", "number", "MU", "Rolling friction on the plate.", zero=True)
]
TwinRate = Annotated[
    float, quantity("--frame-rate", "frequency", "240Hz", "How often the twin's record is taken; 240 Hz.")
]
Duration = Annotated[float | None, quantity("--duration", "time", "1.5s", "How long the twin is watched.")]
Count = Annotated[int, typer.Option("--count", min=1, max=MOST_PARTICLES, help="Number of particles.")]
RollingModel = Annotated[
    Literal["A", "A-explicit", "C"],
    typer.Option(
        "--rolling-model",
        help="Rolling resistance: constant torque (A), the same that stops only the spin it meets (A-explicit), or "
        "elastic-plastic spring (C).",
    ),
]
RollingOfMany = Annotated[
    Literal["A", "A-explicit", "C"] | None,
    typer.Option("--rolling-model", help="Rolling resistance in a twin of many particles, as `simulate` takes it; C."),
]
ContactLaw = Annotated[
    Literal["Hertz-Mindlin", "linear"], typer.Option("--contact-law", help="Springs and dashpots of the contacts.")
]
ImpactSpeed = Annotated[
    float | None,
    quantity("--impact-speed", "speed", "1m/s", "Where linear springs are as stiff as Hertz's contacts; 1 m/s."),
]
Kept = Annotated[
    Path | None,
    file_option(
        "--checkpoint",
        "FILE.npz",
        "Keep the run here, and go on from it where it was stopped; a folder that is not there is made.",
    ),
]
Filmed = Annotated[
    Path | None,
    file_option("--trajectory", "FILE.gsd", "Write the beads' motion for OVITO (.gsd) or ParaView (.vtkhdf)."),
]

FillLimit = Annotated[float | None, quantity("--fill-limit", "time", "3s", "Longest wait for a filling to rest; 3 s.")]
SettleLimit = Annotated[
    float | None, quantity("--settle-limit", "time", "4s", "Longest wait for what has come down to rest; 4 s.")
]

STEEPEST = math.radians(85)  # [rad], of a slope that is one and no wall

Run = Any  # what `bulk` makes of the options of a rig of many particles


def bulk(*, wall: str, count: int | None = None) -> Callable[[Command], Command]:
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
        **NUMERIC,
    }
    casting = ("particle", "wall", "lab", "restitution", "static_friction", "rolling_friction")

    def gather(**said: Any) -> Callable[[], tuple[Any, dict[str, Any]]]:
        asked = _numerics(**{name: value for name, value in said.items() if name not in casting})
        return lambda: (cast_of(**{name: said[name] for name in casting}), asked)

    return gathered("run", options, gather)


NUMERIC: dict[str, tuple[Any, Any]] = {
    "seed": (Seed, 1),
    "stiffness_factor": (Stiffness, 1e-3),
    "time_step_fraction": (TimeStep, 0.3),
    "force": (Force, False),
    "rolling_model": (RollingModel, "C"),
    "contact_law": (ContactLaw, "Hertz-Mindlin"),
    "impact_speed": (ImpactSpeed, None),
    "threads": (Threads, None),
    "device": (Device, "cpu"),
    "checkpoint": (Kept, None),
    "trajectory": (Filmed, None),
}
"""Options of every twin of many particles that say how it is computed."""


def _numerics(**asked: Any) -> dict[str, Any]:
    """What `NUMERIC` gives, and options beside it, as keywords of a twin."""
    asked["rolling"] = rolling_law(asked.pop("rolling_model"))
    asked["forced"] = asked.pop("force")
    only_with("--contact-law", asked["contact_law"], {"--impact-speed": (asked["impact_speed"], "linear")})
    if asked["impact_speed"] is None:
        del asked["impact_speed"]
    return asked


def only_with(choice: str, chosen: str, given: Mapping[str, tuple[Any, str]]) -> None:
    """Refuse what would change nothing: options by name that are given, though another of the choices needs them.

    Where several of the choices need one, they stand with "or" between them.
    """
    from rigtwin.lab.errors import BadInput

    for name, (value, needs) in given.items():
        if value is not None and chosen not in needs.split(" or "):
            raise BadInput(f"{name} belongs to {choice} {needs}, here it is {chosen}; leave one of them out.")


def not_beside(other: str, because: str, given: Mapping[str, Any]) -> None:
    """Refuse options by name that change nothing where the `other` one is given."""
    from rigtwin.lab.errors import BadInput

    for name, value in given.items():
        if value is not None:
            raise BadInput(f"{name} changes nothing beside {other}: {because}; leave one of them out.")


def rolling_law(said: str) -> Rolling:
    """The law that an option means by "A", "A-explicit" or "C"."""
    return cast("Rolling", f"type {said.replace('-', ' ')}")


def cast_of(
    particle: str,
    wall: str,
    lab: Path | None,
    restitution: float | None,
    static_friction: float | None,
    rolling_friction: float | None,
) -> Any:
    """Particle, wall, their contacts among themselves and with the wall; the options go before lab and reference."""
    from rigtwin.compare.twins import by_name
    from rigtwin.compare.twins.many_body import Cast

    model = by_name.model_of(lab, particle)
    bead, base = by_name.particle(particle, model), by_name.wall(wall, model)
    contact = by_name.contact(
        bead.name,
        bead.name,
        model,
        restitution=restitution,
        static_friction=static_friction,
        rolling_friction=rolling_friction,
    )
    return Cast(bead, base, contact, by_name.contact(bead.name, base.name, model))


@app.command("drop", epilog="Example: rigtwin simulate drop --drop-height 300mm --particle D6 --wall steel")
@simulated("drop")
def simulate_drop(
    *,
    drop_height: Annotated[
        float, quantity("--drop-height", "length", "300mm", "From the bead's lowest point to the plate.")
    ],
    particle: ParticleName = "D6",
    wall: WallName = "steel",
    lab: LabFolder = None,
    bounces: Annotated[
        int | None, typer.Option("--bounces", min=1, max=50, help="How many bounces to show; 4.", show_default=False)
    ] = None,
    turned: Annotated[
        float | None,
        quantity("--turned", "angle", "30deg", "How a clump is turned, clockwise as seen; at random.", zero=True),
    ] = None,
    restitution: Restitution = None,
    frame_rate: TwinRate = 240.0,
    duration: Duration = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Seed of how a clump is turned; 1.", show_default=False)
    ] = None,
) -> Work:
    """A bead or a clump dropped on a plate."""
    from rigtwin.compare.twins import by_name
    from rigtwin.lab.errors import BadInput
    from rigtwin.lab.rigs import Drop

    if bounces is not None and duration is not None:
        raise BadInput("--bounces and --duration both say when the record ends; leave one of them out.")
    if turned is not None:
        not_beside("--turned", "nothing is left to chance", {"--seed": seed})
    rig = Drop(drop_height, turned=turned) if bounces is None else Drop(drop_height, bounces, turned)
    model = by_name.model_of(lab, particle)
    bead, plate = by_name.particle(particle, model), by_name.wall(wall, model)
    if seed is not None and bead.shape is None:
        raise BadInput(f"--seed: {bead.name} is a sphere, of whose fall nothing is left to chance; leave it out.")
    contact = by_name.contact(bead.name, plate.name, model, ("restitution",), restitution=restitution)
    from rigtwin.compare.twins.drop import drop_twin

    seed = 1 if seed is None else seed
    return partial(drop_twin, rig, bead, plate, contact, frame_rate=frame_rate, duration=duration, seed=seed)


@app.command(
    "pendulum", epilog="Example: rigtwin simulate pendulum --length 300mm --release-angle 45deg --particle D12"
)
@simulated("pendulum")
def simulate_pendulum(
    *,
    length: Annotated[float, quantity("--length", "length", "300mm", "Hinge to bead centre.")],
    release_angle: Annotated[
        float, quantity("--release-angle", "angle", "45deg", "Of bead A, from the vertical.", highest=UPSIDE_DOWN)
    ],
    variant: Annotated[
        Literal["double", "wall"], typer.Option(help="Two beads, or one bead against an upright wall.")
    ] = "double",
    hanger: Annotated[
        Literal["string", "rod"],
        typer.Option(help="A string, which is warned of where it would be slack, or a rigid rod."),
    ] = "string",
    rod_mass: Annotated[
        float | None, quantity("--rod-mass", "mass", "2g", "Of each rod of --hanger rod; without mass.")
    ] = None,
    particle: ParticleName = "D12",
    wall: UprightWallName = None,
    lab: LabFolder = None,
    restitution: Restitution = None,
    frame_rate: TwinRate = 240.0,
    duration: Duration = None,
) -> Work:
    """Bead A swings from an angle and hits bead B at rest, or a wall."""
    from rigtwin.compare.twins import by_name
    from rigtwin.lab.rigs import Pendulum

    only_with("--variant", variant, {"--wall": (wall, "wall")})
    only_with("--hanger", hanger, {"--rod-mass": (rod_mass, "rod")})
    rig = Pendulum(length, release_angle, variant, hanger, rod_mass or 0.0)
    model = by_name.model_of(lab, particle)
    bead, upright = (
        by_name.particle(particle, model),
        by_name.wall(wall or "steel", model) if variant == "wall" else None,
    )
    other = bead.name if upright is None else upright.name
    contact = by_name.contact(bead.name, other, model, ("restitution",), restitution=restitution)
    from rigtwin.compare.twins.pendulum import pendulum_twin

    return partial(pendulum_twin, rig, bead, contact, frame_rate=frame_rate, wall=upright, duration=duration)


@app.command("pile", epilog="Example: rigtwin simulate pile --base-diameter 90mm --rim-height 10mm --count 2000")
@simulated("pile")
@bulk(wall="steel", count=1000)
def simulate_pile(
    *,
    base_diameter: Annotated[float, quantity("--base-diameter", "length", "90mm", "Diameter of the base.")],
    method: Annotated[
        Literal["piling", "pouring", "emptying"],
        typer.Option(help="Beads rain on the base; a filled tube is lifted; a filled container drains."),
    ] = "piling",
    rim_height: Annotated[
        float,
        quantity("--rim-height", "length", "10mm", "Rim of the base; nothing stays on a plate without one.", zero=True),
    ] = 0.0,
    outlet_diameter: Annotated[
        float | None, quantity("--outlet-diameter", "length", "20mm", "piling: of the funnel.")
    ] = None,
    outlet_height: Annotated[
        float | None,
        quantity("--outlet-height", "length", "80mm", "piling: of the funnel above the base; else it rises."),
    ] = None,
    tube_diameter: Annotated[
        float | None, quantity("--tube-diameter", "length", "45mm", "pouring: inner; half the base.")
    ] = None,
    lift_speed: Annotated[
        float | None, quantity("--lift-speed", "speed", "20mm/s", "pouring: of the tube; 20 mm/s.")
    ] = None,
    drain_diameter: Annotated[
        float | None, quantity("--drain-diameter", "length", "50mm", "emptying: of the hole; a third of the base.")
    ] = None,
    fall_height: Annotated[
        float | None,
        quantity("--fall-height", "length", "20mm", "piling: of the rising funnel above the heap; three diameters."),
    ] = None,
    pour_rate: Annotated[
        float | None,
        quantity("--pour-rate", "rate", "400/s", "piling: beads per second; as Beverloo's law, or more to be quick."),
    ] = None,
    fill_limit: Annotated[
        float | None,
        quantity("--fill-limit", "time", "3s", "pouring, emptying: longest wait for the filling to rest; 3 s."),
    ] = None,
    settle_limit: SettleLimit = None,
    run: Run,
) -> Work:
    """A heap on a round base, its slope seen from four sides."""
    from rigtwin.lab.rigs import Pile

    others = {
        "--outlet-diameter": (outlet_diameter, "piling"),
        "--outlet-height": (outlet_height, "piling"),
        "--tube-diameter": (tube_diameter, "pouring"),
        "--lift-speed": (lift_speed, "pouring"),
        "--drain-diameter": (drain_diameter, "emptying"),
        "--fall-height": (fall_height, "piling"),
        "--pour-rate": (pour_rate, "piling"),
        "--fill-limit": (fill_limit, "pouring or emptying"),
    }
    only_with("--method", method, others)
    if outlet_height is not None:
        not_beside("--outlet-height", "the funnel stands", {"--fall-height": fall_height})
    rig = Pile(
        base_diameter,
        rim_height,
        outlet_diameter,
        method,
        outlet_height,
        tube_diameter,
        lift_speed,
        drain_diameter,
    )
    cast, asked = run()
    from rigtwin.compare.twins.pile import pile_twin

    waits: dict[str, Any] = {"fill_limit": fill_limit, "settle_limit": settle_limit}
    return partial(pile_twin, rig, cast, pour_rate=pour_rate, fall_height=fall_height, **waits, **asked)


@app.command("tilt", epilog="Example: rigtwin simulate tilt --variant slide --particle D6 --wall steel")
@simulated("tilt")
def simulate_tilt(
    *,
    variant: Annotated[
        Literal["slide", "roll"], typer.Option(help="A body that slides (glued beads), or a bead that rolls.")
    ],
    speed: Annotated[
        float, quantity("--speed", "tilting_speed", "1deg/s", "How fast the plate is tilted; 1 deg/s.")
    ] = math.radians(1),
    start_angle: Annotated[
        float,
        quantity("--start-angle", "angle", "10deg", "Of the plate at first; 0.", zero=True, highest=STEEPEST),
    ] = 0.0,
    plate_length: Annotated[
        float, quantity("--plate-length", "length", "200mm", "From the hinge; the body lies in its middle; 200 mm.")
    ] = 0.2,
    particle: ParticleName = "D6",
    wall: WallName = "steel",
    lab: LabFolder = None,
    static_friction: WallFriction = None,
    rolling_friction: WallRolling = None,
    frame_rate: TwinRate = 240.0,
    duration: Duration = None,
) -> Work:
    """A plate tilted until the body on it moves."""
    from rigtwin.compare.twins import by_name
    from rigtwin.lab.rigs import Tilt

    only_with("--variant", variant, {"--rolling-friction": (rolling_friction, "roll")})
    rig = Tilt(variant, speed, start_angle, plate_length)
    model = by_name.model_of(lab, particle)
    bead, plate = by_name.particle(particle, model), by_name.wall(wall, model)
    needs = ("static_friction", "rolling_friction")
    friction: dict[str, Any] = {"static_friction": static_friction, "rolling_friction": rolling_friction}
    contact = by_name.contact(bead.name, plate.name, model, needs, **friction)
    from rigtwin.compare.twins.tilt import tilt_twin

    return partial(tilt_twin, rig, bead, plate, contact, frame_rate=frame_rate, duration=duration)


@app.command("packing", epilog="Example: rigtwin simulate packing --cylinder-diameter 65mm --particle D6 --count 1000")
@simulated("packing")
@bulk(wall="PMMA", count=1000)
def simulate_packing(
    *,
    cylinder_diameter: Annotated[
        float, quantity("--cylinder-diameter", "length", "65mm", "Inner diameter of the cylinder; 65 mm.")
    ] = 0.065,
    outlet_diameter: Annotated[
        float | None,
        quantity("--outlet-diameter", "length", "39mm", "What the particles leave by; 0.6 of the cylinder."),
    ] = None,
    hopper_diameter: Annotated[
        float | None,
        quantity("--hopper-diameter", "length", "100mm", "A hopper with a slide above the cylinder; else a rain."),
    ] = None,
    cylinder_height: Annotated[
        float | None,
        quantity("--cylinder-height", "length", "302mm", "Inner; else 302 mm, or more where so many need it."),
    ] = None,
    fall_height: Annotated[
        float, quantity("--fall-height", "length", "20mm", "From the outlet to the cylinder's rim; 20 mm.")
    ] = 0.02,
    pour_rate: Annotated[
        float | None,
        quantity(
            "--pour-rate", "rate", "400/s", "Of the rain, particles per second; as Beverloo's law, 200/s at least."
        ),
    ] = None,
    fill_limit: Annotated[
        float | None,
        quantity("--fill-limit", "time", "3s", "Of a hopper: longest wait for its filling to rest; 3 s."),
    ] = None,
    settle_limit: SettleLimit = None,
    run: Run,
) -> Work:
    """Particles poured into a cylinder: bed height and bulk density."""
    from rigtwin.lab.errors import BadInput
    from rigtwin.lab.rigs import Packing

    if hopper_diameter is not None:
        not_beside("--hopper-diameter", "its filling leaves as it flows", {"--pour-rate": pour_rate})
    elif fill_limit is not None:
        raise BadInput("--fill-limit belongs to --hopper-diameter, and a rain waits for nothing; leave it out.")
    rig = Packing(
        cylinder_diameter,
        outlet_diameter=outlet_diameter,
        fall_height=fall_height,
        hopper_diameter=hopper_diameter,
    )
    cast, asked = run()
    from rigtwin.compare.twins import packing as bulk_twins

    if cylinder_height is None:
        rig = bulk_twins.cylinder_for(rig, cast.particle, asked["count"])
    else:
        rig = replace(rig, cylinder_height=cylinder_height)
    waits: dict[str, Any] = {"fill_limit": fill_limit, "settle_limit": settle_limit}
    return partial(bulk_twins.packing_twin, rig, cast, pour_rate=pour_rate, **waits, **asked)


@app.command(
    "drum", epilog="Example: rigtwin simulate drum --drum-diameter 140mm --speed 3rpm --depth 50mm --fill 0.35"
)
@simulated("drum")
@bulk(wall="PMMA")
def simulate_drum(
    *,
    drum_diameter: Annotated[float, quantity("--drum-diameter", "length", "140mm", "Inner diameter of the drum.")],
    speed: Annotated[float, quantity("--speed", "angular_speed", "3rpm", "How fast the drum turns.")],
    depth: Annotated[
        float | None, quantity("--depth", "length", "50mm", "Inner length of the drum; half its diameter.")
    ] = None,
    fill: Annotated[
        float | None,
        quantity("--fill", "number", "0..0.9", "Share of the drum that the bed takes, below 0.9; 0.35.", highest=0.9),
    ] = None,
    turns: Annotated[float, quantity("--turns", "number", "N", "How often the drum turns; 1.")] = 1.0,
    count: Annotated[
        int | None, typer.Option("--count", min=1, max=MOST_PARTICLES, help="Particles, in place of --fill.")
    ] = None,
    fill_limit: Annotated[
        float | None,
        quantity("--fill-limit", "time", "2s", "Longest wait for the filling to rest before the drum turns; 2 s."),
    ] = None,
    run: Run,
) -> Work:
    """A bed in a turning drum: dynamic angle of repose and mixing."""
    from rigtwin.lab.errors import BadInput
    from rigtwin.lab.rigs import Drum

    if count is not None and fill is not None:
        raise BadInput("--count and --fill both say how much lies in the drum; leave one of them out.")
    rig = Drum(
        drum_diameter,
        speed,
        depth,
        fill,
    )
    cast, asked = run()
    from rigtwin.compare.twins.drum import drum_twin, need_usual_filling

    if count is None:
        need_usual_filling(rig, cast.particle)
    return partial(drum_twin, rig, cast, count=count, turns=turns, fill_limit=fill_limit, **asked)


@app.command(
    "hopper", epilog="Example: rigtwin simulate hopper --variant slot --outlet 20mm --particle D6 --count 2000"
)
@simulated("hopper")
@bulk(wall="PMMA", count=2000)
def simulate_hopper(
    *,
    variant: Annotated[
        Literal["conical", "slot"], typer.Option(help="A cone with a round outlet, or two walls with a slot.")
    ] = "conical",
    outlet: Annotated[float, quantity("--outlet", "length", "50mm", "Diameter of the outlet, or width of the slot.")],
    bin_width: Annotated[
        float | None,
        quantity("--bin-width", "length", "150mm", "Width above the walls; diameter of the conical hopper's cylinder."),
    ] = None,
    depth: Annotated[float | None, quantity("--depth", "length", "68mm", "slot: its length; 68 mm.")] = None,
    cone_height: Annotated[
        float | None, quantity("--cone-height", "length", "100mm", "conical: of the cone; 100 mm.")
    ] = None,
    inclination: Annotated[
        float | None,
        quantity("--inclination", "angle", "60deg", "slot: of its walls, from the level; 60 deg.", highest=STEEPEST),
    ] = None,
    slide_angle: Annotated[
        float | None,
        quantity("--slide-angle", "angle", "45deg", "slot: of the slide below, from the level; 45.", highest=STEEPEST),
    ] = None,
    slide_drop: Annotated[
        float | None, quantity("--slide-drop", "length", "60mm", "slot: from it down to the slide; 60 mm.")
    ] = None,
    duration: Duration = None,
    fill_limit: FillLimit = None,
    settle_limit: Annotated[
        float | None,
        quantity("--settle-limit", "time", "4s", "slot: longest wait for the heap below to rest; 4 s."),
    ] = None,
    run: Run,
) -> Work:
    """A hopper that empties: discharge time and mass flow."""
    from rigtwin.lab.rigs import HopperSettings

    others = {
        "--depth": (depth, "slot"),
        "--cone-height": (cone_height, "conical"),
        "--inclination": (inclination, "slot"),
        "--slide-angle": (slide_angle, "slot"),
        "--slide-drop": (slide_drop, "slot"),
        "--settle-limit": (settle_limit, "slot"),
    }
    only_with("--variant", variant, others)
    from rigtwin.compare.twins.twin import stated

    shape = stated(cone_height=cone_height, inclination=inclination, slide_angle=slide_angle, slide_drop=slide_drop)
    rig = replace(HopperSettings(variant, bin_width, depth, outlet).rig(), **shape)
    cast, asked = run()
    from rigtwin.compare.twins.hopper import hopper_twin

    waits: dict[str, Any] = {"fill_limit": fill_limit, "settle_limit": settle_limit}
    return partial(hopper_twin, rig, cast, duration=duration, **waits, **asked)


def _box(flag: str) -> Callable[[str], Any]:
    """Reader of a box from "x,y,z..x,y,z", as lab.toml states it."""

    def read(text: str) -> Any:
        from rigtwin.lab.errors import BadInput

        low, dots, high = text.partition("..")
        corners = [[one.strip() for one in corner.split(",")] for corner in (low, high)]
        if not dots or any(len(corner) != 3 for corner in corners):
            raise BadInput(f"{flag}: {text!r} is no box; write two corners like '-20mm,-20mm,5mm..20mm,20mm,80mm'.")
        for one in (*corners[0], *corners[1]):
            with suppress(ValueError):  # with a unit it is no bare number
                if float(one) != 0:  # in metres it would be a hall; the STL is in millimetres
                    raise BadInput(f"{flag}: {one} has no unit; write it like {one}mm.")
        return {"low": corners[0], "high": corners[1]}

    return read


@app.command(
    "custom", epilog="Example: rigtwin simulate custom --stl cup.stl --fill=-20mm,-20mm,5mm..20mm,20mm,80mm --count 200"
)
@simulated("custom")
@gathered("run", NUMERIC, _numerics)
def simulate_custom(
    *,
    lab: Annotated[
        Path | None,
        typer.Argument(
            metavar="[LAB]",
            help="A lab.toml or its folder: the rig under [rigs.NAME]; with --stl only its particles and contacts.",
        ),
    ] = None,
    name: Annotated[str | None, option("--name", "NAME", "Which rig of LAB, where it has several.")] = None,
    stl: Annotated[
        list[Path] | None,
        typer.Option("--stl", metavar="FILE", help="In place of a rig of LAB: a wall at rest; may be repeated."),
    ] = None,
    stl_unit: Annotated[StlUnit | None, typer.Option(help="In which --stl is; mm.", show_default=False)] = None,
    fill: Annotated[
        Any,
        option(
            "--fill",
            "X,Y,Z..X,Y,Z",
            "Box in which particles are placed, clear of walls; needed by --stl.",
            _box("--fill"),
        ),
    ] = None,
    region: Annotated[
        Any,
        option(
            "--region",
            "X,Y,Z..X,Y,Z",
            "Box in which particles are counted and the bed height is taken.",
            _box("--region"),
        ),
    ] = None,
    particle: Annotated[str | None, option("--particle", "NAME", "In place of the rig's; with --stl D6.")] = None,
    wall: Annotated[str | None, option("--wall", "NAME", "Material, in place of the rig's; with --stl steel.")] = None,
    count: Annotated[
        int | None, typer.Option("--count", min=1, max=MOST_PARTICLES, help="In place of the rig's; with --stl 500.")
    ] = None,
    pour_rate: Annotated[
        float | None,
        quantity("--pour-rate", "rate", "400/s", "Particles per second; all at once where none is stated."),
    ] = None,
    duration: Annotated[
        float | None, quantity("--duration", "time", "2s", "Longest simulated time, in place of the rig's; 2 s.")
    ] = None,
    end: Annotated[
        End | None,
        typer.Option(help="End early: as all particles rest, or as all have left; with --stl at rest."),
    ] = None,
    allow_outside: Outside = False,
    run: Run,
) -> Work:
    """A rig of your own: walls from STL files that rest or move.

    docs/own_rigs.md describes its keys in lab.toml.
    """
    from rigtwin.compare.twins.twin import stated
    from rigtwin.lab.errors import BadInput
    from rigtwin.lab.file.own_rigs import named_for, read_own_rig, rig_of_keys

    regions = None if region is None else {"region": region}
    keys = stated(
        regions=regions,
        fill=fill,
        particle=particle,
        wall=wall,
        count=count,
        pour_rate=pour_rate,
        duration=duration,
        end=end,
    )
    if stl:
        if name is not None:
            raise BadInput("--name and --stl both say which walls there are; leave one of them out.")
        if fill is None:
            raise BadInput("--fill: --stl needs it: two corners of a box, like '-20mm,-20mm,5mm..20mm,20mm,80mm'.")
        walls = {name: {"stl": str(file), "stl_unit": stl_unit or "mm"} for name, file in named_for(stl).items()}
        usual = {"particle": "D6", "wall": "steel", "count": 500, "end": "at rest"}
        own = rig_of_keys({**usual, **keys, "walls": walls}, lab)
    elif lab is None:
        raise BadInput("simulate custom: name a lab.toml with a rig under [rigs.NAME], or give --stl and --fill.")
    elif stl_unit is not None:
        raise BadInput("--stl-unit belongs to --stl; for a rig of a lab.toml state stl_unit there.")
    else:
        own = read_own_rig(lab, name, instead=keys, allow_outside=allow_outside)
    from rigtwin.compare.twins.custom import cast_of_own, custom_twin

    cast, surfaces = cast_of_own(own)
    return partial(
        custom_twin, own.rig, cast, count=own.count, surfaces=surfaces, notes=own.notes, located=own.located, **run
    )
