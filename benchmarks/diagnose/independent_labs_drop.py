"""Independent labs of drops: a bead falls on a plate and rebounds a few times.

The state is place and velocity in the camera's axes; an impact turns the velocity into the plate's axes, restores the
normal part and lets friction and spin change the other up to rolling.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp

from rigtwin.benchmarks.diagnose.independent_labs_spheres import (
    DENSE,
    DIAMETER_UNCERTAINTY,
    MATERIALS,
    WALLS,
    distinct,
    spheres,
)
from rigtwin.benchmarks.diagnose.independent_labs_types import (
    FREE,
    GRAVITY,
    PRECISE,
    Array,
    Chance,
    Condition,
    Hidden,
    Lab,
    Motion,
    Rng,
    Sphere,
    still,
)

RESTS = 0.012  # [m/s], rebounds slower than this are not followed
HEIGHT_UNCERTAINTY, LEVEL_UNCERTAINTY = 5e-4, 0.1  # [m], [deg]
MOST_IMPACTS = 4


def move(condition: Condition, off: Mapping[str, float], hidden: Hidden) -> Motion:
    """Release, flights and impacts of one repetition."""
    sphere, nominal, shifts = condition.sphere, condition.nominal, hidden.shifts
    level = off.get("level", 0.0) + shifts.get("level", 0.0)
    normal = complex(-math.sin(level), math.cos(level))
    radius = sphere.radius + off.get("diameter", 0.0) / 2
    start = (off.get("x", 0.0), nominal["height"] + off.get("height", 0.0) + off.get("placing", 0.0) + radius)
    begin = nominal["begin"] + off.get("begin", 0.0)
    motion = Motion()
    motion.add(0.0, begin, still(*start))
    speed_down = shifts.get("release_speed", 0.0)
    state = np.array([*start, off.get("vx", 0.0), -speed_down])
    spin = shifts.get("spin", 0.0)
    inertia = sphere.mass + (hidden.added_mass(sphere) if hidden.added_mass else 0.0)

    def pull(t: float, s: Array) -> tuple[float, float, float, float]:
        fx, fy = 0.0, -sphere.mass * GRAVITY
        if hidden.force:
            more = hidden.force(t, s, sphere)
            fx, fy = more[0], fy + more[1]
        return s[2], s[3], fx / inertia, fy / inertia

    def gap(_t: float, s: Array) -> float:
        return float(s[0] * normal.real + s[1] * normal.imag - radius)

    gap.terminal, gap.direction = True, -1  # type: ignore[attr-defined]
    impacts = int(nominal["impacts"])
    for k in range(impacts + 1):
        flight = solve_ivp(pull, (begin, begin + 6.0), state, events=gap, **PRECISE)
        land = float(flight.t[-1])
        end = land if k < impacts else begin + nominal["cut"] * (land - begin)
        motion.add(begin, end, lambda t, s=flight.sol: s(t)[:2])
        if k == impacts:
            break
        state, begin = flight.y[:, -1].copy(), land
        speed = complex(state[2], state[3]) / normal * 1j  # real part along the plate, imaginary part away from it
        e = nominal["restitution"] + off.get("restitution", 0.0)
        e = hidden.bounce(e, -speed.imag, sphere) if hidden.bounce else e
        e = min(max(e + off.get(f"e{k}", 0.0), 0.0), 0.99)
        away = -e * speed.imag
        slip = speed.real - spin * radius
        grip = math.copysign(min(abs(slip) * 2 / 7, nominal["sliding"] * (away - speed.imag)), -slip)
        spin -= 2.5 * grip / radius
        turn = complex(math.cos(off.get(f"turn{k}", 0.0)), math.sin(off.get(f"turn{k}", 0.0)))
        leaving = complex(speed.real + grip, away) * turn * normal / 1j
        if away < RESTS:
            motion.add(begin, begin + 0.05, still(float(state[0]), float(state[1])))
            break
        # a hair off the plate: the next flight must not end where it starts
        lifted = complex(state[0], state[1]) + 1e-9 * normal
        state = np.array([lifted.real, lifted.imag, leaving.real, leaving.imag])
    return motion


def lab(rng: Rng, *, materials: tuple[str, ...] = (), control: bool = True, wet: float = 0.0) -> Lab:
    """A lab of two to eight conditions; beads of these materials first, and a dense control beside them.

    `wet`: density [kg/m^3] of a liquid in which the beads sink, that the experimenter does not write down.
    """
    if wet:
        beads = spheres(rng, 2, materials, least=3.0, most=8.0)
    else:
        beads = spheres(rng, 1, materials or tuple(MATERIALS))
        if control or rng.random() < 0.5:
            beads += spheres(rng, 1, DENSE if materials else tuple(MATERIALS))
    walls = [str(w) for w in rng.permutation(list(WALLS))[: 1 if len(beads) > 1 else int(rng.integers(1, 3))]]
    pairs = [(bead, wall) for bead in distinct(beads) for wall in walls]
    heights = sorted(
        rng.choice((40, 60, 80, 120) if wet else (60, 100, 150, 250, 400, 600, 900), _levels(rng, pairs), replace=False)
    )
    rate, impacts = _filmed(rng, len(pairs) * len(heights), float(heights[-1]) * 1e-3, wet > 0)
    repetitions = int(rng.integers(3, 7))
    scatter, kick = float(rng.uniform(0.006, 0.02)), float(rng.uniform(0.006, 0.015))
    conditions = []
    for bead, wall in pairs:
        restitution = float(np.clip(bead.restitution + rng.normal(0, 0.04), 0.3, 0.9))
        for height in heights:
            stated = {
                "name": f"{bead.name}_{wall}_h{height:04d}", "bead": bead.name, "wall": wall,
                "drop_height_m": float(height) * 1e-3,
            }  # fmt: skip
            nominal = {
                "height": float(height) * 1e-3, "restitution": restitution, "sliding": WALLS[wall][1], "begin": 0.01,
                "impacts": impacts, "cut": float(rng.uniform(0.3, 0.9)),
            }  # fmt: skip
            groups = {"bead": bead.name, "pair": f"{bead.name}/{wall}"}
            conditions.append(Condition(stated, bead, repetitions, nominal, groups))
    return Lab(
        "drop", distinct(beads), tuple(conditions), chances(scatter, kick), move, rate,
        float(np.round(float(heights[-1]) * 1e-3 / rng.uniform(900, 2200) + 5e-5, 6)),
        float(np.round(rng.uniform(0.2, 0.4), 2)), _geometry(walls),
        "x right, y up, origin on the plate surface below the holder", {wall: WALLS[wall][0] for wall in walls},
    )  # fmt: skip


def _levels(rng: Rng, pairs: list[tuple[Sphere, str]]) -> int:
    """Heights of fall, so that there are two to eight conditions."""
    return int(rng.integers(2, 5)) if len(pairs) > 1 else int(rng.integers(2, 6))


def _filmed(rng: Rng, conditions: int, highest: float, wet: bool) -> tuple[float, int]:
    """Frame rate [Hz] and number of impacts, so that the tracks of a lab do not get endless."""
    rate = float(rng.choice([120, 200, 240, 300, 480, 500, 960, 1000]))
    impacts = int(rng.integers(2, MOST_IMPACTS + 1))
    if wet:
        return min(rate, 300.0), 2
    return (rate if conditions * highest * rate < 2000 else min(rate, 240.0)), impacts


def chances(scatter: float, kick: float) -> tuple[Chance, ...]:
    """Scatter of restitution and of the direction [rad] of a rebound, and what else differs from run to run."""
    each = [
        one
        for k in range(MOST_IMPACTS)
        for one in (Chance(f"e{k}", "run", scatter, step=1e-4), Chance(f"turn{k}", "run", kick, step=1e-4))
    ]
    return (
        Chance("begin", "run", 0.04, FREE, 1e-5, uniform=True),
        Chance("x", "run", 8e-4, FREE),
        Chance("vx", "run", 4e-3, 6e-3, 1e-4),
        Chance("placing", "run", 1e-4),
        *each,
        Chance("height", "condition", 0.5 * HEIGHT_UNCERTAINTY, HEIGHT_UNCERTAINTY),
        Chance("diameter", "bead", 0.5 * DIAMETER_UNCERTAINTY, DIAMETER_UNCERTAINTY, 1e-6),
        Chance("restitution", "pair", 0.0, FREE, 1e-4),
        Chance("level", "lab", math.radians(0.5 * LEVEL_UNCERTAINTY), math.radians(LEVEL_UNCERTAINTY)),
    )


def _geometry(walls: list[str]) -> dict[str, object]:
    return {
        "drop_height": "bottom of the bead to the plate",
        "drop_height_uncertainty_m": HEIGHT_UNCERTAINTY,
        "plate_level_uncertainty_deg": LEVEL_UNCERTAINTY,
        "release": "holder opens 0.01-0.05 s after the first frame; sideways speed at release below about 0.01 m/s",
        "sliding_friction_pw": {wall: WALLS[wall][1] for wall in walls},
        "tracks": "until part of the flight after the last impact that was filmed, or until rest",
    }
