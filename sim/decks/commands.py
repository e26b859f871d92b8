"""Commands that LIGGGHTS and LAMMPS share: start positions and stages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.clumps import Clump
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.decks.deck import END, RECORD, Deck
from rigtwin.sim.decks.scene import Drain, Insert, Lift, Look, Move, Open, Pour, Settle, Timeline, Turn, Watch
from rigtwin.sim.run.filling import AT_REST, LOOK, Stillness

COLUMNS = "id x y z vx vy vz"


def positions(deck: Deck, types: int) -> str:
    """Return a data file with the beads that are there at the start.

    Parameters
    ----------
    deck : Deck
        Deck whose beads are placed.
    types : int
        Number of materials.

    Returns
    -------
    str
        Content of the file.
    """
    scene, count = deck.scene, len(deck.scene.places)
    bounds = [f"{a:.9g} {b:.9g} {axis}lo {axis}hi" for a, b, axis in zip(scene.low, scene.high, "xyz", strict=True)]
    wide, density, each = diameters(deck), densities(deck), len(deck.particle.radii)
    atoms = [
        f"{i} 1 {wide[i - 1]:.10g} {density[i - 1]:.10g} {three(place)}"
        for i, place in enumerate(spheres(deck, scene.places, 0), 1)
    ]
    speeds = [f"{i} {three(speed)} 0 0 0" for i, speed in enumerate(np.repeat(scene.velocities, each, axis=0), 1)]
    head = [f"{deck.particle.name}, written by rigtwin", "", f"{len(atoms)} atoms", f"{types} atom types", *bounds]
    lines = [*head, "", "Atoms", "", *atoms, "", "Velocities", "", *speeds, ""]
    if deck.particle.shape is not None:
        lines += ["Molecules", "", *(f"{i + 1} {i // each + 1}" for i in range(each * count)), ""]
    return "\n".join(lines)


RIGID = "fix move all rigid/small molecule\n"
LIGHTEST = 0.05  # of the mean: least mass of a sphere of a clump, as a code takes none without mass


def _sizes(deck: Deck) -> Array:
    return np.ones(deck.scene.count) if deck.scene.sizes is None else deck.scene.sizes


def diameters(deck: Deck) -> Array:
    """Return the diameters of the spheres of all particles.

    Parameters
    ----------
    deck : Deck
        Deck that holds the particles.

    Returns
    -------
    ndarray, shape (n,)
        Diameters [m], by the number of the sphere.
    """
    return np.outer(_sizes(deck), 2 * np.array(deck.particle.radii)).ravel()


def densities(deck: Deck) -> Array:
    """Return the densities of the spheres of all particles.

    Those of a clump have the masses with which the code, which adds spheres up as if they did not overlap, finds mass,
    centre and moments of inertia of the clump as nearly as it can.

    Parameters
    ----------
    deck : Deck
        Deck that holds the particles.

    Returns
    -------
    ndarray, shape (n,)
        Densities [kg/m^3], by the number of the sphere.
    """
    shape, bead = deck.particle.shape, deck.particle
    if shape is None:
        return np.full(deck.scene.count, bead.effective_density)
    masses, _ = _masses(shape)
    return np.tile(bead.mass * masses / (4 / 3 * np.pi * np.array(shape.radii) ** 3), deck.scene.count)


def inertia_missed(shape: Clump) -> float:
    """Return by how much such a code misses the moments of inertia of a clump.

    Parameters
    ----------
    shape : Clump
        Clump, which the code is given as single spheres with masses of their own.

    Returns
    -------
    float
        Largest relative difference of a moment [1].
    """
    return _masses(shape)[1]


def _masses(shape: Clump) -> tuple[Array, float]:
    """Shares of the mass that the spheres of a clump have, and by how much its moments of inertia are missed."""
    from scipy.optimize import lsq_linear

    places, radii, reach = np.array(shape.offsets), np.array(shape.radii), shape.reach
    x, y, z = places.T
    own = 0.4 * radii**2
    moments = np.array([y**2 + z**2 + own, x**2 + z**2 + own, x**2 + y**2 + own])
    mixed = np.array([x * y, x * z, y * z])
    matrix = np.vstack([np.ones(len(radii)), places.T / reach, moments / reach**2, mixed / reach**2])
    wanted = [1.0, 0.0, 0.0, 0.0, *(np.array(shape.gyration) / reach**2), 0.0, 0.0, 0.0]
    shares = lsq_linear(matrix, wanted, bounds=(LIGHTEST / len(radii), np.inf)).x
    shares /= shares.sum()
    return shares, float(np.abs(moments @ shares / np.array(shape.gyration) - 1).max())


def spheres(deck: Deck, places: Array, first: int) -> Array:
    """Return the centres of the spheres of particles.

    Parameters
    ----------
    deck : Deck
        Deck that holds the particles.
    places : ndarray, shape (n, 3)
        Centres of the particles [m].
    first : int
        Number of the first of them.

    Returns
    -------
    ndarray, shape (m, 3)
        Centres of their spheres [m].
    """
    shape, scene = deck.particle.shape, deck.scene
    if shape is None or not len(places):
        return places
    from scipy.spatial.transform import Rotation

    assert scene.turns is not None
    span = slice(first, first + len(places))
    turns = Rotation.from_quat(scene.turns[span], scalar_first=True)
    arms = np.array(shape.offsets)[None] * _sizes(deck)[span, None, None]
    turned = np.stack([turn.apply(arm) for turn, arm in zip(turns, arms, strict=True)])
    return np.asarray((places[:, None] + turned).reshape(-1, 3))


def start(deck: Deck, types: int) -> str:
    """Return the commands that make the box and the beads that are there at the start.

    Parameters
    ----------
    deck : Deck
        Deck that the commands belong to.
    types : int
        Number of materials.

    Returns
    -------
    str
        The commands.
    """
    scene, clump = deck.scene, deck.particle.shape is not None
    labels = "fix body all property/atom mol ghost yes\n" if clump else ""
    if len(scene.places):
        return f"{labels}read_data beads.data{' fix body NULL Molecules' if clump else ''}\n"
    low, high = scene.low, scene.high
    sides = " ".join(f"{a:.9g} {b:.9g}" for a, b in zip(low, high, strict=True))
    return f"region room block {sides} units box\ncreate_box {types} room\n{labels}"


def poured(deck: Deck) -> str:
    """Return the commands that insert the batches of beads, `LOOK` apart.

    Parameters
    ----------
    deck : Deck
        Deck that the commands belong to.

    Returns
    -------
    str
        The commands.
    """
    steps = deck.steps(LOOK)
    lines, number = [f"# inserts the beads in batches, {LOOK:g} s apart"], len(deck.scene.places)
    for stage in deck.scene.stages:
        for batch in stage.batches if isinstance(stage, Pour) else ():
            if len(batch):
                assert isinstance(stage, Pour)
                lines += _inserted(deck, batch, number, stage.speed)
                if deck.particle.shape is not None:
                    lines += [*(["unfix move"] if number else []), RIGID.strip()]
            number += len(batch)
            lines.append(f"run {steps}")
    return "\n".join(lines) + "\n"


def _inserted(deck: Deck, batch: Array, number: int, speed: float) -> list[str]:
    """Commands that insert a batch of beads after the first `number`, at a speed [m/s] downwards."""
    each = len(deck.particle.radii)
    return [
        *(f"create_atoms 1 single {three(place)} units box" for place in spheres(deck, batch, number)),
        f"group new id {each * number + 1}:{each * (number + len(batch))}",
        *_sized(deck, number, len(batch)),
        f"velocity new set 0 0 {-speed:.10g} units box",
        "group new delete",
    ]


def _sized(deck: Deck, number: int, count: int) -> list[str]:
    """Commands that give `count` new beads after the first `number` their size."""
    if deck.particle.shape is not None:
        return _clumped(deck, number, count)
    wide, density = diameters(deck)[number : number + count], f"density {deck.particle.effective_density:.10g}"
    if deck.scene.sizes is None:
        return [f"set group new diameter {wide[0]:.10g} {density}"]
    # the density last: a new diameter keeps the mass
    each = [f"set atom {number + k} diameter {diameter:.10g}" for k, diameter in enumerate(wide, start=1)]
    return [*each, f"set group new {density}"]


def _clumped(deck: Deck, number: int, count: int) -> list[str]:
    each, wide, density = len(deck.particle.radii), diameters(deck), densities(deck)
    rows = range(each * number, each * (number + count))
    return [f"set atom {k + 1} diameter {wide[k]:.10g} density {density[k]:.10g} mol {k // each + 1}" for k in rows]


def stages(
    deck: Deck,
    name: str,
    opened: Callable[[str], str],
    turned: Callable[[float], str],
    lifted: Callable[[str, float], str] | None = None,
    moved: Callable[[Move], str] | None = None,
) -> str:
    """Return the commands of all stages.

    Parameters
    ----------
    deck : Deck
        Deck that the commands belong to.
    name : str
        Name of the input file.
    opened : callable
        Returns the commands that remove a wall, from its name.
    turned : callable
        Returns those that turn all walls, from the speed [rad/s].
    lifted : callable, optional
        Returns those that lift a wall, from its name and the speed [m/s], in a code that can.
    moved : callable, optional
        Returns those that begin or end a motion, in a code that can.

    Returns
    -------
    str
        The commands.
    """
    return "".join(_stages(deck, name, opened, turned, lifted, moved))


def _stages(
    deck: Deck,
    name: str,
    opened: Callable[[str], str],
    turned: Callable[[float], str],
    lifted: Callable[[str, float], str] | None,
    moved: Callable[[Move], str] | None,
) -> Iterator[str]:
    dump = f"write_dump all custom {RECORD} {COLUMNS} modify sort id append yes\n"
    for number, stage in enumerate(deck.scene.stages):
        done = f"done{number}"
        if isinstance(stage, Pour):
            yield "\n# beads are poured\ninclude pour.in\n"
        elif isinstance(stage, Open):
            yield f"\n# {stage.wall}: removed\n{opened(stage.wall)}"
        elif isinstance(stage, Timeline):
            assert moved is not None  # `Deck` refuses it for other codes
            yield "\n# walls move, beads are placed and recorded at stated times\n"
            yield from _timeline(deck, stage, dump, opened, moved)
        elif isinstance(stage, Watch):
            yield f"\n# recorded for {stage.limit:g} s at most, until: {stage.end}\n"
            leave = {
                "at rest": f"if {_resting(deck, AT_REST)} then {_to(name, done)}",
                "empty": f'if "$(atoms) < 1" then {_to(name, done)}',
            }.get(stage.end, "")
            turns = math.floor(stage.limit / stage.interval + 1e-9)
            left = stage.limit - turns * stage.interval
            last = f"run {deck.steps(left)}\n{dump}" if left > deck.time_step else ""
            body = f"run {deck.steps(stage.interval)}\n{dump}"
            yield _loop(name, number, turns, body, leave, last) if turns else last
        elif isinstance(stage, Settle):
            rest = _resting(deck, stage.still)
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


def _timeline(
    deck: Deck, stage: Timeline, dump: str, opened: Callable[[str], str], moved: Callable[[Move], str]
) -> Iterator[str]:
    step, number = -1, len(deck.scene.places)
    for time, what in stage.events:
        at = round(time / deck.time_step)
        if step < 0 and number:  # LIGGGHTS does not run without a bead
            yield "run 0\n"
            step = 0
        if at > step >= 0:
            yield f"run {at - step}\n"
            step = at
        if isinstance(what, Look):
            yield dump
        elif isinstance(what, Open):
            yield opened(what.wall)
        elif isinstance(what, Move):
            yield moved(what)
        elif isinstance(what, Insert):
            yield "\n".join([*_inserted(deck, what.places, number, what.speed), ""])
            number += len(what.places)


def _resting(deck: Deck, still: Stillness) -> str:
    """Condition that the beads rest."""
    bead = deck.particle
    mean = still.energy * bead.mean_mass * GRAVITY * bead.typical.radius / len(bead.radii)
    return f'"${{fastest}} < {still.speed:g} && ${{energy}} < {mean:.6g}"'


def _loop(name: str, number: int, times: float, body: str, leave: str = "", last: str = "") -> str:
    """Commands that repeat `body`, until `leave` leaves them, and `last` where it did not."""
    turns = max(1, round(times))
    ending = f"{leave}\n" if leave else ""
    return (
        f"variable turn{number} loop {turns}\nlabel again{number}\n{body}{ending}"
        f"next turn{number}\njump {name} again{number}\n{last}label done{number}\n"
    )


def _to(name: str, label: str) -> str:
    return f'"jump {name} {label}"'


def observed(deck: Deck) -> str:
    """Return the commands that make known by what a bed rests.

    Parameters
    ----------
    deck : Deck
        Deck that the commands belong to.

    Returns
    -------
    str
        The commands; they define ``fastest`` [m/s] and ``energy`` [J], the mean kinetic energy of a sphere.
    """
    energy, more = "ke", ""
    if deck.particle.shape is not None:  # the temperature, of which `ke` is made, has no meaning for rigid bodies
        energy = "c_kinetic"
        more = "variable kinetic atom 0.5*mass*v_speed^2\ncompute kinetic all reduce sum v_kinetic\n"
    return (
        "variable speed atom sqrt(vx*vx+vy*vy+vz*vz)\n"
        f"compute fastest all reduce max v_speed\n{more}"
        f"thermo_style custom step atoms {energy} c_fastest\n"
        "thermo_modify lost ignore norm no\n"
        "thermo 1000000\n"
        "variable fastest equal c_fastest\n"
        f"variable energy equal {energy}/(atoms+1.0e-9)\n"
    )


def three(vector: object) -> str:
    """Return three numbers with spaces between them.

    Parameters
    ----------
    vector : sequence of float
        Three components.

    Returns
    -------
    str
        The text.
    """
    return " ".join(f"{value:.10g}" for value in vector)  # type: ignore[attr-defined]
