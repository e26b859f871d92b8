"""Rolling resistance as a lever arm: a length of the material pair, so that small beads roll less easily.

Formula: mu_r = b/R

R is the radius of the bead; b/R is added to the other rolling friction.

Parameters:
- `lever` [m], 0 to 0.005, typically 0.0001: b, from the centre of pressure to the centre

Source: Johnson 1985, section 9.1; Hlosta et al. 2020, table 10
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def rolling(mu: Any, speed: Any, radius: Any, lever: Any) -> Any:
    """mu_r + b/R."""
    return mu + lever / radius


EFFECT = Effect(
    name="rolling_lever",
    title="rolling lever arm",
    kind="physical",
    rigs=("roll",),
    parameters=(
        Parameter(
            "lever", "m", 0.0, 5e-3, 1e-4, starts=(2e-4,), meaning="b, from the centre of pressure to the centre"
        ),
    ),
    equation="mu_r = b/R",
    source="Johnson 1985, section 9.1; Hlosta et al. 2020, table 10",
    synonyms=("lever arm", "rolling resistance length", "size dependent rolling", "mu_r ~ 1/d"),
    rolling=rolling,
    splits="three bead sizes of one material: the lever arm is one length, the coefficient then goes with 1/d",
)
