"""Elastic thread on which beads are exchanged: a heavier bead hangs lower, and stretches it more in a fast swing.

Formula: r = L (1 + c (T - k W)), T = m (g cos theta + L omega^2)

L is the stated length, T the tension, c the `compliance`, W the mean weight of the lab's beads, each counted once, and
k W the tension under which the length was measured; to first order in c T.  In `thread_stretch` the length of each
thread was measured with its own bead.

Parameters:
- `compliance` [1/N], 0 to 30, typically 0.3: strain per force
- `measured_under` [dimensionless], 0 to 4, typically 1: k, 0 of a slack thread, 1 with a bead of the mean weight

Source: elastic pendulum without its own spring oscillation; Landau & Lifshitz 1976, section 27
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="thread_stretch_exchanged",
    title="stretching thread (beads exchanged)",
    kind="physical",
    family="thread_stretch",
    rigs=("pendulum",),
    parameters=(
        Parameter("compliance", "1/N", 0.0, 30.0, 0.3, meaning="strain per force"),
        Parameter("measured_under", "1", 0.0, 4.0, 1.0, assumed=(1.0, 1.0), meaning="k"),
    ),
    equation="r = L (1 + c (T - k W)), T = m (g cos theta + L omega^2)",
    source="Landau & Lifshitz 1976, section 27",
    synonyms=("thread stretch", "elastic thread", "string stretch", "stretchy thread", "elastic string"),
    geometry="stretch",
    free=True,
    splits="a heavier bob on the same thread, or a steel wire: the stretch goes with the force",
)
