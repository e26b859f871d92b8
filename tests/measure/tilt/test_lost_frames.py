"""Frames that a film lacks, told by the turn of a plate that rises steadily."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.measure.tilt.lost_frames import gaps_by_run, gaps_by_turn

RATE = 50.0  # [1/s]


def plate(seed: int, *, count: int = 200, speed: float = 0.02, noise: float = 0.0006) -> np.ndarray:
    """Angle of a plate whose speed sways by a fifth, by frame."""
    rng = np.random.default_rng(seed)
    frames = np.arange(count)
    return speed * (frames + 5 * np.sin(frames / 25)) + noise * rng.standard_normal(count)


def _missing(times: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return gaps_by_turn(times, angle).missing


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.lists(st.integers(2, 36), min_size=1, max_size=4, unique=True))
def test_every_lost_frame_is_told_where_it_is_lost(seed, places):
    kept = np.delete(np.arange(200), [5 * place for place in places])
    found = _missing(np.arange(len(kept)) / RATE, plate(seed)[kept])
    assert np.array_equal(np.arange(len(kept)) + np.cumsum(found), kept)


def test_a_plate_that_sinks_tells_them_as_well():
    kept = np.delete(np.arange(200), [60, 61])
    found = _missing(np.arange(198) / RATE, -plate(1)[kept])
    assert found.tolist() == [0] * 60 + [2] + [0] * 137


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_nothing_is_missing_where_nothing_was_lost(seed):
    assert not _missing(np.arange(200) / RATE, plate(seed)).any()


def test_a_frame_shown_twice_in_another_ones_place_is_no_lost_one():
    shown = np.arange(200)
    shown[5::6] -= 1
    assert not _missing(np.arange(200) / RATE, plate(2)[shown]).any()


def test_a_gap_that_the_times_tell_is_none_that_they_hide():
    kept = np.delete(np.arange(200), [80, 81, 120])
    assert not _missing(kept / RATE, plate(3)[kept]).any()


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_a_plate_that_hardly_turns_beside_its_noise_tells_none(noise):
    kept = np.delete(np.arange(200), [70])
    assert not _missing(np.arange(199) / RATE, plate(4, noise=noise)[kept]).any()


def test_a_plate_that_is_knocked_on_for_some_frames_lacks_none():
    angle = plate(5)
    angle[91:] += 0.02  # three steps of double length, one after the other
    angle[92:] += 0.02
    angle[93:] += 0.02
    assert not _missing(np.arange(200) / RATE, angle).any()


def test_a_plate_that_jerks_by_itself_lacks_no_frames():
    steps = np.where(np.arange(200) % 3 == 0, 0.06, 0.0)  # a motor of few steps a turn
    assert not _missing(np.arange(200) / RATE, np.cumsum(steps)).any()


def run(seed: int, *, rolls: bool = False, count: int = 60, noise: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Way [px] of a body that speeds up from rest, and its noise."""
    frames = np.arange(count)
    way = 0.002 * frames**3 if rolls else 0.1 * frames**2
    return way + noise * np.random.default_rng(seed).standard_normal(count), np.full(count, noise)


@pytest.mark.parametrize("rolls", [False, True])
@settings(max_examples=20)
@given(st.integers(0, 10**6), st.lists(st.integers(6, 11), min_size=1, max_size=4, unique=True))
def test_frames_that_are_lost_from_a_run_are_told_where_they_are_lost(rolls, seed, places):
    way, sigma = run(seed, rolls=rolls)
    kept = np.delete(np.arange(60), [5 * place - 3 for place in places])
    found = gaps_by_run(np.arange(len(kept)) / RATE, way[kept], sigma[kept])
    assert np.array_equal(np.arange(len(kept)) + np.cumsum(found.missing), kept)


@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_a_whole_run_lacks_nothing(seed):
    way, sigma = run(seed)
    found = gaps_by_run(np.arange(60) / RATE, way, sigma)
    assert not found.missing.any()
    assert found.shown.sum() > 40


def test_frames_put_in_between_put_off_a_run_and_those_in_anothers_place_do_not():
    way, sigma = run(7)
    again = np.arange(60) * 4 // 5
    assert np.sum(gaps_by_run(np.arange(60) / RATE, way[again], sigma).missing == -1) > 5
    instead = np.arange(60)
    instead[5::6] -= 1
    assert not gaps_by_run(np.arange(60) / RATE, way[instead], sigma).missing.any()


def test_a_run_that_stops_and_goes_tells_nothing():
    rng = np.random.default_rng(2)
    way = np.cumsum(rng.choice([0.0, 8.0, 16.0], 60))
    assert not gaps_by_run(np.arange(60) / RATE, way, np.full(60, 0.05)).shown.any()


def test_what_a_codec_copies_while_it_hardly_moves_yet_is_no_frame_shown_twice():
    way, sigma = run(3, noise=0.02)
    way[:4] = 0.0, 0.004, 0.0042, 0.55  # of 0, 0.1, 0.4 and 0.9 px, and with less scatter than it is off by
    sigma[:3] = 0.0003
    assert not gaps_by_run(np.arange(60) / RATE, way, sigma).missing.any()
