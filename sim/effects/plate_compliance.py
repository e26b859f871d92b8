"""Bending waves in a thin plate carry energy away: larger loss for larger and faster beads."""

from typing import Any

from rigtwin.sim.effects.effect import Effect, Parameter


def restitution(e: Any, speed: Any, radius: Any, mass: Any, strength: Any) -> Any:
    """e' = e exp(-k (R / 3 mm)^2 (v^(1/5) - 1)); `e` is the value at 1 m/s."""
    loss = strength * (radius / 0.003) ** 2 * ((speed + 1e-9) ** 0.2 - 1.0)
    return e * 2.718281828459045 ** (-loss)


EFFECT = Effect(
    name="plate_compliance",
    title="plate compliance",
    kind="physical",
    family="velocity_dependent_restitution",
    rigs=("drop",),
    parameters=(Parameter("strength", "1", 0.0, 3.0, 0.2, meaning="inelasticity of a 6 mm bead at 1 m/s"),),
    equation="e = e_1 exp(-k (R/3 mm)^2 ((v / 1 m/s)^(1/5) - 1))",
    source="Zener 1941",
    synonyms=("plate flexibility", "elastic plate", "plate vibration", "flexural waves", "base flexibility"),
    restitution=restitution,
    special=True,
    splits="a plate twice as thick, or backed by a block: bending waves vanish, losses in the bead stay",
)
