"""Perspective: the camera looks up or down, so that the scale changes with height.

Formula: (x', y' - y_0') = (x, y - y_0) / (1 - p (y - y_0))

p is `gradient`, y_0 is `level`.

Parameters:
- `gradient` [1/m], -1 to 1, typically 0.05: relative change of scale per metre of height
- `level` [m], -2 to 2, typically 0.1: height at which the stated scale is right

Source: pinhole camera; Hartley & Zisserman 2004
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def view(x: Any, y: Any, gradient: Any, level: Any) -> tuple[Any, Any]:
    """A pinhole camera that looks up or down, its scale right at the height `level`; the picture's origin is the rig's.

    The scale there grows with height by `gradient` [1/m].
    """
    far, origin = _in_front(1.0 - gradient * (y - level)), _in_front(1.0 + gradient * level)
    return x / far, (y - level) / far + level / origin


def _in_front(far: Any) -> Any:
    """A distance of at least a tenth of that of the level: what a fit tries may lie behind the camera."""
    return 0.5 * (far + 0.1 + abs(far - 0.1))


EFFECT = Effect(
    name="perspective",
    title="perspective",
    kind="measurement",
    rigs=("drop", "pendulum", "double", "roll", "slide"),
    parameters=(
        Parameter(
            "gradient", "1/m", -1.0, 1.0, 0.05, least=1e-3, meaning="relative change of scale per metre of height"
        ),
        Parameter(
            "level", "m", -2.0, 2.0, 0.1, assumed=(0.2, 0.3), meaning="height at which the stated scale is right"
        ),
    ),
    equation="(x', y' - y_0') = (x, y - y_0) / (1 - p (y - y_0))",
    source="pinhole camera; Hartley & Zisserman 2004",
    synonyms=("camera pitch", "tilted camera", "out of plane", "parallax", "keystone", "foreshortening"),
    view=view,
    splits="film a ruler over the full height: its divisions shrink towards one end",
)
