"""A clump falls on a plate: where it leaves to hangs on how it is turned, and it takes spin along.

Its centre is seen from the front and from the side, so that the rebound is known in all directions, as Hlosta et al.
2020 ask in section 3.2 of particles that are no spheres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY, Drop
from rigtwin.sim.engine.time_step import positive
from rigtwin.sim.run.trials import FRAMES_AT_REST, TRACK_SIGMA

STEP = 0.1  # of Rayleigh's time step
SHORTEST = 6  # frames of a flight that can be read; the record ends before shorter ones
LOWEST = 0.006  # of the drop height, that a body rises in a flight that can be read
LASTS = 6e-3  # [s], that a bounce lasts at most: edge after edge; or five frames, where these are longer
LOOK = 10e-3  # [s], between two looks whether the record is over, each of which goes through all of it
PUSHED = 1e-4  # [m/s], from which on a change of velocity is a contact and no rounding


@dataclass(frozen=True, eq=False)
class Tumble:
    """How a clump fell and bounced off."""

    front: Track  # x to the right, y up
    side: Track  # x away from the viewer of `front`, y up
    velocity: Array  # [m/s], shape (k, 3): to the right, away, up
    spin: Array  # [rad/s], shape (k, 3), about the same axes
    turn: Array  # [1], shape (k, 4), quaternion from the clump's own axes, the real part first
    lowest: float  # [m], from the centre of mass down to the lowest point as it falls


def run(
    rig: Drop,
    particle: Particle,
    wall: Material,
    contact: Contact,
    *,
    frame_rate: float,
    duration: float | None = None,
    seed: int = 1,
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> Tumble:
    """Drop a clump, turned by `rig.turned` about the line of sight, clockwise from the front, or at random by `seed`.

    Heights are those of its centre of mass above the plate; it is let go at rest after five frames, its lowest point
    at drop height.  Without `duration` [s] the record ends as it comes down from the last of `rig.bounces`, or where
    no flight that can be read follows, and leaves out the few frames of a bounce.  The stiffness is the real one.
    """
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.effect_terms import acting_among
    from rigtwin.sim.engine.walls.shapes import Plane, Wall

    check(rig, particle, frame_rate=frame_rate, duration=duration)
    turn = _orientation(rig.turned, seed)
    lowest = _lowest(particle, turn)
    interval = 1 / frame_rate
    steps = math.ceil(interval / (STEP * particle.rayleigh_time_step))
    reach = 2 * rig.drop_height + 4 * particle.diameter  # it flies no further in one bounce, and later ones are shorter
    high = rig.drop_height + 2 * particle.diameter
    bulk = Bulk(
        [particle],
        contact,
        [Wall(Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), wall, contact)],
        low=(-reach, -reach, -particle.diameter),
        high=(reach, reach, high),
        time_step=interval / steps,
        effects=acting_among(effects, particle)[0],
        threads=1,
        skin=1.0,
    )
    bulk.add(np.array([[0.0, 0.0, rig.drop_height + lowest]]), turn=turn[None])
    longest = math.sqrt(2 * rig.drop_height / GRAVITY) * (1 + 2 * rig.bounces)  # [s], were nothing lost
    most = math.ceil((longest if duration is None else duration) * frame_rate)
    rows: list[Array] = []
    while len(rows) < most:
        grains = bulk.grains()
        if not len(grains.position):
            break  # it left the plate
        rows.append(np.concatenate([grains.position[0], grains.velocity[0], grains.spin[0], grains.turn[0]]))
        if duration is None and _over(rows, interval, rig):
            break
        progress("falling", len(rows), most)
        bulk.run(steps)
    shown = np.arange(len(rows))
    if duration is None:
        flights = _flights(np.array(rows)[:, 3:6], interval, rig.drop_height)[: rig.bounces + 1]
        shown = np.concatenate([np.arange(start, end) for start, end in flights])
    return _seen(np.array(rows), shown, interval, lowest)


def check(rig: Drop, particle: Particle, *, frame_rate: float, duration: float | None = None) -> None:
    """Raises `BadInput` where `run` would refuse these settings, and computes nothing."""
    positive(drop_height=rig.drop_height, frame_rate=frame_rate, bounces=rig.bounces)
    if duration is not None:
        positive(duration=duration)
    if particle.shape is None:
        raise BadInput(f"{particle.name} is a sphere; name a clump.")
    falls = math.sqrt(2 * rig.drop_height / GRAVITY)
    if falls * frame_rate < SHORTEST + 1:
        raise BadInput(
            f"frame_rate: the clump falls for {1e3 * falls:.3g} ms, which {frame_rate:g} Hz see in fewer than "
            f"{SHORTEST + 1} frames; give at least {math.ceil((SHORTEST + 1) / falls)} Hz."
        )


def _orientation(turned: float | None, seed: int) -> Array:
    """As a quaternion, the real part first."""
    if turned is not None:
        return np.array([math.cos(turned / 2), 0.0, math.sin(turned / 2), 0.0])
    turn: Array = np.random.default_rng(seed).normal(size=4)
    return turn / np.linalg.norm(turn)


def _lowest(particle: Particle, turn: Array) -> float:
    from scipy.spatial.transform import Rotation

    assert particle.shape is not None
    heights = Rotation.from_quat(np.roll(turn, -1)).apply(np.array(particle.shape.offsets))[:, 2]
    return float(np.max(np.array(particle.shape.radii) - heights))


def _flights(velocity: Array, interval: float, drop_height: float) -> list[tuple[int, int]]:
    """First frame and the one behind the last of the flights that can be read, up to a bounce that lasts too long.

    An edge may hit a moment before another does: what happens within a few frames is one bounce.
    """
    pushed = np.abs(np.diff(velocity, axis=0) - interval * np.array([0.0, 0.0, -GRAVITY])).max(axis=1)
    contacts = np.flatnonzero(pushed > PUSHED)  # between this frame and the next
    found: list[tuple[int, int]] = []
    for start, end in pairwise([0, *(contacts + 1).tolist(), len(velocity)]):
        rise = max(velocity[start, 2], 0.0) ** 2 / (2 * GRAVITY)
        if end - start < SHORTEST or (start and rise < LOWEST * drop_height):
            continue
        if found and start - found[-1][1] > _lasts(interval):
            break
        found.append((int(start), int(end)))
    return found


def _lasts(interval: float) -> int:
    """Frames of the longest bounce."""
    return max(5, math.ceil(LASTS / interval))


def _over(rows: list[Array], interval: float, rig: Drop) -> bool:
    """Whether the last wanted flight has ended, or no further one follows."""
    if len(rows) % max(SHORTEST, math.ceil(LOOK / interval)):
        return False
    flights = _flights(np.array(rows)[:, 3:6], interval, rig.drop_height)
    return len(flights) > rig.bounces + 1 or len(rows) - flights[-1][1] > _lasts(interval) + SHORTEST


def _seen(rows: Array, shown: npt.NDArray[np.intp], interval: float, lowest: float) -> Tumble:
    """What a camera sees: the frames before it is let go, and those that are `shown` of the fall."""
    time = interval * np.array([*range(FRAMES_AT_REST), *(FRAMES_AT_REST + shown)])
    shown = np.pad(shown, (FRAMES_AT_REST, 0))
    sigma = np.full(len(shown), TRACK_SIGMA)
    front, side = (
        Track(time, rows[shown][:, [across, 2]], sigma, name)
        for across, name in ((0, "clump"), (1, "clump from the side"))
    )
    return Tumble(front, side, rows[shown, 3:6], rows[shown, 6:9], rows[shown, 9:], lowest)


def picture(tumble: Tumble, particle: Particle, *, walls: Array | None = None, flashes: int = 18) -> Image:
    """The clump on its way from the front, as an open shutter sees it by flashes, later ones darker.

    `walls` are triangles [m], shape (n, 3, 3), x to the right, y away and z up.
    """
    from scipy.spatial.transform import Rotation

    from rigtwin.sim.output.picture import BEAD_COLOUR, draw

    assert particle.shape is not None
    time = tumble.front.time
    at = np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], flashes)))
    turns = Rotation.from_quat(np.roll(tumble.turn[at], -1, axis=1))
    places = np.stack([*tumble.front.position[at].T, tumble.side.position[at, 0]])[[0, 2, 1]].T
    spheres = np.array([turns.apply(offset) + places for offset in particle.shape.offsets])  # by sphere and flash
    shades = 1.0 - 0.5 * (time[at] - time[0]) / np.ptp(time)
    tint = np.tile(shades[:, None] * np.array(BEAD_COLOUR), (len(spheres), 1))
    radii = np.repeat(particle.shape.radii, len(at))
    return draw(spheres.reshape(-1, 3), radii, walls=walls, turn=0.0, tilt=0.0, colours=tint)
