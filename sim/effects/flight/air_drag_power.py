"""Air drag whose coefficient varies with the speed by a fitted power: rough, holed or not quite round beads.

Formula: F = rho_air C_D pi R^2 v^2 / 2, C_D = C (v / 1 m/s)^a

rho_air = 1.2 kg/m^3, R the radius, v the speed.

Parameters:
- `drag_coefficient` [dimensionless], 0 to 5, typically 0.44: C_D at 1 m/s
- `speed_exponent` [dimensionless], -0.7 to 0.3, typically -0.2: a, between the intermediate range and a rough sphere

Source: Clift, Grace & Weber 1978, chapters 5 and 6
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter
from rigtwin.sim.effects.flight import air_drag

SLOW = 1e-4  # [m/s], lower limit of the speed in a power


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, drag_coefficient: Any, speed_exponent: Any) -> Any:
    """[N] against the velocity, as `air_drag` with C_D = C (v / 1 m/s)^a."""
    speed = (vx * vx + vy * vy + SLOW * SLOW) ** 0.5
    return air_drag.force(vx, vy, gap, radius, mass, drag_coefficient * speed**speed_exponent)


EFFECT = Effect(
    name="air_drag_power",
    title="air drag (power of the speed)",
    kind="physical",
    family="air_drag",
    rigs=("drop", "pendulum", "double", "roll"),
    parameters=(
        Parameter("drag_coefficient", "1", 0.0, 5.0, 0.44, starts=(0.44,), meaning="C_D at 1 m/s"),
        Parameter("speed_exponent", "1", -0.7, 0.3, 0.1, assumed=(-0.2, 0.2), meaning="a"),
    ),
    equation="F = rho_air C_D pi R^2 v^2 / 2, C_D = C (v / 1 m/s)^a",
    source="Clift, Grace & Weber 1978, chapters 5 and 6",
    synonyms=("air drag", "aerodynamic drag", "air resistance", "form drag"),
    force=force,
    free=True,
    splits="drop a dense control ball (steel) of the same size from the greatest height: drag goes with 1/density",
)
