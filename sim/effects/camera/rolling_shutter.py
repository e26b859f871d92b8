"""Rolling shutter: image rows are read one after another, so the exposure time depends on the height.

Formula: t_true = t + r y

r is `delay`, y [m] the height in the plane of motion.

Parameters:
- `delay` [s/m], -0.06 to 0.06, typically 0.003: row delay per height; up to 0.05 in a telephone

Source: CMOS read-out; Meingast, Geyer & Sastry 2005
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def exposure(time: Any, x: Any, y: Any, delay: Any) -> Any:
    """True time = stamp + r y, with y [m] the height in the plane of motion."""
    return time + delay * y


EFFECT = Effect(
    name="rolling_shutter",
    title="rolling shutter",
    kind="measurement",
    rigs=("drop", "pendulum", "double", "slide", "roll"),
    parameters=(
        Parameter("delay", "s/m", -0.06, 0.06, 0.003, least=2e-5, starts=(-0.02, 0.02), meaning="row delay per height"),
    ),
    equation="t_true = t + r y",
    source="CMOS read-out; Meingast, Geyer & Sastry 2005",
    synonyms=("row delay", "shutter readout", "read-out delay", "cmos skew", "rolling readout"),
    exposure=exposure,
    splits="turn the camera by 180 degrees, or drop a steel ball: drag goes with 1/density, a shutter does not",
)
