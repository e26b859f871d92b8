"""Shapes of particles made of overlapping spheres: mass properties of the union, and the layouts that rigs use.

A clump's density is that of its union as if it were solid, so that an overlap is never counted twice; the mass of the
real particle is kept by giving it density = mass / volume (Hlosta et al. 2020, section 2.2.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations, product
from typing import TYPE_CHECKING

from rigtwin.lab.errors import BadInput

if TYPE_CHECKING:
    from rigtwin.lab.arrays import Array


Vector = tuple[float, float, float]

ACCURACY = 1e-4  # relative, of volume and moments
TOUCHING = 1e-6  # [radii], gap of two spheres that still touch: rounding of written numbers
COARSEST, FINEST = 64, 2048  # columns across the union


@dataclass(frozen=True)
class Clump:
    """A rigid body of spheres, in its own axes: origin at the centre of mass, axes along the principal ones."""

    offsets: tuple[Vector, ...]  # [m], centres of the spheres
    radii: tuple[float, ...]  # [m]
    volume: float  # [m^3], of the union
    gyration: Vector  # [m^2], principal moments of inertia over the mass

    @property
    def reach(self) -> float:
        """Radius [m] of the sphere about the centre of mass that holds the clump."""
        return max(math.hypot(*place) + radius for place, radius in zip(self.offsets, self.radii, strict=True))

    def scaled(self, factor: float) -> Clump:
        """Return the clump with all lengths times a factor.

        Parameters
        ----------
        factor : float
            The factor [1].

        Returns
        -------
        Clump
            The other clump.
        """
        x, y, z = (factor**2 * one for one in self.gyration)
        return Clump(
            tuple((factor * a, factor * b, factor * c) for a, b, c in self.offsets),
            tuple(factor * radius for radius in self.radii),
            factor**3 * self.volume,
            (x, y, z),
        )


@dataclass(frozen=True)
class MassProperties:
    """Of the union of spheres, at unit density."""

    volume: float  # [m^3]
    centre: Vector  # [m]
    inertia: tuple[Vector, Vector, Vector]  # [m^5], tensor about the centre
    accuracy: float  # what the last refinement still changed, relative


def clump(offsets: Sequence[Vector], radii: Sequence[float] | float, *, accuracy: float = ACCURACY) -> Clump:
    """Return the clump of spheres, moved to its centre of mass and turned to its principal axes.

    Parameters
    ----------
    offsets : sequence of tuple of float
        Centres of the spheres [m], in any axes.
    radii : sequence of float or float
        Their radii [m], or the radius of all.
    accuracy : float
        Relative accuracy of volume and moments [1].

    Returns
    -------
    Clump
        The clump.

    Raises
    ------
    BadInput
        If a centre is not finite, a radius is not positive, there is no sphere or not one radius for each, or
        `accuracy` is not between 0 and 1.

    Examples
    --------
    >>> pair = clump([(-1e-3, 0, 0), (1e-3, 0, 0)], 1e-3)
    >>> round(pair.volume / (8 / 3 * math.pi * 1e-9), 4)
    1.0
    """
    sizes = (float(radii),) * len(offsets) if isinstance(radii, int | float) else tuple(map(float, radii))
    return _clump(tuple((float(x), float(y), float(z)) for x, y, z in offsets), sizes, accuracy)


@lru_cache(maxsize=256)
def _clump(offsets: tuple[Vector, ...], radii: tuple[float, ...], accuracy: float) -> Clump:
    import numpy as np

    whole = mass_properties(offsets, radii, accuracy=accuracy)
    tensor = np.array(whole.inertia) / whole.volume
    axes = principal_axes(tensor, accuracy)
    places = (np.array(offsets) - np.array(whole.centre)) @ axes
    gyration = np.diag(axes.T @ tensor @ axes)
    return Clump(tuple(map(_vector, places.tolist())), radii, whole.volume, _vector(gyration.tolist()))


def apart(centres: Array, radii: Array) -> int | None:
    """Find a sphere that is not connected with the first one.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m].
    radii : ndarray, shape (n,)
        Their radii [m].

    Returns
    -------
    int or None
        Index of the first sphere that no chain of touching spheres links to sphere 0; None if there is none.

    Examples
    --------
    >>> import numpy as np
    >>> apart(np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0]]), np.array([0.5, 0.5, 1.0]))
    2
    """
    import numpy as np

    joined, new = {0}, [0]
    while new:
        one = new.pop()
        reach = radii + radii[one] + TOUCHING * radii.min()
        found = set(np.flatnonzero(np.linalg.norm(centres - centres[one], axis=1) <= reach).tolist()) - joined
        joined |= found
        new += found
    return next((index for index in range(len(radii)) if index not in joined), None)


def principal_axes(tensor: Array, accuracy: float = ACCURACY) -> Array:
    """Return the principal axes of an inertia tensor.

    Parameters
    ----------
    tensor : ndarray, shape (3, 3)
        The tensor, in any unit.
    accuracy : float
        Off-diagonal part over the trace [1] up to which the given axes count as principal and are kept.

    Returns
    -------
    ndarray, shape (3, 3)
        The axes as columns, right-handed.
    """
    import numpy as np

    if np.abs(tensor - np.diag(np.diag(tensor))).max() <= accuracy * np.trace(tensor):
        return np.eye(3)
    _moments, axes = np.linalg.eigh(tensor)
    return np.asarray(axes * np.sign(np.linalg.det(axes)))


def _vector(numbers: Sequence[float]) -> Vector:
    x, y, z = numbers
    return float(x), float(y), float(z)


def mass_properties(offsets: Sequence[Vector], radii: Sequence[float], *, accuracy: float = ACCURACY) -> MassProperties:
    """Return volume, centre and inertia tensor of a union of spheres.

    The union is cut into columns, in each of which its length and moments are exact; the columns are halved until that
    changes no number by more than half the accuracy, or `FINEST` columns are reached.

    Parameters
    ----------
    offsets : sequence of tuple of float
        Centres of the spheres [m].
    radii : sequence of float
        Their radii [m].
    accuracy : float
        Relative accuracy [1].

    Returns
    -------
    MassProperties
        At unit density.

    Raises
    ------
    BadInput
        If a centre is not finite, a radius is not positive, there is no sphere or not one radius for each, or
        `accuracy` is not between 0 and 1.
    """
    import numpy as np

    if not (len(offsets) == len(radii) > 0):
        raise BadInput(f"clump: {len(offsets)} centres and {len(radii)} radii were given; give one radius per sphere.")
    centres, sizes = np.array(offsets, dtype=float), np.array(radii, dtype=float)
    if not (np.isfinite(centres).all() and np.isfinite(sizes).all() and (sizes > 0).all()):
        raise BadInput("clump: centres must be finite and radii positive.")
    if not 0 < accuracy < 1:
        raise BadInput(f"clump: accuracy must lie between 0 and 1, got {accuracy:g}.")
    middle = centres.mean(axis=0)
    columns, change = COARSEST, math.inf
    found = _integrals(centres - middle, sizes, columns)
    while change > accuracy / 2 and columns < FINEST:
        columns *= 2
        finer = _integrals(centres - middle, sizes, columns)
        size = np.trace(finer[4:].reshape(3, 3))
        scale = np.concatenate([[finer[0]], np.full(3, math.sqrt(size * finer[0])), np.full(9, size)])
        change, found = float(np.abs((finer - found) / scale).max()), finer
    volume, centre = float(found[0]), found[1:4] / found[0]
    second = found[4:].reshape(3, 3) - volume * np.outer(centre, centre)
    tensor = np.trace(second) * np.eye(3) - second
    rows = tuple(_vector(row) for row in tensor.tolist())
    return MassProperties(volume, _vector((centre + middle).tolist()), (rows[0], rows[1], rows[2]), change)


def _integrals(centres: Array, radii: Array, columns: int) -> Array:
    """Integrals of 1, x_i and x_i x_j over the union: 13 numbers."""
    import numpy as np

    low, high = (centres - radii[:, None]).min(axis=0), (centres + radii[:, None]).max(axis=0)
    pitch = (high - low)[1:] / columns
    y = low[1] + (np.arange(columns) + 0.5) * pitch[0]
    total = np.zeros(13)
    for z in low[2] + (np.arange(columns) + 0.5) * pitch[1]:
        cut = np.abs(z - centres[:, 2]) < radii
        if not cut.any():
            continue
        middles, sizes = centres[cut], radii[cut]
        half2 = sizes**2 - (y[:, None] - middles[:, 1]) ** 2 - (z - middles[:, 2]) ** 2
        half = np.sqrt(np.maximum(half2, 0.0))
        order = np.argsort(middles[:, 0] - half, axis=1)
        start = np.take_along_axis(middles[:, 0] - half, order, axis=1)
        end = np.maximum.accumulate(np.take_along_axis(middles[:, 0] + half, order, axis=1), axis=1)
        # what a sphere adds to those that began before it
        begin = np.maximum(start, np.concatenate([start[:, :1], end[:, :-1]], axis=1))
        begin = np.minimum(begin, end)
        length = (end - begin).sum(axis=1)
        first = ((end**2 - begin**2) / 2).sum(axis=1)
        second = ((end**3 - begin**3) / 3).sum(axis=1)
        one, x, xx = length.sum(), first.sum(), second.sum()
        ly, lyy, xy = (length * y).sum(), (length * y * y).sum(), (first * y).sum()
        total += [one, x, ly, one * z, xx, xy, x * z, xy, lyy, ly * z, x * z, ly * z, one * z * z]
    return np.asarray(total * pitch.prod())


# ---------------------------------------------------------------------- layouts


def row(count: int, radius: float, spacing: float) -> Clump:
    """Return equal spheres in a row along x: a pellet with round ends.

    Parameters
    ----------
    count : int
        Number of spheres.
    radius : float
        Their radius [m].
    spacing : float
        Distance of neighbouring centres [m].

    Returns
    -------
    Clump
        The clump.
    """
    return clump([((k - (count - 1) / 2) * spacing, 0.0, 0.0) for k in range(count)], radius)


def cubic(side: float, *orbits: tuple[tuple[float, float, float], float]) -> Clump:
    """Return spheres inside a cube, with all the symmetries of the cube.

    Parameters
    ----------
    side : float
        Side of the cube [m].
    *orbits : tuple
        Each a direction (in parts of the way from the middle to where the sphere touches the faces) and a radius [m]:
        (1, 1, 1) puts a sphere into each corner, (1, 1, 0) in the middle of each edge, (0, 0, 0) in the middle.

    Returns
    -------
    Clump
        The clump.

    Raises
    ------
    BadInput
        If a sphere does not fit the cube.
    """
    places: list[Vector] = []
    radii: list[float] = []
    for direction, radius in orbits:
        free = side / 2 - radius
        if free < 0:
            raise BadInput(f"clump: a sphere of radius {radius:g} m does not fit a cube of {side:g} m.")
        found = {
            _vector([sign * part * free + 0.0 for sign, part in zip(signs, order, strict=True)])
            for order in permutations(direction)
            for signs in product((-1, 1), repeat=3)
        }
        places += sorted(found)
        radii += [radius] * len(found)
    return clump(places, radii)
