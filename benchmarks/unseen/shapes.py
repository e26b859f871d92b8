"""Triangle meshes of spheres, merged into one mesh with a colour for each vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """One closed body: vertices and normals, shape (n, 3), and faces, shape (m, 3)."""

    vertices: Floats
    normals: Floats
    faces: npt.NDArray[np.int64]


def sphere(detail: int) -> Body:
    """Unit-diameter sphere with 20 * 4**detail faces and the normals of the true sphere."""
    made = trimesh.creation.icosphere(subdivisions=detail, radius=0.5)
    return Body(np.asarray(made.vertices), np.asarray(made.vertex_normals), np.asarray(made.faces))


def copies(body: Body, centres: Floats, size: float, colours: Floats) -> tuple[Body, Floats]:
    """Copies of `body` at the centres, shape (k, 3), merged; and the colour of each vertex."""
    count = len(body.vertices)
    vertices = (body.vertices * size + centres[:, None]).reshape(-1, 3)
    faces = (body.faces[None] + (count * np.arange(len(centres)))[:, None, None]).reshape(-1, 3)
    return Body(vertices, np.tile(body.normals, (len(centres), 1)), faces), np.repeat(colours, count, axis=0)
