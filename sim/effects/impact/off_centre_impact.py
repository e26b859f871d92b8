"""Off-centre impact: the beads do not meet on their line of centres; part of the impulse leaves the plane of motion.

Formula: 1 + e' = (1 + e)(1 - (b/d)^2)

e is the restitution along the line of centres, e' the one seen in the plane of motion.

Parameters:
- `offset` [dimensionless], 0 to 0.9, typically 0.2: b/d, of a diameter

Source: geometry; Foerster et al. 1994
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def restitution(e: Any, speed: Any, radius: Any, mass: Any, offset: Any) -> Any:
    """Seen in the plane: (1 + e') = (1 + e)(1 - b^2/d^2), from the normal turned by sin(gamma) = b/d."""
    return (1.0 + e) * (1.0 - offset * offset) - 1.0


EFFECT = Effect(
    name="off_centre_impact",
    title="off-centre impact",
    kind="physical",
    rigs=("double",),
    parameters=(Parameter("offset", "1", 0.0, 0.9, 0.2, starts=(0.3,), meaning="b/d, of a diameter"),),
    equation="1 + e' = (1 + e)(1 - (b/d)^2)",
    source="geometry; Foerster et al. 1994",
    synonyms=("oblique impact", "non-central impact", "eccentric impact", "misaligned pendulums", "non-spherical"),
    restitution=restitution,
    even=True,
    splits="film from above: the beads then part sideways",
)
