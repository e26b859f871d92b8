"""Fast robust statistics for the fits: median, and correlation of residuals."""

from __future__ import annotations

import numpy as np

from rigtwin.lab.arrays import Array


def correlation_excess(residual: Array) -> float:
    """Factor on the variance of a mean because neighbouring residuals are correlated (compression, demosaicing).

    `residual` has shape (height, width). With the correlations r_x, r_y of neighbours along the rows and columns the
    factor is (1 + r_x) / (1 - r_x) * (1 + r_y) / (1 - r_y), limited to 1 to 16.
    """
    values = residual - float(np.add.reduce(residual, axis=None)) / residual.size
    power = float(np.einsum("ij,ij", values, values)) + 1e-12
    across = float(np.einsum("ij,ij", values[:, 1:], values[:, :-1])) / power
    down = float(np.einsum("ij,ij", values[1:], values[:-1])) / power
    excess = (1 + across) / (1 - across) * (1 + down) / (1 - down)
    return min(max(excess, 1.0), 16.0)


def middle_of(values: Array) -> float:
    """Upper median in single precision, shape (n,) to scalar; three times as fast as in double precision."""
    half = len(values) // 2
    parted = values.astype(np.float32)
    parted.partition(half)
    return float(parted[half])
