"""Rolling resistance of type A: a constant torque against a body's own spin, which never reverses it."""

import math

import numpy as np
import pytest

from rigtwin.lab.clumps import row
from rigtwin.lab.materials import Contact, Material, Particle, clumped
from rigtwin.sim.engine.bulk import bulk as engine
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.few import few_body
from rigtwin.sim.engine.walls.shapes import Disc, Motion, Plane, Wall

G = 9.81
SOFT = Material("soft ash", 720, 11e6, 0.44)
D6 = Particle("D6", SOFT, 6e-3, density=569)
DUMBBELL = clumped("dumbbell", SOFT, row(2, 2e-3, 3e-3))
MU_R = 0.06
CONTACT = Contact(0.5, 0.5, MU_R)
UP = (0, 0, 1)
STEP = 0.3 * D6.rayleigh_time_step


def bench(*walls: Wall, particle=D6, contact=CONTACT, **more) -> Bulk:
    reach = 0.3
    settings = {"low": (-reach,) * 3, "high": (reach,) * 3, "time_step": STEP, "threads": 1, "rolling": "type A"} | more
    return Bulk([particle], contact, walls, **settings)


def floor(contact=CONTACT) -> Wall:
    return Wall(Plane((0, 0, 0), UP), SOFT, contact)


def lying(particle=D6, radius=None, carriers=1, gravity=G) -> float:
    """Height [m] of a sphere whose overlap with the floor carries its share of the particle's weight."""
    radius = particle.radius if radius is None else radius
    modulus = SOFT.youngs_modulus / (2 * (1 - SOFT.poisson_ratio**2))
    weight = particle.mass * gravity / carriers
    return radius - (weight / (4 / 3 * modulus * math.sqrt(radius))) ** (2 / 3)


def alone_or_in_bulk(engine_name, times, *, gravity, rolling="type A", **start):
    """Velocity along x and spin of a bead on the floor at `times` [s], multiples of the bulk's step."""
    pressed = -gravity[2]
    if engine_name == "few bodies":
        body = few_body.Body(D6, (0, 0, lying(gravity=pressed)), **start)
        motion = few_body.run([body], np.asarray(times), walls=[floor()], gravity=gravity, rolling=rolling)
        return motion.velocity[:, 0, 0], motion.spin[:, 0]
    bed = bench(floor(), gravity=gravity, rolling=rolling)
    bed.add([[0, 0, lying(gravity=pressed)]], **{name: [value] for name, value in start.items()})
    speeds, spins = [], []
    for time in times:
        bed.run(round(time / STEP) - bed.steps)
        speeds.append(bed.beads().velocity[0, 0])
        spins.append(bed.beads().spin[0])
    return np.array(speeds), np.array(spins)


LAWS = pytest.mark.parametrize("rolling", ["type A", "type A explicit"])
ENGINES = pytest.mark.parametrize("where", ["few bodies", "bulk"])


def slope(tilt: float) -> tuple[float, float, float]:
    return G * math.sin(tilt), 0.0, -G * math.cos(tilt)


@ENGINES
def test_a_sphere_on_a_slope_below_the_limit_stays_put(where):
    speed, spin = alone_or_in_bulk(where, [1000 * STEP, 20_000 * STEP], gravity=slope(math.atan(0.98 * MU_R)))
    assert np.array_equal(spin, np.zeros((2, 3)))
    assert abs(speed[1]) < (1e-8 if where == "few bodies" else 1e-15)  # below this few bodies count as at rest


@ENGINES
@LAWS
@pytest.mark.parametrize("tangent", [1.05 * MU_R, 0.2])
def test_a_sphere_on_a_slope_above_the_limit_rolls_as_the_closed_form_says(where, rolling, tangent):
    tilt = math.atan(tangent)
    times = np.array([2000, 6000]) * STEP
    speed, spin = alone_or_in_bulk(where, times, gravity=slope(tilt), rolling=rolling)
    # the lever of friction is shorter than the radius by the overlap
    lever = lying(gravity=G * math.cos(tilt)) / D6.radius
    expected = G * (math.sin(tilt) - MU_R / lever * math.cos(tilt)) / (1 + 0.4 / lever**2)
    assert np.diff(speed)[0] / np.diff(times)[0] == pytest.approx(expected, rel=1e-3)
    assert np.diff(spin[:, 1])[0] / np.diff(times)[0] == pytest.approx(expected / lever / D6.radius, rel=1e-3)


@ENGINES
@LAWS
def test_a_spinning_top_stops_when_the_closed_form_says_and_stays_stopped(where, rolling):
    spin = 20.0
    rate = MU_R * G / (0.4 * D6.radius)
    stop = spin / rate
    times = np.round(np.array([0.5 * stop, stop - 2 * STEP, stop + 2 * STEP, 2 * stop]) / STEP) * STEP
    _, found = alone_or_in_bulk(where, times, gravity=(0, 0, -G), spin=(0, 0, spin), rolling=rolling)
    assert found[:2, 2] == pytest.approx(spin - rate * times[:2], abs=0.01 * rate * STEP)
    assert np.array_equal(found[2:], np.zeros((2, 3)))


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_body_that_type_a_holds_creeps_under_explicit_resistance(share):
    step = share * STEP
    bed = bench(floor(), gravity=slope(math.atan(0.5 * MU_R)), rolling="type A explicit", time_step=step)
    bed.add([[0, 0, lying()]])
    bed.run(round(0.1 / step))
    pull = G * math.sin(math.atan(0.5 * MU_R))
    # no acceleration: friction carries the weight along the slope, and its torque is balanced a step later
    creeping = step * pull * D6.radius / (0.4 * D6.radius**2)
    assert bed.beads().spin[0, 1] == pytest.approx(creeping, rel=1e-2)
    assert bed.beads().velocity[0, 0] == pytest.approx(creeping * D6.radius, rel=1e-2)


@LAWS
@pytest.mark.parametrize("spin", [1e-100, 1e-156, 1e-161, 1e-300])
def test_a_spin_left_by_rounding_does_not_grow(rolling, spin):
    """Its square underflows, so that its axis cannot be computed."""
    bed = bench(floor(), particle=DUMBBELL, time_step=0.3 * DUMBBELL.rayleigh_time_step, rolling=rolling)
    bed.add([[0, 0, lying(DUMBBELL, 2e-3, carriers=2)]], spin=[[0, 0, spin]])
    bed.run(5)
    assert abs(bed.grains().spin).max() < 1e-9
    assert abs(bed.grains().velocity).max() < 1e-3


@LAWS
def test_a_dumbbell_that_spins_lying_flat_stops_when_the_closed_form_says(rolling):
    # without friction only rolling resistance acts; each sphere carries half the weight, at the same distance
    spin, r, half_length = 20.0, 2e-3, 1.5e-3
    smooth = Contact(0.5, 0.0, MU_R)
    bed = bench(
        floor(smooth), particle=DUMBBELL, contact=smooth, time_step=0.3 * DUMBBELL.rayleigh_time_step,
        rolling=rolling,
    )  # fmt: skip
    bed.add([[0, 0, lying(DUMBBELL, r, carriers=2)]], spin=[[0, 0, spin]])
    rate = MU_R * G * math.hypot(r, half_length) / DUMBBELL.shape.gyration[2]
    stop, step = spin / rate, bed.time_step
    bed.run(round(0.5 * stop / step))
    assert bed.grains().spin[0] == pytest.approx([0, 0, spin - rate * bed.time], abs=0.01 * rate * step)
    bed.run(round(0.5 * stop / step) + 2)
    assert np.abs(bed.grains().spin[0]).max() <= (0 if rolling == "type A" else 1e-15)
    assert bed.budget().kinetic < 1e-20


def test_a_dumbbell_that_spins_upright_on_a_sphere_is_braked_by_the_distance_to_its_middle():
    # the contact is on the axis: the distance from the axis would give no torque, the sphere's radius too little
    smooth = Contact(0.3, 0.0, MU_R)
    step = 0.2 * DUMBBELL.rayleigh_time_step
    bed = Bulk(
        [D6, DUMBBELL], smooth, [floor(smooth)], low=(-0.1,) * 3, high=(0.1,) * 3, time_step=step, threads=1,
        rolling="type A",
    )  # fmt: skip
    bed.add([[0, 0, D6.radius]])
    above = 2 * D6.radius + 3.5e-3
    upright = [math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0]
    bed.add([[0, 0, above]], spin=[[0, 0, 300.0]], turn=[upright], kind=1)
    seen = []
    for time in (0.02, 0.04):
        bed.run(round(time / step) - bed.steps)
        seen.append((bed.time, bed.grains().spin[1, 2]))
    (begun, fast), (ended, slow) = seen
    assert np.abs(bed.grains().position[:, :2]).max() < 1e-9
    assert (fast - slow) / (ended - begun) == pytest.approx(MU_R * G * 3.5e-3 / DUMBBELL.shape.gyration[0], rel=5e-3)


def shaken(particle=D6, count=150, **more) -> Bulk:
    width, pitch = 0.04, 6.3e-3 if particle is D6 else 7.5e-3
    normals = [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((width, 0, 0), (-1, 0, 0))]
    normals += [((0, 0, 0), (0, 1, 0)), ((0, width, 0), (0, -1, 0))]
    contact = Contact(0.6, 0.44, 0.08)
    walls = [Wall(Plane(point, normal), SOFT, contact) for point, normal in normals]
    bed = bench(*walls, particle=particle, contact=contact, time_step=0.3 * particle.rayleigh_time_step, **more)
    side = int(width / pitch)
    k = np.arange(count)
    rng = np.random.default_rng(2)
    places = (np.stack([k % side, k // side % side, k // side**2], axis=1) + 0.5) * pitch
    bed.add(places + rng.uniform(-1e-4, 1e-4, places.shape), rng.normal(0, 0.4, places.shape))
    return bed


@pytest.mark.slow
@pytest.mark.parametrize(("particle", "count"), [(D6, 150), (DUMBBELL, 60)])
def test_a_bed_at_rest_does_not_creep(particle, count):
    bed = shaken(particle, count)
    bed.run(round(2.0 / bed.time_step))
    before = bed.grains()
    bed.run(round(1.0 / bed.time_step))
    after = bed.grains()
    assert abs(after.position[:, 2].mean() - before.position[:, 2].mean()) < 1e-12
    assert np.linalg.norm(after.velocity, axis=1).max() < 1e-9
    assert np.linalg.norm(after.spin, axis=1).max() < 1e-9


@pytest.mark.parametrize(("particle", "count"), [(D6, 600), (DUMBBELL, 200)])
def test_one_thread_two_and_a_launch_per_step_give_the_same_bits(particle, count, monkeypatch):
    monkeypatch.setattr(engine, "BEADS_PER_THREAD", 1)
    found = []
    for threads, as_on_a_gpu in ((1, False), (2, False), (1, True)):
        bed = shaken(particle, count, threads=threads)
        bed._on_gpu = as_on_a_gpu
        bed.run(1500)
        found.append(bed.grains())
    assert np.abs(found[0].spin).max() > 1
    for other in found[1:]:
        assert all(np.array_equal(getattr(found[0], name), getattr(other, name)) for name in vars(other))


def test_energy_lost_in_rolling_resistance_is_not_work_of_a_turning_wall():
    # at the centre of a turntable forces do no work; the torque acts against the bead's own spin
    table = Wall(Disc((0, 0, 0), UP, 0.05), SOFT, CONTACT, Motion.turning(60, axis=UP))
    bed = bench(table)
    bed.add([[0, 0, lying()]], spin=[[0, 0, 20.0]])
    begun = bed.budget()
    bed.run(round(0.02 / STEP))
    taken = begun.kinetic - bed.budget().kinetic
    rate = MU_R * G / (0.4 * D6.radius)
    inertia = 0.4 * D6.mass * D6.radius**2
    assert taken == pytest.approx(0.5 * inertia * (20.0**2 - (20.0 - rate * bed.time) ** 2), rel=1e-3)
    assert abs(bed.work) < 1e-6 * taken


def test_a_body_stopped_up_to_rounding_rests():
    """If spin and braking differ by rounding only, the remaining spin has no valid digits; it used to be NaN."""
    from rigtwin.sim.engine.backend import start, ti
    from rigtwin.sim.engine.bulk.rigid_bodies import braked_momentum

    start(threads=1)
    most = np.random.default_rng(1).uniform(1e-11, 1e-9, 500)
    left = ti.field(ti.f64, len(most))
    values = ti.types.ndarray(ti.f64, 1)

    @ti.kernel
    def brake(size: values, most: values):
        for k in range(size.shape[0]):
            moments = ti.Vector([8.58e-10, 8.58e-10, 8.58e-10])
            left[k] = braked_momentum(ti.Vector([0.6, 0.0, 0.8]) * size[k], moments, most[k]).norm()

    for size in (0.999 * most, most, most * (1 + 2.3e-16), most * (1 + 1e-14), most * (1 + 1e-6), most * 1.01):
        brake(size, most)
        assert left.to_numpy() == pytest.approx(np.maximum(size - most, 0), rel=1e-6, abs=2e-9 * most.max())
