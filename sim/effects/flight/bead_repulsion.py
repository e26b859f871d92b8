"""Repulsion of two beads with charges of the same sign.

Formula: F = F_0 (2 R / d)^2

d is the distance of the centres, F_0 the `force` of beads that touch; a force below zero attracts.

Parameters:
- `force` [N], -0.1 to 0.1, typically 0.0001: repulsion of beads that touch

Source: Coulomb 1785; Jackson 1999, section 1.1
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def mutual(distance: Any, radius: Any, mass: Any, force: Any) -> Any:
    """[N] apart: F_0 (2 R / d)^2."""
    return force * 4.0 * radius * radius / (distance * distance)


EFFECT = Effect(
    name="bead_repulsion",
    title="repulsion of the beads",
    kind="physical",
    family="bead_repulsion",
    rigs=("double",),
    parameters=(Parameter("force", "N", -0.1, 0.1, 1e-4, meaning="repulsion of beads that touch"),),
    equation="F = F_0 (2 R / d)^2",
    source="Coulomb 1785; Jackson 1999, section 1.1",
    synonyms=("charge repulsion", "electrostatic repulsion", "beads repel", "mutual repulsion", "charged beads"),
    mutual=mutual,
    splits="discharge both beads (ioniser), or earth them by conducting threads",
)
