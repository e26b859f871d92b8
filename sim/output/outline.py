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
    """Outline of spheres over x in `span` [m], seen along y; height above `floor` [m], NaN without a sphere.

    The spacing of the points is 1/24 of the diameter `grain` [m].
    """
    x = np.linspace(*span, math.ceil((span[1] - span[0]) / grain * POINTS_PER_DIAMETER) + 1)
    height = highest(x, centres[:, 0], centres[:, 2], radii)
    seen = np.where(np.isfinite(height), height - floor, np.nan)
    return Profile(x=x, height=seen, sigma=np.full(len(x), SIGMA), view=view)


def silhouette(centres: Array, radii: Array | float, base_diameter: float, view: float) -> Profile:
    """Outline of spheres on a round base, seen from `view` [deg] about its axis; 0 where only the base is visible.

    x runs over the base, 0 on its axis.  A rim is ignored: it would hide beads, but not raise the outline.
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
    """Height [m] of the uppermost edge of spheres at `across` and `up` over each `x` [m]; minus infinity if none."""
    height = np.full(len(x), -np.inf)
    for part in np.array_split(np.arange(len(across)), max(1, len(across) // 1000)):
        inside = radii[part, None] ** 2 - (x - across[part, None]) ** 2
        # a point on the edge would be inside or outside depending on rounding
        over = inside > 1e-9 * radii[part, None] ** 2
        edge = np.where(over, up[part, None] + np.sqrt(np.maximum(inside, 0.0)), -np.inf)
        height = np.maximum(height, edge.max(axis=0, initial=-np.inf))
    return height


def bed(centres: Array, radii: Array) -> npt.NDArray[np.bool_]:
    """Mask of the spheres in the largest cluster of neighbours, without those in flight."""
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
    """Height [m] of the uppermost sphere over points spread evenly over a round base; 0 without a sphere."""
    x = (np.arange(SURFACE_POINTS) + 0.5) / SURFACE_POINTS * diameter - diameter / 2
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    return surface_over(x, x, centres, radii)[np.hypot(points[..., 0], points[..., 1]) < diameter / 2]


def surface_over(x: Array, y: Array, centres: Array, radii: Array) -> Array:
    """Height [m] of the uppermost sphere over a grid, shape (len(x), len(y)); 0 without a sphere.

    `x` and `y` [m] are evenly spaced each.
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
