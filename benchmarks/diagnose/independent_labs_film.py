"""Filming an independent lab: clock, scale, roll, shutter, white tracking noise and lost frames."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rigtwin.benchmarks.diagnose.independent_labs_types import Array, Chance, Hidden, Lab, Motion, Rng

LOST = 0.01  # share of the frames
SCALE_UNCERTAINTY, CLOCK_UNCERTAINTY, ROLL_UNCERTAINTY = 0.002, 1e-4, 0.15  # relative, relative, [deg]

# real errors are half as large as the uncertainties that are stated
CAMERA = (
    Chance("scale", "lab", 0.5 * SCALE_UNCERTAINTY, SCALE_UNCERTAINTY, 1e-5),
    Chance("clock", "lab", 0.5 * CLOCK_UNCERTAINTY, CLOCK_UNCERTAINTY, 1e-6),
    Chance("roll", "lab", math.radians(0.5 * ROLL_UNCERTAINTY), math.radians(ROLL_UNCERTAINTY), 1e-5),
)


def stamps(motion: Motion, lab: Lab, off: Mapping[str, float], hidden: Hidden) -> Array:
    """Times [s] that are written down, from the first frame to the last one."""
    return np.arange(int(motion.end * _ratio(off, hidden) * lab.frame_rate)) / lab.frame_rate


def _ratio(off: Mapping[str, float], hidden: Hidden) -> float:
    """Real over stated frame rate."""
    return (1 + off.get("clock", 0.0)) * (1 + hidden.shifts.get("clock", 0.0))


def real_times(motion: Motion, stamped: Array, off: Mapping[str, float], hidden: Hidden) -> Array:
    return np.clip(stamped / _ratio(off, hidden), 0.0, motion.end)


def seen(motion: Motion, stamped: Array, off: Mapping[str, float], hidden: Hidden) -> Array:
    """Coordinates [m] as the camera shows them without noise, shape (2 * bodies, k)."""
    real = real_times(motion, stamped, off, hidden)
    path = motion.at(real)
    zoom = (1 + off.get("scale", 0.0)) * (1 + hidden.shifts.get("scale", 0.0))
    roll = off.get("roll", 0.0) + hidden.shifts.get("roll", 0.0)
    out = np.empty_like(path)
    for body in range(0, len(path), 2):
        x, y = path[body], path[body + 1]
        if hidden.shutter:
            for _ in range(5):  # the row that shows the bead is read later the higher it lies
                late = np.clip(real + hidden.shutter * y, 0.0, motion.end)
                x, y = motion.at(late)[body : body + 2]
        if hidden.view:
            x, y = hidden.view(real, x, y)
        turned = (x + 1j * y) * zoom * np.exp(1j * roll)
        out[body], out[body + 1] = turned.real, turned.imag
    return out


def film(motion: Motion, lab: Lab, off: Mapping[str, float], hidden: Hidden, rng: Rng) -> tuple[Array, Array]:
    """Stamped times [s] and tracked coordinates [m] of the frames that were kept."""
    stamped = stamps(motion, lab, off, hidden)
    tracked = seen(motion, stamped, off, hidden)
    tracked = tracked + lab.noise * lab.scale * rng.standard_normal(tracked.shape)
    kept = rng.random(len(stamped)) > LOST
    return stamped[kept], tracked[:, kept]
