"""Bounces of known restitution whose record lost a frame, shows one twice, or begins too late."""

import math

import numpy as np
import pytest

from rigtwin.lab.records import Track
from rigtwin.measure import drop

G = 9.81
RELEASE = 0.03  # [s]


def heights(times, *, drop_height, restitution):
    """[m], of a bead without air that rests, falls and bounces."""
    fall = math.sqrt(2 * drop_height / G)
    found = np.where(times < RELEASE, drop_height, drop_height - G / 2 * (times - RELEASE) ** 2)
    begun, speed = RELEASE + fall, G * fall
    while begun < times[-1]:
        speed *= restitution
        since = times - begun
        found = np.where(since > 0, speed * since - G / 2 * since**2, found)
        begun += 2 * speed / G
    return found


def contact(number, *, drop_height, restitution):
    """[s]"""
    fall = math.sqrt(2 * drop_height / G)
    return RELEASE + fall * (1 + 2 * sum(restitution**k for k in range(1, number)))


def record(kept, *, rate, duration, seed, drop_height=0.2, restitution=0.7, towards=0.0, noise=5e-5):
    """A track of the frames that `kept` chooses, stored as if none were missing; y of a bead that comes nearer."""
    times = np.arange(round(duration * rate)) / rate
    off = np.maximum(times - contact(1, drop_height=drop_height, restitution=restitution), 0.0) * towards
    y = heights(times, drop_height=drop_height, restitution=restitution) * (1 + off / 1.5) - 0.03 * off
    seen = np.stack([0.01 * times, y], axis=1)[kept(len(times))]
    seen += np.random.default_rng(seed).normal(0, noise, seen.shape)
    return Track(np.arange(len(seen)) / rate, seen, np.full(len(seen), noise))


def without(first, lost=1):
    return lambda count: [k for k in range(count) if not first <= k < first + lost]


def twice(frame):
    return lambda count: sorted([*range(count), frame])[:count]


def whole(count):
    return list(range(count))


def check(result, name):
    return next(each for each in result.checks if each.check == name)


def off(result, truth=0.7):
    """Restitutions at the contacts, in standard uncertainties from the truth, and what makes them doubtful."""
    return [
        ((each.value - truth) / each.std_uncertainty, each.doubtful)
        for each in result.quantities
        if each.quantity == "restitution_wall" and each.method == "velocity"
    ]


@pytest.mark.parametrize(("rate", "lost"), [(60.0, 1), (240.0, 1), (240.0, 2), (1000.0, 3)])
@pytest.mark.parametrize("place", [0.17, 0.3, 0.46, 0.66])  # [s]: in the fall, the first flight and the second
def test_a_frame_lost_in_flight_is_put_back_and_told(rate, lost, place):
    result = drop.evaluate(record(without(round(place * rate), lost), rate=rate, duration=0.85, seed=round(rate)))
    assert f"{lost} frame" in check(result, "frame_timing").message
    assert "do not tell" in check(result, "frame_timing").message
    assert not [check.check for check in result.checks if not check.passed]
    assert all(abs(far) < 3.5 and not doubt for far, doubt in off(result))
    height = next(each for each in result.quantities if each.quantity == "drop_height")
    assert abs(height.value - 0.2) < 3.5 * height.std_uncertainty


@pytest.mark.parametrize("bounce", [1, 2, 3])
@pytest.mark.parametrize("beside", [-1, 0, 1])
def test_a_frame_lost_at_a_contact_is_put_back_for_flights_meet_on_the_plate(bounce, beside):
    gone = round(contact(bounce, drop_height=0.2, restitution=0.7) * 240) + beside
    result = drop.evaluate(record(without(gone), rate=240.0, duration=1.0, seed=bounce))
    assert "1 frame lost" in check(result, "frame_timing").message
    assert all(abs(far) < 3.5 for far, _ in off(result))


def test_a_frame_that_is_shown_twice_moves_what_follows_back():
    result = drop.evaluate(record(twice(60), rate=240.0, duration=0.85, seed=5))
    assert "a frame is shown twice" in check(result, "frame_timing").message
    assert all(abs(far) < 3.5 for far, _ in off(result))


def test_where_two_contacts_alone_tell_of_a_lost_frame_all_is_doubtful():
    """One step of the plate between two contacts might as well be that of a bead that leaves the plane."""
    gone = round(contact(1, drop_height=0.2, restitution=0.7) * 240)
    result = drop.evaluate(record(without(gone), rate=240.0, duration=0.7, seed=7))
    assert not check(result, "frame_timing").passed
    assert all("level plate" in each.doubtful for each in result.quantities)


@pytest.mark.parametrize("towards", [0.0, 0.1, -0.2, 0.25])
def test_nothing_is_lost_where_a_bead_comes_towards_the_camera_or_goes_away(towards):
    for seed in range(3):
        result = drop.evaluate(record(whole, rate=240.0, duration=1.0, seed=seed, towards=towards))
        assert check(result, "frame_timing").passed
        assert "lost" not in check(result, "frame_timing").message


def test_a_record_that_begins_as_the_bead_rises_makes_heights_doubtful():
    whole_record = record(whole, rate=240.0, duration=1.0, seed=1)
    begins = whole_record.time > contact(1, drop_height=0.2, restitution=0.7) + 0.01
    late = Track(whole_record.time[begins], whole_record.position[begins], whole_record.sigma[begins])
    result = drop.evaluate(late)
    assert "rises from a bounce" in check(result, "first_fall").message
    assert all("rises from a bounce" in each.doubtful for each in result.quantities if each.unit == "m")
    assert check(drop.evaluate(whole_record), "first_fall").passed


def test_a_fall_that_is_not_seen_makes_all_doubtful():
    """The bead is let go of, then lost from sight until it has bounced."""
    made = record(whole, rate=240.0, duration=1.0, seed=2)
    seen = (made.time < RELEASE + 0.06) | (made.time > contact(1, drop_height=0.2, restitution=0.7) + 0.08)
    result = drop.evaluate(Track(made.time[seen], made.position[seen], made.sigma[seen]))
    assert not check(result, "first_fall").passed
    assert all(each.doubtful for each in result.quantities)
