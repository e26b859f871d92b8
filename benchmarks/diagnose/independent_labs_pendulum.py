"""Independent labs of a bead on a thread: angle and angular momentum about the pivot, after Hamilton.

The thread may change its length and the pivot may move; the moment of every force about the pivot is all that changes
the angular momentum, so that a stretching thread needs no term of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp

from rigtwin.benchmarks.diagnose.independent_labs_spheres import DIAMETER_UNCERTAINTY, MATERIALS, distinct, spheres
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
    still,
)

LENGTH_UNCERTAINTY, ANGLE_UNCERTAINTY = 5e-4, 0.3  # [m], [deg]


def move(condition: Condition, off: Mapping[str, float], hidden: Hidden) -> Motion:
    """Release and swing of one repetition."""
    sphere, nominal = condition.sphere, condition.nominal
    length = nominal["length"] * (1 + hidden.shifts.get("length_ratio", 0.0))
    length += off.get("length", 0.0) + hidden.shifts.get("length", 0.0)
    angle = nominal["angle"] + off.get("tip", 0.0) + off.get("hand", 0.0)
    begin, end = nominal["begin"] + off.get("begin", 0.0), nominal["duration"]
    linear_mass, knot = hidden.shifts.get("thread_mass", 0.0), hidden.shifts.get("knot", 0.0)  # [kg/m], [kg] halfway
    mass = sphere.mass + (hidden.added_mass(sphere) if hidden.added_mass else 0.0)

    def stretched(t: float, q: float, momentum: float) -> float:
        if hidden.thread is None:
            return length
        r = length
        for _ in range(2):  # the tension depends a little on the length that it makes
            rate = momentum / (mass * r**2)
            r = hidden.thread(t, length, sphere.mass * (GRAVITY * math.cos(q) + r * rate**2))
        return r

    def inertia(r: float) -> float:
        return mass * r**2 + linear_mass * r**3 / 3 + knot * r**2 / 4

    def motion_of(t: float, s: Array) -> tuple[float, float]:
        q, momentum = float(s[0]), float(s[1])
        r = stretched(t, q, momentum)
        rate = momentum / inertia(r)
        moment = -(sphere.mass + linear_mass * r / 2 + knot / 2) * GRAVITY * r * math.sin(q)
        if hidden.torque:
            moment += hidden.torque(t, q, rate, r, sphere)
        if hidden.support:
            moment -= sphere.mass * hidden.support(t)[1] * r * math.cos(q)
        return rate, moment

    def place(t: Array, q: Array, momentum: Array) -> Array:
        r = np.array([stretched(*one) for one in zip(t, q, momentum, strict=True)]) if hidden.thread else length
        shift = np.array([hidden.support(one)[0] for one in t]) if hidden.support else 0.0
        return np.array([shift + r * np.sin(q), -r * np.cos(q)])

    motion = Motion()
    first = place(np.array([begin]), np.array([angle]), np.array([0.0]))[:, 0]
    motion.add(0.0, begin, still(*first))
    swing = solve_ivp(motion_of, (begin, end), [angle, 0.0], max_step=0.1, **PRECISE)
    motion.add(begin, end, lambda t: place(t, *swing.sol(t)))
    return motion


def lab(rng: Rng, *, materials: tuple[str, ...] = (), control: bool = True) -> Lab:
    """A lab of two to eight conditions."""
    beads = spheres(rng, 1, materials or tuple(MATERIALS), least=4.0)
    if control or rng.random() < 0.5:
        beads += spheres(rng, 1, tuple(MATERIALS)[2:], least=4.0)
    beads = distinct(beads)
    lengths = [float(x) for x in sorted(rng.choice((0.18, 0.25, 0.33, 0.45, 0.6), 1 + int(rng.integers(0, 2)), False))]
    angles = [int(a) for a in sorted(rng.choice((8, 15, 25, 40, 55), int(rng.integers(2, 4)), replace=False))]
    duration = float(rng.choice([3, 4, 6, 8]))
    while len(beads) * len(lengths) * len(angles) > 8:
        lengths = lengths[:1]
    rate = float(rng.choice([120, 150, 200, 240, 300]))
    repetitions = int(rng.integers(3, 6))
    while len(beads) * len(lengths) * len(angles) * repetitions * duration * rate > 25_000 and rate > 120:
        rate = 120.0
    conditions = []
    for bead in beads:
        for length in lengths:
            for angle in angles:
                stated = {
                    "name": f"{bead.name}_L{length * 1e3:.0f}_a{angle}", "bead": bead.name, "length_m": length,
                    "release_angle_deg": angle,
                }  # fmt: skip
                nominal = {"length": length, "angle": math.radians(angle), "begin": 0.02, "duration": duration}
                groups = {"bead": bead.name, "thread": f"{length}"}
                conditions.append(Condition(stated, bead, repetitions, nominal, groups))
    geometry = {
        "length": "pivot to bob centre, set on the bench before hanging the bob",
        "length_uncertainty_m": LENGTH_UNCERTAINTY,
        "release": "from rest, 0.02-0.08 s after the first frame",
        "release_angle_uncertainty_deg": ANGLE_UNCERTAINTY,
        "suspension": "thread of negligible mass, motion in one plane",
    }
    return Lab(
        "pendulum", beads, tuple(conditions), CHANCES, move, rate,
        float(np.round(lengths[-1] * rng.uniform(1.2, 2.0) / rng.uniform(1000, 1900), 6)),
        float(np.round(rng.uniform(0.2, 0.4), 2)), geometry, "x right, y up, origin at the pivot",
    )  # fmt: skip


CHANCES = (
    Chance("begin", "run", 0.06, FREE, uniform=True),
    Chance("hand", "run", math.radians(0.05)),
    Chance("tip", "condition", math.radians(0.5 * ANGLE_UNCERTAINTY), math.radians(ANGLE_UNCERTAINTY)),
    Chance("length", "thread", 0.5 * LENGTH_UNCERTAINTY, LENGTH_UNCERTAINTY),
    Chance("diameter", "bead", 0.5 * DIAMETER_UNCERTAINTY, DIAMETER_UNCERTAINTY, 1e-6),
)
