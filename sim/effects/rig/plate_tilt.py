"""The plate is not level: the bead wanders to the lower side, further with each bounce."""

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
