"""Restitution of a falling bead from drawn clips and simulated tracks of known truth."""

import math
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigtwin.lab.camera import Camera, Lens, Moment
from rigtwin.lab.errors import BadInput, NothingToMeasure, UnreadableMedia
from rigtwin.lab.records import Track, write_tracks
from rigtwin.measure.drop import bounce_fit, checks, fall_in_air
from rigtwin.measure.drop import evaluate as drop
from rigtwin.measure.drop import measurement as drop_measurement
from rigtwin.measure.drop.scale import radius_uncertainty
from rigtwin.measure.media import video_file as sources
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tracking import detect as spots
from rigtwin.measure.tracking import link as spots_link
from rigtwin.measure.tracking.exposure_time import NOT_MEASURED
from rigtwin.measure.tracking.follow import Chase

G = 9.81
FPS = 240.0
SCALE = 0.0005  # [m/px] of the drawn clips
DIAMETER = 0.006  # [m]


def fall(times, *, height=0.25, restitution=0.7, drag=0.0, release=0.03):
    """Height of the lowest point under gravity and drag k v |v|, bouncing with one restitution, shape (n,).

    `drag` [1/m] is k, or a function that gives k at a speed.
    """
    strength = drag if callable(drag) else lambda _: drag

    def motion(_, state):
        return [state[1], -G - strength(abs(state[1])) * state[1] * abs(state[1])]

    def floor(_, state):
        return state[0]

    floor.terminal, floor.direction = True, -1
    heights = np.full(len(times), height)
    state, now = [height, 0.0], release
    while now < times[-1]:
        flight = solve_ivp(
            motion, (now, times[-1] + 0.01), state, events=floor, dense_output=True, rtol=1e-9, atol=1e-12
        )
        inside = (times >= now) & (times <= flight.t[-1])
        if np.any(inside):
            heights[inside] = flight.sol(times[inside])[0]
        if not flight.t_events[0].size:
            break
        now, state = float(flight.t_events[0][0]), [1e-12, -restitution * float(flight.y_events[0][0][1])]
        if state[1] < 0.05:  # rest on the plate instead of infinitely many bounces
            heights[times > now] = 0.0
            break
    return heights


def track(*, fps=FPS, duration=0.95, noise=5e-5, seed=0, sideways=0.01, **motion):
    times = np.arange(round(duration * fps)) / fps
    rng = np.random.default_rng(seed)
    position = np.stack([sideways * times, fall(times, **motion)], axis=1) + noise * rng.standard_normal(
        (len(times), 2)
    )
    return Track(times, position, np.full(len(times), noise if noise else np.nan))


def pick(quantities, name, *, method=None, bounce=None):
    found = [
        q
        for q in quantities
        if q.quantity == name and method in (None, q.method) and bounce in (None, q.detail.get("bounce"))
    ]
    assert len(found) == 1, [q.to_json() for q in quantities]
    return found[0]


def check(result, name):
    return next(each for each in result.checks if each.check == name)


# ------------------------------------------------------------------------------------------------------------- tracks


@pytest.mark.parametrize("method", ["height", "velocity"])
def test_without_air_all_methods_give_the_restitution_of_the_contact(method):
    result = drop.evaluate(track(), bead_diameter=0.006, bead_density=7800.0)
    for bounce in (1, 2):
        e = pick(result.quantities, "restitution_wall", method=method, bounce=bounce)
        assert e.value == pytest.approx(0.7, abs=0.001)
        assert not e.doubtful
    assert pick(result.quantities, "restitution_wall", method="time", bounce=2).value == pytest.approx(0.7, abs=0.001)


def test_heights_and_impact_speed_match_the_simulated_fall():
    result = drop.evaluate(track(), bead_diameter=0.006, bead_density=7800.0)
    assert pick(result.quantities, "drop_height").value == pytest.approx(0.25, rel=0.004)
    assert pick(result.quantities, "rebound_height", bounce=1).value == pytest.approx(0.25 * 0.49, rel=0.006)
    speed = pick(result.quantities, "restitution_wall", method="velocity", bounce=1).detail["impact_speed_m_s"]
    assert speed == pytest.approx(math.sqrt(2 * G * 0.25), rel=0.003)
    assert check(result, "gravity").passed


@pytest.mark.parametrize("known", [True, False])
def test_air_drag_lowers_the_heights_but_not_the_restitution_at_the_contact(known):
    """A light bead, k = 0.35 / m: sqrt(h2/h1) is 2 to 3 % too small due to drag, not due to the contact."""
    k = 0.35
    # the bead whose drag coefficient is 0.44 at these speeds: k = 0.75 * 0.44 * 1.2 / (density * diameter)
    diameter = 0.06
    bead = {"bead_diameter": diameter, "bead_density": 0.75 * 0.44 * 1.2 / (k * diameter)} if known else {}
    result = drop.evaluate(track(drag=k, height=0.5, duration=1.2, noise=1e-4), **bead)
    by_speed = pick(result.quantities, "restitution_wall", method="velocity", bounce=1)
    by_height = pick(result.quantities, "restitution_wall", method="height", bounce=1)
    assert by_speed.value == pytest.approx(0.7, abs=0.007)
    assert by_height.value < 0.689
    low, high = by_speed.interval95
    assert low - 0.002 < 0.7 < high + 0.002


def test_restitution_does_not_depend_on_the_frame_rate():
    slow = drop.evaluate(track(fps=120.0, noise=2e-5))
    fast = drop.evaluate(track(fps=240.0, noise=2e-5))
    for method in ("height", "velocity"):
        a = pick(slow.quantities, "restitution_wall", method=method, bounce=1)
        b = pick(fast.quantities, "restitution_wall", method=method, bounce=1)
        assert a.value == pytest.approx(b.value, abs=2 * math.hypot(a.std_uncertainty, b.std_uncertainty))
        assert a.value == pytest.approx(b.value, abs=0.002)


def test_restitution_does_not_depend_on_scale_or_mirroring():
    first = track()
    other = replace(first, position=first.position * [-3.0, 3.0], sigma=first.sigma * 3)
    a, b = drop.evaluate(first), drop.evaluate(other)
    for method in ("height", "velocity"):
        e = [pick(each.quantities, "restitution_wall", method=method, bounce=1).value for each in (a, b)]
        assert e[0] == pytest.approx(e[1], abs=1e-4)
    assert check(a, "gravity").passed
    assert not check(b, "gravity").passed


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_an_exact_track_without_sigma_gives_the_exact_restitution(noise):
    """Exact heights, no sigma: only the bias of the estimator remains."""
    made = replace(track(noise=noise, fps=400.0), sigma=np.full(380, np.nan))
    result = drop.evaluate(made, bead_diameter=0.006, bead_density=7800.0)
    assert pick(result.quantities, "restitution_wall", method="velocity", bounce=1).value == pytest.approx(
        0.7, abs=5e-4
    )


def test_stated_intervals_cover_the_truth_at_their_nominal_rate():
    """24 records of 6 numbers with random restitution, phase, noise and gaps: 95 % coverage expected."""
    rng = np.random.default_rng(11)
    scaled = []
    for seed in range(24):
        e = rng.uniform(0.5, 0.85)
        made = track(
            restitution=e,
            release=rng.uniform(0.02, 0.04),
            noise=10 ** rng.uniform(-4.6, -3.6),
            seed=seed,
            sideways=0.02,
        )
        kept = rng.uniform(size=len(made.time)) > 0.02
        result = drop.evaluate(Track(made.time[kept], made.position[kept], made.sigma[kept]))
        for method in ("height", "velocity"):
            for q in result.quantities:
                if q.quantity == "restitution_wall" and q.method == method and q.detail["bounce"] < 4:
                    scaled.append((q.value - e) / q.std_uncertainty)
    assert np.mean(np.abs(scaled) < 1.96) > 0.88
    assert np.std(scaled) > 0.15


def test_bounding_boxes_of_moving_spots_do_not_overlap():
    """The bounding box of a bent part may contain another part, which must not be counted twice."""
    mask = np.zeros((20, 20), np.uint8)
    mask[2, 2:15] = mask[2:15, 2] = mask[10:12, 10:12] = mask[18, 18] = 1
    assert sorted(spots._boxes_apart(mask)) == [(2, 2, 13, 13), (18, 18, 1, 1)]


def test_noisier_tracks_have_wider_intervals():
    clean, noisy = (drop.evaluate(track(noise=noise)) for noise in (2e-5, 4e-4))
    a, b = (pick(each.quantities, "restitution_wall", method="velocity", bounce=2) for each in (clean, noisy))
    assert b.budget["tracking"] > 5 * a.budget["tracking"]


def test_horizontal_residuals_enlarge_the_uncertainty_of_heights():
    steady = track(noise=3e-5)
    sway = 2.5e-4 * np.sin(2 * math.pi * steady.time / 0.23)
    rng = np.random.default_rng(3)
    across = 0.01 * steady.time + sway + rng.normal(0, 3e-5, len(sway))
    record = bounce_fit.Heights(steady.time, steady.position[:, 1], steady.sigma)
    budgets = [
        bounce_fit.fit_bounces(replace(record, across=horizontal), fall_in_air.AirDrag()).read(lambda at: at.size)[1]
        for horizontal in (None, across)
    ]
    vertical_only, with_horizontal = (math.hypot(*parts.values()) for parts in budgets)
    assert with_horizontal > 1.3 * vertical_only


def test_budget_adds_up_to_the_standard_uncertainty():
    for quantity in drop.evaluate(track()).quantities:
        assert math.sqrt(sum(part**2 for part in quantity.budget.values())) == pytest.approx(quantity.std_uncertainty)


def test_slow_motion_taken_for_real_time_fails_the_gravity_check():
    """Captured at 240 Hz, stamped as if at 30 Hz: g is 64 times too small, the restitution does not change."""
    made = track()
    result = drop.evaluate(replace(made, time=made.time * 8))
    gravity = check(result, "gravity")
    assert not gravity.passed
    assert gravity.value == pytest.approx(G / 64, rel=0.02)
    assert "captured at 240 Hz" in gravity.message
    assert pick(result.quantities, "drop_height").doubtful
    assert pick(result.quantities, "restitution_wall", method="time", bounce=2).value == pytest.approx(0.7, abs=0.003)


def test_slow_motion_of_a_light_bead_of_known_drag_is_recognised_and_not_refused():
    made = track(drag=0.2, noise=1e-4)
    result = drop.evaluate(replace(made, time=made.time * 8), bead_diameter=0.006, bead_density=568.0)
    assert "slow motion by 8" in check(result, "gravity").message
    real = drop.evaluate(made, bead_diameter=0.006, bead_density=568.0)
    slow_e, e = (pick(each.quantities, "restitution_wall", method="height", bounce=1).value for each in (result, real))
    assert slow_e == pytest.approx(e, abs=0.003)
    assert "the air" in pick(result.quantities, "restitution_wall", method="velocity", bounce=1).doubtful


def test_doubled_frames_are_left_out_and_named():
    """Every frame twice at the stated rate: the record lasts twice as long, and g is four times too small."""
    made = track(duration=0.7)
    twice = np.repeat(made.position, 2, axis=0) + np.random.default_rng(3).normal(0, 1e-5, (2 * len(made.time), 2))
    times = np.arange(len(twice)) / FPS
    result = drop.evaluate(Track(times, twice, np.full(len(times), 5e-5)))
    assert "doubled frames" in check(result, "frame_timing").message
    assert "doubled frames" in check(result, "gravity").message
    assert "--frame-rate 480Hz" in check(result, "gravity").message
    e = pick(result.quantities, "restitution_wall", method="height", bounce=1)
    assert e.value == pytest.approx(0.7, abs=0.004)


def test_the_gravity_check_distinguishes_a_wrong_scale_slow_motion_and_clean_records():
    rng = np.random.default_rng(17)
    recognised = {"the scale": 0, "slow motion": 0, "clean": 0}
    for seed in range(4):
        made = track(
            restitution=rng.uniform(0.5, 0.8),
            height=rng.uniform(0.15, 0.4),
            release=rng.uniform(0.02, 0.04),
            noise=1e-4,
            seed=seed,
            duration=0.8,
        )
        faults = {
            "the scale": replace(made, position=made.position * (1 + 0.03 * rng.choice([-1, 1]))),
            "slow motion": replace(made, time=made.time * rng.choice([4.0, 8.0])),
            "clean": made,
        }
        for name, record in faults.items():
            gravity = check(drop.evaluate(record), "gravity")
            others = {"the scale", "slow motion", "doubled"} - {name}
            first = min(gravity.message.find(word) % 10_000 for word in others)
            recognised[name] += gravity.passed if name == "clean" else gravity.message.find(name) % 10_000 < first
    assert recognised["clean"] == recognised["the scale"] == recognised["slow motion"] == 4, recognised


@pytest.mark.parametrize(("jitter", "lost"), [(0.1, 0.0), (0.0, 0.3), (0.05, 0.3)])
def test_uneven_or_missing_frames_with_true_times_do_not_change_the_restitution(jitter, lost):
    random = np.random.default_rng(8)
    times = np.arange(0.0, 0.95, 1 / FPS)
    times = np.sort(times + random.uniform(-jitter, jitter, len(times)) / FPS)[random.random(len(times)) >= lost]
    noise = 5e-5
    position = np.column_stack([0 * times, fall(times)]) + noise * random.standard_normal((len(times), 2))
    result = drop.evaluate(Track(times, position, np.full(len(times), noise)))
    found = pick(result.quantities, "restitution_wall", method="height", bounce=1)
    assert not found.doubtful
    assert abs(found.value - 0.7) < 4 * found.std_uncertainty < 0.01


def test_nan_points_of_a_record_are_left_out():
    made = track()
    holed = made.position.copy()
    holed[40:43] = np.nan
    result = drop.evaluate(replace(made, position=holed))
    assert pick(result.quantities, "restitution_wall", method="velocity", bounce=1).value == pytest.approx(
        0.7, abs=0.002
    )


def test_a_scale_error_of_five_percent_fails_the_gravity_check():
    made = track()
    result = drop.evaluate(replace(made, position=made.position * 1.05))
    gravity = check(result, "gravity")
    assert not gravity.passed
    assert gravity.value == pytest.approx(1.05 * G, rel=0.004)
    assert "the scale" in gravity.message


def test_a_disturbing_force_makes_the_result_doubtful():
    made = track()
    bump = 1.5e-3 * np.sin(2 * np.pi * made.time / 0.045)
    result = drop.evaluate(replace(made, position=made.position + np.stack([0 * bump, bump], axis=1)))
    assert not check(result, "flight_residuals").passed
    assert pick(result.quantities, "restitution_wall", method="velocity", bounce=1).doubtful


def test_following_another_object_affects_only_later_bounces():
    whole = track(duration=1.3)
    contacts = [float(pick(drop.evaluate(whole).quantities, "restitution_wall", method="velocity", bounce=k)
                      .detail["contact_time_s"]) for k in (3, 4)]  # fmt: skip
    since = (whole.time - contacts[0]) / (contacts[1] - contacts[0])
    lost = (since > 0.1) & (since < 0.9)
    low = np.array(whole.position)
    low[lost, 1] = 0.004 + 0.003 * np.sin(9 * since[lost])
    kept = ~lost | (np.arange(len(lost)) % 3 == 0)
    found = drop.evaluate(Track(whole.time[kept], low[kept], whole.sigma[kept])).quantities
    for quantity in (q for q in found if q.quantity == "restitution_wall"):
        assert quantity.doubtful or abs(quantity.value - 0.7) < 3 * quantity.std_uncertainty, quantity
    assert not pick(found, "restitution_wall", method="velocity", bounce=1).doubtful


def test_a_restitution_above_one_makes_results_doubtful_from_the_bounce_before():
    speeds, time, starts = [1.4, 1.0, 0.7, 0.8, 0.56], 0.05 + 1.4 / G, []
    for speed in speeds[1:]:
        starts.append((time, speed))
        time += 2 * speed / G
    times = np.arange(round(time * FPS)) / FPS
    heights = 1.4**2 / (2 * G) - G / 2 * np.maximum(times - 0.05, 0) ** 2
    for begun, speed in starts:
        since = times - begun
        heights = np.where(since > 0, speed * since - G / 2 * since**2, heights)
    position = np.stack([0 * times, heights], axis=1) + 2e-5 * np.random.default_rng(3).standard_normal((len(times), 2))
    found = drop.evaluate(Track(times, position, np.full(len(times), 2e-5))).quantities
    doubtful = [bool(pick(found, "restitution_wall", method="velocity", bounce=k).doubtful) for k in (1, 2, 3)]
    assert doubtful == [False, True, True]
    assert pick(found, "rebound_height", bounce=3).doubtful


@pytest.mark.parametrize("bend", [-0.25, 0.2])
def test_lens_distortion_is_fitted_from_the_flights(bend):
    """`bend` is the relative radial distortion of the lens 0.1 m off its axis."""
    bare = track(noise=3e-5, seed=5, height=0.12, duration=0.6)
    off = (bare.position - [0, 0.06]) / 0.1
    seen = replace(bare, position=[0, 0.06] + 0.1 * off * (1 + bend * np.sum(off**2, axis=1, keepdims=True)))
    result = drop.evaluate(seen, bead_diameter=0.006, bead_density=7800.0)
    for bounce in (1, 2):
        e = pick(result.quantities, "restitution_wall", method="velocity", bounce=bounce)
        assert e.value == pytest.approx(0.7, abs=min(2 * e.std_uncertainty, 0.001))
        assert not e.doubtful


def test_a_bead_that_bounces_sideways_fails_the_plane_check():
    result = drop.evaluate(track(sideways=0.6))
    assert not check(result, "out_of_plane").passed


@pytest.mark.parametrize("seed", range(3))
def test_two_views_give_the_restitution_of_a_sideways_bounce(seed):
    """Straight down, then 0.8 m/s to the right and 1.1 m/s away from the viewer."""
    hit, fast = 0.03 + math.sqrt(2 * 0.25 / G), math.sqrt(2 * G * 0.25)
    fallen = track(sideways=0.0, restitution=0.5, seed=seed)
    noise = np.random.default_rng(seed + 10).normal(scale=5e-5, size=(2, len(fallen.time)))
    later = np.maximum(fallen.time - hit, 0.0)
    front = replace(fallen, position=np.stack([0.8 * later + noise[0], fallen.position[:, 1]], axis=1))
    side = replace(fallen, position=np.stack([1.1 * later + noise[1], fallen.position[:, 1]], axis=1))

    both = pick(drop.evaluate(front, side=side).quantities, "restitution_wall", method="all directions", bounce=1)
    assert both.value == pytest.approx(math.hypot(0.5 * fast, 0.8, 1.1) / fast, abs=4 * both.std_uncertainty)
    assert both.std_uncertainty < 2e-3
    assert not both.doubtful
    second = pick(drop.evaluate(front, side=side).quantities, "restitution_wall", method="all directions", bounce=2)
    expected = math.hypot(0.25 * fast, 0.8, 1.1) / math.hypot(0.5 * fast, 0.8, 1.1)
    assert second.value == pytest.approx(expected, abs=4 * second.std_uncertainty)

    alone = pick(drop.evaluate(front).quantities, "restitution_wall", method="picture plane", bounce=1)
    assert alone.value == pytest.approx(math.hypot(0.5 * fast, 0.8) / fast, abs=4e-3)
    assert "from one side" in alone.doubtful


def test_a_bead_that_falls_straight_has_no_restitution_in_all_directions():
    assert all(q.method not in ("all directions", "picture plane") for q in drop.evaluate(track()).quantities)


def test_a_fall_without_rebound_is_refused():
    with pytest.raises(NothingToMeasure, match="no turn from falling to rising"):
        drop.evaluate(track(duration=0.24))


def test_a_bead_at_rest_is_refused():
    with pytest.raises(NothingToMeasure, match="times the noise of its position"):
        drop.evaluate(track(release=9.0))


def test_a_tracked_record_is_evaluated_and_plotted(tmp_path):
    path = tmp_path / "rep.csv"
    write_tracks(path, [track()])
    result = drop_measurement.measure(path, Camera(), out=tmp_path / "out")
    assert pick(result.quantities, "restitution_wall", method="height", bounce=1).value == pytest.approx(0.7, abs=0.002)
    assert result.files["plot"].read_text().lstrip().startswith("<?xml")
    assert list(result.files) == ["plot"]


def test_a_table_with_damaged_digits_that_leave_the_drag_without_variance_is_doubtful(tmp_path):
    time = np.round(np.arange(70) / FPS, 6)
    contact = math.sqrt(2 * 0.05 / G) * np.array([0.0, 1.0, 2.4, 3.38])
    first, second, third = (np.arange(70) / FPS - begins for begins in contact[:3])
    flights = [0.05 - G / 2 * first**2]
    flights += [since * (G * contact[1] * speed - G / 2 * since) for since, speed in ((second, 0.7), (third, 0.49))]
    height = np.round(np.select([second < 0, third < 0], flights[:2], flights[2]), 6)
    across = np.zeros(70)
    height[29], across[55] = 0.00167415, 0.000864944
    rows = "\n".join(f"{t:.6f},{x!r},{z!r}" for t, x, z in zip(time, across.tolist(), height.tolist(), strict=True))
    (tmp_path / "r01.csv").write_text(f"time_s,x_m,y_m\n{rows}\n")
    result = drop_measurement.measure(tmp_path / "r01.csv", Camera())
    assert result.quantities
    assert all("times the noise of the track" in one.doubtful for one in result.quantities)


# -------------------------------------------------------------------------------------------------------------- clips


def film(
    path: Path,
    *,
    fps=FPS,
    mirrored=False,
    bead=True,
    frames=150,
    roll=0.0,
    noise=2.0,
    playback=30,
    doubled=False,
    hidden=0.0,
) -> Path:
    """Draw a clip: textured wall, plate, holder, a lit bead of 6 px radius with a third of a frame of motion blur.

    With `doubled` every second frame repeats the one before, and the camera shakes by 1.5 px.  With `hidden` [px] the
    camera shakes too, but the wall does not move, as after a coarse codec.
    """
    width, height, radius = 176, 352, DIAMETER / 2 / SCALE
    rng = np.random.default_rng(7)
    wall = 130 + 3 * cv2.GaussianBlur(rng.normal(0, 30, (height, width)).astype(np.float32), (0, 0), 4)
    wall[320:] = 90
    wall[:22, 80:92] = 40
    y, x = np.mgrid[:height, :width].astype(np.float32)
    fine = np.arange(3 * frames) / (3 * fps)
    drops = fall(fine, height=0.14, release=0.02) / SCALE
    last = wall
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=playback, options={"crf": "16", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for k in range(frames):
            light, cover = np.zeros_like(wall), np.zeros_like(wall)
            for part in (0, 1):  # blur over the first third of the frame
                here = float(drops[3 * k] * (1 - part / 2) + drops[3 * k + 1] * part / 2) if bead else 1e4
                cx, cy = 86 + 0.02 * k, 320 - radius - here
                dx, dy = (x - cx) * math.cos(roll) + (y - cy) * math.sin(roll), y - cy
                distance = np.hypot(x - cx - math.tan(roll) * (cy - 320), dy)
                soft = np.clip(radius - distance + 0.5, 0, 1)
                light += soft * (205 - 25 * dy / radius + 0 * dx) / 2
                cover += soft / 2
            picture = cv2.GaussianBlur(wall * (1 - cover) + light, (0, 0), 0.6) + rng.normal(0, noise, wall.shape)
            grey = np.clip(picture, 0, 255).astype(np.uint8)
            grey = np.ascontiguousarray(grey[:, ::-1]) if mirrored else grey
            if doubled:
                sway = np.array([[1, 0, 2 * math.sin(k / 9)], [0, 1, 1.5 * math.sin(k / 7 + 1)]])
                grey = last if k % 2 else np.asarray(cv2.warpAffine(grey, sway, (width, height), borderMode=1))
                last = grey
            if hidden:
                sway = np.array([[1, 0, 0], [0, 1, hidden * math.cos(k / 6)]])
                stays = (np.abs(x - 86) > 20) & (y < 312)
                last = grey if k == 0 else last
                grey = np.where(stays, last, cv2.warpAffine(grey, sway, (width, height), borderMode=1))
            frame = av.VideoFrame.from_ndarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), format="bgr24")
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


CAMERA = Camera(frame_rate=FPS)
CUT = Moment(115, "frame")  # a little after the second impact: enough for scales and their checks


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return film(tmp_path_factory.mktemp("drop") / "bounce.mp4")


@pytest.fixture(scope="module")
def measured(clip):
    return drop_measurement.measure(clip, CAMERA, bead_diameter=DIAMETER, bead_density=7800.0, out=clip.parent / "out")


def test_a_clip_gives_the_restitution_it_was_drawn_with(measured):
    for method in ("height", "velocity"):
        e = pick(measured.quantities, "restitution_wall", method=method, bounce=1)
        assert e.value == pytest.approx(0.7, abs=0.004)
        assert abs(e.value - 0.7) < 3 * e.std_uncertainty
    assert all(each.passed for each in measured.checks), [each.to_json() for each in measured.checks]


def test_a_clip_gives_the_height_it_was_drawn_with(measured):
    assert pick(measured.quantities, "drop_height").value == pytest.approx(0.14, rel=0.01)


def test_all_output_files_are_written(measured):
    assert {"overlay", "still", "plot", "record"} <= set(measured.files)
    assert all(path.stat().st_size > 500 for path in measured.files.values())
    assert not list(measured.files["still"].parent.glob("*part*"))
    with av.open(str(measured.files["overlay"])) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert sum(1 for _ in container.decode(stream)) == 150


def test_scales_from_rule_bead_and_gravity_agree(clip, measured):
    given = drop_measurement.measure(clip, Camera(frame_rate=FPS, scale=SCALE, end=CUT))
    gravity = drop_measurement.measure(clip, CAMERA)
    assert given.camera["scale_from"] == "given"
    assert gravity.camera["scale_from"] == "gravity"
    assert check(given, "gravity").passed
    assert all(each.check != "gravity" for each in gravity.checks)
    assert any("frame rate not confirmed" in each for each in gravity.warnings)
    assert gravity.camera["scale_m_per_px"] == pytest.approx(SCALE, rel=0.006)
    assert measured.camera["scale_m_per_px"] == pytest.approx(SCALE, rel=0.006)
    assert 2 * measured.camera["bead_radius_px"] * SCALE == pytest.approx(DIAMETER, rel=0.03)


@pytest.mark.parametrize(
    ("rate", "across"), [(FPS / 1.25, 1.0), (FPS, 1.3), pytest.param(FPS, 0.7, marks=pytest.mark.slow)]
)
def test_a_rate_and_diameter_that_contradict_gravity_make_lengths_doubtful(clip, rate, across):
    result = drop_measurement.measure(
        clip, Camera(frame_rate=rate), bead_diameter=across * DIAMETER, bead_density=7800.0
    )
    gravity, height = check(result, "gravity"), pick(result.quantities, "drop_height")
    assert not gravity.passed
    assert "mm across" in gravity.message
    assert "captured at" in gravity.message
    assert height.doubtful
    assert abs(height.value - 0.14) < 2 * height.std_uncertainty
    assert pick(result.quantities, "restitution_wall", method="velocity", bounce=1).doubtful
    assert not pick(result.quantities, "restitution_wall", method="height", bounce=1).doubtful


def test_a_small_error_of_the_diameter_is_no_contradiction_but_a_neighbouring_frame_rate_is():
    rim = 0.012  # relative, for a bead of 20 px radius
    assert checks.scales_agree(1.04, rim)
    assert not checks.scales_agree((25 / 24) ** 2, rim)
    assert "at 1000 ± 60 Hz and not at 1200" in checks.contradiction(1.44, 0.12, 1200.0, 0.006)


def test_a_radius_without_fitted_rim_contradicts_rates_of_50_and_60_but_no_scale_error_of_20_percent():
    spot = spots_link.SpotPath((0, 1), (spots.Spot(10.0, 10.0, 60.0, 9.0, 9.0, 20.0),) * 2)
    scene = Scene(np.zeros((20, 20)), np.ones((20, 20)))
    uncertainty = radius_uncertainty(Chase((), spot, (), NOT_MEASURED, 4.5, scene, (), None, None))
    assert checks.scales_agree(1.2, uncertainty)
    assert not checks.scales_agree((60 / 50) ** 2, uncertainty)


def test_a_contact_is_longer_for_larger_beads_and_slower_falls():
    small, large = fall_in_air.AirDrag(0.006, 2500.0), fall_in_air.AirDrag(0.012, 2500.0)
    assert fall_in_air.longest_contact(large, 0.3) == pytest.approx(2 * fall_in_air.longest_contact(small, 0.3))
    assert fall_in_air.longest_contact(small, 0.03) > fall_in_air.longest_contact(small, 0.3)
    # Hertz for a glass bead of 6 mm on rubber, at 2.4 m/s: about half a millisecond
    assert 3e-4 < fall_in_air.longest_contact(small, 0.3) < 7e-4


def test_without_density_the_drag_law_of_the_diameter_is_used():
    def strength(speed):
        # Schiller and Naumann's coefficient of a wooden bead, three times 0.44 where it is slow
        reynolds = max(1.2 * speed * DIAMETER / 1.8e-5, 1e-9)
        return 0.75 * max(24 / reynolds * (1 + 0.15 * reynolds**0.687), 0.44) * 1.2 / (628 * DIAMETER)

    made = track(drag=strength, noise=5e-5)
    sized = pick(
        drop.evaluate(made, bead_diameter=DIAMETER).quantities, "restitution_wall", method="velocity", bounce=2
    )
    weighed = pick(
        drop.evaluate(made, bead_diameter=DIAMETER, bead_density=628.0).quantities,
        "restitution_wall",
        method="velocity",
        bounce=2,
    )
    assert abs(sized.value - 0.7) < 2 * sized.std_uncertainty < 4e-3
    # knowledge of the air drag does not increase the uncertainty
    assert weighed.std_uncertainty < 1.1 * sized.std_uncertainty
    assert sized.budget["air drag"] > 0


@pytest.mark.slow
def test_the_uncertainty_of_a_board_enters_the_budget_of_heights(clip):
    board = Lens((176, 352), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 0.0), SCALE, 0.02, 0.1)
    result = drop_measurement.measure(clip, Camera(frame_rate=FPS, scale=SCALE, lens=board, end=CUT))
    height = pick(result.quantities, "drop_height")
    assert result.camera["scale_from"] == "board"
    assert height.budget["scale"] == pytest.approx(0.02 * height.value)


@pytest.mark.slow
def test_a_mirrored_clip_gives_the_same_restitution(tmp_path, measured):
    mirrored = drop_measurement.measure(film(tmp_path / "mirrored.mp4", mirrored=True), CAMERA, bead_density=7800.0)
    for method in ("height", "velocity"):
        a = pick(mirrored.quantities, "restitution_wall", method=method, bounce=1)
        b = pick(measured.quantities, "restitution_wall", method=method, bounce=1)
        assert a.value == pytest.approx(b.value, abs=3 * math.hypot(a.std_uncertainty, b.std_uncertainty))


def test_camera_shake_and_doubled_frames_are_corrected_and_reported(tmp_path):
    result = drop_measurement.measure(film(tmp_path / "doubled.mp4", doubled=True), CAMERA, bead_diameter=DIAMETER)
    assert "doubled frames" in check(result, "frame_timing").message
    assert check(result, "static_camera").passed
    assert check(result, "static_camera").value > 0.8
    assert check(result, "bead_size").passed
    e = pick(result.quantities, "restitution_wall", method="height", bounce=1)
    assert e.value == pytest.approx(0.7, abs=max(0.006, 2 * e.std_uncertainty))


@pytest.mark.slow
def test_camera_shake_hidden_by_the_codec_makes_all_quantities_doubtful(tmp_path):
    result = drop_measurement.measure(film(tmp_path / "hidden.mp4", hidden=0.7), CAMERA, bead_diameter=DIAMETER)
    camera = check(result, "static_camera")
    assert not camera.passed
    assert camera.value < 0.2  # the wall appears still
    assert "strongest edges" in camera.message
    assert all("strongest edges" in each.doubtful for each in result.quantities)


@pytest.mark.slow
def test_long_films_and_large_pictures_give_the_same_result(clip, measured, monkeypatch):
    monkeypatch.setattr(sources, "KEPT", 10**5)
    monkeypatch.setattr(spots, "LARGE", 10**4)
    result = drop_measurement.measure(clip, CAMERA, bead_diameter=DIAMETER, bead_density=7800.0)
    for one, other in zip(result.quantities[:4], measured.quantities, strict=False):
        assert abs(one.value - other.value) < 0.3 * other.std_uncertainty


def test_a_region_without_the_bead_is_named_in_the_error(clip):
    with pytest.raises(NothingToMeasure, match=r"nothing was found to move inside --region 0,0,40,40"):
        drop_measurement.measure(clip, Camera(frame_rate=FPS, region=(0, 0, 40, 40)))


def test_a_region_outside_the_picture_is_bad_input(clip):
    with pytest.raises(BadInput, match="outside the picture"):
        drop_measurement.measure(clip, Camera(frame_rate=FPS, region=(5000, 0, 40, 40)))


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "passed"), [(0.0, True), (4.0, False)])
def test_a_camera_roll_that_contradicts_the_fall_makes_lengths_doubtful(clip, degrees, passed):
    result = drop_measurement.measure(
        clip, Camera(frame_rate=FPS, roll=math.radians(degrees), end=CUT), bead_diameter=DIAMETER
    )
    assert check(result, "camera_roll").passed is passed
    # a failed check marks all quantities that depend on it, and no others
    assert all(("camera roll" in each.doubtful) is (each.unit == "m" and not passed) for each in result.quantities)


@pytest.mark.parametrize(("rate", "advice"), [(None, "give --frame-rate"), (20.0, "20 Hz are fewer than the 30 Hz")])
def test_heights_with_scale_from_gravity_and_an_unlikely_rate_are_doubtful(clip, rate, advice):
    result = drop_measurement.measure(clip, Camera(frame_rate=rate, end=CUT))
    assert advice in pick(result.quantities, "drop_height").doubtful
    assert not pick(result.quantities, "restitution_wall", method="velocity", bounce=1).doubtful


@pytest.mark.slow
def test_a_clip_of_a_still_camera_is_read_at_most_twice(clip, monkeypatch):
    monkeypatch.setattr(sources, "KEPT", 10**5)
    read = []
    pictures = sources.Film.pictures

    def counted(film, start=0):
        for picture in pictures(film, start):
            read.append(picture)
            yield picture

    monkeypatch.setattr(sources.Film, "pictures", counted)
    drop_measurement.measure(clip, CAMERA)
    # once for the background (all frames of a short clip), once for the search, and the size from the first frame
    assert len(read) <= 2 * 150 + 1


def test_playback_rate_taken_for_the_capture_rate_is_flagged(clip):
    result = drop_measurement.measure(clip, Camera(scale=SCALE, end=CUT))
    assert not check(result, "gravity").passed
    assert "captured at 240 Hz" in check(result, "gravity").message
    assert any("read from the file" in line for line in result.warnings)


@pytest.mark.slow
def test_a_clip_that_ends_before_the_rebound_is_refused(tmp_path):
    with pytest.raises(NothingToMeasure, match="no turn from falling to rising"):
        drop_measurement.measure(film(tmp_path / "short.mp4", frames=42), CAMERA)


def test_a_clip_without_a_bead_is_refused(tmp_path):
    with pytest.raises(NothingToMeasure, match=r"nothing was found to move \(frames 0 to 29\)"):
        drop_measurement.measure(film(tmp_path / "empty.mp4", bead=False, frames=30), CAMERA)


@pytest.mark.parametrize("content", [b"", b"time_s,x_m\n1,2\n"])
def test_a_file_that_is_no_video_is_refused(tmp_path, content):
    path = tmp_path / "clip.mp4"
    path.write_bytes(content)
    with pytest.raises(UnreadableMedia, match=r"clip\.mp4"):
        drop_measurement.measure(path, CAMERA)
