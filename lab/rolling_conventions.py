"""What a coefficient of rolling friction means in other codes.

Here, as in EDEM and in Hlosta et al. 2020, a contact resists the rolling of each sphere with a torque of at most
mu_r F_n R, R the sphere's own radius.  LIGGGHTS and LAMMPS take the effective radius, 1 / (1 / R_i + 1 / R_j), which is
R / 2 between equal spheres and R at a wall: there the same torque needs twice the coefficient between the spheres.
"""

from __future__ import annotations

import math
from typing import Literal, get_args

from rigtwin.lab.errors import BadInput

Arm = Literal["own radius", "effective radius"]
"""What mu_r F_n is multiplied by."""

ARMS = get_args(Arm)


def rolling_friction(coefficient: float, radius: float, other: float = math.inf, *, arm: Arm) -> float:
    """Convert a coefficient of rolling friction to another code's convention.

    Parameters
    ----------
    coefficient : float
        The coefficient here [1].
    radius : float
        Radius of the sphere [m].
    other : float
        Radius [m] of the sphere it touches, infinite for a wall.
    arm : {"own radius", "effective radius"}
        What the other code multiplies mu_r F_n by.

    Returns
    -------
    float
        The coefficient [1] that limits the torque on the sphere there as `coefficient` does here.

    Raises
    ------
    BadInput
        If `arm` is unknown, or for the effective radius between unequal spheres: there both feel one torque, here each
        its own.

    Examples
    --------
    >>> rolling_friction(0.08, 3e-3, 3e-3, arm="effective radius")
    0.16
    >>> rolling_friction(0.06, 3e-3, arm="effective radius")
    0.06
    """
    if arm not in ARMS:
        raise BadInput(f"arm: {arm!r} is unknown; use {' or '.join(map(repr, ARMS))}.")
    if arm == "own radius" or math.isinf(other):
        return coefficient
    if not math.isclose(radius, other):
        raise BadInput(
            f"rolling friction: spheres of {1e3 * radius:g} and {1e3 * other:g} mm radius feel different torques here, "
            "and the same one where the effective radius counts; no coefficient gives both."
        )
    return coefficient * (1 + radius / other)
