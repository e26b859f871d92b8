"""Friction that falls with a power of the load: adhesion of elastic contacts, whose area grows slower than the load.

Formula: mu_s = mu (N / 0.01 N)^-a

N is the normal force of the weight, mu the friction coefficient under 0.01 N.

Parameters:
- `load_exponent` [dimensionless], 0 to 0.34, typically 0.08: a, 1/3 of one elastic sphere, less of many asperities

Source: Archard 1957
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

REFERENCE = 0.01  # [N], about the weight of a clump of beads
LEAST = 1e-9  # of that, added: without any load the friction coefficient would be infinite


def onset(mu: Any, waiting: Any, normal: Any, load_exponent: Any) -> Any:
    """mu (N / 0.01 N)^-a."""
    return mu * (abs(normal) / REFERENCE + LEAST) ** (-load_exponent)


EFFECT = Effect(
    name="contact_adhesion_load",
    title="adhesion to the arm (power of the load)",
    kind="physical",
    family="contact_adhesion",
    rigs=("slide",),
    parameters=(
        Parameter(
            "load_exponent", "1", 0.0, 0.34, 0.08, meaning="a, 1/3 of one elastic sphere, less of many asperities"
        ),
    ),
    equation="mu_s = mu (N / 0.01 N)^-a",
    source="Archard 1957",
    synonyms=("load dependent friction", "adhesion", "cohesion", "stickiness"),
    onset=onset,
    splits="ballast on the clump: the friction coefficient falls with the load",
)
