"""The outline of beads seen from the side, orthographic: the highest bead edge over x."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rigtwin.lab.records import Profile

Array = npt.NDArray[np.float64]

POINTS_PER_DIAMETER = 24
SIGMA = 1e-5  # [m], a silhouette of exact spheres is as good as the beads' overlap
NEIGHBOURS = 1.1  # sums of radii; spheres farther apart are not of one bed


def outline(
    centres: Array, radii: Array, span: tuple[float, float], *, grain: float, floor: float = 0.0, view: str
) -> Profile:
    """Outline of spheres over x in `span` [m], seen along y; height above `floor` [m], NaN where no sphere is.

    Points lie a 24th of the diameter `grain` [m] apart.
    """
    x = np.linspace(*span, math.ceil((span[1] - span[0]) / grain * POINTS_PER_DIAMETER) + 1)
    height = np.full(len(x), -np.inf)
    for part in np.array_split(np.arange(len(centres)), max(1, len(centres) // 1000)):
        inside = radii[part, None] ** 2 - (x - centres[part, 0, None]) ** 2
        edge = np.where(inside >= 0, centres[part, 2, None] + np.sqrt(np.maximum(inside, 0.0)), -np.inf)
        height = np.maximum(height, edge.max(axis=0, initial=-np.inf))
    seen = np.where(np.isfinite(height), height - floor, np.nan)
    return Profile(x=x, height=seen, sigma=np.full(len(x), SIGMA), view=view)


def bed(centres: Array, radii: Array) -> npt.NDArray[np.bool_]:
    """Which spheres belong to the largest heap of neighbours; those in flight do not."""
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
