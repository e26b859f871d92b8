"""Kinetic friction that changes with the sliding speed.

Formula: mu_k = mu_0 + k v

v is the sliding speed, k is `slope`; below zero where friction weakens.

Parameters:
- `slope` [s/m], -0.5 to 0.5, typically 0.03: growth of mu_k per speed

Source: Rabinowicz 1951
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def sliding(mu: Any, speed: Any, waiting: Any, slope: Any) -> Any:
    """mu_k + k v."""
    return mu + slope * speed


EFFECT = Effect(
    name="sliding_speed",
    title="velocity-dependent sliding friction",
    kind="physical",
    rigs=("slide",),
    parameters=(Parameter("slope", "s/m", -0.5, 0.5, 0.03, meaning="growth of mu_k per speed"),),
    equation="mu_k = mu_0 + k v",
    source="Rabinowicz 1951",
    synonyms=("velocity dependent friction", "speed dependent friction", "velocity weakening", "viscous friction"),
    sliding=sliding,
    splits="slides from rest and with a push: the speeds differ at the same place, a drop of friction does not",
)
