"""Evaluation of bouncing tracks made of exact parabolas: every value, budget and reason of a record."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.records import Track
from rigtwin.measure.drop.evaluate import (
    bounces_of,
    evaluate,
    evaluate_bounces,
    heights_of,
    rate_of,
    readable,
)
from rigtwin.measure.drop.fall_in_air import AirDrag
from rigtwin.measure.media.frame_loss import Loss

G = 9.81
RATE = 240.0  # [1/s]
RELEASED = 0.05  # [s]
HEIGHT = 0.25  # [m]
FAST = math.sqrt(2 * G * HEIGHT)  # [m/s], at the first contact
NOISE = 2e-5  # [m]
HEAVY = {"bead_diameter": 0.006, "bead_density": 7800.0}
RANDOM = 3


def bouncing(speeds=(0.7, 0.49, 0.343), *, along=None, noise=NOISE, seed=RANDOM, until=None, scale=1.0):
    """A fall from `HEIGHT` and a flight for each speed [FAST] after a contact; `along` [m/s] is the speed of each."""
    contacts = [RELEASED + FAST / G]
    for speed in speeds:
        contacts.append(contacts[-1] + 2 * speed * FAST / G)
    time = np.arange(0, contacts[-1] - 0.01 if until is None else until, 1 / RATE)
    height = HEIGHT - G / 2 * np.maximum(time - RELEASED, 0) ** 2
    for contact, speed in zip(contacts, speeds, strict=False):
        since = time - contact
        height = np.where(since > 0, speed * FAST * since - G / 2 * since**2, height)
    x = np.zeros(len(time))
    for begins, ends, speed in zip(
        [0.0, *contacts], [*contacts, math.inf], along or [0.0] * (len(speeds) + 1), strict=False
    ):
        x += speed * np.clip(time - begins, 0, ends - begins)
    place = scale * np.column_stack([x, height]) + noise * np.random.default_rng(seed).normal(size=(len(time), 2))
    return Track(time, place, np.full(len(time), noise))


def pick(found, quantity, method=None, bounce=None):
    (one,) = (
        each for each in found.quantities
        if each.quantity == quantity and method in (None, each.method) and bounce in (None, each.detail.get("bounce"))
    )  # fmt: skip
    return one


def evaluated(track, *, scale_uncertainty=0.0, repeats=0, losses=(), side=None):
    drag = AirDrag(0.006, 7800.0)
    bounces = bounces_of(track, drag, "bead")
    more = {"scale_uncertainty": scale_uncertainty, "rate": RATE, "repeats": repeats, "losses": losses}
    return evaluate_bounces(track, bounces, side=side, **more), bounces


def test_each_bounce_has_its_restitution_by_three_methods_and_its_impact():
    found = evaluate(bouncing(), **HEAVY)
    listed = [(one.quantity, one.method, one.unit, one.detail.get("bounce")) for one in found.quantities]
    assert listed == [
        ("restitution_wall", "height", "1", 1), ("restitution_wall", "velocity", "1", 1),
        ("restitution_wall", "height", "1", 2), ("restitution_wall", "velocity", "1", 2),
        ("restitution_wall", "time", "1", 2),
        ("restitution_wall", "height", "1", 3), ("restitution_wall", "velocity", "1", 3),
        ("restitution_wall", "time", "1", 3),
        ("drop_height", "height", "m", None),
        *[("rebound_height", "height", "m", bounce) for bounce in (1, 2, 3)],
    ]  # fmt: skip
    for one in found.quantities:
        assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))
        assert not one.doubtful
        bounce = one.detail.get("bounce", 0)
        if one.unit == "m":
            assert one.value == pytest.approx(HEIGHT * 0.49**bounce, rel=0.004)
            assert "scale" not in one.budget
            continue
        assert one.value == pytest.approx(0.7, abs=0.003)
        assert one.detail["impact_speed_m_s"] == pytest.approx(FAST * 0.7 ** (bounce - 1), rel=0.003)
        contact = RELEASED + FAST / G * (1 + 2 * sum(0.7**k for k in range(1, bounce)))
        assert one.detail["contact_time_s"] == pytest.approx(contact, abs=2e-4)
    assert [check.check for check in found.checks] == [
        "gravity", "flight_residuals", "out_of_plane", "first_fall", "frame_timing"
    ]  # fmt: skip
    assert all(check.passed for check in found.checks)


def test_heights_and_speeds_of_a_record_in_other_units_are_in_these_units():
    plain, large = evaluate(bouncing(noise=1e-6)), evaluate(bouncing(noise=1e-6, scale=3.0))
    for name, bounce in (("drop_height", None), ("rebound_height", 1), ("rebound_height", 2)):
        assert pick(large, name, bounce=bounce).value == pytest.approx(
            3 * pick(plain, name, bounce=bounce).value, rel=1e-3
        )
    for method in ("height", "velocity"):
        one, other = (pick(each, "restitution_wall", method, 1) for each in (plain, large))
        assert other.value == pytest.approx(one.value, rel=1e-3)
        assert other.detail["impact_speed_m_s"] == pytest.approx(3 * one.detail["impact_speed_m_s"], rel=1e-3)


def test_the_impact_speed_has_the_uncertainty_of_the_fit():
    found, bounces = evaluated(bouncing(noise=2e-4))
    _, parts = bounces.read(lambda at: at.impact_speed(2) * at.size)
    detail = pick(found, "restitution_wall", "velocity", 2).detail
    assert detail["impact_speed_std_m_s"] == pytest.approx(math.hypot(*parts.values()), abs=1e-6)
    assert detail["impact_speed_std_m_s"] > 1e-4


def test_the_clock_of_the_frames_adds_to_the_ratio_of_flight_times():
    found, _ = evaluated(bouncing())
    for bounce in (2, 3):
        one = pick(found, "restitution_wall", "time", bounce)
        before = 2 * 0.7 ** (bounce - 1) * FAST / G  # [s], the flight before the bounce
        # (t2 - t1) / (t1 - t0), each contact known to a hundredth of a frame
        per_time = math.hypot(1, 1 + 0.7, 0.7) / before
        assert one.budget["frame times"] == pytest.approx(0.01 / RATE * per_time, rel=0.01)
    assert "frame times" not in pick(found, "restitution_wall", "velocity", 2).budget


def test_the_scale_adds_to_heights_in_proportion_and_to_no_ratio():
    found, _ = evaluated(bouncing(), scale_uncertainty=0.02)
    for one in found.quantities:
        if one.unit == "m":
            assert one.budget["scale"] == pytest.approx(0.02 * one.value)
            assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))
        else:
            assert "scale" not in one.budget


def slope_sigma(count):
    """Standard uncertainty [m/s] of the speed over this number of frames with `NOISE`."""
    return NOISE * RATE / math.sqrt((count**3 - count) / 12)


def test_the_total_speed_along_and_across_the_plate_has_the_uncertainties_of_both():
    across, along = (1.0, 0.7, 0.49, 0.343), (3.0, 2.5, 2.0, 1.5)
    found = evaluate(bouncing(along=along), **HEAVY)
    assert not next(check for check in found.checks if check.check == "out_of_plane").passed
    for bounce in (1, 2, 3):
        one = pick(found, "restitution_wall", "picture plane", bounce)
        before, after = (math.hypot(across[k] * FAST, along[k]) for k in (bounce - 1, bounce))
        assert one.value == pytest.approx(after / before, rel=0.004)
        assert one.doubtful == "seen from one side: motion along the line of sight is not measured"
        counts = [
            (1.0 if k == 0 else 2 * across[k]) * FAST / G * RATE for k in (bounce - 1, bounce)
        ]  # since the release
        parts = (along[bounce] * slope_sigma(counts[1]) / (after * before),
                 after * along[bounce - 1] * slope_sigma(counts[0]) / before**3)  # fmt: skip
        assert one.budget["along the plate"] == pytest.approx(math.hypot(*parts), rel=0.25)
        assert one.unit == "1"
    height = pick(found, "restitution_wall", "height", 1)
    assert "sideways speed" in height.doubtful
    assert "sideways speed" in pick(found, "restitution_wall", "time", 2).doubtful
    assert "sideways speed" in pick(found, "rebound_height", bounce=1).doubtful
    assert not pick(found, "restitution_wall", "velocity", 1).doubtful


def test_two_views_add_both_directions_along_the_plate():
    front = bouncing(along=(0.3, 0.6, 0.5, 0.4))
    side = bouncing(along=(0.4, 0.8, 0.7, 0.3), seed=5)
    found = evaluate(front, side=side, **HEAVY)
    across = (1.0, 0.7, 0.49, 0.343)
    for bounce in (1, 2, 3):
        both = pick(found, "restitution_wall", "all directions", bounce)
        flat = pick(found, "restitution_wall", "picture plane", bounce)
        speeds = [(across[k] * FAST, (0.3, 0.6, 0.5, 0.4)[k], (0.4, 0.8, 0.7, 0.3)[k]) for k in (bounce - 1, bounce)]
        assert both.value == pytest.approx(math.hypot(*speeds[1]) / math.hypot(*speeds[0]), rel=0.004)
        assert flat.value == pytest.approx(math.hypot(*speeds[1][:2]) / math.hypot(*speeds[0][:2]), rel=0.004)
        assert not both.doubtful
        assert both.budget["along the plate"] > 0


def test_a_body_whose_spin_lifts_it_gains_no_restitution():
    speeds = (0.5, 0.55, 0.3)
    front = bouncing(speeds, along=(0.0, 0.8, 0.5, 0.4))
    side = bouncing(speeds, along=(0.0, 0.9, 0.6, 0.4), seed=5)
    found = evaluate(front, side=side, **HEAVY)
    for bounce in (1, 2, 3):
        for method in ("height", "velocity"):
            assert ("its spin adds" in pick(found, "restitution_wall", method, bounce).doubtful) == (bounce == 2)
        assert "above 1" not in pick(found, "rebound_height", bounce=bounce).doubtful
        assert "its spin adds" not in pick(found, "restitution_wall", "all directions", bounce).doubtful


@pytest.mark.parametrize(("speeds", "wrong_from"), [((0.7, 0.8, 0.5), 1), ((1.1, 0.6, 0.4), 0), ((0.7, 0.6, 0.4), 9)])
def test_a_gain_spoils_the_bounce_before_and_all_that_follow(speeds, wrong_from):
    found = evaluate(bouncing(speeds), **HEAVY)
    gain = "a restitution above 1 is not possible: the track is wrong there"
    for one in found.quantities:
        assert (gain in one.doubtful) == (one.detail.get("bounce", 0) >= wrong_from)


def test_a_wrong_scale_leaves_ratios_of_heights_and_times_and_no_known_drag():
    for wrong, unknown in ((1.06, False), (1.15, True)):
        track = bouncing(scale=wrong)
        found = evaluate(track)
        assert not next(check for check in found.checks if check.check == "gravity").passed
        by_speed = pick(found, "restitution_wall", "velocity", 1)
        drag = "the air drag is not known, as scale or frame rate contradict gravity"
        assert by_speed.doubtful == (drag if unknown else "")
        assert not pick(found, "restitution_wall", "height", 1).doubtful
        assert "free flight gives g" in pick(found, "drop_height").doubtful
        assert "free flight gives g" in pick(found, "rebound_height", bounce=2).doubtful


def test_losses_that_are_not_certain_make_heights_doubtful():
    track = bouncing()
    losses = (Loss(40, 2, float(track.time[40]), 2 / RATE, False, sure=False),)
    found, _ = evaluated(track, losses=losses)
    timing = next(check for check in found.checks if check.check == "frame_timing")
    assert not timing.passed
    assert timing.message.rstrip(".") in pick(found, "drop_height").doubtful
    assert timing.message.rstrip(".") in pick(found, "restitution_wall", "velocity", 1).doubtful


def test_points_that_are_missing_and_frames_that_repeat_are_left_out():
    track = bouncing(noise=0.0)
    holed = track.position.copy()
    holed[[30, 60], [0, 1]] = np.nan
    kept, repeats, losses, fitted = readable(replace(track, position=holed), AirDrag())
    assert len(kept.time) == len(track.time) - 2
    assert not {float(track.time[30]), float(track.time[60])} & set(kept.time.tolist())
    assert (repeats, losses) == (0, ())
    assert fitted is not None
    assert fitted.count == 3
    shown = np.arange(len(track.time)) // 2 * 2  # every frame twice
    kept, repeats, _, _ = readable(replace(track, position=track.position[shown]), AirDrag())
    assert repeats > 0.3 * len(track.time)
    assert len(kept.time) + repeats == len(track.time)


def test_the_frame_rate_is_that_of_the_usual_interval():
    time = np.array([0.0, 0.01, 0.02, 0.05, np.nan, 0.07, 0.08])
    assert rate_of(Track(time, np.zeros((7, 2)), time)) == pytest.approx(100)
    assert rate_of(Track(time[:2], np.zeros((2, 2)), time[:2])) == pytest.approx(100)
    assert math.isnan(rate_of(Track(time[:1], np.zeros((1, 2)), time[:1])))


def test_a_known_drag_is_fitted_where_the_scale_contradicts_it():
    heavy = AirDrag(0.006, 7800.0)
    for scale, same in ((1.1, True), (1.3, False)):
        track = bouncing(scale=scale, noise=1e-6)
        used = bounces_of(track, heavy, "bead", in_metres=True)
        assert used.model.drag.known == same
        assert bounces_of(track, heavy, "bead").model.drag.known


def test_heights_of_a_film_keep_the_position_across():
    track = bouncing(along=(0.3, 0.4, 0.5, 0.6))
    across = heights_of(track, filmed=True).across
    assert across is not None
    assert (across == track.position[:, 0]).all()
    assert heights_of(track).across is None
    assert (heights_of(track).height == track.position[:, 1]).all()


BEAD_AT = ", or state the bead with --bead-at frame:x,y"


@pytest.mark.parametrize("filmed", [False, True])
@pytest.mark.parametrize(
    ("until", "move", "why"),
    [
        (12 / RATE, 1.0, "the bead has 12 positions, more than 12 are needed; give a record in which it falls and "
                         "bounces{bead}."),
        (13 / RATE, 0.0, "what was followed from 0.000 to 0.050 s moves up and down by {times:.1f} times the noise of "
                         "its position, more than 12 are needed; give a record in which the bead falls and "
                         "bounces{bead}."),
        (48 / RATE, 1.0, "what was followed from 0.000 to 0.196 s is highest at {top:.3f} s and lowest at 0.196 s, and "
                         "no turn from falling to rising was found in its track; record it until it has bounced at "
                         "least once, turn a film that lies on its side, move --end{bead}."),
    ],
)  # fmt: skip
def test_a_track_without_a_bounce_is_refused_with_what_it_shows(until, move, why, filmed):
    track = bouncing(until=until - 0.5 / RATE)
    track = replace(
        track, position=track.position * [1, move] + (1 - move) * 1e-4 * np.sin(np.arange(len(track.time)))[:, None]
    )
    with pytest.raises(NothingToMeasure) as refusal:
        bounces_of(track, AirDrag(), "r01", filmed=filmed)
    message = str(refusal.value)
    times = float(message.partition(" times the noise")[0].rpartition(" ")[2]) if "{times" in why else 0.0
    top = float(track.time[np.argmax(track.position[:, 1])])
    assert message == "r01: " + why.format(bead=BEAD_AT if filmed else "", times=times, top=top)
    assert times < 12


def test_turns_without_flights_beside_them_are_listed():
    time = np.arange(60) / RATE
    zigzag = 0.02 * np.abs((np.arange(60) / 5 + 0.5) % 2 - 1)
    with pytest.raises(NothingToMeasure) as refusal:
        bounces_of(Track(time, np.column_stack([0 * time, zigzag]), np.full(60, 1e-5)), AirDrag(), "r01")
    message = str(refusal.value)
    assert message.startswith("r01: the track from 0.000 to 0.246 s turns from falling to rising at 0.0")
    assert " ... s, but no two flights of at least five positions" in message
    assert "could be fitted to its 60 positions (0 frames between them show none)" in message
