"""Effects in the engine, against closed forms and separate integrations."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.sim.effects import Effect, Parameter, named
from rigtwin.sim.effects.nameless_terms import form
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.contact import damping_ratio
from rigtwin.sim.engine.effect_terms import active
from rigtwin.sim.engine.few.few_body import Body, run
from rigtwin.sim.engine.walls.shapes import Motion, Plane, Wall

G = 9.81
FOAM = Material("foam", 28, 5e6, 0.1)
BALL = Particle("EPS12", FOAM, 12e-3)
BALL_DENSITY = BALL.mass / (math.pi / 6 * BALL.diameter**3)
RUBBER = Material("soft", 1000, 1e6, 0.3)
SOFT = Particle("soft", RUBBER, 4e-3)
PLATE = Material("plate", 7800, 210e9, 0.3)
FLOOR = Plane((0, 0, 0), (0, 0, 1))
WEIGHTLESS = (0.0, 0.0, 0.0)


def steady_lift(vx, vy, gap, radius, mass, force):
    return 0.0 * vx, force + 0.0 * vy


OWN = Effect(
    name="steady_lift", title="steady lift", kind="physical", rigs=("drop",),
    parameters=(Parameter("force", "N", 0.0, 1.0, 1e-4),), equation="F = c", source="", force=steady_lift,
)  # fmt: skip

# one set of effects for all tests, so that there is one compilation; unused ones are switched off by their value
NEUTRAL = {
    "air_drag": "drag_coefficient", "air_drag_schiller_naumann": "multiplier", "buoyancy": "multiplier",
    "pivot_viscous": "damping", "pivot_friction": "moment", "restitution_viscoelastic": "share",
    "restitution_plastic": "exponent", "cohesion_sjkr": "energy_density", "adhesion_jkr": "work",
    "steady_lift": "force", "plate_compliance": "strength",
}  # fmt: skip


def only(name: str, value: float | None = None):
    """The effect together with others of zero strength."""
    strengths = {effect: {NEUTRAL[effect]: 0.0} for effect in NEUTRAL}
    strengths[name] = {} if value is None else {NEUTRAL[name]: value}
    return [active(OWN if effect == OWN.name else effect, **given) for effect, given in strengths.items()]


def reynolds_drag(speed: float) -> float:
    """Schiller and Naumann's drag on BALL in air [N], written with the drag coefficient."""
    reynolds = 1.2 * speed * BALL.diameter / 1.81e-5
    # Newton's plateau beyond Re = 1000 (Clift, Grace & Weber 1978)
    coefficient = max(24 / reynolds * (1 + 0.15 * reynolds**0.687), 0.44)
    return 0.5 * 1.2 * coefficient * math.pi * BALL.radius**2 * speed**2


def test_a_bead_in_quadratic_drag_follows_the_closed_form():
    terminal = math.sqrt(2 * BALL.mass * G / (1.2 * 0.5 * math.pi * BALL.radius**2))
    times = np.linspace(0.05, 1.5, 30)
    motion = run([Body(BALL, (0, 0, 10))], times, effects=only("air_drag", 0.5))
    fallen = terminal**2 / G * np.log(np.cosh(G * times / terminal))
    assert 10 - motion.position[:, 0, 2] == pytest.approx(fallen, rel=1e-6)
    assert -motion.velocity[-1, 0, 2] == pytest.approx(terminal * math.tanh(G * 1.5 / terminal), rel=1e-6)


def test_a_thrown_bead_in_schiller_and_naumanns_drag_follows_the_integrated_path():
    start = (1.2, 0.9, 2.0)

    def motion(_t, s):
        speed = np.linalg.norm(s[3:])
        return [*s[3:], *(np.array([0, 0, -G]) - reynolds_drag(speed) / BALL.mass / speed * s[3:])]

    times = np.linspace(0.05, 0.8, 16)
    exact = solve_ivp(motion, (0, 0.8), [0, 0, 5, *start], t_eval=times, rtol=1e-10, atol=1e-12).y[:3].T
    found = run([Body(BALL, (0, 0, 5), velocity=start)], times, effects=only("air_drag_schiller_naumann"))
    assert found.position[:, 0] == pytest.approx(exact, abs=2e-7)


def test_buoyancy_and_added_mass_lower_gravity():
    motion = run([Body(BALL, (0, 0, 10))], np.array([1.0]), effects=only("buoyancy"))
    share = 1.2 / BALL_DENSITY
    assert -motion.velocity[0, 0, 2] == pytest.approx(G * (1 - share) / (1 + share / 2), rel=1e-9)


def test_a_viscous_pivot_damps_a_small_swing_exponentially():
    length, damping = 0.25, 4e-7
    angle = math.radians(2)
    start = (length * math.sin(angle), 0, 1 - length * math.cos(angle))
    times = np.linspace(0.01, 4, 400)
    motion = run([Body(BALL, start, pivot=(0, 0, 1))], times, effects=only("pivot_viscous", damping))
    rate = damping / (BALL.mass * length**2)
    omega = math.sqrt(G / length - rate**2 / 4)
    swing = np.exp(-rate * times / 2) * (np.cos(omega * times) + rate / (2 * omega) * np.sin(omega * times))
    assert motion.position[:, 0, 0] / start[0] == pytest.approx(swing, abs=2e-3)


def test_dry_pivot_friction_takes_the_same_angle_from_every_swing():
    length, moment = 0.25, 2e-7
    start = (length * math.sin(0.1), 0, 1 - length * math.cos(0.1))
    times = np.linspace(1e-3, 3.2, 3200)
    motion = run([Body(BALL, start, pivot=(0, 0, 1))], times, effects=only("pivot_friction", moment))
    angle = np.abs(np.arctan2(motion.position[:, 0, 0], 1 - motion.position[:, 0, 2]))
    peaks = [angle[k] for k in range(1, len(angle) - 1) if angle[k] > angle[k - 1] and angle[k] >= angle[k + 1]]
    assert np.diff(peaks) == pytest.approx(-2 * moment / (BALL.mass * G * length), rel=0.02)


@pytest.mark.parametrize(("effect", "law"), [
    (only("restitution_viscoelastic", 0.8), lambda v: 1 - 0.4 * (0.2 + 0.8 * v**0.2)),
    (only("restitution_plastic", 0.25), lambda v: min(1.0, 0.6 * v**-0.25)),
    # the assumed plate's inelasticity is that of a bead of 1000 kg/m^3
    (only("plate_compliance", 20.0), lambda v: 0.6 * math.exp(-1.72 * 20 * 0.005 * 0.57**0.6 * v**0.2)),
])  # fmt: skip
@pytest.mark.parametrize("speed", [0.2, 0.8, 3.0])
def test_an_effects_restitution_is_reproduced_at_its_impact_speed(effect, law, speed):
    wall = Wall(FLOOR, PLATE, Contact(0.6))
    bead = Particle("D6", Material("ash", 570, 11e9, 0.44), 6e-3)
    body = Body(bead, (0, 0, bead.radius + 1e-5), velocity=(0, 0, -speed))
    motion = run([body], np.array([1e-5 / speed + 4e-4]), walls=[wall], gravity=WEIGHTLESS, effects=effect)
    assert motion.velocity[0, 0, 2] / speed == pytest.approx(law(speed), rel=5e-3)


def test_two_beads_rebound_with_the_restitution_of_their_speed():
    bodies = [Body(SOFT, (0, 0, 0), velocity=(2.0, 0, 0)), Body(SOFT, (SOFT.diameter + 1e-5, 0, 0))]
    motion = run(
        bodies, np.array([5e-3]), contacts=Contact(0.7), gravity=WEIGHTLESS, effects=only("restitution_plastic", 0.2)
    )
    a, b = motion.velocity[0, :, 0]
    assert (b - a) / 2.0 == pytest.approx(0.7 * 2.0**-0.2, rel=5e-3)
    assert a + b == pytest.approx(2.0, rel=1e-12)


def pulled_off(effects, force: float, overlap: float) -> bool:
    """Whether a force `pull` [N] separates a soft bead from the floor, from an `overlap` [m]."""
    wall = Wall(FLOOR, RUBBER, Contact(0.2))
    body = Body(SOFT, (0, 0, SOFT.radius - overlap))
    gravity = (0.0, 0.0, force / SOFT.mass)
    motion = run([body], np.array([0.06]), walls=[wall], gravity=gravity, effects=effects, step=4e-6)
    return bool(motion.position[0, 0, 2] > 1.05 * SOFT.radius)


def test_the_pull_off_force_of_jkr_is_three_halves_pi_w_r():
    work = 0.1
    limit = 1.5 * math.pi * work * SOFT.radius
    assert not pulled_off(only("adhesion_jkr", work), 0.9 * limit, 1e-7)
    assert pulled_off(only("adhesion_jkr", work), 1.02 * limit, 1e-7)


def test_jkr_force_and_neck_are_those_of_the_parametric_form():
    effect = active("adhesion_jkr").effect
    radius, modulus, work = 2e-3, 5e5, 0.1
    snap = (math.pi * work * radius**2 / (8 * modulus)) ** (1 / 3)
    a = np.linspace(1.001 * snap, 20 * snap, 200)
    overlap = a**2 / radius - np.sqrt(2 * math.pi * work * a / modulus)
    force = 4 / 3 * modulus * a**3 / radius - np.sqrt(8 * math.pi * work * modulus * a**3)
    hertz = 4 / 3 * modulus * np.sqrt(radius) * np.maximum(overlap, 0) ** 1.5
    assert hertz - effect.attraction(overlap, radius, modulus, work) == pytest.approx(force, rel=1e-6, abs=1e-9)
    assert force.min() == pytest.approx(-1.5 * math.pi * work * radius, rel=1e-3)
    assert -overlap.min() == pytest.approx(effect.neck(radius, modulus, work), rel=1e-4)


def test_the_pull_off_force_of_sjkr_is_that_of_its_closed_form():
    density = 4e3
    modulus = 1 / (2 * (1 - 0.3**2) / 1e6)
    root = math.pi * density * math.sqrt(SOFT.radius) / modulus  # of the overlap at the largest pull
    limit = 2 / 3 * math.pi * density * SOFT.radius * root**2
    assert not pulled_off(only("cohesion_sjkr", density), 0.9 * limit, 1.4 * root**2)
    assert pulled_off(only("cohesion_sjkr", density), 1.05 * limit, 1.4 * root**2)


def test_a_users_own_force_acts():
    motion = run([Body(BALL, (0, 0, 10))], np.array([0.5]), effects=only("steady_lift", 1e-4))
    assert motion.velocity[0, 0, 2] == pytest.approx(0.5 * (1e-4 / BALL.mass - G), rel=1e-9)


def test_a_force_with_a_fixed_direction_deflects_a_vertical_fall_in_that_direction():
    """A constant force along x and one across the velocity, against SciPy; also for a bead thrown along y."""
    push, turn = 0.5, 0.3

    def fall(_, state):
        _, _, vx, vz = state
        return vx, vz, push - turn * vz, turn * vx - G

    wanted = solve_ivp(fall, (0, 0.5), (0, 10, 0, 0), rtol=1e-10, atol=1e-12).y[:, -1]
    effects = [active(form("form:constant_sideways"), c=push), active(form("form:v_cross"), c=turn)]
    bodies = [Body(BALL, (0, 0, 10)), Body(BALL, (0, 5, 10), (0, 1, 0))]
    motion = run(bodies, np.array([0.5]), effects=effects)
    for body, y in ((0, 0.0), (1, 5.5)):
        assert motion.position[0, body] == pytest.approx((wanted[0], y, wanted[1]), rel=1e-5)
        assert motion.velocity[0, body] == pytest.approx((wanted[2], float(body), wanted[3]), rel=1e-5, abs=1e-9)


def test_a_torque_with_a_fixed_direction_makes_a_bob_at_rest_swing():
    length, push = 0.2, 3.0

    def swing(_, state):
        return state[1], push - G / length * math.sin(state[0])

    times = np.array([0.2, 0.5, 0.8])  # there, and on the way back
    wanted = solve_ivp(swing, (0, 0.8), (0, 0), t_eval=times, rtol=1e-10, atol=1e-12).y[0]
    motion = run(
        [Body(BALL, (0, 0, 1 - length), pivot=(0, 0, 1))], times, effects=[active(form("form:constant"), c=push)]
    )
    found = np.arctan2(motion.position[:, 0, 0], 1 - motion.position[:, 0, 2])
    assert found == pytest.approx(wanted, rel=1e-4, abs=1e-6)


def a_third(vx, vy, gap, radius, mass):
    return 0.0 * vx, mass * G / 3 + 0.0 * vy


def four_lifts(vx, vy, gap, radius, mass, a, b, c, d):
    return 0.0 * vx, a + 10 * b + 100 * c + 1000 * d + 0.0 * vy


def three_pulls(overlap, radius, modulus, a, b, c):
    return a + b + c + 0.0 * overlap


def with_parameters(count: int, **hooks):
    """A user's own effect with this number of parameters."""
    parameters = tuple(Parameter("abcd"[k], "N", 0.0, 1.0, 1e-4) for k in range(count))
    return Effect(
        name=f"own_{count}", title="own", kind="physical", rigs=("drop",), parameters=parameters, equation="",
        source="", **hooks,
    )  # fmt: skip


def test_an_effect_may_have_any_number_of_parameters_and_all_are_used():
    pull = 0.4 * (2 * BALL.mass * G / 3 - 1e-4)  # of the remaining weight: two of three do not carry it
    effects = [
        active(with_parameters(0, force=a_third)),
        active(with_parameters(4, force=four_lifts), a=1e-5, b=2e-6, c=3e-7, d=4e-8),
        active(with_parameters(3, attraction=three_pulls), a=pull, b=pull, c=pull),
    ]
    times, contact = np.array([0.5]), Contact(0.5)
    falling = run([Body(BALL, (0, 0, 10))], times, effects=effects)
    assert falling.velocity[0, 0, 2] == pytest.approx(0.5 * (1e-4 / BALL.mass - G * 2 / 3), rel=1e-9)
    ceiling = Wall(Plane((0, 0, BALL.radius), (0, 0, -1)), PLATE, contact)
    hanging = run([Body(BALL, (0, 0, 1e-6 * BALL.radius))], times, walls=[ceiling], effects=effects)
    assert abs(hanging.position[0, 0, 2]) < 1e-5


def test_a_hook_that_does_not_take_the_parameters_of_its_effect_is_refused():
    with pytest.raises(BadInput, match="its force takes 9 numbers and must take 7"):
        run([Body(BALL, (0, 0, 1))], np.array([0.1]), effects=[active(with_parameters(2, force=four_lifts))])


def test_no_effect_leaves_the_bits_as_they_were_and_a_zero_effect_the_path():
    wall = Wall(FLOOR, PLATE, Contact(0.6, 0.3))
    body = Body(BALL, (0, 0, 0.05), velocity=(0.1, 0, 0), spin=(0, 10, 0))
    times = np.linspace(0.01, 0.3, 30)
    plain = run([body], times, walls=[wall])
    again = run([body], times, walls=[wall], effects=[])
    still = run([body], times, walls=[wall], effects=only("air_drag", 0.0))
    assert np.array_equal(plain.position, again.position)
    assert still.position == pytest.approx(plain.position, abs=1e-12)


def test_an_effect_of_the_camera_or_outside_its_range_is_refused():
    with pytest.raises(BadInput, match="outside"):
        active("air_drag", drag_coefficient=50.0)
    with pytest.raises(BadInput, match="no parameter"):
        active("air_drag", cd=0.4)
    with pytest.raises(BadInput, match="camera"):
        run([Body(BALL, (0, 0, 1))], np.array([0.1]), effects=[active("camera_roll")])


def test_damping_in_the_step_is_that_of_the_pair_law():
    from rigtwin.sim.engine.backend import ti
    from rigtwin.sim.engine.effect_terms import damping_ratio_in_step

    found = ti.field(ti.f64, 4)
    wanted = [0.05, 0.13, 0.6, 0.99]

    @ti.kernel
    def fill():
        for k in ti.static(range(4)):
            found[k] = damping_ratio_in_step(ti.static(wanted[k]))

    fill()
    assert found.to_numpy() == pytest.approx([damping_ratio(e) for e in wanted], rel=1e-9)


# ---------------------------------------------------------------------------------------- the same in the bulk engine


def bulk(particle, effects, walls=(), gravity=(0.0, 0.0, -G), time_step=1e-5, restitution=0.6):
    return Bulk(
        [particle], Contact(restitution), walls, low=(-1, -1, -1), high=(1, 1, 20), time_step=time_step,
        gravity=gravity, effects=effects,
    )  # fmt: skip


def test_a_later_simulation_does_not_change_the_strength_of_an_earlier_ones_effects():
    ends = []
    for later in (False, True):
        bed = bulk(BALL, only("air_drag", 1.0))
        bed.add(np.array([[0.0, 0.0, 5.0]]), np.array([[3.0, 0.0, 0.0]]))
        if later:
            Bulk(
                [BALL], Contact(0.6), low=(-1, -1, -1), high=(1, 1, 20), time_step=1e-5, effects=only("air_drag", 0.1),
                capacity=2000,
            )  # fmt: skip
        bed.run(2000)
        ends.append(bed.beads().velocity)
    assert np.array_equal(*ends)


def test_a_bead_in_the_bulk_falls_in_drag_like_one_alone():
    bed = bulk(BALL, only("air_drag_schiller_naumann"), time_step=2e-5)
    bed.add(np.array([[0.0, 0.0, 5.0]]), np.array([[0.5, 0.0, 0.0]]))
    bed.run(20_000)
    body = Body(BALL, (0, 0, 5), velocity=(0.5, 0, 0))
    alone = run([body], np.array([0.4]), effects=only("air_drag_schiller_naumann"))
    assert bed.beads().position[0] == pytest.approx(alone.position[0, 0], abs=1e-5)
    assert bed.beads().velocity[0] == pytest.approx(alone.velocity[0, 0], abs=1e-4)


@pytest.mark.parametrize("speed", [0.3, 2.0])
def test_restitution_in_the_bulk_is_that_of_the_speed_at_walls_and_between_beads(speed):
    effects = only("restitution_viscoelastic", 0.8)
    wanted = 1 - 0.4 * (0.2 + 0.8 * speed**0.2)
    bed = bulk(SOFT, effects, [Wall(FLOOR, PLATE, Contact(0.6))], WEIGHTLESS, 1e-6)
    gap = 1e-5
    far = 0.5
    bed.add(np.array([[0, 0, SOFT.radius + gap], [far, 0, far], [far + SOFT.diameter + gap, 0, far]]),
            np.array([[0, 0, -speed], [speed, 0, 0], [0, 0, 0]]))  # fmt: skip
    bed.run(8000)
    velocity = bed.beads().velocity
    assert velocity[0, 2] / speed == pytest.approx(wanted, rel=0.01)
    assert (velocity[2, 0] - velocity[1, 0]) / speed == pytest.approx(wanted, rel=0.01)


def after_sticking(speed: float, work: float, radius: float, mass: float, modulus: float) -> float:
    """Rebound speed [m/s] of an elastic impact with adhesion (Thornton and Ning 1998, eq. 57)."""
    energy = 7.09 * (work**5 * radius**4 / modulus**2) ** (1 / 3)
    return math.sqrt(speed**2 - 2 * energy / mass)


def test_pull_off_costs_the_energy_of_jkr_in_both_engines_at_walls_and_between_beads():
    work, speed, gap = 0.1, 0.05, 1e-6
    effects = only("adhesion_jkr", work)
    floor = [Wall(FLOOR, RUBBER, Contact(1.0))]
    modulus = 1 / (2 * (1 - 0.3**2) / 1e6)
    at_wall = after_sticking(speed, work, SOFT.radius, SOFT.mass, modulus)
    of_pair = after_sticking(speed, work, SOFT.radius / 2, SOFT.mass / 2, modulus)
    far = 0.5
    place = np.array([[0, 0, SOFT.radius + gap], [far, 0, far], [far + SOFT.diameter + gap, 0, far]])
    velocity = np.array([[0, 0, -speed], [speed, 0, 0], [0, 0, 0]])
    bodies = [Body(SOFT, tuple(x), velocity=tuple(v)) for x, v in zip(place, velocity, strict=True)]
    alone = run(
        bodies, np.array([0.02]), walls=floor, contacts={(1, 2): Contact(1.0)}, gravity=WEIGHTLESS, effects=effects
    ).velocity[0]
    bed = bulk(SOFT, effects, floor, WEIGHTLESS, 1e-6, restitution=1.0)
    bed.add(place, velocity)
    bed.run(20_000)
    for found in (alone, bed.beads().velocity):
        assert found[0, 2] == pytest.approx(at_wall, rel=0.01)
        assert found[2, 0] - found[1, 0] == pytest.approx(of_pair, rel=0.01)


def test_the_work_of_drag_on_a_falling_bead_is_in_the_energy_balance():
    # over some hundred lists, each of which passes the work on to the next
    terminal = math.sqrt(2 * BALL.mass * G / (1.2 * 0.5 * math.pi * BALL.radius**2))
    bed = bulk(BALL, only("air_drag", 0.5), time_step=2e-5)
    bed.add(np.array([[0.0, 0.0, 5.0]]))
    bed.run(1)
    begun = bed.budget()
    bed.run(25_000)
    books = bed.budget()
    time = bed.time
    fallen = terminal**2 / G * math.log(math.cosh(G * time / terminal))
    lost = BALL.mass * (G * fallen - 0.5 * (terminal * math.tanh(G * time / terminal)) ** 2)
    assert books.in_flight == pytest.approx(-lost, rel=1e-4)
    assert books.total - begun.total == pytest.approx(books.in_flight - begun.in_flight, rel=1e-4)


def test_the_work_of_buoyancy_is_that_of_the_displaced_air():
    bed = bulk(BALL, only("steady_lift", 2e-4), time_step=2e-5)
    bed.add(np.array([[0.0, 0.0, 5.0]]))
    bed.run(10_000)
    risen = bed.beads().position[0, 2] - 5.0
    assert bed.budget().in_flight == pytest.approx(2e-4 * risen, rel=1e-3)


@pytest.mark.parametrize(("effect", "value"), [("cohesion_sjkr", 1e4), ("adhesion_jkr", 0.1)])
def test_the_budget_closes_while_elastic_beads_attract_each_other(effect, value):
    speed, gap, far = 0.05, 1e-6, 0.5
    floor = [Wall(FLOOR, RUBBER, Contact(1.0))]
    bed = bulk(SOFT, only(effect, value), floor, WEIGHTLESS, 1e-6, restitution=1.0)
    place = np.array([[0, 0, SOFT.radius + gap], [far, 0, far], [far + SOFT.diameter + gap, 0, far]])
    bed.add(place, np.array([[0, 0, -speed], [speed, 0, 0], [0, 0, 0]]))
    begun = bed.budget().total
    books = []
    while bed.steps < 20_000 and not (books and books[-1].contacts + books[-1].wall_contacts == 0):
        bed.run(100)
        books.append(bed.budget())
    pulling = [b for b in books if b.contacts == 1 and b.wall_contacts == 1]
    assert len(pulling) > 5
    assert min(b.adhesive for b in pulling) < -0.05 * begun
    assert [b.total for b in pulling] == pytest.approx([begun] * len(pulling), rel=5e-3)


def test_the_work_of_a_moving_wall_through_a_neck_is_in_the_energy_balance():
    # a sinking floor stretches the neck without breaking it; its work is the gain in the energy balance
    floor = Wall(FLOOR, RUBBER, Contact(1.0), Motion(velocity=(0, 0, -2e-3)))
    bed = bulk(SOFT, only("adhesion_jkr", 0.1), [floor], WEIGHTLESS, 1e-6, restitution=1.0)
    bed.add(np.array([[0, 0, SOFT.radius - 1e-9]]))
    bed.run(1)
    begun, apart, books = bed.budget(), [], []
    for _ in range(100):
        bed.run(50)
        apart.append(bed.beads().position[0, 2] - SOFT.radius + 2e-3 * bed.time)
        books.append(bed.budget())
    assert sum(gap > 0 for gap in apart) > 5
    assert books[-1].wall_contacts == 1
    work = np.array([b.work - begun.work for b in books])
    assert np.ptp(work) > 1e-12
    assert [b.total - begun.total for b in books] == pytest.approx(work, abs=0.01 * np.ptp(work))


def test_contacts_broken_in_the_last_move_are_not_in_the_energy_balance():
    # so fast that a single step separates bead and floor, and the two beads, beyond the neck
    speed, floor = 200.0, [Wall(FLOOR, RUBBER, Contact(1.0))]
    bed = bulk(SOFT, only("adhesion_jkr", 0.1), floor, WEIGHTLESS, 1e-6, restitution=1.0)
    place = np.array([[0, 0, SOFT.radius - 1e-6], [0.5, 0, 0.5], [0.5 + SOFT.diameter - 1e-6, 0, 0.5]])
    bed.add(place, np.array([[0, 0, speed], [0, 0, 0], [speed, 0, 0]]))
    bed.run(1)
    assert bed.contacts == 1  # forces were computed before the move
    books = bed.budget()
    assert (books.contacts, books.wall_contacts, books.adhesive) == (0, 0, 0.0)


def test_a_slow_bead_stays_stuck():
    effects = only("adhesion_jkr", 0.1)
    bed = bulk(SOFT, effects, [Wall(FLOOR, RUBBER, Contact(0.5))], WEIGHTLESS, 2e-6)
    bed.add(np.array([[0, 0, SOFT.radius + 1e-6]]), np.array([[0, 0, -0.01]]))
    bed.run(50_000)
    assert abs(bed.beads().position[0, 2] - SOFT.radius) < 1e-5


def test_a_formula_found_in_residuals_acts_in_the_engine_as_the_equivalent_effect():
    # a drag of k v|v| per mass falls as the closed form says; the others are compiled too and switched off
    k = 0.3
    effects = [active("form:v|v|", c=-k), active("form:near_20mm", c=0.0), active("form:e~bump", c=0.0)]
    effects += [active("form:band", c=0.0, low=0.1, high=0.2), active("form:decay_sideways", c=0.0, reach=0.04)]
    times = np.linspace(0.05, 0.8, 10)
    motion = run([Body(BALL, (0, 0, 10))], times, effects=effects)
    fallen = np.log(np.cosh(math.sqrt(k * G) * times)) / k
    assert 10 - motion.position[:, 0, 2] == pytest.approx(fallen, rel=1e-6)


@pytest.mark.parametrize(("name", "says"), [("form:place", "no simulation implements"), ("form:wish", "no formula")])
def test_a_formula_that_no_simulation_implements_is_refused(name, says):
    with pytest.raises(BadInput, match=says):
        active(name)


def test_an_unknown_effect_is_refused_with_the_one_that_was_meant_or_one_of_each_family():
    with pytest.raises(BadInput, match=r"no effect 'air_drga'; did you mean 'air_drag'\?"):
        named("air_drga")
    with pytest.raises(BadInput, match=r"known are .*\bperspective\b") as refused:
        named("nosuch")
    assert len(str(refused.value)) < 800
