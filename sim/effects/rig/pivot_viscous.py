"""Viscous friction in the pivot: a torque proportional to the angular velocity.

Formula: M = -c omega

omega is the angular velocity, c is `damping`.

Parameters:
- `damping` [N m s], 0 to 0.01, typically 1e-06: torque per rate

Source: viscous damping; Nelson & Olsson 1986
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def torque(angle: Any, rate: Any, length: Any, mass: Any, damping: Any) -> Any:
    """[N m] -c omega."""
    return -damping * rate


EFFECT = Effect(
    name="pivot_viscous",
    title="pivot viscous damping",
    kind="physical",
    rigs=("pendulum", "double"),
    parameters=(Parameter("damping", "N m s", 0.0, 1e-2, 1e-6, meaning="torque per rate"),),
    equation="M = -c omega",
    source="viscous damping; Nelson & Olsson 1986",
    synonyms=("viscous pivot", "linear damping", "viscous damping", "viscous hinge", "pivot viscous friction"),
    torque=torque,
    splits="two bobs of one size and different mass, and a longer ring-down: its decay is exponential",
)
