"""Size distributions of particles: diameters drawn by number, given by number or by sieved mass.

The kind's own diameter is the largest of the distribution; a particle drawn smaller is the same body, shrunk.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rigtwin.lab.errors import BadInput

if TYPE_CHECKING:
    import numpy as np

    from rigtwin.lab.arrays import Array


STEPS = 1000  # of the table of quantiles
CUT = 3.0  # standard deviations; without an end the smallest particle would need an endless number of steps


@dataclass(frozen=True)
class Sizes:
    """Diameters [m] at evenly spaced shares, from 0 to 1, of the number of particles."""

    quantiles: tuple[float, ...]

    def __post_init__(self) -> None:
        ends = (*self.quantiles, *self.quantiles[-1:])
        if len(self.quantiles) < 2 or not all(0 < a <= b < math.inf for a, b in itertools.pairwise(ends)):
            raise BadInput("sizes: diameters must be positive and rise; give at least two.")

    @property
    def largest(self) -> float:
        """[m]"""
        return self.quantiles[-1]

    @property
    def smallest(self) -> float:
        """[m]"""
        return self.quantiles[0]

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """`count` diameters [m] at random."""
        import numpy as np

        return np.interp(rng.random(count), np.linspace(0, 1, len(self.quantiles)), self.quantiles)


def uniform(smallest: float, largest: float) -> Sizes:
    """All diameters [m] between two alike often.

    >>> uniform(4e-3, 6e-3).smallest
    0.004
    """
    return Sizes((smallest, largest))


def normal(mean: float, std: float) -> Sizes:
    """Normally distributed diameters [m], cut off at three standard deviations."""
    return Sizes(tuple(mean + std * z for z in _normal_scores()))


def lognormal(median: float, spread: float) -> Sizes:
    """Diameters [m] whose logarithm is normally distributed with standard deviation `spread`, cut off at three."""
    if not median > 0:
        raise BadInput(f"sizes: the median must be positive, got {median:g}.")
    return Sizes(tuple(median * math.exp(spread * z) for z in _normal_scores()))


def sieved(meshes: Sequence[float], masses: Sequence[float]) -> Sizes:
    """Sizes from a sieving: `masses` [kg, or shares] between neighbouring `meshes` [m].

    Within a class the mass is spread evenly over the diameters; by number the small ones count as 1 / d^3.
    """
    import numpy as np

    edges, shares = np.array(meshes, dtype=float), np.array(masses, dtype=float)
    if len(edges) != len(shares) + 1 or not (np.all(edges > 0) and np.all(np.diff(edges) > 0)):
        raise BadInput("sizes: meshes must be positive and rise, and be one more than the masses between them.")
    if not (np.all(shares >= 0) and shares.sum() > 0):
        raise BadInput("sizes: masses must be zero or positive, and not all zero.")
    held = np.flatnonzero(shares)
    edges, shares = edges[held[0] : held[-1] + 2], shares[held[0] : held[-1] + 1]
    # number below d within a class that begins at a: integral of 1 / x^3
    fine = np.unique(np.concatenate([np.linspace(a, b, STEPS) for a, b in itertools.pairwise(edges)]))
    density = (shares / np.diff(edges))[
        np.clip(np.searchsorted(edges, fine[:-1], side="right") - 1, 0, len(shares) - 1)
    ]
    number = np.concatenate([[0], np.cumsum(density * (fine[:-1] ** -2 - fine[1:] ** -2) / 2)])
    return Sizes(tuple(np.interp(np.linspace(0, 1, STEPS + 1), number / number[-1], fine).tolist()))


def _normal_scores() -> list[float]:
    from scipy.special import ndtri

    low, high = 0.5 * math.erfc(CUT / math.sqrt(2)), 1 - 0.5 * math.erfc(CUT / math.sqrt(2))
    return [float(ndtri(low + (high - low) * k / STEPS)) for k in range(STEPS + 1)]
