"""Classes of the pixels of photos by the network: on the sample photos, which it did not see in its training."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import rigtwin
from rigtwin.measure.bulk.grain_classes import MODEL, Grain, grain_classes

SAMPLES = Path(rigtwin.__file__).parent / "sample_media"


@pytest.fixture(scope="module")
def bed():
    return cv2.imread(str(SAMPLES / "seven_rigs" / "packing.jpg"))


def test_probabilities_of_all_classes_add_up_to_one_in_every_pixel(bed):
    found = grain_classes(bed)
    assert found.shape == (*bed.shape[:2], len(Grain))
    assert found.min() >= 0
    np.testing.assert_allclose(found.sum(axis=2), 1.0, atol=1e-4)


def test_the_mirrored_photo_has_the_mirrored_classes(bed):
    bed = bed[: bed.shape[0] // 32 * 32, : bed.shape[1] // 32 * 32]
    apart = np.abs(grain_classes(bed[:, ::-1])[:, ::-1] - grain_classes(bed))
    assert np.quantile(apart, 0.98) < 0.1


def test_the_size_of_a_photo_does_not_matter(bed):
    large = cv2.resize(bed, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    small = cv2.resize(grain_classes(large), bed.shape[1::-1], interpolation=cv2.INTER_AREA)
    assert np.mean(np.abs(small - grain_classes(bed)) > 0.2) < 0.01


def test_a_picture_without_grains_has_hardly_any():
    rng = np.random.default_rng(3)
    noise = rng.normal(120, 6, (300, 400, 3)).clip(0, 255).astype(np.uint8)
    assert np.mean(grain_classes(noise)[..., Grain.GRAINS] > 0.5) < 0.01


def test_the_network_is_small_enough_to_ship():
    assert MODEL.stat().st_size < 5_000_000
