"""The drop test as the diagnosis sees it: flights integrated, impacts exact, every impact free to scatter.

Each repetition has its own release (time, place, sideways speed) and, at each impact, its own speed after it along and
across the plate.  The restitution and the rebound direction that follow are random effects around the contact law.
World axes: x right, y up, origin on the plate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from rigtwin.compare.diagnose import flight
from rigtwin.compare.diagnose.camera import camera_unknowns, exposed, noise_of, viewed
from rigtwin.compare.diagnose.fit import Seen, Unknown
from rigtwin.compare.diagnose.labs import TrackedLab
from rigtwin.lab.records import Array
from rigtwin.sim.effects import Effect

FRICTION = 0.35  # sliding friction where the lab states none; acts only on fast spin


class DropBench:
    """All repetitions of a lab of drops."""

    def __init__(self, lab: TrackedLab) -> None:
        self.lab = lab
        runs = [
            (c, condition, tracks[0]) for c, condition in enumerate(lab.conditions) for tracks in condition.repetitions
        ]
        self.condition = np.array([c for c, _, _ in runs])
        self.radius = np.array([condition.bead.radius for _, condition, _ in runs])
        self.mass = np.array([condition.bead.mass for _, condition, _ in runs])
        height = np.array([float(condition.settings["drop_height_m"]) for _, condition, _ in runs])
        self.pairs = list(dict.fromkeys(f"{c.bead.name}-{c.wall}" for _, c, _ in runs))
        self.pair = np.array([self.pairs.index(f"{c.bead.name}-{c.wall}") for _, c, _ in runs])
        stated = lab.geometry.get("sliding_friction_pw") or {}
        self.friction = np.array([float(stated.get(c.wall, FRICTION)) for _, c, _ in runs])
        self.noise = noise_of(lab, [track for _, _, track in runs])
        events = [impacts(track.time, track.position[:, 1], self.noise) for _, _, track in runs]
        ends = [_last_moment(track.time, found, lab.gravity) for (_, _, track), found in zip(runs, events, strict=True)]
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
        self.active = np.array([[j < len(found) for j in range(self.impacts)] for found in events])
        repetitions = len(runs)
        self.names = ["t0", "x0", "y0", "vx0"]
        lost = self.impacts
        self.local_prior = np.concatenate(
            [
                np.zeros((repetitions, 2)),
                (height + self.radius)[:, None],
                np.zeros((repetitions, 1)),
                np.ones((repetitions, lost)),
                np.zeros((repetitions, lost)),
            ],
            axis=1,
        )
        tall = lab.known("drop_height_uncertainty_m", default=5e-4)
        # an impact that was not filmed is tied to its prior alone
        unseen = np.where(self.active, np.inf, 1e-3)
        self.local_sd = np.concatenate([np.tile([10.0, 0.01, tall, 0.006], (repetitions, 1)), unseen, unseen], axis=1)
        self.local_step = np.array([1e-3, 1e-3, 1e-3, 1e-2, *([1e-2] * lost), *([1e-2] * lost)])
        pairs = len(self.pairs)
        bounce = np.where(self.active, self.pair[:, None], -1)
        kick = np.where(self.active, pairs, -1)
        self.scatter = np.concatenate([bounce, kick], axis=1)
        self.scatter_start = np.full(pairs + 1, 0.03)

    def unknowns(self, terms: Sequence[Effect]) -> list[Unknown]:
        """Restitution of each pair, the calibration quantities with their priors, and the terms' coefficients."""
        own = [Unknown(f"restitution.{pair}", 0.5, 0.05, low=0.01, high=1.2) for pair in self.pairs]
        level = math.radians(self.lab.known("plate_level_uncertainty_deg", default=0.1))
        priors = {"plate_tilt": level}
        return [*own, *camera_unknowns(self.lab, terms, priors)]

    def first_guess(self, values: Mapping[str, float]) -> Array:
        """Release and impacts read off the tracks themselves: speed jumps, times between them, slopes."""
        clock = 1.0 + values.get("frame_rate_error.relative", 0.0)
        gravity = self.lab.gravity
        guess = self.local_prior.copy()
        n = self.impacts
        for r, span in enumerate(self.spans):
            time, place = self.time[span] / clock, self.rows[span]
            found = np.asarray(self.events[r]) / clock
            x, y = place[:, 0], place[:, 1]
            fall = max(y[:5].mean() - self.radius[r], 1e-3)
            part = int(np.argmax(y < y[:5].mean() - 0.1 * fall))
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

    def predict(self, local: Array, values: Mapping[str, Array], terms: Sequence[Effect]) -> Seen:
        """Fly, bounce and film all repetitions for a stack of settings."""
        n = self.impacts
        tilt = values["plate_tilt.angle"][:, None, None]
        sine, cosine = np.sin(tilt), np.cos(tilt)
        t0, x0, y0, vx0 = (local[..., k] for k in range(4))
        up = np.where(self.active, np.maximum(local[..., 4 : 4 + n], 1e-3), 1.0)
        along = local[..., 4 + n : 4 + 2 * n]
        # flight 0 starts at the holder, flight j at the plate
        start_vx = np.concatenate([vx0[..., None], along * cosine - up * sine], axis=2)
        release = values.get("release_speed.speed", np.zeros(len(local)))[:, None, None]
        start_vy = np.concatenate([0 * vx0[..., None] + release, along * sine + up * cosine], axis=2)
        drop = (y0 * cosine[..., 0] - x0 * sine[..., 0] - self.radius)[..., None]
        gap = np.concatenate([np.maximum(drop, 1e-5), np.zeros_like(up)], axis=2)
        paths = flight.fly(
            start_vx,
            start_vy,
            gap,
            sine,
            cosine,
            radius=self.radius[:, None],
            mass=self.mass[:, None],
            gravity=self.lab.gravity,
            terms=terms,
            values=values,
        )
        begin = np.concatenate([t0[..., None], t0[..., None] + np.cumsum(paths.duration[..., :n], axis=2)], axis=2)
        begin[..., 1:] = np.where(self.active, begin[..., 1:], np.inf)
        x_start = np.concatenate([x0[..., None], x0[..., None] + np.cumsum(paths.land_x[..., :n], axis=2)], axis=2)
        y_start = np.concatenate([y0[..., None], y0[..., None] + np.cumsum(paths.land_y[..., :n], axis=2)], axis=2)
        time = exposed(self.time, self.rows, values, terms)
        x, y, vx, vy = flight.where(paths, begin, x_start, y_start, time, self.owner)
        speed = np.stack([vx[0], vy[0]], axis=-1)
        position = np.stack(viewed(x, y, values, terms), axis=-1)
        return Seen(position, self._soft(local, values, terms, paths, sine, cosine), speed)

    def _soft(
        self,
        local: Array,
        values: Mapping[str, Array],
        terms: Sequence[Effect],
        paths: flight.Paths,
        sine: Array,
        cosine: Array,
    ) -> Array:
        """How far each impact is from the contact law: in restitution, and sideways per impact speed."""
        n = self.impacts
        speed_in = np.maximum(paths.land_vx * sine - paths.land_vy * cosine, 1e-3)[..., :n]
        along_in = (paths.land_vx * cosine + paths.land_vy * sine)[..., :n]
        up, along = local[..., 4 : 4 + n], local[..., 4 + n : 4 + 2 * n]
        plain = np.stack([values[f"restitution.{pair}"] for pair in self.pairs], axis=-1)[:, self.pair][..., None]
        e = plain + 0 * speed_in
        for term in terms:
            if term.restitution is not None:
                own = [values[f"{term.name}.{p.name}"][:, None, None] for p in term.parameters]
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


PARTS = ("first", "middle", "last")


def regions(time: Array, spans: Sequence[slice], events: Sequence[Sequence[float]]) -> tuple[Array, list[str]]:
    """Thirds of the fall and of each flight after an impact, by number; -1 where the next impact is not seen."""
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
            # within a frame of an impact the bead may be on either side of it
            clear = (t > edges[j] + 0.006) & (t < edges[j + 1] - 0.006) if j else t < edges[1] - 0.006
            part = np.minimum(((t - edges[j]) / length * 3).astype(int), 2)
            region[span] = np.where(inside & clear, 3 * j + part, region[span])
    return region, names


def impacts(time: Array, height: Array, noise: float) -> list[float]:
    """[s] the moments at which the speed jumps upwards, from slopes of four rows before and after.

    A jump counts where it stands out of the noise of such slopes; smaller bounces are not told from rest.
    """
    n, width = len(time), 4
    jump = np.full(n, -np.inf)
    for i in range(width, n - width + 1):
        a, b = slice(i - width, i), slice(i, i + width)
        before, after = _slope(time[a], height[a]), _slope(time[b], height[b])
        jump[i] = after - before
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


def _slope(time: Array, value: Array) -> float:
    s = time - time.mean()
    return float(np.sum(s * value) / np.sum(s * s))


def _last_moment(time: Array, found: Sequence[float], gravity: float) -> float:
    """[s] the end of what is used: before the bead can have touched again unseen."""
    if len(found) < 2:
        return float(time[-1])
    pause = found[-1] - found[-2]
    # the flight after the last impact seen is shorter than the one before; stop before its end
    ratio = min(pause / max(found[-2] - found[-3], 1e-6), 0.95) if len(found) > 2 else 0.3
    return float(min(time[-1], found[-1] + 0.9 * ratio * pause))
