"""Length error: the distance from pivot to bob differs from the stated one.

Formula: L = L_stated + dL

dL is `offset`.

Parameters:
- `offset` [m], -0.05 to 0.05, typically 0.002: true minus stated length

Source: geometry
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="length_error",
    title="length error",
    kind="physical",
    rigs=("pendulum", "double"),
    parameters=(Parameter("offset", "m", -0.05, 0.05, 0.002, meaning="true minus stated length"),),
    equation="L = L_stated + dL",
    source="geometry",
    synonyms=("wrong length", "pendulum length error", "thread length", "string length error", "pivot offset"),
    geometry="length",
    splits="measure the length again; a wrong scale changes the picture but not the period",
)
