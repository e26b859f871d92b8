"""How much an effect shows in a lab: what it would gain in chi-square over the best plain model.

One run of every condition is computed with the effect and without noise, and the plain model of the same module is
fitted to all of them at once, by Gauss-Newton steps: every number that may differ from what is stated (`Chance`), in a
run, in a group of runs or in the lab, has its standard deviation as a prior; a restitution or a friction is free.  What
is left of the sum of squares, in units of the tracking noise, is the gain (deviations from run to run count as if their
scatter had to be found from them),

    min over u of  sum of n (rows(effect) - rows(plain, u))^2 / noise^2 + (u / sd)^2,

with n the repetitions of a condition.  Rows between an impact (or a slip) of one motion and that of the other are left
out; the fit starts where the times of these agree.  A gain far beyond the limit of detection need not be accurate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigtwin.benchmarks.diagnose.independent_labs_film import CAMERA, real_times, seen, stamps
from rigtwin.benchmarks.diagnose.independent_labs_types import Array, Chance, Condition, Hidden, Lab, Motion

ROWS = 120  # of a run at most; more are thinned, each then counts for several
STEPS, SHORTER = 12, 6  # of the fit, and how often a step that does not help is shortened
ENOUGH = 5e3  # a gain that needs no more accuracy
ON_TIME, FAR = 1e-4, 30.0  # [s], and in standard deviations: for the start of a fit
PLAIN = Hidden()
SEEN_ONLY = {chance.name for chance in CAMERA}


@dataclass(frozen=True)
class _Model:
    """The plain model of one condition, at some deviations."""

    motion: Motion
    rows: Array
    slopes: Array  # (chances, coordinates, times)
    starts: Array  # (chances, pieces + 1), derivatives of the times at which pieces start and the last one ends


class Strength:
    """The plain model of a lab, to weigh effects with."""

    def __init__(self, lab: Lab) -> None:
        self.lab = lab
        self.chances = (*lab.chances, *CAMERA)
        self.keys = [[self._key(chance, condition) for chance in self.chances] for condition in lab.conditions]
        names = dict.fromkeys(key for keys in self.keys for key in keys)
        self.number = {key: number for number, key in enumerate(names)}
        self.weight = np.zeros(len(names))  # of the square of each deviation
        for keys, condition in zip(self.keys, lab.conditions, strict=True):
            for key, chance in zip(keys, self.chances, strict=True):
                times = condition.repetitions if chance.scope == "run" else 1
                self.weight[self.number[key]] = times / chance.prior**2
        motions = [lab.move(condition, {}, PLAIN) for condition in lab.conditions]
        self.ends = [motion.end for motion in motions]
        self._film(motions, PLAIN)
        zero = np.zeros(len(names))
        self.plain = [self._model(k, zero) for k in range(len(lab.conditions))]

    def _film(self, motions: list[Motion], hidden: Hidden) -> None:
        """The times to look at, and the noise of what is seen then."""
        self.times, self.sigma = [], []
        for motion, condition in zip(motions, self.lab.conditions, strict=True):
            every = stamps(motion, self.lab, {}, hidden)
            thin = -(-len(every) // ROWS)
            self.times.append(every[thin // 2 :: thin])
            self.sigma.append(self.lab.noise * self.lab.scale / np.sqrt(thin * condition.repetitions))

    def _key(self, chance: Chance, condition: Condition) -> tuple[str, str]:
        here = condition.stated["name"]
        shared = {"lab": "", "run": here, "condition": here}
        return chance.name, shared[chance.scope] if chance.scope in shared else condition.groups[chance.scope]

    def _off(self, k: int, values: Array) -> dict[str, float]:
        return {
            chance.name: float(values[self.number[key]])
            for chance, key in zip(self.chances, self.keys[k], strict=True)
        }  # fmt: skip

    def _model(self, k: int, values: Array, old: _Model | None = None) -> _Model:
        """Rows at these deviations, with derivatives, or with those of an `old` model."""
        condition, times, off = self.lab.conditions[k], self.times[k], self._off(k, values)
        motion = self.lab.move(condition, off, PLAIN)
        rows = seen(motion, times, off, PLAIN)
        if old:
            return _Model(motion, rows, old.slopes, old.starts)
        slopes, starts = (
            np.zeros((len(self.chances), *rows.shape)),
            np.zeros((len(self.chances), len(motion.starts) + 1)),
        )
        for c, chance in enumerate(self.chances):
            there = off | {chance.name: off[chance.name] + chance.step}
            moved = motion if chance.name in SEEN_ONLY else self.lab.move(condition, there, PLAIN)
            same = _alike(motion, off, PLAIN, moved, there, PLAIN, times)
            slopes[c] = np.where(same, seen(moved, times, there, PLAIN) - rows, 0.0) / chance.step
            both = min(len(moved.starts), len(motion.starts))
            starts[c, :both] = np.subtract(moved.starts[:both], motion.starts[:both]) / chance.step
            starts[c, -1] = (moved.end - motion.end) / chance.step
        return _Model(motion, rows, slopes, starts)

    def gain(self, hidden: Hidden) -> float:
        """In chi-square, of the effect over the plain model."""
        affected = [self.lab.move(condition, {}, hidden) for condition in self.lab.conditions]
        values = self._aligned(affected)
        other = any(abs(now.end / end - 1) > 0.02 for now, end in zip(affected, self.ends, strict=True))
        if other:
            self._film(affected, hidden)
        starts = [(values, [self._model(k, values) for k in range(len(affected))])]
        if not other:
            starts.append((np.zeros_like(values), self.plain))
        values, models = min(starts, key=lambda start: self._far(start[1], affected, hidden, start[0]))
        gain = self._least(models, affected, hidden, values)
        if other:
            self._film([model.motion for model in self.plain], PLAIN)
        return gain

    def _far(self, models: list[_Model], affected: list[Motion], hidden: Hidden, values: Array) -> float:
        """Sum of squares with the rows between an impact of one motion and that of the other."""
        total = float(self.weight @ values**2)
        for k, model in enumerate(models):
            left = seen(affected[k], self.times[k], {}, hidden) - model.rows
            total += float(np.sum((left / self.sigma[k]) ** 2))
        return total

    def _least(self, models: list[_Model], affected: list[Motion], hidden: Hidden, values: Array) -> float:
        """The least sum of squares."""
        normal, right, now = self._equations(models, affected, hidden, values)
        sound = False  # whether the last step led where it was foreseen to
        for _ in range(STEPS):
            step = _solved(normal, right)
            foreseen = now - float(right @ step)
            if now - foreseen < 0.02 * now or now < 1e-3 or (sound and foreseen > ENOUGH):
                break
            for _ in range(SHORTER):
                try:
                    tried = [self._model(k, values + step, old) for k, old in enumerate(models)]
                    there = self._equations(tried, affected, hidden, values + step)
                except ValueError:  # there is no such motion
                    there = normal, right, np.inf
                if there[2] < now:
                    break
                step = step / 3
            else:
                break
            values = values + step
            sound = there[2] < 1.3 * foreseen + 1.0
            if not sound:  # the derivatives have changed
                models = [self._model(k, values) for k in range(len(models))]
                there = self._equations(models, affected, hidden, values)
            normal, right, now = there
        return now - self._not_known(values)

    def _not_known(self, values: Array) -> float:
        """What a sum of squares of deviations from run to run exceeds the gain by, as the scatter is not known either.

        Of N deviations with the sum of squares q, the likelihood with the best scatter differs by N ln(1 + q / N).
        """
        squares: dict[str, float] = {}
        counts: dict[str, int] = {}
        for keys, condition in zip(self.keys, self.lab.conditions, strict=True):
            for key, chance in zip(keys, self.chances, strict=True):
                if chance.scope == "run" and np.isfinite(chance.prior):
                    kind = chance.name.rstrip("0123456789")
                    place = self.number[key]
                    squares[kind] = squares.get(kind, 0.0) + float(self.weight[place] * values[place] ** 2)
                    counts[kind] = counts.get(kind, 0) + condition.repetitions
        return sum(q - counts[kind] * float(np.log1p(q / counts[kind])) for kind, q in squares.items())

    def _equations(
        self, models: list[_Model], affected: list[Motion], hidden: Hidden, values: Array
    ) -> tuple[Array, Array, float]:
        """Normal equations of a step, their right-hand side, and the sum of squares."""
        normal, right = np.diag(self.weight), -self.weight * values
        total = float(self.weight @ values**2)
        for k, model in enumerate(models):
            same = _alike(model.motion, self._off(k, values), PLAIN, affected[k], {}, hidden, self.times[k])
            left = np.where(same, seen(affected[k], self.times[k], {}, hidden) - model.rows, 0.0) / self.sigma[k]
            slopes = np.where(same, model.slopes, 0.0).reshape(len(self.chances), -1) / self.sigma[k]
            where = [self.number[key] for key in self.keys[k]]
            normal[np.ix_(where, where)] += slopes @ slopes.T
            right[where] += slopes @ left.ravel()
            total += float(np.sum(left**2))
        return normal, right, total

    def _aligned(self, affected: list[Motion]) -> Array:
        """Deviations of the runs with which impacts and slips come when they do in the affected motions."""
        values = np.zeros(len(self.number))
        for k, (model, motion) in enumerate(zip(self.plain, affected, strict=True)):
            own = [c for c, chance in enumerate(self.chances) if chance.scope == "run" and np.any(model.starts[c])]
            where = [self.number[self.keys[k][c]] for c in own]
            reach = np.minimum([self.chances[c].prior for c in own], 1.0)
            now = model
            for _ in range(6 if own else 0):
                both = min(len(motion.starts), len(now.motion.starts), model.starts.shape[1] - 1)
                late = np.subtract([*motion.starts[:both], motion.end], [*now.motion.starts[:both], now.motion.end])
                if np.abs(late).max() < 1e-5:
                    break
                slopes = (model.starts[own][:, [*range(both), -1]] * reach[:, None]).T
                # no deviation is made far larger than any that occurs for the sake of a time
                held = np.concatenate([slopes / ON_TIME, np.eye(len(own)) / FAR])
                wanted = np.concatenate([late / ON_TIME, -values[where] / reach / FAR])
                values[where] += reach * np.linalg.lstsq(held, wanted, rcond=1e-9)[0]
                try:
                    now = self._model(k, values, model)
                except ValueError:  # no such motion: the fit starts at the plain one
                    values[where] = 0.0
                    break
        return values


def _alike(
    one: Motion, off: Mapping[str, float], hidden: Hidden, other: Motion, off_other: Mapping[str, float],
    hidden_other: Hidden, times: Array,
) -> Array:  # fmt: skip
    """Times at which two motions are in the same piece."""
    pieces = one.piece(real_times(one, times, off, hidden)) == other.piece(
        real_times(other, times, off_other, hidden_other)
    )
    return np.asarray(pieces & (times < 0.995 * min(one.end, other.end)))


def _solved(normal: Array, right: Array) -> Array:
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(size, size)
    return np.linalg.solve(scaled + 1e-9 * np.eye(len(right)), right / size) / size
