"""Radial lens distortion: the scale changes with the distance from the origin of the coordinates.

Formula: r' = r (1 + k1 r^2)

r is the distance from the origin of the coordinates, in the plane of motion.

Parameters:
- `radial` [1/m^2], -2 to 2, typically 0.05: k1 of the plane of motion

Source: Brown 1966
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def view(x: Any, y: Any, radial: Any) -> Any:
    """Radial distortion about the origin of the coordinates."""
    factor = 1.0 + radial * (x * x + y * y)
    return x * factor, y * factor


EFFECT = Effect(
    name="lens_distortion",
    title="lens distortion",
    kind="measurement",
    rigs=("drop", "pendulum", "double", "roll", "slide"),
    parameters=(Parameter("radial", "1/m^2", -2.0, 2.0, 0.05, least=2e-3, meaning="k1 of the plane of motion"),),
    equation="r' = r (1 + k1 r^2)",
    source="Brown 1966",
    synonyms=("barrel distortion", "pincushion", "radial distortion", "fisheye"),
    view=view,
    splits="film a chessboard: straight lines bend",
)
