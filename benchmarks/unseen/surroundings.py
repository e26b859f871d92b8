"""What stands around a rig in a lab: table, wall, shelf, bottles, boxes, rulers; and the grains, as Mitsuba objects.

World: x to the right, y away from the camera, z up; the radius of the rig is 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import mitsuba as mi
import numpy as np
import shapes
import textures
from shapes import Body, Floats


@dataclass
class Scene:
    """Objects of a picture; `width` of the view at the rig and `centre` (x, z) that the camera looks at."""

    rng: np.random.Generator
    objects: list[dict[str, Any] | mi.Mesh] = field(default_factory=list)
    width: float = 3.0
    centre: tuple[float, float] = (0.0, 0.5)

    def add(self, kind: str, **settings: Any) -> None:
        if "bsdf" not in settings:
            settings["bsdf"] = coat(self.rng, {"type": "bitmap", "bitmap": picture(textures.texture(self.rng))})
        self.objects.append({"type": kind, **settings})

    def box(self, low: Floats | list[float], high: Floats | list[float], **settings: Any) -> None:
        low, high = np.asarray(low, float), np.asarray(high, float)
        place = settings.pop("turn", mi.ScalarTransform4f())
        place = place @ mi.ScalarTransform4f().translate(list((low + high) / 2)).scale(list((high - low) / 2))
        self.add("cube", to_world=place, **settings)

    def column(self, low: list[float], radius: float, height: float, top: bool = True, **settings: Any) -> None:
        """Upright cylinder with its lower centre at `low`."""
        bsdf = settings.pop("bsdf", None) or coat(self.rng, colour_of(self.rng))
        high = [low[0], low[1], low[2] + height]
        self.add("cylinder", p0=low, p1=high, radius=radius, bsdf={"type": "twosided", "inner": bsdf})
        if top:
            lid = mi.ScalarTransform4f().translate(high).scale(radius)
            self.add("disk", to_world=lid, bsdf={"type": "twosided", "inner": bsdf})

    def spheres(self, centres: Floats, radius: float, colours: Floats, finish: str) -> None:
        """Spheres, shape (n, 3), each with its colour."""
        if len(centres):
            detail = 3 if len(centres) < 600 else 2
            body, tints = shapes.copies(shapes.sphere(detail), centres, 2 * radius, colours)
            material = coat(self.rng, {"type": "mesh_attribute", "name": "vertex_color"}, finish)
            self.objects.append(mesh(body, tints, material))


def picture(values: Floats) -> mi.Bitmap:
    return mi.Bitmap(np.asarray(np.asarray(values) * 255, dtype=np.uint8))


def colour_of(rng: np.random.Generator) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(x) for x in textures.colour(rng) ** 2.2]}


def coat(rng: np.random.Generator, reflectance: dict[str, Any], finish: str | None = None) -> dict[str, Any]:
    """Material with this reflectance: matt, glossy or metallic."""
    finish = finish or str(rng.choice(["matt", "matt", "gloss", "metal"], p=[0.4, 0.2, 0.3, 0.1]))
    if finish == "matt":
        return {"type": "diffuse", "reflectance": reflectance}
    rough = {"gloss": rng.uniform(0.05, 0.5), "glass": 0.03, "metal": rng.uniform(0.1, 0.5)}[finish]
    metallic = 1.0 if finish == "metal" else 0.0
    specular = 0.9 if finish == "glass" else 0.5
    return {
        "type": "principled",
        "base_color": reflectance,
        "roughness": float(rough),
        "metallic": metallic,
        "specular": specular,
    }


def mesh(body: Body, tints: Floats, material: dict[str, Any]) -> mi.Mesh:
    props = mi.Properties()
    props["mesh_bsdf"] = mi.load_dict(material)
    made = mi.Mesh("grains", len(body.vertices), len(body.faces), has_vertex_normals=True, props=props)
    made.add_attribute("vertex_color", 3, np.asarray(tints**2.2, np.float32).ravel())
    params = mi.traverse(made)
    params["vertex_positions"] = np.asarray(body.vertices, np.float32).ravel()
    params["vertex_normals"] = np.asarray(body.normals, np.float32).ravel()
    params["faces"] = np.asarray(body.faces, np.uint32).ravel()
    params.update()
    return made


def clutter(scene: Scene, floor: float, near: float) -> None:
    """Wall, shelf, bottles, cups, boxes behind and beside the rig."""
    rng = scene.rng
    far = near + rng.uniform(0.3, 8)
    extent = 3 * scene.width + far
    if rng.random() < 0.85:
        place = mi.ScalarTransform4f().translate([0, far, 0]).rotate([1, 0, 0], 90).scale(extent)
        scale = rng.uniform(1, 12)
        bitmap = {
            "type": "bitmap",
            "bitmap": picture(textures.texture(rng)),
            "to_uv": mi.ScalarTransform3f().scale([scale, scale]),
        }
        flat = colour_of(rng)
        scene.add("rectangle", to_world=place, bsdf=coat(rng, bitmap if rng.random() < 0.6 else flat, "matt"))
    if rng.random() < 0.3:
        level = rng.uniform(floor, floor + scene.width)
        scene.box([-extent, far - rng.uniform(0.2, 1), level], [extent, far, level + rng.uniform(0.02, 0.15)])
        for _ in range(rng.integers(0, 5)):
            _thing(scene, [rng.uniform(-2, 2) * scene.width, far - 0.3, level + 0.1])
    if rng.random() < 0.3:  # books
        x, level = -rng.uniform(0.3, 1.2) * scene.width, floor + rng.choice([0, rng.uniform(0, 1)]) * scene.width
        tall = rng.uniform(0.1, 0.4) * scene.width
        for _ in range(rng.integers(3, 16)):
            broad = tall * rng.uniform(0.1, 0.4)
            cover = coat(rng, colour_of(rng))
            high = tall * rng.uniform(0.7, 1.0)
            scene.box([x, far - 0.25, level], [x + broad, far - 0.05, level + high], bsdf=cover)
            x += broad * rng.choice([1.02, 1.02, 1.6])
    for _ in range(rng.choice([0, 1, 2, 3, 5], p=[0.3, 0.25, 0.2, 0.15, 0.1])):
        x = rng.uniform(-0.9, 0.9) * (scene.width + 0.3 * near)
        _thing(scene, [x, rng.uniform(near, max(far, near + 0.3)), floor])
    for side in (-1, 1):
        if rng.random() < 0.15:
            _thing(
                scene, [scene.centre[0] + side * scene.width * rng.uniform(0.45, 0.6), rng.uniform(-0.8, 0.8), floor]
            )


def _thing(scene: Scene, foot: list[float]) -> None:
    rng = scene.rng
    foot = [float(x) for x in foot]
    size = scene.width * rng.uniform(0.05, 0.3)
    kind = rng.integers(4)
    if kind == 0:
        extent = size * rng.uniform(0.3, 1.2, 3)
        turn = mi.ScalarTransform4f().translate(foot).rotate([0, 0, 1], float(rng.uniform(0, 90)))
        scene.box([-extent[0], -extent[1], 0], [extent[0], extent[1], 2 * extent[2]], turn=turn)
    elif kind == 1:
        scene.column(foot, size * 0.5, size * rng.uniform(0.6, 3), top=bool(rng.random() < 0.5))
    elif kind == 2:
        scene.column(foot, size * 0.4, size * 1.5)
        scene.column([foot[0], foot[1], foot[2] + size * 1.5], size * 0.15, size * rng.uniform(0.3, 0.8))
    else:
        scene.add(
            "sphere",
            center=[foot[0], foot[1], foot[2] + size * 0.5],
            radius=size * 0.5,
            bsdf=coat(rng, colour_of(rng)),
        )


def table(scene: Scene, level: float) -> None:
    extent = 10 * scene.width
    scale = scene.rng.uniform(2, 40)
    bitmap = {
        "type": "bitmap",
        "bitmap": picture(textures.texture(scene.rng)),
        "to_uv": mi.ScalarTransform3f().scale([scale, scale]),
    }
    reflectance = bitmap if scene.rng.random() < 0.6 else colour_of(scene.rng)
    place = mi.ScalarTransform4f().translate([0, extent - scene.rng.uniform(2, 5), level]).scale(extent)
    scene.add("rectangle", to_world=place, bsdf=coat(scene.rng, reflectance))


def ruler(scene: Scene, corner: list[float], length: float, upright: bool) -> None:
    """Ruler with its marks towards the camera, and its lower left corner at `corner`."""
    height = length * scene.rng.uniform(0.05, 0.14)
    marks = {"type": "bitmap", "bitmap": picture(textures.ruler(scene.rng, length / height))}
    place = mi.ScalarTransform4f().translate(corner)
    if upright:
        place = place @ mi.ScalarTransform4f().rotate([0, 1, 0], -90)
    place = place @ mi.ScalarTransform4f().translate([length / 2, 0, height / 2]).rotate([1, 0, 0], 90)
    place = place @ mi.ScalarTransform4f().scale([length / 2, height / 2, 1])
    bsdf = {"type": "twosided", "inner": coat(scene.rng, marks, str(scene.rng.choice(["matt", "gloss"])))}
    scene.add("rectangle", to_world=place, bsdf=bsdf)
