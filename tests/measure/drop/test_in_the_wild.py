"""Drops as others film them: towards the camera, with a shadow beside the bead, with another body in view."""

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from rigtwin.lab.camera import Camera, Seed
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.measure.drop import measurement as drop

RATE = 120.0  # [1/s]
SIZE = 240, 400  # [px], width and height
FOCAL = 500.0  # [px]
DISTANCE = 0.5  # [m], from the camera to the plane of the drop
RADIUS = 0.008  # [m]
RESTITUTION = 0.75
PLATE = -0.15  # [m], height of the bead's centre at a contact, against the camera


def fall(times: np.ndarray) -> tuple[np.ndarray, float]:
    """Height [m] above the contact of a bead dropped from 0.25 m at 0.05 s, and the time of the first contact [s]."""
    release, height, gravity = 0.05, 0.25, 9.81
    contact = first = release + np.sqrt(2 * height / gravity)
    y = np.where(times < release, height, height - gravity / 2 * (times - release) ** 2)
    speed = np.sqrt(2 * gravity * height)
    for _ in range(6):
        speed *= RESTITUTION
        since = times - contact
        y = np.where(since > 0, speed * since - gravity / 2 * since**2, y)
        contact += 2 * speed / gravity
    return y, float(first)


def film(path: Path, *, towards: float = 0.0, shadow: float = 0.0, other: bool = False, frames: int = 110) -> Path:
    """Draw a clip with a pinhole camera.

    `towards` [m/s] is the speed towards the camera from the first contact on; `shadow` [px] the offset of a soft shadow
    to the left; `other` a larger, slower body that falls and bounces beside the bead.
    """
    width, height = SIZE
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    wall = 150 + 12 * cv2.GaussianBlur(rng.normal(0, 6, (height, width)).astype(np.float32), (0, 0), 5)
    times = np.arange(frames) / RATE
    heights, first = fall(times)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "14", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for k, time in enumerate(times):
            z = DISTANCE - towards * max(time - first, 0.0)
            cx, cy = (width - 1) / 2, (height - 1) / 2 - FOCAL * (PLATE + heights[k]) / z
            radius = FOCAL * RADIUS / z
            picture = np.repeat(wall[..., None], 3, axis=2)
            if shadow:
                dark = np.exp(-(((x - cx + shadow) ** 2 + (y - cy - 3) ** 2) / (2 * (0.8 * radius) ** 2)))
                picture *= (1 - 0.35 * dark)[..., None]
            if other:
                off = np.hypot(x - 40, y - 330 + 200 * abs(np.cos(3.0 * time)))
                picture += np.clip(14 - off, 0, 1)[..., None] * (60 - picture)
            cover = np.clip(radius - np.hypot(x - cx, y - cy) + 0.5, 0, 1)[..., None]
            picture = picture * (1 - cover) + cover * np.array([40.0, 60.0, 170.0])
            picture = cv2.GaussianBlur(picture, (0, 0), 0.6) + rng.normal(0, 1.5, picture.shape)
            frame = av.VideoFrame.from_ndarray(np.clip(picture, 0, 255).astype(np.uint8), format="bgr24")
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def restitutions(result, method="velocity"):
    return [q for q in result.quantities if q.quantity == "restitution_wall" and q.method == method]


@pytest.mark.parametrize("towards", [0.1, -0.12])
def test_motion_along_the_line_of_sight_is_corrected(tmp_path, towards):
    clip = film(tmp_path / "clip.mp4", towards=towards)
    result = drop.measure(clip, Camera(frame_rate=RATE), bead_diameter=2 * RADIUS)
    found = restitutions(result)
    assert len(found) >= 2
    for each in found[:-1]:
        assert each.value == pytest.approx(RESTITUTION, abs=0.005)
        assert not each.doubtful
    for each in found:
        assert abs(each.value - RESTITUTION) < 3 * each.std_uncertainty
    moved = next(check for check in result.checks if check.check == "line_of_sight")
    assert np.sign(moved.value) == -np.sign(towards)
    height = next(q for q in result.quantities if q.quantity == "drop_height")
    assert height.value == pytest.approx(0.25, rel=0.015)


@pytest.mark.slow
def test_a_bead_that_stays_in_its_plane_is_not_corrected(tmp_path):
    result = drop.measure(film(tmp_path / "clip.mp4"), Camera(frame_rate=RATE), bead_diameter=2 * RADIUS)
    assert all(check.check != "line_of_sight" for check in result.checks)


def test_a_shadow_beside_the_bead_does_not_move_it(tmp_path):
    clip = film(tmp_path / "clip.mp4", shadow=10.0)
    found = restitutions(drop.measure(clip, Camera(frame_rate=RATE), bead_diameter=2 * RADIUS))
    assert found[0].value == pytest.approx(RESTITUTION, abs=0.005)
    assert found[1].value == pytest.approx(RESTITUTION, abs=0.005)


def test_the_stated_bead_is_followed_among_others(tmp_path):
    clip = film(tmp_path / "clip.mp4", other=True)
    heights, _ = fall(np.array([60 / RATE]))
    at = (119.0 + 1, 199.5 - FOCAL * (PLATE + float(heights[0])) / DISTANCE - 1)
    camera = Camera(frame_rate=RATE, bead_at=Seed(60, at))
    result = drop.measure(clip, camera, bead_diameter=2 * RADIUS)
    assert restitutions(result)[0].value == pytest.approx(RESTITUTION, abs=0.005)
    assert result.camera["stated"] == ["bead_at"]


def test_the_contacts_must_lie_on_a_stated_plate(tmp_path):
    clip = film(tmp_path / "clip.mp4")
    surface = 199.5 - FOCAL * (PLATE - RADIUS) / DISTANCE
    for off, passed in ((0.0, True), (-25.0, False)):
        plate = ((60.0, surface + off), (180.0, surface + off))
        result = drop.measure(clip, Camera(frame_rate=RATE, plate=plate), bead_diameter=2 * RADIUS)
        (check,) = [each for each in result.checks if each.check == "stated_plate"]
        assert check.passed == passed, check.message
        assert all(("stated line" in each.doubtful) != passed for each in result.quantities)


def test_a_stated_place_without_a_bead_is_refused_with_the_place(tmp_path):
    clip = film(tmp_path / "clip.mp4")
    with pytest.raises(NothingToMeasure, match=r"--bead-at 60:200,40"):
        drop.measure(clip, Camera(frame_rate=RATE, bead_at=Seed(60, (200.0, 40.0))))
    with pytest.raises(NothingToMeasure, match="outside the frames"):
        drop.measure(clip, Camera(frame_rate=RATE, bead_at=Seed(600, (119.0, 100.0))))
