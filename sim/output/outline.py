"""Outlines of beads in orthographic side view: the highest bead edge over x."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.records import Profile

VIEWS = (0.0, 45.0, 90.0, 135.0)  # [deg], about the vertical axis, viewing directions of a round rig
POINTS_PER_DIAMETER = 24
SIGMA = 1e-5  # [m], standard uncertainty of a silhouette: of the order of the beads' overlaps
SURFACE_POINTS = 100  # across the cylinder
POINTS_AT_ONCE = 1_000_000  # pairs of a sphere and a point; bounds the memory
NEIGHBOURS = 1.1  # [sums of radii], largest distance of the centres of neighbours in a bed


def outline(
    centres: Array, radii: Array, span: tuple[float, float], *, grain: float, floor: float = 0.0, view: str
) -> Profile:
    """Return the outline of spheres, seen along y.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m].
    radii : ndarray, shape (n,)
        Their radii [m].
    span : tuple of float
        Ends of the outline in x [m].
    grain : float
        A diameter [m], of which the spacing of the points is 1/24.
    floor : float
        Level z [m] from which heights count.
    view : str
        Name of the view.

    Returns
    -------
    Profile
        Height [m] over x; NaN without a sphere.
    """
    x = np.linspace(*span, math.ceil((span[1] - span[0]) / grain * POINTS_PER_DIAMETER) + 1)
    height = highest(x, centres[:, 0], centres[:, 2], radii)
    seen = np.where(np.isfinite(height), height - floor, np.nan)
    return Profile(x=x, height=seen, sigma=np.full(len(x), SIGMA), view=view)


def silhouette(centres: Array, radii: Array | float, base_diameter: float, view: float) -> Profile:
    """Return the outline of spheres on a round base, seen from the side.

    A rim is ignored: it would hide beads, but not raise the outline.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m], from the middle of the base.
    radii : ndarray, shape (n,), or float
        Their radii [m].
    base_diameter : float
        Diameter of the base [m].
    view : float
        Direction of view [deg] about its axis.

    Returns
    -------
    Profile
        Height [m] over x, which runs over the base, 0 on its axis; 0 where only the base is visible.
    """
    radii = np.broadcast_to(radii, len(centres))
    angle = math.radians(view)
    across = centres[:, :2] @ (math.cos(angle), math.sin(angle))
    turned = np.column_stack([across, np.zeros(len(centres)), centres[:, 2]])
    half = base_diameter / 2
    grain = 2 * float(radii.max()) if len(radii) else base_diameter
    seen = outline(turned, radii, (-half, half), grain=grain, view=f"{view:g} deg")
    return replace(seen, height=np.maximum(np.nan_to_num(seen.height), 0.0), base=(-half, half))


def highest(x: Array, across: Array, up: Array, radii: Array) -> Array:
    """Return the height of the uppermost edge of spheres over each x.

    Parameters
    ----------
    x : ndarray, shape (k,)
        The places [m].
    across, up : ndarray, shape (n,)
        Centres of the spheres, along x and upwards [m].
    radii : ndarray, shape (n,)
        Their radii [m].

    Returns
    -------
    ndarray, shape (k,)
        Heights [m]; minus infinity if there is none.
    """
    height = np.full(len(x), -np.inf)
    for part in np.array_split(np.arange(len(across)), max(1, len(across) // 1000)):
        inside = radii[part, None] ** 2 - (x - across[part, None]) ** 2
        # a point on the edge would be inside or outside depending on rounding
        over = inside > 1e-9 * radii[part, None] ** 2
        edge = np.where(over, up[part, None] + np.sqrt(np.maximum(inside, 0.0)), -np.inf)
        height = np.maximum(height, edge.max(axis=0, initial=-np.inf))
    return height


def bed(centres: Array, radii: Array) -> npt.NDArray[np.bool_]:
    """Return which spheres are in the largest cluster of neighbours, without those in flight.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m].
    radii : ndarray, shape (n,)
        Their radii [m].

    Returns
    -------
    ndarray of bool, shape (n,)
        Whether each is in it.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if not len(centres):
        return np.zeros(0, dtype=bool)
    near = cKDTree(centres).query_pairs(2 * NEIGHBOURS * radii.max(), output_type="ndarray")
    near = near[np.linalg.norm(centres[near[:, 0]] - centres[near[:, 1]], axis=1) < NEIGHBOURS * radii[near].sum(1)]
    graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(centres), len(centres)))
    heap = connected_components(graph, directed=False)[1]
    return np.asarray(heap == np.bincount(heap).argmax())


def surface(centres: Array, radii: Array, diameter: float) -> Array:
    """Return the height of the uppermost sphere over points spread evenly over a round base.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m], from the middle of the base.
    radii : ndarray, shape (n,)
        Their radii [m].
    diameter : float
        Diameter of the base [m].

    Returns
    -------
    ndarray, shape (k,)
        Heights [m]; 0 without a sphere.
    """
    x = (np.arange(SURFACE_POINTS) + 0.5) / SURFACE_POINTS * diameter - diameter / 2
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    return surface_over(x, x, centres, radii)[np.hypot(points[..., 0], points[..., 1]) < diameter / 2]


def surface_over(x: Array, y: Array, centres: Array, radii: Array) -> Array:
    """Return the height of the uppermost sphere over a grid.

    Parameters
    ----------
    x, y : ndarray
        Places of its lines [m], evenly spaced each.
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m].
    radii : ndarray, shape (n,)
        Their radii [m].

    Returns
    -------
    ndarray, shape (len(x), len(y))
        Heights [m]; 0 without a sphere.
    """
    height = np.zeros((len(x), len(y)))
    reach = radii.max(initial=0.0)
    # grid lines that a sphere may lie over, and one to spare
    counts = [math.ceil(2 * reach / _spacing(axis)) + 2 for axis in (x, y)]
    for part in np.array_split(np.arange(len(centres)), max(1, len(centres) * math.prod(counts) // POINTS_AT_ONCE)):
        apart2, lines = [], []
        for column, (axis, count) in enumerate(zip((x, y), counts, strict=True)):
            place = centres[part, column, None]
            line = np.floor((place - reach - axis[0]) / _spacing(axis)).astype(np.int64) + np.arange(count)
            on_grid = (line >= 0) & (line < len(axis))
            lines.append(np.clip(line, 0, len(axis) - 1))
            apart2.append(np.where(on_grid, (axis[lines[column]] - place) ** 2, np.inf))
        over = radii[part, None, None] ** 2 - (apart2[0][:, :, None] + apart2[1][:, None, :])
        sphere, i, j = np.nonzero(over >= 0)
        top = centres[part][sphere, 2] + np.sqrt(over[sphere, i, j])
        np.maximum.at(height, (lines[0][sphere, i], lines[1][sphere, j]), top)
    return height


def _spacing(axis: Array) -> float:
    return float(axis[-1] - axis[0]) / (len(axis) - 1) if len(axis) > 1 else 1.0
