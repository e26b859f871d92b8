"""Twins start from the state of the experiment, and their evaluation returns the parameters put in."""

import math
from pathlib import Path

import pytest

from rigtwin.compare.twins import by_name
from rigtwin.compare.twins.drop import drop_twin
from rigtwin.compare.twins.drum import drum_twin
from rigtwin.compare.twins.many_body import Cast
from rigtwin.compare.twins.matched import twin_of
from rigtwin.compare.twins.pendulum import pendulum_twin
from rigtwin.compare.twins.pile import pile_twin
from rigtwin.compare.twins.registry import entry_of
from rigtwin.compare.twins.tilt import tilt_twin
from rigtwin.compare.twins.twin import settings_of
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.materials import Contact
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Drop, DropSettings, Drum, Pendulum, PendulumSettings, Pile, PileSettings, Tilt
from rigtwin.sim.engine import backend

BEAD, STEEL = hlosta2020.particle("D12"), hlosta2020.material("steel")


def experiment(rig, *, frame_rate=240.0, wall=None):
    return Experiment("it", rig, BEAD, wall, Camera(frame_rate=frame_rate), ((Path("r01.mp4"),),))


def measured(name, value, unit, *, frame_rate=240.0, **detail):
    quantity = Quantity(name, value, 0.01, unit, "fit", detail=detail)
    return Measurement("it", Path("r01.mp4"), "0" * 64, (quantity,), camera={"frame_rate_hz": frame_rate})


def values(twin, name):
    return [quantity.value for quantity in twin.evaluation.quantities if quantity.quantity == name]


@pytest.mark.parametrize("restitution", [0.42, 0.85])
def test_a_drop_twin_gives_back_its_restitution_by_every_method_and_bounce(restitution):
    twin = drop_twin(Drop(0.3, bounces=2), BEAD, STEEL, Contact(restitution), frame_rate=240)
    found = values(twin, "restitution_wall")
    assert len(found) >= 2
    assert found == pytest.approx([restitution] * len(found), rel=0.005)
    assert values(twin, "drop_height") == pytest.approx([0.3], rel=1e-3)


def test_a_pendulum_twin_gives_back_its_restitution():
    twin = pendulum_twin(Pendulum(0.2, math.radians(45)), BEAD, Contact(0.7), frame_rate=240)
    assert values(twin, "restitution_pair") == pytest.approx([0.7, 0.7], rel=0.005)
    assert all(check.passed for check in twin.evaluation.checks)


def test_a_warning_says_that_a_pendulum_released_above_its_hinge_is_a_rod():
    right_angle = math.nextafter(math.pi / 2, 4)  # as a conversion of units may round it
    low, high = (
        pendulum_twin(Pendulum(0.2, angle), BEAD, Contact(0.7), frame_rate=1000)
        for angle in (right_angle, math.radians(100))
    )
    assert low.warnings == ()
    assert "100 deg falls on a slack string" in high.warnings[0]


def test_a_drum_twin_that_hardly_turned_gives_only_doubtful_angles():
    contact = Contact(0.6, 0.5, 0.1)
    cast_of_drum = Cast(hlosta2020.particle("D6"), hlosta2020.material("PMMA"), contact, contact)
    twin = drum_twin(Drum(0.05, 3.0, 0.02), cast_of_drum, seed=1, turns=1e-6)
    angles = [quantity for quantity in twin.evaluation.quantities if quantity.unit == "deg"]
    assert len(angles) > 3
    assert all("give more turns" in angle.doubtful for angle in angles)


def test_a_wall_pendulum_twin_gives_back_its_restitution():
    rig = Pendulum(0.2, math.radians(45), "wall")
    twin = pendulum_twin(rig, BEAD, Contact(0.6), frame_rate=480, wall=STEEL)
    assert values(twin, "restitution_wall")
    assert values(twin, "restitution_wall")[0] == pytest.approx(0.6, rel=0.01)


@pytest.mark.parametrize(("variant", "friction"), [("slide", "static_friction"), ("roll", "rolling_friction")])
def test_a_tilt_twin_gives_back_its_friction(variant, friction):
    contact = Contact(0.5, 0.36, 0.06)
    twin = tilt_twin(Tilt(variant), BEAD, STEEL, contact, frame_rate=120)
    assert values(twin, friction)[0] == pytest.approx(getattr(contact, friction), rel=0.01)


def test_an_effect_of_the_model_acts_in_the_twin():
    light = hlosta2020.particle("D4")
    drag = {"air_drag": {"drag_coefficient": 0.5}}
    without, within = (
        drop_twin(Drop(1.0, bounces=1), light, STEEL, Contact(0.7), frame_rate=240, effects=effects)
        for effects in ({}, drag)
    )
    bounced = [max(twin.tracks[0].position[150:, 1]) for twin in (without, within)]
    # the drag's own closed form: falling and rising through the air, heights shrink by the same length scale
    scale = 2 * light.mass / (1.2 * 0.5 * math.pi * light.radius**2)
    fall = scale / 2 * (1 - math.exp(-2 / scale))  # v^2 / (2 g) at the plate
    rise = scale / 2 * math.log(1 + 2 * 0.49 * fall / scale)
    assert bounced[0] - light.radius == pytest.approx(0.49, rel=2e-3)
    assert bounced[1] - light.radius == pytest.approx(rise, rel=5e-3)


def test_a_pile_twin_says_how_many_beads_stayed_and_what_it_assumed():
    contact = Contact(0.5, 0.6, 0.2)
    bead = hlosta2020.particle("D6")
    twin = pile_twin(Pile(0.05, 0.006), Cast(bead, STEEL, contact, contact), count=250, seed=3, threads=1)
    settings = twin.settings
    assert settings["asked"] == 250
    assert settings["engine"] == {"device": "cpu", "threads": 1}
    assert 0 <= settings["fallen"] <= settings["placed"] <= 250
    assert twin.assumptions
    assert len(twin.profiles) >= 2
    assert settings["contacts"]["D6-steel"]["static_friction"] == 0.6


def test_a_twin_reports_the_number_of_threads_it_could_use():
    asked = settings_of(Pile(0.05, 0.006), hlosta2020.particle("D6"), {}, threads=10_000)["engine"]["threads"]
    assert asked == backend.running().threads < 10_000


def test_a_stated_release_angle_takes_precedence_over_the_measured_one():
    rig = PendulumSettings(0.2, release_angle=math.radians(30))
    found = [measured("release_angle", 33.0, "deg", body="A")]
    model = Model().with_contact("D12", "D12", restitution=0.7)
    twin = twin_of(experiment(rig), model=model, measurements=found)
    assert values(twin, "release_angle") == pytest.approx([30], abs=0.05)
    assert twin.set_from == {"release_angle": "stated"}


def test_the_twin_swings_as_long_as_the_film_so_that_every_collision_is_compared():
    from dataclasses import replace

    import numpy as np

    from rigtwin.lab.records import Track

    time = np.arange(0, 1.0, 1 / 240)
    film = Track(time, np.zeros((len(time), 2)), np.zeros(len(time)), "A")
    found = [replace(measured("release_angle", 40.0, "deg", body="A"), tracks=(film,))]
    model = Model().with_contact("D12", "D12", restitution=0.7)
    twin = twin_of(experiment(PendulumSettings(0.2)), model=model, measurements=found)
    collisions = {q.detail.get("collision") for q in twin.evaluation.quantities if q.quantity == "restitution_pair"}
    assert {1, 2} <= collisions


def test_a_drop_that_states_no_height_starts_from_the_mean_of_the_measured_ones():
    model = Model().with_contact("D12", "steel", restitution=0.6)
    found = [measured("drop_height", 0.20, "m"), measured("drop_height", 0.24, "m")]
    twin = twin_of(experiment(DropSettings(), wall=STEEL), model=model, measurements=found)
    assert values(twin, "drop_height") == pytest.approx([0.22], rel=1e-3)
    assert twin.set_from == {"drop_height": "measured"}


def test_the_twin_has_the_measured_frame_rate_where_none_is_stated():
    model = Model().with_contact("D12", "steel", restitution=0.6)
    found = [measured("drop_height", 0.1, "m", frame_rate=1000.0)]
    twin = twin_of(experiment(DropSettings(), frame_rate=None, wall=STEEL), model=model, measurements=found)
    steps = twin.tracks[0].time[1:] - twin.tracks[0].time[:-1]
    assert steps == pytest.approx([1e-3] * len(steps))


def test_a_drop_neither_stated_nor_measured_is_refused_with_the_key_to_add():
    model = Model().with_contact("D12", "steel", restitution=0.6)
    with pytest.raises(BadInput, match=r"drop_height.*lab\.toml"):
        twin_of(experiment(DropSettings(), wall=STEEL), model=model)


@pytest.mark.parametrize(
    ("rig", "frame_rate", "waits"),
    [
        (PileSettings(0.09), None, True),
        (PileSettings(0.09, count=500), None, False),
        (DropSettings(0.3), 240.0, False),
        (DropSettings(0.3), None, True),
        (DropSettings(), 240.0, True),
        (PendulumSettings(0.3, 0.7), 240.0, True),
        (PendulumSettings(0.3), 240.0, True),
    ],
)
def test_a_twin_waits_for_the_measurement_only_where_it_needs_it(rig, frame_rate, waits):
    lab_entry = experiment(rig, frame_rate=frame_rate)
    assert entry_of(lab_entry).needs_measurement(lab_entry) is waits


def test_an_option_replaces_one_parameter_of_a_published_contact_and_leaves_the_others():
    published = hlosta2020.contact("D6", "steel")
    contact = by_name.contact("D6", "steel", Model(), restitution=0.9)
    assert contact == Contact(0.9, published.static_friction, published.rolling_friction)


def test_the_lab_takes_precedence_over_the_published_contact():
    model = Model().with_contact("D6", "steel", static_friction=0.11)
    assert by_name.contact("steel", "D6", model).static_friction == 0.11


def test_an_unknown_contact_is_refused_by_name():
    with pytest.raises(BadInput, match="D6-wood_ash"):
        by_name.contact("D6", "wood_ash", Model())


def test_a_twin_on_rods_with_mass_passes_the_check_of_gravity():
    rig = Pendulum(0.2, math.radians(45), hanger="rod", rod_mass=1e-3)
    twin = pendulum_twin(rig, BEAD, Contact(0.7), frame_rate=240)
    (gravity,) = [check for check in twin.evaluation.checks if check.check == "gravity"]
    assert gravity.passed
    assert gravity.value > 1.05 * gravity.expected
    assert "rods" in gravity.message
    assert not [words for words in twin.evaluation.warnings if "gravity" in words]
