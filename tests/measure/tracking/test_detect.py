"""Moving spots in front of a static background."""

import numpy as np
import pytest

from rigtwin.measure.scene.background import Background
from rigtwin.measure.tracking.detect import moving_spots

HEIGHT, WIDTH, RADIUS, GROUND, CONTRAST = 320, 140, 28.0, 60.0, 120.0


@pytest.mark.parametrize("signal_to_noise", [6, 40])
def test_a_bead_at_the_same_pixels_for_a_third_of_the_clip_is_one_spot(signal_to_noise):
    """The spread of these pixels over time is due to the bead, not to camera noise."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    frames = []
    for k in range(60):
        bead = np.hypot(x - 70, y - 60 - 3.1 * k) < RADIUS
        picture = GROUND + CONTRAST * bead + rng.normal(0, CONTRAST / signal_to_noise, bead.shape)
        frames.append(np.clip(np.round(picture), 0, 255).astype(np.uint8))
    background = Background()
    for index in np.linspace(0, 59, Background.capacity).round().astype(int).tolist():
        background.add(index, frames[index])
    scene = background.scene()
    for index in (10, 30, 50):
        spot = moving_spots(frames[index].astype(np.float32), scene, None)[0]
        assert min(spot.width, spot.height) == pytest.approx(2 * RADIUS, abs=4)
        assert (spot.x, spot.y) == pytest.approx((70, 60 + 3.1 * index), abs=1.0)
