"""Predictions of a bench and their derivatives with respect to all unknowns.

The number of finite differences is kept small: camera unknowns and the release time act through the velocity,
unknowns of one kind in different repetitions are changed together, and unknowns of a contact law change no motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rigtwin.compare.diagnose.models.camera import exposed, is_camera, viewed
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect

SMALL = (
    1e-4  # finite-difference step as a share of a visible change; larger steps separate unknowns that the data cannot
)
STEADY = 1e-3  # the same for motions integrated in steps whose number may change with the unknown


@dataclass(frozen=True)
class Moved:
    """The motion of all repetitions for a stack of B settings."""

    x: Array  # [m], (M, N), for the first M settings
    y: Array
    vx: Array  # [m/s], (N,), velocity of the first setting at each row
    vy: Array
    soft: Array  # (B, R, S), random deviations of the impacts from the contact law


class Moving(Protocol):
    """A rig with its data: the part that concerns the motion."""

    time: Array  # [s], (N,)
    rows: Array  # [m], (N, 2) observed positions, sorted by repetition
    spans: Sequence[slice]  # the rows of each repetition
    owner: Any  # (N,) repetition of each row
    local_step: Array  # (L,)
    onset: int
    """Index of the local unknown that is the release time, -1 for none."""
    small: float
    """Finite-difference step as a share of a visible change."""
    set_up: int
    """Index of the first of two local unknowns, relative scale and height [m] of the origin, -1 for none."""

    def move(
        self, local: Array, values: Mapping[str, Array], terms: Sequence[Effect], true: Array, seen: int
    ) -> Moved: ...

    def quiet(self, name: str, terms: Sequence[Effect]) -> bool:
        """Whether an unknown changes only the contact law, not the motion."""
        ...

    def touches(self, name: str) -> tuple[str, Array] | None:
        """Kind and mask (R,) of the repetitions of a global unknown that acts only in some; None if it acts in all."""
        ...


@dataclass(frozen=True)
class Slopes:
    """A prediction and its derivatives, local unknowns first."""

    position: Array  # [m], (N, 2), where the camera sees the body
    speed: Array  # [m/s], (N, 2)
    soft: Array  # (R, S)
    by_row: Array  # (L + G, N, 2)
    by_soft: Array  # (L + G, R, S)


@dataclass(frozen=True)
class Mechanics:
    """The motion and its derivatives in the rig's own axes; the camera's columns are left at zero."""

    x: Array  # (N,)
    y: Array
    vx: Array
    vy: Array
    soft: Array  # (R, S)
    by_row: Array  # (L + G, N, 2)
    by_soft: Array  # (L + G, R, S)


def slopes(bench: Moving, unknowns: Sequence[Unknown], terms: Sequence[Effect], local: Array, values: Array) -> Slopes:
    """Prediction and derivatives at one setting."""
    now = {u.name: np.array([v]) for u, v in zip(unknowns, values, strict=True)}
    true = exposed(bench.time, bench.rows, now, terms)[0]
    build = getattr(bench, "mechanics", None)
    found: Mechanics = (
        build(unknowns, terms, local, values, true)
        if build is not None
        else mechanics(bench, unknowns, terms, local, values, true)
    )
    x, y = found.x[None], found.y[None]
    place = np.stack(viewed(x, y, now, terms), axis=-1)[0]
    by_row = found.by_row
    h = 1e-5  # [m], finite-difference step; the projection is smooth
    by_x = (np.stack(viewed(x + h, y, now, terms), axis=-1)[0] - place) / h
    by_y = (np.stack(viewed(x, y + h, now, terms), axis=-1)[0] - place) / h
    by_row = by_row[..., :1] * by_x + by_row[..., 1:] * by_y
    size = local.shape[1]
    for k, unknown in enumerate(unknowns):
        if not is_camera(unknown.name, terms):
            continue
        step = bench.small * unknown.step
        other = {**now, unknown.name: now[unknown.name] + step}
        late = exposed(bench.time, bench.rows, other, terms)[0] - true
        there = np.stack(viewed(x + found.vx * late, y + found.vy * late, other, terms), axis=-1)[0]
        by_row[size + k] = (there - place) / step
    seen = Slopes(place, np.stack([found.vx, found.vy], axis=-1), found.soft, by_row, found.by_soft)
    return _set_up_anew(bench, seen, local) if bench.set_up >= 0 else seen


def _set_up_anew(bench: Moving, seen: Slopes, local: Array) -> Slopes:
    """The picture with a scale and a height of the origin that differ from repetition to repetition."""
    k = bench.set_up
    scale, up = 1.0 + local[bench.owner, k], local[bench.owner, k + 1]
    by_row = seen.by_row * scale[:, None]
    by_row[k], by_row[k + 1] = seen.position, (0.0, 1.0)
    place = seen.position * scale[:, None] + np.stack([0.0 * up, up], axis=-1)
    by_soft = np.concatenate([seen.by_soft, np.zeros((*seen.by_soft.shape[:2], 2))], axis=2)
    by_soft[k, :, -2] = by_soft[k + 1, :, -1] = 1.0
    return Slopes(place, seen.speed, np.concatenate([seen.soft, local[:, k : k + 2]], axis=1), by_row, by_soft)


def mechanics(
    bench: Moving, unknowns: Sequence[Unknown], terms: Sequence[Effect], local: Array, values: Array, true: Array
) -> Mechanics:
    """Derivatives of the motion by finite differences in one stacked prediction."""
    size, count = local.shape[1], len(unknowns)
    moving = [k for k in range(size) if k != bench.onset]
    groups, silent = grouped(bench, unknowns, terms)
    settings = 1 + len(moving) + len(groups) + len(silent)
    locals_, stack = np.repeat(local[None], settings, axis=0), np.repeat(values[None], settings, axis=0)
    for row, k in enumerate(moving, start=1):
        locals_[row, :, k] += bench.small * bench.local_step[k]
    for row, group in enumerate([*groups, *silent], start=1 + len(moving)):
        for k in group:
            stack[row, k] += bench.small * unknowns[k].step
    by_name = {u.name: stack[:, k] for k, u in enumerate(unknowns)}
    moved = bench.move(locals_, by_name, terms, true, settings - len(silent))
    by_row = np.zeros((size + count, len(bench.time), 2))
    by_soft = np.zeros((size + count, *moved.soft.shape[1:]))
    x, y = moved.x[0], moved.y[0]
    for row, k in enumerate(moving, start=1):
        step = bench.small * bench.local_step[k]
        by_row[k, :, 0], by_row[k, :, 1] = (moved.x[row] - x) / step, (moved.y[row] - y) / step
        by_soft[k] = (moved.soft[row] - moved.soft[0]) / step
    if bench.onset >= 0:
        by_row[bench.onset, :, 0], by_row[bench.onset, :, 1] = -moved.vx, -moved.vy
    for row, group in enumerate([*groups, *silent], start=1 + len(moving)):
        for k in group:
            step = bench.small * unknowns[k].step
            part = bench.touches(unknowns[k].name)
            change = (moved.soft[row] - moved.soft[0]) / step
            by_soft[size + k] = change if part is None else change * part[1][:, None]
            if row < len(moved.x):
                inside = 1.0 if part is None else part[1][bench.owner]
                by_row[size + k, :, 0] = (moved.x[row] - x) / step * inside
                by_row[size + k, :, 1] = (moved.y[row] - y) / step * inside
    return Mechanics(x, y, moved.vx, moved.vy, moved.soft[0], by_row, by_soft)


def grouped(
    bench: Moving, unknowns: Sequence[Unknown], terms: Sequence[Effect]
) -> tuple[list[list[int]], list[list[int]]]:
    """Groups of unknowns to change together: those that change the motion, and those that change only impacts."""
    moving: dict[str, list[int]] = {}
    silent: dict[str, list[int]] = {}
    for k, unknown in enumerate(unknowns):
        if is_camera(unknown.name, terms):
            continue
        part = bench.touches(unknown.name)
        kind = unknown.name if part is None else part[0]
        (silent if bench.quiet(unknown.name, terms) else moving).setdefault(kind, []).append(k)
    return list(moving.values()), list(silent.values())
