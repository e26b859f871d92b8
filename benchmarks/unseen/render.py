"""Photos of heaps and beds for `unseen.py`, rendered by path tracing: none of them was seen in development.

    python benchmarks/unseen/render.py FOLDER --seed 7 --count 40

Every other picture shows a heap or a bed.  Each folder has `photo.jpg`, `given.json` (what its user states) and
`truth.json`.  Folders that are there already are kept, so that an interrupted run goes on.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import cv2
import mitsuba as mi
import numpy as np
import pyoidn

mi.set_variant("scalar_rgb")

import rigs  # noqa: E402
import textures  # noqa: E402

WIDTH, HEIGHT = 1280, 960
KINDS = (rigs.heap, rigs.bed)


def camera(rig: rigs.Rig, rng: np.random.Generator) -> tuple[dict[str, Any], np.ndarray]:
    """Sensor, and the matrix that projects world points to pixels, shape (3, 4)."""
    width, (x, z) = rig.scene.width, rig.scene.centre
    view = rng.uniform(9, 35)
    distance = width / 2 / np.tan(np.radians(view / 2)) + 0.5
    pitch = np.radians(rng.uniform(0, 5) if rng.random() < 0.8 else rng.uniform(5, 10))
    origin = np.array([x + rng.normal(0, 0.02) * distance, -distance * np.cos(pitch), z + distance * np.sin(pitch)])
    roll = np.radians(rng.uniform(-2.5, 2.5))
    target = np.array([x, 0, z])
    place = mi.ScalarTransform4f().look_at(list(origin), list(target), [np.sin(roll), 0, np.cos(roll)])
    lens: dict[str, Any] = {"type": "perspective"}
    if rng.random() < 0.6:
        blur = float(distance * np.exp(rng.uniform(np.log(0.001), np.log(0.012))))
        lens = {"type": "thinlens", "aperture_radius": blur, "focus_distance": float(distance - rng.uniform(0.2, 0.9))}
    # the denoiser takes noise that is correlated between pixels for texture: no wider filter than a pixel
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}}
    sampler = {"type": "independent", "sample_count": 16}
    sensor = {**lens, "fov": float(view), "to_world": place, "film": film, "sampler": sampler}
    axes = np.array(place.matrix)[:3, :3]  # columns: left, up, forward
    axes = np.column_stack([-axes[:, 0], -axes[:, 1], axes[:, 2]])
    focal = WIDTH / 2 / np.tan(np.radians(view / 2))
    inner = np.array([[focal, 0, (WIDTH - 1) / 2], [0, focal, (HEIGHT - 1) / 2], [0, 0, 1]])
    return sensor, inner @ np.column_stack([axes.T, -axes.T @ origin])


def developed(linear: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """8-bit BGR picture with the exposure, noise and unsharpness of a camera."""
    level = np.percentile(linear.mean(axis=2), rng.uniform(70, 97))
    linear = linear * rng.uniform(0.35, 0.95) / max(level, 1e-3)
    linear = linear + rng.normal(size=linear.shape) * np.sqrt(np.maximum(linear, 0) * rng.uniform(0, 4e-4) + 1e-6)
    display = 255 * np.clip(linear, 0, 1) ** (1 / 2.2)
    return np.ascontiguousarray(np.rint(display[..., ::-1])).astype(np.uint8)


def render(seed: int, number: int, samples: int) -> tuple[np.ndarray, dict[str, Any], dict[str, Any]]:
    """Picture, what is stated, and the truth."""
    rng = np.random.default_rng([seed, number])
    rig = KINDS[number % len(KINDS)](rng)
    sensor, project = camera(rig, rng)
    sky = mi.Bitmap(textures.surroundings(rng))
    turned = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    described: dict[str, Any] = {"sky": {"type": "envmap", "bitmap": sky, "to_world": turned}}
    if rng.random() < 0.45:
        sun = rng.normal(size=3)
        sun[2] = -abs(sun[2]) - 0.3
        power = {"type": "rgb", "value": [float(rng.uniform(0.3, 3))] * 3}
        described["sun"] = {"type": "directional", "direction": list(sun), "irradiance": power}
    described |= {f"part{index:03d}": part for index, part in enumerate(rig.scene.objects)}
    path = {"type": "path", "max_depth": 9 if rig.kind == "packing" else 4}
    integrator = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "path": path}
    whole = mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, **described})
    channels = np.nan_to_num(np.array(mi.render(whole, spp=samples, seed=number), dtype=np.float32))
    noisy, albedo, normal = (np.ascontiguousarray(part) for part in np.split(channels[..., -9:], 3, axis=2))
    linear = pyoidn.denoise(np.minimum(noisy, 50.0), albedo=np.clip(albedo, 0, 1), normal=normal, hdr=True)
    metre = float(rng.uniform(0.02, 0.08))  # of one unit of length
    grain = 1e3 * metre * rig.grain
    given = {"kind": rig.kind, "file": "photo.jpg", "bead_diameter_mm": grain}
    truth = {
        name: (np.array(value) * metre).tolist() if name.endswith("_m") else value for name, value in rig.truth.items()
    }
    truth["bead_diameter_m"] = grain / 1e3
    if rig.kind == "pile":
        given["base_diameter_mm"] = 2e3 * metre
    else:
        given["cylinder_inner_diameter_mm"] = 2e3 * metre
    for name, point in rig.points.items():
        place = project @ [*point, 1.0]
        truth[name] = [float(value) for value in place[:2] / place[2]]
    return developed(linear, rng), given, truth


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--samples", type=int, default=12, help="light paths per pixel")
    asked = parser.parse_args()
    for number in range(asked.count):
        kind = ("pile", "packing")[number % len(KINDS)]
        folder = asked.folder / f"{kind}_{asked.seed}_{number:03d}"
        if (folder / "truth.json").exists():
            continue
        picture, given, truth = render(asked.seed, number, asked.samples)
        folder.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / "photo.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 90])
        (folder / "given.json").write_text(json.dumps(given, indent=1))
        (folder / "truth.json").write_text(json.dumps(truth, indent=1))  # last: a folder with it is complete
        print(folder.name, flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
