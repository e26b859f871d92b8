"""Simulation of the drop test with a clump: its rebound depends on its orientation, and it leaves with spin.

Its centre is recorded from the front and from the side, so that the rebound is known in three dimensions, as Hlosta
et al. 2020, section 3.2, ask for non-spherical particles.
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
from rigtwin.lab.units import positive
from rigtwin.sim.engine.time_step import FEW_BODIES
from rigtwin.sim.run.trials import FRAMES_AT_REST, TRACK_SIGMA

SHORTEST = 6  # frames of a flight that can be evaluated; the record ends before shorter ones
LOWEST = 0.006  # rise over drop height of a flight that can be evaluated
LASTS = 6e-3  # [s], longest bounce, in which one edge hits after another; or five frames, where these are longer
LOOK = 10e-3  # [s] between two checks for the end of the record; each check evaluates the whole record
PUSHED = 1e-4  # [m/s], smallest change of velocity that counts as a contact; smaller ones are rounding


@dataclass(frozen=True, eq=False)
class Tumble:
    """Record of a falling and bouncing clump."""

    front: Track  # x to the right, y up
    side: Track  # x away from the viewer of `front`, y up
    velocity: Array  # [m/s], shape (k, 3): to the right, away, up
    spin: Array  # [rad/s], shape (k, 3), about the same axes
    turn: Array  # [1], shape (k, 4), quaternion from the clump's own axes, real part first
    lowest: float  # [m], from the centre of mass down to the lowest point as it falls


def numerics(particle: Particle, effects: Effects) -> dict[str, str]:
    """Describe the numerical settings of `run`, and the effects that act.

    Parameters
    ----------
    particle, effects : Particle, Effects
        As for `run`.

    Returns
    -------
    dict of str to str
        Settings in words, by name.
    """
    from rigtwin.sim.engine.contact import Mechanics
    from rigtwin.sim.engine.effect_terms import acting_among, named_in

    return {
        "contact_law": Mechanics.contact,
        "stiffness_factor": "1 (the real Young's moduli)",
        "time_step": f"{100 * FEW_BODIES:g}% of Rayleigh's, at most",
        "rolling_resistance": f"{Mechanics.rolling}, torque limit mu_r Fn R",
        **named_in(acting_among(effects, particle)[0]),
    }


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
    """Simulate the drop of a clump and return its path, velocity, spin and orientation.

    Parameters
    ----------
    rig : Drop
        Drop height [m], number of bounces, and the angle `turned` [rad] about the line of sight (clockwise as seen
        from the front; None: random orientation).
    particle : Particle
        The clump.
    wall : Material
        Material of the plate.
    contact : Contact
        Coefficients of the contact of clump and plate.
    frame_rate : float
        Frames per second [1/s].
    duration : float, optional
        Length of the record [s].  Default: until the clump comes down from the last of `rig.bounces`, or until the
        flights become too short to evaluate; the few frames of each bounce are then left out.
    seed : int
        Seed of the random orientation.
    effects : Effects
        Effects of a model by name, with their parameters.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    Tumble
        Two views of the centre of mass (heights above the plate), velocities, spins and orientations, one row per
        frame.  The clump is at rest for five frames, its lowest point at drop height, and is then released.

    Raises
    ------
    BadInput
        If a setting is not positive, the particle is a sphere, or the fall lasts too few frames.

    Notes
    -----
    Young's moduli are not softened.  The time step is at most 0.1 of Rayleigh's.

    References
    ----------
    Hlosta et al. 2020, section 3.2.
    """
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.effect_terms import acting_among
    from rigtwin.sim.engine.walls.shapes import Plane, Wall

    check(rig, particle, frame_rate=frame_rate, duration=duration)
    turn = _orientation(rig.turned, seed)
    lowest = _lowest(particle, turn)
    interval = 1 / frame_rate
    steps = math.ceil(interval / (FEW_BODIES * particle.rayleigh_time_step))
    reach = 2 * rig.drop_height + 4 * particle.diameter  # longest possible flight; later ones are shorter
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
    longest = math.sqrt(2 * rig.drop_height / GRAVITY) * (1 + 2 * rig.bounces)  # [s], without energy loss
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
    """Refuse settings that `run` would refuse, without simulating.

    Parameters
    ----------
    rig, particle : Drop, Particle
        As for `run`.
    frame_rate : float
        Frames per second [1/s].
    duration : float, optional
        Length of the record [s].

    Raises
    ------
    BadInput
        As `run` raises it.
    """
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
    """Orientation as a quaternion, real part first."""
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
    """First frame, and one past the last frame, of each flight that can be evaluated, up to a bounce that is too long.

    One edge may hit shortly before another: contacts within a few frames count as one bounce.
    """
    pushed = np.abs(np.diff(velocity, axis=0) - interval * np.array([0.0, 0.0, -GRAVITY])).max(axis=1)
    contacts = np.flatnonzero(pushed > PUSHED)  # between a frame and the next
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
    """Whether the last requested flight has ended, or no further one follows."""
    if len(rows) % max(SHORTEST, math.ceil(LOOK / interval)):
        return False
    flights = _flights(np.array(rows)[:, 3:6], interval, rig.drop_height)
    return len(flights) > rig.bounces + 1 or len(rows) - flights[-1][1] > _lasts(interval) + SHORTEST


def _seen(rows: Array, shown: npt.NDArray[np.intp], interval: float, lowest: float) -> Tumble:
    """The record: the frames before the release, and the `shown` frames of the fall."""
    time = interval * np.array([*range(FRAMES_AT_REST), *(FRAMES_AT_REST + shown)])
    shown = np.pad(shown, (FRAMES_AT_REST, 0))
    sigma = np.full(len(shown), TRACK_SIGMA)
    front, side = (
        Track(time, rows[shown][:, [across, 2]], sigma, name)
        for across, name in ((0, "clump"), (1, "clump from the side"))
    )
    return Tumble(front, side, rows[shown, 3:6], rows[shown, 6:9], rows[shown, 9:], lowest)


def picture(tumble: Tumble, particle: Particle, *, walls: Array | None = None, flashes: int = 18) -> Image:
    """Draw a strobe picture of the clump from the front; later flashes are darker.

    Parameters
    ----------
    tumble : Tumble
        Record of the drop.
    particle : Particle
        Particle that was dropped.
    walls : ndarray, shape (n, 3, 3), optional
        Triangles [m] of the walls, x to the right, y away from the viewer and z up.
    flashes : int
        Number of flashes, evenly spaced in time.

    Returns
    -------
    Image
        RGB image.
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
