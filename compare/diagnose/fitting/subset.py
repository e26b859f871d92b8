"""Restrict a bench to some repetitions and every n-th row, for screening and for held-out data."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.compare.diagnose.fitting.normal_equations import Regioned
from rigtwin.lab.arrays import Array

ENOUGH_ROWS, ENOUGH_RUNS = 100, 12  # rows per repetition and repetitions in all, enough to detect a strong effect

PER_RUN = ("condition", "radius", "mass", "local_prior", "local_sd", "scatter")
PER_ROW = ("time", "rows", "sigma", "region")


def subset(bench: Regioned, chosen: Sequence[int], every: int = 1) -> Regioned:
    """The bench restricted to the repetitions `chosen` and to every n-th row of each body."""
    part: Any = copy.copy(bench)
    whole: Any = bench
    bodies = whole.bodies
    rows = []
    for r in chosen:
        inside = np.arange(bench.spans[r].start, bench.spans[r].stop)
        body = whole.body[inside] if bodies > 1 else np.zeros(len(inside), dtype=int)
        rows.append(np.sort(np.concatenate([inside[body == k][::every] for k in range(bodies)])))
    kept, counts = np.concatenate(rows), [len(one) for one in rows]
    edges = np.concatenate([[0], np.cumsum(counts)])
    part.spans = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    part.owner = np.repeat(np.arange(len(chosen)), counts)
    for name in (*PER_ROW, *(("body",) if hasattr(whole, "body") else ())):
        setattr(part, name, getattr(whole, name)[kept])
    picked = np.asarray(chosen, dtype=int)
    for name in (*PER_RUN, *whole.per_run):
        value = getattr(whole, name)
        setattr(part, name, [value[r] for r in chosen] if isinstance(value, list) else value[picked])
    return part  # type: ignore[no-any-return]


def coarse(bench: Regioned) -> tuple[Regioned, list[int]]:
    """A small part of the data, enough where the disagreement is large, and the numbers of its repetitions."""
    conditions = len(bench.condition_names)
    chosen: list[int] = []
    for c in range(conditions):
        chosen += np.flatnonzero(bench.condition == c)[: -(-ENOUGH_RUNS // conditions)].tolist()
    bodies = bench.bodies  # type: ignore[attr-defined]
    every = max(1, round(len(bench.rows) / len(bench.spans) / bodies / ENOUGH_ROWS))
    return subset(bench, chosen, every), chosen


def cut(fitted: Fit, chosen: Sequence[int], values: Array | None = None) -> Fit:
    """A fit restricted to the repetitions `chosen`, as a starting point."""
    return replace(
        fitted, local=fitted.local[np.asarray(chosen, dtype=int)], values=fitted.values if values is None else values
    )
