"""Linear cohesion (simplified JKR): an attractive force proportional to the contact area.

Formula: F = k A, A = 2 pi R* d

d is the overlap, R* the effective radius.

Parameters:
- `energy_density` [J/m^3], 0 to 1e+09, typically 100000: k, pull per area of contact

Source: the linear form used in bulk simulation after Johnson, Kendall & Roberts 1971
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def attraction(overlap: Any, radius: Any, modulus: Any, energy_density: Any) -> Any:
    """[N] k A with the area A = 2 pi R* d of the circle in which two spheres cut each other."""
    return energy_density * 6.283185307179586 * radius * 0.5 * (overlap + abs(overlap))


EFFECT = Effect(
    name="cohesion_sjkr",
    title="linear cohesion (SJKR)",
    kind="physical",
    family="adhesion",
    rigs=(),
    parameters=(Parameter("energy_density", "J/m^3", 0.0, 1e9, 1e5, meaning="k, pull per area of contact"),),
    equation="F = k A, A = 2 pi R* d",
    source="the linear form used in bulk simulation after Johnson, Kendall & Roberts 1971",
    synonyms=("sjkr", "linear cohesion", "cohesion", "cohesion energy density"),
    attraction=attraction,
    splits="beads of several sizes: cohesion matters less the heavier the bead",
)
