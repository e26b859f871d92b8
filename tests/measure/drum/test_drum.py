"""A drum's surface: closed-form records, and small films drawn with a known slope."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import cv2
import numpy as np
import numpy.typing as npt
import pytest

from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Evaluation, Measurement, Quantity
from rigtwin.lab.records import Profile, Series
from rigtwin.lab.reference import hlosta2020
from rigtwin.measure.drum import bed as drum_bed
from rigtwin.measure.drum import checks as drum_checks
from rigtwin.measure.drum import evaluate as drum
from rigtwin.measure.drum import measurement as drum_measurement
from rigtwin.measure.drum.bed import Bed, Outline, Still, _hides
from rigtwin.measure.drum.glare import brightened_share
from rigtwin.measure.drum.rim import Rim
from rigtwin.measure.drum.rotation import turning_of
from rigtwin.measure.drum.time_average import mean_over_time

Array = npt.NDArray[np.float64]

RADIUS = 0.075  # [m]
SIZE = (300, 280)  # [px], width and height of the drawn films
CENTRE = (150.0, 130.0)  # [px]
RADIUS_PX = 100.0


def profile(angle: float, *, below: float = 0.2, bend: float = 0.0) -> Profile:
    """Surface through (0, -below R), rising to the right by `angle` [deg], S-shaped by `bend` [1/m^2]."""
    x = np.linspace(-RADIUS, RADIUS, 301)
    height = -below * RADIUS + math.tan(math.radians(angle)) * x - bend * x**3
    inside = np.hypot(x, height) < RADIUS
    return Profile(x, np.where(inside, height, np.nan), np.full(len(x), 1e-4))


def find(of: Evaluation | Measurement, quantity: str, method: str = "") -> Quantity:
    return next(one for one in of.quantities if one.quantity == quantity and (not method or one.method == method))


def correlated(random: np.random.Generator, count: int, likeness: float) -> Array:
    noise = random.normal(size=count + 200)
    value = np.zeros(count + 200)
    for k in range(1, count + 200):
        value[k] = likeness * value[k - 1] + math.sqrt(1 - likeness**2) * noise[k]
    return value[200:]


@pytest.mark.parametrize("angle", [-52.0, -26.0, 12.0, 37.5])
def test_every_definition_gives_the_angle_of_a_straight_surface(angle: float) -> None:
    found = drum.evaluate([profile(angle)] * 20, np.arange(20) / 30, drum_diameter=2 * RADIUS)
    for one in found.quantities:
        assert one.value == pytest.approx(abs(angle), abs=0.05), (one.quantity, one.method)
        assert one.detail["turning"] == ("anticlockwise" if angle > 0 else "clockwise")


def test_an_s_shaped_surface_is_steeper_at_the_axis_than_from_wall_to_wall() -> None:
    bend = 40.0
    found = drum.evaluate([profile(45.0, below=0.0, bend=bend)] * 20, np.arange(20) / 30, drum_diameter=2 * RADIUS)
    # least squares of a x - b x^3 over |x| < c has the slope a - (3/5) b c^2
    tangent = math.degrees(math.atan(1 - 0.6 * bend * (0.2 * RADIUS) ** 2))
    assert find(found, drum.GRAPHICAL, drum.TANGENT).value == pytest.approx(tangent, abs=0.05)
    by_method = {(one.quantity, one.method): one.value for one in found.quantities}
    assert by_method[drum.GEOMETRIC, drum.CHORD] < by_method[drum.GRAPHICAL, drum.MIDDLE] < tangent


def test_a_bed_that_hangs_back_at_its_toe_has_a_smaller_lower_angle() -> None:
    x = np.linspace(-RADIUS, RADIUS, 301)
    height = -0.02 + np.where(x < 0, 0.3 * x, 0.7 * x)
    bent = Profile(x, np.where(np.hypot(x, height) < RADIUS, height, np.nan), np.full(len(x), 1e-4))
    found = drum.evaluate([bent] * 20, np.arange(20) / 30, drum_diameter=2 * RADIUS)
    assert find(found, drum.UPPER).value > find(found, drum.LOWER).value + 5
    assert find(found, drum.UPPER).detail["s_shaped"] is True


def test_the_interval_of_the_mean_holds_although_neighbouring_frames_are_alike() -> None:
    random = np.random.default_rng(3)
    held, runs = 0, 200
    for _ in range(runs):
        mean = mean_over_time(np.arange(240) / 60, 30 + 2 * correlated(random, 240, 0.9))
        held += abs(mean.value - 30) < 1.96 * mean.std_error
    # 90 to 99 %, with the scatter of 200 tries
    assert 0.88 <= held / runs <= 0.995


def test_frames_that_do_not_resemble_each_other_give_the_usual_standard_error() -> None:
    random = np.random.default_rng(4)
    errors = [mean_over_time(np.arange(400) / 60, random.normal(size=400)).std_error for _ in range(20)]
    assert np.mean(errors) == pytest.approx(1 / math.sqrt(400), rel=0.15)


def test_dropped_frames_do_not_pull_the_mean() -> None:
    times = np.arange(400) / 100
    angles = 30 + 5 * np.sin(2 * np.pi * times)
    # the high half is filmed at a tenth of the rate
    kept = (np.sin(2 * np.pi * times) < 0) | (np.arange(400) % 10 == 0)
    found = drum.evaluate([profile(a) for a in angles[kept]], times[kept], drum_diameter=2 * RADIUS)
    assert find(found, drum.GRAPHICAL, drum.MIDDLE).value == pytest.approx(30.0, abs=0.35)
    assert next(check for check in found.checks if check.check == "frame_timing").value > 0.05
    assert not find(found, drum.GRAPHICAL, drum.MIDDLE).doubtful


def test_times_that_jump_about_make_every_number_doubtful() -> None:
    random = np.random.default_rng(6)
    times, angles = np.cumsum(random.exponential(1 / 30, 200)), 30 + 0.8 * correlated(random, 200, 0.5)
    found = drum.evaluate([profile(a) for a in angles], times, drum_diameter=2 * RADIUS)
    assert not next(check for check in found.checks if check.check == "frame_timing").passed
    assert all("frame intervals" in one.doubtful for one in found.quantities)


def test_the_start_of_the_drum_is_left_out() -> None:
    random = np.random.default_rng(5)
    angles = np.concatenate([np.linspace(0, 30, 25), 30 + 0.8 * correlated(random, 175, 0.5)])
    found = drum.evaluate([profile(a) for a in angles], np.arange(200) / 30, drum_diameter=2 * RADIUS)
    assert find(found, drum.GRAPHICAL, drum.MIDDLE).value == pytest.approx(30.0, abs=0.4)
    assert any("steady part" in warning for warning in found.warnings)


def test_avalanches_are_counted_where_the_bed_turns_with_the_drum_between_them() -> None:
    random = np.random.default_rng(6)
    times = np.arange(600) / 30
    speed = math.radians(3.0)  # [rad/s]
    angles = 27 + (3.0 * times) % 5.0 + random.normal(0, 0.1, 600)  # 5 degrees slide every 5/3 s
    found = drum.evaluate([profile(a) for a in angles], times, drum_diameter=2 * RADIUS, speed=speed)
    assert find(found, "avalanche_frequency").value == pytest.approx(0.6, rel=0.03)
    assert find(found, "avalanche_start_angle").value == pytest.approx(32.0, abs=0.6)
    assert find(found, "avalanche_stop_angle").value == pytest.approx(27.0, abs=0.6)


def test_a_flow_that_only_sways_has_no_avalanches() -> None:
    times = np.arange(600) / 30
    angles = 30 + 2 * np.sin(2 * np.pi * 0.6 * times)
    found = drum.evaluate([profile(a) for a in angles], times, drum_diameter=2 * RADIUS)
    assert not any(one.quantity.startswith("avalanche") for one in found.quantities)
    assert any("avalanche frequency" in warning and "as quickly as it falls" in warning for warning in found.warnings)


def test_a_drum_whose_wall_throws_beads_off_has_doubtful_slopes() -> None:
    def wrong(speed: float) -> str:
        seen = [profile(a) for a in 30 + np.random.default_rng(8).normal(size=40)]
        found = drum.evaluate(seen, np.arange(40) / 30, drum_diameter=2 * RADIUS, speed=speed)
        return find(found, drum.GRAPHICAL, drum.MIDDLE).doubtful

    # where the wall's acceleration equals gravity beads stay at it, for either direction of rotation
    assert "centrifuges" in wrong(-math.sqrt(9.82 / RADIUS))
    assert "thrown" in wrong(math.sqrt(0.6 * 9.81 / RADIUS))
    assert wrong(math.sqrt(0.1 * 9.81 / RADIUS)) == ""


@pytest.mark.parametrize("frames", [1, 2, 4, 7, 8, 12])
def test_neighbouring_frames_are_known_no_better_than_one_moment_of_the_flow(frames: int) -> None:
    # moments of a flow that sways by two degrees over seconds: they agree, but carry no information on its mean
    seen = [profile(32 + 0.02 * k) for k in range(frames)]
    found = find(drum.evaluate(seen, np.arange(frames) / 240, drum_diameter=2 * RADIUS), drum.GRAPHICAL)
    assert 2.3 < found.std_uncertainty < 3.0  # 2.4 for beads of 4 % of the drum, known to some 20 %
    assert not found.doubtful


def moments(count: int, *, bead: float = 0.006, speed: float | None = 0.6, apart: float = 1.5, **more: Any) -> Quantity:
    """Angle of `count` moments `apart` [s] of a drum that turns by 0.14 of a turn between them."""
    angles = 32 + np.random.default_rng(5).normal(size=count)
    times = apart * np.arange(count)
    found = drum.evaluate(
        [profile(a) for a in angles], times, drum_diameter=2 * RADIUS, bead_diameter=bead, speed=speed, **more
    )
    return find(found, drum.GRAPHICAL, drum.MIDDLE)


def test_one_moment_scatters_in_proportion_to_the_bead() -> None:
    small, large = (moments(1, bead=bead).std_uncertainty for bead in (0.004, 0.012))
    assert large == pytest.approx(3 * small)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_moments_that_are_parts_of_a_turn_apart_count_each(count: int) -> None:
    one, more = moments(1), moments(count)
    assert more.detail["independent_frames"] == count
    # the usual scatter over the root of their number, lowered by an observed scatter of one degree
    assert 1 / math.sqrt(count) < more.std_uncertainty < one.std_uncertainty / math.sqrt(count)


def test_moments_count_once_where_the_drum_hardly_turns_or_its_speed_is_not_known() -> None:
    one = moments(1).std_uncertainty
    assert moments(5, apart=0.004).std_uncertainty > 0.9 * one
    assert moments(5, speed=None).std_uncertainty == pytest.approx(one)


def test_a_mean_over_time_has_no_scatter_of_one_moment() -> None:
    assert "flow over time" in moments(1).budget
    assert "flow over time" not in moments(1, averaged=True).budget
    slope = Series(np.zeros(1), np.array([32.0]), "angle", "deg")
    one, mean = (drum.evaluate_slope(slope, averaged=each).quantities[0] for each in (False, True))
    assert one.std_uncertainty > 2
    assert mean.std_uncertainty == 0


def test_published_repetitions_scatter_as_single_moments_do() -> None:
    """Standard deviations of repeated measurements by eye in a drum 140 mm wide (Hlosta et al. 2020, table 14)."""
    rows = [row for row in hlosta2020.table(14) if row["rig"] == "drum_140mm_3rpm" and str(row["particle"])[0] == "D"]
    ratios = [
        float(row["aor_exp_std_deg"])
        / drum.one_moment((drum.GRAPHICAL, drum.MIDDLE), hlosta2020.particle(str(row["particle"])).diameter / 0.14)
        for row in rows
    ]
    assert len(ratios) == 5
    # a standard deviation of five repetitions scatters by 35 %, the mean of the logarithms of five such by 16 %
    assert abs(np.mean(np.log(ratios))) < 2 * 0.16


def test_many_moments_of_the_flow_are_known_better_than_one() -> None:
    seen = [profile(angle) for angle in 32 + np.random.default_rng(3).normal(size=100)]
    found = drum.evaluate(seen, np.arange(100) / 4, drum_diameter=2 * RADIUS)
    assert find(found, drum.GRAPHICAL).std_uncertainty < 0.2


def test_bad_records_are_refused_in_a_sentence() -> None:
    one = profile(30)
    with pytest.raises(BadInput, match="2 profiles but 1 times"):
        drum.evaluate([one, one], np.array([0.0]), drum_diameter=0.15)
    with pytest.raises(BadInput, match="do not increase"):
        drum.evaluate([one, one], np.array([1.0, 0.0]), drum_diameter=0.15)
    with pytest.raises(BadInput, match="must be a positive number"):
        drum.evaluate([one], np.array([0.0]), drum_diameter=-0.15)
    empty = Profile(one.x, np.full(len(one.x), np.nan), one.sigma)
    with pytest.raises(NothingToMeasure, match="surface"):
        drum.evaluate([empty], np.array([0.0]), drum_diameter=0.15)


# ------------------------------------------------------------------------------------------------------------- films


def surface(x: Any, angle: float, bend: float = 0.0) -> Any:
    """Height [px] of a drawn bed at x [px], both from the drum's axis; `bend` of the radius at its ends."""
    return math.tan(math.radians(angle)) * x + (bend * (x / RADIUS_PX) ** 2 - 0.3) * RADIUS_PX


def film(
    path: Path,
    angle: float,
    *,
    roll: float = 0.0,
    frames: int = 18,
    drum_grey: int = 190,
    bead_grey: int = 110,
    noise: float = 3.0,
    turn: float = 0.05,
    flicker: float = 0.0,
    quarters: int = 0,
    bend: float = 0.0,
    shown: float = 1.0,
    stand: int | None = 250,
    slides: float = 0.0,
) -> None:
    """A drum on a level stand; its beads `turn` [rad] with it per frame and are taken away above a line or bow.

    The line keeps its `angle`, or turns with the drum and falls back to it from `slides` [deg] above.

    The stand begins at the row `stand` [px], None: it is not in view.  The camera lies on its side by `quarters` of a
    turn, and the left share `shown` of the picture is filmed.
    """
    random = np.random.default_rng(11)
    bead = 4.0  # [px], radius
    side = np.arange(-RADIUS_PX, RADIUS_PX, 2.05 * bead)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    grid = grid + random.uniform(-0.6, 0.6, grid.shape) * bead
    grid = grid[np.hypot(*grid.T) < RADIUS_PX - bead]
    shade = random.integers(-25, 25, len(grid))
    rolled = cv2.getRotationMatrix2D(CENTRE, -roll, 1.0)  # OpenCV turns anticlockwise
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "16", "x264-params": "mbtree=0"})
        width = round(shown * SIZE[0]) // 2 * 2
        stream.width, stream.height = (SIZE[1], width) if quarters % 2 else (width, SIZE[1])
        stream.pix_fmt = "yuv420p"
        for k in range(frames):
            picture = np.full((SIZE[1], SIZE[0], 3), 225, np.uint8)
            if stand is not None:
                cv2.rectangle(picture, (0, stand), (SIZE[0], SIZE[1]), (120, 120, 120), -1)
            cv2.circle(picture, (150, 130), 112, (90, 90, 95), -1, cv2.LINE_AA)
            cv2.circle(picture, (150, 130), 100, (drum_grey,) * 3, -1, cv2.LINE_AA)
            # anticlockwise where the surface rises to the right
            a = math.copysign(turn * k, angle)
            slope = angle + math.copysign(math.degrees(turn * k) % slides, angle) if slides else angle
            x = grid[:, 0] * math.cos(a) - grid[:, 1] * math.sin(a)
            y = grid[:, 0] * math.sin(a) + grid[:, 1] * math.cos(a)
            for px, py, tone in zip(x, y, shade, strict=True):
                if py < surface(px, slope, bend):
                    grey = int(np.clip(bead_grey + tone, 0, 255))
                    where = (round(16 * (CENTRE[0] + px)), round(16 * (CENTRE[1] - py)))
                    cv2.circle(picture, where, round(16 * bead), (grey - 40, grey, grey + 30), -1, cv2.LINE_AA, 4)
            picture = cv2.warpAffine(picture, rolled, SIZE, borderMode=cv2.BORDER_REPLICATE)
            picture = picture * (1 + flicker * math.sin(2 * math.pi * 100.7 * k / 30))
            noisy = np.clip(picture + random.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)
            noisy = np.ascontiguousarray(np.rot90(noisy[:, :width], quarters))
            for packet in stream.encode(av.VideoFrame.from_ndarray(noisy, format="bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)


def measured(path: Path, roll: float | None = None, out: Path | None = None, speed: float | None = None) -> Measurement:
    camera = Camera(frame_rate=30.0, roll=roll)
    return drum_measurement.measure(path, camera, drum_diameter=0.15, bead_diameter=0.006, speed=speed, out=out)


def test_a_filmed_drum_gives_the_slope_it_was_drawn_with(tmp_path: Path) -> None:
    film(tmp_path / "drum.mp4", -30.0, roll=2.0)
    found = measured(tmp_path / "drum.mp4", out=tmp_path / "out", speed=0.4)
    angle = find(found, drum.GRAPHICAL, drum.MIDDLE)
    assert any("speed not confirmed" in warning and "3.82rpm" in warning for warning in found.warnings)
    assert angle.value == pytest.approx(30.0, abs=0.6)
    assert angle.interval95[0] < 30.0 < angle.interval95[1]
    assert angle.detail["turning"] == "clockwise"
    assert found.camera["camera_roll_deg"] == pytest.approx(2.0, abs=0.2)
    assert found.camera["drum_radius_px"] == pytest.approx(RADIUS_PX, abs=1.5)
    assert found.camera["scale_m_per_px"] == pytest.approx(0.15 / (2 * RADIUS_PX), rel=0.015)
    assert {"overlay", "still", "plot"} <= set(found.files)
    assert all(path.exists() for path in found.files.values())
    assert not angle.doubtful


@pytest.mark.parametrize("sign", [1, -1])
def test_a_stated_roll_is_compared_with_the_level_stand(tmp_path: Path, sign: int) -> None:
    film(tmp_path / "drum.mp4", 30.0, roll=1.5)  # clockwise
    found = measured(tmp_path / "drum.mp4", roll=math.radians(1.5 * sign))
    (check,) = [each for each in found.checks if each.check == "camera_roll"]
    angle = find(found, drum.GRAPHICAL, drum.MIDDLE)
    assert check.passed is (sign > 0)
    assert bool(angle.doubtful) is (sign < 0)
    # a scene turned clockwise is turned back, a wrong sign turns it by as much again
    assert angle.value == pytest.approx(30.0 if sign > 0 else 27.0, abs=0.6)


def test_a_wrong_roll_is_compared_with_a_stand_right_below_the_drum(tmp_path: Path) -> None:
    film(tmp_path / "drum.mp4", 30.0, stand=244)
    found = measured(tmp_path / "drum.mp4", roll=math.radians(8.0))
    assert all("camera roll of +8.00 degrees was given" in one.doubtful for one in found.quantities)


@pytest.mark.parametrize("roll", [-8.0, pytest.param(12.0, marks=pytest.mark.slow), 20.0])
def test_a_camera_turned_by_more_than_a_stand_allows_is_corrected_and_doubtful(tmp_path: Path, roll: float) -> None:
    film(tmp_path / "drum.mp4", 30.0, roll=roll)
    found = measured(tmp_path / "drum.mp4")
    angle = find(found, drum.GRAPHICAL, drum.MIDDLE)
    assert found.camera["camera_roll_deg"] == pytest.approx(roll, abs=0.4)
    assert angle.value == pytest.approx(30.0, abs=0.8)
    assert "unusually large for a camera on a stand" in angle.doubtful
    assert not find(measured(tmp_path / "drum.mp4", roll=math.radians(roll)), drum.GRAPHICAL).doubtful


@pytest.mark.parametrize("roll", [0.0, 6.0])
def test_a_roll_that_nothing_shows_is_in_the_uncertainty(tmp_path: Path, roll: float) -> None:
    film(tmp_path / "drum.mp4", 30.0, roll=roll, stand=None)
    found = measured(tmp_path / "drum.mp4")
    angle = find(found, drum.GRAPHICAL, drum.MIDDLE)
    assert abs(angle.value - 30.0) < 3 * float(angle.detail["std_uncertainty_of_this_clip"])
    assert max(angle.budget, key=lambda part: angle.budget[part]) == "camera roll, not measured"
    assert any("Give --camera-roll (0deg if" in warning for warning in found.warnings)
    assert not angle.doubtful


def test_a_large_stated_roll_that_nothing_shows_is_used(tmp_path: Path) -> None:
    film(tmp_path / "drum.mp4", 30.0, roll=12.0, stand=None)
    found = measured(tmp_path / "drum.mp4", roll=math.radians(12.0))
    angle = find(found, drum.GRAPHICAL, drum.MIDDLE)
    assert angle.value == pytest.approx(30.0, abs=0.8)
    assert not angle.doubtful


@pytest.mark.slow
def test_the_avalanche_frequency_does_not_depend_on_the_camera_roll(tmp_path: Path) -> None:
    film(tmp_path / "drum.mp4", 30.0, roll=12.0, frames=90, turn=math.radians(0.4), slides=8.0)
    found = measured(tmp_path / "drum.mp4")
    often = find(found, drum.FREQUENCY)
    assert often.value == pytest.approx(1.5, rel=0.05)  # [1/s], every twentieth frame of 30 a second
    assert not often.doubtful
    assert "give --camera-roll" in find(found, drum.GRAPHICAL).doubtful


def test_beads_in_flight_over_the_upper_end_do_not_count_as_its_surface() -> None:
    random = np.random.default_rng(5)
    times = np.arange(40) / 30
    x = np.arange(-90.0, 91.0)
    outlines = []
    for k, time in enumerate(times):
        height = math.tan(math.radians(28.0)) * x - 20
        height[np.hypot(x, height) > RADIUS_PX] = np.nan
        start = random.uniform(40, 70)
        flying = height + 12.0 * ((x > start) & (x < start + 14) & (k % 2 == 0))
        outlines.append(Outline(k, time, x, flying, flying, flying, 5e3, (0.0, 0.0)))
    bed = SimpleNamespace(
        outlines=tuple(outlines),
        bead=8.0,
        rim=Rim((0.0, 0.0), RADIUS_PX, 1.0, 0.5),
        upright=SimpleNamespace(sigma=0.0, source=""),
    )
    seen = drum_measurement._observation(bed, RADIUS / RADIUS_PX, 0.006 / (2 * RADIUS), averaged=False)
    found = drum.evaluate(seen.profiles, times, drum_diameter=2 * RADIUS)
    assert find(found, drum.UPPER).value == pytest.approx(28.0, abs=0.5)
    assert find(found, drum.GRAPHICAL, drum.WHOLE).value == pytest.approx(28.0, abs=0.2)


@pytest.mark.parametrize("bend", [-0.05, 0.05])
def test_every_filmed_angle_of_a_bent_surface_lies_within_its_uncertainty(tmp_path: Path, bend: float) -> None:
    """The lines' true slopes, by the drawn curve; a surface that bows up or down is steeper in one half."""
    film(tmp_path / "drum.mp4", 28.0, bend=bend)
    found = measured(tmp_path / "drum.mp4")
    x = np.linspace(-RADIUS_PX, RADIUS_PX, 2001)
    height = surface(x, 28.0, bend)
    inside = np.hypot(x, height) < RADIUS_PX
    truth = drum.evaluate([Profile(x[inside], height[inside], 0 * x[inside])], np.zeros(1), drum_diameter=None)
    for name, method in (
        (drum.LOWER, ""),
        (drum.UPPER, ""),
        (drum.GRAPHICAL, drum.MIDDLE),
        (drum.GRAPHICAL, drum.WHOLE),
    ):
        one, true = find(found, name, method), find(truth, name, method)
        assert abs(one.value - true.value) < 2 * float(one.detail["std_uncertainty_of_this_clip"])
        assert not one.doubtful


def test_a_film_broken_off_has_nothing_that_is_not_doubtful(tmp_path: Path) -> None:
    clip = tmp_path / "drum.mkv"
    film(clip, 30.0)
    clip.write_bytes(clip.read_bytes()[: int(0.9 * clip.stat().st_size)])
    assert all("broken off" in one.doubtful for one in measured(clip, out=tmp_path / "out").quantities)


def test_a_slow_drum_is_found_in_a_film_whose_noise_hides_the_motion_of_single_pixels(tmp_path: Path) -> None:
    film(tmp_path / "drum.mp4", 30.0, noise=26.0, turn=0.02)
    angle = find(measured(tmp_path / "drum.mp4"), drum.GRAPHICAL, drum.MIDDLE)
    assert angle.interval95[0] < 30.0 < angle.interval95[1]
    assert angle.std_uncertainty < 3.0


def test_a_surface_that_runs_out_of_the_picture_is_doubtful(tmp_path: Path) -> None:
    film(tmp_path / "drum.mp4", 30.0, shown=0.6)
    found = measured(tmp_path / "drum.mp4")
    assert all("edge of the picture" in one.doubtful for one in found.quantities)


def test_a_surface_of_which_one_half_rises_against_the_other_is_doubtful() -> None:
    for toe in (25.0, -25.0):
        x = profile(25.0).x
        height = np.where(x > 0, math.tan(math.radians(25.0)) * x, math.tan(math.radians(toe)) * x) - 0.2 * RADIUS
        found = drum.evaluate([Profile(x, height, 0 * x)], np.zeros(1), drum_diameter=2 * RADIUS)
        assert all(bool(one.doubtful) is (toe < 0) for one in found.quantities)


def test_the_mirrored_drum_has_the_same_angle_and_turns_the_other_way(tmp_path: Path) -> None:
    film(tmp_path / "right.mp4", 30.0)
    found = measured(tmp_path / "right.mp4")
    angle = find(found, drum.GRAPHICAL, drum.MIDDLE)
    assert angle.value == pytest.approx(30.0, abs=0.6)
    assert angle.detail["turning"] == "anticlockwise"
    assert {"turning", "bed_below"} <= {check.check for check in found.checks if check.passed}


@pytest.mark.parametrize("quarters", [1, 2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_film_on_its_side_is_doubtful(tmp_path: Path, quarters: int) -> None:
    film(tmp_path / "drum.mp4", -28.0, quarters=quarters)
    found = measured(tmp_path / "drum.mp4", out=tmp_path / "out" if quarters == 2 else None)
    assert all("on its side" in one.doubtful for one in found.quantities)


@pytest.mark.parametrize("step", [0.4, -1.0, 6.0])
def test_beads_at_the_wall_show_which_way_a_drum_turns_past_dirt_and_flicker(step: float) -> None:
    random = np.random.default_rng(4)
    texture = cv2.GaussianBlur(random.normal(0, 1, (20, 900)), (0, 0), 2.5) * 200
    dirt = cv2.GaussianBlur(random.normal(0, 1, (20, 150)), (0, 0), 2.5) * 200
    frames = np.arange(40)

    def rings(places: Array) -> list[npt.NDArray[np.uint8]]:
        columns = 400 + np.arange(150)
        beds = [np.array([np.interp(columns - place, np.arange(900), row) for row in texture]) for place in places]
        light = 1 + 0.1 * random.normal(0, 1, len(places))
        return [np.clip((128 + bed + dirt) * by, 0, 255).astype(np.uint8) for bed, by in zip(beds, light, strict=True)]

    assert turning_of(rings(step * frames)) == np.sign(step)
    assert turning_of(rings(random.normal(0, abs(step), len(frames)))) == 0  # it shakes in its place


def test_a_lamp_that_flickers_does_not_hide_the_surface(tmp_path: Path) -> None:
    film(tmp_path / "lamp.mp4", 30.0, turn=0.01, flicker=0.1)
    angle = find(measured(tmp_path / "lamp.mp4"), drum.GRAPHICAL, drum.MIDDLE)
    assert angle.value == pytest.approx(30.0, abs=0.6)
    assert not angle.doubtful


def test_a_single_picture_is_measured_with_a_warning_that_it_is_one_moment(tmp_path: Path) -> None:
    picture = np.full((240, 240), 235, np.uint8)
    y, x = np.mgrid[:240, :240] - 119.5
    bed = -y < math.tan(math.radians(-38)) * x
    picture[np.hypot(x, y) < 110] = 240
    picture[(np.hypot(x, y) < 110) & bed] = 25
    cv2.circle(picture, (119, 119), 110, 60, 1, cv2.LINE_AA)
    cv2.imwrite(str(tmp_path / "drum.bmp"), cv2.GaussianBlur(picture, (0, 0), 1.0))
    found = drum_measurement.measure(tmp_path / "drum.bmp", Camera(), drum_diameter=None, out=tmp_path / "out")
    assert find(found, drum.GRAPHICAL, drum.TANGENT).value == pytest.approx(38.0, abs=0.4)
    assert any("single picture" in warning for warning in found.warnings)
    assert any("scale" in warning for warning in found.warnings)
    assert found.profiles == ()


def test_a_picture_that_is_stated_to_be_a_mean_has_no_part_for_its_moment(tmp_path: Path) -> None:
    drum_beside_a_plate(tmp_path / "drum.png")
    one, mean = (
        drum_measurement.measure(
            tmp_path / "drum.png", Camera(circle=(400.0, 120.0, 80.0), averaged=each), drum_diameter=0.15
        )
        for each in (False, True)
    )
    for seen, averaged in zip(one.quantities, mean.quantities, strict=True):
        assert averaged.value == seen.value
        assert {part: seen.budget[part] for part in averaged.budget} == averaged.budget
        assert set(seen.budget) - set(averaged.budget) == {"flow over time"}
    assert any("bead" in warning and "4%" in warning for warning in one.warnings)
    assert not any("single picture" in warning or "4%" in warning for warning in mean.warnings)
    assert mean.camera["stated"] == ["circle", "averaged"]


@pytest.mark.parametrize(
    ("drum_diameter", "bead", "size"), [(0.15, 0.006, 1.0), (1.5, 0.006, 10.0), (0.15, 0.012, 0.5)]
)
def test_beads_that_are_not_as_large_as_stated_make_the_angles_doubtful(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drum_diameter: float, bead: float, size: float
) -> None:
    film(tmp_path / "drum.mp4", 30.0)  # of a drum 25 beads wide
    monkeypatch.setattr(
        drum_bed, "bead_spacing", lambda *_: 1.08 * 8.0
    )  # drawn discs have none of the shading of beads
    camera = Camera(frame_rate=30.0)
    found = drum_measurement.measure(tmp_path / "drum.mp4", camera, drum_diameter=drum_diameter, bead_diameter=bead)
    (check,) = [each for each in found.checks if each.check == "bead_size"]
    assert check.value == pytest.approx(size, rel=0.02)
    assert all((check.message[:-1] in one.doubtful) == (size != 1) for one in found.quantities)


def test_a_drum_stated_ten_times_too_small_is_named_where_the_bed_is_not_found_for_that_reason(tmp_path: Path) -> None:
    film(tmp_path / "drum.mp4", 20.0)
    with pytest.raises(BadInput, match=r"they are 40 %: check --drum-diameter and --bead-diameter\.$"):
        drum_measurement.measure(
            tmp_path / "drum.mp4", Camera(frame_rate=30.0), drum_diameter=0.015, bead_diameter=0.006
        )


def test_beads_whose_distance_differs_from_frame_to_frame_are_not_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film(tmp_path / "drum.mp4", 30.0)
    found = iter([8.0, None, 12.0, 17.0, None])
    monkeypatch.setattr(drum_bed, "bead_spacing", lambda *_: next(found))
    assert not [each for each in measured(tmp_path / "drum.mp4").checks if each.check == "bead_size"]


def drum_beside_a_plate(path: Path) -> None:
    """A drum of radius 80 px round (400, 120) whose surface falls by 38 degrees, beside a plate with a clear rim."""
    picture = np.full((300, 520), 225, np.uint8)
    cv2.circle(picture, (150, 150), 120, 20, 6, cv2.LINE_AA)
    y, x = np.mgrid[:300, :520]
    inside = np.hypot(x - 400, y - 120) < 80
    picture[inside] = 235
    picture[inside & (y - 120 > math.tan(math.radians(38)) * (x - 400))] = 60
    cv2.imwrite(str(path), cv2.GaussianBlur(picture, (0, 0), 1.0))


@pytest.mark.parametrize("region", [None, (300.0, 20.0, 210.0, 210.0)])
def test_a_drum_is_where_its_circle_is_stated(tmp_path: Path, region: tuple[float, float, float, float] | None) -> None:
    drum_beside_a_plate(tmp_path / "drum.png")
    camera = Camera(circle=(401.0, 119.0, 80.0), region=region)
    found = drum_measurement.measure(tmp_path / "drum.png", camera, drum_diameter=0.15, out=tmp_path / "out")
    angle = find(found, drum.GRAPHICAL, drum.TANGENT)
    assert angle.value == pytest.approx(38.0, abs=0.6)
    assert found.camera["stated"] == ["circle"]
    assert found.camera["drum_centre_px"] == pytest.approx([401.0, 119.0])
    assert found.camera["scale_m_per_px"] == pytest.approx(0.15 / 160)
    assert any("the drum's circle was stated" in check.message for check in found.checks)


def test_without_a_stated_circle_the_plate_beside_the_drum_is_no_drum_that_is_silently_measured(tmp_path: Path) -> None:
    drum_beside_a_plate(tmp_path / "drum.png")
    try:
        found = drum_measurement.measure(tmp_path / "drum.png", Camera(), drum_diameter=0.15)
    except NothingToMeasure:
        return
    angle = find(found, drum.GRAPHICAL, drum.TANGENT)
    assert angle.doubtful or angle.interval95[0] < 38.0 < angle.interval95[1]


def test_the_uncertainty_of_a_stated_circle_is_in_the_angle(tmp_path: Path) -> None:
    film(tmp_path / "drum.mp4", 30.0, bend=0.3)
    path = tmp_path / "drum.mp4"
    circle = (CENTRE[0] + 2.0, CENTRE[1] - 2.0, RADIUS_PX + 2.0)
    found, stated = (
        drum_measurement.measure(path, Camera(frame_rate=30.0, circle=each), drum_diameter=0.15, bead_diameter=0.006)
        for each in (None, circle)
    )
    for definition in (drum.MIDDLE, drum.TANGENT):
        seen, given = find(found, drum.GRAPHICAL, definition), find(stated, drum.GRAPHICAL, definition)
        circle_parts = {"drum's centre, sideways", "drum's radius"}
        assert circle_parts <= set(given.budget) - set(seen.budget)
        assert all(given.budget[part] > 0 for part in circle_parts)
        assert abs(given.value - seen.value) < 2 * given.std_uncertainty


@pytest.mark.parametrize(
    ("x", "radius", "wrong"), [(0.0, 1.0, False), (0.0, 1.12, False), (0.0, 0.55, True), (0.25, 1.0, True)]
)
def test_a_stated_circle_that_the_picture_contradicts_makes_every_angle_doubtful(
    tmp_path: Path, x: float, radius: float, wrong: bool
) -> None:
    film(tmp_path / "drum.mp4", 30.0)
    circle = (CENTRE[0] + x * RADIUS_PX, CENTRE[1], radius * RADIUS_PX)  # of the rim, the flange, and of nothing
    found = drum_measurement.measure(tmp_path / "drum.mp4", Camera(frame_rate=30.0, circle=circle), drum_diameter=0.15)
    said = f"% of the stated circle of radius {circle[2]:.0f} px .* % of the found circle of radius (99|100|101) px"
    for one in found.quantities:
        assert bool(re.search(said, one.doubtful)) == wrong, one.doubtful
        assert (f"check --circle {','.join(f'{number:g}' for number in circle)}" in one.doubtful) == wrong


def test_a_circle_that_does_not_fit_the_picture_is_refused(tmp_path: Path) -> None:
    drum_beside_a_plate(tmp_path / "drum.png")
    for circle, region, complaint in (
        ((900.0, 100.0, 80.0), None, "--circle names a point at 900,100"),
        ((400.0, 120.0, 800.0), None, "--circle has a radius of 800 px"),
        ((60.0, 60.0, 50.0), (300.0, 0.0, 200.0, 200.0), "no part of --circle 60,60,50 lies inside"),
    ):
        with pytest.raises(BadInput, match=complaint):
            drum_measurement.measure(tmp_path / "drum.png", Camera(circle=circle, region=region), drum_diameter=0.15)


def test_a_clip_without_a_drum_is_refused(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    with av.open(str(tmp_path / "none.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"x264-params": "mbtree=0"})
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"
        for _ in range(12):
            grey = random.integers(0, 40, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(grey, format="bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    with pytest.raises(NothingToMeasure, match="drum"):
        drum_measurement.measure(tmp_path / "none.mp4", Camera(frame_rate=30.0), drum_diameter=0.15)


def test_a_heap_that_slides_away_in_no_drum_is_refused(tmp_path: Path) -> None:
    random = np.random.default_rng(4)
    grains = random.uniform((-60, 0), (60, 60), (500, 2))
    grains = grains[grains[:, 1] < 60 - 0.016 * grains[:, 0] ** 2]
    shade = random.integers(70, 140, len(grains))
    with av.open(str(tmp_path / "heap.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "16", "x264-params": "mbtree=0"})
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"
        for _ in range(14):
            picture = np.full((SIZE[1], SIZE[0], 3), 225, np.uint8)
            for (x, y), tone in zip(grains + random.normal(0, 1.5, grains.shape), shade, strict=True):
                cv2.circle(picture, (round(150 + x), round(220 - y)), 4, (int(tone),) * 3, -1, cv2.LINE_AA)
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    with pytest.raises(
        NothingToMeasure, match=r"^[^;]*, and the upper border of what moves bows by [^;]*; film the end[^;]*cx,cy,r\.$"
    ):
        measured(tmp_path / "heap.mp4")


def test_a_film_that_shows_no_surface_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    film(tmp_path / "drum.mp4", 30.0, frames=12)
    follow = drum_measurement.follow_bed

    def unseen(*media: object, **known: object) -> Bed:
        bed = follow(*media, **known)  # type: ignore[arg-type]
        # a border that is seen along a few beads at either end only
        for outline in bed.outlines:
            outline.height[np.abs(outline.x) < 0.6 * RADIUS_PX] = np.nan
        return bed

    monkeypatch.setattr(drum_measurement, "follow_bed", unseen)
    with pytest.raises(NothingToMeasure, match="give the original file, light the drum"):
        measured(tmp_path / "drum.mp4")


# ----------------------------------------------------------------------------------------- what is in front of the drum


def test_what_passes_beside_the_drum_is_seen_and_a_flickering_lamp_is_not() -> None:
    random = np.random.default_rng(3)
    scene = np.clip(120 + cv2.GaussianBlur(random.normal(0, 120, (240, 240)), (0, 0), 4), 0, 255).astype(np.float32)
    y, x = np.mgrid[:240, :240]
    beside = np.hypot(x - 120, y - 120) > 1.15 * 80

    def hides(grey: Array) -> bool:
        noisy = np.clip(grey + random.normal(0, 3, grey.shape), 0, 255).astype(np.uint8)
        still = Still(0, 0.0, cv2.merge([noisy] * 3), np.zeros((240, 240), np.float32), (0.0, 0.0))
        return _hides(still, scene, beside)

    hand = scene.copy()
    hand[:, :40] = 200
    assert hides(hand)
    assert not hides(scene)
    assert not hides(1.1 * scene)


@pytest.mark.parametrize(
    ("lift", "failing"), [("none", set()), ("arc", {"surface_shape"}), ("step", {"surface_steps"})]
)
def test_an_outline_that_no_flowing_bed_has_fails_a_check(lift: str, failing: set[str]) -> None:
    x = np.linspace(-100, 100, 201)
    height = {
        "none": 0.5 * x + 10 * np.sin(np.pi * x / 100),
        "arc": np.sqrt(120.0**2 - x**2),
        "step": 0.5 * x + 60 * (x > 10),
    }[lift]
    outline = Outline(0, 0.0, x, height, height, height, 1.0, (0.0, 0.0))
    checks = drum_checks._checks_of_shape(SimpleNamespace(outlines=(outline,) * 3, bead=8.0))  # type: ignore[arg-type]
    assert {check.check for check in checks if not check.passed} == failing


@pytest.mark.parametrize(
    ("light", "hidden"),
    [
        ("even", False),
        ("falling off by 30 grey levels", False),
        ("a lamp at the axis", True),
        ("a lamp at the end", True),
        ("lighter beads in 0.2 of the bed", False),
        ("lighter beads in 0.35 of the bed", False),
        ("lighter beads in 0.5 of the bed", False),
    ],
)
@pytest.mark.parametrize("wall", [40, 170, 250])
def test_a_lamp_mirrored_in_the_glass_is_distinguished_from_uneven_light_and_lighter_beads(
    light: str, hidden: bool, wall: int
) -> None:
    random = np.random.default_rng(4)
    y, x = np.mgrid[:240, :240] - 120.0
    lamp = {"a lamp at the axis": (0.0, 0.0), "a lamp at the end": (80.0, -40.0)}.get(light)
    added = np.zeros_like(x) if lamp is None else 100 * np.exp(-(np.hypot(x - lamp[0], y - lamp[1]) ** 2) / 700)
    if light.startswith("falling"):
        added = 30 * (120 - x) / 240
    tone = np.full_like(x, 90)
    if light.startswith("lighter"):
        tone[np.abs(x - 20) < 110 * float(light.split()[3])] += 80
    border = np.arange(-110.0, 111.0)
    heights = 0.5 * border + random.normal(0, 2, (6, len(border)))
    pictures = []
    for height in heights:
        bed = -y < np.interp(x, border, height)
        grey = np.where(bed, tone * (1 + random.standard_normal(x.shape) / 3), wall) + added
        pictures.append(cv2.merge([np.clip(grey, 0, 255).astype(np.uint8)] * 3))
    share = brightened_share(pictures, border, heights, (120.0, 120.0), 118.0, 0.0, 8.0)
    assert (share > drum_checks.GLARE) == hidden


def test_a_surface_seen_at_both_ends_alone_gives_no_glare() -> None:
    x = np.concatenate([np.arange(-110.0, -100.0), np.arange(101.0, 111.0)])
    picture = np.full((240, 240, 3), 90, np.uint8)
    share = brightened_share([picture] * 3, x, np.tile(0.5 * x, (3, 1)), (120.0, 120.0), 118.0, 0.0, 8.0)
    assert math.isnan(share)
