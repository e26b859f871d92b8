"""Laws of flights and impacts that an independent lab may hide.

A law draws its constants and gives a function from a size to what is hidden; size 1 is what a real lab may have.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from rigtwin.benchmarks.diagnose.independent_labs_fluids import (
    Fluid,
    abraham,
    against,
    brown_lawler,
    buoyed,
    constant,
    schiller_naumann,
    white,
)
from rigtwin.benchmarks.diagnose.independent_labs_types import Array, Hidden, Lab, Make, Rng, Sized, Sphere, combined


def _air(rng: Rng) -> Fluid:
    return Fluid(float(rng.uniform(1.13, 1.22)), float(rng.uniform(1.79e-5, 1.86e-5)))


def drag(law: Callable[[float], float] | None) -> Make:
    def make(rng: Rng, lab: Lab) -> Sized:
        chosen = law or constant(float(rng.uniform(0.44, 0.50)))
        air = _air(rng)
        return lambda size: against(chosen, air, size)

    return make


def slow_drag(exponent: float) -> Make:
    """Resistance in proportion to the speed: as Stokes foretells for the size, or alike for all beads."""

    def make(rng: Rng, lab: Lab) -> Sized:
        times = float(rng.uniform(4, 15)) * 3 * math.pi * 1.8e-5  # what a porous or fluffy bead meets
        typical = lab.spheres[0].diameter

        def sized(size: float) -> Hidden:
            def force(_t: float, s: Array, sphere: Sphere) -> tuple[float, float]:
                drag = size * times * typical * (sphere.diameter / typical) ** exponent
                return -drag * float(s[2]), -drag * float(s[3])

            def torque(_t: float, _angle: float, rate: float, length: float, sphere: Sphere) -> float:
                return -size * times * typical * (sphere.diameter / typical) ** exponent * length**2 * rate

            return Hidden(force=force, torque=torque)

        return sized

    return make


def buoyancy(rng: Rng, _lab: Lab) -> Sized:
    air = _air(rng)
    return lambda size: buoyed(air, size)


def water(rng: Rng, _lab: Lab) -> Sized:
    water = Fluid(float(rng.uniform(996, 999)), float(rng.uniform(0.85e-3, 1.1e-3)))
    law = schiller_naumann if rng.random() < 0.5 else brown_lawler
    return lambda size: combined([against(law, water, size), buoyed(water, size)])


def oil(rng: Rng, _lab: Lab) -> Sized:
    oil = Fluid(float(rng.uniform(870, 965)), float(rng.uniform(0.05, 0.35)))
    law = abraham if oil.viscosity < 0.15 else white
    return lambda size: combined([against(law, oil, size), buoyed(oil, size)])


def by_impact_speed(law: Callable[[Rng], Callable[[float], float]], scales: str) -> Make:
    """Restitution against impact speed.

    The plain restitution of a bead is what it has at 1 m/s: its loss, or what is left, is that of the law at other
    speeds times one factor of its own.
    """

    def make(rng: Rng, lab: Lab) -> Sized:
        at = law(rng)
        one = at(1.0)

        def sized(size: float) -> Hidden:
            def bounce(plain: float, speed: float, _sphere: Sphere) -> float:
                times = (1 - plain) / (1 - one) if scales == "loss" else plain / one
                return plain + size * times * (at(max(speed, 1e-3)) - one)

            return Hidden(bounce=bounce)

        return sized

    return make


def kuwabara(rng: Rng) -> Callable[[float], float]:
    """1 - e in proportion to v^(1/5); Kuwabara & Kono 1987."""
    loss = float(rng.uniform(0.2, 0.45))
    return lambda v: 1 - loss * v**0.2


def pade(rng: Rng) -> Callable[[float], float]:
    """Viscoelastic spheres at any speed; Schwager & Poeschel 2008 (Pade approximation by Mueller & Poeschel 2011)."""
    beta = float(rng.uniform(0.15, 0.5))

    def e(v: float) -> float:
        x = math.sqrt(beta) * v**0.1
        above = 1 + 0.501086 * x
        below = 1 + 0.501086 * x + 1.15345 * x**2 + 0.577977 * x**3 + 0.532178 * x**4
        return above / below

    return e


def plastic(rng: Rng) -> Callable[[float], float]:
    """Full plasticity, e in proportion to v^(-1/4); Johnson 1985."""
    at_one = float(rng.uniform(0.45, 0.7))
    return lambda v: min(at_one * v**-0.25, 0.99)


def thornton(rng: Rng) -> Callable[[float], float]:
    """Elastic until a yield speed, perfectly plastic beyond; Thornton 1997."""
    yields = float(rng.uniform(0.05, 0.3))

    def e(v: float) -> float:
        if v <= yields:
            return 1.0
        ratio = yields / v
        return (
            math.sqrt(6 * math.sqrt(3) / 5) * math.sqrt(1 - ratio**2 / 6)
            * (ratio / (ratio + 2 * math.sqrt(6 / 5 - ratio**2 / 5))) ** 0.25
        )  # fmt: skip

    return e


def energy_loss(exponent: float) -> Make:
    """Each impact costs an energy that depends on the bead's size by a power, by 0 not at all."""

    def make(rng: Rng, lab: Lab) -> Sized:
        lightest = min(lab.spheres, key=lambda sphere: sphere.mass)
        speed = float(rng.uniform(0.1, 0.35))  # [m/s], of the lightest bead, that this energy stops

        def sized(size: float) -> Hidden:
            def bounce(plain: float, v: float, sphere: Sphere) -> float:
                lost = size * 0.5 * lightest.mass * speed**2 * (sphere.radius / lightest.radius) ** exponent
                return math.sqrt(max(plain**2 - 2 * lost / (sphere.mass * max(v, 1e-6) ** 2), 0.0))

            return Hidden(bounce=bounce)

        return sized

    return make


def charge(kind: str) -> Make:
    """Attraction by the image in a conducting plate: the same charge on all beads, one by area, or one that leaks."""

    def make(rng: Rng, lab: Lab) -> Sized:
        # a share of the lightest bead's weight at the plate, a charge that insulating beads hold
        lightest = min(lab.spheres, key=lambda sphere: sphere.mass)
        share = float(rng.uniform(0.3, 1.5))
        held = math.sqrt(share * lightest.mass * 9.81 * 16 * math.pi * 8.854e-12) * lightest.radius
        leak = float(rng.uniform(0.4, 1.2))

        def sized(size: float) -> Hidden:
            def force(t: float, s: Array, sphere: Sphere) -> tuple[float, float]:
                q = held * math.sqrt(size)
                if kind == "area":
                    q *= (sphere.radius / lightest.radius) ** 2
                if kind == "leaking":
                    q *= math.exp(-t / leak)
                return 0.0, -(q**2) / (16 * math.pi * 8.854e-12 * max(float(s[1]), 0.9 * sphere.radius) ** 2)

            return Hidden(force=force)

        return sized

    return make


def sheet(near: Callable[[float, float], float]) -> Make:
    """A sheet upright beside the fall, which pulls or pushes: strength by distance over reach."""

    def make(rng: Rng, lab: Lab) -> Sized:
        away = float(rng.choice([-1, 1]) * rng.uniform(0.03, 0.06))  # [m]
        reach = float(rng.uniform(0.015, 0.04))
        strength = float(rng.choice([-1, 1]) * rng.uniform(0.3, 1.5)) * 9.81 * 0.2 * lab.spheres[0].mass

        def sized(size: float) -> Hidden:
            def force(_t: float, s: Array, _sphere: Sphere) -> tuple[float, float]:
                distance = max((away - float(s[0])) * math.copysign(1, away), 5e-3)
                return math.copysign(1, away) * size * strength * near(distance, reach), 0.0

            return Hidden(force=force)

        return sized

    return make


def breeze(rng: Rng, lab: Lab) -> Sized:
    """A steady draught from one side, above a height only."""
    highest = max(c.nominal["height"] for c in lab.conditions)
    above, push = float(rng.uniform(0.3, 0.6)) * highest, float(rng.choice([-1, 1]) * rng.uniform(0.2, 0.8))
    width = 0.02 * highest

    def sized(size: float) -> Hidden:
        def force(_t: float, s: Array, sphere: Sphere) -> tuple[float, float]:
            return size * push * sphere.mass / (1 + math.exp(-(float(s[1]) - above) / width)), 0.0

        return Hidden(force=force)

    return sized


def magnet_beside(rng: Rng, lab: Lab) -> Sized:
    """A magnet at one height beside the fall: it pulls up below that, and down above it."""
    highest = max(c.nominal["height"] for c in lab.conditions)
    place, reach = float(rng.uniform(0.3, 0.7)) * highest, float(rng.uniform(0.06, 0.15)) * highest
    strength = float(rng.uniform(0.5, 2.0))

    def sized(size: float) -> Hidden:
        def force(_t: float, s: Array, sphere: Sphere) -> tuple[float, float]:
            u = (float(s[1]) - place) / reach
            return 0.0, -size * strength * sphere.mass * u * math.exp(-(u**2) / 2)

        return Hidden(force=force)

    return sized


def repulsion(kind: str) -> Make:
    """Two beads that push each other apart: equal charges, or a force that decays over some millimetres."""

    def make(rng: Rng, lab: Lab) -> Sized:
        first = lab.spheres[0]
        share, reach = float(rng.uniform(0.02, 0.2)), float(rng.uniform(0.003, 0.012))
        closest = first.mass * 9.81 * share  # [N], of beads that touch

        def sized(size: float) -> Hidden:
            def apart(distance: float, sphere: Sphere) -> float:
                if kind == "charges":
                    return size * closest * (first.diameter / distance) ** 2
                return size * closest * math.exp(-(distance - sphere.diameter) / reach)

            return Hidden(apart=apart)

        return sized

    return make
