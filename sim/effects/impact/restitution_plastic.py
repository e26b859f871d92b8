"""Restitution that falls with the impact speed as a power law: plastic yield of the contact.

Formula: e = e_1 (v / 1 m/s)^(-n)

e_1 is the restitution at 1 m/s.

Parameters:
- `exponent` [dimensionless], -0.02 to 0.5, typically 0.1: n; 1/4 far above yield

Source: Johnson 1985, section 11.5; Thornton 1997
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def restitution(e: Any, speed: Any, radius: Any, mass: Any, exponent: Any) -> Any:
    """e = e_1 v^(-n); `e` is the value at 1 m/s."""
    return e * (speed + 1e-9) ** (-exponent)


EFFECT = Effect(
    name="restitution_plastic",
    title="velocity-dependent restitution (elastic-plastic)",
    kind="physical",
    family="velocity_dependent_restitution",
    rigs=("drop", "double"),
    parameters=(Parameter("exponent", "1", -0.02, 0.5, 0.1, meaning="n; 1/4 far above yield"),),
    equation="e = e_1 (v / 1 m/s)^(-n)",
    source="Johnson 1985, section 11.5; Thornton 1997",
    synonyms=("velocity dependent restitution", "plastic deformation", "yield", "speed dependent restitution"),
    restitution=restitution,
    splits="drops from 0.05 m to 1 m with the same bead: restitution against impact speed over all bounces",
)
