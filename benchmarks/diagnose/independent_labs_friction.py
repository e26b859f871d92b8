"""Laws of friction and of forces along a track that an independent lab may hide."""

from __future__ import annotations

import math

from rigtwin.benchmarks.diagnose.independent_labs_types import Hidden, Lab, Make, Rng, Sized, Slip


def ageing(kind: str) -> Make:
    """Friction that grows while a clump rests: with the logarithm of the time, or with a small power of it."""

    def make(rng: Rng, _lab: Lab) -> Sized:
        rate, power = float(rng.uniform(0.008, 0.02)), float(rng.uniform(0.08, 0.2))

        def sized(size: float) -> Hidden:
            def friction(plain: float, slip: Slip) -> float:
                grown = math.log1p(slip.waited / 1.0) if kind == "log" else ((1 + slip.waited) ** power - 1) / power
                return plain + size * rate * grown  # in a short slide the contacts keep their age

            return Hidden(friction=friction)

        return sized

    return make


def by_speed(kind: str) -> Make:
    """Kinetic friction that falls with the speed to a lower level, or changes in proportion to it."""

    def make(rng: Rng, _lab: Lab) -> Sized:
        falls, scale = float(rng.uniform(0.03, 0.08)), float(rng.uniform(0.05, 0.3))
        slope = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.1))

        def sized(size: float) -> Hidden:
            def friction(plain: float, slip: Slip) -> float:
                if kind == "weakening":
                    return plain - size * falls * (1 - math.exp(-slip.speed / scale))
                return plain + size * slope * slip.speed

            return Hidden(friction=friction)

        return sized

    return make


def by_load(kind: str) -> Make:
    """Friction that is higher under a small load: a pull of the surface, or a power of the load."""

    def make(rng: Rng, lab: Lab) -> Sized:
        lightest = 9.81 * min(condition.nominal["mass"] for condition in lab.conditions)
        share, power = float(rng.uniform(0.05, 0.2)), float(rng.uniform(0.04, 0.12))

        def sized(size: float) -> Hidden:
            def friction(plain: float, slip: Slip) -> float:
                load = max(slip.load, 1e-9)
                if kind == "adhesion":
                    return plain * (1 + size * share * lightest / load)
                return float(plain * (load / lightest) ** (-size * power))

            return Hidden(friction=friction)

        return sized

    return make


def shaken_arm(rng: Rng, _lab: Lab) -> Sized:
    """The arm's drive shakes it along its length."""
    push, period = float(rng.uniform(0.1, 0.4)), float(rng.uniform(0.1, 0.35))

    def sized(size: float) -> Hidden:
        return Hidden(along=lambda t, _s, _v, _c: size * push * math.sin(2 * math.pi * t / period))

    return sized


def patch(rng: Rng, _lab: Lab) -> Sized:
    """The surface is rougher or smoother below one place on the arm."""
    edge, step = float(rng.uniform(0.12, 0.19)), float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.06))

    def sized(size: float) -> Hidden:
        def friction(plain: float, slip: Slip) -> float:
            return plain + size * step / (1 + math.exp((slip.place - edge) / 2e-3))

        return Hidden(friction=friction)

    return sized
