"""Air drag of a sphere from the Stokes through the intermediate to the Newton range (Schiller-Naumann).

Formula: F = 6 pi eta R v (1 + 0.15 Re^0.687) with Re = 2 R v rho / eta; C_D = 0.44 beyond Re = 1000

eta = 1.81e-5 Pa s, rho = 1.2 kg/m^3; without a free coefficient for a smooth sphere.

Parameters:
- `multiplier` [dimensionless], 0 to 5, typically 1: 1 for a smooth sphere

Source: Schiller & Naumann 1933; Clift, Grace & Weber 1978
"""

from typing import Any

from rigtwin.lab.materials import AIR_DENSITY, AIR_VISCOSITY
from rigtwin.sim.effects.effect import Effect, Parameter
from rigtwin.sim.effects.flight.air_drag import DRAG_OF_A_SPHERE


def resistance(speed: Any, radius: Any, density: Any, viscosity: Any) -> Any:
    """[N s/m] force over speed of a sphere: 6 pi eta R (1 + 0.15 Re^0.687), C_D = 0.44 beyond Re = 1000."""
    reynolds = 2.0 * radius * density / viscosity * speed
    stokes = 1.0 + 0.15 * (reynolds + 1e-9) ** 0.687
    newton = DRAG_OF_A_SPHERE / 24.0 * reynolds
    # the larger of the two, without a branch: they meet at Re = 1000
    over = 0.5 * (stokes + newton + abs(stokes - newton))
    return 6.0 * 3.141592653589793 * viscosity * radius * over


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, multiplier: Any) -> Any:
    """[N] against the velocity: 6 pi eta R v (1 + 0.15 Re^0.687), C_D = 0.44 beyond Re = 1000."""
    speed = (vx * vx + vy * vy) ** 0.5
    pull = -multiplier * resistance(speed, radius, AIR_DENSITY, AIR_VISCOSITY)
    return pull * vx, pull * vy


EFFECT = Effect(
    name="air_drag_schiller_naumann",
    title="air drag (Schiller-Naumann)",
    kind="physical",
    family="air_drag",
    rigs=("drop", "pendulum", "double", "roll"),
    parameters=(
        Parameter("multiplier", "1", 0.0, 5.0, 1.0, predicted=1.0, starts=(1.0,), meaning="1 for a smooth sphere"),
    ),
    equation="F = 6 pi eta R v (1 + 0.15 Re^0.687) with Re = 2 R v rho / eta; C_D = 0.44 beyond Re = 1000",
    source="Schiller & Naumann 1933; Clift, Grace & Weber 1978",
    synonyms=("air drag", "aerodynamic drag", "air resistance"),
    force=force,
    splits="drop a dense control ball (steel) of the same size from the greatest height: drag goes with 1/density",
)
