"""Attraction by a body beside the fall: a charged or magnetic sheet that pulls the bead sideways.

Formula: F_x = F (R / 3 mm)^n

R is the radius of the bead; n = 0 if all beads carry the same charge, 2 if the charge goes with the surface.

Parameters:
- `force` [N], -0.01 to 0.01, typically 1e-05: pull towards positive x on a bead of 6 mm
- `size_exponent` [dimensionless], -1 to 6, typically 2: n

Source: Jackson 1999, section 2.1; the sheet is much further from the bead than the bead moves sideways
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def force(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, force: Any, size_exponent: Any) -> Any:
    """[N] sideways: F (R / 3 mm)^n."""
    pull = force * (radius / 0.003) ** size_exponent
    return pull + 0.0 * vx, 0.0 * vy


EFFECT = Effect(
    name="side_attraction",
    title="attraction by a body beside the fall",
    kind="physical",
    rigs=("drop",),
    parameters=(
        Parameter("force", "N", -0.01, 0.01, 1e-5, meaning="pull towards positive x on a bead of 6 mm"),
        Parameter("size_exponent", "1", -1.0, 6.0, 0.5, assumed=(2.0, 1.0), meaning="n"),
    ),
    equation="F_x = F (R / 3 mm)^n",
    source="Jackson 1999, section 2.1",
    synonyms=("sideways attraction", "lateral attraction", "charged wall", "charged sheet", "sideways force"),
    force=force,
    aimed=True,
    splits="turn the camera and the holder by 180 degrees, or take the body beside the fall away",
)
