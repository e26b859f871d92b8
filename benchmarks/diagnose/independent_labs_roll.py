"""Independent labs of a bead that rolls down an incline from rest, or over a level track after a push.

Work along the track: of the pull, of the rolling resistance at the contact and of what is hidden, taken up by the
motion of the centre and by the spin.  A bead that was pushed without spin slides first, until friction has it rolling.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from rigtwin.benchmarks.diagnose.independent_labs_spheres import (
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
    Rolling,
    Sphere,
    still,
)

LEVEL_UNCERTAINTY, ANGLE_UNCERTAINTY = 0.1, 0.05  # [deg]
SPIN = 0.4  # moment of inertia over m R^2
LONGEST = 4.0  # [s], of a run


def move(condition: Condition, off: Mapping[str, float], hidden: Hidden) -> Motion:
    """Release or push, and the ride of one repetition."""
    sphere, nominal, shifts = condition.sphere, condition.nominal, hidden.shifts
    way = nominal["way"]  # 1 to the right, -1 to the left
    own = shifts.get("wedge", 0.0) * (-1.0 if nominal["turned"] else 1.0)  # slope of the surface on its plate
    slope = way * (nominal["slope"] + off.get("tip", 0.0) + off.get("level", 0.0) + shifts.get("level", 0.0) + own)
    radius = sphere.radius + off.get("diameter", 0.0) / 2
    plain = nominal["rolling"] * (1 + off.get("rolling", 0.0)) + off.get("rolling_mean", 0.0)
    begin = nominal["begin"] + off.get("begin", 0.0)
    origin, length = off.get("place", 0.0), nominal["length"]
    push = nominal["push"] * (1 + off.get("push", 0.0))
    load = sphere.mass * GRAVITY * math.cos(slope)

    def pulls(t: float, place: float, speed: float) -> float:
        """Force per mass [m/s^2] along the track, without the resistance."""
        more = hidden.along(t, place, speed, condition) if hidden.along else 0.0
        return GRAVITY * math.sin(slope) + more

    def resists(place: float, speed: float) -> float:
        mu = plain
        if hidden.rolling:
            mu = hidden.rolling(plain, Rolling(speed, load, place, sphere, bool(nominal["turned"]), way))
        return mu * load / sphere.mass

    def rolling(t: float, s: Array) -> tuple[float, float]:
        place, speed = float(s[0]), float(s[1])
        return speed, (pulls(t, place, speed) - resists(place, max(speed, 0.0))) / (1 + SPIN)

    def sliding(t: float, s: Array) -> tuple[float, float, float]:
        rub = nominal["sliding"] * load / sphere.mass
        return float(s[1]), pulls(t, float(s[0]), float(s[1])) - rub, rub / SPIN  # the last: speed of the rim

    def stops(_t: float, s: Array) -> float:
        return float(s[1])

    def arrives(_t: float, s: Array) -> float:
        return float(s[0] - length)

    def grips(_t: float, s: Array) -> float:
        return float(s[1] - s[2])

    stops.terminal, stops.direction = True, -1  # type: ignore[attr-defined]
    arrives.terminal = grips.terminal = True  # type: ignore[attr-defined]

    def at(place: Array | float) -> Array:
        centre = (np.asarray(place) + origin + 1j * radius) * np.exp(-1j * slope)
        return np.array([way * centre.real, centre.imag])

    motion = Motion()
    start = at(0.0)
    motion.add(0.0, begin, still(float(start[0]), float(start[1])))
    state = np.array([0.0, max(push, 1e-9)])
    if push and (slip := shifts.get("slip", 0.0)):
        run = solve_ivp(
            sliding, (begin, begin + 1.0), [0.0, push, (1 - min(slip, 1.0)) * push], events=grips, **PRECISE
        )
        motion.add(begin, float(run.t[-1]), lambda t, s=run.sol: at(s(t)[0]))
        state, begin = run.y[:2, -1], float(run.t[-1])
    run = solve_ivp(rolling, (begin, begin + LONGEST), state, events=(stops, arrives), max_step=0.1, **PRECISE)
    end = float(run.t[-1])
    motion.add(begin, end, lambda t: at(run.sol(t)[0]))
    if len(run.t_events[0]):
        rest = at(float(run.y[0, -1]))
        motion.add(end, end + 0.1, still(float(rest[0]), float(rest[1])))
    return motion


def lab(
    rng: Rng, *, materials: tuple[str, ...] = (), control: bool = False, turned: bool = False, both_ways: bool = False,
    sizes: bool = False, pushed: bool = False,
) -> Lab:  # fmt: skip
    """A lab of two to eight conditions.

    With `turned` the surface lies end for end in half of them, with `both_ways` some beads are pushed back, with
    `sizes` three beads of one material and different diameters roll, with `pushed` they are pushed on the level.
    """
    if sizes:
        beads = _three_sizes(rng)
    else:
        beads = spheres(rng, 1, materials or tuple(MATERIALS)[2:], least=4.0)
        if control or rng.random() < 0.4:
            beads += spheres(rng, 1, tuple(MATERIALS)[3:], least=4.0)
        beads = distinct(beads)
    wall, length = str(rng.choice(list(WALLS))), round(float(rng.uniform(0.3, 0.7)), 2)
    most = 8 // len(beads) // (2 if turned else 1)
    inclines = [(float(a), 0.0) for a in sorted(rng.choice((3, 4, 6, 8, 11, 14), 3, replace=False))]
    pushes = [(0.0, float(v)) for v in sorted(rng.choice((0.25, 0.4, 0.6, 0.8), 2, replace=False))]
    settings = [*inclines[: int(rng.integers(1, 4))], *pushes[: int(rng.integers(0, 3))]][:most]
    if pushed:
        settings = [*inclines[:1], *pushes]
    if both_ways:
        settings = [*inclines[:1], pushes[0], (0.0, -pushes[0][1])][-most:]
    if len(settings) * len(beads) * (2 if turned else 1) < 2:
        settings.append(pushes[0])
    rate = float(rng.choice([120, 200, 240, 300, 480]))
    repetitions = int(rng.integers(3, 7))
    conditions = []
    for bead in beads:
        rolling = MATERIALS[bead.material][6] * float(rng.uniform(0.7, 1.3))
        if sizes:
            rolling = MATERIALS[bead.material][6] * beads[1].diameter / bead.diameter
        for slope, push in settings:
            for over in (False, True)[: 2 if turned else 1]:
                conditions.append(
                    _condition(bead, wall, slope, push, length, rolling, over, repetitions, named=turned)
                )  # fmt: skip
    geometry = {
        "incline_angle_uncertainty_deg": ANGLE_UNCERTAINTY,
        "plate_level_uncertainty_deg": LEVEL_UNCERTAINTY,
        "release": "inclined: from rest; level: pushed, the bead rolls at about push_speed (within 10 %) when it "
        "leaves the pusher, to the left where that is below zero; 0.01-0.05 s after the first frame",
        "sliding_friction_pw": {wall: WALLS[wall][1]},
        "rolling_friction_pw": None,
        "tracks": "until the bead has rolled track_length or stands still",
    }  # fmt: skip
    if turned:
        geometry["surface_turned"] = "the surface was lifted off the plate and laid down end for end"
    return Lab(
        "roll", beads, tuple(conditions), _chances(rng), move, rate,
        float(np.round(length / rng.uniform(800, 1700), 6)), float(np.round(rng.uniform(0.2, 0.4), 2)), geometry,
        "x right along the level, y up, origin where the bead touches the surface at the start; it rolls to the right",
        {wall: WALLS[wall][0]},
    )  # fmt: skip


def _three_sizes(rng: Rng) -> tuple[Sphere, ...]:
    first = spheres(rng, 1, ("wood", "polypropylene", "polyamide"), least=4.0, most=5.0)[0]
    found = []
    for times in (1.0, 1.6, 2.6):
        diameter = round(first.diameter * times, 4)
        name = f"{MATERIALS[first.material][0]}{diameter * 1e4:.0f}"
        found.append(
            Sphere(name, first.material, diameter, first.density, first.youngs_modulus, first.poissons_ratio, 0.6)
        )  # fmt: skip
    return tuple(found)


def _condition(
    bead: Sphere, wall: str, slope: float, push: float, length: float, rolling: float, turned: bool, repetitions: int,
    *, named: bool,
) -> Condition:  # fmt: skip
    kind = f"a{slope:02.0f}" if slope else f"{'v' if push > 0 else 'back'}{abs(push) * 1000:04.0f}"
    stated: dict[str, Any] = {
        "name": f"{bead.name}_{wall}_{kind}{'_turned' if turned else ''}", "bead": bead.name, "wall": wall,
        "incline_angle_deg": slope, **({"push_speed_m_s": push} if push else {}), "track_length_m": length,
        **({"surface_turned": turned} if named else {}), **({"run_reversed": True} if push < 0 else {}),
    }  # fmt: skip
    nominal = {
        "slope": math.radians(slope), "push": abs(push), "way": -1.0 if push < 0 else 1.0, "length": length,
        "rolling": rolling, "turned": float(turned), "begin": 0.01, "sliding": WALLS[wall][1],
    }  # fmt: skip
    return Condition(stated, bead, repetitions, nominal, {"bead": bead.name, "pair": f"{bead.name}/{wall}"})


def _chances(rng: Rng) -> tuple[Chance, ...]:
    return (
        Chance("begin", "run", 0.04, FREE, uniform=True),
        Chance("place", "run", 3e-4, 2e-3),
        Chance("push", "run", 0.05, 0.1, 1e-4),
        Chance("rolling", "run", float(rng.uniform(0.01, 0.04)), step=1e-4),
        Chance("tip", "condition", math.radians(0.5 * ANGLE_UNCERTAINTY), math.radians(ANGLE_UNCERTAINTY)),
        Chance("rolling_mean", "pair", 0.0, FREE, 1e-6),
        Chance("diameter", "bead", 0.5 * DIAMETER_UNCERTAINTY, DIAMETER_UNCERTAINTY, 1e-6),
        Chance("level", "lab", math.radians(0.5 * LEVEL_UNCERTAINTY), math.radians(LEVEL_UNCERTAINTY)),
    )
