"""The camera looks up or down, or the motion leaves the plane: the scale changes with height."""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def view(x: Any, y: Any, gradient: Any) -> Any:
    """Scale grows with height by `gradient` [1/m], for both coordinates."""
    factor = 1.0 + gradient * y
    return x * factor, y * factor


EFFECT = Effect(
    name="perspective",
    title="perspective",
    kind="measurement",
    rigs=("drop", "pendulum", "double", "roll", "slide"),
    parameters=(
        Parameter(
            "gradient", "1/m", -1.0, 1.0, 0.05, least=1e-3, meaning="relative change of scale per metre of height"
        ),
    ),
    equation="(x', y') = (1 + p y) (x, y)",
    source="pinhole camera; Hartley & Zisserman 2004",
    synonyms=("camera pitch", "tilted camera", "out of plane", "parallax", "keystone", "foreshortening"),
    view=view,
    splits="film a ruler over the full height: its divisions shrink towards one end",
)
