"""Restitution that falls above a yield speed: elastic impact below it, plastic above.

Formula: e = e_0 (v / v_y)^(-1/4) for v > v_y, e_0 below

e_0 is the restitution below the yield speed.

Parameters:
- `slowness` [s/m], 0 to 100, typically 1: 1/v_y, yield speed v_y

Source: Johnson 1985, section 11.5: above the yield speed e goes as v^(-1/4)
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def restitution(e: Any, speed: Any, radius: Any, mass: Any, slowness: Any) -> Any:
    """e (v s)^(-1/4) where v s > 1, with s = 1/v_y; `e` is the value below the yield speed."""
    ratio = speed * abs(slowness)
    return e * (0.5 * (ratio + 1.0 + abs(ratio - 1.0))) ** -0.25


EFFECT = Effect(
    name="restitution_plastic_yield",
    title="velocity-dependent restitution (above a yield speed)",
    kind="physical",
    family="velocity_dependent_restitution",
    rigs=("drop", "double"),
    parameters=(Parameter("slowness", "s/m", 0.0, 100.0, 1.0, starts=(0.7, 2.5), meaning="1/v_y, yield speed v_y"),),
    equation="e = e_0 (v / v_y)^(-1/4) for v > v_y, e_0 below",
    source="Johnson 1985, section 11.5: above the yield speed e goes as v^(-1/4)",
    synonyms=("velocity dependent restitution", "plastic deformation", "yield", "speed dependent restitution"),
    restitution=restitution,
    even=True,
    flat=True,
    splits="drops from 0.05 m to 1 m with the same bead: restitution against impact speed over all bounces",
)
