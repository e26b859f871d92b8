"""Diagnosis: its reduced models against closed forms, and the library of effects that enter them."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from rigtwin.compare.diagnose.data import tracked_lab as labs
from rigtwin.compare.diagnose.diagnosis import _closed
from rigtwin.compare.diagnose.fitting.fit import fit
from rigtwin.compare.diagnose.models.double_pendulum import MOST_IMPACTS, DoubleBench, _Contacts
from rigtwin.compare.diagnose.models.pendulum import pushing, true_lengths
from rigtwin.compare.diagnose.models.rows import coefficients
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.compare.diagnose.selection.complexity_penalty import SECOND, feigned
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track
from rigtwin.sim.effects import Effect, Parameter, library, named, own_effect
from rigtwin.sim.effects.nameless_terms import beside, nameless
from rigtwin.sim.effects.validate import check, one_sided
from rigtwin.sim.reduced import flight, swing, swing_and_collide, track

G = 9.81


# ------------------------------------------------------------------------------------------------ reduced models


def test_a_flight_without_air_is_a_parabola():
    one = np.ones((1, 1, 1))
    path = flight.fly(0.2 * one, 3.0 * one, 0 * one, 0 * one, one, radius=one, mass=one, gravity=G, terms=(), values={})
    assert path.duration.item() == pytest.approx(2 * 3.0 / G, rel=1e-9)
    assert path.land_x.item() == pytest.approx(0.2 * 6.0 / G, rel=1e-9)
    assert path.land_vy.item() == pytest.approx(-3.0, rel=1e-9)


@pytest.mark.parametrize(
    ("effect", "grows", "law"),
    [
        ("side_attraction_near", {"nearness": 20.0}, lambda x: 1 / (1 - 20 * x) ** 2),
        ("side_attraction_decay", {"growth": 40.0}, lambda x: math.exp(40 * x)),
    ],
)
def test_a_pull_that_grows_sideways_moves_a_bead_as_its_equation_says(effect, grows, law):
    """A bead that is thrown up beside a body at x = 50 mm; it starts 5 mm towards it."""
    one = np.ones((1, 1, 1))
    mass, pull, start, duration = 1e-4, 4e-5, 0.005, 2 * 1.2 / G  # a twentieth of its weight at x = 0
    values = {"force": pull, "size_exponent": 0.0, **grows}
    path = flight.fly(
        0 * one, 1.2 * one, 0 * one, 0 * one, one, radius=3e-3 * one, mass=mass * one, gravity=G,
        terms=(named(effect),), values={f"{effect}.{name}": np.array([value]) for name, value in values.items()},
        across=start * one,
    )  # fmt: skip
    exact = solve_ivp(lambda _t, s: (s[1], pull / mass * law(s[0])), (0, duration), (start, 0.0), rtol=1e-9, atol=1e-12)
    assert path.duration.item() == pytest.approx(duration, rel=1e-6)
    assert path.land_x.item() == pytest.approx(exact.y[0, -1] - start, rel=1e-3)
    assert exact.y[0, -1] - start > 1.3 * pull / mass * duration**2 / 2  # much further than with a constant pull


def test_friction_of_a_single_elastic_contact_falls_with_the_cube_root_of_the_load():
    law = named("contact_adhesion_load").onset
    assert law(0.3, 10.0, 0.08, 1 / 3) == pytest.approx(0.3 / 2, rel=1e-6)  # eight times the 0.01 N of `mu`
    assert law(0.3, 10.0, 0.01, 1 / 3) == pytest.approx(0.3, rel=1e-6)


def test_a_wrong_ruler_changes_long_lengths_more_than_short_ones():
    stated = np.array([0.25, 0.4])
    values = {"length_error.offset": np.array([1e-3]), "length_error_ratio.relative": np.array([0.02])}
    assert true_lengths(stated, values) == pytest.approx(np.array([[0.256, 0.409]]))


def test_a_long_fall_ends_at_the_terminal_speed_of_its_drag():
    one = np.ones((1, 1, 1))
    radius, mass = 0.006, 2.5e-5
    drag = named("air_drag")
    path = flight.fly(
        0 * one, 0 * one, 12.0 * one, 0 * one, one,
        radius=radius * one, mass=mass * one, gravity=G, terms=(drag,),
        values={"air_drag.drag_coefficient": np.array([0.44])},
    )  # fmt: skip
    terminal = math.sqrt(mass * G / (0.5 * 1.2 * 0.44 * math.pi * radius**2))
    assert -path.land_vy.item() == pytest.approx(terminal, rel=1e-3)


@pytest.mark.parametrize(
    ("diameter", "viscosity", "density", "height", "up"),
    [
        (1e-3, 1.0, 1150, 0.08, 0.0), (5.5e-3, 0.33, 1150, 0.08, 0.0), (3.3e-3, 0.33, 1150, 0.0, 0.3),
        (3.3e-3, 0.05, 1150, 0.08, 0.0), (3.3e-3, 1e-3, 1150, 0.08, 0.0), (6e-3, 1e-3, 970, 0.08, 0.0),
        (6e-3, 1e-3, 970, 0.0, 0.3), (6e-3, 1e-3, 7800, 0.0, 0.8), (0.8e-3, 1e-3, 2500, 1.0, 0.0),
        (2e-3, 1e-3, 1200, 2.0, 0.0), (0.5e-3, 1e-3, 4000, 1.0, 0.0),
    ],
)  # fmt: skip
def test_a_bead_that_sinks_in_a_liquid_moves_as_its_equation_of_motion_says(diameter, viscosity, density, height, up):
    """Drag limits the steps in oil and over long falls, the apparent gravity those of a nearly neutral bead."""
    liquid = 960.0
    radius, mass = diameter / 2, density * math.pi / 6 * diameter**3
    displaced = liquid * math.pi / 6 * diameter**3

    def motion(_time, state):
        reynolds = liquid * abs(state[1]) * diameter / viscosity
        slow = 1 + 0.15 * reynolds**0.687
        drag = 6 * math.pi * viscosity * radius * state[1] * max(slow, 0.44 / 24 * reynolds)
        return [state[1], ((displaced - mass) * G - drag) / (mass + displaced / 2)]

    def landed(_time, state):
        return state[0]

    landed.terminal, landed.direction = True, -1
    exact = solve_ivp(motion, (0, 1e3), [height, up], events=landed, rtol=1e-9, atol=1e-12, method="LSODA")
    one = np.ones((1, 1, 1))
    values = {"density": liquid, "log_viscosity": math.log10(1e3 * viscosity), "excess_drag": 0.0}
    path = flight.fly(
        0 * one, up * one, height * one, 0 * one, one,
        radius=radius * one, mass=mass * one, gravity=G, terms=(named("fluid"),),
        values={f"fluid.{name}": np.array([value]) for name, value in values.items()},
    )  # fmt: skip
    assert path.duration.item() == pytest.approx(exact.t[-1], rel=1e-3)
    assert path.land_vy.item() == pytest.approx(exact.y[1, -1], rel=1e-3)
    times = np.linspace(0, exact.t[-1], 50)
    _, y, _, _ = flight.where(path, 0 * one, 0 * one, height * one, times[None], np.zeros(50, dtype=int))
    exact = solve_ivp(motion, (0, times[-1]), [height, up], t_eval=times, rtol=1e-9, atol=1e-12, method="LSODA")
    assert y[0] == pytest.approx(exact.y[0], abs=1e-3 * exact.y[0].max())


def test_a_bead_that_rises_in_a_liquid_disturbs_no_bead_that_sinks():
    one = np.ones((1, 1, 1))
    radius, both = 1.65e-3, np.array([1150.0, 900.0]).reshape(1, 2, 1)
    values = {
        f"fluid.{name}": np.array([v])
        for name, v in zip(("density", "log_viscosity", "excess_drag"), (960.0, 2.5, 0.0), strict=True)
    }

    def fall(density):
        rest = 0 * density
        return flight.fly(
            rest, rest, rest + 0.08, rest, rest + 1, radius=rest + radius, mass=density * 4 / 3 * math.pi * radius**3,
            gravity=G, terms=(named("fluid"),), values=values,
        )  # fmt: skip

    together, alone = fall(both), fall(1150.0 * one)
    assert together.duration[0, 0, 0] == pytest.approx(alone.duration.item(), rel=1e-6)
    assert np.abs(together.duration).max() < 60


def test_a_rebound_of_a_millisecond_cuts_off_no_long_fall_in_a_liquid():
    def fly(up, height):
        rest = np.zeros((1, 1, len(up)))
        return flight.fly(
            rest, rest + up, rest + height, rest, rest + 1, radius=rest + 3.6e-3,
            mass=rest + 1400 * 4 / 3 * math.pi * 3.6e-3**3, gravity=G, terms=(named("fluid"),),
            values={
                f"fluid.{name}": np.array([v])
                for name, v in {"density": 930.0, "log_viscosity": 2.3, "excess_drag": 0.0}.items()
            },
        )  # fmt: skip

    together, alone = fly([0.0, 1e-3], [0.12, 0.0]), fly([0.0], [0.12])
    assert together.duration[0, 0, 0] == pytest.approx(alone.duration.item(), rel=1e-6)


@pytest.mark.parametrize(("up", "height"), [(0.3, 0.0), (2.0, 0.0), (0.0, 0.05), (0.0, 1.0)])
def test_a_charged_bead_keeps_its_energy_however_steep_the_pull_of_its_image_is(up, height):
    one, charge = np.ones((1, 1, 1)), 1e-9
    radius, mass = 0.003, 2e-4
    path = flight.fly(
        0 * one, up * one, height * one, 0 * one, one,
        radius=radius * one, mass=mass * one, gravity=G, terms=(named("electrostatic"),),
        values={"electrostatic.charge": np.array([charge])},
    )  # fmt: skip
    image = charge**2 / (16 * math.pi * 8.8541878128e-12)
    landing = up**2 + 2 * G * height + 2 * image / mass * (1 / radius - 1 / (radius + height))
    assert path.land_vy.item() ** 2 == pytest.approx(landing, abs=0.01 * 2 * image / mass / radius)


def test_a_pendulum_swings_slower_at_large_angles_as_the_elliptic_integral_says():
    from scipy.special import ellipk

    angle = np.array([[1.0]])
    push, omega = pushing(np.array([[0.25]]), np.array([1e-3]), np.array([3e-3]), G, {}, ())
    swings = swing.half_swings(angle, push, omega, np.array([[2.0]]))
    half = 2 * math.sqrt(0.25 / G) * ellipk(math.sin(0.5) ** 2)
    assert np.diff(swings.begin[:, 0, 0]) == pytest.approx(half, rel=2e-5)


def test_a_trial_motion_that_becomes_nan_ends_with_the_others_and_leaves_them_alone():

    def swung(*lengths):
        push, omega = pushing(np.array([lengths]).T, np.array([1e-3]), np.array([3e-3]), G, {}, ())
        return swing.half_swings(np.ones_like(omega), push, omega, np.full_like(omega, 2.0))

    with np.errstate(invalid="ignore"):
        both = swung(0.25, -0.1)
    alone = swung(0.25)
    assert np.isnan(both.begin[-1, 1, 0])
    assert both.begin[:, 0].tolist() == alone.begin[:, 0].tolist()


def test_dry_friction_takes_the_same_angle_from_every_swing():
    moment, length, mass = 2e-6, 0.25, 2e-4
    values = {"pivot_friction.moment": np.array([moment])}
    push, omega = pushing(
        np.array([[length]]), np.array([mass]), np.array([3e-3]), G, values, (named("pivot_friction"),)
    )
    swings = swing.half_swings(np.array([[0.05]]), push, omega, np.array([[3.0]]))
    loss = -np.diff(np.abs(swings.angle[:, 0, 0, 0]))
    assert loss == pytest.approx(2 * moment / (mass * G * length), rel=2e-3)


@pytest.mark.parametrize("strain", [0.003, 0.03])  # of the hanging thread
def test_an_elastic_thread_swings_as_its_angular_momentum_says(strain):
    length, mass = 0.2, 1e-3
    compliance, times = strain / (mass * G), np.linspace(0.0, 3.0, 60)

    def reach(angle, momentum):
        r = length
        for _ in range(60):
            rate = momentum / r**2
            r = length * (1 + compliance * mass * (G * (math.cos(angle) - 1) + length * rate**2))
        return r

    def motion(_t, s):
        r = reach(*s)
        return s[1] / r**2, -G * r * math.sin(s[0])

    exact = solve_ivp(motion, (0, 3.0), (1.0, 0.0), t_eval=times, rtol=1e-9, atol=1e-12).y[0]
    values, terms = {"thread_stretch.compliance": np.array([compliance])}, (named("thread_stretch"),)
    push, omega = pushing(np.array([[length]]), np.array([mass]), np.array([3e-3]), G, values, terms)
    swings = swing.half_swings(np.array([[1.0]]), push, omega, np.array([[3.0]]))
    angle, _ = swing.angle_at(swings, times[None], np.zeros(len(times), dtype=int))
    assert angle[0] == pytest.approx(exact, abs=3e-5)


@pytest.mark.parametrize("power", [1 / 3, 1.0])
def test_a_creeping_thread_swings_as_its_angular_momentum_says(power):
    length, strain = 0.2, 0.01  # after 1 s
    times = np.linspace(0.1, 5.0, 60)

    def motion(time, state):
        reach = length * (1 + strain * time**power)
        return state[1] / reach**2, -G * reach * math.sin(state[0])

    exact = solve_ivp(motion, (0, 5.0), (1.0, 0.0), t_eval=times, rtol=1e-10, atol=1e-12).y[0]
    term = named("thread_creep_power")
    values = {f"{term.name}.strain": np.array([strain]), f"{term.name}.time_exponent": np.array([power])}
    push, omega = pushing(np.array([[length]]), np.array([1e-3]), np.array([3e-3]), G, values, (term,))
    swings = swing.half_swings(np.array([[1.0]]), push, omega, np.array([[5.0]]), driven=True)
    angle, _ = swing.angle_at(swings, times[None], np.zeros(len(times), dtype=int))
    assert angle[0] == pytest.approx(exact, abs=2e-4)


@pytest.mark.parametrize("power", [2 / 3, 1.0, 1.2])
def test_a_bearing_whose_moment_is_a_power_of_the_rate_damps_as_its_equation_says(power):
    length, mass, moment = 0.3, 2e-4, 2e-6  # the moment [N m] at 1 rad/s
    times = np.linspace(0.1, 10.0, 60)

    def motion(_time, state):
        against = moment * math.copysign(abs(state[1]) ** power, state[1])
        return state[1], -G / length * math.sin(state[0]) - against / (mass * length**2)

    exact = solve_ivp(motion, (0, 10.0), (0.8, 0.0), t_eval=times, rtol=1e-10, atol=1e-12).y[0]
    term = named("pivot_viscous_power")
    values = {f"{term.name}.damping": np.array([moment]), f"{term.name}.rate_exponent": np.array([power - 1])}
    push, omega = pushing(np.array([[length]]), np.array([mass]), np.array([3e-3]), G, values, (term,))
    swings = swing.half_swings(np.array([[0.8]]), push, omega, np.array([[10.0]]), dry=False)
    angle, _ = swing.angle_at(swings, times[None], np.zeros(len(times), dtype=int))
    assert np.abs(exact[-10:]).max() < 0.7  # a good part of the swing is lost
    assert angle[0] == pytest.approx(exact, abs=5e-5)


@pytest.mark.parametrize("power", [0.2, 0.5, 1.0])
def test_rolling_friction_that_grows_with_a_power_of_the_speed_slows_as_its_equation_says(power):
    """A sphere slows by 5/7 of gravity times its rolling friction, which is `mu` + 0.02 v^`power`."""
    mu, slope, speed = 0.004, 0.02, 0.8
    term = named("rolling_speed_power")

    def slowing(v):
        return 5 / 7 * G * term.rolling(mu, v, 3e-3, slope, power - 1)

    # dt = dv / slowing, integrated by SciPy with the law written out
    lasts, _ = quad(lambda v: 1 / (5 / 7 * G * (mu + slope * v**power)), 0.1, speed)
    one = np.ones((1, 1))
    motion = track.ride(0 * one, speed * one, lambda s, v, t: -slowing(v), 2 * lasts * one)
    assert track.place_at(motion, np.array([[lasts]]), np.array([0]))[1].item() == pytest.approx(0.1, rel=1e-4)


def hung_free(start: float, moment: float, times: np.ndarray):
    """Angles [rad] of a free bob with dry friction, integrated in steps and from turn to turn."""
    length, mass, far = np.array([[0.25]]), np.array([2e-4]), np.array([[3.0]])
    values = {"pivot_friction.moment": np.array([moment])}
    push, omega = pushing(length, mass, np.array([3e-3]), G, values, (named("pivot_friction"),))
    exact = swing.half_swings(np.array([[start]]), push, omega, far)

    def nothing_near(a, b, u, v):
        return 1.0 + 0 * a, 0 * a

    def never(a, b, u, v, count, resting):
        raise AssertionError("nothing is near that could be struck")

    begin = np.array([[start]]), np.array([[0.0]])
    stepped = swing_and_collide.swing_and_hit(
        begin, (push, push), 2 * math.pi / omega, far, nothing_near, never, 1, dry=True
    )
    owner = np.zeros(len(times), dtype=int)
    return swing_and_collide.angles_at(stepped, times[None], owner, owner)[0][0], swing.angle_at(
        exact, times[None], owner
    )[0][0]


def test_dry_friction_of_a_pendulum_that_strikes_turns_where_the_bob_turns_not_at_the_step():
    stepped, exact = hung_free(0.7, 4e-6, np.linspace(0.0, 3.0, 200))
    # a micrometre of the path; with the friction's sign taken at the step it is a hundred
    assert 0.25 * stepped == pytest.approx(0.25 * exact, abs=2e-6)


def test_dry_friction_of_a_pendulum_that_strikes_holds_the_bob_where_it_comes_to_rest():
    zone = 4e-6 / (2e-4 * G * 0.25)  # [rad], where friction bears the weight; a turn takes two of it
    stepped, _ = hung_free(0.03, 4e-6, np.linspace(2.0, 3.0, 50))
    assert zone > 0.03 - 4 * zone > -zone
    assert stepped == pytest.approx(0.03 - 4 * zone, abs=1e-5)
    assert np.ptp(stepped) == 0


def test_a_setting_without_a_period_changes_no_other_of_its_stack():
    def push(a, _w):
        return -40.0 * np.sin(a)

    def moved(periods):
        period = np.array(periods)[:, None]
        start = np.full(period.shape, 0.5), np.zeros(period.shape)
        stepped = swing_and_collide.swing_and_hit(
            start, (push, push), period, np.ones(period.shape), lambda a, _b, u, _v: (1.0 + 0 * a, 0 * u), None, 1
        )
        since = np.tile(np.linspace(0.0, 1.0, 30), (len(period), 1))
        return swing_and_collide.angles_at(stepped, since, np.zeros(30, dtype=int), np.zeros(30, dtype=int))[0]

    for impossible in (math.nan, math.inf, 1e15):
        with np.errstate(all="ignore"):
            assert np.array_equal(moved([0.99, impossible, 0.99])[[0, 2]], moved([0.99, 0.99, 0.99])[[0, 2]])


def test_slow_contacts_of_two_beads_are_found_wherever_in_a_step_they_fall():
    e = np.linspace(0.40, 0.50, 101)[:, None]
    one, radius, length = np.ones_like(e), 2.5e-3, 0.25
    local = np.concatenate([0 * e, -1.05 * one, 0 * e, e, e, e], axis=1)[:, None]
    bench = SimpleNamespace(wall=False, radius=radius, impacts=3, active=np.ones((1, 3), dtype=bool))
    contacts = _Contacts(
        bench, local, [length * one, length * one], lambda speed: e[..., None] + 0 * speed, 0.0, (0 * e, 0 * e)
    )
    push, omega = pushing(length * one, np.array([5e-4]), np.array([radius]), G, {}, ())
    motion = swing_and_collide.swing_and_hit(
        (-1.05 * one, 0 * e), (push, push), 2 * math.pi / omega, 1.8 * one, contacts.gap, contacts.hit, 3
    )
    x = 2 * radius + length * (np.sin(motion.angle_end[1]) - np.sin(motion.angle_end[0]))
    y = length * (np.cos(motion.angle_end[0]) - np.cos(motion.angle_end[1]))
    assert (np.hypot(x, y) > 2 * radius - 1e-9).all()
    assert (x > 0).all()
    assert (motion.speeds < 1.0).sum() >= 2 * len(e)


@pytest.mark.parametrize(("longer", "e", "apart"), [(0.0, 0.0, 1e-5), (-2e-4, 0.5, 5e-4), (2e-4, 0.5, 5e-4)])
def test_beads_that_do_not_rebound_swing_on_together(longer, e, apart):
    """An impact without restitution leaves both half the speed; from then on they swing as one bob.

    Threads that differ by `longer` [m] press the beads against each other, or part them a little; then there are slow
    impacts with the restitution `e`.
    """
    one, radius, length, start, until = np.ones((1, 1)), 2.5e-3, 0.25, 0.3, 6.0
    local = np.array([[[0.0, -start, 0.0, 0.0, e, e]]])
    bench = SimpleNamespace(wall=False, radius=radius, impacts=3, active=np.ones((1, 3), dtype=bool))
    threads = [length * one, (length + longer) * one]
    contacts = _Contacts(bench, local, threads, lambda speed: e + 0 * speed, 0.0, (0 * one, 0 * one))
    (push, omega), (other, _) = [pushing(thread, np.array([5e-4]), np.array([radius]), G, {}, ()) for thread in threads]
    motion = swing_and_collide.swing_and_hit(
        (-start * one, 0 * one), (push, other), 2 * math.pi / omega, until * one, contacts.gap, contacts.hit, 3
    )

    def swings(_time, state):
        return state[1], -G / length * math.sin(state[0])

    def hangs(_time, state):
        return state[0]

    hangs.terminal = True
    fall = solve_ivp(swings, (0, until), (-start, 0.0), events=hangs, rtol=1e-10, atol=1e-12)
    times = np.linspace(fall.t[-1] + 0.01, until, 200)
    after = solve_ivp(swings, (fall.t[-1], until), (0.0, fall.y[1, -1] / 2), t_eval=times, rtol=1e-10, atol=1e-12)
    owner = np.zeros(len(times), dtype=int)
    for body in (0, 1):
        angle = swing_and_collide.angles_at(motion, times[None], owner, owner + body)[0][0]
        assert length * angle == pytest.approx(length * after.y[0], abs=apart)


@pytest.mark.parametrize(("leaning", "e"), [(0.1, 0.0), (2.0, 0.0), (5.0, 0.0), (1.0, 0.6)])
def test_a_bob_comes_to_rest_at_a_wall_that_leans_across_its_thread(leaning, e):
    """The wall holds the bob off the vertical by `leaning` [deg], so its weight presses it on."""
    one, length, until = np.ones((1, 1)), 0.25, 8.0
    local = np.array([[[0.0, 0.4, 0.0, e, e, e]]])
    bench = SimpleNamespace(wall=True, radius=2.5e-3, impacts=3, active=np.ones((1, 3), dtype=bool))
    stands = math.radians(leaning) * one
    contacts = _Contacts(bench, local, [length * one], lambda speed: e + 0 * speed, stands, (0 * one, 0 * one))
    push, omega = pushing(length * one, np.array([5e-4]), np.array([2.5e-3]), G, {}, ())
    motion = swing_and_collide.swing_and_hit(
        (0.4 * one, 0 * one), (push, lambda a, w: 0 * a), 2 * math.pi / omega, until * one, contacts.gap,
        contacts.hit, 3,
    )  # fmt: skip
    gap = length * np.sin(motion.angle_end[0][:, 0, 0] - math.radians(leaning))
    assert motion.begin[-1, 0, 0] + motion.length[-1, 0, 0] >= until
    step = 2 * math.pi / omega.item() / swing_and_collide.PER_PERIOD
    assert gap.min() > -1.1 * G * math.sin(math.radians(leaning)) * step**2 / 2 - 1e-6  # in the first step of rest
    assert gap[-20:] == pytest.approx(0.0, abs=2e-6)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3])
def test_residuals_of_the_first_effect_gain_less_than_the_price_of_a_freed_calibration_quantity(share):
    """Data on a line with noise 1 determine the roll to `share` of its stated uncertainty; residuals resemble it."""
    stated, left = 0.01, 400.0
    column = np.ones(100) / (share * stated) / math.sqrt(100)
    leftover = math.sqrt(left) * column / np.linalg.norm(column)
    held, *_ = np.linalg.lstsq(np.append(column, 1 / stated)[:, None], np.append(leftover, 0.0), rcond=None)
    gained = np.sum((leftover - column * held) ** 2) + (held[0] / stated) ** 2
    fewer = SimpleNamespace(fitted=SimpleNamespace(unknowns=[Unknown("camera_roll.angle", 0.0, 1e-3, sd=stated)]))
    more = SimpleNamespace(fitted=SimpleNamespace(std=lambda name: share * stated))
    price = feigned(fewer, more, [named("camera_roll")], left)
    assert gained + SECOND < price + 1e-9
    assert price < 1.1 * (math.sqrt(gained) + math.sqrt(SECOND)) ** 2
    assert feigned(fewer, more, [named("camera_roll"), named("air_drag")], left) == math.inf


@pytest.mark.parametrize(
    ("before", "common", "every", "noise", "closed"),
    [
        (101.0, 1.1, 1.1, 1.0, 0.99), (101.0, 1.1, 51.0, 1.0, 0.99), (101.0, 51.0, 1.1, 1.0, 0.5),
        (101.0, 1.0, 1.5, 1.5, 1.0), (0.0, 0.0, 51.0, 1.0, 0.5),
    ],
)  # fmt: skip
def test_a_gap_is_closed_where_it_is_closed_in_common_to_the_repetitions(before, common, every, noise, closed):
    naming = SimpleNamespace(
        location=SimpleNamespace(statistic=before), after=SimpleNamespace(statistic=common),
        base=SimpleNamespace(per_row=101.0), best=SimpleNamespace(fitted=SimpleNamespace(per_row=every)),
    )  # fmt: skip
    assert _closed(naming, noise) == pytest.approx(closed, abs=0.01)


def test_a_sphere_that_rolls_to_rest_stops_where_its_friction_says():
    deceleration = 5 / 7 * G * 0.05
    one = np.ones((1, 1))
    motion = track.ride(0 * one, 0.5 * one, lambda s, v, t: -deceleration * np.ones_like(v), 5 * one)
    place, speed = track.place_at(motion, np.array([[0.1, 4.0]]), np.array([0, 0]))
    assert place[0, 1] == pytest.approx(0.5**2 / (2 * deceleration), rel=1e-9)
    assert place[0, 0] == pytest.approx(0.5 * 0.1 - deceleration * 0.005, rel=1e-9)
    assert speed[0, 1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("friction", "drag"), [(0.1, 1.0), (0.1, 10.0), (0.01, 4.0), (0.4, 0.1)])
def test_a_sphere_that_a_drag_slows_stops_where_and_when_its_equation_says(friction, drag):
    """v' = -a - c v.  A drag many times the friction slows it at first: the stop is long after v/v' of the start."""
    speed, one = 0.7, np.ones((1, 1))
    motion = track.ride(0 * one, speed * one, lambda s, v, t: -friction - drag * v, 60 * one)
    lasts = math.log(1 + drag * speed / friction) / drag
    assert motion.end.item() == pytest.approx(lasts, rel=1e-4)
    assert motion.place[-1].item() == pytest.approx((speed - friction * lasts) / drag, abs=1e-6)


# ------------------------------------------------------------------------------------------------------- effects


def test_every_effect_says_what_it_is_and_how_it_enters():
    for effect in library():
        assert effect.title
        assert effect.equation
        assert effect.source
        assert effect.synonyms
        assert effect.splits
        assert set(effect.rigs) <= set(labs.TRACKED)
        hooks = (effect.force, effect.torque, effect.restitution, effect.rolling, effect.sliding, effect.onset)
        contact = (effect.attraction, effect.neck, effect.mutual, effect.sideways)
        assert any((*hooks, *contact, effect.exposure, effect.view)) or effect.geometry
        for parameter in effect.parameters:
            # an exponent or a reach does not measure the strength, and every liquid has some density
            assert parameter.low <= 0.0 <= parameter.high or parameter.assumed or effect.slow
            assert parameter.low < parameter.typical < parameter.high


def bounced(speed, radius, density, thickness):
    """Restitution of an elastic sphere of wood on a wide, free plate of steel: Zener's equation, integrated."""
    wood, steel, plate_density = 11e9 / (1 - 0.44**2), 200e9 / (1 - 0.3**2), 7800.0
    mass = density * 4 / 3 * math.pi * radius**3
    spring = 4 / 3 / (1 / wood + 1 / steel) * math.sqrt(radius)
    # a force on a wide plate moves it at this speed per newton, and is not given back
    yields = 1 / (8 * math.sqrt(steel * thickness**3 / 12 * plate_density * thickness))

    def motion(_t, s):
        force = spring * max(s[0], 0.0) ** 1.5  # s[0]: the overlap, s[1]: the speed of the sphere, downwards
        return [s[1] - yields * force, -force / mass]

    def parts(_t, s):
        return s[0]

    parts.terminal, parts.direction = True, -1
    last = 6 * (mass / spring) ** 0.4 * speed**-0.2  # [s], about twice the contact
    run = solve_ivp(motion, (0, last), [1e-12, speed], events=parts, rtol=1e-9, atol=1e-14)
    return -run.y[1, -1] / speed


def test_the_loss_to_a_thin_plate_is_that_of_zeners_equation():
    effect = named("plate_compliance")
    wood = {"density_kg_m3": 570, "youngs_modulus_Pa": 11e9, "poissons_ratio": 0.44}
    steel = {"density_kg_m3": 7800, "youngs_modulus_Pa": 200e9, "poissons_ratio": 0.3}
    for radius, density, thickness, speed in (
        (3e-3, 1000.0, 0.010, 4.0), (6e-3, 1000.0, 0.012, 0.3), (3e-3, 7800.0, 0.010, 2.0), (2e-3, 500.0, 0.004, 3.0)
    ):  # fmt: skip
        mass = density * 4 / 3 * math.pi * radius**3
        plate = effect.parameters[1].stated(wood, {**steel, "thickness_m": thickness})
        found = effect.restitution(1.0, speed, radius, mass, 1.0, plate)
        assert math.log(found) == pytest.approx(math.log(bounced(speed, radius, density, thickness)), rel=0.04)


def test_the_stated_properties_of_a_plate_are_not_fitted_and_are_assumed_where_not_stated():
    effect, values = named("plate_compliance"), {"strength": 0.5, "plate": 0.005}
    known = {f"plate_compliance.{name}": np.array([value]) for name, value in values.items()}
    wood, glass = ({"youngs_modulus_Pa": modulus, "poissons_ratio": 0.3} for modulus in (11e9, 70e9))
    bead = labs.Bead("wood", 6e-3, 1e-4, wood)
    conditions = [labs.Condition(wall, bead, wall, {}, ()) for wall in ("thin", "thick")]
    walls = {name: {**glass, "density_kg_m3": 2600, "thickness_m": h} for name, h in (("thin", 4e-3), ("thick", 8e-3))}
    thick = effect.parameters[1].stated(wood, walls["thick"])
    for stated, plates in (
        (walls, [4 * thick, thick]),
        ({"thin": walls["thin"]}, [4 * thick, 0.005]),
        ({}, [0.005, 0.005]),
    ):
        lab = labs.TrackedLab("", "drop", G, labs.Camera(240.0, 1e-4), {}, tuple(conditions), Path(), {"walls": stated})
        strength, found = coefficients(effect, known, lab, conditions)
        assert strength.ravel() == pytest.approx([0.5])
        assert found.ravel() == pytest.approx(plates)
        remarks = list(lab.assumed([effect]))
        assert len(remarks) == (1 if len(stated) == 1 else 0)
        assert all("wood on thick; plate = 0.005 is assumed there" in one for one in remarks)


def struck(length, release, seconds, rng):
    """A filmed bob that hits a vertical wall below its pivot with e = 0.7 v^(-0.1), and its impacts."""

    def swing(_t, s):
        return [s[1], -G / length * math.sin(s[0])]

    def at_the_wall(_t, s):
        return s[0]

    at_the_wall.terminal, at_the_wall.direction = True, -1
    time = np.arange(0, seconds, 1 / 240)
    angle, at, state, count = np.full(len(time), release), 0.05, [release, 0.0], 0
    while at < time[-1]:
        run = solve_ivp(swing, (at, seconds), state, events=at_the_wall, rtol=1e-9, atol=1e-11, dense_output=True)
        inside = (time >= at) & (time <= run.t[-1])
        angle[inside] = run.sol(time[inside])[0]
        rate, at, count = run.y[1, -1], float(run.t[-1]), count + len(run.t_events[0])
        speed = length * abs(rate)
        state = [1e-9, 0.7 * speed**-0.1 * abs(rate)]
    place = length * np.column_stack([np.sin(angle), -np.cos(angle)])
    return Track(time, place + rng.normal(0, 1e-4, place.shape), np.full(len(time), np.nan)), count


def test_impacts_without_their_own_restitution_follow_the_law_at_their_speed():
    rng = np.random.default_rng(8)
    bead = labs.Bead("b", 0.01, 5e-4)
    conditions, most = [], 0
    for length, angle, seconds in ((0.125, 15, 3.5), (0.25, 15, 2.0), (0.25, 50, 2.0)):
        drawn = [struck(length, math.radians(angle), seconds, rng) for _ in range(2)]
        most = max(most, *(count for _, count in drawn))
        settings = {"length_m": length, "release_angle_deg": angle}
        conditions.append(labs.Condition(f"{length}_{angle}", bead, "w", settings, tuple((one,) for one, _ in drawn)))
    assert most > MOST_IMPACTS
    lab = labs.TrackedLab("", "pendulum", G, labs.Camera(240.0, 1e-4), {}, tuple(conditions), Path())
    fitted = fit(DoubleBench(lab), (named("restitution_plastic"),))
    name = "restitution_plastic.exponent"
    assert fitted.value(name) == pytest.approx(0.1, abs=3 * fitted.std(name))
    assert fitted.std(name) < 0.01
    assert fitted.value("restitution.b-w") == pytest.approx(0.7, abs=0.01)


def test_schiller_naumann_is_stokes_when_slow_and_newton_when_fast():
    slow = named("air_drag_schiller_naumann").force(1e-6, 0.0, 1.0, 1e-3, 1.0, 1.0)[0]
    assert slow == pytest.approx(-6 * math.pi * 1.81e-5 * 1e-3 * 1e-6, rel=1e-2)
    fast = named("air_drag_schiller_naumann").force(1.2, 0.0, 1.0, 6e-3, 1.0, 1.0)[0]
    assert fast == pytest.approx(named("air_drag").force(1.2, 0.0, 1.0, 6e-3, 1.0, 0.44)[0], rel=0.05)
    # Re = 4000: Newton's plateau, where the fitted formula alone would say 0.27
    faster = named("air_drag_schiller_naumann").force(5.0, 0.0, 1.0, 6e-3, 1.0, 1.0)[0]
    assert faster == pytest.approx(named("air_drag").force(5.0, 0.0, 1.0, 6e-3, 1.0, 0.44)[0], rel=1e-6)


def test_the_standard_drag_curve_agrees_with_measurements():
    radius, section = 3e-3, math.pi * 9e-6
    # drag coefficients of smooth spheres (Clift, Grace & Weber 1978)
    for reynolds, coefficient in ((1, 27.1), (100, 1.09), (1000, 0.471), (1e4, 0.405), (1e5, 0.48)):
        speed = reynolds * 1.81e-5 / (1.2 * 2 * radius)
        force = named("air_drag_standard").force(speed, 0.0, 1.0, radius, 1.0, 1.0)[0]
        assert -force == pytest.approx(0.5 * 1.2 * section * speed**2 * coefficient, rel=0.04)


@pytest.mark.parametrize(("gradient", "level"), [(0.05, 0.2), (-0.3, -0.5), (-1.0, 1.0), (1.0, -1.0), (-1.0, 2.0)])
def test_a_camera_keeps_the_origin_and_shows_a_finite_picture(gradient, level):
    view = named("perspective").view
    assert view(0.0, 0.0, gradient, level) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert np.isfinite(view(0.3, np.linspace(-2.0, 2.0, 9), gradient, level)[1]).all()


def test_an_effect_of_the_user_is_a_candidate(tmp_path):
    path = tmp_path / "wind.py"
    path.write_text(
        "from rigtwin.sim.effects import Effect, Parameter\n"
        "def force(vx, vy, gap, radius, mass, a):\n    return mass * a + 0 * vx, 0 * vy\n"
        "EFFECT = Effect(name='wind', title='wind', kind='physical', rigs=('drop',),\n"
        "    parameters=(Parameter('acceleration', 'm/s^2', -5, 5, 0.1),), equation='a', source='own', force=force)\n"
    )
    wind = own_effect(path)
    assert wind.name == "wind"
    assert wind.aimed  # it acts to one side for any motion of the bead


def lifts_one_way(vx, vy, gap, radius, mass, c):
    return 0.0 * vx, mass * c * vx + 0.0 * vy


def blows_high_up(vx, vy, gap, radius, mass, c):
    return mass * c * (gap > 0.5) + 0.0 * vx, 0.0 * vy


def brakes(vx, vy, gap, radius, mass, c):
    return -c * vx, -c * vy


@pytest.mark.parametrize(("force", "aimed"), [(lifts_one_way, True), (blows_high_up, True), (brakes, False)])
def test_a_push_that_changes_in_a_mirror_has_a_preferred_side(force, aimed):
    parameters = (Parameter("c", "1", -1.0, 1.0, 0.1),)
    effect = Effect("own", "own", "physical", ("drop",), parameters, "", "", force=force)
    assert one_sided(effect) == aimed


@pytest.mark.parametrize(
    ("takes", "gives", "parameters", "message"),
    [
        ("vx, vy, gap, radius, a", "a * vx, a * vy", "(Parameter('a', '1', 0, 1, 0.1),)", "force of effect mine fails"),
        ("vx, vy, gap, radius, mass, a", "a * vx", "(Parameter('a', '1', 0, 1, 0.1),)", "two numbers"),
        ("vx, vy, gap, radius, mass, a", "a * vx / 0, vy", "(Parameter('a', '1', 0, 1, 0.1),)", "not finite"),
        ("vx, vy, gap, radius, mass", "vx, vy", "()", "no parameter"),
    ],
)
def test_an_own_effect_whose_functions_do_not_fit_is_refused(tmp_path, takes, gives, parameters, message):
    path = tmp_path / "mine.py"
    path.write_text(
        "from rigtwin.sim.effects import Effect, Parameter\n"
        f"def force({takes}):\n    return {gives}\n"
        "EFFECT = Effect(name='mine', title='mine', kind='physical', rigs=('drop',),\n"
        f"    parameters={parameters}, equation='a', source='own', force=force)\n"
    )
    with pytest.raises(BadInput, match=message) as refused:
        own_effect(path)
    assert "mine.py" in str(refused.value)


@pytest.mark.parametrize("effect", library(), ids=lambda effect: effect.name)
def test_every_effect_of_the_library_could_be_a_users_own(effect):
    check(effect, Path("library"))
    assert one_sided(effect) == effect.aimed


@pytest.mark.parametrize("rig", ["drop", "double"])
def test_formulas_know_whether_they_have_a_preferred_side(rig):
    for effect in (*nameless(rig), *beside(rig)):
        assert one_sided(effect) == effect.aimed, effect.name


@pytest.mark.parametrize("text", [None, "EFFECT = 3\n", "1/0\n"])
def test_an_own_effect_that_is_not_an_effect_is_refused(tmp_path, text):
    path = tmp_path / "bad.py"
    if text is not None:
        path.write_text(text)
    with pytest.raises(BadInput, match=r"bad\.py"):
        own_effect(path)
