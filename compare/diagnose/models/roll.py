"""Reduced model of a rolling bead: down an incline from rest, or along a level surface after a push.

World axes: x right (horizontal), y up, origin at the contact point at the start.  The bead rolls without slipping, to
the right or to the left as its track shows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import Condition, TrackedLab
from rigtwin.compare.diagnose.models.camera import camera_unknowns
from rigtwin.compare.diagnose.models.rows import Runs
from rigtwin.compare.diagnose.models.scattered import of_pairs
from rigtwin.compare.diagnose.models.sensitivities import SMALL, Moved
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect
from rigtwin.sim.reduced.track import place_at, ride

LEVER, TIED = "rolling_lever", 1e-6
"""Effect with one lever arm for all sizes; it replaces the coefficients of the pairs, whose priors are then zero with
this standard deviation."""
WIDEST = 1.5  # ratio of largest to smallest size below which 1/d and a common coefficient are hardly separable
FEWEST_SIZES = 3  # smallest number of sizes of one material that can support a common lever arm
ROLLS = 5 / 7  # acceleration of a rolling solid sphere over that of a sliding one
EARLY = 0.4  # share of the path that determines the start of a bead that is slowed by drag


class RollBench(Runs):
    """All repetitions of a lab of rolling beads."""

    bodies = 1
    onset = 0
    small = SMALL
    drivable = True
    per_run = ("conditions", "slope", "push", "side", "turned", "faces", "pair", "bead")

    def __init__(self, lab: TrackedLab) -> None:
        super().__init__(lab)
        self.slope = np.radians(self.setting("incline_angle_deg", 0.0))
        self.push = np.abs(self.setting("push_speed_m_s", 0.0))
        ways = [self.rows[span][-5:, 0].mean() - self.rows[span][:5, 0].mean() for span in self.spans]
        self.side = np.where(np.array(ways) < 0, -1.0, 1.0)
        self.turned = orientation(self.conditions)
        # a run the other way whose x still grows is filmed from the other side, or its x counts along the run
        self.faces = np.where(_stated(self.conditions, "run_reversed") & (self.side > 0), -1.0, 1.0)
        self.pairs = list(dict.fromkeys(f"{c.bead.name}-{c.wall}" for c in self.conditions))
        self.pair = np.array([self.pairs.index(f"{c.bead.name}-{c.wall}") for c in self.conditions])
        count = len(self.conditions)
        pushed = self.push > 0
        # release time, starting place, speed at the start, rolling friction of this repetition
        self.local_prior = np.stack([np.zeros(count), np.zeros(count), self.push, np.full(count, 0.03)], axis=1)
        self.local_sd = np.stack(
            [
                np.full(count, 10.0), np.full(count, 2e-3), np.where(pushed, 0.1 * self.push + 1e-6, 1e-5),
                np.full(count, np.inf),
            ],
            axis=1,
        )  # fmt: skip
        self.local_step = np.array([1e-3, 1e-3, 1e-2, 1e-3])
        self.local_low = np.full(len(self.local_step), -np.inf)
        self.scatter = self.pair[:, None].copy()
        self.scattered = of_pairs("rolling_friction", self.pairs)
        self.scatter_start = np.full(len(self.pairs), 3e-3)
        self.scatter_most = np.full(len(self.pairs), np.inf)

    def unknowns(self, terms: Sequence[Effect]) -> list[Unknown]:
        """Rolling friction of each pair; angle of each condition, level and calibration with their priors."""
        start, tie = (0.0, TIED) if any(term.name == LEVER for term in terms) else (0.03, math.inf)
        own = [Unknown(f"rolling_friction.{pair}", start, 3e-3, sd=tie, low=0.0, high=1.0) for pair in self.pairs]
        angle_sd = math.radians(self.lab.uncertainty("incline_angle_uncertainty_deg", default=0.05))
        tips = [Unknown(f"angle.{name}", 0.0, 1e-3, sd=angle_sd) for name in self.condition_names]
        level = math.radians(self.lab.uncertainty("plate_level_uncertainty_deg", default=0.1))
        return [*own, *tips, *self.beads.unknowns(), *camera_unknowns(self.lab, terms, {"plate_tilt": level})]

    def first_guess(self, values: Mapping[str, float]) -> Array:
        """Starting values (R, L): release time from the first motion, friction from a parabola through the path."""
        clock = 1.0 + values.get("frame_rate_error.relative", 0.0)
        guess = self.local_prior.copy()
        gravity = self.lab.gravity
        for r, span in enumerate(self.spans):
            time = self.time[span] / clock
            place = self.side[r] * self.rows[span][:, 0] / math.cos(self.slope[r])
            place = place - float(np.median(place[:3]))
            moved = int(np.argmax(place > max(0.06 * float(place.max()), 6 * self.noise)))
            if self.push[r] > 0:
                t0, bend, speed = self._pushed(time[moved:], place[moved:])
                if self._misses(time[moved:], place[moved:]):
                    # drag falls with the speed: the early part gives the start, the late part the friction
                    half = moved + int(np.argmax(place[moved:] > EARLY * place.max()))
                    t0, _, speed = self._pushed(time[moved:half], place[moved:half])
                    bend = self._pushed(time[half:], place[half:])[1]
                guess[r, 2] = min(max(speed, 0.7 * self.push[r]), 1.3 * self.push[r])
                guess[r, 0] = max(t0, 0.0)
                guess[r, 3] = np.clip(-bend / ROLLS / gravity, 1e-3, 0.5)
            else:
                quadratic = np.polyfit(time[moved:], place[moved:], 2)
                bend = max(2 * float(quadratic[0]), 1e-3)
                guess[r, 0] = max(float(-quadratic[1] / (2 * quadratic[0])), 0.0) if quadratic[0] > 0 else time[moved]
                friction = math.tan(self.slope[r]) - bend / ROLLS / gravity / math.cos(self.slope[r])
                guess[r, 3] = np.clip(friction, 1e-3, 0.5)
        return guess

    def _misses(self, time: Array, place: Array) -> bool:
        """Whether the residuals of a parabola through the moving part far exceed the noise."""
        moving = place < 0.97 * place.max()
        left = place[moving] - np.polyval(np.polyfit(time[moving], place[moving], 2), time[moving])
        return float(np.std(left)) > 5 * self.noise

    @staticmethod
    def _pushed(time: Array, place: Array) -> tuple[float, float, float]:
        """Start time [s], acceleration [m/s^2] and start speed [m/s] from a parabola through the moving part."""
        moving = place < 0.97 * place.max()
        quadratic = np.polyfit(time[moving], place[moving], 2)
        a, b, c = (float(value) for value in quadratic)
        inside = b * b - 4 * a * c
        if a >= 0 or inside <= 0:
            return float(time[0]), -0.1, float(np.polyfit(time[moving], place[moving], 1)[0])
        t0 = (-b + math.sqrt(inside)) / (2 * a)
        return t0, 2 * a, 2 * a * t0 + b

    def move(self, local: Array, values: Mapping[str, Array], terms: Sequence[Effect], true: Array, seen: int) -> Moved:
        """Motion of all repetitions for a stack of settings."""
        tips = np.stack([values[f"angle.{name}"] for name in self.condition_names], axis=-1)[:, self.condition]
        level = values["plate_tilt.angle"][:, None]
        if "surface_slope.angle" in values:
            level = level + values["surface_slope.angle"][:, None] * self.turned
        every = self.slope + tips + self.side * self.faces * level
        # the local unknown is the friction on the stated slope: a slope error and the friction error that compensates
        # it give the same motion
        stated = np.sin(self.slope) - local[..., 3] * np.cos(self.slope)
        frictions = (np.sin(every) - stated) / np.cos(every)
        slope, friction = every[:seen], frictions[:seen]
        t0, start, push = (local[:seen, :, k] for k in range(3))
        sine, cosine = np.sin(slope), np.cos(slope)
        acting = [
            (term, [values[f"{term.name}.{p.name}"][:seen, None] for p in term.parameters])
            for term in terms
            if term.name != LEVER
            and any(hook is not None for hook in (term.force, term.rolling, term.torque, term.drive))
        ]

        radii = self.radius + 0.5 * self.beads.of("diameter", values, self.bead)

        def pull(place: Array, speed: Array, time: Array) -> Array:
            mu = friction
            extra = np.zeros_like(speed)
            for term, own in acting:
                if term.rolling is not None:
                    mu = term.rolling(mu, np.abs(speed), self.radius, *own)
                if term.force is not None:
                    # the track is straight: the force along it depends on the speed alone
                    extra = extra + term.force(speed, 0 * speed, 0.0, radii[:seen], self.mass, *own)[0] / self.mass
                if term.torque is not None:
                    extra = extra + term.torque(place, speed, 1.0, 1.0, *own)
                if term.drive is not None:
                    extra = extra + term.drive(t0 + time, place, speed, *own)
            return np.asarray(ROLLS * (self.lab.gravity * (sine - mu * cosine) + extra))

        since = true - t0[:, self.owner]
        until = np.array([np.maximum(since[:, span].max(axis=1), 1e-3) for span in self.spans]).T
        motion = ride(start, np.maximum(push, 0.0), pull, until)
        place, speed = place_at(motion, since, self.owner)
        s, c = sine[:, self.owner], cosine[:, self.owner]
        radius = radii[:seen, self.owner]
        side = self.side[self.owner]
        x, y = side * (place * c + radius * s), radius * c - place * s
        law = np.stack([values[f"rolling_friction.{pair}"] for pair in self.pairs], axis=-1)[:, self.pair]
        for term in terms:
            if term.name == LEVER and term.rolling is not None:
                # the friction of each repetition is one unknown; that of a lever arm does not depend on the speed,
                # and depends on the true radius, not the stated one
                own = [values[f"{term.name}.{p.name}"][:, None] for p in term.parameters]
                law = term.rolling(law, 0.0, radii, *own)
        if "surface_direction.asymmetry" in values:
            lay = self.turned * self.side * self.faces
            law = law * (1.0 + values["surface_direction.asymmetry"][:, None] * lay)
        return Moved(x, y, side * speed[0] * c[0], -speed[0] * s[0], (frictions - law)[..., None])

    def tied(self, terms: Sequence[Effect]) -> list[str]:
        """Coefficients of the baseline that one of these terms replaces by a single one."""
        levers = any(term.name == LEVER for term in terms)
        return [f"rolling_friction.{pair}" for pair in self.pairs] if levers else []

    def quiet(self, name: str, terms: Sequence[Effect]) -> bool:
        """Whether the unknown changes no motion: friction of a pair does not, each repetition has its own friction."""
        return name.startswith(("rolling_friction.", f"{LEVER}.", "surface_direction."))

    def touches(self, name: str) -> tuple[str, Array] | None:
        """A friction acts in the repetitions of its pair, an angle in its condition's, a diameter in its bead's."""
        kind, _, rest = name.partition(".")
        if kind == "rolling_friction":
            return kind, self.pair == self.pairs.index(rest)
        if kind == "angle":
            return kind, self.condition == self.condition_names.index(rest)
        if kind == "diameter":
            return kind, self.bead == self.beads.names.index(rest)
        return None


def orientation(conditions: Sequence[Condition]) -> Array:
    """1 for each condition whose surface lies as at first, -1 where it lies end for end, shape (C,)."""
    return np.where(_stated(conditions, "surface_turned"), -1.0, 1.0)


def _stated(conditions: Sequence[Condition], name: str) -> Any:
    """Whether each condition states that this is so, shape (C,)."""
    return np.array([bool(condition.settings.get(name, False)) for condition in conditions])


def both_ways(lab: TrackedLab) -> bool:
    """Whether the surface lies in both orientations."""
    return len(set(orientation(lab.conditions).tolist())) > 1


def one_material_of_many_sizes(lab: TrackedLab) -> bool:
    """Whether the lab can separate one lever arm from individual friction coefficients of the beads."""
    materials = {str(one.bead.about.get("material") or one.bead.name) for one in lab.conditions}
    sizes = {round(one.bead.diameter, 4) for one in lab.conditions}
    apart = max(sizes) >= WIDEST * min(sizes)
    walls = {one.wall for one in lab.conditions}
    return len(materials) == len(walls) == 1 and len(sizes) >= FEWEST_SIZES and apart
