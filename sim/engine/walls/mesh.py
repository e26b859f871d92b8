"""Walls of triangles: checked, and sorted into cells so that a bead tests only near ones.

::

    funnel = Mesh(stl_facets(Path("funnel.stl"), 1e-3, advice).triangles)
    box = Mesh(corners, closed=True)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.sim.engine.walls import elements

Whole = npt.NDArray[np.int32]

MOST_CELLS = 32_768
ALONE = 32  # up to this number all triangles are tested, without cells
CHUNK = 200_000  # pairs of a point and a triangle processed at a time
LEAST_HEIGHT = 1e-9  # height over longest side; flatter triangles coincide with edges of their neighbours


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles, with contact on either face, on edges and corners; neighbours form one surface."""

    corners: Array  # [m], shape (n, 3 corners, 3)
    closed: bool = False  # whether it must enclose a volume
    name: str = "mesh"  # in messages

    def __post_init__(self) -> None:
        corners = np.ascontiguousarray(self.corners, dtype=np.float64)
        if corners.ndim != 3 or corners.shape[1:] != (3, 3) or not len(corners):
            raise BadInput(f"{self.name}: a mesh needs triangles, an array of shape (n, 3, 3); got {corners.shape}.")
        if not np.isfinite(corners).all():
            bad = int(np.argmin(np.isfinite(corners).all((1, 2))))
            raise BadInput(f"{self.name}: triangle {bad} has a corner that is not a finite number.")
        sides = np.roll(corners, -1, axis=1) - corners
        longest = np.linalg.norm(sides, axis=2).max(1)
        wide = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) > LEAST_HEIGHT * longest**2
        if not wide.any():
            raise BadInput(f"{self.name}: none of its triangles has an area; check the file and its unit.")
        object.__setattr__(self, "corners", corners[wide])
        if self.closed and (open_edges := _open_edges(corners)):
            raise BadInput(
                f"{self.name}: the mesh must be closed, but {open_edges} of its edges do not belong to two triangles; "
                "repair it, or declare it open."
            )

    @property
    def rows(self) -> Array:
        """The triangles as elements."""
        return elements.triangles(self.corners)


def _open_edges(corners: Array) -> int:
    """Number of edges that do not belong to exactly two triangles; corners within 1e-6 of the mesh size are merged."""
    flat = corners.reshape(-1, 3)
    size = np.ptp(flat, axis=0).max()
    _points, number = np.unique(np.round((flat - flat.min(0)) / (1e-6 * size)), axis=0, return_inverse=True)
    faces = number.reshape(-1, 3)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    _edges, shared = np.unique(edges, axis=0, return_counts=True)
    return int((shared != 2).sum())


@dataclass(frozen=True)
class Cells:
    """Triangles that may be within reach of a point, for each cell of a grid."""

    low: Array  # [m], corner of the grid
    size: float  # [m], of a cell
    shape: tuple[int, int, int]
    first: Whole  # first item of each cell, and the end of the last one
    items: Whole  # triangles

    def of(self, points: Array) -> npt.NDArray[np.int64]:
        """Index of the cell of each point; -1 outside the grid."""
        place = np.floor((points - self.low) / self.size).astype(np.int64)
        inside = ((place >= 0) & (place < self.shape)).all(1)
        number = (place[:, 2] * self.shape[1] + place[:, 1]) * self.shape[0] + place[:, 0]
        return np.where(inside, number, -1)


def sort_into_cells(corners: Array, reach: float) -> Cells:
    """Cells that list every triangle within `reach` [m] of any point in them."""
    low = corners.min((0, 1)) - reach
    extent = corners.max((0, 1)) + reach - low
    size = 2 * reach
    while np.ceil(extent / size).prod() > MOST_CELLS:
        size *= 1.2
    shape = np.maximum(1, np.ceil(extent / size)).astype(int)
    pairs = [
        pair[_close(corners, pair, low, size, reach)] for pair in _neighbourhoods(corners, low, size, shape, reach)
    ]
    found = np.concatenate(pairs)
    number = (found[:, 3] * shape[1] + found[:, 2]) * shape[0] + found[:, 1]
    order = np.lexsort((found[:, 0], number))
    first = np.searchsorted(number[order], np.arange(shape.prod() + 1))
    across = int(shape[0]), int(shape[1]), int(shape[2])
    return Cells(low, size, across, first.astype(np.int32), found[order, 0].astype(np.int32))


def _neighbourhoods(corners: Array, low: Array, size: float, shape: Array, reach: float) -> Iterator[Array]:
    """Rows (triangle, x, y, z) of all cells that the bounding box of a triangle touches, in chunks."""
    begin = np.clip(np.floor((corners.min(1) - reach - low) / size), 0, shape - 1).astype(np.int64)
    end = np.clip(np.floor((corners.max(1) + reach - low) / size), 0, shape - 1).astype(np.int64)
    across = end - begin + 1
    counts = across.prod(1)
    start = 0
    while start < len(corners):
        stop = start + max(1, int(np.searchsorted(np.cumsum(counts[start:]), CHUNK)))
        one = np.repeat(np.arange(start, min(stop, len(corners))), counts[start:stop])
        within = np.arange(len(one)) - np.repeat(np.cumsum(counts[start:stop]) - counts[start:stop], counts[start:stop])
        x, rest = within % across[one, 0], within // across[one, 0]
        yield np.stack([one, *(begin[one] + np.stack([x, rest % across[one, 1], rest // across[one, 1]], 1)).T], axis=1)
        start = stop


def _close(corners: Array, pairs: Array, low: Array, size: float, reach: float) -> npt.NDArray[np.bool_]:
    """Whether a point of the cell may be within reach of the triangle."""
    centres = low + (pairs[:, 1:] + 0.5) * size
    return np.asarray(distances(corners[pairs[:, 0]], centres) <= reach + 0.5 * np.sqrt(3) * size)


def distances(corners: Array, points: Array) -> Array:
    """Distance [m] of each point from the triangle in the same row."""
    sides, out = np.roll(corners, -1, axis=1) - corners, points[:, None] - corners
    part = np.clip((out * sides).sum(2) / np.maximum((sides**2).sum(2), 1e-300), 0, 1)
    to_edges = np.linalg.norm(out - part[..., None] * sides, axis=2).min(1)
    normal = np.cross(sides[:, 0], sides[:, 1])
    above = (np.cross(sides, out) * normal[:, None]).sum(2).min(1) >= 0  # above the face, not beyond an edge
    to_plane = np.abs((out[:, 0] * normal).sum(1)) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    return np.asarray(np.where(above, to_plane, to_edges))


def least_distances(corners: Array, points: Array, reach: float) -> Array:
    """Distance [m] of points from the nearest triangle, shape (n,); infinite beyond `reach` [m]."""
    least = np.full(len(points), np.inf)
    if len(corners) <= ALONE:
        for triangle in corners:
            least = np.minimum(least, distances(np.broadcast_to(triangle, (len(points), 3, 3)), points))
    else:
        cells = sort_into_cells(corners, reach)
        number = cells.of(points)
        inside = np.flatnonzero(number >= 0)
        counts = np.diff(cells.first)[number[inside]]
        for some in np.array_split(np.arange(len(inside)), max(1, int(counts.sum() // CHUNK))):
            point = np.repeat(inside[some], counts[some])
            skip = np.arange(len(point)) - np.repeat(np.cumsum(counts[some]) - counts[some], counts[some])
            triangle = cells.items[cells.first[number[point]] + skip]
            np.minimum.at(least, point, distances(corners[triangle], points[point]))
    return np.where(least <= reach, least, np.inf)
