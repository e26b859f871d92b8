"""Heaps on a disc and beds in a cylinder, grain by grain, with the truth of what is measured in their photos.

A dense random packing of spheres is cut to the wanted form: a cone for a heap, a cylinder for a bed.  The outlines,
angles and heights of the truth follow from the centres of the spheres alone, by their definitions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import textures
from scipy.spatial import cKDTree
from shapes import Floats
from surroundings import Scene, clutter, coat, colour_of, ruler, table

MOST = 5000  # grains
READ = 0.95  # share of the cylinder's radius in which `measure packing` reads the outline
SURFACE = 0.8  # [grain diameters], as `measure packing` defines the surface of a bed


@dataclass
class Rig:
    """A scene, what its user states (lengths in units of the rig's radius), the truth, and points to project."""

    scene: Scene
    kind: str
    grain: float  # diameter
    truth: dict[str, Any]
    points: dict[str, tuple[float, float, float]] = field(default_factory=dict)


def packed(rng: np.random.Generator, low: Floats, high: Floats, diameter: float) -> Floats:
    """Centres of a dense random packing (volume fraction 0.58) that touches the floor `low[2]`, shape (n, 3).

    Overlaps of random points are pushed apart, as in Jodrey and Tory 1985.
    """
    extent = high - low
    count = int(0.58 * np.prod(extent) / (np.pi / 6 * diameter**3))
    centres = low + rng.random((count, 3)) * extent
    for step in range(120):
        pairs = cKDTree(centres).query_pairs(diameter * (1.0 if step > 20 else 1.1), output_type="ndarray")
        apart = centres[pairs[:, 0]] - centres[pairs[:, 1]]
        distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
        push = apart * ((diameter - distance) * 0.35 / distance)[:, None] * (distance < diameter)[:, None]
        np.add.at(centres, pairs[:, 0], push)
        np.add.at(centres, pairs[:, 1], -push)
        centres = np.clip(centres, low + diameter / 2, high - diameter / 2)
    return centres


def _on_floor(centres: Floats, floor: Floats | float, radius: float) -> Floats:
    """Grains that would be seen to float are moved down until something is below them; from low to high."""
    order = np.argsort(centres[:, 2])
    placed = centres[order]
    for index, centre in enumerate(placed):
        below = placed[:index]
        apart = np.hypot(below[:, 0] - centre[0], below[:, 1] - centre[1])
        near = apart < 1.9 * radius
        rest = below[near, 2] + np.sqrt(4 * radius**2 - apart[near] ** 2)
        level = max(float(np.max(rest, initial=-np.inf)), float(np.broadcast_to(floor, len(placed))[0]) + radius)
        placed[index, 2] = min(centre[2], level) if level < centre[2] else centre[2]
    return placed


def _grains(scene: Scene, centres: Floats, radius: float) -> tuple[Floats, str]:
    """Adds grains to the scene: one to three colours; returns the colours and the finish."""
    rng = scene.rng
    palette = np.array([textures.colour(rng) for _ in range(1 if rng.random() < 0.7 else int(rng.integers(2, 4)))])
    colours = palette[rng.integers(len(palette), size=len(centres))]
    colours = np.clip(colours * (1 + rng.normal(0, 0.05, (len(centres), 1))), 0.01, 0.97)
    finish = str(rng.choice(["matt", "gloss", "metal", "glass"], p=[0.4, 0.4, 0.1, 0.1]))
    scene.spheres(centres, radius, colours, finish)
    return palette, finish


def outline(centres: Floats, radius: float, x: Floats) -> Floats:
    """Highest edge of the spheres at each x, seen from far away; NaN where there is none."""
    height = np.full(len(x), np.nan)
    for centre in centres:
        rise = radius**2 - (x - centre[0]) ** 2
        under = rise > 0
        height[under] = np.fmax(height[under], centre[2] + np.sqrt(rise[under]))
    return height


def flank(x: Floats, height: Floats, side: int) -> float:
    """Angle [deg] of the line through the outline between 20 and 80 % of its height, left (-1) or right (1)."""
    apex = np.nanmax(height)
    here = (side * (x - x[np.nanargmax(height)]) >= 0) & (height >= 0.2 * apex) & (height <= 0.8 * apex)
    return float(np.degrees(np.arctan(abs(np.polyfit(x[here], height[here], 1)[0]))))


def heap(rng: np.random.Generator) -> Rig:
    """Heap on a raised round disc."""
    scene = Scene(rng, width=2 / rng.uniform(0.4, 0.92))
    slope = np.tan(np.radians(rng.uniform(18, 38)))
    reach = rng.uniform(0.93, 1.02) if rng.random() < 0.7 else rng.uniform(0.7, 0.93)
    across = np.exp(rng.uniform(np.log(12), np.log(40)))
    grain = max(2 / across, (slope * reach**3 * 1.05 / MOST) ** (1 / 3))
    radius = grain / 2
    bulk = packed(rng, np.array([-reach, -reach, 0.0]), np.array([reach, reach, slope * reach + 2 * grain]), grain)
    off, bend = rng.normal(0, 0.02, 2), rng.uniform(-0.1, 0.15)
    along = np.hypot(bulk[:, 0] - off[0], bulk[:, 1] - off[1]) / reach
    top = slope * reach * (1 - along + bend * along * (1 - along))
    inside = (bulk[:, 2] + 0.4 * radius < np.maximum(top, 0.0)) | ((bulk[:, 2] < 1.3 * radius) & (along < 0.96))
    inside &= np.hypot(bulk[:, 0], bulk[:, 1]) < min(reach, 1.0)
    centres = _on_floor(bulk[inside], 0.0, radius)
    palette, finish = _grains(scene, centres, radius)
    thick, foot = float(np.exp(rng.uniform(np.log(0.02), np.log(0.25)))), rng.uniform(0.05, 0.7)
    colour = {"type": "rgb", "value": [float(c) for c in palette[0] ** 2.2]}
    disc = coat(rng, colour if rng.random() < 0.2 else colour_of(rng))
    scene.column([0, 0, -thick], 1.0, thick, bsdf=disc)
    floor = -thick - foot
    scene.column([0, 0, floor], rng.uniform(0.2, 0.85) if rng.random() < 0.8 else 1.2, foot - 0.002)
    table(scene, floor)
    if rng.random() < 0.35:
        count = int(rng.integers(1, 20))
        turn, away = rng.uniform(0, 2 * np.pi, count), rng.uniform(1.2, 1.9, count)
        loose = np.column_stack([away * np.cos(turn), away * np.sin(turn), np.full(count, floor + radius)])
        colours = np.tile(palette[0], (count, 1))
        scene.spheres(loose, radius, colours, finish)
    if rng.random() < 0.4:
        length = rng.uniform(0.8, 2.0)
        ruler(scene, [rng.uniform(-1.2, 1.2 - length), -rng.uniform(1.05, 1.3), floor + 0.003], length, False)
    apex = slope * reach
    scene.centre = (rng.normal(0, 0.05) * scene.width, apex / 2 + rng.uniform(-0.13, 0.13) * scene.width)
    clutter(scene, floor, 1.3)
    x = np.arange(-1.2, 1.2, grain / 24)
    height = outline(centres, radius, x)
    flanks = [flank(x, height, side) for side in (-1, 1)]
    truth = {
        "fit20_80_left_deg": flanks[0],
        "fit20_80_right_deg": flanks[1],
        "fit20_80_mean_deg": float(np.mean(flanks)),
        "geometric_2h_over_D_base_deg": float(np.degrees(np.arctan(np.nanmax(height)))),
        "profile_x_m": x.tolist(),
        "profile_h_m": np.where(np.isfinite(height), height, 0.0).tolist(),
    }
    ends = {"base_left_px": (-1.0, 0.0, 0.0), "base_right_px": (1.0, 0.0, 0.0)}
    return Rig(scene, "pile", grain, truth, ends)


def surface_height(centres: Floats, radius: float) -> float:
    """Mean top of the grains at the surface: those without a higher grain whose centre is near."""
    near = cKDTree(centres[:, :2]).query_ball_point(centres[:, :2], 2 * SURFACE * radius)
    free = [index for index, others in enumerate(near) if centres[others, 2].max() <= centres[index, 2]]
    return float(np.mean(centres[free, 2]) + radius)


def outline_height(centres: Floats, radius: float) -> float:
    """Mean height of the outline seen from far away at its own height, over the part of the width that is read."""
    across = np.linspace(-READ, READ, 1001)
    heights = np.full(across.shape, -np.inf)
    for x, _, z in centres[centres[:, 2] > centres[:, 2].max() - 8 * radius]:
        covered = np.abs(across - x) < radius
        heights[covered] = np.maximum(heights[covered], z + np.sqrt(radius**2 - (across[covered] - x) ** 2))
    return float(np.mean(heights))


def bed(rng: np.random.Generator) -> Rig:
    """Bed in a transparent cylinder on a foot, with a gauge, cups or bottles near it."""
    tall = rng.uniform(1.5, 4.0)
    fill = tall * rng.uniform(0.3, 0.9)
    scene = Scene(rng, width=max(2.6, tall * 4 / 3 * rng.uniform(1.05, 1.8)))
    grain = max(2 / np.exp(rng.uniform(np.log(6), np.log(25))), (3.6 * fill / MOST) ** (1 / 3))
    radius = grain / 2
    bulk = packed(rng, np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, fill + grain]), grain)
    axis = np.hypot(bulk[:, 0], bulk[:, 1])
    bulk, axis = bulk[axis < 1], axis[axis < 1]
    outside = axis > 1 - radius  # those that reach through the wall rest against it
    bulk[outside, :2] *= ((1 - radius) / axis[outside])[:, None]
    lean = rng.normal(0, 0.05)
    bulk = bulk[bulk[:, 2] < fill - radius + lean * bulk[:, 0]]
    apart = cKDTree(bulk).query_pairs(0.8 * grain, output_type="ndarray")
    centres = _on_floor(np.delete(bulk, np.unique(apart[:, 1]), axis=0), 0.0, radius)
    _grains(scene, centres, radius)
    outer = 1 + rng.uniform(0.01, 0.08)
    glass: dict[str, Any] = {"type": "thindielectric", "int_ior": float(rng.uniform(1.1, 1.5))}
    if rng.random() < 0.25:
        tint = 1 - rng.uniform(0, 0.3, 3)
        glass["specular_transmittance"] = {"type": "rgb", "value": [float(t) for t in tint]}
    for wall in (outer, 1.0) if rng.random() < 0.5 else (1.0,):
        scene.add("cylinder", p0=[0, 0, 0], p1=[0, 0, tall], radius=wall, bsdf=glass)
    rim = coat(rng, {"type": "rgb", "value": [float(rng.uniform(0.2, 0.9))] * 3}, "gloss")
    edge = tall - rng.uniform(0.015, 0.05)
    scene.add("cylinder", p0=[0, 0, edge], p1=[0, 0, tall], radius=outer, bsdf={"type": "twosided", "inner": rim})
    base = rng.uniform(0.03, 0.35)
    if rng.random() < 0.7:
        scene.column([0, 0, -base], outer * rng.uniform(1.0, 1.5), base - 0.002)
    else:
        wide = outer * rng.uniform(1.0, 1.5)
        scene.box([-wide, -wide, -base], [wide, wide, -0.002])
    table(scene, -base)
    if rng.random() < 0.5:
        beside = rng.choice([-1, 1]) * rng.uniform(1.2, 1.6)
        ruler(scene, [beside, rng.uniform(-0.6, 0.4), 0.0], tall * rng.uniform(0.9, 1.2), True)
    for _ in range(rng.choice([0, 1, 2], p=[0.5, 0.3, 0.2])):  # cups and beakers behind
        cup, wide = [rng.uniform(-0.6, 0.6) * scene.width, rng.uniform(1.8, 4), -base], rng.uniform(0.3, 1.0)
        scene.column([float(c) for c in cup], wide, rng.uniform(0.4, 1.0) * tall, top=False)
    scene.centre = (rng.normal(0, 0.06) * scene.width, tall / 2 + rng.uniform(-0.05, 0.05) * scene.width)
    clutter(scene, -base, 1.5)
    points = {f"wall_{name}_px": (side, 0.0, fill / 2) for name, side in (("left", -1.0), ("right", 1.0))}
    truth = {"bed_height_m": surface_height(centres, radius), "n_beads": len(centres)}
    truth["outline_height_m"] = outline_height(centres, radius)
    return Rig(scene, "packing", grain, truth, {**points, "floor_px_axis": (0.0, 0.0, 0.0)})
