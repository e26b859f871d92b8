"""Draw the four rigs that `render.py` has not: tilting plate, packed cylinder, drum, slot hopper; with their truth.

``python sample_media/renderer/draw_seven.py`` makes ``seven_rigs/`` again (seconds; seeded).  Plain drawings in
flat light, with sensor noise and compression: enough to be measured, and small.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.sample_media.renderer.footage import write_clip

Picture = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]

HERE = Path(__file__).resolve().parents[1] / "seven_rigs"
GRAVITY = 9.81  # [m/s^2]
BEAD = 6.2  # [mm]
WOOD = (150, 190, 222)  # BGR
FINE = 16  # parts of a pixel in which OpenCV draws


def main() -> None:
    """Write the media and truth.json."""
    HERE.mkdir(exist_ok=True)
    truth = {}
    for name, film, rate in (("tilt", tilt, TILT_RATE), ("drum", drum, DRUM_RATE), ("hopper", hopper, HOPPER_RATE)):
        frames, truth[name] = film()
        write_clip(HERE / f"{name}.mp4", (np.ascontiguousarray(frame[..., ::-1]) for frame in frames), rate, crf=18)
    photo, truth["packing"] = packing()
    cv2.imwrite(str(HERE / "packing.jpg"), photo, [cv2.IMWRITE_JPEG_QUALITY, 92])
    (HERE / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def ball(picture: Picture, centre: tuple[float, float], radius: float, tone: float) -> None:
    """A bead in flat light, brighter in its middle; all in pixels."""
    for share in (1.0, 0.85, 0.7, 0.5, 0.3):
        colour = [float(np.clip(c * tone * (1 - 0.45 * share**2), 0, 255)) for c in WOOD]
        place = (round(centre[0] * FINE), round(centre[1] * FINE))
        cv2.circle(picture, place, round(radius * share * FINE), colour, cv2.FILLED, cv2.LINE_AA, 4)


def noisy(picture: Picture, random: np.random.Generator, sigma: float = 2.0) -> Picture:
    """With the sensor's noise."""
    return np.clip(picture + sigma * random.standard_normal(picture.shape), 0, 255).astype(np.uint8)


# ---------------------------------------------------------------------- tilt: a block of glued beads slides

TILT_RATE = 100  # [1/s]
TILT_SPEED = 2.0  # [deg/s]
TILT_ONSET = (20.4, 0.9)  # [deg], [s]; steel under ash: mu_s = 0.372
KINETIC = 0.85  # of the static friction, once it slides
TILT_SCALE = 0.5  # [mm/px]


def tilt() -> tuple[Iterator[Picture], dict[str, float]]:
    """A plate that rises steadily; the block lets go at the onset and slides down."""
    angle, onset = TILT_ONSET
    time = np.arange(150) / TILT_RATE
    fine = np.arange(0, time[-1] + 1e-4, 1e-4)
    alpha = np.radians(angle + TILT_SPEED * (fine - onset))
    push = GRAVITY * (np.sin(alpha) - KINETIC * math.tan(math.radians(angle)) * np.cos(alpha))
    way = np.cumsum(np.cumsum(np.where(fine > onset, push, 0.0)) * 1e-4) * 1e-4
    down = np.minimum(np.interp(time, fine, way), 0.09)
    truth = {"onset_angle_deg": angle, "onset_time_s": onset, "static_friction": math.tan(math.radians(angle))}
    return (_tilted(np.radians(angle + TILT_SPEED * (t - onset)), 1e3 * d) for t, d in zip(time, down, strict=True)), {
        **truth,
        "plate_speed_deg_s": TILT_SPEED,
    }


def _tilted(alpha: float, down: float) -> Picture:
    zoom, size, hinge = 2, (420, 280), (60.0, 210.0)
    picture = np.full((size[1] * zoom, size[0] * zoom, 3), (168, 172, 170), np.uint8)

    def at(x: float, y: float, turn: float) -> npt.NDArray[np.int64]:
        """From millimetres about the hinge, y up, to sixteenths of a pixel."""
        cosine, sine = math.cos(turn), math.sin(turn)
        place = np.array([x * cosine - y * sine, -x * sine - y * cosine]) / TILT_SCALE + hinge
        return np.round(place * zoom * FINE).astype(np.int64)

    def bar(left: float, right: float, low: float, high: float, turn: float, grey: int) -> None:
        corners = np.array([at(*p, turn) for p in ((left, low), (right, low), (right, high), (left, high))])
        cv2.fillPoly(picture, [corners.astype(np.int32)], (grey, grey, grey), cv2.LINE_AA, 4)

    bar(-200, 350, -33, -24, 0.0, 205)
    bar(-200, 350, -60, -33, 0.0, 90)
    bar(-10, 150, -4, 4, alpha, 125)
    bar(-10, 150, -4, -1, alpha, 45)
    bar(0, 6, -25, -4, 0.0, 150)
    for k in range(3):
        centre = at(112 - down + BEAD * k, 4 + BEAD / 2, alpha) / FINE
        ball(picture, (centre[0], centre[1]), BEAD / 2 / TILT_SCALE * zoom, 1.0 - 0.12 * k)
    shown = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return noisy(shown, np.random.default_rng(round(1e6 * alpha)))


# ---------------------------------------------------------------------- packing: a cylinder with a gauge beside it

CYLINDER = 50.0  # [mm], inside
PACKING_PX = 6.0  # [px/mm]
BED = 60.0  # [mm], to which rows of beads are drawn


def packing() -> tuple[Picture, dict[str, float]]:
    """Beads in two depths behind glass; the truth is the mean outline inside the cylinder."""
    random = np.random.default_rng(2)
    zoom, width, height, axis, floor = 2, 560, 620, 200.0, 540.0
    picture = np.full((height * zoom, width * zoom, 3), (205, 200, 192), np.uint8)
    cv2.rectangle(picture, (0, round(floor * zoom)), (width * zoom, height * zoom), (150, 152, 150), cv2.FILLED)
    mm, reach, beads = PACKING_PX * zoom, (CYLINDER - BEAD) / 2, []
    for depth in (0, 1):
        for k, row in enumerate(np.arange(BEAD / 2, BED - 2, 0.76 * BEAD)):
            for x in np.arange(-reach + 0.45 * BEAD * ((k + depth) % 2), reach + 0.1, 0.9 * BEAD):
                place = np.array(
                    [np.clip(x + random.uniform(-0.4, 0.4), -reach, reach), row + random.uniform(-0.7, 0.7)]
                )
                beads.append(place)
                centre = (axis * zoom + place[0] * mm, floor * zoom - place[1] * mm)
                ball(picture, centre, BEAD / 2 * mm, random.uniform(0.8, 1.05) * (0.75 + 0.25 * depth))
    for side in (-1, 1):
        for place, tone in ((CYLINDER / 2, 60), (CYLINDER / 2 + 2.5, 120)):
            x = round(axis * zoom + side * place * mm)
            cv2.line(picture, (x, round(floor * zoom - 85 * mm)), (x, round(floor * zoom)), (tone, tone, tone), zoom)
    left = round(axis * zoom + 38 * mm)
    cv2.rectangle(picture, (left, 0), (left + round(18 * mm), round(floor * zoom)), (170, 175, 178), cv2.FILLED)
    for k in range(89):
        length = 9 if k % 10 == 0 else 6.5 if k % 5 == 0 else 4.5
        y, right = round((floor * zoom - k * mm) * FINE), round((left + length * mm) * FINE)
        cv2.line(picture, (left * FINE, y), (right, y), (40, 40, 40), zoom, cv2.LINE_AA, 4)
    x = np.linspace(-0.475 * CYLINDER, 0.475 * CYLINDER, 801)
    centres = np.array(beads)
    inside = (BEAD / 2) ** 2 - (x - centres[:, :1]) ** 2
    outline = np.where(inside > 0, centres[:, 1:] + np.sqrt(np.maximum(inside, 0)), 0).max(axis=0)
    shown = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return noisy(shown, random, 2.5), {"mean_outline_mm": float(outline.mean()), "scale_mm_per_px": 1 / PACKING_PX}


# ---------------------------------------------------------------------- drum: beads turn with it and flow off on top

DRUM_RATE = 30  # [1/s]
DRUM_DIAMETER = 100.0  # [mm]
DRUM_ANGLE = 34.0  # [deg]
DRUM_PX = 1.8  # [px/mm]
DRUM_SPEED = 6.0  # [rpm]
DRUM_BELOW = 0.2  # of the radius, from the axis to the surface


def drum() -> tuple[Iterator[Picture], dict[str, float]]:
    """The bed's surface is straight, but for the beads that it is made of."""
    return _turning(), {"surface_angle_deg": DRUM_ANGLE, "speed_rpm": DRUM_SPEED}


def _turning() -> Iterator[Picture]:
    random = np.random.default_rng(11)
    size, centre, radius, bead = (280, 264), (140.0, 122.0), DRUM_DIAMETER / 2 * DRUM_PX, BEAD / 2 * DRUM_PX
    side = np.arange(-radius, radius, 1.95 * bead)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    grid += random.uniform(-0.5, 0.5, grid.shape) * bead
    grid = grid[np.hypot(*grid.T) < radius - bead]
    tones, slope = random.uniform(0.7, 1.0, len(grid)), math.tan(math.radians(DRUM_ANGLE))
    for k in range(60):
        picture = np.full((size[1], size[0], 3), 225, np.uint8)
        cv2.rectangle(picture, (0, 236), size, (120, 120, 120), cv2.FILLED)
        middle = (round(centre[0]), round(centre[1]))
        cv2.circle(picture, middle, round(radius + 11), (90, 90, 95), cv2.FILLED, cv2.LINE_AA)
        cv2.circle(picture, middle, round(radius), (96, 90, 86), cv2.FILLED, cv2.LINE_AA)
        turn = DRUM_SPEED * 2 * math.pi / 60 * k / DRUM_RATE  # anticlockwise: the surface rises to the right
        x = grid[:, 0] * math.cos(turn) - grid[:, 1] * math.sin(turn)
        y = grid[:, 0] * math.sin(turn) + grid[:, 1] * math.cos(turn)
        for px, py, tone in zip(x, y, tones, strict=True):
            if py < slope * px - DRUM_BELOW * radius:
                ball(picture, (centre[0] + px, centre[1] - py), bead, tone)
        yield noisy(picture, random)


# ---------------------------------------------------------------------- hopper: a bed sinks through a slot

HOPPER_RATE = 120  # [1/s]
HOPPER_PX = 2.0  # [px/mm]
SLOT, BIN = 25.0, 60.0  # [mm]
OPENED = 8.3  # [frames]
FLOW = 60.0  # [mm/s], how fast the bed sinks
HOPPER_BED = 50.0  # [mm]


def hopper() -> tuple[Iterator[Picture], dict[str, float]]:
    """Rows of beads go down to the slot one after the other and fall; the last one's upper edge ends the discharge."""
    random = np.random.default_rng(5)
    places = []
    for k, row in enumerate(np.arange(BEAD / 2, HOPPER_BED, 0.9 * BEAD)):
        half = min(SLOT / 2 + row / math.tan(math.radians(60)), BIN / 2) - BEAD / 2
        shift = 0.5 * BEAD * (k % 2)
        places += [(x, row + random.uniform(-0.4, 0.4)) for x in np.arange(-half + shift, half + 0.01, BEAD)]
    beads = np.array(places)
    leaves = (OPENED + 1.5) / HOPPER_RATE + (beads[:, 1] - BEAD / 2) / FLOW  # [s], when it begins to fall free
    # upper edge at the slot: the centre is a radius below it
    last = float((leaves + math.sqrt(2 * BEAD * 1e-3 / GRAVITY)).max())
    truth = {"opening_time_s": OPENED / HOPPER_RATE, "last_particle_time_s": last, "beads_drawn": len(beads)}
    return _emptying(beads, leaves, last), {**truth, "discharge_time_s": last - OPENED / HOPPER_RATE}


def _emptying(beads: Floats, leaves: Floats, last: float) -> Iterator[Picture]:
    random = np.random.default_rng(6)
    size, axis, slot, floor = (240, 330), 120.0, 190.0, 312
    tones = random.uniform(0.75, 1.0, len(beads))
    for k in range(math.ceil(last * HOPPER_RATE) + 20):
        picture = np.full((size[1], size[0], 3), (96, 92, 90), np.uint8)
        cv2.rectangle(picture, (0, floor), size, (140, 120, 110), cv2.FILLED)
        now = k / HOPPER_RATE
        for (x, row), when, tone in zip(beads, leaves, tones, strict=True):
            sunk = FLOW * max(now - (OPENED + 1.5) / HOPPER_RATE, 0.0)
            z = row - sunk if now < when else BEAD / 2 - 500 * GRAVITY * (now - when) ** 2
            narrow = SLOT / 2 + max(z, 0.0) / math.tan(math.radians(60)) - BEAD / 2
            across = max(-narrow, min(narrow, x))
            y = min(slot - z * HOPPER_PX, floor - BEAD / 2 * HOPPER_PX)
            if y < floor - BEAD * HOPPER_PX:
                ball(picture, (axis + across * HOPPER_PX, y), BEAD / 2 * HOPPER_PX, tone)
        wide, high = BIN / 2 * HOPPER_PX, (BIN - SLOT) / 2 * math.tan(math.radians(60)) * HOPPER_PX
        for side in (-1, 1):
            path = [
                (axis + side * SLOT / 2 * HOPPER_PX, slot),
                (axis + side * wide, slot - high),
                (axis + side * wide, 20),
            ]
            cv2.polylines(picture, [np.array(path, np.int32)], False, (175, 178, 180), 4, cv2.LINE_AA)
        edge = axis - SLOT / 2 * HOPPER_PX + 9.0 * (k - OPENED) if k > OPENED - 2 else axis - SLOT / 2 * HOPPER_PX - 18
        cv2.rectangle(
            picture,
            (round(FINE * edge), round(FINE * (slot + 2))),
            (FINE * 500, round(FINE * (slot + 6))),
            (205, 208, 210),
            cv2.FILLED,
            cv2.LINE_AA,
            4,
        )
        yield noisy(picture, random)


if __name__ == "__main__":
    main()
