"""Camera roll: the camera is turned about its optical axis, so that the vertical leans in the image.

Formula: x' = x cos(phi) - y sin(phi), y' = x sin(phi) + y cos(phi)

phi is the parameter `angle`.

Parameters:
- `angle` [rad], -0.3 to 0.3, typically 0.01: of the picture, anticlockwise

Source: camera geometry
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def view(x: Any, y: Any, angle: Any) -> Any:
    """Picture turned by a small angle (exact to third order)."""
    cosine = 1.0 - 0.5 * angle * angle
    sine = angle - angle * angle * angle / 6.0
    return cosine * x - sine * y, sine * x + cosine * y


EFFECT = Effect(
    name="camera_roll",
    title="camera roll",
    kind="measurement",
    rigs=("drop", "pendulum", "double", "slide", "roll"),
    parameters=(Parameter("angle", "rad", -0.3, 0.3, 0.01, meaning="of the picture, anticlockwise"),),
    equation="x' = x cos(phi) - y sin(phi), y' = x sin(phi) + y cos(phi)",
    source="camera geometry",
    synonyms=("roll", "rotated camera", "camera tilt sideways", "camera rotation", "tilted image"),
    view=view,
    splits="film a plumb line: a rolled camera leans it, a plate out of level does not",
)
