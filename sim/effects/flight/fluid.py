"""A liquid around the bead: buoyancy, added mass and drag together.

Formula: (m + m_l/2) a = (m_l - m) g - F_D, m_l = rho 4/3 pi R^3

F_D = exp(excess_drag) 6 pi eta R v (1 + 0.15 Re^0.687) with Re = 2 R v rho / eta, and C_D = 0.44 beyond Re = 1000.

Parameters:
- `density` [kg/m^3], 300 to 3000, typically 1000: rho of the liquid
- `log_viscosity` [dimensionless], -1 to 3.5, typically 0: log10 of eta in mPa s; 0 for water
- `excess_drag` [dimensionless], -0.3 to 0.4, typically 0: logarithm of F_D over the formula, uncertain by 0.1

Source: Batchelor 1967, section 6.8; Schiller & Naumann 1933; Clift, Grace & Weber 1978
"""

from typing import Any

from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.effects.effect import Effect, Parameter
from rigtwin.sim.effects.flight.air_drag_schiller_naumann import resistance


def force(
    vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, density: Any, log_viscosity: Any, excess_drag: Any
) -> Any:
    """[N] beside the weight: what gives the bead of this mass alone the acceleration that it has with the liquid."""
    viscosity = 1e-3 * 10.0**log_viscosity
    displaced = density * 4.1887902047863905 * radius**3
    speed = (vx * vx + vy * vy) ** 0.5
    pull = -(2.718281828459045**excess_drag) * resistance(speed, radius, abs(density), viscosity)
    # a density of zero is a vacuum, which has no viscosity
    pull = pull * density * density / (density * density + 1.0)
    share = mass / (mass + 0.5 * displaced)
    return share * pull * vx, share * (pull * vy + (displaced - mass) * GRAVITY) + mass * GRAVITY


EFFECT = Effect(
    name="fluid",
    title="surrounding liquid (buoyancy, added mass and drag)",
    kind="physical",
    rigs=("drop",),
    parameters=(
        Parameter("density", "kg/m^3", 300.0, 3000.0, 1000.0, starts=(1000.0,), meaning="rho of the liquid"),
        Parameter(
            "log_viscosity",
            "1",
            -1.0,
            3.5,
            0.3,
            assumed=(0.0, 1.0),
            starts=(0.0, 1.0, 1.75, 2.5),
            meaning="log10 of eta in mPa s; 0 for water",
        ),
        Parameter(
            "excess_drag",
            "1",
            -0.3,
            0.4,
            0.1,
            assumed=(0.0, 0.1),
            bounded=True,
            meaning="logarithm of F_D over the formula, uncertain by 0.1",
        ),
    ),
    equation="(m + m_l/2) a = (m_l - m) g - F_D, m_l = rho 4/3 pi R^3",
    source="Batchelor 1967, section 6.8; Schiller & Naumann 1933; Clift, Grace & Weber 1978",
    synonyms=("liquid", "water", "immersion", "buoyancy and drag", "submerged", "viscous liquid"),
    force=force,
    slow=True,
    splits="beads of two densities in the same liquid: the denser one is held up less",
)
