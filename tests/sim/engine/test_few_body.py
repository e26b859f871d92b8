"""Many few-body simulations in one launch: each gives the same result as alone, and agrees with closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput, RigtwinError, SimulationFailed
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import GRAVITY, Drop, Pendulum, Tilt
from rigtwin.sim import drop as drops
from rigtwin.sim import pendulum as pendulums
from rigtwin.sim import tilt as tilts
from rigtwin.sim.engine.effect_terms import active
from rigtwin.sim.engine.few import batch
from rigtwin.sim.engine.few.few_body import Body, Case, Motion, run, run_many, run_many_halved
from rigtwin.sim.engine.walls.shapes import Motion as Moving
from rigtwin.sim.engine.walls.shapes import Plane, Wall

ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)


def sphere(diameter=6e-3, material=ASH):
    return Particle("bead", material, diameter, density=material.density)


def floor(contact, motion=None, until=math.inf):
    return Wall(Plane((0, 0, 0), (0, 0, 1)), STEEL, contact, motion, until)


def drop(height, restitution, *, bead=None, samples=40, span=0.3, **more):
    bead = bead or sphere()
    start = Body(bead, (0, 0, height + bead.radius), spin=(3.0, 0, 0))
    return Case([start], np.linspace(span / samples, span, samples), walls=[floor(Contact(restitution))], **more)


def pendulum(angle, restitution, **more):
    bead, length = sphere(), 0.05
    r = bead.radius
    away = (-r - length * math.sin(angle), 0.0, length * (1 - math.cos(angle)))
    beads = [Body(bead, away, pivot=(-r, 0, length)), Body(bead, (r, 0, 0), pivot=(r, 0, length))]
    return Case(beads, np.linspace(0.01, 0.2, 20), contacts=Contact(restitution, 0.3), **more)


def wall_pendulum(angle, restitution):
    case = pendulum(angle, restitution)
    upright = Wall(Plane((0, 0, 0), (-1, 0, 0)), STEEL, Contact(restitution))
    return Case(case.bodies[:1], case.times, walls=[upright])


def plate(turns, **more):
    bead = sphere(12e-3)
    lies = [Body(bead, (0.1, 0, bead.radius), turns=turns)]
    contact = Contact(0.4, 0.3, 0.05)
    return Case(lies, np.array([0.1, 0.3]), walls=[floor(contact)], gravity_turns=1.0, step=2e-6, **more)


def clinging(energy_density):
    return [active("restitution_viscoelastic"), active("cohesion_sjkr", energy_density=energy_density)]


def company():
    """Cases of many kinds: with and without walls that move, with 0 to 3 walls, with effects of their own strength."""
    beads = [sphere(4e-3), sphere(12e-3, STEEL), sphere()]
    three = [Body(bead, (0.02 * k, 0, 0.02), (-0.3 * k, 0.1, -1)) for k, bead in enumerate(beads)]
    lifted = floor(Contact(0.7, 0.3, 0.05), Moving((0, 0, 0.1), start=0.01))
    side = Wall(Plane((-0.01, 0, 0), (1, 0, 0)), ASH, Contact(0.6))
    return [
        drop(0.02, 0.9),
        drop(0.05, 0.5, bead=sphere(12e-3), samples=7, span=0.05),
        Case(
            three, np.array([0.05, 0.1]), walls=[lifted, side, floor(Contact(0.5), until=0.02)], contacts=Contact(0.8)
        ),
        pendulum(0.5, 0.7),
        wall_pendulum(0.4, 0.6),
        plate(False),
        plate(True),
        Case(
            [Body(sphere(), (0, 0, 1.0), (2, 0, 0))], np.array([0.4]), effects=[active("air_drag", drag_coefficient=2)]
        ),
        Case([Body(sphere(), (0, 0, 1.0), (2, 0, 0))], np.array([0.4]), effects=[active("air_drag")]),
        drop(0.02, 0.6, effects=clinging(1e5)),
        pendulum(0.3, 0.5, effects=clinging(1e6)),
    ]


@pytest.fixture(scope="module")
def alone():
    return [run_many([case])[0] for case in company()]


def same(one, other):
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("position", "velocity", "spin", "steps")
    )


@pytest.mark.parametrize("threads", [1, 2])
def test_a_case_gives_the_same_bits_alone_and_among_others(alone, threads):
    together = run_many(company(), threads=threads)
    assert all(map(same, together, alone))
    reversed_ = run_many([*company()[::-1], *company()[3:7]], threads=threads)
    assert all(map(same, reversed_, [*alone[::-1], *alone[3:7]]))


def test_each_case_has_its_own_strength_of_an_effect():
    thick, thin = run_many(company()[7:9])
    assert thick.position[-1, 0, 2] > thin.position[-1, 0, 2] + 1e-3


def test_eight_bodies_do_not_feel_the_floor_of_another_case():
    # they fill a cache line, so that the next case follows directly in memory
    def row(height):
        beads = [Body(sphere(), (0.01 * k, 0, height)) for k in range(8)]
        return Case(
            beads, np.array([0.05, 0.1]), walls=[Wall(Plane((0, 0, height - 0.02), (0, 0, 1)), ASH, Contact(0.5))]
        )

    cases = [row(0.5), row(0.1), row(0.3)]
    assert all(same(one, run_many([case])[0]) for one, case in zip(run_many(cases), cases, strict=True))


def test_two_hundred_given_restitutions_are_reproduced_in_one_launch():
    rng = np.random.default_rng(7)
    wanted, cases = rng.uniform(0.1, 1.0, 200), []
    for e in wanted:
        speed, bead = rng.uniform(0.05, 5), sphere(rng.uniform(2e-3, 15e-3), ASH if rng.random() < 0.5 else STEEL)
        start = Body(bead, (0, 0, bead.radius + 1e-4), (0, 0, -speed))
        once = np.array([1e-4 / speed + 2e-3])
        cases.append(Case([start], once, walls=[floor(Contact(e))], gravity=(0, 0, 0)))
    found = run_many(cases)
    came = [motion.velocity[0, 0, 2] / -case.bodies[0].velocity[2] for motion, case in zip(found, cases, strict=True)]
    assert came == pytest.approx(wanted, abs=1e-3)


def test_free_falls_of_different_length_are_all_exact():
    spans = [1e-3, 0.05, 0.31]
    cases = [Case([Body(sphere(), (0, 0, 1.0))], np.linspace(span / k, span, k)) for k, span in enumerate(spans, 1)]
    for motion, case in zip(run_many(cases), cases, strict=True):
        assert np.array_equal(motion.time, case.times)
        assert motion.position[:, 0, 2] == pytest.approx(1 - GRAVITY / 2 * case.times**2, abs=1e-12)


def test_long_and_short_records_run_in_one_launch():
    times = np.linspace(1e-6, 0.02, 50_000)
    long = Case([Body(sphere(), (0, 0, 1.0)), Body(sphere(), (0, 0.1, 2.0))], times)
    short = Case([Body(sphere(), (0, 0, 1.0))], times[:100])
    both = run_many([short, long])
    assert both[1].position[:, 1, 2] == pytest.approx(2 - GRAVITY / 2 * times**2, abs=1e-12)
    assert same(both[0], run_many([short])[0])


def test_a_case_that_breaks_down_is_named_and_does_not_affect_others():
    thrown = Case([Body(sphere(), (0, 0, 1.0)), Body(sphere(), (1, 0, 1.0), (1e7, 0, 0))], np.array([0.01]))
    good = drop(0.02, 0.7)
    first, broken, last = run_many([good, thrown, good])
    assert isinstance(broken, RigtwinError)
    assert np.isfinite(first.position).all()
    assert same(first, last)
    halved = run_many_halved([good, thrown], tolerance=1e-5)
    assert [isinstance(one, RigtwinError) for one in halved] == [False, True]
    with pytest.raises(SimulationFailed, match=r"broke down at t = .* \(body 1\)") as failure:
        run(thrown.bodies, thrown.times)
    assert failure.value.exit_code == 2


def test_another_number_of_cases_needs_no_other_kernel():
    case = Case([Body(sphere(), (0, 0, 1.0))], np.array([1e-3]))
    run_many([case])
    before = batch._bench.cache_info().misses
    many = run_many([case] * 700)
    assert batch._bench.cache_info().misses == before
    assert all(same(one, many[0]) for one in many)


def test_a_break_down_does_not_affect_later_runs():
    drag = [active("air_drag")]
    good = Case([Body(sphere(), (0, 0, 1.0), (2, 0, 0))], np.array([0.1]), effects=drag)
    before = run_many([good])[0]
    assert isinstance(run_many([replace(good, bodies=[Body(sphere(), (0, 0, 1.0), (1e200, 0, 0))])])[0], RigtwinError)
    assert same(run_many([good])[0], before)


def test_an_impossible_case_is_named_by_its_index():
    sunk = Case([Body(sphere(), (0, 0, 0.0))], np.array([0.1]), walls=[floor(Contact(0.5))])
    with pytest.raises(BadInput, match=r"^cases\[2\]: body 0 starts 3 mm inside a wall"):
        run_many([drop(0.02, 0.5), drop(0.03, 0.5), sunk])
    with pytest.raises(BadInput, match=r"^threads: 0 is too few"):
        run_many([drop(0.02, 0.5)], threads=0)
    with pytest.raises(BadInput, match=r"^contacts: \(1, 0\) is no pair"):
        run_many([replace(pendulum(0.3, 0.5), contacts={(1, 0): Contact(0.5)})])
    with pytest.raises(BadInput, match=r"^cases\[1\]: None is no few_body\.Case"):
        run_many([drop(0.02, 0.5), None])
    assert run_many([]) == []


def test_halving_converges_for_each_case_as_it_does_alone():
    cases = [drop(0.02, 0.3, samples=10, span=0.1), drop(0.05, 0.9, samples=5, span=0.15), pendulum(0.4, 0.7)]
    together = run_many_halved(cases, tolerance=2e-5)
    for (motion, apart), case in zip(together, cases, strict=True):
        ((one, other),) = run_many_halved([case], tolerance=2e-5)
        assert same(motion, one)
        assert apart == other
    assert max(apart for _, apart in together) <= 2e-5


def test_progress_of_many_cases_is_their_total_time():
    calls = []
    cases = [drop(h, 0.9, span=0.1) for h in (0.01, 0.02, 0.03)]
    assert all(isinstance(one, Motion) for one in run_many(cases, progress=lambda *news: calls.append(news)))
    assert calls[-1] == ("simulating", pytest.approx(0.3), pytest.approx(0.3))


def test_many_drops_are_the_drops_one_by_one():
    bead, steel = sphere(), STEEL
    rng = np.random.default_rng(3)
    trials = [
        drops.Trial(Drop(rng.uniform(0.005, 0.02)), bead, steel, Contact(e), frame_rate=480, duration=0.06)
        for e in (0.3, 0.8)
    ]
    trials.append(replace(trials[0], effects={"air_drag": {}}))
    trials.append(replace(trials[0], duration=0.005))  # ends before the release
    for trial, track in zip(trials, drops.run_many(trials), strict=True):
        alone = drops.run(
            trial.rig, bead, steel, trial.contact, frame_rate=480, duration=trial.duration, effects=trial.effects
        )
        assert np.array_equal(track.position, alone.position)
        assert np.array_equal(track.sigma, alone.sigma)


def test_many_pendulums_are_the_pendulums_one_by_one():
    bead, contact = sphere(), Contact(0.7, 0.3)
    trials = [
        pendulums.Trial(Pendulum(0.03, 0.5), bead, contact, frame_rate=240),
        pendulums.Trial(Pendulum(0.03, 0.4, variant="wall"), bead, contact, frame_rate=240, wall=STEEL),
    ]
    both, one = pendulums.run_many(trials)
    assert [track.body for track in (*both, *one)] == ["A", "B", "A"]
    alone = pendulums.run(trials[0].rig, bead, contact, frame_rate=240)
    assert all(np.array_equal(a.position, b.position) for a, b in zip(both, alone, strict=True))


def test_each_of_many_plates_has_the_onset_of_its_friction():
    slopes = (0.05, 0.1, 0.2)
    trials = [
        tilts.Trial(Tilt("slide", speed=0.2), sphere(), STEEL, Contact(0.4, mu, 0.06), frame_rate=240) for mu in slopes
    ]
    trials.append(replace(trials[1], rig=Tilt("roll", speed=0.2)))
    onsets = []
    for angle, track in tilts.run_many(trials):
        reach = np.linalg.norm(track.position, axis=1)  # from the hinge
        onsets.append(angle.value[np.flatnonzero(reach < reach[0] - 1e-4)[0]])
    assert np.tan(onsets) == pytest.approx([*slopes, 0.06], abs=0.02)


def test_a_clump_that_breaks_down_on_its_plate_does_not_affect_others(monkeypatch):
    def breaks(*_all):
        raise SimulationFailed("The energy exploded")

    monkeypatch.setattr(tilts, "_rolled_clump", breaks)
    good = tilts.Trial(Tilt("roll"), sphere(), STEEL, Contact(0.4, 0.2, 0.06), frame_rate=240, duration=0.03)
    broken, (angle, _track) = tilts.run_many([replace(good, particle=hlosta2020.particle("P6x15_3s")), good])
    assert isinstance(broken, SimulationFailed)
    assert len(angle.value) == 8


def test_an_impossible_trial_is_named_by_its_index():
    good = drops.Trial(Drop(0.01), sphere(), STEEL, Contact(0.5), frame_rate=240, duration=0.03)
    clump = replace(good, particle=hlosta2020.particle("P6x15_3s"))
    with pytest.raises(BadInput, match=r"^trials\[1\]: drop_height"):
        drops.run_many([good, replace(good, rig=Drop(-1.0)), good])
    with pytest.raises(BadInput, match=r"^trials\[2\]: P6x15_3s is a clump"):
        drops.run_many([good, replace(good, duration=0.005), clump])
    with pytest.raises(BadInput, match=r"^drop_height"):
        drops.run_many([replace(good, rig=Drop(-1.0))])
    with pytest.raises(BadInput, match=r"^trials\[1\]: 0\.3 is no drop\.Trial"):
        drops.run_many([good, 0.3])


def test_a_run_of_minutes_reaches_its_samples_despite_the_resolution_of_its_clock():
    # from 128 s on a clock of 64 bits goes in steps of 3e-14 s
    times = np.array([128.3, 200.0, 300.1])
    fell = run([Body(sphere(), (0.0, 0.0, 0.0))], times)
    assert fell.position[:, 0, 2] == pytest.approx(-GRAVITY / 2 * times**2, rel=1e-9)
