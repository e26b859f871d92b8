"""Kinetic friction that changes with the sliding speed up to a limit, as friction that weakens with the speed does.

Formula: mu_k = mu_0 + k v / (1 + v / v_c)

v is the sliding speed; k is `slope`, below zero where friction weakens; 1/v_c is `levelling`.

Parameters:
- `slope` [s/m], -10 to 10, typically 0.1: growth of mu_k per speed at rest
- `levelling` [s/m], 0 to 100, typically 5: 1/v_c

Source: Carlson & Langer 1989
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def sliding(mu: Any, speed: Any, waiting: Any, slope: Any, levelling: Any) -> Any:
    """mu_k + k v / (1 + v / v_c)."""
    return mu + slope * speed / (1.0 + levelling * speed)


EFFECT = Effect(
    name="sliding_speed_levelling",
    title="velocity-dependent sliding friction (to a limit)",
    kind="physical",
    family="sliding_speed",
    rigs=("slide",),
    parameters=(
        Parameter("slope", "s/m", -10.0, 10.0, 0.1, starts=(-0.5, 0.5), meaning="growth of mu_k per speed at rest"),
        Parameter("levelling", "s/m", 0.0, 100.0, 2.0, assumed=(5.0, 5.0), meaning="1/v_c"),
    ),
    equation="mu_k = mu_0 + k v / (1 + v / v_c)",
    source="Carlson & Langer 1989",
    synonyms=("velocity dependent friction", "speed dependent friction", "velocity weakening"),
    sliding=sliding,
    free=True,
    splits="slides from rest and with a push: the speeds differ at the same place, a drop of friction does not",
)
