"""One contact at a time, against closed forms and the published single-contact benchmarks (Chung and Ooi 2011)."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.sim.engine.contact import damping_ratio
from rigtwin.sim.engine.few.few_body import Body, Case, run, run_many_halved
from rigtwin.sim.engine.time_step import dashpot_factor
from rigtwin.sim.engine.walls.shapes import Cylinder, Disc, Plane, Wall

G = 9.81
ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
D6 = Particle("D6", ASH, 6e-3, density=569)
FLOOR = Plane((0, 0, 0), (0, 0, 1))
WEIGHTLESS = (0.0, 0.0, 0.0)


def floor(contact: Contact, material: Material = STEEL) -> list[Wall]:
    return [Wall(FLOOR, material, contact)]


def bounce(speed: float, contact: Contact, particle: Particle = D6, **more):
    """Final velocity and spin of a sphere shot at the floor, without gravity."""
    gap = 0.01 * particle.radius
    velocity = more.pop("velocity", (0.0, 0.0, -speed))
    body = Body(particle, (0, 0, particle.radius + gap), velocity=velocity, spin=more.pop("spin", (0, 0, 0)))
    end = gap / speed + 3e-2 * particle.radius / speed**0.2
    motion = run([body], np.array([end]), walls=floor(contact, more.pop("wall", STEEL)), gravity=WEIGHTLESS, **more)
    return motion.velocity[0, 0], motion.spin[0, 0]


@pytest.mark.parametrize("e", [0.1, 0.2, 0.42, 0.5, 0.75, 0.9, 1.0])
@pytest.mark.parametrize("speed", [0.05, 0.5, 5.0])
def test_rebounds_from_a_wall_have_the_given_restitution(e, speed):
    velocity, _ = bounce(speed, Contact(e))
    assert velocity[2] / speed == pytest.approx(e, rel=5e-3)


@settings(max_examples=25, deadline=None)
@given(
    e=st.floats(0.1, 1.0),
    speed=st.floats(0.05, 5.0),
    ratio=st.floats(0.3, 3.0),
    mu=st.floats(0.0, 1.0),
)
def test_collisions_of_beads_have_the_given_restitution_and_keep_momentum(e, speed, ratio, mu):
    big = Particle("big", ASH, 6e-3 * ratio, density=569)
    gap = 1e-5
    bodies = [
        Body(D6, (0, 0, 0), velocity=(speed, 0, 0)),
        Body(big, (D6.radius + big.radius + gap, 0, 0)),
    ]
    end = gap / speed + 3e-4 * max(1, ratio) / speed**0.2
    motion = run(bodies, np.array([end]), contacts=Contact(e, mu), gravity=WEIGHTLESS)
    one, two = motion.velocity[0, :, 0]
    assert (two - one) / speed == pytest.approx(e, rel=5e-3)
    assert D6.mass * one + big.mass * two == pytest.approx(D6.mass * speed, rel=1e-12)


def test_the_damping_ratio_rises_without_a_jump_as_restitution_falls():
    e = np.linspace(0.01, 1, 400)
    ratio = np.array([damping_ratio(x) for x in e])
    assert np.all(np.diff(ratio) < 0)
    assert np.abs(np.diff(ratio)[e[1:] > 0.1]).max() < 0.05


def test_free_fall_is_exact():
    time = np.linspace(1e-5, 0.2, 10_000)
    motion = run([Body(D6, (0, 0, 1.0), velocity=(0.3, 0, 0))], time)
    assert motion.position[:, 0, 2] == pytest.approx(1 - G * time**2 / 2, abs=1e-12)
    assert motion.position[:, 0, 0] == pytest.approx(0.3 * time, abs=1e-12)


@pytest.mark.parametrize(
    ("material", "force", "overlap", "duration"),
    [
        (Material("glass", 2800, 48e9, 0.20), 10697, 274.1e-6, 40.34e-6),
        (Material("limestone", 2500, 20e9, 0.25), 7108, 368.3e-6, 54.20e-6),
    ],
    ids=["glass", "limestone"],
)
def test_chung_ooi_1_two_equal_spheres_collide(material, force, overlap, duration):
    ball = Particle("ball", material, 20e-3)
    start = 0.0101
    time = np.linspace(1e-7, 80e-6, 3000)
    bodies = [Body(ball, (-start, 0, 0), velocity=(10, 0, 0)), Body(ball, (start, 0, 0), velocity=(-10, 0, 0))]
    motion = run(bodies, time, contacts=Contact(1.0, 0.35), gravity=WEIGHTLESS)
    velocity = motion.velocity[:, 0, 0]
    closest = (motion.position[:, 1, 0] - motion.position[:, 0, 0]).min()
    push = -ball.mass * np.gradient(velocity, time)
    touching = time[push > 1e-4 * force]
    assert ball.diameter - closest == pytest.approx(overlap, rel=1e-3)
    assert push.max() == pytest.approx(force, rel=1e-3)
    assert touching[-1] - touching[0] == pytest.approx(duration, rel=5e-3)


@pytest.mark.parametrize(
    ("material", "force", "overlap", "duration"),
    [
        (Material("aluminium alloy", 2699, 70e9, 0.30), 11370, 49.72e-6, 731.6e-6),
        (Material("magnesium alloy", 1800, 40e9, 0.35), 7233, 52.12e-6, 767.0e-6),
    ],
    ids=["aluminium alloy", "magnesium alloy"],
)
def test_chung_ooi_2_sphere_on_a_rigid_plane(material, force, overlap, duration):
    ball = Particle("ball", material, 0.2)
    rigid = material.softened(1000)
    time = np.linspace(1e-6, 1e-3, 3000)
    body = Body(ball, (0, 0, 0.1 + 1e-5), velocity=(0, 0, -0.2))
    motion = run([body], time, walls=floor(Contact(1.0), rigid), gravity=WEIGHTLESS)
    push = ball.mass * np.gradient(motion.velocity[:, 0, 2], time)
    touching = time[push > 1e-4 * force]
    assert ball.radius - motion.position[:, 0, 2].min() == pytest.approx(overlap, rel=2e-3)
    assert push.max() == pytest.approx(force, rel=2e-3)
    assert touching[-1] - touching[0] == pytest.approx(duration, rel=5e-3)


OXIDE = Material("aluminium oxide", 4000, 380e9, 0.23)
RIGID = Material("wall", 4000, 380e12, 0.23)
PEBBLE = Particle("pebble", OXIDE, 5e-3)


def oblique(angle: float):
    """Chung and Ooi's test 4: 3.9 m/s, e 0.98, mu 0.092; tangential restitution and final spin [rad/s]."""
    a = math.radians(angle)
    normal, along = 3.9 * math.cos(a), 3.9 * math.sin(a)
    velocity, spin = bounce(normal, Contact(0.98, 0.092), PEBBLE, velocity=(along, 0.0, -normal), wall=RIGID)
    return velocity[0] / along, spin[1]


@pytest.mark.parametrize("angle", [30, 40, 50, 60, 70, 80, 85])
def test_chung_ooi_4_a_contact_that_slides_throughout_obeys_coulomb(angle):
    restitution, spin = oblique(angle)
    a = math.radians(angle)
    assert restitution == pytest.approx(1 - 0.092 * 1.98 / math.tan(a), rel=0.01)
    assert spin == pytest.approx(2.5 * 0.092 * 1.98 * 3.9 * math.cos(a) / 2.5e-3, rel=0.01)


@pytest.mark.parametrize(("angle", "published"), [(5, 0.948), (10, 0.703), (15, 0.634), (20, 0.622), (25, 0.639)])
def test_chung_ooi_4_a_contact_that_sticks_rebounds_as_published(angle, published):
    assert oblique(angle)[0] == pytest.approx(published, abs=0.03)


def test_chung_ooi_7_equal_and_opposite_spins_turn_as_cog_wheels():
    alloy = Particle("alloy", Material("alloy", 2700, 70e9, 0.33), 0.2)
    bodies = [
        Body(alloy, (-0.1001, 0, 0), velocity=(0.2, 0, 0), spin=(0, 0, 5.0)),
        Body(alloy, (0.1001, 0, 0), velocity=(-0.2, 0, 0), spin=(0, 0, -5.0)),
    ]
    motion = run(bodies, np.array([4e-3]), contacts=Contact(0.5, 0.4), gravity=WEIGHTLESS)
    assert motion.velocity[0, :, 0] == pytest.approx([-0.1, 0.1], rel=5e-3)
    assert motion.velocity[0, :, 1] == pytest.approx([0, 0], abs=1e-12)
    assert motion.spin[0, :, 2] == pytest.approx([5, -5], rel=1e-12)


def test_an_oblique_pair_keeps_momentum_and_angular_momentum():
    big = Particle("big", ASH, 9e-3)
    bodies = [
        Body(D6, (-4e-3, 1e-3, 0), velocity=(1.0, 0.2, 0.3), spin=(30, -80, 50)),
        Body(big, (4e-3, -1e-3, 1e-3), velocity=(-1.0, 0, 0), spin=(0, 40, -20)),
    ]
    time = np.array([1e-6, 2e-3])
    motion = run(bodies, time, contacts=Contact(0.6, 0.4), gravity=WEIGHTLESS)
    masses = np.array([D6.mass, big.mass])
    inertias = 0.4 * masses * np.array([D6.radius, big.radius]) ** 2
    linear = (masses[:, None] * motion.velocity).sum(1)
    orbital = np.cross(motion.position, masses[:, None] * motion.velocity).sum(1)
    angular = orbital + (inertias[:, None] * motion.spin).sum(1)
    assert np.linalg.norm(motion.velocity[1] - motion.velocity[0]) > 0.5  # they did collide
    assert linear[1] == pytest.approx(linear[0], rel=1e-12)
    assert angular[1] == pytest.approx(angular[0], abs=1e-11 * np.linalg.norm(angular[0]))


def on_floor(contact: Contact, time, tilt=0.0, particle=D6, **more):
    """A sphere on the floor with the overlap that carries its weight; x points down the slope."""
    effective = 1 / (
        (1 - ASH.poisson_ratio**2) / ASH.youngs_modulus + (1 - STEEL.poisson_ratio**2) / STEEL.youngs_modulus
    )
    weight = particle.mass * G * math.cos(tilt)
    depth = (weight / (4 / 3 * effective * math.sqrt(particle.radius))) ** (2 / 3)
    rolling = more.pop("rolling", "type C")
    body = Body(particle, (0, 0, particle.radius - depth), **more)
    gravity = (G * math.sin(tilt), 0.0, -G * math.cos(tilt))
    return run([body], np.asarray(time), walls=floor(contact), gravity=gravity, rolling=rolling)


def test_a_sliding_sphere_slows_by_mu_g_and_ends_rolling_at_five_sevenths():
    motion = on_floor(Contact(0.5, 0.3), [0.002, 0.006, 0.03], velocity=(0.1, 0, 0))
    slowing = (motion.velocity[0, 0, 0] - motion.velocity[1, 0, 0]) / 0.004
    assert slowing == pytest.approx(0.3 * G, rel=1e-4)
    assert motion.velocity[2, 0, 0] == pytest.approx(5 / 7 * 0.1, rel=1e-4)
    assert motion.spin[2, 0, 1] * D6.radius == pytest.approx(motion.velocity[2, 0, 0], rel=1e-3)


@pytest.mark.parametrize("rolling", ["type A", "type C"])
def test_a_rolling_sphere_is_slowed_by_the_rolling_resistance_of_its_radius(rolling):
    motion = on_floor(
        Contact(0.5, 0.5, 0.06), [0.01, 0.03], velocity=(0.2, 0, 0), spin=(0, 0.2 / D6.radius, 0), rolling=rolling
    )
    slowing = (motion.velocity[0, 0, 0] - motion.velocity[1, 0, 0]) / 0.02
    assert slowing == pytest.approx(5 / 7 * 0.06 * G, rel=2e-3)


def test_a_sphere_on_a_slope_starts_to_roll_at_the_angle_whose_tangent_is_mu_r():
    mu_r = 0.06
    held = on_floor(Contact(0.5, 0.5, mu_r), [0.05], tilt=math.atan(0.95 * mu_r))
    assert abs(held.velocity[0, 0, 0]) < 1e-6
    assert held.position[0, 0, 0] < 1e-6
    free = on_floor(Contact(0.5, 0.5, mu_r), [0.05], tilt=math.atan(1.05 * mu_r))
    assert free.velocity[0, 0, 0] > 1e-4


def test_a_sphere_rolls_down_a_slope_with_the_acceleration_of_the_closed_form():
    tilt, mu_r = math.radians(10), 0.06
    motion = on_floor(Contact(0.5, 0.5, mu_r), [0.02, 0.05], tilt=tilt)
    gained = (motion.velocity[1, 0, 0] - motion.velocity[0, 0, 0]) / 0.03
    assert gained == pytest.approx(5 / 7 * G * (math.sin(tilt) - mu_r * math.cos(tilt)), rel=2e-3)


def test_two_rolling_beads_feel_the_torque_of_their_own_radius():
    # a steady load needs gravity: one heavy bead lies on another that spins in place; the torque mu_r Fn R reduces the
    # spin difference at a known rate
    mu_r, spin = 0.05, 20.0
    lower, upper = (0.0, 0.0, 3e-3), (0.0, 0.0, 9e-3)
    walls = [Wall(FLOOR, STEEL, Contact(0.5))]
    bodies = [Body(D6, lower, spin=(0, -spin, 0)), Body(D6, upper, spin=(0, spin, 0))]
    time = np.array([0.005, 0.010])
    motion = run(bodies, time, walls=walls, contacts=Contact(0.5, 0.0, mu_r))
    inertia = 0.4 * D6.mass * D6.radius**2
    expected = mu_r * D6.mass * G * D6.radius / inertia
    assert -(np.diff(motion.spin[:, 1, 1])[0]) / 0.005 == pytest.approx(expected, rel=0.02)
    assert np.diff(motion.spin[:, 0, 1])[0] / 0.005 == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    ("shape", "position", "velocity"),
    [
        (Disc((0, 0, 0), (0, 0, 1), 0.02), (0.01, 0, 3.05e-3), (0, 0, -1.0)),
        (Disc((0, 0, 0), (0, 0, 1), 0.02), (0.01, 0, -3.05e-3), (0, 0, 1.0)),
        (Disc((0, 0, 0), (0, 0, 1), 0.02), (0.02305, 0, 0), (-1.0, 0, 0)),
        (Cylinder((0, 0, 0), (0, 0, 1), 0.02, 0.1), (0.01695, 0, 0.05), (1.0, 0, 0)),
        (Cylinder((0, 0, 0), (0, 0, 1), 0.02, 0.1), (0.02305, 0, 0.05), (-1.0, 0, 0)),
        (Cylinder((0, 0, 0), (0, 0, 1), 0.02, 0.1), (0.02, 0, 0.10305), (0, 0, -1.0)),
    ],
    ids=["disc above", "disc below", "disc edge", "cylinder inside", "cylinder outside", "rim"],
)
def test_every_side_of_a_wall_reflects_along_its_normal(shape, position, velocity):
    body = Body(D6, position, velocity=velocity)
    motion = run([body], np.array([4e-4]), walls=[Wall(shape, STEEL, Contact(0.5))], gravity=WEIGHTLESS)
    assert motion.velocity[0, 0] == pytest.approx(-0.5 * np.array(velocity), abs=3e-3)


def test_halving_the_step_settles_within_the_tolerance_asked_for():
    time = np.linspace(0.01, 0.3, 30)
    body = Body(D6, (0, 0, 0.05))
    case = Case([body], time, walls=floor(Contact(0.5)))
    ((accurate, apart),) = run_many_halved([case], tolerance=1e-6)
    assert apart <= 1e-6
    finest = run([body], time, walls=floor(Contact(0.5)), step=1e-9)
    assert np.abs(accurate.position - finest.position).max() < 2e-6


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        ([Body(D6, (0, 0, math.nan))], "not a finite number"),
        ([Body(D6, (0, 0, 2e-3))], "inside a wall"),
        ([Body(D6, (0, 0, 0.1)), Body(D6, (0, 0, 0.104))], "overlap at the start"),
        ([], "1 to 16"),
    ],
)
def test_impossible_starts_are_refused_in_one_sentence(bodies, message):
    with pytest.raises(BadInput, match=message):
        run(bodies, np.array([0.1]), walls=floor(Contact(0.5)), contacts=Contact(0.5))


def test_an_unlimited_step_is_refused():
    with pytest.raises(BadInput, match="step"):
        run([Body(D6, (0, 0, 1))], np.array([0.1]), step=math.inf)
    with pytest.raises(BadInput, match="times"):
        run([Body(D6, (0, 0, 1))], np.array([0.1, 0.05]))


def test_a_run_that_breaks_down_names_the_body_and_the_time():
    with pytest.raises(RigtwinError, match=r"t = .* s \(body 0\)"):
        run([Body(D6, (0, 0, 1))], np.array([0.1, 1.0]), gravity=(0, 0, 1e9))


def test_the_step_of_a_low_restitution_is_stable_for_its_dashpot():
    """One contact under symplectic Euler steps: free vibration decays with the step, and not with a longer one."""
    for restitution in (0.05, 0.01, 0.001):
        psi = damping_ratio(restitution)
        limit = 2 * (math.sqrt(1 + psi**2) - psi)  # in units of 1 / frequency
        share = dashpot_factor(restitution)
        assert share * 2 * (math.sqrt(1 + damping_ratio(0.05) ** 2) - damping_ratio(0.05)) == (pytest.approx(limit))
        for step, ends in ((0.99 * limit, True), (1.01 * limit, False)):
            x, v = 1.0, 0.0
            for _ in range(4000):
                v -= step * (x + 2 * psi * v)
                x += step * v
                if abs(x) > 1e9:
                    break
            assert (abs(x) < 1) == ends
    assert dashpot_factor(0.05) == dashpot_factor(0.9) == 1.0
