"""Quadratic air drag: form drag of a sphere with a constant drag coefficient.

Formula: F = rho_air C_D pi R^2 v^2 / 2

rho_air = 1.2 kg/m^3, R the radius, v the speed.

Parameters:
- `drag_coefficient` [dimensionless], 0 to 5, typically 0.44: C_D

Source: Newton 1687; Clift, Grace, Weber 1978, table 5.2 (C_D of a sphere 0.44 for Re > 1000)
"""

from typing import Any

from rigtwin.lab.materials import AIR_DENSITY
from rigtwin.sim.effects.effect import Effect, Parameter

DRAG_OF_A_SPHERE = 0.44  # in Newton's range


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, drag_coefficient: Any) -> Any:
    """[N] against the velocity: rho C_D (pi R^2) v^2 / 2."""
    speed = (vx * vx + vy * vy) ** 0.5
    pull = -0.5 * AIR_DENSITY * drag_coefficient * 3.141592653589793 * radius * radius * speed
    return pull * vx, pull * vy


EFFECT = Effect(
    name="air_drag",
    title="air drag",
    kind="physical",
    family="air_drag",
    rigs=("drop", "pendulum", "double", "roll"),
    parameters=(
        Parameter("drag_coefficient", "1", 0.0, 5.0, 0.44, predicted=DRAG_OF_A_SPHERE, starts=(0.44,), meaning="C_D"),
    ),
    equation="F = rho_air C_D pi R^2 v^2 / 2",
    source="Newton 1687; Clift, Grace, Weber 1978, table 5.2 (C_D of a sphere 0.44 for Re > 1000)",
    synonyms=("aerodynamic drag", "quadratic drag", "air resistance", "form drag"),
    force=force,
    splits="drop a dense control ball (steel) of the same size from the greatest height: drag goes with 1/density",
)
