"""Adhesion at an impact with a loss of energy that depends on the size of the bead by a fitted power.

Formula: e'^2 = e^2 - 2 W/(m v^2), W = work (R / 3 mm)^n

n = 4/3 for elastic spheres (JKR), 2 for a loss in proportion to the contact area of hard grains, 0 for a fixed loss.

Parameters:
- `work` [J], 0 to 0.0001, typically 1e-07: energy lost per impact of a 6 mm bead
- `size_exponent` [dimensionless], -1 to 4, typically 1.3: n

Source: Johnson, Kendall & Roberts 1971; Derjaguin, Muller & Toporov 1975; Thornton & Ning 1998
"""

from typing import Any

from rigtwin.sim.effects.adhesion import adhesion
from rigtwin.sim.effects.effect import Effect, Parameter


def restitution(e: Any, speed: Any, radius: Any, mass: Any, work: Any, size_exponent: Any) -> Any:
    """e'^2 = e^2 - 2 W / (m v^2), W = work (R / 3 mm)^n; zero where the bead sticks."""
    own = work * (radius / 0.003) ** (size_exponent - 1.3333333333333333)
    return adhesion.restitution(e, speed, radius, mass, own)


EFFECT = Effect(
    name="adhesion_size",
    title="adhesion (loss by size)",
    kind="physical",
    family="adhesion",
    rigs=("drop", "double"),
    parameters=(
        Parameter("work", "J", 0.0, 1e-4, 1e-7, meaning="energy lost per impact of a 6 mm bead"),
        Parameter("size_exponent", "1", -1.0, 4.0, 0.3, assumed=(1.3333, 1.0), meaning="n"),
    ),
    equation="e'^2 = e^2 - 2 W/(m v^2), W = work (R / 3 mm)^n",
    source="Johnson, Kendall & Roberts 1971; Derjaguin, Muller & Toporov 1975; Thornton & Ning 1998",
    synonyms=("cohesion", "jkr", "dmt", "sticking", "surface energy", "stickiness", "capillary bridge"),
    restitution=restitution,
    free=True,
    splits="low drops (5 to 50 mm) dry and humid: adhesion stops the last bounces and changes with humidity",
)
