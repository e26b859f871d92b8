"""Non-spherical bead: the directions of its rebounds scatter far more than those of a sphere.

Formula: v_x' = (1 + e) v sin(theta), theta drawn anew at each impact

theta is the random tilt of the contact normal, v the impact speed.

Parameters:
- `scatter` [dimensionless], 0 to 2, typically 0.1: sd of the sideways speed over the impact speed

Source: Cross 2002; Hlosta et al. 2020, table 11 (scatter of the restitution of cubes)
"""

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
