"""Linear (Stokes) drag of the air.

Formula: F = 6 pi eta R v

eta = 1.81e-5 Pa s, R the radius, v the speed.

Parameters:
- `multiplier` [dimensionless], 0 to 500, typically 10: 1 for Re << 1

Source: Stokes 1851
"""

from typing import Any

from rigtwin.lab.materials import AIR_VISCOSITY
from rigtwin.sim.effects.effect import Effect, Parameter


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, multiplier: Any) -> Any:
    """[N] against the velocity: 6 pi eta R v."""
    pull = -multiplier * 6.0 * 3.141592653589793 * AIR_VISCOSITY * radius
    return pull * vx, pull * vy


EFFECT = Effect(
    name="linear_drag",
    title="linear (Stokes) drag",
    kind="physical",
    rigs=("drop", "pendulum", "double", "roll"),
    parameters=(Parameter("multiplier", "1", 0.0, 500.0, 10.0, predicted=1.0, meaning="1 for Re << 1"),),
    equation="F = 6 pi eta R v",
    source="Stokes 1851",
    synonyms=("stokes drag", "viscous drag", "linear air drag", "viscous air resistance"),
    force=force,
    splits="greater heights: linear and quadratic drag part as the speed grows",
)
