"""Kinetic friction that changes with the sliding speed and saturates, as in velocity weakening.

Formula: mu_k = mu_0 + k v / (1 + v / v_c)

v is the sliding speed; k is `slope`, below zero where friction weakens; 1/v_c is `saturation`.  With k = -mu_0 / v_c
this is the law of the source, mu_0 / (1 + v / v_c), in which the friction vanishes at high speed.

Parameters:
- `slope` [s/m], -10 to 10, typically 0.1: d mu_k / dv at v = 0
- `saturation` [s/m], 0 to 100, typically 5: 1/v_c

Source: Carlson & Langer 1989
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def sliding(mu: Any, speed: Any, waiting: Any, slope: Any, saturation: Any) -> Any:
    """mu_k + k v / (1 + v / v_c)."""
    return mu + slope * speed / (1.0 + saturation * speed)


EFFECT = Effect(
    name="sliding_speed_saturating",
    title="velocity-dependent sliding friction (saturating)",
    kind="physical",
    family="sliding_speed",
    rigs=("slide",),
    parameters=(
        Parameter("slope", "s/m", -10.0, 10.0, 0.1, starts=(-0.5, 0.5), meaning="d mu_k / dv at v = 0"),
        Parameter("saturation", "s/m", 0.0, 100.0, 2.0, assumed=(5.0, 5.0), meaning="1/v_c"),
    ),
    equation="mu_k = mu_0 + k v / (1 + v / v_c)",
    source="Carlson & Langer 1989",
    synonyms=("velocity dependent friction", "speed dependent friction", "velocity weakening"),
    sliding=sliding,
    free=True,
    splits="slides from rest and with a push: the speeds differ at the same place, a drop of friction does not",
)
