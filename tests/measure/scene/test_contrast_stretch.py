"""Dark and low-contrast pictures are stretched to full range."""

import numpy as np
import pytest

from rigtwin.measure.scene.contrast_stretch import FULL_RANGE, exposure_of


def test_a_well_exposed_picture_is_unchanged():
    picture = np.tile(np.arange(256, dtype=np.uint8), (64, 1))
    assert exposure_of(picture).applied(picture) is picture


@pytest.mark.parametrize(("gain", "offset"), [(0.25, 0.0), (0.25, 80.0), (0.5, 100.0)])
def test_a_dark_or_low_contrast_picture_is_stretched_to_the_bright_one(gain, offset):
    bright = np.tile(np.linspace(28, 227, 300), (64, 1))
    dull = np.rint(bright * gain + offset).astype(np.uint8)
    stretched = exposure_of(dull).applied(dull).astype(float)
    # tolerance: the picture was rounded to whole levels before the stretch
    assert np.abs(stretched - bright).max() < 1 + 1.2 / gain
    assert np.ptp(stretched) == pytest.approx(FULL_RANGE, rel=0.05)


def test_the_noise_of_a_black_picture_is_not_stretched_to_full_range():
    picture = np.full((64, 64), 3, np.uint8)
    assert np.ptp(exposure_of(picture).applied(picture)) == 0
