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
from pathlib import Path
from typing import TYPE_CHECKING

from rigtwin.lab.errors import BadInput

if TYPE_CHECKING:
    from trimesh import Trimesh

    from rigtwin.lab.arrays import Array


Vector = tuple[float, float, float]

ACCURACY = 1e-4  # relative, of volume and moments
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


@dataclass(frozen=True)
class MassProperties:
    """Of the union of spheres, at unit density."""

    volume: float  # [m^3]
    centre: Vector  # [m]
    inertia: tuple[Vector, Vector, Vector]  # [m^5], tensor about the centre
    accuracy: float  # what the last refinement still changed, relative


def clump(offsets: Sequence[Vector], radii: Sequence[float] | float, *, accuracy: float = ACCURACY) -> Clump:
    """The clump of these spheres [m], moved to its centre of mass and turned to its principal axes.

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
    axes = np.eye(3)
    if np.abs(tensor - np.diag(np.diag(tensor))).max() > accuracy * np.trace(tensor):
        _moments, axes = np.linalg.eigh(tensor)
        axes *= np.sign(np.linalg.det(axes))
    places = (np.array(offsets) - np.array(whole.centre)) @ axes
    gyration = np.diag(axes.T @ tensor @ axes)
    return Clump(tuple(map(_vector, places.tolist())), radii, whole.volume, _vector(gyration.tolist()))


def _vector(numbers: Sequence[float]) -> Vector:
    x, y, z = numbers
    return float(x), float(y), float(z)


def mass_properties(offsets: Sequence[Vector], radii: Sequence[float], *, accuracy: float = ACCURACY) -> MassProperties:
    """Volume, centre and inertia tensor of a union of spheres [m], to a relative `accuracy`.

    The union is cut into columns, in each of which its length and moments are exact; the columns are halved until
    that changes no number by more than half the accuracy.
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
    """`count` equal spheres in a row along x: a pellet with round ends [m]."""
    return clump([((k - (count - 1) / 2) * spacing, 0.0, 0.0) for k in range(count)], radius)


def cubic(side: float, *orbits: tuple[tuple[float, float, float], float]) -> Clump:
    """Spheres inside a cube of this side [m], with all the symmetries of the cube.

    Each orbit is a direction (in parts of the way from the middle to where the sphere touches the faces) and a
    radius [m]: (1, 1, 1) puts a sphere into each corner, (1, 1, 0) in the middle of each edge, (0, 0, 0) in the
    middle.
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


# ---------------------------------------------------------------------- filling a body

GRID = 40  # points along the longest side, at which the body is looked at
CANDIDATES = 4000  # places tried as centres
CLIMB = 6  # times that a chosen place looks round for a deeper one, each time half as far


def filled(body: Trimesh | Path, count: int, *, seed: int = 1) -> Clump:
    """`count` spheres inside a closed body [m] (a mesh, or an STL file in metres), each as large as fits.

    Each next sphere is the one that covers most of what the others leave free, of some thousand places.  The spheres
    touch the surface from inside and never pass it, so the clump is a little smaller than the body; its mass is set by
    its density.  Primitives are `trimesh.creation.box` and the like.
    """
    import numpy as np
    from scipy.sparse import csr_array
    from scipy.spatial import cKDTree
    from trimesh.remesh import subdivide_to_size

    mesh = _closed(body)
    if count < 1:
        raise BadInput(f"clump: {count} spheres fill nothing; give at least 1.")
    rng = np.random.default_rng(seed)
    inside, pitch = _points_inside(mesh)
    samples = subdivide_to_size(mesh.vertices, mesh.faces, pitch)[0]  # type: ignore[no-untyped-call]
    surface = cKDTree(samples)
    places = inside[rng.permutation(len(inside))[:CANDIDATES]]
    radii = surface.query(places)[0]
    reached = cKDTree(inside).query_ball_point(places, radii)
    ends = np.cumsum([0, *map(len, reached)])
    covers = csr_array((np.ones(ends[-1], np.float32), np.concatenate(reached), ends), (len(places), len(inside)))
    free = np.ones(len(inside), np.float32)
    chosen: list[Array] = []
    for _ in range(count):
        gains = np.asarray(covers @ free)
        best = int(np.argmax(gains))
        if gains[best] < 1:
            raise BadInput(f"clump: {len(chosen)} spheres already fill the body; give no more than {len(chosen)}.")
        place = places[best]
        for narrower in range(CLIMB):
            near = place + rng.uniform(-pitch, pitch, (100, 3)) / 2**narrower
            place = np.vstack([place, near])[int(np.argmax(surface.query(np.vstack([place, near]))[0]))]
        covered = ((inside - place) ** 2).sum(axis=1) <= surface.query(place)[0] ** 2
        if covered @ free < gains[best]:  # deeper, and so larger, but over what others cover already
            place, covered = places[best], covers[[best]].toarray()[0] > 0
        chosen.append(place)
        free[covered] = 0.0
    depths = [_depth(mesh, place) for place in chosen]
    return clump([_vector(place.tolist()) for place in chosen], depths)


def _closed(body: Trimesh | Path) -> Trimesh:
    import trimesh

    mesh = body
    if isinstance(body, Path):
        try:
            mesh = trimesh.load_mesh(body)
        except Exception as trouble:  # each of trimesh's readers fails in its own way
            raise BadInput(f"{body}: cannot be read as a mesh ({trouble}); give an STL file.") from None
    if not (isinstance(mesh, trimesh.Trimesh) and mesh.is_watertight and mesh.volume > 0):
        name = str(body) if isinstance(body, Path) else "clump"
        raise BadInput(f"{name}: the body is not closed, or its faces look inwards; mend the mesh.")
    return mesh


def _points_inside(mesh: Trimesh) -> tuple[Array, float]:
    """Points of a grid that lie inside, shape (n, 3), and its pitch [m]."""
    import numpy as np

    low, high = mesh.bounds
    pitch = (high - low).max() / GRID
    axes = [np.arange(lower + pitch / 2, upper, pitch) for lower, upper in zip(low, high, strict=True)]
    # a ray upwards through each column leaves the body where it entered it
    columns = np.stack(np.meshgrid(axes[0], axes[1], indexing="ij"), axis=-1).reshape(-1, 2) + 1e-7 * pitch
    corners = np.asarray(mesh.triangles)
    found = []
    for x, y in columns:
        heights = _crossings(corners, x, y)
        within = np.searchsorted(heights, axes[2]) % 2 == 1
        found.append(np.column_stack([np.full(within.sum(), x), np.full(within.sum(), y), axes[2][within]]))
    points = np.concatenate(found)
    if not len(points):
        raise BadInput("clump: the body is too thin to be filled with spheres.")
    return points, float(pitch)


def _crossings(corners: Array, x: float, y: float) -> Array:
    """Heights, rising, at which the line upwards through (x, y) meets triangles, shape (n, 3, 3)."""
    import numpy as np

    a, b, c = (corners[:, k, :2] - (x, y) for k in range(3))

    def cross(one: Array, other: Array) -> Array:
        return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])

    weights = np.stack([cross(b, c), cross(c, a), cross(a, b)], axis=1)
    hit = (weights > 0).all(axis=1) | (weights < 0).all(axis=1)
    share = weights[hit] / weights[hit].sum(axis=1, keepdims=True)
    return np.sort((share * corners[hit, :, 2]).sum(axis=1))


def _depth(mesh: Trimesh, point: Array) -> float:
    """Distance [m] of a point to the mesh."""
    import numpy as np
    from trimesh.triangles import closest_point

    corners = np.asarray(mesh.triangles)
    nearest = np.asarray(closest_point(corners, np.tile(point, (len(corners), 1))))  # type: ignore[no-untyped-call]
    return float(np.linalg.norm(nearest - point, axis=1).min())
