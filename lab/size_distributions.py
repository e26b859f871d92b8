"""Size distributions of particles: diameters drawn by number; laws are given by number or by mass.

The particle itself is the largest of its distribution; one drawn smaller is the same body, shrunk.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from rigtwin.lab.errors import BadInput

if TYPE_CHECKING:
    import numpy as np

    from rigtwin.lab.arrays import Array

By = Literal["number", "mass"]
Law = Literal["list", "uniform", "normal", "lognormal", "sieve"]

STEPS = 100  # intervals of a law's table, evenly spaced in diameter; the mean mass is good to 1e-4
MOST_STEPS = 1000  # of a sieving with many classes
CUT = 3.0  # standard deviations; without an end the smallest particle would need an endless number of steps
WIDEST = 20.0  # largest over smallest diameter; the smallest sets the time step, and the largest fill no neighbour list


@dataclass(frozen=True)
class Sizes:
    """Shares, by number, of particles up to each diameter, with straight lines between: rising from 0 to 1.

    A diameter that stands there twice is that of a class of equal particles.
    """

    diameters: tuple[float, ...]  # [m]
    shares: tuple[float, ...]
    law: str = ""  # in words

    def __post_init__(self) -> None:
        d, shares = self.diameters, self.shares
        rise = all(0 < a <= b < math.inf for a, b in itertools.pairwise((*d, *d[-1:])))
        cover = (
            all(a <= b for a, b in itertools.pairwise(shares)) and bool(shares) and (shares[0], shares[-1]) == (0, 1)
        )
        if not (len(d) == len(shares) >= 2 and rise and cover):
            raise BadInput("sizes: diameters must be positive and rise, and their shares rise from 0 to 1.")
        if d[-1] > WIDEST * d[0]:
            raise BadInput(
                f"sizes: the largest diameter is {d[-1] / d[0]:.3g} times the smallest, and a twin takes at most "
                f"{WIDEST:g} times; leave out the finest part."
            )

    @property
    def largest(self) -> float:
        """Largest diameter [m]."""
        return self.diameters[-1]

    @property
    def smallest(self) -> float:
        """Smallest diameter [m]."""
        return self.diameters[0]

    def mean_power(self, power: int) -> float:
        """Return the mean of the diameters to a power, by number.

        Parameters
        ----------
        power : int
            The power.

        Returns
        -------
        float
            The mean [m^power].

        Examples
        --------
        >>> round(uniform(4e-3, 6e-3).mean_power(1), 6)
        0.005
        """
        return self.mean(lambda d: d**power)

    def mean(self, function: Callable[[Array], Array]) -> float:
        """Return the mean of a smooth function of the diameter, by number.

        Parameters
        ----------
        function : callable
            Takes diameters [m] as an array and returns one of the same shape.

        Returns
        -------
        float
            The mean, in the unit of the function.
        """
        import numpy as np

        d, shares = np.array(self.diameters), np.diff(self.shares)
        # Gauss-Legendre with four points: exact for powers up to seven
        points, weights = np.polynomial.legendre.leggauss(4)
        within = (d[:-1, None] + d[1:, None]) / 2 + np.diff(d)[:, None] / 2 * points
        return float((shares[:, None] * weights / 2 * function(within)).sum())

    @property
    def median_by_mass(self) -> float:
        """Diameter [m] up to which particles have half of the mass."""
        import numpy as np

        d = np.array(self.diameters)
        a, b = d[:-1], d[1:]
        masses = np.diff(self.shares) * (a + b) * (a**2 + b**2)  # of d^3, four times its mean in each interval
        below = np.concatenate([[0.0], np.cumsum(masses)]) / masses.sum()
        at = min(int(np.searchsorted(below, 0.5, side="left")) - 1, len(a) - 1)
        part = (0.5 - below[at]) / (below[at + 1] - below[at])
        # within the interval the mass rises with the fourth power
        return float((a[at] ** 4 + part * (b[at] ** 4 - a[at] ** 4)) ** 0.25)

    def classes(self, most: int = 10) -> list[tuple[float, float]]:
        """Return classes of equal particles that stand for the distribution.

        Parameters
        ----------
        most : int
            Largest number of classes.

        Returns
        -------
        list of tuple of float
            Diameter [m] and share of the mass [1] of each class.
        """
        import numpy as np

        if self.diameters[::2] == self.diameters[1::2] and len(self.diameters) <= 2 * most:
            d, numbers = np.array(self.diameters[::2]), np.diff(self.shares)[::2]
            cubes = numbers * d**3
        else:
            ends = np.linspace(self.smallest, self.largest, most + 1)
            fine = np.union1d(self.diameters, ends)
            shares, a, b = np.diff(np.interp(fine, self.diameters, self.shares)), fine[:-1], fine[1:]
            first = np.searchsorted(fine, ends[:-1])
            numbers = np.add.reduceat(shares, first)
            cubes = np.add.reduceat(shares * (a + b) * (a**2 + b**2) / 4, first)
        held = numbers > 0
        diameters = np.cbrt(cubes[held] / numbers[held])
        return list(zip(diameters.tolist(), (cubes[held] / cubes.sum()).tolist(), strict=True))

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draw diameters: one at random in each of so many equal shares of the number, in random order.

        Parameters
        ----------
        count : int
            Number of diameters.
        rng : numpy.random.Generator
            Source of the numbers.

        Returns
        -------
        ndarray, shape (count,)
            Diameters [m].
        """
        import numpy as np

        shares = (rng.permutation(count) + rng.random(count)) / max(count, 1)
        return np.interp(shares, self.shares, self.diameters)

    def scaled(self, factor: float) -> Sizes:
        """Return the distribution with all diameters times a factor.

        Parameters
        ----------
        factor : float
            The factor [1].

        Returns
        -------
        Sizes
            The other distribution.
        """
        return Sizes(tuple(factor * one for one in self.diameters), self.shares, self.law)


def uniform(smallest: float, largest: float, *, by: By = "number") -> Sizes:
    """Return a uniform size distribution between two ends.

    Parameters
    ----------
    smallest, largest : float
        The ends [m].
    by : {"number", "mass"}
        What is spread evenly over the diameters.

    Returns
    -------
    Sizes
        The distribution.

    Raises
    ------
    BadInput
        If the smallest diameter is not positive or is above the largest.

    Examples
    --------
    >>> uniform(4e-3, 6e-3).smallest
    0.004
    """
    law = f"uniform from {_mm(smallest)} to {_mm(largest)}"
    if not 0 < smallest <= largest:
        raise BadInput("sizes: the smallest diameter must be positive and at most the largest.")
    return _tabled([smallest, largest], [1.0], by, law)


def normal(
    mean: float, std: float, *, by: By = "number", smallest: float | None = None, largest: float | None = None
) -> Sizes:
    """Return normally distributed diameters, cut off at three standard deviations or at the given ends.

    Parameters
    ----------
    mean, std : float
        Mean and standard deviation [m].
    by : {"number", "mass"}
        What is distributed like this.
    smallest, largest : float, optional
        The ends [m].

    Returns
    -------
    Sizes
        The distribution.

    Raises
    ------
    BadInput
        If `mean` or `std` is not positive, an end is not positive, the smallest diameter is not below the largest, or
        nothing of the distribution lies between them.
    """
    if not (mean > 0 and std > 0):
        raise BadInput("sizes: mean and standard deviation must be positive.")
    low = mean - CUT * std if smallest is None else smallest
    high = mean + CUT * std if largest is None else largest
    if low <= 0:
        raise BadInput(
            f"sizes: {CUT:g} standard deviations of {_mm(std)} below a mean of {_mm(mean)} no diameter is left; give "
            "the smallest one."
        )
    return _bell(lambda d: (d - mean) / std, low, high, by, f"normal, {_mm(mean)} ± {_mm(std)}")


def lognormal(
    median: float, spread: float, *, by: By = "number", smallest: float | None = None, largest: float | None = None
) -> Sizes:
    """Return diameters whose logarithm is normally distributed.

    They are cut off at three standard deviations or at the given ends.

    Parameters
    ----------
    median : float
        Median [m].
    spread : float
        Standard deviation of the natural logarithm [1].
    by : {"number", "mass"}
        What is distributed like this.
    smallest, largest : float, optional
        The ends [m].

    Returns
    -------
    Sizes
        The distribution.

    Raises
    ------
    BadInput
        If `median` or `spread` is not positive, an end is not positive, the smallest diameter is not below the largest,
        or nothing of the distribution lies between them.
    """
    import numpy as np

    if not (median > 0 and spread > 0):
        raise BadInput("sizes: median and spread must be positive.")
    low = median * math.exp(-CUT * spread) if smallest is None else smallest
    high = median * math.exp(CUT * spread) if largest is None else largest
    law = f"lognormal, median {_mm(median)}, spread {spread:g}"
    return _bell(lambda d: np.log(d / median) / spread, low, high, by, law)


def listed(diameters: Sequence[float], shares: Sequence[float], *, by: By = "mass") -> Sizes:
    """Return classes of equal particles.

    Parameters
    ----------
    diameters : sequence of float
        Diameter of each class [m].
    shares : sequence of float
        Share of each, in any unit.
    by : {"number", "mass"}
        Of what they are shares.

    Returns
    -------
    Sizes
        The distribution.

    Raises
    ------
    BadInput
        If a diameter is not positive, two diameters are equal, a share is negative or not finite, all are zero, or
        there is not one for each diameter.
    """
    import numpy as np

    if not (len(diameters) == len(shares) > 0):
        raise BadInput(f"sizes: {len(diameters)} diameters and {len(shares)} shares were given; give one for each.")
    order = np.argsort(diameters)
    sizes, parts = np.array(diameters, dtype=float)[order], np.array(shares, dtype=float)[order]
    if not ((sizes > 0).all() and (np.diff(sizes) > 0).all()):
        raise BadInput("sizes: diameters must be positive and all different.")
    parts = _of_number(_checked(parts), sizes, by)
    ends = np.concatenate([[0.0], np.cumsum(parts) / parts.sum()])
    ends[-1] = 1.0
    law = f"{len(sizes)} sizes from {_mm(sizes[0])} to {_mm(sizes[-1])}"
    return Sizes(
        tuple(np.repeat(sizes, 2).tolist()), tuple(np.column_stack([ends[:-1], ends[1:]]).ravel().tolist()), law
    )


def sieved(meshes: Sequence[float], masses: Sequence[float], *, by: By = "mass") -> Sizes:
    """Return sizes from a sieving.

    Within a class number or mass is spread evenly over the diameters.

    Parameters
    ----------
    meshes : sequence of float
        Widths of the meshes [m], rising.
    masses : sequence of float
        What lies between neighbouring meshes, one less than these: [kg], or shares.
    by : {"number", "mass"}
        Of what they are shares.

    Returns
    -------
    Sizes
        The distribution.

    Raises
    ------
    BadInput
        If the meshes are not positive or do not rise, or are not one more than the masses; or if a mass is negative or
        not finite, or all are zero.
    """
    import numpy as np

    edges, shares = np.array(meshes, dtype=float), np.array(masses, dtype=float)
    if len(edges) != len(shares) + 1 or not (np.all(edges > 0) and np.all(np.diff(edges) > 0)):
        raise BadInput("sizes: meshes must be positive and rise, and be one more than the masses between them.")
    shares = _checked(shares)
    held = np.flatnonzero(shares)
    edges, shares = edges[held[0] : held[-1] + 2], shares[held[0] : held[-1] + 1]
    law = f"sieved, {len(shares)} classes from {_mm(edges[0])} to {_mm(edges[-1])}"
    return _tabled(edges.tolist(), shares.tolist(), by, law)


def _checked(shares: Array) -> Array:
    import numpy as np

    if not (np.isfinite(shares).all() and (shares >= 0).all() and shares.sum() > 0):
        raise BadInput("sizes: shares must be zero or positive, and not all zero.")
    return shares


def _tabled(edges: Sequence[float], shares: Sequence[float], by: By, law: str) -> Sizes:
    """Classes in each of which number or mass is spread evenly over the diameters."""
    import numpy as np

    if edges[0] == edges[-1]:
        return Sizes((edges[0], edges[0]), (0.0, 1.0), law)
    if by == "number":
        return _of_shares(np.array(edges), np.array(shares), law)
    steps = max(1, min(STEPS, MOST_STEPS // len(shares)))
    fine = np.unique(np.concatenate([np.linspace(a, b, steps + 1) for a, b in itertools.pairwise(edges)]))
    within = np.clip(np.searchsorted(edges, fine[:-1], side="right") - 1, 0, len(shares) - 1)
    density = (np.array(shares) / np.diff(edges))[within]
    # number in an interval: integral of 1 / x^3
    return _of_shares(fine, density * (fine[:-1] ** -2 - fine[1:] ** -2), law)


def _bell(score: Callable[[Array], Array], low: float, high: float, by: By, law: str) -> Sizes:
    import numpy as np
    from scipy.special import ndtr

    if not 0 < low < high:
        raise BadInput("sizes: the smallest diameter must be positive and below the largest.")
    fine = np.linspace(low, high, STEPS + 1)
    shares = np.diff(ndtr(score(fine)))
    if not shares.sum() > 0:
        raise BadInput("sizes: no part of the distribution lies between the smallest and the largest diameter.")
    return _of_shares(fine, _of_number(shares, (fine[:-1] + fine[1:]) / 2, by), law)


def _of_number(shares: Array, diameters: Array, by: By) -> Array:
    return shares if by == "number" else shares / (diameters / diameters[-1]) ** 3


def _of_shares(edges: Array, shares: Array, law: str) -> Sizes:
    import numpy as np

    below = np.concatenate([[0.0], np.cumsum(shares) / shares.sum()])
    below[-1] = 1.0
    return Sizes(tuple(edges.tolist()), tuple(below.tolist()), law)


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g} mm"
