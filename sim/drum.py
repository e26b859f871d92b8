"""Simulation of the rotating drum: surface of the bed over time, and mixing (Hlosta et al. 2020, section 2.2.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.drum_flow import FILL, fill_check
from rigtwin.lab.errors import BadInput
from rigtwin.lab.formatting import as_given
from rigtwin.lab.materials import PACKING, Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check
from rigtwin.lab.records import Profile, Series
from rigtwin.lab.rigs import Drum
from rigtwin.lab.units import positive
from rigtwin.sim.output.mixing import CELL, Mixing, lacey, mixing
from rigtwin.sim.output.outline import bed, outline
from rigtwin.sim.run import filling
from rigtwin.sim.run.run_log import History
from rigtwin.sim.run.set_up import Bench, Numerics

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.bulk.particle_state import Beads, Grains
    from rigtwin.sim.engine.walls.shapes import Shape
    from rigtwin.sim.output.replay import Frame
    from rigtwin.sim.run.run_log import Logbook


END_WALLS = (1, 2)  # numbers of the walls in `shapes`
DEPTH = 0.5  # depth over diameter, where the rig does not state it
FULLEST = 0.9  # largest fill (share of the volume); a fuller bed cannot turn over
STEADY_AFTER = 0.25  # turns until the slope counts as steady
SHALLOWEST, SHORTEST = (
    3.0,
    6.0,
)  # [bead diameters], least bed height and surface length; below, single beads set the angle
FEWEST_LOOKS = 5  # samples of the steady bed; the scatter of fewer is known no better than to a third


@dataclass(frozen=True)
class Rotation:
    """Result of a run.  x and z from the drum's axis, z up; the drum turns clockwise: the bed climbs towards -x."""

    time: Array  # [s], since the drum began to turn, of each profile; the first is that of the bed at rest
    profiles: tuple[Profile, ...]  # the bed's outline, height against the drum's axis
    steady: Profile  # mean outline of the steady bed; NaN where it is not seen in all samples
    steady_from: float  # [s]
    mixing: Series  # Lacey's index of the initially lower and upper half of the bed; starts at 0
    mixed: Mixing  # at the end
    centres: Array  # [m], shape (n, 3), of the spheres at the end; y along the axis
    radii: Array  # [m], shape (n,)
    count: int
    turns: float  # of the drum
    statistics: dict[str, float] = field(default_factory=dict)
    history: History | None = None  # energy, contacts and overlaps over time
    assumptions: dict[str, str] = field(default_factory=dict)  # all that the rig's description leaves open
    warnings: tuple[str, ...] = ()


def run(
    rig: Drum,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int | None = None,
    turns: float = 1.0,
    interval: float = 0.1,
    seed: int = 1,
    fill_limit: float = 2.0,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Rotation:
    """Fill the drum, let the bed come to rest, and turn the drum.

    Parameters
    ----------
    rig : Drum
        Diameter and depth [m], speed [rad/s] and fill (share of the volume, at bulk density).
    particle : Particle
        Sphere or clump.
    wall : Material
        Material of the shell and of the end walls, which turn with it.
    contact, wall_contact : Contact
        Coefficients of contacts between particles, and of particles with walls.
    count : int, optional
        Number of particles.  Default: as many as fill the share `rig.fill`.
    turns : float
        Number of revolutions [1].
    interval : float
        Time between two samples of the bed [s].
    seed : int
        Seed of the random positions and orientations.
    fill_limit : float
        Longest wait [s] until the bed rests before the drum turns.
    progress : Progress
        Callback for the progress display.
    **numerics : Numerics
        Numerical settings, see `rigtwin.sim.run.set_up.Numerics`.

    Returns
    -------
    Rotation
        Outlines of the bed and mixing index over time.

    Raises
    ------
    BadInput
        If a setting is out of its range, the beads do not fit in, or the wall is too fast for the time step.
    SimulationFailed
        If the simulation breaks down.

    References
    ----------
    Hlosta et al. 2020, section 2.2.4.  The mixing index: Lacey 1954, J. Appl. Chem. 4, 257.
    """
    check(rig, particle, count=count)
    depth, _ = filled_in(rig)
    positive(turns=turns, interval=interval, fill_limit=fill_limit)
    # a fill may be stated or seen in a film, which the caller knows
    if count is None:
        said, fill_from = "fill", f" ({as_given(None)})" if rig.fill is None else ""
        count = filled(rig, particle)
    else:
        said, fill_from = "count", " (by the number of beads given)"
    bench = Bench(rig, particle, wall, contact, wall_contact, numerics)
    if (passes := abs(rig.speed) * rig.diameter / 2) >= bench.fastest:
        raise BadInput(
            f"speed: the drum's wall would move at {passes:.3g} m/s, but the time step allows at most "
            f"{bench.fastest:.3g} m/s; turn it more slowly."
        )
    ends = dict.fromkeys(END_WALLS, rig.end_wall_friction)
    bulk = bench.bulk(shapes(rig, depth), domain(rig, depth, particle), open_domain=False, static_friction=ends)
    course = _Course(random=np.random.default_rng(seed))
    asked = {"count": count, "turns": turns, "interval": interval, "fill_limit": fill_limit}
    with bench.logbook(bulk, seed=seed, **asked) as logbook:
        if kept := logbook.resume():
            course.go_on(kept)
        _scatter(bulk, logbook, course, rig, depth, particle, count, said, progress)
        _settle(bulk, logbook, course, rig, particle, fill_limit, progress)
        _turn(bulk, logbook, course, rig, particle, turns, interval, progress)
    return _rotation(
        rig,
        particle,
        course,
        bulk.beads(),
        bulk.grains(),
        count=count,
        turns=turns,
        statistics={
            **logbook.statistics(),
            "contacts_per_bead": 2 * bulk.contacts / count,
            "wall_work_j": bulk.work,
        },
        history=logbook.history,
        assumptions={
            "depth": f"{depth * 1e3:.3g} mm ({as_given(rig.depth)})",
            "fill": f"{count} beads, {_share(count, rig, depth, particle):.1%} of the volume at a packing of "
            f"{PACKING:g}{fill_from}",
            "end_walls": "of the drum's material, turning with it"
            + ("" if rig.end_wall_friction is None else f", static friction {rig.end_wall_friction:g}"),
            "filling": f"placed on a loose lattice and let fall, {course.let_go:.2f} s until the bed rested",
            "start": "at full speed at once",
            **bench.assumptions(),
        },
        warnings=bench.warnings(bulk, logbook) + _warnings(course),
    )


def replayed(rig: Drum, particle: Particle, frames: Sequence[Frame], *, turns: float, in_time: bool) -> Rotation:
    """The result of a rotation that another program computed.

    Parameters
    ----------
    rig : Drum
        Diameter and depth [m], speed [rad/s].
    particle : Particle
        The sphere.
    frames : sequence of Frame
        The bed as the drum begins to turn, then at regular intervals.
    turns : float
        Number of revolutions [1].
    in_time : bool
        Whether the bed was at rest as the drum began to turn.

    Returns
    -------
    Rotation
        Outlines of the bed and mixing index over time, as `run` gives them.
    """
    first, last = frames[0], frames[-1]
    course = _Course(random=np.random.default_rng(0), let_go=first.time, in_time=in_time)
    _mark_halves(first.grains(particle), course)
    for frame in frames:
        _look(frame.beads(particle), frame.grains(particle), frame.time, course, rig, particle)
    lasts, needed = last.time - first.time, _steady_from(rig, turns)
    if lasts < needed:
        raise BadInput(f"the drum turns for {lasts:.3g} s, and the bed is steady from {needed:.3g} s on; run longer.")
    count = len(last.ident)
    return _rotation(
        rig, particle, course, last.beads(particle), last.grains(particle), count=count, turns=turns,
        statistics={}, history=None, assumptions={}, warnings=_warnings(course),
    )  # fmt: skip


def _rotation(
    rig: Drum,
    particle: Particle,
    course: _Course,
    beads: Beads,
    grains: Grains,
    *,
    count: int,
    turns: float,
    statistics: dict[str, float],
    history: History | None,
    assumptions: dict[str, str],
    warnings: tuple[str, ...],
) -> Rotation:
    times = np.array(course.times)
    empty = _outline(np.zeros((0, 3)), np.zeros(0), rig, particle)
    profiles = tuple(
        replace(empty, height=np.array(height), view=f"t = {when:.3f} s")
        for when, height in zip(course.times, course.heights, strict=True)
    )
    steady_from = _steady_from(rig, turns)
    late = [profile.height for profile, when in zip(profiles, times, strict=True) if when >= steady_from]
    return Rotation(
        time=times,
        profiles=profiles,
        steady=replace(empty, height=np.mean(late, axis=0), view="mean"),
        steady_from=steady_from,
        mixing=Series(times, np.array(course.mixing), "lacey_index", "1"),
        mixed=mixing(*_marked(grains, course), CELL * particle.typical.diameter),
        centres=beads.position,
        radii=beads.radius,
        count=count,
        turns=turns,
        statistics=statistics,
        history=history,
        assumptions=assumptions,
        warnings=warnings,
    )


def _steady_from(rig: Drum, turns: float) -> float:
    """Time [s] from which the slope counts as steady."""
    return min(STEADY_AFTER, 0.5 * turns) * 2 * math.pi / abs(rig.speed)


def checks(rig: Drum, particle: Particle, rotation: Rotation) -> tuple[Check, ...]:
    """Check a run: fill, size of the bed in bead diameters, and number of turns and samples.

    Parameters
    ----------
    rig, particle : Drum, Particle
        As for `run`.
    rotation : Rotation
        Run that is checked.

    Returns
    -------
    tuple of Check
        ``fill``, ``beads_enough`` and ``turned_enough``.
    """
    share = _share(rotation.count, rig, filled_in(rig)[0], particle)
    high, long = (size / particle.typical.equivalent_diameter for size in _across(share, rig.diameter))
    enough = high >= SHALLOWEST and long >= SHORTEST
    looks = int((rotation.time >= rotation.steady_from).sum())
    longer = rotation.turns >= 2 * STEADY_AFTER and looks >= FEWEST_LOOKS
    return (
        fill_check(share, f"{rotation.count} beads fill"),
        Check(
            "beads_enough",
            enough,
            high,
            SHALLOWEST,
            f"the bed of {rotation.count} beads is {high:.2g} diameters high and its surface {long:.2g} long"
            + (
                "."
                if enough
                else f"; an angle needs {SHALLOWEST:g} and {SHORTEST:g}, below which it is set by single beads; give "
                "more or smaller beads."
            ),
        ),
        Check(
            "turned_enough",
            longer,
            rotation.turns,
            1.0,
            f"the drum turned {rotation.turns:g} times, and the steady bed was sampled {looks} times"
            + ("." if longer else f": give more turns, at least {2 * STEADY_AFTER:g} and {FEWEST_LOOKS} samples."),
        ),
    )


def picture(rig: Drum, rotation: Rotation) -> npt.NDArray[np.uint8]:
    """Draw the bed at the end, seen along the axis without the front wall.

    Parameters
    ----------
    rig : Drum
        As for `run`.
    rotation : Rotation
        Run that has ended.

    Returns
    -------
    ndarray, shape (height, width, 3)
        RGB image.
    """
    from rigtwin.sim.output.picture import draw
    from rigtwin.sim.output.trajectory import triangles

    depth, _ = filled_in(rig)
    reach = np.full(3, rig.diameter + depth)
    shell, _front, back = shapes(rig, depth)
    walls = np.concatenate([triangles(shape, (-reach, reach)) for shape in (shell, back)])
    return draw(rotation.centres, rotation.radii, walls=walls, turn=12.0, tilt=8.0)


# ---------------------------------------------------------------------- the rig


def filled_in(rig: Drum) -> tuple[float, float]:
    """Fill in depth and fill where the rig does not state them.

    Parameters
    ----------
    rig : Drum
        Drum whose depth or fill may be left open.

    Returns
    -------
    depth : float
        Depth of the drum [m].
    share : float
        Share of its volume that is filled, at bulk density [1].

    Raises
    ------
    BadInput
        If the diameter or the depth is not positive, or the share is out of its range.
    """
    depth = DEPTH * rig.diameter if rig.depth is None else rig.depth
    share = FILL if rig.fill is None else rig.fill
    positive(diameter=rig.diameter, depth=depth)
    if not 0 < share < FULLEST:
        raise BadInput(f"fill: {share:g} of the drum must be above 0 and below {FULLEST:g}.")
    return depth, share


def filled(rig: Drum, particle: Particle) -> int:
    """Return the number of particles that fill the drum as its rig states.

    Parameters
    ----------
    rig, particle : Drum, Particle
        As for `run`.

    Returns
    -------
    int
        At least one.

    Raises
    ------
    BadInput
        As `filled_in` raises it.
    """
    depth, part = filled_in(rig)
    return max(1, round(part * PACKING * math.pi / 4 * rig.diameter**2 * depth / particle.mean_volume))


def _share(count: int, rig: Drum, depth: float, particle: Particle) -> float:
    volume = math.pi / 4 * rig.diameter**2 * depth
    return count * particle.mean_volume / PACKING / volume


def _across(share: float, diameter: float) -> tuple[float, float]:
    """Height of a level bed that fills this share of a drum, and the length of its surface [m]."""
    angle = np.linspace(0, 2 * math.pi, 721)  # [rad], subtended by the surface at the axis
    taken = float(np.interp(share, (angle - np.sin(angle)) / (2 * math.pi), angle))
    return diameter / 2 * (1 - math.cos(taken / 2)), diameter * math.sin(taken / 2)


def _scatter(
    bulk: Bulk,
    logbook: Logbook,
    course: _Course,
    rig: Drum,
    depth: float,
    particle: Particle,
    count: int,
    said: str,
    progress: Progress,
) -> None:
    inside, box = room(rig, depth)
    filling.scatter_in_turns(bulk, logbook, course, count, inside, box, particle, progress, said)


def room(rig: Drum, depth: float) -> tuple[filling.Inside, tuple[Array, Array]]:
    """Return the room in the drum.

    Parameters
    ----------
    rig : Drum
        Its diameter is used.
    depth : float
        Depth [m].

    Returns
    -------
    inside : callable
        Test for points in the drum, see `rigtwin.sim.run.filling.Inside`.
    box : tuple of ndarray
        Low and high corner [m] of the box around the drum.
    """
    half, deep = rig.diameter / 2, depth / 2

    def inside(points: Array, clear: float) -> npt.NDArray[np.bool_]:
        free = half - np.hypot(points[:, 0], points[:, 2]) > clear
        return np.asarray(free & (deep - np.abs(points[:, 1]) > clear))

    low = np.array([-half, -deep, -half])
    return inside, (low, -low)


def shapes(rig: Drum, depth: float) -> tuple[Shape, ...]:
    """Return shell and end walls; x and z from the axis, y along it.

    Parameters
    ----------
    rig : Drum
        Its diameter is used.
    depth : float
        Depth [m].

    Returns
    -------
    tuple of Shape
        The shell, then the walls at -y and +y.
    """
    from rigtwin.sim.engine.walls.shapes import Cylinder, Disc

    axis, half, deep = (0.0, 1.0, 0.0), rig.diameter / 2, depth / 2
    return (
        Cylinder((0.0, -deep, 0.0), axis, half, depth),
        Disc((0.0, -deep, 0.0), axis, half),
        Disc((0.0, deep, 0.0), axis, half),
    )


def domain(rig: Drum, depth: float, particle: Particle) -> tuple[list[float], list[float]]:
    """Return the domain of a simulation.

    Parameters
    ----------
    rig : Drum
        Its diameter is used.
    depth : float
        Depth [m].
    particle : Particle
        Its diameter sets the margin.

    Returns
    -------
    tuple of list of float
        Low and high corner [m].
    """
    half, deep = (size / 2 + 2 * particle.diameter for size in (rig.diameter, depth))
    return [-half, -deep, -half], [half, deep, half]


# ---------------------------------------------------------------------- the run


@dataclass(kw_only=True)
class _Course(filling.Course):
    """State of filling and turning; a run resumes from it and from the state of the beads."""

    level: float | None = None  # [m], height that divides the bed at rest into halves
    low_at_first: list[int] = field(default_factory=list)  # the beads of the lower half
    times: list[float] = field(default_factory=list)  # [s], of the samples, since the drum began to turn
    heights: list[list[float]] = field(default_factory=list)  # [m], of the bed's outline
    mixing: list[float] = field(default_factory=list)

    def go_on(self, kept: dict[str, Any]) -> None:
        if "level" not in kept:
            raise BadInput("The checkpoint was written by an earlier rigtwin; delete it or name another.")
        super().go_on(kept)


def _settle(
    bulk: Bulk, logbook: Logbook, course: _Course, rig: Drum, particle: Particle, limit: float, progress: Progress
) -> None:
    """Let the bed come to rest, sample it, then start the drum."""
    from rigtwin.sim.engine.walls.shapes import Motion

    if course.let_go is not None:
        return
    filling.settle_and_let_go(bulk, logbook, course, particle, limit, progress)
    _mark_halves(bulk.grains(), course)
    _look(bulk.beads(), bulk.grains(), bulk.time, course, rig, particle)
    for wall in range(len(bulk.shapes)):
        bulk.move_wall(wall, Motion(spin=rig.speed, axis=(0.0, 1.0, 0.0), start=bulk.time))


def _mark_halves(grains: Grains, course: _Course) -> None:
    """Divide the bed at rest into a lower and an upper half."""
    course.level = float(np.median(grains.position[:, 2]))
    course.low_at_first = grains.ident[grains.position[:, 2] < course.level].tolist()


def _turn(
    bulk: Bulk,
    logbook: Logbook,
    course: _Course,
    rig: Drum,
    particle: Particle,
    turns: float,
    interval: float,
    progress: Progress,
) -> None:
    """Turn the drum and sample the bed at regular intervals."""
    assert course.let_go is not None
    steps = max(1, round(interval / bulk.time_step))
    lasts = turns * 2 * math.pi / abs(rig.speed)
    while bulk.time - course.let_go < lasts:
        logbook.run(steps)
        _look(bulk.beads(), bulk.grains(), bulk.time, course, rig, particle)
        logbook.look(course.kept())
        progress("turning", bulk.time - course.let_go, lasts)


def _look(beads: Beads, grains: Grains, time: float, course: _Course, rig: Drum, particle: Particle) -> None:
    """Record the outline of the bed and its mixing index at `time` [s]."""
    assert course.let_go is not None
    heap = bed(beads.position, beads.radius)
    surface = _outline(beads.position[heap], beads.radius[heap], rig, particle)
    course.times.append(time - course.let_go)
    course.heights.append(surface.height.tolist())
    course.mixing.append(lacey(*_marked(grains, course), CELL * particle.typical.diameter))


def _marked(grains: Grains, course: _Course) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Centres of all beads relative to the initial border of the halves, and which beads were below it.

    With the origin on the border no cell contains beads of both halves at the start, and the index begins at 0.
    """
    assert course.level is not None
    marked = np.isin(grains.ident, course.low_at_first)
    return grains.position - np.array([0.0, 0.0, course.level]), marked


# ---------------------------------------------------------------------- the result


def _outline(centres: Array, radii: Array, rig: Drum, particle: Particle) -> Profile:
    half = rig.diameter / 2
    return outline(centres, radii, (-half, half), grain=2 * particle.smallest_radius, view="front")


def check(rig: Drum, particle: Particle, *, count: int | None) -> None:
    """Refuse settings that `run` would refuse, without simulating.

    Parameters
    ----------
    rig, particle : Drum, Particle
        As for `run`.
    count : int or None
        Number of particles; None: as many as fill the share of the rig.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    """
    depth, _ = filled_in(rig)
    if not (math.isfinite(rig.speed) and rig.speed != 0):
        raise BadInput(f"speed: the drum must turn; got {rig.speed:g} rad/s.")
    if rig.diameter < 4 * particle.diameter:
        raise BadInput(
            f"drum_diameter: a drum of {rig.diameter * 1e3:.3g} mm is too small for beads of "
            f"{particle.diameter * 1e3:.3g} mm; give at least four bead diameters."
        )
    filling.need_gap("depth", depth, particle)
    if count is None:
        return
    if count < 1:
        raise BadInput(f"count: {count} beads make no bed; give at least 1.")
    if (share := _share(count, rig, depth, particle)) > FULLEST:
        room = int(count * FULLEST / share)
        more = f"give at most {room}" if room else "give a longer drum"
        raise BadInput(f"count: {count} beads fill {share:.0%} of the drum, more than {FULLEST:.0%}; {more}.")


def _warnings(course: _Course) -> tuple[str, ...]:
    warnings = []
    if not course.in_time:
        warnings.append("the bed was still moving when the drum began to turn; raise --fill-limit")
    if not np.isfinite(course.mixing[-1]):
        warnings.append("no two cells hold enough beads for a mixing index; give more beads")
    return tuple(warnings)
