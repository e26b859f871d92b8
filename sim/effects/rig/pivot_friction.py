"""Dry (Coulomb) friction in the pivot: a constant torque against the motion.

Formula: M = -M_c sign(omega)

omega is the angular velocity, M_c is `moment`.

Parameters:
- `moment` [N m], 0 to 0.001, typically 1e-06: friction torque

Source: Coulomb 1785
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def torque(angle: Any, rate: Any, length: Any, mass: Any, moment: Any) -> Any:
    """[N m] constant, against the rate; smooth only within 1e-4 rad/s of rest."""
    return -moment * rate / (rate * rate + 1e-8) ** 0.5


EFFECT = Effect(
    name="pivot_friction",
    title="pivot friction (Coulomb)",
    kind="physical",
    family="pivot_friction",
    rigs=("pendulum", "double"),
    parameters=(Parameter("moment", "N m", 0.0, 1e-3, 1e-6, meaning="friction torque"),),
    equation="M = -M_c sign(omega)",
    source="Coulomb 1785",
    synonyms=("dry pivot friction", "hinge friction", "bearing friction", "coulomb pivot", "pivot coulomb"),
    torque=torque,
    splits="a longer ring-down: dry friction takes the same angle from each swing and stops it off centre",
)
