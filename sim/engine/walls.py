"""Walls: plane, disc and cylinder (whose short form is the rim of a bowl), each reduced to its nearest point."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material
from rigtwin.sim.engine.backend import ti

Vector = tuple[float, float, float]

PLANE, DISC, CYLINDER = range(3)
# columns of a table of walls: shape, point (3), axis (3), radius, height
SHAPE, POINT, AXIS, RADIUS, HEIGHT = 0, 1, 4, 7, 8
WALL_SIZE = 9


@dataclass(frozen=True)
class Plane:
    """An infinite plane; beads live on the side that `normal` points to, however deep they are pushed."""

    point: Vector  # [m]
    normal: Vector

    @property
    def row(self) -> tuple[float, ...]:
        return (PLANE, *self.point, *_unit(self.normal), 0.0, 0.0)


@dataclass(frozen=True)
class Disc:
    """A thin round plate with an edge; beads may touch either face or the edge."""

    centre: Vector  # [m]
    normal: Vector
    radius: float  # [m]

    @property
    def row(self) -> tuple[float, ...]:
        return (DISC, *self.centre, *_unit(self.normal), _positive("disc radius", self.radius), 0.0)


@dataclass(frozen=True)
class Cylinder:
    """A thin tube wall from `centre` along `axis`, touched on any side; a short one is a rim."""

    centre: Vector  # [m], of the lower opening
    axis: Vector
    radius: float  # [m]
    height: float  # [m]

    @property
    def row(self) -> tuple[float, ...]:
        radius, height = _positive("cylinder radius", self.radius), _positive("cylinder height", self.height)
        return (CYLINDER, *self.centre, *_unit(self.axis), radius, height)


Shape = Plane | Disc | Cylinder


@dataclass(frozen=True)
class Wall:
    """A shape, what it is made of, and how beads touch it."""

    shape: Shape
    material: Material
    contact: Contact


def _unit(vector: Vector) -> Vector:
    length = math.sqrt(sum(c * c for c in vector))
    if not (math.isfinite(length) and length > 0):
        raise BadInput(f"wall: the direction {vector} has no length; give a vector that is not zero.")
    x, y, z = (c / length for c in vector)
    return x, y, z


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise BadInput(f"wall: {name} must be a positive length, got {value:g}.")
    return value


def gaps(shape: Shape, centres: npt.NDArray[np.float64], radii: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Gap [m] between the wall and spheres, shape (n,); negative where they overlap."""
    row = shape.row
    point, axis = np.array(row[POINT:AXIS]), np.array(row[AXIS:RADIUS])
    relative = centres - point
    along = relative @ axis
    if isinstance(shape, Plane):
        return np.asarray(along - radii)
    outward = np.linalg.norm(relative - along[:, None] * axis, axis=1)
    if isinstance(shape, Disc):
        return np.asarray(np.hypot(along, np.maximum(outward - shape.radius, 0.0)) - radii)
    beyond = along - np.clip(along, 0.0, shape.height)
    return np.asarray(np.hypot(beyond, outward - shape.radius) - radii)


@ti.func
def towards_wall(table, w, position):
    """Distance [m] from a point to wall `w` of the table, and the unit vector towards the wall's nearest point."""
    point = ti.Vector([table[w, POINT], table[w, POINT + 1], table[w, POINT + 2]])
    axis = ti.Vector([table[w, AXIS], table[w, AXIS + 1], table[w, AXIS + 2]])
    relative = position - point
    along = relative.dot(axis)
    distance = along
    direction = -axis
    if table[w, SHAPE] > 0.5:
        outward = relative - along * axis
        reach = ti.max(outward.norm(), 1e-12)
        outward /= reach
        radius = table[w, RADIUS]
        to_wall = -along * axis
        if table[w, SHAPE] > 1.5:
            to_wall = (radius - reach) * outward
            to_wall -= (along - ti.min(ti.max(along, 0.0), table[w, HEIGHT])) * axis
        elif reach > radius:
            to_wall += (radius - reach) * outward
        distance = to_wall.norm()
        direction = to_wall / ti.max(distance, 1e-30)
    return distance, direction
