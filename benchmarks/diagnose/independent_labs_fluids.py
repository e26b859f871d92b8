"""Resistance of air and of liquids to a sphere, by several published laws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from rigtwin.benchmarks.diagnose.independent_labs_types import GRAVITY, Array, Hidden, Sphere


@dataclass(frozen=True)
class Fluid:
    """What a bead moves in."""

    density: float  # [kg/m^3]
    viscosity: float  # [Pa s]


def schiller_naumann(reynolds: float) -> float:
    """Drag coefficient; Schiller & Naumann 1933, 0.44 above a Reynolds number of 1000."""
    return 24 / reynolds * (1 + 0.15 * math.pow(reynolds, 0.687)) if reynolds < 1000 else 0.44


def brown_lawler(reynolds: float) -> float:
    """Drag coefficient; Brown & Lawler 2003, their equation 19."""
    return 24 / reynolds * (1 + 0.150 * reynolds**0.681) + 0.407 / (1 + 8710 / reynolds)


def abraham(reynolds: float) -> float:
    """Drag coefficient; Abraham 1970, of a boundary layer around the sphere."""
    return 0.2924 * (1 + 9.06 / math.sqrt(reynolds)) ** 2


def white(reynolds: float) -> float:
    """Drag coefficient; White 1991, chapter 3, up to a Reynolds number of 2e5."""
    return 24 / reynolds + 6 / (1 + math.sqrt(reynolds)) + 0.4


def constant(value: float) -> Callable[[float], float]:
    return lambda _reynolds: value


def resistance(law: Callable[[float], float], fluid: Fluid, speed: float, sphere: Sphere) -> float:
    """Force [N] against a motion at this speed [m/s]."""
    if speed <= 0:
        return 0.0
    reynolds = max(fluid.density * speed * sphere.diameter / fluid.viscosity, 1e-9)
    return 0.5 * fluid.density * law(reynolds) * sphere.section * speed**2


def against(law: Callable[[float], float], fluid: Fluid, size: float) -> Hidden:
    """`size` times the resistance of a fluid, in flight, on a thread and on a track."""

    def force(_t: float, s: Array, sphere: Sphere) -> tuple[float, float]:
        speed = math.hypot(s[2], s[3])
        drag = size * resistance(law, fluid, speed, sphere) / max(speed, 1e-12)
        return -drag * float(s[2]), -drag * float(s[3])

    def torque(_t: float, _angle: float, rate: float, length: float, sphere: Sphere) -> float:
        return -math.copysign(size * length * resistance(law, fluid, abs(rate) * length, sphere), rate)

    def along(_t: float, _place: float, speed: float, condition: object) -> float:
        sphere: Sphere = condition.sphere  # type: ignore[attr-defined]
        return -size * resistance(law, fluid, abs(speed), sphere) / sphere.mass

    return Hidden(force=force, torque=torque, along=along)


def buoyed(fluid: Fluid, size: float) -> Hidden:
    """Buoyancy and the mass of fluid that goes along."""

    def force(_t: float, _s: Array, sphere: Sphere) -> tuple[float, float]:
        return 0.0, size * fluid.density * sphere.volume * GRAVITY

    def torque(_t: float, angle: float, _rate: float, length: float, sphere: Sphere) -> float:
        return size * fluid.density * sphere.volume * GRAVITY * length * math.sin(angle)

    return Hidden(
        force=force, torque=torque, added_mass=lambda sphere: 0.5 * size * fluid.density * sphere.volume
    )  # fmt: skip
