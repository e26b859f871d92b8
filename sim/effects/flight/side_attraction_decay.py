"""Attraction by a body close beside the fall whose pull decays over a length, as before strips of other potential.

Formula: F_x = F (R / 3 mm)^n exp(k x), at most 55 F (R / 3 mm)^n

R is the radius of the bead, x its place from the rig's origin, 1/k the length over which the pull grows by a factor e.

Parameters:
- `force` [N], -0.01 to 0.01, typically 1e-05: pull towards positive x on a bead of 6 mm at x = 0
- `growth` [1/m], -100 to 100, typically 20: k, positive if the body is at positive x
- `size_exponent` [dimensionless], -1 to 6, typically 0.5: n

Source: Jackson 1999, section 2.10
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

E, MOST = 2.718281828459045, 4.0  # at most e^4 times as strong as at x = 0, where trial steps lead far


def sideways(x: Any, radius: Any, mass: Any, force: Any, growth: Any, size_exponent: Any) -> Any:
    """[N] F (R / 3 mm)^n exp(k x)."""
    grown = 0.5 * (growth * x + MOST - abs(growth * x - MOST))
    return force * (radius / 0.003) ** size_exponent * E**grown


EFFECT = Effect(
    name="side_attraction_decay",
    title="attraction by a body beside the fall (decays over a length)",
    kind="physical",
    family="side_attraction",
    rigs=("drop",),
    parameters=(
        Parameter("force", "N", -0.01, 0.01, 1e-5, meaning="pull towards positive x on a bead of 6 mm at x = 0"),
        Parameter("growth", "1/m", -100.0, 100.0, 20.0, assumed=(0.0, 40.0), starts=(-30.0, 30.0), meaning="k"),
        Parameter("size_exponent", "1", -1.0, 6.0, 0.5, assumed=(2.0, 1.0), meaning="n"),
    ),
    equation="F_x = F (R / 3 mm)^n exp(k x)",
    source="Jackson 1999, section 2.10",
    synonyms=("sideways attraction", "lateral attraction", "charged wall", "charged sheet", "sideways force"),
    sideways=sideways,
    free=True,
    splits="turn the camera and the holder by 180 degrees, or take the body beside the fall away",
)
