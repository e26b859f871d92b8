"""Walls of every shape, at rest and in motion: closed forms, mutual comparison, reproducibility to the bit."""

import math

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.stl import stl_facets
from rigtwin.sim.engine.bulk import bulk as engine
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.few import few_body
from rigtwin.sim.engine.walls.mesh import Mesh, least_distances
from rigtwin.sim.engine.walls.shapes import (
    Annulus,
    Box,
    Cone,
    Cylinder,
    Disc,
    Motion,
    Plane,
    Plate,
    Shape,
    SlotPlate,
    Wall,
    gaps,
)
from rigtwin.sim.output.trajectory import triangles

G = 9.81
UP = (0.0, 0.0, 1.0)
SOFT = Material("soft ash", 720, 11e6, 0.44)
D6 = Particle("D6", SOFT, 6e-3, density=569)
CONTACT = Contact(0.5, 0.5)
STEP = 0.3 * D6.rayleigh_time_step
DOMAIN = (np.full(3, -0.2), np.full(3, 0.2))


def bench(*shapes: Shape | Wall, contact=CONTACT, gravity=(0, 0, -G), size=0.2, **more) -> Bulk:
    walls = [shape if isinstance(shape, Wall) else Wall(shape, SOFT, contact) for shape in shapes]
    more = {"time_step": STEP, "threads": 1} | more
    return Bulk([D6], contact, walls, low=(-size,) * 3, high=(size,) * 3, gravity=gravity, **more)


def moving(shape: Shape, motion: Motion, contact=CONTACT, until=math.inf) -> Wall:
    return Wall(shape, SOFT, contact, motion, until)


def depth(gravity=G) -> float:
    """Overlap [m] of a bead with a floor that carries its weight."""
    modulus = SOFT.youngs_modulus / (2 * (1 - SOFT.poisson_ratio**2))
    return (D6.mass * gravity / (4 / 3 * modulus * math.sqrt(D6.radius))) ** (2 / 3)


def lying(x=0.0, y=0.0, z=0.0) -> list[float]:
    """Position of a bead at rest on a horizontal wall at height z."""
    return [x, y, z + D6.radius - depth()]


def sheet(n: int, side=0.1, z=0.0, seed=None) -> np.ndarray:
    """A horizontal square of 2 n^2 triangles; with a seed the inner corners are shifted at random."""
    ticks = np.linspace(-side / 2, side / 2, n + 1)
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    if seed is not None:
        rng = np.random.default_rng(seed)
        x[1:-1, 1:-1] += rng.uniform(-0.3, 0.3, (n - 1, n - 1)) * side / n
        y[1:-1, 1:-1] += rng.uniform(-0.3, 0.3, (n - 1, n - 1)) * side / n
    p = np.stack([x, y, np.full_like(x, z)], axis=2)
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], 2).reshape(-1, 3, 3), np.stack([a, c, d], 2).reshape(-1, 3, 3)])


# ---------------------------------------------------------------------- shapes

SHAPES = [
    Disc((0.01, 0, 0.02), (0.2, 0.5, 1), 0.03),
    Annulus((0.01, 0, 0.02), (0.2, 0.5, 1), 0.01, 0.03),
    Cylinder((0.01, 0, 0.02), (0, 0.3, 2), 0.03, 0.05),
    Cone((0.01, 0, -0.02), (0, 0.3, 2), 0.03, 0.01, 0.05),
    Cone((0.01, 0, -0.02), (0, 0.3, 2), 0.0, 0.02, 0.05),
    Plate((-0.02, -0.02, 0.01), (0.05, 0, 0.01), (0, 0.04, 0.02)),
    SlotPlate((0, 0, 0.01), (0.08, 0.06), (0.02, 0.06)),
    SlotPlate((0, 0, 0.01), (0.08, 0.06), (0.02, 0.03)),
    Box((-0.03, -0.02, -0.01), (0.03, 0.02, 0.05), open_top=True),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_the_distance_of_beads_to_a_wall_is_that_to_its_triangles(shape):
    # the mesh consists of triangles; with 72 corners a circle is within 0.1 % of the radius
    rng = np.random.default_rng(4)
    centres = rng.uniform(-0.05, 0.06, (400, 3))
    gap = gaps(shape, centres, np.full(400, 0.02))
    expected = least_distances(triangles(shape, DOMAIN), centres, 0.04) - 0.02
    near = np.isfinite(gap) & (gap < 0.015)
    assert near.sum() > 40
    assert gap[near] == pytest.approx(expected[near], abs=3e-5)


def area(mesh) -> float:
    return float(np.linalg.norm(np.cross(mesh[:, 1] - mesh[:, 0], mesh[:, 2] - mesh[:, 0]), axis=1).sum() / 2)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (Annulus((0.01, 0, 0.02), (0.2, 0.5, 1), 0.01, 0.03), math.pi * (0.03**2 - 0.01**2)),
        (Cone((0, 0, 0), UP, 0.03, 0.01, 0.04), math.pi * 0.04 * math.hypot(0.04, 0.02)),
        (Cone((0, 0, 0), UP, 0.0, 0.03, 0.04), math.pi * 0.03 * 0.05),
        (Plate((0, 0, 0), (0.03, 0, 0), (0.01, 0.02, 0)), 0.03 * 0.02),
        (SlotPlate((0, 0, 0), (0.08, 0.06), (0.02, 0.03)), 0.08 * 0.06 - 0.02 * 0.03),
        (Box((0, 0, 0), (0.01, 0.02, 0.03)), 2 * (0.01 * 0.02 + 0.01 * 0.03 + 0.02 * 0.03)),
        (Mesh(sheet(5, seed=1)), 0.01),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_wall_has_its_own_area_as_a_mesh(shape, expected):
    assert area(triangles(shape, DOMAIN)) == pytest.approx(expected, rel=2e-3)


def test_the_cells_of_a_mesh_contain_every_near_triangle():
    corners = sheet(12, seed=3)
    corners[..., 2] = 0.02 * np.sin(40 * corners[..., 0])
    points = np.random.default_rng(5).uniform(-0.07, 0.07, (300, 3))
    each = np.min([least_distances(part, points, 0.01) for part in np.array_split(corners, 12)], axis=0)
    assert np.array_equal(least_distances(corners, points, 0.01), each)
    assert np.isfinite(each).sum() > 30


# ---------------------------------------------------------------------- one surface of many parts


def rolled(floor: Shape | Wall, steps=2500, **more) -> engine.Beads:
    """Three beads that slide, spin and bounce over the floor."""
    bed = bench(floor, contact=Contact(0.5, 0.3, 0.05), **more)
    bed.add(
        [lying(-0.04, 0.0003), lying(-0.04, 0.021), [-0.035, -0.02, 0.012]],
        [[0.5, 0.1, 0], [0.7, -0.05, 0], [0.4, 0.2, -0.3]],
        [[0, 0, 0], [30, -20, 50], [-40, 60, 20]],
    )
    bed.run(steps)
    return bed.beads()


def apart(one: engine.Beads, other: engine.Beads) -> float:
    return float(np.abs(one.position - other.position).max() + np.abs(one.velocity - other.velocity).max() * 1e-3)


@pytest.mark.parametrize(
    "floor",
    [
        Plate((-0.05, -0.05, 0), (0.1, 0, 0), (0, 0.1, 0)),
        Mesh(sheet(7)),
        Mesh(sheet(7, seed=2)),
        Mesh(sheet(60, seed=3)),  # triangles a quarter of a bead wide, 7200 of them
    ],
    ids=["plate", "squares", "crooked", "fine"],
)
def test_a_level_mesh_is_a_plane(floor):
    # the history must pass from triangle to triangle, and edges must not push
    assert apart(rolled(floor), rolled(Plane((0, 0, 0), UP))) < 1e-9


def test_a_level_mesh_of_turned_triangles_in_space_is_a_plane_too():
    corners = sheet(9, seed=4)
    corners[::2] = corners[::2, ::-1]
    turn = Motion(spin=1.0, axis=(1, 2, 0.5)).turned(0.7)
    gravity = tuple(turn @ [0, 0, -G])
    start = np.array([lying(-0.03, 0.001), lying(0.0, 0.012)]) @ turn.T
    velocity = np.array([[0.6, 0.1, 0], [0.3, -0.4, 0]]) @ turn.T
    ends = []
    for floor in (Mesh(corners @ turn.T), Plane((0, 0, 0), tuple(turn @ UP))):
        bed = bench(floor, gravity=gravity)
        bed.add(start, velocity)
        bed.run(2000)
        ends.append(bed.beads())
    assert apart(*ends) < 1e-9


def test_a_box_of_plates_is_a_box_of_planes():
    planes = [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((0.03, 0, 0), (-1, 0, 0))]
    planes += [((0, 0, 0), (0, 1, 0)), ((0, 0.03, 0), (0, -1, 0))]
    velocity = np.random.default_rng(6).normal(0, 0.2, (32, 3))
    k = np.arange(32)
    places = np.stack([k % 4, k // 4 % 4, k // 16], axis=1) * 6.5e-3 + 4e-3
    ends = []
    for walls in ([Plane(*plane) for plane in planes], [Box((0, 0, 0), (0.03, 0.03, 0.05), open_top=True)]):
        bed = bench(*walls, contact=Contact(0.5, 0.4, 0.05))
        bed.add(places, velocity)
        bed.run(1500)
        ends.append(bed.beads())
    assert apart(*ends) < 1e-8


def test_a_bead_rolls_over_the_edge_of_a_table_without_a_kick():
    # at a convex edge the normal turns but the path is smooth: energy only falls, and little
    corners = sheet(6, side=0.06)
    slope = corners.copy()
    slope[..., 0] += 0.06
    slope[..., 2] = -0.25 * (slope[..., 0] - 0.03)
    bed = bench(Mesh(np.concatenate([corners, slope])), contact=Contact(0.9, 0.5))
    speed = 0.05
    bed.add([lying(0.02)], [[speed, 0, 0]], [[0, speed / D6.radius, 0]])
    energies = []
    for _ in range(500):
        budget = bed.budget()
        energies.append(budget.total)
        bed.run(20)
    assert bed.beads().position[0, 0] > 0.04
    assert bed.beads().position[0, 2] < D6.radius
    given = 0.7 * D6.mass * speed**2
    # the first steps make the contact
    assert max(np.diff(energies[2:])) < 1e-3 * given
    assert energies[-1] > energies[0] - 0.02 * given


def test_a_bead_in_a_corner_of_two_triangles_presses_on_both():
    # a V of two slopes at 45 degrees: each carries the weight over sqrt 2
    wide = 0.05
    v = [Plate((-wide, -wide, wide), (wide, 0, -wide), (0, 2 * wide, 0))]
    v += [Plate((0, -wide, 0), (wide, 0, wide), (0, 2 * wide, 0))]
    corners = np.concatenate([plate.corners for plate in v])
    bed = bench(Mesh(corners), contact=Contact(0.5))
    bed.add([[0, 0, math.sqrt(2) * D6.radius]])
    bed.run(4000)
    modulus = SOFT.youngs_modulus / (2 * (1 - SOFT.poisson_ratio**2))
    deep = (D6.mass * G / math.sqrt(2) / (4 / 3 * modulus * math.sqrt(D6.radius))) ** (2 / 3)
    assert bed.beads().position[0] == pytest.approx([0, 0, math.sqrt(2) * (D6.radius - deep)], abs=1e-9)
    assert bed.budget().wall_contacts == 2


def test_a_bead_stands_in_the_bottom_corner_of_a_tube():
    tube = bench(
        Disc((0, 0, 0), UP, 0.02), Cylinder((0, 0, 0), UP, 0.02, 0.05), gravity=(G, 0, -G), contact=Contact(0.5)
    )
    tube.add([[0.0, 0, 0.004]])
    tube.run(20_000)
    assert tube.budget().wall_contacts == 2
    assert tube.beads().position[0] == pytest.approx([0.017 + depth(), 0, 0.003 - depth()], abs=2e-6)


def test_on_the_shared_rim_of_two_walls_a_bead_is_carried_once():
    # a cone ends where a tube begins; the bead balances on the rim inside
    cone, tube = Cone((0, 0, 0), UP, 0.02, 0.05, 0.03), Cylinder((0, 0, -0.05), UP, 0.02, 0.05)
    bed = bench(cone, tube, gravity=(0, 0, 0), contact=Contact(1.0))
    rim, normal = np.array([0.02, 0, 0]), np.array([-math.cos(0.5), 0, math.sin(0.5)])
    bed.add([rim + (D6.radius - 1e-6) * normal])
    bed.run(1)
    budget = bed.budget()
    assert budget.wall_contacts == 1


def test_a_bead_on_the_axis_of_a_tube_touches_nothing():
    bed = bench(Cylinder((0, 0, -0.05), UP, 0.02, 0.1), gravity=(0, 0, 0))
    bed.add([[0, 0, 0]])
    bed.run(10)
    assert not bed.beads().velocity.any()


def test_any_number_of_walls_may_be_near_a_bead():
    # a fan of 40 triangles around the landing point, more than the list has room for
    angle = np.arange(41) * 2 * math.pi / 40
    ring = np.stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), 0 * angle], axis=1)
    fan = Mesh(np.stack([np.zeros((40, 3)), ring[:-1], ring[1:]], axis=1))
    ends = []
    for floor, room in ((fan, 16), (fan, None), (Plane((0, 0, 0), UP), None)):
        bed = bench(floor, near_capacity=room)
        bed.add([[1e-4, 2e-5, 0.0035]], [[0.1, 0, -0.2]])
        bed.run(2000)
        ends.append(bed.beads())
    assert np.array_equal(ends[0].position, ends[1].position)
    assert apart(ends[1], ends[2]) < 1e-10


def cone_mesh(cone: Cone, around: int) -> Mesh:
    angle = np.arange(around + 1) * 2 * math.pi / around
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    centre, up = np.array(cone.centre), np.array([0, 0, cone.height])
    low, high = centre + cone.radius * circle, centre + up + cone.far_radius * circle
    one = np.stack([low[:-1], low[1:], high[:-1]], 1)
    return Mesh(np.concatenate([one, np.stack([low[1:], high[1:], high[:-1]], 1)]))


def test_a_bead_rolls_down_a_cone_as_on_its_mesh_and_as_on_a_straight_slope():
    # a generator of the cone is a straight slope of 45 degrees
    cone = Cone((0, 0, 0), UP, 0.005, 0.085, 0.08)
    slope = math.radians(45)
    start = np.array([0.06, 0, 0.055]) + (D6.radius - depth(G * math.cos(slope))) * np.array(
        [-math.sin(slope), 0, math.cos(slope)]
    )
    ends, took = [], 2000 * STEP
    for shape in (cone, cone_mesh(cone, 400)):
        bed = bench(shape, contact=Contact(0.5, 0.6))
        bed.add([start])
        bed.run(2000)
        ends.append(bed.beads())
    way = np.linalg.norm(ends[0].position[0] - start)
    assert way == pytest.approx(0.5 * 5 / 7 * G * math.sin(slope) * took**2, rel=2e-3)
    assert ends[0].position[0, 1] == pytest.approx(0, abs=1e-9)
    # 400 corners lie up to 3e-5 of the radius inside
    assert ends[1].position == pytest.approx(ends[0].position, abs=2e-4 * way)


def test_a_mesh_is_read_from_a_file_and_must_be_closed_if_declared_so(tmp_path):
    import trimesh

    trimesh.creation.box((40, 30, 20)).export(tmp_path / "box.stl")
    mesh = Mesh(np.array(stl_facets(tmp_path / "box.stl", 1e-3, "give a box").triangles), closed=True)
    assert area(mesh.corners) == pytest.approx(2 * (0.04 * 0.03 + 0.04 * 0.02 + 0.03 * 0.02), rel=1e-6)
    with pytest.raises(BadInput, match=r"lid: the mesh must be closed, but 3 of its edges"):
        Mesh(mesh.corners[1:], True, "lid")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Annulus((0, 0, 0), UP, 0.03, 0.02).rows, "inner radius"),
        (lambda: Cone((0, 0, 0), UP, 0.0, 0.0, 0.02).rows, "cone"),
        (lambda: Cone((0, 0, 0), UP, -0.1, 0.1, 0.02).rows, "cone"),
        (lambda: Plate((0, 0, 0), (1, 0, 0), (2, 0, 0)).rows, "no area"),
        (lambda: SlotPlate((0, 0, 0), (0.1, 0.1), (0.2, 0.05)).rows, "opening"),
        (lambda: Box((0, 0, 0), (1, 0, 1)).rows, "box"),
        (lambda: Mesh(np.zeros((0, 3, 3))), "needs triangles"),
        (lambda: Mesh(np.zeros((2, 3, 3))), "area"),
        (lambda: Mesh(np.full((2, 3, 3), math.nan)), "not a finite number"),
        (lambda: Motion((math.inf, 0, 0)), "finite"),
        (lambda: Motion(start=2.0, stop=1.0), "cannot stop"),
        (lambda: Motion.turning(3, axis=(0, 0, 0)), "no length"),
        (lambda: bench(*[Plane((0, 0, -0.1), UP)] * 65), "at most 64"),
    ],
)
def test_an_impossible_wall_is_refused(make, message):
    with pytest.raises(BadInput, match=message):
        make()


# ---------------------------------------------------------------------- walls that move

BELT = Motion((0.3, 0, 0))


@pytest.mark.parametrize(
    "belt",
    [
        moving(Plane((0, 0, 0), UP), BELT),
        moving(Plate((-0.05, -0.05, 0), (0.2, 0, 0), (0, 0.1, 0)), Motion((0.3, 0, 0), in_place=True)),
        moving(Plate((-0.15, -0.05, 0), (0.2, 0, 0), (0, 0.1, 0)), BELT),
    ],
    ids=["plane", "belt", "plate that slides along"],
)
def test_a_bead_on_a_belt_slides_until_it_rolls(belt):
    # friction mu g accelerates and spins it until it rolls: v = 2/7 of the belt's speed
    mu = CONTACT.static_friction
    until_rolling = 2 / 7 * 0.3 / (mu * G)
    bed = bench(belt)
    bed.add([lying(-0.03)])
    bed.run(round(0.5 * until_rolling / STEP))
    beads = bed.beads()
    assert beads.velocity[0, 0] == pytest.approx(mu * G * bed.time, rel=0.01)
    assert beads.spin[0, 1] == pytest.approx(-2.5 * mu * G * bed.time / D6.radius, rel=0.01)
    bed.run(round(3 * until_rolling / STEP))
    beads = bed.beads()
    assert beads.velocity[0, 0] == pytest.approx(2 / 7 * 0.3, rel=1e-3)
    assert beads.velocity[0, 0] - D6.radius * beads.spin[0, 1] == pytest.approx(0.3, rel=1e-3)


def test_a_belt_carries_a_bead_that_cannot_roll_at_its_own_speed():
    # rolling resistance prevents the bead from rolling
    contact = Contact(0.5, 0.5, 10.0)
    bed = bench(moving(Plane((0, 0, 0), UP), BELT, contact), contact=contact)
    bed.add([lying(-0.05)])
    bed.run(round(0.5 * 0.3 / (0.5 * G) / STEP))
    assert bed.beads().velocity[0, 0] == pytest.approx(0.5 * G * bed.time, rel=0.03)
    bed.run(round(2 * 0.3 / (0.5 * G) / STEP))
    assert bed.beads().velocity[0, 0] == pytest.approx(0.3, rel=1e-3)
    assert bed.beads().spin[0] == pytest.approx([0, 0, 0], abs=0.05)


def test_the_work_of_a_wall_is_in_the_energy_balance():
    bed = bench(moving(Plane((0, 0, 0), UP), BELT))
    bed.add([lying(-0.05)])
    before = bed.budget()
    bed.run(50)
    sliding = bed.budget()
    # power of the wall mu m g v; at most two sevenths of the energy remain in the bead
    assert sliding.work == pytest.approx(0.5 * D6.mass * G * 0.3 * bed.time, rel=0.05)
    assert 0 < sliding.total - before.total < sliding.work
    bed.run(3000)
    given = bed.work
    bed.run(1000)
    assert bed.work == pytest.approx(given, rel=1e-6)  # rolling with the wall needs no work


def test_a_lifted_plate_raises_its_bead_and_lowers_it_again():
    lift = Motion((0, 0, 0.1), start=0.01, stop=0.11)
    bed = bench(moving(Plate((-0.02, -0.02, 0), (0.04, 0, 0), (0, 0.04, 0)), lift))
    bed.add([lying()])
    bed.run(round(0.06 / STEP))
    assert bed.beads().velocity[0, 2] == pytest.approx(0.1, rel=1e-3)
    assert bed.beads().position[0, 2] == pytest.approx(lying()[2] + 0.1 * (bed.time - 0.01), abs=2e-6)
    bed.run(round(0.1 / STEP))
    assert bed.beads().position[0] == pytest.approx(lying(z=0.01), abs=1e-7)
    # work against the weight, and for the momentum m v at the speed v at the start
    assert bed.work == pytest.approx(D6.mass * (G * 0.01 + 0.1**2), rel=0.02)


def test_a_bead_falls_when_its_floor_is_removed():
    bed = bench(moving(Disc((0, 0, 0), UP, 0.02), Motion(), until=0.05))
    bed.add([lying()])
    bed.run(round(0.15 / STEP))
    fell = bed.time - math.ceil(0.05 / STEP) * STEP
    assert bed.beads().position[0, 2] == pytest.approx(lying()[2] - G * fell**2 / 2, abs=2e-5)


def test_a_wall_that_goes_too_far_in_a_step_is_refused():
    fast = Motion(velocity=(0, 0, 0.3 * D6.radius / STEP))
    with pytest.raises(BadInput, match=r"wall 1 moves by up to 0\.9 mm in a step of .* s, more than 0\.2 radii"):
        bench(Plane((0, 0, 0), (0, 0, 1)), moving(Plane((0, 0, 0.15), (0, 0, -1)), fast))
    bed = bench(Plane((0, 0, 0), (0, 0, 1)))
    with pytest.raises(BadInput, match=r"wall 0 moves by up to 0\.9 mm"):
        bed.move_wall(0, fast)
    bed.add([lying()])
    bed.run(10)  # it stays as it was
    assert bed.beads().position[0] == pytest.approx(lying(), abs=1e-5)


def test_walls_may_be_moved_and_removed_during_a_run():
    def shelf() -> Bulk:
        bed = bench(Plate((-0.02, -0.02, 0), (0.04, 0, 0), (0, 0.04, 0)))
        bed.add([lying()])
        bed.run(100)
        return bed

    bed = shelf()
    bed.move_wall(0, Motion((0, 0, 0.1), start=bed.time))
    bed.run(3000)
    assert bed.beads().position[0, 2] == pytest.approx(lying()[2] + 0.1 * 3000 * STEP, abs=2e-6)
    with pytest.raises(BadInput, match="has moved already"):
        bed.move_wall(0, Motion((0, 0, 0.1), start=bed.time))
    state, ends = bed.state(), []
    for again in (False, True):
        run = shelf() if again else bed  # a later run takes the memory of the first
        if again:
            run.restore(state)
        run.remove_wall(0)
        run.add([[0, 0, run.beads().position[0, 2] - 0.01]])  # no wall remains to overlap with
        run.run(1000)
        ends.append(run.beads())
    assert same(*ends)
    assert ends[0].velocity[0, 2] == pytest.approx(0.1 - G * 1000 * STEP, abs=1e-3)


def test_a_bead_on_a_turntable_turns_with_it():
    # friction below mu g provides w^2 r; its history must rotate with the table, or the bead would creep outwards
    table = moving(Disc((0, 0, 0), UP, 0.05), Motion.turning(60, axis=UP), Contact(0.5, 0.8, 10.0))
    bed = bench(table, contact=Contact(0.5, 0.8, 10.0))
    omega, r = 2 * math.pi, 0.03
    bed.add([lying(r)], [[0, omega * r, 0]], [[0, 0, omega]])
    bed.run(round(1.0 / STEP))
    beads = bed.beads()
    assert np.hypot(*beads.position[0, :2]) == pytest.approx(r, rel=1e-3)
    angle = math.atan2(beads.position[0, 1], beads.position[0, 0]) % (2 * math.pi)
    assert angle == pytest.approx(omega * bed.time % (2 * math.pi), abs=2e-3)


DRUM = Cylinder((0, -0.03, 0), (0, 1, 0), 0.05, 0.06)


def in_a_drum(shape: Shape, contact: Contact, *, rpm: float, start: float, spin: float, looks: int) -> np.ndarray:
    """Angles [rad] of a bead from the lowest point of a drum that turns about +y, every 200 steps."""
    bed = bench(moving(shape, Motion.turning(rpm, axis=(0, 1, 0)), contact), contact=contact)
    reach = 0.05 - D6.radius + depth(G * math.cos(start))
    bed.add([[-reach * math.sin(start), 0, -reach * math.cos(start)]], spin=[[0, spin, 0]])
    angles = []
    for _ in range(looks):
        x, _y, z = bed.beads().position[0]
        angles.append(math.atan2(-x, -z))
        bed.run(200)
    return np.array(angles)


@pytest.mark.parametrize("mesh", [False, True], ids=["cylinder", "mesh"])
def test_a_bead_in_a_drum_rolls_at_the_angle_of_rolling_friction(mesh):
    # the wall moves down on the side of -x, and the bead is at tan(angle) = mu_r
    shape, angle = cylinder_mesh(DRUM, 360) if mesh else DRUM, math.atan(0.1)
    spin = 20 * math.pi / 30 * 0.05 / D6.radius
    angles = in_a_drum(shape, Contact(0.5, 0.5, 0.1), rpm=20, start=angle, spin=spin, looks=40)
    assert np.tan(angles.mean()) == pytest.approx(0.1, rel=0.03)
    assert angles.std() < 0.1 * angle


def test_a_bead_that_starts_at_the_bottom_of_a_drum_swings_about_the_angle_of_rolling_friction():
    # rolling friction is constant below the wall's speed: it shifts the centre of the swing without damping
    angles = in_a_drum(DRUM, Contact(0.5, 0.5, 0.05), rpm=40, start=0.0, spin=40 * math.pi / 30 * 50 / 3, looks=80)
    time = np.arange(80) * 200 * STEP
    rate = math.sqrt(5 / 7 * G * math.cos(math.atan(0.05)) / 0.047)
    assert angles == pytest.approx(math.atan(0.05) * (1 - np.cos(rate * time)), abs=0.006)


def test_a_bead_that_cannot_roll_in_a_drum_slides_at_the_angle_of_friction():
    angle = math.atan(0.3)
    angles = in_a_drum(DRUM, Contact(0.5, 0.3, 10.0), rpm=60, start=angle, spin=0.0, looks=40)
    assert np.tan(angles.mean()) == pytest.approx(0.3, rel=0.03)
    assert angles.std() < 0.1 * angle


def cylinder_mesh(tube: Cylinder, around: int) -> Mesh:
    """A tube about y as triangles."""
    angle = np.arange(around + 1) * 2 * math.pi / around
    low = np.stack([tube.radius * np.sin(angle), np.full(around + 1, tube.centre[1]), tube.radius * np.cos(angle)], 1)
    high = low + np.array([0, tube.height, 0])
    return Mesh(
        np.concatenate([np.stack([low[:-1], low[1:], high[:-1]], 1), np.stack([low[1:], high[1:], high[:-1]], 1)])
    )


def test_contacts_follow_a_moving_mesh():
    # a rotating blade sweeps beads from the floor; none may ever be inside it
    blade = Plate((0, -0.02, 0.0005), (0.05, 0, 0), (0, 0.04, 0))
    turn = Motion(spin=3.0, axis=(0, 0, 1))
    standing = Plate((0, 0, 0.0005), (0.05, 0, 0), (0, 0, 0.02))
    bed = bench(Plane((0, 0, 0), UP), moving(standing, turn), moving(Mesh(sheet(5, z=-0.05)), turn))
    bed.add([lying(0.03 * math.cos(a), 0.03 * math.sin(a)) for a in (0.5, 1.5, 2.5)])
    for _ in range(20):
        bed.run(round(0.05 / STEP))
        beads = bed.beads()
        back = turn.undone(beads.position, bed.time)
        assert gaps(standing, back, beads.radius).min() > -0.02 * D6.radius
    assert gaps(blade, back, beads.radius).min() < 0.05
    assert bed.work > 0


# ---------------------------------------------------------------------- a few bodies


def test_few_bodies_and_the_bulk_engine_have_the_same_wall_contacts():
    # a bead bounces into a box and along a belt: once in the bulk, once alone, both with a fine step
    bead = Particle("D6", SOFT, 6e-3, density=569)
    walls = [Box((-0.02, -0.02, 0), (0.02, 0.02, 0.05), open_top=True), moving(Plane((0, 0, 0.001), UP), BELT)]
    start, velocity = (0.002, 0.001, 0.01), (0.3, 0.05, -0.2)
    bed = bench(*walls, time_step=STEP / 20)
    bed.add([start], [velocity])
    bed.run(12_000)
    given = [wall if isinstance(wall, Wall) else Wall(wall, SOFT, CONTACT) for wall in walls]
    alone = few_body.run(
        [few_body.Body(bead, start, velocity)], np.array([bed.time]), walls=given, step=STEP / 20, flight_step=STEP / 20
    )
    assert alone.position[0] == pytest.approx(bed.beads().position, abs=2e-5)
    assert alone.velocity[0] == pytest.approx(bed.beads().velocity, abs=2e-3)


def test_a_resting_bead_moves_when_its_floor_is_removed():
    floor = moving(Disc((0, 0, 0), UP, 0.02), Motion(), until=0.5)
    motion = few_body.run([few_body.Body(D6, (0, 0, 0.003))], np.array([0.5, 0.6]), walls=[floor])
    assert motion.position[:, 0, 2] == pytest.approx([lying()[2], lying()[2] - G * 0.1**2 / 2], abs=1e-6)


# ---------------------------------------------------------------------- to the bit


def churn(**more) -> Bulk:
    """Sixty-four beads in a turning box of triangles with a lid that opens."""
    turn = Motion.turning(120, axis=(0, 1, 0), start=0.05, stop=0.3)
    box = Box((-0.018, -0.018, -0.018), (0.018, 0.018, 0.018), open_top=True)
    lid = Plate((-0.018, -0.018, 0.018), (0.036, 0, 0), (0, 0.036, 0))
    contact = Contact(0.5, 0.4, 0.05)
    walls = [moving(box, turn, contact), moving(lid, turn, contact, until=0.25)]
    bed = bench(*walls, contact=contact, open_domain=True, size=0.06, **more)
    k = np.arange(64)
    places = (np.stack([k % 4, k // 4 % 4, k // 16], axis=1) - 1.5) * 7e-3
    bed.add(places, np.random.default_rng(7).normal(0, 0.2, (64, 3)))
    return bed


def same(one: engine.Beads, other: engine.Beads) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in vars(one))


@pytest.fixture(scope="module")
def churned() -> tuple[engine.Beads, float, int]:
    bed = churn()
    bed.run(9000)
    return bed.beads(), bed.work, bed.gone


def test_one_thread_and_two_give_the_same_bits_with_moving_walls(churned, monkeypatch):
    monkeypatch.setattr(engine, "BEADS_PER_THREAD", 1)
    bed = churn(threads=2)
    bed.run(9000)
    assert same(bed.beads(), churned[0])
    assert (bed.work, bed.gone) == churned[1:]
    assert bed.gone > 0


def test_a_resumed_run_with_moving_walls_gives_the_same_bits(churned):
    bed = churn()
    states = []
    for steps in np.diff([0, 1, 1700, 4111, 8000]):
        bed.run(int(steps))
        states.append((bed.steps, bed.state()))
    for made, state in states:
        again = churn()
        again.run(300)
        again.restore(state)
        again.run(9000 - made)
        assert same(again.beads(), churned[0])
        assert (again.work, again.gone) == churned[1:]


def test_reading_the_energy_balance_does_not_change_the_bits(churned):
    bed = churn()
    for _ in range(90):
        bed.budget()
        bed.run(100)
    assert same(bed.beads(), churned[0])


# ---------------------------------------------------------------------- vibration


def test_a_ball_on_a_floor_that_shakes_along_itself_rolls_with_two_sevenths_of_its_speed():
    amplitude, frequency = 0.5e-3, 20.0
    shake = Motion(amplitude=(amplitude, 0, 0), frequency=frequency)
    bed = bench(moving(Mesh(sheet(4)), shake, Contact(0.2, 5.0)))
    bed.add([lying()])
    bed.run(round(0.05 / STEP))
    found, plate = [], []
    for _ in range(40):
        bed.run(50)
        found.append(bed.beads().velocity[0, 0])
        plate.append(2 * math.pi * frequency * amplitude * math.cos(2 * math.pi * frequency * bed.time))
    assert np.array(found) == pytest.approx(2 / 7 * np.array(plate), abs=0.02 * max(plate))


def test_a_bead_on_a_floor_that_shakes_less_than_gravity_stays_on_it():
    amplitude, frequency = 0.4e-3, 18.0  # 0.52 g
    shake = Motion(amplitude=(0, 0, amplitude), frequency=frequency, start=0.05)
    bed = bench(moving(Mesh(sheet(4)), shake, Contact(0.1, 0.5)))
    bed.add([lying()])
    bed.run(round(0.3 / STEP))  # it hops as the floor starts at full speed
    for _ in range(40):
        bed.run(50)
        floor = shake.displaced(bed.time)[2]
        assert floor == pytest.approx(amplitude * math.sin(2 * math.pi * frequency * (bed.time - 0.05)), abs=1e-12)
        # as deep as 0.48 to 1.52 weights press it
        overlap = D6.radius + floor - bed.beads().position[0, 2]
        assert 0.97 * depth(0.48 * G) < overlap < 1.03 * depth(1.52 * G)


def test_a_shaken_wall_has_its_place_back_after_undoing():
    motion = Motion((0.1, 0, 0), 2.0, (0, 1, 0), (0, 0, 0.1), 0.2, 0.9, amplitude=(0, 0.01, 0), frequency=7.0)
    points = np.random.default_rng(1).normal(0, 0.1, (5, 3))
    for time in (0.0, 0.5, 2.0):
        assert motion.undone(motion.done(points, time), time) == pytest.approx(points, abs=1e-15)
    assert motion.displaced(2.0) == pytest.approx([0.07, 0.01 * math.sin(2 * math.pi * 7 * 0.7), 0])


def test_the_impulses_on_a_wall_are_the_weight_of_its_beads_and_survive_a_larger_arena():
    across = np.arange(-0.03, 0.03, 0.007)
    places = [lying(x, y) for x in across for y in across]
    found = []
    for sizes in ({}, {"pair_capacity": 16, "near_capacity": 8}):
        bulk = bench(Plane((0, 0, 0), UP), weighs=True, **sizes)
        bulk.add(np.array(places))
        bulk.run(1000)
        found.append(bulk.impulses)
    assert np.array_equal(*found)
    x, y, _ = np.mean(places, axis=0)
    impulse = -len(places) * D6.mass * G * bulk.time
    assert found[0][0] == pytest.approx(impulse * np.array([0, 0, 1, y, -x, 0]), rel=1e-3, abs=1e-9)
