"""Creeping thread: it becomes longer with time under the load.

Formula: r = L + k t

t is the time since the release, k the `rate`.

Parameters:
- `rate` [m/s], -0.01 to 0.01, typically 0.0001: growth of the length

Source: kinematics; angular momentum of a bob on a thread of changing length
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="thread_creep",
    title="creeping thread",
    kind="physical",
    family="thread_stretch",
    rigs=("pendulum",),
    parameters=(Parameter("rate", "m/s", -0.01, 0.01, 1e-4, meaning="growth of the length"),),
    equation="r = L + k t",
    source="angular momentum of a bob on a thread of changing length",
    synonyms=("thread creep", "thread stretch", "string creep", "slipping thread", "thread slips through its clamp"),
    geometry="creep",
    splits="hang the bob on its thread for an hour before the film, or measure the length before and after",
)
