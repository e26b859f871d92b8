"""Repulsion of two beads that acts over a short distance: poles of magnets, or a layer on the surfaces.

Formula: F = F_0 exp(-(d - 2 R) / l)

d is the distance of the centres, F_0 the `force` of beads that touch, l the `reach`.

Parameters:
- `force` [N], -0.1 to 0.1, typically 0.0001: repulsion of beads that touch
- `reach` [m], 0.0005 to 0.1, typically 0.005: l

Source: empirical
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

E = 2.718281828459045


def mutual(distance: Any, radius: Any, mass: Any, force: Any, reach: Any) -> Any:
    """[N] apart: F_0 exp(-(d - 2 R) / l), with a reach of half a millimetre at least."""
    away = 0.5 * (reach + 0.0005 + abs(reach - 0.0005))
    return force * E ** (-(distance - 2.0 * radius) / away)


EFFECT = Effect(
    name="bead_repulsion_short",
    title="repulsion of the beads (short distance)",
    kind="physical",
    family="bead_repulsion",
    rigs=("double",),
    parameters=(
        Parameter("force", "N", -0.1, 0.1, 1e-4, meaning="repulsion of beads that touch"),
        Parameter("reach", "m", 5e-4, 0.1, 1e-3, assumed=(0.006, 0.004), meaning="l"),
    ),
    equation="F = F_0 exp(-(d - 2 R) / l)",
    source="empirical",
    synonyms=("repulsion", "beads repel", "mutual repulsion", "magnetic repulsion"),
    mutual=mutual,
    splits="discharge both beads (ioniser), or earth them by conducting threads",
)
