"""Every rig measures tables of tracked data; their truth is a closed form, their axes and units are those of a user."""

import math
from pathlib import Path

import numpy as np
import pytest

from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.tracked.table import TableOptions
from rigtwin.measure.drop.measurement import measure as measure_drop
from rigtwin.measure.drum.measurement import measure as measure_drum
from rigtwin.measure.hopper.measurement import measure as measure_hopper
from rigtwin.measure.packing.measurement import measure as measure_packing
from rigtwin.measure.pendulum.measurement import measure as measure_pendulum
from rigtwin.measure.pile.measurement import measure as measure_pile
from rigtwin.measure.tilt.measurement import measure as measure_tilt

PIXEL = 2.5e-4  # [m], of the tables in pixels
RNG = np.random.default_rng(11)


def table(path: Path, header: str, *columns: np.ndarray) -> Path:
    rows = [",".join(f"{cell:.7g}" for cell in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def bounces(restitution: float = 0.7, height: float = 0.3, rate: float = 240.0) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and height [m] of a ball that is dropped and bounces three times, without air."""
    time, impact = np.arange(0, 1.2, 1 / rate), math.sqrt(2 * height / 9.81)
    speed, y = 9.81 * impact, height - 9.81 * np.arange(0, 1.2, 1 / rate) ** 2 / 2
    for _ in range(3):
        speed *= restitution
        since = time - impact
        y = np.where(since > 0, speed * since - 9.81 * since**2 / 2, y)
        impact += 2 * speed / 9.81
    seen = time < impact
    return time[seen], y[seen]


def test_a_drop_in_picture_coordinates_needs_no_scale_for_its_restitution(tmp_path):
    _, y = bounces()
    pixels = 700 - y / PIXEL + RNG.normal(0, 0.1, len(y))
    path = table(tmp_path / "ball.csv", "frame,x_px,y_px", np.arange(len(y)), 0 * y + 300, pixels)
    found = measure_drop(path, Camera(frame_rate=240.0))
    e = found.quantity("restitution_wall", method="velocity", bounce=1)
    assert abs(e.value - 0.7) < 3 * e.std_uncertainty
    assert e.std_uncertainty < 0.01
    assert found.camera["scale_from"] == "gravity"
    np.testing.assert_allclose(found.camera["scale_m_per_px"], PIXEL, rtol=0.02)
    assert "turned over" in found.table["direction_of_y"]
    scaled = measure_drop(path, Camera(frame_rate=240.0, scale=PIXEL))
    height = scaled.quantity("drop_height")
    assert abs(height.value - 0.3) < 3 * height.std_uncertainty
    assert height.std_uncertainty < 0.005


def test_a_bead_that_never_moves_is_refused(tmp_path):
    still = table(tmp_path / "ball.csv", "time_s,x_m,y_m", np.arange(70) / 240, np.zeros(70), np.zeros(70))
    with pytest.raises(BadInput, match=r"moves up and down by 0\.0 times the noise"):
        measure_drop(still, Camera())


def tilting(restless: float = 2e-5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, plate angle [rad] and body [m] in the rig's axes: it slides from 22 degrees on, kinetic friction 0.3."""
    time = np.arange(0, 3.2, 0.01)
    alpha = np.radians(10 + 5 * time)
    start = 2.4
    pull = 9.81 * (np.sin(np.radians(22)) - 0.3 * np.cos(np.radians(22)))
    rate = 9.81 * np.radians(5) * (np.cos(np.radians(22)) + 0.3 * np.sin(np.radians(22)))
    since = np.clip(time - start, 0, None)
    down = pull * since**2 / 2 + rate * since**3 / 6
    along = 0.5 - down
    lift = 0.01
    position = np.column_stack(
        [along * np.cos(alpha) - lift * np.sin(alpha), along * np.sin(alpha) + lift * np.cos(alpha)]
    )
    return time, alpha, position + RNG.normal(0, restless, position.shape)


@pytest.mark.parametrize("case", ["rig's axes", "picture", "rising to the left"])
def test_a_tilt_is_measured_in_any_axes(tmp_path, case):
    time, alpha, body = tilting()
    x, y = body.T
    header, camera = "time_s,x_m,y_m,angle_deg", Camera()
    if case != "rig's axes":
        sign = -1 if case == "rising to the left" else 1
        x, y, header = 600 + sign * x / PIXEL, 900 - y / PIXEL, "time_s,x_px,y_px,angle_deg"
    found = measure_tilt(table(tmp_path / "body.csv", header, time, x, y, np.degrees(alpha)), camera, variant="slide")
    onset = found.quantity("static_friction_angle")
    assert abs(onset.value - 22) < max(3 * onset.std_uncertainty, 0.1)
    if case == "rig's axes":
        kinetic = found.quantity("kinetic_friction")
        assert abs(kinetic.value - 0.3) < max(3 * kinetic.std_uncertainty, 0.01)


def test_the_angle_of_a_tilt_may_stand_in_a_second_table(tmp_path):
    time, alpha, body = tilting()
    track = table(tmp_path / "a-track.csv", "time_s,x_m,y_m", time, *body.T)
    with pytest.raises(BadInput, match="plate's angle"):
        measure_tilt(track, Camera(), variant="slide")
    plate = table(tmp_path / "plate.csv", "t [s],alpha [rad]", time, alpha)
    beside = table(tmp_path / "a-angle.csv", "t [s],alpha [rad]", time, alpha)
    found = [measure_tilt(track, Camera(), variant="slide", angle=angle) for angle in (plate, None)]
    assert beside.exists()
    assert found[0].value("static_friction") == found[1].value("static_friction")


def test_a_pendulum_of_other_names_and_pixels(tmp_path):
    # before the collision A swings and B hangs; afterwards A rests and B swings on: equal beads, restitution 1
    rate, length, start = 240.0, 0.3, math.radians(20)
    omega = math.sqrt(9.81 / length)
    time = np.arange(0, 1.0, 1 / rate)
    release, hit = 0.1, 0.1 + math.pi / 2 / omega
    a = np.where(time < release, -start, np.where(time < hit, -start * np.cos(omega * (time - release)), 0.0))
    b = np.where(time < hit, 0.0, start * np.sin(omega * (time - hit)))
    columns = [time]
    for angle, pivot in ((a, 0.0), (b, 0.02)):
        columns += [800 + (pivot + length * np.sin(angle)) / PIXEL, 100 + length * np.cos(angle) / PIXEL]
    noisy = [columns[0], *(each + RNG.normal(0, 0.05, len(time)) for each in columns[1:])]
    path = table(tmp_path / "swing.csv", "time_s,x1_px,y1_px,x2_px,y2_px", *noisy)
    found = measure_pendulum(path, Camera(), length=length)
    e = next(each for each in found.quantities if each.quantity == "restitution_pair")
    assert abs(e.value - 1) < 0.03
    np.testing.assert_allclose(found.camera["scale_m_per_px"], PIXEL, rtol=0.01)
    assert "turned over" in found.table["direction_of_y"]


def test_a_heap_in_picture_coordinates(tmp_path):
    x = np.linspace(-200, 200, 201)
    height = np.clip(150 - np.abs(x), 0, None) * math.tan(math.radians(28))
    path = table(tmp_path / "heap.csv", "x_px,y_px", x + 500, 700 - height)
    found = measure_pile([path], Camera(scale=PIXEL), bead_diameter=2e-3)
    angle = found.quantity("angle_of_repose_graphical", method="line 20-80 %", side="mean")
    assert abs(angle.value - 28) < 1
    assert "turned over" in found.table["direction_of_y"]


def test_a_bed_in_millimetres(tmp_path):
    x = np.linspace(-30, 30, 121)
    path = table(tmp_path / "bed.csv", "x [mm];height [mm]".replace(";", ","), x, 0 * x + 80)
    found = measure_packing([path], Camera(), cylinder_diameter=0.065, bead_diameter=2e-3)
    assert abs(found.value("bed_height", method="outline") - 0.08) < 1e-6


def test_a_drums_slope_over_time(tmp_path):
    time = np.arange(0, 8, 0.05)
    slope = 33 + 1.5 * np.sin(2 * math.pi * time / 1.7) + RNG.normal(0, 0.2, len(time))
    found = measure_drum(table(tmp_path / "slope.csv", "time_s,angle_deg", time, slope), Camera(), drum_diameter=0.14)
    angle = found.quantity("angle_of_repose_graphical")
    assert angle.method == "slope over time"
    assert abs(angle.value - 33) < 3 * angle.std_uncertainty
    assert not [each for each in found.quantities if each.quantity == "angle_of_repose_geometric"]


def test_a_drums_surface_over_time(tmp_path):
    x, times = np.linspace(-0.06, 0.06, 61), np.arange(20) / 10
    t, places = (each.ravel() for each in np.meshgrid(times, x, indexing="ij"))
    path = table(tmp_path / "surface.csv", "time_s,x_m,height_m", t, places, 0.6 * places - 0.01)
    found = measure_drum(path, Camera(), drum_diameter=0.15)
    assert abs(found.quantities[0].value - math.degrees(math.atan(0.6))) < 0.1


def discharge(mass: float) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(0, 4, 0.02)
    return time, mass * np.clip((time - 0.5) / 2, 0, 1)


@pytest.mark.parametrize("kind", ["left", "collected", "flow"])
def test_a_hopper_by_what_is_left_what_has_left_or_the_flow(tmp_path, kind):
    time, gone = discharge(0.4)
    columns = {
        "left": ("time_s,mass left [g]", 1e3 * (0.4 - gone)),
        "collected": ("time_s,mass [g]", 1e3 * gone),
        "flow": ("time_s,flow rate [g/s]", 1e3 * np.gradient(gone, time)),
    }
    header, values = columns[kind]
    found: Measurement = measure_hopper(table(tmp_path / "mass.csv", header, time, values), Camera())
    assert abs(found.value("mass_flow_rate") - 0.2) < 0.002
    assert abs(found.value("discharge_time") - 2) < 0.05


def test_an_unknown_table_of_a_hopper_is_refused_with_its_columns(tmp_path):
    time, gone = discharge(0.4)
    path = table(tmp_path / "what.csv", "time_s,voltage", time, gone)
    with pytest.raises(BadInput, match="'time_s', 'voltage'"):
        measure_hopper(path, Camera())
    found = measure_hopper(path, Camera(), table=TableOptions({"collected": ("voltage", "kg")}))
    assert abs(found.value("mass_flow_rate") - 0.2) < 0.002
