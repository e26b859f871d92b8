"""Rigid clumps in the bulk engine: conservation laws, closed forms, reproducibility to the bit."""

import math

import gsd.hoomd
import h5py
import numpy as np
import pytest

from rigtwin.lab.clumps import Clump, clump, cubic, row
from rigtwin.lab.errors import BadInput, SimulationFailed
from rigtwin.lab.materials import Contact, Material, Particle, clumped
from rigtwin.sim.engine.bulk import bulk as engine
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.contact import damping_ratio
from rigtwin.sim.engine.walls.shapes import Plane, Wall
from rigtwin.sim.output import trajectory

G = 9.81
SOFT = Material("soft ash", 720, 11e6, 0.44)
CONTACT = Contact(0.6, 0.44, 0.08)
ODD = clumped("odd", SOFT, clump([(0, 0, 0), (3e-3, 0, 0), (0, 2e-3, 1e-3)], [2e-3, 1.5e-3, 1e-3]))
DUMBBELL = clumped("dumbbell", SOFT, row(2, 2e-3, 3e-3))
CUBE = clumped("cube", SOFT, cubic(6e-3, ((1, 1, 1), 1.7e-3)))
PLATE = clumped("plate", SOFT, clump([(0, 4e-3, 0), (3.4e-3, -2e-3, 0), (-3.4e-3, -2e-3, 0)], 2e-3))
UPRIGHT = (math.sqrt(0.5), 0, math.sqrt(0.5), 0)  # x of the clump points down
FLOOR = Plane((0, 0, 0), (0, 0, 1))


def bed(particles, contact=CONTACT, shapes=(FLOOR,), fraction=0.3, **more) -> Bulk:
    step = fraction * min(particle.rayleigh_time_step for particle in particles)
    box = {"low": (-0.05, -0.05, -0.01), "high": (0.05, 0.05, 0.2), "time_step": step, "threads": 1} | more
    return Bulk(particles, contact, [Wall(shape, SOFT, contact) for shape in shapes], **box)


def angular_momentum(bulk: Bulk) -> np.ndarray:
    grains = bulk.grains()
    return (np.cross(grains.position, grains.mass[:, None] * grains.velocity) + grains.momentum).sum(0)


def test_a_spinning_clump_tumbles_and_keeps_its_energy_and_angular_momentum():
    space = bed([ODD], shapes=(), gravity=(0, 0, 0))
    # nearly about the intermediate axis: it must flip over and back
    space.add([[0, 0, 0.1]], spin=[[20.0, 400.0, 20.0]])
    before = space.grains()
    upside = []
    for _ in range(40):
        space.run(500)
        now = space.grains()
        upside.append(engine.rigid_bodies.matrices(now.turn)[0, 1, 1])
        assert now.kinetic_energy == pytest.approx(before.kinetic_energy, rel=1e-5)
        assert now.momentum[0] == pytest.approx(before.momentum[0], abs=1e-14 * np.abs(before.momentum).max())
    assert min(upside) < -0.9
    assert max(upside) > 0.9


def test_a_clump_of_one_sphere_does_what_the_sphere_does():
    r = 3e-3
    sphere = Particle("sphere", SOFT, 2 * r)
    alone = Clump(((0.0, 0.0, 0.0),), (r,), 4 / 3 * math.pi * r**3, (0.4 * r**2,) * 3)
    places = np.array([[-0.012, 0, 0.004], [-0.002, 0.001, 0.0045], [0.008, -0.001, 0.006]])
    velocity, spin = [[0.6, 0.05, -0.2], [0, 0, 0], [-0.5, 0.1, 0]], [[10, 80, -30], [0, 0, 0], [50, 0, 20]]
    found = []
    for kind in (sphere, clumped("one", SOFT, alone)):
        run = bed([kind])
        run.add(places, velocity, spin)
        run.run(1500)
        found.append(run.beads())
    one, other = found
    assert np.abs(one.spin).max() > 10
    assert other.position == pytest.approx(one.position, abs=1e-9 * r)
    assert other.velocity == pytest.approx(one.velocity, abs=1e-9)
    assert other.spin == pytest.approx(one.spin, abs=1e-9 * np.abs(one.spin).max())
    assert other.kinetic_energy == pytest.approx(one.kinetic_energy, rel=1e-9)


def bounce(turn, height: float, e: float) -> engine.Grains:
    """A dumbbell after a drop without spin."""
    run = bed([DUMBBELL], Contact(e, 0.3), fraction=0.01, gravity=(0, 0, 0))
    run.add([[0, 0, height + 5e-5]], [[0.0, 0.0, -0.5]], turn=turn)
    run.run(4000)
    return run.grains()


@pytest.mark.parametrize("e", [0.5, 0.8, 1.0])
def test_a_clump_landing_on_one_sphere_has_the_given_restitution(e):
    up = bounce(UPRIGHT, 3.5e-3, e)
    assert up.velocity[0, 2] == pytest.approx(0.5 * e, rel=5e-3)
    assert np.abs(up.spin).max() < 1e-6


@pytest.mark.parametrize("e", [0.5, 0.8, 1.0])
def test_a_clump_landing_flat_on_two_spheres_has_the_restitution_of_two_dashpots(e):
    # each contact is damped for the whole mass, as in other codes; together they have sqrt(2) times the damping ratio
    flat = bounce(None, 2e-3, e)
    angle = math.asin(math.sqrt(2) * damping_ratio(e))
    assert flat.velocity[0, 2] == pytest.approx(0.5 * math.exp(-(math.pi - 2 * angle) * math.tan(angle)), rel=5e-3)
    assert np.abs(flat.velocity[0, :2]).max() < 1e-12
    assert np.abs(flat.spin).max() < 1e-6


def test_colliding_clumps_keep_momentum_and_angular_momentum():
    space = bed([ODD, CUBE], shapes=(), gravity=(0, 0, 0))
    space.add([[-0.006, 0.001, 0.1]], [[1.0, 0.2, 0.3]], [[30, -80, 50]], kind=0)
    space.add([[0.006, -0.001, 0.101]], [[-1.0, 0, 0]], [[0, 40, -20]], kind=1)
    before, turning = space.grains(), angular_momentum(space)
    space.run(800)
    after = space.grains()
    assert np.abs(after.spin - before.spin).max() > 10  # they did meet
    linear = [(grains.mass[:, None] * grains.velocity).sum(0) for grains in (before, after)]
    assert linear[1] == pytest.approx(linear[0], abs=1e-12 * np.linalg.norm(linear[0]))
    assert angular_momentum(space) == pytest.approx(turning, abs=1e-11 * np.linalg.norm(turning))
    assert after.kinetic_energy < before.kinetic_energy


@pytest.mark.parametrize(("degrees", "slides"), [(20, False), (30, True)])
def test_a_clump_that_cannot_roll_slides_above_the_angle_of_friction(degrees, slides):
    mu, a = 0.44, math.radians(degrees)  # 23.7 degrees
    run = bed([PLATE], Contact(0.5, mu), gravity=(G * math.sin(a), 0, -G * math.cos(a)), fraction=0.2)
    run.add([[-0.04, 0, 2e-3]])
    run.run(1000)
    settled, then = run.grains(), run.time
    run.run(1000)
    grains = run.grains()
    gained = float(grains.velocity[0, 0] - settled.velocity[0, 0]) / (run.time - then)
    expected = G * (math.sin(a) - mu * math.cos(a)) if slides else 0.0
    assert gained == pytest.approx(expected, abs=2e-3 * G)
    assert np.abs(grains.spin).max() < 0.05


def test_a_clump_at_rest_stays_at_rest():
    run = bed([CUBE])
    run.add([[0, 0, 3.2e-3]])
    run.run(20_000)
    before = run.grains()
    run.run(20_000)
    after = run.grains()
    assert np.abs(after.position - before.position).max() < 1e-9 * 6e-3
    assert np.abs(after.turn - before.turn).max() < 1e-9
    assert after.kinetic_energy < 1e-12 * CUBE.mass * G * 3e-3
    # the floor carries the weight on four spheres
    stiff = 4 / 3 * SOFT.youngs_modulus / (2 * (1 - SOFT.poisson_ratio**2)) * math.sqrt(1.7e-3)
    depth = np.maximum(1.7e-3 - run.beads().position[:, 2], 0)
    assert (depth > 0).sum() == 4
    assert (stiff * depth**1.5).sum() == pytest.approx(CUBE.mass * G, rel=1e-3)


def random_turns(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 1, (count, 4))


def heap(seed=3, count=36, **more) -> Bulk:
    """Irregular clumps and spheres thrown into a narrow box."""
    sides = [Plane((x, 0, 0), (n, 0, 0)) for x, n in ((-0.012, 1), (0.012, -1))]
    sides += [Plane((0, y, 0), (0, n, 0)) for y, n in ((-0.012, 1), (0.012, -1))]
    run = bed([ODD, Particle("bead", SOFT, 3e-3)], shapes=(FLOOR, *sides), **more)
    k = np.arange(count)
    places = np.stack([k % 3 - 1, k // 3 % 3 - 1, k // 9 + 0.7], axis=1) * 7.8e-3
    speeds = np.random.default_rng(seed).normal(0, 0.3, (count, 3)) - [0, 0, 0.5]
    odd = k % 4 > 0
    run.add(places[odd], speeds[odd], turn=random_turns(odd.sum(), seed), kind=0)
    run.add(places[~odd], speeds[~odd], kind=1)
    return run


def same_bits(one: engine.Grains, other: engine.Grains) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in vars(one))


def test_a_heap_keeps_its_clumps_whole_and_loses_energy_only():
    run = heap()
    before, budget = run.beads(), [run.budget().total]
    assert run.added == 36
    for _ in range(8):
        run.run(1500)
        budget.append(run.budget().total)
    after = run.beads()
    assert after.mass.sum() == pytest.approx(before.mass.sum())
    assert after.mass.sum() == pytest.approx(27 * ODD.mass + 9 * SOFT.density * math.pi / 6 * 3e-3**3)
    assert np.array_equal(after.grain, before.grain)
    spheres = after.position[after.grain < 27].reshape(27, 3, 3)
    inside = np.linalg.norm(spheres[:, [1, 2, 2]] - spheres[:, [0, 0, 1]], axis=2)
    expected = np.array(ODD.shape.offsets)
    assert inside == pytest.approx(
        np.tile(np.linalg.norm(expected[[1, 2, 2]] - expected[[0, 0, 1]], axis=1), (27, 1)), rel=1e-12
    )
    assert np.all(np.diff(budget) < 1e-3 * budget[0])
    assert run.budget().kinetic < 0.02 * budget[0]
    assert run.largest_overlap < 0.1
    assert after.position[:, 2].min() > 0.9e-3


def test_one_thread_and_two_give_the_same_bits(monkeypatch):
    serial = heap()
    serial.run(1500)
    expected = serial.grains()
    monkeypatch.setattr(engine, "BEADS_PER_THREAD", 1)
    parallel = heap(threads=2)
    parallel.run(1500)
    assert same_bits(parallel.grains(), expected)


def test_growing_the_tables_does_not_change_the_bits():
    plenty = heap()
    plenty.run(1500)
    expected = plenty.grains()
    small = heap(pair_capacity=100)
    small.run(1500)
    assert same_bits(small.grains(), expected)


@pytest.mark.parametrize("rolling", ["type A", pytest.param("type C", marks=pytest.mark.slow)])
def test_the_state_holds_all_that_later_steps_depend_on(rolling):
    run = heap(open_domain=True, rolling=rolling)
    run.add([[0.005, 0, 0.19], [-0.005, 0, 0.19]], [[0, 0, 2.0], [0, 0, 1.0]])  # these leave, one after the other
    states, contacts = [], []
    for steps in (0, 437, 5000):
        run.run(steps)
        states.append((run.state(), run.steps))
        contacts.append(run.contacts)
    run.run(1000)
    end, last = run.grains(), (run.steps, run.gone, run.added, run.largest_overlap)
    assert max(contacts) > 5
    assert run.gone == 2
    for state, steps in states:
        heap(seed=8, rolling=rolling).run(300)  # leaves its bodies in the same memory
        again = heap(open_domain=True, rolling=rolling, seed=9)
        again.restore(state)
        again.run(last[0] - steps)
        assert same_bits(again.grains(), end)
        assert (again.steps, again.gone, again.added, again.largest_overlap) == last


def test_a_clump_leaves_an_open_domain_as_a_whole_when_its_centre_does():
    run = bed([DUMBBELL], shapes=(), gravity=(0, 0, 0), open_domain=True)
    run.add([[0.0455, 0, 0], [0, 0, 0], [0, 0.01, 0]], [[0.2, 0, 0], [0, 0, 0], [0, 0, 0]])
    while run.beads().position[:, 0].max() < 0.0505:
        run.run(50)
    assert run.grains().ident.tolist() == [0, 1, 2]
    run.run(6000)
    assert run.grains().ident.tolist() == [1, 2]
    assert run.beads().grain.tolist() == [1, 1, 2, 2]
    assert run.gone == 1
    run.add([[0, -0.01, 0]])
    run.run(10)
    assert run.grains().ident.tolist() == [1, 2, 3]


def test_a_clump_that_leaves_a_closed_domain_is_named():
    run = bed([DUMBBELL], shapes=(), gravity=(0, 0, 0))
    run.add([[0, 0, 0], [0.0455, 0, 0]], [[0, 0, 0], [2.0, 0, 0]])
    with pytest.raises(SimulationFailed, match="bead 1 at"):
        run.run(10_000)


def test_clumps_that_overlap_at_the_start_are_refused_and_their_own_spheres_are_not():
    run = bed([DUMBBELL], shapes=())
    run.add([[0, 0, 0.05], [0.01, 0, 0.05]])
    with pytest.raises(BadInput, match="beads 1 and 2 overlap"):
        run.add([[0.013, 0, 0.05]])
    with pytest.raises(BadInput, match="quaternion"):
        run.add([[0.03, 0, 0.05]], turn=[0, 0, 0, 0])


@pytest.mark.parametrize("kind", [Particle("ball", SOFT, 6e-3), ODD])
def test_a_scaled_particle_behaves_as_a_kind_of_that_size(kind):
    small = Particle("half", SOFT, 3e-3)
    if kind.shape is not None:
        half = [tuple(0.5 * x for x in place) for place in kind.shape.offsets]
        gyration = tuple(0.25 * k for k in kind.shape.gyration)
        radii = tuple(0.5 * r for r in kind.shape.radii)
        small = clumped("half", SOFT, Clump(tuple(half), radii, kind.shape.volume / 8, gyration))
    found = []
    for particle, scale in ((kind, np.array([0.5, 0.5])), (small, None)):
        run = bed([particle], time_step=0.3 * small.rayleigh_time_step)
        run.add([[0, 0, 0.003], [0.0005, 0, 0.0085]], [[0.1, 0, -0.5]], [[0, 100, 0]], scale=scale)
        run.run(2000)
        found.append(run.grains())
    assert found[0].mass == pytest.approx(small.mass)
    assert found[0].position == pytest.approx(found[1].position, abs=1e-9)
    assert found[0].spin == pytest.approx(found[1].spin, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("scale", [0.0, 1.5, 0.1])
def test_an_impossible_size_is_refused(scale):
    with pytest.raises(BadInput, match="scale"):
        bed([CUBE]).add([[0, 0, 0.05]], scale=np.array([scale]))


@pytest.mark.parametrize("suffix", [".gsd", ".vtkhdf"])
def test_a_trajectory_says_which_spheres_are_one_clump(suffix, tmp_path):
    run = bed([DUMBBELL])
    run.add([[0, 0, 0.01], [0.01, 0, 0.01]])
    film = trajectory.begin(tmp_path / f"film{suffix}", run.kinds, run.domain)
    film.add(run.beads(), 0.0, 0)
    film.close()
    if suffix == ".gsd":
        with gsd.hoomd.open(film.path, mode="r") as read:
            assert read[0].particles.body.tolist() == [0, 0, 1, 1]
            assert read[0].particles.mass.sum() == pytest.approx(2 * DUMBBELL.mass)
    else:
        with h5py.File(film.path) as read:
            assert read["VTKHDF/PointData/grain"][:].tolist() == [0, 0, 1, 1]
