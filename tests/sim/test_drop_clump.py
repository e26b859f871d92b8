"""Drop test with a clump: conservation of energy, impulse of an off-centre impact, mirror symmetry."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import GRAVITY, Drop
from rigtwin.measure.drop import evaluate as ruler
from rigtwin.sim import drop_clump

HEIGHT = 0.2  # [m]
STEEL = hlosta2020.material("steel")
PELLET, CUBE = hlosta2020.particle("P6x15_5s"), hlosta2020.particle("C6_24s")


def fall(particle, turned=None, *, seed=1, bounces=1, frame_rate=1000, **contact):
    touch = replace(hlosta2020.contact(particle.name, "steel"), **contact)
    return drop_clump.run(Drop(HEIGHT, bounces, turned), particle, STEEL, touch, frame_rate=frame_rate, seed=seed)


def first_bounce(tumble):
    """Velocity before and after, and the spin after it."""
    up = tumble.velocity[:, 2]
    k = int(np.flatnonzero((up[:-1] < 0) & (np.diff(up) > 0.1))[0])
    return tumble.velocity[k], tumble.velocity[k + 1], tumble.spin[k + 1], k


@pytest.mark.parametrize("turned", [1.2, pytest.param(1.4, marks=pytest.mark.slow), -1.1])
def test_an_elastic_impact_on_a_pellets_end_follows_the_impulse_equations(turned):
    """Without friction J = 2 v / (1/m + r^2/I) at the end sphere, r being its place along the plate."""
    tumble = fall(PELLET, turned, restitution=1.0, static_friction=0.0, rolling_friction=0.0)
    _, after, spin, _ = first_bounce(tumble)
    offsets = np.array(PELLET.shape.offsets)
    along = int(np.argmax(np.ptp(offsets, axis=0)))
    assert along == 0
    ends = offsets[:, 0]
    lever = float(np.max(ends)) * math.cos(turned) * (1 if turned > 0 else -1)  # the lower end hits
    inertia = PELLET.moments[1] / PELLET.mass
    hit = -math.sqrt(2 * GRAVITY * HEIGHT)
    impulse = -2 * hit / (1 + lever**2 / inertia)  # per mass
    # frames next to the impact differ from it by up to a millisecond of gravity
    assert after[2] == pytest.approx(hit + impulse, abs=0.02)
    assert spin[1] == pytest.approx(-impulse * lever / inertia, rel=0.01)
    assert np.abs(after[:2]).max() < 1e-6
    assert np.abs(spin[[0, 2]]).max() < 1e-6


@pytest.mark.parametrize(
    "particle", [PELLET, pytest.param(CUBE, marks=pytest.mark.slow)], ids=lambda particle: particle.name
)
def test_energy_is_conserved_without_damping_and_never_gained_with_it(particle):
    def energy(tumble, k):
        moments = np.array(particle.moments) / particle.mass
        assert np.ptp(moments) < 1e-3 * moments[0] or np.abs(tumble.spin[k, [0, 2]]).max() < 1e-6
        height = tumble.front.position[k, 1] - tumble.lowest
        return GRAVITY * height + 0.5 * (tumble.velocity[k] ** 2).sum() + 0.5 * moments[1] * (tumble.spin[k] ** 2).sum()

    elastic = fall(particle, 0.5, restitution=1.0, static_friction=0.0, rolling_friction=0.0)
    assert energy(elastic, len(elastic.spin) - 1) == pytest.approx(GRAVITY * HEIGHT, rel=5e-3)
    real = fall(particle, 0.5, restitution=0.6)
    assert 0 < energy(real, len(real.spin) - 1) < 0.9 * GRAVITY * HEIGHT


@pytest.mark.slow
def test_the_mirrored_orientation_rebounds_to_the_other_side():
    one, other = (fall(CUBE, turned, bounces=1) for turned in (0.3, -0.3))
    assert one.front.position[:, 0] == pytest.approx(-other.front.position[:, 0], abs=1e-6)
    assert one.front.position[:, 1] == pytest.approx(other.front.position[:, 1], abs=1e-6)
    assert abs(one.front.position[-1, 0]) > 5e-3


def test_a_clump_landing_flat_rebounds_vertically():
    tumble = fall(CUBE, 0.0, restitution=0.6)
    assert np.abs(tumble.front.position[:, 0]).max() < 1e-6
    assert np.abs(tumble.spin).max() < 1e-3
    assert tumble.lowest == pytest.approx(3.1e-3)


@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("frame_rate", [240, 1000])
def test_two_views_give_the_speed_in_all_directions(seed, frame_rate):
    tumble = fall(PELLET, seed=seed, frame_rate=frame_rate, bounces=2)
    before, after, _, k = first_bounce(tumble)
    quantities = ruler.evaluate(tumble.front, side=tumble.side).quantities
    seen = {q.method: q for q in quantities if q.quantity == "restitution_wall" and q.detail["bounce"] == 1}
    # speeds at the intersection of the flights, extrapolated under gravity from the frames next to the bounce
    flight = tumble.front.time[k + 1] - tumble.front.time[k]
    hit = math.sqrt(2 * GRAVITY * HEIGHT)
    up = after[2] + GRAVITY * (flight - (hit + before[2]) / GRAVITY)
    expected = math.hypot(up, *after[:2]) / hit
    assert seen["all directions"].value == pytest.approx(expected, abs=0.01)
    assert not seen["all directions"].doubtful
    assert seen["velocity"].value == pytest.approx(up / hit, abs=0.01)
    assert seen["all directions"].value > seen["velocity"].value + 0.01
    assert seen["height"].doubtful


@pytest.mark.slow
def test_the_seed_determines_the_orientation():
    first, again, other = (fall(PELLET, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first.front.position, again.front.position)
    assert first.lowest != other.lowest


def test_a_rebound_away_from_the_viewer_makes_its_height_doubtful_too():
    tumble = fall(CUBE, seed=3, frame_rate=240, restitution=0.5)
    _, after, _, _ = first_bounce(tumble)
    assert abs(after[1]) > 2 * abs(after[0])
    quantities = ruler.evaluate(tumble.front, side=tumble.side).quantities
    assert all(q.doubtful for q in quantities if q.method == "height" and q.detail.get("bounce"))


def test_a_fall_of_too_few_frames_is_refused():
    with pytest.raises(BadInput, match="give at least 35 Hz"):
        fall(CUBE, frame_rate=30)


def test_a_sphere_is_refused():
    with pytest.raises(BadInput, match="is a sphere"):
        fall(hlosta2020.particle("D6"))
