"""The twin of a film is drawn where its bodies would be in the picture, in each frame."""

import math
from pathlib import Path

import numpy as np
import pytest

from rigtwin.lab.errors import Mark
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Track
from rigtwin.review.twin_in_step import twin_marks

RATE, SCALE, ROLL, ORIGIN = 240.0, 0.4e-3, math.radians(2), (310.0, 640.0)  # [1/s], [m/px], [rad], [px]


def bouncing(time, restitution, drop=0.25):
    """Height [m] of a bead over its place at the contact, let go at t = 0.1 s."""
    hit = math.sqrt(2 * drop / 9.81)
    since = time - 0.1 - hit
    rising = restitution * 9.81 * hit
    return np.where(since < 0, drop - 4.905 * np.maximum(time - 0.1, 0) ** 2, rising * since - 4.905 * since**2)


def in_picture(x, y):
    cos, sin = math.cos(ROLL), math.sin(ROLL)
    return ORIGIN[0] + (x * cos + y * sin) / SCALE, ORIGIN[1] + (x * sin - y * cos) / SCALE


def filmed(restitution):
    """A film of 90 frames whose bead is seen from the fourth one on."""
    frames = np.arange(4, 90)
    time = frames / RATE
    y = bouncing(time, restitution)
    x = np.full_like(y, 0.01)
    points = list(zip(*(axis.tolist() for axis in in_picture(x, y)), strict=True))
    mark = Mark("bead", points, 8.0, "track", frames.tolist())
    track = Track(time, np.column_stack([x, y]), np.full(len(y), 1e-5))
    return Measurement("drop", Path("r01.mp4"), "", (), tracks=(track,), marks=(mark,))


def simulated(restitution, *, clock=0.37, origin=(0.2, 0.003)):
    """The same drop by a clock and an origin of its own."""
    time = np.arange(90) / RATE
    y = bouncing(time, restitution)
    position = np.column_stack([np.full_like(y, origin[0]), y + origin[1]])
    return Track(time + clock, position, np.full(len(y), 1e-6))


def test_a_twin_that_moves_as_the_film_lies_over_it():
    film = filmed(0.6)
    (mark,) = twin_marks(film, [simulated(0.6)], np.arange(90) / RATE)
    shown = dict(zip(mark.frames, mark.points, strict=True))
    seen = dict(zip(film.marks[0].frames, film.marks[0].points, strict=True))
    both = sorted(shown.keys() & seen.keys())
    assert len(both) > 80
    assert max(math.dist(shown[frame], seen[frame]) for frame in both) < 1.0
    assert (mark.kind, mark.radius) == ("twin", 8.0)


def test_a_twin_that_rebounds_higher_is_drawn_higher_after_the_contact():
    film = filmed(0.6)
    (mark,) = twin_marks(film, [simulated(0.7)], np.arange(90) / RATE)
    highest = {name: min(y for (_, y), frame in zip(each.points, each.frames, strict=True) if frame > 78)
               for name, each in {"film": film.marks[0], "twin": mark}.items()}  # fmt: skip
    risen = {name: (ORIGIN[1] - y) * SCALE for name, y in highest.items()}
    assert risen["twin"] > 1.1 * risen["film"]


@pytest.mark.parametrize("twin", [[], [simulated(0.6)] * 2, [simulated(0.6, origin=(0, 0))]])
def test_where_a_twin_cannot_be_laid_over_the_film_nothing_is_drawn(twin):
    film = filmed(0.6)
    if len(twin) == 1:  # one that falls to the side
        track = twin[0]
        twin = [Track(track.time, track.position[:, ::-1] * [-1, 0], track.sigma)]
    assert twin_marks(film, twin, np.arange(90) / RATE) == ()
