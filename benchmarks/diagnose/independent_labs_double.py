"""Independent labs of two equal beads that hang side by side: A is released and strikes B, again and again.

Angles and angular momenta about the two pivots; an impact passes a momentum along the line of the centres.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

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

LENGTH_UNCERTAINTY, ANGLE_UNCERTAINTY, SPACING_UNCERTAINTY = 5e-4, 0.3, 1e-4  # [m], [deg], [m]
TOGETHER = 0.01  # [m/s], beads that meet more slowly go on together; the record ends there
MOST_IMPACTS = 4


def move(condition: Condition, off: Mapping[str, float], hidden: Hidden) -> Motion:
    """Release, swings and impacts of one repetition."""
    sphere, nominal, shifts = condition.sphere, condition.nominal, hidden.shifts
    common = nominal["length"] * (1 + shifts.get("length_ratio", 0.0)) + shifts.get("length", 0.0)
    lengths = [common + off.get(f"length_{who}", 0.0) for who in "ab"]
    diameter = sphere.diameter + off.get("diameter", 0.0)
    half = sphere.diameter / 2 + off.get("spacing", 0.0) / 2
    angle = -(nominal["angle"] + off.get("tip", 0.0) + off.get("hand", 0.0))
    begin, end = nominal["begin"] + off.get("begin", 0.0), nominal["duration"]
    inertia = [sphere.mass * r**2 for r in lengths]
    weight = [sphere.mass * GRAVITY * r for r in lengths]

    def places(q: Array) -> tuple[complex, complex]:
        """Centres: x + i y."""
        return (
            -half - 1j * lengths[0] * cmath.exp(1j * q[0]), half - 1j * lengths[1] * cmath.exp(1j * q[1])
        )  # fmt: skip

    def moments(t: float, q: Array, rates: tuple[float, float]) -> list[float]:
        found = [-weight[k] * math.sin(q[k]) for k in range(2)]
        if hidden.torque:
            found = [found[k] + hidden.torque(t, q[k], rates[k], lengths[k], sphere) for k in range(2)]
        if hidden.apart:
            a, b = places(q)
            push = hidden.apart(abs(b - a), sphere) * (b - a) / abs(b - a)
            for k, sign in ((0, -1), (1, 1)):
                along = cmath.exp(1j * q[k])  # direction in which the angle grows
                found[k] += sign * lengths[k] * float((push * along.conjugate()).real)
        return found

    def swings(t: float, s: Array) -> list[float]:
        rates = (float(s[2]) / inertia[0], float(s[3]) / inertia[1])
        return [*rates, *moments(t, s[:2], rates)]

    def gap(_t: float, s: Array) -> float:
        a, b = places(s)
        return math.copysign(abs(b - a), (b - a).real) - diameter

    gap.terminal, gap.direction = True, -1  # type: ignore[attr-defined]
    waits = 0.0
    if hidden.apart:  # B hangs where weight and push balance
        waits = float(brentq(lambda q: moments(0.0, np.array([angle, q]), (0.0, 0.0))[1], 0.0, 1.2))

    def at(q: Array) -> Array:
        a = -half - 1j * lengths[0] * np.exp(1j * q[0])
        b = half - 1j * lengths[1] * np.exp(1j * q[1])
        return np.array([a.real, a.imag, b.real, b.imag])

    motion = Motion()
    motion.add(0.0, begin, still(*at(np.array([angle, waits]))))
    state = np.array([angle, waits, 0.0, 0.0])
    for k in range(MOST_IMPACTS + 1):
        run = solve_ivp(swings, (begin, end), state, events=gap, max_step=0.05, **PRECISE)
        motion.add(begin, float(run.t[-1]), lambda t, s=run.sol: at(s(t)[:2]))
        if run.status != 1 or k == MOST_IMPACTS:
            break
        state, begin = run.y[:, -1].copy(), float(run.t[-1])
        line = np.subtract(*places(state)[::-1])
        # what a momentum along the line of the centres changes in each angular momentum
        arms = [lengths[n] * float((line / abs(line) * np.exp(-1j * state[n])).real) for n in range(2)]
        closing = float(state[2] / inertia[0] * arms[0] - state[3] / inertia[1] * arms[1])
        if closing < TOGETHER:
            break
        e = _restitution(closing, k, condition, off, hidden)
        # out of the plane by a share of the diameter: only a part of the line of the centres lies in the plane
        part = 1 - min(shifts.get("off_centre", 0.0), 0.9) ** 2
        impulse = part * (1 + e) * closing / sum(arms[n] ** 2 / inertia[n] for n in range(2))
        state[2:] += impulse * np.array([-arms[0], arms[1]])
        state[1] += 1e-8  # a hair apart
    return motion


def _restitution(closing: float, k: int, condition: Condition, off: Mapping[str, float], hidden: Hidden) -> float:
    """Of the impact number `k`, at this speed [m/s]."""
    e = condition.nominal["restitution"] + off.get("restitution", 0.0)
    e = hidden.bounce(e, closing, condition.sphere) if hidden.bounce else e
    return min(max(e + off.get(f"e{k}", 0.0), 0.0), 0.99)


def lab(rng: Rng, *, materials: tuple[str, ...] = (), control: bool = False) -> Lab:
    """A lab of two to eight conditions."""
    beads = spheres(rng, 1, materials or tuple(MATERIALS)[2:], least=5.0)
    if control or rng.random() < 0.5:
        beads += spheres(rng, 1, tuple(MATERIALS)[3:], least=5.0)
    beads = distinct(beads)
    lengths = [float(x) for x in sorted(rng.choice((0.2, 0.25, 0.3, 0.4), 1 + int(rng.integers(0, 2)), replace=False))]
    angles = [int(a) for a in sorted(rng.choice((15, 25, 40, 55), int(rng.integers(2, 4)), replace=False))]
    if len(beads) * len(lengths) * len(angles) > 8:
        lengths = lengths[:1]
    repetitions = int(rng.integers(3, 6))
    conditions = []
    for bead in beads:
        restitution = float(np.clip(bead.restitution + rng.normal(0.05, 0.04), 0.4, 0.93))
        for length in lengths:
            for angle in angles:
                stated = {
                    "name": f"{bead.name}_L{length * 1e3:.0f}_a{angle}", "bead": bead.name, "length_m": length,
                    "release_angle_deg": angle,
                }  # fmt: skip
                nominal = {
                    "length": length, "angle": math.radians(angle), "begin": 0.02, "duration": 1.5,
                    "restitution": restitution,
                }  # fmt: skip
                conditions.append(
                    Condition(stated, bead, repetitions, nominal, {"bead": bead.name, "thread": f"{length}"})
                )  # fmt: skip
    geometry = {
        "length": "pivot to bead centre, both threads alike, set on the bench before hanging the beads",
        "length_uncertainty_m": LENGTH_UNCERTAINTY,
        "pivots": "one bead diameter apart; A, on the left, is released to the left; B, on the right, hangs at rest",
        "pivot_spacing_uncertainty_m": SPACING_UNCERTAINTY,
        "release": "from rest, 0.02-0.08 s after the first frame",
        "release_angle_uncertainty_deg": ANGLE_UNCERTAINTY,
        "suspension": "threads of negligible mass, motion in one plane",
    }
    return Lab(
        "double", beads, tuple(conditions), _chances(float(rng.uniform(0.006, 0.02))), move,
        float(rng.choice([120, 200, 240, 300, 480])),
        float(np.round(lengths[-1] * rng.uniform(1.2, 2.0) / rng.uniform(1000, 1900), 6)),
        float(np.round(rng.uniform(0.2, 0.4), 2)), geometry, "x right, y up, origin midway between the two pivots",
    )  # fmt: skip


def _chances(scatter: float) -> tuple[Chance, ...]:
    return (
        Chance("begin", "run", 0.06, FREE, uniform=True),
        Chance("hand", "run", math.radians(0.05)),
        *(Chance(f"e{k}", "run", scatter, step=1e-4) for k in range(MOST_IMPACTS)),
        Chance("tip", "condition", math.radians(0.5 * ANGLE_UNCERTAINTY), math.radians(ANGLE_UNCERTAINTY)),
        Chance("length_a", "thread", 0.5 * LENGTH_UNCERTAINTY, LENGTH_UNCERTAINTY),
        Chance("length_b", "thread", 0.5 * LENGTH_UNCERTAINTY, LENGTH_UNCERTAINTY),
        Chance("spacing", "bead", 0.5 * SPACING_UNCERTAINTY, SPACING_UNCERTAINTY, 1e-6),
        Chance("restitution", "bead", 0.0, FREE, 1e-4),
        Chance("diameter", "bead", 0.5 * DIAMETER_UNCERTAINTY, DIAMETER_UNCERTAINTY, 1e-6),
    )
