"""The sample media agree with their truth, and the truth with physics."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

MEDIA = Path(__file__).resolve().parents[2] / "sample_media"
CLIPS = [("drop", "r01"), ("drop", "r02"), ("drop", "r03"), ("pendulum", "r01"), ("pendulum", "r02")]
VIEWS = ["view1", "view2", "view3", "view4"]
GRAVITY = 9.81


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    document: dict[str, Any] = json.loads((MEDIA / "truth.json").read_text(encoding="utf-8"))
    return document


def first_frame(path: Path) -> np.ndarray:
    with av.open(str(path)) as container:
        return next(container.decode(video=0)).to_ndarray(format="rgb24")


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((one.astype(float) - other.astype(float)) ** 2)))


@pytest.mark.parametrize(("rig", "name"), CLIPS)
def test_a_clip_has_the_frames_the_truth_speaks_of(truth: dict[str, Any], rig: str, name: str) -> None:
    known = truth[rig][name]
    with av.open(str(MEDIA / known["file"])) as container:
        frames = list(container.decode(video=0))
    assert len(frames) == known["frames"] == len(known["frame_start_s"])
    assert (frames[0].width, frames[0].height) == (known["width_px"], known["height_px"])
    times = [frame.time for frame in frames]
    np.testing.assert_allclose(times, known["frame_start_s"], atol=1e-4)


@pytest.mark.parametrize("name", VIEWS)
def test_a_photo_has_the_size_the_truth_speaks_of(truth: dict[str, Any], name: str) -> None:
    known = truth["pile"]["views"][name]
    picture = cv2.imread(str(MEDIA / known["file"]))
    assert picture is not None
    assert picture.shape == (known["height_px"], known["width_px"], 3)


def test_the_media_stay_small() -> None:
    shipped = [path for path in MEDIA.rglob("*") if path.is_file() and MEDIA / "out" not in path.parents]
    assert sum(path.stat().st_size for path in shipped) < 6e6


@pytest.mark.parametrize("name", ["r01", "r02", "r03"])
def test_the_dropped_bead_never_gains_energy(truth: dict[str, Any], name: str) -> None:
    known = truth["drop"][name]
    position = np.array(known["position_m"])
    step = 1 / known["frame_rate_hz"]
    velocity = np.gradient(position, step, axis=0)
    energy = GRAVITY * position[:, 2] + 0.5 * np.sum(velocity**2, axis=1)
    # central differences are exact for a parabola but not over a contact
    middle = np.array(known["frame_start_s"]) + known["exposure_s"] / 2
    away = np.ones(len(middle), dtype=bool)
    for moment in [known["release_time_s"], *(bounce["time_s"] for bounce in known["bounces"])]:
        away &= np.abs(middle - moment) > 1.01 * step
    away &= middle < known["bounces"][-1]["time_s"]
    assert np.diff(energy[away]).max() < 1e-4 * energy[0]
    assert energy[away][-1] < 0.1 * energy[0]


@pytest.mark.parametrize("name", ["r01", "r02", "r03"])
def test_heights_give_less_than_the_contact_because_air_takes_its_share(truth: dict[str, Any], name: str) -> None:
    known = truth["drop"][name]
    first = known["bounces"][0]
    # without air the bead would arrive with sqrt(2 g h); drag on a 6 mm wooden bead costs a few percent
    free = np.sqrt(2 * GRAVITY * known["heights_m"][0])
    assert 0.95 * free < first["speed_before_m_per_s"] < 0.99 * free
    assert first["apex_height_m"] < first["speed_after_m_per_s"] ** 2 / (2 * GRAVITY)
    assert first["speed_after_m_per_s"] / first["speed_before_m_per_s"] == pytest.approx(first["restitution"])
    assert 0.97 * first["restitution"] < known["restitution_from_heights"][0] < first["restitution"]


def test_one_repetition_hops_sideways_and_the_others_do_not(truth: dict[str, Any]) -> None:
    drift = {name: abs(known["position_m"][-1][0] - known["position_m"][0][0]) for name, known in truth["drop"].items()}
    assert drift["r03"] > 0.006
    assert max(drift["r01"], drift["r02"]) < 1e-6


@pytest.mark.parametrize("name", ["r01", "r02"])
def test_the_beads_keep_momentum_in_a_collision_and_lose_energy(truth: dict[str, Any], name: str) -> None:
    for hit in truth["pendulum"][name]["collisions"]:
        before, after = hit["speed_before_m_per_s"], hit["speed_after_m_per_s"]
        assert before["A"] + before["B"] == pytest.approx(after["A"] + after["B"], abs=1e-6)
        assert after["A"] ** 2 + after["B"] ** 2 < before["A"] ** 2 + before["B"] ** 2
        assert (after["B"] - after["A"]) / (before["A"] - before["B"]) == pytest.approx(hit["restitution"], rel=1e-5)


@pytest.mark.parametrize("name", ["r01", "r02"])
def test_the_pendulum_beads_stay_on_their_threads_and_apart(truth: dict[str, Any], name: str) -> None:
    known = truth["pendulum"][name]
    a, b = (np.array(known["position_m"][body]) for body in "AB")
    for body, place in (("A", a), ("B", b)):
        reach = np.linalg.norm(place - known["pivot_m"][body], axis=1)
        np.testing.assert_allclose(reach, known["length_m"], atol=1e-7)
    assert np.linalg.norm(a - b, axis=1).min() > known["bead_diameter_m"] - 1e-7
    # sin(half the angle) is the speed at the lowest point; friction and air cost a percent or two
    assert 0.96 * known["restitution"] < known["restitution_from_angles"] < known["restitution"]


def test_the_heap_is_made_of_beads_that_do_not_overlap_and_rest_on_something(truth: dict[str, Any]) -> None:
    from scipy.spatial.distance import cdist

    pile = truth["pile"]
    centres = np.array(pile["bead_centres_m"])
    d = pile["bead_diameter_m"]
    apart = cdist(centres, centres) + np.eye(len(centres))
    assert apart.min() > d * (1 - 1e-4)
    on_plate = np.abs(centres[:, 2] - d / 2) < 1e-7
    below = (apart < d * (1 + 1e-4)) & (centres[None, :, 2] < centres[:, None, 2] - 1e-9)
    touching = (apart < d * (1 + 1e-4)).sum(axis=1)
    assert np.all(on_plate | (below.any(axis=1) & (touching >= 3)))
    assert np.all(np.hypot(centres[:, 0], centres[:, 1]) <= (pile["base_diameter_m"] - d) / 2 + 1e-7)


@pytest.mark.parametrize("name", VIEWS)
def test_the_stored_outline_is_the_edge_of_the_beads(truth: dict[str, Any], name: str) -> None:
    pile = truth["pile"]
    view = pile["views"][name]
    # an independent way: paint the beads as discs, 20 px per mm, and read the highest painted row of each column
    turn = np.radians(view["plate_turned_deg"])
    centres = np.array(pile["bead_centres_m"])
    across = centres[:, 0] * np.cos(turn) - centres[:, 1] * np.sin(turn)
    per_metre, sheet = 20000, np.zeros((800, 2000), dtype=np.uint8)
    for x, z in zip(across, centres[:, 2], strict=True):
        middle = (round(1000 * 16 + x * per_metre * 16), round(z * per_metre * 16))
        cv2.circle(sheet, middle, round(pile["bead_diameter_m"] / 2 * per_metre * 16), 255, cv2.FILLED, shift=4)
    top = (np.arange(800)[:, None] * (sheet > 0)).max(axis=0) / per_metre
    painted = np.interp(view["profile_x_m"], (np.arange(2000) - 1000) / per_metre, top)
    inner = np.abs(view["profile_x_m"]) < 0.042
    gap = np.abs(painted - view["profile_height_m"])[inner]
    assert np.median(gap) < 5e-5
    assert np.quantile(gap, 0.95) < 2e-4  # steep places between two beads


@pytest.mark.parametrize("name", VIEWS)
def test_the_angles_of_the_heap_are_those_of_a_plausible_heap_of_wooden_beads(truth: dict[str, Any], name: str) -> None:
    view = truth["pile"]["views"][name]
    for side in ("left", "right"):
        assert 24 < view["graphical_15_85_deg"][side] < 36
        assert abs(view["graphical_15_85_deg"][side] - view["graphical_20_80_deg"][side]) < 2
    assert 24 < view["geometric_apex_deg"] < 36


def test_the_flank_angle_of_a_cone_is_its_slope() -> None:
    from rigtwin.sample_media.renderer.heap import Outline, apex_angle, flank_angle

    x = np.arange(-0.05, 0.05, 0.00025)
    cone = Outline(x, np.maximum(0.025 - np.abs(x) * np.tan(np.radians(29.0)), 0))
    assert flank_angle(cone, "left", 0.15, 0.85) == pytest.approx(29.0, abs=0.05)
    assert flank_angle(cone, "right", 0.2, 0.8) == pytest.approx(29.0, abs=0.05)
    assert apex_angle(cone, 2 * 0.025 / np.tan(np.radians(29.0))) == pytest.approx(29.0, abs=0.2)


@pytest.mark.slow
def test_rendering_the_drop_again_gives_the_stored_picture(truth: dict[str, Any]) -> None:
    from rigtwin.sample_media.renderer import draw_drop
    from rigtwin.sample_media.renderer.scene import Region

    region = Region(160, 30, 120, 100)
    ground = draw_drop.still(region)
    motion = draw_drop.fly(draw_drop.SETTINGS["r01"])
    again = draw_drop.finish(draw_drop.frame(motion, draw_drop.looks("r01"), ground, "r01", 0), region)
    stored = first_frame(MEDIA / "drop/r01.mp4")[30:130, 160:280]
    assert psnr(stored, again) > 35
    u, v = truth["drop"]["r01"]["position_px"][0]
    assert 160 < u < 280
    assert 30 < v < 130


@pytest.mark.slow
def test_rendering_a_part_of_the_heap_again_gives_the_stored_photo() -> None:
    from rigtwin.sample_media.renderer import draw_pile
    from rigtwin.sample_media.renderer.scene import Region

    region = Region(450, 280, 70, 56)
    again = draw_pile.finish(draw_pile.light("view2", region), region)
    stored = cv2.imread(str(MEDIA / "pile/view2.jpg"))
    assert stored is not None
    inside = np.s_[14:-14, 14:-14]  # the lens blur of a part knows nothing beyond its edge
    assert psnr(stored[280:336, 450:520, ::-1][inside], again[inside]) > 33


@pytest.mark.parametrize(
    ("rig", "name"), [pytest.param(*clip, marks=() if clip[1] == "r01" else pytest.mark.slow) for clip in CLIPS]
)
def test_a_moving_bead_is_seen_where_the_truth_says(truth: dict[str, Any], rig: str, name: str) -> None:
    known = truth[rig][name]
    pixels = known["position_px"] if rig == "drop" else known["position_px"]["A"]
    index = 45  # in free fall, or bead A on its way down
    with av.open(str(MEDIA / known["file"])) as container:
        frames = [frame.to_ndarray(format="rgb24").astype(float) for frame in container.decode(video=0)]
    moved = np.abs(frames[index] - np.median(frames[100::12], axis=0)).max(axis=2) > 18
    u, v = pixels[index]
    rows, columns = np.nonzero(moved)
    near = np.hypot(columns - u, rows - v) < 25
    assert near.sum() > 60
    assert columns[near].mean() == pytest.approx(u, abs=1.5)
    assert rows[near].mean() == pytest.approx(v, abs=1.5)
