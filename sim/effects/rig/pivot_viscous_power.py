"""Viscous friction in the pivot whose torque grows with a fitted power of the angular velocity: a greased bearing.

Formula: M = -c omega (|omega| / 1 rad/s)^a

omega is the angular velocity, c is `damping`.

Parameters:
- `damping` [N m s], 0 to 0.01, typically 1e-06: torque per rate at 1 rad/s
- `rate_exponent` [dimensionless], -0.6 to 0.3, typically -0.3: a, 0 of a full film of oil, -1/3 of a greased bearing

Source: Palmgren 1959, chapter 3 (two thirds of the rate); Nelson & Olsson 1986 (proportional to it)
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

SLOW = 1e-3  # [rad/s], added in quadrature, so that a power of zero is finite; no film shows so slow a turn


def torque(angle: Any, rate: Any, length: Any, mass: Any, damping: Any, rate_exponent: Any) -> Any:
    """[N m] -c omega (|omega| / 1 rad/s)^a."""
    return -damping * rate * (rate * rate + SLOW * SLOW) ** (0.5 * rate_exponent)


EFFECT = Effect(
    name="pivot_viscous_power",
    title="pivot viscous damping (power of the rate)",
    kind="physical",
    family="pivot_viscous",
    rigs=("pendulum", "double"),
    parameters=(
        Parameter("damping", "N m s", 0.0, 1e-2, 1e-6, starts=(1e-6,), meaning="torque per rate at 1 rad/s"),
        Parameter("rate_exponent", "1", -0.6, 0.3, -0.3, assumed=(-0.15, 0.2), meaning="a"),
    ),
    equation="M = -c omega (|omega| / 1 rad/s)^a",
    source="Palmgren 1959; Nelson & Olsson 1986",
    synonyms=("viscous pivot", "bearing friction", "viscous damping", "viscous hinge", "pivot viscous friction"),
    torque=torque,
    free=True,
    splits="two bobs of one size and different mass, and a longer ring-down: its decay is nearly exponential",
)
