"""Elements of walls: planes, surfaces of revolution and triangles, and the nearest point of each.

Every wall is a list of elements, stored as rows of numbers.  Disc, annulus, tube and cone are surfaces of revolution of
a straight line; plates, boxes and meshes consist of triangles.
"""

import math

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.sim.engine.backend import ti

Vector = tuple[float, float, float]

PLANE, ROUND, TRIANGLE = range(3)
# columns of a table of elements; a plane has a point and a normal, a triangle three corners, and a surface of
# revolution a point of its axis, the axis, the radii at that point and a height further on, and the height
KIND, OF_WALL, POINT, AXIS, LOW_RADIUS, HIGH_RADIUS, HEIGHT = 0, 1, 2, 5, 8, 9, 10
CORNERS = (2, 5, 8)
ELEMENT_SIZE = 11


def plane(point: Vector, normal: Vector) -> Array:
    """Row of a plane, shape (1, 11)."""
    return np.array([[PLANE, 0, *point, *normal, 0, 0, 0]], dtype=np.float64)


def revolved(point: Vector, axis: Vector, radii: tuple[float, float], height: float) -> Array:
    """Row of a surface of revolution, shape (1, 11)."""
    return np.array([[ROUND, 0, *point, *axis, *radii, height]], dtype=np.float64)


def triangles(corners: Array) -> Array:
    """Rows of triangles, shape (n, 11), from `corners` [m], shape (n, 3, 3)."""
    rows = np.zeros((len(corners), ELEMENT_SIZE))
    rows[:, KIND] = TRIANGLE
    rows[:, POINT:] = corners.reshape(-1, 9)
    return rows


def distances(row: Array, points: Array) -> Array:
    """Distance [m] of points, shape (n, 3), from one plane (negative behind it) or surface of revolution."""
    point, axis = row[POINT:AXIS], row[AXIS:LOW_RADIUS]
    along = (points - point) @ axis
    if row[KIND] == PLANE:
        return np.asarray(along)
    outward = np.linalg.norm(points - point - along[:, None] * axis, axis=1)
    low, high, height = row[LOW_RADIUS:]
    part = np.clip(((outward - low) * (high - low) + along * height) / ((high - low) ** 2 + height**2), 0, 1)
    return np.asarray(np.hypot(outward - low - part * (high - low), along - part * height))


@ti.func
def towards_element(table, e, position):
    """Distance [m] from a point to element `e` of the table, and the unit vector towards its nearest point."""
    distance = 0.0
    direction = ti.Vector([0.0, 0.0, 0.0])
    relative = position - ti.Vector([table[e, POINT], table[e, POINT + 1], table[e, POINT + 2]])
    axis = ti.Vector([table[e, AXIS], table[e, AXIS + 1], table[e, AXIS + 2]])
    if table[e, KIND] > 1.5:
        to_wall = towards_triangle(table, e, position)
        distance = to_wall.norm()
        direction = to_wall / ti.max(distance, 1e-30)
    else:
        along = relative.dot(axis)
        distance = along
        direction = -axis
        if table[e, KIND] > 0.5:
            outward = relative - along * axis
            reach = outward.norm()
            low, height = table[e, LOW_RADIUS], table[e, HEIGHT]
            wider = table[e, HIGH_RADIUS] - low
            part = ((reach - low) * wider + along * height) / (wider * wider + height * height)
            part = ti.min(ti.max(part, 0.0), 1.0)
            out = low + part * wider - reach
            up = part * height - along
            # a point on the axis has the same distance to the whole ring, so the radial parts cancel
            distance = ti.sqrt(out * out + up * up)
            direction = (out / ti.max(reach, 1e-30) * outward + up * axis) / ti.max(distance, 1e-30)
    return distance, direction


@ti.func
def towards_triangle(table, e, position):
    """Vector from a point to the nearest point of triangle `e`."""
    a = ti.Vector([table[e, CORNERS[0]], table[e, CORNERS[0] + 1], table[e, CORNERS[0] + 2]])
    b = ti.Vector([table[e, CORNERS[1]], table[e, CORNERS[1] + 1], table[e, CORNERS[1] + 2]])
    c = ti.Vector([table[e, CORNERS[2]], table[e, CORNERS[2] + 1], table[e, CORNERS[2] + 2]])
    normal = (b - a).cross(c - a)
    square = normal.norm_sqr()
    # signed double areas of the triangles of the point with two sides, times the length of the normal
    at_b = (position - a).cross(c - a).dot(normal)
    at_c = (b - a).cross(position - a).dot(normal)
    nearest = (a - position).dot(normal) / square * normal
    if ti.min(at_b, at_c, square - at_b - at_c) < 0.0:
        least = 1e30
        for side in range(3):
            start, end = a, b
            if side == 1:
                start, end = b, c
            if side == 2:
                start, end = c, a
            edge = end - start
            part = (position - start).dot(edge) / edge.norm_sqr()
            candidate = start + ti.min(ti.max(part, 0.0), 1.0) * edge - position
            if candidate.norm_sqr() < least:
                least = candidate.norm_sqr()
                nearest = candidate
    return nearest


def unit(vector: Vector) -> Vector:
    """The vector scaled to unit length."""
    length = math.sqrt(sum(c * c for c in vector))
    x, y, z = (c / length for c in vector)
    return x, y, z
