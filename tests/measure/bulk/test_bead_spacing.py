"""Distance of neighbouring beads in drawn beds."""

import math

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from rigtwin.measure.bulk.bead_spacing import bead_spacing
from rigtwin.measure.bulk.checks import size_of_beads


def touching(side: float, rng: np.random.Generator) -> np.ndarray:
    """Random places of discs of diameter 1 in a square, pushed apart until they hardly overlap, shape (n, 2)."""
    places = rng.uniform(0, side, (round(0.8 * side * side / (np.pi / 4)), 2))
    for _ in range(150):
        pairs = cKDTree(places).query_pairs(1.0, output_type="ndarray")
        apart = places[pairs[:, 0]] - places[pairs[:, 1]]
        length = np.linalg.norm(apart, axis=1, keepdims=True) + 1e-9
        push = 0.4 * (1 - length) * apart / length
        np.add.at(places, pairs[:, 0], push)
        np.add.at(places, pairs[:, 1], -push)
    return places


def bed(radius: float, *, seed: int = 1, blur: float = 0.7, noise: float = 2.0, light: float = 0.0) -> np.ndarray:
    """Shaded beads in three layers [grey levels]."""
    rng = np.random.default_rng(seed)
    side = round(28 * radius)
    picture = np.full((side, side), 30.0)
    for tone in (0.5, 0.75, 1.0):
        layer = 2 * radius * touching(14, rng)
        # through a loose layer the beads below are visible
        for place in layer[rng.uniform(size=len(layer)) < 0.9]:
            left, top = (max(math.floor(middle - radius), 0) for middle in place)
            part = picture[top : math.ceil(top + 2 * radius + 2), left : math.ceil(left + 2 * radius + 2)]
            y, x = np.mgrid[: part.shape[0], : part.shape[1]]
            away = np.hypot(left + x - place[0], top + y - place[1]) / radius
            inside = away < 1
            part[inside] = tone * (60 + 150 * np.sqrt(1 - away[inside] ** 2)) * rng.uniform(0.9, 1.1)
    picture += light * (np.arange(side) - side / 2) / side + noise * rng.standard_normal(picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), blur), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("radius", "options"),
    [
        (3.0, {}),
        (6.0, {}),
        (12.0, {}),
        (20.0, {}),
        (6.0, {"blur": 1.3}),
        (8.0, {"noise": 20.0}),
        (8.0, {"light": 90.0}),
    ],
)
def test_the_bead_size_follows_from_the_distance_of_neighbours(radius, options):
    picture = bed(radius, **options)
    found = bead_spacing(picture, np.ones(picture.shape, dtype=bool))
    assert found is not None
    assert size_of_beads(found) == pytest.approx(2 * radius, rel=0.13)


def test_only_the_marked_part_of_the_picture_counts():
    picture = np.hstack([bed(6.0), bed(12.0)[:168, :168]])
    marked = np.zeros(picture.shape, dtype=bool)
    marked[:, :168] = True
    assert bead_spacing(picture, marked) == pytest.approx(bead_spacing(picture[:, :168], marked[:, :168]))


def test_a_wall_gives_no_bead_spacing():
    noise = np.random.default_rng(0).normal(120, 8, (200, 200)).astype(np.uint8)
    whole = np.ones(noise.shape, dtype=bool)
    assert bead_spacing(noise, whole) is None
    assert bead_spacing(np.full((200, 200), 120, np.uint8), whole) is None
    assert bead_spacing(noise, np.zeros(noise.shape, dtype=bool)) is None
