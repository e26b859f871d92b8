"""Adhesion between clump and arm: adds to the normal force that friction acts on.

Formula: mu_s = mu (1 + F_a/N)

N is the normal force of the weight, mu the friction coefficient without adhesion.

Parameters:
- `force` [N], 0 to 1, typically 0.001: at rest

Source: Bowden & Tabor 1950
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def onset(mu: Any, waiting: Any, normal: Any, force: Any) -> Any:
    """mu (1 + F_a / N)."""
    return mu * (1.0 + force / normal)


EFFECT = Effect(
    name="contact_adhesion",
    title="adhesion to the arm",
    kind="physical",
    rigs=("slide",),
    parameters=(Parameter("force", "N", 0.0, 1.0, 1e-3, meaning="at rest"),),
    equation="mu_s = mu (1 + F_a/N)",
    source="Bowden & Tabor 1950",
    synonyms=("adhesion", "cohesion", "stickiness", "electrostatic adhesion"),
    onset=onset,
    splits="ballast on the clump: adhesion loses its share, friction does not",
)
