"""Training pictures for `train.py`: heaps and beds of grains by Blender's path tracer, with the class of every pixel.

    python training/grain_classes/render.py FOLDER --first 0 --count 600

Writes `00000.jpg` and `00000.png` (class of every pixel, see `CLASSES`).  The picture follows from its number alone,
so that an interrupted run goes on and two processes may share the work.  Everything is random: shapes, colours, finish
and number of the grains, base, vessel, table, things around, lights, lens and exposure.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import cv2
import numpy as np
import numpy.typing as npt
from mathutils import Euler, Vector
from scipy.spatial import cKDTree

Floats = npt.NDArray[np.float64]

CLASSES = ("other", "grains", "base", "vessel")  # base: what the grains stand on; vessel: glass without grains behind
OTHER, GRAINS, BASE, VESSEL = range(4)
WIDTH, HEIGHT = 400, 300
SAMPLES = 5  # light paths per pixel, before denoising
BOX = np.array([34.0, 34.0, 26.0])  # [grain diameters], extent of the packing that heaps and beds are cut from
MOST = 2500  # grains in a scene; of more, some are left out at random


def packing(seed: int = 1) -> Floats:
    """Centres of a dense random packing of spheres of diameter 1 in `BOX`, shape (n, 3)."""
    rng = np.random.default_rng(seed)
    centres = rng.random((int(0.6 * np.prod(BOX) / (np.pi / 6)), 3)) * BOX
    for _ in range(60):
        pairs = cKDTree(centres).query_pairs(1.0, output_type="ndarray")
        apart = centres[pairs[:, 0]] - centres[pairs[:, 1]]
        distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
        push = apart * (0.4 * (1 - distance) / distance)[:, None]
        np.add.at(centres, pairs[:, 0], push)
        np.add.at(centres, pairs[:, 1], -push)
        centres = np.clip(centres, 0.0, BOX)
    return centres


@dataclass
class Scene:
    """Objects of a scene by class."""

    rng: np.random.Generator
    kinds: dict[str, int] = field(default_factory=dict)  # class by name of a mesh

    def add(self, mesh: Any, kind: int, material: Any, **place: Any) -> Any:
        mesh.materials.clear()
        mesh.materials.append(material)
        self.kinds[mesh.name] = kind
        return self.place(mesh, **place)

    def place(self, mesh: Any, at: Any = (0, 0, 0), turn: Any = (0, 0, 0), size: Any = (1, 1, 1)) -> Any:
        thing = bpy.data.objects.new(mesh.name, mesh)
        thing.location, thing.rotation_euler, thing.scale = at, turn, size
        bpy.context.scene.collection.objects.link(thing)
        return thing


def mesh_of(shape: str, **how: Any) -> Any:
    """A mesh of Blender's primitives: extent 2 in every direction unless stated."""
    import bmesh

    made = bmesh.new()
    if shape == "cube":
        bmesh.ops.create_cube(made, size=2)
    elif shape == "sphere":
        bmesh.ops.create_icosphere(made, subdivisions=how.get("fine", 4), radius=1)
    elif shape == "cylinder":
        ends = how.get("ends", True)
        bmesh.ops.create_cone(
            made, cap_ends=ends, cap_tris=False, segments=96, radius1=how.get("foot", 1.0), radius2=1, depth=2
        )
    elif shape == "monkey":
        bmesh.ops.create_monkey(made)
    mesh = bpy.data.meshes.new(shape)
    made.to_mesh(mesh)
    made.free()
    smooth = shape in ("sphere", "monkey") or not how.get("ends", True)
    mesh.polygons.foreach_set("use_smooth", [smooth] * len(mesh.polygons))
    return mesh


def colour(rng: np.random.Generator) -> Floats:
    """Linear RGB: greys, woods, near black, near white, or any hue."""
    import colorsys

    kind = rng.random()
    if kind < 0.25:
        return np.full(3, rng.uniform(0.01, 0.9)) * rng.uniform(0.95, 1.05, 3)
    if kind < 0.4:
        return np.full(3, rng.uniform(0.003, 0.03))
    if kind < 0.55:
        return rng.uniform(0.6, 0.95) * np.array([1, rng.uniform(0.85, 1), rng.uniform(0.7, 1)])
    if kind < 0.75:
        return rng.uniform(0.2, 0.7) * np.array([1, rng.uniform(0.5, 0.75), rng.uniform(0.15, 0.45)])
    return np.array(colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.2, 1), rng.uniform(0.05, 0.95)))


def material(rng: np.random.Generator, *, plain: float = 0.4, like: Floats | None = None, finish: str = "") -> Any:
    """A random material; `plain` is the probability that it has no texture, `like` a colour that it keeps."""
    made = bpy.data.materials.new("material")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    surface = nodes["Principled BSDF"]
    first = colour(rng) if like is None else like
    surface.inputs["Base Color"].default_value = (*first, 1)
    finish = finish or str(rng.choice(["matt", "gloss", "metal", "glass"], p=[0.45, 0.37, 0.15, 0.03]))
    surface.inputs["Roughness"].default_value = {"matt": rng.uniform(0.5, 1)}.get(finish, rng.uniform(0.02, 0.45))
    surface.inputs["Metallic"].default_value = 1.0 if finish == "metal" else 0.0
    surface.inputs["Transmission Weight"].default_value = 1.0 if finish == "glass" else 0.0
    if rng.random() > plain:
        other = np.clip(first * rng.uniform(0.3, 1.8), 0, 1) if rng.random() < 0.6 else colour(rng)
        space = nodes.new("ShaderNodeTexCoord")
        stretch = nodes.new("ShaderNodeMapping")
        size = np.exp(rng.uniform(np.log(0.5), np.log(14)))
        stretch.inputs["Scale"].default_value = size * np.exp(rng.normal(0, 0.7, 3))
        stretch.inputs["Rotation"].default_value = rng.uniform(0, 6, 3)
        name = str(rng.choice(["Noise", "Voronoi", "Wave", "Checker", "Brick", "Magic"]))
        pattern = nodes.new(f"ShaderNodeTex{name}")
        ramp = nodes.new("ShaderNodeValToRGB")
        low = rng.uniform(0.1, 0.6)
        ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = low, low + rng.uniform(0.02, 0.4)
        ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (*first, 1), (*other, 1)
        links.new(space.outputs["Generated" if rng.random() < 0.3 else "Object"], stretch.inputs["Vector"])
        links.new(stretch.outputs["Vector"], pattern.inputs["Vector"])
        value = "Fac" if "Fac" in pattern.outputs else "Distance" if "Distance" in pattern.outputs else "Color"
        links.new(pattern.outputs[value], ramp.inputs["Fac"])
        links.new(ramp.outputs["Color"], surface.inputs["Base Color"])
    return made


def glass(rng: np.random.Generator) -> Any:
    """Thin wall that mirrors a little and lets through the rest."""
    made = bpy.data.materials.new("glass")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    through, mirror, mix = (nodes.new(f"ShaderNode{name}") for name in ("BsdfTransparent", "BsdfGlossy", "MixShader"))
    through.inputs["Color"].default_value = (*(1 - rng.uniform(0, 0.2) * rng.random(3)), 1)
    mirror.inputs["Roughness"].default_value = rng.uniform(0, 0.1)
    edge = nodes.new("ShaderNodeLayerWeight")
    edge.inputs["Blend"].default_value = rng.uniform(0.05, 0.35)
    links.new(edge.outputs["Fresnel"], mix.inputs["Fac"])
    links.new(through.outputs["BSDF"], mix.inputs[1])
    links.new(mirror.outputs["BSDF"], mix.inputs[2])
    links.new(mix.outputs["Shader"], nodes["Material Output"].inputs["Surface"])
    return made


def grains(scene: Scene, centres: Floats, diameter: float) -> Floats:
    """Adds grains of one random shape; returns their first colour."""
    rng = scene.rng
    if len(centres) > MOST:
        centres = centres[rng.choice(len(centres), MOST, replace=False)]
    shape = str(rng.choice(["sphere", "cube", "cylinder", "pebble"], p=[0.62, 0.12, 0.12, 0.14]))
    palette = [colour(rng) for _ in range(1 if rng.random() < 0.7 else rng.integers(2, 5))]
    finish = str(rng.choice(["matt", "gloss", "metal", "glass"], p=[0.45, 0.37, 0.12, 0.06]))
    meshes = []
    for tint in palette:
        shades = 1 if rng.random() < 0.5 else 3
        for _ in range(shades):
            mesh = mesh_of("cube" if shape == "cube" else "cylinder" if shape == "cylinder" else "sphere", fine=3)
            if shape == "pebble":
                points = np.array([v.co[:] for v in mesh.vertices])
                for _ in range(4):
                    way = rng.normal(size=3)
                    points *= 1 + rng.uniform(0.03, 0.12) * np.sin(points @ way * 2 + rng.uniform(0, 6))[:, None]
                mesh.vertices.foreach_set("co", points.ravel())
            look = material(rng, plain=0.8, like=np.clip(tint * rng.uniform(0.85, 1.15), 0, 1), finish=finish)
            mesh.materials.append(look)
            scene.kinds[mesh.name] = GRAINS
            meshes.append(mesh)
    radius, spread = diameter / 2, rng.uniform(0, 0.12) if rng.random() < 0.5 else 0.0
    stretch = {"cube": 0.72, "cylinder": 0.75, "pebble": 0.95}.get(shape, 1.0)
    aspect = np.exp(rng.normal(0, 0.2, 3)) if shape != "sphere" else np.ones(3)
    if shape == "cylinder":
        aspect[1] = aspect[0]
    for centre in centres:
        turn = rng.uniform(0, 2 * np.pi, 3) if shape != "sphere" else (0, 0, 0)
        size = radius * stretch * aspect * (1 + spread * rng.normal())
        scene.place(meshes[rng.integers(len(meshes))], centre, turn, size)
    return palette[0]


def _cut(rng: np.random.Generator, packed: Floats) -> Floats:
    """The packing mirrored and turned at random, its middle above the origin; [grain diameters]."""
    centres = (packed - BOX * (0.5, 0.5, 0.0)) * rng.choice([-1, 1], 3)
    centres[:, 2] -= centres[:, 2].min()
    return centres[:, [*rng.permutation(2), 2]]


def heap(scene: Scene, packed: Floats) -> tuple[float, float]:
    """A heap on a disc of radius 1, or without one; returns the width of the view and the height of its middle."""
    rng = scene.rng
    kind = rng.choice(["disc", "bare", "wall"], p=[0.82, 0.1, 0.08])
    across = math.exp(rng.uniform(math.log(9), math.log(32)))
    reach = rng.uniform(0.9, 1.03) if rng.random() < 0.7 else rng.uniform(0.6, 0.9)
    slope, bend = math.tan(math.radians(rng.uniform(12, 42))), rng.uniform(-0.15, 0.2)
    centres = _cut(rng, packed) * (2 / across)
    off = rng.normal(0, 0.03, 2)
    along = np.hypot(*(centres[:, :2] - off).T) / reach
    if kind == "wall":
        along = np.hypot((centres[:, 0] + 1) / 1.9, 0.7 * centres[:, 1]) / reach
    level = slope * reach * (1 - along + bend * along * (1 - along))
    level += rng.uniform(0, 0.4) / across * np.sin(centres[:, 0] * rng.uniform(3, 12)) * np.cos(centres[:, 1] * 7)
    inside = (centres[:, 2] < level) | ((centres[:, 2] < 0.7 * 2 / across) & (along < 1) & (rng.random() < 0.7))
    inside &= along < 1.02
    if kind == "disc":
        inside &= np.hypot(*centres[:, :2].T) < 1.0
    inside &= centres[:, 2] > level - 6 / across  # what is deeper is not seen
    inside &= rng.random(len(centres)) > (rng.uniform(0, 0.4) if rng.random() < 0.2 else 0)
    tint = grains(scene, centres[inside] + np.array([0, 0, 1 / across]), 2 / across)
    thick, foot = math.exp(rng.uniform(math.log(0.01), math.log(0.35))), max(rng.uniform(-0.2, 0.8), 0.0)
    if kind == "disc":
        like = tint if rng.random() < 0.25 else None
        disc = mesh_of("cylinder", foot=1.0 if rng.random() < 0.85 else rng.uniform(0.85, 1.0))
        scene.add(disc, BASE, material(rng, plain=0.6, like=like), at=(0, 0, -thick / 2), size=(1, 1, thick / 2))
        if foot > 0.03:
            wide = rng.uniform(0.15, 0.9) if rng.random() < 0.85 else rng.uniform(1.05, 1.6)
            place = {"at": (0, 0, -thick - foot / 2), "size": (wide, wide, foot / 2)}
            scene.add(mesh_of(str(rng.choice(["cylinder", "cube"], p=[0.8, 0.2]))), OTHER, material(rng), **place)
    elif kind == "wall":
        thick = foot = 0.0
        place = {"at": (-1 - 0.1, 0, 0.6), "size": (0.1, rng.uniform(0.5, 3), rng.uniform(0.5, 1.5))}
        scene.add(mesh_of("cube"), OTHER, material(rng), **place)
    else:
        thick = foot = 0.0
    floor = -thick - foot
    if rng.random() < 0.3:
        count = int(rng.integers(1, 25))
        turn, away = rng.uniform(0, 6.3, count), rng.uniform(1.15, 2.4, count)
        loose = np.column_stack([away * np.cos(turn), away * np.sin(turn), np.full(count, floor + 1 / across)])
        mesh = mesh_of("sphere", fine=3)
        mesh.materials.append(material(rng, like=tint))
        scene.kinds[mesh.name] = OTHER
        for place in loose:
            scene.place(mesh, place, size=np.full(3, 1 / across))
    room(scene, floor, 1.25)
    high = slope * reach
    return 2 / rng.uniform(0.35, 0.93), high * rng.uniform(0.0, 0.8) - rng.uniform(0, 0.3)


def bed(scene: Scene, packed: Floats) -> tuple[float, float]:
    """A bed in a glass cylinder of radius 1."""
    rng = scene.rng
    across = math.exp(rng.uniform(math.log(5), math.log(16)))
    diameter = 2 / across
    centres = _cut(rng, packed) * diameter
    tall = rng.uniform(1.2, 4.0)
    fill = min(tall * rng.uniform(0.25, 0.95), centres[:, 2].max())
    centres[:, :2] += rng.uniform(-1, 1, 2) * max(BOX[0] / 2 * diameter - 1.1, 0)
    inside = (np.hypot(*centres[:, :2].T) < 1 - diameter / 2) & (centres[:, 1] < diameter)
    inside &= centres[:, 2] < fill + rng.normal(0, 0.08) * centres[:, 0]
    # a layer along the wall, as every wall makes one
    turn = rng.uniform(0, 2 * np.pi, 6000)
    wall = np.column_stack([np.cos(turn), np.sin(turn)]) * (1 - diameter / 2)
    layer = np.column_stack([wall, rng.uniform(0, fill, len(turn))])
    kept: list[int] = []
    tree = cKDTree(layer)
    free = np.ones(len(layer), bool)
    for index in range(len(layer)):
        if free[index]:
            kept.append(index)
            free[tree.query_ball_point(layer[index], 0.93 * diameter)] = False
    layer = layer[kept]
    layer = layer[layer[:, 1] < 0.4]
    core = centres[inside]
    core = core[cKDTree(layer).query(core)[0] > 0.8 * diameter] if len(layer) else core
    grains(scene, np.concatenate([layer, core]) + np.array([0, 0, diameter / 2]), diameter)
    pane = glass(rng)
    outer = 1 + rng.uniform(0.01, 0.1)
    if rng.random() < 0.4:  # a rim that is not clear
        low = rng.uniform(0.005, 0.05)
        ring = mesh_of("cylinder", ends=False)
        scene.add(ring, VESSEL, material(rng, plain=1.0), at=(0, 0, tall - low), size=(outer, outer, low))
    for wide in (outer, 1.0) if rng.random() < 0.6 else (1.0,):
        tube = mesh_of("cylinder", ends=False)
        scene.add(tube, VESSEL, pane, at=(0, 0, tall / 2), size=(wide, wide, tall / 2))
    base = rng.uniform(0.02, 0.4) if rng.random() < 0.85 else 0.0
    if base:
        wide = outer * rng.uniform(1.0, 1.5)
        place = {"at": (0, 0, -base / 2 - 0.002), "size": (wide, wide, base / 2)}
        scene.add(mesh_of(str(rng.choice(["cylinder", "cube"], p=[0.75, 0.25]))), BASE, material(rng), **place)
    if rng.random() < 0.5:
        ruler(scene, (rng.choice([-1, 1]) * rng.uniform(1.15, 1.6), rng.uniform(-0.8, 0.4), 0), tall, True)
    for _ in range(rng.integers(0, 3)):
        cup = (rng.uniform(-2.5, 2.5), rng.uniform(1.8, 4), tall * 0.3)
        size = (*np.full(2, rng.uniform(0.4, 1.1)), tall * rng.uniform(0.2, 0.5))
        look = pane if rng.random() < 0.4 else material(rng)
        scene.add(mesh_of("cylinder", ends=False), OTHER, look, at=cup, size=size)
    room(scene, -base, 1.5)
    width = max(2.6, tall * 4 / 3 * rng.uniform(0.9, 1.7))
    return width, tall / 2 + rng.normal(0, 0.08) * width


def ruler(scene: Scene, foot: tuple[float, float, float], length: float, upright: bool) -> None:
    rng = scene.rng
    scale = mesh_of("cube")
    look = material(rng, plain=1.0)
    nodes, links = look.node_tree.nodes, look.node_tree.links
    marks, space = nodes.new("ShaderNodeTexWave"), nodes.new("ShaderNodeTexCoord")
    marks.bands_direction = "Z" if upright else "X"
    marks.inputs["Scale"].default_value = rng.uniform(4, 20)
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.1, 0.2
    ramp.color_ramp.elements[1].color = (*colour(rng), 1)
    links.new(space.outputs["Object"], marks.inputs["Vector"])
    links.new(marks.outputs["Color"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    size = (0.1, 0.01, length / 2) if upright else (length / 2, 0.12, 0.01)
    at = foot[0], foot[1], foot[2] + (length / 2 if upright else 0.02)
    scene.add(scale, OTHER, look, at=at, size=size)


def room(scene: Scene, floor: float, free: float) -> None:
    """Table, wall behind and things on the table; nothing nearer to the axis than `free`."""
    rng = scene.rng
    if rng.random() < 0.92:
        depth = rng.uniform(1.5, 12)
        place = {"at": (0, depth - 8, floor - 0.06), "size": (rng.uniform(3, 20), 8, 0.05)}
        scene.add(mesh_of("cube"), OTHER, material(rng), **place)
    if rng.random() < 0.6:
        place = {"at": (0, rng.uniform(2.0, 14), 0), "turn": (0, 0, rng.normal(0, 0.2)), "size": (30, 0.05, 30)}
        scene.add(mesh_of("cube"), OTHER, material(rng), **place)
    for _ in range(rng.integers(0, 9)):
        shape = str(rng.choice(["cube", "sphere", "cylinder", "monkey"], p=[0.35, 0.2, 0.4, 0.05]))
        size = np.exp(rng.normal(-0.8, 0.5, 3))
        size[2] *= rng.uniform(0.7, 2.5)
        turn, near = rng.uniform(0, 2 * np.pi), free + 1.2 * float(np.max(size[:2]))
        away = near + rng.exponential(2.0)
        x, y = away * math.cos(turn), away * abs(math.sin(turn)) * (1 if rng.random() < 0.8 else -0.3)
        if math.hypot(x, y) < near:
            continue
        at, how = (x, y, floor + size[2]), {"turn": (0, 0, rng.uniform(0, 6)), "size": size}
        scene.add(mesh_of(shape), OTHER, material(rng), at=at, **how)
    for _ in range(rng.integers(0, 3) if rng.random() < 0.3 else 0):  # rows of like things, which look like grains
        count, size = int(rng.integers(3, 14)), rng.uniform(0.05, 0.3)
        mesh = mesh_of(str(rng.choice(["sphere", "cube", "cylinder"])))
        mesh.materials.append(material(rng))
        scene.kinds[mesh.name] = OTHER
        start = np.array([rng.uniform(-4, 2), rng.uniform(2, 6), floor + size * rng.uniform(1, 6)])
        for index in range(count):
            scene.place(mesh, (start[0] + 2.2 * size * index, *start[1:]), size=np.full(3, size))


def lights(rng: np.random.Generator) -> None:
    world = bpy.data.worlds.new("world")
    bpy.context.scene.world = world
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    sky = nodes["Background"]
    sky.inputs["Strength"].default_value = rng.uniform(0.2, 1.2)
    if rng.random() < 0.75:
        pattern = nodes.new(str(rng.choice(["ShaderNodeTexNoise", "ShaderNodeTexVoronoi"])))
        pattern.inputs["Scale"].default_value = np.exp(rng.uniform(0, 3))
        ramp = nodes.new("ShaderNodeValToRGB")
        low = rng.uniform(0.2, 0.6)
        ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = low, low + rng.uniform(0.02, 0.4)
        ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (*colour(rng), 1), (*colour(rng), 1)
        links.new(pattern.outputs[0], ramp.inputs["Fac"])
        links.new(ramp.outputs["Color"], sky.inputs["Color"])
    else:
        sky.inputs["Color"].default_value = (*np.full(3, rng.uniform(0.1, 1)), 1)
    for _ in range(rng.integers(0, 4)):
        lamp = bpy.data.lights.new("lamp", str(rng.choice(["AREA", "POINT", "SUN"], p=[0.6, 0.25, 0.15])))
        turn, up, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.4), rng.uniform(3, 9)
        place = away * np.array([math.cos(turn) * math.cos(up), math.sin(turn) * math.cos(up), math.sin(up)])
        if lamp.type == "SUN":
            lamp.energy = rng.uniform(0.5, 4)
        else:
            lamp.energy = away**2 * rng.uniform(8, 60)
        if lamp.type == "AREA":
            lamp.size = rng.uniform(0.1, 4)
        lamp.color = 1 - rng.uniform(0, 0.4) * rng.random(3)
        shining = bpy.data.objects.new("lamp", lamp)
        shining.location = place
        shining.rotation_euler = Vector(place).to_track_quat("Z", "Y").to_euler()
        bpy.context.scene.collection.objects.link(shining)


def camera(rng: np.random.Generator, width: float, middle: float) -> Any:
    lens = bpy.data.cameras.new("camera")
    angle = math.radians(rng.uniform(8, 42))
    lens.sensor_fit, lens.angle = "HORIZONTAL", angle
    distance = width / 2 / math.tan(angle / 2) + 0.7
    pitch = math.radians(rng.uniform(-0.5, 6) if rng.random() < 0.65 else rng.uniform(6, 24))
    at = np.array([rng.normal(0, 0.05) * width, 0, middle])
    place = at + distance * np.array([rng.normal(0, 0.02), -math.cos(pitch), math.sin(pitch)])
    held = bpy.data.objects.new("camera", lens)
    held.location = place
    turned = Vector(place - at).to_track_quat("Z", "Y")
    turned.rotate(Euler((0, math.radians(rng.normal(0, 1.6)), 0)))
    held.rotation_euler = turned.to_euler()
    if rng.random() < 0.5:
        lens.dof.use_dof = True
        lens.dof.focus_distance = distance - rng.uniform(0.0, 1.0)
        lens.dof.aperture_fstop = (
            lens.lens / 1e3 / (2 * distance * math.exp(rng.uniform(math.log(5e-4), math.log(0.01))))
        )
    bpy.context.scene.collection.objects.link(held)
    bpy.context.scene.camera = held
    return lens


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Blender writes every sample to file descriptor 1."""
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def rendered(folder: str, name: str) -> npt.NDArray[np.uint8]:
    path = str(Path(folder) / name)
    bpy.context.scene.render.filepath = path
    with quiet():
        bpy.ops.render.render(write_still=True)
    return np.asarray(cv2.imread(path, cv2.IMREAD_COLOR), dtype=np.uint8)


def picture(number: int, packed: Floats, folder: str) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """The picture in BGR order and the class of every pixel."""
    rng = np.random.default_rng([2026, number])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = Scene(rng)
    width, middle = (heap if number % 5 < 3 else bed)(scene, packed)
    lights(rng)
    lens = camera(rng, width, middle)
    page = bpy.context.scene
    page.render.engine = "CYCLES"
    page.render.resolution_x, page.render.resolution_y, page.render.resolution_percentage = WIDTH, HEIGHT, 100
    page.render.image_settings.file_format, page.render.image_settings.color_mode = "PNG", "RGB"
    page.render.threads_mode, page.render.threads = "FIXED", 1
    page.cycles.samples, page.cycles.use_denoising, page.cycles.use_adaptive_sampling = SAMPLES, True, False
    page.cycles.denoising_quality = "FAST"
    page.cycles.max_bounces, page.cycles.transparent_max_bounces = 4, 8
    page.cycles.seed = number
    page.view_settings.view_transform = str(rng.choice(["Standard", "AgX", "Filmic"]))
    page.view_settings.exposure = rng.uniform(-1.2, 1.0)
    seen = rendered(folder, "seen.png")
    # the classes: every mesh glows in the colour of its class, one path per pixel
    lens.dof.use_dof = False
    page.world = None
    for thing in page.objects:
        if thing.type == "LIGHT":
            thing.hide_render = True
    page.cycles.samples, page.cycles.use_denoising, page.cycles.use_adaptive_sampling = 1, False, False
    page.cycles.filter_width, page.cycles.max_bounces = 0.01, 0
    page.view_settings.view_transform, page.view_settings.exposure = "Raw", 0.0
    for mesh in bpy.data.meshes:
        if mesh.name in scene.kinds:
            glow = bpy.data.materials.new("class")
            glow.use_nodes = True
            nodes, links = glow.node_tree.nodes, glow.node_tree.links
            light = nodes.new("ShaderNodeEmission")
            light.inputs["Color"].default_value = (*np.full(3, 0.25 * scene.kinds[mesh.name]), 1)
            links.new(light.outputs["Emission"], nodes["Material Output"].inputs["Surface"])
            mesh.materials.clear()
            mesh.materials.append(glow)

    def classes(hidden: int) -> npt.NDArray[np.uint8]:
        for thing in page.objects:
            if thing.type == "MESH":
                thing.hide_render = scene.kinds.get(thing.data.name) == hidden
        return np.rint(rendered(folder, "classes.png")[..., 0] / 63.75).astype(np.uint8)

    kinds = classes(VESSEL)
    if VESSEL in scene.kinds.values():
        pane = classes(GRAINS) == VESSEL
        kinds[pane & (kinds != GRAINS)] = VESSEL
    return seen, kinds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=600)
    parser.add_argument("--step", type=int, default=1, help="2 and --first 0 or 1: two processes share the work")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    packed = packing()
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(asked.first, asked.first + asked.count * asked.step, asked.step):
            done = asked.folder / f"{number:05d}.png"
            if done.exists():
                continue
            seen, kinds = picture(number, packed, scratch)
            cv2.imwrite(str(done.with_suffix(".jpg")), seen, [cv2.IMWRITE_JPEG_QUALITY, 95])
            cv2.imwrite(str(done), kinds)  # last: a picture with its classes is complete


if __name__ == "__main__":
    main()
