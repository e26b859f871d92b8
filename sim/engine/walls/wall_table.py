"""Tables of the walls of a simulation, as `WallContacts` takes them: elements, cells of meshes, motions, laws."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.sim.engine.contact import IMPACT_SPEED, LAW_SIZE, pair_law
from rigtwin.sim.engine.walls import elements as shape
from rigtwin.sim.engine.walls.elements import ELEMENT_SIZE, OF_WALL, TRIANGLE
from rigtwin.sim.engine.walls.mesh import ALONE, sort_into_cells
from rigtwin.sim.engine.walls.shapes import Motion, Shape, Wall, wandering

KINDS, WALLS = 16, 64
ROOM = 16_384  # elements in the smallest table; larger ones grow by factors of 8, so that few kernels are compiled
CELLS_PER_ELEMENT, ITEMS_PER_ELEMENT = 8, 32

# columns of a table of motions: velocity 3, point 3, axis 3, spin, start, duration, time of removal, whether it moves
# in place, upper bound of the speed at which the surface moves, amplitude of the vibration 3, its angular frequency
VELOCITY, PIVOT, AXIS, SPIN, START, LASTS, UNTIL, IN_PLACE, WANDERS, SWAY, SWAY_RATE = (
    0, 3, 6, 9, 10, 11, 12, 13, 14, 15, 18,
)  # fmt: skip
MOTION_SIZE = 19
FAR_OFF = 1e300  # [s], means never


@dataclass(frozen=True)
class WallTable:
    """Tables of the walls of a simulation."""

    elements: Array  # shape (n, 11)
    cell_first: npt.NDArray[np.int32]  # cells of all walls, one after the other
    items: npt.NDArray[np.int32]  # elements listed in the cells
    grid: Array  # per wall: lower corner 3, cells per metre
    grid_shape: npt.NDArray[np.int32]  # per wall: cells along x, y, z, and the first one; zeros: a single cell
    motion: Array  # shape (walls, 19)
    law: Array  # shape (kinds, walls, LAW_SIZE)

    @cached_property
    def room(self) -> int:
        """Number of elements for which a `WallContacts` for these walls is allocated."""
        room = ROOM
        needs = (len(self.elements), len(self.cell_first) / CELLS_PER_ELEMENT, len(self.items) / ITEMS_PER_ELEMENT)
        while room < max(needs):
            room *= 8
        return room


def wall_table(
    walls: Sequence[Sequence[Wall]],
    particles: Sequence[Particle],
    *,
    skin: float,
    domain: tuple[Array, Array],
    impact_speed: float = IMPACT_SPEED,
) -> WallTable:
    """Tables of walls, each given per kind of particle; lists are valid for displacements of half a `skin` [m]."""
    if len(walls) > WALLS:
        raise BadInput(
            f"walls: {len(walls)} were given; at most {WALLS} are possible, but one may be a mesh of many parts."
        )
    reach = max(particle.radius for particle in particles) + skin
    rows: list[Array] = []
    cells: list[npt.NDArray[np.integer]] = [np.zeros(1, dtype=np.int32)]
    items: list[npt.NDArray[np.integer]] = []
    grid, grid_shape = np.zeros((WALLS, 4)), np.zeros((WALLS, 4))
    motion, law = np.zeros((WALLS, MOTION_SIZE)), np.zeros((KINDS, WALLS, LAW_SIZE))
    before = 0  # elements of earlier walls
    for w, wall in enumerate(walls):
        own = wall[0].shape.rows
        own[:, OF_WALL] = w
        grid_shape[w, 3] = sum(len(part) for part in cells) - 1
        known = sum(len(part) for part in items)
        if len(own) > ALONE and np.all(own[:, shape.KIND] == TRIANGLE):
            sorted_ = sort_into_cells(own[:, shape.POINT :].reshape(-1, 3, 3), reach)
            grid[w] = *sorted_.low, 1 / sorted_.size
            grid_shape[w, :3] = sorted_.shape
            cells.append(known + sorted_.first[1:])
            items.append(before + sorted_.items)
        else:
            cells.append(np.array([known + len(own)]))
            items.append(before + np.arange(len(own)))
        rows.append(own)
        before += len(own)
        motion[w] = motion_row(wall[0].shape, wall[0].motion, wall[0].until, domain)
        for a, particle in enumerate(particles):
            law[a, w] = pair_law(particle.material, wall[a].material, wall[a].contact, impact_speed).row
    return WallTable(
        np.concatenate(rows) if rows else np.zeros((1, ELEMENT_SIZE)),
        np.concatenate(cells).astype(np.int32),
        np.concatenate(items).astype(np.int32) if items else np.zeros(1, dtype=np.int32),
        grid,
        grid_shape.astype(np.int32),
        motion,
        law,
    )


def motion_row(moved: Shape, motion: Motion | None, until: float, domain: tuple[Array, Array]) -> tuple[float, ...]:
    """Row of the table of motions."""
    motion = motion or Motion()
    lasts = min(motion.stop - motion.start, FAR_OFF)
    sway, rate = (motion.amplitude, 2 * math.pi * motion.frequency) if motion.vibrates else ((0.0, 0.0, 0.0), 0.0)
    return (
        *motion.velocity, *motion.point, *shape.unit(motion.axis), motion.spin, motion.start, lasts,
        min(until, FAR_OFF), float(motion.in_place), wandering(moved, motion, domain), *sway, rate,
    )  # fmt: skip


def motion_of(row: Array) -> Motion:
    """Motion from its row in the table."""
    x, y, z, a, b, c, u, v, w = map(float, row[VELOCITY:SPIN])
    spin, start, lasts = map(float, row[SPIN:UNTIL])
    p, q, r, rate = map(float, row[SWAY : SWAY_RATE + 1])
    frequency = rate / (2 * math.pi)
    return Motion(
        (x, y, z), spin, (u, v, w), (a, b, c), start, start + lasts, bool(row[IN_PLACE]), (p, q, r), frequency
    )
