"""Cross-correlation of textures moved by a known displacement field."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from rigtwin.measure.bulk.piv import MeanCorrelation, without_outliers

Grey = npt.NDArray[np.uint8]


def texture(seed: int, size: int = 200) -> npt.NDArray[np.float32]:
    random = np.random.default_rng(seed)
    grain = cv2.GaussianBlur(random.normal(0, 1, (size, size)).astype(np.float32), (0, 0), 2.0)
    return np.asarray(128 + 40 * grain / grain.std(), dtype=np.float32)


def moved(picture: npt.NDArray[np.float32], turn: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    size = (picture.shape[1], picture.shape[0])
    return np.asarray(cv2.warpAffine(picture, turn, size, flags=cv2.INTER_CUBIC), dtype=np.float32)


def shown(picture: npt.NDArray[np.float32], seed: int) -> Grey:
    noise = np.random.default_rng(seed).normal(0, 3, picture.shape)
    return np.clip(np.rint(picture + noise), 0, 255).astype(np.uint8)


def test_a_shift_is_found_with_sub_pixel_precision() -> None:
    wanted = (2.3, 5.7)
    places = np.array([[60.0, 60.0], [100.0, 90.0], [140.0, 120.0]])
    mean = MeanCorrelation(places, window=24, reach=(6, 10))
    for seed in range(6):
        one = texture(seed)
        other = moved(one, np.array([[1, 0, wanted[0]], [0, 1, wanted[1]]]))
        mean.add(shown(one, seed + 50), shown(other, seed + 90))
    found = mean.displacements()
    assert found.shift == pytest.approx(np.tile(wanted, (3, 1)), abs=0.1)
    assert np.all(found.score > 0.8)


def test_the_displacement_of_a_rotating_texture_grows_with_the_radius() -> None:
    angle = 0.04  # [rad], clockwise in the picture
    centre = 100.0
    x, y = np.meshgrid(np.arange(40.0, 161, 24), np.arange(40.0, 161, 24))
    places = np.column_stack([x.ravel(), y.ravel()])
    mean = MeanCorrelation(places, window=22, reach=(8, 8))
    turn = cv2.getRotationMatrix2D((centre, centre), -math.degrees(angle), 1.0)
    for seed in range(6):
        one = texture(seed)
        mean.add(shown(one, seed + 10), shown(moved(one, np.asarray(turn, dtype=np.float64)), seed + 30))
    away = places - centre
    wanted = away @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]) - away
    found = without_outliers(mean.displacements())
    assert np.nanmax(np.abs(found.shift - wanted)) < 0.25
    assert np.isfinite(found.shift).all(axis=1).mean() > 0.9


def test_a_window_without_texture_gives_nan() -> None:
    flat = np.full((100, 100), 90, np.uint8)
    mean = MeanCorrelation(np.array([[50.0, 50.0]]), window=20, reach=(5, 5))
    mean.add(flat, flat)
    assert np.isnan(mean.displacements().shift).all()
