"""Friction drop: the kinetic friction coefficient is below the static one.

Formula: mu_k = (1 - s) mu_s

s is the parameter `drop`.

Parameters:
- `drop` [dimensionless], 0 to 0.9, typically 0.1: 1 - mu_k/mu_s

Source: Coulomb 1785; Rabinowicz 1951
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def sliding(mu: Any, speed: Any, waiting: Any, drop: Any) -> Any:
    """Kinetic from static friction."""
    return mu * (1.0 - drop)


EFFECT = Effect(
    name="friction_drop",
    title="static-kinetic friction drop",
    kind="physical",
    rigs=("slide",),
    parameters=(Parameter("drop", "1", 0.0, 0.9, 0.1, meaning="1 - mu_k/mu_s"),),
    equation="mu_k = (1 - s) mu_s",
    source="Coulomb 1785; Rabinowicz 1951",
    synonyms=("static kinetic drop", "kinetic friction", "stiction", "stick slip", "mu_k below mu_s"),
    sliding=sliding,
    splits="film the slide: with a drop the clump starts off with a jerk, without one it starts off gently",
)
