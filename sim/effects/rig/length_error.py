"""Pivot to bob is not as long as noted."""

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
