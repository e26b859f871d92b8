"""Facets of an STL file, binary or text: of a grain that spheres fill, or of a wall."""

from __future__ import annotations

import io
import logging
import re
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rigtwin.lab.errors import BadInput
from rigtwin.lab.input_files import decoding, read_bytes
from rigtwin.lab.media_files import STL_FACET, STL_HEAD, kind_of

if TYPE_CHECKING:
    from trimesh import Trimesh

    from rigtwin.lab.arrays import Array, Mask

StlUnit = Literal["mm", "cm", "m", "um", "inch"]
STL_UNITS: dict[StlUnit, float] = {
    "mm": 1e-3,
    "cm": 1e-2,
    "m": 1.0,
    "um": 1e-6,
    "inch": 0.0254,
}  # [m], of the numbers in an STL file
LARGEST_STL = 32 * 2**20  # [bytes], a text file of 125 000 facets
MOST_FACETS = 100_000  # scans are simplified before; a clump of spheres takes about 10 s with so many
CUT = 200  # [bytes], in which the end of a facet and the first words of another stand


def stl_facets(path: Path, unit: float, advice: str) -> Trimesh:
    """The facets of an STL file whose lengths are in `unit` [m], corners at one place merged.

    Parameters
    ----------
    path : Path
        The file.
    unit : float
        Length of 1 in the file [m].
    advice : str
        What to give instead where it is none, the end of the sentence.

    Returns
    -------
    Trimesh
        In metres, with at least one facet.

    Raises
    ------
    BadInput
        The file cannot be read, ends before its last facet, or has too many facets or corners that are no numbers.
    """
    import numpy as np
    import trimesh

    content = _whole(path, read_bytes(path, advice=advice, largest=LARGEST_STL), advice)
    logging.getLogger("trimesh").setLevel(logging.CRITICAL + 1)  # a damaged file is refused in our words
    with decoding(path, "STL", advice, refuse=BadInput), np.errstate(all="ignore"):
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type="stl", process=False)
    if not (isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)):
        raise BadInput(f"{path}: holds no facets; {advice}.")
    if len(mesh.faces) > MOST_FACETS:
        raise BadInput(
            f"{path}: has {len(mesh.faces)} facets, and at most {MOST_FACETS} are read; simplify the mesh (MeshLab: "
            "quadric edge collapse decimation)."
        )
    wrong = ~np.isfinite(mesh.triangles).all(axis=(1, 2))
    if wrong.any():
        raise BadInput(
            f"{path}: facet {int(wrong.argmax()) + 1} has a corner that is not a finite number; export the file again."
        )
    with np.errstate(all="ignore"):  # of facets far apart
        mesh.process(validate=False)
    if not float(np.max(mesh.extents)) > 0:
        raise BadInput(f"{path}: all its corners are at one place; export it again.")
    mesh.vertices *= unit
    return mesh


def encloses(corners: Array, points: Array) -> Mask:
    """Which points lie inside of a closed part of a surface.

    Parameters
    ----------
    corners : ndarray, shape (n, 3, 3)
        Triangles [m].
    points : ndarray, shape (k, 3)
        Points [m], none of them on the surface or right below one of its edges.

    Returns
    -------
    ndarray of bool, shape (k,)
        Whether a line upwards from there leaves a closed part. Parts that are not closed have no inside, and holes of
        four corners, such as the open top of a box, are holes.
    """
    import numpy as np
    from trimesh import Trimesh

    whole = Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    parts = [np.asarray(part.triangles) for part in whole.split(only_watertight=True, repair=False)]
    inside = np.zeros(len(points), dtype=bool)
    for part in parts:
        low, high = part[:, :, :2].min(axis=1), part[:, :, :2].max(axis=1)
        for number, (x, y, z) in enumerate(points.tolist()):
            near = part[((low <= (x, y)) & (high >= (x, y))).all(axis=1)]
            inside[number] |= (crossings(near, x, y) > z).sum() % 2 == 1
    return inside


def crossings(corners: Array, x: float, y: float) -> Array:
    """Return the heights at which the line upwards through (x, y) meets triangles.

    Parameters
    ----------
    corners : ndarray, shape (n, 3, 3)
        Corners of the triangles [m].
    x, y : float
        Place of the line [m].

    Returns
    -------
    ndarray, shape (k,)
        Heights [m], rising.
    """
    import numpy as np

    a, b, c = (corners[:, k, :2] - (x, y) for k in range(3))

    def cross(one: Array, other: Array) -> Array:
        return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])

    weights = np.stack([cross(b, c), cross(c, a), cross(a, b)], axis=1)
    hit = (weights > 0).all(axis=1) | (weights < 0).all(axis=1)
    share = weights[hit] / weights[hit].sum(axis=1, keepdims=True)
    return np.sort((share * corners[hit, :, 2]).sum(axis=1))


def _whole(path: Path, content: bytes, advice: str) -> bytes:
    """The content without what stands behind its last facet.  Raises `BadInput` where the file is cut off."""
    text = content.lstrip()[:5].lower() == b"solid"
    # the name may hold the word facet, too
    begun = len(re.findall(rb"\bfacet\s+normal\b", content, re.IGNORECASE)) if text else 0
    if begun:
        facets = len(re.findall(rb"\bendfacet\b", content, re.IGNORECASE))
        # the next facet, cut off within its first words
        starts = re.search(rb"\bendfacet\s+f\w*(\s+\w*)?\Z", content[-CUT:], re.IGNORECASE)
        if begun > facets or starts:
            raise BadInput(f"{path}: ends within facet {facets + 1}: it is cut off; copy or export it again.")
        return content
    if text and len(content) < STL_HEAD:
        return content  # an empty solid
    if len(content) < STL_HEAD:
        raise BadInput(f"{path}: has {len(content)} bytes, fewer than the head of an STL file; {advice}.")
    stated = int.from_bytes(content[STL_HEAD - 4 : STL_HEAD], "little")
    there = (len(content) - STL_HEAD) // STL_FACET
    if stated > there and (kind := kind_of(content)):
        raise BadInput(f"{path}: is {kind}, no STL file; {advice}.")
    if stated > there and b"\0" in content:  # else it is text of another kind
        raise BadInput(f"{path}: ends after {there} of its {stated} facets: it is cut off; copy or export it again.")
    return content[: STL_HEAD + stated * STL_FACET] if stated <= there else content
