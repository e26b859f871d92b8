"""Twins of the rigs of one or two bodies: drop, pendulum, tilt."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rigtwin.compare.twin import Twin, settings_of
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.model import NO_EFFECTS, Effects
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Evaluation
from rigtwin.lab.records import Series, Track
from rigtwin.lab.rigs import GRAVITY, Drop, Pendulum, Tilt

IDEAL = "The bead moves in a vacuum and does not spin at the start."


def drop_twin(
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
) -> Twin:
    """A bead dropped on a plate, its record taken at `frame_rate` [1/s] for `duration` [s] or as long as
    `rig.bounces` take; a clump that is not turned by the rig is turned at random, by `seed`."""
    from rigtwin.measure import drop as ruler
    from rigtwin.sim import drop
    from rigtwin.sim.engine.terms import acting_on_few

    if particle.shape is not None:
        return _tumbling_twin(
            rig,
            particle,
            wall,
            contact,
            frame_rate=frame_rate,
            duration=duration,
            seed=seed,
            effects=effects,
            progress=progress,
        )
    begun = time.perf_counter()
    track = drop.run(
        rig, particle, wall, contact, frame_rate=frame_rate, duration=duration, effects=effects, progress=progress
    )
    flight = 2 * contact.restitution * math.sqrt(2 * rig.drop_height / GRAVITY)  # [s], of the first rebound
    rises = 1e3 * contact.restitution**2 * rig.drop_height
    higher = f"a greater drop height or restitution (the first rebound rises {rises:.2g} mm in {flight:.2g} s)"
    with _as_a_twin("drop", _remedies("a higher frame rate", duration, higher)):
        evaluation = ruler.evaluate(track, bead_diameter=particle.diameter, bead_density=None)
    return Twin(
        "drop",
        evaluation,
        settings_of(rig, particle, {f"{particle.name}-{wall.name}": contact}, frame_rate_hz=frame_rate),
        tracks=(track,),
        assumptions=(IDEAL, "The plate is flat, level and does not move."),
        warnings=acting_on_few(effects)[1],
        draw=lambda: _strobe((track,), particle, _ground(track, particle.diameter)),
        seconds=time.perf_counter() - begun,
    )


def _tumbling_twin(
    rig: Drop,
    particle: Particle,
    wall: Material,
    contact: Contact,
    *,
    frame_rate: float,
    duration: float | None,
    seed: int,
    effects: Effects,
    progress: Progress,
) -> Twin:
    """A clump dropped on a plate, seen from the front and from the side."""
    from rigtwin.measure import drop as ruler
    from rigtwin.sim import tumbling
    from rigtwin.sim.engine.terms import acting_among

    begun = time.perf_counter()
    fall = tumbling.run(
        rig,
        particle,
        wall,
        contact,
        frame_rate=frame_rate,
        duration=duration,
        seed=seed,
        effects=effects,
        progress=progress,
    )
    other = "another seed or turn" if rig.turned is None else "another turn"
    with _as_a_twin("drop", f"{other}, a greater drop height or restitution, or a higher frame rate"):
        evaluation = ruler.evaluate(fall.front, side=fall.side)
    turned = f"at random (seed {seed})" if rig.turned is None else f"by {math.degrees(rig.turned):.4g} degrees"
    return Twin(
        "drop",
        evaluation,
        settings_of(rig, particle, {f"{particle.name}-{wall.name}": contact}, frame_rate_hz=frame_rate, seed=seed),
        tracks=(fall.front, fall.side),
        assumptions=(
            IDEAL,
            "The plate is flat, level and does not move.",
            f"The clump falls turned {turned}; where it goes from the plate, and how fast, hangs on that: one fall is "
            f"one of many. Its contact has a restitution of {contact.restitution:g}.",
            "Each of its spheres that touch the plate damps by itself: a face that lands flat rebounds less than the "
            "restitution says.",
        ),
        warnings=acting_among(effects, particle)[1],
        draw=lambda: tumbling.picture(fall, particle, walls=_ground(fall.front, particle.diameter)),
        seconds=time.perf_counter() - begun,
    )


def pendulum_twin(
    rig: Pendulum,
    particle: Particle,
    contact: Contact,
    *,
    frame_rate: float,
    wall: Material | None = None,
    duration: float | None = None,
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> Twin:
    """Bead A swinging against bead B, or against an upright `wall`.

    The record is taken at `frame_rate` [1/s] for `duration` [s] or until the beads have turned.
    """
    from rigtwin.measure import pendulum as ruler
    from rigtwin.sim import pendulum
    from rigtwin.sim.engine.terms import acting_on_few

    begun = time.perf_counter()
    tracks = pendulum.run(
        rig,
        particle,
        contact,
        wall=wall,
        frame_rate=frame_rate,
        duration=duration,
        effects=effects,
        progress=progress,
    )
    # the steeper the release, the faster the beads pass each other: that asks for more frames, not for a greater angle
    shallow = "a greater release angle or length" if rig.release_angle < math.pi / 4 else "a greater length"
    with _as_a_twin("pendulum", _remedies("a higher frame rate", duration, shallow)):
        evaluation = ruler.evaluate(
            tracks, variant=rig.variant, length=rig.length, bead_diameter=particle.diameter, bead_mass=None
        )
    evaluation = _with_rods(evaluation, rig, particle)
    other = particle.name if wall is None else wall.name
    return Twin(
        "pendulum",
        evaluation,
        settings_of(
            rig,
            particle,
            {f"{particle.name}-{other}": contact},
            frame_rate_hz=frame_rate,
        ),
        tracks=tuple(tracks),
        assumptions=(IDEAL, *_hung(rig, particle)),
        warnings=(*_slack(rig), *acting_on_few(effects, pivots=True)[1]),
        draw=lambda: _strobe(tracks, particle, None if wall is None else _upright(particle.diameter)),
        seconds=time.perf_counter() - begun,
    )


def tilt_twin(
    rig: Tilt,
    particle: Particle,
    wall: Material,
    contact: Contact,
    *,
    frame_rate: float,
    duration: float | None = None,
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> Twin:
    """A plate that rises until the body on it slides or rolls, the record taken at `frame_rate` [1/s]."""
    from rigtwin.measure import tilt as ruler
    from rigtwin.sim import tilt

    begun = time.perf_counter()
    angle, track = tilt.run(
        rig, particle, wall, contact, frame_rate=frame_rate, duration=duration, effects=effects, progress=progress
    )
    progress("reading the record", 0, 0)  # it may take longer than the run
    other = "a longer duration" if duration is not None else "a contact with less friction"
    with _as_a_twin("tilt", other):
        evaluation = ruler.evaluate(angle, [track], variant=rig.variant, bead_diameter=particle.diameter)
    return Twin(
        "tilt",
        evaluation,
        settings_of(rig, particle, {f"{particle.name}-{wall.name}": contact}, frame_rate_hz=frame_rate),
        tracks=(track,),
        series=(angle,),
        assumptions=(
            f"The plate rises by {math.degrees(rig.speed):.3g} degrees per second, steadily and without shaking"
            + (f", from {math.degrees(rig.start_angle):.3g} degrees on." if rig.start_angle else "."),
            tilt.body_in_words(rig, particle),
        ),
        warnings=tilt.left_out(rig, particle, effects),
        draw=lambda: _tilted(rig, angle, track, particle),
        seconds=time.perf_counter() - begun,
    )


def _strobe(
    tracks: Sequence[Track], particle: Particle, walls: Array | None, *, turned: float = 0.0
) -> npt.NDArray[np.uint8]:
    """Flashes of the particle, a clump out of its own axes by `turned` [rad], anticlockwise."""
    from rigtwin.sim.picture import strobe

    if particle.shape is None:
        return strobe(tracks, [particle.radius], walls=walls)
    from scipy.spatial.transform import Rotation

    offsets = Rotation.from_rotvec([0.0, -turned, 0.0]).apply(np.array(particle.shape.offsets))
    return strobe(tracks, particle.shape.radii, offsets, walls=walls)


def _ground(track: Track, diameter: float) -> Array:
    """The plate under a fall, as its picture shows it."""
    from rigtwin.sim.picture import slab

    across = track.position[:, 0]
    return slab((across.min() - 3 * diameter, -diameter / 2), (across.max() + 3 * diameter, 0.0))


def _upright(diameter: float) -> Array:
    """The wall that a pendulum meets."""
    from rigtwin.sim.picture import slab

    return slab((0.0, -diameter), (diameter / 2, diameter))


def _tilted(rig: Tilt, angle: Series, track: Track, particle: Particle) -> npt.NDArray[np.uint8]:
    """The body on its way down, and the plate as it stands at the end: in that time it hardly turns."""
    from rigtwin.sim.picture import slab

    end, size = float(angle.value[-1]), particle.diameter
    along = (track.position * np.stack([np.cos(angle.value), np.sin(angle.value)], axis=1)).sum(axis=1)
    left = int(np.argmax(np.abs(along - along[0]) > 0.01 * size))  # 0 where it never does
    left = min(left, len(along) - 2)
    seen = replace(track, time=track.time[left:], position=track.position[left:], sigma=track.sigma[left:])
    return _strobe((seen,), particle, slab((0.0, -size / 2), (rig.plate_length, 0.0), turned=end), turned=end)


def _with_rods(evaluation: Evaluation, rig: Pendulum, particle: Particle) -> Evaluation:
    """The ruler does not know of rods with mass and takes the faster swing for another gravity."""
    if not rig.rod_mass:
        return evaluation
    faster = (particle.mass + rig.rod_mass / 2) / (particle.mass + rig.rod_mass / 3)
    checks, warnings = [], list(evaluation.warnings)
    for check in evaluation.checks:
        if check.check == "gravity" and math.isclose(check.value, faster * check.expected, rel_tol=0.02):
            told = (
                f"gravity from the swing is {check.value:.3f} m/s², {faster:.4g} times its value as such rods make it"
            )
            checks.append(replace(check, passed=True, message=f"{told}."))
            warnings = [words for words in warnings if words != check.message]
        else:
            checks.append(check)
    return replace(evaluation, checks=tuple(checks), warnings=tuple(warnings))


def _hung(rig: Pendulum, particle: Particle) -> tuple[str, ...]:
    """What is taken of hanger and hinge, and of a clump."""
    if rig.hanger == "string":
        hangs = "Strings have no mass and do not stretch"
    else:
        hangs = "Rods have no mass and do not bend"
        if rig.rod_mass:
            ratio = (particle.mass + rig.rod_mass / 3) / (particle.mass + rig.rod_mass / 2)
            hangs = (
                f"Rods are uniform, weigh {1e3 * rig.rod_mass:.3g} g each and do not bend (they swing as threads of "
                f"{1e3 * ratio * rig.length:.4g} mm without mass do)"
            )
    meets = "the beads meet" if rig.variant == "double" else "the bead meets the wall"
    flat = (f"{particle.name} meets the wall flat and does not turn.",) if particle.shape is not None else ()
    return (f"{hangs}, hinges do not rub, {meets} at the lowest point.", *flat)


def _slack(rig: Pendulum) -> tuple[str, ...]:
    """What to say of a bead on a string that is let go from above its hinge."""
    if rig.hanger == "rod" or rig.release_angle <= math.pi / 2 * (1 + 1e-9):  # 90 deg in radians may be rounded up
        return ()
    return (
        f"a bead let go at {math.degrees(rig.release_angle):.4g} deg falls on a slack string; the twin holds for a rod "
        "without mass, so film one, or release at 90 deg or less",
    )


def _remedies(faster: str, duration: float | None, greater: str) -> str:
    """Settings to try; a record that is not cut short by a `duration` is as long as it need be."""
    return ", ".join([faster, *(["a longer duration"] if duration is not None else []), greater])


@contextmanager
def _as_a_twin(rig: str, remedies: str) -> Iterator[None]:
    """The ruler's words on a record that it cannot read, with advice on settings where a film's owner gets another."""
    try:
        yield
    except BadInput as error:
        words = str(error).removeprefix("bead: ").removeprefix("clump: ").removeprefix("the record: ")
        finding = words.rpartition("; ")[0] or words.rstrip(".")
        raise BadInput(f"the twin of the {rig} gives nothing to measure: {finding}; try {remedies}.") from None
