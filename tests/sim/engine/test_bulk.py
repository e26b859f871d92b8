"""Bulk engine: physics, reproducibility to the bit, and bad input."""

import math
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput, RigtwinError, SimulationFailed
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.bulk import bulk as engine
from rigtwin.sim.engine.bulk import table_layout as at
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.bulk.thread_team import Crew
from rigtwin.sim.engine.time_step import time_step
from rigtwin.sim.engine.walls.shapes import Cylinder, Disc, Plane, Wall

G = 9.81
SOFT = Material("soft ash", 720, 11e6, 0.44)
D6 = Particle("D6", SOFT, 6e-3, density=569)
CONTACT = Contact(0.6, 0.44, 0.08)
STEP = 0.3 * D6.rayleigh_time_step


def box(width=0.04, height=0.3, contact=CONTACT, particles=(D6,), wall_contact=CONTACT, **more) -> Bulk:
    planes = [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((width, 0, 0), (-1, 0, 0))]
    planes += [((0, 0, 0), (0, 1, 0)), ((0, width, 0), (0, -1, 0))]
    more = {"time_step": STEP, "threads": 1} | more
    return Bulk(
        particles,
        contact,
        [Wall(Plane(point, normal), SOFT, wall_contact) for point, normal in planes],
        low=(-0.003, -0.003, -0.003),
        high=(width + 0.003, width + 0.003, height),
        **more,
    )


def lattice(count: int, width=0.04, seed=1, pitch=6.3e-3):
    side = int((width - 0.1e-3) / pitch)
    k = np.arange(count)
    places = np.stack([k % side, k // side % side, k // side**2], axis=1) * pitch + pitch / 2
    return places + np.random.default_rng(seed).uniform(-1e-4, 1e-4, places.shape)


def weightless(contact, particles=(D6,), fraction=0.3, walls=(), **more) -> Bulk:
    return Bulk(
        particles, contact, walls, low=(-0.1,) * 3, high=(0.1,) * 3, gravity=(0, 0, 0),
        time_step=fraction * min(p.rayleigh_time_step for p in particles), threads=1, **more,
    )  # fmt: skip


def test_free_fall_is_exact():
    bed = box()
    bed.add([[0.02, 0.02, 0.25]], [[0.1, 0, 0]])
    bed.run(1000)
    t = 1000 * STEP
    beads = bed.beads()
    assert beads.position[0] == pytest.approx([0.02 + 0.1 * t, 0.02, 0.25 - G * t**2 / 2], abs=1e-12)
    assert beads.velocity[0, 2] == pytest.approx(-G * t, rel=1e-12)


@pytest.mark.parametrize("e", [0.2, 0.5, 0.9])
def test_rebounds_have_the_given_restitution_at_a_fine_step(e):
    contact = Contact(e, 0.3)
    bed = weightless(contact, fraction=0.01, walls=[Wall(Plane((0, 0, -0.05), (0, 0, 1)), SOFT, contact)])
    bed.add([[0, 0, -0.0469], [0.03, 0, 0], [0.0361, 0, 0]], [[0, 0, -0.5], [0.5, 0, 0], [0, 0, 0]])
    bed.run(2500)
    at_wall, one, two = bed.beads().velocity
    assert at_wall[2] == pytest.approx(0.5 * e, rel=5e-3)
    assert two[0] - one[0] == pytest.approx(0.5 * e, rel=5e-3)
    assert one[0] + two[0] == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("e", [0.2, 0.42, 0.75, 1.0])
def test_the_error_of_the_usual_step_is_random_without_bias(e):
    # pairs that collide at random times within a step; a contact lasts about ten steps
    pairs = 100
    gap = np.random.default_rng(5).uniform(1e-5, 1e-4, pairs)
    k = np.arange(pairs)
    left = np.stack([np.zeros(pairs), k % 10 * 0.015 - 0.07, k // 10 * 0.015 - 0.07], axis=1)
    right = left + np.array([[1.0, 0, 0]]) * (D6.diameter + gap)[:, None]
    bed = weightless(Contact(e))
    bed.add(left, [[0.5, 0, 0]])
    bed.add(right)
    bed.run(60)
    velocity = bed.beads().velocity[:, 0]
    returned = (velocity[pairs:] - velocity[:pairs]) / 0.5
    assert returned.mean() == pytest.approx(e, rel=0.015)
    assert returned.std() < 0.08


def test_a_bead_spinning_like_a_top_comes_to_rest():
    bed = box(contact=CONTACT)
    bed.add([[0.02, 0.02, D6.radius]], spin=[[0, 0, 50.0]])
    bed.run(20_000)
    assert np.abs(bed.beads().spin).max() < 1e-3


@pytest.mark.parametrize("rolling", ["type A", "type C"])
def test_beads_scaled_down_collide_as_a_kind_of_that_size_does(rolling):
    small = Particle("D3", SOFT, 0.5 * D6.diameter, density=D6.density)
    ends = []
    for as_kind in (False, True):
        bed = weightless(CONTACT, particles=(D6, small), rolling=rolling)
        bed.add([[-0.004, 0.001, 0]], [[0.5, 0.1, 0.2]], [[30, -80, 50]])
        scale = None if as_kind else np.array([0.5, 0.5])
        bed.add([[0.001, 0, 0], [0.0043, 0, 0.0005]], [[-0.5, 0, 0]], [[0, 40, -20]], kind=int(as_kind), scale=scale)
        # a larger arena must keep the scales
        bed.add([[0.01 * k - 0.09, 0.05, 0.01 * layer] for k in range(18) for layer in range(3)])
        if rolling == "type C":
            bed._grow(4096, 1, 1)
        bed.run(200)
        ends.append(bed.beads())
    assert np.abs(ends[0].velocity[:3] - [[0.5, 0.1, 0.2], [-0.5, 0, 0], [-0.5, 0, 0]]).max() > 0.1
    assert ends[1].velocity == pytest.approx(ends[0].velocity, rel=1e-9, abs=1e-12)
    assert ends[1].spin == pytest.approx(ends[0].spin, rel=1e-9, abs=1e-9)


def test_an_oblique_collision_of_unlike_beads_keeps_momentum_and_angular_momentum():
    stone = Particle("stone", Material("stone", 2600, 70e6, 0.22), 9e-3)
    contacts = {(0, 0): CONTACT, (0, 1): Contact(0.5, 0.4, 0.05), (1, 1): CONTACT}
    bed = weightless(contacts, particles=(D6, stone))
    bed.add([[-0.004, 0.001, 0]], [[1.0, 0.2, 0.3]], [[30, -80, 50]], kind=0)
    bed.add([[0.0045, -0.001, 0.001]], [[-1.0, 0, 0]], [[0, 40, -20]], kind=1)
    before = bed.beads()
    bed.run(300)
    after = bed.beads()

    def angular(beads):
        inertia = 0.4 * beads.mass * beads.radius**2
        orbital = np.cross(beads.position, beads.mass[:, None] * beads.velocity)
        return (orbital + inertia[:, None] * beads.spin).sum(0)

    assert np.abs(after.spin - before.spin).max() > 10  # they did rub
    linear = [(beads.mass[:, None] * beads.velocity).sum(0) for beads in (before, after)]
    assert linear[1] == pytest.approx(linear[0], abs=1e-12 * np.linalg.norm(linear[0]))
    assert angular(after) == pytest.approx(angular(before), abs=1e-11 * np.linalg.norm(angular(before)))


@pytest.fixture(scope="module")
def settled() -> np.ndarray:
    """Positions of 150 beads that fell into a box in random order and came to rest."""
    return shaken().beads().position


def shaken(seed=2, **more) -> Bulk:
    bed = box(**more)
    bed.add(lattice(150, seed=seed), np.random.default_rng(seed).normal(0, 0.4, (150, 3)))
    for _ in range(20):  # 3.6 s at most
        bed.run(5000)
        if bed.beads().kinetic_energy < 1e-20:
            break
    return bed


def laid(settled, **more) -> Bulk:
    bed = box(**more)
    bed.add(settled, overlap=0.05)
    bed.run(4000)
    return bed


def test_a_bed_at_rest_stays_at_rest():
    bed = shaken(seed=3)
    before, lists = bed.beads(), bed.lists_built
    bed.run(10_000)
    after = bed.beads()
    assert np.abs(after.position - before.position).max() < 1e-6 * before.position[:, 2].max()
    assert after.kinetic_energy < 1e-12 * after.mass.sum() * G * D6.radius
    assert bed.lists_built == lists


def test_the_floor_carries_the_weight_of_the_bed():
    # force from the overlaps of the lowest beads by Hertz's law; walls without friction carry no weight
    beads = shaken(wall_contact=Contact(0.6)).beads()
    effective = SOFT.youngs_modulus / (2 * (1 - SOFT.poisson_ratio**2))
    depth = np.maximum(D6.radius - beads.position[:, 2], 0)
    carried = (4 / 3 * effective * math.sqrt(D6.radius) * depth**1.5).sum()
    assert carried == pytest.approx(beads.mass.sum() * G, rel=1e-3)


def test_a_new_neighbour_list_changes_nothing_but_the_order_of_sums(settled):
    calm, stirred = laid(settled), None
    calm.run(300)
    expected = calm.beads()
    stirred = laid(settled)
    for _ in range(10):
        stirred.add(np.zeros((0, 3)))  # adding no bead still rebuilds the list and renumbers
        stirred.run(30)
    assert stirred.lists_built >= 10
    assert np.abs(stirred.beads().position - expected.position).max() < 1e-12


def poured(threads: int, **more) -> engine.Beads:
    bed = box(width=0.07, threads=threads, **more)
    bed.add(lattice(1000, width=0.07), [[0.1, 0.05, -0.5]])
    bed.run(600)
    return bed.beads()


def same_bits(one: engine.Beads, other: engine.Beads) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("position", "velocity", "spin"))


def test_one_thread_and_two_give_the_same_bits(monkeypatch):
    serial = poured(1)
    monkeypatch.setattr(engine, "BEADS_PER_THREAD", 1)
    assert same_bits(poured(2), serial)
    assert serial.spin.any()


def test_threads_that_do_not_start_are_not_waited_for(monkeypatch):
    serial = poured(1)
    monkeypatch.setattr(engine, "BEADS_PER_THREAD", 1)
    monkeypatch.setattr(engine, "Crew", lambda threads: Crew(threads + 1))  # one more than Taichi has
    began = time.perf_counter()
    assert same_bits(poured(backend.start().threads + 1), serial)
    assert time.perf_counter() - began < 60


def test_a_launch_per_step_as_on_a_gpu_gives_the_same_bits():
    bed = box(width=0.07)
    bed.add(lattice(1000, width=0.07), [[0.1, 0.05, -0.5]])
    bed._on_gpu = True
    bed.run(600)
    assert same_bits(bed.beads(), poured(1))


MANY_THREADS = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.bulk import bulk
backend.start(5)
bulk.BEADS_PER_THREAD = 1
from test_bulk import poured, same_bits
assert same_bits(poured(5), poured(1))
"""


@pytest.mark.slow
def test_more_threads_than_cores_give_the_same_bits():
    subprocess.run([sys.executable, "-c", MANY_THREADS, str(Path(__file__).parent)], check=True, timeout=600)


def test_the_number_of_launches_does_not_change_the_bits(monkeypatch):
    whole = poured(1)
    monkeypatch.setattr(engine, "LAUNCH_SECONDS", 1e-3)
    assert same_bits(poured(1), whole)


def test_a_full_neighbour_list_grows_and_loses_no_contact():
    plenty = poured(1)
    assert same_bits(poured(1, pair_capacity=70), plenty)


@pytest.mark.parametrize("rolling", ["type A", "type C"])
def test_energy_only_ever_falls_in_a_settling_bed(rolling):
    bed = box(rolling=rolling)
    bed.add(lattice(100), np.random.default_rng(2).normal(0, 0.2, (100, 3)), np.full((100, 3), 20.0))
    energies = []
    for _ in range(12):
        beads = bed.beads()
        energies.append(beads.kinetic_energy + (beads.mass * G * beads.position[:, 2]).sum())
        bed.run(250)
    assert np.all(np.diff(energies) < 1e-3 * energies[0])
    assert energies[-1] < 0.8 * energies[0]


def test_beads_rest_in_a_bowl_and_those_that_left_are_counted():
    up = (0.0, 0.0, 1.0)
    walls = [Wall(Disc((0, 0, 0), up, 0.02), SOFT, CONTACT), Wall(Cylinder((0, 0, 0), up, 0.02, 0.008), SOFT, CONTACT)]
    bowl = Bulk(
        [D6], CONTACT, walls, low=(-0.05, -0.05, -0.02), high=(0.05, 0.05, 0.05),
        time_step=STEP, open_domain=True, threads=1,
    )  # fmt: skip
    bowl.add([[0.005, 0, 0.01], [-0.008, 0.004, 0.01], [0.03, 0, 0.01], [0, 0.035, 0.01]])
    bowl.run(8000)
    beads = bowl.beads()
    assert beads.ident.tolist() == [0, 1]
    assert bowl.gone == 2
    assert np.hypot(beads.position[:, 0], beads.position[:, 1]).max() <= 0.02 - 0.003 + 1e-4
    assert beads.position[:, 2] == pytest.approx(0.003, abs=1e-5)


def test_the_largest_overlap_is_that_of_the_run_also_when_its_beads_have_left():
    space = weightless(CONTACT, open_domain=True)
    space.add([[0.05, 0, 0], [0.0562, 0, 0], [-0.05, 0.05, 0]], [[1.0, 0, 0], [-1.0, 0, 0], [0, 0, 0]])
    space.run(100)
    deepest = space.largest_overlap
    assert deepest > 0.04
    space.run(20_000)
    assert space.gone == 2
    assert space.largest_overlap == deepest
    state = space.state()
    space._grow(4096, 1, 1)
    assert space.largest_overlap == deepest
    again = weightless(CONTACT, open_domain=True)
    assert again.largest_overlap == 0
    again.restore(state)
    assert again.largest_overlap == deepest


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ([[0.02, 0.02, math.nan]], "not a finite number"),
        ([[0.02, 0.02, 0.5]], "outside the domain"),
        ([[0.02, 0.02, 0.001]], "inside a wall"),
        ([[0.02, 0.02, 0.1], [0.02, 0.02, 0.105]], "beads 0 and 1 overlap"),
    ],
)
def test_impossible_beads_are_refused_before_the_run(position, message):
    with pytest.raises(BadInput, match=message):
        box().add(position)


def test_a_bead_that_leaves_the_domain_stops_the_run_by_name_and_time():
    bed = weightless(CONTACT)
    bed.add([[0, 0, 0], [0, 0, 0.09]], [[0, 0, 0], [0, 0, 2.0]])
    with pytest.raises(SimulationFailed, match=r"bead 1 at t = 0\.0"):
        bed.run(1000)


def test_an_explosion_of_energy_stops_the_run_by_name_and_time():
    bed = box(time_step=20 * STEP)
    bed.add(lattice(80))
    with pytest.raises(SimulationFailed, match=r"bead \d+ at t = .* s") as failure:
        bed.run(20_000)
    assert failure.value.exit_code == 2


def test_the_step_is_checked_against_rayleigh():
    assert time_step([D6]) == (pytest.approx(0.3 * D6.rayleigh_time_step), ())
    step, warnings = time_step([D6], 0.5)
    assert step == pytest.approx(0.5 * D6.rayleigh_time_step)
    assert "50%" in warnings[0]
    for fraction in (0.9, 0.0, -0.1, math.nan, 1e-9):
        with pytest.raises(BadInput, match="time_step_fraction"):
            time_step([D6], fraction)
    step, warnings = time_step([D6], 0.9, forced=True)
    assert step == pytest.approx(0.9 * D6.rayleigh_time_step)
    assert "gain spurious energy" in warnings[0]


def test_gravity_that_is_not_finite_is_refused():
    with pytest.raises(BadInput, match="gravity"):
        box(gravity=(0.0, 0.0, math.nan))


def test_a_list_built_in_parts_is_the_same_and_uneven_parts_are_built_as_a_whole(monkeypatch):
    running = backend.start()
    if running.threads < 2 or running.device == "cuda":
        pytest.skip("one core lists all by itself, and so does a GPU")
    monkeypatch.setattr(engine, "BEADS_IN_PARTS", 900)
    even, loose = lattice(1000, width=0.06), lattice(500, width=0.06, pitch=9e-3)
    # the lower half of the beads has nearly all pairs, so its part of the memory is too small
    loose[:, 2] += even[:500, 2].max() + 9e-3
    speeds = np.random.default_rng(2).normal(0, 0.3, even.shape)
    for places, room, whole in ((even, None, 0), (np.vstack([even[:500], loose]), 2200, 1)):
        found = []
        for threads in (1, 2):
            bed = box(width=0.06, height=0.6, threads=threads, pair_capacity=room)
            bed.add(places, speeds)
            bed._arena.listed.fill(-1)
            bed.run(150)
            found.append(bed.beads())
            assert bed.lists_built > 3
        assert bed._arena.listed[1, 0] > 100 * (1 - whole) - 1  # the second thread has listed its part
        assert bed._count(at.WHOLE) == whole
        assert room is None or bed._arena.pair_capacity == room  # and it need not grow
        assert same_bits(*found)


def test_a_bed_cannot_be_used_after_another_took_its_memory():
    first = box()
    box()
    with pytest.raises(RigtwinError, match="later one"):
        first.run(1)


def in_a_new_process(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ, timeout=60
    )


def test_the_engine_starts_silently_and_reports_missing_cuda():
    code = (
        "from rigtwin.sim.engine import backend\n"
        "first = backend.start(device='cuda')\n"
        "assert backend.start(device='cuda') is first\n"
        "assert backend.start(device='auto') is first\n"
        "assert (first.device == 'cuda') == (first.note == ''), first\n"
        "from rigtwin.lab.materials import Contact, Material, Particle\n"
        "from rigtwin.sim.engine.bulk.bulk import Bulk\n"
        "bead = Particle('D6', Material('ash', 720, 11e6, 0.44), 6e-3)\n"
        "box = dict(low=(0, 0, 0), high=(1, 1, 1), time_step=1e-5)\n"
        "assert Bulk([bead], Contact(0.5), device='cuda', **box).note == first.note\n"
        "assert Bulk([bead], Contact(0.5), device='auto', **box).note == ''\n"
    )
    done = in_a_new_process(code)
    assert done.stdout == ""


def test_a_backend_on_one_device_is_not_used_for_the_other(monkeypatch):
    # works without a GPU: only the recorded device of the process matters
    monkeypatch.setattr(backend, "_running", backend.Backend("cuda", 2))
    for start in (backend.start, box):
        with pytest.raises(RigtwinError, match="already runs on CUDA in this process; start a new process for the CPU"):
            start(device="cpu")
    assert backend.start(device="auto").device == backend.running().device == "cuda"
    monkeypatch.setattr(backend, "_running", backend.Backend("cpu", 2))
    assert backend.start(device="auto").device == "cpu"
    with pytest.raises(RigtwinError, match="already runs on the CPU"):
        backend.start(device="cuda")
    with pytest.raises(BadInput, match="'cpu', 'cuda', 'auto'"):
        backend.start(device="gpu")


def test_rig_modules_are_imported_without_the_engine():
    code = (
        "import sys, rigtwin.sim.drop, rigtwin.sim.pendulum, rigtwin.sim.pile.pile\nassert 'taichi' not in sys.modules"
    )
    in_a_new_process(code)
