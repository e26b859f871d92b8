"""Frames that a film lacks, told by the turn of a plate that rises steadily."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.measure.turning import missing_frames

RATE = 50.0  # [1/s]


def plate(seed: int, *, count: int = 200, speed: float = 0.02, noise: float = 0.0006) -> np.ndarray:
    """Angle of a plate whose speed sways by a fifth, by frame."""
    rng = np.random.default_rng(seed)
    frames = np.arange(count)
    return speed * (frames + 5 * np.sin(frames / 25)) + noise * rng.standard_normal(count)


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.lists(st.integers(2, 36), min_size=1, max_size=4, unique=True))
def test_every_lost_frame_is_told_where_it_is_lost(seed, places):
    kept = np.delete(np.arange(200), [5 * place for place in places])
    found = missing_frames(np.arange(len(kept)) / RATE, plate(seed)[kept])
    assert np.array_equal(np.arange(len(kept)) + np.cumsum(found), kept)


def test_a_plate_that_sinks_tells_them_as_well():
    kept = np.delete(np.arange(200), [60, 61])
    found = missing_frames(np.arange(198) / RATE, -plate(1)[kept])
    assert found.tolist() == [0] * 60 + [2] + [0] * 137


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_nothing_is_missing_where_nothing_was_lost(seed):
    assert not missing_frames(np.arange(200) / RATE, plate(seed)).any()


def test_a_frame_shown_twice_in_another_ones_place_is_no_lost_one():
    shown = np.arange(200)
    shown[5::6] -= 1
    assert not missing_frames(np.arange(200) / RATE, plate(2)[shown]).any()


def test_a_gap_that_the_times_tell_is_none_that_they_hide():
    kept = np.delete(np.arange(200), [80, 81, 120])
    assert not missing_frames(kept / RATE, plate(3)[kept]).any()


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_a_plate_that_hardly_turns_beside_its_noise_tells_none(noise):
    kept = np.delete(np.arange(200), [70])
    assert not missing_frames(np.arange(199) / RATE, plate(4, noise=noise)[kept]).any()


def test_a_plate_that_is_knocked_on_for_some_frames_lacks_none():
    angle = plate(5)
    angle[91:] += 0.02  # three steps of double length, one after the other
    angle[92:] += 0.02
    angle[93:] += 0.02
    assert not missing_frames(np.arange(200) / RATE, angle).any()


def test_a_plate_that_jerks_by_itself_lacks_no_frames():
    steps = np.where(np.arange(200) % 3 == 0, 0.06, 0.0)  # a motor of few steps a turn
    assert not missing_frames(np.arange(200) / RATE, np.cumsum(steps)).any()
