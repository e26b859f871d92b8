"""Electrostatic attraction of a charged bead by its image charge in the plate.

Formula: F = q^2 / (16 pi eps0 z^2)

q is `charge`, z the distance from the plate to the bead's centre.

Parameters:
- `charge` [C], 0 to 2e-08, typically 5e-10: charge of the bead

Source: image charge; Jackson 1999, section 2.1
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, charge: Any) -> Any:
    """[N] towards the plate: q |q| / (16 pi eps0 z^2), z from the plate to the bead's centre."""
    distance = 0.5 * (gap + abs(gap)) + radius
    pull = -charge * abs(charge) * 2.2468879468420e9 / (distance * distance)
    return 0.0 * vx, pull + 0.0 * vy


EFFECT = Effect(
    name="electrostatic",
    title="electrostatic attraction",
    kind="physical",
    family="electrostatic",
    rigs=("drop",),
    parameters=(Parameter("charge", "C", 0.0, 2e-8, 5e-10, starts=(1e-9,), meaning="charge of the bead"),),
    equation="F = q^2 / (16 pi eps0 z^2)",
    source="image charge; Jackson 1999, section 2.1",
    synonyms=("electrostatic force", "static charge", "image charge", "charging", "electrostatics"),
    force=force,
    steep=True,
    flat=True,
    splits="discharge the bead (ioniser) or earth the plate, and compare the low bounces",
)
