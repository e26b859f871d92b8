"""What things on a bench look like close up: wood, brushed steel, laminate, a steel rule."""

from __future__ import annotations

import cv2
import numpy as np

from rigtwin.sample_media.renderer.scene import Colour, Floats

LIGHT_WOOD = np.array([0.70, 0.475, 0.265])
DARK_WOOD = np.array([0.47, 0.275, 0.125])


def grain(points: Floats, seed: int = 0) -> Floats:
    """Smooth random values in 0..1 at points in space, about one bump per unit length, shape (n,)."""
    cell = np.floor(points).astype(np.int64)
    part = points - cell
    part = part * part * (3 - 2 * part)
    total = np.zeros(len(points))
    for corner in range(8):
        step = np.array([corner & 1, corner >> 1 & 1, corner >> 2 & 1])
        weight = np.prod(np.where(step == 1, part, 1 - part), axis=-1)
        total += weight * _lattice(cell + step, seed)
    return total


def _lattice(cell: Floats, seed: int) -> Floats:
    key = (cell[:, 0] * 73856093) ^ (cell[:, 1] * 19349663) ^ (cell[:, 2] * 83492791) ^ (seed * 2654435761)
    key = key & 0xFFFFFFFF
    key = ((key ^ (key >> 16)) * 0x45D9F3B) & 0xFFFFFFFF
    key = ((key ^ (key >> 16)) * 0x45D9F3B) & 0xFFFFFFFF
    return ((key ^ (key >> 16)) & 0xFFFF) / 65535.0


def wood(points: Floats, seed: int, *, tint: float = 0.0) -> Floats:
    """Albedo of turned ash at points in bead radii, shape (n, 3): year rings, fibres along the trunk, pores."""
    rng = np.random.default_rng(seed)
    trunk = rng.normal(size=3)
    trunk /= np.linalg.norm(trunk)
    across = np.cross(trunk, [0.3, 0.9, 0.1])
    across /= np.linalg.norm(across)
    own = points @ np.array([across, np.cross(trunk, across), trunk]).T
    offset = rng.uniform(1.5, 4.0)
    distance = np.hypot(own[:, 0] + offset, own[:, 1])
    ring = (distance * rng.uniform(1.6, 2.6) + 0.5 * grain(own * 1.3 + 7, seed)) % 1.0
    late = np.clip((ring - 0.45) / 0.5, 0, 1) ** 2 * np.clip((1 - ring) / 0.06, 0, 1)
    fibre = grain(own * np.array([14.0, 14.0, 1.8]), seed + 1) - 0.5
    pore = np.clip(grain(own * np.array([22.0, 22.0, 3.0]), seed + 2) - 0.78, 0, 1) * 3
    dark = np.clip(0.25 + 0.50 * late + 0.45 * fibre + 0.5 * pore, 0, 1)[:, None]
    albedo = LIGHT_WOOD * (1 - dark) + DARK_WOOD * dark
    return albedo * (1 + tint * np.array([0.9, 1.0, 1.25]))


def drilled(albedo: Floats, points: Floats, axis: Floats, radius: float) -> Floats:
    """The same bead with its hole along `axis`; `points` and `radius` in bead radii."""
    off = np.linalg.norm(points - (points @ axis)[:, None] * axis, axis=1)
    hole = np.clip((radius - off) / 0.06 + 0.5, 0, 1)[:, None]
    rim = np.exp(-(((off - radius * 1.15) / 0.05) ** 2))[:, None]
    return albedo * (1 - 0.25 * rim) * (1 - hole) + np.array([0.035, 0.02, 0.012]) * hole


def brushed(level: float, along_x: bool = True, seed: int = 3) -> Colour:
    """Ground steel: fine streaks along one direction and faint stains; points in mm."""
    stretch = np.array([0.06, 2.6, 2.6]) if along_x else np.array([2.6, 2.6, 0.06])

    def colour(points: Floats) -> Floats:
        streak = grain(points * stretch, seed) + 0.6 * grain(points * stretch * 2.3, seed + 1)
        stain = grain(points * 0.06, seed + 2)
        tone = level * (0.80 + 0.16 * streak + 0.14 * stain)
        return tone[:, None] * np.array([0.97, 0.99, 1.0])

    return colour


def laminate(level: tuple[float, float, float], seed: int = 11) -> Colour:
    """A bench top: fine speckle, worn patches, a few scratches; points in mm."""

    def colour(points: Floats) -> Floats:
        speckle = grain(points * 1.1, seed) - 0.5
        patch = grain(points * 0.018, seed + 1) + 0.5 * grain(points * 0.05, seed + 2) - 0.75
        lines = points[:, 0] * 0.31 + points[:, 1] * 0.12 + 3 * grain(points * 0.01, seed + 4)
        scratch = np.exp(-(((lines % 9.0 - 4.5) / 0.05) ** 2)) * (grain(points * 0.03, seed + 3) > 0.6)
        tone = 1 + 0.22 * speckle + 0.20 * patch + 0.25 * scratch
        return tone[:, None] * np.array(level)

    return colour


def painted(level: tuple[float, float, float], seed: int = 21) -> Colour:
    """A painted wall with roller texture and old marks; points in mm."""

    def colour(points: Floats) -> Floats:
        tone = 1 + 0.06 * (grain(points * 0.3, seed) - 0.5) + 0.30 * (grain(points * 0.005, seed + 1) - 0.5)
        return tone[:, None] * np.array(level)

    return colour


def label(level: tuple[float, float, float], seed: int) -> Colour:
    """A bottle or a binder: a body colour with a pale label round its middle; points in mm, own z along it."""

    def colour(points: Floats) -> Floats:
        height = points[:, 2]
        low, high = np.min(height), np.max(height)
        share = (height - low) / max(high - low, 1e-6)
        band = (share > 0.25) & (share < 0.6)
        line = (height % 5.0 < 2.2) & (share > 0.3) & (share < 0.5)
        word = grain(points * np.array([0.35, 0.35, 0.02]), seed) > 0.42
        stripe = (share > 0.53) & (share < 0.57)
        paper = np.where((line & word)[:, None], 0.33, 0.66) * np.array([1.0, 0.98, 0.92])
        paper = np.where(stripe[:, None], np.array([0.45, 0.10, 0.08]), paper)
        return np.where(band[:, None], paper, np.array(level))

    return colour


def rule_colour(length: float, width: float, resolution: int = 16) -> Colour:
    """A steel rule; own z runs along the graduations from -length/2 (zero) up, own x across, its left edge ruled."""
    rows, columns = round(length * resolution), round(width * resolution)
    sheet = np.full((rows, columns), 255, dtype=np.uint8)
    for mm in range(int(length) + 1):
        reach = 9.0 if mm % 10 == 0 else 6.5 if mm % 5 == 0 else 4.5
        y = rows - 1 - mm * resolution
        half = resolution * 0.09
        cv2.rectangle(
            sheet, (0, round(y - half)), (round(reach * resolution), round(y + half)), 30, thickness=cv2.FILLED
        )
        if mm % 10 == 0 and 0 < mm < length:
            size, _ = cv2.getTextSize(str(mm // 10), cv2.FONT_HERSHEY_SIMPLEX, resolution / 9, 3)
            at = (round(10.0 * resolution), y + size[1] // 2)
            cv2.putText(sheet, str(mm // 10), at, cv2.FONT_HERSHEY_SIMPLEX, resolution / 9, 30, 3, cv2.LINE_AA)
    sheet = cv2.GaussianBlur(sheet.astype(np.float32) / 255, (0, 0), 2.2)
    steel = brushed(0.46, along_x=False, seed=31)

    def colour(points: Floats) -> Floats:
        column = (points[:, 0] + width / 2) * resolution
        row = (length / 2 - points[:, 2]) * resolution - 0.5
        ink = _lookup(sheet, row, column)
        return steel(points) * ink.reshape(-1, 1)

    return colour


def _lookup(sheet: Floats, row: Floats, column: Floats) -> Floats:
    r = np.clip(row, 0, sheet.shape[0] - 1).round().astype(int)
    c = np.clip(column, 0, sheet.shape[1] - 1).round().astype(int)
    return sheet[r, c]
