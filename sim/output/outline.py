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
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    return surface_over(points[np.hypot(*points.T) < diameter / 2], centres, radii, diameter / SURFACE_POINTS)


def surface_over(points: Array, centres: Array, radii: Array, pitch: float) -> Array:
    """Height [m] of the uppermost sphere over `points` [m], shape (n, 2), `pitch` [m] apart; 0 without a sphere."""
    height = np.zeros(len(points))
    for part in np.array_split(np.arange(len(points)), max(1, len(points) * len(centres) // 4_000_000)):
        low = points[part].min(axis=0) - radii.max(initial=0.0) - pitch
        high = points[part].max(axis=0) + radii.max(initial=0.0) + pitch
        near = ((centres[:, :2] > low) & (centres[:, :2] < high)).all(axis=1)
        place, radius = centres[near], radii[near]
        over = radius**2 - ((points[part, None] - place[:, :2]) ** 2).sum(axis=2)
        top = np.where(over >= 0, place[:, 2] + np.sqrt(np.maximum(over, 0.0)), 0.0)
        height[part] = top.max(axis=1, initial=0.0)
    return height
