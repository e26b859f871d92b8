"""Air drag of a smooth sphere by the standard drag curve, in the fit of Brown and Lawler.

Formula: C_D = 24 / Re (1 + 0.15 Re^0.681) + 0.407 / (1 + 8710 / Re), Re < 2e5

F = C_D rho pi R^2 v^2 / 2 with Re = 2 R v rho / eta, rho = 1.2 kg/m^3, eta = 1.81e-5 Pa s.

Parameters:
- `multiplier` [dimensionless], 0 to 5, typically 1: 1 for a smooth sphere

Source: Brown & Lawler 2003
"""

from typing import Any

from rigtwin.lab.materials import AIR_DENSITY, AIR_VISCOSITY
from rigtwin.sim.effects.effect import Effect, Parameter


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, multiplier: Any) -> Any:
    """[N] against the velocity: Stokes' 6 pi eta R v times C_D Re / 24."""
    speed = (vx * vx + vy * vy) ** 0.5
    reynolds = 2.0 * radius * AIR_DENSITY / AIR_VISCOSITY * speed
    over = 1.0 + 0.15 * (reynolds + 1e-9) ** 0.681 + 0.407 / 24.0 * reynolds * reynolds / (reynolds + 8710.0)
    pull = -multiplier * 6.0 * 3.141592653589793 * AIR_VISCOSITY * radius * over
    return pull * vx, pull * vy


EFFECT = Effect(
    name="air_drag_standard",
    title="air drag (standard drag curve)",
    kind="physical",
    family="air_drag",
    rigs=("drop", "pendulum", "double", "roll"),
    parameters=(
        Parameter("multiplier", "1", 0.0, 5.0, 1.0, predicted=1.0, starts=(1.0,), meaning="1 for a smooth sphere"),
    ),
    equation="C_D = 24 / Re (1 + 0.15 Re^0.681) + 0.407 / (1 + 8710 / Re), Re < 2e5",
    source="Brown & Lawler 2003",
    synonyms=("air drag", "drag curve", "sphere drag", "air resistance", "drag"),
    force=force,
    splits="a denser bead of the same size: drag per mass falls with the density",
)
