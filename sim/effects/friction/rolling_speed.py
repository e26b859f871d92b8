"""Rolling friction that grows with the speed.

Formula: mu_r = mu_0 + k v

v is the rolling speed, k is `slope`.

Parameters:
- `slope` [s/m], 0 to 1, typically 0.02: growth of mu_r per speed

Source: Brilliantov & Poschel 1998
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def rolling(mu: Any, speed: Any, radius: Any, slope: Any) -> Any:
    """mu_r + k v."""
    return mu + slope * speed


EFFECT = Effect(
    name="rolling_speed",
    title="velocity-dependent rolling resistance",
    kind="physical",
    rigs=("roll",),
    parameters=(Parameter("slope", "s/m", 0.0, 1.0, 0.02, meaning="growth of mu_r per speed"),),
    equation="mu_r = mu_0 + k v",
    source="Brilliantov & Poschel 1998",
    synonyms=("speed dependent rolling", "viscous rolling resistance", "rolling viscosity", "viscoelastic rolling"),
    rolling=rolling,
    splits="two beads of one size and different density: air drag goes with 1/density, rolling friction does not",
)
