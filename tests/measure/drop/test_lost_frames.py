"""Bounces of known restitution whose record has a lost or doubled frame, or begins too late."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.records import Track
from rigtwin.measure.drop import evaluate as drop
from rigtwin.measure.drop.lost_frames import ODD, _torn_at
from rigtwin.measure.media.frame_loss import Loss, in_time

G = 9.81
RELEASE = 0.03  # [s]


def heights(times, *, drop_height, restitution, lasting=0.0):
    """Heights [m] of a bead without air drag that rests, falls and bounces; `lasting` [s] is the contact time."""
    fall = math.sqrt(2 * drop_height / G)
    found = np.where(times < RELEASE, drop_height, drop_height - G / 2 * (times - RELEASE) ** 2)
    begun, speed = RELEASE + fall, G * fall
    while begun < times[-1] and speed > 0.05:  # [m/s]: flights grow shorter without end
        since = times - begun
        if lasting > 0:
            share = np.clip(since / lasting, 0, 1)
            slowed = share * (1 - share) * ((1 - share) - restitution * share)
            found = np.where(since > 0, -speed * lasting * slowed, found)
            since = since - lasting
            begun += lasting
        speed *= restitution
        found = np.where(since > 0, speed * since - G / 2 * since**2, found)
        begun += 2 * speed / G
    return found


def contact(number, *, drop_height, restitution):
    """Time of a contact [s]."""
    fall = math.sqrt(2 * drop_height / G)
    return RELEASE + fall * (1 + 2 * sum(restitution**k for k in range(1, number)))


def record(kept, *, rate, duration, seed, drop_height=0.2, restitution=0.7, towards=0.0, kicked=(1, 0.0), noise=5e-5):
    """A track of the frames chosen by `kept`, with time stamps as if none were missing.

    `towards` [m/s] is the speed towards the camera; `kicked` is the bounce after which the bead drifts out of the
    plane, and the drift [m/s] of its apparent height.
    """
    times = np.arange(round(duration * rate)) / rate
    off = np.maximum(times - contact(1, drop_height=drop_height, restitution=restitution), 0.0) * towards
    y = heights(times, drop_height=drop_height, restitution=restitution) * (1 + off / 1.5) - 0.03 * off
    bounce, drift = kicked
    y += drift * np.maximum(times - contact(bounce, drop_height=drop_height, restitution=restitution), 0.0)
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


FILMS = ((60.0, 1), (240.0, 1), (240.0, 2), (1000.0, 3))  # [1/s], and how many are lost
PLACES = (0.17, 0.3, 0.46, 0.66)  # [s]: in the fall, the first flight and the second


@pytest.mark.parametrize(
    ("rate", "lost", "place"),
    [
        pytest.param(*one, place, marks=() if (k + n) % 4 in ((0, 1) if one[0] < 1000 else (3,)) else pytest.mark.slow)
        for k, one in enumerate(FILMS)
        for n, place in enumerate(PLACES)
    ],
)
def test_a_frame_lost_in_flight_is_corrected_and_reported(rate, lost, place):
    result = drop.evaluate(record(without(round(place * rate), lost), rate=rate, duration=0.85, seed=round(rate)))
    assert f"{lost} frame" in check(result, "frame_timing").message
    assert "time stamps do not show" in check(result, "frame_timing").message
    assert not [check.check for check in result.checks if not check.passed]
    assert all(abs(far) < 3.5 and not reason for far, reason in off(result))
    height = next(each for each in result.quantities if each.quantity == "drop_height")
    assert abs(height.value - 0.2) < 3.5 * height.std_uncertainty


def contact_times(result):
    """Contact times [s]."""
    return [
        each.detail["contact_time_s"]
        for each in result.quantities
        if each.quantity == "restitution_wall" and each.method == "velocity"
    ]


@pytest.mark.parametrize("bounce", [2, 3])
@pytest.mark.parametrize("beside", [-1, 0, 1])
def test_a_frame_lost_at_an_inner_contact_is_corrected(bounce, beside):
    gone = round(contact(bounce, drop_height=0.2, restitution=0.7) * 240) + beside
    result = drop.evaluate(record(without(gone), rate=240.0, duration=1.0, seed=bounce))
    assert "1 frame lost" in check(result, "frame_timing").message
    assert check(result, "frame_timing").passed
    assert all(abs(far) < 3.5 for far, _ in off(result))


@pytest.mark.parametrize("beside", [-1, 0, 1])
def test_a_frame_lost_at_the_first_contact_makes_all_quantities_doubtful(beside):
    gone = round(contact(1, drop_height=0.2, restitution=0.7) * 240) + beside
    result = drop.evaluate(record(without(gone), rate=240.0, duration=1.0, seed=1))
    timing = check(result, "frame_timing")
    assert not timing.passed
    assert "1 frame lost at about 0.2" in timing.message
    assert "kicked sideways" in timing.message
    assert all(timing.message.rstrip(".") in each.doubtful for each in result.quantities)


@pytest.mark.parametrize("bounce", [1, 2, 3])
@pytest.mark.parametrize("drift", [0.0084, -0.0084, 0.0168, 0.004])  # [m/s]: the first three step as a lost frame does
@pytest.mark.parametrize("duration", [0.86, 1.0])  # [s]: three bounces and a little, so that the fourth is seen; five
def test_a_bead_that_is_kicked_sideways_is_not_taken_for_a_lost_frame(bounce, drift, duration):
    result = drop.evaluate(record(whole, rate=240.0, duration=duration, seed=bounce, kicked=(bounce, drift)))
    assert all(abs(far) < 3 or reason for far, reason in off(result))
    meant = [contact(k + 1, drop_height=0.2, restitution=0.7) for k in range(len(contact_times(result)))]
    assert contact_times(result) == pytest.approx(meant, abs=0.6e-3)  # a frame is 4.2 ms


@pytest.mark.parametrize("drop_height", [0.2, 0.3])
@pytest.mark.parametrize("lasting", [0.005, 0.01])  # [s]
def test_a_long_contact_does_not_change_the_times(lasting, drop_height):
    times = np.arange(216) / 240
    y = heights(times, drop_height=drop_height, restitution=0.5, lasting=lasting)
    seen = np.stack([0.01 * times, y], axis=1) + np.random.default_rng(4).normal(0, 5e-5, (len(times), 2))
    result = drop.evaluate(Track(times, seen, np.full(len(times), 5e-5)))
    assert "after the correction" not in check(result, "frame_timing").message
    apart = np.diff(contact_times(result))[:1]
    meant = math.sqrt(2 * drop_height / G) + lasting
    assert apart == pytest.approx(np.full(len(apart), meant), abs=1e-3)  # a frame is 4.2 ms


def test_lost_frames_in_several_places_are_reported_in_the_times_of_the_record():
    times_gone = (0.3, 0.6)
    gone = [round(time * 240) for time in times_gone]
    kept = without(gone[0])
    result = drop.evaluate(
        record(lambda count: [k for k in kept(count) if k != gone[1]], rate=240.0, duration=0.85, seed=9)
    )
    message = check(result, "frame_timing").message
    assert f"at {gone[0] / 240:.3f} s" in message
    assert f"at {(gone[1] - 1) / 240:.3f} s" in message
    assert all(abs(far) < 3.5 and not reason for far, reason in off(result))


def test_a_time_shift_does_not_depend_on_the_frame_interval_of_the_film():
    """A film of 120 frames per second with doubled frames: the track has every second frame only."""
    loss = Loss(index=12, frames=1, time=0.2, shift=1 / 60, at_contact=False)
    film = np.arange(40) / 120
    moved = in_time(film, (replace(loss, index=24),))
    assert moved[:24] == pytest.approx(film[:24])
    assert moved[24:] == pytest.approx(film[24:] + 1 / 60)
    assert in_time(film, (replace(loss, sure=False),)) == pytest.approx(film)


@pytest.mark.parametrize("points", [0, 1, 8])
def test_a_track_with_too_few_points_is_refused(points):
    few = np.arange(points) / 240
    blank = Track(few, np.zeros((points, 2)), np.full(points, 5e-5))
    with pytest.raises(NothingToMeasure):
        drop.evaluate(blank)
    with pytest.raises(NothingToMeasure):
        drop.evaluate(Track(np.arange(90) / 240, np.full((90, 2), np.nan), np.full(90, 5e-5)))


def test_a_doubled_frame_is_corrected():
    result = drop.evaluate(record(twice(60), rate=240.0, duration=0.85, seed=5))
    assert "1 frame shown twice" in check(result, "frame_timing").message
    assert all(abs(far) < 3.5 for far, _ in off(result))


def test_a_frame_lost_in_a_record_of_two_contacts_makes_all_quantities_doubtful():
    """A single step of the plate between two contacts may also be due to a bead that leaves the plane."""
    gone = round(contact(1, drop_height=0.2, restitution=0.7) * 240)
    result = drop.evaluate(record(without(gone), rate=240.0, duration=0.7, seed=7))
    assert not check(result, "frame_timing").passed
    assert all("level plate" in each.doubtful for each in result.quantities)


@pytest.mark.parametrize("towards", [0.0, 0.1, -0.2, 0.25])
def test_motion_towards_or_away_from_the_camera_is_no_lost_frame(towards):
    for seed in range(3):
        result = drop.evaluate(record(whole, rate=240.0, duration=1.0, seed=seed, towards=towards))
        assert check(result, "frame_timing").passed
        assert "lost" not in check(result, "frame_timing").message


@pytest.mark.parametrize("bounce", [1, 2, 3])
@pytest.mark.parametrize("towards", [0.25, -0.2])
def test_a_frame_lost_at_a_contact_of_an_approaching_bead_is_corrected(bounce, towards):
    gone = round(contact(bounce, drop_height=0.2, restitution=0.7) * 240)
    result = drop.evaluate(record(without(gone), rate=240.0, duration=1.0, seed=bounce, towards=towards))
    assert "1 frame lost" in check(result, "frame_timing").message
    assert all(abs(far) < 3.5 for far, _ in off(result))
    assert contact_times(result)[:3] == pytest.approx(
        [contact(k, drop_height=0.2, restitution=0.7) for k in (1, 2, 3)], abs=0.6e-3
    )


@pytest.mark.parametrize("bounce", [1, 2])
def test_a_lost_frame_that_growth_may_explain_is_not_corrected_silently(bounce):
    """Three contacts give two steps, which a drift and a lost frame can always explain."""
    gone = round(contact(bounce, drop_height=0.2, restitution=0.7) * 240)
    result = drop.evaluate(record(without(gone), rate=240.0, duration=0.75, seed=3, towards=0.1))
    assert all(abs(far) < 3 or reason for far, reason in off(result))
    assert "1 frame lost" in check(result, "frame_timing").message


@pytest.mark.parametrize("seed", range(4))
def test_an_irregularity_below_half_a_frame_at_a_contact_is_no_frame_shown_twice(seed):
    seen = record(whole, rate=240.0, duration=0.9, seed=seed)
    later = seen.time > contact(3, drop_height=0.2, restitution=0.7)
    assert check(drop.evaluate(replace(seen, time=seen.time - 0.4 / 240 * later)), "frame_timing").passed


def test_a_cause_of_uneven_contacts_is_looked_for_where_chance_is_none():
    from scipy.stats import chi2

    assert chi2.sf(ODD, 1) == pytest.approx(1e-3, rel=0.05)


@pytest.mark.parametrize("towards", [0.25, -0.25])
def test_low_flights_without_visible_growth_pass_the_timing_check(towards):
    for seed in range(3):
        seen = record(
            whole, rate=240.0, duration=0.75, seed=seed, drop_height=0.115, restitution=0.635, towards=towards
        )
        assert check(drop.evaluate(seen), "frame_timing").passed


def test_a_record_that_begins_as_the_bead_rises_makes_heights_doubtful():
    whole_record = record(whole, rate=240.0, duration=1.0, seed=1)
    begins = whole_record.time > contact(1, drop_height=0.2, restitution=0.7) + 0.01
    late = Track(whole_record.time[begins], whole_record.position[begins], whole_record.sigma[begins])
    result = drop.evaluate(late)
    assert "rises from a bounce" in check(result, "first_fall").message
    assert all("rises from a bounce" in each.doubtful for each in result.quantities if each.unit == "m")
    assert check(drop.evaluate(whole_record), "first_fall").passed


def test_an_occluded_fall_makes_all_quantities_doubtful():
    """The bead is released, then occluded until it has bounced."""
    made = record(whole, rate=240.0, duration=1.0, seed=2)
    seen = (made.time < RELEASE + 0.06) | (made.time > contact(1, drop_height=0.2, restitution=0.7) + 0.08)
    result = drop.evaluate(Track(made.time[seen], made.position[seen], made.sigma[seen]))
    assert not check(result, "first_fall").passed
    assert all(each.doubtful for each in result.quantities)


@pytest.mark.parametrize(("frames", "words"), [(1, "1 frame lost"), (3, "3 frames lost"), (-2, "2 frames shown twice")])
def test_a_loss_is_described_with_the_number_of_frames(frames, words):
    assert Loss(8, frames, 0.2, 0.0, False).in_words == words


def test_a_loss_within_a_flight_of_more_frames_than_are_tried_is_found(monkeypatch):
    monkeypatch.setattr("rigtwin.measure.drop.lost_frames.MOST_PLACES", 250)
    lost, place, rate = 3, 500, 1e4
    true = np.delete(np.arange(1000), np.s_[place : place + lost]) / rate
    shown = np.arange(len(true)) / rate
    found = _torn_at(shown, 0.05 - 4.905 * true**2, 2, 1e-9, 2)
    assert found is not None
    assert abs(found[0] - place) <= 5
    assert found[1] == lost
