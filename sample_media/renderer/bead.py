"""Moving wooden beads laid over a still picture, with true motion blur, and the shadows they throw."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rigtwin.sample_media.renderer.footage import soften
from rigtwin.sample_media.renderer.scene import Camera, Floats, Lights, Region, along
from rigtwin.sample_media.renderer.surfaces import drilled, wood

FINE = 4  # rays per pixel edge inside a bead's box
MAP_ROWS, MAP_COLUMNS = 192, 384


def map_directions() -> Floats:
    """Directions that a map of a ball's surface is kept for, shape (MAP_ROWS, MAP_COLUMNS, 3)."""
    polar, azimuth = np.meshgrid(
        (np.arange(MAP_ROWS) + 0.5) / MAP_ROWS * np.pi,
        (np.arange(MAP_COLUMNS) + 0.5) / MAP_COLUMNS * 2 * np.pi,
        indexing="ij",
    )
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1).astype(
        np.float32
    )


def look_up(table: Floats, direction: Floats) -> Floats:
    """Values of a map at unit directions, shape (..., 3)."""
    row = np.arccos(np.clip(direction[..., 2], -1, 1)) / np.pi * MAP_ROWS
    column = (np.arctan2(direction[..., 1], direction[..., 0]) / (2 * np.pi) % 1.0) * MAP_COLUMNS
    return table[np.minimum(row.astype(int), MAP_ROWS - 1), np.minimum(column.astype(int), MAP_COLUMNS - 1)]


@dataclass(frozen=True)
class WoodenBead:
    """One bead's looks: its wood, and how the lights of the scene fall on a ball."""

    radius: float  # [mm]
    albedo: Floats  # by direction in the bead's own axes, shape (MAP_ROWS, MAP_COLUMNS, 3)
    lamp: Floats  # light on a surface facing a direction
    highlight: Floats  # mirror-like light for a normal, as the camera sees it
    floor: Floats  # colour of light thrown back from below


def wooden_bead(
    radius: float, lights: Lights, floor: tuple[float, float, float], seed: int, hole: float | None = None
) -> WoodenBead:
    """A bead of ash turned on a lathe; `hole` is the radius of its bore in bead radii, about the own y axis."""
    directions = map_directions().reshape(-1, 3)
    albedo = wood(directions, seed)
    if hole is not None:
        albedo = drilled(albedo, directions, np.array([0.25, 0.95, 0.2]) / np.linalg.norm([0.25, 0.95, 0.2]), hole)
    cosine = np.clip(directions @ lights.direction.T, 0, None)
    lamp = cosine @ lights.radiance
    half = lights.direction - np.array([0.0, 1.0, 0.0], dtype=np.float32)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shine = 26.0
    highlight = (np.clip(directions @ half.T, 0, 1) ** shine * (cosine > 0)) @ lights.radiance * shine / 8 * 0.045
    shape = (MAP_ROWS, MAP_COLUMNS, 3)
    return WoodenBead(
        radius,
        albedo.reshape(shape).astype(np.float32),
        lamp.reshape(shape).astype(np.float32),
        highlight.reshape(shape).astype(np.float32),
        np.array(floor, dtype=np.float32),
    )


@dataclass(frozen=True)
class Patch:
    """A bead seen during one exposure: premultiplied light and coverage over a region of the picture."""

    region: Region
    light: Floats  # shape (h, w, 3)
    cover: Floats  # shape (h, w, 1)

    def over(self, picture: Floats) -> None:
        """Lay the patch over a picture, in place."""
        r = self.region
        part = picture[r.top : r.top + r.height, r.left : r.left + r.width]
        part *= 1 - self.cover
        part += self.light


def expose_bead(
    bead: WoodenBead, camera: Camera, centres: Floats, turn: Floats, gap: Floats | None = None
) -> Patch | None:
    """Average the bead over its places [mm], shape (n, 3), during the exposure; None when it is out of the picture.

    `turn` has the bead's own axes as rows; `gap` [mm], shape (n,), is the air under it, which shades its lower half.
    """
    middle = camera.project(centres)
    reach = bead.radius * camera.focal / (centres[:, 1].min() - camera.position[1]) + 4
    left, top = np.floor(middle.min(axis=0) - reach).astype(int)
    right, bottom = np.ceil(middle.max(axis=0) + reach).astype(int)
    left, top, right, bottom = max(left, 0), max(top, 0), min(right, camera.width - 1), min(bottom, camera.height - 1)
    if right <= left or bottom <= top:
        return None
    region = Region(int(left), int(top), int(right - left + 1), int(bottom - top + 1))
    sub = (np.arange(FINE) + 0.5) / FINE - 0.5
    u = (np.arange(region.width)[:, None] + sub).ravel() + left
    v = (np.arange(region.height)[:, None] + sub).ravel() + top
    rays = camera.rays(*np.meshgrid(u, v)).astype(np.float64)
    light = np.zeros((*rays.shape[:2], 3), dtype=np.float32)
    cover = np.zeros((*rays.shape[:2], 1), dtype=np.float32)
    for number, centre in enumerate(centres):
        offset = centre - np.array(camera.position)
        ahead = rays @ offset
        inside = bead.radius**2 - (offset @ offset - ahead * ahead)
        hit = inside > 0
        normal = (rays[hit] * (ahead[hit] - np.sqrt(inside[hit]))[:, None] - offset) / bead.radius
        light[hit] += _colour(bead, normal, turn, None if gap is None else float(gap[number]))
        cover[hit] += 1
    small = (region.width, region.height)
    light = cv2.resize(light, small, interpolation=cv2.INTER_AREA) / len(centres)
    cover = cv2.resize(cover, small, interpolation=cv2.INTER_AREA) / len(centres)
    return Patch(region, soften(light), soften(cover)[..., None])


def _colour(bead: WoodenBead, normal: Floats, turn: Floats, gap: float | None) -> Floats:
    albedo = look_up(bead.albedo, normal @ turn.T)
    # light from below: the floor fills the lower half, less where the bead itself darkens the floor
    near = 0.0 if gap is None else (bead.radius / (bead.radius + gap)) ** 2
    below = np.clip(0.5 - 0.5 * normal[:, 2:], 0, 1)
    fill = below * bead.floor * (1 - 0.85 * near * below)
    return (albedo * (look_up(bead.lamp, normal) + fill + 0.05) + look_up(bead.highlight, normal)).astype(np.float32)


def spun(axis: tuple[float, float, float], angle: float) -> Floats:
    """Own axes of a bead turned by `angle` [rad] about `axis`."""
    frame = along(axis)
    c, s = np.cos(angle), np.sin(angle)
    return frame.T @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ frame


def shadow(points: Floats, normal: Floats, lights: Lights, free: Floats, *, centre: Floats, radius: float) -> Floats:
    """Share of light left on points of a flat surface when a ball stands at `centre`, shape (n, 3).

    `free` says which lights reach which points without the ball, shape (n_lights, n_points).
    """
    cosine = np.clip(lights.direction @ normal, 0, None)
    offset = (centre - points).astype(np.float32)
    ahead = offset @ lights.direction.T
    apart = np.einsum("ij,ij->i", offset, offset)[:, None] - ahead * ahead
    hidden = (apart < radius**2) & (ahead > 0)
    weight = lights.radiance * cosine[:, None]
    whole = free.T @ weight
    lost = (hidden * free.T) @ weight
    return 1 - lost / np.maximum(whole + 0.10, 1e-6)
