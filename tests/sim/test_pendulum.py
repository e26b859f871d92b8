"""Double pendulum: energy in the swing, restitution in the collision."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Pendulum
from rigtwin.sim import pendulum
from rigtwin.sim.engine.few.few_body import Body, run

ASH = Material("ash", 720, 11e9, 0.44)
D12 = Particle("D12", ASH, 12e-3, density=726)
G = 9.81


def rise(track, part):
    """Highest point [m] within a part of the track, interpolated."""
    t, y = track.time[part], track.position[part, 1]
    top = int(np.clip(np.argmax(y), 1, len(y) - 2))
    a, b, c = np.polyfit(t[top - 1 : top + 2] - t[top], y[top - 1 : top + 2], 2)
    return c - b * b / (4 * a)


@settings(max_examples=10, deadline=None)
@given(e=st.floats(0.3, 1.0), degrees=st.floats(15, 80), length=st.floats(0.1, 0.5))
def test_the_collision_has_the_given_restitution(e, degrees, length):
    rig = Pendulum(length, math.radians(degrees))
    a, b = pendulum.run(rig, D12, Contact(e, 0.45, 0.04), frame_rate=1000)
    after = slice(int(np.argmax(b.position[:, 1] > 1e-6)), None)
    before = math.sqrt(a.position[0, 1])
    # apex heights give speeds at the collision; A may follow B or come back
    speed_b = math.sqrt(rise(b, after)) / before
    x = a.position[after, 0] + D12.radius
    sign = np.sign(x[np.argmax(np.abs(x))])
    speed_a = sign * math.sqrt(max(rise(a, after), 0.0)) / before
    assert speed_b - speed_a == pytest.approx(e, rel=5e-3, abs=2e-3)
    assert speed_b + speed_a == pytest.approx(1.0, abs=3e-3)


def test_a_free_swing_keeps_its_energy_and_its_thread():
    length, angle = 0.3, math.radians(70)
    pivot = (0.0, 0.0, length)
    start = (-length * math.sin(angle), 0.0, length * (1 - math.cos(angle)))
    motion = run([Body(D12, start, pivot=pivot)], np.linspace(0.01, 10, 500))
    energy = G * motion.position[:, 0, 2] + (motion.velocity[:, 0] ** 2).sum(1) / 2
    assert energy == pytest.approx(G * start[2], rel=1e-4)
    assert np.linalg.norm(motion.position[:, 0] - pivot, axis=1) == pytest.approx(length, rel=1e-12)
    assert motion.position[:, 0, 1] == pytest.approx(0, abs=1e-15)


def test_the_bead_swings_down_in_the_time_of_a_large_pendulum():
    # quarter period at 60 degrees: 1.0732 times the small-angle one (tables of the complete elliptic integral)
    rig = Pendulum(0.25, math.radians(60))
    _, b = pendulum.run(rig, D12, Contact(0.8), frame_rate=10_000)
    moved = b.time[np.argmax(b.position[:, 0] > D12.radius + 1e-6)]
    released = pendulum.FRAMES_AT_REST / 10_000
    assert moved - released == pytest.approx(1.0732 * math.pi / 2 * math.sqrt(0.25 / G), rel=1e-3)


def test_beads_hang_touching_and_start_at_rest():
    rig = Pendulum(0.191, math.radians(45))
    a, b = pendulum.run(rig, D12, Contact(0.73), frame_rate=240)
    assert (a.body, b.body) == ("A", "B")
    assert b.position[0] == pytest.approx([D12.radius, 0])
    hanging = np.array([-D12.radius, 0.191])
    assert np.linalg.norm(a.position - hanging, axis=1) == pytest.approx(0.191, rel=1e-9)
    assert a.position[0, 0] < -D12.radius
    assert np.all(a.position[:4] == a.position[0])


def test_the_tracks_end_after_the_rebound_and_before_the_next_collision():
    a, b = pendulum.run(Pendulum(0.2, math.radians(45)), D12, Contact(0.9), frame_rate=500)
    top = int(np.argmax(b.position[:, 1]))
    assert top < len(b.time) - 5
    assert b.position[-1, 0] > 2 * D12.radius
    assert len(a.time) == len(b.time)


@pytest.mark.parametrize(
    "rig", [Pendulum(-0.2, 0.5), Pendulum(0.2, 0.0), Pendulum(0.2, 4.0), Pendulum(0.2, 0.5, variant="wall")]
)
def test_an_impossible_pendulum_is_refused(rig):
    with pytest.raises(BadInput):
        pendulum.run(rig, D12, Contact(0.73), frame_rate=240)


def test_rods_with_mass_swing_faster_with_the_same_restitution():
    """A uniform rod M: omega^2 = g/L (m + M/2) / (m + M/3) (compound pendulum); the restitution does not change."""
    bead, rod, length = D12, 0.8 * D12.mass, 0.3

    def swings(rod_mass):
        rig = Pendulum(length, math.radians(3), hanger="rod", rod_mass=rod_mass)
        return pendulum.run(rig, bead, Contact(0.6), frame_rate=2000, duration=1.0)

    def hit(tracks):
        return tracks[1].time[np.argmax(tracks[1].position[:, 0] > bead.radius + 1e-6)] - 5 / 2000

    light, heavy = swings(0.0), swings(rod)
    ratio = math.sqrt((bead.mass + rod / 2) / (bead.mass + rod / 3))
    assert hit(light) / hit(heavy) == pytest.approx(ratio, rel=2e-3)
    assert rise(heavy[1], slice(None)) == pytest.approx(rise(light[1], slice(None)), rel=2e-3)


def test_rods_may_be_so_heavy_that_the_contact_is_longer_than_a_step_of_the_swing():
    rig = Pendulum(0.3, math.radians(30), hanger="rod", rod_mass=2000.0)
    tracks = pendulum.run(rig, D12, Contact(0.6), frame_rate=1000)
    assert rise(tracks[1], slice(None)) == pytest.approx(0.64 * 0.3 * (1 - math.cos(rig.release_angle)), rel=0.01)


@pytest.mark.parametrize("e", [0.2, 0.6, 0.9])
def test_a_cube_rebounds_from_the_wall_with_the_given_restitution(e):
    cube = hlosta2020.particle("C6_24s")
    rig = Pendulum(0.3, math.radians(40), variant="wall")
    (track,) = pendulum.run(rig, cube, Contact(e, 0.5, 0.1), frame_rate=1000, wall=hlosta2020.material("steel"))
    back = slice(int(np.argmin(track.position[:, 1])) + 5, None)
    assert math.sqrt(rise(track, back) / track.position[0, 1]) == pytest.approx(e, rel=3e-3)
    assert track.position[:, 0].max() == pytest.approx(-3.1e-3, abs=1e-3)  # half its width in front of the wall


def test_settings_that_contradict_the_variant_are_refused():
    with pytest.raises(BadInput, match="is a clump"):
        pendulum.run(Pendulum(0.3, 0.5), hlosta2020.particle("C6_24s"), Contact(0.5), frame_rate=240)
    with pytest.raises(BadInput, match="a string is taken as massless"):
        pendulum.run(Pendulum(0.3, 0.5, rod_mass=1e-3), D12, Contact(0.5), frame_rate=240)
