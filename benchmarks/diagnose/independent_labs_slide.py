"""Independent labs of a clump on an arm that tilts at a steady rate: it rests, slips and slides down.

Place along the arm and its speed, in the axes that turn with the arm (centrifugal and Coriolis terms), found from the
forces along and across it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from rigtwin.benchmarks.diagnose.independent_labs_spheres import DENSE, DIAMETER_UNCERTAINTY, LIGHT, WALLS, spheres
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
    Slip,
)

LEVEL_UNCERTAINTY, RATE_UNCERTAINTY, FRICTION_UNCERTAINTY = 0.1, 0.002, 0.04  # [deg], relative, 1


def move(condition: Condition, off: Mapping[str, float], hidden: Hidden) -> Motion:
    """Rest, slip and slide of one repetition."""
    nominal, shifts = condition.nominal, hidden.shifts
    turning = nominal["rate"] * (1 + off.get("rate", 0.0)) * (1 + shifts.get("rate", 0.0))
    start = nominal["start"] + off.get("level", 0.0) + shifts.get("level", 0.0)
    place = nominal["place"] + off.get("place", 0.0)
    mass, waited, stop = nominal["mass"], nominal["waiting"], nominal["stop"]
    high = condition.sphere.radius + off.get("diameter", 0.0) / 2
    plain = nominal["friction"] + off.get("friction", 0.0) + off.get("static", 0.0)
    kinetic = plain + off.get("kinetic", 0.0) - shifts.get("friction_drop", 0.0)
    kinetic *= 1 - shifts.get("friction_drop_ratio", 0.0)

    def force_per_mass(t: float, s: float, speed: float) -> float:
        return hidden.along(t, s, speed, condition) if hidden.along else 0.0

    def load(angle: float, speed: float) -> float:
        return mass * (GRAVITY * math.cos(angle) - 2 * turning * speed - high * turning**2)

    def rub(mu: float, t: float, s: float, speed: float) -> float:
        """Friction per mass [m/s^2] of a clump that slid to `s` [m] down the arm from its place."""
        pressed = load(start + turning * t, speed)
        if hidden.friction:
            # the age of contacts that slide is that which they had as they slipped
            age = waited + (t if speed == 0.0 else slips)
            mu = hidden.friction(mu, Slip(age, pressed, speed, place - s, t))
        return mu * pressed / mass

    def surplus(t: float) -> float:
        angle = start + turning * t
        return GRAVITY * math.sin(angle) - place * turning**2 + force_per_mass(t, 0.0, 0.0) - rub(plain, t, 0.0, 0.0)

    look = 2e-3 if hidden.along else 2e-2  # [s]
    grid = np.arange(0.0, math.radians(45) / turning, look)
    slips = next((float(t) for t in grid if surplus(float(t)) > 0), None)
    if not slips:
        raise ValueError("the clump must lie still at first and slip later")
    slips = float(brentq(surplus, slips - look, slips, xtol=1e-12))
    begin = slips

    def sliding(t: float, state: Array) -> tuple[float, float]:
        s, speed = float(state[0]), float(state[1])
        drive = GRAVITY * math.sin(start + turning * t) - (place - s) * turning**2 + force_per_mass(t, s, speed)
        push = drive - rub(kinetic, t, s, max(speed, 1e-12))
        return max(speed, 0.0), push if speed > 0 or push > 0 else 0.0

    def there(_t: float, state: Array) -> float:
        return float(state[0] - (place - stop))

    there.terminal = True  # type: ignore[attr-defined]
    run = solve_ivp(sliding, (begin, begin + 8.0), [0.0, 1e-9], events=there, max_step=0.05, **PRECISE)
    end = float(run.t[-1])

    def at(t: Array, s: Array | float) -> Array:
        turned = ((place - s) + 1j * high) * np.exp(1j * (start + turning * t))
        return np.array([turned.real, turned.imag])

    motion = Motion()
    motion.add(0.0, begin, lambda t: at(t, 0.0))
    motion.add(begin, end, lambda t: at(t, run.sol(t)[0]))
    return motion


def lab(rng: Rng, *, loads: bool = False, waits: bool = False) -> Lab:
    """A lab of two to eight conditions; clumps of several weights with `loads`, several waiting times with `waits`."""
    beads = spheres(rng, 1 if loads or waits else int(rng.integers(1, 3)), (*LIGHT[2:], *DENSE), least=4.0, most=10.0)
    wall = str(rng.choice(list(WALLS)))
    stated_friction = WALLS[wall][1]
    ballast = (0.0, 2.0, 5.0) if loads else (0.0, 3.0)[: int(rng.integers(1, 3))]
    waiting = (2.0, 15.0, 120.0) if waits else (5.0, 60.0)[: int(rng.integers(1, 3))]
    turns = [float(x) for x in rng.choice((0.5, 0.8, 1.0, 1.5, 2.0, 3.0), int(rng.integers(1, 3)), replace=False)]
    settings = [(b, r, w, m) for b in beads for r in turns for w in waiting for m in ballast]
    rng.shuffle(settings)  # type: ignore[arg-type]
    settings = settings[:8] if not (loads or waits) else sorted(settings, key=lambda s: s[1])[:8]
    if len(settings) < 2:
        settings = [(beads[0], r, waiting[0], 0.0) for r in (0.8, 2.0)]
    frictions = {bead.name: stated_friction + float(rng.normal(0, 0.02)) for bead in beads}
    start = math.floor(math.degrees(math.atan(min(frictions.values()))) - 5.0)
    repetitions = int(rng.integers(3, 7))
    conditions = []
    for bead, rate, wait, more in sorted(settings, key=lambda s: (s[0].name, *s[1:])):
        mass = 4 * bead.mass * (1 + more)
        stated = {
            "name": f"{bead.name}x4_{wall}_r{rate * 10:02.0f}_w{wait:03.0f}_m{mass * 1e6:.0f}", "bead": bead.name,
            "clump": "four beads glued in a square", "clump_mass_g": round(mass * 1e3, 5), "wall": wall,
            "start_angle_deg": start, "tilt_rate_deg_s": rate, "waiting_time_s": wait, "start_distance_m": 0.25,
        }  # fmt: skip
        nominal = {
            "start": math.radians(start), "rate": math.radians(rate), "waiting": wait, "mass": mass, "place": 0.25,
            "stop": 0.05, "friction": frictions[bead.name],
        }  # fmt: skip
        conditions.append(Condition(stated, bead, repetitions, nominal, {"bead": bead.name, "pair": bead.name}))
    rate = float(rng.choice([60, 100, 120, 200]))
    if sum(6.5 / math.degrees(c.nominal["rate"]) * repetitions for c in conditions) * rate > 25_000:
        rate = 60.0
    geometry = {
        "arm": "tilts at a steady rate from start_angle at the first frame and does not stop; it rises to the right",
        "start_distance": "clump centre to the hinge, along the arm",
        "tilt_rate_uncertainty_rel": RATE_UNCERTAINTY,
        "plate_level_uncertainty_deg": LEVEL_UNCERTAINTY,
        "waiting_time": "the clump lies on the level arm this long before the arm starts",
        "sliding_friction_pw": {wall: stated_friction},
        "friction_uncertainty": FRICTION_UNCERTAINTY,
        "tracks": "until 0.05 m before the hinge",
    }
    return Lab(
        "slide", beads, tuple(conditions), CHANCES, move, rate, float(np.round(0.4 / rng.uniform(600, 1400), 6)),
        float(np.round(rng.uniform(0.2, 0.4), 2)), geometry,
        "x right along the level, y up, origin on the hinge axis, in the arm's surface", {wall: WALLS[wall][0]},
    )  # fmt: skip


CHANCES = (
    Chance("static", "run", 0.01),
    Chance("kinetic", "run", 0.003),
    Chance("place", "run", 5e-4, 2e-3),
    Chance("friction", "pair", 0.0, FREE),
    Chance("diameter", "bead", 0.5 * DIAMETER_UNCERTAINTY, DIAMETER_UNCERTAINTY, 1e-6),
    Chance("level", "lab", math.radians(0.5 * LEVEL_UNCERTAINTY), math.radians(LEVEL_UNCERTAINTY)),
    Chance("rate", "lab", 0.5 * RATE_UNCERTAINTY, RATE_UNCERTAINTY),
)
