"""The bead is no sphere: its rebounds scatter in direction far more than those of one."""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="odd_shape",
    title="non-spherical impact",
    kind="physical",
    rigs=("drop",),
    parameters=(
        Parameter("scatter", "1", 0.0, 2.0, 0.1, least=0.025, meaning="sd of the sideways speed over the impact speed"),
    ),
    equation="v_x' = (1 + e) v sin(theta), theta drawn anew at each impact",
    source="Cross 2002; Hlosta et al. 2020, table 11 (scatter of the restitution of cubes)",
    synonyms=("non-spherical", "irregular shape", "asphericity", "off-centre impact", "shape"),
    geometry="scatter",
    flat=True,
    splits="the same drops with a bearing ball: a sphere rebounds along the normal",
)
