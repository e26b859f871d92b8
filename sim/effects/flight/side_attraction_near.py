"""Attraction by a body close beside the fall: an image charge pulls with the inverse square of the distance.

Formula: F_x = F (R / 3 mm)^n / (1 - k x)^2, at most 25 F (R / 3 mm)^n

R is the radius of the bead, x its place from the rig's origin, and 1/k the place of the body.  With the same charge on
all beads n is 0, with a charge that goes with the surface 4.

Parameters:
- `force` [N], -0.01 to 0.01, typically 1e-05: pull towards positive x on a bead of 6 mm at x = 0
- `nearness` [1/m], -40 to 40, typically 10: k, positive if the body is at positive x
- `size_exponent` [dimensionless], -1 to 6, typically 0.5: n

Source: Jackson 1999, section 2.1
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

LEAST = 0.04  # of the square: nearer than a fifth of the distance a bead of usual size touches the body


def sideways(x: Any, radius: Any, mass: Any, force: Any, nearness: Any, size_exponent: Any) -> Any:
    """[N] F (R / 3 mm)^n / (1 - k x)^2."""
    square = (1.0 - nearness * x) ** 2
    return force * (radius / 0.003) ** size_exponent / (0.5 * (square + LEAST + abs(square - LEAST)))


EFFECT = Effect(
    name="side_attraction_near",
    title="attraction by a body close beside the fall",
    kind="physical",
    family="side_attraction",
    rigs=("drop",),
    parameters=(
        Parameter("force", "N", -0.01, 0.01, 1e-5, meaning="pull towards positive x on a bead of 6 mm at x = 0"),
        Parameter("nearness", "1/m", -40.0, 40.0, 10.0, assumed=(0.0, 20.0), starts=(-15.0, 15.0), meaning="k"),
        Parameter("size_exponent", "1", -1.0, 6.0, 0.5, assumed=(2.0, 1.0), meaning="n"),
    ),
    equation="F_x = F (R / 3 mm)^n / (1 - k x)^2",
    source="Jackson 1999, section 2.1",
    synonyms=("sideways attraction", "lateral attraction", "charged wall", "charged sheet", "sideways force"),
    sideways=sideways,
    free=True,
    splits="turn the camera and the holder by 180 degrees, or take the body beside the fall away",
)
