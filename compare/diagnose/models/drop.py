"""Reduced model of the drop test: integrated flights, instantaneous impacts, and scatter at every impact.

Each repetition has its own release (time, position, horizontal speed) and, at each impact, its own speed after the
impact along and across the plate.  The restitutions and rebound directions are random effects around the contact law.
World axes: x right, y up, origin on the plate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.data.tracking_noise import noise_of
from rigtwin.compare.diagnose.models.camera import camera_unknowns
from rigtwin.compare.diagnose.models.rows import LEAST_SCATTER, Beads, coefficients, shared
from rigtwin.compare.diagnose.models.scattered import Scattered, of_pairs
from rigtwin.compare.diagnose.models.sensitivities import Mechanics
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.lab.records import Track
from rigtwin.sim.effects import Effect, named
from rigtwin.sim.reduced import flight

SIDEWAYS = 0.006  # [m/s], standard uncertainty of the horizontal release speed where the lab states none
LONGER = 1.3  # duration over that of the flight before, above which one of two impacts is false
RISES = 8.0  # height range, in units of the noise, below which a bead is at rest after an impact
ONE_MATERIAL = 0.015
"""Standard deviation between the restitutions of a bead on two plates of one material, apart from the bending of the
plates.  Assumed: two pieces differ in finish, and hardly by more than the scatter from impact to impact."""
SLOWEST = 1e-3  # [m/s], least speed after an impact; the bead rises by less than a tenth of a micrometre
SCALE, HEIGHT = 5e-4, 1e-4  # [1], [m]: where a fit of their scatter from repetition to repetition begins
# [1], [m]: largest usual scatter, of a camera that is set up anew for each drop, some 20 times that of one at rest
USUAL_SCALE, USUAL_HEIGHT = 0.02, 2e-3
LEAST_SCALE, LEAST_HEIGHT = 1e-5, 1e-6  # [1], [m]: lower limits of the fitted scatter, below what a track resolves
SLOW_FALL = 0.8  # [g], acceleration below which a fall, in a liquid for example, begins with it; chosen
LANDED = 5.0  # height above the plate, in units of the noise, below which a bead without a rebound has landed
FRICTION = 0.35  # sliding friction where the lab states none; matters only for fast spin
# finite-difference step as a share of a visible change, small even for a bead hardly heavier than its liquid, which is
# 30 times as sensitive; possible because the number of steps of a flight is the same for all settings
DROP_STEP = 1e-5


class DropBench:
    """All repetitions of a lab of drops."""

    bodies = 1
    onset = 0
    small = DROP_STEP
    per_run = ("conditions", "pair", "friction", "events", "active", "bead", "across")

    def __init__(self, lab: TrackedLab) -> None:
        self.lab = lab
        runs = [
            (c, condition, tracks[0]) for c, condition in enumerate(lab.conditions) for tracks in condition.repetitions
        ]
        self.condition = np.array([c for c, _, _ in runs])
        self.conditions = [condition for _, condition, _ in runs]
        self.radius = np.array([condition.bead.radius for _, condition, _ in runs])
        self.mass = np.array([condition.bead.mass for _, condition, _ in runs])
        self.beads = Beads([condition for _, condition, _ in runs])
        self.bead = self.beads.number
        height = np.array(lab.setting("drop_height_m"))
        self.pairs = list(dict.fromkeys(f"{c.bead.name}-{c.wall}" for _, c, _ in runs))
        self.pair = np.array([self.pairs.index(f"{c.bead.name}-{c.wall}") for _, c, _ in runs])
        self.like = _alike(lab)
        self.friction = np.array([lab.on_wall("sliding_friction_pw", c.wall, default=FRICTION) for _, c, _ in runs])
        self.noise = noise_of(lab, [track for _, _, track in runs])
        events = [
            _on_the_plate(track, impacts(track.time, track.position[:, 1], self.noise), condition.bead.radius)
            for _, condition, track in runs
        ]
        runs_events = list(zip(runs, events, strict=True))
        events = [_in_flight_after(track, found, self.noise) for (_, _, track), found in runs_events]
        ends = [
            _last_moment(track, found, cut, self.noise, lab.gravity, condition.bead.radius)
            for (_, condition, track), found, (_, cut) in zip(runs, events, runs_events, strict=True)
        ]
        kept = [track.time <= end for (_, _, track), end in zip(runs, ends, strict=True)]
        self.time = np.concatenate([track.time[keep] for (_, _, track), keep in zip(runs, kept, strict=True)])
        self.rows = np.concatenate([track.position[keep] for (_, _, track), keep in zip(runs, kept, strict=True)])
        lengths = [int(keep.sum()) for keep in kept]
        edges = np.concatenate([[0], np.cumsum(lengths)])
        self.spans = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        self.owner = np.repeat(np.arange(len(runs)), lengths)
        self.sigma = np.full(len(self.rows), self.noise)
        self.events = events
        self.condition_names = [condition.name for condition in lab.conditions]
        self.region, self.region_names = regions(self.time, self.spans, events)
        self.impacts = max(1, *(len(found) for found in events))
        # [m], (R, flights), where each flight starts, as the picture shows it
        self.across = np.stack(
            [
                _places(self.time[span], self.rows[span, 0], found, self.impacts)
                for span, found in zip(self.spans, events, strict=True)
            ]
        )
        self.active = np.array([[j < len(found) for j in range(self.impacts)] for found in events])
        repetitions, lost = len(runs), self.impacts
        self.local_prior = np.concatenate(
            [
                np.zeros((repetitions, 2)),
                (height + self.radius)[:, None],
                np.zeros((repetitions, 1)),
                np.ones((repetitions, lost)),
                np.zeros((repetitions, lost)),
                np.zeros((repetitions, 2)),
            ],
            axis=1,
        )
        self.set_up = 4 + 2 * lost
        tall = lab.uncertainty("drop_height_uncertainty_m", default=5e-4)
        # an impact that was not filmed is held by its prior
        unseen = np.where(self.active, np.inf, 1e-3)
        side_sd = lab.uncertainty("release_sideways_speed_m_s", default=SIDEWAYS)
        self.local_sd = np.concatenate(
            [np.tile([10.0, 0.01, tall, side_sd], (repetitions, 1)), unseen, unseen, np.full((repetitions, 2), np.inf)],
            axis=1,
        )
        self.local_sd[:, 2] *= shared(self.condition)
        self.local_step = np.array([1e-3, 1e-3, 1e-3, 1e-2, *([1e-2] * lost), *([1e-2] * lost), 1e-3, 1e-3])
        self.local_low = np.array([*([-np.inf] * 4), *([SLOWEST] * lost), *([-np.inf] * (lost + 2))])
        pairs = len(self.pairs)
        bounce = np.where(self.active, self.pair[:, None], -1)
        kick = np.where(self.active, pairs + 2, -1)
        # the bead's distance from the camera and the place of the plate in the picture differ from run to run
        set_up = np.tile([pairs, pairs + 1], (repetitions, 1))
        self.scatter = np.concatenate([bounce, kick, set_up], axis=1)
        self.scatter_start = np.array([*([0.02] * pairs), SCALE, HEIGHT, 0.02])
        self.scatter_least = np.array([*([LEAST_SCATTER] * pairs), LEAST_SCALE, LEAST_HEIGHT, LEAST_SCATTER])
        self.scatter_most = np.array([*([np.inf] * (pairs + 2)), named("odd_shape").parameters[0].least])

    @property
    def scattered(self) -> Sequence[Scattered]:
        """What differs from impact to impact or from repetition to repetition."""
        return (
            *of_pairs("restitution", self.pairs),
            Scattered("scale of the picture", "1", USUAL_SCALE),
            Scattered("height of the plate in the picture", "m", USUAL_HEIGHT),
            Scattered("sideways over impact speed", "1", named("odd_shape").parameters[0].least),
        )

    def unknowns(self, terms: Sequence[Effect]) -> list[Unknown]:
        """Restitution of each pair, calibration quantities with their priors, and coefficients of the terms."""
        own = [
            Unknown(f"restitution.{pair}", 0.5, 0.05, low=0.01, high=1.2)
            if like == number
            else Unknown(f"restitution_beside.{pair}", 0.0, 0.05, sd=ONE_MATERIAL, low=-1.0, high=1.0)
            for number, (pair, like) in enumerate(zip(self.pairs, self.like, strict=True))
        ]
        level = math.radians(self.lab.uncertainty("plate_level_uncertainty_deg", default=0.1))
        priors = {"plate_tilt": level}
        return [*own, *self.beads.unknowns(), *camera_unknowns(self.lab, terms, priors)]

    def first_guess(self, values: Mapping[str, float]) -> Array:
        """Starting values (R, L) of releases and impacts, from jumps of speed, times between them, and slopes."""
        clock = 1.0 + values.get("frame_rate_error.relative", 0.0)
        guess = self.local_prior.copy()
        n = self.impacts
        for r, span in enumerate(self.spans):
            time, place = self.time[span] / clock, self.rows[span]
            found = np.asarray(self.events[r]) / clock
            x, y = place[:, 0], place[:, 1]
            fall = max(y[:5].mean() - self.radius[r], 1e-3)
            part, further = (int(np.argmax(y < y[:5].mean() - share * fall)) for share in (0.1, 0.4))
            # a uniformly accelerated fall needs twice the time for 40 % of its height as for 10 %
            taken, free = time[further] - time[part], math.sqrt(0.2 * fall / self.lab.gravity)
            held_up = taken > free / math.sqrt(SLOW_FALL) + 2 * float(np.median(np.diff(time)))
            gravity = 0.2 * fall / taken**2 if held_up else self.lab.gravity
            guess[r, 0] = max(time[part] - math.sqrt(0.2 * fall / gravity), 0.0)
            guess[r, 1] = float(np.median(x[: max(part // 2, 3)]))
            guess[r, 2] = self.local_prior[r, 2]
            for j, event in enumerate(found):
                after = found[j + 1] if j + 1 < len(found) else time[-1]
                inside = (time > event) & (time < after)
                if j + 1 < len(found):
                    guess[r, 4 + j] = gravity * (after - event) / 2
                else:
                    s = time[inside] - event
                    rise = y[inside] - self.radius[r] + gravity * s * s / 2
                    guess[r, 4 + j] = float(np.sum(rise * s) / max(np.sum(s * s), 1e-12)) if len(s) else 0.1
                guess[r, 4 + j] = max(guess[r, 4 + j], 0.02)
                if inside.sum() > 3:
                    guess[r, 4 + n + j] = float(np.polyfit(time[inside], x[inside], 1)[0])
        return guess

    def mechanics(
        self, unknowns: Sequence[Unknown], terms: Sequence[Effect], local: Array, values: Array, true: Array
    ) -> Mechanics:
        """The motion and its derivatives.

        A flight depends only on its own start; earlier flights shift its beginning.  So each flight is integrated
        again only for its two start speeds, the height of the fall, and each unknown that acts in flight.
        """
        n, size = self.impacts, local.shape[1]
        flown = [k for k, u in enumerate(unknowns) if self._in_flight(u.name, terms)]
        settings = 1 + len(flown)
        stack = np.repeat(values[None], settings, axis=0)
        for row, k in enumerate(flown, start=1):
            stack[row, k] += self.small * unknowns[k].step
        by_name = {u.name: stack[:, k] for k, u in enumerate(unknowns)}
        vx, vy, gap, sine, cosine = self._starts(np.repeat(local[None], settings, axis=0), by_name)
        step_v, step_h = 1e-5, 1e-6  # [m/s], [m]
        own = _Own(
            np.concatenate([vx, vx[:1] + step_v, vx[:1], vx[:1]]),
            np.concatenate([vy, vy[:1], vy[:1] + step_v, vy[:1]]),
            np.concatenate([gap, gap[:1], gap[:1], gap[:1] + step_h]),
            np.concatenate([sine, *([sine[:1]] * 3)]),
            np.concatenate([cosine, *([cosine[:1]] * 3)]),
        )
        repeated = {name: np.concatenate([one, np.repeat(one[:1], 3)]) for name, one in by_name.items()}
        paths = flight.fly(
            own.vx, own.vy, own.gap, own.sine, own.cosine,
            radius=self.radius[:, None], mass=self.mass[:, None], gravity=self.lab.gravity, terms=terms,
            values=repeated, across=self.across,
        )  # fmt: skip
        begin, x_start, y_start = self._laid_out(local, paths, settings)
        same = [np.concatenate([one, *([one[:1]] * 3)]) for one in (begin, x_start, y_start)]
        x, y, u, v = flight.where(paths, same[0], same[1], same[2], true, self.owner)
        number = (true[None] >= np.moveaxis(begin[0][self.owner], 1, 0)[1:]).sum(0)
        by_row = np.zeros((size + len(unknowns), len(true), 2))
        by_soft = np.zeros((size + len(unknowns), len(self.spans), 2 * n))
        for row, k in enumerate(flown, start=1):
            step = self.small * unknowns[k].step
            by_row[size + k, :, 0], by_row[size + k, :, 1] = (x[row] - x[0]) / step, (y[row] - y[0]) / step
        velocity = np.stack([u[0], v[0]], axis=-1)
        within = [
            np.stack([x[row] - x[0], y[row] - y[0]], axis=-1) / step
            for row, step in ((-3, step_v), (-2, step_v), (-1, step_h))
        ]
        onward = [_Onward(paths, row, step) for row, step in ((-3, step_v), (-2, step_v), (-1, step_h))]
        s0, c0 = float(sine[0, 0, 0]), float(cosine[0, 0, 0])

        def column(k: int, leg: int, weights: tuple[float, float, float], shift: tuple[float, float]) -> None:
            """Derivatives for a local unknown that changes the start of one flight and so shifts the later ones."""
            here, later = number == leg, number > leg
            move = sum(w * one for w, one in zip(weights, within, strict=True)) + np.array(shift)
            land = sum(w * one.place[:, leg] for w, one in zip(weights, onward, strict=True)) + np.array(shift)
            late = np.asarray(sum(w * one.late[:, leg] for w, one in zip(weights, onward, strict=True)))
            by_row[k] = np.where(here[:, None], move, 0.0)
            after = land[self.owner] - velocity * late[self.owner][:, None]
            by_row[k] += np.where(later[:, None], after, 0.0)

        by_row[0] = -velocity
        column(1, 0, (0.0, 0.0, -s0), (1.0, 0.0))
        column(2, 0, (0.0, 0.0, c0), (0.0, 1.0))
        column(3, 0, (1.0, 0.0, 0.0), (0.0, 0.0))
        for j in range(n):
            column(4 + j, j + 1, (-s0, c0, 0.0), (0.0, 0.0))
            column(4 + n + j, j + 1, (c0, s0, 0.0), (0.0, 0.0))
        soft = self._soft_slopes(unknowns, terms, local, values, paths, onward, flown, by_soft)
        return Mechanics(x[0], y[0], u[0], v[0], soft, by_row, by_soft)

    def touches(self, name: str) -> tuple[str, Array] | None:
        """A restitution acts in the repetitions of its pair or of pairs of one material, a diameter in its bead's."""
        kind, _, rest = name.partition(".")
        if kind == "diameter":
            return kind, self.bead == self.beads.names.index(rest)
        if kind == "restitution":
            return kind, np.array(self.like)[self.pair] == self.pairs.index(rest)
        return (kind, self.pair == self.pairs.index(rest)) if kind == "restitution_beside" else None

    def _in_flight(self, name: str, terms: Sequence[Effect]) -> bool:
        """Whether a global unknown changes the flight of a bead, and not only the contact law or the picture."""
        effect = name.split(".", maxsplit=1)[0]
        if effect in ("plate_tilt", "release_speed", "diameter"):
            return True
        return any(term.name == effect and (term.force is not None or term.sideways is not None) for term in terms)

    def _starts(self, local: Array, values: Mapping[str, Array]) -> tuple[Array, Array, Array, Array, Array]:
        """Speeds [m/s] at the start of each flight, height of fall [m], and sine and cosine of the plate's tilt."""
        n = self.impacts
        tilt = values["plate_tilt.angle"][:, None, None]
        sine, cosine = np.sin(tilt), np.cos(tilt)
        x0, y0, vx0 = (local[..., k] for k in (1, 2, 3))
        up = np.where(self.active, np.maximum(local[..., 4 : 4 + n], SLOWEST), 1.0)
        along = local[..., 4 + n : 4 + 2 * n]
        # flight 0 starts at the holder, flight j at the plate
        vx = np.concatenate([vx0[..., None], along * cosine - up * sine], axis=2)
        release = values.get("release_speed.speed", np.zeros(len(local)))[:, None, None]
        vy = np.concatenate([0 * vx0[..., None] + release, along * sine + up * cosine], axis=2)
        radius = self.radius + 0.5 * self.beads.of("diameter", values, self.bead)
        fall = (y0 * cosine[..., 0] - x0 * sine[..., 0] - radius)[..., None]
        return vx, vy, np.concatenate([np.maximum(fall, 1e-5), np.zeros_like(up)], axis=2), sine, cosine

    def _laid_out(self, local: Array, paths: flight.Paths, settings: int) -> tuple[Array, Array, Array]:
        """Time [s] and position [m] of the beginning of each flight."""
        n = self.impacts
        found = []
        for first, legs in ((local[:, 0], paths.duration), (local[:, 1], paths.land_x), (local[:, 2], paths.land_y)):
            start = np.repeat(first[None, :, None], settings, axis=0)
            found.append(np.concatenate([start, start + np.cumsum(legs[:settings, :, :n], axis=2)], axis=2))
        found[0][..., 1:] = np.where(self.active, found[0][..., 1:], np.inf)
        return found[0], found[1], found[2]

    def _soft_slopes(
        self, unknowns: Sequence[Unknown], terms: Sequence[Effect], local: Array, values: Array, paths: flight.Paths,
        onward: Sequence[_Onward], flown: Sequence[int], by_soft: Array,
    ) -> Array:  # fmt: skip
        """Deviations of the impacts from the contact law; writes their derivatives into `by_soft`."""
        n, size = self.impacts, local.shape[1]
        count = size + len(unknowns)
        locals_ = np.repeat(local[None], 1 + count, axis=0)
        stack = np.repeat(values[None], 1 + count, axis=0)
        steps = self.small * np.concatenate([self.local_step, [u.step for u in unknowns]])
        for k in range(size):
            locals_[1 + k, :, k] += steps[k]
        for k in range(len(unknowns)):
            stack[1 + size + k, k] += steps[size + k]
        land_vx = np.repeat(paths.land_vx[:1], 1 + count, axis=0)
        land_vy = np.repeat(paths.land_vy[:1], 1 + count, axis=0)
        tilt = stack[:, [u.name for u in unknowns].index("plate_tilt.angle")][:, None, None]
        sine, cosine = np.sin(tilt), np.cos(tilt)
        s0, c0 = float(sine[0, 0, 0]), float(cosine[0, 0, 0])

        def change(k: int, leg: int, weights: tuple[float, float, float]) -> None:
            for weight, one in zip(weights, onward, strict=True):
                land_vx[1 + k, :, leg] += weight * steps[k] * one.vx[:, leg]
                land_vy[1 + k, :, leg] += weight * steps[k] * one.vy[:, leg]

        change(1, 0, (0.0, 0.0, -s0))
        change(2, 0, (0.0, 0.0, c0))
        change(3, 0, (1.0, 0.0, 0.0))
        for j in range(n):
            change(4 + j, j + 1, (-s0, c0, 0.0))
            change(4 + n + j, j + 1, (c0, s0, 0.0))
        for row, k in enumerate(flown, start=1):
            land_vx[1 + size + k], land_vy[1 + size + k] = paths.land_vx[row], paths.land_vy[row]
        by_name = {u.name: stack[:, k] for k, u in enumerate(unknowns)}
        soft = self._soft(locals_, by_name, terms, (land_vx, land_vy), sine, cosine)
        by_soft[:] = (soft[1:] - soft[0]) / steps[:, None, None]
        return np.asarray(soft[0])

    def _soft(
        self,
        local: Array,
        values: Mapping[str, Array],
        terms: Sequence[Effect],
        landing: tuple[Array, Array],
        sine: Array,
        cosine: Array,
    ) -> Array:
        """Deviation of each impact from the contact law: in restitution, and in horizontal speed over impact speed."""
        n = self.impacts
        land_vx, land_vy = landing
        speed_in = np.maximum(land_vx * sine - land_vy * cosine, 1e-3)[..., :n]
        along_in = (land_vx * cosine + land_vy * sine)[..., :n]
        up, along = local[..., 4 : 4 + n], local[..., 4 + n : 4 + 2 * n]
        plain = np.stack(list(self.restitutions(values).values()), axis=-1)[:, self.pair, None]
        e = plain + 0 * speed_in
        for term in terms:
            if term.restitution is not None:
                own = coefficients(term, values, self.lab, self.conditions)
                e = term.restitution(e, speed_in, self.radius[:, None], self.mass[:, None], *own)
        spin = values.get("release_spin.spin", np.zeros(len(local)))[:, None] * self.radius
        sideways = np.zeros_like(e)
        for j in range(n):
            slip = along_in[..., j] + spin
            most = self.friction * (1 + e[..., j]) * speed_in[..., j]
            change = np.clip(-2 / 7 * slip, -most, most)
            sideways[..., j] = along[..., j] - along_in[..., j] - change
            spin = spin + 2.5 * change
        bounce = np.where(self.active, up / speed_in - e, 0.0)
        return np.concatenate([bounce, np.where(self.active, sideways / speed_in, 0.0)], axis=2)

    def restitutions(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Restitution of each pair, before any effect."""
        found: dict[str, Any] = {}
        for number, (pair, like) in enumerate(zip(self.pairs, self.like, strict=True)):
            first = values[f"restitution.{self.pairs[like]}"]
            found[pair] = first if like == number else first + values[f"restitution_beside.{pair}"]
        return found


def _places(time: Array, x: Array, events: Sequence[float], impacts: int) -> Array:
    """Place along x [m] of the release and of each impact, shape (1 + impacts,); the last one for those not filmed."""
    seen = np.interp([time[0], *events], time, x)
    return np.pad(seen, (0, impacts + 1 - len(seen)), mode="edge")


def _alike(lab: TrackedLab) -> list[int]:
    """For each pair of bead and plate, the index of the first pair with this bead and a plate of the same material."""
    pairs = list({f"{c.bead.name}-{c.wall}": (c.bead.name, c.wall) for c in lab.conditions}.values())
    found: list[int] = []
    for number, (bead, wall) in enumerate(pairs):
        firsts = [k for k in range(number) if found[k] == k and pairs[k][0] == bead and lab.alike(pairs[k][1], wall)]
        found.append(firsts[0] if firsts else number)
    return found


@dataclass(frozen=True)
class _Own:
    """Starts of flights for a stack of settings."""

    vx: Array
    vy: Array
    gap: Array
    sine: Array
    cosine: Array


class _Onward:
    """Derivatives of a flight's landing with respect to one number of its start, shape (R, flights)."""

    def __init__(self, paths: flight.Paths, row: int, step: float) -> None:
        def slope(series: Array) -> Array:
            return np.asarray((series[row] - series[0]) / step)

        self.late = slope(paths.duration)
        self.place = np.stack([slope(paths.land_x), slope(paths.land_y)], axis=-1)
        self.vx, self.vy = slope(paths.land_vx), slope(paths.land_vy)


PARTS = ("first", "middle", "last")


def regions(time: Array, spans: Sequence[slice], events: Sequence[Sequence[float]]) -> tuple[Array, list[str]]:
    """Region number of each row, shape (N,), and region names: thirds of the fall and of each flight; -1 for none."""
    most = max(len(found) for found in events)
    names = [
        f"{part} third of the {'fall' if j == 0 else f'flight after impact {j}'}"
        for j in range(most + 1)
        for part in PARTS
    ]
    region = np.full(len(time), -1)
    for span, found in zip(spans, events, strict=True):
        t = time[span]
        edges = [float(t[0]), *found, float(t[-1])]
        number = np.searchsorted(np.asarray(found), t)
        for j in range(len(found) + 1):
            inside = number == j
            length = max(edges[j + 1] - edges[j], 1e-9)
            # rows close to an impact may lie before or after it
            clear = (t > edges[j] + 0.006) & (t < edges[j + 1] - 0.006) if j else t < edges[1] - 0.006
            part = np.minimum(((t - edges[j]) / length * 3).astype(int), 2)
            region[span] = np.where(inside & clear, 3 * j + part, region[span])
    return region, names


def impacts(time: Array, height: Array, noise: float) -> list[float]:
    """Times [s] at which the vertical speed jumps upwards, from slopes over four rows before and after.

    A jump must exceed the noise of such slopes; smaller bounces cannot be separated from rest.
    """
    width = 4
    n = len(time)
    slope = _slopes(time, height, width)  # of the rows i .. i + width - 1
    jump = np.full(n, -np.inf)
    jump[width : n - width + 1] = slope[width:] - slope[: n - 2 * width + 1]
    step = float(np.median(np.diff(time)))
    least = max(6 * noise / (step * math.sqrt(2.5)), 0.06)
    found: list[float] = []
    order = np.argsort(-jump)
    taken = np.zeros(n, dtype=bool)
    for i in order:
        if jump[i] < least:
            break
        if not taken[max(i - width, 0) : i + width + 1].any():
            found.append(float((time[i - 1] + time[i]) / 2))
            taken[i] = True
    return sorted(found)


def _on_the_plate(track: Track, found: Sequence[float], radius: float) -> list[float]:
    """The impacts that are near the plate; a jump of the track further up is not an impact."""
    height = track.position[:, 1]
    step = float(np.median(np.diff(track.time)))
    fastest = float(np.abs(np.diff(height)).max()) / step
    # margins for an origin off by a radius, a scale off by a few percent, and an impact between two rows
    highest = 2 * radius + fastest * step + 0.05 * float(height[:5].mean())
    level = {event: float(np.interp(event, track.time, height)) for event in found}
    kept = [event for event in found if level[event] < highest]
    # no flight lasts much longer than the one before: else the higher one of the two jumps is false
    for k in range(len(kept) - 3, -1, -1):
        if kept[k + 2] - kept[k + 1] > LONGER * (kept[k + 1] - kept[k]):
            kept.remove(max(kept[k], kept[k + 1], key=level.__getitem__))
    return kept


def _slopes(time: Array, value: Array, width: int) -> Array:
    """Slope of each window of `width` rows."""
    t = np.lib.stride_tricks.sliding_window_view(time, width)
    s = t - t.mean(axis=1, keepdims=True)
    return np.asarray(np.sum(s * np.lib.stride_tricks.sliding_window_view(value, width), axis=1) / np.sum(s * s, 1))


def _in_flight_after(track: Track, found: Sequence[float], noise: float) -> list[float]:
    """The impacts without the last ones after which the bead does not rise, because it is at rest."""
    kept = list(found)
    while len(kept) > 1:
        height = track.position[track.time > kept[-1], 1]
        if len(height) > 2 and float(np.ptp(height)) > RISES * noise:
            break
        kept.pop()
    return kept


def _last_moment(
    track: Track, found: Sequence[float], every: Sequence[float], noise: float, gravity: float, radius: float
) -> float:
    """End [s] of the rows that are used: before a next impact that was not detected."""
    time = track.time
    end = float(time[-1])
    if found:
        lying = track.position[time > found[-1] + float(np.median(np.diff(time))), 1]
        if len(lying) > 2 and float(np.ptp(lying)) <= RISES * noise:
            # a flight lower than the noise cannot be separated from rest; it lasts this long at most
            return found[-1] + math.sqrt(4 * noise / gravity)
    if len(every) > len(found):
        return every[len(found)]
    if not found:  # a bead that lands without a rebound, in a liquid or on sand
        lies = np.flatnonzero(track.position[:, 1] < radius + LANDED * noise)
        return float(time[lies[0]]) if len(lies) else end
    after = time > found[-1]
    if after.sum() > 2:
        rise = track.position[after, 1] - float(track.position[:, 1].min())
        top = int(np.argmax(rise))
        down = np.flatnonzero(rise[top:] < max(5 * noise, 0.1 * float(rise.max())))
        if len(down):
            end = float(time[after][top + down[0]])
    if len(found) < 2:
        return end
    pause = found[-1] - found[-2]
    # the flight after the last impact seen is shorter than the one before; stop before its end
    ratio = min(pause / max(found[-2] - found[-3], 1e-6), 0.95) if len(found) > 2 else 0.3
    return min(end, found[-1] + 0.9 * ratio * pause)
