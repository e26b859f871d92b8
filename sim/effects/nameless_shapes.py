"""Nameless terms whose shape is fitted: a band of heights, a decay, a period.

Each has linear coefficients, and non-linear shape parameters that are searched on a grid and then fitted.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigtwin.sim.effects.effect import Effect, Hook, Parameter

E = 2.718281828459045
EDGE = 15.0  # width of a band over the width of its edges
REACHES = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)  # decay lengths over the greatest height
# band edges over the greatest height or the longest path; a band acts between any two of them
EDGES = (-0.05, 0.05, 0.1, 0.18, 0.28, 0.4, 0.55, 0.75, 1.1)
FEWEST_CYCLES, MOST_CYCLES = 0.7, 25.0  # in the longest motion
PER_CYCLE = 4.0  # trial periods per cycle in the span of all motions together
MOST_PERIODS = 400  # counted from the longest; a record long against its motions does not reach the shortest ones
TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Shape:
    """A term with free shape parameters, and the grid of their starting values."""

    effect: Effect
    linear: tuple[str, ...]
    grid: tuple[tuple[float, ...], ...]

    @property
    def shaping(self) -> tuple[str, ...]:
        """Names of the parameters in which the term is non-linear."""
        return tuple(p.name for p in self.effect.parameters if p.name not in self.linear)

    @property
    def cost(self) -> float:
        """Penalty on the gain in deviance, for the search on the grid and the fit of the shape parameters."""
        return 2 * math.log(len(self.grid)) + 2 * len(self.shaping)

    def frozen(self, number: int) -> Effect:
        """The term with the shape parameters of this grid point: linear in all its remaining parameters."""
        fixed = self.grid[number]
        hook = "force" if self.effect.force is not None else "drive"
        whole: Hook = getattr(self.effect, hook)
        own = tuple(p for p in self.effect.parameters if p.name in self.linear)

        def term(*given: Any) -> Any:
            return whole(*given, *fixed)

        hooks: dict[str, Any] = {hook: term}
        edges = self.effect.edges
        if edges is not None:
            hooks["edges"] = lambda *given: edges(*given, *fixed)
        return replace(self.effect, name=f"{self.effect.name}@{number}", parameters=own, **hooks)


def near(place: Any, reach: Any) -> Any:
    """1 at zero, decaying by a factor e per `reach`."""
    return E ** (-abs(place) / (abs(reach) + 1e-6))


def width_of_edge(low: Any, high: Any) -> Any:
    return abs(high - low) / EDGE + 1e-5


def between(place: Any, low: Any, high: Any) -> Any:
    """1 from low to high and 0 elsewhere, with smooth edges so that a fit can move them."""
    edge = width_of_edge(low, high)
    return 1.0 / ((1.0 + E ** ((low - place) / edge)) * (1.0 + E ** ((place - high) / edge)))


# in flight


def decay(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any, reach: Any) -> Any:
    return 0.0 * vx, mass * c * near(gap, reach) + 0.0 * vy


def decay_sideways(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any, reach: Any) -> Any:
    return mass * c * near(gap, reach) + 0.0 * vx, 0.0 * vy


def band(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any, low: Any, high: Any) -> Any:
    return 0.0 * vx, mass * c * between(gap, low, high) + 0.0 * vy


def band_sideways(vx: Any, vy: Any, gap: Any, radius: Any, mass: Any, c: Any, low: Any, high: Any) -> Any:
    return mass * c * between(gap, low, high) + 0.0 * vx, 0.0 * vy


def edges_of_band(c: Any, low: Any, high: Any) -> Any:
    return low + 0.0 * c, width_of_edge(low, high) + 0.0 * c


# along a bob's arc or a track


def in_time(time: Any, place: Any, speed: Any, c: Any, d: Any, period: Any) -> Any:
    return c * np.sin(TURN * time / period) + d * np.cos(TURN * time / period)


def in_place(time: Any, place: Any, speed: Any, c: Any, d: Any, period: Any) -> Any:
    return c * np.sin(TURN * place / period) + d * np.cos(TURN * place / period)


def stretch(time: Any, place: Any, speed: Any, c: Any, low: Any, high: Any) -> Any:
    return c * between(place, low, high)


@dataclass(frozen=True)
class Extent:
    """Extent of the motions of a lab, in time and length."""

    time: float  # [s], the longest motion
    clock: float  # [s], from the first motion in any record to the last
    way: float  # [m], the greatest height of fall or the longest path


def shapes(rig: str, extent: Extent) -> tuple[Shape, ...]:
    """The terms that can act in a rig."""
    reaches = tuple((share * extent.way,) for share in REACHES)
    narrow_first = sorted(itertools.combinations(EDGES, 2), key=lambda pair: pair[1] - pair[0])
    edges = tuple((a * extent.way, b * extent.way) for a, b in narrow_first)
    along, zone = (_length("reach"),), (_length("low"), _length("high"))
    if rig == "drop":
        what = "force per mass c"
        return (
            _shape(rig, "decay", f"{what} exp(-z / reach)", along, reaches, steep=True, force=decay),
            _shape(
                rig, "decay_sideways", f"{what} exp(-z / reach) e_x", along, reaches, steep=True, aimed=True,
                force=decay_sideways,
            ),
            _shape(rig, "band", f"{what} where low < z < high", zone, edges, edges=edges_of_band, force=band),
            _shape(
                rig, "band_sideways", f"{what} e_x where low < z < high", zone, edges, edges=edges_of_band,
                aimed=True, force=band_sideways,
            ),
        )  # fmt: skip
    if rig not in ("pendulum", "roll", "slide"):
        return ()
    what = "acceleration along the path c"
    swings = f"{what} sin(2 pi {{0}} / period) + d cos(2 pi {{0}} / period)"
    in_time_ = _shape(
        rig, "period", swings.format("t"), (Parameter("period", "s", 1e-3, 1e3, 1e-2 * extent.time),),
        _periods(extent.time, extent.clock), drive=in_time,
    )  # fmt: skip
    if rig == "pendulum":
        return (in_time_,)
    return (
        in_time_,
        _shape(
            rig, "ripple", swings.format("s"), (Parameter("period", "m", 1e-3, 1e3, 1e-2 * extent.way),),
            _periods(extent.way, extent.way), drive=in_place,
        ),
        _shape(rig, "stretch", f"{what} where low < s < high", zone, edges, drive=stretch),
    )  # fmt: skip


def _periods(longest: float, span: float) -> tuple[tuple[float, ...], ...]:
    """Trial periods of a periodogram, at the resolution that the span of the motions permits."""
    first, step = FEWEST_CYCLES / longest, 1 / (PER_CYCLE * span)
    count = min(int((MOST_CYCLES / longest - first) / step) + 1, MOST_PERIODS)
    return tuple((1 / float(first + k * step),) for k in range(count))


def _length(name: str) -> Parameter:
    return Parameter(name, "m", -10.0, 10.0, 0.01)


def _shape(
    rig: str, name: str, title: str, shaping: Sequence[Parameter], grid: tuple[tuple[float, ...], ...], **hooks: Any
) -> Shape:
    linear = ("c", "d") if " d " in title else ("c",)
    own = tuple(Parameter(one, "m/s^2", -1e9, 1e9, 0.05) for one in linear)
    effect = Effect(
        name=f"form:{name}", title=title, kind="physical", rigs=(rig,), parameters=(*own, *shaping), equation=title,
        source="regression on the residual", **hooks,
    )  # fmt: skip
    return Shape(effect, linear, grid)
