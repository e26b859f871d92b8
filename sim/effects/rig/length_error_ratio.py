"""Length error in proportion to the length: a ruler, tape or picture of wrong scale gave all stated lengths.

Formula: L = L_stated (1 + k)

k is `relative`.

Parameters:
- `relative` [dimensionless], -0.2 to 0.2, typically 0.005: true over stated length, less 1

Source: geometry
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="length_error_ratio",
    title="length error in proportion to the length",
    kind="physical",
    family="length_error",
    rigs=("pendulum", "double"),
    parameters=(Parameter("relative", "1", -0.2, 0.2, 0.005, meaning="true over stated length, less 1"),),
    equation="L = L_stated (1 + k)",
    source="geometry",
    synonyms=("wrong length", "pendulum length error", "thread length", "string length error", "wrong ruler"),
    geometry="lengths",
    splits="measure the lengths again with another ruler; a wrong scale changes the picture but not the period",
)
