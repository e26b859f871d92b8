"""Reduced model of a single pendulum: the filmed ring-down of a bob on a thread, released from an angle.

World axes: x right, y up, origin at the pivot; angles from the vertical, positive to the right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.data.tracking_noise import noise_of
from rigtwin.compare.diagnose.models.camera import camera_unknowns
from rigtwin.compare.diagnose.models.rows import Beads, eighths, shared
from rigtwin.compare.diagnose.models.scattered import Scattered
from rigtwin.compare.diagnose.models.sensitivities import SMALL, Moved
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect
from rigtwin.sim.reduced.swing import Push, angle_at, half_swings

LEAST_REACH = 0.2  # of the length, of an elastic thread whose trial compliance is too large for its bob
SOONEST = 1e-3  # [s]: creep with a power of the time begins infinitely fast, and a bob at rest does not feel it
LENGTHENING = ("stretch", "creep")  # effects that make the thread longer during a swing
OWN_LENGTH = 0.5  # individual uncertainty of each length, as a share of the stated (common) length uncertainty


class PendulumBench:
    """All repetitions of a lab of single pendulums."""

    bodies = 1
    onset = 0
    small = SMALL
    set_up = -1
    drivable = True
    per_run = ("length", "which", "bead")

    def __init__(self, lab: TrackedLab) -> None:
        self.lab = lab
        runs = [
            (c, condition, tracks[0]) for c, condition in enumerate(lab.conditions) for tracks in condition.repetitions
        ]
        self.condition = np.array([c for c, _, _ in runs])
        self.radius = np.array([condition.bead.radius for _, condition, _ in runs])
        self.mass = np.array([condition.bead.mass for _, condition, _ in runs])
        self.mean_mass = float(np.mean([bead.mass for bead in {c.bead.name: c.bead for c in lab.conditions}.values()]))
        self.beads = Beads([condition for _, condition, _ in runs])
        self.bead = self.beads.number
        self.length = np.array(lab.setting("length_m"))
        self.lengths = sorted(set(self.length.tolist()))
        self.which = np.array([self.lengths.index(length) for length in self.length.tolist()])
        angle = np.radians(lab.setting("release_angle_deg"))
        side = np.array([1.0 if float(np.median(track.position[:5, 0])) >= 0 else -1.0 for _, _, track in runs])
        angle = np.abs(angle) * side
        self.noise = noise_of(lab, [track for _, _, track in runs])
        self.time = np.concatenate([track.time for _, _, track in runs])
        self.rows = np.concatenate([track.position for _, _, track in runs])
        counts = [len(track.time) for _, _, track in runs]
        edges = np.concatenate([[0], np.cumsum(counts)])
        self.spans = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        self.owner = np.repeat(np.arange(len(runs)), counts)
        self.sigma = np.full(len(self.rows), self.noise)
        self.condition_names = [condition.name for condition in lab.conditions]
        self.region, self.region_names = eighths(self.time, self.spans)
        repetitions = len(runs)
        release_sd = math.radians(lab.uncertainty("release_angle_uncertainty_deg", default=0.3))
        self.local_prior = np.stack([np.zeros(repetitions), angle], axis=1)
        self.local_sd = np.stack([np.full(repetitions, 10.0), release_sd * shared(self.condition)], axis=1)
        self.local_step = np.array([1e-3, 1e-2])
        self.local_low = np.full(len(self.local_step), -np.inf)
        self.scatter = np.zeros((repetitions, 0), dtype=int)
        self.scattered: Sequence[Scattered] = ()
        self.scatter_start = self.scatter_least = self.scatter_most = np.zeros(0)

    def unknowns(self, terms: Sequence[Effect]) -> list[Unknown]:
        """Lengths and calibration with their priors, and coefficients of the terms."""
        length_sd = self.lab.uncertainty("length_uncertainty_m", default=5e-4)
        own = [
            Unknown(f"length.{length:g}", 0.0, 1e-3, sd=OWN_LENGTH * length_sd, low=-0.02, high=0.02)
            for length in self.lengths
        ]
        many = own if len(own) > 1 else []
        # drag depends on the diameter; with an exact diameter its error would appear as a torque at the pivot
        sizes = self.beads.unknowns() if any(term.force is not None for term in terms) else []
        return [*many, *sizes, *camera_unknowns(self.lab, terms, {"length_error": length_sd})]

    def first_guess(self, values: Mapping[str, float]) -> Array:
        """Release time from the moment the angle has fallen by a tenth."""
        clock = 1.0 + values.get("frame_rate_error.relative", 0.0)
        guess = self.local_prior.copy()
        for r, span in enumerate(self.spans):
            time, place = self.time[span] / clock, self.rows[span]
            angle = np.abs(np.arctan2(place[:, 0], -place[:, 1]))
            part = int(np.argmax(angle < 0.9 * float(np.median(angle[:3]))))
            omega = math.sqrt(self.lab.gravity / self.length[r])
            guess[r, 0] = max(float(time[part]) - math.sqrt(0.2) / omega, 0.0)
        return guess

    def horizons(self) -> list[Any]:
        """Masks (N,) of the first rows, fitted first so that the phase of the swings is not lost."""
        return [self.time < limit for limit in (1.0, 2.5) if float(self.time.max()) > 1.3 * limit]

    def move(self, local: Array, values: Mapping[str, Array], terms: Sequence[Effect], true: Array, seen: int) -> Moved:
        """Motion of all repetitions for a stack of settings."""
        length = true_lengths(self.length, values)
        if len(self.lengths) > 1:
            own = np.stack([values[f"length.{one:g}"] for one in self.lengths], axis=-1)
            length = length + own[:, self.which]
        radius = self.radius
        if any(term.force is not None for term in terms):
            radius = radius + 0.5 * self.beads.of("diameter", values, self.bead)
        if "thread_stretch_exchanged.measured_under" in values:  # the length of this bead at rest
            measured = values["thread_stretch_exchanged.measured_under"][:, None] * self.mean_mass
            strain = _compliance(values, local) * self.lab.gravity * (self.mass - measured)
            length = length * np.maximum(1 + strain, LEAST_REACH)
        push, omega = pushing(length, self.mass, radius, self.lab.gravity, values, terms, local[..., 0])
        t0 = local[..., 0]
        since = true - t0[:, self.owner]
        until = np.array([since[:, span].max(axis=1) for span in self.spans]).T
        dry = any(term.torque is not None for term in terms)
        creeps = any(term.geometry == "creep" for term in terms)
        driven = creeps or any(term.drive is not None for term in terms)
        swings = half_swings(local[..., 1], push, omega, until, dry=dry, driven=driven)
        angle, rate = angle_at(swings, since, self.owner)
        reach = self._reach(length, angle, rate, since, values)
        x, y = reach * np.sin(angle), -reach * np.cos(angle)
        speed = reach[0] * rate[0]
        soft = np.zeros((len(local), len(self.spans), 0))
        return Moved(x, y, speed * np.cos(angle[0]), speed * np.sin(angle[0]), soft)

    def _reach(self, length: Array, angle: Array, rate: Array, since: Array, values: Mapping[str, Array]) -> Array:
        """Distance from the pivot to the bob at each row, shape (settings, N)."""
        reach = length[:, self.owner]
        reach = reach + _crept(values, reach, since)[0]
        compliance = _compliance(values, length)
        if compliance.any():
            more = self.mass[self.owner] * (self.lab.gravity * (np.cos(angle) - 1.0) + reach * rate**2)
            reach = reach * (1 + compliance * more)
        return np.asarray(reach)

    def quiet(self, name: str, terms: Sequence[Effect]) -> bool:
        """Always False: there are no impacts, every unknown changes the motion."""
        return False

    def touches(self, name: str) -> tuple[str, Array] | None:
        """A length acts in the repetitions of its conditions, a diameter in those of its bead."""
        kind, _, rest = name.partition(".")
        if kind == "diameter":
            return kind, self.bead == self.beads.names.index(rest)
        return (kind, self.which == [f"{one:g}" for one in self.lengths].index(rest)) if kind == "length" else None


def _compliance(values: Mapping[str, Array], stack: Array) -> Array:
    """Strain per force [1/N] of the thread, shape (settings, 1); zero without an effect that stretches it."""
    names = ("thread_stretch.compliance", "thread_stretch_exchanged.compliance")
    return sum((values[name] for name in names if name in values), np.zeros(len(stack)))[:, None]


def _crept(values: Mapping[str, Array], length: Array, since: Array | float) -> tuple[Array | float, Array | float]:
    """Growth [m] of threads of the `length` [m] by creep, a time `since` the release [s], and its rate [m/s]."""
    grown: Array | float = 0.0
    rate: Array | float = 0.0
    since = np.maximum(since, 0.0)
    if "thread_creep.rate" in values:
        rate = values["thread_creep.rate"][:, None]
        grown = rate * since
    if "thread_creep_power.strain" in values:
        power = values["thread_creep_power.time_exponent"][:, None]
        crept = values["thread_creep_power.strain"][:, None] * length * since**power
        grown, rate = grown + crept, rate + power * crept / np.maximum(since, SOONEST)
    return grown, rate


def true_lengths(stated: Array, values: Mapping[str, Array]) -> Array:
    """Lengths [m] with the errors that all share, shape (settings, R), of the stated ones, shape (R,)."""
    found = stated + values["length_error.offset"][:, None]
    if "length_error_ratio.relative" in values:
        found = found + values["length_error_ratio.relative"][:, None] * stated
    return np.asarray(found)


def pushing(
    length: Array,
    mass: Array,
    radius: Array,
    gravity: float,
    values: Mapping[str, Array],
    terms: Sequence[Effect],
    release: Array | float = 0.0,
) -> tuple[Push, Array]:
    """Angular acceleration [rad/s^2] of a bob with the terms acting, as a function, and its frequency [rad/s].

    `release` is the time of release on the clock of the record [s].
    """
    thread = values.get("rod_mass.mass_per_length", np.zeros(len(length)))[:, None]
    inertia = mass * length**2 + thread * length**3 / 3
    weight = (mass + thread * length / 2) * gravity * length
    acting = [
        (term, [values[f"{term.name}.{p.name}"][:, None] for p in term.parameters])
        for term in terms
        if term.force is not None or term.torque is not None or term.drive is not None
    ]

    pull = weight / inertia
    stretch = _compliance(values, length) * mass * length

    def fall(angle: Array, _rate: Array) -> Array:
        return np.asarray(-pull * np.sin(angle))

    lengthens = any(term.geometry in LENGTHENING for term in terms)
    if not (acting or lengthens):
        return fall, np.sqrt(pull)

    def push(angle: Array, rate: Array, since: Array | float = 0.0) -> Array:
        sine = np.sin(angle)
        cosine = np.cos(angle)
        moment = -weight * sine
        if lengthens:  # a thread of changing length r: r theta'' = -g sin(theta) - 2 r' theta'
            crept, creep = _crept(values, length, since)
            longer = stretch * (gravity * (cosine - 1.0) + length * rate**2) + crept
            reach = np.maximum(length + longer, LEAST_REACH * length)
            moment = moment * length / reach
        for term, own in acting:
            if term.force is not None:
                fx, fy = term.force(length * rate * cosine, length * rate * sine, 1e3, radius, mass, *own)
                moment = moment + length * (fx * cosine + fy * sine)
            if term.torque is not None:
                moment = moment + term.torque(angle, rate, length, mass, *own)
            if term.drive is not None:
                along = term.drive(release + since, length * angle, length * rate, *own)
                moment = moment + mass * length * along
        acceleration = np.asarray(moment / inertia)
        if not lengthens:
            return acceleration
        growth = creep - stretch * gravity * sine * rate  # and 2 stretch length theta' theta'' of r', to the left
        softening = 4.0 * stretch * length * rate**2
        return np.asarray((acceleration - 2.0 * growth * rate / reach) / (1.0 + softening / reach))

    return push, np.sqrt(pull)
