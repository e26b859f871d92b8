"""Non-level plate: the bead drifts to the lower side, further with each bounce.

Formula: rebound mirrored at the tilted normal: v_x = -(1 + e) v sin(beta) cos(beta)

beta is `angle`, v the impact speed, e the restitution.

Parameters:
- `angle` [rad], -0.3 to 0.3, typically 0.01: right side up where positive

Source: geometry
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="plate_tilt",
    title="non-level plate",
    kind="physical",
    rigs=("drop", "roll", "slide"),
    parameters=(Parameter("angle", "rad", -0.3, 0.3, 0.01, meaning="right side up where positive"),),
    equation="rebound mirrored at the tilted normal: v_x = -(1 + e) v sin(beta) cos(beta)",
    source="geometry",
    synonyms=("tilted plate", "plate not level", "inclined base", "base tilt", "level error"),
    geometry="level",
    splits="turn the plate by 180 degrees: the drift changes its side, that of a rolled camera does not",
)
