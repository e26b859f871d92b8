"""Regions that the user wants ignored show neither edges nor motion."""

import cv2
import numpy as np
import pytest

from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.measure.media.ignored_regions import covered
from rigtwin.measure.media.photo import all_show_different, read_photo
from rigtwin.measure.media.video import open_video

REGION = (30.0, 20.0, 25.0, 18.0)
INSIDE = np.s_[20:38, 30:55]


def ramp(width: int = 120, height: int = 80) -> np.ndarray:
    return np.tile(np.linspace(40, 200, width), (height, 1)).astype(np.uint8)


@pytest.mark.parametrize("factor", [1, 12])
def test_a_lamp_in_an_ignored_region_disappears_into_its_surroundings(factor):
    plain = ramp(120 * factor, 80 * factor)
    lamp = plain.copy()
    cv2.circle(lamp, (42 * factor, 29 * factor), 8 * factor, 255, -1)
    region = tuple(factor * side for side in REGION)
    result = covered(lamp, [region])
    assert np.abs(result.astype(int) - plain).max() < 20
    colour = covered(cv2.cvtColor(lamp, cv2.COLOR_GRAY2BGR), [region])
    assert np.abs(colour.astype(int) - plain[..., None]).max() < 20  # the lamp is 120 brighter


def test_nothing_outside_an_ignored_region_changes():
    noisy = np.random.default_rng(0).integers(0, 255, (80, 120, 3), dtype=np.uint8)
    result = covered(noisy, [REGION, (100.0, 60.0, 200.0, 200.0)])
    kept = np.ones(noisy.shape[:2], bool)
    kept[INSIDE] = kept[60:, 100:] = False
    assert np.array_equal(result[kept], noisy[kept])
    assert not np.array_equal(result[INSIDE], noisy[INSIDE])


@pytest.mark.parametrize(
    ("region", "reason"),
    [((0.0, 0.0, 120.0, 80.0), "covers the whole picture"), ((120.0, 0.0, 9.0, 9.0), "lies outside the picture")],
)
def test_an_ignored_region_that_leaves_nothing_or_does_nothing_is_refused(tmp_path, region, reason):
    photo = tmp_path / "ramp.png"
    cv2.imwrite(str(photo), ramp())
    with pytest.raises(BadInput, match=f"--ignore .* {reason}"):
        read_photo(photo, Camera(ignore=(region,)))


def test_photos_without_any_structure_are_no_copies(tmp_path):
    pictures = {tmp_path / f"{level}.png": np.full((80, 120, 3), level, np.uint8) for level in (40, 200)}
    all_show_different(pictures)


def test_motion_in_an_ignored_region_of_a_film_does_not_show(tmp_path):
    path = tmp_path / "blink.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30, (120, 80), isColor=False)
    for k in range(6):
        frame = ramp()
        cv2.circle(frame, (42, 29), 3 + k, 255, -1)
        cv2.circle(frame, (90, 10 + 9 * k), 5, 0, -1)
        writer.write(frame)
    writer.release()
    video = open_video(path, Camera(ignore=(REGION,)))
    frames = [frame.grey for frame in video.frames()]
    assert all(np.array_equal(frame[INSIDE], frames[0][INSIDE]) for frame in frames)
    assert np.abs(frames[5][INSIDE].astype(int) - ramp()[INSIDE]).max() < 12
    assert not np.array_equal(frames[5], frames[0])  # what moves elsewhere is seen
    (third,) = video.single([3])
    assert np.array_equal(third.grey, frames[3])


def test_an_ignored_region_of_a_photo_is_covered(tmp_path):
    lamp = ramp()
    lamp[25:30, 40:45] = 255
    cv2.imwrite(str(tmp_path / "lamp.png"), lamp)
    photo, _ = read_photo(tmp_path / "lamp.png", Camera(ignore=(REGION,)))
    assert photo[INSIDE].max() < 130
