"""The collision of two beads from whole paths, and from broken ones as after a coarse codec."""

from itertools import pairwise

import numpy as np
import pytest

from rigtwin.lab.errors import NothingToMeasure
from rigtwin.measure.pendulum.find_collision import Path, find_collision

SIZE, HIT = 20.0, 60  # [px], frame number


class Clip:
    path, first, last, times = "clip.mp4", 0, 199, np.arange(200) / 240


def pieces(frames, across, lengths):
    """Path of a bead along x, split into pieces of the given numbers of frames."""
    edges = np.cumsum([0, *lengths])
    return [
        Path(list(frames[a:b]), [np.array([x, 100.0]) for x in across[a:b]], [SIZE] * (b - a))
        for a, b in pairwise(edges)
    ]


def swings(*, leap=SIZE):
    """Bead A accelerates up to the collision; bead B starts one diameter ahead and slows down."""
    fall, rise = np.arange(20, HIT), np.arange(HIT + 2, HIT + 40)
    came = 200 * (1 - np.cos((fall - 20) / 40 * np.pi / 2)) + 50
    went = 250 + leap + 6.5 * 25 * np.sin((rise - HIT) / 25 * 0.9) / 0.9
    return fall, came, rise, went


@pytest.mark.parametrize(("before", "after"), [((40,), (38,)), ((20, 8, 6, 6), (6, 8, 10, 14))])
def test_the_collision_is_found_from_short_pieces_of_paths(before, after):
    fall, came, rise, went = swings()
    found = find_collision([*pieces(fall, came, before), *pieces(rise, went, after)], Clip(), in_pieces=True)
    assert (found.fall.frames[0], found.fall.frames[-1]) == (fall[0], fall[-1])
    assert found.rise.frames[0] == rise[0]


def test_the_broken_path_of_one_bead_is_no_collision():
    fall, came, rise, went = swings(leap=0.0)
    with pytest.raises(NothingToMeasure, match="moving objects were followed"):
        find_collision([*pieces(fall, came, (34, 6)), *pieces(rise, went, (6, 8, 10, 14))], Clip(), in_pieces=True)
