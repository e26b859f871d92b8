"""Nameless terms: what a disagreement looks like when no listed effect describes it.

Each is a plain term of a residual force (per mass), torque (per moment of inertia) or impact law, fitted like an
effect, so that the formula found can be added to the model as such.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rigtwin.sim.effects import Effect, Parameter

FLIGHT: dict[str, tuple[str, str, float, Callable[[Any, Any, Any], tuple[Any, Any]]]] = {
    # formula, unit of the coefficient, typical size, term of (vx, vy, gap)
    "constant_vertical": ("c", "m/s^2", 0.1, lambda vx, vy, z: (0 * vx, 1 + 0 * vy)),
    "constant_sideways": ("c e_x", "m/s^2", 0.1, lambda vx, vy, z: (1 + 0 * vx, 0 * vy)),
    "v": ("c v", "1/s", 0.1, lambda vx, vy, z: (vx, vy)),
    "v|v|": ("c v |v|", "1/m", 0.05, lambda vx, vy, z: (vx * np.hypot(vx, vy), vy * np.hypot(vx, vy))),
    "v^3": ("c v^3", "s/m^2", 0.02, lambda vx, vy, z: (vx * (vx**2 + vy**2), vy * (vx**2 + vy**2))),
    "v_cross": ("c e_z x v", "1/s", 0.1, lambda vx, vy, z: (-vy, vx)),
    "height": ("c z", "1/s^2", 0.3, lambda vx, vy, z: (0 * vx, z)),
    "height^2": ("c z^2", "1/(m s^2)", 0.5, lambda vx, vy, z: (0 * vx, z * z)),
    "near_5mm": ("c exp(-z / 5 mm)", "m/s^2", 1.0, lambda vx, vy, z: (0 * vx, np.exp(-np.abs(z) / 0.005))),
    "near_20mm": ("c exp(-z / 20 mm)", "m/s^2", 0.5, lambda vx, vy, z: (0 * vx, np.exp(-np.abs(z) / 0.02))),
    "near_80mm": ("c exp(-z / 80 mm)", "m/s^2", 0.3, lambda vx, vy, z: (0 * vx, np.exp(-np.abs(z) / 0.08))),
}
SWING: dict[str, tuple[str, str, float, Callable[[Any, Any], Any]]] = {
    # formula, unit, typical size, angular acceleration from angle and rate
    "sign(rate)": ("c sign(w)", "rad/s^2", 0.02, lambda a, w: np.sign(w)),
    "rate": ("c w", "1/s", 0.02, lambda a, w: w),
    "rate|rate|": ("c w |w|", "1", 0.01, lambda a, w: w * np.abs(w)),
    "rate^3": ("c w^3", "s", 0.003, lambda a, w: w**3),
    "angle^2 rate": ("c a^2 w", "1/s", 0.1, lambda a, w: a * a * w),
    "angle": ("c a", "1/s^2", 0.1, lambda a, w: a),
    "angle^2": ("c a^2", "1/s^2", 0.1, lambda a, w: a * a),
    "angle^3": ("c a^3", "1/s^2", 0.1, lambda a, w: a**3),
    "constant": ("c", "rad/s^2", 0.05, lambda a, w: 1.0 + 0 * a),
    "|angle| sign(rate)": ("c |a| sign(w)", "1/s^2", 0.05, lambda a, w: np.abs(a) * np.sign(w)),
}
IMPACT: dict[str, tuple[str, str, float, Callable[[Any, Any], Any]]] = {
    # formula, unit, typical size, change of the restitution from speed and the plain restitution
    "e~v": ("e + c v", "s/m", 0.02, lambda v, e: v),
    "e~1/v": ("e + c / v", "m/s", 0.01, lambda v, e: 1 / (v + 0.02)),
    "e~v^2": ("e + c v^2", "s^2/m^2", 0.01, lambda v, e: v * v),
    "e~bump": (
        "e + c exp(-(v - 1.5 m/s)^2 / 2 (0.7 m/s)^2)",
        "1",
        0.03,
        lambda v, e: np.exp(-(((v - 1.5) / 0.7) ** 2) / 2),
    ),
}
ROLL: dict[str, tuple[str, str, float, Callable[[Any, Any], Any]]] = {
    # formula, unit, typical size, acceleration along the track from place and speed
    "constant": ("c", "m/s^2", 0.02, lambda s, v: 1.0 + 0 * s),
    "v": ("c v", "1/s", 0.05, lambda s, v: v),
    "v|v|": ("c v |v|", "1/m", 0.05, lambda s, v: v * np.abs(v)),
    "place": ("c s", "1/s^2", 0.1, lambda s, v: s),
    "place^2": ("c s^2", "1/(m s^2)", 0.3, lambda s, v: s * s),
}


def nameless(rig: str) -> list[Effect]:
    """The terms that can act in a rig, as effects with one free coefficient."""
    terms = []
    if rig == "drop":
        for name, (formula, unit, size, term) in FLIGHT.items():
            terms.append(_effect(name, f"force per mass {formula}", unit, size, rig, force=_force(term)))
    if rig in ("pendulum", "double"):
        for name, (formula, unit, size, swing) in SWING.items():
            text = f"angular acceleration {formula}"
            terms.append(_effect(name, text, unit, size, rig, torque=_torque(swing)))
    if rig in ("drop", "double"):
        for name, (formula, unit, size, impact) in IMPACT.items():
            text = f"restitution {formula}"
            terms.append(_effect(name, text, unit, size, rig, restitution=_restitution(impact)))
    if rig in ("roll", "slide"):
        for name, (formula, unit, size, rolling) in ROLL.items():
            text = f"acceleration along the track {formula}"
            terms.append(_effect(name, text, unit, size, rig, torque=_torque(rolling)))
    return terms


def _effect(name: str, formula: str, unit: str, size: float, rig: str, **hooks: Any) -> Effect:
    return Effect(
        name=f"form:{name}",
        title=formula,
        kind="physical",
        rigs=(rig,),
        parameters=(Parameter("c", unit, -1e9, 1e9, size),),
        equation=formula,
        source="regression on the residual",
        **hooks,
    )


def _force(term: Any) -> Any:
    def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any) -> Any:
        ax, ay = term(vx, vy, gap)
        return mass * c * ax, mass * c * ay

    return force


def _torque(term: Any) -> Any:
    def torque(angle: Any, rate: Any, length: Any, mass: Any, c: Any) -> Any:
        return mass * length * length * c * term(angle, rate)

    return torque


def _restitution(term: Any) -> Any:
    def restitution(e: Any, speed: Any, radius: Any, mass: Any, c: Any) -> Any:
        return e + c * term(speed, e)

    return restitution
