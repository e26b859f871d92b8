"""Cubic Hermite interpolation of a step."""

from __future__ import annotations

from rigtwin.lab.arrays import Array


def hermite(a: Array, b: Array, da: Array, db: Array, s: Array) -> tuple[Array, Array]:
    """Value and slope per step, at the fraction s, of the cubic from a to b with end slopes da, db per step."""
    value = a + s * (da + s * (3 * (b - a) - 2 * da - db + s * (2 * (a - b) + da + db)))
    slope = da + s * (2 * (3 * (b - a) - 2 * da - db) + 3 * s * (2 * (a - b) + da + db))
    return value, slope
