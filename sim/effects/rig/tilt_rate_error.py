"""Wrong tilt rate: the arm rises faster or slower than stated.

Formula: rate = stated rate (1 + r)

r is `relative`.

Parameters:
- `relative` [dimensionless], -0.5 to 0.5, typically 0.01: relative error of the rate

Source: calibration of the drive
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="tilt_rate_error",
    title="wrong tilt rate",
    kind="measurement",
    rigs=("slide",),
    parameters=(Parameter("relative", "1", -0.5, 0.5, 0.01, meaning="relative error of the rate"),),
    equation="rate = stated rate (1 + r)",
    source="calibration of the drive",
    synonyms=("tilt rate", "tilting rate", "rate of the drive", "arm speed"),
    geometry="tilt_rate",
    splits="film a protractor on the arm, or time the arm between two angles",
)
