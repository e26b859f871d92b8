"""The rigs of the drawn labs: which conditions are run, what the experimenter writes down, how the beads then move.

`lab.json` holds nominal numbers and their uncertainties; what is really so (a plate a little off level, a height a
little wrong, a length error) goes into the motion alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rigtwin.benchmarks.diagnose.lab_effects import HEAVY, LIGHT, MIDDLE
from rigtwin.benchmarks.diagnose.lab_motion import Bead, Path, Plate, World, double, drop, pendulum, roll, slide

BEADS = {
    bead.name: bead
    for bead in (
        Bead("EPS12", 0.012, 28, "expanded polystyrene", 5e6, 0.1),
        Bead("BL10", 0.010, 120, "balsa", 3e9, 0.3),
        Bead("D4", 0.0042, 570, "wood", 11e9, 0.44),
        Bead("D6", 0.0062, 568, "wood", 11e9, 0.44),
        Bead("D12", 0.0122, 726, "wood", 11e9, 0.44),
        Bead("ABS6", 0.006, 1768, "ABS", 2.25e9, 0.35),
        Bead("ABS10", 0.010, 1060, "ABS", 2.25e9, 0.35),
        Bead("GL6", 0.006, 2500, "glass", 65e9, 0.22),
        Bead("ST5", 0.005, 7648, "steel", 210e9, 0.3),
    )
}
WALLS = {  # density, modulus, Poisson ratio, thickness, sliding friction
    "glass": (2600, 70e9, 0.22, 0.010, 0.36),
    "PMMA": (1250, 3e9, 0.40, 0.010, 0.45),
    "aluminium": (2700, 69e9, 0.33, 0.005, 0.25),
    "steel": (7850, 210e9, 0.30, 0.006, 0.38),
}
RESTITUTION = {"expanded polystyrene": 0.75, "balsa": 0.5, "wood": 0.48, "ABS": 0.7, "glass": 0.8, "steel": 0.45}
BETWEEN_PLATES = 0.01  # standard deviation between the restitutions of a bead on two plates of one material
ROLLING = {
    "expanded polystyrene": 0.02, "balsa": 0.05, "wood": 0.05, "ABS": 0.02, "glass": 0.008, "steel": 0.005
}  # fmt: skip

DIAMETER_UNCERTAINTY, HEIGHT_UNCERTAINTY, LENGTH_UNCERTAINTY = 2e-5, 5e-4, 5e-4  # [m]
LEVEL_UNCERTAINTY, ANGLE_UNCERTAINTY = 0.1, 0.3  # [deg]


@dataclass(frozen=True)
class Run:
    """One condition: what is written down of it, and how one repetition moves."""

    stated: dict[str, Any]
    repetitions: int
    move: Callable[[np.random.Generator], Path]
    bead: Bead  # nominal
    again: Callable[[Bead, Change], Run]
    """The same with a further bead, or with its own, and with a change."""


@dataclass(frozen=True)
class Change:
    """What a further experiment does differently: of the rig's own settings in SI, by the name of each."""

    release: float | None = None  # height [m] or angle [rad]
    state: Mapping[str, float] = field(default_factory=dict)
    longer: float = 1.0
    thickness: float = 1.0  # times that of the plate


SAME = Change()


@dataclass(frozen=True)
class Bench:
    """One rig, set up."""

    rig: str
    beads: tuple[Bead, ...]  # nominal
    walls: tuple[str, ...]
    runs: tuple[Run, ...]
    coordinates: str
    geometry: dict[str, Any]
    frame_rate: float  # [Hz]
    scale: float  # [m/px]


def set_up(
    rig: str, world: World, rng: np.random.Generator, *, wanted: Sequence[str] = (), wall: bool = False
) -> Bench:
    """A rig with beads of the `wanted` names if there are any; `wall` for a pendulum that strikes one."""
    build = {"drop": _drop, "pendulum": _pendulum, "double": _double, "slide": _slide, "roll": _roll}[rig]
    level = float(np.clip(rng.normal(0, 0.05), -LEVEL_UNCERTAINTY, LEVEL_UNCERTAINTY))
    world.level = math.radians(level)
    world.restitution_scatter = float(rng.uniform(0.006, 0.02))
    world.kick_scatter = float(rng.uniform(0.006, 0.015))
    world.friction_scatter = float(rng.uniform(0.005, 0.03))
    if rig == "pendulum":
        return _pendulum(world, rng, wanted, wall=wall)
    return build(world, rng, wanted)


def _pick(rng: np.random.Generator, wanted: Sequence[str], count: int) -> tuple[Bead, ...]:
    """Wanted beads first, then a control of another weight."""
    first = list(rng.permutation(list(wanted))[:1]) if wanted else []
    pool = [name for name in (*MIDDLE, *HEAVY, "D12", *LIGHT) if name not in wanted and name not in first]
    if wanted and set(wanted) <= set(HEAVY):
        pool = [name for name in (*HEAVY, "D12") if name not in first]  # a light bead would make the effect large
    elif wanted and set(wanted) <= {*MIDDLE, "BL10"}:
        pool = [name for name in (*MIDDLE, *HEAVY, "D12") if name not in first]
    elif not wanted:
        pool = [*MIDDLE, *HEAVY, "D12"]
    names = first + list(rng.permutation(pool))[: count - len(first)]
    return tuple(BEADS[str(name)] for name in names)


def plate(wall: str) -> Plate:
    """A wall by its name; "glass x0.5" is half as thick."""
    name, _, times = wall.partition(" x")
    density, modulus, poisson, thickness, _friction = WALLS[name]
    return Plate(density, modulus, poisson, thickness * float(times or 1))


def _real(bead: Bead, rng: np.random.Generator) -> Bead:
    """The bead as it is: its diameter a little off, its mass as weighed."""
    diameter = bead.diameter + float(
        np.clip(rng.normal(0, DIAMETER_UNCERTAINTY / 2), -DIAMETER_UNCERTAINTY, DIAMETER_UNCERTAINTY)
    )
    return replace(bead, diameter=diameter, density=bead.density * (bead.diameter / diameter) ** 3)


def _draw_restitution(bead: Bead, rng: np.random.Generator) -> float:
    return float(np.clip(RESTITUTION[bead.material] + rng.normal(0, 0.04), 0.3, 0.92))


def _meet(world: World, bead: Bead, partner: str, rng: np.random.Generator) -> None:
    """See to it that a bead has a restitution with a wall or another bead; one that it has stays."""
    if f"{bead.name}/{partner}" not in world.restitution:
        world.restitution[f"{bead.name}/{partner}"] = _draw_restitution(bead, rng)


def _off(rng: np.random.Generator, uncertainty: float) -> float:
    """An error inside what is stated."""
    return float(np.clip(rng.normal(0, uncertainty / 2), -uncertainty, uncertainty))


def _drop(world: World, rng: np.random.Generator, wanted: Sequence[str]) -> Bench:
    two_beads = bool(wanted) or rng.random() < 0.6
    beads = _pick(rng, wanted, 2 if two_beads else 1)
    walls = tuple(str(w) for w in rng.permutation(list(WALLS))[: 1 if two_beads else 2])
    heights = (0.05, 0.2, 0.5, 1.0) if two_beads else (0.05, 0.15, 0.35, 0.65, 1.0)

    def condition(bead: Bead, real: Bead, wall: str, height: float, shift: float) -> Run:
        def move(r: np.random.Generator) -> Path:
            return drop(real, wall, plate(wall), height + shift + r.normal(0, 2e-4), world, r)

        def again(other: Bead, change: Change) -> Run:
            _meet(world, other, wall, rng)
            there = height if change.release is None else change.release
            body = real if other == bead else _real(other, rng)
            struck = wall
            if change.thickness != 1:
                struck = f"{wall} x{change.thickness:g}"
                world.sliding[struck] = world.sliding[wall]
                # another piece of the same material: as lively, to what surfaces differ
                alike = world.restitution[f"{other.name}/{wall}"] + float(rng.normal(0, BETWEEN_PLATES))
                world.restitution[f"{other.name}/{struck}"] = min(alike, 0.95)
            return condition(other, body, struck, there, _off(rng, HEIGHT_UNCERTAINTY))

        stated = {
            "name": f"{bead.name}_{wall}_h{round(height * 1000):04d}", "bead": bead.name, "wall": wall,
            "drop_height_m": height,
        }  # fmt: skip
        return Run(stated, 5, move, bead, again)

    runs = []
    for bead in beads:
        real = _real(bead, rng)
        for wall in walls:
            world.restitution[f"{bead.name}/{wall}"] = _draw_restitution(bead, rng)
            world.sliding[wall] = WALLS[wall][4]
            runs += [condition(bead, real, wall, height, _off(rng, HEIGHT_UNCERTAINTY)) for height in heights]
    geometry = {
        "drop_height": "bottom of the bead to the plate",
        "drop_height_uncertainty_m": HEIGHT_UNCERTAINTY,
        "plate_level_uncertainty_deg": LEVEL_UNCERTAINTY,
        "release": "vacuum holder; release happens 0.01-0.05 s after the first frame; sideways speed at release below "
        "about 0.01 m/s",
        "sliding_friction_pw": {wall: WALLS[wall][4] for wall in walls},
        "tracks": "recorded until part of the flight after the fourth bounce or until rest; lost frames are simply "
        "absent",
    }
    text = "x right, y up, origin on the plate surface below the holder"
    return Bench("drop", beads, walls, tuple(runs), text, geometry, 240.0, 5e-4)


def _pendulum(world: World, rng: np.random.Generator, wanted: Sequence[str], *, wall: bool = False) -> Bench:
    beads = _pick(rng, wanted, 1 if wall else 2)
    walls = tuple(str(w) for w in rng.permutation(list(WALLS))[: 1 if wall else 0])
    struck = walls[0] if wall else None
    angles = (15, 30, 50) if wall else (12, 28, 50)
    lengths = (0.25, 0.40)
    off = {length: _off(rng, LENGTH_UNCERTAINTY) + world.hidden.get("length_error", 0.0) for length in lengths}

    def condition(bead: Bead, real: Bead, length: float, angle: float, tip: float, seconds: float) -> Run:
        def move(r: np.random.Generator) -> Path:
            start = math.radians(angle + tip + r.normal(0, 0.05))
            return pendulum(real, length + off[length], start, seconds, world, r, wall=struck)

        def again(other: Bead, change: Change) -> Run:
            thread = change.state.get("length", length)
            off.setdefault(thread, _off(rng, LENGTH_UNCERTAINTY) + world.hidden.get("length_error", 0.0))
            there = angle if change.release is None else round(math.degrees(change.release))
            if struck:
                _meet(world, other, struck, rng)
            body = real if other == bead else _real(other, rng)
            return condition(other, body, thread, there, _off(rng, ANGLE_UNCERTAINTY), change.longer * seconds)

        stated: dict[str, Any] = {
            "name": f"{bead.name}_{struck + '_' if struck else ''}L{round(length * 1000)}_a{angle}_{seconds:.0f}s",
            "bead": bead.name,
            **({"wall": struck} if struck else {}),
            "length_m": length,
            "release_angle_deg": angle,
        }
        return Run(stated, 4 if wall else 3, move, bead, again)

    runs = []
    for bead in beads:
        real = _real(bead, rng)
        for name in walls:
            world.restitution[f"{bead.name}/{name}"] = _draw_restitution(bead, rng)
        for length in lengths:
            for angle in angles:
                runs.append(condition(bead, real, length, angle, _off(rng, ANGLE_UNCERTAINTY), 3.0 if wall else 6.0))
    geometry: dict[str, Any] = {
        "length": "pivot to bob centre, set on the bench before hanging the bob",
        "length_uncertainty_m": LENGTH_UNCERTAINTY,
        "release": "from rest, 0.02-0.08 s after the first frame",
        "release_angle_uncertainty_deg": ANGLE_UNCERTAINTY,
        "suspension": "thread of negligible mass, motion in one plane",
    }
    if wall:
        geometry["wall"] = "upright plate that the hanging bead just touches, on its left; released from the right"
        geometry["plate_level_uncertainty_deg"] = LEVEL_UNCERTAINTY
    return Bench("pendulum", beads, walls, tuple(runs), "x right, y up, origin at the pivot", geometry, 120.0, 4e-4)


def _double(world: World, rng: np.random.Generator, wanted: Sequence[str]) -> Bench:
    beads = _pick(rng, wanted, 2)
    lengths, angles = (0.25, 0.40), (20, 40, 60)
    error = world.hidden.get("length_error", 0.0)
    off = {length: (_off(rng, LENGTH_UNCERTAINTY) + error, _off(rng, LENGTH_UNCERTAINTY) + error) for length in lengths}

    def condition(bead: Bead, real: Bead, length: float, angle: float, tip: float) -> Run:
        def move(r: np.random.Generator) -> Path:
            both = (length + off[length][0], length + off[length][1])
            return double(real, both, math.radians(angle + tip + r.normal(0, 0.05)), 1.6, world, r)

        def again(other: Bead, change: Change) -> Run:
            thread = change.state.get("length", length)
            off.setdefault(thread, (_off(rng, LENGTH_UNCERTAINTY) + error, _off(rng, LENGTH_UNCERTAINTY) + error))
            there = angle if change.release is None else round(math.degrees(change.release))
            _meet(world, other, other.name, rng)
            body = real if other == bead else _real(other, rng)
            return condition(other, body, thread, there, _off(rng, ANGLE_UNCERTAINTY))

        stated = {
            "name": f"{bead.name}_L{round(length * 1000)}_a{angle}", "bead": bead.name, "length_m": length,
            "release_angle_deg": angle,
        }  # fmt: skip
        return Run(stated, 4, move, bead, again)

    runs = []
    for bead in beads:
        real = _real(bead, rng)
        world.restitution[f"{bead.name}/{bead.name}"] = _draw_restitution(bead, rng)
        for length in lengths:
            runs += [condition(bead, real, length, angle, _off(rng, ANGLE_UNCERTAINTY)) for angle in angles]
    geometry = {
        "length": "pivot to bead centre, both threads alike, set on the bench before hanging the beads",
        "length_uncertainty_m": LENGTH_UNCERTAINTY,
        "pivots": "one bead diameter apart; A, on the left, is released to the left; B, on the right, hangs at rest",
        "release": "from rest, 0.02-0.08 s after the first frame",
        "release_angle_uncertainty_deg": ANGLE_UNCERTAINTY,
        "suspension": "threads of negligible mass, motion in one plane",
    }
    text = "x right, y up, origin midway between the two pivots"
    return Bench("double", beads, (), tuple(runs), text, geometry, 240.0, 4e-4)


def _slide(world: World, rng: np.random.Generator, wanted: Sequence[str]) -> Bench:
    beads = _pick(rng, wanted, 2)
    walls = tuple(str(w) for w in rng.permutation(list(WALLS))[:1])
    wall = walls[0]
    stated_friction = WALLS[wall][4]
    friction = stated_friction + float(rng.normal(0, 0.02))
    world.sliding[wall] = friction
    place, stop = 0.25, 0.05
    # filmed from a few degrees before it can slide
    start = math.floor(math.degrees(math.atan(friction)) - 4.0)

    def condition(bead: Bead, real: Bead, rate: float, dwell: float, mass: float) -> Run:
        def move(r: np.random.Generator) -> Path:
            return slide(
                mass, wall, start_angle=math.radians(start), tilt_rate=math.radians(rate), place=place,
                height=real.radius, stop=stop, dwell=dwell, duration=30 / rate, world=world, rng=r,
            )  # fmt: skip

        def again(other: Bead, change: Change) -> Run:
            body = real if other == bead else _real(other, rng)
            turning = math.degrees(change.state.get("rate", math.radians(rate)))
            waits, weighs = change.state.get("waiting", dwell), change.state.get("clump", mass)
            return condition(other, body, turning, waits, weighs)

        stated = {
            "name": f"{bead.name}x4_{wall}_r{round(rate * 10):02d}_w{round(dwell):03d}_m{round(mass * 1e6)}",
            "bead": bead.name, "clump": "four beads glued in a square", "clump_mass_g": round(mass * 1e3, 5),
            "wall": wall, "start_angle_deg": start, "tilt_rate_deg_s": rate, "waiting_time_s": dwell,
            "start_distance_m": place,
        }  # fmt: skip
        return Run(stated, 5, move, bead, again)

    runs = []
    for bead in beads:
        real = _real(bead, rng)
        # a weight on the clump distinguishes a pull of the surface from friction
        for rate, ballast in ((0.5, 0.0), (2.0, 3.0)):
            runs += [condition(bead, real, rate, dwell, 4 * bead.mass * (1 + ballast)) for dwell in (2.0, 20.0, 200.0)]
    geometry = {
        "arm": "tilts at a steady rate from start_angle at the first frame and does not stop; it rises to the right",
        "start_distance": "clump centre to the hinge, along the arm",
        "tilt_rate_uncertainty_rel": 0.002,
        "plate_level_uncertainty_deg": LEVEL_UNCERTAINTY,
        "waiting_time": "the clump lies on the level arm this long before the arm starts",
        "sliding_friction_pw": {wall: stated_friction},
        "friction_uncertainty": 0.04,
        "tracks": "until 0.05 m before the hinge",
    }
    text = "x right along the level, y up, origin on the hinge axis, in the arm's surface"
    return Bench("slide", beads, walls, tuple(runs), text, geometry, 60.0, 5e-4)


def _roll(world: World, rng: np.random.Generator, wanted: Sequence[str]) -> Bench:
    lever = bool(world.hidden.get("lever_arm"))
    beads = tuple(BEADS[n] for n in ("D4", "D6", "D12")) if lever else _pick(rng, wanted, 2)
    walls = tuple(str(w) for w in rng.permutation(list(WALLS))[:1])
    wall = walls[0]
    world.sliding[wall] = WALLS[wall][4]

    def condition(bead: Bead, real: Bead, slope: float, push: float) -> Run:
        tip = math.radians(_off(rng, 0.05))

        def move(r: np.random.Generator) -> Path:
            return roll(real, wall, slope=math.radians(slope) + tip, push=push, distance=0.4, world=world, rng=r)

        def again(other: Bead, change: Change) -> Run:
            if f"{other.name}/{wall}" not in world.rolling:
                world.rolling[f"{other.name}/{wall}"] = ROLLING[other.material] * float(rng.uniform(0.7, 1.3))
            body = real if other == bead else _real(other, rng)
            there = math.degrees(change.state.get("slope", math.radians(slope)))
            return condition(other, body, there, change.state.get("side", 1.0) * change.state.get("push", push))

        kind = f"a{slope:02.0f}" if slope else f"{'v' if push > 0 else 'back'}{round(abs(push) * 1000):04d}"
        stated: dict[str, Any] = {"name": f"{bead.name}_{wall}_{kind}", "bead": bead.name, "wall": wall}
        stated |= {"incline_angle_deg": slope, **({"push_speed_m_s": push} if push else {}), "track_length_m": 0.4}
        return Run(stated, 5, move, bead, again)

    runs = []
    for bead in beads:
        real = _real(bead, rng)
        world.rolling[f"{bead.name}/{wall}"] = ROLLING[bead.material] * float(rng.uniform(0.7, 1.3))
        for slope, push in ((6.0, 0.0), (10.0, 0.0), (15.0, 0.0), (0.0, 0.3), (0.0, 0.7)):
            runs.append(condition(bead, real, slope, push))
    geometry = {
        "incline_angle_uncertainty_deg": 0.05,
        "plate_level_uncertainty_deg": LEVEL_UNCERTAINTY,
        "release": "inclined: from rest; level: pushed, the bead rolls at about push_speed (within 10 %) "
        "when it leaves the pusher; 0.01-0.05 s after the first frame",
        "sliding_friction_pw": {wall: WALLS[wall][4]},
        "rolling_friction_pw": None,
        "rolling_friction_note": "limit torque = rolling_friction * R * normal force; null = not measured",
        "tracks": "until the bead has rolled track_length or stands still",
    }
    text = (
        "x right along the level, y up, origin where the bead touches the surface at the start; it rolls to the right"
    )
    return Bench("roll", beads, walls, tuple(runs), text, geometry, 240.0, 4e-4)
