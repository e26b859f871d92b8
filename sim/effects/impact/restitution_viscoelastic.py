"""Restitution that falls with the impact speed: viscoelastic loss.

Formula: 1 - e = (1 - e_1) ((1 - f) + f (v / 1 m/s)^(1/5))

e_1 is the restitution at 1 m/s, f is `share`.

Parameters:
- `share` [dimensionless], -0.2 to 1.6, typically 0.5: share of the loss that scales as v^(1/5)

Source: Kuwabara & Kono 1987; Ramirez et al. 1999
"""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def restitution(e: Any, speed: Any, radius: Any, mass: Any, share: Any) -> Any:
    """1 - e grows as v^(1/5) in the share f of the loss; `e` is the value at 1 m/s."""
    return 1.0 - (1.0 - e) * ((1.0 - share) + share * (speed + 1e-9) ** 0.2)


EFFECT = Effect(
    name="restitution_viscoelastic",
    title="velocity-dependent restitution (viscoelastic)",
    kind="physical",
    family="velocity_dependent_restitution",
    rigs=("drop", "double"),
    parameters=(Parameter("share", "1", -0.2, 1.6, 0.5, meaning="share of the loss that scales as v^(1/5)"),),
    equation="1 - e = (1 - e_1) ((1 - f) + f (v / 1 m/s)^(1/5))",
    source="Kuwabara & Kono 1987; Ramirez et al. 1999",
    synonyms=("velocity dependent restitution", "speed dependent restitution", "viscoelastic restitution"),
    restitution=restitution,
    splits="drops from 0.05 m to 1 m with the same bead: restitution against impact speed over all bounces",
)
