"""Diagnosis of real data: public tracks with a known effect, as docs/diagnosis.md describes.

    python benchmarks/diagnose/real_tracks.py FOLDER OUT

FOLDER holds the data sets as they were published: falling_balls/*.csv with balls.txt, pingpong_drop/*.txt and
cube_toss/*.csv.  Each is written as a lab into OUT, with what was assumed of it, and diagnosed there.  Clips or tosses
of one body are repetitions of one setting.  With `SMOKE=1` files like these are made up, and no folder is named.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import OUT, SMOKE, Row, report
from rigtwin.compare.diagnose.diagnose_folder import diagnose_folder
from rigtwin.lab.errors import BadInput

Array = npt.NDArray[np.float64]
Lab = tuple[dict[str, Any], dict[str, Array]]  # lab.json, and by file name the rows: time [s], x [m], y [m]

OUNCE, GRAVITY = 28.3495, 9.81  # [g] and [m/s^2]
BALLS = {  # files of the drops, and what balls.txt calls the ball
    "baseball": "baseball", "blue_basketball": "bluebasketball", "bowling_ball": "bowlingball", "golf_ball": "golfball",
    "tennis_ball": "tennisball", "whiffle_ball_1": "wiffleball1", "yellow_whiffle_ball": "yellowWiffle",
}  # fmt: skip
FILMED, PIXEL = 120.0, 1.08e-3  # [1/s] and [m], of the ping-pong clips; from g and the height of the fall
PINGPONG = {"diameter_m": 0.04, "mass_g": 2.7}
BESIDE = 25  # frames before and after an impact that a parabola is laid through, those of the contact apart
HALF_WIDTH, POSES = 0.0524, 148.0  # [m] of the cube, and poses a second


def balls(folder: Path) -> Lab:
    """Balls dropped from a bridge, two drops each; the ground is not in the picture, nor how far they go sideways."""
    kinds = {line.split()[0]: line.split()[1:] for line in (folder / "falling_balls" / "balls.txt").open()}
    particles, conditions, rows = {}, [], {}
    for file in sorted((folder / "falling_balls").glob("*.csv")):
        name = file.stem
        ounces, circumference = map(float, kinds[BALLS[name]])
        particles[name] = {"diameter_m": circumference / 100 / math.pi, "mass_g": ounces * OUNCE}
        drop, time, height = np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1, 2)).T
        drops = [drop == number for number in np.unique(drop)]
        fall = float(np.mean([height[one][0] for one in drops])) - particles[name]["diameter_m"] / 2
        conditions.append(_condition(name, fall, "ground", len(drops)))
        for number, one in enumerate(drops, start=1):
            rows[f"{name}/rep{number:02d}.csv"] = np.column_stack([time[one], 0 * time[one], height[one]])
    camera = {"frame_rate_hz": 15, "tracking_noise_m": 0.1, "scale_uncertainty_rel": 0.02}
    return _lab("balls from a bridge", camera, particles, conditions, drop_height_uncertainty_m=1.0), rows


def floor(folder: Path) -> Lab:
    """A ping-pong ball on a floor: the plate is at the lowest row of a clip, of all clips where it stays in the air."""
    clips = _clips(folder, "floor")
    lowest = max(rows.max() for _, rows in clips.values())
    plates = {name: rows.max() if rows.argmax() < len(rows) - 1 else lowest for name, (_, rows) in clips.items()}
    return _pingpong("ping-pong ball on a floor", clips, plates)


def table(folder: Path) -> Lab:
    """The same ball on a table: the plate is where the parabolas before and after the first impact meet."""
    clips = _clips(folder, "table")
    return _pingpong("ping-pong ball on a table", clips, {name: _meeting(rows) for name, (_, rows) in clips.items()})


def cube(folder: Path) -> Lab:
    """A cube tossed on a board, its centre read as a bead's; the height is that of the top of its path."""
    tops, tracks = [], {}
    for number, file in enumerate(sorted((folder / "cube_toss").glob("*.csv")), start=1):
        x, y, rising = HALF_WIDTH * np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 2, 9)).T
        tops.append(y[0] + max(rising[0], 0.0) ** 2 / (2 * GRAVITY))
        tracks[f"cube/rep{number:02d}.csv"] = np.column_stack([np.arange(len(x)) / POSES, x, y])
    particles = {"cube": {"diameter_m": 2 * HALF_WIDTH, "mass_g": 370}}
    setting = _condition("cube", float(np.mean(tops)) - HALF_WIDTH, "board", len(tracks))
    return _lab(
        "tosses of a cube", {"frame_rate_hz": POSES}, particles, [setting], release_sideways_speed_m_s=1.5
    ), tracks


def _clips(folder: Path, kind: str) -> dict[str, Array]:
    """Column and row [px] of the ball in each frame, by clip."""
    files = sorted((folder / "pingpong_drop").glob(f"{kind}_*.txt"))
    return {file.stem: np.loadtxt(file, delimiter=";", usecols=(0, 1)).T for file in files}


def _meeting(rows: Array) -> float:
    """Row [px] in which the ball strikes first, between two frames."""
    hit = next(i for i in range(BESIDE, len(rows)) if rows[i] > rows.mean() and rows[i] == rows[i - 6 : i + 7].max())
    frames = np.arange(len(rows)) - hit
    parts = slice(hit - BESIDE, hit - 1), slice(hit + 2, hit + BESIDE)
    before, after = (np.polyfit(frames[part], rows[part], 2) for part in parts)
    moments = np.roots(before - after)
    return float(np.polyval(before, moments[np.abs(moments).argmin()].real))


def _pingpong(title: str, clips: dict[str, Array], plates: dict[str, float]) -> Lab:
    falls, tracks = [], {}
    for number, (name, (columns, rows)) in enumerate(clips.items(), start=1):
        height = PIXEL * (plates[name] - rows)
        falls.append(height[:10].max())
        place = np.column_stack([PIXEL * (columns - columns[0]), height + PINGPONG["diameter_m"] / 2])
        tracks[f"ball/rep{number:02d}.csv"] = np.column_stack([np.arange(len(rows)) / FILMED, place])
    setting = _condition("ball", float(np.mean(falls)), "plate", len(tracks))
    return _lab(title, {"frame_rate_hz": FILMED, "scale_uncertainty_rel": 0.02}, {"ball": PINGPONG}, [setting]), tracks


def _condition(bead: str, height: float, wall: str, repetitions: int) -> dict[str, Any]:
    return {"name": bead, "bead": bead, "wall": wall, "drop_height_m": height, "repetitions": repetitions}


def _lab(title: str, camera: Any, particles: Any, conditions: list[Any], **geometry: float) -> dict[str, Any]:
    about = {"title": title, "rig": "drop", "gravity_m_s2": GRAVITY, "camera": camera, "rig_geometry": geometry}
    return about | {"particles": particles, "conditions": conditions}


def _make_up(folder: Path) -> None:
    """Files of the published form, in which balls fall and bounce as Newton says."""
    rng, of_balls, of_clips, of_tosses = (
        np.random.default_rng(1),
        *(folder / name for name in ("falling_balls", "pingpong_drop", "cube_toss")),
    )
    for one in (of_balls, of_clips, of_tosses):
        one.mkdir(parents=True, exist_ok=True)
    (of_balls / "balls.txt").write_text("".join(f"{name} 5 23\n" for name in BALLS.values()))
    time = np.arange(30) / 15
    rows = [np.column_stack([0 * time + k, time, 40 - GRAVITY / 2 * time**2]) for k in (1, 2, 3)]
    for name in ("baseball", "golf_ball"):
        seen = np.concatenate(rows) + [0, 0, 0.1] * rng.standard_normal((90, 3))
        np.savetxt(of_balls / f"{name}.csv", seen, delimiter=",", header="drop,time,height", comments="")
    time, meets = np.arange(64) / FILMED, 34 / FILMED  # [s]; it is seen as it meets the plate
    fall = GRAVITY / 2 * meets**2
    after = time - meets
    height = np.where(after < 0, fall - GRAVITY / 2 * time**2, 0.9 * GRAVITY * meets * after - GRAVITY / 2 * after**2)
    for name in (f"{where}_{k}" for where in ("floor", "table") for k in range(5)):
        places = np.column_stack([0 * time + 200, 700 - height / PIXEL]) + 0.3 * rng.standard_normal((64, 2))
        np.savetxt(of_clips / f"{name}.txt", places, delimiter=";")
    time = np.arange(40) / POSES
    for name in range(5):
        poses = np.zeros((40, 13))
        poses[:, 0], poses[:, 2] = 1.0 * time, 0.9 - GRAVITY / 2 * time**2 + HALF_WIDTH
        poses[:, 9] = -GRAVITY * time
        poses += 1e-3 * rng.standard_normal(poses.shape)
        np.savetxt(of_tosses / f"{name}.csv", poses / HALF_WIDTH, delimiter=",", header="pose", comments="")


def main() -> int:
    """Write the labs, diagnose each, and print what was said."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("folder", type=Path, **({"nargs": "?", "default": OUT / "real-tracks"} if SMOKE else {}))
    arguments.add_argument("out", type=Path, **({"nargs": "?", "default": OUT / "real-tracks"} if SMOKE else {}))
    options = arguments.parse_args()
    if SMOKE:
        _make_up(options.folder)
    results = []
    for name, assume in {"balls": balls, "floor": floor, "table": table, "cube": cube}.items():
        lab, tracks = assume(options.folder)
        for file, rows in tracks.items():
            (path := options.out / name / file).parent.mkdir(parents=True, exist_ok=True)
            np.savetxt(path, rows, fmt="%.9g", delimiter=",", header="time_s,x_m,y_m", comments="")
        (options.out / name / "lab.json").write_text(json.dumps(lab, indent=1), encoding="utf-8")
        said = _said(options.out / name)
        sys.stdout.write(f"{lab['title']}: {said}\n")
        results.append(Row(f"{lab['title']}: tracks", len(tracks), note=said.partition("\n")[0]))
    return report("real-tracks", results)


def _said(lab: Path) -> str:
    """Verdict, reason, effects with their parameters, and the gap: squared deviation per coordinate, in noise."""
    try:
        said = diagnose_folder(lab, lab / "out")[0].to_json()
    except BadInput as refused:
        return f"refused\n  {refused}"
    effects = [f"{effect['title']}: {effect['parameters']}" for effect in said["effects"]]
    gap = ", ".join(f"{name} {said['gap'][name]:.4g}" for name in ("before", "after", "noise_floor") if said["gap"])
    return "\n  ".join([said["verdict"], said["reason"], *effects, f"gap: {gap}"])


if __name__ == "__main__":
    sys.exit(main())
