"""Lost frames found from the turn of a steadily rising plate, and from the run of a body."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.measure.tilt.lost_frames import gaps_by_run, gaps_by_turn

RATE = 50.0  # [1/s]


def plate(seed: int, *, count: int = 200, speed: float = 0.02, noise: float = 0.0006) -> np.ndarray:
    """Angle of a plate whose speed varies by a fifth, for each frame."""
    rng = np.random.default_rng(seed)
    frames = np.arange(count)
    return speed * (frames + 5 * np.sin(frames / 25)) + noise * rng.standard_normal(count)


def _missing(times: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return gaps_by_turn(times, angle).missing


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.lists(st.integers(2, 36), min_size=1, max_size=4, unique=True))
def test_every_lost_frame_is_found_at_its_place(seed, places):
    kept = np.delete(np.arange(200), [5 * place for place in places])
    found = _missing(np.arange(len(kept)) / RATE, plate(seed)[kept])
    assert np.array_equal(np.arange(len(kept)) + np.cumsum(found), kept)


def test_lost_frames_are_found_from_a_sinking_plate():
    kept = np.delete(np.arange(200), [60, 61])
    found = _missing(np.arange(198) / RATE, -plate(1)[kept])
    assert found.tolist() == [0] * 60 + [2] + [0] * 137


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_a_complete_film_has_no_lost_frames(seed):
    assert not _missing(np.arange(200) / RATE, plate(seed)).any()


def test_a_doubled_frame_that_replaces_another_is_no_lost_frame():
    shown = np.arange(200)
    shown[5::6] -= 1
    assert not _missing(np.arange(200) / RATE, plate(2)[shown]).any()


def test_a_gap_in_the_time_stamps_is_no_hidden_loss():
    kept = np.delete(np.arange(200), [80, 81, 120])
    assert not _missing(kept / RATE, plate(3)[kept]).any()


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_a_turn_within_the_noise_shows_no_lost_frames(noise):
    kept = np.delete(np.arange(200), [70])
    assert not _missing(np.arange(199) / RATE, plate(4, noise=noise)[kept]).any()


def test_a_plate_that_is_knocked_for_several_frames_has_no_lost_frames():
    angle = plate(5)
    angle[91:] += 0.02  # three steps of double length, one after the other
    angle[92:] += 0.02
    angle[93:] += 0.02
    assert not _missing(np.arange(200) / RATE, angle).any()


def test_a_plate_that_moves_in_jerks_has_no_lost_frames():
    steps = np.where(np.arange(200) % 3 == 0, 0.06, 0.0)  # a motor with few steps per turn
    assert not _missing(np.arange(200) / RATE, np.cumsum(steps)).any()


def run(seed: int, *, rolls: bool = False, count: int = 60, noise: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Displacement [px] of a body that accelerates from rest, and its noise."""
    frames = np.arange(count)
    way = 0.002 * frames**3 if rolls else 0.1 * frames**2
    return way + noise * np.random.default_rng(seed).standard_normal(count), np.full(count, noise)


@pytest.mark.parametrize("rolls", [False, True])
@settings(max_examples=20)
@given(st.integers(0, 10**6), st.lists(st.integers(6, 11), min_size=1, max_size=4, unique=True))
def test_frames_lost_from_a_run_are_found_at_their_place(rolls, seed, places):
    way, sigma = run(seed, rolls=rolls)
    kept = np.delete(np.arange(60), [5 * place - 3 for place in places])
    found = gaps_by_run(np.arange(len(kept)) / RATE, way[kept], sigma[kept])
    assert np.array_equal(np.arange(len(kept)) + np.cumsum(found.missing), kept)


@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_a_complete_run_has_no_lost_frames(seed):
    way, sigma = run(seed)
    found = gaps_by_run(np.arange(60) / RATE, way, sigma)
    assert not found.missing.any()
    assert found.shown.sum() > 40


def test_inserted_frames_delay_a_run_and_replaced_frames_do_not():
    way, sigma = run(7)
    again = np.arange(60) * 4 // 5
    assert np.sum(gaps_by_run(np.arange(60) / RATE, way[again], sigma).missing == -1) > 5
    instead = np.arange(60)
    instead[5::6] -= 1
    assert not gaps_by_run(np.arange(60) / RATE, way[instead], sigma).missing.any()


def test_a_run_in_jerks_shows_no_lost_frames():
    rng = np.random.default_rng(2)
    way = np.cumsum(rng.choice([0.0, 8.0, 16.0], 60))
    assert not gaps_by_run(np.arange(60) / RATE, way, np.full(60, 0.05)).shown.any()


def test_a_slow_body_copied_by_the_codec_is_no_doubled_frame():
    way, sigma = run(3, noise=0.02)
    way[:4] = 0.0, 0.004, 0.0042, 0.55  # true values 0, 0.1, 0.4 and 0.9 px: errors larger than the scatter
    sigma[:3] = 0.0003
    assert not gaps_by_run(np.arange(60) / RATE, way, sigma).missing.any()
