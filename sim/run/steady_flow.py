"""Flow of a discharge, without its start and its end."""

from __future__ import annotations

import numpy as np

from rigtwin.lab.arrays import Array

STEADY = (0.2, 0.8)  # share of what leaves, between which the flow counts as steady
FEWEST = 10  # beads from which a flow is read


def steady_flow(times: Array, passed: Array, total: float, fewest: int = FEWEST) -> float | None:
    """Flow [1/s, kg/s] of the middle 60 % of a discharge: slope of a line through what has passed over time.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Rising [s].
    passed : ndarray, shape (n,)
        Particles or their mass [1, kg] that have passed the outlet before each time.
    total : float
        Particles or mass [1, kg] in the whole.
    fewest : int
        Times from which a flow is read.

    Returns
    -------
    float or None
        None where fewer times show it.

    Examples
    --------
    >>> times = np.arange(100) * 0.01
    >>> round(steady_flow(times, np.arange(100), 100) or 0, 9)
    100.0
    """
    low, high = (share * total for share in STEADY)
    middle = (passed >= low) & (passed < high)
    if middle.sum() < fewest or np.ptp(times[middle]) <= 0:
        return None
    return float(np.polyfit(times[middle], passed[middle], 1)[0])
