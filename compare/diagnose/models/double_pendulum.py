"""Reduced model of colliding pendulums: bead A against bead B, or a bead against a vertical wall.

World axes: x right, y up; origin midway between the two pivots, or at the pivot.  A hangs on the left and is released
to the left; the wall is to the left of a bead released to the right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.models.camera import camera_unknowns
from rigtwin.compare.diagnose.models.pendulum import OWN_LENGTH, pushing, true_lengths
from rigtwin.compare.diagnose.models.rows import Runs, coefficients, shared
from rigtwin.compare.diagnose.models.scattered import of_pairs
from rigtwin.compare.diagnose.models.sensitivities import SMALL, Moved
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect
from rigtwin.sim.reduced.swing_and_collide import Mutual, angles_at, swing_and_hit

MOST_IMPACTS = 7  # largest number of impacts with a restitution of their own
MOST_CLOCK = 0.1  # relative error of the stated frame rate up to which every filmed impact has a restitution of its own
HANGS = 5e-4  # [rad], standard uncertainty of the rest angle of the waiting bead
FIRST_GUESS = 0.65  # starting value of a restitution
PIVOTS = 1e-4  # [m], standard uncertainty of the pivot spacing where none is stated


class DoubleBench(Runs):
    """All repetitions of a lab with two pendulums, or one pendulum and a wall."""

    onset = 0
    small = SMALL
    per_run = ("conditions", "length", "which", "pair", "bead", "active")

    def __init__(self, lab: TrackedLab) -> None:
        super().__init__(lab)
        self.wall = lab.rig == "pendulum"
        self.length = self.setting("length_m")
        self.lengths = sorted(set(self.length.tolist()))
        self.which = np.array([self.lengths.index(length) for length in self.length.tolist()])
        others = [c.wall if self.wall else c.bead.name for c in self.conditions]
        names = [f"{c.bead.name}-{other}" for c, other in zip(self.conditions, others, strict=True)]
        self.pairs = list(dict.fromkeys(names))
        self.pair = np.array([self.pairs.index(name) for name in names])
        side = 1.0 if self.wall else -1.0
        angle = side * np.abs(np.radians(self.setting("release_angle_deg")))
        self.bodies = 1 if self.wall else 2
        numbers = [k % self.bodies for k, (_, _, track) in enumerate(self.runs) for _ in track.time]
        self.body: Any = np.array(numbers)
        count = len(self.conditions)
        release_sd = math.radians(lab.uncertainty("release_angle_uncertainty_deg", default=0.3))
        ends = np.array([float(self.time[span].max()) for span in self.spans])
        # one contact every half period, the first after a quarter period; one too late to be filmed does no harm
        half = math.pi * np.sqrt(self.length / lab.gravity)
        seen = np.clip(((1 + MOST_CLOCK) * ends / half + 0.5).astype(int), 1, MOST_IMPACTS)
        self.impacts = int(seen.max())
        self.active = np.arange(self.impacts)[None] < seen[:, None]
        self.local_prior = np.concatenate(
            [np.zeros((count, 1)), angle[:, None], np.zeros((count, 1)), np.full((count, self.impacts), FIRST_GUESS)],
            axis=1,
        )
        waits = np.full((count, 1), 1e-7 if self.wall else HANGS)
        self.local_sd = np.concatenate(
            [
                np.full((count, 1), 10.0),
                release_sd * shared(self.condition)[:, None],
                waits,
                np.where(self.active, np.inf, 1e-3),
            ],
            axis=1,
        )
        self.local_step = np.array([1e-3, 1e-2, 1e-3, *([1e-2] * self.impacts)])
        self.local_low = np.full(len(self.local_step), -np.inf)
        self.scatter = np.where(self.active, self.pair[:, None], -1)
        self.scattered = of_pairs("restitution", self.pairs)
        self.scatter_start = np.full(len(self.pairs), 0.03)
        self.scatter_most = np.full(len(self.pairs), np.inf)

    def unknowns(self, terms: Sequence[Effect]) -> list[Unknown]:
        """Restitution of each pair, thread lengths and calibration with their priors."""
        own = [Unknown(f"restitution.{pair}", FIRST_GUESS, 0.05, low=0.01, high=1.2) for pair in self.pairs]
        length_sd = self.lab.uncertainty("length_uncertainty_m", default=5e-4)
        bodies = "A" if self.wall else "AB"
        threads = [
            Unknown(f"length.{body}.{length:g}", 0.0, 1e-3, sd=OWN_LENGTH * length_sd, low=-0.02, high=0.02)
            for length in self.lengths
            for body in bodies
        ]
        if not self.wall:
            set_up = self.lab.uncertainty("pivot_spacing_uncertainty_m", default=PIVOTS)
            own += [*self.beads.unknowns(), *self.beads.unknowns("pivots", set_up)]
        if self.wall:
            level = math.radians(self.lab.uncertainty("plate_level_uncertainty_deg", default=0.1))
            own.append(Unknown("wall.angle", 0.0, 1e-3, sd=level, low=-0.1, high=0.1))
        return [*own, *threads, *camera_unknowns(self.lab, terms, {"length_error": length_sd})]

    def first_guess(self, values: Mapping[str, float]) -> Array:
        """Release time from the moment A's angle has fallen by a tenth."""
        clock = 1.0 + values.get("frame_rate_error.relative", 0.0)
        guess = self.local_prior.copy()
        for r, span in enumerate(self.spans):
            mine = self.body[span] == 0
            time, place = self.time[span][mine] / clock, self.rows[span][mine]
            shift = 0.0 if self.wall else self.radius[r]
            angle = np.abs(np.arctan2(place[:, 0] + shift, -place[:, 1]))
            part = int(np.argmax(angle < 0.9 * float(np.median(angle[:3]))))
            omega = math.sqrt(self.lab.gravity / self.length[r])
            guess[r, 0] = max(float(time[part]) - math.sqrt(0.2) / omega, 0.0)
        return guess

    def horizons(self) -> list[Any]:
        """Masks (N,) of rows up to the first and the second contact, fitted first."""
        half = (math.pi * np.sqrt(self.length / self.lab.gravity))[self.owner]
        return [self.time < 0.9 * half + 0.05, self.time < 1.9 * half + 0.05]

    def move(self, local: Array, values: Mapping[str, Array], terms: Sequence[Effect], true: Array, seen: int) -> Moved:
        """Motion of all repetitions for a stack of settings."""
        reach = [self._lengths("A", values), self._lengths("A" if self.wall else "B", values)]
        gravity = self.lab.gravity
        wider = self._of_bead("diameter", values)
        radius = self.radius + 0.5 * wider
        first, omega = pushing(reach[0], self.mass, radius, gravity, values, terms)
        second, _ = pushing(reach[1], self.mass, radius, gravity, values, terms)
        since = true - local[..., 0][:, self.owner]
        until = np.array([np.maximum(since[:, span].max(axis=1), 1e-3) for span in self.spans]).T
        laws = self._laws(values)
        still: Any = (lambda a, w: 0 * a) if self.wall else second
        stands = values["wall.angle"][:, None] if self.wall else 0.0
        apart = self._of_bead("pivots", values)
        law = partial(self._law, laws, values, terms)
        contacts = _Contacts(self, local, reach, law, stands, (apart, apart - wider))
        mutual = contacts.mutual(terms, values) if any(term.mutual is not None for term in terms) else None
        waits = local[..., 2]
        if mutual is not None:  # the waiting bead hangs where weight and force balance
            waits = waits + mutual(local[..., 1], waits)[1] / omega**2
        motion = swing_and_hit(
            (local[..., 1], waits),
            (first, still),
            2 * math.pi / omega,
            until,
            contacts.gap,
            contacts.hit,
            self.impacts,
            dry=any(term.torque is not None for term in terms),
            mutual=mutual,
        )
        angle, rate = angles_at(motion, since, self.owner, self.body)
        thread = np.where(self.body == 0, reach[0][:, self.owner], reach[1][:, self.owner])
        pivot_side = np.where(self.body == 0, -1.0, 1.0)
        offset = 0.0 if self.wall else pivot_side * (self.radius + 0.5 * apart)[:, self.owner]
        x, y = offset + thread * np.sin(angle), -thread * np.cos(angle)
        speed = thread[0] * rate[0]
        soft = np.where(self.active, local[..., 3:] - law(np.moveaxis(motion.speeds, 0, -1)), 0.0)
        return Moved(x, y, speed * np.cos(angle[0]), speed * np.sin(angle[0]), soft)

    def quiet(self, name: str, terms: Sequence[Effect]) -> bool:
        """Always False: the contact law sets the motion after the impacts that have their own restitution."""
        return False

    def touches(self, name: str) -> tuple[str, Array] | None:
        """A restitution acts in the repetitions of its pair, a length in those of its conditions."""
        kind, _, rest = name.partition(".")
        if kind == "restitution":
            return kind, self.pair == self.pairs.index(rest)
        if kind == "length":
            body, _, length = rest.partition(".")
            return f"length.{body}", self.which == [f"{one:g}" for one in self.lengths].index(length)
        if kind in ("diameter", "pivots"):
            return kind, self.bead == self.beads.names.index(rest)
        return None

    def _lengths(self, body: str, values: Mapping[str, Array]) -> Array:
        own = np.stack([values[f"length.{body}.{length:g}"] for length in self.lengths], axis=-1)[:, self.which]
        return true_lengths(self.length, values) + own

    def _of_bead(self, kind: str, values: Mapping[str, Array]) -> Array:
        """Error [m] of the diameters or of the pivot spacing in each repetition."""
        if self.wall:
            return np.zeros((1, 1))
        return self.beads.of(kind, values, self.bead)

    def restitutions(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Restitution of each pair, before any effect."""
        return {pair: values[f"restitution.{pair}"] for pair in self.pairs}

    def _laws(self, values: Mapping[str, Array]) -> Array:
        return np.stack(list(self.restitutions(values).values()), axis=-1)[:, self.pair]

    def _law(self, laws: Array, values: Mapping[str, Array], terms: Sequence[Effect], speed: Array) -> Array:
        """Restitution of the law at each speed [m/s], shape (settings, R, impacts)."""
        e = laws[..., None] + 0 * speed
        for term in terms:
            if term.restitution is not None:
                own = coefficients(term, values, self.lab, self.conditions)
                e = term.restitution(e, speed, self.radius[:, None], self.mass[:, None], *own)
        return e


class _Contacts:
    """Gap between the surfaces and change of the velocities in an impact, for one stack of settings."""

    def __init__(
        self,
        bench: DoubleBench,
        local: Array,
        reach: list[Array],
        law: Callable[[Array], Array],
        stands: Array | float,
        room: tuple[Array, Array],
    ) -> None:
        self.bench, self.local, self.reach, self.law, self.stands = bench, local, reach, law, stands
        # [m], error of the pivot spacing, and gap between the beads at rest
        self.apart, self.play = room

    def gap(self, a: Array, b: Array, u: Array, v: Array) -> tuple[Array, Array]:
        if self.bench.wall:
            return self.reach[0] * np.sin(a - self.stands), self.reach[0] * u * np.cos(a - self.stands)
        x, y, (sin_a, cos_a), (sin_b, cos_b) = self._between(a, b)
        left, right = self.reach[0] * u, self.reach[1] * v
        # the gap is measured along x: the distance of the centres grows again once one bead is half through the other
        touch = 2 * self.bench.radius + self.apart - self.play
        contact_x = np.sqrt(np.maximum(touch**2 - y**2, (0.1 * touch) ** 2))
        closing = right * cos_b - left * cos_a + y / contact_x * (right * sin_b - left * sin_a)
        return x - contact_x, closing

    def hit(self, a: Array, b: Array, u: Array, v: Array, count: Array, resting: Array) -> tuple[Array, Array, Array]:
        impacts = self.bench.impacts
        at = np.minimum(count, impacts - 1)
        e = np.take_along_axis(self.local[..., 3:], at[..., None], axis=2)[..., 0]
        filmed = np.take_along_axis(np.broadcast_to(self.bench.active, (*count.shape, impacts)), at[..., None], axis=2)
        followed = (count < impacts) & filmed[..., 0]
        if self.bench.wall:
            speed = np.abs(self.reach[0] * u)
            return -self._after(e, followed, speed, resting) * u, v, speed
        _, along_a, along_b = self._along(a, b)
        closing = self.reach[1] * v * along_b - self.reach[0] * u * along_a
        e = self._after(e, followed, np.abs(closing), resting)
        impulse = -(1 + e) * closing / (along_a**2 + along_b**2)
        return u - impulse * along_a / self.reach[0], v + impulse * along_b / self.reach[1], np.abs(closing)

    def mutual(self, terms: Sequence[Effect], values: Mapping[str, Array]) -> Mutual:
        """Angular accelerations of both beads by the forces between them."""
        bench = self.bench
        acting = [
            (term.mutual, [values[f"{term.name}.{p.name}"][:, None] for p in term.parameters])
            for term in terms
            if term.mutual is not None
        ]

        def pushed(a: Array, b: Array) -> tuple[Array, Array]:
            distance, along_a, along_b = self._along(a, b)
            force = sum(hook(distance, bench.radius, bench.mass, *own) for hook, own in acting)
            return -force * along_a / (bench.mass * self.reach[0]), force * along_b / (bench.mass * self.reach[1])

        return pushed

    def _after(self, own: Array, followed: Array, speed: Array, resting: Array) -> Array:
        """The impact's own restitution, that of the law at its speed without one, or that of bobs that rest."""
        if not followed.all():
            own = np.where(followed, own, self.law(np.maximum(speed, 1e-3)[..., None])[..., 0])
        return np.where(np.isnan(resting), own, resting)

    def _between(self, a: Array, b: Array) -> tuple[Array, Array, tuple[Array, Array], tuple[Array, Array]]:
        """From centre to centre [m], x and y, and sine and cosine of the angles of both threads."""
        (sin_a, cos_a), (sin_b, cos_b) = (np.sin(a), np.cos(a)), (np.sin(b), np.cos(b))
        x = 2 * self.bench.radius + self.apart + self.reach[1] * sin_b - self.reach[0] * sin_a
        return x, self.reach[0] * cos_a - self.reach[1] * cos_b, (sin_a, cos_a), (sin_b, cos_b)

    def _along(self, a: Array, b: Array) -> tuple[Array, Array, Array]:
        """Distance of the centres [m], and the parts of both beads' directions of motion along it [1]."""
        x, y, at_a, at_b = self._between(a, b)
        distance = np.hypot(x, y)
        along_a, along_b = ((x * cosine + y * sine) / distance for sine, cosine in (at_a, at_b))
        return distance, along_a, along_b
