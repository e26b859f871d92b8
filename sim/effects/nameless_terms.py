"""Nameless terms: candidate formulas for a deviation that no effect of the catalogue describes.

Each is a simple term of a force (per mass), of a torque (per moment of inertia) or of the restitution, with one free
coefficient.  It is an `Effect` like any other, so a formula found in the residuals can be used in a model file.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from rigtwin.lab.errors import BadInput
from rigtwin.sim.effects.effect import Effect, Parameter
from rigtwin.sim.effects.nameless_shapes import Extent, shapes

E = 2.718281828459045
PREFIX = "form:"
Kind = tuple[str, dict[str, tuple[str, str, float, Callable[..., Any]]], str]
"""Physical quantity of the terms, the terms by name, and the hook where they enter."""


# in flight: force [N] from the velocity and the height of the lowest point


def up(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return 0.0 * vx, mass * c + 0.0 * vy


def sideways(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return mass * c + 0.0 * vx, 0.0 * vy


def with_v(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return mass * c * vx, mass * c * vy


def with_v_squared(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    speed = (vx * vx + vy * vy) ** 0.5
    return mass * c * vx * speed, mass * c * vy * speed


def with_v_cubed(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    squared = vx * vx + vy * vy
    return mass * c * vx * squared, mass * c * vy * squared


def across_v(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return -mass * c * vy, mass * c * vx


def level_with_v(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return mass * c * vx, 0.0 * vy


def sideways_with_height(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return mass * c * gap + 0.0 * vx, 0.0 * vy


def with_height(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return 0.0 * vx, mass * c * gap + 0.0 * vy


def with_height_squared(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return 0.0 * vx, mass * c * gap * gap + 0.0 * vy


def within_5mm(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return 0.0 * vx, mass * c * E ** (-abs(gap) / 0.005) + 0.0 * vy


def within_20mm(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return 0.0 * vx, mass * c * E ** (-abs(gap) / 0.02) + 0.0 * vy


def within_80mm(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
    return 0.0 * vx, mass * c * E ** (-abs(gap) / 0.08) + 0.0 * vy


# on a thread: torque [N m] from angle and rate; on a track, with length and mass 1: acceleration from place and speed


def sign_of_rate(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * rate / (rate * rate + 1e-12) ** 0.5


def with_rate(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * rate


def with_rate_squared(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * rate * abs(rate)


def with_rate_cubed(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * rate * rate * rate


def angle_squared_rate(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * angle * angle * rate


def with_angle(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * angle


def with_angle_squared(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * angle * angle


def with_angle_cubed(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * angle * angle * angle


def always(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c + 0.0 * angle


def size_of_angle_sign_of_rate(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
    return mass * length * length * c * abs(angle) * rate / (rate * rate + 1e-12) ** 0.5


# at an impact


def with_impact_speed(e: Any, speed: Any, radius: Any, mass: Any, c: Any) -> Any:
    return e + c * speed


def against_impact_speed(e: Any, speed: Any, radius: Any, mass: Any, c: Any) -> Any:
    return e + c / (speed + 0.02)


def with_impact_speed_squared(e: Any, speed: Any, radius: Any, mass: Any, c: Any) -> Any:
    return e + c * speed * speed


def around_an_impact_speed(e: Any, speed: Any, radius: Any, mass: Any, c: Any) -> Any:
    off = (speed - 1.5) / 0.7
    return e + c * E ** (-0.5 * off * off)


# name: formula, unit of the coefficient, typical size, hook
FLIGHT = {
    "constant_vertical": ("c", "m/s^2", 0.1, up),
    "constant_sideways": ("c e_x", "m/s^2", 0.1, sideways),
    "v": ("c v", "1/s", 0.1, with_v),
    "v|v|": ("c v |v|", "1/m", 0.05, with_v_squared),
    "v^3": ("c v^3", "s/m^2", 0.02, with_v_cubed),
    "v_cross": ("c e_z x v", "1/s", 0.1, across_v),
    "height": ("c z", "1/s^2", 0.3, with_height),
    "height^2": ("c z^2", "1/(m s^2)", 0.5, with_height_squared),
    "near_5mm": ("c exp(-z / 5 mm)", "m/s^2", 1.0, within_5mm),
    "near_20mm": ("c exp(-z / 20 mm)", "m/s^2", 0.5, within_20mm),
    "near_80mm": ("c exp(-z / 80 mm)", "m/s^2", 0.3, within_80mm),
}
FLIGHT_BESIDE = {
    "v_x": ("c v_x e_x", "1/s", 0.1, level_with_v),
    "height_sideways": ("c z e_x", "1/s^2", 0.3, sideways_with_height),
}
AIMED = (sideways, across_v, sideways_with_height, always, with_angle_squared)
SWING = {
    "sign(rate)": ("c sign(w)", "rad/s^2", 0.02, sign_of_rate),
    "rate": ("c w", "1/s", 0.02, with_rate),
    "rate|rate|": ("c w |w|", "1", 0.01, with_rate_squared),
    "rate^3": ("c w^3", "s", 0.003, with_rate_cubed),
    "angle^2 rate": ("c a^2 w", "1/s", 0.1, angle_squared_rate),
    "angle": ("c a", "1/s^2", 0.1, with_angle),
    "angle^2": ("c a^2", "1/s^2", 0.1, with_angle_squared),
    "angle^3": ("c a^3", "1/s^2", 0.1, with_angle_cubed),
    "constant": ("c", "rad/s^2", 0.05, always),
    "|angle| sign(rate)": ("c |a| sign(w)", "1/s^2", 0.05, size_of_angle_sign_of_rate),
}
IMPACT = {
    "e~v": ("e + c v", "s/m", 0.02, with_impact_speed),
    "e~1/v": ("e + c / v", "m/s", 0.01, against_impact_speed),
    "e~v^2": ("e + c v^2", "s^2/m^2", 0.01, with_impact_speed_squared),
    "e~bump": ("e + c exp(-(v - 1.5 m/s)^2 / 2 (0.7 m/s)^2)", "1", 0.03, around_an_impact_speed),
}
TRACK = {
    "along": ("c", "m/s^2", 0.02, always),
    "speed": ("c v", "1/s", 0.05, with_rate),
    "speed|speed|": ("c v |v|", "1/m", 0.05, with_rate_squared),
    "place": ("c s", "1/s^2", 0.1, with_angle),
    "place^2": ("c s^2", "1/(m s^2)", 0.3, with_angle_squared),
}


@cache
def nameless(rig: str) -> tuple[Effect, ...]:
    """The terms of a rig, as effects with one coefficient; every verdict of the diagnosis is tested against them."""
    kinds: dict[str, tuple[Kind, ...]] = {
        "drop": (("force per mass", FLIGHT, "force"), ("restitution", IMPACT, "restitution")),
        "pendulum": (("angular acceleration", SWING, "torque"),),
        "double": (("angular acceleration", SWING, "torque"), ("restitution", IMPACT, "restitution")),
        "roll": (("acceleration along the track", TRACK, "torque"),),
        "slide": (("acceleration along the track", TRACK, "torque"),),
    }
    return _effects(rig, kinds.get(rig, ()))


@cache
def beside(rig: str) -> tuple[Effect, ...]:
    """Further terms, tried only after no effect of the catalogue explains a deviation."""
    return _effects(rig, (("force per mass", FLIGHT_BESIDE, "force"),) if rig == "drop" else ())


def _effects(rig: str, kinds: tuple[Kind, ...]) -> tuple[Effect, ...]:
    return tuple(
        Effect(
            name=PREFIX + name,
            title=f"{what} {formula}",
            kind="physical",
            rigs=(rig,),
            parameters=(Parameter("c", unit, -1e9, 1e9, size),),
            equation=formula,
            source="regression on the residual",
            steep=name.startswith("near_"),
            aimed=term in AIMED,
            **{hook: term},  # type: ignore[arg-type]
        )
        for what, terms, hook in kinds
        for name, (formula, unit, size, term) in terms.items()
    )


def form(name: str) -> Effect:
    """The nameless term of this name in a model file.  Raises `BadInput` where no simulation implements it."""
    ways = {shape.effect.name for rig in ("pendulum", "roll", "slide") for shape in shapes(rig, Extent(1.0, 1.0, 1.0))}
    if name.removeprefix(PREFIX) in TRACK or name in ways:
        raise BadInput(
            f"effect {name}: an acceleration along a track or by the clock is a formula of the diagnosis that no "
            "simulation implements; remove it from the model file."
        )
    free = tuple(shape.effect for shape in shapes("drop", Extent(1.0, 1.0, 1.0)))
    known = {term.name: term for term in (*free, *beside("drop"), *nameless("double"), *nameless("drop"))}
    if name not in known:
        raise BadInput(f"there is no formula {name!r}; known are {', '.join(known)}.")
    return known[name]
