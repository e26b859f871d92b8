"""Adhesion at an impact: each impact loses a fixed energy, so slow impacts rebound less and finally stick.

Formula: e'^2 = e^2 - 2 W/(m v^2), W ~ R^(4/3)

W = work (R / 3 mm)^(4/3), v the impact speed, m and R mass and radius of the bead.

Parameters:
- `work` [J], 0 to 0.0001, typically 1e-07: energy lost per impact of a 6 mm bead

Source: Johnson, Kendall & Roberts 1971; Thornton & Ning 1998
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def restitution(e: Any, speed: Any, radius: Any, mass: Any, work: Any) -> Any:
    """e'^2 = e^2 - 2 W / (m v^2), W = work (R / 3 mm)^(4/3); zero where the bead sticks."""
    energy = work * (radius / 0.003) ** 1.3333333333333333
    left = e * e - 2.0 * energy / (mass * speed * speed + 1e-18)
    return (0.5 * (left + abs(left)) + 1e-12) ** 0.5


EFFECT = Effect(
    name="adhesion",
    title="adhesion",
    kind="physical",
    family="adhesion",
    rigs=("drop", "double"),
    parameters=(
        Parameter("work", "J", 0.0, 1e-4, 1e-7, starts=(1e-7, 1e-6), meaning="energy lost per impact of a 6 mm bead"),
    ),
    equation="e'^2 = e^2 - 2 W/(m v^2), W ~ R^(4/3)",
    source="Johnson, Kendall & Roberts 1971; Thornton & Ning 1998",
    synonyms=("cohesion", "jkr", "sticking", "surface energy", "stickiness", "capillary bridge"),
    restitution=restitution,
    flat=True,
    splits="low drops (5 to 50 mm) dry and humid: adhesion stops the last bounces and changes with humidity",
)
