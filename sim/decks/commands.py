"""Commands that LIGGGHTS and LAMMPS share: start positions and stages."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.decks.deck import END, RECORD, Deck
from rigtwin.sim.decks.scene import Drain, Lift, Open, Pour, Settle, Turn
from rigtwin.sim.run.filling import LOOK

COLUMNS = "id x y z vx vy vz"
SKIN = 0.2  # [diameters], Verlet skin


def positions(deck: Deck, types: int) -> str:
    """Data file with the beads that are there at the start; `types` is the number of materials."""
    scene, bead = deck.scene, deck.particle
    bounds = [f"{a:.9g} {b:.9g} {axis}lo {axis}hi" for a, b, axis in zip(scene.low, scene.high, "xyz", strict=True)]
    wide, density = diameters(deck), f"{bead.effective_density:.10g}"
    atoms = [f"{i} 1 {wide[i - 1]:.10g} {density} {_three(place)}" for i, place in enumerate(scene.places, 1)]
    speeds = [f"{i} {_three(speed)} 0 0 0" for i, speed in enumerate(scene.velocities, 1)]
    head = [f"{bead.name}, written by rigtwin", "", f"{len(atoms)} atoms", f"{types} atom types", *bounds]
    return "\n".join([*head, "", "Atoms", "", *atoms, "", "Velocities", "", *speeds, ""])


def diameters(deck: Deck) -> Array:
    """Of all beads, by their number [m]."""
    sizes = deck.scene.sizes
    return deck.particle.diameter * (np.ones(deck.scene.count) if sizes is None else sizes)


def start(deck: Deck, types: int) -> str:
    """Commands that make the box and the beads that are there at the start."""
    scene = deck.scene
    if len(scene.places):
        return "read_data beads.data\n"
    low, high = scene.low, scene.high
    sides = " ".join(f"{a:.9g} {b:.9g}" for a, b in zip(low, high, strict=True))
    return f"region room block {sides} units box\ncreate_box {types} room\n"


def poured(deck: Deck) -> str:
    """Commands that insert the batches of beads, `LOOK` apart."""
    steps = deck.steps(LOOK)
    lines, number = [f"# inserts the beads in batches, {LOOK:g} s apart"], len(deck.scene.places)
    for stage in deck.scene.stages:
        for batch in stage.batches if isinstance(stage, Pour) else ():
            lines += [f"create_atoms 1 single {_three(place)} units box" for place in batch]
            if len(batch):
                assert isinstance(stage, Pour)
                lines += [
                    f"group new id {number + 1}:{number + len(batch)}",
                    *_sized(deck, number, len(batch)),
                    f"velocity new set 0 0 {-stage.speed:.10g} units box",
                    "group new delete",
                ]
            number += len(batch)
            lines.append(f"run {steps}")
    return "\n".join(lines) + "\n"


def _sized(deck: Deck, number: int, count: int) -> list[str]:
    """Commands that give `count` new beads after the first `number` their size."""
    wide, density = diameters(deck)[number : number + count], f"density {deck.particle.effective_density:.10g}"
    if deck.scene.sizes is None:
        return [f"set group new diameter {wide[0]:.10g} {density}"]
    # the density last: a new diameter keeps the mass
    each = [f"set atom {number + k} diameter {diameter:.10g}" for k, diameter in enumerate(wide, start=1)]
    return [*each, f"set group new {density}"]


def stages(
    deck: Deck,
    name: str,
    opened: Callable[[str], str],
    turned: Callable[[float], str],
    lifted: Callable[[str, float], str] | None = None,
) -> str:
    """Commands of all stages for the input file `name`.

    `opened` gives the commands that remove a wall, `turned` those that turn all walls at a speed [rad/s], `lifted`
    those that lift a wall at a speed [m/s]
    in a code that can.
    """
    return "".join(_stages(deck, name, opened, turned, lifted))


def _stages(
    deck: Deck,
    name: str,
    opened: Callable[[str], str],
    turned: Callable[[float], str],
    lifted: Callable[[str, float], str] | None,
) -> Iterator[str]:
    dump = f"write_dump all custom {RECORD} {COLUMNS} modify sort id append yes\n"
    for number, stage in enumerate(deck.scene.stages):
        done = f"done{number}"
        if isinstance(stage, Pour):
            yield "\n# beads are poured\ninclude pour.in\n"
        elif isinstance(stage, Open):
            yield f"\n# {stage.wall}: removed\n{opened(stage.wall)}"
        elif isinstance(stage, Settle):
            bead = deck.particle
            mean = stage.still.energy * bead.mean_mass * GRAVITY * bead.typical.radius
            rest = f'"${{fastest}} < {stage.still.speed:g} && ${{energy}} < {mean:.6g}"'
            yield f"\n# until the beads rest, at most {stage.limit:g} s\n"
            yield _loop(
                name, number, stage.limit / LOOK, f"run {deck.steps(LOOK)}\n", f"if {rest} then {_to(name, done)}"
            )
        elif isinstance(stage, Lift):
            assert lifted is not None  # `Deck` refuses it for other codes
            lift = lifted(stage.wall, stage.speed)
            yield f"\n# {stage.wall}: lifted\nrun 0\n{dump}{lift}run {deck.steps(stage.height / stage.speed)}\n"
        elif isinstance(stage, Turn):
            yield f"\n# the walls turn\n{turned(stage.spin)}run 0\n{dump}"
            yield _loop(name, number, stage.duration / stage.interval, f"run {deck.steps(stage.interval)}\n{dump}")
        elif isinstance(stage, Drain):
            yield "\n# until no bead is above the outlet\n"
            yield "region above block INF INF INF INF 0 INF units box\nvariable inside equal count(all,above)\n"
            yield f"run 0\n{dump}"
            leave = f'if "${{inside}} < 1" then {_to(name, done)}'
            steps = deck.steps(stage.interval)
            yield _loop(name, number, stage.limit / stage.interval, f"run {steps}\n{dump}", leave)
    yield f"\nwrite_dump all custom {END} {COLUMNS} modify sort id\n"


def _loop(name: str, number: int, times: float, body: str, leave: str = "") -> str:
    turns = max(1, round(times))
    ending = f"{leave}\n" if leave else ""
    return (
        f"variable turn{number} loop {turns}\nlabel again{number}\n{body}{ending}"
        f"next turn{number}\njump {name} again{number}\nlabel done{number}\n"
    )


def _to(name: str, label: str) -> str:
    return f'"jump {name} {label}"'


OBSERVED = (
    "variable speed atom sqrt(vx*vx+vy*vy+vz*vz)\n"
    "compute fastest all reduce max v_speed\n"
    "thermo_style custom step atoms ke c_fastest\n"
    "thermo_modify lost ignore norm no\n"
    "thermo 1000000\n"
    "variable fastest equal c_fastest\n"
    "variable energy equal ke/(atoms+1.0e-9)\n"
)


def _three(vector: object) -> str:
    return " ".join(f"{value:.10g}" for value in vector)  # type: ignore[attr-defined]
