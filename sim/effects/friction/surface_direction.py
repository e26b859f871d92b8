"""Rolling friction that depends on the direction: a surface with a lay, fibres or a nap.

Formula: mu_r = mu_0 (1 + a d), d = 1 or -1

d changes its sign where the surface lies end for end, and where the bead rolls the other way; a is `asymmetry`.

Parameters:
- `asymmetry` [dimensionless], -0.9 to 0.9, typically 0.1: half the relative difference between both directions

Source: friction of surfaces with a lay; Blau 2009, chapter 6
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="surface_direction",
    title="direction of the surface",
    kind="physical",
    rigs=("roll",),
    parameters=(
        Parameter("asymmetry", "1", -0.9, 0.9, 0.1, meaning="half the relative difference between both directions"),
    ),
    equation="mu_r = mu_0 (1 + a d), d = 1 or -1",
    source="Blau 2009, chapter 6",
    synonyms=("surface direction", "anisotropic friction", "grain direction", "lay of the surface", "nap"),
    geometry="surface_direction",
    splits="lay the surface end for end: friction by its lay changes with it, the slope of the table does not",
)
