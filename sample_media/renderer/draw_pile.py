"""The heap: wooden beads on a round plate on a post, photographed from four sides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from rigtwin.sample_media.renderer.bead import look_up, map_directions, spun
from rigtwin.sample_media.renderer.footage import Picture, develop, expose, soften, vignette
from rigtwin.sample_media.renderer.heap import HeapSetting, apex_angle, build_heap, flank_angle, outline
from rigtwin.sample_media.renderer.scene import (
    Ball,
    Body,
    Box,
    Camera,
    Cylinder,
    Floats,
    Lights,
    Region,
    Scene,
    Surface,
    along,
    draw,
    lens_blur,
    plain,
    room_lights,
)
from rigtwin.sample_media.renderer.surfaces import brushed, drilled, label, laminate, painted, wood

SETTING = HeapSetting(6.2e-3, 0.090, np.radians(32.0), np.radians(1.0), 0.004, seed=22)
RADIUS = SETTING.diameter * 500  # [mm]
BENCH = -42.0  # [mm], below the plate
CAMERA = Camera((2.0, -640.0, 36.0), 4380.0, 1000, 750, pitch=np.radians(2.4), roll=np.radians(0.6))
VIEWS = {"view1": 0.0, "view2": 90.0, "view3": 180.0, "view4": 270.0}  # [deg], how far the plate was turned
TURNING = Region(160, 225, 660, 280)  # [px], holds the heap and the plate's edge in every view
WOODS = 28  # different beads; each is used several times, turned another way and tinted


@dataclass(frozen=True)
class Cloud(Body):
    """Many equal balls, taken as one body."""

    centres: Floats = None  # type: ignore[assignment]  # [mm], shape (n, 3)
    radius: float = 1.0  # [mm]

    @property
    def reach(self) -> float:
        return float(np.linalg.norm(self.centres, axis=1).max()) + self.radius

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        offset = (self.centres - origin).astype(np.float32)
        spare = np.float32(self.radius**2) - np.einsum("ij,ij->i", offset, offset)
        nearest = np.full(len(direction), np.inf, dtype=np.float32)
        for start in range(0, len(direction), 8192):
            ahead = direction[start : start + 8192] @ offset.T
            inside = ahead * ahead + spare
            t = np.where(inside > 0, ahead - np.sqrt(np.maximum(inside, 0)), np.inf)
            nearest[start : start + 8192] = t.min(axis=1)
        return nearest

    def normal(self, local: Floats) -> Floats:
        return (local - self.centres[self.nearest(local)]) / self.radius

    def nearest(self, local: Floats) -> Floats:
        """Number of the bead whose surface a point lies on."""
        return np.asarray(cKDTree(self.centres).query(local)[1])


@cache
def heap() -> Floats:
    """Bead centres [m]."""
    return build_heap(SETTING)


def turned(points: Floats, degrees: float) -> Floats:
    """Points after the plate was turned counter-clockwise seen from above."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


@cache
def _wood_maps() -> Floats:
    directions = map_directions().reshape(-1, 3)
    axis = np.array([0.0, 0.0, 1.0])
    maps = [drilled(wood(directions, 900 + k), directions, axis, 0.17) for k in range(WOODS)]
    return np.array(maps, dtype=np.float32).reshape(WOODS, *map_directions().shape)


def _bead_colours(centres: Floats, degrees: float) -> Callable[[Floats], Floats]:
    """Every bead its own wood, way up and tint; turning the plate turns the beads with it."""
    rng = np.random.default_rng(77)
    count = len(centres)
    which = rng.integers(0, WOODS, count)
    tint = 1 + np.column_stack([rng.normal(0, 0.07, count)] * 3) + rng.normal(0, 0.02, (count, 3)) * [0.5, 1, 1.6]
    attitude = np.array([spun(tuple(rng.normal(size=3)), rng.uniform(0, 2 * np.pi)) for _ in range(count)])
    tree = cKDTree(centres)

    def colour(points: Floats) -> Floats:
        number = tree.query(points)[1]
        outward = turned((points - centres[number]) / RADIUS, -degrees)
        own = np.einsum("nij,nj->ni", attitude[number], outward)
        albedo = np.empty((len(points), 3))
        for k in range(WOODS):
            mine = which[number] == k
            albedo[mine] = look_up(_wood_maps()[k], own[mine])
        return albedo * tint[number]

    return colour


def _cloud_shade(centres: Floats) -> Callable[[Floats, Floats], np.ndarray]:
    """Which points lie behind a bead, seen from a far light: depth maps drawn once per light."""
    step = 0.14  # [mm]
    maps: dict[bytes, tuple[Floats, Floats, Floats]] = {}

    def depth_map(direction: Floats) -> tuple[Floats, Floats, Floats]:
        frame = along(tuple(float(x) for x in direction))
        local = centres @ frame.T
        low = local[:, :2].min(axis=0) - RADIUS - 1
        size = np.ceil((local[:, :2].max(axis=0) + RADIUS + 1 - low) / step).astype(int)
        nearest = np.full(size, -np.inf, dtype=np.float32)
        half = int(RADIUS / step) + 1
        for a, b, depth in local:
            i, j = np.round((np.array([a, b]) - low) / step).astype(int)
            rows, columns = np.arange(i - half, i + half + 1), np.arange(j - half, j + half + 1)
            square = RADIUS**2 - ((rows * step + low[0] - a) ** 2)[:, None] - ((columns * step + low[1] - b) ** 2)[None]
            top = np.where(square > 0, depth + np.sqrt(np.maximum(square, 0)), -np.inf)
            part = nearest[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            np.maximum(part, top, out=part)
        return frame, low, nearest

    def shade(points: Floats, direction: Floats) -> np.ndarray:
        key = direction.tobytes()
        if key not in maps:
            maps[key] = depth_map(direction)
        frame, low, nearest = maps[key]
        local = points @ frame.T
        cell = np.round((local[:, :2] - low) / step).astype(int)
        inside = np.all((cell >= 0) & (cell < nearest.shape), axis=1)
        hidden = np.zeros(len(points), dtype=bool)
        # a bead must not shade itself through the coarseness of the map
        hidden[inside] = nearest[cell[inside, 0], cell[inside, 1]] > local[inside, 2] + 0.3
        return hidden

    return shade


@cache
def lights() -> Lights:
    return room_lights((-0.55, -0.45, 0.8), np.radians(10), 2.3, seed=3)


def scene(degrees: float) -> Scene:
    """The bench with the plate turned by `degrees`; the plate's top is z = 0, its axis x = y = 0."""
    centres = turned(heap() * 1000, degrees)
    black = Surface(plain(0.02, 0.02, 0.022), mirror=0.04, gloss=0.1)
    beads = Surface(_bead_colours(centres, degrees), gloss=0.035, shine=24)
    spilled = [(-46.0, 75.0), (-38.5, 92.0), (34.0, 60.0), (52.0, 118.0), (41.0, 64.0)]
    bodies: list[Body] = [
        Cloud((0.0, 0.0, 0.0), beads, casts=False, centres=centres, radius=RADIUS),
        Cylinder(
            (0.0, 0.0, -2.5),
            Surface(brushed(0.20), mirror=0.28, gloss=0.12, shine=50),
            radius=SETTING.base_diameter * 500,
            half=2.5,
        ),
        Cylinder((0.0, 0.0, -23.0), black, radius=13.0, half=18.0),
        Cylinder((0.0, 0.0, BENCH + 2.0), black, radius=30.0, half=2.0),
        Box((0.0, 100.0, BENCH - 50.0), Surface(laminate((0.20, 0.197, 0.19), seed=81)), half=(600.0, 420.0, 50.0)),
        *(
            Ball((x, y, BENCH + RADIUS), Surface(_loose(number)), radius=RADIUS)
            for number, (x, y) in enumerate(spilled)
        ),
        *_far_things(),
    ]
    return Scene(tuple(bodies), lights(), _cloud_shade(centres))


def _loose(number: int) -> Callable[[Floats], Floats]:
    return lambda points: wood(points / RADIUS, 950 + number)


def _far_things() -> list[Body]:
    far = {"behind": True}
    return [
        Box((0.0, 520.0, 300.0), Surface(painted((0.145, 0.17, 0.185), seed=91)), half=(900.0, 10.0, 700.0), **far),
        Cylinder((-112.0, 420.0, 0.0), Surface(label((0.20, 0.075, 0.02), 92), gloss=0.2), radius=24, half=42, **far),
        Cylinder((-112.0, 420.0, 52.0), Surface(plain(0.03, 0.03, 0.035)), radius=11, half=10, **far),
        Box((118.0, 440.0, 2.0), Surface(label((0.04, 0.10, 0.24), 93)), half=(13.0, 40.0, 44.0), **far),
        Box((146.0, 440.0, -2.0), Surface(label((0.30, 0.06, 0.05), 94)), half=(13.0, 40.0, 40.0), **far),
        Box((-20.0, 460.0, -32.0), Surface(plain(0.40, 0.40, 0.37)), half=(30.0, 30.0, 9.0), **far),
    ]


def light(name: str, region: Region) -> Floats:
    """Linear light of a part of a view."""
    picture, depth = draw(scene(VIEWS[name]), CAMERA, region)
    return _through_lens(picture, depth)


def _through_lens(picture: Floats, depth: Floats) -> Floats:
    return soften(lens_blur(picture, depth, focus=638.0, aperture=20.0))


@cache
def _first_view() -> tuple[Floats, Floats]:
    return draw(scene(0.0), CAMERA, Region(0, 0, CAMERA.width, CAMERA.height))


def _whole(name: str) -> Floats:
    """A whole view; round the heap and its plate nothing changes when the plate is turned."""
    picture, depth = (part.copy() for part in _first_view())
    if VIEWS[name]:
        r = TURNING
        part = np.s_[r.top : r.top + r.height, r.left : r.left + r.width]
        picture[part], depth[part] = draw(scene(VIEWS[name]), CAMERA, r)
    return _through_lens(picture, depth)


def finish(picture: Floats, region: Region | None = None) -> Floats:
    """Display values 0..255 of linear light."""
    r = region or Region(0, 0, CAMERA.width, CAMERA.height)
    shade = vignette(CAMERA.width, CAMERA.height, 0.18)[r.top : r.top + r.height, r.left : r.left + r.width]
    return develop(picture * shade, 0.62)


def photo(name: str) -> Picture:
    """One view, RGB."""
    return expose(finish(_whole(name)), np.random.default_rng(int(VIEWS[name]) + 5), 2.2)


def truth() -> dict[str, Any]:
    """What is known of the heap and of each view."""
    return {
        "rig": "pile",
        "variant": "piling",
        "bead_diameter_m": SETTING.diameter,
        "base_diameter_m": SETTING.base_diameter,
        "count": len(heap()),
        "bead_centres_m": heap().tolist(),
        "views": {name: _view_truth(name) for name in VIEWS},
    }


def _view_truth(name: str) -> dict[str, Any]:
    edge = outline(heap(), SETTING.diameter, np.radians(VIEWS[name]))
    ends = CAMERA.project(np.array([[-45.0, 0, 0], [45.0, 0, 0]]))
    foot = edge.x[edge.height > 0]
    return {
        "file": f"pile/{name}.jpg",
        "width_px": CAMERA.width,
        "height_px": CAMERA.height,
        "plate_turned_deg": VIEWS[name],
        "camera_roll_deg": float(np.degrees(CAMERA.roll)),
        "camera_pitch_deg": float(np.degrees(CAMERA.pitch)),
        "scale_m_per_px": float(0.09 / np.linalg.norm(ends[1] - ends[0])),
        "plate_ends_px": ends.tolist(),
        "plate_axis_px": CAMERA.project(np.zeros(3)).tolist(),
        "heap_height_m": float(edge.height.max()),
        "heap_width_m": float(foot.max() - foot.min()),
        "graphical_15_85_deg": {side: flank_angle(edge, side, 0.15, 0.85) for side in ("left", "right")},
        "graphical_20_80_deg": {side: flank_angle(edge, side, 0.20, 0.80) for side in ("left", "right")},
        "geometric_apex_deg": apex_angle(edge, SETTING.base_diameter),
        "profile_x_m": np.round(edge.x, 6).tolist(),
        "profile_height_m": np.round(edge.height, 7).tolist(),
    }
