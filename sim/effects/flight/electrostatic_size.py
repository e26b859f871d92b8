"""Electrostatic attraction by the image charge in the plate, with a charge that depends on the size of the bead.

Formula: F = q^2 / (16 pi eps0 z^2), q = Q (R / 3 mm)^n

z is the distance from the plate to the bead's centre; n = 2 if the charge goes with the surface.

Parameters:
- `charge` [C], 0 to 2e-08, typically 5e-10: Q, charge of a bead of 6 mm
- `size_exponent` [dimensionless], -1 to 4, typically 1: n

Source: image charge; Jackson 1999, section 2.1
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter
from rigtwin.sim.effects.flight import electrostatic


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, charge: Any, size_exponent: Any) -> Any:
    """[N] towards the plate, as `electrostatic` with the charge Q (R / 3 mm)^n."""
    return electrostatic.force(vx, vy, gap, radius, mass, charge * (radius / 0.003) ** size_exponent)


EFFECT = Effect(
    name="electrostatic_size",
    title="electrostatic attraction (charge by size)",
    kind="physical",
    family="electrostatic",
    rigs=("drop",),
    parameters=(
        Parameter("charge", "C", 0.0, 2e-8, 5e-10, starts=(1e-9,), meaning="Q, charge of a bead of 6 mm"),
        Parameter("size_exponent", "1", -1.0, 4.0, 0.5, assumed=(1.0, 1.0), meaning="n"),
    ),
    equation="F = q^2 / (16 pi eps0 z^2), q = Q (R / 3 mm)^n",
    source="image charge; Jackson 1999, section 2.1",
    synonyms=("electrostatic force", "static charge", "image charge", "charging", "electrostatics"),
    force=force,
    steep=True,
    flat=True,
    free=True,
    splits="discharge the bead (ioniser) or earth the plate, and compare the low bounces",
)
