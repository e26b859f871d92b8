"""Photos and films of beads in bulk (heap, bed behind glass, turning drum, hopper), with one hardness at a time.

Shaded balls before a mottled wall; every picture is drawn from a random generator, its truth known from the balls'
places.  What is done to a picture as a whole (roll, shake, glare, a rod or a hand in front, noise) goes by `Footage`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import small
from rigtwin.benchmarks.measure.bulk_coverage import BEAD, CYLINDER, heaped
from rigtwin.benchmarks.measure.draw_footage import LENS, Footage, sway
from rigtwin.lab.records import Profile

Array = npt.NDArray[np.float64]
Picture = npt.NDArray[np.float32]  # BGR
Photo = npt.NDArray[np.uint8]

WARM = np.array([0.72, 0.95, 1.1], np.float32)  # of a bead's grey level, BGR
LIGHT = np.array([0.35, 0.6, 0.72])  # from the upper right, before the scene
FINE = 16  # parts of a pixel in which OpenCV draws
LARGE = 4  # times as large polygons are drawn
PLAIN = Footage(ground=190.0, bead=170.0)
FRAMES = small(60, 20)  # of a turning drum
DRUM = 0.150  # [m], the drum's diameter, of which a bead is a twenty-fifth
BIN, SLOT, HOPPER_BED = 0.070, 0.030, 0.055  # [m]
SLIDE = 1.2  # [m/s], how fast the slide goes


@dataclass(frozen=True)
class Look:
    """How a scene is set up and taken."""

    footage: Footage = PLAIN
    roll: float = 0.0  # [deg], positive when the scene looks turned clockwise
    clutter: int = 0  # boxes behind the scene
    streaks: float = 0.0  # [grey levels], of a window's reflection in glass
    uneven: float = 0.0  # [bead diameters], by which a bed is higher on one side
    lamp: tuple[float, float] = (
        0.0,
        0.0,
    )  # [bead diameters], of the glare's middle from the middle of what is measured
    lamp_size: float = 2.5  # [bead diameters], standard deviation


# ------------------------------------------------------------------------------------------------------------- pictures


def wall(shape: tuple[int, int], look: Look, rng: np.random.Generator) -> Picture:
    """A mottled wall, lit unevenly, with things standing before it."""
    footage = look.footage
    mottle = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), 5)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    light = footage.ground * (1 + 0.08 * x / shape[1] - 0.06 * y / shape[0]) + footage.mottle * mottle / mottle.std()
    picture = np.repeat(light[..., None], 3, axis=2).astype(np.float32)
    for _ in range(look.clutter):
        left, wide = rng.uniform(0, shape[1]), rng.uniform(0.03, 0.15) * shape[1]
        top, bottom = rng.uniform(0.05, 0.6) * shape[0], 0.8 * shape[0]
        cv2.rectangle(
            picture, (int(left), int(top)), (int(left + wide), int(bottom)), rng.uniform(30, 220, 3).tolist(), -1
        )
    return picture


def balls(picture: Picture, at: Array, radius: Array, nearness: Array, tone: Array, grey: float) -> None:
    """Shaded balls, the nearer before the further ones; places and radii in pixels, `nearness` in radii."""
    front = np.full(picture.shape[:2], -np.inf)
    for (u, v), r, near, own in zip(at, radius, nearness, tone, strict=True):
        left, right = max(int(u - r), 0), min(int(u + r) + 2, picture.shape[1])
        top, bottom = max(int(v - r), 0), min(int(v + r) + 2, picture.shape[0])
        if left >= right or top >= bottom:
            continue
        y, x = np.mgrid[top:bottom, left:right]
        across, up = (x - u) / r, (v - y) / r
        out = np.sqrt(np.maximum(1 - across * across - up * up, 0))
        patch = front[top:bottom, left:right]
        seen = (across * across + up * up < 1) & (near + out > patch)
        patch[seen] = (near + out)[seen]
        bright = 0.4 + 0.6 * np.maximum(across * LIGHT[0] + up * LIGHT[1] + out * LIGHT[2], 0)
        bright = bright * np.clip(0.4 + 0.8 * out, 0, 1)  # gaps between beads are dark
        picture[top:bottom, left:right][seen] = (grey * own * bright[..., None] * WARM)[seen]


def taken(
    picture: Picture,
    look: Look,
    middle: tuple[float, float],
    bead: float,
    moved: Array,
    k: int,
    rng: np.random.Generator,
) -> Photo:
    """What the camera makes of a scene; `middle` of what is measured and the `bead`'s diameter in pixels."""
    footage, (height, width) = look.footage, picture.shape[:2]
    if footage.bar:
        left = round(middle[0] + 1.5 * bead)
        picture[:, left : left + round(1.2 * bead)] = 0.4 * footage.ground
    if footage.hand:
        x = width * (0.95 - 0.25 * math.sin(0.15 * k))
        cv2.ellipse(
            picture,
            (round(x), round(0.6 * height)),
            (round(0.16 * width), round(0.07 * height)),
            20,
            0,
            360,
            (140, 165, 205),
            -1,
            cv2.LINE_AA,
        )
    if footage.glare:
        y, x = np.mgrid[:height, :width].astype(np.float32)
        away = (x - middle[0] - look.lamp[0] * bead) ** 2 + (y - middle[1] + look.lamp[1] * bead) ** 2
        picture = picture + footage.glare * np.exp(-away / (2 * (look.lamp_size * bead) ** 2))[..., None]
    if look.roll or footage.shake:
        # OpenCV turns anticlockwise
        turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -look.roll, 1.0)
        turn[:, 2] += moved
        picture = cv2.warpAffine(picture, turn, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    picture = cv2.GaussianBlur(picture, (0, 0), LENS)
    noisy = picture + footage.noise * rng.standard_normal(picture.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def fill(picture: Picture, corners: Array, grey: float) -> None:
    """A polygon [px] of one grey level; drawn large, for OpenCV lets polygons reach half a pixel too far."""
    height, width = picture.shape[:2]
    large = np.zeros((LARGE * height, LARGE * width), np.uint8)
    places = LARGE * (corners + 0.5) - 0.5
    cv2.fillPoly(large, [np.rint(places * FINE).astype(np.int32)], 255, cv2.LINE_AA, 4)
    cover = cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)[..., None] / 255
    picture += cover * (grey - picture)


# ----------------------------------------------------------------------------------------------------------------- rigs


def heap(look: Look, rng: np.random.Generator) -> tuple[Photo, Profile, float]:
    """A heap on a disc, its true outline [m], and the disc's diameter [m]."""
    size, foot = (900, 640), float(rng.uniform(9, 14))
    slopes = tuple(float(each) for each in rng.uniform(20, 32) + rng.uniform(-2, 2, 2))
    profile, places = heaped(rng, slopes, foot)
    focal, distance, down = 1900.0, 6.5 * foot, math.radians(rng.uniform(1, 5))
    eye = distance * math.tan(down)

    def project(points: Array) -> tuple[Array, Array]:
        away = points + np.array([0, distance, -eye])
        depth = away[:, 1] * math.cos(down) - away[:, 2] * math.sin(down)
        up = away[:, 2] * math.cos(down) + away[:, 1] * math.sin(down)
        return np.column_stack([size[0] / 2 + focal * away[:, 0] / depth, 0.58 * size[1] - focal * up / depth]), depth

    picture = wall(size[::-1], look, rng)
    round_about = np.linspace(0, 2 * np.pi, 361)
    rim = np.column_stack([foot * np.cos(round_about), foot * np.sin(round_about), np.zeros(361)])
    post = np.array([[-2.5, 0, -1], [2.5, 0, -1], [2.5, 0, -40], [-2.5, 0, -40.0]])
    fill(picture, project(post)[0], 50)
    side = np.concatenate([project(rim)[0], project(rim - np.array([0, 0, 1.5]))[0]]).astype(np.float32)
    fill(picture, cv2.convexHull(side)[:, 0], 95)
    fill(picture, project(rim)[0], 125)
    at, depth = project(places)
    radius = 0.5 * focal / depth
    balls(picture, at, radius, -2 * depth, rng.uniform(0.9, 1.1, len(at)), look.footage.bead)
    top = project(np.array([[0, 0, 0.5 * profile.height.max() / BEAD]]))[0][0]
    photo = taken(picture, look, (top[0], top[1]), focal / distance, np.zeros(2), 0, rng)
    return photo, profile, 2 * foot * BEAD


def bed(look: Look, rng: np.random.Generator) -> tuple[Photo, float]:
    """A bed in a glass cylinder with a gauge beside it, and the mean height [m] of its surface beads' tops."""
    size, focal, away = (600, 860), 2000.0, 0.44
    reach, level = (CYLINDER - BEAD) / 2, float(rng.uniform(0.05, 0.08))
    places = _laid(reach, level, look.uneven * BEAD, rng)
    eye = float(rng.uniform(0.03, 0.08))

    def project(points: Array) -> tuple[Array, Array]:
        depth = away + points[:, 1]
        return np.column_stack(
            [0.4 * size[0] + focal * points[:, 0] / depth, 0.55 * size[1] - focal * (points[:, 2] - eye) / depth]
        ), depth

    picture = wall(size[::-1], look, rng)
    table = project(np.array([[0, 0, 0.0]]))[0][0, 1]
    picture[round(table) :] = 0.75 * look.footage.ground
    at, depth = project(places)
    balls(picture, at, BEAD / 2 * focal / depth, -2 * depth / BEAD, rng.uniform(0.9, 1.1, len(at)), look.footage.bead)
    for x, light in ((CYLINDER / 2, 0.4), (CYLINDER / 2 + 0.0025, 0.7)):
        for side in (-1, 1):
            ends = project(np.array([[side * x, 0, 0.0], [side * x, 0, level + 0.03]]))[0]
            cv2.line(
                picture,
                *(tuple(np.rint(end).astype(int).tolist()) for end in ends),
                (light * look.footage.ground,) * 3,
                2,
                cv2.LINE_AA,
            )
    foot, middle, top = project(np.array([[0, 0, 0], [0, 0, level], [0, 0, level + 0.03]]))[0]
    if look.streaks:
        _reflected(picture, foot, top, CYLINDER / 2 * focal / away, look.streaks)
    _gauge(picture, foot, 1e-3 * focal / away)
    return taken(picture, look, (middle[0], middle[1]), BEAD * focal / away, np.zeros(2), 0, rng), _mean_top(places)


def _laid(reach: float, level: float, lean: float, rng: np.random.Generator) -> Array:
    """Centres [m] of beads laid at random, none within another, under a surface that rises by `lean` to the right."""
    places = np.empty((0, 3))
    for height in np.arange(BEAD / 2, level, 0.45 * BEAD):
        for _ in range(130):
            across = reach * math.sqrt(rng.uniform()) * np.exp(2j * math.pi * rng.uniform())
            new = np.array([across.real, across.imag, height + rng.uniform(-0.25, 0.25) * BEAD])
            near = places[places[:, 2] > new[2] - BEAD] if len(places) else places
            surface = level - BEAD / 2 + lean * across.real / (2 * reach)
            if BEAD / 2 <= new[2] < surface and (
                len(near) == 0 or np.linalg.norm(near - new, axis=1).min() > 0.93 * BEAD
            ):
                places = np.vstack([places, new])
    return places


def _mean_top(places: Array) -> float:
    """[m], of the beads that no higher one covers."""
    upper = places[places[:, 2] > places[:, 2].max() - 6 * BEAD]
    apart = np.hypot(*(upper[:, None, :2] - upper[None, :, :2]).T)
    higher = upper[:, 2][:, None] > upper[:, 2][None, :]
    return float(np.mean(upper[~np.any((apart < 0.8 * BEAD) & higher, axis=0), 2])) + BEAD / 2


def _reflected(picture: Picture, foot: Array, top: Array, wide: float, light: float) -> None:
    """Of a cylinder between two points [px] of its axis: a window in its glass, and its bright upper rim."""
    for share, breadth in ((-0.62, 0.16), (0.45, 0.07)):
        x = foot[0] + share * wide
        part = picture[round(top[1]) : round(foot[1]), round(x - breadth * wide / 2) : round(x + breadth * wide / 2)]
        part += light
    middle, axes = (round(top[0]), round(top[1])), (round(wide), round(0.08 * wide))
    cv2.ellipse(picture, middle, axes, 0, 0, 360, (235,) * 3, 2, cv2.LINE_AA)


def _gauge(picture: Picture, zero: Array, along: float) -> None:
    """A rule whose zero lies right of a point [px], `along` [px/mm]."""
    left = round(zero[0] + 42 * along)
    cv2.rectangle(picture, (left, 0), (left + round(16 * along), round(zero[1])), (178, 175, 170), cv2.FILLED)
    for k in range(121):
        length = 9 if k % 10 == 0 else 6.5 if k % 5 == 0 else 4.5
        y, right = round((zero[1] - k * along) * FINE), round((left + length * along) * FINE)
        cv2.line(picture, (left * FINE, y), (right, y), (40, 40, 40), 1, cv2.LINE_AA, 4)


def turning(look: Look, rng: np.random.Generator) -> tuple[Iterator[Photo], float]:
    """A drum whose bed turns with it and is cut off at a straight surface; its angle [deg]."""
    angle = float(rng.uniform(22, 38))
    return _turned(angle, float(rng.choice([-1.0, 1.0])), look, rng), angle


def _turned(angle: float, rises: float, look: Look, rng: np.random.Generator) -> Iterator[Photo]:
    size, centre, radius, bead = (400, 372), np.array([200.0, 172.0]), 140.0, 5.6  # [px], the bead's radius
    side = np.arange(-radius, radius, 1.95 * bead)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    grid = grid + rng.uniform(-0.5, 0.5, grid.shape) * bead
    grid = grid[np.hypot(*grid.T) < radius - bead]
    tone, behind = rng.uniform(0.8, 1.1, len(grid)), wall(size[::-1], look, rng)
    below, slope = float(rng.uniform(0.1, 0.35)) * radius, rises * math.tan(math.radians(angle))
    fill(behind, np.array([[0, 334], [size[0], 334], [size[0], size[1]], [0, size[1]]]), 0.55 * look.footage.ground)
    for reach, light in ((radius + 14, 0.45), (radius, 0.9)):
        place = tuple(np.rint(centre * FINE).astype(int).tolist())
        cv2.circle(behind, place, round(reach * FINE), (light * look.footage.ground,) * 3, -1, cv2.LINE_AA, 4)
    moved = sway(FRAMES, look.footage.shake, rng)
    for k in range(FRAMES):
        turn = rises * 0.03 * k
        x = grid[:, 0] * math.cos(turn) - grid[:, 1] * math.sin(turn)
        y = grid[:, 0] * math.sin(turn) + grid[:, 1] * math.cos(turn)
        under = y < slope * x - below
        picture = behind.copy()
        at = centre + np.column_stack([x, -y])[under]
        balls(picture, at, np.full(len(at), bead), np.zeros(len(at)), tone[under], look.footage.bead)
        yield taken(picture, look, (centre[0], centre[1] + below), 2 * bead, moved[k], k, rng)


def emptying(look: Look, rng: np.random.Generator) -> tuple[Iterator[Photo], float, float]:
    """A hopper of which a bed sinks through the slot; when it opens, and the last bead is a radius below it [s]."""
    rate, opened = look.footage.rate, float(rng.uniform(0.06, 0.1))
    places = []
    for k, row in enumerate(np.arange(BEAD / 2, HOPPER_BED, 0.9 * BEAD)):
        half = min(SLOT / 2 + row / math.tan(math.radians(60)), BIN / 2) - BEAD / 2
        places += [(x, row + rng.uniform(-4e-4, 4e-4)) for x in np.arange(-half + 0.5 * BEAD * (k % 2), half, BEAD)]
    beads = np.array(places)
    leaves = opened + 0.012 + (beads[:, 1] - BEAD / 2) / float(rng.uniform(0.08, 0.15))
    last = float((leaves + math.sqrt(2 * BEAD / 9.81)).max())
    return _emptied(beads, leaves, (opened, last + 20 / rate), look, rng), opened, last


def _emptied(
    beads: Array, leaves: Array, times: tuple[float, float], look: Look, rng: np.random.Generator
) -> Iterator[Photo]:
    (opened, ends), size, axis, slot, floor, per = times, (260, 400), 130.0, 230.0, 382.0, 2100.0  # [px], [px/m]
    behind, tone = wall(size[::-1], look, rng), rng.uniform(0.85, 1.05, len(beads))
    fill(behind, np.array([[0, floor], [size[0], floor], [size[0], size[1]], [0, size[1]]]), 0.6 * look.footage.ground)
    high = (BIN - SLOT) / 2 * math.tan(math.radians(60))
    count = round(ends * look.footage.rate)
    moved = sway(count, look.footage.shake, rng)
    sinking = float(np.ptp(beads[:, 1]) / np.ptp(leaves))
    for k in range(count):
        now = (k + 0.5 * look.footage.exposure) / look.footage.rate
        falls = now - leaves
        z = np.where(
            falls < 0, beads[:, 1] - sinking * max(now - opened - 0.012, 0), BEAD / 2 - 4.905 * falls * np.abs(falls)
        )
        narrow = SLOT / 2 + np.maximum(z, 0) / math.tan(math.radians(60)) - BEAD / 2
        at = np.column_stack([axis + np.clip(beads[:, 0], -narrow, narrow) * per, slot - z * per])
        picture, seen = behind.copy(), at[:, 1] < floor - BEAD * per / 2
        balls(
            picture, at[seen], np.full(seen.sum(), BEAD / 2 * per), np.zeros(seen.sum()), tone[seen], look.footage.bead
        )
        for side in (-1, 1):
            path = [(SLOT / 2, 0), (BIN / 2, high), (BIN / 2, 0.1)]
            bent = np.array([[axis + side * x * per, slot - up * per] for x, up in path])
            cv2.polylines(picture, [np.rint(bent).astype(np.int32)], False, (0.65 * look.footage.ground,) * 3, 4)
        edge = axis + (-SLOT / 2 + max(now - opened, -0.008) * SLIDE) * per
        fill(picture, np.array([[edge, slot + 2], [500, slot + 2], [500, slot + 6], [edge, slot + 6]]), 90)
        yield taken(picture, look, (axis, slot), BEAD * per, moved[k], k, rng)
