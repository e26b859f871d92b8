"""Linear contact law: restitution, duration of contact, and agreement of both engines."""

import math

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.few import few_body
from rigtwin.sim.engine.few.few_body import Body
from rigtwin.sim.engine.walls.shapes import Plane, Wall

ASH = Material("soft ash", 720, 11e6, 0.44)
BEAD = Particle("D6", ASH, 6e-3, density=569)
E_STAR = ASH.youngs_modulus / 2 / (1 - ASH.poisson_ratio**2)


def spring(impact_speed: float) -> tuple[float, float]:
    """Effective mass of two beads, and the spring with the same overlap as Hertz's contact at that speed."""
    mass, radius = BEAD.mass / 2, BEAD.radius / 2
    depth = (15 / 16 * mass * impact_speed**2 / (E_STAR * math.sqrt(radius))) ** (2 / 5)
    return mass, mass * impact_speed**2 / depth**2


def head_on(e: float, speed: float, impact_speed: float = 1.0, samples: int = 4001, **more):
    """Two beads colliding at `speed` without gravity, sampled from just before to long after."""
    mass, stiffness = spring(impact_speed)
    period = math.pi * math.sqrt(mass / stiffness)
    step = period / 4000
    left, right = (Body(BEAD, (x, 0, 0), velocity=(v, 0, 0)) for x, v in ((-0.003, speed / 2), (0.003, -speed / 2)))
    times = np.linspace(0, 2.5 * period, samples)
    return few_body.run(
        [left, right], times, contacts=Contact(e, 0.0), gravity=(0, 0, 0), step=step, flight_step=step,
        contact_law="linear", impact_speed=impact_speed, **more,
    )  # fmt: skip


@pytest.mark.parametrize("speed", [0.05, 5.0])
@pytest.mark.parametrize("e", [0.1, 0.5, 0.9, 1.0])
def test_rebounds_have_the_given_restitution_at_any_speed(e, speed):
    velocity = head_on(e, speed, samples=2).velocity[-1, :, 0]
    assert (velocity[1] - velocity[0]) / speed == pytest.approx(e, rel=2e-3)


@pytest.mark.parametrize(("e", "speed"), [(1.0, 0.05), (1.0, 2.0), (0.6, 0.05), (0.6, 2.0)])
def test_the_duration_of_a_contact_is_that_of_the_damped_oscillator(e, speed):
    # it ends when the force is zero: with psi = sin(a), after (pi - 2 a) / (omega cos(a)), and e = exp(-... tan(a))
    mass, stiffness = spring(1.0)
    low, high = 0.0, math.pi / 2 - 1e-9
    for _ in range(80):
        a = (low + high) / 2
        low, high = (a, high) if math.exp(-(math.pi - 2 * a) * math.tan(a)) > e else (low, a)
    lasts = (math.pi - 2 * a) / math.cos(a) / math.sqrt(stiffness / mass)
    motion = head_on(e, speed)
    closing = motion.velocity[:, 0, 0] - motion.velocity[:, 1, 0]
    changing = motion.time[1:][np.abs(np.diff(closing)) > 1e-9 * speed]
    assert changing.max() - changing.min() == pytest.approx(lasts, rel=5e-3)


def test_an_undamped_impact_at_the_given_speed_has_the_overlap_of_hertz():
    deepest = {}
    for law in ("linear", "Hertz-Mindlin"):
        mass, stiffness = spring(2.0)
        times = np.linspace(0, 1.5 * math.pi * math.sqrt(mass / stiffness), 2001)
        bodies = [Body(BEAD, (x, 0, 0), velocity=(v, 0, 0)) for x, v in ((-0.003, 1.0), (0.003, -1.0))]
        motion = few_body.run(
            bodies, times, contacts=Contact(1.0), gravity=(0, 0, 0), step=1e-7, contact_law=law, impact_speed=2.0
        )
        gap = np.linalg.norm(motion.position[:, 1] - motion.position[:, 0], axis=1) - BEAD.diameter
        deepest[law] = -gap.min()
    mass, stiffness = spring(2.0)
    assert deepest["linear"] == pytest.approx(2.0 * math.sqrt(mass / stiffness), rel=1e-4)
    assert deepest["linear"] == pytest.approx(deepest["Hertz-Mindlin"], rel=1e-3)


@pytest.mark.parametrize("kinds", [1, 2])
def test_the_bulk_engine_makes_the_same_collisions_as_the_few_body_path(kinds):
    contact = Contact(0.6, 0.3, 0.05)
    step = 2e-6
    wall = Wall(Plane((0, 0, 0), (0, 0, 1)), ASH, contact)
    bed = Bulk(
        [BEAD] * kinds, contact, [wall], low=(-0.1,) * 3, high=(0.1,) * 3, gravity=(0, 0, 0), time_step=step,
        threads=1, contact_law="linear", impact_speed=0.5,
    )  # fmt: skip
    places, speeds = [(0, 0, 0.0031), (0.0061, 0, 0.0045)], [(0.3, 0.1, -0.4), (-0.3, 0, -0.2)]
    for k in range(2):
        bed.add([places[k]], [speeds[k]], kind=k % kinds)
    bed.run(2000)
    bodies = [Body(BEAD, place, velocity=speed) for place, speed in zip(places, speeds, strict=True)]
    motion = few_body.run(
        bodies, np.array([2000 * step]), walls=[wall], contacts=contact, gravity=(0, 0, 0), step=step,
        flight_step=step, contact_law="linear", impact_speed=0.5,
    )  # fmt: skip
    assert np.abs(bed.beads().velocity - speeds).max() > 0.2
    assert bed.beads().velocity == pytest.approx(motion.velocity[-1], rel=1e-2, abs=2e-3)
    assert bed.beads().position == pytest.approx(motion.position[-1], abs=2e-6)


def test_the_energy_balance_includes_linear_springs():
    bed = Bulk(
        [BEAD], Contact(1.0), low=(-0.1,) * 3, high=(0.1,) * 3, gravity=(0, 0, 0), time_step=1e-6, threads=1,
        contact_law="linear",
    )  # fmt: skip
    bed.add([[-0.003, 0, 0], [0.003, 0, 0]], [[0.5, 0, 0], [-0.5, 0, 0]])
    totals, springs = [], []
    for _ in range(6):
        books = bed.budget()
        totals.append(books.total)
        springs.append(books.elastic)
        bed.run(60)
    assert max(springs) > 0.5 * totals[0]
    assert totals == pytest.approx([totals[0]] * 6, rel=2e-3)


def test_an_unknown_law_and_an_impossible_speed_are_refused():
    with pytest.raises(BadInput, match="contact_law"):
        Bulk([BEAD], Contact(1.0), low=(0,) * 3, high=(1,) * 3, time_step=1e-6, contact_law="hooke")
    with pytest.raises(BadInput, match="impact_speed"):
        Bulk([BEAD], Contact(1.0), low=(0,) * 3, high=(1,) * 3, time_step=1e-6, impact_speed=0.0)
