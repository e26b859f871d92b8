"""Frame rate error: the true frame rate of the camera differs from the stated one.

Formula: t_true = t / (1 + f)

f is the parameter `relative`; a camera that is faster than stated took its frames earlier.

Parameters:
- `relative` [dimensionless], -0.8 to 4, typically 0.005: true over stated rate, less 1

Source: camera clock
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def exposure(time: Any, x: Any, y: Any, relative: Any) -> Any:
    """Rows are stamped with the stated rate; a faster camera took them earlier."""
    return time / (1.0 + relative)


EFFECT = Effect(
    name="frame_rate_error",
    title="wrong frame rate",
    kind="measurement",
    rigs=("drop", "pendulum", "double", "slide", "roll"),
    parameters=(
        Parameter("relative", "1", -0.8, 4.0, 0.005, starts=(-0.5, 1.0), meaning="true over stated rate, less 1"),
    ),
    equation="t_true = t / (1 + f)",
    source="camera clock",
    synonyms=("frame rate", "fps", "clock error", "time base", "time scale"),
    exposure=exposure,
    splits="film a running clock or a blinking light of known rate: times are wrong, lengths are not",
)
