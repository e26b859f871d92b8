"""Creeping thread whose strain grows with a fitted power of the time: fast at first, as plastics and fibres creep.

Formula: r = L (1 + k (t / 1 s)^p)

t is the time since the release.

Parameters:
- `strain` [dimensionless], -0.05 to 0.05, typically 0.001: k, after 1 s
- `time_exponent` [dimensionless], 0.1 to 1, typically 0.4: p, 1/3 of primary creep, 1 of steady creep

Source: Andrade 1910 (1/3, metal wires); Findley, Lai & Onaran 1976 (other powers, plastics)
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="thread_creep_power",
    title="creeping thread (power of the time)",
    kind="physical",
    family="thread_stretch",
    rigs=("pendulum",),
    parameters=(
        Parameter("strain", "1", -0.05, 0.05, 1e-3, meaning="k, after 1 s"),
        Parameter(
            "time_exponent", "1", 0.1, 1.0, 0.4, assumed=(0.5, 0.2), meaning="p, 1/3 of primary, 1 of steady creep"
        ),
    ),
    equation="r = L (1 + k (t / 1 s)^p)",
    source="Andrade 1910; Findley, Lai & Onaran 1976",
    synonyms=("thread creep", "thread stretch", "string creep", "slipping thread", "thread slips through its clamp"),
    geometry="creep",
    free=True,
    splits="hang the bob on its thread for an hour before the film, or measure the length before and after",
)
