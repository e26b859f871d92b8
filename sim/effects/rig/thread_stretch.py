"""Elastic thread: it is longer where it is pulled harder, at the lowest point of a fast swing.

Formula: r = L + c m (g (cos theta - 1) + L omega^2)

L is the length with the bob at rest, c the `compliance` of the whole thread.

Parameters:
- `compliance` [m/N], 0 to 10, typically 0.1: stretch per force

Source: elastic pendulum without its own spring oscillation; Landau & Lifshitz 1976, section 27
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="thread_stretch",
    title="stretching thread",
    kind="physical",
    family="thread_stretch",
    rigs=("pendulum",),
    parameters=(Parameter("compliance", "m/N", 0.0, 10.0, 0.1, meaning="stretch per force"),),
    equation="r = L + c m (g (cos theta - 1) + L omega^2)",
    source="Landau & Lifshitz 1976, section 27",
    synonyms=("thread stretch", "elastic thread", "string stretch", "stretchy thread", "elastic string"),
    geometry="stretch",
    splits="a heavier bob on the same thread, or a steel wire: the stretch goes with the force",
)
