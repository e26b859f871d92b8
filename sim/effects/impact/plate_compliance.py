"""Plate compliance: bending waves in a thin plate carry energy away, more for larger, denser and faster beads.

Formula: e = e_0 exp(-1.72 k lambda (v / 1 m/s)^(1/5)), lambda = pi^(3/5)/sqrt(3) (R/h)^2 rho^(3/5) E*^(2/5) / (rho_p
    E_p/(1 - nu_p^2))^(1/2)

k is `strength`, e_0 the restitution on a rigid block, lambda Zener's inelasticity at 1 m/s, h the plate's thickness,
R and rho the bead's radius and density, rho_p, E_p and nu_p the plate's density, modulus and Poisson's ratio.

Parameters:
- `strength` [dimensionless], 0 to 300, typically 10: loss over that to a wide plate that bends freely
- `plate` [dimensionless], 0 to 10, typically 0.005: Zener's inelasticity at 1 m/s of a bead of 6 mm and 1000 kg/m^3
  on the plate; 0.005 for wood on 10 mm of glass

Source: Zener 1941
"""

import math
from collections.abc import Mapping
from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

SOLID = 4.1887902047863905  # 4 pi / 3
PER_WAVE = math.pi**0.6 / math.sqrt(3)
PER_LOSS = 1.72  # -ln e of an inelasticity of one, from Zener's equation
SIZE, DENSITY = 0.003, 1000.0  # [m], [kg/m^3], of the bead that `plate` speaks of


def restitution(e: Any, speed: Any, radius: Any, mass: Any, strength: Any, plate: Any) -> Any:
    """e' = e exp(-1.72 k lambda v^(1/5)); `e` is the value on a block, lambda Zener's inelasticity at 1 m/s."""
    density = mass / (SOLID * radius**3)
    inelasticity = plate * (radius / SIZE) ** 2 * (density / DENSITY) ** 0.6
    return e * 2.718281828459045 ** (-PER_LOSS * strength * inelasticity * (speed + 1e-9) ** 0.2)


def waves(bead: Mapping[str, Any], wall: Mapping[str, Any]) -> float:
    """The inelasticity at 1 m/s of a bead of 6 mm and 1000 kg/m^3 that is as stiff as this one, on this plate."""
    own, plate = (one["youngs_modulus_Pa"] / (1 - one["poissons_ratio"] ** 2) for one in (bead, wall))
    both = 1 / (1 / own + 1 / plate)
    size = (SIZE / wall["thickness_m"]) ** 2
    return float(PER_WAVE * size * DENSITY**0.6 * both**0.4 / (wall["density_kg_m3"] * plate) ** 0.5)


EFFECT = Effect(
    name="plate_compliance",
    title="plate compliance",
    kind="physical",
    family="velocity_dependent_restitution",
    rigs=("drop",),
    parameters=(
        Parameter("strength", "1", 0.0, 300.0, 10.0, meaning="loss over that to a wide plate that bends freely"),
        Parameter(
            "plate", "1", 0.0, 10.0, 0.005, assumed=(0.005, 1e-9), stated=waves,
            meaning="Zener's inelasticity at 1 m/s of a bead of 6 mm and 1000 kg/m^3 on the plate; 0.005 for wood on "
            "10 mm of glass",
        ),
    ),
    equation="e = e_0 exp(-1.72 k lambda (v / 1 m/s)^(1/5)), "
    "lambda = pi^(3/5)/sqrt(3) (R/h)^2 rho^(3/5) E*^(2/5) / (rho_p E_p/(1 - nu_p^2))^(1/2)",
    source="Zener 1941",
    synonyms=("plate flexibility", "elastic plate", "plate vibration", "flexural waves", "base flexibility"),
    restitution=restitution,
    special=True,
    splits="a plate twice as thick, or backed by a block: bending waves vanish, losses in the bead stay",
)  # fmt: skip
