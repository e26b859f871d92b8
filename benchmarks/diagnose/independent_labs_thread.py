"""Laws of pivots and threads that an independent lab may hide."""

from __future__ import annotations

import math
from collections.abc import Callable

from rigtwin.benchmarks.diagnose.independent_labs_types import Hidden, Lab, Make, Rng, Sized, Sphere


def moment(law: Callable[[float, float, float, Sphere, float], float], low: float, high: float) -> Make:
    """A moment against the swing, a share of m g L of the lightest bead: law(angle, rate, length, sphere, lightest)."""

    def make(rng: Rng, lab: Lab) -> Sized:
        lightest = min(sphere.mass for sphere in lab.spheres)
        share = float(math.exp(rng.uniform(math.log(low), math.log(high))))

        def sized(size: float) -> Hidden:
            def torque(_t: float, angle: float, rate: float, length: float, sphere: Sphere) -> float:
                return -size * share * law(angle, rate, length, sphere, lightest)

            return Hidden(torque=torque)

        return sized

    return make


def _sign(rate: float) -> float:
    return math.tanh(rate / 2e-3)


def dry(_angle: float, rate: float, _length: float, _sphere: Sphere, lightest: float) -> float:
    return lightest * 9.81 * 0.3 * _sign(rate)


def dry_by_load(angle: float, rate: float, length: float, sphere: Sphere, _lightest: float) -> float:
    """A pin that rubs in its hole: friction times what the thread pulls."""
    return sphere.mass * (9.81 * math.cos(angle) + length * rate**2) * 0.3 * _sign(rate)


def viscous(_angle: float, rate: float, _length: float, _sphere: Sphere, lightest: float) -> float:
    return lightest * 9.81 * 0.3 * rate / 3


def bearing(_angle: float, rate: float, _length: float, _sphere: Sphere, lightest: float) -> float:
    """A greased bearing, whose moment grows with the rate to the power of two thirds; Palmgren 1959."""
    return lightest * 9.81 * 0.3 * math.copysign((abs(rate) / 3) ** (2 / 3), rate)


def thread_drag(thick: bool) -> Make:
    """Resistance of the air along the thread: quadratic, or by Lamb's law for a thin one (nearly linear)."""

    def make(rng: Rng, _lab: Lab) -> Sized:
        width = float(rng.uniform(0.15e-3, 0.5e-3)) * (2 if thick else 1)

        def sized(size: float) -> Hidden:
            def torque(_t: float, _angle: float, rate: float, length: float, _sphere: Sphere) -> float:
                if thick:
                    return -size * 0.5 * 1.18 * 1.1 * width * rate * abs(rate) * length**4 / 4
                reynolds = max(1.18 * abs(rate) * length / 2 * width / 1.8e-5, 1e-3)
                per_length = 4 * math.pi * 1.8e-5 / max(2.0 - math.log(reynolds), 0.7)
                return -size * per_length * rate * length**3 / 3

            return Hidden(torque=torque)

        return sized

    return make


def stretch(rng: Rng, lab: Lab) -> Sized:
    """An elastic thread, its length as measured with the bead hanging at rest."""
    heaviest = max(sphere.mass for sphere in lab.spheres) * 9.81
    strain = float(rng.uniform(0.005, 0.03))

    def sized(size: float) -> Hidden:
        return Hidden(thread=lambda _t, length, tension: length * (1 + size * strain * (tension / heaviest - 1)))

    return sized


def creep(rng: Rng, _lab: Lab) -> Sized:
    """A thread that goes on stretching, with the logarithm of the time or steadily."""
    rate, steady = float(rng.uniform(0.002, 0.01)), bool(rng.random() < 0.5)

    def sized(size: float) -> Hidden:
        return Hidden(
            thread=lambda t, length, _tension: length * (1 + size * rate * (t / 2 if steady else math.log1p(t / 0.5)))
        )

    return sized


def magnet_below(rng: Rng, lab: Lab) -> Sized:
    """A magnet under one place of the swing."""
    place, width = float(rng.uniform(-0.15, 0.15)), float(rng.uniform(0.06, 0.15))  # [rad]
    strength = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.1))

    def sized(size: float) -> Hidden:
        def torque(_t: float, angle: float, _rate: float, length: float, sphere: Sphere) -> float:
            u = (angle - place) / width
            return -size * strength * sphere.mass * 9.81 * length * u * math.exp(-(u**2) / 2)

        return Hidden(torque=torque)

    return sized


def odd_damping(rng: Rng, _lab: Lab) -> Sized:
    """Damping in proportion to the angle squared and to the rate."""
    strength = float(rng.uniform(0.1, 0.4))  # [1/s]

    def sized(size: float) -> Hidden:
        def torque(_t: float, angle: float, rate: float, length: float, sphere: Sphere) -> float:
            return -size * strength * sphere.mass * length**2 * angle**2 * rate

        return Hidden(torque=torque)

    return sized


def shaken_pivot(rng: Rng, _lab: Lab) -> Sized:
    """The pivot moves to and fro: place and acceleration of a sine on the film's clock."""
    width, period = float(rng.uniform(2e-4, 1e-3)), float(rng.uniform(0.25, 0.7))
    phase, turn = float(rng.uniform(0, 2 * math.pi)), 2 * math.pi / period

    def sized(size: float) -> Hidden:
        def support(t: float) -> tuple[float, float]:
            wave = size * width * math.sin(turn * t + phase)
            return wave - size * width * math.sin(phase), -(turn**2) * wave

        return Hidden(support=support)

    return sized
