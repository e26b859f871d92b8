"""Test calls of an effect's functions on plausible numbers, to find errors before a fit or a compiled step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.errors import BadInput
from rigtwin.sim.effects.effect import Effect

SPEED, WAY = np.array([0.02, -0.4, 3.0]), np.array([0.002, 0.05, 0.3])  # [m/s], [m]
RADIUS, MASS, MODULUS = np.full(3, 3e-3), np.full(3, 1e-4), np.full(3, 1e9)  # [m], [kg], [Pa]
SHARE, TIME = np.array([0.2, 0.5, 0.8]), np.array([0.0, 0.1, 2.0])  # friction or restitution; [s]
TRIED = {
    "force": (SPEED, SPEED[::-1], WAY, RADIUS, MASS),
    "sideways": (WAY, RADIUS, MASS),
    "torque": (SPEED, SPEED[::-1], WAY, MASS),
    "mutual": (WAY + 0.006, RADIUS, MASS),
    "restitution": (SHARE, abs(SPEED), RADIUS, MASS),
    "rolling": (SHARE, abs(SPEED), RADIUS),
    "sliding": (SHARE, abs(SPEED), TIME),
    "onset": (SHARE, TIME, np.full(3, 0.02)),
    "attraction": (1e-3 * RADIUS, RADIUS, MODULUS),
    "neck": (RADIUS, MODULUS),
    "exposure": (TIME, WAY, SPEED),
    "view": (WAY, SPEED),
}
HEIGHTS = (0.002, 0.05, 0.3, 0.7, 1.5)  # [m], at which the mirror symmetry of a force is tested
PAIRS = ("force", "view")  # hooks that return two numbers; the others return one


def check(effect: Effect, path: Path) -> None:
    """Call each hook with the typical values of the parameters.

    Parameters
    ----------
    effect : Effect
        Effect whose hooks are called.
    path : Path
        Its file, for messages.

    Raises
    ------
    BadInput
        If the effect has no parameter, or a hook fails, is reserved, or returns a wrong count of numbers or a value
        that is not finite.
    """
    if not effect.parameters:
        raise BadInput(f"{path}: effect {effect.name} has no parameter; give it at least one, whose size is fitted.")
    if effect.drive is not None:
        raise BadInput(
            f"{path}: effect {effect.name} has a drive hook, which is reserved for formulas of the diagnosis; write it "
            "as a force or a torque."
        )
    typical = [parameter.typical for parameter in effect.parameters]
    for hook, motion in TRIED.items():
        function = getattr(effect, hook)
        if function is None:
            continue
        where = f"{path}: {hook} of effect {effect.name}"
        try:
            with np.errstate(all="ignore"):
                given = function(*motion, *typical)
        except Exception as error:
            raise BadInput(
                f"{where} fails when called with {len(motion)} arguments of the motion and {len(typical)} parameters "
                f"({type(error).__name__}: {error}); correct it."
            ) from error
        if hook in PAIRS and not (isinstance(given, tuple) and len(given) == 2):
            raise BadInput(f"{where} must return two numbers, along x and y; end it with: return first, second")
        for one in given if hook in PAIRS else (given,):
            if np.shape(one) not in ((), (3,)) or not np.all(np.isfinite(np.asarray(one, dtype=float))):
                raise BadInput(f"{where} returns a value that is not finite at its typical parameters; correct it.")


def one_sided(effect: Effect) -> bool:
    """Return whether the force or torque of the mirrored motion is not the mirrored one: it has a fixed direction.

    Parameters
    ----------
    effect : Effect
        The effect, at the typical values of its parameters.

    Returns
    -------
    bool
        True where it has a fixed direction.
    """
    typical = [parameter.typical for parameter in effect.parameters]
    across, up = (one.ravel() for one in np.meshgrid(SPEED, SPEED))
    for height in HEIGHTS:
        place = np.full(across.shape, height), np.full(across.shape, RADIUS[0]), np.full(across.shape, MASS[0])
        with np.errstate(all="ignore"):
            if effect.force is not None:
                there, back = (effect.force(side * across, up, *place, *typical) for side in (1.0, -1.0))
                if not (_same(there[0], -back[0]) and _same(there[1], back[1])):
                    return True
            if effect.torque is not None:
                one, other = (
                    effect.torque(side * across, side * up, *place[:1], MASS[0], *typical) for side in (1, -1)
                )
                if not _same(one, -other):
                    return True
    return False


def _same(one: Any, other: Any) -> bool:
    there, back = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    if not (np.isfinite(there).all() and np.isfinite(back).all()):
        return True  # values that are not finite are no evidence of asymmetry
    return np.allclose(there, back, rtol=1e-6, atol=1e-6 * float(np.abs(there).max(initial=0.0)))
