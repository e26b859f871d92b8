"""Registration of frames to the background."""

import cv2
import numpy as np
import pytest

from rigtwin.measure.scene.background import Background
from rigtwin.measure.scene.scene import Scene

HEIGHT, WIDTH, GROUND = 400, 120, 60.0


def frame(pattern: np.ndarray, shake: float, rng: np.random.Generator) -> np.ndarray:
    """A patterned background [grey levels] seen by a camera shifted up by `shake` [px]."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, shake]])
    moved = cv2.warpAffine(pattern.astype(np.float32), turn, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    return np.clip(np.round(GROUND + moved + rng.normal(0, 0.3, moved.shape)), 0, 255).astype(np.uint8)


def scene_of(pattern: np.ndarray, rng: np.random.Generator) -> Scene:
    background = Background()
    for index in range(Background.capacity):
        background.add(index, frame(pattern, 0.0, rng))
    return background.scene()


def grain(rng: np.random.Generator, scatter: float) -> np.ndarray:
    """Soft spots [grey levels], as a codec makes from noise or paper texture."""
    spots = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 2.0)
    return np.asarray(scatter * spots / spots.std())


def test_noise_frozen_by_a_codec_gives_no_shake():
    """Noise of a uniform wall that a codec freezes and then shifts by half a pixel is no camera shake."""
    rng = np.random.default_rng(1)
    pattern = grain(rng, 1.2)
    scene = scene_of(pattern, rng)
    pose = scene.pose(frame(pattern, 0.5, rng))
    assert not pose.placed
    assert pose.shake == (0.0, 0.0)
    assert scene.next_pose(frame(pattern, 0.5, rng), pose).shake == (0.0, 0.0)


@pytest.mark.parametrize("edge", [25.0, 100.0])
def test_a_plate_in_front_of_frozen_noise_gives_the_shake(edge):
    rng = np.random.default_rng(2)
    pattern = grain(rng, 1.2)
    plate = np.where(np.arange(HEIGHT) < 300, 0.0, edge)  # the smaller step is that of a far too dark recording
    pattern += cv2.GaussianBlur(plate[:, None], (0, 0), 1.0)
    pose = scene_of(pattern, rng).pose(frame(pattern, 2.0, rng))
    assert pose.placed
    assert pose.shake[1] == pytest.approx(2.0, abs=0.1)
