"""What a camera and a tracker make of a motion: scale, roll, clock, shutter, noise, lost frames, rounding.

The small errors that every lab has stay inside what `lab.json` states; a hidden error of the measurement is added to
the same terms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.diagnose.lab_motion import Path

Array = npt.NDArray[np.float64]

LOST = 0.01  # share of the frames
DISTANCE = 0.6  # [m], of the camera from the plane of motion


@dataclass(frozen=True)
class Camera:
    """A camera as it really is, beside what the lab believes of it."""

    frame_rate: float  # [Hz], stated
    scale: float  # [m/px], stated
    noise: float  # [px], white, stated
    scale_error: float  # relative
    clock_error: float  # relative, of the frame rate
    roll: float  # [rad]
    locking: float  # [px], amplitude of the pull towards whole pixels
    drift: float  # [px], correlated tracking error
    correlation: float  # of that from frame to frame


def ordinary(rng: np.random.Generator, *, frame_rate: float, scale: float) -> Camera:
    """A camera whose errors lie inside the stated uncertainties (0.2 %, 1e-4, 0.15 deg)."""
    return Camera(
        frame_rate=frame_rate,
        scale=scale,
        noise=round(float(rng.uniform(0.15, 0.38)), 2),
        scale_error=float(np.clip(rng.normal(0, 0.001), -0.002, 0.002)),
        clock_error=float(np.clip(rng.normal(0, 5e-5), -1e-4, 1e-4)),
        roll=math.radians(float(np.clip(rng.normal(0, 0.08), -0.15, 0.15))),
        locking=float(rng.uniform(0.0, 0.05)),
        drift=float(rng.uniform(0.0, 0.06)),
        correlation=float(rng.uniform(0.5, 0.9)),
    )


def film(
    path: Path, camera: Camera, hidden: Mapping[str, float], rng: np.random.Generator
) -> tuple[Array, list[Array], Array]:
    """Stamped times [s], shape (k,); positions of each body [m], shape (2, k); which frames were kept."""
    rate_ratio = (1 + camera.clock_error) * hidden.get("cam_q", 1.0)  # real over stated frame rate
    frames = np.arange(int(path.end * camera.frame_rate * rate_ratio))
    stamped = frames / camera.frame_rate
    real = stamped / rate_ratio
    if jitter := hidden.get("jitter", 0.0):
        real = np.clip(real + rng.normal(0, jitter, len(real)), 0, path.end)
    bodies = _exposed(path, real, hidden.get("shutter", 0.0))
    seen = [_projected(body, camera, hidden, real) for body in bodies]
    return stamped, [_tracked(body, camera, rng) for body in seen], rng.random(len(frames)) > LOST


def _exposed(path: Path, real: Array, shutter: float) -> Array:
    """Positions at the moment each body's own row is read, `shutter` [s/m] later per metre of height."""
    bodies = path.at(real)
    if not shutter:
        return bodies
    out = bodies.copy()
    for k in range(len(bodies)):
        here = bodies[k]
        for _ in range(4):
            late = np.clip(real + shutter * here[1], 0.0, path.end)
            here = path.at(late)[k]
        out[k] = here
    return out


def _projected(body: Array, camera: Camera, hidden: Mapping[str, float], real: Array) -> Array:
    x, y = _pinhole(*body, hidden.get("perspective", 0.0)) if hidden.get("perspective") else body
    depth = hidden.get("depth_drift", 0.0)  # [1/s], growth of the scale as the bead comes nearer
    zoom = (1 + camera.scale_error) * (1 + hidden.get("scale", 0.0)) * (1 + depth * real)
    roll = camera.roll + hidden.get("roll", 0.0)
    c, s = math.cos(roll), math.sin(roll)
    return np.array([zoom * (c * x - s * y), zoom * (s * x + c * y)])


def _pinhole(x: Array, y: Array, gradient: float) -> tuple[Array, Array]:
    """What a camera sees that looks up or down, the picture's origin put where the rig's is.

    Its scale is right at the height it looks at, and grows by `gradient` [1/m] with height there.
    """
    looks_at = 0.0 if y.min() < -0.1 else 0.3  # [m], pendulums are filmed from about the pivot's height
    pitch = math.asin(min(abs(gradient) * DISTANCE, 0.9))

    def seen(x: Array, y: Array) -> tuple[Array, Array]:
        near = 1 / (1 - gradient * (y - looks_at))
        return x * near, (y - looks_at) * math.cos(pitch) * near

    origin = seen(np.zeros(1), np.zeros(1))
    u, v = seen(x, y)
    return u - origin[0], v - origin[1]


def _tracked(body: Array, camera: Camera, rng: np.random.Generator) -> Array:
    pixels = body / camera.scale
    phase = rng.uniform(0, 2 * math.pi, (2, 1))
    pixels = pixels + camera.locking * np.sin(2 * math.pi * pixels + phase)
    pixels = pixels + rng.normal(0, camera.noise, pixels.shape)
    slow = rng.normal(0, camera.drift * math.sqrt(1 - camera.correlation**2), pixels.shape)
    wander = rng.normal(0, camera.drift, 2)
    for k in range(pixels.shape[1]):
        wander = camera.correlation * wander + slow[:, k]
        pixels[:, k] += wander
    return pixels * camera.scale
