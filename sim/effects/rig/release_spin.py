"""Release spin: the bead leaves the holder spinning and is deflected sideways at the first bounce.

Formula: kick (2/7) R omega at the first bounce, at most mu (1 + e) v

omega is `spin`, R the radius, mu the friction coefficient, e the restitution, v the impact speed.

Parameters:
- `spin` [rad/s], -400 to 400, typically 20: about the line of sight

Source: Walton 1993; Cross 2002
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="release_spin",
    title="release spin",
    kind="physical",
    rigs=("drop",),
    parameters=(Parameter("spin", "rad/s", -400.0, 400.0, 20.0, meaning="about the line of sight"),),
    equation="kick (2/7) R omega at the first bounce, at most mu (1 + e) v",
    source="Walton 1993; Cross 2002",
    synonyms=("initial spin", "spin at release", "rotation at release", "bead spin", "backspin", "topspin"),
    geometry="release_spin",
    splits="a dot on the bead, filmed: spin acts at the first bounce only, a plate out of level at each",
)
