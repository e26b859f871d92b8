"""Elastic thread: it is longer where it is pulled harder, at the lowest point of a fast swing.

Formula: r = L (1 + c m (g (cos theta - 1) + L omega^2))

L is the length with the bob at rest, c the `compliance`, one over the product of the thread's modulus and section: a
longer thread of the same kind stretches more.

Parameters:
- `compliance` [1/N], 0 to 30, typically 0.3: strain per force

Source: elastic pendulum without its own spring oscillation; Landau & Lifshitz 1976, section 27
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="thread_stretch",
    title="stretching thread",
    kind="physical",
    family="thread_stretch",
    rigs=("pendulum",),
    parameters=(Parameter("compliance", "1/N", 0.0, 30.0, 0.3, meaning="strain per force"),),
    equation="r = L (1 + c m (g (cos theta - 1) + L omega^2))",
    source="Landau & Lifshitz 1976, section 27",
    synonyms=("thread stretch", "elastic thread", "string stretch", "stretchy thread", "elastic string"),
    geometry="stretch",
    splits="a heavier bob on the same thread, or a steel wire: the stretch goes with the force",
)
