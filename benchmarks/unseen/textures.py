"""Random textures: noise, wood grain, stripes, checks, labels with writing, rulers with marks; sRGB 0..1."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def colour(rng: np.random.Generator) -> Floats:
    """A random colour: often grey, wood-like, near black or near white, else any hue."""
    kind = rng.random()
    if kind < 0.2:
        return np.full(3, rng.uniform(0.05, 0.95)) + rng.normal(0, 0.02, 3).clip(-0.04, 0.04)
    if kind < 0.35:
        return np.full(3, rng.uniform(0.02, 0.14))
    if kind < 0.5:
        return rng.uniform(0.75, 0.97) * np.array([1, rng.uniform(0.93, 1), rng.uniform(0.85, 1)])
    if kind < 0.7:
        return rng.uniform(0.3, 0.9) * np.array([1, rng.uniform(0.65, 0.85), rng.uniform(0.35, 0.7)])
    return rng.uniform(0.02, 0.95, 3)


def _noise(rng: np.random.Generator, shape: tuple[int, int], cells: tuple[float, float]) -> Floats:
    total = np.zeros(shape)
    for octave in range(4):
        coarse = rng.normal(size=tuple(max(2, int(c * 2**octave)) for c in cells))
        total += cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC) / 2**octave
    return np.clip(0.5 + 0.3 * total, 0, 1)


def _written(picture: Floats, text: str, where: tuple[int, int], scale: float, tint: Floats, width: int) -> Floats:
    ink = np.zeros(picture.shape[:2], np.uint8)
    cv2.putText(ink, text, where, cv2.FONT_HERSHEY_PLAIN, scale, 255, width, cv2.LINE_AA)
    return picture + (tint - picture) * (ink[..., None] / 255)


def texture(rng: np.random.Generator, size: int = 192) -> Floats:
    """A random texture, shape (size, size, 3)."""
    first, second = colour(rng), colour(rng)
    if rng.random() < 0.5:
        second = np.clip(first + rng.normal(0, 0.12, 3), 0.01, 0.98)
    rows, columns = np.mgrid[:size, :size] / size
    kind = rng.integers(6)
    if kind == 0:
        blend = _noise(rng, (size, size), (rng.uniform(2, 30),) * 2)
    elif kind == 1:
        blend = _noise(rng, (size, size), (rng.uniform(2, 4), rng.uniform(20, 60)))
        blend = blend if rng.random() < 0.5 else blend.T
    elif kind == 2:
        turn = rng.uniform(0, np.pi)
        blend = (np.sin(2 * np.pi * rng.uniform(2, 30) * (rows * np.sin(turn) + columns * np.cos(turn))) > 0) * 1.0
    elif kind == 3:
        count = rng.uniform(3, 24)
        blend = (np.floor(rows * count) + np.floor(columns * count)) % 2
    elif kind == 4:
        spots = rng.random((size, size)) < rng.uniform(0.002, 0.05)
        blend = np.clip(4 * cv2.GaussianBlur(spots * 1.0, (0, 0), rng.uniform(0.8, 3)), 0, 1)
    else:
        blend = rows**2 * 0.5 + 0.1 * _noise(rng, (size, size), (4, 4))
    picture = first + (second - first) * blend[..., None]
    picture = np.ascontiguousarray(picture)
    if rng.random() < 0.35:
        for _ in range(rng.integers(1, 8)):
            corner, extent = rng.integers(0, size, 2), rng.integers(5, size // 2, 2)
            (x, y), (w, h) = corner, extent
            picture[y : y + h, x : x + w] = colour(rng)
    if rng.random() < 0.25:
        for _ in range(rng.integers(1, 6)):
            text = "".join(rng.choice(list("ABCDEHKLNORSTabcdefghiklmnorst0123456789 "), 8))
            where = (int(rng.integers(0, size // 2)), int(rng.integers(10, size)))
            picture = _written(picture, text, where, rng.uniform(0.6, 2.5), colour(rng), 2)
    return np.clip(picture, 0.01, 0.98)


def ruler(rng: np.random.Generator, aspect: float) -> Floats:
    """Scale with marks along its columns, shape (64, 64 * aspect, 3) at most 1024 wide."""
    width = int(np.clip(64 * aspect, 128, 1024))
    back = rng.choice(
        np.array([[0.95, 0.95, 0.93], [0.9, 0.8, 0.2], [0.7, 0.7, 0.72], [0.8, 0.65, 0.4], [0.1, 0.1, 0.1]])
    )
    back = back * rng.uniform(0.7, 1)
    ink = np.array([0.05, 0.05, 0.07]) if back.mean() > 0.4 else np.array([0.9, 0.9, 0.85])
    picture = np.tile(back, (64, width, 1))
    marks = int(rng.integers(20, 160))
    for mark in range(marks + 1):
        x = int(mark / marks * (width - 1))
        length = 40 if mark % 10 == 0 else 28 if mark % 5 == 0 else 16
        picture[:length, x : x + max(1, width // marks // 4)] = ink
        if mark % 10 == 0:
            picture = _written(picture, str(mark // 10), (x + 2, 60), 0.9, ink, 1)
    return picture if rng.random() < 0.5 else picture[::-1]


def surroundings(rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Light from all around, shape (32, 64, 3), linear: a soft sky with some bright areas such as windows and lamps."""
    light = np.ones((32, 64, 3)) * rng.uniform(0.15, 0.9) * (1 + rng.normal(0, 0.06, 3))
    light *= np.linspace(rng.uniform(0.8, 1.6), rng.uniform(0.3, 1), 32)[:, None, None]
    for _ in range(rng.integers(0, 5)):
        row, column = rng.integers(0, 16), rng.integers(0, 64)
        light[row : row + rng.integers(2, 8), column : column + rng.integers(2, 14)] += rng.uniform(1, 12)
    for _ in range(rng.integers(0, 6)):
        row, column = rng.integers(8, 26), rng.integers(0, 64)
        light[row : row + rng.integers(2, 8), column : column + rng.integers(2, 10)] *= colour(rng)
    return np.asarray(light, dtype=np.float32)
