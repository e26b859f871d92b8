"""Dry friction in the pivot that grows with the load on it: Coulomb friction under the tension of the thread.

Formula: M = -a m (g cos theta + L omega^2) sign(omega)

a is the `lever`, friction coefficient times radius of the pin.

Parameters:
- `lever` [m], 0 to 0.01, typically 0.0001: friction torque per force

Source: Coulomb 1785; friction of a journal bearing
"""

from typing import Any

from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.effects.effect import Effect, Parameter


def torque(angle: Any, rate: Any, length: Any, mass: Any, lever: Any) -> Any:
    """[N m] against the rate; cos(angle) by its series to the sixth power, smooth only within 1e-4 rad/s of rest."""
    square = angle * angle
    cosine = 1.0 - square / 2.0 + square * square / 24.0 - square * square * square / 720.0
    load = mass * (GRAVITY * cosine + length * rate * rate)
    return -lever * load * rate / (rate * rate + 1e-8) ** 0.5


EFFECT = Effect(
    name="pivot_friction_load",
    title="pivot friction (Coulomb, by load)",
    kind="physical",
    family="pivot_friction",
    rigs=("pendulum", "double"),
    parameters=(Parameter("lever", "m", 0.0, 0.01, 1e-4, meaning="friction torque per force"),),
    equation="M = -a m (g cos theta + L omega^2) sign(omega)",
    source="Coulomb 1785; friction of a journal bearing",
    synonyms=("dry pivot friction", "hinge friction", "bearing friction", "coulomb pivot", "pivot coulomb"),
    torque=torque,
    free=True,
    splits="a heavier bob on the same pivot: with the load the loss per swing stays the same",
)
