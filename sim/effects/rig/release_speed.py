"""Release speed: the holder pushes or drags the bead as it lets go.

Formula: v_y(0) = v_rel

v_rel is `speed`.

Parameters:
- `speed` [m/s], -1 to 1, typically 0.05: upwards

Source: release mechanics of the holder
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="release_speed",
    title="release speed",
    kind="physical",
    rigs=("drop",),
    parameters=(Parameter("speed", "m/s", -1.0, 1.0, 0.05, starts=(-0.2, -0.05, 0.05), meaning="upwards"),),
    equation="v_y(0) = v_rel",
    source="release mechanics of the holder",
    synonyms=("release velocity", "initial velocity", "push at release", "late release"),
    geometry="release_speed",
    flat=True,
    splits="keep the frames before the release, or use another release head",
)
