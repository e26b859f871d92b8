from __future__ import annotations

import numpy as np

from rigtwin.lab.arrays import Array


def correlation_excess(residual: Array) -> float:
    """How much neighbouring residuals repeat each other (compression, demosaicing): factor on the variance."""
    values = residual - float(np.add.reduce(residual, axis=None)) / residual.size
    power = float(np.einsum("ij,ij", values, values)) + 1e-12
    across = float(np.einsum("ij,ij", values[:, 1:], values[:, :-1])) / power
    down = float(np.einsum("ij,ij", values[1:], values[:-1])) / power
    excess = (1 + across) / (1 - across) * (1 + down) / (1 - down)
    return min(max(excess, 1.0), 16.0)


def middle_of(values: Array) -> float:
    """The median of many, without the care np.median takes of few; to seven digits, three times as quick as to all."""
    half = len(values) // 2
    parted = values.astype(np.float32)
    parted.partition(half)
    return float(parted[half])
