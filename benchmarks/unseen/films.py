"""Films of drops, tilting plates and double pendulums for `unseen.py`, drawn by VTK from closed forms.

    python benchmarks/unseen/films.py FOLDER --seed 7 --count 60

Each folder has `clip.mp4`, `given.json` (what its user states) and `truth.json`.  Folders that are there already are
kept, so that an interrupted run goes on.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import textures
from scipy.integrate import solve_ivp
from stage import GAMMA, Camera, Floats, Stage

GRAVITY = 9.81
MOST_EXPOSURES = 5  # pictures that are averaged over the time in which the shutter is open


@dataclass
class Film:
    """A stage, what moves it to a time [s], and what is known."""

    stage: Stage
    move: Callable[[float], None]
    fastest: float  # [m/s]
    rate: float  # [Hz]
    frames: int
    given: dict[str, Any]
    truth: dict[str, Any]


def camera(rng: np.random.Generator, size: tuple[int, int], width: float, middle: tuple[float, float]) -> Camera:
    """A nearly level camera that sees `width` [m] of the plane y = 0 around `middle` (x, z)."""
    focal = max(size) * rng.uniform(1.2, 3.5)
    distance = width * focal / size[0]
    sideways, above = np.radians(rng.normal(0, 0.7)), np.radians(rng.uniform(-1, 3))
    target = np.array([middle[0], 0.0, middle[1]])
    place = target + distance * np.array([math.sin(sideways), -math.cos(sideways) * math.cos(above), math.sin(above)])
    return Camera(size, place, target, float(rng.normal(0, 1.0)) if rng.random() < 0.6 else 0.0, focal)


def upright_ruler(stage: Stage, x: float, y: float, low: float, length: float) -> None:
    wide = length * stage.rng.uniform(0.08, 0.14)
    marks = np.rot90(textures.ruler(stage.rng, length / wide))
    stage.picture((x, y, low), (wide, 0, 0), (0, 0, length), np.clip(marks, 0, 1))


def drop(rng: np.random.Generator) -> Film:
    """A bead falls on a plate and bounces."""
    diameter, restitution = math.exp(rng.uniform(math.log(0.003), math.log(0.012))), rng.uniform(0.3, 0.95)
    height = min(rng.uniform(0.06, 0.3), 28 * diameter)
    radius = diameter / 2
    size = (432, 768) if rng.random() < 0.6 else (540, 540)
    tall = 1.25 * height + 4 * diameter
    stage = Stage(rng, camera(rng, size, tall * size[0] / size[1], (0.0, 0.42 * tall)))
    fall = math.sqrt(2 * height / GRAVITY)
    impact, start = GRAVITY * fall, rng.uniform(0.03, 0.15)
    hits, speeds = [start + fall], [impact]
    while len(hits) < 6:
        speeds.append(speeds[-1] * restitution)
        hits.append(hits[-1] + 2 * speeds[-1] / GRAVITY)
    rate = float(rng.choice([120, 240, 240, 500]))
    end = hits[int(rng.integers(1, 3))] + 0.3 * speeds[1] / GRAVITY
    frames = min(int(end * rate), 420)
    sideways = np.concatenate([rng.normal(0, 0.004, (1, 2)), rng.normal(0, 0.02, (6, 2))])  # [m/s], of each flight

    stage.box((-0.06, -0.05, -0.012), (0.06, 0.06, 0.0))
    stage.room(rng.uniform(0.1, 0.6), -0.012 if rng.random() < 0.7 else -0.06, tall)
    if rng.random() < 0.7:
        upright_ruler(
            stage, rng.choice([-1, 1]) * rng.uniform(2, 4) * diameter, rng.uniform(0.005, 0.03), 0.0, 1.1 * height
        )
    stage.rod((0, 0, height + diameter), (0, 0, height + 5 * diameter), 0.3 * diameter)
    bead = stage.ball(radius)

    def move(time: float) -> None:
        place = np.array([0.0, 0.0])
        if time <= start:
            z = height
        else:
            time = min(time, hits[-1])  # then it lies on the plate
            flight = int(np.searchsorted(hits, time))
            since = time - (start if flight == 0 else hits[flight - 1])
            z = height - GRAVITY * since**2 / 2 if flight == 0 else speeds[flight] * since - GRAVITY * since**2 / 2
            for k in range(flight):
                place = place + sideways[k] * (hits[k] - (start if k == 0 else hits[k - 1]))
            place = place + sideways[flight] * since
        bead.SetPosition(place[0], place[1], z + radius)

    given = {"kind": "drop", "capture_fps": rate, "bead_diameter_mm": 1e3 * diameter}
    truth = {"cor_contact": [restitution] * 2, "h1_m": height, "bead_diameter_m": diameter}
    return Film(stage, move, impact, rate, frames, given, truth)


def tilt(rng: np.random.Generator) -> Film:
    """A bead rolls or three beads in one piece slide down an arm that is lifted."""
    rolls = bool(rng.random() < 0.5)
    diameter, length = rng.uniform(0.006, 0.016), rng.uniform(0.12, 0.22)
    radius = diameter / 2
    onset = rng.uniform(1.2, 5.0) if rolls else rng.uniform(9.0, 28.0)
    speed, rate = rng.uniform(0.5, 2.5 if rolls else 4.0), float(rng.choice([30, 30, 60]))
    first = max(onset - speed * rng.uniform(1.2, 3.0), 0.0)
    waits = rng.uniform(0.2, 0.6)
    begins = waits + (onset - first) / speed
    place = length * rng.uniform(0.5, 0.85)
    kept = math.tan(math.radians(onset)) * (1.0 if rolls else rng.uniform(0.8, 0.97))
    inertia = 5 / 7 if rolls else 1.0

    def angle(time: float) -> float:
        return math.radians(first + speed * max(time - waits, 0.0))

    steps = np.arange(0.0, 1.5, 1e-3)
    pull = [inertia * GRAVITY * (math.sin(angle(begins + t)) - kept * math.cos(angle(begins + t))) for t in steps]
    run = np.cumsum(np.cumsum(np.maximum(pull, 0.0)) * 1e-3) * 1e-3
    gone = float(steps[min(int(np.searchsorted(run, place - 2.5 * diameter)), len(steps) - 1)])
    frames = int((begins + gone) * rate)
    side = rng.choice([-1, 1])  # the hinge is on the left (1) or the right (-1)

    size = (720, 480)
    rise = length * math.sin(angle(begins + gone))
    stage = Stage(rng, camera(rng, size, 1.5 * max(length, rise), (side * 0.5 * length, 0.4 * rise)))
    thick, deep = rng.uniform(0.005, 0.012), rng.uniform(0.015, 0.03)
    level = -rng.uniform(0.02, 0.05)
    low, high = sorted((-0.15 * side * length, 1.15 * side * length))
    stage.box((low, -1.3 * deep, level - 0.01), (high, 1.3 * deep, level))
    stage.box((-0.02, -0.8 * deep, level), (0.02, 0.8 * deep, 0.0))
    stage.room(rng.uniform(0.15, 0.6), level - 0.01, length)
    ends = sorted((-0.01 * side, side * length))
    arm = stage.box((ends[0], -deep, -thick), (ends[1], deep, 0.0), moving=True)
    pin = stage.rod((0, -1.3 * deep, -thick / 2), (0, -0.5 * deep, -thick / 2), 0.35 * thick, moving=True)
    tint = textures.colour(rng)
    beads = [stage.ball(radius, tint=tint) for _ in range(1 if rolls else 3)]
    third = math.sqrt(3) / 2 * diameter
    offsets = [(0.0, 0.0)] if rolls else [(-radius, -third / 3), (radius, -third / 3), (0.0, 2 * third / 3)]

    def move(time: float) -> None:
        turn = angle(time)
        along = place - float(np.interp(time - begins, steps, run)) if time > begins else place
        for part in (arm, pin):
            part.SetOrientation(0, -side * math.degrees(turn), 0)
        for bead, (ahead, behind) in zip(beads, offsets, strict=True):
            x = (along + ahead) * math.cos(turn) - radius * math.sin(turn)
            bead.SetPosition(side * x, behind, (along + ahead) * math.sin(turn) + radius * math.cos(turn))

    given = {"kind": "tilt", "capture_fps": rate, "bead_diameter_mm": 1e3 * diameter}
    given["test"] = "rolling (bead)" if rolls else "static (clump slips)"
    seen, turn = stage.camera, angle(0.0)
    x, z = (place * math.cos(turn) - radius * math.sin(turn), place * math.sin(turn) + radius * math.cos(turn))
    truth = {
        "alpha_onset_deg": onset,
        "bead_diameter_m": diameter,
        "rows": [[0, side * first, 0.0, *seen.pixel((side * x, 0.0, z)).tolist()]],  # frame, angle [deg], -, place [px]
        "hinge_px": seen.pixel((0.0, 0.0, 0.0)).tolist(),
        "m_per_px_bead_plane": float(np.linalg.norm(seen.place)) / seen.focal,
    }
    return Film(stage, move, 0.3, rate, frames, given, truth)


def pendulum(rng: np.random.Generator) -> Film:
    """A bead on two threads swings against another one."""
    diameter, length = rng.uniform(0.008, 0.016), rng.uniform(0.12, 0.25)
    restitution, release = rng.uniform(0.4, 0.97), math.radians(rng.uniform(14, 40))
    radius, start, rate = diameter / 2, rng.uniform(0.03, 0.12), float(rng.choice([240, 240, 500]))

    def swing(_: float, state: Floats) -> Floats:
        return np.array(
            [state[1], -GRAVITY / length * math.sin(state[0]), state[3], -GRAVITY / length * math.sin(state[2])]
        )

    def gap(_: float, state: Floats) -> float:
        apart = np.array(
            [
                diameter + length * (math.sin(state[2]) - math.sin(state[0])),
                length * (math.cos(state[0]) - math.cos(state[2])),
            ]
        )
        return float(np.hypot(*apart) - diameter)

    gap.terminal, gap.direction = True, -1  # type: ignore[attr-defined]
    before = solve_ivp(swing, (0, 2), [-release, 0, 0, 0], events=gap, dense_output=True, rtol=1e-9, atol=1e-11)
    hit, (a, va, b, vb) = float(before.t[-1]), before.y[:, -1]
    after_state = [a, (va + vb - restitution * (va - vb)) / 2, b, (va + vb + restitution * (va - vb)) / 2]
    period = 2 * math.pi * math.sqrt(length / GRAVITY)
    after = solve_ivp(swing, (hit, hit + 0.45 * period), after_state, dense_output=True, rtol=1e-9, atol=1e-11)
    frames = int((start + hit + 0.42 * period) * rate)

    size = (720, 540) if rng.random() < 0.7 else (600, 600)
    reach = length * math.sin(release) + 2 * diameter
    stage = Stage(rng, camera(rng, size, max(2.6 * reach, 1.35 * length * size[0] / size[1]), (0.0, -0.48 * length)))
    spread = rng.uniform(0.2, 0.4) * length
    for y in (-spread, spread):
        stage.box((-0.6 * reach, y - 0.005, 0.0), (0.6 * reach, y + 0.005, 0.012))
    post = rng.choice([-1, 1]) * 0.6 * reach
    stage.rod((post, 1.2 * spread, -1.5 * length), (post, 1.2 * spread, 0.012), 0.006)
    stage.room(rng.uniform(0.3, 0.8), -1.35 * length, 1.3 * length)
    tint, thread = textures.colour(rng), textures.colour(rng)
    beads = [stage.ball(radius, tint=tint) for _ in range(2)]
    fine = rng.uniform(0.00007, 0.00015)
    threads = [[stage.rod((0, 0, 0), (0, 0, 1), fine, moving=True, tint=thread) for _ in range(2)] for _ in range(2)]

    def move(time: float) -> None:
        since = max(time - start, 0.0)
        state = (before if since <= hit else after).sol(since)
        for k, (pivot, phi) in enumerate(((-radius, state[0]), (radius, state[2]))):
            centre = np.array([pivot + length * math.sin(phi), 0.0, -length * math.cos(phi)])
            beads[k].SetPosition(*centre)
            for cord, y in zip(threads[k], (-spread, spread), strict=True):
                cord.line.SetPoint1(*centre)
                cord.line.SetPoint2(pivot, y, 0.0)

    given = {"kind": "pendulum", "capture_fps": rate, "bead_diameter_mm": 1e3 * diameter}
    given |= {"pendulum_length_mm": 1e3 * length, "wall_material": None}
    truth = {"e": restitution, "bead_diameter_m": diameter, "alpha_A1_deg": math.degrees(release)}
    extreme = after.sol(np.linspace(hit, after.t[-1], 4001))
    truth |= {"alpha_A2_deg": math.degrees(extreme[0].max()), "alpha_B2_deg": math.degrees(extreme[2].max())}
    return Film(stage, move, math.sqrt(GRAVITY * length) * release, rate, frames, given, truth)


KINDS = {"drop": drop, "tilt": tilt, "pendulum": pendulum}


def shoot(film: Film, rng: np.random.Generator, path: Path) -> None:
    """Write the film, with motion blur, noise and compression."""
    shutter = rng.uniform(0.05, 0.9) / film.rate
    still = film.stage.behind(rng.uniform(0, 2.5))
    across = film.stage.camera.focal / float(np.linalg.norm(film.stage.camera.place))  # [px/m]
    exposures = int(np.clip(math.ceil(film.fastest * shutter * across / 1.5), 1, MOST_EXPOSURES))
    bright = rng.uniform(0.5, 0.95) / max(float(np.percentile(still, 98)), 0.05)
    noise = rng.uniform(0, 0.012)
    wide, tall = film.stage.camera.size
    with av.open(str(path), "w") as box:
        stream = box.add_stream("libx264", rate=Fraction(film.rate).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = wide, tall, "yuv420p"
        stream.options = {"crf": str(int(rng.integers(16, 27))), "preset": "veryfast"}
        for number in range(film.frames):
            light = np.zeros_like(still)
            for part in range(exposures):
                film.move(number / film.rate + ((part + 0.5) / exposures - 0.5) * shutter)
                seen = film.stage.before()
                light += (still * (1 - seen[..., 3:]) + seen[..., :3]) / exposures
            light = cv2.pow(np.clip(bright * light, 0, 1), 1 / GAMMA)
            light = light + noise * rng.standard_normal(light.shape, dtype=np.float32)
            picture = av.VideoFrame.from_ndarray(np.clip(255 * light, 0, 255).astype(np.uint8), format="rgb24")
            box.mux(stream.encode(picture))
        box.mux(stream.encode())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--only", nargs="*", choices=sorted(KINDS), default=sorted(KINDS))
    asked = parser.parse_args()
    for number in range(asked.count):
        kind = list(KINDS)[number % len(KINDS)]
        folder = asked.folder / f"{kind}_{asked.seed}_{number:03d}"
        if kind not in asked.only or (folder / "truth.json").exists():
            continue
        rng = np.random.default_rng([asked.seed, number])
        film = KINDS[kind](rng)
        folder.mkdir(parents=True, exist_ok=True)
        shoot(film, rng, folder / "clip.mp4")
        (folder / "given.json").write_text(json.dumps(film.given | {"file": "clip.mp4"}, indent=1))
        truth = film.truth | {"camera_roll_deg": film.stage.camera.roll}
        (folder / "truth.json").write_text(json.dumps(truth, indent=1))  # last: a folder with it is complete
        print(folder.name, film.frames, "frames", flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
