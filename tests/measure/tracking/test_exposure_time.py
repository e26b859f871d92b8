"""The exposure time follows from the streaks of a fast bead, and from nothing else."""

import math

import numpy as np
import pytest

from rigtwin.measure.scene.pose import Pose
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tracking.bead_image import Look
from rigtwin.measure.tracking.cutouts import Cut
from rigtwin.measure.tracking.detect import Spot
from rigtwin.measure.tracking.exposure_time import TRIED, Shutter, fast_frames, shutter_of
from rigtwin.measure.tracking.follow import measured_shutter
from rigtwin.measure.tracking.link import SpotPath

LOOK = Look(8.0, 0.8, np.array([150.0, 0.0, 0.0, 0.0]))
SIZE = (320, 80)


def falling(frames, pull=1.2, start=20.0):
    """An accelerated fall [px], frame by frame."""
    spots = [Spot(40.0, start + pull * frame**2 / 2, 200, 16, 16, 60.0) for frame in frames]
    return SpotPath(tuple(frames), tuple(spots))


def film(path, share, *, empty=(), seed=0):
    """Cut-outs of a bead on that path, exposed for a share of the frame interval."""
    noise = np.random.default_rng(seed)
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    cuts = []
    for k in range(1, len(path.frames) - 1):
        (x, y), step = path.centres[k], (path.centres[k + 1] - path.centres[k - 1]) / 2
        picture = np.full(SIZE, 80.0)
        if path.frames[k] not in empty:
            moments = y + share * step[1] * ((np.arange(40) + 0.5) / 40 - 0.5)
            about = np.abs(rows[:, 0] - y) < abs(step[1]) + LOOK.radius + 1
            away = np.hypot(columns[None, about] - x, rows[None, about] - moments[:, None, None])
            picture[about] += 70 * np.mean(np.clip((LOOK.radius - away) / 1.6 + 0.5, 0, 1), axis=0)
        grey = (picture + noise.normal(0, 2.0, SIZE)).astype(np.float32)
        step = (float(step[0]), float(step[1]))
        cuts.append(Cut(path.frames[k], k / 240, grey, 0, 0, (float(x), float(y)), step, Pose()))
    return cuts


def scene():
    return Scene(np.full(SIZE, 80, dtype=np.float32), np.full(SIZE, 2.0, dtype=np.float32))


@pytest.mark.parametrize("share", [0.12, 0.35, 0.7, 0.95])
def test_the_streaks_of_a_fast_bead_give_the_exposure_time(share):
    path = falling(range(20))
    cuts = film(path, share)
    roughly = measured_shutter(cuts, path, scene(), LOOK, None)
    assert abs(roughly.share - share) < 2 * roughly.uncertainty
    found = measured_shutter(cuts, path, scene(), LOOK, None, roughly)
    assert abs(found.share - share) < 2 * found.uncertainty < 0.12


def test_frames_without_the_bead_do_not_change_the_exposure_time():
    path = falling(range(20))
    found = measured_shutter(film(path, 0.3, empty=(13, 15, 16)), path, scene(), LOOK, None)
    assert abs(found.share - 0.3) < 2 * found.uncertainty


def test_a_slow_bead_gives_no_exposure_time():
    path = falling(range(20), pull=0.05)
    found = measured_shutter(film(path, 0.5), path, scene(), LOOK, None)
    assert not found.measured
    assert math.isinf(found.uncertainty)


def test_frames_at_a_bounce_and_beside_gaps_are_not_used():
    fall = falling(range(12))
    up = [Spot(40.0, fall.spots[-1].y - 9.0 * k, 200, 16, 16, 60.0) for k in range(1, 8)]
    path = SpotPath((*fall.frames, *range(12, 15), *range(20, 24)), (*fall.spots, *up))
    assert not {11, 14, 20} & set(fast_frames(path))
    assert {10, 12, 13, 21} <= set(fast_frames(path))


def test_a_frame_with_constant_misfit_has_no_weight():
    flat = np.full(7, 3.0)
    sharp = 2 + 3 * (TRIED - 0.4) ** 2
    found = shutter_of(TRIED, np.stack([sharp, flat, flat, sharp, flat], axis=1), np.full(5, 20.0))
    assert found.share == pytest.approx(0.4, abs=0.01)
    assert Shutter(found.share, found.uncertainty).measured
