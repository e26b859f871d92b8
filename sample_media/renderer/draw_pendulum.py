"""The double pendulum: two drilled beads on threads under a cross bar, a holder that lets one of them go."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from rigtwin.sample_media.renderer.bead import WoodenBead, expose_bead, spun, wooden_bead
from rigtwin.sample_media.renderer.footage import Picture, develop, expose, soften, vignette
from rigtwin.sample_media.renderer.physics_pendulum import PendulumMotion, PendulumSetting, swing, turning_angle
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
EXPOSURE = 1 / 1000  # [s]
SUBFRAMES = 8
FRAMES = 204
BEAD_DIAMETER = 12.2e-3  # [m]
BEAD_MASS = 6.9e-4  # [kg]
GAP = 0.25e-3  # [m]
CAMERA = Camera((-8.0, -760.0, -95.0), 1530.0, 720, 480, pitch=np.radians(0.5), roll=np.radians(-0.4))
BAR_SPREAD = 32.0  # [mm], each bead hangs from two threads, one to the front bar and one to the back bar
SETTINGS = {
    "r01": PendulumSetting(BEAD_DIAMETER, BEAD_MASS, 0.190, GAP, np.radians(45.2), 0.06210, 0.735, 0.035),
    "r02": PendulumSetting(BEAD_DIAMETER, BEAD_MASS, 0.190, GAP, np.radians(45.05), 0.07035, 0.722, 0.035),
}
SEEDS = {"r01": 101, "r02": 202}
HOLD = SETTINGS["r01"]


@cache
def lights() -> Lights:
    return room_lights((-0.35, -0.75, 0.7), np.radians(11), 2.3, seed=2)


@cache
def scene() -> Scene:
    """Everything that stands still; the hinges lie at z = 0, the beads swing in the plane y = 0."""
    rod = Surface(brushed(0.16, along_x=False), mirror=0.42, gloss=0.2, shine=80)
    bar = Surface(brushed(0.20), mirror=0.30, gloss=0.15, shine=70)
    black = Surface(plain(0.018, 0.018, 0.02), mirror=0.03, gloss=0.12, shine=25)
    angle = HOLD.release_angle
    # the holder pushes against the bead from outside, square to the threads
    side = np.array([-np.cos(angle), 0.0, -np.sin(angle)])
    bead = np.array([HOLD.pivots[0, 0] - HOLD.length * np.sin(angle), 0.0, -HOLD.length * np.cos(angle)]) * 1000
    tip, grip = bead + side * (BEAD_DIAMETER * 500 + 5.2), bead + side * (BEAD_DIAMETER * 500 + 21.0)
    bodies: list[Body] = [
        Box((-20.0, 200.0, -330.0), Surface(laminate((0.25, 0.245, 0.235), seed=51)), half=(900.0, 520.0, 50.0)),
        Cylinder((88.0, 42.0, -100.0), rod, radius=6.5, half=190.0),
        Box((88.0, 30.0, -270.0), Surface(plain(0.05, 0.05, 0.055), gloss=0.06), half=(45.0, 60.0, 10.0)),
        Box((88.0, 20.0, 6.0), Surface(plain(0.13, 0.14, 0.15), mirror=0.06, gloss=0.1), half=(11.0, 34.0, 11.0)),
        Box((18.0, -BAR_SPREAD, 4.0), bar, half=(66.0, 3.0, 4.0)),
        Box((18.0, BAR_SPREAD, 4.0), bar, half=(66.0, 3.0, 4.0)),
        Box(
            (-10.0, 0.6, -217.0),
            Surface(rule_colour(150.0, 26.0), mirror=0.1, gloss=0.05),
            along((1.0, 0.0, 0.0)),
            half=(13.0, 0.5, 75.0),
        ),
        Cylinder(tuple(tip), rod, along(tuple(side)), radius=1.6, half=5.0),
        Cylinder(tuple(grip), black, along(tuple(side)), radius=4.5, half=12.0),
        Cylinder((float(grip[0]) - 4.0, 12.0, -230.0), rod, radius=5.0, half=86.0),
        *_far_things(),
    ]
    return Scene(tuple(bodies), lights())


def _far_things() -> list[Body]:
    far = {"behind": True}
    board = Surface(plain(0.36, 0.37, 0.38))
    return [
        Box((0.0, 700.0, 100.0), Surface(painted((0.42, 0.43, 0.40), seed=61)), half=(1200.0, 10.0, 700.0), **far),
        Box((-260.0, 640.0, -136.0), board, half=(170.0, 60.0, 6.0), **far),
        Box((-230.0, 640.0, -85.0), Surface(label((0.30, 0.20, 0.05), 71)), half=(14.0, 45.0, 45.0), **far),
        Box((-200.0, 640.0, -80.0), Surface(label((0.05, 0.15, 0.20), 72)), half=(14.0, 45.0, 50.0), **far),
        Box((-170.0, 640.0, -88.0), Surface(label((0.25, 0.06, 0.08), 73)), half=(13.0, 45.0, 42.0), **far),
        Cylinder((322.0, 600.0, -190.0), Surface(label((0.20, 0.075, 0.02), 74), gloss=0.2), radius=38, half=90, **far),
        Cylinder((322.0, 600.0, -85.0), Surface(plain(0.03, 0.03, 0.035)), radius=18, half=15, **far),
        Box((90.0, 620.0, -235.0), Surface(plain(0.45, 0.45, 0.42)), half=(60.0, 60.0, 45.0), **far),
        Box((70.0, 558.0, -225.0), Surface(plain(0.03, 0.06, 0.07), gloss=0.2), half=(24.0, 2.0, 14.0), **far),
        Cylinder((-60.0, 600.0, -250.0), Surface(plain(0.50, 0.55, 0.58), mirror=0.2), radius=30, half=40, **far),
    ]


@cache
def still() -> Floats:
    """Linear light of the picture without beads and threads."""
    light, depth = draw(scene(), CAMERA, Region(0, 0, CAMERA.width, CAMERA.height))
    return soften(lens_blur(light, depth, focus=760.0, aperture=15.0))


@cache
def beads() -> tuple[WoodenBead, WoodenBead]:
    """Beads A and B."""
    a, b = (wooden_bead(BEAD_DIAMETER * 500, lights(), (0.28, 0.28, 0.27), seed) for seed in (303, 404))
    return a, b


def frame(motion: PendulumMotion, ground: Floats, index: int) -> Floats:
    """Linear light of one frame, without vignette and noise."""
    picture = ground.copy()
    moments = index / FRAME_RATE + (np.arange(SUBFRAMES) + 0.5) / SUBFRAMES * EXPOSURE
    centres = np.array([motion.centres(t) for t in moments]) * 1000  # (moment, bead, x and z)
    angles = motion.angles(index / FRAME_RATE + EXPOSURE / 2)
    for k, bead in enumerate(beads()):
        hinge = motion.setting.pivots[k] * 1000
        for y in (BAR_SPREAD, -BAR_SPREAD):
            _thread(picture, hinge, y, centres[:, k])
        places = np.column_stack([centres[:, k, 0], np.zeros(SUBFRAMES), centres[:, k, 1]])
        # the threads keep the bead from turning about its own axis: it turns with the swing
        patch = expose_bead(bead, CAMERA, places, spun((0.0, 1.0, 0.0), float(angles[k])))
        if patch is not None:
            patch.over(picture)
    return picture


def _thread(picture: Floats, hinge: Floats, y: float, centres: Floats) -> None:
    """One thread of 0.16 mm from the bar to the bead, averaged over the exposure, laid over the picture row by row."""
    ends = np.column_stack([centres[:, 0], np.zeros(len(centres)), centres[:, 1]])
    start = CAMERA.project(np.array([hinge[0], y, hinge[1]]))
    stops = CAMERA.project(ends)
    width = 0.16 * CAMERA.focal / -CAMERA.position[1]  # [px]
    rows = np.arange(max(int(start[1]), 0), min(int(stops[:, 1].max()) + 1, CAMERA.height - 1))
    slope = (stops[:, 0] - start[0]) / (stops[:, 1] - start[1])
    column = start[0] + slope[:, None] * (rows - start[1])  # (moment, row)
    long_enough = rows[None] <= stops[:, 1:]
    steep = np.sqrt(1 + slope[:, None] ** 2)
    low = int(np.floor(column.min())) - 4
    cells = np.arange(low, int(np.ceil(column.max())) + 5)
    apart = (cells[None, None] - column[..., None]) / steep[..., None]
    sigma = 0.62
    cover = width / (sigma * np.sqrt(2 * np.pi)) * np.exp(-0.5 * (apart / sigma) ** 2) * long_enough[..., None]
    cover = np.clip(cover.mean(axis=0), 0, 1).astype(np.float32)
    keep = (cells >= 0) & (cells < CAMERA.width)
    part = picture[rows[0] : rows[-1] + 1, cells[keep]]
    share = cover[:, keep, None]
    colour = np.array([0.62, 0.61, 0.57], dtype=np.float32)
    picture[rows[0] : rows[-1] + 1, cells[keep]] = part * (1 - share) + colour * share


def finish(light: Floats) -> Floats:
    """Display values 0..255 of linear light."""
    return develop(light * vignette(CAMERA.width, CAMERA.height, 0.18), 0.52)


def clip(name: str) -> Iterator[Picture]:
    """All frames of a repetition, RGB."""
    motion = swing(SETTINGS[name], FRAMES / FRAME_RATE + 0.01)
    rng = np.random.default_rng(SEEDS[name])
    for index in range(FRAMES):
        yield expose(finish(frame(motion, still(), index)), rng, 1.8)


def truth(name: str) -> dict[str, Any]:
    """What is known of a repetition."""
    setting = SETTINGS[name]
    motion = swing(setting, FRAMES / FRAME_RATE + 0.01)
    starts = np.arange(FRAMES) / FRAME_RATE
    centres = np.array([motion.centres(t + EXPOSURE / 2) for t in starts])
    angles = np.array([motion.angles(t + EXPOSURE / 2)[:2] for t in starts])
    world = np.insert(centres, 1, 0.0, axis=2) * 1000
    first = motion.collisions[0]
    until = motion.collisions[1].time if len(motion.collisions) > 1 else starts[-1]
    rebound = [turning_angle(motion, k, first.time, until) for k in (0, 1)]
    zero, end = np.array([-85.0, 0.0, -204.0]), np.array([65.0, 0.0, -204.0])
    sine = np.sin(np.array([setting.release_angle, *rebound]) / 2)
    return {
        "file": f"pendulum/{name}.mp4",
        "rig": "pendulum",
        "variant": "double",
        "frame_rate_hz": FRAME_RATE,
        "exposure_s": EXPOSURE,
        "frames": FRAMES,
        "width_px": CAMERA.width,
        "height_px": CAMERA.height,
        "bead_diameter_m": setting.diameter,
        "bead_mass_kg": setting.mass,
        "length_m": setting.length,
        "gap_at_rest_m": setting.gap,
        "release_time_s": setting.release,
        "restitution": setting.restitution,
        "release_angle_deg": float(np.degrees(setting.release_angle)),
        "rebound_angle_deg": {"A": float(np.degrees(rebound[0])), "B": float(np.degrees(rebound[1]))},
        "restitution_from_angles": float((sine[2] - sine[1]) / sine[0]),
        "sqrt_height_ratio_B": float(sine[2] / sine[0]),
        "collisions": [
            {
                "time_s": hit.time,
                "speed_before_m_per_s": {"A": hit.before[0], "B": hit.before[1]},
                "speed_after_m_per_s": {"A": hit.after[0], "B": hit.after[1]},
                "restitution": hit.restitution,
            }
            for hit in motion.collisions
        ],
        "scale_m_per_px": float(0.150 / np.linalg.norm(CAMERA.project(end) - CAMERA.project(zero))),
        "rule_150mm_px": [*CAMERA.project(zero).tolist(), *CAMERA.project(end).tolist()],
        "pivot_m": {"A": setting.pivots[0].tolist(), "B": setting.pivots[1].tolist()},
        "pivot_px": {
            body: CAMERA.project(np.array([setting.pivots[k, 0], 0, setting.pivots[k, 1]]) * 1000).tolist()
            for k, body in enumerate("AB")
        },
        "camera_roll_deg": float(np.degrees(CAMERA.roll)),
        "camera_pitch_deg": float(np.degrees(CAMERA.pitch)),
        "frame_start_s": starts.tolist(),
        "angle_deg": {body: np.degrees(angles[:, k]).tolist() for k, body in enumerate("AB")},
        "position_m": {body: centres[:, k].tolist() for k, body in enumerate("AB")},
        "position_px": {body: CAMERA.project(world[:, k]).tolist() for k, body in enumerate("AB")},
    }
