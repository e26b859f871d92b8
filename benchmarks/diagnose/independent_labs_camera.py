"""Errors of the camera and of the set-up that an independent lab may hide, by several laws."""

from __future__ import annotations

import math
from typing import Any

from rigtwin.benchmarks.diagnose.independent_labs_types import Array, Hidden, Lab, Make, Rng, Sized


def shift(name: str, low: float, high: float, *, signed: bool = True) -> Make:
    def make(rng: Rng, _lab: Lab) -> Sized:
        value = float(rng.uniform(low, high)) * (float(rng.choice([-1, 1])) if signed else 1.0)
        return lambda size: Hidden({name: size * value})

    return make


def other_clock(rng: Rng, _lab: Lab) -> Sized:
    """Film at one usual rate read as another, or a camera that runs at 1000/1001 of its nominal rate."""
    ratio = float(rng.choice([25 / 24, 24 / 25, 30 / 29.0, 1.02, 1000 / 1001]))
    return lambda size: Hidden({"clock": size * (ratio - 1)})


def pinhole(rng: Rng, lab: Lab) -> Sized:
    """A camera that looks up or down by some degrees from 0.5 to 1 m away."""
    pitch, distance = math.radians(float(rng.choice([-1, 1]) * rng.uniform(1, 6))), float(rng.uniform(0.5, 1.0))
    axis = 0.0 if lab.rig in ("pendulum", "double") else float(rng.uniform(0.1, 0.3))

    def sized(size: float) -> Hidden:
        c, s = math.cos(size * pitch), math.sin(size * pitch)

        def view(_t: Array, x: Array, y: Array) -> tuple[Array, Array]:
            def project(x: Array | float, y: Array | float) -> tuple[Any, Any]:
                depth = distance - (y - axis) * s
                return distance * x / depth, distance * (y - axis) * c / depth

            u, v = project(x, y)
            _, origin = project(0.0, 0.0)
            return u, v - origin

        return Hidden(view=view)

    return sized


def gradient(rng: Rng, lab: Lab) -> Sized:
    """A scale that grows in proportion to the height."""
    slope = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.12))  # [1/m]
    axis = -0.2 if lab.rig in ("pendulum", "double") else float(rng.uniform(0.0, 0.3))

    def sized(size: float) -> Hidden:
        def view(_t: Array, x: Array, y: Array) -> tuple[Array, Array]:
            scale = size * slope
            return x * (1 + scale * (y - axis)), y + scale * y * (y / 2 - axis)

        return Hidden(view=view)

    return sized


def shutter(sign: float) -> Make:
    """Rows read one after another, from the top or from the bottom."""

    def make(rng: Rng, _lab: Lab) -> Sized:
        delay = sign * float(rng.uniform(0.003, 0.02))
        return lambda size: Hidden(shutter=size * delay)

    return make
