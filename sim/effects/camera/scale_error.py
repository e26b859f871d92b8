"""Scale error: the scale of the image is wrong by a constant factor.

Formula: x' = (1 + s) x

s is the parameter `relative`.

Parameters:
- `relative` [dimensionless], -0.5 to 1, typically 0.01: seen over true length, less 1

Source: camera calibration
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def view(x: Any, y: Any, relative: Any) -> Any:
    """All lengths larger by a factor."""
    return x * (1.0 + relative), y * (1.0 + relative)


EFFECT = Effect(
    name="scale_error",
    title="scale error",
    kind="measurement",
    rigs=("drop", "pendulum", "double", "slide", "roll"),
    parameters=(Parameter("relative", "1", -0.5, 1.0, 0.01, meaning="seen over true length, less 1"),),
    equation="x' = (1 + s) x",
    source="camera calibration",
    synonyms=("wrong scale", "calibration error", "pixel scale", "length scale", "magnification error"),
    view=view,
    splits="film a ruler in the plane of motion: lengths are wrong, times are not",
)
