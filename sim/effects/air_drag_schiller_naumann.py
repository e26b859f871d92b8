"""Air drag of a sphere at intermediate Reynolds numbers: between Stokes and Newton, no free coefficient."""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

AIR_DENSITY = 1.2  # [kg/m^3]
AIR_VISCOSITY = 1.8e-5  # [Pa s]


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, multiplier: Any) -> Any:
    """[N] against the velocity: 6 pi eta R v (1 + 0.15 Re^0.687)."""
    speed = (vx * vx + vy * vy) ** 0.5
    reynolds = 2.0 * radius * AIR_DENSITY / AIR_VISCOSITY * speed
    pull = -multiplier * 6.0 * 3.141592653589793 * AIR_VISCOSITY * radius * (1.0 + 0.15 * (reynolds + 1e-9) ** 0.687)
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
    equation="F = 6 pi eta R v (1 + 0.15 Re^0.687), Re = 2 R v rho / eta < 1000",
    source="Schiller & Naumann 1933",
    synonyms=("air drag", "aerodynamic drag", "air resistance"),
    force=force,
    splits="drop a dense control ball (steel) of the same size from the greatest height: drag goes with 1/density",
)
