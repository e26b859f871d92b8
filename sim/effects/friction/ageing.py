"""Ageing of a resting contact: the static friction grows with the logarithm of the waiting time.

Formula: mu = mu_0 + B ln(1 + t/1 s)

t is the waiting time; the code writes the logarithm as the limit of a power.

Parameters:
- `rate` [dimensionless], -0.1 to 0.3, typically 0.01: B, per factor e of the time

Source: Dieterich 1979
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def onset(mu: Any, waiting: Any, normal: Any, rate: Any) -> Any:
    """mu + B ln(1 + t / 1 s), the logarithm as the limit of a power."""
    small = 1e-6
    return mu + rate * ((1.0 + waiting) ** small - 1.0) / small


EFFECT = Effect(
    name="ageing",
    title="dwell-time ageing",
    kind="physical",
    rigs=("slide",),
    parameters=(Parameter("rate", "1", -0.1, 0.3, 0.01, meaning="B, per factor e of the time"),),
    equation="mu = mu_0 + B ln(1 + t/1 s)",
    source="Dieterich 1979",
    synonyms=("ageing", "aging", "contact ageing", "dwell time", "waiting time", "frictional ageing"),
    onset=onset,
    splits="three waiting times a factor of ten apart, at one tilting rate",
)
