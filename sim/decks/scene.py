"""What happens in a rig, in a form that every code can follow: walls, start positions and stages."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.custom_rig import CustomRig, End, StlWall
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.lab.rigs import GRAVITY, Drum, Hopper, Packing, Pile
from rigtwin.lab.units import positive
from rigtwin.sim import custom, drum, hopper, packing
from rigtwin.sim.engine.walls.shapes import Shape
from rigtwin.sim.pile import pile
from rigtwin.sim.pile.emptying import Emptying
from rigtwin.sim.pile.piling import Piling
from rigtwin.sim.pile.pouring import Pouring
from rigtwin.sim.run import filling
from rigtwin.sim.run.filling import AT_REST, LOOK, SETTLED, Stillness

BulkRig = Packing | Pile | Drum | Hopper | CustomRig

STEEPEST_HEAP = math.radians(35)  # of an expected heap, which a funnel that stands must stay above
SLOWER = 1.1  # [1], time that pouring in a deck may take over that asked for without a remark
LOOSEST = 0.45  # part of a bed's volume that is beads, less than in any poured bed
NOTHING = np.zeros((0, 3))


@dataclass(frozen=True)
class Pour:
    """Beads are inserted at the beginning of each interval of `LOOK`."""

    speed: float  # [m/s], downwards
    batches: tuple[Array, ...]  # [m], each of shape (n, 3)


@dataclass(frozen=True)
class Settle:
    """Wait until the beads rest, with a check every `LOOK`."""

    limit: float  # [s]
    still: Stillness


@dataclass(frozen=True)
class Open:
    """Remove a wall."""

    wall: str


@dataclass(frozen=True)
class Lift:
    """Record the beads, and lift a wall at constant speed."""

    wall: str
    speed: float  # [m/s]
    height: float  # [m]


@dataclass(frozen=True)
class Turn:
    """Turn all walls about the y axis and record the beads at regular intervals, at the start too."""

    spin: float  # [rad/s], right-handed about y
    duration: float  # [s]
    interval: float  # [s]


@dataclass(frozen=True)
class Drain:
    """Record the beads at regular intervals, at the start too, until none is above z = 0."""

    limit: float  # [s]
    interval: float  # [s]


@dataclass(frozen=True)
class Insert:
    """Insert beads."""

    places: Array  # [m], shape (n, 3)
    speed: float  # [m/s], downwards


@dataclass(frozen=True)
class Move:
    """Begin the motion of a wall, or end it."""

    wall: str
    motion: StlWall
    begins: bool


@dataclass(frozen=True)
class Look:
    """Record the beads."""


@dataclass(frozen=True)
class Timeline:
    """What happens at times [s] from the start of the run, rising; the run goes on in between."""

    events: tuple[tuple[float, Insert | Move | Open | Look], ...]


@dataclass(frozen=True)
class Watch:
    """Record the beads at regular intervals."""

    limit: float  # [s]
    interval: float  # [s]
    end: End  # "time", or before: "at rest" as all beads rest, "empty" as none is left


Stage = Pour | Settle | Open | Lift | Turn | Drain | Timeline | Watch


@dataclass(frozen=True)
class Scene:
    """A rig with its beads; x and y from its axis, z up (drum: y along the axis)."""

    rig: BulkRig
    walls: Mapping[str, Shape]
    places: Array  # [m], shape (n, 3), of the beads that are there at the start
    velocities: Array  # [m/s], shape (n, 3)
    stages: tuple[Stage, ...]
    low: Array  # [m], shape (3,), corner of the room in which beads are computed; those outside are lost
    high: Array  # [m], shape (3,)
    inside: Array  # [m], shape (3,), a point on the beads' side of all walls
    warnings: tuple[str, ...] = ()
    sizes: Array | None = None
    """Sizes over that of the largest particle, shape (count,), in the order of their numbers; None: all equal."""
    turns: Array | None = None
    """Orientations of clumps, shape (count, 4): quaternions, the real part first."""

    @property
    def count(self) -> int:
        """Number of beads, those that are poured later included."""
        poured = sum(len(batch) for stage in self.stages if isinstance(stage, Pour) for batch in stage.batches)
        timelines = (stage.events for stage in self.stages if isinstance(stage, Timeline))
        inserted = sum(len(what.places) for events in timelines for _, what in events if isinstance(what, Insert))
        return len(self.places) + poured + inserted

    @property
    def records(self) -> bool:
        """Whether a stage records the beads over time."""
        return any(isinstance(stage, (Lift, Turn, Drain, Watch)) for stage in self.stages)


def scene_of(
    rig: BulkRig, particle: Particle, *, count: int | None, seed: int, fastest: float, **options: Any
) -> Scene:
    """The scene of a rig, with the start positions that rigtwin's own twin has with the same seed.

    Parameters
    ----------
    rig : Packing, Pile, Drum, Hopper or CustomRig
        The rig.
    particle : Particle
        A sphere.
    count : int or None
        Number of beads; None only for a drum, which is then filled as its rig says.
    seed : int
        Seed of the start positions.
    fastest : float
        Largest speed [m/s] of a bead that the time step allows.
    **options : float
        Settings of the run as `rigtwin.sim.<rig>.run` takes them; None counts as not given.

    Returns
    -------
    Scene
        Walls, start positions and stages.

    Raises
    ------
    BadInput
        If the settings cannot be simulated, or no deck can follow them.
    """
    given = {name: value for name, value in options.items() if value is not None}
    random = np.random.default_rng(seed)
    if isinstance(rig, Drum):
        return _drum(rig, particle, count, random, **given)
    assert count is not None
    if isinstance(rig, CustomRig):
        return _custom(rig, particle, count, random)
    if isinstance(rig, Packing):
        return _packing(rig, particle, count, random, fastest, **given)
    if isinstance(rig, Pile):
        return _pile(rig, particle, count, random, fastest, **given)
    return _hopper(rig, particle, count, random, **given)


def _packing(
    rig: Packing,
    particle: Particle,
    count: int,
    random: np.random.Generator,
    fastest: float,
    *,
    pour_rate: float | None = None,
    fill_limit: float = 3.0,
    settle_limit: float = 4.0,
) -> Scene:
    packing.check(rig, particle, count=count, settle_limit=settle_limit, pour_rate=pour_rate)
    source = packing.outlet_of(rig, particle, pour_rate)
    walls: dict[str, Shape] = dict(zip(("floor", "cylinder"), packing.walls_of(rig), strict=True))
    places, velocities = NOTHING, NOTHING
    stages: tuple[Stage, ...]
    if rig.hopper_diameter is None:
        filling.need_bearable(source, fastest)
        filling.need_bearable_fall("cylinder_height", source.height, source.speed, fastest)
        low, high = packing.domain_of(rig, particle, source, None)
        sizes = filling.Course(random=random).sizes(count, particle)
        pour, turns = _poured(source, particle, count, sizes, random)
        stages = (pour, Settle(settle_limit, AT_REST))
    else:
        above = packing.Hopper(rig.hopper_diameter, source, particle, count)
        walls |= dict(zip(("slide", "cone", "bin"), above.shapes, strict=True))
        wide = above.diameter / 2
        box = np.array([-wide, -wide, source.height]), np.array([wide, wide, above.top])
        funnel = filling.in_funnel(source.diameter, above.diameter, above.cone_height, source.height)
        places, velocities, sizes = filling.scattered(count, funnel, box, particle, random)
        turns = filling.turns_of(count, particle, random)
        low, high = packing.domain_of(rig, particle, source, above)
        flows = _longest_flow(particle, source.diameter, count)
        stages = (Settle(fill_limit, SETTLED), Open("slide"), Settle(flows + settle_limit, AT_REST))
    middle = np.array([0.0, 0.0, rig.cylinder_height / 2])
    return Scene(rig, walls, places, velocities, stages, np.array(low), np.array(high), middle, (), sizes, turns)


def _pile(
    rig: Pile,
    particle: Particle,
    count: int,
    random: np.random.Generator,
    fastest: float,
    *,
    pour_rate: float | None = None,
    fall_height: float | None = None,
    fill_limit: float = 3.0,
    settle_limit: float = 4.0,
) -> Scene:
    said: tuple[str, ...] = ()
    if rig.variant == "piling" and rig.outlet_height is None:
        # steps of a tenth of a millimetre, so that the option can repeat the value
        fall = 3 * particle.diameter if fall_height is None else fall_height
        expected = rig.rim_height + rig.base_diameter / 2 * math.tan(STEEPEST_HEAP) + particle.diameter + fall
        height = math.ceil(expected * 1e4) / 1e4
        rig = replace(rig, outlet_height=height)
        said = (
            f"the funnel stands {height * 1e3:.4g} mm above the base, as a deck has no funnel that rises with the "
            f"heap; rigtwin's own twin of this rig takes --outlet-height {height * 1e3:.4g}mm",
        )
    pile.check(rig, particle, count=count)
    positive(settle_limit=settle_limit)
    method = pile.method_of(rig, particle, count, pour_rate, None, fill_limit)
    method.need_bearable(fastest, falls_freely=True)
    low, high = (np.array(corner) for corner in method.domain)
    inside = np.array([0.0, 0.0, particle.diameter])
    if isinstance(method, Emptying):
        walls = dict(zip(("lid", "base", "container"), method.shapes, strict=True))
        half = rig.base_diameter / 2
        box = np.array([-half, -half, 0.0]), np.array([half, half, method.height])
        at, moving, sizes = filling.scattered(count, filling.in_tube(2 * half), box, particle, random)
        stages: tuple[Stage, ...] = (Settle(fill_limit, SETTLED), Open("lid"), Settle(settle_limit, AT_REST))
        return Scene(rig, walls, at, moving, stages, low, high, inside, said, sizes)
    if isinstance(method, Pouring):
        return _lifted(method, low, high, inside, random, fill_limit, settle_limit)
    assert isinstance(method, Piling)
    walls = dict(zip(("base", "rim"), method.shapes, strict=False))
    sizes = filling.Course(random=random).sizes(count, particle)
    pour, turned = _poured(method.outlet, particle, count, sizes, random)
    stages = (pour, Settle(settle_limit, AT_REST))
    return Scene(rig, walls, NOTHING, NOTHING, stages, low, high, inside, said, sizes, turned)


def _lifted(
    method: Pouring, low: Array, high: Array, inside: Array, random: np.random.Generator, fill_limit: float,
    settle_limit: float,
) -> Scene:  # fmt: skip
    """A tube that is lifted until it is above the bed that stood in it."""
    walls = dict(zip(("base", "rim", "tube") if method.rig.rim_height > 0 else ("base", "tube"), method.shapes,
                     strict=True))  # fmt: skip
    half, bead = method.tube_diameter / 2, method.particle
    box = np.array([-half, -half, 0.0]), np.array([half, half, method.tube_height])
    at, moving, sizes = filling.scattered(method.count, filling.in_tube(2 * half), box, bead, random)
    bed = method.count * bead.mean_volume / LOOSEST / (math.pi * half**2) + bead.diameter
    lift = Lift("tube", method.lift_speed, bed)
    stages = (Settle(fill_limit, SETTLED), lift, Open("tube"), Settle(settle_limit, AT_REST))
    above = np.add(high, (0.0, 0.0, 1.1 * bed))
    return Scene(method.rig, walls, at, moving, stages, low, above, inside, sizes=sizes)


def _drum(
    rig: Drum,
    particle: Particle,
    count: int | None,
    random: np.random.Generator,
    *,
    turns: float = 1.0,
    interval: float = 0.1,
    fill_limit: float = 2.0,
) -> Scene:
    drum.check(rig, particle, count=count)
    positive(turns=turns, interval=interval, fill_limit=fill_limit)
    depth, _ = drum.filled_in(rig)
    said = "fill" if count is None else "count"
    inside, box = drum.room(rig, depth)
    places, velocities, sizes = filling.scattered(
        drum.filled(rig, particle) if count is None else count, inside, box, particle, random, said
    )
    turned = filling.turns_of(len(places), particle, random)
    low, high = drum.domain(rig, depth, particle)
    walls = dict(zip(("shell", "front", "back"), drum.shapes(rig, depth), strict=True))
    turn = Turn(rig.speed, turns * 2 * math.pi / abs(rig.speed), interval)
    stages = (Settle(fill_limit, SETTLED), turn)
    middle = np.zeros(3)
    return Scene(rig, walls, places, velocities, stages, np.array(low), np.array(high), middle, (), sizes, turned)


def _hopper(
    rig: Hopper,
    particle: Particle,
    count: int,
    random: np.random.Generator,
    *,
    duration: float | None = None,
    fill_limit: float = 3.0,
    settle_limit: float = 4.0,
) -> Scene:
    hopper.check(rig, particle, count=count, duration=duration)
    positive(fill_limit=fill_limit, settle_limit=settle_limit)
    plan = hopper.plan_of(rig, particle, count)
    places, velocities, sizes = filling.scattered(count, plan.inside, plan.filled, particle, random)
    walls: dict[str, Shape] = {"lid": plan.shapes[hopper.LID]}
    walls |= {f"wall{k}": shape for k, shape in enumerate(plan.shapes) if k != hopper.LID}
    limit = _longest_flow(particle, rig.outlet, count) if duration is None else duration
    stages: list[Stage] = [Settle(fill_limit, SETTLED), Open("lid"), Drain(limit, hopper.LOOK)]
    if plan.floor:
        stages.append(Settle(settle_limit, AT_REST))
    inside = np.array([0.0, 0.0, particle.diameter])
    return Scene(rig, walls, places, velocities, tuple(stages), plan.domain[0], plan.domain[1], inside, sizes=sizes)


def _custom(rig: CustomRig, particle: Particle, count: int, random: np.random.Generator) -> Scene:
    """Walls from STL files; what happens at stated times, then a watch until the run ends."""
    custom.check(rig, particle, count=count)
    names = {name: mesh_name(name) for name in rig.walls}
    for name, other in combinations(names, 2):
        if names[name] == names[other]:
            raise BadInput(
                f"walls.{other}: has the name of walls.{name} in a deck, {names[name]}; give it another name."
            )
    walls: dict[str, Shape] = {names[name]: mesh for name, mesh in custom.shapes(rig).items()}
    low, high = custom.domain_of(rig, particle)
    source, sizes = custom.FillRegion(rig), filling.Course(random=random).sizes(count, particle)
    places, velocities, turns = NOTHING, NOTHING, None
    said = tuple(custom.remarks(rig, particle))
    events: list[tuple[float, Insert | Move | Open | Look]] = []
    if rig.pour_rate is None:
        try:
            places, velocities, _ = filling.scattered(
                count, source.inside, source.box, particle, random, thrown=custom.THROWN, sizes=sizes
            )
        except BadInput as error:
            raise BadInput(f"{error} A deck places all at once: give a pour_rate, or a larger fill.") from None
        turns = filling.turns_of(count, particle, random)
    else:
        pour, turns = _poured(source, particle, count, sizes, random)
        events += [(k * LOOK, Insert(batch, pour.speed)) for k, batch in enumerate(pour.batches) if len(batch)]
        takes, asked = len(pour.batches) * LOOK, count / rig.pour_rate
        if takes > SLOWER * asked + LOOK:
            said += (
                f"the fill region lets beads be placed in {takes:.3g} s, not {asked:.3g} s, as none may be hit on its "
                "way down; give a pour_speed, or a wider fill",
            )
    for name, wall in rig.walls.items():
        if wall.moves:
            events.append((wall.start, Move(names[name], wall, True)))
            if wall.stop is not None:
                events.append((wall.stop, Move(names[name], wall, False)))
        if wall.removed is not None:
            events.append((wall.removed, Open(names[name])))
    events = sorted((one for one in events if one[0] < rig.duration), key=lambda one: one[0])
    last = math.ceil(max([time for time, _ in events], default=0.0) / rig.interval - 1e-9)
    looks = [(k * rig.interval, Look()) for k in range(last + 1) if k * rig.interval < rig.duration]
    left = rig.duration - last * rig.interval
    watch = (Watch(left, rig.interval, rig.end),) if left > 1e-9 * rig.duration else ()
    if not watch:  # events up to the last interval
        looks.append((rig.duration, Look()))
    timeline = Timeline(tuple(sorted((*events, *looks), key=lambda one: one[0])))
    poses = [custom.poses(rig, wall).reshape(-1, 3) for wall in rig.walls.values()]
    wide = np.concatenate([*poses, [low, high]])
    margin = particle.diameter
    return Scene(
        rig, walls, places, velocities, (timeline, *watch), wide.min(axis=0) - margin, wide.max(axis=0) + margin,
        (low + high) / 2, said, sizes, turns,
    )  # fmt: skip


def mesh_name(name: str) -> str:
    """Return the name of a wall of the user's own in a deck, in which a hyphen is no letter.

    Parameters
    ----------
    name : str
        Name of the wall.

    Returns
    -------
    str
        The name in the deck.
    """
    return f"wall_{name.replace('-', '_')}"


def _longest_flow(particle: Particle, outlet: float, count: int) -> float:
    """Longest discharge [s], after which a hopper counts as blocked: four times Beverloo's, and two seconds."""
    grain = particle.typical.equivalent_diameter
    return 2.0 + 4.0 * count / filling.beverloo(particle, max(outlet, 2.5 * grain), grain)


def _poured(
    source: filling.Source, particle: Particle, count: int, sizes: Array | None, random: np.random.Generator
) -> tuple[Pour, Array | None]:
    """Batches of beads that find room below the outlet, while earlier ones fall freely; and the turns of clumps."""
    batches: list[Array] = []
    turns: list[Array] = []
    wide = np.full(count, particle.diameter) if sizes is None else particle.diameter * sizes
    falling, speeds, radii, placed = NOTHING, np.zeros(0), np.zeros(0), 0
    patience = 0
    while placed < count and patience < filling.PATIENCE:
        due = filling.due_at(source, len(batches) * LOOK, count) - placed
        own = isinstance(source, custom.FillRegion)  # a region, in which a new bead may come to lie below earlier ones
        if isinstance(source, custom.FillRegion):
            source.time = len(batches) * LOOK
        due_now = wide[placed : placed + max(due, 0)]
        new = filling.places(falling, radii, source, due_now, random, in_shade=not own)
        batches.append(new)
        if (turned := filling.turns_of(len(new), particle, random)) is not None:
            turns.append(turned)
        radii = np.append(radii, wide[placed : placed + len(new)] / 2)
        placed += len(new)
        patience = 0 if len(new) or due <= 0 else patience + 1
        falling, speeds = np.vstack([falling, new]), np.append(speeds, np.full(len(new), source.speed))
        falling = falling - np.column_stack([0 * speeds, 0 * speeds, speeds * LOOK + GRAVITY / 2 * LOOK**2])
        speeds = speeds + GRAVITY * LOOK
        near = falling[:, 2] > source.height - 2 * particle.diameter
        falling, speeds, radii = falling[near], speeds[near], radii[near]
    if placed < count:
        raise BadInput(f"count: only {placed} of {count} beads find room below the outlet; give a wider outlet.")
    return Pour(source.speed, tuple(batches)), np.concatenate(turns) if turns else None
