"""Adhesion of two elastic spheres (JKR), including the neck that holds while they separate.

Formula: F = 4 E* a^3/(3 R*) - sqrt(8 pi w E* a^3), d = a^2/R* - sqrt(2 pi w a/E*)

a is the contact radius, d the overlap, E* and R* the effective modulus and radius.

Parameters:
- `work` [J/m^2], 0 to 100, typically 0.05: w, work of adhesion of the two surfaces

Source: Johnson, Kendall & Roberts 1971
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

TWO_PI = 6.283185307179586


def contact_radius(overlap: Any, radius: Any, modulus: Any, work: Any) -> Any:
    """Radius a [m] of the contact, the larger root of d = a^2/R* - sqrt(2 pi w a/E*).

    Newton from above, where the function is convex: it cannot overshoot.
    """
    start = (radius * abs(overlap)) ** 0.5 + (TWO_PI * work * radius * radius / modulus) ** 0.3333333333333333
    a = start + 1e-12
    for _ in range(30):
        root = (TWO_PI * work * a / modulus) ** 0.5
        a = a - (a * a / radius - root - overlap) / (2.0 * a / radius - 0.5 * root / a)
    return a


def attraction(overlap: Any, radius: Any, modulus: Any, work: Any) -> Any:
    """[N] by which the JKR force 4 E* a^3/(3 R*) - sqrt(8 pi w E* a^3) stays below Hertz's."""
    a = contact_radius(overlap, radius, modulus, work)
    force = 1.3333333333333333 * modulus * a**3 / radius - (4.0 * TWO_PI * work * modulus * a**3) ** 0.5
    hertz = 1.3333333333333333 * modulus * radius**0.5 * (0.5 * (overlap + abs(overlap))) ** 1.5
    return hertz - force


def neck(radius: Any, modulus: Any, work: Any) -> Any:
    """[m] 3 a^2/R* with a^3 = pi w R*^2/(8 E*): there the contact snaps when it is drawn out slowly."""
    a = (0.0625 * TWO_PI * work * radius * radius / modulus) ** 0.3333333333333333
    return 3.0 * a * a / radius


EFFECT = Effect(
    name="adhesion_jkr",
    title="adhesion (JKR)",
    kind="physical",
    family="adhesion",
    rigs=(),
    parameters=(Parameter("work", "J/m^2", 0.0, 100.0, 0.05, meaning="w, work of adhesion of the two surfaces"),),
    equation="F = 4 E* a^3/(3 R*) - sqrt(8 pi w E* a^3), d = a^2/R* - sqrt(2 pi w a/E*)",
    source="Johnson, Kendall & Roberts 1971",
    synonyms=("jkr", "surface energy", "work of adhesion"),
    attraction=attraction,
    neck=neck,
    splits="beads of several sizes: the pull-off force 3/2 pi w R* matters less the heavier the bead",
)
