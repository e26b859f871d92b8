"""Wedge-shaped surface: its upper side leans against its lower one, so that the slope turns with the surface.

Formula: slope = stated slope + beta t, t = 1, or -1 where the surface lies end for end

beta is `angle`.

Parameters:
- `angle` [rad], -0.3 to 0.3, typically 0.01: right side up where positive, with the surface not turned

Source: geometry
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="surface_slope",
    title="wedge-shaped surface",
    kind="physical",
    rigs=("roll",),
    parameters=(Parameter("angle", "rad", -0.3, 0.3, 0.01, meaning="right side up where positive, not turned"),),
    equation="slope = stated slope + beta t, t = 1, or -1 where the surface lies end for end",
    source="geometry",
    synonyms=("leaning surface", "surface not level", "wedge", "surface turned", "uneven surface"),
    geometry="surface_slope",
    splits="lay the surface end for end: its own slope changes sign, that of the table does not",
)
