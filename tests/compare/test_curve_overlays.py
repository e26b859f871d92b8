"""Overlays: the distance is that of the curves, independent of origin, sampling and side."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rigtwin.compare.curve_overlays import Curve, Overlay, comparable
from rigtwin.compare.report.figures import overlay_figure
from rigtwin.compare.twins.registry import ENTRIES
from rigtwin.lab.materials import Material, Particle
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.records import Profile, Series, Track
from rigtwin.lab.rigs import (
    DropSettings,
    DrumSettings,
    HopperSettings,
    PackingSettings,
    PendulumSettings,
    PileSettings,
    TiltSettings,
)

BEAD = 0.006  # [m]


def measured(**records) -> Measurement:
    return Measurement("it", Path("r01"), "0" * 64, records.pop("quantities", ()), **records)


def twin(tracks=(), profiles=(), series=()):
    return SimpleNamespace(tracks=tracks, profiles=profiles, series=series)


def profile(x, height, **more) -> Profile:
    return Profile(np.asarray(x), np.asarray(height), np.full(len(x), 1e-5), **more)


def overlays(rig, mine, theirs) -> tuple[Overlay, ...]:
    experiment = SimpleNamespace(rig=rig, particle=Particle("bead", Material("ash", 720, 11e9, 0.44), BEAD))
    return comparable(ENTRIES[rig.name].curves(experiment, mine, theirs))


def only(rig, mine, theirs) -> Overlay:
    (shape,) = overlays(rig, mine, theirs)
    return shape


def test_a_heap_that_is_higher_everywhere_lies_as_far_away_as_it_is_higher():
    x = np.linspace(-0.045, 0.045, 301)
    cone = 0.03 - 0.6 * np.abs(x)
    views = tuple(profile(x + shift, cone, base=(shift - 0.045, shift + 0.045)) for shift in (0.0, 0.01))
    higher = profile(np.linspace(-0.045, 0.045, 77), 0.032 - 0.6 * np.abs(np.linspace(-0.045, 0.045, 77)))
    shape = only(PileSettings(0.09), [measured(profiles=views)], [twin(profiles=(higher,))])
    assert shape.distance == pytest.approx(2.0, rel=0.01)  # [mm]
    assert shape.offset == pytest.approx(2.0, rel=0.01)
    assert shape.scatter(shape.measured) == pytest.approx(0.0, abs=1e-6)
    assert shape.row("p")["distance_bead_diameters"] == pytest.approx(1 / 3, rel=0.01)
    assert shape.row("p")["scatter_simulated"] is None


def test_scatter_is_that_of_single_curves_about_their_mean():
    x = np.linspace(-0.03, 0.03, 50)
    beds = [profile(x, np.full(50, level)) for level in (0.1, 0.104)]
    shape = only(PackingSettings(0.065), [measured(profiles=(bed,)) for bed in beds], [twin(profiles=(beds[0],))])
    assert shape.scatter(shape.measured) == pytest.approx(2.0)
    assert shape.offset == pytest.approx(-2.0)


def test_a_discharge_that_takes_a_quarter_longer_lies_apart_by_the_integral_of_the_gap():
    def emptying(lasts, opened, unit):
        time = np.linspace(0, lasts, 60)
        return Series(time + opened, unit * (1 - time / lasts), "left", "1")

    opened = Quantity("opening_time", 0.7, 0.01, "s", "slide")
    film = measured(series=(emptying(1.0, 0.7, 1.0),), quantities=(opened,))
    shape = only(HopperSettings("slot", outlet=0.02), [film], [twin(series=(emptying(1.25, 0.0, 0.142),))])
    # 100 t (1 - 1/1.25) over the first second: 20 / sqrt(3)
    assert shape.distance == pytest.approx(20 / 3**0.5, rel=0.01)
    assert shape.unit == "%"


def test_a_drum_filmed_from_its_other_end_agrees_with_its_twin():
    x = np.linspace(-0.06, 0.06, 200)
    falling = -0.02 - 0.6 * x
    wobble = [profile(x, -falling * 0 + falling[::-1] + 0.001 * np.sin(k)) for k in range(200)]
    shape = only(DrumSettings(0.14, 0.3), [measured(profiles=tuple(wobble))], [twin(profiles=(profile(x, falling),))])
    assert shape.distance < 0.2


def test_bounces_are_aligned_at_the_first_contact_for_any_origin_of_the_record():
    def bounce(start, floor, rate):
        time = np.arange(0, 0.55, 1 / rate)
        fall = 0.35
        before, after = 0.6 - 4.905 * time**2, None
        hit, speed = fall, 9.81 * fall
        after = 0.6 - 4.905 * fall**2 + 0.6 * speed * (time - hit) - 4.905 * (time - hit) ** 2
        height = np.where(time < hit, before, after)
        place = np.stack([np.zeros(len(time)), height + floor], axis=1)
        return (Track(time + start, place, np.full(len(time), 1e-5)),)

    shape = only(DropSettings(0.3), [measured(tracks=bounce(3.0, -0.2, 240))], [twin(tracks=bounce(0.0, 0.0, 300))])
    assert shape.distance < 0.5  # [mm], over a fall of 600
    assert shape.span[1] == pytest.approx(0.2, abs=0.01)


def test_each_bead_of_a_pendulum_has_its_own_curve():
    time = np.arange(0, 1, 1 / 240)

    def swung(amplitude, at):
        angle = np.radians(amplitude) * np.cos(2 * np.pi * time + at)
        place = np.stack([0.2 * np.sin(angle), 0.2 * (1 - np.cos(angle))], axis=1)
        return Track(time, place, np.full(len(time), 1e-5))

    both = (swung(-30, 0.0), swung(20, 0.3))
    shapes = overlays(PendulumSettings(0.2), [measured(tracks=both)], [twin(tracks=both)])
    assert [shape.what for shape in shapes] == ["angle of bead A", "angle of bead B"]
    assert all(shape.distance == pytest.approx(0) and shape.unit == "deg" for shape in shapes)


def test_a_body_that_slides_two_degrees_later_has_a_distance_on_the_plate():
    def slid(onset):
        angle = np.radians(np.linspace(0, 25, 500))
        way = 0.5 * np.maximum(np.degrees(angle) - onset, 0.0) ** 2 * 1e-3
        place = np.stack([(0.1 - way) * np.cos(angle), (0.1 - way) * np.sin(angle)], axis=1)
        time = np.arange(500) / 100
        return {
            "tracks": (Track(time, place, np.full(500, 1e-5)),),
            "series": (Series(time, angle, "plate_angle", "rad"),),
        }

    shape = only(TiltSettings("slide"), [measured(**slid(18))], [twin(**slid(20))])
    at_25 = Curve(shape.simulated[0].x[-1:], shape.simulated[0].y[-1:])
    assert at_25.y[0] == pytest.approx(12.5, rel=0.01)
    assert shape.offset < 0
    assert only(TiltSettings("slide"), [measured(**slid(18))], [twin(**slid(18))]).distance == pytest.approx(0)


def test_gaps_of_a_curve_are_not_filled():
    x = np.linspace(0, 10, 101)
    gap = np.where((x > 4) & (x < 6), np.nan, 0.0)
    step = np.where((x > 4) & (x < 6), 100.0, 1.0)
    shape = Overlay("it", "x", "y", "mm", (Curve(x, gap),), (Curve(x, step),))
    assert shape.distance == pytest.approx(1.0, rel=0.2)


def test_an_experiment_whose_records_do_not_meet_has_no_shape():
    x = np.linspace(-0.03, 0.03, 50)
    bed = profile(x, np.full(50, 0.1))
    assert overlays(PackingSettings(0.065), [measured()], [twin(profiles=(bed,))]) == ()
    apart = profile(x + 1.0, np.full(50, 0.1), base=(-0.03, 0.03))
    assert overlays(PackingSettings(0.065), [measured(profiles=(apart,))], [twin(profiles=(bed,))]) == ()


def test_records_that_overlap_only_where_one_was_not_seen_have_no_shape():
    x = np.linspace(-0.045, 0.045, 301)
    edges = np.where(np.abs(x) > 0.03, 0.01, np.nan)
    middle = np.linspace(-0.02, 0.02, 101)
    mine = measured(profiles=(profile(x, edges, base=(-0.045, 0.045)),))
    theirs = twin(profiles=(profile(middle, np.full(101, 0.02), base=(-0.02, 0.02)),))
    assert overlays(PileSettings(0.09), [mine], [theirs]) == ()


def test_the_figure_names_both_sides():
    x = np.linspace(0, 10, 101)
    shape = Overlay("height", "x", "y", "mm", (Curve(x, x), Curve(x, x + 1)), (Curve(x, x + 3),), to_scale=True)
    drawing = overlay_figure(shape, "height", "Height").svg
    assert "measured, mean of 2" in drawing
    assert "twin" in drawing
