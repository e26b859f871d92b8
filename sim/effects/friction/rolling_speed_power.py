"""Rolling friction that grows with a fitted power of the speed.

Formula: mu_r = mu_0 + k v (v / 1 m/s)^a

v is the rolling speed, k is `slope`.

Parameters:
- `slope` [s/m], 0 to 1, typically 0.02: growth of mu_r per speed at 1 m/s
- `speed_exponent` [dimensionless], -0.9 to 0.1, typically -0.4: a, 0 of a viscous solid, less of a viscoelastic one

Source: Brilliantov & Poschel 1998; Lakes 2009, chapter 7 (a loss that varies as a small power of the frequency)
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter

SLOW = 1e-4  # [m/s], added in quadrature, so that a power of zero is finite; no film shows so slow a roll


def rolling(mu: Any, speed: Any, radius: Any, slope: Any, speed_exponent: Any) -> Any:
    """mu_r + k v (v / 1 m/s)^a."""
    return mu + slope * speed * (speed * speed + SLOW * SLOW) ** (0.5 * speed_exponent)


EFFECT = Effect(
    name="rolling_speed_power",
    title="velocity-dependent rolling resistance (power of the speed)",
    kind="physical",
    family="rolling_speed",
    rigs=("roll",),
    parameters=(
        Parameter("slope", "s/m", 0.0, 1.0, 0.02, starts=(0.02,), meaning="growth of mu_r per speed at 1 m/s"),
        Parameter("speed_exponent", "1", -0.9, 0.1, -0.4, assumed=(-0.3, 0.3), meaning="a"),
    ),
    equation="mu_r = mu_0 + k v (v / 1 m/s)^a",
    source="Brilliantov & Poschel 1998; Lakes 2009",
    synonyms=("speed dependent rolling", "viscous rolling resistance", "rolling viscosity", "viscoelastic rolling"),
    rolling=rolling,
    free=True,
    splits="two beads of one size and different density: air drag goes with 1/density, rolling friction does not",
)
