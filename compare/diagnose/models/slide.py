"""Reduced model of sliding: a clump lies on an arm that tilts at a constant rate, slips, and slides.

World axes: x right along the level, y up, origin on the hinge axis in the arm's surface; the arm rises to the right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.models.camera import camera_unknowns
from rigtwin.compare.diagnose.models.rows import Runs
from rigtwin.compare.diagnose.models.scattered import Scattered, of_pairs
from rigtwin.compare.diagnose.models.sensitivities import STEADY, Moved
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect
from rigtwin.sim.reduced.track import place_at, ride

KINETIC = 0.003
"""Standard deviation from run to run of the kinetic less the static friction coefficient, where a fit begins."""
MOST_KINETIC = 3 * KINETIC
"""Largest standard deviation of that in a fit; with a larger one the baseline takes up a friction drop as scatter."""
USUAL_KINETIC = 0.9 * MOST_KINETIC  # a fit that reaches its limit has more
HALF_NORMAL = 0.4  # mean of the negative half of a normal distribution over its standard deviation, the other half zero
INSTANT = 0.01  # [s], step of the slopes of friction over time; a clump waits for seconds
# least slope over time of the friction that is needed, less that of the law, over the former: 0.8 with a strong ageing,
# 0 where the clump would never slip
LEAST_APART = 0.1
TRACKED_POINT = 5e-4  # [m], standard uncertainty of the height of the tracked point above the arm, in each repetition


class SlideBench(Runs):
    """All repetitions of a lab of clumps on a tilting arm."""

    bodies = 1
    onset = -1
    small = STEADY
    drivable = True
    per_run = ("conditions", "start", "rate", "waiting", "distance", "clump", "pair", "bead")

    def __init__(self, lab: TrackedLab) -> None:
        super().__init__(lab)
        self.start = np.radians(self.setting("start_angle_deg", 0.0))
        self.rate = np.radians(self.setting("tilt_rate_deg_s"))
        self.waiting = self.setting("waiting_time_s", 0.0)
        self.distance = self.setting("start_distance_m")
        self.clump = self.setting("clump_mass_g", math.nan) * 1e-3
        self.clump = np.where(np.isfinite(self.clump), self.clump, self.mass)
        self.pairs = list(dict.fromkeys(f"{c.bead.name}-{c.wall}" for c in self.conditions))
        self.pair = np.array([self.pairs.index(f"{c.bead.name}-{c.wall}") for c in self.conditions])
        count = len(self.conditions)
        # local unknowns: position on the arm, the arm's stated angle at the slip, kinetic less static friction, height
        # of the tracked point above the stated one.  The rows determine the slip to microseconds; friction as the
        # unknown would make the fit nonlinear in the correlated tilt and camera roll.
        self.local_prior = np.stack([self.distance, np.full(count, 0.4), np.zeros(count), np.zeros(count)], axis=1)
        self.local_sd = np.tile([2e-3, np.inf, np.inf, TRACKED_POINT], (count, 1))
        self.local_step = np.array([1e-3, 1e-3, 1e-2, 1e-3])
        self.local_low = np.full(len(self.local_step), -np.inf)
        pairs = len(self.pairs)
        self.scatter = np.stack([self.pair, np.full(count, pairs)], axis=1)
        self.scattered = [
            *of_pairs("static_friction", self.pairs),
            Scattered("kinetic less static friction", "1", USUAL_KINETIC),
        ]
        self.scatter_start = np.array([*([0.01] * pairs), KINETIC])
        self.scatter_most = np.array([*([np.inf] * pairs), MOST_KINETIC])

    def unknowns(self, terms: Sequence[Effect]) -> list[Unknown]:
        """Friction of each pair; tilt rate, level and calibration with their priors."""
        own = [Unknown(f"static_friction.{pair}", 0.4, 0.01, low=0.01, high=3.0) for pair in self.pairs]
        # a clump with a kinetic friction above the static one rests until the arm is steep enough for the kinetic one,
        # so that chance lowers the mean of the kinetic friction
        lower = -HALF_NORMAL * KINETIC
        own.append(Unknown("kinetic_friction.offset", lower, KINETIC, prior=lower, sd=HALF_NORMAL * KINETIC))
        rate = self.lab.uncertainty("tilt_rate_uncertainty_rel", default=0.002)
        level = math.radians(self.lab.uncertainty("plate_level_uncertainty_deg", default=0.1))
        priors = {"plate_tilt": level, "tilt_rate_error": rate}
        return [*own, *self.beads.unknowns(), *camera_unknowns(self.lab, terms, priors)]

    def first_guess(self, values: Mapping[str, float]) -> Array:
        """Starting values (R, L): position on the arm [m], and stated angle [rad] at the first motion."""
        clock = 1.0 + values.get("frame_rate_error.relative", 0.0)
        guess = self.local_prior.copy()
        for r, span in enumerate(self.spans):
            time = self.time[span] / clock
            reach = np.hypot(self.rows[span][:, 0], self.rows[span][:, 1])
            still = float(np.median(reach[: max(len(reach) // 10, 3)]))
            guess[r, 0] = still
            gone = still - reach
            fast = np.flatnonzero(gone > 0.3 * float(gone.max()))[0]
            moved = np.flatnonzero(gone[: fast + 1] < max(6 * self.noise, 0.01 * float(gone.max())))[-1]
            guess[r, 1] = self.start[r] + self.rate[r] * float(time[moved])
        return guess

    def move(self, local: Array, values: Mapping[str, Array], terms: Sequence[Effect], true: Array, seen: int) -> Moved:
        """Motion of all repetitions for a stack of settings."""
        gravity, high = self.lab.gravity, self.radius
        rate = self.rate * (1 + values["tilt_rate_error.relative"][:, None])
        start = self.start + values["plate_tilt.angle"][:, None]
        place, begin = local[..., 0], (local[..., 1] - self.start) / self.rate
        slip = start + rate * begin

        def needed(time: Array) -> Array:
            """Friction coefficient without which the clump would slip at that time."""
            # the rotation of the arm changes the load slightly, and driving forces act before the slip too
            angle, driving = start + rate * time, np.zeros_like(place)
            for term in terms:
                if term.drive is not None:
                    own = [values[f"{term.name}.{p.name}"][:, None] for p in term.parameters]
                    driving = driving + term.drive(time, 0 * place, 0 * place, *own)
            return np.asarray(
                (gravity * np.sin(angle) - place * rate**2 + driving) / (gravity * np.cos(angle) - high * rate**2)
            )

        def law(time: Array) -> Array:
            return self._onset(start + rate * time, time, values, terms)

        static = needed(begin)
        # Where the law rises on the way to the slip, a clump that holds longer than it says meets more friction: the
        # scatter is that of the slip itself, else such a law would gain by the scatter that it takes away.
        rises = (law(begin + INSTANT) - law(begin)) / (needed(begin + INSTANT) - static)
        beyond = (static - law(begin)) / np.maximum(1 - rises, LEAST_APART)
        kinetic = local[..., 2]
        lower = values["kinetic_friction.offset"][:, None]
        soft = np.stack([beyond, kinetic - lower], axis=-1)
        kinetic, off = kinetic[:seen], local[:seen, :, 3]
        place, static, slip, begin = place[:seen], static[:seen], slip[:seen], begin[:seen]
        rate, start = rate[:seen], start[:seen]
        acting = [
            (term, [values[f"{term.name}.{p.name}"][:seen, None] for p in term.parameters])
            for term in terms
            if any(hook is not None for hook in (term.torque, term.sliding, term.onset, term.drive))
        ]
        plain = self._plain(values)[:seen]
        at_slip = self.clump * gravity * np.cos(slip)

        def pull(way: Array, speed: Array, time: Array) -> Array:
            """Acceleration [m/s^2] down the arm."""
            angle = slip + rate * time
            pressing = gravity * np.cos(angle) - 2 * speed * rate - high * rate**2
            extra = np.zeros_like(speed)
            mu = static + kinetic
            for term, own in acting:
                if term.torque is not None:
                    extra = extra + term.torque(way, speed, 1.0, 1.0, *own)
                if term.drive is not None:
                    extra = extra + term.drive(begin + time, way, speed, *own)
                if term.onset is not None:
                    # forces other than the weight also act during sliding, and the normal force changes
                    now = term.onset(plain, self.waiting, self.clump * pressing, *own)
                    mu = mu + now - term.onset(plain, self.waiting, at_slip, *own)
                if term.sliding is not None:
                    mu = term.sliding(mu, np.abs(speed), self.waiting, *own)
            return gravity * np.sin(angle) - (place - way) * rate**2 - mu * pressing + extra

        since = true - begin[:, self.owner]
        until = np.array([np.maximum(since[:, span].max(axis=1), 1e-3) for span in self.spans]).T
        motion = ride(np.zeros_like(place), np.full_like(place, 1e-6), pull, until, may_stop=False)
        way, speed = place_at(motion, since, self.owner)
        angle = start[:, self.owner] + rate[:, self.owner] * true
        lift = (off + (high + 0.5 * self.beads.of("diameter", values, self.bead))[:seen])[:, self.owner]
        reach = place[:, self.owner] - way
        x, y = reach * np.cos(angle) - lift * np.sin(angle), reach * np.sin(angle) + lift * np.cos(angle)
        turning = rate[0][self.owner]
        vx, vy = -speed[0] * np.cos(angle[0]) - turning * y[0], -speed[0] * np.sin(angle[0]) + turning * x[0]
        return Moved(x, y, vx, vy, soft)

    def quiet(self, name: str, terms: Sequence[Effect]) -> bool:
        """Whether the unknown changes no motion: friction of a pair does not, as each repetition has a slip angle."""
        if name == "kinetic_friction.offset":
            return True
        return name.startswith("static_friction.") and not any(term.onset is not None for term in terms)

    def touches(self, name: str) -> tuple[str, Array] | None:
        """A friction acts in the repetitions of its pair, a diameter in those of its bead."""
        kind, _, rest = name.partition(".")
        if kind == "diameter":
            return kind, self.bead == self.beads.names.index(rest)
        return (kind, self.pair == self.pairs.index(rest)) if kind == "static_friction" else None

    def _plain(self, values: Mapping[str, Array]) -> Array:
        """Friction of the pair of each repetition, shape (settings, R)."""
        return np.stack([values[f"static_friction.{pair}"] for pair in self.pairs], axis=-1)[:, self.pair]

    def _onset(self, angle: Array, time: Array, values: Mapping[str, Array], terms: Sequence[Effect]) -> Array:
        """Friction coefficient at rest by the law, at an angle [rad] and time [s] of the tilting, (settings, R)."""
        onset = self._plain(values)
        normal = self.clump * self.lab.gravity * np.cos(angle)
        for term in terms:
            if term.onset is not None:
                own = [values[f"{term.name}.{p.name}"][:, None] for p in term.parameters]
                onset = term.onset(onset, self.waiting + time, normal, *own)
        return np.asarray(onset)
