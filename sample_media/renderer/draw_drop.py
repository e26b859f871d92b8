"""The drop test: a steel plate, a stand with a release tube, a rule, and a bead that falls and bounces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import cv2
import numpy as np

from rigtwin.sample_media.renderer.bead import WoodenBead, expose_bead, shadow, spun, wooden_bead
from rigtwin.sample_media.renderer.footage import Picture, develop, expose, soften, vignette
from rigtwin.sample_media.renderer.physics_drop import DropMotion, DropSetting, fly
from rigtwin.sample_media.renderer.scene import (
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
from rigtwin.sample_media.renderer.surfaces import brushed, label, laminate, painted, rule_colour

FRAME_RATE = 240  # [1/s]
EXPOSURE = 1 / 800  # [s]
SUBFRAMES = 12
BEAD_DIAMETER = 6.2e-3  # [m]
BEAD_MASS = 7.1e-5  # [kg]
RULE_MIDDLE = (47.0, 0.6, 150.0)  # [mm], its face lies in the bead's plane y = 0
CAMERA = Camera((6.0, -690.0, 152.0), 1650.0, 432, 768, pitch=np.radians(0.8), roll=np.radians(0.5))
SETTINGS = {
    "r01": DropSetting(BEAD_DIAMETER, BEAD_MASS, 0.2640, 0.05137, 0.426, 0.030),
    "r02": DropSetting(BEAD_DIAMETER, BEAD_MASS, 0.2643, 0.04371, 0.433, 0.030, start=(0.0004, 0.0)),
    "r03": DropSetting(BEAD_DIAMETER, BEAD_MASS, 0.2647, 0.04822, 0.418, 0.030, kick=(-0.055, 0.02)),
}
FRAMES = 168
LOOKS = {"r01": (5, 0.4), "r02": (17, 2.1), "r03": (29, 4.0)}  # seed of the wood, how it lies in the holder [rad]


@cache
def lights() -> Lights:
    return room_lights((-0.55, -0.6, 0.75), np.radians(9), 2.3, seed=1)


@cache
def scene() -> Scene:
    """Everything that stands still; the plate's top is z = 0, the bead falls along x = y = 0."""
    steel = Surface(brushed(0.17), mirror=0.24, gloss=0.10, shine=60)
    rod = Surface(brushed(0.16, along_x=False), mirror=0.42, gloss=0.2, shine=80)
    black = Surface(plain(0.018, 0.018, 0.02), mirror=0.03, gloss=0.12, shine=25)
    bodies: list[Body] = [
        Box((11.5, 6.0, -5.0), steel, half=(49.5, 36.0, 5.0)),
        Box((-20.0, 240.0, -60.0), Surface(laminate((0.17, 0.168, 0.165))), half=(700.0, 560.0, 50.0)),
        Box(RULE_MIDDLE, Surface(rule_colour(300.0, 22.0), mirror=0.10, gloss=0.05, shine=40), half=(11.0, 0.5, 150.0)),
        Cylinder((-62.0, 34.0, 150.0), rod, radius=6.0, half=160.0),
        Box((-62.0, 34.0, -6.0), Surface(plain(0.05, 0.07, 0.10), gloss=0.06), half=(22.0, 26.0, 4.0)),
        Box((-62.0, 30.0, 290.0), Surface(plain(0.13, 0.14, 0.15), mirror=0.06, gloss=0.1), half=(11.0, 15.0, 10.0)),
        Cylinder((-62.0, 8.0, 290.0), rod, along((0.0, 1.0, 0.0)), radius=3.5, half=9.0),
        Cylinder((-24.0, 12.0, 298.0), rod, along((1.0, 0.0, 0.0)), radius=4.0, half=42.0),
        Box((0.0, 6.0, 298.0), black, half=(8.0, 13.0, 7.0)),
        Cylinder((0.0, 0.0, 289.0), black, radius=4.2, half=9.0),
        Cylinder((0.0, 0.0, 276.0), rod, radius=1.7, half=5.1),
        *_far_things(),
    ]
    return Scene(tuple(bodies), lights())


def _far_things() -> list[Body]:
    """A wall, a shelf and what stands on it, out of focus."""
    far = {"behind": True}
    wall = Box((0.0, 820.0, 200.0), Surface(painted((0.235, 0.265, 0.275))), half=(900.0, 10.0, 600.0), **far)
    board = Surface(plain(0.42, 0.33, 0.22))
    things: list[Body] = [
        wall,
        Box((150.0, 740.0, 196.0), board, half=(240.0, 70.0, 8.0), **far),
        Cylinder((-40.0, 720.0, 244.0), Surface(label((0.20, 0.075, 0.02), 41), gloss=0.2), radius=26, half=40, **far),
        Cylinder((-40.0, 720.0, 294.0), Surface(plain(0.03, 0.03, 0.035)), radius=12, half=10, **far),
        Cylinder((38.0, 735.0, 258.0), Surface(label((0.62, 0.64, 0.62), 42), gloss=0.1), radius=32, half=54, **far),
        Cylinder((38.0, 735.0, 322.0), Surface(plain(0.05, 0.14, 0.36)), radius=15, half=11, **far),
        Box((118.0, 740.0, 274.0), Surface(label((0.03, 0.08, 0.22), 43)), half=(15.0, 50.0, 70.0), **far),
        Box((152.0, 740.0, 272.0), Surface(label((0.33, 0.05, 0.04), 44)), half=(15.0, 50.0, 68.0), **far),
        Box((186.0, 740.0, 270.0), Surface(label((0.06, 0.16, 0.09), 45)), half=(15.0, 50.0, 66.0), **far),
        Box((-150.0, 700.0, 30.0), Surface(plain(0.30, 0.31, 0.32)), half=(60.0, 80.0, 40.0), **far),
        Box((-135.0, 619.0, 40.0), Surface(plain(0.02, 0.05, 0.04), gloss=0.2), half=(28.0, 2.0, 15.0), **far),
        Cylinder((108.0, 640.0, 20.0), Surface(plain(0.55, 0.60, 0.62), mirror=0.15), radius=34, half=30, **far),
        Box((40.0, 690.0, 12.0), Surface(plain(0.62, 0.60, 0.55)), half=(22.0, 40.0, 22.0), **far),
    ]
    return things


@dataclass(frozen=True)
class Still:
    """The picture without the bead, and what is needed to darken the plate under it."""

    light: Floats  # linear, shape (h, w, 3)
    region: Region
    rows: Floats  # rows and columns in the region of the pixels that show the plate's top
    columns: Floats
    points: Floats  # [mm], where those pixels lie on the plate, shape (n, 3)
    free: Floats  # which lights reach them, shape (n_lights, n)


def still(region: Region) -> Still:
    """Draw the part of the picture without the bead."""
    margin = 16  # the far blur looks this far around
    left, top = max(region.left - margin, 0), max(region.top - margin, 0)
    right = min(region.left + region.width + margin, CAMERA.width)
    bottom = min(region.top + region.height + margin, CAMERA.height)
    light, depth = draw(scene(), CAMERA, Region(left, top, right - left, bottom - top))
    light = soften(lens_blur(light, depth, focus=690.0, aperture=14.0))
    light = light[region.top - top :, region.left - left :][: region.height, : region.width]
    u, v = np.meshgrid(np.arange(region.width) + region.left, np.arange(region.height) + region.top)
    rays = CAMERA.rays(u.astype(float), v.astype(float)).reshape(-1, 3)
    distance, which = scene().trace(np.array(CAMERA.position), rays)
    points = np.array(CAMERA.position) + rays * np.where(np.isfinite(distance), distance, 0)[:, None]
    plate = np.flatnonzero((which == 0) & (np.abs(points[:, 2]) < 0.05))
    above = (points[plate] + np.array([0.0, 0.0, 0.02])).astype(np.float32)
    free = np.array([scene().lit(above, direction) for direction in lights().direction])
    return Still(
        light,
        region,
        plate // region.width,
        plate % region.width,
        points[plate].astype(np.float32),
        free.reshape(len(lights().direction), -1).astype(np.float32),
    )


def looks(name: str) -> WoodenBead:
    """The bead of a repetition."""
    return wooden_bead(BEAD_DIAMETER * 500, lights(), (0.5, 0.5, 0.49), LOOKS[name][0], hole=0.16)


def frame(motion: DropMotion, bead: WoodenBead, ground: Still, name: str, index: int) -> Floats:
    """Linear light of one frame over the ground's region, without vignette and noise."""
    start = index / FRAME_RATE
    moments = start + (np.arange(SUBFRAMES) + 0.5) / SUBFRAMES * EXPOSURE
    centres = np.array([motion.state(t)[:3] for t in moments]) * 1000
    picture = ground.light.copy()
    middle = motion.state(start + EXPOSURE / 2)[:3] * 1000
    normal = np.array([0.0, 0.0, 1.0], dtype=np.float32)
    left_over = shadow(ground.points, normal, lights(), ground.free, centre=middle, radius=bead.radius)
    picture[ground.rows, ground.columns] *= left_over
    turn = _attitude(motion, name, start + EXPOSURE / 2)
    whole = np.zeros((CAMERA.height, CAMERA.width, 3), dtype=np.float32)
    r = ground.region
    whole[r.top : r.top + r.height, r.left : r.left + r.width] = picture
    _mirror_image(whole, ground, bead, centres, turn)
    patch = expose_bead(bead, CAMERA, centres, turn, gap=centres[:, 2] - bead.radius)
    if patch is not None:
        patch.over(whole)
    return whole[r.top : r.top + r.height, r.left : r.left + r.width]


def _mirror_image(whole: Floats, ground: Still, bead: WoodenBead, centres: Floats, turn: Floats) -> None:
    """The ground steel shows a weak, smeared image of a bead just above it."""
    height = float(centres[:, 2].mean())
    if height > 40:
        return
    patch = expose_bead(bead, CAMERA, centres * [1, 1, -1], turn)
    if patch is None:
        return
    layer = np.zeros((*whole.shape[:2], 4), dtype=np.float32)
    r = patch.region
    layer[r.top : r.top + r.height, r.left : r.left + r.width] = np.dstack([patch.light * 0.6, patch.cover])
    layer = cv2.GaussianBlur(layer, (0, 0), sigmaX=1.0 + height / 12, sigmaY=1.5 + height / 6)
    rows, columns = ground.rows + ground.region.top, ground.columns + ground.region.left
    share = 0.22 * layer[rows, columns, 3:]
    whole[rows, columns] = whole[rows, columns] * (1 - share) + 0.22 * layer[rows, columns, :3]


def _attitude(motion: DropMotion, name: str, time: float) -> Floats:
    """How the bead lies: still while falling, slowly turning after the first contact."""
    first = motion.bounces[0].time
    spin = 6.0 if name != "r03" else 17.0  # [rad/s]
    until = min(time, motion.rest[0])
    return spun((0.0, 0.0, 1.0), LOOKS[name][1]) @ spun((0.1, 1.0, 0.0), spin * max(until - first, 0.0))


def finish(light: Floats, region: Region) -> Floats:
    """Display values 0..255 of linear light."""
    shade = vignette(CAMERA.width, CAMERA.height, 0.16)
    r = region
    return develop(light * shade[r.top : r.top + r.height, r.left : r.left + r.width], 0.56)


def clip(name: str) -> Iterator[Picture]:
    """All frames of a repetition, RGB."""
    ground = _whole_still()
    motion, bead = fly(SETTINGS[name]), looks(name)
    rng = np.random.default_rng(LOOKS[name][0])
    for index in range(FRAMES):
        yield expose(finish(frame(motion, bead, ground, name, index), ground.region), rng, 1.8)


@cache
def _whole_still() -> Still:
    return still(Region(0, 0, CAMERA.width, CAMERA.height))


def truth(name: str) -> dict[str, Any]:
    """What is known of a repetition."""
    setting, motion = SETTINGS[name], fly(SETTINGS[name])
    starts = np.arange(FRAMES) / FRAME_RATE
    states = np.array([motion.state(t + EXPOSURE / 2) for t in starts])
    heights = [setting.height, *(bounce.apex_height for bounce in motion.bounces)]
    zero, top = np.array([36.0, 0.0, 0.0]), np.array([36.0, 0.0, 200.0])
    origin = CAMERA.project(np.zeros(3))
    return {
        "file": f"drop/{name}.mp4",
        "rig": "drop",
        "frame_rate_hz": FRAME_RATE,
        "exposure_s": EXPOSURE,
        "frames": FRAMES,
        "width_px": CAMERA.width,
        "height_px": CAMERA.height,
        "bead_diameter_m": setting.diameter,
        "bead_mass_kg": setting.mass,
        "release_time_s": setting.release,
        "heights_m": heights,
        "restitution_from_heights": [float(np.sqrt(b / a)) for a, b in pairwise(heights)],
        "bounces": [
            {
                "time_s": bounce.time,
                "speed_before_m_per_s": bounce.speed_before,
                "speed_after_m_per_s": bounce.speed_after,
                "restitution": bounce.restitution,
                "apex_time_s": bounce.apex_time,
                "apex_height_m": bounce.apex_height,
            }
            for bounce in motion.bounces
        ],
        "scale_m_per_px": float(0.2 / np.linalg.norm(CAMERA.project(top) - CAMERA.project(zero))),
        "rule_200mm_px": [*CAMERA.project(zero).tolist(), *CAMERA.project(top).tolist()],
        "contact_point_px": origin.tolist(),
        "camera_roll_deg": float(np.degrees(CAMERA.roll)),
        "camera_pitch_deg": float(np.degrees(CAMERA.pitch)),
        "frame_start_s": starts.tolist(),
        "position_m": states[:, :3].tolist(),
        "position_px": CAMERA.project(states[:, :3] * 1000).tolist(),
    }
