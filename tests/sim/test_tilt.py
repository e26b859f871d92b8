"""Tilting plate: onset at the angle of friction, then the closed forms of sliding and rolling."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.compare.twins.tilt import tilt_twin
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import GRAVITY, Tilt
from rigtwin.sim import tilt

D6 = hlosta2020.particle("D6")
STEEL = hlosta2020.material("steel")
FAST = math.radians(5)  # [rad/s]


def in_the_plate(series, track):
    """Position along the plate and height above it [m]."""
    cosine, sine = np.cos(series.value), np.sin(series.value)
    x, y = track.position.T
    return x * cosine + y * sine, y * cosine - x * sine


def onset_of(series, way) -> float:
    """Angle [rad] at which the body has moved 0.1 mm."""
    return float(series.value[np.flatnonzero(way < way[0] - 1e-4)[0]])


@pytest.mark.parametrize("mu", [0.13, 0.36, 0.8])
def test_a_block_slides_when_the_tangent_is_the_friction(mu):
    rig = Tilt("slide", speed=FAST)
    series, track = tilt.run(rig, D6, STEEL, Contact(0.42, mu, 0.06), frame_rate=240)
    way, height = in_the_plate(series, track)
    # the plate keeps turning while the body moves 0.1 mm: s = g speed t^3 / (6 cos)
    late = FAST * (6 * 1e-4 / (GRAVITY * FAST)) ** (1 / 3)
    assert math.atan(mu) < onset_of(series, way) < math.atan(mu) + 2 * late
    assert height == pytest.approx(D6.radius, abs=2e-5)
    assert series.quantity == "plate_angle"
    assert series.value[-1] > math.atan(mu)


@pytest.mark.parametrize("rolling", ["type A", "type C"])
@pytest.mark.parametrize("mu_r", [0.06, 0.14])
def test_a_sphere_rolls_when_the_tangent_is_the_rolling_friction(mu_r, rolling):
    rig = Tilt("roll", speed=FAST)
    series, track = tilt.run(rig, D6, STEEL, Contact(0.42, 0.36, mu_r), frame_rate=240, rolling=rolling)
    way, _height = in_the_plate(series, track)
    late = FAST * (6 * 1e-4 / (5 / 7 * GRAVITY * FAST)) ** (1 / 3)
    assert math.atan(mu_r) < onset_of(series, way) < math.atan(mu_r) + 2 * late


def test_after_the_onset_the_block_follows_newton():
    mu = 0.36
    series, track = tilt.run(Tilt("slide", speed=FAST), D6, STEEL, Contact(0.42, mu), frame_rate=240)
    way, _height = in_the_plate(series, track)
    # integrate g (sin - mu cos) twice from the onset on
    angle = np.linspace(math.atan(mu), float(series.value[-1]), 20_001)
    step = (angle[1] - angle[0]) / FAST
    speed = np.concatenate([[0], np.cumsum(GRAVITY * (np.sin(angle) - mu * np.cos(angle))) * step])[:-1]
    gone = np.cumsum(speed) * step
    expected = np.interp(series.value, angle, gone, left=0.0)
    assert way[0] - way == pytest.approx(expected, abs=2e-3 * expected[-1])


def test_a_record_begins_at_rest_and_ends_on_the_plate():
    series, track = tilt.run(Tilt("roll", speed=FAST), D6, STEEL, Contact(0.42, 0.36, 0.06), frame_rate=100)
    assert np.array_equal(series.time, track.time)
    assert np.all(series.value[:6] == 0)
    assert np.ptp(track.position[:6], axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert track.position[0] == pytest.approx([0.1, D6.radius], abs=1e-5)
    way, _height = in_the_plate(series, track)
    assert 0 <= way[-1] < 0.02


def test_a_glued_clump_slides_at_the_same_angle_and_does_not_roll():
    contact = hlosta2020.contact("C6", "steel")
    series, track = tilt.run(Tilt("slide", speed=FAST), hlosta2020.particle("C6"), STEEL, contact, frame_rate=240)
    way, _height = in_the_plate(series, track)
    assert math.tan(onset_of(series, way)) == pytest.approx(contact.static_friction, abs=0.02)


def test_a_pellet_across_the_plate_rolls_at_its_rolling_friction_and_a_cube_does_not_roll():
    mu_r, rig = 0.08, Tilt("roll", speed=FAST, start_angle=math.radians(2))
    series, track = tilt.run(rig, hlosta2020.particle("P6x15"), STEEL, Contact(0.3, 0.5, mu_r), frame_rate=120)
    way, height = in_the_plate(series, track)
    assert height == pytest.approx(3e-3, abs=5e-5)
    # the acceleration of a cylinder is below that of a ball: 2/3 of gravity along the plate
    late = FAST * (6 * 1e-4 / (2 / 3 * GRAVITY * FAST)) ** (1 / 3)
    assert math.atan(mu_r) < onset_of(series, way) < math.atan(mu_r) + 2.5 * late
    # rolls without slipping from there to the hinge
    assert way[-1] < 0.02
    rig = Tilt("roll", speed=FAST, start_angle=math.radians(8))
    cube = tilt.run(rig, hlosta2020.particle("C6_8s-b"), STEEL, Contact(0.3, 0.25, mu_r), frame_rate=120)
    assert onset_of(cube[0], in_the_plate(*cube)[0]) == pytest.approx(math.atan(0.25), abs=2.5 * late)


def test_an_effect_that_does_not_act_on_a_rolling_pellet_is_named():
    rig, effects = Tilt("roll", speed=FAST, start_angle=math.radians(4)), {"air_drag": {}}
    pellet, contact = hlosta2020.particle("P6x15"), Contact(0.3, 0.5, 0.08)
    in_air = tilt_twin(rig, pellet, STEEL, contact, frame_rate=120, effects=effects)
    (said,) = in_air.warnings
    assert said.startswith("the model's air_drag had no part")
    plain = tilt.run(rig, pellet, STEEL, contact, frame_rate=120)
    assert np.array_equal(in_air.tracks[0].position, plain[1].position)
    assert not tilt.left_out(rig, D6, effects)
    (said,) = tilt.left_out(rig, D6, {"air_drag": {}, "rolling_lever": {}})
    assert said.startswith("the model's rolling_lever had no part")


def test_the_description_of_the_body_is_true():
    pellet, contact = hlosta2020.particle("P6x15"), Contact(0.3, 0.5, 0.08)
    twin = tilt_twin(Tilt("roll", speed=FAST, start_angle=math.radians(4)), pellet, STEEL, contact, frame_rate=120)
    assert "from 4 degrees on" in twin.assumptions[0]
    assert twin.assumptions[1:] == (
        "The body is P6x15, 5 spheres in one piece, and lies with its axis across the plate.",
    )
    assert "axes along and across" in tilt.body_in_words(Tilt("roll"), hlosta2020.particle("C6"))
    assert tilt.body_in_words(Tilt("roll"), D6) == "The bead that rolls is a sphere."
    for body in (D6, pellet):
        assert tilt.body_in_words(Tilt("slide"), body) == "A body that slides does not turn."


def test_a_plate_that_starts_inclined_and_one_that_turns_slowly_agree():
    contact = Contact(0.42, 0.36)
    ends = []
    for rig in (Tilt("slide", speed=FAST), Tilt("slide", speed=FAST, start_angle=math.radians(15))):
        series, track = tilt.run(rig, D6, STEEL, contact, frame_rate=240)
        ends.append(onset_of(series, in_the_plate(series, track)[0]))
    assert ends[0] == pytest.approx(ends[1], abs=FAST / 240 * 1.5)


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        (Tilt("slide", speed=0.0), "speed"),
        (Tilt("slide", plate_length=0.01), "plate_length"),
        (Tilt("slide", start_angle=2.0), "start_angle"),
        (Tilt("tumble"), "variant"),
    ],
)
def test_impossible_plates_are_refused(rig, words):
    with pytest.raises(BadInput, match=words):
        tilt.run(rig, D6, STEEL, Contact(0.42, 0.36), frame_rate=240)


@pytest.mark.parametrize("variant", ["roll", "slide"])
def test_every_sphere_of_the_reference_stays_on_every_wall_until_its_onset(variant):
    # soft ABS and heavy steel sink most into the softened plate, D6_ABS by more than a thousandth of its radius
    rig = Tilt(variant, speed=math.radians(20))
    names = [(bead, wall) for bead in ("D4", "D6", "D12", "D6_ABS", "D5_steel") for wall in hlosta2020.WALLS]
    trials = [
        tilt.Trial(
            rig, hlosta2020.particle(bead), hlosta2020.material(wall), hlosta2020.contact(bead, wall), frame_rate=240
        )
        for bead, wall in names
    ]
    for (bead, wall), trial, (series, track) in zip(names, trials, tilt.run_many(trials), strict=True):
        way, height = in_the_plate(series, track)
        late = rig.speed * (6 * 1e-4 / (5 / 7 * GRAVITY * rig.speed)) ** (1 / 3)
        held = tilt.onset(rig, trial.contact)
        assert held - 1e-3 < onset_of(series, way) < held + 2 * late, (bead, wall)
        assert np.all(np.abs(height - trial.particle.radius) < 5e-3 * trial.particle.radius), (bead, wall)


def test_a_body_that_would_sink_past_its_centre_is_refused():
    jelly = replace(D6, material=replace(D6.material, youngs_modulus=1e3))
    with pytest.raises(BadInput, match=r"youngs_modulus: D6 .* past its centre .* check those"):
        tilt.run(Tilt("slide", speed=FAST), jelly, STEEL, Contact(0.42, 0.36), frame_rate=240)
