"""The repetitions of a lab as one table of rows, and unknowns that the rigs share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import Condition, TrackedLab, stated_uncertainty
from rigtwin.compare.diagnose.data.tracking_noise import noise_of
from rigtwin.compare.diagnose.models.scattered import Scattered
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.lab.records import Track
from rigtwin.sim.effects import Effect

LEAST_SCATTER = 1e-3
"""Smallest standard deviation of a restitution, of a rebound direction, or of a friction coefficient."""
DIAMETER = 2e-5  # [m], standard uncertainty of a bead's diameter where none is stated


class Runs:
    """The repetitions of a lab in order, with the rows of all tracks concatenated."""

    set_up = -1

    def __init__(self, lab: TrackedLab) -> None:
        self.lab = lab
        self.runs: list[tuple[int, Condition, Track]] = [
            (number, condition, track)
            for number, condition in enumerate(lab.conditions)
            for tracks in condition.repetitions
            for track in tracks
        ]
        per_run = len(lab.conditions[0].repetitions[0])
        firsts = self.runs[::per_run]
        self.condition = np.array([number for number, _, _ in firsts])
        self.condition_names = [condition.name for condition in lab.conditions]
        self.conditions = [condition for _, condition, _ in firsts]
        self.radius = np.array([condition.bead.radius for condition in self.conditions])
        self.mass = np.array([condition.bead.mass for condition in self.conditions])
        self.beads = Beads(self.conditions)
        self.bead = self.beads.number
        self.noise = noise_of(lab, [track for _, _, track in self.runs])
        self.time = np.concatenate([track.time for _, _, track in self.runs])
        self.rows = np.concatenate([track.position for _, _, track in self.runs])
        counts = [
            sum(len(track.time) for _, _, track in self.runs[k : k + per_run])
            for k in range(0, len(self.runs), per_run)
        ]
        self.spans = [slice(int(a), int(b)) for a, b in pairwise(np.concatenate([[0], np.cumsum(counts)]))]
        self.owner: Any = np.repeat(np.arange(len(counts)), counts)
        self.sigma: Array = np.full(len(self.rows), self.noise)
        self.scatter: Any = np.zeros((len(counts), 0), dtype=int)
        self.scattered: Sequence[Scattered] = ()
        self.scatter_start: Array = np.zeros(0)
        self.scatter_most: Array = np.zeros(0)
        self.region: Any
        self.region_names: Sequence[str]
        self.region, self.region_names = eighths(self.time, self.spans)

    @property
    def scatter_least(self) -> Array:
        """Smallest scatter (H,) that a fit may find."""
        return np.full(len(self.scatter_start), LEAST_SCATTER)

    def setting(self, name: str, default: float | None = None) -> Array:
        """A number that each condition states, one per repetition."""
        return np.array(self.lab.setting(name, default))


class Beads:
    """The beads of a lab with their diameters as unknowns; tracks locate a contact to a micrometre."""

    def __init__(self, conditions: Sequence[Condition]) -> None:
        """`conditions` holds the condition of each repetition."""
        self.known = {condition.bead.name: condition.bead for condition in conditions}
        self.names = list(self.known)
        self.number: Any = np.array([self.names.index(condition.bead.name) for condition in conditions])

    def unknowns(self, kind: str = "diameter", sd: float | None = None) -> list[Unknown]:
        """One unknown for each bead: the error [m] of the stated value, with `sd` [m] or that of the diameter."""
        return [
            Unknown(f"{kind}.{name}", 0.0, 1e-3, sd=self._diameter_sd(name) if sd is None else sd, low=-2e-3, high=2e-3)
            for name in self.names
        ]

    def _diameter_sd(self, name: str) -> float:
        return stated_uncertainty(self.known[name].about, "diameter_uncertainty_m", DIAMETER)

    def of(self, kind: str, values: Mapping[str, Array], runs: Any) -> Array:
        """Unknowns of this kind [m] in each repetition, shape (settings, R); `runs` is the bead of each repetition."""
        return np.stack([values[f"{kind}.{name}"] for name in self.names], axis=-1)[:, runs]


def coefficients(
    term: Effect, values: Mapping[str, Array], lab: TrackedLab, conditions: Sequence[Condition]
) -> list[Array]:
    """Parameters of an effect in each repetition, shape (settings, R, 1); stated values replace fitted ones.

    `conditions` holds the condition of each repetition.
    """
    found = []
    for parameter in term.parameters:
        fitted = values[f"{term.name}.{parameter.name}"][:, None]
        if parameter.stated is not None:
            stated = np.array([lab.stated_for(condition, parameter) for condition in conditions], dtype=float)
            fitted = np.where(np.isnan(stated), fitted, stated)
        found.append(fitted[..., None])
    return found


def shared(condition: Array) -> Array:
    """Factor (R,) on the standard uncertainty of a setting common to the n repetitions of a condition: sqrt(n).

    The repetitions share one error, so n of them must not determine the setting better than one.  Each therefore gets
    n times the variance.
    """
    return np.asarray(np.sqrt(np.bincount(condition)[condition]))


def eighths(time: Array, spans: Sequence[slice]) -> tuple[Any, list[str]]:
    """Region number of each row, shape (N,), and region names: eighths of each record by time."""
    region = np.concatenate(
        [np.minimum((8 * (time[s] - time[s].min()) / (np.ptp(time[s]) + 1e-9)).astype(int), 7) for s in spans]
    )
    order = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "last")
    return region, [f"{which} eighth of the record" for which in order]
