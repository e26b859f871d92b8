"""Drop test: the track has the given gravity and restitution."""

import math

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rigs import Drop
from rigtwin.sim import drop

ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
D6 = Particle("D6", ASH, 6e-3, density=569)
G = 9.81


def arcs(track, radius):
    """Apex above the resting height of the arcs between impacts, from parabolas of the known curvature."""
    t, y = track.time, track.position[:, 1] - radius
    low = np.flatnonzero((y[1:-1] < y[:-2]) & (y[1:-1] <= y[2:])) + 1
    heights = []
    for begin, end in zip(low[:-1] + 2, low[1:] - 1, strict=True):
        # y + G t^2 / 2 is a straight line in flight
        slope, start = np.polyfit(t[begin:end], y[begin:end] + G * t[begin:end] ** 2 / 2, 1)
        heights.append(start + slope**2 / (2 * G))
    return heights


@pytest.mark.parametrize("e", [0.42, 0.75, 0.9])
@pytest.mark.parametrize("height", [0.05, 0.25])
def test_rebounds_have_the_given_restitution(e, height):
    track = drop.run(Drop(height, bounces=3), D6, STEEL, Contact(e, 0.36, 0.06), frame_rate=2000)
    first, second = arcs(track, D6.radius)[:2]
    assert math.sqrt(first / height) == pytest.approx(e, rel=5e-3)
    assert math.sqrt(second / first) == pytest.approx(e, rel=5e-3)


def test_the_bead_rests_and_then_falls_freely_from_the_drop_height():
    track = drop.run(Drop(0.3), D6, STEEL, Contact(0.5), frame_rate=240)
    y = track.position[:, 1]
    resting = np.flatnonzero(y == 0.3 + D6.radius)
    assert len(resting) > 3
    release = track.time[resting[-1]]
    falling = (track.time > release) & (track.time < release + 0.2)
    assert y[falling] == pytest.approx(0.3 + D6.radius - G * (track.time[falling] - release) ** 2 / 2, abs=1e-9)
    assert np.all(track.position[:, 0] == 0)
    assert np.allclose(np.diff(track.time), 1 / 240)


@pytest.mark.parametrize("bounces", [1, 2, 5])
def test_the_track_shows_as_many_bounces_as_asked_for(bounces):
    track = drop.run(Drop(0.25, bounces=bounces), D6, STEEL, Contact(0.8), frame_rate=1000)
    y = track.position[:, 1]
    low = np.flatnonzero((y[1:-1] < y[:-2]) & (y[1:-1] <= y[2:]) & (y[1:-1] < 2 * D6.radius))
    assert len(low) == bounces
    assert y[-1] < 3 * D6.radius  # and ends as the bead comes down again


def test_a_long_record_ends_with_the_bead_at_rest_on_the_plate():
    track = drop.run(Drop(0.1), D6, STEEL, Contact(0.3), frame_rate=100, duration=2.0)
    assert track.time[-1] == pytest.approx(2.0)
    assert track.position[-50:, 1] == pytest.approx(D6.radius, abs=1e-6)


@pytest.mark.parametrize(
    ("rig", "rate"), [(Drop(-0.1), 240), (Drop(math.nan), 240), (Drop(0.1, bounces=0), 240), (Drop(0.1), 0.0)]
)
def test_an_impossible_drop_is_refused(rig, rate):
    with pytest.raises(BadInput, match="positive"):
        drop.run(rig, D6, STEEL, Contact(0.5), frame_rate=rate)
