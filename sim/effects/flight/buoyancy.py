"""Buoyancy and added mass in air: a light bead falls with less than g.

Formula: g' = g (1 - s)/(1 + s/2), s = rho_air/rho_bead

s is the ratio of densities, with rho_air = 1.2 kg/m^3.

Parameters:
- `multiplier` [dimensionless], 0 to 4, typically 1: 1 in air of 1.2 kg/m^3

Source: Batchelor 1967, section 6.8
"""

from typing import Any

from rigtwin.lab.materials import AIR_DENSITY
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.effects.effect import Effect, Parameter


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, multiplier: Any) -> Any:
    """[N] upwards, so that the bead falls with g (1 - s)/(1 + s/2), s = rho_air/rho_bead."""
    ratio = AIR_DENSITY * 4.1887902047863905 * radius**3 / mass
    lift = multiplier * mass * GRAVITY * 1.5 * ratio / (1.0 + 0.5 * ratio)
    return 0.0 * vx, lift + 0.0 * vy


EFFECT = Effect(
    name="buoyancy",
    title="buoyancy and added mass",
    kind="physical",
    rigs=("drop", "pendulum", "double"),
    parameters=(Parameter("multiplier", "1", 0.0, 4.0, 1.0, predicted=1.0, meaning="1 in air of 1.2 kg/m^3"),),
    equation="g' = g (1 - s)/(1 + s/2), s = rho_air/rho_bead",
    source="Batchelor 1967, section 6.8",
    synonyms=("archimedes", "buoyant force", "added mass"),
    force=force,
    splits="a dense ball of the same size: buoyancy goes with 1/density, a wrong scale or clock does not",
)
