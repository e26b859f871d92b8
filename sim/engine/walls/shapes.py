"""Walls: shapes, materials and motions.

::

    tube = Wall(Cylinder((0, 0, 0), (0, 0, 1), 0.03, 0.1), steel, contact, Motion((0, 0, 0.05), start=1.0))
    drum = Wall(Cylinder((0, 0, 0), (0, 1, 0), 0.07, 0.05), pmma, contact, Motion.turning(3, axis=(0, 1, 0)))
    lid = Wall(Disc((0, 0, 0), (0, 0, 1), 0.025), steel, contact, until=0.5)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material
from rigtwin.sim.engine.walls import elements
from rigtwin.sim.engine.walls.elements import Vector, unit
from rigtwin.sim.engine.walls.mesh import Mesh, least_distances


@dataclass(frozen=True)
class Plane:
    """An infinite plane; beads are on the side to which `normal` points, whatever their overlap."""

    point: Vector  # [m]
    normal: Vector

    @property
    def rows(self) -> Array:
        return elements.plane(self.point, _unit(self.normal))


@dataclass(frozen=True)
class Disc:
    """A thin round plate; beads may touch either face or the edge."""

    centre: Vector  # [m]
    normal: Vector
    radius: float  # [m]

    @property
    def rows(self) -> Array:
        return elements.revolved(self.centre, _unit(self.normal), (0.0, _positive("disc radius", self.radius)), 0.0)


@dataclass(frozen=True)
class Annulus:
    """A thin round plate with a round hole in its middle."""

    centre: Vector  # [m]
    normal: Vector
    inner_radius: float  # [m]
    outer_radius: float  # [m]

    @property
    def rows(self) -> Array:
        inner = _positive("inner radius of the annulus", self.inner_radius)
        outer = _positive("outer radius of the annulus", self.outer_radius)
        if inner >= outer:
            raise BadInput(
                f"wall: the annulus' inner radius of {inner:g} m must be below its outer one of {outer:g} m."
            )
        return elements.revolved(self.centre, _unit(self.normal), (inner, outer), 0.0)


@dataclass(frozen=True)
class Cylinder:
    """A thin tube from `centre` along `axis`, with contact on both sides; a short one is a rim."""

    centre: Vector  # [m], of the lower opening
    axis: Vector
    radius: float  # [m]
    height: float  # [m]

    @property
    def rows(self) -> Array:
        radius, height = _positive("cylinder radius", self.radius), _positive("cylinder height", self.height)
        return elements.revolved(self.centre, _unit(self.axis), (radius, radius), height)


@dataclass(frozen=True)
class Cone:
    """A thin conical wall, open at both ends (a funnel); a radius of zero at one end gives a tip."""

    centre: Vector  # [m], of the end with `radius`
    axis: Vector
    radius: float  # [m]
    far_radius: float  # [m], at `height` along the axis
    height: float  # [m]

    @property
    def rows(self) -> Array:
        height = _positive("cone height", self.height)
        for name, radius in (("radius", self.radius), ("far_radius", self.far_radius)):
            if not (math.isfinite(radius) and radius >= 0):
                raise BadInput(f"wall: the cone's {name} must be zero or positive, got {radius:g}.")
        if self.radius == self.far_radius == 0:
            raise BadInput("wall: a cone needs a radius at one of its ends.")
        return elements.revolved(self.centre, _unit(self.axis), (self.radius, self.far_radius), height)


@dataclass(frozen=True)
class Plate:
    """A thin flat plate: a parallelogram, or a rectangle if its sides are perpendicular."""

    corner: Vector  # [m]
    side: Vector  # [m], from the corner to the next one
    other_side: Vector  # [m]

    @property
    def corners(self) -> Array:
        """Two triangles [m], shape (2, 3, 3)."""
        at, one, other = (np.array(v, dtype=float) for v in (self.corner, self.side, self.other_side))
        span = np.linalg.norm(np.cross(one, other))
        if not span > 1e-9 * np.linalg.norm(one) * np.linalg.norm(other):
            raise BadInput(f"wall: the plate's sides {self.side} and {self.other_side} span no area.")
        return _plate(at, one, other)

    @property
    def rows(self) -> Array:
        return elements.triangles(self.corners)


@dataclass(frozen=True)
class SlotPlate:
    """A horizontal rectangular plate with a rectangular opening in its middle."""

    centre: Vector  # [m]
    size: tuple[float, float]  # [m], along x and y
    opening: tuple[float, float]  # [m], along x and y; if as long as the plate, a slot from edge to edge

    @property
    def corners(self) -> Array:
        """Triangles [m], shape (n, 3, 3)."""
        (a, b), (p, q) = self.size, self.opening
        if not (0 < p <= a and 0 < q <= b and (p < a or q < b) and all(map(math.isfinite, (a, b)))):
            raise BadInput(f"wall: a plate of {a:g} m x {b:g} m cannot have an opening of {p:g} m x {q:g} m.")
        x, y = (-a / 2, -p / 2, p / 2, a / 2), (-b / 2, -q / 2, q / 2, b / 2)
        parts = []
        for i in range(3):
            for j in range(3):
                wide, deep = x[i + 1] - x[i], y[j + 1] - y[j]
                if (i, j) != (1, 1) and wide > 0 and deep > 0:
                    corner = (self.centre[0] + x[i], self.centre[1] + y[j], self.centre[2])
                    parts.append(Plate(corner, (wide, 0.0, 0.0), (0.0, deep, 0.0)).corners)
        return np.concatenate(parts)

    @property
    def rows(self) -> Array:
        return elements.triangles(self.corners)


@dataclass(frozen=True)
class Box:
    """Six thin plates, with contact inside and outside; `open_top` omits the upper one."""

    low: Vector  # [m]
    high: Vector  # [m]
    open_top: bool = False

    @property
    def corners(self) -> Array:
        """Triangles [m], shape (n, 3, 3)."""
        low, high = np.array(self.low, dtype=float), np.array(self.high, dtype=float)
        if not (np.isfinite([low, high]).all() and (low < high).all()):
            raise BadInput(f"wall: the box's low {self.low} must lie below its high {self.high} on every axis.")
        x, y, z = np.diag(high - low)
        plates = [(low, x, y), (low, x, z), (low, y, z), (low + x, y, z), (low + y, x, z)]
        if not self.open_top:
            plates.append((low + z, x, y))
        return np.concatenate([_plate(at, one, other) for at, one, other in plates])

    @property
    def rows(self) -> Array:
        return elements.triangles(self.corners)


Shape = Plane | Disc | Annulus | Cylinder | Cone | Plate | SlotPlate | Box | Mesh


@dataclass(frozen=True)
class Motion:
    """Motion of a wall in closed form: translation, vibration and rotation between `start` and `stop`, else at rest.

    The vibration adds ``amplitude * sin(2 pi frequency t)``, t from the start.  The axis moves with translation and
    vibration.  `in_place`: the surface moves but the shape stays, as of a conveyor belt.
    """

    velocity: Vector = (0.0, 0.0, 0.0)  # [m/s]
    spin: float = 0.0  # [rad/s], about the axis, right-handed
    axis: Vector = (0.0, 0.0, 1.0)
    point: Vector = (0.0, 0.0, 0.0)  # [m], on the axis at the start
    start: float = 0.0  # [s]
    stop: float = math.inf  # [s]
    in_place: bool = False
    amplitude: Vector = (0.0, 0.0, 0.0)  # [m], of the vibration
    frequency: float = 0.0  # [1/s]

    def __post_init__(self) -> None:
        numbers = (*self.velocity, self.spin, *self.point, self.start, *self.amplitude, self.frequency)
        if not np.isfinite(numbers).all():
            raise BadInput(
                "wall: velocity, spin, point, start, amplitude and frequency of a motion must be finite numbers."
            )
        if not self.stop > self.start:
            raise BadInput(f"wall: a motion that starts at {self.start:g} s cannot stop at {self.stop:g} s.")
        _unit(self.axis)

    @classmethod
    def turning(
        cls, rpm: float, *, axis: Vector, point: Vector = (0.0, 0.0, 0.0), start: float = 0.0, stop: float = math.inf
    ) -> Motion:
        """Turning about an axis through `point` [m] at `rpm` [1/min]."""
        return cls(spin=rpm * math.pi / 30, axis=axis, point=point, start=start, stop=stop)

    def lasted(self, time: float) -> float:
        """Duration [s] of the motion until `time` [s]."""
        return min(max(time - self.start, 0.0), self.stop - self.start)

    def moved_by(self, time: float) -> bool:
        """Whether the wall has left its initial position at `time` [s]."""
        moves = self.spin != 0 or any(self.velocity) or self.vibrates
        return not self.in_place and self.lasted(time) > 0 and moves

    @property
    def vibrates(self) -> bool:
        """Whether the wall vibrates."""
        return self.frequency != 0 and any(self.amplitude)

    def displaced(self, time: float) -> Array:
        """Displacement [m] of the axis at `time` [s], shape (3,)."""
        lasted = self.lasted(time)
        sway = math.sin(2 * math.pi * self.frequency * lasted)
        return np.asarray(lasted * np.array(self.velocity) + sway * np.array(self.amplitude))

    def undone(self, points: Array, time: float) -> Array:
        """Points [m], shape (n, 3), moved back with the wall from `time` [s] to its initial position."""
        if self.in_place:
            return points
        pivot = np.array(self.point)
        relative: Array = points - pivot - self.displaced(time)
        return np.asarray(relative @ self.turned(time) + pivot)

    def done(self, points: Array, time: float) -> Array:
        """Positions [m] at `time` [s] of points of the wall, shape (n, 3)."""
        if self.in_place:
            return points
        pivot = np.array(self.point)
        moved: Array = (points - pivot) @ self.turned(time).T + pivot
        return np.asarray(moved + self.displaced(time))

    def turned(self, time: float) -> Array:
        """Rotation matrix at `time` [s], shape (3, 3)."""
        x, y, z = _unit(self.axis)
        angle = self.spin * self.lasted(time)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)


@dataclass(frozen=True)
class Wall:
    """A wall: shape, material, contact and motion; it is removed at `until` [s]."""

    shape: Shape
    material: Material
    contact: Contact
    motion: Motion | None = None
    until: float = math.inf  # [s]


def gaps(shape: Shape, centres: Array, radii: Array) -> Array:
    """Gap [m] between the wall and spheres, shape (n,); negative where they overlap.

    For walls of triangles, gaps above the largest radius are returned as infinite.
    """
    rows = shape.rows
    flat = rows[:, elements.KIND] == elements.TRIANGLE
    least = np.full(len(centres), np.inf)
    for row in rows[~flat]:
        least = np.minimum(least, elements.distances(row, centres))
    if flat.any() and len(centres):
        corners = rows[flat, elements.POINT :].reshape(-1, 3, 3)
        least = np.minimum(least, least_distances(corners, centres, 2 * radii.max()))
    return np.asarray(least - radii)


def wandering(shape: Shape, motion: Motion, domain: tuple[Array, Array]) -> float:
    """Upper bound [m/s] of the speed at which points of the wall leave its present surface.

    Zero if the motion does not change the surface: a drum rotating about its axis, a plane sliding along itself.
    """
    if motion.in_place:
        return 0.0
    axis, point = np.array(_unit(motion.axis)), np.array(motion.point)
    velocity, sway = np.array(motion.velocity), 2 * math.pi * motion.frequency * np.array(motion.amplitude)
    row = shape.rows[0]
    along = row[elements.AXIS : elements.LOW_RADIUS]
    aligned = bool(np.linalg.norm(np.cross(axis, along)) < 1e-12)
    if isinstance(shape, Plane):
        corners = np.array([[domain[k >> c & 1][c] for c in range(3)] for k in range(8)])
        if aligned or motion.spin == 0:
            return abs(float(velocity @ along)) + abs(float(sway @ along))
    elif row[elements.KIND] == elements.ROUND:
        middle = row[elements.POINT : elements.AXIS]
        if aligned and not velocity.any() and not sway.any() and np.linalg.norm(np.cross(middle - point, axis)) < 1e-12:
            return 0.0
        one = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        one /= np.linalg.norm(one)
        rim = row[elements.LOW_RADIUS : elements.HEIGHT].max() * math.sqrt(2)
        square = [rim * (a * one + b * np.cross(along, one)) for a, b in ((1, 0), (0, 1), (-1, 0), (0, -1))]
        corners = np.array([middle + up * along + out for up in (0.0, row[elements.HEIGHT]) for out in square])
    else:
        corners = shape.rows[:, elements.POINT :].reshape(-1, 3)
    arm = np.linalg.norm(np.cross(corners - point, axis), axis=1).max()
    return float(np.linalg.norm(velocity) + np.linalg.norm(sway) + abs(motion.spin) * arm)


def _plate(corner: Array, side: Array, other_side: Array) -> Array:
    far = corner + side + other_side
    return np.array([[corner, corner + side, far], [corner, far, corner + other_side]])


def _unit(vector: Vector) -> Vector:
    length = math.sqrt(sum(c * c for c in vector))
    if not (math.isfinite(length) and length > 0):
        raise BadInput(f"wall: the direction {vector} has no length; give a vector that is not zero.")
    return unit(vector)


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise BadInput(f"wall: {name} must be a positive length, got {value:g}.")
    return value
