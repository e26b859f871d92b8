"""A clump of spheres in place of a closed body that an STL file describes.

The spheres touch the body from inside where its medial axis is, and are then enlarged alike until the clump has the
volume of the body.  Mass, centre of mass and moments of inertia are those of the body itself, exact for its facets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from rigtwin.lab.clumps import Clump, Vector, apart, principal_axes
from rigtwin.lab.errors import BadInput
from rigtwin.lab.stl import crossings, stl_facets

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    from scipy.spatial import cKDTree
    from trimesh import Trimesh

    from rigtwin.lab.arrays import Array

    Facets = npt.NDArray[np.intp]  # shape (n, 3), numbers of corners

MOST_SPHERES = 300  # of one clump; a heap of 1000 such particles has as many spheres as the engine takes in an hour
STL_SPHERES = 24  # where nothing is said: as many as the paper's clump of a cube with the calibrated parameters
THICKER = 1.0  # times the radius of its largest sphere inside, by which spheres may be enlarged to the volume of a body
THINNEST = 1e-3  # [1], volume over that of the box around the body; a coin of 20 mm by 0.1 mm has 4e-3

FACET = 1 / 40  # [lengths of the body], longest edge of the facets on which the distance is bounded
TARGETS = 3000  # facets that the choice of spheres looks at; the distance is then bounded on all
CANDIDATES = 700  # spheres of the medial axis that are tried
INSIDE = 600  # points inside the body that spheres must cover, so that no hole stays
VOLUME_POINTS = 80_000  # points of the grid on which the volume of the clump is found, good to about 0.5 %
RESOLVED = 0.01  # [lengths of the body], nearer than that a given number of spheres does not come: a ball has facets
SHRINKS = 20  # steps of a sphere towards the medial axis; most converge within five
ROUGHLY = 0.01  # relative, of a distance to the surface while candidates shrink; of a ball all of it is equally near
CONVERGED = 1e-3  # relative change of its radius at which it has
BISECTIONS = 12  # of the distance that a number of spheres reaches, to 1/4000 of its range
TIGHTER = 0.85  # factor on the distance that is asked of the inner spheres where the enlarged ones miss the bound


@dataclass(frozen=True)
class SphereFilling:
    """A clump in place of a body, and how near it comes to it."""

    clump: Clump  # with volume and moments of the body
    error: float  # [m], no point of the body's surface is farther from the clump, and no sphere sticks out more
    enlarged: float  # [m], by which the spheres stick out of the body
    volume: float  # [m^3], of the union of the spheres

    @property
    def touching(self) -> bool:
        """Whether the spheres are all connected; other particles may get into the body between those that are not."""
        import numpy as np

        return apart(np.array(self.clump.offsets), np.array(self.clump.radii)) is None


def read_stl(path: Path, unit: float) -> Trimesh:
    """Read the closed body of an STL file.

    Parameters
    ----------
    path : Path
        Path of the STL file.
    unit : float
        Length of 1 in the file [m].

    Returns
    -------
    Trimesh
        The body, in metres.

    Raises
    ------
    BadInput
        If the file cannot be read, has too many facets, or is not one closed body.
    """
    mesh = stl_facets(path, unit, "give a closed body as STL, binary or text")
    _check_body(mesh, str(path))
    return mesh


def _check_body(mesh: Trimesh, name: str) -> None:
    """Raise `BadInput` if a mesh is not one closed body that spheres can fill."""
    import numpy as np
    from trimesh.repair import broken_faces

    if not mesh.is_watertight:
        holes = len(broken_faces(mesh))  # type: ignore[no-untyped-call]
        raise BadInput(
            f"{name}: the surface is not closed ({holes} facets at open or double edges); close it (MeshLab: close "
            "holes; Blender: 3D print toolbox, make manifold)."
        )
    if mesh.body_count > 1:
        raise BadInput(f"{name}: has {mesh.body_count} separate bodies; export one grain alone.")
    box = float(np.prod(mesh.extents))
    volume = _mass(mesh)[0]
    if volume < 0:
        raise BadInput(f"{name}: its facets look inwards; flip the normals and export it again.")
    if volume < THINNEST * box:
        raise BadInput(f"{name}: encloses {volume / max(box, 1e-300):.1e} of the box around it; give a solid grain.")


def filled(mesh: Trimesh, *, spheres: int | None = None, error: float | None = None) -> SphereFilling:
    """The clump in place of a closed body [m].

    Parameters
    ----------
    mesh : Trimesh
        The body.
    spheres : int, optional
        Most spheres; as near to the body as they come.
    error : float, optional
        In place of `spheres`: distance [m] from the surface of the body to the clump that is kept, with as few spheres
        as the search finds.

    Returns
    -------
    SphereFilling
        The clump, in its principal axes, and its distance from the body.

    Raises
    ------
    BadInput
        If the body is not closed or too thin for so few spheres, or `error` needs more than `MOST_SPHERES`.

    Notes
    -----
    Candidates are spheres of the medial axis, found by shrinking a tangent sphere until no sample of the surface lies
    in it, and the largest spheres about points inside.  A greedy set cover chooses those that come within a distance t
    of most facets that are not yet covered.  The spheres are then enlarged by s so that the union has the body's
    volume; no point of the surface is farther than t - s from the union, and none of the union's is farther than s
    outside.  The distance to one sphere is convex, so its largest value over a facet is at a corner: the bound holds
    for all points of the surface, not only for samples.

    References
    ----------
    Ma, Bae, Choi, 3D medial point approximation using nearest neighbors and the normal field, The Visual Computer 28,
    7-19 (2012): shrinking spheres.  Bradshaw, O'Sullivan, Adaptive medial-axis approximation for sphere-tree
    construction, ACM Trans. Graph. 23, 1-26 (2004).
    """
    if (spheres is None) == (error is None):
        raise BadInput("clump: give either a number of spheres or an error.")
    if spheres is not None and not 1 <= spheres <= MOST_SPHERES:
        raise BadInput(f"clump: {spheres} spheres are not possible; give 1 to {MOST_SPHERES}.")
    _check_body(mesh, "clump")
    body = _Body(mesh)
    if error is None:
        assert spheres is not None
        return _thick_enough(body.enlarged(body.of_number(spheres)))
    if not error > 0:
        raise BadInput(f"clump: a distance of {error:g} m is not possible; give a length above 0.")
    inner = 2 * error / body.length
    while True:
        found = body.enlarged(body.within(inner))
        if found.error <= error:
            return _thick_enough(found)
        if len(found.clump.radii) >= MOST_SPHERES:
            reached = body.enlarged(body.of_number(MOST_SPHERES)).error
            raise BadInput(
                f"{MOST_SPHERES} spheres come within {1e3 * reached:.2g} mm of its surface, {1e3 * error:.2g} mm are "
                "asked; allow more."
            )
        inner *= TIGHTER


def _thick_enough(found: SphereFilling) -> SphereFilling:
    inner = max(found.clump.radii) - found.enlarged
    if found.enlarged > THICKER * inner:
        raise BadInput(
            f"the body is so thin that {len(found.clump.radii)} spheres of up to {2e3 * inner:.2g} mm would have to be "
            f"{2e3 * found.enlarged:.2g} mm larger to have its volume; allow more of them (stl_spheres up to "
            f"{MOST_SPHERES}), a smaller stl_error, or give a thicker body."
        )
    return found


def filled_file(path: Path, unit: float, *, spheres: int | None = None, error: float | None = None) -> SphereFilling:
    """Return the clump in place of the body of an STL file; computed once for a file's state.

    Parameters
    ----------
    path, unit : Path, float
        As for `read_stl`.
    spheres, error : int, float, optional
        As for `filled`.  Default: `STL_SPHERES` spheres.

    Returns
    -------
    SphereFilling
        As `filled` returns it.

    Raises
    ------
    BadInput
        As `read_stl` and `filled` raise it.
    """
    try:
        state = path.stat()
        changed = state.st_size, state.st_mtime_ns
    except (OSError, ValueError):
        changed = 0, 0  # `read_stl` says what is wrong
    if spheres is None and error is None:
        spheres = STL_SPHERES
    return _filled_file(path, changed, unit, spheres, error)


@lru_cache(maxsize=32)
def _filled_file(
    path: Path, _changed: tuple[int, int], unit: float, spheres: int | None, error: float | None
) -> SphereFilling:
    mesh = read_stl(path, unit)
    try:
        return filled(mesh, spheres=spheres, error=error)
    except BadInput as why:
        raise BadInput(f"{path}: {why}") from None


class _Body:
    """A body scaled to length 1, with candidates for spheres."""

    def __init__(self, mesh: Trimesh) -> None:
        import numpy as np
        from scipy.spatial import cKDTree
        from trimesh.remesh import subdivide_to_size

        self.length = float(np.max(mesh.extents))
        self.origin = np.array(mesh.bounds).mean(axis=0)
        self.corners = (np.array(mesh.triangles) - self.origin) / self.length
        vertices = (np.array(mesh.vertices) - self.origin) / self.length
        # facets on which the distance is bounded, and their corners
        self.places, self.facets = subdivide_to_size(vertices, mesh.faces, FACET)[:2]  # type: ignore[no-untyped-call]
        self.volume, self.centre, self.inertia = _mass_of(self.corners)
        middles = self.places[self.facets].mean(axis=1)
        normals = np.cross(*(self.places[self.facets[:, k]] - self.places[self.facets[:, 0]] for k in (1, 2)))
        area = np.linalg.norm(normals, axis=1)
        self.surface = cKDTree(np.vstack([self.places, middles]))
        rng = np.random.default_rng(1)  # which samples are looked at; the bound does not depend on it
        self.inside = _points_inside(self.corners, self.volume, rng)
        flat = area > 0
        picked = rng.permutation(np.flatnonzero(flat))[:CANDIDATES]
        tangent = _shrunk(middles[picked], -normals[picked] / area[picked, None], self.surface, roughly=ROUGHLY)
        self.centres = np.vstack([tangent, self.inside])
        self.radii: Array = np.asarray(self.surface.query(self.centres)[0])
        targets = rng.permutation(len(self.facets))[:TARGETS]
        self.gaps = np.hstack(
            [
                self._of_facets(self.centres, self.radii, self.facets[targets]),
                _distances(self.centres, self.radii, self.inside),
            ]
        )

    def _of_facets(self, centres: Array, radii: Array, facets: Facets) -> Array:
        """Largest distance of each facet's points from each sphere, shape (spheres, facets)."""
        import numpy as np

        used, where = np.unique(facets, return_inverse=True)
        distance = _distances(centres, radii, self.places[used])
        return _largest(distance, np.asarray(where).reshape(len(facets), 3))

    def chosen(self, within: float) -> list[int]:
        """Candidates of a greedy cover of all targets within a distance; at most `MOST_SPHERES`."""
        import numpy as np

        covers = self.gaps <= within
        free = covers.any(axis=0)
        gains = covers[:, free].sum(axis=1)
        found: list[int] = []
        while gains.max(initial=0) > 0 and len(found) < MOST_SPHERES:
            # of candidates alike good the larger one, as small spheres cost time steps
            best = int(np.lexsort((self.radii, gains))[-1])
            found.append(best)
            new = free & covers[best]
            gains = gains - covers[:, new].sum(axis=1)
            free &= ~new
        return found

    def within(self, distance: float) -> tuple[Array, Array]:
        """Spheres that touch the body from inside and come within a distance of all its surface."""
        import numpy as np

        index = self.chosen(distance)
        centres = self.centres[index]
        radii = np.array([_depth(self.corners, centre) for centre in centres])
        gap = self.gap(centres, radii)
        while gap.max() > distance and len(radii) < MOST_SPHERES:
            centres, radii, gap = self._with_one_more(centres, radii, gap)
        return centres, radii

    def of_number(self, spheres: int) -> tuple[Array, Array]:
        """At most so many spheres, as near to the body as the search finds."""
        import numpy as np

        low, high = RESOLVED, 1.0
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            few = len(self.chosen(middle)) <= spheres
            low, high = (low, middle) if few else (middle, high)
        index = self.chosen(high)
        centres = self.centres[index]
        radii = np.array([_depth(self.corners, centre) for centre in centres])
        gap = self.gap(centres, radii)
        while len(radii) < spheres and gap.max() > max(high, RESOLVED):
            centres, radii, gap = self._with_one_more(centres, radii, gap)
        return centres, radii

    def gap(self, centres: Array, radii: Array) -> Array:
        """Bound on the distance of each facet from the union of spheres."""
        import numpy as np

        nearest = np.full(len(self.facets), np.inf)
        for centre, radius in zip(centres, radii, strict=True):
            np.minimum(nearest, _largest(_from(self.places, centre), self.facets) - radius, out=nearest)
        return nearest

    def _with_one_more(self, centres: Array, radii: Array, gap: Array) -> tuple[Array, Array, Array]:
        """The spheres and the one that touches the facet that is farthest from them."""
        import numpy as np

        worst = int(np.argmax(gap))
        a, b, c = self.places[self.facets[worst]]
        inward = np.cross(c - a, b - a)
        middle = (a + b + c) / 3
        centre = _shrunk(middle[None], inward[None] / max(float(np.linalg.norm(inward)), 1e-300), self.surface)
        centres = np.vstack([centres, centre])
        radii = np.append(radii, _depth(self.corners, centre[0]))
        return centres, radii, np.minimum(gap, self.gap(centres[-1:], radii[-1:]))

    def enlarged(self, spheres: tuple[Array, Array]) -> SphereFilling:
        """The clump of these spheres, enlarged to the volume of the body."""
        import numpy as np

        centres, radii = spheres
        axes = [np.array([low - 0.2, high + 0.2]) for low, high in zip(*_box(self.corners), strict=True)]
        pitch = (math.prod(float(np.ptp(axis)) for axis in axes) / VOLUME_POINTS) ** (1 / 3)
        lines = [np.arange(low + pitch / 2, high, pitch) for low, high in axes]
        grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
        nearest = np.full(len(grid), np.inf)
        for centre, radius in zip(centres, radii, strict=True):
            np.minimum(nearest, _from(grid, centre) - radius, out=nearest)
        nearest.sort()
        # the points within this distance of the spheres fill the volume of the body
        reach = min(max(1, round(self.volume / pitch**3)), len(nearest) - 1)
        more = max(0.0, float(nearest[reach - 1] + nearest[reach]) / 2)
        gap = float(self.gap(centres, radii).max())
        axes_of = principal_axes(self.inertia / self.volume)
        places = (centres - self.centre) @ axes_of * self.length
        sizes = (radii + more) * self.length
        gyration = np.diag(axes_of.T @ self.inertia @ axes_of) / self.volume * self.length**2
        clump = Clump(
            tuple(_vector(place) for place in places),
            tuple(map(float, sizes)),
            self.volume * self.length**3,
            _vector(gyration),
        )
        union = float((nearest <= more).sum() * pitch**3 * self.length**3)
        return SphereFilling(clump, max(more, gap - more) * self.length, more * self.length, union)


def _vector(numbers: Array) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return x, y, z


def _box(corners: Array) -> tuple[Array, Array]:
    return corners.min(axis=(0, 1)), corners.max(axis=(0, 1))


def _mass(mesh: Trimesh) -> tuple[float, Array, Array]:
    """Volume, centre and inertia tensor about it, at unit density."""
    return _mass_of(mesh.triangles)


def _mass_of(corners: Array) -> tuple[float, Array, Array]:
    import numpy as np
    from trimesh.triangles import mass_properties

    low, high = _box(np.asarray(corners))
    middle, length = (low + high) / 2, float((high - low).max())
    # about the middle and at length 1, as the sums lose digits far from the origin
    found = mass_properties((corners - middle) / length)
    return (
        float(found.volume) * length**3,
        np.asarray(found.center_mass) * length + middle,
        np.asarray(found.inertia) * length**5,
    )


def _largest(distance: Array, facets: Facets) -> Array:
    """The largest of each facet's corners, along the last axis."""
    import numpy as np

    a, b, c = (np.take(distance, facets[:, k], axis=-1) for k in range(3))
    return np.asarray(np.maximum(np.maximum(a, b), c))


def _from(points: Array, centre: Array) -> Array:
    import numpy as np

    apart = points - centre
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", apart, apart)))


def _distances(centres: Array, radii: Array, points: Array) -> Array:
    """Distance of points from the surfaces of spheres, negative inside, shape (spheres, points)."""
    import numpy as np
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(centres, points) - radii[:, None], dtype=np.float32)


def _shrunk(points: Array, inward: Array, surface: cKDTree, *, roughly: float = 0.0) -> Array:
    """Centres of the largest spheres inside that touch the surface at `points`, shape (n, 3).

    The nearest sample of the surface is found to within `roughly` of its distance.
    """
    import numpy as np

    radii = np.full(len(points), 1.0)  # larger than any that fits into a body of length 1
    for _ in range(SHRINKS):
        centres = points + radii[:, None] * inward
        distance, nearest = surface.query(centres, eps=roughly)
        index = np.asarray(nearest)
        inside = distance < radii * (1 - CONVERGED)
        if not inside.any():
            break
        apart = points[inside] - surface.data[index[inside]]
        # the sphere through both points that is tangent at the first
        along = (apart * -inward[inside]).sum(axis=1)
        radii[inside] = (apart**2).sum(axis=1) / 2 / np.maximum(along, 1e-12)
    return np.asarray(points + radii[:, None] * inward)


def _points_inside(corners: Array, volume: float, rng: np.random.Generator) -> Array:
    """About `INSIDE` points of a grid that lie inside, in random order, shape (n, 3)."""
    import numpy as np

    low, high = _box(corners)
    pitch = (volume / INSIDE) ** (1 / 3)
    axes = [np.arange(lower + pitch / 2, upper, pitch) for lower, upper in zip(low, high, strict=True)]
    # a ray upwards through each column leaves the body where it entered it
    columns = np.stack(np.meshgrid(axes[0], axes[1], indexing="ij"), axis=-1).reshape(-1, 2) + 1e-7 * pitch
    found = [np.zeros((0, 3))]
    for x, y in columns:
        heights = crossings(corners, x, y)
        within = np.searchsorted(heights, axes[2]) % 2 == 1
        found.append(np.column_stack([np.full(within.sum(), x), np.full(within.sum(), y), axes[2][within]]))
    return np.asarray(rng.permutation(np.concatenate(found)))


def _depth(corners: Array, point: Array) -> float:
    """Distance of a point to the triangles."""
    import numpy as np
    from trimesh.triangles import closest_point

    nearest = np.asarray(closest_point(corners, np.tile(point, (len(corners), 1))))  # type: ignore[no-untyped-call]
    return float(np.linalg.norm(nearest - point, axis=1).min())
